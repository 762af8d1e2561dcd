"""Write files and folders so that a half-written one never has the final name."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

PREFIX = "part-"
"""Prefix of temporary names. The suffix stays the same, because writers choose the format by it."""


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
        OSError: the block wrote nothing, or the written file cannot be renamed.
    """
    temporary = path.with_name(f"{PREFIX}{path.name}")
    _remove(temporary)  # left behind by a process that was killed
    try:
        yield temporary
        if not temporary.exists():
            raise OSError(f"{temporary}: could not be written; is the disk full?")
        if temporary.is_dir() and path.exists():
            _remove(path)  # a folder cannot be replaced in one step
        os.replace(temporary, path)
    except BaseException:
        _remove(temporary)
        raise


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


def _remove(path: Path) -> None:
    """Remove a file or a folder, if it exists."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)
