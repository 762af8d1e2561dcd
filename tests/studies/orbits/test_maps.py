"""The map of a case is the run of the case, wherever its periods begin."""

from __future__ import annotations

import numpy as np
import pytest

import delam_fem as df
from delam_fem.api import CaseError, assemble, session_of
from delam_fem.studies.orbits.maps import FREQUENCY, CaseFamily
from delam_fem.studies.orbits.search import settled

SMALL = {
    "mesh.elements": 4, "time.steps_per_period": 200, "time.periods": 30,
    "output.fields_per_period": 0,
}  # fmt: skip
BEFORE_CHAOS = 1e-6
"""Relative: round-off grows by contact in some periods."""


@pytest.mark.parametrize("name", ["paper", "default"])
def test_the_map_is_the_run(name: str) -> None:
    case = df.preset(name, {**SMALL, "time.periods": 3})
    structure = assemble(case, needs_dolfinx=False)
    with session_of(case, structure.operators) as opened:
        assert opened.run() == "completed"
        motion = opened.engine.state().motion[:2]
        strobe = opened.recorder.strobe[:, 0]
    map_ = CaseFamily(case, FREQUENCY).map()
    state = np.zeros(map_.slow.basis.shape[0])
    trajectory = map_.trajectory(state, 3.25, 3)
    assert trajectory.states[-1] == pytest.approx(motion.ravel(), rel=BEFORE_CHAOS, abs=1e-9)
    assert trajectory.strobes == pytest.approx(strobe, rel=BEFORE_CHAOS, abs=1e-9)
    assert map_.after(trajectory.states[:1], 3.25)[0] == pytest.approx(
        trajectory.states[1], abs=1e-12
    )


def test_periods_may_begin_where_the_tips_are_far_apart() -> None:
    case = df.preset("paper", {**SMALL, "contact.law": "none"})
    map_ = CaseFamily(case, FREQUENCY).map()
    state = settled(map_, 3.25, np.zeros(map_.slow.basis.shape[0]), 20)
    other, begun = map_.started_at_widest_gap(state, 3.25)
    trajectory, shifted = map_.trajectory(state, 3.25, 2), other.trajectory(begun, 3.25, 2)
    # the same motion: strobes are taken where the drive begins anew
    assert shifted.strobes[0] == pytest.approx(trajectory.strobes[0], rel=1e-9)
    assert shifted.openings[0] >= trajectory.openings[0]
    tips = 0.012 + trajectory.history[:, 1] - trajectory.history[:, 0]
    assert shifted.openings[0] == pytest.approx(tips.max(), rel=0.05)


def test_slow_coordinates_read_what_they_write() -> None:
    slow = CaseFamily(df.preset("paper", SMALL), FREQUENCY).map().slow
    assert slow.dual @ slow.basis == pytest.approx(np.eye(8), abs=1e-9)


def test_a_drive_that_does_not_repeat_is_refused() -> None:
    sweep = df.preset("paper", {
        "excitation.kind": "sweep", "excitation.start_frequency": 1.0,
        "excitation.end_frequency": 2.0, "excitation.duration": 10.0,
    })  # fmt: skip
    with pytest.raises(CaseError, match="repeats after each period"):
        CaseFamily(sweep, FREQUENCY)
