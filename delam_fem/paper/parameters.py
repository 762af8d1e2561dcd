"""Other parameters: Fig. 15 (planes of motions) and the remarks on γ and the time integration."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import numpy as np

from delam_fem.api import (
    FloatArray,
    IntArray,
    assemble,
    diagnostics,
    largest_stable_time_step,
    settling,
    style,
)
from delam_fem.paper.claims import Criterion, Numbers, Piece, Statement, between
from delam_fem.paper.panels import line, show
from delam_fem.paper.runs import FREQUENCIES, RESONANT, Laboratory, motion_case

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes
    from matplotlib.collections import QuadMesh
    from matplotlib.figure import Figure

    from delam_fem.api import Result

# -- Fig. 15: the plane (e, k_con) at 3.25 Hz, compared with that of the penalty law ------------

PLANE_AXES = {
    "newton-penalty": (
        ("contact.restitution", (0.0, 0.5), "linear", "restitution e [–]"),
        ("contact.penalty_stiffness", (10.0, 1000.0), "logarithmic", "$k_{con}$ [N/m]"),
    ),
    "penalty": (
        ("contact.penalty_damping", (0.01, 10.0), "logarithmic", "damping c [N s/m]"),
        ("contact.penalty_stiffness", (100.0, 10000.0), "logarithmic", "stiffness k [N/m]"),
    ),
}
"""Keys, ranges, spacings and labels of both axes of a plane, by the law.

The paper's axes are not known; k_con goes a decade to both sides of 100. Softer springs of the law
"penalty" let the laminae pass through one another. A pair of nodes is critically damped at
c = 2 sqrt(k m1 m2/(m1 + m2)) = 1 … 10."""
SWEPT_STROBES = 128
"""Number of last strobes, of 200 periods, that decide the kind of motion."""
FEW = 0.1
"""A share of exceptions below this counts as few."""
CORRECT_SHARE = 0.5
TOLD_THRESHOLDS = (5.0, 7.0, 8.0, 10.0, 12.0)
"""Thresholds of the scatter that the text quotes [%]."""
SHOWN_THRESHOLDS = (2.0, 3.0, 5.0, 7.0, 10.0, 15.0, 20.0, 30.0, 50.0)
KINDS = (
    "one-periodic", "higher order", "quasi-periodic", "irregular", "diverged", "failed",
    "undecided", "not settled",
)  # fmt: skip
"""The paper's names for the kinds of motion, in the order of `settling.KINDS`."""
THRESHOLDS = (2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 10.0, 11.0, 12.0, 15.0, 20.0, 30.0, 50.0)
"""Largest scatters of a one-periodic motion that are tried [%]."""
ONE_CONTACT = (0.95, 1.05)
"""A number of tip contacts per period in this range counts as one."""


def one_period_scatter(strobes: FloatArray, half_range: FloatArray) -> FloatArray:
    """Return the rms difference of strobes one period apart, in half ranges, of the worse tip.

    Args:
        strobes: displacements of both tips at the ends of periods, shape (..., 2, n) [m].
        half_range: half peak-to-peak of both tips, shape (..., 2) [m].

    Returns:
        Scatter, shape (...) [-].
    """
    change = np.diff(strobes[..., -diagnostics.STROBES :], axis=-1)
    return np.asarray((np.sqrt((change**2).mean(axis=-1)) / half_range).max(axis=-1))


