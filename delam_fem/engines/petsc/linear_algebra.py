"""PETSc objects from CSR matrices: distributed matrices, factors that are kept, shared vectors.

Every rank holds the whole (small) operators; a PETSc matrix holds the rows of its rank. Serial
factors are PETSc's own, which solve 80 dofs in about 1 µs; parallel factors are MUMPS. The code
that creates an object also destroys it.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from petsc4py import PETSc

from delam_fem.numerics.arrays import FloatArray


def matrix(csr: sp.spmatrix, comm: PETSc.Comm) -> PETSc.Mat:
    """Return a CSR matrix as a PETSc matrix whose rows are distributed over `comm`.

    Args:
        csr: the whole matrix, the same on every rank.
        comm: PETSc communicator.
    """
    csr = sp.csr_matrix(csr)
    csr.sort_indices()
    rows, columns = csr.shape
    local, start = _share_of(rows, comm), _first_of(rows, comm)
    mine = csr[start : start + local]
    result = PETSc.Mat().create(comm)
    result.setSizes(((local, rows), (_share_of(columns, comm), columns)))
    result.setType(PETSc.Mat.Type.AIJ)
    index = PETSc.IntType
    result.setPreallocationCSR(
        (mine.indptr.astype(index), mine.indices.astype(index), mine.data.astype(float))
    )
    result.assemble()
    return result


def _share_of(size: int, comm: PETSc.Comm) -> int:
    """Return how many of `size` rows this rank owns (the same split as PETSc's)."""
    return size // comm.size + (1 if comm.rank < size % comm.size else 0)


def _first_of(size: int, comm: PETSc.Comm) -> int:
    """Return the number of the first row that this rank owns, of `size` rows."""
    return comm.rank * (size // comm.size) + min(comm.rank, size % comm.size)


class Factor:
    """A factorised matrix B; `solve(b, x)` is PETSc's MatSolve on preallocated vectors.

    Attributes:
        scale: s. The factor is that of s B, so that `solve` gives x = B⁻¹ b / s. Steppers choose s
            such that the solution for a residual needs no further scaling.
    """

    def __init__(self, csr: sp.spmatrix, comm: PETSc.Comm, prefix: str, scale: float = 1.0) -> None:
        """Factorise s B.

        Args:
            csr: B, the whole square matrix, the same on every rank.
            comm: PETSc communicator.
            prefix: prefix of the PETSc options; it names the owner and ends in `_`.
            scale: s.

        Raises:
            PETSc.Error: the matrix is singular.
        """
        self.scale = scale
        self._matrix = matrix(scale * csr, comm)
        self._solver = PETSc.KSP().create(comm)
        self._solver.setOptionsPrefix(prefix)
        self._solver.setType(PETSc.KSP.Type.PREONLY)
        self._preconditioner = preconditioner = self._solver.getPC()
        preconditioner.setType(PETSc.PC.Type.LU)
        if comm.size > 1:
            preconditioner.setFactorSolverType("mumps")
        else:
            preconditioner.setFactorOrdering("natural")  # the matrix is banded already
        self._solver.setOperators(self._matrix)
        self._solver.setFromOptions()
        self._solver.setUp()
        self._factor = preconditioner.getFactorMatrix()
        self.solve = self._factor.solve

    def destroy(self) -> None:
        """Free the factor and its matrix; petsc4py defers this if Python collects them instead."""
        self._factor.destroy()
        self._preconditioner.destroy()
        self._solver.destroy()
        self._matrix.destroy()


class Shared:
    """A short vector whose entries are all known on every rank.

    In serial `values` is the memory of the vector itself, so that gathering and spreading cost
    nothing.

    Attributes:
        vector: the PETSc vector.
        values: its entries on every rank, shape (size,).
    """

    def __init__(self, vector: PETSc.Vec) -> None:
        """Take over `vector`, which this object destroys."""
        self.vector = vector
        self._local = vector.array
        self._scatter: PETSc.Scatter | None = None
        if vector.comm.size == 1:
            self.values: FloatArray = self._local
        else:
            self._scatter, self._whole = PETSc.Scatter.toAll(vector)
            self.values = np.zeros(vector.getSize())
            self._range = slice(*vector.getOwnershipRange())

    def gather(self) -> FloatArray:
        """Update `values` from the vector (collective) and return them."""
        if self._scatter is not None:
            self._scatter.scatter(self.vector, self._whole)
            self.values[:] = self._whole.array
        return self.values

    def spread(self) -> None:
        """Update the vector from `values`."""
        if self._scatter is not None:
            self._local[:] = self.values[self._range]

    def destroy(self) -> None:
        """Free the PETSc objects."""
        if self._scatter is not None:
            self._scatter.destroy()
            self._whole.destroy()
        self.vector.destroy()
