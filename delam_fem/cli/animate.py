"""Define the command `delam-fem animate`: the laminae of a run in motion, as GIF and MP4."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from delam_fem.cli.console.terminal import reported, say_files
from delam_fem.cli.inputs import Quiet

if TYPE_CHECKING:
    import xarray as xr

    from delam_fem.case.definition import Case

RunFolder = Annotated[Path, typer.Argument(metavar="RUN", help="Folder of the results of a run.")]
Files = Annotated[
    list[Path] | None,
    typer.Option(
        "-o", "--output", metavar="FILE",
        help="File that ends in .gif or .mp4; repeatable (default: RUN/laminae.gif and .mp4, or "
        "RUN/solid.gif and .mp4).",
    ),
]  # fmt: skip


Solid = Annotated[
    bool,
    typer.Option(
        "--solid", help="Show solids coloured by their stress, their thickness drawn larger."
    ),
]


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
    solid: Solid = False,
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
        name = "solid" if solid else "laminae"
        paths = output or [run / f"{name}.gif", run / f"{name}.mp4"]
        _check_suffixes(paths)
        case, history, _ = load_numbers(run)
        if not history.sizes.get("frame", 0):
            raise CaseError(
                f"{run}: the run kept no frames of its fields; run it again with "
                "output.fields_per_period above 0"
            )
        for folder in {path.parent for path in paths}:
            folder.mkdir(parents=True, exist_ok=True)
        with progress(Console(stderr=True, quiet=quiet)) as report:
            length = None if solid else stretch
            keys = {"periods": periods, "rate": rate, "progress": report}
            written = _written(run, history, case, paths, length, keys)
        if not written:
            raise CaseError(f"{run}: no frame of the run is finite, so there is nothing to show")
        if not quiet:
            say_files(written)


def _written(
    run: Path,
    history: xr.Dataset,
    case: Case,
    paths: list[Path],
    stretch: float | None,
    keys: dict[str, Any],
) -> list[Path]:
    """Write the film of the laminae, or without `stretch` that of the solid."""
    if stretch is not None:
        from delam_fem.results.fields.animation import write_film

        return write_film(history, case, paths, stretch=stretch, **keys)
    from delam_fem.case.toml import CaseError
    from delam_fem.results.fields import stressed
    from delam_fem.results.folder import SOLID

    fields = run / "fields" / SOLID
    if not fields.is_file():
        raise CaseError(
            f'{run}: --solid: expected the run of a solid (model.kind = "plane-stress" or "solid") '
            f"with frames, found no fields/{SOLID}"
        )
    return stressed.write_film(fields, history, case, paths, **keys)


def _check_suffixes(paths: list[Path]) -> None:
    """Refuse files of other formats, and the same file twice."""
    from delam_fem.case.toml import CaseError

    for path in paths:
        if path.suffix not in (".gif", ".mp4"):
            raise CaseError(f"--output: expected a file that ends in .gif or .mp4, given {path}")
    if len(set(paths)) < len(paths):
        raise CaseError("--output: expected different files, given one of them twice")
