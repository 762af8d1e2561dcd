"""Texts that others read, and figures by their words, compared with `tests/golden/`.

Somebody who changed such a format on purpose looks at it, writes the stored texts anew, and reads
their difference:

    .venv/bin/python -m pytest tests/FOLDER --store
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.axes._secondary_axes import SecondaryAxis
from matplotlib.figure import FigureBase
from matplotlib.legend import Legend

TESTS = Path(__file__).parent
FOLDER = TESTS / "golden"


def place(test: str) -> Path:
    """Return the file that belongs to a test, as pytest names it: `folder/test_a.py::test_b[c]`."""
    module, _, name = test.partition("::")
    stem = re.sub(r"[^\w.-]+", "-", name.removeprefix("test_")).strip("-")
    return FOLDER / module.removesuffix(".py") / f"{stem}.txt"


def check(path: Path, text: str, *, store: bool) -> None:
    """Compare a text with the stored one, or store it."""
    new = [line.rstrip() for line in text.splitlines()]
    if store:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("\n".join(new) + "\n", "utf-8")
        return
    old = path.read_text("utf-8").splitlines()
    assert new == old, f"{path} differs (see {Path(__file__).name})"


def describe(figure: FigureBase) -> str:
    """Return what a figure says: titles, labels with units, and how many series each panel has."""
    title = getattr(figure, "_suptitle", None)
    lines = [f"figure {title.get_text() if title else ''!r}"]
    for axes in figure.axes:
        lines += of_panel(axes)
    return "\n".join(lines)


def of_panel(axes: Axes) -> Iterator[str]:
    """Yield the lines that describe a panel."""
    titles = (axes.get_title(side) for side in ("left", "center", "right"))
    yield f"panel {next(filter(None, titles), '')!r}"
    yield f"  x {axes.get_xlabel()!r}, y {axes.get_ylabel()!r}"
    for child in axes.child_axes:
        if isinstance(child, SecondaryAxis):
            yield f"  beside x {child.get_xlabel()!r}, y {child.get_ylabel()!r}"
    series = len(axes.lines) + len(axes.collections) + len(axes.images)
    yield f"  {series} series"
    for legend in (artist for artist in axes.get_children() if isinstance(artist, Legend)):
        yield f"  legend {[entry.get_text() for entry in legend.get_texts()]}"
