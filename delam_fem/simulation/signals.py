"""Read what a recorder has kept in its window: steps, frames, and the signals of sensors.

An acceleration is the mean change of the velocity over the step before an instant and the one
after,

    a = (v₊ - v₋) / 2Δt                                                                        (G1)

and converges with the steps where velocities do. The equation of motion at an instant does not:
modes that are too fast for the step, or that damping makes overdamped, change their sign from step
to step after each impact, and M⁻¹ K weights them with ω². G1 leaves out what alternates, and an
impulse counts with its change of velocity, spread over both steps.

A sensor without a sampling rate has a value at every step. With a rate, the signal passes a
low-pass filter without phase shift before it is sampled, as in front of a converter: the pass band
ends at 0.4 and the stop band begins at 0.5 times the rate (-60 dB), so nothing folds back. The
samples are at whole multiples of 1/rate. At both ends of the window the signal is continued by its
odd reflection, which touches about 18 samples.

What a sensor does of itself comes before that, with its delay, as in the laboratory: the resonance
of its mounting, ω² / (s² + 2 D ω s + ω²), its own Butterworth low-pass filter, and its range. Both
filters are bilinear at the steps, exact at their own frequency. They begin at rest at the first
value of the window; what that leaves dies out with their own decay. Noise is added to the samples,
and a converter rounds them to whole multiples of 2 range / 2^bits last.
"""

from __future__ import annotations

import zlib
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import scipy  # loads its parts when they are used

from delam_fem.case.definition import Case
from delam_fem.case.sections import Sensor
from delam_fem.contact.decisions import LawNumbers
from delam_fem.model.layout import SensorRows, Structure
from delam_fem.model.operators import DistributedOperators, Operators
from delam_fem.numerics.types import BoolArray, FloatArray, IntArray
from delam_fem.simulation.recorder import N_BASE, PeriodRecord, Recorder

PASS, STOP, ATTENUATION = 0.4, 0.5, 60.0
"""End of the pass band and start of the stop band over the sampling rate; attenuation [dB]."""
_AT_REST = 1e-6
"""Size of a signal over its largest value below which it counts as being at rest."""
_ROUND_OFF = 1e-6
"""Share of a sampling interval by which the first or last sample may be outside the window."""


