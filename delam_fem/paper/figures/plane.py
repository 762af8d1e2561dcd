"""Fig. 15 of the paper: the plane (e, k_con) at 3.25 Hz, compared with that of the penalty law."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from delam_fem.numerics import attractors
from delam_fem.paper.claims import Claim, Criterion, Numbers, Piece, judged
from delam_fem.paper.lab import Laboratory
from delam_fem.paper.measures import KINDS, Decade, Plane, best_decade, plane_of
from delam_fem.results.diagnostics import LARGEST_PERIODICITY, PERIODIC_MARGIN, PERIODIC_SCATTER
from delam_fem.results.figures.style import (
    BLACK,
    GREEN,
    ORANGE,
    SKY,
    VERMILLION,
    WIDTH,
    legend_above,
)

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

RESTITUTIONS = (0.0, 0.5)
STIFFNESSES = (10.0, 1000.0)
"""Ranges of e and k_con [N/m]; k_con goes a decade to both sides of 100. The paper's axes are not
known."""
PENALTY_STIFFNESSES = (100.0, 10000.0)
PENALTY_DAMPINGS = (0.01, 10.0)
"""Ranges of k [N/m] and c [N s/m] of the classical law. Softer springs let the laminae pass through
one another. A pair of nodes is critically damped at c = 2 sqrt(k m1 m2/(m1 + m2)) = 1 … 10."""
STROBES = 128
"""Number of last strobes, of 200 periods, that decide the kind of motion."""
FEW = 0.1
"""A share of exceptions below this counts as few."""
CORRECT_SHARE = 0.5
TOLD_THRESHOLDS = (5.0, 7.0, 8.0, 10.0, 12.0)
"""Thresholds of the scatter that the text quotes [%]."""
SHOWN_THRESHOLDS = (2.0, 3.0, 5.0, 7.0, 10.0, 15.0, 20.0, 30.0, 50.0)
KIND_COLOURS = (SKY, ORANGE, GREEN, "#bbbbbb", BLACK, "#ffffff", "#cfe8f7", "#e0e0e0")


@dataclass(frozen=True)
class Planes(Numbers):
    """The parameter planes of both laws.

    Attributes:
        impact: plane of method 3.2, newton-penalty.
        penalty: plane of the classical penalty law.
        best_decade: best decade of the penalty law's damping.
        points: points per axis.
        periods: periods of each point.
    """

    impact: Plane
    penalty: Plane
    best_decade: Decade
    points: int
    periods: int

    def to_json(self) -> Mapping[str, Any]:
        """Return the planes by the names of their laws."""
        best = {"best_decade": self.best_decade.to_json()}
        return {
            "newton-penalty": self.impact.to_json(),
            "penalty": {**self.penalty.to_json(), **best},
        }


def measure(lab: Laboratory) -> Planes:
    """Compute the planes of both laws."""
    impact, penalty = (plane_of(_sweep(lab, law)) for law in ("newton-penalty", "penalty"))
    return Planes(
        impact=impact,
        penalty=penalty,
        best_decade=best_decade(penalty.first, penalty.kind, penalty.tip_amplitude_m),
        points=lab.plan.plane_points,
        periods=lab.plan.plane_periods,
    )


def _sweep(lab: Laboratory, law: str) -> xr.Dataset:
    """Compute the parameter plane of a law."""
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


def draw(numbers: Planes) -> Figure:
    """Draw kinds of motion and scatter of both laws over their parameters."""
    from matplotlib.figure import Figure
    from matplotlib.patches import Patch

    both = (numbers.impact, numbers.penalty)
    titles = ("method 3.2", "classical penalty law")
    figure = Figure(figsize=(WIDTH, 12.0), layout="constrained")
    grid = figure.add_gridspec(3, 2, height_ratios=[4.3, 4.3, 2.8])
    panels = grid[:2, :].subgridspec(2, 2).subplots(squeeze=False)
    _shares(figure.add_subplot(grid[2, :]), both, titles)
    top = max(float(np.nanmax(plane.scatter)) for plane in both)
    for (left, right), plane, title in zip(panels, both, titles, strict=True):
        _kinds(left, plane, title)
        _scatter(figure, right, plane, top)
    present = sorted({int(k) for plane in both for k in np.unique(plane.kind)})
    patches = [Patch(facecolor=KIND_COLOURS[k], edgecolor=BLACK, label=KINDS[k]) for k in present]
    figure.legend(handles=patches, loc="outside upper left", ncols=6, frameon=False)
    return figure


def _shares(panel: Axes, planes: tuple[Plane, ...], titles: tuple[str, ...]) -> None:
    """Draw how the share of one-periodic points depends on the threshold of the scatter."""
    for plane, title, line in zip(planes, titles, ("o-", "s--"), strict=True):
        thresholds = list(plane.one_periodic_by_threshold)
        share = 100.0 * np.array(list(plane.one_periodic_by_threshold.values()))
        panel.semilogx(thresholds, share, line, color=BLACK, label=title)
    at, margin = 100.0 * PERIODIC_SCATTER, PERIODIC_MARGIN
    panel.axvline(at, color=VERMILLION, linewidth=2.0)
    panel.axvspan(
        at / margin,
        at * margin,
        color=KIND_COLOURS[attractors.UNDECIDED],
        zorder=0,
        label="undecided",
    )
    panel.set(xlabel="threshold of the scatter one period apart [%]")
    panel.set(ylabel="points below it [%]", ylim=(0.0, 105.0))
    panel.set_xticks(SHOWN_THRESHOLDS, [f"{t:g}" for t in SHOWN_THRESHOLDS])
    panel.minorticks_off()
    legend_above(panel)


def _kinds(panel: Axes, plane: Plane, title: str) -> None:
    """Draw the kinds of motion in a plane."""
    from matplotlib.colors import ListedColormap

    panel.grid(False)
    panel.pcolormesh(
        plane.first, plane.second, plane.kind.T, shading="nearest",
        cmap=ListedColormap(list(KIND_COLOURS)), vmin=-0.5, vmax=len(KIND_COLOURS) - 0.5,
    )  # fmt: skip
    panel.set_title(f"{title}: {100 * plane.share['one-periodic']:.0f} % one-periodic", loc="left")
    _label(panel, plane)


def _scatter(figure: Figure, panel: Axes, plane: Plane, top: float) -> None:
    """Draw the scatter in a plane."""
    from matplotlib.colors import LogNorm

    panel.grid(False)
    mesh = panel.pcolormesh(
        plane.first, plane.second, plane.scatter.T, shading="nearest",
        cmap="cividis", norm=LogNorm(1e-3, max(top, 2e-3), clip=True),
    )  # fmt: skip
    bar = figure.colorbar(mesh, ax=panel, label="scatter one period apart [–]")
    bar.ax.axhline(PERIODIC_SCATTER, color=VERMILLION, linewidth=2.0)
    _label(panel, plane)


def _label(panel: Axes, plane: Plane) -> None:
    """Label the axes of a plane and mark the paper's parameters."""
    panel.set_yscale("log")
    if plane.axes[0] == "restitution":
        panel.set(xlabel="restitution e [–]", ylabel="$k_{con}$ [N/m]")
        panel.plot([0.1], [100.0], "o", markersize=10, markerfacecolor="none",
                   markeredgecolor=VERMILLION, markeredgewidth=2.0)  # fmt: skip
    else:
        panel.set_xscale("log")
        panel.set(xlabel="damping c [N s/m]", ylabel="stiffness k [N/m]")


