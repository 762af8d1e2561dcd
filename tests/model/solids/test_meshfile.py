"""Solid meshes from files: groups, kinds of cells, orientation, what is refused."""

from collections.abc import Callable
from pathlib import Path

import meshio
import numpy as np
import numpy.typing as npt
import pytest
from box_meshes import MESHES, case_of
from mpi_pool import Crew
from project import ROOT

from delam_fem.api import Case, CaseError, assemble, preset, run, solid_mesh, volumes
from delam_fem.model import linear
from delam_fem.model.solids import meshing
from delam_fem.model.solids.facing import at_vertices, project
from delam_fem.model.solids.mesh import SolidMesh

Array = npt.NDArray[np.float64]

ROUND_OFF = 1e-12
FREQUENCIES = 2e-3  # triangles and tetrahedra at the edges of the delamination
CELLS = {
    "plane_strips": "quadrilateral",
    "solid_strips": "hexahedron",
    "plane_delaminated": "triangle",
    "solid_delaminated": "tetrahedron",
}


def changed(
    name: str, folder: Path, change: Callable[[meshio.Mesh], object], **further: object
) -> Case:
    """Return the case of a mesh of the folder that is changed first."""
    mesh = meshio.read(MESHES / f"{name}.msh", file_format="gmsh")
    mesh.cell_sets = {}
    mesh.point_data = {}
    change(mesh)
    path = folder / "changed.msh"
    mesh.write(path, file_format="gmsh22", binary=False)
    return case_of(name, path, **further)


@pytest.mark.parametrize(("name", "cell"), CELLS.items())
def test_meshes_of_the_folder(name: str, cell: str) -> None:
    case = case_of(name)
    mesh = solid_mesh(case)
    assert mesh.cell == cell
    width = case.lamina[0].width if mesh.dim == 3 else 1.0
    sizes = volumes(mesh)
    assert np.all(sizes > 0.0)
    for number, lamina in enumerate(case.lamina):
        expected = lamina.length * lamina.thickness * width
        assert sizes[mesh.lamina == number].sum() == pytest.approx(expected, rel=1e-9)
    assert list(mesh.supports) == ["start"]
    assert np.abs(mesh.points[mesh.supports["start"], 0]).max() < ROUND_OFF
    assert mesh.points[:, 1].min() == 0.0
    if mesh.dim == 3:
        assert np.abs(mesh.points[:, 2]).max() == pytest.approx(0.5 * width)
    (sides,) = mesh.sides
    pairs = project(mesh, sides, at_vertices(mesh, sides))
    np.testing.assert_allclose(pairs.lower.normals[:, 1], 1.0, atol=ROUND_OFF)
    np.testing.assert_allclose(pairs.gap, 0.0, atol=ROUND_OFF)
    if name.endswith("delaminated"):
        assert 0.06 < pairs.x.min() < pairs.x.max() < 0.14
        assert mesh.bodies.max() == 0
    else:
        assert pairs.weights.sum() == pytest.approx(0.685 * width, rel=1e-9)
        assert len(pairs.x) == (41 if mesh.dim == 2 else 3 * 41)
        assert mesh.bodies.max() == 1


def test_cells_of_second_order_give_their_vertices(tmp_path: Path) -> None:
    def raise_order(mesh: meshio.Mesh) -> None:
        for number, block in enumerate(mesh.cells):
            corners = np.asarray(block.data)
            pairs = {"line": [[0, 1]], "quad": [[0, 1], [1, 2], [2, 3], [3, 0]]}[block.type]
            data = corners
            for pair in pairs:
                new = len(mesh.points) + np.arange(len(corners))
                mesh.points = np.concatenate(
                    [mesh.points, mesh.points[corners[:, pair]].mean(axis=1)]
                )
                data = np.column_stack([data, new])
            name = {"line": "line3", "quad": "quad8"}[block.type]
            mesh.cells[number] = meshio.CellBlock(name, data)

    plain = solid_mesh(case_of("plane_strips"))
    raised = solid_mesh(changed("plane_strips", tmp_path, raise_order))
    assert len(raised.points) == len(plain.points)
    np.testing.assert_allclose(
        raised.points[raised.cells], plain.points[plain.cells], atol=ROUND_OFF
    )


