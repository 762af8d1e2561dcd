"""Floquet multipliers from decays of kicks, their intervals, and what follows for stability.

A kick of the slow coordinates is left to itself for some periods. After the first, the other
coordinates follow the slow ones, and

    d_{n+1} = A d_n + r_n,   n = 1, 2, …

with the jumps r_n of the map. A is fitted by least squares with weights 1/|d_n|, between those that
suit jumps and those by which all sizes on the way count alike; its eigenvalues are the multipliers.
The derivative of a single period takes the other coordinates as being at rest: it gives -0.98 where
kicks grow by 1.3 % in each period.
"""

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
SMALLEST = 1.0 / 30.0
"""Size relative to the first below which kicks count less: impacts are frozen to the grid there."""
EXCITED = 1e-4
"""Least power of a direction that is fitted, relative to the largest."""
_REAL = 1e-9


@dataclass(frozen=True)
class Multipliers:
    """Multipliers of an orbit with bootstrap samples.

    Attributes:
        values: of the mean derivative, by decreasing modulus, shape (m,).
        samples: of resampled kicks, from all sizes and from the smaller half of them alone, each
            row matched to `values`, shape (2 n_samples, m). Their interval contains what the size
            of the kicks changes.
        derivative: the fitted derivative A, shape (m, m).
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


def multipliers(decays: FloatArray, seed: int = 0) -> Multipliers:
    """Return the multipliers of decays of kicks, with bootstrap samples over the kicks.

    Args:
        decays: kicks before and after each period, see `Ensemble.decays`, shape (n, 2, k, m).
        seed: of the resampling.
    """
    size = np.linalg.norm(decays[:, 0], axis=-1)
    counts = np.isfinite(size)
    before, after = np.where(counts[:, None, :, None], decays, 0.0).transpose(1, 0, 2, 3)
    seen = size[counts & (size > SMALLEST)]
    is_small = counts & (size <= (np.median(seen) if seen.size else np.inf))
    k = decays.shape[2]
    chosen = np.random.default_rng(seed).integers(0, k, (RESAMPLES, k))
    found: list[FloatArray] = []
    for used in (counts, is_small):
        weights = used / np.fmax(size, SMALLEST)
        both = np.einsum("nk,nki,nkj->kij", weights, after, before)
        power = np.einsum("nk,nki,nkj->kij", weights, before, before)
        if not found:
            derivative = _fitted(both.sum(axis=0), power.sum(axis=0))
        found.append(_fitted(both[chosen].sum(axis=1), power[chosen].sum(axis=1)))
    values = by_modulus(np.linalg.eigvals(derivative).astype(np.complex128))
    samples = [matched(row, values) for row in np.linalg.eigvals(np.concatenate(found))]
    return Multipliers(values, np.array(samples), derivative)


def _fitted(both: FloatArray, power: FloatArray) -> FloatArray:
    """Return A of least squares, shape (…, m, m)."""
    return np.asarray(both @ np.linalg.pinv(power, rcond=EXCITED, hermitian=True))


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
