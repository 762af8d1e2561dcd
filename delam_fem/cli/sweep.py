"""Define `delam-fem sweep` and `show diagram`, also for clusters that share a sweep."""

from __future__ import annotations

import functools
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from delam_fem.cli.cases import show_sweep
from delam_fem.cli.console import (
    DryRun,
    Folder,
    Overrides,
    Overwrite,
    Quiet,
    Resume,
    Workers,
    Yes,
    error_console,
    fail,
    overrides_in,
    progress,
    require_one,
    say,
)
from delam_fem.cli.endings import DONE, FAILED, INTERRUPTED, tell
from delam_fem.system.errors import CaseError

if TYPE_CHECKING:
    import xarray as xr

    from delam_fem.studies.executors import ExecutorName
    from delam_fem.studies.sweeps.grid import Sweep

DAY = 24.0
"""Longest time of a job unless the user says another [h]."""


def require_fitting(
    way: str | None, whole: Mapping[str, bool], partial: bool, hours: float | None
) -> None:
    """Check the options that go with a way of computing a sweep.

    Args:
        way: "shard", "merge" or "slurm"; None: the whole sweep at once.
        whole: options that only go with the whole sweep, by name.
        partial: whether to write a result without all points.
        hours: longest time of a job, if it is given.

    Raises:
        CaseError: an option does not go with the way.
    """
    if partial and way != "merge":
        raise CaseError("--partial: only goes with --merge")
    if hours is not None and way != "slurm":
        raise CaseError("--hours: only goes with --slurm")
    option = next((name for name, value in whole.items() if value), None)
    if way is not None and option is not None:
        raise CaseError(f"--{option.replace('_', '-')}: does not go with --{way}; leave it out")


def compute_shard(
    sweep: Sweep, directory: Path, text: str, inputs: list[Path], *, quiet: bool, **options: Any
) -> None:
    """Compute a shard and show how far it is; exit with a message if it is not complete."""
    from delam_fem.results.schema import shown
    from delam_fem.studies.sweeps.run import run_shard
    from delam_fem.studies.sweeps.schedule import parse_shard
    from delam_fem.system.files import claimed

    shard = parse_shard(text)
    with claimed(directory, inputs=inputs, is_shared=True):
        with progress(error_console(quiet)) as report:
            result = run_shard(sweep, directory, shard, progress=report, **options)
    points = ("points", f"{result.n_done} of {result.n_points}")
    rows = [points, *((key.replace("_", " "), shown(value)) for key, value in result.about.items())]
    say(quiet, (), tables=[(f"sweep {sweep.file.name}, shard {shard}", ("", "value"), rows)])
    if result.n_done < result.n_points:
        left = result.n_points - result.n_done
        fail(
            f"interrupted with {left} of {result.n_points} points of shard {shard} left; --resume "
            "goes on",
            INTERRUPTED,
        )


def merge_shards(
    sweep: Sweep, directory: Path, inputs: list[Path], *, is_partial: bool
) -> xr.Dataset:
    """Join the shards of a sweep; exit with a message if all points failed."""
    from delam_fem.studies.sweeps.dataset import merge_sweep
    from delam_fem.system.files import claimed

    if not directory.is_dir():
        raise CaseError(f"merge: no such folder: {directory}; give that of the shards with -o DIR")
    with claimed(directory, inputs=inputs, may_hold_results=True):
        data = merge_sweep(sweep, directory, is_partial=is_partial)
    _require_some(data)
    return data


def _require_some(data: xr.Dataset) -> None:
    """Exit with a message if all points of a sweep failed."""
    about = data.attrs
    if not about["n_completed"] and not about["n_missing"]:
        first = next(text for text in data["error"].to_numpy().ravel() if text)
        fail(f"none of the {about['n_points']} points was completed; the first: {first}", FAILED)


def _lost(data: xr.Dataset) -> str | None:
    """Return in words how many points of a sweep were not completed, and why; None: all were."""
    about = data.attrs
    counts = [
        f"{about[f'n_{name}']} {name}" for name in ("failed", "diverged") if about[f"n_{name}"]
    ]
    if not counts:
        return None
    first = next(text for text in data["error"].to_numpy().ravel() if text)
    return (
        f"{' and '.join(counts)} of {about['n_points']} points; the others are in the result. The "
        f"first: {first}"
    )


def print_script(
    sweep: Sweep,
    sweep_file: Path,
    directory: Path,
    overrides: list[str] | None,
    n_shards: int,
    hours: float | None,
) -> None:
    """Measure the time of a point, and print the script of the shards."""
    from delam_fem.studies.sweeps.run import array_script, measured_cost

    command = [sys.executable, "-m", "delam_fem", "sweep", str(sweep_file.resolve())]
    command += ["-o", str(directory.resolve()), *(f"--set={text}" for text in overrides or [])]
    most_hours = DAY if hours is None else hours
    cost = measured_cost(sweep)
    text = array_script(
        sweep, command, n_shards, cost, most_hours=most_hours, interrupted=INTERRUPTED
    )
    typer.echo(text, nl=False)


