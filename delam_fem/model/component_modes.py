"""Structures in modes: a few modes of each body, and the flexibility of those that are left out.

On several ranks (collective) vectors are those of the own dofs, all small matrices are sums over
the ranks, and every rank has them.

The bodies of a structure are groups of dofs that M, C and K do not couple. A body is factorised
once (`factors.py`). The factors give its lowest modes, by inverse iteration in a Krylov space, and
the static shapes of its loads.

A body that is not held has a singular stiffness. Everything is then solved with K + s M: the modes
are the same, and static shapes follow by iteration, see `Component.static`.

Modes and residual flexibility form one basis V, in which M is the identity and K diagonal. Of each
body the basis has

- the lowest normal modes Φ,
- residual shapes: the static displacements in the omitted modes due to a force at each contact
  pair, stop or impactor, to the motion of the base or the force that drives the structure, and to
  the inertia of that motion:

    X = R [h, k_b, M ι + m_b],   R = K⁻¹ - Φ ω⁻² Φᵀ,   ι = -K⁻¹ k_b                           (B1)

Static flexibility at the pairs is therefore that of the full model, H V Ω⁻² Vᵀ Hᵀ = H K⁻¹ Hᵀ, and a
base that moves slowly moves the structure exactly.

Shapes of neighbouring pairs are nearly dependent. They are scaled to unit strain energy, the
eigenvectors of their Gram matrix with eigenvalues above `DEPENDENT` of the largest are kept, and
made orthonormal with K. The small problem K z = ω² M z then gives the rest of the basis. Φ and X
are orthogonal, so the kept normal modes stay as they are.

Source: R. H. MacNeal, "A hybrid method of component mode synthesis", Comput. Struct. 1 (1971);
S. Rubin, "Improved component-mode representation for structural dynamic analysis", AIAA J. 13
(1975).

The equations of a reduced structure are

    u = V q:   I q'' + Vᵀ C V q' + Ω² q = -Vᵀ (m_b q_b'' + c_b q_b' + k_b q_b) + (H V)ᵀ λ

H V is dense. Deflections and slopes of the parts are readings of q.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.linalg import block_diag, eigh

from delam_fem.model.factors import Factor, Solve, factored
from delam_fem.model.layout import Layout, Reading, Structure
from delam_fem.model.linear import lowest, normalised
from delam_fem.model.operators import (
    BaseCoupling,
    DistributedOperators,
    Operators,
    agreed,
    diagonal,
    n_rows,
    of_ranks,
    own_rows,
    summed,
    times,
)
from delam_fem.numerics.types import BoolArray, FloatArray, IntArray

NOT_RAYLEIGH = 1e-12
"""Largest entry of C - α M - β K relative to the diagonal of C that is round-off."""
FITS = 4
"""Number of fits of α and β in turn; each gains some digits."""
CORRECTIONS = 3
"""Iterations for static shapes of a floating body; each gains the factor s/ω² of omitted modes."""


@dataclass(frozen=True)
class Component:
    """A group of dofs that nothing couples to the others, with the factors of its K + s M.

    Attributes:
        dofs: its own dofs, shape (n,).
        mass: M, CSC (n, n), or a matrix of PETSc on several ranks.
        damping: C, likewise.
        stiffness: K, likewise.
        factor: factors of K + s M; s = 0 [1/s2]: the body is held.
        rayleigh: α and β, if the operators say them.
    """

    dofs: IntArray
    mass: Any
    damping: Any
    stiffness: Any
    factor: Factor
    rayleigh: tuple[float, float] | None = None

    @property
    def shift(self) -> float:
        """The shift s [1/s2]."""
        return self.factor.shift

    @property
    def solve(self) -> Solve:
        """Function that applies (K + s M)⁻¹."""
        return self.factor.solve

    def modes(self, n: int) -> tuple[FloatArray, FloatArray]:
        """Return ω² [1/s2], increasing, shape (m,), and Φ with Φᵀ M Φ = 1, shape (n_dofs, m).

        Args:
            n: number of modes; m is n, or the number of dofs where there are fewer.
        """
        n = min(n, n_rows(self.mass))
        frequencies, vectors = lowest(self.stiffness, self.mass, n, factor=self.factor)
        return (2.0 * np.pi * frequencies) ** 2, normalised(vectors, self.mass)

    def static(self, loads: sp.csc_matrix, modes: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the flexibility of all modes to loads, and the shapes of those left out.

            X = R f,   R = Σ φ φᵀ / ω²   over the omitted modes

        The columns of X are orthogonal to the kept modes with M and with K. With a shift the sums
        have ω² + s in place of ω²; X ← X_s + s (K + s M)⁻¹ M X, from X = X_s, corrects that.

        Args:
            loads: f, CSC (n_dofs, k).
            modes: the kept modes, shape (n_dofs, m).

        Returns:
            fᵀ(K + s M)⁻¹f of each load, shape (k,) [m/N], and X, shape (n_dofs, k).
        """
        shapes = self.solve(loads.toarray())
        flexibility = summed(self.mass, np.asarray(loads.T @ shapes).diagonal())
        self._remove(modes, shapes)
        first = shapes
        for _ in range(CORRECTIONS if self.shift else 0):
            shapes = self.solve(times(self.mass, shapes))
            self._remove(modes, shapes)
            shapes = first + self.shift * shapes
        return flexibility, shapes

    def damping_of(self, squares: FloatArray, shapes: FloatArray) -> FloatArray:
        """Return the damping VᵀCV of some shapes, shape (m, m).

        If C = α M + β K, the result is the diagonal matrix α + β ω²: the product itself has the
        round-off of the largest stiffness, which hides the damping of the lowest modes.

        Args:
            squares: ω² of the shapes, shape (m,) [1/s2].
            shapes: V, with VᵀMV = 1 and VᵀKV = ω², shape (n_dofs, m).
        """
        if self.rayleigh is not None:
            alpha, beta = self.rayleigh
            return np.diag(alpha + beta * squares)
        M, C, K = (own_rows(A) for A in (self.mass, self.damping, self.stiffness))
        alpha, beta = self._fitted(M, C, K, shapes[:, 0])
        beside = sp.coo_matrix(C - alpha * M - beta * K)
        scale = np.sqrt(np.maximum(diagonal(self.damping), 0.0))
        of_columns = np.concatenate(of_ranks(self.damping, scale))
        limits = NOT_RAYLEIGH * scale[beside.row] * of_columns[beside.col]
        if all(of_ranks(self.damping, bool((abs(beside.data) <= limits).all()))):
            return np.diag(alpha + beta * squares)
        return self.gram(shapes, self.damping)

    def _fitted(
        self, M: sp.csr_matrix, C: sp.csr_matrix, K: sp.csr_matrix, slowest: FloatArray
    ) -> tuple[float, float]:
        """Return α and β for which α M + β K is near C: by its entries, and by the slowest mode.

        Args:
            M: own rows of the mass.
            C: own rows of the damping.
            K: own rows of the stiffness.
            slowest: φ of the lowest mode, with φᵀMφ = 1, shape (n_dofs,).
        """
        size = summed(self.mass, K.multiply(K).sum())
        everywhere = np.concatenate(of_ranks(self.mass, slowest))
        alpha = 0.0
        beta = 0.0
        for _ in range(FITS):
            beta = float(summed(self.mass, (C - alpha * M).multiply(K).sum()) / size)
            alpha = float(summed(self.mass, slowest @ ((C - beta * K) @ everywhere)))
        return alpha, beta

    def gram(self, shapes: FloatArray, matrix: Any) -> FloatArray:
        """Return the symmetric matrix XᵀA X of shapes X, shape (k, k)."""
        product = summed(matrix, shapes.T @ times(matrix, shapes))
        return np.asarray(0.5 * (product + product.T))

    def _remove(self, modes: FloatArray, shapes: FloatArray) -> None:
        """Make shapes orthogonal to the modes with M, in place; twice, because of round-off."""
        dual = times(self.mass, modes)
        for _ in range(2):
            shapes -= modes @ summed(self.mass, dual.T @ shapes)


