"""The Moreau–Jean θ-scheme in PETSc, with Rayleigh damping at one product with K and one with M.

Impulses belong to the step in which they act:

    Â (v⁺ - v) = Δt [f_θ - C v - K (u + θ Δt v)] + Hᵀ p,   Â = M + θ Δt C + θ² Δt² K      (J1)
    u⁺ = u + Δt [θ v⁺ + (1 - θ) v]
    0 <= p  ⊥  U̇⁺ + e U̇ >= 0   on the pairs with U + Δt/2 U̇ <= 0                           (J2)

f_θ = θ f⁺ + (1 - θ) f is the base load within the step. For θ = 1/2 energy is conserved between
impacts.

With Rayleigh damping

    C = α M + β K,   α and β constant on each body, so that they commute with M and K

the forces before a solve need one product with K, because M v is kept up to date:

    K (u + t v) + C v = K (u + t v + β v) + α M v                                            (R1)

The loss by damping needs C Δ of the change Δ of the velocities, which solves

    B Δ = b,   B = M + c C + k K = (1 + c α) M + (c β + k) K,
    C Δ = β b / (c β + k) + (α - β (1 + c α) / (c β + k)) M Δ                                (R2)

and with s = vᵀ C v, t = v₀ᵀ C (v - v₀) and v_θ = (1 - θ) v₀ + θ v

    v_θᵀ C v_θ = s₀ + 2 θ t + θ² (s - s₀ - 2 t)                                              (R3)

M couples equal components only: it has a half of the entries of K in 2D, a third in 3D. Three
products with K or C would do otherwise. M v and s are computed anew at the start of each period, so
that a run that continues from a file has the same bits. K u and K v cannot be kept in the same way:
the round-off of stiff modes would add up from step to step, to 1e-6 of the motion within a period
for laminae 1 mm thick. In R3 round-off only touches the account of the damping loss.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np
from petsc4py import PETSc

from delam_fem.contact.decisions import Decision
from delam_fem.contact.rules import CLOSED
from delam_fem.engines.petsc import linear_algebra
from delam_fem.engines.petsc.dynamics import BaseState, Dynamics
from delam_fem.engines.petsc.linear_algebra import LazyCompliance, Product, new_vector
from delam_fem.model.operators import DistributedOperators, Operators
from delam_fem.numerics.types import BoolArray, FloatArray, IntArray
from delam_fem.system.mpi import MPI

Weights: TypeAlias = tuple[PETSc.Vec, PETSc.Vec]
"""Factors of R2; see `RayleighDamping.weights`."""


class RayleighDamping:
    """Rayleigh damping of the own dofs: M v and s = vᵀ C v, and the damping loss of a step."""

    def __init__(self, M: Product, K: Product, rayleigh: tuple[FloatArray, FloatArray]) -> None:
        """Store the matrices and create vectors; the velocity is 0.

        Args:
            M: mass.
            K: stiffness.
            rayleigh: α and β at the own dofs, each of shape (n_own,) [1/s, s].
        """
        self._M = M
        self._K = K
        self.rayleigh = rayleigh
        n = rayleigh[0].size
        self._alpha, self._beta = (new_vector(n, values) for values in rayleigh)
        self._momentum, self._kept_momentum, self._work, self._point = (
            new_vector(n) for _ in range(4)
        )
        self._square = self._square_start = self._cross = self._kept_square = 0.0

    def weights(self, c: float, k: float, scale: float) -> Weights:
        """Return the factors of R2 for a matrix s B, with which s B Δ = b gives C Δ.

        Returns:
            Those of the load, β / (s (c β + k)), and of the inertia, α - β (1 + c α) / (c β + k).
        """
        alpha, beta = self.rayleigh
        share = beta / (c * beta + k)
        n = share.size
        of_inertia = alpha - share * (1.0 + c * alpha)
        return new_vector(n, share / scale), new_vector(n, of_inertia)

    def renew(self, v: PETSc.Vec) -> None:
        """Compute M v and s = vᵀ C v anew (collective)."""
        self._M.mult(v, self._momentum)
        self._K.mult(v, self._work)
        self._work.pointwiseMult(self._beta, self._work)
        self._point.pointwiseMult(self._alpha, self._momentum)
        self._square = self._work.dot(v) + self._point.dot(v)

    def keep(self) -> None:
        """Keep the present numbers for `undo`."""
        self._momentum.copy(self._kept_momentum)
        self._kept_square = self._square

    def undo(self) -> None:
        """Return to the numbers of the last `keep`."""
        self._kept_momentum.copy(self._momentum)
        self._square = self._kept_square

    def pull(self, u: PETSc.Vec, v: PETSc.Vec, ahead: float, result: PETSc.Vec) -> None:
        """Write K (u + ahead v) + C v to `result` (R1) and begin a step (collective)."""
        self._square_start = self._square
        self._cross = 0.0
        self._work.pointwiseMult(self._beta, v)
        self._point.waxpy(ahead, v, u)
        self._point.axpy(1.0, self._work)
        self._K.mult(self._point, result)
        self._work.pointwiseMult(self._alpha, self._momentum)
        result.axpy(1.0, self._work)

    def add(
        self,
        change: PETSc.Vec,
        factor: float,
        v: PETSc.Vec,
        start: PETSc.Vec,
        load: PETSc.Vec,
        weights: Weights,
    ) -> None:
        """Account for a change of the velocities in M v and s, before it is made (collective).

        Args:
            change: Δ, the solution for a load.
            factor: the multiple of Δ that is added to the velocities.
            v: velocities before the change.
            start: velocities at the start of the step.
            load: the load that Δ is the solution for.
            weights: the factors of R2 for the matrix.
        """
        inertia, damped = self._point, self._work
        self._M.mult(change, inertia)
        self._momentum.axpy(factor, inertia)
        of_load, of_inertia = weights
        damped.pointwiseMult(of_load, load)
        inertia.pointwiseMult(of_inertia, inertia)
        damped.axpy(1.0, inertia)
        self._square += 2.0 * factor * damped.dot(v) + factor**2 * damped.dot(change)
        self._cross += factor * damped.dot(start)

    def power(self, theta: float) -> float:
        """Return the own share of v_θᵀ C v_θ by R3 [W]."""
        first, cross = self._square_start, self._cross
        return first + 2.0 * theta * cross + theta**2 * (self._square - first - 2.0 * cross)

    def destroy(self) -> None:
        """Free the vectors."""
        for vector in (
            *(self._alpha, self._beta, self._momentum, self._kept_momentum),
            *(self._work, self._point),
        ):
            vector.destroy()


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
        weights: factors of R2; None: C has another form.
        responses: by pair, what a unit impulse adds to the motion, and to what is seen of it.
    """

    time_step: float
    A: linear_algebra.PetscFactor
    stack: PETSc.Mat | None
    W: LazyCompliance
    weights: Weights | None
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
        self._damping: RayleighDamping | None = None
        if self.operators.rayleigh is not None:
            self._damping = RayleighDamping(self._M, self._K, self.operators.rayleigh)
        self._sizes = [self._size(dt) for dt in time_steps]
        self._last_size = len(time_steps) - 1
        self._now = self._sizes[-1]
        self.compliance = _PresentCompliance(self._now.W)
        self._motion_start = self._motion.duplicate()
        self._start = linear_algebra.vector_in(self._motion_start.array[self.operators.n_own :])
        size = self.operators.n_dofs * self.operators.n_pairs
        self._has_room = self._damping is None and size <= ROOM
        self._none_resting = self.resting
        self._is_unaccounted = False
        self._predicted, self._rate_start = (  # sums of all ranks from the beginning
            linear_algebra.RankSums(self.operators.n_pairs, MPI.COMM_SELF) for _ in range(2)
        )

    def _size(self, time_step: float) -> _ThetaSize:
        """Return a size of steps with its factor, whose scale makes the residual give v⁺ - v."""
        reach = self._theta * time_step
        scale = -1.0 / time_step
        damping = self._damping
        factor = self._factor(reach, reach**2, "moreau_", scale)
        weights = None if damping is None else damping.weights(reach, reach**2, scale)
        stack = None if damping is not None else self._stack(reach, 0.0)
        return _ThetaSize(time_step, factor, stack, self._compliance(factor), weights)

    def begin(self, base_states: FloatArray) -> Sequence[BaseState]:
        """Begin a period; see `Dynamics`."""
        rows = super().begin(base_states)
        if self._damping is not None:
            self._damping.renew(self.v)
        return rows

    def restore(self, state: FloatArray) -> None:
        """Take over (u, v, a) of the own dofs, shape (3, n_own)."""
        super().restore(state)
        self._is_unaccounted = False

    def keep(self) -> None:
        """Keep the present state for `undo`; the motion itself is kept by each step."""
        if self._damping is not None:
            self._damping.keep()

    def undo(self) -> None:
        """Return to the state of the last `keep`, before the last step."""
        self._motion_start.copy(self._motion)
        self._see()
        if self._damping is not None:
            self._damping.undo()
        self._is_unaccounted = False

    def rest(self, pairs: BoolArray) -> None:
        """Set which pairs rest; this is only a report, so that the law need not be asked."""
        self.resting = pairs

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
        self.resting = self._none_resting
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
        if self._damping is None:
            self._find_residual(between, self._now.stack, theta * dt)
        else:
            self._damping.pull(u, v, theta * dt, self._residual)
            self._add_base(between)
        self._is_unaccounted = True
        self._now.A.solve(self._residual, self._response)
        if self._damping is not None:
            self._account(self._residual, 1.0)
        v.axpy(1.0, self._response)
        u.axpy(dt * (1.0 - theta), self._start)
        u.axpy(dt * theta, v)
        self._see()
        if self.is_touching:
            fastest = max(-self._rate_vector.min()[1], self._rate_vector.max()[1])
            self._predicted.own.shift(-CLOSED * dt * fastest)
        return self._predicted.own.min()[1]

    def _account(self, load: PETSc.Vec, factor: float) -> None:
        """Account for the change of velocities that the solution for a load is going to make."""
        assert self._damping is not None and self._now.weights is not None
        self._damping.add(self._response, factor, self.v, self._start, load, self._now.weights)

    def jump(self, decision: Decision) -> tuple[float, float]:
        """Add the impulses of a decision to the step.

        Returns:
            Change of energy by the impulses, and by switching springs (0) [J].
        """
        responses, twice, (hit, impulses, pre, post, resting) = self._now.responses, 0.0, decision
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
            if self._damping is not None:
                self._account(self._load, self._now.A.scale)
            self.v.axpy(self._now.A.scale, self._response)
            self.u.axpy(-self._theta, self._response)
            self._see()
        if resting is not None:
            self.resting = resting
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
        if self._damping is not None:
            power = self._damping.power(self._theta)
        else:
            theta, within, load = self._theta, self._point, self._load
            within.waxpy((1.0 - theta) / theta, self._start, self.v)  # v_θ / θ
            self._C.mult(within, load)
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
            for weight in size.weights or ():
                weight.destroy()
        if self._damping is not None:
            self._damping.destroy()
        for thing in (self._motion_start, self._start, self._predicted, self._rate_start):
            thing.destroy()
        super().destroy()
