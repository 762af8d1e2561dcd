"""Contact between the facing surfaces of laminae: pairs by projection, and their pressure.

A pair is a point on the upper surface of the lower lamina, and the place where the normal there
meets the lower surface of the upper lamina. The two meshes need not match. The gap of a pair is
the distance along the normal; its rate is

    n · (u̇(place on the upper lamina) − u̇(point on the lower lamina)),

with n constant: the rotations of contact surfaces are small.

Contact pressure is the force of the pairs, spread over the surfaces on which they act. A pair
shares its force among the vertices of the facet on which it lies, by their linear functions N_v.
The pressure at a vertex is its force over the integral of N_v, and linear between vertices. The
integral of the pressure over the surface is therefore the sum of the forces.

On the structured mesh of a case the pairs are where those of its beams are along x; in 3D each of
them is a row of points across the width, at the vertices. On a mesh from a file they are the
vertices of the lower sides; for tetrahedra they are the middles of the edges there, because a
pressure on a quadratic triangle loads these alone.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import scipy.sparse as sp

from delam_fem.case.definition import Case
from delam_fem.case.sections import Lamina
from delam_fem.model.beams.network import gap_at_rest
from delam_fem.model.layout import Interface, Layout, Part, half_ways, in_order, places_of
from delam_fem.model.solids.forms import Solid, evaluate, gathered
from delam_fem.model.solids.mesh import (
    FACET_OF,
    INSIDE,
    Facing,
    Hits,
    SolidMesh,
    meetings,
    shape_functions,
)
from delam_fem.model.solids.meshing import bonded_cells
from delam_fem.model.solids.unknowns import Unknowns
from delam_fem.numerics.types import BoolArray, FloatArray, IntArray

MANY = 0.2
"""Share of points without an opposite facet above which the user is told."""
_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class FacingPoints:
    """Points on the upper surface of a lower lamina.

    Attributes:
        x: positions, shape (n, dim) [m].
        cells: a cell of the lower lamina in which each point is, shape (n,).
        normals: outward unit normals, shape (n, dim).
        weights: the length (in two dimensions) or area of the surface that belongs to each point,
            shape (n,) [m or m2].
    """

    x: FloatArray
    cells: IntArray
    normals: FloatArray
    weights: FloatArray

    def chosen(self, kept: BoolArray | IntArray) -> FacingPoints:
        """Return some of the points."""
        return FacingPoints(self.x[kept], self.cells[kept], self.normals[kept], self.weights[kept])


@dataclass(frozen=True)
class Pairs:
    """Contact pairs of one interface.

    Attributes:
        facing: the surfaces.
        lower: the points on the lower lamina.
        upper: opposite places on the upper lamina, shape (n, dim) [m].
        cells: the cell of the upper lamina in which each place is, shape (n,).
        gap: distance along the normal, shape (n,) [m]; negative if the surfaces overlap.
    """

    facing: Facing
    lower: FacingPoints
    upper: FloatArray
    cells: IntArray
    gap: FloatArray

    @property
    def x(self) -> FloatArray:
        """Position of each pair along the laminae, shape (n,) [m]."""
        return self.lower.x[:, 0]

    @property
    def plan(self) -> FloatArray:
        """Position of each pair along the laminae and across, shape (n, 2) [m]; in 2D z = 0."""
        across = self.lower.x[:, 2] if self.lower.x.shape[1] == 3 else np.zeros(len(self.gap))
        return np.column_stack([self.x, across])

    @property
    def weights(self) -> FloatArray:
        """Tributary length or area of each pair, shape (n,) [m or m2]."""
        return self.lower.weights

    def chosen(self, kept: BoolArray | IntArray) -> Pairs:
        """Return some of the pairs, for example those that can move."""
        return Pairs(
            self.facing,
            self.lower.chosen(kept),
            self.upper[kept],
            self.cells[kept],
            self.gap[kept],
        )


def at_vertices(mesh: SolidMesh, facing: Facing) -> FacingPoints:
    """Return the vertices of the lower side, by x, then by z.

    Vertices that the upper lamina shares are left out: the laminae are bonded there. A vertex has
    its share of the area of each of its facets; its normal is the mean of theirs, weighted by area.
    """
    cells, _ = mesh.cells_with(facing.lower)
    normals, shares = corner_shares(mesh, facing.lower, cells)
    vertices = facing.lower.reshape(-1, 1)
    of_vertices = np.repeat(cells, facing.lower.shape[1])
    return _summed(mesh, facing, vertices, of_vertices, normals.reshape(-1, mesh.dim), shares)


def at_middles(mesh: SolidMesh, facing: Facing) -> FacingPoints:
    """Return the middle of each facet of the lower side, or of each edge of triangles, by x and z.

    A triangle gives a third of its area to each of its edges. For the pressure between bodies that
    are not thin these points are better than vertices: a force at a vertex of a quadratic cell
    makes a dent of the size of the cell. Along thin laminae vertices are the better choice, because
    the ends have pairs.
    """
    cells, _ = mesh.cells_with(facing.lower)
    vectors, shares = corner_shares(mesh, facing.lower, cells)
    corners = ((0, 1), (1, 2), (0, 2)) if FACET_OF[mesh.cell] == "triangle" else ((0, 1, 2, 3),)
    count = facing.lower.shape[1]
    n = len(corners)
    places = [facing.lower[:, [v for v in chosen if v < count]] for chosen in corners]
    normals = np.tile(vectors.sum(axis=1), (n, 1))
    areas = np.tile(shares.sum(axis=1) / n, n)
    return _summed(mesh, facing, np.concatenate(places), np.tile(cells, n), normals, areas)


def _summed(
    mesh: SolidMesh,
    facing: Facing,
    corners: IntArray,
    cells: IntArray,
    normals: FloatArray,
    shares: FloatArray,
) -> FacingPoints:
    """Return the points of the lower side from what its facets give to each, by x, then by z.

    Points that the upper lamina shares are left out.

    Args:
        mesh: the mesh.
        facing: the sides.
        corners: vertices whose mean the point is, in any order, shape (n, m).
        cells: the cell that gives, shape (n,); of several the first one is that of the point.
        normals: what the cell gives to the normal of the point, shape (n, dim).
        shares: what it gives to the weight of the point, n numbers.
    """
    # cells that share a point have the same sorted vertices; `number` is its place
    facets, number = np.unique(np.sort(corners, axis=1), axis=0, return_inverse=True)
    number = number.ravel()
    normal = np.zeros((len(facets), mesh.dim))
    weight = np.zeros(len(facets))
    np.add.at(normal, number, normals)
    np.add.at(weight, number, shares.ravel())
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    cell = np.full(len(facets), len(mesh.cells))
    np.minimum.at(cell, number, cells)
    points = FacingPoints(mesh.points[facets].mean(axis=1), cell, normal, weight)
    is_apart = ~np.all(np.isin(facets, facing.upper), axis=1)
    order = np.lexsort([*points.x.T[::-1]])
    return points.chosen(order[is_apart[order]])


def at_places(
    mesh: SolidMesh, facing: Facing, x: FloatArray, z: FloatArray | None = None
) -> FacingPoints:
    """Return points on the lower side above given places, in order of x, then of z.

    Weights are half of the distances to the next places or vertices on both sides, along x and
    across, as those of beams are.

    Args:
        mesh: the mesh.
        facing: the sides.
        x: places along the laminae, shape (n,) [m].
        z: places across the width, shape (m,) [m]; None: in two dimensions.

    Raises:
        ValueError: the side does not pass above a place.
    """
    across = np.zeros(1) if z is None else z
    origins = np.zeros((x.size * across.size, mesh.dim))
    origins[:, 0] = np.repeat(x, across.size)
    upwards = np.zeros_like(origins)
    upwards[:, 1] = 1.0
    corners = mesh.points[facing.lower]
    weights = np.repeat(_halves(x, corners[..., 0]), across.size)
    if z is not None:
        origins[:, 2] = np.tile(across, x.size)
        weights = weights * np.tile(_halves(across, corners[..., 2]), x.size)
    hits = meetings(corners, origins, upwards, FACET_OF[mesh.cell])
    first = _first(hits, len(origins), hits.facet)
    if np.any(first < 0):
        at = origins[int(np.flatnonzero(first < 0)[0])]
        raise ValueError(f"facing: expected the lower side above {at}, it does not reach there")
    facet = hits.facet[first]
    local = hits.local[first]
    cells, _ = mesh.cells_with(facing.lower)
    normals, _ = corner_shares(mesh, facing.lower, cells)
    N, _ = shape_functions(FACET_OF[mesh.cell], local)
    normal = np.einsum("kv,kvi->ki", N, _smooth(facing.lower, normals)[facet])
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    return FacingPoints(
        origins + hits.distance[first, None] * upwards, cells[facet], normal, weights
    )


def project(mesh: SolidMesh, facing: Facing, points: FacingPoints) -> Pairs:
    """Return the pairs of points of the lower side with the upper side.

    A point whose normal meets no facet of the upper side that faces it is left out. That is usual
    at the ends of surfaces that do not match. A warning says if many points are left out.

    Args:
        mesh: the mesh.
        facing: the sides.
        points: on the lower side.
    """
    corners = mesh.points[facing.upper]
    cells, _ = mesh.cells_with(facing.upper)
    outward, _ = corner_shares(mesh, facing.upper, cells)
    hits = meetings(corners, points.x, points.normals, FACET_OF[mesh.cell])
    # a facet faces a point if their outward normals are opposed; of several the nearest is taken
    turned = np.einsum("ki,ki->k", outward.sum(axis=1)[hits.facet], points.normals[hits.line])
    distance = np.where(turned < 0.0, np.abs(hits.distance), np.inf)
    first = _first(hits, len(points.x), distance)
    met = np.flatnonzero(first >= 0)
    lost = len(points.x) - met.size
    if lost > MANY * len(points.x):
        _log.warning(
            "contact between the laminae %d and %d: %d of %d points have no facet opposite; they "
            "cannot touch",
            *facing.parts,
            lost,
            len(points.x),
        )
    chosen = first[met]
    gap = hits.distance[chosen]
    lower = points.chosen(met)
    upper = lower.x + gap[:, None] * lower.normals
    return Pairs(facing, lower, upper, cells[hits.facet[chosen]], gap)


def gap_rows(solid: Solid, pairs: Pairs) -> sp.csr_matrix:
    """Return rows that give the gap rates of pairs, this rank's share, shape (n_pairs, n_dofs).

    A pair whose two points are both held has a zero row once the held dofs are left out; such pairs
    must be left out too.
    """
    normals = pairs.lower.normals
    upper = evaluate(solid, pairs.upper, pairs.cells).along(normals)
    lower = evaluate(solid, pairs.lower.x, pairs.lower.cells).along(normals)
    return (upper - lower).tocsr()


def interface(
    parts: Sequence[Part],
    between: tuple[int, int],
    x: FloatArray,
    *,
    at: FloatArray | None = None,
) -> Interface:
    """Return the interface of pairs at given positions; pairs at one position share a station.

    Args:
        parts: all parts, which share their points.
        between: numbers of the lower and the upper part.
        x: positions of the pairs, shape (n,) [m].
        at: x and z of pairs that lie anywhere, shape (n, 2) [m]: each has the station of the
            nearest point of the parts. None: they are in rows.
    """
    place = places_of(parts[between[0]], x)
    place = np.round(place) if at is not None else place
    end = np.ceil(place)
    local = np.where(place == end, 1.0, place - end + 1.0)  # so that differences are of round-off
    name = "-".join(parts[number].name for number in between)
    return Interface(name, between, end - 1.0 + local, at=at)


def _first(hits: Hits, n_lines: int, key: FloatArray | IntArray) -> IntArray:
    """Return the hit with the smallest finite key of each line, or -1, shape (n_lines,)."""
    order = np.lexsort([hits.facet, key, hits.line])
    order = order[np.isfinite(key[order])]
    lines, first = np.unique(hits.line[order], return_index=True)
    result = np.full(n_lines, -1, dtype=np.int64)
    result[lines] = order[first]
    return result


def _halves(at: FloatArray, grid: FloatArray) -> FloatArray:
    """Return half of the distances to the next places of both arrays on both sides [m]."""
    span = float(np.ptp(grid))
    # each place has half of the way to its neighbours, pairs or vertices: a vertex without a pair
    # takes its share away, as it does from the pairs of beams
    every = np.sort(np.concatenate([at, grid.ravel()]))
    every = every[np.concatenate([[True], np.diff(every) > INSIDE * span])]
    behind = np.clip(np.searchsorted(every, at), 1, every.size - 1)
    is_before = at - every[behind - 1] < every[behind] - at
    return np.asarray(half_ways(every)[behind - is_before])


def corner_shares(
    mesh: SolidMesh, facets: IntArray, cells: IntArray
) -> tuple[FloatArray, FloatArray]:
    """Return the share of each facet's area vector (outward) and area that each vertex has.

    The share of vertex v is the integral of its linear function N_v over the facet.

    Args:
        mesh: the mesh.
        facets: as vertices, shape (n, m).
        cells: of which they are facets, shape (n,).

    Returns:
        Vectors, shape (n, m, dim), and areas, shape (n, m) [m or m2].
    """
    corners = mesh.points[facets]
    kind = FACET_OF[mesh.cell]
    places, weights = _quadrature(kind)
    vectors = np.zeros(corners.shape)
    areas = np.zeros(facets.shape)
    for place, weight in zip(places, weights, strict=True):
        N, dN = shape_functions(kind, place[None])
        # ∂x/∂ξ_j = Σ_v x_v ∂N_v/∂ξ_j of every facet k; the normal is as long as dA
        tangents = np.einsum("kvi,vj->kji", corners, dN[0])
        if mesh.dim == 2:
            normal = np.column_stack([tangents[:, 0, 1], -tangents[:, 0, 0]])
        else:
            normal = np.cross(tangents[:, 0], tangents[:, 1])
        vectors += weight * N[0][None, :, None] * normal[:, None, :]
        areas += weight * N[0][None, :] * np.linalg.norm(normal, axis=1)[:, None]
    outward = corners.mean(axis=1) - mesh.points[mesh.cells[cells]].mean(axis=1)
    sign = np.sign(np.einsum("ki,kvi->k", outward, vectors))
    return sign[:, None, None] * vectors, areas


def _quadrature(kind: str) -> tuple[FloatArray, FloatArray]:
    """Return points and weights of Gauss's rule that integrate N_v on a flat facet."""
    if kind == "triangle":
        return np.full((1, 2), 1.0 / 3.0), np.array([0.5])
    at = 0.5 + np.array([-0.5, 0.5]) / np.sqrt(3.0)
    if kind == "interval":
        return at[:, None], np.full(2, 0.5)
    return np.array([(a, b) for a in at for b in at]), np.full(4, 0.25)


