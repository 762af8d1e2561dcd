"""Ways to step through contact that were tried beside the package's, on dense matrices.

Each function makes one step of a small problem from (u, v, a) in place. The base enters as the load
f = -(m_b q'' + c_b q' + k_b q). Contact is asked for velocities, H v⁺ >= floor, or for gaps.
"""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np
from scipy.linalg import expm

from delam_fem.contact.complementarity import solve_into
from delam_fem.model.operators import Operators
from delam_fem.numerics.arrays import FloatArray

LAWS = ("moreau", "closed gaps", "end gaps", "recovery", "bounded recovery")
"""Constraints on the gap rate at the end of a step: Moreau's with the gap half a step ahead, or the
gap at the start; Stewart and Trinkle's with e = 0; the recovery of penetrations without the bound
on work and with it, which is the law "moreau-recovery"."""
MOREAU, CLOSED, END, RECOVERY, BOUNDED = range(5)


class Problem(NamedTuple):
    """A problem on dense matrices.

    Attributes:
        M, C, K: shape (n, n).
        H, gap0: gap = H u + gap0.
        base: columns of M, C and K that belong to the base, shape (3, n).
    """

    M: FloatArray
    C: FloatArray
    K: FloatArray
    H: FloatArray
    gap0: FloatArray
    base: FloatArray

    @classmethod
    def of(cls, o: Operators) -> Problem:
        """Return the same problem."""
        M, C, K, H = (A.toarray() for A in (o.mass, o.damping, o.stiffness, o.gap_matrix))
        return cls(M, C, K, H, o.gap0, np.stack([o.base.mass, o.base.damping, o.base.stiffness]))


class Scheme(NamedTuple):
    """A problem and what the steps of a scheme multiply by.

    Attributes:
        of: the problem.
        inverse: of what the scheme solves with, shape (n, n).
        push: velocities by unit impulses on the pairs, shape (n, n_pairs).
        shift: displacements likewise.
        numbers: of the scheme.
    """

    of: Problem
    inverse: FloatArray
    push: FloatArray
    shift: FloatArray
    numbers: FloatArray


def scheme(
    d: Problem, inverse: FloatArray, push: FloatArray, shift: FloatArray, *numbers: float
) -> Scheme:
    """Return a scheme whose arrays lie in memory as compiled code wants them."""
    parts = (inverse, push, shift, np.array(numbers, dtype=np.float64))
    return Scheme(d, *(np.ascontiguousarray(part) for part in parts))


def theta_matrices(d: Problem, dt: float, law: int, restitution: float) -> Scheme:
    """Return what `theta_step` needs, θ = 1/2."""
    inverse = np.linalg.inv(d.M + dt / 2 * d.C + dt**2 / 4 * d.K)
    push = inverse @ d.H.T
    return scheme(d, inverse, push, dt / 2 * push, dt, law, restitution)


def exact_matrices(d: Problem, dt: float, restitution: float, is_spread: bool) -> Scheme:
    """Return what `exact_step` needs: the propagator of (u, v) under a load linear in the step."""
    n = len(d.M)
    inverse_mass = np.linalg.inv(d.M)
    A = np.zeros((4 * n, 4 * n))
    A[:n, n : 2 * n] = np.eye(n)
    A[n : 2 * n, :n], A[n : 2 * n, n : 2 * n] = -inverse_mass @ d.K, -inverse_mass @ d.C
    A[n : 2 * n, 2 * n : 3 * n] = inverse_mass
    A[2 * n : 3 * n, 3 * n :] = np.eye(n) / dt
    E = expm(A * dt)[: 2 * n]
    push, shift = inverse_mass @ d.H.T, np.zeros((n, len(d.gap0)))
    if is_spread:
        constant = E[:, 2 * n : 3 * n] @ d.H.T / dt
        shift, push = constant[:n], constant[n:]
    return scheme(d, E, push, shift, dt, MOREAU, restitution)


def alpha_matrices(d: Problem, dt: float, restitution: float, radius: float) -> Scheme:
    """Return what `alpha_step` needs: generalised-α of Chung and Hulbert by its spectral radius."""
    am, af = (2 * radius - 1) / (radius + 1), radius / (radius + 1)
    gamma = 0.5 + af - am
    beta = 0.25 * (gamma + 0.5) ** 2
    A = (1 - am) * d.M + (1 - af) * (gamma * dt * d.C + beta * dt**2 * d.K)
    push = np.linalg.inv(d.M) @ d.H.T
    numbers = (dt, restitution, am, af, gamma, beta)
    return scheme(d, np.linalg.inv(A), push, dt / 2 * push, *numbers)


def implicit_matrices(d: Problem, dt: float, is_stabilised: bool) -> Scheme:
    """Return what `implicit_step` needs; `shift` is that of the prediction."""
    inverse = np.linalg.inv(2 / dt * d.M + d.C + dt / 2 * d.K)
    return scheme(d, inverse, dt * inverse @ d.H.T, np.linalg.inv(d.M) @ d.H.T, dt, is_stabilised)


@numba.njit(cache=True)
def _load(m, base):  # type: ignore[no-untyped-def]
    return -(m.of.base[0] * base[2] + m.of.base[1] * base[1] + m.of.base[2] * base[0])


@numba.njit(cache=True)
def _floors(m, gap, rate):  # type: ignore[no-untyped-def]
    """Return the least gap rates at the end of a step, -inf where there is none; see `LAWS`."""
    dt, law, e = m.numbers[0], int(m.numbers[1]), m.numbers[2]
    floors = np.full(gap.size, -np.inf)
    for k in range(gap.size):
        if law == MOREAU or law == CLOSED:
            ahead = gap[k] + (0.5 * dt * rate[k] if law == MOREAU else 0.0)
            if ahead <= 0.0:
                floors[k] = -e * rate[k]
        else:
            floors[k] = -gap[k] / dt
            if law != END and gap[k] <= 0.0:
                floors[k] -= e * min(rate[k], 0.0)
            if law == BOUNDED:
                floors[k] = min(floors[k], -rate[k])
    return floors


