"""Keep in each output folder a list of what the program has written there, and replace no more.

A name comes onto the list before its file gets that name, so that a process that is killed leaves
no file of its own unlisted. The list is hidden (`LIST`), so that it is not taken for a result.
"""

from __future__ import annotations

import errno
import logging
import os
import shutil
from collections.abc import Collection, Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from pathlib import Path

from delam_fem.system.errors import CaseError

PREFIX = ".delam_fem-"
"""Prefix of temporary names. No file of a user has it, so what a killed process left is removed.
The suffix stays that of the final name, because writers choose the format by it."""
LIST = ".delam_fem.txt"
"""Name of the list in an output folder."""
OUTPUTS = frozenset({
    "case.toml", "checkpoint.npz", "state.npz", "result.nc", "summary.json", "report.html",
    "figures", "fields", "sweep.toml", "sweep.nc", "sweep.json", "sweep.journal",
    "convergence.json", "tables.md", "detection.json",
    "orbit.json", "orbit.npz", "branch.nc", "branch.png", "points", "checkpoints",
    "unfinished.txt",
})  # fmt: skip
"""Names that runs, sweeps, refinement studies, orbits and branches give to what they write."""
MADE_OF_RESULT = (
    "export", "overlay", "laminae.gif", "laminae.mp4", "solid.gif", "solid.mp4",
    "response.png", "bifurcation.png", "plane.png", "lyapunov.png", "basins.png",
)  # fmt: skip
"""Names that commands which read the result of a run or a sweep give to what they write there."""
_OF_THEMSELVES = frozenset({"sweep.journal", "points", "checkpoints", "unfinished.txt", LIST})
"""Names of what is no result, and what says itself that it is the program's."""
_MARKS = (
    "result.nc", "sweep.nc", "branch.nc", "orbit.npz", "convergence.json", "detection.json",
    "checkpoint.npz", "state.npz", "sweep.journal", "points", "checkpoints",
)  # fmt: skip
"""A folder without a list that has one of these names is of an earlier version, or was written
from Python file by file: then files with names of outputs are taken for the program's."""
_HEAD = "# Written by delam_fem into this folder, which replaces no other files.\n"
_AGAIN = "# --overwrite: what is above alone belongs to the results before.\n"
_MOST_NAMES = 4
"""Number of names that a message lists."""
_log = logging.getLogger(__name__)


