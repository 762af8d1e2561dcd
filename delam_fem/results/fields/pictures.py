"""The deformed laminae at some instants: pictures, and VTK files for ParaView.

Laminae are ribbons of hexahedra of their real width and thickness. x runs along the laminae, y is
the direction of the motion, z runs across the width. Sections move without rotation, which would
move the faces by at most a tenth of a millimetre. At rest the top face of the lowest lamina is at
y = 0. The bottom face of every other lamina is the gap above the top face of the lamina below, so
faces touch where the gap is 0.

`Ribbons` makes the grids; the module `vtkhdf` writes all frames to one file.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import meshio
import numpy as np
import numpy.typing as npt
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import PolyCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from delam_fem.case.definition import Case
from delam_fem.case.sections import ENDS, Impactor, Stop
from delam_fem.numerics.types import FloatArray, IntArray
from delam_fem.results import diagnostics
from delam_fem.results.fields import vtkhdf
from delam_fem.results.fields.laminae import scalars_of
from delam_fem.results.fields.vtkhdf import Grid
from delam_fem.results.figures.style import DPI, save_figure
from delam_fem.results.schema import by_interface
from delam_fem.system.files import atomic, discard, write_text

OUTWARDS = np.array([-1.0, 1.0])
BLOCK_LENGTH = 0.01
"""Half the length of the block of a stop or an impactor, in lengths of the laminae."""
CORNERS = 4
"""Points per section: (-y, -z), (+y, -z), (+y, +z), (-y, +z)."""
UPWARDS = np.array([-1.0, 1.0, 1.0, -1.0])
"""Sign of y at these points, seen from the middle plane."""


def drawable_frames(history: xr.Dataset) -> xr.Dataset:
    """Return the dataset without the frames of a diverged run that are not finite."""
    fields = np.stack([history[name].to_numpy() for name in ("displacement", "velocity")])
    return history.isel(frame=np.flatnonzero(np.isfinite(fields).all(axis=(0, 1, 3))))


def middle_lines(history: xr.Dataset, case: Case, enlarged: float = 1.0) -> FloatArray:
    """Return y of the middle planes of the laminae at rest, shape (n_laminae, n_nodes) [m].

    Gaps are `enlarged` times as large as they are; where displacements are drawn larger, gaps must
    be as well, or laminae would seem to pass through one another.
    """
    gaps = by_interface(history["gap0"])
    x = history["x"].to_numpy()
    half = [0.5 * lamina.along("thickness", np.minimum(x, lamina.length)) for lamina in case.lamina]
    middle = np.empty((len(half), gaps.shape[1]))
    middle[0] = -half[0]
    for i, gap in enumerate(gaps, start=1):
        top_below = middle[i - 1] + half[i - 1]
        middle[i] = top_below + enlarged * gap + half[i]
    return middle


def rest_points(history: xr.Dataset, case: Case, enlarged: float = 1.0) -> FloatArray:
    """Return the corners of all sections at rest; see `middle_lines`.

    Returns:
        Points, shape (n_laminae, n_nodes, 4 corners, 3) [m].
    """
    x = history["x"].to_numpy()
    middle = middle_lines(history, case, enlarged)
    points = np.empty((*middle.shape, CORNERS, 3))
    for i, lamina in enumerate(case.lamina):
        at = np.minimum(x, lamina.length)  # what is beyond its end lies in its last section
        half = lamina.along("thickness", at)[:, None] / 2.0
        points[i, :, :, 0] = at[:, None]
        points[i, :, :, 1] = middle[i][:, None] + half * UPWARDS
        points[i, :, :, 2] = lamina.along("width", at)[:, None] / 2.0 * np.array([-1, -1, 1, 1])
    return points


@dataclass(frozen=True)
class ObstacleMark:
    """A contact point of a stop or of an impactor, a support inside the span or a spring.

    Attributes:
        lamina: number of the lamina beside the mark, from 0.
        node: number of the node at the mark, or nearest to it.
        x: place along the lamina [m].
        z: place across a plate [m]; None: the whole width.
        side: 1 above the lamina, -1 below.
        height: of the face above that of the lamina at rest [m].
        rest: y of the face at rest [m]; see `middle_lines`.
        motion: displacement of the face, shape (n_frames,) [m].
        state: contact states, shape (n_frames,).
        heat: mean power that the contact takes [W].
    """

    lamina: int
    node: int
    x: float
    z: float | None
    side: int
    height: float
    rest: float
    motion: FloatArray
    state: npt.NDArray[Any]
    heat: float = 0.0


def marks(history: xr.Dataset, case: Case, enlarged: float = 1.0) -> list[ObstacleMark]:
    """Return the marks of stops, impactors and supports inside the span; see `middle_lines`.

    The springs of Hertz's law lie behind one another, so that the first of them stands for an
    impactor. An impactor that has flown off is drawn no farther away than a picture can show.
    """
    middle = middle_lines(history, case, enlarged)
    result = []
    x = history["x"].to_numpy()
    half = [0.5 * lamina.mean("thickness") for lamina in case.lamina]
    frames = history["frame"].to_numpy()
    times = history["time"].to_numpy()
    base = np.interp(frames, times, history["base_displacement"])
    numbers = history["stop_number"].to_numpy() if "stop_number" in history else np.zeros(0)
    strikers: list[Stop | Impactor] = [*case.stop, *case.impactor]
    positions = {number: striker.position for number, striker in enumerate(strikers, start=1)}
    for k, number in enumerate(numbers.tolist()):
        impactor = number - len(case.stop) - 1
        if impactor >= 0 and number == numbers[k - 1] and k:
            continue
        stop = history.isel(stop=k)
        height = float(stop["stop_height"])
        lamina = int(stop["stop_lamina"])
        motion = float(stop["stop_on_base"]) * base
        if impactor >= 0:
            reach = 5.0 * (abs(height) + float(np.abs(history["displacement"]).max()) + sum(half))
            moved = history["impactor_displacement"][impactor].to_numpy().clip(-reach, reach)
            motion = motion + np.interp(frames, times, moved)
        side = -1 if np.signbit(height) else 1
        node = int(stop["stop_node"])
        face = float(middle[lamina, node]) + side * half[lamina] + enlarged * height
        z = across(positions.get(number))
        state = stop["stop_state"].to_numpy()
        heat = float(stop.get("stop_heat", 0.0))
        result.append(
            ObstacleMark(
                lamina, node, float(x[node]), z, side, height, face, motion, state, heat
            )
        )  # fmt: skip
    names = [lamina.name for lamina in case.lamina]
    for support in (*case.support.points(case.length), *case.support.at_points):
        if support.side is not None and support.kind != "spring":
            continue
        lamina = names.index(support.lamina) if support.lamina else 0
        place = support.x
        node = int(np.abs(x - place).argmin())
        side = 1 if support.surface == "top" else -1
        face = float(np.interp(place, x, middle[lamina])) + side * half[lamina]
        z = across(support.position)
        open_ = np.zeros(base.size, np.int8)
        result.append(ObstacleMark(lamina, node, place, z, side, 0.0, face, base, open_))
    return result


def across(position: float | tuple[float, float] | None) -> float | None:
    """Return z of a position on a plate [m]; None: it names x alone."""
    return position[1] if isinstance(position, tuple) else None


@dataclass(frozen=True)
class Ribbons:
    """The laminae at rest as ribbons, and their fields at every frame.

    Stops, impactors and supports inside the span are blocks beside the laminae.

    Attributes:
        rest: corners of all sections, shape (n_laminae, n_nodes, 4 corners, 3) [m].
        height: height of the corners above the middle planes, shape (n_laminae, 4 corners) [m].
        vectors: lateral components of vector fields, each (n_laminae, n_frames, n_nodes).
        scalars: other fields, each (n_laminae, n_frames, n_nodes).
        marks: marks for which the blocks stand.
        blocks: corners of the blocks at rest, shape (n_marks, 2 sections, 4 corners, 3) [m].
    """

    rest: FloatArray
    height: FloatArray
    vectors: Mapping[str, FloatArray]
    scalars: Mapping[str, npt.NDArray[Any]]
    marks: list[ObstacleMark]
    blocks: FloatArray

    @classmethod
    def of(cls, history: xr.Dataset, case: Case, enlarged: float = 1.0) -> Ribbons:
        """Return the ribbons of a run with the fields of its frames; see `middle_lines`."""
        half = np.array([lamina.mean("thickness") / 2.0 for lamina in case.lamina])
        rest_positions = rest_points(history, case, enlarged)
        all_marks = marks(history, case, enlarged)
        blocks = np.empty((len(all_marks), 2, CORNERS, 3))
        for mark, block in zip(all_marks, blocks, strict=True):
            block[:] = rest_positions[mark.lamina, mark.node]
            block[..., 0] = mark.x + BLOCK_LENGTH * case.length * OUTWARDS[:, None]
            if mark.z is not None:
                block[..., 2] = mark.z + BLOCK_LENGTH * case.length * np.sign(block[..., 2])
            block[..., 1] = mark.rest + mark.side * half.sum() * (1.0 + mark.side * UPWARDS)
        return cls(
            rest_positions,
            half[:, None] * UPWARDS,
            {name: history[name].to_numpy() for name in ("displacement", "velocity")},
            scalars_of(history, case),
            all_marks,
            blocks,
        )

    def point_data(self, frame: int) -> dict[str, npt.NDArray[Any]]:
        """Return all fields at all points, scalars of shape (n,), vectors of shape (n, 3).

        displacement [m], velocity [m/s], moment [N m], curvature [1/m], gap [m], contact_state [-],
        impulse since the frame before [N s], heat (mean power over the window) [W], contact_force
        of a pair [N], and strain, the axial strain of bending: minus the height above the middle
        plane times the curvature [-]. Blocks have displacement, contact_state and heat.
        """
        data = {  # along y, at all corners
            name: np.pad(np.repeat(vectors[:, frame].ravel(), CORNERS)[:, None], ((0, 0), (1, 1)))
            for name, vectors in self.vectors.items()
        }
        for name, values in self.scalars.items():
            data[name] = np.repeat(values[:, frame].ravel(), CORNERS)
        curvature = self.scalars["curvature"][:, frame, :, None]
        data["strain"] = (-self.height[:, None, :] * curvature).ravel()
        moved = [mark.motion[frame] for mark in self.marks]
        of_blocks: dict[str, Any] = {
            "gap": np.inf,  # as of a lamina without neighbours
            "displacement": np.outer(np.repeat(moved, 2 * CORNERS), [0.0, 1.0, 0.0]),
            "contact_state": np.repeat([mark.state[frame] for mark in self.marks], 2 * CORNERS),
            "heat": np.repeat([mark.heat for mark in self.marks], 2 * CORNERS),
        }
        for name, values in data.items():
            more = np.zeros((self.blocks.size // 3, *values.shape[1:]), values.dtype)
            more[:] = of_blocks.get(name, 0)
            data[name] = np.concatenate([values, more])
        return data

    @property
    def mesh(self) -> Grid:
        """The laminae at rest as points and cells, and the blocks, whose lamina is 0."""
        n_laminae, n_nodes = self.rest.shape[:2]
        blocks = hexahedra(len(self.marks), 2) + self.rest.size // 3
        numbers = np.repeat(np.arange(1, n_laminae + 1, dtype=np.int8), n_nodes - 1)
        return Grid(
            np.concatenate([self.rest.reshape(-1, 3), self.blocks.reshape(-1, 3)]),
            np.concatenate([hexahedra(n_laminae, n_nodes), blocks]), "hexahedron",
            {"lamina": np.concatenate([numbers, np.zeros(len(blocks), np.int8)])},
        )  # fmt: skip

    def grid(self, frame: int) -> meshio.Mesh:
        """Return the laminae at rest with the fields of one frame.

        "Warp by vector" with the displacement shows the deformed laminae. Cell data is lamina (1,
        2, …).
        """
        mesh = self.mesh
        of_cells = {name: [values] for name, values in mesh.cell_data.items()}
        return meshio.Mesh(mesh.points, [(mesh.cell, mesh.cells)], self.point_data(frame), of_cells)


def hexahedra(n_laminae: int, n_nodes: int) -> IntArray:
    """Return the cells of all ribbons.

    Returns:
        Point numbers, shape (n_laminae (n_nodes - 1), 8), in VTK's order.
    """
    sections = np.arange(n_laminae * n_nodes * CORNERS).reshape(n_laminae, n_nodes, CORNERS)
    cells = np.concatenate([sections[:, :-1], sections[:, 1:]], axis=-1)
    return np.asarray(cells.reshape(-1, 2 * CORNERS), dtype=np.int64)


PHASES = (-0.3, -0.2, -0.1, 0.0, 0.1, 0.2, 0.3)
"""Instants of the snapshots, in periods from the strike."""
SIZE = (1500, 1050)
"""Width and height of the picture [px]."""
TURN = np.radians(24.0)
TILT = np.radians(14.0)
"""Angles by which the camera is turned from the view on the edges of the laminae, and raised."""
TO_CAMERA = np.array([np.sin(TILT), -np.cos(TILT) * np.sin(TURN), -np.cos(TILT) * np.cos(TURN)])
"""Direction of the camera; x is up and y to the right in the picture."""
RIGHT = np.cross([1.0, 0.0, 0.0], TO_CAMERA) / np.cos(TILT)
"""Horizontal in the picture: the direction in which the snapshots stand side by side."""
SCREEN = np.column_stack([RIGHT, np.cross(TO_CAMERA, RIGHT)])
"""Axes of the picture: places there are points @ SCREEN, shape (3, 2)."""
PIECES = 100
"""Pieces of one colour along a lamina."""
SHADE = 0.7
"""Brightness of the faces towards -z."""
BLOCK = np.array([0.6, 0.6, 0.6, 1.0])
OUTLINE = np.array([0.19, 0.19, 0.19, 1.0])
CLEAR = np.zeros(4)
"""Colours: supports, outlines, nothing."""
ROW = 1.42
"""Length of the row of snapshots in lengths of the laminae: it fills the picture."""
COLOURS = "coolwarm"
"""Blue to grey to red: readable by the colour-blind, and zero stays visible on white."""
VISIBLE, SHOWN_DEFLECTION = 0.01, 0.04
"""Deflections below the first number are drawn as large as the second, in lengths."""
NAME_DISTANCE = 0.07
"""Distance of the names of neighbours that touch, in lengths of the laminae."""


def strike_frame(history: xr.Dataset, case: Case) -> int:
    """Return the last frame before the strongest impact at the probes, or before the smallest gap.

    The velocities there are those with which the laminae meet. Instants too near to the ends of
    the window for all snapshots count only if the window contains no others.
    """
    at_probes = diagnostics.is_at_probes(history)
    if at_probes.any():
        when = history["event_time"].to_numpy()[at_probes]
        strength = history["event_impulse"].to_numpy()[at_probes]
    else:
        when = history["time"].to_numpy()
        strength = -diagnostics.tip_gap(history)
    frames = history["frame"].to_numpy()
    is_inside = (when >= frames[0] - PHASES[0] * case.period) & (
        when <= frames[-1] - PHASES[-1] * case.period
    )
    if is_inside.any():
        when = when[is_inside]
        strength = strength[is_inside]
    strike = float(when[np.argmax(strength)])
    return max(0, int(np.searchsorted(frames, strike - 1e-6 * case.time_step)) - 1)


def largest_speed(history: xr.Dataset, frames: list[int]) -> float:
    """Return the end of the colour scale: the largest speed of any strike and frame [m/s].

    The probes are recorded at every step. Frames are too far apart to hold the speeds of strikes.

    Args:
        history: dataset of a run; see `schema.VARIABLES`.
        frames: numbers of the frames that are shown.
    """
    speeds = (history["velocity"].to_numpy()[:, frames], history["tip_velocity"].to_numpy())
    return max(float(np.nanmax(np.abs(v), initial=0.0, where=np.isfinite(v))) for v in speeds)


def draw(history: xr.Dataset, case: Case) -> Figure:
    """Draw the laminae at the instants `PHASES` about a strike, side by side.

    Deflections are true to scale unless they are too small to be seen; the title names the factor.

    Args:
        history: dataset with the fields of at least one frame; see `schema.VARIABLES`.
        case: its case.
    """
    frames = history["frame"].to_numpy()
    shown_strike = strike_frame(history, case)
    strike = frames[shown_strike]
    drawn_frames = [
        int(np.argmin(np.abs(frames - strike - phase * case.period))) for phase in PHASES
    ]
    drawn_frames = sorted(set(drawn_frames))
    length = case.length
    limit = largest_speed(history, drawn_frames) or 1.0
    factor = magnification(history, drawn_frames, length)
    u, v = (history[name].to_numpy()[:, drawn_frames] for name in ("displacement", "velocity"))
    at_rest = rest_points(history, case, factor)
    colours = ScalarMappable(Normalize(-limit, limit), COLOURS)
    name = "strike" if diagnostics.is_at_probes(history).any() else "closest"
    figure = Figure(figsize=(SIZE[0] / DPI, SIZE[1] / DPI))
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    polygons: list[tuple[FloatArray, FloatArray, FloatArray]] = []
    for k, frame in enumerate(drawn_frames):
        place = (k - (len(drawn_frames) - 1) / 2) * ROW / len(PHASES) * length * RIGHT
        corners = at_rest + place
        corners[..., 1] += factor * u[:, k, :, None]
        below, beyond = _supports(case, place, factor * u[0, k])
        laminae = [
            (_pieces(points), colours.to_rgba(_pieces(speed)))
            for points, speed in zip(corners, v[:, k], strict=True)
        ]
        for points, painted in [*below, *laminae[::-1], *beyond]:  # each hides those before it
            polygons += _visible(points, painted)
        after = (frames[frame] - strike) / case.period
        text = f"{after:+.1f} T".replace("-", "−") if frame != shown_strike else name
        _label(axes, place - [0.11 * length, 0.0, 0.0], text)
    shapes, faces, edges = zip(*polygons, strict=True)
    drawn = PolyCollection(shapes, linewidths=0.5)
    drawn.set(facecolors=np.array(faces), edgecolors=np.array(edges))
    axes.add_collection(drawn, autolim=False)
    aside = -(len(drawn_frames) - 1) / 2 * ROW / len(PHASES) * length
    _name_laminae(axes, history, drawn_frames[0], (aside, factor))
    scale = "true to scale" if factor == 1.0 else f"deflections and gaps × {factor:g}"
    figure.text(0.03, 0.955, f"{case.title}; {scale}, T = {case.period:.3g} s", fontsize=12)
    bar = figure.add_axes((0.89, 0.2, 0.02, 0.6), label="<colorbar>")
    figure.colorbar(colours, bar, ticks=np.linspace(-limit, limit, 5).tolist(), format="{x:+.2g}")
    bar.set_title("lateral velocity [m/s]", pad=12.0)
    centre = (np.array([0.48 * length, 0.0, 0.0]) + 0.1 * length * RIGHT) @ SCREEN
    half = 0.65 * length * np.array([SIZE[0] / SIZE[1], 1.0])
    axes.set(xlim=centre[0] + half[0] * OUTWARDS, ylim=centre[1] + half[1] * OUTWARDS)
    axes.set_axis_off()
    return figure


def _pieces(values: FloatArray) -> FloatArray:
    """Return values at all nodes, shape (n, …), at the ends of `PIECES` pieces of the laminae."""
    place = np.linspace(0.0, len(values) - 1.0, PIECES + 1)
    before = np.minimum(place.astype(np.int64), len(values) - 2)
    share = (place - before).reshape(-1, *(1,) * (values.ndim - 1))
    return np.asarray((1.0 - share) * values[before] + share * values[before + 1])


def _visible(
    corners: FloatArray, colours: FloatArray
) -> Iterator[tuple[FloatArray, FloatArray, FloatArray]]:
    """Yield the faces of a body that the camera sees as polygons, with face and edge colours.

    These faces look towards -y, -z and +x.

    Args:
        corners: corners of the sections of the body, shape (n, 4, 3), in the order of `CORNERS`.
        colours: colours of the sections, shape (n, 4).
    """
    between = (colours[:-1] + colours[1:]) / 2.0
    for other, shade in ((3, 1.0), (1, SHADE)):
        sides = corners[:, [0, other]] @ SCREEN
        for k, colour in enumerate(between * [shade, shade, shade, 1.0]):
            yield np.concatenate([sides[k], sides[k + 1, ::-1]]), colour, colour
        yield np.concatenate([sides[:, 0], sides[::-1, 1]]), CLEAR, OUTLINE
    yield corners[-1] @ SCREEN, colours[-1], OUTLINE


def magnification(history: xr.Dataset, frames: list[int], length: float) -> float:
    """Return the factor of deflections and gaps: 1, 2 or 5 times a power of ten; 1 if visible.

    Args:
        history: dataset with the fields of the frames.
        frames: numbers of the frames that are shown.
        length: length of the laminae [m].
    """
    u = history["displacement"].to_numpy()[:, frames]
    largest = max(
        float(np.abs(u).max(initial=0.0)), float(history["gap0"].to_numpy().max(initial=0.0))
    )
    if largest >= VISIBLE * length or largest == 0.0:
        return 1.0
    wanted = SHOWN_DEFLECTION * length / largest
    power = 10.0 ** math.floor(math.log10(wanted))
    return max(1.0, power * max(step for step in (1, 2, 5) if step * power <= wanted))


def _supports(
    case: Case, place: FloatArray, moved: FloatArray
) -> list[list[tuple[FloatArray, FloatArray]]]:
    """Return the blocks that hold the laminae at their start and at their end.

    Args:
        case: case of the run.
        place: offset of the snapshot, shape (3,) [m].
        moved: drawn displacements of the lowest lamina, shape (n_nodes,) [m].

    Returns:
        For each end corners (2, 4, 3) [m] and colours (2, 4) of its block; nothing of a free end.
    """
    length = case.length
    block = 3.0 * case.thickness
    side = np.array([0.0, block, 0.6 * max(lamina.mean("width") for lamina in case.lamina)])
    section = side * np.column_stack([np.zeros(4), UPWARDS, [-1.0, -1.0, 1.0, 1.0]])
    blocks: list[list[tuple[FloatArray, FloatArray]]] = []
    for end, node, x, outwards in zip(ENDS, (0, -1), (0.0, length), (-1.0, 1.0), strict=True):
        depth = (0.05 if case.support.kind(end) == "clamped" else 0.01) * length
        along = [[[reached, moved[node], 0.0]] for reached in sorted((x, x + outwards * depth))]
        body = section + along + place, np.full((2, 4), BLOCK)
        blocks.append([body] if case.support.holds(end) else [])
    return blocks


def _label(axes: Axes, point: FloatArray, text: str) -> None:
    """Write a text at a point of the scene."""
    x, y = point @ SCREEN
    axes.text(x, y, text, ha="center")


def _name_laminae(axes: Axes, history: xr.Dataset, frame: int, drawn: tuple[float, float]) -> None:
    """Write the names of the laminae beyond their probes in the first snapshot.

    `drawn` holds the offset of the snapshot and the factor of its deflections.
    """
    offset, factor = drawn
    node = diagnostics.probe_node(history)
    length = float(history["x"][-1])
    x = float(history["x"][node])
    at_rest = diagnostics.rest_positions(history)[:, node]
    for i, name in enumerate(history["lamina"].to_numpy()):
        y = factor * (at_rest[i] + float(history["displacement"][i, frame, node]))
        between = NAME_DISTANCE if x == length else 2.5 * NAME_DISTANCE  # beside the laminae
        side = between * (i - (len(at_rest) - 1) / 2) * length
        point = np.array([x + 0.03 * length, y, 0.0]) + (offset + side) * RIGHT
        _label(axes, point, str(name))


def write_fields(history: xr.Dataset, case: Case, directory: str | Path) -> list[Path]:
    """Write fields.vtkhdf with all frames, and fields.pvd with the frames of the last period.

    All frames of fields.vtkhdf share one mesh, the laminae at rest. fields.pvd is for programs that
    do not read VTKHDF: it has one .vtu per frame, so it is kept small. Old files that the new
    collection does not name are removed.

    Args:
        history: dataset with the fields of the frames; see `schema.VARIABLES`.
        case: gives widths and thicknesses.
        directory: folder, which is made where it does not exist.

    Returns:
        Both files; none if no frame has finite values.

    Raises:
        OSError: the folder cannot be written or the disk is full.
    """
    history = drawable_frames(history)
    times = history["frame"].to_numpy()
    if not times.size:
        return []
    directory = Path(directory)
    bodies = Ribbons.of(history, case)
    series = vtkhdf.write(bodies.mesh, times, bodies.point_data, directory / "fields.vtkhdf")
    length = case.period if case.is_periodic else np.inf
    last = np.flatnonzero(times > times[-1] - length + 0.5 * case.time_step)
    names = [f"fields_{k:0{len(str(last.size - 1))}d}.vtu" for k in range(last.size)]
    for frame, name in zip(last, names, strict=True):
        with atomic(directory / name) as temporary:
            bodies.grid(int(frame)).write(temporary, file_format="vtu")
    for path in set(directory.glob("fields_*.vtu")) - {directory / name for name in names}:
        discard(path)
    return [series, _write_collection(directory / "fields.pvd", times[last], names)]


def remove_fields(directory: Path) -> None:
    """Remove the fields of an earlier run, which would be taken for those of this one."""
    single = [
        directory / name
        for name in ("fields.pvd", "fields.vtkhdf", "solid.vtkhdf", "surface.vtkhdf")
    ]
    folders = [directory / name for name in ("fields.bp", "solid.bp")]
    for path in (*single, *directory.glob("fields_*.vtu"), *folders):
        discard(path)


def render(history: xr.Dataset, case: Case, path: str | Path) -> Path | None:
    """Write the picture that `draw` makes as PNG.

    Args:
        history: dataset of a run; see `schema.VARIABLES`.
        case: its case.
        path: the file; its folder is made where it does not exist.

    Returns:
        The file; None if no frame has finite values.

    Raises:
        OSError: the file cannot be written.
    """
    history = drawable_frames(history)
    if not history.sizes["frame"]:
        return None
    return save_figure(partial(draw, history, case), Path(path))


def _write_collection(path: Path, times: FloatArray, names: list[str]) -> Path:
    """Write a ParaView collection: a time for each file."""
    frames = [
        f'    <DataSet timestep="{time!r}" group="" part="0" file="{name}" />'
        for time, name in zip(times.tolist(), names, strict=True)
    ]
    lines = [
        "<?xml version='1.0' encoding='utf-8'?>",
        '<VTKFile type="Collection" version="0.1" byte_order="LittleEndian">',
        *("  <Collection>", *frames, "  </Collection>"),
        "</VTKFile>",
    ]
    return write_text(path, "\n".join(lines))
