"""Divide steps near contact in compiled code; the method is that of simulation/refinement.py."""

from __future__ import annotations

from delam_fem.caches.kernels import njit
from delam_fem.engines.compiled import lane_kernels as lk
from delam_fem.engines.compiled import modes
from delam_fem.engines.compiled import points as points
from delam_fem.engines.compiled import step as steps
from delam_fem.engines.compiled.banded import both_products, row_product
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
"""Sizes of steps that may be undone."""
NEAR = 3
"""Result of a step that was undone, besides those of a loop."""
N_COARSE, N_MIDDLE, N_FINE, N_CONTACTS, N_UNFORESEEN = range(5)
"""Indices into `Memory.effort`."""


@njit
def _is_clear(system, memory, reach):  # type: ignore[no-untyped-def]
    """Return whether surely no gap is small up to a time ahead or back (F1).

    One pass over the state after a step answers for this step and for the next. Where gaps take
    longer to see, or pairs rest on springs or touch at rest, the answer is no.
    """
    if not system.is_chained or system.is_within or system.is_touching:
        return False
    if memory.counts[N_SPRINGS] > 0:
        return False
    return lk.smallest_margin(memory.X, system.size, system.rest, reach) > 0.0


@njit
def _mark_near(system, memory, ahead, level, slow):  # type: ignore[no-untyped-def]
    """Return whether a pair faster than `slow` has a small gap up to a time ahead (F1).

    For a coarse step mark the pairs with a small gap.
    """
    if system.is_within:
        return _mark_points(system, memory, ahead, level, slow)
    X, has_springs = memory.X, memory.counts[N_SPRINGS] > 0
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
            gap, rate = both_products(system.gap_rows, k, X, system.size)
            gap = system.gap0[k] + gap
        if has_springs and memory.resting[k]:
            gap, rate = -gap, -rate
        if gap + min(ahead * rate, 0.0) <= 0.0:
            found |= abs(rate) > slow
            if level == COARSE:
                memory.near[k] = 1
            elif found:
                return True
    return found


@njit
def _mark_points(system, memory, ahead, level, slow):  # type: ignore[no-untyped-def]
    """Do the same as `_mark_near` for pairs inside the elements."""
    X, found = memory.X, False
    n_springs = memory.counts[N_SPRINGS]
    if points.see_approach(system, memory, ahead) <= 0.0:
        for k in range(system.n_pairs):
            if memory.present_gap[k] <= 0.0 and not (n_springs and memory.resting[k]):
                found |= abs(row_product(system.gap_rows, k, X, system.size)) > slow
                if level == COARSE:
                    memory.near[k] = 1
                elif found:
                    return True
    for j in range(n_springs):
        k = memory.pairs[j]
        gap, rate = both_products(system.gap_rows, k, X, system.size)
        if system.gap0[k] + gap + max(ahead * rate, 0.0) >= 0.0:
            found |= abs(rate) > slow
            if level == COARSE:
                memory.near[k] = 1
    return found


@njit
def _leap(system, law, memory, log, new_base, level, tick, was_clear):  # type: ignore[no-untyped-def]
    """Make a coarse or middle step that ends at a tick; undo it if a gap is small.

    `near` tells the pairs whose gap is small in a coarse step. `was_clear` tells whether the state
    is known to be clear (`_is_clear`) for steps of this size.

    Returns:
        COMPLETED, NEAR if the step was undone, or a failure of the law; whether the new state is
        clear.
    """
    X, base, totals = memory.X, memory.base, memory.totals
    reach, is_near = 0.5 * SAFETY * system.scheme.time_step, False
    for k in range(system.n_pairs if level == COARSE else 0):
        memory.near[k] = 0
    if not was_clear:
        is_near = _mark_near(system, memory, reach, level, log.slow)
        if is_near and level != COARSE:
            return NEAR, False
    n_kept = (2 if system.is_chained or system.is_modal else 3) * system.size
    for i in range(n_kept):
        memory.kept[i] = X[i]
    old_base, damped = (base[0], base[1], base[2]), totals[CONTACT_DAMPED]
    flow, smallest = steps.advance(system, law, memory, new_base, was_clear)
    is_clear = _is_clear(system, memory, reach)
    if (not is_clear and _mark_near(system, memory, -reach, level, log.slow)) or is_near:
        for i in range(n_kept):
            X[i] = memory.kept[i]
        memory.counts[IS_SEEN] = 0
        base[0], base[1], base[2] = old_base
        totals[CONTACT_DAMPED] = damped
        return NEAR, False
    return steps.end_step(system, law, memory, log, tick, flow, smallest), is_clear


@njit(inline="always")
def _fine_step(system, law, memory, log, new_base, tick, floor):  # type: ignore[no-untyped-def]
    """Make a fine step and ask the law; return COMPLETED, DIVERGED or a failure of the law."""
    flow, smallest = steps.advance(system, law, memory, new_base, False)
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
    before, is_first, is_clear = steps.base_at(log.base_states, step - 1), True, False
    steps.see_base(fine, memory)
    for j in range(1, m + 1):
        after = _base_in(log.base_states, step, j / m, dt)
        if m > 1:
            ticks = (step - 1) * r + j * (r // m)
            status, is_clear = _leap(middle, law, memory, log, after, MIDDLE, ticks, is_clear)
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
    counts, r, floor, is_clear = memory.counts, log.refine, -log.limit, False
    for step in range(first, log.n_steps + 1):
        if counts[N_EVENTS] + r > log.n_events or counts[N_HITS] + r * fine.n_pairs > log.n_hits:
            return step - 1, FULL
        new_base = steps.base_at(log.base_states, step)
        status, is_clear = _leap(coarse, law, memory, log, new_base, COARSE, step * r, is_clear)
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
