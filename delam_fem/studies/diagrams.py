"""Draw diagrams of a sweep over one axis or two, and show the sweep as one page.

The page has the outcomes, the diagrams, a map of the points and a table of them. The row of a point
shows the command that runs the point alone. Where that run was there when the page was written, the
row and the cell of the map lead to its report.
"""

from __future__ import annotations

import shlex
import tomllib
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap, TwoSlopeNorm
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from delam_fem.api import (
    BLOW_STEPS,
    Case,
    CaseError,
    FloatArray,
    IntArray,
    diagnostics,
    html,
    number,
    settling as at,
    style,
    write_text,
)
from delam_fem.studies.linear import linear_amplitudes
from delam_fem.studies.sweeps.grid import INITIAL, Sweep

if TYPE_CHECKING:
    import xarray as xr


_EVEN = 1e-6
"""Relative difference of steps up to which a spacing counts as even."""


@dataclass(frozen=True)
class DiagramAxis:
    """An axis of a sweep as a diagram shows it.

    Attributes:
        name: name of the coordinate.
        key: key of the case.
        values: values along the axis, shape (n,).
        positions: values in the unit of the label, or 0, 1, … for words, shape (n,).
        label: label of the axis, with its unit.
        words: labels of the ticks of an axis of words; empty for numbers.
    """

    name: str
    key: str
    values: FloatArray
    positions: FloatArray
    label: str
    words: tuple[str, ...] = ()

    @property
    def edges(self) -> FloatArray:
        """Edges of the cells of a map, shape (n + 1,)."""
        return style.edges(self.positions, is_logarithmic=self.is_logarithmic)

    @property
    def is_logarithmic(self) -> bool:
        """Whether the values are evenly spaced on a logarithmic axis but not on a linear one."""
        v = self.positions
        if v.size < 3 or v.min() <= 0.0 or self.words:
            return False
        steps = np.diff(v)
        ratios = np.diff(np.log(v))
        return bool(
            np.ptp(ratios) < _EVEN * np.abs(ratios).max()
            and np.ptp(steps) > _EVEN * np.abs(steps).max()
        )


def _axis(data: xr.Dataset, name: str) -> DiagramAxis:
    """Return one axis; lengths are shown in millimetres."""
    coordinate = data[name]
    key = str(coordinate.attrs["key"])
    text = str(coordinate.attrs["long_name"])
    units = str(coordinate.attrs.get("units", ""))
    if not units:
        words = tuple(str(word) for word in coordinate.to_numpy())
        places = np.arange(float(len(words)))
        return DiagramAxis(name, key, places, places, text, words)
    values = coordinate.to_numpy().astype(np.float64)
    factor, unit = (1e3, "mm") if units == "m" else (1.0, "–" if units == "1" else units)
    return DiagramAxis(name, key, values, factor * values, f"{text}  [{unit}]")


def is_unsettled(data: xr.Dataset) -> xr.DataArray:
    """Return which points were completed, but have not settled."""
    is_completed = data["outcome"] == "completed"
    return is_completed & ((data["settled"] == 0.0) if "settled" in data else False)


def is_unresolved(data: xr.Dataset) -> xr.DataArray:
    """Return at which completed points a blow on a contact spring has too few steps."""
    is_completed = data["outcome"] == "completed"
    return is_completed & ((data["blow_steps"] < BLOW_STEPS) if "blow_steps" in data else False)


def heading(data: xr.Dataset) -> str:
    """Return a short description of the base case, without the keys that an axis changes."""
    case = Case.from_toml(data.attrs["case"])
    keys = {str(data[name].attrs.get("key")) for name in data.coords}
    motion, contact = case.excitation, case.contact
    parts = []
    if motion.kind == "harmonic" and "excitation.frequency" not in keys:
        parts.append(f"{motion.frequency:g} Hz")
    if not {"excitation.amplitude", "excitation.acceleration"} & keys:
        parts.append(motion.size)
    if "contact.law" not in keys:
        parts.append(f"contact: {contact.law}")
    if "contact.restitution" not in keys:
        parts.append(f"e = {contact.restitution:g}")
    is_open = case.time.periods == "settled"
    parts.append("each point until settled" if is_open else f"{case.n_periods} periods per point")
    return f"{case.name}: {', '.join(parts)}"


DIRECTION_STYLE = {"up": (style.BLUE, "^", "-"), "down": (style.VERMILLION, "v", "--")}
"""Colour, marker and line of each direction, the same in every diagram."""
POINT_STYLE = {"up": (style.SKY, 3.4), "down": (style.VERMILLION, 1.4)}
"""Colour and size of stroboscopic points; both directions stay visible where they agree."""
HEADROOM = 1.15
"""Upper end of the axis over the largest amplitude; linear resonances lie far above it."""
UNSETTLED_COLOUR = "#888888"
"""Colour of points that have not settled, in every diagram over one axis."""
STACK_POINTS = 200
"""Frequencies of the linear response of a bonded stack, each of which takes a solution."""
BARS = 2.0
"""Half the length of error bars, in standard errors."""
LINEAR_POINTS = 2000


