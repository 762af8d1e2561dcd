"""Node coordinates: uniform meshes, files, and what is wrong with a file."""

from __future__ import annotations

from pathlib import Path

import h5py
import meshio
import numpy as np
import pytest
from project import ROOT

from delam_fem.api import Case, CaseError, node_coordinates, preset

LENGTH = 0.685


def case_with(path: Path) -> Case:
    return preset("paper", {"mesh.file": str(path)})


def write(path: Path, first: list[float], second: list[float], tags: tuple[int, int]) -> Path:
    x = np.array(first + second)
    points = np.column_stack([x, np.repeat([0.0, 0.01], [len(first), len(second)]), 0.0 * x])
    lines = [[k, k + 1] for k in range(len(x) - 1) if k != len(first) - 1]
    tag = np.repeat(tags, [len(first) - 1, len(second) - 1])
    meshio.write_points_cells(path, points, {"line": np.array(lines)}, cell_data={"lamina": [tag]})
    return path


def test_uniform_nodes_span_the_length() -> None:
    x = node_coordinates(preset("paper", {"mesh.elements": 7}))
    assert x.shape == (8,)
    assert x[0] == 0.0
    assert x[-1] == LENGTH
    assert np.allclose(np.diff(x), LENGTH / 7)


@pytest.mark.parametrize(("apart", "is_uniform"), [(2, True), (1, False)])
def test_two_elements_between_edges_are_enough_for_uniform_nodes(
    apart: int, is_uniform: bool
) -> None:
    """The end is off by half of what is allowed, so that nodes of segments would be as well."""
    h, key = 0.4 / 20, "delamination.1"
    ends = {f"{key}.start": 5 * h, f"{key}.end": (5 + apart) * h + 2e-10}
    x = node_coordinates(preset("embedded", {"mesh.elements": 20, **ends}))
    assert np.array_equal(x, np.linspace(0.0, 0.4, 21)) == is_uniform


@pytest.mark.parametrize(
    ("ends", "n", "counts"), [((0.12, 0.28), 6, [2, 2, 2]), ((0.021, 0.379), 7, [2, 3, 2])]
)
def test_segments_have_at_least_two_elements(
    ends: tuple[float, float], n: int, counts: list[int]
) -> None:
    keys = dict(zip(("delamination.1.start", "delamination.1.end"), ends, strict=True))
    x = node_coordinates(preset("embedded", {"mesh.elements": n, **keys}))
    assert np.histogram(x[:-1] + 1e-9, [0.0, *ends, 0.4])[0].tolist() == counts


def test_file_gives_its_own_grading_whatever_the_order_of_its_cells(tmp_path: Path) -> None:
    graded = [0.0, 0.1, 0.3, 0.6, LENGTH]
    path = write(tmp_path / "mesh.vtu", graded, graded, (2, 1))
    mesh = meshio.read(path)
    order = [5, 0, 3, 1, 7, 2, 4, 6]
    cells = mesh.cells[0].data[order][:, ::-1]
    shuffled = {"lamina": [mesh.cell_data["lamina"][0][order]]}
    meshio.write_points_cells(path, mesh.points, {"line": cells}, cell_data=shuffled)
    assert np.allclose(node_coordinates(case_with(path)), graded)


@pytest.mark.parametrize("name", ["laminae_20.msh", "laminae_50.msh", "laminae_graded.msh"])
def test_meshes_of_the_project_are_read(name: str) -> None:
    path = Path(__file__).parents[2] / "meshes" / name
    x = node_coordinates(case_with(path))
    assert x[-1] == LENGTH
    assert (np.diff(x) > 0.0).all()


def test_nodes_that_are_not_opposite_are_named(tmp_path: Path) -> None:
    path = write(tmp_path / "m.vtu", [0.0, 0.2, LENGTH], [0.0, 0.25, LENGTH], (1, 2))
    with pytest.raises(CaseError, match=r"opposite nodes.*node 1 is at x = 0\.2 m.* 0\.25 m"):
        node_coordinates(case_with(path))


