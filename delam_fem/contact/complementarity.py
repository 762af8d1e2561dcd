"""Solve the linear complementarity problem of simultaneous impacts exactly.

    0 <= p,   W p + q >= 0,   p^T (W p + q) = 0

W = H M^-1 H^T is symmetric and positive semidefinite, and q lies in its range. The problem is the
optimality condition of the non-negative least-squares problem min 1/2 |L^T p + L^-1 q|^2 with
W = L L^T. Lawson and Hanson's active-set method solves it, working on W directly. A redundant pair
has no residual once the pairs that span it are active, so the method never adds it: p is then one
of several solutions, but H^T p is unique.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from delam_fem.numerics.types import FloatArray, IntArray
from delam_fem.system.kernels import kept, njit

TOLERANCE = 1e-13
"""A residual below this number times the largest |q| is round-off (for a few dozen pairs)."""

SINGULAR = 1e-13
"""A pivot below this number times the diagonal entry of W is round-off: the pair is redundant."""

CHANCES = 3
"""Exchanges of several pairs that may fail to reduce the number of pairs on the wrong side."""

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
"""The results of `solve_checked` that are errors."""


@njit
def _solve_active(W, q, active, n_active, out):  # type: ignore[no-untyped-def]
    """Solve W_AA s = -q_A by Cholesky; return False if W_AA is singular to round-off."""
    factor = np.empty((n_active, n_active))
    for i in range(n_active):
        for j in range(i + 1):
            total = W[active[i], active[j]]
            for k in range(j):
                total -= factor[i, k] * factor[j, k]
            if i == j:
                if total <= 1e-13 * W[active[i], active[i]]:
                    return False
                factor[i, i] = np.sqrt(total)
            else:
                factor[i, j] = total / factor[j, j]
    for i in range(n_active):
        total = -q[active[i]]
        for k in range(i):
            total -= factor[i, k] * out[k]
        out[i] = total / factor[i, i]
    for i in range(n_active - 1, -1, -1):
        total = out[i]
        for k in range(i + 1, n_active):
            total -= factor[k, i] * out[k]
        out[i] = total / factor[i, i]
    return True


@njit
def _solve_all(W, q, p):  # type: ignore[no-untyped-def]
    """Solve with all pairs active, the usual case; return whether no impulse is negative."""
    n = q.size
    if not _solve_active(W, q, np.arange(n), n, p):
        return False
    for k in range(n):
        if p[k] < 0.0:
            return False
    return True


@njit(forceinline=True)
def _most_violated(W, q, p, active, n_active, is_barred, limit):  # type: ignore[no-untyped-def]
    """Return the inactive pair with the smallest residual below -limit, or -1."""
    best, chosen = -limit, -1
    for k in range(q.size):
        if p[k] == 0.0 and not is_barred[k]:
            residual = q[k]
            for i in range(n_active):
                residual += W[k, active[i]] * p[active[i]]
            if residual < best:
                best, chosen = residual, k
    return chosen


@njit(forceinline=True)
def _feasible_step(p, trial, active, n_active):  # type: ignore[no-untyped-def]
    """Return the largest fraction of the way from p to trial that keeps all impulses >= 0."""
    step = 1.0
    for i in range(n_active):
        if trial[i] <= 0.0:
            old = p[active[i]]
            step = min(step, old / (old - trial[i])) if old > trial[i] else 0.0
    return step


@njit(forceinline=True)
def _drop_pulled(p, trial, active, n_active):  # type: ignore[no-untyped-def]
    """Remove the pairs whose impulse fell to zero; return how many pairs stay active."""
    kept = 0
    for i in range(n_active):
        if trial[i] <= 0.0 and p[active[i]] <= 1e-14 * abs(trial[i]):
            p[active[i]] = 0.0
        else:
            active[kept] = active[i]
            kept += 1
    return kept


@njit
def _active_set(W, q, p, limit):  # type: ignore[no-untyped-def]
    """Run Lawson and Hanson's iteration; return the number of solves, negative on failure."""
    n = q.size
    active = np.empty(n, dtype=np.int64)
    is_barred = np.zeros(n, dtype=np.bool_)
    trial = np.empty(n)
    n_active, solves = 0, 0
    p[:] = 0.0
    while solves <= 3 * n + 10:
        chosen = _most_violated(W, q, p, active, n_active, is_barred, limit)
        if chosen < 0:
            return solves
        active[n_active] = chosen
        n_active += 1
        while n_active > 0:
            solves += 1
            if not _solve_active(W, q, active, n_active, trial):
                n_active -= 1  # the new pair depends on the others: they carry its impulse
                is_barred[chosen] = True
                break
            step = _feasible_step(p, trial, active, n_active)
            for i in range(n_active):
                p[active[i]] += step * (trial[i] - p[active[i]])
            if step == 1.0:
                is_barred[:] = False
                break
            n_active = _drop_pulled(p, trial, active, n_active)
    return -solves


