"""A case with a few modes of each part: its map from period to period, and its runs.

The contact is rigid and takes no energy. A case's law, restitution and scheme have no effect, but
for the law "none", which lets the laminae pass through one another.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from delam_fem.case.definition import Case
from delam_fem.case.toml import CaseError
from delam_fem.engines.modal.periods import Period, Periods
from delam_fem.engines.modal.state import Drive
from delam_fem.model import discretise
from delam_fem.model.layout import Structure
from delam_fem.model.operators import Operators
from delam_fem.model.reduced import Reduced, reduce
from delam_fem.numerics.arrays import FloatArray
from delam_fem.results.folder import Result
from delam_fem.simulation.setup import BaseStates, motion_of, span_of
from delam_fem.studies.reduced.recording import Recording

MODES, REFINE = 12, 64
"""Modes of each part, and fine steps in a coarse one, where nothing else is said."""


@dataclass(frozen=True)
class ReducedMotion:
    """A reduced case, ready to compute periods.

    A state is (q, q', s of each part), see `model.reduced`, shape (n_state,).

    Attributes:
        case: the case.
        structure: its discretisation, which the modes are those of.
        modes: number of modes of each part.
        periods: computes periods.
        motion: the drive, period by period.
    """

    case: Case
    structure: Structure
    modes: int
    periods: Periods
    motion: BaseStates

    @property
    def reduced(self) -> Reduced:
        """The reduced problem."""
        return self.periods.reduced

    @property
    def rest(self) -> FloatArray:
        """The state at t = 0 of a structure at rest, shape (n_state,)."""
        at_rest = np.zeros(self.reduced.n_state)
        if not self.structure.operators.base.is_force:  # seen from the base, which moves already
            o, (q, dq) = self.structure.operators, self.motion(0)[0, :2].tolist()
            m, pull = self.reduced.n_modes, o.mass @ self.reduced.drive @ self.reduced.shapes
            at_rest[:m], at_rest[m : 2 * m] = -q * pull, -dq * pull
        return at_rest

    def advance(self, state: FloatArray, periods: int = 1, first: int = 0) -> FloatArray:
        """Return the state some periods later; NaN if the motion diverges.

        Args:
            state: state at the beginning of a period, shape (n_state,).
            periods: number of periods.
            first: number of the first period, for drives that do not repeat.
        """
        for k in range(first, first + periods):
            state = self.periods.advance(state, self._drive(k))
        return state

    def period(self, state: FloatArray, number: int = 0) -> Period:
        """Compute a period and keep every step of it."""
        return self.periods.record(state, self._drive(number))

    def run(
        self,
        periods: int | None = None,
        *,
        initial: FloatArray | None = None,
        progress: Callable[[int, int], None] | None = None,
    ) -> Result:
        """Compute periods, and return what a run of the whole structure returns.

        Args:
            periods: number of periods; None: those of the case.
            initial: state at the start; None: at rest.
            progress: called after each period with the number of finished periods and of all.

        Returns:
            The result. Its energies are explained in docs/reduced.md.
        """
        span = span_of(self.case)
        n = span.periods if periods is None else periods
        window = min(span.window_periods, n)
        recording = Recording(
            self.structure, self.periods, replace(span, periods=n, window_periods=window)
        )
        state, begin = self.rest if initial is None else initial, time.perf_counter()
        outcome = "completed"
        for k in range(n):
            computed = self.period(state, k)
            if not recording.add(computed, state, self.motion(k)):
                outcome = "diverged"
                break
            state = computed.end
            if progress is not None:
                progress(k + 1, n)
        return recording.result(self.case, outcome, self.modes, time.perf_counter() - begin)

    def _drive(self, period: int) -> Drive:
        return (
            self._first_drive if self.case.is_periodic else self.periods.drive(self.motion(period))
        )

    @cached_property
    def _first_drive(self) -> Drive:
        return self.periods.drive(self.motion(0))


def reduced(
    case: Case,
    modes: int = MODES,
    *,
    refine: int = REFINE,
    structure: Structure | None = None,
) -> ReducedMotion:
    """Return a case with the lowest modes of each lamina, or of a bonded structure.

    Args:
        case: the case.
        modes: number of modes of each part that is kept.
        refine: number of fine steps in a time step of the case, near contact.
        structure: the discretised case; None: beams in closed form.

    Raises:
        CaseError: the case cannot be reduced to so many modes.
    """
    structure = discretise.assemble(case, needs_dolfinx=False) if structure is None else structure
    try:
        operators = structure.operators
        if case.contact.law == "none":
            operators = without_contact(operators)
        periods = Periods(reduce(operators, modes), case.time_step, refine)
    except ValueError as error:
        raise CaseError(f"case {case.name}: {error}") from None
    return ReducedMotion(case, structure, modes, periods, motion_of(case))


def without_contact(operators: Operators) -> Operators:
    """Return operators without pairs."""
    H = sp.csr_matrix((0, operators.n_dofs))
    return replace(operators, gap_matrix=H, gap0=np.zeros(0), pair_weights=None)
