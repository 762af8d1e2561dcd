"""The result of a run: one dataset, one summary, and the folder they are written to."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from delam_fem.case.atomic import atomic, write_text
from delam_fem.case.definition import Case
from delam_fem.case.files import save_case
from delam_fem.model import fields
from delam_fem.model.layout import Model
from delam_fem.numerics.arrays import FloatArray
from delam_fem.simulation.loop import State
from delam_fem.simulation.recorder import LEDGER, N_BASE, PeriodRecord, Recorder

_ENERGY_NAMES = {
    "kinetic": "kinetic energy at the end of the period",
    "strain": "strain energy at the end of the period",
    "spring": "energy in contact springs at the end of the period",
    "base_work": "work of the base on the laminae in the period",
    "damping_loss": "energy lost to damping in the period",
    "contact_damping_loss": "energy lost to contact dampers in the period",
    "impact_loss": "energy lost to impacts in the period",
    "spring_released": "energy set free by switching contact springs in the period",
    "residual": "what the ledger of the period does not account for",
}


@dataclass(frozen=True)
class Result:
    """What a run gives.

    Attributes:
        case: the case.
        history: all recorded quantities, each with units.
        summary: a few numbers; undefined ones are None.
        state: state at the end, from which another run may start.
    """

    case: Case
    history: xr.Dataset
    summary: dict[str, Any]
    state: State

    def save(self, directory: str | Path) -> list[Path]:
        """Write numbers, figures, fields and report to a folder.

        Everything is written under a temporary name and renamed when complete.

        Args:
            directory: made where it does not exist.

        Returns:
            The files and folders written.

        Raises:
            OSError: the folder cannot be written or the disk is full.
        """
        from delam_fem.results import figures, vtk, vtx
        from delam_fem.results.report import write_report

        directory = Path(directory)
        written = self.save_numbers(directory)
        written += figures.save_figures(self.history, self.case, directory / "figures")
        if self.history.sizes.get("frame", 0):
            collection = vtk.write_fields(self.history, self.case, directory / "fields")
            lines = vtx.write_lines(self.history, directory / "fields")
            picture = vtk.render(self.history, self.case, directory / "figures" / "laminae.png")
            written += [path for path in (collection, lines, picture) if path is not None]
        written.append(write_report(self.history, self.summary, self.case, directory))
        return written

    def save_numbers(self, directory: str | Path) -> list[Path]:
        """Write case.toml, result.nc and summary.json only."""
        directory = Path(directory)
        written = [save_case(self.case, directory)]
        path = directory / "result.nc"
        with atomic(path) as temporary:
            self.history.to_netcdf(temporary, engine="h5netcdf")
        written.append(path)
        text = json.dumps(self.summary, indent=2, allow_nan=False) + "\n"
        return [*written, write_text(directory / "summary.json", text)]


def history(
    recorder: Recorder, model: Model, case: Case, attributes: Mapping[str, str]
) -> xr.Dataset:
    """Put what a recorder kept into a dataset.

    Args:
        recorder: after at least one period.
        model: gives the nodes and E I.
        case: gives names and steps.
        attributes: what the dataset says about its origin beside case and versions.
    """
    names = [lamina.name for lamina in case.lamina]
    dt, n_steps = case.time_step, case.time.steps_per_period
    first = recorder.n_closed - len(recorder.window)
    data = xr.Dataset(coords={"lamina": names})
    _add_window(data, recorder, first * n_steps, dt)
    _add_periods(data, recorder)
    _add(data, "x", "node", model.x, "m", "position along the laminae from the clamp")
    data = data.set_coords("x")
    gap0 = np.concatenate([[0.0], model.operators.gap0])
    _add(data, "gap0", "node", gap0, "m", "gap at rest")
    data = _add_frames(data, recorder, model, first * n_steps, dt)
    _add_events(data, recorder, first * n_steps, dt)
    data.attrs = {
        "title": f"clapping laminae: {case.name}",
        "case": case.to_toml(),
        "delam_fem": version("delam_fem"),
        "numpy": np.__version__,
        **attributes,
    }
    return data


def _add(
    data: xr.Dataset, name: str, dims: str | tuple[str, ...], values: Any, *labels: str
) -> None:
    """Add a variable with its unit and long name."""
    units, long_name = labels
    data[name] = (dims, np.asarray(values), {"units": units, "long_name": long_name})


def _rows(record: PeriodRecord) -> slice:
    return slice(1, record.n_steps + 1)


def _add_window(data: xr.Dataset, recorder: Recorder, start: int, dt: float) -> None:
    """Add the histories of the tips and the base at every step of the window."""
    window = recorder.window
    u = np.concatenate([r.u[_rows(r), N_BASE:] for r in window])
    v = np.concatenate([r.v[_rows(r)] for r in window])
    base = np.concatenate([r.base_states[_rows(r), 0] for r in window])
    _add(data, "time", "time", (start + 1 + np.arange(len(u))) * dt, "s", "time")
    both = ("lamina", "time")
    _add(data, "tip_displacement", both, u.T, "m", "displacement of the tip, base motion included")
    _add(data, "tip_velocity", both, v.T, "m/s", "velocity of the tip, base motion included")
    _add(data, "base_displacement", "time", base, "m", "displacement of the base")


def _add_periods(data: xr.Dataset, recorder: Recorder) -> None:
    """Add what is kept of every period."""
    k = recorder.n_closed
    _add(data, "period", "period", np.arange(k), "1", "number of the period")
    both = ("lamina", "period")
    end = "of the tip at the end of the period"
    _add(data, "strobe_displacement", both, recorder.strobe[:k, 0].T, "m", f"displacement {end}")
    _add(data, "strobe_velocity", both, recorder.strobe[:k, 1].T, "m/s", f"velocity {end}")
    within = "displacement of the tip within the period"
    _add(data, "envelope_min", both, recorder.envelope[:k, 0].T, "m", f"smallest {within}")
    _add(data, "envelope_max", both, recorder.envelope[:k, 1].T, "m", f"largest {within}")
    _add(data, "impulse_sum", "period", recorder.impulse[:k, 0], "N s", "sum of impulses in it")
    _add(data, "impact_count", "period", recorder.impulse[:k, 1], "1", "impulses on pairs in it")
    for name, column in zip(LEDGER, recorder.ledger[:k].T, strict=True):
        _add(data, f"energy_{name}", "period", column, "J", _ENERGY_NAMES[name])


def _add_frames(
    data: xr.Dataset, recorder: Recorder, model: Model, start: int, dt: float
) -> xr.Dataset:
    """Add the fields of the window's frames."""
    n, n_nodes = model.operators.n_dofs, len(model.x)
    steps, frames, contact, base = [], [np.empty((0, 2, n))], [np.empty((0, n_nodes - 1))], []
    for j, record in enumerate(recorder.window):
        if record.frames:
            own = record.frame_steps[: len(record.frames)]
            steps.append(start + j * recorder.steps_per_period + own)
            base.append(record.base_states[own, :2])
            frames.append(np.array(record.frames))
            contact.append(np.array(record.contact))
    when = np.concatenate(steps) * dt if steps else np.empty(0)
    base_states = np.concatenate(base) if base else np.empty((0, 2))
    states = np.concatenate(frames)
    u, phi = fields.nodal(states[:, 0], base_states[:, 0])
    v, _ = fields.nodal(states[:, 1], base_states[:, 1])
    state = np.concatenate([np.zeros((len(when), 1)), np.concatenate(contact)], axis=1)
    _add(data, "frame", "frame", when, "s", "time of the frame")
    dims = ("lamina", "frame", "node")
    _add(data, "displacement", dims, u, "m", "displacement, base motion included")
    _add(data, "slope", dims, phi, "1", "slope of the displacement")
    _add(data, "velocity", dims, v, "m/s", "velocity, base motion included")
    moment = fields.bending_moment(model, u, phi)
    _add(data, "moment", dims, moment, "N m", "bending moment E I u''")
    meaning = "contact state: 0 open, 1 hit, 2 permanent"
    _add(data, "contact_state", ("frame", "node"), state.astype(np.int8), "1", meaning)
    return data


