"""Provide executors for many runs: a process pool, the ranks of MPI, or this process."""

from __future__ import annotations

import logging
import multiprocessing
import multiprocessing.connection
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor, Executor, Future, ProcessPoolExecutor
from contextlib import contextmanager, suppress
from logging.handlers import QueueHandler, QueueListener
from multiprocessing.context import SpawnContext, SpawnProcess
from typing import Any, Literal, ParamSpec, TypeVar

from delam_fem.api import ONE_THREAD, STOPPING, CaseError, added, keep_garbage

ExecutorName = Literal["process", "mpi", "serial"]

_PACKAGE = __name__.partition(".")[0]
_log = logging.getLogger(_PACKAGE)
_P = ParamSpec("_P")
_T = TypeVar("_T")

_MEMORY = {"MALLOC_MMAP_THRESHOLD_": "33554432", "MALLOC_TRIM_THRESHOLD_": "268435456"}
"""Settings of the C library: the next point takes the memory of the last one (up to 32 MiB a piece,
the most that can be set). Asking the system for it again takes 4 % of the time of a short point."""
_OF_WORKERS = ONE_THREAD | _MEMORY | {"PYTHONSAFEPATH": "1"}
"""Environment of workers: modules in the working folder must not replace those that a worker
imports."""
_RANKS = ("OMPI_COMM_WORLD_SIZE", "PMI_SIZE", "MPI_LOCALNRANKS")
"""Variables that hold the number of processes under mpiexec."""
_UNGUARDED = 76
"""Exit status of a worker whose script begins a computation when it is imported."""
_NO_GUARD = (
    "workers: each worker process imports the script, which begins the computation again; put the "
    'call under `if __name__ == "__main__":`'
)
"""What such a script is told."""
MPI_COMMAND = "mpiexec -n N python -m mpi4py.futures -m delam_fem sweep …"


class Serial(Executor):
    """Executor that computes at once, in this process."""

    def submit(self, fn: Callable[_P, _T], /, *args: _P.args, **kwargs: _P.kwargs) -> Future[_T]:
        """Call the function and return its result as a future."""
        future: Future[_T] = Future()
        future.set_result(fn(*args, **kwargs))
        return future


def default_name() -> ExecutorName:
    """Return "mpi" under `python -m mpi4py.futures`, otherwise "process".

    Raises:
        CaseError: mpiexec has started several processes that would all compute the same.
    """
    n_ranks = max(int(os.environ.get(name, "1")) for name in _RANKS)
    if "mpi4py.futures" in sys.modules:
        return "mpi"
    if n_ranks > 1:
        raise CaseError(
            f"executor: {n_ranks} MPI processes would all do the same; use {MPI_COMMAND}"
        )
    return "process"


def leave_if_imported() -> None:
    """End this process if it is a worker that imports the script of a user.

    Each worker of a process pool imports the script that has started it. A script that begins a
    computation without `if __name__ == "__main__":` would begin it again in each of them. The
    process that waits for the worker reports the error.
    """
    if getattr(multiprocessing.current_process(), "_inheriting", False):
        os._exit(_UNGUARDED)


def n_cores() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def size_of(executor: Executor) -> int:
    """Return the number of workers of an executor, or of cores if the executor does not say it."""
    for name in ("num_workers", "_max_workers"):  # mpi4py; the pools of the standard library
        size = getattr(executor, name, None)
        if isinstance(size, int) and size > 0:
            return size
    client = getattr(executor, "_client", None)  # Dask
    return sum(client.nthreads().values()) if client is not None else n_cores()


class Pool:
    """Owner of an executor, which it can replace after a worker has died.

    Attributes:
        kind: kind of the executor, or the given one.
        n_workers: number of its workers.
        executor: the present executor.
    """

    def __init__(self, kind: Executor | ExecutorName, workers: int | None) -> None:
        """Start the executor, or take the given one.

        Raises:
            CaseError: "mpi" is asked for, but there is only one process.
        """
        self.kind = kind
        if isinstance(kind, Executor):
            self.executor, self.n_workers = kind, workers or size_of(kind)
        elif kind == "mpi":
            from delam_fem.api import MPI

            n_workers = MPI.COMM_WORLD.size - 1
            if n_workers < 1:
                raise CaseError(
                    f"executor: expected at least 2 MPI processes, given 1; use {MPI_COMMAND}"
                )
            from mpi4py.futures import MPIPoolExecutor  # default_name looks for this module

            self.executor = MPIPoolExecutor()
            self.n_workers = n_workers
        else:
            self.n_workers = 1 if kind == "serial" else workers or n_cores()
            self.executor = Serial() if kind == "serial" else _process_pool(self.n_workers)

    @property
    def renew(self) -> Callable[[], Executor] | None:
        """Function that replaces a broken process pool; None for the other kinds of executors."""
        return self._renewed if self.kind == "process" else None

    def _renewed(self) -> Executor:
        """Replace the executor.

        Raises:
            CaseError: its workers died because the script of the user has no guard.
        """
        if _UNGUARDED in _abandon(self.executor):
            raise CaseError(f'{_NO_GUARD}, or use executor="serial"')
        self.executor = _process_pool(self.n_workers)
        return self.executor


