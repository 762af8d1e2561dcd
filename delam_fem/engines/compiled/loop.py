"""Compute the steps of a period in compiled code: step, contact law, energy ledger and record."""

from __future__ import annotations

import numpy as np

from delam_fem.caches.kernels import njit
from delam_fem.engines.compiled import banded
from delam_fem.engines.compiled import contact as contact
from delam_fem.engines.compiled import lane_kernels as lk
from delam_fem.engines.compiled import springs as springs
from delam_fem.engines.compiled.algebra import measure
from delam_fem.engines.compiled.banded import row_product
from delam_fem.engines.compiled.simd import pointers
from delam_fem.engines.compiled.state import (
    ATTACHMENT,
    DISSIPATED,
    KINETIC,
    MOMENTUM,
    MOREAU,
    N_EVENTS,
    N_FRAMES,
    N_HITS,
    N_RESTING,
    N_SPRINGS,
    NONE,
    RECOVERY,
    SPRING,
    STRAIN,
)

COMPLETED, DIVERGED, FULL = 0, 1, 2
"""Results of the loop, besides the failures that contact.py defines."""
OPEN, HIT, RESTING = (np.int8(k) for k in range(3))
"""Contact states of a pair in a frame; see simulation/recorder.py."""


@njit
def _advance_banded(system, memory, base_state):  # type: ignore[no-untyped-def]
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
    return _loss(system, X), _smallest_gap(system, X, 0.0)


@njit
def _loss(system, X):  # type: ignore[no-untyped-def]
    """Return zᵀ C z, where z is the field P."""
    if system.is_chained:
        return lk.loss(X, system.size, system.form)
    return banded.form(system.damping, system.size, X, lk.P * system.size)


@njit
def _smallest_gap(system, X, ahead):  # type: ignore[no-untyped-def]
    """Return the smallest gap at the displacements u + ahead v."""
    if system.is_chained:
        return lk.smallest_gap(X, system.size, system.rest, ahead)
    smallest = np.inf
    for k in range(system.n_pairs):
        gap = system.gap0[k] + row_product(system.gap_rows, k, X, 0)
        if ahead != 0.0:
            gap += ahead * row_product(system.gap_rows, k, X, system.size)
        smallest = min(smallest, gap)
    return smallest


@njit
def _anticipated_gap(system, X):  # type: ignore[no-untyped-def]
    """Return the smallest U + Δt U̇⁺, where U is the gap at the start of the step."""
    smallest, scheme = np.inf, system.scheme
    for k in range(system.n_pairs):
        gap = system.gap0[k] + row_product(system.gap_rows, k, X, 0)
        gap -= scheme.p * row_product(system.gap_rows, k, X, lk.P * system.size)
        gap += scheme.time_step * row_product(system.gap_rows, k, X, system.size)
        smallest = min(smallest, gap)
    return smallest


@njit(forceinline=True)
def _look_ahead(system, law, memory):  # type: ignore[no-untyped-def]
    """Return the smallest predicted gap (theta.py, J2); store gaps and rates if one is closed.

    Return infinity for laws that look at the gaps at the end of the step.
    """
    if memory.counts[N_RESTING]:
        memory.counts[N_RESTING] = 0
        for k in range(system.n_pairs):
            memory.resting[k] = 0
    if law.kind != MOREAU:
        return np.inf
    ahead = system.scheme.gap_ahead
    smallest = _smallest_gap(system, memory.X, ahead)
    if smallest <= 0.0:
        measure(system, memory.X, ahead, memory.gap, memory.rate)
    return smallest


@njit(forceinline=True)
def _mix_base(system, base, states, step):  # type: ignore[no-untyped-def]
    """Return the base state at θ within a step, and store the base state at its end."""
    after, k = system.scheme.theta, 3 * step
    before = 1.0 - after
    q = after * states[k] + before * base[0]
    dq = after * states[k + 1] + before * base[1]
    ddq = after * states[k + 2] + before * base[2]
    base[0], base[1], base[2] = states[k], states[k + 1], states[k + 2]
    return q, dq, ddq


