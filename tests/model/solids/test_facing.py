"""Pairs of facing surfaces: projection, gaps, weights, signs; surfaces that do not match."""

import logging
from collections.abc import Callable

import numpy as np
import numpy.typing as npt
import pytest
import scipy.sparse as sp
from box_meshes import two_bricks
from scipy.sparse.linalg import splu

from delam_fem.api import MPI, Part
from delam_fem.model.solids.facing import (
    FacingPoints,
    Pairs,
    at_middles,
    at_places,
    at_vertices,
    gap_rows,
    interface,
    project,
)
from delam_fem.model.solids.forms import Elasticity, Solid
from delam_fem.model.solids.mesh import Facing, SolidMesh

Array = npt.NDArray[np.float64]
ROUND_OFF = 1e-12
COUNTS = {
    "triangle": ((5, 2), (7, 1)),
    "quadrilateral": ((5, 2), (7, 1)),
    "tetrahedron": ((3, 2, 2), (4, 1, 3)),
    "hexahedron": ((3, 2, 2), (4, 1, 3)),
}
GAP = 0.05
AREA = {2: 2.0, 3: 2.0 * 0.8}  # of the facing sides; a length in two dimensions


def turn(dim: int, angle: float = 0.7) -> Array:
    """Return a rotation, of z too in three dimensions."""
    c, s = np.cos(angle), np.sin(angle)
    about_z = np.eye(dim)
    about_z[:2, :2] = [[c, -s], [s, c]]
    if dim == 2:
        return about_z
    about_x = np.eye(3)
    about_x[1:, 1:] = [[c, -s], [s, c]]
    return about_x @ about_z


def moved(mesh: SolidMesh, to: Array) -> SolidMesh:
    """Return a mesh with other vertices."""
    return SolidMesh(to, mesh.cells, mesh.cell, mesh.lamina, mesh.supports, mesh.sides)


def rates(solid: Solid, pairs: Pairs, lower: Array, upper: Array, shift: Array) -> Array:
    """Return the gap rates of velocities `gradient x`, plus a shift of the upper body."""
    x = solid.coordinates
    body = np.zeros(solid.n_nodes, dtype=np.int64)
    body[solid.nodes_of(np.flatnonzero(solid.mesh.lamina == 1)).ravel()] = 1
    v = np.where(body[:, None] == 1, x @ upper.T + shift, x @ lower.T)
    return np.asarray(gap_rows(solid, pairs) @ v.ravel())


@pytest.mark.parametrize("is_turned", [False, True])
@pytest.mark.parametrize("cell", COUNTS)
def test_flat_surfaces_that_do_not_match(cell: str, is_turned: bool) -> None:
    """Linear fields give exact rates, wherever the bodies are turned."""
    mesh = two_bricks(cell, *COUNTS[cell], gap=GAP)
    dim = mesh.dim
    Q = turn(dim) if is_turned else np.eye(dim)
    mesh = moved(mesh, mesh.points @ Q.T)
    pairs = project(mesh, mesh.sides[0], at_vertices(mesh, mesh.sides[0]))
    n = Q[:, 1]
    lower = pairs.lower
    assert len(lower.x) == len(np.unique(mesh.sides[0].lower))
    np.testing.assert_allclose(lower.normals, np.tile(n, (len(lower.x), 1)), atol=ROUND_OFF)
    np.testing.assert_allclose(pairs.gap, GAP, atol=ROUND_OFF)
    np.testing.assert_allclose(pairs.upper, lower.x + GAP * n, atol=ROUND_OFF)
    assert pairs.weights.sum() == pytest.approx(AREA[dim], rel=ROUND_OFF)
    A, B = np.random.default_rng(2).normal(size=(2, dim, dim))
    shift = np.arange(1.0, dim + 1.0)
    gap_rates = rates(Solid.on(mesh, MPI.COMM_SELF, 2), pairs, A, B, shift)
    expected = (pairs.upper @ B.T + shift - lower.x @ A.T) @ n
    np.testing.assert_allclose(gap_rates, expected, atol=10 * ROUND_OFF)


