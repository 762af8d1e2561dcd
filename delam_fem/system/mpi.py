"""Import MPI and start PETSc, the one door to both, and check the options of PETSc.

No other module imports `mpi4py.MPI`, whose import starts MPI. It starts when a module first asks
this one for `MPI`, so that the workers of a sweep of beams start none. A process that no launcher
has started needs no network. Open MPI nevertheless opens listening sockets on all interfaces,
unless it is told before its start to stay alone. PETSc is started so that it leaves signals to the
package, and files in the working folder unread.

This module also lists the options of PETSc that have a prefix of the package, and says whether they
are read. It imports nothing for that, because the compiled engine, which reads no options, asks
too.
"""

from __future__ import annotations

import ctypes
import gc
import logging
import os
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

from delam_fem.system.errors import CaseError
from delam_fem.system.imports import added, elsewhere

if TYPE_CHECKING:
    from mpi4py import MPI

LAUNCHED = ("OMPI_COMM_WORLD_SIZE", "PMIX_RANK", "PMI_RANK", "PMI_SIZE", "MPI_LOCALNRANKS")
"""Variables that a launcher (mpirun, srun) sets for the processes it starts."""

ALONE = {
    "OMPI_MCA_ess_singleton_isolated": "1",
    "OMPI_MCA_btl": "self,vader",
    "OMPI_MCA_opal_signal": "",
}
"""Variables that keep Open MPI, in a process that is alone, from opening sockets and from answering
a deadly signal with a page of text, in which it may hang."""

PETSC_ARGUMENTS = ("-no_signal_handler", "-skip_petscrc")
"""Handlers would answer a closed terminal or pipe with a page of text; .petscrc may load code."""


LOOK = 0.02
"""Time between two looks whether the other ranks have come [s]."""
PATIENCE = 5.0
"""Time for which a rank with an error waits for the others [s]."""
RETURNING = {-4: 1 << 16, -3: 1 << 25, -1: 1 << 26}
"""glibc's M_MMAP_MAX, M_MMAP_THRESHOLD and M_TRIM_THRESHOLD, near its own values. SuperLU_DIST,
which comes with PETSc, sets them so that a process keeps all memory that it has ever had."""


class _Alone:
    """Stand-in for the communicator of a single process where MPI is not installed."""

    rank, size = 0, 1


def __getattr__(name: str) -> Any:
    """Start MPI when it is first asked for."""
    if name != "MPI":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    with added({} if any(variable in os.environ for variable in LAUNCHED) else ALONE):
        try:
            from mpi4py import MPI  # an mpirun that this process may start does not inherit them
        except ModuleNotFoundError:
            MPI = SimpleNamespace(COMM_SELF=_Alone(), COMM_WORLD=_Alone())  # type: ignore[assignment]
    globals()["MPI"] = MPI
    return MPI


__all__ = [
    "MPI",
    "end_with_any",
    "have_arrived",
    "hold",
    "release",
    "slepc",
    "start_petsc",
    "told_by_first",
]

_held: list[tuple[MPI.Intracomm, Any]] = []
"""Communicators with PETSc's copies of them, which `hold` keeps."""


def start_petsc(comm: MPI.Intracomm | None = None) -> None:
    """Start PETSc, unless it runs already; the options in PETSC_OPTIONS count.

    Each call of `petsc4py.init` adds a clean-up to the end of the process, also if PETSc runs
    already. All ranks take part in it. If one of them had one more, it would wait forever.

    Args:
        comm: communicator of PETSc; None: all ranks.
    """
    import petsc4py.lib

    with elsewhere():  # it may look for petsc.cfg, which says where PETSc is
        PETSc = petsc4py.lib.ImportPETSc()
    if not PETSc.Sys.isInitialized():
        petsc4py.init(PETSC_ARGUMENTS, PETSc.__arch__, comm)
    for option, value in RETURNING.items():  # only glibc has such options
        getattr(ctypes.CDLL(None), "mallopt", lambda *_: 0)(option, value)


