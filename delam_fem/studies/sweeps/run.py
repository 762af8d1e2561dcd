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
from collections.abc import Callable, Iterator
from concurrent.futures import Executor
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from delam_fem.case.atomic import write_text
from delam_fem.case.files import save_case
from delam_fem.case.toml import CaseError
from delam_fem.engines.cost import (
    FILE_BYTES,
    STUDY_SECONDS,
    WORKER_BYTES,
    Cost,
    require_affordable,
    run_cost,
    step_hours,
)
from delam_fem.model.layout import Layout
from delam_fem.results.pages.progress import reporting
from delam_fem.simulation.interrupts import stop_signals
from delam_fem.studies import executors
from delam_fem.studies.executors import ExecutorName
from delam_fem.studies.sweeps import dataset
from delam_fem.studies.sweeps.grid import Sweep
from delam_fem.studies.sweeps.journal import Journal
from delam_fem.studies.sweeps.point import Done, PointRunner
from delam_fem.studies.sweeps.quantities import Quantity, quantities
from delam_fem.studies.sweeps.reading import open_result
from delam_fem.studies.sweeps.schedule import INDEPENDENT, Schedule, Track
from delam_fem.studies.sweeps.waiting import Waiting

if TYPE_CHECKING:
    import xarray as xr

RESULT, JOURNAL = "sweep.nc", "sweep.journal"
"""Names of the dataset and the journal in the folder of a sweep."""

POINT_BYTES = 80
"""Bytes of a point in the journal and the dataset beside its row."""

