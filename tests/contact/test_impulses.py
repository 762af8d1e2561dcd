"""The formulas of impacts, by hand."""

from __future__ import annotations

import numpy as np
import pytest
from fakes import seen, setting

from delam_fem import Decision
from delam_fem.api import SCHEMES, FloatArray, Impulse, Law


def impact(
    W: FloatArray, rate: list[float], e: float, impulse: Impulse, free: list[float] | None = None
) -> Decision:
    """Return what Newton's law decides for closed pairs; `free` makes it one within a step."""
    law, scheme = Law("newton", e, impulse), "newmark" if free is None else "moreau-jean"
    supervisor = law.supervisor(SCHEMES[scheme], setting(W))
    decision = supervisor.examine(seen([-1e-9] * len(rate), rate, free=free))
    assert decision is not None
    return decision


def test_each_pair_alone_leaves_with_e_times_its_rate() -> None:
    rate, inverse_mass = [-2.0, -0.5], np.array([0.25, 4.0])
    decision = impact(np.diag(inverse_mass) + 0.125, rate, 0.5, "lumped")
    p = decision.impulses
    assert p.tolist() == [1.5 * 2.0 / 0.375, 1.5 * 0.5 / 4.125]
    assert decision.rate_post.tolist() == [1.0, 0.25]


def test_pairs_that_influence_one_another_leave_with_e_times_their_rates() -> None:
    W = np.array([[2.0, 1.0], [1.0, 2.0]])
    p = impact(W, [-3.0, -3.0], 0.25, "consistent").impulses
    assert p == pytest.approx([1.25, 1.25])  # 3 p = 1.25 · 3
    # forces of the step have slowed the pairs down: 3 p = 1 + 0.25 · 3
    slowed = impact(W, [-3.0, -3.0], 0.25, "consistent", free=[-1.0, -1.0])
    assert slowed.impulses == pytest.approx([1.75 / 3.0] * 2)


def test_a_pair_that_the_other_pushes_apart_receives_nothing() -> None:
    W = np.array([[1.0, 0.9], [0.9, 1.0]])
    decision = impact(W, [-1.0, -0.1], 0.0, "consistent")
    assert decision.impulses.tolist() == [1.0, 0.0]
    assert decision.rate_post == pytest.approx([0.0, 0.8])
