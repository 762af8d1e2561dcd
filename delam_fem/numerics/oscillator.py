"""One oscillator: its slowly swept response, and the coefficients of its Rayleigh damping.

The response of one mode to any motion of its base.

    w'' + 2 D ω₀ w' + ω₀² w = -z''                                                            (O1)

With λ = ω₀ (-D + i √(1 - D²)) and ω_d = ω₀ √(1 - D²), w = 2 Re y and

    y' = λ y - z''/(2 i ω_d)                                                                  (O2)

(O2) is solved exactly but for the integral of z'' over a step, which two points of Gauss take.
Compute the coefficients of Rayleigh damping C = alpha M + beta K from a damping ratio.

Mode k has the damping ratio D_k = (alpha / omega_k + beta omega_k) / 2.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Literal

import numpy as np

from delam_fem.numerics.beams import ComplexArray
from delam_fem.numerics.types import FloatArray


def pole(natural: float, damping_ratio: float) -> complex:
    """Return λ of (O2) [1/s], for ω₀ [rad/s] and D, above 0 and below 1 [-]."""
    return natural * complex(-damping_ratio, np.sqrt(1.0 - damping_ratio**2))


def driven(
    time: FloatArray, acceleration: Callable[[FloatArray], FloatArray], root: complex
) -> ComplexArray:
    """Return y of (O2), which starts at 0; a free vibration adds a multiple of e^{λt}.

    Args:
        time: of the steps, equidistant, shape (k,) [s]; 40 in a period of the base give 1e-6.
        acceleration: z'' at given times [m/s2].
        root: λ [1/s].

    Returns:
        Complex amplitudes, shape (k,) [m].
    """
    from scipy.signal import lfilter  # loads scipy.stats, which a run does not need

    h = float(time[1] - time[0])
    load = np.zeros(time.size, dtype=np.complex128)
    for share in (0.5 - np.sqrt(3.0) / 6.0, 0.5 + np.sqrt(3.0) / 6.0):
        z = acceleration(time[:-1] + share * h)
        load[1:] -= 0.5 * h * np.exp(root * (1.0 - share) * h) * z / (2j * root.imag)
    return np.asarray(lfilter([1.0], [1.0, -np.exp(root * h)], load))


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
