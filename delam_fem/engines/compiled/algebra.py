"""Linear algebra in compiled code, in lane order or in band order.

Band order is for systems that do not fit the lane order (simd_chains.py), for example a mass on a
spring, a bar, or laminae whose damping is not Rayleigh's: sparse rows and a banded factorisation,
scalar code without assumptions on the operators. The dofs are in reverse Cuthill–McKee order, which
keeps the band narrow.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import reverse_cuthill_mckee

from delam_fem.contact.decisions import MOREAU
from delam_fem.engines.compiled import inner_points, simd_chains as lk
from delam_fem.engines.compiled.simd_chains import R, Z, fma, lane, load, splat, store
from delam_fem.numerics.types import FloatArray, IntArray
from delam_fem.system.caches import kept, njit


class Rows(NamedTuple):
    """A sparse matrix, stored row by row.

    Attributes:
        start: index of the first entry of each row, shape (n_rows + 1,).
        column: columns of the entries, shape (n_entries,).
        value: values of the entries, shape (n_entries,).
        width: number of columns of a matrix without zeros, a multiple of eight; 0: it is sparse.
    """

    start: IntArray
    column: IntArray
    value: FloatArray
    width: int = 0


class Band(NamedTuple):
    """The factors L and U of a banded matrix, row by row; L has ones on its diagonal.

    Attributes:
        width: number of entries on each side of the diagonal.
        value: entries of L and U, shape (n, 2 width + 1); the diagonal is that of U.
    """

    width: int
    value: FloatArray


def rows(matrix: sp.spmatrix) -> Rows:
    """Return a sparse matrix as `Rows`."""
    csr = sp.csr_matrix(matrix)
    csr.sort_indices()
    return Rows(csr.indptr.astype(np.int64), csr.indices.astype(np.int64), csr.data.astype(float))


def dense_rows(matrix: sp.spmatrix) -> Rows:
    """Return a matrix as `Rows` with all its entries, also those that are zero."""
    values = np.asarray(matrix.todense(), dtype=float)
    n, width = values.shape
    return Rows(width * np.arange(n + 1), np.tile(np.arange(width), n), values.ravel(), width)


def band_order(pattern: sp.spmatrix) -> IntArray:
    """Return the place of each dof in reverse Cuthill–McKee order, shape (n,)."""
    order = reverse_cuthill_mckee(sp.csr_matrix(abs(pattern)), symmetric_mode=False)
    place = np.empty(order.size, dtype=np.int64)
    place[order] = np.arange(order.size)
    return place


def factorise(matrix: sp.spmatrix) -> Band:
    """Return the factors L U of a matrix that needs no pivoting (positive definite).

    Raises:
        ArithmeticError: a pivot is zero, so the matrix is singular.
    """
    entries = sp.coo_matrix(matrix)
    entries.sum_duplicates()
    n = entries.shape[0]
    width = int(abs(entries.row - entries.col).max(initial=0))
    value = np.zeros((n, 2 * width + 1))
    value[entries.row, entries.col - entries.row + width] = entries.data
    bad = int(_factorise(value, width))
    if bad >= 0:
        raise ArithmeticError(
            f"factorisation: the matrix is singular at row {bad} (of the reordered dofs); check "
            "that every free dof has mass"
        )
    return Band(width, value)


@kept
def _factorise(value, width):  # type: ignore[no-untyped-def]
    """Replace a band by its factors; return the row of a zero pivot, or -1."""
    n = value.shape[0]
    # entry (i, j) is at value[i, j - i + width]; row k > i loses its entry in column i
    for i in range(n):
        if value[i, width] == 0.0:
            return i
        for k in range(i + 1, min(i + width + 1, n)):
            factor = value[k, i - k + width] / value[i, width]
            value[k, i - k + width] = factor
            if factor != 0.0:
                for j in range(i + 1, min(i + width + 1, n)):
                    value[k, j - k + width] -= factor * value[i, j - i + width]
    return -1


@njit
def substitute(X, size, band, right, out):  # type: ignore[no-untyped-def]
    """Solve A x = r by the factors of a band; `right` and `out` number the fields r and x of X."""
    r = right * size
    x = out * size
    width = band.width
    value = band.value
    row = 2 * width + 1
    # L y = r downwards, then U x = y upwards, both in the place of x
    for i in range(size):
        total = X[r + i]
        for j in range(max(0, i - width), i):
            total -= value[i * row + j - i + width] * X[x + j]
        X[x + i] = total
    for i in range(size - 1, -1, -1):
        total = X[x + i]
        for j in range(i + 1, min(i + width + 1, size)):
            total -= value[i * row + j - i + width] * X[x + j]
        X[x + i] = total / value[i * row + width]


@njit(forceinline=True)
def _dense_product(value, first, X, shift, width):  # type: ignore[no-untyped-def]
    """Return the product of a dense row with a field; `width` is a multiple of eight."""
    even = splat(0.0)
    odd = splat(0.0)
    for i in range(0, width, 8):
        even = fma(load(value, first + i), load(X, shift + i), even)
        odd = fma(load(value, first + i + 4), load(X, shift + i + 4), odd)
    both = even + odd
    return (lane(both, 0) + lane(both, 1)) + (lane(both, 2) + lane(both, 3))


@njit(forceinline=True)
def add_row(matrix, row, X, shift, factor):  # type: ignore[no-untyped-def]
    """Add `factor` times a row of a matrix to the field of X that begins at `shift`."""
    first, last = matrix.start[row], matrix.start[row + 1]
    if matrix.width > 0:
        by = splat(factor)
        for i in range(0, matrix.width, 4):
            store(X, shift + i, fma(by, load(matrix.value, first + i), load(X, shift + i)))
        return
    for entry in range(first, last):
        X[shift + matrix.column[entry]] += factor * matrix.value[entry]


@njit
def row_product(matrix, row, X, shift):  # type: ignore[no-untyped-def]
    """Return the entry `row` of A x, where x is the field of X that begins at `shift`."""
    if matrix.width > 0:
        return _dense_product(matrix.value, row * matrix.width, X, shift, matrix.width)
    result = 0.0
    for entry in range(matrix.start[row], matrix.start[row + 1]):
        result += matrix.value[entry] * X[shift + matrix.column[entry]]
    return result


@njit
def absolute_product(matrix, row, X, shift):  # type: ignore[no-untyped-def]
    """Return the sum of |A_ij x_j| over j, where x is the field of X that begins at `shift`."""
    result = 0.0
    first = matrix.start[row]
    last = matrix.start[row + 1]
    for entry in range(first, last):
        result += abs(matrix.value[entry] * X[shift + matrix.column[entry]])
    return result


@njit(forceinline=True)
def both_products(matrix, row, X, size):  # type: ignore[no-untyped-def]
    """Return the entries `row` of A u and of A v, in one pass over the row of A."""
    if matrix.width > 0:
        return row_product(matrix, row, X, 0), row_product(matrix, row, X, size)
    u = v = 0.0
    for entry in range(matrix.start[row], matrix.start[row + 1]):
        value = matrix.value[entry]
        column = matrix.column[entry]
        u += value * X[column]
        v += value * X[size + column]
    return u, v


@njit
def form(matrix, n, X, shift):  # type: ignore[no-untyped-def]
    """Return xᵀ A x, where x is the field of X with n numbers that begins at `shift`."""
    result = 0.0
    for row in range(n):
        result += X[shift + row] * row_product(matrix, row, X, shift)
    return result


@njit
def solve_step(system, X):  # type: ignore[no-untyped-def]
    """Solve A z = r for the fields R and Z of X."""
    if system.is_modal:
        inner_points.solve(system, X, R, Z)
    elif system.is_chained:
        lk.substitute(X, system.size, system.solution, R, Z)
    else:
        substitute(X, system.size, system.band, R, Z)


@njit
def solve_mass(system, X):  # type: ignore[no-untyped-def]
    """Solve M z = r for the fields R and Z of X."""
    if system.is_chained:
        lk.substitute(X, system.size, system.mass_solution, R, Z)
    else:
        substitute(X, system.size, system.mass_band, R, Z)


@njit
def clear(X, size, field):  # type: ignore[no-untyped-def]
    """Set a field of X to 0."""
    for i in range(field * size, (field + 1) * size):
        X[i] = 0.0


@njit
def spread_one(system, X, pair, value):  # type: ignore[no-untyped-def]
    """Add Hᵀ λ to the field r, where λ has a value on one pair only."""
    add_row(system.gap_rows, pair, X, R * system.size, value)


@njit
def spread(system, X, pairs, values, n, sign):  # type: ignore[no-untyped-def]
    """Write sign Hᵀ λ into the field r, where λ has values on n pairs."""
    clear(X, system.size, R)
    for k in range(n):
        spread_one(system, X, pairs[k], sign * values[k])


@njit
def measure(system, X, ahead, gap, rate):  # type: ignore[no-untyped-def]
    """Write the gaps at the displacements u + ahead v, and the gap rates, of all pairs."""
    size = system.size
    H = system.gap_rows
    if system.is_chained and not system.is_within:  # opposite nodes: -1 and 1 in two columns
        for k in range(system.n_pairs):
            low = H.column[2 * k]
            high = H.column[2 * k + 1]
            v = X[size + high] - X[size + low]
            gap[k] = system.gap0[k] + (X[high] - X[low]) + ahead * v
            rate[k] = v
        return
    for k in range(system.n_pairs):
        u, v = both_products(H, k, X, size)
        gap[k] = system.gap0[k] + u + ahead * v
        rate[k] = v


@njit(forceinline=True)
def require_compliance(system, law, memory, pair):  # type: ignore[no-untyped-def]
    """Compute the column of W that belongs to a pair, unless it is known."""
    if not memory.is_known[system.coarseness * system.n_pairs + pair]:
        _find_compliance(system, law, memory, pair)


@njit
def _find_compliance(system, law, memory, pair):  # type: ignore[no-untyped-def]
    """Compute the column of W = H B⁻¹ Hᵀ that belongs to a pair.

    B is A for the θ-scheme, otherwise M. With lumped impulses only W_kk is computed.
    """
    X = memory.X
    n_pairs = system.n_pairs
    H = system.gap_rows
    W = memory.compliance
    first = (system.coarseness * n_pairs + pair) * n_pairs
    if law.is_coupled:
        clear(X, system.size, R)
        spread_one(system, X, pair, 1.0)
        if law.kind == MOREAU:
            solve_step(system, X)
        else:
            solve_mass(system, X)
        for i in range(n_pairs):
            W[first + i] = row_product(H, i, X, Z * system.size)
    else:
        single = 0.0
        for entry in range(H.start[pair], H.start[pair + 1]):
            single += H.value[entry] ** 2 * system.inverse_lumped[H.column[entry]]
        W[first + pair] = single
    memory.is_known[system.coarseness * n_pairs + pair] = 1
