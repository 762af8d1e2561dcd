"""Draw a diagram of a sweep by its name, and show a sweep as one page.

A sweep as one page: what came out, its diagrams, a map of the points, and a run for each. The run
of a point is made by the command that its row shows. It writes to the folder to which the row
leads, so that the link works as soon as the run is done.
"""

from __future__ import annotations

import shlex
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from matplotlib.figure import Figure

from delam_fem.numerics.settling import FEWEST_STROBES
from delam_fem.numerics.types import FloatArray
from delam_fem.results.figures.style import GREEN, ORANGE, SKY, styled
from delam_fem.results.pages import html
from delam_fem.results.pages.html import (
    Block,
    Cell,
    Code,
    Gallery,
    Grid,
    Link,
    Paragraph,
    Preformatted,
    Section,
    Table,
    Text,
    embedded,
)
from delam_fem.studies.diagrams.draw import (
    basins,
    bifurcation,
    is_unsettled,
    lyapunov,
    lyapunov_map,
    plane,
    response,
)
from delam_fem.studies.sweeps.grid import INITIAL, Sweep
from delam_fem.system.errors import CaseError
from delam_fem.system.files import atomic, write_text

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
        "response": response,
        "bifurcation": bifurcation,
        "plane": plane,
        "lyapunov": lyapunov_map if len(axes) == 2 else lyapunov,
        "basins": basins,
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


PAGE = "report.html"
"""Name of the page in the folder of a sweep."""
MOST_POINTS = 2500
"""Points of which a page shows the rows and the map: they make it about 1.5 MB large."""
DIAGRAMS = ("response", "bifurcation", "plane", "lyapunov", "basins")
COLOURS = {1: SKY, 2: ORANGE}
"""Colours of periodicities in the map; the further ones are green."""
IRREGULAR, FAILED, UNSETTLED = "#bbbbbb", "#ffffff", "#e0e0e0"
FILES = {
    "sweep.nc": "all numbers of all points, NetCDF",
    "sweep.toml": "the sweep",
    "case.toml": "the case that it varies",
}
ALONE = (
    "The run of a point starts from its own initial state. In a sweep with an order (up, down) the "
    "points start from the state of their neighbours, so that it may reach another motion."
)


@dataclass(frozen=True)
class Point:
    """One point of a sweep.

    Attributes:
        number: in the order of the grid.
        place: index along each dimension.
        values: its coordinates: name, value in words.
        command: that runs it; empty where a run cannot have its initial state.
    """

    number: int
    place: tuple[int, ...]
    values: dict[str, str]
    command: str

    @property
    def folder(self) -> str:
        """The folder of its run, relative to that of the sweep."""
        return f"points/{self.number}"


def write_page(data: xr.Dataset, directory: str | Path) -> Path:
    """Write the page of a sweep with the diagrams that are in its folder.

    Args:
        data: dataset of the sweep.
        directory: folder of the sweep.

    Returns:
        The file.

    Raises:
        OSError: the file cannot be written.
    """
    directory = Path(directory)
    about = data.attrs
    sections = [
        Section("", [Paragraph(sentence(data), "verdict")]),
        Section("Diagrams", [*_diagrams(directory)]),
        Section("Points", [*_points(data, directory)]),
        Section("Files", [html.files(directory, FILES)]),
        Section("Sweep", [Preformatted(str(about["sweep"]))]),
        Section("Case", [Preformatted(str(about["case"]))]),
    ]
    shown = [section for section in sections if section.blocks]
    text = html.page(str(about["title"]), shown, contents=True)
    return write_text(directory / PAGE, text)


def sentence(data: xr.Dataset) -> str:
    """Return what came out of a sweep in a sentence."""
    outcomes = Counter(str(value) or "missing" for value in data["outcome"].to_numpy().ravel())
    parts = [f"{count} {outcome}" for outcome, count in outcomes.most_common()]
    text = f"{sum(outcomes.values())} points: {', '.join(parts)}"
    if "periodicity" in data and outcomes["completed"]:
        is_moving = is_unsettled(data)
        is_judged = (data["outcome"] == "completed") & ~is_moving
        found = data["periodicity"].to_numpy()[is_judged.to_numpy()]
        kinds = Counter(int(P) if np.isfinite(P) else 0 for P in found)
        moving = int(is_moving.sum())
        words = [
            f"{kinds[P]} of period {P}" if P else f"{kinds[0]} without a period"
            for P in sorted(+kinds, key=lambda P: P or 99)
        ]
        words += [f"{moving} not settled"] if moving else []
        text += f"; of these {', '.join(words)}"
    return f"{text}."


def points(data: xr.Dataset, directory: Path) -> Iterator[Point]:
    """Yield the points of a sweep in the order of its grid."""
    grid = data["outcome"]
    axes = [name for name in data.coords if "key" in data[name].attrs]
    for number, place in enumerate(np.ndindex(*grid.shape)):
        at = dict(zip(grid.dims, place, strict=True))
        values, keys = {}, {}
        if "direction" in at:
            values["direction"] = str(data["direction"].to_numpy()[at["direction"]])
        for name in axes:
            value = data[name].to_numpy()[at[data[name].dims[0]]]
            values[str(name)] = f"{value:.6g}" if isinstance(value, float) else str(value)
            keys[str(data[name].attrs["key"])] = value
        yield Point(number, place, values, _command(keys, number, directory))


