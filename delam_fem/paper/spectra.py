"""Fig. 5 of the paper: spectra at 3.25 Hz, distortion along the laminae and over gap shapes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from delam_fem.numerics.harmonics import (
    distortion_factor,
    harmonic_amplitudes,
    total_harmonic_distortion,
)
from delam_fem.numerics.types import FloatArray
from delam_fem.paper.claims import Criterion, Numbers, Piece, Statement, canvas
from delam_fem.paper.lab import RESONANT, Laboratory, motion_case
from delam_fem.paper.measures import describe, ends
from delam_fem.results import diagnostics
from delam_fem.results.figures.style import BASE_COLOUR, LAMINA_COLOURS, legend_above

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from delam_fem.results.folder import Result

PRINTED = (0.0014, 0.0260)
"""d of the thick and the thin lamina as printed in the paper."""
PRINTED_DIGIT = 0.1
"""Relative difference up to which d counts as reproduced."""
NEARLY_HARMONIC = 0.1
"""A THD below this counts as nearly harmonic."""
SHOWN = 20
"""Number of harmonics that are shown."""
COUNTED = 40
"""Number of harmonics in d of velocities and accelerations, which does not converge with more."""
ORDERS = ("displacement", "velocity", "acceleration")
PRESET_EXPONENT = "2"
"""Exponent of the gap's shape in the preset, as a dictionary key."""


