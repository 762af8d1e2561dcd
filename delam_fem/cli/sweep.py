"""Define `delam-fem sweep`, which computes a sweep, and `delam-fem diagram`, which draws one."""

from __future__ import annotations

import functools
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from delam_fem.cli.cases import show_sweep
from delam_fem.cli.console.messages import tell
from delam_fem.cli.console.terminal import (
    DONE,
    FAILED,
    INTERRUPTED,
    error_console,
    fail,
    reported,
    say_files,
    table,
)
from delam_fem.cli.inputs import DryRun, Overrides, Overwrite, Quiet, Workers, Yes, inputs_of
from delam_fem.cli.shards import (
    Hours,
    Merge,
    Partial,
    ShardOption,
    Slurm,
    compute_shard,
    merge_shards,
    print_script,
    require_fitting,
    require_one,
)

if TYPE_CHECKING:
    import xarray as xr

    from delam_fem.studies.executors import ExecutorName
    from delam_fem.studies.sweeps.grid import Sweep

SweepArgument = Annotated[
    Path, typer.Argument(metavar="SWEEP", help="A sweep file (.toml); see docs/sweeps.md.")
]
Source = Annotated[
    Path,
    typer.Argument(
        metavar="SWEEP", help="A sweep file (.toml), or a result: a folder or its sweep.nc."
    ),
]
Kind = Annotated[
    Literal["response", "bifurcation", "plane", "lyapunov", "basins"],
    typer.Argument(
        help="response: amplitudes over an axis; bifurcation: stroboscopic points over an axis; "
        "plane: kinds of motion over two axes; lyapunov: largest exponent over one or two; "
        "basins: attractors over two initial conditions."
    ),
]
Folder = Annotated[
    Path | None,
    typer.Option("-o", "--output", metavar="DIR", help="Folder (default: runs/NAME)."),
]
Resume = Annotated[bool, typer.Option("--resume", help="Continue an interrupted sweep.")]
ExecutorOption = Annotated[
    Literal["process", "mpi", "serial"] | None,
    typer.Option(
        "--executor",
        help="Where to compute points: in processes of this machine, on the ranks of mpiexec "
        "(the default under python -m mpi4py.futures), or one after another in this process.",
    ),
]


def register(app: typer.Typer) -> None:
    """Add the commands to the application."""
    app.command("sweep")(sweep_command)
    app.command("diagram")(diagram_command)


def sweep_command(
    sweep_file: SweepArgument,
    output: Folder = None,
    overrides: Overrides = None,
    *,
    resume: Resume = False,
    overwrite: Overwrite = False,
    workers: Workers = None,
    executor: ExecutorOption = None,
    shard: ShardOption = None,
    merge: Merge = False,
    partial: Partial = False,
    slurm: Slurm = None,
    hours: Hours = None,
    dry_run: DryRun = False,
    yes: Yes = False,
    quiet: Quiet = False,
) -> None:
    """Compute a case at many points and write all results to DIR/sweep.nc."""
    with reported(quiet):
        where = workers, executor
        way = require_one(shard=shard, merge=merge, slurm=slurm)
        require_fitting(way, {"overwrite": overwrite, "dry_run": dry_run}, partial, hours)
        if way is None:
            check = functools.partial(_shown_only, where, yes) if dry_run else None
            going_on = resume, overwrite
            data, directory = _computed(
                sweep_file, output, overrides, going_on, where, quiet, yes=yes, check=check
            )
        else:
            sweep, directory, inputs = _opened(sweep_file, output, overrides)
            if slurm is not None:
                print_script(sweep, sweep_file, directory, overrides, slurm, hours)
                return
            if shard is not None:
                options = {"resume": resume, "is_confirmed": yes, "quiet": quiet}
                compute_shard(sweep, directory, shard, where, inputs, **options)
                return
            data = merge_shards(sweep, directory, inputs, is_partial=partial)
        _finish(data, directory, quiet)


