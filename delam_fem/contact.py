"""The contact laws as pure functions of gaps and gap rates; nothing about time or state.

Impulses [N s] and forces [N] act on pairs; H^T takes them to the dofs. Positive pushes the laminae
apart.
"""

from __future__ import annotations

import numpy as np

from delam_fem import complementarity
from delam_fem.operators import FloatArray

LARGEST_RECOVERY = 0.9
"""Share of a penetration that a step may take back."""


def separate_impulses(
    rate_pre: FloatArray, restitution: float, inverse_mass: FloatArray
) -> FloatArray:
    """Return the impulses that give each pair by itself the rate -e times its own (paper eq. 14).

        p = (1 + e) (-rate_pre) / W_kk,   W_kk = 1/m_1 + 1/m_2

    Args:
        rate_pre: gap rates before, approaching, shape (k,) [m/s].
        restitution: e [-].
        inverse_mass: W_kk of the lumped masses, shape (k,) [1/kg].
    """
    return -(1.0 + restitution) * rate_pre / inverse_mass


def coupled_impulses(
    rate_pre: FloatArray, rate_free: FloatArray, restitution: float, compliance: FloatArray
) -> FloatArray:
    """Return the impulses of Newton's law for pairs that feel one another.

        0 <= p  ⊥  (rate_free + W p) + e rate_pre >= 0

    Args:
        rate_pre: gap rates before the impact, shape (k,) [m/s].
        rate_free: gap rates that would follow without impulses, shape (k,) [m/s]; the same as
            `rate_pre` where the impact takes no time.
        restitution: e [-].
        compliance: W = H M^-1 H^T of the k pairs, shape (k, k) [1/kg].

    Raises:
        ArithmeticError: no solution (velocities or W are not finite).
    """
    return complementarity.solve(compliance, rate_free + restitution * rate_pre)


def floor_impulses(lacking: FloatArray, compliance: FloatArray) -> FloatArray:
    """Return the impulses that lift gap rates to their floors.

        0 <= p  ⊥  W p + lacking >= 0

    Args:
        lacking: gap rates without impulses less their floors, shape (k,) [m/s].
        compliance: W of the k pairs, shape (k, k) [1/kg].

    Raises:
        ArithmeticError: no solution (velocities or W are not finite).
    """
    return complementarity.solve(compliance, lacking)


def recovery_floor(
    gap: FloatArray,
    rate_pre: FloatArray,
    restitution: float,
    recovery_rate: FloatArray,
    time_step: float,
) -> FloatArray:
    """Return the gap rate below which no pair may end a step (law "moreau-recovery").

        open, U > 0:     U̇⁺ >= -2 U / Δt                       the gap may be used up by mid-step
        closed, U <= 0:  U̇⁺ >= -e min(U̇, 0) - κ U              Newton's law; penetrations recede

    Args:
        gap: U at the start of the step, shape (n_pairs,) [m].
        rate_pre: U̇ at the start of the step, shape (n_pairs,) [m/s].
        restitution: e [-].
        recovery_rate: κ, shape (n_pairs,) [1/s]; at most `LARGEST_RECOVERY` is taken back a step.
        time_step: Δt [s].
    """
    rate = np.minimum(recovery_rate, LARGEST_RECOVERY / time_step)
    closed = -restitution * np.minimum(rate_pre, 0.0) - rate * gap
    return np.where(gap > 0.0, -2.0 * gap / time_step, closed)


def spring_energy(stiffness: float, gap: FloatArray) -> float:
    """Return the energy of contact springs at their gaps, 1/2 k U^2 [J]."""
    return 0.5 * stiffness * float(np.dot(gap, gap))
