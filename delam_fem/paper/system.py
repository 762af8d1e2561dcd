"""Fig. 1 of the paper: the system, drawn from the data of the case."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from delam_fem.case.definition import Case
from delam_fem.case.gap import initial_gap
from delam_fem.case.sections import Gap
from delam_fem.paper.claims import Criterion, Numbers, Piece, Statement, canvas
from delam_fem.paper.lab import RESONANT, Laboratory, motion_case
from delam_fem.results.figures.style import (
    BASE_COLOUR,
    BLACK,
    GAP_COLOUR,
    GREEN,
    lamina_colours,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

EXPONENTS = (1.0, 1.5, 2.0, 2.5, 3.0)
"""Exponents p of possible gap shapes g0(L) (x/L)^p; the paper does not give the shape."""
SHOWN_POINTS = 200
NEAR = 0.05
"""Two stiffnesses or mass ratios count as equal if they differ by less than this."""


def measure(lab: Laboratory) -> Numbers:
    """Return the properties of the paper's case; no motion is computed.

    Returns:
        case: the case as TOML; mass_ratio: m1/m2 [-]; natural_frequencies_hz: the first four of
        both laminae; stiffness_over_EbH3_12: given EI over that of the section, of both laminae
        [-]; x_m: positions along the laminae; gap_m: gap at these positions, by the exponent of its
        shape; drawn_case: the case itself.
    """
    case = motion_case(RESONANT, lab.plan)
    thick, thin = case.lamina
    assert case.gap is not None  # the paper's case has one
    x = np.linspace(0.0, thick.length, 21)
    return Numbers(
        {
            "case": case.to_toml(),
            "mass_ratio": thick.mass_per_length / thin.mass_per_length,
            "natural_frequencies_hz": [
                (lam.angular_frequencies(4) / (2.0 * math.pi)).tolist() for lam in case.lamina
            ],
            "stiffness_over_EbH3_12": [
                lam.flexural_rigidity / (lam.young_modulus * lam.width * lam.thickness**3 / 12.0)
                for lam in case.lamina
            ],
            "x_m": x,
            "gap_m": {
                f"{p:g}": initial_gap(Gap(tip=case.gap.tip, exponent=p), x, thick.length)
                for p in EXPONENTS
            },
        },
        drawn_case=case,
    )


def draw(numbers: Numbers) -> Figure:
    """Draw the laminae at rest, their gap, the base and the sensors, and list their properties."""
    case, figure = numbers.drawn_case, canvas(5.2)
    left, right = figure.subplots(1, 2, width_ratios=[3, 4])
    _draw_laminae(left, case)
    _list_properties(right, case)
    figure.suptitle(f"{case.name}: the system at rest (horizontal scale stretched)")
    return figure


def _draw_laminae(axes: Axes, case: Case) -> None:
    """Draw both laminae upright on their base."""
    assert case.gap is not None  # the paper's case has one
    L, tip = case.lamina[0].length, 1e3 * float(case.gap.tip or 0.0)
    x = np.linspace(0.0, L, SHOWN_POINTS)
    gaps = [1e3 * initial_gap(Gap(tip=case.gap.tip, exponent=p), x, L) for p in EXPONENTS]
    own = 1e3 * initial_gap(case.gap, x, L)
    axes.fill_betweenx(1e3 * x, gaps[-1], gaps[0], color=GAP_COLOUR, label="p = 1 … 3")
    shapes = (np.zeros_like(x), own)
    for lamina, shape, colour in zip(case.lamina, shapes, lamina_colours(2), strict=True):
        width = 2.5 * lamina.thickness / 1e-3
        label = f"{lamina.name}, {1e3 * lamina.thickness:g} mm"
        axes.plot(shape, 1e3 * x, color=colour, linewidth=width, label=label)
    height = 1e3 * L
    axes.annotate(
        "", (0.0, 0.97 * height), (tip, 0.97 * height),
        arrowprops={"arrowstyle": "<->", "color": BLACK, "shrinkA": 0, "shrinkB": 0},
    )  # fmt: skip
    axes.text(0.5 * tip, 0.985 * height, f"{tip:g} mm", ha="center", va="bottom")
    for position, name in ((0.0, "$y_1$"), (tip, "$y_2$")):
        axes.plot([position], [height], "s", color=GREEN, markersize=7, zorder=4)
        axes.text(position, 1.035 * height, name, ha="center", va="bottom", color=GREEN)
    axes.plot([], [], "s", color=GREEN, label="position and velocity sensors")
    axes.fill_between([-5.0, tip + 5.0], -0.07 * height, 0.0, color=BASE_COLOUR)
    axes.annotate(
        "", (tip / 2 - 5.0, -0.11 * height), (tip / 2 + 5.0, -0.11 * height),
        arrowprops={"arrowstyle": "<->", "color": BLACK},
    )  # fmt: skip
    axes.text(
        tip / 2, -0.13 * height, f"base: A sin(2πft), {case.excitation.size}",
        ha="center", va="top",
    )  # fmt: skip
    axes.set(
        xlabel="position [mm]", xlim=(-9.0, tip + 9.0),
        ylabel="x [mm]", ylim=(-0.22 * height, 1.32 * height), yticks=np.arange(0.0, height, 100.0),
    )  # fmt: skip
    axes.legend(loc="upper center", fontsize=8, ncols=2)
    axes.grid(False)


def _properties(case: Case) -> list[tuple[str, str, str]]:
    """Return rows of (property, value of the thick lamina, value of the thin lamina)."""
    thick, thin = case.lamina
    computed = [lam.young_modulus * lam.width * lam.thickness**3 / 12.0 for lam in case.lamina]
    f = [lam.angular_frequencies(2) / (2.0 * math.pi) for lam in case.lamina]
    sections = [f"{1e3 * lam.thickness:g} × {1e3 * lam.width:g}" for lam in case.lamina]
    return [
        ("", thick.name, thin.name),
        ("length [mm]", f"{1e3 * thick.length:g}", f"{1e3 * thin.length:g}"),
        ("section [mm × mm]", sections[0], sections[1]),
        ("density [kg/m³]", f"{thick.density:g}", f"{thin.density:g}"),
        ("E [10¹⁰ N/m²]", f"{thick.young_modulus / 1e10:g}", f"{thin.young_modulus / 1e10:g}"),
        ("EI used [N m²]", f"{thick.flexural_rigidity:g}", f"{thin.flexural_rigidity:g}"),
        ("E b h³/12 [N m²]", f"{computed[0]:.4f}", f"{computed[1]:.4f}"),
        ("mass per length [kg/m]", f"{thick.mass_per_length:.4f}", f"{thin.mass_per_length:.4f}"),
        ("damping ratio D", f"{thick.damping_ratio:g}", f"{thin.damping_ratio:g}"),
        ("f₁ exact [Hz]", f"{f[0][0]:.4f}", f"{f[1][0]:.4f}"),
        ("f₂ exact [Hz]", f"{f[0][1]:.3f}", f"{f[1][1]:.3f}"),
        ("contact pairs", f"{case.mesh.elements}", ""),
    ]


def _list_properties(axes: Axes, case: Case) -> None:
    """Write the properties as a table."""
    axes.axis("off")
    rows = _properties(case)
    table = axes.table(
        cellText=[list(row) for row in rows[1:]], colLabels=list(rows[0]), cellLoc="left",
        colWidths=[0.5, 0.28, 0.22], edges="horizontal", loc="center",
    )  # fmt: skip
    table.auto_set_font_size(False)
    table.set_fontsize(10.0)
    table.scale(1.0, 1.6)
    for column, colour in enumerate(lamina_colours(2), start=1):
        table[0, column].get_text().set_color(colour)


STATEMENTS = (
    Statement(
        "the ratio of masses is approximately m1/m2 = 1/2", "sec. 2.3",
        lambda n: f"ρ₁A₁/ρ₂A₂ = {n.mass_ratio:.3f}: the thick lamina is the heavier one "
        "(0.515 = m2/m1)",
        lambda n: [Criterion("away from 1/2 by", abs(n.mass_ratio - 0.5), "<", NEAR)],
    ),
    Statement(
        "E and the sections give EI = 1.51 and 0.16 N m²", "sec. 2.1, 3.1",
        lambda n: "EI given / (E b h³/12) − 1 = {:+.1f} % and {:+.1f} %; the given EI are used"
        .format(*(100 * (given - 1.0) for given in n.stiffness_over_EbH3_12)),
        lambda n: [
            Criterion(
                "largest deviation", max(abs(given - 1.0) for given in n.stiffness_over_EbH3_12),
                "<", NEAR, "%",
            )
        ],
    ),
)  # fmt: skip


SYSTEM = Piece(
    "1",
    "The system",
    "Drawn from the case. The paper prints the gap at the tip alone: the shapes of the single "
    "laminae are unknown and do not matter, the shape of the gap does; the band shows the gaps "
    f"12 mm (x/L)^p with p = {EXPONENTS[0]:g} … {EXPONENTS[-1]:g}, the line p = "
    "{0.drawn_case.gap.exponent:g}, all counted from a straight thick lamina.",
    measure,
    draw,
    STATEMENTS,
)
