"""Fig. 7 of the paper: a strip whose tip falls on a block."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from delam_fem.paper.claims import Claim, Criterion, Numbers, Piece, judged
from delam_fem.paper.lab import Laboratory
from delam_fem.paper.lateral.figures import TipBlock, figure07, tip_block

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MUCH_SMALLER = 0.5
STRONGLY = 0.5
"""The contact dissipates strongly if it takes more than this share of the energy."""
NO_REBOUND = 0.05
"""A rebound below this share of the speed or height before the impact counts as none."""
PEAK_US = 30.0
"""Duration of the force peak in the paper [µs]."""
EXTREMELY_SHORT = 0.01
"""A time below this share of the lowest period counts as extremely short."""


@dataclass(frozen=True)
class StruckTip(Numbers):
    """The results of a strip whose tip falls on a block.

    Attributes:
        values: numbers by name, from `TipBlock.numbers`.
        block: the computed signals.
    """

    values: Mapping[str, Any]
    block: TipBlock

    def to_json(self) -> Mapping[str, Any]:
        """Return the values."""
        return self.values


def struck_block(lab: Laboratory) -> TipBlock:
    """Compute the second experiment once; other computations may run at the same time."""
    return lab.begin("tip block", tip_block).result()


def measure(lab: Laboratory) -> StruckTip:
    """Compute the second experiment."""
    block = struck_block(lab)
    return StruckTip(block.numbers(), block)


def draw(numbers: StruckTip) -> Figure:
    """Draw strains and contact force of a strip whose tip falls on a block."""
    return figure07(numbers.block)


def judge(numbers: StruckTip) -> tuple[Claim, ...]:
    """Judge force, rebound, energy and wave of the tip's impact."""
    return (
        _claim_on_peak(numbers.values),
        *_claims_on_rebound(numbers.values),
        *_claims_on_wave(numbers.values),
    )


def _claim_on_peak(values: Mapping[str, Any]) -> Claim:
    """Judge the duration of the force peak."""
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
        *judged(
            Criterion("shortest", blocks[hard], "<", PEAK_US, "µs"),
            Criterion("longest", blocks[soft], ">", PEAK_US, "µs"),
            Criterion("longest over period", blocks[soft] / period, "<", EXTREMELY_SHORT, "%"),
        ),
    )  # fmt: skip


def _claims_on_rebound(values: Mapping[str, Any]) -> tuple[Claim, ...]:
    """Judge the rebound, and the energy that the contact takes."""
    after, spring = values["restitution_after_peak"], values["spring"]
    first_mode = spring["restitution_of_first_mode"]
    dissipated = spring["lost_to_damping"] + spring["lost_at_impacts"]
    return (
        Claim(
            "7", "no snap-back in the time scope of the impact", "sec. 2.3",
            f"the tip leaves the first peak at {100 * after:.1f} % of its speed before, without "
            "any restitution given",
            *judged(Criterion("speed after", abs(after), "<", NO_REBOUND, "%")),
        ),
        Claim(
            "7", "a snap-back in the ensuing oscillation cannot be excluded", "sec. 2.3",
            f"the last push comes after {spring['last_push_ms']:.1f} ms; then the first "
            f"mode swings back at {100 * first_mode:.0f} % of its speed",
            *judged(Criterion("swings back at", first_mode, ">", NO_REBOUND, "%")),
        ),
        Claim(
            "7", "strong energy dissipation during the contact", "sec. 2.3",
            f"only {100 * dissipated:.0f} % of the energy is dissipated within 8 ms, by the "
            "material; "
            f"the first mode has {100 * spring['first_mode_after']:.0f} % of the energy "
            f"({100 * spring['first_mode_before']:.0f} % before) and looks strongly damped, but "
            "the rest still waves; impacts on a rigid block with e = 0 take "
            f"{100 * values['rigid']['lost_at_impacts']:.0f} %",
            *judged(Criterion("dissipated", dissipated, ">", STRONGLY, "%")),
        ),
    )  # fmt: skip


def _claims_on_wave(values: Mapping[str, Any]) -> tuple[Claim, ...]:
    """Judge the strain wave that the block sends."""
    near, far = values["peak_wave_strain_max_exact"]
    whole = values["wave_strain_max"][1]
    waves, lower = values["half_wave_Hz"], values["timoshenko_lowers_by"]
    speeds = values["mean_wave_speed_m_s"], values["longitudinal_speed_m_s"]
    return (
        Claim(
            "7", "the strain wave decays with the distance from the impact", "sec. 2.3",
            f"exact, without a clamp: the peak alone sends {1e6 * far:.0f} µm/m half-way, "
            f"{1e6 * near:.0f} µm/m to the clamp; computed half-way, before the clamp's answer: "
            f"{1e6 * whole:.0f} µm/m; the slow part that the lasting contact sends does not decay",
            *judged(Criterion("at the clamp over half-way", near / far, "<", 1.0)),
        ),
        Claim(
            "7", "the mean wave velocity is much smaller than the longitudinal one", "sec. 2.3",
            f"{speeds[0]:.0f} m/s to the second gauge, longitudinal {speeds[1]:.0f} m/s; shear and "
            "rotary inertia (Timoshenko), which are left out, would lower the group speeds by "
            f"{100 * min(lower):.0f} to {100 * max(lower):.0f} % at "
            f"{1e-3 * min(waves):.0f} to {1e-3 * max(waves):.0f} kHz",
            *judged(Criterion("ratio", speeds[0] / speeds[1], "<", MUCH_SMALLER)),
        ),
    )  # fmt: skip


STRUCK_TIP = Piece(
    "7",
    "Strain and contact force",
    "A steel strip, lowest period 50 ms, with its tip alone over a block, lifted by 50 mm and "
    "let go (without its weight, which moves the tip by 1 mm): strains near the clamp [1] and "
    "half-way [2], contact force [3], the wave that the block sends and its dispersion. Dotted: "
    "the dispersion with shear and rotary inertia (Timoshenko), which the computation leaves out. "
    "The stiffness of the block is chosen such that the exact beam has a peak of 30 µs. The "
    "paper's signals are not available; compared is what its text says of them.",
    measure,
    draw,
    judge,
)
