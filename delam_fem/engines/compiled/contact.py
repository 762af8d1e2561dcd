"""Contact in compiled code: find the pairs that are hit or rest, and change the state accordingly.

The decisions are those of the laws in contact/. They are carried out as in engines/petsc, in the
same order. Only few steps have contact, so the code is scalar and runs over sparse rows.
"""

from __future__ import annotations

import numpy as np

from delam_fem.caches.kernels import njit
from delam_fem.contact import complementarity
from delam_fem.contact.moreau import CLOSED
from delam_fem.engines.compiled import lane_kernels as lk
from delam_fem.engines.compiled import modes
from delam_fem.engines.compiled.algebra import (
    compliance_block,
    require_compliance,
    solve_mass,
    solve_step,
    spread,
)
from delam_fem.engines.compiled.banded import row_product
from delam_fem.engines.compiled.lane_kernels import R, Z
from delam_fem.engines.compiled.points import measure
from delam_fem.engines.compiled.springs import list_springs, renew_acceleration, spring_energy
from delam_fem.engines.compiled.state import (
    COMPLETED,
    IMPACT,
    IMPACTS,
    IS_SEEN,
    MOREAU,
    N_EVENTS,
    N_HITS,
    N_RESTING,
    PENALTY,
    RELEASED,
)

NOT_FINITE, UNSOLVED = -1, -2
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
    if not complementarity.solve_again(W, n_pairs, hit, n, q, p, memory):
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
    """Return the gap of a pair, which `points.measure` has written if pairs are in elements."""
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
    """Release open springs, hit closed approaching pairs, rest slow pairs (newton.Impacts)."""
    X, resting = memory.X, memory.resting
    n, is_same = 0, True
    if system.is_within:
        measure(system.points, system.size, X, 0.0, False, memory.gap, memory.rate)
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
    """Put springs on exactly the closed pairs (penalty.PenaltySprings)."""
    is_same = True
    if system.is_within:
        measure(system.points, system.size, memory.X, 0.0, False, memory.gap, memory.rate)
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
    """Write the free gap rates; reduce the predicted gaps by the tolerance `moreau.CLOSED`.

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
    """Add the impulses of the pairs whose predicted gap is closed (moreau.StepImpacts).

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
