"""Widen the intervals of events by what bootstrap samples do not contain.

Samples say how well multipliers for one size of kicks are known. Two other errors move the place
where a multiplier crosses the unit circle: the size of the kicks, since a derivative by finite
differences depends on it, and the line between points, since the test function is curved. The first
is measured with kicks half as large at the points on either side, the second with the parabolas
through a further point. An interval contains what both give.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from delam_fem.numerics.arrays import FloatArray
from delam_fem.studies.branches.events import Event, lengths
from delam_fem.studies.branches.point import Point
from delam_fem.studies.orbits.ensemble import Ensemble
from delam_fem.studies.orbits.multipliers import Multipliers, multipliers
from delam_fem.studies.orbits.search import HALVED

REMAINING = 4.0 / 3.0
"""Error by kicks relative to the change when they are halved: it falls with their square."""


def widened(
    ensemble: Ensemble, events: Sequence[Event], points: Sequence[Point], span: float
) -> list[Event]:
    """Return events with the errors by the size of kicks and by interpolation in the intervals.

    Args:
        ensemble: the mean map of the branch.
        events: what happens on it; only crossings of the unit circle change.
        points: the branch.
        span: unit of λ.
    """
    return [_widened(ensemble, event, points, span) for event in events]


def _widened(ensemble: Ensemble, event: Event, points: Sequence[Point], span: float) -> Event:
    """Return an event with a wider interval."""
    if event.kind not in ("period doubling", "Neimark-Sacker"):
        return event
    first = max(event.index - 2, 0)
    near = points[first : event.index + 2]
    place = lengths(near, span)
    left = event.index - 1 - first
    both = slice(left, left + 2)
    tests = np.array([_test(event, point.multipliers) for point in near])
    halved = [_test(event, _halved(ensemble, point)) for point in near[both]]
    at = _root(place[both], tests[both], place[both])
    moved = REMAINING * (_root(place[both], np.array(halved), place[both]) - at)
    curved = [_root(place[i : i + 3], tests[i : i + 3], place[both]) for i in range(len(near) - 2)]
    parameters = np.array([point.parameter for point in near])
    ends = np.array([at, at - moved, at + moved, *curved])
    shift = np.interp(ends[np.isfinite(ends)], place, parameters) - np.interp(at, place, parameters)
    if not shift.size:
        return event
    return replace(event, low=event.low + min(shift.min(), 0.0), high=event.high + shift.max())


def _halved(ensemble: Ensemble, point: Point) -> Multipliers:
    """Return the multipliers at a point by kicks half as large."""
    kick = HALVED * ensemble.perturbations.kick
    return multipliers(ensemble.derivatives(point.state, point.parameter, point.scale, kick))


def _test(event: Event, found: Multipliers) -> float:
    """Return the function that is 0 at an event."""
    return float((found.doubling if event.kind == "period doubling" else found.torus)[0])


def _root(place: FloatArray, values: FloatArray, between: FloatArray) -> float:
    """Return where the polynomial through values is 0, nearest to two places; NaN: nowhere."""
    if not np.isfinite(values).all():
        return float("nan")
    middle = float(between.mean())
    roots = np.roots(np.polyfit(place - middle, values, len(place) - 1))
    real = roots[np.abs(roots.imag) < 1e-9].real
    return middle + float(real[np.argmin(np.abs(real))]) if real.size else float("nan")