ExecutorOption = Annotated[
    Literal["process", "mpi", "serial"] | None,
    typer.Option(
        "--executor",
        help="Where to compute points: in processes of this machine, on the ranks of mpiexec "
        "(the default under python -m mpi4py.futures), or one after another in this process.",
    ),
]


def sweep_command(
    sweep_file: Annotated[
        Path, typer.Argument(metavar="SWEEP", help="A sweep file (.toml); see docs/sweeps.md.")
    ],
    output: Folder = None,
    overrides: Overrides = None,
    *,
    resume: Resume = False,
    overwrite: Overwrite = False,
    workers: Workers = None,
    executor: ExecutorOption = None,
    shard: Annotated[
        str | None,
        typer.Option(
            "--shard",
            metavar="K/N",
            help="Compute only the K-th of N shares of the points; --merge joins them.",
        ),
    ] = None,
    merge: Annotated[
        bool, typer.Option("--merge", help="Join the shards in the folder to the result.")
    ] = False,
    partial: Annotated[
        bool,
        typer.Option("--partial", help="With --merge: write what is there if points are missing."),
    ] = False,
    slurm: Annotated[
        int | None,
        typer.Option(
            "--slurm",
            min=1,
            metavar="N",
            help="Print a script that computes N shards as an array of SLURM jobs and merges them.",
        ),
    ] = None,
    hours: Annotated[
        float | None,
        typer.Option(
            "--hours",
            min=0.0,
            metavar="H",
            help="With --slurm: longest time of a job (default: 24).",
        ),
    ] = None,
    dry_run: DryRun = False,
    yes: Yes = False,
    quiet: Quiet = False,
) -> None:
    """Compute a case at many points and write all results to DIR/sweep.nc."""
    way = require_one(shard=shard, merge=merge, slurm=slurm)
    require_fitting(way, {"overwrite": overwrite, "dry_run": dry_run}, partial, hours)
    if way is None:
        check = functools.partial(_shown_only, workers, executor, yes) if dry_run else None
        data, directory = _computed(
            sweep_file, output, overrides, resume=resume, overwrite=overwrite,
            workers=workers, executor=executor, yes=yes, quiet=quiet, check=check,
        )  # fmt: skip
    else:
        sweep, directory, inputs = _opened(sweep_file, output, overrides)
        if slurm is not None:
            print_script(sweep, sweep_file, directory, overrides, slurm, hours)
            return
        if shard is not None:
            compute_shard(
                sweep, directory, shard, inputs, resume=resume, workers=workers,
                executor=executor, is_confirmed=yes, quiet=quiet,
            )  # fmt: skip
            return
        data = merge_shards(sweep, directory, inputs, is_partial=partial)
    from delam_fem.studies.diagrams import blow_warning, is_unsettled, write_page
    from delam_fem.system.written import listed

    if text := blow_warning(data):
        tell(f"warning: {text}")
    if moving := int(is_unsettled(data).sum()):
        tell(
            f"warning: {moving} of {data.attrs['n_completed']} completed points have not "
            'settled; try more time.periods, or time.periods = "settled"'
        )
    with listed(directory):
        page = write_page(data, directory)
    lost = _lost(data)
    data.close()
    say(quiet, [directory / "sweep.nc", page])
    if lost is not None:
        fail(lost, FAILED)


def _shown_only(
    workers: int | None, executor: ExecutorName | None, yes: bool, sweep: Sweep
) -> None:
    """Show what a sweep needs, and end the command."""
    from delam_fem.studies.sweeps.run import require_computable

    show_sweep(sweep, workers)
    require_computable(sweep, executor, workers, is_confirmed=yes)
    raise typer.Exit(DONE)


def diagram_command(
    kind: Annotated[
        Literal["response", "bifurcation", "plane", "lyapunov", "basins"],
        typer.Argument(
            help="response: amplitudes over an axis; bifurcation: stroboscopic points over an "
            "axis; plane: kinds of motion over two axes; lyapunov: largest exponent over one or "
            "two; basins: attractors over two initial conditions."
        ),
    ],
    source: Annotated[
        Path,
        typer.Argument(
            metavar="SWEEP", help="A sweep file (.toml), or a result: a folder or its sweep.nc."
        ),
    ],
    output: Folder = None,
    overrides: Overrides = None,
    *,
    channel: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME",
            help="Channel of record.channels that response and bifurcation show; repeatable "
            "(default: the displacements of all laminae).",
        ),
    ] = None,
    resume: Resume = False,
    overwrite: Overwrite = False,
    workers: Workers = None,
    executor: ExecutorOption = None,
    yes: Yes = False,
    quiet: Quiet = False,
) -> None:
    """Draw a diagram of a sweep; compute the sweep first if its result does not exist."""
    from delam_fem.studies.diagrams import require_drawable, save_diagram, write_page
    from delam_fem.system.written import listed

    if source.suffix == ".toml":
        data, directory = _computed(
            source, output, overrides, resume=resume, overwrite=overwrite, workers=workers,
            executor=executor, yes=yes, quiet=quiet, again=False,
            check=functools.partial(require_drawable, kind, channels=channel or ()),
        )  # fmt: skip
    else:
        data, directory = _read(source, output)
        if left := data.attrs["n_missing"]:
            n_points = data.attrs["n_points"]
            tell(
                f"warning: the sweep is not finished: the diagram shows {n_points - left} of "
                f"{n_points} points; {_go_on(directory)} computes the others"
            )
    with listed(directory):
        paths = [save_diagram(kind, data, directory / f"{kind}.png", channel or ())]
        if (directory / "sweep.nc").is_file():
            paths.append(write_page(data, directory))
    lost = _lost(data) if source.suffix == ".toml" else None
    data.close()
    say(quiet, paths)
    if lost is not None:
        fail(lost, FAILED)


