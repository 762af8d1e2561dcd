"""What a motion does: whether it is settled, its period, its kind and its attractor.

The strobes z_k of a motion that tends to one of P periods are modelled as

    z_k = a_p + b_p e^(d (n - k)) + r_k,    p = k mod P,

where d is the decay of the slowest mode of the structure in one period and n the last period. The
b_p are what is left at the end of a transient that creeps (P = 1) or beats like a motion of P
periods. The rest r_k is a beat that does not repeat and the scatter of the cycles,
E|r_k|² = s² + t² e^(2 d (n - k)); t is what is left of the beat. A transient that decays faster
than the slowest mode is overestimated.

A motion whose last strobes repeat may wander all the same: on a torus that turns slowly, or in a
transient slower than the slowest mode, as next to a bifurcation. It has settled only if all judged
strobes stay near the fitted ones, and if the P phases differ by `LEAVES` times more than that. A
motion that repeats better by `LEAVES` after a multiple of P has that period.

Where nothing touches, the motion is linear: its cycles do not scatter, all of r_k is transient, and
its steady motion has the period of the excitation. With contact, a beat can be told from scatter
only if it would have decayed visibly within the strobes that are judged.

Kinds and attractors follow from stroboscopic points and amplitudes. The thresholds are the
constants below; figures that use them print them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from delam_fem.numerics.types import BoolArray, FloatArray, IntArray

Word = Literal["settled", "not settled", "irregular"]
"""The verdicts on a motion."""

TOLERANCE = 0.01
"""Largest transient of a settled motion, in half peak-to-peak amplitudes."""
FEWEST = 10
"""Smallest number of judged strobes of each of the P phases."""
VISIBLE = 1.0
"""Decay 2 d L of the power of a transient within L judged periods that can be seen in scatter."""
SLOWEST = 0.1
"""Smallest decay d L within the judged periods that the model can tell from no decay at all."""
HIGHEST = 150.0
"""Largest e-folds of a transient within the judged periods; more says nothing, and overflows."""
REPEATS = 0.10
"""Largest rms difference of displacements P periods apart in a motion of P periods, in half
peak-to-peak amplitudes."""
MARGIN = 1.2
"""Factor below `REPEATS` within which chance decides whether the judged strobes repeat."""
LEAVES = 2.0
"""Ratio of the differences of strobes P and a multiple of P periods apart from which the multiple
is the period."""
DOUBLED = 0.02
"""Difference of displacements P periods apart below which no multiple of P is looked for, in half
peak-to-peak amplitudes."""
LONGEST = 8
"""Longest period of a motion that counts as repeating."""
SURE = 2.0
"""Standard errors within which a fitted transient counts as none."""

TIED = 1e-9
"""Relative difference of excesses within which probes are worst together: scatter alone gives all
of them the same."""


@dataclass(frozen=True)
class Settling:
    """A verdict on a motion, and the numbers behind it.

    Attributes:
        word: "settled", "not settled" or "irregular".
        periodicity: periods after which the settled motion repeats; None unless settled.
        transient: what is left of the transient in the last period, in half peak-to-peak
            amplitudes [-]; NaN if there are too few strobes.
        uncertainty: two standard errors of the transient [-].
        scatter: rms of the cycles about the fitted motion, in half peak-to-peak amplitudes [-].
        allowed: transient up to which the motion counts as settled [-].
        decay: e-folds of the slowest mode of the structure per period [-].
        observed_decay: e-folds per period by which strobes P periods apart draw nearer [-]; NaN if
            they are all alike.
        periods_judged: number of last periods that were judged.
        periods_needed: number of further periods until the transient is allowed, by the slowest
            mode, at most; 0 if it is, None if nothing bounds it, as of a motion that wanders. With
            too few strobes: as if the motion had begun with a transient as large as itself.
    """

    word: Word
    periodicity: int | None
    transient: float
    uncertainty: float
    scatter: float
    allowed: float
    decay: float
    observed_decay: float
    periods_judged: int
    periods_needed: int | None


def judge(
    strobes: FloatArray, periodicity: int | None, decay: float, *, is_linear: bool
) -> Settling:
    """Return whether a motion has settled.

    The second half of the strobes is judged, at least the last 2 `FEWEST`; the first half is the
    transient that every run begins with.

    Args:
        strobes: displacement and velocity of the probes at the end of each period, each over half
            its peak-to-peak amplitude, shape (2, n_probes, n_periods) [-].
        periodicity: P, after which the strobes of the last periods repeat roughly; None: none.
        decay: d, the e-folds of the slowest mode of the structure in one period [-]; 0 if unknown.
        is_linear: whether nothing has touched within the periods that are judged.
    """
    n = strobes.shape[-1]
    judged = strobes[..., min(n // 2, max(0, n - 2 * FEWEST)) :]
    P = 1 if is_linear else periodicity or 1
    length = judged.shape[-1]
    if length < FEWEST * P or not (np.isfinite(judged).all() and math.isfinite(decay)):
        nothing = math.nan
        needed = _needed(1.0 / TOLERANCE, decay)
        missing = None if needed is None else max(needed - n, 1)
        return Settling(
            "not settled", None, nothing, nothing, nothing, TOLERANCE, decay, nothing, length,
            missing,
        )  # fmt: skip
    rate = max(decay, SLOWEST / length)
    creep, error, residual = _creeping(judged, P, rate)
    beat = _decaying(residual, decay)
    scatter = np.zeros(len(creep))
    if is_linear:
        error = np.zeros_like(error)
    elif 2.0 * decay * length >= VISIBLE:
        beat, scatter = _beating(residual, rate)
    own_allowed = np.maximum(TOLERANCE, scatter)
    left = np.hypot(np.sqrt(np.maximum(creep**2 - error**2, 0.0)), beat)
    excess = np.maximum(left, SURE * error) / own_allowed
    is_worst = excess >= (1.0 - TIED) * excess.max()
    worst = int(np.argmax(np.where(is_worst, own_allowed, 0.0)))
    transient, uncertainty, allowed = (
        float(values[worst]) for values in (left, SURE * error, own_allowed)
    )
    is_near = transient <= allowed and uncertainty <= allowed
    is_over = is_near and (is_linear or periodicity is None or _repeats(judged, residual, P))
    is_single = is_linear or periodicity is not None
    if is_over and periodicity and not is_linear and _multiple(judged[0], P) != P:
        return judge(strobes, _multiple(judged[0], P), decay, is_linear=False)
    word: Word = "not settled" if not is_over else "settled" if is_single else "irregular"
    needed = 0 if is_over else _needed(max(transient, uncertainty) / allowed, decay)
    needed = None if is_near and not is_over else needed
    return Settling(
        word, P if word == "settled" else None, transient, uncertainty, float(scatter[worst]),
        allowed, decay, _observed(judged, P), length, needed,
    )  # fmt: skip


def _repeats(judged: FloatArray, rest: FloatArray, P: int) -> bool:
    """Return whether displacements stay near P fitted phases that differ by clearly more."""
    away = float(np.sqrt((rest[0] ** 2).mean(axis=-1)).max())
    phases = np.array([judged[0, :, phase::P].mean(axis=-1) for phase in range(P)])
    apart = float(phases.std(axis=0).max())
    return math.sqrt(2.0) * away <= REPEATS / MARGIN and (P == 1 or apart > LEAVES * away)


def _multiple(z: FloatArray, P: int) -> int | None:
    """Return P, or the multiple of it after which displacements repeat better; None: too long."""
    apart = {
        times: float(np.sqrt(((z[:, times * P :] - z[:, : -times * P]) ** 2).mean(axis=-1)).max())
        for times in range(1, LONGEST + 1)
        if 2 * times * P <= z.shape[-1]
    }
    far = (k for k in apart if apart[1] > max(LEAVES * apart[k], DOUBLED))
    period = P * next(far, 1)
    return period if period <= LONGEST else None


def _needed(excess: float, decay: float) -> int | None:
    """Return the number of periods in which a transient shrinks by a factor; None: never."""
    return math.ceil(math.log(excess) / decay) if decay > 0.0 else None


def _creeping(z: FloatArray, P: int, rate: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Fit a_p + b_p e^(rate (n - k)) to strobes of shape (2, n_probes, n).

    Returns:
        The rms of b_p over the phases in the phase plane of each probe, its standard error, both
        of shape (n_probes,), and the rest, of the shape of the strobes.
    """
    grown = _growth(rate, z.shape[-1])
    residual = np.empty_like(z)
    squares = np.zeros(z.shape[1])
    variances = np.zeros(z.shape[1])
    for phase in range(P):
        samples = z[..., phase::P]
        g = grown[phase::P] - grown[phase::P].mean()
        b = samples @ g / (g @ g)
        residual[..., phase::P] = samples - samples.mean(axis=-1, keepdims=True) - b[..., None] * g
        freedom = max(samples.shape[-1] - 2, 1)
        noise = (
            (residual[..., phase::P] ** 2).sum(axis=-1) / freedom * _memory(residual[..., phase::P])
        )
        squares += (b**2).sum(axis=0) / P
        variances += (noise / (g @ g)).sum(axis=0) / P
    return np.sqrt(squares), np.sqrt(variances), residual


