"""A strip whose tip falls on blocks (paper 2.3, the second experiment)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import eigsh

from delam_fem.case.sections import Lamina
from delam_fem.model.beams import closed_form
from delam_fem.model.operators import Operators
from delam_fem.numerics.arrays import BoolArray, FloatArray
from delam_fem.numerics.beams import StruckBeam, peak_end
from delam_fem.paper.lateral import rolling
from delam_fem.paper.lateral.rolling import LIFT, STRETCH, Energy, GroundLaw, GroundRun
from delam_fem.simulation.loop import State

PEAK_WITHIN = 1e-4
"""The first peak of the force lies within this time after the touch [s]."""
SENT_WITHIN = 1e-3
"""Within this time the wave of the first peak has passed both gauges [s]."""
BLOCK_STIFFNESSES = (5e7, 1e9)
"""Possible stiffness of a brass block, a quartz force transducer (by data sheets about 1e9 N/m) and
the dent at the tip in series: least and greatest [N/m]."""
FAINT = 0.3
"""The wave begins where the strain first exceeds this fraction of its largest value. Weaker waves
before have higher frequencies than the peak of the force, and left the tip before that peak."""


def exact_beam(lamina: Lamina) -> StruckBeam:
    """Return the exact semi-infinite beam with the section of a strip."""
    return StruckBeam(lamina.flexural_rigidity, lamina.mass_per_length, lamina.thickness)


@dataclass(frozen=True)
class TipMotion:
    """The motion of a strip whose tip meets the block; times count from the touch.

    Attributes:
        time: times of the steps, shape (k,) [s].
        tip: height of the tip, shape (k,) [m].
        tip_velocity: velocity of the tip, shape (k,) [m/s].
        strain: strain at the gauges, shape (2, k) [-].
        impulse: impulse that the block has given so far, shape (k,) [N s].
        energy: stored and lost energy; its times also count from the touch.
        first_mode: energy in the first mode at `energy.time` without the start [J].
    """

    time: FloatArray
    tip: FloatArray
    tip_velocity: FloatArray
    strain: FloatArray
    impulse: FloatArray
    energy: Energy
    first_mode: FloatArray


@dataclass(frozen=True)
class TipBlock:
    """The second experiment with no block, with a block of finite stiffness and with a rigid one.

    Attributes:
        lamina: the strip.
        gauges: positions of the two strain gauges from the clamp, the nearer one first, shape (2,)
            [m].
        n_elements, time_step: number of elements [-] and Δt [s] of the computation.
        stiffness: stiffness of the block's surface and force transducer [N/m].
        fall_time: time from the release to the touch [s].
        speed: speed of the tip at the touch, the mean over the time of the peak, since it ripples
            by 0.5 % [m/s].
        energy: energy given to the strip by lifting it [J].
        static_strain: strain at the gauges before the release, shape (2,) [-].
        free: motion without a block.
        spring: motion with the block of finite stiffness.
        rigid: motion with the rigid block, newton@moreau-jean with e = 0.
    """

    lamina: Lamina
    gauges: FloatArray
    n_elements: int
    time_step: float
    stiffness: float
    fall_time: float
    speed: float
    energy: float
    static_strain: FloatArray
    free: TipMotion
    spring: TipMotion
    rigid: TipMotion

    @property
    def force(self) -> FloatArray:
        """Force of the block of finite stiffness, k times its compression, shape (k,) [N].

        The rigid block has no defined force; it has an impulse.
        """
        return self.stiffness * np.maximum(-self.spring.tip, 0.0)

    def wave(self, motion: TipMotion) -> FloatArray:
        """Return the strain that the block alone causes, shape (2, k); the strip is linear."""
        return motion.strain - self.free.strain

    def peak(self) -> tuple[float, float]:
        """Return the largest force of the first peak [N] and the time of its end, a minimum [s]."""
        time, force = self.spring.time, self.force
        highest = int(np.argmax(np.where(self._is_peak(), force, 0.0)))
        rising = highest + int(np.argmax(np.diff(force[highest:]) > 0.0))
        return float(force[highest]), float(time[rising])

    def undisturbed(self) -> float:
        """Return how long the second gauge hardly sees waves that the clamp reflects [s].

        The fastest waves that matter have twice the frequency that belongs to the peak's duration.
        """
        fastest = exact_beam(self.lamina).group_speed(2.0 / self.peak()[1])
        return float((self.lamina.length + self.gauges[1]) / fastest)

    def half_waves(self) -> tuple[FloatArray, FloatArray]:
        """Return the half waves at the second gauge, each between two zeros of its signal.

        Returns:
            Middle of each half wave, counted from the largest force [s], and its frequency [Hz].
        """
        time, signal = self.spring.time, self.wave(self.spring)[1]
        is_seen = (time > 0.0) & (time < self.undisturbed())
        time, signal = time[is_seen], signal[is_seen]
        loud = int(np.argmax(np.abs(signal) > FAINT * np.abs(signal).max()))
        before = loud + np.flatnonzero(np.diff(np.sign(signal[loud:])) != 0.0)
        share = signal[before] / (signal[before] - signal[before + 1])
        zeros = time[before] + share * self.time_step
        strongest = self.spring.time[np.argmax(np.where(self._is_peak(), self.force, 0.0))]
        return 0.5 * (zeros[1:] + zeros[:-1]) - strongest, 0.5 / np.diff(zeros)

    def exact_wave(self) -> FloatArray:
        """Return the strains that `spring_force` causes at the gauges without a clamp, (2, k)."""
        beam, since = exact_beam(self.lamina), np.maximum(self.spring.time, 0.0)
        force = beam.spring_force(since, self.speed, self.stiffness)
        distances = self.lamina.length - self.gauges
        return np.array([beam.strain(force, self.time_step, x) for x in distances])

    def exact_peak_waves(self) -> FloatArray:
        """Return the largest strains at the gauges from the wave of the first peak alone.

        The beam has no clamp; shape (2,) [-]. The wave after the peak, from a slowly fading force,
        is left out, because it has the same largest strain everywhere.
        """
        beam, step = exact_beam(self.lamina), self.time_step
        time = step * np.arange(round(SENT_WITHIN / step))
        force = beam.spring_force(time, self.speed, self.stiffness)
        force[time > self.peak()[1]] = 0.0
        distances = self.lamina.length - self.gauges
        return np.array([np.abs(beam.strain(force, step, x)).max() for x in distances])

    def numbers(self) -> dict[str, Any]:
        """Return the numbers that the figures quote, with the exact beam's where there are any."""
        length, x = self.lamina.length, self.gauges
        static = 1.5 * LIFT * self.lamina.thickness * (length - x) / length**3
        return {
            "strip": self.lamina.model_dump(exclude_none=True),
            "lowest_period_ms": 2e3 * np.pi / float(self.lamina.angular_frequencies(1)[0]),
            "elements": self.n_elements,
            "time_step_us": 1e6 * self.time_step,
            "gauges_m": self.gauges.tolist(),
            "static_strain": self.static_strain.tolist(),
            "static_strain_exact": static.tolist(),
            "fall_time_ms": 1e3 * self.fall_time,
            "speed_m_s": self.speed,
            **self._peak_numbers(),
            **self._wave_numbers(),
            "spring": self._rebound(self.spring),
            "rigid": self._rebound(self.rigid),
        }

    def _peak_numbers(self) -> dict[str, Any]:
        """Return force, duration and impulse of the first peak."""
        beam, (force, end) = exact_beam(self.lamina), self.peak()
        exact = beam.spring_force(np.linspace(0.0, end, 400), self.speed, self.stiffness)
        velocity = _at(end, self.spring, self.spring.tip_velocity)
        return {
            "block_stiffness_N_m": self.stiffness,
            "peak_force_N": force,
            "peak_force_exact_N": float(exact.max()),
            "peak_duration_us": 1e6 * end,
            "impulse_of_peak_N_s": _at(end, self.spring, self.spring.impulse),
            "rigid_impulse_of_peak_N_s": _at(end, self.rigid, self.rigid.impulse),
            "rigid_impulse_of_peak_exact_N_s": float(beam.rigid_impulse(end, self.speed)),
            "duration_of_block_us": {
                f"{k:g}": 1e6 * peak_end() * beam.contact_time(k) for k in BLOCK_STIFFNESSES
            },
            "restitution_after_peak": velocity / self.speed,
        }

    def _wave_numbers(self) -> dict[str, Any]:
        """Return sizes and speeds of the wave before the clamp reflects it."""
        beam, (middle, frequency) = exact_beam(self.lamina), self.half_waves()
        distance = self.lamina.length - self.gauges[1]
        early = self.spring.time < self.undisturbed()
        wave, exact = self.wave(self.spring)[:, early], self.exact_wave()[:, early]
        misfit = np.sqrt(np.mean((wave[1] - exact[1]) ** 2) / np.mean(exact[1] ** 2))
        rod_speed = np.sqrt(self.lamina.young_modulus / self.lamina.density)
        return {
            "undisturbed_us": 1e6 * self.undisturbed(),
            "wave_strain_max": np.abs(wave).max(axis=1).tolist(),
            "wave_strain_max_exact": np.abs(exact).max(axis=1).tolist(),
            "peak_wave_strain_max_exact": self.exact_peak_waves().tolist(),
            "wave_misfit_second_gauge": float(misfit),
            "half_wave_Hz": frequency.tolist(),
            "half_wave_arrival_us": (1e6 * middle).tolist(),
            "half_wave_arrival_exact_us": (1e6 * distance / beam.group_speed(frequency)).tolist(),
            "timoshenko_lowers_by": (
                1.0 - beam.timoshenko_group_speed(frequency) / beam.group_speed(frequency)
            ).tolist(),
            "mean_wave_speed_m_s": float(np.mean(distance / middle)),
            "longitudinal_speed_m_s": float(rod_speed),
        }

    def _is_peak(self) -> BoolArray:
        return np.abs(self.spring.time) < PEAK_WITHIN

    def _rebound(self, motion: TipMotion) -> dict[str, float]:
        """Return the motion after the impact, with energies as shares of the energy of lifting."""
        pushed = np.flatnonzero(np.diff(motion.impulse) > 0.0)
        last = int(pushed[-1]) + 1
        first_mode = float(motion.first_mode[-1]) / self.energy
        before = float(self.free.first_mode[0]) / self.energy
        return {
            "last_push_ms": 1e3 * float(motion.time[last]),
            "tip_within_mm_until_then": 1e3 * float(motion.tip[: last + 1].max()),
            "lost_at_impacts": float(motion.energy.impact[-1]) / self.energy,
            "lost_to_damping": float(motion.energy.damped[-1]) / self.energy,
            "first_mode_before": before,
            "first_mode_after": first_mode,
            "restitution_of_first_mode": float(np.sqrt(first_mode / before)),
        }


def _at(time: float, motion: TipMotion, values: FloatArray) -> float:
    return float(np.interp(time, motion.time, values))


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
    lamina = lamina or closed_form.steel_strip(damping_ratio=DAMPING_RATIO)
    stiffness = exact_beam(lamina).stiffness_for(peak_duration)
    places = np.array(gauges or (0.020, 0.5 * lamina.length))
    rows = closed_form.strain_rows(lamina, n_elements, places)
    dofs = np.unique(rows.indices)
    observed = np.concatenate([[2 * n_elements - 2], dofs])  # u of the tip first
    operators = closed_form.on_ground(lamina, n_elements, "tip", observed)
    start = rolling.released(closed_form.lifted(lamina, n_elements, LIFT, "tip force"), operators)
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
    return rolling.run(
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
    return rolling.run(
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
