"""The schemes of the table, and what they promise."""

from __future__ import annotations

from math import inf

import numpy as np
import pytest

from delam_fem.api import SCHEMES, CaseError, Scheme


def test_the_table_has_average_acceleration_central_difference_and_the_midpoint() -> None:
    assert {name: (s.name, s.beta, s.gamma, s.theta) for name, s in SCHEMES.items()} == {
        "newmark": ("newmark", 0.25, 0.5, 0.5),
        "central-difference": ("central-difference", 0.0, 0.5, 0.5),
        "moreau-jean": ("moreau-jean", 0.25, 0.5, 0.5),
    }


@pytest.mark.parametrize(
    ("scheme", "within", "courant"),
    [
        (SCHEMES["newmark"], False, inf),
        (SCHEMES["central-difference"], False, 2.0),
        (SCHEMES["moreau-jean"], True, inf),
        (Scheme("newmark", beta=0.0), False, 2.0),
        (Scheme("newmark", beta=1.0 / 6.0), False, 12.0**0.5),
        (Scheme("moreau-jean", beta=0.0), True, inf),
    ],
)
def test_where_impulses_act_and_whether_a_step_has_a_limit(
    scheme: Scheme, within: bool, courant: float
) -> None:
    assert scheme.has_impulses_within is within
    assert scheme.courant == pytest.approx(courant, rel=1e-12)


def test_a_scheme_of_its_own_is_average_acceleration_unless_told() -> None:
    assert Scheme() == SCHEMES["newmark"]


def test_a_scheme_that_lets_every_motion_grow_is_refused() -> None:
    with pytest.raises(CaseError, match="gamma: "):
        Scheme("newmark", gamma=0.4)


@pytest.mark.parametrize("beta", [0.0, 1.0 / 12.0, 1.0 / 6.0])
def test_beyond_the_courant_number_a_motion_grows(beta: float) -> None:
    """One oscillator, ω = 1: the radius of the step's matrix is 1 up to the limit."""
    scheme = Scheme("newmark", beta=beta)
    for share, is_stable in ((0.999, True), (1.001, False)):
        dt = share * scheme.courant
        before = np.array([[1.0, dt, (0.5 - beta) * dt**2], [0, 1, 0.5 * dt], [0, 0, 0]])
        after = np.array([[1.0, 0, -beta * dt**2], [0, 1, -0.5 * dt], [1, 0, 1]])
        radius = np.abs(np.linalg.eigvals(np.linalg.solve(after, before))).max()
        assert (radius < 1.0 + 1e-9) == is_stable
