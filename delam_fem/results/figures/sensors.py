"""Figure of the sensors of a run: the signal of each over the last periods."""

from __future__ import annotations

import xarray as xr
from matplotlib.figure import Figure

from delam_fem.case.definition import Case
from delam_fem.results import diagnostics
from delam_fem.results.figures.style import (
    BLACK,
    HISTORY_PERIODS,
    WIDTH,
    finite,
    label_x,
    seconds_below,
    time_axis,
    title,
)
from delam_fem.results.schema import SENSOR, sensors_of

_SCALES = {
    "m": (1e3, "mm"),
    "m/s": (1.0, "m/s"),
    "m/s2": (1.0, "m/s²"),
    "1": (1e6, "µm/m"),
    "N": (1.0, "N"),
}
"""Factor and unit on the axis, by the unit of a signal."""
_DOTS_BELOW = 400
"""Samples up to which they are drawn as dots too."""


def sensors(history: xr.Dataset, case: Case) -> Figure:
    """Draw the signal of each sensor over the last periods, one below the other."""
    names = sensors_of(history)
    start = float(diagnostics.last_periods(history, case, HISTORY_PERIODS)["time"][0])
    unit, label = time_axis(case)
    height = max(4.2, 1.0 + 2.1 * len(names))
    figure = Figure(figsize=(WIDTH, height), layout="constrained")
    panels = figure.subplots(len(names), 1, squeeze=False)[:, 0]
    for axes, name in zip(panels, names, strict=True):
        values = history[name]
        factor, shown = _SCALES[values.attrs["units"]]
        time = values[str(values.dims[0])].to_numpy()
        kept = time >= start
        is_sparse = kept.sum() <= _DOTS_BELOW
        axes.plot(
            time[kept] / unit,
            factor * finite(values)[kept],
            color=BLACK,
            linewidth=0.9,
            marker="." if is_sparse and "sampling_rate" in values.attrs else None,
            markersize=3.0,
        )
        axes.set_title(
            f"{name.removeprefix(SENSOR)}: {values.attrs['long_name']}", fontsize=9, loc="left"
        )
        axes.set_ylabel(f"[{shown}]")
        axes.margins(x=0.0)
    label_x(panels, label)
    seconds_below(panels[-1], case)
    figure.suptitle(title(case))
    return figure
