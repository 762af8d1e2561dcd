"""Write and read the part files of a journal: records that show whether they are whole.

A part file is written by one process, which only appends to it. Each record has a mark, its length
and a checksum. A record that was torn by a kill, or is damaged, is left out, and reading goes on at
the next mark. The first record says to which sweep the file belongs; the others are chunks.
"""

from __future__ import annotations

import json
import mmap
import os
import struct
import zlib
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from delam_fem.numerics.arrays import FloatArray, IntArray
from delam_fem.simulation.loop import State
from delam_fem.studies.sweeps.point import Done

MARK = b"\x89points\n"
_FRAME = struct.Struct("<8sQII")
"""Mark, length of the payload, its checksum, checksum of the fields before."""
_ALIGNED = 8
"""Numbers start at multiples of this many bytes of a payload."""


@dataclass(frozen=True)
class Kept:
    """A chunk of points as a part file has it.

    Attributes:
        track: number of its track, -1 if the points are independent.
        indices: of the points, in the order in which they were computed, shape (n,).
        others: outcome and error of points that were not completed, by their place in `indices`.
        rows: numbers of the completed points in order, shape (n - len(others), size). They lie in
            the mapped file.
        state: from which the track goes on; None: from its initial conditions.
        seconds: computing time [s].
    """

    track: int
    indices: IntArray
    others: dict[int, tuple[str, str]]
    rows: FloatArray
    state: State | None
    seconds: float


class PartFile:
    """A part file that this process writes.

    Attributes:
        path: path of the file; it is made with the first record.
    """

    def __init__(self, path: Path, about: dict[str, Any]) -> None:
        """Store the path and the content of the first record."""
        self.path = path
        self._first = framed(json.dumps(about).encode())
        self._handle: int | None = None

    def add(self, data: bytes) -> None:
        """Append records and wait until they are on the disk.

        Raises:
            OSError: the file cannot be written; what was there before stays readable.
        """
        try:
            if self._handle is None:
                flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_APPEND
                self._handle = os.open(self.path, flags, 0o666)
                data = self._first + data
            view = memoryview(data)
            while len(view):
                view = view[os.write(self._handle, view) :]
            os.fsync(self._handle)
        except OSError as error:
            raise OSError(error.errno, error.strerror, str(self.path)) from None

    def close(self) -> None:
        """Close the file."""
        if self._handle is not None:
            os.close(self._handle)
            self._handle = None


class MappedPart:
    """A part file that is read.

    Attributes:
        path: path of the file.
        about: content of its first record; None if not even that is whole.
        chunks: its whole chunks, in order.
        lost: bytes between whole records; the torn end of a killed process is not counted [bytes].
    """

    def __init__(self, path: Path) -> None:
        """Read all records.

        Raises:
            OSError: the file cannot be read.
        """
        self.path = path
        self.about: dict[str, Any] | None = None
        self.chunks: list[Kept] = []
        self.lost = 0
        self._map: mmap.mmap | None = None
        with path.open("rb") as file:
            if os.fstat(file.fileno()).st_size == 0:
                return
            self._map = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
        after = 0
        for start, stop in _payloads(self._map):
            self.lost += start - _FRAME.size - after
            after = stop
            if start == _FRAME.size:
                self.about = json.loads(self._map[start:stop])
            elif self.about is None:
                self.lost += stop - start  # nobody knows of which sweep
            else:
                self.chunks.append(_unpacked(self._map, start))

    def close(self) -> None:
        """Forget the chunks and unmap the file."""
        self.chunks = []
        if self._map is not None:
            with suppress(BufferError):  # while an error is handled, its frames hold some rows
                self._map.close()
            self._map = None


def framed(payload: bytes) -> bytes:
    """Return a payload as a record."""
    head = _FRAME.pack(MARK, len(payload), zlib.crc32(payload), 0)[:-4]
    return head + struct.pack("<I", zlib.crc32(head)) + payload


def packed(done: Done) -> bytes:
    """Return a finished chunk as a record."""
    points, state = done.points, done.state
    rows = [point.row for point in points if point.row is not None]
    about = {
        "track": done.chunk.track,
        "n": len(points),
        "rows": [len(rows), rows[0].size if rows else 0],
        "others": [[k, p.outcome, p.error] for k, p in enumerate(points) if p.row is None],
        "seconds": round(done.seconds, 6),
    }
    indices: IntArray = np.array([point.index for point in points], dtype=np.int64)
    arrays: list[Any] = [indices, *rows]
    if state is not None:
        internal = np.empty(0) if state.internal is None else state.internal
        about["state"] = [state.motion.shape[1], state.resting.size]
        about["internal"] = None if state.internal is None else list(state.internal.shape)
        arrays += [state.motion, np.array(state.losses), internal, state.resting]
    text = json.dumps(about).encode()
    text += b" " * (-len(text) % _ALIGNED)
    head = struct.pack("<Q", len(text)) + text
    return framed(head + b"".join(np.ascontiguousarray(a).tobytes() for a in arrays))


def _payloads(data: mmap.mmap) -> Iterator[tuple[int, int]]:
    """Yield start and stop of the payloads of whole records."""
    place, size = data.find(MARK), len(data)
    while 0 <= place <= size - _FRAME.size:
        head = data[place : place + _FRAME.size]
        _, length, checksum, own = _FRAME.unpack(head)
        start = place + _FRAME.size
        is_whole = zlib.crc32(head[:-4]) == own and start + length <= size
        if is_whole:
            with memoryview(data) as view, view[start : start + length] as payload:
                is_whole = zlib.crc32(payload) == checksum
        if is_whole:
            yield start, start + length
        place = data.find(MARK, start + length if is_whole else place + 1)


def _unpacked(data: mmap.mmap, start: int) -> Kept:
    """Return the chunk whose payload begins at `start`."""
    (length,) = struct.unpack_from("<Q", data, start)
    place = start + 8 + length
    about = json.loads(data[start + 8 : place])

    def numbers(count: int, kind: type = np.float64) -> Any:
        nonlocal place
        found: Any = np.frombuffer(data, kind, count, place)
        place += found.nbytes
        return found

    indices = numbers(about["n"], np.int64).copy()
    n_rows, size = about["rows"]
    rows = numbers(n_rows * size).reshape(n_rows, size)
    state = None
    if "state" in about:
        n, n_resting = about["state"]
        motion, losses = numbers(3 * n).reshape(3, n).copy(), numbers(2).tolist()
        shape = about["internal"]
        internal = numbers(int(np.prod(shape or [0]))).copy()
        resting = numbers(n_resting, np.bool_).copy()
        state = State(
            motion,
            resting,
            (losses[0], losses[1]),
            None if shape is None else internal.reshape(shape),
        )
    others = {int(k): (str(outcome), str(error)) for k, outcome, error in about["others"]}
    return Kept(about["track"], indices, others, rows, state, about["seconds"])
