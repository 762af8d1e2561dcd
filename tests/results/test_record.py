"""The record of a run, beside a linear oscillator and masses on stops with known answers."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from scipy import sparse
from support import refusal

import delam_fem as df
from delam_fem import load_result
from delam_fem.api import assemble, histories_of, offered, session_of
from delam_fem.results.folder import load_numbers

M, K, D, F, OMEGA = 0.5, 800.0, 0.05, 2.0, 2.0 * math.pi * 7.0
"""Mass [kg], spring [N/m] (6.37 Hz), damping ratio, force [N] and its angular frequency [rad/s]."""
DAMPER = 2.0 * D * math.sqrt(K * M)
POINT = {"name": "one", "mass": M, "stiffness": K, "damping_ratio": D}
FORCE = {"kind": "force", "lamina": "one", "position": 1.0, "amplitude": F, "frequency": 7.0}
SENSORS = [
    {"name": quantity, "lamina": "one", "position": 1.0, "quantity": quantity}
    for quantity in ("displacement", "velocity", "acceleration")
]
LOAD_CELL = {"name": "cell", "quantity": "contact force", "stop": 1}
MEASURES = ("min", "max", "amplitude", "rms")


def case_of(**sections: Any) -> df.Case:
    defaults: dict[str, Any] = {
        "name": "one", "lamina": [POINT], "mesh": {"elements": 1}, "excitation": FORCE,
        "contact": {"law": "none"}, "time": {"steps_per_period": 1000, "periods": 40},
        "output": {"window_periods": 4, "fields_per_period": 0},
    }  # fmt: skip
    return df.Case(**(defaults | sections))


def of_sine(amplitude: float) -> dict[str, float]:
    numbers = (-amplitude, amplitude, amplitude, amplitude / math.sqrt(2.0))
    return dict(zip(MEASURES, numbers, strict=True))


def require_numbers(entry: dict[str, Any], expected: dict[str, float], rel: float = 2e-4) -> None:
    numbers = {key: entry[key] for key in MEASURES}
    assert numbers == pytest.approx(expected, rel=rel)


@pytest.mark.parametrize(
    ("name", "power", "units", "quantity"),
    [
        ("tip_one", 0, "m", "displacement"),
        ("tip_one_velocity", 1, "m/s", "velocity"),
        ("displacement", 0, "m", "displacement"),
        ("velocity", 1, "m/s", "velocity"),
        ("acceleration", 2, "m/s2", "acceleration"),
    ],
)
def test_channels_of_a_linear_oscillator(name: str, power: int, units: str, quantity: str) -> None:
    result = df.run(case_of(sensor=SENSORS), engine="compiled")
    amplitude = F / abs(K - M * OMEGA**2 + 1j * OMEGA * DAMPER) * OMEGA**power
    entry = result.summary["channels"][name]
    require_numbers(entry, of_sine(amplitude))
    channel = result.record[name]
    assert (entry["units"], channel.attrs["units"], channel.attrs["quantity"]) == (
        units, units, quantity,
    )  # fmt: skip
    assert channel.attrs["lamina"] == "one"


def test_the_force_of_a_drive_is_a_channel() -> None:
    result = df.run(case_of(), engine="compiled")
    entry = result.summary["channels"]["drive"]
    require_numbers(entry, of_sine(F))
    assert entry["units"] == "N"
    assert "base" not in result.record


def test_the_motion_of_a_base_is_a_channel() -> None:
    base = {"kind": "harmonic", "frequency": 7.0, "amplitude": 3e-4}
    result = df.run(case_of(excitation=base), engine="compiled")
    require_numbers(result.summary["channels"]["base"], of_sine(3e-4))
    assert result.record["base"].attrs["quantity"] == "base displacement"
    # a mass on a moving base: u = q_b (K + i ω c) / (K - M ω² + i ω c)
    ratio = (K + 1j * OMEGA * DAMPER) / (K - M * OMEGA**2 + 1j * OMEGA * DAMPER)
    require_numbers(result.summary["channels"]["tip_one"], of_sine(3e-4 * abs(ratio)))


@pytest.mark.parametrize(
    ("stop", "contact"),
    [
        ({"stiffness": 4000.0}, {"law": "penalty"}),
        ({}, {"law": "newton", "restitution": 0.3}),
    ],
    ids=["elastic", "rigid"],
)
def test_the_mean_force_of_a_stop_balances_the_mean_of_the_spring(
    stop: dict[str, Any], contact: dict[str, Any]
) -> None:
    above = {"lamina": "one", "side": "above", "gap": 1.5e-3, "on": "ground", **stop}
    case = case_of(stop=[above], contact=contact, sensor=[LOAD_CELL],
                   time={"steps_per_period": 2000, "periods": 60})  # fmt: skip
    record = df.run(case, engine="compiled").record
    force = record["contact_stop 1"]
    assert (force.attrs["units"], force.attrs["quantity"]) == ("N", "contact force")
    # over whole periods of a settled motion the mean of M v' is 0: the stop presses down
    assert float(force.mean()) == pytest.approx(-K * float(record["tip_one"].mean()), rel=2e-3)
    assert float(force.max()) > 0.0
    np.testing.assert_allclose(force, record["cell"], atol=1e-12 * float(force.max()))


def test_impulses_of_an_interface_are_those_of_its_impacts() -> None:
    case = df.preset("paper", {"time.periods": 6, "output.window_periods": 3})
    assert case.contact.law == "newton-penalty"  # its springs are recorded where a sensor asks
    result = df.run(case, engine="compiled")
    channel = result.record["contact_thick-thin"]
    assert (channel.attrs["units"], channel.attrs["quantity"]) == ("N s", "impulse")
    assert float(channel.sum()) == pytest.approx(float(result.history["impulse_sum"][-3:].sum()))
    cell = {"name": "all", "quantity": "contact force", "between": ["thick", "thin"]}
    known = df.run(df.Case(**(case.model_dump() | {"sensor": [cell]})), engine="compiled").record
    force = known["contact_thick-thin"]
    assert force.attrs["units"] == "N"
    np.testing.assert_allclose(force, known["all"], atol=1e-12 * float(force.max()))


def test_a_record_goes_to_a_file_and_back(tmp_path: Path) -> None:
    sampled = {**SENSORS[2], "name": "drive", "sampling_rate": 300.0, "noise": 1e-3}
    result = df.run(case_of(sensor=[sampled]), engine="compiled")
    record = result.record
    again = df.read_record(df.write_record(record, tmp_path / "record.nc"))
    xr.testing.assert_equal(again, record)
    assert record["sensor_drive"].dims == ("sensor_drive_time",)  # "drive" is the force
    for name, channel in record.data_vars.items():
        assert again[name].attrs == channel.attrs
    assert again.attrs["case"] == result.case.to_toml()
    assert again.attrs["numpy"] == np.__version__


def test_other_files_are_no_records(tmp_path: Path) -> None:
    result = df.run(case_of(), engine="compiled")
    result.save(tmp_path / "run", figures=False)
    assert "schema" in refusal(lambda: df.read_record(tmp_path / "run" / "result.nc"))
    assert refusal(lambda: df.read_record(tmp_path / "x.nc")).endswith(
        "x.nc: there is no such file"
    )
    of_result = refusal(lambda: df.write_record(result, tmp_path / "x.nc"))  # type: ignore[arg-type]
    assert of_result == "record: expected a dataset such as result.record, given 'Result'"
    assert not (tmp_path / "x.nc").exists()


def test_a_result_that_is_loaded_has_the_same_record(tmp_path: Path) -> None:
    stop = {"lamina": "one", "side": "above", "gap": 1.5e-3, "on": "ground", "stiffness": 4000.0}
    result = df.run(case_of(stop=[stop], contact={"law": "penalty"}), engine="compiled")
    result.save(tmp_path / "run", figures=False)
    xr.testing.assert_equal(load_result(tmp_path / "run").record, result.record)
    path = tmp_path / "run" / "summary.json"
    summary = json.loads(path.read_text())
    summary["channels"]["tip_one"]["rms"] = "large"
    path.write_text(json.dumps(summary))
    assert "channels" in refusal(lambda: load_numbers(tmp_path / "run"))


def test_probes_of_operators_are_channels() -> None:
    one = sparse.csr_matrix([[1.0]])
    operators = df.Operators(
        mass=one * M, damping=one * DAMPER, stiffness=one * K, gap_matrix=one,
        gap0=np.ones(1), probes=one, base=df.BaseCoupling.force(np.ones(1)), names=("end",),
    )  # fmt: skip
    result = df.run(
        operators, engine="compiled", law="none", scheme="newmark", periods=40,
        steps_per_period=1000, drive=df.HarmonicMotion(7.0, F), window_periods=4,
    )  # fmt: skip
    amplitude = F / abs(K - M * OMEGA**2 + 1j * OMEGA * DAMPER)
    values = result.record["tip_end"].to_numpy()
    assert np.ptp(values) / 2.0 == pytest.approx(amplitude, rel=2e-4)


STOPS = [{"lamina": "one", "side": "above", "gap": 1.5e-3, "on": "ground"}]
ELASTIC = [{**STOPS[0], "stiffness": 4000.0}]
SAME_NAME = {**SENSORS[0], "name": "tip_one", "sampling_rate": 300.0}
FEW = {"time.periods": 1, "output.window_periods": 1, "mesh.elements": 12}
FORCES = [{"name": "all", "quantity": "contact force", "between": ["thick", "thin"]}]


@pytest.mark.parametrize(
    "case",
    [
        case_of(sensor=[SAME_NAME]),
        case_of(stop=STOPS, contact={"law": "newton"}),
        case_of(stop=ELASTIC, contact={"law": "penalty"}, sensor=[LOAD_CELL]),
        *(df.preset("paper", {**FEW, "contact.law": law}) for law in ("newton", "penalty")),
        df.preset("paper", FEW),
        df.preset("paper", {**FEW, "sensor": FORCES}),
        df.preset("embedded", FEW),
    ],
    ids=["sensor", "rigid", "elastic", "newton", "penalty", "both", "forces", "delamination"],
)
def test_the_channels_of_a_case_are_known_before_it_runs(case: df.Case) -> None:
    record = df.run(case, engine="compiled").record
    units = {str(name): channel.attrs["units"] for name, channel in record.data_vars.items()}
    assert offered(assemble(case, needs_dolfinx=False).layout, case) == units


@pytest.mark.parametrize("name", ["rigid", "elastic", "both", "sensor"])
def test_histories_of_a_recorder_are_the_record(name: str) -> None:
    """Sweeps and refinement studies take channels from the recorder, results from their dataset."""
    case = {
        "rigid": case_of(stop=STOPS, contact={"law": "newton"}),
        "elastic": case_of(stop=ELASTIC, contact={"law": "penalty"}, sensor=[LOAD_CELL]),
        "both": df.preset("paper", FEW),
        "sensor": case_of(sensor=[SAME_NAME]),
    }[name]
    structure = assemble(case, needs_dolfinx=False)
    with session_of(case, structure.operators, engine="compiled") as opened:
        opened.run()
        histories = histories_of(opened.recorder, structure, case)
    record = df.run(case, "compiled", structure=structure).record
    assert set(map(str, record.data_vars)) <= set(histories)
    for key, channel in record.data_vars.items():
        history = histories[str(key)]
        np.testing.assert_array_equal(history.values, channel)
        np.testing.assert_allclose(history.time, channel[channel.dims[0]], rtol=1e-12)
        assert history.units == channel.attrs["units"]
