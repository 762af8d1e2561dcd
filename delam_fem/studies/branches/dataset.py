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
from delam_fem.case.toml import CaseError
from delam_fem.results.provenance import provenance
from delam_fem.studies.branches.events import Event
from delam_fem.studies.branches.point import Point
from delam_fem.studies.orbits.coarse import SMOOTH, WITHIN

_log = logging.getLogger(__name__)


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
    _add_points(data, branches, str(attributes["key"]))
    _add_events(data, branches)
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
    solved = [p.residual <= max(SMOOTH, WITHIN * p.residual_error) for p in points]
    largest = np.array([m.largest for m in found])
    one, slow = ("point",), ("point", "slow")
    at = "at the beginning of each period of the drive"
    rows: list[tuple[str, tuple[str, ...], Any, str, str]] = [
        ("branch", one, [n for n, *_ in every], "1", "number of the branch"),
        ("periods", one, [b.periods for _, b, _ in every], "1", "periods of the drive in it"),
        ("parameter", one, [p.parameter for p in points], "", key),
        ("parameter_error", one, [p.parameter_error for p in points], "", "its standard error"),
        ("residual", one, [p.residual for p in points], "1", "residual of the mean map"),
        ("residual_error", one, [p.residual_error for p in points], "1", "its standard error"),
        ("is_solved", one, np.array(solved, dtype=np.int8), "1", "residual is 0 within its error"),
        ("stability", one, [m.stability for m in found], "", "by the 95 % interval of |μ|"),
        ("largest_low", one, largest[:, 0], "1", "lower end of the 95 % interval of max |μ|"),
        ("largest_high", one, largest[:, 1], "1", "upper end of the 95 % interval of max |μ|"),
        ("multiplier_real", slow, values.real, "1", "real part of the multipliers"),
        ("multiplier_imaginary", slow, values.imag, "1", "imaginary part of the multipliers"),
        ("multiplier_error", slow, np.array([m.errors for m in found]), "1", "standard error"),
        ("strobe_displacement", ("point", "cycle", "probe"), padded([p.strobes for p in points]),
         "m", f"displacement of the probes {at}"),
        ("smallest_gap", ("point", "cycle"), padded([p.gaps for p in points]), "m",
         "smallest gap between the tips in each period of the drive"),
        ("low", ("point", "probe"), np.array([p.low for p in points]), "m",
         "smallest displacement of the probes"),
        ("high", ("point", "probe"), np.array([p.high for p in points]), "m",
         "largest displacement of the probes"),
        ("iterations", one, [p.iterations for p in points], "1", "evaluations of the mean map"),
        ("state", ("point", "coordinate"), np.array([p.state for p in points]), "",
         "state at the beginning of the orbit"),
    ]  # fmt: skip
    for name, dims, content, units, meaning in rows:
        labels = {"long_name": meaning} | ({"units": units} if units else {})
        data[name] = (dims, np.asarray(content), labels)


def _add_events(data: xr.Dataset, branches: Sequence[Branch]) -> None:
    """Add a row of each variable for each event."""
    every = [(n, event) for n, branch in enumerate(branches) for event in branch.events]
    offsets = np.cumsum([0, *(len(branch.points) for branch in branches)])
    rows: list[tuple[str, Any, str]] = [
        ("event_kind", np.array([e.kind for _, e in every], dtype=object), "what happens"),
        ("event_parameter", np.array([e.parameter for _, e in every]), "where"),
        ("event_low", np.array([e.low for _, e in every]), "lower end of its 95 % interval"),
        ("event_high", np.array([e.high for _, e in every]), "upper end of its 95 % interval"),
        ("event_branch", np.array([n for n, _ in every], np.int64), "number of the branch"),
        (
            "event_point",
            np.array([offsets[n] + e.index for n, e in every], np.int64),
            "number of the point behind it",
        ),
    ]
    for name, content, meaning in rows:
        data[name] = (("event",), content, {"long_name": meaning})


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
