"""Define `delam-fem measure read`, `response` and `overlay`, and `show export`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from delam_fem.cli.console import reported, say_files, table
from delam_fem.cli.inputs import Overwrite, Quiet

if TYPE_CHECKING:
    import xarray as xr

Files = Annotated[
    list[Path],
    typer.Argument(metavar="FILE…", help="Files of measurements: CSV, UFF, MATLAB, NetCDF."),
]
Channels = Annotated[
    list[str] | None,
    typer.Option(
        "--channel",
        metavar="NAME=SOURCE[:UNIT][@X[/LAMINA]]",
        help="What a column is, e.g. 'tip thick=col2:mm' or "
        "'mid=Laser 3:mm/s@0.2/upper'; repeatable.",
    ),
]
Units = Annotated[
    str | None,
    typer.Option(metavar="UNIT", help="Unit of columns that name none, e.g. mm; SI: SI units."),
]
Rate = Annotated[
    float | None, typer.Option(metavar="HZ", help="Samples per second of files without times.")
]

Excitation = Annotated[
    str | None,
    typer.Option(metavar="NAME", help="Channel to which frequency responses are estimated."),
]
Segment = Annotated[
    float | None,
    typer.Option(
        metavar="S", help="Length of averaged segments (default: an eighth, or from blow to blow)."
    ),
]
Method = Literal["H1", "H2", "Hv"]
Estimator = Annotated[Method, typer.Option(help="Estimator of frequency responses.")]
PoleRange = Annotated[
    tuple[float, float] | None,
    typer.Option("--poles", metavar="LOW HIGH", help="Find poles between two frequencies."),
]
MeasuredFolder = Annotated[
    Path | None,
    typer.Option(
        "-o", "--output", metavar="DIR", help="Folder of the dataset (default: runs/NAME-measured)."
    ),
]


def read_command(
    files: Files,
    output: MeasuredFolder = None,
    channels: Channels = None,
    units: Units = None,
    rate: Rate = None,
    *,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
) -> None:
    """Read measurements into one dataset in SI, DIR/measured.nc, and show what was found."""
    _measure(files, output, channels, units, rate, overwrite=overwrite, quiet=quiet)


def response_command(
    files: Files,
    output: MeasuredFolder = None,
    channels: Channels = None,
    units: Units = None,
    rate: Rate = None,
    *,
    excitation: Excitation = None,
    segment: Segment = None,
    estimator: Estimator = "H1",
    pole_range: PoleRange = None,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
) -> None:
    """Read measurements, and add frequency responses to a channel and their poles."""
    asked = excitation, segment, estimator, pole_range
    _measure(files, output, channels, units, rate, asked, overwrite=overwrite, quiet=quiet)


def _measure(
    files: list[Path],
    output: Path | None,
    channels: list[str] | None,
    units: str | None,
    rate: float | None,
    asked: tuple[str | None, float | None, Method, tuple[float, float] | None] | None = None,
    *,
    overwrite: bool,
    quiet: bool,
) -> None:
    """Read measurements, write and show them.

    `asked` is what a user asks of frequency responses: excitation, length of segments, estimator,
    range of poles; None: nothing.
    """
    with reported(quiet):
        from delam_fem.results.measured.reading import (
            HEADING,
            assigned,
            lines,
            read_measured,
            rows,
            write_all,
        )
        from delam_fem.system.errors import CaseError
        from delam_fem.system.files import claimed

        excitation, segment, estimator, pole_range = asked or (None, None, "H1", None)
        if asked is not None and excitation is None and pole_range is None:
            raise CaseError(
                "measure response: expected --excitation NAME, --poles LOW HIGH or both; "
                "`measure read` only reads"
            )
        data = read_measured(*files, channels=assigned(channels), units=units, rate=rate)
        if excitation is not None:
            from delam_fem.results.measured.responses import with_responses

            data = with_responses(data, excitation, segment=segment, estimator=estimator)
        found = _poles(data, pole_range)
        folder = output or Path("runs") / f"{files[0].stem}-measured"
        with claimed(folder, inputs=files, may_hold_results=overwrite) as directory:
            paths = write_all(data, directory)
        if not quiet:
            names = ", ".join(dict.fromkeys(path.name for path in files))
            table(f"measured: {names}", HEADING, list(rows(data)))
            for line in lines(data):
                typer.echo(line)
            if found:
                table("poles", ("frequency [Hz]", "damping [%]"), found)
            say_files(paths)


def _poles(data: xr.Dataset, pole_range: tuple[float, float] | None) -> list[tuple[str, str]]:
    """Return the poles as rows of a table; they are added to the attributes of the dataset."""
    if pole_range is None:
        return []
    from delam_fem.results.measured.responses import poles

    found = poles(data, *pole_range)
    if not found:
        return [("none found", "–")]
    data.attrs["pole_frequency_hz"] = [pole.frequency for pole in found]
    data.attrs["pole_damping"] = [pole.damping for pole in found]
    return [
        (
            f"{pole.frequency:.5g} ± {pole.frequency_scatter:.1g}",
            f"{100 * pole.damping:.3g} ± {100 * pole.damping_scatter:.1g}",
        )
        for pole in found
    ]


def overlay_command(
    paths: Annotated[
        list[Path],
        typer.Argument(
            metavar="FILE… RUN", help="Files of a measurement; folder of the results of a run."
        ),
    ],
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", metavar="DIR", help="Folder (default: RUN/overlay)."),
    ] = None,
    channels: Channels = None,
    units: Units = None,
    rate: Rate = None,
    *,
    quiet: Quiet = False,
) -> None:
    """Lay a measurement over a run: align it, and show how it differs."""
    with reported(quiet):
        from delam_fem.results.measured.reading import assigned
        from delam_fem.results.overlay.whole import overlay
        from delam_fem.system.errors import CaseError
        from delam_fem.system.files import claimed

        runs, files = ([p for p in paths if p.is_dir() == is_run] for is_run in (True, False))
        if len(runs) != 1 or not files:
            given = ", ".join(map(str, paths))
            raise CaseError(f"overlay: expected files and the folder of one run, given {given}")
        run = runs[0]
        found = overlay(run, *files, channels=assigned(channels), units=units, rate=rate)
        folder = output or run / "overlay"
        with claimed(folder, inputs=files, may_hold_results=True) as directory:
            paths = found.save(directory)
        if not quiet:
            heading = ("channel", "gain", "phase [°]", "noise", "misfit", "d measured", "d run")
            table(f"{files[0].name} over {run}", heading, list(found.rows()))
            for line in found.sentences():
                typer.echo(line)
            say_files(paths)


def export_command(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="Folder of the results of a run.")],
    to: Annotated[str, typer.Option(metavar="csv|mat|uff|vtkhdf", help="Format.")],
    output: Annotated[
        Path | None,
        typer.Option(
            "-o", "--output", metavar="FILE", help="File (default: RUN/export/NAME.FORMAT)."
        ),
    ] = None,
    *,
    quiet: Quiet = False,
) -> None:
    """Write the result of a run for other programs: histories, strobes, events, fields."""
    with reported(quiet):
        from delam_fem.results.export import FORMATS
        from delam_fem.results.folder import load_result

        result = load_result(run)
        written = result.export(to, output or run / "export" / f"{result.case.name}.{to}")
        if not quiet:
            typer.echo(FORMATS[to])
            say_files(written)
