"""The compiled engine: it computes blocks of periods in one call, for small systems.

It implements `simulation.loop.Engine`. Laws, schemes, energy ledger and records are the same as in
the PETSc engine, and so are the results, to round-off. This file translates between the Python
objects of the time loop and the arrays of compiled code. The method is in loop.py and contact.py,
the kernels are in lane_kernels.py and banded.py.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, cast

import numpy as np

from delam_fem.contact.laws import LAWS, ContactLaw, Law
from delam_fem.engines.compiled import contact, loop, state
from delam_fem.engines.compiled.block import OF_BLOCK, Block
from delam_fem.engines.compiled.handle import View, packed
from delam_fem.engines.compiled.state import (
    N_EVENTS,
    N_HITS,
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
from delam_fem.simulation.recorder import Recorder
from delam_fem.simulation.refinement import NOT_REFINED, Refinement

EVENTS, HITS = 4096, 16384
"""Room in the event buffers besides that of one step. A full buffer is enlarged."""

_PLACES = {name: place for name, (place, _) in View(Log).members.items()}
_OF_BLOCK = [_PLACES[name] for name in ("n_slots", "base_states", *OF_BLOCK)]
_OF_EVENTS = (
    *("event_tick", "event_size", "event_energy"),
    *("hit", "impulse", "rate_pre", "rate_post"),
)
"""Members of `Log` in the order of `Columns`."""


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
        steps_at_once: few enough to be stopped in time, and many beside what a call costs.
    """

    n_shares = 1
    steps_at_once = 10_000

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
        self._events = Columns.room(EVENTS + r, HITS + r * operators.n_pairs)
        self._spare: Block | None = None
        self._recorder: Recorder | None = None

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

    def advance(self, recorder: Recorder, base_states: FloatArray, n_periods: int) -> bool:
        """Compute periods and record them; see `simulation.loop.Engine`.

        Raises:
            ArithmeticError: no impulses were found, or velocities before an impact are not finite.
        """
        s, first = self.stepper, recorder.n_closed
        block = self._block(recorder, n_periods)
        block.base_states = np.ascontiguousarray(base_states)
        self._table[_OF_BLOCK] = [
            block.n_slots, block.base_states.ctypes.data, *block.addresses
        ]  # fmt: skip
        s.memory.counts[[N_EVENTS, N_HITS]] = 0
        done, step, ending = self._run(s.address, self._address, first, (0, 0), n_periods)
        while ending == state.FULL:
            self._enlarge()
            done, step, ending = self._run(s.address, self._address, first, (done, step), n_periods)
        block.end(done, self._events, recorder)
        self._spare = cast("Block | None", recorder.take(block))
        _require_impulses(ending)
        return ending == state.COMPLETED

    def _block(self, recorder: Recorder, n_periods: int) -> Block:
        """Return a block with room for some periods; make the table of a new recorder."""
        block, self._spare = self._spare, None
        if recorder is not self._recorder or block is None or not block.has_room(n_periods):
            block = Block(self.stepper, recorder, n_periods)
        if recorder is not self._recorder:
            self._recorder, self._table = recorder, packed(self._log(recorder, block))
            self._address = int(self._table.ctypes.data)
        return block

    def _log(self, recorder: Recorder, block: Block) -> Log:
        """Return what compiled code needs to write a block of a recorder."""
        r = self._refinement
        arrays: dict[str, Any] = {name: getattr(block, name) for name in OF_BLOCK}
        arrays |= zip(_OF_EVENTS, self._events, strict=True)
        return Log(
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
            base_states=block.base_states,
            **arrays,
            strobe=recorder.strobe,
            envelope=recorder.envelope,
            ledger=recorder.ledger,
            impulses=recorder.impulse,
            effort=recorder.effort,
        )

    def _enlarge(self) -> None:
        """Double the event buffers."""
        old = self._events
        self._events = Columns.room(2 * old.ticks.size, 2 * old.hit.size)
        for name, before, after in zip(_OF_EVENTS, old, self._events, strict=True):
            after[: before.size] = before
            self._table[_PLACES[name]] = after.ctypes.data
        sizes = self._events.ticks.size, self._events.hit.size
        self._table[[_PLACES["n_events"], _PLACES["n_hits"]]] = sizes


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
