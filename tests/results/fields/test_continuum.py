"""The fields of solids at the frames: beside the readings, the impulses and VTK's own reader."""

from collections.abc import Iterator
from pathlib import Path

import h5py
import numpy as np
import pytest
import pyvista as pv
import xarray as xr
from mpi_pool import Crew
from vtkmodules.vtkCommonExecutionModel import vtkStreamingDemandDrivenPipeline
from vtkmodules.vtkIOHDF import vtkHDFReader

import delam_fem as df
from delam_fem.api import FloatArray, Result
from delam_fem.results.fields.laminae import contact_force_of_laminae
from delam_fem.results.fields.solids import Frames, write_solid
from delam_fem.system.written import LIST

KEYS = {
    "excitation.frequency": 3.25,
    "model.poisson": 0.3,
    "mesh.elements": 8,
    "time.steps_per_period": 400,
    "time.periods": 2,
    "output.window_periods": 2,
    "output.fields_per_period": 40,
}
SOLIDS = {
    "plane-stress": {"model.kind": "plane-stress", "contact.law": "newton@moreau-jean"},
    "solid": {"model.kind": "solid", "model.strips": 2, "contact.law": "newton@moreau-jean"},
    "springs": {"model.kind": "plane-stress", "contact.law": "penalty@newmark",
                "contact.penalty_damping": 0.05, "output.window_periods": 1},
}  # fmt: skip
FLOAT32 = 2e-7


@pytest.fixture(scope="module", params=SOLIDS)
def result(request: pytest.FixtureRequest) -> Iterator[Result]:
    keys = {**KEYS, **SOLIDS[request.param]}
    if request.param == "solid":
        keys |= {"mesh.elements": 4, "time.steps_per_period": 200}
    yield df.run(df.preset("paper", keys))


def frames_of(result: Result) -> Frames:
    assert result.solid is not None
    return result.solid


def surface(frames: Frames, lamina: int, side: int) -> tuple[FloatArray, FloatArray]:
    """Return the points of a surface and the area of each, by the trapezoidal rule of its nodes."""
    shape = frames.shape
    y = shape.points[:, 1]
    of_lamina = shape.lamina == lamina
    level = y[of_lamina].max() if side > 0 else y[of_lamina].min()
    points = np.flatnonzero(of_lamina & (np.abs(y - level) < 1e-12))
    weights = np.ones(points.size)
    for axis in (0, 2)[: shape.mesh.dim - 1]:
        places, number = np.unique(np.round(shape.points[points, axis], 9), return_inverse=True)
        share = np.zeros(places.size)
        share[:-1] += 0.5 * np.diff(places)
        share[1:] += 0.5 * np.diff(places)
        weights *= share[number]
    return points, weights * (float(shape.width.min()) if shape.mesh.dim == 2 else 1.0)


def test_middle_lines_move_as_the_dataset_says(result: Result) -> None:
    frames, history = frames_of(result), result.history
    np.testing.assert_allclose(frames.times, history["frame"], rtol=1e-13)
    np.testing.assert_allclose(frames.spans, np.diff(frames.times)[0], rtol=1e-9)
    shape = frames.shape
    x = history["x"].to_numpy()
    for lamina in (0, 1):
        height = np.median(shape.points[shape.lamina == lamina, 1])
        is_on_line = (shape.lamina == lamina) & (np.abs(shape.points[:, 1] - height) < 1e-12)
        if shape.mesh.dim == 3:
            is_on_line &= np.abs(shape.points[:, 2]) < 1e-12
        nodes = np.flatnonzero(is_on_line)
        nodes = nodes[np.argsort(shape.points[nodes, 0])][::2]  # without those inside cells
        np.testing.assert_allclose(shape.points[nodes, 0], x, atol=1e-12)
        for k in (0, 5, frames.times.size - 1):
            fields = frames.fields(k)
            for name in ("displacement", "velocity"):
                expected = history[name].to_numpy()[lamina]
                atol = FLOAT32 * np.abs(expected).max()
                motion = fields[name][nodes, 1]
                np.testing.assert_allclose(motion, expected[k], rtol=0.0, atol=atol)


def test_pressure_integrates_to_the_impulses_and_springs(result: Result) -> None:
    frames, history, case = frames_of(result), result.history, result.case
    of_events = events_between(history)
    forces = contact_force_of_laminae(history, case)[0].sum(axis=-1)
    assert max(of_events.max(), np.abs(forces).max()) > 0.0, "the laminae touch"
    for lamina, side in ((0, 1), (1, -1)):
        points, area = surface(frames, lamina, side)
        fields = [frames.fields(k) for k in range(frames.times.size)]
        impulse = np.array([arrays["contact_impulse"][points] @ area for arrays in fields])
        np.testing.assert_allclose(impulse, of_events, atol=1e-6 * (of_events.max() + 1e-12))
        total = np.array([arrays["contact_pressure"][points] @ area for arrays in fields])
        expected = of_events / (case.period / KEYS["output.fields_per_period"]) + forces
        # the dataset takes the forces of springs from the gaps of middle lines
        np.testing.assert_allclose(total, expected, rtol=1e-5, atol=2e-6 * np.abs(expected).max())