def _shown_only(where: tuple[int | None, ExecutorName | None], yes: bool, sweep: Sweep) -> None:
    """Show what a sweep needs, and end the command."""
    from delam_fem.studies.sweeps.run import require_computable

    workers, executor = where
    show_sweep(sweep, workers)
    require_computable(sweep, executor, workers, is_confirmed=yes)
    raise typer.Exit(DONE)


def _finish(data: xr.Dataset, directory: Path, quiet: bool) -> None:
    """Write the page of a sweep; say what has not settled, and which files there are."""
    from delam_fem.studies.diagrams.axes import is_unsettled
    from delam_fem.studies.diagrams.page import write_page

    if moving := int(is_unsettled(data).sum()):
        tell(
            f"warning: {moving} of {data.attrs['n_completed']} completed points have not settled; "
            'try more time.periods, or time.periods = "settled"'
        )
    page = write_page(data, directory)
    data.close()
    if not quiet:
        say_files([directory / "sweep.nc", page])


def diagram_command(
    kind: Kind,
    source: Source,
    output: Folder = None,
    overrides: Overrides = None,
    *,
    resume: Resume = False,
    overwrite: Overwrite = False,
    workers: Workers = None,
    executor: ExecutorOption = None,
    yes: Yes = False,
    quiet: Quiet = False,
) -> None:
    """Draw a diagram of a sweep; compute the sweep first if its result does not exist."""
    with reported(quiet):
        from delam_fem.studies.diagrams.drawing import require_drawable, save_diagram
        from delam_fem.studies.diagrams.page import write_page

        if source.suffix == ".toml":
            going_on = resume, overwrite
            data, directory = _computed(
                source,
                output,
                overrides,
                going_on,
                (workers, executor),
                quiet,
                yes=yes,
                again=False,
                check=functools.partial(require_drawable, kind),
            )
        else:
            data, directory = _read(source, output)
            if left := data.attrs["n_missing"]:
                n_points = data.attrs["n_points"]
                tell(
                    f"warning: the sweep is not finished: the diagram shows {n_points - left} of "
                    f"{n_points} points; {_go_on(directory)} computes the others"
                )
        paths = [save_diagram(kind, data, directory / f"{kind}.png")]
        if (directory / "sweep.nc").is_file():
            paths.append(write_page(data, directory))
        data.close()
        if not quiet:
            say_files(paths)


def _computed(
    sweep_file: Path,
    output: Path | None,
    overrides: list[str] | None,
    going_on: tuple[bool, bool],
    where: tuple[int | None, ExecutorName | None],
    quiet: bool,
    *,
    yes: bool,
    again: bool = True,
    check: Callable[[Sweep], None] | None = None,
) -> tuple[xr.Dataset, Path]:
    """Compute a sweep and show its table; exit with a message if it is not complete.

    `going_on` says whether to resume and whether to overwrite; `check` looks at the sweep before
    anything is computed.
    """
    from delam_fem.case.claim import claimed
    from delam_fem.cli.console.progress import progress
    from delam_fem.studies.sweeps import merge, run

    sweep, directory, inputs = _opened(sweep_file, output, overrides)
    resume, overwrite = going_on
    if not again and not overwrite and merge.is_complete(directory, sweep):
        resume = True
    workers, executor = where
    claim = claimed(directory, inputs=inputs, may_hold_results=resume or overwrite)
    options: dict[str, Any] = {"workers": workers, "resume": resume, "is_confirmed": yes}
    with claim:
        if check is not None:
            check(sweep)
        if overwrite:
            run.require_computable(sweep, executor, workers, is_confirmed=yes, folder=directory)
            merge.remove_results(directory)
        with progress(error_console(quiet)) as report:
            data = run.run_sweep(sweep, directory, executor, progress=report, **options)
    _tell(data, sweep, quiet)
    return data, directory


