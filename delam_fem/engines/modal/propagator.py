"""The exact motion of modes in a step, as numbers that compiled code needs.

A mode q'' + c q' + ω² q = F has the load F = F0 + ΔF τ/h in a step of length h. Then exactly

    q1 = a11 q0 + a12 v0 + b1 F0 + d1 ΔF,   v1 = a21 q0 + a22 v0 + b2 F0 + d2 ΔF              (P1)
    c ∫ v² dτ = xᵀ Q x,   x = (q0, v0, F0, ΔF)                                                 (P2)

In units of the step x' = A x is a linear system of four equations. Its exponential E and Q follow
from those of a small part of the step by doubling, E(2h) = E(h)², Q(2h) = Q(h) + E(h)ᵀ Q(h) E(h),
which holds for any damping and loses no digits.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.special import roots_legendre

from delam_fem.model.reduced import Reduced
from delam_fem.numerics.arrays import FloatArray

SMALL = 0.5
"""Norm of A times the small part of a step."""
TERMS, NODES = 16, 8
"""Terms of the exponential series and Gauss points in the small part: round-off is reached."""


class Step(NamedTuple):
    """Numbers of steps of one size.

    Attributes:
        length: h [s].
        move: a11, a12, a21, a22, b1, b2, d1, d2 of P1, shape (8, m).
        loss: the upper triangle of Q of P2 row by row, off-diagonal entries doubled, shape (10, m).
        decay: exp(-h/β) of each part, 0 where β = 0, shape (c,).
        compliance: gaps at the end of the step by contact forces that are constant in it, flat,
            shape (n²,) [m/N].
    """

    length: float
    move: FloatArray
    loss: FloatArray
    decay: FloatArray
    compliance: FloatArray


def step_of(reduced: Reduced, length: float) -> Step:
    """Return the numbers of steps of a length [s]."""
    move, loss = exact_step(reduced.squares, reduced.damping, length)
    creep = reduced.creep
    decay = np.exp(-length / np.where(creep > 0.0, creep, np.inf), where=creep > 0.0, out=0 * creep)
    G = reduced.gap_modes
    A = (G * move[4]) @ G.T + np.einsum("c,cij->ij", 1.0 - decay, reduced.compliance)
    return Step(length, move, loss, decay, np.ascontiguousarray(0.5 * (A + A.T)).ravel())


def exact_step(
    squares: FloatArray, damping: FloatArray, length: float
) -> tuple[FloatArray, FloatArray]:
    """Return P1 and P2 of modes, shapes (8, m) and (10, m).

    Args:
        squares: ω², shape (m,) [1/s2].
        damping: c, shape (m,) [1/s].
        length: h [s].
    """
    h, A = length, np.zeros((squares.size, 4, 4))
    A[:, 0, 1] = A[:, 1, 2] = A[:, 2, 3] = 1.0
    A[:, 1, 0], A[:, 1, 1] = -squares * h * h, -damping * h
    halvings = np.ceil(np.log2(np.abs(A).sum(axis=2).max(axis=1) / SMALL)).astype(int).clip(0)
    parts = 0.5**halvings
    E = _exponential(A * parts[:, None, None])
    places, weights = roots_legendre(NODES)
    Q = np.zeros_like(A)
    for place, weight in zip(0.5 * (1.0 + places), 0.5 * weights, strict=True):
        row = _exponential(A * (place * parts)[:, None, None])[:, 1]
        Q += (weight * parts)[:, None, None] * row[:, :, None] * row[:, None, :]
    for k in range(int(halvings.max(initial=0))):
        still = halvings > k
        own = E[still]
        Q[still] += own.transpose(0, 2, 1) @ Q[still] @ own
        E[still] = own @ own
    units = np.array([1.0, h, h * h, h * h])
    E[:, :2] *= units / units[:2, None]
    Q *= (damping / h)[:, None, None] * units[:, None] * units
    entries = [(0, 0), (0, 1), (1, 0), (1, 1), (0, 2), (1, 2), (0, 3), (1, 3)]
    rows = [Q[:, a, b] * (1.0 if a == b else 2.0) for a in range(4) for b in range(a, 4)]
    return np.stack([E[:, i, j] for i, j in entries]), np.stack(rows)


def _exponential(A: FloatArray) -> FloatArray:
    """Return exp(A) of small matrices, shape (m, 4, 4)."""
    term = np.broadcast_to(np.eye(4), A.shape).copy()
    total = term.copy()
    for k in range(1, TERMS):
        term = term @ A / k
        total += term
    return total
