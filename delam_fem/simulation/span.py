"""How long a run is, in steps and periods, and what is kept of it."""

from __future__ import annotations

import math
from dataclasses import dataclass

from delam_fem.case.definition import Case

DIVERGED_LENGTHS = 10.0
"""A gap or displacement of so many lengths of the laminae has no meaning any more."""


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

    @classmethod
    def of(cls, case: Case) -> Span:
        """Return the span of a case."""
        return cls(
            case.time_step,
            case.time.steps_per_period,
            case.n_periods,
            case.n_window_periods,
            case.output.fields_per_period,
            DIVERGED_LENGTHS * case.lamina[0].length,
        )
