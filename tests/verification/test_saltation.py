"""Event-driven monodromy against published and closed-form multipliers, and finite differences."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from saltation import StoppedSystem, exact_orbit
from scipy.optimize import brentq

from delam_fem.api import FloatArray

EXACT = 1e-8
DOUBLING = 1e-9
"""In ω: of the doubling found from the monodromy against the closed form."""


def oscillator(omega: float, s: float, e: float) -> StoppedSystem:
    """Return x'' + x = cos ωt, x <= s."""
    one, zero = np.eye(1), np.zeros((1, 1))
    row = np.array([-1.0])
    return StoppedSystem((one, zero, one), np.ones(1, complex), omega, (row, s), restitution=e)


def one_impact(omega: float, s: float, e: float) -> tuple[float, float]:
    """Return the speed V and the phase ωt of the orbit with one impact a period, in closed form.

    a = s - G cos φ and b = -e V + ωG sin φ of the flight x = a cos t + b sin t + G cos(ωt + φ);
    x(T) = s gives a (C - 1) + b S = 0, x'(T) = V gives V (1 + e) = -a S + b (C - 1).
    """
    T, G = 2.0 * np.pi / omega, 1.0 / (1.0 - omega**2)
    cot = 1.0 / np.tan(T / 2.0)
    # [s + (1 + e) V c / 2]² + [(1 - e) V / (2 ω)]² = G²
    A = ((1.0 + e) * cot / 2.0) ** 2 + ((1.0 - e) / (2.0 * omega)) ** 2
    B = s * (1.0 + e) * cot
    V = (-B + np.sqrt(B**2 - 4.0 * A * (s**2 - G**2))) / (2.0 * A)
    cos = (s + (1.0 + e) * V * cot / 2.0) / G
    sin = -(1.0 - e) * V / (2.0 * omega * G)
    return float(V), float(np.arctan2(sin, cos))


def closed_form(omega: float, s: float, e: float) -> FloatArray:
    """Return the multipliers of that orbit: eigenvalues of [[C, S], [-S, C]] [[-e, 0], [p, -e]]."""
    V, phase = one_impact(omega, s, e)
    p = (1.0 + e) * (np.cos(phase) - s) / V
    T = 2.0 * np.pi / omega
    C, S = np.cos(T), np.sin(T)
    return np.asarray(np.linalg.eigvals(np.array([[C, S], [-S, C]]) @ [[-e, 0.0], [p, -e]]))


def start(omega: float, s: float, e: float, elapsed: float = 0.3) -> FloatArray:
    """Return the state of the closed form orbit at t = 0, a while after an impact at φ."""
    V, phase = one_impact(omega, s, e)
    G = 1.0 / (1.0 - omega**2)
    a, b = s - G * np.cos(phase), -e * V + omega * G * np.sin(phase)
    t = (-phase / omega) % (2.0 * np.pi / omega)
    return np.array(
        [
            a * np.cos(t) + b * np.sin(t) + G * np.cos(omega * t + phase),
            -a * np.sin(t) + b * np.cos(t) - omega * G * np.sin(omega * t + phase),
        ]
    )


def sorted_complex(values: npt.NDArray[Any]) -> npt.NDArray[Any]:
    return np.asarray(sorted(values, key=lambda mu: (round(mu.real, 6), mu.imag)))


@pytest.mark.parametrize(
    ("omega", "s", "e", "expected"),
    [
        (2.0, 0.0, 0.5, (0.5, 0.5)),
        (2.2, 0.0, 0.5, (0.3923 - 0.3101j, 0.3923 + 0.3101j)),
        (2.6, 0.0, 0.8, (-0.5745 - 0.5567j, -0.5745 + 0.5567j)),
    ],
)
def test_multipliers_of_the_impact_oscillator(
    omega: float, s: float, e: float, expected: tuple[complex, complex]
) -> None:
    state, journey = exact_orbit(oscillator(omega, s, e), start(omega, s, e) + 0.01)
    assert len(journey.times) == 1
    assert journey.state == pytest.approx(state, abs=1e-12)
    assert -journey.speeds[0] == pytest.approx(one_impact(omega, s, e)[0], rel=1e-11)
    exact = closed_form(omega, s, e)
    # the double eigenvalue ½ splits by the root of round-off: its sum and product do not
    D = journey.derivative
    assert np.trace(D) == pytest.approx(exact.sum().real, abs=EXACT)
    assert np.linalg.det(D) == pytest.approx(e**2, abs=EXACT)
    mu = sorted_complex(np.linalg.eigvals(D))
    if omega != 2.0:
        assert mu == pytest.approx(sorted_complex(exact), abs=EXACT)
    assert mu == pytest.approx(np.array(expected), abs=1e-4)


def test_the_derivative_is_that_of_the_motion() -> None:
    """Two coupled damped modes with several impacts, against central differences."""
    M = np.array([[2.0, 0.3], [0.3, 1.0]])
    K = np.array([[5.0, -1.0], [-1.0, 30.0]])
    system = StoppedSystem(
        (M, 0.02 * K, K), np.array([1.0 + 0.2j, 0.4]), 2.3, (np.array([-1.0, 0.6]), 0.05),
        restitution=0.6,
    )  # fmt: skip
    state = np.array([-0.1, 0.02, 0.3, -0.2])
    journey = system.journey(state, 0.4, 2.0 * system.period)
    assert len(journey.times) >= 3 and min(-v for v in journey.speeds) > 0.01
    h = 1e-6
    columns = [
        (
            system.journey(state + h * d, 0.4, 2.0 * system.period).state
            - system.journey(state - h * d, 0.4, 2.0 * system.period).state
        )
        / (2.0 * h)
        for d in np.eye(4)
    ]
    assert journey.derivative == pytest.approx(np.array(columns).T, rel=1e-4, abs=1e-5)


def test_the_period_doubling_of_the_impact_oscillator() -> None:
    """1 + trace + e² = 0 of the closed form, and -1 as a multiplier of the monodromy."""
    e = 0.8

    def by_formula(omega: float) -> float:
        return float(1.0 + closed_form(omega, 0.0, e).sum().real + e**2)

    def by_monodromy(omega: float) -> float:
        _, journey = exact_orbit(oscillator(omega, 0.0, e), start(omega, 0.0, e))
        return float(np.linalg.det(journey.derivative + np.eye(2)))

    exact = brentq(by_formula, 2.55, 2.75, xtol=1e-13)
    assert brentq(by_monodromy, 2.55, 2.75, xtol=1e-13) == pytest.approx(exact, abs=DOUBLING)
    assert exact == pytest.approx(2.6532, abs=1e-3)


def test_a_near_miss_is_reported() -> None:
    """A free oscillator that swings to 0.99 under a stop at 1 misses it by 0.01."""
    one, zero = np.eye(1), np.zeros((1, 1))
    system = StoppedSystem(
        (one, zero, one), np.zeros(1, complex), 1.3, (np.array([-1.0]), 1.0), restitution=0.5
    )
    journey = system.journey(np.array([0.99, 0.0]), 0.0, 10.0)
    assert journey.times == ()
    assert journey.nearest_miss == pytest.approx(0.01, rel=1e-9)
    journey = system.journey(np.array([0.0, 1.0 + 1e-9]), 0.0, 4.0)
    assert len(journey.times) == 1 and abs(journey.speeds[0]) < 1e-4


def test_chattering_is_refused() -> None:
    """A mass that is pressed against the stop hits it without end."""
    one, zero = np.eye(1), np.zeros((1, 1))
    system = StoppedSystem(
        (one, zero, one), np.zeros(1, complex), 1.3, (np.array([-1.0]), -0.5), restitution=0.9
    )
    with pytest.raises(ArithmeticError, match="chatters"):
        system.journey(np.array([-1.0, 0.0]), 0.0, 100.0)
