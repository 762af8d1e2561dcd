"""Read measurements of any known format into one dataset whose names are those of a run.

`tip_displacement(lamina, time)`, `tip_velocity`, `base_displacement(time)`, `force(time)`,
`sensor_NAME(time)` and `gap0(node)` with `x(node)` mean the same as in a run. Besides:

    response(frequency, output)    frequency responses, complex
    coherence(frequency, output)   their coherence, NaN where it was not measured
    channel_…(channel)             of every channel: variable, units, quantity, position [m],
                                   lamina, where it comes from
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from scipy.interpolate import CubicSpline

from delam_fem.api import CaseError, FloatArray, netcdf, reason_of, schema, shown
from delam_fem.studies.signals import readers
from delam_fem.studies.signals.channels import (
    Channel,
    Sheet,
    Times,
    Values,
    assignment,
    channels_of,
    joined,
    same_names,
)

SCHEMA = "delam_fem measurement"
"""Value of the dataset's attribute `schema`."""
TIP = re.compile(
    r"tip[ _](?:(?:displacement|velocity|acceleration)[ _])?(?P<lamina>.+?)(?:_velocity)?",
    re.IGNORECASE,
)
"""The name of a channel at the tip of a lamina."""
BASE = re.compile(r"base(?:[ _](?:displacement|velocity|acceleration))?", re.IGNORECASE)
"""Names of channels on the base."""
CONTACT = re.compile(r"contact[ _]force[ _](?P<contact>.+)", re.IGNORECASE)
"""The name of a contact force in an exported run."""
OF_TIPS = {"displacement": "tip_displacement", "velocity": "tip_velocity"}
OF_DRIVE = {("base", "displacement"): "base_displacement",
            ("base_displacement", "displacement"): "base_displacement",
            ("force", "force"): "force", ("drive", "force"): "force"}  # fmt: skip
COMPLEX = ("response", "damped_response")
"""Variables that are complex, and in files two each."""
EQUAL = 1e-6
"""Share of a step up to which two axes count as the same."""
SMALLEST_STEP, LARGEST_STEP = 1e-12, 1e9
"""Bounds of the steps of an axis [s, Hz or m]."""
TABLE = {
    "variable": "variable that holds the channel",
    "units": "unit",
    "quantity": "what was measured",
    "position": "where it was measured",
    "lamina": "on which lamina it was measured",
    "source": "file and column, with the unit there",
}
"""Variables `channel_…` with their meaning."""
BESIDES = {
    "channel_across": "where it was measured across a plate",
    "frequency": "frequency",
    "output": "name of a frequency response",
    "response": "frequency response",
    "response_real": "its real part, in a file",
    "response_imag": "its imaginary part, in a file",
    "response_units": "unit of each frequency response, where they differ",
    "damped_response": "frequency response H(iω + a), from which poles are found; a is its decay",
    "damped_response_real": "its real part, in a file",
    "damped_response_imag": "its imaginary part, in a file",
    "coherence": "coherence",
    "psd": "power spectral density of a response",
    "psd_excitation": "power spectral density of the excitation",
    "response_deviation": "standard deviation of a frequency response",
    "response_noise": "its part by noise",
    "line_frequency": "frequency of a line of a multisine",
    "line_kind": "whether a line is driven, even or odd",
    "line_level": "amplitude of a response at a line",
    "line_noise": "its standard deviation by noise",
    "line_scattered": "distortion at a driven line, by realisations",
    "free_time": "middle of a segment of a free vibration",
    "free_frequency": "its frequency",
    "free_damping": "its damping ratio",
    "free_amplitude": "its amplitude at the beginning of the segment",
    "free_frequency_error": "standard error of its frequency",
    "free_damping_error": "standard error of its damping ratio",
    "channel": "name of a channel",
    **{f"channel_{name}": meaning for name, meaning in TABLE.items()},
}
"""Variables and coordinates that a run's dataset does not have, with their meaning."""


