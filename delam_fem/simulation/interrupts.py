"""End a run early on a signal, write checkpoints at intervals, and report progress.

Ctrl-C (SIGINT), SIGTERM and a closed terminal (SIGHUP) end a run after the period it is in, or
after the block of periods that the compiled engine computes in one go.
"""

from __future__ import annotations

import logging
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import TYPE_CHECKING

from delam_fem.simulation.loop import Outcome

if TYPE_CHECKING:  # sweeps use `stop_signals` in a process that must not start MPI
    from delam_fem.simulation.checkpoint import Progress
    from delam_fem.system.mpi import MPI

CHECKPOINT_SECONDS = 30.0
"""Least time between two checkpoints [s]: little is lost in a crash, and little time is spent."""

STOPPING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
"""Signals that end a run: Ctrl-C, a polite kill, a closed terminal."""

_Handler = Callable[[int, FrameType | None], None]
_log = logging.getLogger(__name__)


@contextmanager
def stop_signals() -> Iterator[Callable[[], bool]]:
    """Catch the signals of `STOPPING`, and yield a function that says whether one has arrived.

    A second Ctrl-C raises KeyboardInterrupt at once. Outside the main thread nothing is caught.
    """
    received: list[int] = []

    def note(number: int, frame: object) -> None:
        if received and number == signal.SIGINT:
            raise KeyboardInterrupt
        received.append(number)

    with _handled(note):
        yield lambda: bool(received)


@contextmanager
def interruptible() -> Iterator[None]:
    """Raise KeyboardInterrupt on every signal of `STOPPING`."""

    def interrupt(number: int, frame: object) -> None:
        raise KeyboardInterrupt

    with _handled(interrupt):
        yield


@contextmanager
def _handled(handler: _Handler) -> Iterator[None]:
    """Let a function handle the signals of `STOPPING`; `nohup` keeps SIGHUP ignored."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    is_kept = signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    numbers = [number for number in STOPPING if number != signal.SIGHUP or not is_kept]
    before = {number: signal.signal(number, handler) for number in numbers}
    try:
        yield
    finally:
        for number, previous in before.items():
            signal.signal(number, previous)


class Watch:
    """Callback after each block: reports progress, saves checkpoints, decides whether to stop."""

    def __init__(
        self,
        save: Callable[[Progress], None] | None,
        report: Callable[[int], None],
        is_stopped: Callable[[], bool],
        comm: MPI.Intracomm,
        seconds: float = CHECKPOINT_SECONDS,
    ) -> None:
        """Store the callbacks and start the clock of the checkpoints.

        Args:
            save: function that writes a checkpoint of a run that is so far; None: no checkpoints.
            report: function that takes the number of finished periods.
            is_stopped: function that says whether this process was asked to stop.
            comm: communicator whose ranks must decide the same.
            seconds: least time between two checkpoints [s].
        """
        self._save, self._report = save, report
        self._is_stopped, self._comm = is_stopped, comm
        self._seconds, self._last = seconds, time.monotonic()
        self._is_alone = comm.size == 1

    def __call__(self, period: int) -> bool:
        """Report a period, save a checkpoint if due, and return whether to stop.

        All ranks return the same.
        """
        self._report(period)
        is_due = time.monotonic() - self._last > self._seconds
        wishes = 2 * is_due + self._is_stopped()
        if not self._is_alone:
            from delam_fem.system.mpi import MPI

            wishes = self._comm.allreduce(wishes, MPI.BOR)
        if wishes & 2:
            self._try_to_save("running")
            self._last = time.monotonic()
        return bool(wishes & 1)

    def leave(self, outcome: Outcome) -> None:
        """Save the checkpoint of a run that has ended; it stays until the result is on the disk."""
        self._try_to_save("running" if outcome == "interrupted" else outcome)

    def _try_to_save(self, progress: Progress) -> None:
        """Save a checkpoint; if that fails, warn, because the run itself can go on."""
        if self._save is None:
            return
        try:
            self._save(progress)
        except OSError as error:
            _log.warning("%s: %s; the run goes on without it", error.filename, error.strerror)
