"""What is exported is read back by other libraries and by our own readers."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import pyuff
import pyvista as pv
import xarray as xr
from scipy.io import loadmat
from synthetic import FRAMES, NODES, STEPS, WINDOW, small_case, synthetic_history
from vtkmodules.vtkIOHDF import vtkHDFReader

import delam_fem as df
from delam_fem.api import CaseError, Result
from delam_fem.results.diagnostics import summary
from delam_fem.studies.signals.reading import scan

CASE = small_case()
HISTORY = synthetic_history(CASE)
UFF_DIGITS = 1e-11
"""Relative precision of numbers with twelve digits."""


@pytest.fixture(scope="module")
def result() -> Result:
    """Return a result with a sensor that has a clock of its own."""
    t = HISTORY["time"].to_numpy()[::4]
    about = {"units": "m/s2", "long_name": "acceleration"}
    slow = xr.DataArray(np.sin(t), dims=("sensor_mid_time",), attrs=about)
    history = HISTORY.assign(sensor_mid=slow).assign_coords(
        sensor_mid_time=("sensor_mid_time", t, {"units": "s"})
    )
    return Result(CASE, history, summary(HISTORY, CASE), None)


def test_tables(result: Result, tmp_path: Path) -> None:
    written = result.export("csv", tmp_path / "new" / "a.csv")
    assert {path.name for path in written} >= {
        "a.csv", "a-periods.csv", "a-events.csv", "a-fields.csv", "a-shape.csv",
    }  # fmt: skip
    back = df.read_measured(tmp_path / "new" / "a.csv")
    for name in ("time", "tip_displacement", "tip_velocity", "base_displacement"):
        np.testing.assert_array_equal(back[name], HISTORY[name])
    gap = df.read_measured(tmp_path / "new" / "a-shape.csv")
    np.testing.assert_array_equal(gap["gap0"], HISTORY["gap0"])
    events = np.genfromtxt(tmp_path / "new" / "a-events.csv", delimiter=",", names=True)
    np.testing.assert_array_equal(events["event_impulse_N_s"], HISTORY["event_impulse"])
    periods = np.genfromtxt(tmp_path / "new" / "a-periods.csv", delimiter=",", names=True)
    np.testing.assert_array_equal(
        periods["strobe_displacement_thin_m"], HISTORY["strobe_displacement"].sel(lamina="thin")
    )
    lines = (tmp_path / "new" / "a-fields.csv").read_text().splitlines()
    assert "displacement [m]" in lines[0]
    assert len(lines) == 1 + 2 * FRAMES * WINDOW * NODES


def test_matlab(result: Result, tmp_path: Path) -> None:
    (path,) = result.export("mat", tmp_path / "a.mat")
    back = loadmat(path, simplify_cells=True)
    for name in ("tip_displacement", "strobe_velocity", "event_impulse", "displacement", "x"):
        np.testing.assert_array_equal(back[name], HISTORY[name])
    assert list(back["lamina"]) == ["thick", "thin"]
    assert back["units"]["tip_velocity"] == "m/s"
    assert back["dimensions"]["displacement"] == "lamina, frame, node"
    assert "young_modulus" not in back["outcome"]
    measured = df.read_measured(path)
    np.testing.assert_array_equal(measured["tip_displacement"], HISTORY["tip_displacement"])
    assert measured["lamina"].to_numpy().tolist() == ["thick", "thin"]
    np.testing.assert_array_equal(measured["gap0"], HISTORY["gap0"])


def close(found: object, wanted: xr.DataArray) -> bool:
    scale = float(np.abs(wanted).max())
    return bool(np.all(np.abs(np.asarray(found) - wanted.to_numpy()) <= UFF_DIGITS * scale))


def test_universal_files(result: Result, tmp_path: Path) -> None:
    main, fields = result.export("uff", tmp_path / "a.uff")
    sets = pyuff.UFF(str(main)).read_sets()
    assert [dataset["type"] for dataset in sets][:3] == [151, 164, 15]
    assert [sets[1][key] for key in ("length", "force", "temp", "temp_offset")] == [1, 1, 1, 273.15]
    named = {dataset["id1"]: dataset for dataset in sets[3:]}
    tip = named["tip_displacement thin"]
    assert close(tip["data"], HISTORY["tip_displacement"].sel(lamina="thin"))
    assert tip["ordinate_axis_units_lab"] == "m" and tip["ordinate_spec_data_type"] == 8
    strobe = named["strobe_displacement thick"]
    assert close(strobe["data"], HISTORY["strobe_displacement"].sel(lamina="thick"))
    assert named["sensor_mid"]["ordinate_spec_data_type"] == 12
    start = float(HISTORY["time"][0])
    assert tip["id3"] == f"abscissa from {start!r}"
    back = df.read_measured(main)
    common = back.sizes["time"]  # the sensor ends three steps earlier
    assert close(back["tip_displacement"], HISTORY["tip_displacement"][:, :common])
    assert np.allclose(back["time"], HISTORY["time"][:common] - start, rtol=1e-5)
    field = scan(df.read_measured(fields), "velocity", None)
    assert field.sizes == {"time": FRAMES * WINDOW, "point": 2 * NODES}
    assert np.allclose(np.unique(field["position"]), HISTORY["x"])
    assert np.allclose(np.abs(field).max(), np.abs(HISTORY["velocity"]).max())


def test_vtkhdf(result: Result, tmp_path: Path) -> None:
    (path,) = result.export("vtkhdf", tmp_path / "a.vtkhdf")
    reader = vtkHDFReader()
    reader.SetFileName(str(path))
    reader.UpdateInformation()
    assert reader.GetNumberOfSteps() == FRAMES * WINDOW
    reader.SetStep(7)
    reader.Update()
    lateral = pv.wrap(reader.GetOutput())["displacement"][:, 1]
    assert lateral.max() == pytest.approx(float(HISTORY["displacement"][:, 7].max()))


def test_an_overlay_of_an_export_on_its_run_is_exact(result: Result, tmp_path: Path) -> None:
    (path,) = result.export("mat", tmp_path / "a.mat")
    comparison = df.overlay(result, path)
    assert abs(comparison.offset) < 1e-8 * CASE.period
    assert all(channel.gain == pytest.approx(1.0, abs=1e-9) for channel in comparison.channels)
    assert not comparison.findings and comparison.pairs.time.size == STEPS * WINDOW


@pytest.mark.parametrize(
    ("to", "name", "message"),
    [
        ("xls", "a.xls", "expected one of csv, mat, uff, vtkhdf, given 'xls'"),
        ("csv", "a.txt", "expected a file that ends in .csv"),
        ("vtkhdf", "a.vtkhdf", "no finite frames"),
    ],
)
def test_what_cannot_be_exported_is_refused(
    tmp_path: Path, to: str, name: str, message: str
) -> None:
    none = Result(CASE, HISTORY.isel(frame=slice(0, 0)), {}, None)
    with pytest.raises(CaseError, match=message):
        none.export(to, tmp_path / name)
    assert not list(tmp_path.iterdir())
