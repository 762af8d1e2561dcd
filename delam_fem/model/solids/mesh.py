"""The mesh of laminae as solids, and the geometry of its straight-edged cells.

A mesh is plain arrays, whether they come from a case or from a file. Its axes are x along the
laminae from 0 to their length, y upwards through the thickness (the direction of the deflection),
and z across the width, centred on 0. The bottom of the lowest lamina is y = 0. Laminae that are
apart touch geometrically and have vertices of their own; bonded ones share theirs.

The geometry of cells and facets (reference coordinates, the cells of points, the facets that lines
meet) needs only the arrays of the mesh, so that all ranks find the same cells.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from delam_fem.numerics.types import BoolArray, FloatArray, IntArray

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
    """Cells of laminae in two or three dimensions; every rank has the whole mesh.

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
        for name, shape, expected in shapes:
            if shape != expected:
                raise ValueError(f"solid: {name} has shape {shape}, expected {expected}")
        if n == 0 or self.cells.min() < 0 or self.cells.max() >= len(self.points):
            raise ValueError("solid: a cell has a vertex that does not exist, or there is no cell")

    @property
    def dim(self) -> int:
        """Number of dimensions: 2 or 3."""
        return int(self.points.shape[1])

    @cached_property
    def bodies(self) -> IntArray:
        """Number of the separate body of each cell, in the order of first cells, (n_cells,)."""
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
        cell_by_key: dict[tuple[int, ...], tuple[int, int]] = {}
        twice: set[tuple[int, ...]] = set()
        for number, vertices in enumerate(local):
            keys = np.sort(self.cells[near][:, vertices], axis=1)
            for cell, key in zip(near.tolist(), map(tuple, keys.tolist()), strict=True):
                if key in cell_by_key:
                    twice.add(key)
                cell_by_key[key] = (cell, number)
        asked: Sequence[tuple[int, ...]] = [*map(tuple, np.sort(facets, axis=1).tolist())]
        bad = [key for key in asked if key not in cell_by_key or key in twice]
        if bad:
            raise ValueError(
                f"solid: expected a facet on the boundary of one cell, the facet with the vertices "
                f"{bad[0]} is {'between two' if bad[0] in twice else 'of none'}"
            )
        pairs = np.array([cell_by_key[key] for key in asked], dtype=np.int64)
        return pairs[:, 0], pairs[:, 1]


FACET_OF = {
    "triangle": "interval",
    "quadrilateral": "interval",
    "tetrahedron": "triangle",
    "hexahedron": "quadrilateral",
}
"""Kind of the facets of a cell."""
_PARALLEL = 1e-9
"""Sine of the angle below which a line does not meet a facet but runs along it."""
INSIDE = 1e-6
"""How far outside its cell a point may be, in reference coordinates: round-off of thin cells."""
TENSOR = ("quadrilateral", "hexahedron")
_ITERATIONS = 30
_CONVERGED = 1e-13
_MOST_CANDIDATES = 1_000_000
"""Points times cells, or lines times facets, looked at in one go: a bound for the memory."""


def locate(mesh: SolidMesh, points: FloatArray, lamina: IntArray | int) -> IntArray:
    """Return the cell of the lamina in which each point is, the same on all ranks, shape (k,).

    Of several cells that share the point, the one with the lowest number is taken.

    Args:
        mesh: the mesh.
        points: shape (k, dim) [m].
        lamina: number of the lamina of each point, shape (k,), or of all.

    Raises:
        ValueError: a point is in no cell of its lamina.
    """
    of_point = np.broadcast_to(np.asarray(lamina, dtype=np.int64), len(points))
    result = np.full(len(points), -1, dtype=np.int64)
    for number in np.unique(of_point):
        chosen = np.flatnonzero(of_point == number)
        result[chosen] = _cells_of(mesh, points[chosen], np.flatnonzero(mesh.lamina == number))
    if np.any(result < 0):
        worst = int(np.flatnonzero(result < 0)[0])
        raise ValueError(f"point {points[worst]} is in no cell of lamina {of_point[worst]}")
    return result


def _cells_of(mesh: SolidMesh, points: FloatArray, cells: IntArray) -> IntArray:
    """Return the cell of each point among `cells`, or -1, shape (k,)."""
    corners = mesh.points[mesh.cells[cells]]
    result = np.full(len(points), len(mesh.cells), dtype=np.int64)
    for point, place in _candidates(corners, points):
        X = reference_coordinates(mesh.cell, corners[place], points[point])
        is_in = overshoot(mesh.cell, X) <= INSIDE
        np.minimum.at(result, point[is_in], cells[place[is_in]])
    result[result == len(mesh.cells)] = -1
    return result


