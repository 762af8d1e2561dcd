"""A measurement made from a run lies on it again: offset, clock, noise, scale and phase."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from measurements import recorded, write_csv
from scipy.interpolate import CubicSpline
from scipy.stats import binom
from synthetic import AMPLITUDES, SWEEP, small_case, synthetic_history

import delam_fem as df
from delam_fem.api import CaseError, Result
from delam_fem.results.diagnostics import summary
from delam_fem.studies.signals.overlay import Overlay

NOISE = 3e-4
"""Standard deviation of the noise [m]: 3 % of the amplitudes."""
START = 14.3217
"""Time of the run at which the recorder starts [s]."""
SIGMAS = 4.0
"""Deviations within which an estimate must be: one in 16 000 fails by chance; the seed is fixed."""


def result(subharmonic: float = 0.0, **overrides: object) -> Result:
    case = small_case(**overrides)
    history = synthetic_history(case, subharmonic=subharmonic)
    return Result(case, history, summary(history, case), None)


RUN = result()
PERIOD = RUN.case.period


def measurement(
    folder: Path, *, thick: float = 1.0, thin: float = 1.0, late: float = 0.0, **options: float
) -> Path:
    """Write a measurement whose channels are scaled, and one of them late by a time [s]."""
    about = {"period": PERIOD, "start": START, "noise": NOISE} | options
    t, (a, _) = recorded(RUN.history, **about)
    _, (_, b) = recorded(RUN.history, **(about | {"start": about["start"] - late}))
    return write_csv(folder / "tips.csv", t, {"tip thick": thick * a, "tip thin": thin * b})


def wrapped(difference: float, period: float = PERIOD) -> float:
    return (difference + period / 2) % period - period / 2


@pytest.mark.parametrize(("rate", "start"), [(1024.0, START), (333.0, 0.01), (5000.0, 14.9)])
def test_offset_and_noise_are_found_back(tmp_path: Path, rate: float, start: float) -> None:
    comparison = df.overlay(RUN, measurement(tmp_path, rate=rate, start=start))
    error = comparison.alignment.start_error
    assert 0.0 < error < 1e-3 * PERIOD
    assert abs(wrapped(comparison.offset - start)) < SIGMAS * error
    for channel in comparison.channels:
        spread = 1.0 / np.sqrt(2.0 * (comparison.pairs.time.size - 81))  # 40 harmonics and a mean
        assert channel.noise == pytest.approx(NOISE, rel=SIGMAS * spread)
        assert abs(channel.gain - 1.0) < SIGMAS * channel.gain_error < 0.01
        assert abs(channel.delay) < SIGMAS * channel.delay_error
        assert (
            channel.misfit is not None and channel.misfit < 0.5 * NOISE
        )  # 81 numbers from 666 samples leave 0.35
    assert not comparison.findings and comparison.numbers["verdict"] == "agrees"


def test_errors_of_the_offset_are_those_of_many_measurements(tmp_path: Path) -> None:
    t, clean = recorded(RUN.history, period=PERIOD, start=START, rate=300.0)
    rng, scores = np.random.default_rng(8), []
    for _ in range(15):
        noisy = clean + rng.normal(0.0, NOISE, clean.shape)
        path = write_csv(tmp_path / "m.csv", t, {"tip thick": noisy[0], "tip thin": noisy[1]})
        comparison = df.overlay(RUN, path)
        scores.append(wrapped(comparison.offset - START) / comparison.alignment.start_error)
    assert 0.5 < float(np.std(scores)) < 1.5
    assert abs(float(np.mean(scores))) < 0.8


def test_harmonics_and_distortion_are_those_of_the_motion(tmp_path: Path) -> None:
    comparison = df.overlay(RUN, measurement(tmp_path, duration=6.0))
    for channel, exact in zip(comparison.channels, AMPLITUDES, strict=True):
        assert channel.measured is not None and channel.computed is not None
        assert channel.measured.amplitudes[:3] == pytest.approx(
            exact, abs=SIGMAS * channel.measured.floor
        )
        d = np.sqrt((exact**2).sum()) / exact[0] - 1.0
        measured, error = channel.measured.distortion()
        assert abs(measured - d) < SIGMAS * error
        assert channel.computed.distortion()[0] == pytest.approx(d, rel=1e-3)


@pytest.mark.parametrize("clock", [1.0004, 0.997])
def test_a_clock_that_runs_wrong_is_found(tmp_path: Path, clock: float) -> None:
    comparison = df.overlay(RUN, measurement(tmp_path, clock=clock, duration=6.0))
    assert abs(comparison.alignment.rate - clock) < SIGMAS * comparison.alignment.rate_error
    assert comparison.alignment.rate_error < 1e-4
    assert comparison.measured_frequency == pytest.approx(clock / PERIOD, rel=1e-4)
    assert comparison.measured_frequency == pytest.approx(
        comparison.alignment.rate / PERIOD, rel=1e-12
    )
    assert all(abs(channel.gain - 1.0) < 0.01 for channel in comparison.channels)
    assert kinds(comparison) == [("clock", "")] and comparison.numbers["verdict"] == "differs"


def test_absolute_times_keep_offset_clock_and_drift(tmp_path: Path) -> None:
    t, (a, _) = recorded(RUN.history, period=PERIOD, start=START, noise=NOISE, clock=1.0004)
    first = 86_400.0 * 300  # seconds of a year
    plain, late = (
        df.overlay(RUN, df.read_measured(write_csv(tmp_path / "m.csv", t, {"tip thick": a}))
                   .assign_coords(time=t + begin))
        for begin in (0.0, first)
    )  # fmt: skip
    assert abs(wrapped(late.offset + first - START)) < SIGMAS * late.alignment.start_error
    assert wrapped(late.offset + first - plain.offset) == pytest.approx(0.0, abs=1e-6)
    assert late.drift == pytest.approx(0.0004 * t[-1], rel=0.1)
    assert late.drift == pytest.approx(plain.drift, rel=1e-3)
    text = next(late.sentences())
    assert "at the first sample (25920000 s)" in text
    assert f"clock is {late.alignment.rate:.8g} ±" in text and f"{late.drift:+.2g} s at the" in text


def kinds(found: Overlay) -> list[tuple[str, str]]:
    return [(finding.kind, finding.channel) for finding in found.findings]


@pytest.mark.parametrize("scale", [1.12, 1e3, 25.4])
def test_a_scaled_channel_is_reported(tmp_path: Path, scale: float) -> None:
    comparison = df.overlay(RUN, measurement(tmp_path, thin=scale))
    assert kinds(comparison) == [("amplitude", "tip thin")]
    assert comparison.channels[1].gain == pytest.approx(scale, rel=0.01)
    if scale == 1e3:
        assert "as if millimetres were read as metres" in comparison.findings[0].text
    assert abs(wrapped(comparison.offset - START)) < SIGMAS * comparison.alignment.start_error


@pytest.mark.parametrize("degrees", [20, 85])
def test_a_late_channel_is_reported(tmp_path: Path, degrees: int) -> None:
    """The later it is, the worse both lie on the run together: that is no error of its phase."""
    late = degrees / 360.0 * PERIOD
    comparison = df.overlay(RUN, measurement(tmp_path, late=late))
    assert [kind for kind, _ in kinds(comparison)] == ["phase"]
    thick, thin = comparison.channels
    assert thin.delay - thick.delay == pytest.approx(late, rel=0.05)
    text, size = comparison.findings[0].text, rf"measured ({degrees}|{degrees - 1})\.\d°"
    assert re.search(rf"thin: {size} .* later than tip thick", text) or re.search(
        rf"thick: {size} .* earlier than tip thin", text
    )


def test_the_drive_tells_which_channel_is_late(tmp_path: Path) -> None:
    late = 20.0 / 360.0 * PERIOD
    path = measurement(tmp_path, late=late)
    data = df.read_measured(path)
    t = START + data["time"].to_numpy()
    base = write_csv(
        tmp_path / "base.csv", data["time"].to_numpy(),
        {"base": 0.0025 * np.sin(2.0 * np.pi * t / PERIOD)},
    )  # fmt: skip
    comparison = df.overlay(RUN, df.read_measured(path, base))
    assert kinds(comparison) == [("phase", "tip thin")]
    assert comparison.channels[1].delay == pytest.approx(late, rel=0.02)
    assert abs(wrapped(comparison.offset - START)) < 1e-4


def test_a_turned_sign_is_reported(tmp_path: Path) -> None:
    data = df.read_measured(measurement(tmp_path))
    t = data["time"].to_numpy()
    base = write_csv(
        tmp_path / "base.csv", t, {"base": 0.0025 * np.sin(2.0 * np.pi * (START + t) / PERIOD)}
    )
    turned = measurement(tmp_path, thick=-1.0)
    comparison = df.overlay(RUN, df.read_measured(turned, base))
    assert [channel for _, channel in kinds(comparison)] == ["tip thick"]
    assert "is its sign turned?" in comparison.findings[0].text


def test_another_frequency_is_reported(tmp_path: Path) -> None:
    comparison = df.overlay(RUN, measurement(tmp_path, clock=1.05))
    assert ("clock", "") in kinds(comparison)
    assert "driven at 3.41" in comparison.findings[0].text


def test_another_motion_is_reported(tmp_path: Path) -> None:
    t = np.arange(2000) / 1000.0
    noise = np.random.default_rng(2).normal(0.0, 0.01, t.size)
    comparison = df.overlay(RUN, write_csv(tmp_path / "m.csv", t, {"tip thin": noise}))
    assert ("shape", "tip thin") in kinds(comparison)


def test_a_subharmonic_motion_is_aligned_over_two_periods(tmp_path: Path) -> None:
    run = result(subharmonic=0.004)
    assert run.summary["periodicity"] == 2
    t, (a, b) = recorded(run.history, period=2 * PERIOD, start=START, noise=NOISE)
    comparison = df.overlay(run, write_csv(tmp_path / "m.csv", t, {"tip thick": a, "tip thin": b}))
    error = comparison.alignment.start_error
    assert abs(wrapped(comparison.offset - START, 2 * PERIOD)) < SIGMAS * error < 1e-2 * PERIOD
    assert not comparison.findings


@pytest.mark.parametrize("turned", [None, 0, 1])
@pytest.mark.parametrize("late", [0, 1])
def test_the_base_alone_does_not_tell_the_periods_of_a_doubled_motion_apart(
    tmp_path: Path, late: int, turned: int | None
) -> None:
    run, start = result(subharmonic=0.004), START + late * PERIOD
    t, tips = recorded(run.history, period=2 * PERIOD, start=start, noise=NOISE)
    base = 0.0025 * np.sin(2.0 * np.pi * (start + t) / PERIOD)
    tips *= np.array([-1.0 if k == turned else 1.0 for k in (0, 1)])[:, None]
    comparison = df.overlay(run, write_csv(
        tmp_path / "m.csv", t, {"tip thick": tips[0], "tip thin": tips[1], "base": base}
    ))  # fmt: skip
    assert abs(wrapped(comparison.offset - start, 2 * PERIOD)) < 1e-4 * PERIOD
    signs = [
        finding.channel for finding in comparison.findings if "is its sign turned?" in finding.text
    ]
    assert signs == [("tip thick", "tip thin")[k] for k in [turned] if k is not None]
    assert len(comparison.findings) == len(signs)
    assert all(abs(channel.delay) < 1e-2 * PERIOD for channel in comparison.channels)


def test_another_half_of_a_doubled_motion_is_not_said_to_agree(tmp_path: Path) -> None:
    """The tips are a period of the drive apart from one another: no shift makes both right."""
    run = result(subharmonic=0.004)
    _, (a, _) = recorded(run.history, period=2 * PERIOD, start=START, noise=NOISE)
    t, (_, b) = recorded(run.history, period=2 * PERIOD, start=START + PERIOD, noise=NOISE)
    base = 0.0025 * np.sin(2.0 * np.pi * (START + t) / PERIOD)
    comparison = df.overlay(run, write_csv(
        tmp_path / "m.csv", t, {"tip thick": a, "tip thin": b, "base": base}
    ))  # fmt: skip
    assert "shape" in [kind for kind, _ in kinds(comparison)]


@pytest.mark.slow
@pytest.mark.parametrize(
    "number", [15, pytest.param(200, marks=pytest.mark.nightly)]
)  # fmt: skip
@pytest.mark.parametrize("has_base", [True, False])
def test_stated_errors_contain_the_truth_as_often_as_they_say(
    tmp_path: Path, has_base: bool, number: int
) -> None:
    """Doubled motions from any start, by clocks that are wrong: two deviations hold 95 %."""
    run, rng = result(subharmonic=0.004), np.random.default_rng(40)
    history, inside = run.history, np.zeros(2, dtype=int)
    for _ in range(number):
        start, clock = rng.uniform(14.0, 16.0), 1.0 + rng.normal(0.0, 2e-3)
        t, tips = recorded(
            history, period=2 * PERIOD, start=start, clock=clock, rate=rng.uniform(300.0, 900.0)
        )
        tips += rng.normal(0.0, NOISE, tips.shape)
        columns = {"tip thick": tips[0], "tip thin": tips[1]}
        if has_base:
            base = 0.0025 * np.sin(2.0 * np.pi * (start + clock * t) / PERIOD)
            columns["base"] = base + rng.normal(0.0, 0.1 * NOISE, t.size)
        comparison = df.overlay(run, write_csv(tmp_path / "m.csv", t, columns))
        alignment = comparison.alignment
        assert {kind for kind, _ in kinds(comparison)} <= {"clock"}
        inside += [
            abs(wrapped(comparison.offset - start, 2 * PERIOD)) < 2.0 * alignment.start_error,
            abs(alignment.rate - clock) < 2.0 * alignment.rate_error,
        ]
    least = binom.ppf(0.01, number, 0.954)
    assert least <= inside.min(), inside


def test_the_clock_is_fitted_beside_a_run_that_has_not_settled(tmp_path: Path) -> None:
    time = RUN.history["time"].to_numpy()
    growing = RUN.history["tip_displacement"] * (1.0 + 2.0 * (time - time[0]))
    history = RUN.history.assign(tip_displacement=growing)
    run = Result(RUN.case, history, RUN.summary | {"periodicity": None}, None)
    t = np.arange(0.0, 1.1, 1.0 / 900.0)
    tips = CubicSpline(time, growing.to_numpy(), axis=1)(time[0] + 0.1 + 1.005 * t)
    path = write_csv(tmp_path / "m.csv", t, {"tip thick": tips[0], "tip thin": tips[1]})
    comparison = df.overlay(run, path)
    assert comparison.alignment.rate == pytest.approx(1.005, abs=2e-4)
    assert comparison.alignment.rate_error > 0.0
    assert kinds(comparison) == [("clock", "")]
    assert comparison.offset == pytest.approx(time[0] + 0.1, abs=1e-3 * PERIOD)


def test_a_motion_that_does_not_repeat_is_aligned_by_correlation(tmp_path: Path) -> None:
    run = result(**SWEEP)
    time = run.history["time"].to_numpy()
    chirp = np.array([0.01, 0.02])[:, None] * np.sin(2.0 * np.pi * (3.0 + 2.0 * time) * time)
    history = run.history.assign(tip_displacement=(("lamina", "time"), chirp))
    start = time[0] + 0.171
    t = np.arange(0.0, 0.5, 1.0 / 700.0)
    u = start + t
    tips = np.array([0.01, 0.02])[:, None] * np.sin(2.0 * np.pi * (3.0 + 2.0 * u) * u)
    tips += np.random.default_rng(4).normal(0.0, NOISE, tips.shape)
    path = write_csv(tmp_path / "m.csv", t, {"tip thick": tips[0], "tip thin": tips[1]})
    comparison = df.overlay(Result(run.case, history, run.summary, None), path)
    assert comparison.numbers["method"] == "cross-correlation"
    assert comparison.offset == pytest.approx(start, abs=SIGMAS * comparison.alignment.start_error)
    assert comparison.alignment.start_error < 1e-3
    assert comparison.channels[0].residual == pytest.approx(NOISE, rel=0.1)
    assert comparison.numbers["channels"]["tip thin"]["noise_rms"] is None
    assert {path.name for path in comparison.save(tmp_path / "out")} >= {"overlay_histories.png"}


def test_sensors_are_matched_by_name(tmp_path: Path) -> None:
    history = RUN.history.assign(sensor_mid=RUN.history["tip_displacement"][0].drop_vars("lamina"))
    t, (a, _) = recorded(RUN.history, period=PERIOD, start=START, noise=NOISE)
    path = write_csv(tmp_path / "m.csv", t, {"mid": a, "far": a})
    comparison = df.overlay(Result(RUN.case, history, RUN.summary, None), path)
    assert comparison.pairs.names == ("mid",) and comparison.pairs.unmatched == ("far",)
    assert not comparison.findings


def test_a_sensor_with_a_rate_of_its_own_is_matched(tmp_path: Path) -> None:
    every = RUN.history["tip_displacement"][0, ::2].drop_vars("lamina")
    slow = every.rename(time="sensor_mid_time")
    history = RUN.history.assign(sensor_mid=slow)
    t, (a, _) = recorded(RUN.history, period=PERIOD, start=START, noise=NOISE)
    path = write_csv(tmp_path / "m.csv", t, {"mid": a})
    comparison = df.overlay(Result(RUN.case, history, RUN.summary, None), path)
    assert comparison.channels[0].gain == pytest.approx(1.0, abs=0.01)
    assert abs(wrapped(comparison.offset - START)) < SIGMAS * comparison.alignment.start_error


def test_nothing_in_common_is_refused(tmp_path: Path) -> None:
    t = np.arange(50) / 100.0
    path = write_csv(tmp_path / "m.csv", t, {"tip steel": t})
    with pytest.raises(CaseError, match=r"none of its channels \(tip steel\) is in the run.*thin"):
        df.overlay(RUN, path)


@pytest.mark.usefixtures("pictures")
def test_everything_is_written(tmp_path: Path) -> None:
    comparison = df.overlay(RUN, measurement(tmp_path))
    written = comparison.save(tmp_path / "out")
    assert [path.name for path in written] == [
        "overlay.json", "overlay.nc", "overlay_histories.png", "overlay_harmonics.png",
        "overlay_portraits.png", "overlay.html",
    ]  # fmt: skip
    numbers = json.loads(written[0].read_text())
    assert numbers["offset"] == comparison.offset
    assert set(numbers["channels"]) == {"tip thick", "tip thin"}
    data = xr.load_dataset(written[1], engine="h5netcdf")
    assert float(data["residual"].std()) == pytest.approx(NOISE, rel=0.06)
    page = written[-1].read_text()
    assert page.count("data:image/png") == 3 and "agree within" in page