def events_between(history: xr.Dataset) -> FloatArray:
    """Return the sum of the impulses since the frame before, shape (n_frames,) [N s]."""
    frames = history["frame"].to_numpy()
    edges = np.concatenate([[-np.inf], frames + 1e-9])
    counts, _ = np.histogram(
        history["event_time"], bins=edges, weights=history["event_impulse"].to_numpy()
    )
    return np.asarray(counts)


def test_vtk_reads_the_file(result: Result, tmp_path: Path) -> None:
    frames = frames_of(result)
    path = write_solid(frames, tmp_path / "fields")
    reader = vtkHDFReader()
    reader.SetFileName(str(path))
    reader.UpdateInformation()
    times = reader.GetOutputInformation(0).Get(vtkStreamingDemandDrivenPipeline.TIME_STEPS())
    assert list(times) == frames.times.tolist()
    for frame in (0, 7, len(times) - 1):
        reader.UpdateTimeStep(times[frame])
        grid, expected = pv.wrap(reader.GetOutput()), frames.fields(frame)
        for name, values in expected.items():
            np.testing.assert_array_equal(grid.point_data[name], values)
        np.testing.assert_array_equal(grid.point_data["rise"], frames.rise)
    sizes = grid.compute_cell_sizes()
    total = sizes["Area" if frames.shape.mesh.dim == 2 else "Volume"].sum()
    lamina = result.case.lamina
    across = [layer.width if frames.shape.mesh.dim == 3 else 1.0 for layer in lamina]
    expected_size = sum(o.length * o.thickness * b for o, b in zip(lamina, across, strict=True))
    assert total == pytest.approx(expected_size, rel=1e-3), "a gap at rest bends the mesh a little"
    assert set(grid.cell_data["lamina"]) == {1, 2}


def test_points_at_rest_are_the_gap_apart(result: Result) -> None:
    frames, case = frames_of(result), result.case
    points = frames.grid.points
    lower, _ = surface(frames, 0, 1)
    upper, _ = surface(frames, 1, -1)
    key = [
        np.lexsort((points[nodes, 2], np.round(points[nodes, 0], 9))) for nodes in (lower, upper)
    ]
    gap = points[upper[key[1]], 1] - points[lower[key[0]], 1]
    x = points[lower[key[0]], 0]
    at_pairs = np.isin(np.round(x, 6), np.round(result.history["x"].to_numpy(), 6))
    np.testing.assert_allclose(
        gap[at_pairs], (0.012 * (x / case.length) ** 2)[at_pairs], atol=1e-12
    )
    assert gap.max() == pytest.approx(0.012)


def test_a_run_of_beams_leaves_no_solid(tmp_path: Path) -> None:
    stale = tmp_path / "fields" / "solid.vtkhdf"
    stale.parent.mkdir()
    stale.write_bytes(b"of another run")
    (tmp_path / LIST).write_text("fields/solid.vtkhdf\n")
    case = df.preset("paper", {"time.periods": 1, "output.window_periods": 1})
    result = df.run(case)
    assert result.solid is None
    result.save(tmp_path, figures=False)
    assert not stale.exists()


def test_no_frames_give_no_solid() -> None:
    keys = {**KEYS, **SOLIDS["plane-stress"], "output.fields_per_period": 0, "time.periods": 1}
    case = df.preset("paper", {**keys, "output.window_periods": 1, "time.steps_per_period": 20})
    assert df.run(case).solid is None


RANKS = """
from pathlib import Path
import delam_fem as df
from delam_fem.engines.session import session_of
from delam_fem.model import discretise
from delam_fem.system.mpi import MPI
from delam_fem.results.fields import solids

case = df.preset("paper", eval(arguments[1]))
for own in (MPI.COMM_SELF, comm):
    structure = discretise.assemble(case, comm=own)
    with session_of(case, structure.operators, engine="petsc", comm=own) as opened:
        opened.run(lambda period: False)
        frames = solids.collected(structure, opened.recorder, case)
    assert (frames is None) == (own.rank > 0)
    if comm.rank == 0:
        solids.write_solid(frames, Path(arguments[0]) / str(own.size))
"""


@pytest.mark.mpi
def test_several_ranks_give_the_same_fields(crew: Crew, tmp_path: Path) -> None:
    keys = {**KEYS, **SOLIDS["plane-stress"], "time.periods": 1, "output.window_periods": 1}
    keys |= {"time.steps_per_period": 100, "output.fields_per_period": 10}
    crew.run(2, RANKS, tmp_path, keys)
    results = []
    for ranks in ("1", "2"):
        with h5py.File(tmp_path / ranks / "solid.vtkhdf") as file:
            root = file["VTKHDF"]
            points = root["Points"][:]
            order = np.lexsort(np.round(points, 9).T)  # nodes have other numbers on other ranks
            point_data = {
                key: values[:] for key, values in root["PointData"].items() if key != "rise"
            }
            every = {
                key: values.reshape(-1, len(points), *values.shape[1:])[:, order]
                for key, values in point_data.items()
            }
            results.append((points[order], every))
    (points, one), (others, several) = results
    np.testing.assert_allclose(points, others, atol=1e-12)
    for key, values in one.items():
        np.testing.assert_allclose(several[key], values, atol=1e-5 * np.abs(values).max() + 1e-30)
        assert np.abs(values).max() > 0.0 or "contact" in key
