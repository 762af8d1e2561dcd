"""The contact supervisor: which pairs are hit, rest on a spring, or are let go.

Between two steps it looks at gaps and gap rates and returns a `Decision`, or None when nothing
jumps. It never touches the state: the stepper carries the decision out and renews its
acceleration.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from delam_fem.contact.impulses import coupled_impulses, separate_impulses
from delam_fem.numerics.arrays import BoolArray, FloatArray, IntArray

NO_PAIRS: IntArray = np.zeros(0, dtype=np.int64)
NO_VALUES: FloatArray = np.zeros(0)


class Kinematics(Protocol):
    """What a stepper shows to a supervisor after a candidate step."""

    @property
    def gap(self) -> FloatArray:
        """Gaps that the law examines, shape (n_pairs,) [m]."""

    def rate_pre(self) -> FloatArray:
        """Return gap rates before an impact, shape (n_pairs,) [m/s]."""

    def rate_free(self) -> FloatArray:
        """Return gap rates if no impulse acted, shape (n_pairs,) [m/s]."""


class Compliance(Protocol):
    """W = H M^-1 H^T of the mass that impulses act on."""

    def diagonal(self, pairs: IntArray) -> FloatArray:
        """Return W_kk of some pairs, shape (k,) [1/kg]."""

    def block(self, pairs: IntArray) -> FloatArray:
        """Return W of some pairs among themselves, shape (k, k) [1/kg]."""


@dataclass(frozen=True)
class Decision:
    """What has to jump.

    Attributes:
        hit: pairs that receive an impulse, shape (k,).
        impulses: their impulses, shape (k,) [N s].
        rate_pre: their gap rates before, shape (k,) [m/s].
        rate_post: their gap rates after, shape (k,) [m/s].
        permanent: pairs that carry a spring from now on, shape (n_pairs,); None: as before.
    """

    hit: IntArray
    impulses: FloatArray
    rate_pre: FloatArray
    rate_post: FloatArray
    permanent: BoolArray | None = None


class Supervisor(Protocol):
    """A contact law with its memory."""

    permanent: BoolArray
    """Pairs that carry a spring now, shape (n_pairs,)."""
    is_holding: bool
    """Whether any pair carries a spring, so that the law must look even at open gaps."""

    def examine(self, seen: Kinematics) -> Decision | None:
        """Return what jumps at this instant, None if nothing does."""

    def restore(self, permanent: BoolArray) -> None:
        """Take over the memory of an earlier run."""


class Memory:
    """The set P of pairs that carry a spring."""

    def __init__(self, n_pairs: int) -> None:
        """Begin with no springs."""
        self.restore(np.zeros(n_pairs, dtype=np.bool_))

    def restore(self, permanent: BoolArray) -> None:
        """Take over the memory of an earlier run."""
        self.permanent = permanent
        self._key = permanent.tobytes()
        self.is_holding = bool(permanent.any())


class NoContact(Memory):
    """Law "none": the laminae pass through one another."""

    def examine(self, seen: Kinematics) -> Decision | None:
        """Return None."""
        return None


class Impacts(Memory):
    """Laws "newton" (paper 3.1) and "newton-penalty" (paper 3.2, eq. 17 as corrected).

    At the end of a step, in this order: springs whose gap has opened are released; closed
    approaching pairs without a spring are hit; of those, pairs that leave slower than the
    threshold get a spring.
    """

    def __init__(
        self,
        compliance: Compliance,
        *,
        n_pairs: int,
        restitution: float,
        coupled: bool,
        threshold_velocity: float | None = None,
    ) -> None:
        """Set the law up.

        Args:
            compliance: W of the mass that impulses act on.
            n_pairs: number of contact pairs.
            restitution: e [-].
            coupled: solve simultaneous impacts together ("consistent") or each alone ("lumped").
            threshold_velocity: γ [m/s]; None: pairs never rest on a spring (law "newton").
        """
        super().__init__(n_pairs)
        self._compliance = compliance
        self._restitution = restitution
        self._coupled = coupled
        self._threshold = threshold_velocity

    def examine(self, seen: Kinematics) -> Decision | None:
        """Return the impacts and the new set of springs at the end of a step."""
        closed = seen.gap <= 0.0
        if closed.tobytes() == self._key:
            return None
        rate = seen.rate_pre()
        hit = np.flatnonzero(closed & ~self.permanent & (rate < 0.0))
        kept = self.permanent & closed
        if not hit.size:
            if kept.tobytes() == self._key:
                return None
            self.restore(kept)
            return Decision(NO_PAIRS, NO_VALUES, NO_VALUES, NO_VALUES, kept)
        rate_pre = rate[hit]
        impulses, rate_post = self._impact(hit, rate_pre)
        if self._threshold is not None:
            kept[hit[rate_post < self._threshold]] = True
        if kept.tobytes() == self._key:
            return Decision(hit, impulses, rate_pre, rate_post)
        self.restore(kept)
        return Decision(hit, impulses, rate_pre, rate_post, kept)

    def _impact(self, hit: IntArray, rate_pre: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return impulses and gap rates after."""
        if self._coupled:
            W = self._compliance.block(hit)
            impulses = coupled_impulses(rate_pre, rate_pre, self._restitution, W)
            return impulses, rate_pre + W @ impulses
        inverse_mass = self._compliance.diagonal(hit)
        impulses = separate_impulses(rate_pre, self._restitution, inverse_mass)
        return impulses, -self._restitution * rate_pre


class PenaltySprings(Memory):
    """Law "penalty": every closed pair carries a spring and damper, none is hit."""

    def examine(self, seen: Kinematics) -> Decision | None:
        """Return the new set of springs at the end of a step."""
        closed = seen.gap <= 0.0
        if closed.tobytes() == self._key:
            return None
        self.restore(closed)
        return Decision(NO_PAIRS, NO_VALUES, NO_VALUES, NO_VALUES, closed)
