"""Run the time loop period by period; in each step stepper → contact law → recorder.

This is the only time loop of the package. Stepper, supervisor and recorder are arguments; the loop
knows no law, no scheme and no file. A motion starts from a given state, or with each lamina in its
first mode (`initial_state`).
"""

from __future__ import annotations

import gc
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, ClassVar, Literal, Protocol

import numpy as np

from delam_fem.contact.decisions import Decision, Kinematics, PairState, Supervisor
from delam_fem.model.layout import Structure
from delam_fem.model.linear import first_mode
from delam_fem.numerics.types import BoolArray, FloatArray
from delam_fem.simulation.recorder import PeriodRecord, Recorder, Stepper
from delam_fem.system.errors import require

Outcome = Literal["completed", "diverged", "interrupted", "failed"]

ASKED_EVERY = 10
"""Periods after which a run reports and may be stopped, at the latest."""


@dataclass(frozen=True, init=False)
class State:
    """The state of a motion at an instant, and the energy lost so far.

    Attributes:
        motion: u, v, a of the free dofs, shape (3, n) [m, m/s, m/s2 and slopes].
        pair_state: what is remembered of the pairs.
        losses: energies lost so far to damping and to contact dampers [J].
        internal: the numbers behind `motion` in an engine that has other unknowns; from them it
            continues bit for bit. An engine ignores numbers that do not belong to `motion`.
    """

    motion: FloatArray
    pair_state: PairState
    losses: tuple[float, float] = (0.0, 0.0)
    internal: FloatArray | None = None

    def __init__(
        self,
        motion: FloatArray,
        pair_state: PairState | BoolArray,
        losses: tuple[float, float] = (0.0, 0.0),
        internal: FloatArray | None = None,
    ) -> None:
        """Take over the numbers of a state.

        Args:
            motion: see the class.
            pair_state: what is remembered of the pairs, or which of them rest, shape (n_pairs,):
                then nothing else is remembered.
            losses: see the class.
            internal: see the class.

        Raises:
            CaseError: an array has another form.
        """
        shape = np.shape(motion)
        is_motion = len(shape) == 2 and shape[0] == 3
        require(is_motion, "state.motion", "the shape (3, n): u, v, a", shape)
        if not isinstance(pair_state, PairState):
            pair_state = PairState.at_start(np.size(pair_state))._replace(resting=pair_state)
        kind = np.asarray(pair_state.resting).dtype
        require(kind == np.bool_, "state.resting", "an array of bool, one per pair", kind.name)
        object.__setattr__(self, "motion", motion)
        object.__setattr__(self, "pair_state", pair_state)
        object.__setattr__(self, "losses", losses)
        object.__setattr__(self, "internal", internal)

    @property
    def resting(self) -> BoolArray:
        """Which pairs are at rest, shape (n_pairs,)."""
        return self.pair_state.resting

    @property
    def arrays(self) -> dict[str, Any]:
        """The numbers by name, as files keep them; `of` makes a state of them again."""
        losses = np.array(self.losses)
        arrays = {"motion": self.motion, **self.pair_state._asdict(), "losses": losses}
        return arrays if self.internal is None else arrays | {"internal": self.internal}

    @classmethod
    def of(cls, arrays: Mapping[str, Any]) -> State:
        """Return the state with the numbers of `arrays`, which may have others beside them."""
        damping, contact = (float(loss) for loss in arrays["losses"])
        pair_state = PairState._make(arrays[name] for name in PairState._fields)
        return cls(arrays["motion"], pair_state, (damping, contact), arrays.get("internal"))


class Shared(Protocol):
    """What engines and steppers that may run on several ranks have in common.

    A class of this kind without methods of its own is that of one process that has all dofs.
    """

    @property
    def n_shares(self) -> int:
        """Number of ranks on which the order of the dofs depends; 1: on none."""
        return 1

    def renew_acceleration(self) -> None:
        """Set the acceleration to that of the equation of motion, if the state has one."""
        return

    def gather(self, share: FloatArray) -> FloatArray:
        """Return values of all dofs from those of this rank, the last axis (collective)."""
        return share

    def scatter(self, of_all: FloatArray) -> FloatArray:
        """Return the values of this rank's dofs among those of all dofs, the last axis."""
        return of_all

    def destroy(self) -> None:
        """Free the PETSc objects that it holds, if any."""
        return