def measure(lab: Laboratory) -> Numbers:
    """Compute the motion at 3.25 Hz with every shape of the gap.

    Returns:
        harmonics_m: harmonics of the displacement of both tips, shape (2, `COUNTED`); d, thd:
        distortion of both tips, by the names of `ORDERS`, shape (2,) [-]; d_at_nodes, thd_at_nodes:
        distortion of both laminae, by order, shape (2, n_nodes) [-]; d_by_gap_exponent: distortion
        of both tips, by the exponent of the gap's shape [-]; kind_by_gap_exponent: motion in words,
        by exponent; tip_min_by_gap_exponent, tip_max_by_gap_exponent: extremes of both tips, by
        exponent [m]; names: of the laminae; x: positions of the nodes, shape (n_nodes,) [mm].
    """
    exponents = lab.plan.gap_exponents
    cases = [motion_case(RESONANT, lab.plan, "3.2", {"gap.exponent": p}) for p in exponents]
    found = dict(zip([f"{p:g}" for p in exponents], lab.motions(cases), strict=True))
    result = found[PRESET_EXPONENT]
    u = diagnostics.last_periods(result.history, result.case)["tip_displacement"].to_numpy()
    tips = _harmonics(u, u.shape[1] // result.case.time.steps_per_period, result)
    u = result.history["displacement"].to_numpy().swapaxes(1, 2)
    nodes = _harmonics(u, result.case.n_window_periods, result)
    at_nodes = {order: distortion_factor(a) for order, a in nodes.items()}

    def by_gap(name: str) -> dict[str, Any]:
        return {p: r.summary[name] for p, r in found.items()}

    return Numbers(
        {
            "harmonics_m": tips["displacement"][:, :COUNTED],
            "d": {order: distortion_factor(a) for order, a in tips.items()},
            "thd": {order: total_harmonic_distortion(a) for order, a in tips.items()},
            "d_at_nodes": at_nodes,
            "thd_at_nodes": {order: np.sqrt((1.0 + d) ** 2 - 1.0) for order, d in at_nodes.items()},
            "d_by_gap_exponent": by_gap("distortion_factor"),
            "kind_by_gap_exponent": {p: describe(r) for p, r in found.items()},
            "tip_min_by_gap_exponent": by_gap("tip_min"),
            "tip_max_by_gap_exponent": by_gap("tip_max"),
        },
        names=[lamina.name for lamina in result.case.lamina],
        x=1e3 * result.history["x"].to_numpy(),
    )


def _harmonics(u: FloatArray, n_periods: int, result: Result) -> dict[str, FloatArray]:
    """Return A_n, n ω A_n, (n ω)² A_n by order; those of derivatives only up to `COUNTED`.

    Args:
        u: displacements over whole periods, shape (..., n_samples) [m].
        n_periods: number of these periods.
        result: gives ω.
    """
    amplitudes = harmonic_amplitudes(u, n_periods)
    rotation = 2.0 * np.pi / result.case.period * np.arange(1, amplitudes.shape[-1] + 1)
    return {
        "displacement": amplitudes,
        "velocity": (amplitudes * rotation)[..., :COUNTED],
        "acceleration": (amplitudes * rotation**2)[..., :COUNTED],
    }


def draw(numbers: Numbers) -> Figure:
    """Draw spectra of the tips, d along the laminae, and d over the shape of the gap."""
    figure = canvas(8.6)
    grid = figure.add_gridspec(3, 2)
    for i in range(2):
        _spectrum(figure.add_subplot(grid[i, 0]), numbers, i)
        _along_lamina(figure.add_subplot(grid[i, 1]), numbers, i)
        _over_exponent(figure.add_subplot(grid[2, i]), numbers, i)
    return figure


def _spectrum(panel: Axes, numbers: Numbers, i: int) -> None:
    """Draw the harmonics of a tip as bars."""
    from matplotlib.ticker import LogLocator

    orders, A = np.arange(1, SHOWN + 1), 1e3 * numbers.harmonics_m[i]
    panel.bar(orders, A[:SHOWN], width=0.6, color=LAMINA_COLOURS[i])
    panel.set(
        xlabel="harmonic of the excitation", xlim=(0.0, SHOWN + 1),
        xticks=np.arange(2, SHOWN + 1, 2),
        ylabel="amplitude [mm]", yscale="log", ylim=(1e-4 * A[0], 2.0 * A[0]),
    )  # fmt: skip
    panel.yaxis.set_major_locator(LogLocator(numticks=8))
    d, thd = (100.0 * float(of["displacement"][i]) for of in (numbers.d, numbers.thd))
    panel.set_title(f"{numbers.names[i]} tip:  d = {d:.2f} %,  THD = {thd:.1f} %")


def _along_lamina(panel: Axes, numbers: Numbers, i: int) -> None:
    """Draw d along a lamina, with THD on the right axis."""
    x = numbers.x
    for order, line in zip(ORDERS, ("-", "--", ":"), strict=True):
        d = 100.0 * numbers.d_at_nodes[order][i, 1:]
        panel.semilogy(x[1:], d, line, marker=".", color=LAMINA_COLOURS[i], label=order)
    panel.secondary_yaxis("right", functions=(_thd_of, _d_of)).set_ylabel("THD [%]")
    panel.set(xlabel="x [mm]", xlim=(0.0, 1.02 * x[-1]), ylabel=f"d of {numbers.names[i]} [%]")
    legend_above(panel)


def _over_exponent(panel: Axes, numbers: Numbers, i: int) -> None:
    """Draw d of a tip over the exponent of the gap's shape."""
    exponents = [float(p) for p in numbers.d_by_gap_exponent]
    d = np.array([both[i] for both in numbers.d_by_gap_exponent.values()])
    panel.plot(exponents, 100.0 * d, "o-", color=LAMINA_COLOURS[i], label="computed")
    panel.axhline(
        100.0 * PRINTED[i],
        color=BASE_COLOUR,
        linestyle="--",
        label=f"paper, {100 * PRINTED[i]:.2f} %",
    )
    panel.set(
        xlabel="exponent p of the gap",
        ylabel=f"$d_{i + 1}$ of the tip [%]", ylim=(0.0, 115.0 * max(float(d.max()), PRINTED[i])),
    )  # fmt: skip
    legend_above(panel)


def _thd_of(d: npt.ArrayLike) -> FloatArray:
    """Return the THD that belongs to a value of d, d = sqrt(1 + THD²) - 1, both in percent."""
    share = np.maximum(np.asarray(d, dtype=np.float64) / 100.0, 0.0)
    return np.asarray(100.0 * np.sqrt(share * (2.0 + share)))


def _d_of(thd: npt.ArrayLike) -> FloatArray:
    """Return the d that belongs to a value of THD, both in percent."""
    share = np.asarray(thd, dtype=np.float64) / 100.0
    return np.asarray(100.0 * (np.sqrt(1.0 + share**2) - 1.0))


def _printed(numbers: Numbers, i: int) -> str:
    """Return d of a tip, and whether the printed value is in its range over the gaps, in words."""
    band = [both[i] for both in numbers.d_by_gap_exponent.values()]
    where = "inside" if min(band) <= PRINTED[i] <= max(band) else "outside"
    return (
        f"{100 * numbers.d['displacement'][i]:.2f} % with p = 2; {100 * min(band):.2f} … "
        f"{100 * max(band):.2f} % for gaps (x/L)^p, p = {ends(numbers.d_by_gap_exponent)} (the "
        f"printed value is {where}); THD {100 * numbers.thd['displacement'][i]:.1f} %"
    )


def _away(numbers: Numbers, i: int) -> Criterion:
    """Return the criterion on d of a tip; the unknown shape of the gap makes d uncertain."""
    own = abs(numbers.d["displacement"][i] / PRINTED[i] - 1.0)
    away = [both[i] / PRINTED[i] - 1.0 for both in numbers.d_by_gap_exponent.values()]
    nearest = 0.0 if min(away) <= 0.0 <= max(away) else min(map(abs, away))
    return Criterion("away by", own, "<", PRINTED_DIGIT, "%", (nearest, max(map(abs, away))))


def _printed_row(i: int, name: str) -> Statement:
    """Return the statement on the printed d of a lamina."""
    return Statement(
        f"d{i + 1} = {100 * PRINTED[i]:.2f} % ({name} lamina, 3.25 Hz)",
        "sec. 2.2",
        lambda n: _printed(n, i),
        lambda n: [_away(n, i)],
    )


SPECTRA = Piece(
    "5",
    "Response spectra",
    f"Method 3.2 at {RESONANT} Hz: amplitudes of the harmonics of both tips, distortion "
    "factors d and THD at every node of displacement, velocity and acceleration (harmonics up "
    f"to {COUNTED}), and d of the tips over the unknown shape of the gap, 12 mm (x/L)^p, "
    "beside the paper's (dashed). The paper's spectra are not available; compared are d₁, d₂ "
    "and its text.",
    measure,
    draw,
    (
        _printed_row(0, "thick"),
        _printed_row(1, "thin"),
        Statement(
            "thick nearly harmonic, thin with a distribution of higher harmonics", "sec. 2.2",
            lambda n: "THD {:.0f} % (thick), {:.0f} % (thin)".format(
                *(100 * thd for thd in n.thd["displacement"])
            ),
            lambda n: [
                Criterion("thick", n.thd["displacement"][0], "<", NEARLY_HARMONIC, "%"),
                Criterion("thin", n.thd["displacement"][1], ">", NEARLY_HARMONIC, "%"),
            ],
        ),
        Statement(
            "velocities and accelerations would highlight the nonlinearity more", "sec. 2.2",
            lambda n: "thin lamina: d = {:.1f} % of the displacement, {:.0f} % of the velocity, "
            "{:.0f} % of the acceleration (harmonics up to {})".format(
                *(100 * n.d[order][1] for order in ORDERS), COUNTED
            ),
            lambda n: [
                Criterion(
                    "velocity over displacement",
                    np.divide(n.d["velocity"][1], n.d["displacement"][1]), ">", 1.0,
                ),
                Criterion(
                    "acceleration over velocity",
                    np.divide(n.d["acceleration"][1], max(n.d["velocity"][1], 1e-12)), ">", 1.0,
                ),
            ],
        ),
    ),
)  # fmt: skip
