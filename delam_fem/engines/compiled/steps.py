"""Steps and periods in compiled code: candidate, contact law, ledger, record, divided steps."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
from numba import carray, types

from delam_fem.contact.decisions import MOREAU, NONE
from delam_fem.engines.compiled import algebra, contact, inner_points, simd_chains as lk
from delam_fem.engines.compiled.algebra import both_products, measure, row_product
from delam_fem.engines.compiled.matrices import Problem
from delam_fem.engines.compiled.state import (
    COMPLETED,
    CONTACT_DAMPED,
    DISSIPATED,
    DIVERGED,
    FULL,
    IMPACT,
    IS_SEEN,
    N_EVENTS,
    N_FRAMES,
    N_HITS,
    N_RESTING,
    N_SPRINGS,
    OLD_EVENTS,
    OLD_HITS,
    RELEASED,
    SLOT,
    PeriodBuffers,
    view_at,
)
from delam_fem.simulation.recorder import (
    COARSE,
    CONTACTS,
    FINE,
    MIDDLE,
    N_BASE,
    UNFORESEEN,
    add_flows,
    write_period,
)
from delam_fem.simulation.refinement import SAFETY, base_within
from delam_fem.system.caches import kept, njit

OPEN, HIT, RESTING = (np.int8(k) for k in range(3))
"""Contact states of a pair in a frame; see simulation/recorder.py."""


@njit
def advance_banded(system, memory, base_state):  # type: ignore[no-untyped-def]
    """Compute the candidate state in band order; return zᵀ C z and the smallest gap."""
    X = memory.X
    size = system.size
    column = system.base
    scheme = system.scheme
    # G1: ũ and ṽ take the places of u and v; Y has ũ + g ṽ, and P begins z = v⁺ + ρ v
    q, dq, ddq = base_state
    for i in range(size):
        v, a = X[size + i], X[lk.A * size + i]
        X[i] += scheme.time_step * v + scheme.c2 * a
        X[size + i] += scheme.c3 * a
        X[lk.Y * size + i] = X[i] + scheme.g * X[size + i]
        X[lk.P * size + i] = X[size + i] + scheme.rho * v
    # G2: the load of the base, f = -(m q" + c q' + k q), is part of the right-hand side
    for i in range(size):
        load = column[i] * ddq + column[size + i] * dq + column[2 * size + i] * q
        load += row_product(system.stiffness, i, X, lk.Y * size)
        load += row_product(system.damping, i, X, size)
        if system.has_load:
            load -= memory.load[i]
        X[lk.R * size + i] = -load
    algebra.substitute(X, size, system.band, lk.R, lk.A)
    for i in range(size):
        a = X[lk.A * size + i]
        X[i] += scheme.d1 * a
        X[size + i] += scheme.d2 * a
        X[lk.P * size + i] += scheme.d2 * a
    return loss(system, X), smallest_gap(system, X, 0.0)


@njit
def loss(system, X):  # type: ignore[no-untyped-def]
    """Return zᵀ C z of a step in any order of the unknowns, where z is the field P."""
    if system.is_chained:
        return lk.loss(X, system.size, system.form)
    if system.is_modal:
        return inner_points.loss(system, X)
    return algebra.form(system.damping, system.size, X, lk.P * system.size)


@njit
def smallest_gap(system, X, ahead):  # type: ignore[no-untyped-def]
    """Return the smallest gap of all pairs at the displacements u + ahead v."""
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
    (`_is_clear`): then no predicted gap is closed.
    """
    if memory.counts[N_RESTING]:
        forget_resting(system, memory)
    if law.kind != MOREAU or is_clear:
        return np.inf
    ahead = system.scheme.gap_ahead
    if system.is_modal:
        return inner_points.measure(system, memory, ahead)
    if system.is_within:
        return inner_points.see_cells(system, memory.X, ahead, False, 0.0, memory.gap, memory.rate)
    smallest = smallest_gap(system, memory.X, ahead)
    if smallest <= 0.0 or system.is_touching:
        measure(system, memory.X, ahead, memory.gap, memory.rate)
    return smallest


