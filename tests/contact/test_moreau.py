"""Newton's law within the step."""

import numpy as np
import pytest
from stand_ins import seen, setting

from delam_fem.contact.moreau import StepImpacts

E, GAMMA = 0.25, 1e-2


def law(n: int) -> StepImpacts:
    return StepImpacts(setting(np.eye(n)), restitution=E, resting_velocity=GAMMA)


def test_pushed_pairs_that_did_not_approach_are_reported_as_resting() -> None:
    decision = law(3).examine(seen([-1.0, -1.0, 1.0], [0.0, -1.0, -1.0], free=[-2.0] * 3))
    assert decision is not None
    assert decision.hit.tolist() == [0, 1]
    assert decision.rate_post == pytest.approx([0.0, E])
    assert decision.resting is not None
    assert decision.resting.tolist() == [True, False, False]


def test_open_pairs_are_left_alone() -> None:
    assert law(3).examine(seen([1.0, 1.0, 1.0], [0.0, 0.0, 0.0])) is None


def test_a_closed_pair_that_leaves_fast_enough_is_left_alone() -> None:
    assert law(1).examine(seen([-1.0], [-1.0], free=[E])) is None
    assert law(1).examine(seen([-1.0], [-1.0], free=[0.99 * E])) is not None
