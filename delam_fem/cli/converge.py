"""Define `delam-fem converge` and `compare`: a case refined, or beside other models of it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from delam_fem.cli.console import INTERRUPTED, error_console, fail, reported, say_files, table, tell
from delam_fem.cli.inputs import (
    CaseArgument,
    DryRun,
    Folder,
    Overrides,
    Overwrite,
    Quiet,
    Workers,
    Yes,
    case_of,
    inputs_of,
)

if TYPE_CHECKING:
    from delam_fem.case.definition import Case
    from delam_fem.studies.convergence.analysis import Convergence
    from delam_fem.studies.convergence.ladder import Ladder, MeshChoice, Method

Direction = Annotated[
    Literal["elements", "points", "steps", "both"],
    typer.Option(
        "--in",
        help="What to refine; points: contact points inside the elements; both: every mesh with "
        "every number of steps.",
    ),
]
Laws = Annotated[
    str | None,
    typer.Option(
        metavar="LAW,…",
        help="Contact laws with their schemes, e.g. newton@moreau-jean, maybe with "
        "/lumped or /consistent (default: five of them).",
    ),
]
Elements = Annotated[
    str | None, typer.Option(metavar="N,…", help="Elements per lamina (default: 5,10,…,160).")
]
Points = Annotated[
    str | None, typer.Option(metavar="P,…", help="Contact points per element (default: 1,2,4,8).")
]
MeshFiles = Annotated[
    str | None, typer.Option(metavar="FILE,…", help="Mesh files instead of elements, coarse first.")
]
Steps = Annotated[
    str | None, typer.Option(metavar="N,…", help="Steps per period (default: 250,500,…,16000).")
]
Periods = Annotated[
    int | None, typer.Option(min=1, help="Periods in the statistics (default: 60).")
]
LimitSteps = Annotated[
    int | None,
    typer.Option(min=0, help="Steps per period of the limit (default: 64000); 0: no limit."),
]
EngineOption = Annotated[
    Literal["petsc", "compiled"], typer.Option(help="Engine that computes the steps.")
]
Resume = Annotated[
    bool, typer.Option("--resume", help="Continue an interrupted ladder, or extend a finished one.")
]


def converge_command(
    case_name: CaseArgument,
    output: Folder = None,
    overrides: Overrides = None,
    *,
    direction: Direction = "steps",
    laws: Laws = None,
    elements: Elements = None,
    meshes: MeshFiles = None,
    points: Points = None,
    steps: Steps = None,
    periods: Periods = None,
    limit_steps: LimitSteps = None,
    engine: EngineOption = "compiled",
    workers: Workers = None,
    resume: Resume = False,
    overwrite: Overwrite = False,
    dry_run: DryRun = False,
    yes: Yes = False,
    quiet: Quiet = False,
) -> None:
    """Refine a case, and show to which limit, how fast and at what cost each method converges."""
    with reported(quiet):
        from delam_fem.studies.convergence.ladder import LIMIT_STEPS, PERIODS, Ladder
        from delam_fem.studies.convergence.run import RESULT
        from delam_fem.system.files import claimed

        case = case_of(case_name, overrides)
        ladder = Ladder(
            case,
            _methods(laws),
            _with_points(_meshes(case, direction, elements, meshes), direction, points),
            _steps(case, direction, steps),
            PERIODS if periods is None else periods,
            LIMIT_STEPS if limit_steps is None else limit_steps,
            engine,
        )
        directory = output or Path("runs") / f"{case.name}-converge"
        needed = _affordable(ladder, workers, yes, directory)
        may_hold = resume or overwrite
        with claimed(directory, inputs=inputs_of(case), may_hold_results=may_hold):
            if dry_run:
                table(f"ladder of case {case.name}", ("", ""), needed)
                return
            if overwrite:
                (directory / RESULT).unlink(missing_ok=True)
            _tell(_computed(ladder, directory, workers, resume, quiet), directory, quiet)


def _computed(
    ladder: Ladder, directory: Path, workers: int | None, resume: bool, quiet: bool
) -> Convergence:
    """Compute a ladder and show the progress."""
    from delam_fem.cli.progress import progress
    from delam_fem.studies.convergence.run import run_ladder

    with progress(error_console(quiet)) as report:
        return run_ladder(ladder, directory, workers=workers, resume=resume, progress=report)


def _affordable(
    ladder: Ladder, workers: int | None, yes: bool, folder: Path
) -> list[tuple[str, str]]:
    """Return rows that say what a ladder needs.

    Raises:
        CaseError: that is much, and not confirmed.
    """
    from delam_fem.engines.cost import require_affordable
    from delam_fem.studies.convergence.run import ladder_cost

    cost, n_rungs = ladder_cost(ladder, workers), len(ladder.rungs())
    require_affordable(cost, f"ladder of {n_rungs} runs", is_confirmed=yes, folder=folder)
    return [("runs", str(n_rungs)), ("needs", str(cost))]


def _methods(laws: str | None) -> tuple[Method, ...]:
    """Return the methods of the ladder, by default one for each law."""
    from delam_fem.studies.convergence.ladder import METHODS, method

    names = METHODS if laws is None else laws.split(",")
    return tuple(method(name.strip()) for name in names)


def _meshes(
    case: Case, direction: str, elements: str | None, files: str | None
) -> tuple[int | Path, ...]:
    """Return the meshes of the ladder."""
    from delam_fem.studies.convergence.ladder import ELEMENTS, whole_numbers
    from delam_fem.system.errors import CaseError

    if elements is not None and files is not None:
        raise CaseError("converge: expected --elements or --meshes, given both")
    if files is not None:
        return tuple(Path(name.strip()).absolute() for name in files.split(","))
    if elements is not None:
        return whole_numbers(elements, "elements")
    if direction in ("elements", "both"):
        return ELEMENTS
    mesh = case.mesh.elements if case.mesh.file is None else case.mesh.file
    assert mesh is not None  # a case has either elements or a mesh file
    return (mesh,)


def _with_points(
    meshes: tuple[int | Path, ...], direction: str, points: str | None
) -> tuple[MeshChoice, ...]:
    """Return the meshes with contact points inside their elements, if these are asked for."""
    from delam_fem.studies.convergence.ladder import POINTS, PointMesh, whole_numbers

    if points is None and direction != "points":
        return meshes
    counts = POINTS if points is None else whole_numbers(points, "points")
    return tuple(PointMesh(mesh, n) for mesh in meshes for n in counts)


def _steps(case: Case, direction: str, steps: str | None) -> tuple[int, ...]:
    """Return the numbers of steps per period of the ladder."""
    from delam_fem.studies.convergence.ladder import STEPS, whole_numbers

    if steps is not None:
        return whole_numbers(steps, "steps")
    return STEPS if direction in ("steps", "both") else (case.time.steps_per_period,)


def _tell(found: Convergence, directory: Path, quiet: bool) -> None:
    """Write tables and figures, show the short tables, and fail if the ladder is incomplete."""
    from delam_fem.studies.convergence.analysis import NO_LIMIT, overview, page, verdict
    from delam_fem.studies.convergence.report import save_figures, write_page
    from delam_fem.studies.convergence.run import RESULT
    from delam_fem.system.files import write_text

    path = directory / "tables.md"
    write_text(path, page(found, verdict(found)))
    figures = save_figures(found, directory / "figures")
    written = [directory / RESULT, path, *figures, write_page(found, figures, directory)]
    if not quiet:
        for entry in overview(found):
            table(entry.title, entry.heading, entry.rows)
        if not found.ladder.has_limit:
            tell(NO_LIMIT)
        typer.echo(verdict(found))
        say_files(written)
    if not found.is_complete:
        left = sum(rung.key not in found.results for rung in found.ladder.rungs())
        fail(f"interrupted with {left} rungs left; --resume goes on", INTERRUPTED)
