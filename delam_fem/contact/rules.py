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
    HitPairs,
    Kinematics,
    LawContext,
    LawNumbers,
    PairState,
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
def closing_pairs(law, n_pairs, gap, rate, free, pair_state, hits):  # type: ignore[no-untyped-def]
    """List the pairs that an impulse may part.

    Args:
        law: its numbers.
        n_pairs: number of all pairs.
        gap: gaps that the law examines, shape (n_pairs,) [m].
        rate: gap rates U̇, of the closed pairs at least, shape (n_pairs,) [m/s].
        free: U̇_free, likewise.
        pair_state: what is remembered of the pairs.
        hits: result, with U̇, U̇_free and what is lacking, U̇_free + e U̇, which is negative where
            an impulse is needed.

    Returns:
        Number of these pairs, 0 if none of them needs an impulse; whether a pair begins or ceases
        to rest because of its gap alone.
    """
    n = 0
    lacks = False
    changes = False
    for k in range(n_pairs):
        is_closed = gap[k] <= 0.0
        rests = pair_state.resting[k] != 0
        kind = _kind_of(law, k)
        if kind == PENALTY:
            changes |= is_closed != rests
        elif kind == IMPACTS and not is_closed:
            changes |= rests
        elif is_closed and (kind == MOREAU or (kind == IMPACTS and not rests and rate[k] < 0.0)):
            hits.pair[n] = k
            hits.rate_pre[n] = rate[k]
            hits.rate_post[n] = free[k]
            hits.lacking[n] = free[k] + _restitution_of(law, k) * rate[k]
            lacks |= not hits.lacking[n] >= 0.0  # also if it is no number
            n += 1
    return n if lacks else 0, changes


@njit
def needs_impulse(hits, n, noise):  # type: ignore[no-untyped-def]
    """Return whether one of n candidates lacks more than round-off; see `closing_pairs`."""
    for j in range(n):
        if not hits.lacking[j] >= -noise:  # also if it is no number
            return True
    return False


@njit
def solve_impulses(law, W, places, n, hits, noise, memory):  # type: ignore[no-untyped-def]
    """Find the impulses of n candidates, and their gap rates afterwards.

    Args:
        law: its numbers.
        W: entries, place of the first and length of a column of W; see `solve_among`.
        places: rows of W that belong to the candidates.
        n: number of the candidates.
        hits: these, see `closing_pairs`; result, with U̇⁺ and impulses.
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
            restitution = _restitution_of(law, hits.pair[j])
            hits.impulse[j] = -(1.0 + restitution) * hits.rate_pre[j] / single
            hits.rate_post[j] = -restitution * hits.rate_pre[j]
        return n, complementarity.SOLVED
    result = complementarity.solve_among(
        entries, origin, stride, places, n, hits.lacking, hits.impulse, hits.change, noise, memory
    )
    n_hit = 0
    for j in range(n):
        if law.kind != MOREAU or hits.impulse[j] > 0.0:
            hits.pair[n_hit] = hits.pair[j]
            hits.impulse[n_hit] = hits.impulse[j]
            hits.rate_pre[n_hit] = hits.rate_pre[j]
            hits.rate_post[n_hit] = hits.rate_post[j] + hits.change[j]
            n_hit += 1
    return n_hit, result


@njit
def renew_resting(law, n_pairs, gap, n, hits, pair_state):  # type: ignore[no-untyped-def]
    """Write which pairs rest after n were hit; return whether that has changed.

    Args:
        law: its numbers.
        n_pairs: number of all pairs.
        gap: see `closing_pairs`.
        n: number of the hit pairs.
        hits: these, see `solve_impulses`.
        pair_state: with the pairs that rest before; result, with those that rest afterwards.
    """
    resting = pair_state.resting
    is_changed = False
    for k in range(n_pairs):
        rested = resting[k] != 0
        kind = _kind_of(law, k)
        rests = kind != MOREAU and gap[k] <= 0.0 and (kind == PENALTY or rested)
        is_changed |= rests != rested
        resting[k] = rests
    for j in range(n):
        threshold = _threshold_of(law, hits.pair[j])
        is_slow = hits.rate_post[j] < threshold
        if law.kind == MOREAU:
            is_slow = hits.rate_pre[j] > -threshold
        if is_slow:
            resting[hits.pair[j]] = True
            is_changed = True
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
        self._values = np.zeros((5, setting.n_pairs))  # of `HitPairs`, in their order
        self._next = PairState.at_start(setting.n_pairs)

    def examine(self, seen: Kinematics) -> Decision | None:
        """Return the impulses and the new set of resting pairs, or None if nothing jumps."""
        hit, values = self._hit, self._values
        about = seen.gap, seen.rate_pre(), seen.rate_free(), seen.rate_noise(), hit, values
        tables = *seen.pair_state, *self._next, *self._law
        known = self._W.recent if self._law.is_coupled else NO_BLOCK
        n, result, is_changed = _examine(*known, *about, *tables)
        if result == OTHERS:
            pairs = hit[:n].copy()
            n, result, is_changed = _examine(pairs, self._block(pairs), *about, *tables)
        if result == NOTHING:
            return None
        complementarity.require_solved(result)
        hits = HitPairs(hit[:n].copy(), *values[:, :n].copy())
        pair_state = self._next.copy() if is_changed else None
        return Decision(hits.pair, hits.impulse, hits.rate_pre, hits.rate_post, pair_state)


_BEFORE = len(PairState._fields)
_AFTER = 2 * _BEFORE
"""Ends of the two states of pairs that `_examine` gets; the numbers of the law follow."""


@kept
def _examine(pairs, W, gap, rate, free, noise, hit, values, *tables):  # type: ignore[no-untyped-def]
    """Make the three steps of a decision, called from Python: named tuples would cost more.

    Args:
        pairs: some pairs, shape (k,).
        W: their compliance, shape (k, k).
        gap: see `closing_pairs`.
        rate: see `closing_pairs`.
        free: see `closing_pairs`.
        noise: see `solve_among`.
        hit: result: pairs of `HitPairs`.
        values: result: its other members, one below the other.
        tables: members of `PairState` before; result: those from now on; members of `LawNumbers`.

    Returns:
        Number of hit pairs, the first entries; result of `solve_among`, NOTHING, or OTHERS if not
        `pairs`, but the first entries are the candidates; whether other pairs rest.
    """
    before = PairState(*tables[:_BEFORE])
    after = PairState(*tables[_BEFORE:_AFTER])
    law = LawNumbers(*tables[_AFTER:])
    hits = HitPairs(hit, values[0], values[1], values[2], values[3], values[4])
    result = complementarity.SOLVED
    n, changes = closing_pairs(law, gap.size, gap, rate, free, before, hits)
    if n and not needs_impulse(hits, n, noise):
        n = 0
    if not n and not changes:
        return 0, NOTHING, False
    if n and (n != pairs.size or (pairs != hits.pair[:n]).any()):
        return n, OTHERS, False
    if n:
        memory = complementarity.fresh(n)
        n, result = solve_impulses(law, (W.T.ravel(), 0, n), np.arange(n), n, hits, noise, memory)
    after.resting[:] = before.resting
    changed = renew_resting(law, gap.size, gap, n, hits, after)
    return n, result, changed
