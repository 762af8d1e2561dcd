"""Run a sweep, in processes or as jobs of SLURM.

An executor computes the points, a journal keeps them, and one dataset has them all. A script for
SLURM computes the shards of a sweep as an array of jobs, one shard each. Before the time of a job
is up SLURM sends SIGTERM: the shard stops with everything saved, and the job puts itself back into
the queue. A last job merges the shards.

In Python:

    import delam_fem as df
    data = df.run_sweep(df.load_sweep("bifurcation.toml"), "runs/bifurcation", workers=2)
    data.tip_amplitude.sel(lamina="thick").plot.line(x="frequency")
"""

from __future__ import annotations

import logging
import math
import pickle
import shlex
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from threading import Thread
from typing import TYPE_CHECKING, Any

import numpy as np

from delam_fem.api import (
    FILE_BYTES,
    POINT_SECONDS,
    STUDY_SECONDS,
    WORKER_BYTES,
    CaseError,
    Cost,
    Layout,
    html,
    listed,
    require_affordable,
    run_cost,
    step_hours,
    stop_signals,
)
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
from delam_fem.studies.sweeps.journal import Journal, MergedParts, remove_journal
from delam_fem.studies.sweeps.point import ChunkResult, PointRunner, channel_units, quantities
from delam_fem.studies.sweeps.schedule import (
    INDEPENDENT,
    MOST_SHARDS,
    WHOLE,
    Schedule,
    Shard,
    Track,
)

if TYPE_CHECKING:
    import xarray as xr

MEASURED_SECONDS, MOST_MEASURED = 5.0, 40
"""Longest time in which points are measured [s], and their largest number."""
_RESERVE = 1.5
"""Factor on measured times and estimated memory: other points and machines may need more."""
_START_SECONDS = 120.0
"""Time of a job beside its points: start, compilation on a new machine, files [s]."""
_LEAST_NOTICE = 60.0
"""Least time between SIGTERM and the end of a job [s]."""
_MERGE_BYTES, _MERGE_SECONDS = 1000.0, 2e-5
"""Memory and time of a point in the merge, beside its numbers, several times what was measured."""

_TEXT = """\
#!/bin/bash
#SBATCH --job-name={name}
#SBATCH --array=1-{n_shards}
#SBATCH --ntasks=1
#SBATCH --cpus-per-task=1
#SBATCH --mem={memory}M
#SBATCH --time={time}
#SBATCH --signal=B:TERM@{notice}
#SBATCH --requeue
#SBATCH --open-mode=append
#SBATCH --output={name}-%A_%a.log
#
# {about}
#
# bash FILE    submits the shards, and a job that merges them when all are done
# sbatch FILE  submits the shards alone
# FILE, the sweep and its folder lie where all nodes see them.
set -euo pipefail
export OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 MKL_NUM_THREADS=1 NUMBA_NUM_THREADS=1

sweep=({command})

if [ "${{1:-}}" = merge ]; then
    exec "${{sweep[@]}}" --merge
fi

if [ -z "${{SLURM_ARRAY_TASK_ID:-}}" ]; then
    script=$(realpath "$0")
    job=$(sbatch --parsable "$script")
    job=${{job%%;*}} # the name of the cluster may follow the number
    echo "shards: job $job"
    sbatch --job-name={name}-merge --dependency="afterok:$job" --kill-on-invalid-dep=yes \\
        --ntasks=1 --mem={merge_memory}M --time={merge_time} --output={name}-%j.log \\
        --wrap "bash $(printf '%q' "$script") merge"
    exit
fi

stopped=
trap 'stopped=yes; kill -TERM "$child" || true' TERM
"${{sweep[@]}}" --shard "$SLURM_ARRAY_TASK_ID/{n_shards}" --resume --quiet \\
    --workers "${{SLURM_CPUS_PER_TASK:-1}}" &
child=$!
status=0
wait "$child" || status=$?
while [ -n "$stopped" ] && [ "$status" -eq 143 ]; do # the signal has ended wait, not the shard
    stopped=
    status=0
    wait "$child" || status=$?
done
if [ "$status" -eq {interrupted} ]; then
    echo "shard $SLURM_ARRAY_TASK_ID: not finished; back into the queue"
    scontrol requeue "${{SLURM_ARRAY_JOB_ID}}_$SLURM_ARRAY_TASK_ID"
fi
exit "$status"
"""


