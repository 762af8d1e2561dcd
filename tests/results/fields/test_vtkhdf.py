"""Files of the format VTKHDF, dataset by dataset, and series read from them."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import pytest

from delam_fem.results.fields import vtkhdf
from delam_fem.results.fields.vtkhdf import Grid, Series, subcells, write

POINTS = np.array([
    [0.0, 0.0, 0.0], [0.5, 0.0, 0.0], [0.5, 0.02, 0.0], [0.0, 0.02, 0.0], [1.0, 0.0, 0.0],
    [1.0, 0.03, 0.1], [0.5, 0.03, 0.1],
])  # fmt: skip
GRID = Grid(
    POINTS, np.array([[0, 1, 2, 3], [1, 4, 5, 6]]), "quadrilateral",
    {"lamina": np.array([1, 2], np.int8)}, {"rise": np.linspace(0.0, 0.006, 7)},
)  # fmt: skip
TIMES = np.array([0.5, 0.75, 1.0, 1.5, 2.0])


def point_data(frame: int) -> dict[str, np.ndarray]:
    """Return scalars and vectors at the points, other ones at each frame."""
    n = len(POINTS)
    scalar = frame + np.arange(n) / 10.0
    return {
        **{name: scalar for name in vtkhdf.OF_SOLIDS},
        "von_mises": scalar.astype(np.float32),
        "displacement": np.outer(scalar, [1.0, -2, 3]),
        "velocity": np.outer(scalar, [-4.0, 5, 6]),
    }


@pytest.mark.parametrize("at_once", [1, 14, 15, 2**15])
def test_frames_are_the_same_however_many_are_written_at_once(
    at_once: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    usual = contents(write(GRID, TIMES, point_data, tmp_path / "usual.vtkhdf"))
    monkeypatch.setattr(vtkhdf, "POINTS_AT_ONCE", at_once)
    written = contents(write(GRID, TIMES, point_data, tmp_path / "s.vtkhdf"))
    assert written.keys() == usual.keys()
    for name, values in usual.items():
        np.testing.assert_array_equal(written[name], values, err_msg=name)


def contents(path: Path) -> dict[str, np.ndarray]:
    """Return all datasets of a file by their paths."""
    arrays: dict[str, np.ndarray] = {}

    def read(name: str, node: h5py.Group | h5py.Dataset) -> None:
        if isinstance(node, h5py.Dataset):
            arrays[name] = node[:]

    with h5py.File(path) as file:
        file.visititems(read)
    return arrays


def test_series_are_read_back(tmp_path: Path) -> None:
    series = Series.read(write(GRID, TIMES, point_data, tmp_path / "s.vtkhdf"))
    assert series.cell == "quadrilateral" and series.lamina.tolist() == [1, 2]
    assert set(series.names) == {*vtkhdf.NEEDED, *vtkhdf.OF_SOLIDS}
    np.testing.assert_array_equal(series.times, TIMES)
    np.testing.assert_array_equal(series.points, POINTS)
    np.testing.assert_array_equal(series.cells, GRID.cells)
    np.testing.assert_array_equal(series.rise, GRID.point_data["rise"])
    for frame in range(TIMES.size):
        for name, values in point_data(frame).items():
            np.testing.assert_array_equal(series.field(name, frame), values)
            assert series.field(name, frame).dtype == np.float64
    height = POINTS[:, 1] - series.rise
    assert series.thickness == pytest.approx(height.max() - height.min(), rel=1e-15)


def test_nothing_but_the_file_is_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    write(GRID, TIMES, point_data, Path("s.vtkhdf"))
    assert [path.name for path in tmp_path.iterdir()] == ["s.vtkhdf"]


def test_places_of_points_have_both_factors(tmp_path: Path) -> None:
    series = Series.read(write(GRID, TIMES, point_data, tmp_path / "s.vtkhdf"))
    u = np.random.default_rng(2).normal(size=(7, 3))
    drawn = series.drawn(u, 20.0, 3.0)
    np.testing.assert_allclose(drawn[:, 0], POINTS[:, 0] + 60.0 * u[:, 0], rtol=1e-12)
    y = 20.0 * (POINTS[:, 1] - series.rise) + 3.0 * (series.rise + u[:, 1])
    np.testing.assert_allclose(drawn[:, 1], y, rtol=1e-12)
    np.testing.assert_allclose(drawn[:, 2], POINTS[:, 2] + 3.0 * u[:, 2], rtol=1e-12)


@pytest.mark.parametrize("cell", ["triangle", "tetrahedron", "quadrilateral", "hexahedron"])
@pytest.mark.parametrize("degree", [1, 2, 3])
def test_parts_of_cells_are_turned_like_the_cell(cell: str, degree: int) -> None:
    """All have the same volume, which is positive in VTK's order of the corners."""
    dim = 2 if cell in ("triangle", "quadrilateral") else 3
    is_simplex = cell in ("triangle", "tetrahedron")
    lattice = np.stack(np.meshgrid(*dim * [np.arange(degree + 1)], indexing="ij"), -1)
    nodes = lattice.reshape(-1, dim) / degree
    nodes = nodes[nodes.sum(axis=1) < 1.0 + 1e-9] if is_simplex else nodes
    parts = nodes[subcells(cell, degree, nodes)]
    assert len(parts) == degree**dim
    first, size = parts[:, 0], (0.5 if dim == 2 else 1.0 / 6.0) if is_simplex else 1.0
    ends = {"quadrilateral": (1, 3), "hexahedron": (1, 3, 4)}.get(cell, tuple(range(1, dim + 1)))
    edges = np.stack([parts[:, k] - first for k in ends], axis=1)
    volumes = np.linalg.det(edges) * (size if is_simplex else 1.0)
    np.testing.assert_allclose(volumes, size / degree**dim, rtol=1e-9)
    if not is_simplex:  # VTK goes round a face
        np.testing.assert_allclose(parts[:, 2], parts[:, 1] + parts[:, 3] - first, atol=1e-12)