@dataclass(frozen=True)
class DrawnChannel:
    """A channel of a sweep in a panel of its own.

    Attributes:
        name: name of the channel, or of the lamina of a reference probe.
        symbol: symbol of its displacement; empty: a channel that was asked for.
        unit: unit in which it is shown.
        values: what is drawn, in this unit, over the grid of the sweep.
        number: number of the lamina of a reference probe; None: a channel that was asked for.
    """

    name: str
    symbol: str
    unit: str
    values: xr.DataArray
    number: int | None = None


def drawn_channels(
    data: xr.Dataset, variable: str, measure: str, channels: Sequence[str]
) -> list[DrawnChannel]:
    """Return what a diagram over one axis draws: channels, or the displacements of all laminae.

    Args:
        data: dataset of a sweep.
        variable: variable of the displacements of all laminae.
        measure: what it is of a channel.
        channels: names of the channels; none: the displacements.

    Raises:
        CaseError: the sweep has not recorded a channel.
    """
    if not channels:
        return [
            DrawnChannel(
                str(name), f"$q_{{{i + 1}}}$ ", "mm", 1e3 * data[variable].isel(lamina=i), i
            )
            for i, name in enumerate(data["lamina"].to_numpy())
        ]
    drawn = []
    for name in channels:
        if f"{name}_{measure}" not in data:
            known = [str(key) for key in data.data_vars if str(key).endswith(f"_{measure}")]
            names = [key.removesuffix(f"_{measure}") for key in known if key != variable]
            raise CaseError(
                f"channel: expected some of those that the sweep keeps ({', '.join(names)}), given "
                f"{name}; a sweep file with record.channels = [{name!r}] keeps it"
            )
        values = data[f"{name}_{measure}"]
        unit, factor = style.shown_unit(str(values.attrs["units"]))
        drawn.append(DrawnChannel(name, "", unit, factor * values))
    return drawn


def response(data: xr.Dataset, axis: DiagramAxis, channels: Sequence[str] = ()) -> Figure:
    """Draw amplitudes over one axis for each direction; of displacements those without contact."""

    def draw(panel: Axes, channel: DrawnChannel) -> None:
        for label, amplitude, _, (colour, marker, line) in _directions(data, channel.values):
            panel.plot(
                axis.positions, amplitude.to_numpy(), line, color=colour, marker=marker,
                markersize=3.0, linewidth=1.0, label=label,
            )  # fmt: skip
        computed = channel.values.to_numpy()
        if np.isfinite(computed).any():  # what is linear may leave the panel
            panel.set_ylim(0.0, HEADROOM * float(np.nanmax(computed)) or None)
        if axis.key == "excitation.frequency" and channel.number is not None:
            case = Case.from_toml(data.attrs["case"])
            f = np.linspace(axis.values.min(), axis.values.max(), LINEAR_POINTS)
            if not case.is_apart:
                f = np.linspace(f[0], f[-1], STACK_POINTS)
            alone = 1e3 * linear_amplitudes(case, f)[channel.number]
            panel.plot(
                f, alone, ":", color=style.BASE_COLOUR, linewidth=1.3, label="linear, no contact"
            )

    drawn = drawn_channels(data, "tip_amplitude", "amplitude", channels)
    return _of_channels(data, axis, drawn, draw, 3.0, "half peak-to-peak  {}[{}]")


def bifurcation(data: xr.Dataset, axis: DiagramAxis, channels: Sequence[str] = ()) -> Figure:
    """Draw channels at the end of the last periods of each point over one axis."""

    def draw(panel: Axes, channel: DrawnChannel) -> None:
        for label, strobes, part, _ in _directions(data, channel.values):
            colour, size = POINT_STYLE.get(label, (style.BLUE, 1.6))
            q = strobes.transpose(axis.name, "strobe").to_numpy()
            is_grey = is_unsettled(part).to_numpy()
            for mask, shade in ((~is_grey, colour), (is_grey, UNSETTLED_COLOUR)):
                panel.plot(
                    np.repeat(axis.positions[mask], q.shape[1]), q[mask].ravel(), "o", color=shade,
                    markersize=size, alpha=0.5, markeredgewidth=0.0,
                )  # fmt: skip
            panel.plot([], [], "o", color=colour, markersize=2.0 * size, label=label)

    drawn = drawn_channels(data, "strobe_displacement", "strobe", channels)
    return _of_channels(data, axis, drawn, draw, 3.75, "{}at t = nT [{}]")


