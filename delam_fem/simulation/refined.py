"""The engine that divides steps near contact; see refinement.py."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from delam_fem.contact.decision import NO_PAIRS
from delam_fem.numerics.arrays import BoolArray, FloatArray, IntArray
from delam_fem.simulation.energy import add_flows
from delam_fem.simulation.loop import Advancing, StepByStep
from delam_fem.simulation.recorder import N_BASE, PeriodRecord
from delam_fem.simulation.refinement import SAFETY, Refinement, base_within

COARSE, MIDDLE, FINE = 0, 1, -1
"""Levels of steps. Without middle steps, MIDDLE and FINE are the same level."""

BaseState = tuple[float, float, float]


class Refinable(Advancing, Protocol):
    """A stepper with several sizes of steps; see engines/petsc/dynamics.py."""

    time_step: float

    def use(self, level: int) -> None:
        """Choose the size of the next steps by its number."""

    def begin_step(self, before: BaseState, after: BaseState) -> None:
        """Begin a single step, over which the base moves between two states (q, q', q'')."""

    def keep(self) -> None:
        """Keep the present state for `undo`."""

    def undo(self) -> None:
        """Return to the state of the last `keep`."""

    def near(self, ahead: float) -> tuple[BoolArray, FloatArray]:
        """Return which pairs may close within a time ahead, or back; and all gap rates [m/s]."""


@dataclass(frozen=True)
class RefinedSteps(StepByStep):
    """The engine that makes single steps, and smaller ones near contact.

    Attributes:
        stepper: its sizes of steps are those of the refinement.
        supervisor: contact law, asked after every step.
        refinement: how steps are divided.
        time_step: Δt of a coarse step [s].
    """

    stepper: Refinable
    refinement: Refinement
    time_step: float

    def run_period(self, record: PeriodRecord, floor: float) -> int:
        """Compute the steps of a period and write them into its record; see `Engine`."""
        s, rows = self.stepper, [tuple(row) for row in record.base_states.tolist()]
        s.begin(record.base_states[:1])
        s.observe()
        for step in range(1, len(rows)):
            states = rows[step - 1], rows[step]
            near = self._leap(COARSE, states, record, step * self.refinement.factor)
            if near is not None:
                record.is_divided[step] = 1
                if not self._divide(record, step, states, near, floor):
                    return step - 1
            else:
                record.effort[0] += 1
            s.observe()
            record.keep(step, s)
        return len(rows) - 1

    def _leap(
        self, level: int, states: tuple[BaseState, BaseState], record: PeriodRecord, tick: int
    ) -> BoolArray | None:
        """Make a coarse or middle step that ends at a tick; undo it if a fast pair is near.

        Returns:
            The near pairs, shape (n_pairs,); None if the step was made.
        """
        s = self.stepper
        s.use(level)
        reach = 0.5 * SAFETY * s.time_step
        near, is_fast = self._near(reach)
        if level != COARSE and is_fast:
            return near
        s.keep()
        s.begin_step(*states)
        smallest_gap = s.advance()
        near_after, is_fast_after = self._near(-reach)
        if is_fast or is_fast_after:
            s.undo()
            return near | near_after
        self._ask(record, tick, smallest_gap)
        return None

    def _near(self, ahead: float) -> tuple[BoolArray, bool]:
        """Return which pairs may close, and whether one of them is fast enough to divide a step."""
        near, rate = self.stepper.near(ahead)
        return near, bool((np.abs(rate[near]) > self.refinement.slow).any())

    def _divide(
        self,
        record: PeriodRecord,
        step: int,
        states: tuple[BaseState, BaseState],
        near: BoolArray,
        floor: float,
    ) -> bool:
        """Make a coarse step in smaller steps; return False if the motion diverges.

        Args:
            record: record of the period.
            step: number of the coarse step.
            states: (q, q', q'') of the base at its start and end.
            near: pairs with a small gap according to the coarse step, shape (n_pairs,).
            floor: gap below which the motion counts as diverged [m].
        """
        r, m = self.refinement.factor, self.refinement.middle
        first, before, is_first = (step - 1) * r, states[0], True
        for j in range(1, m + 1):
            after, last = self._base_in(states, j / m), j * (r // m)
            if m > 1 and self._leap(MIDDLE, (before, after), record, first + last) is None:
                record.effort[1] += 1
                self._account(record, before, after, 1.0 / m)
                before = after
                continue
            for tick in range(last - r // m + 1, last + 1):
                after = self._base_in(states, tick / r)
                smallest_gap = self._fine_step((before, after))
                if smallest_gap < floor:
                    return False
                record.effort[2] += 1
                hit = self._ask(record, first + tick, smallest_gap)
                if hit.size and is_first:
                    is_first = False
                    record.effort[3] += 1
                    record.effort[4] += not near[hit].all()
                self._account(record, before, after, 1.0 / r)
                before = after
        return True

    def _fine_step(self, states: tuple[BaseState, BaseState]) -> float:
        """Make the candidate of a fine step; return the smallest gap to examine [m]."""
        s = self.stepper
        s.use(FINE)
        s.begin_step(*states)
        return s.advance()

    def _ask(self, record: PeriodRecord, tick: int, smallest_gap: float) -> IntArray:
        """Let the law examine the candidate; return the pairs that it hits."""
        s = self.stepper
        if smallest_gap <= 0.0 or s.is_resting:
            decision = self.supervisor.examine(s)
            if decision is not None:
                record.jump(tick, decision, s.jump(decision))
                return decision.hit
        return NO_PAIRS

    def _base_in(self, states: tuple[BaseState, BaseState], share: float) -> BaseState:
        """Return (q, q', q'') of the base within a coarse step; share 1 is its end."""
        if share == 1.0:
            return states[1]
        within: BaseState = base_within(*states, share, self.time_step)
        return within

    def _account(
        self, record: PeriodRecord, before: BaseState, after: BaseState, share: float
    ) -> None:
        """Add the work of the base over a small step, a share of a coarse one, to the record."""
        s = self.stepper
        seen_before = s.seen_u[:N_BASE].copy()
        s.observe()
        add_flows(record.flows, seen_before, s.seen_u[:N_BASE], before, after, share)
