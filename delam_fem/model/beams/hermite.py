"""Cubic Hermite beams on a mixed P1 × P1 space (u, phi = u'), in UFL.

A P1 field f has the values f - X J f' and f + (1 - X) J f' at the ends of its cell, where X in
[0, 1] is the local coordinate and J the signed Jacobian. The Hermite interpolant of (u, phi) is
therefore an algebraic expression in UFL. It needs no C1 element from the library, and its slopes
are physical on any graded or reversed cell.

Bonded laminae have a third P1 field, the axial displacement.

Nodes keep the numbers that they have in `Hermite.on_line`. In every gathered matrix node j has the
dofs 2 j (u) and 2 j + 1 (phi), however dolfinx and the partitioning number them; with an axial
field, 3 j (u), 3 j + 1 (phi) and 3 j + 2 (axial).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp
import ufl

from delam_fem.model import _dolfinx
from delam_fem.mpi import MPI
from delam_fem.numerics.arrays import FloatArray, IntArray

MASS_DEGREE = 8  # cubic times cubic times a quadratic coefficient
BENDING_DEGREE = 4  # linear times linear times a quadratic coefficient
COEFFICIENT_DEGREE = 2


@dataclass(frozen=True)
class Hermite:
    """A mixed P1 × P1 space and the Hermite interpolant of its functions.

    Attributes:
        comm: communicator of the mesh.
        mesh: dolfinx mesh of intervals.
        space: the space P1 × P1, or P1 × P1 × P1 with an axial field.
        node_of_vertex: input node of each geometry node of this rank.
        cell_of_cell: input cell of each cell of this rank, ghosts included.
        n_fields: number of P1 fields of the space.
    """

    comm: MPI.Intracomm
    mesh: Any
    space: Any
    node_of_vertex: IntArray
    cell_of_cell: IntArray
    n_fields: int = 2

    @classmethod
    def on_line(
        cls, comm: MPI.Intracomm, x: FloatArray, cells: IntArray, *, has_axial: bool = False
    ) -> Hermite:
        """Build the space on intervals, which may form several separate lines.

        Args:
            comm: communicator.
            x: node coordinates, shape (n_nodes,) [m].
            cells: node pairs in any order and direction, shape (n_cells, 2).
            has_axial: whether there is a third P1 field, the axial displacement.
        """
        n_fields = 3 if has_axial else 2
        mesh = _dolfinx.create_interval_mesh(comm, x, cells)
        return cls(
            comm,
            mesh,
            _dolfinx.mixed_space(mesh, n_fields),
            np.asarray(mesh.geometry.input_global_indices, dtype=np.int64),
            np.asarray(mesh.topology.original_cell_index, dtype=np.int64),
            n_fields,
        )

    def _ends(self, field: Any) -> tuple[Any, Any, Any, Any]:
        """Return X, J and the values of a P1 field at the start and end of its cell."""
        J = ufl.Jacobian(self.mesh)[0, 0]
        X = (ufl.SpatialCoordinate(self.mesh)[0] - ufl.geometry.CellVertices(self.mesh)[0, 0]) / J
        return X, J, field - X * J * field.dx(0), field + (1 - X) * J * field.dx(0)

    def value(self, pair: Any) -> Any:
        """Return w, the Hermite interpolant of (u, phi)."""
        X, J, u0, u1 = self._ends(pair[0])
        _, _, p0, p1 = self._ends(pair[1])
        return (
            (1 - 3 * X**2 + 2 * X**3) * u0
            + (X - 2 * X**2 + X**3) * J * p0
            + (3 * X**2 - 2 * X**3) * u1
            + (X**3 - X**2) * J * p1
        )

    def curvature(self, pair: Any) -> Any:
        """Return w'' of the Hermite interpolant of (u, phi); u enters through J u'."""
        X, J, _, _ = self._ends(pair[0])
        _, _, p0, p1 = self._ends(pair[1])
        return ((6 - 12 * X) * pair[0].dx(0) + (6 * X - 4) * p0 + (6 * X - 2) * p1) / J

    def coefficient(self, values: Callable[[IntArray, FloatArray], FloatArray]) -> Any:
        """Return a piecewise quadratic coefficient on the cells.

        Args:
            values: a function (input cells of shape (k,), x of shape (k,)) -> values, shape (k,).
        """
        space = _dolfinx.space(self.mesh, "Discontinuous Lagrange", COEFFICIENT_DEGREE)
        points = space.tabulate_dof_coordinates()[:, 0]
        cells = np.empty(len(points), dtype=np.int64)
        for local, given in enumerate(self.cell_of_cell):
            cells[space.dofmap.cell_dofs(local)] = given

        def fill(array: FloatArray) -> None:
            array[:] = values(cells, points)

        return _dolfinx.function(space, fill)

    def _global_to_input(self) -> IntArray:
        """Return the input dof (n_fields node + component) of each global dof, on every rank."""
        n = self.n_fields
        rows = []
        nodes = _dolfinx.cell_nodes(self.mesh)
        index_map = self.space.dofmap.index_map
        for component in range(n):
            dofmap = self.space.sub(component).dofmap
            for cell, vertices in enumerate(nodes):
                local = dofmap.cell_dofs(cell).astype(np.int32)
                dofs = index_map.local_to_global(local)
                rows.append(np.column_stack([dofs, n * self.node_of_vertex[vertices] + component]))
        mine = np.vstack(rows) if rows else np.empty((0, 2), dtype=np.int64)
        table = np.vstack(self.comm.allgather(mine))
        result = np.empty(index_map.size_global, dtype=np.int64)
        result[table[:, 0]] = table[:, 1]
        return result

    def assemble(self, form: Any) -> sp.csr_matrix:
        """Assemble a bilinear form and gather it on every rank, in the order of the nodes."""
        matrix = _dolfinx.assemble_matrix(form)
        indptr, columns, values = matrix.getValuesCSR()
        first, _ = matrix.getOwnershipRange()
        n = matrix.getSize()[0]
        matrix.destroy()
        rows = np.repeat(np.arange(len(indptr) - 1), np.diff(indptr)) + first
        pieces = self.comm.allgather((rows, columns, values))
        order = self._global_to_input()
        i, j, v = (np.concatenate(piece) for piece in zip(*pieces, strict=True))
        gathered = sp.coo_matrix((v, (order[i], order[j])), shape=(n, n)).tocsr()
        gathered.eliminate_zeros()
        return gathered
