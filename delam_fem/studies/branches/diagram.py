"""Draw branches over the parameter: stroboscopic points, stable and unstable, and multipliers."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from delam_fem.case.definition import Case
from delam_fem.numerics.arrays import FloatArray
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
from delam_fem.system.errors import CaseError

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
