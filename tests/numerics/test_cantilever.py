"""The exact cantilever."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from delam_fem.numerics.beams import (
    cantilever_mode,
    cantilever_roots,
    frequency_rise,
    transmissibility,
)

ROUND_OFF = 1e-12  # a few hundred roundings at B = 60
QUADRATURE = 1e-9  # 200 Gauss points integrate ten half waves to round-off of the mode itself
PERIOD = 1e-6  # of the frequency: tolerance of the integration, and second differences of the mode


def test_roots_equal_tabulated_values() -> None:
    # Blevins, "Formulas for Natural Frequency and Mode Shape", table 8-1, all printed digits.
    tabulated = [1.87510407, 4.69409113, 7.85475744, 10.99554073, 14.13716839]
    np.testing.assert_allclose(cantilever_roots(5), tabulated, atol=5e-9)


def test_roots_solve_the_equation_up_to_high_modes() -> None:
    B = cantilever_roots(40)
    assert np.all(np.diff(B) > 2.8)
    np.testing.assert_allclose(np.cos(B) + 1.0 / np.cosh(B), 0.0, atol=ROUND_OFF)


@pytest.mark.parametrize("k", [1, 2, 3])
def test_mode_equals_textbook_form(k: int) -> None:
    B, xi = cantilever_roots(k)[-1], np.linspace(0.0, 1.0, 21)
    s = (np.sinh(B) - np.sin(B)) / (np.cosh(B) + np.cos(B))
    z = B * xi
    textbook = np.cosh(z) - np.cos(z) - s * (np.sinh(z) - np.sin(z))
    np.testing.assert_allclose(cantilever_mode(k, xi), textbook / textbook[-1], atol=ROUND_OFF)


def test_modes_are_orthogonal_up_to_the_tenth() -> None:
    points, weights = np.polynomial.legendre.leggauss(200)
    modes = np.array([cantilever_mode(k, 0.5 * (points + 1.0)) for k in range(1, 11)])
    gram = (modes * 0.5 * weights) @ modes.T
    np.testing.assert_allclose(gram, 0.25 * np.eye(10), atol=QUADRATURE)


@pytest.mark.parametrize("k", [1, 12, 60])
def test_mode_is_clamped_and_one_at_the_tip(k: int) -> None:
    near = 1e-7
    w = cantilever_mode(k, [0.0, near, 1.0])
    assert abs(w[0]) < ROUND_OFF
    assert abs(w[1]) < (near * 200.0) ** 2  # no slope: w ~ (B xi)^2, B < 200
    assert w[2] == pytest.approx(1.0, abs=ROUND_OFF)


def test_transmissibility_solves_the_boundary_value_problem() -> None:
    # w = a cosh z + b sinh z + c cos z + d sin z with w(0) = 1, w'(0) = 0, w''(L) = w'''(L) = 0.
    B = 2.0
    omega = B**2 * np.sqrt(1.5 / (0.2 * 0.7**4))
    ch, sh, co, si = np.cosh(B), np.sinh(B), np.cos(B), np.sin(B)
    conditions = np.array([[1, 0, 1, 0], [0, 1, 0, 1], [ch, sh, -co, -si], [sh, ch, si, -co]])
    factors = np.linalg.solve(conditions, [1.0, 0.0, 0.0, 0.0])
    H = transmissibility(omega, length=0.7, flexural_rigidity=1.5, mass_per_length=0.2)
    assert H == pytest.approx(factors @ [ch, sh, co, si], rel=ROUND_OFF)


def test_damping_limits_the_resonance_and_delays_the_tip() -> None:
    omega = cantilever_roots(1)[0] ** 2  # unit length, EI and rho A
    D = 0.008
    beam = {"length": 1.0, "flexural_rigidity": 1.0, "mass_per_length": 1.0}
    H = transmissibility(omega, **beam, rayleigh=(2 * D * omega, 0.0))
    # One mode of participation 2 int w / int w^2... = 1.566 at the tip: |H| = 1.566 / (2 D).
    assert abs(H) == pytest.approx(1.566 / (2 * D), rel=0.01)
    assert np.angle(H) == pytest.approx(-np.pi / 2, abs=0.05)


def test_transmissibility_without_frequency_is_one() -> None:
    beam = {"length": 1.0, "flexural_rigidity": 1.0, "mass_per_length": 1.0}
    assert transmissibility(1e-3, **beam) == pytest.approx(1.0, abs=1e-6)


def test_no_roots_are_refused() -> None:
    with pytest.raises(ValueError, match="expected at least 1, given 0"):
        cantilever_roots(0)


def test_positions_beyond_the_tip_are_refused() -> None:
    with pytest.raises(ValueError, match=r"must lie in \[0, 1\]"):
        cantilever_mode(1, [0.5, 1.1])


@pytest.mark.parametrize("amplitude", [0.1, 0.36])
def test_frequency_rise_is_that_of_the_equation_of_motion(amplitude: float) -> None:
    B = cantilever_roots(1)[0]
    s = (np.sinh(B) - np.sin(B)) / (np.cosh(B) + np.cos(B))
    points, weights = np.polynomial.legendre.leggauss(60)
    x, w = 0.5 * (points + 1.0), 0.5 * weights

    def slope(z: np.ndarray) -> np.ndarray:
        return 0.5 * B * (np.sinh(z) + np.sin(z) - s * (np.cosh(z) - np.cos(z)))

    z = B * x
    bend = 0.5 * B**2 * (np.cosh(z) + np.cos(z) - s * (np.sinh(z) + np.sin(z)))
    shortening = np.array([end * (w @ slope(B * end * x) ** 2) for end in x])
    a = (w @ shortening**2) / (w @ cantilever_mode(1, x) ** 2)
    b = (w @ (bend * slope(z)) ** 2) / (w @ bend**2)
    # (1 + a q²) q'' + a q q'² + q + 2 b q³ = 0, in units of 1/ω_1; from rest until the velocity
    # is zero again: half a period

    def motion(_: float, y: np.ndarray) -> list[float]:
        q, v = y
        return [v, -(a * q * v**2 + q + 2.0 * b * q**3) / (1.0 + a * q**2)]

    def turns(_: float, y: np.ndarray) -> float:
        return float(y[1])

    turns.direction = 1.0  # type: ignore[attr-defined]
    run = solve_ivp(motion, (0.0, 4.0), [amplitude, 0.0], events=turns, rtol=1e-10, atol=1e-12)
    rise = frequency_rise(amplitude)
    assert rise > 0.0
    assert 1.0 + rise == pytest.approx(np.pi / run.t_events[0][-1], abs=PERIOD)
