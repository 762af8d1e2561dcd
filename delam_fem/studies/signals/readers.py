"""Read columns from text, LabVIEW, NetCDF, HDF5, MATLAB, universal, sound and TDMS files.

Of universal files (UFF) the sets 58 and 58b are read, with units and positions. pyuff parses the
sets; what it stumbles over in real files is put right before, byte by byte. Real files have tags
and lines with trailing blanks, D for E in exponents, empty lines, and stray line ends about the
binary data of a set 58b. This data may itself look like a tag.
"""

from __future__ import annotations

import math
import re
import tempfile
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import xarray as xr

from delam_fem.api import (
    DAY,
    CaseError,
    TableColumns,
    footprint,
    hdf5,
    heading,
    read_columns,
    reason_of,
    shown,
)
from delam_fem.studies.signals.channels import (
    AXES,
    Column,
    Sheet,
    Values,
    axis_of,
    matrix_columns,
)
from delam_fem.studies.signals.units import unit_of

MOST_BYTES_OF_TEXT = 100_000_000
"""Size of the largest table; it takes ten times as much memory."""


def read_text(path: Path) -> list[Sheet]:
    """Read the columns of a table in a text file.

    The lines above the first row of numbers are headings. The last of them with as many cells as
    the table has columns names these, with units as in `thick [mm]`; a line of units may follow.
    Dates and clocks become one time in seconds from the first row.

    Args:
        path: the file.

    Returns:
        One sheet.

    Raises:
        CaseError: see `read_columns`; or there are fewer than two rows of numbers.
    """
    table = read_columns(path, str(path), most_bytes=MOST_BYTES_OF_TEXT)
    if len(table.lines) < 2:
        raise CaseError(f"{path}: expected a table with at least two rows of numbers, found one")
    names = zip(_names_of_columns(table), table.values, strict=True)
    columns = [Column(name, values, unit) for (name, unit), values in names]
    if not table.instants:
        return [Sheet(str(path), tuple(columns), notes=table.notes)]
    clock = _clock(table, path)
    others = [column for k, column in enumerate(columns) if k not in table.instants]
    what = " and ".join(f"{columns[k].name!r} ({kind})" for k, kind in table.instants.items())
    notes = (*table.notes, f"time from {what}, in seconds from the first row")
    return [Sheet(str(path), (clock, *others), notes=notes, axis="time")]


def _clock(table: TableColumns, path: Path) -> Column:
    """Return the time that columns of dates and clocks say, from the first row on [s].

    Raises:
        CaseError: there is no clock, or there are several.
    """
    clocks = [k for k, kind in table.instants.items() if "clock" in kind]
    dates = [k for k, kind in table.instants.items() if kind == "date"]
    if len(clocks) != 1 or len(dates) > 1:
        raise CaseError(
            f"{path}, line {table.lines[0]}: expected one column with a clock hh:mm:ss, and at "
            f"most one with dates, given {len(clocks)} and {len(dates)}; write the time in seconds"
        )
    time = table.values[clocks[0]].copy()
    if dates:
        time += table.values[dates[0]]
    elif table.instants[clocks[0]] == "clock":  # it begins anew at midnight
        time += DAY * np.cumsum(np.r_[0, np.diff(time) < -0.5 * DAY])
    return Column("time", time - time[0], "s")


def _names_of_columns(table: TableColumns) -> list[tuple[str, str | None]]:
    """Return names and units of the columns; without headings they are col1, col2 and so on."""
    if not table.headings:
        return [(f"col{k}", None) for k in range(1, len(table.values) + 1)]
    if len(table.above) > 1 and all(map(_is_unit_cell, table.headings)):
        units = [cell.strip("[]() ") for cell in table.headings]
        return [(heading(cell)[0], unit) for cell, unit in zip(table.above[-2], units, strict=True)]
    return [heading(cell) for cell in table.headings]


def _is_unit_cell(cell: str) -> bool:
    """Return whether a cell of a heading can be a unit: in brackets, or a few letters."""
    bare = cell.strip()
    return bare.startswith(("[", "(")) or len(bare) <= 5 or "/" in bare


MOST_BYTES_OF_LABVIEW = 50_000_000
"""Size of the largest text of LabVIEW; it is read slowly."""


def read_labview(path: Path) -> list[Sheet]:
    """Read the segments of a text file of LabVIEW (.lvm).

    Args:
        path: the file.

    Returns:
        A sheet for each segment, and for each column of times in it.

    Raises:
        CaseError: the file is too large, or holds no segment.
    """
    import lvm_read

    if path.stat().st_size > MOST_BYTES_OF_LABVIEW:
        raise CaseError(f"{path}: expected at most {MOST_BYTES_OF_LABVIEW} bytes; export it as CSV")
    text = path.read_bytes().decode("utf-8-sig", "replace")
    try:
        content = lvm_read.read_str(text)
        segments = [content[k] for k in range(content["Segments"])]
        return [sheet for segment in segments for sheet in _segment(segment, content, path)]
    except CaseError:
        raise
    except Exception as error:  # the library raises whatever Python does
        reason = reason_of(error, path)
        raise CaseError(
            f"{path}: damaged, or no text file of LabVIEW ({reason}); export it as CSV"
        ) from None


