"""Modes and residual flexibility as one basis V, in which M is the identity and K diagonal.

Of each body the basis has

- the lowest normal modes Φ,
- what the omitted modes give statically way to by a force at each contact pair, by the motion of
  the base or the force that drives the structure, and by the inertia of that motion:

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
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from scipy.linalg import block_diag, eigh

from delam_fem.model.operators import Operators
from delam_fem.model.reduction.bodies import Body, bodies
from delam_fem.numerics.arrays import BoolArray, FloatArray, IntArray

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
        vectors: V, shape (n_dofs, m).
        squares: ω² of each coordinate, body by body and increasing within each, shape (m,) [1/s2].
        damping: VᵀCV, shape (m, m) [1/s].
        is_mode: whether a coordinate is a normal mode of a body, shape (m,).
        body: number of the body of each coordinate, shape (m,).
        body_of_dof: number of the body of each dof, shape (n_dofs,).
        dropped: number of shapes left out as dependent on others, or beyond the largest number.
        compliance_error: largest error of the flexibility that the omitted modes give a load, in
            parts of it [-].
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
        loads: loads of B1 that omitted modes give way to, CSC (n, k).
        compliance: XᵀK X of these loads, shape (k,) [m/N].
        shapes: residual shapes, orthonormal with K, the most flexible first, shape (n, r).
        weights: eigenvalues of the scaled Gram matrix, decreasing, shape (r,).
        dropped: number of dependent shapes.
        lowest: ω² of its lowest modes, also of those that are left out [1/s2].
    """

    body: Body
    squares: FloatArray
    modes: FloatArray
    loads: sp.csc_matrix
    compliance: FloatArray
    shapes: FloatArray
    weights: FloatArray
    dropped: int
    lowest: FloatArray


def basis_of(o: Operators, modes: int, *, shift: float = 0.0, most: int | None = None) -> Basis:
    """Return the basis of a reduced structure.

    Args:
        o: the semi-discrete problem.
        modes: number of normal modes of each body.
        shift: see `bodies.bodies`.
        most: largest number of coordinates; the least flexible residual shapes are left out.

    Raises:
        ValueError: a body is not held and there is no shift, or there are more normal modes than
            `most` coordinates.
    """
    pieces = [_piece(o, body, modes) for body in bodies(o, shift)]
    kept = _kept(pieces, most)
    columns, squares, damping, is_mode, numbers = [], [], [], [], []
    body_of_dof, error = np.empty(o.n_dofs, dtype=np.int64), 0.0
    for number, (piece, k) in enumerate(zip(pieces, kept, strict=True)):
        high, shapes = _ritz(piece.body, piece.shapes[:, :k])
        reached = np.sum((piece.loads.T @ shapes) ** 2 / high, axis=1)
        if piece.compliance.size:
            error = float(np.maximum(error, np.max(1.0 - reached / piece.compliance)))
        n = piece.squares.size + high.size
        block = np.zeros((o.n_dofs, n))
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
        sum(piece.weights.size + piece.dropped for piece in pieces) - sum(kept),
        error,
        np.sort(np.concatenate([piece.lowest for piece in pieces]))[:COMPARED],
    )


def _kept(pieces: list[_Piece], most: int | None) -> list[int]:
    """Return the number of residual shapes that each body keeps.

    Raises:
        ValueError: there are more normal modes than `most` coordinates.
    """
    weights = np.sort(np.concatenate([piece.weights for piece in pieces]))[::-1]
    normal = sum(piece.squares.size for piece in pieces)
    room = weights.size if most is None else most - normal
    if room < 0:
        raise ValueError(
            f"coordinates: expected at least {normal}, the number of normal modes, given {most}"
        )
    least = weights[room - 1] if 0 < room <= weights.size else np.inf if room == 0 else 0.0
    return [int((piece.weights >= least).sum()) for piece in pieces]


def _piece(o: Operators, body: Body, modes: int) -> _Piece:
    """Return a body with its modes and residual shapes."""
    lowest, found = body.modes(max(modes, COMPARED))
    squares, vectors = lowest[:modes], found[:, :modes]
    loads = _loads(o, body)
    flexibility, shapes = body.static(loads, vectors)
    energy = np.einsum("ij,ij->j", shapes, body.stiffness @ shapes)
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


def _independent(body: Body, shapes: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return independent shapes, orthonormal with K, and their weights, decreasing."""
    if not shapes.shape[1]:
        return shapes, np.zeros(0)
    weights, turn = eigh(_gram(shapes, body.stiffness @ shapes))
    kept = weights > DEPENDENT * weights[-1]
    weights, turn = weights[kept][::-1], turn[:, kept][:, ::-1]
    result = shapes @ (turn / np.sqrt(weights))
    for _ in range(2):  # round-off of the eigenvalues is that of the largest
        factor = np.linalg.cholesky(_gram(result, body.stiffness @ result))
        result = result @ np.linalg.inv(factor).T  # the factor is nearly 1
    return result, weights


def _loads(o: Operators, body: Body) -> sp.csc_matrix:
    """Return the loads of B1 that act on a body, CSC (n, k)."""
    H = o.gap_matrix[:, body.dofs]
    stiff, inertia = o.base.stiffness[body.dofs], o.base.mass[body.dofs]
    columns = [stiff]
    if not o.base.is_force:
        columns.append(inertia - body.mass @ body.solve(stiff))
    loads = sp.hstack([H.T, sp.csc_matrix(np.column_stack(columns))], format="csc")
    return loads[:, np.flatnonzero(abs(loads).sum(axis=0))]


def _ritz(body: Body, shapes: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return ω², increasing, and shapes with VᵀMV = 1 and VᵀKV = ω² in the space of some shapes."""
    if not shapes.shape[1]:
        return np.zeros(0), shapes
    inverse, turn = eigh(_gram(shapes, body.mass @ shapes))
    inverse, turn = inverse[::-1], turn[:, ::-1]
    return 1.0 / inverse, np.asarray(shapes @ (turn / np.sqrt(inverse)))


def _gram(left: FloatArray, right: FloatArray) -> FloatArray:
    """Return the symmetric matrix leftᵀ right."""
    product = left.T @ right
    return np.asarray(0.5 * (product + product.T))
