"""Reduce the record of a point to the row of numbers that a sweep keeps."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from delam_fem.case.definition import Case
from delam_fem.model import fields
from delam_fem.model.layout import Layout, Structure
from delam_fem.numerics.arrays import FloatArray, IntArray
from delam_fem.numerics.harmonics import (
    distortion_factor,
    harmonic_amplitudes,
    harmonic_phases,
    total_harmonic_distortion,
)
from delam_fem.results import diagnostics, settling
from delam_fem.results.scan import scan_field, surface_of
from delam_fem.results.schema import SENSOR
from delam_fem.simulation.recorder import LEDGER, N_BASE, Recorder
from delam_fem.simulation.signals import Signal, signals
from delam_fem.studies.detection.shapes import ORDERS, shapes_of
from delam_fem.studies.sweeps.quantities import ENERGIES, Quantity, scanned

SETTLED = {"settled": 1.0, "not settled": 0.0, "irregular": -1.0}
"""Numbers of the verdicts in the dataset of a sweep."""
NO_PAIR = -1
"""In place of a pair if the interface has none at the probes."""


def row_of(
    wanted: tuple[Quantity, ...],
    case: Case,
    recorder: Recorder,
    structure: Structure,
    extra: Mapping[str, float],
    decay: float = 0.0,
) -> FloatArray:
    """Return the row of a point.

    Args:
        wanted: the quantities in the row.
        case: of the point.
        recorder: after the run.
        structure: that moved.
        extra: values that do not follow from the record, by name.
        decay: e-folds of the slowest mode of the structure in a period [-].

    Returns:
        One row, NaN for numbers without a meaning, shape (sum of sizes,).
    """
    names = {quantity.name for quantity in wanted}
    n_laminae = len(structure.layout.parts)
    values: dict[str, npt.ArrayLike | None] = dict(extra)
    if names & {"tip_min", "harmonic_amplitude"}:
        motion = probe_motion(recorder, structure)
    if "tip_min" in names:
        values |= diagnostics.summary_of(motion, case)
        values |= _settled(settling.numbers(recorder, n_laminae, case, decay))
        values["is_decided"] = _decided(values.pop("periodicity_class"))
        values["tip_amplitude"] = np.ptp(motion.displacement, axis=1) / 2.0
        values["energy_residual"] = recorder.energy_residual()
    strobe = recorder.strobe[: recorder.n_closed, :, :n_laminae]
    values["strobe_displacement"], values["strobe_velocity"] = strobe.transpose(1, 2, 0)
    values["periods_computed"] = recorder.n_closed
    N = case.steps_per_period
    if "harmonic_amplitude" in names:
        whole = motion.whole_periods(N)
        values["harmonic_amplitude"] = harmonic_amplitudes(whole, whole.shape[1] // N)
        values["harmonic_phase"] = harmonic_phases(whole, whole.shape[1] // N)
    if "node_thd" in names:
        values |= _node_distortion(recorder, structure.layout)
    for signal in signals(recorder, structure, case):
        values |= _of_signal(signal, case)
    if "scan_real" in names:
        values |= _scan(case, recorder, structure, wanted)
    window = recorder.ledger[recorder.n_closed - len(recorder.window) : recorder.n_closed]
    means = dict(zip(LEDGER, window.mean(axis=0), strict=True))
    values |= {f"energy_{name}": means[name] for name in ENERGIES}
    return np.concatenate([_fitted(quantity, values.get(quantity.name)) for quantity in wanted])


def _of_signal(signal: Signal, case: Case) -> dict[str, npt.ArrayLike]:
    """Return extremes, rms and harmonics of a signal over the window.

    A sensor with a sampling rate is fitted by harmonics of the excitation with least squares, as
    its samples need not fill whole periods.
    """
    name, value = f"{SENSOR}{signal.sensor.name}", signal.value
    N, n = case.steps_per_period, case.n_window_periods
    if signal.sensor.sampling_rate is None and value.size >= N:
        whole = value[value.size % N :]
        amplitudes = harmonic_amplitudes(whole, whole.size // N)
    else:
        most = max(int(0.4 * value.size / max(n, 1)), 1)  # below the filter's stop band
        phase = 2.0 * np.pi / case.period * np.outer(signal.time, np.arange(most + 1))
        columns = np.hstack([np.cos(phase), np.sin(phase[:, 1:])])
        fitted = np.linalg.lstsq(columns, value, rcond=None)[0]
        amplitudes = np.hypot(fitted[1 : most + 1], fitted[most + 1 :])
    return {
        f"{name}_min": value.min(),
        f"{name}_max": value.max(),
        f"{name}_rms": float(np.sqrt(np.mean(value**2))),
        f"{name}_harmonics": amplitudes,
    }


def probe_motion(recorder: Recorder, structure: Structure) -> diagnostics.ProbeMotion:
    """Return the motion of the reference probes that a recorder has kept.

    The first probes of the layout are the reference probes, one for each part.
    """
    layout, gap0 = structure.layout, structure.operators.gap0
    n_laminae, pairs = len(layout.parts), _pairs_at_probes(layout)
    n_steps = sum(record.n_steps for record in recorder.window)
    is_hit = np.zeros((pairs.size, n_steps), dtype=np.bool_)
    start, n_impacts = 0, 0
    for record in recorder.window:
        jumps = record.jumps.columns()
        n_impacts += jumps.hit.size
        ends = -(-jumps.ticks // record.ticks_per_step)  # the step in which an impact happened
        steps = np.repeat(ends, jumps.sizes) + (start - 1)
        for row, pair in zip(is_hit, pairs, strict=True):
            row[steps[jumps.hit == pair]] = True
        start += record.n_steps
    u = [r.u[1 : r.n_steps + 1, N_BASE : N_BASE + n_laminae] for r in recorder.window]
    return diagnostics.ProbeMotion(
        np.concatenate(u).T,
        recorder.strobe[: recorder.n_closed, 0, :n_laminae].T,
        np.where(pairs == NO_PAIR, 0.0, gap0[pairs]),
        is_hit,
        n_impacts,
    )


def _pairs_at_probes(layout: Layout) -> IntArray:
    """Return the pair at the probe of the lower part of each interface, shape (n_interfaces,)."""
    pairs = np.full(len(layout.interfaces), NO_PAIR, dtype=np.int64)
    for number, interface in enumerate(layout.interfaces):
        places = interface.places(0)
        found = np.flatnonzero(places == layout.probes[interface.parts[0]].point)
        if found.size:
            pairs[number] = interface.first_pair + found[0]
    return pairs


def _node_distortion(recorder: Recorder, layout: Layout) -> dict[str, npt.ArrayLike]:
    """Return d and THD at every node from the frames of the window."""
    states = np.concatenate([np.array(record.frames)[:, 0] for record in recorder.window])
    base = np.concatenate([r.base_states[r.frame_steps, 0] for r in recorder.window])
    u, _ = fields.nodal(layout, states, 0.0 * base if recorder.is_forced else base)
    amplitudes = harmonic_amplitudes(u.swapaxes(1, 2), len(recorder.window))
    return {
        "node_distortion_factor": distortion_factor(amplitudes),
        "node_thd": total_harmonic_distortion(amplitudes),
    }


def _settled(found: Mapping[str, Any]) -> dict[str, Any]:
    """Return the verdict of a point as numbers, and the periodicity that goes with it."""
    if found["settled"] is None:
        return {}
    entries = {name: value for name, value in found.items() if name != "settling"}
    code = SETTLED[found["settled"]]
    return entries | {"settled": code, "transient": found["settling"]["transient"]}


def _scan(
    case: Case, recorder: Recorder, structure: Structure, wanted: tuple[Quantity, ...]
) -> dict[str, npt.ArrayLike]:
    """Return the complex velocity shapes of the points of a scan; NaN for orders not sampled."""
    row = next(quantity for quantity in wanted if quantity.name == "scan_real")
    assert row.scan is not None
    x = scanned(row.scan, structure.layout)
    times, _, v = scan_field(recorder, structure, surface_of(case, row.scan.lamina), x)
    shapes = shapes_of(v, times, case.excitation.top_frequency, x)
    found = np.full((len(ORDERS), x.size), np.nan, dtype=np.complex128)
    found[[ORDERS.index(order) for order in shapes.orders]] = shapes.values
    rms = float(np.sqrt(np.mean(v**2)))
    return {
        "scan_real": found.real, "scan_imag": found.imag, "scan_rms": rms,
        "scan_between": shapes.noise,
    }  # fmt: skip


def _decided(periodicity_class: object) -> float:
    """Return 1 for a decided class, 0 for an undecided one, NaN where there is none."""
    return math.nan if periodicity_class is None else float(periodicity_class != "undecided")


def _fitted(quantity: Quantity, value: npt.ArrayLike | None) -> FloatArray:
    """Return a value as part of a row: the last strobes, the first harmonics, NaN if missing."""
    row = np.full(quantity.shape, np.nan)
    if value is None:
        return row.ravel()
    given = np.asarray(value, dtype=np.float64)
    if quantity.dims[-1:] == ("strobe",):
        n = min(given.shape[-1], row.shape[-1])
        row[..., row.shape[-1] - n :] = given[..., given.shape[-1] - n :]
    elif quantity.dims[-1:] == ("harmonic",):
        n = min(given.shape[-1], row.shape[-1])
        row[..., :n] = given[..., :n]
    else:
        row[...] = given
    return row.ravel()
