"""Read what a recorder has kept in its window: steps, frames, and the signals of sensors.

A sensor without a sampling rate has a value at every step. With a rate, the signal passes a
low-pass filter without phase shift before it is sampled, as in front of a converter: the pass band
ends at 0.4 and the stop band begins at 0.5 times the rate (-60 dB), so nothing folds back. The
samples are at whole multiples of 1/rate. At both ends of the window the signal is continued by its
odd reflection, which touches about 18 samples. Noise is added to the samples last.
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
from delam_fem.contact.laws import LAWS, combination
from delam_fem.model.layout import SensorRows, Structure
from delam_fem.numerics.types import BoolArray, FloatArray, IntArray
from delam_fem.simulation.recorder import N_BASE, PeriodRecord, Recorder

PASS, STOP, ATTENUATION = 0.4, 0.5, 60.0
"""End of the pass band and start of the stop band over the sampling rate; attenuation [dB]."""
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
    rows = ([t[1 : r.n_steps + 1] for t in own] for r, own in zip(records, tables, strict=True))
    u, v, base = (np.concatenate(table) for table in zip(begun, *rows, strict=True))
    return u, v, base


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
    steps, base = [np.zeros(0, np.int64)], [np.zeros((0, 2))]
    for number, record in enumerate(recorder.window):
        own = record.frame_steps[: len(record.frames)]
        steps.append(number * recorder.steps_per_period + own)
        base.append(record.base_states[own, :2])
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
    """

    sensor: Sensor
    time: FloatArray
    value: FloatArray


def signals(recorder: Recorder, structure: Structure, case: Case) -> tuple[Signal, ...]:
    """Return the signals of all sensors of a case over the window of a run."""
    layout = structure.layout
    if not layout.sensors:
        return ()
    forces = [
        None if layout.gap_row is None else spring_forces(record, structure, case)
        for record in recorder.window
    ]
    start = (recorder.n_closed - len(recorder.window)) * recorder.steps_per_period
    n_steps = sum(record.n_steps for record in recorder.window)
    time = (start + 1 + np.arange(n_steps)) * recorder.time_step
    by_name = {own.name: own for own in case.sensor}
    found = []
    for rows in layout.sensors:
        own = by_name[rows.name]
        pieces = [
            _of_period(record, recorder.time_step, structure, rows, case, forces=own_forces)
            for record, own_forces in zip(recorder.window, forces, strict=True)
        ]
        found.append(_sampled(own, time, np.concatenate(pieces), recorder.time_step))
    return tuple(found)


def spring_forces(record: PeriodRecord, structure: Structure, case: Case) -> FloatArray:
    """Return the contact-spring forces [N] at each step, positive in compression, (steps, pairs).

    The forces follow from the recorded gaps: with the law "penalty" a closed pair carries its
    spring and damper, with "newton-penalty" a pair that rests (`resting_pairs`) its spring.
    """
    o, own, reads = structure.operators, structure.layout.gap_row, LAWS[case.contact.law].spring
    assert own is not None  # forces are asked for only where gaps are recorded
    if not reads:
        return np.zeros((record.n_steps, o.n_pairs))
    first, rows = o.n_probes + own, slice(1, record.n_steps + 1)
    gap = o.gap0 + record.u[rows, N_BASE + first : N_BASE + first + o.n_pairs]
    carries = gap <= 0.0
    if "penalty_damping" not in reads:
        carries = resting_pairs(record, gap, case.contact.threshold_velocity)
    rate = record.v[rows, first : first + o.n_pairs]
    return contact_forces(case, gap, rate, carries, o.pair_weights)


def contact_forces(
    case: Case, gap: FloatArray, rate: FloatArray, carries: BoolArray, weights: FloatArray | None
) -> FloatArray:
    """Return -w (k U + c U̇) of pairs that carry a spring, 0 of others; the shape is that of gaps.

    Laws without springs act by impulses alone; their forces are 0.

    Args:
        case: law, stiffness and damping.
        gap: gaps U [m].
        rate: gap rates U̇ [m/s].
        carries: whether a pair carries a spring.
        weights: w of each pair; None: 1.

    Returns:
        Forces, positive in compression [N].
    """
    reads, (stiffness, damping) = LAWS[case.contact.law].spring, case.spring
    if not reads:
        return np.zeros(np.shape(gap))
    force = stiffness * gap
    if "penalty_damping" in reads:
        force = force + damping * rate
    return np.where(carries, -(1.0 if weights is None else weights) * force, 0.0)


