"""Kinds of motion and attractors from made-up stroboscopic points."""

from __future__ import annotations

import numpy as np
import pytest

from delam_fem.api import settling as at

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
    kinds = at.kinds_of_motion(
        np.array([outcome], dtype=object), np.array([periodicity]), both(strobe)
    )
    assert kinds.tolist() == [kind]


def test_an_undecided_motion_has_no_other_kind() -> None:
    kinds = at.kinds_of_motion(
        np.array(["completed", "completed", "diverged"], dtype=object),
        np.array([1.0, 2.0, np.nan]),
        np.concatenate([both(np.ones(N))] * 3),
        np.array([True, False, False]),
    )
    assert kinds.tolist() == [at.PERIOD_1, at.UNDECIDED, at.DIVERGED]


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
    attractors = made([1.0, 2.0, 1.05, 1.0, 2.1, 0.98], [1] * 6, [0] * 6)
    assert attractors.number.tolist() == [0, 1, 0, 0, 1, 0]
    assert attractors.share == pytest.approx([4 / 6, 2 / 6])
    assert attractors.amplitude[:, 0] == pytest.approx([1.0, 2.05], abs=0.01)


def test_the_phase_of_a_doubled_motion_makes_no_second_attractor() -> None:
    attractors = made([1.0, 1.0], [2, 2], [0, 1])
    assert attractors.number.tolist() == [0, 0]
    assert attractors.periodicity.tolist() == [2.0]


def test_a_doubled_motion_is_not_the_single_one_of_equal_amplitude() -> None:
    assert made([1.0, 1.0], [1, 2], [0, 0]).number.tolist() == [0, 1]


def test_the_label_is_the_most_frequent_period() -> None:
    strobes = np.stack([both(np.ones(40))[0]] * 3)
    a = np.ones((3, 2))
    attractors = at.attractors(np.array([1.0, 2.0, 2.0]), -a, a, strobes)
    assert attractors.number.tolist() == [0, 0, 0]
    assert attractors.periodicity.tolist() == [2.0]


def test_points_without_a_result_have_no_attractor() -> None:
    strobes = np.stack([both(np.ones(40))[0], np.full((2, 40), np.nan)])
    a = np.array([[1.0, 1.0], [np.nan, np.nan]])
    attractors = at.attractors(np.array([1.0, np.nan]), -a, a, strobes)
    assert attractors.number.tolist() == [0, -1]
    assert attractors.share.tolist() == [0.5]
    none = at.attractors(np.array([np.nan]), -a[1:], a[1:], strobes[1:])
    assert none.number.tolist() == [-1] and none.share.size == 0


def test_enough_strobes_are_enough() -> None:
    kinds = at.kinds_of_motion(np.array(["completed"]), np.ones(1), both(np.ones(64)))
    assert kinds.tolist() == [at.PERIOD_1]
    with pytest.raises(ValueError, match="given 63"):
        at.kinds_of_motion(np.array(["completed"]), np.ones(1), both(np.ones(63)))


@pytest.mark.parametrize(("share", "kind"), [(0.88, at.IRREGULAR), (0.92, at.QUASI_PERIODIC)])
def test_quasi_periodic_means_nine_tenths_of_the_power_in_lines(share: float, kind: int) -> None:
    """One line, and white noise of which four lines hold about the share that they have in all."""
    line = np.sqrt(2.0) * np.sin(2.0 * np.pi * GOLDEN * K)
    noise = np.random.default_rng(SEED).normal(size=N)
    mixtures = line + np.linspace(0.0, 1.0, 1001)[:, None] * noise
    strobe = mixtures[np.argmin(np.abs(at.line_share(mixtures) - share))]
    assert at.line_share(strobe) == pytest.approx(share, abs=1e-3)
    kinds = at.kinds_of_motion(np.array(["completed"]), np.array([np.nan]), both(strobe))
    assert kinds.tolist() == [kind]


def test_both_tips_must_have_lines() -> None:
    noise = np.random.default_rng(SEED).normal(size=N)
    line = np.sin(2.0 * np.pi * GOLDEN * K)
    for pair in ((noise, line), (line, noise)):
        strobes = np.stack(pair)[None]
        kinds = at.kinds_of_motion(np.array(["completed"]), np.array([np.nan]), strobes)
        assert kinds.tolist() == [at.IRREGULAR]


def test_four_lines_of_five_bins_hold_the_power_and_no_fifth() -> None:
    """Six lines of equal power: four of them hold two thirds. The Hann window has three bins."""
    bins = np.array([6, 16, 26, 36, 46, 56])
    lines = np.cos(2.0 * np.pi * bins[:, None] * K / N).sum(axis=0)
    assert at.line_share(lines) == pytest.approx(4.0 / 6.0, rel=1e-3)
    assert at.line_share(np.cos(2.0 * np.pi * 6.5 * K / N)) > 0.999  # between two bins


