"""The semi-discrete equations of motion with their dofs spread over the ranks of a communicator.

Each rank owns consecutive rows of M, C and K, as PETSc distributes them, and the columns of its own
dofs of the gap operator, the probes and the sensors. Rates of all gaps are the sum of what the
ranks contribute; loads of contact forces need no communication.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse as sp

from delam_fem.model.operators import BaseCoupling, Operators, Recorded
from delam_fem.numerics.arrays import FloatArray

if TYPE_CHECKING:  # those who compute with `Operators` alone start neither
    from petsc4py import PETSc

    from delam_fem.system.mpi import MPI


@dataclass(frozen=True)
class DistributedOperators(Recorded):
    """Matrices of one semi-discrete contact problem, spread over the ranks of a communicator.

    The equations and the units are those of `Operators`. This rank owns n_own of the n dofs.

    Attributes:
        comm: the communicator.
        mass: M, PETSc matrix (n, n), rows and columns spread over the ranks.
        damping: C, PETSc matrix (n, n), spread in the same way.
        stiffness: K, PETSc matrix (n, n), spread in the same way.
        base: coupling of the own dofs to the base, columns of shape (n_own,); all ranks know the
            corner.
        gap_matrix: own columns of H, CSR (n_pairs, n_own).
        gap0: gap at rest, known to all, shape (n_pairs,) [m].
        lumped_mass: own part of the diagonal of the lumped mass, shape (n_own,); None: there is
            none.
        pair_weights: factors of the springs of pairs, known to all, shape (n_pairs,); None: springs
            are per pair.
        probes: own columns of the probes, CSR (n_probes, n_own).
        sensors: own columns of the functionals of sensors, CSR (n_sensors, n_own).
        rayleigh: α and β at the own dofs, each of shape (n_own,); see `Operators`.
        is_uncoupled: whether no entry of M, C and K couples dofs of two ranks, for example because
            each lamina is on one rank. Each rank then factorises its own part alone.
        is_shared_order: whether the order of the dofs is the same for any number of ranks.
    """

    comm: MPI.Intracomm
    mass: PETSc.Mat
    damping: PETSc.Mat
    stiffness: PETSc.Mat
    base: BaseCoupling
    gap_matrix: sp.csr_matrix
    gap0: FloatArray
    lumped_mass: FloatArray | None = None
    pair_weights: FloatArray | None = None
    probes: sp.csr_matrix = None
    sensors: sp.csr_matrix = None
    rayleigh: tuple[FloatArray, FloatArray] | None = None
    is_uncoupled: bool = False
    is_shared_order: bool = False

    def __post_init__(self) -> None:
        """Check the shapes; replace missing probes and sensors by an empty matrix.

        Raises:
            ValueError: a matrix or vector does not fit the number of own dofs or of pairs.
        """
        n, text = self.n_own, "distributed operators: {name} has shape {given} on rank "
        self._complete(n, {}, f"{text}{self.comm.rank}, expected {{expected}}")
        for name in ("mass", "damping", "stiffness"):
            rows, columns = getattr(self, name).getSizes()
            if tuple(rows) != (n, self.n_dofs) or tuple(columns) != tuple(rows):
                raise ValueError(
                    f"distributed operators: {name} has (own, all) rows {rows} and columns "
                    f"{columns} on rank {self.comm.rank}, expected those of mass, "
                    f"({n}, {self.n_dofs})"
                )

    @property
    def n_dofs(self) -> int:
        """Number of free dofs of all ranks."""
        return int(self.mass.getSize()[0])

    @property
    def n_own(self) -> int:
        """Number of free dofs of this rank."""
        return int(self.mass.getLocalSize()[0])

    @property
    def own(self) -> slice:
        """The dofs of this rank among all dofs."""
        return slice(*self.mass.getOwnershipRange())


def spread(operators: Operators, comm: MPI.Intracomm) -> DistributedOperators:
    """Return the share of this rank in operators that every rank knows as a whole (collective).

    Args:
        operators: the whole problem, the same on every rank.
        comm: communicator that shares the work.
    """
    o, own = operators, _own_of(operators.n_dofs, comm)
    base, lumped = o.base, o.lumped_mass
    M, C, K = (matrix(m[own], comm) for m in (o.mass, o.damping, o.stiffness))
    return DistributedOperators(
        comm,
        M,
        C,
        K,
        BaseCoupling(
            base.mass[own], base.damping[own], base.stiffness[own], base.corner, base.is_force
        ),
        gap_matrix=sp.csr_matrix(o.gap_matrix)[:, own],
        gap0=o.gap0,
        lumped_mass=None if lumped is None else lumped[own],
        pair_weights=o.pair_weights,
        probes=sp.csr_matrix(o.probes)[:, own],
        sensors=sp.csr_matrix(o.sensors)[:, own],
        rayleigh=None if o.rayleigh is None else (o.rayleigh[0][own], o.rayleigh[1][own]),
        is_shared_order=True,
    )


def matrix(rows: sp.spmatrix, comm: MPI.Intracomm) -> PETSc.Mat:
    """Return a square PETSc matrix from the rows of each rank (collective).

    Args:
        rows: the own rows with all columns, CSR (n_own, n).
        comm: communicator over which the rows are spread in the order of the ranks.
    """
    from petsc4py import PETSc  # after MPI has started

    rows = sp.csr_matrix(rows)
    rows.sort_indices()
    result = PETSc.Mat().create(comm)
    result.setSizes((rows.shape, rows.shape))
    result.setType(PETSc.Mat.Type.AIJ)
    index = PETSc.IntType
    result.setPreallocationCSR(
        (rows.indptr.astype(index), rows.indices.astype(index), rows.data.astype(float))
    )
    result.assemble()
    return result


def whole(share: FloatArray, comm: MPI.Intracomm) -> FloatArray:
    """Return an array over all dofs on every rank (collective).

    Args:
        share: values at the own dofs, shape (…, n_own).
        comm: the communicator.

    Returns:
        Values at all dofs, shape (…, n).
    """
    return share if comm.size == 1 else np.concatenate(comm.allgather(share), axis=-1)


def _own_of(n: int, comm: MPI.Intracomm) -> slice:
    """Return the rows of n that this rank owns (the same split as PETSc's)."""
    share, rest = divmod(n, comm.size)
    first = comm.rank * share + min(comm.rank, rest)
    return slice(first, first + share + (comm.rank < rest))
