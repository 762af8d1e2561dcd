"""Newton's impact law between two steps, alone or with springs for pairs that stay closed.

The laws are "newton" (paper 3.1) and "newton-penalty" (paper 3.2, eq. 17 as corrected). They go
with schemes that ask the law at the end of a step.
"""

from __future__ import annotations

import numpy as np

from delam_fem.contact.decision import Decision, Kinematics, Setting, is_same_set
from delam_fem.contact.impulses import coupled_impulses, separate_impulses
from delam_fem.numerics.arrays import FloatArray, IntArray


class Impacts:
    """Impacts at the end of a step.

    The law acts in this order. It releases springs whose gap has opened. It hits closed,
    approaching pairs without a spring. Hit pairs that leave slower than the threshold get a spring.
    """

    def __init__(
        self,
        setting: Setting,
        *,
        restitution: float,
        coupled: bool,
        threshold_velocity: float | None = None,
    ) -> None:
        """Set the law up.

        Args:
            setting: the problem; impulses act through its mass matrix.
            restitution: e [-].
            coupled: True: solve simultaneous impacts together ("consistent"); False: each pair
                alone ("lumped").
            threshold_velocity: γ [m/s]; None: no pair ever rests on a spring (law "newton").
        """
        self._compliance = setting.compliance
        self._restitution = restitution
        self._coupled = coupled
        self._threshold = threshold_velocity

    def examine(self, seen: Kinematics) -> Decision | None:
        """Return the impacts and the new set of springs at the end of a step."""
        closed, resting = seen.gap <= 0.0, seen.resting
        if is_same_set(closed, resting):
            return None
        rate = seen.rate_pre()
        hit = np.flatnonzero(closed & ~resting & (rate < 0.0))
        kept = resting & closed
        if not hit.size:
            return None if is_same_set(kept, resting) else Decision.only_resting(kept)
        rate_pre = rate[hit]
        impulses, rate_post = self._impact(hit, rate_pre)
        if self._threshold is not None:
            kept[hit[rate_post < self._threshold]] = True
        changed = None if is_same_set(kept, resting) else kept
        return Decision(hit, impulses, rate_pre, rate_post, changed)

    def _impact(self, hit: IntArray, rate_pre: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the impulses of the hit pairs and their gap rates after the impact."""
        if self._coupled:
            W = self._compliance.block(hit)
            impulses = coupled_impulses(rate_pre, rate_pre, self._restitution, W)
            return impulses, rate_pre + W @ impulses
        inverse_mass = self._compliance.diagonal(hit)
        impulses = separate_impulses(rate_pre, self._restitution, inverse_mass)
        return impulses, -self._restitution * rate_pre
