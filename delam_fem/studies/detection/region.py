"""The region of a plate that an index marks: its outlines and its area.

The points are joined to triangles (Delaunay). A quantity is linear within each, and the region is
where it exceeds 1. Regions of triangles that share an edge have the same corners on it, so the
outline of their union is made of the sides that belong to one of them alone.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from delam_fem.api import BoolArray, FloatArray, IntArray

LONGEST = 3.0
"""Triangles with a side longer than this in median sides span holes of a scan, and are left out."""


@dataclass(frozen=True)
class Region:
    """A part of the surface of a plate.

    Attributes:
        outlines: corners of each piece, counter-clockwise in the plane of x and z,
            each of shape (n, 2) [m].
    """

    outlines: tuple[FloatArray, ...] = ()

    @property
    def area(self) -> float:
        """Area [m2]."""
        return float(sum(area_of(outline) for outline in self.outlines))

    def contains(self, x: FloatArray, z: FloatArray) -> BoolArray:
        """Return whether points are within the region, the shape of x.

        Args:
            x: positions along [m].
            z: positions across, the shape of x [m].
        """
        inside = np.zeros(np.shape(x), dtype=bool)
        for outline in self.outlines:
            inside |= _is_within(outline, x, z)
        return inside

    def overlap(self, other: Region, *, cells: int = 200) -> float:
        """Return the common area over that of both together [-]; 0 where one of them is empty.

        Args:
            other: another region.
            cells: number of cells along each axis in which areas are counted.
        """
        corners = [*self.outlines, *other.outlines]
        if not (self.outlines and other.outlines):
            return 0.0
        low = np.concatenate(corners).min(axis=0)
        high = np.concatenate(corners).max(axis=0)
        steps = (np.arange(cells) + 0.5) / cells
        x, z = np.meshgrid(*(a + (b - a) * steps for a, b in zip(low, high, strict=True)))
        is_here = self.contains(x, z)
        is_there = other.contains(x, z)
        either = np.count_nonzero(is_here | is_there)
        return float(np.count_nonzero(is_here & is_there) / max(either, 1))


def area_of(outline: FloatArray) -> float:
    """Return the area within an outline, negative of a clockwise one [m2]."""
    x, z = outline.T
    return float(0.5 * np.sum(x * np.roll(z, -1) - np.roll(x, -1) * z))


def _is_within(outline: FloatArray, x: FloatArray, z: FloatArray) -> BoolArray:
    """Return whether points are within an outline: a line from each crosses it an odd number."""
    inside = np.zeros(np.shape(x), dtype=bool)
    for (x1, z1), (x2, z2) in zip(outline, np.roll(outline, -1, axis=0), strict=True):
        is_between = (z1 > z) != (z2 > z)
        if z1 != z2:
            inside ^= is_between & (x < x1 + (z - z1) * (x2 - x1) / (z2 - z1))
    return inside


Corner = tuple[int, int]
"""A point (k, k), or the place between two points where the quantity is 1."""


def marked_region(x: FloatArray, z: FloatArray, ratio: FloatArray) -> Region:
    """Return the convex hulls of the pieces in which a quantity exceeds 1.

    As along a beam, what lies between marked points is filled. Hulls that meet are one piece.

    Args:
        x: positions along, shape (n,) [m].
        z: positions across, shape (n,) [m].
        ratio: the quantity at the points, shape (n,).
    """
    if not (ratio > 1.0).any():
        return Region()
    sides: set[tuple[Corner, Corner]] = set()
    for triangle in _triangles(x, z).tolist():
        corners = _clipped(triangle, ratio)
        for side in zip(corners, corners[1:] + corners[:1], strict=True):
            if side[::-1] in sides:
                sides.remove(side[::-1])
            else:
                sides.add(side)
    at = np.stack([x, z], axis=1)

    def place(corner: Corner) -> FloatArray:
        a, b = corner
        if a == b:
            return np.asarray(at[a])
        share = (1.0 - ratio[a]) / (ratio[b] - ratio[a])
        return np.asarray(at[a] + share * (at[b] - at[a]))

    outlines = [np.array([place(corner) for corner in loop]) for loop in _loops(sides)]
    return Region(tuple(_hulls([loop for loop in outlines if area_of(loop) > 0.0])))


def _hulls(outlines: list[FloatArray]) -> list[FloatArray]:
    """Return the convex hulls of outlines, those that meet joined."""
    from scipy.spatial import ConvexHull

    hulls: list[FloatArray] = []
    waiting = [outline[ConvexHull(outline).vertices] for outline in outlines]
    while waiting:
        hull = waiting.pop()
        for k, other in enumerate(hulls):
            if _is_within(hull, *other.T).any() or _is_within(other, *hull.T).any():
                both = np.concatenate([hull, hulls.pop(k)])
                waiting.append(both[ConvexHull(both).vertices])
                break
        else:
            hulls.append(hull)
    return hulls


def _triangles(x: FloatArray, z: FloatArray) -> IntArray:
    """Return the triangles between points, counter-clockwise, shape (m, 3)."""
    from scipy.spatial import Delaunay

    at = np.stack([x, z], axis=1)
    triangles = Delaunay(at).simplices
    corners = at[triangles]
    sides = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
    triangles = triangles[sides.max(axis=1) <= LONGEST * np.median(sides)]
    (ax, az), (bx, bz) = ((at[triangles[:, k]] - at[triangles[:, 0]]).T for k in (1, 2))
    is_clockwise = ax * bz - az * bx < 0.0
    triangles[is_clockwise] = triangles[is_clockwise][:, ::-1]
    return np.asarray(triangles)


def _clipped(triangle: Sequence[int], ratio: FloatArray) -> list[Corner]:
    """Return the corners of the part of a triangle that exceeds 1, in the order of its own."""
    corners: list[Corner] = []
    for a, b in zip(triangle, [*triangle[1:], triangle[0]], strict=True):
        if ratio[a] > 1.0:
            corners.append((a, a))
        if (ratio[a] > 1.0) != (ratio[b] > 1.0):
            corners.append((min(a, b), max(a, b)))
    return corners


def _loops(sides: set[tuple[Corner, Corner]]) -> list[list[Corner]]:
    """Return sides joined to closed loops; what turns about a hole is clockwise."""
    behind: dict[Corner, list[Corner]] = defaultdict(list)
    for first, last in sorted(sides):
        behind[first].append(last)
    loops = []
    while behind:
        start = next(iter(behind))
        loop = []
        corner = start
        while True:
            loop.append(corner)
            following = behind[corner]
            corner_after = following.pop()
            if not following:
                del behind[corner]
            corner = corner_after
            if corner == start:
                break
        loops.append(loop)
    return loops
