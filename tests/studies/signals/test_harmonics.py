"""The frequency of a record is that of its strongest line, whatever else it holds."""

from __future__ import annotations

import numpy as np
import pytest

from delam_fem.studies.signals.comparison import strongest_frequency


@pytest.mark.parametrize("uneven", [0.0, 0.2])
def test_the_strongest_line_is_found_beside_sway_harmonics_and_noise(uneven: float) -> None:
    rng = np.random.default_rng(4)
    t = (np.arange(2000) + uneven * rng.uniform(-1.0, 1.0, 2000)) / 3000.0
    phases = rng.uniform(0.0, 2.0 * np.pi, 8)[:, None]
    rows = np.sin(2.0 * np.pi * 60.07 * t + phases)
    rows += 0.5 * np.sin(2.0 * np.pi * 120.14 * t + 3.0 * phases)
    rows += 4.0 * np.sin(2.0 * np.pi * 3.1 * t) + 7.0
    rows += rng.normal(0.0, 0.1, rows.shape)
    assert strongest_frequency(t, rows, 7.5) == pytest.approx(60.07, rel=3e-5)
    assert strongest_frequency(t, rows, 100.0) == pytest.approx(120.14, rel=3e-5)


def test_a_record_too_short_has_no_frequency() -> None:
    t = np.arange(20) / 1000.0
    assert strongest_frequency(t, np.sin(2.0 * np.pi * 60.0 * t)[None], 7.5) is None
