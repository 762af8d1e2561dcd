"""The response of one mode to any motion of its base.

    w'' + 2 D ω₀ w' + ω₀² w = -z''                                                            (O1)

With λ = ω₀ (-D + i √(1 - D²)) and ω_d = ω₀ √(1 - D²), w = 2 Re y and

    y' = λ y - z''/(2 i ω_d)                                                                  (O2)

(O2) is solved exactly but for the integral of z'' over a step, which two points of Gauss take.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.signal import lfilter

from delam_fem.numerics.arrays import FloatArray
from delam_fem.numerics.cantilever import ComplexArray


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
    h = float(time[1] - time[0])
    load = np.zeros(time.size, dtype=np.complex128)
    for share in (0.5 - np.sqrt(3.0) / 6.0, 0.5 + np.sqrt(3.0) / 6.0):
        z = acceleration(time[:-1] + share * h)
        load[1:] -= 0.5 * h * np.exp(root * (1.0 - share) * h) * z / (2j * root.imag)
    return np.asarray(lfilter([1.0], [1.0, -np.exp(root * h)], load))
