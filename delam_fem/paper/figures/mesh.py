"""Fig. 14 of the paper: the motion at 3.25 Hz on a finer mesh."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from delam_fem.numerics.arrays import FloatArray
from delam_fem.paper.claims import NOT_IN_JSON, Claim, Criterion, Numbers, Piece, judged
from delam_fem.paper.figures.impact_portraits import Portrait, two_portraits
from delam_fem.paper.lab import RESONANT, Laboratory, motion_case
from delam_fem.paper.measures import (
    CLEARLY,
    SMOOTH_HARMONICS,
    MotionNumbers,
    describe,
    motion_numbers,
    rough_part,
    roughness,
)
from delam_fem.results import diagnostics
from delam_fem.results.figures.style import BLACK, LAMINA_COLOURS, PORTRAIT_PERIODS, legend_above

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from delam_fem.results.folder import Result

    Pair = tuple[Result, Result]

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


@dataclass(frozen=True)
class FinerMesh(Numbers):
    """The motion on both meshes of `ELEMENTS`.

    Attributes:
        roughness_free: roughness of both tips in free flight, on both meshes [-].
        roughness: rms of the rough part of both tip velocities, on both meshes [m/s].
        ratio: rough velocity on the fine mesh over the coarse one, by scheme, shape (2,) [-].
        ratio_by_gap_exponent: ratio as above, by scheme and by the exponent of the gap's shape.
        kind_by_gap_exponent: motion on the fine mesh in words, by scheme and by exponent.
        energy_gain_of_impacts_J: energy gain on both meshes with "as printed", by exponent.
        cost: median of the time per step on the fine mesh over that on the coarse one [-].
        cost_within: its quartiles.
        pairs: number of compared pairs of runs.
        motions: numbers of the motions with "as printed", by number of elements.
        portraits: portraits of the same motions, in the same order.
    """

    roughness_free: list[tuple[float, float]]
    roughness: list[FloatArray]
    ratio: dict[str, FloatArray]
    ratio_by_gap_exponent: dict[str, dict[str, FloatArray]]
    kind_by_gap_exponent: dict[str, dict[str, str]]
    energy_gain_of_impacts_J: dict[str, list[float]]
    cost: float
    cost_within: tuple[float, float]
    pairs: int
    motions: dict[int, MotionNumbers] = field(metadata=NOT_IN_JSON)
    portraits: list[Portrait] = field(metadata=NOT_IN_JSON)

    def to_json(self) -> Mapping[str, Any]:
        """Return the fields, and each motion under its number of elements."""
        motions = {f"{n}": motion.to_json() for n, motion in self.motions.items()}
        return {**super().to_json(), **motions}


def measure(lab: Laboratory) -> FinerMesh:
    """Compute the motion on both meshes, with several schemes and shapes of the gap."""
    exponents = lab.plan.gap_exponents
    pairs = _pairs(lab)
    both = pairs["as printed", 2.0]
    ratio = {key: rough_velocity(b) / rough_velocity(a) for key, (a, b) in pairs.items()}
    costs = [
        b.summary["microseconds_per_step"] / a.summary["microseconds_per_step"]
        for a, b in pairs.values()
    ]
    return FinerMesh(
        roughness_free=[roughness(r, free=True) for r in both],
        roughness=[rough_velocity(r) for r in both],
        ratio={name: ratio[name, 2.0] for name in VARIANTS},
        ratio_by_gap_exponent={
            name: {f"{p:g}": ratio[name, p] for p in exponents} for name in OVER_GAPS
        },
        kind_by_gap_exponent={
            name: {f"{p:g}": describe(pairs[name, p][1]) for p in exponents} for name in OVER_GAPS
        },
        energy_gain_of_impacts_J={
            f"{p:g}": [r.summary["impact_energy_gain"] for r in pairs["as printed", p]]
            for p in exponents
        },
        cost=float(np.median(costs)),
        cost_within=(float(np.quantile(costs, 0.25)), float(np.quantile(costs, 0.75))),
        pairs=len(costs),
        motions={n: motion_numbers(r) for n, r in zip(ELEMENTS, both, strict=True)},
        portraits=[Portrait.of(r) for r in both],
    )


def _pairs(lab: Laboratory) -> dict[tuple[str, float], Pair]:
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
    whole = diagnostics.last_periods(result.history, result.case)["tip_velocity"].to_numpy()
    rough = rough_part(whole, whole.shape[1] // result.case.time.steps_per_period)
    rms: FloatArray = np.sqrt((rough**2).mean(axis=1))
    return rms


def draw(numbers: FinerMesh) -> Figure:
    """Draw the phase portraits with 20 and 50 elements, and the roughness over the gap's shape."""
    titles = [f"{n} elements" for n in ELEMENTS]
    figure, below = two_portraits(numbers.portraits, titles, has_row_below=True)
    _ratio_panels(below, numbers.ratio_by_gap_exponent)
    return figure