def _growth(rate: float, n: int) -> FloatArray:
    """Return e^(rate (n - k)) of the periods k = 1 … n, shape (n,); at most e^`HIGHEST`."""
    return np.asarray(np.exp(np.minimum(rate * np.arange(n - 1.0, -1.0, -1.0), HIGHEST)))


def _memory(rest: FloatArray) -> FloatArray:
    """Return by how much correlated cycles widen the variance of a fit, shape of rest[..., 0].

    (1 + c)/(1 - c) is the factor of a first-order process with the correlation c of neighbours.
    """
    power = (rest**2).sum(axis=-1)
    both = (rest[..., 1:] * rest[..., :-1]).sum(axis=-1)
    c = np.clip(np.divide(both, power, out=np.zeros_like(power), where=power > 0.0), 0.0, 0.9)
    return np.asarray((1.0 + c) / (1.0 - c))


def _decaying(rest: FloatArray, decay: float) -> FloatArray:
    """Return t of the rest as if all of it were the slowest transient, shape (n_probes,)."""
    power = (rest**2).sum(axis=0)
    grown = _growth(2.0 * decay, power.shape[-1])
    return np.asarray(np.sqrt(power.mean(axis=-1) / grown.mean()))


def _beating(rest: FloatArray, rate: float) -> tuple[FloatArray, FloatArray]:
    """Fit s² + t² e^(2 rate (n - k)) to the power of the rest; return t and s, (n_probes,).

    The fit is linear least squares with s², t² ≥ 0; t² within two standard errors counts as none.
    """
    power = (rest**2).sum(axis=0)
    n = power.shape[-1]
    grown = _growth(2.0 * rate, n)
    g = grown - grown.mean()
    slope = power @ g / (g @ g)
    left = power - power.mean(axis=-1, keepdims=True) - slope[:, None] * g
    error = np.sqrt((left**2).sum(axis=-1) / max(n - 2, 1) / (g @ g))
    squares = np.clip(np.where(slope > SURE * error, slope, 0.0), 0.0, _decaying(rest, rate) ** 2)
    scatter = np.maximum(power.mean(axis=-1) - squares * grown.mean(), 0.0)
    return np.sqrt(squares), np.sqrt(scatter)