def steps_of(recorder: Recorder) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the recorded motion at the start of the window and after each of its k steps.

    Returns:
        Displacements and velocities of probes and sensors, as in `PeriodRecord` but without the
        entries of the ledger, and (q, q', q'') of the base or force; the first axis has k + 1 rows.
    """
    first, *_ = records = list(recorder.window)
    tables = ((r.u[:, N_BASE:], r.v, r.base_states) for r in records)
    begun = (first.u[:1, N_BASE:], first.v[:1], first.base_states[:1])
    rows = ([t[1 : r.n_steps + 1] for t in table] for r, table in zip(records, tables, strict=True))
    u, v, base = (np.concatenate(table) for table in zip(begun, *rows, strict=True))
    return u, v, base


def displacements_of(recorder: Recorder, n_probes: int) -> FloatArray:
    """Return the first probes after each of the k steps of the window, shape (n_probes, k) [m]."""
    columns = slice(N_BASE, N_BASE + n_probes)
    rows = [record.u[1 : record.n_steps + 1, columns] for record in recorder.window]
    return np.ascontiguousarray(np.concatenate(rows).T)


class Instants(NamedTuple):
    """The frames of a window: all dofs and contact states at k instants.

    Attributes:
        steps: steps of the frames, counted from the start of the window, shape (k,).
        states: k arrays (u, v) of the dofs of this rank, each of shape (2, n_own).
        contact: contact states, shape (k, n_pairs).
        base: (q, q') of the base, 0 where a force drives, shape (k, 2).
    """

    steps: IntArray
    states: list[FloatArray]
    contact: npt.NDArray[np.int8]
    base: FloatArray


def frames_of(recorder: Recorder) -> Instants:
    """Return the frames in the window of a recorder, one after another."""
    steps = [np.zeros(0, np.int64)]
    base = [np.zeros((0, 2))]
    for number, record in enumerate(recorder.window):
        frame_steps = record.frame_steps[: len(record.frames)]
        steps.append(number * recorder.steps_per_period + frame_steps)
        base.append(record.base_states[frame_steps, :2])
    of_base = 0.0 if recorder.is_forced else 1.0
    contact = [state for record in recorder.window for state in record.contact]
    return Instants(
        np.concatenate(steps),
        [state for record in recorder.window for state in record.frames],
        np.array(contact, np.int8),
        of_base * np.concatenate(base),
    )


@dataclass(frozen=True)
class Signal:
    """The signal of a sensor.

    Attributes:
        sensor: the sensor.
        time: time of each sample, shape (k,) [s].
        value: samples, shape (k,), in the unit of the sensor.
        alternating: share of the steps at which the signal alternates, `alternating_share` [-]; of
            an acceleration, before its means are taken.
    """

    sensor: Sensor
    time: FloatArray
    value: FloatArray
    alternating: float = 0.0


def signals(recorder: Recorder, structure: Structure, case: Case) -> tuple[Signal, ...]:
    """Return the signals of all sensors of a case over the window of a run."""
    layout = structure.layout
    n_probes = structure.operators.n_probes
    if not layout.sensors:
        return ()
    forces = None
    if any(rows.of_forces is not None for rows in layout.sensors):
        periods = [contact_forces_of(record, structure, case) for record in recorder.window]
        forces = np.concatenate(periods)
    motion = steps_of(recorder)
    start = (recorder.n_closed - len(recorder.window)) * recorder.steps_per_period
    time = (start + np.arange(1, len(motion[0]))) * recorder.time_step
    by_name = {sensor.name: sensor for sensor in case.sensor}
    return tuple(
        _sampled(
            by_name[rows.name],
            time,
            read(rows, motion, forces, n_probes),
            recorder.time_step,
            is_rate=rows.is_rate,
        )
        for rows in layout.sensors
    )


def read(
    rows: SensorRows,
    motion: tuple[FloatArray, FloatArray, FloatArray],
    forces: FloatArray | None,
    n_probes: int,
) -> FloatArray:
    """Return what a sensor reads at the start of a window and after each of its k steps.

    Args:
        rows: the sensor.
        motion: what `steps_of` returns.
        forces: contact forces of all pairs after each step, shape (k, n_pairs) [N]; None: no
            sensor reads them.
        n_probes: number of probes, which stand before the functionals of sensors.

    Returns:
        Shape (k + 1,); contact forces are 0 at the start.
    """
    u, v, base = motion
    values = base[:, :2] @ np.array(rows.of_base)
    if rows.of_u is not None:
        values += u[:, n_probes + rows.of_u]
    if rows.of_v is not None:
        values += v[:, n_probes + rows.of_v]
    if forces is not None and rows.of_forces is not None:
        values[1:] += forces @ rows.of_forces
    return np.asarray(values)


def contact_forces_of(record: PeriodRecord, structure: Structure, case: Case) -> FloatArray:
    """Return springs' forces and impulses over Δt at each step [N], shape (steps, n_pairs).

    All gaps are recorded, as they are where a sensor reads forces.

    A signal has one value per step: an impulse counts with its mean force over that step.
    """
    forces = spring_forces(record, structure, case)
    jumps = record.jumps.columns()
    steps = jumps.steps(record.ticks_per_step)
    inside = (steps >= 0) & (steps < record.n_steps)
    time_step = case.time_step
    np.add.at(forces, (steps[inside], jumps.hit[inside]), jumps.impulses[inside] / time_step)
    return forces


def recorded_gaps(recorder: Recorder, structure: Structure) -> tuple[FloatArray, FloatArray]:
    """Return recorded gaps [m] and gap rates [m/s] of the window, at its start and after each step.

    Returns:
        Both of shape (k + 1, n_recorded): pairs from `Layout.first_gap` on; without columns where
        none are recorded.
    """
    o, layout = structure.operators, structure.layout
    u, v, _ = steps_of(recorder)
    if layout.gap_row is None:
        return np.zeros((len(u), 0)), np.zeros((len(u), 0))
    row = o.n_probes + layout.gap_row
    columns = slice(row, row + o.n_pairs - layout.first_gap)
    return o.gap0[layout.first_gap :] + u[:, columns], v[:, columns]


def spring_forces(record: PeriodRecord, structure: Structure, case: Case) -> FloatArray:
    """Return the contact-spring forces [N] at each step, positive in compression, (steps, pairs).

    The pairs are those whose gaps are recorded, from `Layout.first_gap` on. The forces follow from
    these gaps: with the law "penalty", and if its contact is elastic, a closed pair carries its
    spring and damper; otherwise with "newton-penalty" a pair that rests (`resting_pairs`) its
    spring.
    """
    o = structure.operators
    layout = structure.layout
    first = layout.first_gap
    if layout.gap_row is None:
        return np.zeros((record.n_steps, 0))
    numbers = law_numbers(case, o)
    if not numbers.has_springs(o.n_pairs)[first:].any():
        return np.zeros((record.n_steps, o.n_pairs - first))
    row = o.n_probes + layout.gap_row
    steps = slice(1, record.n_steps + 1)
    last = row + o.n_pairs - first
    gap = o.gap0[first:] + record.u[steps, N_BASE + row : N_BASE + last]
    carries = gap <= 0.0
    closes = numbers.closes_springs(o.n_pairs)[first:]
    if not closes.all():
        resting = resting_pairs(record, gap, numbers.thresholds(o.n_pairs), first)
        carries = np.where(closes, carries, resting)
    weights = None if o.pair_weights is None else o.pair_weights[first:]
    spring = numbers.stiffness, numbers.dampings(o.n_pairs)[first:]
    return contact_forces(spring, gap, record.v[steps, row:last], carries, weights)


def law_numbers(case: Case, operators: Operators | DistributedOperators) -> LawNumbers:
    """Return the numbers of the law of a case, with those that the pairs have of their own."""
    return case.contact_law.numbers(case.time.integration, operators.pair_numbers)


def contact_forces(
    spring: tuple[float, float | FloatArray],
    gap: FloatArray,
    rate: FloatArray,
    carries: BoolArray,
    weights: FloatArray | None,
) -> FloatArray:
    """Return -w (k U + c U̇) of pairs that carry a spring, 0 of others; the shape is that of gaps.

    Args:
        spring: stiffness k [N/m] and damping c [N s/m] of a spring of weight 1; the latter of each
            pair, or of all.
        gap: gaps U [m].
        rate: gap rates U̇ [m/s].
        carries: whether a pair carries a spring.
        weights: w of each pair; None: 1.

    Returns:
        Forces, positive in compression [N].
    """
    stiffness, damping = spring
    force = stiffness * gap
    if np.any(damping):
        force = force + damping * rate
    return np.where(carries, -(1.0 if weights is None else weights) * force, 0.0)


def resting_pairs(
    record: PeriodRecord, gap: FloatArray, threshold: float | FloatArray, first: int = 0
) -> BoolArray:
    """Return which pairs rest on springs after each step of a period, shape (steps, pairs).

    A pair begins to rest where an impact leaves it slower than the threshold; it ceases where the
    gap opens, or where a later impact leaves it faster.

    Args:
        record: the record of the period.
        gap: gaps at the end of each step, shape (steps, pairs) [m].
        threshold: the threshold velocity, or that of each of all pairs, shape (n_pairs,) [m/s].
        first: number of the pair of the first column.
    """
    n_steps, n_pairs = gap.shape
    change = np.zeros((n_steps + 1, n_pairs), dtype=np.int8)
    change[0] = np.where(record.resting[first:], 1, -1)
    jumps = record.jumps.columns()
    is_known = jumps.hit >= first
    steps = jumps.steps(record.ticks_per_step)[is_known] + 1
    limits = np.broadcast_to(threshold, record.resting.shape)
    slow = jumps.rate_post[is_known] < limits[jumps.hit[is_known]]
    change[steps, jumps.hit[is_known] - first] = np.where(slow, 1, -1)
    change[1:][gap > 0.0] = -1
    # each step has the state of the latest step with a change: 1 rests, -1 does not
    last = np.where(change != 0, np.arange(n_steps + 1)[:, None], 0)
    np.maximum.accumulate(last, axis=0, out=last)
    return np.asarray(np.take_along_axis(change, last, axis=0)[1:] > 0)


def _sampled(
    sensor: Sensor, time: FloatArray, values: FloatArray, time_step: float, *, is_rate: bool = False
) -> Signal:
    """Return the samples of a signal.

    Args:
        sensor: the sensor.
        time: time of each of k steps, shape (k,) [s].
        values: what the sensor reads at the start and after each step, shape (k + 1,).
        time_step: Δt [s].
        is_rate: whether the signal is the change of these values with time.
    """
    of_steps = np.diff(values) / time_step if is_rate else values[1:]
    value = as_mounted(sensor, centred(of_steps) if is_rate else of_steps, time_step)
    if sensor.sampling_rate is not None:
        rate = sensor.sampling_rate * time_step
        value = low_passed(value, rate)
        of_steps = low_passed(of_steps, rate)
        first = np.ceil(time[0] * sensor.sampling_rate - _ROUND_OFF)
        last = np.floor(time[-1] * sensor.sampling_rate + _ROUND_OFF)
        at = np.clip(np.arange(first, last + 1.0) / sensor.sampling_rate, time[0], time[-1])
        value = scipy.interpolate.make_interp_spline(time, value, k=min(3, time.size - 1))(at)
        time = at
    if sensor.noise:
        rng = np.random.default_rng([sensor.seed, zlib.crc32(sensor.name.encode())])
        value = value + rng.normal(scale=sensor.noise, size=value.size)
    if sensor.range is not None and sensor.bits is not None:
        least = 2.0 * sensor.range / 2**sensor.bits
        value = np.clip(least * np.round(value / least), -sensor.range, sensor.range - least)
    value = np.asarray(value, dtype=np.float64)
    return Signal(sensor, time, value, alternating_share(of_steps))


def as_mounted(sensor: Sensor, value: FloatArray, time_step: float) -> FloatArray:
    """Return a signal after the resonance of the mounting, the sensor's filter and its range.

    Args:
        sensor: the sensor.
        value: signal at every step, shape (k,).
        time_step: Δt [s].
    """
    sections = []
    if sensor.resonance is not None or sensor.corner is not None:
        from scipy.signal import bilinear, butter, sosfilt, sosfilt_zi

        rate = 1.0 / time_step
        if sensor.resonance is not None:
            w = 2.0 * rate * np.tan(np.pi * sensor.resonance * time_step)
            D = 0.02 if sensor.resonance_damping is None else sensor.resonance_damping
            sections.append(np.concatenate(bilinear([w**2], [1.0, 2.0 * D * w, w**2], rate)))
        if sensor.corner is not None:
            sections += [*butter(sensor.order or 2, sensor.corner, fs=rate, output="sos")]
        filters = np.array(sections)
        value = sosfilt(filters, value, zi=sosfilt_zi(filters) * value[0])[0]
    return value if sensor.range is None else np.clip(value, -sensor.range, sensor.range)


def centred(change: FloatArray) -> FloatArray:
    """Return the mean of the changes in the steps before and after each instant, shape (k,).

    The last instant of a window has no step after it, and repeats the value before.

    Args:
        change: mean rate of change in each step, shape (k,).
    """
    if change.size < 2:
        return change
    means = 0.5 * (change[:-1] + change[1:])
    return np.append(means, means[-1])


def alternating_share(value: FloatArray) -> float:
    """Return the share of steps at which a signal does little else than alternate [-].

    At such a step, and at both beside it, the alternating part |x₋ - 2 x + x₊| / 4 is more than
    half of the signal there, the root mean square of the three. A sine with more than four steps a
    cycle has no such step, and a peak of a single step is none.

    Args:
        value: signal at every step, shape (k,).
    """
    if value.size < 5:
        return 0.0
    before, here, after = value[:-2], value[1:-1], value[2:]
    part = 0.25 * np.abs(before - 2.0 * here + after)
    size = np.sqrt((before**2 + here**2 + after**2) / 3.0)
    is_large = size > _AT_REST * np.abs(value).max()
    alternates = is_large & (part > 0.5 * size)
    return float(np.mean(alternates[:-2] & alternates[1:-1] & alternates[2:]))


def low_passed(value: FloatArray, rate: float) -> FloatArray:
    """Return a signal without the frequencies that sampling would fold back, shape (k,).

    Args:
        value: signal at every step, shape (k,).
        rate: samples per step, below 1; at 1 and above nothing is removed.
    """
    if rate >= 1.0 or value.size < 2:
        return value
    # imported here: every run and every worker of a sweep imports this module
    from scipy.signal import firwin, kaiserord, oaconvolve

    n_taps, beta = kaiserord(ATTENUATION, 2.0 * (STOP - PASS) * rate)
    n_taps |= 1  # an odd number has no delay of half a step
    taps = firwin(n_taps, (PASS + STOP) * rate, window=("kaiser", beta))
    padded = np.pad(value, n_taps // 2, mode="reflect", reflect_type="odd")
    return np.asarray(oaconvolve(padded, taps, mode="valid"))
