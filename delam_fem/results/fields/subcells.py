"""Cells of higher degree divided into linear ones between their nodes, which every viewer draws."""

from __future__ import annotations

from itertools import permutations, product

import numpy as np

from delam_fem.numerics.arrays import FloatArray, IntArray

TENSOR_CELLS = ("quadrilateral", "hexahedron")
VTK_ORDER = {2: (0, 1, 3, 2), 3: (0, 1, 3, 2, 4, 5, 7, 6)}
"""Corners of quadrilaterals and hexahedra in VTK's order, from their tensor order."""


def subcells(cell: str, degree: int, nodes: FloatArray) -> IntArray:
    """Return the linear cells into which a cell is divided, as nodes, in VTK's order.

    Args:
        cell: "triangle", "quadrilateral", "tetrahedron" or "hexahedron".
        degree: of the cell, so that it has degree + 1 nodes along each edge.
        nodes: their reference coordinates, shape (n_basis, dim).

    Returns:
        Shape (degree**dim, number of vertices of the cell).
    """
    dim = nodes.shape[1]
    places = {tuple(key): k for k, key in enumerate(np.rint(degree * nodes).astype(int).tolist())}
    found = _boxes(degree, dim) if cell in TENSOR_CELLS else _simplices(degree, dim)
    return np.array([[places[corner] for corner in own] for own in found], dtype=np.int64)


Corner = tuple[int, ...]


def _boxes(degree: int, dim: int) -> list[list[Corner]]:
    """Return the boxes of a lattice by the places of their corners."""
    result = []
    for low in product(range(degree), repeat=dim):
        corners = [
            tuple(a + ((number >> axis) & 1) for axis, a in enumerate(low))
            for number in VTK_ORDER[dim]
        ]
        result.append(corners)
    return result


def _simplices(degree: int, dim: int) -> list[list[Corner]]:
    """Return the simplices of a lattice by the places of their corners; all volumes are positive.

    In the coordinates a_k = i_k + i_(k+1) + … the reference simplex is p >= a_1 >= a_2 >= … >= 0,
    which is a union of simplices of Kuhn's division of boxes.
    """
    result = []
    for low, order in product(product(range(degree), repeat=dim), permutations(range(dim))):
        steps = np.zeros((dim + 1, dim), dtype=np.int64)
        for k, axis in enumerate(order):
            steps[k + 1 :, axis] += 1
        sums = np.array(low) + steps
        if np.any(np.diff(sums, axis=1) > 0):
            continue
        corners = sums.copy()
        corners[:, :-1] -= sums[:, 1:]
        if np.linalg.det(corners[1:] - corners[0]) < 0.0:
            corners[[-1, -2]] = corners[[-2, -1]]
        result.append([tuple(corner) for corner in corners.tolist()])
    return result
