"""The compiled engine: it computes all steps of a period in one call, for small systems.

It implements `simulation.loop.Engine`. Laws, schemes, energy ledger and records are the same as in
the PETSc engine, and so are the results, to round-off. This file translates between the Python
objects of the time loop and the arrays of compiled code. The method is in steps.py and contact.py,
the kernels are in simd_chains.py, inner_points.py and algebra.py.
"""

from __future__ import annotations

import threading
from collections.abc import Sequence
from functools import partial
from typing import Any, cast

import numpy as np

from delam_fem.contact import complementarity
from delam_fem.contact.decisions import IMPACTS, LawNumbers
from delam_fem.contact.laws import LAWS, ContactLaw, Law, Scheme
from delam_fem.engines.compiled import matrices, simd_chains as lk, state, steps
from delam_fem.engines.compiled.matrices import Problem, StepNumbers, System
from delam_fem.engines.compiled.state import (
    CONTACT_DAMPED,
    DISSIPATED,
    N_EVENTS,
    N_HITS,
    PeriodBuffers,
    View,
    packed,
)
from delam_fem.model.operators import Operators
from delam_fem.numerics.types import FloatArray
from delam_fem.simulation.loop import Engine, State
from delam_fem.simulation.recorder import (
    LEDGER,
    LEVEL,
    N_BASE,
    Columns,
    Jumps,
    PeriodRecord,
    Recorder,
    in_tables,
)
from delam_fem.simulation.refinement import NOT_REFINED, Refinement

OF_BLOCK = ("u", "v", "is_divided", "frames", "contact", "resting", "damped", "levels", "ends")
"""Members of a block that compiled code writes; see `state.PeriodBuffers`."""
_IMPACT = LEDGER.index("impact_loss")
_RELEASED = LEDGER.index("spring_released")


class BlockArrays:
    """Arrays for a block of periods; the last periods, one per slot, can become records.

    Attributes:
        n_slots: number of slots.
        base_states: (q, q', q'') of the base, then of each further force, at the steps of each
            period, shape (N + 1, 3 + 3 n_forces).
        addresses: addresses of the members of `OF_BLOCK`.
    """

    def __init__(self, engine: Compiled, recorder: Recorder, n_periods: int) -> None:
        """Allocate the arrays."""
        self.n_slots = n_slots = min(n_periods, recorder.window_periods)
        self._window_periods, self._frame_steps = recorder.window_periods, recorder.frame_steps
        self._unknowns = engine.unknowns
        self._ticks_per_step = recorder.refine
        rows = recorder.steps_per_period + 1
        n_frames = recorder.frame_steps.size
        size, n_seen, n_pairs = engine.system.size, engine.system.n_probes, engine.system.n_pairs
        self.u = np.empty((n_slots, rows, N_BASE + n_seen))
        self.v = np.empty((n_slots, rows, n_seen))
        self.is_divided = np.zeros((n_slots, rows), dtype=np.uint8)
        self.frames = np.empty((n_slots, n_frames, 2, size))
        self.contact = np.empty((n_slots, n_frames, n_pairs), dtype=np.int8)
        self.resting = np.empty((n_slots, n_pairs), dtype=np.uint8)
        self.damped = np.empty((n_slots, n_pairs))
        self.levels = np.empty((n_periods + 1, len(LEVEL)))
        self.ends = np.zeros((n_periods, 3), dtype=np.int64)
        self.addresses = [getattr(self, name).ctypes.data for name in OF_BLOCK]
        self.base_states = np.zeros((rows, 3 + 3 * engine.system.n_forces))
        self._n = 0

    def has_room(self, n_periods: int) -> bool:
        """Return whether a block of so many periods fits."""
        return n_periods <= len(self.ends) and min(n_periods, self._window_periods) <= self.n_slots

    def end(self, n_periods: int, events: Columns, recorder: Recorder) -> None:
        """Keep what the records of the computed periods need besides the arrays.

        Args:
            n_periods: number of periods.
            events: buffers with their impacts.
            recorder: recorder with their rows, before it takes the block.
        """
        rows = slice(recorder.n_closed, recorder.n_closed + n_periods)
        self._ledger = recorder.ledger[rows]
        self._n = n_periods
        first = max(0, n_periods - self.n_slots)
        self._begin = n_events, n_hits = self.ends[first - 1, 1:].tolist() if first else (0, 0)
        last = self.ends[n_periods - 1, 1:].tolist() if n_periods else (0, 0)
        self._events = events.part((n_events, last[0]), (n_hits, last[1])).copy()

    def __len__(self) -> int:
        """Return the number of periods."""
        return self._n

    def records(self) -> list[PeriodRecord]:
        """Return the records of the last periods; they share the arrays of the block."""
        return [self._record(j) for j in range(max(0, self._n - self.n_slots), self._n)]

    def _record(self, j: int) -> PeriodRecord:
        slot = j % self.n_slots
        n_steps, *last = self.ends[j].tolist()
        first = self.ends[j - 1, 1:].tolist() if j else (0, 0)
        impacts, hits = (
            (begin - shift, end - shift)
            for begin, end, shift in zip(first, last, self._begin, strict=True)
        )
        n_frames = int(np.searchsorted(self._frame_steps, n_steps, side="right"))
        return PeriodRecord(
            self.base_states,
            self.u[slot],
            self.v[slot],
            self._frame_steps,
            self.levels[j],
            frames=list(self._unknowns.outward(self.frames[slot, :n_frames])) if n_frames else [],
            contact=list(self.contact[slot, :n_frames]),
            jumps=Jumps(self._events.part(impacts, hits)),
            released=float(self._ledger[j, _RELEASED]),
            impact=-float(self._ledger[j, _IMPACT]),
            n_steps=n_steps,
            is_divided=self.is_divided[slot],
            ticks_per_step=self._ticks_per_step,
            resting=self.resting[slot].astype(np.bool_),
            damped=self.damped[slot],
        )