@kept
def solve_into(W, q, p):  # type: ignore[no-untyped-def]
    """Write the solution into p; return whether one was found (called from compiled code)."""
    if q.size == 1:
        p[0] = max(0.0, -q[0] / W[0, 0])
        return True
    if _solve_all(W, q, p):
        return True
    return _active_set(W, q, p, TOLERANCE * np.max(np.abs(q))) >= 0


@njit
def solve_checked(W, q, p, change):  # type: ignore[no-untyped-def]
    """Write the solution into p, and W p into `change`; return SOLVED, or what is wrong."""
    n, largest = q.size, 0.0
    for i in range(n):
        largest = max(largest, abs(q[i]))
        if not np.isfinite(q[i]):
            return NOT_FINITE
        for j in range(n):
            if not np.isfinite(W[i, j]):
                return NOT_FINITE
    if n and not solve_into(W, q, p):
        return NOT_FOUND
    for i in range(n):
        change[i] = 0.0
        for j in range(n):
            change[i] += W[i, j] * p[j]
        if n > 1 and change[i] + q[i] < -UNSOLVABLE * largest:
            return OUT_OF_RANGE
    return SOLVED


@kept
def _solve(W, q, p, change):  # type: ignore[no-untyped-def]
    """Do the same for Python."""
    return solve_checked(W, q, p, change)


@njit
def _factorise_among(W, stride, pairs, active, m, factor):  # type: ignore[no-untyped-def]
    """Write the Cholesky factor of W_AA, with inverse diagonal; return False if it is singular."""
    for i in range(m):
        row, first = pairs[active[i]] * stride, i * stride
        for j in range(i + 1):
            value = W[row + pairs[active[j]]]
            for k in range(j):
                value -= factor[first + k] * factor[j * stride + k]
            if i == j:
                if value <= SINGULAR * W[row + pairs[active[i]]]:
                    return False
                factor[first + i] = 1.0 / np.sqrt(value)
            else:
                factor[first + j] = value * factor[j * stride + j]
    return True


@njit
def _solve_among(stride, q, active, m, factor, trial):  # type: ignore[no-untyped-def]
    """Solve W_AA s = -q_A with the factor of W_AA."""
    for i in range(m):
        value = -q[active[i]]
        for k in range(i):
            value -= factor[i * stride + k] * trial[k]
        trial[i] = value * factor[i * stride + i]
    for i in range(m - 1, -1, -1):
        value = trial[i] * factor[i * stride + i]
        trial[i] = value
        for k in range(i):
            trial[k] -= factor[i * stride + k] * value


@njit
def _renew_factor(W, stride, pairs, active, m, factor, members):  # type: ignore[no-untyped-def]
    """Make the factor that of the active pairs, unless it is; return False if W_AA is singular."""
    is_same = members[stride] == m
    for i in range(m):
        is_same &= members[i] == pairs[active[i]]
    if is_same:
        return True
    members[stride] = -1
    if not _factorise_among(W, stride, pairs, active, m, factor):
        return False
    for i in range(m):
        members[i] = pairs[active[i]]
    members[stride] = m
    return True


@njit
def _violations(W, stride, pairs, q, n, active, m, trial, is_wrong, limit):  # type: ignore[no-untyped-def]
    """Mark the pairs that should change sides: pulled, or closing; return how many they are."""
    count, i = 0, 0
    for j in range(n):
        if i < m and active[i] == j:
            is_wrong[j] = 1 if trial[i] < 0.0 else 0
            i += 1
        else:
            row, residual = pairs[j] * stride, q[j]
            for k in range(m):
                residual += W[row + pairs[active[k]]] * trial[k]
            is_wrong[j] = 1 if residual < -limit else 0
        count += is_wrong[j]
    return count


