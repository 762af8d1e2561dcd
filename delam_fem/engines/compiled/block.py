"""Keep the periods that compiled code has computed in one call until their records are needed."""

from __future__ import annotations

import numpy as np

from delam_fem.engines.compiled.stepper import CompiledStepper
from delam_fem.simulation.energy import LEVEL
from delam_fem.simulation.impacts import Columns, Jumps
from delam_fem.simulation.recorder import LEDGER, N_BASE, PeriodRecord, Recorder

OF_BLOCK = ("u", "v", "is_divided", "frames", "contact", "resting", "levels", "ends")
"""Members of a block that compiled code writes; see `state.Log`."""
_IMPACT, _RELEASED = LEDGER.index("impact_loss"), LEDGER.index("spring_released")


class Block:
    """Arrays for a block of periods; the last of them, one per slot, can become records.

    Attributes:
        n_slots: number of slots.
        base_states: (q, q', q'') of the base at the steps of each period, shape (N + 1, 3).
        addresses: those of the members of `OF_BLOCK`.
    """

    def __init__(self, stepper: CompiledStepper, recorder: Recorder, n_periods: int) -> None:
        """Allocate the arrays."""
        self.n_slots = n_slots = min(n_periods, recorder.window_periods)
        self._window_periods, self._frame_steps = recorder.window_periods, recorder.frame_steps
        self._unknowns, self._ticks_per_step = stepper.unknowns, recorder.refine
        rows, n_frames = recorder.steps_per_period + 1, recorder.frame_steps.size
        size, n_seen, n_pairs = stepper.system.size, stepper.system.n_probes, stepper.resting.size
        self.u = np.empty((n_slots, rows, N_BASE + n_seen))
        self.v = np.empty((n_slots, rows, n_seen))
        self.is_divided = np.zeros((n_slots, rows), dtype=np.uint8)
        self.frames = np.empty((n_slots, n_frames, 2, size))
        self.contact = np.empty((n_slots, n_frames, n_pairs), dtype=np.int8)
        self.resting = np.empty((n_slots, n_pairs), dtype=np.uint8)
        self.levels = np.empty((n_periods + 1, len(LEVEL)))
        self.ends = np.zeros((n_periods, 3), dtype=np.int64)
        self.addresses = [getattr(self, name).ctypes.data for name in OF_BLOCK]
        self.base_states = np.zeros((rows, 3))
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
        self._ledger, self._effort = recorder.ledger[rows], recorder.effort[rows]
        self._n = n_periods
        _, n_events, n_hits = self.ends[n_periods - 1].tolist() if n_periods else (0, 0, 0)
        self._events = events.part((0, n_events), (0, n_hits)).copy()

    def __len__(self) -> int:
        """Return the number of periods."""
        return self._n

    def records(self) -> list[PeriodRecord]:
        """Return the records of the last periods; they share the arrays of the block."""
        return [self._record(j) for j in range(max(0, self._n - self.n_slots), self._n)]

    def _record(self, j: int) -> PeriodRecord:
        slot, (n_steps, *last) = j % self.n_slots, self.ends[j].tolist()
        first = self.ends[j - 1, 1:].tolist() if j else (0, 0)
        n_frames = int(np.searchsorted(self._frame_steps, n_steps, side="right"))
        return PeriodRecord(
            self.base_states,
            self.u[slot],
            self.v[slot],
            self._frame_steps,
            self.levels[j],
            frames=list(self._unknowns.outward(self.frames[slot, :n_frames])),
            contact=list(self.contact[slot, :n_frames]),
            jumps=Jumps(self._events.part((first[0], last[0]), (first[1], last[1]))),
            released=float(self._ledger[j, _RELEASED]),
            impact=-float(self._ledger[j, _IMPACT]),
            n_steps=n_steps,
            is_divided=self.is_divided[slot],
            effort=self._effort[j],
            ticks_per_step=self._ticks_per_step,
            resting=self.resting[slot].astype(np.bool_),
        )