def bodies(o: Operators | DistributedOperators, shift: float = 0.0) -> list[Component]:
    """Return the bodies of a structure.

    Args:
        o: the semi-discrete problem.
        shift: s [1/s2], about the square of the lowest elastic angular frequency, if bodies have
            rigid motions; 0: all are held.

    Raises:
        ValueError: a body is not held and there is no shift.
    """
    result = []
    for dofs, M, C, K in o.bodies():
        rayleigh = None
        if o.rayleigh is not None:
            local = None if not dofs.size else [float(values[dofs[0]]) for values in o.rayleigh]
            alpha, beta = next(filter(None, of_ranks(K, local)))
            rayleigh = alpha, beta
        result.append(Component(dofs, M, C, K, factored(K, M, shift), rayleigh))
    return result


DEPENDENT = 1e-11
"""Eigenvalue of the scaled Gram matrix, relative to the largest, below which shapes are dependent.
With it the flexibility at the pairs is right to 1e-9 (80 elements of a beam) and 2e-7 (640)."""
COMPARED = 10
"""Modes of the full structure whose frequencies are kept for a comparison."""
NOTHING = 1e-13
"""Strain energy of a residual shape relative to that of the whole shape that is round-off."""


@dataclass(frozen=True)
class Basis:
    """The basis of a reduced structure; m coordinates.

    Attributes:
        vectors: V, shape (n_own, m).
        squares: ω² of each coordinate, body by body and increasing within each, shape (m,) [1/s2].
        damping: VᵀCV, shape (m, m) [1/s].
        is_mode: whether a coordinate is a normal mode of a body, shape (m,).
        body: number of the body of each coordinate, shape (m,).
        body_of_dof: number of the body of each own dof, shape (n_own,).
        dropped: number of shapes left out as dependent on others, or beyond the largest number.
        compliance_error: largest relative error of the flexibility of the omitted modes to a load
            [-].
        lowest: ω² of the lowest modes of the full structure, increasing, shape (k,) [1/s2].
    """

    vectors: FloatArray
    squares: FloatArray
    damping: FloatArray
    is_mode: BoolArray
    body: IntArray
    body_of_dof: IntArray
    dropped: int
    compliance_error: float
    lowest: FloatArray


