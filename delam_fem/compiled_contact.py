"""Contact in compiled code: who is hit, who rests on a spring, and what that changes.

The decisions are those of supervisor.py, their execution that of newmark.py and moreau.py, in the same
order. They happen in few steps; the code is scalar and runs over sparse rows.
"""

from __future__ import annotations

import numba
import numpy as np

from delam_fem import banded, complementarity
from delam_fem import lane_kernels as lk
from delam_fem.banded import row_product
from delam_fem.compiled_state import (
    CONTACT_DAMPED,
    IMPACT,
    IMPACTS,
    MOREAU,
    N_EVENTS,
    N_HITS,
    N_RESTING,
    N_SPRINGS,
    PENALTY,
    RELEASED,
)

R, Z = lk.R, lk.Z
DONE, NOT_FINITE, UNSOLVED = 0, -1, -2
"""How a decision ended: well, with velocities that are no numbers, with impulses not found."""
RELATIVE_RESIDUAL = 1e-14
"""Of the conjugate gradients for spring forces: round-off, since the ledger must close."""


# -- building blocks --------------------------------------------------------------------------


@numba.njit(cache=True)
def solve_step(system, X):  # type: ignore[no-untyped-def]
    """Solve A z = r."""
    if system.is_chained:
        lk.substitute(X, system.size, system.solution, R, Z)
    else:
        banded.substitute(X, system.size, system.band, R, Z)


@numba.njit(cache=True)
def solve_mass(system, X):  # type: ignore[no-untyped-def]
    """Solve M z = r."""
    if system.is_chained:
        lk.substitute(X, system.size, system.mass_solution, R, Z)
    else:
        banded.substitute(X, system.size, system.mass_band, R, Z)


@numba.njit(cache=True)
def clear(X, size, field):  # type: ignore[no-untyped-def]
    """Set a field to 0."""
    for i in range(field * size, (field + 1) * size):
        X[i] = 0.0


@numba.njit(cache=True)
def spread_one(system, X, pair, value):  # type: ignore[no-untyped-def]
    """Add Hᵀ λ to r for a value on one pair."""
    H, shift = system.gap_rows, R * system.size
    for entry in range(H.start[pair], H.start[pair + 1]):
        X[shift + H.column[entry]] += value * H.value[entry]


@numba.njit(cache=True)
def spread(system, X, pairs, values, n, sign):  # type: ignore[no-untyped-def]
    """Write r = sign Hᵀ λ for values on n pairs."""
    clear(X, system.size, R)
    for k in range(n):
        spread_one(system, X, pairs[k], sign * values[k])


@numba.njit(cache=True)
def measure(system, X, ahead, gap, rate):  # type: ignore[no-untyped-def]
    """Write the gaps of u + ahead v and the gap rates of all pairs."""
    for k in range(system.n_pairs):
        rate[k] = row_product(system.gap_rows, k, X, system.size)
        gap[k] = system.gap0[k] + row_product(system.gap_rows, k, X, 0) + ahead * rate[k]


@numba.njit(cache=True)
def compliance_block(system, law, memory, n):  # type: ignore[no-untyped-def]
    """Return W = H B⁻¹ Hᵀ of the n hit pairs, with B = A for the θ-scheme and M otherwise."""
    X, W, hit, n_pairs = memory.X, memory.compliance, memory.hit, system.n_pairs
    block = np.empty((n, n))
    for j in range(n):
        k = hit[j]
        if not memory.is_known[k]:
            clear(X, system.size, R)
            spread_one(system, X, k, 1.0)
            if law.kind == MOREAU:
                solve_step(system, X)
            else:
                solve_mass(system, X)
            for i in range(n_pairs):
                W[i * n_pairs + k] = row_product(system.gap_rows, i, X, Z * system.size)
            memory.is_known[k] = 1
        for i in range(n):
            block[i, j] = W[hit[i] * n_pairs + k]
    return block


