"""The course of a run, with which a record is aligned."""

import numpy as np
import pytest
import xarray as xr
from scipy.interpolate import CubicSpline
from scipy.stats import linregress

from delam_fem.api import CaseError
from delam_fem.studies.signals.alignment import (
    MOST_SAMPLES,
    Alignment,
    MotionCourse,
    aligned,
    best_start,
    correlation,
    gains,
    matched,
)

N, CYCLES, PERIOD = 200, 6, 0.5


def test_the_error_of_a_delay_is_the_scatter_of_the_cycles() -> None:
    delays = 1e-3 * np.array([-2.0, 1.0, 0.0, 1.5, -1.0, 0.5])  # s, each within its own cycle
    time = PERIOD / N * np.arange(1, CYCLES * N + 1)
    phases = 2.0 * np.pi * (time - np.repeat(delays, N)) / PERIOD
    course = MotionCourse.of(time, np.stack([np.sin(phases), 0.1 * np.cos(2.0 * phases)]), PERIOD)
    assert course.scatter(1) == pytest.approx(np.std(delays, ddof=1), rel=1e-3)
    assert course.only([1]).scatter(1) == pytest.approx(np.std(delays, ddof=1), rel=1e-3)


def test_the_error_of_a_gain_holds_the_scatter_of_the_cycles() -> None:
    gains = 1.0 + 0.01 * np.array([-2.0, 1.0, 0.0, 1.5, -1.0, 0.5])
    time = PERIOD / N * np.arange(1, CYCLES * N + 1)
    wave = np.sin(2.0 * np.pi * time / PERIOD)
    course = MotionCourse.of(time, (np.repeat(gains, N) * wave)[None],
                       PERIOD)  # fmt: skip
    assert course.scatter(0) == pytest.approx(np.std(gains, ddof=1), rel=1e-3)
    assert course.scatter(1) == pytest.approx(0.0, abs=1e-9)


def test_channels_of_all_sizes_count_alike_in_the_scatter() -> None:
    """A cycle's gain is the mean of those of its channels, whose powers differ by 10⁴."""
    amplitudes = 1.0 + 0.01 * np.array([
        [-2.0, 1.0, 0.0, 1.5, -1.0, 0.5], [0.3, -1.1, 2.0, -0.5, -1.2, 0.5],
    ])  # fmt: skip
    time = PERIOD / N * np.arange(1, CYCLES * N + 1)
    phase = 2.0 * np.pi * time / PERIOD
    motion = np.repeat(amplitudes, N, axis=1) * np.stack(
        [np.sin(phase), 0.01 * np.cos(2.0 * phase)]
    )
    course = MotionCourse.of(time, motion, PERIOD)
    assert course.scatter(0) == pytest.approx(np.std(amplitudes.mean(axis=0), ddof=1), rel=1e-3)


def test_phases_that_drift_enlarge_the_errors_of_start_and_clock() -> None:
    """The errors of a line through phases that scatter by σ: 2 σ, and √12 σ over the duration."""
    time = PERIOD / N * np.arange(1, CYCLES * N + 1)
    late = np.repeat(1e-3 * np.array([-2.0, 1.0, 0.0, 1.5, -1.0, 0.5]), N)
    motion = np.sin(2.0 * np.pi * (time - late) / PERIOD)[None]
    course = MotionCourse.of(time, motion, PERIOD)
    for is_rate_free, factor in ((True, 2.0), (False, 1.0)):
        alignment = aligned(time, course.at(time), course, 1.0, is_rate_free=is_rate_free)
        assert alignment.start_error == pytest.approx(factor * course.scatter(1), rel=1e-3)
        if is_rate_free:
            slope = np.sqrt(12.0) * course.scatter(1) / (time[-1] - time[0])
            assert alignment.rate_error == pytest.approx(slope, rel=1e-3)


def test_a_motion_at_rest_has_no_delays() -> None:
    time = PERIOD / N * np.arange(1, CYCLES * N + 1)
    assert MotionCourse.of(time, np.zeros((1, time.size)), PERIOD).scatter(1) == 0.0


