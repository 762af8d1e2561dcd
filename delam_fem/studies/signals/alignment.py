"""Align a measurement with the clock of a run: where it begins, and how fast its own clock runs.

A sample at the time t of the measurement belongs to the time

    u = tau + s (t - t_first)

of the run. The first, coarse tau is where the normalised histories correlate best; tau and s are
then found by Gauss and Newton's method for measured = gain * computed(u) + mean, with gain and mean
free for each channel. A wrong unit or sensor offset therefore does not disturb the alignment.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import xarray as xr
from scipy.interpolate import CubicSpline, make_interp_spline

from delam_fem.api import CaseError, FloatArray

LEAST_OVERLAP = 0.3
"""Share of the shorter record that must overlap where the motion does not repeat."""


POINTS_PER_ORDER = 16
"""Points of a filtered course for each of its harmonics."""


@dataclass(frozen=True)
class MotionCourse:
    """Histories of a run between and beyond its steps.

    Attributes:
        spline: all histories over the time since `start`; of a motion that repeats, the mean of its
            cycles.
        start: time of the first step that is used [s].
        end: time of the last step [s].
        period: time after which the motion repeats [s]; None: it does not, and nothing is known
            beyond the window.
        multiple: periods of the drive in `period`.
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
    ) -> MotionCourse:
        """Return the course through the steps of a run.

        Args:
            time: times of the steps [s], equidistant, shape (m,).
            values: histories, shape (n_channels, m).
            period: time after which the motion repeats [s]; the last whole cycles are averaged.
            multiple: periods of the drive in `period`.
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

    @property
    def n_steps(self) -> int:
        """Number of points through which the course goes."""
        return int(self.spline.x.size) - 1

    def below(self, highest: float) -> MotionCourse:
        """Return the course of a motion that repeats without what is above a frequency.

        It is the same if the steps of the run cannot show more either.

        Args:
            highest: the frequency [Hz].
        """
        if self.period is None or self.cycles is None:
            return self
        n = self.cycles.shape[2]
        top_order = int(highest * self.period)
        if 2 * top_order >= n:
            return self
        # of the steps, so that the last is left out: it is the first of the next period
        terms = np.fft.rfft(self.spline(self.period * np.arange(n) / n), axis=1)[:, : top_order + 1]
        fine = max(n, POINTS_PER_ORDER * top_order)
        form = np.fft.irfft(terms, fine, axis=1) * (fine / n)
        closed = np.concatenate([form, form[:, :1]], axis=1)
        at = np.linspace(0.0, self.period, fine + 1)
        spline = CubicSpline(at, closed, axis=1, bc_type="periodic")
        of_cycles = np.fft.rfft(self.cycles, axis=2)[:, :, : top_order + 1]
        return replace(self, spline=spline, cycles=np.fft.irfft(of_cycles, n, axis=2))

    def starts(self, since: FloatArray, number: int) -> FloatArray:
        """Return instants at which a record may begin on the clock of the run [s].

        Args:
            since: instants of the record after its beginning, on the clock of the run [s].
            number: number of instants for each period of the drive; of a motion that does not
                repeat 32 times as many for window and record together.
        """
        if self.period is not None:
            n = number * self.multiple
            return self.start + self.period * np.arange(n) / n
        length = self.end - self.start
        span = float(since[-1])
        room = (1.0 - LEAST_OVERLAP) * min(length, span)
        step = max(float(np.median(np.diff(since))), (length + span) / (number * 32))
        starts = np.arange(self.start - room, self.end - span + room, step)
        return starts if starts.size else np.arange(self.start, self.end, step)

    def only(self, rows: Sequence[int]) -> MotionCourse:
        """Return the course of some of the histories."""
        return replace(self, rows=tuple(rows))

    def at(self, time: FloatArray, derivative: int = 0) -> FloatArray:
        """Return the histories, or derivatives of them, at instants.

        Args:
            time: instants on the run's clock [s], shape (n,).
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

    def scatter(self, derivative: int) -> float:
        """Return the standard deviation of the gains, or phases, of single cycles of the run.

        More cycles do not reduce it: what is left of a transient shifts all of them one way.

        Args:
            derivative: 0: of the gains [-]; 1: of the phases [s].
        """
        if self.cycles is None or self.period is None or self.cycles.shape[1] < 2:
            return 0.0
        rows = list(range(len(self.cycles)) if self.rows is None else self.rows)
        n = self.cycles.shape[2]
        form = self.at(self.start + self.period * np.arange(1, n + 1) / n, derivative)
        form = form - form.mean(axis=1, keepdims=True)
        weights = 1.0 / np.maximum((form**2).mean(axis=1), np.finfo(float).tiny)
        power = float(np.einsum("c,cn,cn->", weights, form, form))
        deviations = np.einsum("c,cjn,cn->j", weights, self.cycles[rows], form) / (power or 1.0)
        return float(np.std(deviations, ddof=1))


