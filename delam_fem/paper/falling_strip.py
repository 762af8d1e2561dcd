"""A steel strip that falls on the ground, or with its tip on a block (paper 2.3).

`rolling` is the first experiment: a strip that lies on the ground is lifted and released. All times
are relative to the strip's lowest period as a cantilever. Then only the ratio of the tip height to
the strip's sag under its weight matters, besides law, mesh and time step. `rolling_study` repeats
the experiment with other strips, heights, laws, meshes and time steps. `tip_block` is the second
experiment: the tip falls on blocks.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from delam_fem.api import (
    SCHEMES,
    BoolArray,
    FloatArray,
    ImpactTable,
    Lamina,
    Law,
    Operators,
    Scheme,
    Solution,
    State,
    beams,
    lowest,
    solve,
)
from delam_fem.paper import rigid_ground

LIFT = 0.050
"""Height of the tip before the release [m]."""
STRETCH = 1e-4
"""Time between two entries of the energy ledger [s]."""
UNBOUNDED = 10.0
"""A motion above this height counts as diverged [m]; the strip is lifted by centimetres."""
THRESHOLD = 0.5e-3
"""γ of the paper [m/s]."""
METHODS = {
    "newton@moreau-jean": (
        Law("newton", 0.1, threshold_velocity=THRESHOLD), SCHEMES["moreau-jean"],
    ),
    "newton-penalty@newmark": (
        Law("newton-penalty", 0.1, penalty_stiffness=100.0, threshold_velocity=THRESHOLD),
        SCHEMES["newmark"],
    ),
}  # fmt: skip
"""The laws that are compared, with the paper's e = 0.1, γ and spring stiffness (the thin strip is
as soft as the paper's laminae). Impulses are consistent (through M⁻¹)."""


@dataclass(frozen=True)
class Energy:
    """The stored and the lost energy at the ends of equal stretches of a run [J].

    Attributes:
        time: ends of the stretches, and the start, shape (m,) [s].
        stored: kinetic, strain and spring energy together, shape (m,).
        damped: energy lost to damping so far, shape (m,).
        impact: energy lost at impacts so far, shape (m,).
        residual: largest error of the energy balance over a stretch.
    """

    time: FloatArray
    stored: FloatArray
    damped: FloatArray
    impact: FloatArray
    residual: float

    @classmethod
    def of(cls, run: Solution, *, origin: float = 0.0, at_rest: float = 0.0) -> Energy:
        """Return the energies of a run; times count from an instant, energy from that at rest."""
        flow, records = run.energy, run.records
        stored = flow["kinetic"] + flow["strain"] + flow["spring"]
        steps = np.cumsum([0] + [record.n_steps for record in records])
        return cls(
            time=run.recorder.time_step * steps - origin,
            stored=np.concatenate([[records[0].start[:3].sum()], stored]) - at_rest,
            damped=np.cumsum([0.0, *(flow["damping_loss"] + flow["contact_damping_loss"])]),
            impact=np.cumsum([0.0, *flow["impact_loss"]]),
            residual=float(np.abs(flow["residual"]).max()),
        )


def released(shape: FloatArray, operators: Operators) -> State:
    """Return the state of a lamina that is released at rest in a shape, (u, φ) of all free dofs."""
    motion = np.array([shape, np.zeros_like(shape), np.zeros_like(shape)])
    return State(motion, np.zeros(operators.n_pairs, dtype=np.bool_))


def run(
    law: Law,
    scheme: Scheme,
    operators: Operators,
    start: State,
    *,
    time_step: float,
    stretch: int,
    n_stretches: int,
) -> Solution:
    """Run a problem with a frame of all dofs and an entry of the ledger after each stretch.

    Args:
        law: the contact law.
        scheme: the time integration.
        operators: operators of the lamina over the ground; the tip is observed first.
        start: state at the start.
        time_step: Δt [s].
        stretch: number of steps of a stretch.
        n_stretches: number of stretches.
    """
    return solve(
        operators, law, scheme, steps_per_period=stretch, periods=n_stretches, time_step=time_step,
        frames_per_period=1, limit=UNBOUNDED, initial=start, engine="compiled",
    )  # fmt: skip


