"""A strip that lies on the ground, is lifted and let go (paper 2.3, the first experiment)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from delam_fem import ground, ground_run
from delam_fem.ground_run import LIFT, STRETCH, Energy, GroundLaw, Impulses
from delam_fem.operators import FloatArray
from delam_fem.parameters import Lamina

FRONT_FROM = 0.25
"""The contact line is followed from this part of the length on: nodes nearer the clamp hardly
leave the ground and are hit by every ripple."""
FRONT_WITHIN = 2e-3
"""Time in which the contact line passes; pushes on new nodes later belong to the next swing [s]."""


@dataclass(frozen=True)
class Rolling:
    """A strip that falls on the ground it lies on.

    Attributes:
        lamina: the strip.
        law: contact with the ground.
        lift: what held it before the release.
        x: positions of the free nodes, shape (n,) [m].
        time_step: Δt [s].
        time: of the steps, shape (k,) [s].
        tip: height of the tip, shape (k,) [m].
        shapes: heights at `energy.time` without the start, shape (m - 1, n) [m].
        impulses: all pushes of the ground; `pair` is the index into x.
        energy: where it is and where it went.
        outcome: "completed" or "diverged".
    """

    lamina: Lamina
    law: GroundLaw
    lift: ground.Lift
    x: FloatArray
    time_step: float
    time: FloatArray
    tip: FloatArray
    shapes: FloatArray
    impulses: Impulses
    energy: Energy
    outcome: str

    @property
    def contact_line(self) -> FloatArray:
        """When each node is first pushed, shape (n,) [s]; NaN: never."""
        first = np.full(self.x.size, np.nan)
        pushed, row = np.unique(self.impulses.pair, return_index=True)  # rows go by time
        first[pushed] = self.impulses.time[row]
        return first

    @property
    def landing(self) -> tuple[float, float]:
        """First push beyond `FRONT_FROM`, and when half of the nodes there had theirs [s].

        Not when the last one had it: single nodes may be left out until the next swing.
        """
        beyond = self.contact_line[self.x > FRONT_FROM * self.lamina.length]
        return float(np.nanmin(beyond)), float(np.nanquantile(beyond, 0.5))

    def front(self) -> tuple[float, float]:
        """Return direction and speed of the contact line within 2 ms of the first push.

        Returns:
            Rank correlation of place and time (1: from the clamp to the tip, -1: from the tip to
            the clamp, 0: neither), and the length covered over the time that it took [m/s].
        """
        line = self.contact_line
        is_front = (self.x > FRONT_FROM * self.lamina.length) & (
            line < self.landing[0] + FRONT_WITHIN
        )
        x, t = self.x[is_front], line[is_front]
        if np.ptp(t) < 2.0 * self.time_step:
            return 0.0, float("inf")
        ranks = np.array([np.argsort(np.argsort(values)) for values in (x, t)], dtype=float)
        return float(np.corrcoef(ranks)[0, 1]), float(np.ptp(x) / np.ptp(t))

    def shares(self, time: float) -> dict[str, float]:
        """Return the parts of the energy at a time: lost at impacts, to damping, and left [-]."""
        e, at = self.energy, int(np.searchsorted(self.energy.time, time - 0.5 * STRETCH))
        at = min(at, e.time.size - 1)
        parts = {"impacts": e.impact, "damping": e.damped, "left": e.stored}
        shares = {name: float(values[at] / e.stored[0]) for name, values in parts.items()}
        return shares | {"lost": shares["impacts"] + shares["damping"]}

    def numbers(self) -> dict[str, Any]:
        """Return what the figures quote."""
        direction, speed = self.front()
        begin, end = self.landing
        after = self.tip[np.searchsorted(self.time, end + 1e-3) :]
        return {
            "law": self.law.name,
            "lift": self.lift,
            "elements": self.x.size,
            "time_step_us": 1e6 * self.time_step,
            "damping_ratio": self.lamina.damping_ratio,
            "restitution": self.law.restitution,
            "outcome": self.outcome,
            "energy_J": float(self.energy.stored[0]),
            "landing_ms": [1e3 * begin, 1e3 * end],
            "front_direction": direction,
            "front_speed_m_s": speed if np.isfinite(speed) else None,
            "shares_1ms_after_landing": self.shares(end + 1e-3),
            "shares_at_end": self.shares(self.energy.time[-1]),
            "rebound_of_tip": float(after.max() / self.tip[0]),
            "pushes": int(self.impulses.time.size),
            "energy_residual": self.energy.residual / float(self.energy.stored[0]),
        }


def rolling(
    lamina: Lamina | None = None,
    law: GroundLaw | None = None,
    *,
    lift: ground.Lift = "tip force",
    n_elements: int = 80,
    time_step: float = 2.5e-6,
    duration: float = 0.025,
) -> Rolling:
    """Let a strip fall on the ground it lies on.

    Args:
        lamina: default: the 20 Hz steel strip with D = 0.002.
        law: default: moreau with the e = 0.1 of the paper.
        lift: what holds it before the release; the paper says only that the tip is lifted.
        n_elements: n; each free node is a contact pair.
        time_step: Δt, a divisor of `STRETCH` [s].
        duration: from the release [s].
    """
    lamina = lamina or ground.steel_strip(damping_ratio=0.002)
    law = law or GroundLaw("moreau", 0.1)
    operators = ground.on_ground(lamina, n_elements, "everywhere")
    out = ground_run.run(
        law,
        operators,
        ground_run.released(ground.lifted(lamina, n_elements, LIFT, lift), operators),
        time_step=time_step,
        steps_per_stretch=round(STRETCH / time_step),
        n_stretches=round(duration / STRETCH),
    )
    return Rolling(
        lamina=lamina,
        law=law,
        lift=lift,
        x=ground.nodes(lamina, n_elements),
        time_step=time_step,
        time=out.time,
        tip=out.u[:, 0],
        shapes=out.frames[:, 0, ::2],
        impulses=out.impulses,
        energy=out.energy,
        outcome=out.outcome,
    )