@njit
def _exchange(n, active, m, is_wrong, only_last):  # type: ignore[no-untyped-def]
    """Let marked pairs change sides, or only the last; return the number of active pairs."""
    last = n - 1
    if only_last:
        while not is_wrong[last]:
            last -= 1
        for j in range(last):
            is_wrong[j] = 0
    i = kept = 0
    for j in range(n):  # from here on the marks are those of the pairs that are active next
        was_active = i < m and active[i] == j
        i += was_active
        is_wrong[j] = 1 if was_active != (is_wrong[j] != 0) else 0
    for j in range(n):
        if is_wrong[j]:
            active[kept] = j
            kept += 1
    return kept


class Again(NamedTuple):
    """The arrays that `solve_again` keeps from call to call, for n pairs.

    Attributes:
        was_active: pairs with an impulse in the last solution, shape (n,).
        factor: the last factor, flat, shape (n²,).
        members: the pairs of this factor; the last entry is their number, shape (n + 1,).
        active, trial, is_wrong: work space, each of shape (n,).
    """

    was_active: npt.NDArray[np.uint8]
    factor: FloatArray
    members: IntArray
    active: IntArray
    trial: FloatArray
    is_wrong: npt.NDArray[np.uint8]

    @classmethod
    def of(cls, n: int) -> Again:
        """Return the arrays for n pairs, with nothing known."""
        marks = np.zeros(n, np.uint8), np.zeros(n, np.uint8)
        numbers = np.full(n + 1, -1), np.zeros(n, np.int64)
        return cls(marks[0], np.zeros(n * n), *numbers, np.zeros(n), marks[1])


@njit
def solve_again(W, stride, pairs, n, q, p, memory):  # type: ignore[no-untyped-def]
    """Solve for some pairs, beginning with those that were active last time; return the success.

    Block principal pivoting: all pairs on the wrong side change it at once; if that does not help
    three times, only the last one does, which always ends (Murty). The impulses depend on the final
    set alone, not on the way to it, so that a run continued from a file has the same bits. If W_AA
    is singular, use `solve_into`.

    Args:
        W: symmetric positive definite, with `stride` rows and columns, flat.
        stride: number of all pairs.
        pairs: the pairs in question, increasing, the first n entries.
        n: number of these pairs.
        q: their right-hand sides, the first n entries.
        p: result, the first n entries.
        memory: see `Again`, for `stride` pairs.

    Source:
        J. J. Júdice, F. M. Pires, A block principal pivoting algorithm for large-scale strictly
        monotone linear complementarity problems, Comput. Oper. Res. 21 (1994).
    """
    active, trial, is_wrong = memory.active, memory.trial, memory.is_wrong
    largest, m, fewest, chances = 0.0, 0, n + 1, CHANCES
    for j in range(n):
        largest = max(largest, abs(q[j]))
        if memory.was_active[pairs[j]]:
            active[m] = j
            m += 1
    limit = TOLERANCE * largest
    for _ in range(3 * n + 10):
        if not _renew_factor(W, stride, pairs, active, m, memory.factor, memory.members):
            return False
        _solve_among(stride, q, active, m, memory.factor, trial)
        count = _violations(W, stride, pairs, q, n, active, m, trial, is_wrong, limit)
        if count == 0:
            for k in range(stride):
                memory.was_active[k] = 0
            for j in range(n):
                p[j] = 0.0
            for i in range(m):
                p[active[i]] = trial[i]
                memory.was_active[pairs[active[i]]] = 1
            return True
        chances = CHANCES if count < fewest else chances - 1
        fewest = min(fewest, count)
        m = _exchange(n, active, m, is_wrong, chances < 0)
    return False


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

    Source:
        C. L. Lawson, R. J. Hanson, Solving Least Squares Problems, ch. 23.
    """
    p = np.zeros(q.size)
    require_solved(_solve(W, q, p, np.zeros(q.size)))
    return p


def require_solved(result: int) -> None:
    """Raise an ArithmeticError if a result of `solve_checked` is an error."""
    if result != SOLVED:
        raise ArithmeticError(f"impulses: {FAILURES[result]}")
