"""Find a periodic orbit near where a motion settles: exactly if there is one, coarsely otherwise.

The grid of time steps lies anywhere: a stepped motion may have an exact orbit on one grid and none
on another. The exact search tries several, and the result says which one it is.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from delam_fem.numerics.arrays import FloatArray
from delam_fem.studies.orbits.coarse import Guess, Solved, solved
from delam_fem.studies.orbits.ensemble import Ensemble, Perturbations
from delam_fem.studies.orbits.exact import (
    DIFFERENCE,
    Powered,
    Root,
    derivative,
    newton,
)
from delam_fem.studies.orbits.multipliers import (
    ComplexArray,
    Multipliers,
    by_modulus,
    matched,
    multipliers,
)
from delam_fem.studies.orbits.protocol import CaseMap, PeriodMap
from delam_fem.studies.orbits.shooting import shoot

GRIDS = (0.0, 0.25, 0.5, 0.75)
"""Shifts of the grid of time steps, as shares of a step, on which an exact orbit is sought."""
SETTLE, RESETTLE = 300, 40
"""Periods before a motion counts as settled, and after its grid is shifted."""
SAMPLE = 48
"""Periods, or multiples of P, whose mean state the coarse search starts from."""
MULTIPLES = range(2, 9)
"""Multiples of P after which a motion may repeat that has left an orbit of P periods."""
LEAVES = 2.0
"""Ratio of distances, P periods and a multiple of P apart, from which it has."""
LEAST_DISTANCE = 1e-3
"""Distance relative to the state below which two states are one: such jumps are the map's own."""
HALVED = 0.5
"""Second size of kicks, relative to the first: multipliers that depend on it are not known."""
LARGER = 10.0
"""Second size of differences, relative to the first."""


@dataclass(frozen=True)
class Coarse:
    """An orbit of the mean map.

    Attributes:
        solved: the point and its residual.
        by_kicks: multipliers for each size of kicks, by that size.
    """

    solved: Solved
    by_kicks: dict[float, Multipliers]


@dataclass(frozen=True)
class Multiple:
    """A settled motion that repeats after a multiple of P periods only.

    Attributes:
        times: after how many times P.
        distance: of its states P periods apart, relative to the state [-].
    """

    times: int
    distance: float


@dataclass(frozen=True)
class Exact:
    """An orbit of the map itself.

    Attributes:
        root: the point and its residual.
        values: multipliers of the derivative, by decreasing modulus, shape (2 n,).
        errors: by how much they differ for differences ten times larger, shape (2 n,).
    """

    root: Root
    values: ComplexArray
    errors: FloatArray


def settled(map_: PeriodMap, parameter: float, start: FloatArray, periods: int) -> FloatArray:
    """Return the state after some periods.

    Raises:
        ArithmeticError: the motion diverges.
    """
    states = start[None]
    for _ in range(periods):
        states = map_.after(states, parameter)
    if not np.isfinite(states).all():
        raise ArithmeticError("the motion diverges")
    return np.asarray(states[0])


def settled_map(
    map_: CaseMap, parameter: float, periods: int, start: FloatArray | None = None
) -> tuple[PeriodMap, FloatArray]:
    """Return the map of a case that begins where the tips of its settled motion are far apart.

    Args:
        map_: the map of the case from the beginning of a period of the drive.
        parameter: λ.
        periods: after which the motion counts as settled.
        start: state at the beginning of a period of the drive; None: rest.

    Returns:
        The map, and the settled state at the beginning of its period.

    Raises:
        ArithmeticError: the motion diverges.
    """
    first = np.zeros(map_.slow.basis.shape[0]) if start is None else start
    return map_.opened(settled(map_, parameter, first, periods), parameter)


