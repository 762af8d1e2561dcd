"""The Moreau–Jean θ-scheme in PETSc: impulses belong to the step in which they act.

    Â (v⁺ - v) = Δt [f_θ - C v - K (u + θ Δt v)] + Hᵀ p,   Â = M + θ Δt C + θ² Δt² K      (J1)
    u⁺ = u + Δt [θ v⁺ + (1 - θ) v]
    0 <= p  ⊥  U̇⁺ + e U̇ >= 0   on the pairs with U + Δt/2 U̇ <= 0                           (J2)

f_θ = θ f⁺ + (1 - θ) f is the base load within the step. For θ = 1/2 energy is conserved between
impacts.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from petsc4py import PETSc

from delam_fem.contact.decision import Decision
from delam_fem.contact.moreau import CLOSED
from delam_fem.engines.petsc import linear_algebra
from delam_fem.engines.petsc.compliance import LazyCompliance
from delam_fem.engines.petsc.dynamics import Dynamics
from delam_fem.engines.petsc.images import Weights
from delam_fem.model.distributed import DistributedOperators
from delam_fem.model.operators import Operators
from delam_fem.mpi import MPI
from delam_fem.numerics.arrays import FloatArray, IntArray


@dataclass(frozen=True)
class _Size:
    """A size of steps, with the factor of Â for it, W of that Â, and what R2 needs."""

    time_step: float
    A: linear_algebra.Factor
    W: LazyCompliance
    weights: Weights | None


class _PresentCompliance:
    """W of the size of steps that a stepper uses at present."""

    def __init__(self, stepper: MoreauJean) -> None:
        """Store the stepper."""
        self._stepper = stepper

    def diagonal(self, pairs: IntArray) -> FloatArray:
        """Return W_kk of some pairs, shape (k,) [1/kg]."""
        return self._stepper.present_compliance.diagonal(pairs)

    def block(self, pairs: IntArray) -> FloatArray:
        """Return the rows and columns of W of some pairs, shape (k, k) [1/kg]."""
        return self._stepper.present_compliance.block(pairs)


class MoreauJean(Dynamics):
    """A stepper: `advance` computes the free motion, `jump` adds the impulses of J2."""

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
        self._sizes = [self._size(dt) for dt in time_steps]
        self._now = self._sizes[-1]
        self.compliance = _PresentCompliance(self)
        self._start, self._point = (self._stack() for _ in range(2))
        self._is_touching = bool((operators.gap0 <= 0.0).any())
        self._none_resting = self.resting
        self._is_unaccounted = False
        self._predicted, self._rate_start = (
            linear_algebra.Shared(self.operators.n_pairs, self.comm) for _ in range(2)
        )

    def _size(self, time_step: float) -> _Size:
        """Return a size of steps with its factor, whose scale makes the residual give v⁺ - v."""
        reach, scale = self._theta * time_step, -1.0 / time_step
        factor = self._factor(reach, reach**2, "moreau_", scale)
        W = LazyCompliance(self, factor)
        return _Size(time_step, factor, W, self._weights(reach, reach**2, scale))

    def use(self, level: int) -> None:
        """Choose the size of the next steps by its number."""
        self._now = self._sizes[level]
        self.time_step = self._now.time_step

    @property
    def present_compliance(self) -> LazyCompliance:
        """W of the present size of steps."""
        return self._now.W

    @property
    def gap(self) -> FloatArray:
        """Predicted gaps of J2, shape (n_pairs,) [m]."""
        return self._predicted.values

    def rate_pre(self) -> FloatArray:
        """Return gap rates at the start of the step, shape (n_pairs,) [m/s]."""
        return self._rate_start.gather()

    def rate_free(self) -> FloatArray:
        """Return gap rates at the end of the step without impulses, shape (n_pairs,) [m/s]."""
        return self.gap_rate()

    def advance(self) -> float:
        """Compute the free motion of the next step; return the smallest predicted gap [m]."""
        u, v, dt, theta = self._of_u.all, self._of_v.all, self.time_step, self._theta
        rate = self._rate_start.own
        self._H.multAdd(self.u, self._gap0, self._gap.own)
        self._H.mult(self.v, rate)
        self._predicted.own.waxpy(0.5 * dt, rate, self._gap.own)
        self._predicted.gather()
        if self.is_resting:
            self.rest(self._none_resting)
        v.copy(self._start.all)
        self._find_residual()
        self._is_unaccounted = True
        self._solve(self._residual)
        v.axpy(1.0, self._answer.all)
        u.axpy(dt * (1.0 - theta), self._start.all)
        u.axpy(dt * theta, v)
        if self._is_touching:
            fastest = np.abs(self.gap_rate()).max(initial=0.0)
            self._predicted.total.shift(-CLOSED * dt * fastest)
        return float(self._predicted.total.min()[1])

    def _find_residual(self) -> None:
        """Write K (u + θ Δt v) + C v - f_θ, the negative right-hand side of J1 over Δt."""
        residual, theta = self._residual, self._theta
        ahead = theta * self.time_step
        if self._images is None:
            self._point.own.waxpy(ahead, self.v, self.u)
            self._K.mult(self._point.own, residual)
            self._C.multAdd(self.v, residual, residual)
        else:
            residual.waxpy(ahead, self._of_v.stiff, self._of_u.stiff)
            self._images.add_damping(self._of_v, residual)
        before, after = self._base_states[self._step : self._step + 2]
        self._step += 1
        columns = (self._base_stiffness, self._base_damping, self._base_mass)
        for column, old, new in zip(columns, before, after, strict=True):
            residual.axpy(theta * new + (1.0 - theta) * old, column)

    def _solve(self, load: PETSc.Vec) -> None:
        """Write the solution for a load into the answer, with its products if they are kept."""
        self._now.A.solve(load, self._response)
        if self._images is not None and self._now.weights is not None:
            self._images.complete(self._answer, self._now.weights, load)

    def jump(self, decision: Decision) -> tuple[float, float]:
        """Add the impulses of a decision to the step.

        Returns:
            Change of energy by the impulses, and by switching springs (0) [J].
        """
        self._impulse.values[:] = 0.0
        self._impulse.values[decision.hit] = decision.impulses
        self._H.multTranspose(self._impulse.total, self._load)
        self._solve(self._load)
        self._of_v.all.axpy(self._now.A.scale, self._answer.all)
        self._of_u.all.axpy(-self._theta, self._answer.all)
        if decision.resting is not None:
            self.rest(decision.resting)
        mean_rate = 0.5 * (decision.rate_pre + decision.rate_post)
        return float(decision.impulses @ mean_rate), 0.0

    def observe(self) -> None:
        """Update the recorded values, and account for the damping of a completed step."""
        super().observe()
        if not self._is_unaccounted:
            return
        self._is_unaccounted = False
        mean, theta = self._point, self._theta
        mean.all.waxpy((1.0 - theta) / theta, self._start.all, self._of_v.all)  # v_θ / θ
        if self._images is None:
            self._C.mult(mean.own, self._load)
        else:
            self._images.damping(mean, self._load)
        self._dissipated += theta**2 * self.time_step * self._load.dot(mean.own)

    def renew_acceleration(self) -> None:
        """Do nothing: the scheme has no acceleration."""

    def destroy(self) -> None:
        """Free all PETSc objects."""
        for size in self._sizes:
            size.A.destroy()
            if size.weights is not None:
                size.weights.destroy()
        self._start.destroy()
        self._point.destroy()
        self._predicted.destroy()
        self._rate_start.destroy()
        super().destroy()
