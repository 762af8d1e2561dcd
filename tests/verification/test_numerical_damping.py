"""Schemes with numbers of their own, from keys and from Python: the steps that they stand for."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import delam_fem as df
from delam_fem.api import Case, FloatArray

OMEGA, DEFLECTION, N, PERIODS = 2.0 * np.pi * 3.0, 1e-3, 40, 3
STEP = 1.0 / N


def oscillator(**time: Any) -> Case:
    """Return a mass on a spring, 3 Hz, let go from a deflection; 40 steps a second."""
    return Case.model_validate({
        "name": "oscillator", "mesh": {"elements": 1},
        "lamina": [
            {"name": "mass", "mass": 2.0, "stiffness": 2.0 * OMEGA**2, "damping_ratio": 0.0}
        ],
        "initial": [{"displacement": DEFLECTION}],
        "excitation": {"kind": "harmonic", "frequency": 1.0, "amplitude": 1e-15},
        "contact": {"law": "none"},
        "time": {"steps_per_period": N, "periods": PERIODS, **time},
        "output": {"window_periods": PERIODS, "fields_per_period": 0},
    })  # fmt: skip


def by_hand(*, theta: float | None = None, beta: float = 0.0, gamma: float = 0.0) -> FloatArray:
    """Return x after each step of u'' + ω² u = 0, by the definition of the scheme."""
    x, v, h = DEFLECTION, 0.0, STEP
    rows = []
    for _ in range(N * PERIODS):
        if theta is not None:
            implicit = np.array([[1.0, -theta * h], [theta * h * OMEGA**2, 1.0]])
            explicit = np.array([[1.0, (1 - theta) * h], [-(1 - theta) * h * OMEGA**2, 1.0]])
            x, v = np.linalg.solve(implicit, explicit @ [x, v])
        else:
            a = -(OMEGA**2) * x
            ahead = x + h * v + h**2 * (0.5 - beta) * a
            new_a = -(OMEGA**2) * ahead / (1.0 + beta * h**2 * OMEGA**2)
            x, v = ahead + beta * h**2 * new_a, v + h * ((1 - gamma) * a + gamma * new_a)
        rows.append(x)
    return np.array(rows)


SCHEMES: list[dict[str, Any]] = [
    {"scheme": "moreau-jean", "theta": 0.5},
    {"scheme": "moreau-jean", "theta": 0.6},
    {"scheme": "moreau-jean", "theta": 1.0},
    {"scheme": "newmark", "beta": 0.3025, "gamma": 0.6},
    {"scheme": "newmark", "beta": 1.0 / 6.0, "gamma": 0.5},
    {"scheme": "newmark", "beta": 0.35, "gamma": 0.5},
]


@pytest.mark.parametrize("engine", ["petsc", "compiled"])
@pytest.mark.parametrize("time", SCHEMES)
def test_keys_and_python_give_the_steps_of_the_scheme(time: dict[str, Any], engine: Any) -> None:
    numbers = {key: value for key, value in time.items() if key != "scheme"}
    wanted = by_hand(**numbers)
    scheme = df.Scheme(time["scheme"], **numbers)
    results = [df.run(oscillator(**time), engine), df.run(oscillator(), engine, scheme=scheme)]
    for result in results:
        motion = result.history["tip_displacement"][0].values
        np.testing.assert_allclose(motion, wanted, atol=1e-9 * DEFLECTION)
        if np.isinf(scheme.courant):  # others balance energy only for small steps
            assert result.summary["outcome"] == "completed"
        told = [text for text in result.summary["warnings"] if "change the energy by" in text]
        assert bool(told) is scheme.changes_energy
        for text in told:
            assert all(f"time.{key} = {value:g}" in text for key, value in numbers.items())


def test_the_ledger_has_the_energy_that_steps_take() -> None:
    """θ = 0.6 multiplies the energy by (1 + (0.4 ω Δt)²) / (1 + (0.6 ω Δt)²) in each step."""
    history = df.run(oscillator(scheme="moreau-jean", theta=0.6)).history
    z = (OMEGA * STEP) ** 2
    factor = (1.0 + 0.16 * z) / (1.0 + 0.36 * z)
    begun = 0.5 * 2.0 * (OMEGA * DEFLECTION) ** 2
    left = begun * factor ** (N * np.arange(PERIODS + 1))
    np.testing.assert_allclose(history["energy_residual"], np.diff(left), rtol=1e-6)


def test_what_large_beta_keeps_is_another_energy() -> None:
    """With γ = 1/2 the sum of the energy and of (β - 1/4) Δt² a M a / 2 stays constant."""
    beta = 0.35
    history = df.run(oscillator(beta=beta)).history
    deflections = history["tip_displacement"][0].values[N - 1 :: N]
    share = 0.5 * 2.0 * (beta - 0.25) * (STEP * OMEGA**2 * deflections) ** 2
    change = np.diff(history["energy_kinetic"] + history["energy_strain"])
    np.testing.assert_allclose(change, -np.diff(share), atol=1e-12 * share.max())
    np.testing.assert_allclose(history["energy_residual"][1:], change, atol=1e-12 * share.max())


def test_small_beta_has_a_largest_step() -> None:
    """β = 1/6 is stable up to ω Δt = √12."""
    quick = {"scheme": "newmark", "beta": 1.0 / 6.0, "steps_per_period": 5}
    with pytest.raises(df.CaseError, match=f"at most {np.sqrt(12.0) / OMEGA:.4g}"):
        df.run(oscillator(**quick))


def test_numbers_of_other_schemes_are_listed() -> None:
    assert oscillator(scheme="moreau-jean", gamma=0.6, beta=0.3).unread == (
        "time.beta", "time.gamma",
    )  # fmt: skip
    assert oscillator(scheme="newmark", theta=0.6).unread == ("time.theta",)
    with pytest.raises(df.CaseError, match=r"time\.theta"):
        df.preset("default", {"time.theta": 0.4})
    with pytest.raises(df.CaseError, match="newmark"):
        df.run(oscillator(), scheme=df.Scheme("central-difference", beta=0.1))
