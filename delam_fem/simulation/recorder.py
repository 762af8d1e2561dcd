"""Record a run: every step of the last periods (the window), and one row of numbers per period.

The memory is that of the window and a few numbers per period, for a run of any length. The window
always contains the latest periods, also when a run is interrupted or diverges.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
import numpy.typing as npt

from delam_fem.caches.kernels import kept
from delam_fem.contact.decision import Decision
from delam_fem.model.operators import BaseCoupling
from delam_fem.numerics.arrays import BoolArray, ByteArray, FloatArray, IntArray
from delam_fem.simulation.energy import Energies, Flows, base_flows
from delam_fem.simulation.impacts import Jumps
from delam_fem.simulation.span import Span

N_BASE = 3
"""Number of leading entries of `seen_u` that belong to the energy ledger; the probes follow."""

LEDGER = (
    "kinetic", "strain", "spring", "base_work", "force_work", "damping_loss",
    "contact_damping_loss", "impact_loss", "spring_released", "residual",
)  # fmt: skip
"""Columns of the energy ledger."""

EXCHANGED = slice(LEDGER.index("base_work"), LEDGER.index("residual"))
"""Columns of what is exchanged within a period."""

LEAST_EXCHANGED = 1e-6
"""Of the energy stored: what counts as exchanged at least, in the scale of the residual. Otherwise
the round-off of a free motion without damping would be judged by itself."""

EFFORT = ("coarse", "middle", "fine", "contacts", "unforeseen")
"""Columns of `Recorder.effort`: numbers of steps by size; divided steps with an impact, and those
of them whose first impact hit a pair that the coarse step did not see approach."""

N_SIZES = 3
"""Number of leading columns of `EFFORT` that count steps."""

OPEN, HIT, RESTING = range(3)
"""Contact states of a pair in the frames."""

Level = tuple[Energies, float, float]
"""Stored energies; energies lost so far to damping and to contact dampers [J]."""


class Stepper(Protocol):
    """The part of a stepper that a recorder reads.

    Attributes:
        seen_u: (m_b·u, c_b·u, k_b·u), displacements of the probes and functionals of sensors,
            shape (3 + n_probes + n_sensors,).
        seen_v: velocities of the probes and functionals of sensors, shape (n_probes + n_sensors,).
        dissipated: energy lost to damping so far [J].
        contact_damped: energy lost to contact dampers so far [J].
    """

    seen_u: FloatArray
    seen_v: FloatArray
    dissipated: float
    contact_damped: float

    @property
    def resting(self) -> BoolArray:
        """Which pairs are at rest, shape (n_pairs,)."""

    def energies(self) -> Energies:
        """Return the stored energies of the present state."""

    def state(self) -> FloatArray:
        """Return (u, v, a) of the dofs of this rank, shape (3, n_own)."""

    def observe(self) -> None:
        """Compute `seen_u` and `seen_v` from the present state."""


@dataclass
class PeriodRecord:
    """The record of one period at every step.

    Attributes:
        base_states: (q, q', q'') of the base, shape (N + 1, 3).
        u: `seen_u` at each step, start included, shape (N + 1, 3 + n_probes + n_sensors).
        v: `seen_v` at each step, start included, shape (N + 1, n_probes + n_sensors).
        frame_steps: steps at which the whole state is recorded (the frames), increasing.
        start: energies stored and lost so far when the period began.
        frames: (u, v) of the dofs of this rank at the frames, each of shape (2, n_own).
        contact: contact states at the frames, each of shape (n_pairs,): 0 open, 1 hit, 2 resting.
        jumps: impacts with their ticks, decisions and energy changes.
        released: energy that switching springs on and off has added [J].
        impact: energy that impacts have added [J].
        n_steps: number of computed steps.
        is_divided: which steps were divided near contact, shape (N + 1,).
        flows: sums over the divided steps, for the work of the base; see `energy.add_flows`.
        effort: numbers of steps and contacts, in the order of `EFFORT`.
        end: energies stored and lost so far when the period ended; None until they are computed.
        ticks_per_step: r, the number of fine steps (ticks) in a step.
        resting: pairs at rest when the period began, shape (n_pairs,).
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
    is_divided: ByteArray = field(default_factory=lambda: np.zeros(0, np.uint8))
    flows: FloatArray = field(default_factory=lambda: np.zeros(4))
    effort: IntArray = field(default_factory=lambda: np.zeros(len(EFFORT), np.int64))
    end: Level | None = None
    ticks_per_step: int = 1
    resting: BoolArray = field(default_factory=lambda: np.zeros(0, np.bool_))

    def __post_init__(self) -> None:
        """Prepare `keep`."""
        self._rows_u: list[bytes] = []
        self._rows_v: list[bytes] = []
        self._has_frame = frozenset(self.frame_steps.tolist())

    def jump(self, tick: int, decision: Decision, changes: tuple[float, float]) -> None:
        """Record a decision at a tick, and its energy changes by impulses and by springs [J]."""
        impact, released = changes
        self.impact += impact
        self.released += released
        if decision.hit.size:
            self.jumps.append(tick, decision, impact)

    def keep(self, step: int, stepper: Stepper) -> None:
        """Record the state at the end of a step."""
        self._rows_u.append(stepper.seen_u.tobytes())
        self._rows_v.append(stepper.seen_v.tobytes())
        if step in self._has_frame:
            self.frames.append(stepper.state()[:2])
            resting = stepper.resting
            state = np.where(resting, RESTING, OPEN).astype(np.int8)
            ticks = self.ticks_per_step
            hit = self.jumps.hit_within((step - 1) * ticks, step * ticks)
            state[hit] = np.where(resting[hit], RESTING, HIT)
            self.contact.append(state)

    def end_steps(self, n_steps: int) -> None:
        """Write what `keep` has collected: rows of arrays cost more than the bytes of all rows."""
        self.n_steps = n_steps
        for rows, table in ((self._rows_u, self.u), (self._rows_v, self.v)):
            if rows:
                first = n_steps + 1 - len(rows)
                table[first : n_steps + 1] = np.frombuffer(bytearray().join(rows)).reshape(
                    len(rows), table.shape[1]
                )
                rows.clear()


class Recorder:
    """Recorder of the window and of one row per period.

    Attributes:
        is_forced: whether a force drives the structure; `base_states` of the records are then the
            force [N] and its derivatives, and the base rests.
        time_step: Δt [s].
        steps_per_period: N.
        n_periods: number of periods to compute.
        n_closed: number of periods recorded so far.
        limit: gap or displacement beyond which a motion counts as diverged [m].
        strobe: (u, v) of the probes at the end of each period, shape (n_periods, 2, n_probes).
        envelope: smallest and largest u of the probes within each period, shape (n_periods, 2,
            n_probes).
        ledger: rows with the columns `LEDGER`, shape (n_periods, 10) [J].
        impulse: sum of impulses, number of impulses on pairs, and energy added by the impacts that
            gain energy, within each period, shape (n_periods, 3) [N s, -, J].
        effort: numbers of steps and contacts within each period, in the order of `EFFORT`, shape
            (n_periods, 5).
        refine: r, the number of fine steps in a step.
        window: records of the last periods.
    """

    def __init__(self, base: BaseCoupling, span: Span, n_probes: int, n_sensors: int = 0) -> None:
        """Allocate the rows of all periods.

        Args:
            base: coupling to the base, for the energy ledger.
            span: length of the run, and what it records.
            n_probes: number of probes, which are recorded at every step.
            n_sensors: number of functionals of sensors, which are recorded behind the probes.
        """
        _extremes(np.zeros((1, N_BASE)), 1, np.zeros((2, 0)))  # loads it before the first period
        base_flows(np.zeros((1, N_BASE)), (0.0, 0.0), np.zeros((1, 3)), base, span.time_step)
        self._base, self.time_step = base, span.time_step
        self._n_observed = n_probes + n_sensors
        self.is_forced = base.is_force
        self.steps_per_period, self.n_periods = span.steps_per_period, span.periods
        self.limit, self.n_closed, n = span.limit, 0, span.periods
        self.refine = span.refinement.factor
        self.strobe = np.full((n, 2, n_probes), np.nan)
        self.envelope = np.full((n, 2, n_probes), np.nan)
        self.ledger = np.full((n, len(LEDGER)), np.nan)
        self.impulse = np.full((n, 3), np.nan)
        self.effort = np.zeros((n, len(EFFORT)), dtype=np.int64)
        self.window: deque[PeriodRecord] = deque(maxlen=span.window_periods)
        ticks = np.arange(1, span.frames_per_period + 1) * span.steps_per_period
        self._frame_steps = np.rint(ticks / max(span.frames_per_period, 1)).astype(np.int64)

    def open(
        self, stepper: Stepper, base_states: FloatArray, before: PeriodRecord | None = None
    ) -> PeriodRecord:
        """Return a new record of a period that begins at the present state.

        Args:
            stepper: stepper with the state.
            base_states: (q, q', q'') of the base at the steps of the period, shape (N + 1, 3).
            before: record of the period that ended in exactly this state, if there is one.
        """
        rows, n_observed = self.steps_per_period + 1, self._n_observed
        record = PeriodRecord(
            base_states,
            np.empty((rows, N_BASE + n_observed)),
            np.empty((rows, n_observed)),
            self._frame_steps,
            _level(stepper) if before is None or before.end is None else before.end,
            is_divided=np.zeros(rows, np.uint8),
            ticks_per_step=self.refine,
            resting=np.array(stepper.resting, dtype=np.bool_),
        )
        if before is None:
            stepper.observe()
            record.u[0], record.v[0] = stepper.seen_u, stepper.seen_v
        else:
            record.u[0], record.v[0] = before.u[before.n_steps], before.v[before.n_steps]
        return record

    def close(self, record: PeriodRecord, stepper: Stepper, n_steps: int) -> bool:
        """End a period after `n_steps` steps; return whether the motion stayed within `limit`.

        A motion with an energy that is not finite did not, also where no probe sees it.
        """
        k = self.n_closed
        record.end_steps(n_steps)
        if record.end is None:
            record.end = _level(stepper)
        self.window.append(record)
        self.n_closed += 1
        jumps = record.jumps.columns()
        if self.refine == 1:
            record.effort[0] = n_steps
        self.effort[k] = record.effort
        with np.errstate(all="ignore"):  # the return value reports a diverged motion
            n = self.strobe.shape[2]
            self.strobe[k] = record.u[n_steps, N_BASE : N_BASE + n], record.v[n_steps, :n]
            largest = _extremes(record.u, n_steps + 1, self.envelope[k])
            gains = np.maximum(jumps.energies, 0.0)
            self.impulse[k] = jumps.impulses.sum(), jumps.hit.size, gains.sum()
            self.ledger[k] = self._ledger_row(record, record.end)
        return bool(largest < self.limit) and bool(np.isfinite(self.ledger[k]).all())

    def complete(self, whole: Callable[[FloatArray], FloatArray]) -> None:
        """Replace the frames by those of all dofs.

        Args:
            whole: function that returns values of all dofs from those of this rank.
        """
        for record in self.window:
            record.frames = [whole(frame) for frame in record.frames]

    def energy_residual(self) -> float:
        """Return the largest residual of a period over the largest energy exchanged in one [-].

        It is NaN if any number of the ledger is not finite, and 1 for a residual of nothing.
        """
        rows = np.abs(self.ledger[: self.n_closed])
        if not np.isfinite(rows).all():
            return math.nan
        stored = rows[:, : EXCHANGED.start].sum(axis=1).max(initial=0.0)
        exchanged = rows[:, EXCHANGED].sum(axis=1).max(initial=0.0)
        residual = float(rows[:, -1].max(initial=0.0))
        return residual / (
            max(float(exchanged), LEAST_EXCHANGED * float(stored)) or residual or 1.0
        )

    def _ledger_row(self, record: PeriodRecord, after: Level) -> tuple[float, ...]:
        """Return stored energies, exchanged energies and the residual, in the order of `LEDGER`."""
        (start, dissipated, contact_damped), rows = record.start, slice(0, record.n_steps + 1)
        end, dissipated_after, contact_damped_after = after
        work, base_damping = base_flows(
            record.u[rows],
            (start.momentum, end.momentum),
            record.base_states[rows],
            self._base,
            self.time_step,
            (record.is_divided[rows], record.flows) if self.refine > 1 else None,
        )
        flows = Flows(
            base_work=work,
            damping_loss=dissipated_after - dissipated + base_damping,
            contact_damping_loss=contact_damped_after - contact_damped,
            impact_loss=-record.impact,
            spring_released=record.released,
        )
        residual = end.total - start.total - flows.net
        strain, by_force = end.strain, 0.0
        if self._base.is_force:  # E3
            q, attachment = record.base_states[rows, 0], record.u[rows, 2]
            strain -= q[-1] * attachment[-1]
            by_force = work - (q[-1] * attachment[-1] - q[0] * attachment[0])
            work = 0.0
        return (
            end.kinetic, strain, end.spring, work, by_force, flows.damping_loss,
            flows.contact_damping_loss, flows.impact_loss, flows.spring_released, residual,
        )  # fmt: skip


def _level(stepper: Stepper) -> Level:
    """Return the energies stored now and lost so far."""
    return stepper.energies(), stepper.dissipated, stepper.contact_damped


@kept
def _extremes(u, n_rows, envelope):  # type: ignore[no-untyped-def]
    """Write the extremes of each probe into `envelope`; return the largest magnitude.

    If a value is NaN, the extremes and the result are NaN.
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