def lyapunov(data: xr.Dataset, axis: DiagramAxis) -> Figure:
    """Draw the largest Lyapunov exponent over one axis."""
    figure, (panel,) = style.stacked(1, 4.2)
    panel.axhline(0.0, color=style.BLACK, linewidth=0.8)
    for label, _, part, (colour, marker, line) in _directions(data, data["lyapunov_exponent"]):
        errors = BARS * part["lyapunov_error"].to_numpy() if "lyapunov_error" in part else None
        panel.errorbar(
            axis.positions, part["lyapunov_exponent"].to_numpy(), yerr=errors, fmt=line,
            color=colour, marker=marker, markersize=3.0, linewidth=1.0, elinewidth=0.8, capsize=2.0,
            label=label,
        )  # fmt: skip
    _mark_points(panel, data, axis)
    panel.set(ylabel=f"largest Lyapunov exponent [1/s]\nbars: ±{BARS:g} errors")
    style.legend_above(panel)
    _finish(figure, [panel], data, axis)
    return figure


def _of_channels(
    data: xr.Dataset,
    axis: DiagramAxis,
    drawn: Sequence[DrawnChannel],
    draw: Callable[[Axes, DrawnChannel], None],
    height: float,
    label: str,
) -> Figure:
    """Return a figure with one panel of a height [in] for each channel over one axis.

    Args:
        data: dataset of the sweep.
        axis: the axis.
        drawn: the channels.
        draw: draws a channel into its panel.
        height: height of a panel [in].
        label: label of the y axes, a format of the symbol and the unit.
    """
    height = max(height * len(drawn), 4.2)
    figure, panels = style.stacked(len(drawn), height, sharex=True)
    for panel, channel in zip(panels, drawn, strict=True):
        _shade_two_motions(panel, data, axis)
        draw(panel, channel)
        _mark_points(panel, data, axis)
        panel.set_title(channel.name, loc="left")
        panel.set(ylabel=label.format(channel.symbol, channel.unit))
    style.legend_above(panels[0])
    _finish(figure, panels, data, axis)
    return figure


def _directions(
    data: xr.Dataset, values: xr.DataArray
) -> list[tuple[str, xr.DataArray, xr.Dataset, tuple[str, str, str]]]:
    """Return label, values, points and style of each direction."""
    if "direction" not in data.dims:
        order = tomllib.loads(data.attrs.get("sweep", "")).get("order", "independent")
        label = "each point from the start" if order == "independent" else f"going {order}"
        return [(label, values, data, (style.BLUE, "o", "-"))]
    return [
        (name, values.sel(direction=name), data.sel(direction=name), line_style)
        for name, line_style in DIRECTION_STYLE.items()
    ]


def _shade_two_motions(panel: Axes, data: xr.Dataset, axis: DiagramAxis) -> None:
    """Shade where settled amplitudes of both directions differ by more than `at.SAME_ATTRACTOR`."""
    if "direction" not in data.dims or "tip_amplitude" not in data:
        return
    a = data["tip_amplitude"].transpose("direction", axis.name, "lamina").to_numpy()
    differs = (np.abs(a[0] - a[1]) > at.SAME_ATTRACTOR * np.maximum(a[0], a[1])).any(axis=-1)
    differs &= ~is_unsettled(data).any("direction").to_numpy()  # one may still become the other
    edges = np.flatnonzero(np.diff(differs.astype(np.int8), prepend=0, append=0))
    x = axis.positions
    middles = np.concatenate([x[:1], 0.5 * (x[1:] + x[:-1]), x[-1:]])
    for k, (start, stop) in enumerate(edges.reshape(-1, 2)):
        label = "depends on the direction" if k == 0 else None
        panel.axvspan(
            middles[start],
            middles[stop],
            color=style.GAP_COLOUR,
            linewidth=0.0,
            zorder=0,
            label=label,
        )


def _mark_points(panel: Axes, data: xr.Dataset, axis: DiagramAxis) -> None:
    """Mark the points that have not settled or have no result at the bottom of the panel."""
    for is_marked, marker, colour, label in (
        (is_unsettled(data), "s", UNSETTLED_COLOUR, NOT_SETTLED),
        (data["outcome"] != "completed", "x", style.BLACK, "not completed"),
    ):
        others = [dim for dim in is_marked.dims if dim != axis.name]
        x = axis.positions[is_marked.any(others).to_numpy()]
        if x.size:
            panel.plot(
                x, np.zeros(x.size), marker, color=colour, markersize=5.0, clip_on=False,
                transform=panel.get_xaxis_transform(), label=label,
            )  # fmt: skip


def _finish(figure: Figure, panels: Iterable[Axes], data: xr.Dataset, axis: DiagramAxis) -> None:
    """Label the axis of all panels and write the title of the figure."""
    for panel in panels:
        panel.set(xscale="log" if axis.is_logarithmic else "linear")
        panel.margins(x=0.01)
    style.label_x(panels, axis.label)
    figure.suptitle(heading(data))


