"""What compiled code knows of a problem: the operators in its own order, the scheme, the factors.

Newmark's scheme and the θ-scheme of Moreau and Jean are one step (lane_kernels.py, L1 and L2) with other numbers:

                 c2              c3          g      d1       d2      ρ          weight
    Newmark      (1/2 - β) Δt²   (1 - γ) Δt  0      β Δt²    γ Δt    1          Δt/4
    θ-scheme     0               0           (θ-1)Δt  θ Δt²  Δt      1/θ - 1    θ² Δt

    (M + p C + q K) a⁺ = f - C ṽ - K (ũ + g ṽ),   Newmark: p = γ Δt, q = β Δt²;  θ: p = θ Δt, q = θ² Δt²

The damping loss of a step is weight · (v⁺ + ρ v)ᵀ C (v⁺ + ρ v).

With C = αM + βK in a lamina A = c_M M + c_K K, c_M = 1 + p α, c_K = q + p β, so that M = (A - c_K K)/c_M and

    a⁺ = A⁻¹ (f - K w) - (α/c_M) ṽ,                     w = ũ + s ṽ,  s = g + β - α c_K / c_M      (S1)
       = A⁻¹ (f + (c_M/c_K) M w) - w/c_K - (α/c_M) ṽ                                             (S2)

S2 needs no product with a matrix when M is diagonal.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp

from delam_fem import banded, lanes
from delam_fem import lane_kernels as lk
from delam_fem.banded import Band, Rows
from delam_fem.operators import FloatArray, IntArray, Operators
from delam_fem.simd import aligned_zeros


@dataclass(frozen=True)
class Scheme:
    """Numbers of a time integration; see the module.

    Attributes:
        time_step: Δt [s].
        to_C: p, factor of C in A [s].
        to_K: q, factor of K in A [s²].
        c2, c3, g, d1, d2, rho, weight: see the module.
        theta: where in the step the base is taken: 1 at its end, θ within.
        gap_ahead: time by which the examined gaps are extrapolated from the start; 0: the end's [s].
    """

    time_step: float
    to_C: float
    to_K: float
    c2: float
    c3: float
    g: float
    d1: float
    d2: float
    rho: float
    weight: float
    theta: float = 1.0
    gap_ahead: float = 0.0

    @classmethod
    def newmark(cls, time_step: float, beta: float = 0.25, gamma: float = 0.5) -> Scheme:
        """Return Newmark's scheme; β = 0 is the central difference."""
        dt = time_step
        p, q = gamma * dt, beta * dt**2
        return cls(dt, p, q, (0.5 - beta) * dt**2, (1.0 - gamma) * dt, 0.0, q, p, 1.0, 0.25 * dt)

    @classmethod
    def moreau_jean(cls, time_step: float, theta: float = 0.5) -> Scheme:
        """Return the θ-scheme."""
        dt, p = time_step, theta * time_step
        ratio = (1.0 - theta) / theta
        return cls(
            dt, p, p**2, 0.0, 0.0, (theta - 1.0) * dt, theta * dt**2, dt, ratio, theta * p,
            theta, 0.5 * dt,
        )  # fmt: skip


class System(NamedTuple):
    """A problem as compiled code reads it; all vectors in internal order, of `size` numbers.

    Attributes:
        size: numbers per field.
        is_chained: two laminae in lane order; otherwise sparse rows and bands.
        is_diagonal_load: L2's B is diagonal.
        coefficients: of L1 and L2, shape (36,).
        scheme: g, weight, θ, gap_ahead, p, q.
        load_tape, solution, mass_solution, form, rest: tapes of lane_kernels.py.
        band, mass_band: factors of A and M where not chained.
        mass, damping, stiffness: by rows.
        base: base columns of M, C, K, shape (3, size).
        inverse_lumped: shape (size,).
        gap_rows: H.
        gap0: gaps at rest, shape (n_pairs,) [m].
        seen: rows m_b, c_b, k_b.
        observed: places of the observed dofs.
    """

    size: int
    is_chained: bool
    is_diagonal_load: bool
    coefficients: FloatArray
    scheme: FloatArray
    load_tape: FloatArray
    solution: FloatArray
    mass_solution: FloatArray
    form: FloatArray
    rest: FloatArray
    band: Band
    mass_band: Band
    mass: Rows
    damping: Rows
    stiffness: Rows
    base: FloatArray
    inverse_lumped: FloatArray
    gap_rows: Rows
    gap0: FloatArray
    seen: Rows
    observed: IntArray


_NO_BAND = Band(0, np.zeros((0, 1)))
_NOTHING = np.zeros(0)


@dataclass(frozen=True)
class _Tapes:
    coefficients: FloatArray
    is_diagonal_load: bool
    load: FloatArray
    solution: FloatArray
    mass_solution: FloatArray
    form: FloatArray
    rest: FloatArray


