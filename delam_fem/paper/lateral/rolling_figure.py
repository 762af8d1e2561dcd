"""Draw figure 6: the set-up of the second experiment and the results of the first (paper 2.3)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from delam_fem.model.beams import ground
from delam_fem.paper.lateral.ground_run import LIFT
from delam_fem.paper.lateral.rolling import Rolling
from delam_fem.paper.lateral.studies import RollingStudy
from delam_fem.paper.lateral.tip_block import TipBlock
from delam_fem.paper.lateral.tip_figure import GAUGE_COLOURS
from delam_fem.results.figures.style import (
    BASE_COLOUR,
    BLACK,
    BLUE,
    ORANGE,
    SKY,
    VERMILLION,
    WIDTH,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

LAW_COLOURS = {
    "newton@moreau-jean": BLUE,
    "newton-penalty@newmark": ORANGE,
}
MARKERS = {20: "s", 40: "^", 80: "o"}
"""Markers of the meshes of a ladder, by number of elements."""
SHOWN_LANDING = (-0.02, 0.06)
SHOWN_ENERGY = (-0.05, 0.25)
"""Parts of the period around the first hit that are drawn."""


def figure06(study: RollingStudy, block: TipBlock) -> Figure:
    """Draw the set-up of the second experiment and the results of the first.

    Args:
        study: results of a strip that falls on the ground on which it lies.
        block: second experiment; it gives the strip and the positions of the gauges.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(WIDTH, 12.6), layout="constrained")
    rows = figure.subfigures(4, 1, height_ratios=(1.0, 1.35, 1.35, 1.35))
    _draw_setup(rows[0].subplots(), block)
    main = study.by_law["newton@moreau-jean"]
    for axes, run in zip(rows[1].subplots(1, 2), (main, study.stiff), strict=True):
        _draw_contact_line(axes, run)
    left, right = rows[2].subplots(1, 2)
    _draw_energy(left, main)
    _draw_tips(right, study)
    left, right = rows[3].subplots(1, 2)
    _draw_ladder(left, study)
    _draw_heights(right, study)
    return figure


def _draw_setup(axes: Axes, block: TipBlock) -> None:
    """Draw the strip with its sensors to scale, once lifted and once free of stress."""
    from matplotlib.patches import Rectangle

    strip, n = block.lamina, 100
    x = 1e3 * np.concatenate([[0.0], ground.nodes(strip, n)])
    length, t = 1e3 * strip.length, 1e3 * strip.thickness
    up = 1e3 * np.concatenate([[0.0], ground.lifted(strip, n, LIFT, "tip force")[::2]])
    axes.fill_between(x, 0.0, t, color=BASE_COLOUR, linewidth=0.0)
    axes.plot(x, up + 0.5 * t, color=BLACK, linestyle="--", label="lifted, before the release")
    axes.add_patch(Rectangle((-22.0, -16.0), 22.0, 35.0, facecolor="#c8c8c8", hatch="///"))
    axes.add_patch(Rectangle((length - 12.0, -16.0), 14.0, 16.0, facecolor=ORANGE))
    axes.annotate(
        "[3] block and force transducer",
        (length - 5.0, -10.0),
        (length - 40.0, -13.0),
        ha="right",
        va="center",
        arrowprops={"arrowstyle": "-"},
    )
    for number, (place, colour) in enumerate(zip(block.gauges, GAUGE_COLOURS, strict=True), 1):
        at = 1e3 * float(place)
        axes.plot([at - 4.0, at + 4.0], [t + 1.5] * 2, color=colour, linewidth=4.0)
        axes.text(at, t + 6.0, f"[{number}]", color=colour, ha="center")
    axes.annotate(
        "", (length + 6.0, t), (length + 6.0, t + 1e3 * LIFT), arrowprops={"arrowstyle": "<->"}
    )
    axes.text(length + 9.0, 0.5e3 * LIFT, f"{1e3 * LIFT:g} mm", va="center")
    axes.set(xlim=(-30.0, length + 45.0), ylim=(-20.0, 62.0), aspect="equal")
    axes.set(xlabel="place  x  [mm]", ylabel="height  [mm]")
    axes.legend(loc="upper left", bbox_to_anchor=(0.08, 1.0), frameon=False)
    frequency = float(strip.angular_frequencies(1)[0]) / (2.0 * np.pi)
    section = f"{1e3 * strip.width:g} mm × {t:g} mm × {length:.0f} mm"
    axes.set_title(f"steel strip {section}, lowest frequency {frequency:.0f} Hz", loc="left")