# ---- courses


def chirp(time: np.ndarray) -> np.ndarray:
    """Return two channels that do not repeat, of different sizes and means."""
    phase = 2.0 * np.pi * (3.0 * time + time**2)
    return np.array([np.sin(phase) + 4.0, 0.02 * np.cos(0.7 * phase) - 0.01 * time])


def test_a_course_that_does_not_repeat_is_known_in_its_window_alone() -> None:
    time = 5.0 + np.arange(101) / 100.0
    course, spline = (
        MotionCourse.of(time, chirp(time), None),
        CubicSpline(time, chirp(time), axis=1),
    )
    assert (course.start, course.end, course.period) == (5.0, 6.0, None)
    at = np.array([4.999, 5.0, 5.123, 5.5, 6.0, 6.001])
    for derivative in (0, 1, 2):
        values = course.at(at, derivative)
        assert np.isnan(values[:, [0, 5]]).all()
        wanted = spline(at[1:5], derivative)
        np.testing.assert_allclose(values[:, 1:5], wanted, rtol=1e-9, atol=1e-9)
        np.testing.assert_array_equal(course.only([1]).at(at, derivative), values[1:])
    np.testing.assert_array_equal(course.at(at), course.at(at, 0))
    assert course.scatter(0) == course.scatter(1) == 0.0


def test_the_last_whole_cycles_are_averaged() -> None:
    """Seventy steps before them do not count; the last step ends a cycle."""
    time = 8.0 + PERIOD / N * np.arange(1, 3 * N + 71)
    phase = 2.0 * np.pi * (time - time[-1]) / PERIOD
    gain = np.r_[np.full(70, 99.0), np.repeat([1.0, 3.0, 5.0], N)]
    course = MotionCourse.of(time, (gain * np.cos(phase))[None], PERIOD, 2)
    assert course.start == pytest.approx(time[-1] - PERIOD, abs=1e-12)
    assert (course.end, course.period, course.multiple) == (time[-1], PERIOD, 2)
    assert course.cycles is not None and course.cycles.shape == (1, 3, N)
    np.testing.assert_allclose(course.cycles[0, 2], 2.0 * np.cos(phase[-N:]), atol=1e-12)
    at = time[-1] + np.array([0.0, 0.1, 7.3, -2.7]) * PERIOD
    np.testing.assert_allclose(
        course.at(at)[0], 3.0 * np.cos(2.0 * np.pi * (at - time[-1]) / PERIOD), atol=1e-6
    )
    assert course.scatter(0) == pytest.approx(2.0 / 3.0, rel=1e-9)  # of 1/3, 1 and 5/3


def test_instants_at_which_a_record_may_begin() -> None:
    time = 5.0 + np.arange(101) / 100.0
    periodic = MotionCourse.of(time, chirp(time), 0.5, 3)
    np.testing.assert_allclose(periodic.starts(time, 4), 5.5 + 0.5 * np.arange(12) / 12)
    once = MotionCourse.of(time, chirp(time), None)
    for since, step in (
        (np.arange(0.0, 0.4, 0.03), 0.03),
        (np.arange(0.0, 0.4, 0.001), 1.399 / 64),
    ):
        span = since[-1]  # 70 % of the shorter record may lie outside
        wanted = np.arange(5.0 - 0.7 * span, 6.0 - span + 0.7 * span, step)
        np.testing.assert_allclose(once.starts(since, 2), wanted, rtol=1e-12)
    long = np.arange(0.0, 3.0, 0.05)
    wanted = np.arange(5.0 - 0.7, 6.0 - long[-1] + 0.7, 3.95 / 64)
    assert wanted.size == 0
    np.testing.assert_allclose(once.starts(long, 2), np.arange(5.0, 6.0, 3.95 / 64), rtol=1e-12)