class Engine(Shared, Protocol):
    """An engine, which computes the steps of periods and holds the state of the motion.

    Attributes:
        steps_at_once: largest number of steps that it computes in one go, if a period has fewer.
    """

    steps_at_once: ClassVar[int] = 1

    def state(self) -> State:
        """Return the present state of all dofs (collective)."""

    def restore(self, state: State, base_state: FloatArray) -> None:
        """Set the state as given, with (q, q', q'') of the base at that time, shape (3,)."""

    def advance(self, recorder: Recorder, base_states: FloatArray, n_periods: int) -> bool:
        """Compute periods of the same motion of the base, and record them.

        Args:
            recorder: gets the periods.
            base_states: (q, q', q'') of the base at the steps of each period, shape (N + 1, 3).
            n_periods: number of periods; none is computed after one in which the motion diverges.

        Returns:
            Whether the motion stayed within bounds.

        Raises:
            ArithmeticError: a step has no solution; the steps before it are recorded.
        """


def one_period(engine: Engine, recorder: Recorder, base_states: FloatArray) -> PeriodRecord:
    """Compute one period from the present state, and return its record.

    Args:
        engine: engine that holds the state.
        recorder: recorder whose first row the period takes; its earlier periods are forgotten.
        base_states: (q, q', q'') of the base at the steps of each period, shape (N + 1, 3).
    """
    recorder.n_closed = 0
    engine.advance(recorder, base_states, 1)
    return recorder.window[-1]


class Advancing(Shared, Stepper, Kinematics, Protocol):
    """A stepper that makes single steps of a scheme; see engines/petsc."""

    is_resting: bool
    damped: FloatArray

    def restore(self, state: FloatArray) -> None:
        """Set (u, v, a) of the own dofs, shape (3, n_own)."""

    def remember(self, pair_state: PairState) -> None:
        """Set what is remembered of the pairs; its arrays are never written to."""

    def begin(self, base_states: FloatArray) -> Sequence[Sequence[float]]:
        """Begin a period with (q, q', q'') of the base at its start and steps, shape (k, 3).

        Returns:
            The same numbers as sequences.
        """

    def advance(self) -> float:
        """Compute the candidate state of the next step; return the smallest gap to examine [m]."""

    def jump(self, decision: Decision) -> tuple[float, float]:
        """Apply a decision to the state; return energy changes by impulses and by springs [J]."""


@dataclass(frozen=True)
class StepByStep(Engine):
    """The engine that makes single steps and calls the supervisor of a contact law after each."""

    stepper: Advancing
    supervisor: Supervisor

    @property
    def n_shares(self) -> int:
        """Number of ranks on which the order of the dofs depends; 1: on none."""
        return self.stepper.n_shares

    def state(self) -> State:
        """Return the present state of all dofs (collective)."""
        s = self.stepper
        losses = s.dissipated, s.contact_damped
        return State(s.gather(s.state()), s.pair_state.copy(), losses)

    def restore(self, state: State, base_state: FloatArray) -> None:
        """Set the state as given; see `Engine`."""
        stepper = self.stepper
        stepper.begin(base_state[None, :])
        stepper.restore(stepper.scatter(state.motion))
        stepper.remember(state.pair_state.copy())
        stepper.dissipated, stepper.contact_damped = state.losses

    def renew_acceleration(self) -> None:
        """Set the acceleration to that of the equation of motion."""
        self.stepper.renew_acceleration()

    def gather(self, share: FloatArray) -> FloatArray:
        """Return values of all dofs from those of this rank (collective); see `Engine`."""
        return self.stepper.gather(share)

    def scatter(self, of_all: FloatArray) -> FloatArray:
        """Return the values of this rank's dofs among those of all dofs; see `Engine`."""
        return self.stepper.scatter(of_all)

    def destroy(self) -> None:
        """Free the PETSc objects of the stepper, if any."""
        self.stepper.destroy()

    def advance(self, recorder: Recorder, base_states: FloatArray, n_periods: int) -> bool:
        """Compute periods one after the other, and record them; see `Engine`."""
        for _ in range(n_periods):
            record = recorder.open(self.stepper, base_states)
            failure = None
            try:
                n_steps = self.run_period(record, -recorder.limit)
            except ArithmeticError as error:
                failure = error
                n_steps = record.n_collected
            record.damped = self.stepper.damped
            is_bounded = recorder.close(record, self.stepper, n_steps)
            if failure is not None:
                raise failure
            if not is_bounded or n_steps < len(base_states) - 1:
                return False
        return True

    def run_period(self, record: PeriodRecord, floor: float) -> int:
        """Compute the steps of a period and write them into its record.

        Args:
            record: record opened at the present state; it contains the motion of the base.
            floor: gap below which the motion counts as diverged [m].

        Returns:
            Number of computed steps; fewer than the period has if the motion diverged.
        """
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
            stepper.finish_step()
            record.keep(step, stepper)
        return n_steps


