"""The deformed laminae at some instants: pictures, and VTK files for ParaView.

The laminae as files: VTK fields for ParaView, and a rendered picture. `ribbons` makes the grids,
`vtkhdf` the file of a whole series.
"""

from __future__ import annotations

import math
import shutil
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pyvista as pv
import xarray as xr

from delam_fem.case.definition import Case
from delam_fem.numerics.arrays import FloatArray
from delam_fem.results import diagnostics
from delam_fem.results.fields import ribbons, vtkhdf
from delam_fem.results.figures.style import title
from delam_fem.system.files import atomic

PHASES = (-0.3, -0.2, -0.1, 0.0, 0.1, 0.2, 0.3)
"""Instants of the snapshots, in periods from the strike."""
SIZE = (1500, 1050)
"""Width and height of the picture [px]."""
TURN, TILT = np.radians(24.0), np.radians(14.0)
"""Angles by which the camera is turned from the view on the edges of the laminae, and raised."""
TO_CAMERA = np.array([np.sin(TILT), -np.cos(TILT) * np.sin(TURN), -np.cos(TILT) * np.cos(TURN)])
"""Direction of the camera; x is up and y to the right in the picture."""
RIGHT = np.cross([1.0, 0.0, 0.0], TO_CAMERA) / np.cos(TILT)
"""Horizontal in the picture: the direction in which the snapshots stand side by side."""
ROW = 1.42
"""Length of the row of snapshots in lengths of the laminae: it fills the picture."""
COLOURS = "coolwarm"
"""Blue to grey to red: readable by the colour-blind, and zero stays visible on white."""
VISIBLE, SHOWN_DEFLECTION = 0.01, 0.04
"""Deflections below the first number are drawn as large as the second, in lengths."""
NAME_DISTANCE = 0.07
"""Distance of the names of neighbours that touch, in lengths of the laminae."""
TEXT = 22
"""Size of the letters [px]."""


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
        when, strength = history["time"].to_numpy(), -diagnostics.tip_gap(history)
    frames = history["frame"].to_numpy()
    is_inside = (when >= frames[0] - PHASES[0] * case.period) & (
        when <= frames[-1] - PHASES[-1] * case.period
    )
    if is_inside.any():
        when, strength = when[is_inside], strength[is_inside]
    strike = float(when[np.argmax(strength)])
    return max(0, int(np.searchsorted(frames, strike - 1e-6 * case.time_step)) - 1)


def largest_speed(history: xr.Dataset, frames: list[int]) -> float:
    """Return the end of the colour scale: the largest speed of any strike and frame [m/s].

    The probes are recorded at every step. Frames are too far apart to hold the speeds of strikes.

    Args:
        history: of a run; see `schema.VARIABLES`.
        frames: numbers of the frames that are shown.
    """
    speeds = (history["velocity"].to_numpy()[:, frames], history["tip_velocity"].to_numpy())
    return max(float(np.nanmax(np.abs(v), initial=0.0, where=np.isfinite(v))) for v in speeds)


def draw(history: xr.Dataset, case: Case) -> pv.Plotter:
    """Return the scene: the laminae side by side at the instants `PHASES`.

    Deflections are true to scale unless they are too small to be seen; the title names the factor.

    Args:
        history: with the fields of at least one frame; see `schema.VARIABLES`.
        case: its case.

    Returns:
        An off-screen plotter that the caller closes.
    """
    frames = history["frame"].to_numpy()
    shown_strike = strike_frame(history, case)
    strike = frames[shown_strike]
    shown = [int(np.argmin(np.abs(frames - strike - phase * case.period))) for phase in PHASES]
    shown, length = sorted(set(shown)), case.lamina[0].length
    limit = largest_speed(history, shown) or 1.0
    factor = magnification(history, shown, length)
    bodies = ribbons.Ribbons.of(history, case, factor)
    name = "strike" if diagnostics.is_at_probes(history).any() else "closest"
    plotter = pv.Plotter(off_screen=True, window_size=list(SIZE))
    plotter.set_background("white")
    for k, frame in enumerate(shown):
        place = (k - (len(shown) - 1) / 2) * ROW / len(PHASES) * length * RIGHT
        laminae = bodies.grid(frame).warp_by_vector("displacement", factor=factor).translate(place)
        laminae["lateral velocity"] = laminae["velocity"][:, 1]
        outline = laminae.extract_surface(algorithm="dataset_surface")
        plotter.add_mesh(outline.extract_feature_edges(60.0), color="#303030", line_width=1.0)
        for block in _supports(history, case, frame, factor):
            plotter.add_mesh(block.translate(place), color="#9a9a9a", ambient=0.4)
        plotter.add_mesh(
            laminae, scalars="lateral velocity", cmap=COLOURS, clim=(-limit, limit),
            show_scalar_bar=False, ambient=0.75, diffuse=0.3, specular=0.0,
        )  # fmt: skip
        after = (frames[frame] - strike) / case.period
        text = f"{after:+.1f} T".replace("-", "−") if frame != shown_strike else name
        _label(plotter, place - [0.11 * length, 0.0, 0.0], text)
    aside = -(len(shown) - 1) / 2 * ROW / len(PHASES) * length
    _name_laminae(plotter, history, shown[0], (aside, factor))
    scale = "true to scale" if factor == 1.0 else f"deflections and gaps × {factor:g}"
    _dress(plotter, f"{title(case)}; {scale}, T = {case.period:.3g} s")
    _aim(plotter, length)
    return plotter