def _observed(z: FloatArray, P: int) -> float:
    """Return the e-folds per period by which strobes P periods apart draw nearer; NaN: none."""
    change = ((z[..., P:] - z[..., :-P]) ** 2).sum(axis=(0, 1))
    half = change.size // 2
    early = change[:half].mean()
    late = change[-half:].mean()
    if not (early > 0.0 and late > 0.0):
        return math.nan
    return float(0.5 * np.log(early / late) / (change.size - half))


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
SAME_ATTRACTOR = 0.12
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
        strobes: displacement of the probes at the end of periods, shape (..., n_laminae, n) [m].
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
    is_done = outcome == "completed"
    share = np.zeros(outcome.shape)
    share[is_done] = line_share(strobes[is_done]).min(axis=-1)
    surely = np.ones(outcome.shape, dtype=np.bool_)
    kinds = {  # the first that holds
        DIVERGED: outcome == "diverged",
        FAILED: ~is_done,
        UNSETTLED: ~(surely if is_settled is None else is_settled),
        UNDECIDED: ~(surely if is_decided is None else is_decided),
        PERIOD_1: periodicity == 1,
        HIGHER: periodicity > 1,
        QUASI_PERIODIC: share >= LINE_SHARE,
    }
    return np.select([*kinds.values()], [*kinds], IRREGULAR)


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
    line_power = np.zeros(total.shape)
    bins = np.arange(power.shape[-1])
    left = power.copy()
    for _ in range(LINES):
        peak = left.argmax(axis=-1)[..., None]
        line = np.abs(bins - peak) <= LINE_WIDTH
        line_power += np.where(line, left, 0.0).sum(axis=-1)
        left[line] = 0.0
    share = np.divide(line_power, total, out=np.ones_like(total), where=total > 0.0)
    return np.where(np.isfinite(total), share, 0.0)


@dataclass(frozen=True)
class Attractors:
    """The attractors of a set of points, the most frequent first.

    Attributes:
        number: of the attractor of each point, -1 for none, shape (...).
        periodicity: the most frequent one of each attractor, NaN for none, shape (n_attractors,).
        amplitude: half peak-to-peak of the probes, the median, shape (n_attractors, n_laminae) [m].
        share: of the points, shape (n_attractors,) [-].
    """

    number: IntArray
    periodicity: FloatArray
    amplitude: FloatArray
    share: FloatArray


def attractors(
    periodicity: FloatArray, low: FloatArray, high: FloatArray, strobes: FloatArray
) -> Attractors:
    """Group the final motions of points into attractors by their fingerprints.

    The fingerprint does not depend on which of its periods a period-doubled motion ends with:
    extremes of the probes, mean and standard deviation of strobes. Points are of one attractor
    where no part differs from that of the attractor's first point by `SAME_ATTRACTOR` times the
    larger probe's half peak-to-peak amplitude.

    Args:
        periodicity: NaN for none, shape (...).
        low: smallest displacement of the reference probes, shape (..., n_laminae) [m].
        high: largest, likewise.
        strobes: displacement of the probes at the end of periods, shape (..., n_laminae, n) [m].

    Returns:
        The attractors; a point with NaN in its fingerprint belongs to none.
    """
    shape, n_laminae = periodicity.shape, low.shape[-1]
    amplitude = (0.5 * (high - low)).reshape(-1, n_laminae)
    parts = [low, high, strobes.mean(axis=-1), strobes.std(axis=-1)]
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
        np.array([_most_frequent(periodicity.ravel()[indices]) for indices in members]),
        np.array([np.median(amplitude[indices], axis=0) for indices in members]),
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
    return np.asarray(~np.isin(number, np.concatenate(shared)))


def _most_frequent(values: FloatArray) -> float:
    """Return the value that occurs most often; NaN counts as a value."""
    candidates, counts = np.unique(values, return_counts=True)
    return float(candidates[counts.argmax()])
