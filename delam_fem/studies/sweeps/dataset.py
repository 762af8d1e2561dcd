"""Write the result of a sweep from its journal to one dataset, and open it again.

The dataset is a NetCDF file that xarray can plot directly. It is written slab by slab, so that the
memory does not grow with the number of points. However the points were computed, the same points
give the same bytes.
"""

from __future__ import annotations

import json
import logging
import math
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import h5netcdf
import h5py
import numpy as np
import numpy.typing as npt

from delam_fem.api import (
    CHANNEL_MEASURES,
    SENSOR,
    Case,
    CaseError,
    IntArray,
    Layout,
    atomic_file,
    discard,
    occasion,
    origin,
    require_same,
    save_case,
    write_json,
    write_text,
)
from delam_fem.studies.signals.scan import ORDERS, positions_of
from delam_fem.studies.sweeps.grid import DIRECTIONS, Sweep, SweepFile
from delam_fem.studies.sweeps.journal import (
    OUTCOMES,
    Journal,
    MergedParts,
    PointRange,
    remove_journal,
)
from delam_fem.studies.sweeps.point import (
    SERIES,
    VARIABLES,
    PointRunner,
    Quantity,
    channel_units,
    quantities,
    scanned,
)
from delam_fem.studies.sweeps.schedule import owners

if TYPE_CHECKING:
    import xarray as xr

OCCASION = "sweep.json"
"""Name of the file that says where and how long a sweep was computed.

It is not in the dataset, so that equal sweeps have equal datasets.
"""
COUNTED = ("points", "completed", "diverged", "failed", "missing")
"""What the attributes `n_…` count: all points, and those with each outcome."""

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
    from delam_fem.api import open_dataset, require_alone

    try:
        require_alone(path)
    except OSError:
        raise _damaged(path) from None
    try:
        data = open_dataset(path)
        try:
            _require_sweep(data)
            data.attrs |= _occasion(path.with_name(OCCASION))
            return data.load() if is_loaded else data
        except BaseException:
            data.close()
            raise
    except Exception as error:  # HDF5, h5netcdf and xarray raise whatever they please
        _log.debug("%s cannot be read", path, exc_info=True)
        raise _damaged(path) from error


def _damaged(path: Path) -> CaseError:
    """Return the error for a file that is not the result of a sweep."""
    return CaseError(
        f"{path}: expected the result of a sweep, as delam-fem sweep writes it; this file is "
        "damaged or another one"
    )


def _occasion(path: Path) -> dict[str, str | int | float]:
    """Return how a result was computed; empty where no readable file says it."""
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return content if isinstance(content, dict) else {}


def _require_sweep(data: xr.Dataset) -> None:
    """Raise any error unless a dataset has what every result of a sweep has."""
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
        == sum(int(data.attrs[f"n_{what}"]) for what in COUNTED[1:])
    )
    assert isinstance(data.attrs["outcome"], str)
    keys = (*CHANNEL_MEASURES, *SERIES)
    of_channels = {f"{name}_{key}" for name in file.record.channels for key in keys}
    for name in data.data_vars:
        kind = data[name].dtype.kind
        is_known = str(name) in {*VARIABLES, *of_channels} or str(name).startswith(SENSOR)
        assert is_known and kind in ("OUT" if name in ("outcome", "error") else "f")
        assert data[name].dims[: data["outcome"].ndim] == data["outcome"].dims


SLAB_NUMBERS = 1_000_000
"""Largest number of values in memory at a time (8 MB)."""
_TEXT = h5py.string_dtype()
_WORDS = np.array(OUTCOMES, dtype=object)


def _coordinates(
    file: h5netcdf.File, sweep: Sweep, wanted: tuple[Quantity, ...], layout: Layout
) -> None:
    """Write the dimensions and coordinates of a sweep."""
    sizes = dict(sweep.sizes)
    for quantity in wanted:
        sizes |= dict(zip(quantity.dims, quantity.shape, strict=True))
    file.dimensions = sizes
    for axis in sweep.dimensions:
        labels = {"long_name": axis.long_name, "key": axis.key}
        units = "" if isinstance(axis.values[0], str) else axis.units
        _variable(file, axis.name, (axis.along,), units, labels, axis.values)
    scan = sweep.file.record.scan
    known: dict[str, npt.ArrayLike] = {
        "direction": DIRECTIONS,
        "lamina": [lamina.name for lamina in sweep.base.lamina],
        "strobe": np.arange(1 - sizes.get("strobe", 0), 1),
        "harmonic": np.arange(1, sizes.get("harmonic", 0) + 1),
        "x": layout.x,
        "order": ORDERS,
    }
    if scan is not None:
        known["scan_x"], z = positions_of(scanned(scan, layout, sweep.base))
        if z is not None:
            known["scan_z"] = z
    for name, values in known.items():
        row = VARIABLES[name]
        if row.dims[0] in sizes:
            _variable(file, name, row.dims, row.units, {"long_name": row.long_name}, values)


