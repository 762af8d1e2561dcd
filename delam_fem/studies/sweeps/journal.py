"""Keep every finished point of a sweep in one file on disk, the journal.

The journal is an SQLite file. Only the parent process writes it, and after a crash a commit is
either complete or absent. It contains the finished points and, for each track, the state from which
the next point starts.
"""

from __future__ import annotations

import errno
import logging
import os
import sqlite3
import zlib
from collections.abc import Iterable, Iterator
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np

from delam_fem.case.toml import CaseError
from delam_fem.numerics.arrays import FloatArray
from delam_fem.results.provenance import versions
from delam_fem.simulation.loop import State
from delam_fem.studies.sweeps.point import Done, Point

PATIENCE = 5.0
"""Time to wait for the journal of another process that is about to end [s]."""
_log = logging.getLogger(__name__)
_SCHEMA = """
    CREATE TABLE about (identity TEXT NOT NULL, versions TEXT NOT NULL);
    CREATE TABLE point (
        number INTEGER PRIMARY KEY, outcome TEXT NOT NULL, error TEXT NOT NULL, row BLOB,
        checksum INTEGER NOT NULL
    );
    CREATE TABLE track (
        number INTEGER PRIMARY KEY, motion BLOB NOT NULL, resting BLOB NOT NULL,
        checksum INTEGER NOT NULL
    );
"""


class Journal:
    """The journal of a sweep.

    Attributes:
        path: path of the file.
    """

    def __init__(
        self, path: Path, identity: str, *, resume: bool, patience: float = PATIENCE
    ) -> None:
        """Open a journal and lock it until `close`; a second process cannot open it.

        Args:
            path: path of the file.
            identity: text that is equal only for the same sweep.
            resume: whether to continue with the finished points in the file.
            patience: time to wait for another process that has locked the file [s].

        Raises:
            CaseError: another process has locked the file; the file belongs to another sweep; or
                it has finished points and `resume` is False.
            OSError: the disk is full.
        """
        self.path = path
        self._connection = sqlite3.connect(path, timeout=patience, isolation_level=None)
        try:
            self._open(identity, resume)
        except (sqlite3.Error, TypeError, ValueError) as error:
            self._connection.close()
            if isinstance(error, CaseError):
                raise
            if "locked" in str(error):
                raise CaseError(
                    f"{path}: {error}; is another process computing this sweep? Wait for it, or "
                    "choose another folder with -o DIR"
                ) from None
            if "full" in str(error):
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path)) from None
            _log.debug("%s cannot be read", path, exc_info=True)
            raise CaseError(
                f"{path}: expected the journal of a sweep; this file is damaged or another one. "
                "Delete it, or choose another folder with -o DIR"
            ) from None

    def _open(self, identity: str, resume: bool) -> None:
        run = self._connection.execute
        run("PRAGMA locking_mode = EXCLUSIVE")
        run("PRAGMA synchronous = FULL")
        run("BEGIN EXCLUSIVE")
        if not run("SELECT count(*) FROM sqlite_master").fetchone()[0]:
            for statement in filter(str.strip, _SCHEMA.split(";")):
                run(statement)
            run("INSERT INTO about VALUES (?, ?)", (identity, _versions()))
        found, begun_with = run("SELECT identity, versions FROM about").fetchone()
        n_points = self.n_points
        if found == identity:
            self._remove_damaged()
        run("COMMIT")
        if n_points and not resume:
            raise CaseError(
                f"{self.path.parent}: holds {n_points} points of an unfinished sweep; go on with "
                "--resume, choose another folder with -o DIR, or delete it"
            )
        if found != identity:
            raise CaseError(
                f"resume: {self.path} belongs to another sweep; run it with the settings of the "
                "interrupted one, or choose another folder with -o DIR"
            )

        if begun_with != _versions():
            _log.warning("%s was begun with %s; its points are kept", self.path, begun_with)

    def _remove_damaged(self) -> None:
        """Remove points and states whose checksum does not fit; they are computed anew."""
        run = self._connection.execute
        if run("PRAGMA quick_check(1)").fetchone()[0] != "ok":
            raise ValueError("damaged pages")
        points, tracks = (
            [row[0] for row in run(f"SELECT * FROM {table} ORDER BY number") if _is_damaged(row)]
            for table in ("point", "track")
        )
        for number in points:
            run("DELETE FROM point WHERE number = ?", (number,))
        if tracks:  # without the state, its points cannot go on
            raise ValueError("damaged state")
        if points:
            _log.warning("%s: %d damaged points are computed anew", self.path, len(points))

    @property
    def n_points(self) -> int:
        """Number of finished points."""
        return int(self._connection.execute("SELECT count(*) FROM point").fetchone()[0])

    def add(self, done: Iterable[Done]) -> None:
        """Write finished chunks and wait until they are on disk.

        Raises:
            OSError: the file cannot be written.
        """
        run, many = self._connection.execute, self._connection.executemany
        try:
            run("BEGIN")
            for result in done:
                many("INSERT INTO point VALUES (?, ?, ?, ?, ?)", map(_entry, result.points))
                if result.state is not None:
                    run(
                        "INSERT OR REPLACE INTO track VALUES (?, ?, ?, ?)",
                        _summed(result.chunk.track, *_packed(result.state)),
                    )
            run("COMMIT")
        except sqlite3.OperationalError as error:
            raise OSError(0, f"cannot be written ({error})", str(self.path)) from None

    def numbers(self) -> Iterator[int]:
        """Yield the indices of the finished points, in order."""
        for (number,) in self._connection.execute("SELECT number FROM point ORDER BY number"):
            yield number

    def points(self, start: int, stop: int) -> Iterator[Point]:
        """Yield the finished points with indices from `start` to below `stop`, in order."""
        rows = self._connection.execute(
            "SELECT number, outcome, error, row FROM point WHERE number >= ? AND number < ? "
            "ORDER BY number",
            (start, stop),
        )
        for number, outcome, error, row in rows:
            yield Point(number, outcome, error, None if row is None else np.frombuffer(row))

    def counts(self) -> dict[str, int]:
        """Return the number of points by outcome."""
        return dict(
            self._connection.execute("SELECT outcome, count(*) FROM point GROUP BY outcome")
        )

    def state(self, track: int) -> State | None:
        """Return the state from which a track continues; None if the journal has none."""
        found = self._connection.execute(
            "SELECT motion, resting FROM track WHERE number = ?", (track,)
        ).fetchone()
        if found is None:
            return None
        motion: FloatArray = np.frombuffer(found[0]).reshape(3, -1).copy()
        return State(motion, np.frombuffer(found[1], dtype=np.bool_).copy())

    def close(self) -> None:
        """Close and unlock the file."""
        self._connection.close()

    def __enter__(self) -> Self:
        """Return the journal."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close the journal."""
        self.close()


def _entry(point: Point) -> tuple[object, ...]:
    row = None if point.row is None else np.ascontiguousarray(point.row).tobytes()
    return _summed(point.index, point.outcome, point.error, row)


def _packed(state: State) -> tuple[bytes, bytes]:
    return np.ascontiguousarray(state.motion).tobytes(), state.resting.tobytes()


def _summed(*values: object) -> tuple[object, ...]:
    """Return the values of a row, followed by their checksum."""
    return *values, zlib.crc32(repr(values).encode())


def _is_damaged(row: tuple[object, ...]) -> bool:
    """Return whether the checksum at the end of a row does not fit."""
    return _summed(*row[:-1]) != row


def _versions() -> str:
    """Return the versions on which the bits of the numbers depend."""
    return ", ".join(f"{name} {number}" for name, number in versions().items())
