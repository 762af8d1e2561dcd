"""Record a run: every step of the last periods, one row of numbers per period, all impacts.

The energy ledger balances the work of the base, the stored energies and the losses. For the whole
system, base dofs included, in the fixed frame and over any interval of time,

    T + V + V_springs |_0^1 = W_base - D_damping - D_contact + E_impacts + E_springs      (E1)

E_impacts is the change of energy at impacts (negative when they dissipate). E_springs is the energy
that appears when a spring is put on or taken off a closed pair. Average-acceleration Newmark and
the Moreau–Jean scheme with θ = 1/2 fulfil E1 exactly if the work of the base over a step is

    W_base = -Δ(m·u) mean(q'') + Δ(c·u) mean(q') + mean(k·u) Δq + Δ[(m·v) q']
             + Δ[M_aa q'^2 / 2 + K_aa q^2 / 2] + Δt C_aa mean(q')^2      (E2)

A force F at a point with the loads f is a drive with k = -f and q = F (`BaseCoupling.force`). E2
then contains its potential: V and W_base stand for V - F f·u and -Σ mean(f·u) ΔF. The strain energy
and the work of the force follow by

    V = (V - F f·u) + F f·u,   W_force = Σ mean(F) Δ(f·u) = Δ(F f·u) - Σ mean(f·u) ΔF          (E3)

A further force F with the loads f (`Operators.n_forces`) does the work

    W_force = Σ mean(F) Δ(f·u)                                                               (E4)

of which the base takes Σ mean(F) f·r Δq where u = w + r q (`BaseCoupling.shift`), as E2 has it.

Here m, c, k are the base columns of M, C, K. For small steps this work tends to the integral of the
support reaction times q'.

The memory is that of the window and a few numbers per period, for a run of any length. The window
always contains the latest periods, also when a run is interrupted or diverges.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from itertools import chain, takewhile
from typing import NamedTuple, Protocol

import numpy as np
import numpy.typing as npt

from delam_fem.contact.decisions import Decision, PairState
from delam_fem.model.operators import BaseCoupling, DistributedOperators, Operators
from delam_fem.numerics.types import BoolArray, ByteArray, FloatArray, IntArray
from delam_fem.simulation.refinement import Span
from delam_fem.system.caches import kept, njit


class Energies(NamedTuple):
    """Stored energies at an instant [J].

    Attributes:
        kinetic: kinetic energy T [J].
        strain: strain energy V [J].
        spring: energy in the contact springs [J].
        momentum: m·v [kg m/s], which E2 needs at both ends of an interval.
    """

    kinetic: float
    strain: float
    spring: float
    momentum: float = 0.0


LEVEL = ("kinetic", "strain", "spring", "momentum", "dissipated", "contact_damped")
"""Entries of a level: energies stored at an instant, m·v, and the energies lost until then."""


@njit
def base_flows(seen, start, end, base_states, corner, time_step, is_divided, sums):  # type: ignore[no-untyped-def]
    """Return the work of the base over k steps, and the damping loss due to its motion, by E2.

    Args:
        seen: rows that begin with (m_b·u, c_b·u, k_b·u) at the k steps and at their start, shape
            (k+1, ≥ 3).
        start: m_b·v at the start [kg m/s].
        end: m_b·v at the end [kg m/s].
        base_states: (q, q', q'') of the base at the same steps, shape (k+1, 3).
        corner: (M_aa, C_aa, K_aa).
        time_step: Δt [s].
        is_divided: which steps were divided into smaller ones, shape (k+1,).
        sums: over the divided steps; see `add_flows`.

    Returns:
        Work of the base [J]; part of the damping loss that involves the base velocity [J].
    """
    by_mass, cross_damping, by_stiffness, square = sums[0], sums[1], sums[2], sums[3]
    for j in range(1, seen.shape[0]):
        if not is_divided[j]:
            terms = _flows(seen[j - 1], seen[j], base_states[j - 1], base_states[j], 1.0)
            by_mass += terms[0]
            cross_damping += terms[1]
            by_stiffness += terms[2]
            square += terms[3]
    corner_damping = corner[1] * time_step * square
    before, after = base_states[0], base_states[seen.shape[0] - 1]
    work = (
        cross_damping
        - by_mass
        + by_stiffness
        + end * after[1]
        - start * before[1]
        + 0.5 * corner[0] * (after[1] ** 2 - before[1] ** 2)
        + 0.5 * corner[2] * (after[0] ** 2 - before[0] ** 2)
        + corner_damping
    )
    return work, 2.0 * cross_damping + corner_damping


@njit
def write_ledger(row, levels, seen, base_states, coupling, time_step, is_divided, sums, gained):  # type: ignore[no-untyped-def]
    """Write the row of a period: stored energies, exchanged energies and the residual of E1.

    Args:
        row: gets the columns `LEDGER`.
        levels: entries of `LEVEL` at the start and at the end, shape (2, 6).
        seen: rows that begin with (m_b·u, c_b·u, k_b·u) at the k steps and at their start, shape
            (k+1, ≥ 3).
        base_states: (q, q', q'') of the base at the same steps, shape (k+1, 3).
        coupling: M_aa, C_aa, K_aa, and 1 if a force drives the structure, otherwise 0.
        time_step: Δt [s].
        is_divided: which steps were divided into smaller ones, shape (k+1,).
        sums: of the base's forces over the divided steps; see `add_flows`.
        gained: energies that impacts, and switching springs on and off, have added [J].
    """
    start = levels[0]
    end = levels[1]
    last = seen.shape[0] - 1
    work, base_damping = base_flows(
        seen, start[3], end[3], base_states, coupling, time_step, is_divided, sums
    )
    damping_loss = end[4] - start[4] + base_damping
    contact_loss = end[5] - start[5]
    impact_loss = -gained[0]
    released = gained[1]
    net = work - (damping_loss + contact_loss + impact_loss) + released
    residual = (end[0] + end[1] + end[2]) - (start[0] + start[1] + start[2]) - net
    strain = end[1]
    by_force = 0.0
    if coupling[3]:  # E3
        strain -= base_states[last, 0] * seen[last, 2]
        by_force = work - (base_states[last, 0] * seen[last, 2] - base_states[0, 0] * seen[0, 2])
        work = 0.0
    row[0] = end[0]
    row[1] = strain
    row[2] = end[2]
    row[3] = work
    row[4] = by_force
    row[5] = damping_loss
    row[6] = contact_loss
    row[7] = impact_loss
    row[8] = released
    row[9] = residual  # fmt: skip


@kept
def add_rows(sums, rows):  # type: ignore[no-untyped-def]
    """Add small steps to the four sums of `add_flows`.

    Args:
        sums: the four sums, shape (4,); changed.
        rows: the start and the end of each step: (m_b·u, c_b·u, k_b·u), (q, q', q''), and the size
            of the step over Δt, shape (k+1, 7).
    """
    for j in range(1, rows.shape[0]):
        before, after = rows[j - 1], rows[j]
        add_flows(sums, before, after, before[3:6], after[3:6], after[6])


@njit
def add_flows(sums, seen_before, seen, before, after, share):  # type: ignore[no-untyped-def]
    """Add a step to the four sums of `_flows`, shape (4,)."""
    terms = _flows(seen_before, seen, before, after, share)
    for k in range(4):
        sums[k] += terms[k]


@njit
def _flows(seen_before, seen, before, after, share):  # type: ignore[no-untyped-def]
    """Return Δ(m·u) mean(q''), Δ(c·u) mean(q'), mean(k·u) Δq, mean(q')² of a step.

    Args:
        seen_before: (m_b·u, c_b·u, k_b·u) at the start of the step.
        seen: the same at its end.
        before: (q, q', q'') of the base at its start.
        after: the same at its end.
        share: size of the step over Δt.
    """
    mean_dq = 0.5 * (after[1] + before[1])
    return (
        (seen[0] - seen_before[0]) * 0.5 * (after[2] + before[2]),
        (seen[1] - seen_before[1]) * mean_dq,
        0.5 * (seen[2] + seen_before[2]) * (after[0] - before[0]),
        mean_dq * mean_dq * share,
    )


class Columns(NamedTuple):
    """A table of n impacts and a table of the pairs that they hit, both in the order of time.

    Attributes:
        ticks: time of each impact, as a number of fine steps from the start, shape (n,).
        sizes: number of pairs that each impact hit, shape (n,).
        energies: energy that each impact added, shape (n,) [J].
        hit: pairs that were hit, impact after impact, shape (sum of sizes,).
        impulses: impulses on these pairs, shape (sum of sizes,) [N s].
        rate_pre: gap rates of these pairs before the impact, shape (sum of sizes,) [m/s].
        rate_post: gap rates of these pairs after the impact, shape (sum of sizes,) [m/s].
    """

    ticks: IntArray
    sizes: IntArray
    energies: FloatArray
    hit: IntArray
    impulses: FloatArray
    rate_pre: FloatArray
    rate_post: FloatArray

    @classmethod
    def room(cls, n: int, n_hits: int) -> Columns:
        """Return empty columns for n impacts on `n_hits` pairs in all."""
        ticks = np.zeros(n, np.int64)
        sizes = np.zeros(n, np.int64)
        hit = np.zeros(n_hits, np.int64)
        impulses, rate_pre, rate_post = np.zeros((3, n_hits))
        return cls(ticks, sizes, np.zeros(n), hit, impulses, rate_pre, rate_post)

    def part(self, impacts: tuple[int, int], hits: tuple[int, int]) -> Columns:
        """Return views of a range (first, end) of the impacts and of one of the hit pairs."""
        places = [slice(*impacts)] * 3 + [slice(*hits)] * 4
        return Columns._make(a[place] for a, place in zip(self, places, strict=True))

    def steps(self, ticks_per_step: int) -> IntArray:
        """Return the step, from 0, at the end of which or within which each pair is hit.

        It is -1 for pairs that are hit when the first step begins.
        """
        ends = -(-self.ticks // ticks_per_step)
        return np.repeat(ends, self.sizes) - 1

    def copy(self) -> Columns:
        """Return a copy."""
        return Columns._make(a.copy() for a in self)


_NONE = Columns.room(0, 0)
NO_FORCES = np.zeros(0)
"""What there is of further forces where there are none."""
NO_TABLE = np.zeros((0, 0))
"""Their table."""


class Jumps:
    """The impacts of a period in the order of time."""

    def __init__(self, columns: Columns = _NONE) -> None:
        """Start with the impacts of some columns."""
        self._columns = columns
        self._single: list[tuple[int, Decision, float]] = []

    def append(self, tick: int, decision: Decision, energy: float) -> None:
        """Add the impact of a decision that hits at least one pair."""
        self._single.append((tick, decision, energy))

    def columns(self) -> Columns:
        """Return the columns of all impacts; those that came one by one are made into columns."""
        if self._single:
            ticks, decisions, energies = zip(*self._single, strict=True)
            columns = zip(*(d[:4] for d in decisions), strict=True)
            joined = [np.array([*chain(*map(np.ndarray.tolist, column))]) for column in columns]
            sizes = np.array([d.hit.size for d in decisions])
            more = Columns(np.array(ticks), sizes, np.array(energies), *joined)
            both = zip(self._columns, more, strict=True)
            self._columns = Columns._make(map(np.concatenate, both))
            self._single = []
        return self._columns

    def hit_after(self, tick: int) -> IntArray:
        """Return the pairs hit after a tick, while impacts still come one by one."""
        latest = takewhile(lambda impact: impact[0] > tick, reversed(self._single))
        return np.concatenate([_NONE.hit, *(decision.hit for _, decision, _ in latest)])


N_BASE = 3
"""Number of leading entries of `seen_u` that belong to the energy ledger; the probes follow."""

LEDGER = (
    "kinetic", "strain", "spring", "base_work", "force_work", "damping_loss",
    "contact_damping_loss", "impact_loss", "spring_released", "residual",
)  # fmt: skip
"""Columns of the energy ledger."""

EXCHANGED = slice(LEDGER.index("base_work"), LEDGER.index("residual"))
"""Columns of what is exchanged within a period."""

ROUND_OFFS = 64.0
"""Round-offs of the largest terms that a sum of energies may have, over steps and dofs."""

LEAST_EXCHANGED = 1e-2
"""Share of the stored energy that counts as exchanged at least, where the residual is scaled.
Otherwise the round-off of a free motion without damping would be judged by itself."""

EFFORT = ("coarse", "middle", "fine", "contacts", "unforeseen")
"""Columns of `Recorder.effort`: numbers of steps by size; divided steps with an impact, and those
of them whose first impact hit a pair that the coarse step did not see approach."""
COARSE, MIDDLE, FINE, CONTACTS, UNFORESEEN = range(len(EFFORT))
"""Their numbers; those of steps are also the levels of steps in engines."""

N_SIZES = 3
"""Number of leading columns of `EFFORT` that count steps."""

OPEN, HIT, RESTING = range(3)
"""Contact states of a pair in the frames."""


class Stepper(Protocol):
    """The part of a stepper that a recorder reads.

    Attributes:
        seen_u: (m_b·u, c_b·u, k_b·u), displacements of the probes and functionals of sensors,
            shape (3 + n_probes + n_sensors,).
        seen_v: velocities of the probes and functionals of sensors, shape (n_probes + n_sensors,).
        dissipated: energy lost to damping so far [J].
        contact_damped: energy lost to contact dampers so far [J].
        pair_state: what is remembered of the pairs.
    """

    seen_u: FloatArray
    seen_v: FloatArray
    dissipated: float
    contact_damped: float
    pair_state: PairState

    def energies(self) -> Energies:
        """Return the stored energies of the present state."""

    def state(self) -> FloatArray:
        """Return (u, v, a) of the dofs of this rank, shape (3, n_own)."""

    def finish_step(self) -> None:
        """Book what a completed step has lost; `seen_u` and `seen_v` are then those of its end."""


@dataclass
class PeriodRecord:
    """The record of one period at every step.

    Attributes:
        base_states: (q, q', q'') of the base, then of each further force, shape
            (N + 1, 3 + 3 n_forces).
        u: `seen_u` at each step, start included, shape (N + 1, 3 + n_probes + n_sensors).
        v: `seen_v` at each step, start included, shape (N + 1, n_probes + n_sensors).
        frame_steps: steps at which the whole state is recorded (the frames), increasing.
        start: energies stored and lost so far when the period began, in the order of `LEVEL`.
        frames: (u, v) of the dofs of this rank at the frames, each of shape (2, n_own).
        contact: contact states at the frames, each of shape (n_pairs,): 0 open, 1 hit, 2 resting.
        jumps: impacts with their ticks, decisions and energy changes.
        released: energy that switching springs on and off has added [J].
        impact: energy that impacts have added [J].
        n_steps: number of computed steps.
        is_divided: which steps were divided near contact, shape (N + 1,).
        flows: sums over the divided steps, for the work of the base; see `add_flows`.
        force_flows: works of further forces over the divided steps, shape (n_forces,) [J].
        effort: numbers of steps and contacts, in the order of `EFFORT`, of steps that are counted
            one by one.
        ticks_per_step: r, the number of fine steps (ticks) in a step.
        resting: pairs at rest when the period began, shape (n_pairs,).
        damped: energy that the damper of each pair has taken, shape (n_pairs,) [J]; none: 0.
    """

    base_states: FloatArray
    u: FloatArray
    v: FloatArray
    frame_steps: IntArray
    start: FloatArray
    frames: list[FloatArray] = field(default_factory=list)
    contact: list[npt.NDArray[np.int8]] = field(default_factory=list)
    jumps: Jumps = field(default_factory=Jumps)
    released: float = 0.0
    impact: float = 0.0
    n_steps: int = 0
    is_divided: ByteArray = field(default_factory=lambda: np.zeros(0, np.uint8))
    flows: FloatArray = field(default_factory=lambda: np.zeros(4))
    force_flows: FloatArray = field(default_factory=lambda: np.zeros(0))
    effort: list[int] = field(default_factory=lambda: [0] * len(EFFORT))
    ticks_per_step: int = 1
    resting: BoolArray = field(default_factory=lambda: np.zeros(0, np.bool_))
    damped: FloatArray = field(default_factory=lambda: np.zeros(0))

    def __post_init__(self) -> None:
        """Prepare the lists in which `keep` collects rows."""
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
            resting = stepper.pair_state.resting
            state = np.where(resting, RESTING, OPEN).astype(np.int8)
            hit = self.jumps.hit_after((step - 1) * self.ticks_per_step)
            state[hit] = np.where(resting[hit], RESTING, HIT)
            self.contact.append(state)

    @property
    def n_collected(self) -> int:
        """Number of steps that `keep` has recorded, before the period ends."""
        return len(self._rows_u)

    def end_steps(self, n_steps: int) -> None:
        """Write the rows that `keep` has collected as bytes, all at once: row by row costs more."""
        self.n_steps = n_steps
        for rows, table in ((self._rows_u, self.u), (self._rows_v, self.v)):
            if rows:
                first = n_steps + 1 - len(rows)
                table[first : n_steps + 1] = np.frombuffer(bytearray().join(rows)).reshape(
                    len(rows), table.shape[1]
                )
                rows.clear()


class Block(Protocol):
    """Successive periods that an engine has computed in one go."""

    def __len__(self) -> int:
        """Return the number of periods."""

    def records(self) -> list[PeriodRecord]:
        """Return the records of the last periods, as many as a window may need."""


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
        works: works of further forces within each period, shape (n_periods, n_forces) [J].
        effort: numbers of steps and contacts within each period, in the order of `EFFORT`, shape
            (n_periods, 5).
        refine: r, the number of fine steps in a step.
        round_off: round-off of the strain energy over the square of the largest displacement [N/m].
        window_periods: number of last periods whose records are kept.
        frame_steps: steps of a period at which the whole state is recorded (the frames).
        coupling: corner terms of the base, whether a force drives, and f·r of further forces (E4),
            as compiled code reads them.
    """

    def __init__(
        self,
        base: BaseCoupling,
        span: Span,
        n_probes: int,
        n_sensors: int = 0,
        *,
        round_off: float = 0.0,
        forces_shift: FloatArray = NO_FORCES,
    ) -> None:
        """Allocate the rows of all periods.

        Args:
            base: coupling to the base, for the energy ledger.
            span: length of the run, and what it records.
            n_probes: number of probes, which are recorded at every step.
            n_sensors: number of functionals of sensors, which are recorded behind the probes.
            round_off: see `energy_round_off`.
            forces_shift: f·r of each further force, shape (n_forces,), whose rows are the last of
                the sensors.
        """
        self._parts = (base, n_probes, n_sensors)
        self._forces_shift = forces_shift
        self.n_forces = int(forces_shift.size)
        self._span = span
        self.round_off = round_off
        self.coupling = np.array([*base.corner, base.is_force, *forces_shift])
        self.time_step = span.time_step
        self.n_observed = n_probes + n_sensors
        self.is_forced = base.is_force
        self.steps_per_period, self.n_periods = span.steps_per_period, span.periods
        self.limit = span.limit
        self.n_closed = 0
        n = span.periods
        self.refine = span.refinement.factor
        self.strobe = np.full((n, 2, n_probes), np.nan)
        self.envelope = np.full((n, 2, n_probes), np.nan)
        self.ledger = np.full((n, len(LEDGER)), np.nan)
        self.impulse = np.full((n, 3), np.nan)
        self.works = np.full((n, self.n_forces), np.nan)
        self.effort = np.zeros((n, len(EFFORT)), dtype=np.int64)
        self.window_periods = max(1, span.window_periods)
        self._window: deque[PeriodRecord] = deque(maxlen=self.window_periods)
        self._blocks: deque[Block] = deque()
        ticks = np.arange(1, span.frames_per_period + 1) * span.steps_per_period
        self.frame_steps = np.rint(ticks / max(span.frames_per_period, 1)).astype(np.int64)
        if n:
            none = np.zeros((1, N_BASE + self.n_observed))  # loads the code before the first period
            of_drives = np.zeros((1, 3 + 3 * self.n_forces))
            record = PeriodRecord(of_drives, none, none, self.frame_steps, none[0])
            record.is_divided = np.zeros(1, np.uint8)
            record.force_flows = np.zeros(self.n_forces)
            self._write(0, none, none, record, np.zeros((2, len(LEVEL))))
            self.strobe[0] = self.envelope[0] = self.ledger[0] = self.works[0] = np.nan

    @property
    def window(self) -> deque[PeriodRecord]:
        """Records of the last periods."""
        while self._blocks:
            self._window.extend(self._blocks.popleft().records())
        return self._window

    def impacts(self) -> Columns:
        """Return the impacts of the window; their ticks count from its start."""
        period = self.steps_per_period * self.refine
        tables = [record.jumps.columns() for record in self.window]
        moved = [table._replace(ticks=table.ticks + k * period) for k, table in enumerate(tables)]
        return Columns._make(map(np.concatenate, zip(_NONE, *moved, strict=True)))

    def take(self, block: Block) -> Block | None:
        """Take over periods whose rows are written; return a block that the window needs no more.

        The records of a block are not made until somebody asks for the window.
        """
        self.n_closed += len(block)
        self._blocks.append(block)
        later = sum(map(len, self._blocks)) - len(self._blocks[0])
        return self._blocks.popleft() if later >= self.window_periods else None

    def of_one_period(self) -> Recorder:
        """Return a recorder of one period of the same quantities."""
        base, n_probes, n_sensors = self._parts
        span = replace(self._span, periods=1, window_periods=1)
        return Recorder(
            base,
            span,
            n_probes,
            n_sensors,
            round_off=self.round_off,
            forces_shift=self._forces_shift,
        )

    def open(self, stepper: Stepper, base_states: FloatArray) -> PeriodRecord:
        """Return a new record of a period that begins at the present state.

        Args:
            stepper: stepper with the state.
            base_states: (q, q', q'') of the base, then of each further force, at the steps of the
                period, shape (N + 1, 3 + 3 n_forces).
        """
        rows = self.steps_per_period + 1
        n_observed = self.n_observed
        record = PeriodRecord(
            base_states,
            np.empty((rows, N_BASE + n_observed)),
            np.empty((rows, n_observed)),
            self.frame_steps,
            _level(stepper),
            is_divided=np.zeros(rows, np.uint8),
            force_flows=np.zeros(self.n_forces),
            ticks_per_step=self.refine,
            resting=stepper.pair_state.resting.copy(),
        )
        stepper.finish_step()
        record.u[0], record.v[0] = stepper.seen_u, stepper.seen_v
        return record

    def close(self, record: PeriodRecord, stepper: Stepper, n_steps: int) -> bool:
        """End a period after `n_steps` steps; return whether the motion stayed within `limit`.

        A motion whose energy is not finite did not, even if no probe shows it.
        """
        k = self.n_closed
        record.end_steps(n_steps)
        self.window.append(record)
        self.n_closed += 1
        jumps = record.jumps.columns()
        if not any(record.effort):  # no step was divided
            record.effort[COARSE] = n_steps
        self.effort[k] = record.effort
        with np.errstate(all="ignore"):  # the return value reports a diverged motion
            gains = np.maximum(jumps.energies, 0.0)
            self.impulse[k] = jumps.impulses.sum(), jumps.hit.size, gains.sum()
        rows = slice(0, n_steps + 1)
        levels = np.array([record.start, _level(stepper)])
        return self._write(k, record.u[rows], record.v[rows], record, levels)

    def _write(
        self, k: int, u: FloatArray, v: FloatArray, record: PeriodRecord, levels: FloatArray
    ) -> bool:
        """Write strobe, envelope and ledger of a period; return whether it stayed in bounds."""
        base_states, forces = in_tables(record.base_states)
        of_steps = self.coupling, self.time_step, record.is_divided, record.flows
        of_base = base_states, *of_steps, forces, record.force_flows
        gained = np.array([record.impact, record.released])
        rows = self.strobe[k], self.envelope[k], self.ledger[k], self.works[k]
        return bool(_write_period(u, v, levels, of_base, gained, rows, self.limit))

    def complete(self, whole: Callable[[FloatArray], FloatArray]) -> None:
        """Replace the frames by those of all dofs.

        Args:
            whole: function that returns values of all dofs from those of this rank.
        """
        for record in self.window:
            record.frames = [whole(frame) for frame in record.frames]

    def energy_residual(self, n_periods: int | None = None) -> float:
        """Return the largest residual of a period over the largest energy exchanged in one [-].

        What the round-off of the strain energy explains does not count: of a body that flies, or
        rests apart from where it began, that energy is the difference of large numbers. Where next
        to nothing is exchanged, a share of the stored energy is the scale. The residual is NaN if
        any number of the ledger is not finite, and 1 if no energy was stored or exchanged.

        Args:
            n_periods: number of the first periods that count; None: all that are recorded.
        """
        n = self.n_closed if n_periods is None else n_periods
        rows = np.abs(self.ledger[:n])
        if not np.isfinite(rows).all():
            return math.nan
        stored = rows[:, : EXCHANGED.start].sum(axis=1).max(initial=0.0)
        exchanged = rows[:, EXCHANGED].sum(axis=1).max(initial=0.0)
        moved = float(np.fmax.reduce(np.abs(self.envelope[:n]), None, initial=0.0))
        residual = float(rows[:, -1].max(initial=0.0)) - self.round_off * moved**2
        if residual <= 0.0:
            return 0.0
        return residual / (
            max(float(exchanged), LEAST_EXCHANGED * float(stored)) or residual or 1.0
        )


def in_tables(base_states: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the table of the base and that of further forces, as compiled code reads them.

    They are read-only, as a table that repeats is: Numba compiles for one type.

    Args:
        base_states: see `PeriodRecord`, shape (k, 3 + 3 n_forces).

    Returns:
        (q, q', q'') of the base, shape (k, 3); the same of forces, shape (k, 3 n_forces).
    """
    if base_states.shape[1] == 3:
        base = base_states.view()
        forces = NO_TABLE
    else:
        base, forces = map(np.ascontiguousarray, np.split(base_states, [3], axis=1))
    base.flags.writeable = False
    forces.flags.writeable = False
    return base, forces


def energy_round_off(operators: Operators | DistributedOperators) -> float:
    """Return the round-off of the strain energy over the square of the largest displacement [N/m].

    A rigid motion r of a body has the strain energy rᵀ K r / 2 = 0, a sum of numbers as large as
    the stiffness p K pᵀ at a probe p times the square of its displacement.
    """
    return ROUND_OFFS * float(np.finfo(np.float64).eps) * operators.probe_stiffness


def _level(stepper: Stepper) -> FloatArray:
    """Return the energies stored now and lost so far, in the order of `LEVEL`."""
    e = stepper.energies()
    losses = stepper.dissipated, stepper.contact_damped
    return np.array([e.kinetic, e.strain, e.spring, e.momentum, *losses])


@njit
def write_period(u, v, levels, of_base, gained, rows, limit):  # type: ignore[no-untyped-def]
    """Write strobe, envelope and ledger of a period; return whether it stayed within a limit.

    Args:
        u: rows of `PeriodRecord.u` at the start and at the computed steps.
        v: rows of `PeriodRecord.v` at the same steps.
        levels: energies at the start and at the end (`LEVEL`), shape (2, 6).
        of_base: (q, q', q'') at these steps; coupling, Δt, divided steps and sums over them, as
            `write_ledger` needs them; table of further forces, and their works over divided steps.
        gained: energies that impacts, and switching springs, have added, shape (2,) [J].
        rows: those of the period in `Recorder.strobe`, `envelope`, `ledger` and `works`.
        limit: gap or displacement beyond which a motion counts as diverged [m].
    """
    base_states, coupling, time_step, is_divided, sums, forces, force_flows = of_base
    strobe, envelope, ledger, works = rows
    last = u.shape[0] - 1
    largest = 0.0
    is_finite = True
    for k in range(strobe.shape[1]):
        strobe[0, k] = u[last, N_BASE + k]
        strobe[1, k] = v[last, k]
        low = high = u[0, N_BASE + k]
        is_known = True
        for row in range(1, last + 1):
            value = u[row, N_BASE + k]
            low = value if value < low else low
            high = value if value > high else high
            is_known &= value == value
        if not is_known:
            low = high = math.nan
        envelope[0, k] = low
        envelope[1, k] = high
        for value in (abs(low), abs(high)):
            if value > largest or value != value:
                largest = value
    write_ledger(ledger, levels, u, base_states, coupling, time_step, is_divided, sums, gained)
    for j in range(works.size):  # E4
        reading = u.shape[1] - works.size + j
        work = force_flows[j]
        carried = 0.0
        for row in range(1, last + 1):
            mean = 0.5 * (forces[row, 3 * j] + forces[row - 1, 3 * j])
            carried += mean * (base_states[row, 0] - base_states[row - 1, 0])
            if not is_divided[row]:
                work += mean * (u[row, reading] - u[row - 1, reading])
        carried *= coupling[4 + j]
        works[j] = work + carried
        ledger[3] -= carried
        ledger[4] += works[j]
        ledger[9] -= work
    for value in ledger:
        is_finite &= math.isfinite(value)
    return is_finite and largest < limit


@kept
def _write_period(u, v, levels, of_base, gained, rows, limit):  # type: ignore[no-untyped-def]
    """Call `write_period` from Python."""
    return write_period(u, v, levels, of_base, gained, rows, limit)
