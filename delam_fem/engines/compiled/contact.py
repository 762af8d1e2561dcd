"""Contact in compiled code: pairs that are hit or rest, and the springs of those that rest.

Springs of resting pairs in compiled code, and the accelerations that they cause. A step is first
computed without springs and then corrected by their forces (N2 of petsc/newmark.py). If pairs have
weights w, the springs act on gaps times √w.

The decisions are those of the laws in contact/. They are carried out as in engines/petsc, in the
same order. Only few steps have contact, so the code is scalar and runs over sparse rows.
"""

from __future__ import annotations

import numpy as np

from delam_fem.contact import complementarity
from delam_fem.contact.rules import CLOSED
from delam_fem.engines.compiled import lanes as lk
from delam_fem.engines.compiled import modes
from delam_fem.engines.compiled.algebra import (
    clear,
    compliance_block,
    require_compliance,
    row_product,
    solve_mass,
    solve_step,
    spread,
    spread_one,
)
from delam_fem.engines.compiled.lanes import R, Z
from delam_fem.engines.compiled.state import (
    COMPLETED,
    CONTACT_DAMPED,
    IMPACT,
    IMPACTS,
    IS_SEEN,
    MOREAU,
    N_EVENTS,
    N_HITS,
    N_RESTING,
    N_SPRINGS,
    PENALTY,
    RELEASED,
    SLOT,
)
from delam_fem.system.kernels import njit

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


@njit
def damp(system, law, memory, log):  # type: ignore[no-untyped-def]
    """Count what the dampers of the springs have taken in a step, in all and at each pair."""
    total, factor = 0.0, system.scheme.weight * law.damping
    for j in range(memory.counts[N_SPRINGS]):
        k = memory.pairs[j]
        square = _spring_rate(system, memory.X, k, lk.P * system.size) ** 2
        total += square
        log.damped[memory.counts[SLOT] * system.n_pairs + k] += factor * square
    memory.totals[CONTACT_DAMPED] += factor * total


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


NOT_FINITE, UNSOLVED = -complementarity.NOT_FINITE, -complementarity.NOT_FOUND
"""Failures of a law: velocities that are not finite, impulses that were not found."""


@njit
def _note(memory, log, tick, n, energy):  # type: ignore[no-untyped-def]
    """Write an impact of n pairs into the event buffers."""
    memory.totals[IMPACT] += energy
    event, first = memory.counts[N_EVENTS], memory.counts[N_HITS]
    log.event_tick[event], log.event_size[event], log.event_energy[event] = tick, n, energy
    for j in range(n):
        log.hit[first + j], log.impulse[first + j] = memory.hit[j], memory.impulse[j]
        log.rate_pre[first + j], log.rate_post[first + j] = memory.rate_pre[j], memory.rate_post[j]
    memory.counts[N_EVENTS] = event + 1
    memory.counts[N_HITS] = first + n


@njit
def _single_impulse(system, law, memory, lacking):  # type: ignore[no-untyped-def]
    """Store p = max(0, -q/W) and W p of the only hit pair; return COMPLETED or NOT_FINITE."""
    if not np.isfinite(lacking):
        return NOT_FINITE
    require_compliance(system, law, memory, memory.hit[0])
    n_pairs = system.n_pairs
    first = system.coarseness * n_pairs * n_pairs
    own = memory.compliance[first + memory.hit[0] * (n_pairs + 1)]
    memory.impulse[0] = max(0.0, -lacking / own)
    memory.change[0] = own * memory.impulse[0]
    return COMPLETED


@njit
def _coupled_impulses(system, law, memory, n, q):  # type: ignore[no-untyped-def]
    """Solve 0 <= p ⊥ W p + q >= 0 on the n hit pairs; store p and W p."""
    if n == 1:
        return _single_impulse(system, law, memory, q[0])
    lasts = system.is_touching and law.kind == MOREAU and system.coarseness == 0
    if lasts and _lasting_impulses(system, law, memory, n, q):
        return COMPLETED
    W = compliance_block(system, law, memory, n)
    right, p = np.empty(n), np.zeros(n)
    for j in range(n):
        right[j] = q[j]
        if not np.isfinite(q[j]):
            return NOT_FINITE
    if not complementarity.solve_into(W, right, p):
        return UNSOLVED
    for i in range(n):
        change = 0.0
        for j in range(n):
            change += W[i, j] * p[j]
        memory.impulse[i], memory.change[i] = p[i], change
    return COMPLETED


