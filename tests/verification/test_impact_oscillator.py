"""The periodically forced impact oscillator, whose motions with one impact per period are exact.

x'' + x = cos ωt, x <= s, x'⁺ = -e x'⁻. With T = 2π/ω, G = 1/(1 - ω²), c = cot(T/2) the impact speed
V solves

    [s + (1+e) V c/2]² + [(1-e) V/(2ω)]² = G²                                              (O1)

Both laws look at the gap once a step, so that an impact comes a fraction of a step late: V is wrong
in the first order of Δt, and 1e-6 itself would need millions of steps a period. But Δt divides T,
and the fraction by which the impact is late is the same in each period and, when the grid is
shifted in proportion to Δt, for each Δt. V is then smooth in Δt, and Richardson's extrapolation
gives the limit.
"""

import numpy as np
import pytest
from calibration.oscillator import forcing, impact_phase, orbit, oscillator
from problems import Law, Motions, simulate

from delam_fem.api import FloatArray

# ω, s, e, V; order of V in Δt. Where c = s = 0, V does not depend on s in the first order.
ROWS = [
    (2.0, 0.0, 0.5, 8.0 / 3.0, 2),
    (2.2, 0.0, 0.5, 1.6623393634, 1),
    (2.5, 0.0, 0.5, 0.7231174191, 1),
    (2.0, 0.1, 0.3, 1.8170270503, 1),
    (1.8, 0.2, 0.5, 2.9210441088, 1),
]
REFINEMENT = (50, 100, 200, 400, 800)
"""Steps per period."""
PERIODS = 60
"""After these, impact speeds of successive periods differ by less than `STEADY`."""
STEADY = 1e-3
"""Relative; the row ω = 2.2 swings by 0.98 of it from one period to the next, with changing sign,
and the mean of two impacts that is compared is better by two digits."""
EXTRAPOLATED = 1e-7
"""Relative; four extrapolations from the refinement study leave 7e-9, and V is given to 1e-10."""
ORDER = 0.08
"""Window around the order at the fine end of the refinement study."""
SLOPE = 1e-6
"""Phase difference for a numerical derivative [rad]."""


def steady_motion(
    law: Law, row: tuple[float, float], n: int, *, kick: float = 1.0, periods: int = PERIODS
) -> Motions:
    """Run near the orbit of (ω, s) with n steps per period; the first impact lies before t = 0.

    An impact that is late by r steps belongs to the orbit of the stop s + s' r Δt, s' = ds/dt along
    the family of orbits, and passes s by less than V Δt: r is put in the middle of that range. An
    impact of moreau takes place in the middle of its step.
    """
    (omega, s), e = row, law.restitution
    dt = 2.0 * np.pi / omega / n
    phase = impact_phase(omega, s, e)
    V = orbit(omega, e, phase)[0]
    slope = orbit(omega, e, phase + SLOPE)[1] - orbit(omega, e, phase - SLOPE)[1]
    late = 0.5 * V / (omega * slope / (2.0 * SLOPE))
    V, start = orbit(omega, e, phase + omega * late * dt)
    to_grid = 0.5 if law.name == "newton@moreau-jean" else 0.0
    motions = simulate(
        oscillator(s),
        law,
        (np.array([start]), np.array([-kick * e * V])),
        time_step=dt,
        n_steps=n * periods,
        motion=forcing(omega, phase + omega * (late + to_grid) * dt),
    )
    assert motions.energy_residual < 1e-12
    return motions


def speeds(motions: Motions) -> FloatArray:
    """Return the impact speeds."""
    return -motions.rate_pre


@pytest.mark.parametrize(("omega", "s", "e", "V", "order"), ROWS)
def test_orbit_fulfils_the_published_equation(
    omega: float, s: float, e: float, V: float, order: int
) -> None:
    assert orbit(omega, e, impact_phase(omega, s, e))[0] == pytest.approx(V, rel=1e-10)
    T, G = 2.0 * np.pi / omega, 1.0 / (1.0 - omega**2)
    stop = s + (1.0 + e) * V / np.tan(T / 2.0) / 2.0
    assert stop**2 + ((1.0 - e) * V / (2.0 * omega)) ** 2 == pytest.approx(G**2, rel=1e-9)


@pytest.mark.parametrize(
    ("name", "omega", "s", "e", "V", "order"),
    [  # each row by one of the methods, by turns; by both in the long form
        pytest.param(name, *row, marks=() if (i + k) % 2 == 0 else pytest.mark.nightly)
        for i, name in enumerate(["newton", "newton@moreau-jean"])
        for k, row in enumerate(ROWS)
    ],
)
def test_impact_speed(name: str, omega: float, s: float, e: float, V: float, order: int) -> None:
    law = Law(name, e)
    impact_speeds = []
    for n in REFINEMENT:
        motions = steady_motion(law, (omega, s), n)
        v = speeds(motions)
        steps = np.rint(motions.impact_time / motions.time[1]).astype(int)
        assert np.array_equal(steps, n * np.arange(1, PERIODS + 1)), "one impact per period"
        if n == REFINEMENT[-1]:
            assert abs(v[-1] - v[-2]) < STEADY * V
        impact_speeds.append(v[-2:].mean())
    errors = np.abs(np.array(impact_speeds) - V)
    assert np.log2(errors[-2] / errors[-1]) == pytest.approx(order, abs=ORDER)
    table = np.array(impact_speeds)
    for p in range(1, len(REFINEMENT)):
        table = (2**p * table[1:] - table[:-1]) / (2**p - 1)
    assert table[0] == pytest.approx(V, rel=EXTRAPOLATED)


@pytest.mark.parametrize("name", ["newton", "newton@moreau-jean"])
def test_orbit_attracts(name: str) -> None:
    """A start that is off by 5 % ends in the same motion."""
    omega, s, e = ROWS[2][:3]
    law = Law(name, e)
    n, many = 200, 3 * PERIODS
    v = speeds(steady_motion(law, (omega, s), n, periods=many))[-1]
    kicked = speeds(steady_motion(law, (omega, s), n, periods=many, kick=1.05))[-1]
    assert kicked == pytest.approx(v, rel=1e-5)
