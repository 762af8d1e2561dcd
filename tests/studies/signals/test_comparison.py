"""Harmonics of a record, frequencies, comparisons of channels, and what is said of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from delam_fem.studies.signals.alignment import Alignment, MatchedHistories, MotionCourse
from delam_fem.studies.signals.comparison import (
    CLEAR,
    FACTORS,
    NEIGHBOURHOOD,
    ChannelComparison,
    HarmonicFit,
    compared,
    drive_frequency,
    findings,
    fitted,
    strongest_frequency,
)

F = 4.0
TIME = 2.0 + np.arange(600) / 200.0
COEFFICIENTS = np.array([0.0, 3.0 - 1.0j, 0.2j, 0.6 + 0.8j, 0.1, 0.0, 0.0, 0.05])
"""Of orders 1/2, 1, … of F: 1, 2 and 4 are harmonics of the drive."""


def fit(**about: object) -> HarmonicFit:
    values = {"mean": 7.0, "coefficients": COEFFICIENTS, "frequency": F / 2, "multiple": 2,
           "noise": 0.3, "n_samples": 400}  # fmt: skip
    return HarmonicFit(**values | about)  # type: ignore[arg-type]


def test_harmonics_and_their_noise() -> None:
    harmonic_fit = fit()
    assert harmonic_fit.amplitudes.tolist() == [np.sqrt(10.0), 1.0, 0.0, 0.05]
    assert harmonic_fit.floor == pytest.approx(2.0 * 0.3 / 20.0, rel=1e-15)
    clear_coefficients = np.where(np.abs(COEFFICIENTS) > CLEAR * 0.03, COEFFICIENTS, 0.0)
    assert (
        harmonic_fit.clear().coefficients.tolist() == clear_coefficients.tolist()
        and harmonic_fit.clear().mean == 7.0
    )
    at_limit = fit(coefficients=np.array([CLEAR * 0.03, CLEAR * 0.03 * (1.0 + 1e-12)]))
    assert (np.abs(at_limit.clear().coefficients) > 0.0).tolist() == [False, True]


def test_a_fit_has_value_and_derivatives() -> None:
    harmonic_fit, w = fit(), np.pi * F * np.arange(1, 9)
    for derivative in (0, 1, 2):
        terms = COEFFICIENTS * (1j * w) ** derivative * np.exp(1j * np.outer(TIME, w))
        wanted = terms.real.sum(axis=1) + (7.0 if derivative == 0 else 0.0)
        np.testing.assert_allclose(harmonic_fit.at(TIME, derivative), wanted, rtol=1e-9, atol=1e-9)
    np.testing.assert_array_equal(harmonic_fit.at(TIME), harmonic_fit.at(TIME, 0))


def test_the_distortion_is_without_the_share_of_the_noise() -> None:
    """d = sqrt(1 + (A_2² + … - (n - 1) floor²) / A_1²) - 1, and its deviation by propagation."""
    a, extra = fit().amplitudes, 0.03**2
    higher = a[1] ** 2 + a[3] ** 2 - 3.0 * extra
    d = np.sqrt(1.0 + higher / 10.0) - 1.0
    spread = np.sqrt(2.0 * extra * higher + 3.0 * extra**2) / (2.0 * 10.0 * (1.0 + d))
    assert fit().distortion() == pytest.approx((d, spread), rel=1e-12)
    drowned = fit(noise=30.0)
    assert drowned.distortion() == pytest.approx((0.0, np.sqrt(3.0) * 9.0 / 20.0), rel=1e-12)
    for nothing in (np.zeros(0), np.zeros(4)):
        assert np.isnan(fit(coefficients=nothing).distortion()).all()


def signal(time: np.ndarray) -> np.ndarray:
    """Return the motion of the fit and what does not repeat beside it."""
    return fit().at(time) + 0.02 * np.cos(2.0 * np.pi * 3.1 * time)


def test_a_record_is_fitted_with_its_mean_and_noise() -> None:
    harmonic_fit = fitted(TIME, fit().at(TIME), F, 2)
    np.testing.assert_allclose(harmonic_fit.coefficients[:8], COEFFICIENTS, atol=1e-12)
    assert harmonic_fit.mean == pytest.approx(7.0, abs=1e-12) and harmonic_fit.noise < 1e-12
    assert (harmonic_fit.frequency, harmonic_fit.multiple, harmonic_fit.n_samples) == (2.0, 2, 600)
    beside = fitted(TIME, signal(TIME), F, 2)
    residual = (signal(TIME) - beside.at(TIME)).std()
    n = beside.coefficients.size
    assert beside.noise == pytest.approx(residual * np.sqrt(600.0 / (600 - 1 - 2 * n)), rel=1e-12)


@pytest.mark.parametrize(
    ("n", "rate", "multiple", "orders"),
    [
        (600, 200.0, 1, 24),  # below half the rate, 100 Hz
        (601, 1000.0, 1, 74), (2000, 1000.0, 2, 249), (200, 1000.0, 1, 24), (201, 1000.0, 1, 24),
        (204, 1000.0, 1, 25), (12, 1000.0, 1, 1), (8, 1000.0, 1, 1),
    ],
)  # fmt: skip
def test_how_many_harmonics_are_fitted(n: int, rate: float, multiple: int, orders: int) -> None:
    """What the rate and a quarter of the samples allow, but one at least."""
    time = 1.0 + np.arange(n) / rate
    assert fitted(time, np.sin(time), F, multiple).coefficients.size == orders


def test_the_frequency_of_the_drive_is_found_near_it() -> None:
    rows = np.array(
        [np.sin(2.0 * np.pi * 4.1234 * TIME), 1e3 * np.cos(2.0 * np.pi * 4.1234 * TIME)]
    )
    assert drive_frequency(TIME, rows + 5.0, F) == pytest.approx(4.1234, rel=2e-3)
    assert drive_frequency(TIME, rows, F, 0.6) == pytest.approx(4.1234, rel=2e-3)
    far = np.sin(2.0 * np.pi * 4.9 * TIME)[None]  # the widest range is 2 over the duration
    assert 2.0 / (TIME[-1] - TIME[0]) > NEIGHBOURHOOD * F
    assert drive_frequency(TIME, far, F) is None
    assert drive_frequency(TIME, far, F, 2.0) == pytest.approx(4.9, rel=2e-3)
    for periods, is_found in ((2.99, False), (3.02, True)):
        time = np.linspace(0.0, periods / F, 400)
        frequency = drive_frequency(time, np.sin(2.0 * np.pi * F * time)[None], F)
        assert (frequency is not None) == is_found
    long = 1.0 + np.arange(8000) / 200.0  # 40 s: a tenth of the frequency counts
    for f, is_found in ((3.62, True), (4.38, True), (3.59, False), (4.41, False)):
        frequency = drive_frequency(long, np.sin(2.0 * np.pi * f * long)[None], F)
        assert (frequency == pytest.approx(f, rel=1e-6)) if is_found else frequency is None


def test_channels_in_one_unit_are_weighed_by_their_sizes() -> None:
    time = np.arange(2000) / 500.0
    rows = np.array([np.sin(2.0 * np.pi * 20.0 * time), 3.0 * np.sin(2.0 * np.pi * 33.0 * time)])
    assert strongest_frequency(time, rows, 5.0) == pytest.approx(33.0, rel=1e-5)
    assert strongest_frequency(time, rows[:1], 5.0) == pytest.approx(20.0, rel=1e-5)


# ---- comparisons


def course(time: np.ndarray, period: float | None) -> tuple[MotionCourse, np.ndarray]:
    """Return the course of two channels, and their values; without a period it is a chirp."""
    t = time if period else time + 0.7 * (time - 1.0) ** 2
    values = np.array([
        2.0 * np.sin(2.0 * np.pi * F * t) + 0.3 * np.cos(4.0 * np.pi * F * t) + 0.5,
        0.01 * np.cos(2.0 * np.pi * F * t + 0.4) - 0.002 * np.sin(6.0 * np.pi * F * t),
    ])  # fmt: skip
    return MotionCourse.of(time, values, period), values


def test_comparisons_are_exact() -> None:
    """Channels of known gain, delay and mean over a run that repeats or not."""
    run_time = 1.0 + np.arange(1, 401) / 400.0
    time = 100.0 + np.arange(498) / 250.0
    for period in (0.25, None):
        of_run, computed = course(run_time, period)
        alignment = Alignment(1.004 if period is None else 1.61, 100.0, 0.5)
        delays, gains, means = (0.004, -0.006), (1.2, -0.7), (0.3, -0.01)
        measured = np.array([
            g * of_run.at(alignment.on_clock_of_run(time) - d)[k] + m
            for k, (g, d, m) in enumerate(zip(gains, delays, means, strict=True))
        ])  # fmt: skip
        if period is None:
            delays = (0.0, 0.0)
            motion = of_run.at(alignment.on_clock_of_run(time))
            measured = np.array([g * q + m for g, q, m in zip(gains, motion, means, strict=True)])
        pairs = MatchedHistories(
            ("a", "b"), ("m", "mm"), time, measured, run_time, computed, (True, False), ()
        )
        for k in (0, 1):
            comparison = compared(pairs, k, of_run, alignment, 0.25 if period else None)
            assert (comparison.name, comparison.units, comparison.is_drive) == (
                "ab"[k],
                ("m", "mm")[k],
                k == 0,
            )
            assert comparison.gain == pytest.approx(gains[k], rel=1e-4)
            assert comparison.delay == pytest.approx(delays[k], abs=2e-6)
            residual = measured[k] - of_run.at(alignment.on_clock_of_run(time))[k]
            assert comparison.mean_difference == pytest.approx(residual.mean(), rel=1e-12)
            assert comparison.residual == pytest.approx(residual.std(), rel=1e-12)
            both = np.corrcoef(measured[k], of_run.at(alignment.on_clock_of_run(time))[k])
            assert comparison.correlation == pytest.approx(both[0, 1], rel=1e-9)
            assert comparison.unlike < 1e-3
            assert (comparison.misfit is None) == (comparison.noise is None) == (period is None)
            if period is not None:
                assert comparison.misfit == pytest.approx(
                    residual.std(), rel=5e-3
                )  # of whole periods
                assert comparison.measured is not None and comparison.computed is not None
                ratio = comparison.measured.amplitudes[0] / comparison.computed.amplitudes[0]
                assert ratio == pytest.approx(abs(gains[k]), rel=1e-4)


@pytest.mark.parametrize("period", [0.25, None])
def test_what_the_run_does_not_explain_counts_from_three_times_the_noise(
    period: float | None,
) -> None:
    run_time = 1.0 + np.arange(1, 401) / 400.0
    of_run, computed = course(run_time, period)
    time = np.arange(1, 401) / 400.0
    motion = of_run.at(1.0 + time)[0]
    stray = 0.4 * np.cos(2.0 * np.pi * 3.0 * F * time + 0.3)  # a harmonic of the drive
    pairs = MatchedHistories(
        ("a",), ("m",), time, (motion + stray)[None], run_time, computed, (False,), ()
    )
    alignment = Alignment(1.0 + time[0], time[0], 1.0)
    comparison = compared(pairs, 0, of_run, alignment, period)
    share = stray.std() / (motion + stray).std()
    assert comparison.unlike == pytest.approx(share, rel=2e-2)
    white = np.random.default_rng(1).normal(0.0, 0.2, time.size)
    noisy = replace(pairs, measured=(motion + white)[None])
    assert compared(noisy, 0, of_run, alignment, period).unlike == 0.0


# ---- what is said


def channel(name: str = "a", **about: object) -> ChannelComparison:
    values = {"units": "m", "is_drive": False, "gain": 1.0, "gain_error": 0.001, "delay": 0.0,
           "delay_error": 1e-5, "correlation": 0.987, "mean_difference": 0.0, "residual": 0.0,
           "unlike": 0.02}  # fmt: skip
    return ChannelComparison(name=name, **values | about)  # type: ignore[arg-type]


def said(*channels: ChannelComparison, rate: float = 1.0, error: float = 1e-6,
         frequency: float | None = F) -> list[tuple[str, str, str]]:  # fmt: skip
    alignment = Alignment(0.0, 0.0, rate, 0.0, error)
    return [
        (finding.kind, finding.channel, finding.text)
        for finding in findings(channels, alignment, frequency)
    ]


def test_clocks_that_differ_are_named_beyond_thresholds() -> None:
    assert said(channel(), rate=1.000099) == said(channel(), rate=0.999901) == []
    text = "the run's clock is 1.00012 ± 1e-06 times as fast"
    driven = (", or the measurement was driven at 4.0005 Hz, the run at 4 Hz, which is not the same"
              " motion")  # fmt: skip
    assert said(channel(), rate=1.00012) == [("clock", "", text + driven)]
    assert said(channel(), rate=1.00012, frequency=None) == [("clock", "", text)]
    assert said(channel(), rate=1.0029, error=1e-3) == []
    assert len(said(channel(), rate=1.0031, error=1e-3)) == 1
    assert len(said(channel(), rate=float("nan"))) == 1


def test_amplitudes_that_differ_are_named_beyond_thresholds() -> None:
    assert said(channel(gain=1.0499)) == said(channel(gain=0.9501)) == []
    assert said(channel(gain=1.0512, gain_error=0.0051)) == [
        ("amplitude", "a", "a: measured 1.051 ± 0.0051 times the amplitude of the run")
    ]
    assert said(channel(gain=1.29, gain_error=0.1)) == []
    assert len(said(channel(gain=1.31, gain_error=0.1))) == 1
    for factor, hint in FACTORS.items():
        for share in (0.951, 1.0, 1.049):
            error = 1e-3 * abs(factor)
            [(_, _, text)] = said(channel(gain=share * factor, gain_error=error))
            assert text == (
                f"a: measured {share * factor:.4g} ± {error:.2g} times the amplitude of the run, "
                + hint
            )
        for share in (0.949, 1.051):
            [(_, _, text)] = said(channel(gain=share * factor, gain_error=1e-3 * abs(factor)))
            assert text.endswith("of the run"), (factor, share)


def test_shapes_that_differ_are_named_beyond_thresholds() -> None:
    assert said(channel(unlike=0.1)) == []
    text = "a: the measured motion is not that of the run (correlation 0.99, 10 % of it is left)"
    assert said(channel(unlike=0.1001)) == [("shape", "a", text)]
    assert said(channel(gain=1.0, gain_error=0.333)) == []
    lost = "a: the measured motion is not that of the run (correlation 0.99, 2 % of it is left)"
    assert said(channel(gain=1.0, gain_error=0.3334)) == [("shape", "a", lost)]


@pytest.mark.parametrize("name", ["gain", "gain_error", "delay", "delay_error", "unlike"])
def test_numbers_that_are_none_are_named(name: str) -> None:
    text = "a: not compared, as its gain, delay or correlation is no finite number"
    assert said(channel(**{name: float("nan")})) == [("numbers", "a", text)]
    second = channel("b", gain=2.0)
    assert [kind for kind, _, _ in said(channel(**{name: float("inf")}), second)] == [
        "numbers", "amplitude",
    ]  # fmt: skip


def test_phases_are_told_against_the_drive_or_the_least_late_channel() -> None:
    """At 4 Hz a degree is 0.694 ms."""
    degree = 1.0 / 360.0 / F
    late = channel("b", delay=5.1 * degree, delay_error=0.3 * degree)
    drive = channel("base", is_drive=True, delay=-0.2 * degree, delay_error=0.4 * degree)
    assert said(channel(), channel("b", delay=4.99 * degree)) == []
    text = "b: measured 5.1° ± 0.3° later than a; no drive was measured, so either may be wrong"
    assert said(channel(), late) == said(late, channel()) == [("phase", "b", text)]
    text = "b: measured 5.3° ± 0.5° later than base"
    assert said(late, drive) == [("phase", "b", text)]
    early = replace(late, delay=-170.0 * degree)
    assert said(drive, early) == [("phase", "b", "b: measured 169.8° ± 0.5° earlier than base")]
    turned = replace(late, delay=200.0 * degree)
    assert said(drive, turned) == [("phase", "b", "b: measured 159.8° ± 0.5° earlier than base")]
    unsure = replace(late, delay=6.0 * degree, delay_error=2.1 * degree)
    assert said(channel(), unsure) == []
    sure = replace(unsure, delay_error=1.9 * degree)
    assert len(said(channel(), sure)) == 1
    both = channel("c", delay=-7.0 * degree, delay_error=1.9 * degree)
    assert len(said(channel(delay_error=1.2 * degree), both)) == 1
    assert said(channel(delay_error=1.5 * degree), both) == []
    assert said(drive, late, frequency=None) == []
