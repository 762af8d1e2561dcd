"""Springs of resting pairs in compiled code, and the accelerations that they cause.

A step is first computed without springs and then corrected by their forces (newmark.py, N2). If
pairs have weights w, the springs act on gaps times √w.
"""

from __future__ import annotations

from delam_fem.caches.kernels import njit
from delam_fem.engines.compiled import lane_kernels as lk
from delam_fem.engines.compiled.algebra import clear, solve_mass, solve_step, spread_one
from delam_fem.engines.compiled.banded import row_product
from delam_fem.engines.compiled.lane_kernels import R, Z
from delam_fem.engines.compiled.state import CONTACT_DAMPED, N_SPRINGS

RELATIVE_RESIDUAL = 1e-14
"""Relative residual of the conjugate gradients for spring forces; the energy ledger must close."""


@njit
def _spring_gap(system, X, k):  # type: ignore[no-untyped-def]
    """Return the gap of a pair, times the square root of its weight."""
    return system.roots[k] * (system.gap0[k] + row_product(system.gap_rows, k, X, 0))


@njit
def _spring_rate(system, X, k, shift):  # type: ignore[no-untyped-def]
    """Return H x of a pair, times the square root of its weight; x is the field at `shift`."""
    return system.roots[k] * row_product(system.gap_rows, k, X, shift)


@njit
def _spread_springs(system, memory, values, sign):  # type: ignore[no-untyped-def]
    """Write sign Hᵀ λ into the field r, where λ has values on the spring pairs."""
    clear(memory.X, system.size, R)
    for j in range(memory.counts[N_SPRINGS]):
        k = memory.pairs[j]
        spread_one(system, memory.X, k, sign * (system.roots[k] * values[j]))


@njit
def _spring_loads(system, law, memory, out):  # type: ignore[no-untyped-def]
    """Write k U + c U̇ of the spring pairs at the end of the step to `out`."""
    X = memory.X
    for j in range(memory.counts[N_SPRINGS]):
        k = memory.pairs[j]
        out[j] = law.stiffness * _spring_gap(system, X, k)
        if law.damping != 0.0:
            out[j] += law.damping * _spring_rate(system, X, k, system.size)


@njit
def _mean_spring_loads(system, law, memory, out):  # type: ignore[no-untyped-def]
    """Write k U + c U̇ of the spring pairs in the middle of the step to `out`.

    U(θ) = U⁺ - (1-θ) Δt θ H z and U̇ = θ H z, θ = 1/2.
    """
    X, scheme = memory.X, system.scheme
    by_rate = law.damping * scheme.theta - law.stiffness * scheme.p * (1.0 - scheme.theta)
    for j in range(memory.counts[N_SPRINGS]):
        k = memory.pairs[j]
        out[j] = law.stiffness * _spring_gap(system, X, k)
        out[j] += by_rate * _spring_rate(system, X, k, lk.P * system.size)


@njit
def spring_energy(system, law, memory):  # type: ignore[no-untyped-def]
    """Return the energy of the springs at the current gaps [J]."""
    total = 0.0
    if law.stiffness != 0.0:
        for j in range(memory.counts[N_SPRINGS]):
            gap = _spring_gap(system, memory.X, memory.pairs[j])
            total += gap * gap
    return 0.5 * law.stiffness * total


@njit
def _spring_forces(system, law, memory):  # type: ignore[no-untyped-def]
    """Solve (I + softness S_PP) λ = k U + c U̇ by conjugate gradients; return λ (newmark.py, N2).

    S = H A⁻¹ Hᵀ; each product with S_PP is one solve with A. In lane order λ is the mean force over
    the step.
    """
    X, n, pairs = memory.X, memory.counts[N_SPRINGS], memory.pairs
    residual, forces, direction = memory.residual, memory.forces, memory.direction
    image = memory.image
    softness = law.stiffness * system.scheme.q + law.damping * system.scheme.p
    if system.is_chained:
        _mean_spring_loads(system, law, memory, residual)
    else:
        _spring_loads(system, law, memory, residual)
    square = 0.0
    for j in range(n):
        square += residual[j] * residual[j]
        direction[j], forces[j] = residual[j], residual[j] if softness == 0.0 else 0.0
    if softness == 0.0:
        return forces
    goal = RELATIVE_RESIDUAL**2 * square
    for _ in range(2 * n):
        if square <= goal:
            break
        _spread_springs(system, memory, direction, 1.0)
        solve_step(system, X)
        curvature = 0.0
        for j in range(n):
            answer = _spring_rate(system, X, pairs[j], Z * system.size)
            image[j] = direction[j] + softness * answer
            curvature += direction[j] * image[j]
        length, previous, square = square / curvature, square, 0.0
        for j in range(n):
            forces[j] += length * direction[j]
            residual[j] -= length * image[j]
            square += residual[j] * residual[j]
        for j in range(n):
            direction[j] = residual[j] + square / previous * direction[j]
    return forces


@njit
def push_springs(system, law, memory):  # type: ignore[no-untyped-def]
    """Correct the candidate of a step by the springs.

    In lane order Δz = -Δt A⁻¹ Hᵀ λ; in band order Δa = -A⁻¹ Hᵀ λ.
    """
    X, size, scheme = memory.X, system.size, system.scheme
    forces = _spring_forces(system, law, memory)
    _spread_springs(system, memory, forces, -1.0)
    solve_step(system, X)
    to_u, to_v = scheme.d1, scheme.d2
    if system.is_chained:
        to_u, to_v = scheme.time_step * scheme.p, scheme.time_step
    for i in range(size):
        z = X[Z * size + i]
        X[i] += to_u * z
        X[size + i] += to_v * z
        X[lk.A * size + i] += z
        X[lk.P * size + i] += to_v * z
    if law.damping != 0.0:
        total = 0.0
        for j in range(memory.counts[N_SPRINGS]):
            total += _spring_rate(system, X, memory.pairs[j], lk.P * size) ** 2
        memory.totals[CONTACT_DAMPED] += system.scheme.weight * law.damping * total


@njit
def list_springs(system, memory):  # type: ignore[no-untyped-def]
    """Update the list of spring pairs from `resting`."""
    n = 0
    for k in range(system.n_pairs):
        if memory.resting[k]:
            memory.pairs[n] = k
            n += 1
    memory.counts[N_SPRINGS] = n


@njit
def renew_acceleration(system, law, memory):  # type: ignore[no-untyped-def]
    """Compute a from M a = f - C v - K u - Hᵀ λ at the current state."""
    X, size, base = memory.X, system.size, memory.base
    for i in range(size):
        load = row_product(system.stiffness, i, X, 0) + row_product(system.damping, i, X, size)
        for j in range(3):
            load += system.base[j * size + i] * base[2 - j]
        X[R * size + i] = -load
    if memory.counts[N_SPRINGS]:
        _spring_loads(system, law, memory, memory.residual)
        for j in range(memory.counts[N_SPRINGS]):
            k = memory.pairs[j]
            spread_one(system, X, k, -system.roots[k] * memory.residual[j])
    solve_mass(system, X)
    for i in range(size):
        X[lk.A * size + i] = X[Z * size + i]
