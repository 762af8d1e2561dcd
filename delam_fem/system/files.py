"""Write files under temporary names, and claim the folder of a result for one process.

A folder that holds other results is refused. The lock is on the folder itself, so that a process
that is killed leaves nothing behind.
"""

from __future__ import annotations

import errno
import fcntl
import hashlib
import io
import json
import logging
import math
import os
import platform
import secrets
import shutil
import time
import zipfile
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager, nullcontext, suppress
from contextvars import ContextVar
from pathlib import Path
from typing import Any

import numpy as np

from delam_fem.system.errors import CaseError, reason_of
from delam_fem.system.footprint import bounded, require_room
from delam_fem.system.written import (
    LIST,
    OUTPUTS,
    PREFIX,
    enlist,
    is_replaceable,
    listed,
    require_replaceable_outputs,
)

_HOST = hashlib.sha256(platform.node().encode()).hexdigest()[:6]
"""The machine in temporary names."""
_LEFT_SECONDS = 86400.0
"""Age from which a temporary file of another machine counts as left behind [s]."""
_tidied: set[Path] = set()
"""Folders in which this process has looked for temporary files that were left behind."""
_DIGEST = "digest"


@contextmanager
def atomic(path: Path) -> Iterator[Path]:
    """Yield a temporary path to write to, and rename it to the final path if the block succeeds.

    The temporary path lies in the folder of the final path, and is of this process and call alone:
    several may write the same file, and the last one counts. If the block fails, the final path
    stays as it was and the temporary file is removed.

    Args:
        path: final path of the file or folder; replaces an existing one. Its parent is made where
            it does not exist.

    Yields:
        The path to write to.

    Raises:
        CaseError: it lies in an output folder, and there is such a file that the program has not
            written.
        OSError: the block wrote nothing, or the written file cannot be renamed. It names the file.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    _tidy(path.parent)
    temporary = path.with_name(f"{PREFIX}{_HOST}-{os.getpid()}-{secrets.token_hex(4)}-{path.name}")
    try:
        yield temporary
        if not temporary.exists():
            raise OSError(0, "could not be written; is the disk full?", str(path))
        enlist(path)
        if temporary.is_dir() and path.exists():
            _remove(path)  # a folder cannot be replaced in one step
        os.replace(temporary, path)
    except BaseException as error:
        _remove(temporary)
        if isinstance(error, OSError) and error.filename in (None, str(temporary), temporary):
            raise OSError(error.errno or 0, error.strerror or str(error), str(path)) from error
        raise


def _tidy(folder: Path) -> None:
    """Remove temporary files that processes have left behind that were killed, once per process."""
    if folder in _tidied:
        return
    _tidied.add(folder)
    for path in folder.glob(f"{PREFIX}*"):
        host, process, *_ = [*path.name.removeprefix(PREFIX).split("-"), "", ""]
        try:
            if host == _HOST and process.isdecimal():
                is_left = not _is_alive(int(process))
            else:
                is_left = time.time() - path.lstat().st_mtime > _LEFT_SECONDS
            if is_left:
                _remove(path)
        except OSError:
            continue  # another process was faster


def _is_alive(process: int) -> bool:
    """Return whether a process of this machine still runs."""
    try:
        os.kill(process, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except PermissionError:
        return True
    return True


@contextmanager
def atomic_file(path: Path) -> Iterator[DiskFile]:
    """Yield a binary file that gets its final name when it is complete and on the disk.

    Libraries that crash when a write fails may write to it: see `DiskFile`.

    Args:
        path: final path of the file; replaces an existing one.

    Raises:
        OSError: the file cannot be written, for example because the disk is full.
    """
    with atomic(path) as temporary, DiskFile(temporary, "w+") as file:
        yield file
        if file.error is not None:
            raise file.error
        os.fsync(file.fileno())


def write_text(path: Path, text: str) -> Path:
    """Write a text as UTF-8 and wait until it is on the disk.

    Args:
        path: path of the file; replaces an existing one.
        text: content of the file.

    Returns:
        The path of the file.

    Raises:
        OSError: the file cannot be written.
    """
    with atomic(path) as temporary, temporary.open("w", encoding="utf-8") as file:
        file.write(text)
        file.flush()
        os.fsync(file.fileno())
    return path


def write_json(path: Path, content: Mapping[str, Any]) -> Path:
    """Write numbers and texts as JSON; see `json_ready` and `write_text`."""
    return write_text(path, _json_text(content))


def digest_of_json(content: Mapping[str, Any]) -> str:
    """Return the SHA-256 digest of the file that `write_json` writes."""
    return hashlib.sha256(_json_text(content).encode()).hexdigest()


def _json_text(content: Mapping[str, Any]) -> str:
    """Return numbers and texts as JSON; see `json_ready`."""
    return json.dumps(json_ready(content), indent=2, allow_nan=False) + "\n"


def json_ready(value: Any, digits: int | None = None) -> Any:
    """Return numbers as JSON knows them: no numpy types, None for what is not finite.

    Args:
        value: a number, a text, or such in mappings, sequences and arrays.
        digits: number of significant digits to keep; None: all.
    """
    if isinstance(value, Mapping):
        return {str(key): json_ready(entry, digits) for key, entry in value.items()}
    if isinstance(value, (list, tuple, np.ndarray)):
        return [json_ready(entry, digits) for entry in value]
    if isinstance(value, np.generic):
        value = value.item()
    if not isinstance(value, float):
        return value
    if not math.isfinite(value):
        return None
    return value if digits is None else float(f"{value:.{digits}g}")


def write_arrays(path: Path, arrays: Mapping[str, Any]) -> Path:
    """Write arrays by name to an archive of NumPy, with a digest of their content.

    Raises:
        OSError: the file cannot be written.
    """
    content = {name: np.asarray(values) for name, values in arrays.items()}
    with atomic_file(path) as temporary:
        np.savez(temporary, **content, **{_DIGEST: np.array(_digest(content))})
    return path


def read_arrays(path: Path) -> dict[str, Any]:
    """Return the arrays of an archive that `write_arrays` wrote.

    Raises:
        ValueError: the file is damaged, was changed, or is of another kind.
    """
    try:
        with zipfile.ZipFile(path) as members:
            require_room(path, sum(member.file_size for member in members.infolist()))
        with bounded(path), path.open("rb") as file, np.load(file) as archive:
            content = {name: archive[name] for name in archive.files}
        digest = str(content.pop(_DIGEST))
    except CaseError:
        raise
    except Exception as error:  # a damaged archive raises a dozen different ones
        raise ValueError(reason_of(error)) from error
    if digest != _digest(content):
        raise ValueError("changed after it was written")
    return content


def _digest(arrays: Mapping[str, Any]) -> str:
    """Return a digest of names, types, shapes and values."""
    digest = hashlib.sha256()
    for name, values in sorted(arrays.items()):
        digest.update(f"{name} {values.dtype.str} {values.shape}\n".encode())
        digest.update(values.tobytes())
    return digest.hexdigest()


class DiskFile(io.FileIO):
    """A binary file that keeps the first failure instead of raising it.

    HDF5 ends the process when it cannot write. It is therefore given this file, which after a
    failure takes everything and stores nothing.

    Attributes:
        error: the first failure; None: none so far.
    """

    error: OSError | None = None
    read = io.RawIOBase.read  # type: ignore[assignment]  # by means of `readinto`

    def truncate(self, size: int | None = None) -> int:
        """Set the size of the file, unless a write has failed."""
        try:
            if self.error is None:
                return super().truncate(size)
        except OSError as error:
            self.error = error
        return size or 0

    def readinto(self, buffer: Any) -> int:
        """Read into a buffer; after a failure, what was never stored is read as zeros."""
        view = memoryview(buffer).cast("B")
        count = super().readinto(view) or 0
        if self.error is not None:
            view[count:] = bytes(len(view) - count)
            count = len(view)
        return count

    def write(self, data: Any) -> int:
        """Write all data, unless a write has failed."""
        view = memoryview(data).cast("B")
        size = len(view)
        try:
            while self.error is None and len(view):
                view = view[super().write(view) or 0 :]
        except OSError as error:
            self.error = error
        return size


def discard(path: Path) -> None:
    """Remove an output of the program, if it exists; what somebody else has put there stays."""
    if is_replaceable(path):
        _remove(path)


def _remove(path: Path) -> None:
    """Remove a file or a folder, if it exists."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)


