"""Compute drives with many lines: multisines, random motions and bursts, with exact derivatives.

The value s(t) that is prescribed is a displacement, velocity or acceleration of the base, or a
force. It is a sum of sines, so that the displacement of the base follows line by line,

    s(t) = Re Σ cₖ exp(i ωₖ t),    q(t) = Re Σ cₖ / (i ωₖ)^m exp(i ωₖ t)                        (B1)

with m = 0, 1, 2 of a displacement (or force), velocity, acceleration. There is no drift.

A random motion has the lines k/T of its duration T with normally distributed complex amplitudes,
E|cₖ|² = 2 S(fₖ)/T, where S is its one-sided power spectral density. Its lines are too many to be
summed at each step: they are summed by FFT on a grid of `PER_PERIOD` points per period of the
highest line. Between grid points q is the polynomial of degree 5 with q, q' and q'' of both, so
that q'' is continuous and q' and q'' are the derivatives of q.

Numbers come from the bits of PCG64 alone, so that a seed means the same motion everywhere.

Source: R. Pintelon, J. Schoukens, System Identification: A Frequency Domain Approach, 2nd ed.,
2012, sec. 5.2 (excitations) and 4.3 (random-phase multisines); M. R. Schroeder, IEEE Trans. Inf.
Theory 16 (1970) 85 (phases of low peaks).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt
import scipy  # loads its parts when they are used

from delam_fem.numerics.beams import ComplexArray
from delam_fem.numerics.types import FloatArray, IntArray

PER_PERIOD = 32
"""Points of the grid per period of the highest line: the polynomials are then off by 2e-9 of it."""
_AT_ONCE = 2_000_000
"""Lines times instants that are computed in one go."""
GROUP = 3
"""Consecutive odd lines of which one is left out at random ("odd-random")."""
_PER_LINE = 16
"""Points per period of the highest line among which a zero of the displacement is looked for."""


class Course(Protocol):
    """A value with two derivatives at any time."""

    def states(self, times: npt.ArrayLike) -> FloatArray:
        """Return the value and two derivatives at `times` of shape (k,) [s], shape (k, 3)."""
        ...


@dataclass(frozen=True, eq=False)
class Lines:
    """The sum of sines Re Σ cₖ exp(i ωₖ t).

    Attributes:
        frequency: of the lines, shape (n,) [Hz].
        amplitude: cₖ, shape (n,), in the unit of the value.
    """

    frequency: FloatArray
    amplitude: ComplexArray

    def integrated(self, times: int) -> Lines:
        """Return the integral, repeated `times` times, without constants."""
        i_omega = 2j * np.pi * self.frequency
        return Lines(self.frequency, self.amplitude / i_omega**times)

    def states(self, times: npt.ArrayLike) -> FloatArray:
        """Return the value and two derivatives, shape (k, 3)."""
        t = np.asarray(times, dtype=np.float64)
        i_omega = 2j * np.pi * self.frequency
        columns = self.amplitude[:, None] * i_omega[:, None] ** np.arange(3)
        result = np.empty((t.size, 3))
        size = max(1, _AT_ONCE // max(1, self.frequency.size))
        if t.size > 1 and _is_uniform(t):
            # exp(iω (t₀ + (a n + b) h)) = exp(iω (t₀ + a n h)) exp(iω b h): a product of matrices
            n = math.isqrt(t.size - 1) + 1
            h = (t[-1] - t[0]) / (t.size - 1)
            rows = np.exp(np.outer(t[0] + h * np.arange(0, t.size, n), i_omega))
            within = np.exp(np.outer(h * np.arange(n), i_omega)).T
            for order in range(3):
                result[:, order] = ((rows * columns[:, order]) @ within).real.ravel()[: t.size]
            return result
        for start in range(0, t.size, size):
            part = slice(start, start + size)
            result[part] = (np.exp(np.outer(t[part], i_omega)) @ columns).real
        return result

    def from_zero(self) -> Lines:
        """Return the same sum, which begins at the first instant at which it is 0."""
        step = 1.0 / (_PER_LINE * float(self.frequency.max()))
        value = self.states(np.zeros(1))[0, 0]
        start = 0.0
        while True:  # it has no mean, so that it passes 0 within a period
            times = start + step * np.arange(1025)
            values = np.r_[value, self.states(times[1:])[:, 0]]
            crossings = np.flatnonzero(values[:-1] * values[1:] <= 0.0)
            if crossings.size:
                break
            start = float(times[-1])
            value = values[-1]
        k = int(crossings[0])
        zero = scipy.optimize.brentq(
            lambda t: self.states(np.array([t]))[0, 0], times[k], times[k + 1], xtol=1e-15
        )
        turned = self.amplitude * np.exp(2j * np.pi * self.frequency * zero)
        return Lines(self.frequency, turned)


@dataclass(frozen=True, eq=False)
class Gridded:
    """A sum of the sines k/T that was summed by FFT, with polynomials of degree 5 in between.

    Attributes:
        course: one period of the polynomials.
        length: T [s].
    """

    course: scipy.interpolate.PPoly
    length: float

    @classmethod
    def of(cls, numbers: IntArray, amplitude: ComplexArray, length: float) -> Gridded:
        """Return the sum of the lines k/T with the numbers k and the amplitudes cₖ."""
        n = PER_PERIOD * int(numbers.max())
        n = scipy.fft.next_fast_len(n, real=True)
        spectrum = np.zeros(n // 2 + 1, dtype=np.complex128)
        states = np.empty((3, n + 1))
        for order in range(3):
            factor = (2j * np.pi * numbers / length) ** order
            spectrum[numbers] = 0.5 * n * amplitude * factor
            states[order, :-1] = scipy.fft.irfft(spectrum, n)
        states[:, -1] = states[:, 0]
        h = length / n
        x = h * np.arange(n + 1)
        x[-1] = length
        return cls(scipy.interpolate.PPoly(_quintics(states, h), x), length)

    def states(self, times: npt.ArrayLike) -> FloatArray:
        """Return the value and two derivatives, shape (k, 3)."""
        t = np.mod(np.asarray(times, dtype=np.float64), self.length)
        return np.stack([self.course(t, nu=order) for order in range(3)], axis=-1)


def _is_uniform(times: FloatArray) -> bool:
    """Return whether times have equal distances to round-off."""
    even = np.linspace(times[0], times[-1], times.size)
    return bool(np.abs(times - even).max() <= 4.0 * np.finfo(np.float64).eps * np.abs(times).max())


def _quintics(states: FloatArray, h: float) -> FloatArray:
    """Return the coefficients of the polynomials between points h apart, highest power first.

    Args:
        states: value and two derivatives at n + 1 points, shape (3, n + 1).
        h: their distance [s].

    Returns:
        Shape (6, n).
    """
    value = states[0]
    slope = h * states[1]
    bend = h**2 * states[2]
    rise = np.diff(value)
    v0, v1 = slope[:-1], slope[1:]
    a0, a1 = bend[:-1], bend[1:]
    scaled = [
        6.0 * rise - 3.0 * (v0 + v1) + 0.5 * (a1 - a0),
        -15.0 * rise + 8.0 * v0 + 7.0 * v1 + 1.5 * a0 - a1,
        10.0 * rise - 6.0 * v0 - 4.0 * v1 - 1.5 * a0 + 0.5 * a1,
        0.5 * a0,
        v0,
        value[:-1],
    ]
    return np.stack([c / h ** (5 - k) for k, c in enumerate(scaled)])


@dataclass(frozen=True, eq=False)
class Faded:
    """A motion that begins smoothly from 0, and may end so.

    Attributes:
        motion: the motion.
        rise: time in which it comes and goes [s].
        end: time at which it is 0 again [s]; None: it stays.
    """

    motion: Course
    rise: float
    end: float | None = None

    def states(self, times: npt.ArrayLike) -> FloatArray:
        """Return the value and two derivatives, shape (k, 3)."""
        t = np.asarray(times, dtype=np.float64)
        weight = smooth_step(t, 0.0, self.rise)
        if self.end is not None:
            falling = -smooth_step(t, self.end - self.rise, self.rise)
            falling[:, 0] += 1.0
            weight = product(weight, falling)
        return product(weight, self.motion.states(t))


@dataclass(frozen=True, eq=False)
class Realisations:
    """Multisines one after the other; each goes over into the next in the next one's first period.

    Attributes:
        each: the multisines.
        stay: length of each [s].
        change: length of a period [s].
    """

    each: Sequence[Course]
    stay: float
    change: float

    def states(self, times: npt.ArrayLike) -> FloatArray:
        """Return the value and two derivatives, shape (k, 3)."""
        t = np.asarray(times, dtype=np.float64)
        number = np.floor(t / self.stay * (1.0 + 1e-12)).astype(np.int64)
        number = np.clip(number, 0, len(self.each) - 1)
        result = np.empty((t.size, 3))
        for r in np.unique(number).tolist():
            own_times = number == r
            part = t[own_times]
            now = self.each[r].states(part)
            if r:
                weight = smooth_step(part, r * self.stay, self.change)
                changes = part < r * self.stay + self.change
                before = self.each[r - 1].states(part[changes])
                differing = product(weight[changes], now[changes] - before)
                now[changes] = before + differing
            result[own_times] = now
        return result


class Still:
    """A drive that is always 0."""

    def states(self, times: npt.ArrayLike) -> FloatArray:
        """Return zeros, shape (k, 3)."""
        return np.zeros((np.size(times), 3))


def smooth_step(times: FloatArray, start: float, rise: float) -> FloatArray:
    """Return a rise from 0 to 1 with a continuous second derivative, with derivatives, (k, 3)."""
    x = np.clip((times - start) / rise, 0.0, 1.0)
    value = x**3 * (10.0 - 15.0 * x + 6.0 * x**2)
    slope = 30.0 * x**2 * (1.0 - x) ** 2 / rise
    bend = 60.0 * x * (1.0 - x) * (1.0 - 2.0 * x) / rise**2
    return np.stack([value, slope, bend], axis=-1)


def product(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the product of two functions with its derivatives, shape (k, 3)."""
    first = a[:, 1] * b[:, 0] + a[:, 0] * b[:, 1]
    second = a[:, 2] * b[:, 0] + 2.0 * a[:, 1] * b[:, 1] + a[:, 0] * b[:, 2]
    return np.stack([a[:, 0] * b[:, 0], first, second], axis=-1)


