"""Compute a step in lane order (lanes.py): sweeps over the rows, four chains at a time.

All fields of the state are in one array X; field number k begins at k times the size. The θ-scheme,
and the average acceleration as its case θ = 1/2, is a step from (u, v) to

    A v_θ = M v + θ Δt (f_θ - K u),   A = M + θ Δt C + θ² Δt² K
    u⁺ = u + Δt v_θ,   v⁺ = v_θ/θ - ρ v,   ρ = 1/θ - 1

If C = αM + βK, then A = c_M M + c_K K, so that A itself can express one of the two products on the
right. With z = v_θ/θ = v⁺ + ρ v the step becomes

    z = A⁻¹ (Δt f_θ + B w) + κ h,   w = u + s v                                              (L1)
    u⁺ = u + θ Δt z,   v⁺ = z - ρ v                                                          (L2)
    B = -Δt K,              h = v,  κ = 1/(θ c_M)                                             (L3)
    B = Δt (c_M/c_K) M,     h = u,  κ = -Δt/c_K                                               (L4)

with s = c_K/(θ Δt c_M). L4 needs no product with a matrix if M is diagonal. A step computes no
accelerations; they follow from the equation of motion.
"""

from __future__ import annotations

import numpy as np

from delam_fem.caches.kernels import njit
from delam_fem.engines.compiled.simd import (
    fma,
    lane,
    load,
    smaller,
    splat,
    store,
    swap_halves,
    swap_neighbours,
)

U, V, A, Y, Z, R, P = range(7)
"""Numbers of the fields: u, v, a, half-solved, solution, right-hand side, z = v⁺ + ρ v."""
N_FIELDS = 7
S, KAPPA, TO_U, MINUS_RHO = range(4)
"""Rows of the coefficients of L1 and L2; each row has one number per lane."""
N_COEFFICIENTS = 4
ROW = 8
"""Numbers in a row: two components times four lanes."""


@njit(forceinline=True)
def total(a):  # type: ignore[no-untyped-def]
    """Return the sum of the lanes."""
    return (lane(a, 0) + lane(a, 1)) + (lane(a, 2) + lane(a, 3))


@njit(forceinline=True)
def _forth(solution, t, right, before):  # type: ignore[no-untyped-def]
    """Return y_j = r_j - L_j y_{j-1}, the forward substitution of one row."""
    (r0, r1), (y0, y1) = right, before
    r0 = fma(load(solution, t), y0, r0)
    r1 = fma(load(solution, t + 8), y0, r1)
    return fma(load(solution, t + 4), y1, r0), fma(load(solution, t + 12), y1, r1)


@njit(forceinline=True)
def _back(solution, t, own, after):  # type: ignore[no-untyped-def]
    """Return x_j = D_j⁻¹ y_j - U_j x_{j+1}, the backward substitution of one row."""
    (y0, y1), (x0_next, x1_next) = own, after
    x0 = fma(load(solution, t + 20), y1, load(solution, t + 16) * y0)
    x1 = fma(load(solution, t + 28), y1, load(solution, t + 24) * y0)
    x0 = fma(load(solution, t + 32), x0_next, x0)
    x1 = fma(load(solution, t + 40), x0_next, x1)
    return fma(load(solution, t + 36), x1_next, x0), fma(load(solution, t + 44), x1_next, x1)


@njit(forceinline=True)
def _flow(form, q, own, after):  # type: ignore[no-untyped-def]
    """Return one row's part of half of C z; the products of z with all parts sum up to zᵀ C z."""
    (z0, z1), (z0_next, z1_next) = own, after
    flow0 = fma(load(form, q + 4), z1, load(form, q) * z0)
    flow1 = load(form, q + 8) * z1
    flow0 = fma(load(form, q + 12), z0_next, flow0)
    flow1 = fma(load(form, q + 20), z0_next, flow1)
    return fma(load(form, q + 16), z1_next, flow0), fma(load(form, q + 24), z1_next, flow1)


@njit(forceinline=True)
def eliminate_diagonal(X, size, c, load_tape, solution, force0, force1):  # type: ignore[no-untyped-def]
    """Substitute from the ends to the middle with r = Δt f + B w for a diagonal B.

    Each row gets y_j = r_j - L_j y_{j-1}.
    """
    s, v, y = load(c, 4 * S), V * size, Y * size
    w0, w1 = fma(s, load(X, v), load(X, 0)), fma(s, load(X, v + 4), load(X, 4))
    y0, y1 = fma(load(load_tape, 0), w0, force0), fma(load(load_tape, 4), w1, force1)
    store(X, y, y0)
    store(X, y + 4, y1)
    for i in range(8, size, 8):
        t = 6 * i
        w0 = fma(s, load(X, v + i), load(X, i))
        w1 = fma(s, load(X, v + i + 4), load(X, i + 4))
        right = load(load_tape, i) * w0, load(load_tape, i + 4) * w1
        y0, y1 = _forth(solution, t, right, (y0, y1))
        store(X, y + i, y0)
        store(X, y + i + 4, y1)


