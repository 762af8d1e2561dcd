"""Contact in compiled code: pairs that are hit or rest, and the springs of those that rest.

A step is first computed without the springs of resting pairs and then corrected by their forces (N2
of petsc/newmark.py). If pairs have weights w, the springs act on gaps times √w.

The decisions are those of contact/rules.py. They are carried out as in engines/petsc, in the same
order. Only few steps have contact, so the code is scalar and runs over sparse rows.
"""

from __future__ import annotations

import numpy as np

from delam_fem.contact import complementarity
from delam_fem.contact.decisions import IMPACTS, MOREAU, NONE
from delam_fem.contact.rules import (
    CLOSED,
    OF_PLACE,
    OF_SPEED,
    closing_pairs,
    damping_of,
    needs_impulse,
    renew_resting,
    solve_impulses,
)
from delam_fem.engines.compiled import inner_points, simd_chains as lk
from delam_fem.engines.compiled.algebra import (
    absolute_product,
    clear,
    require_compliance,
    row_product,
    solve_mass,
    solve_step,
    spread,
    spread_one,
)
from delam_fem.engines.compiled.simd_chains import R, Z
from delam_fem.engines.compiled.state import (
    COMPLETED,
    CONTACT_DAMPED,
    IMPACT,
    IS_SEEN,
    N_EVENTS,
    N_HITS,
    N_RESTING,
    N_SPRINGS,
    RELEASED,
    SLOT,
)
from delam_fem.system.caches import njit

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
def _spring_loads(system, law, memory, share, less, field, out):  # type: ignore[no-untyped-def]
    """Write k U + (c `share` - `less`) H x of the spring pairs to `out`; x is a field of X."""
    X = memory.X
    for j in range(memory.counts[N_SPRINGS]):
        k = memory.pairs[j]
        out[j] = law.stiffness * _spring_gap(system, X, k)
        by_rate = damping_of(law, k) * share - less
        if by_rate != 0.0:
            out[j] += by_rate * _spring_rate(system, X, k, field * system.size)


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
    """Solve (I + D S_PP) λ = k U + c U̇ by conjugate gradients; return λ (newmark.py, N2).

    S = H A⁻¹ Hᵀ; each product with S_PP is one solve with A. D has the softness of each spring,
    k q + c p. In lane order λ is the mean force over the step.
    """
    scheme = system.scheme
    share = 1.0
    less = 0.0
    field = lk.V
    if system.is_chained:  # in the middle of the step, U(θ) = U⁺ - (1-θ) Δt θ H z, U̇ = θ H z
        share = scheme.theta
        less = law.stiffness * scheme.p * (1.0 - scheme.theta)
        field = lk.P
    _spring_loads(system, law, memory, share, less, field, memory.residual)
    if law.differ:
        _solve_unequal_springs(system, law, memory)
    else:
        _solve_equal_springs(system, law, memory)
    return memory.forces


@njit
def _solve_equal_springs(system, law, memory):  # type: ignore[no-untyped-def]
    """Solve N2 for springs of one softness, from the loads in `memory.residual`."""
    X = memory.X
    n = memory.counts[N_SPRINGS]
    pairs = memory.pairs
    residual, forces, direction = memory.residual, memory.forces, memory.direction
    image = memory.image
    scheme = system.scheme
    softness = law.stiffness * scheme.q + law.damping * scheme.p
    square = 0.0
    for j in range(n):
        square += residual[j] * residual[j]
        direction[j] = residual[j]
        forces[j] = residual[j] if softness == 0.0 else 0.0
    if softness == 0.0:
        return
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
        length = square / curvature
        previous = square
        square = 0.0
        for j in range(n):
            forces[j] += length * direction[j]
            residual[j] -= length * image[j]
            square += residual[j] * residual[j]
        for j in range(n):
            direction[j] = residual[j] + square / previous * direction[j]