def magnification(history: xr.Dataset, frames: list[int], length: float) -> float:
    """Return the factor of deflections and gaps: 1, 2 or 5 times a power of ten; 1 if visible.

    Args:
        history: with the fields of the frames.
        frames: numbers of the frames that are shown.
        length: length of the laminae [m].
    """
    u = history["displacement"].to_numpy()[:, frames]
    largest = max(float(np.abs(u).max(initial=0.0)), float(history["gap0"].max()))
    if largest >= VISIBLE * length or largest == 0.0:
        return 1.0
    wanted = SHOWN_DEFLECTION * length / largest
    power = 10.0 ** math.floor(math.log10(wanted))
    return max(1.0, power * max(step for step in (1, 2, 5) if step * power <= wanted))


def _supports(history: xr.Dataset, case: Case, frame: int, factor: float) -> Iterator[pv.PolyData]:
    """Yield the blocks that hold the laminae at their ends and move with the base."""
    length = case.length
    block = 6.0 * sum(lamina.thickness for lamina in case.lamina)
    width = max(lamina.width for lamina in case.lamina)
    ends = ((0, case.support.start, 0.0, -1.0), (-1, case.support.end, length, 1.0))
    for node, kind, x, outwards in ends:
        if kind != "free":
            depth = (0.05 if kind == "clamped" else 0.01) * length
            base = factor * float(history["displacement"][0, frame, node])
            x_bounds = sorted((x, x + outwards * depth))
            yield pv.Box(
                bounds=(*x_bounds, base - block / 2, base + block / 2, -0.6 * width, 0.6 * width)
            )


def _label(plotter: pv.Plotter, point: FloatArray, text: str) -> None:
    """Write at a point."""
    plotter.add_point_labels(
        point[None, :], [text], font_size=TEXT, text_color="black", shape=None, bold=False,
        show_points=False, always_visible=True, justification_horizontal="center",
    )  # fmt: skip


def _name_laminae(
    plotter: pv.Plotter, history: xr.Dataset, frame: int, drawn: tuple[float, float]
) -> None:
    """Write the names of the laminae beyond their probes in the first snapshot.

    `drawn` holds the offset of the snapshot and the factor of its deflections.
    """
    offset, factor = drawn
    node, length = diagnostics.probe_node(history), float(history["x"][-1])
    x, at_rest = float(history["x"][node]), diagnostics.rest_positions(history)[:, node]
    for i, name in enumerate(history["lamina"].to_numpy()):
        y = factor * (at_rest[i] + float(history["displacement"][i, frame, node]))
        between = NAME_DISTANCE if x == length else 2.5 * NAME_DISTANCE  # beside the laminae
        side = between * (i - (len(at_rest) - 1) / 2) * length
        point = np.array([x + 0.03 * length, y, 0.0]) + (offset + side) * RIGHT
        _label(plotter, point, str(name))


