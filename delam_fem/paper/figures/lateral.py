"""Figs. 6 and 7 of the paper: lateral impacts of a strip, computed and drawn in `paper.lateral`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Self

from delam_fem.paper.claims import Claim, judged
from delam_fem.paper.lab import Laboratory
from delam_fem.paper.lateral.rolling_figure import figure06
from delam_fem.paper.lateral.studies import (
    LONG,
    RollingStudy,
    TipBlock,
    rolling_study,
    tip_block,
)
from delam_fem.paper.lateral.tip_figure import figure07
from delam_fem.paper.piece import NOT_IN_JSON, Numbers, Piece

if TYPE_CHECKING:
    from matplotlib.figure import Figure

NEARLY_ALL = 0.9
"""Share of the energy that counts as nearly all."""
MUCH_SMALLER = 0.5
STRONGLY = 0.5
"""Share of the energy before up to which the contact has dissipated strongly."""
NO_REBOUND = 0.05
"""Share of the speed or height before that counts as none after."""
FROM_CLAMP = 0.5
"""Rank correlation of place and time from which on the contact line runs from clamp to tip."""
PEAK_US = 30.0
"""Duration of the force peak in the paper [µs]."""
EXTREMELY_SHORT = 0.01
"""Share of the lowest period below which a time counts as extremely short."""


# -- Fig. 6: the strip on the ground ----------------------------------------------------------


@dataclass(frozen=True)
class RollingStrip(Numbers):
    """The strip that falls on the ground along which it lies; runs as `Rolling.numbers`.

    Attributes:
        by_law: the thin strip, by the name of the law.
        stiff: the stiff strip.
        by_height_mm: the thin strip, by the height of its tip.
        ladder: shares of the energy, one entry for each `Rung`.
        study: all of it.
        block: the second experiment, whose set-up is drawn.
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


def measure_strip(lab: Laboratory) -> RollingStrip:
    """Compute the first experiment and its variations, and the second one at the same time."""
    begun = lab.begin("rolling study", rolling_study, fast=not lab.plan.has_long_ladders)
    block = _block(lab)
    return RollingStrip.of(begun.result(), block)


def _block(lab: Laboratory) -> TipBlock:
    """Compute the second experiment, while others may be computed."""
    return lab.begin("tip block", tip_block).result()


def draw_strip(numbers: RollingStrip) -> Figure:
    """Draw the set-up, and the strip that falls on the ground along which it lies."""
    return figure06(numbers.study, numbers.block)


def judge_strip(numbers: RollingStrip) -> tuple[Claim, ...]:
    """Judge how a strip lands on the ground, and where its energy goes."""
    return _claim_on_contact_line(numbers), _claim_on_dissipation(numbers), _claim_on_lift(numbers)


def _claim_on_contact_line(numbers: RollingStrip) -> Claim:
    main, stiff = numbers.by_law["moreau"], numbers.stiff
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
        judged(direction > FROM_CLAMP), True,
    )  # fmt: skip


def _claim_on_dissipation(numbers: RollingStrip) -> Claim:
    shares = numbers.by_law["moreau"]["shares_after_landing"]
    taken = [
        rung["impacts"]
        for rung in numbers.ladder
        if rung["law"] == "moreau" and rung["outcome"] == "completed"
    ]
    return Claim(
        "6", "total dissipation of the energy into the surface", "sec. 2.3",
        f"{100 * shares['lost']:.0f} % are lost 2 % of the lowest period after landing: "
        f"{100 * shares['impacts']:.0f} % at impacts, {100 * shares['damping']:.0f} % to "
        "material damping of the waves that impacts make; over meshes and time steps, with and "
        f"without damping (moreau), impacts take {100 * min(taken):.0f} to "
        f"{100 * max(taken):.0f} %",
        judged(shares["lost"] > NEARLY_ALL), True,
    )  # fmt: skip


def _claim_on_lift(numbers: RollingStrip) -> Claim:
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
        judged(max(lift_offs) < NO_REBOUND),
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
    measure_strip,
    draw_strip,
    judge_strip,
)


# -- Fig. 7: the tip on the block -------------------------------------------------------------


@dataclass(frozen=True)
class StruckTip(Numbers):
    """The strip whose tip falls on a block.

    Attributes:
        values: by name, as `TipBlock.numbers` returns them.
        block: the signals.
    """

    values: Mapping[str, Any]
    block: TipBlock

    def to_json(self) -> Mapping[str, Any]:
        """Return the values."""
        return self.values


def measure_tip(lab: Laboratory) -> StruckTip:
    """Compute the second experiment."""
    block = _block(lab)
    return StruckTip(block.numbers(), block)


