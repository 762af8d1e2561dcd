"""The step in lane order (lanes.py): sweeps over the rows, four chains at a time.

All fields of the state stand in one array X; a field begins at its number times the size. A step is

    ũ = u + Δt v + c2 a,   ṽ = v + c3 a,   w = ũ + s ṽ                                           (L1)
    a⁺ = A⁻¹ (f + B w) + κ_w w + κ_v ṽ                                                        (L2)
    u⁺ = ũ + d1 a⁺,   v⁺ = ṽ + d2 a⁺

which holds Newmark's scheme and the θ-scheme (see compiled_system.py). With C = αM + βK the products with C and
K merge into one with B = -K, or with a multiple of M, whichever is the cheaper.
"""

from __future__ import annotations

import numba
import numpy as np

from delam_fem.simd import fma, lane, load, smaller, splat, store, swap_halves, swap_neighbours

U, V, A, Y, W, P, Z, R = range(8)
"""Fields: u, v, a, half-solved, w of L1, v⁺ + ρ v, solution, right-hand side."""
N_FIELDS = 8
DT, C2, C3, S, KAPPA_W, KAPPA_V, D1, D2, RHO = range(9)
"""Coefficients of L1 and L2, each over the four lanes."""
N_COEFFICIENTS = 9


@numba.njit(cache=True)
def total(a):  # type: ignore[no-untyped-def]
    """Return the sum of the lanes."""
    return (lane(a, 0) + lane(a, 1)) + (lane(a, 2) + lane(a, 3))


@numba.njit(cache=True)
def predict(X, size, c):  # type: ignore[no-untyped-def]
    """Write L1 over u and v; keep w and ṽ + ρ v."""
    dt, c2, c3, s, rho = load(c, 0), load(c, 4), load(c, 8), load(c, 12), load(c, 32)
    for i in range(0, size, 4):
        v, a = load(X, size + i), load(X, 2 * size + i)
        u = fma(c2, a, fma(dt, v, load(X, i)))
        v_new = fma(c3, a, v)
        store(X, i, u)
        store(X, size + i, v_new)
        store(X, W * size + i, fma(s, v_new, u))
        store(X, P * size + i, fma(rho, v, v_new))


@numba.njit(cache=True)
def eliminate_diagonal(X, size, load_tape, solution, force):  # type: ignore[no-untyped-def]
    """Go to the middle with r = f + B w, B diagonal: y_j = r_j - L_j y_{j-1}."""
    w, y = W * size, Y * size
    y0 = fma(load(load_tape, 0), load(X, w), load(force, 0))
    y1 = fma(load(load_tape, 4), load(X, w + 4), load(force, 4))
    store(X, y, y0)
    store(X, y + 4, y1)
    for i in range(8, size, 8):
        t = 6 * i
        r0 = load(load_tape, i) * load(X, w + i)
        r1 = load(load_tape, i + 4) * load(X, w + i + 4)
        r0 = fma(load(solution, t), y0, r0)
        r1 = fma(load(solution, t + 8), y0, r1)
        y0, y1 = (
            fma(load(solution, t + 4), y1, r0),
            fma(load(solution, t + 12), y1, r1),
        )
        store(X, y + i, y0)
        store(X, y + i + 4, y1)


@numba.njit(cache=True)
def eliminate_chained(X, size, load_tape, solution, force):  # type: ignore[no-untyped-def]
    """Go to the middle with r = f + B w, B block tridiagonal: y_j = r_j - L_j y_{j-1}."""
    w, y, zero = W * size, Y * size, splat(0.0)
    y0 = y1 = before0 = before1 = zero
    r0, r1 = load(force, 0), load(force, 4)
    w0, w1 = load(X, w), load(X, w + 4)
    for i in range(0, size, 8):
        t = 6 * i
        if i + 8 < size:
            next0, next1 = load(X, w + i + 8), load(X, w + i + 12)
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
        r0 = fma(load(solution, t), y0, r0)
        r1 = fma(load(solution, t + 8), y0, r1)
        y0, y1 = (
            fma(load(solution, t + 4), y1, r0),
            fma(load(solution, t + 12), y1, r1),
        )
        store(X, y + i, y0)
        store(X, y + i + 4, y1)
        before0, before1, w0, w1, r0, r1 = w0, w1, next0, next1, zero, zero


