import shutil
import xml.etree.ElementTree as ET
from pathlib import Path

import h5py
import meshio
import numpy as np
import pytest
import pyvista as pv
import stack
import xarray as xr
from matplotlib.image import imread
from stack import three_laminae
from synthetic import FRAMES, NODES, PERIODS, WINDOW, small_case, synthetic_history
from vtkmodules.vtkCommonExecutionModel import vtkStreamingDemandDrivenPipeline
from vtkmodules.vtkIOHDF import vtkHDFReader

from delam_fem import Case
from delam_fem.results.fields import pictures, vtkhdf

FRAME = 7
"""Some frame without symmetry."""


def collection_of(history: xr.Dataset, case: Case, directory: Path) -> Path:
    """Write the fields and return the collection of .vtu files."""
    series, collection = pictures.write_fields(history, case, directory)
    assert (series.name, collection.name) == ("fields.vtkhdf", "fields.pvd")
    return collection


def deformed(history: xr.Dataset, case: Case, frame: int) -> pv.UnstructuredGrid:
    """Return the deformed laminae as ParaView's "Warp by vector" makes them."""
    grid = pv.wrap(pictures.Ribbons.of(history, case).grid(frame))
    return grid.warp_by_vector("displacement")


def test_fields_read_by_another_reader_give_the_last_period_back(tmp_path: Path) -> None:
    case = small_case()
    history = synthetic_history(case)
    collection = collection_of(history, case, tmp_path / "fields")
    entries = ET.parse(collection).getroot().findall("Collection/DataSet")
    times = [float(entry.get("timestep")) for entry in entries]
    last = history.isel(frame=slice(-FRAMES, None))
    assert times == last["frame"].to_numpy().tolist()
    mesh = meshio.read(collection.parent / entries[FRAME].get("file"))
    np.testing.assert_array_equal(mesh.points, pictures.rest_points(history, case).reshape(-1, 3))
    corners = (2, NODES, pictures.CORNERS)
    at_frame = last.isel(frame=FRAME)
    for name in ("displacement", "velocity"):
        vectors = mesh.point_data[name].reshape(*corners, 3)
        expected = at_frame[name].to_numpy()[:, :, None]
        np.testing.assert_array_equal(vectors[..., 1], np.broadcast_to(expected, corners))
        assert not vectors[..., [0, 2]].any()
    moment = mesh.point_data["moment"].reshape(corners)
    np.testing.assert_array_equal(moment[..., 2], at_frame["moment"].to_numpy())
    state = mesh.point_data["contact_state"].reshape(corners)
    assert (state == at_frame["contact_state"].to_numpy()[:, None]).all()
    assert mesh.cell_data["lamina"][0].tolist() == [1] * (NODES - 1) + [2] * (NODES - 1)


def test_paraview_s_reader_knows_times_and_files(tmp_path: Path) -> None:
    case = small_case()
    history = synthetic_history(case)
    reader = pv.get_reader(collection_of(history, case, tmp_path))
    np.testing.assert_array_equal(reader.time_values, history["frame"].to_numpy()[-FRAMES:])
    reader.set_active_time_point(FRAME)
    block = reader.read()[0].warp_by_vector("displacement")
    expected = deformed(history, case, FRAME - FRAMES)
    np.testing.assert_array_equal(block.points, expected.points)
    assert block.n_cells == 2 * (NODES - 1)