@numba.njit(cache=True)
def _impulses(m, W, free, floors):  # type: ignore[no-untyped-def]
    """Return p of 0 <= p ⊥ free + W p - floors >= 0 over all pairs that have a floor."""
    p = np.zeros(free.size)
    chosen = np.nonzero(floors > -np.inf)[0]
    if chosen.size == 0 or (free - floors)[chosen].min() >= 0.0:
        return p
    own = np.zeros(chosen.size)
    right = (free - floors)[chosen]
    block = np.empty((chosen.size, chosen.size))
    for i in range(chosen.size):
        for j in range(chosen.size):
            block[i, j] = W[chosen[i], chosen[j]]
    if not solve_into(block, right, own):
        own[:] = np.nan
    for i in range(chosen.size):
        p[chosen[i]] = own[i]
    return p


@numba.njit(cache=True)
def theta_step(m, W, u, v, a, before, after):  # type: ignore[no-untyped-def]
    """Make a step of Moreau and Jean with θ = 1/2."""
    dt = m.numbers[0]
    gap, rate = m.of.H @ u + m.of.gap0, m.of.H @ v
    load = 0.5 * (_load(m, before) + _load(m, after))
    mean = m.inverse @ (m.of.M @ v + 0.5 * dt * (load - m.of.K @ u))
    v_free = 2.0 * mean - v
    p = _impulses(m, W, m.of.H @ v_free, _floors(m, gap, rate))
    u += dt * mean + m.shift @ p
    v[:] = v_free + m.push @ p


@numba.njit(cache=True)
def exact_step(m, W, u, v, a, before, after):  # type: ignore[no-untyped-def]
    """Make an exact linear step; impulses act at its end or as a constant force."""
    n = u.size
    gap, rate = m.of.H @ u + m.of.gap0, m.of.H @ v
    f = _load(m, before)
    x = np.concatenate((u, v, f, _load(m, after) - f))
    x = m.inverse @ x
    p = _impulses(m, W, m.of.H @ x[n:], _floors(m, gap, rate))
    u[:] = x[:n] + m.shift @ p
    v[:] = x[n:] + m.push @ p


@numba.njit(cache=True)
def alpha_step(m, W, u, v, a, before, after):  # type: ignore[no-untyped-def]
    """Make a step of the non-smooth generalised-α: smooth part, then a jump of the velocity."""
    dt, e, am, af, gamma, beta = m.numbers
    rate = m.of.H @ v
    load = (1 - af) * _load(m, after) + af * _load(m, before)
    ahead_u = u + dt * v + dt * dt * (0.5 - beta) * a
    ahead_v = v + dt * (1 - gamma) * a
    inner = m.of.K @ ((1 - af) * ahead_u + af * u) + m.of.C @ ((1 - af) * ahead_v + af * v)
    new = m.inverse @ (load - am * (m.of.M @ a) - inner)
    u[:], v[:], a[:] = ahead_u + beta * dt * dt * new, ahead_v + gamma * dt * new, new
    floors = np.where(m.of.H @ u + m.of.gap0 <= 0.0, -e * rate, -np.inf)
    p = _impulses(m, W, m.of.H @ v, floors)
    u += m.shift @ p
    v += m.push @ p


@numba.njit(cache=True)
def implicit_step(m, W, u, v, a, before, after):  # type: ignore[no-untyped-def]
    """Make a step of Newmark's scheme with contact forces implicit in the gaps (Kane et al.).

    The stabilised scheme (Deuflhard, Krause, Ertel) first brings the prediction within the gaps.
    """
    dt = m.numbers[0]
    load = 0.5 * (_load(m, before) + _load(m, after))
    x, none = u + dt * v, np.zeros(m.of.gap0.size)
    if m.numbers[1] == 1.0:
        x += m.shift @ _impulses(m, m.of.H @ m.shift, m.of.H @ x + m.of.gap0, none)
    right = 2.0 / dt * (m.of.M @ x) + m.of.C @ (x - dt * v) + dt * load - 0.5 * dt * (m.of.K @ u)
    free = m.inverse @ right
    u[:] = free + m.push @ _impulses(m, W, m.of.H @ free + m.of.gap0, none)
    v += 2.0 / dt * (u - x)


@numba.njit
def envelopes(step, m, bases, n_periods, observed):  # type: ignore[no-untyped-def]
    """Run from rest; return the smallest and largest observed u of each period.

    Args:
        step: one of the functions above.
        m: its scheme.
        bases: (q, q', q'') of the base at the steps of a period, shape (N + 1, 3).
        n_periods: to compute.
        observed: dofs.

    Returns:
        Shape (n_periods, 2, n_observed), not finite where the motion has left all bounds.
    """
    n = m.of.M.shape[0]
    W = m.of.H @ m.push
    u, v, a = np.zeros(n), np.zeros(n), np.zeros(n)
    found = np.full((n_periods, 2, observed.size), np.nan)
    for period in range(n_periods):
        low, high = u[observed].copy(), u[observed].copy()
        for j in range(1, len(bases)):
            step(m, W, u, v, a, bases[j - 1], bases[j])
            for k in range(observed.size):
                low[k], high[k] = min(low[k], u[observed[k]]), max(high[k], u[observed[k]])
        if not np.abs(u).max() < 1e3:
            return found
        found[period, 0], found[period, 1] = low, high
    return found
