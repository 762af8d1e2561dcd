"""Keep every finished point of a sweep on disk: the journal, a folder of part files.

Each process writes a part file of its own, named by shard, machine and process, and only appends to
it. Nothing depends on locks, which network file systems may not have: two processes that compute
the same shard by mistake write two files, and the second result of a point changes nothing.
"""

from __future__ import annotations

import fcntl
import hashlib
import logging
import os
import platform
import re
import shutil
import time
from collections.abc import Iterable
from pathlib import Path
from types import TracebackType
from typing import Self

from delam_fem.case.toml import CaseError
from delam_fem.results.provenance import processor, versions
from delam_fem.studies.sweeps.joined import Joined
from delam_fem.studies.sweeps.point import Done
from delam_fem.studies.sweeps.records import PartFile, packed
from delam_fem.studies.sweeps.shards import WHOLE, Shard

PATIENCE = 5.0
"""Time to wait for the journal of another process that is about to end [s]."""
FORMAT = 1
"""Number of the format of part files."""
_SUFFIX, _LOCK = ".points", "lock"
_POLL = 0.1
_log = logging.getLogger(__name__)


class Journal:
    """The journal of a sweep, or what it has of one shard.

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
        self.path, self.shard = path, shard
        self._identity = hashlib.sha256(identity.encode()).hexdigest()
        try:
            path.mkdir(exist_ok=True)
        except FileExistsError:
            raise CaseError(
                f"{path}: expected the journal of a sweep, a folder; this file is of an older "
                "version, or another one. Delete it, or choose another folder with -o DIR"
            ) from None
        self._locked = _locked(path / _LOCK, patience) if shard.is_whole else None
        self._part = PartFile(path / _part_name(shard), self._about())
        try:
            with self.joined() as found:
                if found.numbers.size and not resume:
                    raise CaseError(
                        f"{path.parent}: holds {found.numbers.size} points of an unfinished sweep; "
                        "go on with --resume, choose another folder with -o DIR, or delete it"
                    )
        except BaseException:
            self.close()
            raise

    def _about(self) -> dict[str, object]:
        return {
            "format": FORMAT,
            "identity": self._identity,
            "versions": _versions(),
            "shard": str(self.shard),
            "host": platform.node(),
            "processor": processor(),
            "process": os.getpid(),
        }

    def joined(self) -> Joined:
        """Return the finished points of the shard that are on the disk now; the caller closes them.

        Raises:
            CaseError: a part belongs to another sweep.
        """
        pattern = f"*{_SUFFIX}" if self.shard.is_whole else f"{self.shard.name}.*{_SUFFIX}"
        return Joined(self.path.glob(pattern), self._identity, _versions())

    def add(self, done: Iterable[Done]) -> None:
        """Write finished chunks and wait until they are on disk.

        Raises:
            OSError: the file cannot be written.
        """
        self._part.add(b"".join(packed(result) for result in done))

    def close(self) -> None:
        """Close the part file and give up the lock."""
        self._part.close()
        if self._locked is not None:
            os.close(self._locked)
            self._locked = None

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


def remove_journal(path: Path, shard: Shard = WHOLE) -> None:
    """Remove the journal at a path, or the parts of one shard in it, if there are any."""
    if not shard.is_whole:
        for part in path.glob(f"{shard.name}.*"):
            part.unlink(missing_ok=True)
    elif path.is_dir():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)


def _part_name(shard: Shard) -> str:
    """Return a name that no other process gives."""
    host = re.sub(r"[^\w-]", "_", platform.node())[:40] or "host"
    return f"{shard.name}.{host}.{os.getpid()}.{time.time_ns():x}{_SUFFIX}"


def _locked(path: Path, patience: float) -> int | None:
    """Lock a file and return its handle; None on a file system without locks.

    Raises:
        CaseError: another process has locked it.
    """
    end = time.monotonic() + patience
    handle = os.open(path, os.O_WRONLY | os.O_CREAT, 0o666)
    while True:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return handle
        except BlockingIOError:
            if time.monotonic() < end:
                time.sleep(_POLL)
                continue
            os.close(handle)
            raise CaseError(
                f"{path.parent}: is another process computing this sweep? Wait for it, or choose "
                "another folder with -o DIR"
            ) from None
        except OSError as error:  # some network file systems
            os.close(handle)
            _log.debug("%s cannot be locked (%s)", path, error.strerror)
            return None


def _versions() -> str:
    """Return the versions on which the bits of the numbers depend."""
    return ", ".join(f"{name} {number}" for name, number in versions().items())
