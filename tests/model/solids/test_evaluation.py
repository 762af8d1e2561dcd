"""Rows that evaluate displacements and derivatives at points in cells."""

import numpy as np
import numpy.typing as npt
import pytest
from box_meshes import two_bricks
from mpi_pool import Crew

from delam_fem.api import MPI
from delam_fem.model.solids.forms import Solid, evaluate
from delam_fem.model.solids.mesh import SolidMesh, locate

Array = npt.NDArray[np.float64]
ROUND_OFF = 1e-11  # relative; derivatives of cubic polynomials in cells of size 0.1
COUNTS = {
    "triangle": ((5, 2), (7, 1)),
    "quadrilateral": ((5, 2), (7, 1)),
    "tetrahedron": ((3, 2, 2), (4, 1, 3)),
    "hexahedron": ((3, 2, 2), (4, 1, 3)),
}


def bent(mesh: SolidMesh) -> SolidMesh:
    """Return the mesh with vertices moved, so that no cell is a parallelepiped."""
    x = mesh.points
    moved = x + 0.03 * np.sin(5.0 * x[:, [1, 0, *range(2, x.shape[1])]] + 1.0)
    return SolidMesh(moved, mesh.cells, mesh.cell, mesh.lamina)


def polynomial(x: Array, component: int, degree: int) -> tuple[Array, Array]:
    """Return a polynomial of a degree and its gradient, different for each component."""
    slopes = np.array([0.7, -0.4, 0.9])[: x.shape[1]] + 0.3 * component
    s = x @ slopes + 0.2
    return s**degree, (degree * s ** (degree - 1))[:, None] * slopes


def points_in(mesh: SolidMesh, n: int) -> tuple[Array, npt.NDArray[np.int64]]:
    """Return random points within the cells, and their laminae."""
    random = np.random.default_rng(3)
    chosen = random.integers(len(mesh.cells), size=n)
    shares = random.dirichlet(np.ones(mesh.cells.shape[1]), size=n)
    return np.einsum("kv,kvi->ki", shares, mesh.points[mesh.cells[chosen]]), mesh.lamina[chosen]


@pytest.mark.parametrize("degree", [2, 3])
@pytest.mark.parametrize("cell", COUNTS)
def test_polynomials_of_the_degree_are_exact(cell: str, degree: int) -> None:
    mesh = bent(two_bricks(cell, *COUNTS[cell]))
    solid = Solid.on(mesh, MPI.COMM_SELF, degree)
    dim = mesh.dim
    u = np.column_stack([polynomial(solid.coordinates, i, degree)[0] for i in range(dim)]).ravel()
    x, lamina = points_in(mesh, 40)
    evaluation = evaluate(solid, x, locate(mesh, x, lamina))
    directions = np.random.default_rng(1).normal(size=x.shape)
    along = np.zeros(len(x))
    for i in range(dim):
        value, gradient = polynomial(x, i, degree)
        along += directions[:, i] * value
        np.testing.assert_allclose(evaluation.displacement(i) @ u, value, rtol=0, atol=ROUND_OFF)
        for j in range(dim):
            np.testing.assert_allclose(
                evaluation.derivative(i, j) @ u, gradient[:, j], rtol=0, atol=10 * ROUND_OFF
            )
    np.testing.assert_allclose(evaluation.along(directions) @ u, along, rtol=0, atol=ROUND_OFF)


SUM = """
import numpy as np
from box_meshes import two_bricks
from delam_fem.model.solids.mesh import locate
from delam_fem.model.solids.forms import Solid, evaluate, gathered

mesh = two_bricks("quadrilateral", (6, 1), (5, 1))
solid = Solid.on(mesh, comm, 2, ranks=np.arange(len(mesh.cells)) % 2)
x = np.random.default_rng(0).uniform([0, 0], [2, 0.5], size=(50, 2))
found = evaluate(solid, x, locate(mesh, x, 0))
assert 0 < found.points.size < 50
rows = gathered(found.derivative(1, 0), comm)
own = solid.coordinates
u = np.zeros((solid.n_own_nodes, 2))
u[:, 1] = own[:, 0] ** 2 + own[:, 1]
whole = np.concatenate(comm.allgather(u.ravel()))
assert np.abs(rows @ whole - 2 * x[:, 0]).max() < 1e-12
"""


@pytest.mark.mpi
def test_ranks_evaluate_their_own_cells(crew: Crew) -> None:
    crew.run(2, SUM)
