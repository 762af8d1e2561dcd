"""Read files of measurements of any known format into one dataset; write and read it as NetCDF."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import xarray as xr

from delam_fem.case.toml import CaseError
from delam_fem.numerics.arrays import FloatArray
from delam_fem.results.folder import write_dataset
from delam_fem.results.measured import matlab, netcdf, text, universal
from delam_fem.results.measured.assembly import SCHEMA, dataset
from delam_fem.results.measured.channels import Assignment, channels_of
from delam_fem.results.measured.columns import Sheet, Values
from delam_fem.results.measured.responses import joined

MEASURED = "measured.nc"
"""Name of the file of a measurement."""
READERS: dict[str, Callable[[Path], list[Sheet]]] = {
    ".csv": text.read,
    ".txt": text.read,
    ".dat": text.read,
    ".tsv": text.read,
    ".asc": text.read,
    ".mat": matlab.read,
    ".uff": universal.read,
    ".unv": universal.read,
    ".uf": universal.read,
    ".58b": universal.read,
    ".nc": lambda path: netcdf.sheets(netcdf.load(path), path),
    ".nc4": lambda path: netcdf.sheets(netcdf.load(path), path),
    ".cdf": lambda path: netcdf.sheets(netcdf.load(path), path),
}
"""Readers by the suffix of the file."""


def read_measured(
    *paths: str | Path,
    channels: Mapping[str, str] | None = None,
    units: str | None = None,
    rate: float | None = None,
) -> xr.Dataset:
    """Read measurements into one dataset in SI.

    Args:
        paths: CSV (.csv, .txt, .dat, .tsv), universal (.uff, .unv), MATLAB (.mat) or NetCDF (.nc)
            files, also the result.nc of a run.
        channels: what columns are, as `{"tip thick": "col2:mm", "mid": "Laser 3:mm/s@0.2/upper"}`:
            source, then after a colon the unit, after an @ the position [m] and the lamina.
            `tip LAMINA`, `base`, `force` and `gap` have their own variables; others are sensors.
        units: of columns that name none; "SI" for the SI unit of what the file says they measure.
        rate: samples per second of files without times.

    Returns:
        A dataset as `assembly` describes.

    Raises:
        CaseError: a file cannot be read, or what it holds is not clear.
    """
    if not paths:
        raise CaseError("expected at least one file of measurements, given none")
    if rate is not None and not 0.0 < rate < np.inf:
        raise CaseError(f"--rate: expected a positive number of samples per second, given {rate:g}")
    files = [Path(path) for path in paths]
    if (
        len(files) == 1
        and not channels
        and files[0].suffix in (".nc", ".nc4")
        and files[0].is_file()
    ):
        data = netcdf.load(files[0])
        if data.attrs.get("schema") == SCHEMA:
            return _with_complex(data)
    sheets = [sheet for path in files for sheet in sheets_of(path)]
    assigned = {
        name: Assignment.parsed(text, f"--channel {name}")
        for name, text in (channels or {}).items()
    }
    notes = [f"{sheet.label}: {note}" for sheet in sheets for note in sheet.notes]
    return dataset(joined(channels_of(sheets, assigned, units, rate)), notes)


def sheets_of(path: Path) -> list[Sheet]:
    """Return the columns of a file.

    Raises:
        CaseError: there is no such file, it is of no known format, or it is damaged.
    """
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


def write_measured(data: xr.Dataset, path: Path) -> Path:
    """Write a measurement as NetCDF; complex responses become two variables.

    Raises:
        OSError: the file cannot be written.
    """
    plain = data
    if "response" in data and np.iscomplexobj(data["response"]):
        parts = {"real": data["response"].real, "imag": data["response"].imag}
        plain = data.drop_vars("response").assign(
            {
                f"response_{part}": own.assign_attrs(data["response"].attrs)
                for part, own in parts.items()
            }
        )
    return write_dataset(plain, path)


def _with_complex(data: xr.Dataset) -> xr.Dataset:
    """Return a dataset whose responses are complex again."""
    if "response_real" not in data:
        return data
    whole = data["response_real"] + 1j * data["response_imag"]
    rest = data.drop_vars(["response_real", "response_imag"])
    return rest.assign(response=whole.assign_attrs(data["response_real"].attrs))


def scan(data: xr.Dataset, quantity: str, lamina: str | None = None) -> xr.DataArray:
    """Return the histories of one quantity at points along a lamina as one field.

    Args:
        data: a measurement whose channels have positions.
        quantity: "displacement", "velocity", "acceleration" or "strain".
        lamina: on which the points are; None: all points, whatever their lamina.

    Returns:
        The field, dimensions (time, point), with the coordinates `position` [m], `lamina` and
        `channel` of the points, by increasing position.

    Raises:
        CaseError: no channel of that quantity has a position there.
    """
    position: FloatArray = data["channel_position"].to_numpy()
    is_wanted = (data["channel_quantity"].to_numpy() == quantity) & np.isfinite(position)
    if lamina is not None:
        is_wanted &= data["channel_lamina"].to_numpy() == lamina
    variables = data["channel_variable"].to_numpy()
    rows = [int(k) for k in np.flatnonzero(is_wanted) if "time" in data[variables[k]].dims]
    if not rows:
        raise CaseError(
            f"measurement: expected channels of {quantity} with a position"
            + (f" on the lamina {lamina!r}" if lamina is not None else "")
            + ", found none; --channel NAME=SOURCE:UNIT@POSITION/LAMINA gives one"
        )
    rows.sort(key=lambda k: float(position[k]))
    about = {"units": str(data["channel_units"][rows[0]].item()), "long_name": quantity}
    return xr.DataArray(
        np.array([history_of(data, k) for k in rows]).T,
        dims=("time", "point"),
        coords={
            "time": data["time"],
            "position": ("point", position[rows], {"units": "m"}),
            "lamina": ("point", data["channel_lamina"].to_numpy()[rows]),
            "channel": ("point", data["channel"].to_numpy()[rows]),
        },
        name=quantity,
        attrs=about,
    )


def history_of(data: xr.Dataset, channel: int) -> Values:
    """Return the values of a channel by its number in the table, in SI.

    Returns:
        Values, shape (n,); a frequency response is complex.
    """
    own = data[str(data["channel_variable"][channel].item())]
    labels = {
        "lamina": str(data["channel_lamina"][channel].item()),
        "interface": str(data["channel"][channel].item()),
        "output": str(data["channel"][channel].item()),
    }
    values: Values = own.sel(
        {dim: labels[str(dim)] for dim in own.dims if dim in labels}
    ).to_numpy()
    return values