DRIVES = ("base", "drive")
"""Channels of the drive, which lead the alignment."""
ORDERS = {"displacement": 0, "velocity": 1, "acceleration": 2}
"""Derivatives by time that make the quantities of motions of a displacement."""
SAME_PLACE = 2e-3
"""Distance of channels at the same place, over the largest x of a run."""
SMOOTH = 5
"""Degree of the spline whose derivatives and integrals are other quantities of a channel."""


@dataclass(frozen=True)
class MatchedHistories:
    """Histories that a measurement and a run both have.

    Attributes:
        names: names of the channels in the measurement.
        units: units of the channels.
        time: times of the samples, on the measurement's clock [s], shape (n,).
        measured: histories of the measurement, shape (n_channels, n).
        run_time: times of the steps in the run's window [s], shape (m,).
        computed: histories of the run, shape (n_channels, m).
        is_drive: whether a channel is the drive.
        unmatched: channels of the measurement that the run does not have.
        notes: which channels of the run were differentiated or integrated, in sentences.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    time: FloatArray
    measured: FloatArray
    run_time: FloatArray
    computed: FloatArray
    is_drive: tuple[bool, ...]
    unmatched: tuple[str, ...]
    notes: tuple[str, ...] = ()


def matched(run: xr.Dataset, measured: xr.Dataset, *, repeats: bool) -> MatchedHistories:
    """Return the channels that a measurement and a run have at the same places.

    Of a motion, the run may have another quantity at the place: its nearest one is differentiated,
    or integrated if the motion repeats, so that its mean and drift are no part of it.

    Args:
        run: record of the run.
        measured: record of the measurement; see `reading.record`.
        repeats: whether the window of the run has whole periods.

    Raises:
        CaseError: the run has none of the channels.
    """
    matches: list[tuple[str, str, FloatArray, FloatArray, bool]] = []
    unmatched = []
    notes = []
    for name, channel in measured.data_vars.items():
        called = channel.attrs["name"]
        source, order = _source(run, str(name), channel, repeats=repeats)
        values = None if source is None else _values(run, source, order)
        if source is None or values is None:
            unmatched.append(called)
            continue
        if order:
            verb = "differentiated" if order > 0 else "integrated"
            times = {1: "once", 2: "twice"}[abs(order)]
            notes.append(f"{called}: {source} of the run, {verb} {times}")
        about = (called, channel.attrs["units"])
        matches.append((*about, channel.to_numpy(), values, source in DRIVES))
    if not matches:
        raise CaseError(
            f"measurement: none of its channels ({', '.join(unmatched) or 'none'}) is in the run, "
            f"which has {', '.join(map(str, run.data_vars))}; name them by --channel "
            "'tip LAMINA=SOURCE:UNIT' or --channel 'NAME=SOURCE:UNIT@POSITION/LAMINA'"
        )
    names, all_units, samples, computed, is_drive = zip(*matches, strict=True)
    return MatchedHistories(
        names, all_units, measured["time"].to_numpy(), np.array(samples), run["time"].to_numpy(),
        np.array(computed), is_drive, tuple(unmatched), tuple(notes),
    )  # fmt: skip


def _source(
    run: xr.Dataset, name: str, channel: xr.DataArray, *, repeats: bool
) -> tuple[str | None, int]:
    """Return which channel of a run has the place of a measured one, and its derivative by time.

    Args:
        run: record of the run.
        name: name of the measured channel.
        channel: the measured channel.
        repeats: whether a channel of the run may be integrated.
    """
    about = channel.attrs
    wanted = about["quantity"].removeprefix("base ")
    is_motion = wanted in ORDERS
    if name in run and not (is_motion and _quantity(run[name]) in ORDERS):
        return name, 0
    reach = SAME_PLACE * max((abs(v.attrs.get("x", 0.0)) for v in run.values()), default=0.0)
    orders: dict[str, int] = {}
    for candidate, other in ((str(key), channel.attrs) for key, channel in run.items()):
        is_there = _stem(candidate) == _stem(name) or (
            "x" in about
            and abs(about["x"] - other.get("x", math.inf)) <= reach
            and about.get("lamina") in (None, other.get("lamina"))
        )
        quantity = _quantity(run[candidate])
        if is_there and wanted == quantity:
            orders[candidate] = 0
        elif is_there and is_motion and quantity in ORDERS:
            orders[candidate] = ORDERS[wanted] - ORDERS[quantity]
    usable = [key for key, order in orders.items() if order >= 0 or repeats]
    if not usable:
        return None, 0
    # a derivative rather than an integral, and as few of them as there can be
    source = min(usable, key=lambda key: (orders[key] < 0, abs(orders[key])))
    return source, orders[source]


def _quantity(channel: xr.DataArray) -> str:
    """Return the quantity of a channel of a run, on the base or not."""
    return str(channel.attrs.get("quantity", "")).removeprefix("base ")


def _stem(name: str) -> str:
    """Return the name of a channel at a tip or on the base without its quantity."""
    is_named = name.startswith(("tip_", "base"))
    word, _, quantity = name.rpartition("_")
    return word if is_named and quantity in ORDERS else name


def _values(run: xr.Dataset, name: str, order: int) -> FloatArray | None:
    """Return a channel of a run at its steps, differentiated or integrated; None: it rests.

    Args:
        run: record of the run.
        name: name of the channel.
        order: derivative by time; negative: integral, each without its mean.
    """
    time = run["time"].to_numpy()
    channel = run[name]
    axis = channel[channel.dims[0]].to_numpy()
    values: FloatArray = channel.to_numpy()
    if not np.isfinite(values).all() or values.size <= SMOOTH or (order and not values.any()):
        return None
    if axis.size != time.size:  # a sensor with a sampling rate
        values = CubicSpline(axis, values)(time)
    if order > 0:
        return np.asarray(make_interp_spline(time, values, k=SMOOTH)(time, order))
    for _ in range(-order):
        values = make_interp_spline(time, values - values.mean(), k=SMOOTH).antiderivative()(time)
    return values - values.mean() if order else values


COARSE = 128
"""Instants within a period of the drive that are tried first."""
MOST_SAMPLES = 4000
"""Samples that are used for the coarse search."""
BLOCKS = 8
"""Parts of a record whose own offsets show the scatter of the offset."""
ITERATIONS = 30
CONVERGED = 1e-10
"""Change of the offset that ends the iteration, relative to the record or the period."""


@dataclass(frozen=True)
class Alignment:
    """Where a measurement lies on the clock of a run.

    Attributes:
        start: tau, time of the run at the first sample [s].
        first: time of the first sample on the clock of the measurement [s].
        rate: s, seconds of the run in a second of the measurement; for a periodic motion the
            measured frequency over that of the run.
        start_error: standard deviation of tau [s].
        rate_error: standard deviation of s; 0: s was not estimated.
    """

    start: float
    first: float
    rate: float
    start_error: float = 0.0
    rate_error: float = 0.0

    def on_clock_of_run(self, time: FloatArray) -> FloatArray:
        """Return instants of the measurement on the clock of the run [s]."""
        return self.start + self.rate * (time - self.first)


def aligned(
    time: FloatArray,
    measured: FloatArray,
    course: MotionCourse,
    rate: float,
    *,
    is_rate_free: bool,
    starts: FloatArray | None = None,
) -> Alignment:
    """Return the alignment of histories with the course of a run.

    Args:
        time: times of the samples [s], shape (n,).
        measured: histories, shape (n_channels, n).
        course: course of the same channels.
        rate: s to begin with.
        is_rate_free: whether s is estimated too.
        starts: values of tau that are tried first; None: all that the course allows.
    """
    trial = Alignment(0.0, float(time[0]), rate)
    if starts is None:
        starts = course.starts(rate * (time - time[0]), COARSE)
    trial = replace(trial, start=best_start(time, measured, course, trial, starts))
    scale = course.period or float(time[-1] - time[0])
    for _ in range(ITERATIONS):
        residual, slopes = _linearised(time, measured, course, trial)
        change, _ = _step(residual, slopes, is_rate_free)
        trial = replace(
            trial, start=trial.start + float(change[0]), rate=trial.rate + float(change[1])
        )
        if abs(change[0]) < CONVERGED * scale:
            break
    residual, slopes = _linearised(time, measured, course, trial)
    _, errors = _step(residual, slopes, is_rate_free)
    scatter = max(float(errors[0]), _scatter_of_blocks(residual, slopes))
    of_cycles = course.scatter(1)
    # what enlarges the error of tau beyond white noise enlarges that of s as well
    rate_error = float(errors[1]) * scatter / (float(errors[0]) or 1.0)
    if is_rate_free and course.period is not None:  # of a line through phases that drift
        duration = trial.rate * float(time[-1] - time[0])
        rate_error = float(np.hypot(rate_error, np.sqrt(12.0) * of_cycles / duration))
        of_cycles *= 2.0
    return replace(trial, start_error=float(np.hypot(scatter, of_cycles)), rate_error=rate_error)


def with_common_rate(
    time: FloatArray,
    measured: FloatArray,
    course: MotionCourse,
    alignment: Alignment,
    leaders: Sequence[int],
) -> Alignment:
    """Return the alignment of leading channels with a clock rate that all channels have told.

    One clock has sampled all channels. Channels with many harmonics tell its rate far better than a
    drive with one.

    Args:
        time: times of the samples [s], shape (n,).
        measured: histories of all channels, shape (n_channels, n).
        course: course of all channels, of a motion that repeats.
        alignment: alignment of the leading channels alone.
        leaders: their numbers.
    """
    assert course.period is not None  # the motion repeats
    rates = [alignment.rate]
    errors = [alignment.rate_error]
    for k in sorted(set(range(len(measured))) - set(leaders)):
        history = measured[k : k + 1]
        single = course.only([k])
        starts = alignment.start + course.period * np.linspace(-0.5, 0.5, COARSE * course.multiple)
        start = best_start(time, history, single, alignment, starts, power=2)
        by_channel = aligned(
            time, history, single, alignment.rate, is_rate_free=True, starts=np.array([start])
        )
        rates.append(by_channel.rate)
        errors.append(by_channel.rate_error)
    weights = 1.0 / np.maximum(np.square(errors), np.finfo(float).tiny)
    rate = float(np.average(rates, weights=weights))
    error = float(1.0 / np.sqrt(weights.sum()))
    half = 0.5 * float(time[-1] - time[0])
    start = alignment.start + (alignment.rate - rate) * half  # the middle stays
    rows = list(leaders)
    by_leaders = aligned(
        time, measured[rows], course.only(rows), rate, is_rate_free=False, starts=np.array([start])
    )
    start_error = float(np.hypot(by_leaders.start_error, error * half))
    return replace(by_leaders, rate_error=error, start_error=start_error)


def best_start(
    time: FloatArray, measured: FloatArray, course: MotionCourse, trial: Alignment,
    starts: FloatArray, power: int = 1,
) -> float:  # fmt: skip
    """Return that of several tau at which the sum of the channels' correlations is largest.

    Args:
        time: times of the samples [s], shape (n,).
        measured: histories, shape (n_channels, n).
        course: course of the same channels.
        trial: an alignment with the rate of the clock.
        starts: values of tau [s].
        power: 2: the squares are summed, so that a channel with its sign turned counts as well.
    """
    stride = -(-time.size // MOST_SAMPLES)
    t = trial.rate * (time[::stride] - trial.first)
    samples = measured[:, ::stride]
    scores = [correlation(samples, course.at(start + t), power) for start in starts]
    return float(starts[int(np.nanargmax(scores))])


def correlation(measured: FloatArray, computed: FloatArray, power: int = 1) -> float:
    """Return the sum of the channels' correlations to a power, where both histories are known."""
    known = np.isfinite(computed).all(axis=0)
    if known.sum() < LEAST_OVERLAP * known.size / 2:
        return -np.inf
    a = measured[:, known]
    b = computed[:, known]
    a = a - a.mean(axis=1, keepdims=True)
    b = b - b.mean(axis=1, keepdims=True)
    norms = np.sqrt((a**2).sum(axis=1) * (b**2).sum(axis=1))
    correlations = np.divide(
        (a * b).sum(axis=1), norms, out=np.zeros_like(norms), where=norms > 0.0
    )
    return float((correlations**power).sum())


