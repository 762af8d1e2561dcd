"""Multipliers with intervals, and stability that is decided only where they allow it."""

from __future__ import annotations

import numpy as np
import pytest

from delam_fem.studies.orbits.multipliers import by_modulus, matched, multipliers

ROTATION = np.array([[0.4, -0.6], [0.6, 0.4]])


def noisy(matrix: np.ndarray, size: float, count: int = 24) -> np.ndarray:
    noise = np.random.default_rng(5).standard_normal((count, *matrix.shape))
    return matrix + size * noise


def test_the_interval_contains_the_truth() -> None:
    found = multipliers(noisy(np.diag([-0.9, 0.3]), 0.1))
    low, high = found.largest
    assert low < 0.9 < high
    assert found.errors[0] == pytest.approx(0.1 / np.sqrt(24), rel=0.4)
    assert found.doubling[0] == pytest.approx(0.1 * 1.3, abs=0.08)


@pytest.mark.parametrize(
    ("largest", "expected"), [(-0.8, "stable"), (-1.01, "undecided"), (-1.3, "unstable")]
)
def test_stability_is_decided_by_the_interval(largest: float, expected: str) -> None:
    assert multipliers(noisy(np.diag([largest, 0.3]), 0.1)).stability == expected


def test_pairs_and_real_multipliers_have_their_own_tests() -> None:
    pair = multipliers(noisy(ROTATION, 0.01))
    assert pair.angle == pytest.approx(np.arctan2(0.6, 0.4), abs=0.01)
    assert (pair.doubling > 0.0).all()
    assert pair.torus[0] == pytest.approx(1.0 - np.sqrt(0.52), abs=0.01)
    real = multipliers(noisy(np.diag([0.7, -0.2]), 0.01))
    assert np.isnan(real.torus).all() and np.isnan(real.angle)


def test_multipliers_are_matched_and_sorted() -> None:
    values = by_modulus(np.array([0.1, 0.5 - 0.5j, -0.9, 0.5 + 0.5j]))
    assert values == pytest.approx([-0.9, 0.5 + 0.5j, 0.5 - 0.5j, 0.1])
    assert matched(values[::-1] + 0.01, values) == pytest.approx(values + 0.01)