def _segment(segment: dict[str, Any], content: dict[Any, Any], path: Path) -> Iterator[Sheet]:
    """Yield the sheets of a segment: signals behind each column X_Value, or at a rate."""
    table = np.asarray(segment["data"], dtype=float)
    names = [name for name in segment["Channel names"] if name != "Comment"]
    units = [text or None for text in segment.get("Y_Unit_Label", [])]
    if content.get("X_Columns") == "No":
        rate = 1.0 / float(segment["Delta_X"][0])
        yield Sheet(str(path), tuple(_signals(names, table.T, units)), rate=rate)
        return
    if "X_Value" not in names:
        raise CaseError(f"{path}: expected a column X_Value, found {', '.join(names)[:200]}")
    starts = [k for k, name in enumerate(names) if name == "X_Value"]
    for start, end in zip(starts, [*starts[1:], len(names)], strict=True):
        rows = np.isfinite(table[:, start])
        signals = _signals(names[start + 1 : end], table[rows, start + 1 : end].T, units)
        units = units[len(signals) :]
        kind = str(segment.get("X_Dimension", ["Time"])[0])
        if kind != "Time":
            raise CaseError(f"{path}: expected X_Value to be a time, given {kind[:40]!r}")
        axis = Column("time", table[rows, start], "s")
        yield Sheet(str(path), (axis, *signals), axis="time")


def _signals(names: list[str], rows: Values, units: list[str | None]) -> list[Column]:
    """Return signals with their names and units."""
    labels = [*units, *[None] * len(names)]
    columns = []
    for name, row, unit in zip(names, rows, labels, strict=False):
        bare, said = heading(name)
        columns.append(Column(bare, row, unit or said))
    return columns


def netcdf_sheets(data: xr.Dataset, path: Path) -> list[Sheet]:
    """Return the variables of a dataset over an axis (time, frequency, x) as columns.

    Args:
        data: dataset of the file.
        path: the file, for messages.

    Raises:
        CaseError: no variable is over such an axis.
    """
    sheets = []
    for dim in map(str, data.dims):
        axis = data[dim] if dim in data.variables else None
        kind = axis_of(dim.rpartition("_")[2], None)
        if axis is None or not kind or axis.size < 2:
            continue
        columns = [Column(kind, axis.to_numpy(), axis.attrs.get("units"))]
        for name in map(str, data.data_vars):
            columns += _columns(data[name], dim)
        if len(columns) > 1:
            sheets.append(Sheet(f"{path}", tuple(columns), axis=kind))
    if "gap0" in data and "x" in data["gap0"].coords and "x" not in data.dims:
        x = data["x"]
        if columns := _columns(data["gap0"], str(x.dims[0])):  # a single lamina has none
            points_column = Column("x", x.to_numpy(), x.attrs.get("units"))
            sheets.append(Sheet(f"{path}", (points_column, *columns), axis="x"))
    if not sheets:
        raise CaseError(
            f"{path}: expected variables over a dimension time, frequency or x with its "
            "coordinate, found none"
        )
    return sheets


def _columns(variable: xr.DataArray, dim: str) -> list[Column]:
    """Return the columns of a variable over a dimension, one for each place in the others."""
    others = [d for d in variable.dims if d != dim]
    if dim not in variable.dims or len(others) > 1 or variable.dtype.kind not in "fiuc":
        return []
    name = str(variable.name)
    rows = variable.transpose(*others, dim)
    labels = None
    if others and others[0] in rows.coords:
        labels = [f"{name} {label}" for label in rows[others[0]].to_numpy()]
    units = variable.attrs.get("units")
    said = variable.attrs
    quantity = str(said.get("quantity", "")).removeprefix("base ")  # of a record
    position = said.get("x", said.get("position"))
    place: dict[str, Any] = {"quantity": quantity, "lamina": str(said.get("lamina", ""))}
    if isinstance(position, int | float | np.number):
        place["position"] = float(position)
        if isinstance(across := said.get("z"), int | float | np.number):
            place["across"] = float(across)
    columns = matrix_columns(name, rows.to_numpy(), labels, units)
    return [replace(column, **place) for column in columns]


RATES = {"fs", "rate", "sample_rate", "sampling_rate", "samplerate", "sampling_frequency"}
STEPS = {"dt", "wf_increment", "time_step", "sample_time", "ts", "delta_t", "deltat"}
"""Names of numbers that give the rate [Hz] or the time step [s], in lower case."""
UNITS = "units"
"""Name of the structure with the units of the variables beside it."""
HDF5 = b"\x89HDF"
"""Bytes that a MATLAB file of version 7.3 has behind its header of 512 bytes."""

Tree = dict[str, Any]
"""Variables by name: numbers, texts, lists of texts, or trees for structures."""


def read_matlab(path: Path) -> list[Sheet]:
    """Read the variables of a MATLAB file: vectors and matrices as long as a vector of times.

    Structures are looked into; a structure takes the times from outside if it has none. A number
    fs or dt replaces the times. Where a structure `units` has the name of a variable, its text is
    the unit.

    Args:
        path: the file.

    Returns:
        A sheet for each vector of times, frequencies or positions.

    Raises:
        CaseError: the file is no MATLAB file, or nothing in it goes with an axis.
    """

    def tree() -> Tree:
        with path.open("rb") as file:
            is_hdf5 = HDF5 in file.read(516)
        with footprint.bounded(path):
            return _of_hdf5(path) if is_hdf5 else _of_scipy(path)

    return _sheets_of(
        path, tree, "MATLAB", "vectors beside a vector t or time, or a number fs or dt; found"
    )