def test_gain_and_mean_are_those_of_a_regression() -> None:
    rng = np.random.default_rng(2)
    computed = rng.normal(2.0, 3.0, 40)
    measured = 1.5 * computed - 0.7 + rng.normal(0.0, 0.4, 40)
    regression = linregress(computed, measured)
    wanted = (regression.slope, regression.intercept, regression.stderr)
    assert gains(measured, computed) == pytest.approx(wanted, rel=1e-10)
    computed[[3, 7]] = np.nan
    is_known = np.isfinite(computed)
    regression = linregress(computed[is_known], measured[is_known])
    wanted = (regression.slope, regression.intercept, regression.stderr)
    assert gains(measured, computed) == pytest.approx(wanted, rel=1e-10)
    gain, mean, error = gains(np.array([1.0, 3.0]), np.array([0.0, 4.0]))
    assert (gain, mean, error) == (0.5, 1.0, 0.0)
    gain, mean, _ = gains(np.array([1.0, 3.0]), np.array([4.0, 4.0]))
    assert (gain, mean) == (0.0, 2.0)


def test_correlations_are_summed() -> None:
    a, b = chirp(np.linspace(0.0, 1.0, 60)), chirp(np.linspace(0.1, 1.1, 60))
    correlations = [np.corrcoef(p, q)[0, 1] for p, q in zip(a, b, strict=True)]
    assert correlation(a, b) == correlation(a, b, 1) == pytest.approx(sum(correlations), rel=1e-12)
    assert correlation(a, b, 2) == pytest.approx(
        correlations[0] ** 2 + correlations[1] ** 2, rel=1e-12
    )
    still = np.array([a[0], 0.0 * a[1]])
    assert correlation(still, b) == pytest.approx(correlations[0], rel=1e-12)
    for n_known, is_enough in ((9, True), (8, False)):  # 15 % of 60
        b[1, n_known:] = np.nan
        total = correlation(a, b)
        assert np.isfinite(total) if is_enough else total == -np.inf


@pytest.mark.parametrize("n", [MOST_SAMPLES, MOST_SAMPLES + 1, 3 * MOST_SAMPLES])
def test_of_long_records_some_samples_find_the_best_start(n: int) -> None:
    time = 5.0 + np.arange(101) / 100.0
    course = MotionCourse.of(time, chirp(time), None)
    t = 40.0 + 0.4 * np.arange(n) / n
    trial = Alignment(0.0, 40.0, 1.25)
    measured = course.at(5.3 + 1.25 * (t - 40.0))
    starts = np.arange(5.0, 5.5, 0.05)
    assert best_start(t, measured, course, trial, starts) == pytest.approx(5.3)
    measured[0] = -measured[0]
    assert best_start(t, measured, course, trial, starts, power=2) == pytest.approx(5.3)
    assert best_start(t, -measured, course, trial, starts) != pytest.approx(5.3)


def test_alignments_find_the_start_and_the_clock() -> None:
    """Records of both courses by clocks that are wrong, with noise, from any beginning."""
    rng = np.random.default_rng(5)
    window = 5.0 + np.arange(1, 601) / 300.0
    late = np.repeat([0.003, -0.001, 0.0], 200)
    doubled = np.array([
        np.sin(3.0 * np.pi * (window - late)) + 0.4 * np.cos(6.0 * np.pi * (window - late)),
        0.02 * np.cos(3.0 * np.pi * (window - late)) + 0.3,
    ])  # fmt: skip
    for course, start, rate in (
        (MotionCourse.of(window, doubled, 2.0 / 3.0), 6.5, 1.003),
        (MotionCourse.of(window[-200:], doubled[:, -200:], 2.0 / 3.0), 6.9, 0.98),
        (MotionCourse.of(window, chirp(window - 5.0), None), 5.5, 1.01),
    ):
        t = 70.0 + np.arange(450) / 500.0
        clean = course.at(start + rate * (t - 70.0))
        noise = np.array([[0.05], [0.001]]) * rng.normal(size=clean.shape)
        for is_rate_free in (True, False):
            first_rate = rate + 0.002 if is_rate_free else rate
            alignment = aligned(t, clean + noise, course, first_rate, is_rate_free=is_rate_free)
            np.testing.assert_array_equal(
                alignment.on_clock_of_run(t),
                alignment.start + alignment.rate * (t - alignment.first),
            )
        [one] = [aligned(t, (clean + noise)[:1], course.only([0]), rate, is_rate_free=False,
                         starts=np.array([start - 0.02, start + 0.3]))]  # fmt: skip
        np.testing.assert_allclose(one.start, start, atol=6.0 * one.start_error)


