"""Join the part files of a journal: each point once, in order, whoever computed it.

Two processes may have computed the same point, because one was started twice or a killed one had
more on the disk than was known. Both have the same numbers; if not, that is reported.
"""

from __future__ import annotations

import logging
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np

from delam_fem.case.toml import CaseError
from delam_fem.numerics.arrays import BoolArray, FloatArray, IntArray
from delam_fem.simulation.loop import State
from delam_fem.studies.sweeps.records import Kept, MappedPart
from delam_fem.studies.sweeps.shards import Shard, named

OUTCOMES = ("completed", "diverged", "failed")
"""Outcomes of points, in the order in which one of two is preferred."""
_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Block:
    """Finished points of a range, in order.

    Attributes:
        numbers: indices of the points, shape (m,).
        outcomes: places in `OUTCOMES`, shape (m,).
        errors: reasons why points were not completed, by index.
        rows: numbers of the points, NaN for those that were not completed, shape (m, size).
    """

    numbers: IntArray
    outcomes: IntArray
    errors: dict[int, str]
    rows: FloatArray


class Joined:
    """The finished points in part files.

    Attributes:
        numbers: indices of the finished points; they increase, shape (m,).
        n_disagreeing: number of points that two processes computed differently.
        shards: the shards that have a part file.
        seconds: computing time of all chunks [s].
        machines: hosts and kinds of processors that have computed them.
    """

    def __init__(self, parts: Iterable[Path], identity: str, versions: str) -> None:
        """Read part files.

        Args:
            parts: their paths.
            identity: of the sweep.
            versions: of this program and its libraries; points of others are kept with a warning.

        Raises:
            CaseError: a file belongs to another sweep.
            OSError: a file cannot be read.
        """
        self._parts: list[MappedPart] = []
        self._by_track: dict[int, list[Kept]] | None = None
        self.shards: set[Shard] = set()
        self.machines: set[tuple[str, str]] = set()
        try:
            for path in sorted(parts):
                self._read(path, identity, versions)
            self._chunks = [chunk for part in self._parts for chunk in part.chunks]
            self._resolve()
        except BaseException:
            self.close()
            raise
        self.seconds = sum(chunk.seconds for chunk in self._chunks)

    def _read(self, path: Path, identity: str, versions: str) -> None:
        part = MappedPart(path)
        self._parts.append(part)
        shard = named(path.name)
        if shard is not None:
            self.shards.add(shard)
        if part.lost:
            _log.warning(
                "%s: %d damaged bytes; the points in them are computed anew", path, part.lost
            )
        if part.about is None:
            return  # its process was killed before it had written anything
        if part.about.get("identity") != identity:
            raise CaseError(
                f"resume: {path} belongs to another sweep; run it with the settings of the "
                "interrupted one, or choose another folder with -o DIR"
            )
        self.machines.add((str(part.about.get("host")), str(part.about.get("processor"))))
        if part.about.get("versions") != versions:
            _log.warning(
                "%s was begun with %s; its points are kept", path, part.about.get("versions")
            )

    def _resolve(self) -> None:
        """Find the chunk and the place in it of every point; of two results keep the better."""
        lengths = [chunk.indices.size for chunk in self._chunks]
        none: IntArray = np.empty(0, dtype=np.int64)
        numbers = np.concatenate([none, *(chunk.indices for chunk in self._chunks)])
        owner = np.repeat(np.arange(len(lengths)), lengths)
        begins = np.cumsum([0, *lengths])[:-1]
        place = np.arange(numbers.size) - np.repeat(begins, lengths)
        outcome = np.zeros(numbers.size, dtype=np.int64)
        for begin, chunk in zip(begins, self._chunks, strict=True):
            for k, (word, _) in chunk.others.items():
                outcome[begin + k] = OUTCOMES.index(word)
        order = np.lexsort((owner, outcome, numbers))
        is_first: BoolArray = np.ones(order.size, dtype=np.bool_)
        is_first[1:] = np.diff(numbers[order]) > 0
        kept = order[is_first]
        self.numbers: IntArray = numbers[kept]
        self._owner, self._place, self._outcome = owner[kept], place[kept], outcome[kept]
        again = order[~is_first]
        self.n_disagreeing = sum(
            not self._is_same(int(numbers[k]), self._chunks[owner[k]], int(place[k])) for k in again
        )

    def _is_same(self, number: int, chunk: Kept, place: int) -> bool:
        """Return whether a second result of a point equals the one that is kept, bit by bit."""
        k = int(np.searchsorted(self.numbers, number))
        kept, at = self._chunks[self._owner[k]], int(self._place[k])
        if chunk.others.get(place) != kept.others.get(at):
            return False
        if place in chunk.others:
            return True
        mine = chunk.rows[_rows_before(chunk, np.array([place]))]
        theirs = kept.rows[_rows_before(kept, np.array([at]))]
        return bool(mine.tobytes() == theirs.tobytes())

    def counts(self) -> dict[str, int]:
        """Return the number of points by outcome."""
        found = np.bincount(self._outcome, minlength=len(OUTCOMES))
        return dict(zip(OUTCOMES, found.tolist(), strict=True))

    def block(self, start: int, stop: int, size: int) -> Block:
        """Return the finished points with indices from `start` to below `stop`.

        Args:
            start: first index.
            stop: index after the last.
            size: numbers in a row.
        """
        first, last = np.searchsorted(self.numbers, (start, stop))
        numbers, owner = self.numbers[first:last], self._owner[first:last]
        place, outcomes = self._place[first:last], self._outcome[first:last]
        rows = np.full((numbers.size, size), np.nan)
        errors: dict[int, str] = {}
        order = np.argsort(owner, kind="stable")
        bounds = np.flatnonzero(np.diff(owner[order], prepend=-1))
        for own in np.split(order, bounds[1:]) if numbers.size else ():
            chunk = self._chunks[owner[own[0]]]
            good = own[outcomes[own] == 0] if chunk.others else own
            if good.size:
                rows[good] = chunk.rows[_rows_before(chunk, place[good])]
            if chunk.others:
                bad = own[outcomes[own] > 0]
                errors |= {int(numbers[k]): chunk.others[int(place[k])][1] for k in bad}
        return Block(numbers, outcomes, errors, rows)

    def reached(self, points: IntArray, track: int) -> tuple[int, State | None]:
        """Return how far a track has come.

        Args:
            points: of the track, in order.
            track: its number.

        Returns:
            The number of its finished points from the first one on without a gap, and the state
            from which the next starts (None: from the initial conditions).
        """
        end, state = 0, None
        for first, chunk in sorted(self._of_track(points, track), key=lambda found: found[0]):
            if first > end:
                break  # damaged points; they and the later ones are computed anew
            if first + chunk.indices.size > end:
                end, state = first + chunk.indices.size, chunk.state
        return end, state

    def _of_track(self, points: IntArray, track: int) -> list[tuple[int, Kept]]:
        """Return the chunks of a track with the place of their first point in it."""
        if self._by_track is None:
            self._by_track = {}
            for chunk in self._chunks:
                self._by_track.setdefault(chunk.track, []).append(chunk)
        found = self._by_track.get(track, [])
        if not found:
            return []
        order = np.argsort(points)
        firsts = order[np.searchsorted(points[order], [chunk.indices[0] for chunk in found])]
        return list(zip(firsts.tolist(), found, strict=True))

    def close(self) -> None:
        """Unmap the files."""
        self._chunks = []
        self._by_track = None
        for part in self._parts:
            part.close()

    def __enter__(self) -> Self:
        """Return the points."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Unmap the files."""
        self.close()


def _rows_before(chunk: Kept, places: IntArray) -> IntArray:
    """Return the rows of points that were completed; the others of their chunk have none."""
    if not chunk.others:
        return places
    return places - np.searchsorted(np.array(sorted(chunk.others)), places)
