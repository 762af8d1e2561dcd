"""Figures of a run: motion, phase, spectra, contact."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from functools import partial
from itertools import pairwise
from pathlib import Path

import numpy as np
import numpy.typing as npt
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.figure import Figure

from delam_fem.case.definition import Case
from delam_fem.numerics.types import FloatArray
from delam_fem.results import diagnostics
from delam_fem.results.channels import of_references
from delam_fem.results.figures import channels
from delam_fem.results.figures.responses import has_many_lines, responses
from delam_fem.results.figures.style import (
    BASE_COLOUR,
    BLACK,
    BLUE,
    GAP_COLOUR,
    GREEN,
    HISTORY_PERIODS,
    ORANGE,
    PURPLE,
    SKY,
    VERMILLION,
    canvas,
    finite,
    label_x,
    lamina_colours,
    legend_above,
    over_time,
    save_figure,
    seconds_below,
    stacked,
    steps,
    styled,
    symbol,
    time_axis,
)
from delam_fem.results.schema import by_interface, event_interfaces, sensors_of
from delam_fem.simulation.recorder import RESTING
from delam_fem.system.files import discard

LINE_PERIODS = 2
"""Periods that the contact line shows: the fewest that show whether it repeats."""
ONE_PANEL, PANEL = 5.0, 3.2
"""Height of the figure of one interface, and of each panel if there are several [in]."""
GAP_LEVELS = np.array([0.0, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0])
"""Limits of the shades of gaps [mm]; some powers of ten smaller where gaps are small."""
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
"""Energies exchanged: variable, sign in the balance of the stored energy, label, colour."""
STORES = (
    ("kinetic", 1.0, "kinetic", BLUE),
    ("strain", 1.0, "strain", GREEN),
    ("spring", 1.0, "contact springs", ORANGE),
)
"""Energies stored, likewise."""


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
    figure = canvas(ONE_PANEL if n == 1 else PANEL * n)
    of_interfaces, of_stops = diagnostics.heat(history)
    heat = finite(np.concatenate([of_interfaces, of_stops[stopped]]))
    ratios = [8, 1] if heat.any() else [1]
    grid = figure.subplots(n, len(ratios), sharex="col", squeeze=False, width_ratios=ratios)
    panels = grid[:, 0]
    x = 1e3 * history["x"].to_numpy()
    x_end = float(x[-1])
    for axes, lamina_heat in zip(grid[:, 1:].ravel(), heat, strict=False):
        axes.fill_betweenx(x, 1e3 * lamina_heat, color=VERMILLION, linewidth=0.0, step="mid")
        axes.tick_params(labelleft=False)
    for lamina, axes in zip(stopped, panels[len(names) - 1 :], strict=True):
        _stop_marks(axes, history, lamina, (start, unit), len(case.stop))
        axes.set_ylabel(f"x on {names[lamina]} [mm]")  # a title would lie below the legend
    for j, axes in enumerate(panels[: len(names) - 1]):
        axes.grid(False)
        if history.sizes["frame"] > 1:
            _gap_image(figure, axes, history, j, (start, unit))
        _bonded_bands(axes, case, (names[j], names[j + 1]))
        _marks(axes, history, event_interfaces(history) == j, (start, unit))
        axes.set_ylabel("position along the laminae  x [mm]" if n == 1 else "x [mm]")
        if n > 1:
            axes.set_title(f"{names[j]} – {names[j + 1]}", loc="left")
    for axes in panels:
        axes.set_xlim(start / unit, end / unit)
        if axes.get_legend_handles_labels()[0]:
            legend_above(axes)
    for axes in grid.ravel():
        axes.set_ylim(0.0, 1.02 * x_end)
    for column, text in zip(grid.T, (label, "heat [mW]"), strict=False):
        label_x(column, text)
    seconds_below(panels[-1], case)
    figure.suptitle(case.title)
    return figure


def _gap_image(
    figure: Figure, axes: Axes, history: xr.Dataset, interface: int, axis: tuple[float, float]
) -> None:
    """Draw the gap of an interface as shades and its resting pairs as squares."""
    start, unit = axis
    frames = history["frame"].to_numpy()
    columns = np.flatnonzero(frames >= start - 1e-9 * unit)
    t = frames[columns] / unit
    x = 1e3 * history["x"].to_numpy()
    gap = 1e3 * finite(diagnostics.gap_field(history)[interface, columns]).T
    levels = GAP_LEVELS
    largest = float(np.nanmax(gap, initial=0.0))
    if 0.0 < largest < SMALL_GAP:
        levels = levels * 10.0 ** np.floor(np.log10(largest / SMALL_GAP))
    shades = ListedColormap([str(s) for s in np.linspace(0.52, 0.97, levels.size - 1)])
    image = axes.pcolormesh(
        t, x, np.maximum(gap, 0.0), cmap=shades, norm=BoundaryNorm(levels, shades.N),
        shading="nearest", rasterized=True,
    )  # fmt: skip
    figure.colorbar(image, ax=axes, label="gap [mm]", pad=0.02, format="%g")
    resting = np.argwhere(by_interface(history["contact_state"])[interface, columns] == RESTING)
    if resting.size:
        axes.plot(
            t[resting[:, 0]],
            x[resting[:, 1]],
            "s",
            color=BLUE,
            markersize=3.0,
            label="in permanent contact",
        )


def _bonded_bands(axes: Axes, case: Case, between: tuple[str, str]) -> None:
    """Hatch where two laminae are bonded."""
    if case.is_apart:
        return
    spans = sorted((1e3 * d.start, 1e3 * d.end) for d in case.delamination if d.between == between)
    starts = [0.0, *(end for _, end in spans)]
    ends = [*(start for start, _ in spans), 1e3 * case.length]
    label = "bonded"
    for start, end in zip(starts, ends, strict=True):
        if end > start:
            axes.axhspan(
                start, end, facecolor="white", edgecolor="0.8", hatch="///", linewidth=0.0,
                label=label, zorder=2,
            )  # fmt: skip
            label = "_further"


def _stop_marks(
    axes: Axes, history: xr.Dataset, lamina: int, axis: tuple[float, float], n_stops: int
) -> None:
    """Mark stops and impactors of a lamina, the impacts on them, and when it rests on them."""
    _, unit = axis
    x = 1e3 * history["x"].to_numpy()
    frames = history["frame"].to_numpy()
    is_here = history["stop_lamina"].to_numpy() == lamina
    nodes = history["stop_node"].to_numpy()[is_here]
    strikes = history["stop_number"][is_here] > n_stops
    for label, style, those in (("stop", "-", ~strikes), ("impactor", ":", strikes)):
        for k, node in enumerate(np.unique(nodes[those])):
            name = f"_more {label}" if k else label
            axes.axhline(x[node], color="0.7", linewidth=0.8, linestyle=style, label=name)
    dots = np.argwhere(history["stop_state"].to_numpy()[:, is_here] == RESTING)
    if dots.size:
        axes.plot(frames[dots[:, 0]] / unit, x[nodes[dots[:, 1]]], "s", color=BLUE, markersize=3.0,
                  label="in permanent contact")  # fmt: skip
    _marks(axes, history, np.isin(history["event_stop"], np.flatnonzero(is_here)), axis)


def _marks(
    axes: Axes, history: xr.Dataset, own: npt.NDArray[np.bool_], axis: tuple[float, float]
) -> None:
    """Mark some of the impacts; the area of a mark grows with the impulse, alike in all panels."""
    start, unit = axis
    when = history["event_time"].to_numpy()
    is_shown = own & (when >= start)
    if not is_shown.any():
        return
    impulses = np.abs(history["event_impulse"].to_numpy())
    strongest = float(impulses[when >= start].max())
    share = impulses[is_shown] / max(strongest, np.finfo(np.float64).tiny)
    axes.scatter(
        when[is_shown] / unit,
        1e3 * history["x"].to_numpy()[history["event_node"].to_numpy()[is_shown]],
        s=SMALLEST_MARK + (LARGEST_MARK - SMALLEST_MARK) * share,
        facecolor=VERMILLION, edgecolor="none", alpha=0.75, zorder=3,
        label=f"impact (area: impulse, at most {1e3 * float(impulses[is_shown].max()):.2g} mN s)",
    )  # fmt: skip


def energy_ledger(history: xr.Dataset, case: Case) -> Figure:
    """Draw what changed the energy within each period, and what is stored at its end."""
    t = np.arange(history.sizes["period"] + 1) * case.period / time_axis(case)[0]
    figure, (upper, lower) = stacked(2, 6.2, sharex=True, height_ratios=[3, 2])
    for axes, energies in ((upper, FLOWS), (lower, STORES)):
        parts = [
            (sign * 1e3 * np.nan_to_num(finite(history[f"energy_{name}"])), text, colour)
            for name, sign, text, colour in energies
            if f"energy_{name}" in history
        ]
        _stack(axes, t, parts)
    upper.axhline(0.0, color=BLACK, linewidth=0.8)
    upper.set_ylabel("energy in (+) and out (−)\nper period [mJ]")
    lower.set_ylabel("stored at the end\nof the period [mJ]")
    for axes in (upper, lower):
        axes.margins(x=0.0)
        if axes.get_legend_handles_labels()[0]:
            legend_above(axes)
    return over_time(figure, (upper, lower), case, ": energy")


def _stack(axes: Axes, t: FloatArray, parts: list[tuple[FloatArray, str, str]]) -> None:
    """Stack steps of width one period, positive values upwards and negative ones downwards."""
    up = np.zeros(t.size - 1)
    down = np.zeros(t.size - 1)
    for values, text, colour in parts:
        if not values.any():
            continue
        base = np.where(values >= 0.0, up, down)
        steps(axes, base + values, t, base, color=colour, label=text)
        up = up + np.maximum(values, 0.0)
        down = down + np.minimum(values, 0.0)


def _drive(axes: Axes, t: FloatArray, last: xr.Dataset) -> None:
    """Draw the motion of the base, or the force on an axis of its own."""
    if "force" not in last:
        base = 1e3 * finite(last["base_displacement"])
        axes.plot(t, base, color=BASE_COLOUR, linewidth=0.9, linestyle="--", label="base")
        return
    beside = axes.twinx()
    beside.plot(t, finite(last["force"]), color=BASE_COLOUR, linewidth=0.9, linestyle="--")
    beside.set_ylabel("force [N]", color=BASE_COLOUR)
    beside.tick_params(colors=BASE_COLOUR)
    beside.grid(visible=False)
    axes.plot([], [], color=BASE_COLOUR, linewidth=0.9, linestyle="--", label="force")


def tip_histories(history: xr.Dataset, case: Case) -> Figure:
    """Draw the positions y_i of all laminae at their probes over the last periods.

    y_i is the displacement q_i plus the gaps at rest below lamina i.
    """
    last = diagnostics.last_periods(history, case, HISTORY_PERIODS)
    t = last["time"].to_numpy() / time_axis(case)[0]
    y = 1e3 * finite(diagnostics.probe_positions(last))
    figure, (axes,) = stacked(1, 4.2)
    _drive(axes, t, last)
    for j, (low, high) in enumerate(pairwise(y)):
        axes.fill_between(
            t, low, high, where=high >= low, color=GAP_COLOUR, label=None if j else "gap"
        )
    for i, (name, colour) in enumerate(_laminae(history)):
        axes.plot(t, y[i], color=colour, label=f"{name}  {symbol('y', i)}")
    if case.contact.law != "none":
        # the steps at which neighbours touch at their probes, midway between both
        text = "tips in contact" if diagnostics.probe_place(last) == "the tip" else "in contact"
        for j, closed in enumerate(diagnostics.ProbeMotion.of(last).is_closed):
            middle = y[j : j + 2].mean(axis=0)[closed]
            label = None if j else text
            axes.plot(t[closed], middle, "o", color=BLACK, markersize=4.5, label=label)
    place = diagnostics.probe_place(history)
    text = "position of the tip [mm]" if place == "the tip" else f"position at {place} [mm]"
    axes.set_ylabel(text)
    axes.margins(x=0.0)
    legend_above(axes)
    return over_time(figure, [axes], case)


def envelope(history: xr.Dataset, case: Case) -> Figure:
    """Draw the range of the displacement of each lamina in every period of the run."""
    edges = np.arange(history.sizes["period"] + 1) * case.period / time_axis(case)[0]
    n = history.sizes["lamina"]
    figure, panels = stacked(n, 2.4 * n, sharex=True)
    for i, (name, colour) in enumerate(_laminae(history)):
        low, high, strobe = (
            1e3 * finite(history[variable][i])
            for variable in ("envelope_min", "envelope_max", "strobe_displacement")
        )
        axes = panels[i]
        axes.use_sticky_edges = False
        steps(axes, high, edges, low, color=colour, alpha=0.3, label="range")
        axes.plot(
            edges[1:], strobe, ".", color=BLACK, markersize=3, label="at the end of the period"
        )
        axes.set_title(name, loc="left", color=colour)
        axes.set_ylabel(f"{symbol('q', i)} [mm]")
    legend_above(axes)
    axes.margins(x=0.01)
    words = f": displacements of {diagnostics.probe_place(history)} in each period"
    return over_time(figure, panels, case, words)


def _laminae(history: xr.Dataset) -> Iterator[tuple[str, str]]:
    """Yield name and colour of each lamina."""
    names = [str(name) for name in history["lamina"].to_numpy()]
    yield from zip(names, lamina_colours(len(names)), strict=True)


def _of_references(draw: Callable[..., Figure]) -> Callable[[xr.Dataset, Case], Figure]:
    """Return a function that draws the displacements of the reference probes as channels."""

    def drawn(history: xr.Dataset, case: Case) -> Figure:
        return draw(history, case, *of_references(history["lamina"].to_numpy().tolist()))

    return drawn


FIGURES: dict[str, Callable[..., Figure]] = {
    "tip_histories": tip_histories,
    "phase_portraits": _of_references(channels.portraits),
    "spectra": _of_references(channels.spectra),
    "contact_line": contact_line,
    "energy_ledger": energy_ledger,
    "envelope": envelope,
}
"""The figures of every run by the names of their files."""
OF_PROBES = {"probe_histories": _of_references(channels.histories)} | {
    name: FIGURES[name] for name in ("phase_portraits", "spectra", "energy_ledger", "envelope")
}
"""The figures of runs of operators, of whose structure nothing is known but probes."""
OF_CHANNELS: dict[str, Callable[..., Figure]] = {
    "channels": channels.histories,
    "channel_spectra": channels.spectra,
    "channel_portraits": channels.portraits,
}
"""The figures of channels by name; the first one is drawn of every run with sensors."""


OF_MANY_LINES: dict[str, Callable[..., Figure]] = {"responses": responses}
"""The figures of runs whose drive has many lines."""
LEAST_LENGTH = 256
"""Steps of a window from which responses to a drive that does not repeat are drawn."""


class Plots:
    """The figures of one run as methods: `plots.tip_histories()`, `plots.channels("a1", "base")`.

    The methods return matplotlib's figures, which a notebook shows. `dir(plots)` lists them.
    """

    def __init__(self, history: xr.Dataset, case: Case) -> None:
        """Keep the dataset of the run and its case."""
        self._history = history
        self._case = case

    def __dir__(self) -> list[str]:
        """List the names of the figures."""
        return list(figures_of(self._history, self._case))

    def __getattr__(self, name: str) -> Callable[[], Figure]:
        """Return the function that draws the figure of this name."""
        figures = {} if name.startswith("_") else figures_of(self._history, self._case)
        figures = OF_CHANNELS | figures if name in OF_CHANNELS else figures
        if name not in figures:
            raise AttributeError(f"no figure {name!r}; there are {', '.join(figures)}")
        return styled()(partial(figures[name], self._history, self._case))


def figures_of(history: xr.Dataset, case: Case) -> dict[str, Callable[..., Figure]]:
    """Return the figures of a run by the names of their files."""
    if "tip_node" not in history:
        return OF_PROBES if history.sizes["lamina"] else {"energy_ledger": energy_ledger}
    figures = FIGURES | ({"channels": channels.histories} if sensors_of(history) else {})
    if history.sizes["lamina"] == 1 and "stop" not in history.sizes:
        del figures["contact_line"]
    is_long = history.sizes["time"] >= (case.steps_per_period if case.is_periodic else LEAST_LENGTH)
    return figures | OF_MANY_LINES if has_many_lines(case) and is_long else figures


def remove_figures(directory: Path, keep: Collection[str] = ()) -> None:
    """Remove the figures of an earlier run, but not those that are drawn anew."""
    drawn = {*FIGURES, *OF_PROBES, *OF_CHANNELS, *OF_MANY_LINES, "laminae", "solid"}
    for name in drawn - set(keep):
        discard(directory / f"{name}.png")


def save_figures(
    history: xr.Dataset, case: Case, directory: str | Path, names_of_channels: Sequence[str] = ()
) -> list[Path]:
    """Draw all figures and write them as PNG.

    A spectrum needs a whole period in the window; without one it is left out.

    Args:
        history: dataset of a run, however short; see `schema.VARIABLES`.
        case: its case.
        directory: folder, which is made where it does not exist.
        names_of_channels: channels of which histories, spectra and portraits are drawn; none: the
            histories of the sensors.

    Returns:
        The files, in the order of `figures_of`.

    Raises:
        OSError: the folder cannot be written or the disk is full.
    """
    directory = Path(directory)
    has_period = history.sizes["time"] >= case.steps_per_period
    figures = figures_of(history, case)
    if names_of_channels:
        figures |= OF_CHANNELS
    names = [name for name in figures if has_period or name != "spectra"]
    remove_figures(directory, keep=names)
    paths = [directory / f"{name}.png" for name in names]
    for name, path in zip(names, paths, strict=True):
        of_channels = names_of_channels if name in OF_CHANNELS else ()
        save_figure(partial(figures[name], history, case, *of_channels), path)
    return paths
