"""Define `delam-fem compare`: a case beside the independent reference, or as several models."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from delam_fem.cli.console.messages import tell
from delam_fem.cli.console.terminal import reported, say_files, table
from delam_fem.cli.inputs import CaseArgument, Overrides, Quiet, case_of

if TYPE_CHECKING:
    from delam_fem.case.definition import Case

Folder = Annotated[
    Path | None,
    typer.Option("-o", "--output", metavar="DIR", help="Folder (default: runs/NAME-compare)."),
]
Models = Annotated[
    str | None,
    typer.Option(
        metavar="NAMES",
        help="Compare these models, as beam,plane-stress,solid,reduced; the last reduces the one "
        "before it. Without this option: compare with the reference.",
    ),
]
Frequencies = Annotated[
    list[float] | None,
    typer.Option("--at", min=0.0, metavar="HZ", help="With --models: frequencies; repeatable."),
]
Impacts = Annotated[
    int, typer.Option(metavar="N", help="Compare with the reference up to impact N.")
]
Periods = Annotated[
    int | None,
    typer.Option(metavar="N", help="Periods of each run (3, with --models 20)."),
]
Modes = Annotated[int, typer.Option(min=1, metavar="N", help="Modes of a reduced model.")]


def register(app: typer.Typer) -> None:
    """Add the command to the application."""
    app.command("compare")(compare_command)


def compare_command(
    case_name: CaseArgument,
    output: Folder = None,
    overrides: Overrides = None,
    *,
    models: Models = None,
    at: Frequencies = None,
    impacts: Impacts = 20,
    periods: Periods = None,
    modes: Modes = 20,
    quiet: Quiet = False,
) -> None:
    """Compare a case with an independent reference, or as beams, solids and reduced to modes."""
    with reported(quiet):
        case = case_of(case_name, overrides)
        from delam_fem.case.claim import claimed

        folder = output or Path("runs") / f"{case.name}-compare"
        with claimed(folder, may_hold_results=True) as directory:
            if models is None:
                paths = _with_reference(case, directory, impacts, periods or 3, quiet=quiet)
            else:
                names = [name.strip() for name in models.split(",")]
                paths = _of_models(
                    case, directory, (names, at or [], modes), periods or 20, quiet=quiet
                )
        if not quiet:
            say_files(paths)


def _with_reference(
    case: Case, directory: Path, impacts: int, periods: int, *, quiet: bool
) -> list[Path]:
    """Compare matrices and motion with the reference; return the files."""
    from delam_fem.reference.compare import compare

    comparison = compare(case, impacts=impacts, periods=periods)
    paths = comparison.save(directory)
    if not quiet:
        table("largest differences", ("what", "difference"), comparison.rows())
        if comparison.refusal:
            tell(f"the motion is not compared: {comparison.refusal}")
    return paths


def _of_models(
    case: Case,
    directory: Path,
    wanted: tuple[list[str], list[float], int],
    periods: int,
    *,
    quiet: bool,
) -> list[Path]:
    """Compare models; return the files."""
    from delam_fem.studies.models.comparison import compare_models

    names, frequencies, modes = wanted
    found = compare_models(
        case,
        names,
        frequencies=frequencies,
        periods=periods,
        modes=modes,
        progress=lambda name: None if quiet else tell(f"computing {name}"),
    )
    paths = found.save(directory)
    if not quiet:
        heading = ("", *found.names)
        table(f"models of case {case.name}", heading, found.linear_rows())
        for number, motion in enumerate(found.models[0].motions):
            table(f"{motion.frequency:g} Hz", heading, found.motion_rows(number))
    return paths
