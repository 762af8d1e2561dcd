"""Beams in layers: laminae side by side, or bonded here and delaminated there.

A bonded stack has junctions, which are the edges of delaminations and the ends of the structure.
Between two junctions lies a segment, in which each group of bonded laminae is one Euler–Bernoulli
beam about its neutral axis. At a node the laminae that are bonded on either side form a cluster: a
plane section with one deflection w, one slope w' and, at junctions, one axial displacement u of its
neutral axis. Lamina i of the group g of the cluster c has

    w_i = w_c,   w_i' = w_c',   u_g = u_c - (z_g - z_c) w_c'                                   (N1)
    axial strain of lamina i = u_g' - (z_i - z_g) w''                                          (N2)

Axial inertia is neglected, and so is rotatory inertia, as in every Euler–Bernoulli beam. The axial
force of a group is then constant within a segment, so u_g is linear there and only its values at
junctions are unknowns. They have no mass and are eliminated exactly (`eliminated`). The stiffness
that they leave behind couples the slopes at the edges of a delamination.

Source: P. M. Mujumdar, S. Suryanarayan, "Flexural vibrations of beams with delaminations", J. Sound
Vib. 125 (1988), for one delamination in a homogeneous beam.

Laminae side by side, as in the paper, are beams of their own with supports of their own
(`apart_parts`).
Both discretisations (closed_form.py and forms.py) number their dofs in the order of this layout:
lamina by lamina, node by node from the clamp to the tip, displacement before slope. The clamped
nodes are left out.

Point masses on laminae add to the mass of a structure (`added_mass`):

    m(w, v) = ∫ rho A w v dx + Σ m_j w(x_j) v(x_j)                                  (weak form)

w and v are Hermite interpolants, so a mass m at x adds m N N^T, where N are the values of the cubic
Hermite functions there. The lumped mass gets the share m (1 - X) and m X at the ends of the cell.
The masses are part of M in the damping C = alpha M + beta K; their rotatory inertia is neglected.

Both discretisations give mass and stiffness in the unknowns of a `Network`. This module does the
rest, which both share: operators, layout and damping (`structure`, `side_by_side`).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.linalg import eigh

from delam_fem.case.definition import Case
from delam_fem.case.excitation import Excitation, places_of
from delam_fem.case.gap import initial_gap, opening_at_rest
from delam_fem.case.sections import (
    EDGE_TOLERANCE,
    ENDS,
    Lamina,
    PointMass,
    PointSupport,
    open_ends,
)
from delam_fem.model.layout import (
    BASE,
    CURVATURE,
    DISPLACEMENT,
    FIXED,
    SLOPE,
    Interface,
    Layout,
    Part,
    Place,
    Probe,
    Reading,
    Structure,
    cells_at,
    columns_of,
    gap_matrix,
    in_order,
    opposite,
    place_of,
    probe_rows,
    tributary_lengths,
)
from delam_fem.model.linear import closed_by, elastic, kept_closed, n_rigid
from delam_fem.model.loads import (
    axial_forces,
    require_unbuckled,
)
from delam_fem.model.operators import BaseCoupling, Operators
from delam_fem.model.places import row_at
from delam_fem.model.stops_sensors import StrainRows, struck, with_sensors
from delam_fem.numerics import harmonics
from delam_fem.numerics.types import FloatArray, IntArray
from delam_fem.system.errors import CaseError

Group = tuple[int, ...]
"""Numbers of neighbouring laminae that are bonded, from bottom to top."""

_RIGID_SHARE = 1e-12
"""Square of a frequency over the largest, below which a motion is rigid but for round-off."""
RIGID = 1e9
"""Stiffness of a support over that of the elements beside it from which on it counts as rigid: of
the 16 digits of their sum, too few are theirs."""
ROUND_OFF = 1e-13
"""Entries K_ij of a matrix below this share of sqrt(K_ii K_jj) are round-off of zero."""
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
        segments: the segments from start to end.
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
        """Number of columns of a row: free dofs, the base, axial unknowns."""
        return self.n_free + 1 + self.n_axial

    def groups(self) -> Iterator[tuple[Segment, Group]]:
        """Return every segment with each of its groups, one after the other."""
        return ((segment, group) for segment in self.segments for group in segment.groups)

    def ties(self, segment: Segment, case: Case) -> bool:
        """Return whether both ends of a segment are held or bonded."""
        is_free = not case.support.holds("start") and segment.first == 0
        is_free |= not case.support.holds("end") and segment.last == self.x.size - 1
        return not is_free

    def neutral_axis(self, group: Sequence[int]) -> float:
        """Return z of the neutral axis of bonded laminae, from the bottom of the stack [m]."""
        EA = np.array([self.laminae[i].axial_rigidity for i in group])
        z = self.middles[list(group)]
        return float(z[0] + EA @ (z - z[0]) / EA.sum())

    @property
    def middles(self) -> FloatArray:
        """Heights z of the middle planes of the laminae, from the bottom of the stack [m]."""
        thickness = np.array([lamina.mean("thickness") for lamina in self.laminae])
        return np.asarray(np.cumsum(thickness) - 0.5 * thickness)

    @property
    def is_uniform(self) -> bool:
        """Whether no lamina changes along its length."""
        return all(lamina.is_uniform for lamina in self.laminae)

    def middles_at(self, x: FloatArray, inside: FloatArray | None = None) -> FloatArray:
        """Return heights of the middle planes from the middle of the stack, (n_laminae, …) [m].

        Where laminae change along x the middle of the whole stack stays straight.

        Args:
            x: places, any shape [m].
            inside: see `Profile.at`.
        """
        thickness = np.array([lamina.along("thickness", x, inside) for lamina in self.laminae])
        return np.asarray(
            np.cumsum(thickness, axis=0) - 0.5 * thickness - 0.5 * thickness.sum(axis=0)
        )

    def axis_at(
        self, group: Sequence[int], x: FloatArray, inside: FloatArray | None = None
    ) -> FloatArray:
        """Return heights of the neutral axis of bonded laminae at places; see `middles_at`."""
        EA = np.array([self.laminae[i].axial_rigidity_at(x, inside) for i in group])
        return np.asarray(
            (EA * self.middles_at(x, inside)[list(group)]).sum(axis=0) / EA.sum(axis=0)
        )

    def flexural_rigidity_at(
        self, group: Group, x: FloatArray, inside: FloatArray | None = None
    ) -> FloatArray:
        """Return EI of bonded laminae about their neutral axis at places, see `middles_at`."""
        laminae = [self.laminae[i] for i in group]
        arms = self.middles_at(x, inside)[list(group)] - self.axis_at(group, x, inside)
        return np.asarray(
            sum(
                lamina.flexural_rigidity_at(x, inside)
                + lamina.axial_rigidity_at(x, inside) * arm**2
                for lamina, arm in zip(laminae, arms, strict=True)
            )
        )

    def mass_per_length_at(
        self, group: Group, x: FloatArray, inside: FloatArray | None = None
    ) -> FloatArray:
        """Return the mass per length of bonded laminae at places, see `middles_at` [kg/m]."""
        shares = [self.laminae[i].mass_per_length_at(x, inside) for i in group]
        return np.asarray(np.sum(shares, axis=0))

    def stretch(self, segment: Segment, group: Group) -> tuple[sp.csr_matrix, float]:
        """Return what stretches a group whose section changes, and its compliance.

        With u_0 at the height 0 and the neutral axis at e(x), the axial force N = EA (u_0' - e w'')
        is constant in a segment, so that N ∫ dx/EA = u_0(end) - u_0(start) - ∫ e w'' dx. At a
        junction u_0 = u_c + z_c w'.

        Returns:
            The right-hand side as a row, (1, n_columns) [m]; ∫ dx/EA [m/N].
        """
        row: list[tuple[int, float]] = []
        for node, sign in ((segment.first, -1.0), (segment.last, 1.0)):
            place = self.x[[node]]
            z = float(self.axis_at(self.cluster(node, group[0]), place, place)[0])
            row += [(column, sign * z * factor) for column, factor in self.row(node, group[0], 1)]
            number = self.axial[node, group[0]]
            row += [] if number == FIXED else [(self.n_free + 1 + number, sign)]
        x = self.x[segment.nodes]
        h = np.diff(x)
        s, w = unit_gauss()
        places = x[:-1, None] + h[:, None] * s
        bend = (self.axis_at(group, places) * w) @ hermite_curvature(s) / h[:, None]  # (n, 4)
        for k, node in enumerate(segment.nodes[:-1]):
            for j in range(4):
                factor = float(bend[k, j]) * (h[k] if j % 2 else 1.0)
                row += [(c, -factor * f) for c, f in self.row(node + j // 2, group[0], j % 2)]
        EA = np.sum([self.laminae[i].axial_rigidity_at(places) for i in group], axis=0)
        return self.matrix([row]), float((h[:, None] * w / EA).sum())

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
        return next(c for c in clusters(self.segments, node) if lamina in c)

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

    def matrix(self, rows: Sequence[Sequence[tuple[int, float]]]) -> sp.csr_matrix:
        """Return rows that are given as columns with factors, CSR (n_rows, n_columns)."""
        entries = np.array([entry for row in rows for entry in row]).reshape(-1, 2)
        ends = np.cumsum([0, *map(len, rows)])
        shape = (len(rows), self.n_columns)
        result = sp.csr_matrix((entries[:, 1], entries[:, 0].astype(np.int64), ends), shape)
        result.sum_duplicates()
        return result


GAUSS_POINTS = 5
"""Gauss points of an element: exact for E b h³ linear in each factor, times curvatures."""


def unit_gauss() -> tuple[FloatArray, FloatArray]:
    """Return Gauss points and weights of the interval from 0 to 1."""
    s, w = np.polynomial.legendre.leggauss(GAUSS_POINTS)  # type: ignore[no-untyped-call]
    return 0.5 * (s + 1.0), 0.5 * w


def hermite(s: FloatArray) -> FloatArray:
    """Return the cubic Hermite functions at s in an element of length 1, shape (n, 4)."""
    return np.stack(
        [
            1.0 - 3.0 * s**2 + 2.0 * s**3,
            s - 2.0 * s**2 + s**3,
            3.0 * s**2 - 2.0 * s**3,
            s**3 - s**2,
        ],
        axis=-1,
    )


def hermite_curvature(s: FloatArray) -> FloatArray:
    """Return the second derivatives of `hermite`, shape (n, 4)."""
    return np.stack([12.0 * s - 6.0, 6.0 * s - 4.0, 6.0 - 12.0 * s, 6.0 * s - 2.0], axis=-1)


def network(case: Case, x: FloatArray) -> Network:
    """Return the unknowns of a case over given nodes.

    Free dofs are numbered node by node from the start, at a node cluster by cluster from the
    bottom, the deflection before the slope.

    Args:
        case: the case, with laminae, delaminations and supports.
        x: positions of the nodes; every edge of a delamination is one of them [m].
    """
    segments = _segments(case, x)
    n = x.size - 1
    dofs = np.full((len(case.lamina), n + 1, 2), FIXED, dtype=np.int64)
    axial: dict[tuple[int, int], int] = {}
    n_free = n_axial = 0
    ends = {0: ENDS[0], n: ENDS[1]}
    junctions = {0, *(s.last for s in segments)}
    for node in range(n + 1):
        end = ends.get(node)
        for cluster in clusters(segments, node):
            turns = turns_at(case, x, node, cluster)
            node_dofs = [n_free, n_free + 1]
            if turns is not None:
                node_dofs = [BASE, n_free if turns else FIXED]
            dofs[list(cluster), node] = node_dofs
            n_free += sum(dof >= 0 for dof in node_dofs)
            if node in junctions:
                number = FIXED if end is not None and case.support.holds(end) else n_axial
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
    edges = sorted(
        {x for delamination in case.delamination for x in (delamination.start, delamination.end)}
    )
    stack = network(case, np.array(sorted({0.0, *edges, case.length})))
    if not stack.is_uniform:
        return None
    for segment in stack.segments:
        ratios = [EI / rhoA for EI, rhoA, _ in map(stack.section, segment.groups)]
        if max(ratios) - min(ratios) > _SAME * max(ratios):
            return None
    return (
        "no delamination ever opens under base motion: both halves of each have the same EI / (rho "
        "A), as with a mid-plane delamination between equal laminae, and move alike; take another "
        "depth, or a force at a point of one lamina"
    )


def clusters(segments: Sequence[Segment], node: int) -> tuple[Group, ...]:
    """Return the groups of laminae that are bonded at a node, on either side of it."""
    return joined([segment.groups for segment in segments if segment.first <= node <= segment.last])


def holds(support: PointSupport, case: Case, cluster: Group) -> bool:
    """Return whether a support inside the span holds the laminae of a cluster."""
    return support.lamina in (None, *(case.lamina[i].name for i in cluster))


def turns_at(case: Case, x: FloatArray, node: int, cluster: Group) -> bool | None:
    """Return whether laminae that are bonded at a node can turn there; None: nothing holds them."""
    support = case.support
    ends = {0: ENDS[0], x.size - 1: ENDS[1]}
    if node in ends:
        return support.turns(ends[node]) if support.holds(ends[node]) else None
    for inner in support.held:
        if node_at(x, inner.x) == node and holds(inner, case, cluster):
            return inner.kind != "clamped"
    return None


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
    rows, columns = (grid.ravel() for grid in np.broadcast_arrays(*np.ix_(coupled, coupled)))
    full = sp.csr_matrix((0.5 * (change + change.T).ravel(), (rows, columns)), K_dd.shape)
    return without_round_off(K_dd - full)


def surface_strain(stack: Network, parts: Sequence[Part], stiffness: sp.spmatrix) -> StrainRows:
    """Return the strains of the surfaces of bonded laminae (N2).

        strain = u_g' - (z - z_g) w''

    The axial displacements follow from deflections and slopes as in `eliminated`. At a point
    between two cells the strain is the mean of both.

    Args:
        stack: the unknowns.
        parts: its laminae.
        stiffness: K in the columns of the network.
    """
    n_kept = stack.n_free + 1
    K = without_round_off(stiffness)
    K_aa = K[n_kept:, n_kept:].toarray()
    K_ad = K[n_kept:, :n_kept].toarray()
    axial = -np.linalg.pinv(K_aa, hermitian=True) @ K_ad  # (n_axial, n_kept)

    def of_cell(lamina: int, place: float, side: float, cell: int) -> FloatArray:
        segment = next(s for s in stack.segments if s.first <= cell < s.last)
        group = next(g for g in segment.groups if lamina in g)
        if not stack.is_uniform:
            return of_varying(lamina, place, side, cell, segment, group)
        z = stack.middles[lamina] + 0.5 * side * stack.laminae[lamina].mean("thickness")
        bend = columns_of(parts[lamina], place, stack.n_free, CURVATURE, cell).toarray()[0]
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

    def of_varying(
        lamina: int, place: float, side: float, cell: int, segment: Segment, group: Group
    ) -> FloatArray:
        x = parts[lamina].positions(np.array([place]))
        inside = 0.5 * (stack.x[[cell]] + stack.x[[cell + 1]])
        half = 0.5 * side * stack.laminae[lamina].along("thickness", x, inside)
        z = float((stack.middles_at(x, inside)[lamina] + half - stack.axis_at(group, x, inside))[0])
        bend = columns_of(parts[lamina], place, stack.n_free, CURVATURE, cell).toarray()[0]
        stretch, compliance = stack.stretch(segment, group)
        EA = np.sum([stack.laminae[i].axial_rigidity_at(x, inside) for i in group])
        force = stretch.toarray()[0] / (compliance * EA)
        return np.asarray(force[:n_kept] + force[n_kept:] @ axial - z * bend)

    def rows(lamina: int, place: float, side: float, _: float) -> sp.csr_matrix:
        cell_rows = [of_cell(lamina, place, side, cell) for cell in cells_at(parts[lamina], place)]
        return sp.csr_matrix(np.mean(cell_rows, axis=0))

    return rows


def without_round_off(matrix: sp.spmatrix) -> sp.csr_matrix:
    """Return a symmetric positive matrix without entries that are zero but for round-off."""
    entries = sp.coo_matrix(matrix)
    entries.sum_duplicates()
    scale = np.sqrt(np.maximum(sp.csr_matrix(matrix).diagonal(), 0.0))
    is_kept = np.abs(entries.data) > ROUND_OFF * scale[entries.row] * scale[entries.col]
    return sp.csr_matrix(
        (entries.data[is_kept], (entries.row[is_kept], entries.col[is_kept])), shape=entries.shape
    )


def _segments(case: Case, x: FloatArray) -> tuple[Segment, ...]:
    """Return the segments of a case between its junctions."""
    names = [lamina.name for lamina in case.lamina]
    spans = [
        (
            names.index(delamination.between[1]),
            node_at(x, delamination.start),
            node_at(x, delamination.end),
        )
        for delamination in case.delamination
    ]
    junctions = sorted({0, x.size - 1, *(node for _, *edges in spans for node in edges)})
    segments = []
    for first, last in pairwise(junctions):
        cuts = {upper for upper, start, end in spans if start <= first and last <= end}
        groups = tuple(tuple(range(a, b)) for a, b in pairwise([0, *sorted(cuts), len(names)]))
        segments.append(Segment(first, last, groups))
    return tuple(segments)


def node_at(x: FloatArray, place: float) -> int:
    """Return the node nearest to a place."""
    return int(np.argmin(np.abs(x - place)))


def gap_at_rest(case: Case, layout: Layout) -> FloatArray:
    """Return the gaps at rest of all pairs, shape (n_pairs,) [m].

    Raises:
        CaseError: see `initial_gap` and `opening_at_rest`.
    """
    gaps = (
        opening(case, layout, interface, *layout.positions_of(interface))
        for interface in layout.interfaces
    )
    return np.concatenate([np.zeros(0), *gaps])


def opening(
    case: Case,
    layout: Layout,
    interface: Interface,
    x: FloatArray,
    z: FloatArray | None = None,
) -> FloatArray:
    """Return the gap at rest between the laminae of an interface at x [m], 0 where it is bonded.

    Args:
        case: the case.
        layout: of its laminae.
        interface: between two of them.
        x: places, shape (n,) [m].
        z: places across the width, shape (n,) [m]; None: its middle.

    Raises:
        CaseError: see `initial_gap` and `opening_at_rest`.
    """
    if case.gap is not None:
        lower, upper = (layout.names[part] for part in interface.parts)
        return initial_gap(case.gap, x, case.contact_length(lower, upper))
    gap = np.zeros(x.size)
    margin = EDGE_TOLERANCE * case.length
    between = tuple(layout.names[part] for part in interface.parts)
    z = np.zeros_like(x) if z is None else z
    for delamination in case.delamination:
        if delamination.between == between:
            inside = (x >= delamination.start - margin) & (x <= delamination.end + margin)
            if delamination.across is not None:
                inside = delamination.contains(x, z)
            is_at_start = open_ends(delamination, case.length, case.support) == ("start",)
            gap[inside] = opening_at_rest(
                delamination, x[inside], case.length, opens_at_start=is_at_start, z=z[inside]
            )
    return gap


def pair_weights(case: Case, layout: Layout) -> FloatArray | None:
    """Return the factors of the springs of all pairs, shape (n_pairs,) [-].

    With contact points inside the elements a spring's stiffness holds for a mean element, and each
    pair has its share: its tributary length in lengths of the mean element. None: only the nodes
    are pairs, and each has the whole stiffness, as in the paper.
    """
    if case.contact.points_per_element == 1:
        return None
    shares: list[FloatArray] = []
    for interface in layout.interfaces:
        lower = layout.parts[interface.parts[0]]
        mean = (lower.x[-1] - lower.x[0]) / lower.n_elements
        shares.append(tributary_lengths(layout.parts, interface) / mean)
    return np.concatenate(shares) if shares else np.zeros(0)


def completed(structure: Structure, case: Case, strain: StrainRows | None = None) -> Structure:
    """Return the structure with stops, impactors, drives, start and sensors of a case.

    Args:
        structure: the structure of the case, as it is discretised.
        case: the case.
        strain: strains of surfaces, see `with_sensors`; None: those of laminae that are apart.
    """
    n = structure.operators.n_own
    structure = struck(driven(structure, case), case)
    r = structure.operators.base.shift
    count = structure.operators.n_own - n  # impactors
    if strain is None or (r is None and not structure.layout.n_impactors):
        return with_forces(with_sensors(structure, case, strain), case)

    def shifted(*place: Any) -> sp.csr_matrix:
        row = strain(*place)
        free, base = row[:, :n], row[:, n:]
        if r is not None:
            base = base + sp.csr_matrix(structure.operators.total(free @ r[:n, None]))
        return sp.hstack([free, sp.csr_matrix((1, count)), base], format="csr")

    return with_forces(with_sensors(structure, case, shifted), case)


def driven(structure: Structure, case: Case) -> Structure:
    """Return the structure with the drive of a case: the motion of its base, or a force at a point.

    Forces at further places follow: see `with_forces`.

    Raises:
        CaseError: the point of the force is held, so that the force has no effect.
    """
    operators = structure.operators
    if case.excitation.acts_on == "base" or operators.base.is_force:
        return structure
    load = _load_of(structure, places_of(case.excitation)[0][0])
    return replace(structure, operators=replace(operators, base=BaseCoupling.force(load)))


def with_forces(structure: Structure, case: Case) -> Structure:
    """Return the structure with the forces that act besides its drive, as last rows of sensors.

    Args:
        structure: the structure with its drive and its sensors.
        case: the case.

    Raises:
        CaseError: the point of a force is held, so that the force has no effect.
    """
    o = structure.operators
    loads = [_load_of(structure, one) for one, *_ in places_of(case.excitation)[1:]]
    if not loads:
        return structure
    sensors = sp.vstack([o.sensors, sp.csr_matrix(np.array(loads))], format="csr")
    return replace(structure, operators=replace(o, sensors=sensors, n_forces=len(loads)))


def _load_of(structure: Structure, given: Excitation) -> FloatArray:
    """Return the loads on the own dofs by a unit of a force, shape (n_own,) [N/N].

    Raises:
        CaseError: its point is held.
    """
    layout = structure.layout
    name = getattr(given, "lamina", None) or ""
    position = getattr(given, "position", None)
    n = structure.operators.n_dofs
    row = row_at(layout, given, n)[:, : layout.n_numbered(n)]
    load = np.asarray(layout.of_dofs(row).toarray()[0])
    comm = None if layout.reading is None else layout.reading.comm
    # ranks may have the point, or none of it
    if not (load.any() if comm is None else any(comm.allgather(bool(load.any())))):
        raise CaseError(
            f"excitation.position: expected a point that can move, given {position!r} m, where "
            f"lamina {name} is held"
        )
    return load


def added_mass(
    case: Case, layout: Layout, n: int, masses: Sequence[PointMass]
) -> tuple[sp.csr_matrix, FloatArray]:
    """Return what point masses add to the mass matrix of free dofs and base, and to the lumped one.

    Args:
        case: the case.
        layout: of the structure.
        n: number of free dofs; column n is the base.
        masses: the masses, of the case or of one of its laminae.

    Returns:
        Matrix of shape (n + 1, n + 1), lumped if the case takes the lumped mass; the diagonal that
        they add to the lumped mass, shape (n + 1,) [kg].
    """
    matrix = sp.csr_matrix((n + 1, n + 1))
    lumped = np.zeros(n + 1)
    for point_mass in masses:
        part = layout.parts[layout.names.index(point_mass.lamina)]
        place = place_of(part, case.position_of(point_mass))
        row = columns_of(part, place, n)
        matrix = matrix + point_mass.mass * (row.T @ row)
        point = min(int(place), part.n_elements - 1)
        for node, share in ((point, 1.0 - (place - point)), (point + 1, place - point)):
            dof = int(part.dofs[node, DISPLACEMENT])
            if dof >= 0 or dof == BASE:
                lumped[dof if dof >= 0 else n] += share * point_mass.mass
    return (sp.diags(lumped, format="csr") if case.time.mass == "lumped" else matrix), lumped


def side_by_side(
    case: Case,
    parts: tuple[Part, ...],
    matrices: Sequence[sp.spmatrix],
    lumped: FloatArray,
    damping: sp.spmatrix | None = None,
    *,
    geometric: sp.spmatrix | None = None,
) -> Structure:
    """Return laminae that are apart, with their point masses; each has its own damping.

    The damping ratio of a lamina holds at its own modes, with its masses.

    Args:
        case: the case.
        parts: the laminae.
        matrices: M and K of the own points of all laminae, point by point, held ones included.
        lumped: diagonal of the lumped mass of the same dofs.
        damping: C of the same dofs without point masses; None: it follows from M and K.
        geometric: geometric stiffness of the same dofs; None: there are no axial forces.
    """
    layout = layout_of(case, parts)
    lines = [own_points(case, i, layout.x) for i in range(len(parts))]
    dofs = np.concatenate(
        [part.dofs[: line.size].ravel() for part, line in zip(layout.parts, lines, strict=True)]
    )
    n = int(dofs.max()) + 1
    moving = np.flatnonzero(dofs != FIXED)
    columns = np.where(dofs == BASE, n, dofs)[moving]
    to = sp.csr_matrix((np.ones(moving.size), (moving, columns)), shape=(dofs.size, n + 1))
    M, K = matrices
    if case.time.mass == "lumped":
        M = sp.diags(lumped, format="csr")
    if geometric is not None:
        K = K + geometric
    of_points = M, K
    lumped = to.T @ lumped
    M, K = (sp.csr_matrix(to.T @ matrix @ to) for matrix in of_points)
    added = []
    for lamina in case.lamina:
        masses = [point_mass for point_mass in case.masses if point_mass.lamina == lamina.name]
        matrix, diagonal = added_mass(case, layout, n, masses)
        added.append(matrix)
        M = sp.csr_matrix(M + matrix)
        lumped = lumped + diagonal
    # of each lamina; none where no support yields
    springs = [_springs(case, layout, n, i) for i in range(len(parts)) if has_springs(case)]
    for stiffness, _ in springs:
        K = sp.csr_matrix(K + stiffness)
    of_axial = None if geometric is None else to.T @ geometric @ to
    buckling = require_unbuckled(K, of_axial, n)
    if case.damping.rayleigh == "every mode":
        C = _of_every_mode(case, layout, M, K)
    elif damping is None or not all(map(case.has_exact_modes, range(len(parts)))):
        each = [lamina_damping(case, layout, i, M, K) for i in range(len(parts))]
        sizes = [2 * line.size for line in lines]
        alpha, beta = map(sp.diags, np.repeat(each, sizes, axis=0).T)
        C = to.T @ (alpha @ of_points[0] + beta @ of_points[1]) @ to
        C = C + sum(factor * matrix for (factor, _), matrix in zip(each, added, strict=True))
        for (_, factor), (stiffness, _) in zip(each, springs, strict=False):
            C = C + factor * stiffness if stiffness.nnz else C
    else:
        C = to.T @ damping @ to
    for _, dampers in springs:
        C = C + dampers if dampers.nnz else C
    operators = replace(_operators(case, layout, (M, C, K), lumped), buckling_factor=buckling)
    return completed(Structure(operators, layout), case)


def lamina_damping(
    case: Case, layout: Layout, i: int, M: sp.csr_matrix, K: sp.csr_matrix
) -> tuple[float, float]:
    """Return alpha [1/s] and beta [s] of a lamina that is apart, by its modes with its masses.

    Args:
        case: the case.
        layout: of the laminae as beams, bars or points.
        i: number of the lamina.
        M: mass of the free dofs, point masses included; it may have further rows and columns.
        K: stiffness, likewise.
    """
    lamina = case.lamina[i]
    dofs = layout.parts[i].own_dofs
    if case.has_exact_modes(i):
        return case.rayleigh(i)
    K = K[dofs][:, dofs]
    M = M[dofs][:, dofs]
    count = n_rigid(K)
    if dofs.size == count:
        return case.rayleigh(i)  # of what has no stiffness
    omega = _TWO_PI * elastic(K, M, min(2, dofs.size - count), count)[0]
    if case.is_of_points:
        return 0.0, 2.0 * lamina.damping_ratio / float(omega[0])
    first = float(omega[0])
    second = float(omega[-1])
    return harmonics.coefficients(lamina.damping_ratio, first, second, case.damping.kind)


def _of_every_mode(case: Case, layout: Layout, M: sp.csr_matrix, K: sp.csr_matrix) -> sp.spmatrix:
    """Return C = M Σ 2 D ω φ φᵀ M of free dofs and base, lamina by lamina, with φᵀ M φ = 1.

    It acts on motions relative to the base.
    """
    C = sp.csr_matrix(M.shape)
    n = M.shape[0] - 1
    for lamina, part in zip(case.lamina, layout.parts, strict=True):
        dofs = part.own_dofs
        inertia = M[dofs][:, dofs].toarray()
        squares, shapes = eigh(K[dofs][:, dofs].toarray(), inertia)
        momenta = inertia @ shapes
        squares[squares < _RIGID_SHARE * squares[-1]] = 0.0
        among = momenta * (2.0 * lamina.damping_ratio * np.sqrt(squares)) @ momenta.T
        relative = np.zeros((dofs.size, n + 1))
        relative[np.arange(dofs.size), dofs] = 1.0
        if K[dofs, n].count_nonzero():
            relative[:, n] = -1.0
        C = C + sp.csr_matrix(relative.T @ among @ relative)
    return C


def _operators(
    case: Case, layout: Layout, matrices: Sequence[sp.spmatrix], lumped: FloatArray
) -> Operators:
    """Return operators from M, C, K and the lumped mass, whose last column is the base."""
    n = lumped.size - 1
    M, C, K = (sp.csr_matrix(matrix) for matrix in matrices)
    m, c, k = (matrix[:n, n].toarray().ravel() for matrix in (M, C, K))
    return Operators(
        mass=M[:n, :n],
        damping=C[:n, :n],
        stiffness=K[:n, :n],
        lumped_mass=lumped[:n],
        base=BaseCoupling(m, c, k, corner=(float(M[n, n]), float(C[n, n]), float(K[n, n]))),
        gap_matrix=gap_matrix(layout.parts, layout.interfaces, n),
        gap0=gap_at_rest(case, layout),
        pair_weights=pair_weights(case, layout),
        probes=probe_rows(layout, n),
    )


_TWO_PI = 2.0 * np.pi


def own_points(case: Case, i: int, x: FloatArray) -> FloatArray:
    """Return the points of lamina i, of all points those up to its end, shape (n,) [m]."""
    return x[x <= case.lamina[i].length * (1.0 + EDGE_TOLERANCE)]


def apart_forces(case: Case, x: FloatArray) -> FloatArray | None:
    """Return the axial forces of laminae that are apart, (n_laminae, n, 2); None: there are none.

    Each is held along its axis where a support holds an end of it.
    """
    if not case.has_axial_forces:
        return None
    chains = []
    for i in range(len(case.lamina)):
        last = own_points(case, i, x).size - 1
        start, end = (
            -1 if turns_at(case, x, node, (i,)) is not None else 2 * i + k
            for k, node in enumerate((0, last))
        )
        chains.append((0, last, (i,), start, end))
    return axial_forces(case, x, chains)


def stack_forces(case: Case, stack: Network) -> FloatArray | None:
    """Return the axial forces of the laminae of a stack; None: there are none.

    Joints move along the axis without turning: the eccentricity of a force does not bend.
    """
    if not case.has_axial_forces:
        return None
    chains = []
    for segment, group in stack.groups():
        joints = [stack.axial[node, group[0]] for node in (segment.first, segment.last)]
        start, end = (-1 if joint == FIXED else joint for joint in joints)
        chains.append((segment.first, segment.last, group, start, end))
    return axial_forces(case, stack.x, chains)


def structure(
    case: Case,
    network: Network,
    mass: sp.spmatrix,
    stiffness: sp.spmatrix,
    lumped: FloatArray,
    *,
    geometric: sp.spmatrix | None = None,
) -> Structure:
    """Return the operators and the layout of a bonded stack.

    Args:
        case: the case.
        network: the unknowns of its stack.
        mass: M in the columns of the network.
        stiffness: K in the columns of the network.
        lumped: diagonal of the lumped mass in the columns of the network.
        geometric: geometric stiffness in the columns of the network; None: no axial forces.
    """
    n = network.n_free
    layout = layout_of(case, parts_of(case, network.x, network.dofs))
    if case.time.mass == "lumped":
        mass = sp.diags(lumped)
    added, diagonal = added_mass(case, layout, n, case.masses)
    M = sp.csr_matrix(sp.csr_matrix(mass)[: n + 1, : n + 1] + added)
    of_supports = _springs(case, layout, n)
    K = eliminated(stiffness, n + 1) + of_supports[0]
    if geometric is not None:
        K = K + sp.csr_matrix(geometric)[: n + 1, : n + 1]
    buckling = require_unbuckled(K, geometric, n)
    alpha, beta = damping(case, layout, M[:n, :n], K[:n, :n])
    C = alpha * M + beta * K + of_supports[1]
    operators = _operators(case, layout, (M, C, K), lumped[: n + 1] + diagonal)
    operators = replace(operators, buckling_factor=buckling)
    return completed(
        Structure(operators, layout), case, surface_strain(network, layout.parts, stiffness)
    )


def _springs(
    case: Case, layout: Layout, n: int, only: int | None = None
) -> tuple[sp.csr_matrix, sp.csr_matrix]:
    """Return stiffness and damping of the springs of supports, with the base as last row.

    Args:
        case: the case.
        layout: of its laminae as beams, bars or points.
        n: number of free dofs.
        only: number of the lamina whose springs count; None: all.
    """
    K, C = (sp.csr_matrix((n + 1, n + 1)) for _ in range(2))
    diagonal = np.zeros(n + 1)
    parts = layout.parts if only is None else (layout.parts[only],)
    for end, node in zip(ENDS, (0, -1), strict=True):
        if size := case.support.clamp_stiffness(end):
            diagonal[[part.dofs[node, SLOPE] for part in parts]] = size
    if diagonal.any():
        K = sp.csr_matrix(sp.diags(diagonal))
    base = sp.csr_matrix(([1.0], ([0], [n])), shape=(1, n + 1))
    for support, number in point_supports(case, layout, n):
        if only not in (None, number):
            continue
        part = layout.parts[number]
        place = place_of(part, support.x)
        row, turn = (columns_of(part, place, n, kind) for kind in (DISPLACEMENT, SLOPE))
        K = K + support.rotational_stiffness * turn.T @ turn
        if support.kind == "spring":
            K = K + (support.stiffness or 0.0) * (row - base).T @ (row - base)
            C = C + support.damping * (row - base).T @ (row - base)
    return K, C


def has_springs(case: Case) -> bool:
    """Return whether supports of a case are elastic or damp."""
    yields = any(map(case.support.clamp_stiffness, ENDS))
    return yields or any(
        support.kind == "spring" or support.rotational_stiffness for support in case.support.placed
    )


def _require_spring(support: PointSupport, order: int, part: Part) -> None:
    """Refuse a spring so stiff that the elements beside it are lost in its round-off.

    Args:
        support: a support with a side or a position.
        order: its number among these.
        part: the part that it holds.
    """
    h = np.diff(part.x)
    EI = part.flexural_rigidity
    of_node = {"stiffness": 24.0 * EI / h**3, "rotational_stiffness": 8.0 * EI / h}
    rigid = {"stiffness": 'kind = "pinned"', "rotational_stiffness": 'kind = "clamped"'}
    for key, of_elements in of_node.items():
        limit = RIGID * float(of_elements.max())
        value = getattr(support, key) or 0.0
        if value > limit:
            raise CaseError(
                f"support.{order}.{key}: expected at most {limit:.2g}, {RIGID:.0e} times "
                f"that of two elements of {part.name}, given {value:g}; for what is rigid take "
                f"{rigid[key]}"
            )


def point_supports(case: Case, layout: Layout, n: int) -> Iterator[tuple[PointSupport, int]]:
    """Yield each [[support]] with each part that it holds, of bonded parts the lowest.

    Args:
        case: the case.
        layout: of its laminae as beams.
        n: number of free dofs of the beams.

    Raises:
        CaseError: a spring is rigid beside the elements.
    """
    for order, support in enumerate(case.support.points(case.length), start=1):
        rows: set[tuple[bytes, ...]] = set()
        for number, part in enumerate(layout.parts):
            if support.lamina in (None, part.name):
                if not case.is_axial:
                    _require_spring(support, order, part)
                place = place_of(part, support.x)
                row = tuple(
                    columns_of(part, place, n, kind).indices.tobytes()
                    for kind in (DISPLACEMENT, SLOPE)
                )
                if row not in rows:  # otherwise bonded to the one before
                    rows.add(row)
                    yield support, number


def parts_of(
    case: Case, x: FloatArray, dofs: IntArray, sections: FloatArray | None = None
) -> tuple[Part, ...]:
    """Return the laminae of a case as parts.

    Args:
        case: the case.
        x: positions of the points of each lamina, shape (n_points,) [m].
        dofs: see `Part`, shape (n_laminae, n_points, 2).
        sections: EI [N m2] and ρA [kg/m] of each cell of each lamina, shape
            (2, n_laminae, n_points - 1); None: the constants of the case.
    """
    middles = 0.5 * (x[1:] + x[:-1])
    if sections is None:
        sections = np.array(
            [
                [lamina.flexural_rigidity_at(middles) for lamina in case.lamina],
                [lamina.mass_per_length_at(middles) for lamina in case.lamina],
            ]
        )
    sections = sections * np.array([middles < lamina.length for lamina in case.lamina])
    laminae = zip(case.lamina, dofs, *sections, strict=True)
    parts = (Part(lamina.name, x, *numbers) for lamina, *numbers in laminae)
    ends = np.stack([x[:-1], x[1:]], axis=1)
    inside = np.stack([middles, middles], axis=1)
    return tuple(
        part
        if lamina.is_uniform or case.is_axial
        else replace(part, end_rigidity=lamina.flexural_rigidity_at(ends, inside))
        for lamina, part in zip(case.lamina, parts, strict=True)
    )


def apart_parts(case: Case, x: FloatArray, sections: FloatArray | None = None) -> tuple[Part, ...]:
    """Return laminae side by side, each held by the supports of its own, as parts; see `parts_of`.

    What does not bend has no free slopes.
    """
    dofs = np.empty((len(case.lamina), x.size, 2), dtype=np.int64)
    n_free = 0
    for i, of_lamina in enumerate(dofs):
        of_lamina[:] = FIXED  # beyond its end
        for node, of_node in enumerate(of_lamina[: own_points(case, i, x).size]):
            turns = turns_at(case, x, node, (i,))
            of_node[DISPLACEMENT] = n_free if turns is None else BASE
            n_free += turns is None
            is_free = turns is not False and not case.is_axial
            of_node[SLOPE] = n_free if is_free else FIXED
            n_free += is_free
    return parts_of(case, x, dofs, sections)


def layout_of(
    case: Case,
    parts: tuple[Part, ...],
    interfaces: tuple[Interface, ...] | None = None,
    reading: Reading | None = None,
    places: tuple[Place, ...] = (),
) -> Layout:
    """Return the layout of the laminae of a case, with their probes.

    Args:
        case: the case.
        parts: its laminae, which share their points.
        interfaces: between them; None: of opposite points, see `opposite`.
        reading: what the points of the parts read from the dofs of a solid; None: `Part.dofs` are
            dofs.
        places: places of a plate that have readings of their own, the last rows of the reading.
    """
    if interfaces is None:
        per_element = case.contact.points_per_element
        pairs = pairwise(range(len(parts)))
        interfaces = in_order([opposite(parts, *pair, per_element=per_element) for pair in pairs])
    probes = probes_of(case, parts[0].x)
    return Layout(parts, interfaces, probes, reading=reading, places=places)


def probes_of(case: Case, x: FloatArray) -> tuple[Probe, ...]:
    """Return the probes: a reference probe on each lamina, and both sides of each delamination.

    Beams that are apart over their whole length have their tips alone, and so have points.

    The reference probes are at the free end of the longest delamination, or at its middle; without
    delaminations, at the free end of the structure, or at its middle. Of a plate: in the middle of
    the largest patch, or of the plate; and in the middles of the others.
    """
    if case.is_plate:
        return _probes_of_plate(case, x)
    node, name = _reference(case, x)
    probes = [
        Probe(name, i, min(node, own_points(case, i, x).size - 1)) for i in range(len(case.lamina))
    ]
    names = [lamina.name for lamina in case.lamina]
    is_bar = case.is_axial and not case.is_of_points
    inside = case.delamination if is_bar or not case.is_apart else ()
    for number, delamination in enumerate(inside, start=1):
        middle = _nearest(x, 0.5 * (delamination.start + delamination.end), case)
        for side in delamination.between:
            part = names.index(side)
            if (part, middle) not in {(probe.part, probe.point) for probe in probes}:
                probes.append(Probe(f"delamination-{number}-{side}", part, middle))
    return tuple(probes)


def _probes_of_plate(case: Case, x: FloatArray) -> tuple[Probe, ...]:
    """Return the probes of a plate; see `probes_of`."""
    names = [lamina.name for lamina in case.lamina]
    middle = case.reference_point
    places = [("middle", Place(part, *middle, 0)) for part in range(len(names))]
    for number, patch in enumerate(case.delamination, start=1):
        for side in patch.between:
            place = Place(names.index(side), *patch.middle, 0)
            if place not in (known for _, known in places):
                places.append((f"delamination-{number}-{side}", place))
    return tuple(
        Probe(name, place.part, _nearest(x, place.x, case), place) for name, place in places
    )


def _reference(case: Case, x: FloatArray) -> tuple[int, str]:
    """Return node and name of the reference probes."""
    L = case.length
    free_ends = tuple(end for end in ENDS if not case.support.holds(end))
    spans = [
        (delamination.start, delamination.end, open_ends(delamination, L, case.support))
        for delamination in case.delamination
    ]
    full_span = 0.0, L, free_ends
    start, end, free = max(spans or [full_span], key=lambda span: span[1] - span[0])
    if free:
        return {"start": 0, "end": x.size - 1}[free[-1]], "tip"
    return _nearest(x, 0.5 * (start + end), case), "middle"


def _nearest(x: FloatArray, place: float, case: Case) -> int:
    """Return the inner node nearest to a place that no support holds."""
    distance = np.abs(x[1:-1] - place)
    pins = [node_at(x, support.x) - 1 for support in case.support.held]
    distance[pins] += case.length
    return 1 + int(np.argmin(distance))


def damping(case: Case, layout: Layout, M: sp.csr_matrix, K: sp.csr_matrix) -> tuple[float, float]:
    """Return alpha [1/s] and beta [s] of C = alpha M + beta K of a stack.

    The damping ratio holds at the lowest modes of the structure with its delaminations kept closed.
    Where laminae have different ratios, each counts with its share of the strain energy of the
    bonded stack in bending.

    Args:
        case: damping ratios and model.
        layout: of the structure.
        M: mass of the free dofs.
        K: stiffness of the free dofs.
    """
    return damping_of(case, K, M, kept_closed(layout, M.shape[0]))


def damping_of(case: Case, K: Any, M: Any, S: Any) -> tuple[float, float]:
    """Return alpha [1/s] and beta [s] of a stack that moves as u = S w; see `damping`.

    K, M and S are of SciPy, or of PETSc on several ranks (collective).
    """
    frequencies, _ = elastic(closed_by(S, K), closed_by(S, M), 2, case.n_rigid)
    first, second = (_TWO_PI * frequencies).tolist()
    return harmonics.coefficients(_damping_ratio(case), first, second, case.damping.kind)


def _damping_ratio(case: Case) -> float:
    """Return the damping ratio of the bonded stack: the mean, weighted by bending stiffness."""
    laminae = [lamina.uniform for lamina in case.lamina]
    EA = np.array([lamina.axial_rigidity for lamina in laminae])
    thickness = np.array([lamina.mean("thickness") for lamina in laminae])
    z = np.cumsum(thickness) - 0.5 * thickness
    z = z - EA @ z / EA.sum()
    weights = np.array([lamina.flexural_rigidity for lamina in laminae]) + EA * z**2
    ratios = [lamina.damping_ratio for lamina in case.lamina]
    if len(set(ratios)) == 1:
        return ratios[0]
    return float(weights @ ratios / weights.sum())
