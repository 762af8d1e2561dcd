"""The paper's remarks on its numerical parameters: the threshold γ and the time integration."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from delam_fem.model import linear
from delam_fem.model.beams import closed_form
from delam_fem.numerics.arrays import FloatArray
from delam_fem.paper.claims import NOT_IN_JSON, Claim, Criterion, Numbers, Piece, judged
from delam_fem.paper.lab import FREQUENCIES, RESONANT, Laboratory, motion_case
from delam_fem.paper.measures import half_ranges
from delam_fem.results.figures.style import (
    BASE_COLOUR,
    BLUE,
    GREEN,
    VERMILLION,
    WIDTH,
    label_x,
    legend_above,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from delam_fem.results.folder import Result

CLAPPING = FREQUENCIES[1:]
"""The excitation frequencies at which the tips meet [Hz]."""
THRESHOLDS = (1e-5, 1e-1)
PRINTED = 0.5e-3
"""γ of the paper [m/s]."""
SLIGHT = 0.05
"""A change of the amplitude by less than this share of its mean counts as slight."""
MODERATE = 0.011
"""Upper end of moderate thresholds, about twenty times the printed one [m/s]."""
ORDER = 3.0
"""A number counts as "close to" another one if their ratio is below this factor."""


@dataclass(frozen=True)
class Threshold(Numbers):
    """The motions with other thresholds γ. Dictionaries are by frequency; their lists run over γ.

    Attributes:
        gamma_m_s: values of γ, shape (n,).
        staying_share: share of the impacts that are followed by permanent contact [-].
        amplitude_mm: half peak-to-peak of both tips, each of shape (2,).
        periodicity: class of the motion in words.
        contacts: tip contacts per period.
        largest_tip_gap_rate_m_s: largest gap rate of the tips at 3.25 Hz with the paper's γ.
        central_difference_steps_per_period: smallest number of steps per period at which the
            central difference is stable.
        impacts_per_period: impacts per period on all pairs.
    """

    gamma_m_s: FloatArray
    staying_share: dict[str, list[float]]
    amplitude_mm: dict[str, list[FloatArray]]
    periodicity: dict[str, list[str | None]]
    contacts: dict[str, list[float]]
    largest_tip_gap_rate_m_s: float
    central_difference_steps_per_period: float
    impacts_per_period: dict[str, list[float]] = field(metadata=NOT_IN_JSON)


def measure(lab: Laboratory) -> Threshold:
    """Compute the motions with tip contact over γ, and the limit of the central difference."""
    gammas = np.geomspace(*THRESHOLDS, lab.plan.thresholds)
    found = {f"{f:g}": _study(lab, f, gammas) for f in CLAPPING}
    (printed,) = lab.motions([motion_case(RESONANT, lab.plan)])
    rate, case = printed.history["tip_velocity"].to_numpy(), printed.case
    limit = linear.largest_stable_time_step(closed_form.assemble(case).operators, 100.0)

    def over_gamma(name: str) -> dict[str, list[Any]]:
        return {f: [r.summary[name] for r in results] for f, results in found.items()}

    return Threshold(
        gamma_m_s=gammas,
        staying_share={
            f: [staying_share(r, g) for r, g in zip(results, gammas, strict=True)]
            for f, results in found.items()
        },
        amplitude_mm={f: [1e3 * half_ranges(r) for r in rs] for f, rs in found.items()},
        periodicity=over_gamma("periodicity_class"),
        contacts=over_gamma("tip_contacts_per_period"),
        largest_tip_gap_rate_m_s=float(np.abs(rate[1] - rate[0]).max()),
        central_difference_steps_per_period=float(case.period / limit),
        impacts_per_period=over_gamma("impacts_per_period"),
    )


def staying_share(result: Result, gamma: float) -> float:
    """Return the share of the impacts after which the gap rate e |U̇⁻| is below γ [-]."""
    before = -result.history["event_velocity_before"].to_numpy()
    if not before.size:
        return 0.0
    return float((result.case.contact.restitution * before < gamma).mean())


def _study(lab: Laboratory, frequency: float, gammas: FloatArray) -> list[Result]:
    """Compute the motion at a frequency with each value of γ."""
    keys = [{"contact.threshold_velocity": float(g)} for g in gammas]
    return lab.motions([motion_case(frequency, lab.plan, "3.2", key) for key in keys])


def draw(numbers: Threshold) -> Figure:
    """Draw permanent contacts, amplitudes and impacts of the motions over γ."""
    from matplotlib.figure import Figure

    gammas = numbers.gamma_m_s
    figure = Figure(figsize=(WIDTH, 7.6), layout="constrained")
    panels = figure.subplots(3, 1, sharex=True)
    for f, colour, marker in zip(CLAPPING, (BLUE, VERMILLION, GREEN), "osv", strict=True):
        key = f"{f:g}"
        style = {"color": colour, "marker": marker, "markersize": 4, "label": f"{f:.2f} Hz"}
        thick, thin = np.transpose(numbers.amplitude_mm[key])
        panels[0].semilogx(gammas, 100.0 * np.array(numbers.staying_share[key]), **style)
        panels[1].semilogx(gammas, thick, **style)
        panels[1].semilogx(gammas, thin, **{**style, "linestyle": "--", "label": None})
        panels[2].semilogx(gammas, numbers.impacts_per_period[key], **style)
    panels[0].set_ylabel("impacts followed by\npermanent contact [%]")
    panels[1].set_ylabel("half peak-to-peak [mm]\nthick –, thin - -")
    label_x(panels, "threshold γ [m/s]")
    panels[2].set(ylabel="impacts per period", yscale="log")
    for panel in panels:
        panel.axvline(PRINTED, color=BASE_COLOUR, linestyle=":")
    legend_above(panels[0])
    return figure


def _spread(amplitudes: FloatArray) -> float:
    """Return the range of amplitudes over γ relative to their mean; the larger of both tips.

    Args:
        amplitudes: half peak-to-peak of both tips for each γ, shape (n, 2).
    """
    return float(np.max(np.ptp(amplitudes, axis=0) / amplitudes.mean(axis=0)))


def judge(numbers: Threshold) -> tuple[Claim, ...]:
    """Judge the paper's statements about γ and the central difference scheme."""
    ends = [(f, (s[0], s[-1])) for f, s in numbers.staying_share.items()]
    spread, moderate = (
        {f: _spread(np.array(a)[chosen]) for f, a in numbers.amplitude_mm.items()}
        for chosen in (slice(None), numbers.gamma_m_s <= MODERATE)
    )
    periods = {f: sorted({str(p) for p in ps}) for f, ps in numbers.periodicity.items()}
    rate = numbers.largest_tip_gap_rate_m_s
    steps = numbers.central_difference_steps_per_period
    return (
        Claim(
            "gamma", "larger γ: most contacts are followed by permanent contact", "sec. 3.2",
            "share of impacts followed by it, γ = 1e-5 → 0.1 m/s: "
            + ", ".join(f"{100 * a:.0f} → {100 * b:.0f} % at {f} Hz" for f, (a, b) in ends),
            *judged(Criterion("smallest share", min(b for _, (_, b) in ends), ">", 0.5, "%")),
        ),
        Claim(
            "gamma", "such a choice mostly induces slight differences", "sec. 3.2",
            "half peak-to-peak amplitudes vary by up to "
            + ", ".join(f"{100 * v:.0f} % at {f} Hz" for f, v in spread.items())
            + f" over four decades of γ, by up to {100 * max(moderate.values()):.0f} % below "
            f"{MODERATE:g} m/s; "
            + ", ".join(f"{' or '.join(p)} at {f} Hz" for f, p in periods.items()),
            *judged(Criterion("second smallest", sorted(spread.values())[1], "<", SLIGHT, "%")),
        ),
        Claim(
            "gamma", "γ is close to the thousandth part of the maximum relative velocity",
            "sec. 3.2",
            f"largest gap rate of the tips at 3.25 Hz: {rate:.2f} m/s; γ is 1/{rate / PRINTED:.0f} "
            "of it",
            *judged(
                Criterion("rate/γ over 1000", rate / PRINTED / 1000.0, ">", 1.0 / ORDER),
                Criterion("rate/γ over 1000", rate / PRINTED / 1000.0, "<", ORDER),
            ),
        ),
        Claim(
            "gamma", "the central difference scheme may also be appropriate", "sec. 3.1",
            f"with the consistent mass it is stable from {np.ceil(steps):.0f} steps per period on, "
            "not with the paper's 1000",
            *judged(Criterion("steps per period", steps, "<", 1001.0)),
        ),
    )  # fmt: skip


THRESHOLD = Piece(
    "gamma",
    "The threshold γ",
    "Method 3.2 with other thresholds γ, all else as printed (dotted: the paper's γ). The "
    "paper tells of such computations without showing them.",
    measure,
    draw,
    judge,
)