def _smooth(facets: IntArray, vectors: FloatArray) -> FloatArray:
    """Return at each vertex of the facets the unit vector along the sum over all its facets.

    Args:
        facets: as vertices, shape (n, m).
        vectors: of each facet at each of its vertices, shape (n, m, dim).

    Returns:
        Unit vectors, shape (n, m, dim).
    """
    vertices, number = np.unique(facets, return_inverse=True)
    total = np.zeros((len(vertices), vectors.shape[-1]))
    number = number.reshape(facets.shape)
    np.add.at(total, number, vectors)
    unit = total / np.linalg.norm(total, axis=1)[:, None]
    return np.asarray(unit[number])


ON_FACET = 1e-9
"""Smallest difference from 1 of a sum of linear functions that is no round-off."""


def pressure(
    mesh: SolidMesh,
    facets: IntArray,
    at: FloatArray,
    normals: FloatArray,
    width: float,
    *,
    places: FloatArray,
    cells: IntArray,
    n: int,
) -> sp.csr_matrix:
    """Return the pressure at the points of cells beside a surface per unit force of each pair.

    It is that of the vertices, linear between them.

    Args:
        mesh: the mesh.
        facets: of the surface, as vertices, shape (k, m).
        at: where the pairs lie on it, shape (n_pairs, dim) [m].
        normals: normals of the pairs, shape (n_pairs, dim).
        width: width of the surface in two dimensions [m]; 1 in three.
        places: reference coordinates of the points of a cell, shape (n_basis, dim).
        cells: points of all cells of the mesh, shape (n_cells, n_basis).
        n: number of points.

    Returns:
        CSR (n, n_pairs) [1/m2]; rows of points beside the surface are empty.

    Raises:
        ValueError: a pair is not on the surface.
    """
    kind = FACET_OF[mesh.cell]
    of_facet = mesh.cells_with(facets)[0]
    hits = meetings(mesh.points[facets], at, normals, kind)
    chosen = _first(hits, len(at), np.abs(hits.distance))
    if np.any(chosen < 0):
        raise ValueError("solid: a contact pair lies on no facet of its surface")
    N, _ = shape_functions(kind, hits.local[chosen])
    vertices, number = np.unique(facets, return_inverse=True)
    number = number.reshape(facets.shape)
    _, shares = corner_shares(mesh, facets, of_facet)
    area = width * np.bincount(number.ravel(), shares.ravel())
    columns = np.repeat(np.arange(len(at)), N.shape[1])
    rows = number[hits.facet[chosen]].ravel()
    forces = sp.csr_matrix((N.ravel(), (rows, columns)), (vertices.size, len(at)))
    N, _ = shape_functions(mesh.cell, places)
    facet_cells = mesh.cells[of_facet]
    # the linear functions of a facet's vertices sum to 1 at points on it, to less within the cell
    is_of_facet = (facet_cells[:, :, None] == facets[:, None, :]).any(axis=2)
    facet, point = np.nonzero(is_of_facet @ N.T > 1.0 - ON_FACET)
    points, first = np.unique(cells[of_facet[facet], point], return_index=True)
    facet = facet[first]
    point = point[first]
    rows = np.repeat(np.arange(points.size), N.shape[1])
    used = (N[point] * is_of_facet[facet]).ravel()
    is_used = np.abs(used) > ON_FACET
    columns = np.searchsorted(vertices, facet_cells[facet].ravel()[is_used])
    to = sp.csr_matrix((used[is_used], (points[rows[is_used]], columns)), shape=(n, vertices.size))
    return sp.csr_matrix(to @ sp.csr_matrix(sp.diags(1.0 / area) @ forces))


