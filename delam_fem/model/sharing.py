"""Share the work on one solid among the ranks of MPI, while the first rank does all other work.

The first rank reads, writes and orders functions, which all ranks do together: they assemble,
factorise (MUMPS), find eigenpairs (SLEPc) and multiply, each with its own dofs. Between such orders
the others wait, without keeping a core busy. So an error is told by the first rank alone, and only
it writes to a folder.
"""

from __future__ import annotations

import math
import time
import traceback
from collections.abc import Callable
from contextlib import suppress
from importlib import import_module
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from delam_fem.model.operators import solved
from delam_fem.numerics.types import FloatArray
from delam_fem.system.errors import CaseError
from delam_fem.system.mpi import have_arrived, hold, release, slepc, start_petsc

if TYPE_CHECKING:
    from petsc4py import PETSc

    from delam_fem.system.mpi import MPI

_T = TypeVar("_T")

LOOK = 0.02
"""Longest time between two looks for an order [s]; at first it is a tenth of the time waited."""
RESIDUAL = 1e-13
"""Relative residual at which SLEPc takes an eigenpair."""
LANCZOS = 40
"""Vectors among which the largest eigenvalue is sought."""
MOST_RESTARTS = 10_000
"""Times that they are begun anew."""
NEEDS_SLEPC = "eigenvalues on several ranks need SLEPc: apt-get install python3-slepc4py"
SINGULAR = (-6, -10)
"""Values of MUMPS's INFOG(1) that say that a matrix is singular."""
TOO_SMALL = (-8, -9)
"""Values of MUMPS's INFOG(1) that say that its workspace is smaller than what the factors need."""
MINIMUM_FILL = 2
"""MUMPS's ICNTL(7) of the order by approximate minimum fill. Debian's MUMPS has PORD beside it,
which takes longer for a plate than its factors do, and two orders by minimum degree, of which a
block gets twice the operations."""
WORKSPACE = (100, 300, 1000)
"""Workspace beyond MUMPS's estimate that is tried in turn where that was too small [%]."""


def factorise(solver: PETSc.KSP, like: PETSc.Mat, eigenpairs: Any = None) -> int:
    """Set up a solver whose factors are those of MUMPS; return its INFOG(1) (collective).

    MUMPS estimates its workspace from the pattern of the matrix; with a few rows that couple many
    dofs, as of a spring at a lamina, it may need more. Below 0 there are no factors.

    Args:
        solver: the solver.
        like: the matrix to be factorised, or one of its pattern with `eigenpairs`.
        eigenpairs: solver of SLEPc that makes the matrix; None: it is given.
    """
    from petsc4py import PETSc

    preconditioner = solver.getPC()
    status = 0
    for more in (0, *WORKSPACE):
        if more:  # PETSc never tries factors again that have failed
            solver.reset()
        solver.setOperators(like)
        preconditioner.setFactorSetUpSolverType()
        factor = preconditioner.getFactorMatrix()
        factor.setMumpsIcntl(7, MINIMUM_FILL)
        if more:
            factor.setMumpsIcntl(14, more)
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


def largest(A: PETSc.Mat, B: PETSc.Mat) -> float:
    """Return the largest λ of A φ = λ B φ, with A symmetric and B positive definite (collective).

    Raises:
        CaseError: SLEPc is not installed.
        RuntimeError: it was not found.
    """
    library = slepc()
    if library is None:
        raise CaseError(NEEDS_SLEPC)
    eigenpairs = library.EPS().create(B.comm)
    eigenpairs.setOperators(A, B)
    eigenpairs.setProblemType(library.EPS.ProblemType.GHEP)
    eigenpairs.setWhichEigenpairs(library.EPS.Which.LARGEST_REAL)
    eigenpairs.setDimensions(1, LANCZOS)
    eigenpairs.setTolerances(RESIDUAL, MOST_RESTARTS)
    transformation = eigenpairs.getST()
    transformation.setType(library.ST.Type.SHIFT)
    solver = _cholesky(transformation.getKSP())
    require_factors(factorise(solver, B, eigenpairs), B.comm.size)
    eigenpairs.solve()
    has_converged = eigenpairs.getConverged() > 0
    result = eigenpairs.getEigenvalue(0).real if has_converged else math.nan
    eigenpairs.destroy()
    release(B.comm.tompi4py())
    if not has_converged:
        raise RuntimeError("SLEPc found no largest eigenvalue")
    return float(result)


