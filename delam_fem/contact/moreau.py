"""Newton's impact law with impulses inside the step, as the Moreau–Jean scheme needs it.

0 <= p  ⊥  U̇⁺ + e U̇ >= 0 on every pair whose gap, predicted for the middle of the step, is closed.
"""

from __future__ import annotations

import numpy as np

from delam_fem.caches.kernels import kept
from delam_fem.contact import complementarity
from delam_fem.contact.decision import Decision, Kinematics, Setting

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
        self._active = np.zeros(setting.n_pairs, dtype=np.int64)

    def examine(self, seen: Kinematics) -> Decision | None:
        """Return the impulses of this step, or None if no pair needs one."""
        e, rate_pre, rate_free = self._restitution, seen.rate_pre(), seen.rate_free()
        n_active = _list_active(seen.gap, rate_pre, rate_free, e, self._active)
        if not n_active:
            return None
        active = self._active[:n_active]
        W, resting = self._compliance.block(active), np.zeros(self._n_pairs, dtype=np.bool_)
        pushed = np.empty((3, n_active))
        n, result = _push(
            W, active, rate_pre, rate_free, e, self._resting_velocity, pushed, resting
        )
        complementarity.require_solved(result)
        if n < n_active:
            active, pushed = active[:n], pushed[:, :n]
        return Decision(active.copy(), pushed[0], pushed[1], pushed[2], resting)


@kept
def _list_active(gap, rate_pre, rate_free, restitution, active):  # type: ignore[no-untyped-def]
    """List the closed pairs; return how many they are, or 0 if all of them part fast enough."""
    n, lacks = 0, False
    for k in range(gap.size):
        if gap[k] <= 0.0:
            active[n] = k
            n += 1
            lacks |= not rate_free[k] + restitution * rate_pre[k] >= 0.0  # also if not a number
    return n if lacks else 0


@kept
def _push(W, active, rate_pre, rate_free, restitution, slow, pushed, resting):  # type: ignore[no-untyped-def]
    """Push the closed pairs apart; return how many get an impulse, and whether that was solved.

    Args:
        W: compliance of the closed pairs, shape (k, k).
        active: the closed pairs, shape (k,); as a result those with an impulse, the first entries.
        rate_pre: gap rates of all pairs before the impact, shape (n_pairs,).
        rate_free: the same at the end of the step without impulses.
        restitution: e [-].
        slow: a pair that approaches slower than this counts as resting [m/s].
        pushed: result, impulses and gap rates before and after of these, the first columns.
        resting: result, the pairs that were pushed although they hardly approached, (n_pairs,).
    """
    q, p, change, n = np.empty(active.size), np.zeros(active.size), np.empty(active.size), 0
    for i in range(active.size):
        q[i] = rate_free[active[i]] + restitution * rate_pre[active[i]]
    result = complementarity.solve_checked(W, q, p, change)
    for i in range(active.size):
        if p[i] > 0.0:
            k = active[i]
            active[n], pushed[0, n], pushed[1, n] = k, p[i], rate_pre[k]
            pushed[2, n] = rate_free[k] + change[i]
            resting[k] = rate_pre[k] > -slow
            n += 1
    return n, result
