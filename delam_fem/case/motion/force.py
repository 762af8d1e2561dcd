"""Compute the force at a point of a lamina in time: the blow of a hammer, or a table.

A sine or a swept sine has the course of a motion of the base; see `excitation.py`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.interpolate import PchipInterpolator

from delam_fem.case.motion.series import Series
from delam_fem.numerics.arrays import FloatArray

_LAST = 1e-9
"""Share of a table's length by which round-off may move the last step of a run."""


@dataclass(frozen=True)
class HalfSine:
    """The blow of a hammer: F sin(pi (t - start) / duration) while it lasts, 0 otherwise.

    Attributes:
        amplitude: F [N].
        duration: length of the blow [s].
        start: its beginning [s].
    """

    amplitude: float
    duration: float
    start: float = 0.0

    def states(self, times: npt.ArrayLike) -> FloatArray:
        """Return force, rate and second derivative, shape (k, 3) [N, N/s, N/s2]."""
        since = np.asarray(times, dtype=np.float64) - self.start
        lasts = (since >= 0.0) & (since < self.duration)
        w = math.pi / self.duration
        sin, cos = np.sin(w * since), np.cos(w * since)
        course = self.amplitude * np.stack([sin, w * cos, -(w**2) * sin], axis=-1)
        return np.where(lasts[:, None], course, 0.0)


@dataclass(frozen=True)
class TabulatedForce:
    """A measured force: PCHIP, which does not overshoot between the rows.

    Attributes:
        interpolant: the force [N].
        length: last time of the table [s]; the force is 0 afterwards.
    """

    interpolant: PchipInterpolator
    length: float

    @classmethod
    def of(cls, series: Series) -> TabulatedForce:
        """Return the force of a table [N]."""
        return cls(PchipInterpolator(series.time, series.value), series.length)

    def states(self, times: npt.ArrayLike) -> FloatArray:
        """Return force, rate and second derivative, shape (k, 3) [N, N/s, N/s2]."""
        t = np.asarray(times, dtype=np.float64)
        inside = np.minimum(t, self.length)
        course = np.stack([self.interpolant(inside, nu=order) for order in range(3)], axis=-1)
        return np.where((t <= self.length * (1.0 + _LAST))[:, None], course, 0.0)
