"""The exact struck beam: its force, impulse and strain against their Laplace transforms."""

import numpy as np
import pytest
from scipy.integrate import trapezoid
from scipy.optimize import brentq
from scipy.special import gamma

from delam_fem.api import beams
from delam_fem.numerics.beams import StruckBeam

QUADRATURE = 1e-4
"""Of a Laplace integral by the trapezoidal rule over 1e4 points."""
CUT = 2e-9
"""Absolute error of `unit_force`, whose branch cut ends at a finite rate. Measured: 1.4e-9."""
STRIP = StruckBeam(flexural_rigidity=18.9, mass_per_length=0.942, thickness=0.003)
"""A steel strip of 40 mm by 3 mm."""


@pytest.mark.parametrize("s", [0.5, 1.0, 3.0])
def test_unit_force_has_its_transform(s: float) -> None:
    t = np.linspace(0.0, 40.0 / s, 10_001)
    integral = trapezoid(np.exp(-s * t) * beams.unit_force(t), t)
    assert integral == pytest.approx(1.0 / (s**2 + np.sqrt(s)), rel=QUADRATURE)


def test_unit_force_begins_as_a_spring_and_ends_as_a_beam() -> None:
    early, late = np.array([1e-3]), np.array([300.0])
    assert beams.unit_force(early) == pytest.approx(early, rel=1e-3)
    assert beams.unit_force(late) == pytest.approx(1.0 / np.sqrt(np.pi * late), rel=1e-3)


def test_peak_ends_in_a_minimum_above_zero() -> None:
    end = beams.peak_end()
    before, at, after = beams.unit_force([0.99 * end, end, 1.01 * end])
    assert 0.0 < at < min(before, after)


def test_stiffness_and_duration_belong_together() -> None:
    beam = STRIP
    stiffness = beam.stiffness_for(30e-6)
    assert beam.contact_time(stiffness) * beams.peak_end() == pytest.approx(30e-6)
    assert beam.contact_time(8.0 * stiffness) == pytest.approx(beam.contact_time(stiffness) / 4.0)


def test_a_stiff_spring_gives_the_impulse_of_a_rigid_stop() -> None:
    beam = STRIP
    t = np.linspace(0.0, 30e-6, 20_001)
    impulse = trapezoid(beam.spring_force(t, 6.0, 1e12), t)
    assert impulse == pytest.approx(beam.rigid_impulse(30e-6, 6.0), rel=0.005)


def test_shear_and_rotary_inertia_slow_groups_down() -> None:
    """The speed is dω/dk of the determinant of the Timoshenko beam; both ends are known."""
    r2 = STRIP.thickness**2 / 12.0
    kG = STRIP.flexural_rigidity / (2.6 / (5.0 / 6.0) * r2)  # κGA [N]

    def determinant(omega: float, k: float) -> float:
        m, EI = STRIP.mass_per_length, STRIP.flexural_rigidity
        bending = EI * k**2 - m * r2 * omega**2 + kG
        return bending * (kG * k**2 - m * omega**2) - (kG * k) ** 2

    omega = 2.0 * np.pi * 25e3
    k = brentq(lambda k: determinant(omega, k), 1e2, 1e3)
    rise = 1e-4 * omega
    near = [
        brentq(lambda k, w=w: determinant(w, k), 1e2, 1e3) for w in (omega - rise, omega + rise)
    ]
    assert near[0] < k < near[1]
    assert STRIP.timoshenko_group_speed(25e3) == pytest.approx(
        2.0 * rise / (near[1] - near[0]), rel=1e-6
    )
    assert STRIP.timoshenko_group_speed(1.0) == pytest.approx(STRIP.group_speed(1.0), rel=1e-5)
    fastest = np.sqrt(kG / STRIP.mass_per_length)
    assert STRIP.timoshenko_group_speed(1e9) == pytest.approx(fastest, rel=1e-5)


def test_strain_has_its_transform() -> None:
    beam, x, k = STRIP, 0.1, 1e8
    dt = 2e-7
    t = dt * np.arange(40_000)
    strain = beam.strain(beam.spring_force(t, 1.0, k), dt, x)
    s = 2e3  # far from the window's end, exp(-16)
    root = np.sqrt(s / (2.0 * beam.kappa))
    force = k / (np.sqrt(s) * (s**1.5 + k / beam.impedance))
    curvature = force * np.exp(-root * x) * np.sin(root * x)
    curvature /= beam.kappa * beam.impedance * np.sqrt(s)
    transform = trapezoid(np.exp(-s * t) * strain, t)
    assert transform == pytest.approx(0.5 * beam.thickness * curvature, rel=2e-3)


