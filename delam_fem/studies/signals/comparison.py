"""Compare a measurement with a run once both are aligned, in numbers and sentences."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.linalg import solve_toeplitz
from scipy.optimize import minimize_scalar
from scipy.signal import czt

from delam_fem.api import FloatArray, beams, harmonics, statistics
from delam_fem.studies.signals.alignment import (
    COARSE,
    Alignment,
    MatchedHistories,
    MotionCourse,
    aligned,
    correlation,
    gains,
)

SAMPLES_PER_UNKNOWN = 4
"""Fewest samples for each fitted number."""
EVEN = 1e-3
"""Share of a step by which times of samples may miss an even spacing and still count as even."""
SAME_PHASE_GAPS = 10.0
"""Multiple of the median distance in phase up to which two samples count as of the same phase."""
UNRESOLVED = 0.8
"""Ratio of what two halves of a record differ by to what the harmonics leave, below which the rest
repeats: the motion then has harmonics beyond those that are fitted."""
SAMPLES_PER_ORDER = 8
"""Samples of a run's period for each of its harmonics."""
NEIGHBOURHOOD = 0.1
"""Relative range about the drive's frequency in which the measured one is looked for."""
CLEAR = 2.0
"""Multiple of the noise's amplitude above which a harmonic is taken for one of the motion."""
FEWEST_PERIODS = 3.0
"""Periods of a record below which its frequency cannot be told from that of the drive."""


@dataclass(frozen=True)
class HarmonicFit:
    """The periodic part of a history.

    Attributes:
        mean: mean of the history.
        coefficients: complex amplitudes c_k of Re c_k exp(2 pi i k f t / p), k = 1, 2, …
        frequency: f / p, the lowest frequency [Hz].
        multiple: p, the periods of the drive after which the motion repeats.
        noise: standard deviation of what does not repeat.
        n_samples: number of samples of the fit.
    """

    mean: float
    coefficients: beams.ComplexArray
    frequency: float
    multiple: int
    noise: float
    n_samples: int

    def at(self, time: FloatArray, derivative: int = 0) -> FloatArray:
        """Return the periodic part, or a derivative of it, at instants, by Horner's scheme."""
        orders = 1j * 2.0 * np.pi * self.frequency * np.arange(1, self.coefficients.size + 1)
        turn = np.exp(2j * np.pi * self.frequency * time)
        value = np.zeros(time.size, dtype=np.complex128)
        for term in (self.coefficients * orders**derivative)[::-1]:
            value = (value + term) * turn
        return np.real(value) + (0.0 if derivative else self.mean)

    def later(self, delay: float) -> HarmonicFit:
        """Return the periodic part that comes later by a time [s]."""
        orders = np.arange(1, self.coefficients.size + 1)
        turn = np.exp(-2j * np.pi * self.frequency * delay * orders)
        return replace(self, coefficients=self.coefficients * turn)

    def power_beside(self, other: HarmonicFit, gain: float) -> float:
        """Return the mean square of what moves less a multiple of what moves in another fit."""
        return 0.5 * float((np.abs(self.coefficients - gain * other.coefficients) ** 2).sum())

    def clear(self) -> HarmonicFit:
        """Return the fit without the harmonics that noise may have made."""
        is_clear = np.abs(self.coefficients) > CLEAR * self.floor
        return replace(self, coefficients=np.where(is_clear, self.coefficients, 0.0))

    @property
    def amplitudes(self) -> FloatArray:
        """Amplitudes A_1, A_2, … of the harmonics of the drive."""
        return np.asarray(np.abs(self.coefficients[self.multiple - 1 :: self.multiple]))

    @property
    def floor(self) -> float:
        """Root mean square amplitude that the noise alone gives a harmonic: 2 sigma / sqrt(n)."""
        return 2.0 * self.noise / float(np.sqrt(self.n_samples))

    def distortion(self) -> tuple[float, float]:
        """Return the distortion factor d without the noise's share, and its standard deviation.

        d = sqrt(1 + THD^2) - 1. Noise adds (2 sigma)^2 / n to each squared amplitude.
        """
        a = self.amplitudes
        extra = self.floor**2
        if not a.size or a[0] <= 0.0:
            return float("nan"), float("nan")
        higher = np.sqrt(max(float((a[1:] ** 2).sum()) - extra * (a.size - 1), 0.0))
        d = (
            np.sqrt(1.0 + float(harmonics.total_harmonic_distortion(np.array([a[0], higher]))) ** 2)
            - 1.0
        )
        spread = np.sqrt(2.0 * extra * higher**2 + extra**2 * (a.size - 1))
        return float(d), float(spread / (2.0 * a[0] ** 2 * (1.0 + d)))


