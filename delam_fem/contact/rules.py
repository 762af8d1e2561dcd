"""The decisions of the contact laws: which pairs are hit, with which impulses, and which rest.

Both engines call these functions: they see gaps and gap rates of pairs, and know neither time nor
state. Impulses [N s] and forces [N] act on pairs; H^T maps them to the dofs. A positive impulse or
force pushes the laminae apart. A decision is made in three steps:

- `closing_pairs` lists the closed pairs that an impulse may part. IMPACTS ("newton" in paper 3.1,
  "newton-penalty" in paper 3.2, eq. 17 as corrected) asks between two steps: a pair that carries no
  spring and approaches is hit. MOREAU asks within a step of the Moreau–Jean scheme, about gaps that
  are predicted for its middle. PENALTY and NONE hit no pair.
- `solve_impulses` finds their impulses p by Newton's law, together ("consistent"),

      0 <= p  ⊥  U̇⁺ + e U̇ >= 0,   U̇⁺ = U̇_free + W p

  or each pair as if it were alone ("lumped", paper eq. 14), p = -(1 + e) U̇ / W_kk, so that it
  leaves with -e times its own rate. U̇_free is the gap rate that follows without impulses; between
  two steps it is U̇.
- `renew_resting` says which pairs rest from now on. IMPACTS: a pair whose gap opens loses its
  spring, and a hit pair that leaves slower than the threshold gets one. PENALTY: exactly the closed
  pairs carry springs. MOREAU: pairs that were pushed although they approached slower than the
  threshold; that is only a report.
"""

from __future__ import annotations

import numpy as np

from delam_fem.contact import complementarity
from delam_fem.contact.decisions import (
    DAMPING,
    IMPACTS,
    IS_ELASTIC,
    MOREAU,
    N_OF_PAIR,
    NO_BLOCK,
    PENALTY,
    RESTITUTION,
    THRESHOLD,
    Decision,
    Kinematics,
    LawContext,
    LawNumbers,
)
from delam_fem.system.caches import kept, njit

CLOSED = 1e-4
"""A gap below this fraction of Δt times the largest gap rate is closed, if pairs touch at rest.

Pairs that stay in contact have gaps of nothing but round-off, whose signs would decide whether the
law sees them. The tolerance is proportional to the motion: with closed delaminations, twice the
excitation gives exactly twice the response. The scheme itself lets gaps overrun by about Δt times
the gap rate.
"""

OF_PLACE, OF_SPEED = 1e-14, 1e-11
"""Parts of the displacements over Δt, and of the velocities, of the two sides of a pair, up to
which its gap rate is round-off and needs no impulse.

Equal laminae that touch at rest may move together. Their gap rates are then differences of equal
numbers. A step solves for velocities from K u, so that its round-off is about 4e-16 of u/Δt; the
part of the velocities stands for the displacements while these pass through 0.
"""

NOTHING, OTHERS = -1, -2
"""Results of an examination: nothing jumps; the candidates are other pairs than those given."""


@njit(forceinline=True)
def _kind_of(law, k):  # type: ignore[no-untyped-def]
    """Return the kind of decisions about a pair: an elastic pair is a spring in any law."""
    if law.differ and law.of_pairs[N_OF_PAIR * k + IS_ELASTIC] != 0.0:
        return PENALTY
    return law.kind


@njit(forceinline=True)
def _restitution_of(law, k):  # type: ignore[no-untyped-def]
    """Return e of a pair."""
    return law.of_pairs[N_OF_PAIR * k + RESTITUTION] if law.differ else law.restitution


@njit(forceinline=True)
def _threshold_of(law, k):  # type: ignore[no-untyped-def]
    """Return the speed limit for a resting pair [m/s]."""
    return law.of_pairs[N_OF_PAIR * k + THRESHOLD] if law.differ else law.threshold


@njit(forceinline=True)
def damping_of(law, k):  # type: ignore[no-untyped-def]
    """Return the damping of the spring of a pair, if its weight is 1 [N s/m]."""
    return law.of_pairs[N_OF_PAIR * k + DAMPING] if law.differ else law.damping