@njit
def _solve_unequal_springs(system, law, memory):  # type: ignore[no-untyped-def]
    """Solve N2 for springs whose dampings differ, from the loads in `memory.residual`.

    With R = √D the matrix of (I + R S R) μ = R⁻¹ (load - D S λ₀) is symmetric, and λ = λ₀ + R μ.
    λ₀ is the load of springs without softness, which follows from no other, and 0 at the others.
    """
    X = memory.X
    n = memory.counts[N_SPRINGS]
    pairs = memory.pairs
    residual, forces, direction = memory.residual, memory.forces, memory.direction
    image, roots = memory.image, memory.softness
    scheme = system.scheme
    has_stiff = False
    for j in range(n):
        roots[j] = np.sqrt(law.stiffness * scheme.q + damping_of(law, pairs[j]) * scheme.p)
        forces[j] = residual[j] if roots[j] == 0.0 else 0.0
        has_stiff |= forces[j] != 0.0
    if has_stiff:
        _spread_springs(system, memory, forces, 1.0)
        solve_step(system, X)
    square = 0.0
    for j in range(n):
        answer = _spring_rate(system, X, pairs[j], Z * system.size) if has_stiff else 0.0
        residual[j] = residual[j] / roots[j] - roots[j] * answer if roots[j] > 0.0 else 0.0
        square += residual[j] * residual[j]
        direction[j] = residual[j]
    goal = RELATIVE_RESIDUAL**2 * square
    for _ in range(2 * n):
        if square <= goal:
            break
        for j in range(n):
            image[j] = roots[j] * direction[j]
        _spread_springs(system, memory, image, 1.0)
        solve_step(system, X)
        curvature = 0.0
        for j in range(n):
            answer = _spring_rate(system, X, pairs[j], Z * system.size)
            image[j] = direction[j] + roots[j] * answer
            curvature += direction[j] * image[j]
        length = square / curvature
        previous = square
        square = 0.0
        for j in range(n):
            forces[j] += length * (roots[j] * direction[j])
            residual[j] -= length * image[j]
            square += residual[j] * residual[j]
        for j in range(n):
            direction[j] = residual[j] + square / previous * direction[j]


@njit
def push_springs(system, law, memory):  # type: ignore[no-untyped-def]
    """Correct the candidate state of a step by the forces of the springs.

    In lane order Δz = -Δt A⁻¹ Hᵀ λ; in band order Δa = -A⁻¹ Hᵀ λ.
    """
    X = memory.X
    size = system.size
    scheme = system.scheme
    forces = _spring_forces(system, law, memory)
    _spread_springs(system, memory, forces, -1.0)
    solve_step(system, X)
    to_u, to_v = scheme.d1, scheme.d2
    if system.is_chained:
        to_u = scheme.time_step * scheme.p
        to_v = scheme.time_step
    for i in range(size):
        z = X[Z * size + i]
        X[i] += to_u * z
        X[size + i] += to_v * z
        X[lk.A * size + i] += z
        X[lk.P * size + i] += to_v * z


@njit
def damp(system, law, memory, log):  # type: ignore[no-untyped-def]
    """Count what the dampers of the springs have taken in a step, in all and at each pair."""
    total = 0.0
    factor = system.scheme.weight * (1.0 if law.differ else law.damping)
    for j in range(memory.counts[N_SPRINGS]):
        k = memory.pairs[j]
        square = _spring_rate(system, memory.X, k, lk.P * system.size) ** 2
        if law.differ:
            square *= damping_of(law, k)
        total += square
        log.damped[memory.counts[SLOT] * system.n_pairs + k] += factor * square
    memory.totals[CONTACT_DAMPED] += factor * total


@njit
def list_springs(system, memory):  # type: ignore[no-untyped-def]
    """Update the list of pairs with a spring from those at rest."""
    n = 0
    for k in range(system.n_pairs):
        if memory.pair_state.resting[k]:
            memory.pairs[n] = k
            n += 1
    memory.counts[N_SPRINGS] = n


