"""Define the command `delam-fem detect`: is there a delamination, and where?"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from delam_fem.cli.console.terminal import reported, say_files, table
from delam_fem.cli.inputs import (
    CaseArgument,
    Overrides,
    Overwrite,
    Quiet,
    Resume,
    case_of,
    inputs_of,
)
from delam_fem.cli.measured import Channels, Rate, Units, assigned

if TYPE_CHECKING:
    from delam_fem.case.definition import Case
    from delam_fem.studies.detection.measurement import Measurement, Scan

Folder = Annotated[
    Path | None,
    typer.Option(
        "-o", "--output", metavar="DIR", help="Folder of the results (default: runs/NAME-detect)."
    ),
]
IndexName = Annotated[
    Literal["curvature", "V2", "V3", "V1/2", "distortion", "thd"],
    typer.Option("--index", help="Index that calls and locates."),
]
Lamina = Annotated[
    str | None,
    typer.Option(metavar="NAME", help="Lamina whose surface is measured (default: the thinner)."),
]
Spacing = Annotated[float, typer.Option(metavar="M", help="Distance of the points in m.")]
First = Annotated[float, typer.Option(metavar="M", help="Position of the first point in m.")]
QuantityName = Annotated[
    Literal["velocity", "displacement"],
    typer.Option(help="What the sensor measures, in the fixed frame."),
]
SamplingRate = Annotated[
    float | None,
    typer.Option("--sampling-rate", metavar="HZ", help="Rate of samples (default: 50 per period)."),
]
Periods = Annotated[int, typer.Option(min=4, help="Periods of the record of a point.")]
Averages = Annotated[int, typer.Option(min=1, help="Records that are averaged.")]
Noise = Annotated[
    float,
    typer.Option("--noise-db", metavar="DB", help="Overall rms of the signal over the noise."),
]
Density = Annotated[
    float | None,
    typer.Option(
        "--noise-density", metavar="D", help="Noise of the sensor instead, in m/s/√Hz or m/√Hz."
    ),
]
Seed = Annotated[int, typer.Option(min=0, help="Seed of the noise.")]


Measured = Annotated[
    list[Path] | None,
    typer.Option(
        metavar="FILE",
        help="Judge this measurement of the surface instead of a simulated one; repeatable. "
        "--channel, --units and --rate as for `measure`.",
    ),
]


def register(app: typer.Typer) -> None:
    """Add the command to the application."""
    app.command("detect")(detect_command)


def detect_command(
    case_name: CaseArgument,
    output: Folder = None,
    overrides: Overrides = None,
    *,
    index: IndexName = "curvature",
    lamina: Lamina = None,
    spacing: Spacing = 0.01,
    first: First = 0.0,
    quantity: QuantityName = "velocity",
    sampling_rate: SamplingRate = None,
    periods: Periods = 16,
    averages: Averages = 1,
    noise_db: Noise = 40.0,
    noise_density: Density = None,
    seed: Seed = 1,
    measured: Measured = None,
    channels: Channels = None,
    units: Units = None,
    rate: Rate = None,
    resume: Resume = False,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
) -> None:
    """Measure a case with and without its delaminations, and mark them by what clapping adds."""
    with reported(quiet):
        from delam_fem.case.claim import claimed
        from delam_fem.simulation.checkpoint import of_study
        from delam_fem.studies.detection.measurement import Scan

        case = case_of(case_name, overrides)
        scan = Scan(
            lamina, spacing, first, quantity, sampling_rate, periods, averages, noise_db,
            noise_density, seed,
        )  # fmt: skip
        field = None
        if measured:
            field = read_scan(measured, (channels, units, rate), case, scan)
        where = output or Path("runs") / f"{case.name}-detect"
        inputs = [*inputs_of(case), *(measured or [])]
        claim = claimed(where, inputs=inputs, may_hold_results=resume or overwrite)
        with claim as folder, of_study(folder, resume=resume) as kept:
            _detect(case, scan, index, folder, field, kept=kept, quiet=quiet)


def read_scan(
    paths: list[Path],
    how: tuple[list[str] | None, str | None, float | None],
    case: Case,
    scan: Scan,
) -> Measurement:
    """Return the field in files of measurements; `how`: channels, units, rate."""
    from delam_fem.results.measured.reading import read_measured
    from delam_fem.studies.detection.measurement import read

    channels, units, rate = how
    data = read_measured(*paths, channels=assigned(channels), units=units, rate=rate)
    return read(data, case, scan)


def _detect(
    case: Case,
    scan: Scan,
    index: str,
    directory: Path,
    field: Measurement | None,
    *,
    kept: Path,
    quiet: bool,
) -> None:
    """Detect, write the results and show them."""
    from delam_fem.case.files import save_case
    from delam_fem.model.beams.network import never_opens
    from delam_fem.studies.detection.detect import HEADING, detect
    from delam_fem.studies.detection.figures import save_figures
    from delam_fem.studies.detection.page import verdict, write_page

    found = detect(case, scan, index=index, measured=field, kept=kept)
    save_case(case, directory)
    written = [found.save(directory)]
    figures = save_figures(found, directory / "figures")
    written += [*figures, write_page(found, figures, directory)]
    if message := never_opens(case):
        typer.echo(message, err=True)
    if not quiet:
        table(f"indices of case {case.name}", HEADING, found.rows())
        typer.echo(verdict(found))
        say_files(written)
