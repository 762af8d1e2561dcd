"""A run as tables of text: one file for each group of the dataset, units in the headings."""

from __future__ import annotations

from pathlib import Path

import xarray as xr

from delam_fem.case.atomic import write_text
from delam_fem.results.groups import grouped

MAIN = "history"
"""Group that gets the name of the file; the others add theirs."""
LONG = ("fields",)
"""Groups with a row for each lamina, frame and node; in the others laminae are columns."""


def write(history: xr.Dataset, path: Path) -> list[Path]:
    """Write NAME.csv with the histories, NAME-periods.csv, NAME-events.csv and so on.

    Args:
        history: of a run; see `schema.VARIABLES`.
        path: NAME.csv, in an existing folder.

    Returns:
        The files; empty groups have none.

    Raises:
        OSError: a file cannot be written.
    """
    written = []
    for name, group in grouped(history).items():
        if not group.data_vars or not all(group.sizes.values()):
            continue
        target = path if name == MAIN else path.with_name(f"{path.stem}-{name}{path.suffix}")
        text = _long(group) if name in LONG else _wide(group)
        written.append(write_text(target, text))
    return written


def _wide(group: xr.Dataset) -> str:
    """Return a group as a table in which each lamina, probe or interface has its columns."""
    dim = max(group.dims, key=lambda name: _rank(group, str(name)))
    columns: dict[str, object] = {}
    for name in [n for n in group.coords if group[n].dims == (dim,)] + list(group.data_vars):
        own = group[name]
        if dim not in own.dims:
            continue
        others = [d for d in own.dims if d != dim]
        if not others:
            columns[_heading(own)] = own.to_numpy()
        for k in range(own.sizes[others[0]] if len(others) == 1 else 0):
            one = own.isel({others[0]: k})
            label = str(own[others[0]][k].item()) if others[0] in own.coords else str(k + 1)
            columns[_heading(own, f" {label}")] = one.to_numpy()
    frame = xr.Dataset({k: (("row",), v) for k, v in columns.items()}).to_dataframe()
    return str(frame[list(columns)].to_csv(index=False))


def _rank(group: xr.Dataset, dim: str) -> int:
    """Return how many variables a dimension has."""
    return sum(dim in own.dims for own in group.data_vars.values())


def _long(group: xr.Dataset) -> str:
    """Return a group as a table with a row for each entry of all dimensions."""
    frame = group.to_dataframe().reset_index()
    frame.columns = [_heading(group[name]) if name in group else name for name in frame.columns]
    return str(frame.to_csv(index=False))


def _heading(own: xr.DataArray, label: str = "") -> str:
    """Return the heading of a variable with its unit."""
    units = own.attrs.get("units", "")
    return f"{own.name}{label} [{units}]" if units else f"{own.name}{label}"
