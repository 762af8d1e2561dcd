"""The length of a run (`Span`), and how its steps are divided near contact (`Refinement`).

A coarse step Δt is made if no gap is small. Otherwise it is divided into middle steps, and a middle
step near contact into fine steps of Δt/r. Contact laws are asked after every step, as always.

The gap of a pair is a parabola within a step of constant acceleration. It stays open if

    U + a min(U̇, 0) > 0 at the start,   U - a max(U̇, 0) > 0 at the end,   a = s Δt/2
(F1)

with the safety s = 1. A larger s covers the difference between the coarse and the true motion. The
signs are opposite for a pair that rests on a spring: it must stay closed. A pair that moves slower
than the threshold velocity γ does not divide a step: it rests, and a coarse step deals with it by
the contact law as any step does.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from delam_fem.numerics.types import IntArray
from delam_fem.system.caches import kept, njit
from delam_fem.system.errors import require, require_number

SAFETY = 2.0
"""Safety s of F1; tests/simulation/test_refinement.py shows what other values do."""
MISSED = 0.05
"""Share of unforeseen contacts (`recorder.EFFORT`) above which a run warns."""


@dataclass(frozen=True)
class Refinement:
    """How often steps are divided near contact.

    Attributes:
        factor: r, number of fine steps in a coarse step; 1: all steps are equal.
        slow: γ, gap rate up to which a pair does not divide a step [m/s].
    """

    factor: int = 1
    slow: float = 0.0

    @property
    def middle(self) -> int:
        """Number of middle steps in a coarse step: the divisor of r that is nearest to √r."""
        return next(m for m in range(math.isqrt(self.factor), 0, -1) if self.factor % m == 0)

    @property
    def divisions(self) -> tuple[int, ...]:
        """Number of steps in a coarse step at each level, from coarse to fine, without repeats."""
        return tuple(sorted({1, self.middle, self.factor}))


AHEAD, BACK = 1, 2
"""Parts of the result of `nearness`: a pair may close in the time ahead; it may have closed."""

NOT_REFINED = Refinement()
"""All steps are equal."""


def unforeseen_warning(contacts: IntArray) -> str | None:
    """Return a warning if too many contacts came as a surprise; None if not.

    A coarse step whose pair closes unforeseen is divided only by chance, because another pair was
    near. So their share tells how many contacts coarse steps have missed.

    Args:
        contacts: divided steps with an impact, and those of them whose first impact was unforeseen,
            by period, shape (n_periods, 2).
    """
    total, unforeseen = contacts.sum(axis=0).tolist()
    if unforeseen <= MISSED * total:
        return None
    return (
        f"{unforeseen} of {total} contacts in refined steps were unforeseen, so others may have "
        "been missed between coarse steps; try more time.steps_per_period and a smaller time.refine"
    )


@kept
def nearness(gap, rate, reach, slow):  # type: ignore[no-untyped-def]
    """Return whether a pair that is faster than `slow` may close by F1 (see `RefinedSteps`).

    The result is the sum of AHEAD, if a pair may close within the time `reach` ahead, and BACK, if
    a pair may have been closed within that time back. `reach` is the a of F1 [s].
    """
    flags = 0
    for k in range(gap.size):
        way = reach * abs(rate[k])
        if gap[k] <= way and abs(rate[k]) > slow:
            if gap[k] <= 0.0:
                return AHEAD + BACK
            flags |= AHEAD if rate[k] < 0.0 else BACK
    return flags


@kept
def base_rows(before, after, r, time_step):  # type: ignore[no-untyped-def]
    """Return (q, q', q'') of the base where r equal parts of a step begin and end, shape (r+1, 3).

    The other arguments are those of `base_within`.
    """
    rows = np.empty((r + 1, 3))
    for j in range(r + 1):
        rows[j] = base_within(before, after, j / r, time_step)
    rows[0] = before
    rows[r] = after
    return rows


@njit
def base_within(before, after, share, time_step):  # type: ignore[no-untyped-def]
    """Return (q, q', q'') of the base within a step.

    q and q' are cubic Hermite interpolants, q'' is linear. With a harmonic motion of N steps per
    period q is wrong by (2π/N)⁴/384 of its amplitude and q'' by (2π/N)²/8, as much as the scheme
    itself makes of the motion.

    Args:
        before: (q, q', q'') at the start of the step [m, m/s, m/s2].
        after: the same at its end.
        share: position within the step, from 0 to 1.
        time_step: Δt [s].
    """
    s = share
    back = 1.0 - s
    early = back * back * (1.0 + 2.0 * s)
    late = s * s * (3.0 - 2.0 * s)
    rise = s * back * back * time_step
    fall = -s * s * back * time_step
    q = early * before[0] + late * after[0] + rise * before[1] + fall * after[1]
    dq = early * before[1] + late * after[1] + rise * before[2] + fall * after[2]
    return q, dq, back * before[2] + s * after[2]


@dataclass(frozen=True)
class Span:
    """The length of a run, and what it records.

    Attributes:
        time_step: Δt [s].
        steps_per_period: N; here a period is any sequence of N steps.
        periods: number of periods to compute.
        window_periods: number of last periods that are recorded at every step (the window).
        frames_per_period: number of states of all dofs recorded per period of the window.
        limit: gap or displacement beyond which a motion counts as diverged [m].
        refinement: how steps near contact are divided.
    """

    time_step: float
    steps_per_period: int
    periods: int
    window_periods: int = 1
    frames_per_period: int = 0
    limit: float = math.inf
    refinement: Refinement = NOT_REFINED

    def __post_init__(self) -> None:
        """Refuse numbers without a meaning with a CaseError."""
        is_step = math.isfinite(self.time_step) and self.time_step > 0.0
        require(is_step, "time_step", "a number above 0 [s]", self.time_step)
        for key in ("steps_per_period", "periods"):
            value = getattr(self, key)
            require(value == int(value) and value >= 1, key, "a whole number from 1", value)
        require_number("window_periods", self.window_periods, most=self.periods)
        require_number("frames_per_period", self.frames_per_period, most=self.steps_per_period)
        require(self.limit > 0.0, "limit", "a number above 0 [m]", self.limit)