class Listing:
    """The list of a folder while a process writes there.

    Attributes:
        folder: the folder.
        earlier: names from before the last --overwrite.
        names: all others on the list; names of files are relative to the folder.
    """

    def __init__(self, folder: Path, *, is_replacing: bool) -> None:
        """Read the list of a folder.

        Args:
            folder: the folder, as an absolute path.
            is_replacing: whether what is written from now on replaces the results there.
        """
        self.folder = folder
        self.earlier: set[str] = set()
        self.names: set[str] = set()
        self._is_marked = not is_replacing
        lines = _lines_of(folder)
        for line in lines:
            if line == _AGAIN:
                self._begin_anew()
            elif not line.startswith("#"):
                self.names.add(line.rstrip("\n"))
        self._adopted = () if lines else _adoptable(folder)
        self.names.update(self._adopted)
        self._is_empty = not lines
        self._is_torn = bool(lines) and not lines[-1].endswith("\n")
        self._has_new = False
        if is_replacing:
            self._begin_anew()

    def _begin_anew(self) -> None:
        """Take all names so far for those of results that are replaced."""
        self.earlier |= self.names
        self.names = set()

    def lists(self, name: str) -> bool:
        """Return whether the program has written a file, or files in a folder of that name."""
        known = self.earlier | self.names
        return name in known or any(entry.startswith(f"{name}/") for entry in known)

    def enlist(self, path: Path, name: str) -> None:
        """Put a file on the list that is about to be written.

        Raises:
            CaseError: there is such a file, which is not on the list.
            OSError: the list cannot be written.
        """
        if name.split("/")[0] in _OF_THEMSELVES:
            return
        self._has_new = True
        if name in self.names:
            return
        if name not in self.earlier and (path.exists() or path.is_symlink()):
            if f"{name}\n" not in _lines_of(self.folder):  # another process may have added it
                raise CaseError(_foreign(self.folder, [name]))
        added = f"{name}\n"
        if not self._is_marked:
            added = _AGAIN + added
        if self._is_empty:
            added = _HEAD + "".join(f"{entry}\n" for entry in sorted(self._adopted)) + added
        if self._is_torn:  # by a full disk
            added = "\n" + added
        self._append(added.encode())
        self._is_marked, self._is_empty = True, False
        self.names.add(name)

    def _append(self, added: bytes) -> None:
        """Add lines to the list in one piece, as others may add some at the same time.

        Raises:
            OSError: not all of them fit on the disk.
        """
        handle = os.open(self.folder / LIST, os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o666)
        try:
            n_written = os.write(handle, added)
        finally:
            os.close(handle)
        self._is_torn = n_written < len(added)
        if self._is_torn:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(self.folder / LIST))

    def drop(self, names: Collection[str]) -> None:
        """Remove files on the list, and the folders that they leave empty.

        Raises:
            OSError: a file cannot be removed.
        """
        for name in names:
            path = self.folder / name
            if not path.resolve().is_relative_to(self.folder.resolve()):
                continue  # through a link
            if path.is_dir() and not path.is_symlink():
                shutil.rmtree(path)
            else:
                path.unlink(missing_ok=True)
            with suppress(OSError):
                while (path := path.parent) != self.folder:
                    path.rmdir()  # if it is empty
        self.earlier.difference_update(names)
        self.names.difference_update(names)

    def store(self) -> None:
        """Write the list anew.

        Raises:
            OSError: it cannot be written.
        """
        entries = [_HEAD, *(f"{name}\n" for name in sorted(self.earlier - self.names))]
        if self.earlier:
            entries.append(_AGAIN)
        entries += [f"{name}\n" for name in sorted(self.names)]
        temporary = self.folder / f"{PREFIX}{os.getpid()}{LIST}"
        temporary.write_text("".join(entries), encoding="utf-8")
        temporary.replace(self.folder / LIST)

    def drop_earlier(self, inputs: Collection[Path]) -> None:
        """Remove what belongs to the results that were replaced, unless nothing was written anew.

        Args:
            inputs: files that stay.
        """
        if not self._has_new or not self.earlier:
            return
        spared = {os.path.realpath(path) for path in inputs}
        old = sorted(
            name
            for name in self.earlier - self.names
            if name.split("/")[0] in OUTPUTS.union(MADE_OF_RESULT)
            and os.path.realpath(self.folder / name) not in spared
        )
        gone = [name for name in old if (self.folder / name).exists()]
        self.drop(old)
        self.names |= self.earlier
        self.earlier = set()
        self.store()
        _say_removed(self.folder, gone)


def _lines_of(folder: Path) -> list[str]:
    """Return the lines of the list of a folder, each with its end."""
    try:
        with (folder / LIST).open(encoding="utf-8", errors="replace", newline="\n") as file:
            return list(file)
    except OSError:
        return []


_listings: ContextVar[tuple[Listing, ...]] = ContextVar("_listings", default=())
"""The lists of the folders into which this thread writes."""


@contextmanager
def listed(
    folder: Path, *, is_replacing: bool = False, inputs: Collection[Path] = ()
) -> Iterator[Listing]:
    """Put on the list of a folder what is written there; refuse to replace what is not on it.

    Args:
        folder: the folder.
        is_replacing: whether what is written replaces the results there, whose other files are
            removed at the end.
        inputs: files that are not removed.

    Yields:
        The list.
    """
    real = Path(os.path.realpath(folder))
    for listing in _listings.get():
        if listing.folder == real:
            yield listing
            return
    listing = Listing(real, is_replacing=is_replacing)
    token = _listings.set((*_listings.get(), listing))
    try:
        yield listing
        listing.drop_earlier(inputs)
    finally:
        _listings.reset(token)