def build(operators: Operators, scheme: Scheme) -> tuple[System, IntArray]:
    """Return a problem for compiled code, and where it keeps each dof, shape (n,).

    Raises:
        ArithmeticError: M or A is singular.
    """
    o = operators
    order = lanes.lane_order(o.n_dofs // 4) if o.n_dofs % 4 == 0 and o.n_dofs else None
    tapes = None if order is None else _tapes(o, scheme, order)
    if order is not None and tapes is not None:
        size = lanes.ROW * -(-o.n_dofs // lanes.ROW)
        return _system(o, scheme, order, (size, tapes)), order
    order = banded.band_order(sum(abs(matrix) for matrix in (o.mass, o.damping, o.stiffness)))
    return _system(o, scheme, order, (o.n_dofs, None)), order


def _system(
    o: Operators, scheme: Scheme, order: IntArray, layout: tuple[int, _Tapes | None]
) -> System:
    size, tapes = layout
    to = sp.csr_matrix((np.ones(o.n_dofs), (order, np.arange(o.n_dofs))), (size, o.n_dofs))
    mass, damping, stiffness = (to @ A @ to.T for A in (o.mass, o.damping, o.stiffness))
    base = np.vstack([o.base.mass, o.base.damping, o.base.stiffness]) @ to.T
    band = mass_band = _NO_BAND
    if tapes is None:
        band = banded.factorise(mass + scheme.to_C * damping + scheme.to_K * stiffness)
        mass_band = banded.factorise(mass)
        nothing = [_NOTHING] * 5
        tapes = _Tapes(_coefficients(scheme), False, *nothing)
        is_chained = False
    else:
        is_chained = True
    return System(
        size,
        is_chained,
        tapes.is_diagonal_load,
        tapes.coefficients,
        np.array(
            [scheme.g, scheme.weight, scheme.theta, scheme.gap_ahead, scheme.to_C, scheme.to_K]
        ),
        tapes.load,
        tapes.solution,
        tapes.mass_solution,
        tapes.form,
        tapes.rest,
        band,
        mass_band,
        banded.rows(mass),
        banded.rows(damping),
        banded.rows(stiffness),
        np.ascontiguousarray(base),
        to @ (1.0 / o.lumped_mass),
        banded.rows(o.gap_matrix @ to.T),
        np.array(o.gap0, dtype=float),
        banded.rows(sp.csr_matrix(base)),
        order[o.observed],
    )


def _coefficients(
    scheme: Scheme,
    s: FloatArray | float = 0.0,
    kappa_w: FloatArray | float = 0.0,
    kappa_v: FloatArray | float = 0.0,
) -> FloatArray:
    """Return the coefficients of L1 and L2 over the lanes, shape (36,)."""
    result = aligned_zeros(lk.N_COEFFICIENTS * lanes.LANES)
    table = result.reshape(lk.N_COEFFICIENTS, lanes.LANES)
    given = (
        (lk.DT, scheme.time_step), (lk.C2, scheme.c2), (lk.C3, scheme.c3), (lk.S, s),
        (lk.KAPPA_W, kappa_w), (lk.KAPPA_V, kappa_v), (lk.D1, scheme.d1), (lk.D2, scheme.d2),
        (lk.RHO, scheme.rho),
    )  # fmt: skip
    for row, value in given:
        table[row] = value
    return result


def _tapes(o: Operators, scheme: Scheme, order: IntArray) -> _Tapes | None:
    """Return what the lane kernels read, None where the operators are not two laminae."""
    M, C, K = (lanes.chains(matrix, order) for matrix in (o.mass, o.damping, o.stiffness))
    damping, rest = lanes.rayleigh(o), _rest(o, order)
    is_at_clamp = all(
        (order[np.flatnonzero(column)] < lanes.ROW).all()
        for column in (o.base.mass, o.base.damping, o.base.stiffness)
    )
    if M is None or C is None or K is None or damping is None or rest is None or not is_at_clamp:
        return None
    alpha, beta = (np.repeat(values, 2) for values in damping)
    c_M, c_K = 1.0 + scheme.to_C * alpha, scheme.to_K + scheme.to_C * beta
    A = M.scaled(c_M) + K.scaled(c_K)
    is_diagonal = not (M.before.any() or M.after.any() or M.middle[..., 0, 1].any())
    is_diagonal &= scheme.to_K > 0.0
    s, kappa_v = scheme.g + beta - alpha * c_K / c_M, -alpha / c_M
    return _Tapes(
        _coefficients(scheme, s, -1.0 / c_K if is_diagonal else 0.0, kappa_v),
        is_diagonal,
        lanes.diagonal_tape(M.scaled(c_M / c_K)) if is_diagonal
        else lanes.product_tape(K.scaled(np.full(lanes.LANES, -1.0))),
        lanes.solution_tape(A),
        lanes.solution_tape(M),
        lanes.form_tape(C),
        rest,
    )  # fmt: skip


def _rest(o: Operators, order: IntArray) -> FloatArray | None:
    """Return gaps at rest in lane order, shape (4 m,), infinite where there is none.

    None where the gaps are not those between opposite nodes of two laminae.
    """
    n = o.n_pairs
    if o.n_dofs != 4 * n:
        return None
    pair = np.arange(n)
    columns = np.concatenate([2 * pair, 2 * (n + pair)])
    opposite = sp.csr_matrix(
        (np.repeat([-1.0, 1.0], n), (np.tile(pair, 2), columns)), shape=(n, 4 * n)
    )
    if abs(o.gap_matrix - opposite).max() != 0.0:
        return None
    place = order[2 * pair]
    result = aligned_zeros(lanes.LANES * -(-o.n_dofs // lanes.ROW))
    result[:] = np.inf
    result[place // lanes.ROW * lanes.LANES + place % lanes.LANES] = o.gap0
    return result
