"""The verdict on an orbit beside the motion that the case settles to."""

from __future__ import annotations

import numpy as np
import pytest
from toys import Cubic

import delam_fem as df

ROUGH = 1e-6
"""Jumps of the map, so that it has no exact orbit and kicks alone judge."""


@pytest.mark.parametrize("above", [0.0005, -0.0005])
def test_no_orbit_is_stable_beside_one_of_twice_its_period(above: float) -> None:
    """Its multiplier is -(1 + above); kicks of 6 and 3 % see -0.997 and -0.9996 above the doubling.

    The states of the doubled orbit lie at 1 ± sqrt(above).
    """
    case = df.preset("default", {"excitation.frequency": 1.0 + above})
    away = np.sqrt(max(above, 0.0))
    found = df.orbit(case, map_=Cubic(ROUGH), start=np.array([1.0 + away, 0.0]))
    assert found.coarse.solved.is_solved
    kicks = list(found.coarse.by_kicks)
    said = " ".join(found.words)
    if above < 0.0:
        assert found.multiple is None and kicks == [0.06, 0.03]
        assert {own.stability for own in found.coarse.by_kicks.values()} == {"stable"}
        return
    assert found.kind == "coarse", "no derivative speaks of it"
    assert found.multiple is not None and found.multiple.times == 2
    assert found.multiple.distance == pytest.approx(2.0 * away, rel=0.01)
    assert kicks == pytest.approx([away, 0.5 * away], rel=0.02)
    assert found.stability != "stable"
    assert "repeats after 2 periods; its states 1 apart differ by 4.5 %" in said
    assert found.numbers["settled_repeats"]["times"] == 2
