"""Single steps in compiled code: candidate, contact law, recorded quantities, frames."""

from __future__ import annotations

import numpy as np

from delam_fem.caches.kernels import njit
from delam_fem.engines.compiled import banded, modes
from delam_fem.engines.compiled import contact as contact
from delam_fem.engines.compiled import lane_kernels as lk
from delam_fem.engines.compiled import points as points
from delam_fem.engines.compiled import springs as springs
from delam_fem.engines.compiled.algebra import measure
from delam_fem.engines.compiled.banded import row_product
from delam_fem.engines.compiled.state import (
    COMPLETED,
    DISSIPATED,
    IS_SEEN,
    MOREAU,
    N_EVENTS,
    N_FRAMES,
    N_HITS,
    N_RESTING,
    N_SPRINGS,
    OLD_EVENTS,
    SLOT,
)

OPEN, HIT, RESTING = (np.int8(k) for k in range(3))
"""Contact states of a pair in a frame; see simulation/recorder.py."""


@njit
def advance_banded(system, memory, base_state):  # type: ignore[no-untyped-def]
    """Compute the candidate state in band order; return zᵀ C z and the smallest gap."""
    X, size, column, scheme = memory.X, system.size, system.base, system.scheme
    q, dq, ddq = base_state
    for i in range(size):
        v, a = X[size + i], X[lk.A * size + i]
        X[i] += scheme.time_step * v + scheme.c2 * a
        X[size + i] += scheme.c3 * a
        X[lk.Y * size + i] = X[i] + scheme.g * X[size + i]
        X[lk.P * size + i] = X[size + i] + scheme.rho * v
    for i in range(size):
        load = column[i] * ddq + column[size + i] * dq + column[2 * size + i] * q
        load += row_product(system.stiffness, i, X, lk.Y * size)
        load += row_product(system.damping, i, X, size)
        X[lk.R * size + i] = -load
    banded.substitute(X, size, system.band, lk.R, lk.A)
    for i in range(size):
        a = X[lk.A * size + i]
        X[i] += scheme.d1 * a
        X[size + i] += scheme.d2 * a
        X[lk.P * size + i] += scheme.d2 * a
    return loss(system, X), smallest_gap(system, X, 0.0)


@njit
def loss(system, X):  # type: ignore[no-untyped-def]
    """Return zᵀ C z, where z is the field P."""
    if system.is_chained:
        return lk.loss(X, system.size, system.form)
    if system.is_modal:
        return modes.loss(system, X)
    return banded.form(system.damping, system.size, X, lk.P * system.size)


@njit
def smallest_gap(system, X, ahead):  # type: ignore[no-untyped-def]
    """Return the smallest gap at the displacements u + ahead v."""
    if system.is_chained and not system.is_within:
        return lk.smallest_gap(X, system.size, system.rest, ahead)
    smallest = np.inf
    for k in range(system.n_pairs):
        gap = system.gap0[k] + row_product(system.gap_rows, k, X, 0)
        if ahead != 0.0:
            gap += ahead * row_product(system.gap_rows, k, X, system.size)
        smallest = min(smallest, gap)
    return smallest


@njit(forceinline=True)
def look_ahead(system, law, memory, is_clear):  # type: ignore[no-untyped-def]
    """Return the smallest predicted gap (theta.py, J2); store gaps and rates if one is closed.

    Return infinity for laws that look at the gaps at the end of the step, and if the state is clear
    (`refined._is_clear`): then no predicted gap is closed.
    """
    if memory.counts[N_RESTING]:
        forget_resting(system, memory)
    if law.kind != MOREAU or is_clear:
        return np.inf
    ahead = system.scheme.gap_ahead
    if system.is_modal:
        return modes.measure(system, memory, ahead)
    if system.is_within:
        return points.see(system, memory, ahead, 0.0)
    smallest = smallest_gap(system, memory.X, ahead)
    if smallest <= 0.0 or system.is_touching:
        measure(system, memory.X, ahead, memory.gap, memory.rate)
    return smallest


@njit
def forget_resting(system, memory):  # type: ignore[no-untyped-def]
    """Report no pair as resting; only for the θ-scheme, where resting pairs carry no spring."""
    memory.counts[N_RESTING] = 0
    for k in range(system.n_pairs):
        memory.resting[k] = 0


@njit(forceinline=True)
def base_at(states, step):  # type: ignore[no-untyped-def]
    """Return (q, q', q'') of the base at the end of a step."""
    k = 3 * step
    return states[k], states[k + 1], states[k + 2]


@njit(forceinline=True)
def mix_base(system, base, new):  # type: ignore[no-untyped-def]
    """Return the base state at θ within a step, and store the new base state at its end."""
    after = system.scheme.theta
    before = 1.0 - after
    q = after * new[0] + before * base[0]
    dq = after * new[1] + before * base[1]
    ddq = after * new[2] + before * base[2]
    base[0], base[1], base[2] = new
    return q, dq, ddq


