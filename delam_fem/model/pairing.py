"""Contact pairs of opposite points: the gap operator, the weights of pairs, the rows of probes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.sparse as sp

from delam_fem.model.layout import DISPLACEMENT, Interface, Layout, Part
from delam_fem.numerics.arrays import FloatArray, IntArray


def opposite(parts: Sequence[Part], lower: int, upper: int, first_pair: int = 0) -> Interface:
    """Pair the opposite points of two parts, except points where both parts are held.

    Args:
        parts: all parts of the structure.
        lower: number of the lower part.
        upper: number of the upper part, which has the same number of points.
        first_pair: row of the first pair in the gap operator.
    """
    free = [part.dofs[:, DISPLACEMENT] >= 0 for part in (parts[lower], parts[upper])]
    points = np.flatnonzero(free[0] | free[1])
    name = f"{parts[lower].name}-{parts[upper].name}"
    return Interface(name, (lower, upper), np.column_stack([points, points]), first_pair)


def gap_matrix(
    parts: Sequence[Part], interfaces: Sequence[Interface], n_dofs: int
) -> sp.csr_matrix:
    """Return H of all pairs: gap rate = u̇ of the upper point − u̇ of the lower, (n_pairs, n_dofs).

    A point that is held adds no entry to its row.
    """
    rows, columns, values, n_pairs = [], [], [], 0
    for interface in interfaces:
        n = len(interface.points)
        for side, sign in ((0, -1.0), (1, 1.0)):
            part = parts[interface.parts[side]]
            dofs = part.dofs[interface.points[:, side], DISPLACEMENT]
            free = np.flatnonzero(dofs >= 0)
            rows.append(interface.first_pair + free)
            columns.append(dofs[free])
            values.append(np.full(free.size, sign))
        n_pairs = max(n_pairs, interface.first_pair + n)
    if not rows:
        return sp.csr_matrix((0, n_dofs))
    entries = np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))
    return sp.csr_matrix(entries, shape=(n_pairs, n_dofs))


def tributary_lengths(parts: Sequence[Part], interface: Interface) -> FloatArray:
    """Return the length of the lower part that belongs to each pair, shape (n_pairs,) [m].

    A length is half of both cells that meet at the point. With these weights, springs per length do
    not depend on the mesh.
    """
    h = np.diff(parts[interface.parts[0]].x)
    lengths = np.zeros(h.size + 1)
    lengths[:-1] += 0.5 * h
    lengths[1:] += 0.5 * h
    return np.asarray(lengths[interface.points[:, 0]])


def probe_rows(layout: Layout, n_dofs: int) -> sp.csr_matrix:
    """Return the rows of the probes of a layout; they record displacements of free points.

    Shape (n_probes, n_dofs).
    """
    dofs = [layout.parts[p.part].dofs[p.point, DISPLACEMENT] for p in layout.probes]
    return selection(dofs, n_dofs)


def selection(dofs: Sequence[int] | IntArray, n_dofs: int) -> sp.csr_matrix:
    """Return probe rows that each pick one dof, shape (n_probes, n_dofs)."""
    n = len(dofs)
    return sp.csr_matrix((np.ones(n), np.asarray(dofs), np.arange(n + 1)), shape=(n, n_dofs))
