"""Share points among machines, and submit them to an executor in chunks of about equal time.

The machines do not talk to each other: a share depends on the sweep, the number of shards and
nothing else. Points (or whole tracks) are dealt in rounds: every round gives each shard one of n
neighbours. A hash of the round says who begins, so that a shard does not get the same value of an
axis again and again.

Any `concurrent.futures.Executor` can be used. The points of a track are computed one after another;
all other points go to any free worker.
"""

from __future__ import annotations

import math
import re
from collections import deque
from collections.abc import Callable, Iterable
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, wait
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from delam_fem.api import CaseError, IntArray, State
from delam_fem.studies.sweeps.point import Chunk, ChunkResult, Point, compute

MOST_SHARDS = 100_000
_NAME = re.compile(r"(\d{1,6})-of-(\d{1,6})")
# constants of the hash splitmix64, which change the shares for ever if they are changed
_STEP, _FIRST, _SECOND = 0x9E3779B97F4A7C15, 0xBF58476D1CE4E5B9, 0x94D049BB133111EB


@dataclass(frozen=True)
class Shard:
    """A share of the points of a sweep.

    Attributes:
        number: number of the shard, from 1.
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

    def items(self, count: int) -> IntArray:
        """Return which of `count` points or tracks the shard has, in increasing order."""
        if self.is_whole:
            return np.arange(count)
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
    """Return the shard at the beginning of the name of a file; None without one."""
    match = _NAME.match(text)
    return Shard(int(match[1]), int(match[2])) if match else None


def owners(items: IntArray, of: int) -> IntArray:
    """Return for given points or tracks the number of the shard that has each, shape (n,)."""
    shards = (items % of - _beginners(items // of, of)) % of + 1
    return np.asarray(shards, dtype=np.int64)


def _beginners(rounds: IntArray, of: int) -> IntArray:
    """Return the place of the first shard in each round, from 0: a hash of the round."""
    x: npt.NDArray[np.uint64] = rounds.astype(np.uint64)
    with np.errstate(over="ignore"):
        x = (x + np.uint64(1)) * np.uint64(_STEP)
        x = (x ^ (x >> np.uint64(30))) * np.uint64(_FIRST)
        x = (x ^ (x >> np.uint64(27))) * np.uint64(_SECOND)
    x = x ^ (x >> np.uint64(31))
    return (x % np.uint64(of)).astype(np.int64)


CHUNK_SECONDS = 0.5
"""Target time of a chunk [s]: a hundred times the cost of submitting one."""
SHARE = 4
"""Minimum number of chunks per worker, so that all workers finish together."""
IN_FLIGHT = 2
"""Number of submitted chunks per worker, so that no worker waits for the parent."""
MOST = 10_000
"""Largest number of points in a chunk."""
MOST_DEATHS = 5
"""Number of workers that may die before any point is finished."""
POLL = 0.2
"""Longest time until a stop is noticed [s]."""
INDEPENDENT = -1
"""Track number of points that can be computed in any order."""


@dataclass(eq=False)
class Track:
    """Points of a track that are not submitted yet, in order.

    Attributes:
        number: number of the track, or `INDEPENDENT`.
        waiting: indices of the points, shape (n,).
        state: state from which the first one starts; None: from its initial conditions.
    """

    number: int
    waiting: IntArray
    state: State | None = None

    def put_back(self, chunk: Chunk) -> None:
        """Put the points of a chunk back to the front."""
        self.waiting = np.concatenate([chunk.indices, self.waiting])


@dataclass
class Schedule:
    """The points that are waiting or submitted, and the executor that computes them.

    Attributes:
        packed: the pickled sweep.
        n_workers: number of workers of the executor.
        ready: tracks from which a chunk can be submitted now.
        executor: the executor.
        renew: function that replaces an executor after a worker died; None if it cannot be
            replaced.
        busy: time in which workers computed [s].
        idle: time in which workers waited between chunks [s].
        cost: recent mean time of a point; 0 if no point is finished [s].
    """

    packed: bytes
    n_workers: int
    ready: deque[Track]
    executor: Executor
    renew: Callable[[], Executor] | None = None
    busy: float = 0.0
    idle: float = 0.0
    cost: float = 0.0
    _flying: dict[Future[ChunkResult], tuple[Track, Chunk]] = field(default_factory=dict)
    _suspects: int = 0  # points that may have killed a worker, each now submitted alone
    _deaths: int = 0

    @property
    def overhead(self) -> float:
        """Share of their time in which workers waited between chunks [-]."""
        total = self.busy + self.idle
        return self.idle / total if total > 0.0 else 0.0

    def run(
        self, take_in: Callable[[list[ChunkResult]], None], is_stopped: Callable[[], bool]
    ) -> bool:
        """Compute all waiting points.

        Args:
            take_in: function that takes the results of finished chunks, as soon as they arrive.
            is_stopped: function that says whether to submit no more chunks and to end after the
                running ones.

        Returns:
            Whether all points were computed.

        Raises:
            BrokenExecutor: a worker died, and the executor cannot be replaced.
            CaseError: several workers died before any point was finished.
        """
        while True:
            if is_stopped():
                for future, (track, chunk) in list(self._flying.items()):
                    if future.cancel():  # no worker has begun it
                        del self._flying[future]
                        track.put_back(chunk)
                        if track not in self.ready:
                            self.ready.append(track)
            else:
                self._hand_out()
            if not self._flying:
                return not self.ready
            landed, _ = wait(self._flying, timeout=POLL, return_when=FIRST_COMPLETED)
            results = self._land(landed)
            if results:
                if not is_stopped():
                    self._hand_out()  # workers compute while the results are written
                take_in(results)

    def _hand_out(self) -> None:
        """Submit chunks until every worker has enough, or single points after a worker died."""
        limit = 1 if self._suspects else IN_FLIGHT * self.n_workers
        while self.ready and len(self._flying) < limit:
            track = self.ready.popleft()
            n = self._chunk_size(track)
            indices, track.waiting = track.waiting[:n], track.waiting[n:]
            chunk = Chunk(track.number, tuple(indices.tolist()), track.state)
            if track.number == INDEPENDENT and track.waiting.size:
                self.ready.append(track)
            self._flying[self._submitted(chunk)] = (track, chunk)

    def _submitted(self, chunk: Chunk) -> Future[ChunkResult]:
        """Submit a chunk; on a broken executor return a future with the error."""
        try:
            return self.executor.submit(compute, self.packed, chunk)
        except BrokenExecutor as error:
            broken: Future[ChunkResult] = Future()
            broken.set_exception(error)
            return broken

    def _chunk_size(self, track: Track) -> int:
        """Return the number of points for the next chunk of a track."""
        if self._suspects or self.cost <= 0.0:
            return 1
        left = track.waiting.size
        n = min(int(CHUNK_SECONDS / self.cost), left, MOST)
        if track.number == INDEPENDENT and self.n_workers > 1:
            n = min(n, math.ceil(left / (SHARE * self.n_workers)))
        return max(1, n)

    def _land(self, futures: Iterable[Future[ChunkResult]]) -> list[ChunkResult]:
        """Return the results of finished futures; recover the points of a dead worker."""
        results = []
        lost = []
        for future in futures:
            track, chunk = self._flying.pop(future)
            try:
                done = future.result()
            except BrokenExecutor:
                lost.append((track, chunk))
                continue
            self._suspects = max(0, self._suspects - len(chunk.indices))
            recent = done.seconds / len(done.points)
            # the first point of a worker includes imports; a much smaller time replaces it at once
            self.cost = (
                min(recent, self.cost)
                if 2.0 * recent < self.cost
                else 0.5 * (recent + (self.cost or recent))
            )
            self.busy += done.seconds
            self.idle += done.idle
            results.append(done)
            if track.number != INDEPENDENT:
                track.state = done.state
                if track.waiting.size:
                    self.ready.append(track)
        if lost:
            results += self._recover(lost)
        return results

    def _recover(self, lost: list[tuple[Track, Chunk]]) -> list[ChunkResult]:
        """Replace the executor and resubmit the lost points.

        A lost point that was submitted alone is the one that killed the worker, and has failed.

        Raises:
            BrokenExecutor: the executor cannot be replaced.
            CaseError: `MOST_DEATHS` workers died before any point was finished.
        """
        if self.renew is None:
            raise BrokenExecutor(
                "a worker died (out of memory?); the finished points are kept, and --resume goes on"
            )
        self._deaths += 1
        if self._deaths >= MOST_DEATHS and not self.busy:
            raise CaseError(
                f"workers: {self._deaths} died, one after the other, before any point was "
                "finished: too little memory, or a library that cannot be loaded? One point alone "
                "(--executor serial) may show the reason; --resume goes on"
            )
        self.executor = self.renew()
        was_alone = self._suspects > 0
        lost += self._flying.values()  # the broken executor returns no more results
        self._flying.clear()
        results = []
        for track, chunk in reversed(lost):
            if was_alone:
                self._suspects -= 1
                dead = Point(chunk.indices[0], "failed", "the worker process died", None)
                results.append(ChunkResult(chunk, (dead,), chunk.state, 0.0, 0.0))
            else:
                track.put_back(chunk)
                self._suspects += len(chunk.indices)
            if track.waiting.size and track not in self.ready:
                self.ready.appendleft(track)
        return results
