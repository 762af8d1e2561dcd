"""March a reduced problem through a period: exact modes, rigid contact, fine steps near contact.

In a step of length h the contact forces λ are constant. Modes then move exactly (P1), the omitted
flexibility creeps exactly, s1 = s0 exp(-h/β) + (1 - exp(-h/β)) λ, and the gaps at the end are
linear in λ. Rigid contact is asked at the end of the step:

    0 <= λ  ⊥  gap1 = gap_free + A λ >= 0,   A = G b1 Gᵀ + Σ (1 - exp(-h/β)) W                 (M1)

A is positive definite, so λ is unique and continuous in the state. The energy changes by

    Δ(½ v² + ½ ω² q² + ½ Σ sᵀ W s) = drive work - Σ c ∫ v² - Σ creep - Σ λ gap0                (M2)

    creep = ½ (1 - exp(-2h/β)) (s0 - λ)ᵀ W (s0 - λ)

exactly. The last term is the loss at the instant of closing (gap0: at the start of the step). It
tends to 0 with h; contact itself takes no energy.

A coarse step is made where no gap is small (`refinement.SAFETY`); others are divided into r fine
ones. The drive is linear within coarse steps, so that both sizes give the same motion without
contact, bit for bit but for round-off.
"""

from __future__ import annotations

import numpy as np

from delam_fem.caches.kernels import kept, njit
from delam_fem.contact.complementarity import solve_again, solve_into
from delam_fem.engines.modal.state import (
    COMPLETED,
    CONTACT_LOSS,
    CREEP_LOSS,
    DIVERGED,
    DRIVE_WORK,
    MODAL_LOSS,
    N_COARSE,
    N_FINE,
    UNSOLVED,
)
from delam_fem.simulation.refinement import SAFETY


@njit
def _move(step, memory, load, rise, share):  # type: ignore[no-untyped-def]
    """Compute the amplitudes at the end of a step without contact (P1)."""
    a, q, v = step.move, memory.q, memory.v
    next_q, next_v = memory.next_q, memory.next_v
    for j in range(q.size):
        F, dF = load[j] + share * rise[j], rise[j]
        next_q[j] = a[0, j] * q[j] + a[1, j] * v[j] + a[4, j] * F + a[6, j] * dF
        next_v[j] = a[2, j] * q[j] + a[3, j] * v[j] + a[5, j] * F + a[7, j] * dF


@njit
def _gaps(problem, q, base, out):  # type: ignore[no-untyped-def]
    """Write the gaps without the omitted flexibility into `out`."""
    columns, n = problem.gap_columns, out.size
    for k in range(n):
        out[k] = problem.gap0[k] + problem.gap_drive[k] * base
    for j in range(q.size):
        amplitude = q[j]
        for k in range(n):
            out[k] += columns[j, k] * amplitude


@njit
def _rates(problem, memory, base_rate):  # type: ignore[no-untyped-def]
    """Write the gap rates of the present state without contact forces into `memory.rate`."""
    columns, rate, v = problem.gap_columns, memory.rate, memory.v
    n = rate.size
    for k in range(n):
        rate[k] = problem.gap_drive[k] * base_rate
    for j in range(v.size):
        for k in range(n):
            rate[k] += columns[j, k] * v[j]
    for c in range(problem.creep.size):
        if problem.creep[c] > 0.0:
            for k in range(n):
                rate[k] -= memory.r[c, k] / problem.creep[c]


@njit
def _is_near(memory, ahead):  # type: ignore[no-untyped-def]
    """Return whether a gap is small up to a time ahead (F1 of simulation/refinement.py)."""
    for k in range(memory.gap.size):
        if memory.gap[k] + min(ahead * memory.rate[k], 0.0) <= 0.0:
            return True
    return False


@njit
def _solve(step, memory):  # type: ignore[no-untyped-def]
    """Find the contact forces of M1 from the free gaps in `next_gap`; return the success."""
    n = memory.gap.size
    if solve_again(step.compliance, n, memory.pairs, n, memory.next_gap, memory.force, memory):
        return True
    return solve_into(step.compliance.reshape(n, n), memory.next_gap, memory.force)


