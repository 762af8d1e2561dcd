"""A ball on a shaking table: one touch in each period, exact.

The table moves by A sin ωt, touches are at the phase φ, and the ball flies for T = 2π/ω between
them. It leaves with gT/2 and returns with -gT/2, so that the table has the velocity

    A ω cos φ = g T (1 - e) / (2 (1 + e))                                                  (T1)

and the ball strikes it with g T / (1 + e). The multipliers have the product e² and the sum

    μ₁ + μ₂ = -2 e + (1 + e)² (1 - Γ sin φ),   Γ = A ω²/g                                  (T2)

Two such motions, with φ and -φ, meet in a fold at Γ = π (1 - e)/(1 + e). The one with φ > 0 doubles
its period at Γ² = (π (1 - e)/(1 + e))² + (2 (1 + e²)/(1 + e)²)².
"""

from __future__ import annotations

import math
from typing import Any

from delam_fem.api import Case

G, F, M = 9.80665, 10.0, 0.0027
"""g [m/s2], frequency of the table [Hz], mass of the ball [kg]."""
OMEGA = 2.0 * math.pi * F
T = 1.0 / F


def amplitude_of(gamma: float) -> float:
    """Return the amplitude A of a table with a given Γ [m]."""
    return gamma * G / OMEGA**2


def phase_of(gamma: float, e: float) -> float:
    """Return φ of T1 [rad]."""
    return math.acos(math.pi * (1.0 - e) / ((1.0 + e) * gamma))


def sum_of_multipliers(gamma: float, e: float) -> float:
    """Return μ₁ + μ₂ of T2."""
    return -2.0 * e + (1.0 + e) ** 2 * (1.0 - gamma * math.sin(phase_of(gamma, e)))


def limits(e: float) -> tuple[float, float]:
    """Return Γ at the fold and at the doubling."""
    fold = math.pi * (1.0 - e) / (1.0 + e)
    return fold, math.hypot(fold, 2.0 * (1.0 + e**2) / (1.0 + e) ** 2)


def ball(gamma: float, e: float, phase: float, *, steps: int = 1000, **tables: Any) -> Case:
    """Return a ball that begins at t = 0 on its way to a touch at a phase, with -gT/2 there.

    Motions that stick to the table live beside the one with a touch in each period.

    Args:
        gamma: Γ.
        e: restitution.
        phase: φ [rad].
        steps: steps per period.
        tables: other tables of the case.
    """
    A = amplitude_of(gamma)
    left = phase / OMEGA
    velocity = -0.5 * G * T + G * left
    height = A * math.sin(phase) - velocity * left + 0.5 * G * left**2
    data: dict[str, Any] = {
        "name": "ball",
        "lamina": [{"name": "ball", "mass": M, "stiffness": 0.0, "damping_ratio": 0.0}],
        "mesh": {"elements": 1},
        "stop": [{"lamina": "ball", "side": "below", "gap": 0.0}],
        "gravity": {"acceleration": G},
        "initial": [{"displacement": height, "velocity": velocity}],
        "excitation": {"kind": "harmonic", "frequency": F, "amplitude": A},
        "contact": {"law": "newton", "restitution": e},
        "time": {"periods": 30, "steps_per_period": steps, "scheme": "moreau-jean"},
        "output": {"window_periods": 5, "fields_per_period": 0},
    }
    return Case(**(data | tables))
