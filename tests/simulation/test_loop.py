"""The loop with a bouncing ball as a fake stepper: no matrices, no PETSc."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pytest
from stand_ins import setting

from delam_fem.contact.laws import SCHEMES, Decision, Law
from delam_fem.model.operators import BaseCoupling
from delam_fem.simulation.loop import StepByStep, simulate
from delam_fem.simulation.recorder import Energies, Recorder
from delam_fem.simulation.refinement import Span

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
    resting: np.ndarray = field(default_factory=lambda: np.zeros(1, dtype=bool))
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

    def jump(self, decision: Decision) -> tuple[float, float]:
        before = 0.5 * self.speed**2
        if decision.hit.size:
            self.speed += float(decision.impulses[0])
        return 0.5 * self.speed**2 - before, 0.0

    def observe(self) -> None:
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
    kept = recorder(8, window=8)
    assert simulate(engine(Ball(1.2)), kept, motion) == "completed"
    first = kept.impacts()
    first_step, energy = first.ticks[0] - 4 * kept.steps_per_period, first.energies[0]
    assert [r.jumps.columns().ticks.size for r in kept.window][:4] == [0] * 4
    assert first_step == pytest.approx(90, abs=1)  # falls for 0.4899 s
    assert first.rate_pre[0] == pytest.approx(-4.899, rel=1e-2)
    assert first.rate_post[0] == pytest.approx(-0.5 * first.rate_pre[0])
    assert energy == pytest.approx(-0.5 * 0.75 * first.rate_pre[0] ** 2)
    assert np.abs(kept.ledger[:, -1]).max() < 1e-12
    assert kept.energy_residual() < 1e-12


def test_window_keeps_the_last_periods_and_frames_at_their_steps() -> None:
    kept = recorder(5, window=2)
    simulate(engine(Ball(1.25)), kept, motion)
    assert len(kept.window) == 2
    last = kept.window[-1]
    assert last.frame_steps.tolist() == [25, 50, 75, 100]
    for step, frame in zip(last.frame_steps, last.frames, strict=True):
        assert frame[0, 0] == last.u[step, 3]
        assert frame[1, 0] == last.v[step, 0]
    fallen = 1.25 - 0.5 * G * 0.4**2
    assert last.u[0, 3] == pytest.approx(fallen)
    assert kept.strobe[4, :, 0] == pytest.approx([1.25 - 0.5 * G * 0.25, -5.0])
    assert kept.envelope[4, :, 0] == pytest.approx([0.0, fallen], abs=1e-12)


def test_a_stop_ends_the_run_after_a_period_and_a_later_call_goes_on() -> None:
    kept, whole = recorder(6), recorder(6)
    ball = engine(Ball(1.25))
    assert simulate(ball, kept, motion, stop=lambda period: period == 3) == "interrupted"
    assert kept.n_closed == 3
    assert simulate(ball, kept, motion) == "completed"
    simulate(engine(Ball(1.25)), whole, motion)
    assert np.array_equal(kept.strobe, whole.strobe)


def test_a_stop_at_the_very_end_is_a_completed_run() -> None:
    assert simulate(engine(Ball(1.25)), recorder(2), motion, stop=lambda p: True) == "interrupted"
    assert simulate(engine(Ball(1.25)), recorder(2), motion, stop=lambda p: p == 2) == "completed"


def test_too_large_a_motion_diverges_and_keeps_its_last_period() -> None:
    kept = recorder(50, limit=3.0)
    ball = Ball(1.25, speed=20.0)
    assert simulate(engine(ball), kept, motion) == "diverged"
    assert kept.n_closed == 1
    assert kept.window[-1].n_steps == STEPS


def test_too_deep_a_gap_ends_the_run_within_the_period() -> None:
    kept = recorder(50, limit=3.0)
    assert simulate(engine(Ball(1.25, speed=-100.0), e=0.0), kept, motion) == "completed"
    deep = recorder(5, limit=3.0)
    assert simulate(engine(Ball(1.25, speed=-1e4), e=0.0), deep, motion) == "diverged"
    assert deep.window[-1].n_steps == 0


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_what_is_not_finite_diverges(value: float) -> None:
    assert simulate(engine(Ball(value)), recorder(5), motion) == "diverged"