def dataset(channels: Sequence[Channel], notes: Sequence[str] = ()) -> xr.Dataset:
    """Return measured channels as one dataset.

    Histories over other times than the first are interpolated to the finest step over the time
    that all have; a note says so.

    Args:
        channels: channels in SI.
        notes: what was put right when the files were read.

    Raises:
        CaseError: two channels have the same name, or their times have nothing in common.
    """
    notes = list(notes)
    data = xr.Dataset()
    if any(_is_gap(channel) for channel in channels):  # then other columns over x are no gaps
        channels = [channel for channel in channels if channel.axis != "x" or _is_gap(channel)]
    sources: dict[tuple[str, str], str] = {}
    for channel in channels:
        if (key := (channel.name, channel.kind)) in sources:
            raise same_names(channel.name, sources[key], channel.source)
        sources[key] = channel.source
    histories = [channel for channel in channels if channel.axis == "time"]
    if histories:
        time, values = _on_one_axis(histories, notes)
        data = _with_histories(data, histories, time, values)
    spectra = [channel for channel in channels if channel.axis == "frequency"]
    if spectra:
        data = _with_responses(data, spectra, notes)
    gaps = [channel for channel in channels if channel.axis == "x"]
    if gaps:
        data = _with_gaps(data, gaps, notes)
    data = _with_table(data, channels)
    data.attrs = {"title": "measurement", "schema": SCHEMA, "notes": "\n".join(notes)}
    return data


def _is_gap(channel: Channel) -> bool:
    """Return whether a channel says that it is a gap."""
    return channel.axis == "x" and channel.name.lower().startswith("gap")


def variable_of(channel: Channel) -> str:
    """Return the name of the variable that holds a channel."""
    if channel.axis == "frequency":
        return "coherence" if channel.kind == "coherence" else "response"
    if channel.axis == "x":
        return "gap0"
    tip_match = TIP.fullmatch(channel.name)
    quantity = channel.si.quantity
    if tip_match and quantity in OF_TIPS:
        return OF_TIPS[quantity]
    if drive_name := OF_DRIVE.get((channel.name.lower(), quantity)):
        return drive_name
    word = re.sub(r"[^\w.@-]+", "_", channel.name.strip())
    return word if word.startswith("sensor_") else f"sensor_{word}"


def _on_one_axis(channels: Sequence[Channel], notes: list[str]) -> tuple[FloatArray, list[Values]]:
    """Return a common axis and the values of all channels there."""
    first = channels[0].points
    step = min(float(np.median(np.diff(channel.points))) for channel in channels)
    if not SMALLEST_STEP <= step <= LARGEST_STEP:
        raise CaseError(
            f"{channels[0].source}: expected steps of {channels[0].axis} between {SMALLEST_STEP:g} "
            f"and {LARGEST_STEP:g} in SI units, given {step:g}; is the unit right?"
        )
    if all(
        channel.points.size == first.size
        and bool(np.all(np.abs(channel.points - first) <= EQUAL * step))
        for channel in channels
    ):
        return first, [channel.values for channel in channels]
    start = max(float(channel.points[0]) for channel in channels)
    end = min(float(channel.points[-1]) for channel in channels)
    if end - start < step:
        raise CaseError(
            f"{channels[0].source} and other channels: expected a common range of "
            f"{channels[0].axis}, given none"
        )
    finest = min(channels, key=lambda channel: float(np.median(np.diff(channel.points))))
    margin = EQUAL * step
    axis = finest.points[(finest.points >= start - margin) & (finest.points <= end + margin)]
    values = [
        CubicSpline(channel.points, channel.values)(
            np.clip(axis, channel.points[0], channel.points[-1])
        )
        for channel in channels
    ]
    notes.append(
        f"channels over different values of {channels[0].axis}: interpolated to a step of "
        f"{step:.6g} from {start:.6g} to {end:.6g}"
    )
    return axis, values


