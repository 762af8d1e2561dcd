"""Mark an interval where an index is large, and how far noise moves its ends."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from delam_fem.numerics.arrays import BoolArray, FloatArray
from delam_fem.studies.detection.indices import FALSE_CALLS, INDICES, IndexValues
from delam_fem.studies.detection.shapes import Shapes

SHARE = 0.3
"""Share of its largest value above which an index is marked."""
CONFIDENCE = 0.95
"""Share of the true ends within their bounds (docs/calibration.md)."""
_ROUND_OFF = 1e-9


@dataclass(frozen=True)
class Mark:
    """What an index says of a beam.

    Attributes:
        name: name of the index.
        index: its values and limits.
        start, end: outermost marked points [m]; NaN: none.
    """

    name: str
    index: IndexValues
    start: float
    end: float

    @property
    def is_detected(self) -> bool:
        """Whether the index exceeds the limit of noise somewhere."""
        return bool(np.isfinite(self.start))

    @property
    def is_marked(self) -> BoolArray:
        """Which points are marked, shape (n,)."""
        values = self.index.values
        return np.asarray(values > np.maximum(SHARE * values.max(), self.index.limits))

    def contrast(self, start: float, end: float) -> float:
        """Return the largest value within a true interval over the largest outside it [-].

        Points on the edges count as inside. NaN if there is no point outside or none inside.
        """
        x, values = self.index.x, self.index.values
        slack = _ROUND_OFF * float(x[-1])
        inside = (x >= start - slack) & (x <= end + slack)
        if inside.all() or not inside.any():
            return float("nan")
        return float(values[inside].max() / values[~inside].max())


@dataclass(frozen=True)
class Repeated:
    """Ends and calls over repeated noise.

    Attributes:
        calls: share of the repetitions that call the beam damaged [-].
        start, end: bounds of the true ends, each of shape (2,) [m]: those of the marks, where it is
            called, and a spacing more, since an edge lies between two points.
        middle: medians of start and end, shape (2,) [m].
    """

    calls: float
    start: FloatArray
    end: FloatArray
    middle: FloatArray


def mark(name: str, shapes: Shapes, false_calls: float = FALSE_CALLS) -> Mark:
    """Mark the points at which an index exceeds its limit and 30 % of its largest value.

    The interval runs from the first marked point to the last: what lies between is filled.

    Args:
        name: an index of `INDICES`.
        shapes: of the motion.
        false_calls: rate of calls by noise alone.
    """
    index = INDICES[name](shapes, false_calls)
    empty = Mark(name, index, float("nan"), float("nan"))
    marked = index.x[empty.is_marked]
    return empty if not marked.size else Mark(name, index, float(marked[0]), float(marked[-1]))


def repeated(
    name: str, shapes: Shapes, noise: float | FloatArray, *, repetitions: int = 200, seed: int = 1
) -> Repeated:
    """Mark shapes again and again with new noise.

    Args:
        name: an index of `INDICES`.
        shapes: without noise; or measured, whose own noise then counts twice, so that the bounds
            are rather too wide.
        noise: root mean square of the noise of a shape, of all points or of each.
        repetitions: number of repetitions.
        seed: of the random numbers.
    """
    rng = np.random.default_rng(seed)
    ends = []
    for _ in range(repetitions):
        found = mark(name, replace(shapes.noisy(noise, rng), noise=noise, n_lines=shapes.n_lines))
        if found.is_detected:
            ends.append((found.start, found.end))
    shares = (0.5 * (1.0 - CONFIDENCE), 0.5, 0.5 * (1.0 + CONFIDENCE))
    found_ends = np.quantile(ends, shares, axis=0) if ends else np.full((3, 2), np.nan)
    bounds = found_ends[[0, 2]] + np.diff(shapes.x).max() * np.array([[-1.0], [1.0]])
    return Repeated(len(ends) / repetitions, bounds[:, 0], bounds[:, 1], found_ends[1])