@numba.njit(cache=True)
def renew_acceleration(system, law, memory):  # type: ignore[no-untyped-def]
    """Compute a from M a = f - C v - K u - Hᵀ λ at the present state."""
    X, size, base = memory.X, system.size, memory.base
    for i in range(size):
        load = row_product(system.stiffness, i, X, 0) + row_product(system.damping, i, X, size)
        for j in range(3):
            load += system.base[j * size + i] * base[2 - j]
        X[R * size + i] = -load
    if memory.counts[N_SPRINGS]:
        _spring_loads(system, law, memory, memory.residual)
        for j in range(memory.counts[N_SPRINGS]):
            spread_one(system, X, memory.pairs[j], -memory.residual[j])
    solve_mass(system, X)
    for i in range(size):
        X[lk.A * size + i] = X[Z * size + i]


# -- springs ----------------------------------------------------------------------------------


@numba.njit(cache=True)
def _spring_loads(system, law, memory, out):  # type: ignore[no-untyped-def]
    """Write k U + c U̇ of the spring pairs at the end of the step."""
    X = memory.X
    for j in range(memory.counts[N_SPRINGS]):
        k = memory.pairs[j]
        out[j] = law.stiffness * (system.gap0[k] + row_product(system.gap_rows, k, X, 0))
        if law.damping != 0.0:
            out[j] += law.damping * row_product(system.gap_rows, k, X, system.size)


@numba.njit(cache=True)
def _mean_spring_loads(system, law, memory, out):  # type: ignore[no-untyped-def]
    """Write k U + c U̇ of the spring pairs in the middle of the step.

    U(θ) = U⁺ - (1-θ) Δt θ H z and U̇ = θ H z, θ = 1/2.
    """
    X, scheme = memory.X, system.scheme
    by_rate = law.damping * scheme.theta - law.stiffness * scheme.p * (1.0 - scheme.theta)
    for j in range(memory.counts[N_SPRINGS]):
        k = memory.pairs[j]
        out[j] = law.stiffness * (system.gap0[k] + row_product(system.gap_rows, k, X, 0))
        out[j] += by_rate * row_product(system.gap_rows, k, X, lk.P * system.size)


@numba.njit(cache=True)
def spring_energy(system, law, memory):  # type: ignore[no-untyped-def]
    """Return the energy of the springs at the present gaps [J]."""
    total = 0.0
    if law.stiffness != 0.0:
        for j in range(memory.counts[N_SPRINGS]):
            k = memory.pairs[j]
            gap = system.gap0[k] + row_product(system.gap_rows, k, memory.X, 0)
            total += gap * gap
    return 0.5 * law.stiffness * total


