"""The deformed laminae as ribbons of hexahedra of their real width and thickness.

x runs along the laminae, y is the direction of the motion, z runs across the width. Sections move
as a whole: their rotation, which moves the faces by at most a tenth of a millimetre, is not drawn.
Lamina 1 is straight at rest and lamina 2 the gap away from it, since only the gap enters the
dynamics; where the gap is 0, their faces touch.
"""

from __future__ import annotations

import numpy as np
import pyvista as pv
import xarray as xr

from delam_fem.case.definition import Case
from delam_fem.numerics.arrays import FloatArray, IntArray

CORNERS = 4
"""Points per section: (-y, -z), (+y, -z), (+y, +z), (-y, +z)."""


def drawable_frames(history: xr.Dataset) -> xr.Dataset:
    """Return the dataset without frames that are not finite, the last of a diverged run."""
    fields = np.stack([history[name].to_numpy() for name in ("displacement", "velocity")])
    return history.isel(frame=np.flatnonzero(np.isfinite(fields).all(axis=(0, 1, 3))))


def rest_points(history: xr.Dataset, case: Case) -> FloatArray:
    """Return the corners of all sections at rest.

    Returns:
        Points, shape (2 laminae, n_nodes, 4 corners, 3) [m].
    """
    x = history["x"].to_numpy()
    middle = np.stack([np.zeros(x.size), history["gap0"].to_numpy()])
    points = np.empty((2, x.size, CORNERS, 3))
    for i, lamina in enumerate(case.lamina):
        half = lamina.thickness / 2.0
        outwards = (-half, half)[i]  # faces, not middle planes, are the gap apart
        points[i, :, :, 0] = x[:, None]
        points[i, :, :, 1] = (middle[i] + outwards)[:, None] + half * np.array([-1, 1, 1, -1])
        points[i, :, :, 2] = lamina.width / 2.0 * np.array([-1, -1, 1, 1])
    return points


def grid(
    history: xr.Dataset, case: Case, frame: int, *, rest: FloatArray | None = None
) -> pv.UnstructuredGrid:
    """Return the deformed laminae of one frame.

    Point data are displacement [m], velocity [m/s] (vectors), moment [N m] and contact_state;
    cell data is lamina (1 or 2). The points at rest are the points minus the displacement.

    Args:
        history: with the fields of the frames.
        case: gives widths and thicknesses.
        frame: index of the frame.
        rest: `rest_points`, where they are at hand.
    """
    rest = rest_points(history, case) if rest is None else rest
    n_nodes = rest.shape[1]
    displacement = _lateral(history["displacement"].to_numpy()[:, frame])
    cells = hexahedra(n_nodes)
    result = pv.UnstructuredGrid(
        {pv.CellType.HEXAHEDRON: cells}, rest.reshape(-1, 3) + displacement
    )
    result.point_data["displacement"] = displacement
    result.point_data["velocity"] = _lateral(history["velocity"].to_numpy()[:, frame])
    moment = history["moment"].to_numpy()[:, frame]
    result.point_data["moment"] = np.repeat(moment.ravel(), CORNERS)
    state = history["contact_state"].to_numpy()[frame]
    result.point_data["contact_state"] = np.repeat(np.tile(state, 2), CORNERS)
    result.cell_data["lamina"] = np.repeat(np.array([1, 2], dtype=np.int8), n_nodes - 1)
    return result


def hexahedra(n_nodes: int) -> IntArray:
    """Return the cells of both ribbons.

    Returns:
        Point numbers, shape (2 (n_nodes - 1), 8), in VTK's order.
    """
    sections = np.arange(2 * n_nodes * CORNERS).reshape(2, n_nodes, CORNERS)
    cells: IntArray = np.concatenate([sections[:, :-1], sections[:, 1:]], axis=-1)
    cells = cells.reshape(-1, 2 * CORNERS)
    return cells


def _lateral(values: FloatArray) -> FloatArray:
    """Return nodal values of shape (2, n_nodes) as vectors along y at all corners."""
    vectors = np.zeros((values.size * CORNERS, 3))
    vectors[:, 1] = np.repeat(values.ravel(), CORNERS)
    return vectors
