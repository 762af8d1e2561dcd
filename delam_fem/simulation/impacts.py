"""Store the impacts of a period in columns, so that many impacts cost as little as few."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain
from typing import NamedTuple

import numpy as np

from delam_fem.contact.decision import Decision
from delam_fem.numerics.arrays import FloatArray, IntArray


class Columns(NamedTuple):
    """A table of n impacts and a table of the pairs that they hit, both in the order of time.

    Attributes:
        ticks: time of each impact, as a number of fine steps from the start, shape (n,).
        sizes: number of pairs that each impact hit, shape (n,).
        energies: energy that each impact added, shape (n,) [J].
        hit: pairs that were hit, impact after impact, shape (sum of sizes,).
        impulses: impulses on these pairs, shape (sum of sizes,) [N s].
        rate_pre: gap rates of these pairs before the impact, shape (sum of sizes,) [m/s].
        rate_post: gap rates of these pairs after the impact, shape (sum of sizes,) [m/s].
    """

    ticks: IntArray
    sizes: IntArray
    energies: FloatArray
    hit: IntArray
    impulses: FloatArray
    rate_pre: FloatArray
    rate_post: FloatArray

    @classmethod
    def room(cls, n: int, n_hits: int) -> Columns:
        """Return empty columns for n impacts on `n_hits` pairs in all."""
        ticks, sizes, hit = np.zeros(n, np.int64), np.zeros(n, np.int64), np.zeros(n_hits, np.int64)
        impulses, rate_pre, rate_post = np.zeros((3, n_hits))
        return cls(ticks, sizes, np.zeros(n), hit, impulses, rate_pre, rate_post)

    def part(self, impacts: tuple[int, int], hits: tuple[int, int]) -> Columns:
        """Return the impacts, and the hit pairs, from the first to before the last, uncopied."""
        places = [slice(*impacts)] * 3 + [slice(*hits)] * 4
        return Columns._make(a[place] for a, place in zip(self, places, strict=True))

    def copy(self) -> Columns:
        """Return a copy."""
        return Columns._make(a.copy() for a in self)


_NONE = Columns.room(0, 0)


class Jumps:
    """The impacts of a period in the order of time; iteration yields (tick, decision, energy)."""

    def __init__(self, *parts: Columns) -> None:
        """Start with the impacts of some columns, or with none."""
        self._columns = [part for part in parts if part.ticks.size]
        self._single: list[tuple[int, Decision, float]] = []

    def append(self, tick: int, decision: Decision, energy: float) -> None:
        """Add the impact of a decision that hits at least one pair."""
        self._single.append((tick, decision, energy))

    @property
    def _parts(self) -> list[Columns]:
        """Columns of all impacts, after those that came one by one have become columns."""
        if self._single:
            ticks, decisions, energies = zip(*self._single, strict=True)
            columns = zip(*(d[:4] for d in decisions), strict=True)
            joined = [np.array([*chain(*map(np.ndarray.tolist, column))]) for column in columns]
            sizes = np.array([d.hit.size for d in decisions])
            self._columns.append(Columns(np.array(ticks), sizes, np.array(energies), *joined))
            self._single = []
        return self._columns

    def extend(self, columns: Columns) -> None:
        """Add the impacts of columns, which must not be changed afterwards."""
        self._parts.append(columns)  # behind those that came one by one

    def columns(self) -> Columns:
        """Return the columns of all impacts."""
        if len(self._parts) == 1:
            return self._parts[0]
        return Columns(*map(np.concatenate, zip(_NONE, *self._parts, strict=True)))

    def hit_within(self, first: int, last: int) -> IntArray:
        """Return the pairs hit by impacts after the tick `first`, up to the tick `last`."""
        found = [_NONE.hit]
        for part in reversed(self._parts):
            n_before = int(np.searchsorted(part.ticks, first, side="right"))
            n_until = int(np.searchsorted(part.ticks, last, side="right"))
            start = int(part.sizes[:n_before].sum())
            found.append(part.hit[start : start + int(part.sizes[n_before:n_until].sum())])
            if n_before:
                break
        return np.concatenate(found)

    def __len__(self) -> int:
        """Return the number of impacts."""
        return sum(part.ticks.size for part in self._parts)

    def __iter__(self) -> Iterator[tuple[int, Decision, float]]:
        """Yield tick, decision and energy of each impact."""
        for part in self._parts:
            first = 0
            for tick, size, energy in zip(part.ticks, part.sizes, part.energies, strict=True):
                own, first = slice(first, first + size), first + size
                hits = part.hit[own], part.impulses[own], part.rate_pre[own], part.rate_post[own]
                yield int(tick), Decision(*hits), float(energy)