def _candidates(corners: FloatArray, points: FloatArray) -> Iterator[tuple[IntArray, IntArray]]:
    """Yield points with cells whose boxes contain them: numbers of both, each of shape (m,)."""
    low = corners.min(axis=1)
    high = corners.max(axis=1)
    margin = 1e-6 * (high - low).max(axis=0)
    low = low - margin
    high = high + margin
    scale = 0.5 * (high - low).max(axis=0)  # every box lies within 1 of its centre
    tree = cKDTree(0.5 * (low + high) / scale)
    step = max(1, _MOST_CANDIDATES // len(corners))
    for first in range(0, len(points), step):
        some = points[first : first + step]
        near = tree.query_ball_point(some / scale, 1.0 + 1e-9, p=np.inf)
        point = np.repeat(np.arange(len(some)), [len(candidates) for candidates in near])
        place = np.array([k for candidates in near for k in candidates], dtype=np.int64)
        is_in = np.all((some[point] >= low[place]) & (some[point] <= high[place]), axis=1)
        yield first + point[is_in], place[is_in]


def reference_coordinates(cell: str, corners: FloatArray, points: FloatArray) -> FloatArray:
    """Return the reference coordinates of points in straight-edged cells, shape (k, dim).

    Newton's method on the map of the cell; one step is exact for simplices.

    Args:
        cell: kind of the cells.
        corners: of the cell of each point, shape (k, n_vertices, dim) [m].
        points: shape (k, dim) [m].
    """
    dim = points.shape[1]
    X = np.full(points.shape, 0.5 if cell in TENSOR else 1.0 / (dim + 1))
    for _ in range(_ITERATIONS if cell in TENSOR else 2):
        N, _ = shape_functions(cell, X)
        residual = points - np.einsum("kv,kvi->ki", N, corners)
        jacobians = jacobians_of(cell, corners, X)
        jacobians[np.linalg.det(jacobians) == 0.0] = np.eye(dim)  # outside a cell that is no brick
        step = np.clip(np.linalg.solve(jacobians, residual[..., None])[..., 0], -2.0, 2.0)
        X = X + step
        if np.abs(step).max(initial=0.0) < _CONVERGED:
            break
    return X


def shape_functions(cell: str, X: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the linear or multilinear functions of the vertices, and their derivatives.

    Args:
        cell: kind of the cells or facets.
        X: reference coordinates, shape (k, d).

    Returns:
        Values, shape (k, n_vertices), and derivatives, shape (k, n_vertices, d).
    """
    k, d = X.shape
    if cell not in (*TENSOR, "interval"):
        N = np.column_stack([1.0 - X.sum(axis=1), X])
        return N, np.broadcast_to(np.vstack([-np.ones(d), np.eye(d)]), (k, d + 1, d))
    # in tensor order, bit j of a vertex's number is its coordinate X_j
    bits = (np.arange(2**d)[:, None] >> np.arange(d)) & 1  # (n_vertices, d)
    factors = np.where(bits, X[:, None, :], 1.0 - X[:, None, :])
    dN = np.empty((k, 2**d, d))
    for j in range(d):
        dN[:, :, j] = (2.0 * bits[:, j] - 1.0) * np.prod(np.delete(factors, j, axis=2), axis=2)
    return np.prod(factors, axis=2), dN


def jacobians_of(cell: str, corners: FloatArray, X: FloatArray) -> FloatArray:
    """Return the Jacobians dx_i/dX_j at reference coordinates X, shape (k, dim, d)."""
    return np.asarray(np.einsum("kvi,kvj->kij", corners, shape_functions(cell, X)[1]))


def overshoot(cell: str, X: FloatArray) -> FloatArray:
    """Return how far reference coordinates are outside the cell, shape (k,)."""
    above = X.max(axis=1) if cell in (*TENSOR, "interval") else X.sum(axis=1)
    return np.asarray(np.maximum(-X.min(axis=1), above - 1.0))


def volumes(mesh: SolidMesh) -> FloatArray:
    """Return volumes of cells, or areas in two dimensions, shape (n_cells,) [m3 or m2].

    Simplices have one determinant. Others are integrated by Gauss's rule with two points each way,
    which is exact, because the determinant is at most quadratic in each coordinate.
    """
    corners = mesh.points[mesh.cells]
    dim = mesh.dim
    if mesh.cell not in TENSOR:
        X = np.full((len(corners), dim), 1.0 / (dim + 1))
        factor = 0.5 if dim == 2 else 1.0 / 6.0
        return np.asarray(factor * np.linalg.det(jacobians_of(mesh.cell, corners, X)))
    at = 0.5 + np.array([-0.5, 0.5]) / np.sqrt(3.0)
    places = np.stack(np.meshgrid(*[at] * dim), axis=-1).reshape(-1, dim)
    dets = [
        np.linalg.det(jacobians_of(mesh.cell, corners, np.tile(X, (len(corners), 1))))
        for X in places
    ]
    return np.asarray(np.mean(dets, axis=0))


@dataclass(frozen=True)
class Hits:
    """Meetings of lines and facets.

    Attributes:
        line: number of the line, shape (m,).
        facet: number of the facet, shape (m,).
        distance: from the origin of the line, along its direction, shape (m,) [m].
        local: reference coordinates within the facet, shape (m, dim - 1).
    """

    line: IntArray
    facet: IntArray
    distance: FloatArray
    local: FloatArray


def meetings(corners: FloatArray, origins: FloatArray, directions: FloatArray, facet: str) -> Hits:
    """Return all meetings of lines and facets, line by line.

    Args:
        corners: of the facets, shape (n, n_vertices, dim) [m].
        origins: of the lines, shape (k, dim) [m].
        directions: unit vectors, shape (k, dim).
        facet: "interval", "triangle" or "quadrilateral".
    """
    none = np.zeros(0, dtype=np.int64)
    n_local = corners.shape[2] - 1
    hits = [Hits(none, none, np.zeros(0), np.zeros((0, n_local)))]
    for line, number in _near(corners, origins, directions):
        local, distance, is_met = _meet(corners[number], origins[line], directions[line], facet)
        hits.append(Hits(line[is_met], number[is_met], distance[is_met], local[is_met]))
    parts = [[getattr(one, name) for one in hits] for name in Hits.__dataclass_fields__]
    return Hits(*(np.concatenate(pieces) for pieces in parts))


def _near(
    corners: FloatArray, origins: FloatArray, directions: FloatArray
) -> Iterator[tuple[IntArray, IntArray]]:
    """Yield lines with facets whose bounding spheres they cross: numbers of both, (m,) each."""
    if not len(corners) or not len(origins):
        return
    centres = corners.mean(axis=1)
    radii = np.linalg.norm(corners - centres[:, None], axis=2).max(axis=1, initial=0.0)
    limit = ((1.0 + 1e-6) * radii) ** 2
    if np.abs(directions - directions[0]).max() < _PARALLEL:
        yield _near_parallel(centres, np.sqrt(limit), origins, directions[0])
        return
    shift = centres.mean(axis=0)
    step = max(1, _MOST_CANDIDATES // max(1, len(corners)))
    for first in range(0, len(origins), step):
        some = slice(first, first + step)
        away = (centres - shift)[None] - (origins[some] - shift)[:, None]  # (s, n, dim)
        along = np.einsum("snd,sd->sn", away, directions[some])
        line, facet = np.nonzero(np.einsum("snd,snd->sn", away, away) - along**2 <= limit)
        yield first + line, facet


def _near_parallel(
    centres: FloatArray, radii: FloatArray, origins: FloatArray, direction: FloatArray
) -> tuple[IntArray, IntArray]:
    """Return parallel lines with facets whose bounding spheres they cross: see `_near`."""
    across = np.linalg.svd(direction[None])[2][1:].T  # (dim, dim - 1), normal to the lines
    at = centres @ across
    places = origins @ across
    neighbours = cKDTree(at).query_ball_point(places, radii.max())
    line = np.repeat(np.arange(len(origins)), [len(candidates) for candidates in neighbours])
    facet = np.fromiter(
        (k for candidates in neighbours for k in candidates), dtype=np.int64, count=line.size
    )
    crosses = np.linalg.norm(at[facet] - places[line], axis=1) <= radii[facet]
    order = np.lexsort([facet[crosses], line[crosses]])
    return line[crosses][order], facet[crosses][order]


def _meet(
    corners: FloatArray, origins: FloatArray, directions: FloatArray, facet: str
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Find where a line meets a facet; return local coordinates, distance, and whether it does.

    Newton's method solves x(local) = origin + distance direction. One step is exact for intervals
    and triangles.
    """
    k, dim = origins.shape
    middle = 1.0 / dim if facet == "triangle" else 0.5
    local = np.full((k, dim - 1), middle)
    distance = np.zeros(k)
    is_met = np.ones(k, dtype=np.bool_)
    for _ in range(_ITERATIONS if facet == "quadrilateral" else 2):
        N, dN = shape_functions(facet, local)
        place = np.einsum("kv,kvi->ki", N, corners)
        tangents = np.einsum("kvi,kvj->kij", corners, dN)
        matrix = np.concatenate([tangents, -directions[..., None]], axis=2)
        size = np.prod(np.linalg.norm(tangents, axis=1), axis=1)
        is_met &= np.abs(np.linalg.det(matrix)) > _PARALLEL * size
        matrix[~is_met] = np.eye(dim)
        residual = origins + distance[:, None] * directions - place
        step = np.linalg.solve(matrix, residual[..., None])[..., 0]
        local = local + np.clip(step[:, :-1], -2.0, 2.0)
        distance = distance + step[:, -1]
        if np.abs(step[is_met, :-1]).max(initial=0.0) < _CONVERGED:
            break
    return local, distance, is_met & (overshoot(facet, local) <= INSIDE)
