"""Estimate the largest Lyapunov exponent from two neighbouring motions.

A second motion starts at the distance d0 from the first one, in the energy norm

    |δ|² = δvᵀ M δv + δuᵀ K δu      (Y1)

After each period of the excitation the distance d is measured, and the second motion is moved back
to the distance d0 along the line between both. The exponent is the mean of ln(d/d0)/T. It includes
the jumps at impacts as the scheme computes them. A scheme that places impacts at the ends of steps
has no derivative there: two motions closer than the approach velocity times the time step mostly
hit in the same step. The result is then the exponent of the discrete map, so compare the results of
several perturbations and time steps.

Source: Benettin, Galgani, Giorgilli, Strelcyn, Meccanica 15 (1980) 9–20; for impacts Stefański,
Chaos, Solitons & Fractals 11 (2000) 2443–2451.
"""

from __future__ import annotations

import math

import numpy as np

from delam_fem.engines.session import Session
from delam_fem.model.operators import Operators
from delam_fem.numerics.arrays import FloatArray
from delam_fem.simulation.loop import Engine, State, set_initial
from delam_fem.simulation.recorder import Recorder

ALIGNING = 0.5
"""Share of the periods at the start that are not counted, because the second motion still turns
into the direction that decays most slowly. If two decay rates differ by 0.1/s, this takes some tens
of seconds."""


def largest_exponent(
    session: Session,
    operators: Operators,
    *,
    direction: FloatArray,
    period: float,
    periods: int,
    perturbation: float,
) -> float:
    """Continue a session and return the largest Lyapunov exponent of its motion.

    Args:
        session: session at the end of a run, with the motion on its attractor.
        operators: operators of the session, for the norm Y1.
        direction: direction of the initial difference of displacements, of any length, shape (n,).
        period: period T of the excitation [s].
        periods: number of periods over which the distance is measured.
        perturbation: d0 relative to the norm of the motion [-].

    Returns:
        The exponent [1/s]; NaN if a motion diverges or the system is at rest.
    """
    engine, recorder = session.engine, session.recorder
    one = engine.state()
    d0 = perturbation * _norm(one.motion, operators)
    step = np.zeros_like(one.motion)
    step[0] = direction
    length = _norm(step, operators)
    if not (d0 > 0.0 and length > 0.0):
        return math.nan
    two = State(one.motion + d0 / length * step, one.resting)
    growth, aligning = [], int(ALIGNING * periods)
    for number in range(recorder.n_closed, recorder.n_closed + periods):
        base_states = session.motion(number)
        after = [_advanced(engine, recorder, state, base_states) for state in (one, two)]
        if after[0] is None or after[1] is None:
            return math.nan
        one, step = after[0], after[1].motion - after[0].motion
        d = _norm(step, operators)
        if not 0.0 < d < math.inf:
            return math.nan
        growth.append(math.log(d / d0))
        two = State(one.motion + d0 / d * step, one.resting)
    return float(np.mean(growth[aligning:])) / period


def _advanced(
    engine: Engine, recorder: Recorder, state: State, base_states: FloatArray
) -> State | None:
    """Return the state one period later; None if the motion diverges."""
    set_initial(engine, state, base_states[0])
    record = recorder.open(engine.stepper, base_states)
    n_steps = engine.run_period(record, -recorder.limit)
    return engine.state() if n_steps == len(base_states) - 1 else None


def _norm(motion: FloatArray, operators: Operators) -> float:
    """Return the norm Y1 of a motion (u, v, …), shape (≥ 2, n) [J^½]."""
    u, v = motion[0], motion[1]
    return math.sqrt(float(v @ (operators.mass @ v) + u @ (operators.stiffness @ u)))
