"""The engine that computes steps in PETSc, divides them near contact, and asks a contact law."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from delam_fem.contact.decisions import NO_PAIRS, LawContext
from delam_fem.contact.laws import LAWS, ContactLaw, Law, Scheme
from delam_fem.engines.petsc.newmark import Newmark
from delam_fem.engines.petsc.theta import MoreauJean
from delam_fem.model.operators import DistributedOperators, Operators
from delam_fem.numerics.types import BoolArray, FloatArray, IntArray
from delam_fem.simulation.loop import StepByStep
from delam_fem.simulation.recorder import (
    COARSE,
    CONTACTS,
    FINE,
    MIDDLE,
    N_BASE,
    UNFORESEEN,
    PeriodRecord,
    add_rows,
)
from delam_fem.simulation.refinement import AHEAD, BACK, NOT_REFINED, SAFETY, Refinement, base_rows
from delam_fem.system.mpi import MPI


def petsc_engine(
    operators: Operators | DistributedOperators,
    law: ContactLaw,
    scheme: Scheme,
    time_step: float,
    refinement: Refinement = NOT_REFINED,
    comm: MPI.Intracomm = MPI.COMM_SELF,
) -> StepByStep:
    """Return the engine that computes single steps in PETSc.

    Args:
        operators: the semi-discrete problem; `Operators` are spread over the ranks.
        law: the contact law: one of the table, or a law of your own.
        scheme: the time integration.
        time_step: Δt [s].
        refinement: how steps near contact are divided.
        comm: communicator that shares the work of `Operators`; others have their own.

    Raises:
        ValueError: the law does not go with the scheme, or not with numbers that pairs have of
            their own.
    """
    sizes = [time_step / n for n in refinement.divisions]
    stepper = _stepper(operators, law, scheme, sizes, comm)
    setting = LawContext(operators.n_pairs, stepper.compliance, operators.pair_numbers)
    supervisor = law.supervisor(scheme, setting)
    if refinement.factor == 1:
        return StepByStep(stepper, supervisor)
    return RefinedSteps(stepper, supervisor, refinement, time_step)


def _stepper(
    operators: Operators | DistributedOperators,
    law: ContactLaw,
    scheme: Scheme,
    time_steps: Sequence[float],
    comm: MPI.Intracomm,
) -> Newmark | MoreauJean:
    """Return the stepper of a scheme, set up for a law."""
    if scheme.has_impulses_within:
        return MoreauJean(operators, *time_steps, theta=scheme.theta, comm=comm)
    return Newmark(
        operators,
        *time_steps,
        beta=scheme.beta,
        gamma=scheme.gamma,
        coupled_impulses=law.is_coupled,
        spring=_spring_of(operators, law, scheme),
        comm=comm,
    )


def _spring_of(
    operators: Operators | DistributedOperators, law: ContactLaw, scheme: Scheme
) -> tuple[float, float | FloatArray]:
    """Return stiffness [N/m] and damping [N s/m] of the springs of pairs; see `Newmark`.

    Raises:
        ValueError: pairs have numbers of their own, of which a law of your own does not know.
    """
    if operators.pair_numbers is None:
        return law.spring
    if not isinstance(law, Law):
        raise ValueError(
            f"{law.name!r} is a law of your own, which does not know the numbers that contacts "
            f"have of their own; take one of {', '.join(LAWS)}, or leave these numbers out"
        )
    numbers = law.numbers(scheme, operators.pair_numbers)
    damping = numbers.dampings(operators.n_pairs) if numbers.differ else numbers.damping
    return numbers.stiffness, damping


NOT_SOUGHT: BoolArray = np.zeros(0, dtype=np.bool_)

N_ENDS = N_BASE + 4
"""Numbers in a row of `add_rows`."""

BaseState = Sequence[float]


@dataclass(frozen=True)
class RefinedSteps(StepByStep):
    """The engine that makes single steps, and smaller ones near contact.

    Attributes:
        stepper: stepper with the sizes of steps of the refinement.
        supervisor: contact law, asked after every step.
        refinement: how steps are divided.
        time_step: Δt of a coarse step [s].
    """

    stepper: Newmark | MoreauJean
    refinement: Refinement
    time_step: float

    def run_period(self, record: PeriodRecord, floor: float) -> int:
        """Compute the steps of a period and write them into its record; see `StepByStep`."""
        s = self.stepper
        factor = self.refinement.factor
        rows = s.begin(record.base_states)
        s.finish_step()
        for step in range(1, len(rows)):
            near = self._leap(COARSE, rows[step - 1], rows[step], record, step * factor)
            if near is not None:
                record.is_divided[step] = 1
                ends: list[float] = []
                is_bounded = self._divide(record, step, rows, near, floor, ends)
                add_rows(record.flows, np.array(ends).reshape(-1, N_ENDS))
                if not is_bounded:
                    return step - 1
            else:
                record.effort[COARSE] += 1
            s.finish_step()
            record.keep(step, s)
        return len(rows) - 1

    def _leap(
        self, level: int, before: BaseState, after: BaseState, record: PeriodRecord, tick: int
    ) -> BoolArray | None:
        """Make a coarse or middle step that ends at a tick; undo it if a fast pair is near.

        Returns:
            None if the step was made. If not, the near pairs of a coarse step, shape (n_pairs,);
            those of a middle step are not sought.
        """
        s = self.stepper
        slow = self.refinement.slow
        s.use(level)
        reach = 0.5 * SAFETY * s.time_step
        is_fast = s.nearness(reach, slow) & AHEAD
        if is_fast and level != COARSE:
            return NOT_SOUGHT
        s.keep()
        s.begin_step(before, after)
        smallest_gap = s.advance()
        if is_fast or s.nearness(reach, slow) & BACK:
            near = self._near(-reach) if level == COARSE else NOT_SOUGHT
            s.undo()
            return near | self._near(reach) if level == COARSE else near
        self._ask(record, tick, smallest_gap)
        return None

    def _near(self, ahead: float) -> BoolArray:
        """Return which pairs may close within a time ahead, or back (F1), shape (n_pairs,)."""
        gap, rate = self.stepper.margins()
        return np.asarray(gap + np.minimum(ahead * rate, 0.0) <= 0.0)

    def _divide(
        self,
        record: PeriodRecord,
        step: int,
        rows: Sequence[BaseState],
        near: BoolArray,
        floor: float,
        ends: list[float],
    ) -> bool:
        """Make a coarse step in smaller steps; return False if the motion diverges.

        Args:
            record: record of the period.
            step: number of the coarse step.
            rows: (q, q', q'') of the base at the coarse steps.
            near: pairs with a small gap according to the coarse step, shape (n_pairs,).
            floor: gap below which the motion counts as diverged [m].
            ends: list that gets the rows of `add_rows`, one after the other.
        """
        s = self.stepper
        r = self.refinement.factor
        m = self.refinement.middle
        first = (step - 1) * r
        is_first = True
        within = _parts_of(rows[step - 1], rows[step], r, self.time_step)
        n_forces = s.operators.n_forces
        forces = np.array([within[0][3::3], s.seen_u[-n_forces:]]) if n_forces else None
        ends += [*s.seen_base.tolist(), *within[0][:3], 0.0]
        for last in range(r // m, r + 1, r // m):
            start = last - r // m
            if m > 1:
                if self._leap(MIDDLE, within[start], within[last], record, first + last) is None:
                    record.effort[MIDDLE] += 1
                    self._observe(within[last], 1.0 / m, ends)
                    self._account(record, within[last], forces)
                    continue
            s.use(FINE)
            for tick in range(start + 1, last + 1):
                s.begin_step(within[tick - 1], within[tick])
                smallest_gap = s.advance()
                if smallest_gap < floor:
                    return False
                record.effort[FINE] += 1
                hit = self._ask(record, first + tick, smallest_gap)
                if hit.size and is_first:
                    is_first = False
                    record.effort[CONTACTS] += 1
                    record.effort[UNFORESEEN] += not near[hit].all()
                self._observe(within[tick], 1.0 / r, ends)
                self._account(record, within[tick], forces)
        return True

    def _ask(self, record: PeriodRecord, tick: int, smallest_gap: float) -> IntArray:
        """Let the law examine the candidate; return the pairs that it hits."""
        s = self.stepper
        if smallest_gap <= 0.0 or s.is_resting:
            decision = self.supervisor.examine(s)
            if decision is not None:
                record.jump(tick, decision, s.jump(decision))
                return decision.hit
        return NO_PAIRS

    def _observe(self, base_state: BaseState, share: float, ends: list[float]) -> None:
        """Note the end of a small step, a share of a coarse one, for the work of the base."""
        self.stepper.finish_step()
        ends += [*self.stepper.seen_base.tolist(), *base_state[:3], share]

    def _account(
        self, record: PeriodRecord, base_state: BaseState, forces: FloatArray | None
    ) -> None:
        """Add the work of further forces over a small step to the record.

        Args:
            record: record of the period.
            base_state: state of the drives at its end.
            forces: the forces and what they moved at its start, shape (2, n_forces); changed to
                those at its end. None: there are none.
        """
        if forces is None:
            return
        after = np.array([base_state[3::3], self.stepper.seen_u[-forces.shape[1] :]])
        record.force_flows += 0.5 * (after[0] + forces[0]) * (after[1] - forces[1])
        forces[:] = after


def _parts_of(before: BaseState, after: BaseState, r: int, time_step: float) -> list[list[float]]:
    """Return the states of the drives where r equal parts of a step begin and end."""
    if len(before) == 3:
        rows: list[list[float]] = base_rows(tuple(before), tuple(after), r, time_step).tolist()
        return rows
    drives = [
        base_rows(tuple(before[k : k + 3]), tuple(after[k : k + 3]), r, time_step)
        for k in range(0, len(before), 3)
    ]
    joined: list[list[float]] = np.hstack(drives).tolist()
    return joined
