"""End a command: exit statuses, messages for errors, and all processes of mpirun together."""

from __future__ import annotations

import logging
import sys
from collections.abc import Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from typing import TYPE_CHECKING, NoReturn

import typer

from delam_fem.system.errors import CaseError
from delam_fem.system.mpi import have_arrived

if TYPE_CHECKING:
    from delam_fem.system.mpi import MPI

DONE, FAILED, BAD_INPUT, INTERRUPTED = 0, 1, 2, 130
"""Exit statuses of the command."""

_log = logging.getLogger(__name__)


def tell(text: str) -> None:
    """Write a line to stderr; above a progress bar if there is one, which replaces `sys.stderr`."""
    sys.stderr.write(f"{text}\n")


def explained(error: BaseException) -> tuple[str, int] | None:
    """Return the message and the exit status for an error; None for a defect of the program."""
    if isinstance(error, CaseError):
        return str(error), BAD_INPUT
    fenicsx = ("dolfinx", "ufl", "petsc4py", "mpi4py")
    if isinstance(error, ModuleNotFoundError) and error.name in fenicsx:
        from delam_fem.model.discretise import INSTALL

        return f"{error.name} is not installed, but needed here: {INSTALL}", BAD_INPUT
    if isinstance(error, MemoryError):
        return f"not enough memory ({error or 'no more is to be had'})", FAILED
    if isinstance(error, OSError):
        reason = error.strerror or str(error)
        return f"{error.filename or 'input or output'}: {reason}", FAILED
    return ("interrupted", INTERRUPTED) if isinstance(error, KeyboardInterrupt) else None


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
    if not have_arrived(at_end, has_failed=failure is not None):
        assert failure is not None
        _abort(comm, failure)
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
    text, status = _explained(failure)
    if text is None:
        _log.critical("process %d failed", comm.rank, exc_info=failure)
    elif text:
        tell(f"delam-fem: {text}")
    comm.Abort(status)
    raise failure  # for the types: nothing comes behind an abort


def _explained(failure: BaseException) -> tuple[str | None, int]:
    """Return the message of an error and the exit status; None: it is a defect of the program."""
    if isinstance(failure, typer.Exit):
        return "", failure.exit_code  # it is told already
    return explained(failure) or (None, FAILED)