@pytest.mark.parametrize(("name", "cell"), CELLS.items())
def test_cells_that_are_inside_out_are_turned(name: str, cell: str, tmp_path: Path) -> None:
    def turn(mesh: meshio.Mesh) -> None:
        for block in mesh.cells:
            if block.type in ("triangle", "quad") and cell in ("triangle", "quadrilateral"):
                block.data[::2] = block.data[::2, ::-1].copy()
            if block.type == "tetra":
                block.data[::2] = block.data[::2, [0, 2, 1, 3]].copy()
            if block.type == "hexahedron":
                block.data[::2] = block.data[::2][:, [4, 5, 6, 7, 0, 1, 2, 3]].copy()

    sizes = volumes(solid_mesh(changed(name, tmp_path, turn)))
    np.testing.assert_allclose(sizes, volumes(solid_mesh(case_of(name))), rtol=1e-9)


def test_place_of_the_file_does_not_matter(tmp_path: Path) -> None:
    """The bottom is moved to y = 0, the middle of the width to z = 0."""

    def shift(mesh: meshio.Mesh) -> None:
        mesh.points = mesh.points + np.array([0.0, 0.3, 0.02])

    moved = solid_mesh(changed("solid_strips", tmp_path, shift))
    np.testing.assert_allclose(moved.points, solid_mesh(case_of("solid_strips")).points, atol=1e-12)


def rename(old: str, new: str) -> Callable[[meshio.Mesh], object]:
    """Return a change of a group's name."""
    return lambda mesh: mesh.field_data.update({new: mesh.field_data.pop(old)})


@pytest.mark.parametrize(
    ("name", "group"),
    [
        ("plane_strips", "thick"),
        ("plane_strips", "thin"),
        ("plane_strips", "start"),
        ("plane_strips", "thick-thin lower"),
        ("solid_strips", "thick-thin upper"),
        ("solid_delaminated", "lower-upper lower"),
    ],
)
def test_missing_group_is_named(name: str, group: str, tmp_path: Path) -> None:
    case = changed(name, tmp_path, rename(group, "other"))
    with pytest.raises(CaseError, match=f"expected a physical group '{group}' .*'other'"):
        solid_mesh(case)


def test_missing_end_is_named_only_if_it_is_held(tmp_path: Path) -> None:
    change = rename("end", "other")
    solid_mesh(changed("plane_delaminated", tmp_path, change))
    case = changed("plane_delaminated", tmp_path, change, **{"support.end": "pinned"})
    with pytest.raises(CaseError, match="expected a physical group 'end' of line cells"):
        solid_mesh(case)


def move_points(mesh: meshio.Mesh, factor: tuple[float, float, float]) -> None:
    mesh.points = mesh.points * np.array(factor)


def spoil(mesh: meshio.Mesh) -> None:
    mesh.points[5, 1] = np.nan


def fold(mesh: meshio.Mesh) -> None:
    quads = next(block.data for block in mesh.cells if block.type == "quad")
    mesh.points[quads[3, 0]] = 0.3 * mesh.points[quads[3, 0]] + 0.7 * mesh.points[quads[3, 2]]


def swap_sides(mesh: meshio.Mesh) -> None:
    data = mesh.field_data
    first, second = "thick-thin lower", "thick-thin upper"
    data[first], data[second] = data[second], data[first]


def swap_laminae(mesh: meshio.Mesh) -> None:
    move_points(mesh, (1.0, -1.0, 1.0))


def detach(mesh: meshio.Mesh) -> None:
    """Give the last cells of the thin lamina vertices of their own."""
    block = [block for block in mesh.cells if block.type == "quad"][-1]
    chosen = mesh.points[block.data[:, 0], 0] > 0.5
    vertices, number = np.unique(block.data[chosen], return_inverse=True)
    block.data[chosen] = len(mesh.points) + number.reshape(-1, 4)
    for lines in (block.data for block in mesh.cells if block.type == "line"):
        inside = np.all(np.isin(lines, vertices), axis=1)
        lines[inside] = len(mesh.points) + np.searchsorted(vertices, lines[inside])
    mesh.points = np.concatenate([mesh.points, mesh.points[vertices]])


def tag_both(mesh: meshio.Mesh) -> None:
    blocks = [number for number, block in enumerate(mesh.cells) if block.type == "quad"]
    mesh.cells[blocks[1]] = mesh.cells[blocks[0]]
    tags = mesh.cell_data["gmsh:physical"]
    for cell_tags in mesh.cell_data.values():
        cell_tags[blocks[1]] = cell_tags[blocks[0]].copy()
    tags[blocks[1]] = np.full(len(mesh.cells[blocks[1]].data), mesh.field_data["thin"][0])


