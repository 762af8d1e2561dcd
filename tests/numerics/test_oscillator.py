import numpy as np
import pytest
from scipy.integrate import solve_ivp

from delam_fem.numerics.harmonics import driven, pole

NATURAL, D = 2.0 * np.pi * 1.4357, 0.008


def test_the_pole_has_the_frequency_and_the_decay() -> None:
    root = pole(1.1, 0.05)
    assert root**2 + 2.0 * 0.05 * 1.1 * root + 1.1**2 == pytest.approx(0.0, abs=1e-15)
    assert root.real == pytest.approx(-0.055) and root.imag > 0.0


def test_a_constant_acceleration_ends_at_its_static_deflection() -> None:
    time = np.linspace(0.0, 200.0, 20001)
    w = 2.0 * driven(time, lambda t: np.full_like(t, 3.0), pole(NATURAL, D)).real
    assert w[-1] == pytest.approx(-3.0 / NATURAL**2, rel=1e-5)


@pytest.mark.parametrize(("start", "end"), [(1.3, 1.6), (1.6, 1.3)])
def test_a_swept_response_agrees_with_the_equation_of_motion(start: float, end: float) -> None:
    T = 40.0
    time = np.linspace(0.0, T, 4001)

    def acceleration(t: np.ndarray) -> np.ndarray:
        return np.sin(2.0 * np.pi * (start * t + 0.5 * (end - start) / T * t**2))

    def motion(t: float, y: np.ndarray) -> list[float]:
        return [y[1], -2.0 * D * NATURAL * y[1] - NATURAL**2 * y[0] - float(acceleration(t))]

    exact = solve_ivp(motion, (0.0, T), [0.0, 0.0], t_eval=time, rtol=1e-10, atol=1e-12).y[0]
    w = 2.0 * driven(time, acceleration, pole(NATURAL, D)).real
    assert np.abs(w - exact).max() < 1e-6 * np.abs(exact).max()
