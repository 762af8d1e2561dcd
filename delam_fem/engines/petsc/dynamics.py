"""The PETSc state that every stepper shares: matrices, vectors, gaps, resting pairs, energies.

A stepper adds the time integration. All vectors are allocated once; the time loop only fills them.
Each vector is the own share of its rank. Ranks exchange gaps, gap rates, recorded quantities and
energies, besides what the products and solves of coupled ranks exchange.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from typing import TypeAlias

import numpy as np
import scipy.sparse as sp
from petsc4py import PETSc

from delam_fem.contact.decisions import PairState
from delam_fem.contact.rules import OF_PLACE, OF_SPEED
from delam_fem.engines.petsc import linear_algebra
from delam_fem.engines.petsc.linear_algebra import new_vector
from delam_fem.engines.petsc.rayleigh import RayleighProducts
from delam_fem.model.operators import DistributedOperators, Operators, matrix, spread
from delam_fem.numerics.types import BoolArray, FloatArray, IntArray
from delam_fem.simulation.recorder import N_BASE, Energies
from delam_fem.simulation.refinement import nearness
from delam_fem.system.mpi import MPI

BaseState: TypeAlias = Sequence[float]
"""(q, q', q'') of the base at an instant [m, m/s, m/s2]."""


class Dynamics:
    """Matrices and state of M a + C v + K u = f(t) + contact, in PETSc.

    Attributes:
        operators: the semi-discrete problem.
        u, v, a: displacements, velocities and accelerations of the own free dofs.
        pair_state: what is remembered of the pairs; its arrays are replaced, never written to.
        is_touching: whether some pairs are closed at rest.
        is_resting: whether a pair rests, so that the law must be asked although no gap is closed.
        seen_base: the entries of `seen_u` that belong to the energy ledger, shape (3,).
        spring_stiffness: stiffness of the spring that a resting pair carries [N/m]; 0: no spring.
        contact_damped: energy that contact dampers have taken so far [J].
        damped: energy that the damper of each pair has taken in the period, shape (n_pairs,) [J].
    """

    def __init__(
        self, operators: Operators | DistributedOperators, time_step: float, comm: MPI.Intracomm
    ) -> None:
        """Create all matrices and vectors; the state is at rest.

        Args:
            operators: the semi-discrete problem; `Operators` are spread over the ranks.
            time_step: size of the steps until `use` chooses another one [s].
            comm: communicator that shares the work.
        """
        self._is_owner = isinstance(operators, Operators)
        o = spread(operators, comm) if isinstance(operators, Operators) else operators
        self.operators = o
        self.time_step = time_step
        self.comm = o.comm
        self._blocks = [
            linear_algebra.block(m, o.is_uncoupled) for m in (o.mass, o.damping, o.stiffness)
        ]
        self._M, self._C, self._K = map(linear_algebra.product, self._blocks)
        self._H = matrix(o.gap_matrix, MPI.COMM_SELF)
        self.is_touching = o.is_touching
        self._absolute_H = matrix(abs(o.gap_matrix), MPI.COMM_SELF)
        n = o.n_own
        base = np.column_stack([o.base.stiffness, o.base.damping, o.base.mass, -o.forces])
        if o.load is not None:  # constant loads: a last column, whose number is always 1
            base = np.column_stack([base, -o.load])
        memory = np.zeros(3 * o.n_own + base.shape[1])
        memory[3 * o.n_own + 3 + o.n_forces :] = 1.0
        self._n_forces = o.n_forces
        # u, v, a, (q, q', q'') of the base and the forces in one memory: one product sees them all
        parts = memory, memory[: 2 * n], memory[:n], memory[n : 2 * n], memory[2 * n : 3 * n]
        self._all, self._motion, self.u, self.v, self.a = map(linear_algebra.vector_in, parts)
        self._drive = linear_algebra.vector_in(memory[3 * n :])
        self._residual, self._load, self._response, self._point = (new_vector(n) for _ in range(4))
        self._rayleigh = o.rayleigh and [new_vector(n, values) for values in o.rayleigh]
        self._products: RayleighProducts | None = None
        self._base_columns = matrix(base, MPI.COMM_SELF)
        self._stacks: list[PETSc.Mat] = []
        self._drive_memory = memoryview(self._drive.array).cast("B").cast("d")
        self._moved = np.diff(sp.csr_matrix(o.gap_matrix).indptr) > 0  # pairs of this rank's dofs
        self._rate = linear_algebra.RankSums(o.n_pairs, o.comm, np.flatnonzero(self._moved))
        self._impulse, self._force = (  # all ranks know them
            linear_algebra.RankSums(o.n_pairs, MPI.COMM_SELF) for _ in range(2)
        )
        self._base_table: FloatArray | None = None
        self._base_states: Sequence[BaseState] = [[0.0] * (3 + 3 * o.n_forces)]
        self._step = 0
        self._make_views()
        self._dissipated = self.contact_damped = 0.0
        self.damped: FloatArray = np.zeros(o.n_pairs)
        self.pair_state = PairState.at_start(o.n_pairs)
        self.is_resting = False
        self.spring_stiffness = 0.0
        self._roots = None if o.pair_weights is None else np.sqrt(o.pair_weights)

    def _factor(
        self, of_damping: float, of_stiffness: float, prefix: str, scale: float
    ) -> linear_algebra.PetscFactor:
        """Return the factor of scale (M + of_damping C + of_stiffness K) (collective)."""
        mass, damping, stiffness = self._blocks
        total = mass.copy()
        for factor, term in ((of_damping, damping), (of_stiffness, stiffness)):
            if factor:
                total.axpy(factor, term)
        return linear_algebra.PetscFactor(total, prefix, scale, like=self.operators.stiffness)

    @property
    def dissipated(self) -> float:
        """Energy that damping has taken from the free dofs so far [J] (collective).

        Reading it adds the shares of the ranks; a run continued from a file has the same bits.
        """
        (total,) = linear_algebra.added([self._dissipated], self.comm)
        self._dissipated = total if self.comm.rank == 0 else 0.0
        return total

    @dissipated.setter
    def dissipated(self, value: float) -> None:
        self._dissipated = value if self.comm.rank == 0 else 0.0

    def begin(self, base_states: FloatArray) -> Sequence[BaseState]:
        """Begin a period; return the given states as lists.

        Args:
            base_states: q, q', q'' of the base, and of further forces, at the start and at each
                step, shape (k, 3 + 3 n_forces). The
                lists of a read-only table are kept for the next period, as they cost as much as a
                quarter of its steps.
        """
        if self._base_table is not base_states or base_states.flags.writeable:
            self._base_table, self._base_rows = base_states, base_states.tolist()
        self._base_states = self._base_rows
        self._step = 0
        self.damped = np.zeros_like(self.damped)  # a record keeps that of its period
        if self._products is not None:
            self._products.forget()
        self._see()  # as a run does that continues from a file
        return self._base_rows

    def _set_forces(self, base_state: BaseState) -> BaseState:
        """Set the further forces of a state of the drives; return that of the base."""
        drive = self._drive_memory
        for j in range(self._n_forces):
            drive[3 + j] = base_state[3 + 3 * j]
        return base_state[:3]

    def _add_base(self, base_state: BaseState) -> None:
        """Add the load of a motion of the base, and of further forces, to the residual."""
        drive, residual = self._drive_memory, self._residual
        if self._n_forces:
            base_state = self._set_forces(base_state)
        drive[0], drive[1], drive[2] = base_state
        self._base_columns.multAdd(self._drive, residual, residual)

    @property
    def _is_narrow(self) -> bool:
        """Whether the matrices are serial and those of beams, or of small solids."""
        K = self._blocks[2]
        return K.comm.size == 1 and not linear_algebra.is_wide(K)

    def _stack(self, ahead: float, inertia: float) -> PETSc.Mat | None:
        """Return the matrix of a residual; None for solids, whose memory it would double."""
        M, C, K = self._blocks
        if not self._is_narrow:
            return None
        stack = linear_algebra.stacked(M, C, K, self._base_columns, ahead, inertia)
        self._stacks.append(stack)
        return stack

    def _find_residual(
        self,
        base_state: BaseState,
        stack: PETSc.Mat | None = None,
        ahead: float = 0.0,
        inertia: float = 0.0,
    ) -> None:
        """Write K (u + ahead v) + C v + inertia M a - f to the residual (collective).

        Args:
            base_state: (q, q', q'') of the base, from which f comes.
            stack: `_stack` of the same numbers; None: the products are made one by one, or known.
            ahead: factor of v [s].
            inertia: factor of M a.
        """
        residual = self._residual
        if stack is not None:
            drive = self._drive_memory
            if self._n_forces:
                base_state = self._set_forces(base_state)
            drive[0], drive[1], drive[2] = base_state
            stack.mult(self._all, residual)
            return
        if self._products is not None:
            self._products.refresh(self.u, self.v, self.a)
            self._products.pull(ahead, inertia, residual)
            self._add_base(base_state)
            return
        v, point, load = self.v, self._point, self._load
        point.waxpy(ahead, v, self.u)
        if self._rayleigh is None:
            self._C.mult(v, load)
            self._K.multAdd(point, load, residual)
            load.zeroEntries()
        else:  # C v = M (α v) + K (β v) needs no product of its own
            alpha, beta = self._rayleigh
            load.pointwiseMult(beta, v)
            point.axpy(1.0, load)
            self._K.mult(point, residual)
            load.pointwiseMult(alpha, v)
        load.axpy(inertia, self.a)
        self._M.multAdd(load, residual, residual)
        self._add_base(base_state)

    def begin_step(self, before: BaseState, after: BaseState) -> None:
        """Begin a single step, over which the base moves between two states (q, q', q'')."""
        self._base_states = [before, after]
        self._step = 0

    def remember(self, pair_state: PairState) -> None:
        """Set what is remembered of the pairs."""
        self.pair_state = pair_state
        self.is_resting = bool(pair_state.resting.any())
        self._reach = math.nan

    # -- for refined steps ---------------------------------------------------------------------

    def margins(self) -> tuple[FloatArray, FloatArray]:
        """Return gaps and gap rates, both (n_pairs,), with the other sign for pairs on springs.

        A gap that falls below 0 means that a pair closes, or that a pair on a spring opens.
        """
        gap, rate = self._gap_values, self._rate_values
        if self.is_resting and self.spring_stiffness:
            sign = np.where(self.pair_state.resting, -1.0, 1.0)
            gap = sign * gap
            rate = sign * rate
        return gap, rate

    def nearness(self, reach: float, slow: float) -> int:
        """Return `refinement.nearness` of the present state.

        The state is the end of a step and the start of the next one, so the answer is kept for the
        same reach; `slow` does not change from step to step.
        """
        if self._reach != reach:
            self._nearness = nearness(*self.margins(), reach, slow)
            self._reach = reach
        return self._nearness

    def _make_views(self) -> None:
        """Create the matrix and vectors of gaps, gap rates and recorded quantities."""
        o = self.operators
        rows = sp.csr_matrix(np.vstack([o.base.mass, o.base.damping, o.base.stiffness]))
        of_u = sp.vstack([rows, o.observed])
        of_v = o.observed
        blocks = [[o.gap_matrix, None], [None, o.gap_matrix], [of_u, None], [None, of_v]]
        self._view = matrix(sp.bmat(blocks), MPI.COMM_SELF)
        self._at_rest = self._view.createVecLeft()
        if o.comm.rank == 0:  # the contributions of all ranks are added
            self._at_rest.array[: o.n_pairs] = o.gap0
        self._probe_shift = o.probe_shift if o.base.shift is not None else None
        is_sent = np.ones(self._at_rest.getSize(), dtype=np.bool_)
        is_sent[: o.n_pairs] = self._moved | (o.comm.rank == 0)
        is_sent[o.n_pairs : 2 * o.n_pairs] = self._moved
        self._seen = linear_algebra.RankSums(is_sent.size, o.comm, np.flatnonzero(is_sent))
        ends = np.cumsum([o.n_pairs, o.n_pairs, of_u.shape[0]])
        self._gap_values, self._rate_values, seen_u, seen_v = np.split(self._seen.values, ends)
        self.seen_u: FloatArray = seen_u
        self.seen_base = seen_u[:N_BASE]
        self.seen_v: FloatArray = seen_v
        self._gap_vector, self._rate_vector = (
            linear_algebra.vector_in(values) for values in (self._gap_values, self._rate_values)
        )
        self._nearness = 0
        self._reach = math.nan
        self._see()

    def _see(self) -> None:
        """Compute gaps, rates, `seen_u` and `seen_v`; what changes the state ends with this."""
        if self._probe_shift is not None:
            q, dq = self._base_states[self._step][:2]
            n = self._probe_shift.size
            self._at_rest.array[-2 * n : -n] = q * self._probe_shift
            self._at_rest.array[-n:] = dq * self._probe_shift
        self._view.multAdd(self._motion, self._at_rest, self._seen.own)
        self._seen.gather()
        self._reach = math.nan

    # -- for contact laws ------------------------------------------------------------------------

    @property
    def gap(self) -> FloatArray:
        """Gaps of the candidate state, shape (n_pairs,) [m]."""
        return self._gap_values

    def rate_free(self) -> FloatArray:
        """Return H v without impulses, shape (n_pairs,) [m/s]."""
        return self._rate_values

    def rate_noise(self) -> float:
        """Return max Σ_j |H_kj| (`OF_PLACE` |u_j| / Δt + `OF_SPEED` |v_j|), or 0 [m/s]."""
        if not self.is_touching:
            return 0.0
        size, place = self._point, self._load
        self.v.copy(size)
        size.abs()
        self.u.copy(place)
        place.abs()
        size.axpby(OF_PLACE / self.time_step, OF_SPEED, place)
        self._absolute_H.mult(size, self._rate.own)
        return float(self._rate.gather().max())

    def _compliance(self, factor: linear_algebra.PetscFactor) -> linear_algebra.LazyCompliance:
        """Return H B⁻¹ Hᵀ of a factorised matrix B."""
        return linear_algebra.LazyCompliance(self.operators.n_pairs, partial(self._column, factor))

    def _find_load(self, pairs: IntArray | int, impulses: FloatArray | float) -> None:
        """Write the load Hᵀ p of impulses p on some pairs to `_load`."""
        self._impulse.values[:] = 0.0
        self._impulse.values[pairs] = impulses
        self._H.multTranspose(self._impulse.total, self._load)

    def _column(self, factor: linear_algebra.PetscFactor, pair: int) -> FloatArray:
        """Return H B⁻¹ Hᵀ e of the unit vector e of a pair, shape (n_pairs,)."""
        self._find_load(pair, 1.0)
        factor.solve(self._load, self._response)
        self._H.mult(self._response, self._rate.own)
        return factor.scale * self._rate.gather()

    # -- for recorders ------------------------------------------------------------------------

    def finish_step(self) -> None:
        """Do nothing: `seen_u` and `seen_v` are always those of the present state."""

    def energies(self) -> Energies:
        """Return the energies of the whole system, base included, in the fixed frame [J]."""
        base = self.operators.base
        q, dq = self._base_states[self._step][:2]
        self._M.mult(self.v, self._load)
        with np.errstate(invalid="ignore", over="ignore"):  # the outcome tells of such a motion
            local_sums = [float(base.mass.dot(self.v.array)), self._load.dot(self.v)]
            self._K.mult(self.u, self._load)
            local_sums += [self._load.dot(self.u), float(base.stiffness.dot(self.u.array))]
            if self.operators.load is not None:
                local_sums[2] -= 2.0 * float(self.operators.load.dot(self.u.array))
        momentum, of_mass, of_stiffness, attachment = linear_algebra.added(local_sums, self.comm)
        kinetic = 0.5 * of_mass + dq * momentum
        strain = 0.5 * of_stiffness + q * attachment
        return Energies(
            kinetic + 0.5 * base.corner[0] * dq * dq,
            strain + 0.5 * base.corner[2] * q * q,
            self.spring_energy(self.pair_state.resting),
            momentum,
        )

    def spring_energy(self, pairs: BoolArray) -> float:
        """Return the energy of springs on some pairs at the current gaps [J]."""
        if not self.spring_stiffness:
            return 0.0
        gap = self._of_springs(self._gap_values, pairs)
        return 0.5 * self.spring_stiffness * float(gap @ gap)

    def _of_springs(self, values: FloatArray, pairs: IntArray | BoolArray) -> FloatArray:
        """Return gaps or gap rates of spring pairs, times √w if pairs have weights."""
        return values[pairs] if self._roots is None else self._roots[pairs] * values[pairs]

    def state(self) -> FloatArray:
        """Return (u, v, a) of the own dofs, shape (3, n_own)."""
        return np.array([vector.array for vector in (self.u, self.v, self.a)])

    def restore(self, state: FloatArray) -> None:
        """Take over (u, v, a) of the own dofs, shape (3, n_own)."""
        for row, vector in zip(state, (self.u, self.v, self.a), strict=True):
            vector.array[:] = row
        if self._products is not None:
            self._products.forget()
        self._see()

    @property
    def n_shares(self) -> int:
        """Number of ranks that the order of gathered values depends on; 1: it depends on none."""
        return self.comm.size if self.operators.order is None else 1

    def gather(self, share: FloatArray) -> FloatArray:
        """Return values of all dofs from those of the own dofs, the last axis (collective)."""
        return self.operators.of_all(share)

    def scatter(self, of_all: FloatArray) -> FloatArray:
        """Return the values of the own dofs among those of all dofs, the last axis."""
        order = self.operators.order
        return of_all[..., self.operators.own if order is None else order]

    def destroy(self) -> None:
        """Free all PETSc objects."""
        o = self.operators
        for product in (self._M, self._C, self._K):
            if isinstance(product, linear_algebra.SpreadProduct):
                product.destroy()
        if self._products is not None:
            self._products.destroy()
        matrices = (o.mass, o.damping, o.stiffness) if self._is_owner else ()
        for thing in (
            *(self._rate, self._impulse, self._force, self._gap_vector, self._rate_vector),
            *(self._seen, self._at_rest, *matrices, self._H, self._absolute_H, self._view),
            *(self._all, self._motion, self.u, self.v, self.a),
            *(self._residual, self._load, self._response, self._point),
            *(self._rayleigh or ()),
            *(self._base_columns, self._drive, *self._stacks),
        ):
            thing.destroy()
