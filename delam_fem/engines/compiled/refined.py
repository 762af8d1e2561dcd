"""Divide steps near contact in compiled code; the method is that of simulation/refinement.py."""

from __future__ import annotations

from delam_fem.caches.kernels import njit
from delam_fem.engines.compiled import lane_kernels as lk
from delam_fem.engines.compiled import modes
from delam_fem.engines.compiled import points as points
from delam_fem.engines.compiled import step as steps
from delam_fem.engines.compiled.banded import row_product
from delam_fem.engines.compiled.state import (
    COMPLETED,
    CONTACT_DAMPED,
    DIVERGED,
    FULL,
    IS_SEEN,
    N_EVENTS,
    N_FRAMES,
    N_HITS,
    N_SPRINGS,
    SLOT,
)
from delam_fem.simulation.energy import add_flows
from delam_fem.simulation.refinement import SAFETY, base_within

COARSE, MIDDLE = 0, 1
"""Parts of `Memory.near`, one after the other."""
NEAR = 3
"""Result of a step that was undone, besides those of a loop."""
N_COARSE, N_MIDDLE, N_FINE, N_CONTACTS, N_UNFORESEEN = range(5)
"""Indices into `Memory.effort`."""


@njit
def _mark_near(system, memory, ahead, level, slow):  # type: ignore[no-untyped-def]
    """Mark the pairs whose gap is small up to a time ahead (F1).

    Return whether there is one that moves faster than `slow`.
    """
    if system.is_within:
        return _mark_points(system, memory, ahead, level, slow)
    X, near, first = memory.X, memory.near, level * system.n_pairs
    has_springs = memory.counts[N_SPRINGS] > 0
    if system.is_chained and not has_springs:
        if lk.smallest_approach(X, system.size, system.rest, ahead) > 0.0:
            return False
    found = False
    if system.is_modal:
        modes.see(system, memory)
    for k in range(system.n_pairs):
        if system.is_modal:
            gap, rate = memory.present_gap[k], memory.present_rate[k]
        else:
            gap = system.gap0[k] + row_product(system.gap_rows, k, X, 0)
            rate = row_product(system.gap_rows, k, X, system.size)
        if has_springs and memory.resting[k]:
            gap, rate = -gap, -rate
        if gap + min(ahead * rate, 0.0) <= 0.0:
            near[first + k] = 1
            found |= abs(rate) > slow
    return found


@njit
def _mark_points(system, memory, ahead, level, slow):  # type: ignore[no-untyped-def]
    """Do the same as `_mark_near` for pairs inside the elements."""
    X, near, first, found = memory.X, memory.near, level * system.n_pairs, False
    n_springs = memory.counts[N_SPRINGS]
    if points.see_approach(system, memory, ahead) <= 0.0:
        for k in range(system.n_pairs):
            if memory.present_gap[k] <= 0.0 and not (n_springs and memory.resting[k]):
                near[first + k] = 1
                found |= abs(row_product(system.gap_rows, k, X, system.size)) > slow
    for j in range(n_springs):
        k = memory.pairs[j]
        gap = system.gap0[k] + row_product(system.gap_rows, k, X, 0)
        rate = row_product(system.gap_rows, k, X, system.size)
        if gap + max(ahead * rate, 0.0) >= 0.0:
            near[first + k] = 1
            found |= abs(rate) > slow
    return found


@njit
def _leap(system, law, memory, log, new_base, level, tick):  # type: ignore[no-untyped-def]
    """Make a coarse or middle step that ends at a tick; undo it if a gap is small.

    `near` of the level tells the pairs whose gap is small.

    Returns:
        COMPLETED, NEAR if the step was undone, or a failure of the law.
    """
    X, base, totals = memory.X, memory.base, memory.totals
    n, reach = system.n_pairs, 0.5 * SAFETY * system.scheme.time_step
    for k in range(level * n, (level + 1) * n):
        memory.near[k] = 0
    is_near = _mark_near(system, memory, reach, level, log.slow)
    if is_near and level != COARSE:
        return NEAR
    for i in range(3 * system.size):
        memory.kept[i] = X[i]
    old_base, damped = (base[0], base[1], base[2]), totals[CONTACT_DAMPED]
    flow, smallest = steps.advance(system, law, memory, new_base)
    if _mark_near(system, memory, -reach, level, log.slow) or is_near:
        for i in range(3 * system.size):
            X[i] = memory.kept[i]
        memory.counts[IS_SEEN] = 0
        base[0], base[1], base[2] = old_base
        totals[CONTACT_DAMPED] = damped
        return NEAR
    return steps.end_step(system, law, memory, log, tick, flow, smallest)


@njit(inline="always")
def _fine_step(system, law, memory, log, new_base, tick, floor):  # type: ignore[no-untyped-def]
    """Make a fine step and ask the law; return COMPLETED, DIVERGED or a failure of the law."""
    flow, smallest = steps.advance(system, law, memory, new_base)
    if smallest < floor:
        return DIVERGED
    return steps.end_step(system, law, memory, log, tick, flow, smallest)


@njit(inline="always")
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


@njit(inline="always")
def _base_in(states, step, share, time_step):  # type: ignore[no-untyped-def]
    """Return (q, q', q'') of the base within a step; share 1 is its end."""
    if share == 1.0:
        return steps.base_at(states, step)
    before, after = steps.base_at(states, step - 1), steps.base_at(states, step)
    return base_within(before, after, share, time_step)


@njit(inline="always")
def _divide(middle, fine, law, memory, log, step, floor):  # type: ignore[no-untyped-def]
    """Make a coarse step in smaller ones; return COMPLETED, DIVERGED or a failure of the law."""
    effort, counts, r, m = memory.effort, memory.counts, log.refine, log.middle
    dt = r * fine.scheme.time_step
    before, is_first = steps.base_at(log.base_states, step - 1), True
    steps.see_base(fine, memory)
    for j in range(1, m + 1):
        after = _base_in(log.base_states, step, j / m, dt)
        if m > 1:
            ticks = (step - 1) * r + j * (r // m)
            status = _leap(middle, law, memory, log, after, MIDDLE, ticks)
            if status == COMPLETED:
                effort[N_MIDDLE] += 1
                _account(fine, memory, before, after, 1.0 / m)
                before = after
                continue
            if status != NEAR:
                return status
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


@njit(inline="always")
def run_refined(coarse, middle, fine, law, memory, log, first):  # type: ignore[no-untyped-def]
    """Compute steps, and divide those near contact; see `loop.run_plain`."""
    counts, r, floor = memory.counts, log.refine, -log.limit
    for step in range(first, log.n_steps + 1):
        if counts[N_EVENTS] + r > log.n_events or counts[N_HITS] + r * fine.n_pairs > log.n_hits:
            return step - 1, FULL
        new_base = steps.base_at(log.base_states, step)
        status = _leap(coarse, law, memory, log, new_base, COARSE, step * r)
        if status == COMPLETED:
            memory.effort[N_COARSE] += 1
        elif status == NEAR:
            log.is_divided[counts[SLOT] * (log.n_steps + 1) + step] = 1
            status = _divide(middle, fine, law, memory, log, step, floor)
        if status != COMPLETED:
            return step - 1, status
        steps.observe(fine, memory, log, step)
        n_frames = counts[N_FRAMES]
        if n_frames < log.n_frames and log.frame_steps[n_frames] == step:
            steps.keep_frame(fine, memory, log, step)
    return log.n_steps, COMPLETED