IDENTITY = "identity.json"
"""Name of the file that says to which computation a folder of what is kept belongs."""
LINKED = frozenset({*OUTPUTS, LIST, "export", "overlay"})
"""Names in an output folder that must not be links."""


def remove_kept(folder: Path) -> None:
    """Remove a folder of checkpoints or points, with what the program has written there.

    Files of other kinds, and the folders that hold them, stay.

    Args:
        folder: the folder; nothing happens if it does not exist.

    Raises:
        CaseError: it is a link, or the program has not written it.
    """
    if not folder.exists() and not folder.is_symlink():
        return
    names = [] if folder.is_symlink() else sorted(entry.name for entry in folder.iterdir())
    if folder.is_symlink() or (names and IDENTITY not in names):
        state = "a link" if folder.is_symlink() else f"one with {', '.join(names[:3])}"
        raise CaseError(
            f"{folder}: expected no such folder, or one written by delam-fem, given {state}; "
            "move it, or choose another folder with -o DIR"
        )
    for path in sorted(folder.rglob("*"), reverse=True):
        if path.is_dir() and not path.is_symlink():
            with suppress(OSError):
                path.rmdir()  # if it is empty
        elif _is_kept(path):
            path.unlink(missing_ok=True)
    with suppress(OSError):
        folder.rmdir()