def mean_of_motion(
    map_: PeriodMap, parameter: float, state: FloatArray, periods: int
) -> tuple[FloatArray, float, Multiple | None]:
    """Return the mean of states P periods apart, and how far the slow part of one is from it.

    The second is the rms distance relative to the norm of the mean: the scatter of the motion. The
    third says whether the motion repeats after a multiple of P only.
    """
    found = []
    for _ in range(SAMPLE):
        state = settled(map_, parameter, state, periods)
        found.append(state)
    states = np.array(found)
    y = map_.slow.of(states)
    mean = y.mean(axis=0)
    size = float(np.linalg.norm(mean))
    scatter = np.sqrt(((y - mean) ** 2).sum(axis=1).mean()) / size
    apart = {k: rms_distance(y[k:], y[:-k]) / size for k in (1, *MULTIPLES)}
    far = (k for k in MULTIPLES if apart[1] > max(LEAVES * apart[k], LEAST_DISTANCE))
    times = next(far, None)
    multiple = None if times is None else Multiple(times, apart[1])
    return states.mean(axis=0), float(scatter), multiple


def rms_distance(a: FloatArray, b: FloatArray) -> float:
    """Return the root mean square of the distances of rows."""
    return float(np.sqrt(((a - b) ** 2).sum(axis=1).mean()))


def coarse_orbit(
    map_: PeriodMap,
    parameter: float,
    guess: FloatArray,
    periods: int,
    perturbations: Perturbations,
) -> Coarse:
    """Return the orbit of the mean map near a state, with multipliers for two sizes of kicks.

    Raises:
        ArithmeticError: a motion diverges, or the equations are singular.
    """
    ensemble = Ensemble(map_, periods, perturbations)
    scale = float(np.linalg.norm(map_.slow.of(guess)))
    J = ensemble.derivatives(guess, parameter, scale).mean(axis=0)
    found = solved(ensemble, Guess(guess, parameter, scale), J)
    kicks = perturbations.kick, HALVED * perturbations.kick
    return Coarse(found, {kick: kicked(ensemble, found, kick) for kick in kicks})


def kicked(ensemble: Ensemble, at: Solved, kick: float) -> Multipliers:
    """Return the multipliers at a point for a size of kicks."""
    return multipliers(ensemble.derivatives(at.state, at.parameter, at.scale, kick))


def exact_orbit(
    map_: PeriodMap, parameter: float, start: FloatArray, periods: int
) -> tuple[Exact | None, Root]:
    """Look for an orbit to round-off, on several grids of time steps if there is a grid.

    Newton's method in all coordinates is tried first, then from where Newton's method in the slow
    coordinates ends: the full derivative is that of one small piece of the map.

    Args:
        map_: the map of one period.
        parameter: λ.
        start: a settled state.
        periods: P.

    Returns:
        The orbit, None if there is none on any grid; and the best point.
    """
    best: Root | None = None
    for shift in GRIDS if map_.nature.is_stepped else GRIDS[:1]:
        powered = Powered(map_, parameter, periods, shift)
        states = start[None]
        for _ in range(RESETTLE if shift else 0):
            states = powered.after(states)
        for root in _roots(powered, states[0]):
            if best is None or root.residual < best.residual:
                best = root
            if best.is_exact:
                break
        if best is not None and best.is_exact:
            break
    assert best is not None
    if not best.is_exact:
        return None, best
    values = by_modulus(np.linalg.eigvals(best.derivative).astype(np.complex128))
    powered = Powered(map_, parameter, periods, best.shift)
    again = derivative(powered, best.state, LARGER * DIFFERENCE)
    others = matched(np.linalg.eigvals(again), values)
    return Exact(best, values, np.abs(others - values)), best


def _roots(powered: Powered, start: FloatArray) -> Iterator[Root]:
    """Yield where Newton's method ends from a state, and from where shooting from it ends."""
    p = powered
    yield newton(p.map, start, p.parameter, p.periods, shift=p.shift)
    try:
        shot = shoot(p.map, start, p.parameter, periods=p.periods, shift=p.shift)
    except (ArithmeticError, np.linalg.LinAlgError):
        return
    yield newton(p.map, shot.state, p.parameter, p.periods, shift=p.shift)
