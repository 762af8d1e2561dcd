"""Shoot for a periodic orbit of a smooth map: Newton's method in the slow coordinates alone.

    y = slow part of F(z, λ),   w = rest of F(z, λ),   z = basis y + w

The rest is taken over from one period to the next (Picard). Nothing is averaged, so this needs a
map whose derivative by kicks of some per cent is that of the map itself.

Source: Lust, Roose, Spence, Champneys, SIAM J. Sci. Comput. 19 (1998) 1188-1209.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from delam_fem.numerics.arrays import FloatArray
from delam_fem.studies.orbits.exact import Powered
from delam_fem.studies.orbits.protocol import PeriodMap

SOLVED = 1e-11
"""Relative residual at which an iteration ends."""
LONGEST = 0.3
"""Longest step, relative to the slow coordinates."""
RENEWED, SELDOM = 8, 4
"""First iterations with a new derivative each, and every how many later ones have one."""


@dataclass(frozen=True)
class Shot:
    """The best point of an iteration.

    Attributes:
        state: z.
        residual: of the slow coordinates, relative to their norm.
        multipliers: of kicks of the given size, by decreasing modulus, shape (m,).
        residuals: of all iterations.
    """

    state: FloatArray
    residual: float
    multipliers: npt.NDArray[np.complex128]
    residuals: tuple[float, ...]


def shoot(
    strobe: PeriodMap,
    start: FloatArray,
    parameter: float,
    *,
    kick: float = 0.03,
    iterations: int = 25,
    periods: int = 1,
    shift: float = 0.0,
) -> Shot:
    """Iterate from a state near a periodic orbit, and return the best point.

    Args:
        strobe: the map.
        start: a state near the orbit.
        parameter: of the map.
        kick: size of two-sided kicks for the derivative, relative to the slow coordinates.
        iterations: largest number of iterations.
        periods: P, number of periods of the drive in one of the orbit.
        shift: of the grid of time steps, as a share of a step.

    Raises:
        ArithmeticError: the motion diverges.
    """
    slow, z, residuals = strobe.slow, start, []
    powered = Powered(strobe, parameter, periods, shift)
    scale, best = float(np.linalg.norm(slow.of(start))), start
    derivative = np.eye(slow.size)
    for number in range(iterations):
        after, y = powered.after(z[None])[0], slow.of(z)
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
    values = np.linalg.eigvals(derivative_at(powered, best, kick * scale))
    ordered = values[np.argsort(-np.abs(values))].astype(np.complex128)
    return Shot(best, min(residuals), ordered, tuple(residuals))


def derivative_at(powered: Powered, state: FloatArray, size: float) -> FloatArray:
    """Return the derivative of the slow coordinates by two-sided kicks, shape (m, m)."""
    slow = powered.map.slow
    kicks = size * slow.basis.T
    ends = slow.of(powered.after(np.concatenate([state + kicks, state - kicks])))
    return np.asarray((ends[: len(kicks)] - ends[len(kicks) :]).T / (2.0 * size))