def _is_kept(path: Path) -> bool:
    """Return whether a file among checkpoints or points is the program's, be it damaged or not."""
    if path.suffix != ".npz":
        return path.name == IDENTITY or path.name.startswith(PREFIX)
    try:
        with zipfile.ZipFile(path) as members:
            return f"{_DIGEST}.npy" in members.namelist()
    except (OSError, zipfile.BadZipFile):
        return True


def require_replaceable(paths: Collection[Path], *, is_overwriting: bool) -> None:
    """Refuse to replace files that a user names, unless that is asked for.

    Args:
        paths: the files that a command writes.
        is_overwriting: whether the user has said `--overwrite`.

    Raises:
        CaseError: one of them exists.
    """
    for path in paths:
        if not is_overwriting and (path.exists() or path.is_symlink()):
            raise CaseError(
                f"--output {path}: there is such a file; --overwrite replaces it, or give another"
            )


def require_no_links(directory: Path) -> None:
    """Refuse a folder in which an output would go through a link to another place.

    Raises:
        CaseError: an entry with the name of an output is a link.
    """
    for entry in directory.iterdir():
        if entry.name in LINKED and entry.is_symlink():
            raise CaseError(
                f"output folder {directory}: {entry.name} is a link, which is not followed; remove "
                "it, or choose another folder with -o DIR"
            )


UNFINISHED = "unfinished.txt"
"""Name of the file that is in a folder while its files belong to two results."""
_log = logging.getLogger(__name__)
_held: ContextVar[frozenset[Path]] = ContextVar("_held", default=frozenset())
"""The folders that this thread has locked."""


@contextmanager
def rewritten(directory: Path) -> Iterator[None]:
    """Let a folder say that it is unfinished until all of its files are replaced.

    A reader may meet the folder at any instant, also after a kill: it has the files of the old
    result, those of the new one, or this note.

    Args:
        directory: the folder; it is made where it does not exist.

    Raises:
        OSError: the folder cannot be written.
    """
    note = write_text(
        directory / UNFINISHED,
        "The files in this folder are of two results: they are being replaced, or a process that "
        "did so was ended. The same command with --resume or --overwrite replaces the others.\n",
    )
    with listed(directory):
        yield
    note.unlink(missing_ok=True)


def require_finished(directory: Path) -> None:
    """Refuse to read a folder whose files belong to two results; see `rewritten`.

    Raises:
        CaseError: the folder says that it is unfinished.
    """
    if (directory / UNFINISHED).exists():
        raise CaseError(
            f"{directory}: is not finished: a process was ended while it wrote the results there "
            f"({UNFINISHED}); the same command with --resume or --overwrite writes them"
        )


@contextmanager
def claimed(
    directory: Path,
    *,
    inputs: Collection[Path] = (),
    may_hold_results: bool = False,
    is_replacing: bool = False,
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
        is_replacing: whether the results replace others, whose files are removed at the end.
        is_shared: whether other processes write to the folder at the same time, each to files of
            its own; nothing is locked then.

    Yields:
        The folder.

    Raises:
        CaseError: the folder cannot be made or written, another process has claimed it, it is not
            empty, or an output would replace an input or a file that the program has not written.
    """
    made = _make(directory)
    try:
        with (
            nullcontext() if is_shared else _locked(directory),
            listed(directory, is_replacing=is_replacing, inputs=inputs) as listing,
        ):
            _spare(directory, inputs)
            require_no_links(directory)
            if may_hold_results or is_shared:
                require_replaceable_outputs(listing)
            else:
                known = {os.path.realpath(path) for path in inputs}
                entries = sorted(
                    entry.name
                    for entry in directory.iterdir()
                    if not entry.name.startswith(".") and os.path.realpath(entry) not in known
                )
                if entries:
                    names = ", ".join(entries[:3]) + (" …" if len(entries) > 3 else "")
                    raise CaseError(
                        f"output folder {directory}: is not empty ({names}); choose another with "
                        "-o DIR, go on with --resume, or replace what is there with --overwrite"
                    )
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
    """Hold the lock of a folder; where the file system has no locks, nothing is locked.

    A command and the run within it, in one thread, hold the lock together.
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
    home = Path(os.path.realpath(directory))
    for path in inputs:
        real = Path(os.path.realpath(path))
        if home in real.parents and real.relative_to(home).parts[0] in OUTPUTS:
            raise CaseError(
                f"output folder {directory}: the results would replace {path}, which the case "
                "reads; choose another folder with -o DIR, or rename the file"
            )
