"""Keep what a map returns on disk, so that a search that was killed does not compute it again."""

from __future__ import annotations

import hashlib
import logging
import time
from pathlib import Path
from typing import Any

import numpy as np

from delam_fem.case.atomic import read_arrays, write_arrays
from delam_fem.numerics.arrays import FloatArray
from delam_fem.simulation.interrupts import CHECKPOINT_SECONDS
from delam_fem.studies.orbits.protocol import CaseMap, PeriodMap

_log = logging.getLogger(__name__)


class KeptMap:
    """A map whose results are kept; the search repeats its steps, and finds those that are known.

    At most the results of `CHECKPOINT_SECONDS` are lost.
    """

    def __init__(self, map_: PeriodMap, folder: Path) -> None:
        """Read what is known of a map.

        Args:
            map_: the map.
            folder: of the files; everything in it is of this map.
        """
        folder.mkdir(exist_ok=True)
        self._map, self._folder, self._last = map_, folder, time.monotonic()
        self._new: dict[str, FloatArray] = {}
        self._known: dict[str, FloatArray] = {}
        for path in folder.glob("*.npz"):
            try:
                self._known |= read_arrays(path)
            except ValueError as error:
                _log.warning("%s: computed anew (%s)", path, error)

    def __getattr__(self, name: str) -> Any:
        """Return what else the map has."""
        return getattr(self._map, name)

    def after(
        self, states: FloatArray, parameter: float, shifts: FloatArray | None = None
    ) -> FloatArray:
        """Return the states one period later; see `PeriodMap`."""
        asked = [states, np.array(parameter), np.zeros(0) if shifts is None else shifts]
        key = hashlib.sha256(b"".join(values.tobytes() for values in asked)).hexdigest()
        if key not in self._known:
            self._known[key] = self._new[key] = self._map.after(states, parameter, shifts)
            if time.monotonic() - self._last > CHECKPOINT_SECONDS:
                write_arrays(self._folder / f"{key}.npz", self._new)
                self._new, self._last = {}, time.monotonic()
        return self._known[key].copy()


class KeptCaseMap(KeptMap):
    """The same of the map of a case."""

    _map: CaseMap

    def opened(self, state: FloatArray, parameter: float) -> tuple[PeriodMap, FloatArray]:
        """Return the map whose periods begin elsewhere, kept too; see `CaseMap`."""
        map_, first = self._map.opened(state, parameter)
        return KeptMap(map_, self._folder / "opened"), first
