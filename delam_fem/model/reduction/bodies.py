"""The bodies of a structure: groups of dofs that M, C and K do not couple, and their modes.

A body is factorised once. The factors give its lowest modes by inverse iteration in a Krylov space
(ARPACK), and the static shapes of its loads.

A body that is not held has a singular stiffness. All is then solved with K + s M: the modes are the
same, and static shapes follow by iteration, see `Body.static`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import LinearOperator, eigsh, splu

from delam_fem.model.operators import Operators
from delam_fem.model.vibration import DENSE_DOFS, lowest
from delam_fem.numerics.arrays import FloatArray, IntArray

Solve = Callable[[FloatArray], FloatArray]
"""Function right sides, shape (n,) or (n, k) -> solutions, same shape."""

PETSC_DOFS = 20_000
"""From here on PETSc's Cholesky factors are used: SuperLU takes several times their memory."""
NOT_HELD = "reduction: a body is not held; support each body"
UNSOLVED = 0.5
"""Difference of strain energy and work, relative to the work, that tells a singular matrix; that
of a thin sheet of solids is up to 1e-2, by round-off."""
NOT_RAYLEIGH = 1e-12
"""Largest entry of C - α M - β K relative to the diagonal of C that is round-off."""
FITS = 4
"""Fits of α and β in turn; each gains some digits."""
CORRECTIONS = 3
"""Iterations for static shapes of a floating body; each gains the factor s/ω² of omitted modes."""


