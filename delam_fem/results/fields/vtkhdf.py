"""All frames of a run in one file of the format VTKHDF, which ParaView and VTK read.

The mesh is written once. The file is put together in memory, because HDF5 ends the process when the
disk is full.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np
import numpy.typing as npt

from delam_fem.case.atomic import atomic
from delam_fem.numerics.arrays import FloatArray
from delam_fem.results.fields.ribbons import Ribbons, hexahedra, lamina_numbers

VERSION = (2, 0)
"""The first version of the format with steps."""
HEXAHEDRON = 12
"""VTK's number of the type of all cells."""
POINTS_AT_ONCE = 2**15
"""Points of the frames that are put together before they are compressed."""


def write(bodies: Ribbons, times: FloatArray, path: Path) -> Path:
    """Write the ribbons at rest with the fields of all frames.

    Args:
        bodies: with the fields of as many frames as there are times.
        times: of the frames, shape (n_frames,) [s].
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
        _write_mesh(root, bodies)
        _write_point_data(root, bodies, times.size)
        _write_steps(root, times, bodies.rest.size // 3)
        file.flush()
        content = file.id.get_file_image()
    with atomic(path) as temporary, temporary.open("wb") as target:
        target.write(content)
    return path


def _write_mesh(root: h5py.Group, bodies: Ribbons) -> None:
    """Write points, cells and the numbers of the laminae."""
    cells = hexahedra(*bodies.rest.shape[:2])
    numbers = {
        "NumberOfPoints": bodies.rest.size // 3,
        "NumberOfCells": len(cells),
        "NumberOfConnectivityIds": cells.size,
    }
    for name, number in numbers.items():
        root[name] = np.array([number], dtype=np.int64)
    root["Points"] = bodies.rest.reshape(-1, 3)
    root["Connectivity"] = cells.ravel().astype(np.int64)
    root["Offsets"] = np.arange(0, cells.size + 1, cells.shape[1], dtype=np.int64)
    root["Types"] = np.full(len(cells), HEXAHEDRON, dtype=np.uint8)
    root.create_group("CellData")["lamina"] = lamina_numbers(*bodies.rest.shape[:2])


def _write_point_data(root: h5py.Group, bodies: Ribbons, n_frames: int) -> None:
    """Write the fields of all frames one after the other."""
    group, n_points = root.create_group("PointData"), bodies.rest.size // 3
    block = min(n_frames, max(1, POINTS_AT_ONCE // n_points))
    for name, first in bodies.point_data(0).items():
        group.create_dataset(
            name, (n_frames * n_points, *first.shape[1:]), first.dtype,
            chunks=(block * n_points, *first.shape[1:]), compression="gzip", shuffle=True,
        )  # fmt: skip
    for start in range(0, n_frames, block):
        frames = [bodies.point_data(k) for k in range(start, min(start + block, n_frames))]
        rows = slice(start * n_points, (start + len(frames)) * n_points)
        for name in frames[0]:
            group[name][rows] = np.concatenate([data[name] for data in frames])


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
    points, cells = steps.create_group("PointDataOffsets"), steps.create_group("CellDataOffsets")
    for name in root["PointData"]:
        points[name] = own
    cells["lamina"] = offsets()
