import numpy as np
import pytest
from calibration.resonance import Rig, tip

from delam_fem.api import CaseError, FloatArray, SweptMotion, preset
from delam_fem.studies.identification.resonance import BLOCKS, ResonanceFit, _covariance, fit

FREQUENCY, D, NOISE = 1.4357, 0.008, 1e-4
SIGMAS = 3.5
"""Standard errors within which fixed seeds lie."""
UP, DOWN = (1.0, 2.2), (2.2, 1.0)


def motion(ends: tuple[float, float] = UP) -> SweptMotion:
    return SweptMotion(*ends, 200.0, 0.0025)


def record(
    rig: Rig, ends: tuple[float, float] = UP, *, late: float = 0.0
) -> tuple[FloatArray, FloatArray]:
    """Return times and a tip of the matrix exponential's motion, with noise."""
    t = np.arange(0.0, (200.0 - late) / rig.clock, 0.01)
    x = tip(motion(ends), FREQUENCY, D, rig, late + rig.clock * t)
    return t, x + NOISE * np.random.default_rng(3).standard_normal(t.size)


def found(rig: Rig, ends: tuple[float, float] = UP, *, late: float = 0.0) -> ResonanceFit:
    return fit(*record(rig, ends, late=late), motion(ends))


def assert_right(one: ResonanceFit) -> None:
    assert abs(one.frequency - FREQUENCY) < SIGMAS * one.frequency_error < 1e-4
    assert abs(one.damping_ratio - D) < SIGMAS * one.damping_error < 1e-4


@pytest.mark.parametrize("ends, side", [(UP, 1.0), (DOWN, -1.0)])
def test_the_bias_of_a_sweep_is_corrected(ends: tuple[float, float], side: float) -> None:
    one = found(Rig(), ends)
    assert side * (one.peak - FREQUENCY) > 0.02
    assert_right(one)
    assert one.participation == pytest.approx(1.566, rel=0.01)
    assert not one.remarks


@pytest.mark.parametrize("late", [0.2, 1.7])
@pytest.mark.parametrize("ends", [UP, DOWN])
def test_a_record_that_begins_late_is_right_and_named(
    ends: tuple[float, float], late: float
) -> None:
    one = found(Rig(), ends, late=late)
    assert_right(one)
    assert abs(one.late - late) < SIGMAS * one.late_error < 1e-2
    assert f"the record begins {late:.4g}" in one.remarks[0] and "after the sweep" in one.remarks[0]


def test_a_record_that_begins_early_is_right_and_named() -> None:
    t, x = record(Rig())
    early = fit(t + 0.2, x, motion())  # its clock says 0.2 s when the sweep begins
    assert_right(early)
    assert "begins 0.2" in early.remarks[0] and "before the sweep" in early.remarks[0]


def test_a_slow_clock_is_named_and_held_by_the_error() -> None:
    one = found(Rig(clock=1.01))
    assert abs(one.clock - 1.01) < SIGMAS * one.clock_error < 1e-4
    assert "1.01" in one.remarks[0] and "one clock is wrong" in one.remarks[0]
    assert abs(one.frequency - FREQUENCY) < 2.0 * one.frequency_error


def test_a_second_mode_is_named() -> None:
    assert any("something else moves" in text for text in found(Rig(second=0.4)).remarks)


def test_the_error_holds_what_the_model_leaves_out() -> None:
    """Damping against the air turns the phase by D: 20 errors of white noise in the frequency."""
    one = found(Rig(air=True))
    assert abs(one.frequency - FREQUENCY) < SIGMAS * one.frequency_error
    assert one.frequency_error > 2.0 * found(Rig()).frequency_error


def test_sign_and_unit_of_the_record_do_not_matter() -> None:
    t, x = record(Rig())
    plain, other = fit(t, x, motion()), fit(t, -1e3 * x, motion())
    assert other.frequency == pytest.approx(plain.frequency, abs=0.1 * plain.frequency_error)
    assert other.damping_ratio == pytest.approx(plain.damping_ratio, abs=0.1 * plain.damping_error)
    assert other.participation == pytest.approx(plain.participation, rel=1e-3)


def test_the_bending_stiffness_follows_from_the_frequency() -> None:
    thin = preset("paper").lamina[1]
    EI, error = found(Rig()).bending_stiffness(thin)
    assert EI == pytest.approx(thin.flexural_rigidity, rel=1e-4)
    assert 0.0 < error < 1e-4 * EI


def test_too_few_cycles_are_refused() -> None:
    t, x = record(Rig())
    with pytest.raises(CaseError, match="at least 8 cycles within 30 % of the peak"):
        fit(t[:2000] / 10, x[:2000] * np.exp(-t[:2000]), SweptMotion(1.0, 9.0, 2.0, 0.0025))
    with pytest.raises(CaseError, match="at least 8 cycles with 8 samples or more"):
        fit(t[:500], x[:500], motion())
    with pytest.raises(CaseError, match="at least 8 cycles with 8 samples or more"):
        fit(t[::20], x[::20], motion())


def test_errors_of_what_the_model_leaves_out_are_those_of_a_jackknife() -> None:
    """Fits without one block each, made anew: the variance of their mean is (B - 1) / B Σ d²."""
    n = 40 * BLOCKS
    rng = np.random.default_rng(4)
    jacobian = rng.normal(size=(n, 4))
    jacobian[:, 0] = 1.0  # by which the blocks are parted
    blocks = np.repeat(np.arange(BLOCKS), 40)
    residual = rng.normal(size=BLOCKS)[blocks] + 0.01 * rng.normal(size=n)
    residual -= jacobian @ np.linalg.lstsq(jacobian, residual, rcond=None)[0]
    masks = [blocks != k for k in range(BLOCKS)]
    fits = np.array([np.linalg.lstsq(jacobian[k], residual[k], rcond=None)[0] for k in masks])
    expected = (BLOCKS - 1) / BLOCKS * ((fits - fits.mean(axis=0)) ** 2).sum(axis=0)
    np.testing.assert_allclose(np.diag(_covariance(jacobian, residual))[0], expected[0], rtol=1e-6)