EVENTS, HITS = 4096, 16384
"""Room in the buffers for events and for hits, besides that of one step; full ones are enlarged."""

MOST_KEPT_HITS = 1 << 18
"""Room for hits of the largest buffers that wait for the next engine, 8 MB."""
_thread = threading.local()


def _room(n_events: int, n_hits: int) -> Columns:
    """Return event buffers with room at least for so many: those of the last engine, if they fit.

    The points of a sweep have engines of their own and about as many impacts. New buffers would
    come from the system page by page, and would grow to their size again.
    """
    events: Columns | None = getattr(_thread, "events", None)
    _thread.events = None
    if events is None or events.ticks.size < n_events or events.hit.size < n_hits:
        return Columns.room(n_events, n_hits)
    return events


_PLACES = {name: place for name, (place, _) in View(PeriodBuffers).members.items()}
_OF_BLOCK = [_PLACES[name] for name in ("n_slots", "base_states", "forces", *OF_BLOCK)]
_OF_EVENTS = (
    *("event_tick", "event_size", "event_energy"),
    *("hit", "impulse", "rate_pre", "rate_post"),
)
"""Members of `PeriodBuffers` in the order of `Columns`."""


def compiled_engine(
    operators: Operators,
    law: ContactLaw,
    scheme: Scheme,
    time_step: float,
    refinement: Refinement = NOT_REFINED,
) -> Compiled:
    """Return the engine that runs a problem in compiled code.

    Args:
        operators: the semi-discrete problem.
        law: a law of the table `contact.laws.LAWS`.
        scheme: the time integration.
        time_step: Δt [s].
        refinement: how steps near contact are divided.

    Raises:
        ValueError: the law is not in the table, or it acts on a lumped mass that is missing.
    """
    if not isinstance(law, Law):
        raise ValueError(
            f'engine "compiled": expected one of the laws {", ".join(LAWS)}, given {law.name!r}; '
            'use engine "petsc" for a law of your own'
        )
    numbers = law.numbers(scheme, operators.pair_numbers)
    if numbers.kind == IMPACTS and not numbers.is_coupled:
        operators.require_lumped_mass()
    sizes = [step_numbers(scheme, time_step / n) for n in (1, refinement.middle, refinement.factor)]
    return Compiled(operators, sizes, numbers, refinement)


