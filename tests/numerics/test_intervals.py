"""Intervals of means: exact for a few values, and right as often as they say for many."""

import numpy as np
import pytest

from delam_fem.numerics.statistics import BLOCKS, block_means, interval

RIGHT = (0.90, 0.99)
"""Share of 95 % intervals that contain the mean: 400 trials scatter by 1.1 %, and blocks of 40 of a
process with a memory of 3 are not quite independent."""


def test_means_of_the_last_whole_blocks() -> None:
    assert block_means(np.arange(7.0), 3).tolist() == [1.5, 3.5, 5.5]
    assert block_means(np.arange(2.0), 5).tolist() == [0.0, 1.0]
    assert block_means(np.ones((3, 45))).shape == (3, BLOCKS)


def test_students_interval_of_three_values() -> None:
    """t of two degrees of freedom at 97.5 % is 4.302653, from tables."""
    middle, half = interval(np.array([1.0, 2.0, 3.0]))
    assert middle == 2.0
    assert half == pytest.approx(4.302653 / np.sqrt(3.0), rel=1e-6)
    assert np.isnan(interval(np.array([1.0]))[1])


def test_intervals_of_correlated_values_contain_the_mean() -> None:
    rng = np.random.default_rng(11)
    noise = rng.normal(size=(400, 400))
    values = np.zeros_like(noise)
    for k in range(1, 400):
        values[:, k] = 0.5 * values[:, k - 1] + noise[:, k]
    middle, half = interval(block_means(values))
    assert RIGHT[0] < (np.abs(middle) < half).mean() < RIGHT[1]
    naive = 1.96 * values.std(axis=1) / np.sqrt(400)
    assert (np.abs(middle) < naive).mean() < RIGHT[0], "single values know too little"
