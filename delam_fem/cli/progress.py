"""Show the progress of a run or a sweep: a bar on a terminal, plain lines elsewhere."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TypeAlias

from rich.console import Console
from rich.progress import BarColumn, Progress, ProgressColumn, Task, TextColumn, TimeRemainingColumn
from rich.text import Text

Report: TypeAlias = Callable[[int, int], None]
"""Function of the numbers of finished and of all periods (or points, in a sweep), called after each
period (or chunk of points)."""

LINES = 10
"""Number of plain lines per run, unless the run is slow."""

SILENCE = 10.0
"""Longest time between two plain lines [s]."""

_log = logging.getLogger(__name__)


@contextmanager
def progress(console: Console, steps_per_period: int = 0) -> Iterator[Report]:
    """Show the progress of a run on a console.

    Args:
        console: console for the output; a terminal shows a bar.
        steps_per_period: number of steps per period, for the rate; 0: count points of a sweep
            instead of periods.

    Yields:
        The function to call with the numbers of finished and of all periods (or points).
    """
    logged = PlainProgress(_log.debug, steps_per_period)
    if console.quiet:  # a bar would still hide and show the cursor
        yield logged
        return
    if not console.is_terminal:

        def say(line: str) -> None:
            console.print(line, soft_wrap=True)
            _log.debug(line)

        yield PlainProgress(say, steps_per_period)
        return
    columns = (
        TextColumn(_unit(steps_per_period) + " {task.completed:.0f} of {task.total:.0f}"),
        BarColumn(),
        _Rate(steps_per_period),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=console, transient=True) as bar:

        def report(done: int, total: int) -> None:
            if not bar.tasks:  # a resumed run does not start at 0
                bar.add_task("run", total=total, completed=done)
            bar.update(bar.tasks[0].id, completed=done)
            logged(done, total)

        yield report


def _unit(steps_per_period: int) -> str:
    """Return the word for the counted unit."""
    return "period" if steps_per_period else "point"


def _rate(per_second: float, steps_per_period: int) -> str:
    """Return a rate of periods or points as text."""
    if not steps_per_period:
        return f"{per_second:,.4g} points/s"
    return f"{per_second * steps_per_period:,.0f} steps/s"


class _Rate(ProgressColumn):
    """Column of the progress bar with steps or points per second."""

    def __init__(self, steps_per_period: int) -> None:
        """Store the number of steps per period."""
        super().__init__()
        self.steps_per_period = steps_per_period

    def render(self, task: Task) -> Text:
        """Return the rate as text."""
        speed = task.speed
        return Text(_rate(speed, self.steps_per_period) if speed else "")


class PlainProgress:
    """Print a line at every tenth of the run, and at least every ten seconds.

    Attributes:
        say: function that prints a line.
        steps_per_period: number of steps per period, for the rate; 0: count points.
    """

    def __init__(
        self,
        say: Callable[[str], None],
        steps_per_period: int,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Store the arguments; the first call sets the start, because a resumed run is past 0."""
        self.say = say
        self.steps_per_period = steps_per_period
        self._clock = clock
        self._start: tuple[float, int] | None = None
        self._said: tuple[float, int] = (0.0, 0)

    def __call__(self, done: int, total: int) -> None:
        """Count a finished period, and print a line if one is due."""
        now = (self._clock(), done)
        if self._start is None:
            self._start = self._said = now
        is_next_tenth = done * LINES // total > self._said[1] * LINES // total
        if done == total or is_next_tenth or now[0] - self._said[0] >= SILENCE:
            self._said = now
            unit = _unit(self.steps_per_period)
            self.say(f"{unit} {done} of {total}{self._rate(self._start, now, total)}")

    def _rate(self, start: tuple[float, int], now: tuple[float, int], total: int) -> str:
        """Return the rate and the remaining time as text; empty until they are known."""
        seconds, periods = now[0] - start[0], now[1] - start[1]
        if seconds <= 0.0 or periods <= 0:
            return ""
        left = (total - now[1]) * seconds / periods
        return f", {_rate(periods / seconds, self.steps_per_period)}, {left:.0f} s left"
