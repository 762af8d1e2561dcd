"""The only time loop: period by period, and within a period stepper → contact law → recorder.

The roles come as arguments; the loop knows no law, no scheme and no file.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, Protocol

from delam_fem.contact.decision import Decision, Kinematics, Supervisor
from delam_fem.numerics.arrays import BoolArray, FloatArray
from delam_fem.simulation.recorder import PeriodRecord, Recorder, Stepper

Outcome = Literal["completed", "diverged", "interrupted"]


@dataclass(frozen=True)
class State:
    """All that the future depends on, and the losses so far.

    Attributes:
        motion: u, v, a of the free dofs, shape (3, n) [m, m/s, m/s2 and slopes].
        resting: pairs at rest on one another, shape (n_pairs,).
        losses: energy lost to damping and to contact dampers so far [J].
    """

    motion: FloatArray
    resting: BoolArray
    losses: tuple[float, float] = (0.0, 0.0)


class Moving(Stepper, Protocol):
    """A state that can be taken up."""

    def renew_acceleration(self) -> None:
        """Compute a from the equation of motion."""


class Engine(Protocol):
    """What computes the steps of a period."""

    @property
    def stepper(self) -> Moving:
        """The state, as a recorder reads it."""

    def state(self) -> State:
        """Return the present state."""

    def restore(self, state: State, base_state: FloatArray) -> None:
        """Take over a state as it is, with (q, q', q'') of the base at that time."""

    def destroy(self) -> None:
        """Free what the engine holds."""

    def run_period(self, record: PeriodRecord, floor: float) -> int:
        """Compute the steps of a period into its record.

        Args:
            record: opened at the present state; knows the motion of the base.
            floor: gap below which the motion counts as diverged [m].

        Returns:
            Steps done, fewer than the period has where the motion diverged.
        """


class Advancing(Moving, Kinematics, Protocol):
    """A time integration that takes single steps; see engines/petsc."""

    resting: BoolArray
    is_resting: bool

    def restore(self, state: FloatArray) -> None:
        """Take over (u, v, a), shape (3, n)."""

    def rest(self, pairs: BoolArray) -> None:
        """Take over which pairs rest, shape (n_pairs,)."""

    def begin(self, base_states: FloatArray) -> None:
        """Begin a period with (q, q', q'') of the base at its start and its steps, (k, 3)."""

    def destroy(self) -> None:
        """Free what the stepper holds."""

    def advance(self) -> float:
        """Make the candidate state of the next step; return the smallest gap to examine [m]."""

    def jump(self, decision: Decision) -> tuple[float, float]:
        """Carry a decision out; return energy changes by impulses and by springs [J]."""


@dataclass(frozen=True)
class StepByStep:
    """The engine that asks a contact law after each step of a stepper."""

    stepper: Advancing
    supervisor: Supervisor

    def state(self) -> State:
        """Return the present state."""
        s = self.stepper
        return State(s.state(), s.resting.copy(), (s.dissipated, s.contact_damped))

    def restore(self, state: State, base_state: FloatArray) -> None:
        """Take over a state as it is; see `Engine`."""
        stepper = self.stepper
        stepper.begin(base_state[None, :])
        stepper.restore(state.motion)
        stepper.rest(state.resting.copy())
        stepper.dissipated, stepper.contact_damped = state.losses

    def destroy(self) -> None:
        """Free what the stepper holds."""
        self.stepper.destroy()

    def run_period(self, record: PeriodRecord, floor: float) -> int:
        """Compute the steps of a period into its record; see `Engine`."""
        stepper, supervisor = self.stepper, self.supervisor
        stepper.begin(record.base_states)
        n_steps = len(record.base_states) - 1
        for step in range(1, n_steps + 1):
            smallest_gap = stepper.advance()
            if smallest_gap <= 0.0 or stepper.is_resting:
                if smallest_gap < floor:
                    return step - 1
                decision = supervisor.examine(stepper)
                if decision is not None:
                    record.jump(step, decision, stepper.jump(decision))
            stepper.observe()
            record.keep(step, stepper)
        return n_steps


def set_initial(engine: Engine, initial: State | None, base_state: FloatArray) -> None:
    """Let an engine take a state, or what it has, and renew the accelerations.

    Args:
        engine: new, at rest.
        initial: state at the start; its losses do not count.
        base_state: (q, q', q'') of the base at the start.
    """
    initial = engine.state() if initial is None else initial
    engine.restore(State(initial.motion, initial.resting), base_state)
    engine.stepper.renew_acceleration()


def simulate(
    engine: Engine,
    recorder: Recorder,
    motion: Callable[[int], FloatArray],
    *,
    stop: Callable[[int], bool] = lambda period: False,
) -> Outcome:
    """Run from the recorder's last closed period to its end.

    Args:
        engine: holds the state and computes the steps.
        recorder: keeps what is asked for; says how many periods there are.
        motion: states (q, q', q'') of the base at the N + 1 steps of a period, shape (N + 1, 3).
        stop: asked after each period with the number of periods done; True ends the run.

    Returns:
        How it ended; a period in which the motion diverges is kept as far as it went.
    """
    record = None
    for period in range(recorder.n_closed, recorder.n_periods):
        record = recorder.open(engine.stepper, motion(period), record)
        n_steps = engine.run_period(record, -recorder.limit)
        is_bounded = recorder.close(record, engine.stepper, n_steps)
        if not is_bounded or n_steps < recorder.steps_per_period:
            return "diverged"
        if stop(period + 1) and period + 1 < recorder.n_periods:
            return "interrupted"
    return "completed"
