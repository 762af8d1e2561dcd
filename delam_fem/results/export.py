"""Write a run, or the operators of a case, in the formats of other programs.

The operators are those of

    M u'' + C u' + K u = -(m_b q_b'' + c_b q_b' + k_b q_b) + Hᵀ λ,   gap = H u + g0

The numbers are SI, and the matrices are dense: beams have some hundred dofs at most.
"""

from __future__ import annotations

import re
from collections.abc import Hashable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from scipy.io import savemat

from delam_fem.case.definition import Case
from delam_fem.case.files import CaseSource, find_case
from delam_fem.model.discretise import assemble, require_kind
from delam_fem.model.layout import Structure
from delam_fem.numerics.types import FloatArray
from delam_fem.results.dataset import GROUPS, SHAPE, grouped
from delam_fem.results.diagnostics import probe_node
from delam_fem.system.errors import CaseError, require
from delam_fem.system.files import atomic, atomic_file, write_text

LONGEST = 63
"""Longest name in MATLAB."""


def write_matlab(history: xr.Dataset, path: Path) -> list[Path]:
    """Write a result as a MATLAB file of version 5, which `load` of MATLAB and Octave reads.

    Arrays have the dimensions of the dataset, in the same order; histories of two laminae are
    2 × n. `units`, `meaning` and `dimensions` are structures with a text for each variable;
    `lamina` holds the names of the laminae, `case_file` the case.

    Args:
        history: dataset of a run; see `schema.VARIABLES`.
        path: the file.

    Returns:
        The file.

    Raises:
        OSError: the file cannot be written.
    """
    content: dict[str, Any] = {"units": {}, "meaning": {}, "dimensions": {}}
    for name in [*history.coords, *history.data_vars]:
        variable = history[name]
        word = _word(str(name))
        values = variable.to_numpy()
        content[word] = values.astype(object) if values.dtype.kind in "UO" else values
        content["units"][word] = str(variable.attrs.get("units", ""))
        content["meaning"][word] = str(variable.attrs.get("long_name", ""))
        content["dimensions"][word] = ", ".join(map(str, variable.dims))
    content["case_file"] = str(history.attrs.get("case", ""))
    content["outcome"] = str(history.attrs.get("outcome", ""))
    with atomic(path) as temporary:
        savemat(
            temporary, content, appendmat=False, long_field_names=True, do_compression=True,
            oned_as="row",
        )  # fmt: skip
    return [path]


def _word(name: str) -> str:
    """Return a name that MATLAB accepts."""
    word = re.sub(r"\W", "_", name, flags=re.ASCII)[:LONGEST]
    return word if word[:1].isalpha() else f"v_{word}"[:LONGEST]


MAIN = "history"
"""Group that gets the name of the file; the others add theirs."""
LONG = ("fields",)
"""Groups with a row for each lamina, frame and node; in the others laminae are columns."""


def write_tables(history: xr.Dataset, path: Path) -> list[Path]:
    """Write a result as tables: NAME.csv with the histories, NAME-periods.csv and so on.

    Args:
        history: dataset of a run; see `schema.VARIABLES`.
        path: NAME.csv.

    Returns:
        The files; empty groups have none.

    Raises:
        OSError: a file cannot be written.
    """
    written = []
    for name, group in grouped(history).items():
        if not group.data_vars or not all(group.sizes.values()):
            continue
        target = path if name == MAIN else path.with_name(f"{path.stem}-{name}{path.suffix}")
        written.append(write_text(target, _long(group) if name in LONG else _wide(group)))
    return written


def _wide(group: xr.Dataset) -> str:
    """Return a group as a table in which each lamina, probe or interface has its columns."""
    all_dims = [str(dim) for variable in group.data_vars.values() for dim in variable.dims]
    dim = max(group.dims, key=lambda dim: all_dims.count(str(dim)))  # that of most variables
    columns: dict[str, object] = {}
    for name in [n for n in group.coords if group[n].dims == (dim,)] + list(group.data_vars):
        variable = group[name]
        if dim not in variable.dims:
            continue
        others = [d for d in variable.dims if d != dim]
        if not others:
            columns[_heading(variable)] = variable.to_numpy()
        for k, label in enumerate(_labels(variable, others[0]) if len(others) == 1 else ()):
            one = variable.isel({others[0]: k})
            columns[_heading(variable, f" {label}")] = one.to_numpy()
    frame = xr.Dataset({k: (("row",), v) for k, v in columns.items()}).to_dataframe()
    return str(frame[list(columns)].to_csv(index=False))