def _computed(
    sweep_file: Path,
    output: Path | None,
    overrides: list[str] | None,
    *,
    resume: bool,
    overwrite: bool,
    workers: int | None,
    executor: ExecutorName | None,
    yes: bool,
    quiet: bool,
    again: bool = True,
    check: Callable[[Sweep], None] | None = None,
) -> tuple[xr.Dataset, Path]:
    """Compute a sweep and show its table; exit with a message if it is not complete.

    `check` looks at the sweep before anything is computed.
    """
    from delam_fem.studies.sweeps import dataset, run
    from delam_fem.system.files import claimed

    sweep, directory, inputs = _opened(sweep_file, output, overrides)
    resume = resume or (not again and not overwrite and dataset.is_complete(directory, sweep))
    may = resume or overwrite
    with claimed(directory, inputs=inputs, may_hold_results=may, is_replacing=overwrite):
        if check is not None:
            check(sweep)
        if overwrite:
            run.require_computable(sweep, executor, workers, is_confirmed=yes, folder=directory)
            dataset.remove_results(directory)
        with progress(error_console(quiet)) as report:
            data = run.run_sweep(
                sweep, directory, executor, workers=workers, resume=resume, progress=report,
                is_confirmed=yes,
            )  # fmt: skip
    about = data.attrs
    rows = [(name, str(about[f"n_{name}"])) for name in dataset.COUNTED]
    if "workers" in about:  # a result without sweep.json does not say it
        rows += [
            ("workers", str(about["workers"])),
            ("wall seconds", f"{about['wall_seconds']:.4g}"),
            ("scheduling overhead", f"{100.0 * about['scheduling_overhead']:.2g} %"),
        ]
    say(quiet, (), tables=[(f"sweep {sweep.file.name}", ("", "value"), rows)])
    if about["outcome"] == "interrupted":
        left = about["n_missing"]
        fail(
            f"interrupted with {left} of {about['n_points']} points left; --resume goes on",
            INTERRUPTED,
        )
    _require_some(data)
    return data, directory


def _opened(
    sweep_file: Path, output: Path | None, overrides: list[str] | None
) -> tuple[Sweep, Path, list[Path]]:
    """Return a sweep, its folder, and the files of the user that it is read from.

    The files sweep.toml and case.toml may be outputs.
    """
    from delam_fem.studies.sweeps.grid import load_sweep

    sweep = load_sweep(sweep_file, overrides_in(overrides))
    base = sweep_file.parent / str(sweep.file.base)
    inputs = [*sweep.base.files.values()]
    inputs += [sweep_file] * (sweep_file.name != "sweep.toml")
    inputs += [base] * (base.is_file() and base.name != "case.toml")
    return sweep, output or Path("runs") / sweep.file.name, inputs


def _go_on(directory: Path) -> str:
    """Return the command that goes on with a sweep."""
    return f"delam-fem sweep {directory / 'sweep.toml'} -o {directory} --resume"


def _points_in(directory: Path) -> str:
    """Return in words how many points the journal of a sweep has."""
    from delam_fem.studies.sweeps.grid import load_sweep
    from delam_fem.studies.sweeps.journal import Journal

    sweep = load_sweep(directory / "sweep.toml")
    path = directory / "sweep.journal"
    with Journal(path, sweep.identity, resume=True) as journal, journal.merged() as merged:
        return f"it has {merged.numbers.size} of {sweep.n_points} points"


def _read(source: Path, output: Path | None) -> tuple[xr.Dataset, Path]:
    """Return the result of a sweep and the folder of its diagrams.

    Raises:
        CaseError: there is no result, the sweep is not finished, or its shards are not merged.
    """
    from delam_fem.studies.sweeps.dataset import open_result

    path = source / "sweep.nc" if source.is_dir() else source
    has_journal = not path.is_file() and (source / "sweep.journal").exists()
    if has_journal and not (source / "sweep.toml").is_file():
        raise CaseError(
            f"show diagram: {source} has shards that are not merged; delam-fem sweep FILE "
            f"--merge -o {source} joins them"
        )
    if has_journal:
        raise CaseError(
            f"show diagram: the sweep in {source} is not finished, {_points_in(source)}; "
            f"{_go_on(source)} goes on with it"
        )
    if not path.is_file():
        raise CaseError(
            f"show diagram: no such file: {path}; expected a sweep file (.toml) or a result of one"
        )
    return open_result(path, is_loaded=True), output or path.parent
