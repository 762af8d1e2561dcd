"""Draw diagrams of a sweep over two axes: kinds of motion, basins, Lyapunov exponent."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap, TwoSlopeNorm
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from delam_fem.numerics import attractors as at
from delam_fem.numerics.arrays import FloatArray, IntArray
from delam_fem.results.diagnostics import LARGEST_PERIODICITY, PERIODIC_MARGIN, PERIODIC_SCATTER
from delam_fem.results.figures.style import (
    BLACK,
    BLUE,
    GREEN,
    ORANGE,
    PURPLE,
    SKY,
    VERMILLION,
    WIDTH,
    YELLOW,
)
from delam_fem.studies.diagrams.lines import DiagramAxis, axes_of, heading, is_unsettled, require
from delam_fem.system.errors import CaseError

if TYPE_CHECKING:
    import xarray as xr


KIND_COLOURS = (SKY, ORANGE, GREEN, "#bbbbbb", BLACK, "#ffffff", "#cfe8f7", "#e0e0e0")
"""Colours of the kinds of motion, in the order of `KINDS`."""
ATTRACTOR_COLOURS = (BLUE, ORANGE, GREEN, SKY, VERMILLION, YELLOW, PURPLE)
"""Colours of the attractors, the most frequent first; all further attractors share a grey."""
UNSETTLED, HATCH = at.KINDS[at.UNSETTLED], "////"
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
    _finish(figure, panel, (x, y), data)
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
        (NONE, UNSETTLED, _hatch_unsettled(panel, x, y, data)),
    ):
        if share > 0.0:
            labels.append(f"{text} ({_percent(float(share))})")
            colours.append(colour)
    _legend(panel, colours, labels)
    _finish(figure, panel, (x, y), data)
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
        _legend(panel, [NONE], [f"{UNSETTLED} ({_percent(share)})"])
    _finish(figure, panel, (x, y), data)
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
            hatch=HATCH if label.startswith(UNSETTLED) else None,
        )
        for colour, label in zip(colours, labels, strict=True)
    ]
    panel.legend(
        handles=handles, loc="lower left", bbox_to_anchor=(0.0, 1.0),
        ncols=min(3, max(1, len(handles))), frameon=False,
    )  # fmt: skip


def _finish(
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
