"""Show how far a computation is: a bar in a notebook, a bar of the terminal elsewhere."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib import import_module
from typing import Any, TypeAlias

Report: TypeAlias = Callable[[int, int], None]
"""Function of the numbers of finished and of all periods, points or runs."""

LEAST_SECONDS = 0.1
"""Least time between two pictures of a bar [s]."""


@contextmanager
def reporting(progress: Report | bool | None, unit: str) -> Iterator[Report | None]:
    """Yield the function that takes in progress.

    Args:
        progress: such a function; True: show a bar; None or False: nothing.
        unit: what is counted, as in "period".
    """
    if not isinstance(progress, bool):
        yield progress
    elif not progress:
        yield None
    elif _is_notebook():
        yield NotebookBar(unit)
    else:
        from rich.console import Console
        from rich.progress import Progress

        with Progress(console=Console(stderr=True)) as bar:
            task = bar.add_task(f"{unit}s", total=None)
            yield lambda done, total: bar.update(task, completed=done, total=total)


def _is_notebook() -> bool:
    """Return whether this process is the kernel of a notebook."""
    shell = sys.modules.get("IPython")  # a kernel has loaded it
    return shell is not None and getattr(shell.get_ipython(), "kernel", None) is not None


class NotebookBar:
    """A bar in the output of a cell; it needs no widgets.

    Attributes:
        unit: what is counted.
    """

    def __init__(self, unit: str) -> None:
        """Start the clock."""
        self.unit = unit
        self._start: tuple[float, int] | None = None
        self._shown = 0.0
        self._handle: Any = None

    def __call__(self, done: int, total: int) -> None:
        """Show the numbers of finished and of all units, not too often."""
        notebook = import_module("IPython.display")  # of the kernel that runs this
        now = time.monotonic()
        if self._start is None:
            self._start = now, done
        if done < total and self._handle is not None and now - self._shown < LEAST_SECONDS:
            return
        self._shown = now
        picture = notebook.HTML(self._html(done, total, now))
        if self._handle is None:
            self._handle = notebook.display(picture, display_id=True)
        else:
            self._handle.update(picture)

    def _html(self, done: int, total: int, now: float) -> str:
        """Return the bar, and the time that is left once that is known [s]."""
        begin, first = self._start or (now, done)
        new = done - first
        left = f", {(total - done) * (now - begin) / new:.0f} s left" if new and now > begin else ""
        return (
            f'<progress value="{done}" max="{total}"></progress> {self.unit} {done} of {total}'
            f"{left if done < total else ''}"
        )
