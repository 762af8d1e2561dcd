"""Hands points to an executor in chunks sized by what they have cost, and takes in what is done.

Any `concurrent.futures.Executor` will do. Points of a track follow one another; all others go to
whichever worker is free.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterable
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, wait
from dataclasses import dataclass, field

from delam_fem.simulation.loop import State
from delam_fem.studies.sweeps.point import Chunk, Done, Point, compute

CHUNK_SECONDS = 0.5
"""Aim for the time of a chunk: a hundred times what it costs to hand one over."""
SHARE = 4
"""Chunks per worker that are left at least while there are points: an even end."""
IN_FLIGHT = 2
"""Chunks per worker that are handed over, so that none waits for the parent."""
MOST = 10_000
"""Points in a chunk at most."""
POLL = 0.2
"""Time after which a stop is noticed [s]."""
INDEPENDENT = -1
"""Number of the track of points that do not follow one another."""


@dataclass
class Track:
    """Points that are still to be handed out, in order.

    Attributes:
        number: of the track, or `INDEPENDENT`.
        waiting: the points.
        state: from which the first of them starts.
    """

    number: int
    waiting: deque[int]
    state: State | None = None


@dataclass
class Costs:
    """What the points have cost.

    Attributes:
        busy: time that workers computed [s].
        idle: time that workers waited between chunks [s].
        cost: recent mean time of a point, 0 if none is known [s].
    """

    busy: float = 0.0
    idle: float = 0.0
    cost: float = 0.0

    def add(self, done: Done) -> None:
        """Take a chunk into account."""
        recent = done.seconds / len(done.points)
        # the first point of a worker brings imports: the smaller of both forgets it at once
        self.cost = (
            min(recent, self.cost)
            if 2.0 * recent < self.cost
            else 0.5 * (recent + (self.cost or recent))
        )
        self.busy += done.seconds
        self.idle += done.idle

    @property
    def overhead(self) -> float:
        """Share of the workers' time that they waited between chunks."""
        total = self.busy + self.idle
        return self.idle / total if total > 0.0 else 0.0


@dataclass
class Schedule:
    """The work that is left and in flight.

    Attributes:
        packed: the pickled sweep.
        n_workers: of the executor.
        ready: tracks from which a chunk can be taken now.
        executor: computes.
        renew: returns another executor in place of one whose worker died; None: there is none.
        costs: so far.
    """

    packed: bytes
    n_workers: int
    ready: deque[Track]
    executor: Executor
    renew: Callable[[], Executor] | None = None
    costs: Costs = field(default_factory=Costs)
    _flying: dict[Future[Done], tuple[Track, Chunk]] = field(default_factory=dict)
    _suspects: int = 0

    def run(self, take_in: Callable[[list[Done]], None], is_stopped: Callable[[], bool]) -> bool:
        """Compute all points.

        Args:
            take_in: given what is done, as it comes.
            is_stopped: whether to hand out no more, and end when what flies has landed.

        Returns:
            Whether all points were computed.

        Raises:
            BrokenExecutor: a worker died, and there is no way to renew the executor.
        """
        while True:
            if is_stopped():
                self._call_back()
            else:
                self._hand_out()
            if not self._flying:
                return not self.ready
            landed, _ = wait(self._flying, timeout=POLL, return_when=FIRST_COMPLETED)
            results = self._land(landed)
            if results:
                if not is_stopped():
                    self._hand_out()  # workers go on while the results are written
                take_in(results)

    def _hand_out(self) -> None:
        """Submit chunks until enough fly; a single point after a worker has died."""
        limit = 1 if self._suspects else IN_FLIGHT * self.n_workers
        while self.ready and len(self._flying) < limit:
            track = self.ready.popleft()
            n = self._chunk_size(track)
            indices = tuple(track.waiting.popleft() for _ in range(n))
            chunk = Chunk(track.number, indices, track.state)
            if track.number == INDEPENDENT and track.waiting:
                self.ready.append(track)
            self._flying[self._submitted(chunk)] = (track, chunk)

    def _submitted(self, chunk: Chunk) -> Future[Done]:
        """Submit a chunk; on a broken executor it comes back as broken."""
        try:
            return self.executor.submit(compute, self.packed, chunk)
        except BrokenExecutor as error:
            broken: Future[Done] = Future()
            broken.set_exception(error)
            return broken

    def _chunk_size(self, track: Track) -> int:
        """Return the number of points whose time is worth handing over."""
        if self._suspects or self.costs.cost <= 0.0:
            return 1
        left = len(track.waiting)
        n = min(int(CHUNK_SECONDS / self.costs.cost), left, MOST)
        if track.number == INDEPENDENT and self.n_workers > 1:
            n = min(n, math.ceil(left / (SHARE * self.n_workers)))
        return max(1, n)

    def _land(self, futures: Iterable[Future[Done]]) -> list[Done]:
        """Return the results; put the points of a worker that died back into their track."""
        results, lost = [], []
        for future in futures:
            track, chunk = self._flying.pop(future)
            try:
                done = future.result()
            except BrokenExecutor:
                lost.append((track, chunk))
                continue
            self._suspects = max(0, self._suspects - len(chunk.indices))
            self.costs.add(done)
            results.append(done)
            if track.number != INDEPENDENT:
                track.state = done.state
                if track.waiting:
                    self.ready.append(track)
        if lost:
            results += self._recover(lost)
        return results

    def _recover(self, lost: list[tuple[Track, Chunk]]) -> list[Done]:
        """Renew the executor; a single point that was alone in flight is the one that failed."""
        if self.renew is None:
            raise BrokenExecutor(
                "a worker died (out of memory?); what is finished is kept, and --resume goes on"
            )
        self.executor = self.renew()
        was_alone = self._suspects > 0
        lost += self._flying.values()  # nothing of the broken executor will land
        self._flying.clear()
        results = []
        for track, chunk in reversed(lost):
            if was_alone:
                self._suspects -= 1
                dead = Point(chunk.indices[0], "failed", "the worker process died", None)
                results.append(Done(chunk, (dead,), chunk.state, 0.0, 0.0))
            else:
                track.waiting.extendleft(reversed(chunk.indices))
                self._suspects += len(chunk.indices)
            if track.waiting and track not in self.ready:
                self.ready.appendleft(track)
        return results

    def _call_back(self) -> None:
        """Take back the chunks that no worker has begun."""
        for future, (track, chunk) in list(self._flying.items()):
            if future.cancel():
                del self._flying[future]
                track.waiting.extendleft(reversed(chunk.indices))
                if track not in self.ready:
                    self.ready.append(track)
