"""Read fields/solid.vtkhdf: the bodies of solids at all frames."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np
import numpy.typing as npt

from delam_fem.numerics.arrays import FloatArray, IntArray
from delam_fem.results.fields.vtkhdf import CELL_TYPES

KINDS = {number: kind for kind, number in CELL_TYPES.items()}
"""Kinds of cells by VTK's numbers."""


@dataclass(frozen=True)
class Series:
    """What solid.vtkhdf holds; fields are read frame by frame.

    Attributes:
        path: of the file.
        times: of the frames, shape (n_frames,) [s].
        points: laminae at rest, shape (n_points, 3) [m].
        rise: height by which gaps at rest lift the points, shape (n_points,) [m].
        cells: shape (n_cells, k).
        cell: kind of the cells, one of `vtkhdf.CELL_TYPES`.
        lamina: of each cell, from 1, shape (n_cells,).
        names: of the fields that change.
    """

    path: Path
    times: FloatArray
    points: FloatArray
    rise: FloatArray
    cells: IntArray
    cell: str
    lamina: npt.NDArray[np.int8]
    names: tuple[str, ...]

    @classmethod
    def read(cls, path: Path) -> Series:
        """Read the file.

        Raises:
            OSError: there is no such file, or it is damaged.
        """
        with h5py.File(path) as file:
            root = file["VTKHDF"]
            width = int(root["Offsets"][1])
            return cls(
                path,
                root["Steps/Values"][:],
                root["Points"][:],
                root["PointData/rise"][:],
                root["Connectivity"][:].reshape(-1, width),
                KINDS[int(root["Types"][0])],
                root["CellData/lamina"][:],
                tuple(name for name in root["PointData"] if name != "rise"),
            )

    def field(self, name: str, frame: int) -> FloatArray:
        """Return a field at the points at a frame, shape (n_points,) or (n_points, 3)."""
        n = len(self.points)
        with h5py.File(self.path) as file:
            values = file[f"VTKHDF/PointData/{name}"][frame * n : (frame + 1) * n]
        return np.asarray(values, dtype=np.float64)

    def drawn(self, displacement: FloatArray, thickness: float, deflection: float) -> FloatArray:
        """Return where points are drawn, shape (n_points, 3) [m].

        Args:
            displacement: of the points, shape (n_points, 3) [m].
            thickness: factor of lengths across the laminae.
            deflection: factor of deflections and gaps.
        """
        points = self.points + deflection * displacement
        points[:, 0] += (thickness - 1.0) * deflection * displacement[:, 0]
        y = self.points[:, 1] - self.rise
        points[:, 1] = thickness * y + deflection * (self.rise + displacement[:, 1])
        return points

    @property
    def thickness(self) -> float:
        """Height of all laminae without their gaps [m]."""
        return float(np.ptp(self.points[:, 1] - self.rise))