def _sheets_of(path: Path, read: Callable[[], Tree], kind: str, expected: str) -> list[Sheet]:
    """Return the sheets of a file whose content is a tree.

    Args:
        path: the file.
        read: returns its tree; the libraries that it calls raise whatever they please.
        kind: what the file is, in words.
        expected: what its tree should have, in words, up to what it has.

    Raises:
        CaseError: the file is of another kind, or nothing in it goes with an axis.
    """
    try:
        tree = read()
    except CaseError:
        raise
    except Exception as error:
        reason = reason_of(error, path)
        raise CaseError(
            f"{path}: damaged, or no {kind} file ({reason}); store it anew, or as CSV"
        ) from None
    sheets = list(_sheets(tree, str(path), {}))
    if not sheets:
        names = ", ".join(sorted(tree))[:200] or "nothing"
        raise CaseError(f"{path}: expected {expected} {names}")
    return sheets


def _sheets(tree: Tree, label: str, outer: Tree) -> Iterator[Sheet]:
    """Yield the sheets of a structure and of those in it."""
    unit_names = tree.get(UNITS)
    units: Mapping[str, Any] = unit_names if isinstance(unit_names, dict) else {}
    axes = _axes(tree, units)
    own_rate = _rate(tree)
    rate = _rate(outer) if own_rate is None else own_rate
    names = {axis.name for axis in axes}
    if not axes and own_rate is None:
        axes = _axes(outer, outer.get(UNITS) or {})
    sheets = []
    heads: list[tuple[Column, ...]] = [(axis,) for axis in axes]
    if not axes and rate is not None:
        heads.append(())
    for head in heads:
        n = len(head[0].values) if head else _longest(tree)
        groups = _columns_of_tree(tree, units, n, head[0].name if head else None, names)
        names |= groups.keys()
        if groups:
            columns = (*head, *chain(*groups.values()))
            kind = axis_of(head[0].name, None) if head else ""
            sheets.append(Sheet(label, columns, rate=None if head else rate, axis=kind))
    if sheets:
        left = [
            name for name, values in tree.items()
            if isinstance(values, np.ndarray) and values.size > 1 and name not in names
        ]  # fmt: skip
        notes = (f"left out, as long as no axis: {', '.join(left)[:200]}",) if left else ()
        yield replace(sheets[0], notes=notes)
        yield from sheets[1:]
    for name, branch in tree.items():
        if isinstance(branch, dict) and name != UNITS:
            yield from _sheets(branch, f"{label}: {name}", {**outer, **tree})


def _longest(tree: Tree) -> int:
    """Return the number of samples where a rate is given: that of the longest array."""
    sizes = [max(v.shape) for v in tree.values() if isinstance(v, np.ndarray) and v.ndim in (1, 2)]
    return max(sizes, default=0)


def _axes(tree: Tree, units: Mapping[str, Any]) -> list[Column]:
    """Return the vectors of a structure that are axes, one of each length.

    Beside a time a vector called x or f is a signal, whether it increases or not.
    """
    vectors = [
        (name, values) for name, values in tree.items()
        if isinstance(values, np.ndarray) and values.ndim == 1 and axis_of(name, None)
        and values.size > 1 and bool(np.all(np.diff(values.real) > 0.0))
    ]  # fmt: skip
    order = list(AXES)
    vectors.sort(key=lambda pair: order.index(axis_of(pair[0], None)))
    axes: dict[int, Column] = {}
    for name, values in vectors:
        axes.setdefault(values.size, Column(name, values, units.get(name)))
    return list(axes.values())


def _rate(tree: Tree) -> float | None:
    """Return the sampling rate that a structure names [Hz]; None: it names none."""
    for name, value in tree.items():
        if isinstance(value, np.ndarray) and value.ndim == 0 and float(value.real) > 0.0:
            if name.lower() in RATES:
                return float(value.real)
            if name.lower() in STEPS:
                return 1.0 / float(value.real)
    return None


def _columns_of_tree(
    tree: Tree, units: Mapping[str, Any], n: int, axis: str | None, taken: set[str]
) -> dict[str, list[Column]]:
    """Return the columns of vectors and matrices of n samples over an axis, by their names."""
    groups = {}
    along = _dimensions(tree, axis) if axis is not None else []
    for name, values in tree.items():
        if name in taken or not isinstance(values, np.ndarray):
            continue
        if n < 2 or values.ndim not in (1, 2) or n not in values.shape:
            continue
        dimensions = _dimensions(tree, name)
        if along and dimensions and (along[0] not in dimensions or len(dimensions) > 2):
            continue  # as long by chance, or fields
        rows = values if values.shape[-1] == n else values.T
        unit = units.get(name)
        labels = _labels(tree, name, len(np.atleast_2d(rows)))
        names = [f"{name} {text}" for text in labels] if labels else None
        unit_text = unit if isinstance(unit, str) else None
        groups[name] = matrix_columns(name, rows, names, unit_text)
    return groups