def test_vtk_s_reader_gives_every_frame_of_the_series_back(tmp_path: Path) -> None:
    recorded = three_laminae()
    history, case = recorded.history(), recorded.case
    series, _ = pictures.write_fields(history, case, tmp_path)
    reader = vtkHDFReader()
    reader.SetFileName(str(series))
    reader.UpdateInformation()
    times = reader.GetOutputInformation(0).Get(vtkStreamingDemandDrivenPipeline.TIME_STEPS())
    assert list(times) == history["frame"].to_numpy().tolist()
    bodies = pictures.Ribbons.of(history, case)
    for frame in (0, FRAME, len(times) - 1):
        reader.UpdateTimeStep(times[frame])
        grid, expected = pv.wrap(reader.GetOutput()), pv.wrap(bodies.grid(frame))
        np.testing.assert_array_equal(grid.points, expected.points)
        np.testing.assert_array_equal(grid.cell_connectivity, expected.cell_connectivity)
        assert (grid.celltypes == pv.CellType.HEXAHEDRON).all()
        assert set(grid.point_data) == set(expected.point_data)
        for name in expected.point_data:
            np.testing.assert_array_equal(grid.point_data[name], expected.point_data[name])
        np.testing.assert_array_equal(grid.cell_data["lamina"], expected.cell_data["lamina"])


def test_a_series_is_written_in_blocks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    case = small_case()
    history = synthetic_history(case)
    reference_file = pictures.write_fields(history, case, tmp_path)[0].with_suffix(".whole")
    shutil.copyfile(tmp_path / "fields.vtkhdf", reference_file)
    monkeypatch.setattr(vtkhdf, "POINTS_AT_ONCE", 3 * 2 * NODES * pictures.CORNERS)
    in_blocks, _ = pictures.write_fields(history, case, tmp_path)
    with h5py.File(reference_file) as one, h5py.File(in_blocks) as other:
        assert one["VTKHDF/PointData/velocity"].chunks != other["VTKHDF/PointData/velocity"].chunks
        for name, values in one["VTKHDF/PointData"].items():
            np.testing.assert_array_equal(other["VTKHDF/PointData"][name], values)


def test_ribbons_have_their_real_volume_and_no_inverted_cell() -> None:
    case = small_case()
    mesh = deformed(synthetic_history(case), case, FRAME)
    volumes = mesh.compute_cell_sizes(length=False, area=False)["Volume"]
    for number, lamina in enumerate(case.lamina, start=1):
        cell_volumes = volumes[mesh.cell_data["lamina"] == number]
        expected = lamina.length * lamina.width * lamina.thickness
        assert cell_volumes.min() > 0.0
        assert cell_volumes.sum() == pytest.approx(expected, rel=1e-9)  # a lateral shear keeps it


def test_faces_are_the_gap_apart_and_touch_where_it_is_zero() -> None:
    case = small_case()
    history = synthetic_history(case)
    points = deformed(history, case, FRAME).points.reshape(2, NODES, pictures.CORNERS, 3)
    u = history["displacement"].to_numpy()[:, FRAME]
    gap = history["gap0"].to_numpy() + u[1] - u[0]
    between = points[1, :, :, 1].min(axis=-1) - points[0, :, :, 1].max(axis=-1)
    np.testing.assert_allclose(between, gap, atol=1e-15)
    assert between[0] == 0.0
    np.testing.assert_allclose(np.ptp(points[..., 1], axis=-1), [[0.002] * NODES, [0.001] * NODES])
    np.testing.assert_allclose(np.ptp(points[..., 2], axis=-1), 0.040)


def test_no_frames_give_no_files(tmp_path: Path) -> None:
    case = small_case()
    history = synthetic_history(case).isel(frame=slice(0, 0))
    assert pictures.write_fields(history, case, tmp_path / "fields") == []
    assert pictures.render(history, case, tmp_path / "laminae.png") is None
    assert not list(tmp_path.iterdir())


def test_a_shorter_run_leaves_no_old_frames_and_skips_infinite_ones(tmp_path: Path) -> None:
    case = small_case()
    history = synthetic_history(case)
    pictures.write_fields(history, case, tmp_path)
    assert len(list(tmp_path.glob("*.vtu"))) == FRAMES
    short = history.isel(frame=slice(0, 3))
    short["displacement"] = short["displacement"].copy()
    short["displacement"].to_numpy()[1, 2, -1] = np.inf
    collection = collection_of(short, case, tmp_path)
    files = [entry.get("file") for entry in ET.parse(collection).getroot().iter("DataSet")]
    assert sorted(p.name for p in tmp_path.iterdir()) == sorted(
        [*files, "fields.pvd", "fields.vtkhdf"]
    )
    assert len(files) == 2


