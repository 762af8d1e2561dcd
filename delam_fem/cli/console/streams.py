"""Keep a command alive when nobody reads its output any more.

A reader may go away (`… | head`), a terminal may be closed, a disk may be full. What cannot be
written is dropped; the computation and its files go on.
"""

from __future__ import annotations

import atexit
import io
import os
import select
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any, TextIO

STANDARD = (0, 1, 2)
"""Descriptors of stdin, stdout and stderr."""


@contextmanager
def lasting_streams() -> Iterator[None]:
    """Replace stdout and stderr by unbuffered streams whose writes never fail."""
    _fill_closed()
    before = sys.stdout, sys.stderr
    sys.stdout, sys.stderr = _lasting(sys.stdout, 1), _lasting(sys.stderr, 2)
    try:
        yield
    finally:
        colours = sys.modules.get("colorama.initialise")  # numba's, which would reset the terminal
        if colours is not None:
            atexit.unregister(colours.reset_all)
        sys.stdout, sys.stderr = before[0] or sys.stdout, before[1] or sys.stderr


def _fill_closed() -> None:
    """Open the null device as each standard stream that is closed.

    Otherwise the next file that is opened would get its number, and messages would go there.
    """
    for number in STANDARD:
        try:
            os.fstat(number)
        except OSError:
            opened = os.open(os.devnull, os.O_RDWR)
            if opened != number:
                os.dup2(opened, number)
                os.close(opened)


def _lasting(stream: TextIO | None, number: int) -> TextIO:
    """Return a stream whose writes never fail; a stream that is no descriptor is left alone."""
    if stream is not None:
        try:
            number = stream.fileno()
        except (OSError, ValueError):  # captured in memory
            return stream
        with suppress(OSError):
            stream.flush()
    encoding = getattr(stream, "encoding", None) or "utf-8"
    # a raw stream in the place of a buffer, as `python -u` has it
    raw: Any = _Lasting(number)
    return io.TextIOWrapper(raw, encoding, "backslashreplace", write_through=True)


class _Lasting(io.RawIOBase):
    """The raw stream of a descriptor; after a failure it writes to the null device."""

    def __init__(self, number: int) -> None:
        """Store the descriptor, which stays open."""
        self._number = number

    def writable(self) -> bool:
        """Return True."""
        return True

    def isatty(self) -> bool:
        """Return whether the stream is a terminal."""
        return os.isatty(self._number)

    def fileno(self) -> int:
        """Return the descriptor."""
        return self._number

    def write(self, data: bytes) -> int:  # type: ignore[override]
        """Write data; drop what cannot be written."""
        view = memoryview(data).cast("B")
        size = len(view)
        while len(view):
            try:
                view = view[os.write(self._number, view) :]
            except BlockingIOError:
                select.select([], [self._number], [])
            except OSError:
                null = os.open(os.devnull, os.O_WRONLY)
                os.dup2(null, self._number)
                os.close(null)
        return size
