"""Figures 6 and 7: lateral impact on one beam (paper 2.3); both are known from the text alone."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.ticker import ScalarFormatter

from delam_fem import ground
from delam_fem.figure_style import (
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
from delam_fem.ground_run import LIFT
from delam_fem.lateral import RollingStudy
from delam_fem.rolling import Rolling
from delam_fem.struck_beam import StruckBeam
from delam_fem.tip_block import TipBlock

GAUGE_COLOURS = (BLUE, VERMILLION)
LAW_COLOURS = {"moreau": BLUE, "moreau-recovery": SKY, "newton-penalty": ORANGE}
MARKERS = {20: "s", 40: "^", 80: "o"}
"""Of the meshes of a ladder, by elements."""
SHOWN_LANDING = (11.0, 16.0)
"""Time round the landing that is drawn [ms]."""
SHOWN_WAVE = 350.0
"""Time after the touch in which the wave is drawn [µs]."""


# -- Fig. 6 -----------------------------------------------------------------------------------


def figure06(study: RollingStudy, block: TipBlock) -> Figure:
    """Draw the set-up of the second experiment and the course of the first.

    Args:
        study: a strip that falls on the ground along which it lies.
        block: gives the strip and the places of the gauges.
    """
    figure = Figure(figsize=(WIDTH, 9.6), layout="constrained")
    rows = figure.subfigures(3, 1, height_ratios=(1.0, 1.25, 1.45))
    _draw_setup(rows[0].subplots(), block)
    left, right = rows[1].subplots(1, 2, sharey=True)
    _draw_contact_line(left, study.by_lift["tip force"])
    _draw_contact_line(right, study.by_lift["uniform load"])
    left.set_ylabel("place  x  [mm]")
    left, middle, right = rows[2].subplots(1, 3)
    _draw_energy(left, study.by_lift["tip force"])
    _draw_ladder(middle, study)
    _draw_tips(right, study)
    return figure


def _draw_setup(axes: Axes, block: TipBlock) -> None:
    """Draw the strip, lifted and free of stress, with its sensors, to scale."""
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
    """Draw every push of the ground over time and place, the first one of each node in front."""
    pushes, x = run.impulses, 1e3 * run.x
    axes.plot(
        1e3 * pushes.time, x[pushes.pair], ".", color=SKY, markersize=2.5, label="node is pushed"
    )
    axes.plot(
        1e3 * run.contact_line, x, ".", color=BLACK, markersize=4.5, label="for the first time"
    )
    axes.set(xlim=SHOWN_LANDING, ylim=(0.0, 1.03e3 * run.lamina.length))
    axes.set_xlabel("time after the release  t  [ms]")
    direction, speed = run.front()
    words = "clamp → tip" if direction > 0.0 else "tip → clamp"
    axes.set_title(f"lifted by a {run.lift}: {words}, {speed:.0f} m/s", loc="left")
    axes.legend(loc="center right")


def _draw_energy(axes: Axes, run: Rolling) -> None:
    """Draw where the energy is and where it went."""
    energy = run.energy
    parts = np.array([energy.stored, energy.damped, energy.impact]) / energy.stored[0]
    names = ("in the strip", "lost to damping", "lost at impacts")
    axes.stackplot(1e3 * energy.time, parts, labels=names, colors=(BASE_COLOUR, SKY, VERMILLION))
    axes.set(xlim=(10.0, 25.0), ylim=(0.0, 1.0))
    axes.set(xlabel="time after the release  [ms]", ylabel="share of the energy  [–]")
    axes.set_title(f"{run.law.name}, {run.x.size} elements", loc="left")
    axes.legend(loc="lower right")


def _draw_ladder(axes: Axes, study: RollingStudy) -> None:
    """Draw the shares lost in all and at impacts over the time step; damped strip."""
    damping_ratio = max(rung.damping_ratio for rung in study.ladder)
    for law, colour in LAW_COLOURS.items():
        for n, marker in MARKERS.items():
            rungs = study.rungs(law, damping_ratio, n)
            steps = [1e6 * rung.time_step for rung in rungs]
            drawn = axes.plot(steps, [rung.impacts for rung in rungs], label=_label(law, n))
            drawn += axes.plot(steps, [1.0 - rung.left for rung in rungs], linestyle="--")
            for line in drawn:
                line.set(color=colour, marker=marker, markersize=4.5, linewidth=0.9)
    axes.set(xscale="log", ylim=(0.0, 1.05), xlabel="time step  Δt  [µs]")
    axes.set_ylabel("share lost in 25 ms  [–]")
    axes.xaxis.set_major_formatter(ScalarFormatter())
    meshes = ", ".join(f"{n} {_SIGNS[marker]}" for n, marker in MARKERS.items())
    axes.set_title(f"dashed: all, solid: at impacts\nelements: {meshes}", loc="left")
    axes.legend(loc="center right", bbox_to_anchor=(1.0, 0.68))


_SIGNS = {"s": "□", "^": "△", "o": "○"}


def _label(law: str, n: int) -> str:
    """Return a law's name for one of its lines, no entry in the legend for the others."""
    return law if n == max(MARKERS) else "_nolegend_"


def _draw_tips(axes: Axes, study: RollingStudy) -> None:
    """Draw the height of the tip by each law, and with the release that rolls from the clamp."""
    runs = [(name, run, LAW_COLOURS[name], "-") for name, run in study.by_law.items()]
    runs.append(("uniform load", study.by_lift["uniform load"], BLACK, ":"))
    for name, run, colour, style in runs:
        axes.plot(1e3 * run.time, 1e3 * run.tip, color=colour, linestyle=style, label=name)
    axes.set(xlabel="time after the release  [ms]", ylabel="height of the tip  [mm]")
    axes.set(ylim=(-1.0, 1.02e3 * LIFT))
    axes.margins(x=0.0)
    axes.legend(loc="upper right")
    axes.set_title("tip", loc="left")


# -- Fig. 7 -----------------------------------------------------------------------------------


def figure07(block: TipBlock) -> Figure:
    """Draw strains and contact force: the signals, the first wave, its dispersion.

    Args:
        block: a strip whose tip falls on a block.
    """
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
    axes.set_title(
        f"[{gauge + 1}]  x = {place:.0f} mm;  {before:.0f} before the release", loc="left"
    )
    axes.margins(x=0.0)
    axes.legend(loc="upper right")


def _draw_force(axes: Axes, block: TipBlock) -> None:
    """Draw the contact force over the whole contact."""
    axes.plot(1e3 * block.spring.time, 1e-3 * block.force, color=BLACK, linewidth=0.9)
    axes.set(xlabel="time after the touch  [ms]", ylabel="force  [kN]")
    axes.set_title("[3]  block of finite stiffness", loc="left")
    axes.margins(x=0.0)


def _draw_waves(axes: Axes, block: TipBlock) -> None:
    """Draw the strain that the block causes, beside the beam without a clamp."""
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
    """Draw frequency over arrival at the second gauge, beside the dispersion relation."""
    middle, frequency = block.half_waves()
    distance = float(block.lamina.length - block.gauges[1])
    shown = np.geomspace(0.5 * frequency.min(), 1.3 * frequency.max(), 100)
    arrival = distance / StruckBeam.of(block.lamina).group_speed(shown)
    rod = distance / float(np.sqrt(block.lamina.young_modulus / block.lamina.density))
    axes.plot(1e6 * arrival, 1e-3 * shown, color=BLACK, label="distance / $c_g$ (bending)")
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
    beam = StruckBeam.of(block.lamina)
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
