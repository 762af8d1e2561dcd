"""Which channels of a measurement are which histories of a run."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import xarray as xr
from scipy.interpolate import CubicSpline

from delam_fem.case.toml import CaseError
from delam_fem.numerics.arrays import FloatArray
from delam_fem.results.measured.reading import history_of

DRIVES = ("base_displacement", "force")
"""Variables that are the drive: they are aligned with, and never differ."""


@dataclass(frozen=True)
class Pairs:
    """Histories that a measurement and a run both have.

    Attributes:
        names: of the channels.
        units: of the channels.
        time: of the measurement [s], shape (n,).
        measured: shape (n_channels, n).
        run_time: of the steps of the run's window [s], shape (m,).
        computed: shape (n_channels, m).
        is_drive: whether a channel is the drive.
        unmatched: channels of the measurement that the run does not have.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    time: FloatArray
    measured: FloatArray
    run_time: FloatArray
    computed: FloatArray
    is_drive: tuple[bool, ...]
    unmatched: tuple[str, ...]


def matched(history: xr.Dataset, data: xr.Dataset) -> Pairs:
    """Return the channels that the dataset of a run has under the same name.

    Args:
        history: of a run; see `schema.VARIABLES`.
        data: a measurement; see `measured.assembly`.

    Raises:
        CaseError: the measurement has no histories, or none of the run's.
    """
    if "time" not in data:
        raise CaseError("measurement: expected histories over the time, found none")
    found: list[tuple[str, str, FloatArray, FloatArray, bool]] = []
    unmatched = []
    for k, name in enumerate(map(str, data["channel"].to_numpy())):
        variable = str(data["channel_variable"][k].item())
        if variable not in data or "time" not in data[variable].dims:
            continue
        own = _of_run(history, variable, str(data["channel_lamina"][k].item()))
        if own is None:
            unmatched.append(name)
            continue
        units = str(data["channel_units"][k].item())
        found.append((name, units, history_of(data, k), own, variable in DRIVES))
    if not found:
        held = [str(v) for v in history.data_vars if history[v].dims[-1:] == ("time",)]
        laminae = ", ".join(map(str, history["lamina"].to_numpy()))
        raise CaseError(
            f"measurement: none of its channels ({', '.join(unmatched) or 'none'}) is in the run, "
            f"which has {', '.join(held)} with the laminae {laminae}; name them by --channel "
            "'tip LAMINA=SOURCE:UNIT' or --channel 'NAME=SOURCE:UNIT'"
        )
    names, all_units, measured, computed, is_drive = zip(*found, strict=True)
    return Pairs(
        names, all_units, data["time"].to_numpy(), np.array(measured),
        history["time"].to_numpy(), np.array(computed), is_drive, tuple(unmatched),
    )  # fmt: skip


def _of_run(history: xr.Dataset, variable: str, lamina: str) -> FloatArray | None:
    """Return the history of a run that a channel measures; None: the run has none."""
    if variable not in history:
        return None
    own = history[variable]
    if own.dims == (f"{variable}_time",):  # a sensor with a sampling rate
        sampled = CubicSpline(own[own.dims[0]].to_numpy(), own.to_numpy())
        times: FloatArray = history["time"].to_numpy()
        return np.asarray(sampled(times))
    if "time" not in own.dims:
        return None
    if "lamina" in own.dims:
        if lamina not in history["lamina"].to_numpy():
            return None
        own = own.sel(lamina=lamina)
    values: FloatArray = own.to_numpy()
    return values if values.ndim == 1 and bool(np.isfinite(values).all()) else None
