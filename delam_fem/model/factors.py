"""Factorise sparse matrices and find their lowest eigenpairs: the one door to libraries for both.

|                | factors                  | eigenpairs              |
|----------------|--------------------------|-------------------------|
| small          | SuperLU                  | LAPACK, of all dofs     |
| large          | CHOLMOD, through PETSc   | ARPACK with the factors |
| on ranks       | MUMPS, through PETSc     | SLEPc with the factors  |

Without PETSc all factors are SuperLU's. Matrices of PETSc are spread over ranks (`sharing.py`);
vectors are then those of the own dofs.
"""

from __future__ import annotations

import weakref
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy.sparse as sp
from scipy.linalg import eigh
from scipy.sparse.linalg import LinearOperator, eigsh, splu

from delam_fem.model import sharing
from delam_fem.model.operators import matrix, solved, summed, times
from delam_fem.numerics.types import FloatArray

if TYPE_CHECKING:
    from petsc4py import PETSc

Solve = Callable[[FloatArray], FloatArray]
"""Function of right-hand sides, shape (n,) or (n, k), that returns solutions of the same shape."""
LARGE = 20_000
"""Dofs from which on factors are PETSc's: SuperLU takes several times the memory."""
DENSE_DOFS = 400
"""Up to here a dense eigenvalue problem is solved: no iteration, and still below 0.1 s."""
LEAST = 1e-4
"""Least eigenvalue that counts where only those above 0 are sought."""
NOT_HELD = "reduction: a body is not held; support each body"
UNSOLVED = 0.5
"""Difference of strain energy and work, relative to the work, that shows a singular matrix. For a
thin sheet of solids it is up to 1e-2, by round-off."""


@dataclass(frozen=True)
class Factor:
    """Factors of K + s M, symmetric and positive definite.

    Attributes:
        stiffness: K, shape (n, n), of SciPy, or of PETSc on several ranks.
        mass: M, likewise; None: there are no eigenpairs.
        shift: s [1/s2].
        solve: applies (K + s M)⁻¹.
        of_ranks: function of a number of eigenpairs, which ranks find together; None: no ranks.
    """

    stiffness: Any
    mass: Any
    shift: float
    solve: Solve
    of_ranks: Callable[[int], tuple[FloatArray, FloatArray]] | None = None

    def lowest(self, n: int) -> tuple[FloatArray, FloatArray]:
        """Return the n lowest ω² of K φ = ω² M φ, increasing, and φ, shape (n_dofs, n)."""
        if self.of_ranks is None:
            size = self.stiffness.shape[0]
            inverse = LinearOperator((size, size), matvec=self.solve, dtype=float)
            squares, vectors = eigsh(
                self.stiffness, n, self.mass, sigma=-self.shift, OPinv=inverse, v0=np.ones(size)
            )
        else:
            squares, vectors = self.of_ranks(n)
        order = np.argsort(squares)
        return squares[order], vectors[:, order]


def factored(K: Any, M: Any = None, shift: float = 0.0) -> Factor:
    """Factorise K + s M, symmetric and positive definite.

    Args:
        K: stiffness, a matrix of SciPy, or one of PETSc on several ranks (collective).
        M: mass, likewise; None: none is needed.
        shift: s [1/s2].

    Raises:
        ValueError: the matrix is singular.
        MemoryError: the factors need more memory than there is.
    """
    if not sp.issparse(K):
        factor = _by_ranks(K, M, shift)
        ones = np.ones(K.getLocalSize()[0])
    else:
        factor = _by_one(K, M, shift)
        ones = np.ones(K.shape[0])
    x = factor.solve(ones)
    image = times(K, x) if not shift else times(K, x) + shift * times(M, x)
    work, energy = summed(K, np.array([ones @ x, x @ image]))
    if not abs(energy - work) <= UNSOLVED * work:  # true of NaN, too
        raise ValueError(NOT_HELD)
    return factor


