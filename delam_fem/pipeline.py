"""Turn a case into a result: assemble the structure, run the time loop, collect the record.

This module only connects other modules and computes nothing itself.
"""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Callable, Collection
from contextlib import nullcontext
from dataclasses import replace
from inspect import signature
from pathlib import Path
from typing import Any, overload

import xarray as xr

from delam_fem.case import plausible
from delam_fem.case.definition import ROUND_OFF, Case
from delam_fem.case.excitation import HarmonicMotion
from delam_fem.case.files import CaseSource, find_case
from delam_fem.contact.laws import (
    COMBINATIONS,
    SCHEMES,
    ContactLaw,
    Law,
    LawName,
    Scheme,
    SchemeName,
    combined_name,
)
from delam_fem.engines.session import (
    EngineName,
    Prescribed,
    Stop,
    available,
    session_of,
    solve,
)
from delam_fem.model import discretise
from delam_fem.model.beams.network import never_opens
from delam_fem.model.layout import Structure
from delam_fem.model.operators import DistributedOperators, Operators
from delam_fem.model.stops_sensors import overlap_at_start
from delam_fem.results import (
    channels,
    contacts,
    dataset,
    diagnostics,
    quality,
    record,
    rest as rest_state,
)
from delam_fem.results.fields import sheets, solids
from delam_fem.results.folder import AS_PROBES, OperatorsResult, ProblemView, Result
from delam_fem.results.overlap import overlap_warnings
from delam_fem.results.pages.html import reporting
from delam_fem.results.schema import solvers
from delam_fem.simulation import checkpoint
from delam_fem.simulation.checkpoint import CHECKPOINT_SECONDS, Watch, stop_signals
from delam_fem.simulation.loop import Outcome, State
from delam_fem.simulation.recorder import N_SIZES, Recorder
from delam_fem.simulation.refinement import Refinement, unforeseen_warning
from delam_fem.system import mpi
from delam_fem.system.errors import CaseError, require
from delam_fem.system.files import claimed, json_ready
from delam_fem.system.mpi import MPI

Progress = Callable[[int, int], None]

_log = logging.getLogger(__name__)
OF_GAPS = ("tip_contacts_per_period", "minimum_tip_gap")
"""Numbers of the gaps at reference probes, which probes of operators do not have."""
REPLACED = "contact.law: in place of the law of the case acted"
"""Beginning of the remark on a run with a law that no key names."""
FAILED = "failed: a step has no solution"
"""Reason of a run that had failed before it was resumed."""


@overload
def run(
    what: CaseSource,
    engine: EngineName = ...,
    *,
    law: ContactLaw | LawName | None = ...,
    scheme: Scheme | SchemeName | None = ...,
    drive: HarmonicMotion | None = ...,
    until: float | None = ...,
    directory: str | Path | None = ...,
    resume: bool = ...,
    extend: int = ...,
    progress: Progress | bool | None = ...,
    structure: Structure | None = ...,
    initial: State | None = ...,
    comm: MPI.Intracomm = ...,
    overwrite: bool = ...,
    checkpoint_seconds: float = ...,
) -> Result: ...


@overload
def run(
    what: Operators | DistributedOperators | Structure,
    engine: EngineName = ...,
    *,
    law: ContactLaw | LawName,
    scheme: Scheme | SchemeName,
    drive: Prescribed | None = ...,
    until: float | None = ...,
    periods: int | None = ...,
    steps_per_period: int | None = ...,
    time_step: float | None = ...,
    refinement: Refinement = ...,
    window_periods: int | None = ...,
    frames_per_period: int = ...,
    limit: float = ...,
    initial: State | None = ...,
    stop: Stop | None = ...,
    comm: MPI.Intracomm | None = ...,
    name: str = ...,
) -> OperatorsResult: ...


