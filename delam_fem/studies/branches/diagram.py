"""The dataset of a branch, and its diagram."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from delam_fem.case.definition import Case
from delam_fem.numerics.types import FloatArray
from delam_fem.results.figures.style import (
    BASE_COLOUR,
    BLACK,
    BLUE,
    GAP_COLOUR,
    GREEN,
    ORANGE,
    PURPLE,
    VERMILLION,
    WIDTH,
    label_x,
)
from delam_fem.results.schema import Variable, provenance
from delam_fem.studies.branches.continuation import Event, Point
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
            f"{path}: expected branches of orbits, as delam-fem orbit follow writes them; "
            "this file is missing, damaged or another one"
        ) from error


COLOURS = {"stable": BLUE, "unstable": VERMILLION, "undecided": ORANGE}
MARKS = {"period doubling": "D", "fold": "s", "Neimark-Sacker": "o", "grazing": "x"}
EVENT_COLOURS = {"period doubling": GREEN, "fold": BLACK, "Neimark-Sacker": PURPLE,
                 "grazing": BLACK}  # fmt: skip
SHOWN_MULTIPLIER = 3.0
"""Largest modulus in the panel of multipliers."""


def branch_diagram(data: xr.Dataset, swept: xr.Dataset | None = None) -> Figure:
    """Return the diagram of branches.

    Args:
        data: branches, as `follow` returns them.
        swept: dataset of a sweep over the same key, drawn behind; None: none.

    Raises:
        CaseError: the sweep is not one over this key with stroboscopic points.
    """
    names = [lamina.name for lamina in Case.from_toml(data.attrs["case"]).lamina]
    count = min(len(names), data.sizes["probe"])
    figure = Figure(figsize=(WIDTH, 3.1 * count + 2.6), layout="constrained")
    *panels, lowest = figure.subplots(count + 1, 1, sharex=True, squeeze=False)[:, 0]
    for i, panel in enumerate(panels):
        if swept is not None:
            _swept(panel, swept, i, str(data.attrs["key"]))
        _strobes(panel, data, i)
        panel.set_title(names[i], loc="left")
        panel.set(ylabel=f"tip displacement  $q_{{{i + 1}}}$ at t = nT [mm]")
    _moduli(lowest, data)
    _legend(panels[0], data, swept)
    key = str(data.attrs["key"])
    unit = str(data["parameter"].attrs.get("units", "1")).replace("1", "–")
    label_x([*panels, lowest], f"{key}  [{unit}]")
    low, high = _range(data)
    lowest.set_xlim(low - 0.02 * (high - low), high + 0.02 * (high - low))
    figure.suptitle(f"{data.attrs['title']}, stability by 95 % intervals")
    return figure


def _range(data: xr.Dataset) -> tuple[float, float]:
    parameter = data["parameter"].to_numpy()
    return float(parameter.min()), float(parameter.max())


def _strobes(panel: Axes, data: xr.Dataset, i: int) -> None:
    """Draw the points of all branches in a panel, and what happens on them."""
    parameter, branch = data["parameter"].to_numpy(), data["branch"].to_numpy()
    q = 1e3 * data["strobe_displacement"].isel(probe=i).to_numpy()
    stability = data["stability"].to_numpy()
    for number in np.unique(branch):
        own = branch == number
        for cycle in q[own].T:
            panel.plot(parameter[own], cycle, color=BASE_COLOUR, linewidth=0.8, zorder=2)
    for name, colour in COLOURS.items():
        own = stability == name
        face = colour if name == "stable" else "white"
        panel.plot(
            np.repeat(parameter[own], q.shape[1]), q[own].ravel(), "o", color=colour,
            markerfacecolor=face, markersize=3.2, markeredgewidth=0.9, zorder=3,
        )  # fmt: skip
    _events(panel, data, q)


def _events(panel: Axes, data: xr.Dataset, q: FloatArray) -> None:
    """Mark what happens, with its interval, at the height of the points beside it."""
    for k in range(data.sizes["event"]):
        kind, point = str(data["event_kind"][k].item()), int(data["event_point"][k])
        at = float(data["event_parameter"][k])
        low, high = float(data["event_low"][k]), float(data["event_high"][k])
        heights = 0.5 * (q[point] + q[point - 1])
        for height in heights[np.isfinite(heights)]:
            panel.errorbar(
                at, height, xerr=[[max(at - low, 0.0)], [max(high - at, 0.0)]], fmt=MARKS[kind],
                color=EVENT_COLOURS[kind], markersize=6.0, markerfacecolor="none", capsize=2.0,
                elinewidth=0.9, zorder=4,
            )  # fmt: skip


def _swept(panel: Axes, swept: xr.Dataset, i: int, key: str) -> None:
    """Draw the stroboscopic points of a sweep over the same key."""
    names = [str(n) for n in swept.coords if swept[n].attrs.get("key") == key]
    if not names or "strobe_displacement" not in swept:
        raise CaseError(f"over: expected a sweep over {key} with stroboscopic points")
    strobes = swept["strobe_displacement"].isel(lamina=i)
    q = 1e3 * strobes.transpose(names[0], ...).to_numpy()
    x = swept[names[0]].to_numpy()
    q = q.reshape(len(x), -1)
    panel.plot(np.repeat(x, q.shape[1]), q.ravel(), ".", color="#bbbbbb", markersize=3.0, zorder=1)


def _moduli(panel: Axes, data: xr.Dataset) -> None:
    """Draw the interval of the largest multiplier of each point."""
    panel.axhspan(0.0, 1.0, color=GAP_COLOUR, zorder=0)
    stability = data["stability"].to_numpy()
    low, high = data["largest_low"].to_numpy(), data["largest_high"].to_numpy()
    for name, colour in COLOURS.items():
        own = stability == name
        middle, half = 0.5 * (low + high)[own], 0.5 * (high - low)[own]
        panel.errorbar(
            data["parameter"].to_numpy()[own], middle, yerr=half, fmt="o", color=colour,
            markersize=3.0, markerfacecolor=colour if name == "stable" else "white",
            elinewidth=0.9, capsize=1.5,
        )  # fmt: skip
    panel.set(ylim=(0.0, SHOWN_MULTIPLIER), ylabel="largest |μ|  [–]")


def _legend(panel: Axes, data: xr.Dataset, swept: xr.Dataset | None) -> None:
    """Put a legend of what is there above the panels."""
    shown: list[tuple[str, dict[str, Any]]] = [
        (name, {"color": colour, "marker": "o", "linestyle": "",
                "markerfacecolor": colour if name == "stable" else "white"})
        for name, colour in COLOURS.items()
        if (data["stability"] == name).any()
    ]  # fmt: skip
    shown += [
        (kind, {"color": EVENT_COLOURS[kind], "marker": mark, "linestyle": "",
                "markerfacecolor": "none"})
        for kind, mark in MARKS.items()
        if (data["event_kind"] == kind).any()
    ]  # fmt: skip
    if swept is not None:
        shown.append(("swept", {"color": "#bbbbbb", "marker": ".", "linestyle": ""}))
    for label, style in shown:
        panel.plot([], [], label=label, **style)
    panel.legend(
        loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=4, frameon=False, borderaxespad=0.1
    )