@njit
def closing_pairs(law, n_pairs, gap, rate, free, resting, hit, before, after, lacking):  # type: ignore[no-untyped-def]
    """List the pairs that an impulse may part.

    Args:
        law: its numbers.
        n_pairs: number of all pairs.
        gap: gaps that the law examines, shape (n_pairs,) [m].
        rate: gap rates U̇, of the closed pairs at least, shape (n_pairs,) [m/s].
        free: U̇_free, likewise.
        resting: pairs that rest now, shape (n_pairs,).
        hit: result, the pairs, the first entries.
        before: result, their U̇.
        after: result, their U̇_free.
        lacking: result, U̇_free + e U̇, which is negative where an impulse is needed.

    Returns:
        Number of these pairs, 0 if none of them needs an impulse; whether a pair begins or ceases
        to rest because of its gap alone.
    """
    n = 0
    lacks = False
    changes = False
    for k in range(n_pairs):
        is_closed = gap[k] <= 0.0
        rests = resting[k] != 0
        kind = _kind_of(law, k)
        if kind == PENALTY:
            changes |= is_closed != rests
        elif kind == IMPACTS and not is_closed:
            changes |= rests
        elif is_closed and (kind == MOREAU or (kind == IMPACTS and not rests and rate[k] < 0.0)):
            hit[n] = k
            before[n] = rate[k]
            after[n] = free[k]
            lacking[n] = free[k] + _restitution_of(law, k) * rate[k]
            lacks |= not lacking[n] >= 0.0  # also if it is no number
            n += 1
    return n if lacks else 0, changes


@njit
def needs_impulse(lacking, n, noise):  # type: ignore[no-untyped-def]
    """Return whether one of n candidates lacks more than round-off; see `closing_pairs`."""
    for j in range(n):
        if not lacking[j] >= -noise:  # also if it is no number
            return True
    return False


@njit
def solve_impulses(law, W, places, n, hit, before, after, lacking, impulse, change, noise, memory):  # type: ignore[no-untyped-def]
    """Find the impulses of n candidates, and their gap rates afterwards.

    Args:
        law: its numbers.
        W: entries, place of the first and length of a row of W; see `solve_among`.
        places: rows of W that belong to the candidates.
        n: number of the candidates.
        hit: see `closing_pairs`.
        before: see `closing_pairs`.
        after: see `closing_pairs`; result, U̇⁺.
        lacking: see `closing_pairs`.
        impulse: result.
        change: work space.
        noise: see `solve_among`.
        memory: see `solve_among`.

    Returns:
        Number of pairs that are hit, the first entries; result of `solve_among`. With MOREAU a pair
        without an impulse is not hit.
    """
    entries, origin, stride = W
    if not law.is_coupled:
        for j in range(n):
            single = entries[origin + places[j] * (stride + 1)]
            restitution = _restitution_of(law, hit[j])
            impulse[j] = -(1.0 + restitution) * before[j] / single
            after[j] = -restitution * before[j]
        return n, complementarity.SOLVED
    result = complementarity.solve_among(
        entries, origin, stride, places, n, lacking, impulse, change, noise, memory
    )
    n_hit = 0
    for j in range(n):
        if law.kind != MOREAU or impulse[j] > 0.0:
            hit[n_hit] = hit[j]
            impulse[n_hit] = impulse[j]
            before[n_hit] = before[j]
            after[n_hit] = after[j] + change[j]
            n_hit += 1
    return n_hit, result


