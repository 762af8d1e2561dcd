"""Draw an orbit: its motion, its phase portrait and its multipliers in the unit circle."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from delam_fem.results.figures.style import (
    BASE_COLOUR,
    BLACK,
    BLUE,
    GAP_COLOUR,
    WIDTH,
    lamina_colours,
    title,
)

if TYPE_CHECKING:
    from delam_fem.studies.orbits.run import Orbit

LEAST_REACH = 1.15
"""Half the width of the plane of multipliers that is always shown."""
SHOWN = 60
"""Bootstrap samples drawn as small points."""


def orbit_figure(found: Orbit) -> Figure:
    """Return a figure with the tips over the orbit's periods, and the multipliers."""
    figure = Figure(figsize=(WIDTH, 4.3), layout="constrained")
    motion, plane = figure.subplots(1, 2, width_ratios=(1.25, 1.0))
    _motion(motion, found)
    _plane(plane, found)
    numbers = found.numbers
    is_closed = found.exact is not None or found.coarse.solved.is_solved
    figure.suptitle(
        f"{title(found.case)}\n{found.nature.name}: {found.kind if is_closed else 'no'} orbit of "
        f"{found.periods} period{'s' * (found.periods > 1)}, residual {numbers['residual']:.1e} ± "
        f"{numbers['residual_error']:.1e}: {found.stability}"
    )
    return figure


def _motion(panel: Axes, found: Orbit) -> None:
    """Draw the displacements of the tips over the periods of the orbit."""
    u = found.passage.history
    names = [lamina.name for lamina in found.case.lamina]
    t = found.periods * np.arange(1, len(u) + 1) / len(u)
    for i, (name, colour) in enumerate(zip(names, lamina_colours(len(names)), strict=True)):
        panel.plot(t, 1e3 * u[:, i], color=colour, label=name)
        panel.plot(t[-1], 1e3 * u[-1, i], "o", color=colour, markersize=4.0)
    panel.set(xlabel="time / period of the drive  t/T  [–]", ylabel="tip displacement  q  [mm]")
    panel.legend(loc="best")


def _plane(panel: Axes, found: Orbit) -> None:
    """Draw the multipliers with bootstrap samples, and the exact ones."""
    angle = np.linspace(0.0, 2.0 * np.pi, 361)
    panel.fill(np.cos(angle), np.sin(angle), color=GAP_COLOUR, zorder=0)
    panel.plot(np.cos(angle), np.sin(angle), color=BASE_COLOUR, linewidth=1.0)
    reach = LEAST_REACH
    m = found.coarse.multipliers
    cloud = m.samples[:: max(len(m.samples) // SHOWN, 1)].ravel()
    panel.plot(cloud.real, cloud.imag, ".", color=BLUE, markersize=1.5, alpha=0.35)
    panel.plot(
        m.values.real, m.values.imag, "o", color=BLUE, markersize=5.0, markerfacecolor="none",
        label=f"kicks of {100.0 * found.coarse.kick:.3g} %",
    )  # fmt: skip
    reach = max(reach, 1.1 * float(np.abs(m.values).max()))
    if found.exact is not None:
        mu = found.exact.values
        panel.plot(mu.real, mu.imag, "x", color=BLACK, markersize=5.0, label="derivative")
        reach = max(reach, 1.1 * float(np.abs(mu).max()))
    panel.set(
        xlim=(-reach, reach),
        ylim=(-reach, reach),
        aspect="equal",
        xlabel="Re μ  [–]",
        ylabel="Im μ  [–]",
    )
    panel.legend(loc="upper right", fontsize=8.0)
