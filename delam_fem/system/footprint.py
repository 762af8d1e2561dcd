"""Bound the memory that a file of somebody else can take: by its size, and by a limit.

A small file may claim or unpack to gigabytes. What a file would take is computed before it is read,
where its format says it (`require_room`). While a library reads, the process itself cannot grow
beyond the limit (`bounded`), so that an unknown trick ends in one message too.
"""

from __future__ import annotations

import os
import resource
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from delam_fem.system.errors import CaseError

VARIABLE = "DELAM_FEM_MEMORY"
"""Environment variable with the limit [GB]; workers inherit it. `delam-fem --memory` sets it."""
USUAL = 0.128
"""Limit without that variable [GB]."""
_GIGA = 1e9
_HONEST = 2
"""Content of at most so many times the size of its file is always read."""
_WORK = 5
"""Memory that reading may take at most, relative to the content that is allowed."""
_reading = threading.RLock()
"""Held while the process is bounded: the bound is that of all threads."""
_STATM = Path("/proc/self/statm")


def limit() -> float:
    """Return the largest content of a file that is read whatever its size [bytes].

    Raises:
        CaseError: the environment variable is no positive number.
    """
    text = os.environ.get(VARIABLE, "")
    try:
        size = float(text or USUAL)
    except ValueError:
        size = 0.0
    if not 0.0 < size < 1e9:
        raise CaseError(f"{VARIABLE} (--memory): expected a number of GB, given {text[:40]!r}")
    return size * _GIGA


def allowed(path: Path) -> float:
    """Return the largest content that is read of a file [bytes]."""
    return max(limit(), _HONEST * path.stat().st_size)


def require_room(path: Path, needed: float, label: str | None = None) -> None:
    """Refuse a file whose content is larger than the limit and than its own size.

    Args:
        path: the file.
        needed: size of its content in memory [bytes].
        label: name of the file in messages; None: its path.

    Raises:
        CaseError: the content is too large.
    """
    if needed > allowed(path):
        raise CaseError(
            f"{label or path}: its {path.stat().st_size} bytes would take {needed / _GIGA:.3g} GB "
            f"of memory, at most {allowed(path) / _GIGA:.3g} GB are taken; delam-fem --memory "
            f"{1.2 * needed / _GIGA:.2g} … (or {VARIABLE}) takes it if you trust the file"
        )


@contextmanager
def bounded(path: Path, label: str | None = None) -> Iterator[None]:
    """Keep the process from growing by much more than the limit while a library reads a file.

    Args:
        path: the file.
        label: name of the file in messages; None: its path.

    Raises:
        CaseError: the library wanted more.
    """
    with _reading, _limited(int(_WORK * allowed(path))):
        try:
            yield
            return
        except MemoryError:
            pass
    raise CaseError(
        f"{label or path}: its {path.stat().st_size} bytes would take more than "
        f"{_WORK * allowed(path) / _GIGA:.3g} GB of memory; delam-fem --memory "
        f"{2.0 * limit() / _GIGA:.2g} … (or {VARIABLE}) allows more if you trust the file"
    )


@contextmanager
def _limited(most: int) -> Iterator[None]:
    """Keep the process from growing by more than a number of bytes."""
    before = resource.getrlimit(resource.RLIMIT_AS)
    try:
        present = int(_STATM.read_text("ascii").split()[0]) * resource.getpagesize()
    except OSError:  # a system that does not tell: nothing is bounded
        yield
        return
    bounds = [size for size in (*before, present + most) if size != resource.RLIM_INFINITY]
    resource.setrlimit(resource.RLIMIT_AS, (min(bounds), before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, before)
