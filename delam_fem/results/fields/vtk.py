"""The deformed laminae as files: VTK fields for ParaView, and a rendered picture.

`ribbons` makes the grids and `snapshots` the scene of the picture.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

import pyvista as pv
import xarray as xr

from delam_fem.case.atomic import atomic
from delam_fem.case.definition import Case
from delam_fem.numerics.arrays import FloatArray
from delam_fem.results.fields import ribbons, snapshots


def write_fields(history: xr.Dataset, case: Case, directory: str | Path) -> Path | None:
    """Write one .vtu per frame and the collection fields.pvd, which is written last.

    Old files that the new collection does not name are removed.

    Args:
        history: with the fields of the frames; see `schema.VARIABLES`.
        case: gives widths and thicknesses.
        directory: made where it does not exist.

    Returns:
        The collection; None if no frame has finite values.

    Raises:
        OSError: the folder cannot be written or the disk is full.
    """
    history = ribbons.drawable_frames(history)
    n_frames = history.sizes["frame"]
    if not n_frames:
        return None
    directory = Path(directory)
    directory.mkdir(parents=True, exist_ok=True)
    digits = len(str(n_frames - 1))
    names = [f"fields_{k:0{digits}d}.vtu" for k in range(n_frames)]
    rest = ribbons.rest_points(history, case)
    for k, name in enumerate(names):
        with atomic(directory / name) as temporary:
            ribbons.grid(history, case, k, rest=rest).save(temporary)
    for path in set(directory.glob("fields_*.vtu")) - {directory / name for name in names}:
        path.unlink()
    return _write_collection(directory / "fields.pvd", history["frame"].to_numpy(), names)


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
