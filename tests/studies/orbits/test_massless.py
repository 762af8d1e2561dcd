"""The map of a case in modes, as studies of orbits use it."""

import numpy as np
import pytest
from massless import massless

import delam_fem as df
from delam_fem.api import FloatArray, assemble, session_of
from delam_fem.studies.orbits.maps import ModalMap


@pytest.fixture(scope="module")
def strobe() -> ModalMap:
    return ModalMap(massless(5, 8, mesh__elements=8, time__steps_per_period=250))


def moving(strobe: ModalMap, periods: int) -> FloatArray:
    """Return the state some periods after rest."""
    states = np.zeros((1, strobe.slow.basis.shape[0]))
    for _ in range(periods):
        states = strobe.after(states, 3.25)
    return np.asarray(states[0])


def test_slow_coordinates_are_the_lowest_two_modes_of_each_lamina(strobe: ModalMap) -> None:
    slow = strobe.slow
    np.testing.assert_allclose(slow.dual @ slow.basis, np.eye(8), atol=1e-12)
    model = strobe.at(3.25).periods.reduced
    chosen = np.flatnonzero(slow.dual[:4, : model.n_modes].any(axis=0))
    second = int(np.flatnonzero(np.diff(model.squares) < 0.0)[0]) + 1  # its first mode
    assert chosen.tolist() == [0, 1, second, second + 1]
    state = np.zeros(strobe.slow.basis.shape[0])
    state[chosen[0]] = 1e-3
    energy, strain = strobe.at(3.25).periods.energies(state)
    assert energy == 0.0
    assert 0.5 * float(slow.of(state) @ slow.of(state)) == pytest.approx(strain)


def test_the_parameter_changes_the_map_and_the_passage_sees_it(strobe: ModalMap) -> None:
    start = moving(strobe, 3)
    after = strobe.after(np.stack([start, start]), 3.25)
    np.testing.assert_array_equal(after[0], after[1])
    assert np.abs(strobe.after(start[None], 3.3)[0] - after[0]).max() > 1e-6
    trajectory = strobe.trajectory(start, 3.25, 2)
    np.testing.assert_array_equal(trajectory.states[0], after[0])
    np.testing.assert_array_equal(trajectory.states[1], strobe.after(after[:1], 3.25)[0])
    assert trajectory.strobes.shape == (2, 2)
    assert (trajectory.low < trajectory.strobes.min(axis=0) + 1e-15).all()
    assert (trajectory.high > trajectory.strobes.max(axis=0) - 1e-15).all()
    assert -1e-9 < trajectory.smallest_gap < 0.012


def test_channels_of_the_map_are_those_of_the_run() -> None:
    """Three periods after two: the engine of runs gives velocities and contact forces."""
    sizes = {"mesh__elements": 8, "time__steps_per_period": 250}
    case = massless(5, 8, **sizes, time__periods=5, output__window_periods=3)
    begun = case.with_overrides({"time.periods": 2, "output.window_periods": 1})
    with session_of(begun, assemble(begun, needs_dolfinx=False).operators) as opened:
        opened.run()
        state = opened.engine.state().internal
    assert state is not None
    names = ["tip_thin", "tip_thin_velocity", "contact_thick-thin"]
    history = ModalMap(case, channels=names).trajectory(state, 3.25, 3).history
    record = df.run(case).record
    for name, column in zip(names, history[:, -len(names) :].T, strict=True):
        size = float(np.abs(record[name]).max())
        assert size > 0.0
        np.testing.assert_allclose(column, record[name], atol=1e-6 * size, err_msg=name)
    np.testing.assert_allclose(history[:, 1], record["tip_thin"], atol=1e-9)


def test_kicks_of_all_sizes_grow_alike(strobe: ModalMap) -> None:
    """The map is piecewise smooth without jumps: tiny kicks are not amplified by hundreds.

    Round-off decides which piece the motion of 40 periods ends on; kicks grow by 0.8 to 3.1 there.
    """
    start = moving(strobe, 40)
    scale = float(np.linalg.norm(strobe.slow.of(start)))
    growth = []
    for size in (1e-2, 1e-4, 1e-6, 1e-8):
        kick = size * scale * strobe.slow.basis[:, 0]
        ends = strobe.after(np.stack([start + kick, start - kick]), 3.25)
        growth.append(np.linalg.norm(strobe.slow.of(ends[0] - ends[1])) / (2.0 * size * scale))
    assert max(growth) < 10.0 * min(growth)


def test_a_drive_that_does_not_repeat_has_no_map() -> None:
    sweep = {"kind": "sweep", "start_frequency": 1.0, "end_frequency": 2.0, "duration": 9.0}
    case = massless(**{f"excitation__{k}": v for k, v in sweep.items()})
    with pytest.raises(df.CaseError, match="repeats after each period"):
        ModalMap(case)


def test_periods_may_begin_where_the_tips_are_far_apart(strobe: ModalMap) -> None:
    """The later map goes through the same motion: it meets the states of the first one."""
    start = moving(strobe, 3)
    later, state = strobe.started_at_widest_gap(start, 3.25)
    trajectory, same = strobe.trajectory(start, 3.25, 2), later.trajectory(state, 3.25, 1)
    first = int(np.argmax(trajectory.history[:250, 1] - trajectory.history[:250, 0])) + 1
    assert 0 < first < 250
    np.testing.assert_allclose(same.history, trajectory.history[first : first + 250], atol=1e-12)
    np.testing.assert_allclose(same.strobes[0], trajectory.strobes[0], atol=1e-12)
    assert same.openings[0] > 0.5 * np.ptp(trajectory.history[:, 1] - trajectory.history[:, 0])