def plane_of(data: xr.Dataset, law: str) -> Numbers:
    """Return the motions of a law over a plane of two parameters with m and n values.

    Returns:
        Both parameters by their own names, first damping or restitution, then stiffness; kind: kind
        of motion, an index into `KINDS`, shape (m, n); kinds: names of these indices; share: share
        of the points by kind [-]; scatter: rms difference of strobes one period apart, in half
        ranges, shape (m, n) [-]; one_periodic_by_threshold: share of the points whose scatter is
        below a threshold, by the threshold [%] [-]; tip_amplitude_m: half peak-to-peak of both
        tips, shape (m, n, 2); tip_contacts_per_period: shape (m, n); one_contact_share: share of
        the points with one tip contact per period [-]; amplitude_spread: standard deviation over
        mean of the amplitudes, shape (2,) [-]; amplitude_by_first, amplitude_by_second: share of
        the amplitudes' variance that the first and the second parameter explain, shape (2,) [-];
        axes: names of both parameters; law: name of the law.
    """
    axes = [key.partition(".")[2] for key, *_ in PLANE_AXES[law]]
    data = data.transpose(*axes, "lamina", "strobe", ...)
    strobes = data["strobe_displacement"].to_numpy()
    amplitude = data["tip_amplitude"].to_numpy()
    kind = settling.kinds_of_motion(
        data["outcome"].to_numpy(),
        data["periodicity"].to_numpy(),
        strobes,
        data["is_decided"].to_numpy() != 0.0,
        data["settled"].to_numpy() != 0.0 if "settled" in data else None,
    )
    contacts = data["tip_contacts_per_period"].to_numpy()
    n = max(kind.size, 1)
    scatter = one_period_scatter(strobes, amplitude)
    completed = amplitude[np.isfinite(amplitude).all(axis=-1)]
    return Numbers(
        {name: data[name].to_numpy() for name in axes}
        | {
            "kind": kind,
            "kinds": dict(enumerate(KINDS)),
            "share": {name: float((kind == k).sum() / n) for k, name in enumerate(KINDS)},
            "scatter": scatter,
            "one_periodic_by_threshold": {
                percent: float((100.0 * scatter < percent).sum() / n) for percent in THRESHOLDS
            },
            "tip_amplitude_m": amplitude,
            "tip_contacts_per_period": contacts,
            "one_contact_share": float(
                ((contacts >= ONE_CONTACT[0]) & (contacts <= ONE_CONTACT[1])).sum() / n
            ),
            "amplitude_spread": completed.std(axis=0) / completed.mean(axis=0),
            "amplitude_by_first": main_effect(amplitude, 0),
            "amplitude_by_second": main_effect(amplitude, 1),
        },
        axes=axes,
        law=law,
    )


def one_periodic_within(plane: Numbers) -> tuple[float, float]:
    """Return the share of one-periodic points without and with the undecided ones [-]."""
    share: float = plane.share["one-periodic"]
    return share, share + plane.share.get("undecided", 0.0)


def best_decade(damping: FloatArray, kind: IntArray, amplitude: FloatArray) -> Numbers:
    """Return the decade of the penalty law's damping with the most one-periodic points.

    If several decades have the same share, return the one with the smallest damping.

    Args:
        damping: values of c, increasing, shape (m,) [N s/m].
        kind: kind of motion at each point, 0 is one-periodic, shape (m, n).
        amplitude: half peak-to-peak of both tips at each point, shape (m, n, 2) [m].

    Returns:
        from: smallest damping c of the decade [N s/m]; one_periodic: share of one-periodic points
        in it [-]; one_periodic_within: the same without and with the undecided points [-];
        amplitude_spread: standard deviation over mean of the amplitudes, shape (2,) [-].
    """
    decades = []
    for low in damping[damping <= damping[-1] / 10.0 * (1.0 + 1e-9)]:
        inside = (damping >= low) & (damping <= 10.0 * low * (1.0 + 1e-9))
        chosen = amplitude[inside].reshape(-1, 2)
        share = float((kind[inside] == settling.PERIOD_1).mean())
        unsure = float((kind[inside] == settling.UNDECIDED).mean())
        decades.append(
            {
                "from": float(low),
                "one_periodic": share,
                "one_periodic_within": (share, share + unsure),
                "amplitude_spread": np.nanstd(chosen, axis=0) / np.nanmean(chosen, axis=0),
            }
        )
    return Numbers(max(decades, key=lambda decade: decade["one_periodic"]))


def main_effect(values: FloatArray, axis: int) -> FloatArray:
    """Return the share of a plane's variance that the means along one axis explain, (2,) [-]."""
    means = np.nanmean(values, axis=1 - axis)
    total = np.nanvar(values, axis=(0, 1))
    explained = np.nanvar(means, axis=0)
    return np.asarray(np.divide(explained, total, out=np.zeros_like(total), where=total > 0))


