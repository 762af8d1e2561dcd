"""Histories of the paper (Figs. 3, 8, 10 and 13), and the restitution that they show.

The coefficient of restitution is identified from two velocity signals. Velocities are smooth
between strikes and jump at a strike. Straight lines are fitted to the samples on both sides of a
jump and extended to its middle; there they give the velocities before and after.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from delam_fem.api import FloatArray, style
from delam_fem.paper.claims import (
    CLEARLY,
    SMOOTH_HARMONICS,
    Criterion,
    Numbers,
    Piece,
    Statement,
    between,
    described,
    motion_numbers,
    roughness,
    tip_positions,
)
from delam_fem.paper.panels import four_by_two, line, portrait, show
from delam_fem.paper.runs import (
    BEATS,
    FREQUENCIES,
    LAWS,
    RESONANT,
    Laboratory,
    PaperMethod,
    both_methods,
    motion_case,
    strikes,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from delam_fem.api import Result

SMALLEST_JUMP = 0.2
"""Smallest jump that counts as a strike, as a share of the largest jump; smaller ones are waves or
noise."""


class VelocityJumps(NamedTuple):
    """The strikes in two velocity signals, in the order of time.

    Attributes:
        time: middles of the jumps, shape (n,) [s].
        before: velocities of bodies 1 and 2 just before a strike, shape (n, 2) [m/s].
        after: velocities of bodies 1 and 2 just after it, shape (n, 2) [m/s].
    """

    time: FloatArray
    before: FloatArray
    after: FloatArray

    @property
    def restitution(self) -> FloatArray:
        """Coefficients e = -(v2 - v1)⁺ / (v2 - v1)⁻, shape (n,) [-]. Source: paper eq. 3."""
        rate_before, rate_after = (np.diff(v, axis=1)[:, 0] for v in (self.before, self.after))
        return np.asarray(-rate_after / rate_before)

    def restitution_by_body(self, mass_ratio: float) -> FloatArray:
        """Return e from the jump of body 1 alone and from that of body 2 alone, shape (n, 2).

            v1⁺ = v1⁻ + (1 + e) m2/(m1 + m2) (v2 - v1)⁻
            v2⁺ = v2⁻ - (1 + e) m1/(m1 + m2) (v2 - v1)⁻

        Both values agree if momentum is conserved and the mass ratio is that of the masses that
        take part in the strike.

        Args:
            mass_ratio: m1/m2 [-].

        Source: I. Müller, eq. 4 with both signs corrected. As printed, the gap rate after it is
        2 + e times that before it instead of -e times.
        """
        share = np.array([1.0, -mass_ratio]) / (1.0 + mass_ratio)
        e = (self.after - self.before) / (share * np.diff(self.before, axis=1)) - 1.0
        return np.asarray(e)

    @property
    def apparent_mass_ratio(self) -> FloatArray:
        """Ratios m1/m2 that follow from both jumps by conservation of momentum, shape (n,) [-]."""
        jump = self.after - self.before
        return np.asarray(-jump[:, 1] / jump[:, 0])


def identify(
    t: FloatArray,
    v: FloatArray,
    *,
    fit_samples: int = 3,
    apart: float = 0.0,
    smallest_jump: float = SMALLEST_JUMP,
) -> VelocityJumps:
    """Find the strikes in two velocity signals.

    A strike is a local maximum of the rise of the gap rate from one sample to the next, if the
    bodies approach one another before it. Of several rises within `apart` only the largest counts.

    Args:
        t: equidistant instants, shape (n,) [s].
        v: velocities of bodies 1 and 2 along an axis on which body 2 is ahead of body 1, shape
            (2, n) [m/s].
        fit_samples: number of samples on each side for the fitted line; 1 takes the sample itself.
        apart: shortest time between two strikes [s]; at least 1 + `fit_samples` intervals.
        smallest_jump: smallest jump that counts, as a share of the largest [-].
    """
    rate = v[1] - v[0]
    rise = np.diff(rate)
    candidates = np.flatnonzero((rise >= smallest_jump * rise.max()) & (rate[:-1] < 0.0))
    inside = (candidates >= fit_samples - 1) & (candidates < t.size - fit_samples)
    wait = max(apart, (1 + fit_samples) * (t[1] - t[0]))
    chosen: list[int] = []
    for k in candidates[inside][np.argsort(-rise[candidates[inside]], kind="stable")].tolist():
        if all(abs(t[k] - t[other]) >= wait for other in chosen):
            chosen.append(k)
    first = np.sort(np.array(chosen, dtype=np.int64))
    near = np.arange(fit_samples)
    about = near - near.mean()
    # of the line through the samples, the nearest one first, half an interval before the nearest
    weights = 1.0 / fit_samples - 0.5 * fit_samples * about / ((about @ about) or 1.0)
    before = (v[:, first[:, None] - near] @ weights).T
    after = (v[:, first[:, None] + 1 + near] @ weights).T
    jumps = VelocityJumps(0.5 * (t[first] + t[first + 1]), before, after)
    return VelocityJumps._make(column[before[:, 1] < before[:, 0]] for column in jumps)


# -- Fig. 3: the four motions -----------------------------------------------------------------

LARGE = 0.1
"""A contact phase longer than this share of the period counts as relatively large."""


def measure_histories(lab: Laboratory) -> Numbers:
    """Compute the four motions by both methods.

    Returns:
        motions: numbers of each motion, and results: the results themselves, both by frequency [Hz]
        and method; approach: mean speed of approach before strikes by method 3.2, by frequency
        [m/s]; weakness: largest impulse at 1.25 Hz over that at 3.25 Hz by method 3.2 [-]; reach:
        largest distance of an impact from the clamp at 1.25 Hz by method 3.2 [m]; length: length of
        the laminae [m].
    """
    results = both_methods(lab)
    low, thick = results[FREQUENCIES[0], "3.2"], results[RESONANT, "3.2"]
    x = low.history["x"].to_numpy()[low.history["event_node"].to_numpy()]
    weak, strong = (float(r.history["event_impulse"].max()) for r in (low, thick))
    motions = {key: motion_numbers(result) for key, result in results.items()}
    return Numbers(
        {f"{f:g} Hz, {m}": motion.kept for (f, m), motion in motions.items()},
        motions=motions,
        results=results,
        approach={f: strikes(results[f, "3.2"]).approach for f in FREQUENCIES},
        weakness=weak / strong,
        reach=float(x.max(initial=0.0)),
        length=low.case.lamina[0].length,
    )


def draw_histories(numbers: Numbers) -> Figure:
    """Draw the positions of both tips over four periods at four frequencies, by both methods."""
    figure, panels = four_by_two(
        9.6, numbers.results, _draw_history, "time t/T [–]", "tip [mm]", sharex=True, sharey="row"
    )
    style.legend_above(panels[0, 1])
    return figure


def _draw_history(panel: Axes, result: Result) -> None:
    """Draw the positions of both tips and the gap between them."""
    t, y = tip_positions(result, style.HISTORY_PERIODS)
    panel.fill_between(t, y[0], y[1], where=y[1] >= y[0], color=style.GAP_COLOUR)
    tips = (line(t, y[i], color=style.LAMINA_COLOURS[i], label=f"$y_{i + 1}$") for i in range(2))
    show(panel, *tips, xmargin=0.0)


HISTORIES = Piece(
    "3",
    "Time histories",
    "Positions y₁ = q₁ and y₂ = g₀(L) + q₂ of both tips. The paper shows measured histories "
    "(Fig. 3) and those of method 3.2 (Fig. 12); only what its text says of them is compared.",
    measure_histories,
    draw_histories,
    (
        Statement(
            "1.25 Hz: almost harmonic, no contact at the tip", "sec. 2.2",
            lambda n: "d = {:.3f} / {:.3f} %, {}, smallest tip gap {:.1f} mm".format(
                *(100 * d for d in n.motions[1.25, "3.2"].distortion_factor),
                n.motions[1.25, "3.2"].kind, 1e3 * n.motions[1.25, "3.2"].minimum_tip_gap,
            ),
            lambda n: [
                *described(n.motions[1.25, "3.2"], 1),
                Criterion(
                    "larger d", max(n.motions[1.25, "3.2"].distortion_factor), "<", 0.01, "%"
                ),
                Criterion(
                    "smallest tip gap", 1e3 * n.motions[1.25, "3.2"].minimum_tip_gap, ">", 0.0, "mm"
                ),
            ],
        ),
        Statement(
            "1.25 Hz: weak contacts near the clamp", "sec. 2.2",
            lambda n: f"impacts up to x = {1e3 * n.reach:.0f} mm of {1e3 * n.length:.0f}, the "
            f"strongest {100 * n.weakness:.1f} % of that at 3.25 Hz",
            lambda n: [
                *between("farthest impact over length", n.reach / n.length, (0.0, 0.5), "%"),
                Criterion("strongest impulse over that at 3.25 Hz", n.weakness, "<", 0.1, "%"),
            ],
        ),
        Statement(
            "1.60 Hz: the thin lamina beats the thick one", "sec. 2.2",
            lambda n: n.motions[1.6, "3.2"].kind,
            lambda n: [
                *described(n.motions[1.6, "3.2"], 1),
                Criterion(
                    "thin over thick speed",
                    abs(np.divide(*n.motions[1.6, "3.2"].strike_velocities[::-1])), ">", BEATS,
                ),
            ],
        ),
        Statement(
            "3.25 Hz: the thick beats the thin, opposite velocities before contact", "sec. 2.2",
            lambda n: n.motions[3.25, "3.2"].kind,
            lambda n: [
                *described(n.motions[3.25, "3.2"], 1),
                Criterion("thick", n.motions[3.25, "3.2"].strike_velocities[0], ">", 0.0, "m/s"),
                Criterion("thin", n.motions[3.25, "3.2"].strike_velocities[1], "<", 0.0, "m/s"),
            ],
        ),
        Statement(
            "3.25 Hz gives the maximum strike of all", "sec. 2.2",
            lambda n: "speed of approach before the strike: "
            + ", ".join(f"{n.approach[f]:.2f} m/s at {f:.2f} Hz" for f in FREQUENCIES[1:]),
            lambda n: [
                Criterion(
                    "3.25 Hz over the next",
                    n.approach[RESONANT] / max(v for f, v in n.approach.items() if f != RESONANT),
                    ">", 1.0,
                )
            ],
        ),
        Statement(
            "3.65 Hz: period doubling, one contact in two periods", "sec. 2.2",
            lambda n: n.motions[3.65, "3.2"].kind,
            lambda n: described(n.motions[3.65, "3.2"], 2),
        ),
        Statement(
            "1.60 … 3.65 Hz: the interval of contact is relatively large", "sec. 2.2",
            lambda n: "the tips are less than 1 mm apart for "
            + ", ".join(f"{100 * n.motions[f, '3.2'].near_share:.0f} %" for f in FREQUENCIES[1:])
            + " of the time; the tip pair itself is closed for a few steps at each strike",
            lambda n: [
                Criterion(
                    "smallest share", min(n.motions[f, "3.2"].near_share for f in FREQUENCIES[1:]),
                    ">", LARGE, "%",
                )
            ],
        ),
    ),
)  # fmt: skip

# -- Fig. 8: velocities, and the coefficient of restitution that follows ------------------------

SHOWN_PERIODS = 2
MEASURED = (0.0, 0.1)
"""Range of e from the paper's experiment."""
SAMPLES = (1, 2, 3, 5, 10, 20)
"""Numbers of samples on each side of a jump from which e is read."""
MARGIN = 0.05
"""Distance up to which two ratios of gap rates count as the same."""


