"""Prepare the dense matrices of trial schemes, which are not part of the package's engines.

Each function returns the matrices of one scheme; `steps.py` makes the steps.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.linalg import expm

from delam_fem.api import FloatArray, Operators

LAWS = ("predicted gaps", "closed gaps", "end gaps", "recovery", "bounded recovery")
"""Constraints on the gap rate at the end of a step.

"predicted gaps" and "closed gaps" are Moreau's constraint with the gap half a step ahead and with
the gap at the start; the first is newton@moreau-jean. "end gaps" is the constraint of Stewart and
Trinkle with e = 0. "recovery" and "bounded recovery" recover penetrations, without and with the
bound on work; neither honours e, because both brake a pair before it touches.
"""
MOREAU, CLOSED, END, RECOVERY, BOUNDED = range(5)


class Problem(NamedTuple):
    """The operators as dense matrices.

    Attributes:
        M, C, K: mass, damping and stiffness matrix, each of shape (n, n).
        H, gap0: gap operator and gap at rest, gap = H u + gap0.
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
        """Return operators as dense matrices."""
        M, C, K, H = (A.toarray() for A in (o.mass, o.damping, o.stiffness, o.gap_matrix))
        return cls(M, C, K, H, o.gap0, np.stack([o.base.mass, o.base.damping, o.base.stiffness]))


class Matrices(NamedTuple):
    """A problem and the matrices of a scheme for it.

    Attributes:
        of: the problem.
        inverse: inverse of the matrix that the scheme solves with, shape (n, n); for `exact_step`
            the propagator, shape (2n, 4n).
        push: velocities due to unit impulses on the pairs, shape (n, n_pairs).
        shift: displacements due to unit impulses on the pairs, shape (n, n_pairs).
        numbers: parameters of the scheme, in the order that its step function expects.
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
    """Return the matrices of `theta_step`, the Moreau–Jean scheme with θ = 1/2."""
    inverse = np.linalg.inv(d.M + dt / 2 * d.C + dt**2 / 4 * d.K)
    push = inverse @ d.H.T
    return _matrices(d, inverse, push, dt / 2 * push, dt, law, restitution)


def exact_matrices(d: Problem, dt: float, restitution: float, is_spread: bool) -> Matrices:
    """Return the matrices of `exact_step`: the propagator of (u, v) under a linear load."""
    n = len(d.M)
    inverse_mass = np.linalg.inv(d.M)
    A = np.zeros((4 * n, 4 * n))
    A[:n, n : 2 * n] = np.eye(n)
    A[n : 2 * n, :n] = -inverse_mass @ d.K
    A[n : 2 * n, n : 2 * n] = -inverse_mass @ d.C
    A[n : 2 * n, 2 * n : 3 * n] = inverse_mass
    A[2 * n : 3 * n, 3 * n :] = np.eye(n) / dt
    E = expm(A * dt)[: 2 * n]
    push = inverse_mass @ d.H.T
    shift = np.zeros((n, len(d.gap0)))
    if is_spread:
        constant = E[:, 2 * n : 3 * n] @ d.H.T / dt
        shift, push = constant[:n], constant[n:]
    return _matrices(d, E, push, shift, dt, MOREAU, restitution)


def alpha_matrices(d: Problem, dt: float, restitution: float, radius: float) -> Matrices:
    """Return the matrices of `alpha_step`: generalised-α of Chung and Hulbert, given its ρ∞."""
    am = (2 * radius - 1) / (radius + 1)
    af = radius / (radius + 1)
    gamma = 0.5 + af - am
    beta = 0.25 * (gamma + 0.5) ** 2
    A = (1 - am) * d.M + (1 - af) * (gamma * dt * d.C + beta * dt**2 * d.K)
    push = np.linalg.inv(d.M) @ d.H.T
    numbers = (dt, restitution, am, af, gamma, beta)
    return _matrices(d, np.linalg.inv(A), push, dt / 2 * push, *numbers)


def implicit_matrices(d: Problem, dt: float, is_stabilised: bool) -> Matrices:
    """Return the matrices of `implicit_step`; `shift` belongs to its prediction."""
    inverse = np.linalg.inv(2 / dt * d.M + d.C + dt / 2 * d.K)
    return _matrices(
        d, inverse, dt * inverse @ d.H.T, np.linalg.inv(d.M) @ d.H.T, dt, is_stabilised
    )
