"""The steps of a period in compiled code: step, law, ledger and record without Python in between."""

from __future__ import annotations

import numba
import numpy as np

from delam_fem import banded
from delam_fem import compiled_contact as contact
from delam_fem import lane_kernels as lk
from delam_fem.banded import row_product
from delam_fem.compiled_state import (
    DISSIPATED,
    MOREAU,
    N_EVENTS,
    N_FRAMES,
    N_HITS,
    N_SPRINGS,
)

COMPLETED, DIVERGED, FULL = 0, 1, 2
"""How the loop ended, besides the failures of compiled_contact.py."""


@numba.njit(cache=True)
def _advance_chained(system, memory, q, dq, ddq):  # type: ignore[no-untyped-def]
    """Make the candidate state in lane order; return pᵀ C p and the smallest gap."""
    X, size, c, force, base = memory.X, system.size, system.coefficients, memory.force, system.base
    for i in range(force.size):
        force[i] = -(base[0, i] * ddq + base[1, i] * dq + base[2, i] * q)
    lk.predict(X, size, c)
    if system.is_diagonal_load:
        lk.eliminate_diagonal(X, size, system.load_tape, system.solution, force)
    else:
        lk.eliminate_chained(X, size, system.load_tape, system.solution, force)
    return lk.finish(X, size, c, system.solution, system.form, system.rest)


@numba.njit(cache=True)
def _advance_banded(system, memory, q, dq, ddq):  # type: ignore[no-untyped-def]
    """Make the candidate state of any system; return pᵀ C p and the smallest gap."""
    X, size, c, base = memory.X, system.size, system.coefficients, system.base
    g = system.scheme[0]
    for i in range(size):
        v, a = X[size + i], X[2 * size + i]
        X[i] += c[4 * lk.DT] * v + c[4 * lk.C2] * a
        X[size + i] += c[4 * lk.C3] * a
        X[lk.W * size + i] = X[i] + g * X[size + i]
        X[lk.P * size + i] = X[size + i] + c[4 * lk.RHO] * v
    for i in range(size):
        load = base[0, i] * ddq + base[1, i] * dq + base[2, i] * q
        load += row_product(system.stiffness, i, X, lk.W * size)
        load += row_product(system.damping, i, X, size)
        X[lk.R * size + i] = -load
    banded.substitute(X, size, system.band, lk.R, lk.A)
    for i in range(size):
        a = X[2 * size + i]
        X[i] += c[4 * lk.D1] * a
        X[size + i] += c[4 * lk.D2] * a
        X[lk.P * size + i] += c[4 * lk.D2] * a
    return _loss(system, X), _smallest_gap(system, X, 0.0)


@numba.njit(cache=True)
def _loss(system, X):  # type: ignore[no-untyped-def]
    """Return pᵀ C p of the field P."""
    if system.is_chained:
        return lk.loss(X, system.size, system.form)
    return banded.form(system.damping, X, lk.P * system.size)


@numba.njit(cache=True)
def _smallest_gap(system, X, ahead):  # type: ignore[no-untyped-def]
    """Return the smallest gap of u + ahead v."""
    if system.is_chained:
        return lk.smallest_gap(X, system.size, system.rest, ahead)
    smallest = np.inf
    for k in range(system.gap0.size):
        gap = system.gap0[k] + row_product(system.gap_rows, k, X, 0)
        if ahead != 0.0:
            gap += ahead * row_product(system.gap_rows, k, X, system.size)
        smallest = min(smallest, gap)
    return smallest


@numba.njit(cache=True)
def _look_ahead(system, memory, ahead):  # type: ignore[no-untyped-def]
    """Return the smallest predicted gap; keep gaps and rates where one is closed (J2)."""
    memory.permanent[:] = False
    smallest = _smallest_gap(system, memory.X, ahead)
    if smallest <= 0.0:
        contact.measure(system, memory.X, ahead, memory.gap, memory.rate)
    return smallest


