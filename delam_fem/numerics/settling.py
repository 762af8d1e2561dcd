"""Judge from the strobes of a motion whether its transient has died out.

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
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from delam_fem.numerics.types import FloatArray

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
    P, length = 1 if is_linear else periodicity or 1, judged.shape[-1]
    if length < FEWEST * P or not (np.isfinite(judged).all() and math.isfinite(decay)):
        nothing, needed = math.nan, _needed(1.0 / TOLERANCE, decay)
        missing = None if needed is None else max(needed - n, 1)
        return Settling(
            "not settled", None, nothing, nothing, nothing, TOLERANCE, decay, nothing, length,
            missing,
        )  # fmt: skip
    rate = max(decay, SLOWEST / length)
    creep, error, rest = _creeping(judged, P, rate)
    beat, scatter = _decaying(rest, decay), np.zeros(len(creep))
    if is_linear:
        error = np.zeros_like(error)
    elif 2.0 * decay * length >= VISIBLE:
        beat, scatter = _beating(rest, rate)
    own_allowed = np.maximum(TOLERANCE, scatter)
    left = np.hypot(np.sqrt(np.maximum(creep**2 - error**2, 0.0)), beat)
    worst = int(np.argmax(np.maximum(left, SURE * error) / own_allowed))
    transient, uncertainty, allowed = (
        float(values[worst]) for values in (left, SURE * error, own_allowed)
    )
    is_near = transient <= allowed and uncertainty <= allowed
    is_over = is_near and (is_linear or periodicity is None or _repeats(judged, rest, P))
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
    n = z.shape[-1]
    grown = _growth(rate, n)
    rest = np.empty_like(z)
    squares, variances = np.zeros(z.shape[1]), np.zeros(z.shape[1])
    for phase in range(P):
        own = z[..., phase::P]
        g = grown[phase::P] - grown[phase::P].mean()
        b = own @ g / (g @ g)
        rest[..., phase::P] = own - own.mean(axis=-1, keepdims=True) - b[..., None] * g
        freedom = max(own.shape[-1] - 2, 1)
        noise = (rest[..., phase::P] ** 2).sum(axis=-1) / freedom * _memory(rest[..., phase::P])
        squares += (b**2).sum(axis=0) / P
        variances += (noise / (g @ g)).sum(axis=0) / P
    return np.sqrt(squares), np.sqrt(variances), rest


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
    widened: FloatArray = (1.0 + c) / (1.0 - c)
    return widened


def _decaying(rest: FloatArray, decay: float) -> FloatArray:
    """Return t if all of the rest is a transient that decays as slowly as it can, (n_probes,)."""
    power = (rest**2).sum(axis=0)
    grown = _growth(2.0 * decay, power.shape[-1])
    found: FloatArray = np.sqrt(power.mean(axis=-1) / grown.mean())
    return found


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
    largest = _decaying(rest, rate) ** 2
    squares = np.clip(np.where(slope > SURE * error, slope, 0.0), 0.0, largest)
    scatter = np.maximum(power.mean(axis=-1) - squares * grown.mean(), 0.0)
    return np.sqrt(squares), np.sqrt(scatter)


def _observed(z: FloatArray, P: int) -> float:
    """Return the e-folds per period by which strobes P periods apart draw nearer; NaN: none."""
    change = ((z[..., P:] - z[..., :-P]) ** 2).sum(axis=(0, 1))
    half = change.size // 2
    early, late = change[:half].mean(), change[-half:].mean()
    if not (early > 0.0 and late > 0.0):
        return math.nan
    return float(0.5 * np.log(early / late) / (change.size - half))
