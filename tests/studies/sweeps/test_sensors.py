"""Sensors in sweeps: extremes, rms and harmonics of each point."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import delam_fem as df
from delam_fem import load_sweep
from delam_fem.studies.sweeps.point import PointRunner, assembly_key, quantities

TEXT = """
name = "s"
base = "case.toml"
[[axis]]
key = "excitation.frequency"
values = [2.0, 3.0]
[record]
strobes = 0
harmonics = 2
"""
SENSORS = [
    {"name": "d", "quantity": "displacement", "lamina": "thin", "position": 0.685},
    {"name": "slow", "quantity": "displacement", "lamina": "thin", "position": 0.685,
     "sampling_rate": 150.0},
]  # fmt: skip


def test_a_point_keeps_the_numbers_of_its_sensors(tmp_path: Path) -> None:
    keys = {
        "contact.law": "none", "time.periods": 12, "output.window_periods": 8,
        "time.steps_per_period": 200, "sensor": SENSORS, "mesh.elements": 6,
    }  # fmt: skip
    case = df.preset("paper", keys)
    (tmp_path / "case.toml").write_text(case.to_toml())
    (tmp_path / "s.toml").write_text(TEXT)
    runner = PointRunner(load_sweep(tmp_path / "s.toml"))
    point, _ = runner.point(1, None)
    wanted = quantities(runner.sweep.file.record, runner.structure(case).layout)
    places = np.cumsum([0, *(quantity.size for quantity in wanted)])
    row = {q.name: point.row[a : a + q.size] for q, a in zip(wanted, places, strict=False)}
    assert row["sensor_d_max"] == row["tip_max"][1] and row["sensor_d_min"] == row["tip_min"][1]
    assert row["sensor_d_harmonics"] == pytest.approx(row["harmonic_amplitude"][2:], rel=1e-12)
    slow = row["sensor_slow_harmonics"][0]  # by least squares of samples at 150 Hz
    assert slow == pytest.approx(row["sensor_d_harmonics"][0], rel=0.05)
    assert row["sensor_d_rms"] > 0.5 * row["sensor_d_harmonics"][0]
    units = {q.name: q.units for q in wanted}
    assert units["sensor_d_rms"] == "m"


def test_numbers_of_a_sensor_are_in_the_unit_that_the_dataset_says(tmp_path: Path) -> None:
    keys = {"contact.law": "none", "time.periods": 2, "output.window_periods": 1,
            "time.steps_per_period": 100, "sensor": SENSORS[:1], "mesh.elements": 4}  # fmt: skip
    sweep = df.Sweep(
        df.preset("paper", keys),
        {"sensor.d.quantity": ["displacement", "velocity"]},
        record={"channels": ["d"]},
    )
    data = df.run_sweep(sweep, tmp_path / "sweep")
    for name in ("sensor_d_rms", "d_rms"):
        assert data[name].attrs["units"] == "m"
        as_displacement, as_velocity = data[name].values
        assert as_displacement > 0.0
        assert np.isnan(as_velocity)


def test_the_point_of_a_force_is_part_of_the_model() -> None:
    def key(position: float, frequency: float) -> str:
        excitation = {"kind": "force", "lamina": "thin", "amplitude": 0.1, "frequency": frequency}
        keys = {f"excitation.{name}": value for name, value in excitation.items()}
        return assembly_key(df.preset("paper", {**keys, "excitation.position": position}))

    assert key(0.5, 3.0) == key(0.5, 2.0)
    assert key(0.5, 3.0) != key(0.6, 3.0)
