"""The formulas of impacts, by hand."""

from __future__ import annotations

import numpy as np
import pytest

from delam_fem.contact.rules import coupled_impulses, separate_impulses


def test_each_pair_alone_leaves_with_e_times_its_rate() -> None:
    rate, inverse_mass = np.array([-2.0, -0.5]), np.array([0.25, 4.0])
    p = separate_impulses(rate, 0.5, inverse_mass)
    assert p.tolist() == [1.5 * 2.0 / 0.25, 1.5 * 0.5 / 4.0]
    assert (rate + inverse_mass * p).tolist() == [1.0, 0.25]


def test_pairs_that_influence_one_another_leave_with_e_times_their_rates() -> None:
    W = np.array([[2.0, 1.0], [1.0, 2.0]])
    rate = np.array([-3.0, -3.0])
    p = coupled_impulses(rate, rate, 0.25, W)
    assert p == pytest.approx([1.25, 1.25])  # 3 p = 1.25 · 3
    # forces of the step have slowed the pairs down: 3 p = 1 + 0.25 · 3
    slowed = coupled_impulses(rate, np.array([-1.0, -1.0]), 0.25, W)
    assert slowed == pytest.approx([1.75 / 3.0] * 2)


def test_a_pair_that_the_other_pushes_apart_receives_nothing() -> None:
    W = np.array([[1.0, 0.9], [0.9, 1.0]])
    rate = np.array([-1.0, -0.1])
    p = coupled_impulses(rate, rate, 0.0, W)
    assert p.tolist() == [1.0, 0.0]