@njit(forceinline=True)
def eliminate_chained(X, size, c, load_tape, solution, force0, force1):  # type: ignore[no-untyped-def]
    """Substitute from the ends to the middle with r = Δt f + B w for a block tridiagonal B.

    Each row gets y_j = r_j - L_j y_{j-1}.
    """
    s, v, y, zero = load(c, 4 * S), V * size, Y * size, splat(0.0)
    y0 = y1 = before0 = before1 = zero
    r0, r1 = force0, force1
    w0, w1 = fma(s, load(X, v), load(X, 0)), fma(s, load(X, v + 4), load(X, 4))
    for i in range(0, size, 8):
        t, j = 6 * i, i + 8
        if j < size:
            next0 = fma(s, load(X, v + j), load(X, j))
            next1 = fma(s, load(X, v + j + 4), load(X, j + 4))
        else:
            next0, next1 = swap_neighbours(w0), swap_neighbours(w1)
        r0 = fma(load(load_tape, t), before0, r0)
        r1 = fma(load(load_tape, t + 8), before0, r1)
        r0 = fma(load(load_tape, t + 4), before1, r0)
        r1 = fma(load(load_tape, t + 12), before1, r1)
        r0 = fma(load(load_tape, t + 16), w0, r0)
        r1 = fma(load(load_tape, t + 24), w0, r1)
        r0 = fma(load(load_tape, t + 20), w1, r0)
        r1 = fma(load(load_tape, t + 28), w1, r1)
        r0 = fma(load(load_tape, t + 32), next0, r0)
        r1 = fma(load(load_tape, t + 40), next0, r1)
        r0 = fma(load(load_tape, t + 36), next1, r0)
        r1 = fma(load(load_tape, t + 44), next1, r1)
        y0, y1 = _forth(solution, t, (r0, r1), (y0, y1))
        store(X, y + i, y0)
        store(X, y + i + 4, y1)
        before0, before1, w0, w1, r0, r1 = w0, w1, next0, next1, zero, zero