# ---- what a run and a measurement share


def channel(values: np.ndarray, units: str, quantity: str, **about: object) -> tuple[object, ...]:
    return ("time", values, {"units": units, "quantity": quantity, **about})


def run_and_record() -> tuple[xr.Dataset, xr.Dataset]:
    """Channels of polynomials of the time, whose derivatives are known."""
    time = np.arange(40) / 10.0
    run = xr.Dataset(
        {"tip_up": channel(time**3, "m", "displacement", lamina="up", x=0.5),
         "tip_up_velocity": channel(3.0 * time**2, "m/s", "velocity", lamina="up", x=0.5),
         "base": channel(time**2, "m", "base displacement"),
         "a1": channel(np.sin(time), "m/s2", "acceleration", lamina="low", x=0.2),
         "broken": channel(np.full(40, np.inf), "m", "displacement"),
         "slow": ("slow_time", np.arange(9.0) ** 3, {"units": "N", "quantity": "force"})},
        {"time": time, "slow_time": np.arange(9) / 2.0},
    )  # fmt: skip
    t = 9.0 + np.arange(4) / 10.0
    names = {
        "tip_up_acceleration": ("tip up", "m/s2", "acceleration", {"lamina": "up"}),
        "base_acceleration": ("base", "m/s2", "base acceleration", {}),
        "laser": ("laser", "m/s", "velocity", {"lamina": "low", "x": 0.2004}),
        "far": ("far", "m/s", "velocity", {"lamina": "low", "x": 0.21}),
        "slow": ("slow", "N", "force", {}), "broken": ("broken", "m", "displacement", {}),
        "end": ("end", "m", "displacement", {"lamina": "up", "x": 0.5}),
        "gauge": ("gauge", "1", "strain", {"lamina": "up", "x": 0.5}),
    }  # fmt: skip
    data = xr.Dataset(
        {key: channel(t**k, units, quantity, name=name, **place)
         for k, (key, (name, units, quantity, place)) in enumerate(names.items())},
        {"time": t},
    )  # fmt: skip
    return run, data


def test_channels_are_matched_by_quantity_and_place() -> None:
    run, data = run_and_record()
    pairs = matched(run, data, repeats=False)
    time = run["time"].to_numpy()
    expected = {"tip up": 6.0 * time, "base": np.full(40, 2.0), "slow": (2.0 * time) ** 3,
                "end": time**3}  # fmt: skip
    assert dict(zip(pairs.names, pairs.is_drive, strict=True)) == {
        "tip up": False, "base": True, "slow": False, "end": False,
    }  # fmt: skip
    np.testing.assert_allclose(pairs.computed, list(expected.values()), atol=1e-8)
    assert pairs.unmatched == ("laser", "far", "broken", "gauge")
    assert pairs.notes == (
        "tip up: tip_up_velocity of the run, differentiated once",
        "base: base of the run, differentiated twice",
    )


def test_an_acceleration_that_repeats_is_integrated() -> None:
    """The window has no mean: sin t over two periods has the integral -cos t."""
    run, data = run_and_record()
    time = 4.0 * np.pi * np.arange(1, 801) / 800
    values = channel(np.sin(time), "m/s2", "acceleration", lamina="low", x=0.2)
    run = xr.Dataset({"a1": values}, {"time": time})
    pairs = matched(run, data[["laser"]], repeats=True)
    np.testing.assert_allclose(pairs.computed[0], -np.cos(time), atol=1e-6)
    assert pairs.notes == ("laser: a1 of the run, integrated once",)


def test_what_shares_nothing_is_refused() -> None:
    run, data = run_and_record()
    with pytest.raises(
        CaseError, match=r"none of its channels \(laser, far\) is in the run.*tip_up"
    ):
        matched(run, data[["laser", "far"]], repeats=False)
