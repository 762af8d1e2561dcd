"""Refine steps near contact: the sizes of steps, and the motion of the base within a step.

A coarse step Δt is made if no gap is small. Otherwise it is divided into middle steps, and a middle
step near contact into fine steps of Δt/r. Contact laws are asked after fine steps only.

The gap of a pair is a parabola within a step of constant acceleration. It stays open if

    U + a min(U̇, 0) > 0 at the start,   U - a max(U̇, 0) > 0 at the end,   a = s Δt/2            (F1)

with the safety s = 1. A larger s covers the difference between the coarse and the true motion. The
signs are opposite for a pair that rests on a spring: it must stay closed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from delam_fem.caches.kernels import njit

SAFETY = 2.0
"""Safety s of F1; tests/verification/test_refinement.py shows what other values do."""
MISSED = 0.05
"""Share of unforeseen contacts (`recorder.EFFORT`) above which a run warns."""


@dataclass(frozen=True)
class Refinement:
    """How often steps are divided near contact.

    Attributes:
        factor: r, number of fine steps in a coarse step; 1: all steps are equal.
    """

    factor: int = 1

    @property
    def middle(self) -> int:
        """Number of middle steps in a coarse step: the divisor of r that is nearest to √r."""
        return next(m for m in range(math.isqrt(self.factor), 0, -1) if self.factor % m == 0)

    @property
    def divisions(self) -> tuple[int, ...]:
        """Number of steps in a coarse step at each level, from coarse to fine, without repeats."""
        return tuple(sorted({1, self.middle, self.factor}))


NOT_REFINED = Refinement()
"""All steps are equal."""


@njit
def base_within(before, after, share, time_step):  # type: ignore[no-untyped-def]
    """Return (q, q', q'') of the base within a step by quintic Hermite interpolation.

    The error relative to a harmonic motion is below (ω Δt)⁴/1000, which is round-off with a
    thousand steps per period.

    Args:
        before: (q, q', q'') at the start of the step [m, m/s, m/s2].
        after: the same at its end.
        share: position within the step, from 0 to 1.
        time_step: Δt [s].
    """
    h, s = time_step, share
    q, dq, ddq = before[0], h * before[1], h * h * before[2]
    first = after[0] - q - dq - 0.5 * ddq
    second = h * after[1] - dq - ddq
    third = h * h * after[2] - ddq
    c3 = 10.0 * first - 4.0 * second + 0.5 * third
    c4 = -15.0 * first + 7.0 * second - third
    c5 = 6.0 * first - 3.0 * second + 0.5 * third
    value = q + s * (dq + s * (0.5 * ddq + s * (c3 + s * (c4 + s * c5))))
    slope = dq + s * (ddq + s * (3.0 * c3 + s * (4.0 * c4 + s * 5.0 * c5)))
    curvature = ddq + s * (6.0 * c3 + s * (12.0 * c4 + s * 20.0 * c5))
    return value, slope / h, curvature / (h * h)