_log = logging.getLogger(__name__)


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
    `sweep.nc`. While points are missing it also contains the journal of the finished points.

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
            confirmed.
        BrokenExecutor: a worker of the given executor died; the journal keeps the finished points.
        OSError: the folder cannot be written.
    """
    directory = Path(directory)
    path = directory / RESULT
    if resume and is_complete(directory, sweep):
        return open_result(path)
    layout, wanted = require_computable(
        sweep, executor, workers, is_confirmed=is_confirmed, folder=directory
    )
    directory.mkdir(parents=True, exist_ok=True)
    with Journal(directory / JOURNAL, sweep.identity, resume=resume) as journal:
        save_case(sweep.base, directory)
        write_text(directory / "sweep.toml", sweep.to_toml("case.toml"))
        begin = time.perf_counter()
        with (
            _schedule(sweep, journal, executor, workers) as schedule,
            reporting(progress, "point") as shown,
        ):
            has_all = _computed(sweep, journal, schedule, shown)
        seconds = time.perf_counter() - begin
        attributes = _attributes(sweep, journal, schedule, seconds) | {
            "outcome": "completed" if has_all else "interrupted"
        }
        dataset.write(path, sweep, journal, wanted, x=layout.x, attributes=attributes)
    if has_all:
        _remove_journal(directory)
    return open_result(path)


def require_computable(
    sweep: Sweep,
    executor: Executor | ExecutorName | None,
    workers: int | None,
    *,
    is_confirmed: bool,
    folder: Path | None = None,
) -> tuple[Layout, tuple[Quantity, ...]]:
    """Check the first point and the cost of a sweep before anything is written.

    Returns:
        The layout of the first point, and the quantities in a row.

    Raises:
        CaseError: the first point cannot be computed, or the sweep is large and not confirmed.
    """
    layout = PointRunner(sweep).structure(sweep.case(0)).layout
    wanted = quantities(sweep.file.record, layout)
    what = f"sweep {sweep.file.name} of {sweep.n_points:g} points"
    cost = _cost(sweep, wanted, _n_workers(executor, workers))
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
    return _cost(sweep, quantities(sweep.file.record, layout), workers or executors.n_cores())


def _n_workers(executor: Executor | ExecutorName | None, workers: int | None) -> int:
    """Return the number of workers that a sweep will probably have."""
    if workers is not None:
        return workers
    return executors.size_of(executor) if isinstance(executor, Executor) else executors.n_cores()


def _cost(sweep: Sweep, wanted: tuple[Quantity, ...], n_workers: int) -> Cost:
    """Return the cost of a sweep whose points all are like the first."""
    case, record = sweep.case(0), sweep.file.record
    longer = 1.0 + 2.0 * record.lyapunov / case.n_periods
    hours = sweep.n_points * step_hours(case, sweep.file.engine) * longer / n_workers
    row = 8.0 * sum(quantity.size for quantity in wanted)
    listed = 0 if sweep.file.order == "independent" else 8 * sweep.n_points
    worker = run_cost(case, sweep.file.engine).memory * n_workers
    files = FILE_BYTES + 2.0 * sweep.n_points * (row + POINT_BYTES)
    hours += STUDY_SECONDS / 3600.0
    return Cost(hours, listed + worker, files, (1 + n_workers) * WORKER_BYTES)


def _computed(
    sweep: Sweep,
    journal: Journal,
    schedule: Schedule,
    progress: Callable[[int, int], None] | None,
) -> bool:
    """Compute the missing points; return whether all points are finished."""
    n_done = journal.n_points

    def take_in(results: list[Done]) -> None:
        nonlocal n_done
        journal.add(results)
        n_done += sum(len(done.points) for done in results)
        if progress is not None:
            progress(n_done, sweep.n_points)

    if progress is not None:
        progress(n_done, sweep.n_points)
    with stop_signals() as is_stopped:
        return schedule.run(take_in, is_stopped)


@contextmanager
def _schedule(
    sweep: Sweep,
    journal: Journal,
    executor: Executor | ExecutorName | None,
    workers: int | None,
) -> Iterator[Schedule]:
    """Yield a schedule of the missing points, on an executor that is open in this context."""
    ready, packed = deque(_left(sweep, journal)), pickle.dumps(sweep)
    if isinstance(executor, Executor):
        yield Schedule(packed, workers or executors.size_of(executor), ready, executor)
        return
    with executors.pool(executor or executors.default_name(), workers) as opened:
        yield Schedule(packed, opened.n_workers, ready, opened.executor, opened.renew)


def _left(sweep: Sweep, journal: Journal) -> list[Track]:
    """Return the points that are not in the journal, as tracks."""
    if sweep.file.order == "independent":
        missing = Waiting.all_but(journal.numbers(), sweep.n_points)
        return [Track(INDEPENDENT, missing)] if missing else []
    is_done = np.zeros(sweep.n_points, dtype=np.bool_)
    for number in journal.numbers():
        is_done[number] = True
    tracks = []
    for number, points in enumerate(sweep.tracks):
        missing = Waiting([points[~is_done[points]]])
        if missing:
            tracks.append(Track(number, missing, journal.state(number)))
    return tracks


def _attributes(
    sweep: Sweep, journal: Journal, schedule: Schedule, seconds: float
) -> dict[str, str | int | float]:
    """Return attributes on the computation of the dataset; times are those of this call alone."""
    counts, costs = journal.counts(), schedule.costs
    n_done = sum(counts.values())
    return {
        "n_points": sweep.n_points,
        "n_completed": counts.get("completed", 0),
        "n_diverged": counts.get("diverged", 0),
        "n_failed": counts.get("failed", 0),
        "n_missing": sweep.n_points - n_done,
        "engine": sweep.file.engine,
        "workers": schedule.n_workers,
        "wall_seconds": seconds,
        "busy_seconds": costs.busy,
        "scheduling_overhead": costs.overhead,
    }


def remove_results(directory: Path) -> None:
    """Remove the result and the journal of a sweep, so that it is computed from the beginning."""
    _remove_journal(directory)
    (directory / RESULT).unlink(missing_ok=True)


def _remove_journal(directory: Path) -> None:
    """Remove the journal, after what a killed process has left beside it."""
    for path in sorted(directory.glob(f"{JOURNAL}*"), reverse=True):
        path.unlink(missing_ok=True)


def is_complete(directory: Path, sweep: Sweep) -> bool:
    """Return whether a folder already has the complete result of a sweep.

    Raises:
        CaseError: the folder has the result of another sweep.
    """
    path = directory / RESULT
    if not path.is_file() or (directory / JOURNAL).exists():
        return False
    data = open_result(path)
    same = data.attrs["sweep"], data.attrs["case"]
    data.close()
    if same != (sweep.to_toml("case.toml"), sweep.base.to_toml()):
        raise CaseError(
            f"resume: {path} is the result of another sweep; choose another folder with -o DIR"
        )
    return True
