"""The free dofs of a solid: held ends, relative displacements, order.

At held ends dofs follow the base:

    u = T u_free + g q,     M_free = Tᵀ M T,     m_b = Tᵀ M g,     m_aa = gᵀ M g              (S1)

q is the motion of the base along y, g is 1 at the y components of held nodes. At a clamped end all
other components rest. A pinned end stays plane and turns about its neutral axis y_0, as in beam
theory:

    u_n = -(y - y_0) phi,   u_y = q                                                           (S2)

n is the normal of the end in the plane of x and z; what is at right angles to both rests. phi is a
free dof. Laminae that are bonded at the end turn together. In hexahedra each column of nodes has a
phi of its own, as at the simply supported edge of a plate; where two edges meet, columns do not
turn. Inside the span a support holds
the whole section of a lamina: a pinned one u_y alone, a clamped one also against turns,

    u_x = phi,   u_y = q,                                                                     (S3)

where phi is free, as supports of beams hold nothing along x.

Against round-off, displacements are relative to one node of each column through the thickness. A
cell of a sheet is 10⁸ times and more stiffer through its thickness than the sheet is in bending: in
the displacements of nodes, round-off of that stiffness is as large as a part in 10⁴ of the bending.
All nodes at one place along (and across) a lamina that cells connect form a column; r(i) is one of
them:

    u_i = d_i + d_r(i),   u_r = d_r                                                           (R1)

d_i is a strain of the thickness or a turn of the section, d_r carries the whole column. Then

    K_d = Σ_q w_q (B_q T)ᵀ D (B_q T),   u = T d                                               (R2)

is computed with B_q T, whose derivatives along y vanish for d_r before anything is squared. In
exact arithmetic K_d = Tᵀ K T. Columns are found in cells whose edges are upright; without any, as
in meshes of triangles, T = 1. Nodes that are held keep their displacements.

The free dofs are ordered body by body, and in each body along x, then upwards and across. The
matrices of slender laminae are then narrow bands. On several ranks each one orders its own dofs,
and knows their numbers in the order of a single rank. They mean the same there: no choice of a
node depends on the ranks.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from delam_fem.case.definition import Case
from delam_fem.case.sections import ENDS, PointSupport, place_words, z_of
from delam_fem.model import _dolfinx, operators
from delam_fem.model.beams.network import clusters, holds, network, node_at
from delam_fem.model.mesh import NODE_TOLERANCE, edges
from delam_fem.model.solids.forms import SAME, Elasticity, Solid
from delam_fem.model.solids.mesh import TENSOR, SolidMesh, jacobians_of
from delam_fem.numerics.types import FloatArray, IntArray
from delam_fem.system.errors import CaseError
from delam_fem.system.mpi import MPI

X, Y = 0, 1
"""Components along the laminae and of the deflection."""
SHARED = -1
"""Number in place of that of a lamina, for dofs that bonded laminae share."""


@dataclass(frozen=True)
class Held:
    """The held dofs of a solid; all ranks know all of them.

    Attributes:
        dofs: increasing, numbered over all ranks, shape (n,).
        base: g of S1 for each of them, 0 or 1, shape (n,).
        turn: the factor of phi: -(y - y_0) of S2 [m], 1 of S3, shape (n,).
        place: the dof in whose place phi is, for each of them; itself one of `dofs`; -1: none,
            shape (n,).
        lamina: number of the lamina that turns with phi, SHARED where bonded ones do, shape (n,).
        normal: components of n of S2 in x and z, 0 where nothing turns and in S3, shape (n, 2).
    """

    dofs: IntArray
    base: FloatArray
    turn: FloatArray
    place: IntArray
    lamina: IntArray
    normal: FloatArray


def held(case: Case, solid: Solid, rigidity: FloatArray) -> Held:
    """Return the held dofs of a case (collective).

    Args:
        case: gives the supports.
        solid: the solid.
        rigidity: Young's modulus of each cell, times the width in 2D, shape (n_cells,).

    Raises:
        CaseError: an end that is held has no facets.
    """
    blocks = [_at(solid, np.zeros(0, dtype=np.int64))]
    for name in case.support.sides:
        if not case.support.holds(name):
            continue
        facets = solid.mesh.supports.get(name)
        if facets is None or len(facets) == 0:
            raise CaseError(f'support.{name}: the mesh has no facets "{name}" to hold')
        if not case.support.turns(name):
            blocks.append(_at(solid, solid.nodes_on(facets)))
            continue
        for cluster in clusters_of(facets):
            blocks.append(_pinned(solid, name, facets[cluster], rigidity))
    for inner in case.support.held:
        blocks += _inside(case, solid, inner)
    for pin in case.support.pins:
        blocks.append(_at_point(case, solid, pin))
    return _joined(blocks)


def _joined(blocks: Sequence[Held]) -> Held:
    """Return all held dofs; one that is held in two ways does not turn."""
    every = [[getattr(block, name) for block in blocks] for name in Held.__dataclass_fields__]
    all_dofs, *others = (np.concatenate(values) for values in every)
    dofs, first, number = np.unique(all_dofs, return_index=True, return_inverse=True)
    base, turn, place, lamina, normal = (values[first] for values in others)
    differs = (others[1] != turn[number]) | (others[2] != place[number])
    is_rigid = np.isin(place, place[number[differs]]) & (place >= 0)
    is_rigid[number[differs]] = True
    turn[is_rigid] = 0.0
    place[is_rigid] = -1
    return Held(dofs, base, turn, place, lamina, normal)


def _pinned(solid: Solid, name: str, facets: IntArray, rigidity: FloatArray) -> Held:
    """Return the held dofs of facets that are pinned and connected (collective).

    Args:
        solid: the solid.
        name: of the end or edge.
        facets: its facets as vertices, shape (n, m).
        rigidity: see `neutral_axis`.

    Raises:
        CaseError: an edge has cells that are no hexahedra, or is curved. Flat facets would clamp a
            curved edge (I. Babuska, J. Pitkaranta, SIAM J. Math. Anal. 21 (1990) 551).
    """
    mesh = solid.mesh
    axis = neutral_axis(mesh, facets, rigidity)
    cells = mesh.cells_with(facets)[0]
    laminae = np.unique(mesh.lamina[cells])
    one = int(laminae[0]) if laminae.size == 1 else SHARED
    nodes = solid.nodes_on(facets)
    nodes = nodes[np.argsort(solid.place[nodes])]
    if mesh.cell != "hexahedron":
        if name not in ENDS:
            raise CaseError(
                f"support.side: expected hexahedra at the pinned edge {name!r}, given {mesh.cell}s"
            )
        return _at(solid, nodes, axis, one)
    normals = solid.normals_on(facets)
    at = solid.fetched(solid.coordinates, nodes)
    normal = normals[np.searchsorted(normals[:, 0], nodes), 1:]
    # nodes at one place in the plan are a column, which turns as a whole
    plan = np.round(at[:, [X, 2]] / (SAME * np.ptp(mesh.points, axis=0).max()))
    _, first, column = np.unique(plan, axis=0, return_index=True, return_inverse=True)
    column = column.ravel()
    result = _at(solid, nodes, lamina=one)
    lengths = np.linalg.norm(normal[first], axis=1)
    if np.any((lengths >= STRAIGHT) & (lengths < 1.0 - _BENT)):
        raise CaseError(
            f"support.side: expected straight sides at the pinned edge {name!r}, given a curved "
            "one, which flat facets would clamp; give a spring with a large stiffness, or clamp it"
        )
    turns = np.flatnonzero((lengths >= STRAIGHT)[column])
    unit = (normal[first] / np.maximum(lengths, STRAIGHT)[:, None])[column]
    for component, direction in ((X, 0), (2, 1)):
        chosen = solid.dim * turns + component
        result.turn[chosen] = unit[turns, direction] * (axis - at[turns, Y])
        result.place[chosen] = solid.dim * nodes[first[column[turns]]] + X
        result.normal[chosen] = unit[turns]
    return result


_BENT = 1e-9
"""How much shorter than 1 the mean of two unit normals is where an edge is curved."""
STRAIGHT = 0.9
"""Length of the mean of the unit normals at a node of an edge below which a corner is there: they
differ by more than 50 degrees."""


def _inside(case: Case, solid: Solid, support: PointSupport) -> Iterator[Held]:
    """Yield the held dofs of a support inside the span, bonded laminae together (collective).

    Raises:
        CaseError: a mesh from a file has no nodes there.
    """
    lowest, highest = solid.extremes(solid.mesh.lamina)
    position = support.x
    is_there = np.abs(solid.coordinates[:, X] - position) <= NODE_TOLERANCE * case.length
    numbers = solid.first_node + np.flatnonzero(is_there)
    pieces = solid.comm.allgather((numbers, lowest[is_there], highest[is_there]))
    nodes, low, high = (np.concatenate(values) for values in zip(*pieces, strict=True))
    at = edges(case)
    for cluster in clusters(network(case, at).segments, node_at(at, position)):
        if not holds(support, case, cluster):
            continue
        chosen = nodes[(high >= cluster[0]) & (low <= cluster[-1])]
        if not chosen.size:
            raise CaseError(
                f"support.position: expected nodes of the mesh at {position:g} m in lamina "
                f"{case.lamina[cluster[0]].name}; refine it there, or give a spring"
            )
        none = np.full(chosen.size, -1, dtype=np.int64)
        lamina = np.full(chosen.size, cluster[0] if len(cluster) == 1 else SHARED, dtype=np.int64)
        across = solid.dim * chosen + Y
        along = solid.dim * chosen + X
        flat = np.zeros((chosen.size, 2))
        yield Held(across, np.ones(chosen.size), np.zeros(chosen.size), none, lamina, flat)
        if support.kind == "clamped":
            first = np.full(chosen.size, along[np.argmin(solid.place[chosen])])
            yield Held(along, np.zeros(chosen.size), np.ones(chosen.size), first, lamina, flat)


def _at_point(case: Case, solid: Solid, pin: PointSupport) -> Held:
    """Return the held dofs of a pin at a point of a plate (collective).

    It holds the deflection through the thickness of its lamina and of those that are bonded to it
    there, or of a point of its surface.

    Raises:
        CaseError: a mesh from a file has no nodes there.
    """
    lowest, highest = solid.extremes(solid.mesh.lamina)
    place = np.array([pin.x, z_of(pin.position or 0.0)])
    away = np.abs(solid.coordinates[:, [X, 2]] - place).max(axis=1)
    is_there = away <= NODE_TOLERANCE * case.length
    numbers = solid.first_node + np.flatnonzero(is_there)
    local = numbers, lowest[is_there], highest[is_there], solid.coordinates[is_there, Y]
    pieces = solid.comm.allgather(local)
    nodes, low, high, y = (np.concatenate(values) for values in zip(*pieces, strict=True))
    bottom = 0
    top = len(case.lamina) - 1
    chosen = np.ones(nodes.size, dtype=np.bool_)
    if pin.lamina is not None:
        bottom = top = [lamina.name for lamina in case.lamina].index(pin.lamina)
        chosen = (low <= bottom) & (high >= top)
        while chosen.any() and pin.surface not in ("top", "bottom"):
            if (low[chosen].min(), high[chosen].max()) == (bottom, top):
                break
            bottom = int(low[chosen].min())  # nodes that laminae share bond them
            top = int(high[chosen].max())
            chosen = (low <= top) & (high >= bottom)
    if not chosen.any():
        raise CaseError(
            f"support.position: expected nodes of the mesh at {place_words(pin.position)} in the "
            "plate; refine it there, or give a spring"
        )
    if pin.surface in ("top", "bottom"):
        side = 1.0 if pin.surface == "top" else -1.0
        chosen &= side * y == np.max(side * y[chosen])
    held_nodes = nodes[chosen]
    n = held_nodes.size
    lamina = np.full(n, bottom if bottom == top else SHARED, dtype=np.int64)
    none = np.full(n, -1, dtype=np.int64)
    across = solid.dim * held_nodes + Y
    return Held(across, np.ones(n), np.zeros(n), none, lamina, np.zeros((n, 2)))


def neutral_axis(mesh: SolidMesh, facets: IntArray, rigidity: FloatArray) -> float:
    """Return y of the neutral axis of an end, the mean weighted with E dA [m].

    Args:
        mesh: the mesh.
        facets: facets of the end as vertices, shape (n, m).
        rigidity: Young's modulus of each cell, times the width in 2D, shape (n_cells,).
    """
    cells, _ = mesh.cells_with(facets)
    corners = mesh.points[facets]
    if mesh.dim == 2:
        area = np.linalg.norm(corners[:, 1] - corners[:, 0], axis=1)
        middle = corners.mean(axis=1)[:, Y]
    else:
        halves = [corners[:, :3]] + ([corners[:, 1:]] if facets.shape[1] == 4 else [])
        sizes = [
            0.5 * np.linalg.norm(np.cross(h[:, 1] - h[:, 0], h[:, 2] - h[:, 0]), axis=1)
            for h in halves
        ]
        area = np.sum(sizes, axis=0)
        moments = [s * h.mean(axis=1)[:, Y] for s, h in zip(sizes, halves, strict=True)]
        middle = np.sum(moments, axis=0) / area
    weight = rigidity[cells] * area
    return float(weight @ middle / weight.sum())


def clusters_of(facets: IntArray) -> list[IntArray]:
    """Return the numbers of the facets that vertices connect, cluster by cluster."""
    n, m = facets.shape
    touches = sp.csr_matrix((np.ones(n * m), (np.repeat(np.arange(n), m), facets.ravel())))
    count, label = connected_components(touches @ touches.T, directed=False)
    return [np.flatnonzero(label == number) for number in range(count)]


def _at(solid: Solid, nodes: IntArray, axis: float | None = None, lamina: int = SHARED) -> Held:
    """Return the held dofs of nodes: clamped, or pinned if they have a neutral axis."""
    dim = solid.dim
    dofs = (dim * nodes[:, None] + np.arange(dim)).ravel()
    base = np.tile(np.arange(dim) == Y, nodes.size).astype(np.float64)
    turn = np.zeros(dofs.size)
    place = np.full(dofs.size, -1, dtype=np.int64)
    normal = np.zeros((dofs.size, 2))
    if axis is not None:
        turn[X::dim] = axis - solid.fetched(solid.coordinates, nodes)[:, Y]
        place[X::dim] = dim * nodes[np.argmin(solid.place[nodes])] + X
        normal[X::dim, 0] = 1.0
    return Held(dofs, base, turn, place, np.full(dofs.size, lamina, dtype=np.int64), normal)


_ROUND_OFF = 1e-12
"""Sums of derivatives below this share of the largest derivative are zero."""
_MOST_ENTRIES = 4_000_000
"""Entries of cells that are summed in one go: a bound for the memory."""


@dataclass(frozen=True)
class NodeColumns:
    """The columns of nodes through the thickness of a solid (R1 of unknowns.py).

    Attributes:
        solid: the solid.
        reference: r(i) of each global node, i where it has no other one, shape (n_nodes,).
    """

    solid: Solid
    reference: IntArray

    @classmethod
    def of(cls, solid: Solid, held: IntArray) -> NodeColumns:
        """Find the columns (collective).

        Args:
            solid: the solid.
            held: global nodes whose columns keep their displacements.
        """
        n = solid.n_nodes
        a, b = np.concatenate(solid.comm.allgather(_links(solid)), axis=1)
        graph = sp.csr_matrix((np.ones(a.size, dtype=np.int8), (a, b)), shape=(n, n))
        _, column = connected_components(graph, directed=False)
        by_place = np.argsort(solid.place)
        _, first = np.unique(column[by_place], return_index=True)
        reference = by_place[first][column]
        is_held = np.isin(column, column[held])
        reference[is_held] = np.flatnonzero(is_held)
        return cls(solid, np.asarray(reference, dtype=np.int64))

    @classmethod
    def none(cls, solid: Solid) -> NodeColumns:
        """Return the columns of a solid that has none: T = 1."""
        return cls(solid, np.arange(solid.n_nodes))

    @cached_property
    def is_plain(self) -> bool:
        """Whether T = 1."""
        return bool(np.all(self.reference == np.arange(self.reference.size)))

    def transformation(self, nodes: IntArray) -> sp.csr_matrix:
        """Return the rows of T of R1 at some nodes, the others empty, CSR (n_dofs, n_dofs)."""
        dim = self.solid.dim
        n = self.reference.size
        moved = nodes[self.reference[nodes] != nodes]
        rows = np.concatenate([nodes, moved])
        columns = np.concatenate([nodes, self.reference[moved]])
        of_nodes = sp.csr_matrix((np.ones(rows.size), (rows, columns)), shape=(n, n))
        return sp.kron(of_nodes, sp.identity(dim), format="csr")

    def stiffness(self, young_modulus: FloatArray, material: Elasticity) -> Any:
        """Assemble K_d of R2, a PETSc matrix that the caller owns (collective).

        Args:
            young_modulus: of each input cell, times the width in 2D, shape (n_cells,).
            material: of the cells.
        """
        if self.is_plain:
            return self.solid.stiffness(young_modulus, material)
        n = self.solid.dim * self.solid.n_nodes
        sums = [sp.csr_matrix((n, n))]
        for rows, columns, values in self._entries(young_modulus, material):
            total = sp.csr_matrix((values, (rows, columns)), shape=(n, n))
            # as in a binary counter, sums of like size are joined: each entry is added a few times
            while sums and sums[-1].nnz <= total.nnz:
                total = sums.pop() + total
            sums.append(total)
        total = sums.pop()
        while sums:
            total = sums.pop() + total
        first = self.solid.dim * self.solid.first_node
        stop = first + self.solid.dim * self.solid.n_own_nodes
        comm = self.solid.comm
        return operators.matrix(own_rows(total, first, stop, comm), comm)

    def _entries(
        self, young_modulus: FloatArray, material: Elasticity
    ) -> Iterator[tuple[IntArray, IntArray, FloatArray]]:
        """Yield rows, columns and values of the stiffness of this rank's cells, in portions."""
        solid, dim = self.solid, self.solid.dim
        input_cells = solid.input_cell[: solid.n_own_cells]
        nodes = solid.nodes_of(input_cells)
        references = self.reference[nodes]
        corners = solid.mesh.points[solid.mesh.cells[input_cells]]
        kind = material.kind[input_cells]
        for cells in _alike(corners, nodes, references, kind, solid.mesh.points):
            slots, outside = _slots(nodes[cells[0]], references[cells[0]])
            D = material.matrices[kind[cells[0]]]
            K = _cell_stiffness(solid, corners[cells[0]], slots, D)
            i, j = np.nonzero(K)
            of_slots = np.concatenate([nodes[cells], references[cells][:, outside]], axis=1)
            dofs = (dim * of_slots[:, :, None] + np.arange(dim)).reshape(len(cells), -1)
            dofs = dofs.astype(np.int32)
            step = max(1, _MOST_ENTRIES // max(i.size, 1))
            for first in range(0, len(cells), step):
                some = slice(first, first + step)
                E = young_modulus[input_cells[cells[some]]]
                values = (E[:, None] * K[i, j]).ravel()
                yield dofs[some][:, i].ravel(), dofs[some][:, j].ravel(), values


def _links(solid: Solid) -> IntArray:
    """Return pairs of global nodes of the same column, from this rank's cells, shape (2, n)."""
    if solid.mesh.cell not in TENSOR:
        return np.zeros((2, 0), dtype=np.int64)
    local = solid.local_nodes[: solid.n_own_cells]
    along = np.array([axis for axis in range(solid.dim) if axis != 1])
    at = solid.space.tabulate_dof_coordinates()[:, along]
    close = SAME * np.ptp(solid.mesh.points, axis=0)[along]
    nodes = solid.nodes_of(solid.input_cell[: solid.n_own_cells])
    links = []
    for b in range(1, local.shape[1]):
        for a in range(b):
            is_same = np.all(np.abs(at[local[:, a]] - at[local[:, b]]) <= close, axis=1)
            links.append(nodes[is_same][:, [a, b]])
    return np.asarray(np.concatenate(links).T, dtype=np.int64)


def _alike(
    corners: FloatArray, nodes: IntArray, references: IntArray, kind: IntArray, points: FloatArray
) -> Iterator[IntArray]:
    """Yield the numbers of cells of one shape and kind whose columns lie in the same way."""
    if not len(corners):
        return
    extent = np.ptp(points, axis=0)
    # two cells are alike if their material and corners agree, which nodes share a reference, and
    # where in the cell that reference is: tables of whole numbers, one row a cell
    shapes = np.round((corners - corners[:, :1]) / (SAME * extent)).reshape(len(corners), -1)
    first = (references[:, :, None] == references[:, None, :]).argmax(axis=2)
    at_home = (references[:, :, None] == nodes[:, None, :]) @ (1 + np.arange(nodes.shape[1]))
    keys = np.concatenate([shapes.astype(np.int64), first, at_home, kind[:, None]], axis=1)
    _, group = np.unique(keys, axis=0, return_inverse=True)
    group = group.ravel()
    order = np.argsort(group, kind="stable")
    yield from np.split(order, np.flatnonzero(np.diff(group[order])) + 1)


def _slots(nodes: IntArray, references: IntArray) -> tuple[FloatArray, IntArray]:
    """Return how nodes of a cell follow from its slots: its nodes, then references outside it.

    Args:
        nodes: of the cell, shape (n,).
        references: of its nodes, shape (n,).

    Returns:
        1 where a node follows from a slot, shape (n, n_slots); for each reference outside the cell
        the first node that has it.
    """
    outside = np.flatnonzero(~np.isin(references, nodes))
    others, place = np.unique(references[outside], return_index=True)
    is_same = references[:, None] == np.concatenate([nodes, others])
    return np.maximum(np.eye(*is_same.shape), is_same), outside[place]


def _cell_stiffness(
    solid: Solid, corners: FloatArray, slots: FloatArray, D: FloatArray
) -> FloatArray:
    """Return the stiffness of a cell with E = 1 in its slots, shape (dim n_slots, dim n_slots)."""
    dim = solid.dim
    points, weights = _dolfinx.quadrature(solid.mesh.cell, 2 * solid.degree)
    every = np.broadcast_to(corners, (len(points), *corners.shape))
    jacobians = jacobians_of(solid.mesh.cell, every, points)
    derivatives = solid.tabulate(1, points)[1:]  # (dim, n_points, n)
    gradients = np.einsum("kqb,qkj->qbj", derivatives, np.linalg.inv(jacobians))
    largest = np.abs(gradients).max(axis=(0, 1))
    # ∂N_s/∂x_j of slot s is the sum over the nodes that follow from it (B_q T of R2): 0 along y for
    # a reference, but for round-off, which is removed before anything is squared
    sums = np.einsum("qbj,bs->qsj", gradients, slots)
    sums[np.abs(sums) < _ROUND_OFF * largest] = 0.0
    strains = np.zeros((len(points), 3 * dim - 3, slots.shape[1], dim))
    pairs = [(i, j) for i in range(dim) for j in range(i + 1, dim)]
    for i in range(dim):
        strains[:, i, :, i] = sums[:, :, i]
    for row, (i, j) in enumerate(pairs, start=dim):
        strains[:, row, :, i], strains[:, row, :, j] = sums[:, :, j], sums[:, :, i]
    B = strains.reshape(len(points), 3 * dim - 3, -1)
    weighted = weights * np.abs(np.linalg.det(jacobians))
    K = np.einsum("q,qis,ij,qjt->st", weighted, B, D, B, optimize=True)
    return np.asarray(0.5 * (K + K.T))


def own_rows(total: sp.spmatrix, first: int, stop: int, comm: MPI.Intracomm) -> sp.csr_matrix:
    """Return the rows of this rank in the sum of all ranks' matrices (collective).

    What others add comes in the order of the ranks, so that the same work gives the same bits.

    Args:
        total: what this rank contributes to all rows.
        first: first row of this rank.
        stop: the row after its last.
        comm: communicator whose ranks have the rows in their order.
    """
    total = sp.csr_matrix(total)
    if comm.size == 1:
        return total
    ends = [*comm.allgather(first), total.shape[0]]
    others = [total[ends[r] : ends[r + 1]] if r != comm.rank else None for r in range(comm.size)]
    result = total[first:stop]
    for piece in comm.alltoall(others):  # each rank gets its own rows alone
        if piece is not None and piece.nnz:
            result = result + piece
    return result


@dataclass(frozen=True)
class Restricted:
    """A matrix restricted to the free dofs (S1 of unknowns.py).

    Attributes:
        rows: this rank's rows of Tᵀ A T, CSR (n_own, n_free).
        column: this rank's part of Tᵀ A g, shape (n_own,).
        corners: what each lamina contributes to gᵀ A g, known to all ranks, shape (n_laminae,).
    """

    rows: sp.csr_matrix
    column: FloatArray
    corners: FloatArray

    @property
    def corner(self) -> float:
        """The sum gᵀ A g of all laminae."""
        return float(self.corners.sum())


@dataclass(frozen=True)
class Unknowns:
    """The free dofs of this rank and where they are among those of all ranks.

    Attributes:
        columns: the columns of the solid, in whose d (R1 of unknowns.py) the free dofs are.
        held: the held dofs of the solid.
        own: the dof of the solid that each free dof of this rank stands for, shape (n_own,). At a
            pinned end it gives its place to phi.
        order: number of each free dof of this rank on a single rank, increasing, shape (n_own,).
        first: number of the first free dof of this rank.
        n_free: number of free dofs of all ranks.
        column_of: number of the free dof that stands for each dof in `held.place`, -1: none,
            shape (n_held,).
    """

    columns: NodeColumns
    held: Held
    own: IntArray
    order: IntArray
    first: int
    n_free: int
    column_of: IntArray

    @classmethod
    def of(cls, solid: Solid, held: Held, columns: NodeColumns | None = None) -> Unknowns:
        """Number the free dofs (collective).

        Args:
            solid: the solid.
            held: its held dofs.
            columns: its columns; None: the free dofs are displacements of nodes.
        """
        dim, comm = solid.dim, solid.comm
        columns = NodeColumns.none(solid) if columns is None else columns
        every = dim * solid.first_node + np.arange(dim * solid.n_own_nodes)
        is_kept = ~np.isin(every, np.setdiff1d(held.dofs, held.place))
        own_places = solid.place[solid.first_node :][: solid.n_own_nodes]
        places = (dim * own_places[:, None] + np.arange(dim)).ravel()
        order = np.argsort(places)
        local_dofs = every[order][is_kept[order]]
        local_places = places[order][is_kept[order]]
        places_of_ranks = comm.allgather(local_places)
        counts = [each.size for each in places_of_ranks]
        first = sum(counts[: comm.rank])
        order_of_all = np.searchsorted(np.sort(np.concatenate(places_of_ranks)), local_places)
        turning = np.flatnonzero(np.isin(local_dofs, held.place))
        number = dict(zip(local_dofs[turning].tolist(), (first + turning).tolist(), strict=True))
        everywhere = {d: k for piece in comm.allgather(number) for d, k in piece.items()}
        column_of = np.array([everywhere.get(int(d), -1) for d in held.place], dtype=np.int64)
        return cls(columns, held, local_dofs, order_of_all, first, sum(counts), column_of)

    @property
    def solid(self) -> Solid:
        """The solid."""
        return self.columns.solid

    @property
    def n_own(self) -> int:
        """Number of free dofs of this rank."""
        return int(self.own.size)

    @property
    def n_dofs(self) -> int:
        """Number of dofs of the solid, held ones included, of all ranks."""
        return self.solid.dim * self.solid.n_nodes

    @property
    def parts(self) -> IntArray:
        """Number of the lamina of each own free dof, or SHARED, shape (n_own,)."""
        low, high = self.solid.extremes(self.solid.mesh.lamina)
        of_nodes = np.where(low == high, low, SHARED)
        nodes = self.own // self.solid.dim
        result = of_nodes[nodes - self.solid.first_node]
        if not self.columns.is_plain:  # a reference may carry a column through several laminae
            everywhere = np.concatenate(self.solid.comm.allgather(of_nodes))
            low = everywhere.copy()
            high = everywhere.copy()
            np.minimum.at(low, self.columns.reference, everywhere)
            np.maximum.at(high, self.columns.reference, everywhere)
            result = np.where(low == high, everywhere, SHARED)[nodes]
        for dof, lamina in {*zip(self.held.place.tolist(), self.held.lamina.tolist(), strict=True)}:
            result[self.own == dof] = lamina
        return np.asarray(result)

    @property
    def bodies(self) -> IntArray:
        """Number of the body of each own free dof (collective), shape (n_own,)."""
        of_nodes, _ = self.solid.extremes(self.solid.mesh.bodies)
        return np.asarray(of_nodes[self.own // self.solid.dim - self.solid.first_node])

    @property
    def rigid_motions(self) -> FloatArray:
        """Values of the own free dofs in rigid motions (collective), shape (n_own, 3 or 6).

        A dof d_i of R1 has the difference from its reference. phi of S2 is n_x in the rotation in
        the plane of x and y and -n_z in that of y and z; that of S3 is 1 in the translation along
        x. It is 0 in all other motions.
        """
        solid, dim = self.solid, self.solid.dim
        nodes, component = np.divmod(self.own, dim)
        at = solid.coordinates[nodes - solid.first_node]
        reference = self.columns.reference[nodes]
        is_absolute = reference == nodes
        if not self.columns.is_plain:
            there = solid.fetched(solid.coordinates, reference)
            at = at - np.where(is_absolute[:, None], 0.0, there)
        turns = [(X, Y)] if dim == 2 else [(X, Y), (Y, 2), (2, X)]
        result = np.zeros((nodes.size, dim + len(turns)))
        result[np.flatnonzero(is_absolute), component[is_absolute]] = 1.0
        for k, (i, j) in enumerate(turns, start=dim):
            result[:, k] = np.where(component == j, at[:, i], 0.0)
            result[:, k] -= np.where(component == i, at[:, j], 0.0)
        supported = self.held
        turning = np.flatnonzero(supported.place >= 0)
        motions = np.zeros((turning.size, result.shape[1]))
        motions[:, dim] = supported.normal[turning, 0]
        motions[:, X] = ~supported.normal[turning].any(axis=1)
        if dim == 3:
            motions[:, dim + 1] = -supported.normal[turning, 1]
        number = {dof: k for k, dof in enumerate(supported.place[turning].tolist())}
        for row in np.flatnonzero(np.isin(self.own, supported.place[turning])):
            result[row] = motions[number[int(self.own[row])]]
        return result

    @cached_property
    def _numbers(self) -> IntArray:
        """Number of the free dof that each own dof is, -1: none or phi; (n_own_nodes, dim)."""
        solid = self.solid
        result = np.full(solid.dim * solid.n_own_nodes, -1, dtype=np.int64)
        plain = np.flatnonzero(~np.isin(self.own, self.held.place))
        result[self.own[plain] - solid.dim * solid.first_node] = self.first + plain
        return result.reshape(-1, solid.dim)

    def _selection(self, nodes: IntArray, numbers: IntArray) -> sp.csr_matrix:
        """Return the rows of T of S1 at some nodes and at ends that turn, CSR (n_dofs, n_free).

        Args:
            nodes: global nodes, shape (n,).
            numbers: `_numbers` of them, shape (n, dim).
        """
        plain = numbers >= 0
        turned = np.flatnonzero(self.column_of >= 0)
        dofs = self.solid.dim * nodes[:, None] + np.arange(self.solid.dim)
        rows = np.concatenate([dofs[plain], self.held.dofs[turned]])
        columns = np.concatenate([numbers[plain], self.column_of[turned]])
        values = np.concatenate([np.ones(np.count_nonzero(plain)), self.held.turn[turned]])
        return sp.csr_matrix((values, (rows, columns)), shape=(self.n_dofs, self.n_free))

    def _rows(self, nodes: IntArray, *, is_relative: bool) -> sp.csr_matrix:
        """Return the rows of T of S1 at some nodes (collective), CSR (n_dofs, n_free).

        Args:
            nodes: global nodes, increasing, shape (n,).
            is_relative: without T of R1, which stands before it otherwise.
        """
        columns = self.columns
        every = nodes if is_relative else np.union1d(nodes, columns.reference[nodes])
        result = self._selection(every, self.solid.fetched(self._numbers, every))
        if is_relative or columns.is_plain:
            return result
        return sp.csr_matrix(columns.transformation(nodes) @ result)

    @cached_property
    def free(self) -> sp.csr_matrix:
        """The matrix from own free dofs to all dofs, T of R1 times T of S1, CSR (n_dofs, n_own)."""
        first = self.solid.first_node
        reference = self.columns.reference
        nodes = first + np.arange(self.solid.n_own_nodes)
        result = self._selection(nodes, self._numbers)[:, self.first : self.first + self.n_own]
        if self.columns.is_plain:
            return result
        follow = np.flatnonzero((reference >= first) & (reference < first + nodes.size))
        reached = np.unique(np.concatenate([nodes, follow, self.held.dofs // self.solid.dim]))
        return sp.csr_matrix(self.columns.transformation(reached) @ result)

    @cached_property
    def base(self) -> FloatArray:
        """The vector g of S1, shape (n_dofs,)."""
        result = np.zeros(self.n_dofs)
        result[self.held.dofs] = self.held.base
        return result

    def restricted(self, matrix: Any, *, is_relative: bool = False) -> Restricted:
        """Return a PETSc matrix of the solid restricted to the free dofs (collective).

        Args:
            matrix: of the displacements of all nodes; it is destroyed.
            is_relative: whether it is one of d (R1 of unknowns.py) instead.
        """
        start = self.solid.dim * self.solid.first_node
        stop = start + self.solid.dim * self.solid.n_own_nodes
        indptr, indices, data = matrix.getValuesCSR()
        matrix.destroy()
        is_near = np.zeros(self.n_dofs // self.solid.dim, dtype=np.bool_)
        is_near[start // self.solid.dim : stop // self.solid.dim] = True
        is_near[indices // self.solid.dim] = True
        T = self._rows(np.flatnonzero(is_near), is_relative=is_relative)
        A = sp.csr_matrix((data, indices, indptr), shape=(stop - start, self.n_dofs))
        moved = A @ self.base
        transposed = T[start:stop].T.tocsr()
        rows = self._own_rows(transposed @ (A @ T))
        rows.eliminate_zeros()
        column = self._own_rows(transposed @ sp.csr_matrix(moved[:, None]))
        corners = self._by_lamina(self.base[start:stop] * moved)
        return Restricted(rows, column.toarray().ravel(), corners)

    def _own_rows(self, total: sp.spmatrix) -> sp.csr_matrix:
        """Return the rows of own free dofs in the sum of all ranks' matrices (collective)."""
        return own_rows(total, self.first, self.first + self.n_own, self.solid.comm)

    def diagonal(self, values: FloatArray) -> Restricted:
        """Return a diagonal matrix restricted to the free dofs (collective).

        Args:
            values: of the dofs of the solid that this rank owns, shape (dim n_own_nodes,).

        Raises:
            ValueError: there are columns, so that the result is no diagonal.
        """
        if not self.columns.is_plain:
            raise ValueError("diagonal: expected displacements of nodes, given columns")
        start = self.solid.dim * self.solid.first_node
        stop = start + values.size
        entries = values[self.own - start]
        supported = self.held
        here = (supported.dofs >= start) & (supported.dofs < stop)
        at_held = np.zeros(supported.dofs.size)
        at_held[here] = values[supported.dofs[here] - start]
        at_held = np.sum(self.solid.comm.allgather(at_held), axis=0)
        for column in np.unique(self.column_of[self.column_of >= 0]).tolist():
            if self.first <= column < self.first + self.n_own:
                turning = self.column_of == column
                entries[column - self.first] = supported.turn[turning] ** 2 @ at_held[turning]
        columns = self.first + np.arange(self.n_own)
        rows = sp.csr_matrix(
            (entries, columns, np.arange(self.n_own + 1)), shape=(self.n_own, self.n_free)
        )
        corners = self._by_lamina(values * self.base[start:stop] ** 2)
        return Restricted(rows, np.zeros(self.n_own), corners)

    def _by_lamina(self, values: FloatArray) -> FloatArray:
        """Return the sum of own dofs' values over each lamina, over all ranks (collective)."""
        low, _ = self.solid.extremes(self.solid.mesh.lamina)
        count = int(self.solid.mesh.lamina.max()) + 1
        local_sums = np.bincount(np.repeat(low, self.solid.dim), values, minlength=count)
        return np.asarray(np.sum(self.solid.comm.allgather(local_sums), axis=0))
