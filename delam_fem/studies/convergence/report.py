"""A ladder as figures and as one page."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from delam_fem.results.figures.style import (
    BASE_COLOUR,
    BLACK,
    BLUE,
    GREEN,
    ORANGE,
    PURPLE,
    SKY,
    VERMILLION,
    WIDTH,
    label_x,
    lamina_colours,
    legend_above,
)
from delam_fem.studies.convergence.analysis import Convergence
from delam_fem.studies.convergence.ladder import FREE, LIMIT, Rung
from delam_fem.studies.convergence.rung import WORK, Statistic

Value = Callable[[Rung], float]

STYLES = (
    (BLUE, "o"), (VERMILLION, "s"), (GREEN, "^"), (ORANGE, "v"), (PURPLE, "D"), (SKY, "P"),
    (BLACK, "X"),
)  # fmt: skip
"""Colours and markers of the methods, in their order."""
PANELS = 3
"""Largest number of panels side by side."""
LONG_RANGE = 100.0
"""Ratio of the ends of an axis beyond which only powers of ten have ticks."""
BARS = 2.0
"""Half the length of error bars, in standard errors of the mean."""
FREE_FLOOR = 1e-13
"""Errors without contact below this value are round-off and are not drawn."""


def pictures(found: Convergence) -> dict[str, Callable[[Convergence], Figure]]:
    """Return the functions that draw what the rungs of a ladder allow, by name.

    A ladder without a limit has no figures of errors against the limit.
    """
    ladder = found.ladder
    makers: dict[str, Callable[[Convergence], Figure]] = {}
    if len(ladder.steps) > 1:
        makers["free_steps"] = free_over_steps
    if len(ladder.meshes_of(FREE)) > 1:
        makers["free_elements"] = free_over_elements
    if ladder.methods and len(ladder.steps) > 1:
        makers["work_over_steps"] = work_over_steps
    if ladder.methods and ladder.has_limit:
        makers["error_over_cost"] = error_over_cost
        if len(ladder.steps) > 1:
            makers["error_over_steps"] = error_over_steps
        if len(ladder.meshes) > 1:
            makers[f"limit_over_{ladder.refines}"] = limit_over_meshes
    return makers


def error_over_steps(found: Convergence) -> Figure:
    """Draw the error against the rigid limit of each mesh over steps per period."""
    figure = _panels(found, lambda rung: rung.steps, lambda rung: 100.0 * found.error(rung))
    _finish(figure, found, "steps per period", f"error of the {found.what} [%]")
    return figure


def error_over_cost(found: Convergence) -> Figure:
    """Draw the error against the rigid limit of each mesh over the processor time of a period."""
    figure = _panels(
        found, lambda rung: 1e6 * found.cost(rung), lambda rung: 100.0 * found.error(rung)
    )
    _finish(figure, found, "processor time per period [µs]", f"error of the {found.what} [%]")
    return figure


def work_over_steps(found: Convergence) -> Figure:
    """Draw the contact work per period over steps per period, with the rigid limit dashed."""
    figure = _panels(
        found, lambda rung: rung.steps, lambda rung: WORK.factor * found.value(rung, WORK.name)
    )
    if found.ladder.has_limit:
        for axes, mesh in zip(figure.axes, found.ladder.meshes, strict=True):
            level = WORK.factor * found.value(found.ladder.limit_of(mesh), WORK.name)
            if level > 0.0:
                axes.axhline(level, color=BASE_COLOUR, linestyle="--", linewidth=1.0)
    _finish(figure, found, "steps per period", "contact work per period [mJ]")
    return figure


def free_over_steps(found: Convergence) -> Figure:
    """Draw the errors without contact over steps per period on the finest mesh."""
    rungs = found.ladder.along_steps(FREE, found.ladder.meshes_of(FREE)[-1])
    return _free(found, rungs, "steps", "steps per period", (-2.0,))


def free_over_elements(found: Convergence) -> Figure:
    """Draw the errors without contact over elements per lamina with the smallest steps."""
    rungs = found.ladder.along_meshes(FREE, found.ladder.steps[-1])
    return _free(found, rungs, "elements", "elements per lamina", (-4.0,))


def limit_over_meshes(found: Convergence) -> Figure:
    """Draw the rigid limit over what meshes refine: extremes of the tips and contact work.

    Without limits the last method with the smallest steps stands for them.
    """
    ladder = found.ladder
    method, steps = (
        (LIMIT, ladder.limit_steps) if ladder.has_limit else (ladder.methods[-1], ladder.steps[-1])
    )
    rungs = ladder.along_meshes(method, steps)
    n = [rung.points for rung in rungs]
    name = {"elements": "elements per lamina", "points": "contact points per lamina"}
    figure = Figure(figsize=(WIDTH, 4.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    colours = lamina_colours(found.n_laminae)
    for k, q in enumerate(found.extrema):
        style = "o-" if q.name.startswith("tip_max") else "s--"
        _with_bars(left, found, rungs, q, fmt=style, color=colours[k // 2], label=f"|{q.symbol}|")
    left.set(ylabel="rigid limit of the mesh [mm]")
    left.set_ylim(0.0, None)
    legend_above(left)
    _with_bars(right, found, rungs, WORK, fmt="o-", color=BLACK)
    right.set_yscale("log")
    right.set_ylabel("contact work per period [mJ]")
    _plain_numbers(right.yaxis)
    for axes in (left, right):
        axes.set_xscale("log")
        _plain(axes, n)
        axes.set_xlabel(name[found.ladder.refines])
    name_of_limit = "newton@moreau-jean" if ladder.has_limit else method.name
    text = f"{name_of_limit}, {steps} steps per period, bars: ±{BARS:g} standard errors"
    figure.suptitle(f"{_title(found)}\n{text}")
    return figure


def _with_bars(
    axes: Axes, found: Convergence, rungs: Sequence[Rung], shown: Statistic, **style: Any
) -> None:
    """Draw the size of a statistic over the points with `BARS` standard errors of its mean."""
    n = [rung.points for rung in rungs]
    values = [abs(shown.factor * found.value(rung, shown.name)) for rung in rungs]
    errors = [BARS * shown.factor * found.standard_error(rung, shown.name) for rung in rungs]
    axes.errorbar(n, values, yerr=errors, capsize=4.0, **style)


def _panels(found: Convergence, abscissa: Value, ordinate: Value) -> Figure:
    """Draw one line for each method, in one panel for each mesh."""
    meshes = found.ladder.meshes
    columns = min(PANELS, len(meshes))
    rows = math.ceil(len(meshes) / columns)
    figure = Figure(figsize=(WIDTH, 1.4 + 3.5 * rows), layout="constrained")
    grid = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False).ravel()
    for axes in grid[len(meshes) :]:
        axes.remove()
    for axes, mesh in zip(grid, meshes, strict=False):
        for method, (colour, marker) in zip(found.ladder.methods, _styles(found), strict=True):
            rungs = found.ladder.along_steps(method, mesh)
            points = np.array([(abscissa(rung), ordinate(rung)) for rung in rungs])
            drawn = points[np.isfinite(points).all(axis=1) & (points > 0.0).all(axis=1)]
            axes.loglog(*drawn.T, marker=marker, color=colour, label=method.name, markersize=5)
        axes.set_title(rungs[0].mesh_text, loc="left")
    return figure


def _finish(figure: Figure, found: Convergence, xlabel: str, ylabel: str) -> None:
    """Add labels, legend and title to a figure of panels."""
    axes = figure.axes
    columns = min(PANELS, len(axes))
    for k, panel in enumerate(axes):
        if k % columns == 0:
            panel.set_ylabel(ylabel)
        _plain_numbers(panel.xaxis)
        _plain_numbers(panel.yaxis)
    label_x(axes, xlabel)
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=4, frameon=False)
    figure.suptitle(_title(found))


def _free(
    found: Convergence, rungs: list[Rung], size: str, label: str, slopes: Sequence[float]
) -> Figure:
    """Draw the errors without contact and lines of a slope."""
    figure = Figure(figsize=(WIDTH, 4.6), layout="constrained")
    axes = figure.subplots()
    n = np.array([getattr(rung, size) for rung in rungs], dtype=float)
    errors = np.abs([found.free_errors(rung) for rung in rungs])
    errors[~(errors > FREE_FLOOR)] = np.nan
    colours = lamina_colours(found.n_laminae)
    for i, lamina in enumerate(found.ladder.case.lamina):
        for j, (name, style) in enumerate((("frequency", "o-"), ("amplitude", "s--"))):
            axes.loglog(
                n,
                errors[:, 2 * i + j],
                style,
                color=colours[i],
                label=f"{name}, {lamina.name}",
            )
    for slope in slopes:
        if np.isfinite(errors[0]).any():
            start = 0.4 * np.nanmin(errors[0])
            axes.loglog(n, start * (n / n[0]) ** slope, ":", color=BLACK, label=f"order {-slope:g}")
    if np.isfinite(errors).any():
        axes.set_ylim(bottom=max(0.3 * float(np.nanmin(errors)), FREE_FLOOR))
    axes.set(xlabel=label, ylabel="relative error")
    _plain(axes, n.astype(int).tolist())
    axes.legend()
    other = "elements" if size == "steps" else "steps"
    fixed = getattr(rungs[0], other)
    figure.suptitle(f"{_title(found)} without contact, {fixed} {other}")
    return figure


def _styles(found: Convergence) -> list[tuple[str, str]]:
    return [STYLES[k % len(STYLES)] for k in range(len(found.ladder.methods))]


def _plain(axes: Axes, ticks: Sequence[int]) -> None:
    """Put the ticks of a logarithmic x axis at the given numbers only."""
    axes.set_xticks(list(ticks), [str(tick) for tick in ticks])
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.minorticks_off()


def _plain_numbers(axis: Axis) -> None:
    """Label the ticks of a logarithmic axis 0.1, 0.2, 0.5, 1, … instead of powers of ten."""
    low, high = axis.get_view_interval()
    subs = (1.0, 2.0, 5.0) if high < LONG_RANGE * low else (1.0,)
    axis.set_major_locator(LogLocator(subs=subs))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())


def _title(found: Convergence) -> str:
    case = found.ladder.case
    damping = f"{case.damping.rayleigh} damping, {case.time.mass} mass"
    return f"{case.name}: {1.0 / case.period:g} Hz, {damping}"
