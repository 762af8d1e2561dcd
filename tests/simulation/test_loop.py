"""The loop with a bouncing ball as a fake stepper: no matrices, no PETSc."""

from __future__ import annotations

import gc
from collections.abc import Callable
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from fakes import setting

from delam_fem import Decision
from delam_fem.api import (
    SCHEMES,
    BaseCoupling,
    CaseError,
    Law,
    Recorder,
    Span,
    State,
    one_period,
    set_initial,
)
from delam_fem.contact.decisions import PairState
from delam_fem.simulation.loop import StepByStep, simulate
from delam_fem.simulation.recorder import Energies

G = 10.0
DT = 1e-3
STEPS = 100


@dataclass
class Ball:
    """A mass of 1 kg above a floor; exact between impacts."""

    height: float
    speed: float = 0.0
    dissipated: float = 0.0
    contact_damped: float = 0.0
    damped: np.ndarray = field(default_factory=lambda: np.zeros(1))
    pair_state: PairState = field(default_factory=lambda: PairState.at_start(1))
    is_resting: bool = False
    gap: np.ndarray = field(default_factory=lambda: np.zeros(1))
    seen_u: np.ndarray = field(default_factory=lambda: np.zeros(4))
    seen_v: np.ndarray = field(default_factory=lambda: np.zeros(1))

    def begin(self, base_states: np.ndarray) -> None:
        assert base_states.shape == (STEPS + 1, 3)

    def advance(self) -> float:
        self.height += DT * self.speed - 0.5 * G * DT**2
        self.speed -= G * DT
        self.gap[0] = self.height
        return self.height

    def rate_pre(self) -> np.ndarray:
        return np.array([self.speed])

    rate_free = rate_pre

    def rate_noise(self) -> float:
        return 0.0

    def jump(self, decision: Decision) -> tuple[float, float]:
        before = 0.5 * self.speed**2
        if decision.hit.size:
            self.speed += float(decision.impulses[0])
        return 0.5 * self.speed**2 - before, 0.0

    def finish_step(self) -> None:
        self.seen_u[:] = 0.0, 0.0, 0.0, self.height
        self.seen_v[0] = self.speed

    def energies(self) -> Energies:
        return Energies(0.5 * self.speed**2, G * self.height, 0.0)

    def state(self) -> np.ndarray:
        return np.array([[self.height], [self.speed], [-G]])


def recorder(periods: int, window: int = 2, limit: float = 100.0) -> Recorder:
    span = Span(DT, STEPS, periods, window, frames_per_period=4, limit=limit)
    return Recorder(BaseCoupling.none(1), span, n_probes=1)


def motion(period: int) -> np.ndarray:
    return np.zeros((STEPS + 1, 3))


def engine(ball: Ball, e: float = 0.5) -> StepByStep:
    law = Law("newton", e, "lumped")
    return StepByStep(ball, law.supervisor(SCHEMES["newmark"], setting(np.eye(1))))


def test_ball_falls_bounces_and_loses_what_the_ledger_says() -> None:
    run_recorder = recorder(8, window=8)
    assert simulate(engine(Ball(1.2)), run_recorder, motion) == "completed"
    first = run_recorder.impacts()
    first_step, energy = first.ticks[0] - 4 * run_recorder.steps_per_period, first.energies[0]
    assert [r.jumps.columns().ticks.size for r in run_recorder.window][:4] == [0] * 4
    assert first_step == pytest.approx(90, abs=1)  # falls for 0.4899 s
    assert first.rate_pre[0] == pytest.approx(-4.899, rel=1e-2)
    assert first.rate_post[0] == pytest.approx(-0.5 * first.rate_pre[0])
    assert energy == pytest.approx(-0.5 * 0.75 * first.rate_pre[0] ** 2)
    assert np.abs(run_recorder.ledger[:, -1]).max() < 1e-12
    assert run_recorder.energy_residual() < 1e-12