def _ratio_panels(panels: list[Axes], ratios: dict[str, dict[str, FloatArray]]) -> None:
    """Draw the ratio of roughness of both tips over the exponent of the gap."""
    from matplotlib.ticker import ScalarFormatter

    for i, panel in enumerate(panels):
        for (name, by_gap), style in zip(ratios.items(), ("o-", "s--"), strict=True):
            exponents, values = [float(p) for p in by_gap], [r[i] for r in by_gap.values()]
            panel.plot(exponents, values, style, color=LAMINA_COLOURS[i], label=name)
        panel.axhline(1.0, color=BLACK, linewidth=0.8)
        panel.set(yscale="log", ylim=(0.5, 100.0), xticks=exponents)
        panel.yaxis.set_major_formatter(ScalarFormatter())
        panel.set(xlabel="exponent p of the gap  [–]", ylabel="rough velocity, 50 over 20  [–]")
        legend_above(panel)


def judge(numbers: FinerMesh) -> tuple[Claim, ...]:
    """Judge the effect of the finer mesh on the motion, and its cost."""
    ratio, cost, fine = numbers.ratio, numbers.cost, numbers.motions[ELEMENTS[1]]
    printed = ratio["as printed"]
    table = np.array(list(ratio.values()))
    schemes = [(float(table[:, i].min()), float(table[:, i].max())) for i in range(2)]
    bands = {name: _band(by_gap) for name, by_gap in numbers.ratio_by_gap_exponent.items()}
    first, *_, last = numbers.ratio_by_gap_exponent["as printed"]
    others = ", ".join(f"with {name} {ratio[name][0]:.2f} / {ratio[name][1]:.2f}"
                       for name in list(VARIANTS)[1:])  # fmt: skip
    return (
        Claim(
            "14", "50 elements: considerably less high-frequency velocity", "sec. 3.2",
            f"velocity above harmonic {SMOOTH_HARMONICS} over 40 periods, 50 over 20 elements: "
            f"{printed[0]:.2f} (thick), {printed[1]:.2f} (thin) with p = 2, {others}; over gaps "
            f"(x/L)^p, p = {first} … {last}: {bands['as printed']}, with consistent impulses "
            f"{bands['consistent impulses']}; the motion on 50: {fine.kind}",
            *judged(
                *(
                    Criterion(name, float(printed[i]), "<", CLEARLY, "", schemes[i])
                    for i, name in enumerate(("thick", "thin"))
                )
            ),
        ),
        Claim(
            "14", "a substantial increase in calculation time has to be accepted", "sec. 3.2",
            f"2.5 times the unknowns cost {cost:.1f} times the time per step with banded matrices "
            f"in compiled code (median of {numbers.pairs} pairs of runs)",
            *judged(Criterion("median", cost, ">", SUBSTANTIAL, "", numbers.cost_within)),
        ),
    )  # fmt: skip


def _band(by_gap: dict[str, FloatArray]) -> str:
    """Return the smallest and the largest ratio of both tips in words."""
    values = np.array(list(by_gap.values()))
    (a, b), (c, d) = values.min(axis=0), values.max(axis=0)
    return f"{a:.2f} … {c:.2f} / {b:.2f} … {d:.2f}"


FINER_MESH = Piece(
    "14",
    "A finer mesh",
    f"Method 3.2 at {RESONANT} Hz, {PORTRAIT_PERIODS} periods; all other parameters identical. "
    f"Below: velocity above harmonic {SMOOTH_HARMONICS} with {ELEMENTS[1]} elements over that "
    f"with {ELEMENTS[0]}, for gaps 12 mm (x/L)^p. The paper's portrait is not available; "
    "compared is the sentence on high frequencies.",
    measure,
    draw,
    judge,
)
