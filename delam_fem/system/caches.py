"""Compile functions and weak forms, and keep the machine code on disk behind checksums.

Numba's own cache trusts its files: an empty or damaged one ends a run, and without a folder to
write to the package cannot even be imported. Here damaged files are compiled anew, and the last
resort is a temporary folder.

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
import pickle
import shutil
import stat
import tempfile
import time
from collections.abc import Callable
from functools import cache, partial
from pathlib import Path
from typing import Any, ClassVar, TypeVar

import numba
from llvmlite.binding import Linkage, parse_assembly
from numba import types
from numba.core import caching
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler
from numba.core.runtime import rtsys
from numba.core.serialize import dumps

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
        status = folder.lstat()
        is_own = stat.S_ISDIR(status.st_mode) and status.st_uid == os.getuid()
        if not is_own or status.st_mode & 0o077 or not is_writable(folder):
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
    shared = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / FOLDER
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


def _is_intact(folder: Path, *, is_told: bool = True) -> bool:
    """Return whether a folder has an undamaged library, and the files that FFCx looks for."""
    if not folder.is_dir():
        return False
    try:
        library = _library(folder)
        if library is None or (folder / _SEAL).read_text("ascii") != _checksum(library):
            raise ValueError("missing, or another checksum")
    except (OSError, ValueError) as error:
        if is_told:
            _log.debug("%s: damaged (%s); compiled anew", folder, error)
        return False
    return True


def _publish(private: Path, final: Path) -> None:
    """Seal a new library and give its folder the final name."""
    library = _library(private)
    if library is None or _is_intact(final, is_told=False):  # another process was faster
        return
    try:
        _to_disk(library)
        (private / _SEAL).write_text(_checksum(library), "ascii")
        _to_disk(private / _SEAL)
        old = private.with_suffix(".old")
        if final.is_dir():  # damaged
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


class _InnerLibrary(JITCodeLibrary):  # type: ignore[misc]
    """Code of one function that is neither optimised nor turned into machine code."""

    def _optimize_final_module(self) -> None:
        """Do nothing: the function that Python calls contains this code, and is optimised."""

    def _finalize_final_module(self) -> None:
        """Mark the code as ready to be linked; there is no machine code to load."""
        self._finalize_dynamic_globals()
        self._finalized = True


def _refuse(function: Any, *arguments: Any) -> None:
    """Refuse a call from Python, which would take a hundred times as long without machine code."""
    name = function.func_name
    raise TypeError(f"{name} is for compiled code alone; Python calls a function of `kept`")


class _Inner(Compiler):  # type: ignore[misc]
    """Compile a function that compiled code calls.

    Numba would optimise each function with all that it calls, and make machine code of it. Only the
    machine code of the outermost function ever runs, so that half of the time would be wasted.
    """

    def __init__(self, typing: Any, target: Any, library: Any, *others: Any) -> None:
        """Start with a library of our own, and without entries for Python and C."""
        library = _InnerLibrary(target.codegen(), "inner")
        super().__init__(typing, target, library, *others)
        flags = self.state.flags
        flags.no_cpython_wrapper = flags.no_cfunc_wrapper = True
        self.state.targetctx.get_executable = lambda *_: partial(_refuse, self.state.func_id)


class _KeptLibrary(JITCodeLibrary):  # type: ignore[misc]
    """Code of a function that Python calls, with private copies of all functions that it calls.

    Numba names a function by its number within the process that compiled it. Files from two
    processes may hold different functions of one name, and the first that is loaded would serve
    the callers of both.
    """

    def _optimize_final_module(self) -> None:
        """Hide the functions that have been linked in, then optimise."""
        for function in self._final_module.functions:
            if function.linkage == Linkage.linkonce_odr:
                function.linkage = "internal"
        super()._optimize_final_module()

    def serialize_using_object_code(self) -> Any:
        """Return the machine code, and of the code for other functions to link only the names."""
        name, kind, (code, _) = super().serialize_using_object_code()
        functions = (f for f in self._final_module.functions if not f.is_declaration)
        stubs = (f'define void @"{f.name}"() {{ ret void }}\n' for f in functions)
        return name, kind, (code, parse_assembly("".join(stubs)).as_bitcode())


class _Outermost(Compiler):  # type: ignore[misc]
    """Compile a function that Python calls."""

    def __init__(self, typing: Any, target: Any, library: Any, *others: Any) -> None:
        """Start with a library of our own, whose machine code may be kept."""
        library = _KeptLibrary(target.codegen(), "kept")
        library.enable_object_caching()
        super().__init__(typing, target, library, *others)


def njit(function: Callable[..., Any] | None = None, **options: Any) -> Any:
    """Compile a function that compiled code calls: its machine code is part of the caller's.

    The function is compiled for the types of its arguments alone; Numba would also compile it for
    each literal value.
    """

    def compiled(function: Any) -> Any:
        dispatcher = numba.njit(pipeline_class=_Inner, **options)(function)
        if hasattr(dispatcher, "get_call_template"):  # not where NUMBA_DISABLE_JIT is set
            overloads = dispatcher.overloads
            dispatcher.add_overload = lambda of: overloads.update({tuple(of.signature.args): of})
            of_types = dispatcher.get_call_template
            dispatcher.get_call_template = lambda args, kws: of_types(
                [types.unliteral(kind) for kind in args],
                {name: types.unliteral(kind) for name, kind in kws.items()},
            )
        return dispatcher

    return compiled if function is None else compiled(function)


def kept(function: Callable[..., Any] | None = None, *, what: str = "", **options: Any) -> Any:
    """Compile a function that Python calls, when it is first called; keep its code on disk.

    Args:
        function: the function.
        what: what the function computes and how long it takes to compile, for a message to who
            waits; "": no message, because it compiles fast.
        options: see `numba.njit`; `cache` is not among them.

    Returns:
        The compiled function, or with options alone a decorator.
    """

    def compiled(function: Any) -> Any:
        dispatcher = numba.njit(pipeline_class=_Outermost, **options)(function)
        if hasattr(dispatcher, "enable_caching"):  # not where NUMBA_DISABLE_JIT is set
            dispatcher._cache = _SealedCache(function, what)
        return dispatcher

    return compiled if function is None else compiled(function)


@cache
def _kernels_stamp() -> str:
    """Return a text that changes with any module that machine code depends on.

    The machine code of a function contains that of the functions it calls, and reads the members of
    named tuples by their places (`state.View`). Both may stand in other modules.
    """
    stamp = hashlib.sha256()
    for path in sorted(Path(__file__).parents[1].rglob("*.py")):
        content = path.read_bytes()
        if any(word in content for word in (b"njit", b"numba", b"NamedTuple")):
            stamp.update(content)
    return stamp.hexdigest()


class _TemporaryLocator(caching.UserWideCacheLocator):  # type: ignore[misc]
    """Locator of the last resort, which puts compiled code into a temporary folder."""

    def __init__(self, function: Any, path: str) -> None:
        """Choose the folder for the code of a function from a source file."""
        super().__init__(function, path)
        kernels = temporary_folder() / "kernels"
        self._cache_path = str(kernels / self.get_suitable_cache_subpath(path))


class _Impl(caching.CompileResultCacheImpl):  # type: ignore[misc]
    """Numba's way of storing compiled functions, with a last resort for where to store them."""

    _locator_classes: ClassVar[list[type]] = [
        *caching.CompileResultCacheImpl._locator_classes,
        _TemporaryLocator,
    ]

    def reduce(self, data: Any) -> Any:
        """Return what is stored: not the modules of Numba that object mode alone needs."""
        *parts, _ = super().reduce(data)
        return (*parts, ())


