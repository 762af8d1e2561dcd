"""The committed meshes and the script that makes them."""

import importlib.util
import subprocess
import sys
from pathlib import Path

import meshio
import numpy as np
import numpy.typing as npt
import pytest

MESHES = Path(__file__).parents[1] / "meshes"
NOT_OPPOSITE = Path(__file__).parent / "data" / "not_opposite.msh"
LENGTH = 0.685
ROUND_OFF = 1e-15  # m, a few units in the last place of the coordinates
GMSH_SPACING = 1e-9  # m; gmsh integrates the progression numerically, to 6e-10 m here
ELEMENTS = {"laminae_20": 20, "laminae_50": 50, "laminae_graded": 24}

needs_gmsh = pytest.mark.skipif(
    importlib.util.find_spec("gmsh") is None, reason="gmsh's Python module is not installed"
)


def nodes(path: Path, lamina: str) -> npt.NDArray[np.float64]:
    """Return the sorted x of the nodes of one lamina, by its physical group."""
    mesh = meshio.read(path, file_format="gmsh")
    number, dimension = mesh.field_data[lamina]
    assert dimension == 1
    lines = mesh.cells_dict["line"][mesh.cell_data_dict["gmsh:physical"]["line"] == number]
    return np.sort(mesh.points[np.unique(lines), 0])


@pytest.mark.parametrize(("name", "elements"), ELEMENTS.items())
def test_laminae_have_opposite_nodes_from_clamp_to_tip(name: str, elements: int) -> None:
    thick, thin = (nodes(MESHES / f"{name}.msh", lamina) for lamina in ("thick", "thin"))
    assert len(thick) == elements + 1
    np.testing.assert_allclose(thick, thin, rtol=0.0, atol=ROUND_OFF)
    np.testing.assert_allclose(thick[[0, -1]], [0.0, LENGTH], rtol=0.0, atol=ROUND_OFF)


@pytest.mark.parametrize(
    ("name", "ratio"), [("laminae_20", 1.0), ("laminae_50", 1.0), ("laminae_graded", 0.25)]
)
def test_elements_are_in_geometric_progression(name: str, ratio: float) -> None:
    x = nodes(MESHES / f"{name}.msh", "thin")
    lengths = ratio ** np.linspace(0.0, 1.0, len(x) - 1)
    expected = LENGTH * np.cumsum(lengths / lengths.sum())
    np.testing.assert_allclose(x[1:], expected, rtol=0.0, atol=GMSH_SPACING)


def test_broken_mesh_has_nodes_that_are_not_opposite() -> None:
    thick, thin = (nodes(NOT_OPPOSITE, lamina) for lamina in ("thick", "thin"))
    assert len(thick) == len(thin)
    assert np.abs(thick - thin)[1:-1].min() > 1e-3 * LENGTH


@needs_gmsh
def test_generator_makes_the_committed_meshes(tmp_path: Path) -> None:
    command = [sys.executable, MESHES / "generate.py", "-o", tmp_path]
    subprocess.run(command, check=True, capture_output=True, timeout=600)
    made = sorted(path.name for path in tmp_path.iterdir())
    assert made == sorted(path.name for path in MESHES.glob("*.msh"))
    for file in made:
        for lamina in ("thick", "thin"):
            np.testing.assert_allclose(
                nodes(tmp_path / file, lamina),
                nodes(MESHES / file, lamina),
                rtol=0.0,
                atol=ROUND_OFF,
            )


def places(path: Path) -> dict[str, npt.NDArray[np.float64]]:
    """Return the nodes of each physical group of a mesh, in the order of their places."""
    mesh = meshio.read(path, file_format="gmsh")
    by_name = {}
    for name in mesh.field_data:
        pairs = zip(mesh.cells, mesh.cell_sets[name], strict=True)
        nodes = np.concatenate([block.data[chosen].ravel() for block, chosen in pairs])
        points = mesh.points[np.unique(nodes)]
        by_name[name] = points[np.lexsort(points.round(9).T)]
    return by_name


@needs_gmsh
def test_generator_makes_the_committed_solids(tmp_path: Path) -> None:
    """The triangles of another gmsh may differ; sides and ends do not."""
    command = [sys.executable, MESHES / "solids" / "generate.py", "-o", tmp_path]
    subprocess.run(command, check=True, capture_output=True, timeout=600)
    committed = sorted((MESHES / "solids").glob("*.msh"))
    assert sorted(path.name for path in tmp_path.iterdir()) == [path.name for path in committed]
    for path in committed:
        assert path.stat().st_size < 100_000
        made, expected = places(tmp_path / path.name), places(path)
        assert made.keys() == expected.keys()
        for group, points in expected.items():
            if "strips" in path.name or (path.name.startswith("plane") and "-" in group):
                np.testing.assert_allclose(made[group], points, rtol=0.0, atol=GMSH_SPACING)
            else:
                np.testing.assert_allclose(
                    [made[group].min(axis=0), made[group].max(axis=0)],
                    [points.min(axis=0), points.max(axis=0)],
                    rtol=0.0,
                    atol=GMSH_SPACING,
                )
