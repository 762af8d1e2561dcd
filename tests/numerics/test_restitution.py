"""The coefficient of restitution from velocities: formulas, and jumps found in signals."""

import numpy as np
import pytest
from hypothesis import given, strategies as st

from delam_fem.paper.histories import VelocityJumps, identify

EXACT = 1e-10
"""Straight lines through exact samples meet at the jump up to round-off."""
NOISE = 1e-3
"""Standard deviation of the noise of a measured signal [m/s]."""

speeds = st.floats(0.01, 10.0)


def struck(mass_ratio: float, e: float, v1: float, v2: float) -> tuple[float, float]:
    """Return velocities after an impact, from conservation of momentum and eq. 3 alone."""
    m1, m2 = mass_ratio, 1.0
    momentum, rate = m1 * v1 + m2 * v2, -e * (v2 - v1)
    w1 = (momentum - m2 * rate) / (m1 + m2)
    return w1, w1 + rate


def signals(
    e: float, mass_ratio: float = 1.942, *, n: int = 400, jumps: tuple[int, ...] = (100, 300)
) -> tuple[np.ndarray, np.ndarray]:
    """Return sawtooth velocities that jump in the middle between samples `jumps` and the next."""
    t = np.arange(n) * 1e-3
    v = np.empty((2, n))
    slopes, start = np.array([3.0, -5.0]), np.array([0.1, -0.2])
    begin, now = 0.0, start
    edges = [*(0.5 * (t[k] + t[k + 1]) for k in jumps), np.inf]
    for edge in edges:
        inside = (t >= begin) & (t < edge)
        v[:, inside] = now[:, None] + slopes[:, None] * (t[inside] - begin)
        if np.isfinite(edge):
            now = np.array(struck(mass_ratio, e, *(now + slopes * (edge - begin))))
            begin = edge
    return t, v


@given(e=st.floats(0.0, 1.0), mass_ratio=st.floats(0.1, 10.0), v1=speeds, v2=speeds)
def test_formulas_give_back_the_coefficient(
    e: float, mass_ratio: float, v1: float, v2: float
) -> None:
    after = struck(mass_ratio, e, v1, -v2)
    jumps = VelocityJumps(np.zeros(1), np.array([[v1, -v2]]), np.array([after]))
    assert jumps.restitution == pytest.approx([e], abs=EXACT)
    assert jumps.restitution_by_body(mass_ratio)[0] == pytest.approx((e, e), abs=EXACT)


def test_printed_signs_of_eq_4_would_give_another_gap_rate() -> None:
    e, ratio, v1, v2 = 0.1, 1.942, 0.6, -0.5
    share_1, share_2 = 1.0 / (1.0 + ratio), ratio / (1.0 + ratio)
    w1 = v1 - (1.0 + e) * share_1 * (v2 - v1)
    w2 = v2 + (1.0 + e) * share_2 * (v2 - v1)
    jumps = VelocityJumps(np.zeros(1), np.array([[v1, v2]]), np.array([[w1, w2]]))
    assert jumps.restitution == pytest.approx([-(2.0 + e)])


@pytest.mark.parametrize("e", [0.0, 0.05, 0.1, 0.7])
@pytest.mark.parametrize("fit", [2, 3, 8])
def test_coefficient_is_recovered_from_synthetic_signals(e: float, fit: int) -> None:
    strikes = identify(*signals(e), fit_samples=fit)
    assert strikes.time == pytest.approx([0.1005, 0.3005], abs=1e-12)
    assert strikes.restitution == pytest.approx([e, e], abs=EXACT)
    assert strikes.restitution_by_body(1.942) == pytest.approx(np.full((2, 2), e), abs=EXACT)
    assert strikes.apparent_mass_ratio == pytest.approx([1.942] * 2, abs=EXACT)
    assert (np.diff(strikes.before) < 0.0).all()


