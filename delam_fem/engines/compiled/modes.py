"""The unknowns of a small problem in its modes: a step of the θ-scheme without any linear solve.

With all n modes Φ of K φ = λ M φ, normalised to Φᵀ M Φ = I, and damping that they make diagonal
(any Rayleigh damping), u = Φ η turns M, C, K into diagonal matrices. The scheme is the same, only
the coordinates differ. The gap operator becomes the dense matrix H Φ, so this pays for few pairs.
Reduced models (model/reduction) come in such coordinates, and are taken as they are.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp
from scipy.linalg import eigh

from delam_fem.engines.compiled.lanes import P, fma, load, splat, store, total
from delam_fem.engines.compiled.state import IS_SEEN
from delam_fem.model.operators import BaseCoupling, Operators
from delam_fem.numerics.types import FloatArray, IntArray
from delam_fem.system.kernels import njit

MOST_DOFS = 320
"""Largest number of dofs: the modes of more take seconds."""
ROW = 8
"""The number of modes is a multiple of two vectors of four; modes without any effect fill it up."""
NOT_DIAGONAL = 1e-9
"""Largest entry of Φᵀ C Φ beside its diagonal, relative to the diagonal, that is round-off."""
MANY = 8
"""Unknowns of a mean gap from which dense rows are taken."""
_REFINEMENTS = 2
"""Steps of Ogita and Aishima; each squares the error of the modes."""

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
class Modes:
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


Coordinates = Places | Modes

_KEPT: deque[tuple[Operators, tuple[Operators, Modes] | None]] = deque(maxlen=4)
"""Results of the last calls of `in_modes`."""


def in_modes(o: Operators) -> tuple[Operators, Modes] | None:
    """Return a problem in its modes, or None if that does not pay or damping couples them."""
    for known, result in _KEPT:
        if known is o:
            return result
    if is_reduced(o):
        shapes = np.eye(o.n_dofs, ROW * -(-o.n_dofs // ROW))
        result = filled_up(o), Modes(shapes, shapes)
    else:
        result = _transformed(o) if _pays(o) else None
    _KEPT.append((o, result))
    return result


def is_reduced(o: Operators) -> bool:
    """Return whether M, C and K are diagonal and gaps depend on many of the unknowns.

    So it is where the unknowns are those of a reduced model (model/reduction).
    """
    matrices = (sp.coo_matrix(matrix) for matrix in (o.mass, o.damping, o.stiffness))
    is_diagonal = all(not matrix.data[matrix.row != matrix.col].any() for matrix in matrices)
    return bool(is_diagonal and o.gap_matrix.nnz > MANY * max(o.n_pairs, 1))


def filled_up(o: Operators) -> Operators:
    """Return diagonal operators with unknowns without any effect up to a multiple of `ROW`."""
    n, size = o.n_dofs, ROW * -(-o.n_dofs // ROW)
    columns = ((0, 0), (0, size - n))

    def diagonal(matrix: sp.csr_matrix, filling: float) -> sp.csr_matrix:
        return sp.diags(np.append(matrix.diagonal(), np.full(size - n, filling)), format="csr")

    def rows(matrix: sp.csr_matrix) -> sp.csr_matrix:
        return sp.csr_matrix(np.pad(matrix.toarray(), columns))

    base = np.pad(np.stack([o.base.mass, o.base.damping, o.base.stiffness]), columns)
    return replace(
        o,
        mass=diagonal(o.mass, 1.0),
        damping=diagonal(o.damping, 0.0),
        stiffness=diagonal(o.stiffness, 0.0),
        base=replace(o.base, mass=base[0], damping=base[1], stiffness=base[2]),
        gap_matrix=rows(o.gap_matrix),
        lumped_mass=None if o.lumped_mass is None else np.append(o.lumped_mass, np.ones(size - n)),
        probes=rows(o.probes),
        sensors=rows(o.sensors),
    )


def _pays(o: Operators) -> bool:
    """Return whether the rows of H in modes cost less than what a step in bands costs.

    A product with a dense row takes about a quarter of the time of one with a sparse row by entry.
    """
    n = o.n_dofs
    if not 0 < n <= MOST_DOFS:
        return False
    pattern = sp.coo_matrix(abs(o.mass) + abs(o.stiffness) + abs(o.damping))
    in_step = 2.0 * pattern.nnz / n + 4.0 * _width(pattern)
    return bool(2.0 * o.n_pairs + 12.0 < 4.0 * in_step)


def _width(pattern: sp.coo_matrix) -> int:
    """Return the number of entries on each side of the diagonal, in a good order of the dofs."""
    order = sp.csgraph.reverse_cuthill_mckee(pattern.tocsr(), symmetric_mode=False)
    place = np.argsort(order)
    return int(abs(place[pattern.row] - place[pattern.col]).max(initial=0))


def _transformed(o: Operators) -> tuple[Operators, Modes] | None:
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
    n, size = o.n_dofs, ROW * -(-o.n_dofs // ROW)
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
    modal = Operators(mass, damping, stiffness, base, H, o.gap0, probes=probes, sensors=sensors)
    return modal, Modes(np.asarray(Phi, dtype=float), dual)


def _product(rows: FloatArray, Phi: Long) -> FloatArray:
    """Return rows times Φ."""
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
    first, vectors = eigh(K, M)
    shapes, squares = vectors.astype(np.longdouble), first.astype(np.longdouble)
    identity = np.eye(len(first), dtype=np.longdouble)
    for _ in range(_REFINEMENTS):
        lacking, stiff = identity - _congruent(M, shapes), _congruent(K, shapes)
        squares = stiff.diagonal() / (1.0 - lacking.diagonal())
        apart = squares - squares[:, None]
        off = stiff - np.diag(stiff.diagonal())
        is_cluster = abs(apart) <= 2.0 * abs(off + squares * lacking)
        with np.errstate(divide="ignore", invalid="ignore"):
            change = np.where(is_cluster, 0.5 * lacking, (off + squares * lacking) / apart)
        np.fill_diagonal(change, 0.5 * lacking.diagonal())
        shapes = shapes + shapes @ change
    stiff = _congruent(K, shapes)
    return np.maximum(stiff.diagonal() / _congruent(M, shapes).diagonal(), 0.0), shapes


@njit
def advance(system, X, base_state):  # type: ignore[no-untyped-def]
    """Compute the candidate state of a step (G1 to G3 with diagonal matrices); return zᵀ C z."""
    q, dq, ddq = base_state
    size, scheme, base, held = system.size, system.scheme, system.base, P * system.size
    diagonals = system.modal
    by_q, by_dq, by_ddq = splat(-q), splat(-dq), splat(-ddq)
    dt, ahead = splat(scheme.time_step), splat(scheme.time_step + scheme.g)
    to_u, to_v, rho = splat(scheme.d1), splat(scheme.d2), splat(scheme.rho)
    minus, flow = splat(-1.0), splat(0.0)
    for i in range(0, size, 4):
        u, v, c = load(X, i), load(X, size + i), load(diagonals, size + i)
        right = fma(by_ddq, load(base, i), by_dq * load(base, size + i))
        right = fma(by_q, load(base, 2 * size + i), right)
        right = fma(minus * load(diagonals, 2 * size + i), fma(ahead, v, u), right)
        right = fma(minus * c, v, right)
        a = right * load(diagonals, i)
        after = fma(to_v, a, v)
        z = fma(rho, v, after)
        store(X, i, fma(to_u, a, fma(dt, v, u)))
        store(X, size + i, after)
        store(X, held + i, z)
        flow = fma(c * z, z, flow)
    return total(flow)


@njit
def see(system, memory):  # type: ignore[no-untyped-def]
    """Write the gaps and gap rates of the state, unless they are known."""
    if memory.counts[IS_SEEN]:
        return
    X, size, H = memory.X, system.size, system.gap_rows.value
    for k in range(system.n_pairs):
        first = k * size
        u0, u1, v0, v1 = splat(0.0), splat(0.0), splat(0.0), splat(0.0)
        for i in range(0, size, ROW):
            h0, h1 = load(H, first + i), load(H, first + i + 4)
            u0, u1 = fma(h0, load(X, i), u0), fma(h1, load(X, i + 4), u1)
            v0, v1 = fma(h0, load(X, size + i), v0), fma(h1, load(X, size + i + 4), v1)
        memory.present_rate[k] = total(v0 + v1)
        memory.present_gap[k] = system.gap0[k] + total(u0 + u1)
    memory.counts[IS_SEEN] = 1


@njit
def measure(system, memory, ahead):  # type: ignore[no-untyped-def]
    """Write the gaps at u + ahead v and the gap rates of all pairs; return the smallest gap."""
    see(system, memory)
    smallest = np.inf
    for k in range(system.n_pairs):
        memory.rate[k] = memory.present_rate[k]
        memory.gap[k] = memory.present_gap[k] + ahead * memory.rate[k]
        smallest = min(smallest, memory.gap[k])
    return smallest


@njit
def loss(system, X):  # type: ignore[no-untyped-def]
    """Return zᵀ C z, where z is the field P."""
    size, flow = system.size, splat(0.0)
    for i in range(0, size, 4):
        z = load(X, P * size + i)
        flow = fma(load(system.modal, size + i) * z, z, flow)
    return total(flow)


@njit
def solve(system, X, right, out):  # type: ignore[no-untyped-def]
    """Solve A z = r; `right` and `out` are the numbers of the fields r and z of X."""
    size = system.size
    for i in range(0, size, 4):
        store(X, out * size + i, load(X, right * size + i) * load(system.modal, i))


@njit
def push(system, X, right):  # type: ignore[no-untyped-def]
    """Change a step by impulses with the load r, the field `right`: add z = A⁻¹ r to v and P."""
    size = system.size
    r, held, to_u = right * size, P * size, splat(system.scheme.p)
    for i in range(0, size, 4):
        z = load(X, r + i) * load(system.modal, i)
        store(X, i, fma(to_u, z, load(X, i)))
        store(X, size + i, load(X, size + i) + z)
        store(X, held + i, load(X, held + i) + z)
