"""Compute blocks of periods in compiled code: step, contact law, energy ledger and record."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numba import carray, types

from delam_fem.caches.kernels import kept, njit
from delam_fem.engines.compiled import banded
from delam_fem.engines.compiled import lane_kernels as lk
from delam_fem.engines.compiled import points as points
from delam_fem.engines.compiled import springs as springs
from delam_fem.engines.compiled import step as steps
from delam_fem.engines.compiled.handle import view_at
from delam_fem.engines.compiled.refined import run_refined
from delam_fem.engines.compiled.state import (
    COMPLETED,
    CONTACT_DAMPED,
    DISSIPATED,
    DIVERGED,
    FULL,
    IMPACT,
    IS_SEEN,
    MOREAU,
    N_EVENTS,
    N_FRAMES,
    N_HITS,
    N_SPRINGS,
    NONE,
    OLD_EVENTS,
    OLD_HITS,
    RELEASED,
    SLOT,
    Log,
)
from delam_fem.engines.compiled.system import Problem
from delam_fem.simulation.recorder import N_BASE, write_period


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
        predicted = steps.look_ahead(system, law, memory, False)
        base_state = steps.mix_base(system, memory.base, steps.base_at(log.base_states, step))
        flow, smallest = lk.step(system, X, base_state, predicted <= touch)
        if law.kind == MOREAU:
            smallest = predicted
        elif system.is_within:
            smallest = points.see(system, memory, 0.0, touch)
        if smallest <= touch:
            return step, flow, smallest
        totals[DISSIPATED] += weight * flow
        steps.observe(system, memory, log, step)
    return last + 1, 0.0, np.inf


@njit
def _plain_steps(p, log, first):  # type: ignore[no-untyped-def]
    """Compute the steps of a period from the first; see `run_plain`."""
    system, law, memory, floor = p.fine, p.law, p.memory, -log.limit
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
            new_base = steps.base_at(log.base_states, step)
            flow, smallest = steps.advance(system, law, memory, new_base, False)
        if step <= last:
            if smallest < floor:
                return step - 1, DIVERGED
            status = steps.end_step(system, law, memory, log, step, flow, smallest)
            if status != COMPLETED:
                return step - 1, status
            steps.observe(system, memory, log, step)
            step += 1
        if step > last and n_frames < log.n_frames and log.frame_steps[n_frames] == last:
            steps.keep_frame(system, memory, log, last)
    return log.n_steps, COMPLETED


@njit
def _divided_steps(p, log, first):  # type: ignore[no-untyped-def]
    """Do the same where steps near contact are divided."""
    return run_refined(p.coarse, p.middle, p.fine, p.law, p.memory, log, first)


@njit
def _store_energies(p):  # type: ignore[no-untyped-def]
    """Store the energies of the whole system, base included, in the fixed frame, and m_b·v."""
    system, memory, mass, stiffness = p.fine, p.memory, p.corner[0], p.corner[2]
    X, size, stored, q, dq = memory.X, system.size, memory.stored, memory.base[0], memory.base[1]
    momentum = attachment = 0.0
    for i in range(size):
        momentum += system.base[i] * X[size + i]
        attachment += system.base[2 * size + i] * X[i]
    kinetic = 0.5 * banded.form(system.mass, size, X, size)
    strain = 0.5 * banded.form(system.stiffness, size, X, 0)
    stored[0] = kinetic + dq * momentum + 0.5 * mass * dq * dq
    stored[1] = strain + q * attachment + 0.5 * stiffness * q * q
    stored[2] = springs.spring_energy(system, p.law, memory)
    stored[3] = momentum


@njit
def _store_level(p, log, j):  # type: ignore[no-untyped-def]
    """Write the energies stored now and lost so far as the level number j of a block."""
    _store_energies(p)
    for i in range(4):
        log.levels[6 * j + i] = p.memory.stored[i]
    log.levels[6 * j + 4] = p.memory.totals[DISSIPATED]
    log.levels[6 * j + 5] = p.memory.totals[CONTACT_DAMPED]


@njit
def _begin_period(p, log, j):  # type: ignore[no-untyped-def]
    """Set what is counted within a period to zero, and record its start."""
    memory, width, width_v = p.memory, 3 + p.fine.n_probes, p.fine.n_probes
    counts, totals, n_rows, n_pairs = memory.counts, memory.totals, log.n_steps + 1, p.fine.n_pairs
    slot, before = j % log.n_slots, (j - 1) % log.n_slots
    counts[SLOT], counts[N_FRAMES], counts[IS_SEEN] = slot, 0, 0
    counts[OLD_EVENTS], counts[OLD_HITS] = counts[N_EVENTS], counts[N_HITS]
    if j == 0:
        _store_level(p, log, 0)
        steps.observe(p.fine, memory, log, 0)
    else:
        first, last = slot * n_rows, (before + 1) * n_rows - 1
        for i in range(width):
            log.u[first * width + i] = log.u[last * width + i]
        for i in range(width_v):
            log.v[first * width_v + i] = log.v[last * width_v + i]
    totals[IMPACT] = totals[RELEASED] = 0.0
    for i in range(4):
        memory.flows[i] = 0.0
    for i in range(5):
        memory.effort[i] = 0
    for i in range(3):
        memory.base[i] = log.base_states[i]
    for k in range(n_pairs):
        log.resting[slot * n_pairs + k] = memory.resting[k]
    if log.refine > 1:
        for i in range(slot * n_rows, (slot + 1) * n_rows):
            log.is_divided[i] = 0


@njit
def _pairwise(x, first, n, least):  # type: ignore[no-untyped-def]
    """Return the sum of n numbers, smaller ones raised to the least, added in pairs of halves."""
    if n > 128:
        half = n // 16 * 8
        return _pairwise(x, first, half, least) + _pairwise(x, first + half, n - half, least)
    total, whole = 0.0, n // 8 * 8
    if whole:
        r = np.zeros(8)
        for i in range(whole):
            value = x[first + i]
            r[i % 8] += least if value < least else value
        total = ((r[0] + r[1]) + (r[2] + r[3])) + ((r[4] + r[5]) + (r[6] + r[7]))
    for i in range(first + whole, first + n):
        total += least if x[i] < least else x[i]
    return total


@njit
def _sum(x, first, n, least):  # type: ignore[no-untyped-def]
    """Return the sum as NumPy forms it, bit for bit, so that both engines count impacts alike."""
    total = 0.0
    for start in range(0, n, 8192):  # the size of NumPy's buffers
        total += _pairwise(x, first + start, min(n - start, 8192), least)
    return total


@njit
def _end_period(p, log, first_period, j, n_steps):  # type: ignore[no-untyped-def]
    """Write the rows of a period; return whether the motion stayed within bounds."""
    memory, counts, k, slot = p.memory, p.memory.counts, first_period + j, p.memory.counts[SLOT]
    n_rows, width = log.n_steps + 1, p.fine.n_probes
    _store_level(p, log, j + 1)
    ends = n_steps, counts[N_EVENTS], counts[N_HITS]
    for i in range(3):
        log.ends[3 * j + i] = ends[i]
    for i in range(5):
        log.effort[5 * k + i] = memory.effort[i]
    if log.refine == 1:
        log.effort[5 * k] = n_steps
    n_events, n_hits = counts[N_EVENTS] - counts[OLD_EVENTS], counts[N_HITS] - counts[OLD_HITS]
    log.impulses[3 * k] = _sum(log.impulse, counts[OLD_HITS], n_hits, -np.inf)
    log.impulses[3 * k + 1] = n_hits
    log.impulses[3 * k + 2] = _sum(log.event_energy, counts[OLD_EVENTS], n_events, 0.0)
    u = carray(log.u, (log.n_slots, n_rows, N_BASE + width))[slot, : n_steps + 1]
    v = carray(log.v, (log.n_slots, n_rows, width))[slot, : n_steps + 1]
    base_states = carray(log.base_states, (n_rows, 3))
    is_divided = carray(log.is_divided, (log.n_slots, n_rows))[slot]
    coupling, flows = carray(log.coupling, (4,)), carray(memory.flows, (4,))
    rows = (
        carray(log.strobe, (k + 1, 2, log.n_probes))[k],
        carray(log.envelope, (k + 1, 2, log.n_probes))[k],
        carray(log.ledger, (k + 1, 10))[k],
    )
    gained = memory.totals[IMPACT], memory.totals[RELEASED]
    of_base = base_states, coupling, log.time_step, is_divided, flows
    levels = carray(log.levels, (j + 2, 6))[j:]
    return write_period(u, v, levels, of_base, gained, rows, log.limit)


def _block_of(run_steps: Any) -> Any:
    """Return the function that computes a block; see `run_plain`.

    Args:
        run_steps: `_plain_steps` or `_divided_steps`.
    """

    @njit
    def run_block(p, log, first_period, begin, n_periods):  # type: ignore[no-untyped-def]
        first, step = begin
        for j in range(first, n_periods):
            if step == 0:
                _begin_period(p, log, j)
            step, ending = run_steps(p, log, step + 1)
            if ending == FULL or ending < 0:
                return j, step, ending
            if not _end_period(p, log, first_period, j, step) or ending == DIVERGED:
                return j + 1, 0, DIVERGED
            step = 0
        return n_periods, 0, COMPLETED

    return run_block


# -- called from Python -----------------------------------------------------------------------

_problem, _log = view_at(Problem), view_at(Log)
_plain_block, _divided_block = _block_of(_plain_steps), _block_of(_divided_steps)


@kept(nogil=True, what="steps of one size, for all laws and schemes, about 20 s")
def run_plain(problem_at, log_at, first_period, begin, n_periods):  # type: ignore[no-untyped-def]
    """Compute a block of periods; write their records and rows.

    Args:
        problem_at: address of the table of a `Problem`.
        log_at: address of the table of a `Log`.
        first_period: number of the first period of the block.
        begin: place in the block to go on from: number of periods and of steps that are done.
        n_periods: number of periods of the block.

    Returns:
        Number of finished periods, of steps of the next, and the result of the loop: COMPLETED,
        DIVERGED (in the last of these periods), FULL (enlarge the event buffers and call again), or
        a failure that contact.py defines.
    """
    return _plain_block(_problem(problem_at), _log(log_at), first_period, begin, n_periods)


@kept(nogil=True, what="steps divided near contact, for all laws and schemes, about 25 s")
def run_divided(problem_at, log_at, first_period, begin, n_periods):  # type: ignore[no-untyped-def]
    """Do the same as `run_plain` where steps near contact are divided."""
    return _divided_block(_problem(problem_at), _log(log_at), first_period, begin, n_periods)


def prepared(is_divided: bool) -> Callable[..., tuple[int, int, int]]:
    """Return `run_plain` or `run_divided`, compiled or loaded."""
    run, number = run_divided if is_divided else run_plain, types.int64
    run.compile((number, number, number, types.UniTuple(number, 2), number))
    return run  # type: ignore[no-any-return]


@kept
def observe(problem_at):  # type: ignore[no-untyped-def]
    """Write m_b·u, c_b·u, k_b·u and the probes into `Memory.seen_u` and `seen_v`."""
    p = _problem(problem_at)
    steps.observe_into(p.fine, p.memory.X, p.memory.seen_u, p.memory.seen_v, 0)


@kept
def renew(problem_at):  # type: ignore[no-untyped-def]
    """Compute the accelerations from the equation of motion."""
    p = _problem(problem_at)
    springs.renew_acceleration(p.fine, p.law, p.memory)


@kept
def list_springs(problem_at):  # type: ignore[no-untyped-def]
    """Update the list of spring pairs from `resting`."""
    p = _problem(problem_at)
    springs.list_springs(p.fine, p.memory)


@kept
def store_energies(problem_at):  # type: ignore[no-untyped-def]
    """Update `Memory.stored`."""
    _store_energies(_problem(problem_at))
