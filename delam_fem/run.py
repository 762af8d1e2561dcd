"""From a case to its result: assemble, choose stepper and supervisor, run the loop, collect.

This is where the roles of simulate.py are filled; nothing is computed here.
"""

from __future__ import annotations

import logging
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any, Literal

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from delam_fem import _dolfinx, beam, checkpoint, diagnostics, results, stability
from delam_fem.excitation import base_motion
from delam_fem.model import Model
from delam_fem.moreau import MoreauJean
from delam_fem.newmark import Newmark
from delam_fem.operators import FloatArray, Operators
from delam_fem.parameters import Case, CaseError
from delam_fem.recorder import Recorder
from delam_fem.results import Result
from delam_fem.simulate import Outcome, StepByStep, simulate
from delam_fem.supervisor import (
    Impacts,
    MoreauImpacts,
    NoContact,
    PenaltySprings,
    Supervisor,
)

Engine = Literal["petsc", "compiled"]
Progress = Callable[[int, int], None]

CHECKPOINT_SECONDS = 30.0
"""Time between two checkpoints: little to lose, little to write."""
DIVERGED_LENGTHS = 10.0
"""A gap or displacement of so many lengths of the laminae has no meaning any more."""

_log = logging.getLogger(__name__)


def run(
    case: Case,
    engine: Engine = "petsc",
    *,
    directory: str | Path | None = None,
    resume: bool = False,
    progress: Progress | None = None,
    model: Model | None = None,
    initial: FloatArray | None = None,
    comm: MPI.Intracomm = MPI.COMM_SELF,
) -> Result:
    """Compute a case.

    Args:
        case: what to compute.
        engine: what computes the steps.
        directory: where checkpoints of a long run are kept; None: nowhere.
        resume: go on from the checkpoint in `directory`.
        progress: called after each period with the periods done and all periods.
        model: the discretised case, if it is not to be assembled by `beam.assemble`.
        initial: displacements and velocities of the free dofs at t = 0, shape (2, n) [m, -; m/s,
            1/s]; None: at rest.
        comm: communicator that shares the work; every rank returns the result.

    Returns:
        The result; `history.attrs["outcome"]` says whether the run was completed, diverged or was
        interrupted (Ctrl-C), in which case it holds what was computed.

    Raises:
        CaseError: the case cannot be computed as it stands, or there is nothing to resume.
    """
    if engine != "petsc":
        raise CaseError(f"engine: expected 'petsc', given {engine!r}")
    model = beam.assemble(case, comm=comm) if model is None else model
    stepper, supervisor = _roles(case, model.operators, comm)
    recorder, motion = _recorder(case, model.operators), _motion(case)
    stepper.base_states = motion(0).tolist()
    if initial is not None:
        stepper.restore(np.vstack([initial, np.zeros(model.operators.n_dofs)]))
    stepper.renew_acceleration()
    kept = None if directory is None else checkpoint.path_in(Path(directory))
    if resume:
        if kept is None:
            raise CaseError("resume: expected the directory of the interrupted run, given none")
        checkpoint.load(kept, case, stepper, recorder)
        supervisor.restore(stepper.permanent.copy())
    begin, first = time.perf_counter(), recorder.n_closed
    save = partial(
        checkpoint.save, case=case, stepper=stepper, recorder=recorder, writes=comm.rank == 0
    )

    def report(period: int) -> None:
        if progress is not None:
            progress(period, recorder.n_periods)

    with _stop_signals() as is_stopped:
        stop = _Watch(save, kept, report, is_stopped, comm)
        outcome = simulate(StepByStep(stepper, supervisor), recorder, motion, stop=stop)
    seconds = time.perf_counter() - begin
    stop.leave(outcome)
    stepper.destroy()
    return _result(case, model, recorder, (engine, outcome, seconds, first))


def _roles(
    case: Case, operators: Operators, comm: MPI.Intracomm
) -> tuple[Newmark | MoreauJean, Supervisor]:
    """Return the stepper and the supervisor of a case."""
    contact, n, dt = case.contact, operators.n_pairs, case.time_step
    petsc_comm = PETSc.Comm(comm)
    if contact.law == "moreau":
        moreau = MoreauJean(operators, dt, comm=petsc_comm)
        return moreau, MoreauImpacts(
            moreau.compliance,
            n_pairs=n,
            restitution=contact.restitution,
            resting_velocity=contact.threshold_velocity,
        )
    spring = {
        "newton-penalty": (contact.penalty_stiffness, 0.0),
        "penalty": (contact.penalty_stiffness, contact.penalty_damping),
    }.get(contact.law, (0.0, 0.0))
    beta = 0.25
    if case.time.scheme == "central-difference":
        stability.require_stable(operators, dt, spring[0])
        beta = 0.0
    coupled = contact.impulse == "consistent"
    stepper = Newmark(
        operators, dt, beta=beta, coupled_impulses=coupled, spring=spring, comm=petsc_comm
    )
    if contact.law == "none":
        return stepper, NoContact(n)
    if contact.law == "penalty":
        return stepper, PenaltySprings(n)
    return stepper, Impacts(
        stepper.compliance,
        n_pairs=n,
        restitution=contact.restitution,
        coupled=coupled,
        threshold_velocity=contact.threshold_velocity if contact.law != "newton" else None,
    )


