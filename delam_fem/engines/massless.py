"""March a reduced problem through its periods: exact modes, rigid contact, fine steps near contact.

A mode q'' + c q' + ω² q = F has the load F = F0 + ΔF τ/h in a step of length h. Its exact motion in
the step, as numbers that compiled code needs, is

    q1 = a11 q0 + a12 v0 + b1 F0 + d1 ΔF,   v1 = a21 q0 + a22 v0 + b2 F0 + d2 ΔF              (P1)
    c ∫ v² dτ = xᵀ Q x,   x = (q0, v0, F0, ΔF)                                                 (P2)

In units of the step x' = A x is a linear system of four equations. Its exponential E and Q follow
from those of a small part of the step by doubling, E(2h) = E(h)², Q(2h) = Q(h) + E(h)ᵀ Q(h) E(h),
which holds for any damping and loses no digits.

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

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.special import roots_legendre

from delam_fem.contact.complementarity import SOLVED, WarmStart, nothing_known, solve_among
from delam_fem.contact.decisions import PairState
from delam_fem.model.massless import Reduced, reduce
from delam_fem.model.operators import Operators
from delam_fem.numerics.types import FloatArray, IntArray
from delam_fem.simulation.loop import Engine, State
from delam_fem.simulation.recorder import (
    COARSE,
    FINE,
    N_BASE,
    Columns,
    Energies,
    Jumps,
    PeriodRecord,
    Recorder,
)
from delam_fem.simulation.refinement import SAFETY
from delam_fem.system.caches import kept, njit

DRIVE_WORK, MODAL_LOSS, CREEP_LOSS, CONTACT_LOSS = range(4)
"""Indices into `MasslessMemory.totals`."""
N_COARSE, N_FINE = range(2)
"""Indices into `MasslessMemory.effort`."""
COMPLETED, DIVERGED, UNSOLVED = range(3)
"""How a period ends."""


class MasslessProblem(NamedTuple):
    """A reduced problem (`model.massless`) in compiled code, with m modes, n pairs and c parts.

    Attributes:
        squares: ω², shape (m,) [1/s2].
        damping: c of each mode, shape (m,) [1/s].
        creep: β, shape (c,) [s].
        gap_columns: Gᵀ, shape (m, n).
        compliance: W of each part, shape (c, n, n) [m/N].
        gap0: gap at rest, shape (n,) [m].
        gap_drive: h of the drive and of each further force, shape (d, n).
        force_loads: modal loads by a unit of each further force, shape (d - 1, m).
    """

    squares: FloatArray
    damping: FloatArray
    creep: FloatArray
    gap_columns: FloatArray
    compliance: FloatArray
    gap0: FloatArray
    gap_drive: FloatArray
    force_loads: FloatArray


class MasslessMemory(NamedTuple):
    """The state and the work space of a reduced problem in compiled code.

    Attributes:
        q, v: amplitudes and velocities of the modes, shape (m,).
        s: late contact forces of each part, shape (c, n) [N].
        r: W s, shape (c, n) [m].
        force: contact forces of the last step, shape (n,) [N].
        gap, rate: gaps [m] and their rates [m/s] at the present instant, shape (n,).
        next_q, next_v: amplitudes at the end of a step without contact, shape (m,).
        push: modal contact loads, shape (m,).
        next_gap: gaps at the end of a step, shape (n,).
        bent: A λ, or W λ of a part, shape (n,).
        base, move: q of each drive at the start of a step, and its change, shape (d,).
        totals: energies of the period [J]; shape (4,).
        works: works of further forces in the period, shape (d - 1,) [J].
        effort: numbers of coarse and fine steps, shape (2,).
        lowest: smallest gap of each pair, shape (n,) [m].
        pairs: all pairs, shape (n,).
        again: memory of the complementarity problem.
    """

    q: FloatArray
    v: FloatArray
    s: FloatArray
    r: FloatArray
    force: FloatArray
    gap: FloatArray
    rate: FloatArray
    next_q: FloatArray
    next_v: FloatArray
    push: FloatArray
    next_gap: FloatArray
    bent: FloatArray
    base: FloatArray
    move: FloatArray
    totals: FloatArray
    works: FloatArray
    effort: IntArray
    lowest: FloatArray
    pairs: IntArray
    again: WarmStart


class PeriodDrive(NamedTuple):
    """The drive in a period of N steps.

    Attributes:
        loads: modal loads at each step, shape (N + 1, m).
        motion: q of each drive at each step, shape (N + 1, d).
        refine: r, the number of fine steps in a coarse one; 1: contact in coarse steps.
    """

    loads: FloatArray
    motion: FloatArray
    refine: int


class Trace(NamedTuple):
    """The record of a period, step by step.

    Attributes:
        q, v: amplitudes and velocities of the modes at each step, shape (N + 1, m).
        s: late contact forces at each step, shape (N + 1, c, n) [N].
        impulse: integral of the contact forces over each step, 0 at the start, shape (N + 1, n)
            [N s].
    """

    q: FloatArray
    v: FloatArray
    s: FloatArray
    impulse: FloatArray


def new_memory(m: int, n: int, c: int, d: int = 1) -> MasslessMemory:
    """Allocate the memory of a problem, at rest."""
    return MasslessMemory(
        q=np.zeros(m),
        v=np.zeros(m),
        s=np.zeros((c, n)),
        r=np.zeros((c, n)),
        force=np.zeros(n),
        gap=np.zeros(n),
        rate=np.zeros(n),
        next_q=np.zeros(m),
        next_v=np.zeros(m),
        push=np.zeros(m),
        next_gap=np.zeros(n),
        bent=np.zeros(n),
        base=np.zeros(d),
        move=np.zeros(d),
        totals=np.zeros(4),
        works=np.zeros(d - 1),
        effort=np.zeros(2, dtype=np.int64),
        lowest=np.zeros(n),
        pairs=np.arange(n),
        again=nothing_known(n),
    )


def new_trace(n_steps: int, m: int, n: int, c: int) -> Trace:
    """Allocate the record of a period."""
    rows = n_steps + 1
    return Trace(
        np.zeros((rows, m)), np.zeros((rows, m)), np.zeros((rows, c, n)), np.zeros((rows, n))
    )


SMALL = 0.5
"""Norm of A times the small part of a step."""
TERMS, NODES = 16, 8
"""Terms of the exponential series and Gauss points in the small part: round-off is reached."""


class Step(NamedTuple):
    """The numbers that steps of one size need.

    Attributes:
        length: h [s].
        move: a11, a12, a21, a22, b1, b2, d1, d2 of P1, shape (8, m).
        loss: the upper triangle of Q of P2 row by row, off-diagonal entries doubled, shape (10, m).
        decay: exp(-h/β) of each part, 0 where β = 0, shape (c,).
        compliance: gaps at the end of the step by contact forces that are constant in it, flat,
            shape (n²,) [m/N].
    """

    length: float
    move: FloatArray
    loss: FloatArray
    decay: FloatArray
    compliance: FloatArray


def step_of(reduced: Reduced, length: float) -> Step:
    """Return the numbers of steps of a length [s]."""
    move, loss = exact_step(reduced.squares, reduced.damping, length)
    creep = reduced.creep
    decay = np.exp(-length / np.where(creep > 0.0, creep, np.inf), where=creep > 0.0, out=0 * creep)
    G = reduced.gap_modes
    A = (G * move[4]) @ G.T + np.einsum("c,cij->ij", 1.0 - decay, reduced.compliance)
    return Step(length, move, loss, decay, np.ascontiguousarray(0.5 * (A + A.T)).ravel())


def exact_step(
    squares: FloatArray, damping: FloatArray, length: float
) -> tuple[FloatArray, FloatArray]:
    """Return the coefficients of P1 and P2 of modes, shapes (8, m) and (10, m), as in `Step`.

    Args:
        squares: ω², shape (m,) [1/s2].
        damping: c, shape (m,) [1/s].
        length: h [s].
    """
    h = length
    A = np.zeros((squares.size, 4, 4))
    A[:, 0, 1] = A[:, 1, 2] = A[:, 2, 3] = 1.0
    A[:, 1, 0] = -squares * h * h
    A[:, 1, 1] = -damping * h
    # x = (q, h q', h² F0, h² ΔF) of each mode; F rises linearly, so its derivative is ΔF. A is
    # (m, 4, 4); the series of the exponential converges fast where its norm is below SMALL.
    halvings = np.ceil(np.log2(np.abs(A).sum(axis=2).max(axis=1) / SMALL)).astype(int).clip(0)
    parts = 0.5**halvings
    E = _exponential(A * parts[:, None, None])
    places, weights = roots_legendre(NODES)
    Q = np.zeros_like(A)
    for place, weight in zip(0.5 * (1.0 + places), 0.5 * weights, strict=True):
        row = _exponential(A * (place * parts)[:, None, None])[:, 1]
        Q += (weight * parts)[:, None, None] * row[:, :, None] * row[:, None, :]
    # double the part of the step until it is the step; modes differ in how often that takes
    for k in range(int(halvings.max(initial=0))):
        still = halvings > k
        transition = E[still]
        Q[still] += transition.transpose(0, 2, 1) @ Q[still] @ transition
        E[still] = transition @ transition
    units = np.array([1.0, h, h * h, h * h])
    E[:, :2] *= units / units[:2, None]
    Q *= (damping / h)[:, None, None] * units[:, None] * units
    entries = [(0, 0), (0, 1), (1, 0), (1, 1), (0, 2), (1, 2), (0, 3), (1, 3)]
    rows = [Q[:, a, b] * (1.0 if a == b else 2.0) for a in range(4) for b in range(a, 4)]
    return np.stack([E[:, i, j] for i, j in entries]), np.stack(rows)


def _exponential(A: FloatArray) -> FloatArray:
    """Return exp(A) by its series, of matrices with a small norm, shape (m, 4, 4)."""
    term = np.broadcast_to(np.eye(4), A.shape).copy()
    total = term.copy()
    for k in range(1, TERMS):
        term = term @ A / k
        total += term
    return total


@njit
def _add_modes(problem, q, out):  # type: ignore[no-untyped-def]
    """Add G q, the gaps that amplitudes of the modes open, or the same of their rates, to `out`."""
    columns = problem.gap_columns
    n = out.size
    for j in range(q.size):
        amplitude = q[j]
        for k in range(n):
            out[k] += columns[j, k] * amplitude


@njit
def _gaps(problem, q, base, move, out):  # type: ignore[no-untyped-def]
    """Write the gaps without the omitted flexibility into `out`; the drives are base + move."""
    for k in range(out.size):
        out[k] = problem.gap0[k]
    for d in range(base.size):
        present = base[d] + move[d]
        for k in range(out.size):
            out[k] += problem.gap_drive[d, k] * present
    _add_modes(problem, q, out)


@njit
def _rates(problem, v, move, length, out):  # type: ignore[no-untyped-def]
    """Write the gap rates without the omitted flexibility into `out`; drives move in a length."""
    for k in range(out.size):
        out[k] = 0.0
    for d in range(move.size):
        rate = move[d] / length
        for k in range(out.size):
            out[k] += problem.gap_drive[d, k] * rate
    _add_modes(problem, v, out)


@njit
def _move(problem, step, memory, load, rise, share):  # type: ignore[no-untyped-def]
    """Compute amplitudes (P1) and gaps at the end of a step without contact."""
    a = step.move
    q = memory.q
    v = memory.v
    next_q, next_v, next_gap = memory.next_q, memory.next_v, memory.next_gap
    for j in range(q.size):
        F = load[j] + share * rise[j]
        dF = rise[j]
        next_q[j] = a[0, j] * q[j] + a[1, j] * v[j] + a[4, j] * F + a[6, j] * dF
        next_v[j] = a[2, j] * q[j] + a[3, j] * v[j] + a[5, j] * F + a[7, j] * dF
    _gaps(problem, next_q, memory.base, memory.move, next_gap)
    for c in range(problem.creep.size):
        for k in range(next_gap.size):
            next_gap[k] += step.decay[c] * memory.r[c, k]


@njit
def _is_near(memory, ahead):  # type: ignore[no-untyped-def]
    """Return whether a gap is small up to a time ahead (F1 of simulation/refinement.py)."""
    for k in range(memory.gap.size):
        if memory.gap[k] + min(ahead * memory.rate[k], 0.0) <= 0.0:
            return True
    return False


@njit
def _push(problem, step, memory):  # type: ignore[no-untyped-def]
    """Add the contact forces to the end of the step: to gaps, amplitudes and modal loads."""
    n = memory.gap.size
    force = memory.force
    for k in range(n):
        memory.next_gap[k] += memory.bent[k]
    for j in range(memory.q.size):
        push = 0.0
        for k in range(n):
            push += problem.gap_columns[j, k] * force[k]
        memory.push[j] = push
        memory.next_q[j] += step.move[4, j] * push
        memory.next_v[j] += step.move[5, j] * push


@njit
def _creep(problem, step, memory, is_pushed):  # type: ignore[no-untyped-def]
    """Advance the late contact forces s and r = W s of all parts; return the energy lost [J]."""
    n = memory.gap.size
    force = memory.force
    bent = memory.bent
    loss = 0.0
    for c in range(problem.creep.size):
        e = step.decay[c]
        s = memory.s[c]
        r = memory.r[c]
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
    q = memory.q
    v = memory.v
    h = step.length
    Q = step.loss
    loss = 0.0
    work = 0.0
    n_forces = memory.works.size
    for j in range(q.size):
        drive_force = load[j] + share * rise[j]
        dF = rise[j]
        F = drive_force + memory.push[j]
        q0 = q[j]
        v0 = v[j]
        loss += q0 * (Q[0, j] * q0 + Q[1, j] * v0 + Q[2, j] * F + Q[3, j] * dF)
        loss += v0 * (Q[4, j] * v0 + Q[5, j] * F + Q[6, j] * dF)
        loss += F * (Q[7, j] * F + Q[8, j] * dF) + Q[9, j] * dF * dF
        q[j] = memory.next_q[j]
        v[j] = memory.next_v[j]
        dq = q[j] - q0
        dv = v[j] - v0
        # q" + c q' + ω² q = F integrated over the step gives the mean of q, and with it the work
        # of a rising load: ∫ F q' = F₁ q₁ - F₀ q₀ - ΔF mean(q)
        mean = (F + 0.5 * dF - (dv + problem.damping[j] * dq) / h) / problem.squares[j]
        work += (drive_force + dF) * q[j] - drive_force * q0 - dF * mean
        for d in range(n_forces):
            start = problem.force_loads[d, j] * memory.base[1 + d]
            more = problem.force_loads[d, j] * memory.move[1 + d]
            memory.works[d] += (start + more) * q[j] - start * q0 - more * mean
    memory.totals[MODAL_LOSS] += loss
    memory.totals[DRIVE_WORK] += work


@njit
def _finish(problem, step, memory):  # type: ignore[no-untyped-def]
    """Take over the gaps at the end of a step, and add up what contact exchanged."""
    work = 0.0
    for d in range(memory.move.size):
        moved = 0.0
        for k in range(memory.gap.size):
            moved += memory.force[k] * problem.gap_drive[d, k] * memory.move[d]
        memory.totals[DRIVE_WORK] -= moved
        if d > 0:
            memory.works[d - 1] -= moved
    for k in range(memory.gap.size):
        work += memory.force[k] * (memory.gap[k] - memory.next_gap[k])
        memory.gap[k] = memory.next_gap[k]
        memory.lowest[k] = min(memory.lowest[k], memory.gap[k])
    memory.totals[CONTACT_LOSS] += work


@njit
def _advance(problem, step, memory, load, rise, share, impulse):  # type: ignore[no-untyped-def]
    """Make one step; return whether the contact forces were found.

    The loads begin at `load` + `share` `rise` and grow by `rise`; the drives are in `memory`.
    """
    n = memory.gap.size
    is_pushed = False
    _move(problem, step, memory, load, rise, share)
    for k in range(n):
        memory.force[k] = 0.0
        is_pushed |= memory.next_gap[k] < 0.0
    for j in range(memory.push.size):
        memory.push[j] = 0.0
    if is_pushed:
        result = solve_among(
            step.compliance, 0, n, memory.pairs, n, memory.next_gap, memory.force, memory.bent,
            0.0, memory.again,
        )  # fmt: skip
        if result != SOLVED:
            return False
        _push(problem, step, memory)
        for k in range(n):
            impulse[k] += step.length * memory.force[k]
    memory.totals[CREEP_LOSS] += _creep(problem, step, memory, is_pushed)
    _account(problem, step, memory, load, rise, share)
    _finish(problem, step, memory)
    return True


@njit
def _is_free(problem, coarse, memory, load, rise, is_near):  # type: ignore[no-untyped-def]
    """Return whether a coarse step from the present state meets no contact, without making it."""
    if is_near:
        return False
    reach = 0.5 * SAFETY * coarse.length
    _move(problem, coarse, memory, load, rise, 0.0)
    _rates(problem, memory.next_v, memory.move, coarse.length, memory.bent)
    for k in range(memory.gap.size):
        if memory.next_gap[k] - max(reach * memory.bent[k], 0.0) <= 0.0:
            return False
    return True


@njit
def _divide(problem, fine, memory, load, rise, drive, step, impulse):  # type: ignore[no-untyped-def]
    """Make a coarse step in fine ones; return whether all contact forces were found."""
    r = drive.refine
    for i in range(r):
        for d in range(memory.move.size):
            start = drive.motion[step - 1, d]
            move = drive.motion[step, d] - start
            memory.base[d] = start + move * (i / r)
            memory.move[d] = move / r
        if not _advance(problem, fine, memory, load, rise, float(i), impulse):
            return False
    return True


@njit
def _keep(memory, trace, step):  # type: ignore[no-untyped-def]
    """Write the present state into the record."""
    trace.q[step], trace.v[step], trace.s[step] = memory.q, memory.v, memory.s


@kept(nogil=True, what="steps of modes, about 10 s")
def run_period(problem, coarse, fine, memory, drive, trace):  # type: ignore[no-untyped-def]
    """Compute the steps of a period; return COMPLETED, DIVERGED or UNSOLVED."""
    n_steps = len(drive.motion) - 1
    r = drive.refine
    base = memory.base
    move = memory.move
    reach = 0.5 * SAFETY * coarse.length
    rise = np.empty(memory.q.size)
    small = np.empty(memory.q.size)
    for c in range(problem.creep.size):
        memory.r[c] = problem.compliance[c] @ memory.s[c]
    for d in range(move.size):
        base[d] = drive.motion[0, d]
        move[d] = 0.0
    _gaps(problem, memory.q, base, move, memory.gap)
    for c in range(problem.creep.size):
        memory.gap[:] += memory.r[c]
    memory.lowest[:] = memory.gap
    memory.totals[:], memory.effort[:] = 0.0, 0
    memory.works[:] = 0.0
    _keep(memory, trace, 0)
    for step in range(1, n_steps + 1):
        load = drive.loads[step - 1]
        for j in range(rise.size):
            rise[j] = drive.loads[step, j] - load[j]
            small[j] = rise[j] / r
        for d in range(move.size):
            base[d] = drive.motion[step - 1, d]
            move[d] = drive.motion[step, d] - base[d]
        _rates(problem, memory.v, move, coarse.length, memory.rate)
        for c in range(problem.creep.size):
            if problem.creep[c] > 0.0:
                memory.rate[:] -= memory.r[c] / problem.creep[c]
        is_near = r > 1 and _is_near(memory, reach)
        impulse = trace.impulse[step]
        impulse[:] = 0.0
        if r == 1 or _is_free(problem, coarse, memory, load, rise, is_near):
            is_solved = _advance(problem, coarse, memory, load, rise, 0.0, impulse)
            memory.effort[N_COARSE] += 1
        else:
            is_solved = _divide(problem, fine, memory, load, small, drive, step, impulse)
            memory.effort[N_FINE] += r
        if not is_solved:
            return UNSOLVED
        if not (np.isfinite(memory.q).all() and np.isfinite(memory.gap).all()):
            return DIVERGED
        _keep(memory, trace, step)
    return COMPLETED


@dataclass(frozen=True)
class Period:
    """A computed period.

    Attributes:
        end: state at its end, shape (n_state,).
        trace: what is kept of each step.
        lowest: smallest gap of each pair, shape (n_pairs,) [m].
        exchanged: work of the drive, losses in modal damping, in the creep of the omitted modes and
            at the instants of closing (M2 of model/component_modes.py), shape (4,) [J].
        effort: numbers of coarse and of fine steps, shape (2,).
        works: works of further forces, but for those by the motion of the base alone, (d - 1,) [J].
        failure: why a step has no solution, with which the period ends early; None: it is whole.
    """

    end: FloatArray
    trace: Trace
    lowest: FloatArray
    exchanged: FloatArray
    effort: IntArray
    works: FloatArray
    failure: ArithmeticError | None = None


class Periods:
    """Periods of a reduced problem under a drive, computed one by one from a given state.

    A state is (q, q', s of each part), shape (n_state,).

    Attributes:
        reduced: the reduced problem.
        time_step: Δt, the length of a coarse step [s].
        refine: number of fine steps in a coarse step near contact; 1: contact in coarse steps.
    """

    def __init__(self, reduced: Reduced, time_step: float, refine: int) -> None:
        """Compute the numbers of both sizes of steps.

        Raises:
            ValueError: there is no time step, or it is divided into less than one step.
        """
        if not (time_step > 0.0 and refine >= 1):
            raise ValueError(
                f"expected a time step above 0 and refine of at least 1, given {time_step} s, "
                f"{refine}"
            )
        self.reduced = reduced
        self.time_step = time_step
        self.refine = refine
        self._problem = MasslessProblem(
            reduced.squares,
            reduced.damping,
            reduced.creep,
            np.ascontiguousarray(reduced.gap_modes.T),
            np.ascontiguousarray(reduced.compliance),
            reduced.gap0,
            reduced.gap_drive,
            reduced.force_loads,
        )
        self._coarse = step_of(reduced, time_step)
        self._fine = step_of(reduced, time_step / refine)
        self._sizes = reduced.n_modes, reduced.n_pairs, reduced.n_parts
        n_drives = len(reduced.gap_drive)
        self._memory, self._trace = new_memory(*self._sizes, n_drives), new_trace(0, *self._sizes)

    def drive(self, base_states: FloatArray) -> PeriodDrive:
        """Return the drive of a period.

        Args:
            base_states: (q, q', q'') of the base, or a force and its derivatives, then of each
                further force, at the N + 1 steps, shape (N + 1, 3 d).
        """
        loads = -base_states[:, 2::-1] @ self.reduced.loads
        if len(self.reduced.force_loads):
            loads += base_states[:, 3::3] @ self.reduced.force_loads
        motion = np.ascontiguousarray(base_states[:, ::3])
        return PeriodDrive(np.ascontiguousarray(loads), motion, self.refine)

    def advance(self, start: FloatArray, drive: PeriodDrive) -> FloatArray:
        """Return the state one period later; NaN if the motion diverges.

        Args:
            start: state, shape (n_state,).
            drive: the drive of the period; see `drive`.

        Raises:
            ArithmeticError: no contact forces were found.
        """
        if len(self._trace.q) != len(drive.motion):
            self._trace = new_trace(len(drive.motion) - 1, *self._sizes)
        return self._run(start, drive, self._trace)

    def record(self, start: FloatArray, drive: PeriodDrive) -> Period:
        """Compute a period and keep every step of it; see `advance`."""
        trace = new_trace(len(drive.motion) - 1, *self._sizes)
        trace.q[:] = np.nan  # until it is computed
        memory = self._memory
        failure = None
        try:
            end = self._run(start, drive, trace)
        except ArithmeticError as error:
            failure = error
            end = np.concatenate([memory.q, memory.v, memory.s.ravel()])
        energies = memory.lowest.copy(), memory.totals.copy()
        return Period(end, trace, *energies, memory.effort.copy(), memory.works.copy(), failure)

    def energies(self, at: FloatArray) -> tuple[float, float]:
        """Return kinetic and strain energy of a state [J]; the strain energy is that of M2."""
        q, v, s = self.split(at)
        strain = 0.5 * float(self.reduced.squares @ q**2)
        strain += 0.5 * float(np.einsum("ci,cij,cj->", s, self.reduced.compliance, s))
        return 0.5 * float(v @ v), strain + self.reduced.sag_energy

    def split(self, at: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return q, q' and s of a state, shapes (m,), (m,), (c, n)."""
        m, n, c = self._sizes
        return at[:m], at[m : 2 * m], at[2 * m :].reshape(c, n)

    def _run(self, start: FloatArray, drive: PeriodDrive, trace: Trace) -> FloatArray:
        memory = self._memory
        memory.q[:], memory.v[:], memory.s[:] = self.split(np.asarray(start, dtype=np.float64))
        memory.again.was_idle[:] = 0
        ending = run_period(self._problem, self._coarse, self._fine, memory, drive, trace)
        if ending == UNSOLVED:
            raise ArithmeticError("modes: no contact forces were found in a step")
        end = np.concatenate([memory.q, memory.v, memory.s.ravel()])
        return end if ending == COMPLETED else np.full_like(end, np.nan)


class ModalStepper:
    """The state of a problem of modes, and what a recorder reads of it.

    Attributes:
        operators: the operators of the structure.
        periods: the object that computes the periods.
        at: (q, q', s of each part), shape (n_state,).
        base_state: (q_b, q_b', q_b'') and those of further forces at this instant, shape (3 d,).
        dissipated: energy lost to damping so far, that of the creep included [J].
        contact_damped: 0; contact is rigid [J].
        seen_u, seen_v: see `recorder.Stepper`; the columns of the base are 0, as the energies of a
            period come from the engine.
    """

    def __init__(self, operators: Operators, periods: Periods) -> None:
        """Prepare the rows of what is seen; the state is at rest, seen from the base."""
        self.operators = operators
        self.periods = periods
        self.at = np.zeros(periods.reduced.n_state)
        self.base_state = np.zeros(3 + 3 * operators.n_forces)
        self.dissipated = self.contact_damped = 0.0
        self.pair_state = PairState.at_start(operators.n_pairs)
        reduced = periods.reduced
        rows = operators.observed
        self._of_modes = rows @ reduced.shapes
        self._of_drive = rows @ reduced.drive
        self._of_drive[:, 0] += operators.probe_shift
        self._at_rest = rows @ reduced.sag
        self._of_forces = np.stack([rows @ X for X in reduced.residual])
        self.finish_step()

    def seen(
        self, q: FloatArray, v: FloatArray, s: FloatArray, base_states: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return the observed rows of u and of v, each of shape (k, n); v is without the creep.

        Args:
            q: amplitudes, shape (k, m).
            v: their rates, shape (k, m).
            s: late contact forces, shape (k, c, n_pairs) [N].
            base_states: (q_b, q_b', …) of each drive, shape (k, 3 d).
        """
        late = np.einsum("scn,cpn->sp", s, self._of_forces, optimize=True)
        moved, moving = (base_states[:, i::3] @ self._of_drive.T for i in range(2))
        return q @ self._of_modes.T + late + moved + self._at_rest, v @ self._of_modes.T + moving

    def finish_step(self) -> None:
        """Compute `seen_u` and `seen_v` from the present state."""
        q, v, s = self.periods.split(self.at)
        (u,), (self.seen_v,) = self.seen(q[None], v[None], s[None], self.base_state[None])
        self.seen_u = np.concatenate([np.zeros(N_BASE), u])

    def carried(self) -> float:
        """Return the kinetic energy that the motion of the base adds [J]."""
        reduced = self.periods.reduced
        rate = self.base_state[1]
        if self.operators.base.is_force:
            return 0.0
        momentum = float(reduced.loads[0] @ self.periods.split(self.at)[1])
        return float(momentum * rate + 0.5 * reduced.base_mass * rate**2)

    def energies(self) -> Energies:
        """Return the stored energies, those of the base included [J]."""
        kinetic, strain = self.periods.energies(self.at)
        return Energies(kinetic + self.carried(), strain, 0.0)

    def state(self) -> FloatArray:
        """Return (u, v, a) of all dofs, a without contact forces, shape (3, n_dofs)."""
        reduced, (q, v, s) = self.periods.reduced, self.periods.split(self.at)
        base, rate, second = self.base_state.reshape(-1, 3).T
        load = -self.base_state[2::-1] @ reduced.loads + base[1:] @ reduced.force_loads
        a = reduced.velocity((load - reduced.damping * v - reduced.squares * q)[None], second[None])
        u = reduced.displacement(q[None], s[None], base[None])
        return np.concatenate([u, reduced.velocity(v[None], rate[None]), a])

    def restore(self, motion: FloatArray, internal: FloatArray | None) -> None:
        """Take over `internal` if it belongs to a motion (u, v, a), otherwise the motion's modes.

        A motion alone does not tell the late contact forces; they are then 0, but in the state of
        rest those that it has.
        """
        reduced = self.periods.reduced
        M = self.operators.mass
        if internal is not None and internal.shape == self.at.shape:
            self.at = internal
            if np.array_equal(self.state()[:2], motion[:2]):
                return
        pull = (M @ reduced.drive).T @ reduced.shapes
        m = reduced.n_modes
        moved = np.zeros(2) if self.operators.base.is_force else self.base_state[:2]
        self.at = np.zeros(reduced.n_state)
        counted = motion[0] - reduced.sag, motion[1]
        for place, of_dofs, of_base in zip((0, m), counted, moved, strict=True):
            self.at[place : place + m] = M @ of_dofs @ reduced.shapes - of_base * pull[0]
        equilibrium = self.operators.equilibrium
        if (
            equilibrium is not None
            and reduced.n_pairs
            and np.array_equal(motion[0], equilibrium.displacement)
        ):
            self.at[2 * m :] = np.tile(equilibrium.force, reduced.n_parts)


class ModalEngine(Engine):
    """The engine of modes with massless contact points; see `simulation.loop.Engine`.

    Contact is rigid and takes no energy: `impact_loss` of the ledger is the loss at instants of
    closing, and `damping_loss` has the creep of the omitted modes.

    Attributes:
        stepper: holds the state.
    """

    def __init__(
        self, operators: Operators, modes: int, time_step: float, refine: int, *, is_open: bool
    ) -> None:
        """Reduce the problem to modes; the state is at rest.

        Args:
            operators: the operators of the structure.
            modes: number of modes of each part.
            time_step: Δt [s].
            refine: number of fine steps in a step near contact.
            is_open: whether laminae pass through one another.

        Raises:
            CaseError: the problem has no such modes.
        """
        touching = operators.without_contact() if is_open else operators
        self.stepper = ModalStepper(operators, Periods(reduce(touching, modes), time_step, refine))
        self._driven: tuple[FloatArray, PeriodDrive] | None = None

    def state(self) -> State:
        """Return the present state; `internal` has the modes and the late contact forces."""
        s = self.stepper
        return State(s.state(), s.pair_state.copy(), (s.dissipated, 0.0), s.at.copy())

    def restore(self, state: State, base_state: FloatArray) -> None:
        """Set the state as given; see `Engine`."""
        self.stepper.base_state = np.array(base_state)
        self.stepper.dissipated, _ = state.losses
        self.stepper.restore(state.motion, state.internal)

    def advance(self, recorder: Recorder, base_states: FloatArray, n_periods: int) -> bool:
        """Compute periods one after the other, and record them; see `Engine`."""
        if self._driven is None or self._driven[0] is not base_states:
            self._driven = base_states, self.stepper.periods.drive(base_states)
        for _ in range(n_periods):
            stepper = self.stepper
            k = recorder.n_closed
            record = recorder.open(stepper, base_states)
            before = stepper.periods.energies(stepper.at), stepper.carried()
            period = stepper.periods.record(stepper.at, self._driven[1])
            self._fill(record, period)
            n_steps = int(np.isfinite(period.trace.q).all(axis=1).sum()) - 1
            stepper.at, stepper.base_state = period.end, np.array(base_states[-1])
            of_base = self._base_damping(period, base_states)
            losses = of_base, period.exchanged[MODAL_LOSS], period.exchanged[CREEP_LOSS]
            stepper.dissipated += float(sum(losses))
            is_bounded = recorder.close(record, stepper, n_steps)
            carried = self._carried_works(base_states)
            recorder.works[k] = period.works + carried
            recorder.ledger[k] = self._ledger_row(period, *before, of_base, float(carried.sum()))
            if period.failure is not None:
                raise period.failure
            if not (is_bounded and np.isfinite(period.end).all()):
                return False
        return True

    def _fill(self, record: PeriodRecord, period: Period) -> None:
        """Write a period into its record; contact forces are impulses at the ends of steps."""
        stepper = self.stepper
        trace = period.trace
        steps = record.frame_steps
        reduced = stepper.periods.reduced
        base = record.base_states
        record.u[:, :N_BASE] = 0.0
        record.u[:, N_BASE:], record.v[:] = stepper.seen(trace.q, trace.v, trace.s, base)
        record.effort[COARSE], record.effort[FINE] = period.effort.tolist()
        u = reduced.displacement(trace.q[steps], trace.s[steps], base[steps, ::3])
        record.frames.extend(
            np.stack([u, reduced.velocity(trace.v[steps], base[steps, 1::3])], axis=1)
        )
        touches = np.zeros((steps.size, stepper.operators.n_pairs), np.int8)
        touches[:, : reduced.n_pairs] = trace.impulse[steps] > 0.0
        record.contact.extend(touches)
        step, pair = np.nonzero(trace.impulse > 0.0)
        ends, first, sizes = np.unique(step, return_index=True, return_counts=True)
        rates = trace.v @ reduced.gap_modes.T
        ticks = ends * record.ticks_per_step
        record.jumps = Jumps(
            Columns(
                ticks, sizes, np.zeros(first.size), pair, trace.impulse[step, pair],
                rates[step - 1, pair], rates[step, pair],
            )
        )  # fmt: skip

    def _base_damping(self, period: Period, base_states: FloatArray) -> float:
        """Return what damping takes from the motion of the base itself in a period [J].

        2 Σ mean(q_b') Δ(l·q) + c_b Δt Σ mean(q_b')² with the modal loads l by -q_b' (R4) and the
        damping c_b where q = 0: the terms of the velocity ι q_b' + Φ v in vᵀ C v besides those of
        Φ v. They come from mass-proportional damping, as K ι + k_b = 0.
        """
        reduced = self.stepper.periods.reduced
        if self.stepper.operators.base.is_force:
            return 0.0
        rate = 0.5 * (base_states[1:, 1] + base_states[:-1, 1])
        moved = np.diff(period.trace.q @ reduced.loads[1])
        square = self.stepper.periods.time_step * float(rate @ rate)
        return 2.0 * float(rate @ moved) + reduced.base_damping * square

    def _carried_works(self, base_states: FloatArray) -> FloatArray:
        """Return the works of further forces by the motion of the base alone, shape (n_forces,).

        They act on the static shape ι q_b and on r q_b, with which the base carries their points.
        """
        o = self.stepper.operators
        if o.base.is_force or not o.n_forces:
            return np.zeros(o.n_forces)
        shape = o.forces.T @ self.stepper.periods.reduced.drive[:, 0] + o.forces_shift
        mean = 0.5 * (base_states[1:, 3::3] + base_states[:-1, 3::3])
        return np.asarray(shape * (np.diff(base_states[:, 0]) @ mean))

    def _ledger_row(
        self,
        period: Period,
        stored: tuple[float, float],
        carried: float,
        of_base: float,
        by_forces: float,
    ) -> tuple[float, ...]:
        """Return the energies of a period in the order of `recorder.LEDGER`.

        Args:
            period: the period that has ended.
            stored: kinetic and strain energy at its start, seen from the base [J].
            carried: see `ModalStepper.carried`, at its start [J].
            of_base: see `_base_damping`; the base does the work that this part of the damping takes
                [J].
            by_forces: sum of `_carried_works` [J].
        """
        work, modal, creep, closing = period.exchanged.tolist()
        T, V = self.stepper.periods.energies(period.end)
        residual = T + V - stored[0] - stored[1] - (work - modal - creep - closing)
        more = self.stepper.carried()
        loss = modal + creep + of_base
        of_forces = float(period.works.sum())
        by_base = work - of_forces + more - carried + of_base - by_forces
        is_force = self.stepper.operators.base.is_force
        works = (0.0, work) if is_force else (by_base, of_forces + by_forces)
        return T + more, V, 0.0, *works, loss, 0.0, closing, 0.0, residual
