"""Say what a command does where mpirun or srun has started several processes of it.

`run` shares its steps. Commands that solve one solid share their factors: the first process does
all other work. The others refuse, because each process would do the same, into the same folder.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from typing import TYPE_CHECKING, Literal, NoReturn

from delam_fem.cli.endings import ended_together
from delam_fem.system.errors import CaseError

if TYPE_CHECKING:
    from delam_fem.system.mpi import MPI

Use = Literal["steps", "factors", "cases", "nothing"]
"""What processes share: the steps of a run, the factors of a solid, nothing because the work is
many cases, or nothing at all."""


def launched() -> MPI.Intracomm | None:
    """Return the processes that a launcher has started for one command; None: this one is alone.

    Below mpi4py.futures all but one wait for the points of a sweep, and run no command.
    """
    from delam_fem.system import mpi

    if "mpi4py.futures" in sys.modules or not any(name in os.environ for name in mpi.LAUNCHED):
        return None
    comm = mpi.MPI.COMM_WORLD
    return comm if comm.size > 1 else None


def on_ranks(
    words: str,
    use: Use,
    comm: MPI.Intracomm | None,
    reporting: Callable[[Callable[[], None]], None],
    work: Callable[[], None],
) -> None:
    """Do the work of a command, or what this process does in its place.

    Args:
        words: words of the command.
        use: what its processes share.
        comm: the processes; None: this one is alone.
        reporting: function that does something, and turns its errors into messages.
        work: what the command does in a single process.
    """
    if comm is None:
        reporting(work)
    elif use == "steps":

        def share_steps() -> None:
            with ended_together(comm):
                work()

        reporting(share_steps)
    elif use == "factors":
        from delam_fem.model.sharing import shared

        shared(comm, lambda: reporting(work))
    elif comm.rank == 0:
        reporting(lambda: _refuse(words, use, comm.size))


def _refuse(words: str, use: Use, size: int) -> NoReturn:
    """Refuse several processes.

    Raises:
        CaseError: always.
    """
    from delam_fem.studies.executors import MPI_COMMAND

    reason = (
        "it computes in one; several share the work of run, reduce, modes, compare, detect tap and "
        "show operators"
    )
    if use == "cases":
        reason = (
            "its work is many cases, which -j N shares on one machine; on several machines a sweep "
            f"has --shard I/N, --slurm N, Dask, or {MPI_COMMAND} (docs/howto/cluster.md)"
        )
    raise CaseError(f"{words}: expected one process, given {size} of MPI: {reason}")