def _recorder(case: Case, operators: Operators) -> Recorder:
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


def _motion(case: Case) -> Callable[[int], FloatArray]:
    """Return the base states of a period by its number, shape (N + 1, 3)."""
    motion, n_steps, dt = base_motion(case), case.time.steps_per_period, case.time_step
    steps = np.arange(n_steps + 1)
    return lambda period: motion.states((period * n_steps + steps) * dt)


@contextmanager
def _stop_signals() -> Iterator[Callable[[], bool]]:
    """Let Ctrl-C and termination end the run after the present period; a second Ctrl-C at once."""
    received: list[int] = []
    if threading.current_thread() is not threading.main_thread():
        yield lambda: False
        return

    def note(number: int, frame: object) -> None:
        if received:
            raise KeyboardInterrupt
        received.append(number)

    before = {number: signal.signal(number, note) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield lambda: bool(received)
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


class _Watch:
    """Asked after each period: shows progress, leaves checkpoints, says whether to stop."""

    def __init__(
        self,
        save: Callable[[Path], None],
        path: Path | None,
        report: Callable[[int], None],
        is_stopped: Callable[[], bool],
        comm: MPI.Intracomm,
    ) -> None:
        self._save, self._path, self._report = save, path, report
        self._is_stopped, self._comm = is_stopped, comm
        self._last = time.monotonic()

    def __call__(self, period: int) -> bool:
        """Return whether the run shall end; all ranks decide alike."""
        self._report(period)
        is_due = time.monotonic() - self._last > CHECKPOINT_SECONDS
        wishes = self._comm.allreduce(2 * is_due + self._is_stopped(), MPI.BOR)
        if self._path is not None and wishes & 2:
            self._save(self._path)
            self._last = time.monotonic()
        return bool(wishes & 1)

    def leave(self, outcome: Outcome) -> None:
        """Leave a checkpoint of an interrupted run, and none of a finished one."""
        if self._path is not None and outcome == "interrupted":
            self._save(self._path)
        elif self._path is not None:
            self._path.unlink(missing_ok=True)


def _result(
    case: Case, model: Model, recorder: Recorder, told: tuple[str, Outcome, float, int]
) -> Result:
    """Collect what was computed."""
    engine, outcome, seconds, first = told
    attributes = {
        "outcome": outcome,
        "engine": engine,
        "dolfinx": _dolfinx.version,
        "petsc": ".".join(str(n) for n in PETSc.Sys.getVersion()),
    }
    history = results.history(recorder, model, case, attributes)
    computed = recorder.n_closed - first
    steps = (computed - 1) * case.time.steps_per_period + recorder.window[-1].n_steps
    summary: dict[str, Any] = {
        "outcome": outcome,
        "engine": engine,
        "steps": (recorder.n_closed - 1) * case.time.steps_per_period + recorder.window[-1].n_steps,
        "wall_seconds": seconds,
        "microseconds_per_step": 1e6 * seconds / max(steps, 1),
        **diagnostics.summary(history, case),
        "energy_residual": recorder.energy_residual(),
    }
    if outcome == "diverged":
        summary["message"] = _divergence(case, history)
        _log.error(summary["message"])
    return Result(case, history, results.json_ready(summary))


def _divergence(case: Case, history: Any) -> str:
    """Say when and with what energy a run diverged, and what may help."""
    energy = float(history.energy_kinetic[-1] + history.energy_strain[-1])
    remedy = "fewer elements or more steps per period"
    if case.contact.impulse == "lumped" and case.time.mass == "consistent":
        remedy = (
            'contact.impulse = "consistent" or time.mass = "lumped": with the consistent mass, '
            "lumped impulses can add energy"
        )
    return (
        f"diverged at t = {float(history.time[-1]):.6g} s (period {history.sizes['period']}) with "
        f"{energy:.3g} J in the laminae; try {remedy}"
    )
