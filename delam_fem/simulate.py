"""The only time loop: stepper → supervisor → recorder.

The roles come as arguments; the loop knows no law, no scheme and no file.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal, Protocol

from delam_fem.operators import FloatArray
from delam_fem.recorder import Recorder, Stepper
from delam_fem.supervisor import Decision, Kinematics, Supervisor

Outcome = Literal["completed", "diverged", "interrupted"]


class Advancing(Stepper, Kinematics, Protocol):
    """A time integration; see newmark.py and moreau.py."""

    base_states: list[list[float]]
    base_index: int

    def advance(self) -> float:
        """Make the candidate state of the next step; return the smallest gap to examine [m]."""

    def jump(self, decision: Decision) -> tuple[float, float]:
        """Carry a decision out; return energy changes by impulses and by springs [J]."""

    def observe(self) -> None:
        """Bring the recorded quantities up to date."""


def simulate(
    stepper: Advancing,
    supervisor: Supervisor,
    recorder: Recorder,
    motion: Callable[[int], FloatArray],
    *,
    stop: Callable[[int], bool] = lambda period: False,
) -> Outcome:
    """Run from the recorder's last closed period to its end.

    Args:
        stepper: holds the state and advances it.
        supervisor: decides the jumps.
        recorder: keeps what is asked for; says how many steps and periods there are.
        motion: states (q, q', q'') of the base at the N + 1 steps of a period, shape (N + 1, 3).
        stop: asked after each period with the number of periods done; True ends the run.

    Returns:
        How it ended; a period in which the motion diverges is kept as far as it went.
    """
    floor, n_steps = -recorder.limit, recorder.steps_per_period
    for period in range(recorder.n_closed, recorder.n_periods):
        states = motion(period)
        stepper.base_states = states.tolist()
        stepper.base_index = 0
        record = recorder.open(stepper, states)
        for step in range(1, n_steps + 1):
            smallest_gap = stepper.advance()
            if smallest_gap <= 0.0 or supervisor.is_holding:
                if smallest_gap < floor:
                    stepper.observe()
                    record.keep(step, stepper, supervisor)
                    recorder.close(record, stepper, step)
                    return "diverged"
                decision = supervisor.examine(stepper)
                if decision is not None:
                    record.jump(step, decision, stepper.jump(decision))
            stepper.observe()
            record.keep(step, stepper, supervisor)
        if recorder.close(record, stepper, n_steps):
            return "diverged"
        if stop(period + 1) and period + 1 < recorder.n_periods:
            return "interrupted"
    return "completed"
