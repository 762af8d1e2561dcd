"""Compute the steps of a period in compiled code: step, contact law, energy ledger and record."""

from __future__ import annotations

import numpy as np

from delam_fem.caches.kernels import njit
from delam_fem.engines.compiled import banded
from delam_fem.engines.compiled import lane_kernels as lk
from delam_fem.engines.compiled import points as points
from delam_fem.engines.compiled import springs as springs
from delam_fem.engines.compiled import step as steps
from delam_fem.engines.compiled.refined import run_refined
from delam_fem.engines.compiled.simd import pointers
from delam_fem.engines.compiled.state import (
    ATTACHMENT,
    COMPLETED,
    DISSIPATED,
    DIVERGED,
    FULL,
    IS_SEEN,
    KINETIC,
    MOMENTUM,
    MOREAU,
    N_EVENTS,
    N_FRAMES,
    N_HITS,
    N_SPRINGS,
    NONE,
    SPRING,
    STRAIN,
)


@njit
def _glide(system, law, memory, log, span, touch):  # type: ignore[no-untyped-def]
    """Compute steps in lane order while all gaps are larger than `touch`, without springs.

    Returns:
        The first step whose candidate touches, which is not yet recorded, with its zᵀ C z and
        smallest gap. If no candidate touches: the step after the last one, 0 and infinity.
    """
    X, totals, weight = memory.X, memory.totals, system.scheme.weight
    first, last = span
    for step in range(first, last + 1):
        predicted = steps.look_ahead(system, law, memory)
        base_state = steps.mix_base(system, memory.base, steps.base_at(log.base_states, step))
        flow, smallest = lk.step(system, X, base_state, predicted <= touch)
        if law.kind == MOREAU:
            smallest = predicted
        elif system.is_within:
            smallest = points.see(system, memory, 0.0, touch)
        if smallest <= touch:
            return step, flow, smallest
        totals[DISSIPATED] += weight * flow
        steps.observe_into(system, X, log.u, log.v, step)
    return last + 1, 0.0, np.inf


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
            flow, smallest = steps.advance(
                system, law, memory, steps.base_at(log.base_states, step)
            )
        if step <= last:
            if smallest < floor:
                return step - 1, DIVERGED
            status = steps.end_step(system, law, memory, log, step, flow, smallest)
            if status != COMPLETED:
                return step - 1, status
            steps.observe_into(system, memory.X, log.u, log.v, step)
            step += 1
        if step > last and n_frames < log.n_frames and log.frame_steps[n_frames] == last:
            steps.keep_frame(system, memory, log, last)
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
def run_steps(coarse, middle, fine, law, memory, log, first, floor):  # type: ignore[no-untyped-def]
    """Compute the steps from `first` to the end of the period; store the energies at the end.

    The systems differ in the size of their steps; without refinement they are the same.

    Returns:
        The last completed step, and the result of the loop: COMPLETED, DIVERGED, FULL (empty the
        event buffers and call again), or a failure that contact.py defines.
    """
    bare, state, kept = pointers(fine), pointers(memory), pointers(log)
    memory.counts[IS_SEEN] = 0
    if log.refine == 1:
        ending = _run_steps(bare, law, state, kept, first, floor)
    else:
        sizes = pointers(coarse), pointers(middle)
        ending = run_refined(*sizes, bare, law, state, kept, first, floor)
    _store_energies(bare, law, state)
    return ending


@njit
def observe(system, memory, u, v):  # type: ignore[no-untyped-def]
    """Write m_b·u, c_b·u, k_b·u and the probes of u into `u`; the probes of v into `v`."""
    steps.observe_into(pointers(system), pointers(memory).X, u, v, 0)


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
