"""Pictures of a solid: the deformed laminae coloured by their stress, thicker than they are.

They are made from fields/solid.vtkhdf, so that they can be made again without the run. Real laminae
are a hundred times longer than thick: thicknesses are drawn larger by a factor that the picture
states, and the turning of their sections with them. Deflections and gaps have a factor of their
own, which is 1 if they can be seen.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pyvista as pv
import xarray as xr

from delam_fem.case.definition import Case
from delam_fem.numerics.types import FloatArray
from delam_fem.results import diagnostics
from delam_fem.results.fields import animation, pictures
from delam_fem.results.fields.derived import held_ends
from delam_fem.results.fields.pictures import drawable_frames
from delam_fem.results.fields.vtkhdf import CELL_TYPES, Series
from delam_fem.results.figures.style import title
from delam_fem.system.files import atomic

SIZE = (1500, 800)
FILM_SIZE = (1280, 608)
"""Width and height of the picture and of the film [px]; MP4 wants multiples of 16."""
SHOWN_THICKNESS = 0.1
"""All laminae together are drawn at most so thick, in lengths of the structure."""
UNITS = (("MPa", 1e6), ("kPa", 1e3), ("Pa", 1.0))
"""Units of stress, of which the largest is taken that gives a number of at least 0.1."""
HIGH = 99.9
"""Percentile of the stresses of all cells that the colours reach: a few corners have more."""


def thickening(series: Series) -> float:
    """Return the factor of thicknesses: 1, 2 or 5 times a power of ten, at least 1."""
    largest = SHOWN_THICKNESS * float(np.ptp(series.points[:, 0])) / series.thickness
    steps = [step * 10.0**power for power in range(4) for step in (1, 2, 5)]
    return max([1.0, *(step for step in steps if step <= largest)])


def render(path: Path, history: xr.Dataset, case: Case, target: Path) -> Path | None:
    """Write the picture solid.png: von Mises and axial stress about the strongest strike.

    Args:
        path: of solid.vtkhdf.
        history: of the run; it says when the strike is.
        case: its case.
        target: of the picture; its folder is made where it does not exist.

    Returns:
        The file; None if the frames of both files differ.

    Raises:
        OSError: a file cannot be read or written.
    """
    series, history = Series.read(path), drawable_frames(history)
    if not np.array_equal(series.times, history["frame"].to_numpy()):
        return None
    target.parent.mkdir(parents=True, exist_ok=True)
    with pv.vtk_verbosity("error"), atomic(target) as temporary:
        plotter = _picture(series, history, case)
        try:
            plotter.screenshot(temporary)
        finally:
            plotter.close()
    return target


def _picture(series: Series, history: xr.Dataset, case: Case) -> pv.Plotter:
    """Return the scene of the picture: two stresses at the frame after the strike."""
    strike = pictures.strike_frame(history, case)
    frame = min(strike + 1, series.times.size - 1)
    thick = thickening(series)
    factor = pictures.magnification(history, [frame], case.length)
    points = series.drawn(series.field("displacement", frame), thick, factor)
    plotter = pv.Plotter(off_screen=True, window_size=list(SIZE), shape=(2, 1), border=False)
    plotter.set_background("white")
    panels = (
        ("von_mises", "von Mises stress", "viridis", False),
        ("stress_xx", "stress along x", pictures.COLOURS, True),
    )
    for row, (name, words, colours, signed) in enumerate(panels):
        plotter.subplot(row, 0)
        values = series.field(name, frame)
        high, unit, size = _scaled(float(np.abs(values).max()))
        grid = _grid(series, points)
        grid.point_data[name] = values / size
        low = -high if signed else 0.0
        _add(plotter, grid, name, (low, high), colours, f"{words} [{unit}]\n ")
        _frame(plotter, grid, case)
        _aim(plotter, points, SIZE[0] / (0.5 * SIZE[1]))
    plotter.subplot(0, 0)
    event = "strongest strike" if diagnostics.is_at_probes(history).any() else "smallest gap"
    when = f"t = {series.times[frame]:.4f} s, the first frame after the {event}"
    plotter.add_text(
        f"{title(case)}\n{when}; {scales(thick, factor)}",
        position=(0.02, 0.84), viewport=True, font_size=11, color="black",
    )  # fmt: skip
    return plotter


def _grid(series: Series, points: FloatArray) -> pv.UnstructuredGrid:
    """Return the cells with points where they are drawn."""
    return pv.UnstructuredGrid({CELL_TYPES[series.cell]: series.cells}, points)


def _scaled(largest: float) -> tuple[float, str, float]:
    """Return a largest stress in a unit, the unit, and its size [Pa]."""
    name, size = next((unit for unit in UNITS if largest >= 0.1 * unit[1]), UNITS[-1])
    return largest / size or 1.0, name, size


def scales(thickness: float, deflection: float) -> str:
    """Return the factors of a picture in words."""
    deflected = "true to scale" if deflection == 1.0 else f"× {deflection:g}"
    return f"thickness × {thickness:g}, deflections and gaps {deflected}"


def _add(
    plotter: pv.Plotter,
    grid: pv.UnstructuredGrid,
    name: str,
    limits: tuple[float, float],
    colours: str,
    words: str,
) -> None:
    """Add the laminae and the scale of their colours, whose title is `words`."""
    actor = plotter.add_mesh(
        grid, scalars=name, cmap=colours, clim=limits, show_scalar_bar=False, lighting=False,
    )  # fmt: skip
    plotter.add_scalar_bar(
        title=words, mapper=actor.mapper, vertical=True, position_x=0.89, position_y=0.1,
        width=0.04, height=0.7, n_labels=5, fmt="%.3g", color="black", title_font_size=18,
        label_font_size=18,
    )  # fmt: skip


def _frame(plotter: pv.Plotter, grid: pv.UnstructuredGrid, case: Case) -> None:
    """Add the outline of the laminae and the blocks at the ends that are held, or move them."""
    outline = grid.extract_surface(algorithm="dataset_surface").extract_feature_edges(
        60.0, manifold_edges=False
    )
    if outline.n_points:
        plotter.add_mesh(
            outline, color="#303030", line_width=1.0, name="outline", reset_camera=False
        )
    points, length = np.asarray(grid.points), float(case.length)
    for is_held, x, outwards in zip(held_ends(case), (0.0, length), (-1.0, 1.0), strict=True):
        if is_held:
            own = points[np.abs(points[:, 0] - x) < 0.01 * length]
            (_, low, near), (_, high, far) = own.min(axis=0), own.max(axis=0)
            margin, x_bounds = 0.01 * length, sorted((x, x + outwards * 0.02 * length))
            block = pv.Box(bounds=(*x_bounds, low - margin, high + margin, near, far + 1e-6))
            plotter.add_mesh(
                block, color="#9a9a9a", lighting=False, name=f"held {x}", reset_camera=False
            )


def _aim(plotter: pv.Plotter, points: FloatArray, aspect: float) -> None:
    """Look at the edges of the laminae, x to the right; at solids a little from above."""
    low, high = points.min(axis=0), points.max(axis=0)
    is_deep = high[2] > low[2]
    towards = np.array([-0.12, 0.35, 1.0]) if is_deep else np.array([0.0, 0.0, 1.0])
    span = high - low
    middle = 0.5 * (low + high) + np.array([0.07 * span[0], 0.1 * span[1], 0.0])
    camera = plotter.camera
    camera.focal_point, camera.up = middle, (0.0, 1.0, 0.0)
    camera.position = middle + 4.0 * span[0] * towards / np.linalg.norm(towards)
    plotter.enable_parallel_projection()
    tall = span[1] + (0.4 * span[2] if is_deep else 0.0)
    camera.parallel_scale = max(0.66 * tall, 0.62 * span[0] / aspect)
    plotter.reset_camera_clipping_range()


def write_film(
    path: Path,
    history: xr.Dataset,
    case: Case,
    targets: Sequence[Path],
    *,
    periods: float = 2.0,
    rate: float = 20.0,
    progress: Callable[[int, int], None] | None = None,
) -> list[Path]:
    """Write the last periods of a solid as a film, coloured by the von Mises stress.

    Args:
        path: of solid.vtkhdf.
        history: of the run.
        case: its case.
        targets: of the files, which show the same; each ends in one of `animation.FORMATS`.
        periods: length of the film in periods, at most that of the window.
        rate: pictures per second.
        progress: called after each picture with the numbers of finished and of all pictures.

    Returns:
        The files.

    Raises:
        OSError: a file cannot be read or written.
    """
    series, history = Series.read(path), drawable_frames(history)
    begin = series.times[-1] - periods * case.period + 0.5 * case.time_step
    frames = np.flatnonzero(series.times > begin)
    with ExitStack() as stack:
        writers = []
        for target in targets:
            temporary = stack.enter_context(atomic(target))
            writers.append(stack.enter_context(animation.writer(temporary, rate)))
        for done, picture in enumerate(_pictures(series, history, case, frames), start=1):
            for film in writers:
                film.append_data(picture)
            if progress is not None:
                progress(done, frames.size)
    return list(targets)


def _pictures(
    series: Series, history: xr.Dataset, case: Case, frames: npt.NDArray[Any]
) -> Iterator[animation.Picture]:
    """Yield the pictures of some frames, with the same colours and the same view."""
    thick = thickening(series)
    factor = pictures.magnification(history, frames.tolist(), case.length)
    every = [series.drawn(series.field("displacement", int(k)), thick, factor) for k in frames]
    stresses = [series.field("von_mises", int(k)) for k in frames]
    high, unit, size = _scaled(float(np.percentile(np.stack(stresses), HIGH)))
    bounds = np.concatenate([[own.min(axis=0), own.max(axis=0)] for own in every])
    with pv.vtk_verbosity("error"):
        plotter = pv.Plotter(off_screen=True, window_size=list(FILM_SIZE))
        try:
            plotter.set_background("white")
            grid = _grid(series, every[0])
            grid.point_data["von_mises"] = stresses[0] / size
            words = f"von Mises stress [{unit}]\n "
            _add(plotter, grid, "von_mises", (0.0, high), "viridis", words)
            plotter.add_text(
                f"{title(case)}\n{scales(thick, factor)}",
                position=(0.02, 0.88), viewport=True, font_size=11, color="black",
            )  # fmt: skip
            _aim(plotter, bounds, FILM_SIZE[0] / FILM_SIZE[1])
            plotter.show(auto_close=False)
            for k, points, stress in zip(frames, every, stresses, strict=True):
                grid.points = points
                grid.point_data["von_mises"][:] = stress / size
                _frame(plotter, grid, case)
                animation.tell_time(plotter, float(series.times[k]), case)
                plotter.render()
                picture = np.array(plotter.image, dtype=np.uint8)
                done = (k - frames[0]) / max(1, frames.size - 1)
                yield animation.with_time_bar(picture, float(done))
        finally:
            plotter.close()