# -- the first experiment: a strip on the ground -----------------------------------------------

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
        method: contact law with the ground and time integration, a key of `METHODS`.
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
    method: str
    lift: rigid_ground.Lift
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
        x = self.x[is_front]
        t = line[is_front]
        if np.ptp(t) < 2.0 * self.period / self.steps_per_period:
            return 0.0, float("inf")
        ranks = np.array([np.argsort(np.argsort(values)) for values in (x, t)], dtype=float)
        return float(np.corrcoef(ranks)[0, 1]), float(np.ptp(x) / np.ptp(t))

    def shares(self, time: float) -> dict[str, float]:
        """Return the shares of the energy at a time: lost at impacts, lost to damping, left [-]."""
        e = self.energy
        half = 0.5 * self.period / STRETCHES
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
            "sag_mm": 1e3 * rigid_ground.sag(self.lamina, self.gravity),
            "height_mm": 1e3 * float(self.tip[0]),
            "law": METHODS[self.method][0].name,
            "lift": self.lift,
            "elements": self.x.size,
            "steps_per_period": self.steps_per_period,
            "restitution": METHODS[self.method][0].restitution,
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
    return rigid_ground.steel_strip(length=0.5, thickness=0.001, damping_ratio=damping_ratio)


def rolling(
    lamina: Lamina | None = None,
    method: str = "newton@moreau-jean",
    *,
    height: float = LIFT,
    lift: rigid_ground.Lift = "tip force",
    gravity: float = rigid_ground.GRAVITY,
    n_elements: int = 80,
    steps_per_period: int = 20_000,
    periods: float = 0.5,
) -> Rolling:
    """Compute the fall of a strip on the ground on which it lies.

    Args:
        lamina: the strip; None: `thin_strip`.
        method: contact law and time integration, a key of `METHODS`.
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
    operators = rigid_ground.on_ground(lamina, n_elements, "everywhere", gravity=gravity)
    out = run(
        *METHODS[method],
        operators,
        released(rigid_ground.lifted(lamina, n_elements, height, lift, gravity=gravity), operators),
        time_step=_period(lamina) / steps_per_period,
        stretch=steps_per_period // STRETCHES,
        n_stretches=round(periods * STRETCHES),
    )
    lying = rigid_ground.lying(lamina, n_elements, gravity)
    return Rolling(
        lamina=lamina,
        method=method,
        lift=lift,
        gravity=gravity,
        x=rigid_ground.nodes(lamina, n_elements),
        steps_per_period=steps_per_period,
        time=out.time,
        tip=out.displacement[:, 0] - rigid_ground.sag(lamina, gravity),
        top=(out.frames[:, 0, ::2] - lying[::2]).max(axis=1),
        impulses=out.impacts,
        energy=Energy.of(out, at_rest=0.5 * float(lying @ (operators.stiffness @ lying))),
        outcome=out.outcome,
    )


def _period(lamina: Lamina) -> float:
    return 2.0 * float(np.pi / lamina.angular_frequencies(1)[0])


HEIGHTS = (0.014, 0.02, 0.03, 0.04, 0.05, 0.07, 0.085, 0.1, 0.15)
"""Tip heights of the thin strip, which sags by 34 mm under its weight [m]."""
DAMPING_RATIOS = (0.0, 0.002)
"""D of modes 1 and 2: no damping, and about the damping of a clamped steel strip."""
LONG = 0.8
"""Duration of the runs that show a rebound, in periods; the rebound ends at about 0.76."""


@dataclass(frozen=True)
class RollingStudy:
    """The fall of a strip on the ground and its variations; a force at the tip lifts every strip.

    Attributes:
        by_law: the thin strip, by the name of the law in `METHODS`.
        stiff: the strip of the second experiment with newton@moreau-jean.
        by_height: the thin strip by height of its tip [m], on a coarser mesh.
        refinement: the thin strip on other meshes and with other time steps; see `level`.
    """

    by_law: Mapping[str, Rolling]
    stiff: Rolling
    by_height: Mapping[float, Rolling]
    refinement: Sequence[Mapping[str, Any]]

    def numbers(self) -> dict[str, Any]:
        """Return the numbers that the figure quotes."""
        return {
            "by_law": {name: run.numbers() for name, run in self.by_law.items()},
            "stiff": self.stiff.numbers(),
            "by_height_mm": {f"{1e3 * h:g}": run.numbers() for h, run in self.by_height.items()},
            "refinement": self.refinement,
        }


def rolling_study(*, fast: bool = False) -> RollingStudy:
    """Compute the fall on the ground with several strips, heights, laws, meshes and time steps.

    Args:
        fast: whether to compute fewer meshes and steps.
    """
    elements, steps = (
        ((20, 80), (5_000, 20_000)) if fast else ((20, 40, 80), (5_000, 20_000, 80_000))
    )
    return RollingStudy(
        by_law={name: rolling(method=name, periods=LONG) for name in METHODS},
        stiff=rolling(rigid_ground.steel_strip(damping_ratio=max(DAMPING_RATIOS)), periods=LONG),
        by_height={
            height: rolling(height=height, n_elements=40, steps_per_period=10_000)
            for height in HEIGHTS
        },
        refinement=[
            level(name, damping_ratio, n, n_steps)
            for name in METHODS
            for damping_ratio in DAMPING_RATIOS
            for n in elements
            for n_steps in steps
        ],
    )


def level(law: str, damping_ratio: float, elements: int, steps_per_period: int) -> dict[str, Any]:
    """Compute the energy shares of the thin strip after half a period.

    Args:
        law: name of the law, a key of `METHODS`.
        damping_ratio: D [-].
        elements: n.
        steps_per_period: time steps per lowest period [-].

    Returns:
        The arguments; impacts, damping, left: shares of the energy [-]; outcome: "completed" or
        "diverged".
    """
    run = rolling(
        thin_strip(damping_ratio), law, n_elements=elements, steps_per_period=steps_per_period
    )
    shares = run.shares(float(run.energy.time[-1]))
    return {
        "law": law,
        "damping_ratio": damping_ratio,
        "elements": elements,
        "steps_per_period": steps_per_period,
        **{name: shares[name] for name in ("impacts", "damping", "left")},
        "outcome": run.outcome,
    }


# -- the second experiment: a tip on blocks ----------------------------------------------------

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


def exact_beam(lamina: Lamina) -> beams.StruckBeam:
    """Return the exact semi-infinite beam with the section of a strip."""
    return beams.StruckBeam(
        lamina.flexural_rigidity, lamina.mass_per_length, lamina.mean("thickness")
    )


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
    """The fall of a strip's tip without a block, on a block of finite stiffness, on a rigid one.

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
        time = self.spring.time
        force = self.force
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
        time = self.spring.time
        signal = self.wave(self.spring)[1]
        is_seen = (time > 0.0) & (time < self.undisturbed())
        time = time[is_seen]
        signal = signal[is_seen]
        loud = int(np.argmax(np.abs(signal) > FAINT * np.abs(signal).max()))
        before = loud + np.flatnonzero(np.diff(np.sign(signal[loud:])) != 0.0)
        share = signal[before] / (signal[before] - signal[before + 1])
        zeros = time[before] + share * self.time_step
        strongest = self.spring.time[np.argmax(np.where(self._is_peak(), self.force, 0.0))]
        return 0.5 * (zeros[1:] + zeros[:-1]) - strongest, 0.5 / np.diff(zeros)

    def _exact_strain(self, since: FloatArray, until: float = np.inf) -> FloatArray:
        """Return the strains that `spring_force`, up to a time, causes at the gauges, (2, k).

        The beam has no clamp. The times since the touch are `time_step` apart.
        """
        beam = exact_beam(self.lamina)
        distances = self.lamina.length - self.gauges
        force = beam.spring_force(since, self.speed, self.stiffness)
        force[since > until] = 0.0
        return np.array([beam.strain(force, self.time_step, x) for x in distances])

    def exact_wave(self) -> FloatArray:
        """Return the exact strains at the gauges at the times of the motion, shape (2, k)."""
        return self._exact_strain(np.maximum(self.spring.time, 0.0))

    def exact_peak_waves(self) -> FloatArray:
        """Return the largest strains at the gauges from the wave of the first peak alone, (2,) [-].

        The wave after the peak, from a slowly fading force, is left out, because it has the same
        largest strain everywhere.
        """
        time = self.time_step * np.arange(round(SENT_WITHIN / self.time_step))
        return np.asarray(np.abs(self._exact_strain(time, self.peak()[1])).max(axis=1))

    def numbers(self) -> dict[str, Any]:
        """Return the numbers that the figures quote, with the exact beam's where there are any."""
        length = self.lamina.length
        x = self.gauges
        static = 1.5 * LIFT * self.lamina.mean("thickness") * (length - x) / length**3
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
        return {
            "block_stiffness_N_m": self.stiffness,
            "peak_force_N": force,
            "peak_force_exact_N": float(exact.max()),
            "peak_duration_us": 1e6 * end,
            "impulse_of_peak_N_s": _at(end, self.spring, self.spring.impulse),
            "rigid_impulse_of_peak_N_s": _at(end, self.rigid, self.rigid.impulse),
            "rigid_impulse_of_peak_exact_N_s": float(beam.rigid_impulse(end, self.speed)),
            "duration_of_block_us": {
                f"{k:g}": 1e6 * beams.peak_end() * beam.contact_time(k) for k in BLOCK_STIFFNESSES
            },
            "restitution_after_peak": _at(end, self.spring, self.spring.tip_velocity) / self.speed,
        }

    def _wave_numbers(self) -> dict[str, Any]:
        """Return sizes and speeds of the wave before the clamp reflects it."""
        beam, (middle, frequency) = exact_beam(self.lamina), self.half_waves()
        distance = self.lamina.length - self.gauges[1]
        early = self.spring.time < self.undisturbed()
        wave = self.wave(self.spring)[:, early]
        exact = self.exact_wave()[:, early]
        misfit = np.sqrt(np.mean((wave[1] - exact[1]) ** 2) / np.mean(exact[1] ** 2))
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
            "longitudinal_speed_m_s": float(
                np.sqrt(self.lamina.mean("young_modulus") / self.lamina.mean("density"))
            ),
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
PEAK_DURATION = 30e-6
"""Duration of the force peak in the paper [s]."""
FALL_STEPS = 4
"""Steps of the impact per step of the fall, in which only the lowest modes move."""


