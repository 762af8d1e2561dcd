"""Contact pressure: the forces of pairs, spread over the surfaces on which they act.

A pair shares its force among the vertices of the facet on which it lies, by their linear functions
N_v. The pressure at a vertex is its force over the integral of N_v, and linear between vertices.
The integral of the pressure over the surface is therefore the sum of the forces.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from delam_fem.model.solids.cells import FACET_OF, meetings, shape_functions
from delam_fem.model.solids.facing import Pairs, corner_shares
from delam_fem.model.solids.mesh import Facing, SolidMesh
from delam_fem.numerics.arrays import FloatArray, IntArray

ON_FACET = 1e-9
"""How much less than 1 the linear functions of a facet's vertices may sum up to on it."""


@dataclass(frozen=True)
class Side:
    """One of the two surfaces of an interface.

    Attributes:
        facets: as vertices, shape (n, m).
        cells: whose facets they are, shape (n,).
        places: where the pairs lie on it, shape (n_pairs, dim) [m].
    """

    facets: IntArray
    cells: IntArray
    places: FloatArray


def sides_of(mesh: SolidMesh, facing: Facing, pairs: Pairs) -> tuple[Side, Side]:
    """Return the lower and the upper surface of an interface."""
    lower, _ = mesh.cells_with(facing.lower)
    upper, _ = mesh.cells_with(facing.upper)
    return Side(facing.lower, lower, pairs.lower.x), Side(facing.upper, upper, pairs.upper)


def at_vertices(
    mesh: SolidMesh, side: Side, normals: FloatArray, width: float
) -> tuple[IntArray, sp.csr_matrix]:
    """Return the pressures at the vertices of a side by unit forces of the pairs.

    Args:
        mesh: the mesh.
        side: the side.
        normals: of the pairs, shape (n_pairs, dim).
        width: of the surface in two dimensions [m]; 1 in three.

    Returns:
        The vertices, shape (n,), and CSR (n, n_pairs) [1/m2].

    Raises:
        ValueError: a pair is not on the side.
    """
    kind, corners = FACET_OF[mesh.cell], mesh.points[side.facets]
    hits = meetings(corners, side.places, normals, kind)
    order = np.lexsort([hits.facet, np.abs(hits.distance), hits.line])
    lines, first = np.unique(hits.line[order], return_index=True)
    if lines.size < len(side.places):
        raise ValueError("solid: a contact pair lies on no facet of its surface")
    chosen = order[first]
    N, _ = shape_functions(kind, hits.local[chosen])
    vertices, number = np.unique(side.facets, return_inverse=True)
    number = number.reshape(side.facets.shape)
    _, shares = corner_shares(mesh, side.facets, side.cells)
    area = width * np.bincount(number.ravel(), shares.ravel())
    columns = np.repeat(np.arange(lines.size), N.shape[1])
    rows = number[hits.facet[chosen]].ravel()
    forces = sp.csr_matrix((N.ravel(), (rows, columns)), (vertices.size, lines.size))
    return vertices, sp.csr_matrix(sp.diags(1.0 / area) @ forces)


def at_points(
    mesh: SolidMesh, side: Side, vertices: IntArray, places: FloatArray, cells: IntArray, n: int
) -> sp.csr_matrix:
    """Return the values at the points of the side's cells from values at its vertices.

    Args:
        mesh: the mesh.
        side: the side.
        vertices: whose values are given, increasing, shape (k,).
        places: reference coordinates of the points of a cell, shape (n_basis, dim).
        cells: points of all cells of the mesh, shape (n_cells, n_basis).
        n: number of points.

    Returns:
        CSR (n, k); rows of points beside the surface are empty.
    """
    N, _ = shape_functions(mesh.cell, places)
    own = mesh.cells[side.cells]
    is_of_facet = (own[:, :, None] == side.facets[:, None, :]).any(axis=2)
    facet, point = np.nonzero(is_of_facet @ N.T > 1.0 - ON_FACET)
    points, first = np.unique(cells[side.cells[facet], point], return_index=True)
    facet, point = facet[first], point[first]
    rows = np.repeat(np.arange(points.size), N.shape[1])
    used = (N[point] * is_of_facet[facet]).ravel()
    kept = np.abs(used) > ON_FACET
    columns = np.searchsorted(vertices, own[facet].ravel()[kept])
    return sp.csr_matrix((used[kept], (points[rows[kept]], columns)), shape=(n, vertices.size))
