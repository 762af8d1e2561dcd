"""The laminae as files: VTK fields for ParaView, and a rendered picture.

`ribbons` makes the grids, `vtkhdf` the file of a whole series, `snapshots` the scene of the
picture.
"""

from __future__ import annotations

import shutil
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pyvista as pv
import xarray as xr

from delam_fem.case.atomic import atomic
from delam_fem.case.definition import Case
from delam_fem.numerics.arrays import FloatArray
from delam_fem.results.fields import ribbons, snapshots, vtkhdf


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
        plotter = snapshots.draw(history, case)
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
