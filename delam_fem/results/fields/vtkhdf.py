"""All frames of a run in one file of the format VTKHDF, written and read.

The mesh is written once. The file is put together in memory, because HDF5 ends the process when the
disk is full.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from itertools import permutations, product
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import numpy.typing as npt

from delam_fem.numerics.types import FloatArray, IntArray
from delam_fem.system.files import atomic

TENSOR_CELLS = ("quadrilateral", "hexahedron")
VTK_ORDER = {2: (0, 1, 3, 2), 3: (0, 1, 3, 2, 4, 5, 7, 6)}
"""Corners of quadrilaterals and hexahedra in VTK's order, from their tensor order."""


def subcells(cell: str, degree: int, nodes: FloatArray) -> IntArray:
    """Return the linear cells into which a cell is divided, as nodes, in VTK's order.

    Args:
        cell: "triangle", "quadrilateral", "tetrahedron" or "hexahedron".
        degree: of the cell, so that it has degree + 1 nodes along each edge.
        nodes: their reference coordinates, shape (n_basis, dim).

    Returns:
        Shape (degree**dim, number of vertices of the cell).
    """
    dim = nodes.shape[1]
    places = {tuple(key): k for k, key in enumerate(np.rint(degree * nodes).astype(int).tolist())}
    found = _boxes(degree, dim) if cell in TENSOR_CELLS else _simplices(degree, dim)
    return np.array([[places[corner] for corner in own] for own in found], dtype=np.int64)


Corner = tuple[int, ...]


def _boxes(degree: int, dim: int) -> list[list[Corner]]:
    """Return the boxes of a lattice by the places of their corners."""
    result = []
    for low in product(range(degree), repeat=dim):
        corners = [
            tuple(a + ((number >> axis) & 1) for axis, a in enumerate(low))
            for number in VTK_ORDER[dim]
        ]
        result.append(corners)
    return result


def _simplices(degree: int, dim: int) -> list[list[Corner]]:
    """Return the simplices of a lattice by the places of their corners; all volumes are positive.

    In the coordinates a_k = i_k + i_(k+1) + … the reference simplex is p >= a_1 >= a_2 >= … >= 0,
    which is a union of simplices of Kuhn's division of boxes.
    """
    result = []
    for low, order in product(product(range(degree), repeat=dim), permutations(range(dim))):
        steps = np.zeros((dim + 1, dim), dtype=np.int64)
        for k, axis in enumerate(order):
            steps[k + 1 :, axis] += 1
        sums = np.array(low) + steps
        if np.any(np.diff(sums, axis=1) > 0):
            continue
        corners = sums.copy()
        corners[:, :-1] -= sums[:, 1:]
        if np.linalg.det(corners[1:] - corners[0]) < 0.0:
            corners[[-1, -2]] = corners[[-2, -1]]
        result.append([tuple(corner) for corner in corners.tolist()])
    return result


VERSION = (2, 0)
"""The first version of the format with steps."""
CELL_TYPES = {"triangle": 5, "quadrilateral": 9, "tetrahedron": 10, "hexahedron": 12}
"""VTK's numbers of the types of cells."""
POINTS_AT_ONCE = 2**15
"""Points of the frames that are put together before they are compressed."""


Values = Mapping[str, npt.NDArray[Any]]
"""Fields by name; scalars of shape (n,), vectors of shape (n, 3)."""


@dataclass(frozen=True)
class Grid:
    """Points and cells that stay, and what stays of their fields.

    Attributes:
        points: shape (n_points, 3) [m].
        cells: points of the cells in VTK's order, shape (n_cells, k).
        cell: kind of the cells, one of `CELL_TYPES`.
        cell_data: fields of the cells.
        point_data: fields of the points that are the same in all frames; written once.
    """

    points: FloatArray
    cells: IntArray
    cell: str
    cell_data: Values
    point_data: Values = field(default_factory=dict)