@dataclass(frozen=True)
class PointCost:
    """The measured time of points of a sweep.

    Attributes:
        mean: mean time [s].
        most: longest time [s].
        n_points: number of measured points.
    """

    mean: float
    most: float
    n_points: int


def measured_cost(sweep: Sweep, seconds: float = MEASURED_SECONDS) -> PointCost:
    """Return the time of a point of a sweep, measured at some points across the grid.

    Args:
        sweep: the sweep.
        seconds: time after which no further point is begun [s].
    """
    runner = PointRunner(sweep)
    times = []
    places = np.linspace(0, sweep.n_points - 1, min(MOST_MEASURED, sweep.n_points))
    runner.point(0, None)  # compiles
    end = time.perf_counter() + seconds
    for index in np.random.default_rng(0).permutation(places.astype(np.int64)):
        begin = time.perf_counter()
        runner.point(int(index), None)
        times.append(time.perf_counter() - begin)
        if time.perf_counter() > end:
            break
    return PointCost(float(np.mean(times)), max(times), len(times))


def array_script(
    sweep: Sweep,
    command: Sequence[str],
    n_shards: int,
    cost: PointCost,
    *,
    most_hours: float,
    interrupted: int,
) -> str:
    """Return a script for SLURM that computes a sweep as an array of jobs.

    Args:
        sweep: the sweep.
        command: command that computes the sweep, without the options of shards.
        n_shards: number of shards.
        cost: measured time of its points.
        most_hours: longest time of a job; a shard that needs more is computed in several [h].
        interrupted: exit status of a shard that has stopped before its end.

    Raises:
        CaseError: there are more shards than points or tracks, or a point needs longer than a job.
    """
    n_units = len(sweep.tracks) or sweep.n_points
    if not 1 <= n_shards <= min(n_units, MOST_SHARDS):
        what = "tracks" if sweep.tracks else "points"
        raise CaseError(
            f"slurm: expected 1 to {min(n_units, MOST_SHARDS)} shards, as the sweep has {n_units} "
            f"{what}, given {n_shards}"
        )
    share = max(share_size(sweep, Shard(k, n_shards)) for k in range(1, n_shards + 1))
    work = share * cost.mean
    limit = 3600.0 * most_hours
    notice = max(_LEAST_NOTICE, 2.0 * _RESERVE * cost.most)
    if limit < _START_SECONDS + 2.0 * notice:
        raise CaseError(
            f"slurm: expected jobs of at least {(_START_SECONDS + 2.0 * notice) / 3600.0:.2g} h, "
            f"as a point takes up to {cost.most:.3g} s, given {most_hours:g} h"
        )
    wall_seconds = _START_SECONDS + notice + _RESERVE * work
    n_chunks = max(1, math.ceil(_RESERVE * work / (limit - _START_SECONDS - notice)))
    needed = sweep_cost(sweep, 1, share)
    files = sweep_cost(sweep, 1).disk / 2.0
    # parent, worker, and the list of its points
    memory = needed.programs + needed.memory + 24.0 * share
    chunks = "one job" if n_chunks == 1 else f"about {n_chunks} jobs one after the other"
    return _TEXT.format(
        name=sweep.file.name.replace(" ", "-"),
        n_shards=n_shards,
        memory=math.ceil(_RESERVE * memory / 1e8) * 100,
        time=_duration(min(limit, wall_seconds)),
        notice=math.ceil(notice),
        about=f"{share} points a shard, {1e3 * cost.mean:.3g} ms a point (mean of {cost.n_points} "
        f"here, longest {1e3 * cost.most:.3g} ms): {_duration(work)} of work in {chunks}",
        command=shlex.join(command),
        merge_memory=math.ceil((WORKER_BYTES + _MERGE_BYTES * sweep.n_points + files) / 1e6) + 200,
        merge_time=_duration(600.0 + _MERGE_SECONDS * sweep.n_points + files / 1e7),
        interrupted=interrupted,
    )


