"""Find folds, period doublings, Neimark-Sacker points and grazing on a branch, with intervals.

A multiplier crosses the unit circle between two points at which its side is certain (its 95 %
interval lies on that side). A line is fitted through these and the points between, for each
bootstrap sample, and where the lines cross gives λ with its interval. The interval contains all
points between, and where parabolas through a further point cross, because the test function is
curved. A fold is where λ turns.
Grazing, where the tips begin to touch, is an event of its own: the map has no derivative there, and
nothing is interpolated across it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np

from delam_fem.numerics.arrays import FloatArray
from delam_fem.studies.branches.continuation import Point
from delam_fem.studies.orbits.multipliers import interval

Kind = Literal["period doubling", "Neimark-Sacker", "fold", "grazing"]

SAME_PAIR = 0.4
"""Difference of the arguments of complex multipliers at two points that belong together [rad]."""
TURNED = 3.0
"""Standard errors of λ by which it must turn back to make a fold."""
LEAST_TURN = 0.003
"""The same, in ranges of λ."""
BESIDE = 2
"""Points on either side of a fold through which a parabola is fitted."""
TWO_SIDES = 2.0
"""Standard errors in half a 95 % interval."""
_REAL = 1e-9


@dataclass(frozen=True)
class Event:
    """Something that happens on a branch.

    Attributes:
        kind: what happens.
        parameter: λ.
        low, high: 95 % interval of λ; of grazing, the points between which it happens.
        index: number of the point after it.
    """

    kind: Kind
    parameter: float
    low: float
    high: float
    index: int


def events_of(points: Sequence[Point], span: float) -> list[Event]:
    """Return what happens on a branch, in the order of its points.

    Args:
        points: the branch.
        span: unit of λ.
    """
    if len(points) < 3:
        return []
    found = [m.multipliers for m in points]
    doubling = np.array([m.doubling for m in found])
    torus = np.array([m.torus for m in found])
    angles = np.array([m.angle for m in found])
    events = [
        *crossings("period doubling", doubling, points, span),
        *[
            event
            for event in crossings("Neimark-Sacker", torus, points, span)
            if abs(angles[event.index] - angles[event.index - 1]) < SAME_PAIR
        ],
        *folds(points, span),
        *grazings(points),
    ]
    return sorted(events, key=lambda event: event.index)


def crossings(kind: Kind, tests: FloatArray, points: Sequence[Point], span: float) -> list[Event]:
    """Return where a test function passes 0.

    Args:
        kind: what that means.
        tests: the function at each point: its value and samples, shape (n_points, 1 + n_samples);
            NaN: it has none.
        points: the branch.
        span: unit of λ.
    """
    side = np.array([_side(row) for row in tests])
    certain = np.flatnonzero(side)
    place = lengths(points, span)
    parameters = np.array([point.parameter for point in points])
    found = []
    for a, b in zip(certain[:-1].tolist(), certain[1:].tolist(), strict=True):
        rows = tests[a : b + 1]
        if side[a] == side[b] or np.isnan(rows).mean() > 0.5:
            continue
        places = np.array([_root(place[a : b + 1], column) for column in rows.T])
        after = min(max(int(np.searchsorted(place, np.nanmedian(places))), 1), b)
        beside = range(max(after - 2, 0), min(after, len(points) - 2))
        middle = float(place[after - 1 : after + 1].mean())
        curved = np.array([_root(place[i : i + 3], tests[i : i + 3, 0], 2, middle) for i in beside])
        at, crossed = (
            np.interp(np.clip(found_at, place[a], place[b]), place, parameters)
            for found_at in (places[np.isfinite(places)], curved[np.isfinite(curved)])
        )
        error = TWO_SIDES * max(points[a].parameter_error, points[b].parameter_error)
        ends = [*interval(at), *crossed, *parameters[a + 1 : b]]  # points between: open sides
        low, high = float(min(ends)), float(max(ends))
        found.append(Event(kind, float(at[0]), low - error, high + error, after))
    return found


def turns(points: Sequence[Point], span: float) -> list[tuple[float, float]]:
    """Return pairs of neighbouring λ between which two doublings may lie that no point shows.

    The test function has one sign at both, and the lines through two points on either side cross
    beyond 0 between them.
    """
    values = np.array([point.multipliers.doubling[0] for point in points])
    place = lengths(points, span)
    found = []
    for i in range(1, len(points) - 2):
        left, right = (np.polyfit(place[k : k + 2], values[k : k + 2], 1) for k in (i - 1, i + 1))
        at = (right[1] - left[1]) / (left[0] - right[0]) if left[0] != right[0] else np.nan
        is_beyond = place[i] < at < place[i + 1] and np.polyval(left, at) * values[i] < 0.0
        is_same = bool((values[i - 1 : i + 3] * values[i] > 0.0).all())
        if is_same and is_beyond:
            found.append((points[i].parameter, points[i + 1].parameter))
    return found


def _side(samples: FloatArray) -> int:
    """Return 1 or -1 if samples lie on that side of 0 with certainty, 0 otherwise."""
    if np.isnan(samples).mean() > 0.05:
        return 0
    low, high = interval(samples[np.isfinite(samples)])
    return 1 if low > 0.0 else -1 if high < 0.0 else 0


def _root(place: FloatArray, values: FloatArray, degree: int = 1, middle: float = 0.0) -> float:
    """Return where a polynomial through values is 0, nearest to a place; NaN: nowhere."""
    known = np.isfinite(values)
    if known.sum() <= degree:
        return float("nan")
    roots = np.roots(np.polyfit(place[known] - middle, values[known], degree))
    real = roots[np.abs(roots.imag) < _REAL].real
    return middle + float(real[np.argmin(np.abs(real))]) if real.size else float("nan")


def lengths(points: Sequence[Point], span: float) -> FloatArray:
    """Return the length of a branch up to each point, shape (n_points,)."""
    steps = [
        float(np.linalg.norm(right.x(span) - left.x(span))) for left, right in _neighbours(points)
    ]
    return np.concatenate([[0.0], np.cumsum(steps)])


def _neighbours(points: Sequence[Point]) -> list[tuple[Point, Point]]:
    return list(pairwise(points))


def folds(points: Sequence[Point], span: float) -> list[Event]:
    """Return where λ turns back by more than its errors."""
    parameters = np.array([point.parameter for point in points])
    place, found = lengths(points, span), []
    extreme, way = 0, 0.0
    for i in range(1, len(points)):
        moved = parameters[i] - parameters[extreme]
        error = max(points[i].parameter_error, points[extreme].parameter_error)
        least = max(TURNED * error, LEAST_TURN * span)
        if way == 0.0:
            if abs(moved) > least:
                extreme, way = i, float(np.sign(moved))
        elif way * moved >= 0.0:
            extreme = i
        elif abs(moved) > least:
            found.append(_fold(points, place, extreme))
            extreme, way = i, -way
    return found


def _fold(points: Sequence[Point], place: FloatArray, extreme: int) -> Event:
    """Return the fold at an extreme point, from a parabola through its neighbours."""
    near = slice(max(extreme - BESIDE, 0), extreme + BESIDE + 1)
    s = place[near] - place[extreme]
    values = np.array([point.parameter for point in points[near]])
    a, b, c = np.polyfit(s, values, 2)
    fitted = float(c - b * b / (4.0 * a)) if abs(b) < 2.0 * abs(a) * np.ptp(s) else float(c)
    scatter = float(np.sqrt(np.mean((np.polyval([a, b, c], s) - values) ** 2)))
    error = TWO_SIDES * max(scatter, points[extreme].parameter_error)
    value = points[extreme].parameter
    return Event(
        "fold", fitted, min(fitted - error, value), max(fitted + error, value), extreme + 1
    )


def grazings(points: Sequence[Point]) -> list[Event]:
    """Return where the tips begin or cease to touch in one of the periods."""
    found = []
    for period in range(points[0].gaps.size):
        for i, (left, right) in enumerate(_neighbours(points)):
            before, after = left.gaps[period], right.gaps[period]
            if np.isfinite([before, after]).all() and (before > 0.0) != (after > 0.0):
                low, high = sorted((left.parameter, right.parameter))
                middle = 0.5 * (low + high)
                found.append(Event("grazing", middle, low, high, i + 1))
    return found
