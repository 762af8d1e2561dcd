"""Read a sweep file, and check it before anything is computed."""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from pydantic_core import PydanticCustomError

from delam_fem.case.definition import Case
from delam_fem.case.files import PRESETS, load_case, preset
from delam_fem.case.toml import CaseError, Data, message, read_toml
from delam_fem.case.units import in_si
from delam_fem.results.scan import scan_positions
from delam_fem.studies.detection.shapes import LEAST_PERIODS
from delam_fem.studies.sweeps.file import SweepFile
from delam_fem.studies.sweeps.grid import TAKEN, UNITS, Sweep

CHECKED = 1000
"""Largest number of values of an axis that are checked before the sweep."""


def load_sweep(path: str | Path, overrides: Mapping[str, object] | None = None) -> Sweep:
    """Read a sweep file.

    Args:
        path: TOML file; a relative name of a case file in it is relative to its folder.
        overrides: values of the base case by key; they replace those in `[set]` of the file.

    Returns:
        The sweep; every value of its axes is checked.

    Raises:
        CaseError: the file is missing or is not a valid sweep file, or a value is not valid.
    """
    path = Path(path)
    data = read_toml(path)
    if "lamina" in data:
        raise CaseError(f"sweep {path}: is a case; compute it with delam-fem run {path}")
    return sweep_of({"name": path.stem} | data, overrides, path.absolute().parent)


def sweep_of(
    data: Data, overrides: Mapping[str, object] | None = None, folder: Path | None = None
) -> Sweep:
    """Return the sweep that a dictionary describes.

    Args:
        data: content of a sweep file as `tomllib` returns it, with `name`.
        overrides: see `load_sweep`.
        folder: folder of the base case file; default: the working directory.

    Raises:
        CaseError: see `load_sweep`.
    """
    from pydantic import ValidationError

    label = f"sweep {data.get('name')}"
    try:
        file = SweepFile.model_validate(_with_numbers(data))
    except ValidationError as error:
        raise CaseError(message(label, error, data)) from None
    values = file.set | dict(overrides or {})
    clash = next((axis.key for axis in file.axis if axis.key in (overrides or {})), None)
    if clash is not None:
        raise CaseError(f"override {clash}: is an axis of {label}; change it in the file")
    base = preset(file.base, values) if file.base in PRESETS else _file(file.base, values, folder)
    sweep = Sweep(file, base)
    require_valid(sweep)
    return sweep


def _with_numbers(data: Data) -> Data:
    """Return a sweep file whose axes have numbers in SI where their values carry a unit.

    Raises:
        CaseError: a unit is unknown, or does not fit the key.
    """
    axes = data.get("axis")
    if not isinstance(axes, list | tuple):
        return data
    changed = []
    for number, axis in enumerate(axes, start=1):
        if not isinstance(axis, dict):
            return data
        unit = UNITS.get(str(axis.get("key")).rsplit(".", 1)[-1], "")
        own = dict(axis)
        if not unit and any(isinstance(axis.get(name), str) for name in ("start", "stop")):
            near = difflib.get_close_matches(str(axis.get("key")).rsplit(".", 1)[-1], UNITS, n=1)
            hint = f"; did you mean {near[0]}?" if near else ""
            raise CaseError(
                f"sweep {data.get('name')}: axis.{number}.key: expected a key whose values have a "
                f"unit, given {axis.get('key')!r}{hint}"
            )
        for name in {"start", "stop", "values"} & set(axis) if unit else ():
            label = f"sweep {data.get('name')}: axis.{number}.{name}"
            value = axis[name]
            is_list = isinstance(value, list | tuple)
            own[name] = (
                [_in_si(v, unit, label) for v in value] if is_list else _in_si(value, unit, label)
            )
        changed.append(own)
    return data | {"axis": changed}


def _in_si(value: object, unit: str, label: str) -> object:
    """Return a value with a unit as a number in SI, anything else as it is."""
    try:
        return in_si(value, unit)
    except PydanticCustomError as error:
        raise CaseError(f"{label}: {error.message()}") from None


def _file(name: str, values: Mapping[str, object], folder: Path | None) -> Case:
    path = (folder or Path()) / name
    if not path.is_file():
        raise CaseError(
            f"base {name!r}: neither a preset ({', '.join(PRESETS)}) nor a case file; no such "
            f"file: {path}"
        )
    return load_case(path, values)


def require_valid(sweep: Sweep) -> None:
    """Check the values of every axis of a sweep, with the other axes at their first value.

    Of a long axis the ends and some values between them are checked.

    Raises:
        CaseError: a value is not valid, or a requested record is not possible.
    """
    label = f"sweep {sweep.file.name}"
    names = [d.name for d in sweep.dimensions]
    clash = next((n for n in names if n in TAKEN or names.count(n) > 1), None)
    if clash is not None:
        raise CaseError(f"{label}: axis: the name {clash} is taken; give name = another one")
    first = sweep.overrides(0)
    if sweep.file.combine == "zip":
        trials = [sweep.overrides(index) for index in _some(sweep.n_points)]
    else:
        trials = [
            first | {d.key: d.values[k]} for d in sweep.dimensions for k in _some(len(d.values))
        ]
    for trial in trials:
        case = sweep.case_of(trial, label)
        sweep.initial_of(trial)
    case = sweep.case_of(first, label)
    record, is_harmonic = sweep.file.record, case.is_periodic
    if not is_harmonic and (sweep.file.order != "independent" or record.lyapunov):
        what = "order" if sweep.file.order != "independent" else "record.lyapunov"
        raise CaseError(f'{label}: {what}: expected excitation.kind "harmonic" for it')
    if record.node_distortion:
        _check_frames(sweep, case, label)
    if record.scan is not None:
        _check_scan(sweep, case, label)


def _check_frames(sweep: Sweep, case: Case, label: str) -> None:
    """Check that all points record evenly spaced frames on the same nodes."""
    N, frames = case.steps_per_period, case.frames_per_period
    if frames < 4 or N % frames:
        raise CaseError(
            f"{label}: record.node_distortion: expected output.fields_per_period of at least 4 "
            f"that divides time.steps_per_period = {N}, given {frames}"
        )
    keys = [d.key for d in sweep.dimensions if d.key.split(".")[0] == "mesh"]
    if keys:
        raise CaseError(
            f"{label}: record.node_distortion: expected one mesh for all points, given the "
            f"axis {keys[0]}"
        )


def _check_scan(sweep: Sweep, case: Case, label: str) -> None:
    """Check that the points of a scan exist, and that the window suffices for its shapes."""
    scan = sweep.file.record.scan
    assert scan is not None
    N, frames = case.steps_per_period, case.frames_per_period
    if frames < 5 or N % frames or case.n_window_periods < LEAST_PERIODS:
        raise CaseError(
            f"{label}: record.scan: expected output.window_periods of at least {LEAST_PERIODS},"
            " and output.fields_per_period of at least 5 that divides time.steps_per_period = "
            f"{N}, given {case.n_window_periods} and {frames}"
        )
    if not case.is_periodic:
        raise CaseError(f"{label}: record.scan: expected a harmonic excitation")
    scan_positions(case.length, scan.spacing, scan.first)
    if any(d.key.endswith(".length") for d in sweep.dimensions):
        raise CaseError(f"{label}: record.scan: expected one length for all points")


def _some(count: int) -> list[int]:
    """Return all numbers below `count`, or if they are many, some of them, the ends included."""
    numbers = np.unique(np.linspace(0, count - 1, min(count, CHECKED)).astype(np.int64))
    return [int(number) for number in numbers]
