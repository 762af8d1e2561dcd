"""Multipliers with intervals, and stability that is decided only where they allow it."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from analytic_maps import Henon

from delam_fem.studies.orbits import newton, search
from delam_fem.studies.orbits.newton import Perturbations, Solved
from delam_fem.studies.orbits.search import (
    BENT,
    LEAST_DISTANCE,
    Coarse,
    Multiple,
    by_modulus,
    matched,
    multipliers,
)

ROTATION = np.array([[0.4, -0.6], [0.6, 0.4]])


def decays(matrix: np.ndarray, noise: float, *, bend: float = 0.0, count: int = 24) -> np.ndarray:
    """Return kicks that a matrix and jumps carry on; `bend` makes large ones shrink faster."""
    rng, m = np.random.default_rng(5), len(matrix)
    kicks = [d / np.linalg.norm(d) for d in rng.standard_normal((count, m))]
    distances = [np.array(kicks)]
    for _ in range(40):
        d = distances[-1]
        shrunk = d * (1.0 - bend * np.linalg.norm(d, axis=1, keepdims=True))
        distances.append(shrunk @ matrix.T + noise * rng.standard_normal(d.shape))
    return followed(distances)


def followed(kicks: list[np.ndarray]) -> np.ndarray:
    """Return kicks before and after each period but the first."""
    return np.array([[before, after] for before, after in pairwise(kicks)][1:])


@pytest.mark.parametrize("noise", [0.0, 0.03, 0.3])
def test_the_interval_contains_the_truth(noise: float) -> None:
    estimate = multipliers(decays(np.diag([-0.9, 0.3]), noise))
    low, high = estimate.largest
    assert low + BENT - 1e-9 <= 0.9 <= high - BENT + 1e-9
    assert high - low < 0.2
    assert estimate.values[0] == pytest.approx(-0.9, abs=0.05)
    assert estimate.doubling[0] == pytest.approx(0.1 * 1.3, abs=0.08)


def test_the_interval_contains_what_smaller_kicks_change() -> None:
    """Kicks of full size shrink by 0.9 (1 - 0.1); small ones by 0.9."""
    low, high = multipliers(decays(np.diag([-0.9, 0.3]), 0.0, bend=0.1)).largest
    assert low < 0.88 < 0.894 < high < 0.9


def test_the_interval_contains_what_larger_kicks_say() -> None:
    """Steps hold small kicks: below 0.3 of their first size they do not decay any more."""
    matrix, free_decays = np.diag([-0.9, -0.9]), decays(np.diag([-0.9, -0.9]), 0.0)
    held_decays = [free_decays[0, 0]]
    for _ in range(len(free_decays)):
        d = held_decays[-1]
        is_held = np.linalg.norm(d, axis=1, keepdims=True) < 0.3
        held_decays.append(np.where(is_held, -d, d @ matrix.T))
    estimate = multipliers(np.array([[a, b] for a, b in pairwise(held_decays)]))
    low, high = estimate.largest
    assert low == pytest.approx(0.9 - BENT, abs=1e-9) and high == pytest.approx(1.0 + BENT)
    assert (np.abs(estimate.samples) > 0.93).all() and estimate.stability == "undecided"


@pytest.mark.parametrize(
    ("factor", "away", "multiple", "expected"),
    [
        (0.9, 0.9, None, "stable"),
        (0.9, 1.1, None, "undecided"),
        (0.9, 0.9, Multiple(2, 0.006), "undecided"),
        (1.0, 0.9, None, "undecided"),
    ],
)
def test_a_motion_that_stays_decides_where_small_kicks_alone_are_held(
    factor: float, away: float, multiple: Multiple | None, expected: str
) -> None:
    """Kicks decay by a factor until they are below 0.05; then their signs turn alone."""
    distances = [decays(np.diag([-0.9, -0.9]), 0.0)[0, 0]]
    for _ in range(60):
        d = distances[-1]
        is_held = np.linalg.norm(d, axis=1, keepdims=True) < 0.05
        distances.append(np.where(is_held, -d, -factor * d))
    estimate = multipliers(np.array([[a, b] for a, b in pairwise(distances)]))
    assert estimate.stability == "undecided"
    at = Solved(
        np.ones(2),
        1.0,
        1.0,
        residual=0.0,
        residual_error=0.0,
        uncertainty=np.zeros(2),
        iterations=1,
    )
    assert Coarse(at, 0.02, estimate, away * LEAST_DISTANCE, multiple).stability == expected


@pytest.mark.parametrize(
    ("largest", "expected"), [(-0.8, "stable"), (-1.0, "undecided"), (-1.1, "unstable")]
)
def test_stability_is_decided_by_the_interval(largest: float, expected: str) -> None:
    assert multipliers(decays(np.diag([largest, 0.3]), 0.1)).stability == expected


def test_the_other_coordinates_follow_the_slow_ones() -> None:
    """y' = -0.9 y + w / 2, w' = y / 4: one period of a kick of y says -0.9, the truth is beyond -1.

    `Ensemble.decays` leaves the first period out.
    """
    matrix, y, w = np.array([[-0.9, 0.5], [0.25, 0.0]]), np.ones((4, 1)), np.zeros((4, 1))
    distances = [y]
    for _ in range(10):
        y, w = np.split(np.hstack([y, w]) @ matrix.T, 2, axis=1)
        distances.append(y)
    truth = np.linalg.eigvals(matrix).min()
    estimate = multipliers(followed(distances))
    assert estimate.values[0].real == pytest.approx(truth, abs=0.03) and truth < -1.02
    assert estimate.stability == "unstable"


def test_pairs_and_real_multipliers_have_their_own_tests() -> None:
    pair = multipliers(decays(ROTATION, 0.01))
    assert pair.angle == pytest.approx(np.arctan2(0.6, 0.4), abs=0.03)
    assert (pair.doubling > 0.0).all()
    assert pair.torus[0] == pytest.approx(1.0 - np.sqrt(0.52), abs=0.03)
    real = multipliers(decays(np.diag([0.7, -0.2]), 0.0))
    assert np.isnan(real.torus).all() and np.isnan(real.angle)


def test_multipliers_are_matched_and_sorted() -> None:
    values = by_modulus(np.array([0.1, 0.5 - 0.5j, -0.9, 0.5 + 0.5j]))
    assert values == pytest.approx([-0.9, 0.5 + 0.5j, 0.5 - 0.5j, 0.1])
    assert matched(values[::-1] + 0.01, values) == pytest.approx(values + 0.01)


@pytest.mark.parametrize(("solved_at", "derivatives"), [(1, 1), (3, 3), (9, 6)])
def test_a_search_takes_at_most_six_derivatives(
    monkeypatch: pytest.MonkeyPatch, solved_at: int, derivatives: int
) -> None:
    """And no more when one of them leads to the orbit."""
    map_, begun = Henon(), []

    def solved(*given: Any) -> Solved:
        begun.append(given)
        solution = newton.solved(*given)
        return solution if len(begun) == solved_at else replace(solution, residual=1.0)

    monkeypatch.setattr(search, "solved", solved)
    how = Perturbations(copies=6, size=0.03, kick=0.05)
    search.coarse_orbit(map_, 0.3, map_.fixed(0.3), 1, how)
    assert len(begun) == derivatives
