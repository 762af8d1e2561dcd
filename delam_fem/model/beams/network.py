"""Bonded here, delaminated there: the segments of a stack, its unknowns, and how they follow.

A junction is an edge of a delamination or an end of the structure. Between two junctions lies a
segment, in which each group of bonded laminae is one Euler–Bernoulli beam about its neutral axis.
At a node the laminae that are bonded on either side form a cluster: a plane section with one
deflection w, one slope w' and, at junctions, one axial displacement u of its neutral axis. Lamina i
of the group g of the cluster c has

    w_i = w_c,   w_i' = w_c',   u_g = u_c - (z_g - z_c) w_c'                                   (N1)
    axial strain of lamina i = u_g' - (z_i - z_g) w''                                          (N2)

Axial inertia is neglected, and so is rotatory inertia, as in every Euler–Bernoulli beam. The axial
force of a group is then constant within a segment, so u_g is linear there and only its values at
junctions are unknowns. They have no mass and are eliminated exactly (`eliminated`). What they leave
behind couples the slopes at the edges of a delamination.

Source: P. M. Mujumdar, S. Suryanarayan, "Flexural vibrations of beams with delaminations", J. Sound
Vib. 125 (1988), for one delamination in a homogeneous beam.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import scipy.sparse as sp

from delam_fem.case.definition import Case
from delam_fem.case.sections import Lamina
from delam_fem.model.layout import BASE, FIXED, Part
from delam_fem.model.pairing import CURVATURE, cells_at, columns_of
from delam_fem.model.sensors import StrainRows
from delam_fem.numerics.arrays import FloatArray, IntArray

Group = tuple[int, ...]
"""Numbers of neighbouring laminae that are bonded, from bottom to top."""

ROUND_OFF = 1e-13
"""Entries of a matrix below this share of what their diagonals allow are zero but for round-off."""
_SAME = 1e-9
"""Relative difference below which two halves move alike."""


@dataclass(frozen=True)
class Segment:
    """A stretch between two junctions.

    Attributes:
        first: node at its start.
        last: node at its end.
        groups: the groups of bonded laminae from bottom to top.
    """

    first: int
    last: int
    groups: tuple[Group, ...]

    @property
    def nodes(self) -> IntArray:
        """The nodes of the segment."""
        return np.arange(self.first, self.last + 1)


@dataclass(frozen=True)
class Network:
    """The unknowns of a stack of laminae.

    Attributes:
        x: positions of the nodes [m].
        laminae: the laminae from bottom to top.
        segments: from start to end.
        dofs: the free dofs of deflection and slope of each lamina at each node, or BASE, or FIXED,
            shape (n_laminae, n_nodes, 2). Bonded laminae share them.
        axial: the axial unknown of each lamina's cluster at each junction, or FIXED, by node and
            lamina.
        n_free: number of free dofs.
        n_axial: number of axial unknowns.
    """

    x: FloatArray
    laminae: tuple[Lamina, ...]
    segments: tuple[Segment, ...]
    dofs: IntArray
    axial: dict[tuple[int, int], int]
    n_free: int
    n_axial: int

    @property
    def n_columns(self) -> int:
        """Columns of `rows`: free dofs, the base, axial unknowns."""
        return self.n_free + 1 + self.n_axial

    def groups(self) -> Iterator[tuple[Segment, Group]]:
        """Yield every segment with each of its groups."""
        for segment in self.segments:
            for group in segment.groups:
                yield segment, group

    def neutral_axis(self, group: Sequence[int]) -> float:
        """Return z of the neutral axis of bonded laminae, from the bottom of the stack [m]."""
        EA = np.array([self.laminae[i].axial_rigidity for i in group])
        z = self.middles[list(group)]
        return float(z[0] + EA @ (z - z[0]) / EA.sum())

    @property
    def middles(self) -> FloatArray:
        """Heights z of the middle planes of the laminae, from the bottom of the stack [m]."""
        thickness = np.array([lamina.thickness for lamina in self.laminae])
        return np.asarray(np.cumsum(thickness) - 0.5 * thickness)

    def section(self, group: Group) -> tuple[float, float, float]:
        """Return EI about the neutral axis [N m2], ρA [kg/m] and EA [N] of bonded laminae."""
        laminae = [self.laminae[i] for i in group]
        arms = self.middles[list(group)] - self.neutral_axis(group)
        EA = [lamina.axial_rigidity for lamina in laminae]
        EI = sum(
            lamina.flexural_rigidity + ea * float(arm) ** 2
            for lamina, ea, arm in zip(laminae, EA, arms, strict=True)
        )
        return EI, sum(lamina.mass_per_length for lamina in laminae), sum(EA)

    def cluster(self, node: int, lamina: int) -> Group:
        """Return the laminae that form a plane section with a lamina at a node."""
        touching = [s.groups for s in self.segments if s.first <= node <= s.last]
        return next(c for c in joined(touching) if lamina in c)

    def row(self, node: int, lamina: int, component: int) -> list[tuple[int, float]]:
        """Return deflection (0) or slope (1) of a lamina at a node as columns with factors."""
        dof = int(self.dofs[lamina, node, component])
        if dof == FIXED:
            return []
        return [(self.n_free if dof == BASE else dof, 1.0)]

    def axial_row(self, node: int, group: Group) -> list[tuple[int, float]]:
        """Return the axial displacement of a group at a junction as columns with factors (N1)."""
        lamina = group[0]
        arm = self.neutral_axis(group) - self.neutral_axis(self.cluster(node, lamina))
        row = [(column, -arm * factor) for column, factor in self.row(node, lamina, 1) if arm]
        number = self.axial[node, lamina]
        return row if number == FIXED else [(self.n_free + 1 + number, 1.0), *row]


def network(case: Case, x: FloatArray) -> Network:
    """Return the unknowns of a case over given nodes.

    Free dofs are numbered node by node from the start, at a node cluster by cluster from the
    bottom, the deflection before the slope.

    Args:
        case: laminae, delaminations and supports.
        x: positions of the nodes; every edge of a delamination is one of them [m].
    """
    segments = _segments(case, x)
    n = x.size - 1
    dofs = np.full((len(case.lamina), n + 1, 2), FIXED, dtype=np.int64)
    axial: dict[tuple[int, int], int] = {}
    n_free = n_axial = 0
    supports = {0: case.support.start, n: case.support.end}
    junctions = {0, *(s.last for s in segments)}
    for node in range(n + 1):
        touching = [s.groups for s in segments if s.first <= node <= s.last]
        kind = supports.get(node, "free")
        for cluster in joined(touching):
            own = [n_free, n_free + 1]
            if kind != "free":
                is_rigid = kind == "clamped" and case.support.rotational_stiffness is None
                own = [BASE, FIXED if is_rigid else n_free]
            dofs[list(cluster), node] = own
            n_free += sum(dof >= 0 for dof in own)
            if node in junctions:
                number = n_axial if kind == "free" else FIXED
                axial |= {(node, i): number for i in cluster}
                n_axial += number != FIXED
    return Network(x, case.lamina, segments, dofs, axial, n_free, n_axial)


def never_opens(case: Case) -> str | None:
    """Return a message if no delamination of a case can ever open, otherwise None.

    Two halves with the same EI / ρA move alike under base motion: then one deflection satisfies the
    equations of both without any contact force.
    """
    if not case.delamination or case.is_apart or case.excitation.acts_on != "base":
        return None
    edges = sorted({x for own in case.delamination for x in (own.start, own.end)})
    stack = network(case, np.array(sorted({0.0, *edges, case.length})))
    for segment in stack.segments:
        ratios = [_bending_speed(stack, group) for group in segment.groups]
        if max(ratios) - min(ratios) > _SAME * max(ratios):
            return None
    return (
        "no delamination ever opens under base motion: both halves of each have the same EI / (rho "
        "A), as with a mid-plane delamination between equal laminae, and move alike; take another "
        "depth, or a force at a point of one lamina"
    )


def _bending_speed(stack: Network, group: Group) -> float:
    """Return EI / ρA of bonded laminae [m4/s2]."""
    EI, rhoA, _ = stack.section(group)
    return EI / rhoA


def joined(groupings: Sequence[Sequence[Group]]) -> tuple[Group, ...]:
    """Return the finest groups of neighbours in which every group of every grouping lies."""
    n = sum(len(group) for group in groupings[0])
    is_joined = np.zeros(n, dtype=np.bool_)  # whether lamina i is bonded to lamina i - 1
    for grouping in groupings:
        for group in grouping:
            is_joined[list(group[1:])] = True
    starts = [*np.flatnonzero(~is_joined).tolist(), n]
    return tuple(tuple(range(a, b)) for a, b in pairwise(starts))


def eliminated(matrix: sp.spmatrix, n_kept: int) -> sp.csr_matrix:
    """Return the stiffness of the first unknowns when the others carry no load.

        K = K_dd - K_da K_aa⁻¹ K_ad

    A structure that floats axially has a singular K_aa; the pseudo-inverse holds then, because a
    rigid motion carries no force.

    Args:
        matrix: symmetric stiffness of all unknowns.
        n_kept: number of those that stay.
    """
    K = without_round_off(matrix)
    K_dd, K_ad = K[:n_kept, :n_kept], K[n_kept:, :n_kept]
    coupled = np.unique(K_ad.indices)
    dense = K_ad[:, coupled].toarray()
    change = dense.T @ np.linalg.pinv(K[n_kept:, n_kept:].toarray(), hermitian=True) @ dense
    where = np.ix_(coupled, coupled)
    rows, columns = (grid.ravel() for grid in np.broadcast_arrays(*where))
    full = sp.csr_matrix((0.5 * (change + change.T).ravel(), (rows, columns)), K_dd.shape)
    return without_round_off(K_dd - full)


def surface_strain(stack: Network, stiffness: sp.spmatrix) -> StrainRows:
    """Return the strains of the surfaces of bonded laminae (N2).

        strain = u_g' - (z - z_g) w''

    The axial displacements follow from deflections and slopes as in `eliminated`. At a point
    between two cells it is the mean of both.

    Args:
        stack: the unknowns.
        stiffness: K in the columns of the network.
    """
    n_kept = stack.n_free + 1
    K = without_round_off(stiffness)
    K_aa, K_ad = K[n_kept:, n_kept:].toarray(), K[n_kept:, :n_kept].toarray()
    axial = -np.linalg.pinv(K_aa, hermitian=True) @ K_ad  # (n_axial, n_kept)
    cells = np.ones(stack.x.size - 1)

    def of_cell(lamina: int, place: float, side: float, cell: int) -> FloatArray:
        part = Part("", stack.x, stack.dofs[lamina], cells, cells)
        segment = next(s for s in stack.segments if s.first <= cell < s.last)
        group = next(g for g in segment.groups if lamina in g)
        z = stack.middles[lamina] + 0.5 * side * stack.laminae[lamina].thickness
        bend = columns_of(part, place, stack.n_free, CURVATURE, cell).toarray()[0]
        row = -(z - stack.neutral_axis(group)) * bend
        length = float(stack.x[segment.last] - stack.x[segment.first])
        for node, sign in ((segment.first, -1.0), (segment.last, 1.0)):
            for column, factor in stack.axial_row(node, group):
                change = sign * factor / length
                if column < n_kept:
                    row[column] += change
                else:
                    row += change * axial[column - n_kept]
        return np.asarray(row)

    def rows(lamina: int, place: float, side: float) -> sp.csr_matrix:
        part = Part("", stack.x, stack.dofs[lamina], cells, cells)
        found = [of_cell(lamina, place, side, cell) for cell in cells_at(part, place)]
        return sp.csr_matrix(np.mean(found, axis=0))

    return rows


def without_round_off(matrix: sp.spmatrix) -> sp.csr_matrix:
    """Return a symmetric positive matrix without entries that are zero but for round-off."""
    entries = sp.coo_matrix(matrix)
    entries.sum_duplicates()
    scale = np.sqrt(np.maximum(sp.csr_matrix(matrix).diagonal(), 0.0))
    kept = np.abs(entries.data) > ROUND_OFF * scale[entries.row] * scale[entries.col]
    return sp.csr_matrix(
        (entries.data[kept], (entries.row[kept], entries.col[kept])), shape=entries.shape
    )


def _segments(case: Case, x: FloatArray) -> tuple[Segment, ...]:
    """Return the segments of a case between its junctions."""
    names = [lamina.name for lamina in case.lamina]
    spans = [
        (names.index(own.between[1]), _node(x, own.start), _node(x, own.end))
        for own in case.delamination
    ]
    junctions = sorted({0, x.size - 1, *(node for _, *edges in spans for node in edges)})
    segments = []
    for first, last in pairwise(junctions):
        cuts = {upper for upper, start, end in spans if start <= first and last <= end}
        starts = [0, *sorted(cuts), len(names)]
        groups = tuple(tuple(range(a, b)) for a, b in pairwise(starts))
        segments.append(Segment(first, last, groups))
    return tuple(segments)


def _node(x: FloatArray, place: float) -> int:
    """Return the node nearest to a place."""
    return int(np.argmin(np.abs(x - place)))