def inner_facets(mesh: meshio.Mesh) -> None:
    """Hold the thin lamina at a facet between two of its cells."""
    quads = [block.data for block in mesh.cells if block.type == "quad"][-1]
    tags = mesh.cell_data["gmsh:physical"]
    start = mesh.field_data["start"][0]
    lines = next(
        b for b, block_tags in zip(mesh.cells, tags, strict=True) if block_tags[0] == start
    )
    edges = [quads[3, [k, (k + 1) % 4]] for k in range(4)]
    lines.data[0] = next(edge for edge in edges if np.ptp(mesh.points[edge, 0]) < ROUND_OFF)


@pytest.mark.parametrize(
    ("name", "change", "text"),
    [
        (
            "plane_strips",
            lambda m: move_points(m, (1e3,) * 3),
            r"lamina\.length = 0\.685 m, given 0 to 685",
        ),
        ("plane_strips", spoil, "expected finite coordinates"),
        ("plane_strips", fold, r"convex cells with a volume, the quadrilateral about \(0\.\d+, "),
        ("plane_strips", lambda m: move_points(m, (1.0, 0.0, 1.0)), "the quadrilateral .* is flat"),
        ("plane_strips", swap_sides, "the lamina 'thick' alone in the group 'thick-thin lower'"),
        ("plane_strips", swap_laminae, "expected lamina 'thick' below lamina 'thin'"),
        ("plane_strips", detach, "body .* 'start', one of lamina 'thin' has none"),
        ("plane_strips", tag_both, "one is in two"),
        ("plane_strips", inner_facets, "on the boundary of the laminae in the group 'start'"),
        ("plane_strips", lambda m: m.points.__setitem__((3, 2), 0.1), "plane of x and y, z runs"),
        ("plane_delaminated", lambda m: None, ""),
    ],
    ids=lambda value: getattr(value, "__name__", None),
)
def test_bad_meshes_are_refused(
    name: str, change: Callable[[meshio.Mesh], object], text: str, tmp_path: Path
) -> None:
    case = changed(name, tmp_path, change)
    if not text:  # the way through the file changes nothing by itself
        assert isinstance(solid_mesh(case), SolidMesh)
        return
    with pytest.raises(CaseError, match=rf"mesh\.file: .*changed\.msh: .*{text}"):
        solid_mesh(case)


def test_sides_reach_as_far_as_the_delamination() -> None:
    case = case_of("plane_delaminated", **{"delamination.1.end": 0.15})
    with pytest.raises(CaseError, match=r"lower-upper to reach from 0\.06 to 0\.15 m .*0\.14 m"):
        solid_mesh(case)


def test_cells_of_the_other_dimension_are_refused() -> None:
    path = MESHES / "plane_strips.msh"
    with pytest.raises(CaseError, match=r'tetrahedrons or hexahedrons, for model\.kind = "solid"'):
        solid_mesh(case_of("solid_strips", path))
    with pytest.raises(CaseError, match="found: line"):
        solid_mesh(case_of("plane_strips", ROOT / "meshes" / "laminae_20.msh"))


def test_pairs_inside_cells_are_refused() -> None:
    keys = {"contact.points_per_element": 2, "contact.impulse": "consistent"}
    case = case_of("plane_strips", **keys)
    with pytest.raises(CaseError, match=r"points_per_element: .*given 2"):
        solid_mesh(case)


