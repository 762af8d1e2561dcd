"""The laws without impacts."""

import numpy as np
from fakes import Seen, seen, setting

from delam_fem import Decision
from delam_fem.api import SCHEMES, Law
from delam_fem.contact.laws import LawName


def examined(law: LawName, now: Seen) -> Decision | None:
    return Law(law).supervisor(SCHEMES["newmark"], setting(np.eye(now.gap.size))).examine(now)


def test_law_none_sees_nothing() -> None:
    assert examined("none", seen([-1.0], [-1.0])) is None


def test_penalty_puts_a_spring_on_every_closed_pair() -> None:
    decision = examined("penalty", seen([-1.0, 1.0, -1.0], [1.0, 0.0, -1.0]))
    assert decision is not None
    assert decision.hit.size == 0
    assert decision.pair_state is not None
    assert decision.pair_state.resting.tolist() == [True, False, True]


def test_penalty_says_nothing_while_the_same_pairs_are_closed() -> None:
    same = seen([-1.0, 1.0, -1.0], [1.0, 0.0, -1.0], [True, False, True])
    assert examined("penalty", same) is None


def test_a_gap_of_exactly_zero_is_closed_and_an_open_one_loses_its_spring() -> None:
    decision = examined("penalty", seen([0.0, 1e-12], [-1.0, -1.0], [False, True]))
    assert decision is not None
    assert decision.pair_state is not None
    assert decision.pair_state.resting.tolist() == [True, False]
