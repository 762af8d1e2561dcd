"""The command `delam-fem`: reads the case, calls the package, reports, sets the exit status.

Modules with heavy imports (dolfinx, matplotlib) are imported by the command that needs them.
"""

from __future__ import annotations

import logging
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, NoReturn

import typer

if TYPE_CHECKING:
    from delam_fem.parameters import Case

DONE, FAILED, BAD_INPUT, INTERRUPTED = 0, 1, 2, 130

STATUS = {"completed": DONE, "diverged": FAILED, "interrupted": INTERRUPTED}
"""Exit status by the outcome of a run."""

HINT = {"diverged": "", "interrupted": "; --resume goes on from there"}
"""What a user can do about an outcome; why a run diverged is in its log."""

app = typer.Typer(
    no_args_is_help=True,
    invoke_without_command=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)

CaseArgument = Annotated[
    str, typer.Argument(metavar="CASE", help="A preset by name, or a case file (.toml).")
]
Overrides = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="KEY=VALUE",
        help="Override a key of the case, e.g. excitation.frequency=3.65; repeatable. "
        "KEY= alone removes an optional key.",
    ),
]
Folder = Annotated[
    Path | None, typer.Option("-o", "--output", metavar="DIR", help="Folder of the results.")
]
Quiet = Annotated[bool, typer.Option("-q", "--quiet", help="No progress, no table.")]


@app.callback()
def main(
    version: Annotated[bool, typer.Option("--version", help="Show the version and leave.")] = False,
) -> None:
    """Two delaminated laminae that clap under base motion, by finite elements."""
    if version:
        from delam_fem import __version__

        typer.echo(__version__)
        raise typer.Exit()


@app.command("run")
def run_command(
    case_name: CaseArgument,
    output: Folder = None,
    overrides: Overrides = None,
    *,
    engine: Annotated[
        Literal["petsc", "compiled"], typer.Option(help="What computes the steps.")
    ] = "petsc",
    resume: Annotated[
        bool, typer.Option("--resume", help="Go on with an interrupted run.")
    ] = False,
    quiet: Quiet = False,
) -> None:
    """Compute a case; results go to DIR (runs/NAME)."""
    with _reported(quiet):
        case = _case(case_name, overrides)
        directory = _writable(output or Path("runs") / case.name)
        from rich.console import Console

        from delam_fem.progress import progress
        from delam_fem.run import run

        quiet = quiet or not _is_first_process()
        with progress(Console(stderr=True, quiet=quiet), case.time.steps_per_period) as report:
            result = run(case, engine, directory=directory, resume=resume, progress=report)
        result.save(directory)
        if not quiet:
            _table(f"case {case.name}", ("", "value"), _summary_rows(result.summary))
            _list_files(directory)
        outcome = result.history.attrs["outcome"]
        if outcome != "completed":
            _fail(
                f"{outcome}; the results so far are in {directory}{HINT[outcome]}", STATUS[outcome]
            )


@app.command("compare")
def compare_command(
    case_name: CaseArgument,
    output: Folder = None,
    overrides: Overrides = None,
    *,
    impacts: Annotated[
        int, typer.Option(metavar="N", help="Compare the tip histories up to the N-th impact.")
    ] = 20,
    periods: Annotated[int, typer.Option(metavar="N", help="Length of both runs.")] = 3,
    quiet: Quiet = False,
) -> None:
    """Compare dolfinx and PETSc with the independent reference."""
    with _reported(quiet):
        case = _case(case_name, overrides)
        directory = _writable(output or Path("runs") / f"{case.name}-compare")
        from delam_fem.compare import compare

        comparison = compare(case, impacts=impacts, periods=periods)
        paths = comparison.save(directory)
        if not quiet:
            _table("largest differences", ("what", "difference"), comparison.rows())
            _say_files(paths)


@app.command("modes")
def modes_command(
    case_name: CaseArgument,
    output: Folder = None,
    overrides: Overrides = None,
    *,
    count: Annotated[
        int, typer.Option("-n", "--number", metavar="N", help="Modes per lamina.")
    ] = 6,
    quiet: Quiet = False,
) -> None:
    """List natural frequencies beside those of the exact cantilever."""
    with _reported(quiet):
        case = _case(case_name, overrides)
        directory = _writable(output or Path("runs") / f"{case.name}-modes")
        from delam_fem.modes import modes

        found = modes(case, count)
        paths = found.save(directory)
        if not quiet:
            heading = ("lamina", "mode", "computed [Hz]", "exact [Hz]", "relative difference")
            _table(f"modes of case {case.name}", heading, found.rows())
            _say_files(paths)


