"""The compiled engine: a period's steps in one call, for systems of modest size.

It fills the role `simulate.Engine` with the same laws, schemes, ledger and records as the PETSc
engine and the same results to round-off. This file translates between the Python objects of the
loop and the arrays of compiled code; the method is in loop.py and contact.py, the
kernels are in lane_kernels.py and banded.py.
"""

from __future__ import annotations

import numpy as np

from delam_fem.contact.laws import LAWS, ContactLaw, Law
from delam_fem.engines.compiled import contact, loop, state
from delam_fem.engines.compiled.state import (
    IMPACT,
    N_EVENTS,
    N_FRAMES,
    N_HITS,
    RELEASED,
    LawNumbers,
    Log,
)
from delam_fem.engines.compiled.stepper import CompiledStepper
from delam_fem.engines.compiled.system import StepNumbers
from delam_fem.model.operators import Operators
from delam_fem.numerics.arrays import FloatArray
from delam_fem.numerics.schemes import Scheme
from delam_fem.simulation.impacts import Columns
from delam_fem.simulation.loop import State
from delam_fem.simulation.recorder import PeriodRecord

EVENTS, HITS_PER_PAIR = 256, 16
"""Impacts, and hits per pair, after which the loop returns to have its buffers emptied."""


def compiled_engine(
    operators: Operators, law: ContactLaw, scheme: Scheme, time_step: float
) -> Compiled:
    """Return the engine that runs a problem in compiled code.

    Args:
        operators: the semi-discrete problem.
        law: one of the table `contact.laws.LAWS`.
        scheme: the time integration.
        time_step: Δt [s].

    Raises:
        ValueError: the law is not one of the table, or acts on a lumped mass that is missing.
    """
    numbers = law_numbers(law, scheme)
    if numbers.kind == state.IMPACTS and not numbers.is_coupled:
        operators.require_lumped_mass()
    return Compiled(operators, step_numbers(scheme, time_step), numbers)


def step_numbers(scheme: Scheme, time_step: float) -> StepNumbers:
    """Return a scheme as compiled code reads it."""
    if scheme.has_impulses_within:
        return StepNumbers.moreau_jean(time_step, scheme.theta)
    return StepNumbers.newmark(time_step, scheme.beta, scheme.gamma)


def law_numbers(law: ContactLaw, scheme: Scheme) -> LawNumbers:
    """Return a contact law as compiled code reads it.

    Raises:
        ValueError: the law is not one of the table.
    """
    if not isinstance(law, Law):
        raise ValueError(
            f'engine "compiled": expected one of the laws {", ".join(LAWS)}, given {law.name!r}; '
            'laws of your own need engine "petsc"'
        )
    e, (stiffness, damping), slow = law.restitution, law.spring, law.threshold_velocity
    within = scheme.has_impulses_within
    return {
        "none": LawNumbers(state.NONE),
        "newton": LawNumbers(state.MOREAU, True, e, threshold=slow)
        if within
        else LawNumbers(state.IMPACTS, law.is_coupled, e),
        "newton-penalty": LawNumbers(state.IMPACTS, law.is_coupled, e, stiffness, threshold=slow),
        "penalty": LawNumbers(state.PENALTY, stiffness=stiffness, damping=damping),
        "recovery": LawNumbers(state.RECOVERY, True, e, threshold=slow),
    }[law.name]


class Compiled:
    """The engine; its state is that of its stepper.

    Attributes:
        operators: the semi-discrete problem.
        stepper: the state, as a recorder reads it.
    """

    def __init__(self, operators: Operators, scheme: StepNumbers, law: LawNumbers) -> None:
        """Factorise; the state is at rest.

        Args:
            operators: the semi-discrete problem.
            scheme: the time integration.
            law: what happens in contact.

        Raises:
            ArithmeticError: a matrix is singular.
            ValueError: law "recovery" with θ = 1, where the start of a step is forgotten.
        """
        if law.kind == state.RECOVERY and scheme.rho == 0.0:
            raise ValueError(
                f'law "recovery": expected θ < 1, given {scheme.theta}: use the law "newton"'
            )
        self.operators = operators
        self.stepper = CompiledStepper(operators, scheme, law)
        self._events = Columns.room(EVENTS, HITS_PER_PAIR * operators.n_pairs)

    def state(self) -> State:
        """Return the present state."""
        s = self.stepper
        return State(s.state(), s.resting, (s.dissipated, s.contact_damped))

    def restore(self, state: State, base_state: FloatArray) -> None:
        """Take over a state as it is; see `simulate.Engine`."""
        self.stepper.memory.base[:] = base_state
        self.stepper.restore(state.motion, state.resting)
        self.stepper.dissipated, self.stepper.contact_damped = state.losses

    def destroy(self) -> None:
        """Do nothing: there is only memory to free."""

    def run_period(self, record: PeriodRecord, floor: float) -> int:
        """Compute the steps of a period into its record; see `simulate.Engine`.

        Raises:
            ArithmeticError: no impulses were found, or velocities before an impact are not finite.
        """
        s, memory = self.stepper, self.stepper.memory
        log = self._log(record)
        memory.counts[N_FRAMES] = 0
        memory.totals[[IMPACT, RELEASED]] = 0.0
        memory.base[:] = record.base_states[0]
        step, ending = 0, loop.FULL
        while ending == loop.FULL:
            memory.counts[[N_EVENTS, N_HITS]] = 0
            step, ending = loop.run_steps(s.system, s.law, memory, log, step + 1, floor)
            self._empty_events(record)
        record.end = s.stored_energies(), s.dissipated, s.contact_damped
        record.impact, record.released = (float(memory.totals[k]) for k in (IMPACT, RELEASED))
        n_kept = memory.counts[N_FRAMES]
        record.frames.extend(log.frames[:n_kept, :, s.order])
        record.contact.extend(log.contact[:n_kept])
        _require_impulses(ending)
        return int(step)

    def _log(self, record: PeriodRecord) -> Log:
        """Return where compiled code writes a period."""
        n_frames, size = record.frame_steps.size, self.stepper.system.size
        return Log(
            n_steps=len(record.base_states) - 1,
            n_frames=n_frames,
            n_events=self._events.steps.size,
            n_hits=self._events.hit.size,
            base_states=np.ascontiguousarray(record.base_states),
            u=record.u,
            v=record.v,
            frame_steps=record.frame_steps,
            frames=np.empty((n_frames, 2, size)),
            contact=np.empty((n_frames, self.operators.n_pairs), dtype=np.int8),
            event_step=self._events.steps,
            event_size=self._events.sizes,
            event_energy=self._events.energies,
            hit=self._events.hit,
            impulse=self._events.impulses,
            rate_pre=self._events.rate_pre,
            rate_post=self._events.rate_post,
        )

    def _empty_events(self, record: PeriodRecord) -> None:
        """Give the filled part of the event buffers to the record."""
        n, n_hits = self.stepper.memory.counts[[N_EVENTS, N_HITS]].tolist()
        if n:
            record.jumps.extend(self._events.first(n, n_hits))


def _require_impulses(ending: int) -> None:
    """Raise where the impulses could not be found; the words are those of complementarity.py."""
    if ending == contact.NOT_FINITE:
        raise ArithmeticError("impulses: the velocities before the impact are not finite")
    if ending == contact.UNSOLVED:
        raise ArithmeticError("impulses: no solution found (is the compliance symmetric?)")