def enlist(path: Path) -> None:
    """Put a file on the list of the folder to which it belongs; see `Listing.enlist`."""
    real = Path(os.path.realpath(path.parent), path.name)
    if listing := _listing_of(real):
        listing.enlist(path, real.relative_to(listing.folder).as_posix())


def is_replaceable(path: Path) -> bool:
    """Return whether a file may be removed: it belongs to no folder with a list, or is on it."""
    real = Path(os.path.realpath(path.parent), path.name)
    listing = _listing_of(real)
    return listing is None or listing.lists(real.relative_to(listing.folder).as_posix())


def _listing_of(path: Path) -> Listing | None:
    """Return the list of the innermost folder around a file into which this thread writes.

    A folder in it may have a list of its own, as those of sweeps that a study computes.
    """
    listings = {listing.folder: listing for listing in _listings.get()}
    if listings.keys().isdisjoint(path.parents):
        return None
    for folder in path.parents:
        if folder in listings:
            return listings[folder]
        if (folder / LIST).is_file() or _adoptable(folder):
            return Listing(folder, is_replacing=False)
    return None


def require_replaceable_outputs(listing: Listing) -> None:
    """Refuse a folder in which names of outputs belong to files that the program has not written.

    Raises:
        CaseError: there is such a file or folder.
    """
    foreign = [
        entry.name
        for entry in sorted(listing.folder.iterdir())
        if entry.name in OUTPUTS - _OF_THEMSELVES and not listing.lists(entry.name)
        if not entry.is_dir() or any(entry.iterdir())
    ]
    if foreign:
        raise CaseError(_foreign(listing.folder, foreign))


def drop_made_of_result(folder: Path) -> None:
    """Remove exports, overlays and films of an earlier result; warn of those that stay.

    Raises:
        OSError: a file cannot be removed.
    """
    with listed(folder) as listing:
        known = listing.earlier | listing.names
        old = sorted(name for name in known if name.split("/")[0] in MADE_OF_RESULT)
        gone = [name for name in old if (listing.folder / name).exists()]
        if old:
            listing.drop(old)
            listing.store()
        _say_removed(folder, gone)
    if left := [name for name in MADE_OF_RESULT if (folder / name).exists()]:
        _log.warning("%s: %s: older than the result", folder, ", ".join(left))


def _say_removed(folder: Path, names: list[str]) -> None:
    """Tell which files of an earlier result were removed."""
    if names:
        _log.info("%s: removed %s, of the result before", folder, _listing(names))


def _listing(names: list[str]) -> str:
    """Return names as a message lists them."""
    return ", ".join(names[:_MOST_NAMES]) + (" …" if len(names) > _MOST_NAMES else "")


def _foreign(folder: Path, names: list[str]) -> str:
    """Return the message for files that the program would replace and has not written."""
    return (
        f"output folder {folder}: {_listing(names)}: expected none, or what the program wrote "
        f"there and listed in {LIST}; move or rename it, or choose another folder with -o DIR"
    )


def _adoptable(folder: Path) -> tuple[str, ...]:
    """Return the names of outputs in a folder that has results, but no list."""
    if not any((folder / mark).exists() for mark in _MARKS):
        return ()
    tops = [folder / name for name in OUTPUTS - _OF_THEMSELVES]
    files = [path for path in tops if path.is_file()]
    for top in tops:
        if top.is_dir() and not top.is_symlink():
            files += [path for path in top.rglob("*") if path.is_file()]
            files += [path for path in top.glob("*.bp") if path.is_dir()]
    return tuple(path.relative_to(folder).as_posix() for path in files)
