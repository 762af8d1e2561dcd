"""Fig. 15 of the paper: the plane (e, k_con) at 3.25 Hz, and beside it that of the penalty law."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap, LogNorm
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from delam_fem.numerics import attractors
from delam_fem.paper.claims import Claim, Piece, judged
from delam_fem.paper.figures.plane_measures import KINDS, axes_of, best_decade, plane_numbers
from delam_fem.paper.lab import Laboratory
from delam_fem.results.diagnostics import LARGEST_PERIODICITY, PERIODIC_SCATTER
from delam_fem.results.style import BLACK, GREEN, ORANGE, SKY, VERMILLION, WIDTH

if TYPE_CHECKING:
    import xarray as xr


RESTITUTIONS = (0.0, 0.5)
STIFFNESSES = (10.0, 1000.0)
"""Ranges of e and k_con [N/m], the latter a decade to both sides of 100; the paper's axes are not
known."""
PENALTY_STIFFNESSES = (100.0, 10000.0)
PENALTY_DAMPINGS = (0.01, 10.0)
"""Ranges of k [N/m] and c [N s/m] of the classical law. Softer springs let the laminae pass through
one another; a pair of nodes is critically damped at c = 2 sqrt(k m1 m2/(m1 + m2)) = 1 … 10."""
STROBES = 128
"""Of the 200 periods, by which the kind of motion is told."""
FEW = 0.1
"""A share of exceptions that counts as few."""
CORRECT_SHARE = 0.5
KIND_COLOURS = (SKY, ORANGE, GREEN, "#bbbbbb", BLACK, "#ffffff")


def planes(lab: Laboratory) -> Piece:
    """Draw kinds of motion and scatter of both laws over their parameters."""
    both = {
        "newton-penalty": _sweep(lab, "newton-penalty"),
        "penalty": _sweep(lab, "penalty"),
    }
    numbers = {law: plane_numbers(data) for law, data in both.items()}
    penalty = numbers["penalty"]
    penalty["best_decade"] = best_decade(
        *(penalty[name] for name in ("penalty_damping", "kind", "tip_amplitude_m"))
    )
    figure = Figure(figsize=(WIDTH, 9.2), layout="constrained")
    panels = figure.subplots(2, 2)
    top = max(float(np.nanmax(n["scatter"])) for n in numbers.values())
    for row, (law, data) in zip(panels, both.items(), strict=True):
        title = "method 3.2" if law == "newton-penalty" else "classical penalty law"
        _kinds(row[0], data, numbers[law], title)
        _scatter(figure, row[1], data, numbers[law], top)
    present = sorted({int(k) for n in numbers.values() for k in np.unique(n["kind"])})
    patches = [Patch(facecolor=KIND_COLOURS[k], edgecolor=BLACK, label=KINDS[k]) for k in present]
    figure.legend(handles=patches, loc="outside upper left", ncols=6, frameon=False)
    plan = lab.plan
    caption = (
        f"{plan.plane_points} × {plan.plane_points} points, {plan.plane_periods} periods each, "
        f"T/1000, 3.25 Hz. Period P: strobes P ≤ {LARGEST_PERIODICITY} periods apart differ by "
        f"less than {100 * PERIODIC_SCATTER:g} % of the half peak-to-peak amplitude (rms of the "
        f"worse tip over the last 40 periods); quasi-periodic: {100 * attractors.LINE_SHARE:g} % "
        f"of the power of the last {STROBES} strobes in {attractors.LINES} spectral lines; "
        "irregular: neither. Right: that scatter for P = 1 (line: the threshold). Ring: the "
        "paper's parameters. The axes of the paper's plane are not known; compared is what its "
        "text says of it."
    )
    return Piece("15", "Parameter planes", caption, figure, numbers, _claims(numbers))


def _sweep(lab: Laboratory, law: str) -> xr.Dataset:
    """Compute the plane of a law."""
    n = lab.plan.plane_points
    x: dict[str, Any] = {"key": "contact.restitution", "start": RESTITUTIONS[0]}
    x |= {"stop": RESTITUTIONS[1], "count": n}
    ends = STIFFNESSES
    if law == "penalty":
        x = {"key": "contact.penalty_damping", "start": PENALTY_DAMPINGS[0]}
        x |= {"stop": PENALTY_DAMPINGS[1], "count": n, "spacing": "logarithmic"}
        ends = PENALTY_STIFFNESSES
    y = {"key": "contact.penalty_stiffness", "start": ends[0], "stop": ends[1], "count": n}
    return lab.sweep(
        {
            "name": f"plane {law}",
            "set": {"contact": {"law": law}, "time": {"periods": lab.plan.plane_periods}},
            "axis": [x, y | {"spacing": "logarithmic"}],
            "record": {"strobes": min(STROBES, lab.plan.plane_periods)},
        }
    )


def _kinds(panel: Axes, data: xr.Dataset, numbers: dict[str, Any], title: str) -> None:
    """Draw the kinds of motion of a plane."""
    first, second = axes_of(data)
    panel.grid(False)
    panel.pcolormesh(
        numbers[first], numbers[second], np.asarray(numbers["kind"]).T, shading="nearest",
        cmap=ListedColormap(list(KIND_COLOURS)), vmin=-0.5, vmax=len(KIND_COLOURS) - 0.5,
    )  # fmt: skip
    panel.set_title(
        f"{title}: {100 * numbers['share']['one-periodic']:.0f} % one-periodic", loc="left"
    )
    _label(panel, first)


def _scatter(
    figure: Figure, panel: Axes, data: xr.Dataset, numbers: dict[str, Any], top: float
) -> None:
    """Draw the scatter of a plane."""
    first, second = axes_of(data)
    panel.grid(False)
    mesh = panel.pcolormesh(
        numbers[first], numbers[second], np.asarray(numbers["scatter"]).T, shading="nearest",
        cmap="cividis", norm=LogNorm(1e-3, max(top, 2e-3), clip=True),
    )  # fmt: skip
    bar = figure.colorbar(mesh, ax=panel, label="scatter one period apart [–]")
    bar.ax.axhline(PERIODIC_SCATTER, color=VERMILLION, linewidth=2.0)
    _label(panel, first)


def _label(panel: Axes, first: str) -> None:
    """Label the axes of a plane and mark the paper's parameters."""
    panel.set_yscale("log")
    if first == "restitution":
        panel.set(xlabel="restitution e [–]", ylabel="$k_{con}$ [N/m]")
        panel.plot([0.1], [100.0], "o", markersize=10, markerfacecolor="none",
                   markeredgecolor=VERMILLION, markeredgewidth=2.0)  # fmt: skip
    else:
        panel.set_xscale("log")
        panel.set(xlabel="damping c [N s/m]", ylabel="stiffness k [N/m]")