@numba.njit(cache=True)
def _spring_forces(system, law, memory):  # type: ignore[no-untyped-def]
    """Return λ of (I + softness S_PP) λ = k U + c U̇ (newmark.py, N2) by conjugate gradients.

    S = H A⁻¹ Hᵀ; each product with it is one solve with A. In lane order λ is the mean over the step.
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
        spread(system, X, pairs, direction, n, 1.0)
        solve_step(system, X)
        curvature = 0.0
        for j in range(n):
            answer = row_product(system.gap_rows, pairs[j], X, Z * system.size)
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


@numba.njit(cache=True)
def push_springs(system, law, memory):  # type: ignore[no-untyped-def]
    """Correct the candidate of a step by the springs.

    Lane order: Δz = -Δt A⁻¹ Hᵀ λ; otherwise Δa = -A⁻¹ Hᵀ λ.
    """
    X, size, scheme = memory.X, system.size, system.scheme
    forces = _spring_forces(system, law, memory)
    spread(system, X, memory.pairs, forces, memory.counts[N_SPRINGS], -1.0)
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
            total += row_product(system.gap_rows, memory.pairs[j], X, lk.P * size) ** 2
        memory.totals[CONTACT_DAMPED] += system.scheme.weight * law.damping * total


@numba.njit(cache=True)
def list_springs(system, memory):  # type: ignore[no-untyped-def]
    """Bring the list of spring pairs in line with `permanent`."""
    n = 0
    for k in range(system.n_pairs):
        if memory.permanent[k]:
            memory.pairs[n] = k
            n += 1
    memory.counts[N_SPRINGS] = n


# -- decisions --------------------------------------------------------------------------------


@numba.njit(cache=True)
def _note(memory, log, step, n, energy):  # type: ignore[no-untyped-def]
    """Write an impact of n pairs into the event buffers."""
    memory.totals[IMPACT] += energy
    event, first = memory.counts[N_EVENTS], memory.counts[N_HITS]
    log.event_step[event], log.event_size[event], log.event_energy[event] = step, n, energy
    for j in range(n):
        log.hit[first + j], log.impulse[first + j] = memory.hit[j], memory.impulse[j]
        log.rate_pre[first + j], log.rate_post[first + j] = memory.rate_pre[j], memory.rate_post[j]
    memory.counts[N_EVENTS] = event + 1
    memory.counts[N_HITS] = first + n


@numba.njit(cache=True)
def _coupled_impulses(system, law, memory, n, rate_free):  # type: ignore[no-untyped-def]
    """Solve 0 <= p ⊥ (rate_free + W p) + e rate_pre >= 0 on the n hit pairs."""
    W = compliance_block(system, law, memory, n)
    q = np.empty(n)
    for j in range(n):
        q[j] = rate_free[j] + law.restitution * memory.rate_pre[j]
        if not np.isfinite(q[j]):
            return NOT_FINITE
    p = np.zeros(n)
    if not complementarity.solve_into(W, q, p):
        return UNSOLVED
    for i in range(n):
        rate = rate_free[i]
        for j in range(n):
            rate += W[i, j] * p[j]
        memory.impulse[i], memory.rate_post[i] = p[i], rate
    return DONE


@numba.njit(cache=True)
def _separate_impulses(system, law, memory, n):  # type: ignore[no-untyped-def]
    """Give each of the n hit pairs by itself the rate -e times its own (paper eq. 14)."""
    H = system.gap_rows
    for j in range(n):
        inverse_mass = 0.0
        for entry in range(H.start[memory.hit[j]], H.start[memory.hit[j] + 1]):
            inverse_mass += H.value[entry] ** 2 * system.inverse_lumped[H.column[entry]]
        rate = memory.rate_pre[j]
        memory.impulse[j] = -(1.0 + law.restitution) * rate / inverse_mass
        memory.rate_post[j] = -law.restitution * rate


@numba.njit(cache=True)
def _apply_impulses(system, law, memory, n):  # type: ignore[no-untyped-def]
    """Change the velocities by the impulses; return the change of kinetic energy [J]."""
    X, size = memory.X, system.size
    spread(system, X, memory.hit, memory.impulse, n, 1.0)
    if law.is_coupled:
        solve_mass(system, X)
    else:
        for i in range(size):
            X[Z * size + i] = system.inverse_lumped[i] * X[R * size + i]
    for i in range(size):  # mean of the velocities before and after
        X[R * size + i] = X[size + i] + 0.5 * X[Z * size + i]
    energy = 0.0
    for i in range(size):
        z = X[Z * size + i]
        if z != 0.0:
            energy += z * row_product(system.mass, i, X, R * size)
            X[size + i] += z
    return energy


@numba.njit(cache=True)
def examine_impacts(system, law, memory, log, step):  # type: ignore[no-untyped-def]
    """Release open springs, hit closed approaching pairs, rest the slow ones (supervisor.Impacts)."""
    X, permanent = memory.X, memory.permanent
    n, is_same = 0, True
    for k in range(system.n_pairs):
        gap = system.gap0[k] + row_product(system.gap_rows, k, X, 0)
        if permanent[k] and not gap <= 0.0:
            is_same = False
        memory.gap[k] = gap
        if gap <= 0.0 and not permanent[k]:
            rate = row_product(system.gap_rows, k, X, system.size)
            if rate < 0.0:
                memory.hit[n], memory.rate_pre[n] = k, rate
                n += 1
    if n == 0 and is_same:
        return DONE
    if n:
        if law.is_coupled:
            status = _coupled_impulses(system, law, memory, n, memory.rate_pre)
            if status != DONE:
                return status
        else:
            _separate_impulses(system, law, memory, n)
        _note(memory, log, step, n, _apply_impulses(system, law, memory, n))
        for j in range(n):
            is_same &= memory.rate_post[j] >= law.threshold
    if not is_same:
        memory.totals[RELEASED] -= spring_energy(system, law, memory)
        for k in range(system.n_pairs):
            if not memory.gap[k] <= 0.0:
                permanent[k] = 0
        for j in range(n):
            permanent[memory.hit[j]] = 1 if memory.rate_post[j] < law.threshold else 0
        list_springs(system, memory)
        memory.totals[RELEASED] += spring_energy(system, law, memory)
    if not system.is_chained:
        renew_acceleration(system, law, memory)
    return DONE


@numba.njit(cache=True)
def examine_penalty(system, law, memory):  # type: ignore[no-untyped-def]
    """Put springs on the closed pairs and no others (supervisor.PenaltySprings)."""
    is_same = True
    for k in range(system.n_pairs):
        memory.gap[k] = system.gap0[k] + row_product(system.gap_rows, k, memory.X, 0)
        is_same &= (memory.gap[k] <= 0.0) == (memory.permanent[k] != 0)
    if is_same:
        return
    memory.totals[RELEASED] -= spring_energy(system, law, memory)
    for k in range(system.n_pairs):
        memory.permanent[k] = 1 if memory.gap[k] <= 0.0 else 0
    list_springs(system, memory)
    memory.totals[RELEASED] += spring_energy(system, law, memory)
    if not system.is_chained:
        renew_acceleration(system, law, memory)


@numba.njit(cache=True)
def examine_moreau(system, law, memory, log, step):  # type: ignore[no-untyped-def]
    """Add the impulses of the pairs whose predicted gap is closed (supervisor.MoreauImpacts).

    `memory.gap` and `memory.rate` are those at the start of the step.
    """
    X, size = memory.X, system.size
    n, is_done = 0, True
    rate_free = memory.residual
    for k in range(system.n_pairs):
        if memory.gap[k] <= 0.0:
            rate_free[n] = row_product(system.gap_rows, k, X, size)
            memory.hit[n], memory.rate_pre[n] = k, memory.rate[k]
            is_done &= rate_free[n] + law.restitution * memory.rate[k] >= 0.0
            n += 1
    if is_done:
        return DONE
    status = _coupled_impulses(system, law, memory, n, rate_free)
    if status != DONE:
        return status
    n_pushed, energy = 0, 0.0
    for j in range(n):
        if memory.impulse[j] > 0.0:
            memory.hit[n_pushed], memory.impulse[n_pushed] = memory.hit[j], memory.impulse[j]
            memory.rate_pre[n_pushed] = memory.rate_pre[j]
            memory.rate_post[n_pushed] = memory.rate_post[j]
            n_pushed += 1
    spread(system, X, memory.hit, memory.impulse, n_pushed, 1.0)
    solve_step(system, X)
    to_u = system.scheme.p
    for i in range(size):
        z = X[Z * size + i]
        X[i] += to_u * z
        X[size + i] += z
        X[lk.P * size + i] += z
    for j in range(n_pushed):
        energy += memory.impulse[j] * 0.5 * (memory.rate_pre[j] + memory.rate_post[j])
        if memory.rate_pre[j] > -law.threshold:
            memory.permanent[memory.hit[j]] = 1
            memory.counts[N_RESTING] += 1
    if n_pushed:
        _note(memory, log, step, n_pushed, energy)
    return DONE


@numba.njit(cache=True)
def examine(system, law, memory, log, step):  # type: ignore[no-untyped-def]
    """Let the law act at the end of a step; return how it ended."""
    if law.kind == IMPACTS:
        return examine_impacts(system, law, memory, log, step)
    if law.kind == PENALTY:
        examine_penalty(system, law, memory)
    elif law.kind == MOREAU:
        return examine_moreau(system, law, memory, log, step)
    return DONE
