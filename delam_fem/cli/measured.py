"""Define the commands of measured data: `measure`, `overlay`, `export`, `resonance`, `identify`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from delam_fem.cli.console import reported, say_files, table, tell
from delam_fem.cli.inputs import (
    CaseArgument,
    Folder,
    Overrides,
    Overwrite,
    Quiet,
    Resume,
    Uncertain,
    Workers,
    case_of,
    inputs_of,
)

if TYPE_CHECKING:
    import xarray as xr

    from delam_fem.studies.identification.identify import Experiment, Identification

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
Estimator = Annotated[
    Literal["H1", "H2", "Hv"], typer.Option(help="Estimator of frequency responses.")
]
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


def assigned(channels: list[str] | None) -> dict[str, str]:
    """Return the assignments of the option --channel by name."""
    from delam_fem.case.toml import shown
    from delam_fem.system.errors import CaseError

    found: dict[str, str] = {}
    for text in channels or []:
        name, sign, source = text.partition("=")
        if not sign or not name.strip() or not source.strip():
            raise CaseError(f"--channel: expected NAME=SOURCE, given {shown(text)}")
        if name.strip() in found:
            raise CaseError(f"--channel: expected different names, given {name.strip()!r} twice")
        found[name.strip()] = source.strip()
    return found


def measure_command(
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
    """Read measurements into one dataset in SI, DIR/measured.nc, and show what was found."""
    with reported(quiet):
        from delam_fem.results.measured.reading import (
            HEADING,
            lines,
            read_measured,
            rows,
            write_all,
        )
        from delam_fem.system.files import claimed

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
    run: Annotated[Path, typer.Argument(metavar="RUN", help="Folder of the results of a run.")],
    files: Files,
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
        from delam_fem.results.overlay.whole import overlay
        from delam_fem.system.files import claimed

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


Noise = Annotated[
    float,
    typer.Option(metavar="M", min=0.0, help="Standard deviation of a sample in m."),
]
Unknowns = Annotated[
    list[str], typer.Option(metavar="KEY=LOW:HIGH", help="A key that is sought; repeatable.")
]
Frequencies = Annotated[
    list[float], typer.Option(metavar="HZ", help="Frequency of a motion; repeatable.")
]
Motions = Annotated[
    list[Path] | None,
    typer.Option(
        metavar="FILE",
        help="Tips of a motion, one file per frequency; default: the case simulates them.",
    ),
]
Seed = Annotated[int, typer.Option(min=0, help="Seed of the noise and of the prior.")]


def resonance_command(
    case_name: CaseArgument,
    output: Folder = None,
    overrides: Overrides = None,
    *,
    measured: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Tips in a swept sine; default: the case simulates it."),
    ] = None,
    noise: Noise = 0.0,
    seed: Seed = 1,
    resume: Resume = False,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
) -> None:
    """Identify frequency, damping and EI of each lamina from the swept sine of a case."""
    with reported(quiet):
        from delam_fem.simulation.checkpoint import of_study
        from delam_fem.studies.identification.resonance import HEADING, identified
        from delam_fem.system.files import claimed

        case = case_of(case_name, overrides)
        folder = output or Path("runs") / f"{case.name}-resonance"
        inputs = [*inputs_of(case), *filter(None, [measured])]
        claim = claimed(folder, inputs=inputs, may_hold_results=resume or overwrite)
        with claim as directory, of_study(directory, resume=resume) as kept:
            found = identified(case, measured, noise=noise, seed=seed, kept=kept)
            written = found.save(directory)
        if not quiet:
            table(f"resonances of case {case.name}", HEADING, found.rows())
            for text in found.remarks():
                tell(text)
            say_files(written)


def identify_command(
    case_name: CaseArgument,
    unknown: Unknowns,
    frequency: Frequencies,
    output: Folder = None,
    overrides: Overrides = None,
    *,
    measured: Motions = None,
    noise: Noise = 1e-4,
    uncertain: Uncertain = None,
    simulations: Annotated[int, typer.Option(min=100, help="Number of simulations.")] = 2000,
    calibrate: Annotated[
        int, typer.Option(min=0, help="Number of simulations that check the intervals.")
    ] = 100,
    seed: Seed = 1,
    workers: Workers = None,
    resume: Resume = False,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
) -> None:
    """Identify keys of a case from clapping motions, as a joint posterior."""
    with reported(quiet):
        from delam_fem.studies.identification.identify import HEADING, Experiment
        from delam_fem.studies.unknown import Unknown
        from delam_fem.system.files import claimed

        case, unknowns = case_of(case_name, overrides), map(Unknown.parse, unknown)
        doubts = None if uncertain is None else tuple(map(Unknown.parse, uncertain))
        experiment = Experiment(case, tuple(frequency), tuple(unknowns), noise, uncertain=doubts)
        folder = output or Path("runs") / f"{case.name}-identification"
        inputs = [*inputs_of(case), *(measured or [])]
        claim = claimed(folder, inputs=inputs, may_hold_results=resume or overwrite)
        with claim as directory:
            found = _identified(
                experiment, measured, directory, (simulations, calibrate, seed), workers, quiet
            )
            written = found.save(directory)
        if not quiet:
            table(f"identification of case {case.name}", HEADING, found.rows())
            typer.echo(found.sentence())
            say_files(written)


def _identified(
    experiment: Experiment,
    measured: list[Path] | None,
    directory: Path,
    numbers: tuple[int, int, int],
    workers: int | None,
    quiet: bool,
) -> Identification:
    """Identify, with a bar of progress; `numbers` are simulations, checks and the seed."""
    from rich.console import Console

    from delam_fem.cli.progress import progress
    from delam_fem.studies.identification.identify import identify

    simulations, checks, seed = numbers
    with progress(Console(stderr=True, quiet=quiet)) as report:
        return identify(
            experiment,
            directory,
            measured=measured,
            simulations=simulations,
            checks=checks,
            seed=seed,
            workers=workers,
            progress=report,
        )
