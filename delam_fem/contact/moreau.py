"""Newton's impact law with impulses inside the step, as the Moreau–Jean scheme needs it.

0 <= p  ⊥  U̇⁺ + e U̇ >= 0 on every pair whose gap, predicted for the middle of the step, is closed.
"""

from __future__ import annotations

import numpy as np

from delam_fem.contact.decision import Decision, Kinematics, Setting
from delam_fem.contact.impulses import coupled_impulses
from delam_fem.numerics.arrays import BoolArray, FloatArray, IntArray

CLOSED = 1e-4
"""A gap below this fraction of Δt times the largest gap rate is closed, if pairs touch at rest.

Pairs that stay in contact have gaps of nothing but round-off, whose signs would decide whether the
law sees them. The tolerance is proportional to the motion: with closed delaminations, twice the
excitation gives exactly twice the response. The scheme itself lets gaps overrun by about Δt times
the gap rate.
"""


class StepImpacts:
    """Law "newton" with the Moreau–Jean scheme."""

    def __init__(
        self, setting: Setting, *, restitution: float, resting_velocity: float = 0.0
    ) -> None:
        """Set the law up.

        Args:
            setting: the problem; impulses act through the matrix of the θ-step,
                M + θ Δt C + θ² Δt² K.
            restitution: e [-].
            resting_velocity: a hit pair that approached slower than this counts as resting [m/s];
                this changes only the report, not the motion.
        """
        self._compliance, self._n_pairs = setting.compliance, setting.n_pairs
        self._restitution, self._resting_velocity = restitution, resting_velocity

    def examine(self, seen: Kinematics) -> Decision | None:
        """Return the impulses of this step, or None if no pair needs one."""
        active = np.flatnonzero(seen.gap <= 0.0)
        if not active.size:
            return None
        rate_pre, rate_free = seen.rate_pre()[active], seen.rate_free()[active]
        if (rate_free + self._restitution * rate_pre >= 0.0).all():
            return None
        W = self._compliance.block(active)
        impulses = coupled_impulses(rate_pre, rate_free, self._restitution, W)
        pushed = impulses > 0.0
        rate_post = (rate_free + W @ impulses)[pushed]
        hit, rate_pre = active[pushed], rate_pre[pushed]
        resting = pushed_at_rest(self._n_pairs, hit, rate_pre, self._resting_velocity)
        return Decision(hit, impulses[pushed], rate_pre, rate_post, resting)


def pushed_at_rest(
    n_pairs: int, hit: IntArray, rate_pre: FloatArray, resting_velocity: float
) -> BoolArray:
    """Return which pairs were pushed although they hardly approached, shape (n_pairs,).

    Args:
        n_pairs: number of pairs.
        hit: pairs that receive an impulse, shape (k,).
        rate_pre: gap rates of the hit pairs before the impact, shape (k,) [m/s].
        resting_velocity: a pair that approaches slower than this counts as resting [m/s].
    """
    resting = np.zeros(n_pairs, dtype=np.bool_)
    resting[hit[rate_pre > -resting_velocity]] = True
    return resting
