"""Classify motions by kind and by attractor, from stroboscopic points and amplitudes.

All functions are pure functions of arrays. The thresholds are the constants below; figures that use
them print them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from delam_fem.numerics.types import BoolArray, FloatArray, IntArray

TextArray = npt.NDArray[np.object_] | npt.NDArray[np.str_]

PERIOD_1, HIGHER, QUASI_PERIODIC, IRREGULAR, DIVERGED, FAILED, UNDECIDED, UNSETTLED = range(8)
"""Kinds of motion, as indices into `KINDS`.

PERIOD_1 repeats after one period of the excitation, HIGHER after 2 to 8 periods. QUASI_PERIODIC
does not repeat but has few frequencies; IRREGULAR has many. DIVERGED left all bounds; FAILED was
not computed. UNDECIDED lies so near to the bound between two of the others that chance decides.
UNSETTLED is still on its way to one of them.
"""
KINDS = (
    "period 1", "higher order", "quasi-periodic", "irregular", "diverged", "failed", "undecided",
    "not settled",
)  # fmt: skip
"""Names of the kinds of motion."""

LINES = 4
"""Number of spectral lines that hold nearly all stroboscopic power of a quasi-periodic motion."""
LINE_SHARE = 0.9
"""Smallest share of the power in these lines that counts as quasi-periodic; for white noise
with 64 bins the four strongest lines hold about 0.6."""
LINE_WIDTH = 2
"""Bins on each side that belong to a line, because the Hann window spreads it."""
FEWEST_STROBES = 64
"""Smallest number of strobes that can separate lines from noise."""
SAME_ATTRACTOR = 0.2
"""Largest difference of two motions on one attractor, relative to half their peak-to-peak
amplitude; successive cycles of one clapping motion already differ by 0.1."""


def kinds_of_motion(
    outcome: TextArray,
    periodicity: FloatArray,
    strobes: FloatArray,
    is_decided: BoolArray | None = None,
    is_settled: BoolArray | None = None,
) -> IntArray:
    """Return the kind of motion of each point.

    Args:
        outcome: "completed", "diverged" or anything else, shape (...).
        periodicity: see `diagnostics.periodicity`, NaN for none, shape (...).
        strobes: displacement of the tips at the end of periods, shape (..., n_laminae, n) [m].
        is_decided: see `diagnostics.is_decided`, shape (...); None: all are.
        is_settled: whether the transient of the motion has died out, shape (...); None: of all.

    Returns:
        Indices into `KINDS`, shape (...).

    Raises:
        ValueError: there are fewer than `FEWEST_STROBES` strobes.
    """
    n = strobes.shape[-1]
    if n < FEWEST_STROBES:
        raise ValueError(
            f"kinds of motion: expected at least {FEWEST_STROBES} strobes per point, given {n}; "
            f"compute the sweep with record.strobes = {2 * FEWEST_STROBES}"
        )
    kinds = np.full(outcome.shape, FAILED, dtype=np.int64)
    kinds[outcome == "diverged"] = DIVERGED
    is_done = outcome == "completed"
    has_lines = np.zeros(outcome.shape, dtype=np.bool_)
    has_lines[is_done] = line_share(strobes[is_done]).min(axis=-1) >= LINE_SHARE
    kinds[is_done] = np.where(has_lines[is_done], QUASI_PERIODIC, IRREGULAR)
    kinds[is_done & (periodicity > 1)] = HIGHER
    kinds[is_done & (periodicity == 1)] = PERIOD_1
    if is_decided is not None:
        kinds[is_done & ~is_decided] = UNDECIDED
    if is_settled is not None:
        kinds[is_done & ~is_settled] = UNSETTLED
    return kinds


def line_share(strobes: FloatArray) -> FloatArray:
    """Return the share of the power about the mean in the `LINES` strongest spectral lines.

    Args:
        strobes: equidistant samples, shape (..., n).

    Returns:
        Shares, shape (...) [-]; 1 for constant samples, 0 if a sample is not a number.
    """
    n = strobes.shape[-1]
    about_mean = strobes - strobes.mean(axis=-1, keepdims=True)
    power = np.abs(np.fft.rfft(about_mean * np.hanning(n), axis=-1)) ** 2
    total = power.sum(axis=-1)
    found = np.zeros(total.shape)
    bins = np.arange(power.shape[-1])
    left = power.copy()
    for _ in range(LINES):
        peak = left.argmax(axis=-1)[..., None]
        line = np.abs(bins - peak) <= LINE_WIDTH
        found += np.where(line, left, 0.0).sum(axis=-1)
        left[line] = 0.0
    share = np.divide(found, total, out=np.ones_like(total), where=total > 0.0)
    return np.where(np.isfinite(total), share, 0.0)


@dataclass(frozen=True)
class Attractors:
    """The attractors of a set of points, the most frequent first.

    Attributes:
        number: of the attractor of each point, -1 for none, shape (...).
        periodicity: the most frequent one of each attractor, NaN for none, shape (n_attractors,).
        amplitude: half peak-to-peak of the tips, the median, shape (n_attractors, n_laminae) [m].
        share: of the points, shape (n_attractors,) [-].
    """

    number: IntArray
    periodicity: FloatArray
    amplitude: FloatArray
    share: FloatArray


def attractors(
    periodicity: FloatArray, tip_min: FloatArray, tip_max: FloatArray, strobes: FloatArray
) -> Attractors:
    """Group the final motions of points into attractors by their fingerprints.

    The fingerprint does not depend on which of its periods a period-doubled motion ends with:
    extremes of the tips, mean and standard deviation of their strobes. Points are of one attractor
    where no part differs from that of the attractor's first point by `SAME_ATTRACTOR` times the
    larger tip's half peak-to-peak amplitude.

    Args:
        periodicity: NaN for none, shape (...).
        tip_min: smallest displacement of the tips, shape (..., n_laminae) [m].
        tip_max: largest, likewise.
        strobes: displacement of the tips at the end of periods, shape (..., n_laminae, n) [m].

    Returns:
        The attractors; a point with NaN in its fingerprint belongs to none.
    """
    shape, n_laminae = periodicity.shape, tip_min.shape[-1]
    amplitude = (0.5 * (tip_max - tip_min)).reshape(-1, n_laminae)
    parts = [tip_min, tip_max, strobes.mean(axis=-1), strobes.std(axis=-1)]
    prints = np.stack(parts, axis=-1).reshape(-1, n_laminae * len(parts))
    bound = SAME_ATTRACTOR * amplitude.max(axis=-1)
    number = np.full(len(prints), -1, dtype=np.int64)
    first: list[int] = []
    for i in np.flatnonzero(np.isfinite(prints).all(axis=1)):
        near = np.abs(prints[first] - prints[i]).max(axis=1, initial=0.0)
        same = np.flatnonzero(near <= np.maximum(bound[first], bound[i]))
        if not same.size:
            first.append(int(i))
        number[i] = same[0] if same.size else len(first) - 1
    counts = np.bincount(number[number >= 0], minlength=len(first))
    order = np.argsort(-counts, kind="stable")
    number[number >= 0] = np.argsort(order)[number[number >= 0]]
    members = [number == k for k in range(len(first))]
    return Attractors(
        number.reshape(shape),
        np.array([_most_frequent(periodicity.ravel()[own]) for own in members]),
        np.array([np.median(amplitude[own], axis=0) for own in members]),
        counts[order] / max(number.size, 1),
    )


def is_isolated(number: IntArray) -> BoolArray:
    """Return which cells of a map have an attractor that no two neighbouring cells share.

    A single cell amid others shows no attractor: a transient that is not over, or a motion that
    lies near the bound `SAME_ATTRACTOR`, looks alike.

    Args:
        number: of the attractor of each cell, -1 for none, shape (...).
    """
    shared = [np.array([-1])]
    for axis in range(number.ndim):
        along = np.moveaxis(number, axis, 0)
        shared.append(along[1:][along[1:] == along[:-1]])
    isolated: BoolArray = ~np.isin(number, np.concatenate(shared))
    return isolated


def _most_frequent(values: FloatArray) -> float:
    """Return the value that occurs most often; NaN counts as a value."""
    found, counts = np.unique(values, return_counts=True)
    return float(found[counts.argmax()])