@njit
def renew_acceleration(system, law, memory):  # type: ignore[no-untyped-def]
    """Compute a from M a = f - C v - K u - Hᵀ λ at the current state."""
    X = memory.X
    size = system.size
    base = memory.base
    for i in range(size):
        load = row_product(system.stiffness, i, X, 0) + row_product(system.damping, i, X, size)
        for j in range(3):
            load += system.base[j * size + i] * base[2 - j]
        if system.has_load:
            load -= memory.load[i]
        X[R * size + i] = -load
    if memory.counts[N_SPRINGS]:
        _spring_loads(system, law, memory, 1.0, 0.0, lk.V, memory.residual)
        for j in range(memory.counts[N_SPRINGS]):
            k = memory.pairs[j]
            spread_one(system, X, k, -system.roots[k] * memory.residual[j])
    solve_mass(system, X)
    for i in range(size):
        X[lk.A * size + i] = X[Z * size + i]


@njit
def _note(memory, log, tick, n, energy):  # type: ignore[no-untyped-def]
    """Write an impact of n pairs into the event buffers."""
    memory.totals[IMPACT] += energy
    event, first = memory.counts[N_EVENTS], memory.counts[N_HITS]
    log.event_tick[event] = tick
    log.event_size[event] = n
    log.event_energy[event] = energy
    for j in range(n):
        log.hit[first + j] = memory.hits.pair[j]
        log.impulse[first + j] = memory.hits.impulse[j]
        log.rate_pre[first + j] = memory.hits.rate_pre[j]
        log.rate_post[first + j] = memory.hits.rate_post[j]
    memory.counts[N_EVENTS] = event + 1
    memory.counts[N_HITS] = first + n


@njit
def _apply_impulses(system, law, memory, n):  # type: ignore[no-untyped-def]
    """Change the velocities by impulses between two steps; return the change of energy [J]."""
    X = memory.X
    size = system.size
    spread(system, X, memory.hits.pair, memory.hits.impulse, n, 1.0)
    if law.is_coupled:
        solve_mass(system, X)
    else:
        for i in range(size):
            X[Z * size + i] = system.inverse_lumped[i] * X[R * size + i]
    for i in range(size):  # mean of the velocities before and after the impact
        X[R * size + i] = X[size + i] + 0.5 * X[Z * size + i]
    energy = 0.0
    for i in range(size):
        z = X[Z * size + i]
        if z != 0.0:
            energy += z * row_product(system.mass, i, X, R * size)
            X[size + i] += z
    return energy


@njit
def _push_within_step(system, memory, n):  # type: ignore[no-untyped-def]
    """Add impulses to a θ-step; return the change of energy [J]."""
    X = memory.X
    size = system.size
    hits = memory.hits
    energy = 0.0
    spread(system, X, hits.pair, hits.impulse, n, 1.0)
    if system.is_modal:
        inner_points.push(system, X, R)
        memory.counts[IS_SEEN] = 0
    else:
        solve_step(system, X)
        for i in range(size):
            z = X[Z * size + i]
            X[i] += system.scheme.p * z
            X[size + i] += z
            X[lk.P * size + i] += z
    for j in range(n):
        energy += hits.impulse[j] * 0.5 * (hits.rate_pre[j] + hits.rate_post[j])
    return energy


@njit
def widen_contact(system, memory):  # type: ignore[no-untyped-def]
    """Reduce the predicted gaps by the tolerance `rules.CLOSED`; return the smallest one.

    The gap rates without impulses, which the tolerance follows from, go to `memory.free`.
    """
    fastest = 0.0
    smallest = np.inf
    for k in range(system.n_pairs):
        memory.free[k] = row_product(system.gap_rows, k, memory.X, system.size)
        fastest = max(fastest, abs(memory.free[k]))
    tolerance = CLOSED * system.scheme.time_step * fastest
    for k in range(system.n_pairs):
        memory.gap[k] -= tolerance
        smallest = min(smallest, memory.gap[k])
    return smallest


