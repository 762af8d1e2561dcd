"""Chunks, tracks and dying workers, with an executor that computes nothing."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from concurrent.futures import BrokenExecutor, Executor, Future

import numpy as np
import pytest

from delam_fem.api import CaseError
from delam_fem.studies.sweeps.point import Chunk, ChunkResult, Point
from delam_fem.studies.sweeps.schedule import CHUNK_SECONDS, INDEPENDENT, Schedule, Track


class Fake(Executor):
    """Says at once that points took `cost` seconds; dies of the points in `deadly`."""

    def __init__(self, cost: float, deadly: frozenset[int] = frozenset(), idle: float = 0.0):
        self.cost, self.deadly, self.idle = cost, deadly, idle
        self.chunks: list[Chunk] = []

    def submit(self, fn: object, /, packed: bytes, chunk: Chunk) -> Future[ChunkResult]:  # type: ignore[override]
        self.chunks.append(chunk)
        future: Future[ChunkResult] = Future()
        if self.deadly & set(chunk.indices):
            future.set_exception(BrokenExecutor("gone"))
        else:
            points = tuple(Point(i, "completed", "", None) for i in chunk.indices)
            seconds = self.cost * len(points)
            future.set_result(ChunkResult(chunk, points, None, seconds, self.idle))
        return future


def independent(n: int) -> deque[Track]:
    return deque([Track(INDEPENDENT, np.arange(n))])


def computed(
    schedule: Schedule, is_stopped: Callable[[], bool] = lambda: False
) -> tuple[bool, list[Point]]:
    points: list[Point] = []
    is_complete = schedule.run(
        lambda done: points.extend(p for d in done for p in d.points), is_stopped
    )
    return is_complete, points


@pytest.mark.parametrize("n_workers", [1, 3])
def test_every_point_is_computed_once(n_workers: int) -> None:
    schedule = Schedule(b"", n_workers, independent(1000), Fake(1e-3))
    is_complete, points = computed(schedule)
    assert is_complete
    assert sorted(p.index for p in points) == list(range(1000))


def test_chunks_grow_to_the_time_that_is_aimed_for_and_shrink_to_the_end() -> None:
    executor = Fake(cost=CHUNK_SECONDS / 20)
    computed(Schedule(b"", 2, independent(2000), executor))
    sizes = [len(chunk.indices) for chunk in executor.chunks]
    assert sizes[0] == 1
    assert max(sizes) == 20
    assert sizes[-1] == 1
    assert len(sizes) < 2000 / 20 + 40


def test_a_slow_first_point_does_not_keep_chunks_small() -> None:
    class SlowStart(Fake):
        def submit(self, fn: object, /, packed: bytes, chunk: Chunk) -> Future[ChunkResult]:  # type: ignore[override]
            self.cost = 30.0 if not self.chunks else 1e-3
            return super().submit(fn, packed, chunk)

    executor = SlowStart(0.0)
    computed(Schedule(b"", 2, independent(5000), executor))
    assert max(len(chunk.indices) for chunk in executor.chunks[:20]) > 100


def test_a_track_keeps_its_order_and_has_one_chunk_in_flight() -> None:
    executor = Fake(cost=0.1)
    tracks = deque(Track(k, np.arange(20 * k, 20 * k + 20)) for k in range(2))
    _, points = computed(Schedule(b"", 4, tracks, executor))
    for k in range(2):
        indices = [i for c in executor.chunks if c.track == k for i in c.indices]
        assert indices == list(range(20 * k, 20 * k + 20))
    assert len(points) == 40


def test_a_stop_hands_out_no_more() -> None:
    executor = Fake(cost=10.0)
    is_complete, points = computed(
        Schedule(b"", 1, independent(100), executor), lambda: len(executor.chunks) >= 5
    )
    assert not is_complete
    assert len(points) == sum(len(chunk.indices) for chunk in executor.chunks) < 100


def test_idle_time_is_the_overhead() -> None:
    schedule = Schedule(b"", 1, independent(10), Fake(cost=0.9, idle=0.1))
    computed(schedule)
    assert schedule.overhead == pytest.approx(0.1)


@pytest.mark.parametrize("deadly", [frozenset({0}), frozenset({537}), frozenset({3, 4, 999})])
def test_points_that_kill_their_worker_are_found_and_the_rest_goes_on(
    deadly: frozenset[int],
) -> None:
    made: list[Fake] = []

    def renew() -> Fake:
        made.append(Fake(1e-3, deadly))
        return made[-1]

    schedule = Schedule(b"", 2, independent(1000), renew(), renew)
    is_complete, points = computed(schedule)
    assert is_complete
    assert sorted(p.index for p in points) == list(range(1000))
    failed = [p for p in points if p.outcome == "failed"]
    assert {p.index for p in failed} == deadly
    assert {p.error for p in failed} == {"the worker process died"}
    sizes = [len(chunk.indices) for executor in made[2:] for chunk in executor.chunks]
    assert max(sizes) > 1, "chunks stayed single"


def test_a_given_executor_that_breaks_ends_the_sweep() -> None:
    schedule = Schedule(b"", 2, independent(10), Fake(1e-3, frozenset({5})))
    with pytest.raises(BrokenExecutor, match=r"a worker died .* --resume goes on"):
        computed(schedule)


def test_workers_that_all_die_end_the_sweep_soon() -> None:
    made: list[Fake] = []

    def renew() -> Fake:
        made.append(Fake(1e-3, frozenset(range(1000))))
        return made[-1]

    schedule = Schedule(b"", 2, independent(1000), renew(), renew)
    with pytest.raises(CaseError, match=r"5 died, one after the other, before any point"):
        computed(schedule)
    assert len(made) == 5


def test_deaths_after_the_first_points_do_not_end_it() -> None:
    deadly = frozenset(range(100, 120))
    schedule = Schedule(b"", 2, independent(200), Fake(1e-3, deadly), lambda: Fake(1e-3, deadly))
    _, points = computed(schedule)
    assert {p.index for p in points if p.outcome == "failed"} == deadly
