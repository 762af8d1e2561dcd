"""The mesh of laminae as solids: plain arrays, whether they come from a case or from a file.

Axes: x along the laminae from 0 to their length, y upwards through the thickness (the direction of
the deflection), z across the width, centred on 0. The bottom of the lowest lamina is y = 0. Laminae
that are apart touch geometrically and have vertices of their own; bonded ones share theirs.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from delam_fem.numerics.arrays import FloatArray, IntArray

FACETS: dict[str, tuple[tuple[int, ...], ...]] = {
    "triangle": ((1, 2), (0, 2), (0, 1)),
    "quadrilateral": ((0, 1), (0, 2), (1, 3), (2, 3)),
    "tetrahedron": ((1, 2, 3), (0, 2, 3), (0, 1, 3), (0, 1, 2)),
    "hexahedron": (
        (0, 1, 2, 3), (0, 1, 4, 5), (0, 2, 4, 6), (1, 3, 5, 7), (2, 3, 6, 7), (4, 5, 6, 7),
    ),
}  # fmt: skip
"""Vertices of the facets of each cell, in the order of basix."""
VERTICES = {"triangle": 3, "quadrilateral": 4, "tetrahedron": 4, "hexahedron": 8}
"""Number of vertices of each cell."""


@dataclass(frozen=True)
class Facing:
    """The two surfaces of neighbouring laminae that may touch.

    Attributes:
        parts: numbers of the lower and the upper lamina.
        lower: facets of the upper surface of the lower lamina, as vertices, shape (n, m).
        upper: facets of the lower surface of the upper lamina, as vertices, shape (n, m).
    """

    parts: tuple[int, int]
    lower: IntArray
    upper: IntArray


@dataclass(frozen=True)
class SolidMesh:
    """Cells of laminae in two or three dimensions; all ranks have all of it.

    Attributes:
        points: the vertices, shape (n_points, dim) [m].
        cells: vertices of the cells in the order of dolfinx, which is the tensor order for
            quadrilaterals and hexahedra, shape (n_cells, k).
        cell: "triangle", "quadrilateral", "tetrahedron" or "hexahedron".
        lamina: number of the lamina of each cell, from 0 at the bottom, shape (n_cells,).
        supports: facets of the ends "start" and "end" as vertices, shape (n, m) each.
        sides: the surfaces that face one another, for each interface of neighbouring laminae that
            are apart somewhere.
    """

    points: FloatArray
    cells: IntArray
    cell: str
    lamina: IntArray
    supports: Mapping[str, IntArray] = field(default_factory=dict)
    sides: tuple[Facing, ...] = ()

    def __post_init__(self) -> None:
        """Check the shapes.

        Raises:
            ValueError: an array does not fit the cells.
        """
        if self.cell not in VERTICES:
            raise ValueError(f"solid: expected one of {', '.join(VERTICES)}, given {self.cell!r}")
        dim = 3 if self.cell in ("tetrahedron", "hexahedron") else 2
        n = len(self.cells)
        shapes = (
            ("points", self.points.shape, (len(self.points), dim)),
            ("cells", self.cells.shape, (n, VERTICES[self.cell])),
            ("lamina", self.lamina.shape, (n,)),
        )
        for name, given, expected in shapes:
            if given != expected:
                raise ValueError(f"solid: {name} has shape {given}, expected {expected}")
        if n == 0 or self.cells.min() < 0 or self.cells.max() >= len(self.points):
            raise ValueError("solid: a cell has a vertex that does not exist, or there is no cell")

    @property
    def dim(self) -> int:
        """Number of dimensions: 2 or 3."""
        return int(self.points.shape[1])

    @cached_property
    def bodies(self) -> IntArray:
        """Number of the separate body of each cell, in the order of their cells, (n_cells,)."""
        n, k = self.cells.shape
        rows = np.repeat(np.arange(n), k)
        entries = np.ones(n * k, dtype=np.int8)
        touches = sp.csr_matrix((entries, (rows, self.cells.ravel())), (n, len(self.points)))
        graph = sp.bmat([[None, touches], [touches.T, None]], format="csr")
        _, label = connected_components(graph, directed=False)
        _, first, number = np.unique(label[:n], return_index=True, return_inverse=True)
        return np.asarray(np.argsort(np.argsort(first))[number])

    def cells_with(self, facets: IntArray) -> tuple[IntArray, IntArray]:
        """Return the cell that has each facet on its boundary, and the facet's number in it.

        Args:
            facets: facets as vertices in any order, shape (n, m).

        Returns:
            Cells and local facets, shape (n,) each.

        Raises:
            ValueError: a facet is not on the boundary of exactly one cell.
        """
        if len(facets) == 0:
            return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)
        wanted = np.zeros(len(self.points), dtype=np.bool_)
        wanted[facets.ravel()] = True
        near = np.flatnonzero(wanted[self.cells].sum(axis=1) >= facets.shape[1])
        local = FACETS[self.cell]
        found: dict[tuple[int, ...], tuple[int, int]] = {}
        twice: set[tuple[int, ...]] = set()
        for number, vertices in enumerate(local):
            keys = np.sort(self.cells[near][:, vertices], axis=1)
            for cell, key in zip(near.tolist(), map(tuple, keys.tolist()), strict=True):
                if key in found:
                    twice.add(key)
                found[key] = (cell, number)
        asked: Sequence[tuple[int, ...]] = [*map(tuple, np.sort(facets, axis=1).tolist())]
        bad = [key for key in asked if key not in found or key in twice]
        if bad:
            raise ValueError(
                f"solid: expected a facet on the boundary of one cell, the facet with the vertices "
                f"{bad[0]} is {'between two' if bad[0] in twice else 'of none'}"
            )
        pairs = np.array([found[key] for key in asked], dtype=np.int64)
        return pairs[:, 0], pairs[:, 1]
