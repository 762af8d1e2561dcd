"""Small meshes of solids: two bodies whose facing surfaces need not match, and those of files."""

from itertools import permutations
from pathlib import Path

import numpy as np
import numpy.typing as npt
from project import ROOT

from delam_fem.api import Case, preset
from delam_fem.model.solids.mesh import FACETS, Facing, SolidMesh

Array = npt.NDArray[np.float64]
MESHES = ROOT / "meshes" / "solids"


def brick(cell: str, counts: tuple[int, ...], low: Array, high: Array) -> tuple[Array, Array]:
    """Return points and cells of a box that is divided evenly."""
    dim = len(counts)
    axes = [np.linspace(a, b, n + 1) for a, b, n in zip(low, high, counts, strict=True)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, dim)
    number = np.arange(len(points)).reshape([n + 1 for n in counts])
    corners = []
    for offset in range(2**dim):
        shift = [(offset >> axis) & 1 for axis in range(dim)]
        block = tuple(slice(s, s + n) for s, n in zip(shift, counts, strict=True))
        corners.append(number[block].ravel())
    boxes = np.column_stack(corners)
    if cell in ("quadrilateral", "hexahedron"):
        return points, boxes
    paths = []
    for order in permutations(range(dim)):  # Kuhn's division of a box into simplices
        steps = np.cumsum([0, *(2**axis for axis in order)])
        paths.append(boxes[:, steps])
    return points, np.concatenate(paths)


def facets_at(points: Array, cells: Array, cell: str, height: float) -> npt.NDArray[np.int64]:
    """Return the facets that lie in the plane y = height."""
    facets = np.concatenate([cells[:, list(facet)] for facet in FACETS[cell]])
    return facets[np.all(np.abs(points[facets][..., 1] - height) < 1e-12, axis=1)]


def two_bricks(
    cell: str,
    lower: tuple[int, ...],
    upper: tuple[int, ...],
    gap: float = 0.0,
    size: tuple[float, ...] = (2.0, 0.5, 0.8),
    ends: tuple[float, float] = (0.0, 2.0),
) -> SolidMesh:
    """Return two boxes at a distance; the upper one reaches from one end to the other along x."""
    dim = len(lower)
    half = np.zeros(3)
    half[2] = 0.5 * size[2]
    low, high = -half[:dim], (np.array(size) - half)[:dim]
    first = brick(cell, lower, low, high)
    low, high = low.copy(), high.copy()
    low[0], high[0] = ends
    low[1], high[1] = size[1] + gap, 2.0 * size[1] + gap
    second = brick(cell, upper, low, high)
    shift = len(first[0])
    sides = Facing(
        (0, 1),
        facets_at(*first, cell, size[1]),
        shift + facets_at(*second, cell, size[1] + gap),
    )
    return SolidMesh(
        np.concatenate([first[0], second[0]]),
        np.concatenate([first[1], shift + second[1]]),
        cell,
        np.repeat([0, 1], [len(first[1]), len(second[1])]),
        sides=(sides,),
    )


def case_of(name: str, path: Path | None = None, **further: object) -> Case:
    """Return the case to which a mesh of the folder belongs, with another file of it."""
    keys: dict[str, object] = {
        "model.kind": "plane-stress" if name.startswith("plane") else "solid",
        "mesh.elements": None,
        "mesh.file": str(path or MESHES / f"{name}.msh"),
    }
    if name.endswith("delaminated"):
        keys |= {"delamination.1.start": 0.06, "delamination.1.end": 0.14, "support.end": "free"}
        for number, thickness in enumerate((0.004, 0.002), 1):
            keys[f"lamina.{number}.thickness"] = thickness
            keys[f"lamina.{number}.length"] = 0.2
        return preset("embedded", keys | further)
    return preset("paper", keys | further)