@njit
def renew_resting(law, n_pairs, gap, n, hit, before, after, resting):  # type: ignore[no-untyped-def]
    """Write which pairs rest after n were hit into `resting`; return whether that has changed.

    Args:
        law: its numbers.
        n_pairs: number of all pairs.
        gap: see `closing_pairs`.
        n: number of the hit pairs.
        hit: see `solve_impulses`.
        before: see `solve_impulses`.
        after: see `solve_impulses`.
        resting: pairs that rest before; result, those that rest afterwards, shape (n_pairs,).
    """
    is_changed = False
    for k in range(n_pairs):
        rested = resting[k] != 0
        kind = _kind_of(law, k)
        rests = kind != MOREAU and gap[k] <= 0.0 and (kind == PENALTY or rested)
        is_changed |= rests != rested
        resting[k] = rests
    for j in range(n):
        threshold = _threshold_of(law, hit[j])
        if (before[j] > -threshold) if law.kind == MOREAU else (after[j] < threshold):
            resting[hit[j]], is_changed = True, True
    return is_changed


class Rules:
    """A law of the table, set up for one problem (`contact.decisions.Supervisor`)."""

    def __init__(self, law: LawNumbers, setting: LawContext) -> None:
        """Set a law up for a problem.

        Args:
            law: the numbers of the law.
            setting: the problem; impulses act through its compliance.
        """
        self._law = law
        self._W = (W := setting.compliance)
        self._block = W.block if law.is_coupled else lambda pairs: np.diag(W.diagonal(pairs))
        self._hit = np.zeros(setting.n_pairs, dtype=np.int64)
        self._values = np.zeros((4, setting.n_pairs))  # U̇, U̇_free and U̇⁺, what is lacking, p
        self._resting = np.zeros(setting.n_pairs, dtype=np.bool_)

    def examine(self, seen: Kinematics) -> Decision | None:
        """Return the impulses and the new set of resting pairs, or None if nothing jumps."""
        hit, values, now = self._hit, self._values, self._resting
        about = seen.gap, seen.rate_pre(), seen.rate_free(), seen.resting, hit, values, now
        noise = seen.rate_noise()
        known = self._W.recent if self._law.is_coupled else NO_BLOCK
        n, result, is_changed = _examine(*known, *about, noise, *self._law)
        if result == OTHERS:
            pairs = hit[:n].copy()
            n, result, is_changed = _examine(pairs, self._block(pairs), *about, noise, *self._law)
        if result == NOTHING:
            return None
        complementarity.require_solved(result)
        of_hit = values[:, :n].copy()
        resting = now.copy() if is_changed else None
        return Decision(hit[:n].copy(), of_hit[3], of_hit[0], of_hit[1], resting)


@kept
def _examine(pairs, W, gap, rate, free, resting, hit, values, now, noise, *numbers):  # type: ignore[no-untyped-def]
    """Make the three steps of a decision, called from Python: a tuple for the law would cost more.

    Args:
        pairs: some pairs, shape (k,).
        W: their compliance, shape (k, k).
        gap: see `closing_pairs`.
        rate: see `closing_pairs`.
        free: see `closing_pairs`.
        resting: see `closing_pairs`.
        hit: see `closing_pairs`.
        values: results: U̇, U̇⁺, what is lacking and p of the hit pairs, shape (4, n_pairs).
        now: result: pairs that rest from now on.
        noise: see `solve_among`.
        numbers: `LawNumbers`.

    Returns:
        Number of hit pairs, the first entries; result of `solve_among`, NOTHING, or OTHERS if not
        `pairs`, but the first entries are the candidates; whether other pairs rest.
    """
    before, after, lacking, impulse = values[0], values[1], values[2], values[3]
    law = LawNumbers(*numbers)
    result = complementarity.SOLVED
    of_pairs = hit, before, after, lacking
    n, changes = closing_pairs(law, gap.size, gap, rate, free, resting, *of_pairs)
    if n and not needs_impulse(lacking, n, noise):
        n = 0
    if not n and not changes:
        return 0, NOTHING, False
    if n and (n != pairs.size or (pairs != hit[:n]).any()):
        return n, OTHERS, False
    if n:
        change = np.empty(n)
        memory = complementarity.fresh(n)
        n, result = solve_impulses(
            law, (W.ravel(), 0, n), np.arange(n), n, *of_pairs, impulse, change, noise, memory
        )
    now[:] = resting
    changed = renew_resting(law, gap.size, gap, n, hit, before, after, now)
    return n, result, changed