def set_initial(engine: Engine, initial: State | None, base_state: FloatArray) -> None:
    """Set the initial state of an engine and compute its accelerations.

    Args:
        engine: the engine.
        initial: state at the start, whose losses are ignored; None: the present state.
        base_state: (q, q', q'') of the base at the start, shape (3,).
    """
    initial = engine.state() if initial is None else initial
    engine.restore(State(initial.motion, initial.pair_state), base_state)
    engine.renew_acceleration()


@contextmanager
def _no_collection() -> Iterator[None]:
    """Pause Python's garbage collector, which took a quarter of the time and finds nothing."""
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_enabled:
            gc.enable()


def simulate(
    engine: Engine,
    recorder: Recorder,
    motion: Callable[[int], FloatArray],
    *,
    stop: Callable[[int], bool] | None = None,
    enough: Callable[[int], bool] | None = None,
    every: int = ASKED_EVERY,
) -> Outcome:
    """Compute all periods that the recorder has not recorded yet.

    Args:
        engine: engine that holds the state and computes the steps.
        recorder: recorder of the run; it defines the number of periods.
        motion: function of the number of a period that returns (q, q', q'') of the base at its
            N + 1 steps, shape (N + 1, 3).
        stop: function that takes the number of finished periods and returns whether to end the
            run; it is asked after each block of periods that the engine computes in one go.
        enough: function of the same number that returns whether the run is long enough, so that it
            is completed without the other periods.
        every: most periods in a block, if `stop` or `enough` are asked between blocks; blocks end
            at its multiples.

    Returns:
        "completed", "diverged" or "interrupted". If the motion diverges within a period, the steps
        before that are recorded.
    """
    if stop is None and enough is None:
        every = recorder.n_periods
    longest = max(1, min(every, engine.steps_at_once // recorder.steps_per_period))
    for base_states, last in _blocks(motion, recorder, longest, every):
        with _no_collection():
            is_bounded = engine.advance(recorder, base_states, last - recorder.n_closed)
        if not is_bounded:
            return "diverged"
        if enough is not None and enough(last):
            return "completed"
        if stop is not None and stop(last) and last < recorder.n_periods:
            return "interrupted"
    return "completed"


def _blocks(
    motion: Callable[[int], FloatArray], recorder: Recorder, longest: int, every: int
) -> Iterator[tuple[FloatArray, int]]:
    """Yield the motion of the base in a block of periods, and the number of periods at its end.

    The periods of a block share one table of the motion of the base.
    """
    first, n_periods = recorder.n_closed, recorder.n_periods
    after = motion(first) if first < n_periods else None
    while after is not None:
        base_states = after
        last = first + 1
        after = None
        end = min(first + longest, every * (first // every + 1))
        while last < n_periods:
            after = motion(last)  # of the period behind the block: the same table, or the next's
            if last == end or after is not base_states:
                break
            last = last + 1
            after = None
        yield base_states, last
        first = last


def initial_state(
    structure: Structure,
    given: Mapping[str, float],
    mode_of: Callable[[int], FloatArray] | None = None,
) -> State | None:
    """Return the state in which each lamina has a given tip motion in its first mode.

    Args:
        structure: the discretised structure; its parts have the names of the laminae.
        given: tip displacements [m] by `LAMINA.displacement`, tip velocities [m/s] by
            `LAMINA.velocity`.
        mode_of: function that gives the first mode of a part by its number, where it is known
            already; default: it is computed.

    Returns:
        The state; None (at rest) if all given numbers are 0.
    """
    if not any(given.values()):
        return None
    motion = np.zeros((3, structure.operators.n_dofs))
    for number, part in enumerate(structure.layout.parts):
        mode = mode_of(number) if mode_of is not None else first_mode(structure, number)
        motion[0] += given.get(f"{part.name}.displacement", 0.0) * mode
        motion[1] += given.get(f"{part.name}.velocity", 0.0) * mode
    return State(motion, np.zeros(structure.operators.n_pairs, dtype=np.bool_))
