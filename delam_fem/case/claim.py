"""Take a folder for the results of one process, and refuse a folder that holds others.

The lock is on the folder itself, so that a process that is killed leaves nothing behind.
"""

from __future__ import annotations

import errno
import fcntl
import logging
import os
from collections.abc import Collection, Iterator
from contextlib import contextmanager, nullcontext
from contextvars import ContextVar
from pathlib import Path

from delam_fem.case.toml import CaseError

OUTPUTS = frozenset({
    "case.toml", "checkpoint.npz", "state.npz", "result.nc", "summary.json", "report.html",
    "figures", "fields", "sweep.toml", "sweep.nc", "sweep.json", "sweep.journal",
    "convergence.json", "tables.md", "detection.json",
    "orbit.json", "orbit.npz", "branch.nc", "points", "checkpoints",
})  # fmt: skip
"""Names that runs, sweeps, ladders, orbits and branches give to what they write."""

_log = logging.getLogger(__name__)
_held: ContextVar[frozenset[Path]] = ContextVar("_held", default=frozenset())
"""The folders that this thread has locked."""


@contextmanager
def claimed(
    directory: Path,
    *,
    inputs: Collection[Path] = (),
    may_hold_results: bool = False,
    is_shared: bool = False,
) -> Iterator[Path]:
    """Make and lock a folder; no other process can claim it until the context ends.

    A folder that this call has made is removed again if the input turns out to be bad or nothing
    was written.

    Args:
        directory: the folder.
        inputs: files of the user that the command reads; they may lie in the folder, but must not
            be called like an output there.
        may_hold_results: whether the folder may hold files, because the user asked to go on with
            them or to replace them.
        is_shared: whether other processes write to the folder at the same time, each to files of
            its own; nothing is locked then.

    Yields:
        The folder.

    Raises:
        CaseError: the folder cannot be made or written, another process has claimed it, it is not
            empty, or an output would replace an input.
    """
    made = _make(directory)
    try:
        with nullcontext() if is_shared else _locked(directory):
            _spare(directory, inputs)
            if not (may_hold_results or is_shared):
                _require_empty(directory, inputs)
            yield directory
    finally:
        _remove_empty(made)


def _make(directory: Path) -> list[Path]:
    """Make a folder and its parents; return those that are new, innermost first."""
    new = [path for path in (directory, *directory.parents) if not path.exists()]
    try:
        directory.mkdir(parents=True, exist_ok=True)
        if not os.access(directory, os.W_OK | os.X_OK):
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))
    except OSError as error:
        _remove_empty(new)
        raise CaseError(
            f"output folder {directory}: cannot be written ({error.strerror}); choose another "
            "with -o DIR"
        ) from None
    return new


def _remove_empty(folders: list[Path]) -> None:
    """Remove folders that are empty, innermost first."""
    for folder in folders:
        try:
            folder.rmdir()
        except OSError:
            return


@contextmanager
def _locked(directory: Path) -> Iterator[None]:
    """Hold the lock of a folder; a file system without locks is used without.

    A command and the run within it, in one thread, hold it together.
    """
    real = directory.resolve()
    if real in _held.get():
        yield
        return
    handle = os.open(directory, os.O_RDONLY | os.O_DIRECTORY)
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise CaseError(
                f"output folder {directory}: another process is writing there; wait for it, or "
                "choose another with -o DIR"
            ) from None
        except OSError as error:  # some network file systems
            _log.debug("%s cannot be locked (%s)", directory, error.strerror)
        token = _held.set(_held.get() | {real})
        try:
            yield
        finally:
            _held.reset(token)
    finally:
        os.close(handle)


def _spare(directory: Path, inputs: Collection[Path]) -> None:
    """Refuse a folder in which an output would replace an input."""
    home = directory.resolve()
    for path in inputs:
        real = path.resolve()
        if home in real.parents and real.relative_to(home).parts[0] in OUTPUTS:
            raise CaseError(
                f"output folder {directory}: the results would replace {path}, which the case "
                "reads; choose another folder with -o DIR, or rename the file"
            )


def _require_empty(directory: Path, inputs: Collection[Path]) -> None:
    """Refuse a folder with files that are neither inputs nor left over from a killed process."""
    known = {path.resolve() for path in inputs}
    found = sorted(
        entry.name
        for entry in directory.iterdir()
        if not entry.name.startswith(".") and entry.resolve() not in known
    )
    if found:
        shown = ", ".join(found[:3]) + (" …" if len(found) > 3 else "")
        raise CaseError(
            f"output folder {directory}: is not empty ({shown}); choose another with -o DIR, go on "
            "with --resume, or replace what is there with --overwrite"
        )
