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
made orthonormal with K. The small problem K z = ω² M z then gives the rest of the basis. Φ and X are
orthogonal, so the kept normal modes stay as they are.

Source: R. H. MacNeal, "A hybrid method of component mode synthesis", Comput. Struct. 1 (1971);
S. Rubin, "Improved component-mode representation for structural dynamic analysis", AIAA J. 13
(1975).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import eigh

from delam_fem.model.operators import Operators
from delam_fem.model.reduction.bodies import Body, bodies
from delam_fem.numerics.arrays import FloatArray, IntArray

DEPENDENT = 1e-11
"""Eigenvalue of the scaled Gram matrix, relative to the largest, below which shapes are dependent:
round-off of static shapes is 1e-12 of it at most for the meshes of the tests."""
NOTHING = 1e-13
"""Strain energy of a residual shape relative to that of the whole shape that is round-off."""


@dataclass(frozen=True)
class Basis:
    """The basis of a reduced structure; m coordinates.

    Attributes:
        vectors: V, shape (n_dofs, m).
        squares: ω² of each coordinate, body by body and increasing within each, shape (m,) [1/s2].
        is_mode: whether a coordinate is a normal mode of a body, shape (m,).
        body: number of the body of each coordinate, shape (m,).
        dropped: number of shapes left out as dependent on others, or beyond the largest number.
    """

    vectors: FloatArray
    squares: FloatArray
    is_mode: np.ndarray[tuple[int, ...], np.dtype[np.bool_]]
    body: IntArray
    dropped: int


@dataclass(frozen=True)
class _Residual:
    """Residual shapes of a body, orthonormal with K, the most flexible first.

    Attributes:
        shapes: Y, shape (n, k).
        weights: eigenvalues of the scaled Gram matrix, decreasing, shape (k,).
        dropped: number of dependent shapes.
    """

    shapes: FloatArray
    weights: FloatArray
    dropped: int


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
    found = bodies(o, shift)
    normal = [body.modes(modes) for body in found]
    loads = [_loads(o, body) for body in found]
    residual = [
        _independent(body, body.static(load, vectors), load)
        for body, (_, vectors), load in zip(found, normal, loads, strict=True)
    ]
    kept = [r.weights.size for r in residual]
    if most is not None:
        room = most - sum(squares.size for squares, _ in normal)
        if room < 0:
            raise ValueError(
                f"coordinates: expected at least {most - room}, the number of normal modes, given "
                f"{most}"
            )
        weights = np.sort(np.concatenate([r.weights for r in residual]))[::-1]
        least = weights[room - 1] if 0 < room <= weights.size else (0.0 if room else np.inf)
        kept = [int((r.weights >= least).sum()) for r in residual]
    columns, squares, is_mode, of_body = [], [], [], []
    for number, (body, (low, vectors), own, k) in enumerate(
        zip(found, normal, residual, kept, strict=True)
    ):
        high, shapes = _ritz(body, own.shapes[:, :k])
        block = np.zeros((o.n_dofs, low.size + high.size))
        block[body.dofs] = np.hstack([vectors, shapes])
        columns.append(block)
        squares += [low, high]
        is_mode += [np.ones(low.size, dtype=bool), np.zeros(high.size, dtype=bool)]
        of_body.append(np.full(low.size + high.size, number))
    dropped = sum(r.weights.size + r.dropped for r in residual) - sum(kept)
    return Basis(
        np.hstack(columns),
        np.concatenate(squares),
        np.concatenate(is_mode),
        np.concatenate(of_body),
        dropped,
    )


def _loads(o: Operators, body: Body) -> FloatArray:
    """Return the loads of B1 that act on a body, shape (n, k)."""
    H = o.gap_matrix[:, body.dofs]
    rows = np.flatnonzero(np.diff(H.indptr))
    stiff, inertia = o.base.stiffness[body.dofs], o.base.mass[body.dofs]
    columns = [H[rows].T.toarray(), stiff[:, None]]
    if not o.base.is_force:
        columns.append((inertia - body.mass @ body.solve(stiff))[:, None])
    loads = np.hstack(columns)
    return np.asarray(loads[:, np.abs(loads).max(axis=0) > 0.0])


def _independent(body: Body, shapes: FloatArray, loads: FloatArray) -> _Residual:
    """Return independent residual shapes, orthonormal with K."""
    n = shapes.shape[1]
    whole = np.einsum("ij,ij->j", loads, body.solve(loads))
    energy = np.einsum("ij,ij->j", shapes, body.stiffness @ shapes)
    there = energy > NOTHING * whole
    if not there.any():
        return _Residual(shapes[:, :0], np.zeros(0), n)
    shapes = shapes[:, there] / np.sqrt(energy[there])
    weights, turn = eigh(_gram(shapes, body.stiffness @ shapes))
    kept = weights > DEPENDENT * weights[-1]
    weights, turn = weights[kept][::-1], turn[:, kept][:, ::-1]
    shapes = shapes @ (turn / np.sqrt(weights))
    for _ in range(2):  # round-off of the eigenvalues is that of the largest
        shapes = _orthonormal(body, shapes)
    return _Residual(shapes, weights, n - weights.size)


def _orthonormal(body: Body, shapes: FloatArray) -> FloatArray:
    """Return nearly orthonormal shapes, orthonormal with K: each in turn without those before."""
    gram = _gram(shapes, body.stiffness @ shapes)
    factor = np.linalg.cholesky(gram)
    return np.asarray(np.linalg.solve(factor, shapes.T).T)


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
