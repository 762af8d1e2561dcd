"""The PETSc state that every stepper shares: matrices, vectors, gaps, resting pairs, energies.

A stepper adds the time integration. All vectors are allocated once; the time loop only fills them.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeAlias

import numpy as np
import scipy.sparse as sp
from petsc4py import PETSc

from delam_fem.engines.petsc import linear_algebra
from delam_fem.model.operators import Operators
from delam_fem.numerics.arrays import BoolArray, FloatArray
from delam_fem.simulation.energy import Energies

BaseState: TypeAlias = Sequence[float]
"""(q, q', q'') of the base at an instant [m, m/s, m/s2]."""


class Dynamics:
    """Matrices and state of M a + C v + K u = f(t) + contact, in PETSc.

    Attributes:
        operators: the semi-discrete problem.
        u, v, a: displacements, velocities and accelerations of the free dofs.
        resting: pairs at rest, shape (n_pairs,); the array is replaced, never written to.
        is_resting: whether any pair rests.
        spring_stiffness: stiffness of the spring that a resting pair carries [N/m]; 0: no spring.
        dissipated: energy that damping has taken from the free dofs so far [J].
        contact_damped: energy that contact dampers have taken so far [J].
    """

    def __init__(self, operators: Operators, time_step: float, comm: PETSc.Comm) -> None:
        """Create all matrices and vectors; the state is at rest.

        Args:
            operators: the semi-discrete problem.
            time_step: size of the steps until `use` chooses another one [s].
            comm: PETSc communicator.
        """
        self.operators, self.time_step, self.comm = operators, time_step, comm
        o = operators
        self._M, self._C, self._K, self._H = (
            linear_algebra.matrix(m, comm) for m in (o.mass, o.damping, o.stiffness, o.gap_matrix)
        )
        self.u, self.v, self.a, self._residual, self._load, self._response = (
            self._M.createVecRight() for _ in range(6)
        )
        self._base_mass, self._base_damping, self._base_stiffness = (
            self._vector(c) for c in (o.base.mass, o.base.damping, o.base.stiffness)
        )
        self._kept = [self._M.createVecRight() for _ in range(3)]
        self._kept_losses = (0.0, 0.0)
        self._gap0 = self._H.createVecLeft()
        self._set(self._gap0, o.gap0)
        self._gap, self._rate, self._impulse, self._force = (
            linear_algebra.Shared(self._H.createVecLeft()) for _ in range(4)
        )
        self._make_observation()
        self._base_states: Sequence[BaseState] = [[0.0, 0.0, 0.0]]
        self._step = 0
        self.dissipated = self.contact_damped = 0.0
        self.resting: BoolArray = np.zeros(o.n_pairs, dtype=np.bool_)
        self.is_resting = False
        self.spring_stiffness = 0.0

    def begin(self, base_states: FloatArray) -> None:
        """Begin a period.

        Args:
            base_states: q, q', q'' of the base at the start and at each step, shape (k, 3).
        """
        self._base_states, self._step = base_states.tolist(), 0

    def begin_step(self, before: BaseState, after: BaseState) -> None:
        """Begin a single step, over which the base moves between two states (q, q', q'')."""
        self._base_states, self._step = [before, after], 0

    def rest(self, pairs: BoolArray) -> None:
        """Set which pairs rest, shape (n_pairs,)."""
        self.resting, self.is_resting = pairs, bool(pairs.any())

    # -- for refined steps ---------------------------------------------------------------------

    def keep(self) -> None:
        """Keep the present state for `undo`."""
        for kept, vector in zip(self._kept, (self.u, self.v, self.a), strict=True):
            vector.copy(kept)
        self._kept_losses = self.dissipated, self.contact_damped

    def undo(self) -> None:
        """Return to the state of the last `keep`; resting pairs are those of the present."""
        for kept, vector in zip(self._kept, (self.u, self.v, self.a), strict=True):
            kept.copy(vector)
        self.dissipated, self.contact_damped = self._kept_losses

    def near(self, ahead: float) -> tuple[BoolArray, FloatArray]:
        """Return which pairs may close (F1 of refinement.py), and gap rates, both (n_pairs,).

        Args:
            ahead: time over which gap rates are extrapolated; negative: backwards [s].
        """
        self._H.multAdd(self.u, self._gap0, self._gap.vector)
        gap, rate = self._gap.gather(), self.gap_rate()
        if self.is_resting and self.spring_stiffness:  # these must not open
            sign = np.where(self.resting, -1.0, 1.0)
            gap, rate = sign * gap, sign * rate
        return np.asarray(gap + np.minimum(ahead * rate, 0.0) <= 0.0), rate

    def _make_observation(self) -> None:
        """Create the matrices and vectors of the recorded quantities."""
        o = self.operators
        rows = sp.csr_matrix(np.vstack([o.base.mass, o.base.damping, o.base.stiffness]))
        self._observe_u = linear_algebra.matrix(sp.vstack([rows, o.observed]), self.comm)
        self._observe_v = linear_algebra.matrix(o.observed, self.comm)
        self._seen_u = linear_algebra.Shared(self._observe_u.createVecLeft())
        self._seen_v = linear_algebra.Shared(self._observe_v.createVecLeft())
        self.seen_u: FloatArray = self._seen_u.values
        self.seen_v: FloatArray = self._seen_v.values

    def _set(self, vector: PETSc.Vec, values: FloatArray) -> None:
        vector.array[:] = values[slice(*vector.getOwnershipRange())]

    def _vector(self, values: FloatArray) -> PETSc.Vec:
        result = self._M.createVecRight()
        self._set(result, values)
        return result

    # -- for contact laws ------------------------------------------------------------------------

    @property
    def gap(self) -> FloatArray:
        """Gaps of the candidate state, shape (n_pairs,) [m]."""
        return self._gap.gather()

    def gap_rate(self) -> FloatArray:
        """Return H v, shape (n_pairs,) [m/s]."""
        self._H.mult(self.v, self._rate.vector)
        return self._rate.gather()

    def response(self, factor: linear_algebra.Factor, pair: int) -> FloatArray:
        """Return H x, where x is the factor's solution for a unit load on a pair, (n_pairs,)."""
        self._impulse.values[:] = 0.0
        self._impulse.values[pair] = 1.0
        self._impulse.spread()
        self._H.multTranspose(self._impulse.vector, self._load)
        factor.solve(self._load, self._response)
        # new vectors, because a law may still read the values of the usual ones
        gaps = linear_algebra.Shared(self._H.createVecLeft())
        self._H.mult(self._response, gaps.vector)
        result = gaps.gather().copy()
        gaps.destroy()
        return result

    # -- for recorders ------------------------------------------------------------------------

    def observe(self) -> None:
        """Update `seen_u` = (m_b·u, c_b·u, k_b·u, probes of u) and `seen_v` = (probes of v)."""
        self._observe_u.mult(self.u, self._seen_u.vector)
        self._observe_v.mult(self.v, self._seen_v.vector)
        self._seen_u.gather()
        self._seen_v.gather()

    def energies(self) -> Energies:
        """Return the energies of the whole system, base included, in the fixed frame [J]."""
        base = self.operators.base
        q, dq, _ = self._base_states[self._step]
        self._M.mult(self.v, self._load)
        momentum = self._base_mass.dot(self.v)
        kinetic = 0.5 * self._load.dot(self.v) + dq * momentum
        self._K.mult(self.u, self._load)
        strain = 0.5 * self._load.dot(self.u) + q * self._base_stiffness.dot(self.u)
        return Energies(
            kinetic + 0.5 * base.corner[0] * dq * dq,
            strain + 0.5 * base.corner[2] * q * q,
            self.spring_energy(self.resting),
            momentum,
        )

    def spring_energy(self, pairs: BoolArray) -> float:
        """Return the energy of springs on some pairs at the current gaps [J]."""
        if not self.spring_stiffness:
            return 0.0
        self._H.multAdd(self.u, self._gap0, self._gap.vector)
        gap = self._gap.gather()[pairs]
        if self.operators.pair_weights is not None:
            gap = gap * np.sqrt(self.operators.pair_weights[pairs])
        return 0.5 * self.spring_stiffness * float(gap @ gap)

    def state(self) -> FloatArray:
        """Return (u, v, a) of all dofs on every rank, shape (3, n)."""
        result = np.empty((3, self.operators.n_dofs))
        for row, vector in zip(result, (self.u, self.v, self.a), strict=True):
            row[:] = self._whole(vector)
        return result

    def restore(self, state: FloatArray) -> None:
        """Take over (u, v, a), shape (3, n)."""
        for row, vector in zip(state, (self.u, self.v, self.a), strict=True):
            self._set(vector, row)

    def _whole(self, vector: PETSc.Vec) -> FloatArray:
        if self.comm.size == 1:
            return np.array(vector.array)
        scatter, whole = PETSc.Scatter.toAll(vector)
        scatter.scatter(vector, whole)
        result = np.array(whole.array)
        scatter.destroy()
        whole.destroy()
        return result

    def destroy(self) -> None:
        """Free all PETSc objects."""
        for shared in (
            self._gap,
            self._rate,
            self._impulse,
            self._force,
            self._seen_u,
            self._seen_v,
        ):
            shared.destroy()
        for thing in (
            self._M,
            self._C,
            self._K,
            self._H,
            self._observe_u,
            self._observe_v,
            self.u,
            self.v,
            self.a,
            self._residual,
            self._load,
            self._response,
            *self._kept,
            self._gap0,
            self._base_mass,
            self._base_damping,
            self._base_stiffness,
        ):
            thing.destroy()