@dataclass(frozen=True)
class _Piece:
    """One body with its normal modes and residual shapes.

    Attributes:
        body: the body.
        squares: ω² of its normal modes, shape (m,) [1/s2].
        modes: Φ, shape (n, m).
        loads: loads of B1 to which the omitted modes respond, CSC (n, k).
        compliance: XᵀK X of these loads, shape (k,) [m/N].
        shapes: residual shapes, orthonormal with K, the most flexible first, shape (n, r).
        weights: eigenvalues of the scaled Gram matrix, decreasing, shape (r,).
        dropped: number of dependent shapes.
        lowest: ω² of its lowest modes, kept or left out [1/s2].
    """

    body: Component
    squares: FloatArray
    modes: FloatArray
    loads: sp.csc_matrix
    compliance: FloatArray
    shapes: FloatArray
    weights: FloatArray
    dropped: int
    lowest: FloatArray


def basis_of(
    o: Operators | DistributedOperators,
    modes: int,
    *,
    shift: float = 0.0,
    max_coordinates: int | None = None,
    loads: sp.csr_matrix | None = None,
) -> Basis:
    """Return the basis of a reduced structure.

    Args:
        o: the semi-discrete problem.
        modes: number of normal modes of each body.
        shift: s [1/s2], about the square of the lowest elastic angular frequency, if bodies have
            rigid motions; 0: all are held.
        max_coordinates: largest number; the least flexible residual shapes are left out.
        loads: further loads to which the omitted modes respond, as rows, shape (k, n); None: none.

    Raises:
        ValueError: a body is not held and there is no shift, or there are more normal modes than
            `max_coordinates` coordinates.
    """
    rows = o.gap_matrix if loads is None else sp.vstack([o.gap_matrix, loads], format="csr")
    pieces = [_piece(o, rows, body, modes) for body in bodies(o, shift)]
    # how many residual shapes each body keeps
    weights = np.sort(np.concatenate([piece.weights for piece in pieces]))[::-1]
    normal = sum(piece.squares.size for piece in pieces)
    room = weights.size if max_coordinates is None else max_coordinates - normal
    if room < 0:
        raise ValueError(
            f"coordinates: expected at least {normal}, the number of normal modes, "
            f"given {max_coordinates}"
        )
    least = weights[room - 1] if 0 < room <= weights.size else np.inf if room == 0 else 0.0
    counts = [int((piece.weights >= least).sum()) for piece in pieces]
    columns = []
    squares = []
    damping = []
    is_mode = []
    numbers = []
    body_of_dof = np.empty(o.n_own, dtype=np.int64)
    error = 0.0
    for number, (piece, k) in enumerate(zip(pieces, counts, strict=True)):
        high, shapes = _ritz(piece.body, piece.shapes[:, :k])
        worked = summed(piece.body.mass, np.asarray(piece.loads.T @ shapes))
        reached = np.sum(worked**2 / high, axis=1)
        if piece.compliance.size:
            error = float(np.maximum(error, np.max(1.0 - reached / piece.compliance)))
        n = piece.squares.size + high.size
        block = np.zeros((o.n_own, n))
        block[piece.body.dofs] = np.hstack([piece.modes, shapes])
        columns.append(block)
        squares.append(np.append(piece.squares, high))
        damping.append(piece.body.damping_of(squares[-1], block[piece.body.dofs]))
        is_mode.append(np.arange(n) < piece.squares.size)
        numbers.append(np.full(n, number))
        body_of_dof[piece.body.dofs] = number
    return Basis(
        np.hstack(columns),
        np.concatenate(squares),
        block_diag(*damping),
        np.concatenate(is_mode),
        np.concatenate(numbers),
        body_of_dof,
        sum(piece.weights.size + piece.dropped for piece in pieces) - sum(counts),
        error,
        np.sort(np.concatenate([piece.lowest for piece in pieces]))[:COMPARED],
    )


