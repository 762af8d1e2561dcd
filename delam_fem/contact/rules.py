"""The rules of the contact laws: who is hit, who rests, and with which impulses.

Formulas of the contact laws as pure functions of gaps and gap rates, without time or state.
Impulses [N s] and forces [N] act on pairs; H^T maps them to the dofs. A positive impulse or force
pushes the laminae apart.

Newton's impact law between two steps, alone or with springs for pairs that stay closed. The laws
are "newton" (paper 3.1) and "newton-penalty" (paper 3.2, eq. 17 as corrected). They go with schemes
that ask the law at the end of a step.

Newton's impact law with impulses inside the step, as the Moreau–Jean scheme needs it:

    0 <= p  ⊥  U̇⁺ + e U̇ >= 0

on every pair whose gap, predicted for the middle of the step, is closed.
"""

from __future__ import annotations

import numpy as np

from delam_fem.contact import complementarity
from delam_fem.contact.laws import Decision, Kinematics, Setting, is_same_set
from delam_fem.numerics.types import FloatArray, IntArray
from delam_fem.system.kernels import kept


def separate_impulses(
    rate_pre: FloatArray, restitution: float, inverse_mass: FloatArray
) -> FloatArray:
    """Return impulses that treat each pair as if it were alone (paper eq. 14).

        p = (1 + e) (-rate_pre) / W_kk,   W_kk = 1/m_1 + 1/m_2

    Each pair leaves with -e times its own gap rate.

    Args:
        rate_pre: gap rates before the impact, negative (approaching), shape (k,) [m/s].
        restitution: e [-].
        inverse_mass: W_kk of the lumped masses, shape (k,) [1/kg].
    """
    return -(1.0 + restitution) * rate_pre / inverse_mass


def coupled_impulses(
    rate_pre: FloatArray, rate_free: FloatArray, restitution: float, compliance: FloatArray
) -> FloatArray:
    """Return the impulses of Newton's law for pairs that influence one another.

        0 <= p  ⊥  (rate_free + W p) + e rate_pre >= 0

    Args:
        rate_pre: gap rates before the impact, shape (k,) [m/s].
        rate_free: gap rates that would follow without impulses, shape (k,) [m/s]; equal to
            `rate_pre` if the impact takes no time.
        restitution: e [-].
        compliance: W = H M^-1 H^T of the k pairs, shape (k, k) [1/kg].

    Raises:
        ArithmeticError: no solution (velocities or W are not finite).
    """
    return complementarity.solve(compliance, rate_free + restitution * rate_pre)


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


class NoContact:
    """Law "none": the laminae pass through one another."""

    def examine(self, seen: Kinematics) -> Decision | None:
        """Return None: nothing ever jumps."""
        return None


class PenaltySprings:
    """Law "penalty": every closed pair carries a spring and a damper; no pair is hit."""

    def examine(self, seen: Kinematics) -> Decision | None:
        """Return the new set of springs at the end of a step, or None if it did not change."""
        closed = seen.gap <= 0.0
        return None if is_same_set(closed, seen.resting) else Decision.only_resting(closed)


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
