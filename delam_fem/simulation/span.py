"""Define the length of a run in steps and periods, and what it records."""

from __future__ import annotations

import math
from dataclasses import dataclass

from delam_fem.simulation.refinement import NOT_REFINED, Refinement


@dataclass(frozen=True)
class Span:
    """The length of a run, and what it records.

    Attributes:
        time_step: Δt [s].
        steps_per_period: N; here a period is any sequence of N steps.
        periods: number of periods to compute.
        window_periods: number of last periods that are recorded at every step (the window).
        frames_per_period: number of states of all dofs recorded per period of the window.
        limit: gap or displacement beyond which a motion counts as diverged [m].
        refinement: how steps near contact are divided.
    """

    time_step: float
    steps_per_period: int
    periods: int
    window_periods: int = 1
    frames_per_period: int = 0
    limit: float = math.inf
    refinement: Refinement = NOT_REFINED