@app.command("presets")
def presets_command(
    show: Annotated[
        str | None, typer.Option(metavar="NAME", help="Print this preset as a case file.")
    ] = None,
) -> None:
    """List the presets, or print one as a start for a case file."""
    with _reported():
        from delam_fem.parameters import PRESETS, preset_text

        typer.echo("\n".join(PRESETS) if show is None else preset_text(show), nl=show is None)


def _is_first_process() -> bool:
    """Whether this is the process that speaks, of those that mpirun may have started."""
    from mpi4py import MPI

    rank: int = MPI.COMM_WORLD.rank
    return rank == 0


def _case(name: str, overrides: list[str] | None) -> Case:
    """Return the case of a preset or a file, with the overrides of the command line."""
    from delam_fem.casefile import parse_override
    from delam_fem.parameters import PRESETS, CaseError, load_case, preset

    keys = dict(parse_override(text) for text in overrides or [])
    path = Path(name)
    if path.suffix == ".toml" or path.is_file() or len(path.parts) > 1:
        return load_case(path, keys)
    if name not in PRESETS:
        raise CaseError(
            f"case {name!r}: neither a file nor a preset; expected a case file (.toml) or one of "
            f"{', '.join(PRESETS)}"
        )
    return preset(name, keys)


def _writable(directory: Path) -> Path:
    """Make a folder and see that files can be written there, before any work is done."""
    from delam_fem.parameters import CaseError

    try:
        directory.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=directory):
            pass
    except OSError as error:
        raise CaseError(
            f"output folder {directory}: cannot be written ({error.strerror}); choose another "
            "with -o DIR"
        ) from None
    return directory


@contextmanager
def _reported(quiet: bool = False) -> Iterator[None]:
    """Turn errors into a message on stderr and an exit status; show the package's log."""
    from delam_fem.parameters import CaseError

    log = logging.getLogger("delam_fem")
    handler = _EchoHandler()
    log.addHandler(handler)
    log.setLevel(logging.WARNING if quiet else logging.INFO)
    try:
        yield
    except CaseError as error:
        _fail(str(error), BAD_INPUT)
    except OSError as error:
        log.debug("where it failed", exc_info=True)
        _fail(f"{error.filename or 'input or output'}: {error.strerror or error}", FAILED)
    except KeyboardInterrupt:
        _fail("interrupted", INTERRUPTED)
    finally:
        log.removeHandler(handler)


class _EchoHandler(logging.Handler):
    """Writes the log to stderr, whatever that is at the moment."""

    def emit(self, record: logging.LogRecord) -> None:
        """Write one record."""
        typer.echo(self.format(record), err=True)


def _fail(text: str, status: int) -> NoReturn:
    """Leave with a message."""
    typer.echo(f"delam-fem: {text}", err=True)
    raise typer.Exit(status)


def _table(title: str, heading: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Print a table to stdout."""
    from rich.console import Console
    from rich.table import Table

    table = Table(title=title, title_justify="left")
    for column in heading:
        table.add_column(column)
    for row in rows:
        table.add_row(*row)
    Console().print(table)


def _summary_rows(summary: dict[str, object]) -> list[tuple[str, str]]:
    """Return the summary as table rows."""
    return [(key.replace("_", " "), _shown(value)) for key, value in summary.items()]


def _shown(value: object) -> str:
    """Return a value of the summary as text."""
    if isinstance(value, list | tuple):
        return ", ".join(_shown(entry) for entry in value)
    if isinstance(value, float):
        return f"{value:.4g}"
    return "none" if value is None else str(value)


def _list_files(directory: Path) -> None:
    """Say where the results are."""
    names = (
        "result.nc",
        "summary.json",
        "case.toml",
        "figures",
        "fields/fields.pvd",
        "report.html",
    )
    _say_files([directory / name for name in names if (directory / name).exists()])


def _say_files(paths: Sequence[Path]) -> None:
    """Print paths."""
    for path in paths:
        typer.echo(path)


if __name__ == "__main__":
    app()
