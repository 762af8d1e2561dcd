"""When the Moreau–Jean scheme lets a pair be hit: at a gap predicted for the middle of the step."""

from __future__ import annotations

import numpy as np
import pytest
from problems import ball

from delam_fem.api import SCHEMES, EngineName, Law, State, solve

STEP = 0.125
"""Time step [s]; exact in binary, as are the heights."""


@pytest.mark.parametrize("engine", ["petsc", "compiled"])
@pytest.mark.parametrize(
    ("height", "hit_in_step"),
    [
        (0.25 + 0.0625, 3),  # U = STEP/2 after two steps: predicted to be closed in the middle
        (0.25 + 0.0625 + 2.0**-12, 4),  # a little more: only after it has passed the floor
        (0.25 + 2.0**-20, 3),
        (0.25, 3),
    ],
)
def test_a_pair_is_hit_in_the_step_whose_middle_it_would_not_reach(
    height: float, hit_in_step: int, engine: EngineName
) -> None:
    """A free mass falls with 1 m/s; the gap at the start of step k + 1 is height - k STEP."""
    state = State(np.array([[height], [-1.0], [0.0]]), np.zeros(1, dtype=bool))
    solution = solve(
        ball(2.0),
        Law("newton", restitution=0.5),
        SCHEMES["moreau-jean"],
        time_step=STEP,
        steps_per_period=8,
        periods=1,
        initial=state,
        engine=engine,
    )
    assert solution.impacts.time.tolist() == [hit_in_step * STEP]
    assert solution.impacts.rate_pre.tolist() == [-1.0]
    assert solution.impacts.impulse.tolist() == [2.0 * 1.5]
    # of the step with the impulse, one half passes with the velocity before, one half after
    after = 8 - hit_in_step + 0.5
    assert solution.displacement[-1, 0] == height - STEP * (hit_in_step - 0.5) + 0.5 * STEP * after
