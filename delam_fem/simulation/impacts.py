"""The impacts of a period, in columns: a period of many impacts costs as little as one of few."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from delam_fem.contact.decision import Decision
from delam_fem.numerics.arrays import FloatArray, IntArray


class Columns(NamedTuple):
    """Impacts one after the other, and the pairs that they hit one after the other.

    Attributes:
        steps: step at the end of which each impact happened, shape (n,).
        sizes: pairs that it hit, shape (n,).
        energies: energy that it added, shape (n,) [J].
        hit: pairs, shape (sum of sizes,).
        impulses: on these, likewise [N s].
        rate_pre, rate_post: their gap rates before and after, likewise [m/s].
    """

    steps: IntArray
    sizes: IntArray
    energies: FloatArray
    hit: IntArray
    impulses: FloatArray
    rate_pre: FloatArray
    rate_post: FloatArray

    @classmethod
    def room(cls, n: int, n_hits: int) -> Columns:
        """Return room for so many impacts and hits."""
        steps, sizes, hit = np.zeros(n, np.int64), np.zeros(n, np.int64), np.zeros(n_hits, np.int64)
        impulses, rate_pre, rate_post = np.zeros((3, n_hits))
        return cls(steps, sizes, np.zeros(n), hit, impulses, rate_pre, rate_post)

    def first(self, n: int, n_hits: int) -> Columns:
        """Return a copy of the first impacts and hits."""
        lengths = (n, n, n, n_hits, n_hits, n_hits, n_hits)
        return Columns._make(a[:k].copy() for a, k in zip(self, lengths, strict=True))


_NONE = Columns.room(0, 0)


class Jumps:
    """Impacts in the order in which they happened; iteration gives (step, decision, energy)."""

    def __init__(self, *parts: Columns) -> None:
        """Begin with some impacts, or none."""
        self._parts = [part for part in parts if part.steps.size]

    def append(self, step: int, decision: Decision, energy: float) -> None:
        """Add the impact of a decision that hits somebody."""
        d = decision
        instant = np.array([step]), np.array([d.hit.size]), np.array([energy])
        self._parts.append(Columns(*instant, d.hit, d.impulses, d.rate_pre, d.rate_post))

    def extend(self, columns: Columns) -> None:
        """Add impacts; the columns are not to be written to afterwards."""
        self._parts.append(columns)

    def columns(self) -> Columns:
        """Return all impacts in one table."""
        if len(self._parts) == 1:
            return self._parts[0]
        return Columns(*map(np.concatenate, zip(_NONE, *self._parts, strict=True)))

    def hit_at(self, step: int) -> IntArray:
        """Return the pairs that the last impact hit, none where it was not at this step."""
        if not self._parts or self._parts[-1].steps[-1] != step:
            return _NONE.hit
        last = self._parts[-1]
        return last.hit[last.hit.size - int(last.sizes[-1]) :]

    def __len__(self) -> int:
        """Return the number of impacts."""
        return sum(part.steps.size for part in self._parts)

    def __iter__(self) -> Iterator[tuple[int, Decision, float]]:
        """Give step, decision and energy of each impact."""
        for part in self._parts:
            first = 0
            for step, size, energy in zip(part.steps, part.sizes, part.energies, strict=True):
                own, first = slice(first, first + size), first + size
                hits = part.hit[own], part.impulses[own], part.rate_pre[own], part.rate_post[own]
                yield int(step), Decision(*hits), float(energy)
