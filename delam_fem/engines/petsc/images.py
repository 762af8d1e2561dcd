"""The products K u, K v, M v of a state, kept up to date instead of computed in every step.

    C = α M + β K,   α and β constant on each body                                           (R1)

A stepper changes u, v and a by linear combinations of one another and of solutions x of

    B x = b,   B = M + c C + k K = (1 + c α) M + (c β + k) K.

Their products with K and M follow the same combinations, and those of a solution are

    K x = (b - (1 + c α) M x) / (c β + k).                                                   (R2)

One product with M in a step replaces three with K. M couples equal components only, so that it has
a half of the entries of K in 2D, a third in 3D. The round-off of R2 is that of the inertia b, not
that of the stiffness, whose terms nearly cancel. Steppers compute the products anew at the start of
each period, so that a run that continues from a file has the same bits.
"""

from __future__ import annotations

from petsc4py import PETSc

from delam_fem.engines.petsc.linear_algebra import Product
from delam_fem.numerics.arrays import FloatArray


class Stack:
    """A vector x of own dofs, with K x and M x behind it in one memory if they are kept.

    Attributes:
        all: x, K x and M x as one vector, for linear combinations; x alone if they are not kept.
        own: x.
        stiff: K x.
        inert: M x.
    """

    def __init__(self, n: int, is_kept: bool) -> None:
        """Create the vectors, which are 0.

        Args:
            n: number of own dofs.
            is_kept: whether K x and M x are kept.
        """
        self.all = PETSc.Vec().createSeq(3 * n if is_kept else n)
        self.own = self.stiff = self.inert = self.all
        self._views: list[PETSc.Vec] = []
        if is_kept:
            memory = self.all.array
            self._views = [
                PETSc.Vec().createWithArray(memory[k * n : (k + 1) * n], comm=PETSc.COMM_SELF)
                for k in range(3)
            ]
            self.own, self.stiff, self.inert = self._views

    def destroy(self) -> None:
        """Free the vectors."""
        for view in self._views:
            view.destroy()
        self.all.destroy()


class Weights:
    """The factors of R2 for one matrix s B, with which s B x = b gives K x.

    Attributes:
        of_load: 1 / (s (c β + k)).
        of_inertia: -(1 + c α) / (c β + k).
    """

    def __init__(
        self, rayleigh: tuple[FloatArray, FloatArray], c: float, k: float, scale: float
    ) -> None:
        """Compute the factors.

        Args:
            rayleigh: α and β at the own dofs, each of shape (n_own,).
            c: factor of C in B.
            k: factor of K in B.
            scale: s.
        """
        alpha, beta = rayleigh
        self.of_load = _vector(1.0 / (scale * (c * beta + k)))
        self.of_inertia = _vector(-(1.0 + c * alpha) / (c * beta + k))

    def destroy(self) -> None:
        """Free the vectors."""
        self.of_load.destroy()
        self.of_inertia.destroy()


class Images:
    """Computes the products of stacks."""

    def __init__(self, M: Product, K: Product, rayleigh: tuple[FloatArray, FloatArray]) -> None:
        """Store the matrices.

        Args:
            M: mass.
            K: stiffness.
            rayleigh: α and β at the own dofs, each of shape (n_own,).
        """
        self._M, self._K, self.rayleigh = M, K, rayleigh
        self._alpha, self._beta = (_vector(values) for values in rayleigh)
        self._work = _vector(rayleigh[0])

    def renew(self, stack: Stack) -> None:
        """Compute K x and M x anew (collective)."""
        self._K.mult(stack.own, stack.stiff)
        self._M.mult(stack.own, stack.inert)

    def complete(self, stack: Stack, weights: Weights, load: PETSc.Vec) -> None:
        """Compute K x and M x of the solution x for a load by R2 (collective)."""
        self._M.mult(stack.own, stack.inert)
        stack.stiff.pointwiseMult(weights.of_load, load)
        self._work.pointwiseMult(weights.of_inertia, stack.inert)
        stack.stiff.axpy(1.0, self._work)

    def add_damping(self, stack: Stack, result: PETSc.Vec) -> None:
        """Add C x to a vector."""
        self._work.pointwiseMult(self._alpha, stack.inert)
        result.axpy(1.0, self._work)
        self._work.pointwiseMult(self._beta, stack.stiff)
        result.axpy(1.0, self._work)

    def damping(self, stack: Stack, result: PETSc.Vec) -> None:
        """Write C x into a vector."""
        result.pointwiseMult(self._alpha, stack.inert)
        self._work.pointwiseMult(self._beta, stack.stiff)
        result.axpy(1.0, self._work)

    def destroy(self) -> None:
        """Free the vectors."""
        for vector in (self._alpha, self._beta, self._work):
            vector.destroy()


def _vector(values: FloatArray) -> PETSc.Vec:
    """Return a new vector of the own dofs."""
    result = PETSc.Vec().createSeq(values.size)
    result.array[:] = values
    return result