def _labels(variable: xr.DataArray, dim: Hashable) -> list[str]:
    """Return what the entries of a dimension are called: their names, or numbers from 1."""
    if dim in variable.coords:
        return [str(label) for label in variable[dim].to_numpy().tolist()]
    return [str(k + 1) for k in range(variable.sizes[dim])]


def _long(group: xr.Dataset) -> str:
    """Return a group as a table with a row for each entry of all dimensions."""
    frame = group.to_dataframe().reset_index()
    frame.columns = [_heading(group[name]) if name in group else name for name in frame.columns]
    return str(frame.to_csv(index=False))


def _heading(own: xr.DataArray, label: str = "") -> str:
    """Return the heading of a variable with its unit."""
    units = own.attrs.get("units", "")
    return f"{own.name}{label} [{units}]" if units else f"{own.name}{label}"


TYPES = {"m": 8, "m/s": 11, "m/s2": 12, "N": 13, "1": 3, "N m": 1}
"""Data types of universal files by unit; other units have type 0."""
TIME, GENERAL = 17, 1
NODES_PER_LAMINA = 10_000
"""Numbers of the nodes of a lamina begin at its number times this."""
LATERAL = 3
"""Direction of the motion: +z."""


def write_universal(history: xr.Dataset, path: Path) -> list[Path]:
    """Write NAME.uff with histories and strobes, and NAME-fields.uff with the motion of all nodes.

    Times begin at 0, because the format has six digits for them; a line of each set says when that
    was. Universal files have no place for tables of events.

    Args:
        history: dataset of a run; see `schema.VARIABLES`.
        path: NAME.uff.

    Returns:
        The files.

    Raises:
        OSError: a file cannot be written.
    """
    written = [_write([*_about(history), *_histories(history)], path)]
    if history.sizes.get("frame", 0) > 1:
        fields = path.with_name(f"{path.stem}-fields{path.suffix}")
        written.append(_write([*_about(history), *_fields(history)], fields))
    return written


def _write(sets: list[dict[str, Any]], path: Path) -> Path:
    """Write sets to a universal file."""
    import pyuff

    with atomic(path) as temporary:
        file = pyuff.UFF(str(temporary))
        for dataset in sets:
            file.write_sets([dataset], "add")
    return path


def _about(history: xr.Dataset) -> Iterator[dict[str, Any]]:
    """Yield the sets that say what the file is, its units, and where its nodes are."""
    yield {
        "type": 151, "model_name": "delam_fem", "description": history.attrs.get("title", "")[:80],
        "db_app": "", "date_db_created": "", "time_db_created": "", "version_db1": 0,
        "version_db2": 0, "file_type": 0, "date_db_saved": "", "time_db_saved": "",
        "program": f"delam_fem {history.attrs.get('delam_fem', '')}", "date_db_written": "",
        "time_db_written": "",
    }  # fmt: skip
    yield {
        "type": 164, "units_code": 1, "units_description": "SI: Meter (newton)", "temp_mode": 1,
        "length": 1.0, "force": 1.0, "temp": 1.0, "temp_offset": 273.15,
    }  # fmt: skip
    x: FloatArray = history["x"].to_numpy()
    n = history.sizes["lamina"]
    yield {
        "type": 15,
        "node_nums": [_node(i, k) for i in range(n) for k in range(x.size)],
        "def_cs": [0] * n * x.size, "disp_cs": [0] * n * x.size, "color": [0] * n * x.size,
        "x": np.tile(x, n).tolist(), "y": [0.0] * n * x.size,
        "z": np.repeat(np.arange(n, dtype=float), x.size).tolist(),
    }  # fmt: skip


def _node(lamina: int, station: int) -> int:
    """Return the number of a node of a lamina."""
    return NODES_PER_LAMINA * (lamina + 1) + station


