import numpy as np
import pytest
from scipy.integrate import solve_ivp

from delam_fem.numerics.oscillator import stationary, swept

NATURAL, D, PARTICIPATION = 2.0 * np.pi * 1.4357, 0.008, 1.566


def test_a_constant_frequency_gives_the_stationary_response() -> None:
    time = np.linspace(0.0, 400.0, 4001)
    omega = np.full_like(time, 2.0 * np.pi * 1.45)
    found = swept(time, omega, NATURAL, D, PARTICIPATION)[-1]
    assert found == pytest.approx(stationary(omega[:1], NATURAL, D, PARTICIPATION)[0], rel=1e-9)


def test_the_stationary_response_solves_the_equation_of_motion() -> None:
    omega = np.array([0.3, 1.0, 1.7])
    a = stationary(omega, 1.1, 0.05, 1.3)  # w'' + 2 D w0 w' + w0² w = Γ ω² for w = a e^{iωt}
    left = a * (-(omega**2) + 2j * 0.05 * 1.1 * omega + 1.1**2)
    np.testing.assert_allclose(left, 1.3 * omega**2, rtol=1e-14)


@pytest.mark.parametrize("start, end", [(1.3, 1.6), (1.6, 1.3)])
def test_a_swept_response_agrees_with_the_equation_of_motion(start: float, end: float) -> None:
    T = 100.0
    time = np.linspace(0.0, T, 2001)
    rate = 2.0 * np.pi * (end - start) / T

    def omega(t: np.ndarray) -> np.ndarray:
        return 2.0 * np.pi * start + rate * t

    def phase(t: np.ndarray) -> np.ndarray:
        return 2.0 * np.pi * start * t + 0.5 * rate * t**2

    def motion(t: float, y: np.ndarray) -> list[float]:
        base = -(omega(t) ** 2) * np.cos(phase(t)) - rate * np.sin(phase(t))
        return [y[1], -2.0 * D * NATURAL * y[1] - NATURAL**2 * y[0] - PARTICIPATION * base]

    exact = solve_ivp(motion, (0.0, T), [0.0, 0.0], t_eval=time, rtol=1e-9, atol=1e-9).y[0]
    amplitude = swept(time, omega(time), NATURAL, D, PARTICIPATION)
    found = (amplitude * np.exp(1j * phase(time))).real
    error = np.abs(found - exact)
    assert error.max() < 0.02 * np.abs(amplitude).max()  # the start of the quasi-static part
    assert error[time > 70.0].max() < 2e-4 * np.abs(amplitude).max()
