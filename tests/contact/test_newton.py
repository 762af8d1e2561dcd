"""Decisions of Newton's impact law, pair by pair, in the order of the method."""

from __future__ import annotations

import numpy as np
import pytest
from fakes import Seen, seen, setting
from hypothesis import given, settings, strategies as st

from delam_fem.api import SCHEMES, FloatArray, Law
from delam_fem.contact.decisions import PairState, Supervisor

E = 0.25
GAMMA = 1e-2
ROUND_OFF = 1e-12


def law(
    n: int = 3,
    *,
    coupled: bool = False,
    threshold: float | None = GAMMA,
    W: FloatArray | None = None,
) -> Supervisor:
    """Return Newton's law, with springs for slow pairs if there is a threshold."""
    impulse = "consistent" if coupled else "lumped"
    if threshold is None:
        chosen = Law("newton", E, impulse)
    else:
        chosen = Law("newton-penalty", E, impulse, threshold_velocity=threshold)
    W = np.diag([1.0, 2.0, 3.0]) + 0.5 * coupled if W is None else W
    return chosen.supervisor(SCHEMES["newmark"], setting(W))


def test_only_closed_approaching_pairs_are_hit() -> None:
    decision = law().examine(seen([-1e-6, 1e-6, -1e-6], [-1.0, -1.0, 0.5]))
    assert decision is not None
    assert decision.hit.tolist() == [0]
    assert decision.rate_post == pytest.approx([E])
    assert decision.impulses == pytest.approx([(1 + E) / 1.0])
    assert decision.pair_state is None


def test_a_gap_of_exactly_zero_is_closed() -> None:
    decision = law().examine(seen([0.0, 1.0, 1.0], [-1.0, 0.0, 0.0]))
    assert decision is not None
    assert decision.hit.tolist() == [0]


def test_slow_pairs_stay_on_a_spring_and_are_not_hit_again() -> None:
    slow = -0.5 * GAMMA / E
    first = law().examine(seen([-1e-6, -1e-6, 1.0], [slow, -1.0, 0.0]))
    assert first is not None
    assert first.pair_state is not None
    assert first.pair_state.resting.tolist() == [True, False, False]
    second = law().examine(seen([-2e-6, 1.0, 1.0], [-1.0, 0.0, 0.0], [True, False, False]))
    assert second is None


def test_an_opened_pair_is_released_and_may_be_hit_later() -> None:
    decision = law().examine(seen([1e-9, -1e-9, 1.0], [1.0, -3.0, 0.0], [True, True, False]))
    assert decision is not None
    assert decision.hit.size == decision.impulses.size == 0
    assert decision.rate_pre.size == decision.rate_post.size == 0
    assert decision.pair_state is not None
    assert decision.pair_state.resting.tolist() == [False, True, False]
    again = law().examine(seen([-1e-9, -1e-9, 1.0], [-1.0, -3.0, 0.0], [False, True, False]))
    assert again is not None
    assert again.hit.tolist() == [0]


def test_release_and_impact_happen_in_one_step() -> None:
    decision = law().examine(seen([1e-9, -1e-9, 1.0], [1.0, -1e-3, 0.0], [True, False, False]))
    assert decision is not None
    assert decision.hit.tolist() == [1]
    assert decision.pair_state is not None
    assert decision.pair_state.resting.tolist() == [False, True, False]


def test_a_decision_leaves_the_present_set_as_it_is() -> None:
    now = seen([1e-9, -1e-9, 1.0], [1.0, -1e-3, 0.0], [True, False, False])
    law().examine(now)
    assert now.pair_state.resting.tolist() == [True, False, False]


def test_the_threshold_is_compared_with_the_velocity_after_the_impact() -> None:
    at_threshold = -GAMMA / E
    decision = law().examine(seen([-1e-9, 1.0, 1.0], [at_threshold, 0.0, 0.0]))
    assert decision is not None
    assert decision.pair_state is None  # U̇⁺ = γ is not below γ


def test_without_a_threshold_no_pair_rests() -> None:
    decision = law(threshold=None).examine(seen([-1e-9, 1.0, 1.0], [-1e-9, 0.0, 0.0]))
    assert decision is not None
    assert decision.pair_state is None


@settings(max_examples=60, derandomize=True, deadline=None)
@given(
    rates=st.lists(st.floats(-2.0, 2.0), min_size=4, max_size=4),
    closed=st.lists(st.booleans(), min_size=4, max_size=4),
    factor=st.lists(st.floats(-1.0, 1.0), min_size=16, max_size=16),
)
def test_coupled_impulses_fulfil_the_law(
    rates: list[float], closed: list[bool], factor: list[float]
) -> None:
    B = np.reshape(factor, (4, 4)) + 2.0 * np.eye(4)
    supervisor = law(coupled=True, threshold=None, W=B @ B.T)
    given_rates, none = np.array(rates), PairState.at_start(4)
    decision = supervisor.examine(Seen(np.where(closed, -1.0, 1.0), given_rates, none))
    expected_hit = np.flatnonzero(np.array(closed) & (given_rates < 0.0))
    if not expected_hit.size:
        assert decision is None
        return
    assert decision is not None
    assert np.array_equal(decision.hit, expected_hit)
    p, pre, post = decision.impulses, decision.rate_pre, decision.rate_post
    slack, scale = post + E * pre, np.abs(pre).max()
    assert (p >= 0.0).all()
    assert (slack >= -ROUND_OFF * scale).all()
    assert np.abs(p * slack).max() <= ROUND_OFF * scale * np.abs(p).max()
    assert p @ (pre + post) / 2 <= ROUND_OFF * scale**2  # energy never grows


def test_a_closed_pair_at_rest_or_parting_is_not_hit() -> None:
    assert law().examine(seen([-1e-9, -1e-9, 1.0], [0.0, 1.0, -1.0])) is None


def test_a_resting_pair_at_a_gap_of_exactly_zero_stays() -> None:
    assert law().examine(seen([0.0, 1.0, 1.0], [1.0, 0.0, 0.0], [True, False, False])) is None


def test_coupled_pairs_know_of_one_another_and_rest_by_their_rate_after() -> None:
    """W = diag(1, 2, 3) + 1/2: two pairs are hit with 1 and 0.03 m/s, then with 0.035 m/s."""
    W = np.diag([1.0, 2.0, 3.0]) + 0.5
    rates = np.array([-1.0, -0.03, -5.0])
    decision = law(coupled=True).examine(seen([-1e-9, -1e-9, 1.0], rates.tolist()))
    assert decision is not None
    pair = W[:2, :2]
    impulses = np.linalg.solve(pair, -(1.0 + E) * rates[:2])
    assert impulses.min() < 0.0  # the first throws the second open: it receives nothing
    assert decision.impulses == pytest.approx([(1.0 + E) / 1.5, 0.0])
    assert decision.rate_pre.tolist() == rates[:2].tolist()
    post = rates[:2] + pair @ decision.impulses
    assert decision.rate_post == pytest.approx(post)
    assert decision.pair_state is None
    both = law(coupled=True).examine(seen([-1e-9, -1e-9, 1.0], [-0.035, -0.035, 0.0]))
    assert both is not None
    assert both.rate_post == pytest.approx([E * 0.035, E * 0.035])
    assert both.pair_state is not None
    assert both.pair_state.resting.tolist() == [True, True, False]
