"""Reduce the run of a point to one row of numbers, in a layout that all points share."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from delam_fem.case.definition import Case
from delam_fem.model import fields
from delam_fem.model.layout import Layout, Structure
from delam_fem.numerics.arrays import FloatArray
from delam_fem.numerics.harmonics import (
    distortion_factor,
    harmonic_amplitudes,
    total_harmonic_distortion,
)
from delam_fem.results import diagnostics
from delam_fem.simulation.recorder import LEDGER, N_BASE, Recorder
from delam_fem.studies.sweeps.file import Record

_TIP = ("lamina",)
_SUMMARY: tuple[tuple[str, tuple[str, ...], str, str], ...] = (
    ("tip_min", _TIP, "m", "smallest tip displacement"),
    ("tip_max", _TIP, "m", "largest tip displacement"),
    ("tip_amplitude", _TIP, "m", "half peak-to-peak tip displacement"),
    ("periodicity", (), "1", "periods of the excitation after which the motion repeats"),
    ("strobe_scatter", (), "1", "scatter of strobes for that periodicity, relative"),
    ("tip_contacts_per_period", (), "1", "contacts of the tips per period"),
    ("impacts_per_period", (), "1", "impulses on pairs per period"),
    ("distortion_factor", _TIP, "1", "distortion factor d of the tip"),
    ("thd", _TIP, "1", "total harmonic distortion of the tip"),
    ("minimum_tip_gap", (), "m", "smallest gap at the tip"),
    ("energy_residual", (), "1", "largest residual of the energy ledger, relative"),
)
_ENERGIES = tuple(name for name in LEDGER if name != "residual")
_STORED = ("kinetic", "strain", "spring")


@dataclass(frozen=True)
class Quantity:
    """One variable of the result.

    Attributes:
        name: name of the variable.
        dims: dimensions of the variable besides those of the grid.
        shape: sizes of these dimensions.
        units: unit of the values.
        long_name: description in words.
    """

    name: str
    dims: tuple[str, ...]
    shape: tuple[int, ...]
    units: str
    long_name: str

    @property
    def size(self) -> int:
        """Number of values per point."""
        return math.prod(self.shape)


def quantities(record: Record, layout: Layout) -> tuple[Quantity, ...]:
    """Return the quantities that a sweep records at each point, in the order of a row.

    Args:
        record: the section `record` of the sweep file.
        layout: layout of the structure.
    """
    sizes = {
        "lamina": len(layout.parts),
        "strobe": record.strobes,
        "harmonic": record.harmonics,
        "node": layout.x.size,
    }
    rows: list[tuple[str, tuple[str, ...], str, str]] = []
    if record.summary:
        rows += _SUMMARY
    if record.strobes:
        last, dims = "of the tip at the end of the last periods", ("lamina", "strobe")
        rows.append(("strobe_displacement", dims, "m", f"displacement {last}"))
        rows.append(("strobe_velocity", dims, "m/s", f"velocity {last}"))
    if record.harmonics:
        name = "amplitude of the harmonics of the tip displacement"
        rows.append(("harmonic_amplitude", ("lamina", "harmonic"), "m", name))
    if record.node_distortion:
        dims = ("lamina", "node")
        rows.append(("node_distortion_factor", dims, "1", "distortion factor d at the nodes"))
        rows.append(("node_thd", dims, "1", "total harmonic distortion at the nodes"))
    if record.energies:
        for name in _ENERGIES:
            when = "at the end of periods" if name in _STORED else "per period"
            text = f"{name.replace('_', ' ')} energy {when}, mean over the window"
            rows.append((f"energy_{name}", (), "J", text))
    if record.lyapunov:
        rows.append(("lyapunov_exponent", (), "1/s", "largest Lyapunov exponent"))
    return tuple(
        Quantity(name, dims, tuple(sizes[d] for d in dims), units, text)
        for name, dims, units, text in rows
    )


def row_of(
    wanted: tuple[Quantity, ...],
    case: Case,
    recorder: Recorder,
    structure: Structure,
    extra: Mapping[str, float],
) -> FloatArray:
    """Return the row of numbers of a point.

    Args:
        wanted: quantities in the row, in order.
        case: case of the point.
        recorder: recorder after the run.
        structure: discretised case.
        extra: values that do not follow from the recorder, by name.

    Returns:
        One row, shape (sum of sizes,); NaN for values that are not defined.
    """
    names = {quantity.name for quantity in wanted}
    motion = tip_motion(recorder, structure.operators.gap0)
    values: dict[str, npt.ArrayLike | None] = dict(extra)
    if "tip_min" in names:
        values |= diagnostics.summary_of(motion, case)
        values["tip_amplitude"] = np.ptp(motion.displacement, axis=1) / 2.0
        values["energy_residual"] = recorder.energy_residual()
    values["strobe_displacement"] = recorder.strobe[:, 0].T
    values["strobe_velocity"] = recorder.strobe[:, 1].T
    N = case.time.steps_per_period
    if "harmonic_amplitude" in names:
        whole = motion.whole_periods(N)
        values["harmonic_amplitude"] = harmonic_amplitudes(whole, whole.shape[1] // N)
    if "node_thd" in names:
        values |= _node_distortion(recorder, structure.layout)
    window = recorder.ledger[recorder.n_closed - len(recorder.window) : recorder.n_closed]
    means = dict(zip(LEDGER, window.mean(axis=0), strict=True))
    values |= {f"energy_{name}": means[name] for name in _ENERGIES}
    return np.concatenate([_fitted(quantity, values.get(quantity.name)) for quantity in wanted])


def tip_motion(recorder: Recorder, gap0: FloatArray) -> diagnostics.TipMotion:
    """Return the motion of the tips in the window of a recorder."""
    tip, start, n_impacts = gap0.size - 1, 0, 0
    hit_steps = []
    for record in recorder.window:
        for step, decision, _ in record.jumps:
            n_impacts += decision.hit.size
            if (decision.hit == tip).any():
                hit_steps.append(start + step - 1)
        start += record.n_steps
    return diagnostics.TipMotion(
        np.concatenate([r.u[1 : r.n_steps + 1, N_BASE:] for r in recorder.window]).T,
        recorder.strobe[: recorder.n_closed, 0].T,
        float(gap0[tip]),
        np.array(hit_steps, dtype=np.int64),
        n_impacts,
    )


def _node_distortion(recorder: Recorder, layout: Layout) -> dict[str, npt.ArrayLike]:
    """Return d and THD at every node from the frames of the window."""
    states = np.concatenate([np.array(record.frames)[:, 0] for record in recorder.window])
    base = np.concatenate([r.base_states[r.frame_steps, 0] for r in recorder.window])
    u, _ = fields.nodal(layout, states, base)
    amplitudes = harmonic_amplitudes(u.swapaxes(1, 2), len(recorder.window))
    return {
        "node_distortion_factor": distortion_factor(amplitudes),
        "node_thd": total_harmonic_distortion(amplitudes),
    }


def _fitted(quantity: Quantity, value: npt.ArrayLike | None) -> FloatArray:
    """Return a value in the shape of its quantity, flat; missing strobes and harmonics are NaN."""
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
