"""Exact formulas of the Euler-Bernoulli cantilever: wave numbers, modes, response to base motion.

Nothing is discretised here. B is the dimensionless wave number,
B^4 = rho A omega^2 L^4 / (E I), and xi = x/L runs from the clamp (0) to the free end (1).

Source: any textbook of vibrations; e.g. Meirovitch, "Fundamentals of Vibrations", section 8.
"""

from __future__ import annotations

from typing import TypeVar

import numpy as np
import numpy.typing as npt

from delam_fem.numerics.arrays import FloatArray

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