@njit
def _look(system, law, memory):  # type: ignore[no-untyped-def]
    """Write the gaps that the law examines, and the gap rates of the closed pairs.

    A step of the θ-scheme has predicted the gaps from its start, with `memory.rate`, and
    `widen_contact` has written `memory.free` if pairs touch at rest.
    """
    X = memory.X
    size = system.size
    gap = memory.gap
    H = system.gap_rows
    if law.kind == MOREAU:
        for k in range(0 if system.is_touching else system.n_pairs):
            if gap[k] <= 0.0:
                memory.free[k] = row_product(H, k, X, size)
    elif system.is_within:
        inner_points.measure_cells(system.points, size, X, 0.0, False, gap, memory.rate)
    else:
        for k in range(system.n_pairs):
            gap[k] = system.gap0[k] + row_product(H, k, X, 0)
            if gap[k] <= 0.0 and law.kind == IMPACTS and not memory.pair_state.resting[k]:
                memory.rate[k] = row_product(H, k, X, size)


@njit
def _round_off(system, memory, n):  # type: ignore[no-untyped-def]
    """Return the gap rate up to which n candidates have nothing but round-off [m/s].

    Modes of equal laminae that move together have no gap at all. What the two sides of a pair do in
    modes therefore follows from the largest entry of the row and the largest coordinates.
    """
    X = memory.X
    H = system.gap_rows
    size = system.size
    largest = 0.0
    of_place = OF_PLACE / system.scheme.time_step
    if H.width > 0:  # modes
        motion = of_place * lk.largest_of(X, 0, size) + OF_SPEED * lk.largest_of(X, size, size)
        for j in range(n):
            largest = max(largest, system.gap_largest[memory.hits.pair[j]])
        return largest * motion
    for j in range(n):
        place = absolute_product(H, memory.hits.pair[j], X, 0)
        speed = absolute_product(H, memory.hits.pair[j], X, size)
        largest = max(largest, of_place * place + OF_SPEED * speed)
    return largest


@njit
def examine(system, law, memory, log, tick):  # type: ignore[no-untyped-def]
    """Apply the law at the end of a step, at a tick, as `rules.Rules` does it.

    Returns:
        COMPLETED, or a failure: the negative result of `complementarity.solve_among`.
    """
    if law.kind == NONE:
        return COMPLETED
    _look(system, law, memory)
    n_pairs = system.n_pairs
    gap = memory.gap
    hits = memory.hits
    free = memory.free if law.kind == MOREAU else memory.rate
    n, changes = closing_pairs(law, n_pairs, gap, memory.rate, free, memory.pair_state, hits)
    noise = _round_off(system, memory, n) if n and system.is_touching else 0.0
    if not needs_impulse(hits, n, noise):
        n = 0
    if n == 0 and not changes:
        return COMPLETED
    if n:
        for j in range(n):
            require_compliance(system, law, memory, hits.pair[j])
        lasts = system.is_touching and law.kind == MOREAU and system.coarseness == 0
        if not lasts:
            # impacts are few: no pair keeps its side from one to the next. Between two steps all
            # candidates approach; within a step they are all that is closed, and few are pushed
            complementarity.forget(memory.again, hits.pair, n, law.kind == MOREAU)
        W = memory.compliance, system.coarseness * n_pairs * n_pairs, n_pairs
        n, result = solve_impulses(law, W, hits.pair, n, hits, noise, memory.again)
        if result != complementarity.SOLVED:
            return -result
    if n:
        if law.kind == MOREAU:
            energy = _push_within_step(system, memory, n)
        else:
            energy = _apply_impulses(system, law, memory, n)
        _note(memory, log, tick, n, energy)
    if renew_resting(law, n_pairs, gap, n, hits, memory.pair_state):
        if law.kind == MOREAU:
            memory.counts[N_RESTING] = 1
        else:  # the list is still that of the springs before
            memory.totals[RELEASED] -= spring_energy(system, law, memory)
            list_springs(system, memory)
            memory.totals[RELEASED] += spring_energy(system, law, memory)
    if law.kind != MOREAU and not system.is_chained:
        renew_acceleration(system, law, memory)
    return COMPLETED
