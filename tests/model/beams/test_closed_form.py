"""Element and system matrices in closed form, from what they must do rather than from numbers."""

import numpy as np
import pytest
from numpy.polynomial import Polynomial

from delam_fem.api import Case, CaseError, Structure, preset
from delam_fem.model.beams.closed_form import (
    assemble,
    element_lumped_mass,
    element_mass,
    element_stiffness,
)

ROUND_OFF = 1e-12  # relative to the largest entry
H, EI, RHO_A = 0.37, 1.7, 0.23
GRADED = 0.685 * np.array([0.0, 0.05, 0.15, 0.4, 0.62, 1.0])


@pytest.fixture
def paper() -> Case:
    return preset("paper", {"mesh.elements": 5})


@pytest.fixture
def model(paper: Case) -> Structure:
    return assemble(paper, x=GRADED)


def hermite(h: float) -> list[Polynomial]:
    """Return the cubics with one of w(0), w'(0), w(h), w'(h) equal to 1 and the others 0."""
    powers = np.arange(4)
    at = [0.0**powers, np.eye(4)[1], h**powers, powers * h ** np.maximum(powers - 1.0, 0.0)]
    return [Polynomial(c) for c in np.linalg.inv(np.array(at)).T]


def integral(f: Polynomial, h: float) -> float:
    return float(f.integ()(h))


def test_element_matrices_equal_integrals_of_hermite_cubics() -> None:
    N = hermite(H)
    mass = [[RHO_A * integral(a * b, H) for b in N] for a in N]
    stiffness = [[EI * integral(a.deriv(2) * b.deriv(2), H) for b in N] for a in N]
    np.testing.assert_allclose(element_mass([RHO_A], [H])[0], mass, rtol=ROUND_OFF * 100)
    np.testing.assert_allclose(element_stiffness([EI], [H])[0], stiffness, rtol=ROUND_OFF * 100)


def test_element_rows_belong_to_their_own_element() -> None:
    h = np.array([0.1, 0.3])
    for function in (element_mass, element_stiffness, element_lumped_mass):
        both = function([1.0, 5.0], h)
        np.testing.assert_allclose(both[1], function([5.0], h[1:])[0], rtol=ROUND_OFF)


def test_rigid_motion_needs_no_force() -> None:
    K = element_stiffness([EI], [H])[0]
    for motion in ([1.0, 0.0, 1.0, 0.0], [0.0, 1.0, H, 1.0]):
        np.testing.assert_allclose(K @ motion, 0.0, atol=ROUND_OFF * np.abs(K).max())


def test_constant_curvature_needs_end_moments_alone() -> None:
    parabola = np.array([0.0, 0.0, H**2 / 2, H])  # w'' = 1
    forces = element_stiffness([EI], [H])[0] @ parabola
    np.testing.assert_allclose(forces, [0.0, -EI, 0.0, EI], atol=ROUND_OFF * EI / H**3)


def test_element_mass_has_the_mass_and_inertia_of_a_rod() -> None:
    M = element_mass([RHO_A], [H])[0]
    shift, turn = np.array([1.0, 0.0, 1.0, 0.0]), np.array([0.0, 1.0, H, 1.0])
    assert shift @ M @ shift == pytest.approx(RHO_A * H, rel=ROUND_OFF)
    assert turn @ M @ turn == pytest.approx(RHO_A * H**3 / 3, rel=ROUND_OFF)


def test_lumped_mass_is_half_per_end() -> None:
    end = [RHO_A * H / 2, RHO_A * H**3 / 78]
    np.testing.assert_allclose(element_lumped_mass([RHO_A], [H])[0], end + end, rtol=ROUND_OFF)


