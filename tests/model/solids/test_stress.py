"""Stresses at nodes: exact fields, exact bending with its sign, jumps between laminae."""

import numpy as np
import pytest
from box_meshes import two_bricks

from delam_fem.api import MPI, Body, FloatArray
from delam_fem.model.solids.body import Shape
from delam_fem.model.solids.forms import VTK_ORDER, Elasticity, Solid, sampled, von_mises
from delam_fem.numerics.elasticity import DIRECTIONS

YOUNG, NU = 3.0, 0.3
COUNTS = {
    "triangle": (3, 2),
    "quadrilateral": (3, 2),
    "tetrahedron": (3, 2, 2),
    "hexahedron": (3, 2, 2),
}
ROUND_OFF = 1e-9


def shape_of(cell: str, degree: int, young_modulus: tuple[float, float], nu: float) -> Shape:
    """Return two boxes, 2 long and 0.5 high each, with a gap; their dofs are all free."""
    mesh = two_bricks(cell, COUNTS[cell], COUNTS[cell], gap=0.1)
    solid = Solid.on(mesh, MPI.COMM_SELF, degree)
    n = mesh.dim * solid.n_nodes
    E = np.array(young_modulus)[mesh.lamina]
    body = Body(solid, None, np.zeros(n), E, Elasticity.isotropic(mesh, nu), np.ones(2))
    return body.shape()


def at_nodes(shape: Shape, values: FloatArray) -> FloatArray:
    """Return values at points as values at nodes, shape (n_nodes, dim)."""
    result = np.empty((int(shape.nodes.max()) + 1, values.shape[1]))
    result[shape.node] = values
    return result


@pytest.mark.parametrize("cell", COUNTS)
@pytest.mark.parametrize("degree", [2, 3])
def test_points_are_where_dolfinx_has_them(cell: str, degree: int) -> None:
    shape = shape_of(cell, degree, (YOUNG, YOUNG), NU)
    solid = Solid.on(shape.mesh, MPI.COMM_SELF, degree)
    np.testing.assert_allclose(shape.points, solid.coordinates[shape.node], atol=1e-14)
    assert len(np.unique(shape.node)) == solid.n_nodes


@pytest.mark.parametrize("degree", [2, 3])
@pytest.mark.parametrize("cell", COUNTS)
def test_linear_displacements_have_the_stress_of_hooke_s_law(cell: str, degree: int) -> None:
    """Beside the law of the form itself, evaluated by UFL on numbers."""
    shape = shape_of(cell, degree, (YOUNG, 2.0 * YOUNG), NU)
    dim = shape.mesh.dim
    A = np.random.default_rng(1).normal(size=(dim, dim))
    sigma = shape.recovery.stress(at_nodes(shape, shape.points @ A.T))
    eps = 0.5 * (A + A.T)
    for lamina, E in enumerate((YOUNG, 2.0 * YOUNG)):
        if dim == 2:
            D = E / (1.0 - NU**2) * np.array([[1, NU, 0], [NU, 1, 0], [0, 0, 1 - NU]])
            expected = D @ [eps[0, 0], eps[1, 1], eps[0, 1]]
        else:  # the inverse of Hooke's law as it stands in books
            S = (np.eye(3) * (1.0 + NU) - NU * np.ones((3, 3))) / E
            normal = np.linalg.solve(S, np.diag(eps))
            shear = E / (1.0 + NU) * np.array([eps[0, 1], eps[1, 2], eps[0, 2]])
            expected = np.concatenate([normal, shear])
        stress = sigma[shape.lamina == lamina]
        np.testing.assert_allclose(stress, np.tile(expected, (len(stress), 1)), atol=ROUND_OFF)


