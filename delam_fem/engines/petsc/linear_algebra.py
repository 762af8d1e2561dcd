"""PETSc objects of a stepper: matrices, products, factors, and the compliance of contact pairs.

All vectors of a stepper are the own shares of its rank, sequential PETSc vectors. If the ranks are
not coupled, or there is only one, matrices and factors are sequential too. Otherwise products and
solves copy the shares into distributed vectors and back. The copies cost little beside them.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np
import scipy.sparse as sp
from petsc4py import PETSc

from delam_fem.contact.decisions import NO_BLOCK
from delam_fem.model.operators import DistributedOperators, matrix, with_near_null
from delam_fem.model.sharing import factorise, require_factors
from delam_fem.numerics.types import FloatArray, IntArray
from delam_fem.system.errors import CaseError
from delam_fem.system.mpi import MPI, given_options

LARGE = 20000
"""Entries up to which PETSc's LU factors are the fastest: 800 dofs in plane stress, 240 in 3D."""
PADDED = 1.3
"""Entries of blocks of 2 × 2, the dofs of a node, over those of a matrix, up to which it is stored
in blocks. Their LU factors solve in 3/4 of the time. Cholesky factors of blocks would save another
tenth, but those of PETSc 3.18 are wrong for solids: errors of 100 % at a condition of 1e6."""
WIDE = 12
"""Mean number of entries in a row above which a large matrix is that of a solid; beams have 6."""
ROUND_OFF = 1e-12
"""Largest difference of a symmetric matrix from its transpose, in parts of the largest row sum."""
EXACT = ("lu", "cholesky", "redundant", "svd")
"""Preconditioners of PETSc that solve by themselves; the others take conjugate gradients."""
RESIDUAL, OF_GRADIENTS = 1e-12, 1e-14
"""Relative residuals at which iterative solvers end, and conjugate gradients, which go further. The
energy ledger is open by up to 10⁶ times as much."""
UNSOLVED = 1e-2
"""Relative residual of a trial from which on a solver is refused."""


class Product(Protocol):
    """A square matrix that multiplies own shares of vectors, for example a sequential PETSc one."""

    def mult(self, x: PETSc.Vec, y: PETSc.Vec) -> None:
        """Write B x into y (collective)."""

    def multAdd(self, x: PETSc.Vec, v: PETSc.Vec, y: PETSc.Vec) -> None:
        """Write v + B x into y (collective)."""


def vector_in(memory: FloatArray) -> PETSc.Vec:
    """Return a sequential vector in the memory of an array, which it keeps alive."""
    return PETSc.Vec().createWithArray(memory, comm=PETSc.COMM_SELF)


def new_vector(n: int, values: FloatArray | float = 0.0) -> PETSc.Vec:
    """Return a new sequential vector of n numbers."""
    result = PETSc.Vec().createSeq(n)
    result.array[:] = values
    return result


def block(whole: PETSc.Mat, is_uncoupled: bool) -> PETSc.Mat:
    """Return the matrix of a rank: its own block if no entry couples two ranks, or the whole."""
    return whole.getDiagonalBlock() if is_uncoupled and whole.comm.size > 1 else whole


def product(whole: PETSc.Mat) -> Product:
    """Return the product of a matrix, which must live as long, with own shares of vectors."""
    return whole if whole.comm.size == 1 else SpreadProduct(whole)


def stacked(
    M: PETSc.Mat, C: PETSc.Mat, K: PETSc.Mat, base: PETSc.Mat, ahead: float, inertia: float
) -> PETSc.Mat:
    """Return (K | C + ahead K | inertia M | base), a product that costs less than its parts do.

    Args:
        M: sequential mass.
        C: damping.
        K: stiffness.
        base: further columns.
        ahead: factor of K [s].
        inertia: factor of M.
    """
    of_u, of_v, of_a, of_base = (
        sp.csr_matrix(part.getValuesCSR()[::-1], part.getSize()) for part in (K, C, M, base)
    )
    combined = sp.hstack((of_u, of_v + ahead * of_u, inertia * of_a, of_base), "csr")
    combined.eliminate_zeros()
    return matrix(combined, MPI.COMM_SELF)


