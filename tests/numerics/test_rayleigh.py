"""Rayleigh coefficients give the modes that their kind names the damping ratio."""

import pytest

from delam_fem.numerics.harmonics import Kind, coefficients, overdamped_from

D, OMEGA = 0.008, (19.9, 124.6)
ROUND_OFF = 1e-14


@pytest.mark.parametrize(
    ("kind", "damped"), [("two-mode", OMEGA), ("stiffness", OMEGA[:1]), ("mass", OMEGA[:1])]
)
def test_named_modes_have_the_ratio(kind: Kind, damped: tuple[float, ...]) -> None:
    alpha, beta = coefficients(D, *OMEGA, kind)
    for omega in damped:
        assert 0.5 * (alpha / omega + beta * omega) == pytest.approx(D, rel=ROUND_OFF)
    assert (alpha > 0.0, beta > 0.0) == (kind != "stiffness", kind != "mass")


def test_two_modes_are_the_default() -> None:
    assert coefficients(D, *OMEGA) == coefficients(D, *OMEGA, "two-mode")


@pytest.mark.parametrize("kind", ["two-mode", "stiffness"])
def test_the_last_mode_that_oscillates(kind: Kind) -> None:
    alpha, beta = coefficients(D, *OMEGA, kind)
    last = overdamped_from(alpha, beta)
    assert 0.5 * (alpha / last + beta * last) == pytest.approx(1.0, rel=1e-12)
    assert 0.5 * (alpha / (1.01 * last) + beta * 1.01 * last) > 1.0


def test_modes_that_are_never_or_always_overdamped() -> None:
    assert overdamped_from(0.3, 0.0) == float("inf")
    assert overdamped_from(3.0, 0.5) == 0.0
