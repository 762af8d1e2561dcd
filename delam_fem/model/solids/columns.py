"""Displacements relative to one node of each column through the thickness, against round-off.

A cell of a sheet is 10⁸ times and more stiffer through its thickness than the sheet is in bending:
in the displacements of nodes, round-off of that stiffness is as large as a part in 10⁴ of the
bending. All nodes at one place along (and across) a lamina that cells connect form a column; r(i)
is one of them:

    u_i = d_i + d_r(i),   u_r = d_r                                                           (R1)

d_i is a strain of the thickness or a turn of the section, d_r carries the whole column. Then

    K_d = Σ_q w_q (B_q T)ᵀ D (B_q T),   u = T d                                               (R2)

is computed with B_q T, whose derivatives along y vanish for d_r before anything is squared. In
exact arithmetic K_d = Tᵀ K T. Columns are found in cells whose edges are upright; without any, as
in meshes of triangles, T = 1. Nodes that are held keep their displacements.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from delam_fem.model import _dolfinx, distributed
from delam_fem.model.solids.cells import TENSOR, jacobians_of
from delam_fem.model.solids.elasticity import Solid
from delam_fem.mpi import MPI
from delam_fem.numerics.arrays import FloatArray, IntArray

_SAME = 1e-9
"""Share of the extent of the mesh within which nodes and shapes of cells are the same."""
_ROUND_OFF = 1e-12
"""Sums of derivatives below this share of the largest derivative are zero."""
_MOST_ENTRIES = 20_000_000
"""Entries of cells that are summed in one go: a bound for the memory."""


@dataclass(frozen=True)
class Columns:
    """The columns of a solid.

    Attributes:
        solid: the solid.
        reference: r(i) of each global node, i where it has no other one, shape (n_nodes,).
    """

    solid: Solid
    reference: IntArray

    @classmethod
    def of(cls, solid: Solid, held: IntArray) -> Columns:
        """Find the columns (collective).

        Args:
            solid: the solid.
            held: global nodes whose columns keep their displacements.
        """
        n = solid.n_nodes
        pieces = solid.comm.allgather(_links(solid))
        a, b = np.concatenate(pieces, axis=1)
        graph = sp.csr_matrix((np.ones(a.size, dtype=np.int8), (a, b)), shape=(n, n))
        _, column = connected_components(graph, directed=False)
        _, first = np.unique(column, return_index=True)
        reference = first[column]
        is_held = np.isin(column, column[held])
        reference[is_held] = np.flatnonzero(is_held)
        return cls(solid, np.asarray(reference, dtype=np.int64))

    @classmethod
    def none(cls, solid: Solid) -> Columns:
        """Return no columns: T = 1."""
        return cls(solid, np.arange(solid.n_nodes))

    @cached_property
    def is_plain(self) -> bool:
        """Whether T = 1."""
        return bool(np.all(self.reference == np.arange(self.reference.size)))

    @cached_property
    def transformation(self) -> sp.csr_matrix:
        """T of R1, CSR (n_dofs, n_dofs)."""
        dim, n = self.solid.dim, self.reference.size
        own = np.arange(n)
        moved = np.flatnonzero(self.reference != own)
        rows = np.concatenate([own, moved])
        columns = np.concatenate([own, self.reference[moved]])
        of_nodes = sp.csr_matrix((np.ones(rows.size), (rows, columns)), shape=(n, n))
        return sp.kron(of_nodes, sp.identity(dim), format="csr")

    def stiffness(self, young_modulus: FloatArray, poisson: float) -> Any:
        """Assemble K_d of R2, a PETSc matrix that the caller owns (collective).

        Args:
            young_modulus: of each input cell, times the width in 2D, shape (n_cells,).
            poisson: Poisson's ratio.
        """
        if self.is_plain:
            return self.solid.stiffness(young_modulus, poisson)
        n = self.solid.dim * self.solid.n_nodes
        total = sp.csr_matrix((n, n))
        for rows, columns, values in self._entries(
            young_modulus, elasticity(self.solid.dim, poisson)
        ):
            total = total + sp.csr_matrix((values, (rows, columns)), shape=(n, n))
        first = self.solid.dim * self.solid.first_node
        stop = first + self.solid.dim * self.solid.n_own_nodes
        comm = self.solid.comm
        return distributed.matrix(own_rows(total, first, stop, comm), comm)

    def _entries(
        self, young_modulus: FloatArray, D: FloatArray
    ) -> Iterator[tuple[IntArray, IntArray, FloatArray]]:
        """Yield rows, columns and values of the stiffness of this rank's cells, in portions."""
        solid, dim = self.solid, self.solid.dim
        own = solid.input_cell[: solid.n_own_cells]
        nodes = solid.nodes_of(own)
        references = self.reference[nodes]
        corners = solid.mesh.points[solid.mesh.cells[own]]
        for cells in _alike(corners, nodes, references, solid.mesh.points):
            slots, outside = _slots(nodes[cells[0]], references[cells[0]])
            K = _cell_stiffness(solid, corners[cells[0]], slots, D)
            i, j = np.nonzero(K)
            of_slots = np.concatenate([nodes[cells], references[cells][:, outside]], axis=1)
            dofs = (dim * of_slots[:, :, None] + np.arange(dim)).reshape(len(cells), -1)
            step = max(1, _MOST_ENTRIES // max(i.size, 1))
            for first in range(0, len(cells), step):
                some = slice(first, first + step)
                E = young_modulus[own[cells[some]]]
                values = (E[:, None] * K[i, j]).ravel()
                yield dofs[some][:, i].ravel(), dofs[some][:, j].ravel(), values


def elasticity(dim: int, poisson: float) -> FloatArray:
    """Return stresses by strains for E = 1: plane stress in 2D; shear strains are 2 eps_ij.

    Returns:
        Shape (3, 3) for xx, yy, xy, or (6, 6) for xx, yy, zz, xy, xz, yz.
    """
    nu = poisson
    if dim == 2:
        direct = np.array([[1.0, nu], [nu, 1.0]]) / (1.0 - nu**2)
    else:
        direct = (np.eye(3) + nu / (1.0 - 2.0 * nu)) / (1.0 + nu)
    result = np.zeros((3 * dim - 3, 3 * dim - 3))
    result[:dim, :dim] = direct
    shear = np.arange(dim, 3 * dim - 3)
    result[shear, shear] = 0.5 / (1.0 + nu)
    return result


def _links(solid: Solid) -> IntArray:
    """Return pairs of global nodes of the same column, from this rank's cells, shape (2, n)."""
    if solid.mesh.cell not in TENSOR:
        return np.zeros((2, 0), dtype=np.int64)
    local = solid.local_nodes[: solid.n_own_cells]
    along = np.array([axis for axis in range(solid.dim) if axis != 1])
    at = solid.space.tabulate_dof_coordinates()[:, along]
    close = _SAME * np.ptp(solid.mesh.points, axis=0)[along]
    nodes = solid.nodes_of(solid.input_cell[: solid.n_own_cells])
    links = []
    for b in range(1, local.shape[1]):
        for a in range(b):
            is_same = np.all(np.abs(at[local[:, a]] - at[local[:, b]]) <= close, axis=1)
            links.append(nodes[is_same][:, [a, b]])
    return np.asarray(np.concatenate(links).T, dtype=np.int64)


def _alike(
    corners: FloatArray, nodes: IntArray, references: IntArray, points: FloatArray
) -> Iterator[IntArray]:
    """Yield the numbers of cells of the same shape whose columns lie in the same way."""
    if not len(corners):
        return
    extent = np.ptp(points, axis=0)
    shapes = np.round((corners - corners[:, :1]) / (_SAME * extent)).reshape(len(corners), -1)
    first = (references[:, :, None] == references[:, None, :]).argmax(axis=2)
    at_home = (references[:, :, None] == nodes[:, None, :]) @ (1 + np.arange(nodes.shape[1]))
    keys = np.concatenate([shapes.astype(np.int64), first, at_home], axis=1)
    _, kind = np.unique(keys, axis=0, return_inverse=True)
    kind = kind.ravel()
    order = np.argsort(kind, kind="stable")
    yield from np.split(order, np.flatnonzero(np.diff(kind[order])) + 1)


def _slots(nodes: IntArray, references: IntArray) -> tuple[FloatArray, IntArray]:
    """Return how nodes of a cell follow from its slots: its nodes, then references outside it.

    Args:
        nodes: of the cell, shape (n,).
        references: of its nodes, shape (n,).

    Returns:
        1 where a node follows from a slot, shape (n, n_slots); for each reference outside the cell
        the first node that has it.
    """
    others, place = np.unique(references[~np.isin(references, nodes)], return_index=True)
    away = np.flatnonzero(~np.isin(references, nodes))[place]
    every = np.concatenate([nodes, others])
    own = np.eye(nodes.size, every.size)
    return np.maximum(own, (references[:, None] == every[None, :]).astype(np.float64)), away


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
        total: what this rank has, of all rows.
        first: first row of this rank.
        stop: the row after its last.
        comm: communicator whose ranks have the rows in their order.
    """
    if comm.size == 1:
        return sp.csr_matrix(total)
    entries = sp.coo_matrix(total)
    is_own = (entries.row >= first) & (entries.row < stop)
    others = entries.row[~is_own], entries.col[~is_own], entries.data[~is_own]
    result = sp.csr_matrix(total)[first:stop]
    for rows, columns, values in comm.allgather(others):
        own = (rows >= first) & (rows < stop)
        place = rows[own] - first, columns[own]
        result = result + sp.csr_matrix((values[own], place), shape=result.shape)
    return result
