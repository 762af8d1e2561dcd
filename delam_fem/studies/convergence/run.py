"""Compute a refinement study: an executor computes the levels, and a file keeps each finished one.

In Python:

    import delam_fem as df
    from delam_fem.studies.convergence.refinement import RefinementStudy, method
    from delam_fem.studies.convergence.run import run_refinement
    methods = (method("newton@moreau-jean:64"),)
    study = RefinementStudy(df.preset("default"), methods, (10, 20, 40), (1000, 2000, 4000))
    found = run_refinement(study, "runs/refinement", workers=2)
    found.error(study.levels()[-1])
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
    discard,
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
from delam_fem.studies.convergence.level import LevelResult, compute, level_hours
from delam_fem.studies.convergence.refinement import (
    ELEMENTS,
    LIMIT_STEPS,
    PERIODS,
    POINTS,
    STEPS,
    MeshChoice,
    PointMesh,
    RefinementStudy,
    method,
    refinement_warnings,
    usual_methods,
)
from delam_fem.studies.convergence.study import CONVERGE, Converge

_log = logging.getLogger(__name__)

RESULT = "convergence.json"
"""Name of the file with the results in the folder of a study."""
LEVEL_BYTES = 3000
"""Bytes of a level in `convergence.json`."""


def run_refinement(
    refinement: RefinementStudy,
    directory: str | Path,
    executor: executors.ExecutorName = "process",
    *,
    workers: int | None = None,
    resume: bool = False,
    progress: Callable[[int, int], None] | None = None,
) -> Convergence:
    """Compute all levels of a study.

    Each finished level is written to `convergence.json` in the folder before the progress is
    reported. A level that fails or diverges also counts as finished.

    Args:
        refinement: the study to compute.
        directory: folder of the results; it is made if it does not exist.
        executor: "process" or "serial"; a single worker always computes in this process.
        workers: number of processes; default: one per core.
        resume: whether to continue with the levels in the folder; the study may have more levels
            than before.
        progress: called with the number of finished levels and of all levels.

    Returns:
        The study with its results; incomplete if Ctrl-C or SIGTERM stopped it.

    Raises:
        CaseError: the folder contains another study, or levels of this one and `resume` is False;
            or the script that calls has no `if __name__ == "__main__":`.
        OSError: the folder cannot be written.
    """
    executors.leave_if_imported()
    path = Path(directory) / RESULT
    convergence = Convergence(refinement, _held(path, refinement, resume))
    path.parent.mkdir(parents=True, exist_ok=True)
    levels = refinement.levels()
    missing = [level for level in levels if level.key not in convergence.results]

    def take_in(futures: set[Future[LevelResult]]) -> None:
        convergence.results.update({result.key: result for result in (f.result() for f in futures)})
        write_results(path, convergence)
        if progress is not None:
            progress(
                len(levels) - sum(r.key not in convergence.results for r in levels), len(levels)
            )

    name: executors.ExecutorName = "serial" if workers == 1 else executor
    if refinement.case.has_exact_laminae:
        for text in refinement_warnings(refinement.case, (level.points for level in levels)):
            _log.warning(text)
    take_in(set())
    if missing:
        with stop_signals() as is_stopped, executors.pool(name, workers) as pool:
            running: set[Future[LevelResult]] = set()
            while (missing or running) and not is_stopped():
                while missing and len(running) < pool.n_workers:
                    running.add(pool.executor.submit(compute, missing.pop(0), refinement.engine))
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
    """Refine a case: compute a study of runs with all methods side by side.

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
            extremes of the reference probes.
        workers: number of processes; default: one per core.
        resume: whether to continue with the runs in the folder.
        progress: called with the number of finished runs and of all runs; True: a bar.

    Raises:
        CaseError: the study is not valid, or the folder holds another one.
    """
    case = find_case(case)
    CONVERGE.require_fit(case)
    directory = directory or Path("runs") / f"{case.name}-converge"
    case_mesh = case.mesh.elements or Path(case.mesh.file or "")  # a case has one of them
    refinement = RefinementStudy(
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
        return run_refinement(
            refinement, directory, workers=workers, resume=resume, progress=report
        )


def refinement_cost(refinement: RefinementStudy, workers: int | None = None) -> Cost:
    """Return the cost of a study whose workers share its levels evenly."""
    levels = refinement.levels()
    n_workers = min(workers or executors.n_cores(), len(levels))
    hours = sum(level_hours(level, refinement.engine) for level in levels) / n_workers
    hours += STUDY_SECONDS / 3600.0
    memory = max(run_cost(level.case, refinement.engine).memory for level in levels)
    files = FILE_BYTES + LEVEL_BYTES * len(levels)
    return Cost(hours, n_workers * memory, files, (1 + n_workers) * WORKER_BYTES)


def _held(path: Path, refinement: RefinementStudy, resume: bool) -> dict[str, LevelResult]:
    """Return the results in a file by key, after a check that they belong to this study."""
    if not path.is_file():
        return {}
    results, identity = load_results(path)
    if not resume:
        raise CaseError(
            f"{path.parent}: holds {len(results)} levels of a refinement study; go on with "
            "--resume, choose another folder with -o DIR, or delete it"
        )
    require_same(identity, refinement.identity, path)
    return results


def load_results(path: Path) -> tuple[dict[str, LevelResult], str]:
    """Return the results in a file by key, and the identity of their study.

    Levels whose checksum does not fit are left out, to be computed anew.

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
            f"{path}: expected the results of a refinement study; this file is damaged or another "
            "one. Delete it, or choose another folder with -o DIR"
        ) from None
    if len(intact) < len(entries):
        _log.warning("%s: %d damaged levels are left out", path, len(entries) - len(intact))
    return results, identity


