"""What may end a run early or save it: signals, checkpoints after some time, progress."""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from delam_fem.simulation.loop import Outcome

if TYPE_CHECKING:  # a sweep waits for signals in a process that must not start MPI
    from mpi4py import MPI

CHECKPOINT_SECONDS = 30.0
"""Time between two checkpoints: little to lose, little to write."""


@contextmanager
def stop_signals() -> Iterator[Callable[[], bool]]:
    """Let Ctrl-C and termination end the run after the present period; a second Ctrl-C at once."""
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
    """Asked after each period: shows progress, leaves checkpoints, says whether to stop."""

    def __init__(
        self,
        save: Callable[[Path], None],
        path: Path | None,
        report: Callable[[int], None],
        is_stopped: Callable[[], bool],
        comm: MPI.Intracomm,
    ) -> None:
        """Set the watch up.

        Args:
            save: writes a checkpoint to a path.
            path: of the checkpoint; None: there are none.
            report: told the number of periods done.
            is_stopped: whether this process was asked to stop.
            comm: ranks that decide alike.
        """
        self._save, self._path, self._report = save, path, report
        self._is_stopped, self._comm = is_stopped, comm
        self._last = time.monotonic()

    def __call__(self, period: int) -> bool:
        """Return whether the run shall end; all ranks decide alike."""
        from mpi4py import MPI

        self._report(period)
        is_due = time.monotonic() - self._last > CHECKPOINT_SECONDS
        wishes = self._comm.allreduce(2 * is_due + self._is_stopped(), MPI.BOR)
        if self._path is not None and wishes & 2:
            self._save(self._path)
            self._last = time.monotonic()
        return bool(wishes & 1)

    def leave(self, outcome: Outcome) -> None:
        """Leave a checkpoint of an interrupted run, and none of a finished one."""
        if self._path is not None and outcome == "interrupted":
            self._save(self._path)
        elif self._path is not None:
            self._path.unlink(missing_ok=True)