def _uniform(count: int, *seed: int) -> FloatArray:
    """Return numbers from 0 to below 1 that a seed alone decides, shape (count,)."""
    bits = np.random.PCG64(np.random.SeedSequence(seed)).random_raw(count)
    return (bits >> np.uint64(11)) * 2.0**-53


def line_numbers(first: int, last: int, kind: str, seed: int) -> IntArray:
    """Return the numbers of the lines of a multisine that are driven.

    Args:
        first: lowest number.
        last: highest number.
        kind: "all", "odd", or "odd-random": of each `GROUP` odd lines one is left out.
        seed: decides which.
    """
    numbers: IntArray = np.arange(max(first, 1), last + 1)
    if kind == "all":
        return numbers
    odd: IntArray = numbers[numbers % 2 == 1]
    if kind == "odd":
        return odd
    n_groups = odd.size // GROUP
    left_out = GROUP * np.arange(n_groups) + (GROUP * _uniform(n_groups, seed, 1)).astype(np.int64)
    return np.asarray(np.delete(odd, left_out))


def phases(count: int, kind: str, seed: int, realisation: int) -> FloatArray:
    """Return the phases of the lines of a multisine, shape (count,) [rad].

    Args:
        count: number of lines.
        kind: "random", or "schroeder": -π n (n - 1) / N of the line n of N.
        seed: decides the random ones.
        realisation: number of the realisation from 0.
    """
    if kind == "random":
        return 2.0 * math.pi * _uniform(count, seed, 2, realisation)
    n = np.arange(1, count + 1)
    return -math.pi * n * (n - 1) / count


