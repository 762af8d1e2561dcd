"""What commands share: arguments, the case with its overrides, the folder, and what they say.

The messages of the package appear on the terminal once each, and a file keeps them. Every command
has `-v` and `--log FILE`, which `with_messages` adds.

A command stays alive when nobody reads its output any more. A reader may go away (`… | head`), a
terminal may be closed, a disk may be full. What cannot be written is dropped; the computation and
its files go on.
"""

from __future__ import annotations

import atexit
import functools
import inspect
import io
import logging
import os
import select
import shlex
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NoReturn, TextIO, TypeAlias, get_type_hints

import typer
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from delam_fem.cli.endings import BAD_INPUT, explained, tell
from delam_fem.cli.ranks import Use, launched, on_ranks
from delam_fem.system.errors import CaseError

if TYPE_CHECKING:
    from delam_fem.case.definition import Case

CaseArgument = Annotated[
    str, typer.Argument(metavar="CASE", help="A preset by name, or a case file (.toml).")
]
Overrides = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="KEY=VALUE",
        help="Override a key of the case, e.g. excitation.frequency=3.65; repeatable. "
        "KEY= without a value removes an optional key.",
    ),
]
Folder = Annotated[
    Path | None,
    typer.Option(
        "-o", "--output", metavar="DIR",
        help="Folder of the results (default: runs/NAME, or runs/NAME-COMMAND).",
    ),
]  # fmt: skip
Workers = Annotated[
    int | None,
    typer.Option("-j", "--workers", min=1, metavar="N", help="Processes (default: one per core)."),
]
Resume = Annotated[bool, typer.Option("--resume", help="Continue what was interrupted.")]
Overwrite = Annotated[
    bool, typer.Option("--overwrite", help="Replace other results in the folder.")
]
OverwriteFile = Annotated[
    bool, typer.Option("--overwrite", help="Replace the file if there is one.")
]
Yes = Annotated[
    bool, typer.Option("--yes", help="Compute also what needs many hours or much space.")
]
DryRun = Annotated[
    bool,
    typer.Option(
        "--dry-run", help="Check everything and tell what it needs; compute and write nothing."
    ),
]
Quiet = Annotated[bool, typer.Option("-q", "--quiet", help="Show no progress, no table.")]


def case_of(name: str, overrides: list[str] | None) -> Case:
    """Return the case of a preset or a case file, with the overrides of the command line.

    A number that looks like a mistake in a unit is told.
    """
    from delam_fem.case.files import find_case
    from delam_fem.case.plausible import tell

    keys = overrides_in(overrides)
    case = find_case(name, keys)
    window = keys.get("output.window_periods")
    longest = case.n_periods
    if case.is_periodic and isinstance(window, int) and window > longest:
        raise CaseError(
            f"override output.window_periods: expected at most the {longest} periods of the run, "
            f"given {window}"
        )
    tell(case)
    return case


def overrides_in(texts: list[str] | None) -> dict[str, object]:
    """Return the values of `--set` by their keys."""
    from delam_fem.case.toml import parse_override

    return dict(parse_override(text) for text in texts or [])


def require_one(**given: object) -> str | None:
    """Return which of some options is given; None if none is.

    Args:
        given: options by name, without `--`.

    Raises:
        CaseError: several are given.
    """
    names = [f"--{name}" for name, value in given.items() if value not in (None, False)]
    if len(names) > 1:
        raise CaseError(f"expected one of {' and '.join(names)}, given both")
    return names[0].removeprefix("--") if names else None


Report: TypeAlias = Callable[[int, int], None]
"""Function of the numbers of finished and of all periods (or points, in a sweep), called after each
period (or chunk of points)."""

LINES = 10
"""Number of plain lines per run, unless the run is slow."""

SILENCE = 10.0
"""Longest time between two plain lines [s]."""

_log = logging.getLogger(__name__)


