"""Free vibrations over time beside decays that are known exactly."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from measurements import write_csv
from typer.testing import CliRunner

from delam_fem import read_measured
from delam_fem.api import write_dataset
from delam_fem.cli.app import app
from delam_fem.studies.signals.responses import with_free_vibrations

RATE, MODES = 250.0, ((21.0, 0.006), (27.5, 0.008))
"""Samples per second; frequency [Hz] and damping ratio before and after a change at 4 s."""


def decay(t: np.ndarray, frequency: float, damping: float, size: float) -> np.ndarray:
    w = 2.0 * np.pi * frequency
    return size * np.exp(-damping * w * t) * np.cos(w * np.sqrt(1.0 - damping**2) * t + 0.3)


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two decays, each with another mode close by, an offset and noise of 1 % of the first."""
    t = np.arange(1000) / RATE
    parts = [decay(t, *mode, 2.0) + decay(t, 33.0, 0.004, 0.4) + 0.1 for mode in MODES]
    y = np.concatenate(parts) + np.random.default_rng(2).normal(0.0, 0.02, 2000)
    return write_csv(tmp_path_factory.mktemp("free") / "y.csv", np.arange(2000) / RATE, {"y": y})


def test_frequency_damping_and_amplitude_are_those_of_each_decay(path: Path) -> None:
    """Within four of their own errors, which are small; a segment with both has a large one."""
    data = with_free_vibrations(read_measured(path), "y", 15.0, 30.0, 1.0)
    time = data["free_time"].to_numpy()
    assert time[0] == pytest.approx(0.496)
    np.testing.assert_allclose(np.diff(time), 0.496)
    for (frequency, damping), start in zip(MODES, (0.0, 4.0), strict=True):
        inside = np.flatnonzero((time > start + 0.49) & (time < start + 2.0))
        assert inside.size >= 3
        for name, exact, bound in (("frequency", frequency, 0.05), ("damping", damping, 1.5e-3)):
            values, errors = (data[f"free_{n}"].to_numpy()[inside] for n in (name, f"{name}_error"))
            assert np.all(np.abs(values - exact) < 4.0 * errors)
            assert np.all(errors < bound)
        begins = time[inside] - 0.496 - start
        exact_size = 2.0 * np.exp(-damping * 2.0 * np.pi * frequency * begins)
        np.testing.assert_allclose(data["free_amplitude"][inside], exact_size, rtol=0.04)
    both = np.abs(time - 4.0).argmin()
    assert data["free_frequency_error"][both] > 0.05
    assert data["free_amplitude"].attrs["units"] == "m"


def test_the_command_follows_a_channel_and_draws_it(path: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    words = ["measure", "response", str(path), "-o", str(out), "--free", "y", "15", "30"]
    result = CliRunner().invoke(app, [*words, "--segment", "1"])
    assert result.exit_code == 0, result.output
    assert re.search(r"│ 0.496 +│ (20.99|21\.?0?)\d* ± ", result.output)
    assert (out / "free_vibration.png").stat().st_size > 10_000
    assert "free_damping_error" in read_measured(out / "measured.nc")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["z", "15", "30"], "free: "),
        (["y", "30", "15"], "free: "),
        (["y", "15", "120"], "free: "),
        (["y", "15", "30", "--segment", "0.05"], "segments from 0.256 s to the whole record"),
        (["y", "15", "30", "--segment", "9"], "segments from 0.256 s to the whole record"),
    ],
)
def test_what_cannot_be_followed_is_refused(
    path: Path, tmp_path: Path, words: list[str], message: str
) -> None:
    arguments = ["measure", "response", str(path), "-o", str(tmp_path / "o"), "--free", *words]
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 2
    assert message in " ".join(result.output.split())
    assert not (tmp_path / "o").exists()


def test_the_result_of_a_single_lamina_is_read(tmp_path: Path) -> None:
    """It has places of gaps, but none between laminae."""
    time = np.arange(80) / 40.0
    result = xr.Dataset(
        {"tip_displacement": (("lamina", "time"), np.sin(time)[None]),
         "gap0": (("interface", "node"), np.zeros((0, 4)))},
        {"time": time, "lamina": ["only"], "x": ("node", np.linspace(0.0, 0.5, 4))},
    )  # fmt: skip
    data = read_measured(write_dataset(result, tmp_path / "result.nc"), units="SI")
    assert data["tip_displacement"].sizes == {"lamina": 1, "time": 80}
    np.testing.assert_allclose(data["tip_displacement"][0], np.sin(time))
