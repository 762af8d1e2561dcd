"""The laminae as ribbons of hexahedra of their real width and thickness.

x runs along the laminae, y is the direction of the motion, z runs across the width. Sections move
without rotation, which would move the faces by at most a tenth of a millimetre. At rest the top
face of the lowest lamina is at y = 0. The bottom face of every other lamina is the gap above the
top face of the lamina below, so faces touch where the gap is 0.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import meshio
import numpy as np
import numpy.typing as npt
import xarray as xr

from delam_fem.case.definition import Case
from delam_fem.numerics.arrays import FloatArray, IntArray
from delam_fem.results.diagnostics import of_laminae
from delam_fem.results.fields import derived
from delam_fem.results.fields.vtkhdf import Grid
from delam_fem.results.schema import by_interface

CORNERS = 4
"""Points per section: (-y, -z), (+y, -z), (+y, +z), (-y, +z)."""
UPWARDS = np.array([-1.0, 1.0, 1.0, -1.0])
"""Sign of y at these points, seen from the middle plane."""


def drawable_frames(history: xr.Dataset) -> xr.Dataset:
    """Return the dataset without the frames of a diverged run that are not finite."""
    fields = np.stack([history[name].to_numpy() for name in ("displacement", "velocity")])
    return history.isel(frame=np.flatnonzero(np.isfinite(fields).all(axis=(0, 1, 3))))


def middle_lines(history: xr.Dataset, case: Case, enlarged: float = 1.0) -> FloatArray:
    """Return y of the middle planes of the laminae at rest, shape (n_laminae, n_nodes) [m].

    Gaps are `enlarged` times as large as they are; where displacements are drawn larger, gaps must
    be as well, or laminae would seem to pass through one another.
    """
    gaps = by_interface(history["gap0"])
    half = [lamina.thickness / 2.0 for lamina in case.lamina]
    middle = np.empty((len(half), gaps.shape[1]))
    middle[0] = -half[0]
    for i, gap in enumerate(gaps, start=1):
        top_below = middle[i - 1] + half[i - 1]
        middle[i] = top_below + enlarged * gap + half[i]
    return middle


def rest_points(history: xr.Dataset, case: Case, enlarged: float = 1.0) -> FloatArray:
    """Return the corners of all sections at rest; see `middle_lines`.

    Returns:
        Points, shape (n_laminae, n_nodes, 4 corners, 3) [m].
    """
    x, middle = history["x"].to_numpy(), middle_lines(history, case, enlarged)
    points = np.empty((*middle.shape, CORNERS, 3))
    points[..., 0] = x[:, None]
    for i, lamina in enumerate(case.lamina):
        half = lamina.thickness / 2.0
        points[i, :, :, 1] = middle[i][:, None] + half * UPWARDS
        points[i, :, :, 2] = lamina.width / 2.0 * np.array([-1, -1, 1, 1])
    return points


@dataclass(frozen=True)
class Ribbons:
    """The laminae at rest, and what is known of them at every frame.

    Attributes:
        rest: corners of all sections, shape (n_laminae, n_nodes, 4 corners, 3) [m].
        height: of the corners above the middle planes, shape (n_laminae, 4 corners) [m].
        vectors: lateral components of vector fields, each (n_laminae, n_frames, n_nodes).
        scalars: other fields, each (n_laminae, n_frames, n_nodes).
    """

    rest: FloatArray
    height: FloatArray
    vectors: Mapping[str, FloatArray]
    scalars: Mapping[str, npt.NDArray[Any]]

    @classmethod
    def of(cls, history: xr.Dataset, case: Case, enlarged: float = 1.0) -> Ribbons:
        """Return the ribbons of a run with the fields of its frames; see `middle_lines`."""
        half = np.array([lamina.thickness / 2.0 for lamina in case.lamina])
        return cls(
            rest_points(history, case, enlarged),
            half[:, None] * UPWARDS,
            {name: history[name].to_numpy() for name in ("displacement", "velocity")},
            {
                "moment": history["moment"].to_numpy(),
                "curvature": derived.curvature(history),
                "gap": derived.gap_of_laminae(history),
                "contact_state": of_laminae(by_interface(history["contact_state"])),
                "impulse": derived.impulse_of_laminae(history),
                "contact_force": derived.contact_force_of_laminae(history, case),
            },
        )

    def point_data(self, frame: int) -> dict[str, npt.NDArray[Any]]:
        """Return all fields at all points, scalars of shape (n,), vectors of shape (n, 3).

        displacement [m], velocity [m/s], moment [N m], curvature [1/m], gap [m], contact_state [-],
        impulse since the frame before [N s], contact_force of a pair [N], and the axial strain of
        bending, minus the height above the middle plane times the curvature [-].
        """
        data = {name: _lateral(values[:, frame]) for name, values in self.vectors.items()}
        for name, values in self.scalars.items():
            data[name] = np.repeat(values[:, frame].ravel(), CORNERS)
        curvature = self.scalars["curvature"][:, frame, :, None]
        data["strain"] = (-self.height[:, None, :] * curvature).ravel()
        return data

    @property
    def mesh(self) -> Grid:
        """The laminae at rest as points and cells."""
        shape = self.rest.shape[:2]
        cells = hexahedra(*shape)
        return Grid(
            self.rest.reshape(-1, 3), cells, "hexahedron", {"lamina": lamina_numbers(*shape)}
        )

    def grid(self, frame: int) -> meshio.Mesh:
        """Return the laminae at rest with the fields of one frame.

        "Warp by vector" with the displacement shows the deformed laminae. Cell data is lamina (1,
        2, …).
        """
        mesh = self.mesh
        of_cells = {name: [values] for name, values in mesh.cell_data.items()}
        return meshio.Mesh(mesh.points, [(mesh.cell, mesh.cells)], self.point_data(frame), of_cells)


def lamina_numbers(n_laminae: int, n_nodes: int) -> npt.NDArray[np.int8]:
    """Return the number of the lamina of each cell of all ribbons, from 1."""
    numbers = np.arange(1, n_laminae + 1, dtype=np.int8)
    return np.repeat(numbers, n_nodes - 1)


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