def _dimensions(tree: Tree, name: str) -> list[str]:
    """Return what a variable of an exported run is over, as its file says; empty: it does not."""
    dimensions = tree.get("dimensions")
    text = dimensions.get(name) if isinstance(dimensions, dict) else None
    return text.split(", ") if isinstance(text, str) else []


def _labels(tree: Tree, name: str, n_rows: int) -> list[str]:
    """Return the texts beside a matrix that name its rows; empty: there are none.

    They are those of its dimensions, if the file says which. Otherwise they are the first list of
    as many texts.
    """
    if dimensions := _dimensions(tree, name):
        texts = [tree.get(dimension) for dimension in dimensions]
        lists = [[text] if isinstance(text, str) else text for text in texts]
    else:
        lists = list(tree.values()) if n_rows > 1 else []
    return next((v for v in lists if isinstance(v, list) and len(v) == n_rows), [])


def _of_scipy(path: Path) -> Tree:
    """Return the variables of a MATLAB file of version 5 to 7."""
    from scipy.io import loadmat, whosmat

    footprint.require_room(
        path, sum(8.0 * math.prod(map(float, shape)) for _, shape, _ in whosmat(path))
    )
    return {
        name: _plain(value)
        for name, value in loadmat(path, simplify_cells=True).items()
        if not name.startswith("__")
    }


def _plain(value: Any) -> Any:
    """Return a value of scipy as a tree, a text, a list of texts or an array of numbers."""
    if isinstance(value, dict):
        return {name: _plain(entry) for name, entry in value.items()}
    array = np.asarray(value)
    if array.dtype.kind in "fiucb":
        return array.astype(complex) if array.dtype.kind == "c" else array.astype(float)
    if array.dtype.kind == "U" and array.ndim == 0:
        return str(array)
    texts = array.ravel().tolist()
    return [str(t).strip() for t in texts] if all(isinstance(t, str) for t in texts) else None


def _of_hdf5(path: Path) -> Tree:
    """Return the variables of a MATLAB file of version 7.3."""
    with hdf5.opened(path) as file:
        budget = iter(range(hdf5.MOST_NODES))
        named = {name: node for name, node in file.items() if not name.startswith("#")}
        return {name: _value(node, file, budget) for name, node in named.items()}


def _value(node: Any, file: Any, budget: Iterator[int]) -> Any:
    """Return a node of HDF5 as MATLAB means it: arrays are stored transposed, texts as numbers.

    Args:
        node: the node.
        file: its file.
        budget: what each node takes one of; references may lead to a node again and again.

    Raises:
        ValueError: there are too many.
    """
    if next(budget, None) is None:
        raise ValueError(f"more than {hdf5.MOST_NODES} variables and cells")
    if isinstance(node, h5py.Group):
        return {name: _value(entry, file, budget) for name, entry in node.items()}
    kind = node.attrs.get("MATLAB_class", b"").decode()
    values = node[()]
    if node.attrs.get("MATLAB_empty", 0):
        return "" if kind == "char" else None
    if kind == "char":
        return "".join(chr(code) for code in np.asarray(values).T.ravel())
    if kind == "cell":
        references = np.asarray(values).T.ravel()
        texts = [_value(file[reference], file, budget) for reference in references]
        return texts if all(isinstance(text, str) for text in texts) else None
    array = np.asarray(values)
    if array.dtype.names == ("real", "imag"):
        array = array["real"] + 1j * array["imag"]
    if array.dtype.kind not in "fiuc":
        return None
    array = array.astype(complex if array.dtype.kind == "c" else float).T
    return array.squeeze() if array.ndim <= 2 else array


def read_hdf5(path: Path) -> list[Sheet]:
    """Read the datasets of an HDF5 file of a logger as `read_matlab` reads variables.

    Groups are structures. Attributes of a group or dataset that are numbers count as variables
    beside it, so that `fs` or `dt` may be one; the attribute `unit` or `units` of a dataset is its
    unit. Datasets of several fields have a column for each.

    Args:
        path: the file.

    Returns:
        A sheet for each vector of times, frequencies or positions.

    Raises:
        CaseError: the file is no HDF5 file, or nothing in it goes with an axis.
    """

    def tree() -> Tree:
        with footprint.bounded(path), hdf5.opened(path) as file:
            return _logged(file, iter(range(hdf5.MOST_NODES)))

    return _sheets_of(
        path,
        tree,
        "HDF5",
        "datasets beside a dataset t or time, or a number fs or dt, also as an attribute; found",
    )


def _logged(group: Any, budget: Iterator[int]) -> Tree:
    """Return a group of HDF5 as a tree, with numbers among its attributes and units.

    Raises:
        ValueError: there are too many groups and datasets.
    """
    tree: Tree = {}
    units: dict[str, str] = {}

    def take_attributes(node: Any, name: str) -> None:
        for key, value in node.attrs.items():
            number = np.asarray(value)
            if number.size == 1 and number.dtype.kind in "fiu":
                tree.setdefault(key, number.astype(float).reshape(()))
            elif name and key.lower() in ("unit", "units", "unit_string"):
                units[name] = value.decode() if isinstance(value, bytes) else str(value)

    for name, node in group.items():
        if next(budget, None) is None:
            raise ValueError(f"more than {hdf5.MOST_NODES} groups and datasets")
        if isinstance(node, h5py.Group):
            tree[name] = _logged(node, budget)
            continue
        take_attributes(node, name)
        values = np.asarray(node[()])
        if values.dtype.names:
            tree |= {field: values[field].astype(float) for field in values.dtype.names
                     if values[field].dtype.kind in "fiu"}  # fmt: skip
        elif values.dtype.kind in "fiu":
            tree[name] = values.astype(float).squeeze()
    take_attributes(group, "")
    if units:
        tree[UNITS] = units
    return tree


