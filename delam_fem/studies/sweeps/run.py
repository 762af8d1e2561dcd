"""Compute a sweep: an executor computes the points, a journal keeps them, one dataset has all.

In Python:

    import delam_fem as df
    data = df.run_sweep(df.load_sweep("bifurcation.toml"), "runs/bifurcation", workers=2)
    data.tip_amplitude.sel(lamina="thick").plot.line(x="frequency")
"""

from __future__ import annotations

import logging
import pickle
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Executor
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from delam_fem.engines.cost import (
    FILE_BYTES,
    POINT_SECONDS,
    STUDY_SECONDS,
    WORKER_BYTES,
    Cost,
    require_affordable,
    run_cost,
    step_hours,
)
from delam_fem.model.layout import Layout
from delam_fem.results.pages.progress import reporting
from delam_fem.simulation.checkpoint import stop_signals
from delam_fem.studies import executors
from delam_fem.studies.executors import ExecutorName
from delam_fem.studies.sweeps.dataset import (
    JOURNAL,
    RESULT,
    is_complete,
    open_result,
    save_sweep,
    write_result,
)
from delam_fem.studies.sweeps.grid import Sweep
from delam_fem.studies.sweeps.journal import Joined, Journal, remove_journal
from delam_fem.studies.sweeps.point import Done, PointRunner
from delam_fem.studies.sweeps.quantities import Quantity, quantities
from delam_fem.studies.sweeps.schedule import INDEPENDENT, Schedule, Shard, Track, Waiting

if TYPE_CHECKING:
    import xarray as xr

POINT_BYTES = 80
"""Bytes of a point in the journal and the dataset beside its row."""

_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class ShardProgress:
    """How far a shard has come.

    Attributes:
        n_done: number of its finished points.
        n_points: number of all its points.
        about: number of points by outcome, and the times of this call, by name.
    """

    n_done: int
    n_points: int
    about: Mapping[str, str | int | float]


def run_sweep(
    sweep: Sweep,
    directory: str | Path,
    executor: Executor | ExecutorName | None = None,
    *,
    workers: int | None = None,
    resume: bool = False,
    is_confirmed: bool = False,
    progress: Callable[[int, int], None] | bool | None = None,
) -> xr.Dataset:
    """Compute all points of a sweep and return the dataset.

    The folder contains `case.toml` and `sweep.toml`, from which the sweep can be repeated, and
    `sweep.nc`; `sweep.json` says where and how long it was computed. While points are missing it
    also contains the journal of the finished points.

    Args:
        sweep: the sweep to compute.
        directory: folder of the sweep; it is made if it does not exist.
        executor: any `concurrent.futures.Executor`, for example a Dask client's `get_executor()`;
            or "process" (default), "mpi" (under `python -m mpi4py.futures`) or "serial".
        workers: number of workers; by default those of the executor, or one per core.
        resume: whether to continue with the points in the folder; a complete sweep is returned
            without computing.
        is_confirmed: whether to compute a sweep that needs many hours or much space; without, it is
            refused.
        progress: called with the number of finished points and of all points; True: a bar.

    Returns:
        The dataset, opened lazily. `attrs["outcome"]` is "completed", or "interrupted" by Ctrl-C or
        SIGTERM; then points are missing, and a call with `resume` computes them.

    Raises:
        CaseError: the folder contains another sweep, an unfinished one and `resume` is False, or a
            damaged one; the first point is not a valid case; or the sweep is large and not
            confirmed; workers die before any point is finished; or the script that calls has no
            `if __name__ == "__main__":`.
        BrokenExecutor: a worker of the given executor died; the journal keeps the finished points.
        OSError: the folder cannot be written.
    """
    executors.leave_if_imported()
    directory = Path(directory)
    path = directory / RESULT
    if resume and is_complete(directory, sweep):
        return open_result(path)
    layout, _ = require_computable(
        sweep, executor, workers, is_confirmed=is_confirmed, folder=directory
    )
    directory.mkdir(parents=True, exist_ok=True)
    with Journal(directory / JOURNAL, sweep.identity, resume=resume) as journal:
        save_sweep(sweep, directory)
        about = _computed(sweep, journal, executor, workers, progress)
        with journal.joined() as joined:
            write_result(sweep, directory, joined, layout, about)
            has_all = joined.numbers.size == sweep.n_points
    if has_all:
        remove_journal(directory / JOURNAL)
    return open_result(path)


