"""Products of M and K with a state, kept up to date without products with K.

With Rayleigh damping

    C = α M + β K,   α and β constant on each body, so that they commute with M and K

the solution x of the matrix of a step says what K makes of it:

    (M + c C + k K) x = (1 + c α) M x + (c β + k) K x = b
    K x = (b - (1 + c α) M x) / (c β + k)                                                     (R1)

K u, K v, M v and M a are sums of such products, and with them

    K (u + t v) + C v = K u + (t + β) K v + α M v                                             (R2)

so that a step makes one product, with M. M couples equal components only: in 3D it has a third of
the entries of K. M a comes from the same solutions. In the sums the round-off of stiff modes adds
up from step to step, to 1e-6 of the motion within a period of 1000 steps for laminae 1 mm thick.
They are computed anew at the start of each period, so that a run that continues from a file has
the same bits, and every few steps.
"""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from petsc4py import PETSc

from delam_fem.engines.petsc.linear_algebra import Product, new_vector, vector_in
from delam_fem.numerics.types import FloatArray

Weights: TypeAlias = tuple[PETSc.Vec, ...]
"""The two factors of R1, see `RayleighProducts.weights`; none where products are made."""

RENEWED = 64
"""Steps after which the products are computed anew: round-off is then that of products in each
step, and the renewal costs 1/32 of them."""
AFTER_LUMPED_IMPULSES = 8
"""The same with lumped impulses, which set the stiffest motions going: the round-off of their huge
forces would be 1e-8 of the energy with 64 steps."""


class RayleighProducts:
    """K u, K v, M v and M a of the own dofs, at the present state and at the start of the step.

    Attributes:
        Ma: M a of the present state.
        Mx: M x of the solution x that was added last.
    """

    def __init__(
        self,
        M: Product,
        K: Product,
        rayleigh: tuple[FloatArray, FloatArray],
        renewed: int = RENEWED,
    ) -> None:
        """Store the matrices and create vectors; the products are not known yet.

        Args:
            M: mass.
            K: stiffness.
            rayleigh: α and β at the own dofs, each of shape (n_own,) [1/s, s].
            renewed: steps after which the products are computed anew.
        """
        self._M = M
        self._K = K
        self._rayleigh = rayleigh
        self._renewed = renewed
        n = rayleigh[0].size
        self._alpha, self._beta = (new_vector(n, values) for values in rayleigh)
        self._present, self._start = new_vector(4 * n), new_vector(4 * n)
        self._Ku, self._Kv, self._Mv, self.Ma = self._parts(self._present)
        self._starts = self._parts(self._start)
        self.Mx, self._Kx, self._work = (new_vector(n) for _ in range(3))
        self._weights: list[PETSc.Vec] = []
        self._steps_left = 0

    @staticmethod
    def _parts(whole: PETSc.Vec) -> list[PETSc.Vec]:
        """Return the four parts of a vector, in its memory."""
        return [vector_in(part) for part in np.split(whole.array, 4)]

    def weights(self, c: float, k: float, scale: float) -> Weights:
        """Return the factors of R1 for the solutions of s (M + c C + k K) x = b.

        Returns:
            Those of b, 1 / (s (c β + k)), and of M x, -(1 + c α) / (c β + k).
        """
        alpha, beta = self._rayleigh
        inverse = 1.0 / (c * beta + k)
        factors = inverse / scale, -(1.0 + c * alpha) * inverse
        weights = tuple(new_vector(alpha.size, values) for values in factors)
        self._weights += weights
        return weights

    def forget(self) -> None:
        """Have the products computed anew as soon as they are needed."""
        self._steps_left = 0

    def refresh(self, u: PETSc.Vec, v: PETSc.Vec, a: PETSc.Vec) -> None:
        """Compute the products with a state anew if they are too old (collective)."""
        if self._steps_left:
            return
        self._steps_left = self._renewed
        self._K.mult(u, self._Ku)
        self._K.mult(v, self._Kv)
        self._M.mult(v, self._Mv)
        self._M.mult(a, self.Ma)

    def begin_step(self, time_step: float) -> None:
        """Begin a step at the present state, by u += Δt v."""
        self._steps_left -= 1
        self._present.copy(self._start)
        self._Ku.axpy(time_step, self._Kv)

    def undo(self) -> None:
        """Return to the start of the step."""
        self._start.copy(self._present)

    def pull(self, ahead: float, inertia: float, result: PETSc.Vec) -> None:
        """Write K (u + ahead v) + C v + inertia M a to `result` (R2)."""
        self._damp(self._Kv, self._Mv, result)
        result.axpy(ahead, self._Kv)
        result.axpy(1.0, self._Ku)
        result.axpy(inertia, self.Ma)

    def add(
        self, x: PETSc.Vec, load: PETSc.Vec, weights: Weights, *, to_u: float, to_v: float
    ) -> None:
        """Account for u += to_u x and v += to_v x of the solution x for a load (R1, collective)."""
        of_load, of_inertia = weights
        self._M.mult(x, self.Mx)
        self._Kx.pointwiseMult(of_inertia, self.Mx)
        self._work.pointwiseMult(of_load, load)
        self._Kx.axpy(1.0, self._work)
        self._Ku.axpy(to_u, self._Kx)
        self._Kv.axpy(to_v, self._Kx)
        self._Mv.axpy(to_v, self.Mx)

    def strike(self, v: PETSc.Vec, momentum: PETSc.Vec) -> None:
        """Account for an impact that leaves velocities v; `momentum` is M Δv (collective)."""
        self._K.mult(v, self._Kv)
        self._Mv.axpy(1.0, momentum)

    def resist(self, share: float, result: PETSc.Vec) -> None:
        """Write C (v + share v₀) to `result`, v₀ the velocities at the start of the step."""
        _, Kv, Mv, _ = self._starts
        self._Kx.waxpy(share, Kv, self._Kv)
        self.Mx.waxpy(share, Mv, self._Mv)
        self._damp(self._Kx, self.Mx, result)

    def _damp(self, Kv: PETSc.Vec, Mv: PETSc.Vec, result: PETSc.Vec) -> None:
        """Write α M v + β K v to `result`."""
        result.pointwiseMult(self._beta, Kv)
        self._work.pointwiseMult(self._alpha, Mv)
        result.axpy(1.0, self._work)

    def destroy(self) -> None:
        """Free the vectors."""
        for vector in (
            *(self._Ku, self._Kv, self._Mv, self.Ma, *self._starts, *self._weights),
            *(self._present, self._start, self._alpha, self._beta),
            *(self.Mx, self._Kx, self._work),
        ):
            vector.destroy()
