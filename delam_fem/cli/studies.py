"""Define the commands of the studies, of measured data, and of the paper."""

from __future__ import annotations

import inspect
import math
import re
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from dataclasses import MISSING
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from delam_fem.cli.console import (
    CaseArgument,
    DryRun,
    Folder,
    Overrides,
    Overwrite,
    OverwriteFile,
    Quiet,
    Resume,
    Rows,
    Workers,
    Yes,
    case_of,
    error_console,
    fail,
    progress,
    say,
    table,
    take,
)
from delam_fem.cli.endings import FAILED, INTERRUPTED, tell
from delam_fem.plugins.options import Flag, Options, flags_of
from delam_fem.system.docstrings import meanings, summary
from delam_fem.system.errors import CaseError

if TYPE_CHECKING:
    import xarray as xr

    from delam_fem.plugins.study import Study


_UNIT = re.compile(r"\[([^\[\]]++)\]")
COMMON: dict[str, tuple[Any, Any]] = {
    "workers": (Workers, None),
    "resume": (Resume, False),
    "overwrite": (Overwrite, False),
    "dry_run": (DryRun, False),
    "yes": (Yes, False),
}
"""Options of several commands: type and default."""


def study_command(study: Study[Any, Any]) -> Callable[..., None]:
    """Return the command of a study, whose parameters are the options of the study."""
    kind = study.options
    helps = meanings(kind)

    def called(
        case_name: str, output: Path | None, overrides: list[str] | None, *, quiet: bool,
        **given: Any,
    ) -> None:  # fmt: skip
        from delam_fem.engines.cost import require_affordable
        from delam_fem.model.beams.network import never_opens

        case = case_of(case_name, overrides)
        common = {key: given.pop(key) for key in kind.common}
        options = kind(**{key: value for key, value in given.items() if value is not None})
        folder = output or Path("runs") / f"{case.name}-{study.folder or study.words.split()[-1]}"
        study.require_fit(case)
        is_dry = common.pop("dry_run", False)
        is_confirmed = common.pop("yes", False)
        named_cost = study.cost_of(case, options, common.get("workers"))
        if named_cost is not None:
            what, cost = named_cost
            require_affordable(cost, what, is_confirmed=is_confirmed, folder=folder)
            if is_dry:
                table(f"{what}, case {case.name}", ("", ""), [("needs", str(cost))])
                return
        with progress(error_console(quiet or "workers" not in common)) as report:
            finding, written = study.saved(case, options, folder, **common, progress=report)
        said = finding.report
        for text in filter(None, [never_opens(case), *said.remarks]):
            tell(f"warning: {text}")
        tables = [(each.title, each.heading, each.rows) for each in said.tables]
        say(quiet, written, tables=tables, lines=said.sentences)
        if said.left:
            fail(f"interrupted {said.left}; --resume goes on", INTERRUPTED)

    parameters = {
        "case_name": (CaseArgument, inspect.Parameter.empty),
        "output": (Folder, None),
        "overrides": (Overrides, None),
        **{key: _parameter(kind, key, flag, helps[key]) for key, flag in flags_of(kind).items()},
        **{key: COMMON[key] for key in kind.common},
        "quiet": (Quiet, False),
    }
    called.__doc__ = summary(kind)
    take(called, parameters)
    return called


def _parameter(kind: type[Options], name: str, flag: Flag, text: str) -> tuple[Any, Any]:
    """Return type and default of an option as typer takes them."""
    hint = flag.kind
    default = kind.__dataclass_fields__[name].default
    if flag.is_several:
        hint = str if flag.is_joined else list[flag.kind]  # type: ignore[name-defined]
    if isinstance(default, tuple):
        words = [f"{item:g}" if flag.kind is float else str(item) for item in default]
        default = ",".join(words) if flag.is_joined else words
    unit = _UNIT.search(text)
    text = f"{text[0].upper()}{text[1:]}".replace("[", r"\[")  # units are no markup
    default = inspect.Parameter.empty if default is MISSING else default
    if flag.is_argument:
        return Annotated[hint, typer.Argument(metavar=flag.metavar, help=text)], default
    option = typer.Option(
        *(flag.names or [f"--{name.replace('_', '-')}"]),
        metavar=flag.metavar or (unit and unit[1].upper() + ",…" * flag.is_joined),
        min=flag.least if math.isfinite(flag.least) else None,
        max=flag.most if math.isfinite(flag.most) else None,
        help=text,
    )
    return Annotated[hint | None, option], default