def step_numbers(scheme: Scheme, time_step: float) -> StepNumbers:
    """Return the numbers of a scheme that compiled code needs."""
    if scheme.has_impulses_within:
        return StepNumbers.moreau_jean(time_step, scheme.theta)
    return StepNumbers.newmark(time_step, scheme.beta, scheme.gamma)


class Compiled(Engine):
    """The compiled engine: a problem, its scheme, its law and its state.

    Attributes:
        operators: the semi-discrete problem.
        system, memory: what compiled functions work on; the system is that of fine steps.
        unknowns: meaning of the internal numbers of the fields.
        address: address of the table of this `Problem`.
        steps_at_once: steps of a call: few enough to stop in time, many beside the cost of a call.
    """

    steps_at_once = 200_000

    def __init__(
        self,
        operators: Operators,
        schemes: Sequence[StepNumbers],
        law: LawNumbers,
        refinement: Refinement = NOT_REFINED,
    ) -> None:
        """Factorise the matrices; the state is at rest.

        Args:
            operators: the semi-discrete problem.
            schemes: the time integration with coarse, middle and fine steps.
            law: the contact law.
            refinement: how steps near contact are divided.

        Raises:
            ArithmeticError: a matrix is singular.
        """
        self.operators = operators
        self._refinement = refinement
        self._has_acceleration = schemes[-1].has_acceleration
        (coarse, _), (middle, _), (fine, self.unknowns) = (
            matrices.build_of_size(operators, scheme, 2 - k) for k, scheme in enumerate(schemes)
        )
        self.system = fine
        self.memory = state.memory(fine.size, operators.n_pairs, operators.n_forces)
        self.memory.load[:] = fine.load
        corner = np.array(operators.base.corner, dtype=float)
        self._problem = Problem(coarse, middle, fine, law, self.memory, corner)
        self._problem_table = packed(self._problem, (System,))
        self.address = int(self._problem_table.ctypes.data)
        r = refinement.factor
        self._run = steps.prepared(r > 1)
        self._events = _room(EVENTS + r, HITS + r * operators.n_pairs)
        self._spare: BlockArrays | None = None
        self._recorder: Recorder | None = None

    def state(self) -> State:
        """Return the current state, with a from the equation of motion."""
        self.renew_acceleration()
        fields = self._fields()
        totals = self.memory.totals
        losses = float(totals[DISSIPATED]), float(totals[CONTACT_DAMPED])
        internal = fields.copy() if self.system.is_modal else None
        pair_state = self.memory.pair_state.copy()
        return State(self.unknowns.outward(fields), pair_state, losses, internal)

    def restore(self, state: State, base_state: FloatArray) -> None:
        """Take over a state unchanged; see `simulation.loop.Engine`.

        The numbers of `internal` count if the motion follows from them: they have the round-off of
        the run that stored them.
        """
        memory = self.memory
        fields = self._fields()
        internal = state.internal
        memory.base[:] = base_state[:3]
        memory.force[:] = base_state[3::3]
        memory.load[:] = self.system.load + memory.force @ self.system.forces
        memory.X[:] = 0.0
        if internal is not None and internal.shape == fields.shape and self.system.is_modal:
            is_own = np.array_equal(self.unknowns.outward(internal), state.motion)
        else:
            is_own = False
        fields[:] = internal if is_own else self.unknowns.inward(state.motion)
        for memories, values in zip(memory.pair_state, state.pair_state, strict=True):
            memories[:] = values
        memory.totals[[DISSIPATED, CONTACT_DAMPED]] = state.losses
        if self._has_acceleration:  # the θ-scheme has no springs
            steps.list_springs(self.address)

    def renew_acceleration(self) -> None:
        """Compute a from the equation of motion; do nothing with the θ-scheme, which has no a."""
        if self._has_acceleration:
            steps.renew(self.address)

    def _fields(self) -> FloatArray:
        """Return u, v, a in internal order, shape (3, size)."""
        size = self.system.size
        return self.memory.X[: (lk.A + 1) * size].reshape(3, size)

    def advance(self, recorder: Recorder, base_states: FloatArray, n_periods: int) -> bool:
        """Compute periods and record them; see `simulation.loop.Engine`.

        Raises:
            ArithmeticError: no impulses were found, or velocities before an impact are not finite.
        """
        first = recorder.n_closed
        block = self._block(recorder, n_periods)
        block.base_states = np.ascontiguousarray(base_states)
        tables = in_tables(block.base_states)
        self._table[_OF_BLOCK] = [
            block.n_slots, *(table.ctypes.data for table in tables), *block.addresses
        ]  # fmt: skip
        self.memory.counts[[N_EVENTS, N_HITS]] = 0
        run = partial(self._run, self.address, self._address, first)
        done, step, ending = run((0, 0), n_periods)
        while ending == state.FULL:  # twice the room for events
            old = self._events
            self._events = Columns.room(2 * old.ticks.size, 2 * old.hit.size)
            for name, before, after in zip(_OF_EVENTS, old, self._events, strict=True):
                after[: before.size] = before
                self._table[_PLACES[name]] = after.ctypes.data
            sizes = self._events.ticks.size, self._events.hit.size
            self._table[[_PLACES["n_events"], _PLACES["n_hits"]]] = sizes
            done, step, ending = run((done, step), n_periods)
        block.end(done, self._events, recorder)
        self._spare = cast("BlockArrays | None", recorder.take(block))
        complementarity.require_solved(max(0, -ending))
        return ending == state.COMPLETED

    def destroy(self) -> None:
        """Leave the event buffers to the next engine of this thread."""
        if self._events.hit.size <= MOST_KEPT_HITS:
            _thread.events = self._events
            r = self._refinement.factor
            self._events = Columns.room(1 + r, 1 + r * self.operators.n_pairs)
            self._recorder = None

    def _block(self, recorder: Recorder, n_periods: int) -> BlockArrays:
        """Return a block with room for some periods; make the table of a new recorder."""
        block = self._spare
        self._spare = None
        if recorder is not self._recorder or block is None or not block.has_room(n_periods):
            block = BlockArrays(self, recorder, n_periods)
        if recorder is not self._recorder:
            self._recorder, self._table = recorder, packed(self._buffers(recorder, block))
            self._address = int(self._table.ctypes.data)
        return block

    def _buffers(self, recorder: Recorder, block: BlockArrays) -> PeriodBuffers:
        """Return what compiled code needs to write a block of a recorder."""
        r = self._refinement
        arrays: dict[str, Any] = {name: getattr(block, name) for name in OF_BLOCK}
        arrays |= zip(_OF_EVENTS, self._events, strict=True)
        return PeriodBuffers(
            n_steps=recorder.steps_per_period,
            refine=r.factor,
            middle=r.middle,
            slow=r.slow,
            n_slots=block.n_slots,
            n_frames=recorder.frame_steps.size,
            n_probes=recorder.strobe.shape[2],
            n_events=self._events.ticks.size,
            n_hits=self._events.hit.size,
            time_step=recorder.time_step,
            limit=recorder.limit,
            coupling=recorder.coupling,
            frame_steps=recorder.frame_steps,
            base_states=in_tables(block.base_states)[0],
            forces=in_tables(block.base_states)[1],
            **arrays,
            strobe=recorder.strobe,
            envelope=recorder.envelope,
            ledger=recorder.ledger,
            works=recorder.works,
            impulses=recorder.impulse,
            effort=recorder.effort,
        )