def _opened(
    sweep_file: Path, output: Path | None, overrides: list[str] | None
) -> tuple[Sweep, Path, list[Path]]:
    """Return a sweep, its folder, and the files of the user that it is read from."""
    sweep = _sweep_of(sweep_file, overrides)
    return sweep, output or Path("runs") / sweep.file.name, _inputs(sweep_file, sweep)


def _sweep_of(sweep_file: Path, overrides: list[str] | None) -> Sweep:
    """Return the sweep in a file, with the overrides of the command line."""
    from delam_fem.case.overrides import parse_override
    from delam_fem.studies.sweeps.load import load_sweep

    return load_sweep(sweep_file, dict(parse_override(text) for text in overrides or []))


def _tell(data: xr.Dataset, sweep: Sweep, quiet: bool) -> None:
    """Show the table of a sweep; exit with a message if it is not complete."""
    about = data.attrs
    if not quiet:
        table(f"sweep {sweep.file.name}", ("", "value"), _rows(data))
    if about["outcome"] == "interrupted":
        left = about["n_missing"]
        fail(
            f"interrupted with {left} of {about['n_points']} points left; --resume goes on",
            INTERRUPTED,
        )
    if not about["n_completed"]:
        first = next(text for text in data["error"].to_numpy().ravel() if text)
        fail(f"none of the {about['n_points']} points was completed; the first: {first}", FAILED)


def _inputs(sweep_file: Path, sweep: Sweep) -> list[Path]:
    """Return the files of the user that a sweep is read from; sweep.toml may be an output."""
    own = [] if sweep_file.name == "sweep.toml" else [sweep_file]
    base = sweep_file.parent / str(sweep.file.base)
    is_own = base.is_file() and base.name != "case.toml"
    return [*own, *inputs_of(sweep.base), *([base] if is_own else [])]


def _rows(data: xr.Dataset) -> list[tuple[str, str]]:
    """Return the rows of the table that is shown at the end."""
    about = data.attrs
    counted = ("points", "completed", "diverged", "failed", "missing")
    rows = [(name, str(about[f"n_{name}"])) for name in counted]
    if "workers" in about:  # a result without sweep.json does not say it
        rows += [
            ("workers", str(about["workers"])),
            ("wall seconds", f"{about['wall_seconds']:.4g}"),
            ("scheduling overhead", f"{100.0 * about['scheduling_overhead']:.2g} %"),
        ]
    return rows


def _go_on(directory: Path) -> str:
    """Return the command that goes on with a sweep."""
    return f"delam-fem sweep {directory / 'sweep.toml'} -o {directory} --resume"


def _points_in(directory: Path) -> str:
    """Return in words how many points the journal of a sweep has."""
    from delam_fem.studies.sweeps.journal import Journal
    from delam_fem.studies.sweeps.load import load_sweep

    sweep = load_sweep(directory / "sweep.toml")
    path = directory / "sweep.journal"
    with Journal(path, sweep.identity, resume=True) as journal, journal.joined() as joined:
        return f"it has {joined.numbers.size} of {sweep.n_points} points"


def _read(source: Path, output: Path | None) -> tuple[xr.Dataset, Path]:
    """Open the result of a sweep."""
    from delam_fem.case.toml import CaseError
    from delam_fem.studies.sweeps.reading import open_result

    path = source / "sweep.nc" if source.is_dir() else source
    has_journal = not path.is_file() and (source / "sweep.journal").exists()
    if has_journal and not (source / "sweep.toml").is_file():
        raise CaseError(
            f"diagram: {source} has shards that are not merged; delam-fem sweep FILE --merge -o "
            f"{source} joins them"
        )
    if has_journal:
        raise CaseError(
            f"diagram: the sweep in {source} is not finished, {_points_in(source)}; "
            f"{_go_on(source)} goes on with it"
        )
    if not path.is_file():
        raise CaseError(
            f"diagram: no such file: {path}; expected a sweep file (.toml) or a result of one"
        )
    return open_result(path, is_loaded=True), output or path.parent
