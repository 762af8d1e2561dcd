"""Run a lamina against the ground with the compiled engine, given its operators and a law."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from delam_fem.contact.laws import Law, LawName, combined_name
from delam_fem.engines.session import session
from delam_fem.model.operators import Operators
from delam_fem.numerics.arrays import FloatArray
from delam_fem.numerics.schemes import SCHEMES, SchemeName
from delam_fem.simulation.loop import Outcome, State
from delam_fem.simulation.recorder import LEDGER, PeriodRecord, Recorder
from delam_fem.simulation.setup import at_rest
from delam_fem.simulation.solution import ImpactTable
from delam_fem.simulation.span import Span

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
