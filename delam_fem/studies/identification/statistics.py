"""Numbers that describe a motion whatever the origin of time: harmonics relative to the first one.

A measurement seldom knows the phase of the base. A shift of the origin by τ turns the k-th harmonic
c_k by k ω τ; so c_k e^{-ikφ}, with the phase φ of the first harmonic of the first lamina, does not
change.
"""

from __future__ import annotations

import math

import numpy as np
import xarray as xr

from delam_fem.case.toml import CaseError
from delam_fem.numerics.arrays import FloatArray
from delam_fem.numerics.cantilever import ComplexArray

HARMONICS = 5
"""Number of harmonics of each lamina."""
FITTED = 60
"""Most harmonics that are fitted, so that those of an impact do not count as noise."""
SAMPLES = 4
"""A measurement needs so many times the samples that its harmonics have unknowns."""


def of_points(sweep: xr.Dataset) -> ComplexArray:
    """Return the harmonics of all points of a sweep, shape (n_points, n_laminae, HARMONICS) [m].

    NaN for points that were not completed.
    """
    size, phase = (
        sweep[name].to_numpy().reshape(-1, *sweep[name].shape[-2:])[..., :HARMONICS]
        for name in ("harmonic_amplitude", "harmonic_phase")
    )
    return np.asarray(size * np.exp(1j * phase))


def of_history(time: FloatArray, tips: FloatArray, frequency: float) -> tuple[ComplexArray, float]:
    """Return the harmonics of a measured motion and the scatter about them.

    Args:
        time: times of the samples, any origin, shape (n,) [s].
        tips: displacements of the laminae, shape (n_laminae, n) [m].
        frequency: of the base [Hz].

    Returns:
        Harmonics, shape (n_laminae, HARMONICS) [m], and the standard deviation of a sample [m].

    Raises:
        CaseError: there are too few samples, or less than two periods.
    """
    least = 2 * HARMONICS + 1
    if time.size < SAMPLES * least or np.ptp(time) * frequency < 2.0:
        raise CaseError(
            f"measured history: expected at least {SAMPLES * least} samples and two periods, "
            f"given {time.size} samples over {np.ptp(time) * frequency:.3g} periods of "
            f"{frequency:g} Hz"
        )
    below_nyquist = math.ceil(0.5 / (frequency * float(np.median(np.diff(time))))) - 1
    most = min(FITTED, below_nyquist, (time.size // SAMPLES - 1) // 2)
    fitted = max(HARMONICS, most)
    unknowns = 2 * fitted + 1
    angle = 2.0 * math.pi * frequency * time[:, None] * np.arange(1, fitted + 1)
    columns = np.concatenate([np.sin(angle), np.cos(angle), np.ones((time.size, 1))], axis=1)
    found, *_ = np.linalg.lstsq(columns, tips.T, rcond=None)
    scatter = float(
        np.std(tips.T - columns @ found) * math.sqrt(time.size / (time.size - unknowns))
    )
    sines, cosines = found[:HARMONICS].T, found[fitted : fitted + HARMONICS].T
    return np.asarray(sines + 1j * cosines), scatter


def invariant(harmonics: ComplexArray) -> FloatArray:
    """Return harmonics as real numbers without the origin of time.

    Args:
        harmonics: shape (..., n_laminae, HARMONICS) [m].

    Returns:
        Real and imaginary parts, shape (..., 2 n_laminae HARMONICS - 1) [m]; the imaginary part of
        the first harmonic of the first lamina is 0 and left out.
    """
    first = harmonics[..., 0, 0]
    turns = np.exp(-1j * np.angle(first)[..., None] * np.arange(1, HARMONICS + 1))
    turned = (harmonics * turns[..., None, :]).reshape(*harmonics.shape[:-2], -1)
    return np.concatenate([turned.real, turned.imag[..., 1:]], axis=-1)


def noisy(harmonics: ComplexArray, noise: float, rng: np.random.Generator) -> ComplexArray:
    """Return harmonics with errors of independent normal parts.

    Args:
        harmonics: any shape [m].
        noise: standard deviation of the real and of the imaginary part [m].
        rng: random numbers.
    """
    parts = rng.standard_normal((2, *harmonics.shape))
    return np.asarray(harmonics + noise * (parts[0] + 1j * parts[1]))
