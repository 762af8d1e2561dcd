"""The interval of an event contains the errors by the size of kicks and by interpolation."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from analytic_maps import Cubic, DelayedLogistic, Henon, Toy

from delam_fem.api import FloatArray
from delam_fem.studies.orbits.continuation import (
    LASTS,
    BranchEvent,
    Path,
    crossings,
    events_of,
    first_point,
    followed,
    turns,
)
from delam_fem.studies.orbits.newton import Ensemble, Perturbations

KICK = 0.1


def event(map_: Toy, start: FloatArray, path: Path, kick: float) -> BranchEvent:
    """Return the only event of a branch."""
    ensemble = Ensemble(map_, 1, Perturbations(copies=8, size=1e-6, kick=kick))
    points, _ = followed(
        ensemble, [first_point(ensemble, start, path)], path,
        keep=lambda point, count: None, is_stopped=lambda: False,
    )  # fmt: skip
    (crossing,) = events_of(points, path.span)
    return crossing


def test_the_error_by_kicks_is_in_the_interval() -> None:
    """A two-sided kick of 0.1 sees the doubling 0.01 too late."""
    crossing = event(Cubic(), np.array([1.0, 0.0]), Path(0.8, 1.2), KICK)
    assert crossing.parameter == pytest.approx(Cubic.doubling, abs=KICK**2)
    assert crossing.low <= Cubic.doubling <= crossing.high
    assert crossing.high - crossing.low < 4.0 * KICK**2


def test_the_curvature_is_in_the_interval() -> None:
    map_ = DelayedLogistic()
    crossing = event(map_, map_.fixed(1.7), Path(1.7, 2.3), 0.01)
    assert crossing.low - 2e-4 <= DelayedLogistic.torus <= crossing.high
    assert crossing.high - crossing.low < 0.02


def along(values: list[float], spread: float = 1e-3, alternate: tuple[int, ...] = ()) -> list[Any]:
    """Return points at λ = 0, 1, … at which the test function has given values ± spread.

    Args:
        values: of the function.
        spread: half the width of its samples.
        alternate: numbers of points beside which motions alternate for good.
    """
    samples = np.linspace(-spread, spread, 41)
    return [
        SimpleNamespace(
            parameter=float(k), parameter_error=0.0, x=lambda span, k=k: np.array([k / span]),
            multipliers=SimpleNamespace(doubling=np.r_[value, value + samples]),
            alternation=0.9 if k in alternate else 0.6,
        )
        for k, value in enumerate(values)
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("values", "pairs"),
    [
        ([0.9, 0.2, 0.2, 0.9], [(1.0, 2.0)]),  # the lines meet at -0.15
        ([0.9, 0.7, 0.7, 0.9], []),  # they meet at 0.6
        ([0.9, 0.3, -0.3, -0.9], []),  # a doubling that is found
        ([-0.9, -0.2, -0.2, -0.9], [(1.0, 2.0)]),  # a stable stretch between two doublings
    ],
)
def test_a_bubble_between_two_points_is_told(
    values: list[float], pairs: list[tuple[float, float]]
) -> None:
    assert turns(along(values), 1.0) == pairs


def test_the_interval_contains_all_points_whose_side_is_open() -> None:
    """The line through all points alone would place the doubling to a tenth."""
    points = along([0.5, 0.4, 0.02, 0.01, -0.02, -0.4, -0.5], spread=0.1)
    tests = np.array([point.multipliers.doubling for point in points])
    (crossing,) = crossings("period doubling", tests, points, 1.0)
    assert crossing.low <= 2.0 < crossing.parameter < 4.0 <= crossing.high


@pytest.mark.parametrize(
    ("alternate", "ends"),
    [
        ((), (2.9, 4.1)),
        ((2, 3), (1.0, 4.1)),  # the kicks of two points see a function > 0 behind the doubling
        ((0, 1, 2, 3), (0.0, 4.1)),
        ((1,), (2.9, 4.1)),  # not beside it
    ],
)
@pytest.mark.parametrize("way", [1, -1])
def test_the_interval_reaches_to_where_no_motion_alternates(
    alternate: tuple[int, ...], ends: tuple[float, float], way: int
) -> None:
    """In either direction of the branch, and for period doublings alone."""
    points = along([0.5, 0.4, 0.3, 0.2, -0.2, -0.3, -0.4], alternate=alternate)[::way]
    tests = np.array([point.multipliers.doubling for point in points])
    (crossing,) = crossings("period doubling", tests, points, 1.0)
    low, high = ends
    assert low <= crossing.low < 3.5 < crossing.high <= high
    assert 3 not in alternate or crossing.low == low
    (torus,) = crossings("Neimark-Sacker", tests, points, 1.0)
    assert torus.high - torus.low < 1.0


@pytest.mark.parametrize(
    ("offset", "low", "high"),
    [
        (-0.02, 0.01, 0.5),  # jumps change the phase
        (0.005, LASTS, 1.0),  # a motion of period 2 keeps it
        (0.01, 0.0, 0.0),  # the multiplier is known: it is not asked
    ],
)
def test_jumps_do_not_make_a_motion_alternate_for_good(
    offset: float, low: float, high: float
) -> None:
    map_, a = Henon(1e-3), Henon.doubling + offset
    point = first_point(Ensemble(map_, 1, Perturbations()), map_.fixed(a), Path(a, a + 1.0))
    assert point.doubled > 0.0
    assert low <= point.alternation <= high