@contextmanager
def progress(console: Console, steps_per_period: int = 0) -> Iterator[Report]:
    """Show the progress of a run on a console.

    Args:
        console: console for the output; a terminal shows a bar.
        steps_per_period: number of steps per period, for the rate; 0: count points of a sweep
            instead of periods.

    Yields:
        The function to call with the numbers of finished and of all periods (or points).
    """
    log = logging.getLogger(PROGRESS)

    def say(line: str) -> None:
        console.print(line, soft_wrap=True)
        log.debug(line)

    if console.quiet or not console.is_terminal:  # a quiet bar would still hide the cursor
        yield PlainProgress(say, steps_per_period)
        return
    logged = PlainProgress(log.debug, steps_per_period)
    columns = (
        TextColumn(_unit(steps_per_period) + " {task.completed:.0f} of {task.total:.0f}"),
        BarColumn(),
        TextColumn("{task.fields[rate]}"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=console, transient=True) as bar:

        def report(done: int, total: int) -> None:
            if not bar.tasks:  # a resumed run does not start at 0
                bar.add_task("run", total=total, completed=done, rate="")
            task = bar.tasks[0]
            rate = _rate(task.speed, steps_per_period) if task.speed else ""
            bar.update(task.id, completed=done, rate=rate)
            logged(done, total)

        yield report


def _unit(steps_per_period: int) -> str:
    """Return what progress counts, periods or points, as a word."""
    return "period" if steps_per_period else "point"


def _rate(per_second: float, steps_per_period: int) -> str:
    """Return a rate of periods or points as text."""
    if not steps_per_period:
        return f"{per_second:,.4g} points/s"
    return f"{per_second * steps_per_period:,.0f} steps/s"


class PlainProgress:
    """Print a line at every tenth of the run, and at least every ten seconds.

    Attributes:
        say: function that prints a line.
        steps_per_period: number of steps per period, for the rate; 0: count points.
    """

    def __init__(
        self,
        say: Callable[[str], None],
        steps_per_period: int,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Store the arguments; the first call sets the start, because a resumed run is past 0."""
        self.say = say
        self.steps_per_period = steps_per_period
        self._clock = clock
        self._start: tuple[float, int] | None = None
        self._said: tuple[float, int] = (0.0, 0)

    def __call__(self, done: int, total: int) -> None:
        """Count a finished period, and print a line if one is due."""
        now = (self._clock(), done)
        if self._start is None:
            self._start = self._said = now
        is_next_tenth = done * LINES // total > self._said[1] * LINES // total
        if done == total or is_next_tenth or now[0] - self._said[0] >= SILENCE:
            self._said = now
            unit = _unit(self.steps_per_period)
            self.say(f"{unit} {done} of {total}{self._rate(self._start, now, total)}")

    def _rate(self, start: tuple[float, int], now: tuple[float, int], total: int) -> str:
        """Return the rate and the remaining time as text; empty until they are known."""
        seconds = now[0] - start[0]
        periods = now[1] - start[1]
        if seconds <= 0.0 or periods <= 0:
            return ""
        left = (total - now[1]) * seconds / periods
        return f", {_rate(periods / seconds, self.steps_per_period)}, {left:.0f} s left"


PACKAGE = "delam_fem"
PROGRESS = f"{PACKAGE}.cli.console.progress"
"""Name of the log of progress, which a file keeps and a terminal sees as a bar."""
_command_log = logging.getLogger(f"{PACKAGE}.cli.console.command")
"""The log of begin and end, which a file keeps."""
FORMAT = "%(asctime)s %(levelname)-7s %(message)s"

Verbose = Annotated[
    bool,
    typer.Option("-v", "--verbose", help="Show more messages, e.g. keys that nothing reads."),
]
LogFile = Annotated[
    Path | None,
    typer.Option("--log", metavar="FILE", help="Add all messages, with their times, to a file."),
]


def with_messages(
    command: Callable[..., None], words: str = "", use: Use = "nothing"
) -> Callable[..., None]:
    """Return a command within `reported`, with the options `-v` and `--log` besides its own.

    Args:
        command: the command.
        words: its words.
        use: what several processes of MPI share of its work.
    """
    hints = get_type_hints(command, include_extras=True)
    arguments = inspect.signature(command).parameters
    parameters = {name: (hints[name], parameter.default) for name, parameter in arguments.items()}

    @functools.wraps(command)
    def called(*args: Any, verbose: bool, log_file: Path | None, **options: Any) -> None:
        def reporting(work: Callable[[], None]) -> None:
            with reported(options.get("quiet", False), verbose, log_file):
                work()

        comm = launched()
        on_ranks(words, use, comm, reporting, lambda: command(*args, **options))

    del called.__wrapped__  # typer reads the parameters of the function below all wrappers
    take(called, parameters | {"verbose": (Verbose, False), "log_file": (LogFile, None)})
    return called


def take(command: Callable[..., None], parameters: Mapping[str, tuple[Any, Any]]) -> None:
    """Tell typer which parameters a command takes: type and default of each."""
    command.__annotations__ = {name: hint for name, (hint, _) in parameters.items()}
    command.__signature__ = inspect.Signature(  # type: ignore[attr-defined]
        [
            inspect.Parameter(
                name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=hint
            )
            for name, (hint, default) in parameters.items()
        ]
    )


@contextmanager
def shown(level: int, log_file: Path | None) -> Iterator[None]:
    """Show messages of at least a level on stderr, and add all of them to a file.

    Raises:
        Exit: the file cannot be written.
    """
    log = logging.getLogger(PACKAGE)
    handlers = list[logging.Handler]([_Screen(level)])
    if log_file is not None:
        try:
            handlers.append(logging.FileHandler(log_file, "a", encoding="utf-8"))
        except OSError as error:
            fail(f"--log {log_file}: cannot be written ({error.strerror})", BAD_INPUT)
        handlers[-1].setFormatter(logging.Formatter(FORMAT))
    before = log.level, log.propagate
    log.propagate = False  # FFCx gives the root logger a handler
    log.setLevel(logging.DEBUG if len(handlers) > 1 else level)
    for handler in handlers:
        log.addHandler(handler)
    begin = time.perf_counter()
    _command_log.debug("begin: %s", shlex.join(sys.argv))
    try:
        yield
    finally:
        _command_log.debug("end after %.1f s", time.perf_counter() - begin)
        log.propagate = before[1]
        log.setLevel(before[0])
        for handler in handlers:
            log.removeHandler(handler)
            handler.close()


class _Screen(logging.Handler):
    """Handler that writes to stderr, each text once, however many processes say it."""

    def __init__(self, level: int) -> None:
        """Store the least level."""
        super().__init__(level)
        self._said: set[str] = set()

    def filter(self, record: logging.LogRecord) -> bool:
        """Return whether a record is for the terminal: neither progress nor begin and end."""
        return record.name not in (PROGRESS, _command_log.name)

    def emit(self, record: logging.LogRecord) -> None:
        """Write one record, unless it has been written."""
        text = self.format(record)
        if text not in self._said:
            self._said.add(text)
            tell(f"warning: {text}" if record.levelno == logging.WARNING else text)


@contextmanager
def lasting_streams() -> Iterator[None]:
    """Replace stdout and stderr by unbuffered streams whose writes never fail."""
    _fill_closed()
    before = sys.stdout, sys.stderr
    sys.stdout, sys.stderr = _lasting(sys.stdout, 1), _lasting(sys.stderr, 2)
    try:
        yield
    finally:
        colours = sys.modules.get("colorama.initialise")  # numba's, which would reset the terminal
        if colours is not None:
            atexit.unregister(colours.reset_all)
        sys.stdout = before[0] or sys.stdout
        sys.stderr = before[1] or sys.stderr


def _fill_closed() -> None:
    """Open the null device as each standard stream that is closed.

    Otherwise the next file that is opened would get its number, and messages would go there.
    """
    for number in (0, 1, 2):  # stdin, stdout, stderr
        try:
            os.fstat(number)
        except OSError:
            opened = os.open(os.devnull, os.O_RDWR)
            if opened != number:
                os.dup2(opened, number)
                os.close(opened)


def _lasting(stream: TextIO | None, number: int) -> TextIO:
    """Return a stream whose writes never fail; a stream that is no descriptor is left alone."""
    if stream is not None:
        try:
            number = stream.fileno()
        except (OSError, ValueError):  # captured in memory
            return stream
        with suppress(OSError):
            stream.flush()
    encoding = getattr(stream, "encoding", None) or "utf-8"
    # a raw stream in the place of a buffer, as `python -u` has it; the descriptor stays open
    raw: Any = _Lasting(number, "wb", closefd=False)
    return io.TextIOWrapper(raw, encoding, "backslashreplace", write_through=True)


class _Lasting(io.FileIO):
    """The raw stream of a descriptor; after a failure it writes to the null device."""

    def write(self, data: bytes) -> int:  # type: ignore[override]
        """Write data; drop what cannot be written."""
        view = memoryview(data).cast("B")
        size = len(view)
        while len(view):
            try:
                view = view[os.write(self.fileno(), view) :]
            except BlockingIOError:
                select.select([], [self.fileno()], [])
            except OSError:
                null = os.open(os.devnull, os.O_WRONLY)
                os.dup2(null, self.fileno())
                os.close(null)
        return size


LONGEST = 1000
"""Longest line of a message, in characters."""


@contextmanager
def reported(quiet: bool, verbose: bool, log_file: Path | None) -> Iterator[None]:
    """Show the log of the package, and turn errors into a message and an exit status.

    Ctrl-C, SIGTERM and a closed terminal end the command; output that nobody reads does not.

    Args:
        quiet: whether only warnings are shown.
        verbose: whether messages of the level DEBUG are shown.
        log_file: file that gets all messages of the first process of mpirun; None: none.
    """
    from delam_fem.simulation.checkpoint import interruptible

    level = logging.DEBUG if verbose else logging.WARNING if quiet else logging.INFO
    with lasting_streams(), shown(level, None if _rank() else log_file):
        try:
            with interruptible():
                yield
        except typer.Exit:
            raise
        except (Exception, KeyboardInterrupt) as error:
            explanation = explained(error)
            if explanation is None:
                _log.exception("this is a defect of the program")
                raise
            if isinstance(error, OSError):
                _log.debug("an input or output failed here", exc_info=True)
            fail(*explanation)


def fail(text: str, status: int) -> NoReturn:
    """Print a message to stderr and exit with a status."""
    lines = [shortened(line) for line in f"delam-fem: {text}".splitlines()]
    tell("\n".join(lines))
    _command_log.info("exit status %d: %s", status, " ".join(lines))
    raise typer.Exit(status)


def shortened(line: str) -> str:
    """Return a line without the middle if it is very long, and without control characters."""
    printable = "".join(c if c.isprintable() else "\N{REPLACEMENT CHARACTER}" for c in line)
    half = LONGEST // 2
    return printable if len(printable) <= LONGEST else f"{printable[:half]} … {printable[-half:]}"


def _rank() -> int:
    """Return the number of this process under mpirun or srun; 0 without."""
    ranks = (os.environ.get(name) for name in ("OMPI_COMM_WORLD_RANK", "PMIX_RANK", "PMI_RANK"))
    return next((int(rank) for rank in ranks if rank is not None), 0)


def error_console(quiet: bool) -> Console:
    """Return the console of stderr, for progress."""
    return Console(stderr=True, quiet=quiet)


Rows: TypeAlias = tuple[str, Sequence[str], Iterable[Sequence[str]]]
"""Title, heading and rows of a table."""


def table(title: str, heading: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    """Print a table to stdout."""
    table = Table(*heading, title=title, title_justify="left")
    for row in rows:
        table.add_row(*row)
    Console(markup=False).print(table)  # units stand in brackets


def say(
    quiet: bool,
    files: Iterable[Path],
    *,
    tables: Iterable[Rows] = (),
    lines: Iterable[str] = (),
) -> None:
    """Print what a command has found: tables, lines of text, and paths of the written files.

    If nothing shall be said, no entry is asked for, so that generators need not compute it.
    """
    if not quiet:
        for each in tables:
            table(*each)
        for text in (*lines, *files):
            typer.echo(text)
