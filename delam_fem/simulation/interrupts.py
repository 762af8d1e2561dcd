"""End a run early on a signal, write checkpoints at intervals, and report progress."""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from delam_fem.simulation.loop import Outcome

if TYPE_CHECKING:  # sweeps use `stop_signals` in a process that must not start MPI
    from mpi4py import MPI

CHECKPOINT_SECONDS = 30.0
"""Least time between two checkpoints [s]: little is lost in a crash, and little time is spent."""


@contextmanager
def stop_signals() -> Iterator[Callable[[], bool]]:
    """Catch Ctrl-C and SIGTERM, and yield a function that says whether one has arrived.

    A second signal raises KeyboardInterrupt at once. Outside the main thread nothing is caught.
    """
    received: list[int] = []
    if threading.current_thread() is not threading.main_thread():
        yield lambda: False
        return

    def note(number: int, frame: object) -> None:
        if received:
            raise KeyboardInterrupt
        received.append(number)

    before = {number: signal.signal(number, note) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield lambda: bool(received)
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


class Watch:
    """Callback after each period: reports progress, saves checkpoints, decides whether to stop."""

    def __init__(
        self,
        save: Callable[[Path], None],
        path: Path | None,
        report: Callable[[int], None],
        is_stopped: Callable[[], bool],
        comm: MPI.Intracomm,
    ) -> None:
        """Store the callbacks and start the clock of the checkpoints.

        Args:
            save: function that writes a checkpoint to a path.
            path: path of the checkpoint; None: no checkpoints.
            report: function that takes the number of finished periods.
            is_stopped: function that says whether this process was asked to stop.
            comm: communicator whose ranks must decide the same.
        """
        self._save, self._path, self._report = save, path, report
        self._is_stopped, self._comm = is_stopped, comm
        self._last = time.monotonic()

    def __call__(self, period: int) -> bool:
        """Report a period, save a checkpoint if due, and return whether to stop.

        All ranks return the same.
        """
        from mpi4py import MPI

        self._report(period)
        is_due = time.monotonic() - self._last > CHECKPOINT_SECONDS
        wishes = self._comm.allreduce(2 * is_due + self._is_stopped(), MPI.BOR)
        if self._path is not None and wishes & 2:
            self._save(self._path)
            self._last = time.monotonic()
        return bool(wishes & 1)

    def leave(self, outcome: Outcome) -> None:
        """Save a checkpoint of an interrupted run, and remove that of a finished one."""
        if self._path is not None and outcome == "interrupted":
            self._save(self._path)
        elif self._path is not None:
            self._path.unlink(missing_ok=True)