@njit
def _push(problem, step, memory):  # type: ignore[no-untyped-def]
    """Add the contact forces to the end of the step: to gaps, amplitudes and modal loads."""
    n, force, gap, A = memory.gap.size, memory.force, memory.next_gap, step.compliance
    for i in range(n):
        if force[i] > 0.0:
            for k in range(n):
                gap[k] += A[i * n + k] * force[i]
    for j in range(memory.q.size):
        push = 0.0
        for k in range(n):
            push += problem.gap_columns[j, k] * force[k]
        memory.push[j] = push
        memory.next_q[j] += step.move[4, j] * push
        memory.next_v[j] += step.move[5, j] * push


@njit
def _creep(problem, step, memory, is_pushed):  # type: ignore[no-untyped-def]
    """Advance s and r of all parts; return the energy lost in creep."""
    n, force, bent, loss = memory.gap.size, memory.force, memory.bent, 0.0
    for c in range(problem.creep.size):
        e, s, r = step.decay[c], memory.s[c], memory.r[c]
        for k in range(n):
            bent[k] = 0.0
        if is_pushed:
            for i in range(n):
                if force[i] > 0.0:
                    for k in range(n):
                        bent[k] += problem.compliance[c, i, k] * force[i]
        lost = 0.0
        for k in range(n):
            lost += (s[k] - force[k]) * (r[k] - bent[k])
            s[k] = e * s[k] + (1.0 - e) * force[k]
            r[k] = e * r[k] + (1.0 - e) * bent[k]
        loss += 0.5 * (1.0 - e * e) * lost
    return loss


@njit
def _account(problem, step, memory, load, rise, share):  # type: ignore[no-untyped-def]
    """Take over the amplitudes at the end of a step; add up work and losses (P2, M2)."""
    q, v, h, Q, loss, work = memory.q, memory.v, step.length, step.loss, 0.0, 0.0
    for j in range(q.size):
        own, dF = load[j] + share * rise[j], rise[j]
        F, q0, v0 = own + memory.push[j], q[j], v[j]
        loss += q0 * (Q[0, j] * q0 + Q[1, j] * v0 + Q[2, j] * F + Q[3, j] * dF)
        loss += v0 * (Q[4, j] * v0 + Q[5, j] * F + Q[6, j] * dF)
        loss += F * (Q[7, j] * F + Q[8, j] * dF) + Q[9, j] * dF * dF
        q[j], v[j] = memory.next_q[j], memory.next_v[j]
        dq, dv = q[j] - q0, v[j] - v0
        mean = (F + 0.5 * dF - (dv + problem.damping[j] * dq) / h) / problem.squares[j]
        work += (own + dF) * q[j] - own * q0 - dF * mean
    memory.totals[MODAL_LOSS] += loss
    memory.totals[DRIVE_WORK] += work


@njit
def _finish(problem, step, memory, move):  # type: ignore[no-untyped-def]
    """Take over the gaps at the end of a step, and add up what contact exchanged."""
    held = moved = 0.0
    for k in range(memory.gap.size):
        held += memory.force[k] * (memory.gap[k] - memory.next_gap[k])
        moved += memory.force[k] * problem.gap_drive[k] * move
        memory.gap[k] = memory.next_gap[k]
        memory.lowest[k] = min(memory.lowest[k], memory.gap[k])
    memory.totals[CONTACT_LOSS] += held
    memory.totals[DRIVE_WORK] -= moved


@njit
def _advance(problem, step, memory, load, rise, share, base, impulse):  # type: ignore[no-untyped-def]
    """Make one step; `share` of the loads' rises lies before it, base is (q, Δq) of the drive.

    Return whether the contact forces were found.
    """
    n, is_pushed = memory.gap.size, False
    _move(step, memory, load, rise, share)
    _gaps(problem, memory.next_q, base[0] + base[1], memory.next_gap)
    for c in range(problem.creep.size):
        for k in range(n):
            memory.next_gap[k] += step.decay[c] * memory.r[c, k]
    for k in range(n):
        memory.force[k] = 0.0
        is_pushed |= memory.next_gap[k] < 0.0
    for j in range(memory.push.size):
        memory.push[j] = 0.0
    if is_pushed:
        if not _solve(step, memory):
            return False
        _push(problem, step, memory)
        for k in range(n):
            impulse[k] += step.length * memory.force[k]
    memory.totals[CREEP_LOSS] += _creep(problem, step, memory, is_pushed)
    _account(problem, step, memory, load, rise, share)
    _finish(problem, step, memory, base[1])
    return True


