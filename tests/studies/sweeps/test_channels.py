"""Sweeps keep measures of any channel: beside a linear oscillator with known numbers."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from support import refusal

import delam_fem as df

M, K, D, OMEGA = 0.5, 800.0, 0.1, 2.0 * math.pi * 7.0
"""Mass [kg], spring [N/m], damping ratio, angular frequency of the force [rad/s]."""
CASE = f"""
name = "one"
lamina = [{{ name = "one", mass = {M}, stiffness = {K}, damping_ratio = {D} }}]
mesh = {{ elements = 1 }}
contact = {{ law = "none" }}
time = {{ steps_per_period = 500, periods = 30 }}
output = {{ window_periods = 2, fields_per_period = 0 }}

[excitation]
kind = "force"
lamina = "one"
position = 1.0
amplitude = 1.0
frequency = 7.0

[[sensor]]
name = "a1"
lamina = "one"
position = 1.0
quantity = "acceleration"
"""
SWEEP = """
base = "case.toml"

[[axis]]
key = "excitation.amplitude"
values = [1.0, 3.0]

[record]
summary = false
strobes = 0
channels = [{names}]
"""


def sweep_of(folder: Path, names: str) -> df.Sweep:
    (folder / "case.toml").write_text(CASE)
    (folder / "sweep.toml").write_text(SWEEP.format(names=names))
    return df.load_sweep(folder / "sweep.toml")


def test_a_sweep_keeps_measures_of_channels(tmp_path: Path) -> None:
    sweep = sweep_of(tmp_path, '"tip_one_velocity", "a1", "drive"')
    data = df.run_sweep(sweep, tmp_path / "sweep", workers=1)
    ratio = 1.0 / abs(K - M * OMEGA**2 + 2j * D * math.sqrt(K * M) * OMEGA)
    sizes = {
        "tip_one_velocity": (OMEGA * ratio, "m/s"),
        "a1": (OMEGA**2 * ratio, "m/s2"),
        "drive": (1.0, "N"),
    }
    forces = np.array([1.0, 3.0])
    for name, (size, units) in sizes.items():
        expected = {"min": -size, "max": size, "amplitude": size, "rms": size / math.sqrt(2.0)}
        for key, value in expected.items():
            variable = data[f"{name}_{key}"]
            np.testing.assert_allclose(variable, value * forces, rtol=2e-3)
            assert variable.attrs["units"] == units
        assert np.abs(data[f"{name}_mean"]).max() < 1e-2 * size
    assert "tip_min" not in data


@pytest.mark.parametrize("names", ['"tip_two"', '"a1", "a1"'])
def test_channels_that_a_point_does_not_have_are_refused(tmp_path: Path, names: str) -> None:
    sweep = sweep_of(tmp_path, names)
    said = refusal(lambda: df.run_sweep(sweep, tmp_path / "sweep", workers=1))
    assert all(
        word in said for word in ("record.channels", "tip_one_velocity", names.split('"')[1])
    )
    assert not (tmp_path / "sweep").exists()