class SpreadProduct:
    """The product with a matrix whose rows are spread over the ranks."""

    def __init__(self, whole: PETSc.Mat) -> None:
        """Create vectors for the product.

        Args:
            whole: the matrix, which the caller owns.
        """
        self._whole = whole
        self._in, self._out = (Portion(vector) for vector in whole.createVecs())

    def mult(self, x: PETSc.Vec, y: PETSc.Vec) -> None:
        """Write B x into y (collective)."""
        x.copy(self._in.own)
        self._whole.mult(self._in.vector, self._out.vector)
        self._out.own.copy(y)

    def multAdd(self, x: PETSc.Vec, v: PETSc.Vec, y: PETSc.Vec) -> None:
        """Write v + B x into y (collective)."""
        x.copy(self._in.own)
        self._whole.mult(self._in.vector, self._out.vector)
        v.copy(y)
        y.axpy(1.0, self._out.own)

    def destroy(self) -> None:
        """Free the vectors."""
        self._in.destroy()
        self._out.destroy()


class Portion:
    """A distributed vector and its own share, a sequential vector in the same memory.

    Attributes:
        vector: the distributed vector.
        own: its own share.
    """

    def __init__(self, vector: PETSc.Vec) -> None:
        """Take over a distributed vector, which this object destroys."""
        self.vector = vector
        self.own = vector_in(vector.array)

    def destroy(self) -> None:
        """Free both vectors."""
        self.own.destroy()
        self.vector.destroy()


class PetscFactor:
    """A factorised matrix B; `solve(b, x)` writes x = B⁻¹ b / s for own shares b, x (collective).

    Beams and small solids have narrow bands, for which PETSc's own factors are the fastest, in
    blocks if there are two dofs at a node: 80 dofs take 0.4 µs. Large solids take Cholesky
    factors: CHOLMOD's, or PETSc's own without it. Distributed factors are those of MUMPS. If ranks
    are uncoupled, each one has a serial factor of its own part. Where there are options of PETSc
    with the prefix, its KSP solves as they say, iteratively if they choose a preconditioner that is
    no factor.

    Attributes:
        scale: s. `solve` gives x = B⁻¹ b / s. Steppers choose s such that the solution for a
            residual needs no further scaling.
    """

    def __init__(
        self,
        whole: PETSc.Mat,
        prefix: str,
        scale: float = 1.0,
        like: PETSc.Mat | None = None,
    ) -> None:
        """Factorise the matrix B.

        Args:
            whole: B, which this object scales and destroys.
            prefix: prefix of the PETSc options; it names the owner and ends in `_`.
            scale: s.
            like: matrix whose near-null space B shares, which iterative solvers use; None: none.

        Raises:
            PETSc.Error: the matrix is singular.
            ValueError: a distributed matrix is singular.
            MemoryError: MUMPS has not got the memory for distributed factors.
            CaseError: PETSc refuses the options, or what they choose does not solve.
        """
        self.scale = scale
        self._options = [f"-{name}" for name in given_options(prefix)]
        is_shared = whole.comm.size > 1
        is_banded = not is_shared and not is_wide(whole) and not self._options
        self._matrix = whole
        whole.scale(scale if is_banded else abs(scale))
        is_symmetric = not is_banded and _is_symmetric(whole)
        if is_symmetric:
            whole.setOption(PETSc.Mat.Option.SPD, True)
        elif is_banded:
            _put_in_blocks(whole)
        self._solver = PETSc.KSP().create(whole.comm)
        self._solver.setOptionsPrefix(prefix)
        self._solver.setType(PETSc.KSP.Type.PREONLY)
        self._preconditioner = self._solver.getPC()
        _choose(self._preconditioner, is_symmetric, is_banded)
        self._solver.setOperators(self._matrix)
        self._sides = [Portion(vector) for vector in whole.createVecs()] if is_shared else []
        self._sign = -1.0 if scale < 0.0 and not is_banded else 1.0
        self._factor: PETSc.Mat | None = None
        if self._options:
            self._apply_options(PETSc.Options(prefix), is_symmetric, like)
            self._whole_solve = self._iterate
        else:
            if is_shared:
                require_factors(factorise(self._solver, whole), whole.comm.size)
            else:
                self._solver.setUp()
            self._factor = self._preconditioner.getFactorMatrix()
            self._whole_solve = self._factor.solve
            self._forget()  # a factor is enough
        self.solve = self._whole_solve if is_banded else self._solve

    def _apply_options(
        self, given: PETSc.Options, is_symmetric: bool, like: PETSc.Mat | None
    ) -> None:
        """Set the solver up as options say, and try it on one load (collective)."""
        solver = self._solver
        kinds = PETSc.KSP.Type
        if given.getString("pc_type", EXACT[0]) not in EXACT:
            solver.setType(kinds.CG if is_symmetric else kinds.GMRES)
        solver.setTolerances(rtol=RESIDUAL)
        if given.getString("ksp_type", solver.getType()) == kinds.CG:
            solver.setNormType(PETSc.KSP.NormType.UNPRECONDITIONED)
            solver.setTolerances(rtol=OF_GRADIENTS)
        shapes = like and like.getNearNullSpace()
        if shapes:
            columns = np.array([vector.array_r for vector in shapes.getVecs()])
            with_near_null(self._matrix, columns.T)
        x, b = self._matrix.createVecs()
        b.array[:] = np.cos(np.arange(*b.getOwnershipRange()))
        size = b.norm()
        try:
            solver.setFromOptions()
            solver.setUp()
            solver.setUpOnBlocks()
            self._iterate(b, x)
        except PETSc.Error as error:
            raise self._refused(f"PETSc's error {error.ierr}") from None
        x.scale(-1.0)
        self._matrix.multAdd(x, b, b)
        left = b.norm() / size
        x.destroy()
        b.destroy()
        if not left < UNSOLVED:
            raise self._refused(f"a residual of {left:.2g} of the load")

    def _iterate(self, b: PETSc.Vec, x: PETSc.Vec) -> None:
        """Solve with PETSc's KSP, as options say."""
        self._solver.solve(b, x)
        reason = self._solver.getConvergedReason()
        if reason < 0 and reason != PETSc.KSP.ConvergedReason.DIVERGED_NANORINF:
            count = self._solver.getIterationNumber()
            raise self._refused(f"no solution after {count} iterations (PETSc's reason {reason})")

    def _refused(self, given: str) -> CaseError:
        return CaseError(
            f"PETSC_OPTIONS: {', '.join(self._options)}: expected a solver for the matrix of a "
            f"step, given {given}"
        )

    def _solve(self, b: PETSc.Vec, x: PETSc.Vec) -> None:
        """Write x = B⁻¹ b / s; the factors are those of |s| B, which may be distributed."""
        if self._sides:
            right, left = self._sides
            b.copy(right.own)
            self._whole_solve(right.vector, left.vector)
            left.own.copy(x)
        else:
            self._whole_solve(b, x)
        if self._sign < 0.0:
            x.scale(-1.0)

    def destroy(self) -> None:
        """Free the factor and its matrix; petsc4py defers this if Python collects them instead."""
        for side in self._sides:
            side.destroy()
        if self._factor is not None:
            self._factor.destroy()
        self._forget()

    def _forget(self) -> None:
        """Free the matrix and what the factor came from."""
        self._preconditioner.destroy()
        self._solver.destroy()
        self._matrix.destroy()


