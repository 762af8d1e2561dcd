"""What a contact law sees, what it answers, and the numbers by which it decides.

A stepper makes a candidate state and shows it as `Kinematics`. A law answers with a `Decision`, or
with None if nothing jumps. Laws keep no state: the stepper owns the set of resting pairs, shows it
to the law, and carries decisions out.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from delam_fem.numerics.types import BoolArray, FloatArray, IntArray

NO_PAIRS: IntArray = np.zeros(0, dtype=np.int64)


class Kinematics(Protocol):
    """A candidate state as a contact law sees it."""

    resting: BoolArray
    """Pairs at rest on one another, shape (n_pairs,). With Newmark they carry a spring."""

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


class Decision(NamedTuple):
    """The jumps that a law demands.

    Attributes:
        hit: pairs that receive an impulse, shape (k,).
        impulses: impulses of the hit pairs, shape (k,) [N s].
        rate_pre: their gap rates before the impact, shape (k,) [m/s].
        rate_post: their gap rates after the impact, shape (k,) [m/s].
        resting: pairs at rest from now on, shape (n_pairs,); None: the same as before.
    """

    hit: IntArray
    impulses: FloatArray
    rate_pre: FloatArray
    rate_post: FloatArray
    resting: BoolArray | None = None


class Supervisor(Protocol):
    """A contact law, set up for one problem."""

    def examine(self, seen: Kinematics) -> Decision | None:
        """Return the jumps at this instant, or None if nothing jumps."""


@dataclass(frozen=True)
class Setting:
    """The problem for which a law is set up.

    Attributes:
        n_pairs: number of contact pairs.
        compliance: W of the matrix through which impulses act.
    """

    n_pairs: int
    compliance: Compliance


NONE, IMPACTS, PENALTY, MOREAU = range(4)
"""Kinds of decisions: none, impacts between two steps, springs, impulses within a step."""


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
    """

    kind: int
    is_coupled: bool = False
    restitution: float = 0.0
    stiffness: float = 0.0
    damping: float = 0.0
    threshold: float = -np.inf