def _add_events(data: xr.Dataset, recorder: Recorder, start: int, dt: float) -> None:
    """Add the table of impacts in the window; pairs hit at one instant share its energy."""
    columns: list[FloatArray] = [np.empty((5, 0))]
    for j, record in enumerate(recorder.window):
        for step, decision, energy in record.jumps:
            p = decision.impulses
            time = np.full(p.size, (start + j * recorder.steps_per_period + step) * dt)
            share = energy * p / float(p.sum()) if p.any() else np.zeros(p.size)
            columns.append(np.array([time, decision.hit + 1, p, decision.rate_pre, share]))
    table = np.concatenate(columns, axis=1)
    _add(data, "event_time", "event", table[0], "s", "time of the impact")
    _add(data, "event_node", "event", table[1].astype(np.int64), "1", "node that is hit")
    _add(data, "event_impulse", "event", table[2], "N s", "impulse that parts the laminae")
    _add(data, "event_velocity_before", "event", table[3], "m/s", "gap rate before the impact")
    meaning = "change of energy at the instant, shared in proportion to the impulses"
    _add(data, "event_energy", "event", table[4], "J", meaning)


def json_ready(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return numbers as JSON knows them: no numpy types, None for what is not finite."""

    def ready(value: Any) -> Any:
        if isinstance(value, (list, tuple, np.ndarray)):
            return [ready(v) for v in value]
        if isinstance(value, np.generic):
            value = value.item()
        return None if isinstance(value, float) and not math.isfinite(value) else value

    return {key: ready(value) for key, value in values.items()}
