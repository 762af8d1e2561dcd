import numpy as np
import pytest

from delam_fem.case.files import preset
from delam_fem.case.motion.excitation import SweptMotion
from delam_fem.case.toml import CaseError
from delam_fem.numerics.oscillator import stationary, swept
from delam_fem.studies.identification.resonance import Amplitudes, demodulated, fit

FREQUENCY, D, PARTICIPATION = 1.4357, 0.008, 1.566


def swept_amplitudes(start: float, end: float) -> Amplitudes:
    """Return the amplitudes of a 30-minute swept sine."""
    time = np.linspace(0.0, 1800.0, 9001)
    f = start + (end - start) * time / 1800.0
    a = swept(time, 2.0 * np.pi * f, 2.0 * np.pi * FREQUENCY, D, PARTICIPATION)
    return Amplitudes(f, np.abs(1.0 + a), time)


@pytest.mark.parametrize("ends, peak", [((0.5, 4.0), 1.462), ((4.0, 0.5), 1.410)])
def test_the_bias_of_a_sweep_is_corrected(ends: tuple[float, float], peak: float) -> None:
    found = fit(swept_amplitudes(*ends))
    assert found.peak == pytest.approx(peak, abs=0.002)  # as docs/paper.md measures it
    assert found.frequency == pytest.approx(FREQUENCY, rel=1e-5)
    assert found.damping_ratio == pytest.approx(D, rel=1e-3)
    assert found.participation == pytest.approx(PARTICIPATION, rel=1e-3)


def test_a_stepped_sine_has_no_bias_and_errors_of_the_size_of_the_noise() -> None:
    rng = np.random.default_rng(3)
    f = np.linspace(1.2, 1.7, 101)
    exact = np.abs(1.0 + stationary(2.0 * np.pi * f, 2.0 * np.pi * FREQUENCY, D, PARTICIPATION))
    away = []
    for _ in range(30):
        found = fit(Amplitudes(f, exact + 0.5 * rng.standard_normal(f.size)))
        away.append(
            [
                (found.frequency - FREQUENCY) / found.frequency_error,
                (found.damping_ratio - D) / found.damping_error,
            ]
        )
    assert np.all(np.abs(np.mean(away, axis=0)) < 0.6)  # 3 standard errors of 30
    assert np.all((np.std(away, axis=0) > 0.6) & (np.std(away, axis=0) < 1.4))


def test_the_bending_stiffness_follows_from_the_frequency() -> None:
    thin = preset("paper").lamina[1]
    EI, error = fit(swept_amplitudes(0.5, 4.0)).bending_stiffness(thin)
    assert EI == pytest.approx(thin.flexural_rigidity, rel=1e-4)
    assert error < 1e-3 * EI


def test_amplitudes_of_a_noisy_history_are_found() -> None:
    motion = SweptMotion(1.2, 1.7, 200.0, 0.0025)
    time = np.arange(0.0, 200.0, 0.01)
    f = motion.instantaneous_frequency(time)
    relative = swept(time, 2.0 * np.pi * f, 2.0 * np.pi * FREQUENCY, D, PARTICIPATION)
    turns = 1.2 * time + 0.5 * 0.5 / 200.0 * time**2
    exact = 0.0025 * ((1.0 + relative) * np.exp(2j * np.pi * turns)).real
    noise = 1e-3 * np.random.default_rng(4).standard_normal(time.size)
    found = fit(demodulated(time, exact + noise, motion, 0.0025))
    assert found.frequency == pytest.approx(FREQUENCY, rel=1e-4)
    assert found.damping_ratio == pytest.approx(D, rel=0.02)


def test_too_few_amplitudes_are_refused() -> None:
    f = np.linspace(1.4, 1.5, 5)
    with pytest.raises(CaseError, match="at least 8 amplitudes within 30 % of the peak"):
        fit(Amplitudes(f, np.ones(5)))
    with pytest.raises(CaseError, match="at least 8 cycles"):
        demodulated(np.linspace(0.0, 1.0, 50), np.zeros(50), SweptMotion(1.0, 2.0, 1.0, 1.0), 1.0)
