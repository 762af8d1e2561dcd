"""Solve for an orbit by Newton's method: on a smooth map, on its slow coordinates, or on its mean.

`newton` works on the map itself, which may be smooth enough to have an orbit to round-off. The
derivative is a finite difference in all coordinates, that of one piece of a piecewise smooth map (a
semismooth Newton method). Where contact changes from one state to the next, the iteration stalls,
and no orbit to round-off is found: `search.py` then says what can be said.

`Ensemble` takes the mean of the map. Where impacts are sharp, the map Φ of a period is rough below
some scale: which pair is hit first, and in which step, changes from one state to the next. The mean
over fixed small perturbations of a state,

    F(z) = Σ Φ(z + ξ_i) / k,   ξ_i and -ξ_i in pairs, the same in each call,

is smoother, and the spread of the terms says how well it is known. The grid of time steps is
shifted by another share of a step for each term, because impacts are seen at steps only. The
derivative of F for Newton's method is a two-sided difference over kicks that are larger than the
rough scale. What becomes of kicks in many periods says whether an orbit is stable.

Source: Schilder, Bureau, Santos, Thomsen, Starke, J. Sound Vib. 358 (2015) 251-266.

`solved` and `shoot` work on the slow coordinates, `solved` with F and `shoot` with Φ in its place:

    y = slow part of F(z, λ),  w = rest of F(z, λ),   z = basis y + w                       (N1)

Newton's method needs the derivative in the few slow coordinates alone; the rest decays by itself
and is taken over from one period to the next (Picard). `shoot` averages nothing, so it needs a map
whose derivative by kicks of some per cent is that of the map itself. With λ unknown too, the
equations are bordered by

    t · (x - x_predicted) = 0,   x = (y / scale, λ / span)                                  (N2)

which passes folds. F is known to its standard error only. `solved` ends when the residual lies
within that error; a residual that stays above it is reported as it is.

Source: Lust, Roose, Spence, Champneys, SIAM J. Sci. Comput. 19 (1998) 1188-1209.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from delam_fem.api import FloatArray
from delam_fem.studies.orbits.maps import PeriodMap


@dataclass(frozen=True)
class Perturbations:
    """Fixed small perturbations in antithetic pairs, and the size of kicks.

    Attributes:
        copies: k, an even number of perturbed states.
        size: standard deviation of the perturbations, relative to the state [-].
        kick: size of the kicks, relative to the state [-].
        seed: seed of the random numbers.
    """

    copies: int = 48
    size: float = 0.01
    kick: float = 0.02
    seed: int = 0

    def offsets(self, m: int) -> FloatArray:
        """Return the perturbations of m coordinates, shape (k, m); row i + k/2 is minus row i."""
        half = np.random.default_rng(self.seed).standard_normal((self.copies // 2, m))
        return np.asarray(self.size / np.sqrt(m) * np.concatenate([half, -half]))

    def shifts(self) -> FloatArray:
        """Return a shift of the step grid for each copy, within half a step about 0, shape (k,)."""
        half = (np.arange(self.copies // 2) + 0.5) / self.copies
        order = np.random.default_rng(self.seed + 1).permutation(half.size)
        return np.concatenate([half[order], -half[order]])


USUAL = Perturbations()
PERIODS = 40
"""Periods of the orbit for which kicks are followed."""
LARGEST = 1.5
"""Size relative to the first at which a kick has left the neighbourhood of the orbit."""


@dataclass(frozen=True)
class Mean:
    """The mean of a map over the perturbations.

    Attributes:
        state: F(z), shape (2 n,).
        slow: its slow coordinates, shape (m,).
        covariance: covariance of their errors, shape (m, m).
    """

    state: FloatArray
    slow: FloatArray
    covariance: FloatArray


@dataclass(frozen=True)
class Ensemble:
    """A map over some periods and the perturbations over which it is averaged.

    Attributes:
        map: map of one period.
        periods: P, number of periods of the drive in one of the orbit.
        perturbations: what the mean is taken over.
    """

    map: PeriodMap
    periods: int = 1
    perturbations: Perturbations = USUAL

    def mean(self, state: FloatArray, parameter: float, scale: float) -> Mean:
        """Return the mean of the map about a state.

        Args:
            state: z, shape (2 n,).
            parameter: λ.
            scale: norm of slow coordinates to which the size of perturbations is relative.

        Raises:
            ArithmeticError: a perturbed motion diverges.
        """
        copies, shifts = self._copies(state, scale)
        ends = self._ends(copies, parameter, shifts)
        pairs = 0.5 * np.add(*np.split(self.map.slow.of(ends), 2))
        covariance = np.atleast_2d(np.cov(pairs.T)) / len(pairs)
        return Mean(ends.mean(axis=0), pairs.mean(axis=0), covariance)

    def derivatives(self, state: FloatArray, parameter: float, scale: float) -> FloatArray:
        """Return the derivative of the slow coordinates for each pair, shape (k/2, m, m).

        The mean of all is the derivative of F. Column j is the response to kicks of coordinate j to
        both sides.

        Args:
            state: z, shape (2 n,).
            parameter: λ.
            scale: norm of slow coordinates to which sizes are relative.

        Raises:
            ArithmeticError: a perturbed motion diverges.
        """
        copies, shifts = self._copies(state, scale)
        slow = self.map.slow
        kick = scale * self.perturbations.kick
        columns = []
        for direction in slow.basis.T:
            kicked = np.concatenate([copies + kick * direction, copies - kick * direction])
            ends = slow.of(self._ends(kicked, parameter, np.tile(shifts, 2)))
            columns.append(np.subtract(*np.split(ends, 2)) / (2.0 * kick))
        each = np.stack(columns, axis=-1)
        return np.asarray(0.5 * np.add(*np.split(each, 2)))

    def decays(self, state: FloatArray, parameter: float, scale: float) -> FloatArray:
        """Return kicks before and after each of some periods, relative to their first size.

        A kick is half the difference of two motions that are kicked to both sides of the orbit in
        a random direction; each such pair has another step grid. A kick that has grown to `LARGEST`
        is replaced by a new one.

        Args:
            state: z, shape (2 n,).
            parameter: λ.
            scale: norm of slow coordinates to which sizes are relative.

        Returns:
            Shape (`PERIODS`, 2, n_kicks, m); NaN before the first period of a kick, in which the
            other coordinates do not follow the slow ones yet.

        Raises:
            ArithmeticError: a kicked motion diverges.
        """
        slow = self.map.slow
        perturbations = self.perturbations
        rng = np.random.default_rng(perturbations.seed + 2)
        size = perturbations.kick * scale
        kicks = np.full((max(perturbations.copies // 2, slow.size), slow.size), np.nan)
        shifts = (np.arange(len(kicks)) + 0.5) / len(kicks) - 0.5
        states = np.tile(state, (2, len(kicks), 1))
        samples = []
        for _ in range(PERIODS):
            is_new = ~(np.linalg.norm(kicks, axis=1) <= LARGEST)  # NaN, at first, is new too
            new = rng.standard_normal((int(is_new.sum()), slow.size))
            aside = slow.lifted(size / np.linalg.norm(new, axis=1, keepdims=True) * new)
            states[:, is_new] = state + np.array([aside, -aside])
            states = self._ends(np.concatenate(states), parameter, np.tile(shifts, 2))
            states = states.reshape(2, len(kicks), -1)
            before = np.where(is_new[:, None], np.nan, kicks)
            kicks = slow.of(states[0] - states[1]) / (2.0 * size)
            samples.append([before, kicks])
        return np.array(samples)

    def _copies(self, state: FloatArray, scale: float) -> tuple[FloatArray, FloatArray]:
        """Return the perturbed states and the shifts of their grids."""
        slow = self.map.slow
        offsets = scale * self.perturbations.offsets(slow.size)
        return state + slow.lifted(offsets), self.perturbations.shifts()

    def _ends(self, states: FloatArray, parameter: float, shifts: FloatArray) -> FloatArray:
        for _ in range(self.periods):
            states = self.map.after(states, parameter, shifts)
        if not np.isfinite(states).all():
            raise ArithmeticError("a perturbed motion diverges")
        return states


EXACT = 1e-10
"""Relative residual at which an orbit counts as exact."""
DIFFERENCE = 1e-7
"""Relative size of the differences; the derivative is good to about this."""
FLOOR = 1e-11
"""Relative residual at which the iteration ends."""
FARTHEST = 10.0
"""Largest change of a coordinate, relative to the largest of its part at the start. Far away any
body that floats repeats: what it falls in a period is round-off there."""
ITERATIONS = 9
SLOWEST, FAILURES = 0.5, 2
"""Factor by which an iteration should reduce the residual, and how often in a row it may not."""
BATCH = 64
"""Number of differences that are computed at a time, which bounds the memory."""


@dataclass(frozen=True)
class Root:
    """Where Newton's method ended.

    Attributes:
        state: z, shape (2 n,).
        shift: shift of the grid of time steps, as a share of a step.
        residual: rms change of the coordinates in P periods, relative to the largest of its part
            of the state (displacements, velocities).
        derivative: of the map of P periods in units of `MapInfo.scales`, shape (2 n, 2 n).
        iterations: number of Newton steps.
    """

    state: FloatArray
    shift: float
    residual: float
    derivative: FloatArray
    iterations: int

    @property
    def is_exact(self) -> bool:
        """Whether the residual is that of an exact orbit."""
        return self.residual <= EXACT


def newton(
    map_: PeriodMap, state: FloatArray, parameter: float, periods: int = 1, *, shift: float = 0.0
) -> Root:
    """Look for a fixed point of the map of P periods by Newton's method in all coordinates.

    Args:
        map_: the map of one period.
        state: where to start, shape (2 n,).
        parameter: λ.
        periods: P.
        shift: shift of the grid of time steps, as a share of a step.

    Returns:
        The point with the smallest residual within `FARTHEST`, exact or not.
    """
    powered = Powered(map_, parameter, periods, shift)
    best = (np.inf, state, np.zeros((0, 0)), 0)
    start = state
    reach = FARTHEST * map_.info.scales(start)
    failures = 0
    for number in range(ITERATIONS):
        if (np.abs(state - start) > reach).any():
            break
        change = powered.after(state[None])[0] - state  # (1 - D) step = change, scaled by sizes
        sizes = map_.info.scales(state)
        residual = float(np.sqrt(np.mean((change / sizes) ** 2)))
        if not np.isfinite(residual):
            break
        failures = 0 if residual < SLOWEST * best[0] else failures + 1
        if residual < best[0]:
            D = derivative(powered, state)
            best = residual, state, D, number
        elif failures < FAILURES:
            D = derivative(powered, state)
        if failures == FAILURES or best[0] <= FLOOR:
            break
        try:
            state = state + sizes * np.linalg.solve(np.eye(state.size) - D, change / sizes)
        except np.linalg.LinAlgError:
            break
    residual, state, D, number = best
    return Root(state, shift, residual, D, number)


@dataclass(frozen=True)
class Powered:
    """The map of P periods at a parameter, on a shifted grid of time steps."""

    map: PeriodMap
    parameter: float
    periods: int = 1
    shift: float = 0.0

    def after(self, states: FloatArray) -> FloatArray:
        """Return the states P periods later, shape (k, 2 n)."""
        shifts = np.full(len(states), self.shift)
        for _ in range(self.periods):
            states = self.map.after(states, self.parameter, shifts)
        return states


def derivative(powered: Powered, state: FloatArray, size: float = DIFFERENCE) -> FloatArray:
    """Return the derivative of the map by two-sided differences, in units of `MapInfo.scales`.

    Args:
        powered: the map.
        state: z, shape (2 n,).
        size: of the differences, relative to the scales.

    Returns:
        Shape (2 n, 2 n); its eigenvalues are those of the derivative in any units.
    """
    sizes = powered.map.info.scales(state)
    n = state.size
    columns = np.empty((n, n))
    for first in range(0, n, BATCH):
        kicks = size * np.diag(sizes)[first : first + BATCH]
        ends = powered.after(np.concatenate([state + kicks, state - kicks]))
        columns[first : first + BATCH] = np.subtract(*np.split(ends, 2)) / (2.0 * size * sizes)
    return columns.T


SOLVED = 1e-11
"""Relative residual at which `shoot` ends."""
LONGEST = 0.3
"""Longest step, relative to the slow coordinates."""
RENEWED, SELDOM = 8, 4
"""Number of first iterations with a new derivative each; later, one in so many has one."""


def shoot(
    strobe: PeriodMap,
    start: FloatArray,
    parameter: float,
    *,
    kick: float = 0.03,
    iterations: int = 25,
    periods: int = 1,
    shift: float = 0.0,
) -> FloatArray:
    """Solve for an orbit near a state by Newton's method in the slow coordinates, with no mean.

    Args:
        strobe: the map.
        start: a state near the orbit.
        parameter: λ.
        kick: size of two-sided kicks for the derivative, relative to the slow coordinates.
        iterations: largest number of iterations.
        periods: P, number of periods of the drive in one of the orbit.
        shift: shift of the grid of time steps, as a share of a step.

    Returns:
        The state with the smallest residual, solved or not, shape (2 n,).

    Raises:
        ArithmeticError: the motion diverges.
        LinAlgError: the equations are singular.
    """
    slow = strobe.slow
    z = start
    residuals = []
    powered = Powered(strobe, parameter, periods, shift)
    scale = float(np.linalg.norm(slow.of(start)))
    best = start
    derivative = np.eye(slow.size)
    for number in range(iterations):
        after = powered.after(z[None])[0]
        y = slow.of(z)
        gap = slow.of(after) - y
        residuals.append(float(np.linalg.norm(gap)) / scale)
        if not np.isfinite(residuals[-1]):
            raise ArithmeticError("shooting: the motion diverges; start nearer to the orbit")
        if residuals[-1] == min(residuals):
            best = z
        if residuals[-1] < SOLVED:
            break
        if number < RENEWED or number % SELDOM == 0:
            derivative = derivative_at(powered, z, kick * scale)
        step: Any = np.linalg.solve(np.eye(slow.size) - derivative, gap)
        step *= min(1.0, LONGEST * scale / float(np.linalg.norm(step)))
        z = after - slow.lifted(slow.of(after)) + slow.lifted(y + step)
    return best


def derivative_at(powered: Powered, state: FloatArray, size: float) -> FloatArray:
    """Return the derivative of the slow coordinates by two-sided kicks, shape (m, m)."""
    slow = powered.map.slow
    kicks = size * slow.basis.T
    ends = slow.of(powered.after(np.concatenate([state + kicks, state - kicks])))
    return np.asarray((ends[: len(kicks)] - ends[len(kicks) :]).T / (2.0 * size))


FEWEST, MOST = 3, 14
"""Least number of iterations, by which the rest has settled, and the largest number."""
WITHIN = 2.0
"""Standard errors within which a residual counts as zero."""
SMOOTH = 1e-9
"""Relative residual that is small enough however small its standard error is."""


@dataclass(frozen=True)
class Guess:
    """A state near an orbit.

    Attributes:
        state: z, shape (2 n,).
        parameter: λ.
        scale: norm of the slow coordinates to which residuals and kicks are relative.
    """

    state: FloatArray
    parameter: float
    scale: float


@dataclass(frozen=True)
class Border:
    """The plane N2 in which a point of a branch is sought.

    Attributes:
        tangent: t, of length 1, shape (m + 1,).
        predicted: x_predicted, shape (m + 1,).
        span: unit of λ.
        by_parameter: derivative of the slow coordinates of F by λ, shape (m,).
    """

    tangent: FloatArray
    predicted: FloatArray
    span: float
    by_parameter: FloatArray


@dataclass(frozen=True)
class Solved(Guess):
    """A point at which the iteration of `solved` ended.

    Attributes:
        residual: |y - slow F| / scale.
        residual_error: its standard error, relative to the scale too.
        uncertainty: standard error of x that follows, shape (m,), or (m + 1,) with λ.
        iterations: number of evaluations of F.
        away: distance of x from where it was predicted; 0 without a border.
    """

    residual: float
    residual_error: float
    uncertainty: FloatArray
    iterations: int
    away: float = 0.0

    @property
    def is_solved(self) -> bool:
        """Whether the residual is zero within its error."""
        return is_zero(self.residual, self.residual_error)


def is_zero(residual: float, error: float) -> bool:
    """Return whether a residual is zero within `WITHIN` standard errors, or below `SMOOTH`."""
    return residual <= SMOOTH or residual <= WITHIN * error < np.inf


def solved(
    ensemble: Ensemble, guess: Guess, derivative: FloatArray, border: Border | None = None
) -> Solved:
    """Solve for an orbit of the mean map near a guess, by N1 and, with a border, N2.

    Args:
        ensemble: the mean map.
        guess: where to start.
        derivative: of the slow coordinates of F by those of z, near the guess, shape (m, m).
        border: plane in which the orbit is sought with λ free; None: λ stays.

    Returns:
        The point with the smallest residual, solved or not.

    Raises:
        ArithmeticError: a motion diverges.
        LinAlgError: the equations are singular.
    """
    slow = ensemble.map.slow
    scale = guess.scale
    m = slow.size
    matrix = derivative - np.eye(slow.size)  # in units of the scale and the span
    if border is not None:
        column = border.by_parameter * border.span / scale
        matrix = np.vstack([np.c_[matrix, column], border.tangent])
    inverse = np.linalg.inv(matrix)[:, :m] / scale
    best: Solved | None = None
    for number in range(1, MOST + 1):
        mean = ensemble.mean(guess.state, guess.parameter, scale)
        y = slow.of(guess.state)
        equations = (mean.slow - y) / scale
        solution = Solved(
            guess.state,
            guess.parameter,
            scale,
            float(np.linalg.norm(mean.slow - y)) / scale,
            float(np.sqrt(np.trace(mean.covariance))) / scale,
            np.sqrt(np.einsum("ij,jk,ik->i", inverse, mean.covariance, inverse)),
            number,
        )
        if border is not None:
            off = np.append(y / scale, guess.parameter / border.span) - border.predicted
            solution = replace(solution, away=float(np.linalg.norm(off)))
            equations = np.append(equations, border.tangent @ off)
        # the first points do not count: the rest of the guess has not settled yet
        if number >= FEWEST and (best is None or solution.residual < best.residual):
            best = solution
        if best is not None and best.is_solved:
            return best
        step = -np.linalg.solve(matrix, equations)
        step *= min(1.0, LONGEST / max(float(np.linalg.norm(step)), 1e-300))
        fast_part = mean.state - slow.lifted(mean.slow)
        guess = replace(
            guess,
            state=fast_part + slow.lifted(y + scale * step[:m]),
            parameter=guess.parameter + (0.0 if border is None else border.span * float(step[-1])),
        )
    assert best is not None
    return best


def by_parameter(ensemble: Ensemble, guess: Guess, step: float) -> FloatArray:
    """Return the derivative of the slow coordinates of F by λ, from both sides, shape (m,)."""
    ends = [
        ensemble.mean(guess.state, guess.parameter + sign * step, guess.scale).slow
        for sign in (1.0, -1.0)
    ]
    return np.asarray((ends[0] - ends[1]) / (2.0 * step))
