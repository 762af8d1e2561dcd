"""Newton's method on the map itself, where it is smooth enough to have an orbit to round-off.

The derivative is a finite difference in all coordinates, one piece of a piecewise smooth map (a
semismooth Newton method). Where contact changes from one state to the next, the iteration stalls,
and there is nothing exact to be had: `coarse.py` then says what can be said.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from delam_fem.numerics.arrays import FloatArray
from delam_fem.studies.orbits.protocol import PeriodMap

EXACT = 1e-10
"""Relative residual at which an orbit counts as exact."""
DIFFERENCE = 1e-7
"""Relative size of the differences; the derivative is good to about this."""
FLOOR = 1e-11
"""Relative residual at which the iteration ends."""
ITERATIONS = 9
SLOWEST, FAILURES = 0.5, 2
"""Factor by which an iteration should reduce the residual, and how often in a row it may not."""
BATCH = 64
"""Differences computed at a time; bounds the memory."""


@dataclass(frozen=True)
class Root:
    """Where Newton's method ended.

    Attributes:
        state: z, shape (2 n,).
        shift: of the grid of time steps on which it is an orbit, as a share of a step.
        residual: rms change of the coordinates in P periods, relative to the largest of its part
            of the state (displacements, velocities).
        derivative: of the map of P periods, shape (2 n, 2 n).
        iterations: Newton steps.
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
    """Look for a fixed point of the map of some periods.

    Args:
        map_: the map of one period.
        state: where to start, shape (2 n,).
        parameter: λ.
        periods: P.
        shift: of the grid of time steps, as a share of a step.

    Returns:
        The point with the smallest residual, exact or not.
    """
    powered = Powered(map_, parameter, periods, shift)
    best, failures = (np.inf, state, np.zeros((0, 0)), 0), 0
    for number in range(ITERATIONS):
        change = powered.after(state[None])[0] - state
        sizes = map_.nature.scales(state)
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
    """Return the derivative of the map by two-sided differences, in units of `Nature.scales`.

    Args:
        powered: the map.
        state: z, shape (2 n,).
        size: of the differences, relative to the scales.

    Returns:
        Shape (2 n, 2 n); its eigenvalues are those of the derivative in any units.
    """
    sizes, n = powered.map.nature.scales(state), state.size
    columns = np.empty((n, n))
    for first in range(0, n, BATCH):
        kicks = size * np.diag(sizes)[first : first + BATCH]
        ends = powered.after(np.concatenate([state + kicks, state - kicks]))
        columns[first : first + BATCH] = np.subtract(*np.split(ends, 2)) / (2.0 * size * sizes)
    return columns.T
