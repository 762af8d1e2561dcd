"""Compile functions with Numba, and keep the machine code on disk behind checksums.

Numba's own cache trusts its files: an empty or damaged one ends a run, and without a folder to
write to the package cannot even be imported. Here damaged files are compiled anew, and the last
resort is a temporary folder.
"""

from __future__ import annotations

import hashlib
import logging
import os
import pickle
from collections.abc import Callable
from functools import cache, partial
from pathlib import Path
from typing import Any, ClassVar

import numba
from llvmlite.binding import Linkage
from numba import types
from numba.core import caching
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler
from numba.core.serialize import dumps

from delam_fem.system.caches import opened, sealed, temporary_folder

_log = logging.getLogger(__name__)


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


class _SealedFile(caching.IndexDataCacheFile):  # type: ignore[misc]
    """The files of a function's cache; what is damaged counts as absent."""

    def save(self, key: Any, data: Any) -> None:
        """Save a new entry; a full disk costs only the time to compile again."""
        try:
            super().save(key, data)
        except OSError as error:
            _log.debug("compiled code is not kept: %s", error)

    def _load_index(self) -> dict[Any, str]:
        found = self._load(Path(self._index_path))
        if found is None or found[:2] != (self._version, self._source_stamp):
            return {}
        overloads: dict[Any, str] = found[2]
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
        found = super().load_overload(sig, target_context)
        if found is None and self._what:
            _log.info("compiling %s; this is done once on this machine", self._what)
        return found
