"""The motion of the base period by period, and the span of a case."""

from __future__ import annotations

import numpy as np
import pytest

from delam_fem import HarmonicMotion
from delam_fem.api import Span, SweptMotion, by_period, preset, span_of
from delam_fem.engines.session import at_rest

SPAN = Span(time_step=0.01, steps_per_period=50, periods=7)


def test_a_motion_that_does_not_repeat_goes_on_from_period_to_period() -> None:
    motion = SweptMotion(0.5, 4.0, 3.0, 0.1)
    states = by_period(motion, SPAN, is_periodic=False)
    for period in (0, 1, 3):
        times = 0.01 * np.arange(50 * period, 50 * period + 51)
        np.testing.assert_allclose(states(period), motion.states(times), rtol=0, atol=1e-12)
    np.testing.assert_array_equal(states(2)[-1], states(3)[0])


def test_a_motion_that_repeats_has_one_table_that_closes_and_nobody_changes() -> None:
    motion = HarmonicMotion(2.0, 0.1)
    states = by_period(motion, SPAN, is_periodic=True)
    table = states(0)
    assert states(5) is table
    np.testing.assert_allclose(table, motion.states(0.01 * np.arange(51)), rtol=0, atol=1e-12)
    assert table[-1].tolist() == table[0].tolist()
    with pytest.raises(ValueError, match="read-only"):
        table[0] = 1.0


def test_a_base_at_rest_has_a_row_for_each_step_and_the_start() -> None:
    table = at_rest(SPAN)(4)
    assert table.shape == (51, 3)
    assert not table.any()
    with pytest.raises(ValueError, match="read-only"):
        table[0] = 1.0


def test_the_span_of_a_case() -> None:
    keys = {
        "excitation.frequency": 2.0, "time.steps_per_period": 250, "time.periods": 12,
        "output.window_periods": 3, "output.fields_per_period": 25,
    }  # fmt: skip
    case = preset("paper", keys)
    span = span_of(case)
    assert span.time_step == pytest.approx(0.002)
    assert (span.steps_per_period, span.periods) == (250, 12)
    assert (span.window_periods, span.frames_per_period) == (3, 25)
    assert span.limit == pytest.approx(10.0 * 0.685)