def _histories(history: xr.Dataset) -> Iterator[dict[str, Any]]:
    """Yield the sets of histories at every step, and those at the ends of the periods."""
    observed = probe_node(history)
    for name in map(str, history.data_vars):
        variable = history[name]
        dim = str(variable.dims[-1]) if variable.dims else ""
        is_time = dim == "time" or dim.endswith("_time")
        if not (is_time or dim == "period") or variable.ndim > 2:
            continue
        axis: FloatArray = variable[dim].to_numpy().astype(float)
        if variable.ndim == 1:
            yield _set(variable, name, axis, 0, is_time=is_time)
            continue
        for i, label in enumerate(_labels(variable, variable.dims[0])):
            node = _node(i, observed) if variable.dims[0] == "lamina" else 0
            yield _set(variable[i], f"{name} {label}", axis, node, is_time=is_time)


def _fields(history: xr.Dataset) -> Iterator[dict[str, Any]]:
    """Yield the displacements and velocities of all nodes at the frames."""
    times: FloatArray = history["frame"].to_numpy()
    for name in ("displacement", "velocity"):
        for i, label in enumerate(map(str, history["lamina"].to_numpy())):
            for k in range(history.sizes["node"]):
                words = f"{name} {label} node {k}"
                yield _set(history[name][i, :, k], words, times, _node(i, k), is_time=True)


def _set(
    own: xr.DataArray, name: str, axis: FloatArray, node: int, *, is_time: bool
) -> dict[str, Any]:
    """Return a set of type 58 with one history."""
    units = str(own.attrs.get("units", "1"))
    step = float((axis[-1] - axis[0]) / (axis.size - 1)) if axis.size > 1 else 1.0
    return {
        "type": 58, "binary": 0, "func_type": 1 if is_time else 0, "id1": name[:80],
        "id2": str(own.attrs.get("long_name", "NONE"))[:80] or "NONE",
        "id3": f"abscissa from {float(axis[0])!r}",
        "rsp_ent_name": name[:10].replace(" ", "_"), "rsp_node": node, "rsp_dir": LATERAL,
        "ref_ent_name": "NONE", "ref_node": 0, "ref_dir": 0,
        "abscissa_spacing": 1, "x": step * np.arange(max(axis.size, 2)),  # pyuff wants a step
        "abscissa_inc": step,
        "abscissa_spec_data_type": TIME if is_time else GENERAL,
        "abscissa_axis_lab": "time" if is_time else "period",
        "abscissa_axis_units_lab": "s" if is_time else "1",
        "ordinate_spec_data_type": TYPES.get(units, 0),
        "ordinate_axis_lab": name[:20], "ordinate_axis_units_lab": units,
        "orddenom_spec_data_type": 0, "data": own.to_numpy().astype(float),
    }  # fmt: skip


FORMATS = {
    "csv": "tables: histories, periods with strobes and energies, events, fields, gaps",
    "mat": "MATLAB: everything",
    "uff": "universal file: histories and strobes, and one with the motion of all nodes; no events",
    "vtkhdf": "VTK: the fields",
}
"""Formats, and what a file of each holds."""


def targets(path: Path) -> list[Path]:
    """Return the files that an export to a file may write: the file, and others named after it."""
    names = (*GROUPS, SHAPE)
    return [path, *(path.with_name(f"{path.stem}-{name}{path.suffix}") for name in names)]


def export(history: xr.Dataset, case: Case, to: str, path: str | Path) -> list[Path]:
    """Write the result of a run to files of another format.

    Args:
        history: dataset of a run; see `schema.VARIABLES`.
        case: its case.
        to: one of `FORMATS`.
        path: the file; its folder is made where it does not exist. Further files are named after
            it.

    Returns:
        The files.

    Raises:
        CaseError: there is no such format, or nothing that it holds.
        OSError: a file cannot be written.
    """
    require(to in FORMATS, "--to", f"one of {', '.join(FORMATS)}", to)
    path = Path(path)
    if path.suffix.lower() != f".{to}":
        raise CaseError(f"--output: expected a file that ends in .{to}, given {path}")
    tables = {"csv": write_tables, "mat": write_matlab, "uff": write_universal}
    if to in tables:
        return tables[to](history, path)
    from delam_fem.results.fields import pictures, vtkhdf

    drawable = pictures.drawable_frames(history) if history.sizes.get("frame", 0) else history
    if not drawable.sizes.get("frame", 0):
        raise CaseError(
            "the run kept no finite frames of its fields; run it again with "
            "output.fields_per_period above 0"
        )
    bodies = pictures.Ribbons.of(drawable, case)
    return [vtkhdf.write(bodies.mesh, drawable["frame"].to_numpy(), bodies.point_data, path)]