def random_amplitudes(density: FloatArray, length: float, seed: int) -> ComplexArray:
    """Return complex amplitudes cₖ of a random motion with a power spectral density.

    Args:
        density: S at the lines k/T, one-sided, shape (n,) [unit²/Hz].
        length: T [s].
        seed: decides the amplitudes.
    """
    size = np.sqrt(-np.log1p(-_uniform(density.size, seed, 3)))
    angle = 2.0 * np.pi * _uniform(density.size, seed, 4)
    return np.asarray(np.sqrt(2.0 * density / length) * size * np.exp(1j * angle))


def high_passed(time: FloatArray, value: FloatArray, corner: float) -> FloatArray:
    """Return samples without what is below a frequency, without a shift of phase.

    A Butterworth filter of order 4 passes forward and backward, so that at the corner half the
    amplitude is left.

    Args:
        time: equally spaced instants, shape (n,) [s].
        value: the samples, shape (n,).
        corner: the frequency [Hz].
    """
    rate = (time.size - 1) / (time[-1] - time[0])
    filter_ = scipy.signal.butter(4, corner, "highpass", fs=rate, output="sos")
    longest = min(value.size - 1, math.ceil(3.0 * rate / corner))
    return np.asarray(scipy.signal.sosfiltfilt(filter_, value, padlen=longest))