def read_sound(path: Path) -> list[Sheet]:
    """Read a WAV file: its channels as shares of the full scale.

    Args:
        path: the file.

    Returns:
        One sheet with the columns channel 1, channel 2, … without a unit.

    Raises:
        CaseError: the file is no WAV file, or too large.
    """
    from scipy.io import wavfile

    footprint.require_room(path, 8.0 * path.stat().st_size)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", wavfile.WavFileWarning)  # of chunks without samples
            rate, samples = wavfile.read(path)
    except Exception as error:  # scipy raises whatever it pleases
        raise CaseError(f"{path}: damaged, or no WAV file ({reason_of(error, path)})") from None
    values = np.atleast_2d(np.asarray(samples).T)
    if values.dtype == np.uint8:
        values = values.astype(float) / 128.0 - 1.0
    elif values.dtype.kind == "i":  # 24 bits come in the upper ones of 32
        values = values.astype(float) / (float(np.iinfo(values.dtype).max) + 1.0)
    columns = [Column(f"channel {k}", row.astype(float)) for k, row in enumerate(values, start=1)]
    return [Sheet(str(path), tuple(columns), rate=float(rate))]


def read_tdms(path: Path) -> list[Sheet]:
    """Read a TDMS file of LabVIEW: the channels of each group that have the same times.

    Args:
        path: the file.

    Returns:
        A sheet for each group, rate and length.

    Raises:
        CaseError: npTDMS is not installed, or the file is damaged or has no times.
    """
    try:
        from nptdms import TdmsFile
    except ImportError:
        raise CaseError(f"{path}: expected npTDMS to read it: pip install npTDMS") from None
    footprint.require_room(path, 8.0 * path.stat().st_size)
    groups: dict[tuple[str, float, int], list[Column]] = {}
    sheets = []
    try:
        file = TdmsFile.read(path)
        for group in file.groups():
            timed = [c for c in group.channels() if axis_of(c.name, None) == "time" and len(c) > 1]
            for channel in group.channels():
                values = np.asarray(channel[:])
                if values.dtype.kind not in "fiu" or values.size < 2:
                    continue
                about = {str(key): value for key, value in channel.properties.items()}
                step = float(about.get("wf_increment", 0.0) or 0.0)
                rate = 0.0 if timed or not step > 0.0 else 1.0 / step
                unit = str(about.get("unit_string", about.get("NI_UnitDescription", ""))) or None
                column = Column(channel.name, values.astype(float), unit)
                groups.setdefault((group.name, rate, values.size), []).append(column)
    except Exception as error:  # npTDMS raises whatever it pleases
        raise CaseError(f"{path}: damaged, or no TDMS file ({reason_of(error, path)})") from None
    for (name, rate, _), columns in groups.items():
        sheets.append(Sheet(f"{path}: {name}", tuple(columns), rate=rate or None))
    if not sheets:
        raise CaseError(f"{path}: expected channels of numbers, found none")
    return sheets


def sep005_sheets(series: Sequence[Mapping[str, Any]], label: str = "SEP 005") -> list[Sheet]:
    """Return time series as SEP 005 of SDyPy describes them as columns.

    Args:
        series: dictionaries with `name`, `data`, `unit_str`, and `fs` or `time`; `quantity`,
            `position` [m] and `lamina` are read where they are there.
        label: name of the list in messages.

    Raises:
        CaseError: there is no entry, one is no dictionary or lacks a key, or its times fit its
            data not.

    Source: SDyPy enhancement proposal 005, github.com/sdypy/sdypy.
    """
    groups: dict[tuple[float, int, bytes], list[Column]] = {}
    if not series:
        raise CaseError(f"{label}: expected at least one series, given an empty list")
    for number, entry in enumerate(series, start=1):
        if not isinstance(entry, Mapping):
            raise CaseError(
                f"{label}: series {number}: expected a dictionary, given {shown(str(entry))}; "
                "files are arguments of their own"
            )
        missing = [key for key in ("name", "data", "unit_str") if key not in entry]
        if missing or ("fs" not in entry and "time" not in entry):
            lacking = ", ".join(missing) or "fs or time"
            raise CaseError(f"{label}: series {number}: expected {lacking}, which is missing")
        values = np.asarray(entry["data"], dtype=float)
        time = np.asarray(entry.get("time", ()), dtype=float)
        if values.ndim != 1 or (time.size and time.shape != values.shape):
            raise CaseError(
                f"{label}: series {number}: expected a vector, and times as long, given shapes "
                f"{values.shape} and {time.shape}"
            )
        position = entry.get("position")
        column = Column(
            str(entry["name"]),
            values,
            str(entry["unit_str"]) or None,
            str(entry.get("quantity", "")),
            None if position is None else float(position),
            str(entry.get("lamina", "")),
        )
        rate = 0.0 if time.size else float(entry["fs"])
        groups.setdefault((rate, values.size, time.tobytes()), []).append(column)
    sheets = []
    for (rate, _, content), columns in groups.items():
        times = [Column("time", np.frombuffer(content), "s")] if content else []
        axis = "time" if times else ""
        sheets.append(Sheet(label, (*times, *columns), rate=rate or None, axis=axis))
    return sheets


