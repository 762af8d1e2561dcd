"""Which excitation: what is recommended, what is avoided, and the part of an opening."""

import json
import math
from pathlib import Path

import numpy as np
import pytest

from delam_fem.api import CaseError, preset
from delam_fem.studies.detection.detect import detect, intact
from delam_fem.studies.detection.excitation import (
    RATIOS,
    ExcitationMap,
    excitation_figure,
    excitation_map,
)

COARSE = {"mesh.elements": 20}


def short(directory: Path, noise_db: float) -> ExcitationMap:
    """A delamination of a tenth of the length, near the clamp."""
    case = preset("embedded", COARSE | {"delamination.1.start": 0.05, "delamination.1.end": 0.09})
    return excitation_map(
        case, np.array([60.0, 360.0]), directory, "serial", noise_db=noise_db, resume=True
    )


def test_a_short_delamination_needs_a_high_frequency_and_little_noise(tmp_path: Path) -> None:
    map_ = short(tmp_path, 40.0)
    assert map_.calls.tolist() == [[0.0, 1.0]]
    assert map_.recommended == (0, 1)
    assert map_.reason.startswith("360 Hz: ")
    assert map_.error[0, 1] <= 0.01
    hidden = short(tmp_path, 20.0)
    assert hidden.recommended is None
    assert hidden.reason.startswith("No excitation is called in 90 %")
    map_.save(tmp_path)
    numbers = json.loads((tmp_path / "excitation.json").read_text("utf-8"))
    assert numbers["recommended_frequency"] == 360.0
    assert numbers["ratio"] == [None]
    assert numbers["error"][0][0] is None


def test_doubles_of_resonances_are_avoided(tmp_path: Path) -> None:
    map_ = excitation_map(preset("embedded", COARSE), np.array([80.0, 150.0]), tmp_path, "serial")
    assert np.abs(map_.beam_modes - 300.0).min() < 5.0
    assert map_.is_avoided.tolist() == [False, True]
    assert map_.contrast[0, 0] > 5.0 * map_.contrast[0, 1]
    assert map_.recommended == (0, 0)
    assert "Avoided, as their doubles are resonances" in map_.reason


def test_an_opening_claps_only_if_the_motion_closes_it(tmp_path: Path) -> None:
    case = preset("embedded", COARSE | {"delamination.1.opening": 1e-5})
    map_ = excitation_map(case, np.array([50.0]), tmp_path, "serial")
    assert map_.ratios.tolist() == list(RATIOS)
    assert map_.visibility[0, 0] > 1.0 > map_.visibility[-1, 0]
    wider = case.with_overrides({"delamination.1.opening": 1e-4})  # g₀/A is what matters
    again = excitation_map(wider, np.array([50.0]), tmp_path / "wider", "serial")
    np.testing.assert_allclose(again.visibility[:2], map_.visibility[:2], rtol=1e-3)


def test_a_beam_without_delamination_has_no_map(tmp_path: Path) -> None:
    with pytest.raises(CaseError, match=r"expected a case with \[\[delamination\]\]"):
        excitation_map(intact(preset("embedded")), np.array([50.0]), tmp_path)


def test_a_frequency_is_as_good_as_its_neighbours() -> None:
    case, one = preset("embedded"), np.ones((1, 5))
    visibility = np.array([[54.0, 9.0, 12.0, 11.0, 13.0]])
    none = np.zeros(0)
    map_ = ExcitationMap(
        case, 40.0, np.array([320.0, 330.0, 340.0, 350.0, 360.0]), np.array([math.nan]),
        np.array([0.0, 0.01]), np.ones((1, 5, 2)), 5.0 * one, visibility, one, 0.0 * one, none,
        none, one,
    )  # fmt: skip
    np.testing.assert_array_equal(map_.worst, [[9.0, 9.0, 9.0, 11.0, 11.0]])
    assert map_.recommended == (0, 3)  # not 320 Hz, beside which little is seen
    assert "neighbouring frequencies the index is at least 11.0 times its limit" in map_.reason


def test_motions_that_fail_are_told_and_show_nothing(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    case = preset("embedded", COARSE | {"time.scheme": "central-difference"})
    told = "excitation: 1 of {} motions failed: time.steps_per_period: the scheme needs"
    with pytest.raises(CaseError, match=told.format(1)):
        excitation_map(case, np.array([40.0]), tmp_path / "a", "serial")
    map_ = excitation_map(case, np.array([40.0, 4000.0]), tmp_path / "b", "serial")
    assert told.format(2) in caplog.text and "they show nothing" in caplog.text
    assert np.isnan(map_.visibility[0]).tolist() == [True, False]
    assert map_.worst.tolist() == [[map_.visibility[0, 1]] * 2]


def test_the_map_sees_what_a_scan_sees(tmp_path: Path) -> None:
    """170 Hz: once misled by a resonance near the double; 310 Hz: motion between the harmonics."""
    case = preset("embedded", COARSE)
    map_ = excitation_map(case, np.array([170.0, 310.0]), tmp_path, "serial")
    assert not map_.is_avoided.any()
    assert map_.error.max() <= 0.01
    assert map_.contrast[0, 0] > 10.0  # 2.5 without taking away harmonics of the drive
    scan = detect(case.with_overrides({"excitation.frequency": 310.0}))
    largest = scan.mark.over_limits.max()
    assert map_.visibility[0, 1] < 3.0 * largest  # 4.8 times without the motion between harmonics


def test_a_force_has_no_ratio(tmp_path: Path) -> None:
    force = {
        "excitation.kind": "force",
        "excitation.lamina": "upper",
        "excitation.position": 0.2,
        "excitation.amplitude": 0.1,
        "excitation.frequency": 80.0,
        "lamina.upper.thickness": 0.001,
        "lamina.lower.thickness": 0.001,
    }
    map_ = excitation_map(preset("embedded", COARSE | force), np.array([80.0]), tmp_path, "serial")
    assert math.isnan(map_.ratios[0])
    assert map_.calls[0, 0] == 1.0  # a force on one lamina opens what base motion does not
    one, other, *_ = excitation_figure(map_).axes  # of one frequency alone
    for axes in (one, other):
        assert axes.get_xlim()[0] < 80.0 < axes.get_xlim()[1]
    left, right = one.collections[0].get_coordinates()[0, [0, -1], 0]
    assert left < 79.5 and 80.5 < right
