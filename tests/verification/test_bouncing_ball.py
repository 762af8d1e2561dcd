"""The ball that bounces to rest: impact times, Zeno time, and what each law does with rest.

Dropped from the height h it lands at t_1 = sqrt(2h/g) with v_1 = g t_1 and bounces at

    t_(k+1) = t_k + 2 e^k v_1 / g,   t_∞ = t_1 + 2 v_1 e / (g (1 - e))                     (B1)

Average acceleration is exact for constant acceleration, the impacts alone are as late as the grid
makes them.
"""

import numpy as np
import pytest
from problems import Law, Motions, ball, gravity, simulate

from delam_fem.api import FloatArray

G = 8.0
"""A power of two: with dyadic times every number of the test on the grid is exact in float64."""
ROUND_OFF = 1e-12
SPRING = 4.0e6
"""Contact stiffness [N/m]; the ball of 1 kg sinks in by 2e-6 m at rest."""
REFINEMENT = (181, 293, 467, 761, 1217, 1949)
"""Steps per t_1, primes."""
ORDER = 0.25
"""Window around order 1. Each impact is late by its own fraction of a step, which scatters the
error by as much as itself; the order is the slope of a line through all Δt of the refinement."""
RESOLVED = 20.0
"""Flights of so many steps are compared one by one."""
END = 50.0
"""Steps by which the end of the bouncing may be off: one for each of some twenty bounces, and as
many until speeds are below 2 g Δt. Measured: 40 with e = 0.7, 12 with e = 0.3."""
SETTLED = 200.0
"""Steps after which the speed g Δt has shrunk by e a step to nothing."""


def drop(law: Law, t1: float, *, dt: float, duration: float, damping: float = 0.0) -> Motions:
    """Drop a ball of 1 kg so that it lands at t1."""
    height = 0.5 * G * t1**2
    return simulate(
        ball(1.0, damping),
        law,
        (np.array([height]), np.zeros(1)),
        time_step=dt,
        n_steps=round(duration / dt),
        motion=gravity(G),
    )


def exact_times(t1: float, e: float, count: int) -> FloatArray:
    """Return the first impact times [s], B1."""
    flights = np.concatenate([[t1], 2.0 * t1 * e ** np.arange(1, count)])
    return np.cumsum(flights)


def zeno_time(t1: float, e: float) -> float:
    """Return when the bouncing ends [s], B1."""
    return t1 + 2.0 * t1 * e / (1.0 - e)


def test_impacts_on_the_grid_are_exact() -> None:
    """With e = 1/2 and t_1 = 1 all bounces that last a step or more end on a grid of 2^-k."""
    level = 10
    dt, e, t1 = 2.0**-level, 0.5, 1.0
    motions = drop(Law("newton", e), t1, dt=dt, duration=3.5)
    times = exact_times(t1, e, level + 1)
    assert np.array_equal(motions.impact_time[: level + 1], times)
    assert np.array_equal(-motions.rate_pre[: level + 1], G * t1 * e ** np.arange(level + 1))
    assert zeno_time(t1, e) == 3.0
    # B1 for the bounces that are too short for the grid
    assert times[-1] + (times[-1] - times[-2]) * e / (1.0 - e) == 3.0


@pytest.mark.parametrize(
    ("name", "e"), [("newton", 0.7), ("newton@moreau-jean", 0.7), ("newton@moreau-jean", 0.3)]
)
def test_bouncing_ends_at_the_zeno_time(name: str, e: float) -> None:
    t1 = 0.5
    errors = []
    for n in REFINEMENT:
        dt = t1 / n * (1.0 - 0.3 / n)  # off the grid of the exact times
        motions = drop(Law(name, e), t1, dt=dt, duration=1.3 * zeno_time(t1, e))
        count = np.count_nonzero(2.0 * t1 * e ** np.arange(40) > RESOLVED * dt)
        late = motions.impact_time[:count] - exact_times(t1, e, count)
        assert np.all(np.abs(late) < np.arange(1, count + 1) * dt), "a step per bounce"
        bounces = np.flatnonzero(np.abs(motions.v[:, 0]) > 2.0 * G * dt)
        errors.append(abs(motions.time[bounces[-1]] - zeno_time(t1, e)))
        assert errors[-1] < END * dt
    order = np.polyfit(np.log(1.0 / np.array(REFINEMENT)), np.log(errors), 1)[0]
    assert order == pytest.approx(1.0, abs=ORDER)


def test_moreau_rests_on_the_floor() -> None:
    t1, e, dt = 0.5, 0.7, 1e-3
    motions = drop(Law("newton@moreau-jean", e), t1, dt=dt, duration=4.0)
    resting = motions.time > zeno_time(t1, e) + SETTLED * dt
    assert np.abs(motions.v[resting]).max() < ROUND_OFF
    assert np.ptp(motions.u[resting]) < ROUND_OFF
    assert np.abs(motions.u[resting]).max() < G * dt**2
    weight = motions.impulse[motions.impact_time > motions.time[resting][0]] / dt
    assert weight == pytest.approx(G, rel=1e-9), "mean contact force of a step"


def test_newton_sinks_slowly() -> None:
    """Without impulses within a step an impact a step holds the speed, not the place.

    Each step starts with e w and ends with w = -g Δt/(1 + e); their mean is the speed of sinking.
    """
    t1, e, dt = 0.5, 0.7, 1e-3
    motions = drop(Law("newton", e), t1, dt=dt, duration=4.0)
    resting = motions.time > zeno_time(t1, e) + SETTLED * dt
    sinking = np.diff(motions.u[resting, 0]) / dt
    assert sinking == pytest.approx(-0.5 * (1.0 - e) / (1.0 + e) * G * dt, rel=1e-6)
    assert -motions.rate_pre[-100:] == pytest.approx(G * dt / (1.0 + e), rel=1e-6)


def test_newton_penalty_rests_on_its_spring() -> None:
    """Below the threshold the ball swings about -m g/k; a little damping brings it to rest."""
    t1, e, dt = 0.5, 0.7, 1e-3
    law = Law("newton-penalty", e, (SPRING, 0.0), threshold_velocity=5e-3)
    motions = drop(law, t1, dt=dt, duration=4.0)
    resting = motions.time > zeno_time(t1, e) + SETTLED * dt
    assert motions.impact_time[-1] < motions.time[resting][0], "no more impacts"
    assert motions.u[resting].mean() == pytest.approx(-G / SPRING, rel=0.05), "mean of a swing"
    damped = drop(law, t1, dt=dt, duration=4.0, damping=20.0)
    assert damped.u[-1, 0] == pytest.approx(-G / SPRING, rel=5e-3), "what is left of it"


@pytest.mark.parametrize("name", ["newton", "newton@moreau-jean"])
def test_energy_of_each_impact(name: str) -> None:
    e = 0.7
    motions = drop(Law(name, e), 0.5, dt=1e-3, duration=2.5)
    assert motions.impulse.size > 3
    expected = -0.5 * (1.0 - e**2) * motions.rate_pre**2
    if (
        name == "newton@moreau-jean"
    ):  # the impulse also stops the weight, whose work the step has counted
        expected += 0.5 * (1.0 - e) * motions.rate_pre * G * motions.time[1]
    assert motions.impact_energy == pytest.approx(expected, rel=ROUND_OFF)
    assert motions.energy_residual < ROUND_OFF
