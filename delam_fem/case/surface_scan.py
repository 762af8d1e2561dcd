"""The points of the scan of a plate: a grid in its middle, or those of a file."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from delam_fem.case.tables import in_si_units, read_columns
from delam_fem.numerics.types import FloatArray
from delam_fem.system.errors import CaseError

if TYPE_CHECKING:
    from delam_fem.case.definition import Case

FEWEST = 9
"""Fewest points of a scan: a grid of 3 by 3 has one second difference along each axis."""
_ROUND_OFF = 1e-9


def scan_points(case: Case) -> FloatArray:
    """Return x and z of the points of the scan of a plate, shape (n, 2) [m].

    Points of a grid follow one another along x, row by row.

    Raises:
        CaseError: there are fewer than 9 points, a file cannot be used, two of its points are one,
            or one is beyond the edges.
    """
    scan = case.scan
    assert scan is not None
    half = case.half_width
    if scan.file is not None:
        label = f"scan file {scan.file}"
        return _within(read_points(scan.file, label), label, case.length, half)
    if scan.points is not None:
        return _within(np.array(scan.points), "scan.points", case.length, half)
    assert scan.spacing is not None
    spacing = scan.spacing if isinstance(scan.spacing, tuple) else (scan.spacing, scan.spacing)
    x = 0.5 * case.length + _centred(case.length, spacing[0])
    z = _centred(2.0 * half, spacing[1])
    if min(x.size, z.size) < 3:
        raise CaseError(
            f"scan.spacing: expected at least 3 points along x and z on {case.length:g} m by "
            f"{2.0 * half:g} m, given {x.size} and {z.size} with a spacing of {spacing[0]:g} m and "
            f"{spacing[1]:g} m"
        )
    grid = np.stack(np.meshgrid(x, z), axis=-1)
    return np.asarray(grid.reshape(-1, 2))


def _centred(extent: float, spacing: float) -> FloatArray:
    """Return equidistant places about 0 that an extent has room for, shape (n,) [m]."""
    n = 1 + math.floor(extent / spacing + _ROUND_OFF)
    return spacing * (np.arange(n) - 0.5 * (n - 1))


def read_points(path: Path, label: str) -> FloatArray:
    """Return x and z of the points of a table, in the order of its rows, shape (n, 2) [m].

    Args:
        path: table with the columns x and z; see `tables.read_columns`.
        label: name of the file in messages.

    Raises:
        CaseError: the table cannot be used, or two of its points are one.
    """
    table = read_columns(path, label, ("x", "z"))
    (x, z), _ = in_si_units(table, ("x", "z"), (("m",), ("m",)), label)
    return _different(np.stack([x, z], axis=1), label)


def _within(points: FloatArray, label: str, length: float, half: float) -> FloatArray:
    """Return points after a check that they are enough, and on the plate; see `scan_points`."""
    if len(points) < FEWEST:
        raise CaseError(f"{label}: expected at least {FEWEST} points, given {len(points)}")
    slack = _ROUND_OFF * length
    x, z = points.T
    for k in np.flatnonzero((x < -slack) | (x > length + slack) | (abs(z) > half + slack)):
        raise CaseError(
            f"{label}: expected x from 0 to {length:g} m and z from {-half:g} to {half:g} m, given "
            f"({x[k]:g}, {z[k]:g}) m"
        )
    return _different(points, label)


def _different(points: FloatArray, label: str) -> FloatArray:
    """Return points after a check that no two are one, shape (n, 2) [m]."""
    _, first, number = np.unique(points, axis=0, return_index=True, return_inverse=True)
    for k in np.flatnonzero(first[number.ravel()] != np.arange(len(points))):
        x, z = points[k]
        raise CaseError(f"{label}: expected different points, given ({x:g}, {z:g}) m again")
    return points
