"""The middle line of solid laminae: deflection and slope."""

import numpy as np
import numpy.typing as npt
import pytest
import scipy.sparse as sp
from box_meshes import two_bricks

from delam_fem.api import MPI, CaseError, preset
from delam_fem.model.layout import DISPLACEMENT, SLOPE, Reading
from delam_fem.model.solids import body
from delam_fem.model.solids.forms import Solid
from delam_fem.model.solids.mesh import SolidMesh

Array = npt.NDArray[np.float64]
ROUND_OFF = 1e-11
COUNTS = {
    "triangle": ((5, 2), (7, 1)),
    "quadrilateral": ((5, 1), (7, 3)),
    "tetrahedron": ((3, 2, 2), (4, 1, 3)),
    "hexahedron": ((3, 1, 3), (4, 2, 1)),
}
X = np.array([0.0, 0.4, 0.53, 1.0, 2.0])


def read(solid: Solid, u: Array) -> Array:
    """Return what the parts read of given displacements, shape (n_parts, n, 2)."""
    return (body.reading_rows(solid, X) @ u.ravel()).reshape(-1, X.size, 2)


@pytest.mark.parametrize("cell", COUNTS)
def test_bending_is_read_at_half_height_and_width(cell: str) -> None:
    mesh = two_bricks(cell, *COUNTS[cell], gap=0.1)
    solid = Solid.on(mesh, MPI.COMM_SELF, 2)
    x, y = solid.coordinates[:, 0], solid.coordinates[:, 1]
    z = solid.coordinates[:, 2] if mesh.dim == 3 else 0.0
    u = np.zeros((solid.n_nodes, mesh.dim))
    u[:, 0] = 11.0 * x * y
    u[:, 1] = 0.3 * x**2 - x + 0.2 * x * y + 5.0 * y + 7.0 * z * x
    readings = read(solid, u)
    for number, height in enumerate((0.25, 0.85)):
        at = readings[number]
        deflection = 0.3 * X**2 - X + 0.2 * X * height + 5.0 * height
        np.testing.assert_allclose(at[:, DISPLACEMENT], deflection, atol=ROUND_OFF)
        np.testing.assert_allclose(at[:, SLOPE], 0.6 * X - 1.0 + 0.2 * height, atol=ROUND_OFF)


def test_slope_between_cells_is_the_mean_of_both() -> None:
    """Of x³ the quadratic interpolants have slopes too low by h²/2 on both sides of a vertex."""
    mesh = two_bricks("quadrilateral", (5, 1), (5, 1))
    solid = Solid.on(mesh, MPI.COMM_SELF, 2)
    h, u = 0.4, np.zeros((solid.n_nodes, 2))
    u[:, 1] = solid.coordinates[:, 0] ** 3
    slope = read(solid, u)[0, :, SLOPE]
    assert slope[1] == pytest.approx(3 * 0.4**2 - 0.5 * h**2, abs=ROUND_OFF)
    u[:, 1] = np.abs(solid.coordinates[:, 0] - 0.4)
    assert read(solid, u)[0, 1, SLOPE] == pytest.approx(0.0, abs=ROUND_OFF)


def test_middle_line_follows_a_bent_lamina() -> None:
    mesh = two_bricks("quadrilateral", (40, 2), (40, 1))
    points = mesh.points.copy()
    points[:, 1] += 0.2 * points[:, 0] ** 2
    bent = SolidMesh(points, mesh.cells, mesh.cell, mesh.lamina)
    line = body.middle_line(bent, 1, X)
    np.testing.assert_allclose(line[:, 1], 0.75 + 0.2 * X**2, atol=0.2 * 0.05**2)


def test_lamina_that_is_too_short_is_refused() -> None:
    mesh = two_bricks("quadrilateral", (5, 1), (5, 1), ends=(0.0, 1.5))
    with pytest.raises(CaseError, match=r"lamina 2 .* from x = 0 m to 2 m, .* nothing .* at 2 m"):
        body.middle_line(mesh, 1, X)


def test_hole_in_the_middle_is_refused() -> None:
    mesh = two_bricks("quadrilateral", (5, 3), (5, 1))
    at = mesh.points[mesh.cells].mean(axis=1)
    is_kept = (np.abs(at - np.array([1.0, 0.25])) > 1e-6).any(axis=1)
    holed = SolidMesh(mesh.points, mesh.cells[is_kept], mesh.cell, mesh.lamina[is_kept])
    with pytest.raises(CaseError, match=r"without holes .*; point .* is in no cell of lamina 0"):
        body.reading_rows(Solid.on(holed, MPI.COMM_SELF, 2), X)


def test_what_moves_with_the_base_is_read_through_it() -> None:
    """The base carries the nodes at x = 0; the others follow their dofs."""
    mesh = two_bricks("quadrilateral", (5, 1), (5, 1))
    solid = Solid.on(mesh, MPI.COMM_SELF, 2)
    is_held = np.repeat(solid.coordinates[:, 0] < 1e-9, 2)
    free = sp.eye(is_held.size, format="csc")[:, ~is_held]
    base = np.where(is_held & (np.arange(is_held.size) % 2 == 1), 1.0, 0.0)
    rows = body.reading_rows(solid, X)
    reading = Reading(rows @ free, rows @ base, np.zeros(free.shape[1], dtype=np.int64))
    u = np.zeros((1, free.shape[1]))
    still = reading.of(u, np.array([2.0])).reshape(2, X.size, 2)
    np.testing.assert_allclose(still[:, :, DISPLACEMENT], [[2, 0, 0, 0, 0]] * 2, atol=1e-13)
    rigid = np.where(np.arange(is_held.size) % 2 == 1, 2.0, 0.0)[None, ~is_held]
    rigid_reading = reading.of(rigid, np.array([2.0])).reshape(2, X.size, 2)
    np.testing.assert_allclose(rigid_reading[:, :, DISPLACEMENT], 2.0, atol=1e-12)
    np.testing.assert_allclose(rigid_reading[:, :, SLOPE], 0.0, atol=ROUND_OFF)


@pytest.mark.parametrize(("cells", "expected"), [(30, 30), (3, body.FEWEST)])
def test_points_along_a_mesh_of_a_file_are_as_dense_as_its_cells(cells: int, expected: int) -> None:
    mesh = two_bricks(
        "quadrilateral", (cells, 1), (cells, 1), size=(0.4, 1e-3, 1.0), ends=(0.0, 0.4)
    )
    x = body.points_along(preset("embedded"), mesh)
    assert x.size == expected + 1
    for edge in (0.0, 0.12, 0.28, 0.4):
        assert np.abs(x - edge).min() < 1e-12