@numba.njit(cache=True)
def _advance(system, law, memory, states, step):  # type: ignore[no-untyped-def]
    """Make the candidate state of a step, springs included; return pᵀ C p and the smallest gap."""
    theta = system.scheme[2]
    base, before = memory.base, 1.0 - theta
    q, dq, ddq = (
        theta * states[step, 0] + before * base[0],
        theta * states[step, 1] + before * base[1],
        theta * states[step, 2] + before * base[2],
    )
    for j in range(3):
        base[j] = states[step, j]
    if system.is_chained:
        flow, smallest = _advance_chained(system, memory, q, dq, ddq)
    else:
        flow, smallest = _advance_banded(system, memory, q, dq, ddq)
    if memory.counts[N_SPRINGS]:
        contact.push_springs(system, law, memory)
        return _loss(system, memory.X), _smallest_gap(system, memory.X, 0.0)
    return flow, smallest


@numba.njit(cache=True)
def observe(system, X, u, v):  # type: ignore[no-untyped-def]
    """Write m_b·u, c_b·u, k_b·u and the observed u; the observed v."""
    for j in range(3):
        u[j] = row_product(system.seen, j, X, 0)
    for k in range(system.observed.size):
        u[3 + k], v[k] = X[system.observed[k]], X[system.size + system.observed[k]]


@numba.njit(cache=True)
def _keep_frame(system, memory, log, step):  # type: ignore[no-untyped-def]
    """Keep the whole state of a step and who touches whom."""
    n, size = memory.counts[N_FRAMES], system.size
    for i in range(size):
        log.frames[n, 0, i], log.frames[n, 1, i] = memory.X[i], memory.X[size + i]
    for k in range(memory.permanent.size):
        log.contact[n, k] = 2 if memory.permanent[k] else 0
    event, last = memory.counts[N_EVENTS] - 1, memory.counts[N_HITS]
    if event >= 0 and log.event_step[event] == step:
        for j in range(last - log.event_size[event], last):
            if not memory.permanent[log.hit[j]]:
                log.contact[n, log.hit[j]] = 1
    memory.counts[N_FRAMES] = n + 1


@numba.njit(cache=True, nogil=True)
def run_steps(system, law, memory, log, first, floor):  # type: ignore[no-untyped-def]
    """Compute the steps from `first` to the end of the period.

    Returns:
        The last step done and how the loop ended: COMPLETED, DIVERGED, FULL (empty the event buffers
        and go on), or a failure of compiled_contact.py.
    """
    weight, ahead = system.scheme[1], system.scheme[3]
    is_moreau = law.kind == MOREAU
    counts, states, frame_steps = memory.counts, log.base_states, log.frame_steps
    for step in range(first, states.shape[0]):
        if counts[N_EVENTS] == log.event_step.size or (
            counts[N_HITS] + memory.hit.size > log.hit.size
        ):
            return step - 1, FULL
        predicted = _look_ahead(system, memory, ahead) if is_moreau else 0.0
        flow, smallest = _advance(system, law, memory, states, step)
        if is_moreau:
            smallest = predicted
        else:
            memory.totals[DISSIPATED] += weight * flow
        n_events = counts[N_EVENTS]
        if smallest <= 0.0 or counts[N_SPRINGS] > 0:
            if smallest < floor:
                return step - 1, DIVERGED
            status = contact.examine(system, law, memory, log, step)
            if status != contact.DONE:
                return step - 1, status
        if is_moreau:
            if counts[N_EVENTS] > n_events:
                flow = _loss(system, memory.X)
            memory.totals[DISSIPATED] += weight * flow
        observe(system, memory.X, log.u[step], log.v[step])
        n_frames = counts[N_FRAMES]
        if n_frames < frame_steps.size and frame_steps[n_frames] == step:
            _keep_frame(system, memory, log, step)
    return states.shape[0] - 1, COMPLETED


@numba.njit(cache=True)
def stored_energies(system, law, memory):  # type: ignore[no-untyped-def]
    """Return the kinetic, strain and spring energy of the free dofs [J], m·v and k·u."""
    X, size = memory.X, system.size
    momentum = attachment = 0.0
    for i in range(size):
        momentum += system.base[0, i] * X[size + i]
        attachment += system.base[2, i] * X[i]
    kinetic = 0.5 * banded.form(system.mass, X, size)
    strain = 0.5 * banded.form(system.stiffness, X, 0)
    return kinetic, strain, contact.spring_energy(system, law, memory), momentum, attachment
