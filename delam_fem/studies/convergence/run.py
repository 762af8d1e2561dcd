"""Compute a ladder: an executor computes the rungs, and a file keeps each finished one.

In Python:

    import delam_fem as df
    from delam_fem.studies.convergence.ladder import Ladder, method
    from delam_fem.studies.convergence.run import run_ladder
    methods = (method("newton@moreau-jean:64"),)
    ladder = Ladder(df.preset("default"), methods, (10, 20, 40), (1000, 2000, 4000))
    found = run_ladder(ladder, "runs/ladder", workers=2)
    found.error(ladder.rungs()[-1])
"""

from __future__ import annotations

import json
import logging
import math
import zlib
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from dataclasses import asdict
from pathlib import Path
from typing import Any

from delam_fem.api import (
    FILE_BYTES,
    STUDY_SECONDS,
    WORKER_BYTES,
    Case,
    CaseError,
    CaseSource,
    Cost,
    EngineName,
    RunContext,
    find_case,
    html,
    json_ready,
    provenance,
    require_same,
    run_cost,
    stop_signals,
    write_json,
    write_text,
)
from delam_fem.studies import executors
from delam_fem.studies.convergence.analysis import Convergence, page, verdict
from delam_fem.studies.convergence.ladder import (
    ELEMENTS,
    LIMIT_STEPS,
    PERIODS,
    POINTS,
    STEPS,
    Ladder,
    MeshChoice,
    PointMesh,
    method,
    refinement_warnings,
    usual_methods,
)
from delam_fem.studies.convergence.rung import RungResult, compute, rung_hours
from delam_fem.studies.convergence.study import Converge

_log = logging.getLogger(__name__)

RESULT = "convergence.json"
"""Name of the file with the results in the folder of a ladder."""
RUNG_BYTES = 3000
"""Bytes of a rung in `convergence.json`."""


def run_ladder(
    ladder: Ladder,
    directory: str | Path,
    executor: executors.ExecutorName = "process",
    *,
    workers: int | None = None,
    resume: bool = False,
    progress: Callable[[int, int], None] | None = None,
) -> Convergence:
    """Compute all rungs of a ladder.

    Each finished rung is written to `convergence.json` in the folder before the progress is
    reported. A rung that fails or diverges also counts as finished.

    Args:
        ladder: the ladder to compute.
        directory: folder of the results; it is made if it does not exist.
        executor: "process" or "serial"; a single worker always computes in this process.
        workers: number of processes; default: one per core.
        resume: whether to continue with the rungs in the folder; the ladder may have more rungs
            than before.
        progress: called with the number of finished rungs and of all rungs.

    Returns:
        The ladder with its results; incomplete if Ctrl-C or SIGTERM stopped it.

    Raises:
        CaseError: the folder contains another ladder, or rungs of this one and `resume` is False.
        OSError: the folder cannot be written.
    """
    path = Path(directory) / RESULT
    convergence = Convergence(ladder, _held(path, ladder, resume))
    path.parent.mkdir(parents=True, exist_ok=True)
    rungs = ladder.rungs()
    missing = [rung for rung in rungs if rung.key not in convergence.results]

    def take_in(futures: set[Future[RungResult]]) -> None:
        convergence.results.update({result.key: result for result in (f.result() for f in futures)})
        _write(path, convergence)
        if progress is not None:
            progress(len(rungs) - sum(r.key not in convergence.results for r in rungs), len(rungs))

    name: executors.ExecutorName = "serial" if workers == 1 else executor
    if ladder.case.is_apart:
        for text in refinement_warnings(ladder.case, (rung.points for rung in rungs)):
            _log.warning(text)
    take_in(set())
    if missing:
        with stop_signals() as is_stopped, executors.pool(name, workers) as pool:
            running: set[Future[RungResult]] = set()
            while (missing or running) and not is_stopped():
                while missing and len(running) < pool.n_workers:
                    running.add(pool.executor.submit(compute, missing.pop(0), ladder.engine))
                done, running = wait(running, return_when=FIRST_COMPLETED)
                take_in(done)
            take_in(wait(running).done)
    return convergence


