"""Gaps that depend on several unknowns: points inside elements in lane order, and modes.

Contact points inside the elements of two laminae in lane order cost little more than the elements
alone. The gap at a point of a cell is a mean of values at both ends a, b of the cell, with weights
c:

    U = c₁ (G_a + t S_a) + c₃ (G_b - t' S_b) + δ,   t = c₂/c₁,   t' = -c₄/c₃                    (P1)

G and S are the gap and its slope at the nodes, those at rest included. δ is what the gap at rest at
the point has beyond the cubic interpolant; it is 0 for cubic shapes. With the largest t and t' of a
cell, its points lie above the smallest of the control values

    G_a - ε,   G_a + t S_a - ε,   G_b - t' S_b - ε,   G_b - ε,   ε >= -δ                       (P2)

(Bézier's control values, a little nearer to the curve). A step computes only these, four chains at
a time. Points are evaluated one by one only in cells where a control value is not positive. In the
cell at the clamp the points depend on one node, U = c₃ (G_b - t' S_b) + δ, and ε >= -δ/c₃.

In the modes of a small problem a step of the θ-scheme needs no linear solve. With all n modes Φ of
K φ = λ M φ, normalised to Φᵀ M Φ = I, and damping that they make diagonal (any Rayleigh damping),
u = Φ η turns M, C, K into diagonal matrices. The scheme is the same, only the coordinates differ.
The gap operator becomes the dense matrix H Φ, so this pays for few pairs. Reduced models
(model/reduction) come in such coordinates, and are taken as they are.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import scipy  # loads its parts when they are used
import scipy.sparse as sp
from scipy.linalg import eigh

from delam_fem.engines.compiled.simd_chains import (
    ROW,
    WIDTH,
    P,
    aligned_zeros,
    fma,
    least_lane,
    load,
    smaller,
    splat,
    store,
    swap_halves,
    total,
)
from delam_fem.engines.compiled.state import IS_SEEN
from delam_fem.model.operators import BaseCoupling, Operators
from delam_fem.numerics.types import FloatArray, IntArray
from delam_fem.system.caches import njit

WHOLE = 1e-12
"""Largest difference of the sum of the weights of both ends from 1."""
GUARD = 1e-12
"""Allowance for round-off, relative to the largest gap at rest."""


class Points(NamedTuple):
    """The contact points by cells; cell k ends at the free node k.

    Attributes:
        n: number of free nodes of a lamina.
        control: G and S at rest, -t', t of each row of the lane order, shape (16 m,).
        place: place of u of the lower lamina at each node in lane order, shape (n,).
        bound: the four numbers of `control`, node by node, shape (n, 4).
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
    cell = cell[by_cell]
    weight = weight[by_cell]
    gap0 = o.gap0[by_cell]
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
    lower = H[:, : 2 * n]
    upper = H[:, 2 * n :].tocoo()
    if abs(lower + upper).max() != 0.0 or np.any(np.diff(H.indptr) == 0):
        return None
    node = upper.col // 2
    # cell k lies between the free nodes k - 1 and k; the dofs of node k are 2 k and 2 k + 1. A row
    # of H has entries at both ends of one cell, c₁ to c₄ in the columns 2 k - 2 … 2 k + 1.
    cell = np.zeros(o.n_pairs, dtype=np.int64)
    start = np.full(o.n_pairs, n)
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
    before = np.zeros(n)
    after = np.zeros(n)
    short = np.zeros(n)
    np.maximum.at(before, cell, -by_end / at_end)
    start = np.maximum(cell - 1, 0)
    has_start = at_start > 0.0
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
    local = np.ones(cell.size)
    h = np.zeros(n)
    inside = by_start > 0.0
    # of cubic shapes: by_start = h X (1 - X)², by_end = -h X² (1 - X), so X and h follow from them
    bend = (by_start - by_end)[inside]  # h X (1 - X), where by_start = h X (1 - X)²
    local[inside] = -by_end[inside] / bend
    h[cell[inside]] = bend / (local * (1.0 - local))[inside]
    known = (cell > 0) | (weight[:, 2] == 1.0)
    x = np.cumsum(h)[cell] - (1.0 - local) * h[cell]
    if known.sum() < 2 or np.any(np.diff(x[known]) <= 0.0):
        return np.zeros(n)
    return np.asarray(scipy.interpolate.CubicSpline(x[known], gap0[known])(np.cumsum(h), 1))


