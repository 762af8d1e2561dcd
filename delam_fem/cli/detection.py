"""Define the studies of detection: `delam-fem detect`, `excite`, `pod`, `infer`, `modulate`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from delam_fem.cli.console import reported, say_files, table
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
from delam_fem.cli.measured import Channels, Rate, Units, assigned

if TYPE_CHECKING:
    from delam_fem.case.definition import Case
    from delam_fem.studies.detection.detect import Measurement, Scan
    from delam_fem.studies.detection.modulation import Tones

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
        from delam_fem.simulation.checkpoint import of_study
        from delam_fem.studies.detection.detect import Scan
        from delam_fem.system.files import claimed

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
    from delam_fem.studies.detection.detect import read

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
    from delam_fem.studies.detection.figures import save_figures, verdict, write_page

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


def excite_command(
    case_name: CaseArgument,
    output: Folder = None,
    overrides: Overrides = None,
    *,
    lowest: Annotated[float, typer.Option("--from", metavar="HZ", help="First frequency.")] = 40.0,
    highest: Annotated[float, typer.Option("--to", metavar="HZ", help="Last frequency.")] = 400.0,
    number: Annotated[int, typer.Option("-n", "--number", min=1, help="Frequencies.")] = 37,
    noise_db: Noise = 40.0,
    spacing: Annotated[float, typer.Option(metavar="M", help="Distance of points in m.")] = 0.01,
    workers: Workers = None,
    resume: Resume = False,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
) -> None:
    """Recommend an excitation: how well each frequency shows the delaminations of a case."""
    with reported(quiet):
        import numpy as np

        case = case_of(case_name, overrides)
        frequencies = np.linspace(lowest, highest, number)
        folder = output or Path("runs") / f"{case.name}-excite"
        options = {"workers": workers, "resume": resume, "noise_db": noise_db, "spacing": spacing}
        written = _excite(case, frequencies, folder, options, overwrite=overwrite, quiet=quiet)
        if not quiet:
            say_files(written)


def _excite(
    case: Case, frequencies: Any, folder: Path, options: dict[str, Any], *, overwrite: bool,
    quiet: bool,
) -> list[Path]:  # fmt: skip
    """Compute the map, write it and show the recommendation."""
    from rich.console import Console

    from delam_fem.cli.progress import progress
    from delam_fem.studies.detection.excitation import excitation_map
    from delam_fem.studies.detection.figures import (
        excitation_figure,
        ratio_figure,
        save_drawings,
        save_page,
    )
    from delam_fem.studies.sweeps.dataset import remove_results
    from delam_fem.system.files import claimed

    may = options["resume"] or overwrite
    with claimed(folder, inputs=inputs_of(case), may_hold_results=may) as directory:
        if overwrite:
            remove_results(directory)
        with progress(Console(stderr=True, quiet=quiet)) as report:
            found = excitation_map(case, frequencies, directory, progress=report, **options)
        drawings = {"excitation": excitation_figure(found)}
        if found.ratios.size > 1:
            drawings["ratios"] = ratio_figure(found)
        figures = save_drawings(drawings, directory / "figures")
        captions = dict(zip(figures, (_MAP, _RATIOS), strict=False))
        page = save_page(f"Excitation of {case.name}", found.reason, captions, case, directory)
        written = [found.save(directory), *figures, page]
    if not quiet:
        typer.echo(found.reason)
    return written


_MAP = (
    "The 2f-curvature over its limit of noise, over frequency and place; dashed: the delamination. "
    "Below: its largest value, its contrast without noise, and how often it is called."
)
_RATIOS = "The largest 2f-curvature over its limit of noise, over frequency and opening/amplitude."


def pod_command(
    case_name: CaseArgument,
    output: Folder = None,
    overrides: Overrides = None,
    *,
    frequencies: Annotated[
        str, typer.Option(metavar="HZ,…", help="Excitations that are compared.")
    ] = "92,250,365",
    supports: Annotated[
        str, typer.Option(metavar="KIND,…", help="Supports at the end of the structure.")
    ] = "clamped,free",
    noises: Annotated[
        str,
        typer.Option("--noise-db", metavar="DB,…", help="Overall rms of the signal over noise."),
    ] = "40,20",
    workers: Workers = None,
    resume: Resume = False,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
) -> None:
    """Find the probability of detection over length, depth and position; ROC curves."""
    with reported(quiet):
        from delam_fem.studies.detection.population import grid

        case = case_of(case_name, overrides)
        specimens = grid(case, supports.split(","), _numbers(frequencies))
        folder = output or Path("runs") / f"{case.name}-pod"
        options = {"workers": workers, "resume": resume, "overwrite": overwrite}
        _pod(case, specimens, _numbers(noises), folder, options, quiet=quiet)


def _pod(
    case: Case, specimens: Any, noises: list[float], folder: Path, options: dict[str, Any], *,
    quiet: bool,
) -> None:  # fmt: skip
    """Compute the study, write it and show the table."""
    from rich.console import Console

    from delam_fem.cli.progress import progress
    from delam_fem.results.pages.html import Section, Table
    from delam_fem.studies.detection.figures import save_drawings, save_page
    from delam_fem.studies.detection.pod import HEADING, pod
    from delam_fem.studies.detection.population import population
    from delam_fem.studies.sweeps.dataset import remove_results
    from delam_fem.system.files import claimed

    overwrite = options.pop("overwrite")
    may = options["resume"] or overwrite
    with claimed(folder, inputs=inputs_of(case), may_hold_results=may) as directory:
        if overwrite:
            remove_results(directory)
        with progress(Console(stderr=True, quiet=quiet)) as report:
            runs = population(case, specimens, directory, name="pod", progress=report, **options)
        found = pod(case, runs, noises)
        drawings = {"pod": found.pod_figure(), "roc": found.roc_figure()}
        figures = save_drawings(drawings, directory / "figures")
        captions = dict(zip(figures, (_POD, _ROC), strict=True))
        more = (Section("Numbers", [Table(HEADING, found.rows)]),)
        text = f"{len(specimens)} structures; each support and noise at its best frequency."
        page = save_page(f"POD of {case.name}", text, captions, case, directory, more)
        written = [found.save(directory), *figures, page]
    if not quiet:
        table(f"probability of detection, {case.name}", HEADING, found.rows)
        say_files(written)


def _numbers(text: str) -> list[float]:
    """Return the numbers of a list in an option."""
    from delam_fem.system.errors import CaseError

    try:
        return [float(part) for part in text.split(",")]
    except ValueError:
        raise CaseError(f"expected numbers with commas between them, given {text!r}") from None


_POD = "Hits over length, the logistic regression on ln a, and its lower 95 % bound."
_ROC = "Rates of detection and of false calls for every threshold, in classes of length."


def infer_command(
    case_name: CaseArgument,
    output: Folder = None,
    overrides: Overrides = None,
    *,
    number: Annotated[
        int, typer.Option("-n", "--number", min=100, help="Structures in the table.")
    ] = 5000,
    noise_db: Noise = 40.0,
    frequency: Annotated[
        list[float] | None,
        typer.Option(metavar="HZ", help="Excitation of a scan; repeatable (default: 92, 250)."),
    ] = None,
    measured: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="FILE",
            help="Scan of the surface, a file per frequency, instead of simulated ones. "
            "--channel, --units and --rate as for `measure`.",
        ),
    ] = None,
    channels: Channels = None,
    units: Units = None,
    rate: Rate = None,
    uncertain: Uncertain = None,
    workers: Workers = None,
    resume: Resume = False,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
) -> None:
    """Infer start, end and depth of a delamination from noisy scans: a posterior."""
    with reported(quiet):
        from delam_fem.studies.detection.infer import FREQUENCIES
        from delam_fem.studies.unknown import Unknown

        case = case_of(case_name, overrides)
        frequencies = tuple(frequency or FREQUENCIES)
        scans = None
        if measured:
            scans = _scans(case, frequencies, measured, (channels, units, rate))
        doubts = None if uncertain is None else [Unknown.parse(text) for text in uncertain]
        options = {
            "number": number, "frequencies": frequencies, "noise_db": noise_db, "measured": scans,
            "uncertain": doubts, "workers": workers, "resume": resume,
        }  # fmt: skip
        inputs = [*inputs_of(case), *(measured or [])]
        folder = output or Path("runs") / f"{case.name}-infer"
        _infer(case, folder, inputs, options, overwrite=overwrite, quiet=quiet)


def _scans(
    case: Case, frequencies: tuple[float, ...], files: list[Path],
    how: tuple[list[str] | None, str | None, float | None],
) -> list[Any]:  # fmt: skip
    """Return measured scans, one per frequency; `how`: channels, units, rate."""
    from delam_fem.studies.detection.detect import Scan
    from delam_fem.system.errors import CaseError

    if len(files) != len(frequencies):
        raise CaseError(
            f"--measured: expected one file per frequency, given {len(files)} files and "
            f"{len(frequencies)} frequencies"
        )
    cases = [case.with_overrides({"excitation.frequency": f}) for f in frequencies]
    every = zip(files, cases, strict=True)
    return [read_scan([path], how, own, Scan()) for path, own in every]


def _infer(
    case: Case, folder: Path, inputs: list[Path], options: dict[str, Any], *, overwrite: bool,
    quiet: bool,
) -> None:  # fmt: skip
    """Compute the table and the scans, write the posterior and show it."""
    from rich.console import Console

    from delam_fem.cli.progress import progress
    from delam_fem.studies.detection.figures import save_drawings, save_page
    from delam_fem.studies.detection.infer import infer
    from delam_fem.studies.sweeps.dataset import remove_results
    from delam_fem.system.files import claimed

    may = options["resume"] or overwrite
    with claimed(folder, inputs=inputs, may_hold_results=may) as directory:
        if overwrite:
            remove_results(directory)
        with progress(Console(stderr=True, quiet=quiet)) as report:
            found = infer(case, directory, progress=report, **options)
        figures = save_drawings({"posterior": found.figure()}, directory / "figures")
        captions = {figures[0]: "Prior and posterior of start, end and depth."}
        text = f"{found.n_structures} structures from the prior. {found.mismatch or ''}"
        page = save_page(f"Delamination of {case.name}", text, captions, case, directory)
        written = [found.save(directory), *figures, page]
    if found.mismatch:
        typer.echo(found.mismatch, err=True)
    if not quiet:
        heading = ("parameter", "truth [mm]", "median [mm]", "90 % interval [mm]")
        table(f"posterior, {case.name}", heading, found.rows())
        say_files(written)


def modulate_command(
    case_name: CaseArgument,
    output: Folder = None,
    overrides: Overrides = None,
    *,
    pump_frequency: Annotated[
        float, typer.Option(metavar="HZ", help="Low frequency beside the excitation's [Hz].")
    ],
    pump_amplitude: Annotated[
        float, typer.Option(metavar="A", min=0.0, help="In the case's own unit: m, m/s2 or N.")
    ],
    spacing: Annotated[float, typer.Option(metavar="M", help="Distance of points in m.")] = 0.01,
    periods: Annotated[int, typer.Option(min=1, help="Common periods of the record.")] = 4,
    noise_db: Noise = 40.0,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the noise.")] = 1,
    resume: Resume = False,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
) -> None:
    """Excite a case at two frequencies, and show the sidebands that its delaminations make."""
    with reported(quiet):
        from delam_fem.simulation.checkpoint import of_study
        from delam_fem.studies.detection.detect import Scan
        from delam_fem.studies.detection.modulation import Tones
        from delam_fem.system.files import claimed

        case = case_of(case_name, overrides)
        tones = Tones.of(case, pump_frequency, pump_amplitude)
        scan = Scan(spacing=spacing, periods=periods, noise_db=noise_db, seed=seed)
        where = output or Path("runs") / f"{case.name}-modulate"
        claim = claimed(where, inputs=inputs_of(case), may_hold_results=resume or overwrite)
        with claim as folder, of_study(folder, resume=resume) as kept:
            _modulate(tones, scan, folder, kept=kept, quiet=quiet)


def _modulate(tones: Tones, scan: Scan, directory: Path, *, kept: Path, quiet: bool) -> None:
    """Measure, write the results and show them."""
    from delam_fem.studies.detection.figures import modulation_figure, save_drawings, save_page
    from delam_fem.studies.detection.modulation import modulation

    found = modulation(tones, scan, kept=kept)
    figures = save_drawings({"modulation": modulation_figure(found)}, directory / "figures")
    captions = {figures[0]: "Sideband ratio of each point, and what noise alone exceeds."}
    title = f"Modulation of {found.case.name}"
    page = save_page(title, found.verdict, captions, found.case, directory)
    written = [found.save(directory), *figures, page]
    if not quiet:
        typer.echo(found.verdict)
        say_files(written)
