"""Record the periods of a reduced case as a run of the whole structure is recorded.

Energies are those of the energy ledger, with two differences. The damping loss includes the creep
of the omitted modes, and the impact loss is the loss at instants of closing, which tends to 0 with
the fine steps. The base work leaves out what mass-proportional damping takes from the motion of the
base itself.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from delam_fem.case.definition import Case
from delam_fem.engines.modal.periods import Period, Periods
from delam_fem.model.layout import Structure
from delam_fem.numerics.arrays import BoolArray, FloatArray, IntArray
from delam_fem.results import dataset, diagnostics
from delam_fem.results.folder import Result, json_ready
from delam_fem.simulation.energy import Energies
from delam_fem.simulation.impacts import Columns
from delam_fem.simulation.recorder import N_BASE, N_SIZES, PeriodRecord, Recorder
from delam_fem.simulation.refinement import NOT_REFINED
from delam_fem.simulation.span import Span

ENGINE = "modal"
"""Name of the engine in results."""


class _Start:
    """The start of the first period, as a recorder reads it; what it computes is replaced."""

    dissipated = contact_damped = 0.0

    def __init__(self, n_dofs: int, n_probes: int, n_pairs: int) -> None:
        self.seen_u, self.seen_v = np.zeros(N_BASE + n_probes), np.zeros(n_probes)
        self._n_dofs, self._n_pairs = n_dofs, n_pairs

    @property
    def resting(self) -> BoolArray:
        return np.zeros(self._n_pairs, dtype=np.bool_)

    def energies(self) -> Energies:
        return Energies(0.0, 0.0, 0.0)

    def state(self) -> FloatArray:
        return np.zeros((3, self._n_dofs))

    def observe(self) -> None:
        return None


class Recording:
    """A recorder of periods of a reduced case."""

    def __init__(self, structure: Structure, periods: Periods, span: Span) -> None:
        """Allocate the rows of all periods."""
        self._structure, self._periods = structure, periods
        o, reduced = structure.operators, periods.reduced
        span = Span(
            span.time_step, span.steps_per_period, span.periods, span.window_periods,
            span.frames_per_period, span.limit, NOT_REFINED,
        )  # fmt: skip
        self._recorder = Recorder(o.base, span, o.n_probes)
        self._start = _Start(o.n_dofs, o.n_probes, o.n_pairs)
        self._of_modes = reduced.probes @ reduced.shapes
        self._of_forces = np.stack([reduced.probes @ X for X in reduced.residual])
        self._of_drive = reduced.probes @ reduced.drive
        self._lowest = np.inf

    def add(self, period: Period, start: FloatArray, base_states: FloatArray) -> bool:
        """Add a period; return whether the motion stayed within bounds.

        Args:
            period: the computed period.
            start: state at its start.
            base_states: (q, q', q'') of the drive at its steps, shape (N + 1, 3).
        """
        recorder, trace, k = self._recorder, period.trace, self._recorder.n_closed
        record = recorder.open(self._start, base_states)
        late = np.einsum("scn,cpn->sp", trace.s, self._of_forces, optimize=True)
        moved = np.outer(base_states[:, 0], self._of_drive)
        record.u[:, :N_BASE] = 0.0
        record.u[:, N_BASE:] = trace.q @ self._of_modes.T + late + moved
        record.v[:] = trace.v @ self._of_modes.T + np.outer(base_states[:, 1], self._of_drive)
        self._add_frames(record, period, base_states)
        self._add_contacts(record, period)
        is_bounded = recorder.close(record, self._start, len(base_states) - 1)
        recorder.ledger[k] = self._ledger_row(period, start, base_states)
        recorder.effort[k, [0, N_SIZES - 1]] = period.effort
        return is_bounded and bool(np.isfinite(period.end).all())

    def result(self, case: Case, outcome: str, modes: int, seconds: float) -> Result:
        """Return the result of the run."""
        recorder, structure = self._recorder, self._structure
        attributes = {"outcome": outcome, "engine": ENGINE, "modes": str(modes)}
        history = dataset.history(recorder, structure, case, attributes)
        steps = int(recorder.effort[: recorder.n_closed, :N_SIZES].sum())
        summary: dict[str, Any] = {
            "outcome": outcome,
            "engine": ENGINE,
            "model": {"kind": "reduced", "modes": modes, "refine": self._periods.refine},
            "steps": steps,
            "wall_seconds": seconds,
            "microseconds_per_step": 1e6 * seconds / max(steps, 1),
            "warnings": [],
            **diagnostics.summary(history, case),
            "energy_residual": recorder.energy_residual(),
        }
        return Result(case, history, json_ready(summary), None)

    def _add_frames(self, record: PeriodRecord, period: Period, base_states: FloatArray) -> None:
        """Add displacements and velocities of all dofs at the frames."""
        reduced, own, trace = self._periods.reduced, record.frame_steps, period.trace
        if not own.size:
            return
        u = reduced.displacement(trace.q[own], trace.s[own], base_states[own, 0])
        v = reduced.velocity(trace.v[own], base_states[own, 1])
        record.frames.extend(np.stack([u, v], axis=1))
        is_closed = np.zeros((own.size, self._structure.operators.n_pairs), np.int8)
        if reduced.n_pairs:
            is_closed[:] = trace.impulse[own] > 0.0
        record.contact.extend(is_closed)

    def _add_contacts(self, record: PeriodRecord, period: Period) -> None:
        """Add the impulses of the contact forces over each coarse step, as impacts at its end."""
        trace = period.trace
        step, pair = np.nonzero(trace.impulse > 0.0)
        if not step.size:
            return
        ticks, first, sizes = np.unique(step, return_index=True, return_counts=True)
        rates = trace.v @ self._periods.reduced.gap_modes.T
        hits: tuple[IntArray, FloatArray, FloatArray, FloatArray] = (
            pair, trace.impulse[step, pair], rates[step - 1, pair], rates[step, pair]
        )  # fmt: skip
        record.jumps.extend(Columns(ticks, sizes, np.zeros(first.size), *hits))

    def _ledger_row(
        self, period: Period, start: FloatArray, base_states: FloatArray
    ) -> tuple[float, ...]:
        """Return the energies of a period in the order of `recorder.LEDGER`."""
        periods, reduced = self._periods, self._periods.reduced
        work, modal, creep, closing = period.exchanged.tolist()
        (T0, V0), (T1, V1) = periods.energies(start), periods.energies(period.end)
        residual = T1 + V1 - T0 - V0 - (work - modal - creep - closing)
        if self._structure.operators.base.is_force:
            return T1, V1, 0.0, 0.0, work, modal + creep, 0.0, closing, 0.0, residual
        carried = [
            float(reduced.loads[0] @ periods.split(at)[1]) * dq + 0.5 * reduced.base_mass * dq**2
            for at, dq in ((start, base_states[0, 1]), (period.end, base_states[-1, 1]))
        ]
        base_work = work + carried[1] - carried[0]
        return T1 + carried[1], V1, 0.0, base_work, 0.0, modal + creep, 0.0, closing, 0.0, residual