def test_window_keeps_the_last_periods_and_frames_at_their_steps() -> None:
    run_recorder = recorder(5, window=2)
    simulate(engine(Ball(1.25)), run_recorder, motion)
    assert len(run_recorder.window) == 2
    last = run_recorder.window[-1]
    assert last.frame_steps.tolist() == [25, 50, 75, 100]
    for step, frame in zip(last.frame_steps, last.frames, strict=True):
        assert frame[0, 0] == last.u[step, 3]
        assert frame[1, 0] == last.v[step, 0]
    fallen = 1.25 - 0.5 * G * 0.4**2
    assert last.u[0, 3] == pytest.approx(fallen)
    assert run_recorder.strobe[4, :, 0] == pytest.approx([1.25 - 0.5 * G * 0.25, -5.0])
    assert run_recorder.envelope[4, :, 0] == pytest.approx([0.0, fallen], abs=1e-12)


def test_a_stop_ends_the_run_after_a_period_and_a_later_call_goes_on() -> None:
    run_recorder, complete_recorder = recorder(6), recorder(6)
    ball = engine(Ball(1.25))
    assert simulate(ball, run_recorder, motion, stop=lambda period: period == 3) == "interrupted"
    assert run_recorder.n_closed == 3
    assert simulate(ball, run_recorder, motion) == "completed"
    simulate(engine(Ball(1.25)), complete_recorder, motion)
    assert np.array_equal(run_recorder.strobe, complete_recorder.strobe)


def test_a_stop_at_the_very_end_is_a_completed_run() -> None:
    assert simulate(engine(Ball(1.25)), recorder(2), motion, stop=lambda p: True) == "interrupted"
    assert simulate(engine(Ball(1.25)), recorder(2), motion, stop=lambda p: p == 2) == "completed"


def test_too_large_a_motion_diverges_and_keeps_its_last_period() -> None:
    run_recorder = recorder(50, limit=3.0)
    ball = Ball(1.25, speed=20.0)
    assert simulate(engine(ball), run_recorder, motion) == "diverged"
    assert run_recorder.n_closed == 1
    assert run_recorder.window[-1].n_steps == STEPS


def test_too_deep_a_gap_ends_the_run_within_the_period() -> None:
    run_recorder = recorder(50, limit=3.0)
    assert simulate(engine(Ball(1.25, speed=-100.0), e=0.0), run_recorder, motion) == "completed"
    deep = recorder(5, limit=3.0)
    assert simulate(engine(Ball(1.25, speed=-1e4), e=0.0), deep, motion) == "diverged"
    assert deep.window[-1].n_steps == 0


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_what_is_not_finite_diverges(value: float) -> None:
    assert simulate(engine(Ball(value)), recorder(5), motion) == "diverged"


# ---- blocks of periods


@dataclass
class Counting:
    """An engine that computes nothing and keeps what it is asked for."""

    steps_at_once: int = 400
    bounded_until: int = 99
    asked: list[tuple[int, int]] = field(default_factory=list)
    collects: list[bool] = field(default_factory=list)

    def advance(self, recorder: Any, base_states: np.ndarray, n_periods: int) -> bool:
        self.asked.append((int(base_states[0, 0]), n_periods))
        self.collects.append(gc.isenabled())
        recorder.n_closed += n_periods
        return recorder.n_closed < self.bounded_until


def tables(*lasts: int) -> Callable[[int], np.ndarray]:
    """Return a motion that has one table up to each of these periods, exclusive."""
    made = [np.full((STEPS + 1, 3), float(k)) for k in range(len(lasts))]
    return lambda period: made[sum(period >= last for last in lasts)]


def counting(n_periods: int, n_closed: int = 0) -> Any:
    return SimpleNamespace(n_closed=n_closed, n_periods=n_periods, steps_per_period=STEPS)


@pytest.mark.parametrize(
    ("at_once", "every", "lasts", "start", "n_periods", "ends"),
    [
        (400, 10, (99,), 0, 23, [4, 8, 10, 14, 18, 20, 23]),
        (499, 10, (99,), 5, 14, [9, 10, 14]),
        (50, 10, (99,), 0, 3, [1, 2, 3]),
        (9000, 3, (99,), 0, 8, [3, 6, 8]),
        (9000, 3, (99,), 3, 7, [6, 7]),
        (400, 10, (3, 6, 7, 99), 0, 9, [3, 6, 7, 9]),
        (400, 10, (1, 2, 3, 4), 0, 4, [1, 2, 3, 4]),
        (400, 10, (99,), 4, 4, []),
        (400, 10, (99,), 0, 1, [1]),
    ],
)
def test_blocks_of_periods_end_where_they_have_to(
    at_once: int, every: int, lasts: tuple[int, ...], start: int, n_periods: int, ends: list[int]
) -> None:
    """At multiples of `every`, where the table changes, and after so many steps as are allowed."""
    engine, run_recorder, base = Counting(at_once), counting(n_periods, start), tables(*lasts)
    told: list[int] = []
    asked: list[int] = []

    def motion(period: int) -> np.ndarray:
        asked.append(period)
        return base(period)

    def enough(period: int) -> bool:
        told.append(period)
        return False

    assert simulate(engine, run_recorder, motion, enough=enough, every=every) == "completed"
    assert told == ends and run_recorder.n_closed == n_periods
    begins = [start, *ends[:-1]]
    wanted = [(int(base(a)[0, 0]), b - a) for a, b in zip(begins, ends, strict=False)]
    assert engine.asked == wanted
    assert asked == list(range(start, n_periods))  # each table once


