"""Draw diagrams of a sweep over one axis or two."""

from __future__ import annotations

import tomllib
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap, TwoSlopeNorm
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from delam_fem.case.definition import Case
from delam_fem.numerics import settling as at
from delam_fem.numerics.settling import KINDS, SAME_ATTRACTOR, UNSETTLED
from delam_fem.numerics.types import FloatArray, IntArray
from delam_fem.results.diagnostics import LARGEST_PERIODICITY, PERIODIC_MARGIN, PERIODIC_SCATTER
from delam_fem.results.figures.style import (
    BASE_COLOUR,
    BLACK,
    BLUE,
    GAP_COLOUR,
    GREEN,
    ORANGE,
    PURPLE,
    SKY,
    VERMILLION,
    WIDTH,
    YELLOW,
    label_x,
    legend_above,
)
from delam_fem.studies.linear import linear_amplitudes
from delam_fem.system.errors import CaseError

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
        shown: values in the unit of the label, or 0, 1, … for words, shape (n,).
        label: label of the axis, with its unit.
        words: labels of the ticks of an axis of words; empty for numbers.
    """

    name: str
    key: str
    values: FloatArray
    shown: FloatArray
    label: str
    words: tuple[str, ...] = ()

    @property
    def is_logarithmic(self) -> bool:
        """Whether the values are evenly spaced on a logarithmic axis but not on a linear one."""
        v = self.shown
        if v.size < 3 or v.min() <= 0.0 or self.words:
            return False
        steps, ratios = np.diff(v), np.diff(np.log(v))
        return bool(
            np.ptp(ratios) < _EVEN * np.abs(ratios).max() <= np.ptp(steps)
            or (
                np.ptp(ratios) < _EVEN * np.abs(ratios).max()
                and np.ptp(steps) > _EVEN * np.abs(steps).max()
            )
        )


def axes_of(data: xr.Dataset, count: int, kind: str) -> tuple[DiagramAxis, ...]:
    """Return the axes of a sweep, and check their number.

    Args:
        data: dataset of the sweep.
        count: required number of axes.
        kind: kind of the diagram, for the message.

    Raises:
        CaseError: the sweep has more or fewer axes.
    """
    names = [str(name) for name in data["outcome"].dims if name != "direction"]
    if len(names) != count:
        raise CaseError(
            f"diagram {kind}: expected a sweep over {count} "
            f"{'axis' if count == 1 else 'axes'}, given {', '.join(names)}; select one value of "
            "the others: data.isel(name=0)"
        )
    return tuple(_axis(data, name) for name in names)


def _axis(data: xr.Dataset, name: str) -> DiagramAxis:
    """Return one axis; lengths are shown in millimetres."""
    coordinate = data[name]
    key, text = str(coordinate.attrs["key"]), str(coordinate.attrs["long_name"])
    units = str(coordinate.attrs.get("units", ""))
    if not units:
        words = tuple(str(word) for word in coordinate.to_numpy())
        places = np.arange(float(len(words)))
        return DiagramAxis(name, key, places, places, text, words)
    values = coordinate.to_numpy().astype(np.float64)
    factor, unit = (1e3, "mm") if units == "m" else (1.0, "–" if units == "1" else units)
    return DiagramAxis(name, key, values, factor * values, f"{text}  [{unit}]")


def require(data: xr.Dataset, name: str, remedy: str) -> None:
    """Check that a dataset has a variable.

    Raises:
        CaseError: the variable is missing; the message contains the remedy.
    """
    if name not in data:
        raise CaseError(f"diagram: the sweep has no {name}; compute it with {remedy}")


def is_unsettled(data: xr.Dataset) -> xr.DataArray:
    """Return which points were completed, but have not settled."""
    is_completed = data["outcome"] == "completed"
    return is_completed & ((data["settled"] == 0.0) if "settled" in data else False)


def sweep_keys(data: xr.Dataset) -> dict[str, object]:
    """Return the sweep file as `tomllib` returns it; empty if the dataset does not have it."""
    return tomllib.loads(data.attrs.get("sweep", ""))


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


DIRECTION_STYLE = {"up": (BLUE, "^", "-"), "down": (VERMILLION, "v", "--")}
"""Colour, marker and line of each direction, the same in every diagram."""
POINT_STYLE = {"up": (SKY, 3.4), "down": (VERMILLION, 1.4)}
"""Colour and size of stroboscopic points; both directions stay visible where they agree."""
HEADROOM = 1.15
"""Upper end of the axis over the largest amplitude; linear resonances lie far above it."""
UNSETTLED_COLOUR = "#888888"
"""Colour of points that have not settled, in every diagram over one axis."""
STACK_POINTS = 200
"""Points of the linear response of a bonded stack, which takes a solution each."""
BARS = 2.0
"""Half the length of error bars, in standard errors."""
LINEAR_POINTS = 2000


def response(data: xr.Dataset) -> Figure:
    """Draw the tip amplitudes over one axis for each direction, and those without contact."""
    (axis,) = axes_of(data, 1, "response")
    require(data, "tip_amplitude", "record.summary = true")
    figure, panels = _panels(data, 3.0)
    for i, (panel, name) in enumerate(zip(panels, data["lamina"].to_numpy(), strict=True)):
        _shade_two_motions(panel, data, axis)
        for label, part, (colour, marker, line) in _directions(data):
            amplitude = 1e3 * part["tip_amplitude"].isel(lamina=i).to_numpy()
            panel.plot(
                axis.shown, amplitude, line, color=colour, marker=marker, markersize=3.0,
                linewidth=1.0, label=label,
            )  # fmt: skip
        _top(panel, 1e3 * data["tip_amplitude"].isel(lamina=i).to_numpy())
        if axis.key == "excitation.frequency":
            _linear(panel, data, axis, i)
        _mark_points(panel, data, axis)
        panel.set_title(str(name), loc="left")
        panel.set(ylabel=f"half peak-to-peak  $q_{{{i + 1}}}$ [mm]")
    legend_above(panels[0])
    _finish(figure, panels, data, axis)
    return figure


def bifurcation(data: xr.Dataset) -> Figure:
    """Draw the tip displacements at the end of the last periods of each point over one axis."""
    (axis,) = axes_of(data, 1, "bifurcation")
    require(data, "strobe_displacement", "record.strobes = 40")
    figure, panels = _panels(data, 3.75)
    for i, (panel, name) in enumerate(zip(panels, data["lamina"].to_numpy(), strict=True)):
        _shade_two_motions(panel, data, axis)
        for label, part, _ in _directions(data):
            colour, size = POINT_STYLE.get(label, (BLUE, 1.6))
            strobes = part["strobe_displacement"].isel(lamina=i)
            q = 1e3 * strobes.transpose(axis.name, "strobe").to_numpy()
            is_grey = is_unsettled(part).to_numpy()
            for own, shade in ((~is_grey, colour), (is_grey, UNSETTLED_COLOUR)):
                panel.plot(
                    np.repeat(axis.shown[own], q.shape[1]), q[own].ravel(), "o", color=shade,
                    markersize=size, alpha=0.5, markeredgewidth=0.0,
                )  # fmt: skip
            panel.plot([], [], "o", color=colour, markersize=2.0 * size, label=label)
        _mark_points(panel, data, axis)
        panel.set_title(str(name), loc="left")
        panel.set(ylabel=f"tip displacement  $q_{{{i + 1}}}$ at t = nT [mm]")
    legend_above(panels[0])
    _finish(figure, panels, data, axis)
    return figure


def lyapunov(data: xr.Dataset) -> Figure:
    """Draw the largest Lyapunov exponent over one axis."""
    (axis,) = axes_of(data, 1, "lyapunov")
    require(data, "lyapunov_exponent", "record.lyapunov = 200")
    figure = Figure(figsize=(WIDTH, 4.2), layout="constrained")
    panel = figure.subplots()
    panel.axhline(0.0, color=BLACK, linewidth=0.8)
    for label, part, (colour, marker, line) in _directions(data):
        errors = BARS * part["lyapunov_error"].to_numpy() if "lyapunov_error" in part else None
        panel.errorbar(
            axis.shown, part["lyapunov_exponent"].to_numpy(), yerr=errors, fmt=line, color=colour,
            marker=marker, markersize=3.0, linewidth=1.0, elinewidth=0.8, capsize=2.0, label=label,
        )  # fmt: skip
    _mark_points(panel, data, axis)
    panel.set(ylabel=f"largest Lyapunov exponent [1/s]\nbars: ±{BARS:g} errors")
    legend_above(panel)
    _finish(figure, [panel], data, axis)
    return figure


def _panels(data: xr.Dataset, height: float) -> tuple[Figure, npt.NDArray[Any]]:
    """Return a figure with one panel of a height [in] for each lamina."""
    n = data.sizes["lamina"]
    figure = Figure(figsize=(WIDTH, height * n), layout="constrained")
    return figure, figure.subplots(n, 1, sharex=True, squeeze=False)[:, 0]


def _directions(
    data: xr.Dataset,
) -> list[tuple[str, xr.Dataset, tuple[str, str, str]]]:
    """Return label, points and style of each direction."""
    if "direction" not in data.dims:
        order = sweep_keys(data).get("order", "independent")
        label = "each point from the start" if order == "independent" else f"going {order}"
        return [(label, data, (BLUE, "o", "-"))]
    return [(name, data.sel(direction=name), style) for name, style in DIRECTION_STYLE.items()]


def _shade_two_motions(panel: Axes, data: xr.Dataset, axis: DiagramAxis) -> None:
    """Shade where settled amplitudes of both directions differ by more than `SAME_ATTRACTOR`."""
    if "direction" not in data.dims or "tip_amplitude" not in data:
        return
    a = data["tip_amplitude"].transpose("direction", axis.name, "lamina").to_numpy()
    differs = (np.abs(a[0] - a[1]) > SAME_ATTRACTOR * np.maximum(a[0], a[1])).any(axis=-1)
    differs &= ~is_unsettled(data).any("direction").to_numpy()  # one may still become the other
    edges = np.flatnonzero(np.diff(differs.astype(np.int8), prepend=0, append=0))
    x = axis.shown
    middles = np.concatenate([x[:1], 0.5 * (x[1:] + x[:-1]), x[-1:]])
    for k, (start, stop) in enumerate(edges.reshape(-1, 2)):
        label = "depends on the direction" if k == 0 else None
        panel.axvspan(
            middles[start], middles[stop], color=GAP_COLOUR, linewidth=0.0, zorder=0, label=label
        )


def _top(panel: Axes, values: FloatArray) -> None:
    """Set the vertical range of a panel by the computed amplitudes alone."""
    if np.isfinite(values).any():
        panel.set_ylim(0.0, HEADROOM * float(np.nanmax(values)) or None)


def _linear(panel: Axes, data: xr.Dataset, axis: DiagramAxis, i: int) -> None:
    """Draw the amplitude without contact: of the exact cantilever, or of the bonded stack."""
    case = Case.from_toml(data.attrs["case"])
    f = np.linspace(axis.values.min(), axis.values.max(), LINEAR_POINTS)
    if not case.is_apart:
        f = np.linspace(f[0], f[-1], STACK_POINTS)
    amplitude = 1e3 * linear_amplitudes(case, f)[i]
    panel.plot(f, amplitude, ":", color=BASE_COLOUR, linewidth=1.3, label="linear, no contact")


def _mark_points(panel: Axes, data: xr.Dataset, axis: DiagramAxis) -> None:
    """Mark the points that have not settled or have no result at the bottom of the panel."""
    for is_marked, marker, colour, label in (
        (is_unsettled(data), "s", UNSETTLED_COLOUR, KINDS[UNSETTLED]),
        (data["outcome"] != "completed", "x", BLACK, "not completed"),
    ):
        others = [dim for dim in is_marked.dims if dim != axis.name]
        x = axis.shown[is_marked.any(others).to_numpy()]
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
    label_x(panels, axis.label)
    figure.suptitle(heading(data))


KIND_COLOURS = (SKY, ORANGE, GREEN, "#bbbbbb", BLACK, "#ffffff", "#cfe8f7", "#e0e0e0")
"""Colours of the kinds of motion, in the order of `KINDS`."""
ATTRACTOR_COLOURS = (BLUE, ORANGE, GREEN, SKY, VERMILLION, YELLOW, PURPLE)
"""Colours of the attractors, the most frequent first; all further attractors share a grey."""
NOT_SETTLED, HATCH = at.KINDS[at.UNSETTLED], "////"
OTHERS, ISOLATED, NONE = "#999999", "#dddddd", "#ffffff"
MOST_LABELS = 900
"""Largest number of cells up to which the periodicity is written into them."""
DIVERGING = "PuOr_r"
"""Colour map from purple to orange, readable for the colour-blind; white is zero."""


def plane(data: xr.Dataset) -> Figure:
    """Draw the kind of motion at each point over two axes."""
    x, y = axes_of(data, 2, "plane")
    require(data, "periodicity", "record.summary = true")
    require(data, "strobe_displacement", f"record.strobes = {2 * at.FEWEST_STROBES}")
    try:
        kinds = at.kinds_of_motion(
            _values(data, "outcome", x, y),
            _values(data, "periodicity", x, y),
            _values(data, "strobe_displacement", x, y),
            _values(data, "is_decided", x, y) != 0.0 if "is_decided" in data else None,
            _values(data, "settled", x, y) != 0.0 if "settled" in data else None,
        )
    except ValueError as error:
        raise CaseError(f"diagram plane: {error}") from None
    figure = Figure(figsize=(WIDTH, 6.6), layout="constrained")
    panel = figure.subplots()
    panel.grid(False)
    _cells(panel, x, y, kinds, KIND_COLOURS)
    if kinds.size <= MOST_LABELS:
        periods = np.where(kinds == at.HIGHER, _values(data, "periodicity", x, y), np.nan)
        _write_periods(panel, x, y, periods)
    present = [k for k in range(len(at.KINDS)) if (kinds == k).any()]
    shares = [f"{at.KINDS[k]} ({_percent(float((kinds == k).mean()))})" for k in present]
    _hatch_unsettled(panel, x, y, data)
    _legend(panel, [KIND_COLOURS[k] for k in present], shares)
    _finish_map(figure, panel, (x, y), data)
    figure.supxlabel(_thresholds(), fontsize=8.0, color="#555555")
    return figure


def _thresholds() -> str:
    """Return the definitions of the kinds of motion in words."""
    return (
        f"period P: strobes P ≤ {LARGEST_PERIODICITY} periods apart differ by less than "
        f"{100 * PERIODIC_SCATTER:g} % of the half peak-to-peak amplitude (rms); "
        f"quasi-periodic: {100 * at.LINE_SHARE:g} % of the strobes' power\nin "
        f"{at.LINES} spectral lines; irregular: none of these; undecided: the class changes with "
        f"the {100 * PERIODIC_SCATTER:g} % times or over {PERIODIC_MARGIN:g}; numbers: P of higher "
        "order;\nhatched: the transient is not over"
    )


def basins(data: xr.Dataset) -> Figure:
    """Draw the attractor that is reached from each initial condition (basins of attraction)."""
    x, y = axes_of(data, 2, "basins")
    require(data, "periodicity", "record.summary = true")
    require(data, "strobe_displacement", "record.strobes = 40")
    names = ("periodicity", "tip_min", "tip_max", "strobe_displacement")
    moving = is_unsettled(data)
    kept_points = data[list(names)].where(~moving)
    found = at.attractors(*(_values(kept_points, name, x, y) for name in names))
    isolated = at.is_isolated(found.number)
    kept = np.setdiff1d(found.number[~isolated], [-1])
    number = np.where(isolated, kept.size, np.searchsorted(kept, found.number))
    number[found.number < 0] = kept.size + 1
    colours = [ATTRACTOR_COLOURS[k] if k < len(ATTRACTOR_COLOURS) else OTHERS for k in kept]
    figure = Figure(figsize=(WIDTH, 6.6), layout="constrained")
    panel = figure.subplots()
    panel.grid(False)
    _cells(panel, x, y, number, (*colours, ISOLATED, NONE))
    shown = min(kept.size, len(ATTRACTOR_COLOURS))
    labels = [_attractor(found, k) for k in kept[:shown].tolist()]
    colours = colours[:shown]
    for colour, text, share in (
        (OTHERS, f"{kept.size - shown} others", found.share[kept[shown:]].sum()),
        (ISOLATED, "isolated cells: not decided", isolated.mean()),
        (NONE, "not completed", (found.number < 0).mean() - float(moving.mean())),
        (NONE, NOT_SETTLED, _hatch_unsettled(panel, x, y, data)),
    ):
        if share > 0.0:
            labels.append(f"{text} ({_percent(float(share))})")
            colours.append(colour)
    _legend(panel, colours, labels)
    _finish_map(figure, panel, (x, y), data)
    laminae = " / ".join(str(name) for name in data["lamina"].to_numpy())
    figure.supxlabel(
        f"attractors by period and half peak-to-peak tip displacement ({laminae}); one attractor: "
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


def lyapunov_map(data: xr.Dataset) -> Figure:
    """Draw the largest Lyapunov exponent over two axes."""
    x, y = axes_of(data, 2, "lyapunov")
    require(data, "lyapunov_exponent", "record.lyapunov = 200")
    values = _values(data, "lyapunov_exponent", x, y)
    figure = Figure(figsize=(WIDTH, 6.6), layout="constrained")
    panel = figure.subplots()
    panel.grid(False)
    bound = float(np.nanmax(np.abs(values))) if np.isfinite(values).any() else 1.0
    mesh = panel.pcolormesh(
        x.shown, y.shown, values.T, cmap=DIVERGING, shading="nearest",
        norm=TwoSlopeNorm(0.0, -bound or -1.0, bound or 1.0),
    )  # fmt: skip
    figure.colorbar(mesh, ax=panel, label="largest Lyapunov exponent [1/s]")
    share = _hatch_unsettled(panel, x, y, data)
    if share > 0.0:
        _legend(panel, [NONE], [f"{NOT_SETTLED} ({_percent(share)})"])
    _finish_map(figure, panel, (x, y), data)
    return figure


def _percent(share: float) -> str:
    """Return a share in per cent as text; shares below 1 % become "< 1 %", not "0 %"."""
    return f"{100.0 * share:.0f} %" if share >= 0.01 else "< 1 %"


def _values(data: xr.Dataset, name: str, x: DiagramAxis, y: DiagramAxis) -> npt.NDArray[Any]:
    """Return the values of a variable, with the two axes as first dimensions."""
    if "direction" in data.dims:
        raise CaseError(
            'diagram: a map shows one direction; select it: data.sel(direction="up"), or compute '
            'with order = "independent"'
        )
    return data[name].transpose(x.name, y.name, ...).to_numpy()


def _cells(
    panel: Axes, x: DiagramAxis, y: DiagramAxis, numbers: IntArray,
    colours: tuple[str, ...],
) -> None:  # fmt: skip
    """Colour the cell of each point by its number."""
    panel.pcolormesh(
        x.shown, y.shown, numbers.T, cmap=ListedColormap(list(colours)), shading="nearest",
        vmin=-0.5, vmax=len(colours) - 0.5, edgecolors="white", linewidth=0.3,
    )  # fmt: skip


def _hatch_unsettled(panel: Axes, x: DiagramAxis, y: DiagramAxis, data: xr.Dataset) -> float:
    """Hatch the cells of points that have not settled; return their share."""
    mask = is_unsettled(data).transpose(x.name, y.name).to_numpy()
    if mask.any():
        panel.pcolor(
            x.shown, y.shown, np.where(mask.T, 0.0, np.nan), shading="nearest", hatch=HATCH,
            alpha=0.0,
        )  # fmt: skip
    return float(mask.mean())


def _write_periods(panel: Axes, x: DiagramAxis, y: DiagramAxis, periodicity: FloatArray) -> None:
    """Write the periodicity of motions of higher order into their cells."""
    for i, j in zip(*np.nonzero(periodicity > 1), strict=True):
        panel.text(
            x.shown[i], y.shown[j], f"{periodicity[i, j]:.0f}", fontsize=7.0, ha="center",
            va="center", color=BLACK,
        )  # fmt: skip


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


def _finish_map(
    figure: Figure, panel: Axes, axes: tuple[DiagramAxis, DiagramAxis], data: xr.Dataset
) -> None:
    """Label the axes and write the title of the figure."""
    x, y = axes
    panel.set(xlabel=x.label, ylabel=y.label)
    if x.is_logarithmic:
        panel.set_xscale("log")
    if y.is_logarithmic:
        panel.set_yscale("log")
    if x.words:
        panel.set_xticks(x.shown, x.words)
    if y.words:
        panel.set_yticks(y.shown, y.words)
    figure.suptitle(heading(data))