def is_positive_definite(A: PETSc.Mat) -> bool | None:
    """Return whether a symmetric matrix is, by the pivots of its factors (collective).

    They are not counted where MUMPS needs more than its first estimate of workspace: None.
    """
    from petsc4py import PETSc

    solver = _cholesky(PETSc.KSP().create(A.comm))
    solver.setOperators(A)
    preconditioner = solver.getPC()
    preconditioner.setFactorSetUpSolverType()
    preconditioner.getFactorMatrix().setMumpsIcntl(13, 1)  # or the last pivots are not counted
    status = factorise(solver, A)
    factor = preconditioner.getFactorMatrix()
    is_counted = factor.getMumpsIcntl(13) == 1
    n_negative = factor.getMumpsInfog(12)
    solver.destroy()
    release(A.comm.tompi4py())
    if status in SINGULAR:
        return False
    require_factors(status, A.comm.size)
    return n_negative == 0 if is_counted else None


def _cholesky(solver: PETSc.KSP) -> PETSc.KSP:
    """Let a solver take the factors of MUMPS alone; return it."""
    solver.setType("preonly")
    solver.getPC().setType("cholesky")
    solver.getPC().setFactorSolverType("mumps")
    return solver


class Share:
    """What one rank has of the factors of K + s M, all calls of which are collective."""

    def __init__(self, K: PETSc.Mat, M: PETSc.Mat | None, shift: float) -> None:
        """Factorise K + s M.

        Args:
            K: K, spread over the ranks.
            M: M, spread in the same way; None: there are no eigenpairs, and s is 0.
            shift: s [1/s2].

        Raises:
            ValueError: the matrix is singular.
            MemoryError: the factors need more memory than there is.
        """
        from petsc4py import PETSc

        library = None if M is None else slepc()
        self._eigenpairs = None
        self._sum: PETSc.Mat | None = None
        if library is not None:
            self._eigenpairs = library.EPS().create(K.comm)
            self._eigenpairs.setOperators(K, M)
            self._eigenpairs.setProblemType(library.EPS.ProblemType.GHEP)
            self._eigenpairs.setTarget(-shift)
            self._eigenpairs.setWhichEigenpairs(library.EPS.Which.TARGET_MAGNITUDE)
            self._eigenpairs.setTolerances(RESIDUAL)
            transformation = self._eigenpairs.getST()
            transformation.setType(library.ST.Type.SINVERT)
            transformation.setShift(-shift)
            self._solver = transformation.getKSP()
        else:
            self._solver = PETSc.KSP().create(K.comm)
            if shift:
                self._sum = K.copy()
                self._sum.axpy(shift, M)
        _cholesky(self._solver)
        status = factorise(self._solver, self._sum or K, self._eigenpairs)
        require_factors(status, K.comm.size)
        self._factor = self._solver.getPC().getFactorMatrix()
        self._vector = K.createVecRight()

    def solve(self, loads: FloatArray) -> FloatArray:
        """Return the own part of solutions for the own part of loads, shape (n_own,) or (…, k)."""
        return solved(self._factor, loads)

    def lowest(self, n: int) -> tuple[FloatArray, FloatArray]:
        """Return the eigenvalues of K φ = ω² M φ nearest to -s, and the own part of φ.

        Args:
            n: number of eigenpairs.

        Raises:
            CaseError: SLEPc is not installed.
            RuntimeError: they were not found.
        """
        solver = self._eigenpairs
        if solver is None:
            raise CaseError(NEEDS_SLEPC)
        solver.setDimensions(n)
        solver.solve()
        if solver.getConverged() < n:
            raise RuntimeError(f"SLEPc found {solver.getConverged()} of {n} eigenpairs")
        vectors = np.empty((self._vector.getLocalSize(), n))
        for k in range(n):
            solver.getEigenvector(k, self._vector)
            vectors[:, k] = self._vector.array_r
        return np.array([solver.getEigenvalue(k).real for k in range(n)]), vectors

    def destroy(self) -> None:
        """Free the factors."""
        comm = self._factor.comm.tompi4py()
        for handle in (self._eigenpairs, self._solver, self._factor, self._vector, self._sum):
            if handle is not None:
                handle.destroy()
        release(comm)  # other handles of these objects that Python has had


