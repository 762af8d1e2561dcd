"""Write the result of a run in the format of another program."""

from __future__ import annotations

from pathlib import Path

import xarray as xr

from delam_fem.case.definition import Case
from delam_fem.case.toml import CaseError
from delam_fem.results.export import matlab, text, universal

FORMATS = {
    "csv": "tables: histories, periods with strobes and energies, events, fields, gaps",
    "mat": "MATLAB: everything",
    "uff": "universal file: histories and strobes, and one with the motion of all nodes; no events",
    "vtkhdf": "VTK: the fields",
}
"""Formats with what they hold."""


def export(history: xr.Dataset, case: Case, to: str, path: str | Path) -> list[Path]:
    """Write the result of a run to files of another format.

    Args:
        history: of a run; see `schema.VARIABLES`.
        case: its case.
        to: one of `FORMATS`.
        path: of the file; its folder is made where it does not exist. Further files are named after
            it.

    Returns:
        The files.

    Raises:
        CaseError: there is no such format, or nothing that it holds.
        OSError: a file cannot be written.
    """
    if to not in FORMATS:
        raise CaseError(f"--to: expected one of {', '.join(FORMATS)}, given {to!r}")
    path = Path(path)
    if path.suffix.lower() != f".{to}":
        raise CaseError(f"--output: expected a file that ends in .{to}, given {path}")
    path.parent.mkdir(parents=True, exist_ok=True)
    if to == "csv":
        return text.write(history, path)
    if to == "mat":
        return matlab.write(history, path)
    if to == "uff":
        return universal.write(history, path)
    return _write_vtkhdf(history, case, path)


def _write_vtkhdf(history: xr.Dataset, case: Case, path: Path) -> list[Path]:
    """Write the fields of all frames."""
    from delam_fem.results.fields import ribbons, vtkhdf

    drawable = ribbons.drawable_frames(history) if history.sizes.get("frame", 0) else history
    if not drawable.sizes.get("frame", 0):
        raise CaseError(
            "the run kept no finite frames of its fields; run it again with "
            "output.fields_per_period above 0"
        )
    bodies = ribbons.Ribbons.of(drawable, case)
    times = drawable["frame"].to_numpy()
    return [vtkhdf.write(bodies.mesh, times, bodies.point_data, path)]
