"""Exact natural frequencies of a beam with one delamination, from its transcendental equation.

Four uniform Euler–Bernoulli beams: bonded (1), upper and lower half of the delamination (2, 3),
bonded (4). In each beam w'''' = k⁴ w with k⁴ = ω² ρA / EI. At the tips of the delamination the
section stays plane, so that deflection, slope and axial displacement of all beams agree, and

    V_1 = V_2 + V_3,   M_1 = M_2 + M_3 + P (φ_b - φ_a),   P = Σ EA_i z_i² / a,

and the same with beam 4. z_i is the distance of the middle plane of a half from the neutral axis of
the bonded beam, φ_a and φ_b are the slopes at the tips, a is the length of the delamination. In the
constrained model both halves share their deflection.

Only NumPy and SciPy: nothing is shared with the assemblers or their data.

Source: J. T. S. Wang, Y. Y. Liu, J. A. Gibby, "Vibrations of split beams", J. Sound Vib. 84 (1982);
P. M. Mujumdar, S. Suryanarayan, "Flexural vibrations of beams with delaminations", J. Sound Vib.
125 (1988).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt
from scipy.optimize import brentq

Array = npt.NDArray[np.float64]
Half = tuple[float, float, float]
"""Young's modulus [Pa], density [kg/m3], thickness [m]."""

_POINTS_PER_HALF_WAVE = 60
"""Points of the search between two frequencies of the intact beam; two roots closer than this in
wave number are missed."""


@dataclass(frozen=True)
class SplitBeam:
    """A beam with one delamination.

    Attributes:
        length: L [m].
        width: b [m].
        start: where the delamination begins [m].
        end: where it ends [m].
        lower: the lower half.
        upper: the upper half.
        supports: of start and end: "clamped", "pinned" or "free".
        is_closed: whether both halves are kept together (the constrained model).
    """

    length: float
    width: float
    start: float
    end: float
    lower: Half
    upper: Half
    supports: tuple[str, str] = ("clamped", "clamped")
    is_closed: bool = False

    def frequencies(self, n: int) -> Array:
        """Return the n lowest natural frequencies, increasing, shape (n,) [Hz]."""
        EI, rhoA = self._bonded
        unit = np.sqrt(EI / rhoA) / self.length**2  # angular frequency of wave number 1/L
        frequencies: list[float] = []
        low, step = 0.3, np.pi / _POINTS_PER_HALF_WAVE
        while len(frequencies) < n:
            waves = low + step * np.arange(400)
            values = [self._determinant(wave**2 * unit) for wave in waves]
            for (a, f), (b, g) in pairwise(zip(waves, values, strict=True)):
                if f * g < 0.0:
                    wave = brentq(lambda w: self._determinant(w**2 * unit), a, b, xtol=1e-14)
                    frequencies.append(wave**2 * unit / (2.0 * np.pi))
            low = float(waves[-1])
        return np.array(frequencies[:n])

    @property
    def _offsets(self) -> tuple[float, float]:
        """Distances of the middle planes of lower and upper half from the neutral axis [m]."""
        (E1, _, h1), (E2, _, h2) = self.lower, self.upper
        between = 0.5 * (h1 + h2)
        share = E2 * h2 / (E1 * h1 + E2 * h2)
        return -share * between, (1.0 - share) * between

    @property
    def _halves(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """EI [N m2] about the own middle plane and ρA [kg/m] of lower and upper half."""
        (E1, rho1, h1), (E2, rho2, h2) = self.lower, self.upper
        b = self.width
        return (E1 * b * h1**3 / 12.0, rho1 * b * h1), (E2 * b * h2**3 / 12.0, rho2 * b * h2)

    @property
    def _parallel_axes(self) -> float:
        """Σ EA_i z_i² [N m2]."""
        (E1, _, h1), (E2, _, h2) = self.lower, self.upper
        z1, z2 = self._offsets
        return self.width * (E1 * h1 * z1**2 + E2 * h2 * z2**2)

    @property
    def _bonded(self) -> tuple[float, float]:
        """EI [N m2] and ρA [kg/m] of the bonded beam."""
        (EI1, m1), (EI2, m2) = self._halves
        return EI1 + EI2 + self._parallel_axes, m1 + m2

    def _determinant(self, omega: float) -> float:
        """Return the determinant of the conditions, up to a positive factor."""
        (EI1, m1), (EI2, m2) = self._halves
        middle = [(EI1 + EI2, m1 + m2)] if self.is_closed else [(EI1, m1), (EI2, m2)]
        a = self.end - self.start
        beams = [
            _Beam(*self._bonded, self.start, omega),
            *(_Beam(EI, m, a, omega) for EI, m in middle),
            _Beam(*self._bonded, self.length - self.end, omega),
        ]
        n = len(beams)

        def row(*terms: tuple[int, float, int, bool]) -> Array:
            """Return Σ factor × derivative of beam i at its start or end."""
            values = np.zeros(4 * n)
            for i, factor, derivative, at_end in terms:
                values[4 * i : 4 * i + 4] += factor * beams[i].basis(derivative, at_end)
            return values

        rows = [row((0, 1.0, d, False)) for d in _HELD[self.supports[0]]]
        rows += [row((n - 1, 1.0, d, True)) for d in _HELD[self.supports[1]]]
        inner = range(1, n - 1)
        tie = self._parallel_axes / a
        for outer, at_end in ((0, False), (n - 1, True)):
            far = not at_end  # the tip at the end of beam 0, at the start of the last beam
            for i in inner:
                for d in (0, 1):
                    rows.append(row((outer, 1.0, d, far), (i, -1.0, d, at_end)))
            for d in (2, 3):
                terms = [(outer, beams[outer].EI, d, far)]
                terms += [(i, -beams[i].EI, d, at_end) for i in inner]
                if d == 2:  # the couple of the axial forces
                    terms += [(1, -tie, 1, True), (1, tie, 1, False)]
                rows.append(row(*terms))
        matrix = np.array(rows)
        matrix /= np.abs(matrix).max(axis=1, keepdims=True)
        matrix /= np.abs(matrix).max(axis=0, keepdims=True)
        return float(np.linalg.det(matrix))


_HELD = {"clamped": (0, 1), "pinned": (0, 2), "free": (2, 3)}
"""Derivatives of w that are zero at a support."""


@dataclass(frozen=True)
class _Beam:
    """A uniform beam that vibrates: EI [N m2], ρA [kg/m], length [m], ω [rad/s]."""

    EI: float
    rhoA: float
    length: float
    omega: float

    def basis(self, derivative: int, at_end: bool) -> Array:
        """Return a derivative of the four solutions at one end of the beam, shape (4,).

        They are cos kx, sin kx and the exponentials that decay from both ends, which are bounded.
        """
        k = float((self.omega**2 * self.rhoA / self.EI) ** 0.25)
        x = self.length if at_end else 0.0
        turn = 0.5 * np.pi * derivative
        from_start, from_end = np.exp(-k * x), np.exp(-k * (self.length - x))
        values = [
            np.cos(k * x + turn),
            np.sin(k * x + turn),
            (-1.0) ** derivative * from_start,
            from_end,
        ]
        return np.asarray(k**derivative * np.array(values))
