"""How long a run is and how its base moves, period by period, from a case or without one.

Without dolfinx and PETSc, so that the workers of a sweep start fast.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np

from delam_fem.case.definition import Case
from delam_fem.case.excitation import base_motion
from delam_fem.numerics.arrays import FloatArray
from delam_fem.simulation.span import Span

DIVERGED_LENGTHS = 10.0
"""A gap or displacement of so many lengths of the laminae has no meaning any more."""


class Prescribed(Protocol):
    """A prescribed motion of the base, as far as a run needs it."""

    def states(self, times: FloatArray) -> FloatArray:
        """Return (q, q', q'') [m, m/s, m/s2] at times of shape (k,) [s], shape (k, 3)."""


BaseStates = Callable[[int], FloatArray]
"""From the number of a period to (q, q', q'') of the base at its N + 1 steps, shape (N + 1, 3)."""


def span_of(case: Case) -> Span:
    """Return how long the run of a case is, and what is kept of it."""
    return Span(
        case.time_step,
        case.time.steps_per_period,
        case.n_periods,
        case.n_window_periods,
        case.output.fields_per_period,
        DIVERGED_LENGTHS * case.lamina[0].length,
    )


def motion_of(case: Case) -> BaseStates:
    """Return the motion of the base of a case, period by period."""
    is_periodic = case.excitation.kind == "harmonic"
    return by_period(base_motion(case), span_of(case), is_periodic=is_periodic)


def by_period(motion: Prescribed, span: Span, *, is_periodic: bool) -> BaseStates:
    """Return a motion of the base, period by period.

    Args:
        motion: of the base.
        span: the steps of a period.
        is_periodic: the motion repeats after each period; then one table serves for all, which is
            not to be written to.
    """
    n_steps, dt = span.steps_per_period, span.time_step
    steps = np.arange(n_steps + 1)
    if is_periodic:
        table = motion.states(steps * dt)
        table[-1] = table[0]  # but for round-off it is
        table.flags.writeable = False
        return lambda period: table
    return lambda period: motion.states((period * n_steps + steps) * dt)


def at_rest(span: Span) -> BaseStates:
    """Return the motion of a base that does not move."""
    table = np.zeros((span.steps_per_period + 1, 3))
    table.flags.writeable = False
    return lambda period: table
