"""Write a measurement: its dataset, pictures of its responses, tables of its gaps."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np
import xarray as xr

from delam_fem.api import schema, style, write_dataset, write_text
from delam_fem.studies.signals.distortions import distortions
from delam_fem.studies.signals.reading import COMPLEX
from delam_fem.studies.signals.responses import free_vibration, responses

MEASURED = "measured.nc"
"""Name of the file of a measurement."""


def write_measured(data: xr.Dataset, path: Path) -> Path:
    """Write a measurement as NetCDF; complex responses become two variables.

    Raises:
        OSError: the file cannot be written.
    """
    plain = data
    for name in COMPLEX:
        if name in data and np.iscomplexobj(data[name]):
            parts = {"real": data[name].real, "imag": data[name].imag}
            plain = plain.drop_vars(name).assign(
                {f"{name}_{part}": v.assign_attrs(data[name].attrs) for part, v in parts.items()}
            )
    return write_dataset(plain, path)


def save_pictures(data: xr.Dataset, directory: Path) -> list[Path]:
    """Write the figures of the responses and of the free vibration that a measurement has.

    Raises:
        OSError: a file cannot be written.
    """
    drawn = {
        "response": responses, "free_frequency": free_vibration, "line_level": distortions,
    }  # fmt: skip
    return [
        style.save_figure(partial(draw, data), directory / f"{draw.__name__}.png")
        for name, draw in drawn.items()
        if name in data
    ]


def write_all(data: xr.Dataset, directory: Path) -> list[Path]:
    """Write measured.nc, and for each gap the table that `gap.file` of a case reads.

    Args:
        data: a measurement.
        directory: the folder.

    Returns:
        The files.

    Raises:
        OSError: a file cannot be written.
    """
    written = [write_measured(data, directory / MEASURED)]
    if "response" in data or "free_frequency" in data:
        written += save_pictures(data, directory)
    if "gap0" in data:
        names = data["interface"].to_numpy() if "interface" in data.coords else [""]
        for name, gap in zip(names, schema.by_interface(data["gap0"]), strict=True):
            rows = zip(data["x"].to_numpy().tolist(), gap.tolist(), strict=True)
            text = "\n".join(["x [m],gap [m]", *(f"{x!r},{g!r}" for x, g in rows)]) + "\n"
            path = directory / (f"gap-{name}.csv".replace("/", "_") if name else "gap.csv")
            written.append(write_text(path, text))
    return written
