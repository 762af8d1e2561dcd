"""The motion of a run as functions of time: repeated for ever if it is periodic."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import CubicSpline

from delam_fem.numerics.arrays import FloatArray

LEAST_OVERLAP = 0.3
"""Share of the shorter record that must overlap where the motion does not repeat."""


@dataclass(frozen=True)
class Course:
    """Histories of a run between and beyond its steps.

    Attributes:
        spline: of all histories, over the time since `start`; of a motion that repeats, the mean
            of its cycles.
        start: time of the first step that is used [s].
        end: time of the last step [s].
        period: after which the motion repeats [s]; None: it does not, and nothing is known beyond
            the window.
        multiple: periods of the drive in it.
        cycles: single cycles less their mean, shape (n_channels, n_cycles, n); None: no cycles.
        rows: numbers of the histories that are used; None: all.
    """

    spline: CubicSpline
    start: float
    end: float
    period: float | None
    multiple: int = 1
    cycles: FloatArray | None = None
    rows: tuple[int, ...] | None = None

    @classmethod
    def of(
        cls, time: FloatArray, values: FloatArray, period: float | None, multiple: int = 1
    ) -> Course:
        """Return the course through steps.

        Args:
            time: of the steps [s], equidistant, shape (m,).
            values: histories, shape (n_channels, m).
            period: after which the motion repeats [s]; the last whole cycles are averaged.
            multiple: periods of the drive in it.
        """
        if period is None:
            return cls(CubicSpline(time - time[0], values, axis=1), time[0], time[-1], None)
        n = round(period / (time[1] - time[0]))
        n_cycles = values.shape[1] // n
        cycles = values[:, values.shape[1] - n_cycles * n :].reshape(len(values), n_cycles, n)
        mean = cycles.mean(axis=1)
        closed = np.concatenate([mean[:, -1:], mean], axis=1)
        spline = CubicSpline(np.linspace(0.0, period, n + 1), closed, axis=1, bc_type="periodic")
        return cls(
            spline, float(time[-1]) - period, float(time[-1]), period, multiple,
            cycles - mean[:, None, :],
        )  # fmt: skip

    def starts(self, since: FloatArray, number: int) -> FloatArray:
        """Return instants at which a record may begin on the clock of the run [s].

        Args:
            since: instants of the record after its beginning, on the clock of the run [s].
            number: of instants for each period of the drive; of a motion that does not repeat 32
                times as many for window and record together.
        """
        if self.period is not None:
            n = number * self.multiple
            return self.start + self.period * np.arange(n) / n
        length, span = self.end - self.start, float(since[-1])
        room = (1.0 - LEAST_OVERLAP) * min(length, span)
        step = max(float(np.median(np.diff(since))), (length + span) / (number * 32))
        starts = np.arange(self.start - room, self.end - span + room, step)
        return starts if starts.size else np.arange(self.start, self.end, step)

    def only(self, rows: Sequence[int]) -> Course:
        """Return the course of some of the histories."""
        return replace(self, rows=tuple(rows))

    def at(self, time: FloatArray, derivative: int = 0) -> FloatArray:
        """Return the histories, or derivatives of them, at instants.

        Args:
            time: of the run's clock [s], shape (n,).
            derivative: 0, 1 or 2.

        Returns:
            Values, shape (n_channels, n); NaN beyond the window of a motion that does not repeat.
        """
        since = time - self.start
        if self.period is not None:
            since = np.mod(since, self.period)
        values: FloatArray = self.spline(since, derivative)
        values = values if self.rows is None else values[list(self.rows)]
        if self.period is None:
            values[:, (since < 0.0) | (since > self.end - self.start)] = np.nan
        return values

    def delay_error(self) -> float:
        """Return the standard deviation of the phases of single cycles of the run [s].

        It is not reduced by their number: what is left of a transient shifts them one way.
        """
        if self.cycles is None or self.period is None or self.cycles.shape[1] < 2:
            return 0.0
        rows = list(range(len(self.cycles)) if self.rows is None else self.rows)
        n = self.cycles.shape[2]
        slope = self.at(self.start + self.period * np.arange(1, n + 1) / n, 1)
        weights = 1.0 / np.maximum((slope**2).mean(axis=1), np.finfo(float).tiny)
        power = float(np.einsum("c,cn,cn->", weights, slope, slope))
        delays = np.einsum("c,cjn,cn->j", weights, self.cycles[rows], slope) / (power or 1.0)
        return float(np.std(delays, ddof=1))
