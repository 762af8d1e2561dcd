"""Figs. 6 and 7 of the paper: its claims about lateral impacts beside what lateral.py computes."""

from __future__ import annotations

from typing import Any

from delam_fem.lateral import RollingStudy, TipBlock, rolling_study, tip_block
from delam_fem.lateral_figures import figure06, figure07
from delam_fem.paper_claims import Claim, Piece, judged
from delam_fem.paper_lab import Laboratory

NEARLY_ALL = 0.9
"""Share of the energy that counts as nearly all."""
MUCH_SMALLER = 0.5
NO_REBOUND = 0.05
"""Share of the speed before that counts as none after."""
FROM_CLAMP = 0.5
"""Rank correlation of place and time from which on the contact line runs from clamp to tip."""


def rolling_strip(lab: Laboratory) -> Piece:
    """Draw the set-up, and the strip that falls on the ground along which it lies."""
    study, block = _computed(lab)
    numbers = study.numbers()
    caption = (
        "Above: the second experiment. Below: a steel strip (lowest period 50 ms) that lies on "
        "rigid ground, is lifted by 50 mm and let go; how it is lifted is not told and decides "
        "where it lands first. Ladders show where the energy goes with other meshes and steps. "
        "Nothing is printed of the strip: compared is what the text says."
    )
    figure = figure06(study, block)
    return Piece("6", "Lateral impact of a strip", caption, figure, numbers, _rolling(numbers))


def struck_tip(lab: Laboratory) -> Piece:
    """Draw strains and contact force of a strip whose tip falls on a block."""
    _, block = _computed(lab)
    numbers = block.numbers()
    caption = (
        "The same strip with its tip alone over a block, lifted by 50 mm and let go: strains near "
        "the clamp [1] and half-way [2], contact force [3], the wave that the block sends and its "
        "dispersion. The stiffness of the block is chosen such that the exact beam has a peak of "
        "30 µs. The paper's signals are not available; compared is what its text says of them."
    )
    figure = figure07(block)
    return Piece("7", "Strain and contact force", caption, figure, numbers, _block(numbers))


def _computed(lab: Laboratory) -> tuple[RollingStudy, TipBlock]:
    """Compute both experiments at the same time."""
    study = lab.begin("rolling study", rolling_study, fast=not lab.plan.has_long_ladders)
    block = lab.begin("tip block", tip_block)
    return study.result(), block.result()


def _rolling(numbers: dict[str, Any]) -> tuple[Claim, ...]:
    lifts, force = numbers["by_lift"], numbers["by_lift"]["tip force"]
    direction = {name: run["front_direction"] for name, run in lifts.items()}
    shares = force["shares_1ms_after_landing"]
    rebound = ", ".join(f"{100 * r['rebound_of_tip']:.0f} % ({n})" for n, r in lifts.items())
    taken = [
        rung["impacts"]
        for rung in numbers["ladder"]
        if rung["law"] == "moreau" and rung["outcome"] == "completed"
    ]
    return (
        Claim(
            "6", "a contact line that evolves from the clamped end to the free one", "sec. 2.3",
            "rank correlation of place and time of contact: "
            + ", ".join(f"{value:+.2f} lifted by {name}" for name, value in direction.items())
            + ": it depends on how the strip is lifted",
            judged(direction["tip force"] > FROM_CLAMP), True,
        ),
        Claim(
            "6", "total dissipation of the energy into the surface", "sec. 2.3",
            f"1 ms after landing {100 * shares['lost']:.0f} % are lost (lifted at the tip): "
            f"{100 * shares['impacts']:.0f} % at impacts, {100 * shares['damping']:.0f} % to "
            "material damping of the waves that impacts make; over meshes and time steps (moreau) "
            f"impacts take {100 * min(taken):.0f} to {100 * max(taken):.0f} %",
            judged(shares["lost"] > NEARLY_ALL), True,
        ),
        Claim(
            "6", "no snap-back occurs", "sec. 2.3",
            f"within 40 ms the tip rises again to {rebound} of the height it fell from",
            judged(all(run["rebound_of_tip"] < NO_REBOUND for run in lifts.values())),
        ),
    )  # fmt: skip


def _block(numbers: dict[str, Any]) -> tuple[Claim, ...]:
    near, far = numbers["wave_strain_max"]
    window = numbers["undisturbed_us"]
    speeds = numbers["mean_wave_speed_m_s"], numbers["longitudinal_speed_m_s"]
    first_mode = numbers["spring"]["restitution_of_first_mode"]
    after = numbers["restitution_after_peak"]
    return (
        Claim(
            "7", "a force peak of about 30 µs, extremely short beside the period of 50 ms",
            "sec. 2.3",
            f"{numbers['peak_duration_us']:.1f} µs, {1e-3 * numbers['peak_force_N']:.1f} kN; strip "
            f"({numbers['lowest_period_ms']:.1f} ms) and block are chosen for it", "open",
        ),
        Claim(
            "7", "no snap-back in the time scope of the impact", "sec. 2.3",
            f"the tip leaves the first peak at {100 * after:.1f} % of its speed before, without "
            "any restitution given",
            judged(abs(after) < NO_REBOUND), True,
        ),
        Claim(
            "7", "a snap-back in the ensuing oscillation cannot be excluded", "sec. 2.3",
            f"the last push comes after {numbers['spring']['last_push_ms']:.1f} ms; then the first "
            f"mode swings back at {100 * first_mode:.0f} % of its speed",
            judged(first_mode > NO_REBOUND),
        ),
        Claim(
            "7", "the strain wave decays with the distance from the impact", "sec. 2.3",
            f"largest strain of the wave until the clamp sends it back ({window:.0f} µs): "
            f"{1e6 * far:.0f} µm/m half-way, {1e6 * near:.0f} µm/m near the clamp, where its slow "
            "part has not arrived by then", "open",
        ),
        Claim(
            "7", "the mean wave velocity is much smaller than the longitudinal one", "sec. 2.3",
            f"{speeds[0]:.0f} m/s to the second gauge, longitudinal {speeds[1]:.0f} m/s",
            judged(speeds[0] < MUCH_SMALLER * speeds[1]), True,
        ),
    )  # fmt: skip
