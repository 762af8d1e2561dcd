"""The dataset of a run in groups whose variables share their long dimension.

The whole dataset has no table: its dimensions do not go together. Each group has one
(`to_dataframe()`).
"""

from __future__ import annotations

import xarray as xr

from delam_fem.results.schema import INTERFACE, SENSOR

GROUPS = {"history": "time", "periods": "period", "fields": "frame", "events": "event"}
"""Name of each group, and the dimension of its variables."""
SHAPE = "shape"
"""Name of the group of what does not depend on time: gaps at rest, probes."""


def grouped(history: xr.Dataset) -> dict[str, xr.Dataset]:
    """Return the dataset in groups: history, periods, fields, events, shape, sensors.

    Attributes of the dataset stay with each group. A variable is in one group; a
    sensor with a sampling rate is a group of its own.

    Args:
        history: of a run; see `schema.VARIABLES`.
    """
    dims = {str(name): set(history[name].dims) for name in history.data_vars}
    groups = {
        group: [name for name, own in dims.items() if dim in own] for group, dim in GROUPS.items()
    }
    for name, own in dims.items():  # a sensor with a time axis of its own
        if name.startswith(SENSOR) and f"{name}_time" in own:
            groups[name] = [name]
    taken = {name for names in groups.values() for name in names}
    groups[SHAPE] = [name for name in dims if name not in taken]
    return {group: _tidy(history[names]) for group, names in groups.items()}


def _tidy(group: xr.Dataset) -> xr.Dataset:
    """Return a group without coordinates that belong to none of its variables."""
    used = {str(dim) for name in group.data_vars for dim in group[name].dims}
    unused = [name for name in group.coords if not set(map(str, group[name].dims)) <= used]
    return group.drop_vars([name for name in unused if name != INTERFACE])
