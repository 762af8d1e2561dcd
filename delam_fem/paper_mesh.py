"""Fig. 14 of the paper: the motion at 3.25 Hz on a finer mesh."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes

from delam_fem import diagnostics
from delam_fem.figure_style import BLACK, LAMINA_COLOURS, legend_above
from delam_fem.motion_figures import PORTRAIT_PERIODS
from delam_fem.paper_claims import Claim, Piece, judged
from delam_fem.paper_detail import two_portraits
from delam_fem.paper_lab import Laboratory, motion_case
from delam_fem.paper_measures import SMOOTH_HARMONICS, describe, rough_part, roughness
from delam_fem.paper_motion import CLEARLY, RESONANT, motion_numbers
from delam_fem.results import Result

FloatArray = npt.NDArray[np.float64]

ELEMENTS = (20, 50)
LONG_WINDOW = {"output.window_periods": 40, "output.fields_per_period": 0}
"""For the roughness of motions whose cycles scatter."""
VARIANTS: dict[str, dict[str, object]] = {
    "as printed": {},
    "consistent impulses": {"contact.impulse": "consistent"},
    "lumped mass": {"time.mass": "lumped"},
}
"""Schemes with which the finer mesh is tried; "as printed" can add energy at impacts."""
SUBSTANTIAL = 1.25
"""Increase of a time from which on it counts as substantial."""

Pair = tuple[Result, Result]


def finer_mesh(lab: Laboratory) -> Piece:
    """Draw the phase portraits with 50 elements beside those with 20, and over the gap's shape."""
    variants: dict[str, dict[str, object]] = dict(VARIANTS)
    variants |= {f"p = {p:g}": {"gap.exponent": p} for p in lab.plan.gap_exponents}
    cases = [
        motion_case(RESONANT, lab.plan, "3.2", keys | LONG_WINDOW | {"mesh.elements": n})
        for keys in variants.values()
        for n in ELEMENTS
    ]
    results = lab.motions(cases)
    pairs = dict(zip(variants, zip(results[::2], results[1::2], strict=True), strict=True))
    coarse, fine = pairs["as printed"]
    numbers = _numbers(pairs, lab.plan.gap_exponents)
    titles = [f"{n} elements" for n in ELEMENTS]
    figure, below = two_portraits([coarse, fine], titles, has_row_below=True)
    _ratio_panels(below, numbers["ratio_by_gap_exponent"])
    caption = (
        f"Method 3.2 at {RESONANT} Hz, {PORTRAIT_PERIODS} periods; all other parameters identical. "
        f"Below: velocity above harmonic {SMOOTH_HARMONICS} with {ELEMENTS[1]} elements over that "
        f"with {ELEMENTS[0]}, for gaps 12 mm (x/L)^p. The paper's portrait is not available; "
        "compared is the sentence on high frequencies."
    )
    return Piece("14", "A finer mesh", caption, figure, numbers, _claims(numbers, fine))


def rough_velocity(result: Result) -> FloatArray:
    """Return rms of the rough part of both tip velocities, shape (2,) [m/s]."""
    whole = diagnostics.last_periods(result.history, result.case)["tip_velocity"].to_numpy()
    rough = rough_part(whole, whole.shape[1] // result.case.time.steps_per_period)
    rms: FloatArray = np.sqrt((rough**2).mean(axis=1))
    return rms


def _ratio_panels(panels: list[Axes], ratios: dict[str, FloatArray]) -> None:
    """Draw the ratio of roughness of both tips over the exponent of the gap."""
    exponents = [float(p) for p in ratios]
    for i, panel in enumerate(panels):
        panel.plot(
            exponents, [r[i] for r in ratios.values()], "o-", color=LAMINA_COLOURS[i],
            label="computed",
        )  # fmt: skip
        panel.axhline(1.0, color=BLACK, linewidth=0.8, label="no difference")
        panel.set_ylim(0.0, 1.1 * max(float(np.max(list(ratios.values()))), 1.0))
        panel.set(xlabel="exponent p of the gap  [–]", ylabel="rough velocity, 50 over 20  [–]")
        legend_above(panel)


def _numbers(pairs: dict[str, Pair], exponents: tuple[float, ...]) -> dict[str, Any]:
    coarse, fine = pairs["as printed"]
    ratio = {name: rough_velocity(b) / rough_velocity(a) for name, (a, b) in pairs.items()}
    costs = [
        b.summary["microseconds_per_step"] / a.summary["microseconds_per_step"]
        for a, b in pairs.values()
    ]
    return {
        "roughness_free": [roughness(r, free=True) for r in (coarse, fine)],
        "roughness": [rough_velocity(r) for r in (coarse, fine)],
        "ratio": ratio["as printed"],
        "ratio_of_variants": {name: ratio[name] for name in list(VARIANTS)[1:]},
        "ratio_by_gap_exponent": {f"{p:g}": ratio[f"p = {p:g}"] for p in exponents},
        "kind_by_gap_exponent": {f"{p:g}": describe(pairs[f"p = {p:g}"][1]) for p in exponents},
        "cost": float(np.median(costs)),
        "20": motion_numbers(coarse),
        "50": motion_numbers(fine),
    }


def _claims(numbers: dict[str, Any], fine: Result) -> tuple[Claim, ...]:
    ratio, cost = numbers["ratio"], numbers["cost"]
    band = np.array(list(numbers["ratio_by_gap_exponent"].values()))
    low, high = band.min(axis=0), band.max(axis=0)
    first, *_, last = numbers["ratio_by_gap_exponent"]
    others = ", ".join(
        f"with {name} {a:.2f} / {b:.2f}" for name, (a, b) in numbers["ratio_of_variants"].items()
    )
    return (
        Claim(
            "14", "50 elements: considerably less high-frequency velocity", "sec. 3.2",
            f"velocity above harmonic {SMOOTH_HARMONICS} over 40 periods, 50 over 20 elements: "
            f"{ratio[0]:.2f} (thick), {ratio[1]:.2f} (thin) with p = 2; {low[0]:.2f} … "
            f"{high[0]:.2f} and {low[1]:.2f} … {high[1]:.2f} for gaps (x/L)^p, p = {first} … "
            f"{last}; {others}; the motion on 50: {describe(fine)}",
            judged(bool(np.all(ratio < CLEARLY))), True,
        ),
        Claim(
            "14", "a substantial increase in calculation time has to be accepted", "sec. 3.2",
            f"2.5 times the unknowns cost {cost:.1f} times the time per step with banded matrices "
            f"in compiled code (median of {len(band) + len(VARIANTS)} pairs of runs)",
            judged(cost > SUBSTANTIAL),
        ),
    )  # fmt: skip