def write(grid: Grid, times: FloatArray, point_data: Callable[[int], Values], path: Path) -> Path:
    """Write a grid with the fields of all frames.

    Args:
        grid: the grid.
        times: of the frames, shape (n_frames,) [s].
        point_data: fields of the points at a frame, the same names and types at all frames.
        path: of the file, in an existing folder.

    Returns:
        The file.

    Raises:
        OSError: the file cannot be written.
    """
    with h5py.File("memory", "w", driver="core", backing_store=False) as file:
        root = file.create_group("VTKHDF")
        root.attrs["Version"] = VERSION
        root.attrs.create("Type", b"UnstructuredGrid", dtype=h5py.string_dtype("ascii", 16))
        _write_mesh(root, grid)
        _write_point_data(root, len(grid.points), times.size, point_data)
        _write_steps(root, times, len(grid.points))
        _write_fixed(root, grid, times.size)
        file.flush()
        content = file.id.get_file_image()
    with atomic(path) as temporary, temporary.open("wb") as target:
        target.write(content)
    return path


def _write_mesh(root: h5py.Group, grid: Grid) -> None:
    """Write points and cells."""
    cells = grid.cells
    numbers = {
        "NumberOfPoints": len(grid.points),
        "NumberOfCells": len(cells),
        "NumberOfConnectivityIds": cells.size,
    }
    for name, number in numbers.items():
        root[name] = np.array([number], dtype=np.int64)
    root["Points"] = grid.points
    root["Connectivity"] = cells.ravel().astype(np.int64)
    root["Offsets"] = np.arange(0, cells.size + 1, cells.shape[1], dtype=np.int64)
    root["Types"] = np.full(len(cells), CELL_TYPES[grid.cell], dtype=np.uint8)


def _write_point_data(
    root: h5py.Group, n_points: int, n_frames: int, point_data: Callable[[int], Values]
) -> None:
    """Write the fields of all frames one after the other."""
    group, block = root.create_group("PointData"), min(n_frames, max(1, POINTS_AT_ONCE // n_points))
    for start in range(0, n_frames, block):
        frames = [point_data(k) for k in range(start, min(start + block, n_frames))]
        rows = slice(start * n_points, (start + len(frames)) * n_points)
        for name, first in frames[0].items():
            if start == 0:
                group.create_dataset(
                    name, (n_frames * n_points, *first.shape[1:]), first.dtype,
                    chunks=(block * n_points, *first.shape[1:]), compression="gzip", shuffle=True,
                )  # fmt: skip
            group[name][rows] = np.concatenate([data[name] for data in frames])


def _write_fixed(root: h5py.Group, grid: Grid, n_frames: int) -> None:
    """Write the fields that stay; every frame has them at the same place."""
    for where, fields in (("CellData", grid.cell_data), ("PointData", grid.point_data)):
        group = root.require_group(where)
        offsets = root["Steps"].require_group(f"{where}Offsets")
        for name, values in fields.items():
            group[name] = values
            offsets[name] = np.zeros(n_frames, dtype=np.int64)


def _write_steps(root: h5py.Group, times: FloatArray, n_points: int) -> None:
    """Write the times and where the data of each of them begins; the mesh is that of step 0."""
    steps, n_frames = root.create_group("Steps"), times.size
    steps.attrs["NSteps"] = n_frames
    steps["Values"] = times

    def offsets(*shape: int) -> npt.NDArray[Any]:
        return np.zeros((n_frames, *shape), dtype=np.int64)

    steps["PartOffsets"], steps["PointOffsets"] = offsets(), offsets()
    steps["NumberOfParts"] = offsets() + 1
    steps["CellOffsets"], steps["ConnectivityIdOffsets"] = offsets(1), offsets(1)
    own = n_points * np.arange(n_frames, dtype=np.int64)
    points = steps.create_group("PointDataOffsets")
    for name in root["PointData"]:
        points[name] = own


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
