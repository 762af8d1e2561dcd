"""Contact points inside the elements of two laminae in lane order, at the cost of the elements.

The gap at a point of a cell is a mean of values at both ends a, b of the cell, with weights c:

    U = c₁ (G_a + t S_a) + c₃ (G_b - t' S_b) + δ,   t = c₂/c₁,   t' = -c₄/c₃                    (P1)

G and S are the gap and its slope at the nodes, those at rest included. δ is what the gap at rest at
the point has beyond the cubic interpolant; it is 0 for cubic shapes. With the largest t and t' of a
cell, its points lie above the smallest of the control values

    G_a - ε,   G_a + t S_a - ε,   G_b - t' S_b - ε,   G_b - ε,   ε >= -δ                       (P2)

(Bézier's control values, a little nearer to the curve). A step computes only these, four chains at
a time. Points are evaluated one by one only in cells where a control value is not positive. In the
cell at the clamp the points depend on one node, U = c₃ (G_b - t' S_b) + δ, and ε >= -δ/c₃.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline

from delam_fem.engines.compiled.lanes import (
    ROW,
    WIDTH,
    aligned_zeros,
    fma,
    least_lane,
    load,
    smaller,
    splat,
    swap_halves,
)
from delam_fem.model.operators import Operators
from delam_fem.numerics.types import FloatArray, IntArray
from delam_fem.system.kernels import njit

WHOLE = 1e-12
"""The weights of both ends add up to 1 but for this."""
GUARD = 1e-12
"""Allowance for round-off, relative to the largest gap at rest."""


class Points(NamedTuple):
    """The contact points by cells; cell k ends at the free node k.

    Attributes:
        n: number of free nodes of a lamina.
        control: G and S at rest, -t', t of each row of the lane order, shape (16 m,).
        place: place of u of the lower lamina at each node in lane order, shape (n,).
        bound: the same four numbers of each node, shape (n, 4).
        first: number of the first point of each cell in the arrays that follow, shape (n + 1,).
        pair: pair of each point, shape (n_pairs,).
        weight: c₁ to c₄ of each point, shape (n_pairs, 4).
        gap0: gap at rest of each point, shape (n_pairs,) [m].
    """

    n: int
    control: FloatArray
    place: IntArray
    bound: FloatArray
    first: IntArray
    pair: IntArray
    weight: FloatArray
    gap0: FloatArray


NO_POINTS = Points(
    0,
    *(np.zeros(0), np.zeros(0, dtype=np.int64), np.zeros((0, 4)), np.zeros(0, dtype=np.int64)),
    *(np.zeros(0, dtype=np.int64), np.zeros((0, 4)), np.zeros(0)),
)


def points_of(o: Operators, order: IntArray) -> Points | None:
    """Return the contact points of two laminae, or None if the gaps have another form.

    Args:
        o: operators with 4 n dofs, node by node.
        order: place of each dof in lane order, shape (4 n,).
    """
    n = o.n_dofs // 4
    cells_and_weights = _cells(o, n)
    if cells_and_weights is None:
        return None
    cell, weight = cells_and_weights
    at_node = (weight[:, 2] == 1.0) & ~weight[:, [0, 1, 3]].any(axis=1)
    if not np.array_equal(np.sort(cell[at_node]), np.arange(n)):
        return None
    by_cell = np.lexsort((weight[:, 2], cell))
    cell, weight, gap0 = cell[by_cell], weight[by_cell], o.gap0[by_cell]
    bound = _bounds(cell, weight, gap0, n)
    place = order[2 * np.arange(n)]
    control = aligned_zeros(4 * WIDTH * -(-o.n_dofs // ROW))
    tape = control.reshape(-1, 4, WIDTH)
    tape[:, 0] = np.inf  # where there is no node, and for the lanes of the upper lamina
    tape[place // ROW, :, place % ROW] = bound
    first = np.searchsorted(cell, np.arange(n + 1))
    return Points(n, control, place, bound, first, by_cell, weight, gap0)


def _cells(o: Operators, n: int) -> tuple[IntArray, FloatArray] | None:
    """Return cell and weights of each pair, or None if a row of H has another form than P1."""
    H = o.gap_matrix.tocsr()
    lower, upper = H[:, : 2 * n], H[:, 2 * n :].tocoo()
    if abs(lower + upper).max() != 0.0 or np.any(np.diff(H.indptr) == 0):
        return None
    node = upper.col // 2
    cell, start = np.zeros(o.n_pairs, dtype=np.int64), np.full(o.n_pairs, n)
    np.maximum.at(cell, upper.row, node)
    np.minimum.at(start, upper.row, node)
    if np.any(cell - start > 1):
        return None
    weight = np.zeros((o.n_pairs, 4))
    np.add.at(weight, (upper.row, upper.col - 2 * cell[upper.row] + 2), upper.data)
    at_start, by_start, at_end, by_end = weight.T
    is_whole = (np.abs(at_start + at_end - 1.0) < WHOLE) | (cell == 0)
    is_mean = (at_start >= 0.0) & (by_start >= 0.0) & (at_end > 0.0) & (by_end <= 0.0)
    is_free = (at_start > 0.0) | (by_start == 0.0)
    return (cell, weight) if bool(np.all(is_whole & is_mean & is_free)) else None


def _bounds(cell: IntArray, weight: FloatArray, gap0: FloatArray, n: int) -> FloatArray:
    """Return G - ε and S at rest, -t' and t of each node (P2), shape (n, 4)."""
    at_start, by_start, at_end, by_end = weight.T
    slope = _slopes(cell, weight, gap0, n)
    value = gap0[np.searchsorted(cell, np.arange(n), side="right") - 1]
    before, after, short = np.zeros(n), np.zeros(n), np.zeros(n)
    np.maximum.at(before, cell, -by_end / at_end)
    start, has_start = np.maximum(cell - 1, 0), at_start > 0.0
    np.maximum.at(
        after, start[has_start], (by_start / np.where(has_start, at_start, 1.0))[has_start]
    )
    cubic = at_end * value[cell] + by_end * slope[cell]
    cubic[has_start] += (at_start * value[start] + by_start * slope[start])[has_start]
    guard = GUARD * float(np.abs(gap0).max())
    lack = (np.maximum(cubic - gap0, 0.0) + guard) / np.where(cell == 0, at_end, 1.0)
    np.maximum.at(short, cell, lack)
    np.maximum.at(short, start[has_start], lack[has_start])
    return np.column_stack([value - short, slope, -before, after])


