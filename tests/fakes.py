"""Candidate states and compliances given by hand, for tests of contact laws."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from delam_fem.api import LawContext
from delam_fem.contact.decisions import NO_BLOCK, PairState


@dataclass
class Seen:
    """Kinematics given by hand."""

    gap: np.ndarray
    rate: np.ndarray
    pair_state: PairState
    free: np.ndarray | None = None
    noise: float = 0.0

    def rate_pre(self) -> np.ndarray:
        return self.rate

    def rate_free(self) -> np.ndarray:
        return self.rate if self.free is None else self.free

    def rate_noise(self) -> float:
        return self.noise


@dataclass
class Matrix:
    """A compliance given by hand."""

    W: np.ndarray
    recent = NO_BLOCK

    def diagonal(self, pairs: np.ndarray) -> np.ndarray:
        return self.W[pairs, pairs]

    def block(self, pairs: np.ndarray) -> np.ndarray:
        return self.W[np.ix_(pairs, pairs)]

    def columns(self, pairs: np.ndarray) -> np.ndarray:
        return self.W[:, pairs]


def seen(
    gap: list[float],
    rate: list[float],
    resting: list[bool] | None = None,
    free: list[float] | None = None,
) -> Seen:
    """Return a candidate state; no pair rests unless given."""
    pairs = PairState.at_start(len(gap))
    if resting is not None:
        pairs.resting[:] = resting
    return Seen(np.array(gap), np.array(rate), pairs, None if free is None else np.array(free))


def setting(W: np.ndarray) -> LawContext:
    """Return the setting of a law for a compliance."""
    return LawContext(W.shape[0], Matrix(W))