@pytest.mark.parametrize("cell", COUNTS)
def test_gap_opens_when_the_upper_body_rises(cell: str) -> None:
    mesh = two_bricks(cell, *COUNTS[cell])
    pairs = project(mesh, mesh.sides[0], at_vertices(mesh, mesh.sides[0]))
    still, up = np.zeros((mesh.dim, mesh.dim)), np.eye(mesh.dim)[1]
    gap_rates = rates(Solid.on(mesh, MPI.COMM_SELF, 2), pairs, still, still, 3.0 * up)
    np.testing.assert_allclose(gap_rates, 3.0, atol=ROUND_OFF)


@pytest.mark.parametrize("cell", COUNTS)
def test_tilted_upper_surface(cell: str) -> None:
    """The gap is the distance along the normal of the lower side, not of the upper one."""
    mesh = two_bricks(cell, *COUNTS[cell], gap=GAP)
    points = mesh.points.copy()
    is_upper = points[:, 1] > 0.5 + 0.5 * GAP
    slope = 0.1
    points[is_upper, 1] += slope * points[is_upper, 0]
    pairs = project(mesh := moved(mesh, points), mesh.sides[0], at_vertices(mesh, mesh.sides[0]))
    np.testing.assert_allclose(pairs.gap, GAP + slope * pairs.x, atol=ROUND_OFF)


def test_tilted_lower_surface() -> None:
    """The normal leans against x; the gap is the distance along it to the level upper side."""
    mesh = two_bricks("quadrilateral", (8, 1), (5, 1), gap=GAP, ends=(-1.0, 2.0))
    points = mesh.points.copy()
    is_top = np.abs(points[:, 1] - 0.5) < ROUND_OFF
    slope = -0.1
    points[is_top, 1] += slope * points[is_top, 0]
    pairs = project(mesh := moved(mesh, points), mesh.sides[0], at_vertices(mesh, mesh.sides[0]))
    n = np.array([0.1, 1.0]) / np.hypot(0.1, 1.0)
    x = np.linspace(0.0, 2.0, 9)
    assert pairs.x.size == np.sum(x + 0.1 * (GAP + 0.1 * x) <= 2.0) < 9  # the last normals miss
    np.testing.assert_allclose(pairs.lower.normals, np.tile(n, (pairs.x.size, 1)), atol=ROUND_OFF)
    np.testing.assert_allclose(pairs.gap, (GAP + 0.1 * pairs.x) / n[1], atol=ROUND_OFF)


def test_overlapping_surfaces_have_a_negative_gap() -> None:
    mesh = two_bricks("triangle", (5, 2), (7, 2), gap=-0.01)
    pairs = project(mesh, mesh.sides[0], at_vertices(mesh, mesh.sides[0]))
    np.testing.assert_allclose(pairs.gap, -0.01, atol=ROUND_OFF)


def test_normals_of_a_curved_side_tend_to_those_of_the_circle() -> None:
    """The mean of the facets' normals is exact at the vertices of a regular polygon."""
    mesh = two_bricks("hexahedron", (12, 1, 2), (3, 1, 2), gap=1.0)
    points = mesh.points.copy()
    is_top = np.abs(points[:, 1] - 0.5) < ROUND_OFF
    angle = 0.3 * (points[is_top, 0] - 1.0)
    radius = 2.0
    points[is_top, 0], points[is_top, 1] = 1.0 + radius * np.sin(angle), radius * np.cos(angle) - 1
    mesh = moved(mesh, points)
    vertices = at_vertices(mesh, mesh.sides[0])
    angle = np.arcsin((vertices.x[:, 0] - 1.0) / radius)
    inner = np.abs(angle) < 0.29
    expected = np.column_stack([np.sin(angle), np.cos(angle), np.zeros(angle.size)])
    np.testing.assert_allclose(vertices.normals[inner], expected[inner], atol=ROUND_OFF)
    chord = 2.0 * radius * np.sin(0.5 * 0.3 * 2.0 / 12)
    assert vertices.weights.sum() == pytest.approx(12 * chord * 0.8, rel=1e-12)


