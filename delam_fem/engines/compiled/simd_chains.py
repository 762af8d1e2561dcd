"""Two laminae as four chains of nodes, computed side by side by vectors of four numbers.

Compiled code works on vectors of four doubles, so that one instruction works on four chains. Numba
by itself leaves loops over four lanes scalar: they are too short for its loop vectoriser, and
vectorisation of straight code is off. `float64x4` is LLVM's <4 x double>. On a machine without
registers of that width an operation takes two or four instructions.

A step in lane order is a few sweeps over the rows, four chains at a time. All fields of the state
are in one array X; field number k begins at k times the size. The θ-scheme, and the average
acceleration as its case θ = 1/2, is a step from (u, v) to

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

The four chains of two laminae run from both ends to the middle. Each lamina is a chain of 2×2
blocks (u, φ) that are coupled to their neighbours only. Eliminating it from the clamp and from the
tip at once, up to the middle, makes two chains of half the length. Two laminae make four chains,
and these are the four lanes of a vector:

    row      lane 0 (lamina 1)   lane 1 (lamina 1)   lane 2 (lamina 2)   lane 3 (lamina 2)
    0        node 1              node n              node 1              node n
    1        node 2              node n - 1          node 2              node n - 1
    …                            (n odd: lanes 1 and 3 begin with an empty row instead of node n)
    m - 1    node m              node m + 1          node m              node m + 1

The row that follows the last row is the last row with its neighbouring lanes swapped, so that every
kernel treats the middle as any other row. A "tape" holds coefficients row by row in the order in
which a kernel reads them.
"""

from __future__ import annotations

import operator
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic, models, overload, register_model

from delam_fem.model.operators import Operators
from delam_fem.numerics.types import FloatArray, IntArray
from delam_fem.system.caches import njit

WIDTH = 4
"""Number of doubles in a vector."""
_ALIGNMENT = 64
"""Bytes of a cache line; arrays aligned to it have no vector that lies in two cache lines."""
_VECTOR = ir.VectorType(ir.DoubleType(), WIDTH)
_LANES = ir.VectorType(ir.IntType(32), WIDTH)


class _Float64x4(types.Type):  # type: ignore[misc]
    """Numba's type for a vector of four doubles."""

    def __init__(self) -> None:
        super().__init__(name="float64x4")


float64x4 = _Float64x4()


@register_model(_Float64x4)
class _ChainModel(models.PrimitiveModel):  # type: ignore[misc]
    """Stores the type as LLVM's own vector."""

    def __init__(self, manager, kind):  # type: ignore[no-untyped-def]
        super().__init__(manager, kind, _VECTOR)


