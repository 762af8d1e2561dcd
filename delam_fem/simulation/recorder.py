"""What a run keeps: every step of the last periods, a row per period of all of them.

Memory is that of the window and a few numbers a period, however long the run. The last periods are
always at hand, so that a run which ends early (interrupted, diverged) has its window too.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from typing import Protocol

import numba
import numpy as np
import numpy.typing as npt

from delam_fem.contact.decision import Decision
from delam_fem.model.operators import BaseCoupling
from delam_fem.numerics.arrays import BoolArray, FloatArray, IntArray
from delam_fem.simulation.energy import Energies, Flows, base_flows
from delam_fem.simulation.impacts import Jumps
from delam_fem.simulation.span import Span

N_BASE = 3
"""Leading entries of `seen_u` that belong to the energy ledger."""

LEDGER = (
    "kinetic", "strain", "spring", "base_work", "damping_loss", "contact_damping_loss",
    "impact_loss", "spring_released", "residual",
)  # fmt: skip


OPEN, HIT, RESTING = range(3)
"""States of a pair in the frames."""

Level = tuple[Energies, float, float]
"""Stored energies, energy dissipated and energy damped in contacts so far."""


class Stepper(Protocol):
    """What a recorder reads from a stepper."""

    seen_u: FloatArray
    seen_v: FloatArray
    dissipated: float
    contact_damped: float

    @property
    def resting(self) -> BoolArray:
        """Pairs at rest on one another, shape (n_pairs,)."""

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
        u: `seen_u` at each step, start included, shape (N + 1, 3 + n_probes).
        v: `seen_v` likewise, shape (N + 1, n_probes).
        start: stored energies, dissipation and contact damping so far when the period began.
        end: likewise when it ended; None until somebody asks.
        frame_steps: steps whose whole state is kept, increasing.
        frames: their (u, v), each of shape (2, n).
        contact: their contact states, each of shape (n_pairs,): 0 open, 1 hit, 2 resting.
        jumps: steps, decisions and energy changes by their impulses.
        released: energy that switching springs has set free [J].
        n_steps: steps done.
    """

    base_states: FloatArray
    u: FloatArray
    v: FloatArray
    frame_steps: IntArray
    start: Level
    frames: list[FloatArray] = field(default_factory=list)
    contact: list[npt.NDArray[np.int8]] = field(default_factory=list)
    jumps: Jumps = field(default_factory=Jumps)
    released: float = 0.0
    impact: float = 0.0
    n_steps: int = 0
    end: Level | None = None

    def jump(self, step: int, decision: Decision, changes: tuple[float, float]) -> None:
        """Note a decision and the energies that it changed."""
        impact, released = changes
        self.impact += impact
        self.released += released
        if decision.hit.size:
            self.jumps.append(step, decision, impact)

    def keep(self, step: int, stepper: Stepper) -> None:
        """Note the state at the end of a step."""
        self.u[step] = stepper.seen_u
        self.v[step] = stepper.seen_v
        n_frames = len(self.frames)
        if n_frames < self.frame_steps.size and step == self.frame_steps[n_frames]:
            self.frames.append(stepper.state()[:2])
            resting = stepper.resting
            state = np.where(resting, RESTING, OPEN).astype(np.int8)
            hit = self.jumps.hit_at(step)
            state[hit] = np.where(resting[hit], RESTING, HIT)
            self.contact.append(state)


