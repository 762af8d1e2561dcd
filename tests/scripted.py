"""An engine whose motion is written down: what a recorder must keep of it is known exactly."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from delam_fem import Decision
from delam_fem.api import BaseCoupling, PeriodRecord, Recorder, Span, State
from delam_fem.contact.decisions import NO_PAIRS, PairState
from delam_fem.simulation.loop import StepByStep
from delam_fem.simulation.recorder import Energies

STEPS, PERIODS, DT = 4, 3, 0.5
"""Steps per period, periods, time step [s]."""
SPEED = 2.0
"""Velocity of the base [m/s]."""
CORNER = (16.0, 0.125, 8.0)
"""M_aa [kg], C_aa [N s/m], K_aa [N/m]."""
U = np.array([[5.0, 3.0, -7.0, 2.0, 6.0, 8.0, 1.0, 0.0, -2.0, 4.0, 9.0, -1.0, 7.0],
              [0.5, 2.5, 1.5, -0.5, 0.0, 0.0, 3.5, 4.5, 5.5, 6.5, 0.5, 0.25, 0.75]])  # fmt: skip
"""Displacements of two probes at all steps of the run [m]."""
IMPACTS = {
    2: (Decision(np.array([1]), np.array([0.25]), np.array([-1.0]), np.array([0.5])), -0.75, 0.0),
    3: (Decision(NO_PAIRS, *[np.zeros(0)] * 3, PairState(np.array([True, False]))), 0.0, 0.125),
    8: (Decision(np.array([0, 1]), np.array([1.0, 2.0]), np.array([-3.0, -4.0]), np.zeros(2)),
        0.5, -0.25),
    10: (Decision(np.array([1]), np.array([4.0]), np.array([-5.0]), np.zeros(1)), -2.0, 0.0),
}  # fmt: skip
"""Decision, energy added by impulses and by springs [J] by the step at whose end they happen."""
STATIC = np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0], [0.0, 0.0, 0.0]])


@dataclass
class Scripted:
    """A stepper of three dofs and two pairs at a step of the motion above."""

    step: int = 0
    pair_state: PairState = field(default_factory=lambda: PairState.at_start(2))
    dissipated: float = 0.0
    contact_damped: float = 0.0
    damped: np.ndarray = field(default_factory=lambda: np.zeros(2))
    seen_u: np.ndarray = field(default_factory=lambda: np.zeros(5))
    seen_v: np.ndarray = field(default_factory=lambda: np.zeros(2))

    def finish_step(self) -> None:
        """Show (m·u, c·u, k·u), the probes, and their velocities, which are ten times as large."""
        s = float(self.step)
        self.seen_u[:] = 7.0 * s, 0.25 * s, 0.5 * s, *U[:, self.step]
        self.seen_v[:] = 10.0 * U[:, self.step]

    def energies(self) -> Energies:
        s = float(self.step)
        return Energies(kinetic=s, strain=2.0 * s, spring=4.0 * s, momentum=3.0 * s)

    def state(self) -> np.ndarray:
        return STATIC + 100.0 * self.step


@dataclass
class Engine:
    """The engine with this stepper; damping takes 0.5 J in a step, contact dampers 0.25 J."""

    stepper: Scripted = field(default_factory=Scripted)
    base_state: np.ndarray | None = None
    ends_at: int = STEPS * PERIODS
    """Step after which no further step is computed."""
    n_shares: int = 1

    def state(self) -> State:
        s = self.stepper
        return State(s.state(), s.pair_state.copy(), (s.dissipated, s.contact_damped))

    def restore(self, state: State, base_state: np.ndarray) -> None:
        s = self.stepper
        s.step = round((state.motion[0, 0] - STATIC[0, 0]) / 100.0)
        s.pair_state, self.base_state = state.pair_state.copy(), base_state
        s.dissipated, s.contact_damped = state.losses

    def renew_acceleration(self) -> None:
        """Do nothing: the motion is written down."""

    def gather(self, share: np.ndarray) -> np.ndarray:
        return share

    scatter = gather

    def destroy(self) -> None:
        """Do nothing: there is nothing to free."""

    steps_at_once: int = 1
    advance = StepByStep.advance

    def run_period(self, record: PeriodRecord, floor: float) -> int:
        s = self.stepper
        for step in range(1, STEPS + 1):
            if s.step == self.ends_at:
                return step - 1
            s.step += 1
            s.dissipated += 0.5
            s.contact_damped += 0.25
            if s.step in IMPACTS:
                decision, *changes = IMPACTS[s.step]
                if decision.pair_state is not None:
                    s.pair_state = decision.pair_state
                record.jump(step, decision, (changes[0], changes[1]))
            s.finish_step()
            record.keep(step, s)
        return STEPS


def recorder(window: int = 2, frames: int = 2, limit: float = 100.0) -> Recorder:
    """Return a recorder of the whole motion."""
    span = Span(DT, STEPS, PERIODS, window, frames, limit)
    zero = np.zeros(3)
    return Recorder(BaseCoupling(zero, zero, zero, CORNER), span, n_probes=2)


def motion(period: int) -> np.ndarray:
    """Return the states of a base that moves steadily from 0."""
    t = DT * (STEPS * period + np.arange(STEPS + 1))
    return np.stack([SPEED * t, np.full(t.size, SPEED), np.zeros(t.size)], axis=1)