def _slopes(cell: IntArray, weight: FloatArray, gap0: FloatArray, n: int) -> FloatArray:
    """Return the slopes of the gap at rest at the nodes by a cubic spline, shape (n,).

    The spline begins at the first node: the gap at the clamp is not known here. Any slopes are
    allowed, as ε makes up for them; these are exact for cubic shapes.
    """
    _, by_start, _, by_end = weight.T
    local, h, inside = np.ones(cell.size), np.zeros(n), by_start > 0.0
    bend = (by_start - by_end)[inside]  # h X (1 - X), where by_start = h X (1 - X)²
    local[inside] = -by_end[inside] / bend
    h[cell[inside]] = bend / (local * (1.0 - local))[inside]
    known = (cell > 0) | (weight[:, 2] == 1.0)
    x = np.cumsum(h)[cell] - (1.0 - local) * h[cell]
    if known.sum() < 2 or np.any(np.diff(x[known]) <= 0.0):
        return np.zeros(n)
    return np.asarray(CubicSpline(x[known], gap0[known])(np.cumsum(h), 1))


@njit(forceinline=True)
def lowest_control(X, size, control, ahead):  # type: ignore[no-untyped-def]
    """Return the smallest control value (P2) at the displacements u + ahead v."""
    least, time = splat(np.inf), splat(ahead)
    for i in range(0, size, 8):
        u = fma(time, load(X, size + i), load(X, i))
        phi = fma(time, load(X, size + i + 4), load(X, i + 4))
        gap = swap_halves(u) - u + load(control, 2 * i)
        slope = swap_halves(phi) - phi + load(control, 2 * i + 4)
        least = smaller(fma(load(control, 2 * i + 8), slope, gap), least)
        least = smaller(fma(load(control, 2 * i + 12), slope, gap), least)
    return least_lane(least)


