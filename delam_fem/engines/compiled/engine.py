"""The compiled engine: it computes all steps of a period in one call, for small systems.

It implements `simulation.loop.Engine`. Laws, schemes, energy ledger and records are the same as in
the PETSc engine, and so are the results, to round-off. This file translates between the Python
objects of the time loop and the arrays of compiled code. The method is in loop.py and contact.py,
the kernels are in lane_kernels.py and banded.py.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from delam_fem.contact.laws import LAWS, ContactLaw, Law
from delam_fem.engines.compiled import contact, loop, state
from delam_fem.engines.compiled.handle import View, packed
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
from delam_fem.numerics.arrays import FloatArray, IntArray
from delam_fem.numerics.schemes import Scheme
from delam_fem.simulation.impacts import Columns
from delam_fem.simulation.loop import State
from delam_fem.simulation.recorder import PeriodRecord
from delam_fem.simulation.refinement import NOT_REFINED, Refinement

EVENTS, HITS = 4096, 16384
"""Room in the event buffers besides that of one step. A full buffer is emptied in Python."""

_PLACES = {name: place for name, (place, _) in View(Log).members.items()}


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
    numbers = law_numbers(law, scheme)
    if numbers.kind == state.IMPACTS and not numbers.is_coupled:
        operators.require_lumped_mass()
    sizes = [step_numbers(scheme, time_step / n) for n in (1, refinement.middle, refinement.factor)]
    return Compiled(operators, sizes, numbers, refinement)


def step_numbers(scheme: Scheme, time_step: float) -> StepNumbers:
    """Return the numbers of a scheme that compiled code needs."""
    if scheme.has_impulses_within:
        return StepNumbers.moreau_jean(time_step, scheme.theta)
    return StepNumbers.newmark(time_step, scheme.beta, scheme.gamma)


def law_numbers(law: ContactLaw, scheme: Scheme) -> LawNumbers:
    """Return the numbers of a contact law that compiled code needs.

    Raises:
        ValueError: the law is not in the table.
    """
    if not isinstance(law, Law):
        raise ValueError(
            f'engine "compiled": expected one of the laws {", ".join(LAWS)}, given {law.name!r}; '
            'use engine "petsc" for a law of your own'
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
    }[law.name]


class Compiled:
    """The compiled engine; its stepper holds the state.

    Attributes:
        operators: the semi-discrete problem.
        stepper: the state, in the form that a recorder reads.
        n_shares: 1: this process has all dofs.
    """

    n_shares = 1

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
        self.operators, self._refinement = operators, refinement
        self.stepper = CompiledStepper(operators, schemes, law)
        self._run = loop.prepared(refinement.factor > 1)
        self.stepper.observe()  # loads this code too, before the clock of a run starts
        self.stepper.energies()
        r = refinement.factor
        self._buffers: tuple[Log, IntArray] | None = None
        self._events = Columns.room(EVENTS + r, HITS + r * operators.n_pairs)

    def state(self) -> State:
        """Return the current state."""
        s = self.stepper
        return State(s.state(), s.resting, (s.dissipated, s.contact_damped), s.internal())

    def restore(self, state: State, base_state: FloatArray) -> None:
        """Take over a state unchanged; see `simulation.loop.Engine`."""
        self.stepper.memory.base[:] = base_state
        self.stepper.restore(state.motion, state.resting, state.internal)
        self.stepper.dissipated, self.stepper.contact_damped = state.losses

    def whole(self, share: FloatArray) -> FloatArray:
        """Return the values as they are: this process has all dofs."""
        return share

    share = whole

    def destroy(self) -> None:
        """Do nothing: Python frees the memory."""

    def run_period(self, record: PeriodRecord, floor: float) -> int:
        """Compute the steps of a period and write its record; see `simulation.loop.Engine`.

        Raises:
            ArithmeticError: no impulses were found, or velocities before an impact are not finite.
        """
        s, memory = self.stepper, self.stepper.memory
        log, address = self._log(record)
        memory.counts[N_FRAMES] = 0
        memory.totals[[IMPACT, RELEASED]] = 0.0
        memory.flows[:], memory.effort[:] = 0.0, 0
        memory.base[:] = record.base_states[0]
        step, ending = 0, state.FULL
        while ending == state.FULL:
            memory.counts[[N_EVENTS, N_HITS]] = 0
            step, ending = self._run(s.address, address, step + 1, floor)
            self._empty_events(record)
        record.end = s.stored_energies(), s.dissipated, s.contact_damped
        record.impact, record.released = (float(memory.totals[k]) for k in (IMPACT, RELEASED))
        record.flows[:], record.effort[:] = memory.flows, memory.effort
        n_kept = memory.counts[N_FRAMES]
        record.frames.extend(s.unknowns.outward(log.frames[:n_kept]))
        record.contact.extend(log.contact[:n_kept].copy())
        _require_impulses(ending)
        return int(step)

    def _log(self, record: PeriodRecord) -> tuple[Log, int]:
        """Return the buffers into which compiled code writes a period, and their address.

        They are made once; only the arrays of the record differ from period to period.
        """
        if self._buffers is None or self._buffers[0].frame_steps is not record.frame_steps:
            log = self._new_log(record)
            self._buffers = log, packed(log)
        log, table = self._buffers
        own = {"base_states": np.ascontiguousarray(record.base_states)}
        own |= {name: getattr(record, name) for name in ("u", "v", "is_divided")}
        for name, values in own.items():
            table[_PLACES[name]] = values.ctypes.data
        self._own = own  # what the table points to must stay
        return log, int(table.ctypes.data)

    def _new_log(self, record: PeriodRecord) -> Log:
        n_frames, size = record.frame_steps.size, self.stepper.system.size
        return Log(
            n_steps=len(record.base_states) - 1,
            refine=self._refinement.factor,
            middle=self._refinement.middle,
            slow=self._refinement.slow,
            n_frames=n_frames,
            n_events=self._events.ticks.size,
            n_hits=self._events.hit.size,
            base_states=np.ascontiguousarray(record.base_states),
            u=record.u,
            v=record.v,
            is_divided=record.is_divided,
            frame_steps=record.frame_steps,
            frames=np.empty((n_frames, 2, size)),
            contact=np.empty((n_frames, self.operators.n_pairs), dtype=np.int8),
            event_tick=self._events.ticks,
            event_size=self._events.sizes,
            event_energy=self._events.energies,
            hit=self._events.hit,
            impulse=self._events.impulses,
            rate_pre=self._events.rate_pre,
            rate_post=self._events.rate_post,
        )

    def _empty_events(self, record: PeriodRecord) -> None:
        """Copy the filled part of the event buffers into the record."""
        n, n_hits = self.stepper.memory.counts[[N_EVENTS, N_HITS]].tolist()
        if n:
            record.jumps.extend(self._events.first(n, n_hits))


def _require_impulses(ending: int) -> None:
    """Raise if the impulses were not found; the messages are those of complementarity.py."""
    if ending == contact.NOT_FINITE:
        raise ArithmeticError(
            "impulses: the velocities before the impact are not finite; the motion diverges: use a "
            "smaller time step"
        )
    if ending == contact.UNSOLVED:
        raise ArithmeticError(
            "impulses: no solution found; check that the mass, damping and stiffness matrices are "
            "symmetric"
        )