def test_points_without_a_facet_opposite_are_left_out(caplog: pytest.LogCaptureFixture) -> None:
    mesh = two_bricks("quadrilateral", (10, 1), (3, 1), gap=GAP, ends=(0.5, 1.7))
    with caplog.at_level(logging.WARNING):
        pairs = project(mesh, mesh.sides[0], at_vertices(mesh, mesh.sides[0]))
    np.testing.assert_allclose(pairs.x, np.linspace(0.6, 1.6, 6), atol=ROUND_OFF)
    assert "laminae 0 and 1: 5 of 11 points have no facet opposite" in caplog.text


def test_surfaces_that_look_the_same_way_are_no_pair() -> None:
    """The upper surface of the upper body lies above, but does not face the lower one."""
    mesh = two_bricks("quadrilateral", (4, 1), (3, 1), gap=GAP)
    top = np.flatnonzero(np.abs(mesh.points[:, 1] - 1.0 - GAP) < ROUND_OFF)
    facets = np.column_stack([top[:-1], top[1:]])
    wrong = Facing((0, 1), mesh.sides[0].lower, facets)
    mesh = SolidMesh(mesh.points, mesh.cells, mesh.cell, mesh.lamina, sides=(wrong,))
    assert project(mesh, wrong, at_vertices(mesh, wrong)).x.size == 0


@pytest.mark.parametrize("cell", ["quadrilateral", "hexahedron", "tetrahedron"])
def test_places_along_and_across(cell: str) -> None:
    """They have the weights of beams, times the share of the width."""
    mesh = two_bricks(cell, *COUNTS[cell], gap=GAP)
    x = np.array([0.25, 0.5, 2.0])
    z = None if mesh.dim == 2 else np.array([-0.4, 0.4])
    points = at_places(mesh, mesh.sides[0], x, z)
    assert points.x[:, 0].tolist() == (x if z is None else np.repeat(x, 2)).tolist()
    np.testing.assert_allclose(points.x[:, 1], 0.5, atol=ROUND_OFF)
    np.testing.assert_allclose(points.normals[:, 1], 1.0, atol=ROUND_OFF)
    grid = np.unique(np.concatenate([np.linspace(0, 2, COUNTS[cell][0][0] + 1), x]))
    shares = np.zeros(grid.size)
    shares[1:] += 0.5 * np.diff(grid)
    shares[:-1] += 0.5 * np.diff(grid)
    expected = shares[np.searchsorted(grid, x)]
    if z is not None:  # two strips: the vertices in the middle have a half
        assert points.x[:2, 2].tolist() == z.tolist()
        expected = np.repeat(expected, 2) * 0.2
    np.testing.assert_allclose(points.weights, expected, atol=ROUND_OFF)
    pairs = project(mesh, mesh.sides[0], points)
    np.testing.assert_allclose(pairs.gap, GAP, atol=ROUND_OFF)


def test_place_beside_the_side_is_refused() -> None:
    mesh = two_bricks("quadrilateral", (4, 1), (3, 1))
    with pytest.raises(ValueError, match=r"expected the lower side above \[2\.5 0"):
        at_places(mesh, mesh.sides[0], np.array([1.0, 2.5]))


def test_shared_vertices_are_no_pairs() -> None:
    """At the edge of a delamination both laminae have the same vertex."""
    mesh = two_bricks("quadrilateral", (4, 1), (4, 1))
    sides = mesh.sides[0]
    left = [
        int(np.unique(side)[np.argmin(mesh.points[np.unique(side), 0])])
        for side in (sides.lower, sides.upper)
    ]
    cells = np.where(mesh.cells == left[1], left[0], mesh.cells)
    upper = np.where(sides.upper == left[1], left[0], sides.upper)
    facing = Facing((0, 1), sides.lower, upper)
    glued = SolidMesh(mesh.points, cells, mesh.cell, mesh.lamina, sides=(facing,))
    points = at_vertices(glued, facing)
    np.testing.assert_allclose(points.x[:, 0], [0.5, 1.0, 1.5, 2.0], atol=ROUND_OFF)
    np.testing.assert_allclose(points.weights, [0.5, 0.5, 0.5, 0.25], atol=ROUND_OFF)