ATTRACTOR_COLOURS = (
    style.BLUE,
    style.ORANGE,
    style.GREEN,
    style.SKY,
    style.VERMILLION,
    style.YELLOW,
    style.PURPLE,
)
"""Colours of the attractors, the most frequent first; all further attractors share a grey."""
NOT_SETTLED = at.KINDS[at.UNSETTLED]
HATCH = "////"
OTHERS, ISOLATED, NONE = "#999999", "#dddddd", "#ffffff"
MOST_LABELS = 900
"""Largest number of cells up to which the periodicity is written into them."""
DIVERGING = "PuOr_r"
"""Colour map from purple to orange, readable for the colour-blind; white is zero."""


def _map(data: xr.Dataset, x: DiagramAxis, y: DiagramAxis) -> tuple[Figure, Axes]:
    """Return a figure for a map over two axes, with labels and a title."""
    figure, (panel,) = style.stacked(1, 6.6)
    panel.grid(False)
    for axis, name in ((x, "x"), (y, "y")):
        panel.set(**{f"{name}label": axis.label})
        if axis.is_logarithmic:
            panel.set(**{f"{name}scale": "log"})
        if axis.words:
            panel.set(**{f"{name}ticks": axis.positions, f"{name}ticklabels": axis.words})
    figure.suptitle(heading(data))
    return figure, panel


def plane(data: xr.Dataset, x: DiagramAxis, y: DiagramAxis) -> Figure:
    """Draw the kind of motion at each point over two axes."""
    try:
        kinds = at.kinds_of_motion(
            data["outcome"].to_numpy(),
            data["periodicity"].to_numpy(),
            data["strobe_displacement"].to_numpy(),
            data["is_decided"].to_numpy() != 0.0 if "is_decided" in data else None,
            data["settled"].to_numpy() != 0.0 if "settled" in data else None,
        )
    except ValueError as error:
        raise CaseError(f"diagram plane: {error}") from None
    figure, panel = _map(data, x, y)
    _cells(panel, x, y, kinds, style.KIND_COLOURS)
    if kinds.size <= MOST_LABELS:
        periods = data["periodicity"].to_numpy()
        for i, j in zip(*np.nonzero((kinds == at.HIGHER) & (periods > 1)), strict=True):
            panel.text(
                x.positions[i], y.positions[j], f"{periods[i, j]:.0f}", fontsize=7.0, ha="center",
                va="center", color=style.BLACK,
            )  # fmt: skip
    present = [k for k in range(len(at.KINDS)) if (kinds == k).any()]
    shares = [f"{at.KINDS[k]} ({_percent(float((kinds == k).mean()))})" for k in present]
    _hatch_unsettled(panel, x, y, data)
    _legend(panel, [style.KIND_COLOURS[k] for k in present], shares)
    figure.supxlabel(
        f"period P: strobes P ≤ {diagnostics.LARGEST_PERIODICITY} periods apart differ by less "
        f"than {100 * diagnostics.PERIODIC_SCATTER:g} % of the half peak-to-peak amplitude (rms); "
        f"quasi-periodic: {100 * at.LINE_SHARE:g} % of the strobes' power\nin "
        f"{at.LINES} spectral lines; irregular: none of these; undecided: the class changes with "
        f"the {100 * diagnostics.PERIODIC_SCATTER:g} % times or over "
        f"{diagnostics.PERIODIC_MARGIN:g}; numbers: P of higher order;\n"
        "hatched: the transient is not over",
        fontsize=8.0, color="#555555",
    )  # fmt: skip
    return figure


def basins(data: xr.Dataset, x: DiagramAxis, y: DiagramAxis) -> Figure:
    """Draw the attractor that is reached from each initial condition (basins of attraction)."""
    names = ("periodicity", "tip_min", "tip_max", "strobe_displacement")
    moving = is_unsettled(data)
    kept_points = data[list(names)].where(~moving)
    attractors = at.attractors(*(kept_points[name].to_numpy() for name in names))
    isolated = at.is_isolated(attractors.number)
    common = np.setdiff1d(attractors.number[~isolated], [-1])
    number = np.where(isolated, common.size, np.searchsorted(common, attractors.number))
    number[attractors.number < 0] = common.size + 1
    colours = [ATTRACTOR_COLOURS[k] if k < len(ATTRACTOR_COLOURS) else OTHERS for k in common]
    figure, panel = _map(data, x, y)
    _cells(panel, x, y, number, (*colours, ISOLATED, NONE))
    n_shown = min(common.size, len(ATTRACTOR_COLOURS))
    labels = [_attractor(attractors, k) for k in common[:n_shown].tolist()]
    colours = colours[:n_shown]
    for colour, text, share in (
        (OTHERS, f"{common.size - n_shown} others", attractors.share[common[n_shown:]].sum()),
        (ISOLATED, "isolated cells: not decided", isolated.mean()),
        (NONE, "not completed", (attractors.number < 0).mean() - float(moving.mean())),
        (NONE, NOT_SETTLED, _hatch_unsettled(panel, x, y, data)),
    ):
        if share > 0.0:
            labels.append(f"{text} ({_percent(float(share))})")
            colours.append(colour)
    _legend(panel, colours, labels)
    laminae = " / ".join(str(name) for name in data["lamina"].to_numpy())
    figure.supxlabel(
        f"attractors by period and half peak-to-peak displacement ({laminae}); one attractor: "
        f"extremes and strobes differ by at most {100 * at.SAME_ATTRACTOR:g} % of the amplitude,\n"
        "and two neighbouring cells share it",
        fontsize=8.0, color="#555555",
    )  # fmt: skip
    return figure