def gains(measured: FloatArray, computed: FloatArray) -> tuple[float, float, float]:
    """Return gain and mean of measured = gain * computed + mean, and the gain's deviation."""
    known = np.isfinite(computed)
    a = measured[known]
    b = computed[known]
    centred = b - b.mean()
    power = float(centred @ centred) or float(np.finfo(float).tiny)
    gain = float((centred @ a) / power)
    mean = float(a.mean() - gain * b.mean())
    residual = a - gain * b - mean
    spread = float(residual @ residual) / max(a.size - 2, 1)
    return gain, mean, float(np.sqrt(spread / power))


def _linearised(
    time: FloatArray, measured: FloatArray, course: MotionCourse, trial: Alignment
) -> tuple[FloatArray, FloatArray]:
    """Return residuals over their deviation, and their derivatives by tau and s.

    The derivatives are without the parts that a change of gain and mean makes up for.

    Returns:
        Residuals, shape (n_channels * n,); derivatives, shape (n_channels * n, 2); zeros where
        nothing is known.
    """
    u = trial.on_clock_of_run(time)
    value = course.at(u)
    slope = course.at(u, 1)
    residuals = []
    slopes = []
    for channel, r, dr in zip(measured, value, slope, strict=True):
        known = np.isfinite(r)
        gain, mean, _ = gains(channel, r)
        residual = np.where(known, channel - gain * np.nan_to_num(r) - mean, 0.0)
        sigma = float(np.sqrt((residual**2).sum() / max(known.sum() - 4, 1))) or 1.0
        # a change of the mean, and of the gain: orthogonal, so each is projected out alone
        base = np.array([known * 1.0, np.where(known, r - np.nanmean(r), 0.0)])
        by = gain * np.nan_to_num(dr) * np.array([np.ones_like(time), time - trial.first])
        weights = (by @ base.T) / np.maximum((base**2).sum(axis=1), np.finfo(float).tiny)
        residuals.append(residual / sigma)
        slopes.append((by - weights @ base).T / sigma)
    return np.concatenate(residuals), np.concatenate(slopes)


