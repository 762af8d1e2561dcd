"""Keep every finished point of a sweep in part files that show whether they are whole.

Each process writes a part file of its own, named by shard, machine and process, and only appends to
it. Nothing depends on locks, which network file systems may not have: two processes that compute
the same shard by mistake write two files, and the second result of a point changes nothing.

Each record of a part file has a mark, its length and a checksum. A record that was torn by a kill,
or is damaged, is left out, and reading goes on at the next mark. The first record says to which
sweep the file belongs; the others are chunks.

The part files of a journal are joined: each point once, in order, whoever computed it. Two
processes may have computed the same point, because one was started twice or a killed one had more
on the disk than was known. Both have the same numbers; if not, that is reported.
"""

from __future__ import annotations

import errno
import fcntl
import json
import logging
import math
import mmap
import os
import platform
import re
import struct
import time
import zlib
from collections import defaultdict
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from delam_fem.api import (
    BoolArray,
    CaseError,
    FloatArray,
    IntArray,
    State,
    processor,
    require_same,
    versions,
)
from delam_fem.studies.sweeps.point import ChunkResult
from delam_fem.studies.sweeps.schedule import WHOLE, Shard, named

MARK = b"\x89points\n"
_FRAME = struct.Struct("<8sQII")
"""Mark, length of the payload, its checksum, checksum of the fields before."""
_ALIGNED = 8
"""Numbers start at multiples of this many bytes of a payload."""


@dataclass(frozen=True)
class StoredChunk:
    """A chunk of points as a part file has it.

    Attributes:
        track: number of its track, -1 if the points are independent.
        indices: of the points, in the order in which they were computed, shape (n,).
        others: outcome and error of points that were not completed, by their place in `indices`.
        rows: numbers of the points, NaN for those that were not completed, shape (n, size). They
            lie in the mapped file.
        state: from which the track goes on; None: from its initial conditions.
        seconds: computing time [s].
    """

    track: int
    indices: IntArray
    others: dict[int, tuple[str, str]]
    rows: FloatArray
    state: State | None
    seconds: float


def framed(payload: bytes) -> bytes:
    """Return a payload as a record."""
    head = _FRAME.pack(MARK, len(payload), zlib.crc32(payload), 0)[:-4]
    return head + struct.pack("<I", zlib.crc32(head)) + payload


def packed(done: ChunkResult) -> bytes:
    """Return a finished chunk as a record.

    Its payload is the length of a JSON text (8 bytes), this text with spaces up to a multiple of 8
    bytes, and the arrays whose types and shapes the text has: indices, rows, and the parts of the
    state if there is one.
    """
    points, state = done.points, done.state
    none = np.full(max((p.row.size for p in points if p.row is not None), default=0), np.nan)
    rows = np.array([none if p.row is None else p.row for p in points])
    indices = np.array([p.index for p in points], dtype=np.int64)
    arrays = {"indices": indices, "rows": rows, **({} if state is None else state.arrays)}
    about = {
        "track": done.chunk.track,
        "arrays": {name: [a.dtype.str, *a.shape] for name, a in arrays.items()},
        "others": [[k, p.outcome, p.error] for k, p in enumerate(points) if p.row is None],
        "seconds": round(done.seconds, 6),
    }
    text = json.dumps(about).encode()
    text += b" " * (-len(text) % _ALIGNED)
    head = struct.pack("<Q", len(text)) + text
    return framed(head + b"".join(np.ascontiguousarray(a).tobytes() for a in arrays.values()))


def payloads(data: mmap.mmap | bytes) -> Iterator[tuple[int, int]]:
    """Yield start and stop of the payload of each whole record in a part file."""
    place = data.find(MARK)
    size = len(data)
    while 0 <= place <= size - _FRAME.size:
        head = data[place : place + _FRAME.size]
        _, length, checksum, head_checksum = _FRAME.unpack(head)
        start = place + _FRAME.size
        is_whole = zlib.crc32(head[:-4]) == head_checksum and start + length <= size
        if is_whole:
            with memoryview(data) as view, view[start : start + length] as payload:
                is_whole = zlib.crc32(payload) == checksum
        if is_whole:
            yield start, start + length
        place = data.find(MARK, start + length if is_whole else place + 1)


