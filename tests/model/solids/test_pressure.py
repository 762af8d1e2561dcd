"""Contact pressure: its integral over both surfaces is the sum of the forces of the pairs."""

import numpy as np
import pytest
from box_meshes import two_bricks

from delam_fem.api import MPI, Body, FloatArray
from delam_fem.model import _dolfinx
from delam_fem.model.solids.body import Shape
from delam_fem.model.solids.facing import at_places, at_vertices, project
from delam_fem.model.solids.forms import Elasticity, Solid
from delam_fem.model.solids.mesh import FACETS

COUNTS = {
    "triangle": ((5, 2), (7, 1)),
    "quadrilateral": ((5, 2), (7, 1)),
    "tetrahedron": ((3, 2, 2), (4, 1, 3)),
    "hexahedron": ((3, 2, 2), (4, 1, 3)),
}
WIDTH = 0.25
AREA = {2: 2.0 * WIDTH, 3: 2.0 * 0.8}
HEIGHTS = (0.5, 0.6)
"""Of the lower and the upper surface."""


def shape_of(cell: str, degree: int = 2, *, inside: bool = False) -> Shape:
    """Return two boxes whose meshes do not match, with pairs at vertices or inside facets."""
    mesh = two_bricks(cell, *COUNTS[cell], gap=HEIGHTS[1] - HEIGHTS[0])
    facing = mesh.sides[0]
    x, z = np.linspace(0.05, 1.95, 14), np.linspace(-0.3, 0.35, 4)
    places = at_places(mesh, facing, x, z if mesh.dim == 3 else None)
    pairs = project(mesh, facing, places if inside else at_vertices(mesh, facing))
    solid = Solid.on(mesh, MPI.COMM_SELF, degree)
    E = np.ones(len(mesh.cells))
    none = np.zeros(mesh.dim * solid.n_nodes)
    width = np.array([WIDTH, 2.0 * WIDTH])
    body = Body(solid, None, none, E, Elasticity.isotropic(solid.mesh, 0.0), width, (pairs,))
    return body.shape()


def integral(shape: Shape, values: FloatArray, height: float) -> float:
    """Integrate values at points over a surface by dolfinx's basis, as fine quadrature does."""
    mesh = shape.mesh
    total, dim = 0.0, mesh.dim
    q, w = np.polynomial.legendre.leggauss(4)
    q, w = 0.5 + 0.5 * q, 0.5 * w
    for number, cell in enumerate(mesh.cells):
        for facet in FACETS[mesh.cell]:
            corners = mesh.points[cell[list(facet)]]
            if np.abs(corners[:, 1] - height).max() > 1e-12:
                continue
            total += _over_facet(shape, values[shape.cells[number]], (cell, facet), q, w)
    return total * (float(shape.width.min()) if dim == 2 else 1.0)


def _over_facet(
    shape: Shape,
    values: FloatArray,
    of: tuple[FloatArray, tuple[int, ...]],
    q: FloatArray,
    w: FloatArray,
) -> float:
    """Integrate over one facet, in reference coordinates of its cell."""
    cell, facet = of
    mesh, kind = shape.mesh, shape.mesh.cell
    dim = mesh.dim
    if kind in ("quadrilateral", "hexahedron"):
        every = np.array([[(v >> i) & 1 for i in range(dim)] for v in range(2**dim)], dtype=float)
    else:
        every = np.vstack([np.zeros(dim), np.eye(dim)])
    node_points, corners = every[list(facet)], mesh.points[cell[list(facet)]]
    edges, sides = (node_points[1:dim] - node_points[0], corners[1:dim] - corners[0])
    if dim == 2:
        s, weights, size = q[:, None], w, np.linalg.norm(sides[0])
    else:
        a, b = np.meshgrid(q, q, indexing="ij")
        both = np.outer(w, w).ravel()
        s, weights = np.column_stack([a.ravel(), b.ravel()]), both
        size = np.linalg.norm(np.cross(sides[0], sides[1]))
        if kind == "tetrahedron":
            weights = both * (1.0 - s[:, 0])
            s = np.column_stack([s[:, 0], s[:, 1] * (1.0 - s[:, 0])])
    table = _dolfinx.tabulate(kind, shape.degree, 0, node_points[0] + s @ edges)[0]
    return float(size * weights @ (table @ values))


@pytest.mark.parametrize("inside", [False, True])
@pytest.mark.parametrize("cell", COUNTS)
def test_pressure_integrates_to_the_forces_on_both_surfaces(cell: str, inside: bool) -> None:
    shape = shape_of(cell, inside=inside)
    (by_forces,) = shape.pressing
    forces = np.random.default_rng(5).uniform(0.5, 2.0, size=by_forces.shape[1])
    pressure = by_forces @ forces
    for height in HEIGHTS:
        assert integral(shape, pressure, height) == pytest.approx(forces.sum(), rel=1e-9)
    beside = ~np.isin(np.round(shape.points[:, 1], 9), HEIGHTS)
    assert beside.any()
    assert not pressure[beside].any()


@pytest.mark.parametrize("degree", [2, 3])
@pytest.mark.parametrize("cell", COUNTS)
def test_forces_by_tributary_area_give_uniform_pressure(cell: str, degree: int) -> None:
    """On the lower surface, whose vertices have the pairs."""
    shape = shape_of(cell, degree)
    (by_forces,) = shape.pressing
    weights = shape.touching[0].weights
    forces = 7.0 * weights * (WIDTH if shape.mesh.dim == 2 else 1.0)
    lower = np.abs(shape.points[:, 1] - HEIGHTS[0]) < 1e-12
    lower &= shape.lamina == 0
    assert lower.sum() > len(weights), "nodes between vertices too"
    np.testing.assert_allclose((by_forces @ forces)[lower], 7.0, rtol=1e-9)
    assert forces.sum() == pytest.approx(7.0 * AREA[shape.mesh.dim], rel=1e-9)


@pytest.mark.parametrize("cell", ["quadrilateral", "hexahedron"])
def test_a_force_presses_where_it_acts(cell: str) -> None:
    shape = shape_of(cell)
    (by_forces,) = shape.pressing
    pairs = shape.touching[0]
    middle = int(np.argmin(np.linalg.norm(pairs.lower.x - pairs.lower.x.mean(axis=0), axis=1)))
    pressure = by_forces[:, middle].toarray().ravel()
    for height in HEIGHTS:
        on = np.abs(shape.points[:, 1] - height) < 1e-12
        centre = pressure[on] @ shape.points[on] / pressure[on].sum()
        assert abs(centre[0] - pairs.x[middle]) < 0.25
        assert pressure[on].min() > -1e-12
