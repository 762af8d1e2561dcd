"""Say what a command does where mpirun or srun has started several processes of it.

`run` shares its steps. Commands that solve one solid share their factors: the first process does
all other work. The others refuse, because each process would do the same, into the same folder.
"""

from __future__ import annotations

import logging
import os
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from typing import TYPE_CHECKING, Literal, NoReturn

import typer

from delam_fem.system.errors import CaseError

if TYPE_CHECKING:
    from delam_fem.system.mpi import MPI

Use = Literal["steps", "factors", "cases", "nothing"]
"""What processes share: the steps of a run, the factors of a solid, nothing because the work is
many cases, or nothing at all."""
LOOK = 0.02
"""Time between two looks whether the other processes have ended their work [s]."""
PATIENCE = 5.0
"""Time for which a process with an error waits for the others to end, too [s]."""

_log = logging.getLogger(__name__)


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


@contextmanager
def ended_together(comm: MPI.Intracomm) -> Iterator[None]:
    """End the processes of mpirun together, with the error of the first that has one (collective).

    A process with an error waits a little for the others. If they do not come, because they wait
    for it in a step, it tells its error and aborts them.

    Raises:
        Exit: another process has an error; the status is that of the other.
    """
    if comm.size == 1:
        yield
        return
    at_end = comm.Dup()
    failure: BaseException | None = None
    try:
        yield
    except BaseException as error:
        failure = error
    request = at_end.Ibarrier()
    last = time.monotonic() + PATIENCE
    while not request.Test():  # without keeping a core busy
        if failure is not None and time.monotonic() > last:
            _abort(comm, failure)
        time.sleep(LOOK)
    statuses = at_end.allgather(None if failure is None else _explained(failure)[1])
    at_end.Free()
    failed = [rank for rank, status in enumerate(statuses) if status is not None]
    if failed[:1] == [comm.rank]:
        assert failure is not None
        raise failure
    if failed:
        raise typer.Exit(statuses[failed[0]])


@contextmanager
def entered_by_first(
    comm: MPI.Intracomm, context: AbstractContextManager[object]
) -> Iterator[None]:
    """Enter a context on the first process; if it fails, all fail (collective).

    Raises:
        Exit: the first process, another one, could not enter.
    """
    failure: Exception | None = None
    with ExitStack() as stack:
        if comm.rank == 0:
            try:
                stack.enter_context(context)
            except Exception as error:
                failure = error
        if comm.size > 1 and comm.bcast(failure is not None) and failure is None:
            raise typer.Exit(1)  # the status of the first counts
        if failure is not None:
            raise failure
        yield


def _abort(comm: MPI.Intracomm, failure: BaseException) -> NoReturn:
    """Tell an error, and end all processes."""
    from delam_fem.cli.console import tell

    text, status = _explained(failure)
    if text is None:
        _log.critical("process %d failed", comm.rank, exc_info=failure)
    elif text:
        tell(f"delam-fem: {text}")
    comm.Abort(status)
    raise failure  # for the types: nothing comes behind an abort


def _explained(failure: BaseException) -> tuple[str | None, int]:
    """Return the message of an error and the exit status; None: it is a defect of the program."""
    from delam_fem.cli.console import FAILED, explained

    if isinstance(failure, typer.Exit):
        return "", failure.exit_code  # it is told already
    return explained(failure) or (None, FAILED)


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
