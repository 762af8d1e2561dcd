"""Draw figures 6 and 7 with the studies that they need (paper 2.3).

`rolling` lets a strip fall on the ground on which it lies. `tip_block` lets its tip fall on a
block. `rolling_study` repeats the first with other strips, heights, laws, meshes and time steps.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from delam_fem.model.beams import closed_form
from delam_fem.paper.lateral.rolling import LIFT, GroundLaw, Rolling, rolling, thin_strip
from delam_fem.paper.lateral.tip import TipBlock, exact_beam, tip_block
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
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["LAWS", "RollingStudy", "StripRung", "TipBlock", "rolling", "rolling_study", "tip_block"]

LAWS = {
    "newton@moreau-jean": GroundLaw("newton", 0.1, scheme="moreau-jean"),
    "newton-penalty@newmark": GroundLaw("newton-penalty", 0.1, stiffness=100.0),
}
"""The laws that are compared, with the paper's e = 0.1, γ and spring stiffness (the thin strip is
as soft as the paper's laminae)."""
HEIGHTS = (0.014, 0.02, 0.03, 0.04, 0.05, 0.07, 0.085, 0.1, 0.15)
"""Tip heights of the thin strip, which sags by 34 mm under its weight [m]."""
DAMPING_RATIOS = (0.0, 0.002)
"""D of modes 1 and 2: no damping, and about the damping of a clamped steel strip."""
LONG = 0.8
"""Duration of the runs that show a rebound, in periods; the rebound ends at about 0.76."""


@dataclass(frozen=True)
class StripRung:
    """The energy shares of one run of a ladder.

    Attributes:
        law: name of the law.
        damping_ratio: D [-].
        elements: n.
        steps_per_period: time steps per lowest period [-].
        impacts, damping, left: shares of the energy after half a period [-].
        outcome: "completed" or "diverged".
    """

    law: str
    damping_ratio: float
    elements: int
    steps_per_period: int
    impacts: float
    damping: float
    left: float
    outcome: str


@dataclass(frozen=True)
class RollingStudy:
    """The first experiment and its variations; a force at the tip lifts every strip.

    Attributes:
        by_law: the thin strip, by the name of the law in `LAWS`.
        stiff: the strip of the second experiment with newton@moreau-jean.
        by_height: the thin strip by height of its tip [m], on a coarser mesh.
        ladder: the thin strip on other meshes and with other time steps.
    """

    by_law: Mapping[str, Rolling]
    stiff: Rolling
    by_height: Mapping[float, Rolling]
    ladder: tuple[StripRung, ...]

    def rungs(self, law: str, damping_ratio: float, elements: int) -> list[StripRung]:
        """Return the completed runs of a law, a damping and a mesh, by increasing steps."""
        return [
            rung
            for rung in sorted(self.ladder, key=lambda rung: rung.steps_per_period)
            if (rung.law, rung.damping_ratio, rung.elements) == (law, damping_ratio, elements)
            and rung.outcome == "completed"
        ]

    def numbers(self) -> dict[str, Any]:
        """Return the numbers that the figure quotes."""
        return {
            "by_law": {name: run.numbers() for name, run in self.by_law.items()},
            "stiff": self.stiff.numbers(),
            "by_height_mm": {f"{1e3 * h:g}": run.numbers() for h, run in self.by_height.items()},
            "ladder": [vars(rung) for rung in self.ladder],
        }


def rolling_study(*, fast: bool = False) -> RollingStudy:
    """Compute the first experiment with other strips, heights, laws, meshes and time steps.

    Args:
        fast: whether to compute a shorter ladder.
    """
    elements, steps = (
        ((20, 80), (5_000, 20_000)) if fast else ((20, 40, 80), (5_000, 20_000, 80_000))
    )
    stiff = closed_form.steel_strip(damping_ratio=max(DAMPING_RATIOS))
    return RollingStudy(
        by_law={name: rolling(law=law, periods=LONG) for name, law in LAWS.items()},
        stiff=rolling(stiff, periods=LONG),
        by_height={
            height: rolling(height=height, n_elements=40, steps_per_period=10_000)
            for height in HEIGHTS
        },
        ladder=tuple(
            rung(name, damping_ratio, n, n_steps)
            for name in LAWS
            for damping_ratio in DAMPING_RATIOS
            for n in elements
            for n_steps in steps
        ),
    )


