"""Meshes of solids: bodies, and the cells behind facets."""

import pytest
from box_meshes import two_bricks

from delam_fem.model.solids.mesh import FACETS, SolidMesh

COUNTS = {
    "triangle": (3, 2),
    "quadrilateral": (3, 2),
    "tetrahedron": (2, 2, 1),
    "hexahedron": (2, 2, 1),
}


@pytest.mark.parametrize("cell", COUNTS)
def test_cells_behind_the_facets_of_a_side(cell: str) -> None:
    mesh = two_bricks(cell, COUNTS[cell], COUNTS[cell])
    facets = mesh.sides[0].lower[:, ::-1]
    cells, numbers = mesh.cells_with(facets)
    for facet, cell_number, number in zip(facets, cells, numbers, strict=True):
        assert set(mesh.cells[cell_number][list(FACETS[cell][number])]) == set(facet)
        assert mesh.lamina[cell_number] == 0


def test_facets_inside_and_outside_are_refused() -> None:
    mesh = two_bricks("quadrilateral", (2, 1), (2, 1))
    inner = mesh.cells[0][[1, 3]]  # between the two cells of the lower body
    with pytest.raises(ValueError, match="between two"):
        mesh.cells_with(inner[None])
    with pytest.raises(ValueError, match="of none"):
        mesh.cells_with(mesh.cells[0][[0, 3]][None])


def test_bodies_are_numbered_in_the_order_of_their_cells() -> None:
    mesh = two_bricks("triangle", (3, 1), (2, 2))
    assert mesh.bodies.tolist() == mesh.lamina.tolist()
    turned = SolidMesh(mesh.points, mesh.cells[::-1], mesh.cell, mesh.lamina[::-1])
    assert turned.bodies.tolist() == [0] * 8 + [1] * 6
    glued = mesh.cells.copy()
    glued[glued == glued[-1, 0]] = 0
    assert not SolidMesh(mesh.points, glued, mesh.cell, mesh.lamina).bodies.any()


def test_arrays_that_do_not_fit_are_refused() -> None:
    mesh = two_bricks("quadrilateral", (2, 1), (2, 1))
    with pytest.raises(ValueError, match="lamina has shape"):
        SolidMesh(mesh.points, mesh.cells, mesh.cell, mesh.lamina[1:])
    with pytest.raises(ValueError, match="cells has shape"):
        SolidMesh(mesh.points, mesh.cells, "triangle", mesh.lamina)
    with pytest.raises(ValueError, match="points has shape"):
        SolidMesh(mesh.points, mesh.cells[:, [0, 1, 2, 3]], "tetrahedron", mesh.lamina)
    with pytest.raises(ValueError, match="does not exist"):
        SolidMesh(mesh.points[:3], mesh.cells, mesh.cell, mesh.lamina)
    with pytest.raises(ValueError, match="given 'pyramid'"):
        SolidMesh(mesh.points, mesh.cells, "pyramid", mesh.lamina)
