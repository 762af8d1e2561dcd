"""The response of one mode to a base motion whose frequency changes slowly.

    w'' + 2 D ω₀ w' + ω₀² w = -Γ z'',   z = A sin φ(t),   φ' = ω(t)                            (O1)

With λ = ω₀ (-D + i √(1 - D²)) and ω_d = ω₀ √(1 - D²), w = 2 Re y and y' = λ y + f/(2 i ω_d). The
forcing is f = -Γ z'' = Re(g e^{iφ}) with g = -Γ A (i ω² + ω'). The part of y that turns with the
excitation, y = b e^{iφ}, changes slowly:

    b' = (λ - i ω) b + g/(4 i ω_d)                                                             (O2)

The other part, which turns against it, is quasi-static: it has no resonance. A constant frequency
gives the exact stationary response, and the motion starts at rest but for the quasi-static part.
"""

from __future__ import annotations

import numpy as np

from delam_fem.numerics.arrays import FloatArray
from delam_fem.numerics.cantilever import ComplexArray


def stationary(
    omega: FloatArray, natural: float, damping_ratio: float, participation: float = 1.0
) -> ComplexArray:
    """Return the amplitude of w of (O1) at constant frequencies, for a base motion Re(e^{iωt}).

    Args:
        omega: ω, shape (k,) [rad/s].
        natural: ω₀ [rad/s].
        damping_ratio: D [-].
        participation: Γ [-].

    Returns:
        Complex amplitudes per unit of the base, shape (k,) [-].
    """
    dynamic = natural**2 - omega**2 + 2j * damping_ratio * natural * omega
    return np.asarray(participation * omega**2 / dynamic)


def swept(
    time: FloatArray,
    omega: FloatArray,
    natural: float,
    damping_ratio: float,
    participation: float = 1.0,
) -> ComplexArray:
    """Return the slowly varying amplitude of w of (O1), which starts at rest.

    (O2) is solved step by step; within a step ω is the mean of both ends. Steps are short enough if
    ω changes by less than about D ω₀ / 10 in each.

    Args:
        time: increasing times, shape (k,) [s].
        omega: ω(t), shape (k,) [rad/s].
        natural: ω₀ [rad/s].
        damping_ratio: D, above 0 and below 1 [-].
        participation: Γ [-].

    Returns:
        Complex amplitudes a of w = A Re(a e^{iφ}) for z = A Re(e^{iφ}), shape (k,) [-].
    """
    root = np.sqrt(1.0 - damping_ratio**2)
    pole, damped = natural * (-damping_ratio + 1j * root), natural * root
    change = np.gradient(omega, time)
    forcing = participation * (omega**2 - 1j * change)
    rate, load = pole - 1j * omega, forcing / (4j * damped)
    h = np.diff(time)
    mean = 0.5 * (rate[1:] + rate[:-1])
    decay = np.exp(mean * h)
    push = (decay - 1.0) / mean * 0.5 * (load[1:] + load[:-1])
    b = np.empty(time.size, dtype=np.complex128)
    value = 0j
    b[0] = value
    for k, (factor, added) in enumerate(zip(decay.tolist(), push.tolist(), strict=True), start=1):
        value = factor * value + added
        b[k] = value
    against = -np.conj(forcing) / (4j * damped * (pole + 1j * omega))
    return np.asarray(2.0 * (b + np.conj(against)))