@njit(forceinline=True)
def finish(X, size, c, solution, form, rest, held, keeps):  # type: ignore[no-untyped-def]
    """Substitute back from the middle to the ends, complete the step (L1, L2), and measure it.

    `held` is the number of the field h of L1. If `keeps` is true, z is kept in the field P. The
    other arguments are members of `system.System`.

    Returns:
        zᵀ C z and the smallest gap.
    """
    kappa, to_u, minus_rho = load(c, 4 * KAPPA), load(c, 4 * TO_U), load(c, 4 * MINUS_RHO)
    y, last, h, v = Y * size, size - 8, held * size, V * size
    next0, next1 = swap_neighbours(load(X, y + last)), swap_neighbours(load(X, y + last + 4))
    z0_next = z1_next = loss0 = loss1 = splat(0.0)
    gap = splat(np.inf)
    for i in range(last, -1, -8):
        t, q = 6 * i, i // 2 * 7
        y0, y1 = load(X, y + i), load(X, y + i + 4)
        next0, next1 = _back(solution, t, (y0, y1), (next0, next1))
        z0, z1 = fma(kappa, load(X, h + i), next0), fma(kappa, load(X, h + i + 4), next1)
        u0, v0_new = fma(to_u, z0, load(X, i)), fma(minus_rho, load(X, v + i), z0)
        store(X, i, u0)
        store(X, i + 4, fma(to_u, z1, load(X, i + 4)))
        store(X, v + i, v0_new)
        store(X, v + i + 4, fma(minus_rho, load(X, v + i + 4), z1))
        if keeps:
            store(X, P * size + i, z0)
            store(X, P * size + i + 4, z1)
        if i == last:
            z0_next, z1_next = swap_neighbours(z0), swap_neighbours(z1)
        flow0, flow1 = _flow(form, q, (z0, z1), (z0_next, z1_next))
        loss0, loss1 = fma(z0, flow0, loss0), fma(z1, flow1, loss1)
        z0_next, z1_next = z0, z1
        gap = smaller(swap_halves(u0) - u0 + load(rest, i // 2), gap)
    return total(loss0 + loss1), least_lane(gap)


@njit(forceinline=True)
def step(system, X, base_state, keeps):  # type: ignore[no-untyped-def]
    """Compute a candidate state; return zᵀ C z and the smallest gap.

    `base_state` is (q, q', q'') of the base at θ. For `keeps` see `finish`.
    """
    q, dq, ddq = base_state
    size, c, base, dt = system.size, system.coefficients, system.base, system.scheme.time_step
    by_q, by_dq, by_ddq = splat(-dt * q), splat(-dt * dq), splat(-dt * ddq)
    m, d, k = 0, size, 2 * size
    force0 = fma(by_q, load(base, k), fma(by_dq, load(base, d), by_ddq * load(base, m)))
    m, d, k = m + 4, d + 4, k + 4
    force1 = fma(by_q, load(base, k), fma(by_dq, load(base, d), by_ddq * load(base, m)))
    if system.is_diagonal_load:
        held = U
        eliminate_diagonal(X, size, c, system.load_tape, system.solution, force0, force1)
    else:
        held = V
        eliminate_chained(X, size, c, system.load_tape, system.solution, force0, force1)
    return finish(X, size, c, system.solution, system.form, system.rest, held, keeps)


@njit(forceinline=True)
def base_rows(system, X, out, first):  # type: ignore[no-untyped-def]
    """Write m_b·u, c_b·u, k_b·u to out[first:]; only the first row of u contributes."""
    u0, u1, base, size = load(X, 0), load(X, 4), system.base, system.size
    for j in range(3):
        terms = fma(load(base, j * size + 4), u1, load(base, j * size) * u0)
        out[first + j] = total(terms)


@njit(forceinline=True)
def least_lane(gap):  # type: ignore[no-untyped-def]
    """Return the smallest number of the four lanes."""
    gap = smaller(gap, swap_neighbours(gap))
    return lane(smaller(gap, swap_halves(gap)), 0)


@njit
def loss(X, size, form):  # type: ignore[no-untyped-def]
    """Return pᵀ C p, where p is the field P."""
    first, last = P * size, size - 8
    p0_next = swap_neighbours(load(X, first + last))
    p1_next = swap_neighbours(load(X, first + last + 4))
    loss0 = loss1 = splat(0.0)
    for i in range(last, -1, -8):
        q = i // 2 * 7
        p0, p1 = load(X, first + i), load(X, first + i + 4)
        flow0, flow1 = _flow(form, q, (p0, p1), (p0_next, p1_next))
        loss0, loss1 = fma(p0, flow0, loss0), fma(p1, flow1, loss1)
        p0_next, p1_next = p0, p1
    return total(loss0 + loss1)


@njit(forceinline=True)
def smallest_gap(X, size, rest, ahead):  # type: ignore[no-untyped-def]
    """Return the smallest gap at the displacements u + ahead v."""
    gap, time = splat(np.inf), splat(ahead)
    for i in range(0, size, 8):
        u = fma(time, load(X, size + i), load(X, i))
        gap = smaller(swap_halves(u) - u + load(rest, i // 2), gap)
    return least_lane(gap)


@njit
def smallest_approach(X, size, rest, ahead):  # type: ignore[no-untyped-def]
    """Return the smallest U + min(ahead U̇, 0) of all pairs (refinement.py, F1)."""
    gap, time, zero = splat(np.inf), splat(ahead), splat(0.0)
    for i in range(0, size, 8):
        u, v = load(X, i), load(X, size + i)
        shift = smaller(time * (swap_halves(v) - v), zero)
        gap = smaller(swap_halves(u) - u + load(rest, i // 2) + shift, gap)
    return least_lane(gap)


@njit
def smallest_margin(X, size, rest, reach):  # type: ignore[no-untyped-def]
    """Return the smallest U - reach |U̇| of all pairs: that of both signs of F1 at once."""
    gap, time, zero = splat(np.inf), splat(-reach), splat(0.0)
    for i in range(0, size, 8):
        u, v = load(X, i), load(X, size + i)
        rate = swap_halves(v) - v
        shift = smaller(time * rate, zero - time * rate)
        gap = smaller(swap_halves(u) - u + load(rest, i // 2) + shift, gap)
    return least_lane(gap)


@njit
def substitute(X, size, solution, right, out):  # type: ignore[no-untyped-def]
    """Solve A x = r; `right` and `out` are the numbers of the fields r and x of X."""
    r, x = right * size, out * size
    y0, y1 = load(X, r), load(X, r + 4)
    store(X, x, y0)
    store(X, x + 4, y1)
    for i in range(8, size, 8):
        t = 6 * i
        y0, y1 = _forth(solution, t, (load(X, r + i), load(X, r + i + 4)), (y0, y1))
        store(X, x + i, y0)
        store(X, x + i + 4, y1)
    next0, next1 = swap_neighbours(y0), swap_neighbours(y1)
    for i in range(size - 8, -1, -8):
        t = 6 * i
        y0, y1 = load(X, x + i), load(X, x + i + 4)
        next0, next1 = _back(solution, t, (y0, y1), (next0, next1))
        store(X, x + i, next0)
        store(X, x + i + 4, next1)
