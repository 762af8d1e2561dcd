"""Rows that evaluate displacements and derivatives at points in cells."""

import os
import subprocess
import sys

import numpy as np
import numpy.typing as npt
import pytest
from bricks import two_bricks
from project import ROOT

from delam_fem.model.solids.cells import locate, reference_coordinates
from delam_fem.model.solids.elasticity import Solid
from delam_fem.model.solids.evaluation import evaluate
from delam_fem.model.solids.mesh import SolidMesh
from delam_fem.mpi import MPI

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
    found = evaluate(solid, x, locate(mesh, x, lamina))
    directions = np.random.default_rng(1).normal(size=x.shape)
    along = np.zeros(len(x))
    for i in range(dim):
        value, gradient = polynomial(x, i, degree)
        along += directions[:, i] * value
        np.testing.assert_allclose(found.displacement(i) @ u, value, rtol=0, atol=ROUND_OFF)
        for j in range(dim):
            np.testing.assert_allclose(
                found.derivative(i, j) @ u, gradient[:, j], rtol=0, atol=10 * ROUND_OFF
            )
    np.testing.assert_allclose(found.along(directions) @ u, along, rtol=0, atol=ROUND_OFF)


@pytest.mark.parametrize("cell", COUNTS)
def test_points_on_boundaries_of_cells_have_the_first_of_them(cell: str) -> None:
    mesh = two_bricks(cell, *COUNTS[cell])
    has = [np.flatnonzero(np.any(mesh.cells == v, axis=1)) for v in range(len(mesh.points))]
    first = np.array([cells[0] for cells in has])
    assert locate(mesh, mesh.points, mesh.lamina[first]).tolist() == first.tolist()


def test_laminae_that_touch_are_told_apart() -> None:
    mesh = two_bricks("quadrilateral", (4, 1), (3, 1))
    at = np.array([[0.9, 0.5]])  # on the lower one's upper surface and the upper one's lower one
    assert [mesh.lamina[locate(mesh, at, number)[0]] for number in (0, 1)] == [0, 1]


def test_thin_cells_are_found_at_their_ends() -> None:
    mesh = two_bricks(
        "hexahedron", (20, 1, 2), (20, 1, 2), size=(0.685, 1e-3, 0.05), ends=(0, 0.685)
    )
    x = np.array([[0.685, 1e-3, 0.025], [0.0, 0.0, -0.025], [0.3425, 5e-4, 0.0]])
    assert np.all(mesh.lamina[locate(mesh, x, 0)] == 0)


def test_point_outside_its_lamina_is_refused() -> None:
    mesh = two_bricks("triangle", (4, 1), (3, 1))
    with pytest.raises(ValueError, match=r"point \[0\.9 0\.7\] is in no cell of lamina 0"):
        locate(mesh, np.array([[0.9, 0.3], [0.9, 0.7]]), 0)


def test_reference_coordinates_are_those_of_basix() -> None:
    corners = np.array([[[0.0, 0.0], [2.0, 0.0], [0.0, 1.0], [2.0, 1.0]]])
    X = reference_coordinates("quadrilateral", corners, np.array([[0.5, 0.75]]))
    np.testing.assert_allclose(X, [[0.25, 0.75]], atol=1e-14)


SUM = """
import numpy as np
from bricks import two_bricks
from delam_fem.model.solids.cells import locate, reference_coordinates
from delam_fem.model.solids.cells import locate
from delam_fem.model.solids.elasticity import Solid
from delam_fem.model.solids.evaluation import evaluate, gathered
from delam_fem.mpi import MPI

comm = MPI.COMM_WORLD
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
@pytest.mark.slow
def test_ranks_evaluate_their_own_cells() -> None:
    command = ["mpirun", "--allow-run-as-root", "--oversubscribe", "-n", "2", sys.executable]
    path = f"{ROOT}:{ROOT / 'tests'}"
    done = subprocess.run(
        [*command, "-c", SUM],
        env={**os.environ, "PYTHONPATH": path, "OMP_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert done.returncode == 0, done.stderr
