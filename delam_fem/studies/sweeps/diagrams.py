"""Draw a diagram of a sweep by its name; `line_diagrams.py` and `map_diagrams.py` define them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from matplotlib.figure import Figure

from delam_fem.case.atomic import atomic
from delam_fem.results.figures.style import styled
from delam_fem.studies.sweeps import line_diagrams, map_diagrams

if TYPE_CHECKING:
    import xarray as xr

DiagramName = Literal["response", "bifurcation", "plane", "lyapunov", "basins"]


def diagram(kind: DiagramName, data: xr.Dataset) -> Figure:
    """Draw a diagram of a sweep.

    Args:
        kind: name of the diagram.
        data: dataset from `run_sweep`, or a part of it with the number of axes that the diagram
            needs: one for response and bifurcation, two for plane and basins, one or two for
            lyapunov.

    Raises:
        CaseError: the sweep has another number of axes, or has not recorded a required variable.
    """
    axes = [name for name in data["outcome"].dims if name != "direction"]
    draw: dict[DiagramName, Callable[[xr.Dataset], Figure]] = {
        "response": line_diagrams.response,
        "bifurcation": line_diagrams.bifurcation,
        "plane": map_diagrams.plane,
        "lyapunov": map_diagrams.lyapunov_map if len(axes) == 2 else line_diagrams.lyapunov,
        "basins": map_diagrams.basins,
    }
    with styled():
        return draw[kind](data)


def save_diagram(kind: DiagramName, data: xr.Dataset, path: str | Path) -> Path:
    """Draw a diagram and write it to a PNG file.

    Returns:
        The path of the file.

    Raises:
        CaseError: see `diagram`.
        OSError: the file cannot be written.
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure = diagram(kind, data)
    with styled(), atomic(path) as temporary:
        figure.savefig(temporary, format="png")
    return path
