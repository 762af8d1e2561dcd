"""Read measurements from NetCDF: a measurement of this package, the result of a run, any other."""

from __future__ import annotations

from pathlib import Path

import xarray as xr

from delam_fem.case.toml import CaseError
from delam_fem.results.measured.columns import Column, Sheet, axis_of, matrix_columns


def load(path: Path) -> xr.Dataset:
    """Return the dataset of a file as it is.

    Raises:
        CaseError: the file is no NetCDF, or damaged.
    """
    with path.open("rb") as file:
        engine = "scipy" if file.read(3) == b"CDF" else "h5netcdf"
    try:
        return xr.load_dataset(path, engine=engine, decode_times=False)
    except Exception as error:  # HDF5, h5netcdf and xarray raise whatever they please
        reason = str(error).partition("\n")[0][:80]
        raise CaseError(f"{path}: damaged, or no NetCDF file ({reason})") from None


def sheets(data: xr.Dataset, path: Path) -> list[Sheet]:
    """Return the variables over an axis (time, frequency, x) as columns.

    Args:
        data: of the file.
        path: of the file, for messages.

    Raises:
        CaseError: no variable is over such an axis.
    """
    found = []
    for dim in map(str, data.dims):
        axis = data[dim] if dim in data.variables else None
        kind = axis_of(dim.rpartition("_")[2], None)
        if axis is None or not kind or axis.size < 2:
            continue
        columns = [Column(kind, axis.to_numpy(), axis.attrs.get("units"))]
        for name in map(str, data.data_vars):
            columns += _columns(data[name], dim)
        if len(columns) > 1:
            found.append(Sheet(f"{path}", tuple(columns)))
    if "gap0" in data and "x" in data["gap0"].coords and "x" not in data.dims:
        x = data["x"]
        column = Column("x", x.to_numpy(), x.attrs.get("units"))
        found.append(Sheet(f"{path}", (column, *_columns(data["gap0"], str(x.dims[0])))))
    if not found:
        raise CaseError(
            f"{path}: expected variables over a dimension time, frequency or x with its "
            "coordinate, found none"
        )
    return found


def _columns(variable: xr.DataArray, dim: str) -> list[Column]:
    """Return the columns of a variable over a dimension, one for each place in the others."""
    others = [d for d in variable.dims if d != dim]
    if dim not in variable.dims or len(others) > 1 or variable.dtype.kind not in "fiuc":
        return []
    name, unit = str(variable.name), variable.attrs.get("units")
    if not others:
        return [Column(name, variable.to_numpy(), unit)]
    rows = variable.transpose(others[0], dim)
    labels = (
        [f"{name} {label}" for label in rows[others[0]].to_numpy()]
        if others[0] in rows.coords
        else None
    )
    return [
        Column(column.name, column.values, unit)
        for column in matrix_columns(name, rows.to_numpy(), labels)
    ]