class Ranks:
    """The ranks that share the work on a solid. The first one orders, and takes part.

    Attributes:
        comm: their communicator.
        is_busy: whether an order has begun and not ended; others may then wait forever.
    """

    def __init__(self, comm: MPI.Intracomm) -> None:
        """Begin (collective)."""
        self.comm = comm
        self.is_busy = False
        self._at_end = comm.Dup()

    def do(self, work: Callable[..., _T], *arguments: Any) -> _T:
        """Do something on all ranks; the first one calls, the others get it from there.

        Args:
            work: function of a module, which is called with `comm` by name.
            arguments: its other arguments, which can be pickled.

        Returns:
            What the first rank gets.
        """
        self._order(work, arguments)
        return self._take_part(work, arguments)

    def end(self) -> None:
        """Let the other ranks go."""
        self._order(None, ())
        self._at_end.Free()

    def obey(self) -> None:
        """Take part in what the first rank orders, until it ends."""
        while True:
            request = self.comm.Ibarrier()
            begin = time.monotonic()
            while not request.Test():
                time.sleep(min(LOOK, 0.1 * (time.monotonic() - begin)))
            work, arguments = self.comm.bcast(None)
            if work is None:
                self._at_end.Free()
                return
            with suppress(Exception, KeyboardInterrupt):  # the first rank tells it
                self._take_part(work, arguments)

    def _order(self, work: Callable[..., Any] | None, arguments: tuple[Any, ...]) -> None:
        """Tell the other ranks what to take part in."""
        self.comm.Ibarrier().Wait()
        self.comm.bcast((work, arguments))

    def _take_part(self, work: Callable[..., _T], arguments: tuple[Any, ...]) -> _T:
        """Do something as all ranks do, and end together.

        Raises:
            Exception: this rank, or another one, has failed.
        """
        failure: BaseException | None = None
        self.is_busy = True
        try:
            result = work(*arguments, comm=self.comm)
        except BaseException as error:
            failure = error
        if not have_arrived(self._at_end, has_failed=failure is not None):
            traceback.print_exception(failure)
            self.comm.Abort(1)
        told = None if failure is None else _portable(failure)
        cause = failure
        while cause is not None:  # what its frames keep alive ends on all ranks at one place
            traceback.clear_frames(cause.__traceback__)
            cause = cause.__context__
        errors = [error for error in self._at_end.allgather(told) if error is not None]
        release(self.comm)
        self.is_busy = False
        if failure is not None:
            raise failure
        if errors:
            raise errors[0]
        return result


def _portable(failure: BaseException) -> BaseException:
    """Return an error that other ranks can be sent."""
    is_known = type(failure) in (CaseError, MemoryError, ValueError)
    return failure if is_known else RuntimeError("".join(traceback.format_exception(failure)))


_ranks: Ranks | None = None


def together(work: Callable[..., _T], *arguments: Any) -> _T:
    """Do something on all ranks that share their work; a process that is alone does it itself.

    Args:
        work: function of a module, which takes the communicator as `comm`, None: there is one
            process.
        arguments: its other arguments, which can be pickled.
    """
    return work(*arguments, comm=None) if _ranks is None else _ranks.do(work, *arguments)


def shared(comm: MPI.Intracomm, work: Callable[[], _T]) -> _T | None:
    """Do work on the first rank, while all ranks share what it does `together` (collective).

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
        with suppress(ImportError):  # an order then says what is missing
            import_module("delam_fem.model.solids.assembly")  # while the first rank reads a case
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
