"""Figures of the contact: the gaps over x and t, and the energy ledger."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.figure import Figure

from delam_fem.case.definition import Case
from delam_fem.numerics.types import FloatArray
from delam_fem.results import diagnostics
from delam_fem.results.figures.style import (
    BLACK,
    BLUE,
    GREEN,
    ORANGE,
    PURPLE,
    SKY,
    VERMILLION,
    WIDTH,
    finite,
    label_x,
    legend_above,
    seconds_below,
    steps,
    time_axis,
    title,
)
from delam_fem.results.schema import by_interface, event_interfaces
from delam_fem.simulation.recorder import RESTING

LINE_PERIODS = 2
"""Periods that the contact line shows: the fewest that show whether it repeats."""
ONE_PANEL, PANEL = 5.0, 3.2
"""Height of the figure of one interface, and of each panel if there are several [in]."""
SMALL_GAP = 3.0
"""Gaps below this have finer shades [mm]."""
SMALLEST_MARK, LARGEST_MARK = 3.0, 90.0
"""Areas of the marks of the weakest and of the strongest impact [pt2]."""

FLOWS = (
    ("base_work", 1.0, "work of the base", BLUE),
    ("force_work", 1.0, "work of the force", BLUE),
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
    """Draw the gap of each interface over x and t, with contacts and impacts marked.

    Below them each lamina with stops has a panel with its contacts and impacts. Beside each panel
    is the power that contact takes at each point, if there is any.
    """
    unit, label = time_axis(case)
    end = float(history["time"][-1])
    last = diagnostics.last_periods(history, case, LINE_PERIODS)
    start = float(last["time"][0]) - case.time_step
    names = [str(name) for name in history["lamina"].to_numpy()]
    stopped = np.unique(history["stop_lamina"]).tolist() if "stop_lamina" in history else []
    n = len(names) - 1 + len(stopped)
    figure = Figure(figsize=(WIDTH, ONE_PANEL if n == 1 else PANEL * n), layout="constrained")
    of_interfaces, of_stops = diagnostics.heat(history)
    heat = finite(np.concatenate([of_interfaces, of_stops[stopped]]))
    ratios = [8, 1] if heat.any() else [1]
    grid = figure.subplots(n, len(ratios), sharex="col", squeeze=False, width_ratios=ratios)
    panels, x = grid[:, 0], 1e3 * history["x"].to_numpy()
    x_end = float(x[-1])
    for axes, own in zip(grid[:, 1:].ravel(), heat, strict=False):
        axes.fill_betweenx(x, 1e3 * own, color=VERMILLION, linewidth=0.0, step="mid")
        axes.set(ylim=(0.0, 1.02 * x_end))
        axes.tick_params(labelleft=False)
    for lamina, axes in zip(stopped, panels[len(names) - 1 :], strict=True):
        _stop_marks(axes, history, lamina, (start, unit))
        axes.set(ylabel="x [mm]", xlim=(start / unit, end / unit), ylim=(0.0, 1.02 * x_end))
        axes.set_title(f"stops and impactors of {names[lamina]}", loc="left")
        legend_above(axes)
    for j, axes in enumerate(panels[: len(names) - 1]):
        axes.grid(False)
        if history.sizes["frame"] > 1:
            _gap_image(figure, axes, history, j, (start, unit))
        _bonded_bands(axes, case, (names[j], names[j + 1]))
        _impact_marks(axes, history, j, (start, unit))
        axes.set(ylabel="position along the laminae  x [mm]" if n == 1 else "x [mm]")
        axes.set(xlim=(start / unit, end / unit), ylim=(0.0, 1.02 * x_end))
        if n > 1:
            axes.set_title(f"{names[j]} – {names[j + 1]}", loc="left")
        if axes.get_legend_handles_labels()[0]:
            legend_above(axes)
    for column, text in zip(grid.T, (label, "heat [mW]"), strict=False):
        label_x(column, text)
    seconds_below(panels[-1], case)
    figure.suptitle(title(case))
    return figure


def _gap_image(
    figure: Figure, axes: Axes, history: xr.Dataset, interface: int, axis: tuple[float, float]
) -> None:
    """Draw the gap of an interface as shades and its resting pairs as squares."""
    start, unit = axis
    frames = history["frame"].to_numpy()
    shown = np.flatnonzero(frames >= start - 1e-9 * unit)
    t, x = frames[shown] / unit, 1e3 * history["x"].to_numpy()
    gap = 1e3 * finite(diagnostics.gap_field(history)[interface, shown]).T
    levels = _levels(float(np.nanmax(gap, initial=0.0)))
    shades = ListedColormap([str(s) for s in np.linspace(0.52, 0.97, levels.size - 1)])
    image = axes.pcolormesh(
        t, x, np.maximum(gap, 0.0), cmap=shades, norm=BoundaryNorm(levels, shades.N),
        shading="nearest", rasterized=True,
    )  # fmt: skip
    figure.colorbar(image, ax=axes, label="gap [mm]", pad=0.02, format="%g")
    held = np.argwhere(by_interface(history["contact_state"])[interface, shown] == RESTING)
    if held.size:
        axes.plot(
            t[held[:, 0]],
            x[held[:, 1]],
            "s",
            color=BLUE,
            markersize=3.0,
            label="in permanent contact",
        )


def _levels(largest: float) -> FloatArray:
    """Return the limits of the shades for gaps up to `largest` [mm]."""
    levels = np.array([0.0, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0])
    if not 0.0 < largest < SMALL_GAP:
        return levels
    return np.asarray(levels * 10.0 ** np.floor(np.log10(largest / SMALL_GAP)))


def _bonded_bands(axes: Axes, case: Case, between: tuple[str, str]) -> None:
    """Hatch where two laminae are bonded."""
    if case.is_apart:
        return
    own = sorted((1e3 * d.start, 1e3 * d.end) for d in case.delamination if d.between == between)
    starts = [0.0, *(end for _, end in own)]
    ends = [*(start for start, _ in own), 1e3 * case.length]
    label = "bonded"
    for start, end in zip(starts, ends, strict=True):
        if end > start:
            axes.axhspan(
                start, end, facecolor="white", edgecolor="0.8", hatch="///", linewidth=0.0,
                label=label, zorder=2,
            )  # fmt: skip
            label = "_further"


def _impact_marks(
    axes: Axes, history: xr.Dataset, interface: int, axis: tuple[float, float]
) -> None:
    """Mark the impacts on an interface; the area of a mark grows with the impulse.

    All interfaces share the scale of the areas.
    """
    _marks(axes, history, event_interfaces(history) == interface, axis)


def _stop_marks(axes: Axes, history: xr.Dataset, lamina: int, axis: tuple[float, float]) -> None:
    """Mark the stops of a lamina, the impacts on them, and when it rests on them."""
    _, unit = axis
    x, frames = 1e3 * history["x"].to_numpy(), history["frame"].to_numpy()
    own = history["stop_lamina"].to_numpy() == lamina
    nodes = history["stop_node"].to_numpy()[own]
    for k, node in enumerate(np.unique(nodes)):
        axes.axhline(x[node], color="0.7", linewidth=0.8, label="_more" if k else "stop")
    held = np.argwhere(history["stop_state"].to_numpy()[:, own] == RESTING)
    if held.size:
        axes.plot(frames[held[:, 0]] / unit, x[nodes[held[:, 1]]], "s", color=BLUE, markersize=3.0,
                  label="in permanent contact")  # fmt: skip
    _marks(axes, history, np.isin(history["event_stop"], np.flatnonzero(own)), axis)


def _marks(
    axes: Axes, history: xr.Dataset, own: npt.NDArray[np.bool_], axis: tuple[float, float]
) -> None:
    """Mark some of the events; see `_impact_marks`."""
    start, unit = axis
    when = history["event_time"].to_numpy()
    shown = own & (when >= start)
    if not shown.any():
        return
    impulses = np.abs(history["event_impulse"].to_numpy())
    strongest = float(impulses[when >= start].max())
    share = impulses[shown] / max(strongest, np.finfo(np.float64).tiny)
    axes.scatter(
        when[shown] / unit,
        1e3 * history["x"].to_numpy()[history["event_node"].to_numpy()[shown]],
        s=SMALLEST_MARK + (LARGEST_MARK - SMALLEST_MARK) * share,
        facecolor=VERMILLION, edgecolor="none", alpha=0.75, zorder=3,
        label=f"impact (area: impulse, at most {1e3 * float(impulses[shown].max()):.2g} mN s)",
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
    label_x((upper, lower), label)
    seconds_below(lower, case)
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
        steps(axes, base + values, t, base, color=colour, label=text)
        up, down = up + np.maximum(values, 0.0), down + np.minimum(values, 0.0)