def fitted(time: FloatArray, values: FloatArray, frequency: float, multiple: int) -> HarmonicFit:
    """Return the periodic part of a history by least squares, with all harmonics that it can show.

    Args:
        time: times of the samples [s], shape (n,).
        values: the history, shape (n,).
        frequency: frequency of the drive [Hz].
        multiple: periods of the drive after which the motion repeats.
    """
    lowest = frequency / multiple
    n = time.size
    duration = float(time[-1] - time[0])
    top_frequency = 0.5 * (n - 1) / duration - 1.0 / duration  # where k and -k are still two lines
    n_orders = max(min(int(top_frequency / lowest), (n // SAMPLES_PER_UNKNOWN - 1) // 2), 1)
    terms = _harmonic_terms(time, values - values.mean(), lowest, n_orders)
    mean = float(values.mean() + terms[0].real)
    fit = HarmonicFit(mean, 2.0 * terms[1:], lowest, multiple, 0.0, n)
    residual = values - fit.at(time)
    noise = float(residual.std() * np.sqrt(n / max(n - 1 - 2 * n_orders, 1)))
    halves = _unlike_halves(time * lowest, residual)
    return replace(fit, noise=halves if halves < UNRESOLVED * noise else noise)


def _harmonic_terms(
    time: FloatArray, values: FloatArray, lowest: float, n_orders: int
) -> beams.ComplexArray:
    """Fit sum_k a_k exp(2 pi i k f t), k = -K … K, by least squares.

    The normal equations are G a = b with b_k = sum_j x_j exp(-2 pi i k f t_j) and G_kl = g(l - k),
    g(m) = sum_j exp(2 pi i m f t_j): G is a Toeplitz matrix, which is solved without being built.

    Args:
        time: times of the samples [s], shape (n,).
        values: real samples, shape (n,).
        lowest: f [Hz].
        n_orders: K.

    Returns:
        a_0 … a_K, shape (K + 1,).
    """
    middle = 0.5 * float(time[0] + time[-1])
    b = _sums(values, time - middle, lowest, n_orders)
    g = _sums(np.ones(time.size), time - middle, lowest, 2 * n_orders)
    both = np.concatenate([b[:0:-1].conj(), b])
    turn = np.exp(-2j * np.pi * lowest * middle * np.arange(n_orders + 1))
    return np.asarray(solve_toeplitz(g, both)[n_orders:] * turn)


def _sums(values: FloatArray, time: FloatArray, lowest: float, n_orders: int) -> beams.ComplexArray:
    """Return sum_j x_j exp(-2 pi i k f t_j) for k = 0 … K, shape (K + 1,)."""
    step = float(time[-1] - time[0]) / max(time.size - 1, 1)
    even = time[0] + step * np.arange(time.size)
    if np.abs(time - even).max() <= EVEN * step:
        begin = np.exp(-2j * np.pi * lowest * time[0] * np.arange(n_orders + 1))
        return np.asarray(begin * czt(values, n_orders + 1, np.exp(-2j * np.pi * lowest * step)))
    turn = np.exp(-2j * np.pi * lowest * time)
    row = values.astype(np.complex128)
    sums = np.empty(n_orders + 1, dtype=np.complex128)
    for k in range(n_orders + 1):
        sums[k] = row.sum()
        row *= turn
    return sums


def _unlike_halves(turns: FloatArray, values: FloatArray) -> float:
    """Return the noise by what two halves of a record differ by at the same phase.

    Each sample of the second half is compared with that of the first whose phase is nearest.

    Args:
        turns: time of the samples in periods of the motion, shape (n,).
        values: the samples, shape (n,).

    Returns:
        Standard deviation of what does not repeat, whatever harmonics the motion has; infinite if
        the halves are shorter than a period.
    """
    n = values.size // 2
    if turns[n] - turns[0] < 1.0:
        return np.inf
    order = np.argsort(turns[:n] % 1.0)
    phases = (turns[:n] % 1.0)[order]
    first = values[:n][order]
    around = np.concatenate([[phases[-1] - 1.0], phases, [phases[0] + 1.0]])
    first = np.concatenate([first[-1:], first, first[:1]])
    later = turns[n:] % 1.0
    place = np.clip(np.searchsorted(around, later), 1, around.size - 1)
    place -= later - around[place - 1] < around[place] - later
    distance = np.abs(around[place] - later)
    is_same = distance <= SAME_PHASE_GAPS * np.median(distance)
    return float(np.sqrt(0.5 * np.mean((values[n:] - first[place])[is_same] ** 2)))


def of_course(course: MotionCourse, multiple: int, n_orders: int) -> HarmonicFit:
    """Return the harmonics of a run that repeats, which have no noise.

    Args:
        course: course of one history.
        multiple: periods of the drive in a period of the motion.
        n_orders: number of harmonics.
    """
    assert course.period is not None  # the motion repeats
    n = max(course.n_steps, SAMPLES_PER_ORDER * n_orders)
    values = course.at(course.start + course.period * np.arange(n) / n)[0]
    terms = np.fft.rfft(values)[: n_orders + 1] / n
    lowest = 1.0 / course.period
    turn = np.exp(-2j * np.pi * lowest * course.start * np.arange(1, n_orders + 1))
    return HarmonicFit(float(terms[0].real), 2.0 * terms[1:] * turn, lowest, multiple, 0.0, n)


def strongest_frequency(time: FloatArray, values: FloatArray, lowest: float) -> float | None:
    """Return the frequency at which a measurement moves most.

    Args:
        time: times of the samples [s], shape (n,).
        values: histories in one unit, shape (n_channels, n).
        lowest: frequency below which motions are not looked at [Hz].

    Returns:
        The frequency [Hz]; None: the record is too short to tell it.
    """
    even = np.linspace(time[0], time[-1], time.size)
    rows = np.array([np.interp(even, time, row - row.mean()) for row in values])
    power = (np.abs(np.fft.rfft(np.hanning(time.size) * rows)) ** 2).sum(axis=0)
    frequency = np.fft.rfftfreq(time.size, even[1] - even[0])
    strongest = float(frequency[np.argmax(np.where(frequency < lowest, 0.0, power))])
    return drive_frequency(time, values, strongest, 2.0 * frequency[1])


def drive_frequency(
    time: FloatArray, values: FloatArray, expected: float, reach: float | None = None
) -> float | None:
    """Return the frequency near the drive's at which a measurement has its line.

    Args:
        time: times of the samples [s], shape (n,).
        values: histories, shape (n_channels, n).
        expected: frequency of the drive [Hz].
        reach: how far from it the line may be [Hz]; None: `NEIGHBOURHOOD`.

    Returns:
        The frequency [Hz]; None: the record is too short, or there is no line near the drive's.
    """
    duration = float(time[-1] - time[0])
    if duration * expected < FEWEST_PERIODS:
        return None
    scaled = np.hanning(time.size) * (values - values.mean(axis=1, keepdims=True))
    scaled /= np.maximum(np.abs(scaled).max(axis=1, keepdims=True), np.finfo(float).tiny)

    def power(f: float) -> float:
        return float((np.abs(scaled @ np.exp(-2j * np.pi * f * time)) ** 2).sum())

    reach = reach or min(max(NEIGHBOURHOOD * expected, 2.0 / duration), 0.45 * expected)
    grid = np.arange(expected - reach, expected + reach, 0.25 / duration)
    k = int(np.argmax([power(float(f)) for f in grid]))
    if k in (0, len(grid) - 1):
        return None
    best = minimize_scalar(
        lambda f: -power(f), bounds=(grid[k - 1], grid[k + 1]), method="bounded",
        options={"xatol": 1e-7 * expected},
    )  # fmt: skip
    return float(best.x)


SEVERAL = 3.0
"""Unexplained motion over the noise, from which it no longer counts as noise."""
ALIKE = 0.8
"""Correlation from which motions are alike; below its negative a sign is turned."""


@dataclass(frozen=True)
class ChannelComparison:
    """One channel of a measurement beside that of a run.

    Attributes:
        name: name of the channel.
        units: units of its values.
        is_drive: whether the channel is the drive.
        gain: measured amplitude over that of the run, at the channel's own phase.
        gain_error: its standard deviation.
        delay: time by which the channel comes later than the run after the alignment [s].
        delay_error: standard deviation of the channel's own phase [s].
        correlation: correlation of both after the alignment.
        mean_difference: mean of the measurement minus that of the run.
        residual: root mean square of measured minus computed without the mean difference.
        unlike: share of the motion that the run does not explain at the channel's own gain and
            phase; 0: it is within the noise.
        misfit: as `residual`, of the periodic part of the measurement; None: no periodic motion.
        noise: standard deviation of the part that does not repeat; None likewise.
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
    pairs: MatchedHistories, k: int, course: MotionCourse, alignment: Alignment, turn: float | None
) -> ChannelComparison:
    """Return the comparison of one channel of a measurement with that of a run.

    The channel's own phase is that at which it correlates best within a period of the drive; a
    channel that is mirrored has a negative gain.

    Args:
        pairs: measurement and run.
        k: number of the channel.
        course: course of all channels of the run.
        alignment: alignment of all channels together.
        turn: period of the drive [s]; None: there is none.
    """
    single = course.only([k])
    values = pairs.measured[k : k + 1]
    u = alignment.on_clock_of_run(pairs.time)
    computed = single.at(u)[0]
    known = np.isfinite(computed)
    residual = values[0, known] - computed[known]
    together = correlation(values[:, known], computed[None, known])
    sign = -1.0 if together < -ALIKE else 1.0
    starts = None
    if turn is not None:  # the alignment of all is among them: a force of blows has narrow peaks
        starts = alignment.start + turn * np.r_[0.0, np.linspace(-0.5, 0.5, COARSE)]
    at_own = aligned(
        pairs.time, sign * values, single, alignment.rate, is_rate_free=False, starts=starts
    )
    own_course = single.at(at_own.on_clock_of_run(pairs.time))[0]
    gain, mean, gain_error = gains(values[0], own_course)
    period = course.period
    about: dict[str, Any] = {
        "name": pairs.names[k], "units": pairs.units[k], "is_drive": pairs.is_drive[k],
        "gain": gain, "gain_error": float(np.hypot(gain_error, single.scatter(0))),
        "delay": alignment.start - at_own.start, "delay_error": at_own.start_error,
        "correlation": together,
        "mean_difference": float(residual.mean()),
        "residual": float(np.std(residual)),
    }  # fmt: skip
    if period is None:
        noise = statistics.white_noise(values[0])
        return ChannelComparison(
            **about, unlike=_unlike(values[0], gain * own_course + mean, noise)
        )
    measured = fitted(u, values[0], course.multiple / period, course.multiple)
    # a run that explains all leaves the noise alone, and with fewer fitted numbers
    measured = replace(measured, noise=min(measured.noise, about["residual"]))
    run = of_course(single, course.multiple, measured.coefficients.size)
    at_phase = run.later(alignment.start - at_own.start)
    power_of_noise = 0.5 * measured.coefficients.size * measured.floor**2
    unexplained = measured.power_beside(at_phase, gain)
    motion = measured.power_beside(run, 0.0)
    is_unlike = unexplained > SEVERAL**2 * power_of_noise
    misfit = max(measured.power_beside(run, 1.0) - power_of_noise, 0.0)
    return ChannelComparison(
        **about, unlike=float(np.sqrt(unexplained / motion)) if is_unlike else 0.0,
        misfit=float(np.sqrt(misfit)), noise=measured.noise, measured=measured, computed=run,
    )  # fmt: skip


def _unlike(measured: FloatArray, explained: FloatArray, noise: float) -> float:
    """Return the share of a motion that is not explained; 0 if that may be noise."""
    residual = float(np.nanstd(measured - explained))
    return residual / float(np.std(measured)) if residual > SEVERAL * noise else 0.0


SIGNIFICANT = 3.0
"""Number of standard deviations from which a difference is no chance."""
SAME_GAIN, SAME_PHASE, SAME_RATE = 0.05, 5.0, 1e-4
"""Differences that are not worth a sentence: of amplitude, of phase [degrees], of clocks."""
SAME_SHAPE = 0.1
"""Share of a motion that the run may leave without a sentence."""
FACTORS = {
    1e3: "as if millimetres were read as metres",
    1e-3: "as if metres were read as millimetres",
    1e6: "as if micrometres were read as metres",
    25.4: "as if inches were millimetres",
    1 / 25.4: "as if millimetres were inches",
    10.0: "as if centimetres were millimetres",
    0.1: "as if millimetres were centimetres",
    2.0: "as if peak-to-peak were an amplitude",
    0.5: "as if an amplitude were peak-to-peak",
    -1.0: "is its sign turned?",
}
"""Ratios of amplitudes that common mistakes make, with the mistake in words."""
NEAR_FACTOR = 0.05
NO_NUMBERS = "not compared, as its gain, delay or correlation is no finite number"


@dataclass(frozen=True)
class Deviation:
    """One difference between a measurement and a run.

    Attributes:
        kind: "clock", "amplitude", "phase", "shape" or "numbers".
        channel: name of the channel; empty: all channels.
        text: the difference in a sentence.
    """

    kind: str
    channel: str
    text: str


def findings(
    channels: Sequence[ChannelComparison], alignment: Alignment, frequency: float | None
) -> list[Deviation]:
    """Return the differences between a measurement and a run that are worth a sentence.

    Args:
        channels: comparisons.
        alignment: alignment of all channels together.
        frequency: frequency of the run's drive [Hz]; None: there is none.
    """
    result = list(_of_clock(alignment, frequency))
    reference = next((channel for channel in channels if channel.is_drive), None)
    reference = reference or min(channels, key=lambda own: abs(own.delay))
    for channel in channels:
        numbers = (
            channel.gain,
            channel.gain_error,
            channel.delay,
            channel.delay_error,
            channel.unlike,
        )
        if not all(map(math.isfinite, numbers)):
            result.append(Deviation("numbers", channel.name, f"{channel.name}: {NO_NUMBERS}"))
            continue
        result += _of_shape(channel)
        if channel is not reference and frequency is not None:
            result += _of_phase(channel, reference, frequency)
    return result


def _of_clock(alignment: Alignment, frequency: float | None) -> Iterator[Deviation]:
    """Yield a finding if the clocks differ, or the frequencies of the drives, which looks alike."""
    rate, error = alignment.rate, alignment.rate_error
    if not abs(rate - 1.0) <= max(SAME_RATE, SIGNIFICANT * error):
        driven = "" if frequency is None else (
            f", or the measurement was driven at {rate * frequency:.5g} Hz, the run at "
            f"{frequency:.5g} Hz, which is not the same motion"
        )  # fmt: skip
        yield Deviation(
            "clock", "", f"the run's clock is {rate:.6g} ± {error:.1g} times as fast{driven}"
        )


def _of_shape(own: ChannelComparison) -> Iterator[Deviation]:
    """Yield findings if a channel moves in another way, or by another amplitude, than the run."""
    is_found = abs(own.gain) > SIGNIFICANT * own.gain_error
    if own.unlike > SAME_SHAPE or not is_found:
        yield Deviation(
            "shape", own.name,
            f"{own.name}: the measured motion is not that of the run (correlation "
            f"{own.correlation:.2f}, {100 * own.unlike:.2g} % of it is left)",
        )  # fmt: skip
    if abs(own.gain - 1.0) > max(SAME_GAIN, SIGNIFICANT * own.gain_error):
        factor = next((f for f in FACTORS if abs(own.gain / f - 1.0) < NEAR_FACTOR), None)
        hint = f", {FACTORS[factor]}" if factor is not None else ""
        yield Deviation(
            "amplitude", own.name,
            f"{own.name}: measured {own.gain:.4g} ± {own.gain_error:.2g} times the amplitude of "
            f"the run{hint}",
        )  # fmt: skip


def _of_phase(
    own: ChannelComparison, reference: ChannelComparison, frequency: float
) -> Iterator[Deviation]:
    """Yield a finding if a channel's phase differs from that of the reference channel."""
    turn = 360.0 * frequency
    phase = (turn * (own.delay - reference.delay) + 180.0) % 360.0 - 180.0
    error = turn * math.hypot(own.delay_error, reference.delay_error)
    if abs(phase) > max(SAME_PHASE, SIGNIFICANT * error):
        hint = "" if reference.is_drive else "; no drive was measured, so either may be wrong"
        yield Deviation(
            "phase", own.name,
            f"{own.name}: measured {abs(phase):.1f}° ± {error:.1g}° "
            f"{'later' if phase > 0 else 'earlier'} than {reference.name}{hint}",
        )  # fmt: skip