def converge(
    case: CaseSource,
    directory: str | Path | None = None,
    *,
    laws: Sequence[str] | None = None,
    elements: Sequence[int] = (),
    meshes: Sequence[MeshChoice | str] = (),
    steps: Sequence[int] = (),
    periods: int = PERIODS,
    limit_steps: int = LIMIT_STEPS,
    engine: EngineName = "compiled",
    judged: Sequence[str] = (),
    of: Sequence[str] = (),
    workers: int | None = None,
    resume: bool = False,
    progress: Callable[[int, int], None] | bool | None = None,
) -> Convergence:
    """Refine a case: compute a ladder of runs with all methods side by side.

    Args:
        case: the case to refine; also the name of a preset, or the path of a case file.
        directory: folder of the results; None: runs/NAME-converge.
        laws: methods, as "newton@moreau-jean"; None: five of them, or with elastic stops that of
            the case.
        elements: numbers of elements per lamina, increasing.
        meshes: mesh files, from coarse to fine; with neither: the mesh of the case.
        steps: numbers of steps per period, increasing; none: those of the case.
        periods: number of periods in the statistics.
        limit_steps: steps per period of the rigid limit; 0: no limit.
        engine: name of the engine that computes the steps.
        judged: names of the numbers that the verdict is about, as "amplitude".
        of: channels that the verdict is about, as "tip_thin_velocity" or the name of a sensor;
            "NAME:MEASURE" asks for one of min, max, amplitude, rms, mean. With neither: the
            extremes of the tips.
        workers: number of processes; default: one per core.
        resume: whether to continue with the runs in the folder.
        progress: called with the number of finished runs and of all runs; True: a bar.

    Raises:
        CaseError: the ladder is not valid, or the folder holds another one.
    """
    case = find_case(case)
    directory = directory or Path("runs") / f"{case.name}-converge"
    case_mesh = case.mesh.elements or Path(case.mesh.file or "")  # a case has one of them
    ladder = Ladder(
        case,
        usual_methods(case) if laws is None else tuple(method(text) for text in laws),
        (*elements, *(Path(m) if isinstance(m, str) else m for m in meshes)) or (case_mesh,),
        tuple(steps) or (case.time.steps_per_period,),
        periods,
        limit_steps,
        engine,
        tuple(judged),
        tuple(of),
    )
    with html.reporting(progress, "run") as report:
        return run_ladder(ladder, directory, workers=workers, resume=resume, progress=report)


def ladder_cost(ladder: Ladder, workers: int | None = None) -> Cost:
    """Return the cost of a ladder whose workers share its rungs evenly."""
    rungs = ladder.rungs()
    n_workers = min(workers or executors.n_cores(), len(rungs))
    hours = sum(rung_hours(rung, ladder.engine) for rung in rungs) / n_workers
    hours += STUDY_SECONDS / 3600.0
    memory = max(run_cost(rung.case, ladder.engine).memory for rung in rungs)
    files = FILE_BYTES + RUNG_BYTES * len(rungs)
    return Cost(hours, n_workers * memory, files, (1 + n_workers) * WORKER_BYTES)


def _held(path: Path, ladder: Ladder, resume: bool) -> dict[str, RungResult]:
    """Return the results in a file by key, after a check that they belong to this ladder."""
    if not path.is_file():
        return {}
    results, identity = load_results(path)
    if not resume:
        raise CaseError(
            f"{path.parent}: holds {len(results)} rungs of a ladder; go on with --resume, choose "
            "another folder with -o DIR, or delete it"
        )
    require_same(identity, ladder.identity, path)
    return results


