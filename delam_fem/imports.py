"""Keep the symbols of dolfinx's libraries from those of others, whoever imports it, and when.

dolfinx up to 0.7 switches the process to RTLD_GLOBAL and leaves it so. Later versions, if Numba is
installed, make llvmlite load PETSc, and HDF5 with it, in the same global way. In both cases the
wheels of vtk, netCDF4 and h5py that are loaded afterwards pick up symbols of these libraries
instead of their own and break. The import of dolfinx is therefore kept from both calls. Where it
came first, what is loaded from now on prefers its own symbols; what was loaded between the two
cannot be mended.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from importlib.machinery import ModuleSpec, PathFinder
from types import ModuleType


@contextmanager
def _symbols_stay_local() -> Iterator[None]:
    """Disable the calls that make a library's symbols visible to all other libraries."""
    import llvmlite.binding

    held = [(sys, "setdlopenflags"), (llvmlite.binding, "load_library_permanently")]
    originals = [getattr(owner, name) for owner, name in held]
    for owner, name in held:
        setattr(owner, name, lambda *_: None)
    try:
        yield
    finally:
        for (owner, name), original in zip(held, originals, strict=True):
            setattr(owner, name, original)


class Within:
    """Finder that has a package, with all of its modules, imported within a context."""

    def __init__(self, package: str, context: Callable[[], AbstractContextManager[None]]) -> None:
        """Store the name of the package, and what makes the context."""
        self.package, self.context = package, context

    def find_spec(
        self, name: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Return how to import a module of the package; None for others."""
        is_own = name.partition(".")[0] == self.package
        spec = PathFinder.find_spec(name, path, target) if is_own else None
        loader = spec.loader if spec is not None else None
        if loader is not None:
            execute = loader.exec_module

            def exec_module(module: ModuleType) -> None:
                with self.context():
                    execute(module)

            loader.exec_module = exec_module  # type: ignore[method-assign]
        return spec


sys.meta_path.insert(0, Within("dolfinx", _symbols_stay_local))
if "dolfinx" in sys.modules:
    sys.setdlopenflags(os.RTLD_NOW | os.RTLD_DEEPBIND)
