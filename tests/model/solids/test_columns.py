"""Displacements relative to columns through the thickness: the same solid with less round-off."""

import numpy as np
import pytest
import scipy.sparse as sp
from box_meshes import two_bricks

from delam_fem.api import MPI, preset
from delam_fem.model.solids import unknowns
from delam_fem.model.solids.assembly import assemble
from delam_fem.model.solids.forms import Elasticity, Solid
from delam_fem.model.solids.mesh import SolidMesh
from delam_fem.model.solids.meshing import lattice
from delam_fem.model.solids.unknowns import NodeColumns

COUNTS = {"quadrilateral": (3, 2), "hexahedron": (2, 2, 1)}
ROUND_OFF = 1e-12
NU = 0.3


def csr(matrix: object) -> sp.csr_matrix:
    """Return a PETSc matrix as a sparse matrix of SciPy, and destroy it."""
    indptr, indices, values = matrix.getValuesCSR()  # type: ignore[attr-defined]
    shape = matrix.getSize()  # type: ignore[attr-defined]
    matrix.destroy()  # type: ignore[attr-defined]
    return sp.csr_matrix((values, indices, indptr), shape=shape)


@pytest.fixture(
    params=[(c, d) for c in COUNTS for d in (2, 3)], ids=lambda own: f"{own[0]}-{own[1]}"
)
def solid(request: pytest.FixtureRequest) -> Solid:
    """Return a solid of two boxes, 2 x 0.5 (x 0.8) each, the upper one with other cells."""
    cell, degree = request.param
    other = (2, *COUNTS[cell][1:])
    return Solid.on(two_bricks(cell, COUNTS[cell], other, gap=0.1), MPI.COMM_SELF, degree)


def test_nodes_of_a_column_are_those_above_one_another(solid: Solid) -> None:
    columns = NodeColumns.of(solid, np.zeros(0, dtype=np.int64))
    at = solid.coordinates
    upper = at[:, 1] > 0.55
    along = np.delete(at, 1, axis=1)
    np.testing.assert_allclose(along, along[columns.reference], atol=ROUND_OFF)
    np.testing.assert_array_equal(upper, upper[columns.reference])
    heights = 1 + 2 * solid.degree  # of two cells
    _, sizes = np.unique(columns.reference, return_counts=True)
    assert set(sizes) == {heights}


def test_columns_of_held_nodes_keep_their_displacements(solid: Solid) -> None:
    clamped = np.flatnonzero(solid.coordinates[:, 0] < ROUND_OFF)
    columns = NodeColumns.of(solid, clamped[:1])
    at_end = columns.reference == np.arange(solid.n_nodes)
    beside = np.delete(solid.coordinates, 1, axis=1)
    is_same = np.all(np.abs(beside - beside[clamped[0]]) < ROUND_OFF, axis=1)
    is_same &= (solid.coordinates[:, 1] > 0.55) == (solid.coordinates[clamped[0], 1] > 0.55)
    assert np.all(at_end[is_same])
    assert np.unique(columns.reference[is_same]).size == 1 + 2 * solid.degree


def test_stiffness_is_that_of_the_solid(solid: Solid) -> None:
    """K_d = Tᵀ K T, and u = T d."""
    clamped = np.flatnonzero(solid.coordinates[:, 0] < ROUND_OFF)
    E = 1.0 + np.arange(len(solid.mesh.cells))
    columns = NodeColumns.of(solid, clamped)
    assert not columns.is_plain
    T, K = (
        columns.transformation(np.arange(solid.n_nodes)),
        csr(solid.stiffness(E, Elasticity.isotropic(solid.mesh, NU))),
    )
    stiffness = csr(columns.stiffness(E, Elasticity.isotropic(solid.mesh, NU)))
    assert abs(stiffness - T.T @ K @ T).max() < ROUND_OFF * abs(K).max()
    d = np.arange(solid.n_nodes * solid.dim, dtype=float).reshape(-1, solid.dim)
    u = (T @ d.ravel()).reshape(d.shape)
    moved = columns.reference != np.arange(solid.n_nodes)
    np.testing.assert_array_equal(u[moved], d[moved] + d[columns.reference[moved]])
    np.testing.assert_array_equal(u[~moved], d[~moved])


def test_skewed_and_split_cells() -> None:
    """Cells whose edges are not upright, and laminae whose columns reach through both."""
    mesh = two_bricks("quadrilateral", (3, 2), (2, 1))
    points = mesh.points.copy()
    points[:, 0] += 0.1 * points[:, 1] ** 2 * (points[:, 0] > 1.0)
    skewed = SolidMesh(points, mesh.cells, mesh.cell, mesh.lamina)
    for solid_mesh in (
        skewed,
        lattice(preset("embedded", {"model.kind": "solid", "mesh.elements": 8})),
    ):
        solid = Solid.on(solid_mesh, MPI.COMM_SELF, 2)
        columns = NodeColumns.of(solid, np.zeros(0, dtype=np.int64))
        E = np.ones(len(solid_mesh.cells))
        T, K = (
            columns.transformation(np.arange(solid.n_nodes)),
            csr(solid.stiffness(E, Elasticity.isotropic(solid.mesh, NU))),
        )
        assert (
            abs(csr(columns.stiffness(E, Elasticity.isotropic(solid.mesh, NU))) - T.T @ K @ T).max()
            < 1e-11 * abs(K).max()
        )
    triangles = Solid.on(two_bricks("triangle", (3, 2), (2, 1)), MPI.COMM_SELF, 2)
    assert NodeColumns.of(triangles, np.zeros(0, dtype=np.int64)).is_plain


def test_many_cells_are_summed_in_portions(solid: Solid, monkeypatch: pytest.MonkeyPatch) -> None:
    columns, E = NodeColumns.of(solid, np.arange(1)), 1.0 + np.arange(len(solid.mesh.cells))
    stiffness = csr(columns.stiffness(E, Elasticity.isotropic(solid.mesh, NU)))
    monkeypatch.setattr(unknowns, "_MOST_ENTRIES", 1)
    assert (
        abs(csr(columns.stiffness(E, Elasticity.isotropic(solid.mesh, NU))) - stiffness).max()
        < ROUND_OFF * abs(stiffness).max()
    )


def test_a_moving_base_strains_a_thin_sheet_less_than_round_off_of_plain_dofs() -> None:
    """With cells of 1 mm x 68.5 mm: error of K⁻¹ k_b, the same dofs as displacements of nodes."""
    errors = []
    for impulse in ("consistent", "lumped"):
        keys = {"model.kind": "plane-stress", "mesh.elements": 10, "contact.impulse": impulse}
        structure = assemble(preset("default", keys))
        o = structure.operators
        assert (o.lumped_mass is None) == (impulse == "consistent")
        iota = np.linalg.solve(o.stiffness.toarray(), -o.base.stiffness)
        read = structure.layout.read(iota[None], np.ones(1))[0, ::2]
        errors.append(float(np.abs(read - 1.0).max()))
    assert errors[0] < 1e-6 and errors[0] < 0.05 * errors[1]
