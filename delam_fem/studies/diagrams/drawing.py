"""Draw a diagram of a sweep by its name; `lines.py` and `maps.py` define them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Literal

from matplotlib.figure import Figure

from delam_fem.case.atomic import atomic
from delam_fem.case.toml import CaseError
from delam_fem.numerics.attractors import FEWEST_STROBES
from delam_fem.results.figures.style import styled
from delam_fem.studies.diagrams import lines, maps
from delam_fem.studies.sweeps.grid import Sweep

if TYPE_CHECKING:
    import xarray as xr

DiagramName = Literal["response", "bifurcation", "plane", "lyapunov", "basins"]


@dataclass(frozen=True)
class _Needs:
    """What a diagram needs of a sweep.

    Attributes:
        axes: possible numbers of axes.
        record: least value of each key of the record.
        is_map: whether it shows one direction only.
    """

    axes: tuple[int, ...]
    record: Mapping[str, int]
    is_map: bool = False


_NEEDS: Mapping[DiagramName, _Needs] = MappingProxyType(
    {
        "response": _Needs((1,), {"summary": 1}),
        "bifurcation": _Needs((1,), {"strobes": 1}),
        "plane": _Needs((2,), {"summary": 1, "strobes": FEWEST_STROBES}, is_map=True),
        "lyapunov": _Needs((1, 2), {"lyapunov": 1}),
        "basins": _Needs((2,), {"summary": 1, "strobes": 1}, is_map=True),
    }
)


def require_drawable(kind: DiagramName, sweep: Sweep) -> None:
    """Check that a diagram can be drawn of a sweep before the sweep is computed.

    Raises:
        CaseError: the sweep has another number of axes, or does not record what is drawn.
    """
    needs, label = _NEEDS[kind], f"diagram {kind}"
    axes = [name for name in sweep.sizes if name != "direction"]
    if len(axes) not in needs.axes:
        count = " or ".join(map(str, needs.axes))
        raise CaseError(
            f"{label}: expected a sweep over {count} {'axis' if count == '1' else 'axes'}, given "
            f"{', '.join(axes)}; nothing was computed"
        )
    for key, least in needs.record.items():
        value = getattr(sweep.file.record, key)
        if value < least:
            wanted, given = ("true", "false") if isinstance(value, bool) else (least, value)
            raise CaseError(
                f"{label}: expected record.{key} of at least {wanted} in the sweep file, given "
                f"{given}; nothing was computed"
            )
    if "direction" in sweep.sizes and (needs.is_map or len(axes) == 2):
        raise CaseError(
            f'{label}: a map shows one direction; expected order = "independent", "up" or "down", '
            f'given "{sweep.file.order}"; nothing was computed'
        )


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
        "response": lines.response,
        "bifurcation": lines.bifurcation,
        "plane": maps.plane,
        "lyapunov": maps.lyapunov_map if len(axes) == 2 else lines.lyapunov,
        "basins": maps.basins,
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
