"""A closed delamination under pressure: linear below the threshold of `modes`, claps above it."""

from __future__ import annotations

import numpy as np
import pytest
from loads.pressed_delamination import beam, harmonics_of, resonance, threshold

import delam_fem as df


@pytest.mark.slow
@pytest.mark.parametrize("share_of_resonance", [1.0, 0.7])
def test_harmonics_begin_at_the_threshold(share_of_resonance: float) -> None:
    case = beam()
    numbers = df.modes(case, 1, delaminations="closed").report.numbers
    assert numbers is not None
    hertz = float(numbers["structure_frequency_hz"][0])  # type: ignore[index]
    assert numbers["opening_amplitude"] == pytest.approx([threshold(case, hertz)], rel=1e-6)
    # springs hold the delamination a little softer than what ties it
    assert resonance(case) == pytest.approx(hertz, rel=3e-3)
    frequency = share_of_resonance * resonance(case)
    opening = threshold(case, frequency)
    levels = [harmonics_of(case, frequency, s * opening) for s in (0.5, 0.98, 1.01, 1.05, 1.5)]
    assert np.max(levels[:2]) < -120.0
    second, *_ = np.transpose(levels[2:])
    assert -100.0 < second[0] < second[1] < second[2]
    assert np.min(levels[3:]) > -80.0
