"""What a recorder keeps of a motion that is written down."""

from __future__ import annotations

import numpy as np
import pytest
import scripted
from scripted import DT, PERIODS, STEPS, Engine, U, motion, recorder

from delam_fem.api import LEDGER, N_BASE
from delam_fem.simulation.loop import simulate


def test_strobes_and_envelopes_of_each_period() -> None:
    run_recorder = recorder()
    assert simulate(Engine(), run_recorder, motion) == "completed"
    ends = STEPS * np.arange(1, PERIODS + 1)
    assert run_recorder.strobe[:, 0].tolist() == U[:, ends].T.tolist()
    assert run_recorder.strobe[:, 1].tolist() == (10.0 * U[:, ends].T).tolist()
    for k in range(PERIODS):
        within = U[:, STEPS * k : STEPS * (k + 1) + 1]  # its start included
        assert run_recorder.envelope[k, 0].tolist() == within.min(axis=1).tolist()
        assert run_recorder.envelope[k, 1].tolist() == within.max(axis=1).tolist()
    assert run_recorder.impulse.tolist() == [[0.25, 1.0, 0.0], [3.0, 2.0, 0.5], [4.0, 1.0, 0.0]]


def test_the_window_keeps_every_step_of_the_last_periods() -> None:
    run_recorder = recorder(window=2)
    simulate(Engine(), run_recorder, motion)
    assert run_recorder.n_closed == PERIODS
    for k, record in zip((1, 2), run_recorder.window, strict=True):
        steps = slice(STEPS * k, STEPS * (k + 1) + 1)
        assert record.n_steps == STEPS
        assert record.u[:, N_BASE:].tolist() == U[:, steps].T.tolist()
        assert record.u[:, 2].tolist() == (0.5 * np.arange(13)[steps]).tolist()
        assert record.v.tolist() == (10.0 * U[:, steps].T).tolist()
        assert record.base_states.tolist() == motion(k).tolist()


@pytest.mark.parametrize(
    ("frames", "steps"), [(0, []), (1, [4]), (2, [2, 4]), (3, [1, 3, 4]), (4, [1, 2, 3, 4])]
)
def test_frames_are_spread_over_the_period_and_hold_the_state(
    frames: int, steps: list[int]
) -> None:
    run_recorder = recorder(window=3, frames=frames)
    simulate(Engine(), run_recorder, motion)
    for k, record in enumerate(run_recorder.window):
        assert record.frame_steps.tolist() == steps
        recorded_states = [frame.tolist() for frame in record.frames]
        states = [(scripted.STATIC[:2] + 100.0 * (STEPS * k + step)).tolist() for step in steps]
        assert recorded_states == states


def test_frames_tell_which_pairs_are_hit_and_which_rest() -> None:
    run_recorder = recorder(window=3, frames=4)
    simulate(Engine(), run_recorder, motion)
    states = [state.tolist() for record in run_recorder.window for state in record.contact]
    # the first pair rests from step 3 on, and stays at rest when it is hit at step 8
    assert states == [
        [0, 0], [0, 1], [2, 0], [2, 0],
        [2, 0], [2, 0], [2, 0], [2, 1],
        [2, 0], [2, 1], [2, 0], [2, 0],
    ]  # fmt: skip


def test_the_ledger_by_hand() -> None:
    """The base moves steadily, so that only c·u, k·u, the momentum and the corner do work."""
    run_recorder = recorder()
    simulate(Engine(), run_recorder, motion)
    for k, (impact, released) in enumerate([(-0.75, 0.125), (0.5, -0.25), (-2.0, 0.0)]):
        s0, s1 = STEPS * k, STEPS * (k + 1)
        cross = 0.25 * STEPS * 2.0
        corner_damping = 0.125 * 4.0 * STEPS * DT
        by_stiffness = sum(0.5 * (s - 0.5) * 2.0 * DT for s in range(s0 + 1, s1 + 1))
        momentum = 3.0 * (s1 - s0) * 2.0
        corner = 0.5 * 8.0 * ((2.0 * DT * s1) ** 2 - (2.0 * DT * s0) ** 2)
        work = cross + by_stiffness + momentum + corner + corner_damping
        damping = 0.5 * STEPS + 2.0 * cross + corner_damping
        row = dict(zip(LEDGER, run_recorder.ledger[k], strict=True))
        assert row == {
            "kinetic": s1,
            "strain": 2.0 * s1,
            "spring": 4.0 * s1,
            "base_work": work,
            "force_work": 0.0,
            "damping_loss": damping,
            "contact_damping_loss": 0.25 * STEPS,
            "impact_loss": -impact,
            "spring_released": released,
            "residual": 7.0 * STEPS - (work - damping - 0.25 * STEPS + impact + released),
        }
    exchanged = np.abs(run_recorder.ledger[:, 3:9]).sum(axis=1).max()
    assert run_recorder.energy_residual() == np.abs(run_recorder.ledger[:, 9]).max() / exchanged