def measure_planes(lab: Laboratory) -> Numbers:
    """Compute the planes of motions of both laws, method 3.2 and the penalty law.

    Returns:
        impact: plane of method 3.2, newton-penalty; classical: plane of the classical penalty law;
        best_decade: best decade of the penalty law's damping; points: number of points per axis;
        periods: number of periods of each point.
    """
    impact, penalty = (plane_of(_sweep(lab, law), law) for law in PLANE_AXES)
    best = best_decade(penalty.penalty_damping, penalty.kind, penalty.tip_amplitude_m)
    return Numbers(
        {"newton-penalty": impact.kept, "penalty": {**penalty.kept, "best_decade": best.kept}},
        impact=impact,
        classical=penalty,
        best_decade=best,
        points=lab.plan.plane_points,
        periods=lab.plan.plane_periods,
    )


def _sweep(lab: Laboratory, law: str) -> xr.Dataset:
    """Compute the parameter plane of a law."""
    n, periods = lab.plan.plane_points, lab.plan.plane_periods
    axes = [
        {"key": key, "start": start, "stop": stop, "count": n, "spacing": spacing}
        for key, (start, stop), spacing, _ in PLANE_AXES[law]
    ]
    return lab.sweep(
        {
            "name": f"plane {law}",
            "set": {"contact": {"law": law}, "time": {"periods": periods}},
            "axis": axes,
            "record": {"strobes": min(SWEPT_STROBES, periods)},
        }
    )


def draw_planes(numbers: Numbers) -> Figure:
    """Draw kinds of motion and scatter of both laws over their parameters."""
    from matplotlib.colors import ListedColormap, LogNorm
    from matplotlib.patches import Patch

    both = (numbers.impact, numbers.classical)
    titles = ("method 3.2", "classical penalty law")
    figure = style.canvas(12.0)
    grid = figure.add_gridspec(3, 2, height_ratios=[4.3, 4.3, 2.8])
    panels = grid[:2, :].subgridspec(2, 2).subplots(squeeze=False)
    _shares(figure.add_subplot(grid[2, :]), both, titles)
    top = max(float(np.nanmax(plane.scatter)) for plane in both)
    norm = LogNorm(1e-3, max(top, 2e-3), clip=True)
    for (left, right), plane, title in zip(panels, both, titles, strict=True):
        _map(left, plane, plane.kind, cmap=ListedColormap(list(style.KIND_COLOURS)),
             vmin=-0.5, vmax=len(style.KIND_COLOURS) - 0.5)  # fmt: skip
        left.set_title(f"{title}: {100 * plane.share['one-periodic']:.0f} % one-periodic")
        mesh = _map(right, plane, plane.scatter, cmap="cividis", norm=norm)
        bar = figure.colorbar(mesh, ax=right, label="scatter one period apart [–]")
        bar.ax.axhline(diagnostics.PERIODIC_SCATTER, color=style.VERMILLION, linewidth=2.0)
    present = sorted({int(k) for plane in both for k in np.unique(plane.kind)})
    patches = [
        Patch(facecolor=style.KIND_COLOURS[k], edgecolor=style.BLACK, label=KINDS[k])
        for k in present
    ]
    figure.legend(handles=patches, loc="outside upper left", ncols=6, frameon=False)
    return figure


def _shares(panel: Axes, planes: tuple[Numbers, ...], titles: tuple[str, ...]) -> None:
    """Draw how the share of one-periodic points depends on the threshold of the scatter."""
    at = 100.0 * diagnostics.PERIODIC_SCATTER
    margin = diagnostics.PERIODIC_MARGIN
    shares = [plane.one_periodic_by_threshold for plane in planes]
    lines = [
        line(
            [*share],
            [100.0 * value for value in share.values()],
            line_style,
            color=style.BLACK,
            label=title,
        )
        for share, title, line_style in zip(shares, titles, ("o-", "s--"), strict=True)
    ]
    show(
        panel, *lines, xscale="log", xlabel="threshold of the scatter one period apart [%]",
        ylabel="points below it [%]", ylim=(0.0, 105.0),
    )  # fmt: skip
    panel.axvline(at, color=style.VERMILLION, linewidth=2.0)
    undecided = style.KIND_COLOURS[settling.UNDECIDED]
    panel.axvspan(at / margin, at * margin, label="undecided", color=undecided, zorder=0)
    panel.set_xticks(SHOWN_THRESHOLDS, [f"{t:g}" for t in SHOWN_THRESHOLDS])
    panel.minorticks_off()
    style.legend_above(panel)


