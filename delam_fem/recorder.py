"""What a run keeps: every step of the last periods, a row per period of all of them.

Memory is that of the window and a few numbers a period, however long the run. The last periods are
always at hand, so that a run which ends early (interrupted, diverged) has its window too.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
import numpy.typing as npt

from delam_fem.energy import Energies, Flows, base_flows
from delam_fem.operators import BaseCoupling, FloatArray, IntArray
from delam_fem.supervisor import Decision, Supervisor

N_BASE = 3
"""Leading entries of `seen_u` that belong to the energy ledger."""

LEDGER = (
    "kinetic", "strain", "spring", "base_work", "damping_loss", "contact_damping_loss",
    "impact_loss", "spring_released", "residual",
)  # fmt: skip


class Stepper(Protocol):
    """What a recorder reads from a stepper."""

    seen_u: FloatArray
    seen_v: FloatArray
    dissipated: float
    contact_damped: float

    def energies(self) -> Energies:
        """Return the stored energies now."""

    def state(self) -> FloatArray:
        """Return (u, v, a) of all dofs, shape (3, n)."""

    def observe(self) -> None:
        """Bring `seen_u` and `seen_v` up to date."""


@dataclass
class PeriodRecord:
    """One period at every step.

    Attributes:
        base_states: (q, q', q'') of the base, shape (N + 1, 3).
        u: `seen_u` at each step, start included, shape (N + 1, 3 + n_observed).
        v: `seen_v` likewise, shape (N + 1, n_observed).
        start: stored energies, dissipation and contact damping so far when the period began.
        frame_steps: steps whose whole state is kept, increasing.
        frames: their (u, v), each of shape (2, n).
        contact: their contact states, each of shape (n_pairs,): 0 open, 1 hit, 2 permanent.
        jumps: (step, decision, energy change by its impulses).
        released: energy that switching springs has set free [J].
        n_steps: steps done.
    """

    base_states: FloatArray
    u: FloatArray
    v: FloatArray
    frame_steps: IntArray
    start: tuple[Energies, float, float]
    frames: list[FloatArray] = field(default_factory=list)
    contact: list[npt.NDArray[np.int8]] = field(default_factory=list)
    jumps: list[tuple[int, Decision, float]] = field(default_factory=list)
    released: float = 0.0
    impact: float = 0.0
    n_steps: int = 0

    def jump(self, step: int, decision: Decision, changes: tuple[float, float]) -> None:
        """Note a decision and the energies that it changed."""
        impact, released = changes
        self.impact += impact
        self.released += released
        if decision.hit.size:
            self.jumps.append((step, decision, impact))

    def keep(self, step: int, stepper: Stepper, supervisor: Supervisor) -> None:
        """Note the state at the end of a step."""
        self.u[step] = stepper.seen_u
        self.v[step] = stepper.seen_v
        n_frames = len(self.frames)
        if n_frames < self.frame_steps.size and step == self.frame_steps[n_frames]:
            self.frames.append(stepper.state()[:2])
            state = np.where(supervisor.permanent, 2, 0).astype(np.int8)
            if self.jumps and self.jumps[-1][0] == step:
                hit = self.jumps[-1][1].hit
                state[hit] = np.where(supervisor.permanent[hit], 2, 1)
            self.contact.append(state)


class Recorder:
    """Keeps the window and the rows of all periods.

    Attributes:
        steps_per_period: N.
        n_periods: periods to compute.
        n_closed: periods recorded so far.
        limit: gap or displacement beyond which a motion counts as diverged [m].
        strobe: observed (u, v) at the end of each period, shape (n_periods, 2, n_observed).
        envelope: smallest and largest observed u within each period, likewise.
        ledger: rows of `LEDGER`, shape (n_periods, 9) [J].
        impulse: sum of impulses, number of impacts, and energy added by the instants of impact
            that gain, within each period, shape (n_periods, 3) [N s, -, J].
        window: records of the last periods.
    """

    def __init__(
        self,
        base: BaseCoupling,
        *,
        time_step: float,
        steps_per_period: int,
        n_periods: int,
        n_observed: int,
        window_periods: int,
        frames_per_period: int,
        limit: float,
    ) -> None:
        """Make room for all periods."""
        self._base, self._time_step = base, time_step
        self.steps_per_period, self.n_periods, self.limit = steps_per_period, n_periods, limit
        self.n_closed = 0
        self.strobe = np.full((n_periods, 2, n_observed), np.nan)
        self.envelope = np.full((n_periods, 2, n_observed), np.nan)
        self.ledger = np.full((n_periods, len(LEDGER)), np.nan)
        self.impulse = np.full((n_periods, 3), np.nan)
        self.window: deque[PeriodRecord] = deque(maxlen=window_periods)
        ticks = np.arange(1, frames_per_period + 1) * steps_per_period
        self._frame_steps = np.rint(ticks / max(frames_per_period, 1)).astype(np.int64)

    def open(self, stepper: Stepper, base_states: FloatArray) -> PeriodRecord:
        """Begin a period at the present state."""
        rows, n_observed = self.steps_per_period + 1, self.strobe.shape[2]
        record = PeriodRecord(
            base_states,
            np.empty((rows, N_BASE + n_observed)),
            np.empty((rows, n_observed)),
            self._frame_steps,
            (stepper.energies(), stepper.dissipated, stepper.contact_damped),
        )
        stepper.observe()
        record.u[0], record.v[0] = stepper.seen_u, stepper.seen_v
        return record

    def close(self, record: PeriodRecord, stepper: Stepper, n_steps: int) -> bool:
        """End a period after `n_steps`; return whether the motion has stayed within bounds."""
        k, rows = self.n_closed, slice(0, n_steps + 1)
        record.n_steps = n_steps
        self.window.append(record)
        self.n_closed += 1
        observed = np.ascontiguousarray(record.u[rows, N_BASE:].T)
        impulses = [decision.impulses for _, decision, _ in record.jumps]
        with np.errstate(all="ignore"):  # a diverged motion is told by the return value
            self.strobe[k] = observed[:, -1], record.v[n_steps]
            self.envelope[k] = observed.min(axis=1), observed.max(axis=1)
            self.impulse[k] = (
                np.concatenate(impulses).sum() if impulses else 0.0,
                sum(p.size for p in impulses),
                sum(energy for _, _, energy in record.jumps if energy > 0.0),
            )
            self.ledger[k] = self._ledger_row(record, stepper, n_steps)
            return bool(np.abs(self.envelope[k]).max(initial=0.0) < self.limit)

    def energy_residual(self) -> float:
        """Return the largest residual of a period over the largest energy exchanged in one [-]."""
        rows = self.ledger[: self.n_closed]
        exchanged = np.abs(rows[:, LEDGER.index("base_work") : -1]).sum(axis=1).max(initial=0.0)
        residual = np.abs(rows[:, -1]).max(initial=0.0)
        return float(residual / exchanged) if exchanged > 0.0 else 0.0

    def _ledger_row(self, record: PeriodRecord, stepper: Stepper, n_steps: int) -> FloatArray:
        """Return stored energies, flows and what does not add up, in the order of `LEDGER`."""
        start, dissipated, contact_damped = record.start
        end, rows = stepper.energies(), slice(0, n_steps + 1)
        work, base_damping = base_flows(
            record.u[rows, :N_BASE],
            (start.momentum, end.momentum),
            record.base_states[rows],
            self._base,
            self._time_step,
        )
        flows = Flows(
            base_work=work,
            damping_loss=stepper.dissipated - dissipated + base_damping,
            contact_damping_loss=stepper.contact_damped - contact_damped,
            impact_loss=-record.impact,
            spring_released=record.released,
        )
        residual = end.total - start.total - flows.net
        return np.array(
            [
                end.kinetic, end.strain, end.spring, flows.base_work, flows.damping_loss,
                flows.contact_damping_loss, flows.impact_loss, flows.spring_released, residual,
            ]
        )  # fmt: skip
