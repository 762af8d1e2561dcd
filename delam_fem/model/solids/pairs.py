"""The contact pairs of a case: where they are, the gap matrix, their interfaces and weights.

On the structured mesh of a case the pairs are where those of its beams are along x; in 3D each of
them is a row of points across the width, at the vertices. On a mesh from a file they are the
vertices of the lower sides; of tetrahedra the middles of the edges there, because a pressure on a
quadratic triangle loads these alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from delam_fem.case.definition import Case
from delam_fem.model.beams.laminae import gap_at_rest
from delam_fem.model.layout import Interface, Layout, Part
from delam_fem.model.solids import facing
from delam_fem.model.solids.elasticity import Solid
from delam_fem.model.solids.evaluation import gathered
from delam_fem.model.solids.facing import Pairs
from delam_fem.model.solids.lattice import bonded_cells
from delam_fem.model.solids.mesh import Facing, SolidMesh
from delam_fem.model.solids.unknowns import Unknowns
from delam_fem.numerics.arrays import BoolArray, FloatArray

_ROUND_OFF = 1e-9
"""Values of basis functions below this are zero but for round-off."""

_OPENINGS = frozenset({"opening", "shape", "file"})
"""Keys of a delamination that say how far it is open at rest."""


@dataclass(frozen=True)
class Touching:
    """The pairs of one interface that can move.

    Attributes:
        sides: the surfaces.
        pairs: the pairs.
        rows: their rows of the gap matrix, columns of the own free dofs, CSR (n_pairs, n_own).
    """

    sides: Facing
    pairs: Pairs
    rows: sp.csr_matrix


def touching(case: Case, unknowns: Unknowns, x: FloatArray) -> tuple[Touching, ...]:
    """Return the pairs of all interfaces (collective).

    Args:
        case: the case.
        unknowns: the free dofs.
        x: positions of the points of the parts, shape (n,) [m].
    """
    solid = unknowns.solid
    result = []
    for sides in solid.mesh.sides:
        points = _points(case, solid.mesh, sides, x)
        found = facing.project(solid.mesh, sides, points)
        of_all = gathered(facing.gap_rows(solid, found), solid.comm)
        of_all.data[np.abs(of_all.data) < _ROUND_OFF] = 0.0
        rows = sp.csr_matrix(of_all @ unknowns.free)
        rows.eliminate_zeros()
        moves = _moves(solid, rows)
        result.append(Touching(sides, found.chosen(moves), rows[moves]))
    return tuple(result)


def interfaces(parts: Sequence[Part], every: Sequence[Touching], case: Case) -> list[Interface]:
    """Return the interfaces of all pairs, which follow one another.

    Args:
        parts: all parts.
        every: the pairs of each interface.
        case: the case.
    """
    result: list[Interface] = []
    for own in every:
        first = sum(len(other.points) for other in result)
        is_file = case.mesh.file is not None
        result.append(
            facing.interface(parts, own.sides.parts, own.pairs.x, first, at_points=is_file)
        )
    return result


def weights(
    case: Case, parts: Sequence[Part], every: Sequence[Touching], dim: int
) -> FloatArray | None:
    """Return the factors of the springs of all pairs, shape (n_pairs,) [-].

    As of beams a spring's stiffness holds for a mean element, and each pair has its share of the
    length or, in 3D, of the area. If pairs are at the points of the parts alone, each point has the
    whole stiffness, as in the paper, which its pairs across the width share. None: every pair has
    the whole.
    """
    is_whole = case.contact.points_per_element == 1 and case.mesh.file is None
    if is_whole and dim == 2:
        return None
    result: list[FloatArray] = [np.zeros(0)]
    for own in every:
        lower = parts[own.sides.parts[0]]
        own_weights = own.pairs.weights
        if is_whole:
            _, row = np.unique(own.pairs.x, return_inverse=True)
            result.append(own_weights / np.bincount(row, own_weights)[row])
            continue
        mean = (lower.x[-1] - lower.x[0]) / lower.n_elements
        across = 1.0 if dim == 2 else min(case.lamina[i].width for i in own.sides.parts)
        result.append(own_weights / (mean * across))
    return np.concatenate(result)


def gaps(case: Case, layout: Layout, every: Sequence[Touching]) -> FloatArray:
    """Return the gaps at rest of all pairs, shape (n_pairs,) [m].

    They are the case's. On a mesh from a file they are the mesh's own at delaminations of which the
    case gives neither an opening nor a shape nor a table.

    Args:
        case: the case.
        layout: with the interfaces of the pairs.
        every: the pairs of each interface.
    """
    if not every:
        return np.zeros(0)
    result = gap_at_rest(case, layout)
    if case.mesh.file is None or case.gap is not None:
        return result
    for own, interface in zip(every, layout.interfaces, strict=True):
        between = tuple(layout.names[i] for i in interface.parts)
        for open_place in case.delamination:
            if open_place.between == between and not _OPENINGS & open_place.model_fields_set:
                x = own.pairs.x
                is_in = (x >= open_place.start) & (x <= open_place.end)
                result[interface.pairs][is_in] = own.pairs.gap[is_in]
    return result


def _points(case: Case, mesh: SolidMesh, sides: Facing, x: FloatArray) -> facing.Points:
    """Return the points of the lower side at which pairs are sought."""
    if case.mesh.file is not None:
        is_tetrahedral = mesh.cell == "tetrahedron"
        return (facing.at_middles if is_tetrahedral else facing.at_vertices)(mesh, sides)
    lower, upper = (case.lamina[i] for i in sides.parts)
    across = None
    if mesh.dim == 3:
        half = 0.5 * min(lower.width, upper.width)
        across = np.linspace(-half, half, case.model.strips + 1)
    bonded = bonded_cells(case, x)[sides.parts[0]]
    return facing.at_places(
        mesh, sides, _places(bonded, x, case.contact.points_per_element), across
    )


def _places(bonded: BoolArray, x: FloatArray, per_element: int) -> FloatArray:
    """Return the positions of the pairs of beams: within cells that are apart [m].

    Args:
        bonded: whether each cell is bonded, shape (n,).
        x: nodes, shape (n + 1,) [m].
        per_element: number of pairs per cell, at the local coordinates 1/p, 2/p, …, 1.
    """
    touches_bond = np.zeros(x.size, dtype=np.bool_)
    touches_bond[1:] |= bonded
    touches_bond[:-1] |= bonded
    local = np.arange(1, per_element) / per_element
    inside = x[:-1][~bonded, None] + np.diff(x)[~bonded, None] * local
    return np.sort(np.concatenate([x[~touches_bond], inside.ravel()]))


def _moves(solid: Solid, rows: sp.csr_matrix) -> BoolArray:
    """Return which pairs any free dof moves (collective), shape (n_pairs,)."""
    own = np.asarray(abs(rows).sum(axis=1)).ravel()
    if solid.comm.size > 1:
        own = np.sum(solid.comm.allgather(own), axis=0)
    return np.asarray(own > 0.0)
