"""Fig. 6 of the paper: a strip that falls on the ground on which it lies."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Self

from delam_fem.paper.claims import NOT_IN_JSON, Claim, Criterion, Numbers, Piece, judged
from delam_fem.paper.figures.struck_tip import NO_REBOUND, struck_block
from delam_fem.paper.lab import Laboratory
from delam_fem.paper.lateral.figures import LONG, RollingStudy, TipBlock, figure06, rolling_study

if TYPE_CHECKING:
    from matplotlib.figure import Figure

NEARLY_ALL = 0.9
"""A share of the energy above this counts as nearly all."""
FROM_CLAMP = 0.5
"""With a larger rank correlation of place and time, the contact line runs from clamp to tip."""


@dataclass(frozen=True)
class RollingStrip(Numbers):
    """The strip that falls on the ground on which it lies; each run as in `Rolling.numbers`.

    Attributes:
        by_law: runs of the thin strip, by the name of the law.
        stiff: run of the stiff strip.
        by_height_mm: runs of the thin strip, by the height of its tip.
        ladder: shares of the energy, one entry for each `StripRung`.
        study: all results of the first experiment.
        block: results of the second experiment, whose set-up is drawn.
    """

    by_law: Mapping[str, Mapping[str, Any]]
    stiff: Mapping[str, Any]
    by_height_mm: Mapping[str, Mapping[str, Any]]
    ladder: Sequence[Mapping[str, Any]]
    study: RollingStudy = field(metadata=NOT_IN_JSON)
    block: TipBlock = field(metadata=NOT_IN_JSON)

    @classmethod
    def of(cls, study: RollingStudy, block: TipBlock) -> Self:
        """Return the numbers of a study."""
        return cls(**study.numbers(), study=study, block=block)


def measure(lab: Laboratory) -> RollingStrip:
    """Compute the first experiment and its variations; compute the second at the same time."""
    begun = lab.begin("rolling study", rolling_study, fast=not lab.plan.has_long_ladders)
    block = struck_block(lab)
    return RollingStrip.of(begun.result(), block)


def draw(numbers: RollingStrip) -> Figure:
    """Draw the set-up, and the results of the strip that falls on the ground on which it lies."""
    return figure06(numbers.study, numbers.block)


def judge(numbers: RollingStrip) -> tuple[Claim, ...]:
    """Judge the landing of a strip on the ground, and the loss of its energy."""
    return _claim_on_contact_line(numbers), _claim_on_dissipation(numbers), _claim_on_lift(numbers)


def _claim_on_contact_line(numbers: RollingStrip) -> Claim:
    """Judge the direction in which the contact line runs."""
    main, stiff = numbers.by_law["newton@moreau-jean"], numbers.stiff
    direction, sag = main["front_direction"], main["sag_mm"]
    rolled = [
        run["height_mm"] / sag
        for run in numbers.by_height_mm.values()
        if run["front_direction"] > FROM_CLAMP
    ]
    strip = f"{1e3 * main['strip']['thickness']:g} mm × {1e3 * main['strip']['length']:.0f} mm"
    reach = f"{min(rolled):.1f} to {max(rolled):.1f}" if rolled else "no"
    return Claim(
        "6", "a contact line that evolves from the clamped end to the free one", "sec. 2.3",
        f"steel {strip} (sags by {sag:.0f} mm under its weight) lifted {main['height_mm']:.0f} "
        f"mm at the tip: rank correlation of place and time of contact {direction:+.2f}, "
        f"{main['front_speed_m_s'] or float('inf'):.0f} m/s; so for heights of {reach} sags; "
        f"a stiff strip ({stiff['height_mm'] / stiff['sag_mm']:.0f} sags) lands tip first "
        f"({stiff['front_direction']:+.2f})",
        *judged(Criterion("rank correlation", direction, ">", FROM_CLAMP)),
    )  # fmt: skip


def _claim_on_dissipation(numbers: RollingStrip) -> Claim:
    """Judge how much of the energy is lost at the landing."""
    shares = numbers.by_law["newton@moreau-jean"]["shares_after_landing"]
    taken = [
        rung["impacts"]
        for rung in numbers.ladder
        if rung["law"] == "newton@moreau-jean" and rung["outcome"] == "completed"
    ]
    return Claim(
        "6", "total dissipation of the energy into the surface", "sec. 2.3",
        f"{100 * shares['lost']:.0f} % are lost 2 % of the lowest period after landing: "
        f"{100 * shares['impacts']:.0f} % at impacts, {100 * shares['damping']:.0f} % to "
        "material damping of the waves that impacts make; over meshes and time steps, with and "
        f"without damping (newton@moreau-jean), impacts take {100 * min(taken):.0f} to "
        f"{100 * max(taken):.0f} %",
        *judged(Criterion("lost", shares["lost"], ">", NEARLY_ALL, "%")),
    )  # fmt: skip


def _claim_on_lift(numbers: RollingStrip) -> Claim:
    """Judge whether the strip lifts off again."""
    stiff = numbers.stiff
    rebounds, lift_offs = (
        [run[name] for run in numbers.by_law.values()] for name in ("rebound_of_tip", "lift_off")
    )
    return Claim(
        "6", "no snap-back or local lift-off", "sec. 2.3",
        f"until {LONG:g} of the lowest period the tip rises again to at most "
        f"{100 * max(rebounds):.1f} % of the height it fell from, any place of the strip to "
        f"{100 * max(lift_offs):.1f} % (three laws); the stiff strip's tip to "
        f"{100 * stiff['rebound_of_tip']:.0f} %",
        *judged(
            Criterion("highest rise of three laws", max(lift_offs), "<", NO_REBOUND, "%")
        ),
    )  # fmt: skip


ROLLING_STRIP = Piece(
    "6",
    "Lateral impact of a strip",
    "Above: the set-up of the second experiment. Below: the first one; a steel strip lies on "
    "rigid ground, is lifted by a force at its tip and let go. Strip and height are not told, "
    "and the ratio of the height to the sag under its own weight decides how it lands: a thin "
    "strip rolls down from the clamp, a stiff one (that of the second experiment, lowest "
    "period 50 ms) lands with its tip first. Energies and ladders are those of the thin strip. "
    "Nothing is printed of the strip: compared is what the text says.",
    measure,
    draw,
    judge,
)
