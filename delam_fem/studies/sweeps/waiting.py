"""Keep the points of a sweep that wait, without a list of them all."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from delam_fem.numerics.arrays import IntArray

Segment = range | IntArray
"""Indices of points in the order in which they are computed."""


class Waiting:
    """Indices of points that wait, in order: ranges, or arrays where the order is another one."""

    def __init__(self, segments: Iterable[Segment]) -> None:
        """Store segments, in order; empty ones are left out."""
        self._segments = deque(segment for segment in segments if len(segment))
        self._size = sum(len(segment) for segment in self._segments)

    @classmethod
    def all_but(cls, done: IntArray, items: Segment) -> Waiting:
        """Return the items that are not done; both increase."""
        if isinstance(items, range):
            return cls(_gaps(done, len(items)))
        return cls([items[~np.isin(items, done, assume_unique=True)]])

    def __len__(self) -> int:
        """Return the number of points that wait."""
        return self._size

    def take(self, count: int) -> tuple[int, ...]:
        """Remove the first points and return them; at most `count`."""
        taken: list[int] = []
        while self._segments and len(taken) < count:
            segment = self._segments.popleft()
            n = count - len(taken)
            first = segment[:n]
            taken.extend(first if isinstance(first, range) else first.tolist())
            if len(segment) > n:
                self._segments.appendleft(segment[n:])
        self._size -= len(taken)
        return tuple(taken)

    def put_back(self, indices: Sequence[int]) -> None:
        """Put points that were taken back to the front."""
        self._segments.appendleft(np.asarray(indices, dtype=np.int64))
        self._size += len(indices)


def _gaps(done: IntArray, count: int) -> Iterator[range]:
    """Yield the ranges between finished points."""
    starts = np.concatenate([np.zeros(1, dtype=np.int64), done + 1])
    stops = np.append(done, count)
    for k in np.flatnonzero(starts < stops).tolist():
        yield range(int(starts[k]), int(stops[k]))
