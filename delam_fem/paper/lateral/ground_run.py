"""Runs of a lamina against the ground: `Operators` and a law → compiled engine → time loop."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from delam_fem.engines.compiled import state
from delam_fem.engines.compiled.engine import Compiled, law_named
from delam_fem.engines.compiled.system import Scheme
from delam_fem.model.operators import Operators
from delam_fem.numerics.arrays import FloatArray, IntArray
from delam_fem.simulation.loop import Outcome, State, set_initial, simulate
from delam_fem.simulation.recorder import LEDGER, N_BASE, PeriodRecord, Recorder

LawName = Literal["none", "newton", "newton-penalty", "penalty", "moreau", "moreau-recovery"]

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
        name: as in case files.
        restitution: e [-].
        stiffness: of the springs of newton-penalty and penalty, per node [N/m].
        threshold_velocity: γ [m/s].
    """

    name: LawName
    restitution: float = 0.0
    stiffness: float = 0.0
    threshold_velocity: float = 0.5e-3

    def engine(self, operators: Operators, time_step: float) -> Compiled:
        """Return what computes the steps: average acceleration, or Moreau–Jean with θ = 1/2."""
        law = law_named(
            self.name,
            is_coupled=True,
            restitution=self.restitution,
            stiffness=self.stiffness,
            damping=0.0,
            threshold=self.threshold_velocity,
        )
        is_moreau = law.kind >= state.MOREAU
        scheme = Scheme.moreau_jean(time_step) if is_moreau else Scheme.newmark(time_step)
        return Compiled(operators, scheme, law)


@dataclass(frozen=True)
class Impulses:
    """Impulses of a run, one row per push on a node.

    Attributes:
        time: end of the step, shape (k,) [s].
        pair: contact pair, shape (k,).
        impulse: [N s].
        rate_pre: velocity of the node before, downwards negative [m/s].
    """

    time: FloatArray
    pair: IntArray
    impulse: FloatArray
    rate_pre: FloatArray


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
        impulses: all pushes.
        energy: the ledger.
        state: at the end.
        outcome: how it ended.
    """

    time: FloatArray
    u: FloatArray
    v: FloatArray
    frames: FloatArray
    impulses: Impulses
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
    engine = law.engine(operators, time_step)
    recorder = Recorder(
        operators.base,
        time_step=time_step,
        steps_per_period=steps_per_stretch,
        n_periods=n_stretches,
        n_observed=operators.observed.size,
        window_periods=n_stretches,
        frames_per_period=1,
        limit=UNBOUNDED,
    )
    at_rest = np.zeros((steps_per_stretch + 1, 3))
    set_initial(engine, start, at_rest[0])
    outcome = simulate(
        engine,
        recorder,
        lambda _: at_rest,
        stop=lambda done: stop(*recorder.strobe[done - 1, :, 0].tolist()),
    )
    records = list(recorder.window)
    n_steps = [record.n_steps for record in records]
    parts = list(zip(records, n_steps, strict=True))
    first = records[0]
    return GroundRun(
        time=time_step * np.arange(sum(n_steps) + 1),
        u=np.concatenate([first.u[:1], *(r.u[1 : k + 1] for r, k in parts)])[:, N_BASE:],
        v=np.concatenate([first.v[:1], *(r.v[1 : k + 1] for r, k in parts)]),
        frames=np.array([frame for r in records for frame in r.frames]),
        impulses=_impulses(records, time_step),
        energy=_energy(recorder, records, time_step),
        state=engine.state(),
        outcome=outcome,
    )


def _impulses(records: list[PeriodRecord], time_step: float) -> Impulses:
    """Return the pushes of all records in one table."""
    rows, steps_before = [], 0
    for record in records:
        for step, decision, _ in record.jumps:
            instant = np.full(decision.hit.size, (steps_before + step) * time_step)
            rows.append(
                np.array([instant, decision.hit, decision.impulses, decision.rate_pre], dtype=float)
            )
        steps_before += record.n_steps
    table = np.concatenate([np.zeros((4, 0)), *rows], axis=1)
    return Impulses(table[0], table[1].astype(np.int64), table[2], table[3])


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
