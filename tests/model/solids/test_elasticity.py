"""Mass and stiffness of solids: rigid motions, uniform strains, locking."""

import numpy as np
import numpy.typing as npt
import pytest
import scipy.sparse as sp
from box_meshes import two_bricks

from delam_fem.api import MPI
from delam_fem.model.solids.forms import Elasticity, Solid

Array = npt.NDArray[np.float64]
COUNTS = {
    "triangle": (2, 2),
    "quadrilateral": (2, 1),
    "tetrahedron": (1, 2, 1),
    "hexahedron": (2, 1, 1),
}
SPACES = [(cell, degree) for cell in COUNTS for degree in (2, 3)]
ROUND_OFF = 1e-12
E, NU, RHO = 70.0, 0.3, 2.7


def csr(matrix: object) -> sp.csr_matrix:
    """Return a PETSc matrix as a sparse matrix of SciPy, and destroy it."""
    indptr, columns, values = matrix.getValuesCSR()  # type: ignore[attr-defined]
    shape = matrix.getSize()  # type: ignore[attr-defined]
    matrix.destroy()  # type: ignore[attr-defined]
    return sp.csr_matrix((values, columns, indptr), shape=shape)


@pytest.fixture(params=SPACES, ids=lambda own: f"{own[0]}-{own[1]}")
def solid(request: pytest.FixtureRequest) -> Solid:
    """Return a solid of two boxes, 2 x 0.5 (x 0.8) each."""
    cell, degree = request.param
    mesh = two_bricks(cell, COUNTS[cell], COUNTS[cell], gap=0.1)
    return Solid.on(mesh, MPI.COMM_SELF, degree)


def gradients(solid: Solid, table: Array) -> Array:
    """Return the displacements whose gradient is a table, at the nodes, flat."""
    return np.asarray(solid.coordinates @ table[: solid.dim, : solid.dim].T).ravel()


def test_rigid_motions_have_no_stiffness_and_the_whole_mass(solid: Solid) -> None:
    of_cells = np.ones(len(solid.mesh.cells))
    K, M = (
        csr(solid.stiffness(E * of_cells, Elasticity.isotropic(solid.mesh, NU))),
        csr(solid.mass(RHO * of_cells)),
    )
    assert abs(K - K.T).max() < ROUND_OFF * abs(K).max()
    volume = 2.0 * 2.0 * 0.5 * (0.8 if solid.dim == 3 else 1.0)
    turn = gradients(solid, np.array([[0.0, -1.0, 2.0], [1.0, 0.0, -3.0], [-2.0, 3.0, 0.0]]))
    assert np.abs(K @ turn).max() < ROUND_OFF * abs(K).max()
    for component in range(solid.dim):
        shift = np.tile(np.arange(solid.dim) == component, solid.n_nodes).astype(float)
        assert np.abs(K @ shift).max() < ROUND_OFF * abs(K).max()
        assert shift @ M @ shift == pytest.approx(RHO * volume)
    x = solid.coordinates[:, 0]
    u = np.zeros((solid.n_nodes, solid.dim))
    u[:, 1] = x
    assert u.ravel() @ M @ u.ravel() == pytest.approx(RHO * volume * 4.0 / 3.0)  # mean of x²


def test_uniform_strains_have_their_energy(solid: Solid) -> None:
    """2 W / V = σ : ε, with plane stress in two dimensions."""
    of_cells = np.where(solid.mesh.lamina == 0, 1.0, 0.0)
    K = csr(solid.stiffness(E * of_cells, Elasticity.isotropic(solid.mesh, NU)))
    volume = 2.0 * 0.5 * (0.8 if solid.dim == 3 else 1.0)
    G = E / (2.0 * (1.0 + NU))
    stretch = gradients(solid, np.diag([1.0, 0.0, 0.0]))
    along = E / (1.0 - NU**2) if solid.dim == 2 else E * (1 - NU) / ((1 + NU) * (1 - 2 * NU))
    assert stretch @ K @ stretch == pytest.approx(along * volume)
    slide = gradients(solid, np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]]))
    assert slide @ K @ slide == pytest.approx(G * volume)
    free = gradients(solid, np.diag([1.0, -NU, -NU]))
    assert free @ K @ free == pytest.approx(E * volume)


def test_nodes_on_facets(solid: Solid) -> None:
    facets = solid.mesh.sides[0].lower
    nodes = solid.nodes_on(facets)
    on_top = np.flatnonzero(np.abs(solid.coordinates[:, 1] - 0.5) < ROUND_OFF)
    assert nodes.tolist() == on_top.tolist()
    np.testing.assert_array_equal(solid.fetched(solid.coordinates, nodes), solid.coordinates[nodes])
    assert solid.nodes_on(facets[:0]).size == 0


def test_nodes_of_cells_are_in_the_order_of_the_basis(solid: Solid) -> None:
    """The basis at a point, times the nodes' coordinates, gives the point."""
    point = np.full((1, solid.dim), 0.21)
    basis = solid.tabulate(0, point)[0, 0]
    linear = Solid.on(solid.mesh, MPI.COMM_SELF, 1).tabulate(0, point)[0, 0]
    cells = np.arange(len(solid.mesh.cells))
    points = np.einsum("b,cbi->ci", basis, solid.coordinates[solid.nodes_of(cells)])
    expected = np.einsum("v,cvi->ci", linear, solid.mesh.points[solid.mesh.cells])
    np.testing.assert_allclose(points, expected, atol=ROUND_OFF)
