"""The interval of an event contains the errors by the size of kicks and by interpolation."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from toys import Cubic, DelayedLogistic, Toy

from delam_fem.numerics.types import FloatArray
from delam_fem.studies.branches.continuation import (
    Event,
    Path,
    crossings,
    events_of,
    first_point,
    followed,
    turns,
)
from delam_fem.studies.orbits.newton import Ensemble, Perturbations

KICK = 0.1


def event(map_: Toy, start: FloatArray, path: Path, kick: float) -> Event:
    """Return the only event of a branch."""
    ensemble = Ensemble(map_, 1, Perturbations(copies=8, size=1e-6, kick=kick))
    points, _ = followed(
        ensemble, [first_point(ensemble, start, path)], path,
        keep=lambda point, count: None, is_stopped=lambda: False,
    )  # fmt: skip
    (found,) = events_of(points, path.span)
    return found


def test_the_error_by_kicks_is_in_the_interval() -> None:
    """A two-sided kick of 0.1 sees the doubling 0.01 too late."""
    found = event(Cubic(), np.array([1.0, 0.0]), Path(0.8, 1.2), KICK)
    assert found.parameter == pytest.approx(Cubic.doubling, abs=KICK**2)
    assert found.low <= Cubic.doubling <= found.high
    assert found.high - found.low < 4.0 * KICK**2


def test_the_curvature_is_in_the_interval() -> None:
    map_ = DelayedLogistic()
    found = event(map_, map_.fixed(1.7), Path(1.7, 2.3), 0.01)
    assert found.low - 2e-4 <= DelayedLogistic.torus <= found.high
    assert found.high - found.low < 0.02


def along(values: list[float], spread: float = 1e-3) -> list[Any]:
    """Return points at λ = 0, 1, … at which the test function has given values ± spread."""
    samples = np.linspace(-spread, spread, 41)
    return [
        SimpleNamespace(
            parameter=float(k), parameter_error=0.0, x=lambda span, k=k: np.array([k / span]),
            multipliers=SimpleNamespace(doubling=np.r_[value, value + samples]),
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
    (found,) = crossings("period doubling", tests, points, 1.0)
    assert found.low <= 2.0 < found.parameter < 4.0 <= found.high
