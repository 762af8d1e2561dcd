"""Fig. 8 of the paper: velocities of the tips, and the coefficient of restitution read off them."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from delam_fem.numerics.arrays import FloatArray
from delam_fem.numerics.restitution import Strike, identify
from delam_fem.paper.claims import Claim, Piece, judged
from delam_fem.paper.lab import RESONANT, Laboratory, motion_case
from delam_fem.results.dataset import Result
from delam_fem.results.style import BLACK, LAMINA_COLOURS, WIDTH, legend_above

SHOWN_PERIODS = 2
MEASURED = (0.0, 0.1)
"""Range of e that the paper's experiment gave."""
MARGIN = 0.05
"""By which a mean of e may lie outside of the measured range."""


def velocities(lab: Laboratory) -> Piece:
    """Draw the tip velocities over two periods with the jumps that e is read off."""
    (result,) = lab.motions([motion_case(RESONANT, lab.plan)])
    strikes = tip_strikes(result)
    history, T = result.history, result.case.period
    time, v = history["time"].to_numpy(), history["tip_velocity"].to_numpy()
    shown = time > time[-1] - SHOWN_PERIODS * T
    start = time[shown][0]
    figure = Figure(figsize=(WIDTH, 7.0), layout="constrained")
    panels = figure.subplots(2, 1)
    for i, colour in enumerate(LAMINA_COLOURS):
        label = f"{result.case.lamina[i].name}  $\\dot y_{i + 1}$"
        panels[0].plot((time[shown] - start) / T, v[i, shown], color=colour, label=label)
    for k, strike in enumerate(s for s in strikes if s.time >= start):
        at = np.full(4, (strike.time - start) / T)
        ends = np.concatenate([strike.before, strike.after])
        name = "before and after the strike" if k == 0 else None
        panels[0].plot(at, ends, "o", color=BLACK, markersize=4, label=name)
    panels[0].set(xlabel="time t/T [–]", ylabel="velocity of the tip [m/s]")
    panels[0].margins(x=0.0)
    legend_above(panels[0])
    number = np.arange(1, len(strikes) + 1)
    e = np.array([s.restitution for s in strikes])
    by_body = np.array([s.restitution_by_body for s in strikes]).reshape(-1, 2)
    panels[1].plot(number, e, "o", color=BLACK, label="eq. 3")
    for i, (marker, colour) in enumerate(zip("^v", LAMINA_COLOURS, strict=True)):
        panels[1].plot(number, by_body[:, i], marker, color=colour, label=f"eq. 4, lamina {i + 1}")
    panels[1].axhspan(*MEASURED, color="#e9e9e9", label="paper's range")
    panels[1].axhline(result.case.contact.restitution, color=BLACK, linewidth=0.8, label="given e")
    panels[1].set(xlabel="number of the strike", ylabel="coefficient of restitution e [–]")
    legend_above(panels[1])
    numbers = {
        "strike_time_s": [s.time for s in strikes],
        "before": [s.before for s in strikes],
        "after": [s.after for s in strikes],
        "restitution": e,
        "restitution_by_lamina": by_body,
        "apparent_mass_ratio": [s.apparent_mass_ratio for s in strikes],
        "mass_ratio": mass_ratio(result),
    }
    caption = (
        f"Method 3.2 at {RESONANT} Hz. e by eq. 3 from the gap rates before and after the strike, "
        "and by eq. 4 (signs corrected) from each lamina with m1/m2 = ρ₁A₁/ρ₂A₂. The paper's "
        "signals are not available; compared is the range of e that it read off them."
    )
    return Piece("8", "Impact-dominated velocities", caption, figure, numbers, _claims(strikes))


def mass_ratio(result: Result) -> float:
    """Return m1/m2 of a result's laminae [-]."""
    thick, thin = result.case.lamina
    return thick.mass_per_length / thin.mass_per_length


def tip_strikes(result: Result) -> tuple[Strike, ...]:
    """Return the strikes of the tips, one a period, with the samples beside the jump as they are.

    Lines through several samples would be bent by the waves that arrive at the tip.
    """
    history = result.history
    return identify(
        history["time"].to_numpy(),
        history["tip_velocity"].to_numpy(),
        mass_ratio(result),
        fit_samples=1,
        apart=0.5 * result.case.period,
        smallest_jump=0.5,
    )


def printed_ratio(before: FloatArray, e: float, mass_ratio: float) -> float:
    """Return the gap rate after over that before by eq. 4 with the signs as printed [-].

    Args:
        before: velocities of lamina 1 and 2, shape (2,) [m/s].
        e: coefficient of restitution [-].
        mass_ratio: m1/m2 [-].
    """
    rate = before[1] - before[0]
    thick = before[0] - (1.0 + e) / (1.0 + mass_ratio) * rate
    thin = before[1] + (1.0 + e) * mass_ratio / (1.0 + mass_ratio) * rate
    return float((thin - thick) / rate)


def _claims(strikes: tuple[Strike, ...]) -> tuple[Claim, ...]:
    e = np.array([s.restitution for s in strikes])
    jump = np.array([np.abs(s.after - s.before).sum() for s in strikes])
    by_body = np.array([s.restitution_by_body for s in strikes])
    mean = float(e.mean())
    printed = float(np.mean([printed_ratio(s.before, mean, s.mass_ratio) for s in strikes]))
    return (
        Claim(
            "8", "velocities jump at the beginning of contact", "sec. 2.3",
            f"{len(strikes)} jumps in 10 periods; the gap rate changes by {jump.mean():.2f} m/s "
            "within one step (T/1000)",
            judged(len(strikes) >= 1),
        ),
        Claim(
            "8", "0 ≤ e ≤ 0.1 from the velocities before and after", "sec. 2.3",
            f"e = {mean:.2f} (from {e.min():.2f} to {e.max():.2f}, {len(strikes)} strikes) by eq. "
            f"3, {by_body[:, 0].mean():.2f} and {by_body[:, 1].mean():.2f} from thick and thin by "
            "eq. 4 corrected; 0.10 was given to every pair",
            judged(MEASURED[0] - MARGIN <= mean <= MEASURED[1] + MARGIN), True,
        ),
        Claim(
            "8", "eq. 4 as printed", "sec. 2.3",
            f"from the velocities before these strikes it gives with e = {mean:.2f} a gap rate "
            f"after of {printed:+.2f} times that before, the laminae gain speed through one "
            f"another; computed {-mean:+.2f} times; with both signs changed it is eq. 14",
            judged(abs(printed + mean) < MARGIN),
        ),
    )  # fmt: skip