@pytest.mark.parametrize("cell", COUNTS)
def test_pure_bending_with_its_sign(cell: str) -> None:
    """Upward curvature compresses the top: sigma_xx = -E y u_y'', all other components vanish.

    The displacement of Saint-Venant's solution is quadratic: all elements have it exactly.
    """
    shape = shape_of(cell, 2, (YOUNG, YOUNG), NU)
    x, y = shape.points[:, 0], shape.points[:, 1] - shape.points[:, 1].mean()
    curvature = 0.02
    u = np.zeros_like(shape.points)
    u[:, 0] = -curvature * x * y
    u[:, 1] = 0.5 * curvature * (x**2 + NU * y**2)
    if u.shape[1] == 3:
        z = shape.points[:, 2]
        u[:, 1] -= 0.5 * curvature * NU * z**2
        u[:, 2] = NU * curvature * y * z
    sigma = shape.recovery.stress(at_nodes(shape, u))
    np.testing.assert_allclose(sigma[:, 0], -YOUNG * y * curvature, atol=ROUND_OFF)
    np.testing.assert_allclose(sigma[:, 1:], 0.0, atol=ROUND_OFF)
    np.testing.assert_allclose(von_mises(sigma), np.abs(sigma[:, 0]), atol=ROUND_OFF)


@pytest.mark.parametrize("dim", [2, 3])
def test_von_mises(dim: int) -> None:
    """The norm of the deviator, of any stress; plane stress has no component along z."""
    sigma = np.random.default_rng(3).normal(size=(5, len(VTK_ORDER[dim])))
    full = np.zeros((5, 3, 3))
    for k, (i, j) in enumerate(DIRECTIONS[dim][k] for k in VTK_ORDER[dim]):
        full[:, i, j] = full[:, j, i] = sigma[:, k]
    deviator = full - np.trace(full, axis1=1, axis2=2)[:, None, None] / 3.0 * np.eye(3)
    expected = np.sqrt(1.5 * np.einsum("kij,kij->k", deviator, deviator))
    np.testing.assert_allclose(von_mises(sigma), expected, rtol=1e-12)


@pytest.mark.parametrize("degree", [2, 3])
def test_places_are_those_of_gauss_and_continue_polynomials(degree: int) -> None:
    nodes = np.random.default_rng(4).uniform(size=(7, 2))
    places, continued = sampled("quadrilateral", degree, nodes)
    assert len(places) == degree**2
    f = lambda X: (1.0 + X[:, 0]) ** (degree - 1) * (2.0 - X[:, 1]) ** (degree - 1)  # noqa: E731
    np.testing.assert_allclose(continued @ f(places), f(nodes), rtol=1e-10)
    assert np.abs(places - 0.5).max() < 0.5, "within the cell"
    near = np.sort(np.unique(np.round(places[:, 0] - 0.5, 9)))
    exact = {
        2: [-0.5 / np.sqrt(3.0), 0.5 / np.sqrt(3.0)],
        3: [-0.5 * np.sqrt(0.6), 0.0, 0.5 * np.sqrt(0.6)],
    }
    np.testing.assert_allclose(near, exact[degree], atol=1e-8)


def test_the_law_is_that_of_the_stiffness() -> None:
    """Strain energy from recovered stresses equals u K u / 2 of the assembled form."""
    shape = shape_of("quadrilateral", 2, (YOUNG, 2.0 * YOUNG), NU)
    A = np.array([[0.1, 0.3], [-0.2, 0.4]])
    u = at_nodes(shape, shape.points @ A.T)
    solid = Solid.on(shape.mesh, MPI.COMM_SELF, 2)
    matrix = solid.stiffness(shape.young_modulus, shape.material)
    vector = matrix.createVecRight()
    vector.array = u.ravel()
    energy = 0.5 * vector.dot(matrix * vector)
    sigma = shape.recovery.stress(u)
    eps = np.array([A[0, 0], A[1, 1], A[0, 1] + A[1, 0]])
    both = [sigma[shape.lamina == k][0] @ eps * 0.5 for k in (0, 1)]
    assert energy == pytest.approx(sum(both), rel=1e-12)  # each box has the area 1
