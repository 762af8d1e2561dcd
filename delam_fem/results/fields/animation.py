"""The laminae in motion as GIF and MP4, by pyvista; solids coloured by their stress.

Pictures of a solid show its laminae thicker than they are. They are made from fields/solid.vtkhdf,
so that they can be made again without the run. Real laminae are a hundred times longer than thick:
thicknesses are drawn larger by a factor that the picture states, and the turning of their sections
with them. Deflections and gaps have a factor of their own, which is 1 if they can be seen.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import ExitStack, closing, nullcontext
from pathlib import Path
from typing import Any

import numpy as np
import pyvista as pv
import xarray as xr
from imageio import v2 as imageio

from delam_fem.case.definition import Case
from delam_fem.numerics.types import FloatArray
from delam_fem.results import diagnostics
from delam_fem.results.fields import pictures
from delam_fem.results.fields.laminae import contact_lights, held_ends
from delam_fem.results.fields.pictures import RIGHT, TO_CAMERA, drawable_frames, magnification
from delam_fem.results.fields.vtkhdf import CELL_TYPES, OPENING, Series
from delam_fem.results.figures.style import lamina_colours
from delam_fem.results.reading import SOLID, SURFACE, load_numbers
from delam_fem.simulation.recorder import HIT, RESTING
from delam_fem.system.errors import CaseError
from delam_fem.system.files import atomic
from delam_fem.system.written import listed

FORMATS = (".gif", ".mp4")
"""Suffixes of the files that can be written."""
SIZE = (720, 960)
"""Width and height [px]; MP4 wants multiples of 16."""
BAR = slice(-20, -10)
"""Rows of the time bar."""
EDGE = 24
"""Free columns on both sides of the time bar."""
TRACK, DONE = 215, 60
"""Greys of the time bar: what is to come, what has passed."""
LIGHTS = {HIT: "#f0a000", RESTING: "#202020"}
"""Colours of pairs that were hit since the frame before, and of those that rest."""
BLOCKS = "#9a9a9a"
"""Colour of what holds, stops or strikes the laminae."""
RADIUS = 0.011
"""Radius of a light in lengths of the laminae."""
STRETCH = 3.0
"""Factor of lateral lengths: the motion is seen, and the laminae keep their shape."""
TEXT = 12
"""Size of the letters [pt]."""


def write_film(
    history: xr.Dataset,
    case: Case,
    paths: Sequence[Path],
    *,
    solid: Path | None = None,
    periods: float = 2.0,
    rate: float = 20.0,
    stretch: float = STRETCH,
    progress: Callable[[int, int], None] | None = None,
) -> list[Path]:
    """Write the last periods of a run as a film.

    Args:
        history: dataset of a run with frames; see `schema.VARIABLES`.
        case: its case.
        paths: paths of the files, which show the same; each ends in one of `FORMATS`. Their folders
            exist.
        solid: path of solid.vtkhdf, to show solids coloured by the von Mises stress, or of
            surface.vtkhdf, to show a reduced plate coloured by its opening; None: the laminae,
            with the pairs that touch lit.
        periods: length of the film in periods, at most that of the window.
        rate: pictures per second.
        stretch: factor of all lateral lengths of laminae; 1: true to scale. Deflections that are
            too small to be seen are enlarged further, and the film says how much.
        progress: called after each picture with the numbers of finished and of all pictures.

    Returns:
        The files; none if no frame has finite values.

    Raises:
        OSError: a file cannot be read or written.
    """
    history = drawable_frames(history)
    series = None if solid is None else Series.read(solid)
    times = history["frame"].to_numpy() if series is None else series.times
    if not times.size:
        return []
    begin = times[-1] - periods * case.period + 0.5 * case.time_step
    frames = np.flatnonzero(times >= begin).tolist()
    look: dict[str, dict[str, Any]] = {
        ".gif": {"format": "GIF-PIL", "duration": 1.0 / rate, "loop": 0},
        ".mp4": {"format": "FFMPEG", "fps": rate, "quality": 8},
    }
    # without a display, VTK warns before it uses EGL or Mesa
    with pv.vtk_verbosity("error"), ExitStack() as stack:
        files = [stack.enter_context(atomic(path)) for path in paths]
        films: list[Any] = [
            stack.enter_context(imageio.get_writer(file, mode="I", **look[path.suffix]))
            for path, file in zip(paths, files, strict=True)
        ]
        size = SIZE if series is None else SOLID_SIZE
        plotter = pv.Plotter(off_screen=True, window_size=list(size))
        stack.callback(plotter.close)
        plotter.set_background("white")
        show = (
            _Scene(plotter, history, case, frames, (rate, stretch)).show
            if series is None
            else _solid(plotter, series, history, case, frames)
        )
        plotter.show(auto_close=False)
        width = size[0] - 2 * EDGE
        for done, frame in enumerate(frames):
            show(frame)
            time = float(times[frame])
            period = case.period
            text = f"t = {time:.4f} s" + (f" = {time / period:.2f} T" if case.is_periodic else "")
            plotter.add_text(
                text, position=(EDGE / SIZE[0], 0.03), viewport=True, font_size=TEXT,
                color="black", name="time",
            )  # fmt: skip
            plotter.render()
            picture = np.array(plotter.image, dtype=np.uint8)
            picture[BAR, EDGE : EDGE + width] = TRACK
            passed = done / max(1, len(frames) - 1)
            picture[BAR, EDGE : EDGE + round(passed * width)] = DONE
            for film in films:
                film.append_data(picture)
            if progress is not None:
                progress(done + 1, len(frames))
    return list(paths)


def animate(
    run: str | Path,
    output: Sequence[str | Path] | None = None,
    *,
    periods: float = 2.0,
    rate: float = 20.0,
    stretch: float = STRETCH,
    solid: bool = False,
    progress: Callable[[int, int], None] | None = None,
) -> list[Path]:
    """Write a film of the laminae of a run, with the pairs that touch lit.

    Args:
        run: folder of the results of a run.
        output: files that end in .gif or .mp4; None: laminae or solid .gif and .mp4 in the folder.
        periods: length of the film: the last periods.
        rate: pictures per second.
        stretch: factor of lateral lengths; 1: true to scale.
        solid: whether solids are shown, coloured by their stress; of reduced plates the surfaces,
            coloured by the opening of their patches.
        progress: called with the numbers of finished and of all pictures.

    Returns:
        The files.

    Raises:
        CaseError: an option is not valid, or the run has nothing to show.
    """
    for name, value in (("periods", periods), ("rate", rate), ("stretch", stretch)):
        if not 0.0 < value < float("inf"):
            raise CaseError(f"--{name}: expected a positive number, given {value:g}")
    run = Path(run)
    name = "solid" if solid else "laminae"
    paths = [Path(path) for path in output or (run / f"{name}.gif", run / f"{name}.mp4")]
    for path in paths:
        if path.suffix not in FORMATS:
            raise CaseError(f"--output: expected a file that ends in .gif or .mp4, given {path}")
    if len(set(paths)) < len(paths):
        raise CaseError("--output: expected different files, given one of them twice")
    case, history, _ = load_numbers(run)
    if not history.sizes.get("frame", 0):
        raise CaseError(
            f"{run}: the run kept no frames of its fields; run it again with "
            "output.fields_per_period above 0"
        )
    fields = next(
        (path for name in (SURFACE, SOLID) if (path := run / "fields" / name).is_file()),
        run / "fields" / SOLID,
    )
    if solid and not fields.is_file():
        raise CaseError(
            f'{run}: --solid: expected the run of a solid (model.kind = "plane-stress" or "solid") '
            f"with frames, found no fields/{SOLID}"
        )
    with nullcontext() if output else listed(run):
        written = write_film(
            history, case, paths, solid=fields if solid else None, periods=periods, rate=rate,
            stretch=stretch, progress=progress,
        )  # fmt: skip
    if not written:
        raise CaseError(f"{run}: no frame of the run is finite, so there is nothing to show")
    return written


class _Scene:
    """The laminae in a plotter, moved from frame to frame.

    Attributes:
        plotter: the plotter that shows the laminae.
        bodies: ribbons with their fields.
        lights: which pairs to light in each frame; see `contact_lights`.
        deflection: factor of the displacements, which includes the stretch.
        at_rest: corners at rest, stretched, first those of the laminae, shape (n_points, 3) [m].
        laminae: number of the corners of the laminae.
        meshes: meshes of the laminae and of the blocks, with the numbers of their points.
        clamps: for each end that is held: its index (0 or -1), the block, the block's points at
            rest.
        edge: z of the lights: before the near edges of all laminae [m].
        radius: radius of the lights [m].
    """

    def __init__(
        self,
        plotter: pv.Plotter,
        history: xr.Dataset,
        case: Case,
        frames: list[int],
        speed: tuple[float, float],
    ) -> None:
        """Put the laminae at rest into the plotter and aim at where they will move.

        Args:
            plotter: the plotter that shows the laminae.
            history: dataset of the run, with finite frames.
            case: its case.
            frames: numbers of the frames to show.
            speed: pictures per second, and the factor of lateral lengths.
        """
        rate, stretch = speed
        factor = magnification(history, frames, case.length)
        self.bodies = bodies = pictures.Ribbons.of(history, case, factor)
        self.plotter, self.lights = plotter, contact_lights(history)
        self.deflection = factor * stretch
        self.laminae = bodies.rest.size // 3
        self.at_rest = bodies.mesh.points * np.array([1.0, stretch, 1.0])
        length = float(np.ptp(history["x"].to_numpy()))
        self.edge = float(self.at_rest[:, 2].min()) - 0.005 * length
        self.radius = RADIUS * length
        self.meshes = []
        grid = pv.wrap(bodies.grid(0))
        names = [str(name) for name in history["lamina"].to_numpy()]
        entries = list(zip(names, lamina_colours(len(names)), strict=True))
        for i, (_, colour) in enumerate([*entries, ("", BLOCKS)], start=1):
            cells = np.flatnonzero(grid.cell_data["lamina"] == i % (len(names) + 1))
            if not cells.size:
                continue
            part = grid.extract_cells(cells)
            plotter.add_mesh(part, color=colour, ambient=0.75, diffuse=0.3, specular=0.0)
            self.meshes.append((part, part.point_data["vtkOriginalPointIds"]))
        self.clamps = [
            (end, clamp, clamp.points.copy())
            for end, clamp in zip((0, -1), self._blocks(length), strict=True)
            if held_ends(case)[end]
        ]
        for _, clamp, _ in self.clamps:
            plotter.add_mesh(clamp, color=BLOCKS, ambient=0.5)
        plotter.add_legend(
            [*map(list, entries), ["hit", LIGHTS[HIT]], ["resting", LIGHTS[RESTING]]],
            bcolor=None, face="rectangle", loc="lower right", size=(0.16, 0.1),
        )  # fmt: skip
        self._aim(history, length)
        times = history["frame"].to_numpy()
        spacing = float(times[1] - times[0]) if times.size > 1 else 0.0
        scale = "true to scale" if stretch == 1.0 else f"lateral × {stretch:g}"
        scale += "" if factor == 1.0 else f", deflections and gaps × {factor * stretch:g}"
        plotter.add_text(
            f"{case.title.replace(', contact', chr(10) + 'contact')}\n"
            f"{spacing * rate:.2g} of real time, {scale}",
            position=(0.03, 0.915), viewport=True, font_size=TEXT, color="black",
        )  # fmt: skip

    def show(self, frame: int) -> None:
        """Move the laminae to a frame and light the pairs that touch."""
        points = self.at_rest + self.deflection * self.bodies.point_data(frame)["displacement"]
        for mesh, chosen in self.meshes:
            mesh.points = points[chosen]
        faces = points[: self.laminae].reshape(self.bodies.rest.shape)
        marks = self.bodies.marks
        for end, clamp, at_rest in self.clamps:
            moved = float(self.bodies.vectors["displacement"][0, frame, end])
            clamp.points = at_rest + np.array([0.0, self.deflection * moved, 0.0])
        for state, colour in LIGHTS.items():
            where, node = np.nonzero(self.lights[frame] == state)
            name = f"light {state}"
            lit = [k for k, mark in enumerate(marks) if mark.state[frame] == state]
            if not where.size and not lit:
                self.plotter.remove_actor(name, render=False)
                continue
            between = (faces[where, node, 1] + faces[where + 1, node, 0]) / 2.0
            chosen = [
                faces[m.lamina, m.node, 1 if m.side > 0 else 0] for m in (marks[k] for k in lit)
            ]
            between = np.concatenate([between, np.reshape(chosen, (-1, 3))])
            between[:, 2] = self.edge
            spheres = pv.PolyData(between).glyph(
                geom=pv.Sphere(radius=self.radius), scale=False, orient=False
            )
            self.plotter.add_mesh(
                spheres, color=colour, name=name, lighting=False, reset_camera=False
            )

    def _blocks(self, length: float) -> list[pv.PolyData]:
        """Return the blocks that clamp the first and the last section at rest."""
        blocks = []
        for end, outwards in ((0, -1.0), (-1, 1.0)):
            section = self.at_rest[: self.laminae].reshape(self.bodies.rest.shape)[:, end]
            (x, low, _), (_, high, z) = section.min(axis=(0, 1)), section.max(axis=(0, 1))
            margin = 0.015 * length
            x_end = x + outwards * 0.04 * length
            bounds = (min(x, x_end), max(x, x_end), low - margin, high + margin, -z, z)
            blocks.append(pv.Box(bounds=bounds))
        return blocks

    def _aim(self, history: xr.Dataset, length: float) -> None:
        """Point the camera at the middle of all motion."""
        u = self.deflection * history["displacement"].to_numpy()
        y = self.at_rest[: self.laminae, 1].reshape(self.bodies.rest.shape[:3])
        low = float(y.min() + u.min())
        high = float(y.max() + u.max())
        focus: FloatArray = np.array([0.5 * length, 0.0, 0.0]) + 0.5 * (low + high) * RIGHT
        half = max(0.62 * length, 0.55 * (high - low) * SIZE[1] / SIZE[0])
        _aim(self.plotter, focus, (1.0, 0.0, 0.0), 4.0 * length * TO_CAMERA, half)


def _aim(
    plotter: pv.Plotter, focus: FloatArray, up: tuple[float, ...], away: FloatArray, scale: float
) -> None:
    """Point the camera at `focus` from the distance `away`; `scale` is half the height [m]."""
    camera = plotter.camera
    camera.focal_point = focus
    camera.up = up
    camera.position = focus + away
    plotter.enable_parallel_projection()
    camera.parallel_scale = scale
    plotter.reset_camera_clipping_range()


STILL_SIZE = (1500, 800)
SOLID_SIZE = (1280, 608)
"""Width and height of the picture and of the film [px]; MP4 wants multiples of 16."""
SHOWN_THICKNESS = 0.1
"""All laminae together are drawn at most so thick, in lengths of the structure."""
UNITS = (("MPa", 1e6), ("kPa", 1e3), ("Pa", 1.0))
"""Units of stress, of which the largest is taken that gives a number of at least 0.1."""
UNITS_OF_OPENINGS = (("mm", 1e-3), ("µm", 1e-6), ("nm", 1e-9))
"""The same of openings."""
OPENED = (OPENING, "opening", "viridis", 0.0)
"""What is drawn of a reduced plate, as `STRESSES` of solids."""
STRESSES = (
    ("von_mises", "von Mises stress", "viridis", 0.0),
    ("stress_xx", "stress along x", pictures.COLOURS, -1.0),
)
"""Stresses that are drawn: field, words, colours, and the lowest colour over the highest."""
HELD = (("start", 0, -1.0), ("end", 0, 1.0), ("left", 2, -1.0), ("right", 2, 1.0))
"""Edges that may be held, the axis across each, and in which direction it is outside."""
MASSES = "#202020"
"""Colour of point masses."""
SLOPE = 0.35
"""How much lower what is behind must be, over its distance behind, to be seen below the front."""
HIGH = 99.9
"""Percentile of the stresses of all cells that the colours reach: a few corners have more."""


def thickening(series: Series) -> float:
    """Return the factor of thicknesses: 1, 2 or 5 times a power of ten, at least 1."""
    largest = SHOWN_THICKNESS * float(np.ptp(series.points[:, 0])) / series.thickness
    steps = [step * 10.0**power for power in range(4) for step in (1, 2, 5)]
    return max([1.0, *(step for step in steps if step <= largest)])


def render_solid(path: Path, history: xr.Dataset, case: Case, target: Path) -> Path | None:
    """Write a picture of a solid's von Mises and axial stresses just after the strongest strike.

    Args:
        path: path of solid.vtkhdf.
        history: dataset of the run; it says when the strike is.
        case: its case.
        target: path of the picture; its folder is made where it does not exist.

    Returns:
        The file; None if the frames of both files differ.

    Raises:
        OSError: a file cannot be read or written.
    """
    series = Series.read(path)
    history = drawable_frames(history)
    if not np.array_equal(series.times, history["frame"].to_numpy()):
        return None
    with pv.vtk_verbosity("error"), atomic(target) as temporary:
        with closing(_still(series, history, case)) as plotter:
            plotter.screenshot(temporary)
    return target


def _still(series: Series, history: xr.Dataset, case: Case) -> pv.Plotter:
    """Return the scene of `render_solid`: two stresses at the frame after the strike."""
    frame = min(pictures.strike_frame(history, case) + 1, series.times.size - 1)
    thick = thickening(series)
    factor = magnification(history, [frame], case.length)
    points = series.drawn(series.field("displacement", frame), thick, factor)
    attached = _Attached(series, history, case, thick, factor)
    plotter = pv.Plotter(off_screen=True, window_size=list(STILL_SIZE), shape=(2, 1), border=False)
    plotter.set_background("white")
    for row, kind in enumerate(STRESSES):
        plotter.subplot(row, 0)
        values = series.field(kind[0], frame)
        grid, _ = _coloured(plotter, series, points, values, (float(np.abs(values).max()), *kind))
        _held(plotter, grid, case)
        attached.show(plotter, points, frame)
        _look(plotter, points, STILL_SIZE[0] / (0.5 * STILL_SIZE[1]))
    plotter.subplot(0, 0)
    event = "strongest strike" if diagnostics.is_at_probes(history).any() else "smallest gap"
    when = f"t = {series.times[frame]:.4f} s, the first frame after the {event}"
    plotter.add_text(
        f"{case.title}\n{when}; {scales(thick, factor)}",
        position=(0.02, 0.84), viewport=True, font_size=11, color="black",
    )  # fmt: skip
    return plotter


def _scaled(largest: float, field: str) -> tuple[float, str, float]:
    """Return the largest value of a field in a unit, the unit, and its size in SI."""
    units = UNITS_OF_OPENINGS if field == OPENING else UNITS
    name, size = next((unit for unit in units if largest >= 0.1 * unit[1]), units[-1])
    return largest / size or 1.0, name, size


def scales(thickness: float, deflection: float) -> str:
    """Return the factors of a picture in words."""
    deflected = "true to scale" if deflection == 1.0 else f"× {deflection:g}"
    return f"thickness × {thickness:g}, deflections and gaps {deflected}"


def _coloured(
    plotter: pv.Plotter,
    series: Series,
    points: FloatArray,
    stress: FloatArray,
    look: tuple[float, str, str, str, float],
) -> tuple[pv.UnstructuredGrid, float]:
    """Add the laminae in the colours of a stress to a plotter, with the scale of the colours.

    Args:
        plotter: the plotter that shows the laminae.
        series: gives the cells.
        points: places at which the points are drawn, shape (n_points, 3) [m].
        stress: stress at the points, shape (n_points,) [Pa].
        look: largest stress that the colours reach [Pa], and a row of `STRESSES`.

    Returns:
        The laminae, and the unit of the stress there [Pa].
    """
    largest, name, words, colours, lowest = look
    high, unit, size = _scaled(largest, name)
    grid = pv.UnstructuredGrid({CELL_TYPES[series.cell]: series.cells}, points)
    grid.point_data[name] = stress / size
    actor = plotter.add_mesh(
        grid, scalars=name, cmap=colours, clim=(lowest * high, high), show_scalar_bar=False,
        lighting=False,
    )  # fmt: skip
    plotter.add_scalar_bar(
        title=f"{words} [{unit}]\n ", mapper=actor.mapper, vertical=True, position_x=0.89,
        position_y=0.1, width=0.04, height=0.7, n_labels=5, fmt="%.3g", color="black",
        title_font_size=18, label_font_size=18,
    )  # fmt: skip
    return grid, size


def _held(plotter: pv.Plotter, grid: pv.UnstructuredGrid, case: Case) -> None:
    """Add the outline of the laminae and the blocks at the ends that are held, or move them."""
    outline = grid.extract_surface(algorithm="dataset_surface").extract_feature_edges(
        60.0, manifold_edges=False
    )
    if outline.n_points:
        plotter.add_mesh(
            outline, color="#303030", line_width=1.0, name="outline", reset_camera=False
        )
    points = np.asarray(grid.points)
    length = float(case.length)
    for side, axis, outwards in HELD:
        if case.support.holds(side):
            along = outwards * points[:, axis]
            section = points[along > along.max() - 0.01 * length]
            bounds = np.array([section.min(axis=0), section.max(axis=0)])
            bounds[:, 1] += 0.01 * length * pictures.OUTWARDS
            bounds[:, axis] = outwards * along.max()
            bounds[int(outwards > 0.0), axis] += outwards * 0.02 * length
            bounds[1, 2] += 1e-6
            block = pv.Box(bounds=bounds.T.ravel())
            plotter.add_mesh(
                block, color=BLOCKS, lighting=False, name=f"held {side}", reset_camera=False
            )


class _Attached:
    """What holds, stops, strikes or loads a solid inside its span: blocks, and balls for masses.

    Attributes:
        marks: stops, impactors and supports, with their points of the mesh and the places at which
            these are drawn at rest, shape (3,) [m].
        masses: points of the mesh that carry a mass, with the side on which it is drawn.
        factor: factor of deflections and gaps.
        length: of the laminae [m].
        width: lowest and highest z of the laminae [m].
    """

    def __init__(
        self, series: Series, history: xr.Dataset, case: Case, thick: float, factor: float
    ) -> None:
        """Find the points; `thick` and `factor` are those of `Series.drawn`."""
        self.factor = factor
        self.length = float(case.length)
        self.width = (series.points[:, 2].min(), series.points[:, 2].max())
        at_rest = series.drawn(np.zeros_like(series.points), thick, factor)
        self.marks = [
            (mark, at_rest[_point_at(series, mark.lamina, mark.x, mark.z or 0.0, mark.side)])
            for mark in pictures.marks(history, case)
        ]
        names = [lamina.name for lamina in case.lamina]
        self.masses = []
        for mass in case.masses:
            lamina = names.index(mass.lamina)
            is_lowest = lamina == 0 and len(names) > 1
            side = {"top": 1, "bottom": -1}.get(mass.surface or "", -1 if is_lowest else 1)
            place = case.position_of(mass), pictures.across(mass.position) or 0.0
            self.masses.append((_point_at(series, lamina, *place, side), side))

    def show(self, plotter: pv.Plotter, points: FloatArray, frame: int) -> None:
        """Add blocks and balls to a plotter, or move them.

        Args:
            plotter: the plotter that shows the laminae.
            points: places at which the points are drawn, shape (n_points, 3) [m].
            frame: number of the frame.
        """
        half = pictures.BLOCK_LENGTH * self.length
        back, front = self.width
        for number, (mark, (x, y, _)) in enumerate(self.marks):
            face = y + self.factor * (mark.height + mark.motion[frame])
            low_z, high_z = (back, front) if mark.z is None else (mark.z - half, mark.z + half)
            # what is below reaches out from behind the edge in front
            depth = 4.0 * half + (SLOPE * (front - high_z) if mark.side < 0 else 0.0)
            low_y, high_y = sorted((face, face + mark.side * depth))
            block = pv.Box(bounds=(x - half, x + half, low_y, high_y, low_z, high_z + 1e-6))
            name = f"mark {number}"
            plotter.add_mesh(block, color=BLOCKS, ambient=0.5, name=name, reset_camera=False)
        for number, (point, side) in enumerate(self.masses):
            ball = pv.Sphere(
                radius=1.5 * half, center=points[point] + [0.0, side * 1.5 * half, 0.0]
            )
            plotter.add_mesh(ball, color=MASSES, name=f"mass {number}", reset_camera=False)


def _point_at(series: Series, lamina: int, x: float, z: float, side: int) -> int:
    """Return the point of the mesh nearest to a place on a side (1: top) of a lamina, from 0."""
    points = np.unique(series.cells[series.lamina == lamina + 1])
    distance = np.hypot(series.points[points, 0] - x, series.points[points, 2] - z)
    column = points[distance <= distance.min() + 1e-9]
    return int(column[np.argmax(side * series.points[column, 1])])


def _look(plotter: pv.Plotter, points: FloatArray, aspect: float) -> None:
    """Look at the edges of the laminae, x to the right; at solids a little from above."""
    low = points.min(axis=0)
    high = points.max(axis=0)
    is_deep = high[2] > low[2]
    towards = np.array([-0.12, SLOPE, 1.0]) if is_deep else np.array([0.0, 0.0, 1.0])
    span = high - low
    middle = 0.5 * (low + high) + np.array([0.07 * span[0], 0.1 * span[1], 0.0])
    tall = span[1] + (0.4 * span[2] if is_deep else 0.0)
    away = 4.0 * span[0] * towards / np.linalg.norm(towards)
    _aim(plotter, middle, (0.0, 1.0, 0.0), away, max(0.66 * tall, 0.62 * span[0] / aspect))


def _solid(
    plotter: pv.Plotter, series: Series, history: xr.Dataset, case: Case, frames: list[int]
) -> Callable[[int], None]:
    """Put a solid, or a reduced plate, into a plotter; return a function that shows a frame.

    All frames share the scale of colours and the direction of view.
    """
    thick = thickening(series)
    factor = magnification(history, frames, case.length)
    every = {k: series.drawn(series.field("displacement", k), thick, factor) for k in frames}
    look = OPENED if OPENING in series.names else STRESSES[0]
    values = {k: series.field(look[0], k) for k in frames}
    largest = float(np.percentile(np.stack(list(values.values())), HIGH))
    grid, size = _coloured(plotter, series, every[frames[0]], values[frames[0]], (largest, *look))
    plotter.add_text(
        f"{case.title}\n{scales(thick, factor)}",
        position=(0.02, 0.88), viewport=True, font_size=11, color="black",
    )  # fmt: skip
    attached = _Attached(series, history, case, thick, factor)
    bounds = np.concatenate([[points.min(axis=0), points.max(axis=0)] for points in every.values()])
    _look(plotter, bounds, SOLID_SIZE[0] / SOLID_SIZE[1])

    def show(frame: int) -> None:
        grid.points = every[frame]
        grid.point_data[look[0]][:] = values[frame] / size
        _held(plotter, grid, case)
        attached.show(plotter, every[frame], frame)

    return show