@njit(forceinline=True)
def lowest_control(X, size, control, ahead, is_closing):  # type: ignore[no-untyped-def]
    """Return the smallest C + ahead Ċ of all control values C (P2) at u and v.

    If `is_closing`, min(ahead Ċ, 0) takes the place of ahead Ċ.
    """
    least = splat(np.inf)
    time = splat(ahead)
    zero = splat(0.0)
    for i in range(0, size, 8):
        # 16 numbers of `control` belong to a row: G, S, -t', t at rest of its node in each chain
        u = load(X, i)
        phi = load(X, i + 4)
        v = load(X, size + i)
        omega = load(X, size + i + 4)  # fmt: skip
        gap = swap_halves(u) - u + load(control, 2 * i)
        slope = swap_halves(phi) - phi + load(control, 2 * i + 4)
        rate = time * (swap_halves(v) - v)
        turn = time * (swap_halves(omega) - omega)
        for j in range(2 * i + 8, 2 * i + 16, 4):
            shift = fma(load(control, j), turn, rate)
            if is_closing:
                shift = smaller(shift, zero)
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
def measure_cells(points, size, X, ahead, is_closing, gap, rate):  # type: ignore[no-untyped-def]
    """Write gaps and gap rates of the points of all cells with a control value below 0 (P2).

    The gaps are U + ahead U̇, or U + min(ahead U̇, 0) if `is_closing`. The gaps of all other points
    are set to infinity: they are open.

    Returns:
        The smallest gap.
    """
    smallest = np.inf
    above = np.inf
    by = (ahead, is_closing)
    U = S = dU = dS = 0.0
    for k in range(points.n):
        at = points.place[k]
        first_bound = 4 * k
        # the upper lamina is two lanes behind the lower one; slopes are four numbers behind u
        V = X[at + 2] - X[at]
        T = X[at + 6] - X[at + 4]
        at += size
        dV = X[at + 2] - X[at]
        dT = X[at + 6] - X[at + 4]
        ends = V + points.bound[first_bound], T + points.bound[first_bound + 1]
        below = _lowest(points.bound, first_bound + 2, ends, (dV, dT), by)
        is_open = above > 0.0 and below > 0.0
        for j in range(points.first[k], points.first[k + 1]):
            pair = points.pair[j]
            c = 4 * j
            gap[pair] = np.inf
            if not is_open:
                c1, c2 = points.weight[c], points.weight[c + 1]
                c3, c4 = points.weight[c + 2], points.weight[c + 3]
                rate[pair] = c1 * dU + c2 * dS + c3 * dV + c4 * dT
                value = points.gap0[j] + c1 * U + c2 * S + c3 * V + c4 * T
                gap[pair] = value + _shift(rate[pair], ahead, is_closing)
                smallest = min(smallest, gap[pair])
        above = _lowest(points.bound, first_bound + 3, ends, (dV, dT), by)
        U = V
        S = T
        dU = dV
        dS = dT
    return smallest


@njit(forceinline=True)
def see_cells(system, X, ahead, is_closing, touch, gap, rate):  # type: ignore[no-untyped-def]
    """Return the smallest gap of `measure_cells`, or a smaller number above `touch`.

    `touch` is 0 or less. Unless the result is larger, write the gaps and the gap rates of all
    pairs.
    """
    least = lowest_control(X, system.size, system.points.control, ahead, is_closing)
    if least > touch:
        return least
    return measure_cells(system.points, system.size, X, ahead, is_closing, gap, rate)


MOST_DOFS = 320
"""Largest number of dofs: the modes of more take seconds."""
NOT_DIAGONAL = 1e-9
"""Largest entry of Φᵀ C Φ beside its diagonal, relative to the diagonal, that is round-off."""
MANY = 8
"""Mean number of unknowns in a gap above which dense rows are taken."""
_REFINEMENTS = 2
"""Steps of Ogita and Aishima; each squares the error of the modes."""
_FIRST_ORDER = 0.1
"""Largest mix of two modes that the first order corrects; modes that are closer, as the rigid ones
of a free body, are a cluster, in which any mix that is orthonormal serves."""
_NORMALISATIONS = 3
"""Steps that make modes orthonormal, also those of a cluster; each squares what is lacking."""

Long = npt.NDArray[np.longdouble]


