"""Newton's law within the step."""

import numpy as np
import pytest
from fakes import seen, setting

from delam_fem.api import SCHEMES, FloatArray, Law
from delam_fem.contact.decisions import Supervisor

E, GAMMA = 0.25, 1e-2


def law(W: FloatArray, threshold: float = GAMMA) -> Supervisor:
    chosen = Law("newton", E, "lumped", threshold_velocity=threshold)  # which has no effect here
    return chosen.supervisor(SCHEMES["moreau-jean"], setting(W))


def test_pushed_pairs_that_did_not_approach_are_reported_as_resting() -> None:
    decision = law(np.eye(3)).examine(seen([-1.0, -1.0, 1.0], [0.0, -1.0, -1.0], free=[-2.0] * 3))
    assert decision is not None
    assert decision.hit.tolist() == [0, 1]
    assert decision.rate_post == pytest.approx([0.0, E])
    assert decision.pair_state is not None
    assert decision.pair_state.resting.tolist() == [True, False, False]


def test_open_pairs_are_left_alone() -> None:
    assert law(np.eye(3)).examine(seen([1.0, 1.0, 1.0], [0.0, 0.0, 0.0])) is None


def test_a_closed_pair_that_leaves_fast_enough_is_left_alone() -> None:
    assert law(np.eye(1)).examine(seen([-1.0], [-1.0], free=[E])) is None
    assert law(np.eye(1)).examine(seen([-1.0], [-1.0], free=[0.99 * E])) is not None


def test_a_predicted_gap_of_exactly_zero_is_closed() -> None:
    decision = law(np.eye(2)).examine(seen([0.0, 1e-12], [-1.0, -1.0], free=[-1.0, -1.0]))
    assert decision is not None
    assert decision.hit.tolist() == [0]
    assert decision.impulses == pytest.approx([1.0 + E])


def test_pairs_that_influence_one_another_are_solved_together() -> None:
    """The second, slow, is thrown open by the first and receives nothing."""
    W = np.array([[2.0, 1.0, 0.3], [1.0, 2.0, 0.2], [0.3, 0.2, 1.0]])
    supervisor = law(W)
    alone = supervisor.examine(seen([-1.0, -1.0, 1.0], [-1.0, -0.1, -9.0], free=[-1.2, -0.1, -9.0]))
    assert alone is not None
    assert alone.hit.tolist() == [0]
    assert alone.impulses == pytest.approx([(1.2 + E) / 2.0])
    assert alone.rate_pre.tolist() == [-1.0]
    assert alone.rate_post == pytest.approx([E])
    rates, free = np.array([-1.0, -0.8]), np.array([-1.2, -0.9])
    both = supervisor.examine(seen([-1.0, -1.0, 1.0], [*rates, -9.0], free=[*free, -9.0]))
    assert both is not None
    assert both.impulses == pytest.approx(np.linalg.solve(W[:2, :2], -(free + E * rates)))
    assert both.rate_post == pytest.approx(-E * rates)


@pytest.mark.parametrize(("rate", "rests"), [(-GAMMA, False), (-0.99 * GAMMA, True), (0.1, True)])
def test_a_pushed_pair_rests_if_it_approached_slower_than_the_threshold(
    rate: float, rests: bool
) -> None:
    decision = law(np.eye(2)).examine(seen([1.0, -1.0], [0.0, rate], free=[0.0, -1.0]))
    assert decision is not None
    assert (decision.pair_state is not None) == rests
    assert not rests or decision.pair_state.resting.tolist() == [False, True]


@pytest.mark.parametrize(("rate", "rests"), [(0.0, False), (0.5, True)])
def test_without_a_threshold_a_pushed_pair_rests_if_it_parted(rate: float, rests: bool) -> None:
    supervisor = law(np.eye(1), threshold=0.0)
    decision = supervisor.examine(seen([-1.0], [rate], free=[-1.0]))
    assert decision is not None
    assert (decision.pair_state is not None) == rests
