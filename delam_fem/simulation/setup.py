"""Set a run up: its length, and the motion of its base period by period, with or without a case.

This module imports neither dolfinx nor PETSc, so that the workers of a sweep start fast.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np

from delam_fem.case.definition import Case
from delam_fem.case.motion.excitation import drive
from delam_fem.numerics.arrays import FloatArray
from delam_fem.simulation.refinement import Refinement
from delam_fem.simulation.span import Span

DIVERGED_LENGTHS = 10.0
"""Gap or displacement, in lengths of the laminae, beyond which a motion has no meaning any more."""


class Prescribed(Protocol):
    """A prescribed motion of the base: the part of its interface that a run needs."""

    def states(self, times: FloatArray) -> FloatArray:
        """Return (q, q', q'') [m, m/s, m/s2], shape (k, 3), at `times` of shape (k,) [s]."""


BaseStates = Callable[[int], FloatArray]
"""Function of the number of a period: (q, q', q'') at its N + 1 steps, shape (N + 1, 3)."""


def span_of(case: Case) -> Span:
    """Return the span of a case: the length of its run, and what the run records."""
    return Span(
        case.time_step,
        case.steps_per_period,
        case.n_periods,
        case.n_window_periods,
        case.frames_per_period,
        DIVERGED_LENGTHS * case.lamina[0].length,
        Refinement(case.time.refine, case.time.refine_velocity),
    )


def motion_of(case: Case) -> BaseStates:
    """Return the drive of a case (motion of the base, or force) as a function of the period."""
    return by_period(drive(case), span_of(case), is_periodic=case.is_periodic)


def by_period(motion: Prescribed, span: Span, *, is_periodic: bool) -> BaseStates:
    """Return a base motion as a function of the period.

    Args:
        motion: the motion of the base.
        span: time step and number of steps of a period.
        is_periodic: whether the motion repeats after each period; then all periods share one
            read-only table.
    """
    n_steps, dt = span.steps_per_period, span.time_step
    steps = np.arange(n_steps + 1)
    if is_periodic:
        table = motion.states(steps * dt)
        table[-1] = table[0]  # both differ by round-off only
        table.flags.writeable = False
        return lambda period: table
    return lambda period: motion.states((period * n_steps + steps) * dt)


def at_rest(span: Span) -> BaseStates:
    """Return the motion of a base at rest as a function of the period."""
    table = np.zeros((span.steps_per_period + 1, 3))
    table.flags.writeable = False
    return lambda period: table
