"""Gaps, contact lines and positions at rest, of two and of three laminae."""

from __future__ import annotations

import numpy as np
import stack
from stack import three_laminae
from synthetic import FRAMES, STEPS, WINDOW, small_case, synthetic_history

from delam_fem.api import diagnostics


def test_contact_line_is_the_farthest_contact() -> None:
    history = synthetic_history(small_case())
    (line,) = diagnostics.contact_line(history)
    x = history["x"].to_numpy()
    assert line.shape == (FRAMES * WINDOW,)
    assert line[:2].tolist() == [x[3], x[2]]
    assert np.isnan(line[2:FRAMES]).all()


def test_gap_field_ends_at_the_gap_of_the_probes() -> None:
    history = synthetic_history(small_case())
    (field,) = diagnostics.gap_field(history)
    every = STEPS // FRAMES
    np.testing.assert_allclose(field[:, -1], diagnostics.tip_gap(history)[every - 1 :: every])
    assert (field[:, 0] == 0.0).all()


def test_two_laminae_rest_at_zero_and_at_the_gap() -> None:
    history = synthetic_history(small_case())
    lower, upper = diagnostics.rest_positions(history)
    assert not lower.any()
    assert upper.tobytes() == history["gap0"].to_numpy().tobytes()


def test_each_lamina_of_three_rests_above_all_gaps_below() -> None:
    history = three_laminae().history()
    shape = stack.shape(history["x"].to_numpy())
    expected = np.array([[0.0], [0.030], [0.050]]) * shape
    np.testing.assert_allclose(diagnostics.rest_positions(history), expected, rtol=1e-15)


def test_gap_fields_of_three_laminae() -> None:
    history = three_laminae().history()
    shape = stack.shape(history["x"].to_numpy())
    t = stack.PERIODS - WINDOW + np.arange(1, FRAMES * WINDOW + 1) / FRAMES
    u = stack.q(t)
    at_probes = stack.GAPS[:, None] + np.diff(u, axis=0)
    field = diagnostics.gap_field(history)
    np.testing.assert_allclose(field, at_probes[:, :, None] * shape, rtol=1e-12, atol=1e-17)


def test_each_interface_of_three_laminae_has_its_contact_line() -> None:
    history = three_laminae().history()
    x = history["x"].to_numpy()
    lower, upper = diagnostics.contact_line(history)
    none = np.nan
    np.testing.assert_array_equal(lower[:4], [x[3], none, x[2], none])
    np.testing.assert_array_equal(upper[:4], [none, x[2], x[2], none])


def test_a_lamina_between_two_others_has_the_larger_contact_state() -> None:
    below, above = np.array([0, 1, 1, 2], np.int8), np.array([0, 0, 2, 1], np.int8)
    states = diagnostics.of_laminae(np.stack([below, above]))
    assert states.dtype == np.int8
    assert states.tolist() == [below.tolist(), [0, 1, 2, 2], above.tolist()]
    assert diagnostics.of_laminae(below[None]).tolist() == [below.tolist()] * 2