@njit(forceinline=True)
def lowest_approach(X, size, control, ahead):  # type: ignore[no-untyped-def]
    """Return the smallest C + min(ahead Ċ, 0) of all control values C (P2) at u and v."""
    least, time, zero = splat(np.inf), splat(ahead), splat(0.0)
    for i in range(0, size, 8):
        u, phi, v, omega = (
            load(X, i), load(X, i + 4), load(X, size + i), load(X, size + i + 4)
        )  # fmt: skip
        gap = swap_halves(u) - u + load(control, 2 * i)
        slope = swap_halves(phi) - phi + load(control, 2 * i + 4)
        rate, turn = time * (swap_halves(v) - v), time * (swap_halves(omega) - omega)
        for j in range(2 * i + 8, 2 * i + 16, 4):
            shift = smaller(fma(load(control, j), turn, rate), zero)
            least = smaller(fma(load(control, j), slope, gap) + shift, least)
    return least_lane(least)


@njit(forceinline=True)
def _shift(rate, ahead, is_closing):  # type: ignore[no-untyped-def]
    """Return ahead · rate, or min(ahead · rate, 0) if only closing counts."""
    return min(ahead * rate, 0.0) if is_closing else ahead * rate


@njit(forceinline=True)
def _lowest(bound, at, ends, motion, by):  # type: ignore[no-untyped-def]
    """Return the smaller control value (P2) of one node towards one of its cells."""
    (gap, slope), (rate, turn), (ahead, is_closing) = ends, motion, by
    t = bound[at]
    beside = gap + t * slope + _shift(rate + t * turn, ahead, is_closing)
    return min(gap + _shift(rate, ahead, is_closing), beside)


@njit
def measure(points, size, X, ahead, is_closing, gap, rate):  # type: ignore[no-untyped-def]
    """Write gaps and gap rates of the points of all cells with a control value below 0 (P2).

    The gaps are U + ahead U̇, or U + min(ahead U̇, 0) if `is_closing`. The gaps of all other points
    are set to infinity: they are open.

    Returns:
        The smallest gap.
    """
    smallest, above, by = np.inf, np.inf, (ahead, is_closing)
    U = S = dU = dS = 0.0
    for k in range(points.n):
        at, rest = points.place[k], 4 * k
        V, T = X[at + 2] - X[at], X[at + 6] - X[at + 4]
        at += size
        dV, dT = X[at + 2] - X[at], X[at + 6] - X[at + 4]
        ends = V + points.bound[rest], T + points.bound[rest + 1]
        below = _lowest(points.bound, rest + 2, ends, (dV, dT), by)
        is_open = above > 0.0 and below > 0.0
        for j in range(points.first[k], points.first[k + 1]):
            pair, c = points.pair[j], 4 * j
            gap[pair] = np.inf
            if not is_open:
                c1, c2 = points.weight[c], points.weight[c + 1]
                c3, c4 = points.weight[c + 2], points.weight[c + 3]
                rate[pair] = c1 * dU + c2 * dS + c3 * dV + c4 * dT
                value = points.gap0[j] + c1 * U + c2 * S + c3 * V + c4 * T
                gap[pair] = value + _shift(rate[pair], ahead, is_closing)
                smallest = min(smallest, gap[pair])
        above = _lowest(points.bound, rest + 3, ends, (dV, dT), by)
        U, S, dU, dS = V, T, dV, dT
    return smallest


@njit(forceinline=True)
def see(system, memory, ahead, touch):  # type: ignore[no-untyped-def]
    """Return the smallest gap at u + ahead v, or a smaller number above `touch`.

    `touch` is 0 or less. Unless the result is larger, write the gaps and the gap rates of all
    pairs; see `measure`.
    """
    X, size = memory.X, system.size
    least = lowest_control(X, size, system.points.control, ahead)
    if least > touch:
        return least
    return measure(system.points, size, X, ahead, False, memory.gap, memory.rate)


@njit(forceinline=True)
def see_approach(system, memory, ahead):  # type: ignore[no-untyped-def]
    """Do the same as `see` for U + min(ahead U̇, 0), with `touch` = 0.

    The values go to `present_gap` and `present_rate`: `gap` and `rate` are those of the law.
    """
    X, size, gap, rate = memory.X, system.size, memory.present_gap, memory.present_rate
    least = lowest_approach(X, size, system.points.control, ahead)
    if least > 0.0:
        return least
    return measure(system.points, size, X, ahead, True, gap, rate)
