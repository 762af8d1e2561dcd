"""A strip that lies on the ground, is lifted and released (paper 2.3, the first experiment).

All times are relative to the strip's lowest period as a cantilever. Then only the ratio of the tip
height to the strip's sag under its weight matters, besides law, mesh and time step.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from delam_fem.case.sections import Lamina
from delam_fem.model.beams import ground
from delam_fem.numerics.arrays import FloatArray
from delam_fem.paper.lateral import ground_run
from delam_fem.paper.lateral.ground_run import LIFT, Energy, GroundLaw
from delam_fem.simulation.solution import ImpactTable

FRONT_FROM = 0.25
"""The contact line is followed from this fraction of the length on: nodes nearer the clamp hardly
leave the ground and are hit by every ripple."""
FRONT_WITHIN = 0.04
"""Time within which the contact line passes, in periods; later first hits belong to the next swing
[-]."""
SETTLED = 0.02
"""Time between the landing of half of the strip and the reading of the losses, in periods [-]."""
STRETCHES = 500
"""Entries of the energy ledger per period."""


@dataclass(frozen=True)
class Rolling:
    """The fall of a strip on the ground on which it lies.

    Attributes:
        lamina: the strip.
        law: contact law with the ground.
        lift: load that held the strip before the release.
        gravity: g [m/s2].
        x: positions of the free nodes, shape (n,) [m].
        steps_per_period: time steps per lowest period [-].
        time: times of the steps, shape (k,) [s].
        tip: height of the tip, shape (k,) [m].
        top: height of the highest node at `energy.time` without the start, shape (m - 1,) [m].
        impulses: all impulses of the ground; `pair` is the index into x.
        energy: stored and lost energy; `stored` is 0 at rest on the ground.
        outcome: "completed" or "diverged".
    """

    lamina: Lamina
    law: GroundLaw
    lift: ground.Lift
    gravity: float
    x: FloatArray
    steps_per_period: int
    time: FloatArray
    tip: FloatArray
    top: FloatArray
    impulses: ImpactTable
    energy: Energy
    outcome: str

    @property
    def period(self) -> float:
        """Lowest period of the strip as a cantilever [s]."""
        return _period(self.lamina)

    @property
    def contact_line(self) -> FloatArray:
        """Time of the first hit of each node, shape (n,) [s]; NaN: it is never hit."""
        first = np.full(self.x.size, np.nan)
        pushed, row = np.unique(self.impulses.pair, return_index=True)  # rows are sorted by time
        first[pushed] = self.impulses.time[row]
        return first

    @property
    def landing(self) -> tuple[float, float]:
        """Times [s] of the first hit beyond `FRONT_FROM`, and when half the nodes there were hit.

        The last node is not used: single nodes may not be hit until the next swing.
        """
        beyond = self.contact_line[self.x > FRONT_FROM * self.lamina.length]
        return float(np.nanmin(beyond)), float(np.nanquantile(beyond, 0.5))

    def front(self) -> tuple[float, float]:
        """Return direction and speed of the contact line soon after the first hit.

        Returns:
            Rank correlation of place and time (1: from the clamp to the tip, -1: from the tip to
            the clamp, 0: neither), and the length that the line covers per time [m/s].
        """
        line = self.contact_line
        is_front = (self.x > FRONT_FROM * self.lamina.length) & (
            line < self.landing[0] + FRONT_WITHIN * self.period
        )
        x, t = self.x[is_front], line[is_front]
        if np.ptp(t) < 2.0 * self.period / self.steps_per_period:
            return 0.0, float("inf")
        ranks = np.array([np.argsort(np.argsort(values)) for values in (x, t)], dtype=float)
        return float(np.corrcoef(ranks)[0, 1]), float(np.ptp(x) / np.ptp(t))

    def shares(self, time: float) -> dict[str, float]:
        """Return the shares of the energy at a time: lost at impacts, lost to damping, left [-]."""
        e, half = self.energy, 0.5 * self.period / STRETCHES
        at = int(np.searchsorted(self.energy.time, time - half))
        at = min(at, e.time.size - 1)
        parts = {"impacts": e.impact, "damping": e.damped, "left": e.stored}
        shares = {name: float(values[at] / e.stored[0]) for name, values in parts.items()}
        return shares | {"lost": shares["impacts"] + shares["damping"]}

    def numbers(self) -> dict[str, Any]:
        """Return the numbers that the figures quote."""
        direction, speed = self.front()
        begin, end = self.landing
        settled = end + SETTLED * self.period
        tip = self.tip[np.searchsorted(self.time, settled) :]
        top = self.top[np.searchsorted(self.energy.time[1:], settled) :]
        return {
            "strip": self.lamina.model_dump(exclude_none=True),
            "period_ms": 1e3 * self.period,
            "gravity_m_s2": self.gravity,
            "sag_mm": 1e3 * ground.sag(self.lamina, self.gravity),
            "height_mm": 1e3 * float(self.tip[0]),
            "law": self.law.name,
            "lift": self.lift,
            "elements": self.x.size,
            "steps_per_period": self.steps_per_period,
            "restitution": self.law.restitution,
            "outcome": self.outcome,
            "energy_J": float(self.energy.stored[0]),
            "landing_ms": [1e3 * begin, 1e3 * end],
            "front_direction": direction,
            "front_speed_m_s": speed if np.isfinite(speed) else None,
            "shares_after_landing": self.shares(settled),
            "shares_at_end": self.shares(self.energy.time[-1]),
            "rebound_of_tip": float(tip.max() / self.tip[0]),
            "lift_off": float(top.max() / self.tip[0]),
            "pushes": int(self.impulses.time.size),
            "energy_residual": self.energy.residual / float(self.energy.stored[0]),
        }


def thin_strip(damping_ratio: float = 0.002) -> Lamina:
    """Return a steel strip of 500 × 40 × 1 mm, 3.34 Hz, which sags by 34 mm under its weight."""
    return ground.steel_strip(length=0.5, thickness=0.001, damping_ratio=damping_ratio)


def rolling(
    lamina: Lamina | None = None,
    law: GroundLaw | None = None,
    *,
    height: float = LIFT,
    lift: ground.Lift = "tip force",
    gravity: float = ground.GRAVITY,
    n_elements: int = 80,
    steps_per_period: int = 20_000,
    periods: float = 0.5,
) -> Rolling:
    """Compute the fall of a strip on the ground on which it lies.

    Args:
        lamina: the strip; None: `thin_strip`.
        law: contact law; None: newton@moreau-jean with the paper's e = 0.1.
        height: height of the tip before the release [m].
        lift: load that holds the strip until then; the paper lifts the free end.
        gravity: g [m/s2].
        n_elements: n; each free node is a contact pair.
        steps_per_period: time steps per lowest period, a multiple of `STRETCHES`.
        periods: duration of the run from the release, in lowest periods.

    Raises:
        ValueError: the load would not lift a part of the strip.
    """
    lamina = lamina or thin_strip()
    law = law or GroundLaw("newton", 0.1, scheme="moreau-jean")
    operators = ground.on_ground(lamina, n_elements, "everywhere", gravity=gravity)
    shape = ground.lifted(lamina, n_elements, height, lift, gravity=gravity)
    out = ground_run.run(
        law,
        operators,
        ground_run.released(shape, operators),
        time_step=_period(lamina) / steps_per_period,
        steps_per_stretch=steps_per_period // STRETCHES,
        n_stretches=round(periods * STRETCHES),
    )
    lying = ground.lying(lamina, n_elements, gravity)
    at_rest = 0.5 * float(lying @ (operators.stiffness @ lying))
    return Rolling(
        lamina=lamina,
        law=law,
        lift=lift,
        gravity=gravity,
        x=ground.nodes(lamina, n_elements),
        steps_per_period=steps_per_period,
        time=out.time,
        tip=out.u[:, 0] - ground.sag(lamina, gravity),
        top=(out.frames[:, 0, ::2] - lying[::2]).max(axis=1),
        impulses=out.impulses,
        energy=replace(out.energy, stored=out.energy.stored - at_rest),
        outcome=out.outcome,
    )


def _period(lamina: Lamina) -> float:
    return 2.0 * float(np.pi / lamina.angular_frequencies(1)[0])
