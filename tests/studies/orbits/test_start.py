"""Orbits are sought from the initial state of a case."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import delam_fem as df
from delam_fem.studies.orbits.search import map_of, settled_map, start_of

OTHERS = Path(__file__).parents[3] / "docs" / "examples" / "others"
KEY = "excitation.frequency"


def test_the_start_is_that_of_a_run() -> None:
    """In the frame of the dofs, while the base moves."""
    keys = {"time.steps_per_period": 400, "time.periods": 1, "output.window_periods": 1,
            "stop.1.on": "base", "excitation.acceleration": 0.2}  # fmt: skip
    case = df.load_case(OTHERS / "sdnd102.toml").with_overrides(keys)
    map_, start = map_of(case, KEY), start_of(case)
    assert start is not None
    tips = df.run(case, engine="compiled").history["tip_displacement"][0].to_numpy()
    trajectory = map_.trajectory(start, case.excitation.top_frequency, 1)
    assert trajectory.strobes[-1, 0] == pytest.approx(tips[-1], abs=1e-12)
    assert abs(tips[-1]) > 1e-5
    assert start_of(case.without_strikes) is None


def test_the_start_chooses_one_of_two_motions() -> None:
    """The rod on a stiff stop, at 66,602 rad/s: free from rest, on the stop from 0.4 mm."""
    keys = {"stop.1.stiffness": 1.008e10, "time.steps_per_period": 400, KEY: 10600.0}
    low = df.load_case(OTHERS / "rod.toml").with_overrides(keys)
    high = low.with_overrides({"initial": [{"shape": "mode", "displacement": -4e-4}]})
    tips = []
    for case in (low, high):
        map_, state = settled_map(map_of(case, KEY), 10600.0, 200, start_of(case))
        trajectory = map_.trajectory(state, 10600.0, 1)
        tips.append(max(-float(trajectory.low[0]), float(trajectory.high[0])))
    np.testing.assert_allclose(tips, [6.04e-5, 3.21e-4], rtol=0.02)
