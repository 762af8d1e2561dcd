"""Compute the steps of a period in compiled code: step, contact law, energy ledger and record."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numba import types

from delam_fem.caches.kernels import kept, njit
from delam_fem.engines.compiled import banded
from delam_fem.engines.compiled import lane_kernels as lk
from delam_fem.engines.compiled import points as points
from delam_fem.engines.compiled import springs as springs
from delam_fem.engines.compiled import step as steps
from delam_fem.engines.compiled.handle import view_at
from delam_fem.engines.compiled.refined import run_refined
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
    Log,
)
from delam_fem.engines.compiled.system import Problem


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


@njit(inline="always")
def _run_steps(system, law, memory, log, first, floor):  # type: ignore[no-untyped-def]
    """Compute steps; see `run_plain`."""
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

_problem, _log = view_at(Problem), view_at(Log)


@kept(nogil=True, what="steps of one size, for all laws and schemes, about 20 s")
def run_plain(problem_at, log_at, first, floor):  # type: ignore[no-untyped-def]
    """Compute the steps from `first` to the end of the period; store the energies at the end.

    Args:
        problem_at: address of the table of a `Problem`.
        log_at: address of the table of a `Log`.
        first: number of the first step.
        floor: gap below which the motion counts as diverged [m].

    Returns:
        The last completed step, and the result of the loop: COMPLETED, DIVERGED, FULL (empty the
        event buffers and call again), or a failure that contact.py defines.
    """
    p = _problem(problem_at)
    p.memory.counts[IS_SEEN] = 0
    ending = _run_steps(p.fine, p.law, p.memory, _log(log_at), first, floor)
    _store_energies(p.fine, p.law, p.memory)
    return ending


@kept(nogil=True, what="steps divided near contact, for all laws and schemes, about 25 s")
def run_divided(problem_at, log_at, first, floor):  # type: ignore[no-untyped-def]
    """Do the same as `run_plain` where steps near contact are divided."""
    p = _problem(problem_at)
    p.memory.counts[IS_SEEN] = 0
    ending = run_refined(p.coarse, p.middle, p.fine, p.law, p.memory, _log(log_at), first, floor)
    _store_energies(p.fine, p.law, p.memory)
    return ending


def prepared(is_divided: bool) -> Callable[[int, int, int, float], tuple[int, int]]:
    """Return `run_plain` or `run_divided`, compiled or loaded."""
    run = run_divided if is_divided else run_plain
    run.compile((types.int64, types.int64, types.int64, types.float64))
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
    p = _problem(problem_at)
    _store_energies(p.fine, p.law, p.memory)
