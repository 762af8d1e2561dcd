"""Define the studies of detection: `delam-fem excite`, `pod` and `infer`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from delam_fem.cli.console.terminal import reported, say_files, table
from delam_fem.cli.inputs import (
    CaseArgument,
    Overrides,
    Overwrite,
    Quiet,
    Resume,
    Uncertain,
    Workers,
    case_of,
    inputs_of,
)
from delam_fem.cli.measured import Channels, Rate, Units

if TYPE_CHECKING:
    from delam_fem.case.definition import Case

Folder = Annotated[
    Path | None,
    typer.Option("-o", "--output", metavar="DIR", help="Folder (default: runs/NAME-COMMAND)."),
]
Noise = Annotated[
    float,
    typer.Option("--noise-db", metavar="DB", help="Overall rms of the signal over the noise."),
]


def register(app: typer.Typer) -> None:
    """Add the commands to the application."""
    app.command("excite")(excite_command)
    app.command("pod")(pod_command)
    app.command("infer")(infer_command)


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

    from delam_fem.case.claim import claimed
    from delam_fem.cli.console.progress import progress
    from delam_fem.studies.detection.excitation import excitation_map
    from delam_fem.studies.detection.excitation_figure import excitation_figure, ratio_figure
    from delam_fem.studies.detection.saving import save_drawings, save_page
    from delam_fem.studies.sweeps.merge import remove_results

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
        from delam_fem.studies.detection.probability import grid

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

    from delam_fem.case.claim import claimed
    from delam_fem.cli.console.progress import progress
    from delam_fem.results.pages.html import Section, Table
    from delam_fem.studies.detection.pod import HEADING, pod
    from delam_fem.studies.detection.population import population
    from delam_fem.studies.detection.saving import save_drawings, save_page
    from delam_fem.studies.sweeps.merge import remove_results

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
    from delam_fem.case.toml import CaseError

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
        from delam_fem.studies.detection.inference import FREQUENCIES
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
    from delam_fem.case.toml import CaseError
    from delam_fem.cli.detection.detect import read_scan
    from delam_fem.studies.detection.measurement import Scan

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

    from delam_fem.case.claim import claimed
    from delam_fem.cli.console.progress import progress
    from delam_fem.studies.detection.posterior import infer
    from delam_fem.studies.detection.saving import save_drawings, save_page
    from delam_fem.studies.sweeps.merge import remove_results

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