@pytest.mark.parametrize(("name", "dofs"), [("plane_strips", 720), ("solid_delaminated", 10171)])
def test_too_many_unknowns_are_refused(
    name: str, dofs: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The estimate is of the size of what comes out (1,080 and 12,534)."""
    monkeypatch.setattr(meshing, "MOST_DOFS", 100)
    with pytest.raises(CaseError, match=f"at most 100 unknowns, given about {dofs} from"):
        solid_mesh(case_of(name))


def test_formats_without_groups_are_refused(tmp_path: Path) -> None:
    mesh = meshio.read(MESHES / "plane_strips.msh", file_format="gmsh")
    path = tmp_path / "m.vtu"
    meshio.Mesh(mesh.points, [("quad", mesh.cells_dict["quad"])]).write(path)
    with pytest.raises(CaseError, match=r"physical group 'thick' .*found the groups: none"):
        solid_mesh(case_of("plane_strips", path))


def test_other_thickness_is_told(caplog: pytest.LogCaptureFixture) -> None:
    solid_mesh(case_of("plane_strips", **{"lamina.2.thickness": 0.0012}))
    assert "the area of lamina 'thin' is 0.833 times that of the case" in caplog.text


def frequencies(case: Case) -> Array:
    """Return the two lowest natural frequencies without contact [Hz]."""
    operators = assemble(case).operators
    lowest, _ = linear.lowest(operators.stiffness, operators.mass, 2)
    return lowest


@pytest.mark.parametrize("name", CELLS)
def test_beams_of_a_file_vibrate_as_the_structured_ones(name: str) -> None:
    case = case_of(name)
    lattice = case_of(name, **{"mesh.file": None, "mesh.elements": 40, "model.layers": 1})
    np.testing.assert_allclose(frequencies(case), frequencies(lattice), rtol=FREQUENCIES)


def test_opening_of_the_mesh_counts_if_the_case_gives_none(tmp_path: Path) -> None:
    def opened(mesh: meshio.Mesh) -> None:
        tag = mesh.field_data["lower-upper upper"][0]
        tags = mesh.cell_data["gmsh:physical"]
        lines = next(
            b.data for b, block_tags in zip(mesh.cells, tags, strict=True) if block_tags[0] == tag
        )
        x = mesh.points[np.unique(lines), 0]
        mesh.points[np.unique(lines), 1] += 1e-5 * np.sin(np.pi * (x - 0.06) / 0.08)

    def gaps(opening: float | None) -> Array:
        case = changed("plane_delaminated", tmp_path, opened, **{"delamination.1.opening": opening})
        structure = assemble(case)
        assert structure.layout.interfaces[0].places.size == structure.operators.n_pairs
        return structure.operators.gap0

    rest_gaps = gaps(None)
    x = np.linspace(0.06, 0.14, rest_gaps.size + 2)[1:-1]
    np.testing.assert_allclose(rest_gaps, 1e-5 * np.sin(np.pi * (x - 0.06) / 0.08), rtol=1e-6)
    assert np.all(gaps(0.0) == 0.0)


def test_mesh_of_a_file_runs() -> None:
    """The tips follow the beam's until the first strike; the pairs are at all vertices."""
    further = {"time.periods": 1, "output.window_periods": 1, "time.steps_per_period": 400}
    history = run(case_of("plane_strips", **further)).history
    beam = run(preset("paper", further)).history
    assert history["contact_state"].shape[-1] == history["x"].size == 46
    assert history["event_time"].min() > 0.0
    free = int(np.sum(history["frame"].values < history["event_time"].values.min()))
    tips = [data["displacement"].values[:, :free, -1] for data in (history, beam)]
    assert free > 3
    np.testing.assert_allclose(tips[0], tips[1], atol=0.005 * np.abs(tips[1]).max())


SHARED = """
import sys
import numpy as np
sys.path += arguments
from test_meshfile import case_of
from delam_fem.model.discretise import assemble
from delam_fem.system.mpi import MPI

for name in ("plane_strips", "solid_delaminated"):
    one, shared = (assemble(case_of(name), comm=own) for own in (MPI.COMM_SELF, comm))
    load = np.linspace(1.0, 2.0, one.operators.n_pairs)
    for of in (lambda s: s.operators.gap_matrix, lambda s: s.layout.reading.matrix):
        sums = [(own @ own.T).toarray() for own in (of(one), of(shared))]
        np.testing.assert_allclose(comm.allreduce(sums[1]), sums[0], atol=1e-9 * abs(sums[0]).max())
    for of in (lambda s: s.operators.gap0, lambda s: s.operators.pair_weights):
        assert np.array_equal(of(one), of(shared))
    O, S = one.operators, shared.operators
    expected = O.gap_matrix @ (O.stiffness @ (O.gap_matrix.T @ load))
    x, y = S.stiffness.createVecs()
    x.array = S.gap_matrix.T @ load
    S.stiffness.mult(x, y)
    found = comm.allreduce(S.gap_matrix @ y.array)
    np.testing.assert_allclose(found, expected, atol=1e-9 * abs(expected).max())
"""


@pytest.mark.mpi
@pytest.mark.parametrize("ranks", [2, pytest.param(3, marks=pytest.mark.nightly)])
def test_ranks_share_pairs_and_readings(ranks: int, crew: Crew) -> None:
    """H Hᵀ and the like do not depend on the order of the dofs."""
    crew.run(ranks, SHARED, Path(__file__).parent)
