"""Mean and confidence interval of a number that fluctuates, from the means of blocks.

Successive values of a motion depend on one another, so that their scatter says too little about the
error of their mean. Means over blocks that are longer than this memory are nearly independent and
nearly normal; Student's t gives the interval (batch means; Law & Kelton, Simulation Modeling and
Analysis, chapter 9).
"""

from __future__ import annotations

import numpy as np
from scipy.special import stdtrit  # scipy.stats has it too, and loads slowly

from delam_fem.numerics.arrays import FloatArray

CONFIDENCE = 0.95
BLOCKS = 10
"""Number of blocks: more give little narrower intervals, and blocks that are too short."""


def block_means(values: FloatArray, blocks: int = BLOCKS) -> FloatArray:
    """Return the means of equal blocks of the last values.

    Args:
        values: in the order of time, shape (..., n).
        blocks: number of blocks; n if there are fewer values.

    Returns:
        Shape (..., number of blocks). Up to `blocks` - 1 values at the start are left out.
    """
    n = values.shape[-1]
    blocks = min(blocks, n)
    length = n // max(blocks, 1)
    kept = values[..., n - blocks * length :]
    means: FloatArray = kept.reshape(*values.shape[:-1], blocks, length).mean(axis=-1)
    return means


def interval(means: FloatArray, confidence: float = CONFIDENCE) -> tuple[FloatArray, FloatArray]:
    """Return the mean of independent values and half the width of its confidence interval.

    >>> float(interval(np.array([1.0, 2.0, 3.0]))[1].round(3))
    2.484

    Args:
        means: of blocks, shape (..., m).
        confidence: probability that the interval contains the true mean.

    Returns:
        Both of shape (...); the width is NaN with fewer than two values.
    """
    m = means.shape[-1]
    middle: FloatArray = means.mean(axis=-1)
    if m < 2:
        return middle, np.full_like(middle, np.nan)
    error = means.std(axis=-1, ddof=1) / np.sqrt(m)
    return middle, error * stdtrit(m - 1, 0.5 + 0.5 * confidence)