@numba.njit(cache=True)
def finish(X, size, c, solution, form, rest):  # type: ignore[no-untyped-def]
    """Go back to the ends, complete the step, and measure it on the way.

    Returns:
        (v⁺ + ρ v)ᵀ C (v⁺ + ρ v) and the smallest gap.
    """
    kappa_w, kappa_v, d1, d2 = load(c, 16), load(c, 20), load(c, 24), load(c, 28)
    y, last = Y * size, size - 8
    next0, next1 = swap_neighbours(load(X, y + last)), swap_neighbours(load(X, y + last + 4))
    p0_next = p1_next = loss0 = loss1 = splat(0.0)
    gap = splat(np.inf)
    for i in range(last, -1, -8):
        t, q = 6 * i, i // 2 * 7
        y0, y1 = load(X, y + i), load(X, y + i + 4)
        x0 = fma(load(solution, t + 20), y1, load(solution, t + 16) * y0)
        x1 = fma(load(solution, t + 28), y1, load(solution, t + 24) * y0)
        x0 = fma(load(solution, t + 32), next0, x0)
        x1 = fma(load(solution, t + 40), next0, x1)
        x0, x1 = (
            fma(load(solution, t + 36), next1, x0),
            fma(load(solution, t + 44), next1, x1),
        )
        next0, next1 = x0, x1
        v0, v1 = load(X, size + i), load(X, size + i + 4)
        a0 = fma(kappa_v, v0, fma(kappa_w, load(X, W * size + i), x0))
        a1 = fma(kappa_v, v1, fma(kappa_w, load(X, W * size + i + 4), x1))
        u0, u1 = fma(d1, a0, load(X, i)), fma(d1, a1, load(X, i + 4))
        p0, p1 = fma(d2, a0, load(X, P * size + i)), fma(d2, a1, load(X, P * size + i + 4))
        store(X, 2 * size + i, a0)
        store(X, 2 * size + i + 4, a1)
        store(X, i, u0)
        store(X, i + 4, u1)
        store(X, size + i, fma(d2, a0, v0))
        store(X, size + i + 4, fma(d2, a1, v1))
        store(X, P * size + i, p0)
        store(X, P * size + i + 4, p1)
        if i == last:
            p0_next, p1_next = swap_neighbours(p0), swap_neighbours(p1)
        flow0 = fma(load(form, q + 4), p1, load(form, q) * p0)
        flow1 = load(form, q + 8) * p1
        flow0 = fma(load(form, q + 12), p0_next, flow0)
        flow1 = fma(load(form, q + 20), p0_next, flow1)
        flow0 = fma(load(form, q + 16), p1_next, flow0)
        flow1 = fma(load(form, q + 24), p1_next, flow1)
        loss0, loss1 = fma(p0, flow0, loss0), fma(p1, flow1, loss1)
        p0_next, p1_next = p0, p1
        gap = smaller(swap_halves(u0) - u0 + load(rest, i // 2), gap)
    return total(loss0 + loss1), _smallest(gap)


@numba.njit(cache=True)
def _smallest(gap):  # type: ignore[no-untyped-def]
    """Return the smallest lane."""
    gap = smaller(gap, swap_neighbours(gap))
    return lane(smaller(gap, swap_halves(gap)), 0)


@numba.njit(cache=True)
def loss(X, size, form):  # type: ignore[no-untyped-def]
    """Return pᵀ C p of the field P."""
    first, last = P * size, size - 8
    p0_next = swap_neighbours(load(X, first + last))
    p1_next = swap_neighbours(load(X, first + last + 4))
    loss0 = loss1 = splat(0.0)
    for i in range(last, -1, -8):
        q = i // 2 * 7
        p0, p1 = load(X, first + i), load(X, first + i + 4)
        flow0 = fma(load(form, q + 4), p1, load(form, q) * p0)
        flow1 = load(form, q + 8) * p1
        flow0 = fma(load(form, q + 12), p0_next, flow0)
        flow1 = fma(load(form, q + 20), p0_next, flow1)
        flow0 = fma(load(form, q + 16), p1_next, flow0)
        flow1 = fma(load(form, q + 24), p1_next, flow1)
        loss0, loss1 = fma(p0, flow0, loss0), fma(p1, flow1, loss1)
        p0_next, p1_next = p0, p1
    return total(loss0 + loss1)


@numba.njit(cache=True)
def smallest_gap(X, size, rest, ahead):  # type: ignore[no-untyped-def]
    """Return the smallest gap of u + ahead v."""
    gap, time = splat(np.inf), splat(ahead)
    for i in range(0, size, 8):
        u = fma(time, load(X, size + i), load(X, i))
        gap = smaller(swap_halves(u) - u + load(rest, i // 2), gap)
    return _smallest(gap)


@numba.njit(cache=True)
def substitute(X, size, solution, right, out):  # type: ignore[no-untyped-def]
    """Solve A x = r between two fields."""
    r, x = right * size, out * size
    y0, y1 = load(X, r), load(X, r + 4)
    store(X, x, y0)
    store(X, x + 4, y1)
    for i in range(8, size, 8):
        t = 6 * i
        r0 = fma(load(solution, t), y0, load(X, r + i))
        r1 = fma(load(solution, t + 8), y0, load(X, r + i + 4))
        y0, y1 = (
            fma(load(solution, t + 4), y1, r0),
            fma(load(solution, t + 12), y1, r1),
        )
        store(X, x + i, y0)
        store(X, x + i + 4, y1)
    next0, next1 = swap_neighbours(y0), swap_neighbours(y1)
    for i in range(size - 8, -1, -8):
        t = 6 * i
        y0, y1 = load(X, x + i), load(X, x + i + 4)
        x0 = fma(load(solution, t + 20), y1, load(solution, t + 16) * y0)
        x1 = fma(load(solution, t + 28), y1, load(solution, t + 24) * y0)
        x0 = fma(load(solution, t + 32), next0, x0)
        x1 = fma(load(solution, t + 40), next0, x1)
        next0, next1 = (
            fma(load(solution, t + 36), next1, x0),
            fma(load(solution, t + 44), next1, x1),
        )
        store(X, x + i, next0)
        store(X, x + i + 4, next1)
