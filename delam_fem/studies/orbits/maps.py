"""The stroboscopic map of a case, stepped by the compiled engine.

A state (u, v) says nothing of pairs at rest, which carry a spring in some laws. A pair counts as
resting where its gap is closed at the section: that is what the laws leave behind.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from delam_fem.contact.laws import Law
from delam_fem.engines.choose import engine_of
from delam_fem.model.operators import Operators
from delam_fem.numerics.arrays import FloatArray
from delam_fem.numerics.schemes import Scheme
from delam_fem.simulation.loop import Engine, State, one_period, set_initial
from delam_fem.simulation.recorder import N_BASE, PeriodRecord, Recorder
from delam_fem.simulation.setup import Prescribed
from delam_fem.simulation.span import Span
from delam_fem.studies.orbits.protocol import Nature, Passage, Slow

KEPT = 4
"""Engines that are kept: continuation returns to neighbouring parameters."""
BEGINNINGS = 20
"""Instants of a period among which its beginning is chosen."""
_RESTS_ON_SPRINGS = ("newton-penalty", "penalty")


@dataclass(frozen=True)
class Problem:
    """One problem whose drive repeats after each period.

    Attributes:
        operators: the semi-discrete problem.
        law: the contact law.
        scheme: the time integration.
        motion: the drive.
        span: time step, steps per period, refinement, bound.
        tip: two probes and the gap between them at rest [m], for the smallest gap; None: not seen.
    """

    operators: Operators
    law: Law
    scheme: Scheme
    motion: Prescribed
    span: Span
    tip: tuple[int, int, float] | None = None


class StrobeMap:
    """The map of a family of problems; see `protocol.PeriodMap`.

    Attributes:
        slow: coordinates for Newton's method.
        nature: what the map is of.
        evaluations: periods computed so far.
    """

    def __init__(
        self, problem_of: Callable[[float], Problem], slow: Slow, *, phase: float = 0.0
    ) -> None:
        """Store the family; engines are made when they are needed.

        Args:
            problem_of: problem for a value of the parameter; all have the same number of dofs.
            slow: coordinates for Newton's method.
            phase: where in a period of the drive a period of the map begins, 0 to 1.
        """
        self.slow, self.evaluations, self.phase = slow, 0, phase
        n = slow.basis.shape[0] // 2
        self.nature = Nature("finite elements", {"displacement": n, "velocity": n}, is_stepped=True)
        self._problem_of = problem_of
        self._ready: dict[float, _Ready] = {}

    def after(
        self, states: FloatArray, parameter: float, shifts: FloatArray | None = None
    ) -> FloatArray:
        """Return the states one period later; see `protocol.PeriodMap.after`."""
        ready = self._at(parameter)
        given = np.zeros(len(states)) if shifts is None else shifts
        result = np.empty_like(states)
        for row, (state, shift) in enumerate(zip(states, given.tolist(), strict=True)):
            result[row] = ready.end(state, shift)[0]
        self.evaluations += len(states)
        return result

    def watched(self, state: FloatArray, parameter: float, periods: int) -> Passage:
        """Return what is seen in some periods from a state."""
        ready, states, records = self._at(parameter), [state], []
        for _ in range(periods):
            end, record = ready.end(states[-1], 0.0)
            states.append(end)
            records.append(record)
        self.evaluations += periods
        u = np.concatenate([record.u[1:, N_BASE:] for record in records])
        tip = ready.problem.tip
        gap = np.full(len(u), np.inf) if tip is None else tip[2] + u[:, tip[1]] - u[:, tip[0]]
        gaps = gap.reshape(periods, -1)
        n = gaps.shape[1]
        return Passage(
            np.array(states[1:]),
            u[n - 1 - ready.first :: n],
            u.min(axis=0),
            u.max(axis=0),
            float(gaps.min()),
            gaps.min(axis=1),
            gaps[:, -1],
            u,
        )

    def opened(self, state: FloatArray, parameter: float) -> tuple[StrobeMap, FloatArray]:
        """Return the map whose periods begin where the tips are farthest apart, and the state.

        A kick there violates no gap. A map without tips, or of a case that is too coarse in time
        for other beginnings, is returned as it is.

        Args:
            state: at the beginning of a period, shape (2 n,).
            parameter: λ.
        """
        ready = self._at(parameter)
        tip, span = ready.problem.tip, ready.problem.span
        if tip is None or span.steps_per_period % BEGINNINGS:
            return self, state
        _, record = ready.end(state, 0.0, BEGINNINGS)
        every = span.steps_per_period // BEGINNINGS
        u = record.u[every::every, N_BASE:]
        best = int(np.argmax(u[:, tip[1]] - u[:, tip[0]]))
        share = ((best + 1) / BEGINNINGS + self.phase) % 1.0
        found = record.frames[best].ravel()
        return StrobeMap(self._problem_of, self.slow, phase=share), np.asarray(found)

    def _at(self, parameter: float) -> _Ready:
        """Return what is ready to compute periods at a parameter."""
        if parameter not in self._ready:
            while len(self._ready) >= KEPT:
                del self._ready[next(iter(self._ready))]
            self._ready[parameter] = _Ready(self._problem_of(parameter), self.phase)
        return self._ready[parameter]


class _Ready:
    """A problem with its engine, and tables of its drive on shifted step grids.

    Attributes:
        problem: the problem.
        first: number of the step of the drive at which a period of the map begins.
    """

    def __init__(self, problem: Problem, phase: float) -> None:
        span = problem.span
        self.problem, self.first = problem, round(phase * span.steps_per_period)
        self.engine: Engine = engine_of(
            problem.operators,
            problem.law,
            problem.scheme,
            span.time_step,
            refinement=span.refinement,
        )
        self._recorders: dict[int, Recorder] = {}
        self._tables: dict[float, FloatArray] = {}

    def end(
        self, state: FloatArray, shift: float, frames: int = 0
    ) -> tuple[FloatArray, PeriodRecord]:
        """Return the state one period later, NaN if the motion diverges, and the record.

        Args:
            state: at the beginning, shape (2 n,).
            shift: of the grid, as a share of a step.
            frames: number of states on the way that the record keeps.
        """
        table = self._table(shift)
        u, v = state.reshape(2, -1)
        motion = np.array([u, v, np.zeros_like(u)])
        operators = self.problem.operators
        resting = np.zeros(operators.n_pairs, dtype=np.bool_)
        if self.problem.law.name in _RESTS_ON_SPRINGS:
            resting = operators.gap_matrix @ u + operators.gap0 <= 0.0
        set_initial(self.engine, State(motion, resting), table[0])
        recorder = self._recorder(frames)
        record = one_period(self.engine, recorder, table)
        if record.n_steps < len(table) - 1:
            return np.full_like(state, np.nan), record
        return self.engine.state().motion[:2].ravel(), record

    def _recorder(self, frames: int) -> Recorder:
        """Return a recorder that keeps some states of each period."""
        if frames not in self._recorders:
            problem = self.problem
            span = replace(problem.span, frames_per_period=frames)
            operators = problem.operators
            own = Recorder(operators.base, span, operators.n_probes, operators.n_sensors)
            self._recorders[frames] = own
        return self._recorders[frames]

    def _table(self, shift: float) -> FloatArray:
        """Return (q, q', q'') on a grid that begins a share of a step later, shape (N + 1, 3)."""
        if shift not in self._tables:
            span = self.problem.span
            steps = np.arange(span.steps_per_period + 1) + (shift + self.first)
            table = self.problem.motion.states(steps * span.time_step)
            table[-1] = table[0]
            self._tables[shift] = table
        return self._tables[shift]