def test_more_nodes_on_one_lamina_are_refused(tmp_path: Path) -> None:
    path = write(tmp_path / "m.vtu", [0.0, 0.2, LENGTH], [0.0, 0.2, 0.4, LENGTH], (1, 2))
    with pytest.raises(CaseError, match=r"opposite nodes.*node 2"):
        node_coordinates(case_with(path))


def test_length_must_be_that_of_the_case(tmp_path: Path) -> None:
    path = write(tmp_path / "m.vtu", [0.0, 0.2, 0.5], [0.0, 0.2, 0.5], (1, 2))
    with pytest.raises(CaseError, match=r"lamina\.length = 0\.685 m, given 0 to 0\.5 m"):
        node_coordinates(case_with(path))


def test_lines_without_two_groups_are_refused(tmp_path: Path) -> None:
    path = write(tmp_path / "m.vtu", [0.0, LENGTH], [0.0, LENGTH], (1, 1))
    with pytest.raises(CaseError, match="two physical groups named 'thick' and 'thin'"):
        node_coordinates(case_with(path))


def test_branched_lines_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "m.vtu"
    points = np.array([[0.0, 0, 0], [0.3, 0, 0], [0.5, 0, 0], [LENGTH, 0, 0]])
    lines = np.array([[0, 1], [1, 3], [1, 2], [0, 1], [1, 2], [2, 3]])
    tag = [np.array([1, 1, 1, 2, 2, 2])]
    meshio.write_points_cells(path, points, {"line": lines}, cell_data={"lamina": tag})
    with pytest.raises(CaseError, match="one chain along x"):
        node_coordinates(case_with(path))


def test_a_mesh_without_lines_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "m.vtu"
    points = np.array([[0.0, 0, 0], [1.0, 0, 0], [0.0, 1.0, 0]])
    meshio.write_points_cells(path, points, {"triangle": np.array([[0, 1, 2]])})
    with pytest.raises(CaseError, match="expected line cells, found: triangle"):
        node_coordinates(case_with(path))


def test_a_file_that_meshio_cannot_read_is_named(tmp_path: Path) -> None:
    path = tmp_path / "m.msh"
    path.write_text("no mesh")
    with pytest.raises(CaseError, match=r"meshio cannot read .*m\.msh"):
        node_coordinates(case_with(path))


def test_only_formats_that_were_tried_are_read(tmp_path: Path) -> None:
    path = tmp_path / "m.mdpa"
    path.write_text("Begin Nodes\n")  # meshio would read this for ever
    with pytest.raises(CaseError, match=r"expected a file \.msh, \.vtk, \.vtu, \.xdmf"):
        node_coordinates(case_with(path))


def test_a_message_quotes_nothing_of_the_file(tmp_path: Path) -> None:
    path = tmp_path / "m.msh"
    path.write_text("$MeshFormat\nsecret\n")
    with pytest.raises(CaseError) as caught:
        node_coordinates(case_with(path))
    assert "secret" not in str(caught.value)


@pytest.mark.parametrize("suffix", [".vtk", ".vtu", ".xdmf"])
def test_other_formats_are_read(tmp_path: Path, suffix: str) -> None:
    mesh = meshio.read(ROOT / "meshes" / "laminae_graded.msh", file_format="gmsh")
    lines, tags = mesh.cells_dict["line"], mesh.cell_data_dict["gmsh:physical"]["line"]
    path = tmp_path / f"m{suffix}"
    meshio.Mesh(mesh.points, [("line", lines)], cell_data={"lamina": [tags]}).write(path)
    expected = node_coordinates(case_with(ROOT / "meshes" / "laminae_graded.msh"))
    assert np.array_equal(node_coordinates(case_with(path)), expected)


