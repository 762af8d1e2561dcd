"""Divide steps near contact in compiled code; the method is that of simulation/refinement.py."""

from __future__ import annotations

from delam_fem.caches.kernels import njit
from delam_fem.engines.compiled import contact, modes
from delam_fem.engines.compiled import lane_kernels as lk
from delam_fem.engines.compiled import points as points
from delam_fem.engines.compiled import springs as springs
from delam_fem.engines.compiled import step as steps
from delam_fem.engines.compiled.banded import row_product
from delam_fem.engines.compiled.state import (
    COMPLETED,
    CONTACT_DAMPED,
    DISSIPATED,
    DIVERGED,
    FULL,
    N_EVENTS,
    N_FRAMES,
    N_HITS,
    N_RESTING,
    N_SPRINGS,
)
from delam_fem.simulation.energy import add_flows
from delam_fem.simulation.refinement import SAFETY, base_within

COARSE, MIDDLE = 0, 1
"""Parts of `Memory.near`, one after the other."""
N_COARSE, N_MIDDLE, N_FINE, N_CONTACTS, N_UNFORESEEN = range(5)
"""Indices into `Memory.effort`."""


@njit
def _mark_near(system, memory, ahead, level):  # type: ignore[no-untyped-def]
    """Mark the pairs whose gap is small up to a time ahead (F1); return whether there are any."""
    if system.is_within:
        return _mark_points(system, memory, ahead, level)
    X, near, first = memory.X, memory.near, level * system.n_pairs
    has_springs = memory.counts[N_SPRINGS] > 0
    if system.is_chained and not has_springs:
        if lk.smallest_approach(X, system.size, system.rest, ahead) > 0.0:
            return False
    found = False
    for k in range(system.n_pairs):
        gap = system.gap0[k] + row_product(system.gap_rows, k, X, 0)
        shift = ahead * row_product(system.gap_rows, k, X, system.size)
        if has_springs and memory.resting[k]:
            gap, shift = -gap, -shift
        if gap + min(shift, 0.0) <= 0.0:
            near[first + k] = 1
            found = True
    return found


@njit
def _mark_points(system, memory, ahead, level):  # type: ignore[no-untyped-def]
    """Do the same as `_mark_near` for pairs inside the elements."""
    X, near, first, found = memory.X, memory.near, level * system.n_pairs, False
    n_springs = memory.counts[N_SPRINGS]
    if points.see_approach(system, memory, ahead) <= 0.0:
        for k in range(system.n_pairs):
            if memory.gap[k] <= 0.0 and not (n_springs and memory.resting[k]):
                near[first + k] = 1
                found = True
    for j in range(n_springs):
        k = memory.pairs[j]
        gap = system.gap0[k] + row_product(system.gap_rows, k, X, 0)
        if gap + max(ahead * row_product(system.gap_rows, k, X, system.size), 0.0) >= 0.0:
            near[first + k] = 1
            found = True
    return found


@njit
def _free_step(system, law, memory, new_base):  # type: ignore[no-untyped-def]
    """Compute a step without asking the law; return zᵀ C z."""
    base_state = steps.mix_base(system, memory.base, new_base)
    if system.is_chained:
        keeps = memory.counts[N_SPRINGS] > 0
        flow, _ = steps.advance_chained(system, memory.X, base_state, keeps)
    elif system.is_modal:
        flow = modes.advance(system, memory.X, base_state)
    else:
        flow, _ = steps.advance_banded(system, memory, base_state)
    if memory.counts[N_SPRINGS]:
        springs.push_springs(system, law, memory)
        return steps.loss(system, memory.X)
    return flow


@njit
def _leap(system, law, memory, new_base, level):  # type: ignore[no-untyped-def]
    """Make a step without asking the law; undo it and return False if a gap is small.

    `near` of the level tells the pairs whose gap is small.
    """
    X, base, totals = memory.X, memory.base, memory.totals
    n, reach = system.n_pairs, 0.5 * SAFETY * system.scheme.time_step
    for k in range(level * n, (level + 1) * n):
        memory.near[k] = 0
    is_near = _mark_near(system, memory, reach, level)
    if is_near and level != COARSE:
        return False
    for i in range(3 * system.size):
        memory.kept[i] = X[i]
    old_base, damped = (base[0], base[1], base[2]), totals[CONTACT_DAMPED]
    flow = _free_step(system, law, memory, new_base)
    if _mark_near(system, memory, -reach, level) or is_near:
        for i in range(3 * system.size):
            X[i] = memory.kept[i]
        base[0], base[1], base[2] = old_base
        totals[CONTACT_DAMPED] = damped
        return False
    totals[DISSIPATED] += system.scheme.weight * flow
    if memory.counts[N_RESTING]:
        steps.forget_resting(system, memory)
    return True