def run(what: Any, engine: EngineName = "petsc", **options: Any) -> Result:
    """Compute a case, or operators of your own, and return the result.

    Args:
        what: a case, the name of a preset or the path of a case file; or operators, or a structure,
            from any discretisation.
        engine: name of the engine that computes the steps.
        options: by their names, as follows.

    Options:
        law: the contact law: a name, a `Law`, or a law of your own (`contact.laws.ContactLaw`),
            which needs the engine "petsc". With a case: in place of its own.
        scheme: name of the time integration, or a `Scheme`. With a case: in place of
            its own.
        drive: motion of the base. With a case: a `HarmonicMotion` in place of its own; with
            operators None: the base rests.
        until: time that the run covers at least [s].
        initial: state at t = 0, for example `Result.state` of another run; None: at rest. The run
            computes the accelerations of this state anew.
        comm: communicator whose ranks share the work; every rank returns the result. With the
            engine "compiled" every rank computes the same run. The first rank alone logs.

    With a case also:
        directory: folder for the checkpoint, which `Result.save` removes when all results are on
            the disk; it is made and locked meanwhile. None: no checkpoints.
        resume: whether to continue from the checkpoint in `directory`.
        extend: number of periods by which to extend the completed run of this case in `directory`;
            the case may have any number of periods. The result is that of one run, bit for bit.
        progress: called with the number of finished periods and of all periods, after each period
            or, with the engine "compiled", after blocks of up to ten and 10,000 steps;
            True: a bar, in a notebook as on a terminal.
        structure: the discretised case; None: `discretise.assemble` makes it.
        overwrite: whether the checkpoint of another run in `directory` may be replaced.
        checkpoint_seconds: least time between two checkpoints [s].

    With operators also:
        name: name of the run in the titles of figures and page.
        periods, steps_per_period, time_step, refinement, window_periods, frames_per_period, limit,
            stop: called after each period; True ends the run. None: nothing ends it early.

    Returns:
        The result. `history.attrs["outcome"]` is "completed", "diverged", "interrupted" (Ctrl-C) or
        "failed" (a step has no solution); but for the first the result holds the steps computed so
        far.

    Raises:
        CaseError: the case or the operators cannot be computed, there is no checkpoint to resume
            from, there is one that would be replaced, or another process writes to `directory`.
    """
    if isinstance(what, Structure):
        parts = what.layout.names
        names = tuple(f"{parts[probe.part]} {probe.name}" for probe in what.layout.probes)
        what = replace(what.operators, names=names)
    is_bare = isinstance(what, Operators | DistributedOperators)
    keys = {*signature(_run_case).parameters} - {"case"}
    if is_bare:
        keys = {*signature(_run_operators).parameters, *signature(solve).parameters}
        keys -= {"operators", "length", "motion"}
    if wrong := sorted(options.keys() - keys):
        text = "operators know" if is_bare else "a case has keys for all but"
        raise CaseError(f"run: {', '.join(wrong)}: {text} {', '.join(sorted(keys - {'engine'}))}")
    if is_bare and not {"law", "scheme"} <= options.keys():
        raise CaseError(
            'run: operators: law or scheme is missing; for example law="newton", '
            'scheme="moreau-jean", drive=df.HarmonicMotion(f, amplitude), steps_per_period=1000, '
            "periods=20"
        )
    if is_bare:
        return _run_operators(what, engine, **options)
    with mpi.told_by_first(options.get("comm", MPI.COMM_SELF)):
        return _run_case(what, engine, **options)


def rest(case: CaseSource) -> xr.Dataset:
    """Return the state of rest of a case under its weight and constant loads, as a dataset.

    Args:
        case: a case, the name of a preset or a case file.

    Raises:
        CaseError: nothing acts all the time, or there is no state of rest; see `discretise`.
    """
    found_case = find_case(case)
    return rest_state.dataset_of(discretise.assemble(found_case), found_case)