@pytest.mark.parametrize("way", ["link", "storage", "another name", "symbolic link"])
def test_an_xdmf_file_reads_its_own_numbers_alone(tmp_path: Path, way: str) -> None:
    mesh = meshio.read(ROOT / "meshes" / "laminae_graded.msh", file_format="gmsh")
    lines, tags = mesh.cells_dict["line"], mesh.cell_data_dict["gmsh:physical"]["line"]
    path, heavy, other = (tmp_path / name for name in ("m.xdmf", "m.h5", "other.h5"))
    meshio.Mesh(mesh.points, [("line", lines)], cell_data={"lamina": [tags]}).write(path)
    if way in ("another name", "symbolic link"):
        heavy.rename(other)
    if way == "another name":
        path.write_text(path.read_text().replace("m.h5", "other.h5"))
    elif way == "symbolic link":
        heavy.symlink_to(other)
    else:
        with h5py.File(heavy, "r+") as file:
            values = file["data0"][:]
            del file["data0"]
            if way == "link":
                with h5py.File(other, "w") as source:
                    source["v"] = values
                file["data0"] = h5py.ExternalLink("other.h5", "v")
            else:
                other.write_bytes(values.tobytes())
                storage = [(str(other), 0, values.nbytes)]
                file.create_dataset("data0", values.shape, values.dtype, external=storage)
    with pytest.raises(CaseError, match=r"expected numbers in m\.h5|in another file"):
        node_coordinates(case_with(path))


@pytest.mark.parametrize(
    ("x", "expected"), [(np.nan, "finite coordinates"), (0.0, "the same x|not form one chain")]
)
def test_nodes_must_be_finite_and_apart(tmp_path: Path, x: float, expected: str) -> None:
    points = np.array([[0.0, 0, 0], [x, 0, 0], [0.685, 0, 0]])
    lines = np.array([[0, 1], [1, 2]])
    path = tmp_path / "m.vtu"
    meshio.Mesh(
        np.vstack([points, points]),
        [("line", np.vstack([lines, lines + 3]))],
        cell_data={"lamina": [np.array([1, 1, 2, 2])]},
    ).write(path)
    with pytest.raises(CaseError, match=expected):
        node_coordinates(case_with(path))


GMSH = """$MeshFormat
VERSION 0 8
$EndMeshFormat
$PhysicalNames
1
1 1 "thick"
$EndPhysicalNames
$Entities
2 1 0 0
1 0 0 0 0
2 1 0 0 0
1 0 0 0 1 0 0 1 1 2 1 -2
$EndEntities
$Nodes
1 2 1 2
1 1 0 2
1
2
0 0 0
1 0 0
$EndNodes
$Elements
2 2 1 2
0 1 15 1
1 1
1 1 1 1
2 1 2
$EndElements
"""
"""A line in a physical group, and a point in none, as gmsh writes with Mesh.SaveAll = 1."""


@pytest.mark.parametrize(("version", "remedy"), [("4.1", "Mesh.SaveAll = 0"), ("4", "4.1")])
def test_what_meshio_refuses_has_its_reason_and_a_remedy(
    tmp_path: Path, version: str, remedy: str
) -> None:
    path = tmp_path / "m.msh"
    path.write_text(GMSH.replace("VERSION", version))
    with pytest.raises(CaseError) as error:
        node_coordinates(case_with(path))
    told = str(error.value)
    assert str(path) in told and remedy in told and "damaged" not in told and "(" in told


def test_a_mesh_file_in_millimetres_is_the_same_mesh(tmp_path: Path) -> None:
    file = ROOT / "meshes/laminae_20.msh"
    mesh = meshio.read(file)
    mesh.points = mesh.points * 1e3
    large = tmp_path / "large.msh"
    meshio.write(large, mesh, file_format="gmsh22", binary=False)
    plain = node_coordinates(preset("paper", {"mesh.file": file}))
    case = preset("paper", {"mesh.file": large, "mesh.unit": "mm"})
    np.testing.assert_allclose(node_coordinates(case), plain, rtol=1e-12)
    assert case.with_overrides({"mesh.elements": 4}).mesh.unit is None
    with pytest.raises(CaseError, match=r"mesh\.unit: expected only beside file"):
        preset("paper", {"mesh.unit": "mm"})
