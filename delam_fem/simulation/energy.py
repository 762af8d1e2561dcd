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

from dataclasses import dataclass, fields

import numpy as np

from delam_fem.caches.kernels import kept, njit
from delam_fem.model.operators import BaseCoupling
from delam_fem.numerics.arrays import ByteArray, FloatArray


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


@dataclass(frozen=True)
class Flows:
    """Energies exchanged over a period, the terms of E1; losses are positive [J]."""

    base_work: float
    damping_loss: float
    contact_damping_loss: float
    impact_loss: float
    spring_released: float

    @property
    def net(self) -> float:
        """Change of the stored energy that E1 predicts [J]."""
        losses = self.damping_loss + self.contact_damping_loss + self.impact_loss
        return self.base_work - losses + self.spring_released

    @property
    def exchanged(self) -> float:
        """Sum of the magnitudes, a scale for the residual [J]."""
        return sum(abs(float(getattr(self, f.name))) for f in fields(self))


def base_flows(
    seen: FloatArray,
    momentum: tuple[float, float],
    base_states: FloatArray,
    base: BaseCoupling,
    time_step: float,
    divided: tuple[ByteArray, FloatArray] | None = None,
) -> tuple[float, float]:
    """Return the work of the base over k steps, and the damping loss due to its motion, by E2.

    Args:
        seen: rows that begin with (m_b·u, c_b·u, k_b·u) at the k steps and at their start, shape
            (k+1, ≥ 3).
        momentum: m_b·v at the start and at the end [kg m/s].
        base_states: (q, q', q'') of the base at the same steps, shape (k+1, 3).
        base: coupling to the base, with its corner terms.
        time_step: Δt [s].
        divided: which steps were divided into smaller ones, shape (k+1,), and the sums over these
            (see `add_flows`); None: no step.

    Returns:
        Work of the base [J]; part of the damping loss that involves the base velocity [J].
    """
    is_divided, sums = divided or (np.zeros(len(seen), np.uint8), np.zeros(4))
    drive = base_states.view()
    drive.flags.writeable = False  # as it is if it repeats: Numba compiles for one type of array
    by_mass, cross_damping, by_stiffness, square = _sums(seen, drive, is_divided, sums)
    mass, damping, stiffness = base.corner
    corner_damping = damping * time_step * square
    (q0, dq0, _), (q1, dq1, _) = base_states[0].tolist(), base_states[-1].tolist()
    work = (
        cross_damping
        - by_mass
        + by_stiffness
        + momentum[1] * dq1
        - momentum[0] * dq0
        + 0.5 * mass * (dq1**2 - dq0**2)
        + 0.5 * stiffness * (q1**2 - q0**2)
        + corner_damping
    )
    return work, 2.0 * cross_damping + corner_damping


@kept
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
