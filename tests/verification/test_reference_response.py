"""Response to the base without contact: exact transmissibility, second order in time."""

import numpy as np
import pytest
from scipy.sparse.linalg import spsolve

from delam_fem.api import Case, Operators, assemble, preset
from delam_fem.numerics.beams import transmissibility
from delam_fem.reference.loop import Standing, simulate_reference

FREQUENCY_DOMAIN = 1e-5  # 20 elements: f1 is 5e-8 off, amplified 20-fold at 3.25 Hz; higher modes
TIME_DOMAIN = 1e-4  # N = 2000: (omega dt)^2/12 = 8e-7, amplified near resonance
ORDER, WINDOW = 2.0, 0.1
UNDAMPED = {"lamina.thick.damping_ratio": 0.0, "lamina.thin.damping_ratio": 0.0}
FREE = {"contact.law": "none"}


def steady(ops: Operators, omega: float) -> np.ndarray:
    """Return the complex response of the free dofs per unit motion of the base."""
    base = ops.base
    load = base.stiffness + 1j * omega * base.damping - omega**2 * base.mass
    matrix = ops.stiffness + 1j * omega * ops.damping - omega**2 * ops.mass
    return np.asarray(spsolve(matrix.tocsc(), -load))


def exact(case: Case, omega: float) -> np.ndarray:
    return np.array(
        [
            transmissibility(
                omega,
                length=lamina.length,
                flexural_rigidity=lamina.flexural_rigidity,
                mass_per_length=lamina.mass_per_length,
                rayleigh=case.rayleigh(i),
            )
            for i, lamina in enumerate(case.lamina)
        ]
    )


def steady_start(case: Case, ops: Operators) -> Standing:
    """Return the semi-discrete steady state at t = 0, so that nothing rings."""
    omega = 2.0 * np.pi * case.excitation.frequency
    response = case.excitation.amplitude * steady(ops, omega)
    no_pairs = np.zeros(ops.n_pairs, dtype=bool)
    return Standing(0, response.imag, (1j * omega * response).imag, no_pairs)


@pytest.mark.parametrize("frequency", [1.25, 1.60, 3.25, 3.65])
@pytest.mark.parametrize("rayleigh", ["none", "two-mode", "stiffness", "mass"])
def test_frequency_domain_equals_the_exact_beam(frequency: float, rayleigh: str) -> None:
    overrides = UNDAMPED if rayleigh == "none" else {"damping.rayleigh": rayleigh}
    case = preset("paper", overrides)
    ops, omega = assemble(case, needs_dolfinx=False).operators, 2.0 * np.pi * frequency
    response, expected = ops.probes @ steady(ops, omega), exact(case, omega)
    np.testing.assert_allclose(response, expected, rtol=FREQUENCY_DOMAIN)


@pytest.mark.parametrize("frequency", [1.25, 1.60, 3.65])
def test_undamped_transmissibility_by_time_stepping(frequency: float) -> None:
    case = preset(
        "paper",
        {
            **UNDAMPED,
            **FREE,
            "excitation.frequency": frequency,
            "time.steps_per_period": 2000,
            "mesh.elements": 10,
        },
    )
    model = assemble(case, needs_dolfinx=False)
    start = steady_start(case, model.operators)
    run = simulate_reference(model.operators, case, periods=2, initial=start)
    base = np.sin(2.0 * np.pi * frequency * run.times)
    amplitude = run.displacement @ base / (base @ base) / case.excitation.amplitude
    expected = exact(case, 2.0 * np.pi * frequency).real
    np.testing.assert_allclose(amplitude, expected, rtol=TIME_DOMAIN)


@pytest.mark.parametrize("mass", ["consistent", "lumped"])
def test_order_two_in_time(mass: str) -> None:
    errors = []
    for N in (50, 100, 200):
        case = preset(
            "paper",
            {**FREE, "time.mass": mass, "mesh.elements": 5, "time.steps_per_period": N},
        )
        model = assemble(case, needs_dolfinx=False)
        omega = 2.0 * np.pi * case.excitation.frequency
        start = steady_start(case, model.operators)
        run = simulate_reference(model.operators, case, periods=2, initial=start)
        tips = case.excitation.amplitude * (model.operators.probes @ steady(model.operators, omega))
        expected = (tips[:, None] * np.exp(1j * omega * run.times)).imag
        errors.append(np.abs(run.displacement - expected).max() / np.abs(tips).max())
    rates = np.log2(np.array(errors[:-1]) / errors[1:])
    np.testing.assert_allclose(rates, ORDER, atol=WINDOW)
    assert errors[-1] < 1e-2
