"""The interface between contact laws and steppers.

A stepper makes a candidate state and shows it as `Kinematics`. A law answers with a `Decision`, or
with None if nothing jumps. Laws keep no state: the stepper owns the set of resting pairs, shows it
to the law, and carries decisions out.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from delam_fem.numerics.arrays import BoolArray, FloatArray, IntArray

NO_PAIRS: IntArray = np.zeros(0, dtype=np.int64)
NO_VALUES: FloatArray = np.zeros(0)


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


class Compliance(Protocol):
    """W = H B⁻¹ Hᵀ, where B is the matrix through which impulses act."""

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

    @classmethod
    def only_resting(cls, resting: BoolArray) -> Decision:
        """Return a decision that hits no pair and only changes which pairs rest."""
        return cls(NO_PAIRS, NO_VALUES, NO_VALUES, NO_VALUES, resting)


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


def is_same_set(first: BoolArray, second: BoolArray) -> bool:
    """Return whether two sets of pairs are equal.

    This runs in every step with contact. Comparing bytes takes a tenth of the time of
    `numpy.array_equal`.
    """
    return first.tobytes() == second.tobytes()
