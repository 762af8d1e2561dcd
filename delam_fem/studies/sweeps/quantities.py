"""Every variable of a sweep's dataset, once, and the reduction of a record to them.

Dimensions here are those beside the grid of the sweep. The coordinates of the axes have the names
that the file of the sweep gives them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np
import numpy.typing as npt

from delam_fem.case.definition import Case
from delam_fem.model.layout import Layout, SensorRows, Structure, nodal
from delam_fem.numerics.harmonics import (
    distortion_factor,
    harmonic_amplitudes,
    harmonic_phases,
    total_harmonic_distortion,
)
from delam_fem.numerics.types import FloatArray, IntArray
from delam_fem.results import diagnostics, quality
from delam_fem.results.scan import ORDERS, scan_field, scan_positions, shapes_of, surface_of
from delam_fem.results.schema import MEASURES, SENSOR, Variable
from delam_fem.simulation.recorder import LEDGER, N_BASE, Recorder
from delam_fem.simulation.signals import Signal, signals
from delam_fem.studies.sweeps.grid import Record, ScanRecord

ENERGIES = tuple(name for name in LEDGER if name != "residual")
"""Columns of the ledger that a sweep keeps."""
_STORED = ("kinetic", "strain", "spring")
_LAST = "of the tip at the end of the last periods"

_SUMMARY = (
    *(MEASURES[name] for name in ("tip_min", "tip_max", "tip_amplitude", "periodicity")),
    Variable("settled", (), "1", "1 settled, 0 not settled, -1 irregular; NaN without a period"),
    MEASURES["transient"],
    Variable("periods_computed", (), "1", "periods that the run of the point took"),
    MEASURES["strobe_scatter"],
    Variable("is_decided", (), "1", "whether the periodicity has a margin to the threshold"),
    *(
        MEASURES[name]
        for name in (
            "tip_contacts_per_period", "impacts_per_period", "distortion_factor", "thd",
            "minimum_tip_gap", "energy_residual",
        )
    ),
)  # fmt: skip
_STROBES = (
    Variable("strobe_displacement", ("lamina", "strobe"), "m", f"displacement {_LAST}"),
    Variable("strobe_velocity", ("lamina", "strobe"), "m/s", f"velocity {_LAST}"),
)
_HARMONICS = (
    Variable(
        "harmonic_amplitude",
        ("lamina", "harmonic"),
        "m",
        "amplitude of the harmonics of the tip displacement",
    ),
    Variable(
        "harmonic_phase",
        ("lamina", "harmonic"),
        "rad",
        "phase φ of the harmonics A sin(k ω t + φ), where the base moves as sin ω t",
    ),
)
_NODES = (
    Variable("node_distortion_factor", ("lamina", "node"), "1", "distortion factor d at the nodes"),
    Variable("node_thd", ("lamina", "node"), "1", "total harmonic distortion at the nodes"),
)
_ENERGIES = tuple(
    Variable(
        f"energy_{name}",
        (),
        "J",
        f"{name.replace('_', ' ')} energy "
        f"{'at the end of periods' if name in _STORED else 'per period'}, mean over the window",
    )
    for name in ENERGIES
)
_SCAN = (
    Variable("scan_real", ("order", "scan_point"), "m/s", "velocity shape, real part"),
    Variable("scan_imag", ("order", "scan_point"), "m/s", "velocity shape, imaginary part"),
    Variable("scan_rms", (), "m/s", "root mean square of the velocity over times and points"),
    Variable("scan_between", ("scan_point",), "m/s", "mean velocity amplitude between harmonics"),
)
_LYAPUNOV = (
    Variable("lyapunov_exponent", (), "1/s", "largest Lyapunov exponent"),
    Variable(
        "lyapunov_error",
        (),
        "1/s",
        "its standard error, and what twice the distance of motions changes",
    ),
)
_OF_POINTS = (
    Variable("outcome", (), "", "how the run of the point ended"),
    Variable("error", (), "", "why a point was not completed"),
)
_COORDINATES = (
    Variable("direction", ("direction",), "", "order of the points"),
    Variable("lamina", ("lamina",), "", "lamina"),
    Variable("strobe", ("strobe",), "1", "period, counted from the end"),
    Variable("harmonic", ("harmonic",), "1", "number of the harmonic"),
    Variable("x", ("node",), "m", "position along the laminae"),
    Variable("order", ("order",), "1", "multiple of the excitation's frequency"),
    Variable("scan_x", ("scan_point",), "m", "position of the points of a scan"),
)
VARIABLES: Mapping[str, Variable] = MappingProxyType(
    {
        row.name: row
        for group in (
            _SUMMARY, _STROBES, _HARMONICS, _NODES, _ENERGIES, _SCAN, _LYAPUNOV, _OF_POINTS,
            _COORDINATES,
        )
        for row in group
    }
)  # fmt: skip
"""All variables by name; words have no unit."""


def of_sensor(sensor: SensorRows, n_harmonics: int) -> list[Variable]:
    """Return what a sweep keeps of a sensor: extremes, rms, and harmonics if it keeps these."""
    name, unit = f"{SENSOR}{sensor.name}", sensor.unit
    rows = [
        Variable(f"{name}_min", (), unit, f"smallest {sensor.words}"),
        Variable(f"{name}_max", (), unit, f"largest {sensor.words}"),
        Variable(f"{name}_rms", (), unit, f"root mean square of the {sensor.words}"),
    ]
    if n_harmonics:
        words = f"amplitude of the harmonics of the {sensor.words}"
        rows.append(Variable(f"{name}_harmonics", ("harmonic",), unit, words))
    return rows


@dataclass(frozen=True)
class Quantity:
    """Numbers that a sweep keeps of each point.

    Attributes:
        variable: of the dataset.
        shape: sizes of its dimensions beside those of the grid.
        scan: the points of the scan, if the sweep records one.
    """

    variable: Variable
    shape: tuple[int, ...]
    scan: ScanRecord | None = None

    @property
    def name(self) -> str:
        """Name of the variable."""
        return self.variable.name

    @property
    def dims(self) -> tuple[str, ...]:
        """Dimensions of the variable beside those of the grid."""
        return self.variable.dims

    @property
    def size(self) -> int:
        """Number of values per point."""
        return math.prod(self.shape)


def scanned(scan: ScanRecord, layout: Layout) -> FloatArray:
    """Return the positions of the points of a scan, shape (n,) [m]."""
    return scan_positions(float(layout.x[-1]), scan.spacing, scan.first)


def quantities(record: Record, layout: Layout) -> tuple[Quantity, ...]:
    """Return the numbers that a sweep keeps of each point, in the order of its row.

    Args:
        record: the wishes in the file of the sweep.
        layout: of the structure.
    """
    sizes = {
        "lamina": len(layout.parts),
        "strobe": record.strobes,
        "harmonic": record.harmonics,
        "node": layout.x.size,
        "order": len(ORDERS),
        "scan_point": 0 if record.scan is None else scanned(record.scan, layout).size,
    }
    signals = [row for own in layout.sensors for row in of_sensor(own, record.harmonics)]
    groups: tuple[tuple[bool | int, Sequence[Variable]], ...] = (
        (record.summary, _SUMMARY),
        (record.strobes, _STROBES),
        (record.harmonics, _HARMONICS),
        (record.node_distortion, _NODES),
        (record.energies, _ENERGIES),
        (record.scan is not None, _SCAN),
        (record.lyapunov, _LYAPUNOV),
        (record.summary, signals),
    )
    return tuple(
        Quantity(row, tuple(sizes[dim] for dim in row.dims), record.scan)
        for is_wanted, rows in groups
        if is_wanted
        for row in rows
    )


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
        values |= _settled(quality.numbers(recorder, n_laminae, case, decay))
        values["is_decided"] = _decided(values.pop("periodicity_class"))
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
    u, _ = nodal(layout, states, 0.0 * base if recorder.is_forced else base)
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
