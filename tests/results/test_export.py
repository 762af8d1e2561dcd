"""What each exported file holds, beside what is stored."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import golden
import numpy as np
import pytest
import pyuff
import xarray as xr
from scipy.io import loadmat
from stack import STOPS, three_laminae, with_stops

import delam_fem as df
from delam_fem.results.export import export, operators
from delam_fem.system.errors import CaseError


def three() -> tuple[xr.Dataset, Any]:
    """Return a history of three laminae with stops and sensors of both clocks, and its case."""
    recorded = three_laminae()
    history = with_stops(recorded.history())
    time = history["time"].to_numpy()
    about = {"units": "m/s2", "long_name": "acceleration of the thin lamina at 0.2 m " + 60 * "x"}
    history["sensor_slow"] = ("sensor_slow_time", np.cos(time[::9]), about)
    history = history.assign_coords(sensor_slow_time=("sensor_slow_time", time[::9]))
    history["sensor a-b"] = ("time", np.sin(time), {"units": "N"})
    history["1st"] = ("time", time**2)
    history.attrs = {"title": "three", "case": "the case", "outcome": "completed",
                     "delam_fem": "0.1"}  # fmt: skip
    case = recorded.case.model_copy(update={"stop": STOPS})
    return history, case


def test_tables_hold_what_is_stored(tmp_path: Path, stored: Callable[..., None]) -> None:
    history, case = three()
    told = []
    for path in export(history, case, "csv", tmp_path / "a.csv"):
        heading, *rows = path.read_text("utf-8").splitlines()
        told += [f"# {path.name}: {len(rows)} rows", heading, *rows[:2], rows[-1]]
        if path.stem not in ("a-fields", "a-shape", "a-events"):
            columns = np.genfromtxt(path, delimiter=",", skip_header=1)
            told += [golden.numbers(column) for column in np.atleast_2d(columns.T)]
    stored("\n".join(told))


def test_matlab_files_hold_what_is_stored(tmp_path: Path, stored: Callable[..., None]) -> None:
    history, case = three()
    history["v" * 70] = ("time", history["time"].to_numpy())
    [path] = export(history, case, "mat", tmp_path / "a.mat")
    content = loadmat(path)
    told = []
    for name in sorted(key for key in content if not key.startswith("__")):
        own = content[name]
        if name in ("units", "meaning", "dimensions"):
            of_names = {key: own[key][0, 0].ravel().tolist() for key in own.dtype.names}
            told += [f"{name}.{key}: {text}" for key, text in sorted(of_names.items())]
        else:
            told.append(f"{name} {own.shape} {own.dtype}: {golden.values_of(own)}")
    stored("\n".join(told))
    assert "v" * 63 in content and "v_1st" in content and "sensor_a_b" in content


def test_universal_files_hold_what_is_stored(tmp_path: Path, stored: Callable[..., None]) -> None:
    history, case = three()
    history = history.isel(frame=slice(0, 5), node=slice(3, 5))
    told = []
    for path in export(history, case, "uff", tmp_path / "a.uff"):
        told.append(f"# {path.name}")
        for own in pyuff.UFF(str(path)).read_sets():
            own = {k: v for k, v in own.items() if not k.endswith("_file_written")}  # now
            texts = {k: v for k, v in own.items() if isinstance(v, (str, int, float))}
            told.append(", ".join(f"{k} {v}" for k, v in texts.items() if v not in ("NONE", "")))
            arrays = [key for key in ("node_nums", "x", "y", "z", "data") if key in own]
            told += [f"  {k} {golden.numbers(np.asarray(own[k], float))}" for k in arrays]
    stored("\n".join(told))
    [alone] = export(history.isel(frame=[0], period=[0]), case, "uff", tmp_path / "b.uff")
    assert alone.name == "b.uff"
    [_, _, _, *sets] = pyuff.UFF(str(alone)).read_sets()  # the only period has a step of 1
    assert {own["abscissa_inc"] for own in sets if own["abscissa_axis_lab"] == "period"} == {1.0}


CASES: dict[str, tuple[str, dict[str, Any]]] = {
    "base": ("paper", {"mesh.elements": 3, "excitation.acceleration": 2.0}),
    "force": ("paper", {"mesh.elements": 2, "excitation": {
        "kind": "force", "lamina": "thin", "position": 0.3, "amplitude": 0.7, "frequency": 3.0}}),
    "sweep": ("embedded", {"mesh.elements": 6, "excitation": {
        "kind": "sweep", "start_frequency": 1.0, "end_frequency": 2.0, "duration": 9.0,
        "acceleration": 1.0}}),
    "stop": ("paper", {"mesh.elements": 2, "contact.impulse": "consistent", "stop": [
        {"lamina": "thick", "side": "below", "gap": 0.001, "position": 0.2}]}),
}  # fmt: skip


@pytest.mark.parametrize("suffix", [".npz", ".mat"])
def test_operators_hold_what_is_stored(
    suffix: str, tmp_path: Path, stored: Callable[..., None]
) -> None:
    told = []
    for name, (of, keys) in CASES.items():
        path = operators(df.preset(of, keys), tmp_path / "new" / f"{name}{suffix}")
        content = dict(np.load(path)) if suffix == ".npz" else loadmat(path)
        told.append(f"# {name}")
        for key in sorted(own for own in content if own[:2] != "__" and own != "case"):
            own = np.asarray(content[key])
            told.append(f"{key} {own.shape} {own.dtype.kind}: {golden.values_of(own)}")
        assert df.preset(of, keys).is_in(str(np.ravel(content["case"])[0]))
    stored("\n".join(told))


def test_what_cannot_be_written_is_refused(tmp_path: Path) -> None:
    history, case = three()
    for to, name, message in (
        ("xls", "a.xls", "--to: expected one of csv, mat, uff, vtkhdf, given 'xls'"),
        ("csv", "a.txt", "--output: expected a file that ends in .csv, given a.txt"),
        ("vtkhdf", "a.vtkhdf", "the run kept no finite frames of its fields; run it again with "
         "output.fields_per_period above 0"),
    ):  # fmt: skip
        with pytest.raises(CaseError) as error:
            export(history.isel(frame=slice(0, 0)), case, to, name)
        assert str(error.value) == message
    assert export(history, case, "csv", tmp_path / "A.CSV")[0].name == "A.CSV"
    with pytest.raises(CaseError) as error:
        operators(df.preset("paper"), tmp_path / "a.txt")
    assert str(error.value) == ("operators: expected a file that ends in .npz or .mat, given a.txt")
