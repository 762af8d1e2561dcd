"""Solve with A and M, apply H and Hᵀ, and compute compliances, in lane order or in band order."""

from __future__ import annotations

import numpy as np

from delam_fem.caches.kernels import njit
from delam_fem.engines.compiled import banded, modes
from delam_fem.engines.compiled import lane_kernels as lk
from delam_fem.engines.compiled.banded import add_row, both_products, row_product
from delam_fem.engines.compiled.lane_kernels import R, Z
from delam_fem.engines.compiled.state import MOREAU


@njit
def solve_step(system, X):  # type: ignore[no-untyped-def]
    """Solve A z = r for the fields R and Z of X."""
    if system.is_modal:
        modes.solve(system, X, R, Z)
    elif system.is_chained:
        lk.substitute(X, system.size, system.solution, R, Z)
    else:
        banded.substitute(X, system.size, system.band, R, Z)


@njit
def solve_mass(system, X):  # type: ignore[no-untyped-def]
    """Solve M z = r for the fields R and Z of X."""
    if system.is_chained:
        lk.substitute(X, system.size, system.mass_solution, R, Z)
    else:
        banded.substitute(X, system.size, system.mass_band, R, Z)


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
    for k in range(system.n_pairs):
        u, v = both_products(system.gap_rows, k, X, system.size)
        gap[k], rate[k] = system.gap0[k] + u + ahead * v, v


@njit(forceinline=True)
def require_compliance(system, law, memory, pair):  # type: ignore[no-untyped-def]
    """Compute the column of W that belongs to a pair, unless it is known."""
    if not memory.is_known[system.coarseness * system.n_pairs + pair]:
        _find_compliance(system, law, memory, pair)


@njit
def _find_compliance(system, law, memory, pair):  # type: ignore[no-untyped-def]
    X, n_pairs = memory.X, system.n_pairs
    first = system.coarseness * n_pairs * n_pairs + pair
    clear(X, system.size, R)
    spread_one(system, X, pair, 1.0)
    if law.kind >= MOREAU:
        solve_step(system, X)
    else:
        solve_mass(system, X)
    for i in range(n_pairs):
        memory.compliance[first + i * n_pairs] = row_product(system.gap_rows, i, X, Z * system.size)
    memory.is_known[system.coarseness * n_pairs + pair] = 1


@njit
def compliance_block(system, law, memory, n):  # type: ignore[no-untyped-def]
    """Return W = H B⁻¹ Hᵀ of the n hit pairs, with B = A for the θ-scheme and M otherwise."""
    W, hit, n_pairs = memory.compliance, memory.hit, system.n_pairs
    first, block = system.coarseness * n_pairs * n_pairs, np.empty((n, n))
    for j in range(n):
        require_compliance(system, law, memory, hit[j])
        for i in range(n):
            block[i, j] = W[first + hit[i] * n_pairs + hit[j]]
    return block
