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
from delam_fem.system.errors import CaseError, reason_of
from delam_fem.system.files import atomic
from delam_fem.system.footprint import bounded
from delam_fem.system.hdf5 import opened

TENSOR_CELLS = ("quadrilateral", "hexahedron")
VTK_ORDER = {2: (0, 1, 3, 2), 3: (0, 1, 3, 2, 4, 5, 7, 6)}
"""Corners of quadrilaterals and hexahedra in VTK's order, from their tensor order."""


def subcells(cell: str, degree: int, nodes: FloatArray) -> IntArray:
    """Return the linear cells into which a cell is divided, as nodes, in VTK's order.

    Args:
        cell: "triangle", "quadrilateral", "tetrahedron" or "hexahedron".
        degree: degree of the cell, which has degree + 1 nodes along each edge.
        nodes: reference coordinates of the nodes, shape (n_basis, dim).

    Returns:
        Shape (degree**dim, number of vertices of the cell).
    """
    dim = nodes.shape[1]
    places = {tuple(key): k for k, key in enumerate(np.rint(degree * nodes).astype(int).tolist())}
    pieces = _boxes(degree, dim) if cell in TENSOR_CELLS else _simplices(degree, dim)
    return np.array([[places[corner] for corner in piece] for piece in pieces], dtype=np.int64)


Corner = tuple[int, ...]


def _boxes(degree: int, dim: int) -> list[list[Corner]]:
    """Return the boxes of a lattice by the places of their corners."""
    return [
        [tuple(a + ((n >> axis) & 1) for axis, a in enumerate(low)) for n in VTK_ORDER[dim]]
        for low in product(range(degree), repeat=dim)
    ]


def _simplices(degree: int, dim: int) -> list[list[Corner]]:
    """Return the simplices of a lattice by the places of their corners; all volumes are positive.

    In the coordinates a_k = i_k + i_(k+1) + … the reference simplex is p >= a_1 >= a_2 >= … >= 0
    (p: degree), which is a union of simplices of Kuhn's division of boxes: each goes from the
    lowest corner of a box to the highest, one axis after the other.
    """
    result = []
    for low, order in product(product(range(degree), repeat=dim), permutations(range(dim))):
        sums = np.array(low) + np.tri(dim + 1, dim, -1, dtype=np.int64)[:, np.argsort(order)]
        if np.any(np.diff(sums, axis=1) > 0):
            continue  # outside the reference simplex
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
"""Number of points of successive frames that are compressed together."""
MOST_CHUNK = 2**30
"""Largest array that is one block of HDF5 [bytes]; a block has less than 4 GB."""


Values = Mapping[str, npt.NDArray[Any]]
"""Fields by name; scalars of shape (n,), vectors of shape (n, 3)."""


@dataclass(frozen=True)
class Grid:
    """Points and cells that are the same in all frames, with the fields that do not change.

    Attributes:
        points: places of the points, shape (n_points, 3) [m].
        cells: numbers of the points of each cell in VTK's order, shape (n_cells, k).
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
    """Write a grid with the fields of all frames to a VTKHDF file.

    Args:
        grid: the grid.
        times: times of the frames, shape (n_frames,) [s].
        point_data: function that returns the fields of the points at a frame, with the same names
            and types at all frames.
        path: the file.

    Returns:
        The file.

    Raises:
        OSError: the file cannot be written.
    """
    with h5py.File("memory", "w", driver="core", backing_store=False) as file:
        root = file.create_group("VTKHDF")
        root.attrs["Version"] = VERSION
        root.attrs.create("Type", b"UnstructuredGrid", dtype=h5py.string_dtype("ascii", 16))
        for name, values in _fixed(grid, times).items():
            _write_checked(root, name, values)
        root["Steps"].attrs["NSteps"] = times.size
        _write_point_data(root, len(grid.points), times.size, point_data)
        file.flush()
        content = file.id.get_file_image()
    with atomic(path) as temporary, temporary.open("wb") as target:
        target.write(content)
    return path


def _write_checked(root: h5py.Group, name: str, values: npt.NDArray[Any]) -> None:
    """Write an array with a sum that HDF5 checks when it is read (Fletcher-32)."""
    is_one = 0 < values.nbytes < MOST_CHUNK
    chunks = values.shape if is_one else bool(values.size) or None
    root.create_dataset(name, data=values, chunks=chunks, fletcher32=bool(values.size))


def _fixed(grid: Grid, times: FloatArray) -> Values:
    """Return all that is the same at every frame, and where a frame finds it: at the beginning."""
    cells = grid.cells
    first = np.zeros(times.size, dtype=np.int64)
    return {
        "NumberOfPoints": np.array([len(grid.points)], dtype=np.int64),
        "NumberOfCells": np.array([len(cells)], dtype=np.int64),
        "NumberOfConnectivityIds": np.array([cells.size], dtype=np.int64),
        "Points": grid.points,
        "Connectivity": cells.ravel().astype(np.int64),
        "Offsets": np.arange(0, cells.size + 1, cells.shape[1], dtype=np.int64),
        "Types": np.full(len(cells), CELL_TYPES[grid.cell], dtype=np.uint8),
        **{f"CellData/{name}": values for name, values in grid.cell_data.items()},
        **{f"PointData/{name}": values for name, values in grid.point_data.items()},
        "Steps/Values": times,
        "Steps/NumberOfParts": first + 1,
        "Steps/PartOffsets": first,
        "Steps/PointOffsets": first,
        "Steps/CellOffsets": first[:, None],
        "Steps/ConnectivityIdOffsets": first[:, None],
        **{f"Steps/CellDataOffsets/{name}": first for name in grid.cell_data},
        **{f"Steps/PointDataOffsets/{name}": first for name in grid.point_data},
    }


def _write_point_data(
    root: h5py.Group, n_points: int, n_frames: int, point_data: Callable[[int], Values]
) -> None:
    """Write the fields of all frames one after the other, and where each frame begins."""
    group = root.require_group("PointData")
    block = min(n_frames, max(1, POINTS_AT_ONCE // n_points))
    for start in range(0, n_frames, block):
        frames = [point_data(k) for k in range(start, min(start + block, n_frames))]
        rows = slice(start * n_points, (start + len(frames)) * n_points)
        for name, first in frames[0].items():
            if start == 0:
                group.create_dataset(
                    name, (n_frames * n_points, *first.shape[1:]), first.dtype,
                    chunks=(block * n_points, *first.shape[1:]), compression="gzip", shuffle=True,
                    fletcher32=True,
                )  # fmt: skip
                begins = n_points * np.arange(n_frames, dtype=np.int64)
                _write_checked(root, f"Steps/PointDataOffsets/{name}", begins)
            group[name][rows] = np.concatenate([data[name] for data in frames])


NEEDED = ("displacement", "velocity")
"""Fields that all files have."""
OF_SOLIDS = ("stress_xx", "von_mises")
"""Further fields that pictures of a solid show; those of a reduced plate show its opening."""
OPENING = "opening"


def _damaged(path: Path, error: Exception) -> CaseError:
    """Return the error for a file that is damaged or of another kind."""
    return CaseError(
        f"{path}: damaged, or not the fields of a solid ({reason_of(error)}); compute the run again"
    )


KINDS = {number: kind for kind, number in CELL_TYPES.items()}
"""Kinds of cells by VTK's numbers."""