def aligned_zeros(size: int) -> FloatArray:
    """Return an array of zeros that begins at a cache line, shape (size,)."""
    raw = np.zeros(size + _ALIGNMENT // 8)
    first = (-raw.ctypes.data % _ALIGNMENT) // 8
    return raw[first : first + size]


def _address(context, builder, signature, values):  # type: ignore[no-untyped-def]
    """Return the address of a vector at pointer + index."""
    index = context.cast(builder, values[1], signature.args[1], types.intp)
    return builder.bitcast(builder.gep(values[0], [index]), _VECTOR.as_pointer())


@intrinsic
def load(typing, pointer, index):  # type: ignore[no-untyped-def]
    """Return the vector of the four numbers that begin at an index behind a pointer."""

    def code(context, builder, signature, values):  # type: ignore[no-untyped-def]
        return builder.load(_address(context, builder, signature, values), align=8)  # type: ignore[no-untyped-call]

    return float64x4(pointer, index), code


@intrinsic
def store(typing, pointer, index, value):  # type: ignore[no-untyped-def]
    """Write the four numbers of a vector, beginning at an index behind a pointer."""

    def code(context, builder, signature, values):  # type: ignore[no-untyped-def]
        builder.store(values[2], _address(context, builder, signature, values), align=8)  # type: ignore[no-untyped-call]
        return context.get_dummy_value()

    return types.none(pointer, index, value), code


@intrinsic
def splat(typing, x):  # type: ignore[no-untyped-def]
    """Return the vector (x, x, x, x)."""

    def code(context, builder, signature, values):  # type: ignore[no-untyped-def]
        scalar = context.cast(builder, values[0], signature.args[0], types.float64)
        one = builder.insert_element(
            ir.Constant(_VECTOR, ir.Undefined), scalar, ir.Constant(ir.IntType(32), 0)
        )
        zeros = ir.Constant(_LANES, [0] * WIDTH)
        return builder.shuffle_vector(one, ir.Constant(_VECTOR, ir.Undefined), zeros)

    return float64x4(x), code


@intrinsic
def fma(typing, a, b, c):  # type: ignore[no-untyped-def]
    """Return a b + c, rounded once if the machine has such an instruction."""

    def code(context, builder, signature, values):  # type: ignore[no-untyped-def]
        kind = ir.FunctionType(_VECTOR, [_VECTOR] * 3)
        function = cgutils.get_or_insert_function(builder.module, kind, "llvm.fmuladd.v4f64")
        return builder.call(function, values)

    return float64x4(a, b, c), code


def _shuffled(order: tuple[int, ...]):  # type: ignore[no-untyped-def]
    """Return an intrinsic that reorders the lanes of a vector."""

    @intrinsic
    def function(typing, a):  # type: ignore[no-untyped-def]
        def code(context, builder, signature, values):  # type: ignore[no-untyped-def]
            return builder.shuffle_vector(values[0], values[0], ir.Constant(_LANES, list(order)))

        return float64x4(a), code

    return function


def _overloaded(symbol, name):  # type: ignore[no-untyped-def]
    """Make an operator of Python an LLVM instruction where both sides are vectors."""

    @intrinsic
    def function(typing, a, b):  # type: ignore[no-untyped-def]
        def code(context, builder, signature, values):  # type: ignore[no-untyped-def]
            return getattr(builder, name)(*values)

        return float64x4(a, b), code

    @overload(symbol)
    def of_vectors(a, b):  # type: ignore[no-untyped-def]
        if a == float64x4 and b == float64x4:
            return lambda a, b: function(a, b)
        return None


for _pair in ((operator.add, "fadd"), (operator.sub, "fsub"), (operator.mul, "fmul")):
    _overloaded(*_pair)  # type: ignore[no-untyped-call]
swap_neighbours = _shuffled((1, 0, 3, 2))
swap_halves = _shuffled((2, 3, 0, 1))


@intrinsic
def smaller(typing, a, b):  # type: ignore[no-untyped-def]
    """Return the smaller number in each lane; where a is NaN, return b."""

    def code(context, builder, signature, values):  # type: ignore[no-untyped-def]
        return builder.select(builder.fcmp_ordered("<", *values), *values)

    return float64x4(a, b), code


@intrinsic
def lane(typing, a, index):  # type: ignore[no-untyped-def]
    """Return one of the four doubles of a vector."""

    def code(context, builder, signature, values):  # type: ignore[no-untyped-def]
        index = context.cast(builder, values[1], signature.args[1], types.int32)
        return builder.extract_element(values[0], index)

    return types.float64(a, index), code


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
    """Return the sum of the four lanes of a vector."""
    return (lane(a, 0) + lane(a, 1)) + (lane(a, 2) + lane(a, 3))


@njit(forceinline=True)
def _forth(tape, t, right, before):  # type: ignore[no-untyped-def]
    """Return y_j = r_j - L_j y_{j-1}, the forward substitution of one row.

    The 16 numbers of -L_j begin at a place of a tape.
    """
    (r0, r1), (y0, y1) = right, before
    r0 = fma(load(tape, t), y0, r0)
    r1 = fma(load(tape, t + 8), y0, r1)
    return fma(load(tape, t + 4), y1, r0), fma(load(tape, t + 12), y1, r1)


@njit(forceinline=True)
def _back(tape, t, own, after):  # type: ignore[no-untyped-def]
    """Return x_j = D_j⁻¹ y_j - U_j x_{j+1}, the backward substitution of one row.

    D_j⁻¹ and -U_j, 16 numbers each, begin at a place of a tape.
    """
    (y0, y1), (x0_next, x1_next) = own, after
    x0 = fma(load(tape, t + 4), y1, load(tape, t) * y0)
    x1 = fma(load(tape, t + 12), y1, load(tape, t + 8) * y0)
    x0 = fma(load(tape, t + 16), x0_next, x0)
    x1 = fma(load(tape, t + 24), x0_next, x1)
    return fma(load(tape, t + 20), x1_next, x0), fma(load(tape, t + 28), x1_next, x1)


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
def eliminate_diagonal(X, size, c, forth, first, constant):  # type: ignore[no-untyped-def]
    """Substitute from the ends to the middle with r = Δt f + B w for a diagonal B.

    Each row gets y_j = r_j - L_j y_{j-1}. `forth` is a tape (`step_tapes`); `constant` is (whether
    there are constant loads, Δt, these loads); `first` is the load of the base on the first row.
    """
    # Row i/8 of a field holds u in numbers i … i+3, one per lane, and φ in i+4 … i+7; row 0 alone
    # carries the load of the base, as only the nodes beside the clamps are coupled to it.
    s = load(c, 4 * S)
    v = V * size
    y = Y * size
    has_load, dt, loads = constant
    force0, force1 = first
    w0 = fma(s, load(X, v), load(X, 0))
    w1 = fma(s, load(X, v + 4), load(X, 4))
    if has_load:
        force0 = fma(dt, load(loads, 0), force0)
        force1 = fma(dt, load(loads, 4), force1)
    y0 = fma(load(forth, 0), w0, force0)
    y1 = fma(load(forth, 4), w1, force1)
    store(X, y, y0)
    store(X, y + 4, y1)
    for i in range(8, size, 8):
        # a row of the tape has 24 numbers, three times the 8 of a field: B and -L
        t = 3 * i
        w0 = fma(s, load(X, v + i), load(X, i))
        w1 = fma(s, load(X, v + i + 4), load(X, i + 4))
        r0 = load(forth, t) * w0
        r1 = load(forth, t + 4) * w1
        if has_load:
            r0 = fma(dt, load(loads, i), r0)
            r1 = fma(dt, load(loads, i + 4), r1)
        y0, y1 = _forth(forth, t + 8, (r0, r1), (y0, y1))
        store(X, y + i, y0)
        store(X, y + i + 4, y1)


@njit(forceinline=True)
def eliminate_chained(X, size, c, forth, first, constant):  # type: ignore[no-untyped-def]
    """Substitute from the ends to the middle with r = Δt f + B w for a block tridiagonal B.

    Each row gets y_j = r_j - L_j y_{j-1}; see `eliminate_diagonal` for the arguments.
    """
    s = load(c, 4 * S)
    v = V * size
    y = Y * size
    has_load, dt, loads = constant
    zero = splat(0.0)
    y0 = y1 = before0 = before1 = zero
    r0, r1 = first
    w0 = fma(s, load(X, v), load(X, 0))
    w1 = fma(s, load(X, v + 4), load(X, 4))
    for i in range(0, size, 8):
        t = 8 * i  # a row of the tape has 64 numbers: B and -L
        j = i + 8
        # B w needs the rows before, here and after; behind the last row comes itself with its lanes
        # swapped, because chains 0 and 1, and 2 and 3, meet there
        if j < size:
            next0 = fma(s, load(X, v + j), load(X, j))
            next1 = fma(s, load(X, v + j + 4), load(X, j + 4))
        else:
            next0 = swap_neighbours(w0)
            next1 = swap_neighbours(w1)
        if has_load:
            r0 = fma(dt, load(loads, i), r0)
            r1 = fma(dt, load(loads, i + 4), r1)
        r0 = fma(load(forth, t), before0, r0)
        r1 = fma(load(forth, t + 8), before0, r1)
        r0 = fma(load(forth, t + 4), before1, r0)
        r1 = fma(load(forth, t + 12), before1, r1)
        r0 = fma(load(forth, t + 16), w0, r0)
        r1 = fma(load(forth, t + 24), w0, r1)
        r0 = fma(load(forth, t + 20), w1, r0)
        r1 = fma(load(forth, t + 28), w1, r1)
        r0 = fma(load(forth, t + 32), next0, r0)
        r1 = fma(load(forth, t + 40), next0, r1)
        r0 = fma(load(forth, t + 36), next1, r0)
        r1 = fma(load(forth, t + 44), next1, r1)
        y0, y1 = _forth(forth, t + 48, (r0, r1), (y0, y1))
        store(X, y + i, y0)
        store(X, y + i + 4, y1)
        before0 = w0
        before1 = w1
        w0 = next0
        w1 = next1
        r0 = zero
        r1 = zero


@njit(forceinline=True)
def finish(X, size, c, back, held, keeps):  # type: ignore[no-untyped-def]
    """Substitute back from the middle to the ends, complete the step (L1, L2), and measure it.

    `held` is the number of the field h of L1. If `keeps` is true, z is kept in the field P. The
    other arguments are members of `matrices.System`.

    Returns:
        zᵀ C z and the smallest gap.
    """
    kappa = load(c, 4 * KAPPA)
    to_u = load(c, 4 * TO_U)
    minus_rho = load(c, 4 * MINUS_RHO)
    y = Y * size
    last = size - 8
    h = held * size
    v = V * size
    next0 = swap_neighbours(load(X, y + last))
    next1 = swap_neighbours(load(X, y + last + 4))
    z0_next = z1_next = loss0 = loss1 = splat(0.0)
    gap = splat(np.inf)
    t = 0
    for i in range(last, -1, -8):
        y0 = load(X, y + i)
        y1 = load(X, y + i + 4)
        next0, next1 = _back(back, t, (y0, y1), (next0, next1))
        z0 = fma(kappa, load(X, h + i), next0)
        z1 = fma(kappa, load(X, h + i + 4), next1)
        u0 = fma(to_u, z0, load(X, i))
        v0_new = fma(minus_rho, load(X, v + i), z0)
        store(X, i, u0)
        store(X, i + 4, fma(to_u, z1, load(X, i + 4)))
        store(X, v + i, v0_new)
        store(X, v + i + 4, fma(minus_rho, load(X, v + i + 4), z1))
        if keeps:
            store(X, P * size + i, z0)
            store(X, P * size + i + 4, z1)
        # zᵀ C z counts the coupling of two rows at the earlier one, for both; where chains meet,
        # each lane counts its own side
        if i == last:
            z0_next = swap_neighbours(z0)
            z1_next = swap_neighbours(z1)
        flow0, flow1 = _flow(back, t + 32, (z0, z1), (z0_next, z1_next))
        loss0 = fma(z0, flow0, loss0)
        loss1 = fma(z1, flow1, loss1)
        z0_next = z0
        z1_next = z1
        # lanes 0 and 1 have the upper minus the lower lamina, plus the gap at rest; lanes 2 and 3
        # have the negative of that, but infinite gaps at rest
        gap = smaller(swap_halves(u0) - u0 + load(back, t + 60), gap)
        t += 64  # a row of the tape has D⁻¹, -U, the form of C and the gaps at rest
    return total(loss0 + loss1), least_lane(gap)


@njit(forceinline=True)
def step(system, X, base_state, loads, keeps):  # type: ignore[no-untyped-def]
    """Compute a candidate state in lane order; return zᵀ C z and the smallest gap.

    `base_state` is (q, q', q'') of the base at θ; `loads` are constant loads and those of further
    forces there. For `keeps` see `finish`.
    """
    q, dq, ddq = base_state
    size = system.size
    c = system.coefficients
    base = system.base
    dt = system.scheme.time_step
    by_q = splat(-dt * q)
    by_dq = splat(-dt * dq)
    by_ddq = splat(-dt * ddq)
    m = 0
    d = size
    k = 2 * size
    force0 = fma(by_q, load(base, k), fma(by_dq, load(base, d), by_ddq * load(base, m)))
    m = m + 4
    d = d + 4
    k = k + 4
    force1 = fma(by_q, load(base, k), fma(by_dq, load(base, d), by_ddq * load(base, m)))
    first = force0, force1
    constant = system.has_load, splat(dt), loads
    if system.is_diagonal_load:
        h_field = U
        eliminate_diagonal(X, size, c, system.forth, first, constant)
    else:
        h_field = V
        eliminate_chained(X, size, c, system.forth, first, constant)
    return finish(X, size, c, system.back, h_field, keeps)


@njit(forceinline=True)
def base_rows(system, X, out, first):  # type: ignore[no-untyped-def]
    """Write m_b·u, c_b·u, k_b·u to out[first:]; only the first row of u contributes."""
    u0 = load(X, 0)
    u1 = load(X, 4)
    base = system.base
    size = system.size
    for j in range(3):
        terms = fma(load(base, j * size + 4), u1, load(base, j * size) * u0)
        out[first + j] = total(terms)


@njit(forceinline=True)
def least_lane(gap):  # type: ignore[no-untyped-def]
    """Return the smallest number of the four lanes."""
    gap = smaller(gap, swap_neighbours(gap))
    return lane(smaller(gap, swap_halves(gap)), 0)


@njit
def largest_of(X, first, n):  # type: ignore[no-untyped-def]
    """Return the largest absolute value of n numbers from a place on, n a multiple of 4."""
    least = zero = splat(0.0)  # -|x|
    for i in range(first, first + n, WIDTH):
        x = load(X, i)
        least = smaller(smaller(zero - x, x), least)
    return -least_lane(least)


@njit
def loss(X, size, form):  # type: ignore[no-untyped-def]
    """Return zᵀ C z in lane order, where z is the field P."""
    first = P * size
    last = size - 8
    p0_next = swap_neighbours(load(X, first + last))
    p1_next = swap_neighbours(load(X, first + last + 4))
    loss0 = loss1 = splat(0.0)
    for i in range(last, -1, -8):
        q = i // 2 * 7
        p0 = load(X, first + i)
        p1 = load(X, first + i + 4)
        flow0, flow1 = _flow(form, q, (p0, p1), (p0_next, p1_next))
        loss0 = fma(p0, flow0, loss0)
        loss1 = fma(p1, flow1, loss1)
        p0_next = p0
        p1_next = p1
    return total(loss0 + loss1)


@njit(forceinline=True)
def smallest_gap(X, size, rest, ahead):  # type: ignore[no-untyped-def]
    """Return the smallest gap in lane order at the displacements u + ahead v."""
    gap = splat(np.inf)
    time = splat(ahead)
    for i in range(0, size, 8):
        u = fma(time, load(X, size + i), load(X, i))
        gap = smaller(swap_halves(u) - u + load(rest, i // 2), gap)
    return least_lane(gap)


@njit
def smallest_approach(X, size, rest, ahead):  # type: ignore[no-untyped-def]
    """Return the smallest U + min(ahead U̇, 0) of all pairs (refinement.py, F1)."""
    gap = splat(np.inf)
    time = splat(ahead)
    zero = splat(0.0)
    for i in range(0, size, 8):
        u = load(X, i)
        v = load(X, size + i)
        shift = smaller(time * (swap_halves(v) - v), zero)
        gap = smaller(swap_halves(u) - u + load(rest, i // 2) + shift, gap)
    return least_lane(gap)


@njit
def smallest_margin(X, size, rest, reach):  # type: ignore[no-untyped-def]
    """Return the smallest U - reach |U̇| of all pairs: that of both signs of F1 at once."""
    gap = splat(np.inf)
    time = splat(-reach)
    zero = splat(0.0)
    for i in range(0, size, 8):
        u = load(X, i)
        v = load(X, size + i)
        # U - reach |U̇| = U + min(-reach U̇, reach U̇)
        rate = swap_halves(v) - v
        shift = smaller(time * rate, zero - time * rate)
        gap = smaller(swap_halves(u) - u + load(rest, i // 2) + shift, gap)
    return least_lane(gap)


@njit
def substitute(X, size, solution, right, out):  # type: ignore[no-untyped-def]
    """Solve A x = r by a solution tape; `right` and `out` number the fields r and x of X."""
    r = right * size
    x = out * size
    y0 = load(X, r)
    y1 = load(X, r + 4)
    store(X, x, y0)
    store(X, x + 4, y1)
    for i in range(8, size, 8):
        t = 6 * i
        y0, y1 = _forth(solution, t, (load(X, r + i), load(X, r + i + 4)), (y0, y1))
        store(X, x + i, y0)
        store(X, x + i + 4, y1)
    next0 = swap_neighbours(y0)
    next1 = swap_neighbours(y1)
    for i in range(size - 8, -1, -8):
        t = 6 * i
        y0 = load(X, x + i)
        y1 = load(X, x + i + 4)
        next0, next1 = _back(solution, t + 16, (y0, y1), (next0, next1))
        store(X, x + i, next0)
        store(X, x + i + 4, next1)


BLOCK = 2
"""Dofs per node."""
LANES = WIDTH
RAYLEIGH_TOLERANCE = 1e-13
"""Largest entry of C - αM - βK relative to C that is round-off of an assembly."""


@dataclass(frozen=True)
class Chains:
    """A block tridiagonal matrix in lane order.

    Attributes:
        before: coupling of each row to the row before it, shape (m, lanes, 2, 2).
        middle: diagonal blocks, shape (m, lanes, 2, 2); blocks of empty rows are 0, not identities.
        after: coupling of each row to the next row, shape (m, lanes, 2, 2); the last row couples to
            itself with swapped lanes.
    """

    before: FloatArray
    middle: FloatArray
    after: FloatArray

    def __add__(self, other: Chains) -> Chains:
        """Return the sum of two matrices."""
        return Chains(
            self.before + other.before, self.middle + other.middle, self.after + other.after
        )

    def scaled(self, factors: FloatArray) -> Chains:
        """Return the matrix with each lane multiplied by its own factor; factors: shape (4,)."""
        by = factors[None, :, None, None]
        return Chains(by * self.before, by * self.middle, by * self.after)


def lane_order(n_elements: int) -> IntArray:
    """Return the place of each dof of two laminae in lane order, shape (4 n,)."""
    m = (n_elements + 1) // 2
    lamina, dof = np.divmod(np.arange(4 * n_elements), 2 * n_elements)
    node = dof // BLOCK + 1
    component = dof % BLOCK
    is_far = node > m
    row = np.where(is_far, 2 * m - node, node - 1)
    return np.asarray(row * ROW + component * LANES + 2 * lamina + is_far, dtype=np.int64)


def chains(matrix: sp.csr_matrix, order: IntArray) -> Chains | None:
    """Return a matrix in lane order, or None if it couples more than neighbours of a lamina."""
    # which block has the entry in row (row, i, lane) and column (row + step, j, other)
    m = -(-matrix.shape[0] // (4 * BLOCK))
    entries = sp.coo_matrix(matrix)
    entries.sum_duplicates()
    values = entries.data
    there = entries.data != 0.0
    (row, i, lane), (column, j, other) = (
        _place(order[index[there]]) for index in (entries.row, entries.col)
    )
    values = values[there]
    step = column - row
    is_last = (row == m - 1) & (column == m - 1)
    across = (other == (lane ^ 1)) & is_last
    kinds = {
        "before": (lane == other) & (step == -1),
        "middle": (lane == other) & (step == 0),
        "after": ((lane == other) & (step == 1)) | across,
    }
    if not np.logical_or.reduce(list(kinds.values())).all():
        return None
    blocks = {}
    for name, mine in kinds.items():
        blocks[name] = np.zeros((m, LANES, BLOCK, BLOCK))
        blocks[name][row[mine], lane[mine], i[mine], j[mine]] = values[mine]
    return Chains(**blocks)


def _place(index: IntArray) -> tuple[IntArray, IntArray, IntArray]:
    """Return row, component and lane of places in lane order."""
    return index // ROW, index % ROW // LANES, index % LANES


def rayleigh(operators: Operators) -> tuple[FloatArray, FloatArray] | None:
    """Return (α [1/s], β [s]) of both laminae, each of shape (2,), such that C = αM + βK.

    Return None if C does not have this form to round-off.
    """
    half = operators.n_dofs // 2
    coefficients = []
    for part in (slice(0, half), slice(half, None)):
        C, M, K = (
            sp.csr_matrix(matrix)[part, part]
            for matrix in (operators.damping, operators.mass, operators.stiffness)
        )
        scales = [abs(matrix).max() or 1.0 for matrix in (M, K)]
        columns = [M / scales[0], K / scales[1]]
        normal = np.array([[a.multiply(b).sum() for b in columns] for a in columns])
        right = np.array([a.multiply(C).sum() for a in columns])
        alpha, beta = np.linalg.lstsq(normal, right, rcond=None)[0] / scales
        if abs(C - alpha * M - beta * K).max() > RAYLEIGH_TOLERANCE * (abs(C).max() or 1.0):
            return None
        coefficients.append((float(alpha), float(beta)))
    return np.array(coefficients)[:, 0], np.array(coefficients)[:, 1]


# -- tapes ------------------------------------------------------------------------------------


def product_tape(matrix: Chains) -> FloatArray:
    """Return the coefficients of y = A x: before, middle, after of each row, shape (48 m,)."""
    return _tape(matrix.before, matrix.middle, matrix.after)


def form_tape(matrix: Chains) -> FloatArray:
    """Return the coefficients of xᵀ A x, with each pair of rows once, shape (28 m,).

    Each row has D00, D01 + D10, D11 and its coupling to the next row from both sides.
    """
    D = matrix.middle
    both = matrix.after.copy()
    # x_rᵀ F_r x_{r+1} + x_{r+1}ᵀ B_{r+1} x_r is one product with F_r + B_{r+1}ᵀ
    both[:-1] += matrix.before[1:].swapaxes(-1, -2)  # at the middle each lane has its own side
    diagonal = np.stack([D[..., 0, 0], D[..., 0, 1] + D[..., 1, 0], D[..., 1, 1]], axis=1)
    coupling = both.transpose(0, 2, 3, 1).reshape(len(D), 4, LANES)
    return flat(np.concatenate([diagonal, coupling], axis=1))


def solution_tape(matrix: Chains) -> FloatArray:
    """Factorise A from both ends to the middle; return its tape, shape (48 m,).

        y_j = r_j - L_j y_{j-1},   x_j = D_j⁻¹ y_j - U_j x_{j+1}
        L_j = B_j D_{j-1}⁻¹,   D_j = A_jj - L_j F_{j-1},   U_j = D_j⁻¹ F_j

    B and F are the couplings to the row before and to the next row. In the last row the two chains
    of a lamina meet in a 4×4 system. The blocks of its inverse take the places of D⁻¹ and U, and
    the swapped y takes the place of the next x.

    Returns:
        -L_j, D_j⁻¹, -U_j of each row.
    """
    m = len(matrix.middle)
    is_empty = ~matrix.middle.any(axis=(2, 3))
    D = matrix.middle.copy()
    D[is_empty] = np.eye(BLOCK)
    lower, inverse, upper = (np.zeros_like(D) for _ in range(3))
    for j in range(m):
        # block LU of a tridiagonal matrix, all four chains at once: the arrays are (lanes, 2, 2)
        if j:
            lower[j] = -matrix.before[j] @ inverse[j - 1]
            D[j] += lower[j] @ matrix.after[j - 1]
        if j < m - 1:
            inverse[j] = np.linalg.inv(D[j])
            upper[j] = -inverse[j] @ matrix.after[j]
    for near, far in ((0, 1), (2, 3)):
        meeting = np.linalg.inv(
            np.block([[D[-1, near], matrix.after[-1, near]], [matrix.after[-1, far], D[-1, far]]])
        )
        inverse[-1, near], upper[-1, near] = meeting[:2, :2], meeting[:2, 2:]
        upper[-1, far], inverse[-1, far] = meeting[2:, :2], meeting[2:, 2:]
    return _tape(lower, inverse, upper)


def step_tapes(
    loads: FloatArray, solution: FloatArray, form: FloatArray, rest: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the coefficients of a step in the order in which its two passes read them.

    Args:
        loads: B of L1, its diagonal of shape (8 m,) or its product tape of shape (48 m,).
        solution: tape of A, shape (48 m,).
        form: tape of the form of C, shape (28 m,).
        rest: gaps at rest, shape (4 m,).

    Returns:
        B and -L of each row, from the ends to the middle, shape (24 m,) or (64 m,); D⁻¹, -U, the
        form and the gaps of each row, from the middle to the ends, shape (64 m,).
    """
    by_row = solution.reshape(-1, 48)
    m = len(by_row)
    forth = np.hstack([loads.reshape(m, -1), by_row[:, :16]])
    back = np.hstack([by_row[:, 16:], form.reshape(m, -1), rest.reshape(m, -1)])
    return flat(forth), flat(back[::-1])


def _tape(*blocks: FloatArray) -> FloatArray:
    """Return 2×2 blocks of shape (m, lanes, 2, 2) as one tape, each entry for all lanes."""
    return flat(np.stack([block.transpose(0, 2, 3, 1) for block in blocks], axis=1))


def flat(values: FloatArray) -> FloatArray:
    """Return all values as one row that begins at a cache line."""
    result = aligned_zeros(values.size)
    result[:] = values.ravel()
    return result
