"""fields.bp: the right values at the right nodes, where dolfinx can write them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import ufl
import xarray as xr
from mpi4py import MPI
from stack import three_laminae
from synthetic import small_case, synthetic_history

import delam_fem as df
from delam_fem.model import _dolfinx
from delam_fem.results.fields import vtx
from delam_fem.results.fields.solids import write_solid
from delam_fem.results.fields.vtkhdf import Series


@pytest.fixture(scope="module")
def frames() -> xr.Dataset:
    return synthetic_history(small_case())


def test_lines_share_no_node(frames: xr.Dataset) -> None:
    points, cells = vtx.lines_at_rest(frames)
    n = frames.sizes["node"]
    np.testing.assert_array_equal(points[n:, 1] - points[:n, 1], frames.gap0)
    assert cells.min() == 0 and cells.max() == 2 * n - 1
    assert (n - 1, n) not in set(map(tuple, cells.tolist()))
    shuffled = np.random.default_rng(1).permutation(cells)[:, ::-1]
    mesh = _dolfinx.create_mesh(MPI.COMM_SELF, "interval", points, shuffled)
    linear = _dolfinx.space(mesh, "Lagrange", 1)
    coordinates = linear.tabulate_dof_coordinates()[:, :2]
    np.testing.assert_allclose(
        coordinates, points[_dolfinx.input_nodes(linear)], rtol=0.0, atol=1e-15
    )


def test_three_laminae_are_three_lines() -> None:
    frames = three_laminae().history()
    points, cells = vtx.lines_at_rest(frames)
    n = frames.sizes["node"]
    assert points.shape == (3 * n, 2)
    assert cells.shape == (3 * (n - 1), 2)
    assert np.unique(cells).tolist() == list(range(3 * n))
    x = frames["x"].to_numpy()
    for i, end in enumerate((0.0, 0.030, 0.050)):
        line = points[i * n : (i + 1) * n]
        np.testing.assert_array_equal(line[:, 0], x)
        np.testing.assert_allclose(line[:, 1], end * (x / x[4]) ** 2, rtol=1e-14)
    mesh = _dolfinx.create_mesh(MPI.COMM_SELF, "interval", points, cells)
    linear = _dolfinx.space(mesh, "Lagrange", 1)
    nodes = _dolfinx.input_nodes(linear)
    coordinates = linear.tabulate_dof_coordinates()[:, :2]
    np.testing.assert_allclose(coordinates, points[nodes], rtol=0.0, atol=1e-15)
    values = np.hstack(frames["displacement"].to_numpy())
    assert values.shape == (frames.sizes["frame"], 3 * n)
    np.testing.assert_array_equal(values[5].reshape(3, n), frames["displacement"][:, 5])


def test_values_of_the_thin_lamina_follow_those_of_the_thick(frames: xr.Dataset) -> None:
    values = np.hstack(frames.displacement.to_numpy())
    n = frames.sizes["node"]
    assert values.shape == (frames.sizes["frame"], 2 * n)
    np.testing.assert_array_equal(values[1, n:], frames.displacement[1, 1])


@pytest.mark.skipif(_dolfinx.has_adios2, reason="this dolfinx has ADIOS2")
def test_nothing_is_written_without_adios2(frames: xr.Dataset, tmp_path: Path) -> None:
    assert vtx.write_lines(frames, tmp_path) is None
    assert list(tmp_path.iterdir()) == []


@pytest.mark.skipif(not _dolfinx.has_adios2, reason="this dolfinx has no ADIOS2")
def test_folder_holds_every_frame_and_replaces_an_earlier_one(
    frames: xr.Dataset, tmp_path: Path
) -> None:
    path = vtx.write_lines(frames.isel(frame=slice(0, 2)), tmp_path)
    assert path == tmp_path / "fields.bp"
    (path / "old").touch()
    vtx.write_lines(frames, tmp_path)
    assert [p.name for p in tmp_path.iterdir()] == ["fields.bp"]
    assert not (path / "old").exists()
    names, data = ((path / file).read_bytes() for file in ("md.0", "data.0"))
    assert all(name.encode() in names for name in (*vtx.FIELDS, "contact_state"))
    for name in vtx.FIELDS:  # doubles as they are; without a reader, where they stand is unknown
        for value in frames[name].to_numpy()[1, :, -1]:
            assert value.tobytes() in data


def test_frames_that_are_not_finite_are_left_out(frames: xr.Dataset, tmp_path: Path) -> None:
    broken = frames.copy(deep=True)
    broken["displacement"][:] = np.nan
    assert vtx.write_lines(broken, tmp_path) is None


@pytest.fixture(scope="module", params=["plane-stress", "solid"])
def series(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Series:
    """Return the fields of a solid that moves a little."""
    keys = {
        "model.kind": request.param,
        "mesh.elements": 3,
        "time.steps_per_period": 100,
        "time.periods": 1,
        "output.window_periods": 1,
        "output.fields_per_period": 3,
    }
    solid = df.run(df.preset("paper", keys)).solid
    assert solid is not None
    return Series.read(write_solid(solid, tmp_path_factory.mktemp("fields")))


def test_bodies_have_their_values_at_their_points(
    series: Series, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What would be written, on every release."""
    arguments = []

    def written(path: str, *given: Any) -> None:
        Path(path).mkdir()
        arguments.extend(given)

    monkeypatch.setattr(_dolfinx, "has_adios2", True)
    monkeypatch.setattr(_dolfinx, "write_vtx", written)
    assert vtx.write_bodies(series, tmp_path) == tmp_path / "solid.bp"
    mesh, times, fields = arguments
    assert times.size == 3
    linear = _dolfinx.space(mesh, "Lagrange", 1)
    nodes = _dolfinx.input_nodes(linear)
    dim = mesh.geometry.dim
    coordinates = linear.tabulate_dof_coordinates()[:, :dim]
    np.testing.assert_allclose(coordinates, series.points[nodes, :dim], rtol=0.0, atol=1e-15)
    mass = ufl.inner(ufl.TrialFunction(linear), ufl.TestFunction(linear)) * ufl.dx
    size = _dolfinx.assemble_matrix(mass).getValuesCSR()[2].sum()
    width = 1.0 if dim == 2 else 0.040  # cells whose vertices are in a wrong order have another
    assert size == pytest.approx(0.685 * 0.003 * width, rel=1e-3)
    values = fields(1)
    np.testing.assert_array_equal(values["displacement"], series.field("displacement", 1))
    np.testing.assert_array_equal(values["von_mises"], series.field("von_mises", 1))
    assert "rise" not in values


@pytest.mark.skipif(not _dolfinx.has_adios2, reason="this dolfinx has no ADIOS2")
def test_bodies_are_written_with_adios2(series: Series, tmp_path: Path) -> None:
    path = vtx.write_bodies(series, tmp_path)
    assert path == tmp_path / "solid.bp"
    names, data = ((path / file).read_bytes() for file in ("md.0", "data.0"))
    assert b"von_mises" in names and b"displacement_x" not in names
    for vector in series.field("displacement", 1):
        assert vector.tobytes() in data