@njit
def forget_resting(system, memory):  # type: ignore[no-untyped-def]
    """Report no pair as resting any more; for the θ-scheme, where resting pairs have no spring."""
    memory.counts[N_RESTING] = 0
    for k in range(system.n_pairs):
        memory.pair_state.resting[k] = False


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
def aim_forces(system, memory, log, step, share, time_step):  # type: ignore[no-untyped-def]
    """Write the further forces at the end of a step, or a share of it, to `ahead`."""
    width = 3 * system.n_forces
    for j in range(system.n_forces):
        end = step * width + 3 * j
        if share == 1.0:
            memory.ahead[j] = log.forces[end]
        else:
            start = end - width
            before = log.forces[start], log.forces[start + 1], log.forces[start + 2]
            after = log.forces[end], log.forces[end + 1], log.forces[end + 2]
            memory.ahead[j] = base_within(before, after, share, time_step)[0]


@njit
def _load_forces(system, memory):  # type: ignore[no-untyped-def]
    """Write the loads at θ within a step to `load`, and take over the forces at its end."""
    after = system.scheme.theta
    before = 1.0 - after
    size = system.size
    for i in range(size):
        memory.load[i] = system.load[i]
    for j in range(system.n_forces):
        force = after * memory.ahead[j] + before * memory.force[j]
        memory.force[j] = memory.ahead[j]
        for i in range(size):
            memory.load[i] += force * system.forces[j * size + i]


@njit
def _see_forces(system, memory, is_first):  # type: ignore[no-untyped-def]
    """Note the further forces and what they moved; add the works since the last time."""
    n = system.n_forces
    size = system.size
    for j in range(n):
        moved = 0.0
        for i in range(size):
            moved += system.forces[j * size + i] * memory.X[i]
        if not is_first:
            mean = 0.5 * (memory.force[j] + memory.reading[j])
            memory.force_flows[j] += mean * (moved - memory.reading[n + j])
        memory.reading[j] = memory.force[j]
        memory.reading[n + j] = moved


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
    products = memory.seen
    before = products[0], products[1], products[2]
    _base_rows(system, memory.X, products, 0)
    return before


@njit(forceinline=True)
def observe(system, memory, log, step):  # type: ignore[no-untyped-def]
    """Record the end of a step: m_b·u, c_b·u, k_b·u and the probes of u; the probes of v."""
    row = memory.counts[SLOT] * (log.n_steps + 1) + step
    X = memory.X
    base = memory.base
    n = system.n_probes
    u = log.u
    v = log.v
    first_u = row * (3 + n)
    first_v = row * n
    _base_rows(system, X, u, first_u)
    if system.is_selecting:
        for k in range(n):
            place = system.selected[k]
            u[first_u + 3 + k], v[first_v + k] = X[place], X[system.size + place]
    else:
        for k in range(n):
            u[first_u + 3 + k] = row_product(system.probe_rows, k, X, 0)
            v[first_v + k] = row_product(system.probe_rows, k, X, system.size)
    if system.is_shifted:
        for k in range(n):
            shift = system.probe_shift[k]
            if shift != 0.0:
                u[first_u + 3 + k] += shift * base[0]
                v[first_v + k] += shift * base[1]


@njit
def advance(system, law, memory, new_base, is_clear):  # type: ignore[no-untyped-def]
    """Compute one candidate state, with springs if any; return zᵀ C z and the smallest gap.

    For `is_clear` see `look_ahead`.
    """
    X = memory.X
    predicted = look_ahead(system, law, memory, is_clear)
    base_state = mix_base(system, memory.base, new_base)
    if system.n_forces:
        _load_forces(system, memory)
    if system.is_chained:  # z is needed for springs, and where impulses may change the step
        keeps = predicted <= 0.0 or memory.counts[N_SPRINGS] > 0
        flow, smallest = lk.step(system, X, base_state, memory.load, keeps)
    elif system.is_modal:
        flow = inner_points.advance(system, X, base_state, memory.load)
        smallest = np.inf
        memory.counts[IS_SEEN] = 0
        if law.kind != MOREAU:
            smallest = smallest_gap(system, X, 0.0)
    else:
        flow, smallest = advance_banded(system, memory, base_state)
    if memory.counts[N_SPRINGS]:
        contact.push_springs(system, law, memory)
        return loss(system, X), smallest_gap(system, X, 0.0)
    if law.kind == MOREAU:
        return flow, contact.widen_contact(system, memory) if system.is_touching else predicted
    if system.is_within:
        touch = -np.inf if law.kind == NONE else 0.0
        return flow, inner_points.see_cells(system, X, 0.0, False, touch, memory.gap, memory.rate)
    return flow, smallest


