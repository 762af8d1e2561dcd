"""What the loop needs of a case beside an engine: its recorder and the motion of its base.

Without dolfinx and PETSc, so that the workers of a sweep start fast.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from delam_fem.case.definition import Case
from delam_fem.case.excitation import base_motion
from delam_fem.model.operators import Operators
from delam_fem.numerics.arrays import FloatArray
from delam_fem.simulation.recorder import Recorder

DIVERGED_LENGTHS = 10.0
"""A gap or displacement of so many lengths of the laminae has no meaning any more."""


def recorder_of(case: Case, operators: Operators) -> Recorder:
    """Return a recorder for a case."""
    return Recorder(
        operators.base,
        time_step=case.time_step,
        steps_per_period=case.time.steps_per_period,
        n_periods=case.n_periods,
        n_observed=operators.observed.size,
        window_periods=case.n_window_periods,
        frames_per_period=case.output.fields_per_period,
        limit=DIVERGED_LENGTHS * case.lamina[0].length,
    )


def motion_of(case: Case) -> Callable[[int], FloatArray]:
    """Return the base states of a period by its number, shape (N + 1, 3).

    A harmonic motion has one table for all periods, which is not to be written to.
    """
    motion, n_steps, dt = base_motion(case), case.time.steps_per_period, case.time_step
    steps = np.arange(n_steps + 1)
    if case.excitation.kind == "harmonic":
        table = motion.states(steps * dt)
        table[-1] = table[0]  # but for round-off it is
        table.flags.writeable = False
        return lambda period: table
    return lambda period: motion.states((period * n_steps + steps) * dt)
