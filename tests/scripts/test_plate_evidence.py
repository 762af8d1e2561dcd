"""Evidence on plates: what is drawn, and how calls are counted."""

import numpy as np
import plate_find
import pytest

from delam_fem.studies.detection.maps import patches_of
from delam_fem.studies.detection.region import Region


def test_plates_have_their_patches_within_and_differ():
    plates = plate_find.drawn(40)
    assert plates[:5] == plate_find.drawn(5)
    for specimen in plates:
        (outline,) = patches_of(specimen.case).outlines
        low, high = outline.min(axis=0), outline.max(axis=0)
        assert (low >= [0.01 - 1e-9, -0.065 - 1e-4]).all()
        assert (high <= [0.19 + 1e-4, 0.065 + 1e-4]).all()
        assert 0.15 <= specimen.depth <= 0.45
        assert 0.0025 <= specimen.damping <= 0.01
    areas = [patches_of(specimen.case).area for specimen in plates]
    assert np.ptp(areas) > 1e-3


def test_calls_misses_and_false_places_are_counted():
    square = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    truth = Region((square,))
    called = plate_find.described(Region((0.5 * square,)), 3.0, truth)
    beside = plate_find.described(Region((square + 2.0,)), 2.0, truth)
    missed = plate_find.described(Region(), 0.5, truth)
    assert called["overlap"] == pytest.approx(0.25, abs=0.01)
    words = [plate_find.outcome(one) for one in (called, beside, missed)]
    assert words == ["called", "false", "missed"]
    keys = [*(f"{f:g}" for f in plate_find.FREQUENCIES), plate_find.ALL]
    data = {
        "plates": [
            {"found": {key: dict.fromkeys(plate_find.INDICES, one) for key in keys}}
            for one in (called, called, beside, missed)
        ],
        "healthy": {key: dict.fromkeys(plate_find.INDICES, 0.01) for key in keys[:-1]},
    }
    row = plate_find.table(data).splitlines()[-1]
    assert [cell.strip() for cell in row.split("|")[3:8]] == ["2", "1", "1", "0.25", "3.0 %"]