Files = Annotated[
    list[Path],
    typer.Argument(metavar="FILE…", help="Files of measurements: CSV, UFF, MATLAB, NetCDF."),
]
Channels = Annotated[
    list[str] | None,
    typer.Option(
        "--channel",
        metavar="NAME=SOURCE[:UNIT][@X[:Z][/LAMINA]]",
        help="What a column is, e.g. 'tip thick=col2:mm' or "
        "'mid=Laser 3:mm/s@0.2/upper'; repeatable.",
    ),
]
Units = Annotated[
    str | None,
    typer.Option(metavar="UNIT", help="Unit of columns that name none, e.g. mm; SI: SI units."),
]
Rate = Annotated[
    float | None,
    typer.Option(metavar="HZ", help="Samples per second; replaces the times of the files."),
]
Between = Annotated[
    tuple[float, float] | None,
    typer.Option(metavar="FIRST LAST", help="Times between which records are read [s]."),
]
Fill = Annotated[
    bool, typer.Option("--fill", help="Interpolate short holes, where samples are missing.")
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
    between: Between = None,
    fill: Fill = False,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
) -> None:
    """Read measurements into one dataset in SI, DIR/measured.nc, and show what was found."""
    data = _read(files, channels, units, rate, between=between, fill=fill)
    _keep(data, files, output, overwrite=overwrite, quiet=quiet)


def response_command(
    files: Files,
    output: MeasuredFolder = None,
    channels: Channels = None,
    units: Units = None,
    rate: Rate = None,
    *,
    between: Between = None,
    fill: Fill = False,
    excitation: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="Channel to which frequency responses are estimated."),
    ] = None,
    segment: Annotated[
        float | None,
        typer.Option(
            metavar="S",
            help="Length of averaged segments (default: an eighth, or from blow to blow).",
        ),
    ] = None,
    estimator: Annotated[
        Literal["H1", "H2", "Hv"], typer.Option(help="Estimator of frequency responses.")
    ] = "H1",
    pole_range: Annotated[
        tuple[float, float] | None,
        typer.Option("--poles", metavar="LOW HIGH", help="Find poles between two frequencies."),
    ] = None,
    free: Annotated[
        tuple[str, float, float] | None,
        typer.Option(
            metavar="CHANNEL LOW HIGH",
            help="Follow the free vibration of a channel between two frequencies, in segments.",
        ),
    ] = None,
    period: Annotated[
        float | None,
        typer.Option(
            metavar="S", help="Period of a multisine, 1/spacing: no window, and its distortions."
        ),
    ] = None,
    realisations: Annotated[
        int, typer.Option(min=1, help="Realisations of the multisine, one after the other.")
    ] = 1,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
) -> None:
    """Read measurements or a run, and add responses, distortions, poles, or a free vibration."""
    from delam_fem.studies.signals.distortions import run_in, with_distortions

    run = run_in(files)
    if run is not None:
        files = [run.file]
        excitation = excitation or run.excitation
        period = period or run.period
        realisations = run.realisations if run.period else realisations
    if not (excitation or pole_range or free):
        raise CaseError(
            "measure response: expected --excitation NAME, --poles LOW HIGH or both, or --free "
            "CHANNEL LOW HIGH; `measure read` only reads"
        )
    from delam_fem.studies.signals.responses import with_free_vibrations, with_responses

    data = _read(files, channels, units, rate, between=between, fill=fill)
    tables: list[Rows] = []
    if run is not None and run.claps:
        text = "the run claps: its responses are not those of a linear structure"
        notes = "\n".join(filter(None, (data.attrs.get("notes"), text)))
        data = data.assign_attrs(is_linear=0, notes=notes)
    if excitation is not None and period is not None:
        data = with_distortions(data, excitation, period, realisations)
    elif excitation is not None:
        data = with_responses(data, excitation, segment=segment, estimator=estimator)
    if free is not None:
        data = with_free_vibrations(data, *free, segment=segment)
    is_linear = bool(data.attrs.get("is_linear", 1))
    if pole_range is not None and not is_linear:
        reason = "the record is not linear, as one that claps: a pole of it would be none"
        tables.append(("poles", ("not printed",), [(reason,)]))
    elif pole_range is not None:
        of_poles = ("frequency [Hz] (± 2 errors)", "damping [%] (± 2 errors)")
        data, rows_of_poles, rows_of_rest = _poles(data, *pole_range)
        tables.append(("poles", of_poles, rows_of_poles))
        tables.append(("what the poles leave", ("response", "rms [%]"), rows_of_rest))
    if free is not None:
        heading = ("time [s]", "frequency [Hz]", "damping [%]", "amplitude")
        tables.append((f"free vibration of {free[0]}", heading, _free_rows(data)))
    _keep(data, files, output, tables, overwrite=overwrite, quiet=quiet)