@njit(forceinline=True)
def _base_rows(system, X, out, first):  # type: ignore[no-untyped-def]
    """Write m_b·u, c_b·u, k_b·u to out[first:]."""
    if system.is_chained:
        lk.base_rows(system, X, out, first)
    else:
        for j in range(3):
            out[first + j] = row_product(system.base_rows, j, X, 0)


@njit(forceinline=True)
def see_base(system, memory):  # type: ignore[no-untyped-def]
    """Write m_b·u, c_b·u, k_b·u to `seen`; return the values before."""
    seen = memory.seen
    before = seen[0], seen[1], seen[2]
    _base_rows(system, memory.X, seen, 0)
    return before


@njit(forceinline=True)
def observe(system, memory, log, step):  # type: ignore[no-untyped-def]
    """Record what `observe_into` sees at the end of a step."""
    row = memory.counts[SLOT] * (log.n_steps + 1) + step
    observe_into(system, memory.X, log.u, log.v, row)


@njit(forceinline=True)
def observe_into(system, X, u, v, row):  # type: ignore[no-untyped-def]
    """Write the recorded quantities into row `row` of u and v.

    u gets m_b·u, c_b·u, k_b·u and the probes of u; v gets the probes of v.
    """
    n = system.n_probes
    first_u, first_v = row * (3 + n), row * n
    _base_rows(system, X, u, first_u)
    if system.is_selecting:
        for k in range(n):
            place = system.selected[k]
            u[first_u + 3 + k], v[first_v + k] = X[place], X[system.size + place]
    else:
        for k in range(n):
            u[first_u + 3 + k] = row_product(system.probe_rows, k, X, 0)
            v[first_v + k] = row_product(system.probe_rows, k, X, system.size)


@njit
def advance(system, law, memory, new_base, is_clear):  # type: ignore[no-untyped-def]
    """Compute one candidate, with springs if any; return zᵀ C z and the smallest gap.

    For `is_clear` see `look_ahead`.
    """
    X, predicted = memory.X, look_ahead(system, law, memory, is_clear)
    base_state = mix_base(system, memory.base, new_base)
    if system.is_chained:
        flow, smallest = lk.step(system, X, base_state, True)
    elif system.is_modal:
        flow, smallest = modes.advance(system, X, base_state), np.inf
        memory.counts[IS_SEEN] = 0
        if law.kind != MOREAU:
            smallest = smallest_gap(system, X, 0.0)
    else:
        flow, smallest = advance_banded(system, memory, base_state)
    if memory.counts[N_SPRINGS]:
        springs.push_springs(system, law, memory)
        return loss(system, X), smallest_gap(system, X, 0.0)
    if law.kind == MOREAU:
        return flow, contact.widen_contact(system, memory) if system.is_touching else predicted
    if system.is_within:
        return flow, points.see(system, memory, 0.0, 0.0)
    return flow, smallest


@njit
def keep_frame(system, memory, log, step):  # type: ignore[no-untyped-def]
    """Store the whole state of a step and the contact state of each pair."""
    size, counts = system.size, memory.counts
    n = counts[SLOT] * log.n_frames + counts[N_FRAMES]
    for i in range(size):
        log.frames[2 * n * size + i] = memory.X[i]
        log.frames[(2 * n + 1) * size + i] = memory.X[size + i]
    first = n * system.n_pairs
    for k in range(system.n_pairs):
        log.contact[first + k] = RESTING if memory.resting[k] else OPEN
    event, last = counts[N_EVENTS] - 1, counts[N_HITS]
    while event >= counts[OLD_EVENTS] and log.event_tick[event] > (step - 1) * log.refine:
        for j in range(last - log.event_size[event], last):
            if not memory.resting[log.hit[j]]:
                log.contact[first + log.hit[j]] = HIT
        last -= log.event_size[event]
        event -= 1
    counts[N_FRAMES] += 1


@njit(inline="always")
def end_step(system, law, memory, log, tick, flow, smallest):  # type: ignore[no-untyped-def]
    """Apply the law to a candidate that touches, and account for damping.

    Args:
        system: of the step.
        law: contact law.
        memory: state.
        log: record of the period.
        tick: instant of the end of the step.
        flow: zᵀ C z of the candidate.
        smallest: its smallest gap [m].

    Returns:
        COMPLETED, or a failure of the law, see contact.py.
    """
    status = COMPLETED
    if smallest <= 0.0 or memory.counts[N_SPRINGS] > 0:
        status = contact.examine(system, law, memory, log, tick)
        if law.kind >= MOREAU:
            flow = loss(system, memory.X)
    memory.totals[DISSIPATED] += system.scheme.weight * flow
    return status
