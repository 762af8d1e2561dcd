"""Fig. 12 of the paper: phase portraits of the four motions by both methods."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from delam_fem.paper.claims import Claim, Criterion, Numbers, Piece, judged
from delam_fem.paper.figures.impact_portraits import Portrait
from delam_fem.paper.lab import FREQUENCIES, LAWS, Laboratory, PaperMethod, both_methods
from delam_fem.paper.measures import (
    CLEARLY,
    SMOOTH_HARMONICS,
    MotionNumbers,
    motion_numbers,
    roughness,
)
from delam_fem.results.diagnostics import PERIODIC_MARGIN, PERIODIC_SCATTER
from delam_fem.results.figures.style import (
    BLACK,
    PORTRAIT_PERIODS,
    WIDTH,
    label_x,
    lamina_colours,
    legend_outside,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Portraits(Numbers):
    """The four motions by both methods; the keys are frequency [Hz] and method.

    Attributes:
        motions: numbers of each motion.
        roughness_free: roughness of both tips in free flight [-]; see `roughness`.
        portraits: phase portraits of each motion.
    """

    motions: dict[tuple[float, PaperMethod], MotionNumbers]
    roughness_free: dict[tuple[float, PaperMethod], tuple[float, float]]
    portraits: dict[tuple[float, PaperMethod], Portrait]

    def to_json(self) -> Mapping[str, Any]:
        """Return the motions with their roughness, with keys in words."""
        return {
            f"{f:g} Hz, {m}": {
                **motion.to_json(), "roughness_free": self.roughness_free[f, m],
            }
            for (f, m), motion in self.motions.items()
        }  # fmt: skip


def measure(lab: Laboratory) -> Portraits:
    """Compute the four motions by both methods."""
    found = both_methods(lab)
    return Portraits(
        {key: motion_numbers(result) for key, result in found.items()},
        {key: roughness(result, free=True) for key, result in found.items()},
        {key: Portrait.of(result) for key, result in found.items()},
    )


def draw(numbers: Portraits) -> Figure:
    """Draw the phase portraits of both tips over ten periods at the four frequencies."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(WIDTH, 12.0), layout="constrained")
    panels = figure.subplots(4, 2, sharex="row", sharey="row")
    for (frequency, method), portrait in numbers.portraits.items():
        panel = panels[FREQUENCIES.index(frequency), int(method == "3.2")]
        _draw_both_tips(panel, portrait)
        letter = "abcd"[FREQUENCIES.index(frequency)]
        panel.set_title(f"[{letter}] {frequency:.2f} Hz, method {method}", loc="left")
    for row in panels:
        row[0].set_ylabel("velocity of the tip [m/s]")
    label_x(panels.flat, "position of the tip [mm]")
    legend_outside(figure, panels[0, 0], 3)
    return figure


def _draw_both_tips(panel: Axes, portrait: Portrait) -> None:
    """Draw the portraits of both tips into one panel, over the tips' positions."""
    ends = slice(portrait.steps_per_period - 1, None, portrait.steps_per_period)
    shift = (0.0, 1e3 * portrait.gap_at_rest)
    for i, colour in enumerate(lamina_colours(2)):
        q, v = 1e3 * portrait.motion[i, 0] + shift[i], portrait.motion[i, 1]
        panel.plot(q, v, color=colour, linewidth=0.6, label=portrait.names[i])
        label = "ends of periods" if i == 0 else None
        panel.plot(q[ends], v[ends], "o", color=BLACK, markersize=3, zorder=4, label=label)


def judge(numbers: Portraits) -> tuple[Claim, ...]:
    """Judge whether one set of parameters gives all motions, all of them stable and smooth."""
    kinds = {m: [numbers.motions[f, m].is_as_described for f in FREQUENCIES] for m in LAWS}
    scatter = [numbers.motions[f, "3.2"].strobe_scatter for f in FREQUENCIES]
    rough = {m: np.array([numbers.roughness_free[f, m] for f in FREQUENCIES[1:]]) for m in LAWS}
    ratio = rough["3.2"] / rough["3.1"]
    margin, scatters = PERIODIC_MARGIN, [math.nan if s is None else s for s in scatter]
    stable = [
        Criterion(f"{f:.2f} Hz", s, "<", PERIODIC_SCATTER, "%", (s / margin, s * margin))
        for f, s in zip(FREQUENCIES, scatters, strict=True)
    ]
    return (
        Claim(
            "12", "all four motions with one set of parameters", "sec. 3.2, 4",
            f"{sum(kinds['3.2'])} of 4 motions are as described by method 3.2 "
            f"({sum(kinds['3.1'])} of 4 by 3.1), e = 0.1, k_con = 100 N/m, γ = 0.5 mm/s throughout",
            *judged(Criterion("motions as described", sum(kinds["3.2"]), ">", 3.0)),
        ),
        Claim(
            "12", "in all cases an orbitally stable solution", "sec. 3.2",
            "cycles differ by "
            + ", ".join("–" if s is None else f"{100 * s:.2g} %" for s in scatter)
            + " of the half peak-to-peak amplitude at 1.25, 1.60, 3.25, 3.65 Hz",
            *judged(*stable),
        ),
        Claim(
            "12", "3.2 is distinctly smoother than 3.1 in free vibration", "sec. 3.2",
            f"velocity above harmonic {SMOOTH_HARMONICS} while the tips are more than 1 mm apart, "
            "3.2 over 3.1 (thick / thin): "
            + ", ".join(
                f"{a:.2f} / {b:.2f} at {f:.2f} Hz"
                for f, (a, b) in zip(FREQUENCIES[1:], ratio, strict=True)
            ),
            *judged(Criterion("largest ratio", float(np.max(ratio)), "<", CLEARLY)),
        ),
    )  # fmt: skip


PORTRAITS = Piece(
    "12",
    "Phase portraits",
    f"Phase portraits of both tips over {PORTRAIT_PERIODS} periods by methods 3.1 (impact law) "
    "and 3.2 (impact law and penalty stiffness), dots: ends of periods. The paper's portraits "
    "are not available; compared is what its text says of them.",
    measure,
    draw,
    judge,
)