def _with_histories(
    data: xr.Dataset, channels: Sequence[Channel], time: FloatArray, values: Sequence[Values]
) -> xr.Dataset:
    """Return the dataset with histories: tips by lamina, drive and sensors."""
    tips: dict[str, dict[str, Values]] = {}
    drives = dict[str, Values]()
    sensors = dict[str, Any]()
    sources: dict[tuple[str, str], str] = {}
    for channel, row in zip(channels, values, strict=True):
        name = variable_of(channel)
        key = (name, _lamina_of(channel) if name in OF_TIPS.values() else "")
        if key in sources:
            raise same_names(" ".join(filter(None, key)), sources[key], channel.source)
        sources[key] = channel.source
        if name in OF_TIPS.values():
            tips.setdefault(name, {})[_lamina_of(channel)] = row
        elif name in schema.VARIABLES:
            drives[name] = row
        else:
            words = f"{channel.si.quantity or 'signal'}: {channel.name}"
            about = {"units": channel.si.units, "long_name": words, **_attributes(channel)}
            sensors[name] = (("time",), row, about)
    laminae = list(dict.fromkeys(lamina for by_lamina in tips.values() for lamina in by_lamina))
    if laminae:
        data = data.assign_coords(lamina=laminae)
    none = np.full(time.size, np.nan)
    tables = {
        name: [by_lamina.get(lamina, none) for lamina in laminae]
        for name, by_lamina in tips.items()
    }
    schema.add(data, time=time, **tables, **drives)
    for quantity, name in OF_TIPS.items():
        if name in tables:
            data[name].attrs |= {"quantity": quantity, "place": "the tips"}
    for name in drives:
        place = "the base" if name.startswith("base") else "the driven point"
        data[name].attrs |= {"quantity": name.replace("_", " "), "place": place}
    return data.assign(sensors)  # at once: one by one, thousands take minutes


def _attributes(channel: Channel) -> dict[str, Any]:
    """Return quantity and place of a channel, as a record of a run has them."""
    is_base = BASE.fullmatch(channel.name)
    quantity = f"base {channel.si.quantity}" if is_base else channel.si.quantity
    lamina = channel.lamina or _lamina_of(channel)
    places = [lamina] if lamina else []
    attributes: dict[str, Any] = {"quantity": quantity}
    if lamina:
        attributes["lamina"] = lamina
    if channel.position is not None:
        attributes["x"] = channel.position
        places.append(f"{channel.position:g} m")
    if channel.across is not None:
        attributes["z"] = channel.across
        places[-1] = f"({channel.position:g}, {channel.across:g}) m"
    return {**attributes, "place": " at ".join(places) or channel.name}


def _with_responses(data: xr.Dataset, channels: Sequence[Channel], notes: list[str]) -> xr.Dataset:
    """Return the dataset with frequency responses and coherences."""
    frequency, values = _on_one_axis(channels, notes)
    tables = {
        kind: {c.name: v for c, v in zip(channels, values, strict=True) if variable_of(c) == kind}
        for kind in ("response", "coherence")
    }
    units = {channel.si.units for channel in channels if variable_of(channel) == "response"}
    names = list(dict.fromkeys([*tables["response"], *tables["coherence"]]))
    data = data.assign_coords(
        frequency=("frequency", frequency, {"units": "Hz", "long_name": BESIDES["frequency"]}),
        output=names,
    )
    none = np.full(frequency.size, np.nan)
    shown_units = {"response": units.pop() if len(units) == 1 else "see channel_units"}
    for kind, by_name in tables.items():
        if by_name:
            about = {"units": shown_units.get(kind, "1"), "long_name": BESIDES[kind]}
            table = np.array([by_name.get(name, none) for name in names]).T
            data[kind] = (("frequency", "output"), table, about)
    return data


def _with_gaps(data: xr.Dataset, channels: Sequence[Channel], notes: list[str]) -> xr.Dataset:
    """Return the dataset with the gaps at rest."""
    wrong = [channel for channel in channels if channel.si.quantity != "displacement"]
    if wrong:
        raise CaseError(
            f"{wrong[0].source}: expected a gap in a unit of length over x, given a "
            f"{wrong[0].si.quantity or 'quantity in ' + wrong[0].si.units}"
        )
    x, values = _on_one_axis(channels, notes)
    if len(channels) > 1:
        data = data.assign_coords(interface=[channel.name for channel in channels])
    schema.add(data, x=x)
    data = data.set_coords("x")
    schema.add(data, gap0=values[0] if len(values) == 1 else np.array(values))
    return data


def _with_table(data: xr.Dataset, channels: Sequence[Channel]) -> xr.Dataset:
    """Return the dataset with the table of the channels."""
    rows = [channel for channel in channels if channel.kind != "coherence"]
    columns = {
        "variable": [variable_of(channel) for channel in rows],
        "units": [channel.si.units for channel in rows],
        "quantity": [channel.si.quantity for channel in rows],
        "position": [np.nan if channel.position is None else channel.position for channel in rows],
        "lamina": [channel.lamina or _lamina_of(channel) for channel in rows],
        "source": [channel.source for channel in rows],
    }
    across = np.array([np.nan if channel.across is None else channel.across for channel in rows])
    data = data.assign_coords(channel=[channel.name for channel in rows])
    if np.isfinite(across).any():
        about = {"units": "m", "long_name": BESIDES["channel_across"]}
        data["channel_across"] = (("channel",), across, about)
    for name, values in columns.items():
        about = {"units": "m" if name == "position" else "1", "long_name": TABLE[name]}
        data[f"channel_{name}"] = (("channel",), np.array(values), about)
    return data