def _by_one(K: sp.spmatrix, M: sp.spmatrix | None, shift: float) -> Factor:
    """Return the factors of a single process.

    Raises:
        ValueError: the matrix is singular to the last bit.
    """
    factor = None
    if is_large := K.shape[0] >= LARGE:
        K = _rows(K)
        M = None if M is None else _rows(M)
    A = K if M is None or not shift else K + shift * M
    if is_large:
        factor = _by_petsc(K, M, shift, A)
    if factor is None:
        symmetric = {"SymmetricMode": True}
        A = sp.csc_matrix(A)
        try:
            solve = splu(A, "MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=symmetric).solve
        except RuntimeError:
            raise ValueError(NOT_HELD) from None
        factor = Factor(K, M, shift, solve)
    return factor


def regular(A: sp.spmatrix) -> Callable[[Any], Any]:
    """Return a function that solves with any regular matrix, real or complex, by SuperLU.

    Raises:
        RuntimeError: A is singular to the last bit.
    """
    A = sp.csc_matrix(A)
    ordering = "MMD_AT_PLUS_A" if A.shape[0] >= LARGE else "COLAMD"  # of symmetric patterns
    solve: Callable[[Any], Any] = splu(A, ordering).solve
    return solve


def largest(A: Any, B: Any, factor: Factor | None = None) -> float:
    """Return the largest λ of A φ = λ B φ, with A symmetric and B positive definite.

    Args:
        A: shape (n, n), of SciPy, or of PETSc on several ranks (collective).
        B: shape (n, n), likewise.
        factor: factors of B, if there are any; None: they are computed where they are needed. On
            several ranks SLEPc has its own.
    """
    if not sp.issparse(B):
        return sharing.largest(A, B)
    n = B.shape[0]
    if n <= DENSE_DOFS:
        last = (n - 1, n - 1)
        return float(eigh(A.toarray(), B.toarray(), eigvals_only=True, subset_by_index=last)[0])
    inverse = LinearOperator((n, n), matvec=(factor or factored(B)).solve, dtype=float)
    (result,) = eigsh(A, 1, B, Minv=inverse, which="LA", return_eigenvectors=False, v0=np.ones(n))
    return float(result)


def largest_above_zero(A: Any, B: Any, factor: Factor | None) -> float:
    """Return the largest λ of A φ = λ B φ, or 0 where it is below `LEAST`.

    Eigenvalues that crowd just below 0 would not converge: whether there are others is counted by
    the signs of the pivots of B - A / `LEAST` (Sylvester's law of inertia).

    Args:
        A: symmetric, shape (n, n), of SciPy, or of PETSc on several ranks (collective).
        B: positive definite, shape (n, n), likewise.
        factor: factors of B; None: there are none yet.
    """
    if not sp.issparse(B):
        shifted = B.copy()
        shifted.axpy(-1.0 / LEAST, A)
        if sharing.is_positive_definite(shifted):
            return 0.0
    elif B.shape[0] > DENSE_DOFS:
        symmetric = {"SymmetricMode": True}
        shifted = sp.csc_matrix(B - A / LEAST)
        pivots = splu(shifted, "MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=symmetric).U
        if pivots.diagonal().min() > 0.0:
            return 0.0
    result = largest(A, B, factor)
    return result if result > LEAST else 0.0


def _rows(A: sp.spmatrix) -> sp.csr_matrix:
    """Return a symmetric matrix by rows, without a copy where its columns are stored."""
    by_rows = A.T if A.format == "csc" else sp.csr_matrix(A)
    by_rows.sort_indices()
    return by_rows


def _by_ranks(K: PETSc.Mat, M: PETSc.Mat | None, shift: float) -> Factor:
    """Return factors of MUMPS (collective).

    Raises:
        ValueError: the matrix is singular.
    """
    try:
        share = sharing.Share(K, M, shift)
    except ValueError:
        raise ValueError(NOT_HELD) from None

    def solve(b: FloatArray) -> FloatArray:
        return share.solve(b)

    weakref.finalize(solve, share.destroy).atexit = False
    return Factor(K, M, shift, solve, share.lowest)


def _by_petsc(
    K: sp.csr_matrix, M: sp.csr_matrix | None, shift: float, A: sp.csr_matrix
) -> Factor | None:
    """Return PETSc's Cholesky factors of A = K + s M; None: there is no PETSc."""
    try:
        from delam_fem.system.mpi import MPI

        comm = MPI.COMM_SELF  # the door to MPI comes before PETSc
        from petsc4py import PETSc
    except ImportError:
        return None
    operator = matrix(A, comm)
    operator.setOption(PETSc.Mat.Option.SPD, True)
    solver = PETSc.KSP().create(comm)
    solver.setOperators(operator)
    solver.setType("preonly")
    solver.getPC().setType("cholesky")
    if PETSc.Sys.hasExternalPackage("suitesparse"):
        solver.getPC().setFactorSolverType("cholmod")
    solver.setUp()
    factors = solver.getPC().getFactorMatrix()

    def solve(b: FloatArray) -> FloatArray:
        return solved(factors, b)

    def destroy() -> None:
        for handle in (factors, solver, operator):
            handle.destroy()

    # PETSc's memory is free as soon as nobody solves any more, and not when Python's collector runs
    weakref.finalize(solve, destroy).atexit = False
    return Factor(K, M, shift, solve)
