"""Panels of the paper's figures as rows of data, and the grids of panels that figures share."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy.typing as npt

from delam_fem.api import diagnostics, style
from delam_fem.paper.runs import FREQUENCIES, PaperMethod

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from delam_fem.api import FloatArray, Result

Line = tuple[npt.ArrayLike, npt.ArrayLike, str, dict[str, Any]]
"""A line of a panel; see `line`."""


def line(x: npt.ArrayLike, y: npt.ArrayLike, line_style: str = "-", **look: Any) -> Line:
    """Return points, line style and look of a line for `show`, as `Axes.plot` takes them."""
    return x, y, line_style, look


def show(panel: Axes, *lines: Line, legend: str = "", **look: Any) -> None:
    """Draw lines into a panel, label it, and put its legend to its place.

    Args:
        panel: where to draw.
        lines: made by `line`, in the order of drawing.
        legend: "above", a place inside as `Axes.legend` names it, or "" for none.
        look: properties of the panel as `Axes.set` takes them.
    """
    for x, y, line_style, options in lines:
        panel.plot(x, y, line_style, **options)
    panel.set(**look)
    if legend == "above":
        style.legend_above(panel)
    elif legend:
        panel.legend(loc=legend)


def portrait(result: Result) -> FloatArray:
    """Return displacement [m] and velocity [m/s] of both tips, shape (2 laminae, 2, n)."""
    return diagnostics.phase_portrait(result.history, result.case, style.PORTRAIT_PERIODS)


def four_by_two(
    height: float,
    results: Mapping[tuple[float, PaperMethod], Result],
    draw: Callable[[Axes, Result], None],
    x: str,
    y: str,
    **shared: Any,
) -> tuple[Figure, Any]:
    """Draw the four motions in rows, and both methods in columns.

    Args:
        height: height of the figure [in].
        results: motions by frequency and method.
        draw: function that draws one motion into a panel.
        x: label of the horizontal axes.
        y: label of the vertical axes.
        shared: which panels share their axes.

    Returns:
        The figure and its panels, shape (4, 2).
    """
    figure = style.canvas(height)
    panels = figure.subplots(4, 2, **shared)
    for (frequency, method), result in results.items():
        row = FREQUENCIES.index(frequency)
        panel = panels[row, int(method == "3.2")]
        draw(panel, result)
        panel.set_title(f"[{'abcd'[row]}] {frequency:.2f} Hz, method {method}")
        panels[row, 0].set_ylabel(y)
    style.label_x(panels.flat, x)
    return figure, panels


def two_portraits(
    results: Sequence[Result], titles: Sequence[str], n_below: int = 0
) -> tuple[Figure, list[Axes]]:
    """Draw the portraits of the thick and the thin tip in two columns, with one row per motion.

    Args:
        results: at least one motion.
        titles: titles of the rows.
        n_below: number of rows of axes to leave below the portraits.

    Returns:
        The figure, and the axes of the rows below.
    """
    rows = len(results)
    figure = style.canvas(0.6 + 3.9 * rows + 2.8 * n_below)
    grid = figure.add_gridspec(rows + n_below, 2, height_ratios=[3.9] * rows + [2.8] * n_below)
    panels = grid[:rows, :].subgridspec(rows, 2).subplots(squeeze=False, sharex="col", sharey=True)
    for row, result, title in zip(panels, results, titles, strict=True):
        for i, (q, v) in enumerate(portrait(result)):
            show(
                row[i],
                line(1e3 * q, v, color=style.LAMINA_COLOURS[i], linewidth=0.6),
                title=f"{result.case.lamina[i].name}, {title}",
            )
        row[0].set_ylabel("velocity of the tip [m/s]")
    for i, column in enumerate(panels.T):
        style.label_x(column, f"displacement of the tip $q_{i + 1}$ [mm]")
    return figure, [figure.add_subplot(grid[rows, i]) for i in range(2 * n_below)]
