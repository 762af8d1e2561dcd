"""The dolfinx and PETSc path against exact solutions and against the independent reference."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.sparse.linalg import spsolve

from delam_fem.api import Case, State, assemble, node_coordinates, preset, run
from delam_fem.model.beams import forms
from delam_fem.numerics.beams import transmissibility
from delam_fem.reference import matrices
from delam_fem.reference.loop import simulate_reference

UNDAMPED = {
    "lamina.thick.damping_ratio": 0.0,
    "lamina.thin.damping_ratio": 0.0,
    "contact.law": "none",
    "output.fields_per_period": 0,
}
EXACT = 1e-4
"""Relative; the issue of a fine time step, not of 20 elements (1e-7)."""
SAME_MATRICES = 1e-12
"""Relative to the largest entry: quadrature sums against closed forms."""
SAME_TIPS = 1e-8
"""m, over three periods: impacts amplify the round-off in which the two paths differ."""


def steady_start(case: Case) -> State:
    """Return the state at t = 0 of the undamped steady motion: u = 0, v = ω times its shape."""
    o = forms.assemble(case).operators
    omega = 2.0 * np.pi * case.excitation.frequency
    A = case.excitation.amplitude
    load = A * (omega**2 * o.base.mass - o.base.stiffness)
    shape = spsolve((o.stiffness - omega**2 * o.mass).tocsc(), load)
    zero = np.zeros_like(shape)
    return State(np.array([zero, omega * shape, zero]), np.zeros(o.n_pairs, dtype=bool))


@pytest.mark.parametrize("frequency", [1.25, 1.60, 3.65])
def test_undamped_transmissibility_by_time_stepping(frequency: float) -> None:
    settings = {"excitation.frequency": frequency, "time.periods": 3}
    case = preset("paper", {**UNDAMPED, **settings, "time.steps_per_period": 4000})
    history = run(case, initial=steady_start(case)).history
    base = case.excitation.amplitude * np.sin(2.0 * np.pi * frequency * history.time.values)
    for i, lamina in enumerate(case.lamina):
        tip = history.tip_displacement.values[i]
        exact = float(
            transmissibility(
                2.0 * np.pi * frequency,
                length=lamina.length,
                flexural_rigidity=lamina.flexural_rigidity,
                mass_per_length=lamina.mass_per_length,
            ).real
        )
        amplitude = float(tip @ base) / float(base @ base)
        assert amplitude == pytest.approx(exact, rel=EXACT)
        assert np.abs(tip - exact * base).max() < 2.0 * EXACT * np.abs(exact * base).max()


@pytest.mark.parametrize("scheme", ["newmark", "central-difference"])
def test_order_two_in_the_time_step_without_contact(scheme: str) -> None:
    settings = {"mesh.elements": 3, "contact.law": "none", "time.periods": 1}
    settings |= {"time.scheme": scheme, "output.fields_per_period": 1}
    if scheme == "central-difference":
        settings["time.mass"] = "lumped"
    steps = np.array([4000, 8000, 16000, 128000])
    ends = []
    for n in steps:
        history = run(preset("paper", {**settings, "time.steps_per_period": int(n)})).history
        ends.append(history.displacement.values[:, -1].ravel())
    errors = [float(np.linalg.norm(end - ends[-1])) for end in ends[:-1]]
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert orders == pytest.approx(2.0, abs=0.1)
    assert errors[-1] < 1e-3 * float(np.linalg.norm(ends[-1]))


@pytest.mark.parametrize("mass", ["consistent", "lumped"])
def test_matrices_are_those_in_closed_form(mass: str) -> None:
    case = preset("paper", {"time.mass": mass})
    operators, expected = (
        forms.assemble(case).operators,
        assemble(case, needs_dolfinx=False).operators,
    )
    for name in ("mass", "damping", "stiffness", "gap_matrix"):
        a, b = getattr(operators, name), getattr(expected, name)
        assert abs(a - b).max() <= SAME_MATRICES * abs(b).max(), name
    for name in ("mass", "damping", "stiffness"):
        a, b = getattr(operators.base, name), getattr(expected.base, name)
        assert np.abs(a - b).max() <= SAME_MATRICES * max(np.abs(b).max(), 1e-300), name
    assert operators.base.corner == pytest.approx(expected.base.corner, rel=SAME_MATRICES)
    assert operators.lumped_mass == pytest.approx(expected.lumped_mass, rel=SAME_MATRICES)
    assert abs(operators.probes - expected.probes).max() == 0.0
    assert operators.gap0 == pytest.approx(expected.gap0, rel=SAME_MATRICES)


@pytest.mark.parametrize("law", ["newton-penalty", "newton"])
@pytest.mark.parametrize("impulse", ["lumped", "consistent"])
def test_tips_follow_the_reference(law: str, impulse: str) -> None:
    settings = {"contact.impulse": impulse, "contact.law": law, "time.periods": 3}
    case = preset("paper", {**settings, "output.fields_per_period": 0})
    history = run(case).history
    nodes = node_coordinates(case)
    expected = simulate_reference(matrices.assemble(case, nodes), case, periods=3)
    tips = history.tip_displacement.values
    difference = np.abs(tips - expected.displacement[:, -tips.shape[1] :]).max()
    assert history.sizes["event"] == len(expected.events) > 20
    assert difference < SAME_TIPS
