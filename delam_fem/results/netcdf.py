"""Write datasets as NetCDF with a digest of their content, and read NetCDF files of anybody.

The digest is an attribute of the file. A file that was changed after it was written does not match
it, whatever changed: a number, a text, an attribute, a name. Files of other programs have none.
"""

from __future__ import annotations

import hashlib
import logging
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import h5netcdf
import numpy as np
import xarray as xr

from delam_fem.system.errors import CaseError, reason_of
from delam_fem.system.files import atomic_file
from delam_fem.system.footprint import bounded
from delam_fem.system.hdf5 import opened

DIGEST = "digest"
"""Attribute with the digest of all other content."""
_log = logging.getLogger(__name__)


def write_dataset(data: xr.Dataset | Mapping[str, xr.Dataset], path: Path) -> Path:
    """Write a dataset as NetCDF-4, or several as the groups of one file, with their digests."""
    groups = {"/": data} if isinstance(data, xr.Dataset) else data
    with atomic_file(path) as temporary:
        file = h5netcdf.File(temporary, "w")
        for name, group in groups.items():
            store: Any = xr.backends.H5NetCDFStore(file, group=name)  # type: ignore[no-untyped-call]
            group.assign_attrs({DIGEST: digest_of(group)}).dump_to_store(store)
        file.close()
    return path


def digest_of(data: xr.Dataset) -> str:
    """Return a digest of names, dimensions, types, values and attributes of a dataset.

    It is the same for a dataset and for what is read back from its file.

    Raises:
        UnicodeEncodeError: a text is none.
    """
    result = hashlib.sha256()
    for name, variable in sorted(data.variables.items(), key=lambda item: str(item[0])):
        result.update(f"{name!r} {variable.dims!r}\n".encode())
        _update(result, variable.values)
        _update_by_attributes(result, variable.attrs)
    _update_by_attributes(result, {k: v for k, v in data.attrs.items() if k != DIGEST})
    return result.hexdigest()


def _update_by_attributes(result: Any, attributes: Mapping[Any, Any]) -> None:
    """Add attributes to a digest."""
    for name, value in sorted(attributes.items(), key=lambda item: str(item[0])):
        result.update(f"{name!r}\n".encode())
        _update(result, np.ravel(value))


def _update(result: Any, values: Any) -> None:
    """Add an array of numbers or texts to a digest."""
    if values.dtype.kind in "fiubc":
        result.update(f"{values.dtype.newbyteorder('=').str} {values.shape}\n".encode())
        result.update(np.ascontiguousarray(values, dtype=values.dtype.newbyteorder("=")))
    else:
        result.update(f"text {values.shape}\n".encode())
        result.update(repr([str(text) for text in values.ravel()]).encode())


def read_dataset(path: Path, *, is_ours: bool = False) -> xr.Dataset:
    """Return the dataset of a NetCDF file in memory.

    Args:
        path: the file.
        is_ours: whether the package writes such files: then one without a digest is told.

    Raises:
        CaseError: the file is no NetCDF, is damaged, was changed after it was written, names other
            files, or is too large; see `require_room`.
    """
    try:
        with bounded(path), warnings.catch_warnings():
            warnings.simplefilter("ignore")  # what is wrong is in the error
            with path.open("rb") as file:
                is_classic = file.read(3) == b"CDF"
            data = _classic(path) if is_classic else _in_memory(path)
            stated = data.attrs.pop(DIGEST, None)
            present = digest_of(data)
    except CaseError:
        raise
    except FileNotFoundError:
        raise CaseError(f"{path}: there is no such file") from None
    except Exception as error:  # HDF5, h5netcdf and xarray raise whatever they please
        raise CaseError(
            f"{path}: damaged, or no NetCDF file ({reason_of(error, path)}); store it anew, or as "
            "CSV"
        ) from None
    if stated is None and is_ours:
        _log.warning("%s has no digest, by which damage would be seen", path)
    elif stated is not None and stated != present:
        raise CaseError(
            f"{path}: was changed after it was written, or is damaged: its content does not match "
            "its digest; copy it again from where it came, or compute it again"
        )
    return data


class _Reading(h5netcdf.File):  # type: ignore[misc]
    """A file that is read. One that could not be opened has nothing to close."""

    def __del__(self) -> None:
        """Leave the file to the one that has opened it."""


def open_dataset(path: Path) -> xr.Dataset:
    """Open the dataset of a file of HDF5, without any interpretation of times.

    Values are read when they are used; the caller closes the dataset.

    Raises:
        Exception: any, if the file is damaged; a CaseError if it names other files.
    """
    file = opened(path)
    try:
        reading = _Reading(file, "r", decode_vlen_strings=True)
        store: Any = xr.backends.H5NetCDFStore(reading)  # type: ignore[no-untyped-call]
        data = xr.open_dataset(store, decode_times=False)
        data.set_close(file.close)
    except BaseException:
        file.close()
        raise
    return data


def _in_memory(path: Path) -> xr.Dataset:
    """Return all values of a file of HDF5."""
    with open_dataset(path) as data:
        return data.load()


def _classic(path: Path) -> xr.Dataset:
    """Return the dataset of a file of NetCDF-3."""
    return xr.load_dataset(path, engine="scipy", decode_times=False)
