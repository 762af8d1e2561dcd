"""Frequency responses of all channels, beside exact beams, filters and direct solutions."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import signal

import delam_fem as df
from delam_fem.api import Case, assemble, beams, of_channels
from delam_fem.model.responses import motions, mounting

FREQUENCY = np.linspace(0.5, 30.0, 60)
SOLVED = 1e-8
"""Relative error that is left by what (F1) leaves, near resonances of a damping ratio of 0.008."""
ELEMENTS = 2e-5
"""Relative error of 80 elements: (kL/80)⁴/720 = 1e-7 of the third frequency, 1/D times that."""
SENSORS = [
    {"name": name, "quantity": name, "lamina": "thin", "position": 0.3}
    for name in ("displacement", "velocity", "acceleration", "strain")
]


def test_tips_of_cantilevers_follow_the_exact_transmissibility() -> None:
    case = df.preset("paper", {"mesh.elements": 80})
    s = 2j * np.pi * FREQUENCY
    channels = of_channels(assemble(case, needs_dolfinx=False), case, s)
    for number, lamina in enumerate(case.lamina):
        exact = beams.transmissibility(
            2.0 * np.pi * FREQUENCY, length=lamina.length, mass_per_length=lamina.mass_per_length,
            flexural_rigidity=lamina.flexural_rigidity, rayleigh=case.rayleigh(number),
        )  # fmt: skip
        tip = channels[f"tip_{lamina.name}"]
        np.testing.assert_allclose(tip, exact, rtol=ELEMENTS)
        np.testing.assert_allclose(channels[f"tip_{lamina.name}_velocity"], s * tip, rtol=1e-14)


@pytest.mark.parametrize("decay", [0.0, 3.0])
def test_motions_solve_the_equation_at_each_point(decay: float) -> None:
    """Of a bonded stack under a force, beside a solution at each point, decay included."""
    case = df.preset("embedded")
    o = assemble(case, needs_dolfinx=False).operators
    s = decay + 2j * np.pi * np.linspace(1.0, 900.0, 70)
    basis, Y = motions(o, s)
    assert basis.shape[1] < o.n_dofs
    np.testing.assert_allclose(basis.T @ basis, np.eye(basis.shape[1]), atol=1e-12)
    for k, point in enumerate(s.tolist()):
        Z = (o.stiffness + point * o.damping + point**2 * o.mass).toarray()
        load = -(o.base.stiffness + point * o.base.damping + point**2 * o.base.mass)
        direct = np.linalg.solve(Z, load)
        assert np.linalg.norm(basis @ Y[:, k] - direct) < SOLVED * np.linalg.norm(direct)


def test_sensors_read_powers_of_s_and_strain_of_the_curvature() -> None:
    base = df.preset("paper")
    case = Case(**(base.model_dump(exclude_unset=True, exclude_none=True) | {"sensor": SENSORS}))
    s = 2j * np.pi * FREQUENCY
    channels = of_channels(assemble(case, needs_dolfinx=False), case, s)
    w = channels["displacement"]
    np.testing.assert_allclose(channels["velocity"], s * w, rtol=1e-9)
    np.testing.assert_allclose(channels["acceleration"], s**2 * w, rtol=1e-9)
    # a slow base bends the beam by its inertia alone: w'' = -(rho A/EI) (L - x)²/2 s²
    lamina = case.lamina[1]
    slow = np.array([2j * np.pi * 1e-3])
    strain = of_channels(assemble(case, needs_dolfinx=False), case, slow)["strain"]
    load = lamina.mass_per_length / lamina.flexural_rigidity * slow**2
    curvature = -load * (lamina.length - 0.3) ** 2 / 2.0
    np.testing.assert_allclose(strain.real, -0.5 * 0.001 * curvature.real, rtol=3e-3)


@pytest.mark.parametrize("order", [1, 2, 3, 6])
def test_filters_and_mountings_are_those_of_the_textbook(order: int) -> None:
    sensor = df.preset("paper").with_overrides({}).sensor
    assert not sensor
    mounted = Case(**(df.preset("paper").model_dump(exclude_unset=True, exclude_none=True) | {
        "sensor": [SENSORS[2] | {"corner": 12.0, "order": order, "resonance": 25.0,
                                 "resonance_damping": 0.1}],
    })).sensor[0]  # fmt: skip
    w = 2.0 * np.pi * FREQUENCY
    _, filtered = signal.freqs(*signal.butter(order, 2.0 * np.pi * 12.0, analog=True), w)
    w0 = 2.0 * np.pi * 25.0
    _, resonant = signal.freqs([w0**2], [1.0, 0.2 * w0, w0**2], w)
    np.testing.assert_allclose(mounting(mounted, 1j * w), filtered * resonant, rtol=1e-10)


def test_a_force_on_short_elements_comes_to_an_end() -> None:
    """Its round-off is above the tolerance: 40 elements leave some 1e-8 where (F1) is solved."""
    force = {
        "excitation.kind": "force", "excitation.lamina": "thin", "excitation.position": 0.685,
        "excitation.amplitude": 1.0, "excitation.frequency": 3.25,
    }  # fmt: skip
    case = df.preset("paper", {"mesh.elements": 40, **force})
    o = assemble(case, needs_dolfinx=False).operators
    s = 2j * np.pi * np.linspace(1.0, 200.0, 400)
    basis, Y = motions(o, s)
    for k in (3, 111, 222, 399):
        Z = (o.stiffness + s[k] * o.damping + s[k] ** 2 * o.mass).toarray()
        direct = np.linalg.solve(Z, -o.base.stiffness)
        u = basis @ Y[:, k]
        assert np.linalg.norm(u - direct) < 1e-6 * np.linalg.norm(direct)