def measure_velocities(lab: Laboratory) -> Numbers:
    """Compute the motion at 3.25 Hz and find the jumps of the tip velocities.

    Returns:
        strike_time_s: times of the strikes, shape (n,); before, after: velocities of both tips
        before and after a strike, shape (n, 2) [m/s]; restitution: e by eq. 3, shape (n,) [-];
        restitution_by_samples: mean of e by eq. 3 by the number of samples on each side to which a
        line is fitted, with one the sample itself is taken [-]; restitution_by_lamina: e by eq. 4,
        shape (n, 2) [-]; apparent_mass_ratio: m1/m2 from the velocity jumps, shape (n,) [-];
        mass_ratio: m1/m2 of the laminae [-]; result: the result.
    """
    (result,) = lab.motions([motion_case(RESONANT, lab.plan)])
    impacts, (thick, thin) = tip_strikes(result), result.case.lamina
    mass_ratio = thick.mass_per_length / thin.mass_per_length
    return Numbers(
        {
            "strike_time_s": impacts.time,
            "before": impacts.before,
            "after": impacts.after,
            "restitution": impacts.restitution,
            "restitution_by_samples": {
                n: float(tip_strikes(result, n).restitution.mean()) for n in SAMPLES
            },
            "restitution_by_lamina": impacts.restitution_by_body(mass_ratio),
            "apparent_mass_ratio": impacts.apparent_mass_ratio,
            "mass_ratio": mass_ratio,
        },
        result=result,
    )