def test_coefficient_is_recovered_from_a_noisy_signal() -> None:
    rng = np.random.default_rng(1)
    t, v = signals(0.08)
    measured = v + NOISE * rng.standard_normal(v.shape)
    jumps = identify(t, measured, fit_samples=20, apart=0.05)
    # two lines through 20 samples: NOISE times about 1 at their ends, over 2.5 m/s of approach
    assert jumps.restitution == pytest.approx([0.08] * 2, abs=5.0 * NOISE)


def test_of_two_jumps_close_together_the_larger_one_counts() -> None:
    t, v = signals(0.1)
    v[1, 110:] += 0.4  # a further push that parts them
    v[0, 105:110] += 0.3  # and an approach before it
    assert identify(t, v, apart=0.05).time.size == 2


def test_no_strike_in_smooth_signals_that_part() -> None:
    t = np.linspace(0.0, 1.0, 50)
    assert identify(t, np.stack([-t, 1.0 + t])).time.size == 0


def steady(n: int, *jumps: tuple[int, float]) -> tuple[np.ndarray, np.ndarray]:
    """Return a first body at rest and a second with -1 m/s whose velocity jumps after samples."""
    t, v = 0.25 * np.arange(n), np.zeros((2, n))
    v[1] = -1.0
    for after, by in jumps:
        v[1, after + 1 :] += by
    return t, v


@pytest.mark.parametrize(
    ("after", "is_found"), [(0, False), (1, False), (2, True), (6, True), (7, False), (8, False)]
)
def test_a_strike_needs_its_samples_on_both_sides(after: int, is_found: bool) -> None:
    """Ten samples, three of them on each side of the jump."""
    jumps = identify(*steady(10, (after, 1.5)), fit_samples=3)
    assert jumps.time.tolist() == ([0.25 * (after + 0.5)] if is_found else [])
    assert jumps.restitution == pytest.approx([0.5] if is_found else [])


def test_bodies_that_part_by_the_time_of_the_jump_do_not_strike() -> None:
    """The gap rate rises steadily by 0.4 m/s a sample, through 0 before the jump after sample 4."""
    t = np.arange(12.0)
    rate = -1.7 + 0.4 * t
    rate[5:] += 3.0
    assert rate[4] < 0.0 < rate[4] + 0.5 * 0.4
    assert identify(t, np.stack([0.0 * t, rate])).time.size == 0


@pytest.mark.parametrize(("second", "found"), [(0.19, 1), (0.21, 2)])
def test_small_jumps_count_from_a_share_of_the_largest(second: float, found: int) -> None:
    t, v = steady(40, (10, 1.0), (25, second))
    v[1] -= 1.0
    assert identify(t, v, smallest_jump=0.2).time.size == found
    assert identify(t, v, smallest_jump=1.0).time.size == 1


@pytest.mark.parametrize(("apart", "found"), [(3.75, 2), (3.76, 1)])
def test_strikes_closer_than_asked_are_one_the_larger(apart: float, found: int) -> None:
    """The jumps are 15 samples of 0.25 s apart."""
    t, v = steady(40, (10, 0.5), (25, 1.0))
    v[1] -= 1.0
    times = identify(t, v, apart=apart).time
    assert times.size == found
    assert times[-1] == pytest.approx(0.25 * 25.5)


@pytest.mark.parametrize(("distance", "found"), [(3, 1), (4, 2)])
def test_strikes_do_not_share_samples(distance: int, found: int) -> None:
    """Three samples of a line and one interval of a jump lie between two strikes."""
    t, v = steady(40, (10, 0.5), (10 + distance, 1.0))
    v[1] -= 1.0
    assert identify(t, v, fit_samples=3).time.size == found


def test_one_sample_is_taken_as_it_is_and_lines_are_extrapolated_to_the_middle() -> None:
    t = np.arange(10.0)
    v = np.stack([0.0 * t, -2.0 + 0.1 * t])
    v[1, 5:] += 3.0
    single = identify(t, v, fit_samples=1)
    assert (single.before[0, 1], single.after[0, 1]) == pytest.approx((-1.6, 1.5))
    line = identify(t, v, fit_samples=3)
    assert (line.before[0, 1], line.after[0, 1]) == pytest.approx((-1.55, 1.45))
    assert line.time == [4.5]
