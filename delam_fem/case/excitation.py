"""Compute the motion of the base: displacement, exact velocity and acceleration at given times.

Both kinds of motion start at t = 0 with the displacement 0 but not with the velocity 0: the base
starts abruptly while the laminae are at rest, as in the paper.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

from delam_fem.case.definition import Case
from delam_fem.case.sections import HarmonicExcitation, SweepExcitation
from delam_fem.numerics.arrays import FloatArray


class BaseMotion(Protocol):
    """A motion of the base, which all clamped dofs share."""

    def states(self, times: npt.ArrayLike) -> FloatArray:
        """Return the motion at `times`, shape (k,) [s].

        Returns:
            Displacement [m], velocity [m/s] and acceleration [m/s2] as columns, shape (k, 3).
        """
        ...

    def instantaneous_frequency(self, times: npt.ArrayLike) -> FloatArray:
        """Return the frequency phi'(t) / (2 pi) at `times`, same shape as `times` [Hz]."""
        ...


@dataclass(frozen=True)
class HarmonicMotion:
    """The motion A sin(2 pi f t).

    Attributes:
        frequency: f [Hz].
        amplitude: A [m].
    """

    frequency: float
    amplitude: float

    def states(self, times: npt.ArrayLike) -> FloatArray:
        """Return displacement, velocity and acceleration, shape (k, 3); see `BaseMotion`."""
        t = np.asarray(times, dtype=np.float64)
        omega = 2.0 * math.pi * self.frequency
        return _states(self.amplitude, omega * t, np.full_like(t, omega), np.zeros_like(t))

    def instantaneous_frequency(self, times: npt.ArrayLike) -> FloatArray:
        """Return the constant frequency, same shape as `times` [Hz]."""
        return np.full_like(np.asarray(times, dtype=np.float64), self.frequency)


@dataclass(frozen=True)
class SweptMotion:
    """The motion A sin(phi(t)) with the frequency f(t) = phi'(t) / (2 pi).

        linear:       f(t) = f0 + (f1 - f0) t/T,  phi = 2 pi (f0 t + (f1 - f0) t^2 / (2 T))
        logarithmic:  f(t) = f0 e^(r t/T),        phi = 2 pi f0 T (e^(r t/T) - 1) / r,  r = ln f1/f0

    The frequency stays at f1 after t = T, because a run may end with a whole period after T.

    Attributes:
        start_frequency: f0 [Hz].
        end_frequency: f1 [Hz].
        duration: T [s].
        amplitude: A [m].
        logarithmic: whether the frequency changes logarithmically in time, not linearly.
    """

    start_frequency: float
    end_frequency: float
    duration: float
    amplitude: float
    logarithmic: bool = False

    def states(self, times: npt.ArrayLike) -> FloatArray:
        """Return displacement, velocity and acceleration, shape (k, 3); see `BaseMotion`."""
        t = np.asarray(times, dtype=np.float64)
        turns, rate = self._law(np.minimum(t, self.duration))
        beyond = np.maximum(t - self.duration, 0.0)
        turns = turns + self.end_frequency * beyond
        rate = np.where(beyond > 0.0, 0.0, rate)
        rotation = 2.0 * math.pi * self.instantaneous_frequency(t)
        return _states(self.amplitude, 2.0 * math.pi * turns, rotation, 2.0 * math.pi * rate)

    def instantaneous_frequency(self, times: npt.ArrayLike) -> FloatArray:
        """Return f(t), same shape as `times` [Hz]."""
        share = np.minimum(np.asarray(times, dtype=np.float64) / self.duration, 1.0)
        f0, f1 = self.start_frequency, self.end_frequency
        frequency: FloatArray = (
            f0 * (f1 / f0) ** share if self.logarithmic else f0 + (f1 - f0) * share
        )
        return frequency

    def _law(self, t: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return phi / (2 pi) [-] and f' [Hz/s] at times t up to T, same shapes as t."""
        f0, f1, T = self.start_frequency, self.end_frequency, self.duration
        if not self.logarithmic:
            return t * (f0 + (f1 - f0) * t / (2.0 * T)), np.full_like(t, (f1 - f0) / T)
        r = math.log(f1 / f0)
        turns = f0 * T * np.expm1(r * t / T) / r if r else f0 * t
        return turns, self.instantaneous_frequency(t) * r / T


def base_motion(case: Case) -> BaseMotion:
    """Return the motion of the base that a case describes."""
    given = case.excitation
    if isinstance(given, HarmonicExcitation):
        return HarmonicMotion(given.frequency, given.amplitude)
    return _swept(given)


def _swept(given: SweepExcitation) -> SweptMotion:
    """Return the motion of the base for a sweep excitation."""
    return SweptMotion(
        given.start_frequency,
        given.end_frequency,
        given.duration,
        given.amplitude,
        logarithmic=given.spacing == "logarithmic",
    )


def _states(A: float, phi: FloatArray, rotation: FloatArray, change: FloatArray) -> FloatArray:
    """Return A sin(phi) and its derivatives, shape (k, 3); phi' is `rotation`, phi'' `change`."""
    sin, cos = np.sin(phi), np.cos(phi)
    states: FloatArray = A * np.stack(
        [sin, rotation * cos, change * cos - rotation**2 * sin], axis=-1
    )
    return states
