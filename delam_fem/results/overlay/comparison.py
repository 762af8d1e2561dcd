"""Numbers for each channel: how a measurement differs from a run once both are aligned."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from delam_fem.numerics.arrays import FloatArray
from delam_fem.results.overlay.alignment import COARSE, Alignment, aligned, gains
from delam_fem.results.overlay.course import Course
from delam_fem.results.overlay.harmonics import HarmonicFit, fitted
from delam_fem.results.overlay.matching import Pairs

SEVERAL = 3.0
"""Size of what is not explained over that of the noise from which it is no noise."""
ALIKE = 0.8
"""Correlation from which motions are alike; below its negative a sign is turned."""


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
        unlike: share of the motion that the run does not explain at the channel's own gain and
            phase; 0: it is within the noise.
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
    unlike: float
    misfit: float | None = None
    noise: float | None = None
    measured: HarmonicFit | None = None
    computed: HarmonicFit | None = None


def compared(
    pairs: Pairs, k: int, course: Course, alignment: Alignment, turn: float | None
) -> Comparison:
    """Return the comparison of one channel.

    The channel's own phase is that at which it correlates best within a period of the drive; a
    channel that is mirrored has a negative gain.

    Args:
        pairs: measurement and run.
        k: number of the channel.
        course: of all channels of the run.
        alignment: of all channels together.
        turn: period of the drive [s]; None: there is none.
    """
    single = course.only([k])
    values = pairs.measured[k : k + 1]
    u = alignment.on_clock_of_run(pairs.time)
    computed = single.at(u)[0]
    known = np.isfinite(computed)
    rest = values[0, known] - computed[known]
    correlation = _correlation(values[0, known], computed[known])
    sign = -1.0 if correlation < -ALIKE else 1.0
    starts = None if turn is None else alignment.start + turn * np.linspace(-0.5, 0.5, COARSE)
    at_own = aligned(
        pairs.time, sign * values, single, alignment.rate, is_rate_free=False, starts=starts
    )
    own = single.at(at_own.on_clock_of_run(pairs.time))[0]
    gain, mean, gain_error = gains(values[0], own)
    period = course.period
    about: dict[str, Any] = {
        "name": pairs.names[k], "units": pairs.units[k], "is_drive": pairs.is_drive[k],
        "gain": gain, "gain_error": gain_error, "delay": alignment.start - at_own.start,
        "delay_error": float(np.hypot(at_own.start_error, alignment.start_error)),
        "correlation": correlation,
        "mean_difference": float(rest.mean()),
        "residual": float(np.std(rest)),
    }  # fmt: skip
    if period is None:  # noise by third differences, in which a motion leaves little
        noise = float(np.std(np.diff(values[0], 3))) / np.sqrt(20.0)
        return Comparison(**about, unlike=_unlike(values[0], gain * own + mean, noise))
    frequency = course.multiple / period
    measured = fitted(u, values[0], frequency, course.multiple)
    run = fitted(u, computed, frequency, course.multiple)
    noise = measured.noise * np.sqrt(2.0 * measured.coefficients.size / values.size)
    return Comparison(
        **about, unlike=_unlike(measured.at(u), gain * own + mean, noise),
        misfit=float(np.std(measured.at(u) - computed)), noise=measured.noise, measured=measured,
        computed=run,
    )  # fmt: skip


def _unlike(measured: FloatArray, explained: FloatArray, noise: float) -> float:
    """Return the share of a motion that is not explained; 0: it is that of the noise."""
    rest = float(np.nanstd(measured - explained))
    return rest / float(np.std(measured)) if rest > SEVERAL * noise else 0.0


def _correlation(a: FloatArray, b: FloatArray) -> float:
    """Return the correlation coefficient; 0 where one does not move."""
    a, b = a - a.mean(), b - b.mean()
    norm = float(np.sqrt((a @ a) * (b @ b)))
    return float(a @ b) / norm if norm > 0.0 else 0.0
