"""The slowest decay of a structure beside that of exact cantilevers and of single masses."""

import dataclasses

import numpy as np
import pytest
import scipy.sparse as sp

import delam_fem as df
from delam_fem.api import BaseCoupling, Operators, assemble, at_start, response
from delam_fem.model.linear import slowest_decay

DISCRETE = 1e-3
"""Ten cubic elements: the lowest frequencies are within 1e-4 of the exact ones."""


@pytest.mark.parametrize("kind", ["two-mode", "stiffness", "mass"])
def test_the_slowest_mode_of_two_laminae_is_the_lowest_of_the_thin_one(kind: str) -> None:
    case = df.preset("paper", {"damping.rayleigh": kind, "mesh.elements": 10})
    omega = case.lamina[1].angular_frequencies(1)[0]
    decay = slowest_decay(assemble(case, needs_dolfinx=False).operators)
    assert decay == pytest.approx(0.008 * omega, rel=DISCRETE)


def test_the_less_damped_lamina_decides() -> None:
    keys = {"lamina.thick.damping_ratio": 0.001, "mesh.elements": 10}
    case = df.preset("paper", keys)
    omega = case.lamina[0].angular_frequencies(1)[0]
    decay = slowest_decay(assemble(case, needs_dolfinx=False).operators)
    assert decay == pytest.approx(0.001 * omega, rel=DISCRETE)


@pytest.mark.parametrize("kind", ["two-mode", "mass"])
def test_contact_points_without_mass_decide_nothing(kind: str) -> None:
    keys = {"damping.rayleigh": kind, "mesh.elements": 4, "time.mass": "massless"}
    case = df.preset("default", keys | {"contact.law": "newton", "contact.restitution": 0.0})
    omega = case.lamina[1].angular_frequencies(1)[0]
    decay = slowest_decay(assemble(case, needs_dolfinx=False).operators)
    assert decay == pytest.approx(0.008 * omega, rel=0.02)  # 7 of 16 motions have no mass


def masses(damping: list[float], stiffness: list[float]) -> Operators:
    """Return unit masses that do not know one another."""
    n = len(damping)
    return Operators(
        sp.identity(n, format="csr"),
        sp.csr_matrix(np.diag(damping)),
        sp.csr_matrix(np.diag(stiffness)),
        BaseCoupling.none(n),
        sp.csr_matrix((0, n)),
        np.zeros(0),
    )


def test_nothing_is_left_to_decay_where_nothing_has_mass() -> None:
    light = dataclasses.replace(masses([1.0], [1.0]), mass=sp.csr_matrix((1, 1)))
    assert slowest_decay(light) == np.inf


@pytest.mark.parametrize(
    ("damping", "stiffness", "expected"),
    [
        ([0.2, 0.6], [4.0, 9.0], 0.1),  # s = c/2
        ([5.0, 0.6], [4.0, 9.0], 0.3),
        ([10.0, 8.0], [16.0, 9.0], 4.0 - 7.0**0.5),  # s - sqrt(s^2 - omega^2), 2 and 1.35
        ([0.0, 1.0], [4.0, 9.0], 0.0),
    ],
)
def test_masses(damping: list[float], stiffness: list[float], expected: float) -> None:
    assert slowest_decay(masses(damping, stiffness)) == pytest.approx(expected, abs=1e-12)


def test_a_mass_that_nothing_holds_never_stops() -> None:
    decay = slowest_decay(masses([0.0, 0.5, 0.5], [0.0, 4.0, 9.0]), is_floating=True)
    assert decay == pytest.approx(0.0, abs=1e-7)


@pytest.mark.parametrize("frequency", [0.1, 0.5])  # below and above the resonance at 0.32 Hz
def test_the_steady_response_is_that_of_a_mass_on_a_moving_foot(frequency: float) -> None:
    o = masses([0.3], [4.0])
    foot = BaseCoupling(np.zeros(1), np.array([-0.3]), np.array([-4.0]), np.zeros(3))
    w = 2.0 * np.pi * frequency
    U = response(dataclasses.replace(o, base=foot), frequency)
    exact = (4.0 + 0.3j * w) / (4.0 + 0.3j * w - w**2)  # mass, spring and damper, by hand
    assert U == pytest.approx([exact], rel=1e-12)
    t = np.array([-1e-4, 0.0, 1e-4])
    u = np.imag(exact * np.exp(1j * w * t))
    expected = [u[1], (u[2] - u[0]) / 2e-4, (u[2] - 2.0 * u[1] + u[0]) / 1e-8]
    np.testing.assert_allclose(at_start(U, frequency)[:, 0], expected, rtol=1e-6, atol=1e-7)


def test_the_kept_motions_alone_respond() -> None:
    o = masses([0.1, 0.1], [1.0, 3.0])
    pushed = dataclasses.replace(
        o, base=BaseCoupling(np.zeros(2), np.zeros(2), np.array([1.0, 0.0]), np.zeros(3))
    )
    together = sp.csr_matrix(np.ones((2, 1)))  # as one mass 2 on 4 N/m, 0.2 N s/m
    w = 2.0 * np.pi * 0.4
    amplitudes = response(pushed, 0.4, together)
    assert amplitudes == pytest.approx(2 * [-1.0 / (4.0 + 0.2j * w - 2.0 * w**2)], rel=1e-12)