def resting_pairs(record: PeriodRecord, gap: FloatArray, threshold: float) -> BoolArray:
    """Return which pairs rest on springs after each step of a period, shape (steps, pairs).

    A pair begins to rest where an impact leaves it slower than the threshold; it ceases where the
    gap opens, or where a later impact leaves it faster.

    Args:
        record: the record of the period.
        gap: gaps at the end of each step, shape (steps, pairs) [m].
        threshold: the threshold velocity [m/s].
    """
    n_steps, n_pairs = gap.shape
    change = np.zeros((n_steps + 1, n_pairs), dtype=np.int8)
    change[0] = np.where(record.resting, 1, -1)
    jumps = record.jumps.columns()
    steps = np.repeat(_steps_of(record), jumps.sizes)
    change[steps, jumps.hit] = np.where(jumps.rate_post < threshold, 1, -1)
    change[1:][gap > 0.0] = -1
    # each step has the state of the latest step with a change: 1 rests, -1 does not
    last = np.where(change != 0, np.arange(n_steps + 1)[:, None], 0)
    np.maximum.accumulate(last, axis=0, out=last)
    return np.asarray(np.take_along_axis(change, last, axis=0)[1:] > 0)


def _steps_of(record: PeriodRecord) -> IntArray:
    """Return the number of the step within which each impact of a period lies, from 1."""
    return np.asarray(-(-record.jumps.columns().ticks // record.ticks_per_step))


def _of_period(
    record: PeriodRecord,
    time_step: float,
    structure: Structure,
    rows: SensorRows,
    case: Case,
    *,
    forces: FloatArray | None,
) -> FloatArray:
    """Return the signal of a sensor at each step of a period, shape (steps,)."""
    n, steps = structure.operators.n_probes, slice(1, record.n_steps + 1)
    signal = record.base_states[steps] @ np.array(rows.of_base)
    if rows.of_u is not None:
        signal += record.u[steps, N_BASE + n + rows.of_u]
    if rows.of_v is not None:
        signal += record.v[steps, n + rows.of_v]
    if forces is None or rows.of_forces is None:
        return np.asarray(signal)
    signal += forces @ rows.of_forces
    reads = combination(case.contact.law, case.time.scheme).reads
    is_lumped = "impulse" in reads and case.contact.impulse == "lumped"
    weights = rows.of_lumped_impulses if is_lumped else rows.of_forces
    assert weights is not None  # beside the weights of forces
    jumps = record.jumps.columns()
    at = np.repeat(_steps_of(record), jumps.sizes) - 1
    inside = (at >= 0) & (at < record.n_steps)
    # a signal has one value per step: an impulse counts with its mean force over that step
    means = (weights[jumps.hit] * jumps.impulses)[inside] / time_step
    np.add.at(signal, at[inside], means)
    return np.asarray(signal)


def _sampled(own: Sensor, time: FloatArray, value: FloatArray, time_step: float) -> Signal:
    """Return the samples of a signal that is known at every step."""
    if own.sampling_rate is not None:
        value = low_passed(value, own.sampling_rate * time_step)
        first = np.ceil(time[0] * own.sampling_rate - _ROUND_OFF)
        last = np.floor(time[-1] * own.sampling_rate + _ROUND_OFF)
        at = np.clip(np.arange(first, last + 1.0) / own.sampling_rate, time[0], time[-1])
        value = scipy.interpolate.make_interp_spline(time, value, k=min(3, time.size - 1))(at)
        time = at
    if own.noise:
        rng = np.random.default_rng([own.seed, zlib.crc32(own.name.encode())])
        value = value + rng.normal(scale=own.noise, size=value.size)
    return Signal(own, time, np.asarray(value, dtype=np.float64))


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