def judge(numbers: Planes) -> tuple[Claim, ...]:
    """Judge the robustness of method 3.2 and the sensitivity of the classical penalty law."""
    return *_claims_on_robustness(numbers.impact), _claim_on_penalty(numbers)


def _claims_on_robustness(ours: Plane) -> tuple[Claim, ...]:
    """Judge the statements about the plane of method 3.2."""
    spread, by_e, by_k = ours.amplitude_spread, ours.amplitude_by_first, ours.amplitude_by_second
    kinds = ", ".join(f"{100 * v:.0f} % {k}" for k, v in ours.share.items() if v > 0.0)
    share, within = ours.share["one-periodic"], ours.one_periodic_within
    by_threshold = ", ".join(
        f"{100 * ours.one_periodic_by_threshold[t]:.0f} % at {t:g} %" for t in TOLD_THRESHOLDS
    )
    return (
        Claim(
            "15", "remarkable robustness in the choice of e and k_con", "sec. 3.2, 4",
            f"e = 0 … 0.5, k_con = 10 … 1000 N/m: {kinds}; half peak-to-peak amplitudes vary by "
            f"{100 * spread[0]:.0f} / {100 * spread[1]:.0f} % (standard deviation, thick / "
            f"thin); the share with a scatter below a threshold is {by_threshold}",
            *judged(Criterion("one-periodic", share, ">", CORRECT_SHARE, "%", within)),
        ),
        Claim(
            "15", "apart from a few exceptions one contact event in one period", "sec. 3.2",
            f"one tip contact per period at {100 * ours.one_contact_share:.0f} % of the points",
            *judged(Criterion("share", ours.one_contact_share, ">", 1.0 - FEW, "%")),
        ),
        Claim(
            "15", "e mainly affects the solution, k_con hardly", "sec. 3.2",
            f"share of the variance of the amplitudes (thick / thin): e {100 * by_e[0]:.0f} / "
            f"{100 * by_e[1]:.0f} %, k_con {100 * by_k[0]:.0f} / {100 * by_k[1]:.0f} %",
            *judged(
                Criterion("smaller e over k_con", float(np.min(by_e / by_k)), ">", 1.0)
            ),
        ),
    )  # fmt: skip


