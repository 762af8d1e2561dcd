"""The two laws without impacts: no contact at all, and the classical penalty spring."""

from __future__ import annotations

from delam_fem.contact.decision import Decision, Kinematics, is_same_set


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