def _map(panel: Axes, plane: Numbers, values: FloatArray | IntArray, **look: Any) -> QuadMesh:
    """Draw values over a plane, label its axes and mark the paper's parameters."""
    panel.grid(False)
    first, second = (plane.kept[name] for name in plane.axes)
    (*_, spacing, first_label), (*_, second_label) = PLANE_AXES[plane.law]
    columns = style.edges(first, is_logarithmic=spacing == "logarithmic")
    mesh = panel.pcolormesh(columns, style.edges(second, is_logarithmic=True), values.T, **look)
    panel.set(xlabel=first_label, ylabel=second_label, yscale="log")
    if spacing == "logarithmic":
        panel.set_xscale("log")
    if plane.law == "newton-penalty":
        panel.plot([0.1], [100.0], "o", markersize=10, markerfacecolor="none",
                   markeredgecolor=style.VERMILLION, markeredgewidth=2.0)  # fmt: skip
    return mesh


def _spread(plane: Numbers) -> str:
    """Return in words by how much the amplitudes vary over a plane."""
    return "{:.0f} / {:.0f} %".format(*100 * plane.amplitude_spread)


def _sensitive(numbers: Numbers) -> Iterable[Criterion]:
    """Return the criteria that compare the penalty law in its best decade with method 3.2."""
    best = numbers.best_decade
    share, with_undecided = (
        fraction or math.nan for fraction in one_periodic_within(numbers.impact)
    )
    yield Criterion(
        "one-periodic in the best decade over method 3.2", best.one_periodic / share, "<", 1.0, "",
        (best.one_periodic / with_undecided, best.one_periodic_within[1] / share),
    )  # fmt: skip
    ratio = float(np.min(best.amplitude_spread / numbers.impact.amplitude_spread))
    yield Criterion("smaller ratio of the amplitudes' variation", ratio, ">", 1.0)


PLANES = Piece(
    "15",
    "Parameter planes",
    "{0.points} × {0.points} points, {0.periods} periods each, "
    f"T/1000, 3.25 Hz. Period P: strobes P ≤ {diagnostics.LARGEST_PERIODICITY} periods apart "
    f"differ by less than {100 * diagnostics.PERIODIC_SCATTER:g} % of the half peak-to-peak "
    "amplitude (rms of the worse tip over the last 40 periods); quasi-periodic: "
    f"{100 * settling.LINE_SHARE:g} % of the power of the last {SWEPT_STROBES} strobes in "
    f"{settling.LINES} spectral lines; irregular: neither; undecided: the class changes "
    f"with the threshold times or over {diagnostics.PERIODIC_MARGIN:g}. Right: that scatter "
    "for P = 1 (line: the threshold). Below: the share of points with a scatter below a "
    "threshold. Ring: the paper's parameters. The axes of the paper's plane are not known; "
    "compared is what its text "
    "says of it.",
    measure_planes,
    draw_planes,
    (
        Statement(
            "remarkable robustness in the choice of e and k_con", "sec. 3.2, 4",
            lambda n: "e = 0 … 0.5, k_con = 10 … 1000 N/m: "
            + ", ".join(f"{100 * v:.0f} % {kind}" for kind, v in n.impact.share.items() if v > 0.0)
            + f"; half peak-to-peak amplitudes vary by {_spread(n.impact)} (standard deviation, "
            "thick / thin); the share with a scatter below a threshold is "
            + ", ".join(f"{100 * n.impact.one_periodic_by_threshold[t]:.0f} % at {t:g} %"
                        for t in TOLD_THRESHOLDS),
            lambda n: [
                Criterion(
                    "one-periodic", n.impact.share["one-periodic"], ">", CORRECT_SHARE, "%",
                    one_periodic_within(n.impact),
                )
            ],
        ),
        Statement(
            "apart from a few exceptions one contact event in one period", "sec. 3.2",
            lambda n: f"one tip contact per period at {100 * n.impact.one_contact_share:.0f} % of "
            "the points",
            lambda n: [Criterion("share", n.impact.one_contact_share, ">", 1.0 - FEW, "%")],
        ),
        Statement(
            "e mainly affects the solution, k_con hardly", "sec. 3.2",
            lambda n: "share of the variance of the amplitudes (thick / thin): "
            "e {:.0f} / {:.0f} %, k_con {:.0f} / {:.0f} %".format(
                *100 * n.impact.amplitude_by_first, *100 * n.impact.amplitude_by_second
            ),
            lambda n: [
                Criterion(
                    "smaller e over k_con",
                    float(np.min(n.impact.amplitude_by_first / n.impact.amplitude_by_second)),
                    ">", 1.0,
                )
            ],
        ),
        Statement(
            "the classical penalty law is far more sensitive", "sec. 3.2, 4",
            lambda n: "k = 100 … 10000 N/m, c = 0.01 … 10 N s/m: "
            f"{100 * n.classical.share['one-periodic']:.0f} % one-periodic, one tip contact per "
            f"period at {100 * n.classical.one_contact_share:.0f} %, amplitudes vary by "
            f"{_spread(n.classical)} (method 3.2: {100 * n.impact.share['one-periodic']:.0f} %, "
            f"{100 * n.impact.one_contact_share:.0f} %, {_spread(n.impact)}); in its best decade "
            f"of c, from {n.best_decade.kept['from']:.2g} N s/m on, "
            f"{100 * n.best_decade.one_periodic:.0f} % and {_spread(n.best_decade)}",
            _sensitive,
        ),
    ),
)  # fmt: skip

