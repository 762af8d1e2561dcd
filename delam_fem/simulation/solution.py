"""Hold the result of a run without a case: histories of the probes, impacts, energies."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from delam_fem.numerics.arrays import FloatArray, IntArray
from delam_fem.simulation.loop import Outcome, State
from delam_fem.simulation.recorder import LEDGER, N_BASE, PeriodRecord, Recorder


@dataclass(frozen=True)
class ImpactTable:
    """Impulses on pairs, one row per impulse, in the order of time.

    Attributes:
        time: end of the step of each impulse, shape (k,) [s].
        pair: number of the contact pair, shape (k,).
        impulse: impulse on the pair; positive pushes the pair apart, shape (k,) [N s].
        rate_pre: gap rate before the impulse, shape (k,) [m/s].
    """

    time: FloatArray
    pair: IntArray
    impulse: FloatArray
    rate_pre: FloatArray


@dataclass(frozen=True)
class Solution:
    """The result of a run without a case; times count from the start of the window.

    Attributes:
        outcome: "completed", "diverged" or "interrupted".
        recorder: recorder of the run.
        state: state at the end; another run may start from it.
    """

    outcome: Outcome
    recorder: Recorder
    state: State

    @property
    def records(self) -> list[PeriodRecord]:
        """Records of the periods of the window."""
        return list(self.recorder.window)

    @property
    def time(self) -> FloatArray:
        """Times of all steps of the window, its start included, shape (k,) [s]."""
        n_steps = sum(record.n_steps for record in self.records)
        return np.asarray(self.recorder.time_step * np.arange(n_steps + 1))

    @cached_property
    def displacement(self) -> FloatArray:
        """Displacements of the probes at the times `time`, shape (k, n_probes) [m]."""
        first, *_ = records = self.records
        rows = np.concatenate([first.u[:1], *(r.u[1 : r.n_steps + 1] for r in records)])
        n = self.recorder.strobe.shape[2]
        return np.asarray(rows[:, N_BASE : N_BASE + n])

    @cached_property
    def velocity(self) -> FloatArray:
        """Velocities of the probes at the times `time`, shape (k, n_probes) [m/s]."""
        first, *_ = records = self.records
        n = self.recorder.strobe.shape[2]
        return np.concatenate([first.v[:1, :n], *(r.v[1 : r.n_steps + 1, :n] for r in records)])

    @property
    def frames(self) -> FloatArray:
        """(u, v) of all dofs at the frames of the window, shape (n_frames, 2, n)."""
        return np.array([frame for record in self.records for frame in record.frames])

    @cached_property
    def impacts(self) -> ImpactTable:
        """All impacts of the window."""
        rows, before = [np.zeros((4, 0))], 0
        for record in self.records:
            for tick, decision, _ in record.jumps:
                time = (before + tick / record.ticks_per_step) * self.recorder.time_step
                instant = np.full(decision.hit.size, time)
                rows.append(
                    np.array([instant, decision.hit, decision.impulses, decision.rate_pre], float)
                )
            before += record.n_steps
        time_, pair, impulse, rate_pre = np.concatenate(rows, axis=1)
        return ImpactTable(time_, pair.astype(np.int64), impulse, rate_pre)

    @property
    def energy(self) -> dict[str, FloatArray]:
        """Columns of the energy ledger by name, each of shape (n_periods,) [J]."""
        rows = self.recorder.ledger[: self.recorder.n_closed]
        return dict(zip(LEDGER, rows.T, strict=True))
