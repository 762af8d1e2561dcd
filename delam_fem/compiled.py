"""The compiled engine: a period's steps in one call, for systems of modest size.

It fills the role `simulate.Engine` with the same laws, schemes, ledger and records as the PETSc engine and
the same results to round-off. This file translates between the Python objects of the loop and the arrays
of compiled code; the method is in compiled_loop.py and compiled_contact.py, the kernels in
lane_kernels.py and banded.py.
"""

from __future__ import annotations

import numpy as np

from delam_fem import compiled_contact, compiled_loop, compiled_state, compiled_system, stability
from delam_fem import lane_kernels as lk
from delam_fem.compiled_state import CONTACT_DAMPED, DISSIPATED, IMPACT, RELEASED, Law, Log
from delam_fem.compiled_system import Scheme
from delam_fem.energy import Energies
from delam_fem.operators import FloatArray, Operators
from delam_fem.parameters import Case
from delam_fem.recorder import PeriodRecord
from delam_fem.simulate import State
from delam_fem.supervisor import Decision

EVENTS, HITS_PER_PAIR = 256, 16
"""Impacts, and hits per pair, after which the loop returns to have its buffers emptied."""


def compiled_engine(case: Case, operators: Operators) -> Compiled:
    """Return the engine that runs a case in compiled code.

    Args:
        case: law, scheme and their numbers.
        operators: the semi-discrete problem.

    Raises:
        CaseError: the time step is beyond the stability limit of the scheme.
    """
    law = law_of(case)
    if case.contact.law == "moreau":
        return Compiled(operators, Scheme.moreau_jean(case.time_step), law)
    beta = 0.25
    if case.time.scheme == "central-difference":
        stability.require_stable(operators, case.time_step, law.stiffness)
        beta = 0.0
    return Compiled(operators, Scheme.newmark(case.time_step, beta), law)


def law_of(case: Case) -> Law:
    """Return the contact law of a case as compiled code knows it."""
    contact = case.contact
    e, is_coupled = contact.restitution, contact.impulse == "consistent"
    stiffness, threshold = contact.penalty_stiffness, contact.threshold_velocity
    return {
        "none": Law(compiled_state.NONE),
        "newton": Law(compiled_state.IMPACTS, is_coupled, e),
        "newton-penalty": Law(
            compiled_state.IMPACTS, is_coupled, e, stiffness, threshold=threshold
        ),
        "penalty": Law(
            compiled_state.PENALTY, stiffness=stiffness, damping=contact.penalty_damping
        ),
        "moreau": Law(compiled_state.MOREAU, True, e, threshold=threshold),
    }[contact.law]


