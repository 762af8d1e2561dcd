"""The deformed laminae as ribbons of hexahedra of their real width and thickness.

x runs along the laminae, y is the direction of the motion, z runs across the width. Sections move
without rotation, which would move the faces by at most a tenth of a millimetre. At rest the top
face of the lowest lamina is at y = 0. The bottom face of every other lamina is the gap above the
top face of the lamina below, so faces touch where the gap is 0.
"""

from __future__ import annotations

import numpy as np
import pyvista as pv
import xarray as xr

from delam_fem.case.definition import Case
from delam_fem.numerics.arrays import FloatArray, IntArray
from delam_fem.results.gaps import of_laminae
from delam_fem.results.schema import by_interface

CORNERS = 4
"""Points per section: (-y, -z), (+y, -z), (+y, +z), (-y, +z)."""


def drawable_frames(history: xr.Dataset) -> xr.Dataset:
    """Return the dataset without the frames of a diverged run that are not finite."""
    fields = np.stack([history[name].to_numpy() for name in ("displacement", "velocity")])
    return history.isel(frame=np.flatnonzero(np.isfinite(fields).all(axis=(0, 1, 3))))


def middle_lines(history: xr.Dataset, case: Case) -> FloatArray:
    """Return y of the middle planes of the laminae at rest, shape (n_laminae, n_nodes) [m]."""
    gaps = by_interface(history["gap0"])
    half = [lamina.thickness / 2.0 for lamina in case.lamina]
    middle = np.empty((len(half), gaps.shape[1]))
    middle[0] = -half[0]
    for i, gap in enumerate(gaps, start=1):
        top_below = middle[i - 1] + half[i - 1]
        middle[i] = top_below + gap + half[i]
    return middle


def rest_points(history: xr.Dataset, case: Case) -> FloatArray:
    """Return the corners of all sections at rest.

    Returns:
        Points, shape (n_laminae, n_nodes, 4 corners, 3) [m].
    """
    x, middle = history["x"].to_numpy(), middle_lines(history, case)
    points = np.empty((*middle.shape, CORNERS, 3))
    points[..., 0] = x[:, None]
    for i, lamina in enumerate(case.lamina):
        half = lamina.thickness / 2.0
        points[i, :, :, 1] = middle[i][:, None] + half * np.array([-1, 1, 1, -1])
        points[i, :, :, 2] = lamina.width / 2.0 * np.array([-1, -1, 1, 1])
    return points


def grid(
    history: xr.Dataset, case: Case, frame: int, *, rest: FloatArray | None = None
) -> pv.UnstructuredGrid:
    """Return the deformed laminae of one frame.

    Point data are displacement [m], velocity [m/s] (vectors), moment [N m] and contact_state;
    cell data is lamina (1, 2, …). The points at rest are the points minus the displacement.

    Args:
        history: with the fields of the frames.
        case: gives widths and thicknesses.
        frame: index of the frame.
        rest: `rest_points`; None to compute them.
    """
    rest = rest_points(history, case) if rest is None else rest
    n_laminae, n_nodes = rest.shape[:2]
    displacement = _lateral(history["displacement"].to_numpy()[:, frame])
    cells = hexahedra(n_laminae, n_nodes)
    result = pv.UnstructuredGrid(
        {pv.CellType.HEXAHEDRON: cells}, rest.reshape(-1, 3) + displacement
    )
    result.point_data["displacement"] = displacement
    result.point_data["velocity"] = _lateral(history["velocity"].to_numpy()[:, frame])
    moment = history["moment"].to_numpy()[:, frame]
    result.point_data["moment"] = np.repeat(moment.ravel(), CORNERS)
    state = of_laminae(by_interface(history["contact_state"])[:, frame])
    result.point_data["contact_state"] = np.repeat(state.ravel(), CORNERS)
    numbers = np.arange(1, n_laminae + 1, dtype=np.int8)
    result.cell_data["lamina"] = np.repeat(numbers, n_nodes - 1)
    return result


def hexahedra(n_laminae: int, n_nodes: int) -> IntArray:
    """Return the cells of all ribbons.

    Returns:
        Point numbers, shape (n_laminae (n_nodes - 1), 8), in VTK's order.
    """
    sections = np.arange(n_laminae * n_nodes * CORNERS).reshape(n_laminae, n_nodes, CORNERS)
    cells: IntArray = np.concatenate([sections[:, :-1], sections[:, 1:]], axis=-1)
    cells = cells.reshape(-1, 2 * CORNERS)
    return cells


def _lateral(values: FloatArray) -> FloatArray:
    """Return values at all nodes of all laminae as vectors along y at all corners."""
    vectors = np.zeros((values.size * CORNERS, 3))
    vectors[:, 1] = np.repeat(values.ravel(), CORNERS)
    return vectors
