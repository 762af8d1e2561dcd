"""Where straight lines meet the facets of a mesh."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from delam_fem.model.solids.cells import INSIDE, overshoot, shape_functions
from delam_fem.numerics.arrays import BoolArray, FloatArray, IntArray

FACET_OF = {
    "triangle": "interval",
    "quadrilateral": "interval",
    "tetrahedron": "triangle",
    "hexahedron": "quadrilateral",
}
"""Kind of the facets of a cell."""
_ITERATIONS = 30
_CONVERGED = 1e-13
_PARALLEL = 1e-9
"""Sine of the angle below which a line does not meet a facet but runs along it."""
_MOST_CANDIDATES = 1_000_000


@dataclass(frozen=True)
class Hits:
    """Meetings of lines and facets.

    Attributes:
        line: number of the line, shape (m,).
        facet: number of the facet, shape (m,).
        distance: from the origin of the line, along its direction, shape (m,) [m].
        local: reference coordinates within the facet, shape (m, dim - 1).
    """

    line: IntArray
    facet: IntArray
    distance: FloatArray
    local: FloatArray


def meetings(corners: FloatArray, origins: FloatArray, directions: FloatArray, facet: str) -> Hits:
    """Return all meetings of lines and facets, line by line.

    Args:
        corners: of the facets, shape (n, n_vertices, dim) [m].
        origins: of the lines, shape (k, dim) [m].
        directions: unit vectors, shape (k, dim).
        facet: "interval", "triangle" or "quadrilateral".
    """
    found = [Hits(*(np.zeros(0, dtype=np.int64),) * 2, np.zeros(0), np.zeros((0, 1)))]
    for line, number in _near(corners, origins, directions):
        local, distance, is_met = _meet(corners[number], origins[line], directions[line], facet)
        found.append(Hits(line[is_met], number[is_met], distance[is_met], local[is_met]))
    if len(found) == 1:
        return found[0]
    parts = [[getattr(one, name) for one in found[1:]] for name in Hits.__dataclass_fields__]
    return Hits(*(np.concatenate(pieces) for pieces in parts))


def _near(
    corners: FloatArray, origins: FloatArray, directions: FloatArray
) -> Iterator[tuple[IntArray, IntArray]]:
    """Yield lines with facets whose bounding spheres they cross: numbers of both, (m,) each."""
    centres = corners.mean(axis=1)
    radii = np.linalg.norm(corners - centres[:, None], axis=2).max(axis=1, initial=0.0)
    limit = ((1.0 + 1e-6) * radii) ** 2
    shift = centres.mean(axis=0) if len(centres) else 0.0
    step = max(1, _MOST_CANDIDATES // max(1, len(corners)))
    for first in range(0, len(origins), step):
        some = slice(first, first + step)
        away = (centres - shift)[None] - (origins[some] - shift)[:, None]  # (s, n, dim)
        along = np.einsum("snd,sd->sn", away, directions[some])
        line, facet = np.nonzero(np.einsum("snd,snd->sn", away, away) - along**2 <= limit)
        yield first + line, facet


def _meet(
    corners: FloatArray, origins: FloatArray, directions: FloatArray, facet: str
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Solve X(local) = origin + distance direction; return local, distance, and whether it is in.

    Newton's method; one step is exact for intervals and triangles.
    """
    k, dim = origins.shape
    middle = 1.0 / dim if facet == "triangle" else 0.5
    local, distance = np.full((k, dim - 1), middle), np.zeros(k)
    is_met = np.ones(k, dtype=np.bool_)
    for _ in range(_ITERATIONS if facet == "quadrilateral" else 2):
        N, dN = shape_functions(facet, local)
        place = np.einsum("kv,kvi->ki", N, corners)
        tangents = np.einsum("kvi,kvj->kij", corners, dN)
        matrix = np.concatenate([tangents, -directions[..., None]], axis=2)
        size = np.prod(np.linalg.norm(tangents, axis=1), axis=1)
        is_met &= np.abs(np.linalg.det(matrix)) > _PARALLEL * size
        matrix[~is_met] = np.eye(dim)
        residual = origins + distance[:, None] * directions - place
        step = np.linalg.solve(matrix, residual[..., None])[..., 0]
        local = local + np.clip(step[:, :-1], -2.0, 2.0)
        distance = distance + step[:, -1]
        if np.abs(step[is_met, :-1]).max(initial=0.0) < _CONVERGED:
            break
    return local, distance, is_met & (overshoot(facet, local) <= INSIDE)
