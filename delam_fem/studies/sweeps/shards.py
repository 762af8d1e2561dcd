"""Share the points of a sweep among machines that do not talk to each other.

A share depends on the sweep, the number of shards and nothing else. Points (or whole tracks) are
dealt in rounds: every round gives each shard one of n neighbours. A hash of the round says who
begins, so that a shard does not get the same value of an axis again and again.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from delam_fem.case.toml import CaseError
from delam_fem.numerics.arrays import IntArray

MOST_SHARDS = 100_000
_NAME = re.compile(r"(\d+)-of-(\d+)")
# constants of the hash splitmix64, which change the shares for ever if they are changed
_STEP, _FIRST, _SECOND = 0x9E3779B97F4A7C15, 0xBF58476D1CE4E5B9, 0x94D049BB133111EB


@dataclass(frozen=True)
class Shard:
    """A share of the points of a sweep.

    Attributes:
        number: of the shard, from 1.
        of: number of shards.
    """

    number: int
    of: int

    @property
    def name(self) -> str:
        """Name of the shard in names of files."""
        return f"{self.number}-of-{self.of}"

    @property
    def is_whole(self) -> bool:
        """Whether the share is the whole sweep."""
        return self.of == 1

    def __str__(self) -> str:
        """Return the shard as the command line takes it."""
        return f"{self.number}/{self.of}"

    def items(self, count: int) -> IntArray | range:
        """Return which of `count` points or tracks the shard has; they increase."""
        if self.is_whole:
            return range(count)
        rounds: IntArray = np.arange(-(-count // self.of), dtype=np.int64)
        items = rounds * self.of + (self.number - 1 + _beginners(rounds, self.of)) % self.of
        return items[items < count]


WHOLE = Shard(1, 1)


def parse_shard(text: str) -> Shard:
    """Return the shard `k/n`.

    Raises:
        CaseError: the text is something else, or k is not between 1 and n.
    """
    number, slash, of = text.partition("/")
    if slash and number.strip().isdecimal() and of.strip().isdecimal():
        shard = Shard(int(number), int(of))
        if 1 <= shard.number <= shard.of <= MOST_SHARDS:
            return shard
    raise CaseError(
        f"shard: expected K/N with K from 1 to N and N up to {MOST_SHARDS}, for example 3/16, "
        f"given {text[:40]!r}"
    )


def named(text: str) -> Shard | None:
    """Return the shard that a name of a file begins with; None without one."""
    found = _NAME.match(text)
    return Shard(int(found[1]), int(found[2])) if found else None


def owners(items: IntArray, of: int) -> IntArray:
    """Return the numbers of the shards that have the given points or tracks, shape (n,)."""
    found = (items % of - _beginners(items // of, of)) % of + 1
    return np.asarray(found, dtype=np.int64)


def _beginners(rounds: IntArray, of: int) -> IntArray:
    """Return the place of the first shard in each round, from 0: a hash of the round."""
    x: npt.NDArray[np.uint64] = rounds.astype(np.uint64)
    with np.errstate(over="ignore"):
        x = (x + np.uint64(1)) * np.uint64(_STEP)
        x = (x ^ (x >> np.uint64(30))) * np.uint64(_FIRST)
        x = (x ^ (x >> np.uint64(27))) * np.uint64(_SECOND)
    x = x ^ (x >> np.uint64(31))
    return (x % np.uint64(of)).astype(np.int64)
