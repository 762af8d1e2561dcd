"""A bar that is cut in two and pressed together, beside what passes the cut exactly."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from loads.pressed_bar import C, F, Z, cut_bar, harmonics_of, passing, reopening
from scipy.integrate import solve_ivp

import delam_fem as df
from delam_fem.api import EngineName

RATIOS = (0.8, 0.5, 0.2)
"""P/a: the cut is open for a small, a middle and a large part of the period."""
ORDER = (1.6, 2.6)
"""Window around order 2 of linear elements; the cut closes within a step and an element, which
scatters the error."""


@pytest.mark.parametrize("pressure", RATIOS)
def test_the_cut_opens_and_closes_as_a_stepped_gap_does(pressure: float) -> None:
    """R1 by another way: integrate g' until g = 0, then a sum in place of a quadrature."""
    opens, closes = reopening(pressure)

    def rate(angle: float, _: Any) -> list[float]:
        return [-2.0 * (pressure + np.sin(angle))]

    def is_zero(angle: float, gap: Any) -> float:
        return float(gap[0]) if angle > opens + 0.1 else 1.0

    is_zero.terminal = True  # type: ignore[attr-defined]
    solution = solve_ivp(rate, (opens, opens + 7.0), [0.0], events=is_zero, max_step=1e-3)
    assert solution.t[-1] == pytest.approx(closes, abs=2e-6)
    angle = opens + 2.0 * np.pi * (np.arange(200_000) + 0.5) / 200_000
    force = np.where(angle < closes, -pressure, np.sin(angle))
    sums = np.abs(np.exp(-1j * np.outer(np.arange(1, 5), angle)) @ force) / 100_000
    assert passing(pressure) == pytest.approx(sums, abs=2e-5)


@pytest.mark.slow
@pytest.mark.parametrize("pressure", RATIOS)
def test_harmonics_behind_the_cut(pressure: float) -> None:
    """With 20 elements in a wavelength of the second harmonic."""
    exact = passing(pressure)
    case = cut_bar(pressure, 20, steps=1600, waves=0.5)
    measured = harmonics_of(case)
    assert measured[:2] == pytest.approx(exact[:2], rel=0.01)
    assert measured[2:] == pytest.approx(exact[2:], rel=0.02)


@pytest.mark.slow
@pytest.mark.parametrize("pressure", [0.5, 0.2])
def test_their_order(pressure: float) -> None:
    exact = passing(pressure, 3)
    counts = np.array([10, 20, 40])
    errors = [
        np.linalg.norm(
            harmonics_of(cut_bar(pressure, int(n), steps=6400, waves=0.5), count=3) / exact - 1.0
        )
        for n in counts
    ]
    order = -np.polyfit(np.log(counts), np.log(errors), 1)[0]
    assert ORDER[0] < order < ORDER[1]
    assert errors[-1] < 3e-3


@pytest.mark.slow
def test_a_wave_below_the_pressure_passes_unchanged() -> None:
    case = cut_bar(1.02, 20, time={
        "scheme": "moreau-jean", "steps_per_period": 400, "periods": 100
    })  # fmt: skip
    measured = harmonics_of(case)
    assert measured[0] == pytest.approx(1.0, abs=1e-4)
    assert 20.0 * np.log10(measured[1:].max()) < -120.0


@pytest.mark.parametrize(
    "keys",
    [
        {},
        {"time.scheme": "newmark", "contact.law": "newton-penalty",
         "contact.penalty_stiffness": 1e10},
    ],
    ids=["newton", "newton-penalty"],
)  # fmt: skip
def test_engines_pass_waves_alike(keys: dict[str, Any]) -> None:
    case = cut_bar(0.5, 5, steps=200, waves=0.5).with_overrides({"time.periods": 4} | keys)
    petsc, compiled = (df.run(case, engine) for engine in ("petsc", "compiled"))
    for name in ("tip_displacement", "tip_velocity"):
        first, second = petsc.history[name].values, compiled.history[name].values
        assert np.abs(first - second).max() < 1e-9 * np.abs(first).max(), name
    assert abs(petsc.summary["energy_residual"]) < 1e-9
    assert petsc.summary["rest"]["contact_force"] == pytest.approx({"left-right": 50.0}, rel=1e-9)


@pytest.mark.parametrize("engine", ["petsc", "compiled"])
def test_ends_with_dampers_absorb_waves(engine: EngineName) -> None:
    """The force 2 a at the end makes a wave a, and the contact force is P + a sin ω(t - L/c)."""
    case = cut_bar(1.5, 20, steps=800, sensor=[
        {"name": "cut", "quantity": "contact force", "between": ["left", "right"]}
    ])  # fmt: skip
    history = df.run(case, engine).history
    force = history.sensor_cut.values
    t = history.time.values - 0.5 / 800.0 / F  # means of steps
    assert force == pytest.approx(150.0 + 100.0 * np.sin(2.0 * np.pi * F * t), abs=1.0)
    assert Z == pytest.approx(2700.0 * C * 1e-4)