def _variable(
    file: h5netcdf.File,
    name: str,
    dims: tuple[str, ...],
    units: str,
    labels: Mapping[str, str],
    values: npt.ArrayLike | None = None,
) -> None:
    """Make a variable with values, or an empty one of texts (without a unit) or of numbers."""
    column = np.empty(0, dtype=np.float64 if units else "U1") if values is None else values
    array = np.asarray(column)
    is_text = array.dtype.kind == "U"
    checked = None if is_text else True  # HDF5 checks the sums of numbers when they are read
    made = file.create_variable(name, dims, _TEXT if is_text else array.dtype, fletcher32=checked)
    made.attrs.update({"units": units, **labels} if units else labels)
    if values is not None:
        made[...] = array.astype(object) if is_text else array


def _fill(
    file: h5netcdf.File,
    slab: slice,
    block: PointRange,
    wanted: tuple[Quantity, ...],
    lead: tuple[int, ...],
) -> None:
    """Write the points of a slab of the grid, which has the shape `lead`."""
    n = math.prod(lead)
    column = 0
    rows = np.full((n, block.rows.shape[1]), np.nan)
    outcome = np.full(n, "", dtype=object)
    error = np.full(n, "", dtype=object)
    first = slab.start * math.prod(lead[1:])
    at = block.numbers - first
    rows[at] = block.rows
    outcome[at] = _WORDS[block.outcomes]
    for index, text in block.errors.items():
        error[index - first] = text
    for quantity in wanted:
        values = rows[:, column : column + quantity.size]
        file[quantity.name][slab] = values.reshape(*lead, *quantity.shape)
        column += quantity.size
    file["outcome"][slab] = outcome.reshape(lead)
    file["error"][slab] = error.reshape(lead)


RESULT, JOURNAL = "sweep.nc", "sweep.journal"
"""Names of the dataset and the journal in the folder of a sweep."""
_SHOWN = 5
"""Number of shards that a message names."""


def merge_sweep(sweep: Sweep, directory: str | Path, *, is_partial: bool = False) -> xr.Dataset:
    """Join the journals of all shards of a sweep to its result.

    The journal is removed when the result has all points. Part files of shards that were computed
    elsewhere may be copied into the folder `sweep.journal` before.

    Args:
        sweep: the sweep.
        directory: its folder.
        is_partial: whether to write the result although points are missing; they are NaN.

    Returns:
        The dataset, opened lazily; the same as that of `run_sweep`.

    Raises:
        CaseError: there is no journal; it belongs to another sweep; another process computes the
            sweep; or points are missing and `is_partial` is False.
        OSError: a file cannot be read or written.
    """
    directory = Path(directory)
    if is_complete(directory, sweep):
        return open_result(directory / RESULT)
    path = directory / JOURNAL
    if not path.exists():
        raise CaseError(
            f"merge: {directory} has no journal of a sweep; delam-fem sweep FILE --shard K/N "
            f"-o {directory} computes a shard"
        )
    layout = PointRunner(sweep).structure(sweep.case(0)).layout
    with Journal(path, sweep.identity, resume=True) as journal, journal.merged() as merged:
        n_missing = sweep.n_points - merged.numbers.size
        if n_missing and not is_partial:
            raise CaseError(
                f"merge: {n_missing} points are missing{_by_shard(sweep, merged)}; --shard K/N "
                "--resume goes on with a shard, --resume alone computes all that is missing, and "
                "--partial writes what is there"
            )
        if merged.n_disagreeing:
            _log.warning(
                "%d points were computed twice with different results, on different machines or "
                "versions; the first is kept",
                merged.n_disagreeing,
            )
        save_sweep(sweep, directory)
        about = {"n_shards": len(merged.shards), "busy_seconds": merged.seconds}
        write_result(sweep, directory, merged, layout, about)
    if not n_missing:
        remove_journal(path)
    return open_result(directory / RESULT)


