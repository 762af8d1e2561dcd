"""Spectra of records beside sums of sines, variances and known filters."""

from __future__ import annotations

import numpy as np
from scipy.signal import freqz, lfilter

from delam_fem.numerics.spectra import densities, h1, lines_of_periods

N, STEP = 128, 0.01


def test_lines_are_the_amplitudes_of_each_period_of_each_realisation() -> None:
    """What is before the last whole periods is left out."""
    t = np.arange(N) / N
    amplitudes = np.array([[1.0, 2.0], [3.0 + 1j, -4j]])  # realisations, lines 3 and 10
    periods = [(c * np.exp(2j * np.pi * np.outer(t, [3, 10]))).sum(axis=1).real for c in amplitudes]
    record = np.concatenate([[7.0] * 5, periods[0], periods[0], periods[1], 2.0 * periods[1]])
    lines = lines_of_periods(record[None], N, 2)
    assert lines.shape == (1, 2, 2, N // 2 - 1)
    np.testing.assert_allclose(lines[0, 0, :, [2, 9]], [[1.0, 1.0], [2.0, 2.0]], atol=1e-13)
    np.testing.assert_allclose(lines[0, 1, 1, [2, 9]], 2.0 * amplitudes[1], atol=1e-13)
    others = np.delete(lines, [2, 9], axis=3)
    assert np.abs(others).max() < 1e-13


def test_a_density_is_one_sided_and_its_integral_is_the_variance() -> None:
    noise = np.random.default_rng(1).standard_normal((2, 40_000)) * [[1.0], [3.0]]
    frequency, density = densities(noise, STEP, 400)
    assert frequency[-1] == 0.5 / STEP
    variance = density.sum(axis=1) * (frequency[1] - frequency[0])
    np.testing.assert_allclose(variance, noise.var(axis=1), rtol=0.02)


def test_h1_is_the_response_of_a_filter_with_noise_behind_it() -> None:
    """A sign of i that is turned, or S_xf for S_fx, would turn its phase."""
    rng = np.random.default_rng(2)
    force = rng.standard_normal(60_000)
    motion = lfilter([0.2, 0.1], [1.0, -0.6], force)
    noisy = motion + 0.1 * rng.standard_normal(force.size)
    H = h1(force, np.stack([motion, noisy]), STEP, 256)
    w = 2.0 * np.pi * np.fft.rfftfreq(256)
    _, exact = freqz([0.2, 0.1], [1.0, -0.6], w[1:-1])
    np.testing.assert_allclose(H[0, 1:-1], exact, atol=0.01)
    np.testing.assert_allclose(H[1, 1:-1], exact, atol=0.03)


def test_where_there_is_no_force_there_is_no_response() -> None:
    assert np.all(h1(np.zeros(512), np.ones((1, 512)), STEP, 128) == 0.0)
    assert lines_of_periods(np.zeros((1, 100)), 40).shape == (1, 1, 2, 19)
