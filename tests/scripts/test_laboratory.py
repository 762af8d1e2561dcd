"""The page beside pyFRF and sdypy-EMA, and responses where the drive has a band."""

from __future__ import annotations

import numpy as np
import pytest
from project import script

pytest.importorskip("sdypy.EMA")
laboratory = script("laboratory")


def test_poles_of_a_noisy_record_whose_drive_has_a_band_are_found_and_h1_is_the_peers() -> None:
    """Beyond the band there is noise over noise, which must not reach the lines within it."""
    rows, numbers = laboratory.rows(0.02, duration=96)
    assert len(rows) == 2
    assert numbers["pyfrf"] < 1e-9
    assert numbers["scipy"] < 1e-3
    for mode in (1, 2):
        assert abs(numbers[f"ours_f{mode}"]) < 1e-3
        assert abs(numbers[f"ours_D{mode}"]) < 0.05
    assert numbers["ours_peak"] == pytest.approx(numbers["theirs_peak"], abs=1e-9)


def test_the_exact_modes_are_where_the_exact_response_is_largest() -> None:
    frequency = np.linspace(10.0, 130.0, 120_001)
    size = np.abs(laboratory.transmissibility(frequency))
    for f, D in laboratory.exact_modes():
        near = np.abs(frequency - f) < 5.0
        assert frequency[near][np.argmax(size[near])] == pytest.approx(f, rel=2.0 * D**2 + 1e-4)


def test_the_page_has_a_row_for_each_program_and_noise() -> None:
    text = laboratory.PAGE.read_text("utf-8")
    assert text.startswith(laboratory.HEAD)
    assert text.count("| delam_fem |") == text.count("| pyFRF, sdypy-EMA |") == 3
