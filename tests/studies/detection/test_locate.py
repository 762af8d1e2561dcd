"""Marks of made-up indices, and their spread under noise."""

import numpy as np
import pytest

from delam_fem.studies.detection.indices import Mark, mark, repeated
from delam_fem.studies.signals.scan import Shapes

X = np.linspace(0.0, 0.4, 41)


def bump(noise: float = 0.0) -> Shapes:
    """A second harmonic that is a half-cosine between 0.1 and 0.2 m."""
    inside = (X > 0.0999) & (X < 0.2001)
    V2 = np.where(inside, np.sin(np.pi * (X - 0.1) / 0.1) ** 2, 0.0)
    return Shapes(X, 10.0, (1.0, 2.0), np.stack([np.ones(41), V2]).astype(complex), noise)


def test_the_ends_of_a_bump_are_marked_and_the_middle_is_filled() -> None:
    index_mark = mark("curvature", bump())
    assert (index_mark.start, index_mark.end) == pytest.approx((0.1, 0.2))
    assert mark("V2", bump()).start == pytest.approx(0.12)
    two = np.where((X > 0.1) & (X < 0.2), np.abs(np.sin(20.0 * np.pi * (X - 0.1))), 0.0)
    values = np.stack([np.ones(41), two]).astype(complex)
    index_mark = mark("V2", Shapes(X, 10.0, (1.0, 2.0), values))
    assert (index_mark.start, index_mark.end) == pytest.approx((0.11, 0.19))
    assert not index_mark.is_marked[15]  # between both bumps


def test_below_the_limit_of_noise_nothing_is_marked() -> None:
    index_mark = mark("curvature", bump(noise=1.0))
    assert not index_mark.is_detected
    assert np.isnan(index_mark.start)


def test_the_contrast_is_that_of_the_largest_values() -> None:
    values = np.array([1.0, 2.0, 9.0, 6.0, 3.0])
    x = np.array([0.0, 1.0, 2.0, 3.0, 4.0])
    index_mark = Mark(x, values, np.zeros(5))
    assert index_mark.contrast(2.0, 3.0) == pytest.approx(3.0)
    assert np.isnan(index_mark.contrast(0.0, 4.0))
    assert np.isnan(index_mark.contrast(1.2, 1.8))


def test_noise_moves_the_ends_and_much_noise_hides_them() -> None:
    quiet = repeated("curvature", bump(), 1e-4)
    assert quiet.calls == 1.0
    spacing = 0.01  # an edge lies between two points
    np.testing.assert_allclose(quiet.start, [0.1 - spacing, 0.1 + spacing])
    np.testing.assert_allclose(quiet.end, [0.2 - spacing, 0.2 + spacing])
    loud = repeated("curvature", bump(), 0.02, repetitions=100)
    assert loud.calls > 0.9
    assert loud.end[1] > loud.end[0]
    none = repeated("curvature", bump(), 10.0, repetitions=20)
    assert none.calls < 0.2


def test_no_call_has_no_bounds() -> None:
    empty = Shapes(X, 10.0, (1.0, 2.0), np.zeros((2, 41), dtype=complex))
    outcome = repeated("curvature", empty, 1.0, repetitions=5, seed=2)
    assert outcome.calls == 0.0
    assert np.isnan(outcome.start).all()
