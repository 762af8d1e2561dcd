"""Phase portraits and spectra of the paper (Figs. 5, 9, 12 and 14)."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from delam_fem.api import FloatArray, diagnostics, harmonics, style
from delam_fem.paper.claims import (
    CLEARLY,
    SMOOTH_HARMONICS,
    Criterion,
    Numbers,
    Piece,
    Statement,
    describe,
    ends,
    has_period,
    motion_numbers,
    rough_part,
    roughness,
    settling,
)
from delam_fem.paper.panels import four_by_two, line, portrait, show, two_portraits
from delam_fem.paper.runs import FREQUENCIES, RESONANT, Laboratory, both_methods, motion_case

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from delam_fem.api import Result


# -- Fig. 9: method 3.1 -----------------------------------------------------------------------

SCATTERS = 3.0
"""A distance from the stationary cycle counts as near up to this number of its scatters (rms)."""
NARROW, WIDE = 2.5, 4.0
"""Other numbers of scatters, which show how much the length of a transient depends on it."""
LONG = 100
"""A transient of at least this number of periods counts as "some hundred"."""


def measure_impact_portraits(lab: Laboratory) -> Numbers:
    """Compute the four motions by method 3.1.

    Returns:
        The numbers of the motion at 3.25 Hz; motion: the same; settled_by_scatters: number of
        periods after which each of the four motions is stationary, by the distance that counts as
        near; result: the motion at 3.25 Hz.
    """
    results = lab.motions([motion_case(f, lab.plan, "3.1") for f in FREQUENCIES])
    result = results[FREQUENCIES.index(RESONANT)]
    motion = motion_numbers(result)
    settled = {s: [_settling(r, s) for r in results] for s in (NARROW, SCATTERS, WIDE)}
    return Numbers(motion.kept, motion=motion, settled_by_scatters=settled, result=result)


def _settling(result: Result, scatters: float) -> int:
    """Return the number of periods after which a motion stays near its stationary cycle."""
    strobe = result.history["strobe_displacement"].to_numpy()
    half = 0.5 * np.ptp(result.history["tip_displacement"].to_numpy(), axis=1)
    scatter = result.summary["strobe_scatter"] or diagnostics.PERIODIC_SCATTER
    return settling(strobe, half, result.summary["periodicity"] or 1, scatters * scatter)


IMPACT_PORTRAITS = Piece(
    "9",
    "Phase portraits by method 3.1",
    f"Method 3.1 at {RESONANT} Hz, {style.PORTRAIT_PERIODS} periods. The paper's experiment beside "
    "it is not available.",
    measure_impact_portraits,
    lambda n: two_portraits([n.result], ["method 3.1"])[0],
    (
        Statement(
            "Δt = T/1000 gives orbitally stable results", "sec. 3.1",
            lambda n: f"method 3.1, {n.motion.kind}; successive cycles differ by "
            f"{100 * float(n.motion.strobe_scatter or np.nan):.1f} % of the "
            "half peak-to-peak amplitude (rms at the ends of periods)",
            lambda n: has_period(n.motion, 1),
        ),
        Statement(
            "some hundred periods are necessary to get a stationary state", "sec. 3.1",
            lambda n: f"from rest, strobes stay within {SCATTERS:g} times the scatter of the "
            "stationary cycles after "
            + ", ".join(
                f"{periods} at {f:.2f} Hz"
                for periods, f in zip(n.settled_by_scatters[SCATTERS], FREQUENCIES, strict=True)
            )
            + " (periods)",
            lambda n: [
                Criterion(
                    "longest", max(n.settled_by_scatters[SCATTERS]), ">", LONG - 1.0, "periods",
                    (max(n.settled_by_scatters[WIDE]), max(n.settled_by_scatters[NARROW])),
                )
            ],
        ),
    ),
)  # fmt: skip

# -- Fig. 12: both methods --------------------------------------------------------------------


def measure_portraits(lab: Laboratory) -> Numbers:
    """Compute the four motions by both methods.

    Returns:
        motions: numbers of each motion, roughness_free: roughness of both tips in free flight [-],
        and results: the results themselves, all by frequency [Hz] and method.
    """
    results = both_methods(lab)
    motions = {key: motion_numbers(result) for key, result in results.items()}
    rough = {key: roughness(result, free=True) for key, result in results.items()}
    return Numbers(
        {
            f"{f:g} Hz, {m}": {**motion.kept, "roughness_free": rough[f, m]}
            for (f, m), motion in motions.items()
        },
        motions=motions,
        roughness_free=rough,
        results=results,
    )


def draw_portraits(numbers: Numbers) -> Figure:
    """Draw the phase portraits of both tips over ten periods at the four frequencies."""
    figure, panels = four_by_two(
        12.0, numbers.results, _draw_both_tips,
        "position of the tip [mm]", "velocity of the tip [m/s]", sharex="row", sharey="row",
    )  # fmt: skip
    style.legend_outside(figure, panels[0, 0], 3)
    return figure


def _draw_both_tips(panel: Axes, result: Result) -> None:
    """Draw the portraits of both tips into one panel, over the tips' positions."""
    N = result.case.time.steps_per_period
    gap = 1e3 * float(diagnostics.ProbeMotion.of(result.history).gap_at_rest[0])
    for i, (q, v) in enumerate(portrait(result)):
        y = 1e3 * q + i * gap
        name = result.case.lamina[i].name
        show(
            panel,
            line(y, v, color=style.LAMINA_COLOURS[i], linewidth=0.6, label=name),
            line(y[N - 1 :: N], v[N - 1 :: N], "o", color=style.BLACK, markersize=3, zorder=4,
                 label=None if i else "ends of periods"),
        )  # fmt: skip


