"""Plates: meshes with patches, edges of all kinds, what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
from plates import EDGES, LENGTH, RHO, THICKNESS, bending, plate, radius_of, write_disc

from delam_fem.api import Case, CaseError, assemble, lowest, volumes
from delam_fem.model.contacts import pairs_of_contacts
from delam_fem.model.mesh import GRADING, graded
from delam_fem.model.solids.mesh import SolidMesh
from delam_fem.model.solids.meshing import lattice

Array = npt.NDArray[np.float64]
LAYERS = (0.0014, 0.0006)
BETWEEN = ["lower", "upper"]
PATCH = {"between": BETWEEN, "start": 0.06, "end": 0.12, "across": [-0.03, 0.01]}
WHOLE = {key: value for key, value in PATCH.items() if key != "across"}
ROUND_OFF = 1e-9


def stacked(*patches: dict[str, object], elements: int = 12, across: int = 10) -> Case:
    """Return a clamped plate of two laminae with patches."""
    kinds = {"start": "clamped", "end": "clamped"}
    size = {"width": 0.15, "thicknesses": LAYERS}
    return plate(kinds, elements, across, delamination=list(patches), **size)  # type: ignore[arg-type]


def area(mesh: SolidMesh, facets: npt.NDArray[np.int64]) -> float:
    """Return the area of horizontal quadrilaterals in tensor order."""
    x, z = mesh.points[facets][..., [0, 2]].transpose(2, 0, 1)
    return float(
        0.5 * np.abs((x[:, 3] - x[:, 0]) * (z[:, 2] - z[:, 1])
                     - (x[:, 2] - x[:, 1]) * (z[:, 3] - z[:, 0])).sum()
    )  # fmt: skip


@pytest.mark.parametrize(("shape", "factor"), [("rectangle", 1.0), ("ellipse", 0.25 * np.pi)])
def test_a_patch_is_open_within_its_outline_alone(shape: str, factor: float) -> None:
    case = stacked({**PATCH, "shape_in_plane": shape})
    mesh = lattice(case)
    sides = mesh.sides[0]
    for facets in (sides.lower, sides.upper):
        assert area(mesh, facets) == pytest.approx(factor * 0.06 * 0.04, rel=ROUND_OFF)
    assert not mesh.bodies.any()
    shared = np.intersect1d(sides.lower, sides.upper)
    along, over = case.delamination[0].local(*mesh.points[shared][:, [0, 2]].T)
    size = np.hypot(along, over) if shape == "ellipse" else np.maximum(abs(along), abs(over))
    np.testing.assert_allclose(size, size[0], rtol=ROUND_OFF)
    inside = np.setdiff1d(sides.lower, shared)
    assert np.all(case.delamination[0].contains(*mesh.points[inside][:, [0, 2]].T))
    assert np.all(volumes(mesh) > 0.0)
    assert volumes(mesh).sum() == pytest.approx(0.2 * 0.15 * 0.002)


def test_patches_at_several_interfaces_overlap() -> None:
    laminae = (0.001, 0.0005, 0.0005)
    patches = [
        {"between": ["lower", "upper"], "start": 0.04, "end": 0.10, "across": [-0.05, 0.0]},
        {"between": ["upper", "cover"], "start": 0.08, "end": 0.14, "across": [-0.02, 0.03]},
        {"between": ["upper", "cover"], "start": 0.04, "end": 0.06, "across": [-0.02, 0.03]},
    ]
    case = plate({"start": "clamped"}, 14, 10, thicknesses=laminae, delamination=patches)
    mesh = lattice(case)
    lower, upper = mesh.sides
    assert area(mesh, lower.lower) == pytest.approx(0.06 * 0.05)
    assert area(mesh, upper.lower) == pytest.approx(0.06 * 0.05 + 0.02 * 0.05)
    np.testing.assert_allclose(mesh.points[lower.lower][..., 1], 0.001)
    np.testing.assert_allclose(mesh.points[upper.lower][..., 1], 0.0015)


def test_cells_are_finer_at_the_edges_of_patches() -> None:
    x = graded(np.array([0.0, 0.4, 1.0]), 20, "mesh.elements", [0.4])
    h = np.diff(x)
    edge = int(np.argmin(np.abs(x - 0.4)))
    assert x[edge] == 0.4 and x.size == 21
    assert np.all(np.diff(h[:edge]) < 0.0) and np.all(np.diff(h[edge:]) > 0.0)
    steepest = (1.0 + GRADING) / (1.0 - GRADING)
    assert 0.8 * steepest < h[-1] / h[edge] < steepest
    np.testing.assert_allclose(
        graded(np.array([0.0, 1.0]), 5, "mesh.elements", []), np.linspace(0.0, 1.0, 6)
    )


def test_pairs_and_openings_are_those_of_their_patch() -> None:
    """Two patches of one interface beside one another across the width."""
    first = {**PATCH, "across": [-0.06, -0.02], "opening": 1e-4}
    second = {
        **PATCH, "across": [0.02, 0.06], "opening": 2e-4, "shape_in_plane": "ellipse",
        "restitution": 0.5,
    }  # fmt: skip
    case = stacked(first, second, elements=12, across=16)
    structure = assemble(case)
    (interface,) = structure.layout.interfaces
    x, z = structure.layout.positions_of(interface)
    gap = structure.operators.gap0
    pairs = {key: rows for key, _, rows in pairs_of_contacts(structure.layout, case)}
    assert np.all(z[pairs["delamination.1"]] < 0.0) and np.all(z[pairs["delamination.2"]] > 0.0)
    assert sum(rows.size for rows in pairs.values()) == gap.size
    s, t = (x - 0.09) / 0.03, (np.abs(z) - 0.04) / 0.02
    arch = np.where(
        z < 0.0,
        1e-4 * np.cos(0.5 * np.pi * s) * np.cos(0.5 * np.pi * t),
        2e-4 * np.cos(0.5 * np.pi * np.hypot(s, t)),
    )
    np.testing.assert_allclose(gap, arch, atol=1e-12)
    weights = structure.operators.pair_weights
    assert weights is not None
    numbers = structure.operators.pair_numbers
    assert numbers is not None
    np.testing.assert_array_equal(np.isnan(numbers.restitution), z < 0.0)


def navier(width: float, n: int) -> Array:
    """Return the lowest frequencies of a simply supported thin plate [Hz]."""
    D, m = bending()
    p = np.arange(1, 6)
    squares = (p[:, None] / LENGTH) ** 2 + (p / width) ** 2
    return np.asarray(np.sort(0.5 * np.pi * np.sqrt(D / m) * squares.ravel())[:n])


def frequencies(case: Case, n: int) -> Array:
    """Return the lowest frequencies of a case [Hz]."""
    o = assemble(case).operators
    return lowest(o.stiffness, o.mass, n, is_floating=case.n_rigid > 0)[0]


def thick(width: float, k: tuple[int, int]) -> float:
    """Return the share by which shear and rotary inertia lower a frequency of a plate.

    Of first order in h² (R. D. Mindlin, J. Appl. Mech. 18 (1951) 31), shear factor 5/6.
    """
    square = (k[0] * np.pi / LENGTH) ** 2 + (k[1] * np.pi / width) ** 2
    shear = 2.0 / (5.0 / 6.0 * (1.0 - 0.3))  # D/(κ G h) = h²/12 of this
    return float(-0.5 * THICKNESS**2 / 12.0 * square * (1.0 + shear))


def test_a_simply_supported_plate_has_the_frequencies_of_navier_and_mindlin() -> None:
    case = plate(dict.fromkeys(EDGES, "pinned"), 6, 4, width=0.15, degree=3)
    computed = frequencies(case, 2)
    exact = navier(0.15, 2)
    np.testing.assert_allclose(computed, exact, rtol=0.005)
    expected = [exact[0] * (1.0 + thick(0.15, (1, 1))), exact[1] * (1.0 + thick(0.15, (2, 1)))]
    np.testing.assert_allclose(computed[0], expected[0], rtol=2e-4)  # half of what shear takes
    np.testing.assert_allclose(computed[1], expected[1], rtol=6e-4)


def test_turning_the_plate_turns_its_edges() -> None:
    """Edges along x and edges along z are treated alike."""
    upright = plate({"start": "clamped", "left": "pinned"}, 4, 4)
    turned = plate({"left": "clamped", "start": "pinned"}, 4, 4)
    np.testing.assert_allclose(frequencies(upright, 4), frequencies(turned, 4), rtol=1e-8)


def test_elastic_edges_go_from_free_to_pinned_and_clamped() -> None:
    """A spring of an edge is spread evenly along it: its stiffness is that of the whole edge."""
    soft = {"kind": "spring", "stiffness": 100.0}
    case = plate(dict.fromkeys(("left", "right"), soft), 2, 2)
    mass = RHO * THICKNESS * LENGTH**2
    rises = frequencies(case, 6)  # in the plane nothing holds it
    # rise: 200 over m; turn about z: 200 L²/12 over m L²/12; about x: 200 L²/4 over m L²/12
    exact = np.sqrt(np.array([200.0, 200.0, 600.0]) / mass) / (2.0 * np.pi)
    np.testing.assert_allclose(rises[3:6], exact, rtol=2e-3)
    assert case.n_rigid == 3
    stiff = {"kind": "spring", "stiffness": 1e9}
    sprung = plate({"start": stiff, "end": stiff, "left": "pinned", "right": "pinned"}, 4, 4)
    pinned = plate(dict.fromkeys(EDGES, "pinned"), 4, 4)
    np.testing.assert_allclose(frequencies(sprung, 2), frequencies(pinned, 2), rtol=0.01)
    yielding = {"kind": "pinned", "rotational_stiffness": 1e7}
    clamp = plate({"start": yielding, "end": "pinned"}, 4, 4)
    rigid = plate({"start": "clamped", "end": "pinned"}, 4, 4)
    np.testing.assert_allclose(frequencies(clamp, 2), frequencies(rigid, 2), rtol=0.01)


@pytest.mark.parametrize(
    ("supports", "count"),
    [({}, 6), ({"left": "clamped"}, 0), ({"left": "pinned"}, 1), ({"start": "pinned"}, 1),
     ({"start": "pinned", "right": "pinned"}, 0)],
)  # fmt: skip
def test_rigid_motions_are_counted(supports: dict[str, str], count: int) -> None:
    case = plate(supports, 2, 2)
    assert case.n_rigid == count
    first = frequencies(case, count + 1)
    assert np.all(first[:count] < 1e-3) and first[count] > 10.0


LEISSA_CLAMPED = (35.985, 73.394, 73.394)
LEISSA_FREE = (13.468, 19.596, 24.270)
"""ω a² √(ρh/D) of square plates, ν = 0.3: A. W. Leissa, J. Sound Vib. 31 (1973) 257, tables C1 and
C21 with more digits of others; thin plates."""
ROUND = (10.2158, 21.26, 21.26, 34.88)
"""λ² of clamped round plates: A. W. Leissa, "Vibration of Plates" (NASA SP-160), table 2.1."""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "meshes", "exact"),
    [("clamped", (8, 12), LEISSA_CLAMPED), ("free", (4, 8), LEISSA_FREE)],
)
def test_square_plates_have_the_frequencies_of_leissa(
    kind: str, meshes: tuple[int, int], exact: tuple[float, ...]
) -> None:
    D, m = bending()
    errors = []
    for n in meshes:
        case = plate(dict.fromkeys(EDGES, kind), n, n, degree=3)
        f = frequencies(case, case.n_rigid + 3)[case.n_rigid :]
        errors.append(2.0 * np.pi * f * LENGTH**2 / np.sqrt(D / m) / np.array(exact) - 1.0)
    assert np.abs(errors[1]).max() < 0.005
    assert np.all(errors[1] < errors[0])  # from above; thin plates know no shear, which lowers them


@pytest.mark.slow
def test_a_round_clamped_plate_from_an_own_mesh(tmp_path: Path) -> None:
    errors = []
    for n in (4, 8):
        path = write_disc(tmp_path / f"{n}.msh", 0.5 * LENGTH, 0.001, n)
        case = plate({"rim": "clamped"}, thicknesses=(0.001,), degree=3, mesh={"file": str(path)})
        D, m = bending(0.001)
        scale = radius_of(0.5 * LENGTH, n) ** 2 / np.sqrt(D / m)
        errors.append(2.0 * np.pi * frequencies(case, 4) * scale / np.array(ROUND) - 1.0)
    assert np.abs(errors[1]).max() < 0.005
    assert np.all(np.abs(errors[1]) < 0.5 * np.abs(errors[0]))


def test_a_pinned_curved_edge_is_refused(tmp_path: Path) -> None:
    path = write_disc(tmp_path / "disc.msh", 0.5 * LENGTH, 0.001, 2)
    case = plate({"rim": "pinned"}, thicknesses=(0.001,), mesh={"file": str(path)})
    with pytest.raises(CaseError, match=r"support\.side: expected straight sides .* 'rim'"):
        assemble(case)


def test_a_group_that_the_mesh_lacks_is_refused(tmp_path: Path) -> None:
    path = write_disc(tmp_path / "disc.msh", 0.5 * LENGTH, 0.001, 2)
    case = plate({"edge": "clamped"}, thicknesses=(0.001,), mesh={"file": str(path)})
    with pytest.raises(CaseError, match=r"group 'edge' of quad cells, found the groups: 'rim'"):
        assemble(case)


BEAM = {"model": {"kind": "beam"}}
PLANE = {"model": {"kind": "plane-stress"}}


@pytest.mark.parametrize(
    ("key", "sections", "words"),
    [
        ("mesh.across", BEAM, 'expected only with model.kind = "solid", of a plate, given "beam"'),
        ("mesh.across", PLANE, "given \"plane-stress\""),
        ("delamination.1.across", {"mesh": {"elements": 8}}, "give mesh.across"),
        ("delamination.1.across", {"delamination": [{**PATCH, "across": [0.0, 0.2]}]},
         r"expected places from -0.1 to 0.1 m"),
        ("delamination.1.across", {"delamination": [{**PATCH, "across": [0.01, 0.0]}]},
         "the smaller one first"),
        ("delamination.1.shape_in_plane",
         {"delamination": [{**WHOLE, "shape_in_plane": "ellipse"}]},
         "expected only beside across"),
        ("delamination.1.shape", {"delamination": [{**PATCH, "shape": "power"}]}, "half-cosine"),
        ("support.1.side", {"support": [{"side": "top", "kind": "pinned"}]},
         "expected one of start, end, left, right"),
        ("support.*lamina",
         {"support": [{"side": "left", "kind": "spring", "stiffness": 1.0, "lamina": "lower"}]},
         "expected none at an edge"),
        ("support.side",
         {"support": [{"side": "left", "kind": "pinned"}, {"side": "left", "kind": "clamped"}]},
         "expected one"),
        ("contact.points_per_element", {"contact": {"law": "none", "points_per_element": 2}},
         "expected 1 with plates"),
        ("gap", {"gap": {"tip": 0.01}, "delamination": []}, "expected \\[\\[delamination\\]\\]"),
    ],
)  # fmt: skip
def test_what_plates_refuse(key: str, sections: dict[str, object], words: str) -> None:
    tables: dict[str, object] = {"delamination": [PATCH], **sections}
    with pytest.raises(CaseError, match=rf"{key}.*: .*{words}"):
        plate({"start": "clamped"}, thicknesses=LAYERS, **tables)


def test_ellipses_that_meet_an_outline_or_fold_cells_are_refused() -> None:
    ellipse = {**PATCH, "shape_in_plane": "ellipse"}
    touching = {**ellipse, "across": [-0.075, 0.0]}
    with pytest.raises(CaseError, match=r"delamination\.1\.shape_in_plane: .* edge of the plate"):
        lattice(stacked(touching))
    crossing = {"between": BETWEEN, "start": 0.12, "end": 0.15, "across": [-0.02, 0.0]}
    with pytest.raises(CaseError, match=r"between the same laminae|outline of another patch"):
        lattice(stacked(ellipse, crossing))


def test_patches_at_mirrored_places_have_the_same_frequencies() -> None:
    left = stacked({**PATCH, "across": [-0.05, -0.01]}, elements=8, across=8)
    right = stacked({**PATCH, "across": [0.01, 0.05]}, elements=8, across=8)
    np.testing.assert_allclose(frequencies(left, 4), frequencies(right, 4), rtol=1e-9)
