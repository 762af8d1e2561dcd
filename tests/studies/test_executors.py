"""Which executor is chosen, with how many workers, and what is said where there are none."""

from __future__ import annotations

import logging
import multiprocessing
import os
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from logging.handlers import QueueHandler
from multiprocessing.connection import Connection
from pathlib import Path
from types import ModuleType

import pytest
from project import ROOT

from delam_fem.api import CaseError
from delam_fem.studies import executors

RANKS = ("OMPI_COMM_WORLD_SIZE", "PMI_SIZE", "MPI_LOCALNRANKS")


@pytest.fixture
def alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """Take away what mpiexec would leave behind."""
    for name in RANKS:
        monkeypatch.delenv(name, raising=False)
    monkeypatch.delitem(sys.modules, "mpi4py.futures", raising=False)


@pytest.mark.usefixtures("alone")
def test_processes_are_the_default() -> None:
    assert executors.default_name() == "process"


@pytest.mark.usefixtures("alone")
def test_ranks_are_taken_where_mpi4py_futures_has_started_them(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("OMPI_COMM_WORLD_SIZE", "3")
    monkeypatch.setitem(sys.modules, "mpi4py.futures", ModuleType("mpi4py.futures"))
    assert executors.default_name() == "mpi"


@pytest.mark.usefixtures("alone")
@pytest.mark.parametrize("name", RANKS)
def test_ranks_that_would_all_do_the_same_are_refused(
    monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    monkeypatch.setenv(name, "3")
    with pytest.raises(CaseError, match=r"3 MPI processes would all do the same; use mpiexec"):
        executors.default_name()


@pytest.mark.usefixtures("alone")
def test_one_rank_is_too_few_and_leaves_processes_the_default() -> None:
    with pytest.raises(CaseError, match=r"at least 2 MPI processes, given 1; use mpiexec"):
        executors.Pool("mpi", None)
    assert executors.default_name() == "process"


def test_executors_tell_their_size() -> None:
    with ThreadPoolExecutor(3) as threads:
        assert executors.size_of(threads) == 3
    assert executors.size_of(executors.Serial()) >= 1


def test_a_serial_pool_is_one_worker_and_is_not_renewed() -> None:
    with executors.pool("serial", 7) as opened:
        assert opened.n_workers == 1
        assert opened.renew is None


SWEEP = """
import delam_fem as df
from delam_fem.studies.sweeps.grid import sweep_of

small = {"mesh.elements": 1, "time.periods": 4, "output.fields_per_period": 0}
axis = {"key": "excitation.frequency", "values": [3.0, 3.5, 4.0]}
sweep = sweep_of({"name": "s", "base": "paper", "set": small, "axis": [axis]})
df.run_sweep(sweep, "out", workers=2)
"""
STUDY = """
import delam_fem as df

case = df.preset("paper", {"mesh.elements": 1, "time.steps_per_period": 50})
df.converge(case, "out", elements=[1, 2], periods=20, workers=2)
"""


@pytest.mark.slow
@pytest.mark.parametrize(("script", "remedy"), [(SWEEP, ', or use executor="serial"'), (STUDY, "")])
def test_a_script_without_a_guard_is_told_once(script: str, remedy: str, tmp_path: Path) -> None:
    """Each worker imports the script, which would begin the computation again."""
    (tmp_path / "script.py").write_text(script)
    environment = os.environ | {"PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"}
    command = [sys.executable, "script.py"]
    done = subprocess.run(
        command, cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=600
    )
    assert done.returncode == 1
    assert done.stderr.count("__main__") == 1
    assert done.stderr.rstrip().endswith(f'if __name__ == "__main__":`{remedy}')
    assert "locked" not in done.stderr and "another process" not in done.stderr
    assert "holds" not in done.stderr


def leave_slowly() -> None:
    """Close the files, by which the parent sees the end, before the exit status exists.

    The one by which the worker sees the end of the parent stays: the thread that waits for it may
    begin only now, and would take a closed file for that end.
    """
    parent = multiprocessing.parent_process()
    assert parent is not None
    os.closerange(3, parent.sentinel)
    os.closerange(parent.sentinel + 1, 256)
    time.sleep(0.5)
    os._exit(executors._UNGUARDED)


def test_the_status_of_a_dead_worker_is_waited_for() -> None:
    """On an idle machine the pool broke before the status was there, and nothing was told."""
    with executors.pool("process", 1) as opened:
        future = opened.executor.submit(leave_slowly)
        with pytest.raises(BrokenProcessPool):
            future.result(timeout=600.0)
        assert opened.renew is not None
        with pytest.raises(CaseError, match="__main__"):
            opened.renew()


def test_an_error_ends_the_workers_at_once() -> None:
    with pytest.raises(ZeroDivisionError), executors.pool("process", 1) as opened:
        assert opened.executor.submit(os.getpid).result(timeout=600.0) != os.getpid()
        asleep = opened.executor.submit(time.sleep, 600.0)
        while not asleep.running():
            time.sleep(0.01)
        (worker,) = opened.executor._processes.values()
        raise ZeroDivisionError
    end = time.monotonic() + 10.0
    while worker.exitcode is None and time.monotonic() < end:
        worker.join(0.1)  # the thread of the pool may ask for the status at the same time
    assert worker.exitcode == -signal.SIGKILL


def test_two_threads_may_close_what_the_workers_read(monkeypatch: pytest.MonkeyPatch) -> None:
    """They do when a pool breaks; a file that was closed twice kept the process from its end."""
    with executors.pool("process", 1) as opened:
        reader = opened.executor._call_queue._reader
        closed = []

        def close_slowly(connection: Connection) -> None:
            closed.append(connection.fileno())
            time.sleep(0.1)

        with monkeypatch.context() as slow:
            slow.setattr(Connection, "_close", close_slowly)
            threads = [threading.Thread(target=reader.close) for _ in range(2)]
            for thread in threads:
                thread.start()
            for thread in threads:
                thread.join()
        (file,) = closed
        os.close(file)


def die_with_the_lock_of_the_messages() -> None:
    """Die as a worker that is killed in the midst of a message."""
    (handler,) = (h for h in logging.getLogger("delam_fem").handlers if isinstance(h, QueueHandler))
    handler.queue._wlock.acquire()
    die()


def test_a_worker_that_dies_in_a_message_keeps_nobody() -> None:
    with executors.pool("process", 1) as opened:
        dead = opened.executor.submit(die_with_the_lock_of_the_messages)
        with pytest.raises(BrokenProcessPool):
            dead.result(timeout=600.0)
        renewal = threading.Thread(target=opened.renew, daemon=True)
        renewal.start()
        renewal.join(timeout=600.0)
        assert not renewal.is_alive()


def die() -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def test_a_broken_pool_does_not_wait_for_the_workers_that_live() -> None:
    """They ignore the signal by which Python ends them, and may wait for what no one gives."""
    begin = time.monotonic()
    with executors.pool("process", 2) as opened:
        asleep = opened.executor.submit(time.sleep, 3000.0)
        while not asleep.running():
            time.sleep(0.01)
        with pytest.raises(BrokenProcessPool):
            opened.executor.submit(die).result(timeout=600.0)
    assert time.monotonic() - begin < 1500.0


def test_a_pool_that_broke_with_a_full_pipe_ends() -> None:
    with executors.pool("process", 1) as opened:
        asleep = opened.executor.submit(time.sleep, 3000.0)
        waiting = opened.executor.submit(len, bytes(10**6))  # more than a pipe holds
        while not asleep.running():
            time.sleep(0.01)
        manager = opened.executor._executor_manager_thread
        (worker,) = opened.executor._processes.values()
        time.sleep(0.5)
        os.kill(worker.pid, signal.SIGKILL)
        with pytest.raises(BrokenProcessPool):
            waiting.result(timeout=600.0)
        opened.renew()
        manager.join(600.0)
        assert not manager.is_alive()
