"""Numbers for each channel: how a measurement differs from a run once both are aligned."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from delam_fem.numerics.arrays import FloatArray
from delam_fem.results.overlay.alignment import Alignment, aligned, gains
from delam_fem.results.overlay.course import Course
from delam_fem.results.overlay.harmonics import HarmonicFit, fitted
from delam_fem.results.overlay.matching import Pairs


@dataclass(frozen=True)
class Comparison:
    """One channel of a measurement beside that of a run.

    Attributes:
        name: of the channel.
        units: of its values.
        is_drive: whether it is the drive.
        gain: measured amplitude over that of the run, at the channel's own phase.
        gain_error: its standard deviation.
        delay: time by which the channel comes later than the run after the alignment [s].
        delay_error: its standard deviation [s].
        correlation: of both after the alignment.
        mean_difference: mean of the measurement minus that of the run.
        residual: root mean square of measured minus computed without the mean difference.
        misfit: the same for what repeats only; None: the motion does not repeat.
        noise: standard deviation of what does not repeat; None likewise.
        measured: harmonics of the measurement; None likewise.
        computed: harmonics of the run; None likewise.
    """

    name: str
    units: str
    is_drive: bool
    gain: float
    gain_error: float
    delay: float
    delay_error: float
    correlation: float
    mean_difference: float
    residual: float
    misfit: float | None = None
    noise: float | None = None
    measured: HarmonicFit | None = None
    computed: HarmonicFit | None = None


def compared(pairs: Pairs, k: int, course: Course, alignment: Alignment) -> Comparison:
    """Return the comparison of one channel.

    Args:
        pairs: measurement and run.
        k: number of the channel.
        course: of all channels of the run.
        alignment: of all channels together.
    """
    single = course.only([k])
    values = pairs.measured[k : k + 1]
    at_own = aligned(pairs.time, values, single, alignment.rate, is_rate_free=False)
    gain, _, gain_error = gains(values[0], single.at(at_own.on_clock_of_run(pairs.time))[0])
    u = alignment.on_clock_of_run(pairs.time)
    computed = single.at(u)[0]
    known = np.isfinite(computed)
    rest = values[0, known] - computed[known]
    period = course.period
    delay = alignment.start - at_own.start
    if period is not None:
        delay = (delay + period / 2) % period - period / 2
    about: dict[str, Any] = {
        "name": pairs.names[k], "units": pairs.units[k], "is_drive": pairs.is_drive[k],
        "gain": gain, "gain_error": gain_error, "delay": delay,
        "delay_error": float(np.hypot(at_own.start_error, alignment.start_error)),
        "correlation": _correlation(values[0, known], computed[known]),
        "mean_difference": float(rest.mean()),
        "residual": float(np.std(rest)),
    }  # fmt: skip
    if period is None:
        return Comparison(**about)
    frequency = course.multiple / period
    measured = fitted(u, values[0], frequency, course.multiple)
    run = fitted(u, computed, frequency, course.multiple)
    repeating = measured.at(u) - computed
    return Comparison(
        **about, misfit=float(np.std(repeating)), noise=measured.noise, measured=measured,
        computed=run,
    )  # fmt: skip


def _correlation(a: FloatArray, b: FloatArray) -> float:
    """Return the correlation coefficient; 0 where one does not move."""
    a, b = a - a.mean(), b - b.mean()
    norm = float(np.sqrt((a @ a) * (b @ b)))
    return float(a @ b) / norm if norm > 0.0 else 0.0
