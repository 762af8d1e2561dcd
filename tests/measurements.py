"""Noisy measurements made from the dataset of a run, as tests of the overlay need them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import xarray as xr
from scipy.interpolate import CubicSpline


def recorded(
    history: xr.Dataset,
    *,
    period: float,
    start: float,
    rate: float = 1024.0,
    duration: float = 2.0,
    noise: float = 0.0,
    clock: float = 1.0,
) -> tuple[np.ndarray, np.ndarray]:
    """Return what a recorder with its own clock, rate and noise makes of the tips of a run.

    The last period of the run is repeated for ever.

    Args:
        history: of a run whose last period ends as it begins.
        period: of the motion [s].
        start: time of the run at the first sample [s].
        rate: samples per second of the recorder.
        duration: of the record [s].
        noise: standard deviation [m].
        clock: seconds of the run in a second of the recorder.

    Returns:
        Time [s], from 0; displacements of the tips, shape (n_laminae, n) [m].
    """
    time, tips = history["time"].to_numpy(), history["tip_displacement"].to_numpy()
    n = round(period / (time[1] - time[0]))
    one = np.concatenate([tips[:, -1:], tips[:, -n:]], axis=1)
    spline = CubicSpline(np.linspace(0.0, period, n + 1), one, axis=1, bc_type="periodic")
    t = np.arange(round(duration * rate)) / rate
    values = spline(np.mod(start + clock * t - time[-1], period))
    return t, values + np.random.default_rng(5).normal(0.0, noise, values.shape)


def write_csv(path: Path, t: np.ndarray, channels: dict[str, np.ndarray]) -> Path:
    """Write channels in mm as a table."""
    rows = np.array([t, *(1e3 * values for values in channels.values())]).T
    heading = ",".join(["time [s]", *(f"{name} [mm]" for name in channels)])
    np.savetxt(path, rows, fmt="%.7g", delimiter=",", header=heading, comments="")
    return path