@contextmanager
def pool(kind: Executor | ExecutorName, workers: int | None = None) -> Iterator[Pool]:
    """Open an executor, and shut it down at the end of the `with` block.

    Args:
        kind: "process", "mpi" or "serial"; or an executor that is open, and stays open.
        workers: number of processes; default: one per core. MPI uses the processes that mpiexec
            has started.

    Yields:
        The owner of the executor.

    Raises:
        CaseError: "mpi" is asked for, but there is only one process; or the workers died because
            the script of the user has no guard.
    """
    leave_if_imported()
    if isinstance(kind, Executor):
        yield Pool(kind, workers)
        return
    with added(_OF_WORKERS if kind == "process" else {}):
        opened = Pool(kind, workers)
        try:
            yield opened
        except BaseException as error:
            statuses = _abandon(opened.executor)
            if isinstance(error, BrokenExecutor) and _UNGUARDED in statuses:
                raise CaseError(_NO_GUARD) from None
            raise
        opened.executor.shutdown(wait=True, cancel_futures=True)


def _process_pool(workers: int) -> ProcessPoolExecutor:
    """Return a pool of new interpreters; forked ones would share the state of an MPI library."""
    context = _Spawning()
    messages = context.Queue()
    level = _log.getEffectiveLevel()
    executor = _ListeningPool(
        workers, mp_context=context, initializer=_prepare_worker, initargs=(messages, level)
    )
    _let_threads_close(executor._call_queue._reader)  # type: ignore[attr-defined]
    executor.listen(messages)
    return executor


def _let_threads_close(connection: Any) -> None:
    """Let several threads close a connection.

    Of two that do so at once, the second would close the file a second time. It would fail, or
    close one that was opened meanwhile. The thread that feeds the workers of a pool waits forever
    after such a failure, and with it the end of the process.
    """
    lock = threading.Lock()
    close = connection.close

    def close_once() -> None:
        with lock:
            close()

    connection.close = close_once


class _Worker(SpawnProcess):
    """A worker that a broken pool has to kill, because it ignores the signal to terminate."""

    def terminate(self) -> None:
        """Kill the process, which may wait for a lock of a dead worker, or for a reader."""
        if not multiprocessing.connection.wait([self.sentinel], timeout=0.0):
            self.kill()  # one that is leaving keeps its status, which says why


class _Spawning(SpawnContext):
    """New interpreters as workers."""

    Process = _Worker


class _ListeningPool(ProcessPoolExecutor):
    """A process pool whose workers' messages appear in the log of this process."""

    _listener: _Listener | None = None

    def listen(self, messages: Any) -> None:
        """Take in the messages in a queue, until the pool is shut down."""
        self._listener = _Listener(messages)
        self._listener.start()

    def submit(self, function: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Submit a call, and watch the worker that may have been started for it."""
        n_workers = len(self._processes or ())
        future = super().submit(function, *args, **kwargs)
        if n_workers and len(self._processes) > n_workers:
            with self._shutdown_lock:  # the manager may have listed the workers before the new one
                self._executor_manager_thread_wakeup.wakeup()
        return future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Shut the pool down, and show the last messages."""
        super().shutdown(wait, cancel_futures=cancel_futures)
        listener = self._listener
        self._listener = None
        if listener is not None:
            listener.stop()


class _Listener(QueueListener):
    """A thread that takes in the messages of workers.

    No message ends it: a worker that was killed while it sent one keeps the lock of the queue, so
    that nobody could send another.
    """

    def __init__(self, messages: Any) -> None:
        """Store the queue of the messages."""
        super().__init__(messages, _Here())
        self._ending, self._end = multiprocessing.Pipe(duplex=False)

    def dequeue(self, block: bool) -> Any:
        """Wait for a message, or for the end once all messages are taken in."""
        messages = self.queue._reader  # type: ignore[attr-defined]
        ready = multiprocessing.connection.wait([messages, self._ending])
        return self.queue.get() if messages in ready else None

    def enqueue_sentinel(self) -> None:
        """Let the thread end."""
        self._end.close()


class _Here(logging.Handler):
    """Handler that gives a message of a worker to the log of this process."""

    def emit(self, record: logging.LogRecord) -> None:
        """Handle one record as if it came from here."""
        logging.getLogger(record.name).handle(record)


def _prepare_worker(messages: Any, level: int) -> None:
    """Send messages to the parent, ignore the signals that it handles, and exit when it dies.

    Terminals and batch systems send these signals to all processes; a worker that obeyed would lose
    the points that it computes.
    """
    keep_garbage()
    messages.cancel_join_thread()  # a worker that ends does not wait for its messages to arrive
    log = logging.getLogger(_PACKAGE)
    log.addHandler(QueueHandler(messages))
    log.propagate = False
    log.setLevel(level)
    for number in STOPPING:
        signal.signal(number, signal.SIG_IGN)
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_end_with, args=(parent.sentinel,), daemon=True).start()


def _end_with(sentinel: Any) -> None:
    """Exit when the parent has ended, even by kill -9; the queues of the pool would not notice."""
    multiprocessing.connection.wait([sentinel])
    os._exit(1)


def _abandon(executor: Executor) -> set[int]:
    """Shut an executor down and kill its workers; return the exit statuses of the already dead."""
    processes = list((getattr(executor, "_processes", None) or {}).values())  # shutdown drops them
    calls = getattr(executor, "_call_queue", None)
    dead = multiprocessing.connection.wait([process.sentinel for process in processes], timeout=0.0)
    executor.shutdown(wait=False, cancel_futures=True)
    statuses = {_status(process) for process in processes if process.sentinel in dead}
    for process in processes:
        process.kill()
    if calls is not None:
        with suppress(OSError):  # the thread that feeds the pipe may be closing it as well
            calls._reader.close()  # Python up to 3.11.4 would wait for a reader of a full pipe
    return statuses


def _status(process: Any) -> int:
    """Return the exit status of a process that has closed its files.

    The system tells the status only a moment later, and only one of two threads that ask for it.
    """
    while process.exitcode is None:
        process.join(0.1)
    return int(process.exitcode)
