"""What each exported file holds, as other programs read it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import pyuff
import xarray as xr
from scipy.io import loadmat
from stack import STOPS, three_laminae, with_stops

import delam_fem as df
from delam_fem import operators
from delam_fem.api import CaseError
from delam_fem.results.export import export

SOME = [
    "tip_displacement", "tip_velocity", "probe_displacement", "strobe_displacement", "envelope_min",
    "energy_impact_loss", "x", "tip_node", "gap0", "displacement", "velocity", "contact_state",
    "event_time", "event_node", "event_impulse", "stop_number", "stop_height", "stop_state",
]  # fmt: skip
"""Variables of each set of dimensions: what holds of one holds of the others."""


def three() -> tuple[xr.Dataset, Any]:
    """Return a history of three laminae with stops and sensors of both clocks, and its case."""
    recorded = three_laminae()
    history = with_stops(recorded.history())[SOME]
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


def test_tables_have_the_stored_headings(tmp_path: Path, stored: Callable[[str], None]) -> None:
    history, case = three()
    lines = []
    for path in export(history, case, "csv", tmp_path / "a.csv"):
        heading, *rows = path.read_text("utf-8").splitlines()
        lines += [f"# {path.name}: {len(rows)} rows", heading]
    stored("\n".join(lines))


def test_matlab_files_have_the_stored_variables(
    tmp_path: Path, stored: Callable[[str], None]
) -> None:
    history, case = three()
    history["v" * 70] = ("time", history["time"].to_numpy())
    [path] = export(history, case, "mat", tmp_path / "a.mat")
    content = loadmat(path)
    lines = []
    for name in sorted(key for key in content if not key.startswith("__")):
        array = content[name]
        if name == "meaning":
            assert set(array.dtype.names) >= set(content["units"].dtype.names)
        elif name in ("units", "dimensions"):
            texts = {key: array[key][0, 0].ravel().tolist() for key in array.dtype.names}
            lines += [f"{name}.{key}: {text}" for key, text in sorted(texts.items())]
        else:
            lines.append(f"{name} {array.shape} {array.dtype.kind}")
    stored("\n".join(lines))
    assert "v" * 63 in content and "v_1st" in content and "sensor_a_b" in content
    for name in ("time", "tip_displacement", "displacement"):
        np.testing.assert_array_equal(np.squeeze(content[name]), history[name].to_numpy())


def test_universal_files_have_the_stored_sets(
    tmp_path: Path, stored: Callable[[str], None]
) -> None:
    history, case = three()
    history = history.isel(frame=slice(0, 5), node=slice(3, 5))
    lines = []
    for path in export(history, case, "uff", tmp_path / "a.uff"):
        lines.append(f"# {path.name}")
        for dataset in pyuff.UFF(str(path)).read_sets():
            texts = {key: text for key, text in dataset.items() if isinstance(text, (str, int))}
            lines.append(", ".join(f"{k} {v}" for k, v in texts.items() if is_word(k, v)))
    stored("\n".join(lines))
    [alone] = export(history.isel(frame=[0], period=[0]), case, "uff", tmp_path / "b.uff")
    assert alone.name == "b.uff"
    [_, _, _, *sets] = pyuff.UFF(str(alone)).read_sets()  # the only period has a step of 1
    assert {
        dataset["abscissa_inc"] for dataset in sets if dataset["abscissa_axis_lab"] == "period"
    } == {1.0}


def is_word(key: str, value: str | int) -> bool:
    """Return whether an entry of a set is the same tomorrow; "id2" says what a set is."""
    return value not in ("NONE", "") and not key.endswith("_file_written") and key != "id2"


def test_what_cannot_be_written_is_refused(tmp_path: Path) -> None:
    history, case = three()
    for to, name, message in (
        ("xls", "a.xls", "--to: expected .*csv, mat, uff, vtkhdf.* 'xls'"),
        ("csv", "a.txt", "--output: expected .*.csv, .*a.txt"),
        ("vtkhdf", "a.vtkhdf", "frames.*output.fields_per_period"),
    ):
        with pytest.raises(CaseError, match=message):
            export(history.isel(frame=slice(0, 0)), case, to, name)
    assert export(history, case, "csv", tmp_path / "A.CSV")[0].name == "A.CSV"
    with pytest.raises(CaseError, match=r"operators: expected .*.npz or .mat, .*a.txt"):
        operators(df.preset("paper"), tmp_path / "a.txt")


def test_a_case_is_named_as_everywhere(tmp_path: Path) -> None:
    """A file of a case has the operators and the basis of the case."""
    case = df.preset("default", {"mesh.elements": 3})
    (tmp_path / "case.toml").write_text(case.to_toml())
    by_case, by_file = (
        np.load(operators(source, tmp_path / "operators.npz"))["K"]
        for source in (case, str(tmp_path / "case.toml"))
    )
    np.testing.assert_array_equal(by_case, by_file)
    bases = [df.reduced_case(source, 2) for source in (case, tmp_path / "case.toml")]
    np.testing.assert_array_equal(bases[0].frequencies, bases[1].frequencies)