TAG = b"    -1"
TAG_LINE = re.compile(rb"(?:^|(?<=\n)|(?<=\r)) {4}-1[ \t]*(?:\r\n|\n|\r|\Z)")
"""A line that begins or ends a set."""
END_TAG = re.compile(rb" {4}-1[ \t]*+(?:\r\n|\n|\r|\Z)")
"""The end of binary data: the tag may follow the last byte at once."""
LINE = re.compile(rb"[^\r\n]*(?:\r\n|\n|\r|\Z)")
MOST_STRAYS = 16
"""Number of places at which binary data among stray line ends is looked for."""
HEADER_LINES = 13
"""Lines of a set 58 before its data: the tag, the type, eleven records."""
NUMBER_WIDTHS = {2: 4, 4: 8, 5: 8, 6: 16}
"""Bytes of a value by the type of the ordinate: real and complex, single and double."""
MOST_BYTES = 1_000_000_000
"""Size of the largest universal file that is read."""


@dataclass(frozen=True)
class UniversalSet:
    """A set of a universal file.

    Attributes:
        number: number of the set in the file, from 1.
        kind: type of the set, such as "58b".
        header: the first lines of a set 58b, all lines of another; without the tag at the end.
        data: binary data of a set 58b without stray line ends.
        notes: what was put right.
    """

    number: int
    kind: str
    header: bytes
    data: bytes = b""
    notes: tuple[str, ...] = ()


def blocks_of(path: Path) -> list[UniversalSet]:
    """Return the sets of a universal file.

    Raises:
        CaseError: the file is too large, has no set, or ends within one.
    """
    if path.stat().st_size > MOST_BYTES:
        raise CaseError(f"{path}: expected at most {MOST_BYTES} bytes")
    content = path.read_bytes()
    place = 0
    blocks: list[UniversalSet] = []
    while (tag := TAG_LINE.search(content, place)) is not None:
        block, place = _block(content, tag.start(), len(blocks) + 1, path)
        blocks.append(block)
    if not blocks:
        raise CaseError(
            f"{path}: expected a universal file, found no line '    -1' that begins a set"
        )
    return blocks


def _block(content: bytes, start: int, number: int, path: Path) -> tuple[UniversalSet, int]:
    """Return the set that begins at a tag, and where the file goes on after it."""
    type_line = LINE.match(content, _line_end(content, start))
    kind = type_line.group().strip().decode("ascii", "replace") if type_line else ""
    if kind[:3].lower() == "58b":
        return _binary(content, start, number, path)
    end = TAG_LINE.search(content, _line_end(content, start))
    if end is None:
        raise CaseError(f"{path}: set {number} (type {kind[:6]}) has no end; the file is cut off")
    kind = kind.split()[0] if kind.split() else "empty"
    return UniversalSet(number, kind, content[start : end.start()]), end.end()


def _binary(content: bytes, start: int, number: int, path: Path) -> tuple[UniversalSet, int]:
    """Return a set 58b; the size of its data follows from its header, not from the next tag."""
    place = start
    lines = []
    for _ in range(HEADER_LINES):
        end = _line_end(content, place)
        lines.append(content[place:end].rstrip(b"\r\n"))
        place = end
    try:
        ordinate, points, is_even = (int(lines[8][k : k + 10]) for k in (0, 10, 20))
        width = NUMBER_WIDTHS[ordinate]
        of_abscissa = 0 if is_even else (4 if ordinate in (2, 5) else 8)
    except (ValueError, KeyError):
        raise CaseError(f"{path}: set {number} (type 58b): its header cannot be read") from None
    size = points * (width + of_abscissa)
    end_tag = END_TAG.search(content, place + size)
    if end_tag is None:
        raise CaseError(
            f"{path}: set {number} (type 58b): expected {size} bytes of data and its end, found "
            f"{len(content) - place} bytes; the file is cut off"
        )
    data = content[place : end_tag.start()]
    notes = list[str]()
    before, behind = _strays(data, size, ">" if lines[1][7:13].strip() == b"2" else "<")
    if before or behind:
        notes.append(f"{before + behind} stray bytes about its binary data left out")
    header = b"".join(line.rstrip() + b"\n" for line in lines)
    return UniversalSet(
        number, "58b", header, data[before : before + size], tuple(notes)
    ), end_tag.end()


def _strays(data: bytes, size: int, order: str) -> tuple[int, int]:
    """Return how many stray bytes are before and behind the binary data.

    Only line ends can be stray. Where it is not clear on which side they are, because a value
    begins or ends with such a byte, the side is taken that leaves values nearer to 1 in their
    powers of ten.
    """
    extra = len(data) - size
    before = len(data) - len(data.lstrip(b"\r\n"))
    behind = len(data) - len(data.rstrip(b"\r\n"))
    starts = list(range(max(0, extra - behind), min(before, extra) + 1))[:MOST_STRAYS] or [0]
    if len(starts) > 1 and size % 8 == 0:
        largest = [np.frombuffer(data[k : k + size], f"{order}f8") for k in starts]
        with np.errstate(all="ignore"):
            spread = [float(np.max(np.abs(np.log10(np.abs(v) + 1e-30)))) for v in largest]
        starts = [starts[int(np.nanargmin(np.nan_to_num(spread, nan=np.inf)))]]
    return starts[0], extra - starts[0]


