"""The forced impact oscillator, x'' + x = cos ωt, x <= s, x'⁺ = -e x'⁻: exact motions and maps.

Motions with one impact in a period T = 2π/ω are known in closed form, and so are their multipliers,
whose product is e². With G = 1/(1 - ω²), c = cot(T/2) the impact speed V solves

    [s + (1+e) V c/2]² + [(1-e) V/(2ω)]² = G²                                              (O1)

The larger V doubles its period where 1 + μ₁ + μ₂ + e² = 0, and both V meet in a fold where

    s = |G| √(1 + ((1+e) ω c/(1-e))²),  1 < ω < 2                                          (O2)
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable

import numba
import numpy as np
import scipy.sparse as sp
from scipy.optimize import brentq

from delam_fem.api import BaseCoupling, FloatArray, Operators

SAMPLES = 64
"""Instants of a period at which a flight is looked at; its maxima between them are, too."""
MOST_IMPACTS = 30
"""Impacts in a period beyond which a motion counts as chattering."""


def oscillator(stop: float) -> Operators:
    """Return x'' + x = q(t), x <= s: a unit mass on a unit spring whose other end moves by q.

    Args:
        stop: s [m].
    """
    one = np.ones(1)
    zero = np.zeros(1)
    return Operators(
        mass=sp.csr_matrix([[1.0]]),
        damping=sp.csr_matrix([[0.0]]),
        stiffness=sp.csr_matrix([[1.0]]),
        lumped_mass=one,
        base=BaseCoupling(zero, zero, -one, (0.0, 0.0, 1.0)),
        gap_matrix=sp.csr_matrix([[-1.0]]),
        gap0=np.array([stop]),
        probes=sp.csr_matrix([[1.0]]),
    )


def forcing(omega: float, phase: float) -> Callable[[FloatArray], FloatArray]:
    """Return q = cos(ωt + phase) with its derivatives."""

    def motion(times: FloatArray) -> FloatArray:
        angle = omega * times + phase
        cos = np.cos(angle)
        sin = np.sin(angle)
        return np.stack([cos, -omega * sin, -(omega**2) * cos], axis=-1)

    return motion


def orbit(omega: float, e: float, phase: float) -> tuple[float, float]:
    """Return V and s of the one-impact orbit with the forcing phase ωt = `phase` at the impact.

    x = a cos t + b sin t + G cos(ωt + phase); x(0) = x(T) = s, x'(0) = -e V, x'(T) = V.
    """
    T = 2.0 * np.pi / omega
    G = 1.0 / (1.0 - omega**2)
    C = np.cos(T)
    S = np.sin(T)
    conditions = [[1, 0, 0, -1], [C, S, 0, -1], [0, 1, e, 0], [-S, C, -1, 0]]
    x = G * np.cos(phase)
    v = omega * G * np.sin(phase)
    _, _, V, s = np.linalg.solve(np.array(conditions, dtype=float), [-x, -x, v, v])
    return float(V), float(s)


def impact_phase(omega: float, s: float, e: float) -> float:
    """Return the phase at the impacts of the orbit with stop s and V > 0, of two that with less.

    Raises:
        ArithmeticError: there is none.
    """
    phases = np.linspace(0.0, 2.0 * np.pi, 181)
    for left, right in itertools.pairwise(phases):
        ends = [orbit(omega, e, phase)[1] - s for phase in (left, right)]
        if ends[0] * ends[1] < 0.0:
            phase = brentq(lambda p: orbit(omega, e, p)[1] - s, left, right, xtol=1e-14)
            if orbit(omega, e, phase)[0] > 0.0:
                return float(phase)
    raise ArithmeticError("no orbit with one impact in a period")


def state_at_zero(omega: float, s: float, e: float, phase: float) -> FloatArray:
    """Return (x, v) at t = 0 of the motion whose only impact in a period has a phase."""
    V = orbit(omega, e, phase)[0]
    G = 1.0 / (1.0 - omega**2)
    a = s - G * np.cos(phase)
    b = -e * V + omega * G * np.sin(phase)
    t = (-phase / omega) % (2.0 * np.pi / omega)
    angle = omega * t + phase
    return np.array([
        a * np.cos(t) + b * np.sin(t) + G * np.cos(angle),
        -a * np.sin(t) + b * np.cos(t) - omega * G * np.sin(angle),
    ])  # fmt: skip


def multipliers(omega: float, s: float, e: float) -> np.ndarray:
    """Return the eigenvalues of the linearised map from before one impact to before the next.

    With the acceleration a = cos φ - s at the impact and V before it,

        J = [[-e, 0], [(1 + e) a / V, -e]]  at the impact,  R(T) = [[C, S], [-S, C]]  between.
    """
    phase = impact_phase(omega, s, e)
    V, _ = orbit(omega, e, phase)
    T = 2.0 * math.pi / omega
    C = math.cos(T)
    S = math.sin(T)
    J = np.array([[-e, 0.0], [(1.0 + e) * (math.cos(phase) - s) / V, -e]])
    values: np.ndarray = np.linalg.eigvals(np.array([[C, S], [-S, C]]) @ J)
    return values


def fold_stop(omega: float, e: float) -> float:
    """Return the stop s at which two motions with one impact in a period meet, by O2."""
    ratio = (1.0 + e) * omega / math.tan(math.pi / omega) / (1.0 - e)
    return math.hypot(1.0, ratio) / abs(1.0 - omega**2)


@numba.njit
def journey(
    x: float, v: float, omega: float, s: float, e: float, periods: int
) -> tuple[float, float, float]:
    """Return the state after some periods from t = 0, and by how much a difference has grown.

    Flights are exact, an impact is found to round-off, and the difference passes it by J of
    `multipliers`; nothing is stepped.

    Returns:
        x, v, and the logarithm of the growth of a difference; NaN if the impacts do not end.
    """
    G = 1.0 / (1.0 - omega**2)
    T = 2.0 * math.pi / omega
    h = T / SAMPLES
    t = 0.0
    end = periods * T
    growth = 0.0
    d0, d1, n_impacts = 1.0, 0.0, 0
    while t < end - 1e-12:
        angle = omega * t
        a = x - G * math.cos(angle)
        b = v + omega * G * math.sin(angle)
        left = 0.0
        before = v
        hit = False
        while t + left < end - 1e-12 and not hit:
            right = min(left + h, end - t)
            after = -a * math.sin(right) + b * math.cos(right)
            after -= omega * G * math.sin(angle + omega * right)
            up = a * math.cos(right) + b * math.sin(right) + G * math.cos(angle + omega * right)
            last = right
            if before > 0.0 > after:  # a maximum between two samples
                low = left
                high = right
                for _ in range(60):
                    middle = 0.5 * (low + high)
                    speed = -a * math.sin(middle) + b * math.cos(middle)
                    speed -= omega * G * math.sin(angle + omega * middle)
                    low, high = (middle, high) if speed > 0.0 else (low, middle)
                top = a * math.cos(low) + b * math.sin(low) + G * math.cos(angle + omega * low)
                if top > s:
                    right = low
                    up = top
            if up > s:
                low = left
                high = right
                for _ in range(60):
                    middle = 0.5 * (low + high)
                    place = a * math.cos(middle) + b * math.sin(middle)
                    place += G * math.cos(angle + omega * middle)
                    low, high = (low, middle) if place > s else (middle, high)
                left = low
                hit = True
            else:
                left = last
                before = after
        C = math.cos(left)
        S = math.sin(left)
        t = t + left
        angle = angle + omega * left
        x = a * C + b * S + G * math.cos(angle)
        v = -a * S + b * C - omega * G * math.sin(angle)
        d0, d1 = C * d0 + S * d1, C * d1 - S * d0
        if hit:
            d0, d1 = -e * d0, (1.0 + e) * (math.cos(angle) - s) / v * d0 - e * d1
            x = s
            v = -e * v
            n_impacts = n_impacts + 1
            if n_impacts > MOST_IMPACTS * periods or v >= 0.0:
                return math.nan, math.nan, math.nan
        size = math.hypot(d0, d1)
        growth = growth + math.log(size)
        d0 = d0 / size
        d1 = d1 / size
    return x, v, growth


@numba.njit
def images(states: FloatArray, omega: float, s: float, e: float) -> FloatArray:
    """Return states (x, v) one period later, shape (k, 2)."""
    result = np.empty_like(states)
    for k in range(len(states)):
        result[k, 0], result[k, 1], _ = journey(states[k, 0], states[k, 1], omega, s, e, 1)
    return result
