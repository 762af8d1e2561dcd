"""Solve the linear complementarity problem of simultaneous impacts exactly.

    0 <= p,   W p + q >= 0,   p^T (W p + q) = 0

W = H M^-1 H^T is symmetric and positive semidefinite, and q lies in its range. The problem is the
optimality condition of the non-negative least-squares problem min 1/2 |L^T p + L^-1 q|^2 with
W = L L^T. Lawson and Hanson's active-set method solves it, working on W directly: the impulses of
the active pairs follow from W_AA s = -q_A, and all others are 0. Lasting contact pushes the pairs
of the last step, so the method begins with these: the pairs that would be pulled leave the set at
once, then the method goes on as always, from p = 0.

If W_AA is singular to round-off, the method begins again with no pair and takes one at a time. A
redundant pair has no residual once the pairs that span it are active, so the method never adds it:
p is then one of several solutions, but H^T p is unique.

Redundant pairs with different restitution demand different things. Then q need not lie in the range
of W, and the method may end with a pair that lacks something. W + ε diag W is regular, and as ε
tends to 0 its solution tends to the smallest p of the problem itself, if there is one (R. W.
Cottle, J.-S. Pang, R. E. Stone, The Linear Complementarity Problem, theorem 5.6.2). It is tried
before such a problem counts as one without solution.

Source:
    C. L. Lawson, R. J. Hanson, Solving Least Squares Problems, ch. 23.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from delam_fem.numerics.types import FloatArray, IntArray
from delam_fem.system.caches import kept, njit

TOLERANCE = 1e-13
"""A residual below this number times the largest |q| is round-off (for a few dozen pairs). What is
round-off of q itself follows from the motion, see `rules.OF_PLACE`."""

SINGULAR = 1e-13
"""A pivot below this number times the diagonal entry of W is round-off: the pair is redundant."""

LIFT = 1e-9
"""ε of the second attempt; the residual that it leaves is of this size, its round-off 1e-16/ε."""

GONE = 1e-14
"""An impulse below this number times the size of its trial value is round-off of zero."""

UNSOLVABLE = 1e-4
"""A residual above this number times the largest |q| is an error; nearly equal pairs reach 1e-6."""

SOLVED, NOT_FINITE, NOT_FOUND, OUT_OF_RANGE = range(4)
FAILURES = {
    NOT_FINITE: "the velocities before the impact are not finite; the motion diverges: use a "
    "smaller time step",
    NOT_FOUND: "no solution found; check that the mass, damping and stiffness matrices are "
    "symmetric",
    OUT_OF_RANGE: "no impulses can part these pairs (q is not in the range of W); check their rows "
    "of the gap matrix",
}
"""Results of `solve_among` that are errors, with what to tell the user."""
IDLE, ACTIVE, BARRED = range(3)
"""Sides of a pair in `solve_among`: impulse 0, impulse sought, or dependent on active pairs."""


class WarmStart(NamedTuple):
    """The arrays that `solve_among` keeps from call to call, for n pairs.

    Attributes:
        was_idle: pairs that were in question last time and got no impulse, shape (n,).
        factor: Cholesky factor of the last W_AA, flat, shape (n²,).
        members: number of the pairs of this factor, or -1; then the place where its W begins; then
            these pairs, shape (n + 2,).
        active, trial, side: work space, each of shape (n,): the active pairs, s of W_AA s = -q_A,
            and IDLE, ACTIVE or BARRED.
    """

    was_idle: npt.NDArray[np.uint8]
    factor: FloatArray
    members: IntArray
    active: IntArray
    trial: FloatArray
    side: npt.NDArray[np.uint8]


def nothing_known(n: int) -> WarmStart:
    """Return an empty `WarmStart` for n pairs; Python and compiled code call this function."""
    # three allocations, cut into views: a solution of few pairs takes hardly longer than these
    numbers = np.zeros(n * (n + 1))
    places = np.full(2 * n + 2, -1)
    marks = np.zeros(2 * n, np.uint8)
    return WarmStart(marks[:n], numbers[n:], places[n:], places[:n], numbers[:n], marks[n:])


fresh = njit(nothing_known)


@njit
def forget(memory, pairs, n, begins_idle):  # type: ignore[no-untyped-def]
    """Forget the last solution of n pairs, and the factor of the last W_AA.

    Args:
        memory: see `WarmStart`.
        pairs: the pairs, the first n entries.
        n: number of these pairs.
        begins_idle: whether few of them are likely to be pushed; otherwise most.
    """
    memory.members[0] = -1
    for j in range(n):
        memory.was_idle[pairs[j]] = begins_idle


@njit
def _factorise(W, origin, stride, pairs, m, lift, memory):  # type: ignore[no-untyped-def]
    """Factorise W_AA of the m active pairs; return False if it is singular.

    Its diagonal is multiplied by 1 + lift.

    W_AA = L Lᵀ by Cholesky; the diagonal of L is stored inverted. A pivot that is not a number also
    counts as that of a singular matrix. A row of L depends on the pairs up to it alone: the rows of
    the last factor remain as far as its pairs are the same.
    """
    factor, members, active = memory.factor, memory.members, memory.active
    n_kept = 0
    if members[1] == origin:
        while n_kept < min(m, members[0]) and members[2 + n_kept] == pairs[active[n_kept]]:
            n_kept += 1
    members[0] = n_kept
    members[1] = origin
    for i in range(n_kept, m):
        pair = pairs[active[i]]
        first = i * stride
        row = origin + pair
        for j in range(i + 1):
            value = W[row + pairs[active[j]] * stride]
            if j == i and lift > 0.0:
                value += lift * value
            for k in range(j):
                value -= factor[first + k] * factor[j * stride + k]
            if j < i:
                factor[first + j] = value * factor[j * stride + j]
            elif value > SINGULAR * W[row + pair * stride]:
                factor[first + i] = 1.0 / np.sqrt(value)
            else:
                return False
        members[2 + i] = pair
        members[0] = i + 1
    return True


@njit
def _substitute(stride, q, m, memory):  # type: ignore[no-untyped-def]
    """Solve W_AA s = -q_A with the factor of W_AA; s goes to `memory.trial`."""
    factor, active, trial = memory.factor, memory.active, memory.trial
    for i in range(m):
        value = -q[active[i]]
        for k in range(i):
            value -= factor[i * stride + k] * trial[k]
        trial[i] = value * factor[i * stride + i]
    for i in range(m - 1, -1, -1):
        value = trial[i] * factor[i * stride + i]
        trial[i] = value
        for k in range(i):  # column by column, so that vectors of numbers are subtracted
            trial[k] -= factor[i * stride + k] * value


@njit
def _move(p, m, memory):  # type: ignore[no-untyped-def]
    """Move the impulses p towards `trial` while all stay >= 0.

    Pairs whose impulse falls to zero on the way become idle.

    Returns:
        Whether they get there; number of pairs that stay active, in the same order.
    """
    active = memory.active
    trial = memory.trial
    step = 1.0
    for i in range(m):
        if trial[i] <= 0.0:
            before = p[active[i]]
            step = min(step, before / (before - trial[i])) if before > trial[i] else 0.0
    n_active = 0
    for i in range(m):
        j = active[i]
        p[j] = trial[i] if step == 1.0 else p[j] + step * (trial[i] - p[j])
        if step < 1.0 and trial[i] <= 0.0 and p[j] <= GONE * abs(trial[i]):
            p[j] = 0.0
            memory.side[j] = IDLE
        else:
            active[n_active] = j
            n_active += 1
    return step == 1.0, n_active


@njit
def _most_violated(W, origin, stride, pairs, n, q, p, m, limit, memory):  # type: ignore[no-untyped-def]
    """Return the idle pair with the smallest residual below -limit, or -1."""
    best = -limit
    chosen = -1
    for j in range(n):
        if memory.side[j] == IDLE:
            row = origin + pairs[j]
            residual = q[j]
            for i in range(m):
                other = memory.active[i]
                residual += W[row + pairs[other] * stride] * p[other]
            if residual < best:
                best = residual
                chosen = j
    return chosen


@njit
def _list_active(n, memory):  # type: ignore[no-untyped-def]
    """List the active ones of n pairs in their order; return their number."""
    m = 0
    for j in range(n):
        if memory.side[j] == ACTIVE:
            memory.active[m] = j
            m += 1
    return m


@njit
def _is_solved(W, origin, stride, pairs, n, q, p, limit, lift, memory):  # type: ignore[no-untyped-def]
    """Run the iteration of `solve_among`; return whether it came to an end.

    A pair that becomes active takes the last place, so that the factor gets one row. At the end the
    impulses are computed once more with the pairs in their order, on which alone they depend then.
    """
    side = memory.side
    active = memory.active
    for j in range(n):
        p[j] = 0.0
        side[j] = IDLE if memory.was_idle[pairs[j]] else ACTIVE
    m = _list_active(n, memory)
    is_fresh = m == 0
    for _ in range(4 * n + 20):
        if _factorise(W, origin, stride, pairs, m, lift, memory):
            _substitute(stride, q, m, memory)
            is_there, m = _move(p, m, memory)
            if not is_there:
                continue
            for j in range(n):
                side[j] = ACTIVE if side[j] == ACTIVE else IDLE
        elif is_fresh:
            m -= 1
            side[active[m]] = BARRED  # it depends on the others, which carry its impulse
        else:
            is_fresh = True
            m = 0
            for j in range(n):
                p[j] = 0.0
                side[j] = IDLE
        chosen = _most_violated(W, origin, stride, pairs, n, q, p, m, limit, memory)
        if chosen < 0:
            _put_in_order(W, origin, stride, pairs, n, q, p, m, lift, memory)
            return True
        side[chosen] = ACTIVE
        active[m] = chosen
        m += 1
    return False


@njit
def _put_in_order(W, origin, stride, pairs, n, q, p, m, lift, memory):  # type: ignore[no-untyped-def]
    """Compute the impulses of the m active pairs in their order, unless they are in it."""
    is_in_order = True
    for i in range(1, m):
        is_in_order &= memory.active[i - 1] < memory.active[i]
    if is_in_order:
        return
    _list_active(n, memory)
    if _factorise(W, origin, stride, pairs, m, lift, memory):
        _substitute(stride, q, m, memory)
        for i in range(m):
            p[memory.active[i]] = max(memory.trial[i], 0.0)


@njit
def _attempt(W, origin, stride, pairs, n, q, p, change, noise, largest, lift, memory):  # type: ignore[no-untyped-def]
    """Solve the problem with W + lift diag W; write p and W p, and return how well p serves W."""
    result = SOLVED
    limit = max(TOLERANCE * largest, noise)
    if not _is_solved(W, origin, stride, pairs, n, q, p, limit, lift, memory):
        result = NOT_FOUND
    for i in range(n):
        change[i] = 0.0
    for j in range(n):
        if p[j] != 0.0:  # few pairs of a wide contact are pushed
            column = origin + pairs[j] * stride
            for i in range(n):
                change[i] += W[column + pairs[i]] * p[j]
    for i in range(n):
        if not change[i] + q[i] >= -max(UNSOLVABLE * largest, noise):
            result = OUT_OF_RANGE if result == SOLVED else result
    return result


@njit
def solve_among(W, origin, stride, pairs, n, q, p, change, noise, memory):  # type: ignore[no-untyped-def]
    """Find the impulses of some pairs, beginning with the side that each pair had last time.

    The impulses depend on the final set of active pairs alone, not on the way to it. A run that is
    continued from a file therefore has the same bits, unless W is singular.

    Args:
        W: symmetric positive semidefinite, with `stride` rows, column after column, flat: those of
            pairs that are pushed are read, the others need not be in the caches.
        origin: place of the first entry of W.
        stride: number of all pairs.
        pairs: the pairs in question, increasing, the first n entries.
        n: number of these pairs.
        q: q of these pairs, the first n entries.
        p: result, the impulses, the first n entries.
        change: result, W p, the first n entries.
        noise: a residual up to this size is round-off, as is all of q up to it.
        memory: see `WarmStart`, for at least `stride` pairs.

    Returns:
        SOLVED, or a key of `FAILURES`.
    """
    largest = 0.0
    for j in range(n):
        if not np.isfinite(q[j]):
            return NOT_FINITE
        largest = max(largest, abs(q[j]))
    if n == 1:
        single = W[origin + pairs[0] * (stride + 1)]
        p[0] = max(0.0, -q[0] / single)
        change[0] = single * p[0]
        return SOLVED if np.isfinite(single) else NOT_FINITE
    result = _attempt(W, origin, stride, pairs, n, q, p, change, noise, largest, 0.0, memory)
    if result != SOLVED:
        memory.members[0] = -1
        result = _attempt(W, origin, stride, pairs, n, q, p, change, noise, largest, LIFT, memory)
        memory.members[0] = -1
    if result == SOLVED:
        for j in range(n):
            memory.was_idle[pairs[j]] = p[j] == 0.0
        return SOLVED
    for i in range(n):
        for j in range(n):
            if not np.isfinite(W[origin + pairs[i] * stride + pairs[j]]):
                return NOT_FINITE
    return result


@kept
def solve_into(W, q, p, change):  # type: ignore[no-untyped-def]
    """Write the solution for all pairs into p, and W p into `change`; see `solve_among`."""
    n = q.size
    return solve_among(W.T.ravel(), 0, n, np.arange(n), n, q, p, change, 0.0, fresh(n))


def solve(W: FloatArray, q: FloatArray) -> FloatArray:
    """Return p with 0 <= p ⊥ W p + q >= 0.

    Args:
        W: symmetric positive semidefinite, shape (k, k), e.g. H M^-1 H^T [1/kg].
        q: shape (k,), in the range of W, e.g. (1 + e) times the approach velocities [m/s].

    Returns:
        p, shape (k,), e.g. impulses [N s].

    Raises:
        ArithmeticError: W or q is not finite, q is not in the range of W, or the iteration does
            not converge.
    """
    p = np.zeros(q.size)
    require_solved(solve_into(np.ascontiguousarray(W), q, p, np.zeros(q.size)))
    return p


def require_solved(result: int) -> None:
    """Raise an ArithmeticError if a result of `solve_among` is an error."""
    if result != SOLVED:
        raise ArithmeticError(f"impulses: {FAILURES[result]}")