def _read(
    files: list[Path],
    channels: list[str] | None,
    units: str | None,
    rate: float | None,
    *,
    between: tuple[float, float] | None,
    fill: bool,
) -> xr.Dataset:
    """Read measurements as the options of the command line say."""
    from delam_fem.studies.signals.reading import assigned, read_measured

    return read_measured(
        *files, channels=assigned(channels), units=units, rate=rate, between=between, fill=fill
    )


def _keep(
    data: xr.Dataset,
    files: list[Path],
    output: Path | None,
    tables: Sequence[Rows] = (),
    *,
    overwrite: bool,
    quiet: bool,
) -> None:
    """Write and show what was read from files, and further tables."""
    from delam_fem.studies.signals.reading import HEADING, lines, rows
    from delam_fem.studies.signals.writing import write_all
    from delam_fem.system.files import claimed

    folder = output or Path("runs") / f"{files[0].stem}-measured"
    with claimed(folder, inputs=files, may_hold_results=overwrite) as directory:
        paths = write_all(data, directory)
    names = ", ".join(dict.fromkeys(path.name for path in files))
    say(quiet, (), tables=[(f"measured: {names}", HEADING, rows(data))], lines=lines(data))
    say(quiet, paths, tables=tables)


def _poles(
    data: xr.Dataset, lower: float, upper: float
) -> tuple[xr.Dataset, list[tuple[str, ...]], list[tuple[str, ...]]]:
    """Return the dataset with the poles as attributes, the poles as rows, and what they leave."""
    from delam_fem.studies.signals.responses import poles

    result, left = poles(data, lower, upper)
    left_rows: list[tuple[str, ...]] = [
        (name, f"{100 * share:.3g}") for name, share in left.items()
    ]
    if not result:
        return data, [("none found", "–")], left_rows
    data = data.assign_attrs(
        pole_frequency_hz=[pole.frequency for pole in result],
        pole_frequency_error_hz=[pole.frequency_error for pole in result],
        pole_damping=[pole.damping for pole in result],
        pole_damping_error=[pole.damping_error for pole in result],
    )
    rows: list[tuple[str, ...]] = [
        (
            f"{pole.frequency:.7g} ± {pole.frequency_error:.1g}",
            f"{100 * pole.damping:.5g} ± {100 * pole.damping_error:.1g}",
        )
        for pole in result
    ]
    return data, rows, left_rows


