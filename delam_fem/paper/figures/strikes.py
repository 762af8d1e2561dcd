"""Fig. 8 of the paper: tip velocities and the coefficient of restitution that follows."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from delam_fem.numerics.arrays import FloatArray
from delam_fem.numerics.restitution import Strike, identify
from delam_fem.paper.claims import NOT_IN_JSON, Claim, Criterion, Numbers, Piece, judged
from delam_fem.paper.lab import RESONANT, Laboratory, motion_case
from delam_fem.results.figures.style import BLACK, WIDTH, lamina_colours, legend_above

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from delam_fem.results.folder import Result

SHOWN_PERIODS = 2
MEASURED = (0.0, 0.1)
"""Range of e from the paper's experiment."""
SAMPLES = (1, 2, 3, 5, 10, 20)
"""Numbers of samples on each side of a jump from which e is read."""
MARGIN = 0.05
"""Distance up to which two ratios of gap rates count as the same."""


@dataclass(frozen=True)
class Velocities(Numbers):
    """The velocities of the tips at 3.25 Hz, and the strikes that they show.

    Attributes:
        strike_time_s: times of the strikes, shape (n,).
        before, after: velocities of both tips before and after a strike, shape (n, 2) [m/s].
        restitution: e by eq. 3, shape (n,) [-].
        restitution_by_samples: mean of e by eq. 3 by the number of samples on each side to which a
            line is fitted; with one, the sample itself is taken [-].
        restitution_by_lamina: e by eq. 4, shape (n, 2) [-].
        apparent_mass_ratio: m1/m2 from the velocity jumps, shape (n,) [-].
        mass_ratio: m1/m2 of the laminae [-].
        names: names of the laminae.
        given_restitution: e that the case gives to every pair [-].
        period: T [s].
        time, velocity: end of the record of tip velocities, shapes (k,) [s] and (2, k) [m/s].
    """

    strike_time_s: FloatArray
    before: FloatArray
    after: FloatArray
    restitution: FloatArray
    restitution_by_samples: dict[int, float]
    restitution_by_lamina: FloatArray
    apparent_mass_ratio: FloatArray
    mass_ratio: float
    names: tuple[str, str] = field(metadata=NOT_IN_JSON)
    given_restitution: float = field(metadata=NOT_IN_JSON)
    period: float = field(metadata=NOT_IN_JSON)
    time: FloatArray = field(metadata=NOT_IN_JSON)
    velocity: FloatArray = field(metadata=NOT_IN_JSON)


def measure(lab: Laboratory) -> Velocities:
    """Compute the motion at 3.25 Hz and find the jumps of the tip velocities."""
    (result,) = lab.motions([motion_case(RESONANT, lab.plan)])
    strikes = tip_strikes(result)
    history, (thick, thin) = result.history, result.case.lamina
    time, v = history["time"].to_numpy(), history["tip_velocity"].to_numpy()
    shown = time > time[-1] - SHOWN_PERIODS * result.case.period
    return Velocities(
        strike_time_s=np.array([s.time for s in strikes]),
        before=np.array([s.before for s in strikes]).reshape(-1, 2),
        after=np.array([s.after for s in strikes]).reshape(-1, 2),
        restitution=np.array([s.restitution for s in strikes]),
        restitution_by_samples={
            n: float(np.mean([s.restitution for s in tip_strikes(result, n)])) for n in SAMPLES
        },
        restitution_by_lamina=np.array([s.restitution_by_body for s in strikes]).reshape(-1, 2),
        apparent_mass_ratio=np.array([s.apparent_mass_ratio for s in strikes]),
        mass_ratio=mass_ratio(result),
        names=(thick.name, thin.name),
        given_restitution=result.case.contact.restitution,
        period=result.case.period,
        time=time[shown],
        velocity=v[:, shown],
    )


def mass_ratio(result: Result) -> float:
    """Return m1/m2 of a result's laminae [-]."""
    thick, thin = result.case.lamina
    return thick.mass_per_length / thin.mass_per_length


def tip_strikes(result: Result, fit_samples: int = 1) -> tuple[Strike, ...]:
    """Find strikes from the tip velocities alone, as the experiment does; at most one per period.

    `motions.strikes` finds strikes from the gap, which the experiment does not measure.

    Args:
        result: of a run with strikes.
        fit_samples: number of samples on each side of a jump to which a line is fitted; waves that
            arrive at the tip distort the line, so that e depends on this number.
    """
    history = result.history
    return identify(
        history["time"].to_numpy(),
        history["tip_velocity"].to_numpy(),
        mass_ratio(result),
        fit_samples=fit_samples,
        apart=0.5 * result.case.period,
        smallest_jump=0.5,
    )


def printed_ratio(before: FloatArray, e: float, mass_ratio: float) -> float:
    """Return the ratio of gap rates after and before by eq. 4 with the signs as printed [-].

    Args:
        before: velocities of laminae 1 and 2 before the strike, shape (2,) [m/s].
        e: coefficient of restitution [-].
        mass_ratio: m1/m2 [-].
    """
    rate = before[1] - before[0]
    thick = before[0] - (1.0 + e) / (1.0 + mass_ratio) * rate
    thin = before[1] + (1.0 + e) * mass_ratio / (1.0 + mass_ratio) * rate
    return float((thin - thick) / rate)


