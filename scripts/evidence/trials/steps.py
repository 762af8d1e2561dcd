"""Make the steps of the trial schemes of `schemes.py`, in compiled code.

Each step function advances (u, v, a) of a small dense problem by one step, in place. The base acts
as the load f = -(m_b q'' + c_b q' + k_b q). Contact is a constraint on velocities, H v⁺ >= floor,
or on gaps.
"""

from __future__ import annotations

import numba
import numpy as np
from trials.schemes import BOUNDED, CLOSED, END, MOREAU

from delam_fem.contact.complementarity import SOLVED, solve_into
from delam_fem.system.caches import njit


@njit
def _load(m, base):  # type: ignore[no-untyped-def]
    """Return the load due to the base motion `base` = (q, q', q''), shape (n,) [N, N m]."""
    return -(m.of.base[0] * base[2] + m.of.base[1] * base[1] + m.of.base[2] * base[0])


@njit
def _floors(m, gap, rate):  # type: ignore[no-untyped-def]
    """Return the smallest allowed gap rate of each pair, -inf if free; see `schemes.LAWS`."""
    dt = m.numbers[0]
    law = int(m.numbers[1])
    e = m.numbers[2]
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


@njit
def _impulses(m, W, free, floors):  # type: ignore[no-untyped-def]
    """Solve 0 <= p ⊥ free + W p - floors >= 0 over all pairs with a finite floor; return p."""
    p = np.zeros(free.size)
    chosen = np.nonzero(floors > -np.inf)[0]
    if chosen.size == 0 or (free - floors)[chosen].min() >= 0.0:
        return p
    local = np.zeros(chosen.size)
    right = (free - floors)[chosen]
    block = np.empty((chosen.size, chosen.size))
    for i in range(chosen.size):
        for j in range(chosen.size):
            block[i, j] = W[chosen[i], chosen[j]]
    if solve_into(block, right, local, np.empty(chosen.size)) != SOLVED:
        local[:] = np.nan
    for i in range(chosen.size):
        p[chosen[i]] = local[i]
    return p


@njit
def theta_step(m, W, u, v, a, before, after):  # type: ignore[no-untyped-def]
    """Make a step of the Moreau–Jean scheme with θ = 1/2."""
    dt = m.numbers[0]
    gap = m.of.H @ u + m.of.gap0
    rate = m.of.H @ v
    load = 0.5 * (_load(m, before) + _load(m, after))
    mean = m.inverse @ (m.of.M @ v + 0.5 * dt * (load - m.of.K @ u))
    v_free = 2.0 * mean - v
    p = _impulses(m, W, m.of.H @ v_free, _floors(m, gap, rate))
    u += dt * mean + m.shift @ p
    v[:] = v_free + m.push @ p


@njit
def exact_step(m, W, u, v, a, before, after):  # type: ignore[no-untyped-def]
    """Make an exact linear step with impulses at its end or as a constant force in it."""
    n = u.size
    gap = m.of.H @ u + m.of.gap0
    rate = m.of.H @ v
    f = _load(m, before)
    x = np.concatenate((u, v, f, _load(m, after) - f))
    x = m.inverse @ x
    p = _impulses(m, W, m.of.H @ x[n:], _floors(m, gap, rate))
    u[:] = x[:n] + m.shift @ p
    v[:] = x[n:] + m.push @ p


@njit
def alpha_step(m, W, u, v, a, before, after):  # type: ignore[no-untyped-def]
    """Make a step of the non-smooth generalised-α scheme: a smooth part, then a velocity jump."""
    dt, e, am, af, gamma, beta = m.numbers
    rate = m.of.H @ v
    load = (1 - af) * _load(m, after) + af * _load(m, before)
    ahead_u = u + dt * v + dt * dt * (0.5 - beta) * a
    ahead_v = v + dt * (1 - gamma) * a
    inner = m.of.K @ ((1 - af) * ahead_u + af * u) + m.of.C @ ((1 - af) * ahead_v + af * v)
    new = m.inverse @ (load - am * (m.of.M @ a) - inner)
    u[:] = ahead_u + beta * dt * dt * new
    v[:] = ahead_v + gamma * dt * new
    a[:] = new
    floors = np.where(m.of.H @ u + m.of.gap0 <= 0.0, -e * rate, -np.inf)
    p = _impulses(m, W, m.of.H @ v, floors)
    u += m.shift @ p
    v += m.push @ p


@njit
def implicit_step(m, W, u, v, a, before, after):  # type: ignore[no-untyped-def]
    """Make a step of Newmark's scheme with contact forces implicit in the gaps (Kane et al.).

    The stabilised scheme (Deuflhard, Krause, Ertel) first moves the prediction so that no gap is
    negative.
    """
    dt = m.numbers[0]
    load = 0.5 * (_load(m, before) + _load(m, after))
    x = u + dt * v
    none = np.zeros(m.of.gap0.size)
    if m.numbers[1] == 1.0:
        x += m.shift @ _impulses(m, m.of.H @ m.shift, m.of.H @ x + m.of.gap0, none)
    right = 2.0 / dt * (m.of.M @ x) + m.of.C @ (x - dt * v) + dt * load - 0.5 * dt * (m.of.K @ u)
    free = m.inverse @ right
    u[:] = free + m.push @ _impulses(m, W, m.of.H @ free + m.of.gap0, none)
    v += 2.0 / dt * (u - x)


@numba.njit
def envelopes(step, m, bases, n_periods, observed):  # type: ignore[no-untyped-def]
    """Run from rest; return the smallest and largest displacements of some dofs in each period.

    Args:
        step: one of the step functions above.
        m: matrices of its scheme.
        bases: (q, q', q'') of the base at the steps of a period, shape (N + 1, 3).
        n_periods: number of periods to compute.
        observed: numbers of the observed dofs, shape (n_observed,).

    Returns:
        Extremes, shape (n_periods, 2, n_observed); NaN from the period in which the motion
        diverges.
    """
    n = m.of.M.shape[0]
    W = m.of.H @ m.push
    u = np.zeros(n)
    v = np.zeros(n)
    a = np.zeros(n)
    result = np.full((n_periods, 2, observed.size), np.nan)
    for period in range(n_periods):
        low = u[observed].copy()
        high = u[observed].copy()
        for j in range(1, len(bases)):
            step(m, W, u, v, a, bases[j - 1], bases[j])
            for k in range(observed.size):
                low[k], high[k] = min(low[k], u[observed[k]]), max(high[k], u[observed[k]])
        if not np.abs(u).max() < 1e3:
            return result
        result[period, 0] = low
        result[period, 1] = high
    return result
