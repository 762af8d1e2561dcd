"""Rayleigh damping in the θ-scheme with one product with K and one with M in a step.

    C = α M + β K,   α and β constant on each body, so that they commute with M and K

The forces before a solve need one product with K, because M v is kept up to date:

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
for laminae 1 mm thick. In R3 it only touches the account.
"""

from __future__ import annotations

from dataclasses import dataclass

from petsc4py import PETSc

from delam_fem.engines.petsc.linear_algebra import Product
from delam_fem.numerics.arrays import FloatArray


@dataclass
class Weights:
    """The factors of R2 for a matrix s B, with which s B Δ = b gives C Δ.

    Attributes:
        of_load: β / (s (c β + k)).
        of_inertia: α - β (1 + c α) / (c β + k).
    """

    of_load: PETSc.Vec
    of_inertia: PETSc.Vec

    @classmethod
    def of(
        cls, rayleigh: tuple[FloatArray, FloatArray], c: float, k: float, scale: float
    ) -> Weights:
        """Return the factors.

        Args:
            rayleigh: α and β at the own dofs, each of shape (n_own,).
            c: factor of C in B.
            k: factor of K in B.
            scale: s.
        """
        alpha, beta = rayleigh
        share = beta / (c * beta + k)
        return cls(_vector(share / scale), _vector(alpha - share * (1.0 + c * alpha)))

    def destroy(self) -> None:
        """Free the vectors."""
        self.of_load.destroy()
        self.of_inertia.destroy()


class RayleighDamping:
    """Keeps M v and s = vᵀ C v of the own dofs, and the account of a step."""

    def __init__(self, M: Product, K: Product, rayleigh: tuple[FloatArray, FloatArray]) -> None:
        """Store the matrices and create vectors; the velocity is 0.

        Args:
            M: mass.
            K: stiffness.
            rayleigh: α and β at the own dofs, each of shape (n_own,) [1/s, s].
        """
        self._M, self._K, self.rayleigh = M, K, rayleigh
        self._alpha, self._beta = (_vector(values) for values in rayleigh)
        self._momentum, self._kept_momentum, self._work, self._point = (
            _vector(0.0 * rayleigh[0]) for _ in range(4)
        )
        self._square = self._square_start = self._cross = self._kept_square = 0.0

    def renew(self, v: PETSc.Vec) -> None:
        """Compute M v and s anew (collective)."""
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
        """Write K (u + ahead v) + C v by R1, and begin the account of a step (collective)."""
        self._square_start, self._cross = self._square, 0.0
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
        """Account for a change of the velocities before it is made (collective).

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
        damped.pointwiseMult(weights.of_load, load)
        inertia.pointwiseMult(weights.of_inertia, inertia)
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


def _vector(values: FloatArray) -> PETSc.Vec:
    """Return a new vector of the own dofs."""
    result = PETSc.Vec().createSeq(values.size)
    result.array[:] = values
    return result
