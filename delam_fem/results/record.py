"""The record of a run: each quantity that has a history is a channel.

A record is a dataset. A channel is one of its variables, with the attributes

    units       SI unit
    quantity    displacement, velocity, acceleration, strain, contact force, impulse, force or base
                displacement
    place       where it is, in words
    lamina, x   lamina and position [m], of a channel at a place of a lamina
    long_name   quantity and place

A run offers, without being asked, `tip_LAMINA` and `tip_LAMINA_velocity` (of operators the names of
the probes in place of those of laminae), `base` or `drive`, `contact_NAME` of each interface, stop
and impactor, and the sensors under their own names. A sensor whose name is taken is `sensor_NAME`.

The points of the scan of a plate are a record of their own (`of_scan`), in the same form.

`contact_NAME` is a contact force: an impulse counts with its mean force over its step, as in the
signal of a sensor. Springs of an interface are recorded if a sensor reads contact forces. Without
one the channel has the impulses alone (law "newton-penalty"), or is left out (elastic contacts).
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import xarray as xr

from delam_fem.model.layout import reference_channels
from delam_fem.numerics.types import BoolArray, FloatArray
from delam_fem.results.contacts import force_unit, named
from delam_fem.results.diagnostics import probe_place, steps_of_events
from delam_fem.results.netcdf import read_dataset, write_dataset
from delam_fem.results.schema import (
    CHANNEL_MEASURES,
    FORCE_PLACE,
    INTERFACE,
    SENSOR,
    VARIABLES,
    event_interfaces,
    sensors_of,
)
from delam_fem.system.errors import CaseError, require

SCHEMA = "delam_fem record 1"
"""Attribute `schema` of the file of a record."""
IN_SUMMARY = ("min", "max", "amplitude", "rms")
"""Measures of channels that summary.json has."""
QUANTITIES = ("displacement", "velocity")
"""Quantities of reference probes."""
_OF_SENSORS = ("lamina", "surface", "between", "sampling_rate", "noise", "alternating")
"""Attributes that a channel has of its sensor."""


def of_run(history: xr.Dataset, case: Any) -> xr.Dataset:
    """Return the record of a run; see the docstring of this module.

    Args:
        history: dataset of a run; of operators with the names of a case.
        case: its case, or the problem of operators.

    Returns:
        Channels over `time`; a sensor with a sampling rate is over `NAME_time`. The attributes are
        those of the history.
    """
    coordinates: dict[str, Any] = {"time": history["time"]}
    channels = dict(_references(history))
    if "force" in history:
        channels["drive"] = _channel(history["force"], quantity="force", place="the driven point")
    for number, force in enumerate(history["forces"][1:] if "forces" in history else (), start=2):
        place = str(force[FORCE_PLACE].to_numpy())
        channels[f"drive_{number}"] = _channel(force, quantity="force", place=place)
    base = history["base_displacement"]
    if "force" not in history or base.any():
        channels["base"] = _channel(base, quantity="base displacement", place="the base")
    for contact, values, units in _contacts(history, case):
        quantity = "contact force" if units == "N" else "impulse"
        force = xr.DataArray(values, dims="time", attrs={"units": units})
        channels[f"contact_{contact}"] = _channel(force, quantity=quantity, place=contact)
    for variable in sensors_of(history):
        sensor = history[variable]
        name = variable.removeprefix(SENSOR)
        name = variable if name in {*channels, *coordinates} else name
        dim = str(sensor.dims[0])
        if dim != "time":
            time = sensor[dim]
            dim = f"{name}_time"
            coordinates[dim] = (dim, time.to_numpy(), time.attrs)
        channels[name] = (dim, sensor.to_numpy(), _of_sensor(sensor))
    return xr.Dataset(channels, coordinates, {**history.attrs, "schema": SCHEMA})


def of_scan(history: xr.Dataset, case: Any) -> xr.Dataset:
    """Return the velocities of the points of a scan as channels `scan_1`, `scan_2` and so on.

    Args:
        history: dataset of a run.
        case: its case.

    Returns:
        Channels over `time`, the times of the frames, with the attributes of those of `of_run`, and
        `z` [m]. The attributes are those of the history.

    Raises:
        CaseError: the case has no scan.
    """
    if "scan_velocity" not in history:
        raise CaseError("scan: expected a case with [scan], given one without")
    lamina = case.scan.lamina or case.outer_lamina.name
    record = xr.Dataset(
        coords={"time": ("time", history["frame"].to_numpy(), {"units": "s", "long_name": "time"})}
    )
    places = zip(history["scan_x"].to_numpy(), history["scan_z"].to_numpy(), strict=True)
    channels = {}
    for number, (x, z) in enumerate(places):
        place = f"({x:g}, {z:g}) m of {lamina}"
        about = {
            "units": "m/s",
            "quantity": "velocity",
            "place": place,
            "lamina": lamina,
            "x": float(x),
            "z": float(z),
            "long_name": f"velocity at {place}",
        }
        values = history["scan_velocity"].to_numpy()[:, number]
        channels[f"scan_{number + 1}"] = ("time", values, about)
    record = record.assign(channels)
    record.attrs = {**history.attrs, "schema": SCHEMA}
    return record


_Channel: TypeAlias = tuple[str, FloatArray, dict[str, Any]]
"""Dimension, values and attributes of a channel."""


def _channel(values: xr.DataArray, row: int | None = None, **about: Any) -> _Channel:
    """Return a channel over time, with its unit and `about` as attributes.

    Args:
        values: values over time, or rows of them.
        row: number of its row; None: there are no rows.
        about: further attributes, among them `quantity` and `place`.
    """
    words = f"{about['quantity']} at {about['place']}"
    units = values.attrs.get("units") or VARIABLES[str(values.name)].units
    array = values.to_numpy()
    array = array if row is None else array[row]
    return "time", array, {"units": units, **about, "long_name": words}


def _references(history: xr.Dataset) -> Iterator[tuple[str, _Channel]]:
    """Yield names and channels: displacement and velocity of each reference probe."""
    at: dict[str, Any] = {}
    where = ""
    if "tip_node" in history:
        at["x"] = float(history["x"][int(history["tip_node"])])
        where = f"{probe_place(history)} of "
    names = history["lamina"].to_numpy().tolist()
    motions = {
        quantity: history[variable]
        for quantity in QUANTITIES
        if (variable := f"tip_{quantity}") in history
    }
    for row, lamina in enumerate(names):
        for name, quantity in zip(reference_channels(lamina), QUANTITIES, strict=True):
            if quantity in motions:
                about = {"quantity": quantity, "place": f"{where}{lamina}", "lamina": lamina}
                yield name, _channel(motions[quantity], row, **at, **about)


def _contacts(history: xr.Dataset, case: Any) -> Iterator[tuple[str, FloatArray, str]]:
    """Yield name, values and unit of the force, or of the impulses, of each contact."""
    if "event_node" not in history:
        return
    forces = history["contact_force"] if "contact_force" in history else None
    known = [] if forces is None else forces["contact"].to_numpy().tolist()
    for name, is_its in _events_of(history, case):
        unit = force_unit(case, name, is_recorded=name in known)
        if not unit:
            continue
        if forces is not None and name in known:
            yield name, forces[known.index(name)].to_numpy(), unit
            continue
        steps, is_inside = steps_of_events(history)
        chosen = is_its & is_inside
        impulses = np.bincount(
            steps[chosen],
            weights=history["event_impulse"].to_numpy()[chosen],
            minlength=history.sizes["time"],
        ).astype(np.float64)
        yield name, impulses / case.time_step if unit == "N" else impulses, unit


def _events_of(history: xr.Dataset, case: Any) -> Iterator[tuple[str, BoolArray]]:
    """Yield the name of each contact, and which events are impacts on it."""
    interfaces = event_interfaces(history)
    laminae = history["lamina"].to_numpy().tolist()
    names = ["-".join(laminae)]
    if INTERFACE in history.coords:
        names = history[INTERFACE].to_numpy().tolist()
    for number, name in enumerate(names):
        yield name, interfaces == number
    if "stop_number" not in history:
        return
    numbers = history["stop_number"].to_numpy()
    stops = history["event_stop"].to_numpy()
    of_events = np.where(stops < 0, 0, numbers[stops])
    for number in dict.fromkeys(numbers.tolist()):
        _, name = named(number - 1, case)
        yield name, of_events == number


def _of_sensor(sensor: xr.DataArray) -> dict[str, Any]:
    """Return the attributes of the channel of a sensor."""
    about: dict[str, Any] = {key: sensor.attrs.get(key, "") for key in ("units", "quantity")}
    words = str(sensor.attrs.get("long_name", str(sensor.name).removeprefix(SENSOR)))
    place = words.removeprefix(f"{about['quantity']} ").removeprefix("of ").removeprefix("at ")
    about |= {"place": place, "long_name": words}
    if "position" in sensor.attrs:
        about |= dict(zip(("x", "z"), np.ravel(sensor.attrs["position"]).tolist(), strict=False))
    return about | {key: sensor.attrs[key] for key in _OF_SENSORS if key in sensor.attrs}


def measures(record: xr.Dataset) -> dict[str, dict[str, Any]]:
    """Return the entry `channels` of summary.json: measures of each channel, with its unit."""
    return {
        str(name): measures_of(channel.to_numpy(), channel.attrs["units"])
        for name, channel in record.data_vars.items()
    }


def measures_of(values: FloatArray, units: str) -> dict[str, Any]:
    """Return the measures of the values of a channel, shape (k,), with their unit."""
    measured = {
        key: float(CHANNEL_MEASURES[key].of(values)) if values.size else None for key in IN_SUMMARY
    }
    return {**measured, "units": units}


def write_record(record: xr.Dataset, path: str | Path) -> Path:
    """Write a record as NetCDF, with units, places and where it comes from.

    Raises:
        CaseError: it is no dataset.
        OSError: the file cannot be written or the disk is full.
    """
    is_dataset = isinstance(record, xr.Dataset)
    require(is_dataset, "record", "a dataset such as result.record", type(record).__name__)
    return write_dataset(record, Path(path))


def read_record(path: str | Path) -> xr.Dataset:
    """Read a record that `write_record` has written.

    Raises:
        CaseError: the file is missing, damaged, or has no record.
    """
    record = read_dataset(Path(path))
    if record.attrs.get("schema") != SCHEMA:
        raise CaseError(
            f'{path}: expected a record with the attribute schema = "{SCHEMA}", given '
            f"{record.attrs.get('schema', 'none')!r}; read_measured reads other files"
        )
    return record
