"""Plates for tests: cases with named edges, and the mesh of a round plate."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import meshio
import numpy as np
import numpy.typing as npt

from delam_fem.api import Case

Array = npt.NDArray[np.float64]

E = 70e9  # Pa
RHO = 2700.0  # kg/m3
NU = 0.3
LENGTH = 0.2  # m
THICKNESS = 0.002  # m
EDGES = ("start", "end", "left", "right")


def plate(
    supports: Mapping[str, str | Mapping[str, object]],
    elements: int = 8,
    across: int = 8,
    *,
    length: float = LENGTH,
    width: float = LENGTH,
    thicknesses: tuple[float, ...] = (THICKNESS,),
    degree: int = 2,
    damping: float = 0.01,
    **sections: object,
) -> Case:
    """Return the case of a plate.

    Args:
        supports: kind of the support of each edge, or its table; edges that are not named are free.
        elements: cells along x.
        across: cells along z.
        length: of the plate [m].
        width: of the plate [m].
        thicknesses: of the laminae from the bottom [m].
        degree: of the cells.
        damping: damping ratio.
        **sections: further sections, in place of those of the plate.
    """
    names = ("lower", "upper", "cover")[: len(thicknesses)] if len(thicknesses) > 1 else ("sheet",)
    kinds = {end: "free" for end in EDGES[:2]} | dict(supports)
    tables = [
        {"side": side, **({"kind": kind} if isinstance(kind, str) else kind)}
        for side, kind in kinds.items()
    ]
    data: dict[str, object] = {
        "name": "plate",
        "lamina": [
            {
                "name": name, "length": length, "width": width, "thickness": h, "density": RHO,
                "young_modulus": E, "damping_ratio": damping,
            }
            for name, h in zip(names, thicknesses, strict=True)
        ],
        "support": tables,
        "mesh": {"elements": elements, "across": across},
        "model": {"kind": "solid", "poisson": NU, "degree": degree},
        "excitation": {"kind": "harmonic", "frequency": 100.0, "amplitude": 1e-5},
        "contact": {"law": "none"},
    }  # fmt: skip
    return Case.checked(data | sections, "plate")


PATCH: dict[str, object] = {
    "between": ["lower", "upper"], "start": 0.04, "end": 0.09, "across": [-0.03, 0.02],
}  # fmt: skip
"""The patch of `patched`, 50 mm along both axes."""
FORCE: dict[str, object] = {
    "kind": "force", "lamina": "lower", "position": [0.02, 0.03], "amplitude": 1.0,
    "frequency": 3000.0,
}  # fmt: skip
"""A shaker at a point of `patched`."""


def patched(elements: int = 6, **sections: object) -> Case:
    """Return the case of a plate of 120 x 100 mm with a patch, clamped at its start, on a base.

    Args:
        elements: cells along both axes.
        **sections: further sections, in place of those of the plate; "support" has all edges.
    """
    data: dict[str, object] = {
        "delamination": [PATCH],
        "excitation": {"kind": "harmonic", "frequency": 3000.0, "amplitude": 1e-6},
        "contact": {"law": "newton-penalty", "impulse": "consistent"},
        "time": {"steps_per_period": 100, "periods": 1},
    }
    return plate(
        {"start": "clamped"}, elements, elements, length=0.12, width=0.1,
        thicknesses=(0.0014, 0.0006), damping=0.02, **data | sections,
    )  # fmt: skip


def bending(h: float = THICKNESS) -> tuple[float, float]:
    """Return the bending stiffness D [N m] and the mass per area [kg/m2] of a sheet."""
    return E * h**3 / 12.0 / (1.0 - NU**2), RHO * h


def radius_of(radius: float, n: int) -> float:
    """Return the radius of the circle with the area of the polygon of `write_disc` [m]."""
    return float(radius * np.sqrt(2.0 * n / np.pi * np.sin(0.5 * np.pi / n)))


def write_disc(path: Path, radius: float, thickness: float, n: int, layers: int = 1) -> Path:
    """Write the mesh of a round plate, whose rim is the group "rim".

    A square of n x n cells is surrounded by four blocks of n x n/2 cells that end on a polygon
    within the circle.

    Args:
        path: the file.
        radius: its radius [m]; it lies from x = 0 to 2 radius.
        thickness: its thickness [m].
        n: cells along a side of the square, an even number.
        layers: cells through the thickness.
    """
    s = np.linspace(-1.0, 1.0, n + 1)
    side = np.stack([0.5 * s, np.full(n + 1, 0.5)], axis=1)
    arc = np.stack([np.sin(0.25 * np.pi * s), np.cos(0.25 * np.pi * s)], axis=1)
    shares = np.linspace(0.0, 1.0, n // 2 + 1)[:, None, None]
    ring = (1.0 - shares) * side + shares * arc
    grids = [np.stack(np.meshgrid(0.5 * s, 0.5 * s, indexing="ij"), axis=-1)]
    for quarter in range(4):
        c, sn = np.round([np.cos(quarter * np.pi / 2), np.sin(quarter * np.pi / 2)])
        grids.append(ring @ np.array([[c, sn], [-sn, c]]))
    corners = np.concatenate(
        [
            np.stack([g[:-1, :-1], g[1:, :-1], g[1:, 1:], g[:-1, 1:]], axis=2).reshape(-1, 4, 2)
            for g in grids
        ]
    )
    plan, number = np.unique(np.round(corners.reshape(-1, 2), 9), axis=0, return_inverse=True)
    quads = number.reshape(-1, 4)
    count = len(plan)
    y = np.linspace(0.0, thickness, layers + 1)
    points = np.concatenate(
        [np.column_stack([radius * (1.0 + plan[:, 0]), np.full(count, at), radius * plan[:, 1]])
         for at in y]
    )  # fmt: skip
    cells = np.concatenate(
        [np.hstack([quads + k * count, quads + (k + 1) * count]) for k in range(layers)]
    )
    sides = np.concatenate([quads[:, [a, b]] for a, b in ((0, 1), (1, 2), (2, 3), (3, 0))])
    is_rim = np.all(np.hypot(*plan[sides].transpose(2, 0, 1)) > 1.0 - 1e-6, axis=1)
    rim = np.concatenate(
        [
            np.hstack([sides[is_rim] + k * count, sides[is_rim][:, ::-1] + (k + 1) * count])
            for k in range(layers)
        ]
    )
    mesh = meshio.Mesh(
        points,
        [("hexahedron", cells), ("quad", rim)],
        cell_data={"gmsh:physical": [np.full(len(cells), 1), np.full(len(rim), 2)],
                   "gmsh:geometrical": [np.full(len(cells), 1), np.full(len(rim), 2)]},
        field_data={"sheet": np.array([1, 3]), "rim": np.array([2, 2])},
    )  # fmt: skip
    mesh.write(path, file_format="gmsh22", binary=False)
    return path
