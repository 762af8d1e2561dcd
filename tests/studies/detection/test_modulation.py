"""A linear beam has no sidebands; a delamination that claps has them."""

import numpy as np
import pytest

from delam_fem.case.definition import Case
from delam_fem.case.files import preset
from delam_fem.studies.detection import modulation as module
from delam_fem.studies.detection.indices import sideband_ratio
from delam_fem.studies.detection.modulation import Tones, modulation, two_tone
from delam_fem.studies.options import Scan
from delam_fem.system.errors import CaseError

PUMP, PROBE = 60.0, 350.0


def embedded(**keys: object) -> Case:
    small = {"mesh.elements": 20, "time.steps_per_period": 100, "excitation.frequency": PROBE}
    return preset("embedded", small | keys)


def test_both_tones_repeat_after_a_common_period() -> None:
    tones = Tones.of(embedded(), PUMP, 0.2)
    assert tones.turns == 35  # 0.1 s
    times = np.linspace(0.0, 0.01, 7)
    np.testing.assert_allclose(tones.states(times + 0.1), tones.states(times), atol=1e-9)
    w1, w2 = 2.0 * np.pi * PUMP, 2.0 * np.pi * PROBE
    expected = -0.2 * np.sin(w1 * times) - 0.1 * np.sin(w2 * times)
    np.testing.assert_allclose(tones.states(times)[:, 2], expected, atol=1e-12)


def test_an_intact_beam_has_no_sidebands_without_noise() -> None:
    found = two_tone(Tones.of(embedded(), PUMP, 0.1).intact(), Scan(periods=1))
    assert sideband_ratio(found.field, found.times, PUMP, PROBE).max() < 1e-6


def test_a_delamination_is_called_and_its_intact_structure_is_not() -> None:
    found = modulation(Tones.of(embedded(), PUMP, 0.1), Scan(periods=2))
    assert found.is_called and not found.is_intact_called
    assert found.gain > 50.0  # 235 measured
    assert np.median(found.ratio) > 0.1


def test_one_more_record_exceeds_the_limit_in_1_percent(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of 200 records and one more the largest two of all are 1 %."""
    largest = iter([*np.random.default_rng(1).permutation(200), 0.0, 0.0])
    monkeypatch.setattr(module, "sideband_ratio", lambda *_: np.array([1.0 + next(largest)]))
    found = modulation(Tones.of(embedded(), PUMP, 0.1), Scan(periods=1))
    assert found.limits == pytest.approx([198.99])


@pytest.mark.parametrize("frequency", [0.0, 50.0, 400.0, 60.0001])
def test_frequencies_that_do_not_go_together_are_refused(frequency: float) -> None:
    with pytest.raises(CaseError, match=r"^pump frequency: expected .*, given"):
        Tones.of(embedded(), frequency, 0.1)
