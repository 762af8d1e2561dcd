"""The free dofs of a solid: their order, and matrices restricted to them.

The order follows the bodies one after another, and each body along x, then upwards and across. The
matrices of slender laminae are then narrow bands. On several ranks each one orders its own dofs.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp

from delam_fem.model.solids.columns import Columns, own_rows
from delam_fem.model.solids.elasticity import Solid
from delam_fem.model.solids.supports import SHARED, Held
from delam_fem.numerics.arrays import FloatArray, IntArray

_SAME = 1e-9
"""Share of the extent along an axis within which nodes are at the same place."""


@dataclass(frozen=True)
class Restricted:
    """A matrix restricted to the free dofs (S1 of supports.py).

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
        columns: the columns of the solid, in whose d (R1 of columns.py) the free dofs are.
        held: the held dofs of the solid.
        own: the dof of the solid that each free dof of this rank stands for, shape (n_own,). At a
            pinned end it gives its place to phi.
        first: number of the first free dof of this rank.
        n_free: number of free dofs of all ranks.
        column_of: number of the free dof that stands for each dof in `held.place`, -1: none,
            shape (n_held,).
    """

    columns: Columns
    held: Held
    own: IntArray
    first: int
    n_free: int
    column_of: IntArray

    @classmethod
    def of(cls, solid: Solid, held: Held, columns: Columns | None = None) -> Unknowns:
        """Number the free dofs (collective).

        Args:
            solid: the solid.
            held: its held dofs.
            columns: its columns; None: the free dofs are displacements of nodes.
        """
        dim, comm = solid.dim, solid.comm
        columns = Columns.none(solid) if columns is None else columns
        start = dim * solid.first_node
        every = start + np.arange(dim * solid.n_own_nodes)
        kept = ~np.isin(every, np.setdiff1d(held.dofs, held.place))
        order = _order(solid)
        own = every[order][kept[order]]
        counts = comm.allgather(own.size)
        first = sum(counts[: comm.rank])
        places = np.unique(held.place[held.place >= 0])
        turning = np.flatnonzero(np.isin(own, places))
        number = dict(zip(own[turning].tolist(), (first + turning).tolist(), strict=True))
        everywhere = {d: k for piece in comm.allgather(number) for d, k in piece.items()}
        column_of = np.array([everywhere.get(int(d), -1) for d in held.place], dtype=np.int64)
        return cls(columns, held, own, first, sum(counts), column_of)

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
        low, high = _of_nodes(self.solid, self.solid.mesh.lamina)
        of_nodes = np.where(low == high, low, SHARED)
        of_nodes = self._of_columns(of_nodes)
        result = of_nodes[self.own // self.solid.dim - self.solid.first_node]
        for dof, lamina in {*zip(self.held.place.tolist(), self.held.lamina.tolist(), strict=True)}:
            result[self.own == dof] = lamina
        return np.asarray(result)

    def _of_columns(self, parts: IntArray) -> IntArray:
        """Return SHARED for the references of columns that reach through several laminae."""
        reference, first = self.columns.reference, self.solid.first_node
        if self.columns.is_plain:
            return parts
        everywhere = np.concatenate(self.solid.comm.allgather(parts))
        low, high = everywhere.copy(), everywhere.copy()
        np.minimum.at(low, reference, everywhere)
        np.maximum.at(high, reference, everywhere)
        result = np.where(low == high, everywhere, SHARED)
        return np.asarray(result[first : first + parts.size])

    @property
    def bodies(self) -> IntArray:
        """Number of the separate body of each own free dof, shape (n_own,)."""
        body, _ = _of_nodes(self.solid, self.solid.mesh.bodies)
        return np.asarray(body[self.own // self.solid.dim - self.solid.first_node])

    @cached_property
    def _selection(self) -> sp.csr_matrix:
        """T of S1, the columns of all ranks (collective), CSR (n_dofs, n_free)."""
        own = np.concatenate(self.solid.comm.allgather(self.own))
        plain = np.flatnonzero(~np.isin(own, self.held.place))
        turned = np.flatnonzero(self.column_of >= 0)
        rows = np.concatenate([own[plain], self.held.dofs[turned]])
        columns = np.concatenate([plain, self.column_of[turned]])
        values = np.concatenate([np.ones(plain.size), self.held.turn[turned]])
        return sp.csr_matrix((values, (rows, columns)), shape=(self.n_dofs, self.n_free))

    @cached_property
    def _whole(self) -> sp.csr_matrix:
        """T of R1 times T of S1, the columns of all ranks (collective), CSR (n_dofs, n_free)."""
        if self.columns.is_plain:
            return self._selection
        return sp.csr_matrix(self.columns.transformation @ self._selection)

    @cached_property
    def free(self) -> sp.csr_matrix:
        """T of R1 times T of S1, the columns of this rank, CSR (n_dofs, n_own)."""
        return self._whole[:, self.first : self.first + self.n_own]

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
            is_relative: whether it is one of d (R1 of columns.py) instead.
        """
        T = self._selection if is_relative else self._whole
        start = self.solid.dim * self.solid.first_node
        stop = start + self.solid.dim * self.solid.n_own_nodes
        indptr, indices, data = matrix.getValuesCSR()
        matrix.destroy()
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
        own = values[self.own - start]
        held = self.held
        here = (held.dofs >= start) & (held.dofs < stop)
        at_held = np.zeros(held.dofs.size)
        at_held[here] = values[held.dofs[here] - start]
        if self.solid.comm.size > 1:
            at_held = np.sum(self.solid.comm.allgather(at_held), axis=0)
        for column in np.unique(self.column_of[self.column_of >= 0]).tolist():
            if self.first <= column < self.first + self.n_own:
                turning = self.column_of == column
                own[column - self.first] = held.turn[turning] ** 2 @ at_held[turning]
        columns = self.first + np.arange(self.n_own)
        rows = sp.csr_matrix(
            (own, columns, np.arange(self.n_own + 1)), shape=(self.n_own, self.n_free)
        )
        corners = self._by_lamina(values * self.base[start:stop] ** 2)
        return Restricted(rows, np.zeros(self.n_own), corners)

    def _by_lamina(self, values: FloatArray) -> FloatArray:
        """Return the sum of own dofs' values over each lamina, over all ranks (collective)."""
        low, _ = _of_nodes(self.solid, self.solid.mesh.lamina)
        count = int(self.solid.mesh.lamina.max()) + 1
        own = np.bincount(np.repeat(low, self.solid.dim), values, minlength=count)
        return np.asarray(np.sum(self.solid.comm.allgather(own), axis=0))


