"""Decide on contact in the reference: hit pairs, pairs on springs, velocities after impacts.

All functions are pure and follow the paper equation by equation (section 3, with corrections).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.linalg import cholesky, eigh, solve_triangular
from scipy.optimize import nnls

from delam_fem.case.sections import Contact
from delam_fem.model.operators import Operators
from delam_fem.numerics.arrays import BoolArray, FloatArray

Impact = tuple[int, float, float]
"""Number of the pair (0 is next to the clamp), impulse [N s], gap rate before the impact [m/s]."""
_SINGULAR = 1e-12
"""Eigenvalue of W, relative to the largest, below which it is round-off of zero."""
MassSolver = Callable[[FloatArray], FloatArray]
"""Function that returns M^-1 times a vector (n,) or a matrix (n, k)."""


def decide(
    operators: Operators,
    law: Contact,
    state: tuple[FloatArray, FloatArray, BoolArray],
    solve_mass: MassSolver,
) -> tuple[FloatArray, list[Impact], BoolArray]:
    """Decide on contact at the end of a step, in the order of operations of newton-penalty.

    Args:
        operators: gap operator, gap at rest, masses.
        law: the section `contact` of a case with the law "none", "newton" or "newton-penalty".
        state: displacement, shape (n,) [m]; velocity, shape (n,) [m/s]; which pairs are at rest
            on springs, shape (n_pairs,).
        solve_mass: function that multiplies by M^-1.

    Returns:
        Velocity after the impacts, shape (n,) [m/s]; the impacts; which pairs are at rest on
        springs from now on, shape (n_pairs,).
    """
    u, v, P = state
    if law.law == "none":
        return v, [], P
    H = operators.gap_matrix
    gap = H @ u + operators.gap0
    rate = H @ v
    stays = P & (gap <= 0.0)  # eq. 21
    hit = ~P & (gap <= 0.0) & (rate < 0.0)  # eq. 13
    if not hit.any():
        return v, [], stays
    if law.impulse == "lumped":
        v, impulses = lumped_impact(operators, v, hit, law.restitution)
    else:
        v, impulses = consistent_impact(operators, v, hit, law.restitution, solve_mass)
    pairs = np.flatnonzero(hit)
    impacts = list(zip(pairs.tolist(), impulses.tolist(), rate[hit].tolist(), strict=True))
    if law.law == "newton":
        return v, impacts, stays
    enters = hit & (H @ v < law.threshold_velocity)  # eq. 18
    return v, impacts, stays | enters


def lumped_impact(
    operators: Operators, v: FloatArray, hit: BoolArray, restitution: float
) -> tuple[FloatArray, FloatArray]:
    """Apply impulses that change only the velocities of the hit nodes (paper eq. 14).

    Args:
        operators: gap operator and nodal (lumped) masses.
        v: velocity before, shape (n,) [m/s].
        hit: which pairs are closed and approaching, shape (n_pairs,).
        restitution: e [-].

    Returns:
        Velocity after, shape (n,) [m/s]; impulse of each hit pair, shape (n_hit,) [N s].
    """
    H = operators.gap_matrix[hit]
    inverse_mass = 1.0 / operators.require_lumped_mass()
    impulses = -(1.0 + restitution) * (H @ v) / (H.power(2) @ inverse_mass)
    return v + inverse_mass * (H.T @ impulses), impulses


def consistent_impact(
    operators: Operators,
    v: FloatArray,
    hit: BoolArray,
    restitution: float,
    solve_mass: MassSolver,
) -> tuple[FloatArray, FloatArray]:
    """Apply the impulses p that solve 0 <= p  _|_  W p + (1 + e) rate >= 0 over the hit pairs.

    Here W = H M^-1 H^T. With W = L L^T and b = (1 + e) rate these are the optimality conditions of
    min |L^T p + L^-1 b|^2 over p >= 0, a problem of non-negative least squares. If some pairs
    depend on the others, as many in one element do, W is singular and L has fewer columns.

    Args:
        operators: gap operator.
        v: velocity before, shape (n,) [m/s].
        hit: which pairs are closed and approaching, shape (n_pairs,).
        restitution: e [-].
        solve_mass: function that multiplies by M^-1.

    Returns:
        Velocity after, shape (n,) [m/s]; impulse of each hit pair, shape (n_hit,) [N s].
    """
    H = operators.gap_matrix[hit]
    response = solve_mass(H.T.toarray())  # M^-1 H^T
    b = (1.0 + restitution) * (H @ v)
    impulses, _ = nnls(*_roots(H @ response, -b))
    return v + response @ impulses, impulses


def _roots(W: FloatArray, right: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return L^T and L^-1 r of W = L L^T; for a singular W those of its range."""
    squares, vectors = eigh(W)
    kept = squares > _SINGULAR * squares[-1]
    if kept.all():
        L = cholesky(W, lower=True)
        return L.T, np.asarray(solve_triangular(L, right, lower=True))
    roots, basis = np.sqrt(squares[kept]), vectors[:, kept]
    return roots[:, None] * basis.T, basis.T @ right / roots
