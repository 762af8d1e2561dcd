"""Figs. 3 and 12 of the paper: histories and phase portraits of four motions, both methods."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from delam_fem.numerics.arrays import FloatArray
from delam_fem.paper.claims import Claim, Piece, judged
from delam_fem.paper.lab import (
    FREQUENCIES,
    LAWS,
    RESONANT,
    Laboratory,
    Method,
    motion_case,
)
from delam_fem.paper.measures import (
    SMOOTH_HARMONICS,
    describe,
    is_as_described,
    near_share,
    roughness,
    strikes,
)
from delam_fem.results import diagnostics
from delam_fem.results.dataset import Result
from delam_fem.results.motion_figures import HISTORY_PERIODS, PORTRAIT_PERIODS
from delam_fem.results.style import (
    BLACK,
    GAP_COLOUR,
    LAMINA_COLOURS,
    WIDTH,
    legend_above,
    legend_outside,
)

CLEARLY = 0.8
"""A roughness below this share of the other counts as a distinct improvement."""
LARGE = 0.1
"""A share of the period from which on a contact phase counts as relatively large."""
SERIES_STEP = 4
"""Every so many steps are kept in the numbers of a figure."""

Motions = dict[tuple[float, Method], Result]


def histories(lab: Laboratory) -> Piece:
    """Draw the positions of both tips over four periods at the four frequencies, both methods."""
    found = _motions(lab)
    figure = Figure(figsize=(WIDTH, 8.4), layout="constrained")
    panels = figure.subplots(4, 2, sharex=True, sharey="row")
    for (frequency, method), result in found.items():
        panel = panels[FREQUENCIES.index(frequency), int(method == "3.2")]
        t, y = tip_positions(result, HISTORY_PERIODS)
        panel.fill_between(t, y[0], y[1], where=y[1] >= y[0], color=GAP_COLOUR)
        for i in range(2):
            panel.plot(t, y[i], color=LAMINA_COLOURS[i], label=f"$y_{i + 1}$")
        letter = "abcd"[FREQUENCIES.index(frequency)]
        panel.set_title(f"[{letter}] {frequency:.2f} Hz, method {method}", loc="left")
        panel.margins(x=0.0)
    for row in panels:
        row[0].set_ylabel("tip [mm]")
    for panel in panels[-1]:
        panel.set_xlabel("time t/T [–]")
    legend_above(panels[0, 1])
    numbers = {f"{f:g} Hz, {m}": motion_numbers(r) for (f, m), r in found.items()}
    caption = (
        "Positions y₁ = q₁ and y₂ = g₀(L) + q₂ of both tips. The paper shows measured histories "
        "(Fig. 3) and those of method 3.2 (Fig. 12); only what its text says of them is compared."
    )
    return Piece("3", "Time histories", caption, figure, numbers, _history_claims(found))


def portraits(lab: Laboratory) -> Piece:
    """Draw the phase portraits of both tips over ten periods at the four frequencies."""
    found = _motions(lab)
    figure = Figure(figsize=(WIDTH, 12.0), layout="constrained")
    panels = figure.subplots(4, 2, sharex="row", sharey="row")
    for (frequency, method), result in found.items():
        panel = panels[FREQUENCIES.index(frequency), int(method == "3.2")]
        _portrait(panel, result, with_strobes=True)
        letter = "abcd"[FREQUENCIES.index(frequency)]
        panel.set_title(f"[{letter}] {frequency:.2f} Hz, method {method}", loc="left")
    for row in panels:
        row[0].set_ylabel("velocity of the tip [m/s]")
    for panel in panels[-1]:
        panel.set_xlabel("position of the tip [mm]")
    legend_outside(figure, panels[0, 0], 3)
    numbers = {
        f"{f:g} Hz, {m}": motion_numbers(r) | {"roughness_free": roughness(r, free=True)}
        for (f, m), r in found.items()
    }
    caption = (
        f"Phase portraits of both tips over {PORTRAIT_PERIODS} periods by methods 3.1 (impact law) "
        "and 3.2 (impact law and penalty stiffness), dots: ends of periods. The paper's portraits "
        "are not available; compared is what its text says of them."
    )
    return Piece("12", "Phase portraits", caption, figure, numbers, _portrait_claims(found))


def tip_positions(result: Result, count: int) -> tuple[FloatArray, FloatArray]:
    """Return t/T from 0 and the positions of both tips over the last periods, (n,), (2, n) [mm]."""
    last = diagnostics.last_periods(result.history, result.case, count)
    q = 1e3 * last["tip_displacement"].to_numpy()
    gap = 1e3 * float(result.history["gap0"][diagnostics.TIP])
    t = np.arange(1, q.shape[1] + 1) / result.case.time.steps_per_period
    return t, q + np.array([[0.0], [gap]])


def _motions(lab: Laboratory) -> Motions:
    """Compute the four motions by both methods."""
    keys: list[tuple[float, Method]] = [(f, m) for f in FREQUENCIES for m in LAWS]
    results = lab.motions([motion_case(f, lab.plan, m) for f, m in keys])
    return dict(zip(keys, results, strict=True))


def motion_numbers(result: Result) -> dict[str, Any]:
    """Return what a motion is, and its last four periods."""
    t, y = tip_positions(result, HISTORY_PERIODS)
    names = (
        "periodicity", "strobe_scatter", "tip_contacts_per_period", "impacts_per_period",
        "tip_min", "tip_max", "minimum_tip_gap", "distortion_factor", "thd", "energy_residual",
    )  # fmt: skip
    return {name: result.summary[name] for name in names} | {
        "kind": describe(result),
        "is_as_described": is_as_described(result),
        "strike_velocities": strikes(result).mean,
        "near_share": near_share(result),
        "t_over_T": t[::SERIES_STEP],
        "position_mm": np.round(y[:, ::SERIES_STEP], 4),
    }


def _portrait(panel: Axes, result: Result, *, with_strobes: bool = False) -> None:
    """Draw the portraits of both tips into one panel."""
    N = result.case.time.steps_per_period
    portrait = diagnostics.phase_portrait(result.history, result.case, PORTRAIT_PERIODS)
    shift = (0.0, 1e3 * float(result.history["gap0"][diagnostics.TIP]))
    for i, colour in enumerate(LAMINA_COLOURS):
        q, v = 1e3 * portrait[i, 0] + shift[i], portrait[i, 1]
        panel.plot(q, v, color=colour, linewidth=0.6, label=result.case.lamina[i].name)
        if with_strobes:
            ends = slice(N - 1, None, N)
            label = "ends of periods" if i == 0 else None
            panel.plot(q[ends], v[ends], "o", color=BLACK, markersize=3, zorder=4, label=label)


def _history_claims(found: Motions) -> tuple[Claim, ...]:
    low, thin, thick, double = (found[f, "3.2"] for f in FREQUENCIES)
    events = low.history
    x = events["x"].to_numpy()[events["event_node"].to_numpy()]
    impulses = [float(r.history["event_impulse"].max()) for r in (low, thick)]
    d, length = low.summary["distortion_factor"], low.case.lamina[0].length
    speeds = {f: strikes(found[f, "3.2"]).approach for f in FREQUENCIES}
    share = [near_share(found[f, "3.2"]) for f in FREQUENCIES[1:]]
    return (
        Claim(
            "3", "1.25 Hz: almost harmonic, no contact at the tip", "sec. 2.2",
            f"d = {100 * d[0]:.3f} / {100 * d[1]:.3f} %, {describe(low)}, smallest tip gap "
            f"{1e3 * low.summary['minimum_tip_gap']:.1f} mm",
            judged(is_as_described(low) and max(d) < 0.01), True,
        ),
        Claim(
            "3", "1.25 Hz: weak contacts near the clamp", "sec. 2.2",
            f"impacts up to x = {1e3 * x.max(initial=0.0):.0f} mm of "
            f"{1e3 * length:.0f}, the strongest "
            f"{100 * impulses[0] / impulses[1]:.1f} % of that at 3.25 Hz",
            judged(0.0 < x.max(initial=0.0) < 0.5 * length and impulses[0] < 0.1 * impulses[1]),
        ),
        Claim(
            "3", "1.60 Hz: the thin lamina beats the thick one", "sec. 2.2", describe(thin),
            judged(is_as_described(thin)), True,
        ),
        Claim(
            "3", "3.25 Hz: the thick beats the thin, opposite velocities before contact",
            "sec. 2.2", describe(thick), judged(is_as_described(thick)), True,
        ),
        Claim(
            "3", "3.25 Hz gives the maximum strike of all", "sec. 2.2",
            "speed of approach before the strike: "
            + ", ".join(f"{speeds[f]:.2f} m/s at {f:.2f} Hz" for f in FREQUENCIES[1:]),
            judged(max(speeds, key=lambda f: speeds[f]) == RESONANT), True,
        ),
        Claim(
            "3", "3.65 Hz: period doubling, one contact in two periods", "sec. 2.2",
            describe(double), judged(is_as_described(double)), True,
        ),
        Claim(
            "3", "1.60 … 3.65 Hz: the interval of contact is relatively large", "sec. 2.2",
            "the tips are less than 1 mm apart for "
            + ", ".join(f"{100 * s:.0f} %" for s in share)
            + " of the time; the tip pair itself is closed for a few steps at each strike",
            judged(min(share) > LARGE),
        ),
    )  # fmt: skip


def _portrait_claims(found: Motions) -> tuple[Claim, ...]:
    kinds = {m: [is_as_described(found[f, m]) for f in FREQUENCIES] for m in LAWS}
    scatter = [found[f, "3.2"].summary["strobe_scatter"] for f in FREQUENCIES]
    rough = {
        m: np.array([roughness(found[f, m], free=True) for f in FREQUENCIES[1:]]) for m in LAWS
    }
    ratio = rough["3.2"] / rough["3.1"]
    return (
        Claim(
            "12", "all four motions with one set of parameters", "sec. 3.2, 4",
            f"{sum(kinds['3.2'])} of 4 motions are as described by method 3.2 "
            f"({sum(kinds['3.1'])} of 4 by 3.1), e = 0.1, k_con = 100 N/m, γ = 0.5 mm/s throughout",
            judged(all(kinds["3.2"])), True,
        ),
        Claim(
            "12", "in all cases an orbitally stable solution", "sec. 3.2",
            "cycles differ by "
            + ", ".join("–" if s is None else f"{100 * s:.2g} %" for s in scatter)
            + " of the half peak-to-peak amplitude at 1.25, 1.60, 3.25, 3.65 Hz",
            judged(all(s is not None for s in scatter)),
        ),
        Claim(
            "12", "3.2 is distinctly smoother than 3.1 in free vibration", "sec. 3.2",
            f"velocity above harmonic {SMOOTH_HARMONICS} while the tips are more than 1 mm apart, "
            "3.2 over 3.1 (thick / thin): "
            + ", ".join(
                f"{a:.2f} / {b:.2f} at {f:.2f} Hz"
                for f, (a, b) in zip(FREQUENCIES[1:], ratio, strict=True)
            ),
            judged(bool(np.all(ratio < CLEARLY))), True,
        ),
    )  # fmt: skip