@njit
def _lasting_impulses(system, law, memory, n, q):  # type: ignore[no-untyped-def]
    """Solve as `_coupled_impulses`, from the last step's solution; return whether that worked.

    Where pairs are closed at rest, contact lasts for many steps and hardly changes.
    """
    n_pairs, W, hit, p = system.n_pairs, memory.compliance, memory.hit, memory.impulse
    for j in range(n):
        require_compliance(system, law, memory, hit[j])
        if not np.isfinite(q[j]):
            return False
    if not complementarity.solve_again(W, n_pairs, hit, n, q, p, memory.again):
        return False
    for i in range(n):
        change = 0.0
        for j in range(n):
            change += W[hit[i] * n_pairs + hit[j]] * p[j]
        memory.change[i] = change
    return True


@njit
def _separate_impulses(system, law, memory, n):  # type: ignore[no-untyped-def]
    """Compute impulse and gap rate after of each hit pair as if it were alone (paper eq. 14)."""
    H = system.gap_rows
    for j in range(n):
        inverse_mass = 0.0
        for entry in range(H.start[memory.hit[j]], H.start[memory.hit[j] + 1]):
            inverse_mass += H.value[entry] ** 2 * system.inverse_lumped[H.column[entry]]
        rate = memory.rate_pre[j]
        memory.impulse[j] = -(1.0 + law.restitution) * rate / inverse_mass
        memory.rate_post[j] = -law.restitution * rate


@njit
def _apply_impulses(system, law, memory, n):  # type: ignore[no-untyped-def]
    """Change the velocities by the impulses; return the change of kinetic energy [J]."""
    X, size = memory.X, system.size
    spread(system, X, memory.hit, memory.impulse, n, 1.0)
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


@njit(forceinline=True)
def _gap(system, memory, k):  # type: ignore[no-untyped-def]
    """Return the gap of a pair; `modes.measure_cells` has written it if pairs are in elements."""
    if system.is_within:
        return memory.gap[k]
    return system.gap0[k] + row_product(system.gap_rows, k, memory.X, 0)


@njit(forceinline=True)
def _rate(system, memory, k):  # type: ignore[no-untyped-def]
    """Return the gap rate of a pair; see `_gap`."""
    if system.is_within:
        return memory.rate[k]
    return row_product(system.gap_rows, k, memory.X, system.size)


@njit
def examine_impacts(system, law, memory, log, tick):  # type: ignore[no-untyped-def]
    """Release open springs, hit closed approaching pairs, rest slow pairs (`rules.Impacts`)."""
    X, resting = memory.X, memory.resting
    n, is_same = 0, True
    if system.is_within:
        modes.measure_cells(system.points, system.size, X, 0.0, False, memory.gap, memory.rate)
    for k in range(system.n_pairs):
        gap = _gap(system, memory, k)
        if resting[k] and not gap <= 0.0:
            is_same = False
        memory.gap[k] = gap
        if gap <= 0.0 and not resting[k]:
            rate = _rate(system, memory, k)
            if rate < 0.0:
                memory.hit[n], memory.rate_pre[n] = k, rate
                n += 1
    if n == 0 and is_same:
        return COMPLETED
    if n:
        if law.is_coupled:
            for j in range(n):
                memory.residual[j] = memory.rate_pre[j] + law.restitution * memory.rate_pre[j]
            status = _coupled_impulses(system, law, memory, n, memory.residual)
            if status != COMPLETED:
                return status
            for j in range(n):
                memory.rate_post[j] = memory.rate_pre[j] + memory.change[j]
        else:
            _separate_impulses(system, law, memory, n)
        _note(memory, log, tick, n, _apply_impulses(system, law, memory, n))
        for j in range(n):
            is_same &= memory.rate_post[j] >= law.threshold
    if not is_same:
        memory.totals[RELEASED] -= spring_energy(system, law, memory)
        for k in range(system.n_pairs):
            if not memory.gap[k] <= 0.0:
                resting[k] = 0
        for j in range(n):
            resting[memory.hit[j]] = 1 if memory.rate_post[j] < law.threshold else 0
        list_springs(system, memory)
        memory.totals[RELEASED] += spring_energy(system, law, memory)
    if not system.is_chained:
        renew_acceleration(system, law, memory)
    return COMPLETED