def _step(
    residual: FloatArray, slopes: FloatArray, is_rate_free: bool
) -> tuple[FloatArray, FloatArray]:
    """Return the change of (tau, s) that reduces the residual most, and their deviations."""
    used = slopes if is_rate_free else slopes[:, :1]
    scale = np.sqrt((used**2).sum(axis=0)) + np.finfo(float).tiny
    inverse = np.linalg.pinv((used / scale).T @ (used / scale))
    change = inverse @ ((used / scale).T @ residual) / scale
    errors = np.sqrt(np.diag(inverse)) / scale
    return (change, errors) if is_rate_free else (np.r_[change, 0.0], np.r_[errors, 0.0])


def _scatter_of_blocks(residual: FloatArray, slopes: FloatArray) -> float:
    """Return the deviation of tau by the scatter of the offsets of parts of the record [s].

    It also holds where the residual is not white, because the run differs from the measurement.
    """
    parts = np.array_split(np.arange(residual.size), BLOCKS)
    offsets = [
        float(slopes[k, 0] @ residual[k]) / power
        for k in parts
        if (power := float(slopes[k, 0] @ slopes[k, 0])) > 0.0
    ]
    return float(np.std(offsets, ddof=1) / np.sqrt(len(offsets))) if len(offsets) > 1 else 0.0