class Recorder:
    """Keeps the window and the rows of all periods.

    Attributes:
        time_step: Δt [s].
        steps_per_period: N.
        n_periods: periods to compute.
        n_closed: periods recorded so far.
        limit: gap or displacement beyond which a motion counts as diverged [m].
        strobe: (u, v) of the probes at the end of each period, shape (n_periods, 2, n_probes).
        envelope: smallest and largest u of the probes within each period, likewise.
        ledger: rows of `LEDGER`, shape (n_periods, 9) [J].
        impulse: sum of impulses, number of impacts, and energy added by the instants of impact
            that gain, within each period, shape (n_periods, 3) [N s, -, J].
        window: records of the last periods.
    """

    def __init__(self, base: BaseCoupling, span: Span, n_probes: int) -> None:
        """Make room for all periods.

        Args:
            base: coupling to the base, for the energy ledger.
            span: how long the run is and what is kept.
            n_probes: probes that are recorded at every step.
        """
        self._base, self.time_step = base, span.time_step
        self.steps_per_period, self.n_periods = span.steps_per_period, span.periods
        self.limit, self.n_closed, n = span.limit, 0, span.periods
        self.strobe = np.full((n, 2, n_probes), np.nan)
        self.envelope = np.full((n, 2, n_probes), np.nan)
        self.ledger = np.full((n, len(LEDGER)), np.nan)
        self.impulse = np.full((n, 3), np.nan)
        self.window: deque[PeriodRecord] = deque(maxlen=span.window_periods)
        ticks = np.arange(1, span.frames_per_period + 1) * span.steps_per_period
        self._frame_steps = np.rint(ticks / max(span.frames_per_period, 1)).astype(np.int64)

    def open(
        self, stepper: Stepper, base_states: FloatArray, before: PeriodRecord | None = None
    ) -> PeriodRecord:
        """Begin a period at the present state.

        Args:
            stepper: holds the state.
            base_states: (q, q', q'') of the base at the steps of the period, shape (N + 1, 3).
            before: the period that has led to this very state, where there is one.
        """
        rows, n_probes = self.steps_per_period + 1, self.strobe.shape[2]
        record = PeriodRecord(
            base_states,
            np.empty((rows, N_BASE + n_probes)),
            np.empty((rows, n_probes)),
            self._frame_steps,
            _level(stepper) if before is None or before.end is None else before.end,
        )
        if before is None:
            stepper.observe()
            record.u[0], record.v[0] = stepper.seen_u, stepper.seen_v
        else:
            record.u[0], record.v[0] = before.u[before.n_steps], before.v[before.n_steps]
        return record

    def close(self, record: PeriodRecord, stepper: Stepper, n_steps: int) -> bool:
        """End a period after `n_steps`; return whether the motion has stayed within bounds."""
        k = self.n_closed
        record.n_steps = n_steps
        if record.end is None:
            record.end = _level(stepper)
        self.window.append(record)
        self.n_closed += 1
        jumps = record.jumps.columns()
        with np.errstate(all="ignore"):  # a diverged motion is told by the return value
            self.strobe[k] = record.u[n_steps, N_BASE:], record.v[n_steps]
            largest = _extremes(record.u, n_steps + 1, self.envelope[k])
            gains = np.maximum(jumps.energies, 0.0)
            self.impulse[k] = jumps.impulses.sum(), jumps.hit.size, gains.sum()
            self.ledger[k] = self._ledger_row(record, record.end)
        return bool(largest < self.limit)

    def energy_residual(self) -> float:
        """Return the largest residual of a period over the largest energy exchanged in one [-]."""
        rows = self.ledger[: self.n_closed]
        exchanged = np.abs(rows[:, LEDGER.index("base_work") : -1]).sum(axis=1).max(initial=0.0)
        residual = np.abs(rows[:, -1]).max(initial=0.0)
        return float(residual / exchanged) if exchanged > 0.0 else 0.0

    def _ledger_row(self, record: PeriodRecord, after: Level) -> tuple[float, ...]:
        """Return stored energies, flows and what does not add up, in the order of `LEDGER`."""
        (start, dissipated, contact_damped), rows = record.start, slice(0, record.n_steps + 1)
        end, dissipated_after, contact_damped_after = after
        work, base_damping = base_flows(
            record.u[rows],
            (start.momentum, end.momentum),
            record.base_states[rows],
            self._base,
            self.time_step,
        )
        flows = Flows(
            base_work=work,
            damping_loss=dissipated_after - dissipated + base_damping,
            contact_damping_loss=contact_damped_after - contact_damped,
            impact_loss=-record.impact,
            spring_released=record.released,
        )
        residual = end.total - start.total - flows.net
        return (
            end.kinetic, end.strain, end.spring, flows.base_work, flows.damping_loss,
            flows.contact_damping_loss, flows.impact_loss, flows.spring_released, residual,
        )  # fmt: skip


def _level(stepper: Stepper) -> Level:
    """Return what is stored and lost so far."""
    return stepper.energies(), stepper.dissipated, stepper.contact_damped


@numba.njit(cache=True)
def _extremes(u, n_rows, envelope):  # type: ignore[no-untyped-def]
    """Write the extremes of the observed u; return their largest magnitude.

    What is not a number stays one to the end.
    """
    n, largest = envelope.shape[1], 0.0
    for k in range(n):
        low = high = u[0, N_BASE + k]
        for row in range(1, n_rows):
            value = u[row, N_BASE + k]
            if value < low or value != value:
                low = value
            if value > high or value != value:
                high = value
        envelope[0, k], envelope[1, k] = low, high
        for value in (abs(low), abs(high)):
            if value > largest or value != value:
                largest = value
    return largest