# -- γ and the time integration ---------------------------------------------------------------

CLAPPING = FREQUENCIES[1:]
"""The excitation frequencies at which the tips meet [Hz]."""
GAMMAS = (1e-5, 1e-1)
PRINTED = 0.5e-3
"""γ of the paper [m/s]."""
SLIGHT = 0.05
"""A change of the amplitude by less than this share of its mean counts as slight."""
MODERATE = 0.011
"""Upper end of moderate thresholds, about twenty times the printed one [m/s]."""
ORDER = 3.0
"""A number counts as "close to" another one if their ratio is below this factor."""


def measure_threshold(lab: Laboratory) -> Numbers:
    """Compute the motions with tip contact over γ, and the limit of the central difference.

    Returns:
        gamma_m_s: values of γ, shape (n,). By frequency, each a list over γ: staying_share: share
        of the impacts that are followed by permanent contact [-]; amplitude_mm: half peak-to-peak
        of both tips, each of shape (2,); periodicity: class of the motion in words; contacts: tip
        contacts per period; impacts_per_period: impacts per period on all pairs.
        largest_tip_gap_rate_m_s: largest gap rate of the tips at 3.25 Hz with the paper's γ;
        central_difference_steps_per_period: smallest number of steps per period at which the
        central difference is stable.
    """
    gammas = np.geomspace(*GAMMAS, lab.plan.thresholds)
    keys = [{"contact.threshold_velocity": float(g)} for g in gammas]
    runs = {
        f"{f:g}": lab.motions([motion_case(f, lab.plan, "3.2", key) for key in keys])
        for f in CLAPPING
    }
    (printed,) = lab.motions([motion_case(RESONANT, lab.plan)])
    rate = printed.history["tip_velocity"].to_numpy()
    case = printed.case
    limit = largest_stable_time_step(assemble(case, needs_dolfinx=False).operators, 100.0)

    def over_gamma(name: str) -> dict[str, list[Any]]:
        return {f: [r.summary[name] for r in results] for f, results in runs.items()}

    return Numbers(
        {
            "gamma_m_s": gammas,
            "staying_share": {
                f: [staying_share(r, g) for r, g in zip(results, gammas, strict=True)]
                for f, results in runs.items()
            },
            "amplitude_mm": {
                f: [1e3 * np.array(r.summary["tip_amplitude"]) for r in rs]
                for f, rs in runs.items()
            },
            "periodicity": over_gamma("periodicity_class"),
            "contacts": over_gamma("tip_contacts_per_period"),
            "largest_tip_gap_rate_m_s": float(np.abs(rate[1] - rate[0]).max()),
            "central_difference_steps_per_period": float(case.period / limit),
        },
        impacts_per_period=over_gamma("impacts_per_period"),
    )


def staying_share(result: Result, gamma: float) -> float:
    """Return the share of the impacts after which the gap rate e |U̇⁻| is below γ [-]."""
    before = -result.history["event_velocity_before"].to_numpy()
    if not before.size:
        return 0.0
    return float((result.case.contact.restitution * before < gamma).mean())


