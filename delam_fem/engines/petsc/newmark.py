"""Newmark's scheme in PETSc, with the springs of resting pairs as a Woodbury correction.

    A a⁺ = f - C v* - K u*,   A = M + γ Δt C + β Δt² K                                        (N1)
    u* = u + Δt v + (1/2 - β) Δt² a,   v* = v + (1 - γ) Δt a
    u⁺ = u* + β Δt² a⁺,   v⁺ = v* + γ Δt a⁺

β = 1/4, γ = 1/2 is the average acceleration of the paper; β = 0, γ = 1/2 is the central difference.
A is factorised once. With average acceleration the sum of both accelerations is the unknown,

    A (a⁺ + a) = f - C v - K (u + Δt v) + M a                                                 (N1')

After an impact on a stiff body, Δt² a is many times the displacement, and N1 would cancel digits
that the energy needs. With springs λ = k U + c U̇ on the pairs P, the exact correction of the
candidate is

    (I + (k β Δt² + c γ Δt) S_PP) λ = k U + c U̇,   S = H A⁻¹ Hᵀ,   Δa = -A⁻¹ Hᵀ λ            (N2)

If pairs have weights w, the springs act on the gaps times √w: U, H and S stand for √w U, √w H and
√w S √w, so that the stiffness of a pair is w k. If springs have dampings of
their own, k β Δt² + c γ Δt is a diagonal matrix D. With R = √D the matrix I + R S R is symmetric,
and λ = λ₀ + R μ, where λ₀ is the load of springs without softness.

This file takes no contact decisions.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from petsc4py import PETSc

from delam_fem.contact.decisions import Compliance, Decision, PairState
from delam_fem.engines.petsc import linear_algebra
from delam_fem.engines.petsc.dynamics import Dynamics
from delam_fem.engines.petsc.linear_algebra import LazyCompliance, LumpedCompliance, new_vector
from delam_fem.engines.petsc.rayleigh import (
    AFTER_LUMPED_IMPULSES,
    RENEWED,
    RayleighProducts,
    Weights,
)
from delam_fem.model.operators import DistributedOperators, Operators
from delam_fem.numerics.types import FloatArray, IntArray
from delam_fem.system.mpi import MPI

DIRECT_PAIRS = 64
"""N2 is inverted as a dense matrix for up to this number of springs, else solved iteratively."""
RELATIVE_RESIDUAL = 1e-14
"""Relative residual of the conjugate gradients on N2; round-off, so the energy ledger closes."""


@dataclass
class _NewmarkSize:
    """A size of steps, with what belongs to it.

    Attributes:
        time_step: Δt [s].
        to_u, to_v: β Δt² and γ Δt, the factors of the new acceleration.
        keep_u, keep_v: (1/2 - β) Δt² and (1 - γ) Δt, the factors of the old acceleration.
        softness: k β Δt² + c γ Δt of a spring; of each pair, shape (n_pairs,), if they differ.
        A: factor of the matrix A of N1.
        stack: `Dynamics._stack` of the residual of N1, or N1' with average acceleration.
        S: S of N2.
        weights: factors of `RayleighProducts`.
        resistance: inverse matrix of N2 for the springs of `pairs`; None: iterate.
        pairs: the pairs that `resistance` belongs to.
    """

    time_step: float
    to_u: float
    to_v: float
    keep_u: float
    keep_v: float
    softness: float | FloatArray
    A: linear_algebra.PetscFactor
    stack: PETSc.Mat | None
    S: LazyCompliance
    weights: Weights = ()
    resistance: FloatArray | None = None
    pairs: IntArray | None = None


class Newmark(Dynamics):
    """The stepper of Newmark's scheme, with `advance` for candidates and `jump` for decisions."""

    def __init__(
        self,
        operators: Operators | DistributedOperators,
        *time_steps: float,
        beta: float = 0.25,
        gamma: float = 0.5,
        coupled_impulses: bool = False,
        spring: tuple[float, float | FloatArray] = (0.0, 0.0),
        comm: MPI.Intracomm = MPI.COMM_SELF,
    ) -> None:
        """Factorise M, and A for each size of steps; the state is at rest.

        Args:
            operators: the semi-discrete problem.
            time_steps: sizes of steps, from coarse to fine [s]; the last one is in use at first.
            beta: Newmark's β (the paper's α_N).
            gamma: Newmark's γ (the paper's β_N).
            coupled_impulses: True: impulses act through M⁻¹ ("consistent"); False: through the
                lumped mass alone.
            spring: stiffness [N/m] and damping [N s/m] of a resting pair's spring; several
                dampings are those of all pairs, shape (n_pairs,).
            comm: communicator that shares the work.
        """
        super().__init__(operators, time_steps[-1], comm)
        o = self.operators
        self.spring_stiffness = spring[0]
        self._dampings = spring[1]
        self._has_dampers = bool(np.any(self._dampings))
        self._is_average = (beta, gamma) == (0.25, 0.5)
        if o.rayleigh is not None and self._is_average and not self._is_narrow:
            renewed = RENEWED if coupled_impulses else AFTER_LUMPED_IMPULSES
            self._products = RayleighProducts(self._M, self._K, o.rayleigh, renewed)
        self._sizes = [self._size(dt, beta, gamma) for dt in time_steps]
        self._last_size = len(time_steps) - 1
        self._now = self._sizes[-1]
        self._M_factor = self._factor(0.0, 0.0, "newmark_mass_", scale=-1.0)
        self._velocities, self._kept_a = new_vector(o.n_own), new_vector(o.n_own)
        self._kept_motion = self._motion.duplicate()
        self._kept_losses = (0.0, 0.0)
        self._kept_damped = self.damped.copy()
        self._coupled = coupled_impulses
        inverse = 0.0 if coupled_impulses else 1.0 / o.require_lumped_mass()
        self._inverse_lumped = new_vector(o.n_own, inverse)
        self.compliance: Compliance = (
            self._compliance(self._M_factor) if coupled_impulses else LumpedCompliance(o)
        )
        self._pairs = np.flatnonzero(self.pair_state.resting)

    def _size(self, time_step: float, beta: float, gamma: float) -> _NewmarkSize:
        """Return a size of steps with its factor."""
        dt = time_step
        to_u = beta * dt**2
        to_v = gamma * dt
        # scale -1: solving with the residual K u + C v - f gives an acceleration
        factor = self._factor(to_v, to_u, "newmark_", scale=-1.0)
        softness = self.spring_stiffness * to_u + self._dampings * to_v
        keep_u = (0.5 - beta) * dt**2
        keep_v = (1.0 - gamma) * dt
        stack = self._stack(*(dt, -1.0) if self._is_average else (0.0, 0.0))
        result = _NewmarkSize(
            dt, to_u, to_v, keep_u, keep_v, softness, factor, stack, self._compliance(factor)
        )
        if self._products is not None:
            result.weights = self._products.weights(to_v, to_u, factor.scale)
        return result

    def use(self, level: int) -> None:
        """Choose the size of the next steps by its level; the last one if there are fewer."""
        self._now = self._sizes[min(level, self._last_size)]
        self.time_step = self._now.time_step
        self._prepare_springs()

    def keep(self) -> None:
        """Keep the present state for `undo`."""
        self._motion.copy(self._kept_motion)
        self.a.copy(self._kept_a)
        self._kept_losses = self._dissipated, self.contact_damped
        if self._has_dampers:
            np.copyto(self._kept_damped, self.damped)

    def undo(self) -> None:
        """Return to the state of the last `keep`; resting pairs are those of the present."""
        self._kept_motion.copy(self._motion)
        self._kept_a.copy(self.a)
        if self._products is not None:
            self._products.undo()
        self._see()
        self._dissipated, self.contact_damped = self._kept_losses
        if self._has_dampers:
            np.copyto(self.damped, self._kept_damped)

    rate_pre = Dynamics.rate_free  # an impact is between two steps

    def advance(self) -> float:
        """Compute the candidate state of the next step; return its smallest gap [m]."""
        u, v, a, both, now = self.u, self.v, self.a, self._velocities, self._now
        products = self._products
        self._step += 1
        base_state = self._base_states[self._step]
        v.copy(both)
        if self._is_average:
            self._find_residual(base_state, now.stack, now.time_step, -1.0)
            now.A.solve(self._residual, self._response)
            a.aypx(-1.0, self._response)
            v.axpy(now.to_v, self._response)
            both.axpy(1.0, v)  # twice the mean velocity of the step
            u.axpy(0.5 * now.time_step, both)
            if products is not None:
                products.begin_step(now.time_step)
                products.add(
                    self._response, self._residual, now.weights, to_u=now.to_u, to_v=now.to_v
                )
                products.Ma.aypx(-1.0, products.Mx)
        else:
            u.axpy(now.time_step, v)
            u.axpy(now.keep_u, a)
            v.axpy(now.keep_v, a)
            self._find_residual(base_state, now.stack)
            now.A.solve(self._residual, a)
            u.axpy(now.to_u, a)
            v.axpy(now.to_v, a)
            both.axpy(1.0, v)
        self._see()
        if self._pairs.size:
            self._push_springs()
            both.axpy(now.to_v, self._response)
        if products is None:
            self._C.mult(both, self._load)
        else:
            products.resist(1.0, self._load)
        self._dissipated += 0.25 * self.time_step * self._load.dot(both)
        if self._has_dampers and self._pairs.size:
            self._H.mult(both, self._rate.own)
            rate = self._of_springs(self._rate.gather(), self._pairs)
            factor = 0.25 * self.time_step * self._of_pairs(self._dampings)
            self.damped[self._pairs] += factor * rate**2
            if isinstance(factor, np.ndarray):
                self.contact_damped += float(factor @ rate**2)
            else:
                self.contact_damped += factor * float(rate @ rate)
        return self._gap_vector.min()[1]

    # -- springs ------------------------------------------------------------------------------

    def _push_springs(self) -> None:
        """Correct the candidate state by the forces of the springs (N2)."""
        drive = self._spring_loads()
        now = self._now
        if now.resistance is not None:
            forces = now.resistance @ drive
        else:
            forces = self._iterate_springs(drive)
        self._push(forces)
        now.A.solve(self._load, self._response)
        if self._products is not None:
            self._products.add(
                self._response, self._load, now.weights, to_u=now.to_u, to_v=now.to_v
            )
            self._products.Ma.axpy(1.0, self._products.Mx)
        self.a.axpy(1.0, self._response)
        self.u.axpy(now.to_u, self._response)
        self.v.axpy(now.to_v, self._response)
        self._see()

    def _spring_loads(self) -> FloatArray:
        """Return k U + c U̇ of the spring pairs at the current state."""
        loads = self.spring_stiffness * self._of_springs(self._gap_values, self._pairs)
        if self._has_dampers:
            rates = self._of_springs(self._rate_values, self._pairs)
            loads += self._of_pairs(self._dampings) * rates
        return loads

    def _of_pairs(self, values: float | FloatArray) -> float | FloatArray:
        """Return the values of the spring pairs; one number stands for all."""
        return values[self._pairs] if isinstance(values, np.ndarray) else values

    def _push(self, forces: FloatArray) -> None:
        """Write the load H^T λ of forces λ on the spring pairs to `_load`."""
        if self._roots is not None:
            forces = self._roots[self._pairs] * forces
        self._force.values[self._pairs] = forces
        self._H.multTranspose(self._force.total, self._load)

    def _iterate_springs(self, drive: FloatArray) -> FloatArray:
        """Solve N2 by conjugate gradients; each product with S_PP is one solve with A."""
        softness = self._of_pairs(self._now.softness)
        if isinstance(softness, np.ndarray):
            return self._iterate_unequal_springs(drive, np.sqrt(softness))
        return self._conjugate_gradients(
            drive, lambda direction: direction + softness * self._answer(direction)
        )

    def _conjugate_gradients(
        self, load: FloatArray, product: Callable[[FloatArray], FloatArray]
    ) -> FloatArray:
        """Solve a symmetric system of the spring pairs by conjugate gradients.

        Args:
            load: right-hand side.
            product: what its matrix makes of a vector.
        """
        solution = np.zeros(load.size)
        residual = load.copy()
        direction = load.copy()
        square = float(residual @ residual)
        goal = RELATIVE_RESIDUAL**2 * square
        for _ in range(2 * load.size):
            if square <= goal:
                break
            image = product(direction)
            length = square / float(direction @ image)
            solution += length * direction
            residual -= length * image
            previous = square
            square = float(residual @ residual)
            direction = residual + square / previous * direction
        return solution

    def _answer(self, forces: FloatArray) -> FloatArray:
        """Return S_PP times forces on the spring pairs."""
        self._push(forces)
        self._now.A.solve(self._load, self._response)
        self._H.mult(self._response, self._rate.own)
        # factors solve with -A, so that S appears with the other sign
        return -self._of_springs(self._rate.gather(), self._pairs)

    def _iterate_unequal_springs(self, drive: FloatArray, roots: FloatArray) -> FloatArray:
        """Solve N2 in its symmetric form by conjugate gradients, as `_iterate_springs` does.

        Args:
            drive: loads of the spring pairs.
            roots: √D of the spring pairs; 0 where a spring has no softness.
        """
        is_soft = roots > 0.0
        forces = np.where(is_soft, 0.0, drive)
        residual = np.divide(drive, roots, out=np.zeros(drive.size), where=is_soft)
        if forces.any():
            residual -= roots * self._answer(forces)
        solution = self._conjugate_gradients(
            residual, lambda direction: direction + roots * self._answer(roots * direction)
        )
        return forces + roots * solution

    def remember(self, pair_state: PairState) -> None:
        """Set what is remembered of the pairs; those that rest carry a spring: prepare N2."""
        super().remember(pair_state)
        self._force.values[:] = 0.0
        self._pairs = np.flatnonzero(pair_state.resting)
        self._prepare_springs()

    def _prepare_springs(self) -> None:
        """Prepare N2 for the present springs and the present size of steps."""
        now = self._now
        if now.pairs is self._pairs:
            return
        now.pairs = self._pairs
        now.resistance = None
        if 0 < self._pairs.size <= DIRECT_PAIRS:
            softness = self._of_pairs(now.softness)
            rows = softness[:, None] if isinstance(softness, np.ndarray) else softness
            matrix = rows * now.S.block(self._pairs)
            if self._roots is not None:
                matrix *= np.outer(self._roots[self._pairs], self._roots[self._pairs])
            matrix.flat[:: self._pairs.size + 1] += 1.0
            now.resistance = np.linalg.inv(matrix)

    # -- jumps --------------------------------------------------------------------------------

    def jump(self, decision: Decision) -> tuple[float, float]:
        """Carry a decision out and renew the acceleration.

        Args:
            decision: impulses and the new set of springs.

        Returns:
            Change of energy by the impulses, and by switching springs [J].
        """
        impact = self._impact(decision) if decision.hit.size else 0.0
        switched = 0.0
        if decision.pair_state is not None:
            switched -= self.spring_energy(self.pair_state.resting)
            self.remember(decision.pair_state)
            switched += self.spring_energy(self.pair_state.resting)
        self.renew_acceleration()
        return impact, switched

    def _impact(self, decision: Decision) -> float:
        """Change the velocities by impulses; return the change of kinetic energy [J]."""
        self._find_load(decision.hit, decision.impulses)
        load, change, mean = self._load, self._response, self._velocities
        if self._coupled:
            self._M_factor.solve(load, change)
            change.scale(self._M_factor.scale)
        else:
            change.pointwiseMult(load, self._inverse_lumped)
        mean.waxpy(0.5, change, self.v)  # of the velocities before and after the impact
        self._M.mult(change, load)
        self.v.axpy(1.0, change)
        if self._products is not None:
            self._products.strike(self.v, load)
        self._see()
        return linear_algebra.added([float(load.dot(mean))], self.comm)[0]

    def renew_acceleration(self) -> None:
        """Compute a from M a = f - C v - K u - H^T λ at the current state."""
        self._find_residual(self._base_states[self._step])
        if self._pairs.size:
            self._push(self._spring_loads())
            self._residual.axpy(1.0, self._load)
        self._M_factor.solve(self._residual, self.a)
        if self._products is not None:  # M a is minus the residual
            self._products.Ma.axpby(-1.0, 0.0, self._residual)

    def destroy(self) -> None:
        """Free all PETSc objects."""
        for vector in (self._velocities, self._inverse_lumped, self._kept_motion, self._kept_a):
            vector.destroy()
        for size in self._sizes:
            size.A.destroy()
        self._M_factor.destroy()
        super().destroy()
