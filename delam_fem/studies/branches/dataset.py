"""Put branches into one dataset, and read it back."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from delam_fem.case.definition import Case
from delam_fem.results.provenance import provenance
from delam_fem.results.schema import Variable
from delam_fem.studies.branches.continuation import Point
from delam_fem.studies.branches.events import Event
from delam_fem.studies.orbits.newton import is_zero
from delam_fem.studies.sweeps.grid import unit_of
from delam_fem.system.errors import CaseError

_log = logging.getLogger(__name__)


_POINT, _SLOW, _CYCLE, _PROBE = (
    ("point",),
    ("point", "slow"),
    ("point", "cycle"),
    ("point", "probe"),
)
_BEGIN = "at the beginning of each period of the drive"
VARIABLES: Mapping[str, Variable] = {
    row.name: row
    for row in (
        Variable("branch", _POINT, "1", "number of the branch"),
        Variable("periods", _POINT, "1", "periods of the drive in it"),
        Variable("parameter", _POINT, "", "the key that is followed"),
        Variable("parameter_error", _POINT, "", "its standard error"),
        Variable("residual", _POINT, "1", "residual of the mean map"),
        Variable("residual_error", _POINT, "1", "its standard error"),
        Variable("is_solved", _POINT, "1", "residual is 0 within its error"),
        Variable("stability", _POINT, "", "by the 95 % interval of |μ|, and by what runs on"),
        Variable("largest_low", _POINT, "1", "lower end of the 95 % interval of max |μ|"),
        Variable("largest_high", _POINT, "1", "upper end of the 95 % interval of max |μ|"),
        Variable("multiplier_real", _SLOW, "1", "real part of the multipliers"),
        Variable("multiplier_imaginary", _SLOW, "1", "imaginary part of the multipliers"),
        Variable("multiplier_error", _SLOW, "1", "standard error"),
        Variable(
            "strobe_displacement", (*_CYCLE, "probe"), "m", f"displacement of the probes {_BEGIN}"
        ),
        Variable(
            "smallest_gap", _CYCLE, "m",
            "smallest gap between the tips in each period of the drive",
        ),
        Variable("low", _PROBE, "m", "smallest displacement of the probes"),
        Variable("high", _PROBE, "m", "largest displacement of the probes"),
        Variable("iterations", _POINT, "1", "evaluations of the mean map"),
        Variable("state", ("point", "coordinate"), "", "state at the beginning of the orbit"),
        Variable("event_kind", ("event",), "", "what happens"),
        Variable("event_parameter", ("event",), "", "where"),
        Variable("event_low", ("event",), "", "lower end of its 95 % interval"),
        Variable("event_high", ("event",), "", "upper end of its 95 % interval"),
        Variable("event_branch", ("event",), "", "number of the branch"),
        Variable("event_point", ("event",), "", "number of the point behind it"),
    )
}  # fmt: skip
"""All variables of branches by name."""


@dataclass(frozen=True)
class Branch:
    """A branch of orbits.

    Attributes:
        periods: P, number of periods of the drive in one of the orbit.
        points: its points in order.
        events: what happens on it.
        ending: why it ends: "range", "points", "lost" or "interrupted".
    """

    periods: int
    points: tuple[Point, ...]
    events: tuple[Event, ...]
    ending: str


def of(
    branches: Sequence[Branch], case: Case, span: float, attributes: Mapping[str, Any]
) -> xr.Dataset:
    """Return the dataset of branches.

    Args:
        branches: at least one, each with points.
        case: the case at the start.
        span: range of λ.
        attributes: of the dataset beside case, versions and outcome.
    """
    data = xr.Dataset()
    key = str(attributes["key"])
    _add_points(data, branches, key)
    _add_events(data, branches)
    for name in ("parameter", "parameter_error", "event_parameter", "event_low", "event_high"):
        data[name].attrs["units"] = unit_of(key, case)
    endings = [branch.ending for branch in branches]
    data.attrs |= {
        "title": f"orbits of {case.name}",
        "case": case.to_toml(),
        "span": span,
        "outcome": "interrupted" if "interrupted" in endings else "completed",
        "endings": ", ".join(endings),
        **provenance(),
        **attributes,
    }
    return data


def _add_points(data: xr.Dataset, branches: Sequence[Branch], key: str) -> None:
    """Add a row of each variable for each point."""
    every = [(n, branch, point) for n, branch in enumerate(branches) for point in branch.points]
    found = [point.multipliers for *_, point in every]
    cycles = max(branch.periods for branch in branches)

    def padded(rows: list[Any]) -> Any:
        """Return rows of different numbers of periods with NaN behind the shorter ones."""
        arrays = [np.asarray(row, dtype=np.float64) for row in rows]
        result = np.full((len(arrays), cycles, *arrays[0].shape[1:]), np.nan)
        for row, array in zip(result, arrays, strict=True):
            row[: len(array)] = array
        return result

    points = [point for *_, point in every]
    values = np.array([m.values for m in found])
    solved = [is_zero(p.residual, p.residual_error) for p in points]
    largest = np.array([m.largest for m in found])
    data_of_points: dict[str, Any] = {
        "branch": [n for n, *_ in every],
        "periods": [branch.periods for _, branch, _ in every],
        "parameter": [p.parameter for p in points],
        "parameter_error": [p.parameter_error for p in points],
        "residual": [p.residual for p in points],
        "residual_error": [p.residual_error for p in points],
        "is_solved": np.array(solved, dtype=np.int8),
        "stability": [p.stability for p in points],
        "largest_low": largest[:, 0],
        "largest_high": largest[:, 1],
        "multiplier_real": values.real,
        "multiplier_imaginary": values.imag,
        "multiplier_error": np.array([m.errors for m in found]),
        "strobe_displacement": padded([p.strobes for p in points]),
        "smallest_gap": padded([p.gaps for p in points]),
        "low": np.array([p.low for p in points]),
        "high": np.array([p.high for p in points]),
        "iterations": [p.iterations for p in points],
        "state": np.array([p.state for p in points]),
    }
    for name, content in data_of_points.items():
        _add(data, name, content)
    data["parameter"].attrs["long_name"] = key


def _add_events(data: xr.Dataset, branches: Sequence[Branch]) -> None:
    """Add a row of each variable for each event."""
    every = [(n, event) for n, branch in enumerate(branches) for event in branch.events]
    offsets = np.cumsum([0, *(len(branch.points) for branch in branches)])
    data_of_events: dict[str, Any] = {
        "event_kind": np.array([e.kind for _, e in every], dtype=object),
        "event_parameter": np.array([e.parameter for _, e in every]),
        "event_low": np.array([e.low for _, e in every]),
        "event_high": np.array([e.high for _, e in every]),
        "event_branch": np.array([n for n, _ in every], np.int64),
        "event_point": np.array([offsets[n] + e.index for n, e in every], np.int64),
    }
    for name, content in data_of_events.items():
        _add(data, name, content)


def _add(data: xr.Dataset, name: str, content: Any) -> None:
    """Add a variable of `VARIABLES`; one without a unit has no attribute `units`."""
    row = VARIABLES[name]
    labels = {"long_name": row.long_name} | ({"units": row.units} if row.units else {})
    data[name] = (row.dims, np.asarray(content), labels)


def read(path: Path) -> xr.Dataset:
    """Return the dataset of branches that `follow` wrote.

    Raises:
        CaseError: the file is missing, damaged or another one.
    """
    try:
        with xr.open_dataset(path, engine="h5netcdf") as data:
            data["strobe_displacement"], data["event_kind"], data.attrs["key"]
            return data.load()
    except Exception as error:  # HDF5, h5netcdf and xarray raise whatever they please
        _log.debug("%s cannot be read", path, exc_info=True)
        raise CaseError(
            f"{path}: expected branches of orbits, as delam-fem continue writes them; this file is "
            "missing, damaged or another one"
        ) from error