def _claim_on_penalty(numbers: Planes) -> Claim:
    """Compare the penalty law, in its best decade of damping, with method 3.2."""
    ours, penalty, best = numbers.impact, numbers.penalty, numbers.best_decade
    share = [plane.share["one-periodic"] for plane in (ours, penalty)]
    spread = [plane.amplitude_spread for plane in (ours, penalty)]
    return Claim(
        "15", "the classical penalty law is far more sensitive", "sec. 3.2, 4",
        "k = 100 … 10000 N/m, c = 0.01 … 10 N s/m: "
        f"{100 * share[1]:.0f} % one-periodic, one tip contact per period at "
        f"{100 * penalty.one_contact_share:.0f} %, amplitudes vary by "
        f"{100 * spread[1][0]:.0f} / {100 * spread[1][1]:.0f} % (method 3.2: "
        f"{100 * share[0]:.0f} %, {100 * ours.one_contact_share:.0f} %, "
        f"{100 * spread[0][0]:.0f} / {100 * spread[0][1]:.0f} %); in its best decade of c, "
        f"from {best.begin:.2g} N s/m on, {100 * best.one_periodic:.0f} % and "
        f"{100 * best.amplitude_spread[0]:.0f} / {100 * best.amplitude_spread[1]:.0f} %",
        *judged(
            Criterion(
                "one-periodic in the best decade over method 3.2",
                _over(best.one_periodic, share[0]), "<", 1.0, "",
                (best.one_periodic / ours.one_periodic_within[1],
                 best.one_periodic_within[1] / share[0]),
            ),
            Criterion(
                "smaller ratio of the amplitudes' variation",
                float(np.min(best.amplitude_spread / spread[0])), ">", 1.0,
            ),
        ),
    )  # fmt: skip


PLANES = Piece(
    "15",
    "Parameter planes",
    "{0.points} × {0.points} points, {0.periods} periods each, "
    f"T/1000, 3.25 Hz. Period P: strobes P ≤ {LARGEST_PERIODICITY} periods apart differ by "
    f"less than {100 * PERIODIC_SCATTER:g} % of the half peak-to-peak amplitude (rms of the "
    f"worse tip over the last 40 periods); quasi-periodic: {100 * attractors.LINE_SHARE:g} % "
    f"of the power of the last {STROBES} strobes in {attractors.LINES} spectral lines; "
    "irregular: neither; undecided: the class changes with the threshold times or over "
    f"{PERIODIC_MARGIN:g}. Right: that scatter for P = 1 (line: the threshold). Below: the share "
    "of points with a scatter below a threshold. Ring: the "
    "paper's parameters. The axes of the paper's plane are not known; compared is what its text "
    "says of it.",
    measure,
    draw,
    judge,
)


def _over(part: float, whole: float) -> float:
    """Return a ratio; NaN, with which no criterion holds, if the whole is 0."""
    return part / whole if whole else math.nan