def _lamina_of(channel: Channel) -> str:
    """Return the lamina that the name of a tip's channel says; empty for others."""
    tip_match = TIP.fullmatch(channel.name)
    return tip_match["lamina"] if tip_match and channel.axis == "time" else ""


READERS: dict[str, Callable[[Path], list[Sheet]]] = {
    ".csv": readers.read_text,
    ".txt": readers.read_text,
    ".dat": readers.read_text,
    ".tsv": readers.read_text,
    ".asc": readers.read_text,
    ".lvm": readers.read_labview,
    ".mat": readers.read_matlab,
    ".uff": readers.read_universal,
    ".unv": readers.read_universal,
    ".uf": readers.read_universal,
    ".58b": readers.read_universal,
    ".nc": lambda path: readers.netcdf_sheets(netcdf.read_dataset(path), path),
    ".nc4": lambda path: readers.netcdf_sheets(netcdf.read_dataset(path), path),
    ".cdf": lambda path: readers.netcdf_sheets(netcdf.read_dataset(path), path),
    ".h5": readers.read_hdf5,
    ".hdf5": readers.read_hdf5,
    ".tdms": readers.read_tdms,
    ".wav": readers.read_sound,
}
"""Readers by the suffix of the file."""


def assigned(channels: Mapping[str, str] | Sequence[str] | None) -> dict[str, str]:
    """Return sources by name of the channel, from a mapping or texts NAME=SOURCE (--channel)."""
    if isinstance(channels, Mapping):
        return dict(channels)
    sources: dict[str, str] = {}
    for text in channels or ():
        name, sign, source = text.partition("=")
        if not sign or not name.strip() or not source.strip():
            raise CaseError(f"--channel: expected NAME=SOURCE, given {shown(text)}")
        if name.strip() in sources:
            raise CaseError(f"--channel: expected different names, given {name.strip()!r} twice")
        sources[name.strip()] = source.strip()
    return sources


def read_measured(
    *paths: str | Path | Sequence[Mapping[str, Any]],
    channels: Mapping[str, str] | None = None,
    units: str | None = None,
    rate: float | None = None,
    between: tuple[float, float] | None = None,
    fill: bool = False,
) -> xr.Dataset:
    """Read measurements into one dataset in SI.

    Args:
        paths: CSV (.csv, .txt, .dat, .tsv), universal (.uff, .unv), MATLAB (.mat), LabVIEW (.lvm,
            .tdms), HDF5 (.h5), sound (.wav) or NetCDF (.nc) files, also the result.nc of a run; or
            lists of time series after SEP 005 of SDyPy.
        channels: what columns are, as `{"tip thick": "col2:mm", "mid": "Laser 3:mm/s@0.2/upper"}`:
            source, then after a colon the unit, after an @ the position [m] and the lamina.
            `tip LAMINA`, `base`, `force` and `gap` have their own variables; others are sensors.
        units: unit of columns that name none; "SI": the SI unit of the quantity that the file says.
        rate: samples per second; it replaces the times of the files.
        between: first and last time that are read [s]; None: all.
        fill: interpolate short holes, where samples are missing.

    Returns:
        A dataset as the docstring of this module describes it.

    Raises:
        CaseError: a file cannot be read, or what it holds is not clear.
    """
    if not paths:
        raise CaseError("expected at least one file of measurements, given none")
    if rate is not None and not 0.0 < rate < np.inf:
        raise CaseError(f"--rate: expected a positive number of samples per second, given {rate:g}")
    files = [Path(path) for path in paths if isinstance(path, str | Path)]
    lists = [path for path in paths if not isinstance(path, str | Path)]
    if (
        len(files) == len(paths) == 1
        and not channels
        and files[0].suffix in (".nc", ".nc4")
        and files[0].is_file()
    ):
        data = netcdf.read_dataset(files[0])
        if data.attrs.get("schema") == SCHEMA:
            _require_measurement(data, str(files[0]))
            return _with_complex(data)
    sheets = [sheet for path in files for sheet in sheets_of(path)]
    sheets += [sheet for series in lists for sheet in readers.sep005_sheets(series)]
    assigned = {
        name: assignment(text, f"--channel {name}") for name, text in (channels or {}).items()
    }
    notes = [f"{sheet.label}: {note}" for sheet in sheets for note in sheet.notes]
    channels_in_si = channels_of(sheets, assigned, units, Times(rate, fill, between), notes)
    return dataset(joined(channels_in_si), notes)


