"""Compute the coefficients of Rayleigh damping C = alpha M + beta K from a damping ratio.

Mode k has the damping ratio D_k = (alpha / omega_k + beta omega_k) / 2.
"""

from __future__ import annotations

import math
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


def overdamped_from(alpha: float, beta: float) -> float:
    """Return the angular frequency above which modes do not oscillate any more [rad/s].

    D_k = 1 has the larger solution (1 + sqrt(1 - alpha beta)) / beta. Above it, a mode that is let
    go creeps back with the rate 1/beta, whatever its stiffness.

    >>> overdamped_from(0.0, 0.5)
    4.0

    Args:
        alpha: of C = alpha M + beta K [1/s].
        beta: likewise [s].

    Returns:
        The frequency; infinity without a term in K, 0 if every mode is overdamped.
    """
    if beta == 0.0:
        return math.inf
    return 0.0 if alpha * beta >= 1.0 else (1.0 + math.sqrt(1.0 - alpha * beta)) / beta
