"""Complex shapes of synthetic fields with known amplitudes, phases and noise."""

import math

import numpy as np
import pytest

from delam_fem.studies.signals.scan import Shapes, amplitudes, shapes_of

F = 7.0
X = np.linspace(0.0, 1.0, 11)
KNOWN = {0.5: 0.3 * X, 1.0: np.exp(2j * X), 2.0: (0.2 - 0.1j) * X**2, 3.0: 0.05j * (1.0 - X)}


def field_of(times: np.ndarray, known: dict[float, np.ndarray]) -> np.ndarray:
    phases = {k: np.exp(2j * math.pi * k * F * times)[:, None] for k in known}
    return 0.7 + sum((phases[k] * V).real for k, V in known.items())


def test_known_shapes_come_back_with_their_phases() -> None:
    times = np.arange(16 * 20) / (20 * F)
    shapes = shapes_of(field_of(times, KNOWN), times, F, X)
    for k, V in KNOWN.items():
        np.testing.assert_allclose(shapes.order(k), V, atol=1e-12)
    np.testing.assert_allclose(shapes.order(4.0), 0.0, atol=1e-12)
    assert np.max(shapes.noise) < 1e-12


def test_samples_that_are_not_locked_to_the_excitation_give_the_same() -> None:
    times = 0.013 + np.arange(300) / 133.7  # 15.7 periods
    shapes = shapes_of(field_of(times, KNOWN), times, F, X, orders=tuple(KNOWN))
    for k, V in KNOWN.items():
        np.testing.assert_allclose(shapes.order(k), V, atol=1e-10)


def test_the_noise_between_the_harmonics_is_that_of_the_shapes() -> None:
    times = np.arange(16 * 50) / (50 * F)
    noise = np.random.default_rng(3).normal(scale=0.1, size=(times.size, 200))
    x = np.linspace(0.0, 1.0, 200)
    still = {k: np.interp(x, X, V.real) for k, V in KNOWN.items()}
    shapes = shapes_of(field_of(times, still) + noise, times, F, x)
    expected = 2.0 * 0.1 / math.sqrt(times.size)  # E|δV|² = 4 σ²/n
    assert np.sqrt(np.mean(np.square(shapes.noise))) == pytest.approx(expected, rel=0.03)
    assert np.shape(shapes.noise) == (200,) and shapes.n_lines == 14
    error = shapes.order(2.0) - still[2.0]
    assert np.sqrt(np.mean(np.abs(error) ** 2)) == pytest.approx(expected, rel=0.1)


def test_orders_above_half_the_sampling_rate_are_left_out() -> None:
    times = np.arange(8 * 6) / (6 * F)
    assert shapes_of(field_of(times, KNOWN)[:, :2], times, F, X[:2]).orders == (0.5, 1.0, 2.0)


def test_a_short_record_is_refused() -> None:
    times = np.arange(3 * 20) / (20 * F)
    with pytest.raises(ValueError, match=r"at least 4 periods of 7 Hz, given 3"):
        shapes_of(field_of(times, KNOWN), times, F, X)


def test_amplitudes_at_any_frequencies() -> None:
    times = np.arange(400) / 100.0
    signal = 2.0 * np.cos(2 * math.pi * 3.0 * times) - 0.5 * np.sin(2 * math.pi * 4.1 * times)
    sizes = amplitudes(signal[:, None], times, [3.0, 4.1])
    np.testing.assert_allclose(sizes[:, 0], [2.0, 0.5j], atol=1e-12)


def test_added_noise_has_its_root_mean_square() -> None:
    times = np.arange(16 * 20) / (20 * F)
    shapes = shapes_of(field_of(times, KNOWN), times, F, X)
    rng = np.random.default_rng(1)
    many = np.stack([shapes.noisy(0.2, rng).order(2.0) - shapes.order(2.0) for _ in range(500)])
    assert np.sqrt(np.mean(np.abs(many) ** 2)) == pytest.approx(0.2, rel=0.05)
    assert abs(np.mean(many)) < 0.02


def test_a_harmonic_of_the_drive_is_taken_away_and_a_delamination_left() -> None:
    x = np.linspace(0.0, 1.0, 41)
    response = np.sin(5.0 * x) + 1.0 + 0.3j * np.cos(3.0 * x)
    bulge = np.where((x > 0.3) & (x < 0.6), np.sin(np.pi * (x - 0.3) / 0.3) ** 2, 0.0)
    values = np.stack([x + 0j, bulge + (0.4 - 2.0j) * response])
    for noise in (0.0, 1e-3, np.full(x.size, 1e-3)):
        shapes = Shapes(x, F, (1.0, 2.0), values, noise)
        left = shapes.without_drive({2.0: response, 3.0: response})
        np.testing.assert_allclose(left.order(2.0), bulge, atol=5e-3)
        np.testing.assert_array_equal(left.order(1.0), x)


def test_what_is_not_the_drives_harmonic_stays() -> None:
    x = np.linspace(0.0, 1.0, 41)
    other = np.cos(9.0 * x)
    left = Shapes(x, F, (2.0,), other[None] + 0j, 1e-3).without_drive({2.0: x**2 + 0j})
    left = np.diff(left.order(2.0), 2)
    assert np.linalg.norm(left - np.diff(other, 2)) < 0.5 * np.linalg.norm(left)


def test_a_record_may_begin_late() -> None:
    times = 40.0 + np.arange(16 * 20) / (20 * F)
    shapes = shapes_of(field_of(times, KNOWN), times, F, X)
    assert shapes.n_lines == shapes_of(field_of(times - 40.0, KNOWN), times - 40.0, F, X).n_lines
    for k, V in KNOWN.items():
        np.testing.assert_allclose(shapes.order(k), V, atol=1e-10)
