"""The command `delam-fem converge`: one case under refinement, all schemes side by side."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from delam_fem.cli.terminal import INTERRUPTED, fail, reported, say_files, table

if TYPE_CHECKING:
    from delam_fem.case.definition import Case
    from delam_fem.studies.convergence.ladder import MeshChoice
    from delam_fem.studies.convergence.run import Convergence

Direction = Annotated[
    Literal["elements", "steps", "both"],
    typer.Option("--in", help="What is refined; both: every mesh with every number of steps."),
]
Laws = Annotated[
    str | None,
    typer.Option(
        metavar="LAW,…",
        help="Contact laws, each alone or as LAW/lumped or LAW/consistent; all of them.",
    ),
]


def register(app: typer.Typer) -> None:
    """Add the command to the application."""
    app.command("converge")(converge_command)


def converge_command(
    case_name: Annotated[
        str, typer.Argument(metavar="CASE", help="A preset by name, or a case file (.toml).")
    ],
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", metavar="DIR", help="Folder (runs/NAME-converge)."),
    ] = None,
    overrides: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="KEY=VALUE", help="Override a key of the case; repeatable."),
    ] = None,
    *,
    direction: Direction = "steps",
    laws: Laws = None,
    elements: Annotated[
        str | None, typer.Option(metavar="N,…", help="Elements per lamina; 5,10,…,160.")
    ] = None,
    meshes: Annotated[
        str | None, typer.Option(metavar="FILE,…", help="Mesh files instead, coarse first.")
    ] = None,
    steps: Annotated[
        str | None, typer.Option(metavar="N,…", help="Steps per period; 250,500,…,16000.")
    ] = None,
    periods: Annotated[
        int | None, typer.Option(min=1, help="Periods of the statistics; 60.")
    ] = None,
    limit_steps: Annotated[
        int | None,
        typer.Option(min=0, help="Steps per period that stand for the limit; 64000. 0: none."),
    ] = None,
    engine: Annotated[
        Literal["petsc", "compiled"], typer.Option(help="What computes the steps.")
    ] = "compiled",
    workers: Annotated[
        int | None,
        typer.Option("-j", "--workers", min=1, metavar="N", help="Processes; one per core."),
    ] = None,
    resume: Annotated[
        bool, typer.Option("--resume", help="Go on with an interrupted ladder, or extend one.")
    ] = False,
    quiet: Annotated[bool, typer.Option("-q", "--quiet", help="No progress, no table.")] = False,
) -> None:
    """Refine a case: what each scheme converges to, how fast and at what cost."""
    with reported(quiet):
        from rich.console import Console

        from delam_fem.cli.inputs import case_of, writable
        from delam_fem.cli.progress import progress
        from delam_fem.studies.convergence.ladder import LAWS, LIMIT_STEPS, PERIODS, Ladder, scheme
        from delam_fem.studies.convergence.run import run_ladder

        case = case_of(case_name, overrides)
        ladder = Ladder(
            case,
            tuple(scheme(law.strip()) for law in (laws or ",".join(LAWS)).split(",")),
            _meshes(case, direction, elements, meshes),
            _steps(case, direction, steps),
            PERIODS if periods is None else periods,
            LIMIT_STEPS if limit_steps is None else limit_steps,
            engine,
        )
        directory = writable(output or Path("runs") / f"{case.name}-converge")
        with progress(Console(stderr=True, quiet=quiet)) as report:
            found = run_ladder(ladder, directory, workers=workers, resume=resume, progress=report)
        _tell(found, directory, quiet)
        if not found.is_complete:
            left = sum(rung.key not in found.results for rung in ladder.rungs())
            fail(f"interrupted with {left} rungs left; --resume goes on", INTERRUPTED)


def _meshes(
    case: Case, direction: str, elements: str | None, files: str | None
) -> tuple[MeshChoice, ...]:
    """Return the meshes of the ladder."""
    from delam_fem.case.toml import CaseError
    from delam_fem.studies.convergence.ladder import ELEMENTS, whole_numbers

    if elements is not None and files is not None:
        raise CaseError("converge: expected --elements or --meshes, given both")
    if files is not None:
        return tuple(Path(name.strip()).absolute() for name in files.split(","))
    if elements is not None:
        return whole_numbers(elements, "elements")
    if direction != "steps":
        return ELEMENTS
    mesh = case.mesh.elements if case.mesh.file is None else case.mesh.file
    assert mesh is not None  # a case has exactly one of both
    return (mesh,)


def _steps(case: Case, direction: str, steps: str | None) -> tuple[int, ...]:
    """Return the numbers of steps per period of the ladder."""
    from delam_fem.studies.convergence.ladder import STEPS, whole_numbers

    if steps is not None:
        return whole_numbers(steps, "steps")
    return STEPS if direction != "elements" else (case.time.steps_per_period,)


def _tell(found: Convergence, directory: Path, quiet: bool) -> None:
    """Write tables and figures, and show what matters of them."""
    from rich.markup import escape

    from delam_fem.case.atomic import write_text
    from delam_fem.studies.convergence.figures import save_figures
    from delam_fem.studies.convergence.run import RESULT
    from delam_fem.studies.convergence.tables import overview, tables

    path = directory / "tables.md"
    text = "\n".join(entry.markdown() for entry in tables(found))
    write_text(path, f"# Convergence of case {found.ladder.case.name}\n\n{text}")
    written = [directory / RESULT, path, *save_figures(found, directory / "figures")]
    if not quiet:
        for entry in overview(found):
            table(escape(entry.title), [escape(text) for text in entry.heading], entry.rows)
        say_files(written)
