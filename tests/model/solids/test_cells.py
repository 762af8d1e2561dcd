"""Geometry of cells: where points are, reference coordinates, volumes, lines through facets."""

import numpy as np
import numpy.typing as npt
import pytest
from box_meshes import two_bricks

from delam_fem.api import volumes
from delam_fem.model.solids import mesh as cells
from delam_fem.model.solids.mesh import (
    SolidMesh,
    jacobians_of,
    locate,
    meetings,
    reference_coordinates,
    shape_functions,
)

Array = npt.NDArray[np.float64]
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


@pytest.mark.parametrize("cell", COUNTS)
def test_reference_coordinates_invert_the_map(cell: str) -> None:
    mesh = bent(two_bricks(cell, *COUNTS[cell]))
    X = np.random.default_rng(4).dirichlet(np.ones(mesh.dim + 1), len(mesh.cells))[:, :-1]
    corners = mesh.points[mesh.cells]
    x = np.einsum("kv,kvi->ki", shape_functions(cell, X)[0], corners)
    np.testing.assert_allclose(reference_coordinates(cell, corners, x), X, atol=1e-11)
    cell_numbers = locate(mesh, x, mesh.lamina)
    assert cell_numbers.tolist() == list(range(len(mesh.cells)))


@pytest.mark.parametrize("cell", [*COUNTS, "interval"])
def test_functions_are_one_at_their_vertex_and_their_slopes_are_right(cell: str) -> None:
    d = {"interval": 1, "triangle": 2, "quadrilateral": 2}.get(cell, 3)
    X = np.random.default_rng(5).uniform(0.1, 0.3, (4, d))
    N, dN = shape_functions(cell, X)
    np.testing.assert_allclose(N.sum(axis=1), 1.0, rtol=1e-14)
    for j in range(d):
        step = 1e-6 * np.eye(d)[j]
        slope = (shape_functions(cell, X + step)[0] - shape_functions(cell, X - step)[0]) / 2e-6
        np.testing.assert_allclose(dN[:, :, j], slope, atol=1e-9)
    bits = (np.arange(2**d)[:, None] >> np.arange(d)) & 1
    is_tensor = cell in ("interval", "quadrilateral", "hexahedron")
    vertices = bits if is_tensor else np.eye(d + 1, d, -1)
    np.testing.assert_allclose(
        shape_functions(cell, vertices.astype(float))[0], np.eye(len(vertices))
    )


@pytest.mark.parametrize("cell", COUNTS)
def test_volumes_add_up_to_that_of_the_box(cell: str) -> None:
    mesh = two_bricks(cell, *COUNTS[cell])
    total = 2.0 * 0.5 * (0.8 if mesh.dim == 3 else 1.0)
    assert np.abs(volumes(mesh))[mesh.lamina == 0].sum() == pytest.approx(total, rel=1e-13)
    X = np.full((1, mesh.dim), 0.25)
    sign = np.sign(np.linalg.det(jacobians_of(cell, mesh.points[mesh.cells[:1]], X)))
    assert np.sign(volumes(mesh)[0]) == sign[0]


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


def test_volumes_of_bent_cells() -> None:
    points = np.array([[0.0, 0.0], [2.0, 0.0], [0.5, 1.0], [1.0, 1.5]])
    mesh = SolidMesh(points, np.array([[0, 1, 2, 3]]), "quadrilateral", np.zeros(1, dtype=np.int64))
    x, y = points[[0, 1, 3, 2]].T
    shoelace = 0.5 * (x @ np.roll(y, -1) - y @ np.roll(x, -1))
    assert volumes(mesh)[0] == pytest.approx(shoelace, rel=1e-14)


EDGE = np.array([[[0.0, 2.0], [4.0, 4.0]]])


def test_a_line_meets_an_edge() -> None:
    hits = meetings(EDGE, np.array([[1.0, 0.0]]), np.array([[0.0, 1.0]]), "interval")
    assert hits.distance == pytest.approx([2.5])
    assert hits.local.ravel() == pytest.approx([0.25])


def test_lines_have_two_directions() -> None:
    hits = meetings(EDGE, np.array([[1.0, 5.0]]), np.array([[0.0, 1.0]]), "interval")
    assert hits.distance == pytest.approx([-2.5])


def test_ends_belong_to_an_edge_and_what_is_beyond_does_not() -> None:
    origins = np.array([[0.0, 0.0], [4.0, 0.0], [-1e-3, 0.0], [4.001, 0.0]])
    hits = meetings(EDGE, origins, np.tile([0.0, 1.0], (4, 1)), "interval")
    assert hits.line.tolist() == [0, 1]


def test_a_line_along_an_edge_does_not_meet_it() -> None:
    upright = np.array([[[1.0, 0.0], [1.0, 2.0]]])
    hits = meetings(upright, np.array([[1.0, -1.0]]), np.array([[0.0, 1.0]]), "interval")
    assert hits.line.size == 0


@pytest.mark.parametrize(("facet", "count"), [("triangle", 3), ("quadrilateral", 4)])
def test_slanted_facets(facet: str, count: int) -> None:
    """The plane z = 1 + x + 2 y, met along a slanted line."""
    square = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]])[:count]
    corners = np.column_stack([square, 1.0 + square @ [1.0, 2.0]])[None]
    direction = np.array([[1.0, 2.0, 2.0]]) / 3.0
    place = np.array([[0.3, 0.4, 2.1]])
    hits = meetings(corners, place - 6.0 * direction, direction, facet)
    assert hits.distance == pytest.approx([6.0])
    np.testing.assert_allclose(hits.local, [[0.3, 0.4]], atol=1e-12)
    beyond = np.array([[0.7, 0.6, 2.9]])  # outside of the triangle
    assert meetings(corners, beyond, direction, facet).line.size == (facet == "quadrilateral")


def test_twisted_facets() -> None:
    """The surface z = x y over the unit square."""
    corners = np.array([[[0.0, 0, 0], [1.0, 0, 0], [0.0, 1, 0], [1.0, 1, 1]]])
    origins = np.array([[0.3, 0.7, -1.0], [0.9, 0.8, 5.0]])
    hits = meetings(corners, origins, np.tile([0.0, 0.0, 1.0], (2, 1)), "quadrilateral")
    np.testing.assert_allclose(hits.distance, [1.21, 0.72 - 5.0], atol=1e-12)


def test_many_lines_are_met_in_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    x = np.linspace(0.0, 1.0, 41)
    corners = np.stack([np.column_stack([x[:-1], x[:-1]]), np.column_stack([x[1:], x[1:]])], axis=1)
    origins = np.column_stack([np.linspace(0.01, 0.99, 30), np.zeros(30)])
    up = np.tile([0.0, 1.0], (30, 1))
    all_hits = meetings(corners, origins, up, "interval")
    np.testing.assert_allclose(all_hits.distance, origins[all_hits.line, 0], atol=1e-12)
    monkeypatch.setattr(cells, "_MOST_CANDIDATES", 100)
    parts = meetings(corners, origins, up, "interval")
    assert np.array_equal(parts.line, all_hits.line)
    assert np.array_equal(parts.facet, all_hits.facet)


def test_nothing_meets_nothing() -> None:
    hits = meetings(np.zeros((0, 2, 2)), np.zeros((1, 2)), np.array([[0.0, 1.0]]), "interval")
    assert hits.line.size == 0