def _duration(seconds: float) -> str:
    """Return a time as SLURM writes it, in whole minutes."""
    minutes = math.ceil(seconds / 60.0)
    return f"{minutes // 60:02d}:{minutes % 60:02d}:00"


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
        CaseError: the folder contains another sweep, a damaged one, or an unfinished one and
            `resume` is False; the first point is not a valid case; the sweep is large and not
            confirmed; workers die before any point is finished; or the script that calls has no
            `if __name__ == "__main__":`.
        BrokenExecutor: a worker of the given executor died; the journal keeps the finished points.
        OSError: the folder cannot be written.
    """
    executors.leave_if_imported()
    directory = Path(directory)
    if not (resume and is_complete(directory, sweep)):
        options = (executor, workers, resume, is_confirmed, progress)
        Thread(target=_load_xarray).start()
        with (
            listed(directory),
            _computing(sweep, directory, WHOLE, *options) as (merged, layout, about),
        ):
            write_result(sweep, directory, merged, layout, about)
            has_all = merged.numbers.size == sweep.n_points
        if has_all:
            remove_journal(directory / JOURNAL)
    return open_result(directory / RESULT)


def _load_xarray() -> None:
    """Load what opens the result while workers compute."""
    with suppress(RuntimeError):  # a call that fails at once ends this process meanwhile
        import_module("xarray").Dataset(coords={"n": [0]})


def completed(sweep: Sweep, directory: Path, executor: Any = None, **options: Any) -> xr.Dataset:
    """Compute a sweep that a study needs, and return its dataset, loaded; see `run_sweep`.

    Raises:
        KeyboardInterrupt: the sweep was interrupted; `resume` goes on.
    """
    with run_sweep(sweep, directory, executor, **options) as data:
        if data.attrs["outcome"] != "completed":
            raise KeyboardInterrupt
        return data.load()


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
        executor: "process", "mpi", "serial", or an executor of `concurrent.futures`.
        workers: number of workers; by default those of the executor, or one per core.
        resume: whether to continue with the finished points of the shard.
        is_confirmed: see `run_sweep`; it is asked of the points of the shard.
        progress: called with the number of finished points and of all points of the shard.

    Returns:
        How far the shard has come.

    Raises:
        CaseError: the folder holds another, a damaged or an unfinished sweep, or the first point is
            not a valid case; all reasons: `run_sweep`.
        BrokenExecutor: a worker of the given executor died; the journal keeps the finished points.
        OSError: the folder cannot be written.
    """
    executors.leave_if_imported()
    directory = Path(directory)
    n_points = share_size(sweep, shard)
    if resume and is_complete(directory, sweep):
        return ShardProgress(n_points, n_points, {})
    options = (executor, workers, resume, is_confirmed, progress)
    with _computing(sweep, directory, shard, *options) as (merged, _, about):
        return ShardProgress(merged.numbers.size, n_points, merged.counts() | about)


@contextmanager
def _computing(
    sweep: Sweep,
    directory: Path,
    shard: Shard,
    executor: Executor | ExecutorName | None,
    workers: int | None,
    resume: bool,
    is_confirmed: bool,
    progress: Callable[[int, int], None] | bool | None,
) -> Iterator[tuple[MergedParts, Layout, dict[str, str | int | float]]]:
    """Compute the missing points of a shard; see `run_shard`.

    Yields:
        Its finished points, the layout of the first point of the sweep, and workers and times.
    """
    n_points = share_size(sweep, shard)
    layout = require_computable(
        sweep, executor, workers, is_confirmed=is_confirmed, folder=directory, n_points=n_points
    )
    directory.mkdir(parents=True, exist_ok=True)
    path = directory / JOURNAL
    with Journal(path, sweep.identity, resume=resume, shard=shard) as journal:
        if shard.is_whole:
            save_sweep(sweep, directory)
        with journal.merged() as merged:
            left = _left(sweep, merged, shard)
        n_done = n_points - sum(track.waiting.size for track in left)
        begin = time.perf_counter()
        packed = pickle.dumps(Sweep(sweep.base, sweep.file))  # without what it has cached
        with (
            executors.pool(executor or executors.default_name(), workers) as opened,
            html.reporting(progress, "point") as show,
        ):
            ready = deque(left)
            schedule = Schedule(packed, opened.n_workers, ready, opened.executor, opened.renew)

            def take_in(results: list[ChunkResult]) -> None:
                nonlocal n_done
                journal.add(results)
                n_done += sum(len(done.points) for done in results)
                if show is not None:
                    show(n_done, n_points)

            if show is not None:
                show(n_done, n_points)
            with stop_signals() as is_stopped:
                schedule.run(take_in, is_stopped)
            about: dict[str, str | int | float] = {
                "workers": schedule.n_workers,
                "wall_seconds": time.perf_counter() - begin,
                "busy_seconds": schedule.busy,
                "scheduling_overhead": schedule.overhead,
            }
        with journal.merged() as merged:
            yield merged, layout, about


