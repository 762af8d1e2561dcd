"""Shooting: exact on a map that is known, and in modes."""

import numpy as np
import pytest
from massless import massless

from delam_fem.api import FloatArray
from delam_fem.studies.orbits.maps import MapInfo, ModalMap, PeriodMap, SlowCoordinates, Trajectory
from delam_fem.studies.orbits.newton import Powered, derivative_at, shoot


class Known:
    """A map with the fixed point (λ, 2, 3), the multipliers -1.5, 0.9 and a fast rest of 0.2."""

    slow = SlowCoordinates(np.eye(3)[:, :2], np.eye(3)[:2])
    info = MapInfo("known", {"x": 3})

    def after(
        self, states: FloatArray, parameter: float, shifts: FloatArray | None = None
    ) -> FloatArray:
        off = states - np.array([parameter, 2.0, 3.0])
        bent = np.stack([0.1 * off[:, 1] ** 2, 0.0 * off[:, 0], 0.3 * off[:, 0]], axis=1)
        return np.asarray(off * [-1.5, 0.9, 0.2] + bent + [parameter, 2.0, 3.0])

    def trajectory(self, state: FloatArray, parameter: float, periods: int) -> Trajectory:
        raise NotImplementedError


def away(map_: PeriodMap, state: FloatArray, parameter: float) -> float:
    """Return the change of the slow coordinates in a period, relative to their norm."""
    y, after = (map_.slow.of(point) for point in (state, map_.after(state[None], parameter)[0]))
    return float(np.linalg.norm(after - y) / np.linalg.norm(y))


def of_kicks(map_: PeriodMap, state: FloatArray, parameter: float) -> np.ndarray:
    """Return the multipliers by kicks of 3 %, by decreasing modulus."""
    size = 0.03 * float(np.linalg.norm(map_.slow.of(state)))
    values = np.linalg.eigvals(derivative_at(Powered(map_, parameter), state, size))
    return values[np.argsort(-np.abs(values))]


def test_an_unstable_orbit_is_found_with_its_multipliers() -> None:
    state = shoot(Known(), np.array([1.2, 1.9, 2.0]), 1.0)
    assert away(Known(), state, 1.0) < 2e-11
    np.testing.assert_allclose(state[:2], [1.0, 2.0], atol=1e-9)
    np.testing.assert_allclose(of_kicks(Known(), state, 1.0), [-1.5, 0.9], atol=1e-9)


def test_a_motion_that_diverges_is_said() -> None:
    with pytest.raises(ArithmeticError, match="diverges"):
        shoot(Known(), np.array([np.nan, 1.0, 1.0]), 1.0)


@pytest.mark.nightly
def test_shooting_is_exact_where_the_document_says_so() -> None:
    """docs/evidence/massless.md: 8 modes, r = 64, from 3.25 over 3.35 to 3.45 Hz."""
    strobe = ModalMap(massless(8))
    states = np.zeros((1, strobe.slow.basis.shape[0]))
    for _ in range(200):
        states = strobe.after(states, 3.25)
    (state,) = states
    for frequency in (3.25, 3.35, 3.45):
        state = shoot(strobe, state, frequency)
    assert away(strobe, state, frequency) < 1e-9
    largest = of_kicks(strobe, state, frequency)[0]
    assert largest.real == pytest.approx(-0.10, abs=0.03)
    assert abs(largest.imag) == pytest.approx(0.82, abs=0.03)