def test_moving_with_the_base_needs_no_force(model: Structure) -> None:
    ops = model.operators
    translation = np.tile([1.0, 0.0], ops.n_dofs // 2)
    scale = ops.stiffness.diagonal().max()
    np.testing.assert_allclose(
        ops.stiffness @ translation + ops.base.stiffness, 0.0, atol=ROUND_OFF * scale
    )
    reaction = ops.base.corner[2] + translation @ ops.base.stiffness
    assert abs(reaction) < ROUND_OFF * scale


def test_total_mass_is_that_of_both_laminae(paper: Case, model: Structure) -> None:
    ops = model.operators
    translation = np.tile([1.0, 0.0], ops.n_dofs // 2)
    total = (
        translation @ ops.mass @ translation
        + 2.0 * translation @ ops.base.mass
        + ops.base.corner[0]
    )
    expected = sum(lamina.mass_per_length * lamina.length for lamina in paper.lamina)
    assert total == pytest.approx(expected, rel=ROUND_OFF)


def test_damping_is_rayleigh_per_lamina(paper: Case, model: Structure) -> None:
    ops, half = model.operators, model.operators.n_dofs // 2
    for i, dofs in enumerate((slice(0, half), slice(half, None))):
        alpha, beta = paper.rayleigh(i)
        expected = alpha * ops.mass[dofs, dofs] + beta * ops.stiffness[dofs, dofs]
        difference = abs(ops.damping[dofs, dofs] - expected).max()
        assert difference < ROUND_OFF * expected.max()
        column = alpha * ops.base.mass[dofs] + beta * ops.base.stiffness[dofs]
        np.testing.assert_allclose(ops.base.damping[dofs], column, rtol=ROUND_OFF)
    assert ops.damping[:half, half:].nnz == 0


def test_dofs_run_along_lamina_one_then_two(model: Structure) -> None:
    ops, n = model.operators, model.layout.parts[0].n_elements
    q = np.zeros(ops.n_dofs)
    q[2 * 2], q[2 * n + 2 * 2], q[2 * 2 + 1] = 3.0, 10.0, 99.0  # third free node: u1, u2, phi1
    np.testing.assert_array_equal(ops.gap_matrix @ q, [0.0, 0.0, 7.0, 0.0, 0.0])
    np.testing.assert_array_equal(ops.probes @ np.arange(4 * n), [2 * n - 2, 4 * n - 2])
    thick, thin = (part.mass_per_length for part in model.layout.parts)
    h = np.diff(GRADED)
    assert ops.lumped_mass[0] == pytest.approx(thick[0] * (h[0] + h[1]) / 2, rel=ROUND_OFF)
    assert ops.lumped_mass[-2] == pytest.approx(thin[0] * h[-1] / 2, rel=ROUND_OFF)
    assert ops.lumped_mass[-1] == pytest.approx(thin[0] * h[-1] ** 3 / 78, rel=ROUND_OFF)


def test_gap_at_rest_is_that_of_the_free_nodes(model: Structure) -> None:
    expected = 0.012 * (GRADED[1:] / 0.685) ** 2
    np.testing.assert_allclose(model.operators.gap0, expected, rtol=ROUND_OFF)


def test_lumped_mass_of_the_integration_is_diagonal(paper: Case) -> None:
    lumped = assemble(paper.with_overrides({"time.mass": "lumped"})).operators
    consistent = assemble(paper).operators
    np.testing.assert_array_equal(lumped.mass.toarray(), np.diag(consistent.lumped_mass))
    np.testing.assert_array_equal(lumped.base.mass, 0.0)
    h = 0.685 / 5
    clamps = sum(lamina.mass_per_length * h / 2 for lamina in paper.lamina)
    assert lumped.base.corner[0] == pytest.approx(clamps, rel=ROUND_OFF)
    alpha, beta = paper.rayleigh(0)
    damping = alpha * lumped.mass[:10, :10] + beta * lumped.stiffness[:10, :10]
    assert abs(lumped.damping[:10, :10] - damping).max() < ROUND_OFF * damping.max()


def test_default_nodes_are_uniform(paper: Case) -> None:
    np.testing.assert_allclose(assemble(paper).layout.x, np.linspace(0.0, 0.685, 6), rtol=ROUND_OFF)


def test_nodes_that_do_not_reach_the_tip_are_refused(paper: Case) -> None:
    with pytest.raises(CaseError, match=r"from 0 to the length 0\.685 m, given 0 to 0\.5 m"):
        assemble(paper, x=[0.0, 0.2, 0.5])
