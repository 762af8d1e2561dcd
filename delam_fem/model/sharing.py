"""Share factors and eigenpairs among the ranks of MPI, while the first rank does all other work.

The first rank assembles, reads and writes. It hands the rows of a matrix to all ranks, which
factorise it together (MUMPS) and find its eigenpairs together (SLEPc). Between such orders the
others wait, without keeping a core busy. So whatever the first rank computes with the factors of
`factors.py` is shared, an error is its error alone, and only it writes to a folder.
"""

from __future__ import annotations

import time
import traceback
from collections.abc import Callable, Iterator
from itertools import pairwise
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
import scipy.sparse as sp

from delam_fem.model.operators import matrix
from delam_fem.numerics.types import FloatArray
from delam_fem.system.mpi import hold, release, slepc, start_petsc

if TYPE_CHECKING:
    from petsc4py import PETSc

    from delam_fem.system.mpi import MPI

_T = TypeVar("_T")

LOOK = 0.02
"""Longest time between two looks for an order [s]; at first it is a tenth of the time waited."""
RESIDUAL = 1e-13
"""Relative residual at which SLEPc takes an eigenpair."""
MOST_LOADS = 64
"""Largest number of loads that are solved for at once: their solutions fill memory."""
SINGULAR = (-6, -10)
"""Values of MUMPS's INFOG(1) that say that a matrix is singular."""
TOO_SMALL = (-8, -9)
"""Values of MUMPS's INFOG(1) that say that its workspace is smaller than what the factors need."""
WORKSPACE = (100, 300, 1000)
"""Workspace beyond MUMPS's estimate that is tried in turn where that was too small [%]."""


def factorise(solver: PETSc.KSP, like: PETSc.Mat, eigenpairs: Any = None) -> int:
    """Set up a solver whose factors are those of MUMPS; return its INFOG(1) (collective).

    MUMPS estimates its workspace from the pattern of the matrix; with a few rows that couple many
    dofs, as of a spring at a lamina, it may need more. Below 0 there are no factors.

    Args:
        solver: the solver.
        like: a matrix with the pattern of the one to be factorised.
        eigenpairs: solver of SLEPc that makes this matrix; None: `solver` has it.
    """
    from petsc4py import PETSc

    preconditioner = solver.getPC()
    status = 0
    for more in (0, *WORKSPACE):
        if more:  # PETSc never tries factors again that have failed
            solver.reset()
            solver.setOperators(like)
            preconditioner.setFactorSetUpSolverType()
            preconditioner.getFactorMatrix().setMumpsIcntl(14, more)
        try:
            (eigenpairs or solver).setUp()
        except PETSc.Error:
            status = int(preconditioner.getFactorMatrix().getMumpsInfog(1))
            if status >= 0:
                raise
        else:
            status = int(preconditioner.getFactorMatrix().getMumpsInfog(1))
        if status not in TOO_SMALL:
            break
    return status


def require_factors(status: int, size: int) -> None:
    """Refuse to go on without factors.

    Args:
        status: what `factorise` returns.
        size: number of ranks.

    Raises:
        ValueError: the matrix is singular.
        MemoryError: the factors need more memory than there is.
    """
    if status in SINGULAR:
        raise ValueError("the matrix is singular")
    if status < 0:
        raise MemoryError(f"MUMPS on {size} ranks, INFOG(1) = {status}")


