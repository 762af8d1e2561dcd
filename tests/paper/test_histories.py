"""Strikes found in velocities that are lines between jumps."""

import numpy as np
import pytest

from delam_fem.paper.histories import VelocityJumps, identify

DT = 0.01
T = 5.0 + DT * np.arange(200)
STRIKES = ((40, 0.6), (90, 0.3), (150, 0.8))
"""Samples before strikes, and their coefficients of restitution."""
RATIO = 2.5
"""Mass of body 1 over that of body 2."""


def velocities() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return signals with jumps, and the velocities before and after each at its middle."""
    v, befores, afters = np.zeros((2, T.size)), [], []
    speed, slope, begin = np.array([1.0, -0.5]), np.array([0.3, -0.8]), 0
    for last, e in STRIKES:
        part = np.arange(begin, last + 1)
        v[:, part] = speed[:, None] + slope[:, None] * DT * (part - begin + 0.5 * (begin > 0))
        before = v[:, last] + 0.5 * DT * slope
        rate = before[1] - before[0]
        after = before + (1.0 + e) * rate * np.array([1.0, -RATIO]) / (1.0 + RATIO)
        befores.append(before)
        afters.append(after)
        speed, begin, slope = after, last + 1, np.array([1.2, -3.0])
    part = np.arange(begin, T.size)
    v[:, part] = speed[:, None] + slope[:, None] * DT * (part - begin + 0.5)
    return v, np.array(befores), np.array(afters)


@pytest.mark.parametrize("fit_samples", [2, 3, 5])
def test_lines_are_led_on_to_the_middle_of_a_jump(fit_samples: int) -> None:
    v, before, after = velocities()
    jumps = identify(T, v, fit_samples=fit_samples)
    np.testing.assert_allclose(jumps.time, [T[k] + DT / 2.0 for k, _ in STRIKES], rtol=1e-12)
    np.testing.assert_allclose(jumps.before, before, rtol=1e-9)
    np.testing.assert_allclose(jumps.after, after, rtol=1e-9)
    e = [e for _, e in STRIKES]
    np.testing.assert_allclose(jumps.restitution, e, rtol=1e-9)
    by_body = jumps.restitution_by_body(RATIO)
    np.testing.assert_allclose(by_body, np.transpose([e, e]), rtol=1e-9)
    np.testing.assert_allclose(jumps.apparent_mass_ratio, RATIO, rtol=1e-9)


def test_three_samples_are_fitted_and_one_is_taken_as_it_is() -> None:
    v, _, _ = velocities()
    three = identify(T, v)
    np.testing.assert_array_equal(three.before, identify(T, v, fit_samples=3).before)
    one = identify(T, v, fit_samples=1)
    at = np.array([k for k, _ in STRIKES])
    np.testing.assert_allclose(one.before, v[:, at].T, rtol=1e-12)
    np.testing.assert_allclose(one.after, v[:, at + 1].T, rtol=1e-12)


def test_a_fit_averages_noise() -> None:
    """Least squares through samples 0, 1 and 2 before the jump, led on by half an interval."""
    v, _, _ = velocities()
    rng = np.random.default_rng(4)
    v = v + 1e-3 * rng.normal(size=v.shape)
    jumps = identify(T, v)
    for values, (last, _) in zip(jumps.before, STRIKES, strict=True):
        line = np.polynomial.Polynomial.fit([0.0, -1.0, -2.0], v[0, last - np.arange(3)], 1)
        assert values[0] == pytest.approx(line(0.5), rel=1e-9)
    for values, (last, _) in zip(jumps.after, STRIKES, strict=True):
        line = np.polynomial.Polynomial.fit([1.0, 2.0, 3.0], v[1, last + 1 + np.arange(3)], 1)
        assert values[1] == pytest.approx(line(0.5), rel=1e-9)


def rate(*jumps: tuple[int, float]) -> np.ndarray:
    """Return velocities with a gap rate that jumps up after some samples, to fall in between."""
    stairs = np.zeros(T.size)
    for last, size in jumps:
        stairs[last + 1 :] += size
    steady = sum(size for _, size in jumps) / T.size
    return np.array([np.zeros(T.size), stairs - 2.0 * steady * np.arange(T.size) - 1.0])


def test_small_jumps_and_near_ones_are_left_out() -> None:
    def found(v: np.ndarray, **given: float) -> list[int]:
        jumps = identify(T, v, fit_samples=1, **given)  # type: ignore[arg-type]
        return np.rint((jumps.time - T[0]) / DT - 0.5).astype(int).tolist()

    v = rate((50, 1.0), (60, 0.5), (120, 0.9))
    assert found(v) == [50, 60, 120]
    assert found(v, smallest_jump=0.6) == [50, 120]
    assert found(v, apart=0.15) == [50, 120]
    assert found(v, apart=0.099) == [50, 60, 120]
    assert found(v, apart=0.75) == [50]  # the largest, whatever its place


def test_jumps_at_the_ends_have_no_samples_about_them() -> None:
    for fit_samples in (1, 3):
        first, last = fit_samples - 1, T.size - fit_samples - 1
        for place, is_found in ((first - 1, False), (first, True), (last, True), (last + 1, False)):
            if 0 <= place < T.size - 1:
                v = np.array([np.zeros(T.size), np.where(np.arange(T.size) <= place, -1.0, 1.0)])
                assert identify(T, v, fit_samples=fit_samples).time.size == is_found


def test_bodies_that_part_before_a_jump_do_not_strike() -> None:
    after = np.arange(T.size) > 90
    for before, n in ((-0.5, 1), (0.0, 0), (0.5, 0)):
        assert identify(T, np.array([0.0 * T, np.where(after, 2.0, before)])).time.size == n


def test_numbers_of_jumps() -> None:
    jumps = VelocityJumps(np.zeros(1), np.array([[0.6, -0.4]]), np.array([[-0.1, 0.4]]))
    assert jumps.restitution == pytest.approx([0.5])
    assert jumps.apparent_mass_ratio == pytest.approx([0.8 / 0.7])
    by_body = jumps.restitution_by_body(1.0)
    assert by_body == pytest.approx(np.array([[0.4, 0.6]]))
