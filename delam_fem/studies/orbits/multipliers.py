"""Floquet multipliers from noisy derivatives, their intervals, and what follows for stability."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from delam_fem.numerics.arrays import FloatArray

ComplexArray = npt.NDArray[np.complex128]
Stability = Literal["stable", "unstable", "undecided"]

RESAMPLES = 200
"""Bootstrap samples; the ends of a 95 % interval then lie at five samples from the ends."""
CONFIDENCE = 0.95
_REAL = 1e-9


@dataclass(frozen=True)
class Multipliers:
    """Multipliers of an orbit with bootstrap samples.

    Attributes:
        values: of the mean derivative, by decreasing modulus, shape (m,).
        samples: of resampled means, each row matched to `values`, shape (n_samples, m).
        derivative: the mean derivative, shape (m, m).
    """

    values: ComplexArray
    samples: ComplexArray
    derivative: FloatArray

    @property
    def errors(self) -> FloatArray:
        """Standard error of each multiplier, as a distance in the plane, shape (m,)."""
        return np.asarray(np.sqrt((np.abs(self.samples - self.values) ** 2).mean(axis=0)))

    @property
    def largest(self) -> tuple[float, float]:
        """Interval of the largest modulus."""
        return interval(np.abs(self.samples).max(axis=1))

    @property
    def stability(self) -> Stability:
        """Whether the interval of the largest modulus lies below 1, above 1 or on both sides."""
        return stability_of(*self.largest)

    @property
    def doubling(self) -> FloatArray:
        """The product of all 1 + μ, and of samples; it changes sign at a period doubling."""
        rows = np.vstack([self.values, self.samples])
        return np.asarray(np.prod(1.0 + rows, axis=1).real)

    @property
    def torus(self) -> FloatArray:
        """1 - |μ| of the largest complex pair, and of samples; NaN: all are real."""
        return np.array([1.0 - abs(largest_pair(row)) for row in (self.values, *self.samples)])

    @property
    def angle(self) -> float:
        """Argument of the largest complex pair, 0 to π; NaN: all are real."""
        return float(np.angle(largest_pair(self.values)))


def multipliers(derivatives: FloatArray, seed: int = 0) -> Multipliers:
    """Return the multipliers of the mean of derivatives, with bootstrap samples.

    Args:
        derivatives: independent estimates of the same matrix, shape (k, m, m).
        seed: of the resampling.
    """
    mean = derivatives.mean(axis=0)
    values = by_modulus(np.linalg.eigvals(mean).astype(np.complex128))
    rng = np.random.default_rng(seed)
    chosen = rng.integers(0, len(derivatives), (RESAMPLES, len(derivatives)))
    resampled = np.linalg.eigvals(derivatives[chosen].mean(axis=1))
    samples = np.array([matched(row, values) for row in resampled])
    return Multipliers(values, samples, mean)


def stability_of(low: float, high: float) -> Stability:
    """Return what an interval of the largest modulus says; nothing if an end is not finite."""
    return "stable" if low <= high < 1.0 else "unstable" if 1.0 < low <= high else "undecided"


def by_modulus(values: ComplexArray) -> ComplexArray:
    """Return multipliers by decreasing modulus; of a pair, the one with Im > 0 first."""
    return np.asarray(values[np.lexsort((-values.imag, -np.round(np.abs(values), 12)))])


def matched(values: npt.NDArray[Any], to: ComplexArray) -> ComplexArray:
    """Return multipliers in the order of others, each beside the one to which it belongs."""
    from scipy.optimize import linear_sum_assignment

    distance = np.abs(values[None, :] - to[:, None])
    _, columns = linear_sum_assignment(distance)
    return np.asarray(values[columns], dtype=np.complex128)


def interval(samples: FloatArray) -> tuple[float, float]:
    """Return the 95 % interval of samples."""
    tail = 0.5 * (1.0 - CONFIDENCE)
    low, high = np.quantile(samples, [tail, 1.0 - tail])
    return float(low), float(high)


def largest_pair(values: ComplexArray) -> complex:
    """Return the multiplier with Im > 0 of the largest complex pair, NaN if all are real."""
    pairs = values[values.imag > _REAL]
    return complex(pairs[np.argmax(np.abs(pairs))]) if pairs.size else complex(np.nan)