def _as_described(numbers: Numbers, method: str) -> int:
    """Return how many of the four motions of a method are as the paper describes them."""
    return sum(numbers.motions[f, method].is_as_described for f in FREQUENCIES)


def _scatters(numbers: Numbers) -> list[tuple[float, float]]:
    """Return the frequencies [Hz] and the scatters of the motions by method 3.2; NaN: none [-]."""
    scatters = [(f, numbers.motions[f, "3.2"].strobe_scatter) for f in FREQUENCIES]
    return [(f, math.nan if scatter is None else scatter) for f, scatter in scatters]


def _smoother(numbers: Numbers) -> FloatArray:
    """Return roughness by 3.2 over that by 3.1, of the motions with tip contact, (3, 2) [-]."""
    rough = numbers.roughness_free
    return np.array([np.divide(rough[f, "3.2"], rough[f, "3.1"]) for f in FREQUENCIES[1:]])


PORTRAITS = Piece(
    "12",
    "Phase portraits",
    f"Phase portraits of both tips over {style.PORTRAIT_PERIODS} periods by methods 3.1 (impact "
    "law) and 3.2 (impact law and penalty stiffness), dots: ends of periods. The paper's portraits "
    "are not available; compared is what its text says of them.",
    measure_portraits,
    draw_portraits,
    (
        Statement(
            "all four motions with one set of parameters", "sec. 3.2, 4",
            lambda n: f"{_as_described(n, '3.2')} of 4 motions are as described by method 3.2 "
            f"({_as_described(n, '3.1')} of 4 by 3.1), e = 0.1, k_con = 100 N/m, γ = 0.5 mm/s "
            "throughout",
            lambda n: [Criterion("motions as described", _as_described(n, "3.2"), ">", 3.0)],
        ),
        Statement(
            "in all cases an orbitally stable solution", "sec. 3.2",
            lambda n: "cycles differ by "
            + ", ".join("–" if math.isnan(s) else f"{100 * s:.2g} %" for _, s in _scatters(n))
            + " of the half peak-to-peak amplitude at 1.25, 1.60, 3.25, 3.65 Hz",
            lambda n: [
                Criterion(
                    f"{f:.2f} Hz", s, "<", diagnostics.PERIODIC_SCATTER, "%",
                    (s / diagnostics.PERIODIC_MARGIN, s * diagnostics.PERIODIC_MARGIN),
                )
                for f, s in _scatters(n)
            ],
        ),
        Statement(
            "3.2 is distinctly smoother than 3.1 in free vibration", "sec. 3.2",
            lambda n: f"velocity above harmonic {SMOOTH_HARMONICS} while the tips are more than "
            "1 mm apart, 3.2 over 3.1 (thick / thin): "
            + ", ".join(
                f"{a:.2f} / {b:.2f} at {f:.2f} Hz"
                for f, (a, b) in zip(FREQUENCIES[1:], _smoother(n), strict=True)
            ),
            lambda n: [Criterion("largest ratio", float(np.max(_smoother(n))), "<", CLEARLY)],
        ),
    ),
)  # fmt: skip

