"""Set up and run a computation: put a problem, an engine and a recorder together.

This is the only place where a run is set up. `solve` needs no case: operators, a law, a scheme and
a motion of the base are enough.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from delam_fem.case.definition import Case
from delam_fem.case.motion.excitation import HarmonicMotion
from delam_fem.case.toml import CaseError
from delam_fem.contact.laws import ContactLaw
from delam_fem.engines.choose import EngineName, engine_of, law_of, scheme_of
from delam_fem.model.operators import Operators
from delam_fem.numerics.schemes import Scheme
from delam_fem.simulation import checkpoint
from delam_fem.simulation.interrupts import Watch, stop_signals
from delam_fem.simulation.loop import ASKED_EVERY, Engine, Outcome, State, set_initial, simulate
from delam_fem.simulation.recorder import Recorder
from delam_fem.simulation.refinement import NOT_REFINED, Refinement
from delam_fem.simulation.setup import (
    BaseStates,
    Prescribed,
    at_rest,
    by_period,
    motion_of,
    span_of,
)
from delam_fem.simulation.solution import Solution
from delam_fem.simulation.span import Span

if TYPE_CHECKING:
    from delam_fem.mpi import MPI

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
        stop: Stop = lambda period: False,
        enough: Stop = lambda period: False,
        every: int = ASKED_EVERY,
    ) -> Outcome:
        """Run from the last closed period to the end; return the outcome.

        Args:
            stop: called after each block of periods; True interrupts the run.
            enough: called after each block of periods; True completes it.
            every: see `simulate`.
        """
        run = partial(simulate, self.engine, self.recorder, self.motion)
        return run(stop=stop, enough=enough, every=every)

    def run_kept(self, folder: Path | None, case: Case, name: str = "compiled") -> Outcome:
        """Run from the checkpoint in a folder, if there is one, to the end, and keep checkpoints.

        Args:
            folder: of the checkpoints of a study; None: none are kept.
            case: the case; a checkpoint of another is left alone.
            name: of the engine, and what else tells this run from others.

        Raises:
            CaseError: the checkpoint is damaged, or of another version.
            KeyboardInterrupt: a signal ended the run; its checkpoint is kept.
        """
        if folder is None:
            return self.run()
        from delam_fem.mpi import MPI

        what = hashlib.sha256(f"{name} {case.to_toml()}".encode()).hexdigest()[:16]
        path, parts = folder / f"{what}.npz", (case, name, self.engine, self.recorder)
        if path.is_file():
            before = checkpoint.load(path, *parts, self.motion)
            if before != "running":
                return before
        with stop_signals() as is_stopped:
            save = partial(checkpoint.save, path, *parts)
            stop = Watch(
                lambda ended: save(outcome=ended), lambda period: None, is_stopped, MPI.COMM_SELF
            )
            outcome = self.run(stop)
            stop.leave(outcome)
        if outcome == "interrupted":
            raise KeyboardInterrupt
        return outcome

    def solution(self, outcome: Outcome) -> Solution:
        """Return the results of the run."""
        return Solution(outcome, self.recorder, self.engine.state())


@contextmanager
def session(
    operators: Operators,
    law: ContactLaw,
    scheme: Scheme,
    motion: BaseStates,
    span: Span,
    *,
    initial: State | None = None,
    engine: EngineName = "compiled",
    comm: MPI.Intracomm | None = None,
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

    Raises:
        CaseError: see `engine_of`.
    """
    computing = engine_of(
        operators, law, scheme, span.time_step, refinement=span.refinement, name=engine, comm=comm
    )
    try:
        set_initial(computing, initial, motion(0)[0])
        recorder = Recorder(operators.base, span, operators.n_probes, operators.n_sensors)
        yield Session(computing, recorder, motion)
    except BaseException:
        if comm is None or comm.size == 1:  # to free what ranks share, all must take part
            computing.destroy()
        raise
    computing.destroy()


@contextmanager
def session_of(
    case: Case,
    operators: Operators,
    *,
    initial: State | None = None,
    engine: EngineName = "compiled",
    comm: MPI.Intracomm | None = None,
) -> Iterator[Session]:
    """Set up the run of a case; see `session`.

    Raises:
        CaseError: see `engine_of`.
    """
    with session(
        operators,
        law_of(case),
        scheme_of(case),
        motion_of(case),
        span_of(case),
        initial=initial,
        engine=engine,
        comm=comm,
    ) as opened:
        yield opened


def solve(
    operators: Operators,
    law: ContactLaw,
    scheme: Scheme,
    motion: Prescribed | None = None,
    *,
    steps_per_period: int,
    periods: int,
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
        operators: the semi-discrete problem, from any discretisation.
        law: the contact law: `Law`, or a law of your own (`contact.laws.ContactLaw`).
        scheme: one of `SCHEMES`, or a `Scheme` with other numbers.
        motion: motion of the base; None: the base does not move.
        steps_per_period: N; a period is any stretch of N steps.
        periods: number of periods to compute.
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
    window = periods if window_periods is None else window_periods
    span = Span(
        _time_step(time_step, motion, steps_per_period),
        steps_per_period,
        periods,
        window,
        frames_per_period,
        limit,
        refinement,
    )
    states = at_rest(span) if motion is None else _states(motion, span)
    with session(
        operators, law, scheme, states, span, initial=initial, engine=engine, comm=comm
    ) as opened:
        outcome = opened.run() if stop is None else opened.run(stop, every=1)
        return opened.solution(outcome)


def _time_step(given: float | None, motion: Prescribed | None, steps_per_period: int) -> float:
    """Return the time step [s]; if it is not given, take it from the motion."""
    if given is not None:
        return given
    if not isinstance(motion, HarmonicMotion):
        raise CaseError(
            "time_step: missing; give time_step, or a harmonic motion of the base, whose frequency "
            "determines it"
        )
    return 1.0 / (steps_per_period * motion.frequency)


def _states(motion: Prescribed, span: Span) -> BaseStates:
    """Return a motion of the base, as one table for all periods if it repeats after each."""
    period = span.steps_per_period * span.time_step
    turns = motion.frequency * period if isinstance(motion, HarmonicMotion) else 0.5
    return by_period(motion, span, is_periodic=abs(turns - round(turns)) < 1e-12 and turns > 0.5)