def _free_rows(data: xr.Dataset) -> list[tuple[str, ...]]:
    """Return the numbers of a free vibration as rows of a table."""
    names = "frequency", "frequency_error", "damping", "damping_error", "amplitude"
    columns = (data[f"free_{name}"].to_numpy().tolist() for name in ("time", *names))
    return [
        (f"{t:.4g}", f"{f:.6g} ± {e:.1g}", f"{100 * d:.3g} ± {100 * s:.1g}", f"{a:.3g}")
        for t, f, e, d, s, a in zip(*columns, strict=True)
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
    from delam_fem.studies.signals.overlay import overlay
    from delam_fem.studies.signals.reading import assigned
    from delam_fem.system.files import claimed

    runs, files = ([p for p in paths if p.is_dir() == is_run] for is_run in (True, False))
    if len(runs) != 1 or not files:
        names = ", ".join(map(str, paths))
        raise CaseError(f"overlay: expected files and the folder of one run, given {names}")
    run = runs[0]
    result = overlay(run, *files, channels=assigned(channels), units=units, rate=rate)
    with claimed(output or run, inputs=files, may_hold_results=True):
        paths = result.save(output or run / "overlay")
    heading = ("channel", "gain", "phase [°]", "noise", "misfit", "d measured", "d run")
    said = f"{files[0].name} over {run}", heading, result.rows()
    say(quiet, paths, tables=[said], lines=result.sentences())


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
    overwrite: OverwriteFile = False,
    quiet: Quiet = False,
) -> None:
    """Write the result of a run for other programs: histories, strobes, events, fields."""
    from delam_fem.results.export import FORMATS, targets
    from delam_fem.results.folder import load_result
    from delam_fem.system.files import require_no_links, require_replaceable
    from delam_fem.system.written import listed

    result = load_result(run, is_strict=True)
    if output is None:
        require_no_links(run)
    else:
        require_replaceable(targets(output), is_overwriting=overwrite)
    with listed(run) if output is None else nullcontext():
        written = result.export(to, output or run / "export" / f"{result.case.name}.{to}")
    say(quiet, written, lines=[FORMATS[to]])


def paper_command(
    figures: Annotated[
        list[str] | None,
        typer.Argument(metavar="[FIG]…", help="Figures: 1, 2a, 2b, 3, … 15, gamma (default: all)."),
    ] = None,
    output: Annotated[
        Path, typer.Option("-o", "--output", metavar="DIR", help="Folder of the results.")
    ] = Path("runs/paper"),
    *,
    fast: Annotated[
        bool,
        typer.Option("--fast", help="Coarser planes and responses; histories stay the same."),
    ] = False,
    workers: Workers = None,
    engine: Annotated[
        Literal["petsc", "compiled"], typer.Option(help="Engine that computes the steps.")
    ] = "compiled",
    quiet: Quiet = False,
) -> None:
    """Reproduce the paper: figures, numbers, and its claims beside the computed results."""
    from delam_fem.paper.reproduce import (
        FIGURES,
        chosen,
        claims_of,
        entries,
        file_stem,
        reproduce,
        tally,
        write_page,
    )
    from delam_fem.paper.runs import FAST, FULL, laboratory
    from delam_fem.system.files import claimed

    names = chosen(figures or [])
    try:
        with (
            claimed(output, may_hold_results=True),
            laboratory(FAST if fast else FULL, workers=workers, engine=engine) as lab,
        ):
            paths = reproduce(lab, output, names)
    except (RuntimeError, ArithmeticError) as error:
        fail(str(error), FAILED)
    entries_of_page = entries(output, [file_stem(name) for name in FIGURES])
    paths.append(write_page(output, entries_of_page))
    claims = claims_of(figure for figure in entries_of_page if figure["name"] in names)
    rows = [(c.figure, c.text, c.measured, c.verdict) for c in claims]
    heading = ("figure", "the paper says", "what came out", "verdict")
    say(quiet, paths, tables=[(tally(claims), heading, rows)])