def run_shard(
    sweep: Sweep,
    directory: str | Path,
    shard: Shard,
    executor: Executor | ExecutorName | None = None,
    *,
    workers: int | None = None,
    resume: bool = False,
    is_confirmed: bool = False,
    progress: Callable[[int, int], None] | bool | None = None,
) -> ShardProgress:
    """Compute the points of one shard; `merge_sweep` joins the shards.

    Any number of shards can be computed at the same time in the same folder.

    Args:
        sweep: the sweep.
        directory: folder of the sweep; the shard only writes to the journal in it.
        shard: the share of the points.
        executor: see `run_sweep`.
        workers: see `run_sweep`.
        resume: whether to continue with the finished points of the shard.
        is_confirmed: see `run_sweep`; it is asked of the points of the shard.
        progress: called with the number of finished points and of all points of the shard.

    Returns:
        How far the shard has come.

    Raises:
        CaseError: see `run_sweep`.
        BrokenExecutor: see `run_sweep`.
        OSError: the folder cannot be written.
    """
    executors.leave_if_imported()
    directory = Path(directory)
    n_points = share_size(sweep, shard)
    if resume and is_complete(directory, sweep):
        return ShardProgress(n_points, n_points, {})
    require_computable(
        sweep, executor, workers, is_confirmed=is_confirmed, folder=directory, n_points=n_points
    )
    directory.mkdir(parents=True, exist_ok=True)
    path = directory / JOURNAL
    with Journal(path, sweep.identity, resume=resume, shard=shard) as journal:
        about = _computed(sweep, journal, executor, workers, progress)
        with journal.joined() as joined:
            return ShardProgress(joined.numbers.size, n_points, joined.counts() | about)


def require_computable(
    sweep: Sweep,
    executor: Executor | ExecutorName | None,
    workers: int | None,
    *,
    is_confirmed: bool,
    folder: Path | None = None,
    n_points: int | None = None,
) -> tuple[Layout, tuple[Quantity, ...]]:
    """Check the first point and the cost of a sweep before anything is written.

    Args:
        sweep: the sweep.
        executor: see `run_sweep`.
        workers: see `run_sweep`.
        is_confirmed: whether a large sweep is computed.
        folder: where the files go.
        n_points: number of points that are computed; default: all.

    Returns:
        The layout of the first point, and the quantities in a row.

    Raises:
        CaseError: the first point cannot be computed, or the sweep is large and not confirmed.
    """
    layout = PointRunner(sweep).structure(sweep.case(0)).layout
    wanted = quantities(sweep.file.record, layout)
    count = sweep.n_points if n_points is None else n_points
    what = f"sweep {sweep.file.name} of {count:g} points"
    cost = _cost(sweep, wanted, _n_workers(executor, workers), count)
    require_affordable(cost, what, is_confirmed=is_confirmed, folder=folder)
    return layout, wanted


def sweep_cost(sweep: Sweep, workers: int | None = None) -> Cost:
    """Return the cost of a sweep.

    Args:
        sweep: the sweep.
        workers: number of workers; default: one per core.

    Raises:
        CaseError: its first point cannot be computed.
    """
    layout = PointRunner(sweep).structure(sweep.case(0)).layout
    wanted = quantities(sweep.file.record, layout)
    return _cost(sweep, wanted, workers or executors.n_cores(), sweep.n_points)