def test_one_line_ends_two_bins_beside_its_peak() -> None:
    """Bins three apart are two lines: of six such lines the four strongest count."""
    bins = 10 + 6 * np.arange(6)
    for distance, n_lines in ((2, 4), (3, 2)):
        twins = np.concatenate([bins, bins + distance])
        twins = np.cos(2.0 * np.pi * twins[:, None] * K / N).sum(axis=0)
        share = float(at.line_share(twins))
        assert share == pytest.approx(n_lines / 6.0, abs=0.12), distance


@pytest.mark.parametrize("index", range(4))
@pytest.mark.parametrize(("factor", "number"), [(0.99, [0, 0]), (1.01, [0, 1])])
def test_twelve_hundredths_of_the_larger_amplitude_part_attractors(
    index: int, factor: float, number: list[int]
) -> None:
    """In any part of the fingerprint of any tip; the larger half range of both points counts."""
    low, high = np.array([[-3.0, -1.0], [-3.0, -1.0]]), np.array([[5.0, 1.0], [5.0, 1.0]])
    strobes = np.zeros((2, 2, 40))
    strobes[:, :, ::2] = 1.0
    shift = factor * 0.12 * 4.0
    if index == 0:
        low[1, 0] += shift  # the first point keeps the larger half range
    elif index == 1:
        high[1, 1] += shift
    elif index == 2:
        strobes[1, 1] += shift
    else:
        strobes[1, 0, ::2] += 2.0 * shift
        strobes[1, 0] -= shift
    attractors = at.attractors(np.ones(2), low, high, strobes)
    assert attractors.number.tolist() == number
    swapped = at.attractors(np.ones(2), low[::-1], high[::-1], strobes[::-1])
    assert swapped.number.tolist() == number


def test_the_larger_of_both_amplitudes_bounds_the_difference() -> None:
    """Half ranges 1 and 1.13: the ends differ by 0.13, more than 0.12, less than 0.1356."""
    strobes = np.zeros((2, 1, 40))
    low, high = np.array([[-1.0], [-1.13]]), np.array([[1.0], [1.13]])
    for order in (slice(None), slice(None, None, -1)):
        attractors = at.attractors(np.ones(2), low[order], high[order], strobes)
        assert attractors.number.tolist() == [0, 0]
    assert attractors.amplitude.tolist() == [[1.065]]


def test_the_most_frequent_attractor_is_the_first_in_every_array() -> None:
    attractors = made([3.0, 1.0, 1.0, 9.0, 9.0, 9.0], [3, 1, 1, 2, 2, 2], [0] * 6)
    assert attractors.number.tolist() == [2, 1, 1, 0, 0, 0]
    assert attractors.share == pytest.approx([3 / 6, 2 / 6, 1 / 6])
    assert attractors.amplitude[:, 0] == pytest.approx([9.0, 1.0, 3.0])
    assert attractors.periodicity.tolist() == [2.0, 1.0, 3.0]


def test_points_on_a_grid_keep_its_shape() -> None:
    strobes = np.zeros((2, 3, 1, 40))
    low, high = np.full((2, 3, 1), -1.0), np.full((2, 3, 1), 1.0)
    low[1, 2] = -2.0
    attractors = at.attractors(np.ones((2, 3)), low, high, strobes)
    assert attractors.number.tolist() == [[0, 0, 0], [0, 0, 1]]


def test_cells_whose_attractor_no_neighbours_share_are_isolated() -> None:
    """3 and 5 are shared side by side, 4 and 6 one above the other; -1 is no attractor."""
    number = np.array([[3, 3, 1, 4], [0, 2, -1, 4], [6, 0, 1, 2], [6, 2, 5, 5]])
    alone = np.isin(number, [0, 1, 2])
    assert at.is_isolated(number).tolist() == alone.tolist()
    assert at.is_isolated(number.T).tolist() == alone.T.tolist()
    assert at.is_isolated(np.array([-1, 7, 8, 8, 7])).tolist() == [False, True, False, False, True]
    assert at.is_isolated(np.array([1, 2])).tolist() == [True, True]


@pytest.mark.parametrize("axis", range(3))
def test_neighbours_along_any_axis_share_an_attractor(axis: int) -> None:
    number = np.arange(8).reshape(2, 2, 2)
    pair = [slice(None) if k == axis else 1 for k in range(3)]
    number[tuple(pair)] = 9
    assert np.array_equal(at.is_isolated(number), number != 9)