def _checksum(entry: dict[str, object]) -> int:
    """Return a checksum of the values of a level."""
    return zlib.crc32(json.dumps(entry, sort_keys=True).encode())


def _result(entry: dict[str, object]) -> LevelResult:
    """Return the result in an entry of the file."""
    fields: dict[str, Any] = {
        name: math.nan if value is None else value for name, value in entry.items()
    }
    fields["statistics"] = {
        name: tuple(math.nan if x is None else float(x) for x in pair)
        for name, pair in fields["statistics"].items()
    }
    return LevelResult(**fields)


def write_results(path: Path, found: Convergence) -> None:
    """Write all results to the file, which stays valid at any moment."""
    ready = [json_ready(asdict(result)) for result in found.results.values()]
    write_json(
        path,
        {
            "title": f"convergence of case {found.refinement.case.name}",
            **provenance(),
            "engine": found.refinement.engine,
            "limit_steps": found.refinement.limit_steps,
            "identity": found.refinement.identity,
            "rungs": [entry | {"checksum": _checksum(entry)} for entry in ready],
        },
    )


def _refinement(case: Case, given: Converge) -> RefinementStudy:
    """Return the study by options of a user; sizes that are not given follow the direction."""
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
    return RefinementStudy(
        case, methods, tuple(refined or meshes), steps, given.periods, given.limit_steps,
        given.engine, given.judged or (), given.of or (),
    )  # fmt: skip


def cost(case: Case, given: Converge, workers: int | None) -> tuple[str, Cost]:
    """Return the name and the cost of a study."""
    refinement = _refinement(case, given)
    name = f"refinement study of {len(refinement.levels())} runs"
    return name, refinement_cost(refinement, workers)


def refine(case: Case, options: Converge, context: RunContext) -> Convergence:
    """Compute a study with options of a user, and write all its tables."""
    convergence = run_refinement(_refinement(case, options), context.folder, **context.sweeping)
    write_text(context.folder / "tables.md", page(convergence, verdict(convergence)))
    return convergence


def remove(folder: Path) -> None:
    """Remove the result of a refinement study."""
    discard(folder / RESULT)
