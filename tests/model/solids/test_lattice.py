"""Structured meshes of cases: vertices that bonded laminae share, sides, ends."""

import numpy as np
import pytest

from delam_fem.api import Case, CaseError, preset
from delam_fem.model.solids.mesh import FACETS, SolidMesh
from delam_fem.model.solids.meshing import MOST_DOFS, bonded_cells, lattice


def plane(name: str, **overrides: object) -> Case:
    """Return a preset in plane stress."""
    keys = {key.replace("__", "."): value for key, value in overrides.items()}
    return preset(name, {"model.kind": "plane-stress", "mesh.elements": 10, **keys})


def boundary(mesh: SolidMesh) -> set[tuple[int, ...]]:
    """Return the facets that belong to one cell only."""
    facets = np.concatenate([mesh.cells[:, list(facet)] for facet in FACETS[mesh.cell]])
    distinct, count = np.unique(np.sort(facets, axis=1), axis=0, return_counts=True)
    return {tuple(facet) for facet in distinct[count == 1].tolist()}


def volume(mesh: SolidMesh) -> float:
    """Return the area or volume of all boxes, negative ones counted as such."""
    corners = mesh.points[mesh.cells]
    edges = corners[:, [1, 2, 4][: mesh.dim]] - corners[:, :1]
    return float(np.linalg.det(edges).sum())


def test_laminae_that_are_apart_are_separate_bodies() -> None:
    case = plane("default", model__layers=2)
    mesh = lattice(case)
    assert mesh.bodies.tolist() == mesh.lamina.tolist() == [0] * 20 + [1] * 20
    assert len(mesh.points) == 2 * 11 * 3
    assert volume(mesh) == pytest.approx(0.685 * 0.003)
    heights = mesh.points[:, 1]
    assert (heights.min(), heights.max()) == (0.0, pytest.approx(0.003))
    ends = {name: mesh.points[facets][..., 0] for name, facets in mesh.supports.items()}
    assert np.all(ends["start"] == 0.0) and np.all(ends["end"] == 0.685)
    assert len(mesh.supports["start"]) == len(mesh.supports["end"]) == 4


def test_a_delamination_has_doubled_vertices_and_shared_ones_at_its_edges() -> None:
    mesh = lattice(plane("embedded"))  # from 0.12 to 0.28 of 0.4
    assert not mesh.bodies.any()
    assert len(mesh.points) == 3 * 11 + 3
    sides = mesh.sides[0]
    assert sides.parts == (0, 1)
    for facets in (sides.lower, sides.upper):
        x = mesh.points[facets]
        assert (x[..., 0].min(), x[..., 0].max()) == pytest.approx((0.12, 0.28))
        np.testing.assert_allclose(x[..., 1], 0.0014)
    shared = np.intersect1d(sides.lower, sides.upper)
    np.testing.assert_allclose(mesh.points[shared, 0], [0.12, 0.28])
    assert {tuple(f) for f in np.sort(sides.lower, axis=1).tolist()} <= boundary(mesh)
    assert mesh.cells_with(sides.lower)[0].max() < 10 <= mesh.cells_with(sides.upper)[0].min()


def test_a_delamination_that_reaches_a_free_end_is_open_there() -> None:
    case = plane("embedded", support__end="free", delamination=[
        {"between": ["lower", "upper"], "start": 0.2, "end": 0.4}
    ])  # fmt: skip
    mesh = lattice(case)
    assert len(mesh.points) == 3 * 11 + 5
    bonded = bonded_cells(case, np.linspace(0.0, 0.4, 11))
    assert bonded[:, :, 0].tolist() == [[True] * 5 + [False] * 5]
    tips = mesh.points[mesh.supports["end"].ravel()]
    assert np.unique(mesh.supports["end"]).size == len(tips) == 4


def test_in_3d_the_width_is_centred_and_cells_are_in_tensor_order() -> None:
    case = plane("embedded", model__kind="solid", model__strips=2, mesh__elements=10)
    mesh = lattice(case)
    assert mesh.cell == "hexahedron"
    assert len(mesh.points) == 3 * (3 * 11 + 3)
    assert volume(mesh) == pytest.approx(0.4 * 0.020 * 0.0020)
    z = mesh.points[:, 2]
    assert (z.min(), z.max()) == pytest.approx((-0.010, 0.010))
    corner = mesh.points[mesh.cells[0]] - mesh.points[mesh.cells[0, 0]]
    np.testing.assert_allclose(corner[[1, 2, 4]], np.diag([0.04, 0.0014, 0.010]))
    np.testing.assert_allclose(corner[7], [0.04, 0.0014, 0.010])
    sides = mesh.sides[0]
    assert sides.lower.shape == sides.upper.shape == (4 * 2, 4)
    assert {tuple(f) for f in np.sort(sides.upper, axis=1).tolist()} <= boundary(mesh)
    np.testing.assert_allclose(mesh.points[sides.lower], mesh.points[sides.upper])


def test_bonded_laminae_of_different_widths_are_refused_in_3d() -> None:
    wide = {"lamina.1.width": 0.03, "model.kind": "solid"}
    with pytest.raises(CaseError, match=r"lamina.upper.width: "):
        lattice(preset("embedded", wide))
    assert lattice(preset("default", wide)).cell == "hexahedron"


def test_a_mesh_beyond_memory_is_refused_before_it_is_made() -> None:
    case = plane("default", model__kind="solid", mesh__elements=1000, model__strips=100)
    with pytest.raises(CaseError, match=f"mesh.elements: expected at most {MOST_DOFS} unknowns"):
        lattice(case)
