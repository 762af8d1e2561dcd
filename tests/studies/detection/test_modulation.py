"""A linear beam has no sidebands; a delamination that claps has them."""

import numpy as np
import pytest

from delam_fem.api import Case, CaseError, preset
from delam_fem.studies.detection import modulation as module
from delam_fem.studies.detection.detect import common_turns, intact, simulated
from delam_fem.studies.detection.indices import sideband_ratio
from delam_fem.studies.detection.modulation import modulation, pump_of
from delam_fem.studies.detection.study import Modulate, Scan
from delam_fem.studies.signals.scan import amplitudes

PUMP, PROBE = 60.0, 350.0


def embedded(**keys: object) -> Case:
    small = {"mesh.elements": 20, "time.steps_per_period": 100, "excitation.frequency": PROBE}
    return preset("embedded", small | keys)


def options(periods: int) -> Modulate:
    return Modulate(pump_frequency=PUMP, pump_amplitude=0.1, periods=periods)


def test_both_tones_act_for_whole_common_periods() -> None:
    """Without contact the record is the sum of both steady motions, and repeats after 0.1 s."""
    case, scan = intact(embedded()), Scan(periods=2)
    pump = pump_of(case, PUMP, 0.2)
    assert common_turns(PUMP, PROBE) == 35
    both = simulated(case, scan, pump=pump)
    half = len(both.times) // 2
    assert both.times[half] - both.times[0] == pytest.approx(0.1)
    size = np.ptp(both.field)
    np.testing.assert_allclose(both.field[half:], both.field[:half], atol=1e-3 * size)
    for tone, frequency in ((pump, PUMP), (case, PROBE)):
        alone = simulated(tone, Scan(periods=4, sampling_rate=50 * PROBE))
        sizes, expected = (
            np.abs(amplitudes(one.field, one.times, [frequency]))[0] for one in (both, alone)
        )
        np.testing.assert_allclose(sizes, expected, rtol=0.01, atol=1e-3 * expected.max())


def test_an_intact_beam_has_no_sidebands_without_noise() -> None:
    case = intact(embedded())
    measurement = simulated(case, Scan(periods=1), pump=pump_of(case, PUMP, 0.1))
    assert sideband_ratio(measurement.field, measurement.times, PUMP, PROBE).max() < 1e-6


@pytest.mark.slow
def test_a_delamination_is_called_and_its_intact_structure_is_not() -> None:
    result = modulation(embedded(), options(2))
    assert result.mark.is_over.any() and not result.intact_mark.is_over.any()
    assert result.gain > 50.0  # 235 measured
    assert np.median(result.mark.values) > 0.1


def test_one_more_record_exceeds_the_limit_in_1_percent(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of 200 records and one more the largest two of all are 1 %."""
    largest = iter([*np.random.default_rng(1).permutation(200), 0.0, 0.0])
    monkeypatch.setattr(module, "sideband_ratio", lambda *_: np.array([1.0 + next(largest)]))
    result = modulation(embedded(), options(1))
    assert result.mark.limits == pytest.approx([198.99])


@pytest.mark.parametrize("frequency", [0.0, 50.0, 400.0, 60.0001])
def test_frequencies_that_do_not_go_together_are_refused(frequency: float) -> None:
    with pytest.raises(CaseError, match=r"^pump frequency: "):
        pump_of(embedded(), frequency, 0.1)
