"""Local defect resonance of round and square patches, beside that of the clamped plate above them.

A plate of two laminae, clamped at all edges, has one patch in its middle. Its upper lamina has a
fifth of the thickness h, its sides are 1.5 times as long as the patch. The frequency is that of the
lowest mode, beside λ² √(D / ρ h) / (2π a²) of a thin clamped plate: λ² = 10.2158 of a circle of
radius a, 35.985 of a square with the sides a (A. W. Leissa, "Vibration of Plates", NASA SP-160).

The edge of a patch is elastic: the skin goes on as if the plate were larger by k h on each side,

    f / f_clamped = (1 + k h / r)⁻²,   r half of the size of the patch,

and k follows from the frequency. It prints a table in Markdown.

    python scripts/evidence/defect_resonance.py [--cells 6 9 12] [--depths 80 40 20]
        [--shapes ellipse rectangle]
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence

from delam_fem.api import Case, assemble, lowest

SIZE = 0.04  # m, of the patch
SIDE = 1.5 * SIZE
E, RHO, NU = 70e9, 2700.0, 0.3
BELOW = 4.0
"""Thickness of the lower lamina over that of the upper one."""
LAMBDA = {"ellipse": (10.2158, 0.5 * SIZE), "rectangle": (35.985, SIZE)}
"""λ² and its length [m] by the shape of the patch."""
EDGES = ("start", "end", "left", "right")
NAMES = {"ellipse": "round", "rectangle": "square"}


def case_of(shape: str, slenderness: float, cells: int, degree: int) -> Case:
    """Return the case of a plate with a patch.

    Args:
        shape: of the patch.
        slenderness: its size over the thickness above it.
        cells: of the mesh along x and across.
        degree: of the elements.
    """
    h = SIZE / slenderness
    lamina = {
        "length": SIDE, "width": SIDE, "density": RHO, "young_modulus": E, "damping_ratio": 0.01,
    }  # fmt: skip
    low = 0.5 * (SIDE - SIZE)
    data = {
        "name": "patch",
        "lamina": [
            lamina | {"name": "lower", "thickness": BELOW * h},
            lamina | {"name": "upper", "thickness": h},
        ],
        "support": [{"side": side, "kind": "clamped"} for side in EDGES],
        "delamination": [
            {
                "between": ["lower", "upper"], "start": low, "end": low + SIZE,
                "across": [-0.5 * SIZE, 0.5 * SIZE], "shape_in_plane": shape,
            }
        ],
        "mesh": {"elements": cells, "across": cells},
        "model": {"kind": "solid", "poisson": NU, "degree": degree},
        "excitation": {"kind": "harmonic", "frequency": 1000.0, "amplitude": 1e-6},
        "contact": {"law": "none"},
    }  # fmt: skip
    return Case.checked(data, "patch")


def frequency(shape: str, slenderness: float, cells: int, degree: int) -> float:
    """Return the frequency of the lowest mode with the patch open, over the clamped plate's."""
    operators = assemble(case_of(shape, slenderness, cells, degree)).operators
    (computed,), _ = lowest(operators.stiffness, operators.mass, 1)
    h = SIZE / slenderness
    square, length = LAMBDA[shape]
    speed = math.sqrt(E * h**2 / 12.0 / (1.0 - NU**2) / RHO)
    return float(computed) * 2.0 * math.pi * length**2 / (square * speed)


def main(arguments: Sequence[str] | None = None) -> list[tuple[str, float, int, float, float]]:
    """Print the table; return its rows: shape, size over h, cells, f over the clamped one, k."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cells", type=int, nargs="+", default=[6, 9, 12])
    parser.add_argument("--depths", type=float, nargs="+", default=[80.0, 40.0, 20.0])
    parser.add_argument("--degree", type=int, default=3)
    parser.add_argument("--shapes", nargs="+", choices=LAMBDA, default=list(LAMBDA))
    options = parser.parse_args(arguments)
    rows = []
    print("| patch | size / h | cells | f over that of the clamped plate | k |")
    print("|---|---|---|---|---|")
    for shape in options.shapes:
        for slenderness in options.depths:
            for cells in options.cells:
                share = frequency(shape, slenderness, cells, options.degree)
                k = 0.5 * slenderness * (share**-0.5 - 1.0)
                rows.append((shape, slenderness, cells, share, k))
                print(
                    f"| {NAMES[shape]} | {slenderness:g} | {cells} x {cells} | {share:.4f} | "
                    f"{k:.2f} |",
                    flush=True,
                )
    return rows


if __name__ == "__main__":
    main()
