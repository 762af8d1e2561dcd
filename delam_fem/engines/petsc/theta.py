"""The Moreau–Jean θ-scheme in PETSc.

Impulses belong to the step in which they act:

    Â (v⁺ - v) = Δt [f_θ - C v - K (u + θ Δt v)] + Hᵀ p,   Â = M + θ Δt C + θ² Δt² K      (J1)
    u⁺ = u + Δt [θ v⁺ + (1 - θ) v]
    0 <= p  ⊥  U̇⁺ + e U̇ >= 0   on the pairs with U + Δt/2 U̇ <= 0                           (J2)

f_θ = θ f⁺ + (1 - θ) f is the base load within the step. For θ = 1/2 energy is conserved between
impacts.

Its loss by damping in a step is Δt v_θᵀ C v_θ with v_θ = (1 - θ) v + θ v⁺.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from petsc4py import PETSc

from delam_fem.contact.decisions import Decision, PairState
from delam_fem.contact.rules import CLOSED
from delam_fem.engines.petsc import linear_algebra
from delam_fem.engines.petsc.dynamics import BaseState, Dynamics
from delam_fem.engines.petsc.linear_algebra import LazyCompliance
from delam_fem.engines.petsc.rayleigh import RayleighProducts, Weights
from delam_fem.model.operators import DistributedOperators, Operators
from delam_fem.numerics.types import FloatArray, IntArray
from delam_fem.system.mpi import MPI

ROOM = 1_000_000
"""Dofs times pairs up to which the responses to impulses are kept: contact returns to few pairs."""


@dataclass(frozen=True)
class _ThetaSize:
    """A size of steps, with what belongs to it.

    Attributes:
        time_step: Δt [s].
        A: factor of Â.
        stack: `Dynamics._stack` of the forces before a solve.
        W: compliance H Â⁻¹ Hᵀ of the pairs.
        weights: factors of `RayleighProducts`.
        responses: by pair, what a unit impulse adds to the motion, and to what is seen of it.
    """

    time_step: float
    A: linear_algebra.PetscFactor
    stack: PETSc.Mat | None
    W: LazyCompliance
    weights: Weights
    responses: dict[int, tuple[PETSc.Vec, PETSc.Vec]] = field(default_factory=dict)


class _PresentCompliance:
    """W of the size of steps that a stepper uses at present."""

    def __init__(self, present: LazyCompliance) -> None:
        """Store the first one; the stepper replaces it when it chooses another size."""
        self.present = present

    @property
    def recent(self) -> tuple[IntArray, FloatArray]:
        """The pairs that `block` was asked for last and their block, or `NO_BLOCK`."""
        return self.present.recent

    def diagonal(self, pairs: IntArray) -> FloatArray:
        """Return W_kk of some pairs, shape (k,) [1/kg]."""
        return self.present.diagonal(pairs)

    def block(self, pairs: IntArray) -> FloatArray:
        """Return the rows and columns of W of some pairs, shape (k, k) [1/kg]."""
        return self.present.block(pairs)


class MoreauJean(Dynamics):
    """The stepper of the θ-scheme, with `advance` for free motions and `jump` for impulses (J2)."""

    def __init__(
        self,
        operators: Operators | DistributedOperators,
        *time_steps: float,
        theta: float = 0.5,
        comm: MPI.Intracomm = MPI.COMM_SELF,
    ) -> None:
        """Factorise Â for each size of steps; the state is at rest.

        Args:
            operators: the semi-discrete problem.
            time_steps: sizes of steps, from coarse to fine [s]; the last one is in use at first.
            theta: θ, from 1/2 (no numerical damping) to 1.
            comm: communicator that shares the work.
        """
        super().__init__(operators, time_steps[-1], comm)
        self._theta = theta
        if self.operators.rayleigh is not None:
            self._products = RayleighProducts(self._M, self._K, self.operators.rayleigh)
        self._sizes = [self._size(dt) for dt in time_steps]
        self._last_size = len(time_steps) - 1
        self._now = self._sizes[-1]
        self.compliance = _PresentCompliance(self._now.W)
        self._motion_start = self._motion.duplicate()
        self._start = linear_algebra.vector_in(self._motion_start.array[self.operators.n_own :])
        size = self.operators.n_dofs * self.operators.n_pairs
        self._has_room = self._products is None and size <= ROOM
        self._none_resting = self.pair_state.resting
        self._is_unaccounted = False
        self._predicted, self._rate_start = (  # sums of all ranks from the beginning
            linear_algebra.RankSums(self.operators.n_pairs, MPI.COMM_SELF) for _ in range(2)
        )

    def _size(self, time_step: float) -> _ThetaSize:
        """Return a size of steps with its factor, whose scale makes the residual give v⁺ - v."""
        reach = self._theta * time_step
        scale = -1.0 / time_step
        factor = self._factor(reach, reach**2, "moreau_", scale)
        W = self._compliance(factor)
        if self._products is None:
            return _ThetaSize(time_step, factor, self._stack(reach, 0.0), W, ())
        return _ThetaSize(
            time_step, factor, None, W, self._products.weights(reach, reach**2, scale)
        )

    def restore(self, state: FloatArray) -> None:
        """Take over (u, v, a) of the own dofs, shape (3, n_own)."""
        super().restore(state)
        self._is_unaccounted = False

    def keep(self) -> None:
        """Do nothing: each step keeps the state at its start for `undo`."""

    def undo(self) -> None:
        """Return to the state of the last `keep`, before the last step."""
        self._motion_start.copy(self._motion)
        self._see()
        if self._products is not None:
            self._products.undo()
        self._is_unaccounted = False

    def remember(self, pair_state: PairState) -> None:
        """Set what is remembered; pairs that rest are a report: the law need not be asked."""
        self.pair_state = pair_state

    def use(self, level: int) -> None:
        """Choose the size of the next steps by its level; the last one if there are fewer."""
        self._now = self._sizes[min(level, self._last_size)]
        self.time_step, self.compliance.present = self._now.time_step, self._now.W

    @property
    def gap(self) -> FloatArray:
        """Predicted gaps of J2, shape (n_pairs,) [m]."""
        return self._predicted.values

    def rate_pre(self) -> FloatArray:
        """Return gap rates at the start of the step, shape (n_pairs,) [m/s]."""
        return self._rate_start.values

    def advance(self) -> float:
        """Compute the free motion of the next step; return the smallest predicted gap [m]."""
        u, v, dt, theta = self.u, self.v, self.time_step, self._theta
        if self._is_unaccounted:
            self.finish_step()
        self._rate_vector.copy(self._rate_start.own)
        self._predicted.own.waxpy(0.5 * dt, self._rate_vector, self._gap_vector)
        if self.pair_state.resting is not self._none_resting:
            self.pair_state = self.pair_state._replace(resting=self._none_resting)
        self._motion.copy(self._motion_start)
        before = self._base_states[self._step]
        old_share = 1.0 - theta
        self._step += 1
        after = self._base_states[self._step]
        between: BaseState
        if self._n_forces:
            between = [
                theta * new + old_share * old for new, old in zip(after, before, strict=True)
            ]
        else:  # faster
            q, dq, ddq = before
            new_q, new_dq, new_ddq = after
            between = (
                theta * new_q + old_share * q,
                theta * new_dq + old_share * dq,
                theta * new_ddq + old_share * ddq,
            )
        # K (u + θ Δt v) + C v - f_θ, the negative right-hand side of J1 over Δt
        self._find_residual(between, self._now.stack, theta * dt)
        self._is_unaccounted = True
        self._now.A.solve(self._residual, self._response)
        if self._products is not None:
            self._products.begin_step(dt)
            self._products.add(
                self._response, self._residual, self._now.weights, to_u=theta * dt, to_v=1.0
            )
        v.axpy(1.0, self._response)
        u.axpy(dt * (1.0 - theta), self._start)
        u.axpy(dt * theta, v)
        self._see()
        if self.is_touching:
            fastest = max(-self._rate_vector.min()[1], self._rate_vector.max()[1])
            self._predicted.own.shift(-CLOSED * dt * fastest)
        return self._predicted.own.min()[1]

    def jump(self, decision: Decision) -> tuple[float, float]:
        """Add the impulses of a decision to the step.

        Returns:
            Change of energy by the impulses, and by switching springs (0) [J].
        """
        responses = self._now.responses
        twice = 0.0
        hit, impulses, pre, post, pair_state = decision
        of_hit = hit.tolist(), impulses.tolist(), pre.tolist(), post.tolist()
        for pair, impulse, before, after in zip(*of_hit, strict=True):  # faster than NumPy
            twice += impulse * (before + after)
            if self._has_room:
                motion, reading = responses.get(pair) or self._respond(pair)
                self._motion.axpy(impulse, motion)
                self._seen.own.axpy(impulse, reading)
        if self._has_room:
            self._seen.gather()
            self._reach = math.nan
        else:
            self._solve_impulses(hit, impulses)
            to_u = -self._theta
            to_v = self._now.A.scale
            if self._products is not None:
                self._products.add(
                    self._response, self._load, self._now.weights, to_u=to_u, to_v=to_v
                )
            self.v.axpy(to_v, self._response)
            self.u.axpy(to_u, self._response)
            self._see()
        if pair_state is not None:
            self.pair_state = pair_state
        return 0.5 * twice, 0.0

    def _solve_impulses(self, pairs: IntArray, impulses: FloatArray) -> None:
        """Solve with the load of impulses on some pairs."""
        self._find_load(pairs, impulses)
        self._now.A.solve(self._load, self._response)

    def _respond(self, pair: int) -> tuple[PETSc.Vec, PETSc.Vec]:
        """Compute the responses of the present size of steps to a unit impulse on a pair."""
        self._solve_impulses(np.array([pair]), np.ones(1))
        motion = self._motion.duplicate()
        reading = self._at_rest.duplicate()
        by_unit = self._response.array
        # p adds Â⁻¹ Hᵀ p to v⁺ and θ Δt times that to u⁺; the factor's scale is -1/Δt, so that its
        # solution x gives v⁺ += -x/Δt and u⁺ += -θ x
        motion.array[:] = np.concatenate([-self._theta * by_unit, self._now.A.scale * by_unit])
        self._view.mult(motion, reading)
        self._now.responses[pair] = motion, reading
        return motion, reading

    def finish_step(self) -> None:
        """Account for the damping of a completed step."""
        if not self._is_unaccounted:
            return
        self._is_unaccounted = False
        theta, within, load = self._theta, self._point, self._load
        old_share = (1.0 - theta) / theta
        within.waxpy(old_share, self._start, self.v)  # v_θ / θ
        if self._products is None:
            self._C.mult(within, load)
        else:
            self._products.resist(old_share, load)
        power = theta**2 * load.dot(within)
        self._dissipated += self.time_step * power

    def renew_acceleration(self) -> None:
        """Do nothing: the scheme has no acceleration."""

    def destroy(self) -> None:
        """Free all PETSc objects."""
        for size in self._sizes:
            size.A.destroy()
            for response in size.responses.values():
                for vector in response:
                    vector.destroy()
        for thing in (self._motion_start, self._start, self._predicted, self._rate_start):
            thing.destroy()
        super().destroy()