def tip_strikes(result: Result, fit_samples: int = 1) -> VelocityJumps:
    """Find strikes from the tip velocities alone, as the experiment does; at most one per period.

    `runs.strikes` finds strikes from the gap, which the experiment does not measure.

    Args:
        result: result of a run with strikes.
        fit_samples: number of samples on each side of a jump to which a line is fitted; waves that
            arrive at the tip distort the line, so that e depends on this number.
    """
    history = result.history
    return identify(
        history["time"].to_numpy(),
        history["tip_velocity"].to_numpy(),
        fit_samples=fit_samples,
        apart=0.5 * result.case.period,
        smallest_jump=0.5,
    )


def draw_velocities(numbers: Numbers) -> Figure:
    """Draw the tip velocities over two periods with the jumps from which e follows."""
    figure = style.canvas(7.0)
    panels = figure.subplot_mosaic([["whole"] * 2, ["strikes", "samples"]], width_ratios=[3, 1])
    history, case = numbers.result.history, numbers.result.case
    time = history["time"].to_numpy()
    T = case.period
    is_shown = time > time[-1] - SHOWN_PERIODS * T
    start = time[is_shown][0]
    v = history["tip_velocity"].to_numpy()[:, is_shown]
    struck = np.flatnonzero(numbers.strike_time_s >= start)
    at = (numbers.strike_time_s[struck] - start) / T
    ends = np.concatenate([numbers.before[struck], numbers.after[struck]], axis=1)
    show(
        panels["whole"],
        *(
            line((time[is_shown] - start) / T, v[i], color=colour,
                 label=f"{case.lamina[i].name}  $\\dot y_{i + 1}$")
            for i, colour in enumerate(style.lamina_colours(2))
        ),
        line(np.repeat(at, 4), ends.ravel(), "o", color=style.BLACK, markersize=4,
             label="before and after the strike"),
        xlabel="time t/T [–]", ylabel="velocity of the tip [m/s]", xmargin=0.0, legend="above",
    )  # fmt: skip
    panel = panels["strikes"]  # e of each strike
    e = numbers.restitution
    restitution = numbers.result.case.contact.restitution
    number = np.arange(1, e.size + 1)
    by_lamina = numbers.restitution_by_lamina
    show(
        panel,
        line(number, e, "o", color=style.BLACK, label="eq. 3"),
        *(
            line(number, by_lamina[:, i], marker, color=colour, label=f"eq. 4, lamina {i + 1}")
            for i, (marker, colour) in enumerate(zip("^v", style.lamina_colours(2), strict=True))
        ),
        xlabel="number of the strike", ylabel="coefficient of restitution e [–]",
    )  # fmt: skip
    panel.axhspan(*MEASURED, color="#e9e9e9", label="paper's range")
    panel.axhline(restitution, color=style.BLACK, linewidth=0.8, label="given e")
    style.legend_above(panel)
    panel = panels["samples"]  # from which e is read, on each side
    samples, e = zip(*numbers.restitution_by_samples.items(), strict=True)
    panel.semilogx(samples, e, "o-", color=style.BLACK)
    panel.axhspan(*MEASURED, color="#e9e9e9")
    panel.set(xlabel="samples on each side", ylabel="mean e by eq. 3 [–]")
    panel.set_xticks(samples, [str(n) for n in samples])
    panel.minorticks_off()
    return figure