def test_what_is_enough_is_complete_and_what_is_stopped_is_not() -> None:
    for stop, enough, outcome, last in (
        (4, 99, "interrupted", 4), (99, 8, "completed", 8), (4, 4, "completed", 4),
        (23, 99, "completed", 23), (99, 23, "completed", 23),
    ):  # fmt: skip
        run_recorder = counting(23)
        ending = simulate(
            Counting(), run_recorder, tables(99),
            stop=lambda n, at=stop: n == at, enough=lambda n, at=enough: n == at,
        )  # fmt: skip
        assert (ending, run_recorder.n_closed) == (outcome, last)
    run_recorder = counting(23)
    told = simulate(
        Counting(bounded_until=8),
        run_recorder,
        tables(99),
        stop=lambda n: n >= 8,
        enough=lambda n: n >= 8,
    )
    assert (told, run_recorder.n_closed) == ("diverged", 8)


def test_the_garbage_collector_rests_during_a_block_alone() -> None:
    assert gc.isenabled()
    stepper, gc_states = Counting(bounded_until=8), []

    def stop(period: int) -> bool:
        gc_states.append(gc.isenabled())
        return False

    simulate(stepper, counting(23), tables(99), stop=stop)
    assert stepper.collects == [False, False] and gc_states == [True] and gc.isenabled()
    gc.disable()
    try:
        simulate(stepper, counting(4), tables(99))
        assert not gc.isenabled()
    finally:
        gc.enable()


# ---- states


def test_states_of_another_form_are_refused() -> None:
    for shape in ((3,), (2, 5), (3, 5, 1), (4, 3)):
        with pytest.raises(CaseError) as error:
            State(np.zeros(shape), np.zeros(1, dtype=bool))
        told = f"state.motion: expected the shape (3, n): u, v, a, given {shape!r}"
        assert str(error.value) == told
    with pytest.raises(CaseError) as error:
        State(np.zeros((3, 5)), np.zeros(2))
    told = "state.resting: expected an array of bool, one per pair, given 'float64'"
    assert str(error.value) == told
    state = State(np.zeros((3, 0)), np.zeros(0, dtype=bool))
    assert state.losses == (0.0, 0.0) and state.internal is None


def test_a_start_has_no_losses_and_renews_the_acceleration() -> None:
    done: list[Any] = []
    present = State(np.ones((3, 2)), np.array([True]), (0.5, 0.25), np.ones(7))
    engine: Any = SimpleNamespace(
        state=lambda: present,
        restore=lambda state, base: done.append((state, base)),
        renew_acceleration=lambda: done.append("renewed"),
    )
    other = State(np.full((3, 2), 4.0), np.array([False]), (0.1, 0.2), np.ones(7))
    for initial, wanted in ((None, present), (other, other)):
        done.clear()
        set_initial(engine, initial, np.array([1.0, 2.0, 3.0]))
        (state, base), renewed = done
        assert renewed == "renewed" and base.tolist() == [1.0, 2.0, 3.0]
        assert state.motion is wanted.motion and state.resting is wanted.resting
        assert state.losses == (0.0, 0.0) and state.internal is None


def test_one_period_takes_the_first_row_whatever_was_before() -> None:
    run_recorder, ball_engine = recorder(6), engine(Ball(1.25))
    simulate(ball_engine, run_recorder, motion)
    record = one_period(ball_engine, run_recorder, motion(0))
    assert run_recorder.n_closed == 1 and record is run_recorder.window[-1]
    assert record.u[0, 3] == pytest.approx(run_recorder.window[-2].u[-1, 3])
