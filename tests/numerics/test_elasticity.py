"""Orthotropic elasticity: turned layers, plane stress, laminates, beside printed formulas."""

import numpy as np
import pytest

from delam_fem.numerics.elasticity import (
    compliance,
    is_admissible,
    isotropic,
    laminate,
    stiffness,
    turned,
)

E1, E2, E3, G12, G13, G23 = 181e9, 10.3e9, 9e9, 7.17e9, 6e9, 3.5e9
NU12, NU13, NU23 = 0.28, 0.3, 0.42
LAYER = compliance((E1, E2, E3), (G12, G13, G23), (NU12, NU13, NU23))
ROUND_OFF = 1e-12


@pytest.mark.parametrize("angle", [-30.0, 25.0, 60.0, 130.0])
def test_turned_layers_have_the_compliances_of_jones(angle: float) -> None:
    """R. M. Jones, Mechanics of Composite Materials, 2nd ed. (1999), eqs. 2.95 and 2.97."""
    m, n = np.cos(np.deg2rad(angle)), np.sin(np.deg2rad(angle))
    S = turned(LAYER, angle)
    mixed = 1.0 / G12 - 2.0 * NU12 / E1
    assert S[0, 0] == pytest.approx(m**4 / E1 + n**4 / E2 + mixed * (m * n) ** 2)
    shear = 2.0 / E1 + 2.0 / E2 + 4.0 * NU12 / E1 - 1.0 / G12
    assert S[4, 4] == pytest.approx(2.0 * shear * (m * n) ** 2 + (m**4 + n**4) / G12)
    first = (2.0 / E1 + 2.0 * NU12 / E1 - 1.0 / G12) * n * m**3
    second = (2.0 / E2 + 2.0 * NU12 / E1 - 1.0 / G12) * n**3 * m
    assert S[0, 4] == pytest.approx(first - second)  # a turn from x towards z
    assert S[3, 3] == pytest.approx(m**2 / G13 + n**2 / G23)
    assert S[0, 1] == pytest.approx(-NU13 / E1 * m**2 - NU23 / E2 * n**2)


def test_a_quarter_turn_swaps_x_and_z_without_round_off() -> None:
    swap = [2, 1, 0, 5, 4, 3]
    np.testing.assert_array_equal(turned(LAYER, 90.0), LAYER[np.ix_(swap, swap)])
    np.testing.assert_array_equal(turned(LAYER, -90.0), turned(LAYER, 90.0))
    np.testing.assert_array_equal(turned(LAYER, 180.0), LAYER)


def test_an_isotropic_material_is_that_of_hooke_at_any_angle() -> None:
    E, nu = 70e9, 0.3
    S = compliance((E, E, E), [E / (2.0 + 2.0 * nu)] * 3, (nu, nu, nu))
    for angle in (0.0, 37.0):
        for dim in (2, 3):
            D = stiffness(turned(S, angle), dim) / E
            np.testing.assert_allclose(D, isotropic(dim, nu), atol=ROUND_OFF)


def test_plane_stress_has_no_stress_across() -> None:
    """The full law with the strains that make σ_zz, σ_xz and σ_yz vanish."""
    S = turned(LAYER, 20.0)
    across = [2, 4, 5]
    C = np.linalg.inv(S)
    strains = np.array([1e-3, -2e-3, 0.0, 5e-4, 0.0, 0.0])
    free = np.linalg.solve(C[np.ix_(across, across)], -C[across] @ strains)
    strains[across] = free
    sigma = C @ strains
    np.testing.assert_allclose(sigma[across], 0.0, atol=1e-6 * abs(sigma).max())
    in_plane = [0, 1, 3]
    np.testing.assert_allclose(stiffness(S, 2) @ strains[in_plane], sigma[in_plane], rtol=1e-9)


def test_what_has_no_positive_energy_is_found() -> None:
    equal = (1e9, 1e9, 1e9)
    assert is_admissible(compliance(equal, equal, (0.49, 0.49, 0.49)))
    assert not is_admissible(compliance(equal, equal, (0.51, 0.51, 0.51)))
    assert not is_admissible(compliance((10e9, 1e9, 1e9), equal, (3.2, 0.0, 0.0)))  # > √10
    assert is_admissible(compliance((10e9, 1e9, 1e9), equal, (3.1, 0.0, 0.0)))


def test_laminates_beside_laminate_theory_by_hand() -> None:
    h = 0.25e-3
    Q11, Q22, Q12 = np.array([E1, E2, NU12 * E2]) / (1.0 - NU12**2 * E2 / E1)
    cross = [turned(LAYER, angle) for angle in (0.0, 90.0, 90.0, 0.0)]
    matrix, stretching, bending = laminate(cross, [h] * 4)
    A11 = 2.0 * h * (Q11 + Q22)
    D11 = 2.0 / 3.0 * h**3 * (7.0 * Q11 + Q22)
    D22 = 2.0 / 3.0 * h**3 * (Q11 + 7.0 * Q22)
    D12 = 16.0 / 3.0 * h**3 * Q12
    assert matrix[0, 0] == pytest.approx(A11) and matrix[3, 3] == pytest.approx(D11)
    np.testing.assert_allclose(matrix[:3, 3:], 0.0, atol=1e-9 * A11 * h)
    assert bending == pytest.approx(D11 - D12**2 / D22)
    assert stretching == pytest.approx(A11 - (4.0 * h * Q12) ** 2 / A11)
    # two plies: B11 = (Q22 - Q11) h²/2 with the stiff one below
    matrix, _, bending = laminate(cross[:2], [h, h])
    assert matrix[0, 3] == pytest.approx(0.5 * h**2 * (Q22 - Q11))
    assert bending < 0.5 * matrix[3, 3]
