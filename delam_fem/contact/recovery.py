"""The law "recovery": it keeps every gap rate above a floor, also at open gaps.

Contact starts when the gap closes, not after penetration. The law removes remaining penetration
only as fast as it can without adding energy (`impulses.recovery_floor`).
"""

from __future__ import annotations

import numpy as np

from delam_fem.contact.decision import Decision, Kinematics, Setting
from delam_fem.contact.impulses import floor_impulses, recovery_floor
from delam_fem.contact.moreau import pushed_at_rest
from delam_fem.numerics.arrays import FloatArray

ROUND_OFF = 1e-12
"""A shortfall of a gap rate below this fraction of the largest shortfall is round-off."""


class Recovery:
    """Law "recovery" with the Moreau–Jean scheme."""

    def __init__(
        self, setting: Setting, *, restitution: float, resting_velocity: float = 0.0
    ) -> None:
        """Set the law up.

        Args:
            setting: the problem; impulses act through the matrix of the θ-step,
                M + θ Δt C + θ² Δt² K.
            restitution: e [-].
            resting_velocity: see `moreau.StepImpacts`.
        """
        self._compliance, self._n_pairs = setting.compliance, setting.n_pairs
        self._restitution, self._time_step = restitution, setting.time_step
        self._resting_velocity = resting_velocity

    def examine(self, seen: Kinematics) -> Decision | None:
        """Return the impulses of this step, or None if no pair needs one."""
        pre, free = seen.rate_pre(), seen.rate_free()
        floor = recovery_floor(seen.gap, pre, self._restitution, self._time_step)
        lacking = free - floor
        active = np.flatnonzero(lacking < 0.0)
        if not active.size:
            return None
        while True:  # add neighbours that the impulses push below their floor
            columns = self._compliance.columns(active)
            impulses = floor_impulses(lacking[active], columns[active])
            change = columns @ impulses
            joining = (lacking + change < -_tolerance(lacking)) & (lacking >= 0.0)
            joining[active] = False
            if not joining.any():
                break
            active = np.flatnonzero(joining | np.isin(np.arange(joining.size), active))
        pushed = impulses > 0.0
        hit, rate_pre = active[pushed], pre[active[pushed]]
        resting = pushed_at_rest(self._n_pairs, hit, rate_pre, self._resting_velocity)
        return Decision(hit, impulses[pushed], rate_pre, free[hit] + change[hit], resting)


def _tolerance(lacking: FloatArray) -> float:
    """Return the shortfall of a gap rate that counts as round-off [m/s]."""
    return ROUND_OFF * float(-lacking.min())