def _by_shard(sweep: Sweep, merged: MergedParts) -> str:
    """Return in words how many points of which shards are missing; "" if nobody knows."""
    numbers_of_shards = {shard.of for shard in merged.shards} - {1}
    if len(numbers_of_shards) != 1:
        return ""
    (of,) = numbers_of_shards
    is_left = np.ones(sweep.n_points, dtype=np.bool_)
    is_left[merged.numbers] = False
    items: IntArray = np.flatnonzero(is_left)
    if sweep.tracks:
        track: IntArray = np.empty(sweep.n_points, dtype=np.int64)
        for number, points in enumerate(sweep.tracks):
            track[points] = number
        items = track[items]
    counts = np.bincount(owners(items, of))
    shards = sorted(np.flatnonzero(counts).tolist(), key=lambda k: -counts[k])
    named = [f"{counts[k]} of shard {k}/{of}" for k in shards[:_SHOWN]]
    if len(shards) > _SHOWN:
        named.append(f"the others of {len(shards) - _SHOWN} more shards")
    return f": {', '.join(named)}"


def save_sweep(sweep: Sweep, directory: Path) -> None:
    """Write the files from which a sweep can be repeated."""
    save_case(sweep.base, directory)
    write_text(directory / "sweep.toml", sweep.to_toml("case.toml"))


def write_result(
    sweep: Sweep,
    directory: Path,
    merged: MergedParts,
    layout: Layout,
    about: Mapping[str, str | int | float],
) -> None:
    """Write the dataset of a sweep, and how it was computed.

    An existing dataset is replaced when the new one is complete.

    Args:
        sweep: the sweep.
        directory: its folder.
        merged: the finished points; those that are missing are NaN.
        layout: layout of the first point.
        about: how the points were computed; it does not go into the dataset.

    Raises:
        OSError: a file cannot be written.
    """
    hosts, processors = zip(*sorted(merged.machines), strict=True) if merged.machines else ((), ())
    machines = {"hosts": ", ".join(hosts), "processors": ", ".join(sorted(set(processors)))}
    write_json(directory / OCCASION, {**occasion(), **machines, **about})
    grid = tuple(sweep.sizes)
    wanted = quantities(sweep.file.record, layout, channel_units(sweep, layout), sweep.base)
    outer, *inner = sweep.sizes.values()
    per_index = math.prod(inner)
    size = sum(quantity.size for quantity in wanted)
    step = max(1, SLAB_NUMBERS // (per_index * max(size, 1)))
    n_missing = sweep.n_points - merged.numbers.size
    with atomic_file(directory / RESULT) as temporary, h5netcdf.File(temporary, "w") as file:
        _coordinates(file, sweep, wanted, layout)
        # NetCDF needs a list of the coordinates without a dimension of the same name
        off_dimension = [name for name in file.variables if name not in file.dimensions]
        for row in (*wanted, VARIABLES["outcome"], VARIABLES["error"]):
            _variable(file, row.name, (*grid, *row.dims), row.units, {"long_name": row.long_name})
        for start in range(0, outer, step):
            stop = min(start + step, outer)
            block = merged.block(start * per_index, stop * per_index, size)
            _fill(file, slice(start, stop), block, wanted, (stop - start, *inner))
        file.attrs.update(
            title=f"sweep {sweep.file.name}",
            coordinates=" ".join(off_dimension),
            sweep=sweep.to_toml("case.toml"),
            case=sweep.base.to_toml(),
            identity=merged.identity,
            **origin(),
            n_points=sweep.n_points,
            **{f"n_{outcome}": count for outcome, count in merged.counts().items()},
            n_missing=n_missing,
            engine=sweep.file.engine,
            outcome="interrupted" if n_missing else "completed",
        )


def is_complete(directory: Path, sweep: Sweep) -> bool:
    """Return whether a folder already has the complete result of a sweep.

    Raises:
        CaseError: the folder has the result of another sweep.
    """
    path = directory / RESULT
    if not path.is_file():
        return False
    with open_result(path) as data:
        about = dict(data.attrs)
    if about["outcome"] != "completed":
        return False
    require_same(str(about.get("identity")), sweep.identity, path)
    remove_journal(directory / JOURNAL)  # a process may have been killed before it did
    return True


def remove_results(directory: Path) -> None:
    """Remove the result and the journal of a sweep, so that it is computed from the beginning."""
    remove_journal(directory / JOURNAL)
    for name in (RESULT, OCCASION):
        discard(directory / name)
