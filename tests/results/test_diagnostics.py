import json

import numpy as np
import pytest
import stack
import xarray as xr
from stack import three_laminae
from synthetic import (
    AMPLITUDES,
    PERIODS,
    STEPS,
    SWEEP,
    WINDOW,
    small_case,
    synthetic_history,
    tip_motion,
)

from delam_fem.api import Case, diagnostics, json_ready

ROUND_OFF = 1e-10
"""Relative to the largest amplitude: a transform of a thousand samples loses few digits."""


def harmonics_of(history: xr.Dataset, case: Case) -> np.ndarray | None:
    return diagnostics.ProbeMotion.of(history).harmonics(case.steps_per_period)


def test_harmonics_of_the_window_are_those_put_in() -> None:
    case = small_case()
    amplitudes = harmonics_of(synthetic_history(case), case)
    expected = np.zeros_like(amplitudes)
    expected[:, :3] = AMPLITUDES
    np.testing.assert_allclose(amplitudes, expected, rtol=0, atol=ROUND_OFF * AMPLITUDES.max())


def test_summary_of_the_prescribed_motion() -> None:
    case = small_case()
    summary = diagnostics.summary(synthetic_history(case), case)
    t = PERIODS - WINDOW + np.arange(1, STEPS * WINDOW + 1) / STEPS
    q, _ = tip_motion(t)
    thd = np.hypot(AMPLITUDES[:, 1], AMPLITUDES[:, 2]) / AMPLITUDES[:, 0]
    np.testing.assert_allclose(summary["tip_min"], q.min(axis=1), rtol=1e-14)
    np.testing.assert_allclose(summary["tip_max"], q.max(axis=1), rtol=1e-14)
    np.testing.assert_allclose(summary["thd"], thd, rtol=ROUND_OFF)
    np.testing.assert_allclose(summary["distortion_factor"], np.sqrt(1 + thd**2) - 1, rtol=1e-8)
    assert summary["minimum_tip_gap"] == pytest.approx((0.030 + q[1] - q[0]).min(), rel=1e-14)
    assert summary["periodicity"] == 1
    assert summary["strobe_scatter"] < ROUND_OFF
    assert summary["periodicity_class"] == "period 1" and len(summary["strobe_scatters"]) == 8
    assert summary["tip_contacts_per_period"] == 1.0
    assert summary["impacts_per_period"] == 2.0


def test_period_doubled_motion() -> None:
    case = small_case()
    history = synthetic_history(case, subharmonic=0.004, tip_strikes=(0.5, 2.5))
    summary = diagnostics.summary(history, case)
    assert summary["periodicity"] == 2
    assert summary["tip_contacts_per_period"] == 0.5
    plain = diagnostics.summary(synthetic_history(case), case)
    np.testing.assert_allclose(summary["thd"], plain["thd"], rtol=1e-9)  # even window: no leakage


