"""How all figures look: colours, sizes, axes of time.

Nothing here changes the global state of matplotlib, except within the context `styled`. Importing
this module does not import matplotlib, so that code which only measures does not need it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from delam_fem.case.definition import Case
from delam_fem.numerics.types import FloatArray
from delam_fem.system.files import atomic

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure

BLACK, ORANGE, SKY, GREEN, YELLOW, BLUE, VERMILLION, PURPLE = (
    "#000000", "#E69F00", "#56B4E9", "#009E73", "#F0E442", "#0072B2", "#D55E00", "#CC79A7",
)  # fmt: skip
"""Colours that colour-blind readers can distinguish (Okabe and Ito)."""

LAMINA_COLOURS = (BLUE, VERMILLION, GREEN, ORANGE, PURPLE, SKY)
"""Colours of the laminae from bottom to top in every figure; further laminae begin again."""
KIND_COLOURS = (
    SKY,
    ORANGE,
    GREEN,
    "#bbbbbb",
    BLACK,
    "#ffffff",
    "#cfe8f7",
    "#e0e0e0",
)
"""Colours of the kinds of motion, in the order of `settling.KINDS`."""
GAP_COLOUR = "#e9e9e9"
BASE_COLOUR = "#8a8a8a"

DPI = 150
WIDTH = 9.0
"""Width of a figure [in]; the fonts are readable when a page shows it about 900 pixels wide."""
SECOND_AXIS = 36.0
"""Distance of a second axis below the first [pt]."""
HISTORY_PERIODS = 4
"""Periods that time histories show, as in the paper's Fig. 12."""
PORTRAIT_PERIODS = 10
"""Periods that phase portraits show, as in the paper's Fig. 12."""

_UNITS = {"m": ("mm", 1e3), "m/s2": ("m/s²", 1.0), "1": ("µm/m", 1e6)}
"""Unit that is shown and factor, where it is not that of the dataset."""
_SUBSCRIPTS = str.maketrans("0123456789", "₀₁₂₃₄₅₆₇₈₉")
_SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")

_STYLE: dict[str, object] = {
    "font.size": 10.5,
    "axes.titlesize": 10.5,
    "axes.labelsize": 10.5,
    "figure.titlesize": 10.5,
    "legend.fontsize": 9.0,
    "legend.framealpha": 0.9,
    "lines.linewidth": 1.3,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#dddddd",
    "grid.linewidth": 0.6,
    "axes.axisbelow": True,
    "savefig.dpi": DPI,
    "figure.dpi": DPI,
    "figure.facecolor": "white",
}


def lamina_colours(n: int) -> tuple[str, ...]:
    """Return the colours of n laminae from bottom to top."""
    return tuple(LAMINA_COLOURS[i % len(LAMINA_COLOURS)] for i in range(n))


def symbol(letter: str, index: int) -> str:
    """Return a letter with a number as subscript: q₁ for the index 0.

    Plain letters are drawn faster than mathematical text, which is parsed for each drawing.
    """
    return letter + str(index + 1).translate(_SUBSCRIPTS)


def powers_of_ten(axis: Axis) -> None:
    """Write the numbers of a logarithmic axis as 10⁻³."""
    axis.set_major_formatter(
        lambda value, _: "10" + str(round(math.log10(value))).translate(_SUPERSCRIPTS)
    )


def steps(
    axes: Axes, values: FloatArray, edges: FloatArray, baseline: FloatArray, **look: Any
) -> None:
    """Fill the steps between two lines as `Axes.stairs` does, but without its loop in Python.

    Args:
        axes: where to draw.
        values: one line, shape (k,).
        edges: ends of the steps, shape (k+1,).
        baseline: the other line, shape (k,).
        look: properties of the patch.
    """
    from matplotlib.patches import StepPatch

    untyped_baseline: Any = baseline  # matplotlib's types know numbers alone
    patch: Any = StepPatch(values, edges, baseline=untyped_baseline, fill=True, **look)
    lowest = np.fmin.reduce(np.fmin(values, baseline))
    highest = np.fmax.reduce(np.fmax(values, baseline))
    patch.sticky_edges.y.append(baseline.min())
    axes.add_artist(patch)
    axes.update_datalim([(edges[0], lowest), (edges[-1], highest)])
    axes.autoscale_view()


def label_x(panels: Iterable[Axes], text: str) -> None:
    """Write the label and the numbers of the x axis below each panel, shared or not."""
    for panel in panels:
        panel.set_xlabel(text)
        panel.tick_params(labelbottom=True)


def seconds_below(axes: Axes, case: Case) -> None:
    """Add an axis of the time in seconds below an axis of t/T; there is none without a period."""
    if case.is_periodic:
        _second_axis(axes, case.period, "time  t  [s]")


def hertz_below(axes: Axes, case: Case) -> None:
    """Add an axis of frequencies in hertz below one of f/f₀; there is none without a period."""
    if case.is_harmonic:
        _second_axis(axes, 1.0 / case.period, "frequency [Hz]")