@njit(forceinline=True)
def _observe(system, X, u, v, row):  # type: ignore[no-untyped-def]
    """Write the recorded quantities into row `row` of u and v.

    u gets m_b·u, c_b·u, k_b·u and the probes of u; v gets the probes of v.
    """
    n = system.n_probes
    first_u, first_v = row * (3 + n), row * n
    if system.is_chained:
        lk.base_rows(system, X, u, first_u)
    else:
        for j in range(3):
            u[first_u + j] = row_product(system.base_rows, j, X, 0)
    if system.is_selecting:
        for k in range(n):
            place = system.selected[k]
            u[first_u + 3 + k], v[first_v + k] = X[place], X[system.size + place]
    else:
        for k in range(n):
            u[first_u + 3 + k] = row_product(system.probe_rows, k, X, 0)
            v[first_v + k] = row_product(system.probe_rows, k, X, system.size)


@njit
def _glide(system, law, memory, log, steps, touch):  # type: ignore[no-untyped-def]
    """Compute steps in lane order while all gaps are larger than `touch`, without springs.

    Returns:
        The first step whose candidate touches, which is not yet recorded, with its zᵀ C z and
        smallest gap. If no candidate touches: the step after the last one, 0 and infinity.
    """
    X, totals, weight = memory.X, memory.totals, system.scheme.weight
    anticipates, (first, last) = law.kind == RECOVERY, steps
    ahead = system.scheme.time_step if anticipates else 0.0
    for step in range(first, last + 1):
        predicted = _look_ahead(system, law, memory)
        base_state = _mix_base(system, memory.base, log.base_states, step)
        flow, smallest = lk.step(system, X, base_state, ahead, anticipates or predicted <= touch)
        if law.kind == MOREAU:
            smallest = predicted
        if smallest <= touch:
            return step, flow, smallest
        totals[DISSIPATED] += weight * flow
        _observe(system, X, log.u, log.v, step)
    return last + 1, 0.0, np.inf


@njit
def _advance(system, law, memory, log, step):  # type: ignore[no-untyped-def]
    """Compute one candidate, with springs if any; return zᵀ C z and the smallest gap."""
    X, predicted = memory.X, _look_ahead(system, law, memory)
    base_state = _mix_base(system, memory.base, log.base_states, step)
    if system.is_chained:
        flow, smallest = lk.step(system, X, base_state, 0.0, True)
    else:
        flow, smallest = _advance_banded(system, memory, base_state)
    if memory.counts[N_SPRINGS]:
        springs.push_springs(system, law, memory)
        return _loss(system, X), _smallest_gap(system, X, 0.0)
    if law.kind == RECOVERY:
        return flow, _anticipated_gap(system, X)
    return flow, predicted if law.kind == MOREAU else smallest


@njit
def _keep_frame(system, memory, log, step):  # type: ignore[no-untyped-def]
    """Store the whole state of a step and the contact state of each pair."""
    n, size = memory.counts[N_FRAMES], system.size
    for i in range(size):
        log.frames[2 * n * size + i] = memory.X[i]
        log.frames[(2 * n + 1) * size + i] = memory.X[size + i]
    first = n * system.n_pairs
    for k in range(system.n_pairs):
        log.contact[first + k] = RESTING if memory.resting[k] else OPEN
    event, last = memory.counts[N_EVENTS] - 1, memory.counts[N_HITS]
    if event >= 0 and log.event_step[event] == step:
        for j in range(last - log.event_size[event], last):
            if not memory.resting[log.hit[j]]:
                log.contact[first + log.hit[j]] = HIT
    memory.counts[N_FRAMES] = n + 1


