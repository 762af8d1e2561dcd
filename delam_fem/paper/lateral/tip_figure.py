"""Draw figure 7: a strip whose tip falls on a block (paper 2.3); the original is not available."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from delam_fem.paper.lateral.tip_block import TipBlock, exact_beam
from delam_fem.results.figures.style import (
    BASE_COLOUR,
    BLACK,
    BLUE,
    GREEN,
    ORANGE,
    PURPLE,
    VERMILLION,
    WIDTH,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

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