_ROUND_OFF = 1e-9
"""Values of basis functions below this are zero but for round-off."""

_OPENINGS = frozenset({"opening", "shape", "file"})
"""Keys of a delamination that say how far it is open at rest."""


def touching(
    case: Case, unknowns: Unknowns, x: FloatArray
) -> tuple[tuple[Pairs, ...], sp.csr_matrix]:
    """Return the pairs that can move, by interface (collective), and the gap matrix.

    Args:
        case: the case.
        unknowns: the free dofs.
        x: positions of the points of the parts, shape (n,) [m].

    Returns:
        The pairs; H of all of them, columns of the own free dofs, CSR (n_pairs, n_own).
    """
    solid = unknowns.solid
    every = []
    H = [sp.csr_matrix((0, unknowns.n_own))]
    for sides in solid.mesh.sides:
        projection = project(solid.mesh, sides, _points(case, solid.mesh, sides, x))
        of_all = gathered(gap_rows(solid, projection), solid.comm)
        of_all.data[np.abs(of_all.data) < _ROUND_OFF] = 0.0
        rows = sp.csr_matrix(of_all @ unknowns.free)
        rows.eliminate_zeros()
        local_sums = np.asarray(abs(rows).sum(axis=1)).ravel()
        moves = (
            np.sum(solid.comm.allgather(local_sums), axis=0) > 0.0
        )  # which pairs any free dof moves
        every.append(projection.chosen(moves))
        H.append(rows[moves])
    return tuple(every), sp.vstack(H, format="csr")