def rung(law: str, damping_ratio: float, elements: int, steps_per_period: int) -> StripRung:
    """Compute the energy shares of the thin strip with a law of `LAWS`.

    Args:
        law: name of the law.
        damping_ratio: D [-].
        elements: n.
        steps_per_period: time steps per lowest period [-].
    """
    run = rolling(
        thin_strip(damping_ratio),
        LAWS[law],
        n_elements=elements,
        steps_per_period=steps_per_period,
    )
    shares = run.shares(float(run.energy.time[-1]))
    return StripRung(
        law=law,
        damping_ratio=damping_ratio,
        elements=elements,
        steps_per_period=steps_per_period,
        impacts=shares["impacts"],
        damping=shares["damping"],
        left=shares["left"],
        outcome=run.outcome,
    )


GAUGE_COLOURS = (BLUE, VERMILLION)
SHOWN_WAVE = 350.0
"""Time after the touch up to which the wave is drawn [µs]."""


def figure07(block: TipBlock) -> Figure:
    """Draw strains and contact force: the signals, the first wave, its dispersion.

    Args:
        block: results of a strip whose tip falls on a block.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(WIDTH, 8.6), layout="constrained")
    axes = figure.subplots(3, 2)
    for k in (0, 1):
        _draw_strain(axes[k, 0], block, k)
    _draw_force(axes[2, 0], block)
    _draw_waves(axes[0, 1], block)
    _draw_dispersion(axes[1, 1], block)
    _draw_peak(axes[2, 1], block)
    return figure


def _draw_strain(axes: Axes, block: TipBlock, gauge: int) -> None:
    """Draw the strain at a gauge over the impact."""
    motion = block.spring
    axes.plot(1e3 * motion.time, 1e6 * motion.strain[gauge], color=GAUGE_COLOURS[gauge])
    free = block.free.strain[gauge]
    axes.plot(
        1e3 * block.free.time, 1e6 * free, color=BASE_COLOUR, linestyle="--", label="no block"
    )
    axes.set(xlabel="time after the touch  [ms]", ylabel="strain  ε  [10⁻⁶]")
    before = 1e6 * block.static_strain[gauge]
    place = 1e3 * block.gauges[gauge]
    axes.set_title(f"[{gauge + 1}]  x = {place:.0f} mm, held up: ε = {before:.0f}·10⁻⁶", loc="left")
    axes.margins(x=0.0)
    axes.legend(loc="best")


def _draw_force(axes: Axes, block: TipBlock) -> None:
    """Draw the contact force over the whole contact."""
    axes.plot(1e3 * block.spring.time, 1e-3 * block.force, color=BLACK, linewidth=0.9)
    axes.set(xlabel="time after the touch  [ms]", ylabel="force  [kN]")
    axes.set_title("[3]  block of finite stiffness", loc="left")
    axes.margins(x=0.0)


def _draw_waves(axes: Axes, block: TipBlock) -> None:
    """Draw the strain that the block causes, with that of the exact beam without a clamp."""
    time = 1e6 * block.spring.time
    wave, exact = 1e6 * block.wave(block.spring), 1e6 * block.exact_wave()
    for k, colour in enumerate(GAUGE_COLOURS):
        distance = 1e3 * (block.lamina.length - block.gauges[k])
        axes.plot(time, wave[k], color=colour, label=f"[{k + 1}]  {distance:.0f} mm from the tip")
    axes.plot(time, exact[1], color=BLACK, linestyle=":", label="[2] exact, no clamp")
    shown = (time > 0.0) & (time < SHOWN_WAVE)
    largest = 1.1 * float(np.abs(wave[:, shown]).max())
    axes.set(xlim=(0.0, SHOWN_WAVE), ylim=(-largest, 1.9 * largest))
    axes.set(xlabel="time after the touch  [µs]", ylabel="strain by the block  [10⁻⁶]")
    axes.legend(loc="upper left")


def _draw_dispersion(axes: Axes, block: TipBlock) -> None:
    """Draw frequency over arrival time at the second gauge, with the dispersion relation."""
    middle, frequency = block.half_waves()
    distance = float(block.lamina.length - block.gauges[1])
    shown = np.geomspace(0.5 * frequency.min(), 1.3 * frequency.max(), 100)
    arrival = distance / exact_beam(block.lamina).group_speed(shown)
    slower = distance / exact_beam(block.lamina).timoshenko_group_speed(shown)
    rod = distance / float(np.sqrt(block.lamina.young_modulus / block.lamina.density))
    axes.plot(1e6 * arrival, 1e-3 * shown, color=BLACK, label="distance / $c_g$ (bending)")
    axes.plot(1e6 * slower, 1e-3 * shown, ":", color=BLACK, label="with shear (Timoshenko)")
    axes.axvline(1e6 * rod, color=PURPLE, linestyle="--", label="distance / $c_0$ (longitudinal)")
    axes.plot(
        1e6 * middle, 1e-3 * frequency, "o", color=GAUGE_COLOURS[1], label="half waves at [2]"
    )
    axes.set(xlim=(0.0, 1e6 * float(arrival.max())), ylim=(0.0, 2e-3 * float(shown.max())))
    axes.set(xlabel="arrival after the largest force  [µs]", ylabel="frequency  [kHz]")
    axes.legend(loc="upper right")


def _draw_peak(axes: Axes, block: TipBlock) -> None:
    """Draw the first peak of the force, and the impulse of the rigid block."""
    time = 1e6 * block.spring.time
    exact_time = np.linspace(0.0, 1e-4, 300)
    beam = exact_beam(block.lamina)
    exact = beam.spring_force(exact_time, block.speed, block.stiffness)
    axes.plot(time, 1e-3 * block.force, color=BLACK, label="force")
    axes.plot(1e6 * exact_time, 1e-3 * exact, color=ORANGE, linestyle="--", label="exact")
    axes.set(xlim=(-10.0, 100.0), xlabel="time after the touch  [µs]", ylabel="force  [kN]")
    right = axes.twinx()
    right.plot(
        1e6 * block.rigid.time, block.rigid.impulse, color=GREEN, label="impulse, rigid block"
    )
    impulse = beam.rigid_impulse(exact_time, block.speed)
    right.plot(1e6 * exact_time, impulse, color=ORANGE, linestyle="--")
    right.set(ylim=(0.0, 0.15))
    right.set_ylabel("impulse  [N s]", color=GREEN)
    right.grid(visible=False)
    _, end = block.peak()
    axes.axvspan(0.0, 1e6 * end, color="#eeeeee", zorder=0)
    axes.set_title(f"[3]  peak of {1e6 * end:.0f} µs", loc="left")
    handles = [a.get_legend_handles_labels() for a in (axes, right)]
    axes.legend(
        *(first + second for first, second in zip(*handles, strict=True)), loc="upper right"
    )


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
    x = 1e3 * np.concatenate([[0.0], closed_form.nodes(strip, n)])
    length, t = 1e3 * strip.length, 1e3 * strip.thickness
    up = 1e3 * np.concatenate([[0.0], closed_form.lifted(strip, n, LIFT, "tip force")[::2]])
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
    sag = 1e3 * closed_form.sag(run.lamina, run.gravity)
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
    ratio = [run.tip[0] / closed_form.sag(run.lamina, run.gravity) for run in runs]
    direction = [run.front()[0] for run in runs]
    axes.plot(ratio[:-1], direction[:-1], "o-", color=BLUE, label="thin strip")
    axes.plot(ratio[-1:], direction[-1:], "s", color=VERMILLION, label="stiff strip")
    axes.set(xscale="log", ylim=(-1.15, 1.15), xlabel="height of the tip / sag  [–]")
    axes.set_ylabel("rank correlation, place and time  [–]")
    axes.set_title("1: clamp → tip\n−1: tip → clamp", loc="left")
    axes.legend(loc="center left")