class Share:
    """What one rank has of the factors of K + s M, all calls of which are collective.

    Attributes:
        sizes: number of rows of each rank.
        status: MUMPS's INFOG(1); below 0 there are no factors.
    """

    def __init__(
        self, comm: MPI.Intracomm, K: sp.csr_matrix, M: sp.csr_matrix | None, shift: float
    ) -> None:
        """Factorise K + s M.

        Args:
            comm: communicator whose ranks have the rows in their order.
            K: own rows of K.
            M: own rows of M; None: there are no eigenpairs, and s is 0.
            shift: s [1/s2].
        """
        from petsc4py import PETSc

        library = slepc()
        self._comm, self.sizes = comm, comm.allgather(K.shape[0])
        self._matrices = [matrix(K, comm)]
        if M is not None and library is not None:
            self._matrices.append(matrix(M, comm))
            self._eigenpairs = library.EPS().create(comm)
            self._eigenpairs.setOperators(*self._matrices)
            self._eigenpairs.setProblemType(library.EPS.ProblemType.GHEP)
            self._eigenpairs.setTarget(-shift)
            self._eigenpairs.setWhichEigenpairs(library.EPS.Which.TARGET_MAGNITUDE)
            self._eigenpairs.setTolerances(RESIDUAL)
            transformation = self._eigenpairs.getST()
            transformation.setType(library.ST.Type.SINVERT)
            transformation.setShift(-shift)
            self._solver = transformation.getKSP()
        else:
            self._eigenpairs = None
            self._solver = PETSc.KSP().create(comm)
            if M is not None:
                self._matrices = [matrix(sp.csr_matrix(K + shift * M), comm)]
            self._solver.setOperators(self._matrices[0])
        self._solver.setType(PETSc.KSP.Type.PREONLY)
        preconditioner = self._solver.getPC()
        preconditioner.setType(PETSc.PC.Type.CHOLESKY)
        preconditioner.setFactorSolverType("mumps")
        self.status = factorise(self._solver, self._matrices[0], self._eigenpairs)
        self._factor = preconditioner.getFactorMatrix()
        self._vector = self._matrices[0].createVecRight()

    def solve(self, count: int, loads: FloatArray | None) -> FloatArray | None:
        """Return solutions for loads, one below the other, on the first rank, which has the loads.

        Args:
            count: number of loads.
            loads: the loads, shape (count, n); None on the other ranks.
        """
        from petsc4py import PETSc

        comm = self._comm
        size = (self.sizes[comm.rank], sum(self.sizes))
        solutions = None if loads is None else np.empty_like(loads)
        right, left = (PETSc.Mat().createDense((size, count), comm=comm) for _ in range(2))
        share = np.empty((count, size[0]))  # a dense matrix of PETSc has column after column
        for k in range(count):
            comm.Scatterv(None if loads is None else self._spread(loads[k]), share[k])
        for dense in (right, left):
            dense.setUp()
        right.getDenseArray()[:] = share.T
        right.assemble()
        left.assemble()
        self._factor.matSolve(right, left)
        share[:] = left.getDenseArray().T
        for k in range(count):
            comm.Gatherv(share[k], None if solutions is None else self._spread(solutions[k]))
        right.destroy()
        left.destroy()
        return solutions

    def _spread(self, values: FloatArray) -> list[Any]:
        """Return an array of all dofs as MPI takes what it deals out or collects."""
        from delam_fem.system.mpi import MPI

        return [values, self.sizes, None, MPI.DOUBLE]

    @property
    def has_eigenpairs(self) -> bool:
        """Whether `lowest` can be had: it needs M, and SLEPc."""
        return self._eigenpairs is not None

    def lowest(self, n: int) -> tuple[FloatArray, FloatArray | None]:
        """Return the eigenvalues of K φ = ω² M φ nearest to -s, and φ on the first rank.

        Args:
            n: number of eigenpairs.

        Raises:
            RuntimeError: they were not found.
        """
        solver, comm = self._eigenpairs, self._comm
        solver.setDimensions(n)
        solver.solve()
        if solver.getConverged() < n:
            raise RuntimeError(f"SLEPc found {solver.getConverged()} of {n} eigenpairs")
        is_first = comm.rank == 0
        vectors = np.empty((n, sum(self.sizes))) if is_first else None
        for k in range(n):
            solver.getEigenvector(k, self._vector)
            comm.Gatherv(
                self._vector.array_r, None if vectors is None else self._spread(vectors[k])
            )
        squares = np.array([solver.getEigenvalue(k).real for k in range(n)])
        return squares, None if vectors is None else vectors.T

    def destroy(self) -> None:
        """Free the factors."""
        (self._eigenpairs or self._solver).destroy()
        for each in (self._vector, *self._matrices):
            each.destroy()


