"""Fig. 3 of the paper: time histories of the four motions by both methods."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from delam_fem.numerics.arrays import FloatArray
from delam_fem.paper.claims import Claim, Criterion, Numbers, Piece, judged
from delam_fem.paper.lab import (
    BEATS,
    FREQUENCIES,
    RESONANT,
    Laboratory,
    PaperMethod,
    both_methods,
    strikes,
)
from delam_fem.paper.measures import MotionNumbers, motion_numbers, tip_positions
from delam_fem.results.figures.style import (
    GAP_COLOUR,
    HISTORY_PERIODS,
    LAMINA_COLOURS,
    WIDTH,
    label_x,
    legend_above,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

LARGE = 0.1
"""A contact phase longer than this share of the period counts as relatively large."""


@dataclass(frozen=True)
class Histories(Numbers):
    """The four motions by both methods.

    Attributes:
        motions: numbers of each motion, by frequency [Hz] and method.
        curves: t/T and the positions of both tips, shapes (n,) and (2, n) [mm], by frequency [Hz]
            and method.
        approach: mean speed of approach before strikes by method 3.2, by frequency [m/s].
        strongest_impulses: largest impulse at 1.25 Hz and at 3.25 Hz by method 3.2 [N s].
        farthest_impact: largest distance of an impact from the clamp, 1.25 Hz, method 3.2 [m].
        length: length of the laminae [m].
    """

    motions: dict[tuple[float, PaperMethod], MotionNumbers]
    curves: dict[tuple[float, PaperMethod], tuple[FloatArray, FloatArray]]
    approach: dict[float, float]
    strongest_impulses: tuple[float, float]
    farthest_impact: float
    length: float

    def to_json(self) -> Mapping[str, Any]:
        """Return the motions, with keys in words."""
        return {f"{f:g} Hz, {m}": motion.to_json() for (f, m), motion in self.motions.items()}


def measure(lab: Laboratory) -> Histories:
    """Compute the four motions by both methods."""
    found = both_methods(lab)
    low, thick = found[FREQUENCIES[0], "3.2"], found[RESONANT, "3.2"]
    x = low.history["x"].to_numpy()[low.history["event_node"].to_numpy()]
    weak, strong = (float(r.history["event_impulse"].max()) for r in (low, thick))
    return Histories(
        motions={key: motion_numbers(result) for key, result in found.items()},
        curves={key: tip_positions(result, HISTORY_PERIODS) for key, result in found.items()},
        approach={f: strikes(found[f, "3.2"]).approach for f in FREQUENCIES},
        strongest_impulses=(weak, strong),
        farthest_impact=float(x.max(initial=0.0)),
        length=low.case.lamina[0].length,
    )


def draw(numbers: Histories) -> Figure:
    """Draw the positions of both tips over four periods at four frequencies, by both methods."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(WIDTH, 9.6), layout="constrained")
    panels = figure.subplots(4, 2, sharex=True, sharey="row")
    for (frequency, method), (t, y) in numbers.curves.items():
        panel = panels[FREQUENCIES.index(frequency), int(method == "3.2")]
        panel.fill_between(t, y[0], y[1], where=y[1] >= y[0], color=GAP_COLOUR)
        for i in range(2):
            panel.plot(t, y[i], color=LAMINA_COLOURS[i], label=f"$y_{i + 1}$")
        letter = "abcd"[FREQUENCIES.index(frequency)]
        panel.set_title(f"[{letter}] {frequency:.2f} Hz, method {method}", loc="left")
        panel.margins(x=0.0)
    for row in panels:
        row[0].set_ylabel("tip [mm]")
    label_x(panels.flat, "time t/T [–]")
    legend_above(panels[0, 1])
    return figure


def judge(numbers: Histories) -> tuple[Claim, ...]:
    """Judge the paper's statements about the four motions, with method 3.2."""
    return (
        *_claims_without_tip_contact(numbers),
        *_claims_on_strikes(numbers),
        _claim_on_contact_phase(numbers),
    )