def _command(keys: dict[str, Any], number: int, directory: Path) -> str:
    """Return the command that runs a point."""
    if any(key.partition(".")[0] == INITIAL for key in keys):
        return ""
    parts = ["delam-fem", "run", str(directory / "case.toml")]
    for key, value in keys.items():
        parts += ["--set", f"{key}={value}"]
    return shlex.join([*parts, "-o", str(directory / Point(number, (), {}, "").folder)])


def _diagrams(directory: Path) -> Iterator[Block]:
    """Yield the diagrams that have been drawn, or how to draw one."""
    found = [directory / f"{kind}.png" for kind in DIAGRAMS]
    for picture in found:
        if picture.is_file():
            yield Gallery([embedded(picture)], picture.stem, f"Diagram: {picture.stem}.")
    if not any(picture.is_file() for picture in found):
        command = shlex.join(["delam-fem", "show", "diagram", DIAGRAMS[0], str(directory)])
        yield Paragraph(("No diagram has been drawn yet; ", Code(command), " draws one."))


def _points(data: xr.Dataset, directory: Path) -> Iterator[Block]:
    """Yield the map of the points and their table."""
    if data["outcome"].size > MOST_POINTS:
        text = f"{data['outcome'].size} points are too many for a page; they are in sweep.nc."
        yield Paragraph(text, "about")
        return
    found = list(points(data, directory))
    yield from _maps(data, found, directory)
    yield Paragraph(ALONE, "about")
    yield _table(data, found, directory)


def _maps(data: xr.Dataset, found: list[Point], directory: Path) -> Iterator[Block]:
    """Yield a map of the periodicity over two axes, one for each direction."""
    grid = data["outcome"]
    axes = [str(name) for name in grid.dims if name != "direction"]
    if len(axes) != 2:
        return
    text = (
        "Periods after which the motion repeats, – where it does not, … where it has not settled; "
        "a cell leads to its run."
    )
    yield Paragraph(text, "about")
    numbers = np.arange(grid.size).reshape(grid.shape)
    by_direction = numbers if "direction" in grid.dims else numbers[None]
    for of_direction in by_direction:
        rows = []
        for j in reversed(range(of_direction.shape[1])):
            own = [found[number] for number in of_direction[:, j].tolist()]
            rows.append((own[0].values[axes[1]], [_cell(data, p, directory) for p in own]))
        columns = [found[number].values[axes[0]] for number in of_direction[:, 0].tolist()]
        first = found[int(of_direction[0, 0])].values.get("direction", "")
        title = f"{axes[1]} over {axes[0]}" + (f", {first}" if first else "")
        yield Grid(title, columns, rows)


def _cell(data: xr.Dataset, point: Point, directory: Path) -> Cell:
    """Return the cell of a point in a map."""
    outcome = str(data["outcome"].to_numpy()[point.place])
    P = _number(data, "periodicity", point)
    words = ", ".join(f"{name} = {value}" for name, value in point.values.items())
    if outcome != "completed":
        return Cell("×", _target(point, directory), FAILED, f"{words}: {outcome or 'missing'}")
    if bool(is_unsettled(data).to_numpy()[point.place]):
        return Cell("…", _target(point, directory), UNSETTLED, f"{words}: not settled")
    if not np.isfinite(P):
        return Cell("–", _target(point, directory), IRREGULAR, words)
    text = f"{P:.0f}"
    return Cell(text, _target(point, directory), COLOURS.get(int(P), GREEN), f"{words}: {text}")


def _target(point: Point, directory: Path) -> str:
    """Return where the cell of a point leads: to its run, otherwise to its row in the table."""
    report = f"{point.folder}/report.html"
    return report if (directory / report).is_file() else f"#point-{point.number}"


def _table(data: xr.Dataset, found: list[Point], directory: Path) -> Table:
    """Return the table of all points with the commands that run them."""
    names = [*found[0].values] if found else []
    shown = [name for name in ("periodicity", "tip_contacts_per_period") if name in data]
    heading = ("point", *names, "outcome", *(name.replace("_", " ") for name in shown), "run")
    rows = []
    for point in found:
        outcome = str(data["outcome"].to_numpy()[point.place]) or "missing"
        numbers = [_number(data, name, point) for name in shown]
        report = f"{point.folder}/report.html"
        is_run = (directory / report).is_file()
        run: Text = Link("report", report) if is_run else Code(point.command)
        cells = [f"{number:.4g}" if np.isfinite(number) else "–" for number in numbers]
        rows.append((str(point.number), *point.values.values(), outcome, *cells, run))
    return Table(heading, rows, anchors=[f"point-{point.number}" for point in found])


def _number(data: xr.Dataset, name: str, point: Point) -> float:
    """Return a number of a point; NaN where the sweep does not have it."""
    if name not in data:
        return float("nan")
    values: FloatArray = data[name].to_numpy()
    return float(values[point.place])
