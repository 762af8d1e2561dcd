"""Compute spectra of a periodic motion at the harmonics of its excitation, and its distortion.

Samples of whole periods put each harmonic into its own bin, so no window function is needed and no
leakage occurs.
"""

from __future__ import annotations

import numpy as np

from delam_fem.numerics.types import FloatArray


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
    found = np.fft.rfft(values, axis=-1)[..., bins]
    cycles = np.arange(bins.start, bins.stop, bins.step)
    turned = 1j * found * np.exp(-2j * np.pi * cycles / values.shape[-1])
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
