"""Kinds of motion and attractors from made-up stroboscopic points."""

from __future__ import annotations

import numpy as np
import pytest

from delam_fem.numerics import attractors as at

N = 128
K = np.arange(N)
SEED = 20
GOLDEN = 0.5 * (np.sqrt(5.0) - 1.0)


def both(strobe: np.ndarray) -> np.ndarray:
    """Return the strobes of two tips that move alike, shape (1, 2, n)."""
    return np.stack([strobe, 0.5 * strobe])[None]


def test_lines_hold_all_of_a_sum_of_sines_and_part_of_noise() -> None:
    sines = np.sin(2.0 * np.pi * GOLDEN * K) + 0.5 * np.cos(2.0 * np.pi * 0.13 * K)
    assert at.line_share(sines) > 0.99
    noise = np.random.default_rng(SEED).normal(size=(200, N))
    assert 0.4 < at.line_share(noise).mean() < 0.75
    assert at.line_share(noise).max() < at.LINE_SHARE


def test_lines_of_a_motion_that_repeats_and_of_none() -> None:
    assert at.line_share(np.full(N, 3.0)) == 1.0
    assert at.line_share(np.full(N, np.nan)) == 0.0


@pytest.mark.parametrize(
    ("outcome", "periodicity", "strobe", "kind"),
    [
        ("completed", 1.0, np.ones(N), at.PERIOD_1),
        ("completed", 2.0, (-1.0) ** K, at.HIGHER),
        ("completed", 8.0, K % 8, at.HIGHER),
        ("completed", np.nan, np.sin(2.0 * np.pi * GOLDEN * K), at.QUASI_PERIODIC),
        (
            "completed",
            np.nan,
            np.random.default_rng(SEED).normal(size=N),
            at.IRREGULAR,
        ),
        ("diverged", np.nan, np.full(N, np.nan), at.DIVERGED),
        ("failed", np.nan, np.full(N, np.nan), at.FAILED),
        ("", np.nan, np.full(N, np.nan), at.FAILED),
    ],
)
def test_kinds(outcome: str, periodicity: float, strobe: np.ndarray, kind: int) -> None:
    found = at.kinds_of_motion(
        np.array([outcome], dtype=object), np.array([periodicity]), both(strobe)
    )
    assert found.tolist() == [kind]


def test_too_few_strobes_are_refused() -> None:
    with pytest.raises(
        ValueError, match=r"at least 64 strobes per point, given 40; .*strobes = 128"
    ):
        at.kinds_of_motion(np.array(["completed"]), np.ones(1), both(np.ones(40)))


def made(amplitudes: list[float], periods: list[int], phases: list[int]) -> at.Attractors:
    """Return the attractors among motions of given amplitude, period and final phase."""
    strobes = np.stack(
        [
            both(a * np.cos(2.0 * np.pi * (K[:40] + phase) / P))[0]
            for a, P, phase in zip(amplitudes, periods, phases, strict=True)
        ]
    )
    a = np.array(amplitudes)[:, None] * np.array([1.0, 0.5])
    return at.attractors(np.array(periods, dtype=float), -a, a, strobes)


def test_attractors_are_told_by_amplitude_and_counted() -> None:
    found = made([1.0, 2.0, 1.05, 1.0, 2.1, 0.98], [1] * 6, [0] * 6)
    assert found.number.tolist() == [0, 1, 0, 0, 1, 0]
    assert found.share == pytest.approx([4 / 6, 2 / 6])
    assert found.amplitude[:, 0] == pytest.approx([1.0, 2.05], abs=0.01)


def test_the_phase_of_a_doubled_motion_makes_no_second_attractor() -> None:
    found = made([1.0, 1.0], [2, 2], [0, 1])
    assert found.number.tolist() == [0, 0]
    assert found.periodicity.tolist() == [2.0]


def test_a_doubled_motion_is_not_the_single_one_of_equal_amplitude() -> None:
    assert made([1.0, 1.0], [1, 2], [0, 0]).number.tolist() == [0, 1]


def test_the_label_is_the_most_frequent_period() -> None:
    strobes = np.stack([both(np.ones(40))[0]] * 3)
    a = np.ones((3, 2))
    found = at.attractors(np.array([1.0, 2.0, 2.0]), -a, a, strobes)
    assert found.number.tolist() == [0, 0, 0]
    assert found.periodicity.tolist() == [2.0]


def test_points_without_a_result_have_no_attractor() -> None:
    strobes = np.stack([both(np.ones(40))[0], np.full((2, 40), np.nan)])
    a = np.array([[1.0, 1.0], [np.nan, np.nan]])
    found = at.attractors(np.array([1.0, np.nan]), -a, a, strobes)
    assert found.number.tolist() == [0, -1]
    assert found.share.tolist() == [0.5]
    none = at.attractors(np.array([np.nan]), -a[1:], a[1:], strobes[1:])
    assert none.number.tolist() == [-1] and none.share.size == 0
