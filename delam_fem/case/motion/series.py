"""Read a course of values in time from a table: two columns, time [s] and value."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from delam_fem.case.tables import read_columns, require_unit
from delam_fem.case.toml import CaseError
from delam_fem.numerics.arrays import FloatArray

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
        path: table with the columns time and value; see `tables.read_columns`.
        acts_on: "base" or "force".
        least_rows: smallest number of rows.

    Raises:
        CaseError: the file is missing; a heading has another unit; a row is not a pair of finite
            numbers; the times do not begin at 0 or do not increase; or there are too few rows.
    """
    name = f"excitation.file {path}"
    table = read_columns(path, name, ("time", "value"))
    require_unit(table, 0, {"s": "s"}, "times in s", name)
    known = _UNITS[acts_on]
    expected = " or ".join(dict.fromkeys(known.values()))
    unit = require_unit(table, 1, known, f'values in {expected} with acts_on = "{acts_on}"', name)
    time, value = table.values
    if time.size < least_rows:
        raise CaseError(f"{name}: expected at least {least_rows} rows, given {time.size}")
    _check_times(time, table.lines, name)
    return Series(time, value, unit or next(iter(known.values())))


def _check_times(time: FloatArray, lines: Sequence[int], name: str) -> None:
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