@dataclass(frozen=True)
class Body:
    """One body, with the factors of K + s M.

    Attributes:
        dofs: its dofs, shape (n,).
        mass: M, CSC (n, n).
        damping: C, CSC (n, n).
        stiffness: K, CSC (n, n).
        shift: s [1/s2]; 0: the body is held.
        solve: applies (K + s M)⁻¹.
        rayleigh: α and β, if the operators say them.
    """

    dofs: IntArray
    mass: sp.csc_matrix
    damping: sp.csc_matrix
    stiffness: sp.csc_matrix
    shift: float
    solve: Solve
    rayleigh: tuple[float, float] | None = None

    def modes(self, n: int) -> tuple[FloatArray, FloatArray]:
        """Return ω² [1/s2], increasing, shape (m,), and Φ with Φᵀ M Φ = 1, shape (n_dofs, m).

        Args:
            n: number of modes; m is n, or the number of dofs where there are fewer.
        """
        size = self.dofs.size
        n = min(n, size)
        if size <= DENSE_DOFS or 2 * n > size:
            frequencies, vectors = lowest(
                self.stiffness, self.mass, n, is_floating=self.shift > 0.0
            )
            squares = (2.0 * np.pi * frequencies) ** 2
        else:
            inverse = LinearOperator((size, size), matvec=self.solve, dtype=float)
            squares, vectors = eigsh(
                self.stiffness, n, self.mass, sigma=-self.shift, OPinv=inverse, v0=np.ones(size)
            )
            order = np.argsort(squares)
            squares, vectors = np.maximum(squares[order], 0.0), vectors[:, order]
        masses = np.sqrt(np.einsum("ij,ij->j", vectors, self.mass @ vectors))
        return squares, vectors / (masses * _signs(vectors))

    def static(self, loads: sp.csc_matrix, modes: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the flexibility of all modes to loads, and the shapes of those left out.

            X = R f,   R = Σ φ φᵀ / ω²   over the omitted modes

        X are orthogonal to the kept modes with M and with K. With a shift the sums have ω² + s in
        place of ω²; X ← X_s + s (K + s M)⁻¹ M X, from X = X_s, corrects that.

        Args:
            loads: f, CSC (n_dofs, k).
            modes: the kept modes, shape (n_dofs, m).

        Returns:
            fᵀ(K + s M)⁻¹f of each load, shape (k,) [m/N], and X, shape (n_dofs, k).
        """
        shapes = self.solve(loads.toarray())
        flexibility = np.asarray(loads.T @ shapes).diagonal().copy()
        self._remove(modes, shapes)
        first = shapes
        for _ in range(CORRECTIONS if self.shift else 0):
            shapes = self.solve(self.mass @ shapes)
            self._remove(modes, shapes)
            shapes = first + self.shift * shapes
        return flexibility, shapes

    def damping_of(self, squares: FloatArray, shapes: FloatArray) -> FloatArray:
        """Return VᵀCV, shape (m, m).

        If C = α M + β K, it is the diagonal matrix α + β ω²: the product itself has the round-off
        of the largest stiffness, which hides the damping of the lowest modes.

        Args:
            squares: ω² of the shapes, shape (m,) [1/s2].
            shapes: V, with VᵀMV = 1 and VᵀKV = ω², shape (n_dofs, m).
        """
        C = self.damping
        alpha, beta = self.rayleigh or self._fitted(shapes[:, 0])
        beside = sp.coo_matrix(C - alpha * self.mass - beta * self.stiffness)
        scale = np.sqrt(np.maximum(C.diagonal(), 0.0))
        if (abs(beside.data) <= NOT_RAYLEIGH * scale[beside.row] * scale[beside.col]).all():
            return np.diag(alpha + beta * squares)
        projected = shapes.T @ (C @ shapes)
        return np.asarray(0.5 * (projected + projected.T))

    def _fitted(self, slowest: FloatArray) -> tuple[float, float]:
        """Return α and β for which α M + β K is near C: by its entries, and by the slowest mode.

        Args:
            slowest: φ of the lowest mode, with φᵀMφ = 1, shape (n_dofs,).
        """
        M, C, K = self.mass, self.damping, self.stiffness
        size, alpha, beta = K.multiply(K).sum(), 0.0, 0.0
        for _ in range(FITS):
            beta = float((C - alpha * M).multiply(K).sum() / size)
            alpha = float(slowest @ ((C - beta * K) @ slowest))
        return alpha, beta

    def _remove(self, modes: FloatArray, shapes: FloatArray) -> None:
        """Take the share of the modes out of shapes, in place; twice, because of round-off."""
        dual = self.mass @ modes
        for _ in range(2):
            shapes -= modes @ (dual.T @ shapes)


def bodies(o: Operators, shift: float = 0.0) -> list[Body]:
    """Return the bodies of a structure.

    Args:
        o: the semi-discrete problem.
        shift: s [1/s2], about the square of the lowest elastic angular frequency, if bodies can
            move as rigid bodies; 0: all are held.

    Raises:
        ValueError: a body is not held and there is no shift.
    """
    count, label = connected_components(abs(o.mass) + abs(o.stiffness) + abs(o.damping), False)
    found = []
    for number in range(count):
        dofs = np.flatnonzero(label == number)
        M, C, K = (A[dofs][:, dofs].tocsc() for A in (o.mass, o.damping, o.stiffness))
        A = (K + shift * M).tocsc() if shift else K
        given = None if o.rayleigh is None else [float(values[dofs[0]]) for values in o.rayleigh]
        rayleigh = None if given is None else (given[0], given[1])
        found.append(Body(dofs, M, C, K, shift, _factorised(A), rayleigh))
    return found


def _factorised(A: sp.csc_matrix) -> Solve:
    """Return a function that solves with A, symmetric and positive definite.

    Raises:
        ValueError: A is singular.
    """
    solve = _by_petsc(A) if A.shape[0] >= PETSC_DOFS else None
    if solve is None:
        symmetric = {"SymmetricMode": True}
        try:
            solve = splu(A, "MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=symmetric).solve
        except RuntimeError:
            raise ValueError(NOT_HELD) from None
    ones = np.ones(A.shape[0])
    x = solve(ones)
    work = float(ones @ x)
    if not abs(float(x @ (A @ x)) - work) <= UNSOLVED * work:  # true of NaN, too
        raise ValueError(NOT_HELD)
    return solve


def _by_petsc(A: sp.csc_matrix) -> Solve | None:
    """Return a function that solves with PETSc's Cholesky factors; None: there is no PETSc."""
    try:
        from delam_fem.mpi import MPI

        comm = MPI.COMM_SELF  # the door to MPI comes before PETSc
        from petsc4py import PETSc
    except ImportError:
        return None
    csr = sp.csr_matrix(A)
    index = csr.indptr.astype(PETSc.IntType), csr.indices.astype(PETSc.IntType)
    matrix = PETSc.Mat().createAIJ(csr.shape, csr=(*index, csr.data), comm=comm)
    matrix.setOption(PETSc.Mat.Option.SPD, True)
    solver = PETSc.KSP().create(comm)
    solver.setOperators(matrix)
    solver.setType("preonly")
    solver.getPC().setType("cholesky")
    solver.setUp()
    right, left = matrix.createVecs()

    def solve(b: FloatArray) -> FloatArray:
        columns = b.reshape(len(b), -1)
        result = np.empty_like(columns)
        for k in range(columns.shape[1]):
            right.array[:] = columns[:, k]
            solver.solve(right, left)
            result[:, k] = left.array
        return result.reshape(b.shape)

    return solve


def _signs(vectors: FloatArray) -> FloatArray:
    """Return the signs of the largest entries, so that neighbouring cases have like modes."""
    largest = np.abs(vectors).argmax(axis=0)
    return np.asarray(np.sign(vectors[largest, np.arange(vectors.shape[1])]))
