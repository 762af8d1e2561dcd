"""Probability of detection: hit or miss over length, depth and position; ROC curves.

A specimen is a hit if the index calls it and marks something of its delamination. The logistic
regression of hits on ln a follows MIL-HDBK-1823A (appendix G): POD(a) = 1 / (1 + exp(-β₀ - β₁ ln
a)); a90 is where it is 0.9, a90/95 where its lower 95 % bound is.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from scipy.stats import norm

from delam_fem.case.definition import Case
from delam_fem.numerics.arrays import BoolArray, FloatArray
from delam_fem.studies.detection.indices import curvature
from delam_fem.studies.detection.locate import mark
from delam_fem.studies.detection.measurement import Scan, intact, simulated
from delam_fem.studies.detection.population import (
    ELEMENTS,
    PERIODS,
    SAMPLES,
    STEPS,
    Population,
    Specimen,
)
from delam_fem.studies.detection.shapes import shapes_of

LENGTHS = (0.05, 0.10, 0.15, 0.20, 0.25, 0.30, 0.35, 0.40)
"""a/L of the grid."""
DEPTHS = (0.15, 0.30, 0.45)
"""Depths of the grid over the thickness of the beam."""
MIDDLES = (0.25, 0.375, 0.5, 0.625, 0.75)
"""Middles of the delaminations of the grid over the length of the beam."""
INTACT = 200
"""Number of noisy intact beams that count false calls."""
_BOUND = 0.95


@dataclass(frozen=True)
class Curve:
    """A POD curve with its lower bound.

    Attributes:
        beta: β₀, β₁; NaN where the regression has no solution.
        covariance: of β, shape (2, 2).
    """

    beta: FloatArray
    covariance: FloatArray

    def pod(self, a: FloatArray) -> FloatArray:
        """Return the probability of detection of lengths a, same shape."""
        return self._probability(a, 0.0)

    def lower(self, a: FloatArray, level: float = _BOUND) -> FloatArray:
        """Return its lower one-sided confidence bound (Wald, on the logit), same shape."""
        return self._probability(a, float(norm.ppf(level)))

    def _probability(self, a: FloatArray, deviations: float) -> FloatArray:
        columns = np.stack([np.ones_like(a), np.log(a)], axis=-1)
        spread = np.sqrt(np.einsum("...i,ij,...j->...", columns, self.covariance, columns))
        logit = columns @ self.beta - deviations * spread
        return np.asarray(0.5 * (1.0 + np.tanh(0.5 * logit)))

    def length(self, probability: float, level: float | None = None) -> float:
        """Return the length with this POD, or whose lower bound is; NaN: there is none.

        Args:
            probability: for example 0.9.
            level: of the bound; None: the curve itself.
        """
        if not np.isfinite(self.beta).all() or self.beta[1] <= 0.0:
            return math.nan
        middle = float(-self.beta[0] / self.beta[1])
        a = np.exp(np.linspace(middle - 5.0, middle + 5.0, 20_001))
        values = self.pod(a) if level is None else self.lower(a, level)
        above = np.flatnonzero(values >= probability)
        return float(a[above[0]]) if above.size else math.nan


def logistic(a: FloatArray, hit: BoolArray) -> Curve:
    """Return the logistic regression of hits on ln a.

    Without misses, without hits, or with lengths that separate both, it has no solution: NaN.

    Args:
        a: lengths, shape (n,).
        hit: shape (n,).
    """
    from statsmodels.api import GLM, families

    nothing = Curve(np.full(2, np.nan), np.full((2, 2), np.nan))
    if hit.all() or not hit.any() or a[hit].min() > a[~hit].max():
        return nothing
    columns = np.stack([np.ones_like(a), np.log(a)], axis=-1)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = GLM(hit.astype(np.float64), columns, family=families.Binomial()).fit()
    if not np.isfinite(found.bse).all():
        return nothing
    return Curve(np.asarray(found.params), np.asarray(found.cov_params()))


@dataclass(frozen=True)
class Trials:
    """Hits and misses of a population at one noise.

    Attributes:
        noise_db: of the sensor.
        specimens: the structures, shape (n,).
        start, end: marked ends [m], NaN where nothing is called, shape (n,).
        hit: called, and something of the delamination is marked, shape (n,).
        score: largest index over its limit of noise, shape (n,).
    """

    noise_db: float
    specimens: tuple[Specimen, ...]
    start: FloatArray
    end: FloatArray
    hit: BoolArray
    score: FloatArray

    @property
    def lengths(self) -> FloatArray:
        """Lengths of the delaminations, shape (n,) [m]."""
        return np.array([own.length for own in self.specimens])

    @property
    def error(self) -> float:
        """Median error of both ends where something is detected [m]; NaN: nothing is."""
        pairs = [
            (abs(start - own.start), abs(end - own.end))
            for own, start, end, hit in zip(
                self.specimens, self.start, self.end, self.hit, strict=True
            )
            if hit
        ]
        return float(np.median(pairs)) if pairs else math.nan

    def of(self, chosen: BoolArray) -> Trials:
        """Return the trials of some of the specimens."""
        kept = tuple(own for own, there in zip(self.specimens, chosen, strict=True) if there)
        return Trials(
            self.noise_db, kept, self.start[chosen], self.end[chosen], self.hit[chosen],
            self.score[chosen],
        )  # fmt: skip


def grid(case: Case, supports: Sequence[str], frequencies: Sequence[float]) -> list[Specimen]:
    """Return the specimens of the grid: supports, frequencies, lengths, depths, positions."""
    L = case.length
    h = sum(own.thickness or 0.0 for own in case.lamina)
    return [
        Specimen(L * (m - 0.5 * a), L * (m + 0.5 * a), h * depth, support, frequency)
        for support, frequency, a, depth, m in product(
            supports, frequencies, LENGTHS, DEPTHS, MIDDLES
        )
    ]


def trials(found: Population, noise_db: float, seed: int = 1) -> Trials:
    """Measure each specimen once with a noisy sensor and judge it by the 2f-curvature."""
    rng = np.random.default_rng(seed)
    n = len(found.specimens)
    start, end, score = (np.full(n, np.nan) for _ in range(3))
    hit = np.zeros(n, dtype=np.bool_)
    for k, own in enumerate(found.specimens):
        if not found.is_there(k):
            continue
        noisy = found.shapes(k, noise_db, rng)
        called = mark("curvature", noisy)
        start[k], end[k] = called.start, called.end
        score[k] = float((called.index.values / called.index.limits).max())
        hit[k] = called.is_detected and called.start <= own.end and called.end >= own.start
    return Trials(noise_db, found.specimens, start, end, hit, score)


def intact_scores(
    case: Case, support: str, frequency: float, noise_db: float, *, n: int = INTACT, seed: int = 2
) -> FloatArray:
    """Return the largest index over its limit of n noisy intact beams, shape (n,).

    The noise is in the samples, and the limit follows from the noise between the harmonics, as of a
    measurement. A beam is called if its score is above 1.
    """
    changed = case.with_overrides(
        {
            "support.end": support,
            "excitation.frequency": frequency,
            "mesh.elements": ELEMENTS,
            "time.steps_per_period": STEPS,
        }
    )
    scan = Scan(noise_db=noise_db, periods=PERIODS, sampling_rate=SAMPLES * frequency)
    pure = simulated(intact(changed), scan)
    noise = pure.noise_of(scan)
    scores = []
    for k in range(n):
        noisy = pure.noisy(noise, seed * 1_000_003 + k)
        shapes = shapes_of(noisy.field, noisy.times, frequency, noisy.x, orders=(1.0, 2.0))
        index = curvature(shapes)
        scores.append(float((index.values / index.limits).max()))
    return np.array(scores)


def roc(damaged: FloatArray, intact_ones: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return false-call rates and rates of detection for every threshold on the score.

    Args:
        damaged: scores of damaged structures, shape (n,); NaN: none.
        intact_ones: scores of intact structures, shape (m,).
    """
    thresholds = np.unique(np.concatenate([intact_ones, damaged[np.isfinite(damaged)]]))[::-1]
    thresholds = np.concatenate([[np.inf], thresholds])
    false = np.array([(intact_ones >= t).mean() for t in thresholds])
    true = np.array([(damaged >= t).mean() for t in thresholds])
    return false, true
