"""A bar that is cut in two and pressed together: what passes the cut, exact.

A wave of compression p(t) = a sin ωt reaches the cut, which the force P presses together. While the
cut is closed, its contact force is P + p, and the wave passes unchanged. It opens where P + p falls
below 0. While it is open, the force that passes is -P, and the gap g grows by

    ρ c A g' = -2 (P + p)                                                                  (R1)

until it is 0 again. For P > a the cut never opens.

Source: J. M. Richardson, Int. J. Eng. Sci. 17 (1979) 73-85.

The case has both bars from their outer ends at x = 0 to the cut at x = L, with dampers ρ c A at the
outer ends, which absorb the waves.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from scipy.optimize import brentq

from delam_fem.api import Case, EngineName, FloatArray, run

E, RHO, WIDTH = 7e10, 2700.0, 0.01
C = math.sqrt(E / RHO)
"""Speed of waves [m/s]."""
Z = RHO * C * WIDTH**2
"""Impedance ρ c A [N s/m]."""
F = 20e3
"""Frequency of the wave [Hz]."""
A = 100.0
"""Amplitude a of its force [N]."""
QUADRATURE = np.polynomial.legendre.leggauss(200)


def reopening(pressure: float) -> tuple[float, float]:
    """Return ωt at which the cut opens and closes again, for P/a < 1, by R1."""
    opens = math.pi + math.asin(pressure)
    rises_again = 2.0 * math.pi - math.asin(pressure)

    def gap(angle: float) -> float:
        """Return g of R1, up to a positive factor."""
        return math.cos(angle) - math.cos(opens) - pressure * (angle - opens)

    return opens, float(brentq(gap, rises_again, opens + 2.0 * math.pi, xtol=1e-14))


def passing(pressure: float, count: int = 4) -> FloatArray:
    """Return the lowest harmonics of the wave behind the cut, relative to a, shape (count,).

    Args:
        pressure: P/a.
        count: number of harmonics.
    """
    if pressure >= 1.0:
        return np.eye(count)[0]
    opens, closes = reopening(pressure)
    pieces = (
        (opens, closes, lambda angle: np.full_like(angle, -pressure)),
        (closes, opens + 2.0 * math.pi, np.sin),
    )
    harmonics = np.zeros(count, dtype=complex)
    points, weights = QUADRATURE
    for start, end, force in pieces:
        half = 0.5 * (end - start)
        angle = 0.5 * (start + end) + half * points
        turns = np.exp(-1j * np.outer(np.arange(1, count + 1), angle))
        harmonics += turns @ (half * weights * force(angle)) / math.pi
    return np.abs(harmonics)


def cut_bar(
    pressure: float, per_wave: int, *, steps: int = 400, waves: float = 1.0, **tables: Any
) -> Case:
    """Return a cut bar under pressure.

    Args:
        pressure: P/a.
        per_wave: elements in a wavelength of the second harmonic.
        steps: steps per period.
        waves: length of each half, in wavelengths.
        tables: other tables of the case.
    """
    length = waves * C / F
    bar = {
        "motion": "axial", "length": length, "width": WIDTH, "thickness": WIDTH, "density": RHO,
        "young_modulus": E, "damping_ratio": 0.0,
    }  # fmt: skip
    data: dict[str, Any] = {
        "name": "cut-bar",
        "lamina": [{"name": "left"} | bar, {"name": "right"} | bar],
        "gap": {"root": 1.0, "tip": 1e-15, "exponent": 1.0},
        "mesh": {"elements": round(2 * per_wave * waves)},
        "support": [
            {"side": "start", "kind": "spring", "stiffness": 0.0, "damping": Z},
            {"side": "end", "kind": "free"},
        ],
        "load": [{"between": ["left", "right"], "position": length, "force": pressure * A}],
        "excitation": {
            "kind": "force", "lamina": "left", "position": 0.0, "amplitude": 2.0 * A,
            "frequency": F,
        },
        "contact": {"law": "newton", "restitution": 0.0},
        "time": {"scheme": "moreau-jean", "steps_per_period": steps, "periods": 12},
        "output": {"window_periods": 1, "fields_per_period": 0},
    }  # fmt: skip
    return Case(**(data | tables))


def harmonics_of(case: Case, engine: EngineName = "compiled", count: int = 4) -> FloatArray:
    """Return the lowest harmonics of ρ c A v behind the cut, relative to a, shape (count,)."""
    velocity = run(case, engine).history.tip_velocity.values[1]
    return np.asarray(2.0 * Z / A * np.abs(np.fft.rfft(velocity))[1 : count + 1] / velocity.size)
