"""Formulas of the contact laws as pure functions of gaps and gap rates, without time or state.

Impulses [N s] and forces [N] act on pairs; H^T maps them to the dofs. A positive impulse or force
pushes the laminae apart.
"""

from __future__ import annotations

from delam_fem.contact import complementarity
from delam_fem.numerics.arrays import FloatArray


def separate_impulses(
    rate_pre: FloatArray, restitution: float, inverse_mass: FloatArray
) -> FloatArray:
    """Return impulses that treat each pair as if it were alone (paper eq. 14).

        p = (1 + e) (-rate_pre) / W_kk,   W_kk = 1/m_1 + 1/m_2

    Each pair leaves with -e times its own gap rate.

    Args:
        rate_pre: gap rates before the impact, negative (approaching), shape (k,) [m/s].
        restitution: e [-].
        inverse_mass: W_kk of the lumped masses, shape (k,) [1/kg].
    """
    return -(1.0 + restitution) * rate_pre / inverse_mass


def coupled_impulses(
    rate_pre: FloatArray, rate_free: FloatArray, restitution: float, compliance: FloatArray
) -> FloatArray:
    """Return the impulses of Newton's law for pairs that influence one another.

        0 <= p  ⊥  (rate_free + W p) + e rate_pre >= 0

    Args:
        rate_pre: gap rates before the impact, shape (k,) [m/s].
        rate_free: gap rates that would follow without impulses, shape (k,) [m/s]; equal to
            `rate_pre` if the impact takes no time.
        restitution: e [-].
        compliance: W = H M^-1 H^T of the k pairs, shape (k, k) [1/kg].

    Raises:
        ArithmeticError: no solution (velocities or W are not finite).
    """
    return complementarity.solve(compliance, rate_free + restitution * rate_pre)
