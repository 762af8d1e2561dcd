"""The exact step of a mode: against the matrix exponential, quadrature and the energy balance."""

import numpy as np
import pytest
from scipy.linalg import expm

from delam_fem.engines.massless import exact_step

OMEGA = 2.0 * np.pi * np.array([1.4, 3.2, 500.0, 3400.0])
RATIOS = np.array([0.0, 0.008, 1.0, 3.0])  # undamped, light, critical, overdamped
X = np.array([1e-3, 2e-2, -0.3, 0.01])  # q0, v0, F0, ΔF


def system(omega: float, damping: float, length: float) -> np.ndarray:
    """Return the matrix of (q, v/ω, F/ω², ΔF/ω²), in which all entries are alike."""
    w = omega
    return np.array(
        [[0, w, 0, 0], [-w, -damping, w, 0], [0, 0, 0, 1.0 / length], [0, 0, 0, 0]], dtype=float
    )


@pytest.mark.parametrize("length", [3e-4, 4.7e-6])
def test_motion_is_the_matrix_exponential(length: float) -> None:
    damping = 2.0 * RATIOS * OMEGA
    move, _ = exact_step(OMEGA**2, damping, length)
    for j, w in enumerate(OMEGA):
        E = expm(length * system(w, damping[j], length))
        units = np.array([1.0, 1.0 / w, 1.0 / w**2, 1.0 / w**2])
        E = E * units / units[:, None]
        expected = [E[0, 0], E[0, 1], E[1, 0], E[1, 1], E[0, 2], E[1, 2], E[0, 3], E[1, 3]]
        np.testing.assert_allclose(move[:, j], expected, rtol=1e-9, atol=1e-12)


def test_damping_loss_is_the_integral_of_power() -> None:
    length = 3e-4
    damping = 2.0 * RATIOS * OMEGA
    _, loss = exact_step(OMEGA**2, damping, length)
    places, weights = np.polynomial.legendre.leggauss(200)
    rows, columns = np.triu_indices(4)
    for j in (0, 1, 2, 3):
        total = 0.0
        for place, weight in zip(0.5 * (places + 1.0), 0.5 * weights, strict=True):
            part, _ = exact_step(OMEGA[j : j + 1] ** 2, damping[j : j + 1], place * length)
            inner = X * np.array([1.0, 1.0, 1.0, place])  # the load's rise up to there
            v = part[[2, 3, 5, 7], 0] @ inner
            total += weight * length * damping[j] * v * v
        computed_loss = float((loss[:, j] * X[rows] * X[columns]).sum())
        assert computed_loss == pytest.approx(total, rel=1e-8, abs=1e-18)
