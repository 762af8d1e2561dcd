"""The laws whose impulses belong to the step: Moreau–Jean, and with recovery of penetrations.

They are supervisors like those of supervisor.py, for the stepper of moreau.py.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np

from delam_fem import contact
from delam_fem.operators import FloatArray, IntArray
from delam_fem.supervisor import Compliance, Decision, Kinematics, Memory


class FullCompliance(Compliance, Protocol):
    """W of which whole columns are known."""

    def columns(self, pairs: IntArray) -> FloatArray:
        """Return the columns of some pairs, shape (n_pairs, k) [1/kg]."""


class MoreauImpacts(Memory):
    """Law "moreau": impulses within the step, on every pair whose predicted gap is closed.

    `permanent` tells which pairs were pushed without having approached: they rest on one another.
    """

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
            resting_velocity: approach slower than this counts as resting [m/s]; it changes what is
                reported, not the motion.
        """
        super().__init__(n_pairs)
        self._compliance = compliance
        self._restitution = restitution
        self._resting_velocity = resting_velocity
        self._none = self.permanent

    def examine(self, seen: Kinematics) -> Decision | None:
        """Return the impulses of this step."""
        self.permanent = self._none
        active = np.flatnonzero(seen.gap <= 0.0)
        if not active.size:
            return None
        rate_pre, rate_free = seen.rate_pre()[active], seen.rate_free()[active]
        if (rate_free + self._restitution * rate_pre >= 0.0).all():
            return None
        W = self._compliance.block(active)
        impulses = contact.coupled_impulses(rate_pre, rate_free, self._restitution, W)
        pushed = impulses > 0.0
        rate_post = (rate_free + W @ impulses)[pushed]
        hit, rate_pre = active[pushed], rate_pre[pushed]
        self.permanent = self._none.copy()
        self.permanent[hit[rate_pre > -self._resting_velocity]] = True
        return Decision(hit, impulses[pushed], rate_pre, rate_post)


class MoreauRecovery(Memory):
    """Law "moreau-recovery": the θ-step with a floor under every gap rate, open gaps included.

    A pair comes into contact before its gap is used up, and a penetration that the step could not
    avoid is taken back within the time in which a wave crosses an element.
    """

    def __init__(
        self,
        compliance: FullCompliance,
        *,
        restitution: float,
        resting_velocity: float,
        recovery_rate: FloatArray,
        time_step: float,
    ) -> None:
        """Set the law up.

        Args:
            compliance: W of the matrix of the θ-step, M + θ Δt C + θ² Δt² K.
            restitution: e [-].
            resting_velocity: approach slower than this counts as resting [m/s]; only reported.
            recovery_rate: κ of each pair, shape (n_pairs,) [1/s].
            time_step: Δt [s].
        """
        super().__init__(recovery_rate.size)
        self._compliance = compliance
        self._restitution, self._resting_velocity = restitution, resting_velocity
        self._recovery_rate, self._time_step = recovery_rate, time_step
        self._none = self.permanent

    def examine(self, seen: Kinematics) -> Decision | None:
        """Return the impulses of this step."""
        self.permanent = self._none
        pre, free = seen.rate_pre(), seen.rate_free()
        floor = contact.recovery_floor(
            seen.gap, pre, self._restitution, self._recovery_rate, self._time_step
        )
        lacking = free - floor
        active = np.flatnonzero(lacking < 0.0)
        if not active.size:
            return None
        lacking = lacking.copy()
        while True:  # neighbours that the impulses push below their floor join in
            columns = self._compliance.columns(active)
            impulses = contact.floor_impulses(lacking[active], columns[active])
            change = columns @ impulses
            joining = (lacking + change < -self._tolerance(lacking)) & (lacking >= 0.0)
            joining[active] = False
            if not joining.any():
                break
            active = np.flatnonzero(joining | np.isin(np.arange(joining.size), active))
        pushed = impulses > 0.0
        hit, rate_pre = active[pushed], pre[active[pushed]]
        rate_post = free[hit] + change[hit]
        self.permanent = self._none.copy()
        self.permanent[hit[rate_pre > -self._resting_velocity]] = True
        return Decision(hit, impulses[pushed], rate_pre, rate_post)

    @staticmethod
    def _tolerance(lacking: FloatArray) -> float:
        """Return the shortfall that counts as round-off [m/s]."""
        return 1e-12 * float(-lacking.min())
