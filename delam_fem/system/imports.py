"""Keep two intruders out: symbols of dolfinx's libraries, and settings in the working folder.

dolfinx up to 0.7 switches the process to RTLD_GLOBAL and leaves it so. Later versions, if Numba is
installed, make llvmlite load PETSc, and HDF5 with it, in the same global way. In both cases the
wheels of vtk, netCDF4 and h5py that are loaded afterwards pick up symbols of these libraries
instead of their own and break. The import of dolfinx is therefore kept from both calls. Where
dolfinx was imported before this package, libraries that are loaded from now on prefer their own
symbols; those loaded between the two imports cannot be mended.

PETSc, Numba and matplotlib read settings in the folder where a process is started, and some of them
run code or change results. Cases come from other people: the command reads none of them.
"""

from __future__ import annotations

import atexit
import gc
import os
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from importlib import metadata
from importlib.machinery import ModuleSpec, PathFinder
from types import ModuleType

ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
"""Settings of libraries that are loaded later. On small matrices more threads only wait for each
other, and spin a while after each call."""

NEW_OBJECTS = 50_000
"""New objects after which Python looks for garbage. Its own number, 700, costs a short run a fifth
of its time: most objects come from imports, and stay."""


def keep_garbage() -> None:
    """Let a process of our own look for garbage rarely, and not at its end, which takes 0.2 s."""
    gc.set_threshold(NEW_OBJECTS)
    atexit.register(gc.freeze)


@contextmanager
def _symbols_stay_local() -> Iterator[None]:
    """Disable the calls that make a library's symbols visible to all other libraries."""
    import llvmlite.binding

    functions = [(sys, "setdlopenflags"), (llvmlite.binding, "load_library_permanently")]
    originals = [getattr(owner, name) for owner, name in functions]
    for owner, name in functions:
        setattr(owner, name, lambda *_: None)
    arguments = sys.argv  # dolfinx gives them to its log, which takes UTF-8 alone
    sys.argv = [text.encode("utf-8", "replace").decode() for text in arguments]
    try:
        yield
    finally:
        sys.argv = arguments
        for (owner, name), original in zip(functions, originals, strict=True):
            setattr(owner, name, original)


@contextmanager
def elsewhere() -> Iterator[None]:
    """Leave the working folder until the context ends."""
    here = os.open(".", os.O_PATH)
    os.chdir("/")
    try:
        yield
    finally:
        os.fchdir(here)
        os.close(here)


@contextmanager
def _without_its_file() -> Iterator[None]:
    """Keep Numba from its file of settings, both at its import and later, when it compiles."""
    with elsewhere():
        yield
    if config := sys.modules.get("numba.core.config"):
        config._config_fname = os.devnull  # type: ignore[attr-defined]


@contextmanager
def added(variables: Mapping[str, str]) -> Iterator[None]:
    """Set the environment variables that are not set, and remove them afterwards."""
    new = {name: value for name, value in variables.items() if name not in os.environ}
    os.environ.update(new)
    try:
        yield
    finally:
        for name in new:
            os.environ.pop(name, None)


@contextmanager
def _versions_from_metadata() -> Iterator[None]:
    """Replace pkg_resources, which loads slowly, for importers that ask it for a version alone."""
    if "pkg_resources" in sys.modules:
        yield
        return
    stand_in = sys.modules["pkg_resources"] = ModuleType("pkg_resources")
    stand_in.get_distribution = metadata.distribution  # type: ignore[attr-defined]
    try:
        yield
    finally:
        del sys.modules["pkg_resources"]


class Within:
    """Finder that has a package, with all of its modules, imported within a context."""

    def __init__(self, package: str, context: Callable[[], AbstractContextManager[None]]) -> None:
        """Store the name of the package, and what makes the context."""
        self.package = package
        self.context = context

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


@contextmanager
def _local_and_elsewhere() -> Iterator[None]:
    """Import dolfinx outside the working folder, and with symbols that stay local.

    Later versions of dolfinx ask petsc4py for the PETSc that `petsc.cfg` names.
    """
    with elsewhere(), _symbols_stay_local():
        yield


def ignore_working_folder() -> None:
    """Keep Numba, matplotlib and dolfinx from reading settings in the working folder."""
    sys.meta_path[:0] = [
        Within("numba", _without_its_file),
        Within("matplotlib", elsewhere),
        Within("dolfinx", _local_and_elsewhere),
    ]


sys.meta_path[:0] = [
    Within("dolfinx", _symbols_stay_local),
    Within("ufl", _versions_from_metadata),
    Within("ffcx", _versions_from_metadata),
]
if "dolfinx" in sys.modules:
    sys.setdlopenflags(os.RTLD_NOW | os.RTLD_DEEPBIND)
