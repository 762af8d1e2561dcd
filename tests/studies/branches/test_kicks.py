"""The interval of an event contains the errors by the size of kicks and by interpolation."""

from __future__ import annotations

import numpy as np
import pytest
from toys import Cubic, DelayedLogistic, Toy

from delam_fem.numerics.arrays import FloatArray
from delam_fem.studies.branches.continuation import Path, first_point, followed
from delam_fem.studies.branches.events import Event, events_of
from delam_fem.studies.branches.kicks import widened
from delam_fem.studies.orbits.ensemble import Ensemble, Perturbations

KICK = 0.1


def events(map_: Toy, start: FloatArray, path: Path) -> tuple[Event, Event]:
    """Return the event of a branch as sampled, and with its other errors."""
    ensemble = Ensemble(map_, 1, Perturbations(copies=8, size=1e-6, kick=KICK))
    points, _ = followed(
        ensemble, [first_point(ensemble, start, path)], path,
        keep=lambda point, count: None, is_stopped=lambda: False,
    )  # fmt: skip
    (sampled,) = events_of(points, path.span)
    (wider,) = widened(ensemble, [sampled], points, path.span)
    assert wider.parameter == sampled.parameter
    return sampled, wider


def test_the_error_by_kicks_is_in_the_interval() -> None:
    sampled, wider = events(Cubic(), np.array([1.0, 0.0]), Path(0.8, 1.2))
    assert sampled.parameter == pytest.approx(Cubic.doubling + KICK**2, abs=1e-4)
    assert sampled.low > Cubic.doubling + 0.5 * KICK**2  # the samples know nothing of it
    assert wider.low == pytest.approx(Cubic.doubling, abs=1e-4)
    assert wider.high == pytest.approx(Cubic.doubling + 2.0 * KICK**2, abs=1e-4)


def test_the_curvature_is_in_the_interval() -> None:
    map_ = DelayedLogistic()
    sampled, wider = events(map_, map_.fixed(1.7), Path(1.7, 2.3))
    assert wider.low <= DelayedLogistic.torus <= wider.high
    assert sampled.low >= wider.low and sampled.high <= wider.high
    assert wider.high - wider.low < 0.01