def draw_threshold(numbers: Numbers) -> Figure:
    """Draw permanent contacts, amplitudes and impacts of the motions over γ."""
    gammas = numbers.gamma_m_s
    figure = style.canvas(7.6)
    panels = figure.subplots(3, 1, sharex=True)
    for f, colour, marker in zip(
        CLAPPING, (style.BLUE, style.VERMILLION, style.GREEN), "osv", strict=True
    ):
        key = f"{f:g}"
        line_style = {"color": colour, "marker": marker, "markersize": 4, "label": f"{f:.2f} Hz"}
        thick, thin = np.transpose(numbers.amplitude_mm[key])
        panels[0].semilogx(gammas, 100.0 * np.array(numbers.staying_share[key]), **line_style)
        panels[1].semilogx(gammas, thick, **line_style)
        panels[1].semilogx(gammas, thin, **{**line_style, "linestyle": "--", "label": None})
        panels[2].semilogx(gammas, numbers.impacts_per_period[key], **line_style)
    panels[0].set_ylabel("impacts followed by\npermanent contact [%]")
    panels[1].set_ylabel("half peak-to-peak [mm]\nthick –, thin - -")
    style.label_x(panels, "threshold γ [m/s]")
    panels[2].set(ylabel="impacts per period", yscale="log")
    for panel in panels:
        panel.axvline(PRINTED, color=style.BASE_COLOUR, linestyle=":")
    style.legend_above(panels[0])
    return figure


def _spreads(numbers: Numbers, largest: float = math.inf) -> dict[str, float]:
    """Return the range of amplitudes over γ, up to a largest γ, relative to their mean.

    Returns:
        The larger one of both tips, by frequency [-].
    """
    amplitudes = {
        f: np.array(a)[numbers.gamma_m_s <= largest] for f, a in numbers.amplitude_mm.items()
    }
    return {f: float(np.max(np.ptp(a, axis=0) / a.mean(axis=0))) for f, a in amplitudes.items()}


THRESHOLD = Piece(
    "gamma",
    "The threshold γ",
    "Method 3.2 with other thresholds γ, all else as printed (dotted: the paper's γ). The "
    "paper tells of such computations without showing them.",
    measure_threshold,
    draw_threshold,
    (
        Statement(
            "larger γ: most contacts are followed by permanent contact", "sec. 3.2",
            lambda n: "share of impacts followed by it, γ = 1e-5 → 0.1 m/s: "
            + ", ".join(
                f"{100 * share[0]:.0f} → {100 * share[-1]:.0f} % at {f} Hz"
                for f, share in n.staying_share.items()
            ),
            lambda n: [
                Criterion(
                    "smallest share", min(share[-1] for share in n.staying_share.values()),
                    ">", 0.5, "%",
                )
            ],
        ),
        Statement(
            "such a choice mostly induces slight differences", "sec. 3.2",
            lambda n: "half peak-to-peak amplitudes vary by up to "
            + ", ".join(f"{100 * v:.0f} % at {f} Hz" for f, v in _spreads(n).items())
            + " over four decades of γ, by up to "
            f"{100 * max(_spreads(n, MODERATE).values()):.0f} % below {MODERATE:g} m/s; "
            + ", ".join(
                f"{' or '.join(sorted({str(kind) for kind in kinds}))} at {f} Hz"
                for f, kinds in n.periodicity.items()
            ),
            lambda n: [
                Criterion("second smallest", sorted(_spreads(n).values())[1], "<", SLIGHT, "%")
            ],
        ),
        Statement(
            "γ is close to the thousandth part of the maximum relative velocity", "sec. 3.2",
            lambda n: f"largest gap rate of the tips at 3.25 Hz: {n.largest_tip_gap_rate_m_s:.2f} "
            f"m/s; γ is 1/{n.largest_tip_gap_rate_m_s / PRINTED:.0f} of it",
            lambda n: between(
                "rate/γ over 1000", n.largest_tip_gap_rate_m_s / PRINTED / 1000.0,
                (1.0 / ORDER, ORDER),
            ),
        ),
        Statement(
            "the central difference scheme may also be appropriate", "sec. 3.1",
            lambda n: "with the consistent mass it is stable from "
            f"{np.ceil(n.central_difference_steps_per_period):.0f} steps per period on, not with "
            "the paper's 1000",
            lambda n: [
                Criterion(
                    "steps per period", n.central_difference_steps_per_period, "<", 1001.0
                )
            ],
        ),
    ),
)  # fmt: skip
