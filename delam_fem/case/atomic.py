"""Write files and folders so that nothing half-written ever stands under a final name."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

PREFIX = "part-"
"""Start of temporary names; the end stays, because formats follow from the suffix."""


@contextmanager
def atomic(path: Path) -> Iterator[Path]:
    """Give a temporary path, and rename what was written there when the block succeeds.

    The temporary stands beside the final path. A block that fails leaves the final path as it was
    and no temporary.

    Args:
        path: of the file or folder, which replaces an earlier one; its parent exists.

    Yields:
        The path to write to.

    Raises:
        OSError: the block wrote nothing, or the result cannot be renamed.
    """
    temporary = path.with_name(f"{PREFIX}{path.name}")
    _remove(temporary)  # of a process that was killed
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
    """Write a text as UTF-8; it is on the disk when this returns.

    Args:
        path: of the file, which replaces an earlier one; its folder exists.
        text: the content.

    Returns:
        The path.

    Raises:
        OSError: the file cannot be written.
    """
    with atomic(path) as temporary, temporary.open("w", encoding="utf-8") as file:
        file.write(text)
        file.flush()
        os.fsync(file.fileno())
    return path


def _remove(path: Path) -> None:
    """Remove a file or a folder, if there is one."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)
