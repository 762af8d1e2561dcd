"""Read a course of values in time from a table: two columns, time [s] and value."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from delam_fem.case.tables import in_si_units, read_columns
from delam_fem.case.toml import CaseError
from delam_fem.numerics.arrays import FloatArray

_UNITS = {"base": ("m", "m/s2"), "force": ("N",)}
"""SI units of the values by what they act on."""


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

    Comments (#) are skipped. A heading gives units in brackets: `time [ms], force [kN]`. Without
    units, times are in s, values in m (base) or N (force), and a warning says so.

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
    (time, value), units = in_si_units(table, ("time", "value"), (("s",), _UNITS[acts_on]), name)
    if time.size < least_rows:
        raise CaseError(f"{name}: expected at least {least_rows} rows, given {time.size}")
    _check_times(time, table.lines, name)
    return Series(time, value, units[1])


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
