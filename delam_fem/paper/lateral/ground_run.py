"""Runs of a lamina against the ground: `Operators` and a law → compiled engine → time loop."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from delam_fem.contact.laws import Law, LawName
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
"""Between two entries of the energy ledger [s]."""
UNBOUNDED = 10.0
"""Height at which a motion counts as diverged [m]; the strip is lifted by centimetres."""
_STORED = [LEDGER.index(name) for name in ("kinetic", "strain", "spring")]
_DAMPED = [LEDGER.index(name) for name in ("damping_loss", "contact_damping_loss")]
_IMPACT, _RELEASED = LEDGER.index("impact_loss"), LEDGER.index("spring_released")
_RESIDUAL = LEDGER.index("residual")


@dataclass(frozen=True)
class GroundLaw:
    """What happens where a node meets the ground; impulses are consistent (through M⁻¹).

    Attributes:
        name: of the contact law, as in case files.
        restitution: e [-].
        stiffness: of the springs of newton-penalty and penalty, per node [N/m].
        threshold_velocity: γ [m/s].
        scheme: time integration, as in case files.
    """

    name: LawName
    restitution: float = 0.0
    stiffness: float = 0.0
    threshold_velocity: float = 0.5e-3
    scheme: SchemeName = "newmark"

    @property
    def law(self) -> Law:
        """The contact law."""
        return Law(
            self.name,
            restitution=self.restitution,
            penalty_stiffness=self.stiffness,
            threshold_velocity=self.threshold_velocity,
        )


@dataclass(frozen=True)
class Energy:
    """Where the energy is at the ends of equal stretches of a run, and where it went [J].

    Attributes:
        time: shape (m,), the start included [s].
        stored: kinetic, strain and spring energy together.
        damped: lost to damping so far.
        impact: lost at impacts so far.
        released: set free by switching springs so far.
        residual: largest of what does not add up over a stretch.
    """

    time: FloatArray
    stored: FloatArray
    damped: FloatArray
    impact: FloatArray
    released: FloatArray
    residual: float


@dataclass(frozen=True)
class GroundRun:
    """What came out.

    Attributes:
        time: of all steps, the start included, shape (k,) [s].
        u: observed displacements, shape (k, n_observed) [m].
        v: observed velocities likewise [m/s].
        frames: (u, v) of all dofs at `energy.time` without the start, shape (m - 1, 2, n).
        impulses: all pushes; `rate_pre` is the velocity of the node, downwards negative.
        energy: the ledger.
        state: at the end.
        outcome: how it ended.
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
    """Return the state of a lamina that is let go from rest in a shape, (u, φ) of all free dofs."""
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
    """Run a problem; energies and frames are kept at the ends of the stretches.

    Args:
        law: what happens in contact.
        operators: lamina and ground.
        start: displacements, velocities and springs.
        time_step: Δt [s].
        steps_per_stretch: N.
        n_stretches: how many.
        stop: asked after each stretch with the first observed u [m] and v [m/s].

    Returns:
        All of it; what there is, where the motion diverges or `stop` ends it.
    """

    def ends(done: int) -> bool:
        return stop(*opened.recorder.strobe[done - 1, :, 0].tolist())

    span = Span(time_step, steps_per_stretch, n_stretches, n_stretches, 1, UNBOUNDED)
    with session(
        operators, law.law, SCHEMES[law.scheme], at_rest(span), span, initial=start
    ) as opened:
        found = opened.solution(opened.run(ends))
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
    """Return the ledger as running sums."""
    ledger = recorder.ledger[: recorder.n_closed]
    at_start = records[0].start[0].total
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
