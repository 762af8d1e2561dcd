"""How far a run or a sweep has come: a bar on a terminal, plain lines elsewhere."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TypeAlias

from rich.console import Console
from rich.progress import (
    BarColumn,
    Progress,
    ProgressColumn,
    Task,
    TextColumn,
    TimeRemainingColumn,
)
from rich.text import Text

Report: TypeAlias = Callable[[int, int], None]
"""Called with the periods (points) done and all of them, once per period (chunk of points)."""

LINES = 10
"""Plain lines per run, at most, unless it is slow."""

SILENCE = 10.0
"""Seconds after which a plain line is due in any case."""


@contextmanager
def progress(console: Console, steps_per_period: int = 0) -> Iterator[Report]:
    """Show the progress of a run on a console.

    Args:
        console: where; a bar if it is a terminal.
        steps_per_period: for the rate; 0: points of a sweep are counted, not periods.

    Yields:
        The function to call with the periods (points) done and all of them.
    """
    if not console.is_terminal:
        yield PlainProgress(lambda line: console.print(line, soft_wrap=True), steps_per_period)
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

        yield report


def _unit(steps_per_period: int) -> str:
    """Return what is counted."""
    return "period" if steps_per_period else "point"


def _rate(per_second: float, steps_per_period: int) -> str:
    """Return a rate of periods or points as text."""
    if not steps_per_period:
        return f"{per_second:,.4g} points/s"
    return f"{per_second * steps_per_period:,.0f} steps/s"


class _Rate(ProgressColumn):
    """Steps or points per second."""

    def __init__(self, steps_per_period: int) -> None:
        """Keep the number of steps per period."""
        super().__init__()
        self.steps_per_period = steps_per_period

    def render(self, task: Task) -> Text:
        """Return the rate as text."""
        speed = task.speed
        return Text(_rate(speed, self.steps_per_period) if speed else "")


class PlainProgress:
    """Say every tenth of the run, or every ten seconds, how far it is.

    Attributes:
        say: what a line is handed to.
        steps_per_period: for the rate; 0 counts points.
    """

    def __init__(
        self,
        say: Callable[[str], None],
        steps_per_period: int,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Begin without a mark: the first call sets it, as a resumed run does not begin at 0."""
        self.say = say
        self.steps_per_period = steps_per_period
        self._clock = clock
        self._start: tuple[float, int] | None = None
        self._said: tuple[float, int] = (0.0, 0)

    def __call__(self, done: int, total: int) -> None:
        """Take notice of a period; say a line if one is due."""
        now = (self._clock(), done)
        if self._start is None:
            self._start = self._said = now
        is_next_tenth = done * LINES // total > self._said[1] * LINES // total
        if done == total or is_next_tenth or now[0] - self._said[0] >= SILENCE:
            self._said = now
            unit = _unit(self.steps_per_period)
            self.say(f"{unit} {done} of {total}{self._rate(self._start, now, total)}")

    def _rate(self, start: tuple[float, int], now: tuple[float, int], total: int) -> str:
        """Return the rate and the time left, once they are known."""
        seconds, periods = now[0] - start[0], now[1] - start[1]
        if seconds <= 0.0 or periods <= 0:
            return ""
        left = (total - now[1]) * seconds / periods
        return f", {_rate(periods / seconds, self.steps_per_period)}, {left:.0f} s left"