def _order(solid: Solid) -> IntArray:
    """Return the order of the dofs of this rank: body, x, y, z, component."""
    body, _ = _of_nodes(solid, solid.mesh.bodies)
    extent = np.maximum(np.ptp(solid.mesh.points, axis=0), np.finfo(np.float64).tiny)
    at = np.round(solid.coordinates / (_SAME * extent))
    nodes = np.lexsort([*at.T[::-1], body])
    dim = solid.dim
    return np.asarray((dim * nodes[:, None] + np.arange(dim)).ravel())


def _of_nodes(solid: Solid, of_cells: IntArray) -> tuple[IntArray, IntArray]:
    """Return the lowest and the highest number of the cells at each own node (collective)."""
    n, ghosts = solid.n_own_nodes, solid.ghost_nodes
    low = np.full(n + ghosts.size, np.iinfo(np.int64).max)
    high = np.full(n + ghosts.size, -1, dtype=np.int64)
    numbers = of_cells[solid.input_cell]
    for nodes in solid.local_nodes.T:
        np.minimum.at(low, nodes, numbers)
        np.maximum.at(high, nodes, numbers)
    for nodes, lowest, highest in solid.comm.allgather((ghosts, low[n:], high[n:])):
        local = nodes - solid.first_node
        own = (local >= 0) & (local < n)
        np.minimum.at(low, local[own], lowest[own])
        np.maximum.at(high, local[own], highest[own])
    return low[:n], high[:n]