def _unmap(data: mmap.mmap) -> None:
    """Unmap a file whose rows nobody holds."""
    with suppress(BufferError):  # while an error is handled, its frames hold some rows
        data.close()


def unpacked(data: mmap.mmap | bytes, start: int) -> StoredChunk:
    """Return the chunk in the payload at `start` of a part file; see `packed`."""
    (length,) = struct.unpack_from("<Q", data, start)
    place = start + 8 + length
    arrays: dict[str, Any] = {}
    about = json.loads(data[start + 8 : place])
    for name, (kind, *shape) in about["arrays"].items():
        array = np.frombuffer(data, kind, math.prod(shape), place)
        arrays[name] = array.reshape(shape)
        place += array.nbytes
    indices = arrays.pop("indices")
    rows = arrays.pop("rows")
    copies = {name: values.copy() for name, values in arrays.items()}
    state = State.of(copies) if copies else None
    others = {int(k): (str(outcome), str(error)) for k, outcome, error in about["others"]}
    return StoredChunk(about["track"], indices.copy(), others, rows, state, about["seconds"])


OUTCOMES = ("completed", "diverged", "failed")
"""Outcomes of points, in the order in which one of two is preferred."""
_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class PointRange:
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


class MergedParts(ExitStack):
    """The finished points in part files, which stay mapped until this object is closed.

    Attributes:
        identity: identity of the sweep.
        numbers: indices of the finished points; they increase, shape (m,).
        n_disagreeing: number of points that two processes computed differently.
        shards: the shards that have a part file.
        seconds: computing time of all chunks [s].
        machines: hosts and kinds of processors that have computed them.
    """

    def __init__(self, parts: Iterable[Path], identity: str, versions: str) -> None:
        """Read part files.

        Args:
            parts: paths of the files.
            identity: identity of the sweep.
            versions: versions of this program and its libraries; points of others are kept with a
                warning.

        Raises:
            CaseError: a file belongs to another sweep.
            OSError: a file cannot be read.
        """
        super().__init__()
        self.identity = identity
        self._chunks: list[StoredChunk] = []
        self._by_track: defaultdict[int, list[StoredChunk]] = defaultdict(list)
        self.shards: set[Shard] = set()
        self.machines: set[tuple[str, str]] = set()
        try:
            for path in sorted(parts):
                self._read(path, versions)
            self._resolve()
        except BaseException:
            self.close()
            raise
        self.seconds = sum(chunk.seconds for chunk in self._chunks)
        self.callback(self._chunks.clear)  # before their files are unmapped
        self.callback(self._by_track.clear)

    def _read(self, path: Path, versions: str) -> None:
        """Map a part file and take in its whole records."""
        if (shard := named(path.name)) is not None:
            self.shards.add(shard)
        with path.open("rb") as file:
            if os.fstat(file.fileno()).st_size == 0:
                return  # its process was killed before it had written anything
            data = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
        self.callback(_unmap, data)
        about: dict[str, Any] = {}
        after = lost = 0  # bytes between whole records; a torn end is not counted
        for start, stop in payloads(data):
            lost += start - _FRAME.size - after
            after = stop
            if start == _FRAME.size:
                about = json.loads(data[start:stop])
                if about.get("format") != FORMAT:
                    raise CaseError(f"{path}: is of another version; delete it, or use that one")
            elif about:
                self._chunks.append(unpacked(data, start))
                self._by_track[self._chunks[-1].track].append(self._chunks[-1])
            else:
                lost += stop - start  # their sweep is not known
        if lost:
            _log.warning("%s: %d damaged bytes; the points in them are computed anew", path, lost)
        if not about:
            return
        require_same(str(about.get("identity")), self.identity, path)
        self.machines.add((str(about.get("host")), str(about.get("processor"))))
        if about.get("versions") != versions:
            _log.warning("%s was begun with %s; its points are kept", path, about.get("versions"))

    def _resolve(self) -> None:
        """Find chunk and place of every point; of two results keep the better, then the first."""
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
        firsts = order[is_first]
        self.numbers: IntArray = numbers[firsts]
        self._owner = owner[firsts]
        self._place = place[firsts]
        self._outcome = outcome[firsts]
        again = order[~is_first]
        self.n_disagreeing = sum(
            not self._is_same(int(numbers[k]), self._chunks[owner[k]], int(place[k])) for k in again
        )

    def _is_same(self, number: int, chunk: StoredChunk, place: int) -> bool:
        """Return whether a second result of a point equals the one that is kept, bit by bit."""
        k = int(np.searchsorted(self.numbers, number))
        earlier = self._chunks[self._owner[k]]
        at = int(self._place[k])
        if chunk.others.get(place) != earlier.others.get(at):
            return False
        if place in chunk.others:
            return True
        return bool(chunk.rows[place].tobytes() == earlier.rows[at].tobytes())

    def counts(self) -> dict[str, int]:
        """Return the number of points by outcome."""
        counts = np.bincount(self._outcome, minlength=len(OUTCOMES))
        return dict(zip(OUTCOMES, counts.tolist(), strict=True))

    def block(self, start: int, stop: int, size: int) -> PointRange:
        """Return the finished points with indices from `start` to below `stop`.

        Args:
            start: first index.
            stop: index after the last.
            size: number of values in a row.
        """
        first, last = np.searchsorted(self.numbers, (start, stop))
        numbers = self.numbers[first:last]
        owner = self._owner[first:last]
        place = self._place[first:last]
        outcomes = self._outcome[first:last]
        rows = np.full((numbers.size, size), np.nan)
        errors: dict[int, str] = {}
        order = np.argsort(owner, kind="stable")
        bounds = np.flatnonzero(np.diff(owner[order], prepend=-1))
        for indices in np.split(order, bounds[1:]) if numbers.size else ():
            chunk = self._chunks[owner[indices[0]]]
            good = indices[outcomes[indices] == 0] if chunk.others else indices
            if good.size:
                rows[good] = chunk.rows[place[good]]
            if chunk.others:
                bad = indices[outcomes[indices] > 0]
                errors |= {int(numbers[k]): chunk.others[int(place[k])][1] for k in bad}
        return PointRange(numbers, outcomes, errors, rows)

    def reached(self, points: IntArray, track: int) -> tuple[int, State | None]:
        """Return how many points of a track are finished, and the state after them.

        Args:
            points: points of the track, in order.
            track: number of the track.

        Returns:
            The number of its finished points from the first one on without a gap, and the state
            from which the next starts (None: from the initial conditions).
        """
        end = 0
        state = None
        chunks = self._by_track[track]
        order = np.argsort(points)
        firsts = order[np.searchsorted(points[order], [chunk.indices[0] for chunk in chunks])]
        pairs = zip(firsts.tolist(), chunks, strict=True)
        for first, chunk in sorted(pairs, key=lambda pair: pair[0]):
            if first > end:
                break  # damaged points; they and the later ones are computed anew
            if first + chunk.indices.size > end:
                end = first + chunk.indices.size
                state = chunk.state
        return end, state