def _piece(
    o: Operators | DistributedOperators, rows: sp.csr_matrix, body: Component, modes: int
) -> _Piece:
    """Return a body with its modes and residual shapes for loads at the rows of pairs."""
    lowest, mode_shapes = body.modes(max(modes, COMPARED))
    squares = lowest[:modes]
    vectors = mode_shapes[:, :modes]
    H = rows[:, body.dofs]  # the loads of B1 that act on the body follow
    stiff = o.base.stiffness[body.dofs]
    inertia = o.base.mass[body.dofs]
    columns = [stiff, *o.forces[body.dofs].T]
    if not o.base.is_force:
        columns.append(inertia - times(body.mass, body.solve(stiff)))
    loads = sp.hstack([H.T, sp.csc_matrix(np.column_stack(columns))], format="csc")
    loads = loads[:, np.flatnonzero(summed(body.mass, np.asarray(abs(loads).sum(axis=0))))]
    flexibility, shapes = body.static(loads, vectors)
    energy = np.einsum("ij,ij->j", shapes, times(body.stiffness, shapes))
    energy = summed(body.stiffness, energy)
    there = energy > NOTHING * flexibility
    energy, shapes = energy[there], shapes[:, there] / np.sqrt(energy[there])
    independent, weights = _independent(body, shapes)
    return _Piece(
        body,
        squares,
        vectors,
        loads[:, there],
        energy,
        independent,
        weights,
        loads.shape[1] - weights.size,
        lowest,
    )