def load_results(path: Path) -> tuple[dict[str, RungResult], str]:
    """Return the results in a file by key, and the identity of their ladder.

    Rungs whose checksum does not fit are left out, to be computed anew.

    Raises:
        CaseError: the file is damaged as a whole, or holds something else.
    """
    try:
        content = json.loads(path.read_bytes().decode("utf-8"))
        entries = content["rungs"]
        identity = str(content["identity"])
        intact = [entry for entry in entries if entry.pop("checksum") == _checksum(entry)]
        results = {result.key: result for result in map(_result, intact)}
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        _log.debug("%s cannot be read", path, exc_info=True)
        raise CaseError(
            f"{path}: expected the results of a ladder; this file is damaged or another one. "
            "Delete it, or choose another folder with -o DIR"
        ) from None
    if len(intact) < len(entries):
        _log.warning("%s: %d damaged rungs are left out", path, len(entries) - len(intact))
    return results, identity


def _checksum(entry: dict[str, object]) -> int:
    """Return a checksum of the values of a rung."""
    return zlib.crc32(json.dumps(entry, sort_keys=True).encode())


def _result(entry: dict[str, object]) -> RungResult:
    """Return the result in an entry of the file."""
    fields: dict[str, Any] = {
        name: math.nan if value is None else value for name, value in entry.items()
    }
    fields["statistics"] = {
        name: tuple(math.nan if x is None else float(x) for x in pair)
        for name, pair in fields["statistics"].items()
    }
    return RungResult(**fields)


def _write(path: Path, found: Convergence) -> None:
    """Write all results to the file, which stays valid at any moment."""
    ready = [json_ready(asdict(result)) for result in found.results.values()]
    write_json(
        path,
        {
            "title": f"convergence of case {found.ladder.case.name}",
            **provenance(),
            "engine": found.ladder.engine,
            "limit_steps": found.ladder.limit_steps,
            "identity": found.ladder.identity,
            "rungs": [entry | {"checksum": _checksum(entry)} for entry in ready],
        },
    )


def _ladder(case: Case, given: Converge) -> Ladder:
    """Return the ladder by options of a user; sizes that are not given follow the direction."""
    if given.elements is not None and given.meshes is not None:
        raise CaseError("converge: expected --elements or --meshes, given both")
    case_mesh = case.mesh.elements or Path(case.mesh.file or "")  # a case has one of them
    meshes: Sequence[int | Path] = given.elements or [p.absolute() for p in given.meshes or ()]
    steps = given.steps
    points = given.points
    is_both = given.direction == "both"
    if not meshes:
        meshes = ELEMENTS if is_both or given.direction == "elements" else (case_mesh,)
    if steps is None:
        is_refined = is_both or given.direction == "steps"
        steps = STEPS if is_refined else (case.time.steps_per_period,)
    if points is None and given.direction == "points":
        points = POINTS
    refined = [PointMesh(mesh, n) for mesh in meshes for n in points or ()]
    methods = tuple(method(text) for text in given.laws or ()) or usual_methods(case)
    return Ladder(
        case, methods, tuple(refined or meshes), steps, given.periods, given.limit_steps,
        given.engine, given.judged or (), given.of or (),
    )  # fmt: skip


def cost(case: Case, given: Converge, workers: int | None) -> tuple[str, Cost]:
    """Return the name and the cost of a ladder."""
    ladder = _ladder(case, given)
    return f"ladder of {len(ladder.rungs())} runs", ladder_cost(ladder, workers)


def refine(case: Case, options: Converge, context: RunContext) -> Convergence:
    """Compute a ladder with options of a user, and write all its tables."""
    convergence = run_ladder(_ladder(case, options), context.folder, **context.sweeping)
    write_text(context.folder / "tables.md", page(convergence, verdict(convergence)))
    return convergence


def remove(folder: Path) -> None:
    """Remove the result of a refinement study."""
    (folder / RESULT).unlink(missing_ok=True)