@dataclass(frozen=True)
class Series:
    """The content of solid.vtkhdf; fields are read frame by frame.

    Attributes:
        path: the file.
        times: times of the frames, shape (n_frames,) [s].
        points: laminae at rest, shape (n_points, 3) [m].
        rise: height by which gaps at rest lift the points, shape (n_points,) [m].
        cells: numbers of the points of each cell, shape (n_cells, k).
        cell: kind of the cells, one of `CELL_TYPES`.
        lamina: number of the lamina of each cell, from 1, shape (n_cells,).
        names: names of the fields that change.
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
        """Read the mesh, the times and the names of the fields from a file.

        Raises:
            CaseError: there is no such file, it is damaged, or it is of another kind.
        """
        try:
            with bounded(path), opened(path) as file:
                root = file["VTKHDF"]
                series = cls(
                    path,
                    root["Steps/Values"][:],
                    root["Points"][:],
                    root["PointData/rise"][:],
                    root["Connectivity"][:].reshape(-1, int(root["Offsets"][1])),
                    KINDS[int(root["Types"][0])],
                    root["CellData/lamina"][:],
                    tuple(name for name in root["PointData"] if name != "rise"),
                )
                shapes = {name: root[f"PointData/{name}"].shape for name in series.names}
            series._require(shapes)
        except CaseError:
            raise
        except Exception as error:  # HDF5 raises whatever it pleases
            raise _damaged(path, error) from None
        return series

    def _require(self, shapes: Mapping[str, tuple[int, ...]]) -> None:
        """Require that the arrays fit one another and are finite.

        Args:
            shapes: shapes of the fields of all frames, by their names.

        Raises:
            ValueError: they do not.
        """
        n = len(self.points)
        vertices = {"triangle": 3, "quadrilateral": 4, "tetrahedron": 4, "hexahedron": 8}
        expected: dict[str, tuple[npt.NDArray[Any], tuple[int, ...], str]] = {
            "Points": (self.points, (n, 3), "f"),
            "rise": (self.rise, (n,), "f"),
            "Steps/Values": (self.times, (self.times.size,), "f"),
            "Connectivity": (self.cells, (len(self.cells), vertices[self.cell]), "iu"),
            "lamina": (self.lamina, (len(self.cells),), "iu"),
        }
        for name, (values, shape, kinds) in expected.items():
            if values.shape != shape or values.dtype.kind not in kinds or not values.size:
                raise ValueError(f"{name} of another size or type")
            if not np.isfinite(values).all():
                raise ValueError(f"{name} with numbers that are not finite")
        if self.cells.min() < 0 or self.cells.max() >= n or self.lamina.min() < 0:
            raise ValueError("cells with corners that do not exist")
        for name in (*NEEDED, *((OPENING,) if OPENING in shapes else OF_SOLIDS)):
            if shapes.get(name, ())[:1] != (n * self.times.size,):
                raise ValueError(f"no {name}, or of another size")
        for name, (rows, *components) in shapes.items():
            if rows != n * self.times.size or components not in ([], [3]):
                raise ValueError(f"{name[:40]!r} of another size")

    def field(self, name: str, frame: int) -> FloatArray:
        """Return a field at the points at a frame, shape (n_points,) or (n_points, 3).

        Raises:
            CaseError: the file is damaged.
        """
        n = len(self.points)
        try:
            with h5py.File(self.path) as file:
                values = file[f"VTKHDF/PointData/{name}"][frame * n : (frame + 1) * n]
            field = np.asarray(values, dtype=np.float64)
            if not np.isfinite(field).all():
                raise ValueError(f"{name} with numbers that are not finite")
        except Exception as error:  # HDF5 raises whatever it pleases
            raise _damaged(self.path, error) from None
        return field

    def drawn(self, displacement: FloatArray, thickness: float, deflection: float) -> FloatArray:
        """Return the places at which a picture shows the points, shape (n_points, 3) [m].

        Args:
            displacement: displacements of the points, shape (n_points, 3) [m].
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
