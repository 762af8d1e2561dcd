"""The verdict on an orbit beside the motion that the case settles to."""

from __future__ import annotations

import numpy as np
import pytest
from analytic_maps import Cubic, Steep

import delam_fem as df

ROUGH = 1e-6
"""Jumps of the map, so that it has no exact orbit and kicks alone judge."""


@pytest.mark.parametrize("above", [0.0005, -0.02])
def test_no_orbit_is_stable_beside_one_of_twice_its_period(above: float) -> None:
    """Its multiplier is -(1 + above); the states of the doubled orbit lie at 1 ± sqrt(above)."""
    case = df.preset("default", {"excitation.frequency": 1.0 + above})
    away = np.sqrt(max(above, 0.0))
    orbit = df.orbit(case, map_=Cubic(ROUGH), start=np.array([1.0 + away, 0.0]))
    assert orbit.coarse.solved.is_solved
    coarse, said = orbit.coarse, " ".join(orbit.words)
    if above < 0.0:
        assert coarse.multiple is None and coarse.kick == 0.02
        assert orbit.stability == "stable"
        return
    assert orbit.kind == "coarse", "no derivative speaks of it"
    assert coarse.multiple is not None and coarse.multiple.times == 2
    assert coarse.multiple.distance == pytest.approx(2.0 * away, rel=0.01)
    assert coarse.kick == pytest.approx(0.5 * away, rel=0.02)
    assert orbit.stability != "stable"
    assert "The motion repeats after 2 periods; its states 1 apart differ by 4.5 %" in said
    assert orbit.numbers["runs_on_to"]["times"] == 2


def test_a_motion_that_leaves_an_orbit_says_so_where_it_started() -> None:
    """At a = 1.1 the states of the doubled orbit lie 0.32 from the unstable one between them."""
    case = df.preset("default", {"excitation.frequency": 1.1})
    orbit = df.orbit(case, map_=Cubic(ROUGH), start=np.array([1.001, 0.0]))
    assert orbit.coarse.away == pytest.approx(np.sqrt(0.1), rel=0.01)
    assert orbit.stability == "unstable"
    low, high = orbit.coarse.multipliers.largest
    assert low < 1.1 < high + 0.01


def test_an_orbit_is_found_far_from_the_mean_of_the_motion_that_left_it() -> None:
    """A derivative at that mean leads to a point that does not close, with multipliers below 1."""
    case = df.preset("default", {"excitation.frequency": 2.0})
    orbit = df.orbit(case, map_=Steep(ROUGH), start=np.array([1.01, 0.0]))
    assert orbit.coarse.solved.is_solved and orbit.stability == "unstable"
    assert orbit.coarse.solved.state[0] == pytest.approx(1.0, abs=1e-3)
    low, high = orbit.coarse.multipliers.largest
    assert 1.8 < low < high < 2.0