def draw(numbers: Velocities) -> Figure:
    """Draw the tip velocities over two periods with the jumps from which e follows."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(WIDTH, 7.0), layout="constrained")
    above, below = figure.subplots(2, 2, width_ratios=[3, 1])
    whole = above[0].get_gridspec()
    for panel in above:
        panel.remove()
    _draw_velocities(figure.add_subplot(whole[0, :]), numbers)
    _draw_restitution(below[0], numbers)
    _draw_samples(below[1], numbers)
    return figure


def _draw_velocities(panel: Axes, numbers: Velocities) -> None:
    """Draw the velocities of both tips, with marks before and after each strike."""
    start, T = numbers.time[0], numbers.period
    for i, colour in enumerate(lamina_colours(2)):
        label = f"{numbers.names[i]}  $\\dot y_{i + 1}$"
        panel.plot((numbers.time - start) / T, numbers.velocity[i], color=colour, label=label)
    for k, strike in enumerate(np.flatnonzero(numbers.strike_time_s >= start)):
        at = np.full(4, (numbers.strike_time_s[strike] - start) / T)
        ends = np.concatenate([numbers.before[strike], numbers.after[strike]])
        name = "before and after the strike" if k == 0 else None
        panel.plot(at, ends, "o", color=BLACK, markersize=4, label=name)
    panel.set(xlabel="time t/T [–]", ylabel="velocity of the tip [m/s]")
    panel.margins(x=0.0)
    legend_above(panel)


def _draw_restitution(panel: Axes, numbers: Velocities) -> None:
    """Draw e of each strike, with the paper's range and the given value."""
    e, by_lamina = numbers.restitution, numbers.restitution_by_lamina
    number = np.arange(1, e.size + 1)
    panel.plot(number, e, "o", color=BLACK, label="eq. 3")
    for i, (marker, colour) in enumerate(zip("^v", lamina_colours(2), strict=True)):
        panel.plot(number, by_lamina[:, i], marker, color=colour, label=f"eq. 4, lamina {i + 1}")
    panel.axhspan(*MEASURED, color="#e9e9e9", label="paper's range")
    panel.axhline(numbers.given_restitution, color=BLACK, linewidth=0.8, label="given e")
    panel.set(xlabel="number of the strike", ylabel="coefficient of restitution e [–]")
    legend_above(panel)


def _draw_samples(panel: Axes, numbers: Velocities) -> None:
    """Draw how the mean of e depends on the samples that it is read from."""
    by_samples = numbers.restitution_by_samples
    panel.semilogx(list(by_samples), list(by_samples.values()), "o-", color=BLACK)
    panel.axhspan(*MEASURED, color="#e9e9e9")
    panel.set_xticks(list(by_samples), [str(n) for n in by_samples])
    panel.minorticks_off()
    panel.set(xlabel="samples on each side", ylabel="mean e by eq. 3 [–]")


def judge(numbers: Velocities) -> tuple[Claim, ...]:
    """Judge the value of e measured in the paper, and its eq. 4."""
    e, by_lamina = numbers.restitution, numbers.restitution_by_lamina
    jump = np.abs(numbers.after - numbers.before).sum(axis=1)
    by_samples = numbers.restitution_by_samples
    mean, within = by_samples[1], (min(by_samples.values()), max(by_samples.values()))
    printed = float(
        np.mean([printed_ratio(before, mean, numbers.mass_ratio) for before in numbers.before])
    )
    return (
        Claim(
            "8", "velocities jump at the beginning of contact", "sec. 2.3",
            f"{e.size} jumps in 10 periods; the gap rate changes by {jump.mean():.2f} m/s "
            "within one step (T/1000)",
            *judged(Criterion("jumps in 10 periods", e.size, ">", 0.0)),
        ),
        Claim(
            "8", "0 ≤ e ≤ 0.1 from the velocities before and after", "sec. 2.3",
            f"e = {mean:.2f} (from {e.min():.2f} to {e.max():.2f}, {e.size} strikes) by eq. "
            "3 with one sample on each side of the jump, "
            + ", ".join(f"{value:.2f}" for n, value in by_samples.items() if n > 1)
            + f" with {', '.join(str(n) for n in by_samples if n > 1)} samples: waves follow the "
            "strike at once, so e is not a property of the strike alone; "
            f"{by_lamina[:, 0].mean():.2f} and {by_lamina[:, 1].mean():.2f} from thick and thin "
            "by eq. 4 corrected; 0.10 was given to every pair",
            *judged(
                Criterion("e", mean, ">", MEASURED[0], "", within),
                Criterion("e", mean, "<", MEASURED[1], "", within),
            ),
        ),
        Claim(
            "8", "eq. 4 as printed", "sec. 2.3",
            f"from the velocities before these strikes it gives with e = {mean:.2f} a gap rate "
            f"after of {printed:+.2f} times that before, the laminae gain speed through one "
            f"another; computed {-mean:+.2f} times; with both signs changed it is eq. 14",
            *judged(Criterion("printed less computed", abs(printed + mean), "<", MARGIN)),
        ),
    )  # fmt: skip


VELOCITIES = Piece(
    "8",
    "Impact-dominated velocities",
    f"Method 3.2 at {RESONANT} Hz. e by eq. 3 from the gap rates before and after the strike, "
    "and by eq. 4 (signs corrected) from each lamina with m1/m2 = ρ₁A₁/ρ₂A₂. The paper's "
    "signals are not available; below on the right: e depends on the number of samples on each "
    "side of a jump to which a line is fitted; compared is the range of e that it read off them.",
    measure,
    draw,
    judge,
)