def interfaces(parts: Sequence[Part], every: Sequence[Pairs], case: Case) -> tuple[Interface, ...]:
    """Return the interfaces of all neighbours, whose pairs follow one another.

    As of beams, neighbours that are bonded everywhere have one without pairs.

    Args:
        parts: all parts.
        every: the pairs of each two neighbours that are apart somewhere, from bottom to top.
        case: the case.
    """
    lie_anywhere = case.mesh.file is not None or case.is_plate
    apart = {pairs.facing.parts: (pairs.x, pairs.plan) for pairs in every}
    result = []
    for between in pairwise(range(len(parts))):
        x, plan = apart.get(between, (np.zeros(0), np.zeros((0, 2))))
        result.append(interface(parts, between, x, at=plan if lie_anywhere else None))
    return in_order(result)


def weights(
    case: Case, parts: Sequence[Part], every: Sequence[Pairs], dim: int
) -> FloatArray | None:
    """Return the factors of the springs of all pairs, shape (n_pairs,) [-].

    As for beams, a spring's stiffness holds for a mean element, and each pair has its share of the
    length or, in 3D, of the area. If pairs are at the points of the parts alone, each point has the
    whole stiffness, as in the paper, and its pairs across the width share it. None: every pair has
    the whole stiffness.
    """
    is_structured = case.mesh.file is None and not case.is_plate
    is_whole = case.contact.points_per_element == 1 and is_structured
    if is_whole and dim == 2:
        return None
    result: list[FloatArray] = [np.zeros(0)]
    for pairs in every:
        lower = parts[pairs.facing.parts[0]]
        if is_whole:
            _, row = np.unique(pairs.x, return_inverse=True)
            result.append(pairs.weights / np.bincount(row, pairs.weights)[row])
            continue
        mean = (lower.x[-1] - lower.x[0]) / lower.n_elements
        across = 1.0 if dim == 2 else min(case.lamina[i].mean("width") for i in pairs.facing.parts)
        result.append(pairs.weights / (mean * across))
    return np.concatenate(result)


