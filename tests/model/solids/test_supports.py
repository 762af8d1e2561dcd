"""Held ends of solids: clamped, pinned, free; the neutral axis."""

import numpy as np
import pytest
from box_meshes import two_bricks

from delam_fem.api import MPI, CaseError, preset
from delam_fem.model.solids.body import surface
from delam_fem.model.solids.forms import Solid
from delam_fem.model.solids.meshing import lattice
from delam_fem.model.solids.unknowns import Held, Unknowns, held, neutral_axis

EMBEDDED = {"model.kind": "plane-stress", "mesh.elements": 10}


def of(name: str, overrides: dict[str, object], modulus: tuple[float, float]) -> Unknowns:
    """Return the unknowns of a preset whose two laminae have some moduli."""
    case = preset(name, overrides)
    mesh = lattice(case)
    solid = Solid.on(mesh, MPI.COMM_SELF, 2)
    return Unknowns.of(solid, held(case, solid, np.array(modulus)[mesh.lamina]))


def positions(unknowns: Unknowns, held: Held) -> np.ndarray:
    """Return x, y, … of the nodes of held dofs."""
    return unknowns.solid.coordinates[held.dofs // unknowns.solid.dim]


def test_clamped_ends_follow_the_base_along_y_alone() -> None:
    unknowns = of("embedded", EMBEDDED, (1.0, 1.0))
    supported = unknowns.held
    assert supported.dofs.size == 2 * 2 * 5  # two ends of two cells, each with 2 dofs at 5 heights
    at = positions(unknowns, supported)
    assert set(np.round(at[:, 0], 12)) == {0.0, 0.4}
    np.testing.assert_array_equal(supported.base, supported.dofs % 2)
    assert np.all(supported.place == -1) and not supported.turn.any()
    assert unknowns.n_free == unknowns.n_dofs - supported.dofs.size


def test_free_ends_are_not_held() -> None:
    unknowns = of("default", {"model.kind": "plane-stress", "mesh.elements": 10}, (1.0, 1.0))
    supported = unknowns.held
    assert supported.dofs.size == 2 * 2 * 3
    np.testing.assert_allclose(positions(unknowns, supported)[:, 0], 0.0, atol=1e-12)


def test_a_pinned_end_turns_about_its_neutral_axis() -> None:
    ends = {"support.start": "pinned", "support.end": "free"}
    unknowns = of("embedded", {**EMBEDDED, **ends}, (1.0, 3.0))
    supported, h = unknowns.held, (0.0014, 0.0006)
    axis = (h[0] * 0.7e-3 + 3.0 * h[1] * 1.7e-3) / (h[0] + 3.0 * h[1])
    height = positions(unknowns, supported)[:, 1]
    along = supported.dofs % 2 == 0
    np.testing.assert_allclose(supported.turn[along], axis - height[along])
    assert np.unique(supported.place[along]).size == 1 and np.all(supported.place[~along] == -1)
    assert unknowns.n_free == unknowns.n_dofs - supported.dofs.size + 1


def test_laminae_that_are_apart_at_a_pinned_end_turn_alone() -> None:
    ends = {"support.start": "pinned", "support.end": "pinned"}
    opening = {"delamination.1.start": 0.0, "delamination.1.end": 0.16}
    unknowns = of("embedded", {**EMBEDDED, **ends, **opening}, (1.0, 1.0))
    places = np.unique(unknowns.held.place[unknowns.held.place >= 0])
    assert places.size == 3
    supported = unknowns.held
    at = positions(unknowns, supported)
    for low, high in ((0.0, 0.0014), (0.0014, 0.0020)):  # the lower and the upper one at x = 0
        inside = (at[:, 1] > low + 1e-6) & (at[:, 1] < high - 1e-6) & (at[:, 0] < 0.1)
        np.testing.assert_allclose(supported.turn[inside], 0.0, atol=1e-12)  # their middles


@pytest.mark.parametrize("cell", ["triangle", "quadrilateral", "tetrahedron", "hexahedron"])
def test_neutral_axis_of_all_facets(cell: str) -> None:
    """Of two boxes of height 0.5, the upper one 0.1 above the other and 4 times as stiff."""
    dim = 2 if cell in ("triangle", "quadrilateral") else 3
    mesh = two_bricks(cell, (1, 2, 3)[:dim], (1, 3, 2)[:dim], gap=0.1)
    facets = surface(mesh, np.ones(len(mesh.cells), dtype=bool))
    end = facets[np.all(mesh.points[facets][..., 0] == 0.0, axis=1)]
    stiff = np.where(mesh.lamina == 0, 1.0, 4.0)
    assert neutral_axis(mesh, end, stiff) == pytest.approx((0.25 + 4.0 * 0.85) / 5.0)


def test_an_end_without_facets_is_refused() -> None:
    case = preset("embedded", EMBEDDED)
    solid = Solid.on(two_bricks("quadrilateral", (2, 1), (2, 1)), MPI.COMM_SELF, 2)
    with pytest.raises(CaseError, match=r'support.start: the mesh has no facets "start"'):
        held(case, solid, np.ones(4))
