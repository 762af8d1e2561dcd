"""Write the script that computes the shards of a sweep as an array of SLURM jobs.

Every job computes one shard. Before its time is up SLURM sends SIGTERM: the shard stops with
everything saved, and the job puts itself back into the queue. A last job merges the shards.
"""

from __future__ import annotations

import math
import shlex
import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from delam_fem.engines.cost import WORKER_BYTES, Cost
from delam_fem.studies.sweeps.grid import Sweep
from delam_fem.studies.sweeps.point import PointRunner
from delam_fem.studies.sweeps.run import share_size, sweep_cost
from delam_fem.studies.sweeps.schedule import MOST_SHARDS, Shard
from delam_fem.system.errors import CaseError

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
    """Return the time of a point, from some points across the grid that are computed here.

    Args:
        sweep: the sweep.
        seconds: time after which no further point is begun [s].
    """
    runner, times = PointRunner(sweep), []
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
    """Return the script.

    Args:
        sweep: the sweep.
        command: that computes the sweep, without the options of shards.
        n_shards: number of shards.
        cost: time of a point.
        most_hours: longest time of a job; a shard that needs more is computed in several [h].
        interrupted: exit status of a shard that has stopped before its end.

    Raises:
        CaseError: there are more shards than points or tracks, or a point needs longer than a job.
    """
    most = len(sweep.tracks) or sweep.n_points
    if not 1 <= n_shards <= min(most, MOST_SHARDS):
        what = "tracks" if sweep.tracks else "points"
        raise CaseError(f"slurm: expected 1 to {min(most, MOST_SHARDS)} shards, as the sweep has "
                        f"{most} {what}, given {n_shards}")  # fmt: skip
    share = max(share_size(sweep, Shard(k, n_shards)) for k in range(1, n_shards + 1))
    work, limit = share * cost.mean, 3600.0 * most_hours
    notice = max(_LEAST_NOTICE, 2.0 * _RESERVE * cost.most)
    if limit < _START_SECONDS + 2.0 * notice:
        raise CaseError(
            f"slurm: expected jobs of at least {(_START_SECONDS + 2.0 * notice) / 3600.0:.2g} h, "
            f"as a point takes up to {cost.most:.3g} s, given {most_hours:g} h"
        )
    whole = _START_SECONDS + notice + _RESERVE * work
    n_chunks = max(1, math.ceil(_RESERVE * work / (limit - _START_SECONDS - notice)))
    needed = sweep_cost(sweep, 1)
    files = needed.disk / 2.0
    return _TEXT.format(
        name=sweep.file.name.replace(" ", "-"),
        n_shards=n_shards,
        memory=_megabytes(needed, share),
        time=_duration(min(limit, whole)),
        notice=math.ceil(notice),
        about=_about(cost, share, work, n_chunks),
        command=shlex.join(command),
        merge_memory=math.ceil((WORKER_BYTES + _MERGE_BYTES * sweep.n_points + files) / 1e6) + 200,
        merge_time=_duration(600.0 + _MERGE_SECONDS * sweep.n_points + files / 1e7),
        interrupted=interrupted,
    )


def _about(cost: PointCost, share: int, work: float, n_chunks: int) -> str:
    """Return what a shard needs, in words."""
    chunks = "one job" if n_chunks == 1 else f"about {n_chunks} jobs one after the other"
    return (
        f"{share} points a shard, {1e3 * cost.mean:.3g} ms a point (mean of {cost.n_points} here, "
        f"longest {1e3 * cost.most:.3g} ms): {_duration(work)} of work in {chunks}"
    )


def _megabytes(needed: Cost, share: int) -> int:
    """Return the memory of a job [MB]: parent, worker, and the list of its points."""
    return math.ceil(_RESERVE * (needed.programs + needed.memory + 24.0 * share) / 1e8) * 100


def _duration(seconds: float) -> str:
    """Return a time as SLURM writes it, in whole minutes."""
    minutes = math.ceil(seconds / 60.0)
    return f"{minutes // 60:02d}:{minutes % 60:02d}:00"