def test_the_picture_is_taken_before_the_strongest_strike() -> None:
    case = small_case()
    history = synthetic_history(case)
    frames = history["frame"].to_numpy() / case.period
    # impulses grow, but the strike at 3.5 of 4 periods still has 0.3 periods after it
    assert frames[pictures.strike_frame(history, case)] == pytest.approx(
        PERIODS - WINDOW + 3.5 - 1 / FRAMES
    )
    late = synthetic_history(case, tip_strikes=(0.5, 1.5, 2.5, 3.9))
    assert frames[pictures.strike_frame(late, case)] == pytest.approx(
        PERIODS - WINDOW + 2.5 - 1 / FRAMES
    )


def test_the_colours_reach_the_speeds_of_the_strikes() -> None:
    case = small_case()
    history = synthetic_history(case)
    frames = [0, 1]
    slow = float(np.abs(history["velocity"].to_numpy()[:, frames]).max())
    strike = 2.0 * float(np.abs(history["velocity"]).max())
    history["tip_velocity"] = history["tip_velocity"].copy()
    history["tip_velocity"].to_numpy()[1, 7] = -strike
    assert pictures.largest_speed(history, frames) == strike > slow
    history["tip_velocity"].to_numpy()[:] = 0.0
    history["tip_velocity"].to_numpy()[0, 3] = np.nan
    assert pictures.largest_speed(history, frames) == slow


