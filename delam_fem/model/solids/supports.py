"""Held ends of solids: which dofs follow the base, and how a pinned end turns.

    u = T u_free + g q,     M_free = Tᵀ M T,     m_b = Tᵀ M g,     m_aa = gᵀ M g              (S1)

q is the motion of the base along y, g is 1 at the y components of held nodes. At a clamped end all
other components rest. A pinned end stays plane and turns about its neutral axis y_0, as in beam
theory:

    u_x = -(y - y_0) phi,   u_y = q                                                           (S2)

phi is a free dof. Laminae that are bonded at the end turn together.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from delam_fem.case.definition import Case
from delam_fem.case.toml import CaseError
from delam_fem.model.solids.elasticity import Solid
from delam_fem.model.solids.mesh import SolidMesh
from delam_fem.numerics.arrays import FloatArray, IntArray

X, Y = 0, 1
"""Components along the laminae and of the deflection."""
SHARED = -1
"""Stands for the lamina of what bonded laminae share."""


@dataclass(frozen=True)
class Held:
    """The held dofs of a solid; all ranks know all of them.

    Attributes:
        dofs: increasing, numbered over all ranks, shape (n,).
        base: g of S1 for each of them, 0 or 1, shape (n,).
        turn: the factor -(y - y_0) of S2, shape (n,) [m].
        place: the dof in whose place phi is, for each of them; itself one of `dofs`; -1: none,
            shape (n,).
        lamina: number of the lamina that turns with phi, SHARED where bonded ones do, shape (n,).
    """

    dofs: IntArray
    base: FloatArray
    turn: FloatArray
    place: IntArray
    lamina: IntArray

    @property
    def is_turning(self) -> bool:
        """Whether there is a pinned end."""
        return bool(np.any(self.place >= 0))


def held(case: Case, solid: Solid, rigidity: FloatArray) -> Held:
    """Return the held dofs of a case (collective).

    Args:
        case: gives the supports.
        solid: the solid.
        rigidity: Young's modulus of each cell, times the width in 2D, shape (n_cells,).

    Raises:
        CaseError: an end that is held has no facets.
    """
    blocks: list[Held] = []
    for name in ("start", "end"):
        kind = getattr(case.support, name)
        if kind == "free":
            continue
        facets = solid.mesh.supports.get(name)
        if facets is None or len(facets) == 0:
            raise CaseError(f'support.{name}: the mesh has no facets "{name}" to hold')
        if kind == "clamped":
            blocks.append(_at(solid, solid.nodes_on(facets)))
            continue
        for own in _clusters(facets):
            nodes = solid.nodes_on(facets[own])
            axis = neutral_axis(solid.mesh, facets[own], rigidity)
            laminae = np.unique(solid.mesh.lamina[solid.mesh.cells_with(facets[own])[0]])
            one = int(laminae[0]) if laminae.size == 1 else SHARED
            blocks.append(_at(solid, nodes, axis, one))
    return _joined(blocks)


def neutral_axis(mesh: SolidMesh, facets: IntArray, rigidity: FloatArray) -> float:
    """Return y of the neutral axis of an end, the mean weighted with E dA [m].

    Args:
        mesh: the mesh.
        facets: of the end, shape (n, m).
        rigidity: Young's modulus of each cell, times the width in 2D, shape (n_cells,).
    """
    cells, _ = mesh.cells_with(facets)
    corners = mesh.points[facets]
    if mesh.dim == 2:
        area = np.linalg.norm(corners[:, 1] - corners[:, 0], axis=1)
        middle = corners.mean(axis=1)[:, Y]
    else:
        halves = [corners[:, :3]] + ([corners[:, 1:]] if facets.shape[1] == 4 else [])
        sizes = [_triangle_area(half) for half in halves]
        area = np.sum(sizes, axis=0)
        moments = [s * h.mean(axis=1)[:, Y] for s, h in zip(sizes, halves, strict=True)]
        middle = np.sum(moments, axis=0) / area
    weight = rigidity[cells] * area
    return float(weight @ middle / weight.sum())


def _triangle_area(corners: FloatArray) -> FloatArray:
    """Return the areas of triangles, corners of shape (n, 3, 3)."""
    sides = corners[:, 1:] - corners[:, :1]
    return np.asarray(0.5 * np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1))


def _clusters(facets: IntArray) -> list[IntArray]:
    """Return the numbers of the facets that hang together, cluster by cluster."""
    n, m = facets.shape
    entries = np.ones(n * m), (np.repeat(np.arange(n), m), facets.ravel())
    touches = sp.csr_matrix(entries)
    count, label = connected_components(touches @ touches.T, directed=False)
    return [np.flatnonzero(label == number) for number in range(count)]


def _at(solid: Solid, nodes: IntArray, axis: float | None = None, lamina: int = SHARED) -> Held:
    """Return the held dofs of nodes: clamped, or pinned with a neutral axis."""
    dim = solid.dim
    dofs = (dim * nodes[:, None] + np.arange(dim)).ravel()
    base = np.tile(np.arange(dim) == Y, nodes.size).astype(np.float64)
    turn, place = np.zeros(dofs.size), np.full(dofs.size, -1, dtype=np.int64)
    if axis is not None:
        turn[X::dim] = axis - solid.coordinates_of(nodes)[:, Y]
        place[X::dim] = dofs[X]
    return Held(dofs, base, turn, place, np.full(dofs.size, lamina, dtype=np.int64))


def _joined(blocks: list[Held]) -> Held:
    """Return the held dofs of all ends, increasing."""
    if not blocks:
        nothing, none = np.zeros(0), np.zeros(0, dtype=np.int64)
        return Held(none, nothing, nothing, none, none)
    every = [np.concatenate([getattr(b, name) for b in blocks]) for name in _FIELDS]
    _, first = np.unique(every[0], return_index=True)
    return Held(*(values[first] for values in every))


_FIELDS = ("dofs", "base", "turn", "place", "lamina")