def _attractor(found: at.Attractors, k: int) -> str:
    """Return period, amplitudes and share of an attractor in words."""
    P = found.periodicity[k]
    period = f"period {P:.0f}" if np.isfinite(P) else "not periodic"
    sizes = " / ".join(f"{amplitude:.1f}" for amplitude in 1e3 * found.amplitude[k])
    return f"{period}, {sizes} mm ({_percent(float(found.share[k]))})"


def lyapunov_map(data: xr.Dataset, x: DiagramAxis, y: DiagramAxis) -> Figure:
    """Draw the largest Lyapunov exponent over two axes."""
    values = data["lyapunov_exponent"].to_numpy()
    figure, panel = _map(data, x, y)
    bound = float(np.nanmax(np.abs(values))) if np.isfinite(values).any() else 1.0
    mesh = panel.pcolormesh(
        x.edges, y.edges, values.T, cmap=DIVERGING,
        norm=TwoSlopeNorm(0.0, -bound or -1.0, bound or 1.0),
    )  # fmt: skip
    figure.colorbar(mesh, ax=panel, label="largest Lyapunov exponent [1/s]")
    share = _hatch_unsettled(panel, x, y, data)
    if share > 0.0:
        _legend(panel, [NONE], [f"{NOT_SETTLED} ({_percent(share)})"])
    return figure


def _percent(share: float) -> str:
    """Return a share in per cent as text; shares below 1 % become "< 1 %", not "0 %"."""
    return f"{100.0 * share:.0f} %" if share >= 0.01 else "< 1 %"


def _cells(
    panel: Axes, x: DiagramAxis, y: DiagramAxis, numbers: IntArray,
    colours: tuple[str, ...],
) -> None:  # fmt: skip
    """Colour the cell of each point by its number."""
    panel.pcolormesh(
        x.edges, y.edges, numbers.T, cmap=ListedColormap(list(colours)),
        vmin=-0.5, vmax=len(colours) - 0.5, edgecolors="white", linewidth=0.3,
    )  # fmt: skip


def _hatch_unsettled(panel: Axes, x: DiagramAxis, y: DiagramAxis, data: xr.Dataset) -> float:
    """Hatch the cells of points that have not settled; return their share."""
    mask = is_unsettled(data).to_numpy()
    if mask.any():
        panel.pcolor(
            x.edges, y.edges, np.where(mask.T, 0.0, np.nan), hatch=HATCH, alpha=0.0,
        )  # fmt: skip
    return float(mask.mean())


def _legend(panel: Axes, colours: list[str], labels: list[str]) -> None:
    """Draw the legend of the colours above the panel."""
    handles = [
        Patch(
            facecolor=colour,
            edgecolor="#555555",
            linewidth=0.5,
            label=label,
            hatch=HATCH if label.startswith(NOT_SETTLED) else None,
        )
        for colour, label in zip(colours, labels, strict=True)
    ]
    panel.legend(
        handles=handles, loc="lower left", bbox_to_anchor=(0.0, 1.0),
        ncols=min(3, max(1, len(handles))), frameon=False,
    )  # fmt: skip


DiagramName = Literal["response", "bifurcation", "plane", "lyapunov", "basins"]
OF_CHANNELS: tuple[DiagramName, ...] = ("response", "bifurcation")
"""Diagrams that show channels."""


_NEEDS: Mapping[DiagramName, tuple[tuple[int, ...], Mapping[str, int], Mapping[str, str]]] = (
    MappingProxyType(
        {
            "response": ((1,), {"summary": 1}, {"tip_amplitude": "summary = true"}),
            "bifurcation": ((1,), {"strobes": 1}, {"strobe_displacement": "strobes = 40"}),
            "plane": (
                (2,),
                {"summary": 1, "strobes": at.FEWEST_STROBES},
                {
                    "periodicity": "summary = true",
                    "strobe_displacement": f"strobes = {2 * at.FEWEST_STROBES}",
                },
            ),
            "lyapunov": ((1, 2), {"lyapunov": 1}, {"lyapunov_exponent": "lyapunov = 200"}),
            "basins": (
                (2,),
                {"summary": 1, "strobes": 1},
                {"periodicity": "summary = true", "strobe_displacement": "strobes = 40"},
            ),
        }
    )
)
"""What a diagram needs of a sweep: possible numbers of axes, least values of `record`, and
variables of the dataset with the record that
has them."""