class Ranks:
    """The ranks that share factors. The first one orders, and takes part in what it orders.

    Attributes:
        comm: their communicator.
        is_busy: whether an order has begun and not ended; others may then wait forever.
    """

    def __init__(self, comm: MPI.Intracomm) -> None:
        """Begin without any factors."""
        self.comm = comm
        self.is_busy = False
        self._shares: dict[int, Share] = {}
        self._n_factors = 0
        self._unused: list[int] = []

    def factored(self, K: sp.csr_matrix, M: sp.csr_matrix | None, shift: float) -> int:
        """Factorise K + s M and return the number of the factors.

        Raises:
            ValueError: the matrix is singular.
            MemoryError: the factors need more memory than there is.
        """
        self._n_factors += 1
        number = self._n_factors
        size = self.comm.size
        ends = [K.shape[0] * rank // size for rank in range(size + 1)]
        pieces = (
            (K[first:last], None if M is None else M[first:last]) for first, last in pairwise(ends)
        )
        status = self._together("_factor", number, shift, of_first=pieces)
        require_factors(status, size)
        return number

    def solve(self, number: int, b: FloatArray) -> FloatArray:
        """Return the solution for loads, shape (n,) or (n, k)."""
        columns = np.ascontiguousarray(b.reshape(len(b), -1).T, dtype=np.float64)
        blocks = (columns[k : k + MOST_LOADS] for k in range(0, len(columns), MOST_LOADS))
        solutions = [
            self._together("_solve", number, len(block), of_first=block) for block in blocks
        ]
        return np.asarray(np.concatenate([columns[:0], *solutions]).T.reshape(b.shape))

    def has_eigenpairs(self, number: int) -> bool:
        """Return whether SLEPc finds eigenpairs with some factors."""
        return self._shares[number].has_eigenpairs

    def lowest(self, number: int, n: int) -> tuple[FloatArray, FloatArray]:
        """Return n eigenpairs; see `Share.lowest`."""
        pairs: tuple[FloatArray, FloatArray] = self._together("_lowest", number, n)
        return pairs

    def forget(self, number: int) -> None:
        """Free factors with the next order."""
        self._unused.append(number)

    def end(self) -> None:
        """Free all factors, and let the other ranks go."""
        self._together("_end")

    def obey(self) -> None:
        """Take part in what the first rank orders, until it ends."""
        name = ""
        while name != "_end":
            request = self.comm.Ibarrier()
            begin = time.monotonic()
            while not request.Test():
                time.sleep(min(LOOK, 0.1 * (time.monotonic() - begin)))
            name, arguments = self.comm.bcast(None)
            try:
                getattr(self, name)(*arguments)
            except BaseException:
                traceback.print_exc()
                self.comm.Abort(1)

    def _together(self, name: str, *arguments: Any, of_first: Any = None) -> Any:
        """Do something on all ranks; the first one, which calls, has further data."""
        self.is_busy = True
        unused = self._unused
        self._unused = []
        if unused:
            self._order("_forget", unused)
            self._forget(unused)
        self._order(name, *arguments)
        further = () if of_first is None else (of_first,)
        result = getattr(self, name)(*arguments, *further)
        self.is_busy = False
        return result

    def _order(self, name: str, *arguments: Any) -> None:
        """Tell the other ranks what to take part in."""
        self.comm.Ibarrier().Wait()
        self.comm.bcast((name, arguments))

    def _factor(self, number: int, shift: float, pieces: Iterator[Any] | None = None) -> int:
        """Factorise what the first rank hands out, piece by piece; return MUMPS's status."""
        if pieces is None:
            K, M = self.comm.recv(source=0)
        else:
            K, M = next(pieces)
            for rank, piece in enumerate(pieces, start=1):
                self.comm.send(piece, dest=rank)
        self._shares[number] = Share(self.comm, K, M, shift)
        return self._shares[number].status

    def _solve(self, number: int, count: int, columns: FloatArray | None = None) -> Any:
        """Solve for a few loads, which the first rank has one below the other."""
        return self._shares[number].solve(count, columns)

    def _lowest(self, number: int, n: int) -> Any:
        """Find eigenpairs."""
        return self._shares[number].lowest(n)

    def _forget(self, numbers: list[int]) -> None:
        """Free factors."""
        for number in numbers:
            self._shares.pop(number).destroy()

    def _end(self) -> None:
        """Free all factors."""
        self._forget(list(self._shares))


_ranks: Ranks | None = None


def sharing() -> Ranks | None:
    """Return the ranks that share factors at present; None: this process is alone."""
    return _ranks


def shared(comm: MPI.Intracomm, work: Callable[[], _T]) -> _T | None:
    """Do work on the first rank, while all ranks share its factors (collective).

    Args:
        comm: communicator of the ranks.
        work: what to do.

    Returns:
        What the work returns; None on the other ranks.
    """
    global _ranks
    if comm.size == 1:
        return work()
    start_petsc()  # all together
    hold(comm)
    ranks = Ranks(comm)
    if comm.rank > 0:
        ranks.obey()
        release(comm)
        return None
    _ranks = ranks
    try:
        return work()
    finally:
        _ranks = None
        if ranks.is_busy:  # an error in the midst of an order: the others wait for the rest of it
            comm.Abort(1)
        ranks.end()
        release(comm)