VELOCITIES = Piece(
    "8",
    "Impact-dominated velocities",
    f"Method 3.2 at {RESONANT} Hz. e by eq. 3 from the gap rates before and after the strike, "
    "and by eq. 4 (signs corrected) from each lamina with m1/m2 = ρ₁A₁/ρ₂A₂. The paper's "
    "signals are not available; below on the right: e depends on the number of samples on each "
    "side of a jump to which a line is fitted; compared is the range of e that it read off them.",
    measure_velocities,
    draw_velocities,
    (
        Statement(
            "velocities jump at the beginning of contact", "sec. 2.3",
            lambda n: f"{n.restitution.size} jumps in 10 periods; the gap rate changes by "
            f"{np.abs(n.after - n.before).sum(axis=1).mean():.2f} m/s within one step (T/1000)",
            lambda n: [Criterion("jumps in 10 periods", n.restitution.size, ">", 0.0)],
        ),
        Statement(
            "0 ≤ e ≤ 0.1 from the velocities before and after", "sec. 2.3",
            lambda n: f"e = {n.restitution_by_samples[1]:.2f} (from {n.restitution.min():.2f} to "
            f"{n.restitution.max():.2f}, {n.restitution.size} strikes) by eq. "
            "3 with one sample on each side of the jump, "
            + ", ".join(f"{e:.2f}" for k, e in n.restitution_by_samples.items() if k > 1)
            + f" with {', '.join(str(k) for k in n.restitution_by_samples if k > 1)} samples: "
            "waves follow the strike at once, so e is not a property of the strike alone; "
            "{:.2f} and {:.2f} from thick and thin by eq. 4 corrected; "
            "0.10 was given to every pair".format(*n.restitution_by_lamina.mean(axis=0)),
            lambda n: between(
                "e", n.restitution_by_samples[1], MEASURED, "",
                (min(n.restitution_by_samples.values()), max(n.restitution_by_samples.values())),
            ),
        ),
        Statement(
            "eq. 4 as printed", "sec. 2.3",
            lambda n: "from the velocities before these strikes it gives with e = {:.2f} a gap "
            "rate after of {:+.2f} times that before, the laminae gain speed through one another; "
            "computed {:+.2f} times; with both signs changed it is eq. 14".format(
                *(a * n.restitution_by_samples[1] + b for a, b in ((1, 0), (1, 2), (-1, 0)))
            ),
            lambda n: [
                Criterion(
                    "printed less computed", abs(2.0 + 2.0 * n.restitution_by_samples[1]),
                    "<", MARGIN,
                )
            ],
        ),
    ),
)  # fmt: skip

