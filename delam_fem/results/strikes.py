"""Strikes: the beginnings of contacts at the reference probes, with the velocities before them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from delam_fem.numerics.arrays import BoolArray, FloatArray, IntArray
from delam_fem.results import diagnostics

if TYPE_CHECKING:
    import xarray as xr

STEPS_BEFORE = 2
"""The velocities of a strike are read this number of steps before it, because waves from impacts
nearer the clamp reach the tip in the very last step."""


@dataclass(frozen=True)
class Strikes:
    """The strikes of two neighbours in the window of a run.

    A contact is a group of closures at the probes less than `diagnostics.GROUP_PERIODS` apart. A
    strike is the beginning of a contact. If a period has several, the strike is the beginning with
    the fastest approach.

    Attributes:
        step: step of each strike within the window, shape (n,).
        velocity: velocities of the lower and the upper probe before each strike, shape (2, n)
            [m/s].
    """

    step: IntArray
    velocity: FloatArray

    @property
    def mean(self) -> tuple[float, float]:
        """Mean velocities of both probes before a strike [m/s]; NaN if there are no strikes."""
        if not self.step.size:
            return float("nan"), float("nan")
        lower, upper = self.velocity.mean(axis=1)
        return float(lower), float(upper)

    @property
    def approach(self) -> float:
        """Mean speed of approach [m/s]; 0 if there are no strikes."""
        lower, upper = self.mean
        return lower - upper if self.step.size else 0.0


def of_interface(history: xr.Dataset, steps_per_period: int, interface: int) -> Strikes:
    """Return the strikes of the laminae `interface` and `interface` + 1, counted from 0."""
    v = history["tip_velocity"].to_numpy()
    closed = diagnostics.ProbeMotion.of(history).is_closed[interface]
    begins = contact_begins(closed, steps_per_period)
    begins = begins[begins >= STEPS_BEFORE]
    rate = v[interface + 1, begins - STEPS_BEFORE] - v[interface, begins - STEPS_BEFORE]
    period = begins // steps_per_period
    chosen = [
        int(begins[period == k][np.argmin(rate[period == k])]) for k in np.unique(period).tolist()
    ]
    steps = np.array(chosen, dtype=np.int64)
    return Strikes(steps, v[interface : interface + 2, steps - STEPS_BEFORE])


def contact_begins(closed: BoolArray, steps_per_period: int) -> IntArray:
    """Return the steps at which contacts begin.

    A contact that may have begun before the window is left out.

    Args:
        closed: whether the pair is closed at each step, shape (n_steps,).
        steps_per_period: N.
    """
    steps = np.flatnonzero(closed)
    apart = diagnostics.GROUP_PERIODS * steps_per_period
    since = np.diff(steps, prepend=-np.inf if steps.size and steps[0] > apart else 0)
    return np.asarray(steps[since >= apart], dtype=np.int64)
