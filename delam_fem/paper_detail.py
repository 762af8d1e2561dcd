"""Figs. 9, 10, 13 and 14 of the paper: the motion at 3.25 Hz in detail, by both methods."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from matplotlib.figure import Figure

from delam_fem import diagnostics
from delam_fem.figure_style import LAMINA_COLOURS, WIDTH, legend_above
from delam_fem.motion_figures import PORTRAIT_PERIODS
from delam_fem.paper_claims import Claim, Piece, judged
from delam_fem.paper_lab import FREQUENCIES, LAWS, Laboratory, motion_case
from delam_fem.paper_measures import (
    SMOOTH_HARMONICS,
    describe,
    rough_part,
    roughness,
    settling,
    strikes,
)
from delam_fem.paper_motion import CLEARLY, RESONANT, motion_numbers, tip_positions
from delam_fem.results import Result

FloatArray = npt.NDArray[np.float64]

FINE_ELEMENTS = 50
LONG_WINDOW = {"output.window_periods": 40, "output.fields_per_period": 0}
"""For the roughness of motions whose cycles scatter."""
LONG = 100
"""Periods from which on a transient counts as some hundred."""
VARIANTS: dict[str, dict[str, object]] = {
    "as printed": {},
    "consistent impulses": {"contact.impulse": "consistent"},
    "lumped mass": {"time.mass": "lumped"},
}
"""Schemes with which the finer mesh is tried; "as printed" can add energy at impacts."""
DETAIL = (0.10, 0.25)
"""Part of a period before and after the strike that details show."""


def portrait_of_impacts(lab: Laboratory) -> Piece:
    """Draw the phase portraits of method 3.1 at 3.25 Hz."""
    motions = lab.motions([motion_case(f, lab.plan, "3.1") for f in FREQUENCIES])
    result = motions[FREQUENCIES.index(RESONANT)]
    settled = [_settling(motion) for motion in motions]
    figure = _two_portraits([result], [""])
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
        "from rest, strobes stay near the stationary cycle after "
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


def finer_mesh(lab: Laboratory) -> Piece:
    """Draw the phase portraits of method 3.2 with 50 elements beside those with 20."""
    cases = [
        motion_case(RESONANT, lab.plan, "3.2", keys | LONG_WINDOW | {"mesh.elements": n})
        for keys in VARIANTS.values()
        for n in (20, FINE_ELEMENTS)
    ]
    coarse, fine, *others = lab.motions(cases)
    ratios = {
        name: _rough_velocity(others[2 * k + 1]) / _rough_velocity(others[2 * k])
        for k, name in enumerate(list(VARIANTS)[1:])
    }
    figure = _two_portraits([coarse, fine], ["20 elements", f"{FINE_ELEMENTS} elements"])
    rough = np.array([roughness(r, free=True) for r in (coarse, fine)])
    all_time = np.array([_rough_velocity(r) for r in (coarse, fine)])
    cost = fine.summary["microseconds_per_step"] / coarse.summary["microseconds_per_step"]
    numbers = {
        "roughness_free": rough, "roughness": all_time, "cost": cost,
        "ratio_of_variants": ratios, "20": motion_numbers(coarse), "50": motion_numbers(fine),
    }  # fmt: skip
    ratio = all_time[1] / all_time[0]
    claims = (
        Claim(
            "14", "50 elements: considerably less high-frequency velocity", "sec. 3.2",
            f"velocity above harmonic {SMOOTH_HARMONICS} over 40 periods, 50 over 20 elements: "
            f"{ratio[0]:.2f} (thick), {ratio[1]:.2f} (thin); {describe(fine)}; "
            + ", ".join(f"with {name} {a:.2f} / {b:.2f}" for name, (a, b) in ratios.items()),
            judged(bool(np.all(ratio < CLEARLY))), True,
        ),
        Claim(
            "14", "a substantial increase in calculation time has to be accepted", "sec. 3.2",
            f"{2.5:g} times the unknowns cost {max(cost, 1.0):.1f} times the time per step with "
            "banded matrices in compiled code", "open",
        ),
    )  # fmt: skip
    caption = (
        f"Method 3.2 at {RESONANT} Hz, {PORTRAIT_PERIODS} periods; all other parameters identical. "
        "The paper's portrait is not available; compared is the sentence on high frequencies."
    )
    return Piece("14", "A finer mesh", caption, figure, numbers, claims)


def _two_portraits(results: list[Result], titles: list[str]) -> Figure:
    """Draw the portraits of thick and thin in columns, results in rows."""
    rows = len(results)
    figure = Figure(figsize=(WIDTH, 0.6 + 3.9 * rows), layout="constrained")
    panels = figure.subplots(rows, 2, squeeze=False, sharex="col", sharey=True)
    for row, result, title in zip(panels, results, titles, strict=True):
        portrait = diagnostics.phase_portrait(result.history, result.case, PORTRAIT_PERIODS)
        for i, panel in enumerate(row):
            panel.plot(1e3 * portrait[i, 0], portrait[i, 1], color=LAMINA_COLOURS[i], linewidth=0.6)
            name = result.case.lamina[i].name
            panel.set_title(f"{name}, {title}" if title else name, loc="left")
        row[0].set_ylabel("velocity of the tip [m/s]")
    for i, panel in enumerate(panels[-1]):
        panel.set_xlabel(f"displacement of the tip $q_{i + 1}$ [mm]")
    return figure


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
    panels[-1][0].set_xlabel("position of the tip [mm]")
    panels[-1][1].set_xlabel("time since the strike  t/T [–]")
    legend_above(panels[0][1])
    return figure


def _settling(result: Result) -> int:
    """Return after how many periods a motion is near its stationary cycle."""
    strobe = result.history["strobe_displacement"].to_numpy()
    half = 0.5 * np.ptp(result.history["tip_displacement"].to_numpy(), axis=1)
    return settling(strobe, half, result.summary["periodicity"] or 1)


def _rough_velocity(result: Result) -> FloatArray:
    """Return rms of the rough part of both tip velocities [m/s]."""
    whole = diagnostics.last_periods(result.history, result.case)["tip_velocity"].to_numpy()
    rough = rough_part(whole, whole.shape[1] // result.case.time.steps_per_period)
    rms: FloatArray = np.sqrt((rough**2).mean(axis=1))
    return rms
