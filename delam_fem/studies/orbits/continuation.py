"""Follow a branch of orbits past its folds, and find the events on it.

The branch is followed by pseudo-arclength in the slow coordinates and λ. A step predicts along the
tangent and corrects in the plane across it (N2 of newton.py). It is accepted if the residual is
zero within its confidence and the correction is small beside the step. A point depends only on the
points before it, so a branch that is broken off goes on the same.

Events are folds, period doublings, Neimark-Sacker points and grazing, each with an interval. A
multiplier crosses the unit circle between two points at which its side is certain (its 95 %
interval lies on that side). A line is fitted through these and the points between, for each
bootstrap sample; the zeros of the lines give λ with its interval. The interval also contains all
points between, and the zeros of parabolas through a further point, because the test function is
curved. A point beside which a motion alternates for good lies behind a doubling, although kicks,
which the steps hold, may say that it does not: the interval then begins at the last point beside
which no motion does. A fold is where λ turns. Grazing, where the pair begins to touch, is an event
of its own: the map has no derivative there, and nothing is interpolated across it.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Literal

import numpy as np

from delam_fem.api import FloatArray
from delam_fem.studies.orbits.newton import Border, Ensemble, Guess, Solved, by_parameter, solved
from delam_fem.studies.orbits.search import (
    Multipliers,
    Stability,
    alternating,
    interval,
    multipliers,
    run_on,
    with_harmless_kicks,
)

Kind = Literal["period doubling", "Neimark-Sacker", "fold", "grazing"]

SAME_PAIR = 0.4
"""Difference of the arguments of complex multipliers at two points that belong together [rad]."""
TURNED = 3.0
"""Standard errors by which λ must turn back to make a fold."""
LEAST_TURN = 0.003
"""Share of the range of λ by which λ must turn back to make a fold."""
LASTS = 0.8
"""Share of a motion that alternates from which on it does so for good. Jumps before a doubling make
motions alternate whose phase is lost in time: of over a hundred such points of Hénon's maps all but
one have at most 0.56; at points of strips behind a doubling it is 0.91 to 0.99."""
BESIDE = 2
"""Points on either side of a fold through which a parabola is fitted."""
TWO_SIDES = 2.0
"""Standard errors in half a 95 % interval."""
_REAL = 1e-9


@dataclass(frozen=True)
class BranchEvent:
    """An event on a branch.

    Attributes:
        kind: what happens.
        parameter: λ.
        low, high: 95 % interval of λ; of grazing, the points between which it happens.
        index: number of the first point behind the event.
    """

    kind: Kind
    parameter: float
    low: float
    high: float
    index: int


def events_of(points: Sequence[BranchPoint], span: float) -> list[BranchEvent]:
    """Return the events on a branch, in the order of its points.

    Args:
        points: the branch.
        span: unit of λ.
    """
    if len(points) < 3:
        return []
    all_multipliers = [m.multipliers for m in points]
    angles = np.array([m.angle for m in all_multipliers])
    events = [
        *crossings(
            "period doubling", np.array([m.doubling for m in all_multipliers]), points, span
        ),
        *[
            event
            for event in crossings(
                "Neimark-Sacker", np.array([m.torus for m in all_multipliers]), points, span
            )
            if abs(angles[event.index] - angles[event.index - 1]) < SAME_PAIR
        ],
        *folds(points, span),
        *grazings(points),
    ]
    return sorted(events, key=lambda event: event.index)


def crossings(
    kind: Kind, tests: FloatArray, points: Sequence[BranchPoint], span: float
) -> list[BranchEvent]:
    """Return the events at which a test function passes 0.

    Args:
        kind: kind of these events.
        tests: value and samples of the function at each point, shape (n_points, 1 + n_samples); NaN
            where it has none.
        points: the branch.
        span: unit of λ.
    """
    side = np.array([_side(row) for row in tests])
    certain = np.flatnonzero(side)
    is_behind = np.array([kind == "period doubling" and p.alternation > LASTS for p in points])
    sure = np.flatnonzero((side < 0) | (side > 0) & ~is_behind)
    place = lengths(points, span)
    parameters = np.array([point.parameter for point in points])
    events = []
    for a, b in zip(certain[:-1].tolist(), certain[1:].tolist(), strict=True):
        rows = tests[a : b + 1]
        if side[a] == side[b] or np.isnan(rows).mean() > 0.5:
            continue
        # zeros of the lines, by length along the branch: of the value, then of each sample
        places = np.array([_root(place[a : b + 1], column) for column in rows.T])
        after = min(max(int(np.searchsorted(place, np.nanmedian(places))), 1), b)
        # parabolas through the two points about the zero and one more on either side
        beside = range(max(after - 2, 0), min(after, len(points) - 2))
        middle = float(place[after - 1 : after + 1].mean())
        curved = np.array([_root(place[i : i + 3], tests[i : i + 3, 0], 2, middle) for i in beside])
        at, crossed = (
            np.interp(np.clip(found_at, place[a], place[b]), place, parameters)
            for found_at in (places[np.isfinite(places)], curved[np.isfinite(curved)])
        )
        error = TWO_SIDES * max(points[a].parameter_error, points[b].parameter_error)
        # half of the samples is from kicks of all sizes, half from small ones (`multipliers`)
        every, small = (float(np.median(part)) for part in np.array_split(at[1:], 2))
        beyond = 2.0 * small - every  # still smaller kicks may change λ as much again
        # points between have no side; next to them motions may alternate, up to a sure point
        first = sure[sure <= a].max(initial=0)
        last = sure[sure >= b].min(initial=len(points) - 1)
        open_ = [*parameters[first:a], *parameters[a + 1 : b], *parameters[b + 1 : last + 1]]
        ends = [*interval(at), *crossed, beyond, *open_]
        low = float(min(ends))
        high = float(max(ends))
        events.append(BranchEvent(kind, float(at[0]), low - error, high + error, after))
    return events


def turns(points: Sequence[BranchPoint], span: float) -> list[tuple[float, float]]:
    """Return pairs of neighbouring λ between which two doublings may lie that no point shows.

    The test function has one sign at both, and the lines through two points on either side cross
    beyond 0 between them.
    """
    values = np.array([point.multipliers.doubling[0] for point in points])
    place = lengths(points, span)
    intervals = []
    for i in range(1, len(points) - 2):
        left, right = (np.polyfit(place[k : k + 2], values[k : k + 2], 1) for k in (i - 1, i + 1))
        at = (right[1] - left[1]) / (left[0] - right[0]) if left[0] != right[0] else np.nan
        is_beyond = place[i] < at < place[i + 1] and np.polyval(left, at) * values[i] < 0.0
        is_same = bool((values[i - 1 : i + 3] * values[i] > 0.0).all())
        if is_same and is_beyond:
            intervals.append((points[i].parameter, points[i + 1].parameter))
    return intervals


def _side(samples: FloatArray) -> int:
    """Return the sign of samples if their 95 % interval does not contain 0, otherwise 0."""
    if np.isnan(samples).mean() > 0.05:
        return 0
    low, high = interval(samples[np.isfinite(samples)])
    return 1 if low > 0.0 else -1 if high < 0.0 else 0


def _root(place: FloatArray, values: FloatArray, degree: int = 1, middle: float = 0.0) -> float:
    """Return the zero nearest to `middle` of a polynomial fitted to values; NaN without one."""
    known = np.isfinite(values)
    if known.sum() <= degree:
        return float("nan")
    roots = np.roots(np.polyfit(place[known] - middle, values[known], degree))
    real = roots[np.abs(roots.imag) < _REAL].real
    return middle + float(real[np.argmin(np.abs(real))]) if real.size else float("nan")


def lengths(points: Sequence[BranchPoint], span: float) -> FloatArray:
    """Return the length of a branch up to each point, shape (n_points,)."""
    steps = [
        float(np.linalg.norm(right.x(span) - left.x(span))) for left, right in pairwise(points)
    ]
    return np.concatenate([[0.0], np.cumsum(steps)])


def folds(points: Sequence[BranchPoint], span: float) -> list[BranchEvent]:
    """Return the folds of a branch: where λ turns back by more than its errors."""
    parameters = np.array([point.parameter for point in points])
    place = lengths(points, span)
    events = []
    extreme, way = 0, 0.0
    for i in range(1, len(points)):
        moved = parameters[i] - parameters[extreme]
        error = max(points[i].parameter_error, points[extreme].parameter_error)
        least = max(TURNED * error, LEAST_TURN * span)
        if way == 0.0:
            if abs(moved) > least:
                extreme = i
                way = float(np.sign(moved))
        elif way * moved >= 0.0:
            extreme = i
        elif abs(moved) > least:
            events.append(_fold(points, place, extreme))
            extreme = i
            way = -way
    return events


def _fold(points: Sequence[BranchPoint], place: FloatArray, extreme: int) -> BranchEvent:
    """Return the fold at an extreme point, from a parabola through its neighbours."""
    near = slice(max(extreme - BESIDE, 0), extreme + BESIDE + 1)
    s = place[near] - place[extreme]
    values = np.array([point.parameter for point in points[near]])
    a, b, c = np.polyfit(s, values, 2)
    # λ at the vertex s = -b / 2a, or at the extreme point if the vertex is far from these points
    fitted = float(c - b * b / (4.0 * a)) if abs(b) < 2.0 * abs(a) * np.ptp(s) else float(c)
    scatter = float(np.sqrt(np.mean((np.polyval([a, b, c], s) - values) ** 2)))
    error = TWO_SIDES * max(scatter, points[extreme].parameter_error)
    value = points[extreme].parameter
    return BranchEvent(
        "fold", fitted, min(fitted - error, value), max(fitted + error, value), extreme + 1
    )


def grazings(points: Sequence[BranchPoint]) -> list[BranchEvent]:
    """Return the grazings of a branch: where the probed pair begins or ceases to touch."""
    events = []
    for period in range(points[0].gaps.size):
        for i, (left, right) in enumerate(pairwise(points)):
            before = left.gaps[period]
            after = right.gaps[period]
            if np.isfinite([before, after]).all() and (before > 0.0) != (after > 0.0):
                low, high = sorted((left.parameter, right.parameter))
                events.append(BranchEvent("grazing", 0.5 * (low + high), low, high, i + 1))
    return events


@dataclass(frozen=True)
class BranchPoint:
    """A point of a branch.

    Attributes:
        state: z at the beginning of the orbit, shape (2 n,).
        parameter: λ.
        slow: its slow coordinates, shape (m,).
        residual, residual_error: of the mean map, relative to the norm of the slow coordinates.
        parameter_error: standard error of λ, as the point lies on the branch.
        derivatives: of the slow coordinates, independent estimates, shape (n_pairs, m, m).
        decays: of kicks, see `Ensemble.decays`, shape (n_periods, 2, n_kicks, m).
        by_parameter: derivative of the slow coordinates of the mean map by λ, shape (m,).
        tangent: of the branch in (slow / scale, λ / span), of length 1, shape (m + 1,).
        step: length of the step that led here, for the next one.
        iterations: evaluations of the mean map.
        strobes: what `Trajectory.strobes` has, shape (P, n_seen).
        low, high: smallest and largest value of each, shape (n_seen,).
        gaps: smallest gap at the probed pair in each period, shape (P,) [m].
        doubled: distance of states P periods apart of the motion that runs on from the point, if
            it repeats after a multiple of P only, relative to the state; 0 otherwise.
        alternation: share of that motion that alternates, see `alternating`; 0 where `doubled` is
            0 or a multiplier lies beyond 1.
    """

    state: FloatArray
    parameter: float
    slow: FloatArray
    residual: float
    residual_error: float
    parameter_error: float
    derivatives: FloatArray
    decays: FloatArray
    by_parameter: FloatArray
    tangent: FloatArray
    step: float
    iterations: int
    strobes: FloatArray
    low: FloatArray
    high: FloatArray
    gaps: FloatArray
    doubled: float
    alternation: float

    @property
    def scale(self) -> float:
        """Norm of the slow coordinates."""
        return float(np.linalg.norm(self.slow))

    @cached_property
    def multipliers(self) -> Multipliers:
        """Multipliers with their samples."""
        return multipliers(self.decays)

    @property
    def stability(self) -> Stability:
        """Stability by the multipliers; never "stable" beside a motion of a multiple of P."""
        verdict = self.multipliers.stability
        return "undecided" if verdict == "stable" and self.doubled else verdict

    def x(self, span: float) -> FloatArray:
        """Return the coordinates (slow / scale, λ / span) of the point, shape (m + 1,)."""
        return np.append(self.slow / self.scale, self.parameter / span)


def measured(
    ensemble: Ensemble, at: Solved, *, heading: FloatArray, span: float, step: float
) -> BranchPoint:
    """Return the point of a branch at a solved orbit: its derivatives, multipliers and motion.

    Args:
        ensemble: the mean map.
        at: the solved orbit.
        heading: the way in (slow, λ) that the branch has come, not scaled, shape (m + 1,).
        span: unit of λ.
        step: length of the step that led here.

    Raises:
        ArithmeticError: a kicked motion diverges.
    """
    map_ = ensemble.map
    y = map_.slow.of(at.state)
    scale = float(np.linalg.norm(y))
    derivatives = ensemble.derivatives(at.state, at.parameter, scale)
    at = replace(at, scale=scale)
    slope = by_parameter(ensemble, at, SLOPE * span)
    try:
        multiple = run_on(ensemble, at)[1]
    except ArithmeticError:
        multiple = None
    kicked = with_harmless_kicks(ensemble, at, multiple)
    trajectory = map_.trajectory(at.state, at.parameter, ensemble.periods)
    units = np.append(np.full(y.size, scale), span)
    gaps = (
        trajectory.gaps
        if trajectory.gaps.size
        else np.full(ensemble.periods, trajectory.smallest_gap)
    )
    error = at.uncertainty[-1] * span if at.uncertainty.size > y.size else 0.0
    point = BranchPoint(
        at.state,
        at.parameter,
        y,
        at.residual,
        at.residual_error,
        float(error),
        derivatives,
        kicked.decays(at.state, at.parameter, scale),
        slope,
        tangent(derivatives.mean(axis=0), slope * span / scale, heading / units),
        step,
        at.iterations,
        trajectory.strobes,
        trajectory.low,
        trajectory.high,
        gaps,
        0.0 if multiple is None else multiple.distance,
        0.0,
    )
    if multiple is not None and point.multipliers.stability != "unstable":
        with suppress(ArithmeticError):
            return replace(point, alternation=alternating(ensemble, at))
    return point


SLOPE = 0.02
"""Step of λ for the derivative by λ, relative to the span."""


def tangent(derivative: FloatArray, slope: FloatArray, heading: FloatArray) -> FloatArray:
    """Return the direction of the branch, of length 1, shape (m + 1,).

    It is the mean of the tangent of F(y, λ) = y and of the way that the branch has come, because
    the direction of either is known roughly only.

    Args:
        derivative: of F by y, shape (m, m).
        slope: of F by λ, shape (m,).
        heading: the way that the branch has come, of any length, in the same units, shape (m + 1,).
    """
    rows = np.c_[derivative - np.eye(len(derivative)), slope]
    direction = np.linalg.svd(rows)[2][-1]
    came = heading / np.linalg.norm(heading)
    both = came + (direction if direction @ came >= 0.0 else -direction)
    return np.asarray(both / np.linalg.norm(both))


_log = logging.getLogger(__name__)

EASY, HARD = 5, 10
"""Iterations up to which the next step is longer, and from which it is shorter."""
LONGER, SHORTER = 1.3, 0.5
DEVIATION = 2.0
"""Largest correction, relative to the step."""
LOOSE = 4.0
"""Standard errors of the residual within which a point is kept at the shortest step, marked as not
solved."""
ONSETS = (0.1, 0.14, 0.2, 0.3)
"""Amplitudes at which a doubled branch is sought, relative to the state. At amplitudes not much
larger than the kicks both orbits are smeared into one another, and λ may be far off. At large ones
the branch no longer lies along its first direction."""
LEADS_ON = 2
"""Steps that must be accepted behind the first point of a doubled branch."""
FARTHEST = 0.3
"""Largest correction of the first point of a doubled branch, relative to state and range."""
ROUNDS = 3
"""Number of new derivatives at each amplitude."""


@dataclass(frozen=True)
class Path:
    """Where a branch may go, and how.

    Attributes:
        start, stop: ends of the range of λ; a branch ends outside.
        step: length of the first steps, in units of the state and of the range of λ.
        longest, shortest: bounds of the steps.
        most: largest number of points.
    """

    start: float
    stop: float
    step: float = 0.04
    longest: float = 0.06
    shortest: float = 0.01
    most: int = 200

    @property
    def span(self) -> float:
        """Unit of λ."""
        return abs(self.stop - self.start)

    def has(self, parameter: float) -> bool:
        """Return whether λ lies within the range."""
        low, high = sorted((self.start, self.stop))
        return low <= parameter <= high


def first_point(ensemble: Ensemble, guess: FloatArray, path: Path) -> BranchPoint:
    """Return the first point of a branch, at the start of the range, from a state near it.

    Raises:
        ArithmeticError: no orbit is found, or a motion diverges.
        LinAlgError: the equations are singular.
    """
    scale = float(np.linalg.norm(ensemble.map.slow.of(guess)))
    J = ensemble.derivatives(guess, path.start, scale).mean(axis=0)
    solution = solved(ensemble, Guess(guess, path.start, scale), J)
    if not _is_near(solution):
        raise ArithmeticError(
            f"the mean map closes to {solution.residual:.2g} ± {solution.residual_error:.2g} only"
        )
    heading = np.append(np.zeros(ensemble.map.slow.size), path.stop - path.start)
    return measured(ensemble, solution, heading=heading, span=path.span, step=path.step)


def doubled_point(
    ensemble: Ensemble, near: BranchPoint, parameter: float, path: Path
) -> BranchPoint:
    """Return the first point of the branch that leaves a period doubling.

    The orbit of twice the period is sought at a given distance from the old one, along the
    direction of the multiplier near -1, with λ free.

    Args:
        ensemble: the mean map of twice the period.
        near: the first point of the old branch behind the doubling.
        parameter: λ at the doubling.
        path: the range of λ.

    Raises:
        ArithmeticError: no orbit is found.
    """
    slow = ensemble.map.slow
    scale = near.scale
    values, vectors = np.linalg.eig(near.multipliers.derivative)
    direction = np.real(vectors[:, np.argmin(np.abs(values + 1.0))])
    direction *= _opening_side(ensemble, near, parameter, direction) / np.linalg.norm(direction)
    first: BranchPoint | None = None
    for onset in ONSETS:
        state = near.state + slow.lifted(onset * scale * direction)
        predicted = np.append(slow.of(state) / scale, parameter / path.span)
        solution = _across(
            ensemble, Guess(state, parameter, scale), direction, predicted, path.span
        )
        if solution is None:
            continue
        way = np.append(slow.of(solution.state) - near.slow, solution.parameter - parameter)
        point = measured(ensemble, solution, heading=way, span=path.span, step=path.step)
        first = first or point
        if _leads_on(ensemble, point, path):
            return point
    if first is None:
        raise ArithmeticError("no orbit of twice the period is found at the doubling")
    return first


def _leads_on(ensemble: Ensemble, point: BranchPoint, path: Path) -> bool:
    """Return whether `LEADS_ON` further steps are accepted behind a point."""
    after: BranchPoint | None = point
    for _ in range(LEADS_ON):
        after = None if after is None else next_point(ensemble, after, path)
    return after is not None


def _across(
    ensemble: Ensemble, guess: Guess, direction: FloatArray, predicted: FloatArray, span: float
) -> Solved | None:
    """Return the orbit in the plane across a direction with λ free; None if there is none near."""
    for _ in range(ROUNDS):
        J = ensemble.derivatives(guess.state, guess.parameter, guess.scale).mean(axis=0)
        border = Border(
            np.append(direction, 0.0), predicted, span, by_parameter(ensemble, guess, SLOPE * span)
        )
        try:
            solution = solved(ensemble, guess, J, border)
        except (ArithmeticError, np.linalg.LinAlgError):
            return None
        guess = solution
        if solution.is_solved and solution.away < FARTHEST:
            return solution
    return None


def _opening_side(
    ensemble: Ensemble, near: BranchPoint, parameter: float, direction: FloatArray
) -> float:
    """Return the sign of a direction with which the pair is farther apart at the beginning.

    The orbit of twice the period may begin with either of its periods. The farther apart the pair
    is, the less harmful are kicks.
    """
    move = ensemble.map.slow.lifted(ONSETS[0] * near.scale * direction / np.linalg.norm(direction))
    openings = [
        ensemble.map.trajectory(near.state + sign * move, parameter, 2).openings
        for sign in (1.0, -1.0)
    ]
    return 1.0 if not openings[0].size or openings[0][-1] >= openings[1][-1] else -1.0


def followed(
    ensemble: Ensemble,
    points: list[BranchPoint],
    path: Path,
    *,
    keep: Callable[[BranchPoint, int], None],
    is_stopped: Callable[[], bool],
) -> tuple[list[BranchPoint], str]:
    """Go on with a branch until it leaves the range.

    Args:
        ensemble: the mean map.
        points: the points so far, at least one.
        path: range of λ and length of steps.
        keep: called with each new point and the number of points.
        is_stopped: whether to stop before the next point.

    Returns:
        All points, and why the branch ends: "range", "points", "lost" or "interrupted".
    """
    points = list(points)
    while len(points) < path.most:
        if len(points) > 1 and not path.has(points[-1].parameter):
            return points, "range"
        if is_stopped():
            return points, "interrupted"
        point = next_point(ensemble, points[-1], path)
        if point is None:
            return points, "lost"
        points.append(point)
        keep(point, len(points))
    return points, "points"


def next_point(ensemble: Ensemble, last: BranchPoint, path: Path) -> BranchPoint | None:
    """Return the next point of a branch; None if no step, however short, leads to one."""
    step = last.step
    while True:
        is_shortest = step <= path.shortest
        solution = _corrected(ensemble, last, path.span, step)
        if solution is not None and _is_accepted(solution, step, is_shortest):
            break
        if is_shortest:
            return None
        step = max(SHORTER * step, path.shortest)
    if solution.iterations <= EASY:
        step = min(LONGER * step, path.longest)
    elif solution.iterations >= HARD:
        step = max(SHORTER * step, path.shortest)
    way = np.append(
        ensemble.map.slow.of(solution.state) - last.slow, solution.parameter - last.parameter
    )
    try:
        return measured(ensemble, solution, heading=way, span=path.span, step=step)
    except (ArithmeticError, np.linalg.LinAlgError) as error:
        _log.debug("nothing can be measured at %g: %s", solution.parameter, error)
        return None


def why_lost(ensemble: Ensemble, last: BranchPoint, path: Path) -> str:
    """Return in words why no step leads on from the last point of a branch."""
    solution = _corrected(ensemble, last, path.span, path.shortest)
    if solution is None:
        return "a motion diverges, or the equations are singular"
    if not _is_near(solution):
        return (
            f"the mean map closes to {solution.residual:.2g} ± {solution.residual_error:.2g} only"
        )
    if not _is_accepted(solution, path.shortest, True):
        return f"the orbit that is found lies {solution.away / path.shortest:.2g} steps off"
    return "motions beside the orbit diverge"


def _corrected(ensemble: Ensemble, last: BranchPoint, span: float, step: float) -> Solved | None:
    """Return the corrected point of a step; None if motions diverge or equations are singular."""
    predicted = last.x(span) + step * last.tangent
    move = last.scale * step * last.tangent[:-1]
    state = last.state + ensemble.map.slow.lifted(move)
    guess = Guess(state, span * float(predicted[-1]), last.scale)
    border = Border(last.tangent, predicted, span, last.by_parameter)
    try:
        return solved(ensemble, guess, last.derivatives.mean(axis=0), border)
    except (ArithmeticError, np.linalg.LinAlgError) as error:
        _log.debug("a step of %g fails: %s", step, error)
        return None


def _is_accepted(found: Solved, step: float, is_shortest: bool) -> bool:
    """Return whether a corrected point continues the branch."""
    if not (found.is_solved or (is_shortest and _is_near(found))):
        return False
    return found.away <= max(DEVIATION * step, 2.0 * float(np.linalg.norm(found.uncertainty)))


def _is_near(found: Solved) -> bool:
    """Return whether a residual is zero within `LOOSE` standard errors."""
    return found.is_solved or found.residual <= LOOSE * found.residual_error
