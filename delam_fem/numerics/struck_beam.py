"""The exact semi-infinite Euler–Bernoulli beam that is struck at its free end.

It has no length, so that all times follow from κ = sqrt(EI/ρA) [m²/s] and the contact. With the
Laplace transforms F of the contact force and V of the end's velocity, bending moment 0 at the end,

    F = Z sqrt(s) V,   Z = ρA sqrt(κ/2)                                                        (B1)

The beam's answer to a force is thus half an integral of it: neither a mass nor a damper. A clamped
strip answers the same until waves come back from the clamp. Nothing is discretised in space here.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.optimize import minimize_scalar

from delam_fem.numerics.arrays import FloatArray

_LOG_RATES = np.linspace(-40.0, 8.0, 241)
"""Logarithms of the decay rates over which the branch cut is summed: the integrand is below 1e-8
beyond them, and the trapezoidal rule on it converges as exp(-2π²/3h), here to round-off."""
_RESOLVED = 0.125 * np.pi
"""Angle per step up to which a chirp is sampled; it fades until twice that."""
_PEAK_END = (4.0, 8.0)
"""Where the first minimum of the force lies, in units of τ."""


@dataclass(frozen=True)
class StruckBeam:
    """A semi-infinite beam.

    Attributes:
        flexural_rigidity: EI [N m2].
        mass_per_length: ρA [kg/m].
        thickness: twice the distance of the surface from the neutral axis [m].
    """

    flexural_rigidity: float
    mass_per_length: float
    thickness: float

    @property
    def kappa(self) -> float:
        """κ = sqrt(EI/ρA) [m2/s]."""
        return math.sqrt(self.flexural_rigidity / self.mass_per_length)

    @property
    def impedance(self) -> float:
        """Z of B1 [N s^(3/2) / m]."""
        return self.mass_per_length * math.sqrt(0.5 * self.kappa)

    def group_speed(self, frequency: npt.ArrayLike) -> FloatArray:
        """Return the speed of wave groups, c_g = 2 (EI/ρA)^(1/4) ω^(1/2) [m/s].

        Args:
            frequency: any shape [Hz].
        """
        omega = 2.0 * np.pi * np.asarray(frequency, dtype=np.float64)
        return np.asarray(2.0 * np.sqrt(self.kappa * omega))

    # -- the end strikes something rigid ------------------------------------------------------

    def rigid_impulse(self, time: npt.ArrayLike, speed: float) -> FloatArray:
        """Return the impulse given so far by a rigid stop that holds the end, ρA v sqrt(2 κ t / π).

        It begins with no mass at all and grows as the beam joins in; the force v Z / sqrt(π t) has
        no peak value.

        Args:
            time: since the touch [s].
            speed: of the end before [m/s].
        """
        t = np.asarray(time, dtype=np.float64)
        return np.asarray(self.mass_per_length * speed * np.sqrt(2.0 * self.kappa * t / np.pi))

    # -- the end strikes a spring -------------------------------------------------------------

    def contact_time(self, stiffness: float) -> float:
        """Return τ = (Z/k)^(2/3), the time scale of the contact with a spring k [s]."""
        return math.pow(self.impedance / stiffness, 2.0 / 3.0)

    def stiffness_for(self, duration: float) -> float:
        """Return the spring whose force peak lasts as long, from the touch to the minimum [N/m].

        Args:
            duration: [s].
        """
        return self.impedance / math.pow(duration / peak_end(), 1.5)

    def spring_force(self, time: npt.ArrayLike, speed: float, stiffness: float) -> FloatArray:
        """Return the force of a spring that the end strikes, k v τ f(t/τ), `unit_force` [N].

        It never comes back to 0 before a wave does: such an end does not rebound.

        Args:
            time: since the touch, shape (k,) [s].
            speed: of the end before [m/s].
            stiffness: k [N/m].
        """
        tau = self.contact_time(stiffness)
        return stiffness * speed * tau * unit_force(np.asarray(time, dtype=np.float64) / tau)

    def strain(self, force: FloatArray, time_step: float, distance: float) -> FloatArray:
        """Return the bending strain that an end force sends to a place.

            ε(t) = t_h / (κ Z) ∫ F(t - r) g(r) dr,   g = sin(x²/4κr) / sqrt(π r)

        with t_h half the thickness: a chirp whose frequency x²/(8π κ r²) falls, as the dispersion
        relation demands of the waves that arrive at the time r.

        Args:
            force: at equal steps from the touch, shape (k,) [N].
            time_step: [s]; the chirp counts as far as the steps resolve it.
            distance: from the end [m].

        Returns:
            Shape (k,), positive is tension on the side of the force.
        """
        r = time_step * (np.arange(force.size) + 0.5)
        phase = distance**2 / (4.0 * self.kappa * r)
        resolved = np.clip(2.0 - phase / r * time_step / _RESOLVED, 0.0, 1.0)
        chirp = np.sin(0.5 * np.pi * resolved) ** 2 * np.sin(phase) / np.sqrt(np.pi * r)
        scale = 0.5 * self.thickness / (self.kappa * self.impedance) * time_step
        middle = 0.5 * (force + np.concatenate([[0.0], force[:-1]]))
        size = 2 * force.size
        product = np.fft.rfft(middle, size) * np.fft.rfft(chirp, size)
        return np.asarray(scale * np.fft.irfft(product, size)[: force.size])


def unit_force(time: npt.ArrayLike) -> FloatArray:
    """Return f = t E_{3/2,2}(-t^{3/2}), the inverse transform of 1 / (s² + sqrt(s)).

    Two poles, s = exp(±2πi/3), and the branch cut along the negative axis:

        f = 4/3 exp(-t/2) cos(√3 t/2 - 2π/3) + 1/π ∫ exp(-r t) √r / (r⁴ + r) dr

    Args:
        time: in units of τ, shape (k,) [-].

    Source: R. Gorenflo, F. Mainardi, "Fractional calculus", on fractional oscillations.
    """
    t = np.atleast_1d(np.asarray(time, dtype=np.float64))
    poles = 4.0 / 3.0 * np.exp(-0.5 * t) * np.cos(np.sqrt(0.75) * t - 2.0 * np.pi / 3.0)
    r = np.exp(_LOG_RATES)
    weights = r**1.5 / (np.pi * (r**4 + r)) * (_LOG_RATES[1] - _LOG_RATES[0])
    return np.asarray(poles + np.array([float(weights @ np.exp(-r * instant)) for instant in t]))


def peak_end() -> float:
    """Return when the first peak of `unit_force` ends in a minimum, in units of τ [-]."""
    return float(
        minimize_scalar(lambda t: float(unit_force(t)[0]), bounds=_PEAK_END, method="bounded").x
    )