@pytest.mark.parametrize("places", [at_vertices, at_middles])
@pytest.mark.parametrize("cell", COUNTS)
def test_constant_pressure_transmits_its_force_and_moment(
    cell: str, places: Callable[[SolidMesh, Facing], FacingPoints]
) -> None:
    """Nothing is lost between surfaces that do not match: force and moment are exact on both."""
    mesh = two_bricks(cell, *COUNTS[cell], gap=GAP)
    pairs = project(mesh, mesh.sides[0], places(mesh, mesh.sides[0]))
    solid = Solid.on(mesh, MPI.COMM_SELF, 2)
    pressure = 7.0
    force = (gap_rows(solid, pairs).T @ (pressure * pairs.weights)).reshape(-1, mesh.dim)
    x, upper = solid.coordinates, np.zeros(solid.n_nodes, dtype=np.bool_)
    upper[solid.nodes_of(np.flatnonzero(mesh.lamina == 1)).ravel()] = True
    for body, sign in ((upper, 1.0), (~upper, -1.0)):
        total = force[body].sum(axis=0)
        assert total[1] == pytest.approx(sign * pressure * AREA[mesh.dim], rel=ROUND_OFF)
        assert np.abs(np.delete(total, 1)).max() < ROUND_OFF
        moment = np.sum(x[body, 0] * force[body, 1])
        assert moment == pytest.approx(sign * pressure * AREA[mesh.dim] * 1.0, rel=ROUND_OFF)


def test_constant_pressure_on_quadratic_cells_is_not_uniform_deformation() -> None:
    """What points cannot do: the load of a pressure on a quadratic edge is 1/6, 4/6, 1/6.

    Pairs at vertices share it as 1/2, 0, 1/2. The mean pressure is exact, but each force makes a
    dent, whose depth falls with the size of the cells; in their middles the dents are smaller.
    """
    scatter = {}
    for places in (at_vertices, at_middles):
        for n in (8, 16):
            mesh = two_bricks("quadrilateral", (n, 4), (3, 1), gap=GAP)
            solid = Solid.on(mesh, MPI.COMM_SELF, 2)
            x = solid.coordinates
            free = np.repeat((x[:, 1] > ROUND_OFF) & (x[:, 1] < 0.5 + 0.5 * GAP), 2)
            K = solid.stiffness(np.ones(len(mesh.cells)), Elasticity.isotropic(solid.mesh, 0.0))
            rows, columns, values = K.getValuesCSR()
            K = sp.csr_matrix((values, columns, rows), shape=K.getSize())
            pairs = project(mesh, mesh.sides[0], places(mesh, mesh.sides[0]))
            load = gap_rows(solid, pairs).T @ pairs.weights
            u = np.zeros(free.size)
            u[free] = splu(K[free][:, free].tocsc()).solve(load[free])
            top = np.flatnonzero((np.abs(x[:, 1] - 0.5) < ROUND_OFF) & (np.abs(x[:, 0] - 1) < 0.6))
            depth = u[2 * top + 1]
            scatter[places, n] = np.ptp(depth)
    assert 0.3 < scatter[at_vertices, 16] / scatter[at_vertices, 8] < 0.7
    assert scatter[at_middles, 16] < 0.6 * scatter[at_vertices, 16]