def _line_end(content: bytes, place: int) -> int:
    """Return where the line at a place ends, its line end included."""
    match = LINE.match(content, place)
    return match.end() if match else len(content)


def cleaned(block: UniversalSet) -> bytes:
    """Return the bytes of a set for pyuff: plain tags and line ends, no trailing blanks, no D."""
    header = _in_utf8(block.header)
    if block.kind == "58b":
        return header + block.data + b"\n" + TAG + b"\n"
    lines = [line.rstrip() for line in header.splitlines()]
    lines[0] = TAG
    head, body = lines[:HEADER_LINES], lines[HEADER_LINES:]
    if block.kind == "58":
        lines = head + [line.replace(b"D", b"E").replace(b"d", b"E") for line in body if line]
    return b"\n".join(lines) + b"\n" + TAG + b"\n"


def _in_utf8(header: bytes) -> bytes:
    """Return the text of a set in UTF-8; what is none is Windows-1252 (Latin-1)."""
    try:
        header.decode("utf-8")
    except UnicodeDecodeError:
        return header.decode("cp1252", "replace").encode("utf-8")
    return header


FUNCTIONS = {0: "signal", 1: "signal", 4: "response", 6: "coherence"}
"""Functions of a set 58 that are read: general or time response, frequency response, coherence."""
FUNCTION_NAMES = (
    "general", "time response", "auto spectrum", "cross spectrum", "frequency response",
    "transmissibility", "coherence", "auto correlation", "cross correlation",
    "power spectral density", "energy spectral density", "probability density", "spectrum",
    "cumulative frequency distribution", "peaks and valleys", "stress over cycles",
    "strain over cycles", "orbit", "mode indicator function", "force pattern", "partial power",
    "partial coherence", "eigenvalue", "eigenvector", "shock response spectrum", "filter",
    "multiple coherence", "order function",
)  # fmt: skip
"""Names of all functions of a set 58, by their number."""
UNKNOWN, TIME, FREQUENCY = 0, 17, 18
"""Types of an abscissa."""
QUANTITIES = {8: "displacement", 11: "velocity", 12: "acceleration", 13: "force", 9: "force",
              3: "strain", 17: "time", 18: "frequency"}  # fmt: skip
"""Quantities by the type of data."""
FACTORS = {"displacement": "length", "velocity": "length", "acceleration": "length",
           "force": "force", "strain": ""}  # fmt: skip
"""Factor of set 164 by which values of a quantity are divided to be in SI."""
RATIOS = {"displacement": "receptance", "velocity": "mobility", "acceleration": "accelerance"}
"""Quantities of frequency responses to a force."""
RESPONSE = 4
SETS = ("15", "58", "58b", "164", "2411")
"""Sets that are given to pyuff; others are left out."""
NOTHING = ("", "NONE")


def read_universal(path: Path) -> list[Sheet]:
    """Read the functions of a universal file.

    Args:
        path: the file.

    Returns:
        A sheet for each set 58 that holds a history, a frequency response or a coherence.

    Raises:
        CaseError: the file has no such set, or a damaged one.
    """
    blocks = [block for block in blocks_of(path) if block.kind in SETS]
    sets = [_parsed(block, path) for block in blocks]
    factors = next(
        (dataset for dataset in sets if dataset["type"] == 164), {"length": None, "force": None}
    )
    places: dict[int, float] = {}
    for dataset in sets:
        if dataset["type"] in (15, 2411):
            numbers = dataset.get("node_nums", dataset.get("grid_global", []))
            length = factors["length"] or 1.0
            places |= {
                int(n): float(x) / length for n, x in zip(numbers, dataset["x"], strict=False)
            }
    functions = list[tuple[UniversalSet, dict[str, Any]]]()
    others = list[str]()
    for block, fields in zip(blocks, sets, strict=True):
        if fields["type"] != 58:
            continue
        is_read = fields["func_type"] in FUNCTIONS
        if is_read and fields["abscissa_spec_data_type"] in (UNKNOWN, TIME, FREQUENCY):
            functions.append((block, fields))
        else:
            others.append(f"set {block.number} ({_described(fields)})")
    if not functions:
        kinds = ", ".join(block.kind for block in blocks_of(path)) or "none"
        raise CaseError(
            f"{path}: expected a universal file with sets 58 that hold histories, frequency "
            f"responses or coherences, found {', '.join(others)[:300] or f'the sets {kinds[:80]}'};"
            " export histories or frequency responses"
        )
    names = _names([fields for _, fields in functions], [block.number for block, _ in functions])
    sheets = [
        _sheet(path, block, fields, (name, factors, places))
        for (block, fields), name in zip(functions, names, strict=True)
    ]
    if others:
        note = f"left out: {', '.join(others)[:300]}"
        sheets[0] = replace(sheets[0], notes=(*sheets[0].notes, note))
    return sheets


