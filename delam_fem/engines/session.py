"""Set up and run a computation: choose the engine, give it a problem, collect the solution.

This is the only place where a run is set up: its engine, contact law and scheme, its length, and
the motion of its base period by period. `solve` needs no case: operators, a law, a scheme and a
motion of the base are enough.

An engine is imported only when it is chosen, and this module imports neither dolfinx nor PETSc, so
that the workers of a sweep start fast.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property, lru_cache
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Literal, Protocol, cast

import numpy as np

from delam_fem.case.definition import PARTS, ROUND_OFF, Case
from delam_fem.case.excitation import HarmonicMotion, drive, places_of
from delam_fem.case.identity import digest
from delam_fem.contact.laws import (
    SCHEMES,
    ContactLaw,
    Law,
    LawName,
    Scheme,
    SchemeName,
    combination,
)
from delam_fem.model.linear import require_stable
from delam_fem.model.operators import DistributedOperators, Operators
from delam_fem.numerics.types import BoolArray, FloatArray, IntArray
from delam_fem.simulation import checkpoint
from delam_fem.simulation.checkpoint import Watch, stop_signals
from delam_fem.simulation.loop import ASKED_EVERY, Engine, Outcome, State, set_initial, simulate
from delam_fem.simulation.recorder import LEDGER, PeriodRecord, Recorder, energy_round_off
from delam_fem.simulation.refinement import NOT_REFINED, Refinement, Span
from delam_fem.simulation.signals import steps_of
from delam_fem.system.errors import CaseError, require
from delam_fem.system.mpi import require_options_used

if TYPE_CHECKING:
    from delam_fem.system.mpi import MPI

EngineName = Literal["petsc", "compiled", "modal"]
_log = logging.getLogger(__name__)
ENGINES: tuple[EngineName, ...] = ("petsc", "compiled")
"""Engines among which a user chooses; "modal" goes with massless contact points alone."""


def available(name: EngineName, case: Case) -> EngineName:
    """Return the engine of a run: the compiled one where PETSc is not installed, with a warning.

    Modes with massless contact points have an engine of their own.
    """
    if case.is_massless:
        return "modal"
    if name == "petsc" and find_spec("petsc4py") is None:
        _log.warning("PETSc is not installed: the compiled engine computes the steps")
        return "compiled"
    return name


def engine_of(
    operators: Operators | DistributedOperators,
    law: ContactLaw,
    scheme: Scheme,
    time_step: float,
    *,
    refinement: Refinement = NOT_REFINED,
    name: EngineName = "compiled",
    comm: MPI.Intracomm | None = None,
    modes: int | None = None,
) -> Engine:
    """Return the engine that computes the time steps of a problem.

    Args:
        operators: the semi-discrete problem.
        law: the contact law.
        scheme: the time integration.
        time_step: Δt [s].
        refinement: how steps near contact are divided; nothing is divided without contact.
        name: "petsc" computes single steps and accepts every law; "compiled" computes whole
            periods.
        comm: communicator that shares the work of "petsc"; None: this process alone.
        modes: number of modes of each part, whose contact points have no mass; law and scheme then
            say only whether there is contact. None: all dofs.

    Raises:
        CaseError: there is no such engine, the law does not go with the scheme or the engine, or
            the time step exceeds the stability limit.
    """
    is_whole = name == "compiled" or modes is not None
    if is_whole and isinstance(operators, DistributedOperators):
        raise CaseError(f"engine {name}: expected Operators, given DistributedOperators")
    one = cast(Operators, operators)
    if modes is not None:
        from delam_fem.engines.massless import ModalEngine

        is_open = law.name == "none"
        refine = refinement.factor
        return ModalEngine(one, modes, time_step, refine, is_open=is_open)
    require(name in ENGINES, "engine", " or ".join(map(repr, ENGINES)), name)
    if name == "petsc" and find_spec("petsc4py") is None:
        raise CaseError('engine: expected "compiled", as petsc4py is not installed')
    if law.name == "none":
        refinement = NOT_REFINED
    if math.isfinite(scheme.courant):
        stiffness = _stiffness_of(law, scheme, operators)
        require_stable(operators, time_step, stiffness, scheme.courant)
    try:
        if isinstance(law, Law):
            combination(law.name, scheme.name)
        if name == "compiled":
            from delam_fem.engines.compiled.engine import compiled_engine

            engine: Engine = compiled_engine(one, law, scheme, time_step, refinement)
        else:
            comm = comm or initialise_petsc_alone()  # before anything imports PETSc
            from delam_fem.engines.petsc.engine import petsc_engine

            engine = petsc_engine(operators, law, scheme, time_step, refinement, comm)
    except CaseError:
        raise
    except ValueError as error:
        raise CaseError(f"contact law: {error}") from None
    require_options_used()
    return engine


def _stiffness_of(
    law: ContactLaw, scheme: Scheme, operators: Operators | DistributedOperators
) -> float | FloatArray:
    """Return the stiffness of the springs of pairs, or of each, shape (n_pairs,) [N/m]."""
    if operators.pair_numbers is None or not isinstance(law, Law):
        return law.spring[0]
    numbers = law.numbers(scheme, operators.pair_numbers)
    return np.where(numbers.has_springs(operators.n_pairs), numbers.stiffness, 0.0)


def modes_of(case: Case) -> int | None:
    """Return the number of modes of each part that a case is computed with; None: all dofs."""
    return case.n_modes if case.is_massless else None


def scheme_of(case: Case) -> Scheme:
    """Return the time integration of a case."""
    return case.time.integration


def initialise_petsc_alone() -> MPI.Intracomm:
    """Initialise PETSc for this process alone, and return its communicator.

    By default PETSc initialises with all ranks together. The worker of a sweep would then wait for
    the other ranks forever.
    """
    from delam_fem.system.mpi import MPI, start_petsc

    start_petsc(MPI.COMM_SELF)
    return MPI.COMM_SELF


DIVERGED = 10.0
"""Gap or displacement, in sizes of a case, beyond which a motion has no meaning any more."""
SAMPLES = 2001
"""Instants at which the course of a drive is looked at for its largest values."""


class Prescribed(Protocol):
    """A prescribed motion of the base: the part of its interface that a run needs."""

    def states(self, times: FloatArray) -> FloatArray:
        """Return (q, q', q'') [m, m/s, m/s2], shape (k, 3), at `times` of shape (k,) [s]."""


BaseStates = Callable[[int], FloatArray]
"""Function of the number of a period: (q, q', q'') of the base, then of each further force, at its
N + 1 steps, shape (N + 1, 3 + 3 n_forces)."""


def span_of(case: Case) -> Span:
    """Return the span of a case: the length of its run, and what the run records."""
    return Span(
        case.time_step,
        case.steps_per_period,
        case.n_periods,
        case.n_window_periods,
        case.frames_per_period,
        DIVERGED * _size_of(case),
        Refinement(case.time.refine, case.time.refine_velocity),
    )


def _size_of(case: Case) -> float:
    """Return the size of the motion that a case describes [m].

    What is held moves by a fraction of its length. What floats, and points, which have no length,
    go as far as the start, the base or the force can take them in the time of the run.
    """
    lengths = [lamina.length for lamina in case.lamina if not lamina.is_point]
    if lengths and not case.is_floating:
        return lengths[0]
    duration = case.n_periods * case.period
    times = np.linspace(0.0, case.period if case.is_periodic else duration, SAMPLES)
    largest = np.abs(drive(case.excitation).states(times)).max(axis=0)
    speed = sum(abs(start.velocity) for start in case.initial)
    speed += sum(impactor.velocity for impactor in case.impactor)
    reach = sum(abs(start.displacement) for start in case.initial)
    masses = [
        lamina.mass or lamina.uniform.mass_per_length * lamina.length for lamina in case.lamina
    ]
    for number, (one, *_) in enumerate(places_of(case.excitation)):
        value, rate = largest[3 * number : 3 * number + 2].tolist()
        if one.acts_on == "force":
            reach += 0.5 * value / min(masses) * duration**2
        else:
            reach += value
            speed += rate
    gaps = [*(stop.gap for stop in case.stop), *(impactor.gap for impactor in case.impactor)]
    if case.gap is not None:
        gaps += [case.gap.tip or 0.0, case.gap.root or 0.0]
    return max(*lengths, *gaps, reach + speed * duration, 0.0) or math.inf


def motion_of(case: Case) -> BaseStates:
    """Return the drive of a case (motion of the base, or force) as a function of the period."""
    return _motion(case, span_of(case))


def _motion(case: Case, span: Span) -> BaseStates:
    """Return the drive of a case with its span as a function of the period."""
    return by_period(drive(case.excitation), span, is_periodic=case.is_periodic)


def by_period(motion: Prescribed, span: Span, *, is_periodic: bool) -> BaseStates:
    """Return a base motion as a function of the period.

    Args:
        motion: the motion of the base.
        span: time step and number of steps of a period.
        is_periodic: whether the motion repeats after each period; then all periods share one
            read-only table.
    """
    n_steps, dt = span.steps_per_period, span.time_step
    if is_periodic:
        if isinstance(motion, HarmonicMotion):
            table = _harmonic_table(motion, dt, n_steps)
        else:
            table = _table(motion, dt, n_steps)
        return lambda period: table
    steps = np.arange(n_steps + 1)
    return lambda period: motion.states((period * n_steps + steps) * dt)


def _table(motion: Prescribed, time_step: float, n_steps: int) -> FloatArray:
    """Return the read-only table of a motion that repeats after so many steps."""
    table = motion.states(np.arange(n_steps + 1) * time_step)
    table[-1] = table[0]  # both differ by round-off only
    table.flags.writeable = False
    return table


@lru_cache(maxsize=2)
def _harmonic_table(motion: HarmonicMotion, time_step: float, n_steps: int) -> FloatArray:
    """Return the table of a harmonic motion; points of a sweep mostly share it."""
    return _table(motion, time_step, n_steps)


def at_rest(span: Span, n_forces: int = 0) -> BaseStates:
    """Return the motion of a base at rest, and forces of 0, as a function of the period."""
    table = np.zeros((span.steps_per_period + 1, 3 + 3 * n_forces))
    table.flags.writeable = False
    return lambda period: table


@dataclass(frozen=True)
class ImpactTable:
    """Impulses on pairs, one row per impulse, in the order of time.

    Attributes:
        time: end of the step of each impulse, shape (k,) [s].
        pair: number of the contact pair, shape (k,).
        impulse: impulse on the pair; positive pushes the pair apart, shape (k,) [N s].
        rate_pre: gap rate before the impulse, shape (k,) [m/s].
    """

    time: FloatArray
    pair: IntArray
    impulse: FloatArray
    rate_pre: FloatArray


@dataclass(frozen=True)
class Solution:
    """The result of a run of operators; times count from the start of the window.

    Attributes:
        outcome: "completed", "diverged", "interrupted" or "failed".
        recorder: recorder of the run.
        state: state at the end; another run may start from it.
        reason: why the run failed; empty if it did not.
    """

    outcome: Outcome
    recorder: Recorder
    state: State
    reason: str = ""

    @property
    def records(self) -> list[PeriodRecord]:
        """Records of the periods of the window."""
        return list(self.recorder.window)

    @property
    def time(self) -> FloatArray:
        """Times of all steps of the window, its start included, shape (k,) [s]."""
        n_steps = sum(record.n_steps for record in self.records)
        return np.asarray(self.recorder.time_step * np.arange(n_steps + 1))

    @cached_property
    def displacement(self) -> FloatArray:
        """Displacements of the probes at the times `time`, shape (k, n_probes) [m]."""
        if not self.recorder.strobe.shape[2]:
            raise CaseError(
                "operators: probes: missing, so no displacement is recorded; give Operators(…, "
                "probes=P), P of shape (n_probes, n_dofs)"
            )
        return steps_of(self.recorder)[0][:, : self.recorder.strobe.shape[2]]

    @cached_property
    def velocity(self) -> FloatArray:
        """Velocities of the probes at the times `time`, shape (k, n_probes) [m/s]."""
        return steps_of(self.recorder)[1][:, : self.recorder.strobe.shape[2]]

    @property
    def frames(self) -> FloatArray:
        """(u, v) of all dofs at the frames of the window, shape (n_frames, 2, n)."""
        return np.array([frame for record in self.records for frame in record.frames])

    @cached_property
    def impacts(self) -> ImpactTable:
        """All impacts of the window."""
        table = self.recorder.impacts()
        recorder = self.recorder
        instants = np.repeat(table.ticks / recorder.refine * recorder.time_step, table.sizes)
        return ImpactTable(instants, table.hit, table.impulses, table.rate_pre)

    @property
    def energy(self) -> dict[str, FloatArray]:
        """Columns of the energy ledger by name, each of shape (n_periods,) [J]."""
        return dict(zip(LEDGER, self.recorder.ledger[: self.recorder.n_closed].T, strict=True))


Stop = Callable[[int], bool]
"""Function of the number of completed periods, called now and then; True ends the run."""


@dataclass(frozen=True)
class Session:
    """A run that is ready to start.

    Attributes:
        engine: holds the state and computes the steps.
        recorder: keeps the quantities that the span asks for.
        motion: motion of the base, period by period.
    """

    engine: Engine
    recorder: Recorder
    motion: BaseStates

    def run(
        self,
        stop: Stop | None = None,
        enough: Stop | None = None,
        every: int = ASKED_EVERY,
    ) -> Outcome:
        """Run from the last closed period to the end; return the outcome.

        Args:
            stop: called after each block of periods; True interrupts the run.
            enough: called after each block of periods; True completes it.
            every: most periods in a block, if `stop` or `enough` are asked between blocks; blocks
                end at its multiples.
        """
        return simulate(
            *(self.engine, self.recorder, self.motion), stop=stop, enough=enough, every=every
        )

    def run_or_fail(
        self, stop: Stop | None = None, enough: Stop | None = None, every: int = ASKED_EVERY
    ) -> tuple[Outcome, str]:
        """Run as `run` does; return the outcome, and why the run failed if a step has no solution.

        Raises:
            CaseError: not a single step has a solution.
        """
        try:
            return self.run(stop, enough, every), ""
        except ArithmeticError as error:
            _log.debug("the run failed here", exc_info=True)
            recorder = self.recorder
            n_steps = recorder.window[-1].n_steps if recorder.n_closed else 0
            n_steps += (recorder.n_closed - 1) * recorder.steps_per_period
            if n_steps <= 0:
                raise CaseError(f"run: no step has a solution: {error}") from None
            return "failed", f"failed after t = {n_steps * recorder.time_step:.6g} s: {error}"

    def run_with_checkpoints(self, folder: Path | None, case: Case, **question: object) -> Outcome:
        """Run from the checkpoint in a folder, if there is one, to the end, and keep checkpoints.

        Args:
            folder: folder of the checkpoints of a study; None: none are kept.
            case: the case; a checkpoint of another case is left alone.
            **question: what tells this run from others of the case; see `identity`.

        Raises:
            CaseError: the checkpoint is damaged, or of another version.
            KeyboardInterrupt: a signal ended the run; its checkpoint is kept.
        """
        if folder is None:
            return self.run()
        from delam_fem.system.mpi import MPI

        run = checkpoint.identity_of(case, "compiled", self.engine, **question)
        path = folder / f"{digest(run)}.npz"
        if path.is_file():
            before = checkpoint.load(path, run, self.engine, self.recorder, self.motion)
            if before != "running":
                return before
        with stop_signals() as is_stopped:
            stop = Watch(path, (run, self.engine, self.recorder), is_stopped, MPI.COMM_SELF)
            outcome = self.run(stop)
            stop.leave(outcome)
        if outcome == "interrupted":
            raise KeyboardInterrupt
        return outcome

    def solution(self, outcome: Outcome, reason: str = "") -> Solution:
        """Return the results of the run."""
        return Solution(outcome, self.recorder, self.engine.state(), reason)


@contextmanager
def session(
    operators: Operators | DistributedOperators,
    law: ContactLaw,
    scheme: Scheme,
    motion: BaseStates,
    span: Span,
    *,
    initial: State | None = None,
    engine: EngineName = "compiled",
    comm: MPI.Intracomm | None = None,
    modes: int | None = None,
) -> Iterator[Session]:
    """Set up a run, and free its engine at the end of the context.

    Args:
        operators: the semi-discrete problem.
        law: the contact law.
        scheme: the time integration.
        motion: motion of the base, period by period.
        span: length of the run, and what is kept.
        initial: state at the start; its accelerations are computed anew. None: at rest.
        engine: name of the engine that computes the steps.
        comm: communicator that shares the work of "petsc"; None: this process alone.
        modes: number of modes of each part, whose contact points have no mass; law and scheme then
            say only whether there is contact. None: all dofs.

    Raises:
        CaseError: the initial state has another shape; see also `engine_of`.
    """
    if initial is not None:
        for name, shape in (("motion", (3, operators.n_dofs)), ("resting", (operators.n_pairs,))):
            actual_shape = getattr(initial, name).shape
            require(actual_shape == shape, f"initial.{name}", f"the shape {shape}", actual_shape)
    columns = 3 + 3 * operators.n_forces
    require(motion(0).shape[1] == columns, "motion", f"{columns} columns", motion(0).shape[1])
    computing = engine_of(
        operators, law, scheme, span.time_step, refinement=span.refinement, name=engine, comm=comm,
        modes=modes,
    )  # fmt: skip
    if initial is None:
        has_springs: BoolArray | bool = law.spring[0] > 0.0
        if operators.pair_numbers is not None:
            has_springs = operators.pair_numbers.is_elastic | has_springs
        initial = start_of(operators, motion(0)[0], has_springs=has_springs)
    try:
        set_initial(computing, initial, motion(0)[0])
        recorder = Recorder(
            operators.base,
            span,
            operators.n_probes,
            operators.n_sensors,
            round_off=energy_round_off(operators),
            forces_shift=operators.forces_shift,
        )
        yield Session(computing, recorder, motion)
    except BaseException:
        if comm is None or comm.size == 1:  # to free what ranks share, all must take part
            computing.destroy()
        raise
    computing.destroy()


def start_of(
    operators: Operators | DistributedOperators,
    base_state: FloatArray,
    *,
    has_springs: BoolArray | bool = False,
) -> State | None:
    """Return the state with which a run begins that gets no other; None: all dofs at rest.

    The call is collective.

    Args:
        operators: the semi-discrete problem.
        base_state: (q, q', q'') of the base at the start, shape (3,).
        has_springs: whether pairs that are pressed together at rest carry springs, all of them or
            each, shape (n_pairs,).
    """
    start = operators.start
    shift = operators.base.shift
    if start is None and shift is None:
        return None
    motion = np.zeros((3, operators.n_own))
    if start is not None:
        motion[:2] = start
    if shift is not None:
        motion[:2] -= np.outer(base_state[:2], shift)
    resting = np.zeros(operators.n_pairs, dtype=np.bool_)
    equilibrium = operators.equilibrium
    if equilibrium is not None:
        gap = operators.total(operators.gap_matrix @ motion[0]) + operators.gap0
        resting = has_springs & (equilibrium.force > 0.0) & (gap <= 0.0)
    if isinstance(operators, DistributedOperators):
        motion = operators.of_all(motion)
    return State(motion, resting)


@contextmanager
def session_of(
    case: Case,
    operators: Operators,
    *,
    law: ContactLaw | None = None,
    initial: State | None = None,
    engine: EngineName = "compiled",
    comm: MPI.Intracomm | None = None,
) -> Iterator[Session]:
    """Set up the run of a case, with a law in place of its own if one is given; see `session`.

    Raises:
        CaseError: there is no such engine, the law does not go with the scheme or the engine, or
            the time step exceeds the stability limit.
    """
    span = span_of(case)
    with session(
        operators,
        case.contact_law if law is None else law,
        scheme_of(case),
        _motion(case, span),
        span,
        initial=initial,
        engine=engine,
        comm=comm,
        modes=modes_of(case),
    ) as opened:
        yield opened


def solve(
    operators: Operators | DistributedOperators,
    law: ContactLaw | LawName,
    scheme: Scheme | SchemeName,
    motion: Prescribed | None = None,
    *,
    steps_per_period: int | None = None,
    periods: int | None = None,
    until: float | None = None,
    refinement: Refinement = NOT_REFINED,
    time_step: float | None = None,
    window_periods: int | None = None,
    frames_per_period: int = 0,
    limit: float = float("inf"),
    initial: State | None = None,
    engine: EngineName = "petsc",
    stop: Stop | None = None,
    comm: MPI.Intracomm | None = None,
) -> Solution:
    """Integrate M a + C v + K u = f(t) + Hᵀ λ with contact on the gaps H u + g0.

    Args:
        operators: the semi-discrete problem, from any discretisation; `DistributedOperators` are
            computed by the ranks that share them, with "petsc".
        law: the contact law: `Law` or the name of one, or a law of your own
            (`contact.laws.ContactLaw`).
        scheme: one of `SCHEMES` or its name, or a `Scheme` with other numbers.
        motion: motion of the base; None: the base does not move.
        steps_per_period: N; a period is any stretch of N steps. None: with `until` and `time_step`,
            a hundredth of the run.
        periods: number of periods to compute; None: as many as `until` needs.
        until: time that the run covers at least [s], instead of `periods`.
        refinement: how steps near contact are divided.
        time_step: Δt [s]; None: 1/(N f) of a harmonic motion.
        window_periods: number of last periods that are recorded at every step; None: all.
        frames_per_period: number of states of all dofs kept per period of the window.
        limit: gap or displacement beyond which a motion counts as diverged [m].
        initial: state at the start; None: at rest.
        engine: "petsc" or "compiled"; a law of your own needs "petsc".
        stop: called after each period; True ends the run. None: nothing ends it early.
        comm: communicator that shares the work of "petsc"; None: this process alone.

    Returns:
        Histories of the probes, impacts, energies and the state at the end.

    Raises:
        CaseError: the law does not go with the scheme or the engine, or the time step is missing or
            exceeds the stability limit.
    """
    law = Law(law) if isinstance(law, str) else law
    if isinstance(operators, DistributedOperators):
        comm = operators.comm
    if isinstance(scheme, str):
        require(scheme in SCHEMES, "scheme", f"one of {', '.join(SCHEMES)}", scheme)
        scheme = SCHEMES[scheme]
    dt, n_steps, periods = _length(time_step, motion, steps_per_period, periods, until)
    span = Span(
        dt,
        n_steps,
        periods,
        periods if window_periods is None else window_periods,
        frames_per_period,
        limit,
        refinement,
    )
    states = at_rest(span, operators.n_forces) if motion is None else _states(motion, span)
    with session(
        operators, law, scheme, states, span, initial=initial, engine=engine, comm=comm
    ) as opened:
        every = ASKED_EVERY if stop is None else 1
        return opened.solution(*opened.run_or_fail(stop, every=every))


def _length(
    time_step: float | None,
    motion: Prescribed | None,
    n_steps: int | None,
    periods: int | None,
    until: float | None,
) -> tuple[float, int, int]:
    """Return the time step [s], the steps of a period and the periods of a run."""
    if (periods is None) == (until is None):
        raise CaseError("solve: expected either periods or until [s]; given both or none")
    if until is not None:
        require(0.0 < until < math.inf, "until", "a number above 0 [s]", until)
    if n_steps is None and until is not None and time_step:
        n_steps = math.ceil(until / (PARTS * time_step) * (1.0 - ROUND_OFF))
    if n_steps is None:
        raise CaseError("steps_per_period: missing; give it, or until and time_step [s]")
    if time_step is None:
        if not isinstance(motion, HarmonicMotion):
            raise CaseError(
                "time_step: missing; give time_step, or a harmonic motion of the base, whose "
                "frequency determines it"
            )
        time_step = 1.0 / (n_steps * motion.frequency)
    if periods is None and until is not None:
        periods = math.ceil(until / (n_steps * time_step) * (1.0 - ROUND_OFF))
    return time_step, n_steps, periods or 0


def _states(motion: Prescribed, span: Span) -> BaseStates:
    """Return a motion of the base, as one table for all periods if it repeats after each."""
    period = span.steps_per_period * span.time_step
    turns = motion.frequency * period if isinstance(motion, HarmonicMotion) else 0.5
    return by_period(motion, span, is_periodic=abs(turns - round(turns)) < 1e-12 and turns > 0.5)