def slepc() -> Any:
    """Return SLEPc, which begins when it is first asked for (collective); None: there is none."""
    try:
        with elsewhere():  # it may look for slepc.cfg
            from slepc4py import SLEPc
    except ImportError:
        return None
    return SLEPc


def hold(comm: MPI.Intracomm) -> None:
    """Keep PETSc's copy of a communicator until the end of the process (collective).

    PETSc frees its copy with the last object on it, and makes a new one, collectively, when it
    cleans up at the end. If one rank still has an object then, the others wait forever.
    """
    if comm.size > 1 and comm not in [other for other, _ in _held]:
        from petsc4py import PETSc

        _held.append((comm, PETSc.Comm(comm).duplicate()))


def end_with_any(comm: MPI.Intracomm) -> None:
    """End all ranks when an uncaught exception ends one of them, and show its traceback.

    The other ranks would wait forever. A script of one's own needs this as the command does.
    """
    if comm.size == 1 or sys.excepthook is not sys.__excepthook__:
        return  # in a notebook or debugger somebody else shows exceptions, and goes on

    def show_and_abort(*what: Any) -> None:
        sys.__excepthook__(*what)
        sys.stderr.flush()
        comm.Abort(1)

    sys.excepthook = show_and_abort


@contextmanager
def told_by_first(comm: MPI.Intracomm) -> Iterator[None]:
    """Let the first rank alone log what the package has to say."""
    log = logging.getLogger("delam_fem")
    before = log.level
    if comm.rank > 0:
        log.setLevel(logging.CRITICAL)
    try:
        yield
    finally:
        log.setLevel(before)


def have_arrived(comm: MPI.Comm, *, has_failed: bool) -> bool:
    """Wait for the other ranks at the end of what all do (collective).

    Args:
        comm: communicator that nothing else uses meanwhile.
        has_failed: whether this rank has; it then waits for `PATIENCE` alone, because the others
            may wait for it in what they do.

    Returns:
        Whether the others have come.
    """
    request = comm.Ibarrier()
    last = time.monotonic() + PATIENCE
    while not request.Test():  # without keeping a core busy
        if has_failed and time.monotonic() > last:
            return False
        time.sleep(LOOK)
    return True


def release(comm: MPI.Intracomm) -> None:
    """Free unused PETSc and dolfinx objects on all ranks at the same place (collective)."""
    if comm.size > 1:
        from petsc4py import PETSc

        gc.collect()
        if hasattr(PETSc, "garbage_cleanup"):
            PETSc.garbage_cleanup(PETSc.Comm(comm))
        comm.Barrier()


PREFIXES = ("moreau_", "newmark_mass_", "newmark_")
"""One prefix for each kind of factor; an option belongs to the first one that it starts with."""


def given_options(prefix: str | None = None) -> list[str]:
    """Return the options of PETSc with a prefix of the package, also before PETSc is loaded.

    Args:
        prefix: one of `PREFIXES`; None: all.
    """
    PETSc = sys.modules.get("petsc4py.PETSc")
    words = os.environ.get("PETSC_OPTIONS", "").split()
    names = [w[1:] for w in words if w[:1] == "-"] if PETSc is None else PETSc.Options().getAll()
    wanted = PREFIXES if prefix is None else (prefix,)
    return [n for n in names if next(filter(n.startswith, PREFIXES), None) in wanted]


def require_options_used() -> None:
    """Refuse options of PETSc with a prefix of the package that nothing has read so far.

    Raises:
        CaseError: there are some.
    """
    PETSc = sys.modules.get("petsc4py.PETSc")

    def is_used(name: str) -> bool:
        if PETSc is None or PETSc.__file__ is None:
            return False
        used = ctypes.c_int(0)
        # petsc4py does not offer this function
        ctypes.CDLL(PETSc.__file__).PetscOptionsUsed(None, name.encode(), ctypes.byref(used))
        return bool(used.value)

    unused = [f"-{name}" for name in given_options() if not is_used(name)]
    if unused:
        raise CaseError(
            f"PETSC_OPTIONS: {', '.join(unused)}: expected options that the solvers of this run "
            "read (docs/continuum.md has their prefixes); given, but read by none"
        )
