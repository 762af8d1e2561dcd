"""Prepare the schemes that were tried beside the package's: dense matrices of their steps.

Each function returns the matrices of one scheme; `trial_steps.py` makes the steps.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.linalg import expm

from delam_fem.model.operators import Operators
from delam_fem.numerics.arrays import FloatArray

LAWS = ("predicted gaps", "closed gaps", "end gaps", "recovery", "bounded recovery")
"""Constraints on the gap rate at the end of a step: Moreau's, with the gap half a step ahead or the
gap at the start; Stewart and Trinkle's, with e = 0; the recovery of penetrations, without the bound
on work or with it. The first is newton@moreau-jean, the last the law "recovery"."""
MOREAU, CLOSED, END, RECOVERY, BOUNDED = range(5)


class Problem(NamedTuple):
    """A problem on dense matrices.

    Attributes:
        M, C, K: shape (n, n).
        H, gap0: gap = H u + gap0.
        base: columns of M, C and K that belong to the base, shape (3, n).
    """

    M: FloatArray
    C: FloatArray
    K: FloatArray
    H: FloatArray
    gap0: FloatArray
    base: FloatArray

    @classmethod
    def of(cls, o: Operators) -> Problem:
        """Return the problem of operators."""
        M, C, K, H = (A.toarray() for A in (o.mass, o.damping, o.stiffness, o.gap_matrix))
        return cls(M, C, K, H, o.gap0, np.stack([o.base.mass, o.base.damping, o.base.stiffness]))


class Matrices(NamedTuple):
    """A problem and the matrices of a scheme for it.

    Attributes:
        of: the problem.
        inverse: of the matrix that the scheme solves with, shape (n, n); in `exact_step` the
            propagator, shape (2n, 4n).
        push: velocities by unit impulses on the pairs, shape (n, n_pairs).
        shift: displacements by unit impulses on the pairs, shape (n, n_pairs).
        numbers: parameters of the scheme, in the order in which its step takes them.
    """

    of: Problem
    inverse: FloatArray
    push: FloatArray
    shift: FloatArray
    numbers: FloatArray


def _matrices(
    d: Problem, inverse: FloatArray, push: FloatArray, shift: FloatArray, *numbers: float
) -> Matrices:
    """Return the matrices of a scheme as contiguous arrays, which compiled code expects."""
    parts = (inverse, push, shift, np.array(numbers, dtype=np.float64))
    return Matrices(d, *(np.ascontiguousarray(part) for part in parts))


def theta_matrices(d: Problem, dt: float, law: int, restitution: float) -> Matrices:
    """Return what `theta_step` needs, θ = 1/2."""
    inverse = np.linalg.inv(d.M + dt / 2 * d.C + dt**2 / 4 * d.K)
    push = inverse @ d.H.T
    return _matrices(d, inverse, push, dt / 2 * push, dt, law, restitution)


def exact_matrices(d: Problem, dt: float, restitution: float, is_spread: bool) -> Matrices:
    """Return what `exact_step` needs: the propagator of (u, v) under a load linear in the step."""
    n = len(d.M)
    inverse_mass = np.linalg.inv(d.M)
    A = np.zeros((4 * n, 4 * n))
    A[:n, n : 2 * n] = np.eye(n)
    A[n : 2 * n, :n], A[n : 2 * n, n : 2 * n] = -inverse_mass @ d.K, -inverse_mass @ d.C
    A[n : 2 * n, 2 * n : 3 * n] = inverse_mass
    A[2 * n : 3 * n, 3 * n :] = np.eye(n) / dt
    E = expm(A * dt)[: 2 * n]
    push, shift = inverse_mass @ d.H.T, np.zeros((n, len(d.gap0)))
    if is_spread:
        constant = E[:, 2 * n : 3 * n] @ d.H.T / dt
        shift, push = constant[:n], constant[n:]
    return _matrices(d, E, push, shift, dt, MOREAU, restitution)


def alpha_matrices(d: Problem, dt: float, restitution: float, radius: float) -> Matrices:
    """Return what `alpha_step` needs: generalised-α of Chung and Hulbert by its spectral radius."""
    am, af = (2 * radius - 1) / (radius + 1), radius / (radius + 1)
    gamma = 0.5 + af - am
    beta = 0.25 * (gamma + 0.5) ** 2
    A = (1 - am) * d.M + (1 - af) * (gamma * dt * d.C + beta * dt**2 * d.K)
    push = np.linalg.inv(d.M) @ d.H.T
    numbers = (dt, restitution, am, af, gamma, beta)
    return _matrices(d, np.linalg.inv(A), push, dt / 2 * push, *numbers)


def implicit_matrices(d: Problem, dt: float, is_stabilised: bool) -> Matrices:
    """Return what `implicit_step` needs; `shift` is that of the prediction."""
    inverse = np.linalg.inv(2 / dt * d.M + d.C + dt / 2 * d.K)
    return _matrices(
        d, inverse, dt * inverse @ d.H.T, np.linalg.inv(d.M) @ d.H.T, dt, is_stabilised
    )
