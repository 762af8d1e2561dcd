import numpy as np
import pytest

from delam_fem.numerics.harmonics import (
    amplitude_spectrum,
    distortion_factor,
    harmonic_amplitudes,
    harmonic_phases,
    total_harmonic_distortion,
)

ROUND_OFF = 1e-12
"""Amplitudes are of order 1, and a transform of some hundred samples loses few digits."""


def samples(n: int, n_periods: int) -> np.ndarray:
    """Return 0.5 + 3 cos(wt + 1) + 0.4 sin(2wt) + 0.01 cos(5wt) + 2 sin(wt/2)."""
    t = 2.0 * np.pi * n_periods * np.arange(n) / n
    return (
        0.5
        + 3.0 * np.cos(t + 1.0)
        + 0.4 * np.sin(2.0 * t)
        + 0.01 * np.cos(5.0 * t)
        + 2.0 * np.sin(0.5 * t)
    )


@pytest.mark.parametrize("n", [400, 404])
def test_known_amplitudes_stand_in_their_bins(n: int) -> None:
    expected = np.zeros(n // 2 + 1)
    expected[[0, 2, 4, 8, 20]] = [0.5, 2.0, 3.0, 0.4, 0.01]
    spectrum = amplitude_spectrum(samples(n, 4))
    np.testing.assert_allclose(spectrum, expected, rtol=0, atol=ROUND_OFF)


def test_amplitude_at_half_the_sampling_rate_is_not_doubled() -> None:
    spectrum = amplitude_spectrum(np.array([1.0, -1.0] * 3))
    np.testing.assert_allclose(spectrum, [0.0, 0.0, 0.0, 1.0], atol=ROUND_OFF)


def test_odd_number_of_samples() -> None:
    spectrum = amplitude_spectrum(2.0 * np.cos(2.0 * np.pi * 3 * np.arange(7) / 7))
    np.testing.assert_allclose(spectrum, [0.0, 0.0, 0.0, 2.0], atol=ROUND_OFF)


def test_harmonics_leave_the_subharmonic_out() -> None:
    amplitudes = harmonic_amplitudes(np.stack([samples(400, 4), samples(400, 4) / 2]), 4)
    assert amplitudes.shape == (2, 49)  # 50 would be Nyquist's
    np.testing.assert_allclose(amplitudes[0, :6], [3.0, 0.4, 0, 0, 0.01, 0], atol=ROUND_OFF)
    np.testing.assert_allclose(amplitudes[1], amplitudes[0] / 2, atol=ROUND_OFF)


def test_phases_belong_to_sines_of_a_base_that_starts_one_step_earlier() -> None:
    t = 2.0 * np.pi * np.arange(1, 401) / 100
    values = 0.5 + 3.0 * np.sin(t + 1.0) + 0.4 * np.sin(2.0 * t - 2.0) + np.cos(3.0 * t)
    phases = harmonic_phases(values, 4)
    np.testing.assert_allclose(phases[:3], [1.0, -2.0, np.pi / 2], atol=ROUND_OFF)


@pytest.mark.parametrize("n_periods", [0, 3])
def test_a_broken_period_is_refused(n_periods: int) -> None:
    with pytest.raises(ValueError, match=f"whole number of samples in each of {n_periods} periods"):
        harmonic_amplitudes(np.zeros(400), n_periods)


def test_distortion_by_definition() -> None:
    A = np.array([[4.0, 3.0, 0.0], [1.0, 1e-9, 0.0]])
    np.testing.assert_allclose(total_harmonic_distortion(A), [0.75, 1e-9], rtol=1e-14)
    # sqrt(16 + 9)/4 - 1, and the leading term of sqrt(1 + THD^2) - 1, which must not cancel
    np.testing.assert_allclose(distortion_factor(A), [0.25, 0.5e-18], rtol=1e-14)


@pytest.mark.parametrize("amplitudes", [np.zeros((2, 3)), np.zeros((2, 0))])
def test_no_basic_oscillation_has_no_distortion(amplitudes: np.ndarray) -> None:
    assert np.isnan(total_harmonic_distortion(amplitudes)).tolist() == [True, True]
    assert np.isnan(distortion_factor(amplitudes)).tolist() == [True, True]


@pytest.mark.parametrize("n", [5, 6, 7, 8, 9, 10])
def test_every_bin_has_the_amplitude_that_was_put_in(n: int) -> None:
    bins = np.arange(n // 2 + 1)
    put_in = 1.0 + bins
    samples = (put_in[:, None] * np.cos(2.0 * np.pi * bins[:, None] * np.arange(n) / n)).sum(axis=0)
    np.testing.assert_allclose(amplitude_spectrum(samples), put_in, rtol=ROUND_OFF)
    # harmonics of one period: all bins but the mean and Nyquist's
    amplitudes = harmonic_amplitudes(samples, 1)
    np.testing.assert_allclose(amplitudes, put_in[1 : (n + 1) // 2], rtol=ROUND_OFF)


@pytest.mark.parametrize("shape", [(), (2,), (3, 2)])
def test_distortion_of_any_shape(shape: tuple[int, ...]) -> None:
    A = np.broadcast_to([4.0, 0.0, 3.0], (*shape, 3))
    np.testing.assert_allclose(total_harmonic_distortion(A), np.full(shape, 0.75), rtol=1e-14)
    np.testing.assert_allclose(distortion_factor(A), np.full(shape, 0.25), rtol=1e-14)
    assert total_harmonic_distortion(np.zeros((*shape, 0))).shape == shape
    assert np.isnan(total_harmonic_distortion(np.zeros((*shape, 0)))).all()
