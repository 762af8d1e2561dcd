"""The supervisor's decisions, pair by pair, in the order of the method."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from delam_fem.contact.decision import (
    Decision,
    Impacts,
    NoContact,
    PenaltySprings,
)
from delam_fem.contact.recovery import MoreauImpacts, MoreauRecovery

E = 0.25
GAMMA = 1e-2
ROUND_OFF = 1e-12


@dataclass
class Seen:
    """Kinematics given by hand."""

    gap: np.ndarray
    rate: np.ndarray
    free: np.ndarray | None = None

    def rate_pre(self) -> np.ndarray:
        return self.rate

    def rate_free(self) -> np.ndarray:
        return self.rate if self.free is None else self.free


@dataclass
class Matrix:
    """A compliance given by hand."""

    W: np.ndarray

    def diagonal(self, pairs: np.ndarray) -> np.ndarray:
        return self.W[pairs, pairs]

    def block(self, pairs: np.ndarray) -> np.ndarray:
        return self.W[np.ix_(pairs, pairs)]

    def columns(self, pairs: np.ndarray) -> np.ndarray:
        return self.W[:, pairs]


def seen(gap: list[float], rate: list[float]) -> Seen:
    return Seen(np.array(gap), np.array(rate))


def law(n: int = 3, *, coupled: bool = False, threshold: float | None = GAMMA) -> Impacts:
    W = np.diag(np.arange(1.0, n + 1)) + 0.5 * coupled
    return Impacts(
        Matrix(W), n_pairs=n, restitution=E, coupled=coupled, threshold_velocity=threshold
    )


def test_only_closed_approaching_pairs_are_hit() -> None:
    decision = law().examine(seen([-1e-6, 1e-6, -1e-6], [-1.0, -1.0, 0.5]))
    assert decision is not None
    assert decision.hit.tolist() == [0]
    assert decision.rate_post == pytest.approx([E])
    assert decision.impulses == pytest.approx([(1 + E) / 1.0])
    assert decision.permanent is None


def test_a_gap_of_exactly_zero_is_closed() -> None:
    decision = law().examine(seen([0.0, 1.0, 1.0], [-1.0, 0.0, 0.0]))
    assert decision is not None
    assert decision.hit.tolist() == [0]


def test_slow_pairs_stay_on_a_spring_and_are_not_hit_again() -> None:
    supervisor = law()
    slow = -0.5 * GAMMA / E
    first = supervisor.examine(seen([-1e-6, -1e-6, 1.0], [slow, -1.0, 0.0]))
    assert first is not None
    assert first.permanent is not None
    assert first.permanent.tolist() == [True, False, False]
    assert supervisor.is_holding
    second = supervisor.examine(seen([-2e-6, 1.0, 1.0], [-1.0, 0.0, 0.0]))
    assert second is None


def test_an_opened_pair_is_released_and_may_be_hit_later() -> None:
    supervisor = law()
    supervisor.restore(np.array([True, True, False]))
    decision = supervisor.examine(seen([1e-9, -1e-9, 1.0], [1.0, -3.0, 0.0]))
    assert decision is not None
    assert decision.hit.size == 0
    assert decision.permanent is not None
    assert decision.permanent.tolist() == [False, True, False]
    again = supervisor.examine(seen([-1e-9, -1e-9, 1.0], [-1.0, -3.0, 0.0]))
    assert again is not None
    assert again.hit.tolist() == [0]


def test_release_and_impact_happen_in_one_step() -> None:
    supervisor = law()
    supervisor.restore(np.array([True, False, False]))
    decision = supervisor.examine(seen([1e-9, -1e-9, 1.0], [1.0, -1e-3, 0.0]))
    assert decision is not None
    assert decision.hit.tolist() == [1]
    assert decision.permanent is not None
    assert decision.permanent.tolist() == [False, True, False]


def test_the_threshold_is_compared_with_the_velocity_after_the_impact() -> None:
    at_threshold = -GAMMA / E
    decision = law().examine(seen([-1e-9, 1.0, 1.0], [at_threshold, 0.0, 0.0]))
    assert decision is not None
    assert decision.permanent is None  # U̇⁺ = γ is not below γ


def test_law_newton_never_holds() -> None:
    supervisor = law(threshold=None)
    decision = supervisor.examine(seen([-1e-9, 1.0, 1.0], [-1e-9, 0.0, 0.0]))
    assert decision is not None
    assert decision.permanent is None
    assert not supervisor.is_holding


def test_law_none_sees_nothing() -> None:
    assert NoContact(1).examine(seen([-1.0], [-1.0])) is None


def test_penalty_puts_a_spring_on_every_closed_pair() -> None:
    supervisor = PenaltySprings(3)
    decision = supervisor.examine(seen([-1.0, 1.0, -1.0], [1.0, 0.0, -1.0]))
    assert decision is not None
    assert decision.permanent is not None
    assert decision.permanent.tolist() == [True, False, True]
    assert supervisor.examine(seen([-1.0, 1.0, -1.0], [1.0, 0.0, -1.0])) is None


def test_moreau_reports_what_rests() -> None:
    supervisor = MoreauImpacts(Matrix(np.eye(3)), n_pairs=3, restitution=E, resting_velocity=GAMMA)
    kinematics = Seen(np.array([-1.0, -1.0, 1.0]), np.array([0.0, -1.0, -1.0]), np.full(3, -2.0))
    decision = supervisor.examine(kinematics)
    assert decision is not None
    assert decision.hit.tolist() == [0, 1]
    assert decision.rate_post == pytest.approx([0.0, E])
    assert supervisor.permanent.tolist() == [True, False, False]
    assert supervisor.is_holding  # looks again though all may be open
    assert supervisor.examine(seen([1.0, 1.0, 1.0], [0.0, 0.0, 0.0])) is None
    assert not supervisor.permanent.any()


def recovery(W: np.ndarray) -> MoreauRecovery:
    n = W.shape[0]
    return MoreauRecovery(
        Matrix(W), n_pairs=n, restitution=E, resting_velocity=GAMMA, time_step=1e-3
    )


def test_recovery_holds_every_gap_rate_above_its_floor() -> None:
    gap = np.array([1e-4, 1.0, -1e-4, -1e-2, -1e-4, -1e-4])
    pre = np.array([-1.0, -1.0, -1.0, -1.0, 0.0, 0.5])
    decision = recovery(np.eye(6)).examine(Seen(gap, pre, np.full(6, -1.0)))
    assert decision is not None
    assert decision.hit.tolist() == [0, 2, 3, 4, 5]
    # -U/Δt; -e U̇ - U/Δt; no faster than it came; at rest it stays; apart it may come back as fast
    assert decision.rate_post == pytest.approx([-0.1, E + 0.1, 1.0, 0.0, -0.5])
    assert supervised_work(decision) <= 0.0


def supervised_work(decision: Decision) -> float:
    return float((decision.impulses * (decision.rate_pre + decision.rate_post)).max())


def test_neighbours_pushed_below_their_floor_join() -> None:
    W = np.array([[1.0, -0.9, 0.0], [-0.9, 1.0, 0.0], [0.0, 0.0, 1.0]])
    gap, free = np.array([-1e-9, 1e-6, 1.0]), np.array([-1.0, 0.0, 0.0])
    decision = recovery(W).examine(Seen(gap, np.zeros(3), free))
    assert decision is not None
    assert decision.hit.tolist() == [0, 1]
    assert decision.rate_post == pytest.approx([0.0, -1e-3], abs=1e-12)


def test_recovery_sees_nothing_where_all_is_open() -> None:
    assert recovery(np.eye(1)).examine(Seen(np.ones(1), -np.ones(1))) is None


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
    W = B @ B.T
    supervisor = Impacts(Matrix(W), n_pairs=4, restitution=E, coupled=True)
    given_rates = np.array(rates)
    decision = supervisor.examine(Seen(np.where(closed, -1.0, 1.0), given_rates))
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
