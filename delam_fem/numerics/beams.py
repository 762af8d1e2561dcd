"""Exact formulas of Euler–Bernoulli beams, clamped or struck at a free end.

Nothing is discretised here.

The cantilever: wave numbers, modes, response to base motion. B is the dimensionless wave number,
B^4 = rho A omega^2 L^4 / (E I), and xi = x/L runs from the clamp (0) to the free end (1).

Source: any textbook of vibrations; e.g. Meirovitch, "Fundamentals of Vibrations", section 8.

The beam that is struck at its end (`StruckBeam`) has no length: all times follow from
κ = sqrt(EI/ρA) [m²/s] and the contact. Let F and V be the Laplace transforms of the contact force
and of the velocity of the end. Without bending moment at the end,

    F = Z sqrt(s) V,   Z = ρA sqrt(κ/2)                                                        (B1)

The velocity of the end is thus a half-order integral of the force: the beam acts neither as a mass
nor as a damper. A clamped strip responds in the same way until waves return from the clamp.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
import numpy.typing as npt
import scipy  # loads its parts when they are used

from delam_fem.numerics.types import FloatArray

ComplexArray = npt.NDArray[np.complex128]
_Number = TypeVar("_Number", np.float64, np.complex128)

_NEWTON_STEPS = 8
"""Number of Newton steps from (k - 1/2) pi. Convergence is quadratic: root 1 reaches round-off
after five steps, higher roots earlier."""
_POINTS = 2001
"""Number of points for integrals over a mode; they give six digits."""


def cantilever_roots(n: int) -> FloatArray:
    """Return the first n roots of 1 + cos B cosh B = 0.

    The function solves cos B + sech B = 0, which does not grow with B.

    >>> cantilever_roots(3).round(4).tolist()
    [1.8751, 4.6941, 7.8548]

    Args:
        n: number of roots, at least 1.

    Returns:
        Increasing roots B_1 … B_n, shape (n,) [-]; B_1 = 1.8751.

    Raises:
        ValueError: n is below 1.
    """
    if n < 1:
        raise ValueError(f"number of cantilever modes: expected at least 1, given {n}")
    B = (np.arange(1, n + 1) - 0.5) * np.pi
    for _ in range(_NEWTON_STEPS):
        sech = _sech(B)
        B = B + (np.cos(B) + sech) / (np.sin(B) + sech * np.tanh(B))
    return B


def cantilever_mode(k: int, xi: npt.ArrayLike) -> FloatArray:
    """Return the k-th mode shape, scaled to 1 at the free end.

    The textbook form cosh z - cos z - s (sinh z - sin z), z = B xi, loses all digits near k = 12.
    This function writes the growing part as (1 - s) e^z with 1 - s in closed form, so that no large
    numbers cancel.

    Args:
        k: number of the mode; 1 is the lowest.
        xi: positions x/L in [0, 1], any shape [-].

    Returns:
        Mode shape w(xi), same shape as xi, w(1) = 1 [-].

    Raises:
        ValueError: k is below 1, or a position lies outside [0, 1].
    """
    xi = np.asarray(xi, dtype=np.float64)
    if not np.all((xi >= 0.0) & (xi <= 1.0)):
        raise ValueError("cantilever mode: positions xi = x/L must lie in [0, 1]")
    B = cantilever_roots(k)[-1]
    decay = np.exp(-B)
    # s = (sinh B - sin B) / (cosh B + cos B);  one_minus_s = (1 - s) e^B
    one_minus_s = 2.0 * (decay + np.cos(B) + np.sin(B)) / (1.0 + decay**2 + 2.0 * decay * np.cos(B))
    s = 1.0 - one_minus_s * decay
    z = B * xi
    growing = 0.5 * one_minus_s * np.exp(z - B)
    decaying = 0.5 * (1.0 + s) * np.exp(-z)
    shape: FloatArray = growing + decaying - np.cos(z) + s * np.sin(z)
    return shape * (0.5 if k % 2 else -0.5)  # the textbook form ends at 2 (-1)^(k+1)


def frequency_rise(amplitude: float) -> float:
    """Return the relative rise of the lowest frequency at a large amplitude, ω/ω_1 - 1.

    An inextensible cantilever that moves in its first mode, w = q(t) φ(x), has the energies

        T = 1/2 m (1 + a q²) q'²,   a = ∫ (∫_0^x φ'²)² dx / ∫ φ² dx
        V = 1/2 k (1 + b q²) q²,    b = ∫ φ''² φ'² dx / ∫ φ''² dx

    The term with a slows the motion down, the term with b speeds it up. The period follows from T +
    V = const., with q = Q sin θ:

        ω_1/ω = 1/(2π) ∫_0^2π sqrt((1 + a q²) / (1 + b (Q² + q²))) dθ

    Args:
        amplitude: amplitude of the tip over the length, Q/L [-].

    Source: M. Crespo da Silva, C. Glynn, "Nonlinear flexural-flexural-torsional dynamics of
    inextensional beams I", J. Struct. Mech. 6 (1978), for the kinetic and strain energy.
    """
    # imported here: every case imports this module, and scipy.integrate would double the time
    from scipy.integrate import cumulative_trapezoid, trapezoid

    x = np.linspace(0.0, 1.0, _POINTS)
    mode = cantilever_mode(1, x)
    slope = np.gradient(mode, x, edge_order=2)
    curvature = np.gradient(slope, x, edge_order=2)
    shortening = cumulative_trapezoid(slope**2, x, initial=0.0)
    a = trapezoid(shortening**2, x) / trapezoid(mode**2, x)
    b = trapezoid((curvature * slope) ** 2, x) / trapezoid(curvature**2, x)
    q = amplitude * np.sin(2.0 * np.pi * x[:-1])
    ratio = np.sqrt((1.0 + a * q**2) / (1.0 + b * (amplitude**2 + q**2))).mean()
    return float(1.0 / ratio) - 1.0


def transmissibility(
    omega: npt.ArrayLike,
    *,
    length: float,
    flexural_rigidity: float,
    mass_per_length: float,
    rayleigh: tuple[float, float] = (0.0, 0.0),
) -> ComplexArray:
    """Return the ratio of tip motion to clamp motion, both in the fixed frame.

        H = (cos B + cosh B) / (1 + cos B cosh B),
        EI (1 + i omega beta) B^4 = rho A (omega^2 - i omega alpha) L^4

    H is exact for Rayleigh damping C = alpha M + beta K, and real without damping.

    Args:
        omega: angular frequencies of the clamp, any shape [rad/s].
        length: L [m].
        flexural_rigidity: EI [N m2].
        mass_per_length: rho A [kg/m].
        rayleigh: (alpha [1/s], beta [s]).

    Returns:
        H(omega), complex, shape of omega [-].
    """
    omega = np.asarray(omega, dtype=np.float64)
    alpha, beta = rayleigh
    inertia = mass_per_length * (omega**2 - 1j * omega * alpha) * length**4
    B = (inertia / (flexural_rigidity * (1.0 + 1j * omega * beta))) ** 0.25
    sech = _sech(B)
    H: ComplexArray = (1.0 + np.cos(B) * sech) / (sech + np.cos(B))
    return H


def _sech(z: npt.NDArray[_Number]) -> npt.NDArray[_Number]:
    """Return 1/cosh z without overflow for Re z >= 0."""
    decay: npt.NDArray[_Number] = np.exp(-z)
    sech: npt.NDArray[_Number] = 2.0 * decay / (1.0 + decay * decay)
    return sech


_LOG_RATES = np.linspace(-40.0, 8.0, 241)
"""Logarithms of the decay rates for the integral along the branch cut. Outside this range the
integrand is below 1e-8; the trapezoidal rule converges as exp(-2π²/3h), here to round-off."""
_RESOLVED = 0.125 * np.pi
"""Largest angle per step at which the chirp counts fully; it fades to 0 at twice this angle."""
_PEAK_END = (4.0, 8.0)
"""Interval that contains the first minimum of the force, in units of τ."""


@dataclass(frozen=True)
class StruckBeam:
    """A semi-infinite beam with a free end.

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
            frequency: frequencies of the waves, any shape [Hz].
        """
        omega = 2.0 * np.pi * np.asarray(frequency, dtype=np.float64)
        return np.asarray(2.0 * np.sqrt(self.kappa * omega))

    def timoshenko_group_speed(
        self, frequency: npt.ArrayLike, *, shear_factor: float = 5.0 / 6.0, poisson: float = 0.3
    ) -> FloatArray:
        """Return the speed of wave groups with shear and rotary inertia [m/s].

        With r² = h²/12, s² = EI/(k_s G A) = 2 (1 + ν) r²/k_s and a = EI/ρA, the bending waves have

            2 a k² = (s² + r²) ω² + sqrt((s² - r²)² ω⁴ + 4 a ω²)

        and c_g = dω/dk. For low frequencies this is `group_speed`, for high ones sqrt(k_s G/ρ). The
        other formulas of this class leave shear and rotary inertia out.

        Args:
            frequency: frequencies of the waves, any shape, above 0 [Hz].
            shear_factor: k_s of a rectangular section [-].
            poisson: ν of an isotropic material [-].

        Source: S. Timoshenko, Phil. Mag. 41 (1921) 744–746.
        """
        omega = 2.0 * np.pi * np.asarray(frequency, dtype=np.float64)
        a = self.kappa**2
        r2 = self.thickness**2 / 12.0
        s2 = 2.0 * (1.0 + poisson) / shear_factor * r2
        root = np.sqrt((s2 - r2) ** 2 * omega**4 + 4.0 * a * omega**2)
        k = np.sqrt(((s2 + r2) * omega**2 + root) / (2.0 * a))
        slope = (s2 + r2) * omega + ((s2 - r2) ** 2 * omega**3 + 2.0 * a * omega) / root
        return np.asarray(2.0 * a * k / slope)

    # -- the end strikes something rigid ------------------------------------------------------

    def rigid_impulse(self, time: npt.ArrayLike, speed: float) -> FloatArray:
        """Return the impulse of a rigid stop on the end up to a time, ρA v sqrt(2 κ t / π) [N s].

        The impulse starts at 0 and grows as more of the beam is stopped. The force v Z / sqrt(π t)
        has no finite peak.

        Args:
            time: time since the first touch, any shape [s].
            speed: speed of the end before the touch [m/s].
        """
        t = np.asarray(time, dtype=np.float64)
        return np.asarray(self.mass_per_length * speed * np.sqrt(2.0 * self.kappa * t / np.pi))

    # -- the end strikes a spring -------------------------------------------------------------

    def contact_time(self, stiffness: float) -> float:
        """Return τ = (Z/k)^(2/3), the time scale of the contact with a spring k [s]."""
        return math.pow(self.impedance / stiffness, 2.0 / 3.0)

    def stiffness_for(self, duration: float) -> float:
        """Return the stiffness of the spring whose first force peak has a given duration [N/m].

        Args:
            duration: time from the first touch to the first minimum of the force [s].
        """
        return self.impedance / math.pow(duration / peak_end(), 1.5)

    def spring_force(self, time: npt.ArrayLike, speed: float, stiffness: float) -> FloatArray:
        """Return the force of a spring that the end strikes, k v τ f(t/τ), f = `unit_force` [N].

        The force does not return to 0 until a reflected wave arrives: the end does not rebound.

        Args:
            time: time since the first touch, shape (k,) [s].
            speed: speed of the end before the touch [m/s].
            stiffness: k [N/m].
        """
        tau = self.contact_time(stiffness)
        return stiffness * speed * tau * unit_force(np.asarray(time, dtype=np.float64) / tau)

    def strain(self, force: FloatArray, time_step: float, distance: float) -> FloatArray:
        """Return the bending strain at a place on the beam due to a force on its end.

            ε(t) = t_h / (κ Z) ∫ F(t - r) g(r) dr,   g = sin(x²/4κr) / sqrt(π r)

        Here t_h is half the thickness. The kernel g is a chirp with the falling frequency
        x²/(8π κ r²), which the dispersion relation gives for waves that arrive at the time r.

        Args:
            force: force on the end at equal steps from the first touch, shape (k,) [N].
            time_step: step [s]; only the part of the chirp that the steps resolve counts.
            distance: distance of the place from the end [m].

        Returns:
            Strain, shape (k,) [-]; positive is tension on the side of the force.
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

    The two poles s = exp(±2πi/3) and the branch cut along the negative axis give

        f = 4/3 exp(-t/2) cos(√3 t/2 - 2π/3) + 1/π ∫ exp(-r t) √r / (r⁴ + r) dr

    Args:
        time: times in units of τ, shape (k,) [-].

    Source: R. Gorenflo, F. Mainardi, "Fractional calculus", on fractional oscillations.
    """
    t = np.atleast_1d(np.asarray(time, dtype=np.float64))
    poles = 4.0 / 3.0 * np.exp(-0.5 * t) * np.cos(np.sqrt(0.75) * t - 2.0 * np.pi / 3.0)
    r = np.exp(_LOG_RATES)
    weights = r**1.5 / (np.pi * (r**4 + r)) * (_LOG_RATES[1] - _LOG_RATES[0])
    return np.asarray(poles + np.array([float(weights @ np.exp(-r * instant)) for instant in t]))


def peak_end() -> float:
    """Return the time of the first minimum of `unit_force`, in units of τ [-]."""
    return float(
        scipy.optimize.minimize_scalar(
            lambda t: float(unit_force(t)[0]), bounds=_PEAK_END, method="bounded"
        ).x
    )
