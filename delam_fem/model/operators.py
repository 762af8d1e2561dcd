"""The semi-discrete equations of motion: given as arrays, matrices of PETSc, or forms.

    M a + C v + K u = f -(m_b q''_b + c_b q'_b + k_b q_b) + H^T lambda,   gap = H u + g0

f are constant loads, as weight; K contains the geometric stiffness of constant axial forces. u
holds the free dofs in the fixed frame, q_b(t) is the motion that all clamped dofs share (paper eq.
10). This module does not know where the matrices come from (beam, continuum, point mass) or how
they are integrated in time.

UFL forms and matrices of PETSc have held dofs, of which each has g times the motion q of the base:
1 where it follows, 0 where it rests. Then m_b = M g at the free dofs. All displacements are those
of the fixed frame, and so are the gaps: a stop rests on the ground.

Each rank owns consecutive rows of M, C and K, as PETSc distributes them, and the columns of its own
dofs of the gap operator, the probes and the sensors. Rates of all gaps are the sum of what the
ranks contribute; loads of contact forces need no communication.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from operator import attrgetter
from typing import TYPE_CHECKING, Any, Generic, TypeVar

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from delam_fem.contact.decisions import PairNumbers
from delam_fem.numerics.types import FloatArray, IntArray
from delam_fem.system.errors import CaseError, require

if TYPE_CHECKING:
    from petsc4py import PETSc

    from delam_fem.system.mpi import MPI


@dataclass(frozen=True)
class Gap:
    """Contact of points of a body with a rigid stop, or with points opposite.

    U = at_rest + along · (u(points) - u(opposite))

    Attributes:
        points: shape (n, dim) [m].
        along: the direction in which the gap opens, one number for each component of the space.
        at_rest: gap at rest, a number or shape (n,) [m]; positive is open.
        opposite: of each point, shape (n, dim) [m]; None: a rigid stop.
    """

    points: Any
    along: Sequence[float]
    at_rest: Any
    opposite: Any = None


DEPENDENT = 1e-6
"""Share of a shape outside the span of the others, below which the shape adds nothing."""


@dataclass(frozen=True)
class BaseCoupling:
    """The columns and the corner of M, C, K that belong to the moving base (paper eq. 9).

    Attributes:
        mass: M_ba summed over the base dofs, shape (n,) [kg].
        damping: C_ba summed over the base dofs, shape (n,) [N s/m].
        stiffness: K_ba summed over the base dofs, shape (n,) [N/m].
        corner: (M_aa, C_aa, K_aa) summed over the base dofs [kg, N s/m, N/m].
        is_force: whether the columns are those of a force; see `force`.
        shift: r of displacements u = w + r q, where the free dofs are w, shape (n,) [-]: then gaps
            to what moves with the base follow from w alone. None: the free dofs are u.
    """

    mass: FloatArray
    damping: FloatArray
    stiffness: FloatArray
    corner: tuple[float, float, float] = (0.0, 0.0, 0.0)
    is_force: bool = False
    shift: FloatArray | None = None

    @classmethod
    def force(cls, load: FloatArray) -> BaseCoupling:
        """Return the coupling of a force while the base rests.

        The drive q(t) is then the force [N], and K_ba = -load: engines need not know what q is.

        Args:
            load: loads on the free dofs by a unit force, shape (n,) [N/N].
        """
        nothing = np.zeros(load.size)
        return cls(nothing, nothing, -load, is_force=True)

    @classmethod
    def none(cls, n: int) -> BaseCoupling:
        """Return the coupling of n dofs to a base that has no effect on them."""
        return cls(np.zeros(n), np.zeros(n), np.zeros(n))


@dataclass(frozen=True)
class Equilibrium:
    """The state of rest under constant loads: K u = f + H^T lambda with contact, the base at q = 0.

    Attributes:
        displacement: u of the own free dofs, from the unloaded shape, shape (n_own,) [m].
        force: contact forces lambda, positive where they part the two sides, shape (n_pairs,) [N].
    """

    displacement: FloatArray
    force: FloatArray


_Matrix = TypeVar("_Matrix")
_Value = TypeVar("_Value")


@dataclass(frozen=True, eq=False)
class Recorded(Generic[_Matrix]):
    """What all operators share, whatever holds their matrices: counts of pairs, probes, sensors."""

    mass: _Matrix
    damping: _Matrix
    stiffness: _Matrix
    base: BaseCoupling
    gap_matrix: sp.csr_matrix
    gap0: FloatArray
    lumped_mass: FloatArray | None = None
    pair_weights: FloatArray | None = None
    probes: sp.csr_matrix = None
    sensors: sp.csr_matrix = None
    rayleigh: tuple[FloatArray, FloatArray] | None = None
    names: tuple[str, ...] = ()
    pair_numbers: PairNumbers | None = None
    load: FloatArray | None = None
    equilibrium: Equilibrium | None = None
    n_forces: int = 0
    near_null: FloatArray | None = None
    start: FloatArray | None = None
    buckling_factor: float | None = None

    @property
    def n_dofs(self) -> int:
        """Number of free dofs of all ranks."""
        return n_rows(self.mass)

    @property
    def n_own(self) -> int:
        """Number of free dofs of this rank."""
        of_one = sp.issparse(self.mass)
        return int(self.mass.shape[0] if of_one else self.mass.getLocalSize()[0])  # type: ignore[attr-defined]

    def total(self, share: FloatArray) -> FloatArray:
        """Return the sum of what all ranks contribute, with the same bits on each (collective)."""
        return share

    def last_dofs(self, count: int) -> IntArray:
        """Return the last so many of all dofs, as numbers of own dofs."""
        return np.arange(self.n_own - count, self.n_own)

    @cached_property
    def pair_mass(self) -> FloatArray:
        """Mass that each pair meets if its nodes move alone, shape (n_pairs,) [kg] (collective)."""
        H = self.gap_matrix
        with np.errstate(divide="ignore", invalid="ignore"):  # points of contact may have no mass
            inverse = self.total(H.multiply(H) @ (1.0 / diagonal(self.mass)))
            return np.asarray(1.0 / inverse)

    @cached_property
    def probe_stiffness(self) -> float:
        """The largest p K pᵀ of the probes p [N/m]; 0 without probes (collective)."""
        p = self.probes.toarray()
        return float(self.total(np.sum(p * times(self.stiffness, p.T).T, axis=1)).max(initial=0.0))

    def _complete(self, n: int, further: Mapping[str, tuple[int, ...]], text: str) -> None:
        """Replace missing probes and sensors by an empty matrix; check the shapes.

        Args:
            n: number of own dofs.
            further: expected shapes of further arrays by name, which are checked first.
            text: of the error, with {name}, {given} and {expected}.

        Raises:
            ValueError: an array has another shape.
        """
        for name in ("probes", "sensors"):
            if getattr(self, name) is None:
                object.__setattr__(self, name, sp.csr_matrix((0, n)))
        shapes: dict[str, tuple[int, ...]] = {
            **further,
            "lumped_mass": (n,),
            "load": (n,),
            "start": (2, n),
            "base.mass": (n,),
            "base.damping": (n,),
            "base.stiffness": (n,),
            "gap_matrix": (self.n_pairs, n),
            "pair_weights": (self.n_pairs,),
            "probes": (self.n_probes, n),
            "sensors": (self.n_sensors, n),
        }
        if self.pair_numbers is not None:
            shapes["pair_numbers.is_elastic"] = (self.n_pairs,)
        for name, expected in shapes.items():
            array = attrgetter(name)(self)
            if array is not None and array.shape != expected:
                raise ValueError(text.format(name=name, given=array.shape, expected=expected))
        require(0 <= self.n_forces <= self.n_sensors, "n_forces", "rows of sensors", self.n_forces)
        named = len(self.names), self.n_probes
        require(named[0] in (0, named[1]), "names", f"one for each of {named[1]} probes", named[0])

    @property
    def is_touching(self) -> bool:
        """Whether pairs are closed at rest, so that contact lasts."""
        is_pressed = self.equilibrium is not None and bool(self.equilibrium.force.any())
        return is_pressed or bool((self.gap0 <= 0.0).any())

    @property
    def n_probes(self) -> int:
        """Number of probes."""
        return int(self.probes.shape[0])

    @property
    def n_sensors(self) -> int:
        """Number of functionals of sensors."""
        return int(self.sensors.shape[0])

    @property
    def forces(self) -> FloatArray:
        """Loads on the own dofs by a unit force of each further drive, shape (n_own, n_forces)."""
        return np.asarray(self.sensors[self.n_sensors - self.n_forces :].toarray().T)

    @property
    def forces_shift(self) -> FloatArray:
        """What a unit of q adds to the displacements at these forces (collective), (n_forces,)."""
        if self.base.shift is None:
            return np.zeros(self.n_forces)
        return self.total(np.asarray(self.base.shift @ self.forces))

    @property
    def probe_shift(self) -> FloatArray:
        """What a unit of q adds to the readings of probes and sensors, shape (n_observed,) [-].

        It is `probes @ r` with r of `BaseCoupling.shift`. For sensors it is 0, because their own
        weights of the base contain it.
        """
        result = np.zeros(self.n_probes + self.n_sensors)
        if self.base.shift is not None:
            result[: self.n_probes] = self.probes @ self.base.shift
        return result

    @property
    def observed(self) -> sp.csr_matrix:
        """Probes and sensors, all that is recorded of u and of v: their rows, own columns."""
        return sp.vstack([self.probes, self.sensors], format="csr")

    @property
    def n_pairs(self) -> int:
        """Number of contact pairs."""
        return int(self.gap0.shape[0])

    def require_lumped_mass(self) -> FloatArray:
        """Return the diagonal of the lumped mass at the own dofs, shape (n_own,).

        Raises:
            ValueError: there is no lumped mass.
        """
        if self.lumped_mass is None:
            raise ValueError(
                'operators: lumped_mass is missing, but impulse = "lumped" acts on it; give it, or '
                'take impulse = "consistent"'
            )
        return self.lumped_mass


@dataclass(frozen=True, eq=False)
class Operators(Recorded[sp.csr_matrix]):
    """Matrices of one semi-discrete contact problem, in SI units and float64; never changed.

    Two problems are equal if they are one object, so that what follows from one can be kept.

    Attributes:
        mass: M, the mass matrix of the time integration, CSR (n, n); here and below a matrix of
            PETSc on one rank is taken as well.
        damping: C, CSR (n, n).
        stiffness: K, CSR (n, n).
        base: coupling of the free dofs to the base.
        gap_matrix: H, CSR (n_pairs, n); gap rate = H v.
        gap0: gap at rest, shape (n_pairs,) [m]; positive is open.
        lumped_mass: diagonal of the lumped mass matrix, on which "lumped" impulses act, shape (n,);
            None: there is none.
        pair_weights: factors of the stiffness and damping of each pair's spring, shape (n_pairs,):
            tributary lengths [m] for springs per length, areas [m2] for springs per area. None:
            springs are per pair, as in the paper.
        pair_numbers: numbers of the contact law that pairs have of their own; None: all follow the
            law alike.
        probes: the quantities that are recorded at every step, as linear functionals of u and of v,
            CSR (n_probes, n). None: no probes (an empty matrix).
        sensors: further functionals of u and of v that are recorded at every step, from which
            signals of sensors follow, CSR (n_sensors, n). None: none.
        rayleigh: α and β at each dof, constant on each body, if C = α M + β K holds to round-off,
            each of shape (n,) [1/s, s]; engines may then need fewer products. None: no word on C.
        names: of the probes; empty: they have numbers only.
        load: f, constant loads on the dofs, shape (n,) [N, N m]; None: there are none.
        equilibrium: the state of rest under these loads; None: the unloaded shape, or none.
        n_forces: number of forces that act besides the drive of `base`, each with a course of its
            own. The last rows of `sensors` are their loads, and read what these forces move.
        near_null: motions that strain the bodies least, as rigid ones, for iterative solvers, shape
            (n, k); None: none are known.
        start: displacements and velocities with which runs begin that get no other state, whatever
            `BaseCoupling.shift` is, shape (2, n) [m, m/s]; None: at rest.
        buckling_factor: factor on all axial forces in K at which the structure buckles [-]; None:
            there are none, or none that it buckles at.
    """

    def __post_init__(self) -> None:
        """Check the shapes; replace missing probes and sensors by an empty matrix.

        Raises:
            CaseError: a matrix is not sparse or not finite, or a mass is negative.
            ValueError: a matrix or vector does not fit the number of dofs or of pairs.
        """
        for name in ("mass", "damping", "stiffness", "gap_matrix"):
            value = getattr(self, name)
            if hasattr(value, "getValuesCSR"):
                value = _of_one_rank(value, name)
                object.__setattr__(self, name, value)
            if not sp.issparse(value):
                raise CaseError(
                    f"operators: {name}: expected a sparse matrix, given {type(value).__name__}; "
                    f"write scipy.sparse.csr_matrix({name})"
                )
            wrong = value.data[~np.isfinite(value.data)]
            require(not wrong.size, f"operators: {name}", "finite numbers", wrong[:1].tolist())
        least = float(self.mass.diagonal().min(initial=0.0))
        require(least >= 0.0, "operators: mass", "a diagonal without negative numbers", least)
        n = self.n_dofs
        square = {"mass": (n, n), "damping": (n, n), "stiffness": (n, n)}
        self._complete(n, square, "operators: {name} has shape {given}, expected {expected}")

    def bodies(self) -> Iterator[tuple[IntArray, sp.csr_matrix, sp.csr_matrix, sp.csr_matrix]]:
        """Yield the dofs that M, C and K do not couple to others, with M, C and K of these."""
        M, C, K = self.mass, self.damping, self.stiffness
        if C.data.all() and connected_components(C, directed=False)[0] == 1:  # as of Rayleigh
            yield np.arange(self.n_dofs), M, C, K
            return
        count, label = connected_components(abs(M) + abs(C) + abs(K), directed=False)
        for number in range(count):
            dofs = np.flatnonzero(label == number)
            M_b, C_b, K_b = (A[dofs][:, dofs] for A in (M, C, K))
            yield dofs, M_b, C_b, K_b

    def without_contact(self) -> Operators:
        """Return the same operators without pairs."""
        return replace(
            self,
            gap_matrix=sp.csr_matrix((0, self.n_dofs)),
            gap0=np.zeros(0),
            pair_weights=None,
            pair_numbers=None,
            equilibrium=None,
        )

    @staticmethod
    def from_forms(
        mass: Any,
        stiffness: Any,
        damping: Any = (0.0, 0.0),
        *,
        base: Sequence[Any] = (),
        gap: Gap | tuple[Any, Any],
        probes: Mapping[str, tuple[Sequence[float], Sequence[float]]] | None = None,
    ) -> Operators | DistributedOperators:
        """Return the operators of bilinear UFL forms on a space of dolfinx (collective).

        Args:
            mass: UFL form of M.
            stiffness: UFL form of K.
            damping: UFL form of C, or (α, β) of C = α M + β K [1/s, s].
            base: Dirichlet conditions of dolfinx at what is held; their values are the share in
                the motion of the base, 1 where dofs follow it and 0 where they rest.
            gap: points that may touch, or H, one row for each pair over the own dofs of the space,
                and the gaps at rest.
            probes: points that are recorded, with the direction of each, by name.

        Returns:
            `Operators` if the mesh is on one rank, `DistributedOperators` on several.

        Raises:
            CaseError: a point is outside the mesh, or the base carries a point of the gap.
        """
        from delam_fem.model import _dolfinx

        space = mass.arguments()[0].ufl_function_space()
        M, K = (_dolfinx.assemble_own(form) for form in (mass, stiffness))
        C = damping if isinstance(damping, tuple) else _dolfinx.assemble_own(damping)
        if isinstance(gap, Gap):
            points = np.atleast_2d(gap.points)
            opposite = gap.opposite
            rows = _dolfinx.rows_at(space, points, gap.along)
            if opposite is not None:
                rows = rows - _dolfinx.rows_at(space, np.atleast_2d(opposite), gap.along)
            gap = rows, np.broadcast_to(np.asarray(gap.at_rest, dtype=float), len(points)).copy()
        probe_rows = {
            name: _dolfinx.rows_at(space, np.atleast_2d(point), along)
            for name, (point, along) in (probes or {}).items()
        }
        result = Operators.from_petsc(
            M, C, K, gap=gap, base=_dolfinx.held_by(base, M), probes=probe_rows
        )
        for matrix in (M, K, *([] if isinstance(C, tuple) else [C])):
            matrix.destroy()
        return result

    @staticmethod
    def from_petsc(
        mass: PETSc.Mat,
        damping: Any,
        stiffness: PETSc.Mat,
        *,
        gap: tuple[Any, Any],
        base: FloatArray | None = None,
        probes: Mapping[str, Any] | None = None,
    ) -> Operators | DistributedOperators:
        """Return the operators of assembled matrices on any communicator (collective).

        Args:
            mass: M, whose rows are spread as PETSc does; copied, as all that is given.
            damping: C, or (α, β) of C = α M + β K [1/s, s].
            stiffness: K; its near-null space serves iterative solvers.
            gap: H, own columns, (n_pairs, n_own), and gaps at rest, (n_pairs,) [m].
            base: share of each own dof in the motion of the base, NaN where it is free, shape
                (n_own,); None: all are free.
            probes: rows that are recorded, own columns, (1, n_own), by name.

        Returns:
            `Operators` if the matrices are on one rank, `DistributedOperators` on several.

        Raises:
            CaseError: the base carries a point of the gap.
        """
        from petsc4py import PETSc

        comm, (n, _) = mass.comm.tompi4py(), mass.getSizes()[0]
        follows = np.full(n, np.nan) if base is None else np.asarray(base, dtype=float)
        require(
            follows.shape == (n,), "base", f"one number for each own dof, ({n},)", follows.shape
        )
        free = np.flatnonzero(np.isnan(follows))
        H = sp.csr_matrix(gap[0])
        at_rest = np.asarray(gap[1], dtype=float)
        carried = np.abs(H @ np.nan_to_num(follows)).max(initial=0.0)
        carried = carried if comm.size == 1 else max(comm.allgather(carried))
        require(carried == 0.0, "gap", "points that the base does not carry", float(carried))
        if isinstance(damping, tuple):
            C = mass.copy()
            C.scale(damping[0])
            C.axpy(damping[1], stiffness)
        else:
            C = damping
        first, _ = mass.getOwnershipRange()
        where = PETSc.IS().createGeneral((first + free).astype(PETSc.IntType), comm=mass.comm)
        g, image = mass.createVecs()
        g.array[:] = np.nan_to_num(follows)
        parts = []
        columns = []
        corners = []
        for matrix in (mass, C, stiffness):
            matrix.mult(g, image)
            parts.append(matrix.createSubMatrix(where, where))
            columns.append(np.array(image.array[free]))
            corners.append(float(g.dot(image)))
        for handle in (where, g, image, *([C] if isinstance(damping, tuple) else [])):
            handle.destroy()
        shapes = stiffness.getNearNullSpace()
        near = np.array([v.array_r[free] for v in shapes.getVecs()]).T if shapes else None
        rows = [sp.csr_matrix((0, n)), *(sp.csr_matrix(row) for row in (probes or {}).values())]
        further: dict[str, Any] = {
            "base": BaseCoupling(
                columns[0], columns[1], columns[2], (corners[0], corners[1], corners[2])
            ),
            "gap_matrix": H[:, free],
            "gap0": at_rest,
            "probes": sp.vstack(rows, format="csr")[:, free],
            "names": tuple(probes or ()),
        }
        if isinstance(damping, tuple):
            further["rayleigh"] = np.full(free.size, damping[0]), np.full(free.size, damping[1])
        if comm.size > 1:
            if near is not None:
                with_near_null(parts[2], near)
            return DistributedOperators(*parts, comm=comm, **further)
        return Operators(parts[0], parts[1], parts[2], near_null=near, **further)


def _of_one_rank(matrix: PETSc.Mat, name: str) -> sp.csr_matrix:
    """Return a matrix of PETSc as one of SciPy.

    Raises:
        CaseError: it is spread over several ranks.
    """
    require(
        matrix.comm.size == 1,
        f"operators: {name}",
        "a matrix on one rank; Operators.from_petsc takes one on several",
        f"{matrix.comm.size} ranks",
    )
    return sp.csr_matrix(matrix.getValuesCSR()[::-1], shape=matrix.getSize())


@dataclass(frozen=True, eq=False)
class DistributedOperators(Recorded["PETSc.Mat"]):
    """Matrices of one semi-discrete contact problem, spread over the ranks of a communicator.

    The equations and the units are those of `Operators`. This rank owns n_own of the n dofs.

    Attributes:
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
        pair_numbers: see `Operators`; known to all.
        probes: own columns of the probes, CSR (n_probes, n_own).
        sensors: own columns of the functionals of sensors, CSR (n_sensors, n_own).
        rayleigh: α and β at the own dofs, each of shape (n_own,); see `Operators`.
        names: of the probes; empty: they have numbers only.
        load: constant loads on the own dofs, shape (n_own,); None: there are none.
        equilibrium: see `Operators`; its displacements are those of the own dofs.
        n_forces: see `Operators`.
        near_null: values of these motions at the own dofs, shape (n_own, k); see `Operators`.
        start: see `Operators`, at the own dofs, shape (2, n_own).
        buckling_factor: see `Operators`.
        comm: the communicator.
        is_uncoupled: whether no entry of M, C and K couples dofs of two ranks, for example because
            each lamina is on one rank. Each rank then factorises its own part alone.
        order: number of each own dof in an order that does not depend on the number of ranks, shape
            (n_own,); None: there is none.
        body: number of the body of each own dof, which M, C and K do not couple to others, shape
            (n_own,); None: all are one.
    """

    comm: MPI.Intracomm = field(kw_only=True)
    is_uncoupled: bool = False
    order: IntArray | None = None
    body: IntArray | None = None

    def __post_init__(self) -> None:
        """Check the shapes; replace missing probes and sensors by an empty matrix.

        Raises:
            ValueError: a matrix or vector does not fit the number of own dofs or of pairs.
        """
        n = self.n_own
        text = "distributed operators: {name} has shape {given} on rank "
        self._complete(n, {}, f"{text}{self.comm.rank}, expected {{expected}}")
        for name in ("mass", "damping", "stiffness"):
            rows, columns = getattr(self, name).getSizes()
            if tuple(rows) != (n, self.n_dofs) or tuple(columns) != tuple(rows):
                raise ValueError(
                    f"distributed operators: {name} has (own, all) rows {rows} and columns "
                    f"{columns} on rank {self.comm.rank}, expected those of mass, "
                    f"({n}, {self.n_dofs})"
                )

    def last_dofs(self, count: int) -> IntArray:
        """Return the last so many of all dofs, as numbers of own dofs; the last rank has them."""
        is_last = self.comm.rank == self.comm.size - 1
        return np.arange(self.n_own - count if is_last else self.n_own, self.n_own)

    def total(self, share: FloatArray) -> FloatArray:
        """Return the sum of what all ranks contribute, with the same bits on each (collective)."""
        return np.asarray(np.sum(self.comm.allgather(share), axis=0))

    def of_all(self, share: FloatArray) -> FloatArray:
        """Return values of all dofs in `order` from those of the own dofs, the last axis.

        The call is collective.
        """
        values = gather(share, self.comm)
        if self.order is None or self.comm.size == 1 or not values.size:
            return values
        result = np.empty_like(values)
        result[..., np.concatenate(self.comm.allgather(self.order))] = values
        return result

    def bodies(self) -> Iterator[tuple[IntArray, PETSc.Mat, PETSc.Mat, PETSc.Mat]]:
        """Yield own dofs that M, C and K do not couple to others, with M, C, K of them.

        The call is collective. A rank may have no dofs of a body.
        """
        matrices = self.mass, self.damping, self.stiffness
        numbers = np.zeros(self.n_own, dtype=np.int64) if self.body is None else self.body
        count = 1 + max(self.comm.allgather(int(numbers.max(initial=0))))
        for number in range(count):
            dofs = np.flatnonzero(numbers == number)
            M, C, K = matrices if count == 1 else (restricted(A, dofs) for A in matrices)
            yield dofs, M, C, K

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
    o, (share, remainder) = operators, divmod(operators.n_dofs, comm.size)
    first = comm.rank * share + min(comm.rank, remainder)
    local_rows = slice(first, first + share + (comm.rank < remainder))  # the same split as PETSc's
    base, lumped = o.base, o.lumped_mass
    matrices = o.mass, o.damping, o.stiffness
    M, C, K = (matrix(m if comm.size == 1 else m[local_rows], comm) for m in matrices)
    if o.near_null is not None:
        with_near_null(K, o.near_null[local_rows])
    return DistributedOperators(
        M,
        C,
        K,
        BaseCoupling(
            base.mass[local_rows],
            base.damping[local_rows],
            base.stiffness[local_rows],
            base.corner,
            base.is_force,
            None if base.shift is None else base.shift[local_rows],
        ),
        gap_matrix=sp.csr_matrix(o.gap_matrix)[:, local_rows],
        gap0=o.gap0,
        lumped_mass=None if lumped is None else lumped[local_rows],
        pair_weights=o.pair_weights,
        pair_numbers=o.pair_numbers,
        probes=sp.csr_matrix(o.probes)[:, local_rows],
        sensors=sp.csr_matrix(o.sensors)[:, local_rows],
        rayleigh=None
        if o.rayleigh is None
        else (o.rayleigh[0][local_rows], o.rayleigh[1][local_rows]),
        names=o.names,
        load=None if o.load is None else o.load[local_rows],
        start=None if o.start is None else o.start[:, local_rows],
        equilibrium=o.equilibrium
        and replace(o.equilibrium, displacement=o.equilibrium.displacement[local_rows]),
        buckling_factor=o.buckling_factor,
        n_forces=o.n_forces,
        comm=comm,
        order=np.arange(local_rows.start, local_rows.stop),
    )


def matrix(rows: sp.spmatrix, comm: MPI.Intracomm, n_columns: int | None = None) -> PETSc.Mat:
    """Return a PETSc matrix from the rows of each rank (collective).

    On one rank the matrix is in the memory of the rows, so that nobody may write to them.

    Args:
        rows: the own rows with all columns, CSR (n_own, n).
        comm: communicator over which the rows are spread in the order of the ranks.
        n_columns: number of columns of this rank on several ranks; None: that of its rows.
    """
    from petsc4py import PETSc  # after MPI has started

    rows = sp.csr_matrix(rows)
    rows.sort_indices()
    index = PETSc.IntType
    arrays = (
        rows.indptr.astype(index, copy=False),
        rows.indices.astype(index, copy=False),
        rows.data.astype(float, copy=False),
    )
    if comm.size == 1:
        return PETSc.Mat().createAIJWithArrays(rows.shape, arrays, comm=comm)
    result = PETSc.Mat().create(comm)
    columns = rows.shape[0] if n_columns is None else n_columns
    result.setSizes(((rows.shape[0], PETSc.DETERMINE), (columns, rows.shape[1])))
    result.setType(PETSc.Mat.Type.AIJ)
    result.setPreallocationCSR(arrays)
    result.assemble()
    return result


AT_ONCE = 32
"""Columns that are multiplied on ranks, or solved for by PETSc, at once: a bound for the memory."""


def times(matrix: Any, vectors: FloatArray) -> FloatArray:
    """Return a matrix of SciPy, or one of PETSc (collective), times vectors of the own dofs.

    Args:
        matrix: the matrix.
        vectors: shape (n_own,) or (n_own, k).
    """
    if sp.issparse(matrix):
        return np.asarray(matrix @ vectors)
    columns = vectors.reshape(len(vectors), *vectors.shape[1:] or (1,))
    result = np.empty((matrix.getLocalSize()[0], columns.shape[1]))
    for first in range(0, columns.shape[1], AT_ONCE):
        some = slice(first, first + AT_ONCE)
        right = dense(columns[:, some], matrix.comm)
        left = matrix.matMult(right)
        result[:, some] = left.getDenseArray()
        left.destroy()
        right.destroy()
    return np.asarray(result.reshape(len(result), *vectors.shape[1:]))


def solved(factor: PETSc.Mat, loads: FloatArray) -> FloatArray:
    """Return the solutions for loads on the own dofs, by factors of PETSc (collective).

    Many columns take a third of the time for each that one takes alone.

    Args:
        factor: the factors.
        loads: shape (n_own,) or (n_own, k).
    """
    columns = loads.reshape(len(loads), *loads.shape[1:] or (1,))
    result = np.empty_like(columns)
    for first in range(0, columns.shape[1], AT_ONCE):
        some = slice(first, first + AT_ONCE)
        right = dense(columns[:, some], factor.comm)
        left = dense(columns[:, some], factor.comm)
        factor.matSolve(right, left)
        result[:, some] = left.getDenseArray()
        right.destroy()
        left.destroy()
    return result.reshape(loads.shape)


def dense(columns: FloatArray, comm: Any) -> PETSc.Mat:
    """Return a dense matrix of PETSc with the own rows of some columns (collective)."""
    from petsc4py import PETSc

    n, k = columns.shape
    result = PETSc.Mat().createDense(((n, PETSc.DETERMINE), k), comm=comm)
    result.setUp()
    result.getDenseArray()[:] = columns
    result.assemble()
    return result


def summed(matrix: Any, share: Any) -> FloatArray:
    """Return the sum over the ranks of a matrix, with the same bits on each (collective)."""
    if sp.issparse(matrix):
        return np.asarray(share)
    comm = matrix.comm.tompi4py()
    local = np.array(share, order="C")
    total: FloatArray = np.empty_like(local)
    comm.Reduce(local, total)
    comm.Bcast(total)
    return total


def agreed(matrix: Any, value: _Value) -> _Value:
    """Return what the first rank of a matrix has, on all (collective): round-off may differ."""
    return value if sp.issparse(matrix) else matrix.comm.tompi4py().bcast(value)


def of_ranks(matrix: Any, value: _Value) -> list[_Value]:
    """Return what each rank of a matrix has, on all (collective)."""
    return [value] if sp.issparse(matrix) else matrix.comm.tompi4py().allgather(value)


def n_rows(matrix: Any) -> int:
    """Return the number of rows of a matrix of SciPy or of PETSc, those of all ranks."""
    return int(matrix.shape[0] if sp.issparse(matrix) else matrix.getSize()[0])


def n_columns(matrix: Any) -> int:
    """Return the number of columns of a matrix of SciPy or of PETSc, those of all ranks."""
    return int(matrix.shape[1] if sp.issparse(matrix) else matrix.getSize()[1])


def diagonal(matrix: Any) -> FloatArray:
    """Return the own part of the diagonal of a matrix of SciPy or of PETSc."""
    if sp.issparse(matrix):
        return np.asarray(matrix.diagonal())
    vector = matrix.getDiagonal()
    result = np.array(vector.array)
    vector.destroy()
    return result


def scaled_by(matrix: PETSc.Mat, factors: FloatArray) -> tuple[PETSc.Mat, PETSc.Mat]:
    """Return D A D of a symmetric matrix and own factors D, and the identity (collective)."""
    scale = matrix.createVecLeft()
    scale.array[:] = factors
    scaled = matrix.copy()
    scaled.diagonalScale(scale, scale)
    identity = matrix.duplicate()
    identity.shift(1.0)
    scale.destroy()
    return scaled, identity


def congruent(matrix: PETSc.Mat, basis: PETSc.Mat) -> PETSc.Mat:
    """Return Sᵀ A S of matrices of PETSc (collective)."""
    from petsc4py import PETSc

    options = PETSc.Options()
    if not options.hasName("matptap_via"):
        options["matptap_via"] = "allatonce"  # half the time of the default, and less memory
    return matrix.ptap(basis)


def own_rows(matrix: Any) -> Any:
    """Return the own rows of a matrix of PETSc with all columns, CSR (n_own, n); others as is."""
    if sp.issparse(matrix):
        return matrix
    shape = matrix.getLocalSize()[0], matrix.getSize()[1]
    return sp.csr_matrix(matrix.getValuesCSR()[::-1], shape=shape)


def bordered(A: Any, diagonal: FloatArray, count: int, near_null: FloatArray | None = None) -> Any:
    """Return a matrix with dofs behind all others that nothing couples, of SciPy or of PETSc.

    The call is collective.

    Args:
        A: the matrix.
        diagonal: entries of those dofs of this rank: all of them on the last one, none on others.
        count: number of these dofs.
        near_null: see `with_near_null`, of a matrix of PETSc with these dofs; None: none.
    """
    if sp.issparse(A):
        return sp.block_diag([A, sp.diags(diagonal)], format="csr")
    rows = own_rows(A)
    wider = sp.hstack([rows, sp.csr_matrix((rows.shape[0], count))], format="csr")
    more = sp.csr_matrix(
        (diagonal, (np.arange(diagonal.size), rows.shape[1] + np.arange(diagonal.size))),
        shape=(diagonal.size, wider.shape[1]),
    )
    result = matrix(sp.vstack([wider, more], format="csr"), A.comm.tompi4py())
    A.destroy()
    return result if near_null is None else with_near_null(result, near_null)


def restricted(matrix: Any, dofs: IntArray) -> Any:
    """Return rows and columns of own dofs of a matrix of SciPy or of PETSc (collective)."""
    if sp.issparse(matrix):
        return matrix[dofs][:, dofs]
    from petsc4py import PETSc

    first, _ = matrix.getOwnershipRange()
    where = PETSc.IS().createGeneral((first + dofs).astype(PETSc.IntType), comm=matrix.comm)
    result = matrix.createSubMatrix(where, where)
    where.destroy()
    return result


def with_near_null(stiffness: PETSc.Mat, shapes: FloatArray) -> PETSc.Mat:
    """Give a stiffness matrix its near-null space, the motions that strain least; return it.

    The call is collective.

    Args:
        stiffness: the matrix.
        shapes: values of these motions at the own dofs, shape (n_own, k), orthogonal or not.
    """
    from petsc4py import PETSc

    vectors: list[PETSc.Vec] = []
    for shape in shapes.T:
        vector = stiffness.createVecLeft()
        vector.array[:] = shape
        size = vector.norm()
        for other in vectors:
            vector.axpy(-vector.dot(other), other)
        if vector.normalize() > DEPENDENT * size:
            vectors.append(vector)
    stiffness.setNearNullSpace(PETSc.NullSpace().create(vectors=vectors, comm=stiffness.comm))
    return stiffness


def gather(share: FloatArray, comm: MPI.Intracomm) -> FloatArray:
    """Return an array over all dofs on every rank (collective).

    Args:
        share: values at the own dofs, shape (…, n_own).
        comm: the communicator.

    Returns:
        Values at all dofs, shape (…, n).
    """
    return share if comm.size == 1 else np.concatenate(comm.allgather(share), axis=-1)
