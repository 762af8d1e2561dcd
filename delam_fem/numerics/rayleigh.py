"""Compute the coefficients of Rayleigh damping C = alpha M + beta K from a damping ratio.

Mode k has the damping ratio D_k = (alpha / omega_k + beta omega_k) / 2.
"""

from __future__ import annotations

from typing import Literal

Kind = Literal["two-mode", "stiffness", "mass"]
"""Terms of C: both ("two-mode", ratio D at modes 1 and 2), or one of them (ratio D at mode 1)."""


def coefficients(
    damping_ratio: float, first: float, second: float, kind: Kind = "two-mode"
) -> tuple[float, float]:
    """Return alpha [1/s] and beta [s] of C = alpha M + beta K.

    >>> coefficients(0.1, 1.0, 3.0)
    (0.15000000000000002, 0.05)

    Args:
        damping_ratio: D of the modes that the kind names [-].
        first: angular frequency of mode 1 [rad/s].
        second: angular frequency of mode 2 [rad/s].
        kind: which terms C has.
    """
    D = damping_ratio
    if kind == "stiffness":
        return 0.0, 2.0 * D / first
    if kind == "mass":
        return 2.0 * D * first, 0.0
    return 2.0 * D * first * second / (first + second), 2.0 * D / (first + second)
