"""Keep compiled libraries where no kill and no damage can spoil them, sealed by checksums.

FFCx by itself writes into the folder that all processes read. If a process ends while it compiles,
every later one waits for it and fails; an empty or truncated library ends the process that loads
it. Here FFCx compiles each library in a private folder, which is sealed with a checksum and renamed
when it is on the disk. What is stale or damaged is compiled anew.
"""

from __future__ import annotations

import hashlib
import importlib.machinery
import logging
import multiprocessing
import os
import shutil
import stat
import tempfile
import time
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

SEAL_SIZE = hashlib.sha256().digest_size
"""Length of the checksum at the start of a sealed file."""

_log = logging.getLogger(__name__)


def sealed(content: bytes) -> bytes:
    """Return the content of a file with its checksum in front."""
    return hashlib.sha256(content).digest() + content


def opened(text: bytes) -> bytes:
    """Return the content of a sealed file.

    Raises:
        ValueError: the file is empty, truncated or changed.
    """
    seal, content = text[:SEAL_SIZE], text[SEAL_SIZE:]
    if hashlib.sha256(content).digest() != seal:
        raise ValueError("the checksum does not fit")
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


FOLDER = Path("fenics") / "delam_fem"
"""Folder below the user's cache: beside what dolfinx compiles for others."""
PRIVATE = "part-"
"""Prefix of the folders in which libraries are compiled."""
STALE_SECONDS = 3600.0
"""Age at which a private folder has no owner any more [s]."""
_SEAL = "sha256"
_T = TypeVar("_T")


def compiled(comm: Any, key: str, make: Callable[[Path], _T]) -> _T:
    """Return what `make` compiles, or what an earlier process has compiled (collective).

    Args:
        comm: communicator of `make`; its first rank compiles.
        key: text that differs where the code of the library would.
        make: compiles in the folder that it is given, or loads what FFCx finds there.

    Raises:
        OSError: the code cannot be compiled.
    """
    shared, final, folder = comm.bcast(_places(key) if comm.rank == 0 else None)
    try:
        result = make(folder)
        if folder != final:
            comm.Barrier()  # all ranks have loaded it
            if comm.rank == 0:
                _publish(folder, final)
    except Exception as error:
        text = f"the forms cannot be compiled ({error}); is there a C compiler, and space?"
        raise OSError(0, text, str(shared)) from error
    finally:
        if comm.rank == 0 and folder != final:
            shutil.rmtree(folder, ignore_errors=True)
    return result


def _places(key: str) -> tuple[Path, Path, Path]:
    """Return the folder of all libraries, that of this one, and where FFCx is to look for it."""
    name = hashlib.sha256(key.encode()).hexdigest()[:40]
    kept = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    shared = Path(kept) / FOLDER
    is_found = _is_intact(shared / name)
    if not is_found and not is_writable(shared):
        shared = temporary_folder() / FOLDER.name
        shared.mkdir(exist_ok=True)
        is_found = _is_intact(shared / name)
    final = shared / name
    if is_found:
        return shared, final, final
    _announce()
    return shared, final, Path(tempfile.mkdtemp(prefix=PRIVATE, dir=shared))


def _is_intact(folder: Path) -> bool:
    """Return whether a folder has an undamaged library, and the files that FFCx looks for."""
    if not folder.is_dir():
        return False
    try:
        library = _library(folder)
        if library is None or (folder / _SEAL).read_text("ascii") != _checksum(library):
            raise ValueError("missing, or another checksum")
    except (OSError, ValueError) as error:
        _log.debug("%s: damaged (%s); compiled anew", folder, error)
        return False
    return True


def _publish(private: Path, final: Path) -> None:
    """Seal a new library and give its folder the final name."""
    library = _library(private)
    if library is None:
        return
    try:
        _to_disk(library)
        (private / _SEAL).write_text(_checksum(library), "ascii")
        _to_disk(private / _SEAL)
        old = private.with_suffix(".old")
        if final.is_dir():  # damaged, or another process was faster
            os.rename(final, old)
            shutil.rmtree(old, ignore_errors=True)
        os.rename(private, final)
    except OSError as error:  # the library is loaded and stays so
        _log.debug("%s: not kept (%s)", private, error)
    for path in final.parent.glob(f"{PRIVATE}*"):  # killed processes may have left theirs
        try:
            is_stale = time.time() - path.stat().st_mtime > STALE_SECONDS
        except OSError:
            continue
        if is_stale:
            _log.debug("%s: removed, left by a process that was killed", path)
            shutil.rmtree(path, ignore_errors=True)


@cache
def _announce() -> None:
    """Log, once per process, that the weak forms are being compiled."""
    _log.info("compiling the weak forms, once, some seconds")


def _library(folder: Path) -> Path | None:
    """Return the path of the finished library in a folder; None if there is none."""
    for ready in folder.glob("*.c.cached"):
        source = ready.with_suffix("")
        paths = (source.with_suffix(end) for end in importlib.machinery.EXTENSION_SUFFIXES)
        if source.is_file():
            return next((path for path in paths if path.is_file()), None)
    return None


def _checksum(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def _to_disk(path: Path) -> None:
    """Wait until a file is on the disk."""
    with path.open("rb") as file:
        os.fsync(file.fileno())