@njit
def _contact(system, law, memory, log, step, flow):  # type: ignore[no-untyped-def]
    """Account for the damping of a candidate and apply the law; return the result of the law."""
    if law.kind < MOREAU:
        memory.totals[DISSIPATED] += system.scheme.weight * flow
        return contact.examine(system, law, memory, log, step)
    status = contact.examine(system, law, memory, log, step)
    memory.totals[DISSIPATED] += system.scheme.weight * _loss(system, memory.X)
    return status


@njit
def _run_steps(system, law, memory, log, first, floor):  # type: ignore[no-untyped-def]
    """Compute steps with bare pointers; see `run_steps`."""
    counts, step, touch = memory.counts, first, floor if law.kind == NONE else 0.0
    while step <= log.n_steps:
        if counts[N_EVENTS] == log.n_events or counts[N_HITS] + system.n_pairs > log.n_hits:
            return step - 1, FULL
        n_frames, last = counts[N_FRAMES], log.n_steps
        if n_frames < log.n_frames and log.frame_steps[n_frames] >= step:
            last = log.frame_steps[n_frames]
        if system.is_chained and counts[N_SPRINGS] == 0:
            step, flow, smallest = _glide(system, law, memory, log, (step, last), touch)
        else:
            flow, smallest = _advance(system, law, memory, log, step)
        if step <= last:
            if smallest <= 0.0 or counts[N_SPRINGS] > 0:
                if smallest < floor:
                    return step - 1, DIVERGED
                status = _contact(system, law, memory, log, step, flow)
                if status != contact.DONE:
                    return step - 1, status
            else:
                memory.totals[DISSIPATED] += system.scheme.weight * flow
            _observe(system, memory.X, log.u, log.v, step)
            step += 1
        if step > last and n_frames < log.n_frames and log.frame_steps[n_frames] == last:
            _keep_frame(system, memory, log, last)
    return log.n_steps, COMPLETED


@njit
def _store_energies(system, law, memory):  # type: ignore[no-untyped-def]
    X, size, stored = memory.X, system.size, memory.stored
    momentum = attachment = 0.0
    for i in range(size):
        momentum += system.base[i] * X[size + i]
        attachment += system.base[2 * size + i] * X[i]
    stored[KINETIC] = 0.5 * banded.form(system.mass, size, X, size)
    stored[STRAIN] = 0.5 * banded.form(system.stiffness, size, X, 0)
    stored[SPRING] = springs.spring_energy(system, law, memory)
    stored[MOMENTUM], stored[ATTACHMENT] = momentum, attachment


# -- called from Python -----------------------------------------------------------------------


@njit(nogil=True)
def run_steps(system, law, memory, log, first, floor):  # type: ignore[no-untyped-def]
    """Compute the steps from `first` to the end of the period; store the energies at the end.

    Returns:
        The last completed step, and the result of the loop: COMPLETED, DIVERGED, FULL (empty the
        event buffers and call again), or a failure that contact.py defines.
    """
    bare, state = pointers(system), pointers(memory)
    ending = _run_steps(bare, law, state, pointers(log), first, floor)
    _store_energies(bare, law, state)
    return ending


@njit
def observe(system, memory, u, v):  # type: ignore[no-untyped-def]
    """Write m_b·u, c_b·u, k_b·u and the probes of u into `u`; the probes of v into `v`."""
    _observe(pointers(system), pointers(memory).X, u, v, 0)


@njit
def renew(system, law, memory):  # type: ignore[no-untyped-def]
    """Compute the accelerations from the equation of motion."""
    springs.renew_acceleration(pointers(system), law, pointers(memory))


@njit
def list_springs(system, memory):  # type: ignore[no-untyped-def]
    """Update the list of spring pairs from `resting`."""
    springs.list_springs(pointers(system), pointers(memory))


@njit
def store_energies(system, law, memory):  # type: ignore[no-untyped-def]
    """Update `Memory.stored`."""
    _store_energies(pointers(system), law, pointers(memory))