def _independent(body: Component, shapes: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return independent shapes, orthonormal with K, and their weights, decreasing."""
    if not shapes.shape[1]:
        return shapes, np.zeros(0)
    K = body.stiffness
    weights, turn = agreed(K, eigh(body.gram(shapes, K)))
    is_kept = weights > DEPENDENT * weights[-1]
    weights = weights[is_kept][::-1]
    turn = turn[:, is_kept][:, ::-1]
    result = shapes @ (turn / np.sqrt(weights))
    for _ in range(2):  # round-off of the eigenvalues is that of the largest
        factor = np.linalg.cholesky(body.gram(result, K))
        result = result @ np.linalg.inv(factor).T  # the factor is nearly 1
    return result, weights


def _ritz(body: Component, shapes: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return ω², increasing, and shapes with VᵀMV = 1 and VᵀKV = ω² in the space of some shapes."""
    if not shapes.shape[1]:
        return np.zeros(0), shapes
    inverse, turn = agreed(body.mass, eigh(body.gram(shapes, body.mass)))
    inverse = inverse[::-1]
    turn = turn[:, ::-1]
    return 1.0 / inverse, np.asarray(shapes @ (turn / np.sqrt(inverse)))


def projected(structure: Structure, basis: Basis) -> Structure:
    """Return a structure in the coordinates of a basis.

    Deflections and slopes are readings of the coordinates. There is no lumped mass: impulses act
    through M = I. Sensors are left out, see `stops_sensors.with_sensors`.

    Args:
        structure: the full structure.
        basis: of its operators.
    """
    o = structure.operators
    V = basis.vectors
    n = basis.squares.size
    shares = o.pair_weights  # contacts get their own stiffnesses where the modes are used
    if o.pair_numbers is not None:
        shares = o.pair_numbers.shares
    base = BaseCoupling(
        o.total(V.T @ o.base.mass),
        o.total(V.T @ o.base.damping),
        o.total(V.T @ o.base.stiffness),
        o.base.corner,
        o.base.is_force,
    )
    operators = Operators(
        mass=sp.identity(n, format="csr"),
        damping=sp.csr_matrix(basis.damping),
        stiffness=sp.diags(basis.squares, format="csr"),
        base=base,
        gap_matrix=sp.csr_matrix(o.total(o.gap_matrix @ V)),
        gap0=o.gap0,
        pair_weights=shares,
        probes=sp.csr_matrix(o.total(o.probes @ V)),
        load=None if o.load is None else o.total(o.load @ V),
        buckling_factor=o.buckling_factor,
    )
    layout, reading = structure.layout, structure.layout.reading
    sheets = layout.sheets
    if sheets is not None:
        sheets = replace(sheets, matrix=o.total(np.asarray(sheets.matrix @ V)))
    rows, moved = (V, np.zeros(len(V))) if reading is None else (reading.matrix @ V, reading.base)
    parts = _parts(layout, basis, o)
    return Structure(
        operators,
        replace(
            layout,
            reading=Reading(sp.csr_matrix(o.total(rows)), moved, parts),
            sensors=(),
            gap_row=None,
            sheets=sheets,
        ),
    )


def _parts(layout: Layout, basis: Basis, o: Operators | DistributedOperators) -> IntArray:
    """Return the part to which each coordinate belongs, -1 where bonded parts share it."""
    of_body = np.full(1 + int(basis.body.max()), -2)  # -2: of no part yet
    for number in range(len(layout.parts)):
        local_bodies = basis.body_of_dof[layout.own_dofs(number)].tolist()
        bodies_of_part = sorted(set().union(*of_ranks(o.mass, set(local_bodies))))
        of_body[bodies_of_part] = np.where(of_body[bodies_of_part] == -2, number, -1)
    return np.maximum(of_body, -1)[basis.body]
