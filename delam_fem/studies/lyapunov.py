"""Estimate the largest Lyapunov exponent from two neighbouring motions.

A second motion starts at the distance d0 from the first one, in the energy norm

    |δ|² = δvᵀ M δv + δuᵀ K δu      (Y1)

After each period of the excitation the distance d is measured, and the second motion is moved back
to the distance d0 along the line between both. The exponent is the mean of ln(d/d0)/T. It includes
the jumps at impacts as the scheme computes them. A scheme that places impacts at the ends of steps
has no derivative there: two motions closer than the approach velocity times the time step mostly
hit in the same step. The result is then the exponent of the discrete map, so compare the results of
several perturbations and time steps.

The result has the statistical error of the mean, not the error of the map. In the chaos of an
impact oscillator, results scatter about the exact exponent by more than that (docs/sweeps.md).

Source: Benettin, Galgani, Giorgilli, Strelcyn, Meccanica 15 (1980) 9–20; for impacts Stefański,
Chaos, Solitons & Fractals 11 (2000) 2443–2451.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from delam_fem.engines.session import Session
from delam_fem.model.operators import Operators
from delam_fem.numerics.arrays import FloatArray
from delam_fem.simulation.loop import Engine, State, one_period, set_initial
from delam_fem.simulation.recorder import Recorder

BLOCKS = 10
"""Number of blocks of successive periods whose means give the statistical error."""
ALIGNING = 0.5
"""Share of the periods at the start that are not counted, because the second motion still turns
into the direction that decays most slowly. If two decay rates differ by 0.1/s, this takes some tens
of seconds."""


@dataclass(frozen=True)
class Exponent:
    """A Lyapunov exponent.

    Attributes:
        value: the exponent [1/s].
        error: standard error of the mean that it is [1/s]; NaN for fewer than `BLOCKS` periods.
    """

    value: float
    error: float


UNKNOWN = Exponent(math.nan, math.nan)


def largest_exponent(
    session: Session,
    operators: Operators,
    *,
    direction: FloatArray,
    period: float,
    periods: int,
    perturbation: float,
) -> Exponent:
    """Continue a session and return the largest Lyapunov exponent of its motion.

    Args:
        session: session at the end of a run, with the motion on its attractor.
        operators: operators of the session, for the norm Y1.
        direction: direction of the initial difference of displacements, of any length, shape (n,).
        period: period T of the excitation [s].
        periods: number of periods over which the distance is measured.
        perturbation: d0 relative to the norm of the motion [-].

    Returns:
        The exponent with its error; NaN if a motion diverges or the system is at rest.
    """
    engine, recorder = session.engine, session.recorder
    one = engine.state()
    d0 = perturbation * _norm(one.motion, operators)
    step = np.zeros_like(one.motion)
    step[0] = direction
    length = _norm(step, operators)
    if not (d0 > 0.0 and length > 0.0):
        return UNKNOWN
    two = State(one.motion + d0 / length * step, one.resting)
    growth, aligning = [], int(ALIGNING * periods)
    of_one = recorder.of_one_period()
    for number in range(recorder.n_closed, recorder.n_closed + periods):
        base_states = session.motion(number)
        after = [_advanced(engine, of_one, state, base_states) for state in (one, two)]
        if after[0] is None or after[1] is None:
            return UNKNOWN
        one, step = after[0], after[1].motion - after[0].motion
        d = _norm(step, operators)
        if not 0.0 < d < math.inf:
            return UNKNOWN
        growth.append(math.log(d / d0))
        two = State(one.motion + d0 / d * step, one.resting)
    return mean_growth(np.array(growth[aligning:]) / period)


def mean_growth(rates: FloatArray) -> Exponent:
    """Return the mean of the rates of successive periods and its statistical error.

    Rates of neighbouring periods depend on one another; the means of `BLOCKS` blocks hardly do.

    Args:
        rates: ln(d/d0)/T of each period, shape (n,) [1/s].
    """
    means = [part.mean() for part in np.array_split(rates, BLOCKS) if part.size]
    error = np.std(means, ddof=1) / math.sqrt(len(means)) if len(means) == BLOCKS else math.nan
    return Exponent(float(rates.mean()), float(error))


def _advanced(
    engine: Engine, recorder: Recorder, state: State, base_states: FloatArray
) -> State | None:
    """Return the state one period later; None if the motion diverges."""
    set_initial(engine, state, base_states[0])
    record = one_period(engine, recorder, base_states)
    return engine.state() if record.n_steps == len(base_states) - 1 else None


def _norm(motion: FloatArray, operators: Operators) -> float:
    """Return the norm Y1 of a motion (u, v, …), shape (≥ 2, n) [J^½]."""
    u, v = motion[0], motion[1]
    return math.sqrt(float(v @ (operators.mass @ v) + u @ (operators.stiffness @ u)))