def _draw_contact_line(axes: Axes, run: Rolling) -> None:
    """Draw the hits of the nodes over time and place, with the first hit of each node on top."""
    pushes, x = run.impulses, 1e3 * run.x
    shown = run.landing[0] + run.period * np.array(SHOWN_LANDING)
    is_shown = (pushes.time > shown[0]) & (pushes.time < shown[1])
    time, pair = pushes.time[is_shown], pushes.pair[is_shown]
    apart = np.ptp(shown) / 400.0  # more dots than that cannot be distinguished
    _, seen = np.unique(np.stack([np.floor(time / apart), pair]), axis=1, return_index=True)
    line = 1e3 * run.contact_line
    axes.plot(
        1e3 * time[seen], x[pair[seen]], ".", color=SKY, markersize=2.5, label="node is pushed"
    )
    axes.plot(line, x, ".", color=BLACK, markersize=4.5, label="for the first time")
    axes.set(xlim=1e3 * shown, ylim=(0.0, 1.03e3 * run.lamina.length))
    axes.set(xlabel="time after the release  t  [ms]", ylabel="place  x  [mm]")
    direction, speed = run.front()
    words = "clamp → tip" if direction > 0.0 else "tip → clamp"
    axes.set_title(f"{_strip(run)}\n{words}, {speed:.0f} m/s", loc="left")
    axes.legend(loc="upper left" if direction > 0.0 else "center right")


def _strip(run: Rolling) -> str:
    """Return thickness, length, sag and lifting height of a strip in words."""
    size = f"{1e3 * run.lamina.thickness:g} mm × {1e3 * run.lamina.length:.0f} mm"
    sag = 1e3 * ground.sag(run.lamina, run.gravity)
    return f"{size}, sag {sag:.0f} mm, lifted {1e3 * run.tip[0]:.0f} mm"


def _draw_energy(axes: Axes, run: Rolling) -> None:
    """Draw the stored and the lost energy over time."""
    energy = run.energy
    parts = np.array([energy.stored, energy.damped, energy.impact]) / energy.stored[0]
    names = ("in the strip", "lost to damping", "lost at impacts")
    axes.stackplot(1e3 * energy.time, parts, labels=names, colors=(BASE_COLOUR, SKY, VERMILLION))
    shown = run.landing[0] + run.period * np.array(SHOWN_ENERGY)
    axes.set(xlim=1e3 * shown, ylim=(0.0, 1.0))
    axes.set(xlabel="time after the release  [ms]", ylabel="share of the energy  [–]")
    axes.set_title(f"thin strip, {run.law.method}, {run.x.size} elements", loc="left")
    axes.legend(loc="lower right")


def _draw_ladder(axes: Axes, study: RollingStudy) -> None:
    """Draw the total loss and the loss at impacts over the time step, for the damped strip."""
    from matplotlib.ticker import NullLocator

    damping_ratio = max(rung.damping_ratio for rung in study.ladder)
    for law, colour in LAW_COLOURS.items():
        for n, marker in MARKERS.items():
            rungs = study.rungs(law, damping_ratio, n)
            steps = [rung.steps_per_period for rung in rungs]
            drawn = axes.plot(steps, [rung.impacts for rung in rungs], label=_label(law, n))
            drawn += axes.plot(steps, [1.0 - rung.left for rung in rungs], linestyle="--")
            for line in drawn:
                line.set(color=colour, marker=marker, markersize=4.5, linewidth=0.9)
    ticks = sorted({rung.steps_per_period for rung in study.ladder})
    axes.set(xscale="log", ylim=(0.0, 1.05), xlabel="time steps per lowest period  [–]")
    axes.set_xticks(ticks, [f"{n}" for n in ticks])
    axes.xaxis.set_minor_locator(NullLocator())
    axes.set_ylabel("share lost in half a period  [–]")
    meshes = ", ".join(f"{n} {_SIGNS[marker]}" for n, marker in MARKERS.items())
    axes.set_title(f"dashed: all, solid: at impacts\nelements: {meshes}", loc="left")
    axes.legend(loc="lower left")


_SIGNS = {"s": "□", "^": "△", "o": "○"}


def _label(law: str, n: int) -> str:
    """Return a law's name for the one line in the legend, and no label for its other lines."""
    return law if n == max(MARKERS) else "_nolegend_"


def _draw_tips(axes: Axes, study: RollingStudy) -> None:
    """Draw the height of the tip over time for each law."""
    for name, run in study.by_law.items():
        axes.plot(1e3 * run.time, 1e3 * run.tip, color=LAW_COLOURS[name], label=name)
    axes.set(xlabel="time after the release  [ms]", ylabel="height of the tip  [mm]")
    axes.set(ylim=(-1.0, 1.02e3 * LIFT))
    axes.margins(x=0.0)
    axes.legend(loc="upper right")
    axes.set_title("tip of the thin strip", loc="left")


def _draw_heights(axes: Axes, study: RollingStudy) -> None:
    """Draw the direction of the contact line over the height of the tip, in sags of the strip."""
    runs = [*study.by_height.values(), study.stiff]
    ratio = [run.tip[0] / ground.sag(run.lamina, run.gravity) for run in runs]
    direction = [run.front()[0] for run in runs]
    axes.plot(ratio[:-1], direction[:-1], "o-", color=BLUE, label="thin strip")
    axes.plot(ratio[-1:], direction[-1:], "s", color=VERMILLION, label="stiff strip")
    axes.set(xscale="log", ylim=(-1.15, 1.15), xlabel="height of the tip / sag  [–]")
    axes.set_ylabel("rank correlation, place and time  [–]")
    axes.set_title("1: clamp → tip\n−1: tip → clamp", loc="left")
    axes.legend(loc="center left")
