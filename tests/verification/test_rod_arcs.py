"""A rod on an elastic stop beside its exact motions, and their folds beside harmonic balance."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from rod_arcs import UNIT, Orbit, Rod, folds

import delam_fem as df
from delam_fem.api import Case

ROD = Path(__file__).parents[2] / "docs" / "examples" / "others" / "rod.toml"


def rod(ratio: float, omega: float, periods: int = 300) -> Case:
    """Return the rod at ω [rad/s] on a stop of k = ratio E A / L."""
    keys = {"stop.1.stiffness": ratio * 2.52e9, "excitation.frequency": omega / (2.0 * np.pi),
            "time.periods": periods}  # fmt: skip
    return df.load_case(ROD).with_overrides(keys)


def settled(case: Case) -> tuple[Rod, Orbit, float]:
    """Return the exact rod, its orbit near the settled motion of a run, and |u| of the run."""
    result, exact = df.run(case, engine="compiled"), Rod(case)
    gap = case.stop[0].gap
    (u, v), omega = result.state.motion[:2], 2.0 * np.pi * case.excitation.frequency
    orbit = exact.orbit(np.append(u / gap, v / gap / UNIT), omega / UNIT)
    assert orbit is not None
    tip = np.abs(result.history["tip_displacement"].to_numpy()).max()
    return exact, orbit, float(tip)


@pytest.mark.parametrize(("ratio", "omega"), [(0.4, 63500.0), (4.0, 63500.0)])
def test_a_run_settles_to_the_exact_motion(ratio: float, omega: float) -> None:
    _, orbit, tip = settled(rod(ratio, omega))
    assert orbit.growth < 1.0
    assert tip == pytest.approx(2e-4 * orbit.largest, rel=1e-3)


@pytest.mark.slow
def test_on_a_stiff_stop_the_motion_loses_its_stability_and_wins_it_back() -> None:
    """The frequencies between which `orbit follow` loses it: Neimark-Sacker points."""
    exact, orbit, _ = settled(rod(4.0, 64300.0))
    branch = exact.branch(orbit, 65900.0 / UNIT, 0.1)
    unstable = [orbit.omega * UNIT for orbit in branch if orbit.growth > 1.0]
    assert min(unstable) == pytest.approx(64400.0, abs=60.0)
    assert max(unstable) == pytest.approx(65620.0, abs=80.0)
    assert branch[-1].growth < 1.0


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("ratio", "expected", "peak"),
    [(0.4, (64892.9, 63848.3), 0.51639), (4.0, (69450.2, 63876.8), 0.42288)],
)
def test_folds_are_those_of_harmonic_balance(
    ratio: float, expected: tuple[float, float], peak: float
) -> None:
    exact, orbit, _ = settled(rod(ratio, 63500.0))
    branch = exact.branch(orbit, 70000.0 / UNIT if ratio > 1.0 else 65000.0 / UNIT)
    assert folds(branch) == pytest.approx(list(expected), rel=5e-4)
    assert 0.2 * max(orbit.largest for orbit in branch) == pytest.approx(peak, rel=1.5e-3)