@pytest.mark.parametrize("P", range(1, 9))
def test_periodicity_is_the_smallest_that_repeats(P: int) -> None:
    cycle = np.random.default_rng(1).uniform(-1.0, 1.0, (2, P))
    strobe = np.tile(cycle, 80 // P + 1)
    assert diagnostics.periodicity(strobe, np.array([1.0, 1.0])) == (P, 0.0)


def test_a_cycle_of_nine_has_no_periodicity() -> None:
    strobe = np.tile(np.random.default_rng(1).uniform(-1.0, 1.0, (2, 9)), 9)
    assert diagnostics.periodicity(strobe, np.array([1.0, 1.0])) == (None, None)


@pytest.mark.parametrize(("scatter", "expected"), [(0.099, 1), (0.101, None)])
def test_threshold_of_the_rms_difference_of_either_tip(scatter: float, expected: int) -> None:
    """Steps of ± scatter have that rms difference for P = 1; the other P see a drift."""
    steady = np.zeros(60)
    drifting = 5.0 * scatter * np.arange(60.0)
    for strobe in (np.stack([steady, drifting]), np.stack([drifting, steady])):
        P, computed_scatter = diagnostics.periodicity(strobe, np.array([5.0, 5.0]))
        assert P == expected
        assert computed_scatter == (pytest.approx(scatter, rel=1e-12) if expected else None)


@pytest.mark.parametrize(
    ("single", "double", "expected"),
    [
        (0.065, 0.065, "period 1"),
        (0.09, 0.001, "undecided"),  # 1 or 2
        (0.109, 0.081, "undecided"),  # 2, 1 or none
        (0.13, 0.001, "period 2"),
        (0.13, 0.09, "undecided"),  # 2 or none
        (0.3, 0.3, "not periodic"),
    ],
)
def test_a_class_needs_a_margin(single: float, double: float, expected: str) -> None:
    """Strobes that alternate by `a` and wander by `b`: scatters are known for P = 1 and 2."""
    scatters = np.full(8, double)
    scatters[::2] = single
    history = np.zeros((1, 60))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(diagnostics, "scatters", lambda strobe, half_range: scatters)
        P, _ = diagnostics.periodicity(history, np.ones(1))
        decided = diagnostics.is_decided(scatters)
    assert diagnostics.class_name(P, is_decided=decided) == expected


def test_scatters_of_an_alternating_motion() -> None:
    """An alternation of ± a has the scatter 2 a / half range for odd P and none for even P."""
    strobe = 0.1 * (-1.0) ** np.arange(80)[None]
    assert diagnostics.scatters(strobe, np.array([0.5])) == pytest.approx([0.4, 0.0] * 4)
    assert diagnostics.scatters(strobe, np.zeros(1)).size == 0


def test_only_the_last_periods_count() -> None:
    strobe = np.zeros((2, 200))
    strobe[:, : 200 - diagnostics.STROBES] = np.random.default_rng(0).normal(size=(2, 160))
    assert diagnostics.periodicity(strobe, np.ones(2)) == (1, 0.0)
    strobe[:, 200 - diagnostics.STROBES] = 3.0
    assert diagnostics.periodicity(strobe, np.ones(2))[0] != 1


@pytest.mark.parametrize("n", [0, 1])
def test_too_few_periods_have_no_periodicity(n: int) -> None:
    assert diagnostics.periodicity(np.zeros((2, n)), np.ones(2)) == (None, None)


def test_a_tip_at_rest_has_no_periodicity() -> None:
    assert diagnostics.periodicity(np.zeros((2, 50)), np.array([1.0, 0.0])) == (None, None)


@pytest.mark.parametrize(
    ("closed", "expected"),
    [
        ([], 0),
        ([30], 1),
        ([30, 31, 32], 1),
        ([30, 39, 48], 1),  # each less than 10 from the next
        ([30, 40], 2),
        ([0, 50, 99], 2),  # the one at the end goes on at the start
        ([5, 96], 1),
        ([5, 95], 2),
        (range(100), 1),
    ],
)
def test_contacts_are_groups_of_closed_steps(closed: list[int], expected: int) -> None:
    is_closed = np.zeros(100, dtype=bool)
    is_closed[list(closed)] = True
    assert diagnostics.count_contacts(is_closed, 10.0) == expected


def test_contacts_do_not_depend_on_where_the_window_begins() -> None:
    is_closed = np.zeros(400, dtype=bool)
    is_closed[[17, 19, 26, 150, 155, 300]] = True
    counts = {diagnostics.count_contacts(np.roll(is_closed, k), 10.0) for k in range(400)}
    assert counts == {3}


def test_a_closed_gap_counts_without_impacts() -> None:
    case = small_case(contact__law="penalty")
    history = synthetic_history(case).isel(event=slice(0, 0))
    assert diagnostics.summary(history, case)["tip_contacts_per_period"] == 0.0
    gap = diagnostics.tip_gap(history)
    threshold = np.quantile(gap, 0.1)  # once per period, below its only small gaps
    history["gap0"] = history["gap0"] - threshold
    summary = diagnostics.summary(history, case)
    assert summary["minimum_tip_gap"] < 0.0
    assert summary["tip_contacts_per_period"] == 1.0
    assert summary["impacts_per_period"] == 0.0


def test_impacts_count_although_the_gap_stays_open_and_only_those_at_the_tip() -> None:
    case = small_case()
    history = synthetic_history(case, tip_strikes=(0.25, 0.75))
    assert diagnostics.tip_gap(history).min() > 0.0
    closed = np.flatnonzero(diagnostics.ProbeMotion.of(history).is_closed.any(axis=0))
    assert closed.tolist() == [STEPS // 4 - 1, 3 * STEPS // 4 - 1]


def test_without_contact_law_no_contacts_but_the_gap() -> None:
    case = small_case(contact__law="none")
    history = synthetic_history(case).isel(event=slice(0, 0))
    summary = diagnostics.summary(history, case)
    assert summary["tip_contacts_per_period"] is None
    assert summary["impacts_per_period"] == 0.0
    assert summary["minimum_tip_gap"] > 0.0


def test_swept_sine_has_no_harmonics_and_no_periodicity() -> None:
    case = small_case(**SWEEP)
    summary = diagnostics.summary(synthetic_history(case), case)
    for name in ("distortion_factor", "thd", "periodicity", "strobe_scatter", "periodicity_class"):
        assert summary[name] is None
    assert summary["tip_contacts_per_period"] == 1.0


def test_interrupted_window_is_cut_to_its_last_whole_periods() -> None:
    case = small_case()
    history = synthetic_history(case).isel(time=slice(0, 3 * STEPS - 7))
    amplitudes = harmonics_of(history, case)
    np.testing.assert_allclose(amplitudes[:, :3], AMPLITUDES, atol=ROUND_OFF * AMPLITUDES.max())
    assert diagnostics.last_periods(history, case).sizes["time"] == 2 * STEPS
    assert diagnostics.last_periods(history, case, 1).sizes["time"] == STEPS


def test_unfinished_period_has_no_strobe() -> None:
    case = small_case()
    history = synthetic_history(case).isel(time=slice(0, WINDOW * STEPS - 7))
    history["strobe_displacement"][:, -1] = np.nan
    summary = diagnostics.summary(history, case)
    assert summary["periodicity"] == 1


def test_less_than_a_period_and_not_finite_values_give_null_in_json() -> None:
    case = small_case()
    short = synthetic_history(case).isel(time=slice(0, STEPS // 2), period=slice(0, 1))
    summary = json_ready(diagnostics.summary(short, case))
    assert summary["thd"] is None
    assert summary["periodicity"] is None
    diverged = synthetic_history(case)
    diverged["tip_displacement"][0, -1] = np.inf
    diverged["tip_displacement"][1, -1] = np.inf
    diverged["strobe_displacement"][1, -1] = np.inf
    summary = json_ready(diagnostics.summary(diverged, case))
    assert summary["tip_max"] == [None, None]
    assert summary["tip_min"][0] < 0.0
    assert summary["minimum_tip_gap"] is None
    assert summary["periodicity"] is None
    json.dumps(summary, allow_nan=False)


def test_phase_portrait_pairs_displacement_and_velocity() -> None:
    case = small_case()
    history = synthetic_history(case)
    portrait = diagnostics.phase_portrait(history, case, 2)
    assert portrait.shape == (2, 2, 2 * STEPS)
    # central differences of the displacement; (2 pi)^2 / 6 / STEPS^2 and harmonics bound the error
    slope = (portrait[:, 0, 2:] - portrait[:, 0, :-2]) / (2.0 * case.time_step)
    assert np.abs(slope - portrait[:, 1, 1:-1]).max() < 2e-3 * np.abs(portrait[:, 1]).max()


def test_three_laminae_meet_at_the_node_of_their_probes() -> None:
    recorded = three_laminae()
    history, case = recorded.history(), recorded.case
    motion = diagnostics.ProbeMotion.of(history)
    t = stack.PERIODS - WINDOW + np.arange(1, STEPS * WINDOW + 1) / STEPS
    u = stack.q(t)
    np.testing.assert_allclose(motion.displacement, u, atol=1e-15)
    np.testing.assert_allclose(motion.gap_at_rest, stack.GAPS, rtol=1e-15)
    gaps = [0.030 + u[1] - u[0], 0.020 + u[2] - u[1]]
    np.testing.assert_allclose(motion.gaps, gaps, rtol=1e-13)
    np.testing.assert_array_equal(diagnostics.tip_gap(history), motion.gaps.min(axis=0))
    assert (
        0 < (np.argmin(gaps, axis=0) == 0).sum() < t.size
    )  # each of them is the smallest at times
    for closed, phase in zip(motion.is_closed, stack.STRIKES.values(), strict=True):
        expected = [j * STEPS + round(phase * STEPS) - 1 for j in range(WINDOW)]
        assert np.flatnonzero(closed).tolist() == expected
    np.testing.assert_allclose(
        diagnostics.probe_positions(history),
        u + np.array([[0.0], [0.030], [0.050]]),
        rtol=1e-13,
        atol=1e-15,
    )
    assert diagnostics.phase_portrait(history, case, 2).shape == (3, 2, 2 * STEPS)
    harmonics = harmonics_of(history, case)
    assert harmonics is not None
    np.testing.assert_allclose(harmonics[:, 0], stack.AMPLITUDES, rtol=1e-12)


def test_summary_of_three_laminae() -> None:
    recorded = three_laminae()
    summary = diagnostics.summary(recorded.history(), recorded.case)
    u = stack.q(np.arange(1, STEPS + 1) / STEPS)
    np.testing.assert_allclose(summary["tip_min"], u.min(axis=1), rtol=1e-12)
    np.testing.assert_allclose(summary["tip_max"], u.max(axis=1), rtol=1e-12)
    smallest = np.min([0.030 + u[1] - u[0], 0.020 + u[2] - u[1]])
    assert summary["minimum_tip_gap"] == pytest.approx(smallest, rel=1e-12)
    assert summary["tip_contacts_per_period"] == 2.0  # one of each interface
    assert summary["impacts_per_period"] == 3.0
    assert summary["periodicity"] == 1
    assert len(summary["thd"]) == 3


def test_the_gap_of_two_laminae_is_evaluated_in_one_order() -> None:
    history = synthetic_history(small_case())
    u = history["tip_displacement"].to_numpy()
    gap = float(history["gap0"][-1]) + u[1] - u[0]
    assert diagnostics.tip_gap(history).tobytes() == gap.tobytes()


@pytest.mark.parametrize(("scatter", "expected"), [(0.083, 1), (0.121, None)])
def test_periodicity_is_relative_to_half_the_range_of_the_window(
    scatter: float, expected: int | None
) -> None:
    """The tips swing between 10 and 13 and between -1 and 2: half their range is 1.5."""
    case = small_case()
    swing = 1.5 * np.sin(2.0 * np.pi * np.arange(2 * STEPS) / STEPS)
    drift = 1.5 * scatter * np.arange(60.0)
    motion = diagnostics.ProbeMotion(
        np.stack([11.5 + swing, 0.5 + swing]),
        np.stack([drift, -drift]),
        np.array([1.0]),
        np.zeros((1, 2 * STEPS), dtype=bool),
        0,
    )
    summary = diagnostics.summary_of(motion, case)
    assert summary["periodicity"] == expected
    if expected:
        assert summary["strobe_scatter"] == pytest.approx(scatter, rel=1e-3)  # of the samples


@pytest.mark.parametrize(("apart", "contacts"), [(0.045, 1.0), (0.05, 2.0)])
def test_a_twentieth_of_a_period_parts_contacts(apart: float, contacts: float) -> None:
    case = small_case()
    strikes = tuple(k + 0.25 + shift for k in range(WINDOW) for shift in (0.0, apart))
    summary = diagnostics.summary(synthetic_history(case, tip_strikes=strikes), case)
    assert summary["tip_contacts_per_period"] == contacts


@pytest.mark.parametrize(
    ("strike", "steps"),
    [(0.0, []), (1 / STEPS, [0]), (WINDOW, [WINDOW * STEPS - 1]), (WINDOW + 1 / STEPS, [])],
)
def test_impacts_count_in_the_window_alone(strike: float, steps: list[int]) -> None:
    history = synthetic_history(small_case(), tip_strikes=(strike,))
    assert (
        np.flatnonzero(diagnostics.ProbeMotion.of(history).is_closed.any(axis=0)).tolist() == steps
    )


def test_a_gap_of_exactly_zero_is_closed() -> None:
    motion = diagnostics.ProbeMotion(
        np.array([[1.0, 1.0, 1.0], [0.0, -0.5, -0.25]]),
        np.zeros((2, 0)),
        np.array([1.25]),
        np.array([[True, False, False]]),
        1,
    )
    assert motion.gap.tolist() == [0.25, -0.25, 0.0]
    assert motion.is_closed.tolist() == [[True, True, True]]


def test_whole_periods_are_the_last_ones() -> None:
    case = small_case()
    history = synthetic_history(case)
    motion = diagnostics.ProbeMotion.of(history)
    assert motion.whole_periods(STEPS).shape == (2, WINDOW * STEPS)
    cut = motion.whole_periods(300)
    assert cut.tolist() == motion.displacement[:, -600:].tolist()
    short = history.isel(time=slice(0, STEPS - 1))
    assert harmonics_of(short, case) is None
    assert diagnostics.last_periods(short, case).sizes["time"] == 0
    assert diagnostics.last_periods(short, case, 3).sizes["time"] == STEPS - 1
    assert diagnostics.last_periods(history, case, 2)["time"][0] == history["time"][2 * STEPS]


def test_rates_per_period_are_those_of_the_window() -> None:
    case = small_case()
    history = synthetic_history(case).isel(time=slice(0, 2 * STEPS + STEPS // 2))
    summary = diagnostics.summary(history, case)
    assert summary["impacts_per_period"] == 8 / 2.5
    assert summary["tip_contacts_per_period"] == 3 / 2.5


def test_ten_periods_of_a_portrait_unless_told() -> None:
    case = small_case()
    history = synthetic_history(case)
    assert diagnostics.phase_portrait(history, case).shape == (2, 2, WINDOW * STEPS)
    assert diagnostics.phase_portrait(history, case, 1).shape == (2, 2, STEPS)


@pytest.mark.parametrize(("n", "expected"), [(1, None), (2, 1), (3, 1)])
def test_a_period_must_be_seen_twice(n: int, expected: int | None) -> None:
    assert diagnostics.periodicity(np.ones((2, n)), np.ones(2))[0] == expected
    doubled = np.tile([0.0, 1.0], (2, 2))
    assert diagnostics.periodicity(doubled, np.ones(2)) == (2, 0.0)
    assert diagnostics.periodicity(doubled[:, :3], np.ones(2)) == (None, None)


@pytest.mark.parametrize(("first", "hits"), [(99, [False]), (98, [False, True])])
def test_strikes_need_two_samples_to_be_placed(first: int, hits: list[bool]) -> None:
    history = synthetic_history(small_case(), tip_strikes=(0.5,)).isel(time=slice(first, 100))
    assert diagnostics.ProbeMotion.of(history).is_hit[0].tolist() == hits


def test_the_place_of_the_probes_is_told() -> None:
    assert diagnostics.probe_place(synthetic_history(small_case())) == "the tip"