def _dress(plotter: pv.Plotter, text: str) -> None:
    """Add the title and a scalar bar beside the scene."""
    plotter.add_text(
        text, position=(0.03, 0.955), viewport=True, font_size=TEXT // 2 + 2, color="black"
    )
    plotter.add_scalar_bar(
        title="lateral velocity [m/s]\n ", vertical=True, position_x=0.885, position_y=0.2,
        width=0.05, height=0.6, n_labels=5, fmt="%+.2f", color="black",
        title_font_size=TEXT, label_font_size=TEXT,
    )  # fmt: skip


def _aim(plotter: pv.Plotter, length: float) -> None:
    """Point the camera so that the row fills the picture left of the scalar bar."""
    focus = np.array([0.48 * length, 0.0, 0.0]) + 0.1 * length * RIGHT
    plotter.camera.focal_point = focus
    plotter.camera.position = focus + 4.0 * length * TO_CAMERA
    plotter.camera.up = (1.0, 0.0, 0.0)
    plotter.enable_parallel_projection()
    plotter.camera.parallel_scale = 0.65 * length
    plotter.reset_camera_clipping_range()


def write_fields(history: xr.Dataset, case: Case, directory: str | Path) -> list[Path]:
    """Write fields.vtkhdf with all frames, and fields.pvd with the frames of the last period.

    All frames of fields.vtkhdf share one mesh, the laminae at rest. fields.pvd is for programs that
    do not read VTKHDF: it has one .vtu per frame, so it is kept small. Old files that the new
    collection does not name are removed.

    Args:
        history: with the fields of the frames; see `schema.VARIABLES`.
        case: gives widths and thicknesses.
        directory: made where it does not exist.

    Returns:
        Both files; none if no frame has finite values.

    Raises:
        OSError: the folder cannot be written or the disk is full.
    """
    history = ribbons.drawable_frames(history)
    times = history["frame"].to_numpy()
    if not times.size:
        return []
    directory = Path(directory)
    directory.mkdir(parents=True, exist_ok=True)
    bodies = ribbons.Ribbons.of(history, case)
    series = vtkhdf.write(bodies.mesh, times, bodies.point_data, directory / "fields.vtkhdf")
    length = case.period if case.is_periodic else np.inf
    last = np.flatnonzero(times > times[-1] - length + 0.5 * case.time_step)
    names = [f"fields_{k:0{len(str(last.size - 1))}d}.vtu" for k in range(last.size)]
    for frame, name in zip(last, names, strict=True):
        with atomic(directory / name) as temporary:
            bodies.grid(int(frame)).save(temporary)
    for path in set(directory.glob("fields_*.vtu")) - {directory / name for name in names}:
        path.unlink()
    return [series, _write_collection(directory / "fields.pvd", times[last], names)]


def remove_fields(directory: Path) -> None:
    """Remove the fields of an earlier run, which would be taken for those of this one."""
    single = [directory / name for name in ("fields.pvd", "fields.vtkhdf", "solid.vtkhdf")]
    for path in (*single, *directory.glob("fields_*.vtu")):
        path.unlink(missing_ok=True)
    for name in ("fields.bp", "solid.bp"):
        shutil.rmtree(directory / name, ignore_errors=True)


def render(history: xr.Dataset, case: Case, path: str | Path) -> Path | None:
    """Write the picture that `snapshots.draw` makes as PNG.

    Args:
        history: of a run; see `schema.VARIABLES`.
        case: its case.
        path: of the file; its folder is made if it does not exist.

    Returns:
        The file; None if no frame has finite values.

    Raises:
        OSError: the file cannot be written.
    """
    history = ribbons.drawable_frames(history)
    if not history.sizes["frame"]:
        return None
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    # without a display, VTK warns before it uses EGL or Mesa
    with pv.vtk_verbosity("error"), atomic(path) as temporary:
        plotter = draw(history, case)
        try:
            plotter.screenshot(temporary)
        finally:
            plotter.close()
    return path


def _write_collection(path: Path, times: FloatArray, names: list[str]) -> Path:
    """Write a ParaView collection: a time for each file."""
    root = ET.Element("VTKFile", type="Collection", version="0.1", byte_order="LittleEndian")
    collection = ET.SubElement(root, "Collection")
    for time, name in zip(times, names, strict=True):
        ET.SubElement(
            collection, "DataSet", timestep=repr(float(time)), group="", part="0", file=name
        )
    ET.indent(root)
    with atomic(path) as temporary:
        ET.ElementTree(root).write(temporary, encoding="utf-8", xml_declaration=True)
    return path