# -- Figs. 10 and 13: the contact phase by method 3.1, and by method 3.2 beside it --------------

DETAIL = (0.10, 0.25)
"""Time before and after the strike that details show, in periods."""


def measure_contact(lab: Laboratory) -> Numbers:
    """Compute the motion at 3.25 Hz and its roughness during contact by both methods.

    Returns:
        roughness_near: roughness of both tips while they are near, by method [-]; ratio: roughness
        by method 3.2 over that by method 3.1, shape (2,) [-]; results: results by method.
    """
    results = {m: lab.motions([motion_case(RESONANT, lab.plan, m)])[0] for m in LAWS}
    rough = {m: roughness(r, free=False) for m, r in results.items()}
    return Numbers(
        {"roughness_near": rough, "ratio": np.divide(rough["3.2"], rough["3.1"])}, results=results
    )


def measure_impacts(lab: Laboratory) -> Numbers:
    """Compute the motion at 3.25 Hz by both methods, and count its impacts.

    Returns:
        roughness_velocity, roughness_displacement: roughness of both tips while they are near, by
        method 3.1 [-]; impacts_per_period: impacts by method 3.1 and by method 3.2; results:
        results by method.
    """
    results = measure_contact(lab).results
    roughnesses = {
        f"roughness_{name}": roughness(results["3.1"], free=False, quantity=f"tip_{name}")
        for name in ("velocity", "displacement")
    }
    impacts = [float(r.summary["impacts_per_period"]) for r in results.values()]
    return Numbers(roughnesses | {"impacts_per_period": impacts}, results=results)


