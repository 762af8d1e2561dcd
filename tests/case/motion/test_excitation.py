"""The motion of the base: exact derivatives, frequencies, joints."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import quad

from delam_fem import HarmonicMotion
from delam_fem.api import SweptMotion, base_motion, preset

A = 0.0025
T = 10.0
STEP = 1e-4
DIFFERENCE = 1e-5
"""Relative error of a central difference: (2 pi 4 Hz STEP)^2/6 = 1e-6, and round-off below."""

MOTIONS = [
    HarmonicMotion(3.25, A),
    SweptMotion(0.5, 4.0, T, A),
    SweptMotion(4.0, 0.5, T, A),
    SweptMotion(0.5, 4.0, T, A, logarithmic=True),
    SweptMotion(4.0, 0.5, T, A, logarithmic=True),
    SweptMotion(2.0, 2.0, T, A, logarithmic=True),
]


OF_ACCELERATION = [
    SweptMotion(0.5, 4.0, T, 0.0, acceleration=2.0),
    SweptMotion(4.0, 0.5, T, 0.0, acceleration=2.0),
    SweptMotion(0.5, 4.0, T, 0.0, logarithmic=True, acceleration=2.0),
    SweptMotion(4.0, 0.5, T, 0.0, logarithmic=True, acceleration=2.0),
]
"""Sweeps whose displacement falls with the square of the frequency."""


@pytest.mark.parametrize("motion", [*MOTIONS, *OF_ACCELERATION], ids=str)
@pytest.mark.parametrize("column", [0, 1])
def test_each_column_is_the_derivative_of_the_one_before(
    motion: HarmonicMotion | SweptMotion, column: int
) -> None:
    t = np.concatenate([np.linspace(0.01, T - 0.01, 199), np.linspace(T + 0.01, T + 0.5, 21)])
    difference = (motion.states(t + STEP) - motion.states(t - STEP))[:, column] / (2 * STEP)
    exact = motion.states(t)[:, column + 1]
    assert difference == pytest.approx(exact, abs=DIFFERENCE * np.abs(exact).max())


@pytest.mark.parametrize("motion", MOTIONS, ids=str)
def test_phase_is_the_integral_of_the_frequency(motion: HarmonicMotion | SweptMotion) -> None:
    for end in (0.7, 6.3, T):
        turns, _ = quad(motion.instantaneous_frequency, 0.0, end, epsabs=1e-12)
        displacement = motion.states(np.array([end]))[0, 0]
        assert displacement == pytest.approx(A * math.sin(2 * math.pi * turns), abs=1e-9 * A)


@pytest.mark.parametrize("motion", OF_ACCELERATION, ids=str)
def test_displacement_of_a_given_acceleration(motion: SweptMotion) -> None:
    for end in (0.7, 6.3, T, T + 0.4):
        turns, _ = quad(motion.instantaneous_frequency, 0.0, end, epsabs=1e-12, points=[T])
        omega = 2.0 * math.pi * float(motion.instantaneous_frequency(end))
        expected = 2.0 / omega**2 * math.sin(2.0 * math.pi * turns)
        assert motion.states(np.array([end]))[0, 0] == pytest.approx(expected, abs=1e-9)


def test_harmonic_motion_is_the_sine() -> None:
    t = np.array([0.0, 0.1])
    w = 2 * math.pi * 3.25
    expected = [
        [0.0, A * w, 0.0],
        [A * f for f in (math.sin(w / 10), w * math.cos(w / 10), -w * w * math.sin(w / 10))],
    ]
    assert HarmonicMotion(3.25, A).states(t) == pytest.approx(np.array(expected), abs=1e-15)


@pytest.mark.parametrize(("logarithmic", "middle"), [(False, 2.25), (True, math.sqrt(2.0))])
def test_frequency_moves_from_start_to_end_and_stays(logarithmic: bool, middle: float) -> None:
    motion = SweptMotion(0.5, 4.0, T, A, logarithmic=logarithmic)
    frequencies = motion.instantaneous_frequency([0.0, T / 2, T, T + 1])
    assert frequencies == pytest.approx([0.5, middle, 4.0, 4.0], rel=1e-14)


@pytest.mark.parametrize("spacing", ["linear", "logarithmic"])
def test_motion_of_a_case(spacing: str) -> None:
    assert base_motion(preset("paper").excitation) == HarmonicMotion(3.25, 0.0025)
    keys = {"kind": "sweep", "start_frequency": 1.0, "end_frequency": 2, "duration": 60.0}
    case = preset("paper", {f"excitation.{k}": v for k, v in {**keys, "spacing": spacing}.items()})
    expected = SweptMotion(1.0, 2.0, 60.0, 0.0025, logarithmic=spacing == "logarithmic")
    assert base_motion(case.excitation) == expected
