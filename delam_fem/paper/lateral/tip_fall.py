"""Compute the fall of a strip's tip on a block: one fall, then impacts on three blocks."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import eigsh

from delam_fem.case.sections import Lamina
from delam_fem.model.beams import ground
from delam_fem.model.operators import Operators
from delam_fem.numerics.arrays import FloatArray
from delam_fem.paper.lateral import ground_run
from delam_fem.paper.lateral.ground_run import LIFT, STRETCH, GroundLaw, GroundRun
from delam_fem.paper.lateral.tip_block import TipBlock, TipMotion, exact_beam
from delam_fem.simulation.loop import State

DAMPING_RATIO = 2e-5
"""D of modes 1 and 2 [-]; Rayleigh damping then has 0.4 % at 30 kHz, as steel has."""
FALL_STEPS = 4
"""Steps of the impact per step of the fall, in which only the lowest modes move."""


def tip_block(
    lamina: Lamina | None = None,
    *,
    n_elements: int = 200,
    time_step: float = 2.5e-7,
    duration: float = 8e-3,
    gauges: tuple[float, float] | None = None,
    peak_duration: float = 30e-6,
) -> TipBlock:
    """Compute the fall of a strip with its tip on a block.

    Args:
        lamina: the strip; None: the 20 Hz steel strip with `DAMPING_RATIO`.
        n_elements: n.
        time_step: Δt, a divisor of an eighth of `STRETCH` [s].
        duration: duration of the impact run, which starts shortly before the touch [s].
        gauges: positions of the gauges from the clamp; None: 20 mm and half the length [m].
        peak_duration: duration of the force peak; the block's stiffness follows from it by the
            exact beam [s].
    """
    lamina = lamina or ground.steel_strip(damping_ratio=DAMPING_RATIO)
    stiffness = exact_beam(lamina).stiffness_for(peak_duration)
    places = np.array(gauges or (0.020, 0.5 * lamina.length))
    rows = ground.strain_rows(lamina, n_elements, places)
    dofs = np.unique(rows.indices)
    observed = np.concatenate([[2 * n_elements - 2], dofs])  # u of the tip first
    operators = ground.on_ground(lamina, n_elements, "tip", observed)
    start = ground_run.released(ground.lifted(lamina, n_elements, LIFT, "tip force"), operators)
    fall = _fall(lamina, operators, start, FALL_STEPS * time_step)
    free, spring, rigid = (
        _impact(law, operators, fall.state, time_step, duration)
        for law in (
            GroundLaw("none"),
            GroundLaw("penalty", stiffness=stiffness),
            GroundLaw("newton", restitution=0.0, scheme="moreau-jean"),
        )
    )
    touch, speed = _touch(free, round(peak_duration / time_step))
    at_gauges = rows[:, dofs]
    mode = _FirstMode.of(operators)
    return TipBlock(
        lamina=lamina,
        gauges=places,
        n_elements=n_elements,
        time_step=time_step,
        stiffness=stiffness,
        fall_time=float(fall.time[-1]) + touch,
        speed=speed,
        energy=float(fall.energy.stored[0]),
        static_strain=np.asarray(rows @ start.motion[0]),
        free=_motion(free, touch, at_gauges, mode),
        spring=_motion(spring, touch, at_gauges, mode, stiffness),
        rigid=_motion(rigid, touch, at_gauges, mode),
    )


def _impact(
    law: GroundLaw, operators: Operators, start: State, time_step: float, duration: float
) -> GroundRun:
    """Run the impact on one kind of block."""
    return ground_run.run(
        law,
        operators,
        start,
        time_step=time_step,
        steps_per_stretch=_steps(time_step),
        n_stretches=round(2.0 * duration / STRETCH),
    )


def _steps(time_step: float) -> int:
    """Return the number of impact steps in half a stretch."""
    return round(0.5 * STRETCH / time_step)


def _touch(free: GroundRun, n_steps: int) -> tuple[float, float]:
    """Return when the tip without a block passes the ground [s], and how fast [m/s].

    Args:
        free: a run without a block.
        n_steps: number of steps after the touch over which the speed is averaged.
    """
    first = int(np.argmax(free.u[:, 0] <= 0.0))
    touch = float(free.time[first] - free.u[first, 0] / free.v[first, 0])
    return touch, -float(free.v[first : first + n_steps, 0].mean())


def _fall(lamina: Lamina, operators: Operators, start: State, time_step: float) -> GroundRun:
    """Run the fall until the tip, at its current velocity, would touch within `STRETCH`."""
    half_period = float(np.pi / lamina.angular_frequencies(1)[0])
    return ground_run.run(
        GroundLaw("none"),
        operators,
        start,
        time_step=time_step,
        steps_per_stretch=_steps(time_step),
        n_stretches=round(2.0 * half_period / STRETCH),
        stop=lambda u, v: u + STRETCH * v < 0.0,
    )


@dataclass(frozen=True)
class _FirstMode:
    """Computes the energy in the first mode from a state.

    Attributes:
        of_u: φᵀ M ω / √2 for the mode φ with φᵀ M φ = 1, shape (n,).
        of_v: φᵀ M / √2, shape (n,).
    """

    of_u: FloatArray
    of_v: FloatArray

    @classmethod
    def of(cls, operators: Operators) -> _FirstMode:
        square, mode = eigsh(
            operators.stiffness.tocsc(), k=1, M=operators.mass.tocsc(), sigma=0.0, which="LM"
        )
        projection = np.sqrt(0.5) * (operators.mass @ mode[:, 0])
        return cls(np.sqrt(square[0]) * projection, projection)

    def energy(self, frames: FloatArray) -> FloatArray:
        """Return the energy of states of shape (m, 2, n), shape (m,) [J]."""
        return np.asarray((frames[:, 0] @ self.of_u) ** 2 + (frames[:, 1] @ self.of_v) ** 2)


def _motion(
    out: GroundRun,
    touch: float,
    at_gauges: sp.csr_matrix,
    mode: _FirstMode,
    stiffness: float | None = None,
) -> TipMotion:
    """Return the motion of a run, with times from the touch; with a stiffness: a spring block."""
    tip, impulse = out.u[:, 0], np.zeros(out.time.size)
    if stiffness is not None:
        force = stiffness * np.maximum(-tip, 0.0)
        impulse[1:] = np.cumsum(np.diff(out.time) * 0.5 * (force[1:] + force[:-1]))
    else:
        steps = np.rint(out.impulses.time / (out.time[1] - out.time[0])).astype(np.int64)
        np.add.at(impulse, steps, out.impulses.impulse)
        impulse = np.cumsum(impulse)
    return TipMotion(
        time=out.time - touch,
        tip=tip,
        tip_velocity=out.v[:, 0],
        strain=np.asarray(at_gauges @ out.u[:, 1:].T),
        impulse=impulse,
        energy=replace(out.energy, time=out.energy.time - touch),
        first_mode=mode.energy(out.frames),
    )