def is_wide(whole: PETSc.Mat) -> bool:
    """Return whether a serial matrix is so large and wide that Cholesky factors are faster."""
    return int(whole.getInfo()["nz_used"]) > max(LARGE, WIDE * whole.getSize()[0])


def _is_symmetric(whole: PETSc.Mat) -> bool:
    """Return whether a matrix is symmetric to round-off (collective).

    The products of the matrix and of its transpose with one vector are compared. Entries need not
    be stored on both sides of the diagonal.
    """
    x, image = whole.createVecs()
    transposed = x.duplicate()
    first, last = x.getOwnershipRange()
    x.array[:] = np.cos(np.arange(first, last))
    whole.mult(x, image)
    whole.multTranspose(x, transposed)
    image.axpy(-1.0, transposed)
    largest = float(whole.norm(PETSc.NormType.NORM_INFINITY))
    is_same = float(image.norm(PETSc.NormType.NORM_INFINITY)) <= ROUND_OFF * largest
    for vector in (x, image, transposed):
        vector.destroy()
    return is_same


def _put_in_blocks(whole: PETSc.Mat) -> None:
    """Store a serial matrix in blocks of 2 × 2 if hardly more entries result."""
    n = whole.getSize()[0]
    indptr, columns, values = whole.getValuesCSR()
    rows = sp.csr_matrix((values, columns, indptr), (n, n))
    if n and n % 2 == 0 and rows.tobsr((2, 2)).nnz <= PADDED * rows.nnz:
        whole.setBlockSize(2)
        whole.convert(PETSc.Mat.Type.SEQBAIJ)


def _choose(preconditioner: PETSc.PC, is_symmetric: bool, is_banded: bool) -> None:
    """Choose the kind of a factor, and the package that computes it."""
    kinds = PETSc.PC.Type
    preconditioner.setType(kinds.CHOLESKY if is_symmetric else kinds.LU)
    if preconditioner.comm.size > 1:
        preconditioner.setFactorSolverType("mumps")
    elif is_banded:
        preconditioner.setFactorOrdering("natural")
    elif is_symmetric and PETSc.Sys.hasExternalPackage("suitesparse"):
        preconditioner.setFactorSolverType("cholmod")
    else:
        preconditioner.setFactorOrdering("rcm")  # solids are slender


