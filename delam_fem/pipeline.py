"""From a case to its result: assemble, set the run up, run the loop, collect.

Nothing is computed here. `engines.session.solve` does the same without a case.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import xarray as xr
from mpi4py import MPI
from petsc4py import PETSc

from delam_fem.case.definition import Case
from delam_fem.engines.choose import EngineName
from delam_fem.engines.session import session_of
from delam_fem.model import _dolfinx, beam
from delam_fem.model.layout import Structure
from delam_fem.results import dataset, diagnostics, energy_gain
from delam_fem.results.folder import Result, json_ready
from delam_fem.simulation import checkpoint
from delam_fem.simulation.interrupts import Watch, stop_signals
from delam_fem.simulation.loop import Outcome, State
from delam_fem.simulation.recorder import Recorder

Progress = Callable[[int, int], None]

_log = logging.getLogger(__name__)


def run(
    case: Case,
    engine: EngineName = "petsc",
    *,
    directory: str | Path | None = None,
    resume: bool = False,
    progress: Progress | None = None,
    structure: Structure | None = None,
    initial: State | None = None,
    comm: MPI.Intracomm = MPI.COMM_SELF,
) -> Result:
    """Compute a case.

    Args:
        case: what to compute.
        engine: what computes the steps.
        directory: where checkpoints of a long run are kept; None: nowhere.
        resume: go on from the checkpoint in `directory`.
        progress: called after each period with the periods done and all periods.
        structure: the discretised case, if it is not to be assembled by `beam.assemble`.
        initial: state at t = 0, for example `Result.state` of another run; None: at rest. Its
            accelerations are renewed.
        comm: communicator that shares the work; every rank returns the result. With "compiled"
            every rank computes the same.

    Returns:
        The result; `history.attrs["outcome"]` says whether the run was completed, diverged or was
        interrupted (Ctrl-C), in which case it holds what was computed.

    Raises:
        CaseError: the case cannot be computed as it stands, or there is nothing to resume.
    """
    if case.unread:
        _log.info("given, but not read: %s", ", ".join(case.unread))
    structure = beam.assemble(case, comm=comm) if structure is None else structure
    kept = None if directory is None else checkpoint.path_in(Path(directory))
    with session_of(case, structure.operators, initial=initial, engine=engine, comm=comm) as opened:
        recorder = opened.recorder
        if resume:
            checkpoint.load(kept, case, opened.engine, recorder, opened.motion)
        begin, first = time.perf_counter(), recorder.n_closed
        save = partial(
            checkpoint.save,
            case=case,
            engine=opened.engine,
            recorder=recorder,
            writes=comm.rank == 0,
        )

        def report(period: int) -> None:
            if progress is not None:
                progress(period, recorder.n_periods)

        with stop_signals() as is_stopped:
            stop = Watch(save, kept, report, is_stopped, comm)
            outcome = opened.run(stop)
        seconds = time.perf_counter() - begin
        stop.leave(outcome)
        state = opened.engine.state()
    summary = _summary(engine, outcome, recorder, recorder.n_closed - first, seconds)
    return _result(case, structure, recorder, state, summary)


def _summary(
    engine: EngineName, outcome: Outcome, recorder: Recorder, n_new: int, seconds: float
) -> dict[str, Any]:
    """Return what is known of the computation itself; `n_new` periods were computed now."""
    n_steps, last = recorder.steps_per_period, recorder.window[-1].n_steps
    return {
        "outcome": outcome,
        "engine": engine,
        "steps": (recorder.n_closed - 1) * n_steps + last,
        "wall_seconds": seconds,
        "microseconds_per_step": 1e6 * seconds / max((n_new - 1) * n_steps + last, 1),
    }


def _result(
    case: Case, structure: Structure, recorder: Recorder, state: State, summary: dict[str, Any]
) -> Result:
    """Collect what was computed."""
    attributes = {
        "outcome": summary["outcome"],
        "engine": summary["engine"],
        "dolfinx": _dolfinx.version,
        "petsc": ".".join(str(n) for n in PETSc.Sys.getVersion()),
    }
    history = dataset.history(recorder, structure, case, attributes)
    summary |= diagnostics.summary(history, case)
    summary["energy_residual"] = recorder.energy_residual()
    summary["impact_energy_gain"] = energy_gain.gain_of(recorder)
    summary["unread_keys"] = list(case.unread)
    warning = energy_gain.gain_warning(case, recorder)
    summary["warnings"] = [] if warning is None else [warning]
    if warning is not None:
        _log.warning(warning)
    if summary["outcome"] == "diverged":
        summary["message"] = _divergence(case, history)
        _log.error(summary["message"])
    return Result(case, history, json_ready(summary), state)


def _divergence(case: Case, history: xr.Dataset) -> str:
    """Say when and with what energy a run diverged, and what may help."""
    end, n_periods = float(history["time"][-1]), history.sizes["period"]
    energy = float(history["energy_kinetic"][-1] + history["energy_strain"][-1])
    law = case.contact.law
    if law == "none":
        remedy = "a smaller excitation.amplitude: linear beams know no large displacements"
    elif energy_gain.may_add_energy(case):
        remedy = energy_gain.REMEDY
    else:
        remedy = "more steps per period, fewer elements or a smaller excitation.amplitude"
    return (
        f"diverged at t = {end:.6g} s (period {n_periods}) with "
        f"{energy:.3g} J in the laminae; try {remedy}"
    )
