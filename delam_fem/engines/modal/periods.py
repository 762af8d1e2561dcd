"""Compute periods of a reduced problem: state in, state a period later out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from delam_fem.engines.modal import march, state
from delam_fem.engines.modal.propagator import step_of
from delam_fem.engines.modal.state import Drive, Trace
from delam_fem.model.reduced import Reduced
from delam_fem.numerics.arrays import FloatArray, IntArray


@dataclass(frozen=True)
class Period:
    """A computed period.

    Attributes:
        end: state at its end, shape (n_state,).
        trace: what is kept of each step.
        lowest: smallest gap of each pair, shape (n_pairs,) [m].
        exchanged: work of the drive, losses in modal damping, in the creep of the omitted modes and
            at the instants of closing (M2 of march.py), shape (4,) [J].
        effort: numbers of coarse and of fine steps, shape (2,).
    """

    end: FloatArray
    trace: Trace
    lowest: FloatArray
    exchanged: FloatArray
    effort: IntArray


class Periods:
    """Computes periods of a reduced problem under one periodic or prescribed drive.

    A state is (q, q', s of each part), shape (n_state,).

    Attributes:
        reduced: the reduced problem.
        time_step: Δt, the length of a coarse step [s].
        refine: number of fine steps in a coarse step near contact; 1: contact in coarse steps.
    """

    def __init__(self, reduced: Reduced, time_step: float, refine: int) -> None:
        """Compute the numbers of both sizes of steps.

        Raises:
            ValueError: there is no time step, or it is divided into less than one step.
        """
        if not (time_step > 0.0 and refine >= 1):
            raise ValueError(
                f"expected a time step above 0 and refine of at least 1, given {time_step} s, "
                f"{refine}"
            )
        self.reduced, self.time_step, self.refine = reduced, time_step, refine
        self._problem = state.problem_of(reduced)
        self._coarse = step_of(reduced, time_step)
        self._fine = step_of(reduced, time_step / refine)
        self._sizes = reduced.n_modes, reduced.n_pairs, reduced.n_parts
        self._memory, self._trace = state.memory(*self._sizes), state.trace(0, *self._sizes)

    def drive(self, base_states: FloatArray) -> Drive:
        """Return the drive of a period.

        Args:
            base_states: (q, q', q'') of the base, or a force and its derivatives, at the N + 1
                steps, shape (N + 1, 3).
        """
        loads = -base_states[:, ::-1] @ self.reduced.loads
        return Drive(np.ascontiguousarray(loads), base_states[:, 0].copy(), self.refine)

    def advance(self, start: FloatArray, drive: Drive) -> FloatArray:
        """Return the state one period later; NaN if the motion diverges.

        Args:
            start: state, shape (n_state,).
            drive: of the period; see `drive`.

        Raises:
            ArithmeticError: no contact forces were found.
        """
        if len(self._trace.q) != len(drive.motion):
            self._trace = state.trace(len(drive.motion) - 1, *self._sizes)
        return self._run(start, drive, self._trace)

    def record(self, start: FloatArray, drive: Drive) -> Period:
        """Compute a period and keep every step of it; see `advance`."""
        trace = state.trace(len(drive.motion) - 1, *self._sizes)
        end, memory = self._run(start, drive, trace), self._memory
        return Period(end, trace, memory.lowest.copy(), memory.totals.copy(), memory.effort.copy())

    def energies(self, at: FloatArray) -> tuple[float, float]:
        """Return kinetic and strain energy of a state [J]; the strain energy is that of M2."""
        q, v, s = self.split(at)
        strain = 0.5 * float(self.reduced.squares @ q**2)
        strain += 0.5 * float(np.einsum("ci,cij,cj->", s, self.reduced.compliance, s))
        return 0.5 * float(v @ v), strain

    def split(self, at: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return q, q' and s of a state, shapes (m,), (m,), (c, n)."""
        m, n, c = self._sizes
        return at[:m], at[m : 2 * m], at[2 * m :].reshape(c, n)

    def _run(self, start: FloatArray, drive: Drive, trace: Trace) -> FloatArray:
        memory = self._memory
        memory.q[:], memory.v[:], memory.s[:] = self.split(np.asarray(start, dtype=np.float64))
        memory.was_active[:] = 0
        ending = march.run_period(self._problem, self._coarse, self._fine, memory, drive, trace)
        if ending == state.UNSOLVED:
            raise ArithmeticError("reduced model: no contact forces were found in a step")
        end = np.concatenate([memory.q, memory.v, memory.s.ravel()])
        return end if ending == state.COMPLETED else np.full_like(end, np.nan)
