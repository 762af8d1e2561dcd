"""Figs. 9, 10 and 13 of the paper: the motion at 3.25 Hz in detail, by both methods."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from delam_fem.paper.claims import Claim, Piece, judged
from delam_fem.paper.figures.motion import CLEARLY, motion_numbers, tip_positions
from delam_fem.paper.lab import FREQUENCIES, LAWS, RESONANT, Laboratory, motion_case
from delam_fem.paper.measures import (
    SMOOTH_HARMONICS,
    roughness,
    settling,
    strikes,
)
from delam_fem.results import diagnostics
from delam_fem.results.dataset import Result
from delam_fem.results.motion_figures import PORTRAIT_PERIODS
from delam_fem.results.style import LAMINA_COLOURS, WIDTH, legend_above

SCATTERS = 3.0
"""Distance from the stationary cycle that counts as near, in its own scatter (rms)."""
LONG = 100
"""Periods from which on a transient counts as some hundred."""
DETAIL = (0.10, 0.25)
"""Part of a period before and after the strike that details show."""


def portrait_of_impacts(lab: Laboratory) -> Piece:
    """Draw the phase portraits of method 3.1 at 3.25 Hz."""
    motions = lab.motions([motion_case(f, lab.plan, "3.1") for f in FREQUENCIES])
    result = motions[FREQUENCIES.index(RESONANT)]
    settled = [_settling(motion) for motion in motions]
    figure, _ = two_portraits([result], ["method 3.1"])
    numbers = motion_numbers(result)
    scatter = float(numbers["strobe_scatter"] or np.nan)
    stable = Claim(
        "9", "Δt = T/1000 gives orbitally stable results", "sec. 3.1",
        f"method 3.1, {numbers['kind']}; successive cycles differ by {100 * scatter:.1f} % of the "
        "half peak-to-peak amplitude (rms at the ends of periods)",
        judged(numbers["periodicity"] == 1),
    )  # fmt: skip
    long = Claim(
        "9", "some hundred periods are necessary to get a stationary state", "sec. 3.1",
        f"from rest, strobes stay within {SCATTERS:g} times the scatter of the stationary cycles "
        "after "
        + ", ".join(f"{n} at {f:.2f} Hz" for n, f in zip(settled, FREQUENCIES, strict=True))
        + " (periods)",
        judged(max(settled) >= LONG),
    )  # fmt: skip
    caption = (
        f"Method 3.1 at {RESONANT} Hz, {PORTRAIT_PERIODS} periods. The paper's experiment beside "
        "it is not available."
    )
    return Piece("9", "Phase portraits by method 3.1", caption, figure, numbers, (stable, long))


def impacts_in_detail(lab: Laboratory) -> Piece:
    """Draw the contact phase by method 3.1: phase portrait [a] and time history [b]."""
    result, other = lab.motions([motion_case(RESONANT, lab.plan, m) for m in LAWS])
    figure = _details([result], ["method 3.1"])
    v, q = (
        roughness(result, free=False, quantity=f"tip_{k}") for k in ("velocity", "displacement")
    )
    impacts = [float(r.summary["impacts_per_period"]) for r in (result, other)]
    numbers = {"roughness_velocity": v, "roughness_displacement": q, "impacts_per_period": impacts}
    claims = (
        Claim(
            "10", "permanent contact is captured by numerous single impacts", "sec. 3.1",
            f"{impacts[0]:.0f} impacts on all pairs per period at {RESONANT} Hz ({impacts[1]:.0f} "
            "by method 3.2)",
            judged(impacts[0] > 1.0),
        ),
        Claim(
            "10", "the time history is hardly affected by successive impacts", "sec. 3.1",
            f"share of the motion above harmonic {SMOOTH_HARMONICS} while the tips are near: "
            f"velocity {100 * v[0]:.0f} / {100 * v[1]:.0f} %, displacement {100 * q[0]:.1f} / "
            f"{100 * q[1]:.1f} % (thick / thin)",
            judged(max(q) < 0.1 * max(v)),
        ),
    )  # fmt: skip
    caption = f"Method 3.1 at {RESONANT} Hz about one strike, every time step a dot."
    return Piece("10", "Contact phase by method 3.1", caption, figure, numbers, claims)


def contact_in_detail(lab: Laboratory) -> Piece:
    """Draw the contact phase by method 3.2 beside that by method 3.1."""
    found = {m: lab.motions([motion_case(RESONANT, lab.plan, m)])[0] for m in LAWS}
    figure = _details([found["3.2"], found["3.1"]], ["method 3.2", "method 3.1"])
    rough = {m: roughness(r, free=False) for m, r in found.items()}
    ratio = np.divide(rough["3.2"], rough["3.1"])
    claim = Claim(
        "13", "permanent contact makes the contact phase more realistic", "sec. 3.2",
        f"velocity above harmonic {SMOOTH_HARMONICS} while the tips are near, 3.2 over 3.1: "
        f"{ratio[0]:.2f} (thick), {ratio[1]:.2f} (thin)",
        judged(bool(np.all(ratio < CLEARLY))),
    )  # fmt: skip
    caption = f"{RESONANT} Hz about one strike by both methods, every time step a dot."
    numbers = {"roughness_near": rough, "ratio": ratio}
    return Piece("13", "Contact phase by method 3.2", caption, figure, numbers, (claim,))


def two_portraits(
    results: list[Result], titles: list[str], *, has_row_below: bool = False
) -> tuple[Figure, list[Axes]]:
    """Draw the portraits of thick and thin in columns, results in rows.

    Args:
        results: at least one.
        titles: of the rows.
        has_row_below: whether to leave a row for something else.

    Returns:
        The figure, and the axes of the row below.
    """
    rows, n_below = len(results), int(has_row_below)
    figure = Figure(figsize=(WIDTH, 0.6 + 3.9 * rows + 2.8 * n_below), layout="constrained")
    grid = figure.add_gridspec(rows + n_below, 2, height_ratios=[3.9] * rows + [2.8] * n_below)
    above = grid[:rows, :].subgridspec(rows, 2)
    panels = above.subplots(squeeze=False, sharex="col", sharey=True)
    for row, result, title in zip(panels, results, titles, strict=True):
        portrait = diagnostics.phase_portrait(result.history, result.case, PORTRAIT_PERIODS)
        for i, panel in enumerate(row):
            panel.plot(1e3 * portrait[i, 0], portrait[i, 1], color=LAMINA_COLOURS[i], linewidth=0.6)
            panel.set_title(f"{result.case.lamina[i].name}, {title}", loc="left")
        row[0].set_ylabel("velocity of the tip [m/s]")
    for i, panel in enumerate(panels[-1]):
        panel.set_xlabel(f"displacement of the tip $q_{i + 1}$ [mm]")
    return figure, [figure.add_subplot(grid[rows, i]) for i in range(2 * n_below)]


def _details(results: list[Result], titles: list[str]) -> Figure:
    """Draw the phase portrait and the history about a strike; one row per result."""
    figure = Figure(figsize=(WIDTH, 0.5 + 4.1 * len(results)), layout="constrained")
    panels = figure.subplots(len(results), 2, squeeze=False, sharex="col", sharey="col")
    for row, result, title in zip(panels, results, titles, strict=True):
        N = result.case.time.steps_per_period
        t, y = tip_positions(result, PORTRAIT_PERIODS)
        v = diagnostics.phase_portrait(result.history, result.case, PORTRAIT_PERIODS)[:, 1]
        steps = strikes(result).step
        at = int(steps[steps + DETAIL[1] * N < t.size][-1])
        part = slice(max(at - int(DETAIL[0] * N), 0), at + int(DETAIL[1] * N))
        for i, colour in enumerate(LAMINA_COLOURS):
            name = result.case.lamina[i].name
            style = {"color": colour, "linewidth": 0.7, "marker": ".", "markersize": 2.5}
            row[0].plot(y[i, part], v[i, part], label=name, **style)
            row[1].plot(t[part] - t[at], y[i, part], label=name, **style)
        row[0].set_title(f"[a] phase portrait, {title}", loc="left")
        row[1].set_title("[b] history", loc="left")
        row[0].set_ylabel("velocity of the tip [m/s]")
        row[1].set_ylabel("position of the tip [mm]")
        row[1].set_xticks(np.arange(-1, 3) / 10.0)
    panels[-1][0].set_xlabel("position of the tip [mm]")
    panels[-1][1].set_xlabel("time since the strike  t/T [–]")
    legend_above(panels[0][1])
    return figure


def _settling(result: Result) -> int:
    """Return after how many periods a motion is as near its stationary cycle as it will be."""
    strobe = result.history["strobe_displacement"].to_numpy()
    half = 0.5 * np.ptp(result.history["tip_displacement"].to_numpy(), axis=1)
    scatter = result.summary["strobe_scatter"] or diagnostics.PERIODIC_SCATTER
    return settling(strobe, half, result.summary["periodicity"] or 1, SCATTERS * scatter)
