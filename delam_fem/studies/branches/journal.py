"""Keep each accepted point of a continuation in a file, so that it can go on after a kill."""

from __future__ import annotations

import dataclasses
import logging
import shutil
from pathlib import Path

from delam_fem.case.atomic import read_arrays, write_arrays, write_text
from delam_fem.case.toml import CaseError
from delam_fem.studies.branches.point import Point

FOLDER = "points"
"""Name of the folder of the points in the folder of a continuation."""
_ABOUT = "about.txt"
_NUMBERS = ("parameter", "residual", "residual_error", "parameter_error", "step", "doubled")

_log = logging.getLogger(__name__)


class PointJournal:
    """The points of all branches of a continuation, one file each.

    Attributes:
        folder: where they are.
    """

    def __init__(self, directory: Path, identity: str, *, resume: bool) -> None:
        """Open the journal of a continuation, or begin one.

        Args:
            directory: folder of the continuation.
            identity: text that is equal only for the same continuation.
            resume: whether to go on with the points in the folder.

        Raises:
            CaseError: the points belong to another continuation.
        """
        self.folder = directory / FOLDER
        if not resume and self.folder.exists():
            shutil.rmtree(self.folder)
        self.folder.mkdir(parents=True, exist_ok=True)
        about = self.folder / _ABOUT
        if not about.is_file():
            write_text(about, identity)
        elif about.read_text("utf-8") != identity:
            raise CaseError(
                f"resume: {self.folder} belongs to another continuation; run it with the settings "
                "of the interrupted one, or choose another folder with -o DIR"
            )

    def points(self, branch: int) -> list[Point]:
        """Return the points of a branch, up to the first that is missing or damaged."""
        found: list[Point] = []
        while (point := self._read(branch, len(found))) is not None:
            found.append(point)
        return found

    def keep(self, branch: int, number: int, point: Point) -> None:
        """Write a point and wait until it is on the disk.

        Raises:
            OSError: the file cannot be written.
        """
        write_arrays(self._path(branch, number), dataclasses.asdict(point))

    def _path(self, branch: int, number: int) -> Path:
        return self.folder / f"{branch:02d}-{number:04d}.npz"

    def _read(self, branch: int, number: int) -> Point | None:
        path = self._path(branch, number)
        if not path.is_file():
            return None
        try:
            values = read_arrays(path)
            numbers = {name: float(values[name]) for name in _NUMBERS}
            return Point(**{**values, **numbers, "iterations": int(values["iterations"])})
        except (ValueError, KeyError, TypeError) as error:
            _log.warning("%s: computed anew (%s)", path, error)
            return None
