"""The course of a run, with which a record is aligned."""

import numpy as np
import pytest

from delam_fem.results.overlay.alignment import Course

N, CYCLES, PERIOD = 200, 6, 0.5


def test_the_error_of_a_delay_is_the_scatter_of_the_cycles() -> None:
    delays = 1e-3 * np.array([-2.0, 1.0, 0.0, 1.5, -1.0, 0.5])  # s, each within its own cycle
    time = PERIOD / N * np.arange(1, CYCLES * N + 1)
    phases = 2.0 * np.pi * (time - np.repeat(delays, N)) / PERIOD
    course = Course.of(time, np.stack([np.sin(phases), 0.1 * np.cos(2.0 * phases)]), PERIOD)
    assert course.delay_error() == pytest.approx(np.std(delays, ddof=1), rel=1e-3)
    assert course.only([1]).delay_error() == pytest.approx(np.std(delays, ddof=1), rel=1e-3)


def test_a_motion_at_rest_has_no_delays() -> None:
    time = PERIOD / N * np.arange(1, CYCLES * N + 1)
    assert Course.of(time, np.zeros((1, time.size)), PERIOD).delay_error() == 0.0