def _require_measurement(data: xr.Dataset, label: str) -> None:
    """Require that a dataset is a measurement as `write_measured` writes it.

    Raises:
        CaseError: the table of the channels, an axis or a channel is not there or has another form.
    """
    size = data.sizes.get("channel", 0)
    for name in ("channel", *(f"channel_{key}" for key in TABLE)):
        variable = data.variables.get(name)
        kinds = "f" if name == "channel_position" else "OUT"
        if variable is None or variable.dims != ("channel",) or variable.dtype.kind not in kinds:
            raise CaseError(f"{label}: expected a measurement, found no table of channels ({name})")
    for axis in ("time", "frequency", "x"):
        points = data.variables.get(axis)
        is_axis = points is None or (points.ndim == 1 and points.dtype.kind in "fiu")
        if not is_axis or (points is not None and np.any(~(np.diff(points.values) > 0.0))):
            raise CaseError(f"{label}: expected a measurement, found {axis} that does not increase")
    parts = {"response": ("response_real", "response_imag")}
    for k in range(size):
        variable_name = str(data["channel_variable"].values[k])
        for name in parts.get(variable_name, (variable_name,)):
            if name not in data.variables or not data[name].dims:
                raise CaseError(f"{label}: expected a measurement, found no channel {name[:40]!r}")
        try:
            values = history_of(_with_complex(data), k)
        except (KeyError, ValueError, IndexError, TypeError) as error:
            raise CaseError(
                f"{label}: expected a measurement, found another channel {variable_name[:40]!r} "
                f"({reason_of(error)})"
            ) from None
        if values.ndim != 1 or values.dtype.kind not in "fiuc" or values.size < 1:
            raise CaseError(
                f"{label}: expected a measurement, found another form of {variable_name[:40]!r}"
            )
    if not isinstance(data.attrs.get("notes", ""), str):
        raise CaseError(f"{label}: expected a measurement, found notes that are no text")


def sheets_of(path: Path) -> list[Sheet]:
    """Return the columns of a file of any known format.

    Raises:
        CaseError: there is no such file, it is of no known format, or it is damaged.
    """
    if path.is_dir():
        raise CaseError(f"{path}: expected a file, given a folder; that of a run has result.nc")
    if not path.is_file():
        raise CaseError(f"{path}: there is no such file")
    reader = READERS.get(path.suffix.lower())
    if reader is None:
        raise CaseError(
            f"{path}: expected a file that ends in {', '.join(READERS)}, given "
            f"{path.suffix or 'no suffix'}"
        )
    try:
        return reader(path)
    except OSError as error:
        raise CaseError(f"{path}: cannot be read ({error.strerror or error})") from None


def _with_complex(data: xr.Dataset) -> xr.Dataset:
    """Return a dataset whose responses are complex again."""
    for name in COMPLEX:
        if f"{name}_real" in data:
            real, imag = data[f"{name}_real"], data[f"{name}_imag"]
            data = data.drop_vars([f"{name}_real", f"{name}_imag"])
            data = data.assign({name: (real + 1j * imag).assign_attrs(real.attrs)})
    return data


def record(data: xr.Dataset) -> xr.Dataset:
    """Return the histories of a measurement as a record: channels named as those of a run.

    Args:
        data: a measurement.

    Returns:
        Channels over `time` with the attributes of `results/record.py`, besides `name`: the name
        that the measurement gives to the channel.

    Raises:
        CaseError: the measurement has no histories.
    """
    if "time" not in data:
        raise CaseError("measurement: expected histories over the time, found none")
    channels = {}
    for k, name in histories_in(data).items():
        row = {key: data[f"channel_{key}"][k].item() for key in TABLE}
        quantity = str(row["quantity"])
        about = {"units": row["units"], "quantity": quantity, "place": name, "name": name}
        if row["lamina"]:
            about["lamina"] = row["lamina"]
        if np.isfinite(row["position"]):
            about["x"] = row["position"]
        if "channel_across" in data and np.isfinite(data["channel_across"][k]):
            about["z"] = data["channel_across"][k].item()
        if BASE.fullmatch(name):
            about["quantity"] = f"base {quantity}"
        channels[_name_in_record(name, row)] = ("time", history_of(data, k), about)
    return xr.Dataset(channels, coords={"time": data["time"]})


