"""Small contact problems with exact solutions, as `Operators`, and one way to run them all.

Each builder is the semi-discrete problem alone; `simulate` puts it together with a law and a time
integration of the package.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp

from delam_fem.api import N_BASE, SCHEMES, BaseCoupling, FloatArray, Operators, Scheme, State, solve
from delam_fem.contact import laws
from delam_fem.model.beams.closed_form import element_mass, element_stiffness, sum_elements
from delam_fem.simulation.refinement import Refinement

Motion = Callable[[FloatArray], FloatArray]
"""States (q, q', q'') of the base at times of shape (k,), shape (k, 3)."""

SEATED = 1e-9
"""Depth by which the beam rests below the floor [m]: with a gap of 0 round-off decides whether
moreau looks at a pair, and one that it does not look at falls by g Δt² in the step."""
UNBOUNDED = 1e6
"""Displacement beyond which a motion counts as diverged [m]."""


@dataclass(frozen=True)
class Law:
    """A contact law with its scheme; impulses act through the mass of the scheme.

    Attributes:
        name: LAW@SCHEME, or a law alone, which goes with Newmark.
        restitution: e [-].
        spring: stiffness [N/m] and damping [N s/m] of a resting pair.
        threshold_velocity: γ of newton-penalty [m/s].
        theta: θ of Moreau–Jean [-].
        refine: fine steps in a step near contact.
    """

    name: str
    restitution: float = 0.0
    spring: tuple[float, float] = (0.0, 0.0)
    threshold_velocity: float = 0.0
    theta: float = 0.5
    refine: int = 1

    @property
    def contact(self) -> laws.Law:
        """The contact law."""
        return laws.Law(
            self.name.partition("@")[0],  # type: ignore[arg-type]
            restitution=self.restitution,
            penalty_stiffness=self.spring[0],
            penalty_damping=self.spring[1],
            threshold_velocity=self.threshold_velocity,
        )

    @property
    def scheme(self) -> Scheme:
        """The time integration."""
        name = self.name.partition("@")[2] or "newmark"
        return replace(SCHEMES[name], theta=self.theta)


@dataclass(frozen=True)
class Prescribed:
    """A motion of the base from a function of time."""

    states: Motion


@dataclass(frozen=True)
class Motions:
    """What came out, the start included.

    Attributes:
        time: shape (k,) [s].
        u: observed displacements, shape (k, n_observed) [m].
        v: observed velocities likewise [m/s].
        impact_time: end of the step with the impulse, shape (n_impacts,) [s].
        impact_pair: pair that is pushed.
        impulse: [N s].
        rate_pre: gap rates before the impulse [m/s].
        impact_energy: change of energy at the instant, of all pairs hit then [J].
        state: (u, v) of all dofs at the end, shape (2, n).
        frames: the same after each step, shape (k - 1, 2, n), if asked for.
        ledger: rows of `recorder.LEDGER`, one per stretch of the run.
        energy_residual: relative residual of the ledger.
    """

    time: FloatArray
    u: FloatArray
    v: FloatArray
    impact_time: FloatArray
    impact_pair: npt.NDArray[np.int64]
    impulse: FloatArray
    rate_pre: FloatArray
    impact_energy: FloatArray
    state: FloatArray
    frames: FloatArray
    ledger: FloatArray
    energy_residual: float


def at_rest(times: FloatArray) -> FloatArray:
    """Return the states of a base that does not move."""
    return np.zeros((times.size, 3))


def simulate(
    operators: Operators,
    law: Law,
    initial: tuple[FloatArray, FloatArray],
    *,
    time_step: float,
    n_steps: int,
    motion: Motion = at_rest,
    keep_frames: bool = False,
) -> Motions:
    """Run a problem from its initial displacements and velocities, in one stretch."""
    solution = solve(
        operators,
        law.contact,
        law.scheme,
        Prescribed(motion),
        time_step=time_step,
        steps_per_period=n_steps,
        periods=1,
        refinement=Refinement(law.refine),
        frames_per_period=n_steps if keep_frames else 0,
        limit=UNBOUNDED,
        initial=State(
            np.array([*initial, np.zeros(operators.n_dofs)]),
            np.zeros(operators.n_pairs, dtype=np.bool_),
        ),
        engine="petsc",
    )
    assert solution.outcome == "completed"
    recorder, times, state = solution.recorder, solution.time, solution.state.motion[:2]
    (record,) = recorder.window
    jumps = record.jumps.columns()
    of_each = np.array([jumps.ticks * time_step / law.refine, jumps.energies])
    when, energy = np.repeat(of_each, jumps.sizes, axis=1)
    table = np.array([when, jumps.hit, jumps.impulses, jumps.rate_pre, energy])
    return Motions(
        times,
        record.u[:, N_BASE:],
        record.v,
        table[0],
        table[1].astype(np.int64),
        table[2],
        table[3],
        table[4],
        state,
        np.array(record.frames),
        recorder.ledger,
        recorder.energy_residual(),
    )


def ball(mass: float, damping: float = 0.0) -> Operators:
    """Return a mass above a floor, u its height, which a base with q'' = g loads by its weight.

    Args:
        mass: [kg].
        damping: of the motion relative to the ground [N s/m].
    """
    m = np.array([mass])
    return Operators(
        mass=sp.csr_matrix([[mass]]),
        damping=sp.csr_matrix([[damping]]),
        stiffness=sp.csr_matrix([[0.0]]),
        lumped_mass=m,
        base=BaseCoupling(m, np.zeros(1), np.zeros(1)),
        gap_matrix=sp.csr_matrix([[1.0]]),
        gap0=np.zeros(1),
        probes=sp.csr_matrix([[1.0]]),
    )


def gravity(g: float) -> Motion:
    """Return base states that load each mass m of the base column by -m g and do nothing else."""
    return lambda times: np.tile([0.0, 0.0, g], (times.size, 1))


@dataclass(frozen=True)
class Bar:
    """An elastic bar that flies lengthwise against a wall at x = 0.

    Attributes:
        young_modulus: E [Pa].
        area: S [m2].
        density: ρ [kg/m3].
        length: L [m].
        gap: distance from the wall at t = 0 [m].
        speed: towards the wall [m/s].
    """

    young_modulus: float
    area: float
    density: float
    length: float
    gap: float
    speed: float

    @property
    def wave_speed(self) -> float:
        """Speed of longitudinal waves c [m/s]."""
        return float(np.sqrt(self.young_modulus / self.density))

    @property
    def contact_start(self) -> float:
        """When the bar touches the wall [s]."""
        return self.gap / self.speed

    @property
    def contact_duration(self) -> float:
        """How long a wave takes to the free end and back [s]."""
        return 2.0 * self.length / self.wave_speed

    @property
    def contact_force(self) -> float:
        """Force on the wall during contact, ρ c S v [N]."""
        return self.density * self.wave_speed * self.area * self.speed

    def displacement(self, x: FloatArray, times: FloatArray) -> FloatArray:
        """Return d'Alembert's solution, shape (n_times, n_points) [m].

        The front of compression leaves the wall with contact and stops each section it meets; from
        the free end it comes back as a release, and throws each section upwards with the speed of
        the fall. When it reaches the wall, the bar is undeformed and leaves it for ever.

        Args:
            x: distance of the sections from the wall's end of the bar, shape (n_points,) [m].
            times: shape (n_times,) [s].
        """
        since = np.asarray(times)[:, None] - self.contact_start
        stopped, thrown = x / self.wave_speed, (2.0 * self.length - x) / self.wave_speed
        fallen = np.minimum(since, stopped) + self.contact_start
        return np.asarray(self.speed * (np.maximum(since - thrown, 0.0) - fallen))

    def operators(self, n: int, *, consistent: bool = False) -> Operators:
        """Return n linear elements; dof 0 meets the wall.

        Args:
            n: number of elements.
            consistent: take the mass matrix of the form, not the lumped one.
        """
        h = self.length / n
        k = self.young_modulus * self.area / h
        main = np.full(n + 1, 2.0 * k)
        main[[0, -1]] = k
        off = np.full(n, -k)
        m = np.full(n + 1, self.density * self.area * h)
        m[[0, -1]] /= 2.0
        sixth = np.full(n, self.density * self.area * h / 6.0)
        full = sp.diags([sixth, 2.0 / 3.0 * m, sixth], [-1, 0, 1], format="csr")
        return Operators(
            mass=full if consistent else sp.diags(m, format="csr"),
            damping=sp.csr_matrix((n + 1, n + 1)),
            stiffness=sp.diags([off, main, off], [-1, 0, 1], format="csr"),
            lumped_mass=m,
            base=BaseCoupling.none(n + 1),
            gap_matrix=sp.csr_matrix(([1.0], ([0], [0])), shape=(1, n + 1)),
            gap0=np.array([self.gap]),
            probes=sp.identity(n + 1, format="csr"),
        )

    def flying(self, n: int) -> tuple[FloatArray, FloatArray]:
        """Return displacements and velocities at t = 0."""
        return np.zeros(n + 1), np.full(n + 1, -self.speed)


@dataclass(frozen=True)
class HeavyBeam:
    """A beam on a rigid floor whose end x = 0 is lifted; its slope there is free.

    Attributes:
        flexural_rigidity: EI [N m2].
        mass_per_length: ρA [kg/m].
        length: [m].
        gravity: [m/s2].
    """

    flexural_rigidity: float
    mass_per_length: float
    length: float
    gravity: float

    @property
    def weight(self) -> float:
        """Weight per length q [N/m]."""
        return self.mass_per_length * self.gravity

    def lifted_length(self, lift: float) -> float:
        """Return (24 EI δ / q)^(1/4), the length that leaves the floor [m]."""
        return float((24.0 * self.flexural_rigidity * lift / self.weight) ** 0.25)

    def operators(self, n: int, damping_rate: float) -> Operators:
        """Return n Hermite elements, damped by C = α M; node 0 is lifted by the base displacement.

        The accelerations in the base states load the beam by gravity. That leaves the lift and
        the weight independent of one another, as they are in a lift that accelerates.

        Args:
            n: number of elements.
            damping_rate: α [1/s].
        """
        h = np.full(n, self.length / n)
        M = sum_elements(element_mass(np.full(n, self.mass_per_length), h))
        K = sum_elements(element_stiffness(np.full(n, self.flexural_rigidity), h))
        free = slice(1, None)
        mass = sp.csr_matrix(M[free, free])
        upward = np.zeros(2 * n + 2)
        upward[::2] = 1.0
        size = 2 * n + 1
        pairs = np.arange(n)  # nodes 1..n; u of node j is free dof 2 j - 1
        return Operators(
            mass=mass,
            damping=damping_rate * mass,
            stiffness=sp.csr_matrix(K[free, free]),
            lumped_mass=np.asarray(abs(mass).sum(axis=1)).ravel(),
            base=BaseCoupling((M @ upward)[free], np.zeros(size), K[free, 0].toarray().ravel()),
            gap_matrix=sp.csr_matrix((np.ones(n), (pairs, 2 * pairs + 1)), shape=(n, size)),
            gap0=np.full(n, -SEATED),
            probes=sp.identity(size, format="csr"),
        )