def gaps(case: Case, layout: Layout, every: Sequence[Pairs]) -> FloatArray:
    """Return the gaps at rest of all pairs, shape (n_pairs,) [m].

    The gaps are those of the case. On a mesh from a file they are the mesh's own at delaminations
    for which the case gives neither an opening nor a shape nor a table.

    Args:
        case: the case.
        layout: the layout, with the interfaces of the pairs.
        every: the pairs of each interface.
    """
    if not every:
        return np.zeros(0)
    result = gap_at_rest(case, layout)
    if case.mesh.file is None or case.gap is not None:
        return result
    for pairs in every:
        interface = layout.interfaces[pairs.facing.parts[0]]
        between = tuple(layout.names[i] for i in interface.parts)
        for open_place in case.delamination:
            if open_place.between == between and not _OPENINGS & open_place.model_fields_set:
                x, z = pairs.plan.T
                is_in = (x >= open_place.start) & (x <= open_place.end)
                if open_place.across is not None:
                    is_in = open_place.contains(x, z)
                result[interface.pairs][is_in] = pairs.gap[is_in]
    return result


def _points(case: Case, mesh: SolidMesh, sides: Facing, x: FloatArray) -> FacingPoints:
    """Return the points of the lower side at which pairs are sought."""
    if case.mesh.file is not None or case.is_plate:
        return (at_middles if mesh.cell == "tetrahedron" else at_vertices)(mesh, sides)
    lower, upper = (case.lamina[i] for i in sides.parts)
    across = None
    if mesh.dim == 3:
        half = 0.5 * min(_least_width(lower), _least_width(upper))
        across = np.linspace(-half, half, case.model.strips + 1)
    bonded = bonded_cells(case, x)[sides.parts[0], :, 0]
    return at_places(mesh, sides, _places(bonded, x, case.contact.points_per_element), across)


def _least_width(lamina: Lamina) -> float:
    """Return the smallest width of a lamina [m]."""
    profile = lamina.profiles.get("width")
    return lamina.mean("width") if profile is None else min(profile.value)


def _places(bonded: BoolArray, x: FloatArray, per_element: int) -> FloatArray:
    """Return the positions of the pairs of beams: within cells that are apart [m].

    Args:
        bonded: whether each cell is bonded, shape (n,).
        x: nodes, shape (n + 1,) [m].
        per_element: number of pairs per cell, at the local coordinates 1/p, 2/p, …, 1.
    """
    touches_bond = np.zeros(x.size, dtype=np.bool_)
    touches_bond[1:] |= bonded
    touches_bond[:-1] |= bonded
    local = np.arange(1, per_element) / per_element
    inside = x[:-1][~bonded, None] + np.diff(x)[~bonded, None] * local
    return np.sort(np.concatenate([x[~touches_bond], inside.ravel()]))