def test_without_a_period_nothing_is_left_over() -> None:
    assert recorder().energy_residual() == 0.0


def test_a_run_that_goes_on_records_what_a_run_at_once_does() -> None:
    complete_recorder, parted, engine = recorder(window=3), recorder(window=3), Engine()
    simulate(Engine(), complete_recorder, motion)
    outcomes = [
        simulate(engine, parted, motion, stop=lambda k, end=end: k == end) for end in (1, 2)
    ]
    assert outcomes == ["interrupted", "interrupted"]
    assert simulate(engine, parted, motion) == "completed"
    for name in ("strobe", "envelope", "ledger", "impulse"):
        assert getattr(parted, name).tolist() == getattr(complete_recorder, name).tolist(), name


@pytest.mark.parametrize(("limit", "closed"), [(8.0, 2), (8.1, 3), (9.0, 3)])
def test_the_largest_displacement_of_any_probe_bounds_a_run(limit: float, closed: int) -> None:
    """It is 7 in the first period, 8 in the second, 9 in the third."""
    run_recorder = recorder(limit=limit)
    assert simulate(Engine(), run_recorder, motion) == "diverged"
    assert run_recorder.n_closed == closed
    assert simulate(Engine(), recorder(limit=9.1), motion) == "completed"


def test_negative_displacements_count_as_well() -> None:
    run_recorder = recorder(limit=7.0)
    assert simulate(Engine(), run_recorder, motion) == "diverged"  # -7 in the first period
    assert run_recorder.n_closed == 1


@pytest.mark.parametrize("probe", [0, 1])
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("step", [5, 8])
def test_a_value_that_is_not_finite_ends_the_run(
    probe: int, value: float, step: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    broken = U.copy()
    broken[probe, step] = value
    monkeypatch.setattr(scripted, "U", broken)
    run_recorder = recorder()
    assert simulate(Engine(), run_recorder, motion) == "diverged"
    assert run_recorder.n_closed == 2
    assert np.isfinite(run_recorder.envelope[0]).all()
    assert not np.isfinite(run_recorder.envelope[1, :, probe]).all()


def test_a_period_that_ends_early_has_the_steps_before() -> None:
    run_recorder = recorder()
    assert simulate(Engine(ends_at=6), run_recorder, motion) == "diverged"
    assert run_recorder.n_closed == 2
    last = run_recorder.window[-1]
    assert last.n_steps == 2
    assert run_recorder.strobe[1, 0].tolist() == U[:, 6].tolist()
    assert run_recorder.envelope[1].tolist() == [[1.0, 0.0], [8.0, 3.5]]
    assert run_recorder.ledger[1, 0] == 6.0


def test_a_block_leaves_as_soon_as_later_ones_fill_the_window() -> None:
    run_recorder, blocks = recorder(window=2), [[0], [0], [0]]  # one period each
    assert [run_recorder.take(block) for block in blocks] == [None, None, blocks[0]]


@pytest.mark.parametrize(
    ("rows", "residual"),
    [
        ([[4.0, 2.0, 1.0, 3.0, -1.0, 2.0, 0.5, 1.5, -0.25, 0.5]], 0.5 / 8.25),
        ([[4.0, 2.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.5]], 0.5 / 7e-2),
        ([[4.0, 2.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.5],
          [1.0, 9.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, -0.75]], 0.75 / 11e-2),
        ([10 * [0.0]], 0.0), ([[*9 * [0.0], -0.5]], 1.0),
        ([[*3 * [0.0], 2.0, *5 * [0.0], 0.1], [*4 * [0.0], -4.0, *4 * [0.0], 0.2]], 0.05),
        ([[1.0, np.nan, *8 * [0.0]]], np.nan), ([[*9 * [0.0], np.inf]], np.nan),
    ],
)  # fmt: skip
def test_the_residual_is_relative_to_what_is_exchanged(
    rows: list[list[float]], residual: float
) -> None:
    """The largest of a period over the largest exchange of one; at least 1e-2 of what is stored."""
    run_recorder = recorder()
    run_recorder.ledger[: len(rows)], run_recorder.n_closed = rows, len(rows)
    assert run_recorder.energy_residual() == pytest.approx(residual, rel=1e-12, nan_ok=True)


def test_the_round_off_of_a_long_way_is_no_residual() -> None:
    """1 N/m times (3 m)² are 9 J, which the strain energy of a body far off may miss."""
    far = recorder()
    far.round_off, far.n_closed = 1.0, 1
    far.envelope[0] = [[-3.0, 0.5], [-1.0, 2.0]]
    far.ledger[0] = [*3 * [0.0], 2.0, *5 * [0.0], -9.0]
    assert far.energy_residual() == 0.0
    far.ledger[0, -1] = -9.5
    assert far.energy_residual() == pytest.approx(0.25)
