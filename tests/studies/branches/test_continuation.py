"""Branches of maps in closed form: folds, doublings and Neimark-Sacker points where they are."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from analytic_maps import DelayedLogistic, Henon, Toy

from delam_fem.api import FloatArray
from delam_fem.studies.orbits import continuation
from delam_fem.studies.orbits.continuation import (
    BranchPoint,
    Path,
    doubled_point,
    events_of,
    first_point,
    followed,
    grazings,
    why_lost,
)
from delam_fem.studies.orbits.newton import Ensemble, Perturbations

FINE = Perturbations(copies=8, size=1e-6, kick=1e-4)
ROUGH = Perturbations(copies=48, size=0.01, kick=0.06)
"""Perturbations far above a roughness of 1e-3."""


def branch(map_: Toy, start: FloatArray, path: Path, how: Perturbations) -> list[BranchPoint]:
    ensemble = Ensemble(map_, 1, how)
    points = [first_point(ensemble, start, path)]
    branch_points, ending = followed(
        ensemble, points, path, keep=lambda point, count: None, is_stopped=lambda: False
    )
    assert ending == "range"
    return branch_points


def test_a_branch_passes_its_fold() -> None:
    map_ = Henon()
    path = Path(-0.05, -0.3)
    points = branch(map_, map_.fixed(-0.05), path, FINE)
    assert points[0].state == pytest.approx(map_.fixed(-0.05), rel=1e-8)
    folds = [event for event in events_of(points, path.span) if event.kind == "fold"]
    assert len(folds) == 1
    assert folds[0].parameter == pytest.approx(Henon.fold, abs=1e-3)
    assert folds[0].low <= Henon.fold <= folds[0].high
    # back at the start of the range on the other, unstable side
    assert points[-1].parameter > -0.05
    assert points[0].multipliers.stability == "stable"
    assert points[-1].multipliers.stability == "unstable"


@pytest.mark.slow
@pytest.mark.parametrize(("roughness", "how"), [(0.0, FINE), (1e-3, ROUGH)])
def test_a_doubling_and_its_branch(roughness: float, how: Perturbations) -> None:
    map_ = Henon(roughness)
    path = Path(0.2, 1.0)
    points = branch(map_, map_.fixed(0.2), path, how)
    events = events_of(points, path.span)
    assert [event.kind for event in events] == ["period doubling"]
    (event,) = events
    assert event.parameter == pytest.approx(Henon.doubling, abs=3e-3)
    assert event.low - 2e-3 <= Henon.doubling <= event.high + 2e-3
    twice = Ensemble(map_, 2, how)
    first = doubled_point(twice, points[event.index], event.parameter, path)
    branch_points, _ = followed(
        twice, [first], path, keep=lambda point, count: None, is_stopped=lambda: False
    )
    assert branch_points[-1].parameter > 1.0 and len(branch_points[0].strobes) == 2
    nearest = min(branch_points, key=lambda point: abs(point.parameter - 0.7))
    # the two points of the orbit: a x² - (1 - b) x + (1 - b)²/a - 1 = 0
    a, c = nearest.parameter, 0.7
    exact = np.sort(np.roots([a, -c, c**2 / a - 1.0]).real)
    assert np.sort(nearest.strobes[:, 0]) == pytest.approx(exact, abs=1e-6 + 5.0 * roughness)
    second = [e for e in events_of(branch_points, path.span) if e.kind == "period doubling"]
    assert second[0].parameter == pytest.approx(Henon.second, abs=6e-3)


def test_a_point_leads_on_if_two_steps_follow(monkeypatch: pytest.MonkeyPatch) -> None:
    some: Any = object()
    for steps, leads_on in (([some, some], True), ([some, None], False), ([None], False)):
        monkeypatch.setattr(continuation, "next_point", lambda *_, left=steps: left.pop(0))
        assert continuation._leads_on(some, some, some) == leads_on and not steps


def test_a_neimark_sacker_point() -> None:
    map_ = DelayedLogistic()
    path = Path(1.7, 2.3)
    points = branch(map_, map_.fixed(1.7), path, FINE)
    (event,) = events_of(points, path.span)
    assert event.kind == "Neimark-Sacker"
    assert event.parameter == pytest.approx(DelayedLogistic.torus, abs=2e-3)


def test_a_range_without_an_orbit_is_refused() -> None:
    map_ = Henon()
    ensemble = Ensemble(map_, 1, FINE)
    with pytest.raises((ArithmeticError, np.linalg.LinAlgError)):
        first_point(ensemble, np.array([1.0, 0.3]), Path(-0.5, 0.0))


def test_a_branch_that_is_lost_says_why() -> None:
    """Parameters at which the map has no number end the branch."""

    class Torn(Henon):
        def image(self, x: FloatArray, y: FloatArray, parameter: float) -> FloatArray:
            return super().image(x, y, parameter) * (1.0 if parameter < 0.25 else np.nan)

    ensemble, path = Ensemble(Torn(), 1, FINE), Path(0.2, 0.3)
    points, ending = followed(
        ensemble, [first_point(ensemble, Torn().fixed(0.2), path)], path,
        keep=lambda point, count: None, is_stopped=lambda: False,
    )  # fmt: skip
    assert ending == "lost" and 0.2 < points[-1].parameter < 0.25
    assert "diverge" in why_lost(ensemble, points[-1], path)


@pytest.mark.parametrize(
    ("gaps", "places"),
    [
        ([2.0, 1.0, -1.0, -2.0], [2.5]),
        ([2.0, 0.0, -1.0, 1.0], [1.5, 3.5]),
        ([1.0, np.nan, -1.0, -1.0], []),
        ([0.0, 0.0, -1.0, 0.0], []),
    ],
)
def test_grazings_are_where_tips_begin_or_cease_to_touch(
    gaps: list[float], places: list[float]
) -> None:
    points: Any = [
        SimpleNamespace(gaps=np.array([gap]), parameter=float(i)) for i, gap in enumerate(gaps, 1)
    ]
    events = grazings(points)
    assert [event.parameter for event in events] == places
    assert all(event.high - event.low == 1.0 for event in events)
    assert [event.index for event in events] == [int(place) for place in places]
