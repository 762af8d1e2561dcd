"""The fields on the middle lines of the laminae, written by ADIOS2 where dolfinx has it.

ParaView opens fields.bp with its ADIOS2 VTX reader: two lines in the plane of the motion, at rest,
with displacement [m], velocity [m/s], moment [N m] and contact_state at the nodes. "Warp by scalar"
along y shows the motion. fields.pvd (vtk.py) holds the same on bodies, and needs no ADIOS2.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import xarray as xr
from mpi4py import MPI

from delam_fem.case.atomic import atomic
from delam_fem.model import _dolfinx
from delam_fem.numerics.arrays import FloatArray, IntArray

FIELDS = ("displacement", "velocity", "moment")


def write_lines(history: xr.Dataset, directory: str | Path) -> Path | None:
    """Write fields.bp in place of an earlier one.

    Args:
        history: with the fields of the frames; see results.py.
        directory: exists.

    Returns:
        The folder fields.bp; None where dolfinx has no ADIOS2 or no frame is finite.
    """
    frames = np.isfinite(np.stack([history[name].to_numpy() for name in FIELDS])).all((0, 1, 3))
    if not _dolfinx.has_adios2 or not frames.any():
        return None
    history = history.isel(frame=frames)
    mesh = _dolfinx.create_interval_mesh(MPI.COMM_SELF, *two_lines(history))
    fields = {name: by_node(history[name].to_numpy()) for name in FIELDS}
    state = history["contact_state"].to_numpy().astype(np.float64)
    fields["contact_state"] = np.hstack([state, state])
    path = Path(directory) / "fields.bp"
    with atomic(path) as temporary:
        _dolfinx.write_vtx(str(temporary), mesh, history["frame"].to_numpy(), fields)
    return path


def two_lines(history: xr.Dataset) -> tuple[FloatArray, IntArray]:
    """Return the nodes at rest, shape (2 n_nodes, 2) [m], and the cells of both laminae."""
    x, gap = history["x"].to_numpy(), history["gap0"].to_numpy()
    points = np.vstack([np.column_stack([x, 0.0 * gap]), np.column_stack([x, gap])])
    line = np.column_stack([np.arange(x.size - 1), np.arange(1, x.size)])
    return points, np.vstack([line, line + x.size]).astype(np.int64)


def by_node(values: FloatArray) -> FloatArray:
    """Return (2 laminae, frames, nodes) as (frames, nodes of both)."""
    return np.hstack(list(values))
