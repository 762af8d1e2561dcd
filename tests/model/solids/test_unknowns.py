"""The free dofs of solids: their order, and matrices restricted to them."""

import numpy as np
import pytest
import scipy.sparse as sp

from delam_fem.api import MPI, preset
from delam_fem.model.solids.forms import Elasticity, Solid
from delam_fem.model.solids.meshing import lattice
from delam_fem.model.solids.unknowns import SHARED, Unknowns, held

CASES = {
    "apart": ("default", {}),
    "bonded": ("embedded", {}),
    "pinned": ("embedded", {"support.start": "pinned", "support.end": "pinned"}),
    "solid": ("embedded", {"model.kind": "solid", "support.start": "pinned"}),
}


@pytest.fixture(params=CASES)
def unknowns(request: pytest.FixtureRequest) -> Unknowns:
    """Return the unknowns of a small case."""
    name, overrides = CASES[request.param]
    base = {"model.kind": "plane-stress", "mesh.elements": 10}
    case = preset(name, {**base, **overrides})
    mesh = lattice(case)
    solid = Solid.on(mesh, MPI.COMM_SELF, 2)
    return Unknowns.of(solid, held(case, solid, 1.0 + mesh.lamina))


def test_restricted_matrices_are_those_of_the_transformation(unknowns: Unknowns) -> None:
    """S1 of unknowns.py, in dense matrices; T written down anew from what is held."""
    solid, supported = unknowns.solid, unknowns.held
    matrix = solid.stiffness(np.ones(len(solid.mesh.cells)), Elasticity.isotropic(solid.mesh, 0.3))
    indptr, columns, values = matrix.getValuesCSR()
    A = sp.csr_matrix((values, columns, indptr), shape=matrix.getSize()).toarray()
    restricted = unknowns.restricted(matrix)
    T = np.zeros((unknowns.n_dofs, unknowns.n_free))
    for column, dof in enumerate(unknowns.own):
        if dof not in supported.dofs:
            T[dof, column] = 1.0
            continue
        turning = supported.place == dof
        T[supported.dofs[turning], column] = supported.turn[turning]
    g = np.zeros(unknowns.n_dofs)
    g[supported.dofs] = supported.base
    scale = abs(A).max()
    np.testing.assert_allclose(restricted.rows.toarray(), T.T @ A @ T, atol=1e-12 * scale)
    np.testing.assert_allclose(restricted.column, T.T @ A @ g, atol=1e-12 * scale)
    assert restricted.corner == pytest.approx(g @ A @ g)
    np.testing.assert_allclose(unknowns.free.toarray(), T)
    np.testing.assert_allclose(unknowns.base, g)


def test_restricted_diagonals_are_those_of_the_transformation(unknowns: Unknowns) -> None:
    values = 1.0 + np.arange(unknowns.n_dofs)
    diagonal = unknowns.diagonal(values)
    T, g = unknowns.free.toarray(), unknowns.base
    np.testing.assert_allclose(diagonal.rows.toarray(), T.T @ np.diag(values) @ T)
    assert diagonal.corner == pytest.approx(g @ np.diag(values) @ g)
    assert not diagonal.column.any()


def test_the_order_follows_bodies_and_x(unknowns: Unknowns) -> None:
    solid = unknowns.solid
    nodes = unknowns.own // solid.dim
    bodies = np.full(solid.n_nodes, -1)
    bodies[solid.nodes_of(np.arange(len(solid.mesh.cells)))] = solid.mesh.bodies[:, None]
    steps = np.diff(solid.coordinates[nodes, 0])[np.diff(bodies[nodes]) == 0]
    assert steps.min() > -1e-9
    assert np.all(np.diff(bodies[nodes]) >= 0)
    assert sorted(np.unique(unknowns.parts)) == ([0, 1] if bodies.any() else [SHARED, 0, 1])


def test_matrices_of_slender_laminae_are_narrow_bands() -> None:
    case = preset("default", {"model.kind": "plane-stress", "mesh.elements": 40})
    solid = Solid.on(lattice(case), MPI.COMM_SELF, 2)
    unknowns = Unknowns.of(solid, held(case, solid, np.ones(80)))
    K = unknowns.restricted(
        solid.stiffness(np.ones(80), Elasticity.isotropic(solid.mesh, 0.0))
    ).rows.tocoo()
    assert abs(K.row - K.col).max() == 17  # three columns of three nodes
    assert unknowns.n_free == 2 * 2 * 3 * 80
