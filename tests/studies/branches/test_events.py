"""The interval of an event contains the errors by the size of kicks and by interpolation."""

from __future__ import annotations

import numpy as np
import pytest
from toys import Cubic, DelayedLogistic, Toy

from delam_fem.numerics.arrays import FloatArray
from delam_fem.studies.branches.continuation import Path, first_point, followed
from delam_fem.studies.branches.events import Event, events_of
from delam_fem.studies.orbits.ensemble import Ensemble, Perturbations

KICK = 0.1


def event(map_: Toy, start: FloatArray, path: Path, kick: float) -> Event:
    """Return the only event of a branch."""
    ensemble = Ensemble(map_, 1, Perturbations(copies=8, size=1e-6, kick=kick))
    points, _ = followed(
        ensemble, [first_point(ensemble, start, path)], path,
        keep=lambda point, count: None, is_stopped=lambda: False,
    )  # fmt: skip
    (found,) = events_of(points, path.span)
    return found


def test_the_error_by_kicks_is_in_the_interval() -> None:
    """A two-sided kick of 0.1 sees the doubling 0.01 too late."""
    found = event(Cubic(), np.array([1.0, 0.0]), Path(0.8, 1.2), KICK)
    assert found.parameter == pytest.approx(Cubic.doubling, abs=KICK**2)
    assert found.low <= Cubic.doubling <= found.high
    assert found.high - found.low < 4.0 * KICK**2


def test_the_curvature_is_in_the_interval() -> None:
    map_ = DelayedLogistic()
    found = event(map_, map_.fixed(1.7), Path(1.7, 2.3), 0.01)
    assert found.low - 2e-4 <= DelayedLogistic.torus <= found.high
    assert found.high - found.low < 0.02
