"""Fig. 9 of the paper: phase portraits by method 3.1, and the drawing that Fig. 14 also uses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from delam_fem.numerics.arrays import FloatArray
from delam_fem.paper.claims import Claim, Criterion, Numbers, Piece, judged
from delam_fem.paper.lab import FREQUENCIES, RESONANT, Laboratory, motion_case
from delam_fem.paper.measures import MotionNumbers, motion_numbers, settling
from delam_fem.results import diagnostics
from delam_fem.results.figures.style import LAMINA_COLOURS, PORTRAIT_PERIODS, WIDTH, label_x

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from delam_fem.results.folder import Result

SCATTERS = 3.0
"""A distance from the stationary cycle counts as near up to this number of its scatters (rms)."""
NARROW, WIDE = 2.5, 4.0
"""Other numbers of scatters, which show how much the length of a transient depends on it."""
LONG = 100
"""A transient of at least this number of periods counts as "some hundred"."""


@dataclass(frozen=True)
class Portrait:
    """The phase portraits of both tips over the last `PORTRAIT_PERIODS` periods.

    Attributes:
        names: names of the laminae.
        motion: displacement [m] and velocity [m/s] of both tips, shape (2 laminae, 2, n).
        gap_at_rest: gap of the tips at rest [m].
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
            float(diagnostics.ProbeMotion.of(result.history).gap_at_rest[0]),
            result.case.time.steps_per_period,
        )


@dataclass(frozen=True)
class ImpactPortraits(Numbers):
    """The motions by method 3.1.

    Attributes:
        motion: numbers of the motion at 3.25 Hz.
        settled: number of periods after which each of the four motions is stationary.
        settled_by_scatters: the same with other distances that count as near, by the distance.
        portrait: portraits of the motion at 3.25 Hz.
    """

    motion: MotionNumbers
    settled: list[int]
    settled_by_scatters: dict[float, list[int]]
    portrait: Portrait

    def to_json(self) -> Mapping[str, Any]:
        """Return the numbers of the motion at 3.25 Hz."""
        return self.motion.to_json()


def measure(lab: Laboratory) -> ImpactPortraits:
    """Compute the four motions by method 3.1."""
    motions = lab.motions([motion_case(f, lab.plan, "3.1") for f in FREQUENCIES])
    result = motions[FREQUENCIES.index(RESONANT)]
    settled = {s: [_settling(motion, s) for motion in motions] for s in (NARROW, SCATTERS, WIDE)}
    return ImpactPortraits(motion_numbers(result), settled[SCATTERS], settled, Portrait.of(result))


def _settling(result: Result, scatters: float) -> int:
    """Return the number of periods after which a motion stays near its stationary cycle."""
    strobe = result.history["strobe_displacement"].to_numpy()
    half = 0.5 * np.ptp(result.history["tip_displacement"].to_numpy(), axis=1)
    scatter = result.summary["strobe_scatter"] or diagnostics.PERIODIC_SCATTER
    return settling(strobe, half, result.summary["periodicity"] or 1, scatters * scatter)


def draw(numbers: ImpactPortraits) -> Figure:
    """Draw the phase portraits of method 3.1 at 3.25 Hz."""
    figure, _ = two_portraits([numbers.portrait], ["method 3.1"])
    return figure


def judge(numbers: ImpactPortraits) -> tuple[Claim, ...]:
    """Judge whether method 3.1 is stable, and how long its transients are."""
    motion, settled = numbers.motion, numbers.settled_by_scatters
    scatter = float(motion.strobe_scatter or np.nan)
    return (
        Claim(
            "9", "Δt = T/1000 gives orbitally stable results", "sec. 3.1",
            f"method 3.1, {motion.kind}; successive cycles differ by {100 * scatter:.1f} % of the "
            "half peak-to-peak amplitude (rms at the ends of periods)",
            *judged(*motion.criteria(1)[1:]),
        ),
        Claim(
            "9", "some hundred periods are necessary to get a stationary state", "sec. 3.1",
            f"from rest, strobes stay within {SCATTERS:g} times the scatter of the stationary "
            "cycles after "
            + ", ".join(
                f"{n} at {f:.2f} Hz" for n, f in zip(numbers.settled, FREQUENCIES, strict=True)
            )
            + " (periods)",
            *judged(
                Criterion(
                    "longest", max(numbers.settled), ">", LONG - 1.0, "periods",
                    (float(max(settled[WIDE])), float(max(settled[NARROW]))),
                )
            ),
        ),
    )  # fmt: skip


def two_portraits(
    portraits: Sequence[Portrait], titles: Sequence[str], *, has_row_below: bool = False
) -> tuple[Figure, list[Axes]]:
    """Draw the portraits of the thick and the thin tip in two columns, with one row per motion.

    Args:
        portraits: at least one portrait.
        titles: titles of the rows.
        has_row_below: whether to leave a row of axes below the portraits.

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
    for i, column in enumerate(panels.T):
        label_x(column, f"displacement of the tip $q_{i + 1}$ [mm]")
    return figure, [figure.add_subplot(grid[rows, i]) for i in range(2 * n_below)]


IMPACT_PORTRAITS = Piece(
    "9",
    "Phase portraits by method 3.1",
    f"Method 3.1 at {RESONANT} Hz, {PORTRAIT_PERIODS} periods. The paper's experiment beside "
    "it is not available.",
    measure,
    draw,
    judge,
)