class RankSums:
    """A few numbers that are sums of what each rank contributes, known to all ranks.

    One collective call brings the contributions to every rank, which adds them in the order of the
    ranks, so that all have the same bits and decide the same. In serial `values` is the memory of
    the contributions, so that gathering costs nothing.

    Attributes:
        own: vector of the own contributions.
        values: the sums, shape (size,).
        total: vector of the sums, in the memory of `values`.
    """

    def __init__(self, size: int, comm: MPI.Intracomm, places: IntArray | None = None) -> None:
        """Create the vectors (collective).

        Args:
            size: number of the numbers.
            comm: communicator of the ranks that contribute.
            places: numbers to which this rank contributes, the only ones that it sends, increasing;
                None: all.
        """
        self._comm = comm
        self._is_alone = comm.size == 1  # asked in every step
        self.own = PETSc.Vec().createSeq(size)
        self._memory: FloatArray = self.own.array
        self.values, self.total = self._memory, self.own
        self._sent = np.arange(size) if places is None else places
        if not self._is_alone:
            every = comm.allgather(self._sent)
            self._counts, self._places = (
                [places_of_rank.size for places_of_rank in every],
                np.concatenate(every),
            )
            self._parts = np.empty(self._places.size)
            self.values = np.zeros(size)
            self.total = vector_in(self.values)

    def gather(self) -> FloatArray:
        """Update `values` from the contributions of all ranks (collective) and return them."""
        if not self._is_alone:
            self._comm.Allgatherv(self._memory[self._sent], [self._parts, self._counts])
            self.values[:] = np.bincount(self._places, self._parts, self.values.size)
        return self.values

    def destroy(self) -> None:
        """Free the PETSc objects."""
        self.total.destroy()
        self.own.destroy()


def added(values: list[float], comm: MPI.Intracomm) -> list[float]:
    """Return numbers summed over the ranks, in their order (collective); in serial as they are."""
    return values if comm.size == 1 else np.sum(comm.allgather(values), axis=0).tolist()


class LazyCompliance:
    """H B^-1 H^T of a factorised matrix B; each column is computed when it is first needed."""

    def __init__(self, n: int, column: Callable[[int], FloatArray]) -> None:
        """Prepare the computation of columns; compute none yet.

        Args:
            n: number of pairs.
            column: function that computes the column of a pair, shape (n,).
        """
        self._column = column
        self._columns = np.empty((0, n))  # one below the other, in the order of their computation
        self._place = np.full(n, -1)
        self._n_known = 0
        self.recent: tuple[IntArray, FloatArray] = NO_BLOCK

    def _require(self, pairs: IntArray) -> None:
        missing = pairs[self._place[pairs] < 0]
        if not missing.size:
            return
        room = self._n_known + missing.size
        if room > len(self._columns):
            more = np.empty((max(room, 2 * self._n_known) - self._n_known, self._place.size))
            self._columns = np.concatenate([self._columns[: self._n_known], more])
        for k in missing.tolist():
            self._columns[self._n_known] = self._column(k)
            self._place[k] = self._n_known
            self._n_known += 1

    def diagonal(self, pairs: IntArray) -> FloatArray:
        """Return the diagonal entries of some pairs, shape (k,)."""
        self._require(pairs)
        return self._columns[self._place[pairs], pairs]

    def block(self, pairs: IntArray) -> FloatArray:
        """Return the rows and columns of some pairs, shape (k, k)."""
        self._require(pairs)
        self.recent = pairs, self._columns[self._place[pairs], pairs[:, None]]
        return self.recent[1]


class LumpedCompliance:
    """H D^-1 H^T of the lumped mass D; pairs of different nodes do not influence one another."""

    recent = NO_BLOCK

    def __init__(self, operators: DistributedOperators) -> None:
        """Compute the matrix, which is sparse (collective)."""
        H, comm = operators.gap_matrix, operators.comm
        compliance = (H @ sp.diags(1.0 / operators.require_lumped_mass()) @ H.T).tocsr()
        self._W = compliance if comm.size == 1 else sum(comm.allgather(compliance), 0 * compliance)
        self._diagonal = self._W.diagonal()

    def diagonal(self, pairs: IntArray) -> FloatArray:
        """Return the diagonal entries of some pairs, shape (k,) [1/kg]."""
        return self._diagonal[pairs]

    def block(self, pairs: IntArray) -> FloatArray:
        """Return the rows and columns of some pairs, shape (k, k) [1/kg]."""
        return np.asarray(self._W[pairs][:, pairs].toarray())
