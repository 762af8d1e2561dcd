"""Show the messages of the package on the terminal, once each, and keep them in a file.

Every command has `-v` and `--log FILE`, which `with_messages` adds.
"""

from __future__ import annotations

import functools
import inspect
import logging
import shlex
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, get_type_hints

import typer

PACKAGE = "delam_fem"
PROGRESS = f"{PACKAGE}.cli.console.progress"
"""Name of the log of progress, which a file keeps and a terminal sees as a bar."""
COMMAND = f"{PACKAGE}.cli.console.command"
"""Name of the log of begin and end, which a file keeps."""
FORMAT = "%(asctime)s %(levelname)-7s %(message)s"

Verbose = Annotated[
    bool,
    typer.Option("-v", "--verbose", help="Show more messages, e.g. keys that nothing reads."),
]
LogFile = Annotated[
    Path | None,
    typer.Option("--log", metavar="FILE", help="Add all messages, with their times, to a file."),
]


@dataclass(frozen=True)
class Wanted:
    """What a user wants to see.

    Attributes:
        verbose: whether to show messages of the level DEBUG.
        log_file: file that gets all messages; None: none.
    """

    verbose: bool = False
    log_file: Path | None = None


class LogFileError(OSError):
    """Report that the file of `--log` cannot be written."""


_wanted: ContextVar[Wanted | None] = ContextVar("_wanted", default=None)


def with_messages(command: Callable[..., None]) -> Callable[..., None]:
    """Return a command with the options `-v` and `--log` besides its own."""
    hints = get_type_hints(command, include_extras=True)
    own = [
        parameter.replace(annotation=hints[name])
        for name, parameter in inspect.signature(command).parameters.items()
    ]
    kind = inspect.Parameter.KEYWORD_ONLY
    added = [
        inspect.Parameter("verbose", kind, default=False, annotation=Verbose),
        inspect.Parameter("log_file", kind, default=None, annotation=LogFile),
    ]

    @functools.wraps(command)
    def called(*args: Any, verbose: bool, log_file: Path | None, **options: Any) -> None:
        token = _wanted.set(Wanted(verbose, log_file))
        try:
            command(*args, **options)
        finally:
            _wanted.reset(token)

    del called.__wrapped__  # typer reads the parameters of the function below all wrappers
    called.__annotations__ = hints | {"verbose": Verbose, "log_file": LogFile}
    called.__signature__ = inspect.Signature([*own, *added])  # type: ignore[attr-defined]
    return called


@contextmanager
def shown(*, quiet: bool, is_first: bool) -> Iterator[None]:
    """Show messages on stderr, and add them to the file that the user wants.

    Args:
        quiet: whether only warnings are shown.
        is_first: whether this is the first process of mpirun, which alone writes the file.

    Raises:
        LogFileError: the file cannot be written.
    """
    wanted, log = _wanted.get() or Wanted(), logging.getLogger(PACKAGE)
    level = logging.DEBUG if wanted.verbose else logging.WARNING if quiet else logging.INFO
    handlers: list[logging.Handler] = [_Screen(level)]
    if wanted.log_file is not None and is_first:
        handlers.append(_file(wanted.log_file))
    before = log.level, log.propagate
    log.propagate = False  # FFCx gives the root logger a handler
    log.setLevel(logging.DEBUG if len(handlers) > 1 else level)
    for handler in handlers:
        log.addHandler(handler)
    command, begin = command_log(), time.perf_counter()
    command.debug("begin: %s", shlex.join(sys.argv))
    try:
        yield
    finally:
        command.debug("end after %.1f s", time.perf_counter() - begin)
        log.propagate = before[1]
        log.setLevel(before[0])
        for handler in handlers:
            log.removeHandler(handler)
            handler.close()


def command_log() -> logging.Logger:
    """Return the log of begin and end of a command."""
    return logging.getLogger(COMMAND)


def tell(text: str) -> None:
    """Write a line to stderr; above a progress bar if there is one, which replaces `sys.stderr`."""
    sys.stderr.write(f"{text}\n")


def _file(path: Path) -> logging.Handler:
    """Return a handler that adds messages to a file."""
    try:
        handler = logging.FileHandler(path, "a", encoding="utf-8")
    except OSError as error:
        raise LogFileError(f"--log {path}: cannot be written ({error.strerror})") from None
    handler.setFormatter(logging.Formatter(FORMAT))
    return handler


class _Screen(logging.Handler):
    """Handler that writes to stderr, each text once, however many processes say it."""

    def __init__(self, level: int) -> None:
        """Store the least level."""
        super().__init__(level)
        self._said: set[str] = set()

    def filter(self, record: logging.LogRecord) -> bool:
        """Return whether a record is for the terminal: neither progress nor begin and end."""
        return record.name not in (PROGRESS, COMMAND)

    def emit(self, record: logging.LogRecord) -> None:
        """Write one record, unless it has been written."""
        text = self.format(record)
        if text not in self._said:
            self._said.add(text)
            tell(f"warning: {text}" if record.levelno == logging.WARNING else text)
