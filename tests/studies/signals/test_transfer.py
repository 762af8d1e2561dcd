"""Frequency responses and poles of systems whose responses are known."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from measurements import write_csv
from scipy.signal import cont2discrete, lfilter
from typer.testing import CliRunner

from delam_fem import read_measured
from delam_fem.api import CaseError
from delam_fem.cli.app import app
from delam_fem.studies.signals.responses import poles, with_responses
from delam_fem.studies.signals.writing import save_pictures

RATE, N, SEGMENT = 200.0, 40_000, 40.0
MODES = ((3.2, 0.012, 1.0), (19.7, 0.008, -5.0))
"""Frequency [Hz], damping ratio and residue of each mode."""


def measured(tmp_path: Path, noise: float = 0.02) -> tuple[Path, np.ndarray]:
    """Write a random force and the response of two modes, filtered exactly between samples."""
    rng = np.random.default_rng(1)
    force = lfilter(np.ones(4) / 4.0, [1.0], rng.normal(0.0, 1.0, N))
    y = np.zeros(N)
    for f, damping, residue in MODES:
        w = 2.0 * np.pi * f
        b, a, _ = cont2discrete(([residue], [1.0, 2.0 * damping * w, w**2]), 1.0 / RATE, "foh")
        y += lfilter(b.ravel(), a, force)
    y += rng.normal(0.0, noise * y.std(), N)
    path = write_csv(tmp_path / "h.csv", np.arange(N) / RATE, {"a": y})
    other = tmp_path / "f.csv"
    body = "\n".join(f"{t!r},{f!r}" for t, f in zip((np.arange(N) / RATE).tolist(), force.tolist(),
                                                     strict=True))  # fmt: skip
    other.write_text(f"time [s],force [N]\n{body}\n")
    return path, force


def exact(f: np.ndarray) -> np.ndarray:
    w = 2.0 * np.pi * f
    terms = [
        r / ((2.0 * np.pi * f0) ** 2 - w**2 + 2j * d * 2.0 * np.pi * f0 * w) for f0, d, r in MODES
    ]
    return np.sum(terms, axis=0)


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> xr.Dataset:
    folder = tmp_path_factory.mktemp("frf")
    path, _ = measured(folder)
    return read_measured(path, folder / "f.csv")


@pytest.mark.parametrize("estimator", ["H1", "H2", "Hv"])
def test_responses_are_those_of_the_modes(data: xr.Dataset, estimator: str) -> None:
    responses = with_responses(data, "force", segment=SEGMENT, estimator=estimator)
    f, h = responses["frequency"].to_numpy(), responses["response"].sel(output="a").to_numpy()
    assert f[1] == pytest.approx(1.0 / SEGMENT)
    assert responses["response"].attrs["units"] == "m/N"
    wanted = exact(f)
    for near in (2.8, 3.6, 19.0, 20.4):  # beside the peaks, which the window widens
        k = int(np.argmin(np.abs(f - near)))
        around = slice(k - 4, k + 5)
        ratio = np.mean(h[around] / wanted[around])
        assert abs(ratio - 1.0) < 0.05, near
        assert responses["coherence"].sel(output="a")[k] > 0.9


def test_responses_are_drawn(data: xr.Dataset, tmp_path: Path) -> None:
    assert len(save_pictures(with_responses(data, "force", segment=SEGMENT), tmp_path)) == 1


def test_a_late_response_has_a_negative_phase_and_noise_takes_coherence() -> None:
    rng, late, share = np.random.default_rng(7), 3, 0.5
    x = rng.normal(0.0, 1.0, N)
    y = 2.0 * np.roll(x, late) + rng.normal(0.0, 2.0 * share, N)
    time = np.arange(N) / RATE
    record = xr.Dataset(
        {"force": ("time", x), "sensor_y": ("time", y),
         "channel_variable": ("channel", ["force", "sensor_y"]),
         "channel_units": ("channel", ["N", "m/s2"]), "channel_lamina": ("channel", ["", ""])},
        {"time": time, "channel": ["force", "y"]},
    )  # fmt: skip
    responses = with_responses(record, "force", segment=1.0)
    f, h = responses["frequency"].to_numpy()[1:-1], responses["response"].to_numpy()[1:-1, 0]
    np.testing.assert_allclose(h, 2.0 * np.exp(-2j * np.pi * f * late / RATE), atol=0.25)
    coherence = float(responses["coherence"][1:-1].mean())
    assert coherence == pytest.approx(1.0 / (1.0 + share**2), abs=0.02)
    assert responses["response_units"].item() in ("1/kg", "m/(N s2)")


def test_poles_are_those_of_the_modes(data: xr.Dataset) -> None:
    pytest.importorskip("sdypy.EMA")
    fitted_poles, _ = poles(with_responses(data, "force", segment=SEGMENT), 1.0, 30.0)
    assert len(fitted_poles) == len(MODES)
    for pole, (frequency, damping, _) in zip(fitted_poles, MODES, strict=True):
        assert pole.frequency == pytest.approx(frequency, rel=1e-3)
        assert pole.damping == pytest.approx(damping, rel=0.06)  # Hann's window added 16 %
        assert (
            abs(pole.damping - damping) < 1.5 * pole.damping_error
        )  # one record in ten is outside


def test_without_the_extra_a_message_says_what_to_install(
    data: xr.Dataset, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "sdypy.EMA", None)
    with pytest.raises(CaseError, match=r'pip install "delam_fem\[ema\]"'):
        poles(with_responses(data, "force"), 1.0, 30.0)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"excitation": "hammer"}, "expected one of the histories a, force, given 'hammer'"),
        ({"excitation": "force", "estimator": "H3"}, "expected one of H1, H2, Hv"),
        ({"excitation": "force", "segment": 150.0}, "half the record"),
    ],
)
def test_bad_requests_are_refused(
    data: xr.Dataset, options: dict[str, object], message: str
) -> None:
    with pytest.raises(CaseError, match=message):
        with_responses(data, **options)  # type: ignore[arg-type]


def test_uneven_samples_are_refused(data: xr.Dataset) -> None:
    time = data["time"].to_numpy().copy()
    time[100:] += 0.01
    with pytest.raises(CaseError, match="equal steps"):
        with_responses(data.assign_coords(time=time), "force")


def test_the_command_writes_responses_and_poles(tmp_path: Path) -> None:
    pytest.importorskip("sdypy.EMA")
    path, _ = measured(tmp_path)
    done = CliRunner().invoke(
        app,
        ["measure", "response", str(path), str(tmp_path / "f.csv"), "-o", str(tmp_path / "out"),
         "--excitation", "force", "--segment", "40", "--poles", "1", "30"],
    )  # fmt: skip
    assert done.exit_code == 0, done.output
    assert re.search(r" 3\.(19[5-9]|20)\d* ±", done.output), done.output
    assert re.search(r" 19\.(69|70)\d* ±", done.output)
    assert (tmp_path / "out" / "responses.png").stat().st_size > 10_000
    again = read_measured(tmp_path / "out" / "measured.nc")
    assert again["response"].dtype.kind == "c"
    assert again.attrs["pole_frequency_hz"][0] == pytest.approx(3.2, rel=1e-3)
