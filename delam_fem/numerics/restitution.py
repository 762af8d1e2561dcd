"""Identify the coefficient of restitution from two velocity signals, computed or measured.

Velocities are smooth between strikes and jump at a strike. Straight lines are fitted to the samples
on both sides of a jump and extended to its middle; there they give the velocities before and after.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from delam_fem.numerics.types import FloatArray

SMALLEST_JUMP = 0.2
"""Smallest jump that counts as a strike, as a share of the largest jump; smaller ones are waves or
noise."""


@dataclass(frozen=True)
class Strike:
    """One strike with the velocities before and after it.

    Attributes:
        time: middle of the jump [s].
        before: velocities of bodies 1 and 2 just before the strike, shape (2,) [m/s].
        after: velocities of bodies 1 and 2 just after the strike, shape (2,) [m/s].
        mass_ratio: m1/m2 [-].
    """

    time: float
    before: FloatArray
    after: FloatArray
    mass_ratio: float

    @property
    def approach(self) -> float:
        """Gap rate before the strike; negative [m/s]."""
        return float(self.before[1] - self.before[0])

    @property
    def restitution(self) -> float:
        """Coefficient e = -(gap rate after)/(gap rate before) [-]. Source: paper eq. 3."""
        return restitution(self.before, self.after)

    @property
    def restitution_by_body(self) -> tuple[float, float]:
        """Coefficient e from the jump of each body alone [-]; see `restitution_by_body`."""
        return restitution_by_body(self.before, self.after, self.mass_ratio)

    @property
    def apparent_mass_ratio(self) -> float:
        """Ratio m1/m2 that follows from the two jumps by conservation of momentum [-]."""
        jump = self.after - self.before
        return float(-jump[1] / jump[0])


def restitution(before: npt.ArrayLike, after: npt.ArrayLike) -> float:
    """Return the coefficient of restitution e = -(v2 - v1)⁺ / (v2 - v1)⁻.

    Args:
        before: velocities of bodies 1 and 2 before the strike, shape (2,) [m/s].
        after: velocities of bodies 1 and 2 after the strike, shape (2,) [m/s].

    Raises:
        ValueError: the bodies do not approach one another.

    Source: I. Müller, eq. 3.
    """
    (v1, v2), (w1, w2) = (np.asarray(v, dtype=np.float64) for v in (before, after))
    _require_approach(float(v2 - v1))
    return float(-(w2 - w1) / (v2 - v1))


def restitution_by_body(
    before: npt.ArrayLike, after: npt.ArrayLike, mass_ratio: float
) -> tuple[float, float]:
    """Return e from the jump of body 1 alone and from the jump of body 2 alone.

        v1⁺ = v1⁻ + (1 + e) m2/(m1 + m2) (v2 - v1)⁻
        v2⁺ = v2⁻ - (1 + e) m1/(m1 + m2) (v2 - v1)⁻

    Both values agree if momentum is conserved and the mass ratio is that of the masses that take
    part in the strike.

    Args:
        before: velocities of bodies 1 and 2 before the strike, shape (2,) [m/s].
        after: velocities of bodies 1 and 2 after the strike, shape (2,) [m/s].
        mass_ratio: m1/m2 [-].

    Raises:
        ValueError: the bodies do not approach one another, or the mass ratio is not positive.

    Source: I. Müller, eq. 4 with both signs corrected (as printed, it gives (2 + e) instead of -e).
    """
    if not mass_ratio > 0.0:
        raise ValueError(f"mass ratio m1/m2: expected a number above 0, given {mass_ratio!r}")
    (v1, v2), (w1, w2) = (np.asarray(v, dtype=np.float64) for v in (before, after))
    approach = float(v2 - v1)
    _require_approach(approach)
    share_1, share_2 = 1.0 / (1.0 + mass_ratio), mass_ratio / (1.0 + mass_ratio)
    return float((w1 - v1) / (share_1 * approach)) - 1.0, float(
        (v2 - w2) / (share_2 * approach) - 1.0
    )


def identify(
    time: npt.ArrayLike,
    velocities: npt.ArrayLike,
    mass_ratio: float,
    *,
    jump_samples: int = 1,
    fit_samples: int = 3,
    apart: float = 0.0,
    smallest_jump: float = SMALLEST_JUMP,
) -> tuple[Strike, ...]:
    """Find the strikes in two velocity signals.

    A strike is a local maximum of the rise of the gap rate over `jump_samples` intervals, if the
    bodies approach one another before it. Of several rises within `apart` only the largest counts.

    Args:
        time: equidistant instants, shape (n,) [s].
        velocities: velocities of bodies 1 and 2 along an axis on which body 2 is ahead of body 1,
            shape (2, n) [m/s].
        mass_ratio: m1/m2 [-].
        jump_samples: number of intervals over which a jump is spread; 1 in computed signals.
        fit_samples: number of samples on each side for the fitted line; 1 takes the sample itself.
        apart: shortest time between two strikes [s].
        smallest_jump: smallest jump that counts, as a share of the largest [-].

    Returns:
        The strikes in the order of time.

    Raises:
        ValueError: the signals are too short, of different lengths, or not equidistant.
    """
    t, v = np.asarray(time, dtype=np.float64), np.asarray(velocities, dtype=np.float64)
    _check(t, v, jump_samples, fit_samples)
    rate = v[1] - v[0]
    rise = rate[jump_samples:] - rate[:-jump_samples]
    candidates = np.flatnonzero((rise >= smallest_jump * rise.max()) & (rate[:-jump_samples] < 0.0))
    inside = (candidates >= fit_samples - 1) & (
        candidates < t.size - jump_samples - fit_samples + 1
    )
    wait = max(apart, (jump_samples + fit_samples) * (t[1] - t[0]))
    chosen: list[int] = []
    for k in candidates[inside][np.argsort(-rise[candidates[inside]], kind="stable")].tolist():
        if all(abs(t[k] - t[other]) >= wait for other in chosen):
            chosen.append(k)
    strikes = (_strike(t, v, k, (jump_samples, fit_samples), mass_ratio) for k in sorted(chosen))
    return tuple(strike for strike in strikes if strike.approach < 0.0)


def _strike(
    t: FloatArray, v: FloatArray, k: int, samples: tuple[int, int], mass_ratio: float
) -> Strike:
    """Return the strike whose jump begins after sample k."""
    jump, fit = samples
    middle = 0.5 * (t[k] + t[k + jump])
    before = _extrapolated(t[k - fit + 1 : k + 1], v[:, k - fit + 1 : k + 1], middle)
    after = _extrapolated(t[k + jump : k + jump + fit], v[:, k + jump : k + jump + fit], middle)
    return Strike(float(middle), before, after, mass_ratio)


def _extrapolated(t: FloatArray, v: FloatArray, at: float) -> FloatArray:
    """Return the values at an instant of the least-squares lines through (t, v), shape (2,)."""
    mean: FloatArray = v.mean(axis=1)
    if t.size == 1:
        return mean
    about = t - t.mean()
    slope = (v @ about) / (about @ about)
    value: FloatArray = mean + slope * (at - t.mean())
    return value


def _require_approach(approach: float) -> None:
    if not approach < 0.0:
        raise ValueError(
            f"restitution: expected bodies that approach one another (v2 - v1 < 0), given "
            f"{approach!r} m/s; if body 1 is ahead, swap the two bodies"
        )


def _check(t: FloatArray, v: FloatArray, jump: int, fit: int) -> None:
    if v.shape != (2, t.size):
        raise ValueError(
            f"velocities: expected two signals of the {t.size} samples of time, shape (2, "
            f"{t.size}), given shape {v.shape}"
        )
    if min(jump, fit) < 1:
        raise ValueError(f"samples of jump and fit: expected at least 1, given {jump} and {fit}")
    if t.size < jump + 2 * fit:
        raise ValueError(f"time: expected at least {jump + 2 * fit} samples, given {t.size}")
    steps = np.diff(t)
    if not np.all(np.abs(steps - steps.mean()) <= 1e-6 * abs(steps.mean())) or steps[0] <= 0.0:
        raise ValueError("time: expected increasing equidistant instants; resample the signals")
