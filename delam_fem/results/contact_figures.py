"""Figures of the contact: the contact line over x and t, and the energy ledger."""

from __future__ import annotations

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.figure import Figure

from delam_fem.case.definition import Case
from delam_fem.numerics.arrays import FloatArray
from delam_fem.results import diagnostics
from delam_fem.results.style import (
    BLACK,
    BLUE,
    GREEN,
    ORANGE,
    PURPLE,
    SKY,
    VERMILLION,
    WIDTH,
    finite,
    legend_above,
    time_axis,
    title,
)

LINE_PERIODS = 2
"""Periods that the contact line shows: the least that shows whether it repeats."""
SMALLEST_MARK, LARGEST_MARK = 3.0, 90.0
"""Areas of the marks of the weakest and of the strongest impact [pt2]."""

FLOWS = (
    ("base_work", 1.0, "work of the base", BLUE),
    ("damping_loss", -1.0, "damping", SKY),
    ("contact_damping_loss", -1.0, "contact dampers", PURPLE),
    ("impact_loss", -1.0, "impacts", VERMILLION),
    ("spring_released", 1.0, "switching springs", ORANGE),
)
"""Variable, sign with which it changes the stored energy, label, colour."""
STORES = (
    ("kinetic", "kinetic", BLUE),
    ("strain", "strain", GREEN),
    ("spring", "contact springs", ORANGE),
)


def contact_line(history: xr.Dataset, case: Case) -> Figure:
    """Draw where the laminae touch over x and t, above the gap, with every impact marked."""
    unit, label = time_axis(case)
    end = float(history["time"][-1])
    start = max(end - LINE_PERIODS * case.period, float(history["time"][0]) - case.time_step)
    figure = Figure(figsize=(WIDTH, 5.0), layout="constrained")
    axes = figure.subplots()
    axes.grid(False)
    x = 1e3 * history["x"].to_numpy()
    if history.sizes["frame"] > 1:
        _gap_image(figure, axes, history, (start, unit))
    _impact_marks(axes, history, (start, unit))
    axes.set(xlabel=label, ylabel="position along the laminae  x [mm]")
    axes.set(xlim=(start / unit, end / unit), ylim=(0.0, 1.02 * x[-1]))
    if axes.get_legend_handles_labels()[0]:
        legend_above(axes)
    figure.suptitle(title(case))
    return figure


def _gap_image(figure: Figure, axes: Axes, history: xr.Dataset, axis: tuple[float, float]) -> None:
    """Draw the gap as shades and closed or held pairs as black dots."""
    start, unit = axis
    frames = history["frame"].to_numpy()
    shown = np.flatnonzero(frames >= start - 1e-9 * unit)
    t, x = frames[shown] / unit, 1e3 * history["x"].to_numpy()
    gap = 1e3 * finite(diagnostics.gap_field(history)[shown]).T
    levels = np.array([0.0, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0])
    shades = ListedColormap([str(s) for s in np.linspace(0.52, 0.97, levels.size - 1)])
    image = axes.pcolormesh(
        t, x, np.maximum(gap, 0.0), cmap=shades, norm=BoundaryNorm(levels, shades.N),
        shading="nearest", rasterized=True,
    )  # fmt: skip
    figure.colorbar(image, ax=axes, label="gap [mm]", pad=0.02, format="%g")
    held = np.argwhere(history["contact_state"].to_numpy()[shown] == 2)
    if held.size:
        axes.plot(
            t[held[:, 0]],
            x[held[:, 1]],
            "s",
            color=BLUE,
            markersize=3.0,
            label="in permanent contact",
        )


def _impact_marks(axes: Axes, history: xr.Dataset, axis: tuple[float, float]) -> None:
    """Mark the impacts; the area of a mark grows with the impulse."""
    start, unit = axis
    when = history["event_time"].to_numpy()
    shown = when >= start
    if not shown.any():
        return
    impulse = np.abs(history["event_impulse"].to_numpy()[shown])
    share = impulse / max(float(impulse.max()), np.finfo(np.float64).tiny)
    axes.scatter(
        when[shown] / unit,
        1e3 * history["x"].to_numpy()[history["event_node"].to_numpy()[shown]],
        s=SMALLEST_MARK + (LARGEST_MARK - SMALLEST_MARK) * share,
        facecolor=VERMILLION, edgecolor="none", alpha=0.75, zorder=3,
        label=f"impact (area: impulse, at most {1e3 * float(impulse.max()):.2g} mN s)",
    )  # fmt: skip


def energy_ledger(history: xr.Dataset, case: Case) -> Figure:
    """Draw what changed the energy within each period, and what is stored at its end."""
    unit, label = time_axis(case)
    t = np.arange(history.sizes["period"] + 1) * case.period / unit
    figure = Figure(figsize=(WIDTH, 6.2), layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=[3, 2])
    flows = [
        (sign * 1e3 * _column(history, name), text, colour)
        for name, sign, text, colour in FLOWS
        if f"energy_{name}" in history
    ]
    _stack(upper, t, flows)
    stored = [
        (1e3 * _column(history, name), text, colour)
        for name, text, colour in STORES
        if f"energy_{name}" in history
    ]
    _stack(lower, t, stored)
    upper.axhline(0.0, color=BLACK, linewidth=0.8)
    upper.set_ylabel("energy in (+) and out (−)\nper period [mJ]")
    lower.set_ylabel("stored at the end\nof the period [mJ]")
    for axes in (upper, lower):
        axes.margins(x=0.0)
        if axes.get_legend_handles_labels()[0]:
            legend_above(axes)
    lower.set_xlabel(label)
    figure.suptitle(f"{title(case)}: energy")
    return figure


def _column(history: xr.Dataset, name: str) -> FloatArray:
    """Return a column of the ledger, 0 where it is not finite [J]."""
    return np.nan_to_num(finite(history[f"energy_{name}"]))


def _stack(axes: Axes, t: FloatArray, parts: list[tuple[FloatArray, str, str]]) -> None:
    """Stack steps of width one period, positive values upwards and negative ones downwards."""
    up, down = np.zeros(t.size - 1), np.zeros(t.size - 1)
    for values, text, colour in parts:
        if not values.any():
            continue
        base = np.where(values >= 0.0, up, down)
        axes.stairs(base + values, t, baseline=base, fill=True, color=colour, label=text)
        up, down = up + np.maximum(values, 0.0), down + np.minimum(values, 0.0)