class _SealedFile(caching.IndexDataCacheFile):  # type: ignore[misc]
    """The files of a function's cache; what is damaged counts as absent."""

    def save(self, key: Any, data: Any) -> None:
        """Save a new entry; a full disk costs only the time to compile again."""
        try:
            super().save(key, data)
        except OSError as error:
            _log.debug("compiled code is not kept: %s", error)

    def _load_index(self) -> dict[Any, str]:
        content = self._load(Path(self._index_path))
        if content is None or content[:2] != (self._version, self._source_stamp):
            return {}
        overloads: dict[Any, str] = content[2]
        return overloads

    def _save_index(self, overloads: dict[Any, str]) -> None:
        content = pickle.dumps((self._version, self._source_stamp, overloads))
        self._save(Path(self._index_path), content)

    def _load_data(self, name: str) -> Any:
        return self._load(Path(self._data_path(name)))

    def _save_data(self, name: str, data: Any) -> None:
        self._save(Path(self._data_path(name)), dumps(data))

    def _load(self, path: Path) -> Any:
        """Return the object in a file; None if it is missing, damaged, or of another version."""
        try:
            return pickle.loads(opened(path.read_bytes()))
        except FileNotFoundError:
            return None
        except (ValueError, OSError, ImportError, AttributeError) as error:
            _log.debug("%s: compiled anew (%s)", path, error)
            return None

    def _save(self, path: Path, content: bytes) -> None:
        """Write a file under a private name, and rename it when it is on the disk."""
        with self._open_for_write(str(path)) as file:
            file.write(sealed(content))
            file.flush()
            os.fsync(file.fileno())


class _SealedCache(caching.FunctionCache):  # type: ignore[misc]
    """Numba's cache of one function, in sealed files."""

    _impl_class = _Impl

    def __init__(self, function: Any, what: str) -> None:
        """Find the folder of the function."""
        super().__init__(function)
        self._what = what
        self._cache_file = _SealedFile(
            cache_path=self._cache_path,
            filename_base=self._impl.filename_base,
            source_stamp=(self._impl.locator.get_source_stamp(), _kernels_stamp()),
        )

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return the machine code for the types of a call; None: Numba compiles it next."""
        rtsys.initialize(target_context)  # all that loading needs of what compiling needs
        overload = self._load_overload(sig, target_context)
        if overload is None and self._what:
            _log.info("compiling %s; this is done once on this machine", self._what)
        return overload
