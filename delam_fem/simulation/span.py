"""How long a run is, in steps and periods, and what is kept of it."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class Span:
    """How long a run is, and what is kept of it.

    Attributes:
        time_step: Δt [s].
        steps_per_period: N; a period is any stretch of N steps.
        periods: to compute.
        window_periods: how many of the last are recorded at every step.
        frames_per_period: states of all dofs kept per period of the window.
        limit: gap or displacement beyond which a motion counts as diverged [m].
    """

    time_step: float
    steps_per_period: int
    periods: int
    window_periods: int = 1
    frames_per_period: int = 0
    limit: float = math.inf