def _draw_strikes(numbers: Numbers, *methods: PaperMethod) -> Figure:
    """Draw the phase portrait and the history around a strike; one row per method.

    The strike is the last one whose details are all in the window.
    """
    figure = style.canvas(0.5 + 4.1 * len(methods))
    panels = figure.subplots(len(methods), 2, squeeze=False, sharex="col", sharey="col")
    for row, method in zip(panels, methods, strict=True):
        result = numbers.results[method]
        N = result.case.time.steps_per_period
        t, y = tip_positions(result, style.PORTRAIT_PERIODS)
        v = portrait(result)[:, 1]
        steps = strikes(result).step
        at = int(steps[steps + DETAIL[1] * N < t.size][-1])
        part = slice(max(at - int(DETAIL[0] * N), 0), at + int(DETAIL[1] * N))
        looks = [
            {"color": colour, "label": lamina.name, "linewidth": 0.7, "markersize": 2.5}
            for lamina, colour in zip(result.case.lamina, style.lamina_colours(2), strict=True)
        ]
        show(
            row[0],
            *(line(y[i, part], v[i, part], ".-", **look) for i, look in enumerate(looks)),
            title=f"[a] phase portrait, method {method}", ylabel="velocity of the tip [m/s]",
        )  # fmt: skip
        show(
            row[1],
            *(line(t[part] - t[at], y[i, part], ".-", **look) for i, look in enumerate(looks)),
            title="[b] history", ylabel="position of the tip [mm]",
            xticks=np.arange(-1, 3) / 10.0,
        )  # fmt: skip
    style.label_x(panels[:, 0], "position of the tip [mm]")
    style.label_x(panels[:, 1], "time since the strike  t/T [–]")
    style.legend_above(panels[0][1])
    return figure


IMPACTS = Piece(
    "10",
    "Contact phase by method 3.1",
    f"Method 3.1 at {RESONANT} Hz about one strike, every time step a dot.",
    measure_impacts,
    lambda numbers: _draw_strikes(numbers, "3.1"),
    (
        Statement(
            "permanent contact is captured by numerous single impacts", "sec. 3.1",
            lambda n: f"{n.impacts_per_period[0]:.0f} impacts on all pairs per period at "
            f"{RESONANT} Hz ({n.impacts_per_period[1]:.0f} by method 3.2)",
            lambda n: [Criterion("impacts per period", n.impacts_per_period[0], ">", 1.0)],
        ),
        Statement(
            "the time history is hardly affected by successive impacts", "sec. 3.1",
            lambda n: f"share of the motion above harmonic {SMOOTH_HARMONICS} while the tips are "
            "near: velocity {:.0f} / {:.0f} %, displacement {:.1f} / {:.1f} % (thick / thin)"
            .format(*(100 * r for r in (*n.roughness_velocity, *n.roughness_displacement))),
            lambda n: [
                Criterion(
                    "displacement over velocity",
                    max(n.roughness_displacement) / max(n.roughness_velocity), "<", 0.1, "%",
                )
            ],
        ),
    ),
)  # fmt: skip

CONTACT = Piece(
    "13",
    "Contact phase by method 3.2",
    f"{RESONANT} Hz about one strike by both methods, every time step a dot.",
    measure_contact,
    lambda numbers: _draw_strikes(numbers, "3.2", "3.1"),
    (
        Statement(
            "permanent contact makes the contact phase more realistic", "sec. 3.2",
            lambda n: f"velocity above harmonic {SMOOTH_HARMONICS} while the tips are near, 3.2 "
            f"over 3.1: {n.ratio[0]:.2f} (thick), {n.ratio[1]:.2f} (thin)",
            lambda n: [Criterion("larger ratio", float(np.max(n.ratio)), "<", CLEARLY)],
        ),
    ),
)  # fmt: skip