# -- Fig. 14: a finer mesh --------------------------------------------------------------------

ELEMENTS = (20, 50)
LONG_WINDOW = {"output.window_periods": 40, "output.fields_per_period": 0}
"""A long window, to measure the roughness of motions whose cycles scatter."""
VARIANTS: dict[str, dict[str, object]] = {
    "as printed": {},
    "consistent impulses": {"contact.impulse": "consistent"},
    "lumped mass": {"time.mass": "lumped"},
    "consistent impulses and stiffness damping": {
        "contact.impulse": "consistent",
        "damping.rayleigh": "stiffness",
    },
}
"""Schemes that are tried on the finer mesh; "as printed" can add energy at impacts."""
OVER_GAPS = ("as printed", "consistent impulses")
"""Schemes that are tried with every shape of the gap; "consistent impulses" cannot add energy."""
SUBSTANTIAL = 1.25
"""An increase of the time by this factor or more counts as substantial."""


def measure_finer_mesh(lab: Laboratory) -> Numbers:
    """Compute the motion on both meshes of `ELEMENTS`, with several schemes and shapes of the gap.

    Returns:
        roughness_free: roughness of both tips in free flight, on both meshes [-]; roughness: rms
        of the rough part of both tip velocities, on both meshes [m/s]; ratio: rough velocity on the
        fine mesh over the coarse one, by scheme, shape (2,) [-]; ratio_by_gap_exponent: the same,
        by scheme and by the exponent of the gap's shape; kind_by_gap_exponent: motion on the fine
        mesh in words, by scheme and by exponent; energy_gain_of_impacts_J: on both meshes with "as
        printed", by exponent; cost: median of the time per step on the fine mesh over that on the
        coarse one [-]; cost_within: its quartiles; pairs: number of compared pairs of runs;
        the numbers of the motions with "as printed", by number of elements; fine: that of the fine
        mesh; results: of both meshes with "as printed".
    """
    exponents = lab.plan.gap_exponents
    pairs = _pairs(lab)
    both = pairs["as printed", 2.0]
    ratio = {key: rough_velocity(b) / rough_velocity(a) for key, (a, b) in pairs.items()}
    costs = [
        b.summary["microseconds_per_step"] / a.summary["microseconds_per_step"]
        for a, b in pairs.values()
    ]
    motions = {f"{n}": motion_numbers(r) for n, r in zip(ELEMENTS, both, strict=True)}
    return Numbers(
        {
            "roughness_free": [roughness(r, free=True) for r in both],
            "roughness": [rough_velocity(r) for r in both],
            "ratio": {name: ratio[name, 2.0] for name in VARIANTS},
            "ratio_by_gap_exponent": {
                name: {f"{p:g}": ratio[name, p] for p in exponents} for name in OVER_GAPS
            },
            "kind_by_gap_exponent": {
                name: {f"{p:g}": describe(pairs[name, p][1]) for p in exponents}
                for name in OVER_GAPS
            },
            "energy_gain_of_impacts_J": {
                f"{p:g}": [r.summary["impact_energy_gain"] for r in pairs["as printed", p]]
                for p in exponents
            },
            "cost": float(np.median(costs)),
            "cost_within": (float(np.quantile(costs, 0.25)), float(np.quantile(costs, 0.75))),
            "pairs": len(costs),
            **{n: motion.kept for n, motion in motions.items()},
        },
        fine=motions[f"{ELEMENTS[1]}"],
        results=both,
    )