def test_strain_of_an_impulse_is_the_resolved_part_of_the_chirp() -> None:
    """A force of 1 N at one sample acts over half of two steps, as the trapezoidal rule has it.

    The chirp turns by x²/(4 κ r²) Δt in a step: all of it counts up to π/8, half of its sin² ramp
    is left at 3π/16, and nothing from π/4 on.
    """
    beam, x, dt, n = STRIP, 0.15, 1e-6, 400
    force = np.zeros(n)
    force[0] = 1.0
    strain = beam.strain(force, dt, x)
    scale = 0.5 * beam.thickness / (beam.kappa * beam.impedance) * dt
    halves = 2.0 * strain / scale  # of the kernel at two neighbouring steps, added
    kernel = np.array([sum(halves[k::-1] * (-1.0) ** np.arange(k + 1)) for k in range(n)])
    r = dt * (np.arange(n) + 0.5)
    phase = x**2 / (4.0 * beam.kappa * r)
    chirp = np.sin(phase) / np.sqrt(np.pi * r)
    turn = phase / r * dt / (np.pi / 8.0)
    scatter = 1e-10 * np.abs(chirp).max()
    assert kernel[turn < 1.0] == pytest.approx(chirp[turn < 1.0], abs=scatter)
    assert np.abs(kernel[turn > 2.0]).max() < scatter
    ramp = (turn > 1.0) & (turn < 2.0)
    assert 10 < ramp.sum() < (turn > 2.0).sum() < (turn < 1.0).sum()
    expected = 0.5 * (1.0 + np.cos(np.pi * (turn - 1.0))) * chirp
    assert kernel[ramp] == pytest.approx(expected[ramp], abs=scatter)


def test_strain_adds_up_and_is_not_periodic() -> None:
    """Any force is a sum of samples; what it does late never comes back early."""
    force = np.random.default_rng(3).normal(size=60)
    unit = STRIP.strain(np.eye(60)[0], 1e-6, 0.02)
    expected = np.convolve(force, unit)[:60]
    assert STRIP.strain(force, 1e-6, 0.02) == pytest.approx(
        expected, abs=1e-12 * np.abs(expected).max()
    )


def test_properties_of_the_strip_by_hand() -> None:
    beam = StruckBeam(flexural_rigidity=8.0, mass_per_length=0.5, thickness=0.01)
    assert beam.kappa == 4.0
    assert beam.impedance == pytest.approx(0.5 * np.sqrt(2.0))
    # c_g = dω/dk with ω = κ k²: 2 κ k
    omega = 2.0 * np.pi * 10.0
    assert beam.group_speed(10.0) == pytest.approx(2.0 * 4.0 * np.sqrt(omega / 4.0))
    assert beam.rigid_impulse(0.25, 3.0) == pytest.approx(0.5 * 3.0 * np.sqrt(2.0 / np.pi))
    assert beam.contact_time(beam.impedance / 8.0) == pytest.approx(4.0)  # 8^(2/3)


def test_force_of_a_spring_is_scaled_by_its_own_time() -> None:
    beam, k = STRIP, 3e7
    tau = beam.contact_time(k)
    t = np.array([0.3, 1.0, 4.0]) * tau
    expected = k * 2.0 * tau * beams.unit_force([0.3, 1.0, 4.0])
    assert beam.spring_force(t, 2.0, k) == pytest.approx(expected, rel=1e-12)


def test_unit_force_by_its_series() -> None:
    """t E_{3/2,2}(-t^{3/2}) = Σ (-1)^j t^(1 + 3j/2) / Γ(2 + 3j/2)."""
    t = np.array([0.01, 0.1, 0.7, 2.0, 5.0])
    j = np.arange(60)
    terms = (-1.0) ** j * t[:, None] ** (1.0 + 1.5 * j) / gamma(2.0 + 1.5 * j)
    assert beams.unit_force(t) == pytest.approx(terms.sum(axis=1), abs=CUT)
