"""Write the fields of middle lines and of solids by ADIOS2, where dolfinx has it.

ParaView opens fields.bp with its ADIOS2 VTX reader: one line per lamina in the plane of the motion,
at rest, with displacement [m], velocity [m/s], moment [N m] and contact_state at the nodes. "Warp
by scalar" along y shows the motion. `pictures.write_fields` writes the same fields without ADIOS2.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from delam_fem.model import _dolfinx
from delam_fem.numerics.types import FloatArray, IntArray
from delam_fem.results import diagnostics
from delam_fem.results.fields.vtkhdf import TENSOR_CELLS, VTK_ORDER, Series
from delam_fem.results.schema import by_interface
from delam_fem.system.files import atomic
from delam_fem.system.mpi import MPI

FIELDS = ("displacement", "velocity", "moment")


def write_lines(history: xr.Dataset, directory: str | Path) -> Path | None:
    """Write the fields on the middle lines to fields.bp, in place of an earlier one.

    Args:
        history: dataset with the fields of the frames; see `schema.VARIABLES`.
        directory: the folder.

    Returns:
        The folder fields.bp; None if dolfinx has no ADIOS2 or no frame is finite.
    """
    frames = np.isfinite(np.stack([history[name].to_numpy() for name in FIELDS])).all((0, 1, 3))
    if not _dolfinx.has_adios2 or not frames.any():
        return None
    history = history.isel(frame=frames)
    mesh = _dolfinx.create_mesh(MPI.COMM_SELF, "interval", *lines_at_rest(history))
    fields = {name: np.hstack(list(history[name].to_numpy())) for name in FIELDS}
    states = by_interface(history["contact_state"])
    fields["contact_state"] = np.hstack(list(diagnostics.of_laminae(states).astype(np.float64)))
    path = Path(directory) / "fields.bp"
    with atomic(path) as temporary:
        _dolfinx.write_vtx(
            str(temporary),
            mesh,
            history["frame"].to_numpy(),
            lambda frame: {name: values[frame] for name, values in fields.items()},
        )
    return path


def write_bodies(series: Series, directory: Path) -> Path | None:
    """Write the fields of solid.vtkhdf to solid.bp, in place of an earlier one.

    Args:
        series: content of solid.vtkhdf.
        directory: the folder.

    Returns:
        The folder solid.bp; None if dolfinx has no ADIOS2.
    """
    if not _dolfinx.has_adios2:
        return None
    path = directory / "solid.bp"
    with atomic(path) as temporary:
        _dolfinx.write_vtx(
            str(temporary),
            mesh_of(series),
            series.times,
            lambda frame: {name: series.field(name, frame) for name in series.names},
        )
    return path


def mesh_of(series: Series) -> Any:
    """Return the cells of a series as a mesh of dolfinx; its input nodes are the points."""
    points = series.points[:, : 2 if series.cell in ("triangle", "quadrilateral") else 3]
    cells = series.cells
    if series.cell in TENSOR_CELLS:  # VTK's order is its own inverse
        cells = cells[:, list(VTK_ORDER[points.shape[1]])]
    return _dolfinx.create_mesh(MPI.COMM_SELF, series.cell, points, cells)


def lines_at_rest(history: xr.Dataset) -> tuple[FloatArray, IntArray]:
    """Return the lines of all laminae at rest.

    Returns:
        Nodes, shape (n_laminae n_nodes, 2) [m], and cells, shape (n_laminae (n_nodes - 1), 2).
    """
    x = history["x"].to_numpy()
    positions = diagnostics.rest_positions(history)
    points = np.vstack([np.column_stack([x, y]) for y in positions])
    line = np.column_stack([np.arange(x.size - 1), np.arange(1, x.size)])
    return points, np.vstack([line + i * x.size for i in range(len(positions))]).astype(np.int64)
