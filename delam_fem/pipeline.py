"""Turn a case into a result: assemble the structure, run the time loop, collect the record.

This module only connects other modules and computes nothing itself. `engines.session.solve` runs
operators, a law, a scheme and a motion without any case.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any

import xarray as xr

from delam_fem.case import plausible
from delam_fem.case.definition import Case
from delam_fem.case.files import CaseSource, find_case, save_case
from delam_fem.engines.session import EngineName, Session, available, session_of
from delam_fem.model import discretise
from delam_fem.model.beams.network import never_opens
from delam_fem.model.layout import Structure
from delam_fem.model.operators import Operators
from delam_fem.results import dataset, diagnostics, quality
from delam_fem.results.fields import derived
from delam_fem.results.folder import Result, json_ready
from delam_fem.results.pages.html import reporting
from delam_fem.results.schema import solvers
from delam_fem.simulation import checkpoint
from delam_fem.simulation.checkpoint import CHECKPOINT_SECONDS, Watch, stop_signals
from delam_fem.simulation.loop import Outcome, State
from delam_fem.simulation.recorder import N_SIZES, Recorder
from delam_fem.simulation.refinement import unforeseen_warning
from delam_fem.system import mpi
from delam_fem.system.errors import CaseError
from delam_fem.system.files import claimed
from delam_fem.system.mpi import MPI

Progress = Callable[[int, int], None]

_log = logging.getLogger(__name__)


def run(
    case: CaseSource,
    engine: EngineName = "petsc",
    *,
    directory: str | Path | None = None,
    resume: bool = False,
    extend: int = 0,
    progress: Progress | bool | None = None,
    structure: Structure | None = None,
    initial: State | None = None,
    comm: MPI.Intracomm = MPI.COMM_SELF,
    overwrite: bool = False,
    checkpoint_seconds: float = CHECKPOINT_SECONDS,
) -> Result:
    """Compute a case and return its result.

    Args:
        case: the case to compute; also the name of a preset, or the path of a case file.
        engine: name of the engine that computes the steps.
        directory: folder for the checkpoint, which `Result.save` removes when all results are on
            the disk; it is made and locked meanwhile. None: no checkpoints.
        resume: whether to continue from the checkpoint in `directory`.
        extend: number of periods by which to extend the completed run of this case in `directory`;
            the case may have any number of periods. The result is that of one run, bit for bit.
        progress: called with the number of finished periods and of all periods, after each period
            or, with the engine "compiled", after blocks of up to ten and 10,000 steps;
            True: a bar, in a notebook as on a terminal.
        structure: the discretised case; None: `discretise.assemble` makes it.
        initial: state at t = 0, for example `Result.state` of another run; None: at rest. The run
            computes the accelerations of this state anew.
        comm: communicator whose ranks share the work; every rank returns the result. With the
            engine "compiled" every rank computes the same run.
        overwrite: whether the checkpoint of another run in `directory` may be replaced.
        checkpoint_seconds: least time between two checkpoints [s].

    Returns:
        The result. `history.attrs["outcome"]` is "completed", "diverged" or "interrupted" (Ctrl-C);
        in the last two cases the result holds the steps computed so far.

    Raises:
        CaseError: the case cannot be computed, there is no checkpoint to resume from, there is one
            that would be replaced, or another process is writing to `directory`.
    """
    case = _case(case)
    engine = available(engine, case)
    plausible.tell(case)
    if case.unread:
        _log.debug("this run ignores keys that are given, but not read: %s", ", ".join(case.unread))
    kept = source = _checkpoint_in(directory, may_exist=resume or overwrite)
    if extend:
        case, source = _extended(case, directory, extend, comm, resume=resume)
    mpi.hold(comm)
    mpi.end_with_any(comm)
    structure = discretise.assemble(case, comm=comm) if structure is None else structure
    writes = comm.rank == 0 and directory is not None
    claim = claimed(Path(directory or ""), may_hold_results=True) if writes else nullcontext()
    session = session_of(case, structure.operators, initial=initial, engine=engine, comm=comm)
    with claim, session as opened:
        recorder = opened.recorder
        before: checkpoint.Progress = "running"
        if resume or extend:
            before = _restored(source, case, engine, opened, extend)
        begin, first = time.perf_counter(), recorder.n_closed
        decay, enough = quality.judge_of(case, structure, recorder)
        with stop_signals() as is_stopped, reporting(progress, "period") as shown:
            report, save = _callbacks(case, engine, opened, kept, comm, shown)
            stop = Watch(save, report, is_stopped, comm, checkpoint_seconds)
            outcome = opened.run(stop, enough) if before == "running" else before
            _require_a_step(case, recorder)
            seconds = time.perf_counter() - begin
            if before == "running":
                stop.leave(outcome)
        state = opened.engine.state()
        arrays = _gathered(case, structure, engine, opened, outcome)
    mpi.release(comm)
    summary = _summary(engine, outcome, recorder, recorder.n_closed - first, seconds)
    result = _result(case, structure, recorder, state, summary, decay)
    final = arrays if outcome == "completed" else None
    return replace(result, final=final, checkpoint=None if outcome == "interrupted" else kept)


def _case(given: object) -> Case:
    """Return the case that is meant; refuse what `solve` computes."""
    if isinstance(given, Operators | Structure):
        raise CaseError(
            f"run: expected a case, given {type(given).__name__}; for operators of your own write "
            'df.solve(operators, "newton", "moreau-jean", df.HarmonicMotion(f, amplitude), '
            "steps_per_period=1000, periods=20)"
        )
    if not isinstance(given, Case | str | Path):
        raise CaseError(
            f"run: expected a case, the name of a preset or a case file, given {given!r}"
        )
    return find_case(given)


def _gathered(
    case: Case, structure: Structure, engine: EngineName, opened: Session, outcome: Outcome
) -> dict[str, Any]:
    """Return the arrays of the last checkpoint; complete the frames if the layout numbers dofs."""
    recorder = opened.recorder
    arrays = checkpoint.arrays_of(case, engine, opened.engine, recorder, outcome)
    reading = structure.layout.reading
    if reading is None or reading.comm is None:  # every rank reads all dofs
        recorder.complete(opened.engine.whole)
    return arrays


def _checkpoint_in(directory: str | Path | None, *, may_exist: bool) -> Path | None:
    """Return the path of the checkpoint of a run in a folder; refuse that of another run."""
    kept = None if directory is None else checkpoint.path_in(Path(directory))
    if kept is not None and kept.exists() and not may_exist:
        raise CaseError(
            f"{kept}: belongs to a run that is not finished; go on with --resume, or replace it "
            "with --overwrite"
        )
    return kept


def _restored(
    source: Path | None, case: Case, engine: EngineName, opened: Session, extend: int
) -> checkpoint.Progress:
    """Go on from a checkpoint, or from the final state of a shorter run; return how it ended."""
    into = (engine, opened.engine, opened.recorder, opened.motion)
    ended = checkpoint.load(source, case, *into, of_shorter=bool(extend))
    return "running" if extend else ended


def checked(case: Case, engine: EngineName = "petsc") -> tuple[Structure, list[str]]:
    """Assemble a case and set its engine up as `run` does, but compute no step.

    Returns:
        The structure, and what may be wrong with the numbers of a run.

    Raises:
        CaseError: the case cannot be computed.
    """
    structure, engine = discretise.assemble(case), available(engine, case)
    with session_of(case, structure.operators, engine=engine):
        pass
    opening = never_opens(case)
    warnings = [] if opening is None else [opening]
    return structure, warnings + quality.quality_warnings(case, structure, residual=0.0)


def _extended(
    case: Case, directory: str | Path | None, periods: int, comm: MPI.Intracomm, *, resume: bool
) -> tuple[Case, Path]:
    """Return the case of a longer run, and the file with the final state of the shorter one.

    The folder gets the new case, from which --resume goes on.
    """
    if periods < 1 or resume or directory is None or not case.is_periodic:
        raise CaseError(
            "extend: expected a positive number of periods, the directory of a completed run, no "
            f"resume, and an excitation that repeats; given {periods} periods, directory "
            f"{directory}, resume {resume}, an excitation of the kind {case.excitation.kind}"
        )
    path = checkpoint.final_in(Path(directory))
    longer = case.with_overrides({"time.periods": checkpoint.periods_in(path) + periods})
    if comm.rank == 0:
        save_case(longer, path.parent)
    return longer, path


def _require_a_step(case: Case, recorder: Recorder) -> None:
    """Raise a CaseError if not even the first step of a run stays within bounds."""
    if recorder.n_closed == 1 and not recorder.window[-1].n_steps:
        raise CaseError(
            f"case {case.name}: the first step of {case.time_step:g} s already goes beyond "
            f"{recorder.limit:g} m, or to no number at all; expected sizes that fit together, "
            "for example a smaller excitation.amplitude"
        )


def _callbacks(
    case: Case,
    engine: EngineName,
    opened: Session,
    kept: Path | None,
    comm: MPI.Intracomm,
    progress: Progress | None,
) -> tuple[Callable[[int], None], Callable[[checkpoint.Progress], None] | None]:
    """Return the functions that report a period and save a checkpoint; None: no checkpoints."""
    recorder = opened.recorder

    def report(period: int) -> None:
        if progress is not None:
            progress(period, recorder.n_periods)

    def save(outcome: checkpoint.Progress) -> None:
        assert kept is not None
        checkpoint.save(
            kept, case, engine, opened.engine, recorder, outcome=outcome, writes=comm.rank == 0
        )

    return report, None if kept is None else save


def _summary(
    engine: EngineName, outcome: Outcome, recorder: Recorder, n_new: int, seconds: float
) -> dict[str, Any]:
    """Return outcome, engine, number of steps and times; this call computed `n_new` periods."""
    steps = recorder.effort[: recorder.n_closed, :N_SIZES].sum(axis=1)
    contacts, unforeseen = recorder.effort[: recorder.n_closed, N_SIZES:].sum(axis=0).tolist()
    new = int(steps[len(steps) - n_new :].sum())
    return {
        "outcome": outcome,
        "engine": engine,
        "steps": int(steps.sum()),
        "wall_seconds": seconds,
        "microseconds_per_step": 1e6 * seconds / max(new, 1),
        "unforeseen_contacts": unforeseen / contacts if contacts else 0.0,
    }


def _result(
    case: Case,
    structure: Structure,
    recorder: Recorder,
    state: State,
    summary: dict[str, Any],
    decay: float,
) -> Result:
    """Return the result: the dataset of a run with its summary and warnings."""
    residual = recorder.energy_residual()
    is_lost = summary["outcome"] == "completed" and quality.is_lost(residual)
    summary["outcome"] = "diverged" if is_lost else summary["outcome"]
    attributes = {
        "outcome": summary["outcome"],
        "engine": summary["engine"],
        **solvers(),
    }
    history = dataset.history(recorder, structure, case, attributes)
    summary |= diagnostics.summary(history, case)
    summary |= quality.numbers(recorder, len(structure.layout.parts), case, decay)
    summary["intervals"] = quality.of_run(history, case, summary)
    summary["periods"] = recorder.n_closed
    summary["energy_residual"] = residual
    summary["impact_energy_gain"] = diagnostics.gain_of(recorder)
    summary["unread_keys"] = list(case.unread)
    at_limit = quality.limit_warning(case, summary)
    gain = diagnostics.gain_warning(case, recorder)
    unforeseen = unforeseen_warning(recorder.effort[: recorder.n_closed, N_SIZES:])
    warnings = [
        text for text in (gain, unforeseen, never_opens(case), at_limit) if text is not None
    ]
    warnings += quality.quality_warnings(case, structure, residual)
    summary["warnings"] = [*plausible.warnings(case), *warnings]  # those of the case are told
    for text in warnings:
        _log.warning(text)
    if summary["outcome"] == "diverged":
        summary["message"] = (
            f"{quality.OPEN}; the warnings say why" if is_lost else _divergence(case, history)
        )
        _log.error(summary["message"])
    solid = derived.collected(structure, recorder, case)
    return Result(case, history, json_ready(summary), state, solid=solid)


def _divergence(case: Case, history: xr.Dataset) -> str:
    """Return a message: when a run diverged, with what energy, and what may help."""
    end, n_periods = float(history["time"][-1]), history.sizes["period"]
    energy = float(history["energy_kinetic"][-1] + history["energy_strain"][-1])
    law = case.contact.law
    if law == "none":
        remedy = "a smaller excitation.amplitude: linear beams hold for small displacements only"
    elif diagnostics.may_add_energy(case):
        remedy = diagnostics.REMEDY
    else:
        remedy = "more steps per period, fewer elements or a smaller excitation.amplitude"
    return (
        f"diverged at t = {end:.6g} s (period {n_periods}) with "
        f"{energy:.3g} J in the laminae; try {remedy}"
    )