def _claims_without_tip_contact(numbers: Histories) -> tuple[Claim, Claim]:
    """Judge the statements about the motion at 1.25 Hz."""
    low = numbers.motions[FREQUENCIES[0], "3.2"]
    d, (weak, strong) = low.distortion_factor, numbers.strongest_impulses
    reach, length = numbers.farthest_impact, numbers.length
    return (
        Claim(
            "3", "1.25 Hz: almost harmonic, no contact at the tip", "sec. 2.2",
            f"d = {100 * d[0]:.3f} / {100 * d[1]:.3f} %, {low.kind}, smallest tip gap "
            f"{1e3 * low.minimum_tip_gap:.1f} mm",
            *judged(
                *low.criteria(1),
                Criterion("larger d", max(d), "<", 0.01, "%"),
                Criterion("smallest tip gap", 1e3 * low.minimum_tip_gap, ">", 0.0, "mm"),
            ),
        ),
        Claim(
            "3", "1.25 Hz: weak contacts near the clamp", "sec. 2.2",
            f"impacts up to x = {1e3 * reach:.0f} mm of {1e3 * length:.0f}, the strongest "
            f"{100 * weak / strong:.1f} % of that at 3.25 Hz",
            *judged(
                Criterion("farthest impact over length", reach / length, ">", 0.0, "%"),
                Criterion("farthest impact over length", reach / length, "<", 0.5, "%"),
                Criterion("strongest impulse over that at 3.25 Hz", weak / strong, "<", 0.1, "%"),
            ),
        ),
    )  # fmt: skip


def _claims_on_strikes(numbers: Histories) -> tuple[Claim, ...]:
    """Judge the statements about the motions whose tips strike one another."""
    thin, thick, double = (numbers.motions[f, "3.2"] for f in FREQUENCIES[1:])
    speeds = numbers.approach
    others = max(speed for f, speed in speeds.items() if f != RESONANT)
    v = [motion.strike_velocities for motion in (thin, thick)]
    beats = [Criterion("thin over thick speed", abs(v[0][1] / v[0][0]), ">", BEATS)]
    opposite = [
        Criterion("thick", v[1][0], ">", 0.0, "m/s"),
        Criterion("thin", v[1][1], "<", 0.0, "m/s"),
    ]
    return (
        Claim(
            "3", "1.60 Hz: the thin lamina beats the thick one", "sec. 2.2", thin.kind,
            *judged(*thin.criteria(1), *beats),
        ),
        Claim(
            "3", "3.25 Hz: the thick beats the thin, opposite velocities before contact",
            "sec. 2.2", thick.kind, *judged(*thick.criteria(1), *opposite),
        ),
        Claim(
            "3", "3.25 Hz gives the maximum strike of all", "sec. 2.2",
            "speed of approach before the strike: "
            + ", ".join(f"{speeds[f]:.2f} m/s at {f:.2f} Hz" for f in FREQUENCIES[1:]),
            *judged(Criterion("3.25 Hz over the next", speeds[RESONANT] / others, ">", 1.0)),
        ),
        Claim(
            "3", "3.65 Hz: period doubling, one contact in two periods", "sec. 2.2",
            double.kind, *judged(*double.criteria(2)),
        ),
    )  # fmt: skip


def _claim_on_contact_phase(numbers: Histories) -> Claim:
    """Judge how long the tips stay near one another."""
    share = [numbers.motions[f, "3.2"].near_share for f in FREQUENCIES[1:]]
    return Claim(
        "3", "1.60 … 3.65 Hz: the interval of contact is relatively large", "sec. 2.2",
        "the tips are less than 1 mm apart for "
        + ", ".join(f"{100 * s:.0f} %" for s in share)
        + " of the time; the tip pair itself is closed for a few steps at each strike",
        *judged(Criterion("smallest share", min(share), ">", LARGE, "%")),
    )  # fmt: skip


HISTORIES = Piece(
    "3",
    "Time histories",
    "Positions y₁ = q₁ and y₂ = g₀(L) + q₂ of both tips. The paper shows measured histories "
    "(Fig. 3) and those of method 3.2 (Fig. 12); only what its text says of them is compared.",
    measure,
    draw,
    judge,
)