def test_points_are_ordered_along_the_laminae() -> None:
    mesh = two_bricks("tetrahedron", (3, 1, 2), (2, 1, 1))
    mesh = moved(mesh, mesh.points * np.array([-1.0, 1.0, 1.0]))
    for places in (at_vertices, at_middles):
        x, z = places(mesh, mesh.sides[0]).x[:, [0, 2]].round(9).T
        assert np.all((np.diff(x) > 0.0) | ((np.diff(x) == 0.0) & (np.diff(z) > 0.0)))


def test_nearest_facet_opposite_counts() -> None:
    """Of two facets that face a point, above and far below it, the one above is opposite."""
    mesh = two_bricks("quadrilateral", (4, 1), (3, 1), gap=GAP)
    x = np.concatenate([mesh.points, [[0.0, -3.0], [2.0, -3.0], [0.0, -2.0], [2.0, -2.0]]])
    n = len(mesh.points)
    cells = np.concatenate([mesh.cells, n + np.arange(4)[None]])
    facets = np.concatenate([mesh.sides[0].upper, [[n, n + 1]]])
    facing = Facing((0, 1), mesh.sides[0].lower, facets)
    both = SolidMesh(x, cells, mesh.cell, np.append(mesh.lamina, 1), sides=(facing,))
    np.testing.assert_allclose(project(both, facing, at_vertices(both, facing)).gap, GAP)


def test_edges_of_a_bond_are_no_pairs() -> None:
    """The front of a delamination is an edge of both sides."""
    mesh = two_bricks("tetrahedron", (1, 1, 1), (1, 1, 1))
    sides = mesh.sides[0]
    front = [side[np.abs(mesh.points[side, 0]) < ROUND_OFF] for side in (sides.lower, sides.upper)]
    lower, upper = (np.unique(facets) for facets in front)
    to = np.arange(len(mesh.points))
    to[upper] = lower
    facing = Facing((0, 1), sides.lower, to[sides.upper])
    glued = SolidMesh(mesh.points, to[mesh.cells], mesh.cell, mesh.lamina, sides=(facing,))
    assert at_middles(mesh, sides).x[:, 0].min() == 0.0
    np.testing.assert_allclose(at_middles(glued, facing).x[:, 0], [1.0, 1.0, 1.0, 2.0])


def test_middles_of_triangles_are_those_of_their_edges() -> None:
    mesh = two_bricks("tetrahedron", (1, 1, 1), (1, 1, 1))
    points = at_middles(mesh, mesh.sides[0])
    np.testing.assert_allclose(points.x[:, 0], [0.0, 1.0, 1.0, 1.0, 2.0], atol=ROUND_OFF)
    np.testing.assert_allclose(points.x[:, 2], [0.0, -0.4, 0.0, 0.4, 0.0], atol=ROUND_OFF)
    shares = np.array([1, 1, 2, 1, 1]) * AREA[3] / 6.0
    np.testing.assert_allclose(points.weights, shares, atol=ROUND_OFF)


def part(x: Array) -> Part:
    """Return a part with given points."""
    n = x.size
    dofs = np.arange(2 * n).reshape(n, 2)
    return Part("a", x, dofs, np.ones(n - 1), np.ones(n - 1))


def test_pairs_of_a_row_share_their_station() -> None:
    parts = [part(np.linspace(0, 1, 5))] * 2
    pairing = interface(parts, (0, 1), np.repeat([0.25, 0.3, 1.0], 3))
    assert pairing.pairs == slice(0, 9)
    expected = np.repeat([1.0, 1.2, 4.0], 3)
    np.testing.assert_allclose(pairing.places, expected, atol=1e-12)
    assert interface(parts, (0, 1), np.array([0.25, 1.0])).places.tolist() == [1.0, 4.0]


def test_pairs_anywhere_belong_to_the_nearest_point() -> None:
    parts = [part(np.linspace(0, 1, 5))] * 2
    pairing = interface(parts, (0, 1), np.array([0.0, 0.11, 0.14, 0.9]), at=np.zeros((4, 2)))
    assert pairing.places.tolist() == [0.0, 0.0, 1.0, 4.0]