def _n_workers(executor: Executor | ExecutorName | None, workers: int | None) -> int:
    """Return the number of workers that a sweep will probably have."""
    if workers is not None:
        return workers
    return executors.size_of(executor) if isinstance(executor, Executor) else executors.n_cores()


def _cost(sweep: Sweep, wanted: tuple[Quantity, ...], n_workers: int, n_points: int) -> Cost:
    """Return the cost of a sweep whose points all are like the first."""
    case, record = sweep.case(0), sweep.file.record
    longer = 1.0 + 3.0 * record.lyapunov / case.n_periods
    each = step_hours(case, sweep.file.engine) * longer + POINT_SECONDS / 3600.0
    hours = n_points * each / n_workers
    row = 8.0 * sum(quantity.size for quantity in wanted)
    listed = 0 if sweep.file.order == "independent" else 8 * n_points
    worker = run_cost(case, sweep.file.engine).memory * n_workers
    files = FILE_BYTES + 2.0 * n_points * (row + POINT_BYTES)
    hours += STUDY_SECONDS / 3600.0
    return Cost(hours, listed + worker, files, (1 + n_workers) * WORKER_BYTES)


def share_size(sweep: Sweep, shard: Shard) -> int:
    """Return the number of points of a shard."""
    if not sweep.tracks:
        return len(shard.items(sweep.n_points))
    return sum(sweep.tracks[number].size for number in shard.items(len(sweep.tracks)))


def _computed(
    sweep: Sweep,
    journal: Journal,
    executor: Executor | ExecutorName | None,
    workers: int | None,
    progress: Callable[[int, int], None] | bool | None,
) -> dict[str, str | int | float]:
    """Compute the missing points of a journal; return how, with the times of this call alone."""
    with journal.joined() as joined:
        left = _left(sweep, joined, journal.shard)
    n_points = share_size(sweep, journal.shard)
    n_done = n_points - sum(len(track.waiting) for track in left)
    begin = time.perf_counter()
    with (
        _schedule(sweep, left, executor, workers) as schedule,
        reporting(progress, "point") as show,
    ):

        def take_in(results: list[Done]) -> None:
            nonlocal n_done
            journal.add(results)
            n_done += sum(len(done.points) for done in results)
            if show is not None:
                show(n_done, n_points)

        if show is not None:
            show(n_done, n_points)
        with stop_signals() as is_stopped:
            schedule.run(take_in, is_stopped)
        return {
            "workers": schedule.n_workers,
            "wall_seconds": time.perf_counter() - begin,
            "busy_seconds": schedule.costs.busy,
            "scheduling_overhead": schedule.costs.overhead,
        }


@contextmanager
def _schedule(
    sweep: Sweep,
    left: list[Track],
    executor: Executor | ExecutorName | None,
    workers: int | None,
) -> Iterator[Schedule]:
    """Yield a schedule of the missing points, on an executor that is open in this context."""
    ready = deque(left)
    packed = pickle.dumps(Sweep(sweep.base, sweep.file))  # without what it has cached
    if isinstance(executor, Executor):
        yield Schedule(packed, workers or executors.size_of(executor), ready, executor)
        return
    with executors.pool(executor or executors.default_name(), workers) as opened:
        yield Schedule(packed, opened.n_workers, ready, opened.executor, opened.renew)


def _left(sweep: Sweep, joined: Joined, shard: Shard) -> list[Track]:
    """Return the points of a shard that are not finished, as tracks."""
    if not sweep.tracks:
        waiting = Waiting.all_but(joined.numbers, shard.items(sweep.n_points))
        return [Track(INDEPENDENT, waiting)] if waiting else []
    tracks = []
    for number in shard.items(len(sweep.tracks)):
        points = sweep.tracks[number]
        n_done, state = joined.reached(points, int(number))
        waiting = Waiting([points[n_done:]])
        if waiting:
            tracks.append(Track(int(number), waiting, state))
    return tracks
