"""What a file of measurements holds before its columns are named: columns with units, a rate."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

Values = npt.NDArray[Any]
"""Real or complex values, shape (n,)."""

TIMES = {"t", "time", "zeit", "temps", "tempo", "seconds", "sekunden"}
FREQUENCIES = {"f", "freq", "frequency", "frequenz", "frequencies"}
POSITIONS = {"x", "position", "pos"}
"""Names of columns that are axes of the others, in lower case."""
HEADING = re.compile(r"^(?P<name>.*?)\s*(?:\[(?P<square>[^\]]*)\]|\((?P<round>[^)]*)\))?\s*$")
"""A name with its unit behind it."""
AXES = {"time": TIMES, "frequency": FREQUENCIES, "x": POSITIONS}


@dataclass(frozen=True)
class Column:
    """A column as a file has it.

    Attributes:
        name: in the file; of a table without headings colN.
        values: in the unit of the file, real or complex, shape (n,).
        unit: as the file names it; None: it names none.
        quantity: where the file says so itself; empty: by the unit.
        position: where it was measured [m]; None: not known.
        lamina: on which it was measured; empty: not known.
        kind: "signal", "response" (a frequency response), "coherence".
    """

    name: str
    values: Values
    unit: str | None = None
    quantity: str = ""
    position: float | None = None
    lamina: str = ""
    kind: str = "signal"


@dataclass(frozen=True)
class Sheet:
    """Columns of the same length that belong together.

    Attributes:
        label: file, and what in it, for messages.
        columns: in the order of the file.
        rate: samples per second, where the file says so; None: a column has the times.
        notes: what was put right when the file was read.
        alias: another name of its only signal, such as set3; empty: none.
    """

    label: str
    columns: tuple[Column, ...]
    rate: float | None = None
    notes: tuple[str, ...] = ()
    alias: str = ""


def axis_of(name: str, unit: str | None) -> str:
    """Return which axis a column is: "time", "frequency", "x", or "" for none.

    Args:
        name: of the column.
        unit: that the file names.
    """
    word = name.strip().lower()
    for axis, names in AXES.items():
        if word in names:
            return axis
    if unit in ("s", "ms", "us", "µs", "min"):
        return "time"
    return "frequency" if unit in ("Hz", "kHz") and word.startswith("freq") else ""


def heading(text: str) -> tuple[str, str | None]:
    """Return name and unit of a heading such as "thick [mm]" or "thick (mm)"; None: no unit."""
    found = HEADING.match(text.strip().strip('"'))
    if found is None:
        return text, None
    unit = found["square"] if found["square"] is not None else found["round"]
    return found["name"].strip(), unit if unit is None else unit.strip()


def matrix_columns(name: str, values: Values, names: list[str] | None = None) -> list[Column]:
    """Return the rows of a matrix, shape (n_columns, n), as columns.

    Args:
        name: of the matrix.
        values: one row for each column.
        names: of the columns; None: they are numbered.
    """
    rows = np.atleast_2d(values)
    if names is None:
        names = [name] if len(rows) == 1 else [f"{name}_{k}" for k in range(1, len(rows) + 1)]
    return [Column(own, row) for own, row in zip(names, rows, strict=True)]