def require_computable(
    sweep: Sweep,
    executor: Executor | ExecutorName | None,
    workers: int | None,
    *,
    is_confirmed: bool,
    folder: Path | None = None,
    n_points: int | None = None,
) -> Layout:
    """Check the first point and the cost of a sweep before anything is written.

    Args:
        sweep: the sweep.
        executor: "process", "mpi", "serial", or an executor of `concurrent.futures`.
        workers: number of workers; by default those of the executor, or one per core.
        is_confirmed: whether a large sweep is computed.
        folder: where the files go.
        n_points: number of points that are computed; default: all.

    Returns:
        The layout of the first point.

    Raises:
        CaseError: the first point cannot be computed, or the sweep is large and not confirmed.
    """
    layout = PointRunner(sweep).structure(sweep.case(0)).layout
    count = sweep.n_points if n_points is None else n_points
    if workers is None and isinstance(executor, Executor):
        workers = executors.size_of(executor)
    cost = sweep_cost(sweep, workers, count, layout)
    what = f"sweep {sweep.file.name} of {count:g} points"
    require_affordable(cost, what, is_confirmed=is_confirmed, folder=folder)
    return layout


def sweep_cost(
    sweep: Sweep,
    workers: int | None = None,
    n_points: int | None = None,
    layout: Layout | None = None,
) -> Cost:
    """Return the cost of a sweep whose points all are like the first.

    Args:
        sweep: the sweep.
        workers: number of workers; default: one per core.
        n_points: number of points that are computed; default: all.
        layout: layout of the first point; default: it is assembled.

    Raises:
        CaseError: the first point cannot be computed.
    """
    case = sweep.case(0)
    record = sweep.file.record
    n = sweep.n_points if n_points is None else n_points
    n_workers = workers or executors.n_cores()
    if layout is None:
        layout = PointRunner(sweep).structure(case).layout
    channels = channel_units(sweep, layout)
    longer = 1.0 + 3.0 * record.lyapunov / case.n_periods
    each = step_hours(case, sweep.file.engine) * longer + POINT_SECONDS / 3600.0
    hours = n * each / n_workers + STUDY_SECONDS / 3600.0
    row = 8.0 * sum(quantity.size for quantity in quantities(record, layout, channels, sweep.base))
    worker = run_cost(case, sweep.file.engine).memory * n_workers
    files = FILE_BYTES + 2.0 * n * (row + POINT_BYTES)
    return Cost(hours, 8 * n + worker, files, (1 + n_workers) * WORKER_BYTES)


def share_size(sweep: Sweep, shard: Shard) -> int:
    """Return the number of points of a shard."""
    if not sweep.tracks:
        return shard.items(sweep.n_points).size
    return sum(sweep.tracks[number].size for number in shard.items(len(sweep.tracks)))


def _left(sweep: Sweep, merged: MergedParts, shard: Shard) -> list[Track]:
    """Return the points of a shard that are not finished, as tracks."""
    if not sweep.tracks:
        points = shard.items(sweep.n_points)
        waiting = np.setdiff1d(points, merged.numbers, assume_unique=True)
        return [Track(INDEPENDENT, waiting)] if waiting.size else []
    tracks = []
    for number in shard.items(len(sweep.tracks)).tolist():
        points = sweep.tracks[number]
        n_done, state = merged.reached(points, number)
        if n_done < points.size:
            tracks.append(Track(number, points[n_done:], state))
    return tracks