@njit
def keep_frame(system, memory, log, step):  # type: ignore[no-untyped-def]
    """Store the whole state of a step and the contact state of each pair."""
    size = system.size
    counts = memory.counts
    n = counts[SLOT] * log.n_frames + counts[N_FRAMES]
    for i in range(size):
        log.frames[2 * n * size + i] = memory.X[i]
        log.frames[(2 * n + 1) * size + i] = memory.X[size + i]
    first = n * system.n_pairs
    for k in range(system.n_pairs):
        log.contact[first + k] = RESTING if memory.pair_state.resting[k] else OPEN
    # impacts of this step are the last ones in the buffers: go back until one is before it
    event = counts[N_EVENTS] - 1
    last = counts[N_HITS]
    while event >= counts[OLD_EVENTS] and log.event_tick[event] > (step - 1) * log.refine:
        for j in range(last - log.event_size[event], last):
            if not memory.pair_state.resting[log.hit[j]]:
                log.contact[first + log.hit[j]] = HIT
        last -= log.event_size[event]
        event -= 1
    counts[N_FRAMES] += 1


@njit(inline="always")
def end_step(system, law, memory, log, tick, flow, smallest):  # type: ignore[no-untyped-def]
    """Apply the law to a candidate that touches, and account for damping.

    Args:
        system: the system with the size of the step.
        law: contact law.
        memory: state.
        log: record of the period.
        tick: instant of the end of the step.
        flow: zᵀ C z of the candidate.
        smallest: its smallest gap [m].

    Returns:
        COMPLETED, or a failure of the law (`contact.examine`).
    """
    status = COMPLETED
    if (law.damping != 0.0 or law.differ) and memory.counts[N_SPRINGS] > 0:
        contact.damp(system, law, memory, log)
    if smallest <= 0.0 or memory.counts[N_SPRINGS] > 0:
        event = memory.counts[N_EVENTS]
        status = contact.examine(system, law, memory, log, tick)
        if law.kind >= MOREAU and memory.counts[N_EVENTS] > event:  # impulses have changed the step
            flow = loss(system, memory.X)
    memory.totals[DISSIPATED] += system.scheme.weight * flow
    return status


NEAR = 3
"""Result of a step that was undone, besides those of a loop."""