def draw_tip(numbers: StruckTip) -> Figure:
    """Draw strains and contact force of a strip whose tip falls on a block."""
    return figure07(numbers.block)


def judge_tip(numbers: StruckTip) -> tuple[Claim, ...]:
    """Judge force, rebound, energy and wave of the tip's impact."""
    return (
        _claim_on_peak(numbers.values),
        *_claims_on_rebound(numbers.values),
        *_claims_on_wave(numbers.values),
    )


def _claim_on_peak(values: Mapping[str, Any]) -> Claim:
    duration, blocks = values["peak_duration_us"], values["duration_of_block_us"]
    soft, hard = min(blocks, key=float), max(blocks, key=float)
    period = 1e3 * values["lowest_period_ms"]
    return Claim(
        "7", "a force peak of about 30 µs, extremely short beside the period of 50 ms",
        "sec. 2.3",
        f"{duration:.1f} µs (1/{period / duration:.0f} of the period) and "
        f"{1e-3 * values['peak_force_N']:.1f} kN with a block of "
        f"{1e-6 * values['block_stiffness_N_m']:.0f} N/µm, "
        f"which is chosen for it; blocks of {1e-6 * float(soft):g} to {1e-6 * float(hard):g} "
        f"N/µm have {blocks[soft]:.0f} to {blocks[hard]:.0f} µs",
        judged(blocks[hard] < PEAK_US < blocks[soft] < EXTREMELY_SHORT * period),
    )  # fmt: skip


def _claims_on_rebound(values: Mapping[str, Any]) -> tuple[Claim, ...]:
    after, spring = values["restitution_after_peak"], values["spring"]
    first_mode = spring["restitution_of_first_mode"]
    return (
        Claim(
            "7", "no snap-back in the time scope of the impact", "sec. 2.3",
            f"the tip leaves the first peak at {100 * after:.1f} % of its speed before, without "
            "any restitution given",
            judged(abs(after) < NO_REBOUND), True,
        ),
        Claim(
            "7", "a snap-back in the ensuing oscillation cannot be excluded", "sec. 2.3",
            f"the last push comes after {spring['last_push_ms']:.1f} ms; then the first "
            f"mode swings back at {100 * first_mode:.0f} % of its speed",
            judged(first_mode > NO_REBOUND),
        ),
        Claim(
            "7", "strong energy dissipation during the contact", "sec. 2.3",
            f"after it the first mode has {100 * spring['first_mode_after']:.0f} % of the energy "
            f"({100 * spring['first_mode_before']:.0f} % before): "
            f"{100 * spring['lost_to_damping']:.0f} % went to material damping, the rest is in "
            f"waves; impacts on a rigid block with e = 0 take "
            f"{100 * values['rigid']['lost_at_impacts']:.0f} %",
            judged(spring["first_mode_after"] < STRONGLY * spring["first_mode_before"]),
        ),
    )  # fmt: skip


def _claims_on_wave(values: Mapping[str, Any]) -> tuple[Claim, ...]:
    near, far = values["peak_wave_strain_max_exact"]
    whole = values["wave_strain_max"][1]
    speeds = values["mean_wave_speed_m_s"], values["longitudinal_speed_m_s"]
    return (
        Claim(
            "7", "the strain wave decays with the distance from the impact", "sec. 2.3",
            f"exact, without a clamp: the peak alone sends {1e6 * far:.0f} µm/m half-way, "
            f"{1e6 * near:.0f} µm/m to the clamp; computed half-way, before the clamp's answer: "
            f"{1e6 * whole:.0f} µm/m; the slow part that the lasting contact sends does not decay",
            judged(near < far),
        ),
        Claim(
            "7", "the mean wave velocity is much smaller than the longitudinal one", "sec. 2.3",
            f"{speeds[0]:.0f} m/s to the second gauge, longitudinal {speeds[1]:.0f} m/s",
            judged(speeds[0] < MUCH_SMALLER * speeds[1]), True,
        ),
    )  # fmt: skip


STRUCK_TIP = Piece(
    "7",
    "Strain and contact force",
    "A steel strip, lowest period 50 ms, with its tip alone over a block, lifted by 50 mm and "
    "let go (without its weight, which moves the tip by 1 mm): strains near the clamp [1] and "
    "half-way [2], contact force [3], the wave that the block sends and its dispersion. The "
    "stiffness of the block is chosen such that the exact beam has a peak of 30 µs. The "
    "paper's signals are not available; compared is what its text says of them.",
    measure_tip,
    draw_tip,
    judge_tip,
)