def histories_in(data: xr.Dataset) -> dict[int, str]:
    """Return the names of the channels over the time, by their numbers in the table."""
    names = map(str, data["channel"].to_numpy())
    variables = map(str, data["channel_variable"].to_numpy())
    return {
        k: name
        for k, (name, variable) in enumerate(zip(names, variables, strict=True))
        if variable in data and "time" in data[variable].dims
    }


def _name_in_record(name: str, row: Mapping[str, Any]) -> str:
    """Return what the record of a run calls a channel."""
    quantity = str(row.get("quantity", ""))
    suffix = "" if quantity in ("", "displacement") else f"_{quantity}"
    if TIP.fullmatch(name) and quantity and row["lamina"]:
        return f"tip_{row['lamina']}{suffix}"
    if BASE.fullmatch(name):
        return f"base{suffix}"
    if row["variable"] == "force":
        return "drive"
    if contact := CONTACT.fullmatch(name):
        return f"contact_{contact['contact']}"
    return name.removeprefix(schema.SENSOR)


def history_named(data: xr.Dataset, name: str, option: str) -> int:
    """Return the number of a history in the table by its name there, or in the record of a run.

    Args:
        data: a measurement.
        name: the name.
        option: what names it, for the message.

    Raises:
        CaseError: there is no such history.
    """
    names = histories_in(data)
    for k, called in names.items():
        if name == called:
            return k
    for k, called in names.items():
        row = {key: data[f"channel_{key}"][k].item() for key in TABLE if f"channel_{key}" in data}
        if name == _name_in_record(called, row):
            return k
    listing = ", ".join(names.values()) or "none"
    raise CaseError(f"{option}: expected one of the histories {listing}, given {name!r}")


def as_sep005(data: xr.Dataset) -> list[dict[str, Any]]:
    """Return a record as time series after SEP 005 of SDyPy.

    Args:
        data: channels over `time`: `result.record`, or what `record` makes of a measurement.

    Returns:
        For each channel `name`, `data`, `unit_str`, `quantity`, and `fs` [Hz] where times have
        equal steps, otherwise `time` [s]; `position` [m] and `lamina` where they are known.

    Raises:
        CaseError: nothing is over `time`.
    """
    if "time" not in data:
        raise CaseError("SEP 005: expected channels over the time, found none")
    time = data["time"].to_numpy()
    steps = np.diff(time)
    is_even = steps.size > 0 and np.ptp(steps) <= EQUAL * steps.mean()
    axis = {"fs": float(1.0 / steps.mean())} if is_even else {"time": time.tolist()}
    series = []
    for name, channel in data.data_vars.items():
        if channel.dims != ("time",):
            continue
        about = {key: channel.attrs[key] for key in ("quantity", "lamina") if key in channel.attrs}
        if "x" in channel.attrs:
            about["position"] = float(channel.attrs["x"])
        series.append(
            {
                "name": str(name),
                "data": channel.to_numpy(),
                "unit_str": str(channel.attrs.get("units", "")),
                "start_timestamp": float(time[0]),
            }
            | axis
            | about
        )
    return series


def placed(data: xr.Dataset, quantity: str, lamina: str, places: FloatArray) -> xr.Dataset:
    """Return the record of a measurement whose channels of one quantity have places on a plate.

    Args:
        data: a measurement.
        quantity: quantity of the channels.
        lamina: lamina on which they are.
        places: x and z of each of these channels, in the order of the file, shape (n, 2) [m].

    Raises:
        CaseError: there are more or fewer places than channels.
    """
    channels = record(data)
    chosen = [
        name
        for name, channel in channels.data_vars.items()
        if channel.attrs["quantity"] == quantity and channel.attrs.get("lamina", lamina) == lamina
    ]
    if len(chosen) != len(places):
        raise CaseError(
            f"positions: expected x and z of each of the {len(chosen)} channels of {quantity}, "
            f"given {len(places)}"
        )
    for name, (x, z) in zip(chosen, places.tolist(), strict=True):
        channels[name].attrs |= {"x": x, "z": z, "lamina": lamina}
    return channels


