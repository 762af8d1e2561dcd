"""The laws whose impulses belong to the step: Moreau–Jean, and with recovery of penetrations.

They are supervisors like those of supervisor.py, for the stepper of moreau.py.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np

from delam_fem.contact.decision import Compliance, Decision, Kinematics, Memory
from delam_fem.contact.impulses import coupled_impulses, floor_impulses, recovery_floor
from delam_fem.numerics.arrays import FloatArray, IntArray


class FullCompliance(Compliance, Protocol):
    """W of which whole columns are known."""

    def columns(self, pairs: IntArray) -> FloatArray:
        """Return the columns of some pairs, shape (n_pairs, k) [1/kg]."""


class _StepImpacts(Memory):
    """What both laws report: which pairs were pushed without having approached.

    `permanent` tells them; it changes what is reported, not the motion.
    """

    def __init__(self, n_pairs: int, resting_velocity: float) -> None:
        """Begin with no pair at rest; slower approach than `resting_velocity` is none [m/s]."""
        super().__init__(n_pairs)
        self._resting_velocity, self._none = resting_velocity, self.permanent

    def _forget(self) -> None:
        """Begin a step with no pair at rest."""
        self.permanent, self.is_holding = self._none, False

    def _report(self, hit: IntArray, rate_pre: FloatArray) -> None:
        """Note the pairs that rest, and look again after the next step even if all is open."""
        self.permanent = self._none.copy()
        self.permanent[hit[rate_pre > -self._resting_velocity]] = True
        self.is_holding = bool(self.permanent.any())


class MoreauImpacts(_StepImpacts):
    """Law "moreau": impulses within the step, on every pair whose predicted gap is closed."""

    def __init__(
        self,
        compliance: Compliance,
        *,
        n_pairs: int,
        restitution: float,
        resting_velocity: float = 0.0,
    ) -> None:
        """Set the law up.

        Args:
            compliance: W of the matrix of the θ-step, M + θ Δt C + θ² Δt² K.
            n_pairs: number of contact pairs.
            restitution: e [-].
            resting_velocity: approach slower than this is reported as resting [m/s].
        """
        super().__init__(n_pairs, resting_velocity)
        self._compliance = compliance
        self._restitution = restitution

    def examine(self, seen: Kinematics) -> Decision | None:
        """Return the impulses of this step."""
        self._forget()
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
        self._report(hit, rate_pre)
        return Decision(hit, impulses[pushed], rate_pre, rate_post)


class MoreauRecovery(_StepImpacts):
    """Law "moreau-recovery": the θ-step with a floor under every gap rate, open gaps included.

    A pair comes into contact when its gap is used up, not when it has been overrun, and takes back
    the penetration that remains as far as that needs no energy (`contact.recovery_floor`).
    """

    def __init__(
        self,
        compliance: FullCompliance,
        *,
        n_pairs: int,
        restitution: float,
        time_step: float,
        resting_velocity: float = 0.0,
    ) -> None:
        """Set the law up.

        Args:
            compliance: W of the matrix of the θ-step, M + θ Δt C + θ² Δt² K.
            n_pairs: number of contact pairs.
            restitution: e [-].
            time_step: Δt [s].
            resting_velocity: see `MoreauImpacts`.
        """
        super().__init__(n_pairs, resting_velocity)
        self._compliance = compliance
        self._restitution, self._time_step = restitution, time_step

    def examine(self, seen: Kinematics) -> Decision | None:
        """Return the impulses of this step."""
        self._forget()
        pre, free = seen.rate_pre(), seen.rate_free()
        floor = recovery_floor(seen.gap, pre, self._restitution, self._time_step)
        lacking = free - floor
        active = np.flatnonzero(lacking < 0.0)
        if not active.size:
            return None
        lacking = lacking.copy()
        while True:  # neighbours that the impulses push below their floor join in
            columns = self._compliance.columns(active)
            impulses = floor_impulses(lacking[active], columns[active])
            change = columns @ impulses
            joining = (lacking + change < -self._tolerance(lacking)) & (lacking >= 0.0)
            joining[active] = False
            if not joining.any():
                break
            active = np.flatnonzero(joining | np.isin(np.arange(joining.size), active))
        pushed = impulses > 0.0
        hit, rate_pre = active[pushed], pre[active[pushed]]
        rate_post = free[hit] + change[hit]
        self._report(hit, rate_pre)
        return Decision(hit, impulses[pushed], rate_pre, rate_post)

    @staticmethod
    def _tolerance(lacking: FloatArray) -> float:
        """Return the shortfall that counts as round-off [m/s]."""
        return 1e-12 * float(-lacking.min())
