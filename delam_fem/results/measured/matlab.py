"""Read measurements from MATLAB files: version 5 to 7 by scipy, 7.3 (HDF5) by h5py."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from delam_fem.case.toml import CaseError
from delam_fem.results.measured.columns import Column, Sheet, axis_of, matrix_columns

RATES = {"fs", "rate", "sample_rate", "sampling_rate", "samplerate", "sampling_frequency"}
STEPS = {"dt", "time_step", "sample_time"}
"""Names of numbers that give the rate [Hz] or the time step [s], in lower case."""
UNITS = "units"
"""Name of the structure with the units of the variables beside it."""
HDF5 = b"\x89HDF"
"""What a file of version 7.3 has behind its header of 512 bytes."""

Tree = dict[str, Any]
"""Variables by name: numbers, texts, lists of texts, or trees for structures."""


def read(path: Path) -> list[Sheet]:
    """Read the variables of a file: vectors and matrices as long as a vector of times.

    Structures are looked into; a structure takes the times from outside if it has none. A number
    fs or dt replaces the times. Where a structure `units` has the name of a variable, its text is
    the unit.

    Args:
        path: of the file.

    Returns:
        A sheet for each vector of times, frequencies or positions.

    Raises:
        CaseError: the file is no MATLAB file, or nothing in it goes with an axis.
    """
    try:
        with path.open("rb") as file:
            is_hdf5 = HDF5 in file.read(516)
        tree = _of_hdf5(path) if is_hdf5 else _of_scipy(path)
    except Exception as error:  # both libraries raise whatever they please
        reason = str(error).partition("\n")[0][:80]
        raise CaseError(f"{path}: damaged, or no MATLAB file ({reason})") from None
    found = list(_sheets(tree, str(path), {}))
    if not found:
        raise CaseError(
            f"{path}: expected vectors beside a vector t or time, or a number fs; found "
            f"{', '.join(sorted(tree))[:200] or 'nothing'}"
        )
    return found


def _sheets(tree: Tree, label: str, outer: Tree) -> Iterator[Sheet]:
    """Yield the sheets of a structure and of those in it."""
    unit_names = tree.get(UNITS)
    units: Mapping[str, Any] = unit_names if isinstance(unit_names, dict) else {}
    axes, rate = _axes(tree, units), _rate(tree) or _rate(outer)
    if not axes:
        axes = _axes(outer, outer.get(UNITS) or {})
    taken: set[str] = set()
    for axis in axes:
        columns = _columns(tree, units, len(axis.values), taken)
        if columns:
            yield Sheet(label, (axis, *columns))
    if not axes and rate is not None:
        lengths = [len(v) for v in tree.values() if isinstance(v, np.ndarray) and v.ndim == 1]
        columns = _columns(tree, units, max(lengths, default=0), taken)
        if columns:
            yield Sheet(label, tuple(columns), rate=rate)
    for name, branch in tree.items():
        if isinstance(branch, dict) and name != UNITS:
            yield from _sheets(branch, f"{label}: {name}", {**outer, **tree})


def _axes(tree: Tree, units: Mapping[str, Any]) -> list[Column]:
    """Return the vectors of a structure that are axes."""
    vectors = {k: v for k, v in tree.items() if isinstance(v, np.ndarray) and v.ndim == 1}
    return [
        Column(name, values, units.get(name))
        for name, values in vectors.items()
        if axis_of(name, None) and values.size > 1 and np.all(np.diff(values.real) > 0.0)
    ]


def _rate(tree: Tree) -> float | None:
    """Return the sampling rate that a structure names [Hz]; None: it names none."""
    for name, value in tree.items():
        if isinstance(value, np.ndarray) and value.ndim == 0 and float(value.real) > 0.0:
            if name.lower() in RATES:
                return float(value.real)
            if name.lower() in STEPS:
                return 1.0 / float(value.real)
    return None


def _columns(tree: Tree, units: Mapping[str, Any], n: int, taken: set[str]) -> list[Column]:
    """Return vectors and matrices of n samples; their names go into `taken`."""
    columns = []
    for name, values in tree.items():
        if name in taken or not isinstance(values, np.ndarray) or axis_of(name, None):
            continue
        if n < 2 or values.ndim not in (1, 2) or n not in values.shape:
            continue
        taken.add(name)
        rows = values if values.shape[-1] == n else values.T
        unit = units.get(name)
        names = _row_names(tree, name, len(np.atleast_2d(rows)))
        columns += [
            Column(own.name, own.values, unit if isinstance(unit, str) else None)
            for own in matrix_columns(name, rows, names)
        ]
    return columns


def _row_names(tree: Tree, name: str, n_rows: int) -> list[str] | None:
    """Return the names of a matrix' rows, where a list of that many texts lies beside it."""
    lists = [v for v in tree.values() if isinstance(v, list) and len(v) == n_rows]
    return [f"{name} {text}" for text in lists[0]] if lists and n_rows > 1 else None


def _of_scipy(path: Path) -> Tree:
    """Return the variables of a file of version 5 to 7."""
    from scipy.io import loadmat

    raw = loadmat(path, simplify_cells=True)
    return {name: _plain(value) for name, value in raw.items() if not name.startswith("__")}


def _plain(value: Any) -> Any:
    """Return a value of scipy as a tree, a text, a list of texts or an array of numbers."""
    if isinstance(value, dict):
        return {name: _plain(own) for name, own in value.items()}
    array = np.asarray(value)
    if array.dtype.kind in "fiucb":
        return array.astype(complex) if array.dtype.kind == "c" else array.astype(float)
    if array.dtype.kind == "U" and array.ndim == 0:
        return str(array)
    texts = array.ravel().tolist()
    return [str(t).strip() for t in texts] if all(isinstance(t, str) for t in texts) else None


def _of_hdf5(path: Path) -> Tree:
    """Return the variables of a file of version 7.3."""
    with h5py.File(path, "r") as file:
        return {name: _value(node, file) for name, node in file.items() if not name.startswith("#")}


def _value(node: Any, file: Any) -> Any:
    """Return a node of HDF5 as MATLAB means it: arrays are stored transposed, texts as numbers."""
    if isinstance(node, h5py.Group):
        return {name: _value(own, file) for name, own in node.items()}
    kind = node.attrs.get("MATLAB_class", b"").decode()
    values = node[()]
    if node.attrs.get("MATLAB_empty", 0):
        return "" if kind == "char" else None
    if kind == "char":
        return "".join(chr(code) for code in np.asarray(values).T.ravel())
    if kind == "cell":
        texts = [_value(file[reference], file) for reference in np.asarray(values).T.ravel()]
        return texts if all(isinstance(text, str) for text in texts) else None
    array = np.asarray(values)
    if array.dtype.names == ("real", "imag"):
        array = array["real"] + 1j * array["imag"]
    if array.dtype.kind not in "fiuc":
        return None
    array = array.astype(complex if array.dtype.kind == "c" else float).T
    return array.squeeze() if array.ndim <= 2 else array