def _axes(kind: DiagramName, dims: Iterable[str], fewer: str, one: str) -> list[str]:
    """Return the axes of a sweep with given dimensions.

    Args:
        kind: name of the diagram.
        dims: dimensions of the grid.
        fewer: remedy if the diagram needs another number of axes.
        one: remedy if a map would have to show two directions.

    Raises:
        CaseError: a diagram of this kind cannot be drawn of these axes.
    """
    counts = _NEEDS[kind][0]
    names = list(dims)
    axes = [name for name in names if name != "direction"]
    if len(axes) not in counts:
        count = " or ".join(map(str, counts))
        raise CaseError(
            f"diagram {kind}: expected a sweep over {count} {'axis' if count == '1' else 'axes'}, "
            f"given {', '.join(axes)}; {fewer}"
        )
    if len(axes) == 2 and len(names) == 3:
        raise CaseError(f"diagram {kind}: a map shows one direction; {one}")
    return axes


def _require_channels(kind: DiagramName, channels: Sequence[str]) -> None:
    """Check that a diagram is one of channels, if any are asked for.

    Raises:
        CaseError: it is one of the whole motion.
    """
    if channels and kind not in OF_CHANNELS:
        raise CaseError(
            f"diagram {kind}: expected no channel, as it shows kinds of the whole motion, given "
            f"{', '.join(channels)}; {' and '.join(OF_CHANNELS)} show channels"
        )


def require_drawable(kind: DiagramName, sweep: Sweep, channels: Sequence[str] = ()) -> None:
    """Check that a diagram can be drawn of a sweep before the sweep is computed.

    Raises:
        CaseError: the sweep has another number of axes, or does not record what is drawn.
    """
    _require_channels(kind, channels)
    of_sweep = sweep.file.record.channels
    if missing := [name for name in channels if name not in of_sweep]:
        raise CaseError(
            f"diagram {kind}: expected {', '.join(map(repr, missing))} among record.channels of "
            f"the sweep file, given {', '.join(map(repr, of_sweep)) or 'none'}; nothing was "
            "computed"
        )
    nothing = "nothing was computed"
    order = sweep.file.order
    one = f'expected order = "independent", "up" or "down", given "{order}"; {nothing}'
    _axes(kind, sweep.sizes, nothing, one)
    for key, least in _NEEDS[kind][1].items():
        value = getattr(sweep.file.record, key)
        if value < least:
            wanted, actual = ("true", "false") if isinstance(value, bool) else (least, value)
            raise CaseError(
                f"diagram {kind}: expected record.{key} of at least {wanted} in the sweep file, "
                f"given {actual}; {nothing}"
            )


def is_drawable(kind: DiagramName, data: xr.Dataset) -> bool:
    """Return whether a diagram can be drawn of the dataset of a sweep."""
    try:
        _axes(kind, map(str, data["outcome"].dims), "", "")
    except CaseError:
        return False
    _, least, variables = _NEEDS[kind]
    has_all = all(name in data for name in variables)
    return has_all and data.sizes.get("strobe", 0) >= least.get("strobes", 0)


def diagram(kind: DiagramName, data: xr.Dataset, channels: Sequence[str] = ()) -> Figure:
    """Draw a diagram of a sweep.

    Args:
        kind: name of the diagram.
        data: dataset from `run_sweep`, or a part of it with the number of axes that the diagram
            needs: one for response and bifurcation, two for plane and basins, one or two for
            lyapunov.
        channels: channels that response and bifurcation show; none: the displacements of all
            laminae.

    Raises:
        CaseError: the sweep has another number of axes, or has not recorded what is drawn.
    """
    _require_channels(kind, channels)
    fewer = "select one value of the others: data.isel(name=0)"
    one = 'select it: data.sel(direction="up"), or compute with order = "independent"'
    axes = _axes(kind, map(str, data["outcome"].dims), fewer, one)
    for name, remedy in _NEEDS[kind][2].items() if not channels else ():
        if name not in data:
            raise CaseError(f"diagram: the sweep has no {name}; compute it with record.{remedy}")
    draw: dict[DiagramName, Callable[..., Figure]] = {
        "response": partial(response, channels=channels),
        "bifurcation": partial(bifurcation, channels=channels),
        "plane": plane,
        "lyapunov": lyapunov_map if len(axes) == 2 else lyapunov,
        "basins": basins,
    }
    ordered = data.transpose(*data["outcome"].dims, ...)
    with style.styled():
        return draw[kind](ordered, *(_axis(data, name) for name in axes))


