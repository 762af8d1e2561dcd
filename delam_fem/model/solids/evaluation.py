"""Displacements and their derivatives at points inside the cells of a solid, as sparse rows.

The cell of a point is found on the mesh as it was given (`cells.locate`), so that all ranks find
the same one. The rank that owns the cell evaluates the basis there.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from delam_fem.model.solids.cells import jacobians_of, reference_coordinates
from delam_fem.model.solids.elasticity import Solid
from delam_fem.mpi import MPI
from delam_fem.numerics.arrays import FloatArray, IntArray


@dataclass(frozen=True)
class Evaluation:
    """The basis of a solid's space at points, of those points whose cells this rank owns.

    Attributes:
        n_points: number of points of all ranks.
        n_dofs: number of dofs of all ranks.
        points: numbers of this rank's points, shape (k,).
        nodes: global nodes of their cells, shape (k, n_basis); dof = dim * node + component.
        values: of the basis functions, shape (k, n_basis).
        gradients: their derivatives in x, y, z, shape (k, n_basis, dim) [1/m].
    """

    n_points: int
    n_dofs: int
    points: IntArray
    nodes: IntArray
    values: FloatArray
    gradients: FloatArray

    @property
    def dim(self) -> int:
        """Number of components of the displacement."""
        return int(self.gradients.shape[2])

    def displacement(self, component: int) -> sp.csr_matrix:
        """Return rows for a component of the displacement, shape (n_points, n_dofs)."""
        return self._rows(self.values, component)

    def derivative(self, component: int, direction: int) -> sp.csr_matrix:
        """Return rows for d u_component / d x_direction, shape (n_points, n_dofs)."""
        return self._rows(self.gradients[:, :, direction], component)

    def along(self, directions: FloatArray) -> sp.csr_matrix:
        """Return rows for the displacement along a direction at each point, (n_points, n_dofs).

        Args:
            directions: of all points, shape (n_points, dim).
        """
        return sum(
            (sp.diags(directions[:, i]) @ self.displacement(i) for i in range(1, self.dim)),
            sp.diags(directions[:, 0]) @ self.displacement(0),
        ).tocsr()

    def _rows(self, entries: FloatArray, component: int) -> sp.csr_matrix:
        rows = np.repeat(self.points, self.nodes.shape[1])
        columns = self.dim * self.nodes.ravel() + component
        shape = (self.n_points, self.n_dofs)
        return sp.csr_matrix((entries.ravel(), (rows, columns)), shape=shape)


def evaluate(solid: Solid, points: FloatArray, cells: IntArray) -> Evaluation:
    """Evaluate the basis at points; each rank does so in the cells that it owns.

    Args:
        solid: the solid.
        points: shape (k, dim) [m].
        cells: the input cell in which each point is, see `locate`, shape (k,).
    """
    mesh, own_cells = solid.mesh, solid.input_cell[: solid.n_own_cells]
    local = np.full(len(mesh.cells), -1, dtype=np.int64)
    local[own_cells] = np.arange(own_cells.size)
    own = np.flatnonzero(local[cells] >= 0)
    corners = mesh.points[mesh.cells[cells[own]]]
    X = reference_coordinates(mesh.cell, corners, points[own])
    table = solid.tabulate(1, X) if own.size else np.zeros((1 + mesh.dim, 0, 0))
    inverse = np.linalg.inv(jacobians_of(mesh.cell, corners, X))  # dX_k/dx_j
    gradients = np.einsum("dkb,kdj->kbj", table[1:], inverse)
    nodes = solid.nodes_of(cells[own])[:, : table.shape[2]]
    n_dofs = mesh.dim * solid.n_nodes
    return Evaluation(len(points), n_dofs, own, nodes, table[0], gradients)


def gathered(rows: sp.csr_matrix, comm: MPI.Intracomm) -> sp.csr_matrix:
    """Return the sum of all ranks' rows on every rank (collective), of the same shape."""
    if comm.size == 1:
        return rows
    coo = rows.tocoo()
    data, row, column = (
        np.concatenate(pieces)
        for pieces in zip(*comm.allgather((coo.data, coo.row, coo.col)), strict=True)
    )
    return sp.csr_matrix((data, (row, column)), shape=rows.shape)