def scan(data: xr.Dataset, quantity: str, lamina: str | None = None) -> xr.DataArray:
    """Return the histories of one quantity at points along a lamina as one field.

    Args:
        data: a measurement whose channels have positions, or a record of it.
        quantity: "displacement", "velocity", "acceleration" or "strain".
        lamina: lamina on which the points are; None: points of all laminae.

    Returns:
        The field, dimensions (time, point), with the coordinates `position` [m], `across` (of
        plates, otherwise NaN) [m], `lamina` and `channel` of the points, by increasing position.

    Raises:
        CaseError: no channel of that quantity has a position there.
    """
    points = [
        channel
        for channel in (record(data) if "channel" in data.coords else data).data_vars.values()
        if channel.attrs["quantity"] == quantity
        and "x" in channel.attrs
        and lamina in (None, channel.attrs.get("lamina", ""))
    ]
    if not points:
        raise CaseError(
            f"measurement: expected channels of {quantity} with a position"
            + (f" on the lamina {lamina!r}" if lamina is not None else "")
            + ", found none; --channel NAME=SOURCE:UNIT@POSITION/LAMINA gives one"
        )
    points.sort(key=lambda channel: float(channel.attrs["x"]))
    about = {"units": "m"}
    return xr.DataArray(
        np.array([channel.to_numpy() for channel in points]).T,
        dims=("time", "point"),
        coords={
            "time": data["time"],
            "position": ("point", [channel.attrs["x"] for channel in points], about),
            "across": ("point", [channel.attrs.get("z", np.nan) for channel in points], about),
            "lamina": ("point", [channel.attrs.get("lamina", "") for channel in points]),
            "channel": ("point", [channel.attrs["name"] for channel in points]),
        },
        name=quantity,
        attrs={"units": points[0].attrs["units"], "long_name": quantity},
    )


def history_of(data: xr.Dataset, channel: int) -> Values:
    """Return the values of a channel by its number in the table, in SI.

    Returns:
        Values, shape (n,); a frequency response is complex.
    """
    table = data.variables  # a DataArray of each would gather all coordinates: n² for n channels
    variable = table[str(table["channel_variable"].values[channel])]
    name = str(table["channel"].values[channel])
    labels = {"lamina": str(table["channel_lamina"].values[channel])}
    labels |= {"interface": name, "output": name}
    here = {
        dim: table[dim].values.tolist().index(labels[str(dim)])
        for dim in variable.dims
        if dim in labels
    }
    return np.asarray(variable.isel(here).values)


HEADING = ("channel", "in measured.nc", "quantity", "smallest", "largest")
"""Heading of the table of `rows`."""


def rows(data: xr.Dataset) -> Iterator[tuple[str, ...]]:
    """Yield a table row for each channel; of complex responses the amplitudes are shown."""
    columns = (
        data[f"channel_{key}"].to_numpy() for key in ("position", "variable", "quantity", "units")
    )
    channels = zip(data["channel"].to_numpy(), *columns, strict=True)
    for k, (name, position, variable, quantity, units) in enumerate(channels):
        history = history_of(data, k)
        values = np.abs(history) if np.iscomplexobj(history) else history
        place = f" at {float(position):g} m" if np.isfinite(position) else ""
        yield (
            f"{name}{place}",
            str(variable),
            f"{quantity or 'value'} [{units}]",
            f"{values.min():.4g}",
            f"{values.max():.4g}",
        )


def lines(data: xr.Dataset) -> Iterator[str]:
    """Yield lines of text on all channels: rate, duration, ranges, and what was put right."""
    if "time" in data:
        time: FloatArray = data["time"].to_numpy()
        span = float(time[-1] - time[0])
        rate = 1.0 / float(np.median(np.diff(time)))
        yield f"time: {time.size} samples, {rate:.6g} per second, {span:.6g} s from {time[0]:.6g} s"
    for name, unit in (("frequency", "Hz"), ("x", "m")):
        if name in data.coords:
            points: FloatArray = data[name].to_numpy()
            yield f"{name}: {points.size} values, {points[0]:.6g} to {points[-1]:.6g} {unit}"
    yield from (f"note: {note}" for note in data.attrs.get("notes", "").splitlines() if note)
