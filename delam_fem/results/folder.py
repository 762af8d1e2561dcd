"""The result of a run, and the folder it is written to."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from delam_fem.case.atomic import atomic, write_text
from delam_fem.case.definition import Case
from delam_fem.case.files import save_case
from delam_fem.simulation.loop import State


@dataclass(frozen=True)
class Result:
    """What a run gives.

    Attributes:
        case: the case.
        history: all recorded quantities, each with units.
        summary: a few numbers; undefined ones are None.
        state: state at the end, from which another run may start.
    """

    case: Case
    history: xr.Dataset
    summary: dict[str, Any]
    state: State

    def save(self, directory: str | Path) -> list[Path]:
        """Write numbers, figures, fields and report to a folder.

        Everything is written under a temporary name and renamed when complete.

        Args:
            directory: made where it does not exist.

        Returns:
            The files and folders written.

        Raises:
            OSError: the folder cannot be written or the disk is full.
        """
        from delam_fem.results.fields import vtk, vtx
        from delam_fem.results.figures.run import save_figures
        from delam_fem.results.pages.report import write_report

        directory = Path(directory)
        written = self.save_numbers(directory)
        written += save_figures(self.history, self.case, directory / "figures")
        if self.history.sizes.get("frame", 0):
            written += vtk.write_fields(self.history, self.case, directory / "fields")
            lines = vtx.write_lines(self.history, directory / "fields")
            picture = vtk.render(self.history, self.case, directory / "figures" / "laminae.png")
            written += [path for path in (lines, picture) if path is not None]
        written.append(write_report(self.history, self.summary, self.case, directory))
        return written

    def save_numbers(self, directory: str | Path) -> list[Path]:
        """Write case.toml, result.nc and summary.json only."""
        directory = Path(directory)
        written = [save_case(self.case, directory)]
        path = directory / "result.nc"
        with atomic(path) as temporary:
            self.history.to_netcdf(temporary, engine="h5netcdf")
        written.append(path)
        text = json.dumps(self.summary, indent=2, allow_nan=False) + "\n"
        return [*written, write_text(directory / "summary.json", text)]


def json_ready(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return numbers as JSON knows them: no numpy types, None for what is not finite."""

    def ready(value: Any) -> Any:
        if isinstance(value, (list, tuple, np.ndarray)):
            return [ready(v) for v in value]
        if isinstance(value, np.generic):
            value = value.item()
        return None if isinstance(value, float) and not math.isfinite(value) else value

    return {key: ready(value) for key, value in values.items()}