def save_diagram(
    kind: DiagramName, data: xr.Dataset, path: str | Path, channels: Sequence[str] = ()
) -> Path:
    """Draw a diagram and write it to a PNG file; see `diagram`.

    Returns:
        The path of the file.

    Raises:
        CaseError: the sweep has another number of axes, or has not recorded what is drawn.
        OSError: the file cannot be written.
    """
    return style.save_figure(lambda: diagram(kind, data, channels), Path(path))


MOST_POINTS = 2500
"""Largest number of points in the table and map of a page, which then has about 1.5 MB."""
COLOURS = {1: style.SKY, 2: style.ORANGE}
"""Colours of periodicities in the map; the further ones are green."""
IRREGULAR, FAILED, MOVING = "#bbbbbb", "#ffffff", "#e0e0e0"
FILES = {
    "sweep.nc": "all numbers of all points, NetCDF",
    "sweep.toml": "the sweep",
    "case.toml": "the case that it varies",
}
SHOWN = ("periodicity", "tip_contacts_per_period", "blow_steps")
"""Numbers of a point in the table."""
ALONE = (
    "The run of a point starts from its own initial state. In a sweep with an order (up, down) the "
    "points start from the state of their neighbours, so that it may reach another motion."
)


@dataclass(frozen=True)
class DiagramPoint:
    """One point of a sweep.

    Attributes:
        number: number of the point in the order of the grid.
        values: values of its coordinates in words, by name.
        command: command that runs it; empty where a run cannot have its initial state.
        report: page of its run, relative to the folder of the sweep; empty without one.
        outcome: its outcome, or "missing".
        is_moving: whether it was completed but has not settled.
        numbers: its numbers by name, of `SHOWN`, as far as the sweep has them.
    """

    number: int
    values: dict[str, str]
    command: str
    report: str
    outcome: str
    is_moving: bool
    numbers: dict[str, float]


def write_page(data: xr.Dataset, directory: str | Path) -> Path:
    """Write the page of a sweep with the diagrams that are in its folder.

    Args:
        data: dataset of the sweep.
        directory: folder of the sweep.

    Returns:
        The path of the page.

    Raises:
        OSError: the file cannot be written.
    """
    directory = Path(directory)
    about = data.attrs
    sections = [
        html.PageSection(
            "",
            [
                html.Paragraph(sentence(data), "verdict"),
                *(html.Paragraph(text, "warning") for text in [blow_warning(data)] if text),
            ],
        ),
        html.PageSection("Diagrams", [*_diagrams(data, directory)]),
        html.PageSection("Points", [*_points(data, directory)]),
        html.PageSection("Files", [html.files(directory, FILES)]),
        html.PageSection("Sweep", [html.Preformatted(str(about["sweep"]))]),
        html.PageSection("Case", [html.Preformatted(str(about["case"]))]),
    ]
    text = html.page(str(about["title"]), [s for s in sections if s.blocks], contents=True)
    return write_text(directory / "report.html", text)


def sentence(data: xr.Dataset) -> str:
    """Return a sentence with the numbers of points of a sweep by outcome and periodicity."""
    outcomes = Counter(str(value) or "missing" for value in data["outcome"].to_numpy().ravel())
    parts = [f"{count} {outcome}" for outcome, count in outcomes.most_common()]
    text = f"{sum(outcomes.values())} points: {', '.join(parts)}"
    if "periodicity" in data and outcomes["completed"]:
        is_moving = is_unsettled(data)
        is_judged = (data["outcome"] == "completed") & ~is_moving
        periods = data["periodicity"].to_numpy()[is_judged.to_numpy()]
        kinds = Counter(int(P) if np.isfinite(P) else 0 for P in periods)
        moving = int(is_moving.sum())
        words = [
            f"{kinds[P]} of period {P}" if P else f"{kinds[0]} without a period"
            for P in sorted(+kinds, key=lambda P: P or 99)
        ]
        words += [f"{moving} not settled"] if moving else []
        text += f"; of these {', '.join(words)}"
    return f"{text}."


def blow_warning(data: xr.Dataset) -> str | None:
    """Return a warning if blows on contact springs have too few steps somewhere; else None."""
    count = int(is_unresolved(data).sum())
    if not count:
        return None
    fewest = float(data["blow_steps"].where(is_unresolved(data)).min())
    return (
        f"at {count} of {data.attrs['n_completed']} completed points a blow on a contact spring "
        f"has fewer than {BLOW_STEPS} steps, {fewest:.2g} at the fewest (blow_steps), so that its "
        f"energy is wrong; try up to {BLOW_STEPS / fewest:.3g} times as many steps, or softer "
        "springs"
    )


