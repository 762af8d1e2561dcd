"""Write files and folders so that a half-written one never has the final name."""

from __future__ import annotations

import hashlib
import io
import os
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

PREFIX = ".delam_fem-"
"""Prefix of temporary names, which no file of a user has: what a killed process left is removed.
The suffix stays the same, because writers choose the format by it."""


_DIGEST = "digest"


@contextmanager
def atomic(path: Path) -> Iterator[Path]:
    """Yield a temporary path to write to, and rename it to the final path if the block succeeds.

    The temporary path lies in the folder of the final path. If the block fails, the final path
    stays as it was and the temporary file is removed.

    Args:
        path: final path of the file or folder; replaces an existing one. Its parent must exist.

    Yields:
        The path to write to.

    Raises:
        OSError: the block wrote nothing, or the written file cannot be renamed. It names the file.
    """
    temporary = path.with_name(f"{PREFIX}{path.name}")
    _remove(temporary)  # left behind by a process that was killed
    try:
        yield temporary
        if not temporary.exists():
            raise OSError(0, "could not be written; is the disk full?", str(path))
        if temporary.is_dir() and path.exists():
            _remove(path)  # a folder cannot be replaced in one step
        os.replace(temporary, path)
    except BaseException as error:
        _remove(temporary)
        if isinstance(error, OSError) and error.filename in (None, str(temporary), temporary):
            raise OSError(error.errno or 0, error.strerror or str(error), str(path)) from error
        raise


@contextmanager
def atomic_file(path: Path) -> Iterator[DiskFile]:
    """Yield a binary file that gets its final name when it is complete and on the disk.

    Libraries that crash when a write fails may write to it: see `DiskFile`.

    Args:
        path: final path of the file; replaces an existing one. Its folder must exist.

    Raises:
        OSError: the file cannot be written, for example because the disk is full.
    """
    with atomic(path) as temporary, temporary.open("w+b", buffering=0) as raw:
        file = DiskFile(raw)
        yield file
        if file.error is not None:
            raise file.error
        os.fsync(raw.fileno())


def write_text(path: Path, text: str) -> Path:
    """Write a text as UTF-8 and wait until it is on the disk.

    Args:
        path: path of the file; replaces an existing one. Its folder must exist.
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
        with path.open("rb") as file, np.load(file) as archive:
            content = {name: archive[name] for name in archive.files}
        digest = str(content.pop(_DIGEST))
    except Exception as error:  # a damaged archive raises a dozen different ones
        text = str(error).splitlines()[0][:80] if str(error) else type(error).__name__
        raise ValueError(text) from error
    if digest != _digest(content):
        raise ValueError("changed after it was written")
    return content


def _digest(arrays: Mapping[str, Any]) -> str:
    """Return a digest of names, types, shapes and values."""
    found = hashlib.sha256()
    for name, values in sorted(arrays.items()):
        found.update(f"{name} {values.dtype.str} {values.shape}\n".encode())
        found.update(values.tobytes())
    return found.hexdigest()


class DiskFile(io.RawIOBase):
    """A binary file that keeps the first failure instead of raising it.

    HDF5 ends the process when it cannot write. It therefore writes to this file, which after a
    failure takes everything and stores nothing.

    Attributes:
        error: the first failure; None: none so far.
    """

    def __init__(self, raw: io.FileIO) -> None:
        """Store the open file, which the caller closes."""
        self._raw = raw
        self.error: OSError | None = None

    def readable(self) -> bool:
        """Return True."""
        return True

    def writable(self) -> bool:
        """Return True."""
        return True

    def seekable(self) -> bool:
        """Return True."""
        return True

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        """Move to a position."""
        return self._raw.seek(offset, whence)

    def truncate(self, size: int | None = None) -> int:
        """Set the size, unless a write has failed."""
        try:
            if self.error is None:
                return self._raw.truncate(size)
        except OSError as error:
            self.error = error
        return size or 0

    def readinto(self, buffer: Any) -> int:
        """Read into a buffer; after a failure, what was never stored is read as zeros."""
        view = memoryview(buffer).cast("B")
        count = self._raw.readinto(view) or 0
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
                view = view[self._raw.write(view) or 0 :]
        except OSError as error:
            self.error = error
        return size


def _remove(path: Path) -> None:
    """Remove a file or a folder, if it exists."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)
