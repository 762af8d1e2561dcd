from collections.abc import Callable

import numpy as np
import pytest
import xarray as xr

from delam_fem.api import CaseError
from delam_fem.studies.identification import identify

FREQUENCY = 3.25
RNG = np.random.default_rng(7)
HARMONICS = RNG.standard_normal((2, 5)) + 1j * RNG.standard_normal((2, 5))


def history(time: np.ndarray, shift: float = 0.0) -> np.ndarray:
    """Return Σ Im(c_k e^{ikωt}) with a mean, for a shifted origin of time."""
    angle = 2.0 * np.pi * FREQUENCY * (time + shift)[:, None] * np.arange(1, 6)
    return 0.3 + (np.exp(1j * angle) @ HARMONICS.T).imag.T


def test_harmonics_of_a_history_are_found() -> None:
    time = np.arange(0.0, 4.0, 0.003)
    harmonics, scatter = identify.of_history(time, history(time), FREQUENCY)
    np.testing.assert_allclose(harmonics, HARMONICS, atol=1e-10)
    assert scatter.max() < 1e-10


def test_statistics_do_not_depend_on_the_origin_of_time() -> None:
    time = np.arange(0.0, 4.0, 0.003)
    here, _ = identify.of_history(time, history(time), FREQUENCY)
    there, _ = identify.of_history(time, history(time, shift=0.123), FREQUENCY)
    assert not np.allclose(here, there, atol=0.1)
    invariants = identify.invariant(here)
    np.testing.assert_allclose(identify.invariant(there), invariants, atol=1e-10)
    assert invariants.shape == (19,)
    assert invariants[0] == pytest.approx(abs(HARMONICS[0, 0]))


def test_noise_is_found_as_scatter_and_harmonics_have_its_error() -> None:
    time = np.arange(0.0, 20.0, 0.003)
    rng, deviations = np.random.default_rng(1), []
    for _ in range(20):
        noise = 0.1 * rng.standard_normal((2, time.size))
        harmonics, scatter = identify.of_history(time, history(time) + noise, FREQUENCY)
        assert scatter == pytest.approx(0.1, rel=0.05)
        deviations.append(np.abs(harmonics - HARMONICS))
    expected = 0.1 * np.sqrt(2.0 * 2.0 / time.size)  # both parts
    assert np.sqrt(np.mean(np.square(deviations))) == pytest.approx(expected, rel=0.15)


def test_higher_harmonics_of_an_impact_are_no_noise() -> None:
    time = np.arange(0.0, 20.0, 0.003)
    cusp = np.abs(np.sin(np.pi * FREQUENCY * time))  # its harmonics fall as 1/k²
    noise = 2e-3 * np.random.default_rng(1).standard_normal((2, time.size))
    harmonics, scatter = identify.of_history(time, cusp + noise, FREQUENCY)
    assert scatter == pytest.approx(2e-3, rel=0.1)  # 0.013 with five harmonics
    k = np.arange(1, 6)
    np.testing.assert_allclose(np.abs(harmonics[0]), 4.0 / np.pi / (4 * k**2 - 1), atol=2e-4)


@pytest.mark.parametrize("envelope", [lambda t: np.exp(-t), lambda t: (t > 1.0) & (t < 1.9)])
def test_decays_and_bursts_are_no_steady_motions(envelope: Callable[..., np.ndarray]) -> None:
    time = np.arange(0.0, 4.0, 0.003)
    with pytest.raises(CaseError, match=r"expected a steady motion at 3\.25 Hz"):
        identify.of_history(time, envelope(time) * (history(time) - 0.3), FREQUENCY)
    slowly = 1.0 + 0.3 * np.sin(1.5 * time)  # a beat is no burst
    identify.of_history(time, slowly * history(time), FREQUENCY)


def test_points_of_a_sweep_have_amplitude_and_phase() -> None:
    size, phase = RNG.uniform(1.0, 2.0, (2, 3, 5)), RNG.uniform(-3.0, 3.0, (2, 3, 5))
    dims = ("exponent", "harmonic")
    sweep = xr.Dataset(
        {f"{name}_harmonic_{part}": (dims, values[k])
         for k, name in enumerate(("tip_thin", "a1"))
         for part, values in (("amplitude", size), ("phase", phase))}
    )  # fmt: skip
    harmonics = identify.of_points(sweep, ("tip_thin", "a1"))
    expected = (size * np.exp(1j * phase)).swapaxes(0, 1)
    np.testing.assert_allclose(harmonics, expected)


@pytest.mark.parametrize("time", [np.linspace(0.0, 4.0, 20), np.linspace(0.0, 0.4, 2000)])
def test_short_histories_are_refused(time: np.ndarray) -> None:
    with pytest.raises(CaseError, match="at least 44 samples and two periods"):
        identify.of_history(time, np.zeros((2, time.size)), FREQUENCY)