def points(data: xr.Dataset, directory: Path) -> Iterator[DiagramPoint]:
    """Yield the points of a sweep in the order of its grid."""
    grid = data["outcome"]
    axes = [str(name) for name in data.coords if "key" in data[name].attrs]
    names = ["direction"] * ("direction" in grid.dims) + axes
    columns = [name for name in SHOWN if name in data and data[name].notnull().any()]
    coordinates, numbers = (
        {name: data[name].broadcast_like(grid).to_numpy().ravel() for name in group}
        for group in (names, columns)
    )
    is_moving = is_unsettled(data).to_numpy().ravel()
    for index, outcome in enumerate(grid.to_numpy().ravel()):
        values = {name: column[index] for name, column in coordinates.items()}
        keys = {str(data[name].attrs["key"]): values[name] for name in axes}
        folder = f"points/{index}"
        there = (directory / folder / "report.html").is_file()
        yield DiagramPoint(
            index,
            {name: f"{v:.6g}" if isinstance(v, float) else str(v) for name, v in values.items()},
            _command(keys, directory, folder),
            f"{folder}/report.html" if there else "",
            str(outcome) or "missing",
            bool(is_moving[index]),
            {name: float(column[index]) for name, column in numbers.items()},
        )


def _command(keys: dict[str, Any], directory: Path, folder: str) -> str:
    """Return the command that runs a point into a folder of the sweep."""
    if any(key.partition(".")[0] == INITIAL for key in keys):
        return ""
    settings = [text for key, value in keys.items() for text in ("--set", f"{key}={value}")]
    case = str(directory / "case.toml")
    folder = str(directory / folder)
    return shlex.join(["delam-fem", "run", case, *settings, "-o", folder])


def _diagrams(data: xr.Dataset, directory: Path) -> Iterator[html.Block]:
    """Yield the diagrams that have been drawn, or how to draw one."""
    pictures = [directory / f"{kind}.png" for kind in _NEEDS]
    for picture in pictures:
        if picture.is_file():
            yield html.Gallery([html.embedded(picture)], picture.stem, f"Diagram: {picture.stem}.")
    if any(picture.is_file() for picture in pictures):
        return
    possible = next((kind for kind in _NEEDS if is_drawable(kind, data)), None)
    if possible is None and data["outcome"].ndim == 1:
        possible = "response"
    if possible is not None:
        command = shlex.join(["delam-fem", "show", "diagram", possible, str(directory)])
        yield html.Paragraph(("No diagram has been drawn yet; ", html.Code(command), " draws one."))


def _points(data: xr.Dataset, directory: Path) -> Iterator[html.Block]:
    """Yield the map of the points and their table."""
    if data["outcome"].size > MOST_POINTS:
        yield html.Paragraph(
            f"{data['outcome'].size} points are too many for a page; they are in sweep.nc.", "about"
        )
        return
    entries = list(points(data, directory))
    yield from _maps(data, entries)
    yield html.Paragraph(ALONE, "about")
    yield _table(entries)


def _maps(data: xr.Dataset, found: list[DiagramPoint]) -> Iterator[html.Block]:
    """Yield a map of the periodicity over two axes, one for each direction."""
    axes = [str(name) for name in data["outcome"].dims if name != "direction"]
    if len(axes) != 2:
        return
    yield html.Paragraph(
        "Periods after which the motion repeats, – where it does not, … where it has not settled; "
        "a cell leads to its run.",
        "about",
    )
    sizes = [data.sizes[name] for name in axes]
    for of_direction in np.array(found, dtype=object).reshape(-1, *sizes):
        rows = [
            (line[0].values[axes[1]], [_cell(point) for point in line])
            for line in of_direction.T[::-1]
        ]
        columns = [point.values[axes[0]] for point in of_direction[:, 0]]
        first = of_direction[0, 0].values.get("direction", "")
        yield html.CellMap(
            f"{axes[1]} over {axes[0]}" + (f", {first}" if first else ""), columns, rows
        )


def _cell(point: DiagramPoint) -> html.Cell:
    """Return the cell of a point in a map."""
    P = point.numbers.get("periodicity", np.nan)
    words = ", ".join(f"{name} = {value}" for name, value in point.values.items())
    target = point.report or f"#point-{point.number}"
    if point.outcome != "completed":
        return html.Cell("×", target, FAILED, f"{words}: {point.outcome}")
    if point.is_moving:
        return html.Cell("…", target, MOVING, f"{words}: not settled")
    if not np.isfinite(P):
        return html.Cell("–", target, IRREGULAR, words)
    return html.Cell(f"{P:.0f}", target, COLOURS.get(int(P), style.GREEN), f"{words}: {P:.0f}")


def _table(found: list[DiagramPoint]) -> html.HtmlTable:
    """Return the table of all points with the commands that run them."""
    names, quantities = (list(found[0].values), list(found[0].numbers)) if found else ([], [])
    rows = [
        (
            str(point.number),
            *point.values.values(),
            point.outcome,
            *map(number, point.numbers.values()),
            html.Link("report", point.report) if point.report else html.Code(point.command),
        )
        for point in found
    ]
    heading = ("point", *names, "outcome", *(name.replace("_", " ") for name in quantities), "run")
    return html.HtmlTable(heading, rows, anchors=[f"point-{point.number}" for point in found])