def _second_axis(axes: Axes, factor: float, label: str) -> None:
    """Add an axis below that of x; its numbers are those of x times a factor."""
    second = axes.secondary_xaxis(
        "bottom", functions=(partial(np.multiply, factor), partial(np.multiply, 1.0 / factor))
    )
    second.spines["bottom"].set_position(("outward", SECOND_AXIS))
    second.set_xlabel(label)


def canvas(height: float) -> Figure:
    """Return an empty figure of the width that all figures have."""
    from delam_fem.results.figures.picture import Picture

    return Picture(figsize=(WIDTH, height), layout="constrained")


def edges(places: FloatArray, *, is_logarithmic: bool = False) -> FloatArray:
    """Return the edges of the cells of a map, in the middle between places, shape (n + 1,).

    A place alone has a cell, too. On a logarithmic axis the middles are geometric: others would lie
    below 0 where places are far apart.

    Args:
        places: places of the cells, in order, shape (n,).
        is_logarithmic: whether the axis is.
    """
    positions = np.log(places) if is_logarithmic else places
    half = np.diff(positions) / 2.0 if positions.size > 1 else 0.01 * np.abs(positions) + 1e-6
    borders = np.hstack(
        [positions[0] - half[0], (positions[1:] + positions[:-1]) / 2.0, positions[-1] + half[-1]]
    )
    return np.asarray(np.exp(borders) if is_logarithmic else borders)


def stacked(n: int, height: float, **options: Any) -> tuple[Figure, Any]:
    """Return a figure with n panels, one below the other, and the panels, shape (n,)."""
    figure = canvas(height)
    return figure, figure.subplots(n, 1, squeeze=False, **options)[:, 0]


def side_by_side(
    n: int, height: float, columns: int = 2, *, above: float = 0.0, **options: Any
) -> tuple[Figure, Any]:
    """Return a figure with n panels in rows of a height [in], and the panels, shape (n,).

    Args:
        n: number of panels.
        height: height of a row [in].
        columns: panels of a row.
        above: height for a title or legends besides [in].
        options: of `Figure.subplots`.
    """
    columns = min(n, columns)
    rows = math.ceil(n / columns)
    figure = canvas(above + height * rows)
    panels = figure.subplots(rows, columns, squeeze=False, **options).ravel()
    for axes in panels[n:]:
        axes.remove()
    return figure, panels[:n]


def over_time(figure: Figure, panels: Sequence[Axes], case: Case, words: str = "") -> Figure:
    """Name the time below each panel, and the case with some words above all; return the figure."""
    label_x(panels, time_axis(case)[1])
    seconds_below(panels[-1], case)
    figure.suptitle(f"{case.title}{words}")
    return figure


def save_figure(draw: Callable[[], Figure], path: Path) -> Path:
    """Draw a figure in the house style and write it as PNG; return the path.

    Raises:
        OSError: the folder cannot be written or the disk is full.
    """
    with styled(), atomic(path) as temporary:
        write_png(draw(), temporary)
    return path


def write_png(figure: Figure, path: Path) -> None:
    """Write a figure as PNG, whose background hides what lies below it.

    Matplotlib draws a figure twice for its layout, and writes how transparent each pixel is. To
    lay it out first and leave that out takes two thirds of the time, and the file is smaller.
    """
    from PIL import Image

    if (layout := figure.get_layout_engine()) is not None:
        layout.execute(figure)
        figure.set_layout_engine(None)
    figure.savefig(temporary := BytesIO(), format="raw", dpi="figure")
    picture = Image.frombytes("RGBA", figure.canvas.get_width_height(), temporary.getbuffer())
    picture.convert("RGB").save(path, "png", dpi=(DPI, DPI))


def shown_unit(units: str) -> tuple[str, float]:
    """Return the unit in which a signal is shown, and the factor to it."""
    return _UNITS.get(units, (units, 1.0))


def legend_above(axes: Axes) -> None:
    """Put the legend above the axes on the right, where it hides nothing."""
    axes.legend(
        loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=5, frameon=False, borderaxespad=0.1
    )


def legend_outside(
    figure: Figure, axes: Axes, ncols: int, loc: str = "outside upper center"
) -> None:
    """Put the legend of one axes of a figure beside all of its axes."""
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(handles, labels, loc=loc, ncols=ncols, frameon=False)


@contextmanager
def styled() -> Iterator[None]:
    """Apply the style of the package's figures while they are drawn and saved within this context.

    The style that matplotlib had before returns at the end.
    """
    from matplotlib import rc_context

    with rc_context(_STYLE):
        yield


def finite(values: npt.ArrayLike) -> FloatArray:
    """Return values with NaN for what is not finite: the last steps of a diverged run."""
    array = np.asarray(values, dtype=np.float64)
    return np.where(np.isfinite(array), array, np.nan)


def time_axis(case: Case) -> tuple[float, str]:
    """Return the unit of time of a figure's axis [s] and the axis' label.

    Under harmonic excitation it is the period T = 1/f, otherwise the second.
    """
    if case.is_periodic:
        return case.period, "time / period of the excitation  t/T  [–]"
    return 1.0, "time  t  [s]"