@njit
def _is_clear(system, memory, reach):  # type: ignore[no-untyped-def]
    """Return whether it is certain that no gap is small up to a time ahead or back (F1).

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
    X = memory.X
    has_springs = memory.counts[N_SPRINGS] > 0
    if system.is_chained and not has_springs:
        if lk.smallest_approach(X, system.size, system.rest, ahead) > 0.0:
            return False
    is_fast = False
    if system.is_modal:
        inner_points.see(system, memory)
    for k in range(system.n_pairs):
        if system.is_modal:
            gap = memory.present_gap[k]
            rate = memory.present_rate[k]
        else:
            gap, rate = both_products(system.gap_rows, k, X, system.size)
            gap = system.gap0[k] + gap
        if has_springs and memory.pair_state.resting[k]:
            gap = -gap
            rate = -rate
        if gap + min(ahead * rate, 0.0) <= 0.0:
            is_fast |= abs(rate) > slow
            if level == COARSE:
                memory.near[k] = 1
            elif is_fast:
                return True
    return is_fast


@njit
def _mark_points(system, memory, ahead, level, slow):  # type: ignore[no-untyped-def]
    """Return and mark the same as `_mark_near` for pairs inside the elements."""
    X = memory.X
    is_fast = False
    n_springs = memory.counts[N_SPRINGS]
    gaps = memory.present_gap  # the law has `gap`
    if inner_points.see_cells(system, X, ahead, True, 0.0, gaps, memory.present_rate) <= 0.0:
        for k in range(system.n_pairs):
            if gaps[k] <= 0.0 and not (n_springs and memory.pair_state.resting[k]):
                is_fast |= abs(row_product(system.gap_rows, k, X, system.size)) > slow
                if level == COARSE:
                    memory.near[k] = 1
                elif is_fast:
                    return True
    for j in range(n_springs):
        k = memory.pairs[j]
        gap, rate = both_products(system.gap_rows, k, X, system.size)
        if system.gap0[k] + gap + max(ahead * rate, 0.0) >= 0.0:
            is_fast |= abs(rate) > slow
            if level == COARSE:
                memory.near[k] = 1
    return is_fast


@njit
def _leap(system, law, memory, log, new_base, level, tick, was_clear):  # type: ignore[no-untyped-def]
    """Make a coarse or middle step that ends at a tick; undo it if a gap is small.

    A coarse step marks the pairs with a small gap in `memory.near`. `was_clear` tells whether the
    state is known to be clear (`_is_clear`) for steps of this size.

    Returns:
        COMPLETED, NEAR if the step was undone, or a failure of the law; whether the new state is
        clear.
    """
    X, base = memory.X, memory.base
    reach = 0.5 * SAFETY * system.scheme.time_step
    is_near = False
    for k in range(system.n_pairs if level == COARSE else 0):
        memory.near[k] = 0
    if not was_clear:
        is_near = _mark_near(system, memory, reach, level, log.slow)
        if is_near and level != COARSE:
            return NEAR, False
    # lane order and modes need no acceleration to go on, bands do
    n_kept = (2 if system.is_chained or system.is_modal else 3) * system.size
    for i in range(n_kept):
        memory.kept[i] = X[i]
    old_base = base[0], base[1], base[2]
    for j in range(system.n_forces):
        memory.undone_force[j] = memory.force[j]
    flow, smallest = advance(system, law, memory, new_base, was_clear)
    is_clear = _is_clear(system, memory, reach)
    if (not is_clear and _mark_near(system, memory, -reach, level, log.slow)) or is_near:
        for i in range(n_kept):
            X[i] = memory.kept[i]
        memory.counts[IS_SEEN] = 0
        base[0], base[1], base[2] = old_base
        for j in range(system.n_forces):
            memory.force[j] = memory.undone_force[j]
        return NEAR, False
    return end_step(system, law, memory, log, tick, flow, smallest), is_clear


@njit(inline="always")
def _fine_step(system, law, memory, log, new_base, tick, floor):  # type: ignore[no-untyped-def]
    """Make a fine step and ask the law; return COMPLETED, DIVERGED or a failure of the law."""
    flow, smallest = advance(system, law, memory, new_base, False)
    if smallest < floor:
        return DIVERGED
    return end_step(system, law, memory, log, tick, flow, smallest)


@njit(inline="always")
def _account(system, memory, before, after, share):  # type: ignore[no-untyped-def]
    """Add the work of the base over a small step to `flows`."""
    seen_before = see_base(system, memory)
    add_flows(memory.flows, seen_before, memory.seen, before, after, share)
    if system.n_forces:
        _see_forces(system, memory, False)


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
        return base_at(states, step)
    before = base_at(states, step - 1)
    after = base_at(states, step)
    return base_within(before, after, share, time_step)


@njit(inline="always")
def _divide(middle, fine, law, memory, log, step, floor):  # type: ignore[no-untyped-def]
    """Make a coarse step in smaller ones; return COMPLETED, DIVERGED or a failure of the law."""
    effort = memory.effort
    counts = memory.counts
    r = log.refine
    m = log.middle
    dt = r * fine.scheme.time_step
    before = base_at(log.base_states, step - 1)
    is_first = True
    is_clear = False
    see_base(fine, memory)
    if fine.n_forces:
        _see_forces(fine, memory, True)
    # m middle steps; each that is undone becomes r/m fine ones; ticks count fine steps from the
    # start of the period
    for j in range(1, m + 1):
        after = _base_in(log.base_states, step, j / m, dt)
        if m > 1:
            aim_forces(fine, memory, log, step, j / m, dt)
            ticks = (step - 1) * r + j * (r // m)
            status, is_clear = _leap(middle, law, memory, log, after, MIDDLE, ticks, is_clear)
            if status == COMPLETED:
                effort[MIDDLE] += 1
                _account(fine, memory, before, after, 1.0 / m)
                before = after
                continue
            if status != NEAR:
                return status
        for tick in range((j - 1) * (r // m) + 1, j * (r // m) + 1):
            after = _base_in(log.base_states, step, tick / r, dt)
            aim_forces(fine, memory, log, step, tick / r, dt)
            event = counts[N_EVENTS]
            status = _fine_step(fine, law, memory, log, after, (step - 1) * r + tick, floor)
            if status != COMPLETED:
                return status
            effort[FINE] += 1
            if is_first and counts[N_EVENTS] > event:
                is_first = False
                effort[CONTACTS] += 1
                effort[UNFORESEEN] += _was_unforeseen(memory, log, event)
            _account(fine, memory, before, after, 1.0 / r)
            before = after
    return COMPLETED


@njit(inline="always")
def _step_of_one_size(p, log, step, was_clear):  # type: ignore[no-untyped-def]
    """Make a step that is never divided; return how it ends, see `_fine_step`, and False."""
    new_base = base_at(log.base_states, step)
    aim_forces(p.fine, p.memory, log, step, 1.0, 0.0)
    return _fine_step(p.fine, p.law, p.memory, log, new_base, step, -log.limit), False


@njit(inline="always")
def _step_of_three_sizes(p, log, step, was_clear):  # type: ignore[no-untyped-def]
    """Make a step, divided if it is near contact.

    Returns:
        COMPLETED, DIVERGED or a failure of the law; whether the new state is clear (`_is_clear`).
    """
    law = p.law
    memory = p.memory
    new_base = base_at(log.base_states, step)
    aim_forces(p.fine, memory, log, step, 1.0, 0.0)
    tick = step * log.refine
    status, is_clear = _leap(p.coarse, law, memory, log, new_base, COARSE, tick, was_clear)
    if status == COMPLETED:
        memory.effort[COARSE] += 1
    elif status == NEAR:
        log.is_divided[memory.counts[SLOT] * (log.n_steps + 1) + step] = 1
        status = _divide(p.middle, p.fine, law, memory, log, step, -log.limit)
    return status, is_clear


@njit
def _store_level(p, log, j):  # type: ignore[no-untyped-def]
    """Write the energies stored now and lost so far (`recorder.LEVEL`) as number j of a block.

    They are those of the whole system, base included, in the fixed frame.
    """
    system = p.fine
    memory = p.memory
    mass = p.corner[0]
    stiffness = p.corner[2]
    X = memory.X
    size = system.size
    q = memory.base[0]
    dq = memory.base[1]
    levels = log.levels
    first = 6 * j  # fmt: skip
    momentum = attachment = 0.0
    for i in range(size):
        momentum += system.base[i] * X[size + i]
        attachment += system.base[2 * size + i] * X[i]
    kinetic = 0.5 * algebra.form(system.mass, size, X, size)
    strain = 0.5 * algebra.form(system.stiffness, size, X, 0)
    if system.has_load:
        for i in range(size):
            strain -= system.load[i] * X[i]
    levels[first] = kinetic + dq * momentum + 0.5 * mass * dq * dq
    levels[first + 1] = strain + q * attachment + 0.5 * stiffness * q * q
    levels[first + 2] = contact.spring_energy(system, p.law, memory)
    levels[first + 3] = momentum
    levels[first + 4] = memory.totals[DISSIPATED]
    levels[first + 5] = memory.totals[CONTACT_DAMPED]


# The memory of a block of six periods (j = 0 … 5) with three slots, while period 4 is computed:
#
#     slot (SLOT)         0             1 (now)       2
#     period              3             4             2
#     log.u, log.v        rows 0 … N    rows 0 … N    rows 0 … N     one row a step, probes behind
#                              └─copied→ row 0                       the three products of the base
#     log.frames          k = 0 … F-1 of each slot: u, then v        N_FRAMES are filled
#
#     log.event_tick …    │ periods 0 to 3 │ period 4 │ free │       one entry an instant of impact
#                         0          OLD_EVENTS    N_EVENTS   n_events
#     log.hit …           │ periods 0 to 3 │ period 4 │ free │       one entry a pair that is hit
#                         0           OLD_HITS      N_HITS    n_hits
#
#     log.levels          row j: energies at the start of period j; row j + 1: at its end
#     log.strobe, ledger, …   row `first_period` + j of the whole run
#
# An event of size s has the last s hits before those of the next event. A block that stops because
# the event buffers are full (FULL) goes on in larger ones from the step that it has reached.


@njit
def _begin_period(p, log, j):  # type: ignore[no-untyped-def]
    """Set what is counted within a period to zero, and record its start."""
    memory = p.memory
    width = 3 + p.fine.n_probes
    width_v = p.fine.n_probes
    counts = memory.counts
    totals = memory.totals
    n_rows = log.n_steps + 1
    n_pairs = p.fine.n_pairs
    slot = j % log.n_slots
    before = (j - 1) % log.n_slots
    counts[SLOT] = slot
    counts[N_FRAMES] = 0
    counts[IS_SEEN] = 0
    counts[OLD_EVENTS], counts[OLD_HITS] = counts[N_EVENTS], counts[N_HITS]
    if j == 0:
        _store_level(p, log, 0)
        observe(p.fine, memory, log, 0)
    else:
        first = slot * n_rows
        last = (before + 1) * n_rows - 1
        for i in range(width):
            log.u[first * width + i] = log.u[last * width + i]
        for i in range(width_v):
            log.v[first * width_v + i] = log.v[last * width_v + i]
    totals[IMPACT] = totals[RELEASED] = 0.0
    for i in range(4):
        memory.flows[i] = 0.0
    for j in range(p.fine.n_forces):
        memory.force_flows[j] = 0.0
        memory.force[j] = log.forces[3 * j]
    for i in range(5):
        memory.effort[i] = 0
    for i in range(3):
        memory.base[i] = log.base_states[i]
    for k in range(n_pairs):
        log.resting[slot * n_pairs + k] = memory.pair_state.resting[k]
        log.damped[slot * n_pairs + k] = 0.0
    if log.refine > 1:
        for i in range(slot * n_rows, (slot + 1) * n_rows):
            log.is_divided[i] = 0


@njit
def _sum(x, first, n, least):  # type: ignore[no-untyped-def]
    """Return the sum of n numbers, smaller ones raised to the least, added in pairs of halves.

    The result is NumPy's sum bit for bit, so that both engines count impacts alike; NumPy before
    2.4 adds more than 8192 numbers in pieces.
    """
    if n > 128:
        half = n // 16 * 8
        return _sum(x, first, half, least) + _sum(x, first + half, n - half, least)
    total = 0.0
    n_blocked = n // 8 * 8
    if n_blocked:
        r = np.zeros(8)
        for i in range(n_blocked):
            value = x[first + i]
            r[i % 8] += least if value < least else value
        total = ((r[0] + r[1]) + (r[2] + r[3])) + ((r[4] + r[5]) + (r[6] + r[7]))
    for i in range(first + n_blocked, first + n):
        total += least if x[i] < least else x[i]
    return total


@njit
def _end_period(p, log, first_period, j, n_steps):  # type: ignore[no-untyped-def]
    """Write the rows of a period; return whether the motion stayed within bounds."""
    memory, counts, k, slot = p.memory, p.memory.counts, first_period + j, p.memory.counts[SLOT]
    n_rows = log.n_steps + 1
    width = p.fine.n_probes
    _store_level(p, log, j + 1)
    ends = n_steps, counts[N_EVENTS], counts[N_HITS]
    for i in range(3):
        log.ends[3 * j + i] = ends[i]
    for i in range(5):
        log.effort[5 * k + i] = memory.effort[i]
    if log.refine == 1:
        log.effort[5 * k] = n_steps
    n_events = counts[N_EVENTS] - counts[OLD_EVENTS]
    n_hits = counts[N_HITS] - counts[OLD_HITS]
    log.impulses[3 * k] = _sum(log.impulse, counts[OLD_HITS], n_hits, -np.inf)
    log.impulses[3 * k + 1] = n_hits
    log.impulses[3 * k + 2] = _sum(log.event_energy, counts[OLD_EVENTS], n_events, 0.0)
    u = carray(log.u, (log.n_slots, n_rows, N_BASE + width))[slot, : n_steps + 1]
    v = carray(log.v, (log.n_slots, n_rows, width))[slot, : n_steps + 1]
    base_states = carray(log.base_states, (n_rows, 3))
    is_divided = carray(log.is_divided, (log.n_slots, n_rows))[slot]
    n_forces = p.fine.n_forces
    coupling = carray(log.coupling, (4 + n_forces,))
    forces = carray(log.forces, (n_rows, 3 * n_forces))
    force_flows = carray(memory.force_flows, (n_forces,))
    flows = carray(memory.flows, (4,))
    rows = (
        carray(log.strobe, (k + 1, 2, log.n_probes))[k],
        carray(log.envelope, (k + 1, 2, log.n_probes))[k],
        carray(log.ledger, (k + 1, 10))[k],
        carray(log.works, (k + 1, n_forces))[k],
    )
    gained = memory.totals[IMPACT], memory.totals[RELEASED]
    of_base = base_states, coupling, log.time_step, is_divided, flows, forces, force_flows
    levels = carray(log.levels, (j + 2, 6))[j:]
    return write_period(u, v, levels, of_base, gained, rows, log.limit)


def _block_of(make_step: Any) -> Any:
    """Return the function that computes a block; see `run_plain`.

    Args:
        make_step: `_step_of_one_size` or `_step_of_three_sizes`.
    """

    @njit
    def run_steps(p, log, first):  # type: ignore[no-untyped-def]
        system = p.fine
        counts = p.memory.counts
        r = log.refine
        is_clear = False
        for step in range(first, log.n_steps + 1):
            n_hits = counts[N_HITS] + r * system.n_pairs  # after this step, at most
            if counts[N_EVENTS] + r > log.n_events or n_hits > log.n_hits:
                return step - 1, FULL
            status, is_clear = make_step(p, log, step, is_clear)
            if status != COMPLETED:
                return step - 1, status
            observe(system, p.memory, log, step)
            n_frames = counts[N_FRAMES]
            if n_frames < log.n_frames and log.frame_steps[n_frames] == step:
                keep_frame(system, p.memory, log, step)
        return log.n_steps, COMPLETED

    @njit
    def run_block(p, log, first_period, begin, n_periods):  # type: ignore[no-untyped-def]
        first, step = begin
        for j in range(first, n_periods):
            if step == 0:
                _begin_period(p, log, j)
            step, ending = run_steps(p, log, step + 1)
            if ending == FULL:
                return j, step, ending
            is_bounded = _end_period(p, log, first_period, j, step)
            if ending < 0:
                return j + 1, 0, ending
            if not is_bounded or ending == DIVERGED:
                return j + 1, 0, DIVERGED
            step = 0
        return n_periods, 0, COMPLETED

    return run_block


# -- called from Python -----------------------------------------------------------------------

_problem = view_at(Problem)
_buffers = view_at(PeriodBuffers)
_plain_block = _block_of(_step_of_one_size)
_divided_block = _block_of(_step_of_three_sizes)


@kept(nogil=True, what="steps of one size, for all laws and schemes, about 15 s")
def run_plain(problem_at, log_at, first_period, begin, n_periods):  # type: ignore[no-untyped-def]
    """Compute a block of periods; write their records and rows.

    Args:
        problem_at: address of the table of a `Problem`.
        log_at: address of the table of a `PeriodBuffers`.
        first_period: number of the first period of the block.
        begin: place in the block to go on from: number of periods and of steps that are done.
        n_periods: number of periods of the block.

    Returns:
        Number of finished periods, of steps of the next, and the result of the loop: COMPLETED,
        DIVERGED (in the last of these periods), FULL (enlarge the event buffers and call again), or
        a failure (`contact.examine`), likewise in the last of these periods.
    """
    return _plain_block(_problem(problem_at), _buffers(log_at), first_period, begin, n_periods)


@kept(nogil=True, what="steps divided near contact, for all laws and schemes, about 15 s")
def run_divided(problem_at, log_at, first_period, begin, n_periods):  # type: ignore[no-untyped-def]
    """Compute a block of periods with steps divided near contact; see `run_plain`."""
    return _divided_block(_problem(problem_at), _buffers(log_at), first_period, begin, n_periods)


@cache
def prepared(is_divided: bool) -> Callable[..., tuple[int, int, int]]:
    """Return `run_plain` or `run_divided`, compiled or loaded."""
    run = run_divided if is_divided else run_plain
    number = types.int64
    run.compile((number, number, number, types.UniTuple(number, 2), number))
    return run  # type: ignore[no-any-return]


@kept
def renew(problem_at):  # type: ignore[no-untyped-def]
    """Compute the accelerations of a `Problem` from the equation of motion."""
    p = _problem(problem_at)
    contact.renew_acceleration(p.fine, p.law, p.memory)


@kept
def list_springs(problem_at):  # type: ignore[no-untyped-def]
    """Update the list of pairs with a spring of a `Problem` from `resting`."""
    p = _problem(problem_at)
    contact.list_springs(p.fine, p.memory)
