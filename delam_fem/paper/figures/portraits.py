"""Figs. 9 and 12 of the paper: phase portraits by method 3.1, and of the four motions by both."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from delam_fem.numerics.arrays import FloatArray
from delam_fem.paper.claims import Claim, judged
from delam_fem.paper.lab import LAWS, Laboratory, Method, both_methods, motion_case
from delam_fem.paper.measures import (
    CLEARLY,
    SMOOTH_HARMONICS,
    MotionNumbers,
    motion_numbers,
    roughness,
    settling,
)
from delam_fem.paper.motions import FREQUENCIES, RESONANT
from delam_fem.paper.piece import Numbers, Piece
from delam_fem.results import diagnostics
from delam_fem.results.style import (
    BLACK,
    LAMINA_COLOURS,
    PORTRAIT_PERIODS,
    WIDTH,
    legend_outside,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from delam_fem.results.dataset import Result

SCATTERS = 3.0
"""Distance from the stationary cycle that counts as near, in its own scatter (rms)."""
LONG = 100
"""Periods from which on a transient counts as some hundred."""


@dataclass(frozen=True)
class Portrait:
    """The phase portraits of both tips over the last `PORTRAIT_PERIODS` periods.

    Attributes:
        names: of the laminae.
        motion: displacement [m] and velocity [m/s] of both tips, shape (2 laminae, 2, n).
        gap_at_rest: of the tips [m].
        steps_per_period: N.
    """

    names: tuple[str, str]
    motion: FloatArray
    gap_at_rest: float
    steps_per_period: int

    @classmethod
    def of(cls, result: Result) -> Self:
        """Return the portraits of a result."""
        thick, thin = result.case.lamina
        return cls(
            (thick.name, thin.name),
            diagnostics.phase_portrait(result.history, result.case, PORTRAIT_PERIODS),
            float(result.history["gap0"][diagnostics.TIP]),
            result.case.time.steps_per_period,
        )


# -- Fig. 12: four motions, both methods ------------------------------------------------------


@dataclass(frozen=True)
class Portraits(Numbers):
    """The four motions by both methods; all by frequency [Hz] and method.

    Attributes:
        motions: their numbers.
        roughness_free: of both tips in free flight [-]; see `roughness`.
        portraits: their phase portraits.
    """

    motions: dict[tuple[float, Method], MotionNumbers]
    roughness_free: dict[tuple[float, Method], tuple[float, float]]
    portraits: dict[tuple[float, Method], Portrait]

    def to_json(self) -> Mapping[str, Any]:
        """Return the motions with their roughness, the keys in words."""
        return {
            f"{f:g} Hz, {m}": {
                **motion.to_json(), "roughness_free": self.roughness_free[f, m],
            }
            for (f, m), motion in self.motions.items()
        }  # fmt: skip


def measure_portraits(lab: Laboratory) -> Portraits:
    """Compute the four motions by both methods."""
    found = both_methods(lab)
    return Portraits(
        {key: motion_numbers(result) for key, result in found.items()},
        {key: roughness(result, free=True) for key, result in found.items()},
        {key: Portrait.of(result) for key, result in found.items()},
    )


def draw_portraits(numbers: Portraits) -> Figure:
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
    for panel in panels[-1]:
        panel.set_xlabel("position of the tip [mm]")
    legend_outside(figure, panels[0, 0], 3)
    return figure


def _draw_both_tips(panel: Axes, portrait: Portrait) -> None:
    """Draw the portraits of both tips into one panel, over their positions."""
    ends = slice(portrait.steps_per_period - 1, None, portrait.steps_per_period)
    shift = (0.0, 1e3 * portrait.gap_at_rest)
    for i, colour in enumerate(LAMINA_COLOURS):
        q, v = 1e3 * portrait.motion[i, 0] + shift[i], portrait.motion[i, 1]
        panel.plot(q, v, color=colour, linewidth=0.6, label=portrait.names[i])
        label = "ends of periods" if i == 0 else None
        panel.plot(q[ends], v[ends], "o", color=BLACK, markersize=3, zorder=4, label=label)


def judge_portraits(numbers: Portraits) -> tuple[Claim, ...]:
    """Judge whether one set of parameters gives all motions, stable and smooth."""
    kinds = {m: [numbers.motions[f, m].is_as_described for f in FREQUENCIES] for m in LAWS}
    scatter = [numbers.motions[f, "3.2"].strobe_scatter for f in FREQUENCIES]
    rough = {m: np.array([numbers.roughness_free[f, m] for f in FREQUENCIES[1:]]) for m in LAWS}
    ratio = rough["3.2"] / rough["3.1"]
    return (
        Claim(
            "12", "all four motions with one set of parameters", "sec. 3.2, 4",
            f"{sum(kinds['3.2'])} of 4 motions are as described by method 3.2 "
            f"({sum(kinds['3.1'])} of 4 by 3.1), e = 0.1, k_con = 100 N/m, γ = 0.5 mm/s throughout",
            judged(all(kinds["3.2"])), True,
        ),
        Claim(
            "12", "in all cases an orbitally stable solution", "sec. 3.2",
            "cycles differ by "
            + ", ".join("–" if s is None else f"{100 * s:.2g} %" for s in scatter)
            + " of the half peak-to-peak amplitude at 1.25, 1.60, 3.25, 3.65 Hz",
            judged(all(s is not None for s in scatter)),
        ),
        Claim(
            "12", "3.2 is distinctly smoother than 3.1 in free vibration", "sec. 3.2",
            f"velocity above harmonic {SMOOTH_HARMONICS} while the tips are more than 1 mm apart, "
            "3.2 over 3.1 (thick / thin): "
            + ", ".join(
                f"{a:.2f} / {b:.2f} at {f:.2f} Hz"
                for f, (a, b) in zip(FREQUENCIES[1:], ratio, strict=True)
            ),
            judged(bool(np.all(ratio < CLEARLY))), True,
        ),
    )  # fmt: skip


PORTRAITS = Piece(
    "12",
    "Phase portraits",
    f"Phase portraits of both tips over {PORTRAIT_PERIODS} periods by methods 3.1 (impact law) "
    "and 3.2 (impact law and penalty stiffness), dots: ends of periods. The paper's portraits "
    "are not available; compared is what its text says of them.",
    measure_portraits,
    draw_portraits,
    judge_portraits,
)


# -- Fig. 9: method 3.1 at 3.25 Hz ------------------------------------------------------------


@dataclass(frozen=True)
class ImpactPortraits(Numbers):
    """Motions by method 3.1.

    Attributes:
        motion: the one at 3.25 Hz.
        settled: periods after which each of the four motions is stationary.
        portrait: of the motion at 3.25 Hz.
    """

    motion: MotionNumbers
    settled: list[int]
    portrait: Portrait

    def to_json(self) -> Mapping[str, Any]:
        """Return the motion at 3.25 Hz."""
        return self.motion.to_json()


def measure_impact_portraits(lab: Laboratory) -> ImpactPortraits:
    """Compute the four motions by method 3.1."""
    motions = lab.motions([motion_case(f, lab.plan, "3.1") for f in FREQUENCIES])
    result = motions[FREQUENCIES.index(RESONANT)]
    settled = [_settling(motion) for motion in motions]
    return ImpactPortraits(motion_numbers(result), settled, Portrait.of(result))


def _settling(result: Result) -> int:
    """Return after how many periods a motion is as near its stationary cycle as it will be."""
    strobe = result.history["strobe_displacement"].to_numpy()
    half = 0.5 * np.ptp(result.history["tip_displacement"].to_numpy(), axis=1)
    scatter = result.summary["strobe_scatter"] or diagnostics.PERIODIC_SCATTER
    return settling(strobe, half, result.summary["periodicity"] or 1, SCATTERS * scatter)


def draw_impact_portraits(numbers: ImpactPortraits) -> Figure:
    """Draw the phase portraits of method 3.1 at 3.25 Hz."""
    figure, _ = two_portraits([numbers.portrait], ["method 3.1"])
    return figure


def judge_impact_portraits(numbers: ImpactPortraits) -> tuple[Claim, ...]:
    """Judge whether method 3.1 is stable, and how long its transients are."""
    motion = numbers.motion
    scatter = float(motion.strobe_scatter or np.nan)
    return (
        Claim(
            "9", "Δt = T/1000 gives orbitally stable results", "sec. 3.1",
            f"method 3.1, {motion.kind}; successive cycles differ by {100 * scatter:.1f} % of the "
            "half peak-to-peak amplitude (rms at the ends of periods)",
            judged(motion.periodicity == 1),
        ),
        Claim(
            "9", "some hundred periods are necessary to get a stationary state", "sec. 3.1",
            f"from rest, strobes stay within {SCATTERS:g} times the scatter of the stationary "
            "cycles after "
            + ", ".join(
                f"{n} at {f:.2f} Hz" for n, f in zip(numbers.settled, FREQUENCIES, strict=True)
            )
            + " (periods)",
            judged(max(numbers.settled) >= LONG),
        ),
    )  # fmt: skip


IMPACT_PORTRAITS = Piece(
    "9",
    "Phase portraits by method 3.1",
    f"Method 3.1 at {RESONANT} Hz, {PORTRAIT_PERIODS} periods. The paper's experiment beside "
    "it is not available.",
    measure_impact_portraits,
    draw_impact_portraits,
    judge_impact_portraits,
)


def two_portraits(
    portraits: Sequence[Portrait], titles: Sequence[str], *, has_row_below: bool = False
) -> tuple[Figure, list[Axes]]:
    """Draw the portraits of thick and thin in columns, motions in rows.

    Args:
        portraits: at least one.
        titles: of the rows.
        has_row_below: whether to leave a row for something else.

    Returns:
        The figure, and the axes of the row below.
    """
    from matplotlib.figure import Figure

    rows, n_below = len(portraits), int(has_row_below)
    figure = Figure(figsize=(WIDTH, 0.6 + 3.9 * rows + 2.8 * n_below), layout="constrained")
    grid = figure.add_gridspec(rows + n_below, 2, height_ratios=[3.9] * rows + [2.8] * n_below)
    above = grid[:rows, :].subgridspec(rows, 2)
    panels = above.subplots(squeeze=False, sharex="col", sharey=True)
    for row, portrait, title in zip(panels, portraits, titles, strict=True):
        for i, panel in enumerate(row):
            q, v = portrait.motion[i]
            panel.plot(1e3 * q, v, color=LAMINA_COLOURS[i], linewidth=0.6)
            panel.set_title(f"{portrait.names[i]}, {title}", loc="left")
        row[0].set_ylabel("velocity of the tip [m/s]")
    for i, panel in enumerate(panels[-1]):
        panel.set_xlabel(f"displacement of the tip $q_{i + 1}$ [mm]")
    return figure, [figure.add_subplot(grid[rows, i]) for i in range(2 * n_below)]
