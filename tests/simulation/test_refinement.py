"""How steps divide, and how the base moves within a step."""

from typing import Any

import numpy as np
import pytest
from support import compiled

import delam_fem as df
from delam_fem.api import CaseError, Span
from delam_fem.simulation import refinement
from delam_fem.simulation.refinement import (
    AHEAD,
    BACK,
    NOT_REFINED,
    Refinement,
    base_rows,
    nearness,
    unforeseen_warning,
)

base_within = compiled(refinement.base_within)


@pytest.mark.parametrize(
    ("factor", "divisions"),
    [(1, (1,)), (2, (1, 2)), (7, (1, 7)), (12, (1, 3, 12)), (64, (1, 8, 64)), (256, (1, 16, 256))],
)
def test_steps_divide_into_middle_and_fine_steps(factor: int, divisions: tuple[int, ...]) -> None:
    assert Refinement(factor).divisions == divisions
    assert factor % Refinement(factor).middle == 0


@pytest.mark.parametrize("share", [0.0, 0.3, 0.5, 1.0])
def test_cubic_motions_are_exact(share: float) -> None:
    p = np.polynomial.Polynomial([0.3, -1.0, 2.0, 0.7])
    dt, start = 0.5, 0.2

    def state(t: float) -> tuple[float, float, float]:
        return float(p(t)), float(p.deriv()(t)), float(p.deriv(2)(t))

    base_state = base_within(state(start), state(start + dt), share, dt)
    np.testing.assert_allclose(base_state, state(start + share * dt), rtol=1e-12)


@pytest.mark.parametrize("n_steps", [100, 1000])
def test_errors_of_a_harmonic_motion_are_those_of_its_degree(n_steps: int) -> None:
    omega, angle = 20.0, 2.0 * np.pi / n_steps
    dt, worst = angle / omega, np.zeros(3)

    def state(t: float) -> tuple[float, float, float]:
        sine, cosine = np.sin(omega * t), np.cos(omega * t)
        return float(sine), float(omega * cosine), float(-(omega**2) * sine)

    for start in np.linspace(0.0, 2.0 * np.pi / omega, 40):
        base_state = base_within(state(start), state(start + dt), 0.5, dt)
        exact = np.array(state(start + 0.5 * dt))
        worst = np.maximum(worst, np.abs((base_state - exact) / (1.0, omega, omega**2)))
    cubic, linear = angle**4 / 384.0, angle**2 / 8.0
    np.testing.assert_allclose(worst, [cubic, cubic, linear], rtol=0.01, atol=1e-13)


def test_a_load_that_is_constant_stays_constant() -> None:
    """Gravity is given as q'' alone."""
    assert base_within((0.0, 0.0, 9.81), (0.0, 0.0, 9.81), 0.3, 1e-3)[2] == pytest.approx(9.81)


def test_unforeseen_contacts_warn_from_a_share_on() -> None:
    assert unforeseen_warning(np.array([[10, 0], [10, 1]])) is None
    assert unforeseen_warning(np.zeros((3, 2), dtype=np.int64)) is None
    text = unforeseen_warning(np.array([[10, 1], [10, 1]]))
    assert text is not None
    assert text.startswith("2 of 20 contacts in refined steps were unforeseen")


def test_rows_within_a_step_are_those_of_its_parts() -> None:
    before, after, parts, dt = (0.1, -2.0, 5.0), (0.3, 4.0, -7.0), 8, 0.05
    rows = base_rows(before, after, parts, dt)
    assert rows[0].tolist() == list(before) and rows[-1].tolist() == list(after)
    for j in range(1, parts):
        assert rows[j].tolist() == list(base_within(before, after, j / parts, dt))


@pytest.mark.parametrize(
    ("gap", "rate", "reach", "near"),
    [
        (1.0, -3.0, 0.5, AHEAD),  # closes within the time ahead
        (1.0, -3.0, 0.3, 0),
        (1.0, 3.0, 0.5, BACK),  # was closed before
        (1.0, 3.0, 0.3, 0),
        (-1.0, 2.0, 0.1, 0),  # closed, but slow
        (0.0, 2.5, 0.1, AHEAD + BACK),  # touches
        (-0.1, -2.5, 0.1, AHEAD + BACK),
    ],
)
def test_a_fast_pair_is_near_that_may_close(
    gap: float, rate: float, reach: float, near: int
) -> None:
    slow = 2.0
    assert nearness(np.array([9.0, gap]), np.array([0.0, rate]), reach, slow) == near


def test_one_pair_may_close_ahead_and_another_back() -> None:
    gap, rate = np.array([1.0, 9.0, 1.0]), np.array([3.0, 0.0, -3.0])
    assert nearness(gap, rate, 0.5, 2.0) == AHEAD + BACK


@pytest.mark.parametrize("engine", ["compiled", "petsc"])
def test_the_safety_tells_how_many_steps_are_divided(engine: Any) -> None:
    """With the safety 1 it is 413 steps, with 3 it is 491."""
    keys = {"time.periods": 2, "time.steps_per_period": 100, "time.refine": 16,
            "contact.restitution": 0.0, "excitation.amplitude": 0.01}  # fmt: skip
    assert df.run(df.preset("default", keys), engine).summary["steps"] == 431


def test_what_a_warning_says_of_contacts() -> None:
    assert unforeseen_warning(np.array([[20, 1]])) is None  # 5 %
    assert unforeseen_warning(np.array([[19, 1]])) == (
        "1 of 19 contacts in refined steps were unforeseen, so others may have been missed between "
        "coarse steps; try more time.steps_per_period and a smaller time.refine"
    )


def test_limits_of_nearness_are_met() -> None:
    one = np.array([1.0])
    assert nearness(one, np.array([-2.5]), 0.4, 2.0) == AHEAD  # the way is the gap
    assert nearness(one, np.array([2.5]), 0.4, 2.0) == BACK
    assert nearness(one, np.array([2.5]), np.nextafter(0.4, 0.0), 2.0) == 0
    assert nearness(0.1 * one, np.array([-2.0]), 0.4, 2.0) == 0  # as slow as allowed
    closed = np.array([1.0, -1.0, 1.0])
    assert nearness(closed, np.array([-3.0, 3.0, 9.0]), 0.4, 2.0) == AHEAD + BACK


def test_spans_have_bounds() -> None:
    span = Span(0.5, 4, 3)
    assert (span.window_periods, span.frames_per_period, span.limit) == (1, 0, np.inf)
    assert span.refinement is NOT_REFINED and NOT_REFINED == Refinement(1, 0.0)
    assert Span(0.5, 1, 1, frames_per_period=1, limit=1e-9).limit == 1e-9
    for arguments, told in (
        ((0.0, 4, 3), "time_step: expected a number above 0 [s], given 0.0"),
        ((np.inf, 4, 3), "time_step: expected a number above 0 [s], given inf"),
        ((0.5, 0, 3), "steps_per_period: expected a whole number from 1, given 0"),
        ((0.5, 4, 1.5), "periods: expected a whole number from 1, given 1.5"),
        ((0.5, 4, 3, 1, 0, 0.0), "limit: expected a number above 0 [m], given 0.0"),
    ):
        with pytest.raises(CaseError) as error:
            Span(*arguments)
        assert str(error.value) == told
    of_frames = (0.5, 4, 3, 1, 5)
    for arguments, key in (((0.5, 4, 3, 4), "window_periods"), (of_frames, "frames_per_period")):
        with pytest.raises(CaseError, match=f"^{key}: expected "):
            Span(*arguments)