@njit
def _is_free(problem, coarse, memory, load, rise, base, base_rate, is_near):  # type: ignore[no-untyped-def]
    """Return whether a coarse step from the present state meets no contact; do not make it."""
    if is_near:
        return False
    reach = 0.5 * SAFETY * coarse.length
    _move(coarse, memory, load, rise, 0.0)
    _gaps(problem, memory.next_q, base[0] + base[1], memory.next_gap)
    columns, n = problem.gap_columns, memory.gap.size
    for c in range(problem.creep.size):
        for k in range(n):
            memory.next_gap[k] += coarse.decay[c] * memory.r[c, k]
    for k in range(n):
        memory.bent[k] = problem.gap_drive[k] * base_rate
    for j in range(memory.q.size):
        for k in range(n):
            memory.bent[k] += columns[j, k] * memory.next_v[j]
    for k in range(n):
        if memory.next_gap[k] - max(reach * memory.bent[k], 0.0) <= 0.0:
            return False
    return True


@njit
def _divide(problem, fine, memory, load, rise, drive, step, impulse):  # type: ignore[no-untyped-def]
    """Make a coarse step in fine ones; return whether all contact forces were found."""
    r = drive.refine
    start, move = drive.motion[step - 1], drive.motion[step] - drive.motion[step - 1]
    for i in range(r):
        base = (start + move * (i / r), move / r)
        if not _advance(problem, fine, memory, load, rise, float(i), base, impulse):
            return False
    return True


@njit
def _keep(memory, trace, step):  # type: ignore[no-untyped-def]
    """Write the present state into the record."""
    trace.q[step], trace.v[step], trace.s[step] = memory.q, memory.v, memory.s


@kept(nogil=True, what="steps of modes, about 10 s")
def run_period(problem, coarse, fine, memory, drive, trace):  # type: ignore[no-untyped-def]
    """March through the steps of a period; return COMPLETED, DIVERGED or UNSOLVED."""
    n_steps, r, reach = len(drive.motion) - 1, drive.refine, 0.5 * SAFETY * coarse.length
    rise, small = np.empty(memory.q.size), np.empty(memory.q.size)
    for c in range(problem.creep.size):
        memory.r[c] = problem.compliance[c] @ memory.s[c]
    _gaps(problem, memory.q, drive.motion[0], memory.gap)
    for c in range(problem.creep.size):
        memory.gap[:] += memory.r[c]
    memory.lowest[:] = memory.gap
    memory.totals[:], memory.effort[:] = 0.0, 0
    _keep(memory, trace, 0)
    for step in range(1, n_steps + 1):
        load, base_rate = drive.loads[step - 1], 0.0
        for j in range(rise.size):
            rise[j] = drive.loads[step, j] - load[j]
            small[j] = rise[j] / r
        base = (drive.motion[step - 1], drive.motion[step] - drive.motion[step - 1])
        base_rate = base[1] / coarse.length
        _rates(problem, memory, base_rate)
        is_near = r > 1 and _is_near(memory, reach)
        impulse = trace.impulse[step]
        impulse[:] = 0.0
        if r == 1 or _is_free(problem, coarse, memory, load, rise, base, base_rate, is_near):
            found = _advance(problem, coarse, memory, load, rise, 0.0, base, impulse)
            memory.effort[N_COARSE] += 1
        else:
            found = _divide(problem, fine, memory, load, small, drive, step, impulse)
            memory.effort[N_FINE] += r
        if not found:
            return UNSOLVED
        if not (np.isfinite(memory.q).all() and np.isfinite(memory.gap).all()):
            return DIVERGED
        _keep(memory, trace, step)
    return COMPLETED
