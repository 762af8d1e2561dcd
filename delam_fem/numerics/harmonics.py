"""Spectra at the harmonics of an excitation, and the response of one oscillator.

Samples of whole periods of the excitation put each harmonic into its own bin, so no window function
is needed and no leakage occurs.

The response of one mode to any motion of its base follows

    w'' + 2 D ω₀ w' + ω₀² w = -z''                                                            (O1)

With λ = ω₀ (-D + i √(1 - D²)) and ω_d = ω₀ √(1 - D²), w = 2 Re y and

    y' = λ y - z''/(2 i ω_d)                                                                  (O2)

A step solves (O2) exactly, except for the integral of z'', which Gauss quadrature with two points
approximates.

With Rayleigh damping C = alpha M + beta K, mode k has the damping ratio D_k = (alpha / omega_k +
beta omega_k) / 2.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Literal

import numpy as np

from delam_fem.numerics.beams import ComplexArray
from delam_fem.numerics.types import FloatArray


def amplitude_spectrum(values: FloatArray) -> FloatArray:
    """Return the one-sided amplitude spectrum by the discrete Fourier transform.

    A cosine of amplitude A with a whole number of cycles gives A in its bin and 0 elsewhere. Equal
    values give equal bits, wherever they lie in memory.

    Args:
        values: equidistant samples, shape (..., n).

    Returns:
        Amplitudes, shape (..., n // 2 + 1), in the unit of `values`; bin k has k cycles.
    """
    n = values.shape[-1]
    amplitudes = 2.0 * np.abs(np.fft.rfft(np.ascontiguousarray(values), axis=-1)) / n
    amplitudes[..., 0] *= 0.5
    if n % 2 == 0:
        amplitudes[..., -1] *= 0.5
    return amplitudes


def harmonic_amplitudes(values: FloatArray, n_periods: int) -> FloatArray:
    """Return the amplitudes A_1, A_2, … of the harmonics of the excitation, below Nyquist.

    Args:
        values: equidistant samples of `n_periods` whole periods, shape (..., n).
        n_periods: number of periods; an even number avoids leakage of a period-doubled motion.

    Returns:
        Amplitudes, shape (..., n_harmonics), in the unit of `values`.

    Raises:
        ValueError: the number of samples per period is not a whole number.
    """
    return amplitude_spectrum(values)[..., _bins(values.shape[-1], n_periods)]


def harmonic_phases(values: FloatArray, n_periods: int) -> FloatArray:
    """Return the phases φ_1, φ_2, … of Σ A_k sin(k ω t + φ_k), where the base moves as sin ω t.

    Args:
        values: as for `harmonic_amplitudes`; the first sample is one step after the start of a
            period, as in the window of a run.
        n_periods: number of periods.

    Returns:
        Phases from -π to π, shape (..., n_harmonics) [rad].

    Raises:
        ValueError: the number of samples per period is not a whole number.
    """
    bins = _bins(values.shape[-1], n_periods)
    spectrum = np.fft.rfft(values, axis=-1)[..., bins]
    cycles = np.arange(bins.start, bins.stop, bins.step)
    turned = 1j * spectrum * np.exp(-2j * np.pi * cycles / values.shape[-1])
    return np.asarray(np.angle(turned))


def _bins(n_samples: int, n_periods: int) -> slice:
    """Return the bins of the harmonics below Nyquist; raise ValueError for broken periods."""
    if n_periods < 1 or n_samples % n_periods:
        raise ValueError(
            f"expected a whole number of samples in each of {n_periods} periods, given {n_samples} "
            "samples; cut them to whole periods"
        )
    return slice(n_periods, (n_samples - 1) // 2 + 1, n_periods)


def total_harmonic_distortion(amplitudes: FloatArray) -> FloatArray:
    """Return THD = sqrt(sum_{i>1} A_i^2) / A_1.

    Args:
        amplitudes: A_1, A_2, …, shape (..., n_harmonics).

    Returns:
        THD, shape (...) [-]; NaN if A_1 is 0 or missing.
    """
    if not amplitudes.shape[-1]:
        return np.full(amplitudes.shape[:-1], np.nan)
    first = amplitudes[..., 0]
    overtones = np.sqrt((amplitudes[..., 1:] ** 2).sum(axis=-1))
    return np.asarray(
        np.divide(overtones, first, out=np.full_like(first, np.nan), where=first > 0.0)
    )


def distortion_factor(amplitudes: FloatArray) -> FloatArray:
    """Return d = sqrt(sum_{i>=1} A_i^2 / A_1^2) - 1 = sqrt(1 + THD^2) - 1.

    Args:
        amplitudes: A_1, A_2, …, shape (..., n_harmonics).

    Returns:
        d, shape (...) [-]; NaN if A_1 is 0 or missing.

    Source:
        I. Müller, eq. 2 (the 1 is subtracted outside the root).
    """
    thd = total_harmonic_distortion(amplitudes)
    factor: FloatArray = thd**2 / (1.0 + np.sqrt(1.0 + thd**2))  # equal, without cancellation
    return factor


def pole(natural: float, damping_ratio: float) -> complex:
    """Return the pole λ of an oscillator (O2) [1/s], for ω₀ [rad/s] and D, above 0, below 1 [-]."""
    return natural * complex(-damping_ratio, np.sqrt(1.0 - damping_ratio**2))


def driven(
    time: FloatArray, acceleration: Callable[[FloatArray], FloatArray], root: complex
) -> ComplexArray:
    """Return the response y of an oscillator to a motion of its base (O2), from y = 0.

    A free vibration adds a multiple of e^{λt}.

    Args:
        time: equidistant times, shape (k,) [s]; 40 in a period of the base give errors of 1e-6.
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