@dataclass(frozen=True)
class Places:
    """Internal unknowns that are the dofs in another order.

    Attributes:
        order: place of each dof, shape (n,).
        size: number of places.
    """

    order: IntArray
    size: int

    def inward(self, fields: FloatArray) -> FloatArray:
        """Return fields of dofs, shape (…, n), in internal order, shape (…, size)."""
        result = np.zeros((*fields.shape[:-1], self.size))
        result[..., self.order] = fields
        return result

    def outward(self, fields: FloatArray) -> FloatArray:
        """Return fields in internal order, shape (…, size), by dofs, shape (…, n)."""
        return np.asarray(fields[..., self.order])


@dataclass(frozen=True)
class InnerModes:
    """Internal unknowns that are the amplitudes of modes.

    Attributes:
        shapes: Φ, one mode a column, shape (n, size).
        dual: M Φ, shape (n, size).
    """

    shapes: FloatArray
    dual: FloatArray

    @property
    def size(self) -> int:
        """Number of modes, with those that fill the last row up."""
        return self.shapes.shape[1]

    def inward(self, fields: FloatArray) -> FloatArray:
        """Return the amplitudes of fields of dofs: Φᵀ M u, shape (…, size)."""
        return np.asarray(fields @ self.dual)

    def outward(self, fields: FloatArray) -> FloatArray:
        """Return amplitudes by dofs: Φ η, shape (…, n)."""
        return np.asarray(fields @ self.shapes.T)


Coordinates = Places | InnerModes