def _described(fields: dict[str, Any]) -> str:
    """Return the kind of function of a set 58 in words, or its abscissa if that is the reason."""
    number = fields["func_type"]
    if number in FUNCTIONS:
        return f"abscissa of type {fields['abscissa_spec_data_type']}, no time and no frequency"
    is_known = 0 <= number < len(FUNCTION_NAMES)
    return FUNCTION_NAMES[number] if is_known else f"function of type {number}"


def _parsed(block: UniversalSet, path: Path) -> dict[str, Any]:
    """Return a set as pyuff parses it, after its bytes have been put right."""
    import pyuff

    with tempfile.TemporaryDirectory(prefix="delam-fem-") as folder:
        temporary = Path(folder) / "set.uff"
        with temporary.open("wb") as file:
            file.write(cleaned(block))
        try:
            sets = pyuff.UFF(str(temporary)).read_sets()
        except Exception as error:  # pyuff raises bare exceptions
            raise CaseError(
                f"{path}: set {block.number} (type {block.kind}) cannot be read ({error})"
            ) from None
    if not isinstance(sets, dict) or "type" not in sets:
        raise CaseError(f"{path}: set {block.number} (type {block.kind}) cannot be read")
    return sets


def _names(functions: list[dict[str, Any]], numbers: list[int]) -> list[str]:
    """Return the name of each set: what tells all sets apart.

    That is the first of id1, entity, node with direction, these with those of the reference, and
    these with the number of the set.
    """

    def are_told(names: list[str]) -> bool:
        kinds = [fields["func_type"] for fields in functions]
        return len(set(zip(kinds, names, strict=True))) == len(names) and not set(names) & set(
            NOTHING
        )

    def places(side: str) -> list[str]:
        along = {1: " +x", 2: " +y", 3: " +z", -1: " -x", -2: " -y", -3: " -z"}
        return [
            f"node{fields[f'{side}_node']}{along.get(fields[f'{side}_dir'], '')}"
            for fields in functions
        ]

    labels = [
        [str(fields.get(key, "")).strip() for fields in functions]
        for key in ("id1", "rsp_ent_name")
    ]
    nodes = places("rsp")
    pairs = [f"{response} to {ref}" for response, ref in zip(nodes, places("ref"), strict=True)]
    counted = [f"{pair}, set {number}" for pair, number in zip(pairs, numbers, strict=True)]
    return next((names for names in (*labels, nodes, pairs) if are_told(names)), counted)


def _sheet(path: Path, block: UniversalSet, own: dict[str, Any], about: tuple[Any, ...]) -> Sheet:
    """Return the sheet of a set: its abscissa and its values."""
    name, factors, places = about
    kind = FUNCTIONS[own["func_type"]]
    unit_of_axis = str(own.get("abscissa_axis_units_lab", "")).strip()
    is_named = unit_of_axis.upper() not in NOTHING
    is_time = own["abscissa_spec_data_type"] == TIME
    if own["abscissa_spec_data_type"] == UNKNOWN:
        is_time = kind == "signal"
        if is_named:
            label = f"{path}, set {block.number}, abscissa"
            is_time = unit_of(unit_of_axis, label).quantity != "frequency"
    n = min(own["num_pts"], own["data"].size, own["x"].size)
    if n < own["num_pts"] or n < 2:
        raise CaseError(
            f"{path}: set {block.number} has {n} of {own['num_pts']} values; the file is cut off"
        )
    unit, quantity, scale = ("1", "", 1.0) if kind == "coherence" else _unit(own, factors)
    x = own["abscissa_min"] + own["abscissa_inc"] * np.arange(n)
    axis = Column(
        "time" if is_time else "frequency",
        x if own["abscissa_spacing"] else own["x"][:n],
        unit_of_axis if is_named else None,
    )
    place = places.get(int(own["rsp_node"]))
    column = Column(name, own["data"][:n] * scale, unit, quantity, place, kind=kind)
    return Sheet(
        f"{path}, set {block.number}",
        (axis, column),
        notes=block.notes,
        alias=f"set{block.number}",
        axis=axis.name,
    )


def _unit(own: dict[str, Any], factors: dict[str, Any]) -> tuple[str | None, str, float]:
    """Return the unit of a set (None: not named), its quantity (empty: not known), a factor.

    Values times the factor are in the unit.

    The unit's label in the set comes first, then the factors of set 164, by which values are
    divided to be SI.
    """
    above = QUANTITIES.get(own["ordinate_spec_data_type"], "")
    below = QUANTITIES.get(own["orddenom_spec_data_type"], "")
    quantity = RATIOS.get(above, "") if below == "force" else "" if below else above
    unit = str(own.get("ordinate_axis_units_lab", "")).strip()
    divisor = str(own.get("orddenom_axis_units_lab", "")).strip()
    if unit.upper() not in NOTHING:
        is_ratio = own["func_type"] == RESPONSE and divisor.upper() not in NOTHING
        return (f"({unit})/({divisor})" if is_ratio else unit), quantity, 1.0
    if factors["length"] is None or not above:
        return None, quantity, 1.0
    scale = 1.0
    for name, sign in ((above, -1), (below, 1)):
        if factor := FACTORS.get(name, ""):
            scale *= float(factors[factor]) ** sign
    return "SI", quantity, scale
