"""Do what `delam-fem sweep` does for clusters: compute a shard, merge all shards."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from delam_fem.cli.console.terminal import FAILED, INTERRUPTED, error_console, fail, table

if TYPE_CHECKING:
    import xarray as xr

    from delam_fem.studies.executors import ExecutorName
    from delam_fem.studies.sweeps.grid import Sweep

ShardOption = Annotated[
    str | None,
    typer.Option(
        "--shard",
        metavar="K/N",
        help="Compute only the K-th of N shares of the points; --merge joins them.",
    ),
]
Merge = Annotated[
    bool, typer.Option("--merge", help="Join the shards in the folder to the result.")
]
Partial = Annotated[
    bool, typer.Option("--partial", help="With --merge: write what is there if points are missing.")
]
Slurm = Annotated[
    int | None,
    typer.Option(
        "--slurm",
        min=1,
        metavar="N",
        help="Print a script that computes N shards as an array of SLURM jobs and merges them.",
    ),
]
Hours = Annotated[
    float | None,
    typer.Option(
        "--hours", min=0.0, metavar="H", help="With --slurm: longest time of a job (default: 24)."
    ),
]
DAY = 24.0
"""Longest time of a job unless the user says another [h]."""


def require_one(**given: object) -> str | None:
    """Return which of some options is given; None if none is.

    Args:
        given: options by name, without `--`.

    Raises:
        CaseError: several are given.
    """
    from delam_fem.case.toml import CaseError

    names = [f"--{name}" for name, value in given.items() if value not in (None, False)]
    if len(names) > 1:
        raise CaseError(f"expected one of {' and '.join(names)}, given both")
    return names[0].removeprefix("--") if names else None


def require_fitting(
    way: str | None, whole: Mapping[str, bool], partial: bool, hours: float | None
) -> None:
    """Check the options that go with a way of computing a sweep.

    Args:
        way: "shard", "merge" or "slurm"; None: the whole sweep at once.
        whole: options that only go with the whole sweep, by name.
        partial: whether to write a result without all points.
        hours: longest time of a job, if it is given.

    Raises:
        CaseError: an option does not go with the way.
    """
    from delam_fem.case.toml import CaseError

    if partial and way != "merge":
        raise CaseError("--partial: only goes with --merge")
    if hours is not None and way != "slurm":
        raise CaseError("--hours: only goes with --slurm")
    found = next((name for name, value in whole.items() if value), None)
    if way is not None and found is not None:
        raise CaseError(f"--{found.replace('_', '-')}: does not go with --{way}; leave it out")


def compute_shard(
    sweep: Sweep,
    directory: Path,
    text: str,
    where: tuple[int | None, ExecutorName | None],
    inputs: list[Path],
    **options: Any,
) -> None:
    """Compute a shard and show how far it is; exit with a message if it is not complete."""
    from delam_fem.case.claim import claimed
    from delam_fem.cli.console.progress import progress
    from delam_fem.studies.sweeps.run import run_shard
    from delam_fem.studies.sweeps.shards import parse_shard

    shard, quiet = parse_shard(text), options.pop("quiet")
    workers, executor = where
    with claimed(directory, inputs=inputs, is_shared=True):
        with progress(error_console(quiet)) as report:
            found = run_shard(
                sweep, directory, shard, executor, workers=workers, progress=report, **options
            )
    if not quiet:
        rows = [(name.replace("_", " "), _shown(value)) for name, value in found.about.items()]
        rows = [("points", f"{found.n_done} of {found.n_points}"), *rows]
        table(f"sweep {sweep.file.name}, shard {shard}", ("", "value"), rows)
    if found.n_done < found.n_points:
        left = found.n_points - found.n_done
        fail(
            f"interrupted with {left} of {found.n_points} points of shard {shard} left; --resume "
            "goes on",
            INTERRUPTED,
        )


def merge_shards(
    sweep: Sweep, directory: Path, inputs: list[Path], *, is_partial: bool
) -> xr.Dataset:
    """Join the shards of a sweep; exit with a message if all points failed."""
    from delam_fem.case.claim import claimed
    from delam_fem.case.toml import CaseError
    from delam_fem.studies.sweeps.merge import merge_sweep

    if not directory.is_dir():
        raise CaseError(f"merge: no such folder: {directory}; give that of the shards with -o DIR")
    with claimed(directory, inputs=inputs, may_hold_results=True):
        data = merge_sweep(sweep, directory, is_partial=is_partial)
    about = data.attrs
    if not about["n_completed"] and not about["n_missing"]:
        first = next(text for text in data["error"].to_numpy().ravel() if text)
        fail(f"none of the {about['n_points']} points was completed; the first: {first}", FAILED)
    return data


def print_script(
    sweep: Sweep,
    sweep_file: Path,
    directory: Path,
    overrides: list[str] | None,
    n_shards: int,
    hours: float | None,
) -> None:
    """Measure the time of a point, and print the script of the shards."""
    from delam_fem.studies.slurm import array_script, measured_cost

    command = [sys.executable, "-m", "delam_fem", "sweep", str(sweep_file.resolve())]
    command += ["-o", str(directory.resolve())]
    command += [f"--set={text}" for text in overrides or []]
    cost = measured_cost(sweep)
    most = DAY if hours is None else hours
    text = array_script(sweep, command, n_shards, cost, most_hours=most, interrupted=INTERRUPTED)
    typer.echo(text, nl=False)


def _shown(value: object) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)
