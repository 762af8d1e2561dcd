"""Write the result of a sweep from its journal: of a run, or of many shards.

However the points were computed, the same points give the same bytes.
"""

from __future__ import annotations

import json
import logging
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from delam_fem.case.atomic import write_text
from delam_fem.case.files import save_case
from delam_fem.case.toml import CaseError
from delam_fem.model.layout import Layout
from delam_fem.numerics.arrays import IntArray
from delam_fem.results.provenance import occasion
from delam_fem.studies.sweeps import dataset
from delam_fem.studies.sweeps.grid import Sweep
from delam_fem.studies.sweeps.joined import Joined
from delam_fem.studies.sweeps.journal import Journal, remove_journal
from delam_fem.studies.sweeps.point import PointRunner
from delam_fem.studies.sweeps.quantities import quantities
from delam_fem.studies.sweeps.reading import OCCASION, open_result
from delam_fem.studies.sweeps.shards import owners

if TYPE_CHECKING:
    import xarray as xr

RESULT, JOURNAL = "sweep.nc", "sweep.journal"
"""Names of the dataset and the journal in the folder of a sweep."""
_SHOWN = 5
"""Number of shards that a message names."""
_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Missing:
    """The points that no shard has finished.

    Attributes:
        n_points: their number.
        by_shard: number of missing points of each shard that misses some, by its name `k/n`;
            empty if the journals are of different numbers of shards.
    """

    n_points: int
    by_shard: dict[str, int]

    def __str__(self) -> str:
        """Return how many points are missing, and of which shards."""
        most = sorted(self.by_shard.items(), key=lambda row: -row[1])
        named = [f"{count} of shard {shard}" for shard, count in most[:_SHOWN]]
        if len(most) > _SHOWN:
            named.append(f"the others of {len(most) - _SHOWN} more shards")
        return f"{self.n_points} points are missing" + (f": {', '.join(named)}" if named else "")


def merge_sweep(sweep: Sweep, directory: str | Path, *, is_partial: bool = False) -> xr.Dataset:
    """Join the journals of all shards of a sweep to its result.

    The journal is removed when the result has all points. Part files of shards that were computed
    elsewhere may be copied into the folder `sweep.journal` before.

    Args:
        sweep: the sweep.
        directory: its folder.
        is_partial: whether to write the result although points are missing; they are NaN.

    Returns:
        The dataset, opened lazily; the same as that of `run_sweep`.

    Raises:
        CaseError: there is no journal; it belongs to another sweep; another process computes the
            sweep; or points are missing and `is_partial` is False.
        OSError: a file cannot be read or written.
    """
    directory = Path(directory)
    if is_complete(directory, sweep):
        return open_result(directory / RESULT)
    path = directory / JOURNAL
    if not path.exists():
        raise CaseError(
            f"merge: {directory} has no journal of a sweep; delam-fem sweep FILE --shard K/N "
            f"-o {directory} computes a shard"
        )
    layout = PointRunner(sweep).structure(sweep.case(0)).layout
    with Journal(path, sweep.identity, resume=True) as journal, journal.joined() as joined:
        left = missing(sweep, joined)
        if left.n_points and not is_partial:
            raise CaseError(
                f"merge: {left}; --shard K/N --resume goes on with a shard, --resume alone "
                "computes all that is missing, and --partial writes what is there"
            )
        if joined.n_disagreeing:
            _log.warning(
                "%d points were computed twice with different results, on different machines or "
                "versions; the first is kept",
                joined.n_disagreeing,
            )
        save_sweep(sweep, directory)
        about = {"n_shards": len(joined.shards), "busy_seconds": joined.seconds}
        write_result(sweep, directory, joined, layout, about)
    if not left.n_points:
        remove_journal(path)
    return open_result(directory / RESULT)


def missing(sweep: Sweep, joined: Joined) -> Missing:
    """Return which points of a sweep are not in its journal."""
    n_points = sweep.n_points - joined.numbers.size
    numbers_of_shards = {shard.of for shard in joined.shards} - {1}
    if not n_points or len(numbers_of_shards) != 1:
        return Missing(n_points, {})
    (of,) = numbers_of_shards
    is_left = np.ones(sweep.n_points, dtype=np.bool_)
    is_left[joined.numbers] = False
    items: IntArray = np.flatnonzero(is_left)
    if sweep.tracks:
        track: IntArray = np.empty(sweep.n_points, dtype=np.int64)
        for number, points in enumerate(sweep.tracks):
            track[points] = number
        items = track[items]
    counts = np.bincount(owners(items, of))
    return Missing(n_points, {f"{k}/{of}": int(counts[k]) for k in np.flatnonzero(counts)})


def save_sweep(sweep: Sweep, directory: Path) -> None:
    """Write the files from which a sweep can be repeated."""
    save_case(sweep.base, directory)
    write_text(directory / "sweep.toml", sweep.to_toml("case.toml"))


def write_result(
    sweep: Sweep,
    directory: Path,
    joined: Joined,
    layout: Layout,
    about: Mapping[str, str | int | float],
) -> None:
    """Write the dataset of a sweep, and how it was computed.

    Args:
        sweep: the sweep.
        directory: its folder.
        joined: the finished points.
        layout: of the first point.
        about: how the points were computed; it does not go into the dataset.
    """
    counts = joined.counts()
    n_missing = sweep.n_points - joined.numbers.size
    attributes = {
        "n_points": sweep.n_points,
        **{f"n_{outcome}": count for outcome, count in counts.items()},
        "n_missing": n_missing,
        "engine": sweep.file.engine,
        "outcome": "interrupted" if n_missing else "completed",
    }
    hosts, processors = zip(*sorted(joined.machines), strict=True) if joined.machines else ((), ())
    machines = {"hosts": ", ".join(hosts), "processors": ", ".join(sorted(set(processors)))}
    text = json.dumps({**occasion(), **machines, **about}, indent=1)
    write_text(directory / OCCASION, f"{text}\n")
    wanted = quantities(sweep.file.record, layout)
    dataset.write(directory / RESULT, sweep, joined, wanted, x=layout.x, attributes=attributes)


def is_complete(directory: Path, sweep: Sweep) -> bool:
    """Return whether a folder already has the complete result of a sweep.

    Raises:
        CaseError: the folder has the result of another sweep.
    """
    path = directory / RESULT
    if not path.is_file():
        return False
    data = open_result(path)
    about = dict(data.attrs)
    data.close()
    if about["outcome"] != "completed":
        return False
    if (about["sweep"], about["case"]) != (sweep.to_toml("case.toml"), sweep.base.to_toml()):
        raise CaseError(
            f"resume: {path} is the result of another sweep; choose another folder with -o DIR"
        )
    remove_journal(directory / JOURNAL)  # a process may have been killed before it did
    return True


def remove_results(directory: Path) -> None:
    """Remove the result and the journal of a sweep, so that it is computed from the beginning."""
    remove_journal(directory / JOURNAL)
    for name in (RESULT, OCCASION):
        (directory / name).unlink(missing_ok=True)
