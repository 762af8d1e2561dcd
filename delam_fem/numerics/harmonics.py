"""Compute spectra of a periodic motion at the harmonics of its excitation, and its distortion.

Samples of whole periods put each harmonic into its own bin, so no window function is needed and no
leakage occurs.
"""

from __future__ import annotations

import numpy as np

from delam_fem.numerics.arrays import FloatArray


def amplitude_spectrum(values: FloatArray) -> FloatArray:
    """Return the one-sided amplitude spectrum by the discrete Fourier transform.

    A cosine of amplitude A with a whole number of cycles gives A in its bin and 0 elsewhere.

    Args:
        values: equidistant samples, shape (..., n).

    Returns:
        Amplitudes, shape (..., n // 2 + 1), in the unit of `values`; bin k has k cycles.
    """
    n = values.shape[-1]
    amplitudes = 2.0 * np.abs(np.fft.rfft(values, axis=-1)) / n
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
    n = values.shape[-1]
    if n_periods < 1 or n % n_periods:
        raise ValueError(
            f"expected a whole number of samples in each of {n_periods} periods, given {n} "
            "samples; cut them to whole periods"
        )
    below_nyquist = (n - 1) // 2
    return amplitude_spectrum(values)[..., n_periods : below_nyquist + 1 : n_periods]


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
    rest = np.sqrt((amplitudes[..., 1:] ** 2).sum(axis=-1))
    thd: FloatArray = np.divide(rest, first, out=np.full_like(first, np.nan), where=first > 0.0)
    return thd


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
