"""Compute the force at a point of a lamina in time: sine, blow of a hammer, or table."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt
from scipy.interpolate import PchipInterpolator

from delam_fem.case.series import Series
from delam_fem.numerics.arrays import FloatArray

_LAST = 1e-9
"""Share of a table's length by which round-off may move the last step of a run."""


class _Course(Protocol):
    """Anything with `states`, such as `excitation.HarmonicMotion`."""

    def states(self, times: npt.ArrayLike) -> FloatArray:
        """Return a value and its derivatives as columns."""
        ...


class Course(Protocol):
    """A force in time."""

    def values(self, times: npt.ArrayLike) -> FloatArray:
        """Return force [N] and its rate [N/s] at `times` of shape (k,) [s], shape (k, 2)."""
        ...


@dataclass(frozen=True)
class SineForce:
    """A force whose course is that of a motion of the base: F sin(2 pi f t), or swept.

    Attributes:
        motion: the course, with the amplitude in N.
    """

    motion: _Course

    def values(self, times: npt.ArrayLike) -> FloatArray:
        """Return force and rate, shape (k, 2); see `Course`."""
        return self.motion.states(times)[:, :2]


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

    def values(self, times: npt.ArrayLike) -> FloatArray:
        """Return force and rate, shape (k, 2); see `Course`."""
        since = np.asarray(times, dtype=np.float64) - self.start
        lasts = (since >= 0.0) & (since < self.duration)
        omega = math.pi / self.duration
        course = np.stack([np.sin(omega * since), omega * np.cos(omega * since)], axis=-1)
        return np.where(lasts[:, None], self.amplitude * course, 0.0)


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

    def values(self, times: npt.ArrayLike) -> FloatArray:
        """Return force and rate, shape (k, 2); see `Course`."""
        t = np.asarray(times, dtype=np.float64)
        inside = np.minimum(t, self.length)
        course = np.stack([self.interpolant(inside), self.interpolant(inside, nu=1)], axis=-1)
        lasts = t <= self.length * (1.0 + _LAST)
        return np.where(lasts[:, None], course, 0.0)


@dataclass(frozen=True)
class ForceDrive:
    """A force at a point while the base rests.

    Attributes:
        course: the force in time.
    """

    course: Course

    def states(self, times: npt.ArrayLike) -> FloatArray:
        """Return q = q' = q'' = 0 of the base, force [N] and rate [N/s], shape (k, 5)."""
        t = np.asarray(times, dtype=np.float64)
        return np.concatenate([np.zeros((t.size, 3)), self.course.values(t)], axis=1)