def _claims(numbers: dict[str, dict[str, Any]]) -> tuple[Claim, ...]:
    ours, penalty = numbers["newton-penalty"], numbers["penalty"]
    share = {law: n["share"]["one-periodic"] for law, n in numbers.items()}
    spread = [np.asarray(n["amplitude_spread"]) for n in (ours, penalty)]
    by_e, by_k = (np.asarray(ours[f"amplitude_by_{axis}"]) for axis in ("first", "second"))
    best = penalty["best_decade"]
    kinds = ", ".join(f"{100 * v:.0f} % {k}" for k, v in ours["share"].items() if v > 0.0)
    return (
        Claim(
            "15", "remarkable robustness in the choice of e and k_con", "sec. 3.2, 4",
            f"e = 0 … 0.5, k_con = 10 … 1000 N/m: {kinds}; half peak-to-peak amplitudes vary by "
            f"{100 * spread[0][0]:.0f} / {100 * spread[0][1]:.0f} % (standard deviation, thick / "
            "thin)",
            judged(share["newton-penalty"] > CORRECT_SHARE), True,
        ),
        Claim(
            "15", "apart from a few exceptions one contact event in one period", "sec. 3.2",
            f"one tip contact per period at {100 * ours['one_contact_share']:.0f} % of the points",
            judged(ours["one_contact_share"] > 1.0 - FEW), True,
        ),
        Claim(
            "15", "e mainly affects the solution, k_con hardly", "sec. 3.2",
            f"share of the variance of the amplitudes (thick / thin): e {100 * by_e[0]:.0f} / "
            f"{100 * by_e[1]:.0f} %, k_con {100 * by_k[0]:.0f} / {100 * by_k[1]:.0f} %",
            judged(bool(np.all(by_e > by_k))), True,
        ),
        Claim(
            "15", "the classical penalty law is far more sensitive", "sec. 3.2, 4",
            "k = 100 … 10000 N/m, c = 0.01 … 10 N s/m: "
            f"{100 * share['penalty']:.0f} % one-periodic, one tip contact per period at "
            f"{100 * penalty['one_contact_share']:.0f} %, amplitudes vary by "
            f"{100 * spread[1][0]:.0f} / {100 * spread[1][1]:.0f} % (method 3.2: "
            f"{100 * share['newton-penalty']:.0f} %, {100 * ours['one_contact_share']:.0f} %, "
            f"{100 * spread[0][0]:.0f} / {100 * spread[0][1]:.0f} %); in its best decade of c, "
            f"from {best['from']:.2g} N s/m on, {100 * best['one_periodic']:.0f} % and "
            f"{100 * best['amplitude_spread'][0]:.0f} / {100 * best['amplitude_spread'][1]:.0f} %",
            judged(
                best["one_periodic"] < share["newton-penalty"]
                and bool(np.all(best["amplitude_spread"] > spread[0]))
            ), True,
        ),
    )  # fmt: skip