OPERATOR_FORMATS = (".npz", ".mat")


def operators(case: CaseSource, path: str | Path) -> Path:
    """Write M, C, K, H, g0 and the vectors of the base of a case; see `write_operators`.

    Args:
        case: the case, or the name or file of one.
        path: the file, which ends in .npz or .mat.

    Raises:
        CaseError: the case is not valid or of a solid, or the file name has another ending.
    """
    case = find_case(case)
    require_kind(
        case,
        "operators",
        ("beam", "modes"),
        "solids are too large for dense matrices; give the case that delam-fem reduce writes",
    )
    return write_operators(assemble(case, needs_dolfinx=False), case, path)


def write_operators(structure: Structure, case: Case, path: str | Path) -> Path:
    """Write the operators of a structure to a file that ends in .npz or .mat.

    docs/modes.md explains them. Its arrays are `M`, `C`, `K` of shape (n, n); `m_b`, `c_b`, `k_b`
    of shape (n,), `M_bb`, `C_bb`, `K_bb`; `H` of shape (n_pairs, n) and `g0`; `P` of shape
    (n_probes, n), their rows; `lamina` (from 0), `x` [m] and `component` (0 displacement,
    1 slope) of each dof, -1 for the coordinates of a reduced model, shape (n,); `pair_x` [m];
    `drive_frequency` [Hz] and `drive_amplitude` [m or N] (NaN if the drive is not harmonic);
    `drive_is_force`; `case`, the case as TOML.

    Args:
        structure: the discretised case.
        case: gives the drive and the text of the case.
        path: the file; its folder is made where it does not exist.

    Raises:
        CaseError: the file name has another ending.
    """
    path = Path(path)
    if path.suffix not in OPERATOR_FORMATS:
        raise CaseError(f"operators: expected a file that ends in .npz or .mat, given {path.name}")
    o, layout = structure.operators, structure.layout
    of_dofs = np.full((3, o.n_dofs), -1.0)
    for number, part in enumerate(layout.parts if layout.reading is None else ()):
        for component, dofs in enumerate(part.dofs.T):
            free = dofs >= 0
            of_dofs[0, dofs[free]] = number
            of_dofs[2, dofs[free]] = component
            of_dofs[1, dofs[free]] = part.x[free]
    pairs = [layout.parts[i.parts[0]].positions(i.places) for i in layout.interfaces]
    pairs += [layout.parts[stop.part].positions(stop.places) for stop in layout.stops]
    excitation = case.excitation
    frequency = excitation.top_frequency if excitation.is_harmonic else np.nan
    amplitude = getattr(excitation, "amplitude", np.nan)
    if excitation.is_harmonic and hasattr(excitation, "displacement_amplitude"):
        amplitude = excitation.displacement_amplitude(frequency)
    content = {
        "M": o.mass.toarray(),
        "C": o.damping.toarray(),
        "K": o.stiffness.toarray(),
        "m_b": o.base.mass,
        "c_b": o.base.damping,
        "k_b": o.base.stiffness,
        **dict(zip(("M_bb", "C_bb", "K_bb"), o.base.corner, strict=True)),
        "H": o.gap_matrix.toarray(),
        "g0": o.gap0,
        "P": o.probes.toarray(),
        "lamina": of_dofs[0].astype(np.int64),
        "x": of_dofs[1],
        "component": of_dofs[2].astype(np.int64),
        "pair_x": np.concatenate([np.zeros(0), *pairs]),
        "drive_frequency": frequency,
        "drive_amplitude": np.nan if amplitude is None else amplitude,
        "drive_is_force": int(o.base.is_force),
        "case": case.to_toml(),
    }
    with atomic_file(path) as temporary:
        if path.suffix == ".npz":
            np.savez_compressed(temporary, **content)
        else:
            savemat(temporary, content, oned_as="column", do_compression=True)
    return path