PATIENCE = 5.0
"""Time to wait for the journal of another process that is about to end [s]."""
FORMAT = 3
"""Number of the format of part files."""
_SUFFIX, _LOCK = ".points", "lock"
_POLL = 0.1


class Journal(ExitStack):
    """The journal of a sweep, or the part of one shard in it.

    Attributes:
        path: path of the folder.
        shard: the shard whose points are added; the whole sweep reads the points of all shards.
    """

    def __init__(
        self,
        path: Path,
        identity: str,
        *,
        resume: bool,
        shard: Shard = WHOLE,
        patience: float = PATIENCE,
    ) -> None:
        """Open a journal to add points to it.

        A second process on the whole sweep is refused where the file system has locks. Shards lock
        nothing, because the lock of a machine that has died may stay.

        Args:
            path: path of the folder; it is made if it does not exist.
            identity: text that is equal only for the same sweep.
            resume: whether to continue with finished points in the folder.
            shard: the shard whose points are added.
            patience: time to wait for another process that has locked the journal [s].

        Raises:
            CaseError: another process computes the sweep; a part belongs to another sweep; there
                are finished points and `resume` is False; or the path is a file.
            OSError: the folder cannot be made or read.
        """
        super().__init__()
        self.path = path
        self.shard = shard
        self._handle = -1
        self._identity = identity
        try:
            path.mkdir(exist_ok=True)
        except FileExistsError:
            raise CaseError(
                f"{path}: expected the journal of a sweep, a folder; this file is of an older "
                "version, or another one. Delete it, or choose another folder with -o DIR"
            ) from None
        # a name that no other process gives
        host = re.sub(r"[^\w-]", "_", platform.node())[:40] or "host"
        name = f"{shard.name}.{host}.{os.getpid()}.{time.time_ns():x}{_SUFFIX}"
        self._part = path / name
        if shard.is_whole:
            self._lock(patience)
        try:
            with self.merged() as parts:
                if parts.numbers.size and not resume:
                    raise CaseError(
                        f"{path.parent}: holds {parts.numbers.size} points of an unfinished sweep; "
                        "go on with --resume, choose another folder with -o DIR, or delete it"
                    )
        except BaseException:
            self.close()
            raise

    def merged(self) -> MergedParts:
        """Return the finished points of the shard that are on the disk now; the caller closes them.

        Raises:
            CaseError: a part belongs to another sweep.
            FileNotFoundError: the part of this process was deleted.
        """
        self._require_part()
        pattern = f"*{_SUFFIX}" if self.shard.is_whole else f"{self.shard.name}.*{_SUFFIX}"
        return MergedParts(self.path.glob(pattern), self._identity, _versions())

    def add(self, done: Iterable[ChunkResult]) -> None:
        """Append finished chunks to the part file and wait until they are on disk.

        The file is made at the first call and begins with a record of what it belongs to.

        Raises:
            OSError: the file cannot be written, or was deleted; what was there before stays
                readable.
        """
        data = b"".join(packed(result) for result in done)
        try:
            if self._handle < 0:
                flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_APPEND
                self._handle = os.open(self._part, flags, 0o666)
                self.callback(os.close, self._handle)
                about = {
                    "format": FORMAT,
                    "identity": self._identity,
                    "versions": _versions(),
                    "shard": str(self.shard),
                    "host": platform.node(),
                    "processor": processor(),
                    "process": os.getpid(),
                }
                data = framed(json.dumps(about).encode()) + data
            view = memoryview(data)
            while len(view):
                view = view[os.write(self._handle, view) :]
            os.fsync(self._handle)
        except OSError as error:
            self._require_part()
            raise OSError(error.errno, error.strerror, str(self._part)) from None
        self._require_part()

    def _require_part(self) -> None:
        """Stop if somebody has deleted what this process has written, or its folder."""
        written = self.path if self._handle < 0 else self._part
        if not written.exists():
            raise FileNotFoundError(
                errno.ENOENT,
                "was deleted while the sweep was computed; the sweep stops, as its points are lost",
                str(written),
            )

    def _lock(self, patience: float) -> None:
        """Lock the journal until it is closed, if the file system has locks.

        Raises:
            CaseError: another process has locked it.
        """
        end = time.monotonic() + patience
        handle = os.open(self.path / _LOCK, os.O_WRONLY | os.O_CREAT, 0o666)
        self.callback(os.close, handle)
        while True:
            try:
                fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
                return
            except BlockingIOError:
                if time.monotonic() >= end:
                    self.close()
                    raise CaseError(
                        f"{self.path}: is another process computing this sweep? Wait for it, or "
                        "choose another folder with -o DIR"
                    ) from None
                time.sleep(_POLL)
            except OSError as error:  # some network file systems
                _log.debug("%s cannot be locked (%s)", self.path, error.strerror)
                return


def remove_journal(path: Path) -> None:
    """Remove the journal at a path, if there is one; files of other kinds in it stay."""
    if not path.is_dir():
        path.unlink(missing_ok=True)
        return
    for entry in path.iterdir():
        if entry.name == _LOCK or entry.suffix == _SUFFIX or entry.name.startswith("."):
            entry.unlink(missing_ok=True)
    with suppress(OSError):
        path.rmdir()  # if it is empty


def _versions() -> str:
    """Return the versions on which the bits of the numbers depend."""
    return ", ".join(f"{name} {number}" for name, number in versions().items())
