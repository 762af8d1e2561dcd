"""Contact pairs: the gap operator, the weights of pairs, the rows of probes.

A pair is at two opposite points, or inside two opposite cells, where the gap is that of the cubic
Hermite interpolants of both parts.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.sparse as sp

from delam_fem.model.layout import BASE, DISPLACEMENT, Interface, Layout, Part
from delam_fem.numerics.arrays import FloatArray, IntArray

CURVATURE = 2
"""The second derivative of the interpolant, beside DISPLACEMENT and SLOPE."""
_AT_POINT = 1e-9
"""Share of a cell within which a place is at its end."""


def opposite(
    parts: Sequence[Part], lower: int, upper: int, first_pair: int = 0, *, per_element: int = 1
) -> Interface:
    """Pair the opposite points of two parts, except points where both are held or bonded.

    Args:
        parts: all parts of the structure.
        lower: number of the lower part.
        upper: number of the upper part, which has the same number of points.
        first_pair: row of the first pair in the gap operator.
        per_element: number of pairs per element, at the local coordinates 1/p, 2/p, …, 1; 1: only
            the points.
    """
    free = [part.dofs[:, DISPLACEMENT] >= 0 for part in (parts[lower], parts[upper])]
    is_bonded = parts[lower].dofs[:, DISPLACEMENT] == parts[upper].dofs[:, DISPLACEMENT]
    is_apart = (free[0] | free[1]) & ~is_bonded
    points = np.flatnonzero(is_apart)
    name = f"{parts[lower].name}-{parts[upper].name}"
    if per_element == 1:
        return Interface(name, (lower, upper), np.column_stack([points, points]), first_pair)
    n = parts[lower].n_elements
    ends = np.concatenate([[0], np.repeat(np.arange(1, n + 1), per_element)])
    local = np.concatenate([[1.0], np.tile(np.arange(1, per_element + 1) / per_element, n)])
    within = is_apart[ends] | is_apart[np.maximum(ends - 1, 0)]  # of elements that are not bonded
    is_kept = np.where(local < 1.0, within, is_apart[ends])
    both = [np.column_stack([values[is_kept]] * 2) for values in (ends, local)]
    return Interface(name, (lower, upper), both[0], first_pair, both[1])


def neighbours(parts: Sequence[Part], per_element: int) -> tuple[Interface, ...]:
    """Pair each part with the next one; see `opposite`."""
    interfaces: list[Interface] = []
    for lower in range(len(parts) - 1):
        first_pair = sum(len(interface.points) for interface in interfaces)
        interfaces.append(opposite(parts, lower, lower + 1, first_pair, per_element=per_element))
    return tuple(interfaces)


def interpolation_rows(
    part: Part, places: FloatArray, n_dofs: int, component: int = DISPLACEMENT
) -> sp.csr_matrix:
    """Return rows that evaluate the cubic Hermite interpolant of a part, shape (k, n_dofs).

        u(X) = (1 - 3 X² + 2 X³) u₀ + (X - 2 X² + X³) h φ₀ + (3 X² - 2 X³) u₁ + (X³ - X²) h φ₁

    Points that are held add no entries: the rows give what the free dofs contribute.

    Args:
        part: the part.
        places: numbers of points; 2.25 lies a quarter of the cell behind point 2, shape (k,).
        n_dofs: number of dofs of the structure.
        component: DISPLACEMENT for u, SLOPE for u'.
    """
    cells, weights = interpolation(part, places, component)
    dofs = np.concatenate([part.dofs[cells], part.dofs[cells + 1]], axis=1)  # (k, 4)
    rows = np.repeat(np.arange(len(places))[:, None], 4, axis=1)
    there = (dofs >= 0) & (weights != 0.0)
    entries = weights[there], (rows[there], dofs[there])
    return sp.csr_matrix(entries, shape=(len(places), n_dofs))


def interpolation(
    part: Part,
    places: FloatArray,
    component: int = DISPLACEMENT,
    cells: IntArray | None = None,
) -> tuple[IntArray, FloatArray]:
    """Return the cell of each place, and the weights of (u₀, φ₀, u₁, φ₁) of this cell.

    Args:
        part: gives the points.
        places: numbers of points; 2.25 lies a quarter of the cell behind point 2, shape (k,).
        component: DISPLACEMENT for u, SLOPE for u', CURVATURE for u''.
        cells: the cells, for places between two; None: those that end there, shape (k,).

    Returns:
        Cells, shape (k,), and weights, shape (k, 4).
    """
    if cells is None:
        cells = np.clip(np.ceil(places).astype(np.int64) - 1, 0, part.n_elements - 1)
    X, h = places - cells, np.diff(part.x)[cells]
    if component == DISPLACEMENT:
        terms = (
            1.0 - 3.0 * X**2 + 2.0 * X**3,
            (X - 2.0 * X**2 + X**3) * h,
            3.0 * X**2 - 2.0 * X**3,
            (X**3 - X**2) * h,
        )
    elif component == CURVATURE:
        bend = (12.0 * X - 6.0) / h**2
        terms = (bend, (6.0 * X - 4.0) / h, -bend, (6.0 * X - 2.0) / h)
    else:
        bend = 6.0 * (X**2 - X) / h
        terms = (bend, 1.0 - 4.0 * X + 3.0 * X**2, -bend, 3.0 * X**2 - 2.0 * X)
    return cells, np.stack(terms, axis=1)


def place_of(part: Part, x: float) -> float:
    """Return a position [m] as a number of points; 2.25 lies a quarter of the cell behind 2."""
    place = float(np.interp(x, part.x, np.arange(part.x.size, dtype=np.float64)))
    return float(round(place)) if abs(place - round(place)) < _AT_POINT else place


def cells_at(part: Part, place: float) -> tuple[int, ...]:
    """Return the cells in which or at whose ends a place is: one, or two at an inner point."""
    first = max(int(np.ceil(place)) - 1, 0)
    is_between = place == round(place) and 0 < place < part.n_elements
    return (first, first + 1) if is_between else (first,)


def columns_of(
    part: Part, place: float, n_dofs: int, component: int = DISPLACEMENT, cell: int | None = None
) -> sp.csr_matrix:
    """Return a row that evaluates the interpolant of a part from free dofs and base, (1, n + 1).

    Args:
        part: the part.
        place: number of a point; see `interpolation_rows`.
        n_dofs: n, number of dofs of the structure; column n is the base.
        component: DISPLACEMENT, SLOPE or CURVATURE.
        cell: the cell, for a place between two; None: the one that ends there.
    """
    given = None if cell is None else np.array([cell])
    cells, weights = interpolation(part, np.array([place]), component, given)
    row = np.zeros(n_dofs + 1)
    for dof, weight in zip(part.dofs[cells[0] : cells[0] + 2].ravel(), weights[0], strict=True):
        if dof >= 0 or dof == BASE:
            row[dof if dof >= 0 else n_dofs] += weight
    return sp.csr_matrix(row)


def gap_matrix(
    parts: Sequence[Part], interfaces: Sequence[Interface], n_dofs: int
) -> sp.csr_matrix:
    """Return H of all pairs: gap rate = u̇ of the upper point − u̇ of the lower, (n_pairs, n_dofs).

    A point that is held adds no entry to its row: both parts move with the base there.
    """
    blocks = []
    for interface in sorted(interfaces, key=lambda interface: interface.first_pair):
        lower, upper = (
            interpolation_rows(parts[number], interface.places(side), n_dofs)
            for side, number in enumerate(interface.parts)
        )
        blocks.append(upper - lower)
    return sp.vstack(blocks, format="csr") if blocks else sp.csr_matrix((0, n_dofs))


def tributary_lengths(parts: Sequence[Part], interface: Interface) -> FloatArray:
    """Return the length of the lower part that belongs to each pair, shape (n_pairs,) [m].

    A length is half of the distances to the next points or pairs on both sides. With these weights,
    springs per length do not depend on the mesh.
    """
    lower, own = parts[interface.parts[0]], interface.places(0)
    places = np.unique(np.concatenate([np.arange(lower.x.size, dtype=np.float64), own]))
    h = np.diff(lower.positions(places))
    lengths = np.zeros(h.size + 1)
    lengths[:-1] += 0.5 * h
    lengths[1:] += 0.5 * h
    return np.asarray(lengths[np.searchsorted(places, own)])


def probe_rows(layout: Layout, n_dofs: int) -> sp.csr_matrix:
    """Return the rows of the probes of a layout; they record displacements of free points.

    Shape (n_probes, n_dofs).
    """
    dofs = [layout.parts[p.part].dofs[p.point, DISPLACEMENT] for p in layout.probes]
    return layout.of_dofs(selection(dofs, layout.n_numbered(n_dofs)))


def selection(dofs: Sequence[int] | IntArray, n_dofs: int) -> sp.csr_matrix:
    """Return probe rows that each pick one dof, shape (n_probes, n_dofs)."""
    n = len(dofs)
    return sp.csr_matrix((np.ones(n), np.asarray(dofs), np.arange(n + 1)), shape=(n, n_dofs))