@njit(forceinline=True)
def _fine_step(system, law, memory, log, new_base, tick, floor):  # type: ignore[no-untyped-def]
    """Make a fine step and ask the law; return COMPLETED, DIVERGED or a failure of the law."""
    flow, smallest = steps.advance(system, law, memory, new_base)
    if smallest <= 0.0 or memory.counts[N_SPRINGS] > 0:
        if smallest < floor:
            return DIVERGED
        status = steps.apply_law(system, law, memory, log, tick, flow)
        return COMPLETED if status == contact.DONE else status
    memory.totals[DISSIPATED] += system.scheme.weight * flow
    return COMPLETED


@njit(forceinline=True)
def _account(system, memory, before, after, share):  # type: ignore[no-untyped-def]
    """Add the work of the base over a small step to `flows`."""
    seen_before = steps.see_base(system, memory)
    add_flows(memory.flows, seen_before, memory.seen, before, after, share)


@njit
def _was_unforeseen(memory, log, event):  # type: ignore[no-untyped-def]
    """Return whether the last event hit a pair that the coarse step did not see approach."""
    last = memory.counts[N_HITS]
    for j in range(last - log.event_size[event], last):
        if not memory.near[log.hit[j]]:
            return True
    return False


@njit(forceinline=True)
def _base_in(states, step, share, time_step):  # type: ignore[no-untyped-def]
    """Return (q, q', q'') of the base within a step; share 1 is its end."""
    if share == 1.0:
        return steps.base_at(states, step)
    before, after = steps.base_at(states, step - 1), steps.base_at(states, step)
    return base_within(before, after, share, time_step)


@njit
def _divide(middle, fine, law, memory, log, step, floor):  # type: ignore[no-untyped-def]
    """Make a coarse step in smaller ones; return COMPLETED, DIVERGED or a failure of the law."""
    effort, counts, r, m = memory.effort, memory.counts, log.refine, log.middle
    dt = r * fine.scheme.time_step
    before, is_first = steps.base_at(log.base_states, step - 1), True
    steps.see_base(fine, memory)
    for j in range(1, m + 1):
        after = _base_in(log.base_states, step, j / m, dt)
        if m > 1 and _leap(middle, law, memory, after, MIDDLE):
            effort[N_MIDDLE] += 1
            _account(fine, memory, before, after, 1.0 / m)
            before = after
            continue
        for tick in range((j - 1) * (r // m) + 1, j * (r // m) + 1):
            after = _base_in(log.base_states, step, tick / r, dt)
            event = counts[N_EVENTS]
            status = _fine_step(fine, law, memory, log, after, (step - 1) * r + tick, floor)
            if status != COMPLETED:
                return status
            effort[N_FINE] += 1
            if is_first and counts[N_EVENTS] > event:
                is_first = False
                effort[N_CONTACTS] += 1
                effort[N_UNFORESEEN] += _was_unforeseen(memory, log, event)
            _account(fine, memory, before, after, 1.0 / r)
            before = after
    return COMPLETED


@njit
def run_refined(coarse, middle, fine, law, memory, log, first, floor):  # type: ignore[no-untyped-def]
    """Compute steps with bare pointers, and divide those near contact; see `loop.run_steps`."""
    counts, r = memory.counts, log.refine
    for step in range(first, log.n_steps + 1):
        if counts[N_EVENTS] + r > log.n_events or counts[N_HITS] + r * fine.n_pairs > log.n_hits:
            return step - 1, FULL
        if _leap(coarse, law, memory, steps.base_at(log.base_states, step), COARSE):
            memory.effort[N_COARSE] += 1
        else:
            log.is_divided[step] = 1
            status = _divide(middle, fine, law, memory, log, step, floor)
            if status != COMPLETED:
                return step - 1, status
        steps.observe_into(fine, memory.X, log.u, log.v, step)
        n_frames = counts[N_FRAMES]
        if n_frames < log.n_frames and log.frame_steps[n_frames] == step:
            steps.keep_frame(fine, memory, log, step)
    return log.n_steps, COMPLETED