def _pairs(lab: Laboratory) -> dict[tuple[str, float], tuple[Result, Result]]:
    """Compute pairs of runs (coarse, fine), by scheme and by the exponent of the gap's shape."""
    variants = {(name, 2.0): keys for name, keys in VARIANTS.items()} | {
        (name, p): VARIANTS[name] | {"gap.exponent": p}
        for name in OVER_GAPS
        for p in lab.plan.gap_exponents
    }
    cases = [
        motion_case(RESONANT, lab.plan, "3.2", keys | LONG_WINDOW | {"mesh.elements": n})
        for keys in variants.values()
        for n in ELEMENTS
    ]
    results = lab.motions(cases)
    return dict(zip(variants, zip(results[::2], results[1::2], strict=True), strict=True))


def rough_velocity(result: Result) -> FloatArray:
    """Return the rms of the rough part of both tip velocities, shape (2,) [m/s]."""
    velocity = diagnostics.last_periods(result.history, result.case)["tip_velocity"].to_numpy()
    rough = rough_part(velocity, velocity.shape[1] // result.case.time.steps_per_period)
    return np.asarray(np.sqrt((rough**2).mean(axis=1)))


def draw_finer_mesh(numbers: Numbers) -> Figure:
    """Draw the phase portraits with 20 and 50 elements, and the roughness over the gap's shape."""
    from matplotlib.ticker import ScalarFormatter

    figure, below = two_portraits(numbers.results, [f"{n} elements" for n in ELEMENTS], 1)
    ratios = numbers.ratio_by_gap_exponent
    for i, panel in enumerate(below):
        show(
            panel,
            *(
                line([float(p) for p in by_gap], [r[i] for r in by_gap.values()], line_style,
                     color=style.LAMINA_COLOURS[i], label=name)
                for (name, by_gap), line_style in zip(ratios.items(), ("o-", "s--"), strict=True)
            ),
            yscale="log", ylim=(0.5, 100.0), xticks=[float(p) for p in ratios["as printed"]],
            xlabel="exponent p of the gap  [–]", ylabel="rough velocity, 50 over 20  [–]",
            legend="above",
        )  # fmt: skip
        panel.axhline(1.0, color=style.BLACK, linewidth=0.8)
        panel.yaxis.set_major_formatter(ScalarFormatter())
    return figure


def _band(by_gap: Mapping[str, FloatArray]) -> str:
    """Return the smallest and the largest ratio of both tips in words."""
    values = np.array(list(by_gap.values()))
    (a, b), (c, d) = values.min(axis=0), values.max(axis=0)
    return f"{a:.2f} … {c:.2f} / {b:.2f} … {d:.2f}"


def _finer(ratio: Mapping[str, FloatArray]) -> Iterable[Criterion]:
    """Return the criteria on the ratio of velocities as printed; other schemes show its range."""
    table = np.array(list(ratio.values()))
    for i, name in enumerate(("thick", "thin")):
        within = (float(table[:, i].min()), float(table[:, i].max()))
        yield Criterion(name, float(ratio["as printed"][i]), "<", CLEARLY, "", within)


FINER_MESH = Piece(
    "14",
    "A finer mesh",
    f"Method 3.2 at {RESONANT} Hz, {style.PORTRAIT_PERIODS} periods; all other parameters "
    "identical. "
    f"Below: velocity above harmonic {SMOOTH_HARMONICS} with {ELEMENTS[1]} elements over that "
    f"with {ELEMENTS[0]}, for gaps 12 mm (x/L)^p. The paper's portrait is not available; "
    "compared is the sentence on high frequencies.",
    measure_finer_mesh,
    draw_finer_mesh,
    (
        Statement(
            "50 elements: considerably less high-frequency velocity", "sec. 3.2",
            lambda n: f"velocity above harmonic {SMOOTH_HARMONICS} over 40 periods, 50 over 20 "
            "elements: {:.2f} (thick), {:.2f} (thin) with p = 2, ".format(*n.ratio["as printed"])
            + ", ".join("with {} {:.2f} / {:.2f}".format(name, *n.ratio[name])
                        for name in list(VARIANTS)[1:])
            + f"; over gaps (x/L)^p, p = {ends(n.energy_gain_of_impacts_J)}: "
            f"{_band(n.ratio_by_gap_exponent['as printed'])}, with consistent impulses "
            f"{_band(n.ratio_by_gap_exponent['consistent impulses'])}; "
            f"the motion on 50: {n.fine.kind}",
            lambda n: _finer(n.ratio),
        ),
        Statement(
            "a substantial increase in calculation time has to be accepted", "sec. 3.2",
            lambda n: f"2.5 times the unknowns cost {n.cost:.1f} times the time per step with "
            f"banded matrices in compiled code (median of {n.pairs} pairs of runs)",
            lambda n: [Criterion("median", n.cost, ">", SUBSTANTIAL, "", n.cost_within)],
        ),
    ),
)  # fmt: skip


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
        exponent [m]; names: names of the laminae; x: positions of the nodes, shape (n_nodes,) [mm].
    """
    exponents = lab.plan.gap_exponents
    cases = [motion_case(RESONANT, lab.plan, "3.2", {"gap.exponent": p}) for p in exponents]
    results = dict(zip([f"{p:g}" for p in exponents], lab.motions(cases), strict=True))
    result = results[PRESET_EXPONENT]
    u = diagnostics.last_periods(result.history, result.case)["tip_displacement"].to_numpy()
    tips = _harmonics(u, u.shape[1] // result.case.time.steps_per_period, result)
    u = result.history["displacement"].to_numpy().swapaxes(1, 2)
    nodes = _harmonics(u, result.case.n_window_periods, result)
    at_nodes = {order: harmonics.distortion_factor(a) for order, a in nodes.items()}

    def by_gap(name: str) -> dict[str, Any]:
        return {p: r.summary[name] for p, r in results.items()}

    return Numbers(
        {
            "harmonics_m": tips["displacement"][:, :COUNTED],
            "d": {order: harmonics.distortion_factor(a) for order, a in tips.items()},
            "thd": {order: harmonics.total_harmonic_distortion(a) for order, a in tips.items()},
            "d_at_nodes": at_nodes,
            "thd_at_nodes": {order: np.sqrt((1.0 + d) ** 2 - 1.0) for order, d in at_nodes.items()},
            "d_by_gap_exponent": by_gap("distortion_factor"),
            "kind_by_gap_exponent": {p: describe(r) for p, r in results.items()},
            "tip_min_by_gap_exponent": by_gap("tip_min"),
            "tip_max_by_gap_exponent": by_gap("tip_max"),
        },
        names=[lamina.name for lamina in result.case.lamina],
        x=1e3 * result.history["x"].to_numpy(),
    )


def _harmonics(u: FloatArray, n_periods: int, result: Result) -> dict[str, FloatArray]:
    """Return harmonics of displacement, velocity and acceleration: A_n, n ω A_n, (n ω)² A_n.

    Those of the derivatives end at `COUNTED`.

    Args:
        u: displacements over whole periods, shape (..., n_samples) [m].
        n_periods: number of these periods.
        result: the result whose excitation gives ω.
    """
    amplitudes = harmonics.harmonic_amplitudes(u, n_periods)
    rotation = 2.0 * np.pi / result.case.period * np.arange(1, amplitudes.shape[-1] + 1)
    return {
        "displacement": amplitudes,
        "velocity": (amplitudes * rotation)[..., :COUNTED],
        "acceleration": (amplitudes * rotation**2)[..., :COUNTED],
    }


def draw(numbers: Numbers) -> Figure:
    """Draw spectra of the tips, d along the laminae, and d over the shape of the gap."""
    figure = style.canvas(8.6)
    grid = figure.add_gridspec(3, 2)
    for i in range(2):
        _spectrum(figure.add_subplot(grid[i, 0]), numbers, i)
        _along_lamina(figure.add_subplot(grid[i, 1]), numbers, i)
        _over_exponent(figure.add_subplot(grid[2, i]), numbers, i)
    return figure


def _spectrum(panel: Axes, numbers: Numbers, i: int) -> None:
    """Draw the harmonics of a tip as bars."""
    from matplotlib.ticker import LogLocator

    orders = np.arange(1, SHOWN + 1)
    A = 1e3 * numbers.harmonics_m[i]
    panel.bar(orders, A[:SHOWN], width=0.6, color=style.LAMINA_COLOURS[i])
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
    name = numbers.names[i]
    show(
        panel,
        *(
            line(x[1:], 100.0 * numbers.d_at_nodes[order][i, 1:], line_style, marker=".",
                 color=style.LAMINA_COLOURS[i], label=order)
            for order, line_style in zip(ORDERS, ("-", "--", ":"), strict=True)
        ),
        xlabel="x [mm]", xlim=(0.0, 1.02 * x[-1]), ylabel=f"d of {name} [%]", yscale="log",
        legend="above",
    )  # fmt: skip
    # d = sqrt(1 + THD²) - 1, both in percent
    both = (
        lambda d: 100.0 * np.sqrt(np.maximum(0.01 * d, 0.0) * (2.0 + np.maximum(0.01 * d, 0.0))),
        lambda thd: 100.0 * (np.hypot(1.0, 0.01 * thd) - 1.0),
    )
    panel.secondary_yaxis("right", functions=both).set_ylabel("THD [%]")


def _over_exponent(panel: Axes, numbers: Numbers, i: int) -> None:
    """Draw d of a tip over the exponent of the gap's shape."""
    exponents = [float(p) for p in numbers.d_by_gap_exponent]
    d = 100.0 * np.array([both[i] for both in numbers.d_by_gap_exponent.values()])
    printed = 100.0 * PRINTED[i]
    panel.plot(exponents, d, "o-", color=style.LAMINA_COLOURS[i], label="computed")
    panel.axhline(printed, color=style.BASE_COLOUR, linestyle="--", label=f"paper, {printed:.2f} %")
    show(
        panel, xlabel="exponent p of the gap", ylabel=f"$d_{i + 1}$ of the tip [%]",
        ylim=(0.0, 1.15 * max(float(d.max()), printed)), legend="above",
    )  # fmt: skip


def _printed(numbers: Numbers, i: int) -> str:
    """Return in words d of a tip, and whether the printed value is in its range over the gaps."""
    band = [both[i] for both in numbers.d_by_gap_exponent.values()]
    where = "inside" if min(band) <= PRINTED[i] <= max(band) else "outside"
    return (
        f"{100 * numbers.d['displacement'][i]:.2f} % with p = 2; {100 * min(band):.2f} … "
        f"{100 * max(band):.2f} % for gaps (x/L)^p, p = {ends(numbers.d_by_gap_exponent)} (the "
        f"printed value is {where}); THD {100 * numbers.thd['displacement'][i]:.1f} %"
    )


def _away(numbers: Numbers, i: int) -> Criterion:
    """Return the criterion on d of a tip; the unknown shape of the gap makes d uncertain."""
    deviation = abs(numbers.d["displacement"][i] / PRINTED[i] - 1.0)
    away = [both[i] / PRINTED[i] - 1.0 for both in numbers.d_by_gap_exponent.values()]
    nearest = 0.0 if min(away) <= 0.0 <= max(away) else min(map(abs, away))
    return Criterion("away by", deviation, "<", PRINTED_DIGIT, "%", (nearest, max(map(abs, away))))


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
