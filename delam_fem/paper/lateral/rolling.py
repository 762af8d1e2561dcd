"""A strip that lies on the ground, is lifted and released (paper 2.3, the first experiment).

All times are relative to the strip's lowest period as a cantilever. Then only the ratio of the tip
height to the strip's sag under its weight matters, besides law, mesh and time step.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from delam_fem.case.sections import Lamina
from delam_fem.contact.laws import Law, LawName, combined_name
from delam_fem.engines.session import ImpactTable, at_rest, session
from delam_fem.model.beams import closed_form
from delam_fem.model.operators import Operators
from delam_fem.numerics.arrays import FloatArray
from delam_fem.numerics.schemes import SCHEMES, SchemeName
from delam_fem.simulation.loop import Outcome, State
from delam_fem.simulation.recorder import LEDGER, PeriodRecord, Recorder
from delam_fem.simulation.refinement import Span

LIFT = 0.050
"""Height of the tip before the release [m]."""
STRETCH = 1e-4
"""Time between two entries of the energy ledger [s]."""
UNBOUNDED = 10.0
"""A motion above this height counts as diverged [m]; the strip is lifted by centimetres."""
_STORED = [LEDGER.index(name) for name in ("kinetic", "strain", "spring")]
_DAMPED = [LEDGER.index(name) for name in ("damping_loss", "contact_damping_loss")]
_IMPACT, _RELEASED = LEDGER.index("impact_loss"), LEDGER.index("spring_released")
_RESIDUAL = LEDGER.index("residual")


@dataclass(frozen=True)
class GroundLaw:
    """The contact law between a node and the ground; impulses are consistent (through M⁻¹).

    Attributes:
        name: name of the contact law, as in case files.
        restitution: e [-].
        stiffness: stiffness of a spring per node, for newton-penalty and penalty [N/m].
        threshold_velocity: γ [m/s].
        scheme: name of the time integration, as in case files.
    """

    name: LawName
    restitution: float = 0.0
    stiffness: float = 0.0
    threshold_velocity: float = 0.5e-3
    scheme: SchemeName = "newmark"

    @property
    def method(self) -> str:
        """The law with its scheme, as in `newton@moreau-jean`."""
        return combined_name(self.name, self.scheme)

    @property
    def law(self) -> Law:
        """The contact law as engines need it."""
        return Law(
            self.name,
            restitution=self.restitution,
            penalty_stiffness=self.stiffness,
            threshold_velocity=self.threshold_velocity,
        )


@dataclass(frozen=True)
class Energy:
    """The stored and the lost energy at the ends of equal stretches of a run [J].

    Attributes:
        time: ends of the stretches, and the start, shape (m,) [s].
        stored: kinetic, strain and spring energy together, shape (m,).
        damped: energy lost to damping so far, shape (m,).
        impact: energy lost at impacts so far, shape (m,).
        released: energy released by switching springs so far, shape (m,).
        residual: largest error of the energy balance over a stretch.
    """

    time: FloatArray
    stored: FloatArray
    damped: FloatArray
    impact: FloatArray
    released: FloatArray
    residual: float


@dataclass(frozen=True)
class GroundRun:
    """The results of a run against the ground.

    Attributes:
        time: times of all steps, and the start, shape (k,) [s].
        u: observed displacements, shape (k, n_observed) [m].
        v: observed velocities, shape (k, n_observed) [m/s].
        frames: (u, v) of all dofs at `energy.time` without the start, shape (m - 1, 2, n).
        impulses: all impulses; `rate_pre` is the velocity of the node, negative downwards.
        energy: the energy ledger.
        state: the state at the end.
        outcome: how the run ended.
    """

    time: FloatArray
    u: FloatArray
    v: FloatArray
    frames: FloatArray
    impulses: ImpactTable
    energy: Energy
    state: State
    outcome: Outcome


def released(shape: FloatArray, operators: Operators) -> State:
    """Return the state of a lamina released from rest in a shape, (u, φ) of all free dofs."""
    motion = np.array([shape, np.zeros_like(shape), np.zeros_like(shape)])
    return State(motion, np.zeros(operators.n_pairs, dtype=np.bool_))


def run(
    law: GroundLaw,
    operators: Operators,
    start: State,
    *,
    time_step: float,
    steps_per_stretch: int,
    n_stretches: int,
    stop: Callable[[float, float], bool] = lambda u, v: False,
) -> GroundRun:
    """Run a problem; keep energies and frames at the ends of the stretches.

    Args:
        law: the contact law.
        operators: operators of the lamina over the ground.
        start: state at the start.
        time_step: Δt [s].
        steps_per_stretch: N.
        n_stretches: number of stretches.
        stop: called after each stretch with the first observed u [m] and v [m/s]; True ends the
            run.

    Returns:
        The results; if the motion diverges or `stop` ends it, the results up to that time.
    """

    def ends(done: int) -> bool:
        return stop(*opened.recorder.strobe[done - 1, :, 0].tolist())

    span = Span(time_step, steps_per_stretch, n_stretches, n_stretches, 1, UNBOUNDED)
    with session(
        operators, law.law, SCHEMES[law.scheme], at_rest(span), span, initial=start
    ) as opened:
        found = opened.solution(opened.run(ends, every=1))
    return GroundRun(
        time=found.time,
        u=found.displacement,
        v=found.velocity,
        frames=found.frames,
        impulses=found.impacts,
        energy=_energy(found.recorder, found.records, time_step),
        state=found.state,
        outcome=found.outcome,
    )


def _energy(recorder: Recorder, records: list[PeriodRecord], time_step: float) -> Energy:
    """Return the energy ledger as running sums."""
    ledger = recorder.ledger[: recorder.n_closed]
    at_start = records[0].start[:3].sum()
    steps = np.cumsum([0] + [record.n_steps for record in records])

    def sums(flow: FloatArray) -> FloatArray:
        return np.concatenate([[0.0], np.cumsum(flow)])

    return Energy(
        time=time_step * steps,
        stored=np.concatenate([[at_start], ledger[:, _STORED].sum(axis=1)]),
        damped=sums(ledger[:, _DAMPED].sum(axis=1)),
        impact=sums(ledger[:, _IMPACT]),
        released=sums(ledger[:, _RELEASED]),
        residual=float(np.abs(ledger[:, _RESIDUAL]).max()),
    )


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
    lift: closed_form.Lift
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
            "sag_mm": 1e3 * closed_form.sag(self.lamina, self.gravity),
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
    return closed_form.steel_strip(length=0.5, thickness=0.001, damping_ratio=damping_ratio)


def rolling(
    lamina: Lamina | None = None,
    law: GroundLaw | None = None,
    *,
    height: float = LIFT,
    lift: closed_form.Lift = "tip force",
    gravity: float = closed_form.GRAVITY,
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
    operators = closed_form.on_ground(lamina, n_elements, "everywhere", gravity=gravity)
    shape = closed_form.lifted(lamina, n_elements, height, lift, gravity=gravity)
    out = run(
        law,
        operators,
        released(shape, operators),
        time_step=_period(lamina) / steps_per_period,
        steps_per_stretch=steps_per_period // STRETCHES,
        n_stretches=round(periods * STRETCHES),
    )
    lying = closed_form.lying(lamina, n_elements, gravity)
    at_rest = 0.5 * float(lying @ (operators.stiffness @ lying))
    return Rolling(
        lamina=lamina,
        law=law,
        lift=lift,
        gravity=gravity,
        x=closed_form.nodes(lamina, n_elements),
        steps_per_period=steps_per_period,
        time=out.time,
        tip=out.u[:, 0] - closed_form.sag(lamina, gravity),
        top=(out.frames[:, 0, ::2] - lying[::2]).max(axis=1),
        impulses=out.impulses,
        energy=replace(out.energy, stored=out.energy.stored - at_rest),
        outcome=out.outcome,
    )


def _period(lamina: Lamina) -> float:
    return 2.0 * float(np.pi / lamina.angular_frequencies(1)[0])