def _run_case(
    case: CaseSource,
    engine: EngineName,
    *,
    law: ContactLaw | LawName | None = None,
    scheme: Scheme | SchemeName | None = None,
    drive: HarmonicMotion | None = None,
    until: float | None = None,
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
    """Compute a case; see `run`."""
    expected = "a case, the name of a preset, a case file, operators or a structure"
    require(isinstance(case, Case | str | Path), "run", expected, case)
    case, other = _changed(find_case(case), law, scheme, drive, until)
    if other is not None and directory is not None:
        raise CaseError(
            f"run: directory: expected none with the law {other.name!r}, which checkpoints do not "
            "know; Result.save writes the results"
        )
    if other is not None and case.is_massless:
        raise CaseError(
            f'run: law: expected none with time.mass = "massless", given {other.name!r}: contact '
            "points without mass take no impulses"
        )
    engine = available(engine, case)
    plausible.tell(case)
    if case.unread:
        _log.debug("this run ignores keys that are given, but not read: %s", ", ".join(case.unread))
    path = source = None if directory is None else checkpoint.path_in(Path(directory))
    if path is not None and path.exists() and not (resume or overwrite):
        raise CaseError(
            f"{path}: belongs to a run that is not finished; go on with --resume, or replace it "
            "with --overwrite"
        )
    if extend:
        case, source = _extended(case, directory, extend, resume=resume)
    mpi.hold(comm)
    mpi.end_with_any(comm)
    beyond = _beyond_case(structure, initial, other)
    if structure is None:
        sharing = comm if engine == "petsc" else MPI.COMM_SELF
        structure = discretise.assemble(case, comm=sharing)
    told = quality.unresolved_blows(case, structure)
    for text in told:
        _log.warning(text)
    writes = comm.rank == 0 and directory is not None
    claim = claimed(Path(directory or ""), may_hold_results=True) if writes else nullcontext()
    session = session_of(
        case, structure.operators, law=other, initial=initial, engine=engine, comm=comm
    )
    with claim, session as opened:
        recorder = opened.recorder
        identity = checkpoint.identity_of(case, engine, opened.engine, **beyond)
        of_run = identity, opened.engine, recorder
        before: checkpoint.Progress = "running"
        if resume or extend:
            before = checkpoint.load(source, *of_run, opened.motion, of_shorter=bool(extend))
            before = "running" if extend else before
        begin = time.perf_counter()
        first = recorder.n_closed
        decay = quality.decay_of(case, structure) * case.period
        enough = quality.stop_when_settled(case, recorder, len(structure.layout.parts), decay)
        with stop_signals() as is_stopped, reporting(progress, "period") as report:
            stop = Watch(path, of_run, is_stopped, comm, report=report, seconds=checkpoint_seconds)
            if extend:
                stop.save("running")  # from now on the folder says that it is not finished
            if before == "running":
                outcome, reason = opened.run_or_fail(stop, enough)
            else:
                outcome = before
                reason = FAILED if before == "failed" else ""
            if recorder.n_closed == 1 and not recorder.window[-1].n_steps:
                raise CaseError(
                    f"case {case.name}: the first step of {case.time_step:g} s already goes beyond "
                    f"{recorder.limit:g} m, or to no number at all; expected sizes that fit "
                    "together, for example a smaller excitation.amplitude"
                )
            seconds = time.perf_counter() - begin
            if before == "running":
                stop.leave(outcome)
        state = opened.engine.state()
        arrays = checkpoint.arrays_of(*of_run, outcome)
        reading = structure.layout.reading
        if reading is None or reading.comm is None:  # every rank reads all dofs
            recorder.complete(opened.engine.gather)
    mpi.release(comm)
    summary = _summary(engine, outcome, recorder, recorder.n_closed - first, seconds)
    remark = None if other is None else f"{REPLACED} {other.name!r}; case.toml does not say so"
    if reason:
        summary["message"] = reason
    result = _result(case, structure, recorder, state, summary, decay, remark, identity, told=told)
    final = arrays if outcome == "completed" and other is None else None
    return replace(result, final=final, checkpoint=None if outcome == "interrupted" else path)


def _changed(
    case: Case,
    law: ContactLaw | LawName | None,
    scheme: Scheme | SchemeName | None,
    drive: HarmonicMotion | None,
    until: float | None,
) -> tuple[Case, ContactLaw | None]:
    """Return the case with what `run` is given in place of keys, and a law that no key names.

    Figures and numbers take such a law for "newton", or with a spring for "newton-penalty".
    """
    keys: dict[str, Any] = {} if scheme is None else _keys_of(scheme)
    if isinstance(law, str):
        keys["contact.law"] = law
    elif isinstance(law, Law):
        row = COMBINATIONS.get((law.name, keys.get("time.scheme", case.time.scheme)))
        reads = () if row is None else row.reads  # a wrong pair is refused below
        keys |= {"contact.law": law.name, **{f"contact.{key}": getattr(law, key) for key in reads}}
    elif law is not None:
        keys["contact.law"] = "newton-penalty" if law.spring[0] else "newton"
        keys["contact.impulse"] = "consistent" if law.is_coupled else "lumped"
        if law.spring[0]:
            keys["contact.penalty_stiffness"] = law.spring[0]
    if drive is not None:
        if not isinstance(drive, HarmonicMotion):
            raise CaseError(
                f"run: drive: expected a HarmonicMotion with a case, given {drive!r}; "
                "others are sections [excitation] of the case"
            )
        keys |= {"excitation.kind": "harmonic", "excitation.frequency": drive.frequency}
        keys["excitation.amplitude"] = drive.amplitude
    changed = case.with_overrides(keys) if keys else case
    if until is not None:
        require(0.0 < until < math.inf, "until", "a number above 0 [s]", until)
        periods = math.ceil(until / changed.period * (1.0 - ROUND_OFF))
        changed = changed.with_overrides(
            {"time.periods": periods} if changed.is_periodic else {"time.duration": until}
        )
    return changed, None if isinstance(law, Law | str) else law


def _keys_of(scheme: Scheme | SchemeName) -> dict[str, Any]:
    """Return the keys of a case that choose a scheme, with its numbers if it is a `Scheme`."""
    if isinstance(scheme, str):
        return {"time.scheme": scheme}
    numbers = {f"time.{key}": value for key, value in scheme.numbers.items()}
    if not numbers and scheme.courant != SCHEMES[scheme.name].courant:
        raise CaseError(
            f"run: scheme: expected df.SCHEMES[{scheme.name!r}] or "
            f'Scheme("newmark", beta={scheme.beta:g}, gamma={scheme.gamma:g}), given {scheme!r}'
        )
    return {"time.scheme": scheme.name, **numbers}


def _run_operators(
    operators: Operators | DistributedOperators,
    engine: EngineName,
    *,
    law: ContactLaw | LawName,
    scheme: Scheme | SchemeName,
    drive: Prescribed | None = None,
    name: str = "operators",
    **length: Any,
) -> OperatorsResult:
    """Compute operators; see `run`."""
    begin = time.perf_counter()
    solution = solve(operators, law, scheme, drive, engine=engine, **length)
    seconds = time.perf_counter() - begin
    recorder = solution.recorder
    period = recorder.time_step * recorder.steps_per_period
    f = drive.frequency if isinstance(drive, HarmonicMotion) else 0.0
    said = f"{f:.4g} Hz" if f else "driven" if drive is not None else "no drive"
    about = {
        "engine": engine,
        "law": law if isinstance(law, str) else law.name,
        "scheme": scheme if isinstance(scheme, str) else scheme.name,
    }
    case: Any = ProblemView(  # has all that numbers read of a case
        f"{name}: {said}, contact: {combined_name(about['law'], about['scheme'])}",
        recorder.time_step,
        recorder.steps_per_period,
        recorder.n_periods,
        is_periodic=abs(f * period - 1.0) < ROUND_OFF,
    )
    n_balanced = recorder.n_closed - (solution.outcome == "failed")
    n = recorder.strobe.shape[2]
    residual = recorder.energy_residual(n_balanced)
    is_lost = solution.outcome == "completed" and quality.is_lost(
        residual, SCHEMES[scheme] if isinstance(scheme, str) else scheme
    )
    outcome = "diverged" if is_lost else solution.outcome
    names = operators.names or tuple(f"probe {k + 1}" for k in range(n))
    history = dataset.of_probes(recorder, names, {"title": case.title, "outcome": outcome, **about})
    efforts = recorder.effort[: recorder.n_closed]
    steps = int(efforts[:, :N_SIZES].sum())
    summary: dict[str, Any] = {
        "outcome": outcome, **about, "steps": steps, "wall_seconds": seconds,
        "microseconds_per_step": 1e6 * seconds / max(steps, 1),
        "periods": recorder.n_closed, "probes": list(names),
    }  # fmt: skip
    if n:
        numbers = diagnostics.summary(history, case)
        summary |= {
            key.replace("tip_", "probe_"): numbers[key] for key in numbers if key not in OF_GAPS
        }
        decay = quality.decay_of_operators(operators) * period if case.is_periodic else 0.0
        summary |= quality.settling_summary(recorder, n, case, decay)
        summary["judged_by"] = channels.of_references(names) if case.is_periodic else None
    summary["energy_residual"] = residual
    summary["impact_energy_gain"] = diagnostics.gain_of(recorder)
    texts = [
        diagnostics.gain_warning(recorder, may_add=False),
        unforeseen_warning(efforts[:, N_SIZES:]),
        quality.open_balance(residual) if not residual <= quality.CLOSED else None,
    ]
    summary["warnings"] = [text for text in texts if text is not None]
    for text in summary["warnings"]:
        _log.warning(text)
    if is_lost or solution.reason:
        summary["message"] = solution.reason or quality.OPEN
    return OperatorsResult(case, history.rename(AS_PROBES), json_ready(summary), solution.state)


def checked(case: Case, engine: EngineName = "petsc") -> tuple[Structure, list[str]]:
    """Assemble a case and set its engine up as `run` does, but compute no step.

    Returns:
        The structure, and what may be wrong with the numbers of a run.

    Raises:
        CaseError: the case cannot be computed.
    """
    structure = discretise.assemble(case)
    engine = available(engine, case)
    with session_of(case, structure.operators, engine=engine):
        pass
    texts = never_opens(case), overlap_at_start(structure, case)
    warnings = [text for text in texts if text is not None]
    return structure, warnings + quality.quality_warnings(case, structure, residual=0.0)


def _extended(
    case: Case, directory: str | Path | None, periods: int, *, resume: bool
) -> tuple[Case, Path]:
    """Return the case of a longer run, and the file with the final state of the shorter one."""
    if periods < 1 or resume or directory is None or not case.is_periodic:
        raise CaseError(
            "extend: expected a positive number of periods, the directory of a completed run, no "
            f"resume, and an excitation that repeats; given {periods} periods, directory "
            f"{directory}, resume {resume}, an excitation of the kind {case.excitation.kind}"
        )
    path = checkpoint.final_in(Path(directory))
    return case.with_overrides({"time.periods": checkpoint.periods_in(path) + periods}), path


def _beyond_case(
    structure: Structure | None, initial: State | None, law: ContactLaw | None
) -> dict[str, object]:
    """Return what the identity of a run has beside its case: what is given in place of it."""
    additions: dict[str, object] = {} if law is None else {"law": law.name}
    if initial is not None:
        additions["initial"] = initial
    if structure is not None and isinstance(structure.operators, Operators):
        o = structure.operators
        matrices = (o.mass, o.damping, o.stiffness, o.gap_matrix)
        arrays = [part for matrix in matrices for part in (matrix.data, matrix.indices)]
        additions["structure"] = [*arrays, o.gap0]
    return additions


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
    remark: str | None,
    identity: str,
    *,
    told: Collection[str],
) -> Result:
    """Return the result: the dataset of a run with its identity, summary and warnings.

    Warnings that were `told` before the run are not logged again.
    """
    # the period in which a run failed ends with the energies of a step that is not recorded
    n_balanced = recorder.n_closed - (summary["outcome"] == "failed")
    residual = recorder.energy_residual(n_balanced)
    is_lost = summary["outcome"] == "completed" and quality.is_lost(residual, case.time.integration)
    summary["outcome"] = "diverged" if is_lost else summary["outcome"]
    attributes = {
        "outcome": summary["outcome"],
        "engine": summary["engine"],
        "identity": identity,
        **solvers(),
    }
    history = dataset.history(recorder, structure, case, attributes)
    summary |= diagnostics.summary(history, case)
    names = structure.layout.names
    summary |= quality.settling_summary(recorder, len(names), case, decay)
    summary["judged_by"] = channels.of_references(names) if case.is_periodic else None
    if case.is_loaded:
        summary["rest"] = rest_state.summary_of(structure, case)
    summary["contacts"] = contacts.of_run(recorder, structure, case, history)
    summary["channels"] = record.measures(record.of_run(history, case))
    summary |= {
        "intervals": quality.confidence_intervals(history, case, summary),
        "periods": recorder.n_closed,
        "blow_steps": quality.blow_steps(case, structure),
        "energy_residual": residual,
        "impact_energy_gain": diagnostics.gain_of(recorder),
        "unread_keys": list(case.unread),
    }
    texts = [
        remark,
        overlap_at_start(structure, case),
        diagnostics.gain_warning(recorder, may_add=diagnostics.may_add_energy(case)),
        unforeseen_warning(recorder.effort[: recorder.n_closed, N_SIZES:]),
        never_opens(case),
        quality.limit_warning(case, summary),
        quality.alternating_warning(case, history),
        quality.range_warning(case, history),
        quality.released_warning(recorder),
        *quality.quality_warnings(case, structure, residual),
        *overlap_warnings(history, case),
    ]
    warnings = [text for text in texts if text is not None]
    summary["warnings"] = [*plausible.warnings(case), *warnings]  # those of the case are told
    for text in warnings:
        if text not in told:
            _log.warning(text)
    if summary["outcome"] == "diverged":
        summary["message"] = (
            f"{quality.OPEN}; the warnings say why" if is_lost else _divergence(case, history)
        )
    if "message" in summary:
        _log.error(summary["message"])
    solid = None if structure.body is None else solids.collected(structure, recorder, case)
    plate = None if structure.layout.sheets is None else sheets.collected(structure, recorder)
    return Result(case, history, json_ready(summary), state, solid=solid, plate=plate)


def _divergence(case: Case, history: xr.Dataset) -> str:
    """Return a message: when a run diverged, with what energy, and what may help."""
    end = float(history["time"][-1])
    n_periods = history.sizes["period"]
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