def test_without_strikes_the_picture_is_of_the_smallest_gap() -> None:
    case = small_case()
    history = synthetic_history(case).isel(event=slice(0, 0))
    frame = pictures.strike_frame(history, case)
    u = history["displacement"].to_numpy()[..., -1]
    gap = u[1] - u[0]
    period = slice(frame - FRAMES // 2, frame + FRAMES // 2)
    assert abs(int(np.argmin(gap[period])) - FRAMES // 2) <= 1


@pytest.mark.parametrize("n_frames", [1, FRAMES * WINDOW])
def test_rendered_picture_shows_the_laminae(tmp_path: Path, n_frames: int) -> None:
    case = small_case()
    history = synthetic_history(case).isel(frame=slice(0, n_frames))
    path = pictures.render(history, case, tmp_path / "figures" / "laminae.png")
    picture = imread(path)[..., :3]
    assert picture.shape == (pictures.SIZE[1], pictures.SIZE[0], 3)
    scene = picture[120:-120, : int(0.85 * pictures.SIZE[0])]  # without title and scalar bar
    drawn = (scene.min(axis=-1) < 0.95).mean()
    assert (0.005 if n_frames == 1 else 0.03) < drawn < 0.6
    bar = picture[:, int(0.88 * pictures.SIZE[0]) :]
    assert (np.ptp(bar, axis=-1) > 0.4).mean() > 0.02  # its ends are blue and red
    assert [p.name for p in path.parent.iterdir()] == ["laminae.png"]


def test_fields_of_three_laminae_are_read_back(tmp_path: Path) -> None:
    recorded = three_laminae()
    history, case = recorded.history(), recorded.case
    reader = pv.get_reader(collection_of(history, case, tmp_path))
    np.testing.assert_array_equal(reader.time_values, history["frame"].to_numpy()[-FRAMES:])
    reader.set_active_time_point(2)
    block = reader.read()[0]
    assert block.n_cells == 3 * (NODES - 1)
    assert block.n_points == 3 * NODES * pictures.CORNERS
    assert np.unique(block.cell_data["lamina"], return_counts=True)[1].tolist() == [NODES - 1] * 3
    assert block.cell_data["lamina"].tolist() == sorted(block.cell_data["lamina"].tolist())
    corners = (3, NODES, pictures.CORNERS)
    state = block.point_data["contact_state"].reshape(corners)[..., 0]
    # node 2 is hit on the lower interface and rests on the upper one
    assert state[:, 2].tolist() == [1, 2, 2]
    assert not np.delete(state, 2, axis=1).any()
    u = history["displacement"].to_numpy()[:, 2 - FRAMES]
    moved = block.point_data["displacement"].reshape(*corners, 3)[..., 1]
    np.testing.assert_array_equal(moved, np.broadcast_to(u[:, :, None], corners))
    volumes = block.compute_cell_sizes(length=False, area=False)["Volume"]
    for number, lamina in enumerate(case.lamina, start=1):
        cell_volumes = volumes[block.cell_data["lamina"] == number]
        assert cell_volumes.min() > 0.0
        expected = lamina.length * lamina.width * lamina.thickness
        assert cell_volumes.sum() == pytest.approx(expected, rel=1e-6)


def test_faces_of_three_laminae_are_their_gaps_apart() -> None:
    recorded = three_laminae()
    history = recorded.history()
    points = deformed(history, recorded.case, FRAME).points
    y = points.reshape(3, NODES, pictures.CORNERS, 3)[..., 1]
    u = history["displacement"].to_numpy()[:, FRAME]
    gaps = stack.GAPS[:, None] * stack.shape(history["x"].to_numpy()) + np.diff(u, axis=0)
    np.testing.assert_allclose(y[1:].min(axis=-1) - y[:-1].max(axis=-1), gaps, atol=1e-15)
    places = pictures.rest_points(history, recorded.case)[..., 1]
    assert (places[0].max(axis=-1) == 0.0).all()
    np.testing.assert_allclose(np.ptp(y, axis=-1)[:, 3], [0.002, 0.001, 0.0015])


def test_the_picture_of_three_laminae_is_taken_before_their_strongest_strike(
    tmp_path: Path,
) -> None:
    recorded = three_laminae()
    history, case = recorded.history(), recorded.case
    frame = pictures.strike_frame(history, case)
    when = history["frame"].to_numpy()[frame] / case.period % 1.0
    assert when == pytest.approx(stack.STRIKES[1] - 1 / FRAMES)
    picture = imread(pictures.render(history, case, tmp_path / "laminae.png"))[..., :3]
    scene = picture[120:-120, : int(0.85 * pictures.SIZE[0])]
    assert 0.03 < (scene.min(axis=-1) < 0.95).mean() < 0.6


def test_names_of_laminae_stand_side_by_side_beyond_their_probes(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    recorded = three_laminae()
    history = recorded.history()
    labels = {}
    monkeypatch.setattr(pictures, "_label", lambda axes, point, text: labels.update({text: point}))
    pictures._name_laminae(None, history, FRAME, (0.0, 1.0))
    assert list(labels) == ["thick", "thin", "top"]
    places = np.array(list(labels.values())) @ pictures.RIGHT
    assert (np.diff(places) * np.sign(places[-1] - places[0]) > 0.0).all()
    x, length = history["x"].to_numpy()[stack.NODE], recorded.case.lamina[0].length
    assert labels["thin"][0] == pytest.approx(x + 0.03 * length)


def test_small_deflections_are_drawn_larger_by_a_round_factor() -> None:
    history = three_laminae().history()
    u = history["displacement"]
    length = 0.685
    history["displacement"] = u * (1.7e-5 / float(np.abs(u).max()))
    frames = list(range(history.sizes["frame"]))
    assert pictures.magnification(history, frames, length) == 1.0  # the gap is 12 mm
    history["gap0"] = 0.0 * history["gap0"]
    factor = pictures.magnification(history, frames, length)
    assert factor == 1000.0  # 0.04 * 0.685 / 1.7e-5 = 1612
    history["displacement"] = u * (0.02 * length / float(np.abs(u).max()))
    assert pictures.magnification(history, frames, length) == 1.0
    assert pictures.magnification(0.0 * history, frames, length) == 1.0
