"""The course of a run, with which a record is aligned."""

import numpy as np
import pytest

from delam_fem.results.overlay.alignment import Course, aligned

N, CYCLES, PERIOD = 200, 6, 0.5


def test_the_error_of_a_delay_is_the_scatter_of_the_cycles() -> None:
    delays = 1e-3 * np.array([-2.0, 1.0, 0.0, 1.5, -1.0, 0.5])  # s, each within its own cycle
    time = PERIOD / N * np.arange(1, CYCLES * N + 1)
    phases = 2.0 * np.pi * (time - np.repeat(delays, N)) / PERIOD
    course = Course.of(time, np.stack([np.sin(phases), 0.1 * np.cos(2.0 * phases)]), PERIOD)
    assert course.scatter(1) == pytest.approx(np.std(delays, ddof=1), rel=1e-3)
    assert course.only([1]).scatter(1) == pytest.approx(np.std(delays, ddof=1), rel=1e-3)


def test_the_error_of_a_gain_holds_the_scatter_of_the_cycles() -> None:
    gains = 1.0 + 0.01 * np.array([-2.0, 1.0, 0.0, 1.5, -1.0, 0.5])
    time = PERIOD / N * np.arange(1, CYCLES * N + 1)
    course = Course.of(time, (np.repeat(gains, N) * np.sin(2.0 * np.pi * time / PERIOD))[None],
                       PERIOD)  # fmt: skip
    assert course.scatter(0) == pytest.approx(np.std(gains, ddof=1), rel=1e-3)
    assert course.scatter(1) == pytest.approx(0.0, abs=1e-9)


def test_phases_that_drift_enlarge_the_errors_of_start_and_clock() -> None:
    """The errors of a line through phases that scatter by σ: 2 σ, and √12 σ over the duration."""
    time = PERIOD / N * np.arange(1, CYCLES * N + 1)
    late = np.repeat(1e-3 * np.array([-2.0, 1.0, 0.0, 1.5, -1.0, 0.5]), N)
    motion = np.sin(2.0 * np.pi * (time - late) / PERIOD)[None]
    course = Course.of(time, motion, PERIOD)
    for is_rate_free, factor in ((True, 2.0), (False, 1.0)):
        found = aligned(time, course.at(time), course, 1.0, is_rate_free=is_rate_free)
        assert found.start_error == pytest.approx(factor * course.scatter(1), rel=1e-3)
        if is_rate_free:
            slope = np.sqrt(12.0) * course.scatter(1) / (time[-1] - time[0])
            assert found.rate_error == pytest.approx(slope, rel=1e-3)


def test_a_motion_at_rest_has_no_delays() -> None:
    time = PERIOD / N * np.arange(1, CYCLES * N + 1)
    assert Course.of(time, np.zeros((1, time.size)), PERIOD).scatter(1) == 0.0
