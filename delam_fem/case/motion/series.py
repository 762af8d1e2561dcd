"""Read a course of values in time from a CSV table: two columns, time [s] and value."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from delam_fem.case.tables import described, rows_of
from delam_fem.case.toml import CaseError
from delam_fem.numerics.arrays import FloatArray

_UNIT = re.compile(r"[\[(]\s*([^\])]*?)\s*[\])]\s*$")
"""A unit in brackets at the end of a heading."""
_TIMES = {"s"}
_UNITS = {
    "base": {"m": "m", "m/s2": "m/s2", "m/s^2": "m/s2", "m/s²": "m/s2", "m/s**2": "m/s2"},
    "force": {"N": "N"},
}
"""Units of the values by what they act on, as they may be written, and as they are kept."""


@dataclass(frozen=True)
class Series:
    """Values in time.

    Attributes:
        time: times from 0, increasing, shape (rows,) [s].
        value: values, shape (rows,).
        unit: unit of the values: "m", "m/s2" or "N".
    """

    time: FloatArray
    value: FloatArray
    unit: str

    @property
    def length(self) -> float:
        """Last time [s]."""
        return float(self.time[-1])


def read_series(path: Path, acts_on: str, least_rows: int = 6) -> Series:
    """Read a table and check it.

    Comments (#) are skipped. A heading may give units in brackets: `time [s], force [N]`. Without
    units, times are in s, values in m (base) or N (force).

    Args:
        path: CSV file with the columns time and value.
        acts_on: "base" or "force".
        least_rows: smallest number of rows.

    Raises:
        CaseError: the file is missing; a heading has another unit; a row is not a pair of finite
            numbers; the times do not begin at 0 or do not increase; or there are too few rows.
    """
    name = f"excitation.file {path}"
    unit, numbers, rows = next(iter(_UNITS[acts_on].values())), [], []
    is_first = True
    for number, cells in rows_of(path, name):
        place = f"{name}, line {number}"
        if len(cells) != 2:
            raise CaseError(
                f"{place}: expected two columns, time and value, given {described(cells)}"
            )
        row = _row(cells)
        if row is None and is_first:
            unit = _unit_of(cells, acts_on, place) or unit
        elif row is None:
            raise CaseError(f"{place}: expected two finite numbers, given {described(cells)}")
        else:
            numbers.append(number)
            rows.append(row)
        is_first = False
    if len(rows) < least_rows:
        raise CaseError(f"{name}: expected at least {least_rows} rows, given {len(rows)}")
    time, value = np.array(rows).T
    _check_times(time, numbers, name)
    return Series(time, value, unit)


def _row(cells: list[str]) -> tuple[float, float] | None:
    """Return a pair of finite numbers, or None."""
    try:
        pair = float(cells[0]), float(cells[1])
    except ValueError:
        return None
    return pair if np.isfinite(pair).all() else None


def _unit_of(heading: list[str], acts_on: str, place: str) -> str | None:
    """Return the unit of the values that a heading gives, or None."""
    times, values = (_UNIT.search(cell) for cell in heading)
    if times is not None and times[1] not in _TIMES:
        raise CaseError(f"{place}: expected times in s, given {times[1][:8]}")
    if values is None:
        return None
    known = _UNITS[acts_on]
    if values[1] not in known:
        expected = " or ".join(dict.fromkeys(known.values()))
        raise CaseError(
            f'{place}: expected values in {expected} with acts_on = "{acts_on}", given '
            f"{values[1][:8]}"
        )
    return known[values[1]]


def _check_times(time: FloatArray, lines: list[int], name: str) -> None:
    """Check that times begin at 0 and increase."""
    if time[0] != 0.0:
        raise CaseError(
            f"{name}, line {lines[0]}: expected times from 0, given {time[0]}; subtract the first "
            "time"
        )
    for k in np.flatnonzero(~(np.diff(time) > 0.0)):
        raise CaseError(
            f"{name}, line {lines[k + 1]}: expected times to increase, given {time[k + 1]} after "
            f"{time[k]}"
        )
