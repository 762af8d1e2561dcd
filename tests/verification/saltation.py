"""Motions of a few modes with one stop from impact to impact, exact to round-off.

    M a + C v + K x = Re(f exp(iωt)),   gap g = g0 + h x >= 0,   g'⁺ = -e g'⁻

Between impacts the motion is that of the linear system, in closed form. The derivative of the state
at the end by that at the start (the monodromy, over a period) is the product of exp(A t) of the
flights and of a saltation matrix of each impact,

    S = R + (F⁺ - R F⁻) n / (n F⁻),   R = 1 - (1 + e) d h,   n = (h, 0)                    (T1)

with the vector field F before and after it, and d h the projection on the mode of the impulse. S
grows without bound as the speed of the impact goes to 0 (grazing): there is no derivative then.
This module steps nothing and shares no code with what steps: it is the judge of those.

Source: Müller, Chaos, Solitons & Fractals 5 (1995) 1671-1681; Leine and Nijmeijer, Dynamics and
Bifurcations of Non-Smooth Mechanical Systems (2004), chapter 7.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.optimize import brentq

from delam_fem.api import FloatArray

SAMPLES = 60
"""Instants per period of the fastest mode, or of the drive, at which the gap is looked at."""
LANDED = 1e-9
"""Share of a sampling interval after an impact in which the same impact is not found again."""
MOST_IMPACTS = 200
"""Impacts in a journey, beyond which it counts as chattering."""
CHATTERS = "the motion chatters: its impacts follow one another without end"
ROOT = 4.0 * np.finfo(float).eps
"""Relative accuracy of the time of an impact."""


@dataclass(frozen=True)
class Journey:
    """A motion over a time, with its derivative.

    Attributes:
        state: (x, v) at the end, shape (2 n,).
        derivative: of this state by that at the start, shape (2 n, 2 n).
        times: of the impacts [s].
        speeds: gap rates before the impacts, negative [m/s].
        nearest_miss: smallest gap at a minimum that is not an impact [m]; infinite: none.
    """

    state: FloatArray
    derivative: FloatArray
    times: tuple[float, ...]
    speeds: tuple[float, ...]
    nearest_miss: float


class StoppedSystem:
    """A linear system under a harmonic force with one stop.

    Attributes:
        size: n, number of coordinates.
        period: of the force [s].
    """

    def __init__(
        self,
        matrices: tuple[FloatArray, FloatArray, FloatArray],
        force: npt.NDArray[np.complex128],
        omega: float,
        stop: tuple[FloatArray, float],
        *,
        restitution: float,
    ) -> None:
        """Diagonalise the system.

        Args:
            matrices: M, C and K, each of shape (n, n).
            force: f, complex amplitudes, shape (n,).
            omega: ω [rad/s].
            stop: row h, shape (n,), and gap at rest g0.
            restitution: e [-].
        """
        M, C, K = matrices
        row, self._gap0 = stop
        n = self.size = len(M)
        self._omega, self._e = omega, restitution
        self.period = 2.0 * np.pi / omega
        self._A = np.block([[np.zeros((n, n)), np.eye(n)], [-np.linalg.solve(M, np.c_[K, C])]])
        self._rates, self._vectors = np.linalg.eig(self._A)
        self._inverse = np.linalg.inv(self._vectors)
        load = np.concatenate([np.zeros(n), np.linalg.solve(M, force)])
        self._steady = np.linalg.solve(1j * omega * np.eye(2 * n) - self._A, load)
        self._load = load
        self._gap, self._rate = np.r_[row, np.zeros(n)], np.r_[np.zeros(n), row]
        push = np.linalg.solve(M, row)
        kick = np.r_[np.zeros(n), push / (row @ push)]
        self._reset = np.eye(2 * n) - (1.0 + restitution) * np.outer(kick, self._rate)
        fastest = max(np.abs(self._rates.imag).max(), omega)
        self._interval = 2.0 * np.pi / (fastest * SAMPLES)

    def journey(self, state: FloatArray, start: float, duration: float) -> Journey:
        """Return the motion over a time.

        Args:
            state: (x, v) at the start, shape (2 n,).
            start: time at the start, which the phase of the force follows [s].
            duration: [s].

        Raises:
            ArithmeticError: the impacts follow one another without end (chattering).
        """
        t, end = start, start + duration
        derivative = np.eye(2 * self.size)
        times: list[float] = []
        speeds: list[float] = []
        miss = np.inf
        while True:
            flight = self._flight(state, t)
            impact_time, nearest = self._next_impact(flight, t, end, bool(times))
            miss = min(miss, nearest)
            if impact_time is None:
                derivative = self._propagator(end - t) @ derivative
                return Journey(flight(end), derivative, tuple(times), tuple(speeds), miss)
            before = flight(impact_time)
            derivative = (
                self._saltation(before, impact_time)
                @ self._propagator(impact_time - t)
                @ derivative
            )
            times.append(impact_time)
            speeds.append(float(self._rate @ before))
            state, t = self._reset @ before, impact_time
            if len(times) > MOST_IMPACTS:
                raise ArithmeticError(CHATTERS)

    def _flight(self, state: FloatArray, start: float) -> Callable[..., FloatArray]:
        """Return the motion without impacts as a function of the time, or of times (k, 1)."""
        free = self._inverse @ (state - np.real(self._steady * np.exp(1j * self._omega * start)))

        def at(t: float | FloatArray) -> FloatArray:
            free_motion = (free * np.exp(self._rates * (t - start))) @ self._vectors.T
            return np.real(free_motion + self._steady * np.exp(1j * self._omega * t))

        return at

    def _propagator(self, duration: float) -> FloatArray:
        return np.real((self._vectors * np.exp(self._rates * duration)) @ self._inverse)

    def _saltation(self, before: FloatArray, t: float) -> FloatArray:
        """Return S of T1 for an impact."""
        after = self._reset @ before
        load = np.real(self._load * np.exp(1j * self._omega * t))
        field, left = self._A @ before + load, self._A @ after + load
        jump = left - self._reset @ field
        return np.asarray(self._reset + np.outer(jump, self._gap) / (self._gap @ field))

    def _next_impact(
        self, flight: Callable[..., FloatArray], start: float, end: float, is_landed: bool
    ) -> tuple[float | None, float]:
        """Return the time of the next impact, None if there is none, and the nearest miss.

        Minima of the gap between two samples are looked at too, so that no short contact is missed.
        """
        count = max(2, int(np.ceil((end - start) / self._interval)) + 1)
        grid = np.linspace(start, end, count)
        if is_landed:
            grid[0] = start + LANDED * (grid[1] - start)
        motion = flight(grid[:, None])
        gaps, rates = self._gap0 + motion @ self._gap, motion @ self._rate
        nearest = np.inf
        if is_landed and gaps[0] <= 0.0:
            raise ArithmeticError(CHATTERS)

        def gap(t: float) -> float:
            return float(self._gap0 + self._gap @ flight(t))

        def rate(t: float) -> float:
            return float(self._rate @ flight(t))

        for k in range(count - 1):
            left, right = float(grid[k]), float(grid[k + 1])
            if rates[k] < 0.0 < rates[k + 1]:  # a minimum between two samples
                right = float(brentq(rate, left, right, rtol=ROOT))
            elif rates[k] > 0.0 > rates[k + 1] and gaps[k + 1] < 0.0:  # up and down within one
                left = float(brentq(rate, left, right, rtol=ROOT))
            lowest = gap(right)
            if lowest <= 0.0 and gap(left) > 0.0:
                return float(brentq(gap, left, right, xtol=1e-300, rtol=ROOT)), nearest
            if right < grid[k + 1]:
                nearest = min(nearest, lowest)
        return None, nearest


def exact_orbit(
    system: StoppedSystem, guess: FloatArray, periods: int = 1, tolerance: float = 1e-12
) -> tuple[FloatArray, Journey]:
    """Return the state of a periodic orbit at t = 0, by Newton's method, and its journey.

    Args:
        system: the system.
        guess: state to start from, shape (2 n,).
        periods: of the force in one of the orbit.
        tolerance: largest change of the state in the last iteration, relative to it.

    Raises:
        ArithmeticError: the iteration does not converge.
    """
    state = np.array(guess, dtype=np.float64)
    for _ in range(50):
        journey = system.journey(state, 0.0, periods * system.period)
        change = np.linalg.solve(np.eye(state.size) - journey.derivative, journey.state - state)
        state = state + change
        if np.abs(change).max() <= tolerance * np.abs(state).max():
            return state, system.journey(state, 0.0, periods * system.period)
    raise ArithmeticError("Newton's method does not converge to a periodic orbit")
