"""What a contact law sees, what it answers, and the numbers by which it decides.

A stepper makes a candidate state and shows it as `Kinematics`. A law answers with a `Decision`, or
with None if nothing jumps. Laws keep no state: the stepper owns what is remembered of the pairs
(`PairState`), shows it to the law, and carries decisions out.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from delam_fem.numerics.types import BoolArray, FloatArray, IntArray

NO_PAIRS: IntArray = np.zeros(0, dtype=np.int64)


class PairState(NamedTuple):
    """What is remembered of the pairs from step to step: all that a law may build on.

    Engines show it to the law and take over that of a decision; states, checkpoints and the
    journals of sweeps carry all members.

    Attributes:
        resting: pairs at rest on one another, shape (n_pairs,). With Newmark they carry a spring.
    """

    resting: BoolArray

    @classmethod
    def at_start(cls, n_pairs: int) -> PairState:
        """Return what is remembered before the first step: no pair rests."""
        return cls(np.zeros(n_pairs, dtype=np.bool_))

    def copy(self) -> PairState:
        """Return a copy."""
        return PairState._make(values.copy() for values in self)


class Kinematics(Protocol):
    """A candidate state as a contact law sees it."""

    pair_state: PairState
    """What is remembered of the pairs."""

    @property
    def gap(self) -> FloatArray:
        """Gaps that the law examines, shape (n_pairs,) [m]."""

    def rate_pre(self) -> FloatArray:
        """Return gap rates before an impact, shape (n_pairs,) [m/s]."""

    def rate_free(self) -> FloatArray:
        """Return gap rates if no impulse acted, shape (n_pairs,) [m/s]."""

    def rate_noise(self) -> float:
        """Return the gap rate up to which there may be nothing but round-off [m/s].

        It is 0 where no pair touches at rest.
        """


NO_BLOCK = np.empty(0, np.int64), np.empty((0, 0))
"""No pairs, and their block of a compliance."""


class Compliance(Protocol):
    """W = H B⁻¹ Hᵀ, where B is the matrix through which impulses act."""

    @property
    def recent(self) -> tuple[IntArray, FloatArray]:
        """The pairs that `block` was asked for last and their block, or `NO_BLOCK`."""

    def diagonal(self, pairs: IntArray) -> FloatArray:
        """Return W_kk of some pairs, shape (k,) [1/kg]."""

    def block(self, pairs: IntArray) -> FloatArray:
        """Return the rows and columns of W of some pairs, shape (k, k) [1/kg]."""


class HitPairs(NamedTuple):
    """Pairs that an impulse may part, or has parted: the first entries of each array.

    Attributes:
        pair: their numbers.
        rate_pre: their gap rates before the impact [m/s].
        rate_post: those after it; before the impulses are known, those without impulses [m/s].
        lacking: what the gap rates after the impact lack without impulses, if it is below 0 [m/s].
        impulse: impulses [N s].
        change: by what the impulses change the gap rates [m/s].
    """

    pair: IntArray
    rate_pre: FloatArray
    rate_post: FloatArray
    lacking: FloatArray
    impulse: FloatArray
    change: FloatArray

    @classmethod
    def room(cls, n_pairs: int) -> HitPairs:
        """Return room for all pairs."""
        return cls(np.zeros(n_pairs, dtype=np.int64), *np.zeros((5, n_pairs)))


class Decision(NamedTuple):
    """The jumps that a law demands.

    Attributes:
        hit: pairs that receive an impulse, shape (k,).
        impulses: impulses of the hit pairs, shape (k,) [N s].
        rate_pre: their gap rates before the impact, shape (k,) [m/s].
        rate_post: their gap rates after the impact, shape (k,) [m/s].
        pair_state: what is remembered of the pairs from now on; None: the same as before.
    """

    hit: IntArray
    impulses: FloatArray
    rate_pre: FloatArray
    rate_post: FloatArray
    pair_state: PairState | None = None


class Supervisor(Protocol):
    """A contact law, set up for one problem."""

    def examine(self, seen: Kinematics) -> Decision | None:
        """Return the jumps at this instant, or None if nothing jumps."""


@dataclass(frozen=True, eq=False)
class PairNumbers:
    """Numbers that pairs have of their own, in place of those of the law; NaN: that of the law.

    Attributes:
        is_elastic: pairs that are springs while they are closed, in any law, shape (n_pairs,).
        restitution: e, shape (n_pairs,) [-].
        relaxation: damping over stiffness of a pair's spring, shape (n_pairs,) [s].
        threshold: γ, shape (n_pairs,) [m/s].
        shares: factors of the springs of the pairs before their own stiffnesses, shape (n_pairs,);
            `Operators.pair_weights` has both.
    """

    is_elastic: BoolArray
    restitution: FloatArray
    relaxation: FloatArray
    threshold: FloatArray
    shares: FloatArray


@dataclass(frozen=True)
class LawContext:
    """The problem for which a law is set up.

    Attributes:
        n_pairs: number of contact pairs.
        compliance: W of the matrix through which impulses act.
        pair_numbers: numbers that pairs have of their own; None: all follow the law.
    """

    n_pairs: int
    compliance: Compliance
    pair_numbers: PairNumbers | None = None


NONE, IMPACTS, PENALTY, MOREAU = range(4)
"""Kinds of decisions: none, impacts between two steps, springs, impulses within a step."""


IS_ELASTIC, RESTITUTION, DAMPING, THRESHOLD = range(4)
N_OF_PAIR = 4
"""Places, and count, of the numbers of a pair in `LawNumbers.of_pairs`."""


class LawNumbers(NamedTuple):
    """The numbers of a law of the table with a scheme.

    Attributes:
        kind: NONE, IMPACTS, PENALTY or MOREAU.
        is_coupled: whether simultaneous impacts influence one another ("consistent").
        restitution: e [-].
        stiffness: stiffness of a pair's spring [N/m].
        damping: damping of a pair's spring [N s/m].
        threshold: speed limit for resting pairs [m/s]. IMPACTS: a pair that leaves slower than this
            rests on a spring; -inf: never. MOREAU: a pair that approaches slower than this counts
            as resting.
        differ: whether pairs have different numbers. Those of `of_pairs` then count; the others are
            those of a pair without numbers of its own.
        of_pairs: whether each pair is a spring while it is closed, its e, damping and threshold,
            one pair after the other, shape (4 n_pairs,); empty if all pairs are alike.
    """

    kind: int
    is_coupled: bool = False
    restitution: float = 0.0
    stiffness: float = 0.0
    damping: float = 0.0
    threshold: float = -np.inf
    differ: bool = False
    of_pairs: FloatArray = np.zeros(0)

    @property
    def table(self) -> FloatArray:
        """The numbers of pairs that differ, shape (n_pairs, 4); without rows if they are alike."""
        return self.of_pairs.reshape(-1, N_OF_PAIR)

    def closes_springs(self, n_pairs: int) -> BoolArray:
        """Return which pairs are springs whenever they are closed, shape (n_pairs,)."""
        if self.differ:
            return np.asarray(self.table[:, IS_ELASTIC] != 0.0)
        return np.full(n_pairs, self.kind == PENALTY)

    def has_springs(self, n_pairs: int) -> BoolArray:
        """Return which pairs may carry a spring, shape (n_pairs,)."""
        if self.kind == IMPACTS and self.threshold == -np.inf:
            return self.closes_springs(n_pairs)
        return np.full(n_pairs, self.kind in (IMPACTS, PENALTY))

    def dampings(self, n_pairs: int) -> FloatArray:
        """Return the damping of a spring of weight 1 at each pair, shape (n_pairs,) [N s/m]."""
        return self.table[:, DAMPING].copy() if self.differ else np.full(n_pairs, self.damping)

    def thresholds(self, n_pairs: int) -> FloatArray:
        """Return the threshold of each pair, shape (n_pairs,) [m/s]."""
        return self.table[:, THRESHOLD].copy() if self.differ else np.full(n_pairs, self.threshold)
