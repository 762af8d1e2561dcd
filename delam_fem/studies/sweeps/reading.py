"""Open the result of a sweep, and refuse a file that is damaged or something else."""

from __future__ import annotations

import json
import logging
import tomllib
from pathlib import Path
from typing import TYPE_CHECKING

from delam_fem.case.toml import CaseError

if TYPE_CHECKING:
    import xarray as xr

OCCASION = "sweep.json"
"""Name of the file that says where and how long a sweep was computed.

It is not in the dataset, so that equal sweeps have equal datasets.
"""
_COUNTED = ("points", "completed", "diverged", "failed", "missing")

_log = logging.getLogger(__name__)


def open_result(path: Path, *, is_loaded: bool = False) -> xr.Dataset:
    """Open the dataset of a sweep.

    Args:
        path: the file.
        is_loaded: whether to read all values at once; otherwise they are read when they are used.

    Returns:
        The dataset; the caller closes it. Its attributes include those in `OCCASION` beside it.

    Raises:
        CaseError: the file is damaged, or not the result of a sweep.
    """
    import xarray as xr

    try:
        data = xr.open_dataset(path, engine="h5netcdf")
        try:
            _require_sweep(data)
            data.attrs |= _occasion(path.with_name(OCCASION))
            return data.load() if is_loaded else data
        except BaseException:
            data.close()
            raise
    except Exception as error:  # HDF5, h5netcdf and xarray raise whatever they please
        _log.debug("%s cannot be read", path, exc_info=True)
        raise CaseError(
            f"{path}: expected the result of a sweep, as delam-fem sweep writes it; this file is "
            "damaged or another one"
        ) from error


def _occasion(path: Path) -> dict[str, str | int | float]:
    """Return how a result was computed; empty where nothing says it."""
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return found if isinstance(found, dict) else {}


def _require_sweep(data: xr.Dataset) -> None:
    """Raise an error unless a dataset has what every result of a sweep has."""
    from delam_fem.case.definition import Case
    from delam_fem.results.schema import SENSOR
    from delam_fem.studies.sweeps.file import SweepFile
    from delam_fem.studies.sweeps.quantities import VARIABLES

    Case.from_toml(data.attrs["case"])
    file = SweepFile.model_validate(tomllib.loads(data.attrs["sweep"]))
    n_points = 1
    for name in data["outcome"].dims:
        if name != "direction" and file.combine == "product":
            assert data[name].dims == (name,) and data[name].attrs["key"]
        n_points *= data.sizes[name]
    assert (
        n_points
        == int(data.attrs["n_points"])
        == sum(int(data.attrs[f"n_{what}"]) for what in _COUNTED[1:])
    )
    assert isinstance(data.attrs["outcome"], str)
    for name in data.data_vars:
        kind = data[name].dtype.kind
        is_known = str(name) in VARIABLES or str(name).startswith(SENSOR)
        assert is_known and kind in ("OUT" if name in ("outcome", "error") else "f")
        assert data[name].dims[: data["outcome"].ndim] == data["outcome"].dims
