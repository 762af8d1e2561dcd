"""A Moreau–Jean loop of its own for delaminations that are closed at rest, in dense matrices.

It shares no code with the engines: matrices come from the judge's own assembly, and impulses from
SciPy's non-negative least squares.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from scipy.optimize import nnls

from delam_fem.api import FloatArray, Operators

CLOSED = 1e-4
"""Share of Δt times the largest gap rate below which a gap counts as closed."""


def moreau_jean(
    o: Operators, base: FloatArray, dt: float, restitution: float
) -> tuple[FloatArray, int]:
    """Return displacements after each step, shape (n_steps, n), and the number of impulses.

    Args:
        o: operators of the judge.
        base: (q, q', q'') of the base at the start and at each step, shape (n_steps + 1, 3).
        dt: time step [s].
        restitution: e [-].
    """
    M, C, K, H = (np.asarray(A.todense()) for A in (o.mass, o.damping, o.stiffness, o.gap_matrix))
    load = -np.stack([o.base.stiffness, o.base.damping, o.base.mass], axis=1)
    inverse = np.linalg.inv(M + 0.5 * dt * C + 0.25 * dt**2 * K)
    W = H @ inverse @ H.T
    u, v, motion, count = np.zeros(len(M)), np.zeros(len(M)), [], 0
    for before, after in pairwise(base):
        force = load @ (0.5 * (before + after))
        free = v + dt * inverse @ (force - C @ v - K @ (u + 0.5 * dt * v))
        tolerance = CLOSED * dt * np.abs(H @ free).max()
        closed = np.flatnonzero(o.gap0 + H @ (u + 0.5 * dt * v) <= tolerance)
        p = np.zeros(len(H))
        if closed.size:
            p[closed] = complementary(
                W[np.ix_(closed, closed)], H[closed] @ (free + restitution * v)
            )
        after_v = free + inverse @ H.T @ p
        u, v = u + 0.5 * dt * (v + after_v), after_v
        motion.append(u)
        count += np.count_nonzero(p > 0.0)
    return np.array(motion), count


def complementary(W: FloatArray, q: FloatArray) -> FloatArray:
    """Return p with 0 <= p ⊥ W p + q >= 0: the minimum of |Lᵀ p + L⁻¹ q| with W = L Lᵀ, p >= 0."""
    scale = np.abs(q).max()
    if scale == 0.0:
        return np.zeros(q.size)
    L = np.linalg.cholesky(W)
    return scale * nnls(L.T, -np.linalg.solve(L, q / scale), maxiter=100 * q.size)[0]
