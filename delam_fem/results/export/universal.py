"""A run as universal files: histories as sets 58 with units, positions in a set 15."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from delam_fem.case.atomic import atomic
from delam_fem.numerics.arrays import FloatArray
from delam_fem.results.diagnostics import probe_node

TYPES = {"m": 8, "m/s": 11, "m/s2": 12, "N": 13, "1": 3, "N m": 9}
"""Types of data by unit; 0 for others."""
TIME, GENERAL = 17, 1
HISTORIES, STROBES = ("time",), ("period",)
NODES_PER_LAMINA = 10_000
"""Numbers of the nodes of a lamina begin at its number times this."""
LATERAL = 3
"""Direction of the motion: +z."""


def write(history: xr.Dataset, path: Path) -> list[Path]:
    """Write NAME.uff with histories and strobes, and NAME-fields.uff with the motion of all nodes.

    Times begin at 0, because the format has six digits for them; a line of each set says when that
    was. Universal files have no place for tables of events.

    Args:
        history: of a run; see `schema.VARIABLES`.
        path: NAME.uff, in an existing folder.

    Returns:
        The files.

    Raises:
        OSError: a file cannot be written.
    """
    written = [_write([*_about(history), *_histories(history)], path)]
    if history.sizes.get("frame", 0) > 1:
        fields = path.with_name(f"{path.stem}-fields{path.suffix}")
        written.append(_write([*_about(history), *_fields(history)], fields))
    return written


def _write(sets: list[dict[str, Any]], path: Path) -> Path:
    """Write sets to a file."""
    import pyuff

    with atomic(path) as temporary:
        file = pyuff.UFF(str(temporary))
        for own in sets:
            file.write_sets([own], "add")
    return path


def _about(history: xr.Dataset) -> Iterator[dict[str, Any]]:
    """Yield the sets that say what the file is, its units, and where its nodes are."""
    yield {
        "type": 151, "model_name": "delam_fem", "description": history.attrs.get("title", "")[:80],
        "db_app": "", "date_db_created": "", "time_db_created": "", "version_db1": 0,
        "version_db2": 0, "file_type": 0, "date_db_saved": "", "time_db_saved": "",
        "program": f"delam_fem {history.attrs.get('delam_fem', '')}", "date_db_written": "",
        "time_db_written": "",
    }  # fmt: skip
    yield {
        "type": 164, "units_code": 1, "units_description": "SI: Meter (newton)", "temp_mode": 1,
        "length": 1.0, "force": 1.0, "temp": 1.0, "temp_offset": 273.15,
    }  # fmt: skip
    x: FloatArray = history["x"].to_numpy()
    n = history.sizes["lamina"]
    yield {
        "type": 15,
        "node_nums": [_node(i, k) for i in range(n) for k in range(x.size)],
        "def_cs": [0] * n * x.size, "disp_cs": [0] * n * x.size, "color": [0] * n * x.size,
        "x": np.tile(x, n).tolist(), "y": [0.0] * n * x.size,
        "z": np.repeat(np.arange(n, dtype=float), x.size).tolist(),
    }  # fmt: skip


def _node(lamina: int, station: int) -> int:
    """Return the number of a node of a lamina."""
    return NODES_PER_LAMINA * (lamina + 1) + station


def _histories(history: xr.Dataset) -> Iterator[dict[str, Any]]:
    """Yield the sets of histories at every step, and those at the ends of the periods."""
    tip = probe_node(history)
    for name in map(str, history.data_vars):
        own = history[name]
        dim = str(own.dims[-1]) if own.dims else ""
        is_time = dim == "time" or dim.endswith("_time")
        if not (is_time or dim == "period") or own.ndim > 2:
            continue
        axis: FloatArray = own[dim].to_numpy().astype(float)
        if own.ndim == 1:
            yield _set(own, name, axis, 0, is_time=is_time)
            continue
        labels = map(str, own[own.dims[0]].to_numpy())
        for i, label in enumerate(labels):
            node = _node(i, tip) if own.dims[0] == "lamina" else 0
            yield _set(own[i], f"{name} {label}", axis, node, is_time=is_time)


def _fields(history: xr.Dataset) -> Iterator[dict[str, Any]]:
    """Yield the displacements and velocities of all nodes at the frames."""
    times: FloatArray = history["frame"].to_numpy()
    for name in ("displacement", "velocity"):
        for i, label in enumerate(map(str, history["lamina"].to_numpy())):
            for k in range(history.sizes["node"]):
                own = history[name][i, :, k]
                yield _set(own, f"{name} {label} node {k}", times, _node(i, k), is_time=True)


def _set(
    own: xr.DataArray, name: str, axis: FloatArray, node: int, *, is_time: bool
) -> dict[str, Any]:
    """Return a set 58 with one history."""
    units = str(own.attrs.get("units", "1"))
    step = float((axis[-1] - axis[0]) / (axis.size - 1)) if axis.size > 1 else 1.0
    return {
        "type": 58, "binary": 0, "func_type": 1 if is_time else 0, "id1": name[:80],
        "id2": str(own.attrs.get("long_name", "NONE"))[:80] or "NONE",
        "id3": f"abscissa from {float(axis[0])!r}",
        "rsp_ent_name": name[:10].replace(" ", "_"), "rsp_node": node, "rsp_dir": LATERAL,
        "ref_ent_name": "NONE", "ref_node": 0, "ref_dir": 0,
        "abscissa_spacing": 1, "x": step * np.arange(axis.size), "abscissa_inc": step,
        "abscissa_spec_data_type": TIME if is_time else GENERAL,
        "abscissa_axis_lab": "time" if is_time else "period",
        "abscissa_axis_units_lab": "s" if is_time else "1",
        "ordinate_spec_data_type": TYPES.get(units, 0),
        "ordinate_axis_lab": name[:20], "ordinate_axis_units_lab": units,
        "orddenom_spec_data_type": 0, "data": own.to_numpy().astype(float),
    }  # fmt: skip
