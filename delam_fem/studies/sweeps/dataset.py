"""Write the points of a sweep's journal to one NetCDF file that xarray can plot directly.

The file is written slab by slab, so that the memory does not grow with the number of points.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from pathlib import Path

import h5netcdf
import h5py
import numpy as np
import numpy.typing as npt

from delam_fem.case.atomic import atomic_file
from delam_fem.numerics.arrays import FloatArray
from delam_fem.results.provenance import origin
from delam_fem.results.scan import scan_positions
from delam_fem.results.schema import Variable
from delam_fem.studies.detection.shapes import ORDERS
from delam_fem.studies.sweeps.grid import DIRECTIONS, Dimension, Sweep
from delam_fem.studies.sweeps.joined import OUTCOMES, Block, Joined
from delam_fem.studies.sweeps.quantities import VARIABLES, Quantity

SLAB_NUMBERS = 1_000_000
"""Largest number of values in memory at a time (8 MB)."""
_TEXT = h5py.string_dtype()
_WORDS = np.array(OUTCOMES, dtype=object)


def write(
    path: Path,
    sweep: Sweep,
    joined: Joined,
    wanted: tuple[Quantity, ...],
    *,
    x: FloatArray,
    attributes: Mapping[str, str | int | float],
) -> None:
    """Write the dataset of a sweep; an existing file is replaced when the new one is complete.

    Args:
        path: of the NetCDF file.
        sweep: gives the grid.
        joined: gives the points; those that are missing are NaN.
        wanted: layout of the rows.
        x: positions of the nodes of the first point, shape (n_nodes,) [m].
        attributes: of the dataset beside sweep, case and origin.

    Raises:
        OSError: the file cannot be written.
    """
    with atomic_file(path) as temporary, h5netcdf.File(temporary, "w") as file:
        sizes = _dimensions(file, sweep, wanted, x)
        grid = tuple(sweep.sizes)
        for quantity in wanted:
            _known_variable(file, quantity.variable, np.float64, grid)
        _known_variable(file, "outcome", _TEXT, grid)
        _known_variable(file, "error", _TEXT, grid)
        for slab, block in _slabs(sweep, joined, wanted):
            _fill(file, slab, block, wanted, tuple(sizes[d] for d in grid))
        file.attrs.update(
            title=f"sweep {sweep.file.name}",
            coordinates=" ".join(_off_dimension(sweep, sizes)),
            sweep=sweep.to_toml("case.toml"),
            case=sweep.base.to_toml(),
            **origin(),
            **attributes,
        )


def _dimensions(
    file: h5netcdf.File, sweep: Sweep, wanted: tuple[Quantity, ...], x: FloatArray
) -> dict[str, int]:
    """Write dimensions and coordinates; return the size of each dimension by name."""
    sizes = dict(sweep.sizes)
    for quantity in wanted:
        sizes |= dict(zip(quantity.dims, quantity.shape, strict=True))
    file.dimensions = sizes
    for dimension in sweep.dimensions:
        _axis(file, dimension)
    if "direction" in sizes:
        _known_variable(file, "direction", _TEXT)
        file["direction"][:] = np.array(DIRECTIONS, dtype=object)
    if "lamina" in sizes:
        _known_variable(file, "lamina", _TEXT)
        file["lamina"][:] = np.array([lamina.name for lamina in sweep.base.lamina], dtype=object)
    if "strobe" in sizes:
        _known_variable(file, "strobe", np.int64)
        file["strobe"][:] = np.arange(1 - sizes["strobe"], 1)
    if "harmonic" in sizes:
        _known_variable(file, "harmonic", np.int64)
        file["harmonic"][:] = np.arange(1, sizes["harmonic"] + 1)
    if "node" in sizes:
        _known_variable(file, "x", np.float64)
        file["x"][:] = x
    if "scan_point" in sizes:
        scan = next(quantity.scan for quantity in wanted if quantity.scan is not None)
        _known_variable(file, "order", np.float64)
        file["order"][:] = ORDERS
        _known_variable(file, "scan_x", np.float64)
        file["scan_x"][:] = scan_positions(float(x[-1]), scan.spacing, scan.first)
    return sizes


def _off_dimension(sweep: Sweep, sizes: Mapping[str, int]) -> Iterator[str]:
    """Yield the coordinates without a dimension of the same name; NetCDF needs a list of them."""
    yield from (d.name for d in sweep.dimensions if d.name != d.along)
    if "node" in sizes:
        yield "x"
    if "scan_point" in sizes:
        yield "scan_x"


def _axis(file: h5netcdf.File, axis: Dimension) -> None:
    """Write the coordinate of an axis."""
    is_text = isinstance(axis.values[0], str)
    labels = {"long_name": axis.long_name, "key": axis.key}
    if not is_text:
        labels["units"] = axis.units
    is_whole = all(isinstance(value, int) for value in axis.values)
    kind = _TEXT if is_text else np.int64 if is_whole else np.float64
    _variable(file, axis.name, (axis.along,), kind, labels)
    file[axis.name][:] = np.array(axis.values, dtype=object if is_text else kind)


def _known_variable(
    file: h5netcdf.File, own: str | Variable, kind: npt.DTypeLike, grid: tuple[str, ...] = ()
) -> None:
    """Make a variable, given by its name in `VARIABLES` or by itself, behind the grid's dims."""
    row = VARIABLES[own] if isinstance(own, str) else own
    labels = {"units": row.units} if row.units else {}
    _variable(file, row.name, (*grid, *row.dims), kind, {**labels, "long_name": row.long_name})


def _variable(
    file: h5netcdf.File,
    name: str,
    dims: tuple[str, ...],
    kind: npt.DTypeLike,
    labels: Mapping[str, str],
) -> None:
    is_number = kind is not _TEXT and dims  # HDF5 checks their sums when they are read
    variable = file.create_variable(name, dims, kind, fletcher32=True if is_number else None)
    variable.attrs.update(labels)


def _slabs(
    sweep: Sweep, joined: Joined, wanted: tuple[Quantity, ...]
) -> Iterator[tuple[slice, Block]]:
    """Yield ranges of the outermost dimension (slabs) with their points."""
    outer, *inner = sweep.sizes.values()
    per_index = math.prod(inner)
    size = sum(quantity.size for quantity in wanted)
    step = max(1, SLAB_NUMBERS // (per_index * max(size, 1)))
    for start in range(0, outer, step):
        stop = min(start + step, outer)
        yield slice(start, stop), joined.block(start * per_index, stop * per_index, size)


def _fill(
    file: h5netcdf.File,
    slab: slice,
    block: Block,
    wanted: tuple[Quantity, ...],
    shape: tuple[int, ...],
) -> None:
    """Write the points of a slab."""
    inner = shape[1:]
    first, n = slab.start * math.prod(inner), (slab.stop - slab.start) * math.prod(inner)
    rows = np.full((n, block.rows.shape[1]), np.nan)
    outcome, error = np.full(n, "", dtype=object), np.full(n, "", dtype=object)
    at = block.numbers - first
    rows[at], outcome[at] = block.rows, _WORDS[block.outcomes]
    for index, text in block.errors.items():
        error[index - first] = text
    lead, column = (slab.stop - slab.start, *inner), 0
    for quantity in wanted:
        values = rows[:, column : column + quantity.size]
        file[quantity.name][slab] = values.reshape(*lead, *quantity.shape)
        column += quantity.size
    file["outcome"][slab] = outcome.reshape(lead)
    file["error"][slab] = error.reshape(lead)
