"""Balance the energy: the work of the base, the stored energies and the losses (the energy ledger).

For the whole system, base dofs included, in the fixed frame and over any interval of time,

    T + V + V_springs |_0^1 = W_base - D_damping - D_contact + E_impacts + E_springs      (E1)

E_impacts is the change of energy at impacts (negative when they dissipate). E_springs is the energy
that appears when a spring is put on or taken off a closed pair. Average-acceleration Newmark and
the Moreau–Jean scheme with θ = 1/2 fulfil E1 exactly if the work of the base over a step is

    W_base = -Δ(m·u) mean(q'') + Δ(c·u) mean(q') + mean(k·u) Δq + Δ[(m·v) q']
             + Δ[M_aa q'^2 / 2 + K_aa q^2 / 2] + Δt C_aa mean(q')^2      (E2)

A force F at a point with the loads f is a drive with k = -f and q = F (`BaseCoupling.force`). E2
then contains its potential: V and W_base stand for V - F f·u and -Σ mean(f·u) ΔF. The strain energy
and the work of the force follow by

    V = (V - F f·u) + F f·u,   W_force = Σ mean(F) Δ(f·u) = Δ(F f·u) - Σ mean(f·u) ΔF          (E3)

Here m, c, k are the base columns of M, C, K. For small steps this work tends to the integral of the
support reaction times q'.
"""

from __future__ import annotations

from dataclasses import dataclass

from delam_fem.system.kernels import kept, njit


@dataclass(frozen=True)
class Energies:
    """Stored energies at an instant [J].

    Attributes:
        kinetic: kinetic energy T [J].
        strain: strain energy V [J].
        spring: energy in the contact springs [J].
        momentum: m·v [kg m/s], which E2 needs at both ends of an interval.
    """

    kinetic: float
    strain: float
    spring: float
    momentum: float = 0.0

    @property
    def total(self) -> float:
        """Sum of the stored energies [J]."""
        return self.kinetic + self.strain + self.spring


LEVEL = ("kinetic", "strain", "spring", "momentum", "dissipated", "contact_damped")
"""Entries of a level: energies stored at an instant, m·v, and the energies lost until then."""


@njit
def base_flows(seen, start, end, base_states, corner, time_step, is_divided, sums):  # type: ignore[no-untyped-def]
    """Return the work of the base over k steps, and the damping loss due to its motion, by E2.

    Args:
        seen: rows that begin with (m_b·u, c_b·u, k_b·u) at the k steps and at their start, shape
            (k+1, ≥ 3).
        start: m_b·v at the start [kg m/s].
        end: m_b·v at the end [kg m/s].
        base_states: (q, q', q'') of the base at the same steps, shape (k+1, 3).
        corner: (M_aa, C_aa, K_aa).
        time_step: Δt [s].
        is_divided: which steps were divided into smaller ones, shape (k+1,).
        sums: over these; see `add_flows`.

    Returns:
        Work of the base [J]; part of the damping loss that involves the base velocity [J].
    """
    by_mass, cross_damping, by_stiffness, square = _sums(seen, base_states, is_divided, sums)
    corner_damping = corner[1] * time_step * square
    before, after = base_states[0], base_states[seen.shape[0] - 1]
    work = (
        cross_damping
        - by_mass
        + by_stiffness
        + end * after[1]
        - start * before[1]
        + 0.5 * corner[0] * (after[1] ** 2 - before[1] ** 2)
        + 0.5 * corner[2] * (after[0] ** 2 - before[0] ** 2)
        + corner_damping
    )
    return work, 2.0 * cross_damping + corner_damping


@njit
def write_ledger(row, levels, seen, base_states, coupling, time_step, is_divided, sums, gained):  # type: ignore[no-untyped-def]
    """Write the row of a period: stored energies, exchanged energies and the residual of E1.

    Args:
        row: gets the columns `recorder.LEDGER`.
        levels: those at the start and at the end (`LEVEL`).
        seen: see `base_flows`.
        base_states: the same.
        coupling: M_aa, C_aa, K_aa, and 1 if a force drives the structure, otherwise 0.
        time_step: Δt [s].
        is_divided: see `base_flows`.
        sums: the same.
        gained: energies that impacts, and switching springs on and off, have added [J].
    """
    start, end, last = levels[0], levels[1], seen.shape[0] - 1
    work, base_damping = base_flows(
        seen, start[3], end[3], base_states, coupling, time_step, is_divided, sums
    )
    damping_loss = end[4] - start[4] + base_damping
    contact_loss, impact_loss, released = end[5] - start[5], -gained[0], gained[1]
    net = work - (damping_loss + contact_loss + impact_loss) + released
    residual = (end[0] + end[1] + end[2]) - (start[0] + start[1] + start[2]) - net
    strain, by_force = end[1], 0.0
    if coupling[3]:  # E3
        strain -= base_states[last, 0] * seen[last, 2]
        by_force = work - (base_states[last, 0] * seen[last, 2] - base_states[0, 0] * seen[0, 2])
        work = 0.0
    row[0], row[1], row[2], row[3], row[4] = end[0], strain, end[2], work, by_force
    row[5], row[6], row[7], row[8], row[9] = (
        damping_loss, contact_loss, impact_loss, released, residual
    )  # fmt: skip


@njit
def _sums(seen, base, is_divided, sums):  # type: ignore[no-untyped-def]
    """Return four sums over steps: Δ(m·u) mean(q''), Δ(c·u) mean(q'), mean(k·u) Δq, mean(q')².

    The sums over divided steps are given.
    """
    by_mass, by_damping, by_stiffness, square = sums[0], sums[1], sums[2], sums[3]
    for j in range(1, seen.shape[0]):
        if is_divided[j]:
            continue
        mean_dq = 0.5 * (base[j, 1] + base[j - 1, 1])
        mean_ddq = 0.5 * (base[j, 2] + base[j - 1, 2])
        by_mass += (seen[j, 0] - seen[j - 1, 0]) * mean_ddq
        by_damping += (seen[j, 1] - seen[j - 1, 1]) * mean_dq
        by_stiffness += 0.5 * (seen[j, 2] + seen[j - 1, 2]) * (base[j, 0] - base[j - 1, 0])
        square += mean_dq * mean_dq
    return by_mass, by_damping, by_stiffness, square


@kept
def add_rows(sums, rows):  # type: ignore[no-untyped-def]
    """Add small steps to the four sums of `_sums`.

    Args:
        sums: the four sums, shape (4,); changed.
        rows: the start and the end of each step: (m_b·u, c_b·u, k_b·u), (q, q', q''), and the size
            of the step over Δt, shape (k+1, 7).
    """
    for j in range(1, rows.shape[0]):
        before, after = rows[j - 1], rows[j]
        add_flows(sums, before, after, before[3:6], after[3:6], after[6])


@njit
def add_flows(sums, seen_before, seen, before, after, share):  # type: ignore[no-untyped-def]
    """Add a small step to the four sums of `_sums`.

    Args:
        sums: the four sums, shape (4,); changed.
        seen_before: (m_b·u, c_b·u, k_b·u) at the start of the small step.
        seen: the same at its end.
        before: (q, q', q'') of the base at its start.
        after: the same at its end.
        share: size of the small step over Δt.
    """
    mean_dq = 0.5 * (after[1] + before[1])
    sums[0] += (seen[0] - seen_before[0]) * 0.5 * (after[2] + before[2])
    sums[1] += (seen[1] - seen_before[1]) * mean_dq
    sums[2] += 0.5 * (seen[2] + seen_before[2]) * (after[0] - before[0])
    sums[3] += mean_dq * mean_dq * share
