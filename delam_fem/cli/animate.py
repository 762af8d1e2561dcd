"""Define the command `delam-fem animate`: the laminae of a run in motion, as GIF and MP4."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from delam_fem.cli.console.terminal import reported, say_files
from delam_fem.cli.inputs import Quiet

RunFolder = Annotated[Path, typer.Argument(metavar="RUN", help="Folder of the results of a run.")]
Files = Annotated[
    list[Path] | None,
    typer.Option(
        "-o", "--output", metavar="FILE",
        help="File that ends in .gif or .mp4; repeatable (default: RUN/laminae.gif and .mp4).",
    ),
]  # fmt: skip


def register(app: typer.Typer) -> None:
    """Add the command to the application."""
    app.command("animate")(animate_command)


def animate_command(
    run: RunFolder,
    output: Files = None,
    *,
    periods: Annotated[
        float, typer.Option(metavar="N", help="Length of the film: the last periods.")
    ] = 2.0,
    rate: Annotated[float, typer.Option(metavar="N", help="Pictures per second.")] = 20.0,
    stretch: Annotated[
        float, typer.Option(metavar="N", help="Factor of lateral lengths; 1: true to scale.")
    ] = 3.0,
    quiet: Quiet = False,
) -> None:
    """Write a film of the laminae, with the pairs that touch lit."""
    with reported(quiet):
        from rich.console import Console

        from delam_fem.case.toml import CaseError
        from delam_fem.cli.console.progress import progress
        from delam_fem.results.folder import load_numbers

        for name, value in (("--periods", periods), ("--rate", rate), ("--stretch", stretch)):
            if not 0.0 < value < float("inf"):
                raise CaseError(f"{name}: expected a positive number, given {value:g}")
        paths = output or [run / "laminae.gif", run / "laminae.mp4"]
        _check_suffixes(paths)
        case, history, _ = load_numbers(run)
        if not history.sizes.get("frame", 0):
            raise CaseError(
                f"{run}: the run kept no frames of its fields; run it again with "
                "output.fields_per_period above 0"
            )
        for folder in {path.parent for path in paths}:
            folder.mkdir(parents=True, exist_ok=True)
        from delam_fem.results.fields.animation import write_film

        with progress(Console(stderr=True, quiet=quiet)) as report:
            written = write_film(
                history, case, paths, periods=periods, rate=rate, stretch=stretch, progress=report
            )
        if not written:
            raise CaseError(f"{run}: no frame of the run is finite, so there is nothing to show")
        if not quiet:
            say_files(written)


def _check_suffixes(paths: list[Path]) -> None:
    """Refuse files of other formats, and the same file twice."""
    from delam_fem.case.toml import CaseError

    for path in paths:
        if path.suffix not in (".gif", ".mp4"):
            raise CaseError(f"--output: expected a file that ends in .gif or .mp4, given {path}")
    if len(set(paths)) < len(paths):
        raise CaseError("--output: expected different files, given one of them twice")
