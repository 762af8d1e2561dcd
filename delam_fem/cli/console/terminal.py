"""Print tables to stdout, messages and the log to stderr, and set the exit status."""

from __future__ import annotations

import logging
import os
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

import typer

from delam_fem.cli.console.messages import LogFileError, command_log, shown, tell
from delam_fem.cli.console.streams import lasting_streams

if TYPE_CHECKING:
    from rich.console import Console

DONE, FAILED, BAD_INPUT, INTERRUPTED = 0, 1, 2, 130
"""Exit statuses of the command."""

PATIENCE = 3.0
"""Time after which another process than the first tells its error [s]."""

LONGEST = 1000
"""Longest line of a message, in characters."""

_log = logging.getLogger(__name__)


@contextmanager
def reported(quiet: bool = False) -> Iterator[None]:
    """Show the log of the package, and turn errors into a message and an exit status.

    Ctrl-C, SIGTERM and a closed terminal end the command; output that nobody reads does not.
    """
    from delam_fem.simulation.interrupts import interruptible

    with lasting_streams(), _messages(quiet):
        try:
            with interruptible():
                yield
        except typer.Exit:
            raise
        except (Exception, KeyboardInterrupt) as error:
            found = explained(error)
            if found is None:
                _log.exception("this is a defect of the program")
                raise
            if isinstance(error, OSError):
                _log.debug("an input or output failed here", exc_info=True)
            fail(*found)


@contextmanager
def _messages(quiet: bool) -> Iterator[None]:
    """Show messages; exit if the file for them cannot be written."""
    try:
        with shown(quiet=quiet, is_first=_rank() == 0):
            yield
    except LogFileError as error:
        fail(str(error), BAD_INPUT)


def explained(error: BaseException) -> tuple[str, int] | None:
    """Return the message and the exit status for an error; None for a defect of the program."""
    from delam_fem.case.toml import CaseError

    if isinstance(error, CaseError):
        return str(error), BAD_INPUT
    if isinstance(error, MemoryError):
        return f"not enough memory ({error or 'no more is to be had'})", FAILED
    if isinstance(error, OSError):
        reason = error.strerror or str(error)
        return f"{error.filename or 'input or output'}: {reason}", FAILED
    return ("interrupted", INTERRUPTED) if isinstance(error, KeyboardInterrupt) else None


def fail(text: str, status: int) -> NoReturn:
    """Print a message to stderr and exit with a status."""
    let_the_first_speak()
    lines = [_shortened(line) for line in f"delam-fem: {text}".splitlines()]
    tell("\n".join(lines))
    command_log().info("exit status %d: %s", status, " ".join(lines))
    raise typer.Exit(status)


def _shortened(line: str) -> str:
    """Return a line without the middle if it is very long, and without control characters."""
    shown = "".join(c if c.isprintable() else "\N{REPLACEMENT CHARACTER}" for c in line)
    half = LONGEST // 2
    return shown if len(shown) <= LONGEST else f"{shown[:half]} … {shown[-half:]}"


def let_the_first_speak() -> None:
    """Wait a moment unless this is the first process of mpirun, which ends all after an error.

    An error that all processes have is therefore told once.
    """
    if _rank():
        time.sleep(PATIENCE)


def _rank() -> int:
    """Return the number of this process under mpirun; 0 without."""
    return int(os.environ.get("OMPI_COMM_WORLD_RANK", os.environ.get("PMI_RANK", "0")))


def error_console(quiet: bool) -> Console:
    """Return the console of stderr, for progress."""
    from rich.console import Console

    return Console(stderr=True, quiet=quiet)


def table(title: str, heading: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Print a table to stdout."""
    from rich.console import Console
    from rich.table import Table

    table = Table(title=title, title_justify="left")
    for column in heading:
        table.add_column(column)
    for row in rows:
        table.add_row(*row)
    Console(markup=False).print(table)  # units stand in brackets


def summary_rows(summary: Mapping[str, object]) -> list[tuple[str, str]]:
    """Return the summary of a run as rows of a table."""
    told = ("warnings", "message")  # on stderr
    return [
        (key.replace("_", " "), _shown(value)) for key, value in summary.items() if key not in told
    ]


def _shown(value: object) -> str:
    """Return a value of the summary as text."""
    if isinstance(value, Mapping):
        return ", ".join(f"{key} {_shown(entry)}" for key, entry in value.items())
    if isinstance(value, list | tuple):
        return ", ".join(_shown(entry) for entry in value)
    if isinstance(value, float):
        return f"{value:.4g}"
    return "none" if value is None else str(value)


def say_files(paths: Sequence[Path]) -> None:
    """Print the paths of written files."""
    for path in paths:
        typer.echo(path)
