"""Find a periodic orbit near where a motion settles, and judge its stability.

The place of the grid of time steps is arbitrary: a stepped motion may have an exact orbit on one
grid and none on another. The exact search tries several, and the result says which one it is.

Floquet multipliers follow from decays of kicks, with their intervals. A kick of the slow
coordinates is left to itself for some periods. After the first, the other coordinates follow the
slow ones, and

    d_{n+1} = A d_n + r_n,   n = 1, 2, …

with the jumps r_n of the map. A is fitted by least squares with weights 1/|d_n|, which lie between
1, for jumps of one size, and 1/|d_n|², by which kicks of all sizes count alike. Its eigenvalues are
the multipliers. The derivative of a single period takes the other coordinates as being at rest: it
gives -0.98 where kicks grow by 1.3 % in each period.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from delam_fem.api import (
    Case,
    FloatArray,
    assemble,
    chosen,
    drive,
    of_references,
    settling,
    start_of as start_of_motion,
)
from delam_fem.studies.orbits.maps import CaseFamily, ModalMap, PeriodMap
from delam_fem.studies.orbits.newton import (
    DIFFERENCE,
    USUAL,
    Ensemble,
    Guess,
    Perturbations,
    Powered,
    Root,
    Solved,
    derivative,
    newton,
    shoot,
    solved,
)
from delam_fem.studies.orbits.study import OfOrbits

ComplexArray = npt.NDArray[np.complex128]
Stability = Literal["stable", "unstable", "undecided"]

RESAMPLES = 200
"""Bootstrap samples of each fit; beyond each end of a 95 % interval lie 2.5 % of them."""
CONFIDENCE = 0.95
SMALLEST = 1.0 / 30.0
"""Size relative to the first below which kicks count less: impacts are frozen to the grid there."""
BENT = 1e-3
"""Half the width of an interval of multipliers at least: kicks bend the map by that much."""
EXCITED = 1e-4
"""Least power of a direction that is fitted, relative to the largest."""
_REAL = 1e-9


@dataclass(frozen=True)
class Multipliers:
    """Multipliers of an orbit with bootstrap samples.

    Attributes:
        values: multipliers of the fitted derivative, by decreasing modulus, shape (m,).
        samples: those of resampled kicks, first of all sizes, then of the smaller half of them
            alone, each row matched to `values`, shape (2 n_samples, m). So their interval contains
            what smaller kicks change.
        larger: those of the larger half alone, shape (n_samples, m). Steps hold small kicks.
        derivative: the fitted derivative A, shape (m, m).
    """

    values: ComplexArray
    samples: ComplexArray
    larger: ComplexArray
    derivative: FloatArray

    @property
    def errors(self) -> FloatArray:
        """Standard error of each multiplier, as a distance in the plane, shape (m,).

        It is the largest of those from all sizes, from the smaller half and from the larger half.
        """
        away = np.abs(np.vstack([self.samples, self.larger]) - self.values)
        of_each = (away**2).reshape(3, -1, self.values.size).mean(axis=1)
        return np.asarray(np.sqrt(of_each.max(axis=0) + (0.5 * BENT) ** 2))

    @property
    def largest(self) -> tuple[float, float]:
        """Interval of the largest modulus: it contains those of `samples` and of `larger`."""
        return _outer(self.samples, self.larger)

    @property
    def stability(self) -> Stability:
        """Stability by the interval of the largest modulus: below 1, above 1 or on both sides."""
        return stability_of(*self.largest)

    @property
    def of_larger(self) -> Stability:
        """Stability by all kicks together and by the larger half, without the smaller half."""
        return stability_of(*_outer(self.samples[: len(self.larger)], self.larger))

    @property
    def doubling(self) -> FloatArray:
        """Product of all 1 + μ, of values and samples, which changes sign at a period doubling."""
        return np.asarray(np.prod(1.0 + np.vstack([self.values, self.samples]), axis=1).real)

    @property
    def torus(self) -> FloatArray:
        """1 - |μ| of the largest complex pair, of values and samples; NaN where all are real."""
        return np.array([1.0 - abs(largest_pair(row)) for row in (self.values, *self.samples)])

    @property
    def angle(self) -> float:
        """Argument of the largest complex pair, 0 to π; NaN: all are real."""
        return float(np.angle(largest_pair(self.values)))


def multipliers(decays: FloatArray, seed: int = 0) -> Multipliers:
    """Return the multipliers of decays of kicks, with bootstrap samples over the kicks.

    Args:
        decays: kicks before and after each period, see `Ensemble.decays`, shape (n, 2, k, m).
        seed: seed of the resampling.
    """
    size = np.linalg.norm(decays[:, 0], axis=-1)
    counts = np.isfinite(size)
    before, after = np.where(counts[:, None, :, None], decays, 0.0).transpose(1, 0, 2, 3)
    sizes = size[counts & (size > SMALLEST)]
    is_small = counts & (size <= (np.median(sizes) if sizes.size else np.inf))
    is_large = counts & ~is_small if sizes.size else is_small
    k = decays.shape[2]
    chosen = np.random.default_rng(seed).integers(0, k, (RESAMPLES, k))
    matrices: list[FloatArray] = []
    for used in (counts, is_small, is_large):
        # A = (Σ w d' dᵀ) (Σ w d dᵀ)⁻¹; sums of each kick over periods are what is resampled
        weights = used / np.fmax(size, SMALLEST)
        both = np.einsum("nk,nki,nkj->kij", weights, after, before)
        power = np.einsum("nk,nki,nkj->kij", weights, before, before)
        if not matrices:
            derivative = _fitted(both.sum(axis=0), power.sum(axis=0))
        matrices.append(_fitted(both[chosen].sum(axis=1), power[chosen].sum(axis=1)))
    values = by_modulus(np.linalg.eigvals(derivative).astype(np.complex128))
    samples = [matched(row, values) for row in np.linalg.eigvals(np.concatenate(matrices))]
    *others, larger = np.split(np.array(samples), len(matrices))
    return Multipliers(values, np.concatenate(others), larger, derivative)


def _fitted(both: FloatArray, power: FloatArray) -> FloatArray:
    """Return A = both power⁻¹, without directions of little power, shape (…, m, m)."""
    return np.asarray(both @ np.linalg.pinv(power, rcond=EXCITED, hermitian=True))


def stability_of(low: float, high: float) -> Stability:
    """Return the stability by an interval of the largest modulus; undecided if an end is NaN."""
    return "stable" if low <= high < 1.0 else "unstable" if 1.0 < low <= high else "undecided"


def by_modulus(values: ComplexArray) -> ComplexArray:
    """Return multipliers by decreasing modulus; of a pair, the one with Im > 0 first."""
    return np.asarray(values[np.lexsort((-values.imag, -np.round(np.abs(values), 12)))])


def matched(values: npt.NDArray[Any], to: ComplexArray) -> ComplexArray:
    """Return multipliers in the order of others, matched by the least sum of distances."""
    from scipy.optimize import linear_sum_assignment

    _, columns = linear_sum_assignment(np.abs(values[None, :] - to[:, None]))
    return np.asarray(values[columns], dtype=np.complex128)


def interval(samples: FloatArray) -> tuple[float, float]:
    """Return the 95 % interval of samples."""
    tail = 0.5 * (1.0 - CONFIDENCE)
    low, high = np.quantile(samples, [tail, 1.0 - tail])
    return float(low), float(high)


def _outer(*samples: ComplexArray) -> tuple[float, float]:
    """Return an interval of the largest modulus that contains that of each set of samples."""
    low, high = np.transpose([interval(np.abs(rows).max(axis=1)) for rows in samples])
    return float(low.min()) - BENT, float(high.max()) + BENT


def largest_pair(values: ComplexArray) -> complex:
    """Return the multiplier with Im > 0 of the largest complex pair, NaN if all are real."""
    pairs = values[values.imag > _REAL]
    return complex(pairs[np.argmax(np.abs(pairs))]) if pairs.size else complex(np.nan)


SMOOTH = Perturbations(copies=16, size=1e-3, kick=0.03)
"""Perturbations for massless contact points, whose map has no jumps: few and small ones."""


def map_of(case: Case, key: str, channels: Sequence[str] = ()) -> PeriodMap:
    """Return the map of a case from one period to the next.

    Args:
        case: the case; its drive must be periodic.
        key: the parameter.
        channels: channels that are seen beside the probes.

    Raises:
        CaseError: the case has no such map.
    """
    if case.is_massless:
        return ModalMap(case, key, channels)
    return CaseFamily(case, key, channels).map()


def seen_channels(case: Case, channels: Sequence[str]) -> dict[str, str]:
    """Return the units of channels that a study of orbits shows, by their names.

    Args:
        case: the case.
        channels: their names; none: those of the reference probes.

    Raises:
        CaseError: there is no such channel with a value at each step.
    """
    return chosen(channels, assemble(case, needs_dolfinx=False).layout, case)


def columns_of(values: FloatArray, channels: Collection[str], case: Case) -> FloatArray:
    """Return the columns of channels in what is seen of a case, see `Trajectory.strobes`.

    Args:
        values: shape (…, n_seen).
        channels: names of the channels that are shown.
        case: the case.
    """
    n = len(channels)
    references = of_references([lamina.name for lamina in case.lamina])
    return values[..., :n] if list(channels) == references else values[..., -n:]


def start_of(case: Case) -> FloatArray | None:
    """Return the state with which a run of a case begins; None: rest, or massless points."""
    if case.is_massless or not (case.initial or case.impactor or case.begins_at_rest):
        return None
    operators = assemble(case, needs_dolfinx=False).operators
    start = start_of_motion(operators, drive(case.excitation).states(np.zeros(1))[0])
    return None if start is None else start.motion[:2].ravel()


def default_perturbations(case: Case) -> Perturbations:
    """Return the perturbations that suit the map of a case."""
    return SMOOTH if case.is_massless else USUAL


def kicks(given: OfOrbits, case: Case) -> Perturbations:
    """Return the usual perturbations of a case with kick size and seed that a user gives."""
    perturbations = replace(default_perturbations(case), seed=given.seed)
    return perturbations if given.kick is None else replace(perturbations, kick=given.kick)


GRIDS = (0.0, 0.25, 0.5, 0.75)
"""Shifts of the grid of time steps, as shares of a step, on which an exact orbit is sought."""
SETTLE, RESETTLE = 300, 40
"""Periods before a motion counts as settled, and after its grid is shifted."""
SAMPLE = 48
"""Periods, or multiples of P, whose mean state the coarse search starts from."""
LONG = 1000
"""The same where it is asked how long a motion alternates; even."""
MULTIPLES = range(2, settling.LONGEST + 1)
"""Multiples of P after which a motion may repeat that has left an orbit of P periods."""
LEAST_DISTANCE = 5e-3
"""Distance, relative to the state, below which two states are one: the map jumps by as much."""
REACH = 0.25
"""Largest kick relative to the distance of other states of a motion. Two kicked motions that have
arrived at two of its states differ by that distance, so that half of it is the kick."""
BESIDE = 0.1
"""Offset of a motion that runs on beside an orbit, in each slow coordinate, relative to kicks."""
DERIVATIVES = 6
"""Largest number of derivatives to solve the mean map, each taken where the last one led."""
LARGER = 10.0
"""Second size of differences, which gives the errors, relative to the first."""


@dataclass(frozen=True)
class Multiple:
    """A motion that repeats after a multiple of P periods only.

    Attributes:
        times: the multiple, from 2.
        distance: rms distance of its states P periods apart, relative to the state [-].
    """

    times: int
    distance: float


@dataclass(frozen=True)
class Coarse:
    """An orbit of the mean map.

    Attributes:
        solved: the point and its residual.
        kick: size of the kicks, relative to the state [-].
        multipliers: multipliers by their decay.
        away: rms distance from the orbit at which a motion ends that began beside it, relative to
            the state.
        multiple: that motion, or the settled one, if it repeats after a multiple of P only.
    """

    solved: Solved
    kick: float
    multipliers: Multipliers
    away: float
    multiple: Multiple | None

    @property
    def stability(self) -> Stability:
        """Stability by the decay of kicks, and by the motion beside the orbit where it is open.

        Steps hold small kicks. If these alone leave the stability open, and the motion stays as
        near as the map jumps, the orbit is stable.
        """
        stays = self.multiple is None and self.away < LEAST_DISTANCE
        estimate = self.multipliers
        return (
            estimate.of_larger if stays and estimate.of_larger == "stable" else estimate.stability
        )


@dataclass(frozen=True)
class Exact:
    """An orbit of the map itself.

    Attributes:
        root: the point and its residual.
        values: multipliers of the derivative, by decreasing modulus, shape (2 n,).
        errors: change of these by differences `LARGER` times as large, shape (2 n,).
    """

    root: Root
    values: ComplexArray
    errors: FloatArray


def settled(
    map_: PeriodMap, parameter: float, start: FloatArray | None, periods: int
) -> FloatArray:
    """Return the state after some periods from a state; None: from rest.

    Raises:
        ArithmeticError: the motion diverges.
    """
    states = np.zeros((1, len(map_.slow.basis))) if start is None else start[None]
    for _ in range(periods):
        states = map_.after(states, parameter)
    if not np.isfinite(states).all():
        raise ArithmeticError("the motion diverges")
    return np.asarray(states[0])


def settled_map(
    map_: PeriodMap, parameter: float, periods: int, start: FloatArray | None = None
) -> tuple[PeriodMap, FloatArray]:
    """Return the map that begins where the gap of the settled motion is wide, and a state.

    Args:
        map_: the map of the case from the beginning of a period of the drive.
        parameter: λ.
        periods: number of periods after which the motion counts as settled.
        start: state at the beginning of a period of the drive; None: rest.

    Returns:
        The map, and the settled state at the beginning of its period.

    Raises:
        ArithmeticError: the motion diverges.
    """
    return map_.started_at_widest_gap(settled(map_, parameter, start, periods), parameter)


def mean_of_motion(
    map_: PeriodMap, parameter: float, state: FloatArray, periods: int
) -> tuple[FloatArray, float, Multiple | None]:
    """Return mean and scatter of the states P periods apart of a motion, and its `Multiple`.

    The scatter is the rms distance of the slow coordinates from their mean, relative to its norm.
    The `Multiple` is None unless the motion repeats after a multiple of P only.
    """
    states, multiple = sampled(map_, parameter, state, periods)
    y = map_.slow.of(states)
    mean = states.mean(axis=0)
    middle = map_.slow.of(mean)
    return mean, rms_distance(y, middle) / float(np.linalg.norm(middle)), multiple


def sampled(
    map_: PeriodMap, parameter: float, state: FloatArray, periods: int
) -> tuple[FloatArray, Multiple | None]:
    """Return the states P periods apart of a motion, and its `Multiple`; None: it has none."""
    samples = []
    for _ in range(SAMPLE):
        state = settled(map_, parameter, state, periods)
        samples.append(state)
    states = np.array(samples)
    y = map_.slow.of(states)
    size = float(np.linalg.norm(y.mean(axis=0)))
    # the multiple is the first after which states repeat better by `LEAVES` than after P
    apart = {k: rms_distance(y[k:], y[:-k]) / size for k in (1, *MULTIPLES)}
    times = next(
        (k for k in MULTIPLES if apart[1] > max(settling.LEAVES * apart[k], LEAST_DISTANCE)), None
    )
    return states, None if times is None else Multiple(times, apart[1])


def rms_distance(a: FloatArray, b: FloatArray) -> float:
    """Return the root mean square of the distances of rows."""
    return float(np.sqrt(((a - b) ** 2).sum(axis=1).mean()))


def coarse_orbit(
    map_: PeriodMap,
    parameter: float,
    guess: FloatArray,
    periods: int,
    perturbations: Perturbations,
    settled_to: Multiple | None = None,
) -> Coarse:
    """Return the orbit of the mean map near a state, with its multipliers.

    Args:
        map_: the map of one period.
        parameter: λ.
        guess: a state near the orbit.
        periods: P.
        perturbations: what the mean is taken over, and the size of kicks.
        settled_to: the settled motion about the guess, if it is one of a multiple of P.

    Raises:
        ArithmeticError: a motion diverges.
        LinAlgError: the equations are singular.
    """
    scale = float(np.linalg.norm(map_.slow.of(guess)))
    first = Guess(guess, parameter, scale)
    ensemble = with_harmless_kicks(Ensemble(map_, periods, perturbations), first, settled_to)
    for _ in range(DERIVATIVES):  # the mean of a doubled motion may lie far from the orbit
        J = ensemble.derivatives(first.state, parameter, scale).mean(axis=0)
        at = solved(ensemble, first, J)
        if at.is_solved:
            break
        first = at
    away, multiple = run_on(ensemble, at)
    multiple = max(multiple, settled_to, key=lambda found: found.distance if found else 0.0)
    ensemble = with_harmless_kicks(ensemble, at, multiple)
    return Coarse(
        at,
        ensemble.perturbations.kick,
        multipliers(ensemble.decays(at.state, parameter, scale)),
        away,
        multiple,
    )


def run_on(ensemble: Ensemble, at: Guess) -> tuple[float, Multiple | None]:
    """Return how far from an orbit a motion ends that begins beside it, and its `Multiple`.

    Raises:
        ArithmeticError: the motion diverges.
    """
    map_ = ensemble.map
    slow = ensemble.map.slow
    states, multiple = sampled(map_, at.parameter, _settled_beside(ensemble, at), ensemble.periods)
    return rms_distance(slow.of(states), slow.of(at.state)) / at.scale, multiple


def alternating(ensemble: Ensemble, at: Guess) -> float:
    """Return the share of a motion beside an orbit that alternates from one P to the next.

    It is |mean (-1)^n d_n| over `LONG` states P periods apart, relative to the rms of their
    distances d_n from their mean. A motion of twice the period has 1. One that jumps of the map
    make alternate loses its phase in time, and has nearly 0.

    Raises:
        ArithmeticError: the motion diverges.
    """
    map_ = ensemble.map
    state = _settled_beside(ensemble, at)
    places = []
    for _ in range(LONG):
        state = settled(map_, at.parameter, state, ensemble.periods)
        places.append(map_.slow.of(state))
    away = np.array(places) - np.mean(places, axis=0)
    signs = (-1.0) ** np.arange(LONG)
    return float(np.linalg.norm(signs @ away / LONG) / np.sqrt((away**2).sum(axis=1).mean()))


def _settled_beside(ensemble: Ensemble, at: Guess) -> FloatArray:
    """Return the state to which a motion runs on that begins beside an orbit."""
    slow = ensemble.map.slow
    aside = np.full(slow.size, BESIDE * ensemble.perturbations.kick * at.scale)
    return settled(ensemble.map, at.parameter, at.state + slow.lifted(aside), SETTLE)


def with_harmless_kicks(ensemble: Ensemble, at: Guess, multiple: Multiple | None) -> Ensemble:
    """Return an ensemble whose kicks at an orbit do not reach over to other states.

    The other states are those of a motion of a multiple of P, and of the orbit itself.
    """
    of = ensemble.map.slow.of
    P = ensemble.periods
    kick = ensemble.perturbations.kick
    distances = [] if multiple is None else [multiple.distance]
    if P > 1:
        others = of(ensemble.map.trajectory(at.state, at.parameter, P - 1).states)
        distances += (np.linalg.norm(others - of(at.state), axis=1) / at.scale).tolist()
    kick = min([kick, *(REACH * distance for distance in distances)])
    return replace(ensemble, perturbations=replace(ensemble.perturbations, kick=kick))


def exact_orbit(
    map_: PeriodMap, parameter: float, start: FloatArray, periods: int
) -> tuple[Exact | None, Root]:
    """Look for an orbit to round-off, on several grids of time steps if there is a grid.

    On each grid, Newton's method in all coordinates starts from the settled state, then from where
    Newton's method in the slow coordinates ends: the full derivative holds on one small piece of
    the map only.

    Args:
        map_: the map of one period.
        parameter: λ.
        start: a settled state, shape (2 n,).
        periods: P.

    Returns:
        The orbit, None if there is none on any grid; and the best point.
    """
    roots = []
    for root in _roots(map_, parameter, start, periods):
        roots.append(root)
        if root.is_exact:
            break
    best = min(roots, key=lambda root: root.residual)
    if not best.is_exact:
        return None, best
    values = by_modulus(np.linalg.eigvals(best.derivative).astype(np.complex128))
    powered = Powered(map_, parameter, periods, best.shift)
    again = derivative(powered, best.state, LARGER * DIFFERENCE)
    others = matched(np.linalg.eigvals(again), values)
    return Exact(best, values, np.abs(others - values)), best


def _roots(map_: PeriodMap, parameter: float, start: FloatArray, periods: int) -> Iterator[Root]:
    """Yield where Newton's method ends on each grid: from the state, then from where shooting ends.

    A state settles anew on a shifted grid.
    """
    for shift in GRIDS if map_.info.is_stepped else GRIDS[:1]:
        powered = Powered(map_, parameter, periods, shift)
        states = start[None]
        for _ in range(RESETTLE if shift else 0):
            states = powered.after(states)
        yield newton(map_, states[0], parameter, periods, shift=shift)
        try:
            state = shoot(map_, states[0], parameter, periods=periods, shift=shift)
        except (ArithmeticError, np.linalg.LinAlgError):
            continue
        yield newton(map_, state, parameter, periods, shift=shift)