def tip_block(
    *, n_elements: int = 200, time_step: float = 2.5e-7, duration: float = 8e-3
) -> TipBlock:
    """Compute the fall of a 20 Hz steel strip with its tip on a block.

    The block has the stiffness with which the exact beam has a force peak of `PEAK_DURATION`.

    Args:
        n_elements: n.
        time_step: Δt, a divisor of an eighth of `STRETCH` [s].
        duration: duration of the impact run, which starts shortly before the touch [s].
    """
    lamina = rigid_ground.steel_strip(damping_ratio=DAMPING_RATIO)
    stiffness = exact_beam(lamina).stiffness_for(PEAK_DURATION)
    gauges = np.array([0.020, 0.5 * lamina.length])
    operators = rigid_ground.on_ground(lamina, n_elements, "tip", gauges=gauges.tolist())
    start = released(rigid_ground.lifted(lamina, n_elements, LIFT, "tip force"), operators)
    newmark = SCHEMES["newmark"]
    half = 0.5 * STRETCH
    slow = FALL_STEPS * time_step
    fall = run(
        Law("none"), newmark, operators, start, time_step=slow, stretch=round(half / slow),
        n_stretches=round(0.5 * _period(lamina) / half),
    )  # fmt: skip
    u, v = fall.frames[:, :, -2].T  # of the tip
    last = int(np.argmax(u + STRETCH * v < 0.0))  # it would touch within `STRETCH`
    before = replace(start, motion=np.vstack([fall.frames[last], np.zeros_like(start.motion[:1])]))
    free, spring, rigid = (
        run(
            law,
            scheme,
            operators,
            before,
            time_step=time_step,
            stretch=round(half / time_step),
            n_stretches=round(duration / half),
        )
        for law, scheme in (
            (Law("none"), newmark),
            (Law("penalty", penalty_stiffness=stiffness), newmark),
            (Law("newton", threshold_velocity=THRESHOLD), SCHEMES["moreau-jean"]),
        )
    )
    # when the tip without a block passes the ground [s], and how fast [m/s]
    u = free.displacement[:, 0]
    v = free.velocity[:, 0]
    first = int(np.argmax(u <= 0.0))
    touch = float(free.time[first] - u[first] / v[first])
    speed = -float(v[first : first + round(PEAK_DURATION / time_step)].mean())
    # φᵀ M ω / √2 and φᵀ M / √2 for the first mode φ with φᵀ M φ = 1: the squares of their products
    # with u and v are the energies in the mode
    M = operators.mass
    (frequency,), vectors = lowest(operators.stiffness, M, 1)
    phi = vectors[:, 0]
    projection = np.sqrt(0.5) * (M @ phi) / np.sqrt(phi @ M @ phi)
    mode = np.array([2.0 * np.pi * frequency * projection, projection])
    return TipBlock(
        lamina=lamina,
        gauges=gauges,
        n_elements=n_elements,
        time_step=time_step,
        stiffness=stiffness,
        fall_time=float(fall.time[(last + 1) * round(half / slow)]) + touch,
        speed=speed,
        energy=float(Energy.of(fall).stored[0]),
        static_strain=np.asarray(operators.probes[1:] @ start.motion[0]),
        free=_motion(free, touch, mode),
        spring=_motion(spring, touch, mode, stiffness),
        rigid=_motion(rigid, touch, mode),
    )


def _motion(
    out: Solution, touch: float, mode: FloatArray, stiffness: float | None = None
) -> TipMotion:
    """Return the motion of a run, with times from the touch; with a stiffness: a spring block."""
    tip = out.displacement[:, 0]
    impulse = np.zeros(out.time.size)
    if stiffness is not None:
        force = stiffness * np.maximum(-tip, 0.0)
        impulse[1:] = np.cumsum(np.diff(out.time) * 0.5 * (force[1:] + force[:-1]))
    else:
        steps = np.rint(out.impacts.time / (out.time[1] - out.time[0])).astype(np.int64)
        np.add.at(impulse, steps, out.impacts.impulse)
        impulse = np.cumsum(impulse)
    return TipMotion(
        time=out.time - touch,
        tip=tip,
        tip_velocity=out.velocity[:, 0],
        strain=out.displacement[:, 1:].T,
        impulse=impulse,
        energy=Energy.of(out, origin=touch),
        first_mode=(out.frames[:, 0] @ mode[0]) ** 2 + (out.frames[:, 1] @ mode[1]) ** 2,
    )
