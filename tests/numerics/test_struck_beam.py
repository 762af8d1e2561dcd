"""The exact struck beam: its force, impulse and strain against their Laplace transforms."""

import numpy as np
import pytest
from scipy.integrate import trapezoid

from delam_fem.numerics import struck_beam
from delam_fem.numerics.struck_beam import StruckBeam

QUADRATURE = 1e-4
"""Of a Laplace integral by the trapezoidal rule over 1e4 points."""
STRIP = StruckBeam(flexural_rigidity=18.9, mass_per_length=0.942, thickness=0.003)
"""A steel strip of 40 mm by 3 mm."""


@pytest.mark.parametrize("s", [0.5, 1.0, 3.0])
def test_unit_force_has_its_transform(s: float) -> None:
    t = np.linspace(0.0, 40.0 / s, 10_001)
    integral = trapezoid(np.exp(-s * t) * struck_beam.unit_force(t), t)
    assert integral == pytest.approx(1.0 / (s**2 + np.sqrt(s)), rel=QUADRATURE)


def test_unit_force_begins_as_a_spring_and_ends_as_a_beam() -> None:
    early, late = np.array([1e-3]), np.array([300.0])
    assert struck_beam.unit_force(early) == pytest.approx(early, rel=1e-3)
    assert struck_beam.unit_force(late) == pytest.approx(1.0 / np.sqrt(np.pi * late), rel=1e-3)


def test_peak_ends_in_a_minimum_above_zero() -> None:
    end = struck_beam.peak_end()
    before, at, after = struck_beam.unit_force([0.99 * end, end, 1.01 * end])
    assert 0.0 < at < min(before, after)


def test_stiffness_and_duration_belong_together() -> None:
    beam = STRIP
    stiffness = beam.stiffness_for(30e-6)
    assert beam.contact_time(stiffness) * struck_beam.peak_end() == pytest.approx(30e-6)
    assert beam.contact_time(8.0 * stiffness) == pytest.approx(beam.contact_time(stiffness) / 4.0)


def test_a_stiff_spring_gives_the_impulse_of_a_rigid_stop() -> None:
    beam = STRIP
    t = np.linspace(0.0, 30e-6, 20_001)
    given = trapezoid(beam.spring_force(t, 6.0, 1e12), t)
    assert given == pytest.approx(beam.rigid_impulse(30e-6, 6.0), rel=0.005)


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
    found = trapezoid(np.exp(-s * t) * strain, t)
    assert found == pytest.approx(0.5 * beam.thickness * curvature, rel=2e-3)
