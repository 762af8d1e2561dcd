"""Choose folders for compiled code, and seal files so that damage is noticed."""

from __future__ import annotations

import hashlib
import logging
import multiprocessing
import os
import stat
import tempfile
from functools import cache
from pathlib import Path

SEAL_SIZE = hashlib.sha256().digest_size
"""Length of the checksum at the start of a sealed file."""

_log = logging.getLogger(__name__)


class DamagedError(ValueError):
    """Report that a sealed file is not what was written."""


def sealed(content: bytes) -> bytes:
    """Return the content behind its checksum."""
    return hashlib.sha256(content).digest() + content


def opened(text: bytes) -> bytes:
    """Return the content of a sealed file.

    Raises:
        DamagedError: the file is empty, truncated or changed.
    """
    seal, content = text[:SEAL_SIZE], text[SEAL_SIZE:]
    if hashlib.sha256(content).digest() != seal:
        raise DamagedError("the checksum does not fit")
    return content


def is_writable(folder: Path) -> bool:
    """Return whether files can be made in a folder, which is made if it does not exist."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError:
        return False


@cache
def temporary_folder() -> Path:
    """Return a folder for compiled code below the system's folder of temporary files, and warn.

    The folder has the same name in every process of a user, so that code is compiled once. A folder
    of this name that belongs to somebody else, or that others may write to, is not used.
    """
    name = f"delam_fem-{os.getuid()}"
    folder = Path(tempfile.gettempdir()) / name
    try:
        folder.mkdir(mode=0o700, exist_ok=True)
        found = folder.lstat()
        is_own = stat.S_ISDIR(found.st_mode) and found.st_uid == os.getuid()
        if not is_own or found.st_mode & 0o077 or not is_writable(folder):
            raise PermissionError
    except OSError:
        folder = Path(tempfile.mkdtemp(prefix=f"{name}-"))
    if multiprocessing.parent_process() is None:  # the workers of a sweep need not repeat it
        _log.warning(
            "no folder for compiled code can be written; %s is used. Set XDG_CACHE_HOME to a "
            "folder that is kept",
            folder,
        )
    return folder


def ensure_home() -> None:
    """Give a process without any home folder a temporary one; some libraries fail without."""
    try:
        Path.home()
    except RuntimeError:
        os.environ["HOME"] = str(temporary_folder())