@njit
def examine_penalty(system, law, memory):  # type: ignore[no-untyped-def]
    """Put springs on exactly the closed pairs (`rules.PenaltySprings`)."""
    is_same = True
    if system.is_within:
        modes.measure_cells(
            system.points, system.size, memory.X, 0.0, False, memory.gap, memory.rate
        )
    for k in range(system.n_pairs):
        memory.gap[k] = _gap(system, memory, k)
        is_same &= (memory.gap[k] <= 0.0) == (memory.resting[k] != 0)
    if is_same:
        return
    memory.totals[RELEASED] -= spring_energy(system, law, memory)
    for k in range(system.n_pairs):
        memory.resting[k] = 1 if memory.gap[k] <= 0.0 else 0
    list_springs(system, memory)
    memory.totals[RELEASED] += spring_energy(system, law, memory)
    if not system.is_chained:
        renew_acceleration(system, law, memory)


@njit
def _push_within_step(system, law, memory, log, tick, n):  # type: ignore[no-untyped-def]
    """Add the impulses of n pairs to a θ-step; a pair with a zero impulse does not count as hit."""
    X, size = memory.X, system.size
    n_pushed, energy = 0, 0.0
    for j in range(n):
        if memory.impulse[j] > 0.0:
            memory.hit[n_pushed], memory.impulse[n_pushed] = memory.hit[j], memory.impulse[j]
            memory.rate_pre[n_pushed] = memory.rate_pre[j]
            memory.rate_post[n_pushed] = memory.rate_post[j]
            n_pushed += 1
    if n_pushed == 0:
        return
    spread(system, X, memory.hit, memory.impulse, n_pushed, 1.0)
    if system.is_modal:
        modes.push(system, X, R)
        memory.counts[IS_SEEN] = 0
    else:
        solve_step(system, X)
        for i in range(size):
            z = X[Z * size + i]
            X[i] += system.scheme.p * z
            X[size + i] += z
            X[lk.P * size + i] += z
    for j in range(n_pushed):
        energy += memory.impulse[j] * 0.5 * (memory.rate_pre[j] + memory.rate_post[j])
        if memory.rate_pre[j] > -law.threshold:
            memory.resting[memory.hit[j]] = 1
            memory.counts[N_RESTING] += 1
    _note(memory, log, tick, n_pushed, energy)


@njit
def widen_contact(system, memory):  # type: ignore[no-untyped-def]
    """Write the free gap rates; reduce the predicted gaps by the tolerance `rules.CLOSED`.

    Return the smallest gap.
    """
    fastest, smallest = 0.0, np.inf
    for k in range(system.n_pairs):
        memory.free[k] = row_product(system.gap_rows, k, memory.X, system.size)
        fastest = max(fastest, abs(memory.free[k]))
    tolerance = CLOSED * system.scheme.time_step * fastest
    for k in range(system.n_pairs):
        memory.gap[k] -= tolerance
        smallest = min(smallest, memory.gap[k])
    return smallest


@njit
def examine_moreau(system, law, memory, log, tick):  # type: ignore[no-untyped-def]
    """Add the impulses of the pairs whose predicted gap is closed (`rules.StepImpacts`).

    `memory.gap` and `memory.rate` hold the values at the start of the step, `memory.free` those of
    `widen_contact`.
    """
    n, is_done, lacking = 0, True, memory.residual
    for k in range(system.n_pairs):
        if memory.gap[k] <= 0.0:
            if system.is_touching:
                free = memory.free[k]
            else:
                free = row_product(system.gap_rows, k, memory.X, system.size)
            memory.hit[n], memory.rate_pre[n], memory.rate_post[n] = k, memory.rate[k], free
            lacking[n] = free + law.restitution * memory.rate[k]
            is_done &= lacking[n] >= 0.0
            n += 1
    if is_done:
        return COMPLETED
    status = _coupled_impulses(system, law, memory, n, lacking)
    if status == COMPLETED:
        for j in range(n):
            memory.rate_post[j] += memory.change[j]
        _push_within_step(system, law, memory, log, tick, n)
    return status


@njit(inline="always")
def examine(system, law, memory, log, tick):  # type: ignore[no-untyped-def]
    """Apply the law at the end of a step, at a tick; return COMPLETED, NOT_FINITE or UNSOLVED."""
    if law.kind == IMPACTS:
        return examine_impacts(system, law, memory, log, tick)
    if law.kind == PENALTY:
        examine_penalty(system, law, memory)
    elif law.kind == MOREAU:
        return examine_moreau(system, law, memory, log, tick)
    return COMPLETED
