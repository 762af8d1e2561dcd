"""Estimate spectra of records: lines of whole periods, densities, frequency responses.

Source: P. D. Welch, IEEE Trans. Audio Electroacoust. 15 (1967) 70, for densities.
"""

from __future__ import annotations

import numpy as np

from delam_fem.numerics.beams import ComplexArray
from delam_fem.numerics.types import FloatArray


def lines_of_periods(values: FloatArray, n_samples: int, realisations: int = 1) -> ComplexArray:
    """Return the complex amplitudes of the lines 1, 2, … of each whole period, without a window.

    Args:
        values: records, shape (k, n); the last whole periods of all realisations are taken.
        n_samples: samples of a period.
        realisations: number of realisations, one after the other, of equal length.

    Returns:
        Shape (k, realisations, periods, n_lines) with n_lines below half the sampling rate.
    """
    periods = values.shape[1] // n_samples // realisations
    first = values.shape[1] - realisations * periods * n_samples
    shaped = values[:, first:].reshape(len(values), realisations, periods, n_samples)
    return np.asarray(2.0 * np.fft.rfft(shaped, axis=3)[..., 1 : (n_samples + 1) // 2] / n_samples)


def densities(values: FloatArray, step: float, length: int) -> tuple[FloatArray, FloatArray]:
    """Return frequencies [Hz] and one-sided power spectral densities, shape (k, n_lines), by Welch.

    Args:
        values: records, shape (k, n).
        step: time between samples [s].
        length: samples of a segment; segments overlap by half, each with a Hann window.
    """
    from scipy.signal import welch  # imports statistics, which takes long

    frequency, density = welch(values, 1.0 / step, nperseg=length)
    return frequency, density


def h1(force: FloatArray, motions: FloatArray, step: float, length: int) -> ComplexArray:
    """Return the frequency responses H1 = S_fx/S_ff, shape (k, n_lines), of segments as above.

    Where the force has no power they are 0.

    Args:
        force: the excitation, shape (n,).
        motions: the responses, shape (k, n).
        step: time between samples [s].
        length: samples of a segment.
    """
    from scipy.signal import csd

    _, cross = csd(force[None], motions, 1.0 / step, nperseg=length)
    _, density = densities(force[None], step, length)
    return np.asarray(np.where(density > 0.0, cross / np.where(density > 0.0, density, 1.0), 0.0))