class Compiled:
    """State and steps in compiled code; engine and stepper in one.

    Attributes:
        operators: the semi-discrete problem.
        seen_u: m_b·u, c_b·u, k_b·u and the observed u, as of the last `observe`.
        seen_v: observed v likewise.
    """

    def __init__(self, operators: Operators, scheme: Scheme, law: Law) -> None:
        """Factorise; the state is at rest.

        Args:
            operators: the semi-discrete problem.
            scheme: the time integration.
            law: what happens in contact.

        Raises:
            ArithmeticError: a matrix is singular.
        """
        self.operators, self._law = operators, law
        self._system, self._order = compiled_system.build(operators, scheme)
        self._memory = compiled_state.memory(self._system.size, operators.n_pairs)
        self.seen_u: FloatArray = np.zeros(3 + operators.observed.size)
        self.seen_v: FloatArray = np.zeros(operators.observed.size)
        n = max(HITS_PER_PAIR * operators.n_pairs, 1)
        self._hits = (np.zeros(n, dtype=np.int64), np.zeros(n), np.zeros(n), np.zeros(n))
        self._events = (
            np.zeros(EVENTS, dtype=np.int64), np.zeros(EVENTS, dtype=np.int64), np.zeros(EVENTS),
        )  # fmt: skip

    # -- engine -------------------------------------------------------------------------------

    @property
    def stepper(self) -> Compiled:
        """The state, as a recorder reads it."""
        return self

    def start(self, initial: State | None, base_state: FloatArray) -> None:
        """Take a state, or rest, and renew the accelerations; see `simulate.Engine`."""
        self._memory.base[:] = base_state
        if initial is not None:
            self.restore(State(initial.motion, initial.permanent))
        self._renew()

    def state(self) -> State:
        """Return the present state; accelerations are those of the equation of motion."""
        self._renew()
        losses = self.dissipated, self.contact_damped
        return State(self._fields()[:, self._order], self._memory.permanent.astype(np.bool_), losses)

    def restore(self, state: State) -> None:
        """Take over a state as it is."""
        self._memory.X[:] = 0.0
        self._fields()[:, self._order] = state.motion
        self._memory.permanent[:] = state.permanent
        if self._law.kind != compiled_state.MOREAU:  # which has no springs
            compiled_loop.list_springs(self._system, self._memory)
        self._memory.totals[[DISSIPATED, CONTACT_DAMPED]] = state.losses

    def destroy(self) -> None:
        """Do nothing: there is only memory to free."""

    def run_period(self, record: PeriodRecord, floor: float) -> int:
        """Compute the steps of a period into its record; see `simulate.Engine`.

        Raises:
            ArithmeticError: no impulses were found, or velocities before an impact are not finite.
        """
        memory, size, n_frames = self._memory, self._system.size, record.frame_steps.size
        frames = np.empty((n_frames, 2, size))
        contact = np.empty((n_frames, self.operators.n_pairs), dtype=np.int8)
        log = Log(
            len(record.base_states) - 1, n_frames, self._events[0].size, self._hits[0].size,
            record.base_states, record.u, record.v, record.frame_steps, frames, contact,
            *self._events, *self._hits,
        )  # fmt: skip
        memory.counts[compiled_state.N_FRAMES] = 0
        memory.totals[[IMPACT, RELEASED]] = 0.0
        memory.base[:] = record.base_states[0]
        step, ending = 0, compiled_loop.FULL
        while ending == compiled_loop.FULL:
            memory.counts[[compiled_state.N_EVENTS, compiled_state.N_HITS]] = 0
            step, ending = compiled_loop.run_steps(
                self._system, self._law, memory, log, step + 1, floor
            )
            self._empty_events(record)
        record.impact, record.released = (float(memory.totals[k]) for k in (IMPACT, RELEASED))
        n_kept = memory.counts[compiled_state.N_FRAMES]
        record.frames.extend(frames[:n_kept, :, self._order])
        record.contact.extend(contact[:n_kept])
        _require_impulses(ending)
        return int(step)

    def _empty_events(self, record: PeriodRecord) -> None:
        """Turn the filled part of the event buffers into decisions of the record."""
        n = self._memory.counts[compiled_state.N_EVENTS]
        steps, sizes, energies = (values[:n].tolist() for values in self._events)
        hits = [values[: sum(sizes)].copy() for values in self._hits]
        first = 0
        for step, size, energy in zip(steps, sizes, energies, strict=True):
            part = slice(first, first + size)
            record.jumps.append((step, Decision(*(values[part] for values in hits)), energy))
            first += size

    # -- what a recorder reads ----------------------------------------------------------------

    @property
    def dissipated(self) -> float:
        """Energy that damping has taken from the free dofs so far [J]."""
        return float(self._memory.totals[DISSIPATED])

    @property
    def contact_damped(self) -> float:
        """Energy that contact dampers have taken so far [J]."""
        return float(self._memory.totals[CONTACT_DAMPED])

    def observe(self) -> None:
        """Bring `seen_u` and `seen_v` up to date."""
        compiled_loop.observe(self._system, self._memory, self.seen_u, self.seen_v)

    def energies(self) -> Energies:
        """Return the energies of the whole system, base included, in the fixed frame [J]."""
        kinetic, strain, spring, momentum, attachment = compiled_loop.stored_energies(
            self._system, self._law, self._memory
        )
        corner = self.operators.base.corner
        q, dq, _ = self._memory.base.tolist()
        return Energies(
            kinetic + dq * momentum + 0.5 * corner[0] * dq * dq,
            strain + q * attachment + 0.5 * corner[2] * q * q,
            spring,
            momentum,
        )

    def _renew(self) -> None:
        """Renew the accelerations; the θ-scheme has none, steps by bands keep theirs."""
        if self._law.kind != compiled_state.MOREAU:
            compiled_loop.renew(self._system, self._law, self._memory)

    def _fields(self) -> FloatArray:
        """Return u, v, a in internal order, shape (3, size)."""
        size = self._system.size
        return self._memory.X[: (lk.A + 1) * size].reshape(3, size)


def _require_impulses(ending: int) -> None:
    """Raise where the impulses could not be found; the words are those of complementarity.py."""
    if ending == compiled_contact.NOT_FINITE:
        raise ArithmeticError("impulses: the velocities before the impact are not finite")
    if ending == compiled_contact.UNSOLVED:
        raise ArithmeticError("impulses: no solution found (is the compliance symmetric?)")
