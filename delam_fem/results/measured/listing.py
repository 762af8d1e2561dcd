"""Say in a table what a measurement holds, and write it: the dataset, and gaps for cases."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import xarray as xr

from delam_fem.case.atomic import write_text
from delam_fem.numerics.arrays import FloatArray
from delam_fem.results.measured.reading import MEASURED, history_of, write_measured
from delam_fem.results.schema import by_interface

HEADING = ("channel", "in measured.nc", "quantity", "smallest", "largest")
"""Heading of the table of `rows`."""


def rows(data: xr.Dataset) -> Iterator[tuple[str, ...]]:
    """Yield a table row for each channel; of complex responses the amplitudes are shown."""
    for k, name in enumerate(data["channel"].to_numpy()):
        values = np.abs(own) if np.iscomplexobj(own := history_of(data, k)) else own
        position = float(data["channel_position"][k])
        place = f" at {position:g} m" if np.isfinite(position) else ""
        yield (
            f"{name}{place}",
            str(data["channel_variable"][k].item()),
            f"{data['channel_quantity'][k].item() or 'value'} [{data['channel_units'][k].item()}]",
            f"{values.min():.4g}",
            f"{values.max():.4g}",
        )


def lines(data: xr.Dataset) -> Iterator[str]:
    """Yield what holds for all channels: rate, duration, ranges, and what was put right."""
    if "time" in data:
        time: FloatArray = data["time"].to_numpy()
        span = float(time[-1] - time[0])
        rate = (time.size - 1) / span
        yield f"time: {time.size} samples, {rate:.6g} per second, {span:.6g} s from {time[0]:.6g} s"
    for name, unit in (("frequency", "Hz"), ("x", "m")):
        if name in data.coords:
            points: FloatArray = data[name].to_numpy()
            yield f"{name}: {points.size} values, {points[0]:.6g} to {points[-1]:.6g} {unit}"
    yield from (f"note: {note}" for note in data.attrs.get("notes", "").splitlines() if note)


def write_all(data: xr.Dataset, directory: Path) -> list[Path]:
    """Write measured.nc, and for each gap the table that `gap.file` of a case reads.

    Args:
        data: a measurement.
        directory: an existing folder.

    Returns:
        The files.

    Raises:
        OSError: a file cannot be written.
    """
    written = [write_measured(data, directory / MEASURED)]
    if "response" in data:
        from delam_fem.results.measured.figures import save_responses

        written.append(save_responses(data, directory))
    if "gap0" in data:
        names = data["interface"].to_numpy() if "interface" in data.coords else [""]
        for name, gap in zip(names, by_interface(data["gap0"]), strict=True):
            text = gap_table(data["x"].to_numpy(), gap)
            path = directory / (f"gap-{name}.csv".replace("/", "_") if name else "gap.csv")
            written.append(write_text(path, text))
    return written


def gap_table(x: FloatArray, gap: FloatArray) -> str:
    """Return a gap [m] over x [m] as the table that cases read, with all digits."""
    body = (f"{a!r},{g!r}" for a, g in zip(x.tolist(), gap.tolist(), strict=True))
    return "\n".join(["x [m],gap [m]", *body]) + "\n"
