"""The law with a floor under every gap rate."""

import numpy as np
import pytest
from stand_ins import seen, setting

from delam_fem.contact.decision import Decision
from delam_fem.contact.recovery import Recovery

E, GAMMA = 0.25, 1e-2


def recovery(W: np.ndarray) -> Recovery:
    return Recovery(setting(W, time_step=1e-3), restitution=E, resting_velocity=GAMMA)


def work(decision: Decision) -> float:
    return float((decision.impulses * (decision.rate_pre + decision.rate_post)).max())


def test_recovery_holds_every_gap_rate_above_its_floor() -> None:
    gap = [1e-4, 1.0, -1e-4, -1e-2, -1e-4, -1e-4]
    pre = [-1.0, -1.0, -1.0, -1.0, 0.0, 0.5]
    decision = recovery(np.eye(6)).examine(seen(gap, pre, free=[-1.0] * 6))
    assert decision is not None
    assert decision.hit.tolist() == [0, 2, 3, 4, 5]
    # -U/Δt; -e U̇ - U/Δt; no faster than it came; at rest it stays; apart it may come back as fast
    assert decision.rate_post == pytest.approx([-0.1, E + 0.1, 1.0, 0.0, -0.5])
    assert work(decision) <= 0.0


def test_neighbours_pushed_below_their_floor_join() -> None:
    W = np.array([[1.0, -0.9, 0.0], [-0.9, 1.0, 0.0], [0.0, 0.0, 1.0]])
    decision = recovery(W).examine(seen([-1e-9, 1e-6, 1.0], [0.0] * 3, free=[-1.0, 0.0, 0.0]))
    assert decision is not None
    assert decision.hit.tolist() == [0, 1]
    assert decision.rate_post == pytest.approx([0.0, -1e-3], abs=1e-12)


def test_recovery_sees_nothing_where_all_is_open() -> None:
    assert recovery(np.eye(1)).examine(seen([1.0], [-1.0])) is None