@lru_cache(maxsize=4)
def in_modes(o: Operators) -> tuple[Operators, InnerModes] | None:
    """Return a problem in its modes, or None if that does not pay or damping couples them.

    The last results are kept.
    """
    if is_reduced(o):
        shapes = np.eye(o.n_dofs, ROW * -(-o.n_dofs // ROW))
        return padded(o), InnerModes(shapes, shapes)
    return _transformed(o) if _is_faster_in_modes(o) else None


def is_reduced(o: Operators) -> bool:
    """Return whether M, C and K are diagonal and gaps depend on many of the unknowns.

    Operators of a reduced model (model/reduction.py) are like that.
    """
    matrices = (sp.coo_matrix(matrix) for matrix in (o.mass, o.damping, o.stiffness))
    is_diagonal = all(not matrix.data[matrix.row != matrix.col].any() for matrix in matrices)
    return bool(is_diagonal and o.gap_matrix.nnz > MANY * max(o.n_pairs, 1))


def padded(o: Operators) -> Operators:
    """Return diagonal operators, filled up to a multiple of `ROW` by unknowns without effect."""
    n = o.n_dofs
    size = ROW * -(-o.n_dofs // ROW)
    columns = ((0, 0), (0, size - n))

    def diagonal(matrix: sp.csr_matrix, filling: float) -> sp.csr_matrix:
        return sp.diags(np.append(matrix.diagonal(), np.full(size - n, filling)), format="csr")

    def rows(matrix: sp.csr_matrix) -> sp.csr_matrix:
        return sp.csr_matrix(np.pad(matrix.toarray(), columns))

    base = np.pad(np.stack([o.base.mass, o.base.damping, o.base.stiffness]), columns)
    shift = None if o.base.shift is None else np.append(o.base.shift, np.zeros(size - n))
    return replace(
        o,
        mass=diagonal(o.mass, 1.0),
        damping=diagonal(o.damping, 0.0),
        stiffness=diagonal(o.stiffness, 0.0),
        base=replace(o.base, mass=base[0], damping=base[1], stiffness=base[2], shift=shift),
        gap_matrix=rows(o.gap_matrix),
        lumped_mass=None if o.lumped_mass is None else np.append(o.lumped_mass, np.ones(size - n)),
        load=None if o.load is None else np.append(o.load, np.zeros(size - n)),
        probes=rows(o.probes),
        sensors=rows(o.sensors),
        start=None,  # it is that of all dofs
    )


def _is_faster_in_modes(o: Operators) -> bool:
    """Return whether the rows of H in modes cost less than what a step in bands costs.

    A product with a dense row takes about a quarter of the time of one with a sparse row by entry.
    """
    n = o.n_dofs
    if not 0 < n <= MOST_DOFS:
        return False
    pattern = sp.coo_matrix(abs(o.mass) + abs(o.stiffness) + abs(o.damping))
    place = np.argsort(sp.csgraph.reverse_cuthill_mckee(pattern.tocsr(), symmetric_mode=False))
    width = int(abs(place[pattern.row] - place[pattern.col]).max(initial=0))  # of the band
    in_step = 2.0 * pattern.nnz / n + 4.0 * width
    return bool(2.0 * o.n_pairs + 12.0 < 4.0 * in_step)


def _transformed(o: Operators) -> tuple[Operators, InnerModes] | None:
    """Return the problem in its modes, or None if the damping couples them."""
    M, C, K = (matrix.toarray() for matrix in (o.mass, o.damping, o.stiffness))
    scale = 1.0 / np.sqrt(M.diagonal())
    M, C, K = (scale[:, None] * A * scale for A in (M, C, K))
    squares, shapes = _modes(K, M)
    damping = _congruent(C, shapes)
    diagonal = np.maximum(damping.diagonal(), 0.0)
    allowed = NOT_DIAGONAL * np.sqrt(np.outer(diagonal, diagonal)) + 1e-18 * diagonal.max()
    np.fill_diagonal(damping, 0.0)
    if (abs(damping) > allowed).any():
        return None
    n = o.n_dofs
    size = ROW * -(-o.n_dofs // ROW)
    Phi = np.zeros((n, size), dtype=np.longdouble)
    Phi[:, :n] = scale[:, None] * shapes
    dual = np.asarray(o.mass.astype(np.longdouble) @ Phi, dtype=float)
    fill = np.zeros(size - n)
    mass, damping, stiffness = (
        sp.diags(np.concatenate([np.asarray(d, dtype=float), f])).tocsr()
        for d, f in ((np.ones(n), fill + 1.0), (diagonal, fill), (squares, fill))
    )
    columns = _product(np.stack([o.base.mass, o.base.damping, o.base.stiffness]), Phi)
    base = BaseCoupling(columns[0], columns[1], columns[2], o.base.corner)
    H, probes, sensors = (
        sp.csr_matrix(_product(rows.toarray(), Phi)) for rows in (o.gap_matrix, o.probes, o.sensors)
    )
    modal = Operators(
        *(mass, damping, stiffness, base, H, o.gap0),
        probes=probes,
        sensors=sensors,
        load=None if o.load is None else _product(o.load[None], Phi)[0],
        equilibrium=o.equilibrium,
        n_forces=o.n_forces,
    )
    return modal, InnerModes(np.asarray(Phi, dtype=float), dual)


def _product(rows: FloatArray, Phi: Long) -> FloatArray:
    """Return the product of rows with Φ, computed in extended precision."""
    return np.asarray(rows.astype(np.longdouble) @ Phi, dtype=float)


def _congruent(matrix: FloatArray, shapes: Long) -> Any:
    """Return Φᵀ A Φ in extended precision."""
    return shapes.T @ (matrix.astype(np.longdouble) @ shapes)


def _modes(K: FloatArray, M: FloatArray) -> tuple[Long, Long]:
    """Return λ and Φ of K φ = λ M φ, accurate for the lowest modes too.

    The round-off of `eigh` is that of the largest λ, which hides many digits of the smallest.

    Source:
        T. Ogita, K. Aishima, Iterative refinement for symmetric eigenvalue decomposition, Japan J.
        Indust. Appl. Math. 35 (2018).
    """
    K, M = (0.5 * (A + A.T) for A in (K, M))  # else their round-off tilts modes of one frequency
    first, vectors = eigh(K, M)
    shapes = vectors.astype(np.longdouble)
    squares = first.astype(np.longdouble)
    identity = np.eye(len(first), dtype=np.longdouble)
    for _ in range(_REFINEMENTS):
        lacking = identity - _congruent(M, shapes)
        stiff = _congruent(K, shapes)
        # with Φᵀ M Φ = I - E and S = Φᵀ K Φ, to first order: λ_i = S_ii / (1 - E_ii), and Φ (I + F)
        # is better, F_ij = (S_ij + λ_j E_ij) / (λ_j - λ_i), or E_ij / 2 for a cluster and i = j
        squares = stiff.diagonal() / (1.0 - lacking.diagonal())
        apart = squares - squares[:, None]
        off = stiff - np.diag(stiff.diagonal())
        is_cluster = _FIRST_ORDER * abs(apart) <= abs(off + squares * lacking)
        with np.errstate(divide="ignore", invalid="ignore"):
            change = np.where(is_cluster, 0.5 * lacking, (off + squares * lacking) / apart)
        np.fill_diagonal(change, 0.5 * lacking.diagonal())
        shapes = shapes + shapes @ change
    for _ in range(_NORMALISATIONS):
        shapes = shapes + 0.5 * shapes @ (identity - _congruent(M, shapes))
    stiff = _congruent(K, shapes)
    return np.maximum(stiff.diagonal() / _congruent(M, shapes).diagonal(), 0.0), shapes


@njit
def advance(system, X, base_state, loads):  # type: ignore[no-untyped-def]
    """Compute the candidate state of a step in modes (G1 to G3 of system.py); return zᵀ C z.

    `loads` are constant loads and those of further forces.
    """
    q, dq, ddq = base_state
    size, scheme, base, p_start = system.size, system.scheme, system.base, P * system.size
    diagonals = system.modal
    by_q = splat(-q)
    by_dq = splat(-dq)
    by_ddq = splat(-ddq)
    dt = splat(scheme.time_step)
    ahead = splat(scheme.time_step + scheme.g)
    to_u = splat(scheme.d1)
    to_v = splat(scheme.d2)
    rho = splat(scheme.rho)
    minus = splat(-1.0)
    flow = splat(0.0)
    for i in range(0, size, 4):
        u = load(X, i)
        v = load(X, size + i)
        c = load(diagonals, size + i)
        # a = (f - C v - K (u + (Δt + g) v)) / A, f = -(m q" + c q' + k q); z = v⁺ + ρ v
        right = fma(by_ddq, load(base, i), by_dq * load(base, size + i))
        right = fma(by_q, load(base, 2 * size + i), right)
        right = fma(minus * load(diagonals, 2 * size + i), fma(ahead, v, u), right)
        right = fma(minus * c, v, right)
        if system.has_load:
            right = right + load(loads, i)
        a = right * load(diagonals, i)
        after = fma(to_v, a, v)
        z = fma(rho, v, after)
        store(X, i, fma(to_u, a, fma(dt, v, u)))
        store(X, size + i, after)
        store(X, p_start + i, z)
        flow = fma(c * z, z, flow)
    return total(flow)


@njit
def see(system, memory):  # type: ignore[no-untyped-def]
    """Write the gaps and gap rates of the state in modes, unless they are known."""
    if memory.counts[IS_SEEN]:
        return
    X = memory.X
    size = system.size
    H = system.gap_rows.value
    for k in range(system.n_pairs):
        first = k * size
        u0 = splat(0.0)
        u1 = splat(0.0)
        v0 = splat(0.0)
        v1 = splat(0.0)
        for i in range(0, size, ROW):
            h0 = load(H, first + i)
            h1 = load(H, first + i + 4)
            u0 = fma(h0, load(X, i), u0)
            u1 = fma(h1, load(X, i + 4), u1)
            v0 = fma(h0, load(X, size + i), v0)
            v1 = fma(h1, load(X, size + i + 4), v1)
        memory.present_rate[k] = total(v0 + v1)
        memory.present_gap[k] = system.gap0[k] + total(u0 + u1)
    memory.counts[IS_SEEN] = 1


@njit
def measure(system, memory, ahead):  # type: ignore[no-untyped-def]
    """Write gaps at u + ahead v and gap rates of all pairs in modes; return the smallest gap."""
    see(system, memory)
    smallest = np.inf
    for k in range(system.n_pairs):
        memory.rate[k] = memory.present_rate[k]
        memory.gap[k] = memory.present_gap[k] + ahead * memory.rate[k]
        smallest = min(smallest, memory.gap[k])
    return smallest


@njit
def loss(system, X):  # type: ignore[no-untyped-def]
    """Return zᵀ C z in modes, where z is the field P."""
    size = system.size
    flow = splat(0.0)
    for i in range(0, size, 4):
        z = load(X, P * size + i)
        flow = fma(load(system.modal, size + i) * z, z, flow)
    return total(flow)


@njit
def solve(system, X, right, out):  # type: ignore[no-untyped-def]
    """Solve A z = r in modes; `right` and `out` number the fields r and z of X."""
    size = system.size
    for i in range(0, size, 4):
        store(X, out * size + i, load(X, right * size + i) * load(system.modal, i))


@njit
def push(system, X, right):  # type: ignore[no-untyped-def]
    """Change a step by impulses with the load r, the field `right`: add z = A⁻¹ r to v and P."""
    size = system.size
    r = right * size
    p_start = P * size
    to_u = splat(system.scheme.p)
    for i in range(0, size, 4):
        z = load(X, r + i) * load(system.modal, i)
        store(X, i, fma(to_u, z, load(X, i)))
        store(X, size + i, load(X, size + i) + z)
        store(X, p_start + i, load(X, p_start + i) + z)
