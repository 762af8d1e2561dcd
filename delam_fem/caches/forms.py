"""Keep the libraries that FFCx compiles where no kill and no damage can spoil them.

FFCx writes into the folder that all processes read. If a process ends while it compiles, every
later one waits for it and fails; an empty or truncated library ends the process that loads it. Here
each library is compiled in a private folder, sealed with a checksum, and renamed when it is on the
disk. What is stale or damaged is compiled anew.
"""

from __future__ import annotations

import functools
import hashlib
import importlib.machinery
import importlib.util
import logging
import os
import shutil
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from delam_fem.caches.folders import is_writable, temporary_folder

FOLDER = "delam_fem"
"""Folder below FFCx's own cache."""
PRIVATE = "part-"
"""Prefix of the folders in which libraries are compiled."""
STALE_SECONDS = 3600.0
"""Age at which a private folder has no owner any more [s]."""
_SEAL = "sha256"

_log = logging.getLogger(__name__)


def protect(jit: Any) -> None:
    """Make FFCx's compiler (the module `ffcx.codegeneration.jit`) use this cache."""
    for name in ("compile_elements", "compile_forms", "compile_expressions"):
        if hasattr(jit, name):  # not every version compiles elements
            setattr(jit, name, _in_private(jit, getattr(jit, name)))


def _in_private(jit: Any, compile_: Callable[..., Any]) -> Callable[..., Any]:
    """Return a function of FFCx that compiles in a private folder and then publishes it."""

    @functools.wraps(compile_)
    def compiled(*args: Any, cache_dir: Any = None, **options: Any) -> Any:
        place = _Place.below(Path(cache_dir or temporary_folder()).expanduser() / FOLDER)
        jit.get_cached_module = place.find
        try:
            result = compile_(*args, cache_dir=place.private, **options)
            place.publish()
        except Exception as error:
            text = f"the forms cannot be compiled ({error}); is there a C compiler, and space?"
            raise OSError(0, text, str(place.shared)) from error
        finally:
            shutil.rmtree(place.private, ignore_errors=True)
        return result

    return compiled


@dataclass
class _Place:
    """Where one library is looked for and compiled.

    Attributes:
        shared: folder of the finished libraries, one folder each.
        private: folder to compile in.
        is_lasting: whether `shared` can be written.
        name: name of the library that is being compiled; empty if it was found.
    """

    shared: Path
    private: Path
    is_lasting: bool
    name: str = ""

    @classmethod
    def below(cls, shared: Path) -> _Place:
        """Return a place with a new private folder."""
        is_lasting = is_writable(shared)
        private = tempfile.mkdtemp(prefix=PRIVATE, dir=shared if is_lasting else None)
        return cls(shared, Path(private), is_lasting)

    def find(self, name: str, objects: Sequence[str], *_: Any) -> tuple[list[Any] | None, Any]:
        """Return the objects and the module of a finished library; (None, None) to compile it."""
        module = self._module(name)
        if module is None and not self.is_lasting:
            self.shared = temporary_folder() / FOLDER
            self.shared.mkdir(exist_ok=True)
            module = self._module(name)
        if module is not None:
            return [getattr(module.lib, wanted) for wanted in objects], module
        self.name = name
        _announce()
        (self.private / f"{name}.c").touch()  # FFCx renames it where the compiler fails
        return None, None

    def _module(self, name: str) -> Any:
        """Return the module of an intact library; None if there is none."""
        folder = self.shared / name
        if not folder.is_dir():
            return None
        library = _library(folder, name)
        try:
            if library is None or (folder / _SEAL).read_text("ascii") != _checksum(library):
                raise ValueError("missing, or another checksum")
            return _loaded(name, library)
        except (OSError, ValueError, ImportError) as error:
            _log.debug("%s: damaged (%s); compiled anew", folder, error)
            return None

    def publish(self) -> None:
        """Seal a new library and give its folder the final name."""
        library = _library(self.private, self.name) if self.name else None
        if library is None:
            return
        try:
            _to_disk(library)
            (self.private / _SEAL).write_text(_checksum(library), "ascii")
            _to_disk(self.private / _SEAL)
            final, old = self.shared / self.name, self.private.with_suffix(".old")
            if final.is_dir():  # damaged, or another process was faster
                os.rename(final, old)
                shutil.rmtree(old, ignore_errors=True)
            os.rename(self.private, final)
        except OSError as error:  # the library is loaded and stays so
            _log.debug("%s: not kept (%s)", self.name, error)
        _clear_out(self.shared)


@functools.cache
def _announce() -> None:
    """Say, once a process, why nothing seems to happen now."""
    _log.info("compiling the weak forms, once, some seconds")


def _library(folder: Path, name: str) -> Path | None:
    """Return the path of a compiled library in a folder; None if there is none."""
    paths = (folder / f"{name}{suffix}" for suffix in importlib.machinery.EXTENSION_SUFFIXES)
    return next((path for path in paths if path.is_file()), None)


def _checksum(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def _to_disk(path: Path) -> None:
    """Wait until a file is on the disk."""
    with path.open("rb") as file:
        os.fsync(file.fileno())


def _loaded(name: str, library: Path) -> Any:
    """Load a library as the module `name`."""
    spec = importlib.util.spec_from_file_location(name, library)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def _clear_out(shared: Path) -> None:
    """Remove private folders that killed processes have left."""
    for path in shared.glob(f"{PRIVATE}*"):
        try:
            is_stale = time.time() - path.stat().st_mtime > STALE_SECONDS
        except OSError:
            continue
        if is_stale:
            _log.debug("%s: removed, left by a process that was killed", path)
            shutil.rmtree(path, ignore_errors=True)
