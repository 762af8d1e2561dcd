"""The file of a reduced structure, which `delam-fem reduce` writes and `kind = "modes"` reads.

The file is an archive of NumPy (.npz) with the operators, the layout and the case that was reduced,
behind one checksum. A case that is computed with the file must agree with the reduced case in
everything that was assembled. Gaps at rest are computed again, and stops, impactors and sensors are
set up again from the readings.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp

from delam_fem.case.definition import Case
from delam_fem.case.excitation import places_of
from delam_fem.case.sections import Lamina, x_of, z_of
from delam_fem.model.beams.network import completed, gap_at_rest, layout_of, parts_of
from delam_fem.model.layout import (
    Interface,
    Layout,
    Place,
    Reading,
    Sheets,
    Structure,
    in_order,
)
from delam_fem.model.operators import BaseCoupling, Operators
from delam_fem.model.stops_sensors import StrainRows
from delam_fem.numerics.types import FloatArray
from delam_fem.system.errors import CaseError, reason_of
from delam_fem.system.files import read_arrays, write_arrays

FORMAT = 2
"""Number of the format, which changes when a file cannot be read as before."""
_DIMENSIONS: Mapping[str, tuple[int, ...]] = {
    **dict.fromkeys(("format", "case", "mesh", "is_force"), (0,)),
    **dict.fromkeys(("x", "squares", "corner", "gap0", "weights", "lower"), (1,)),
    **dict.fromkeys(("reading_base", "reading_part", "places"), (1,)),
    **dict.fromkeys(("base", "H", "probes", "readings", "strains", "start", "spots"), (2,)),
    **dict.fromkeys(("dofs", "sections"), (3,)),
    **dict.fromkeys(("sheet_points", "sheet_cells", "sheet_matrix"), (2,)),
    **dict.fromkeys(("sheet_thickness", "sheet_part", "sheet_base"), (1,)),
    "damping": (1, 2),
}
"""Numbers of dimensions that the arrays of a file may have; `places_k` are those of interface k, as
are x and z in `pairs_k` [m]. `spots` are places of a plate: part, x, z and side."""
_COMPARED: Mapping[str, set[str] | None] = {
    "lamina": None,
    "support": None,
    "delamination": {"between", "start", "end", "across", "shape_in_plane"},
    "mesh": {"elements", "across"},
    "damping": None,
    "contact": {"points_per_element"},
    "time": {"mass"},
    "point_mass": None,
    "stop": {"lamina", "position", "start", "end"},
    "impactor": {"lamina", "position"},
    "initial": None,
    "gravity": {"acceleration", "inclination", "roll"},
    "load": None,
}
"""Sections whose keys were assembled; None: all of their keys."""


_SAME_PLACE = 1e-9
"""Difference relative to the length below which two places are one."""


def write(path: Path, structure: Structure, case: Case, strains: FloatArray) -> None:
    """Write a reduced structure.

    Args:
        path: the file; its folder exists.
        structure: the reduced structure, without sensors.
        case: the case that was reduced.
        strains: what the strain sensors of the case read, in their order: a row of the coordinates,
            and the base, shape (k, m + 1).

    Raises:
        OSError: the file cannot be written.
    """
    o, layout = structure.operators, structure.layout
    assert layout.reading is not None
    C = o.damping.toarray()
    is_diagonal = not (C - np.diag(C.diagonal())).any()
    content: dict[str, Any] = {
        "format": np.array(FORMAT),
        "case": np.array(case.to_toml()),
        "mesh": np.array(_digest(case)),
        "x": layout.x,
        "dofs": np.stack([part.dofs for part in layout.parts]),
        "sections": np.stack(
            [[part.flexural_rigidity, part.mass_per_length] for part in layout.parts], axis=1
        ),
        "squares": o.stiffness.diagonal(),
        "damping": C.diagonal() if is_diagonal else C,
        "base": np.stack([o.base.mass, o.base.damping, o.base.stiffness]),
        "corner": np.array(o.base.corner),
        "is_force": np.array(o.base.is_force),
        "H": o.gap_matrix.toarray(),
        "gap0": o.gap0,
        "weights": np.zeros(0) if o.pair_weights is None else o.pair_weights,
        "probes": o.probes.toarray(),
        "readings": layout.reading.matrix.toarray(),
        "reading_base": layout.reading.base,
        "reading_part": layout.reading.part,
        "strains": strains,
    }
    if layout.places:
        content["spots"] = np.array(layout.places, dtype=np.float64)
    if layout.sheets is not None:
        sheets = layout.sheets
        content |= {
            "sheet_points": sheets.points,
            "sheet_thickness": sheets.thickness,
            "sheet_part": sheets.part,
            "sheet_cells": sheets.cells,
            "sheet_matrix": sheets.matrix.astype(np.float32),
            "sheet_base": sheets.base,
        }
    content["lower"] = np.array(
        [interface.parts[0] for interface in layout.interfaces], dtype=np.int64
    )
    for k, interface in enumerate(layout.interfaces):
        content[f"places_{k}"] = interface.places
        if interface.at is not None:
            content[f"pairs_{k}"] = interface.at
    further = {"start": o.start, "load": o.load, "buckling": o.buckling_factor}
    content |= {name: np.array(value) for name, value in further.items() if value is not None}
    write_arrays(path, content)


def load(case: Case) -> Structure:
    """Return the structure of a case with `model.kind = "modes"`, from its file.

    Raises:
        CaseError: the file is missing or damaged, or the case differs in what was assembled.
    """
    path = case.model.file
    assert path is not None  # the section is checked
    try:
        stamp = path.stat()
    except OSError as error:
        raise CaseError(f"model.file: {path} cannot be read ({error.strerror})") from None
    origin, mesh, structure, strains = _read(path, stamp.st_mtime_ns, stamp.st_size)
    # the case must not differ from the reduced one in what was assembled
    before = dict(_assembled(origin))
    now = dict(_assembled(case))
    for key in [*before, *(key for key in now if key not in before)]:
        if before.get(key) != now.get(key):
            raise CaseError(
                f"{key}: expected {before.get(key)!r}, with which {path} was reduced, given "
                f"{now.get(key)!r}; reduce the case again with delam-fem reduce"
            )
    if _digest(case) != mesh:
        raise CaseError(f"mesh.file: is not the mesh with which {path} was reduced; reduce again")
    require_coupled(case)
    o = structure.operators
    if (case.gap, case.delamination) != (origin.gap, origin.delamination):
        structure = replace(
            structure, operators=replace(o, gap0=gap_at_rest(case, structure.layout))
        )
    is_beam = origin.model.kind == "beam" and origin.is_apart
    strain_rows = None if is_beam else _strain_rows(structure.layout, origin, strains)
    return completed(structure, case, strain_rows)


@lru_cache(maxsize=4)
def _read(path: Path, changed: int, size: int) -> tuple[Case, str, Structure, FloatArray]:
    """Return the case, the digest of its mesh file, the structure and strains of a file.

    Args:
        path: the file.
        changed: time of its last change, by which a changed file is read again.
        size: its size.

    Raises:
        CaseError: the file is damaged, or it has no reduced structure.
    """
    try:
        data = read_arrays(path)
        if int(data["format"]) != FORMAT:
            raise ValueError(f"format {int(data['format'])}, expected {FORMAT}")
        origin = Case.from_toml(str(data["case"]))
        structure = _structure(data, origin)
        strains = data["strains"]
        if strains.ndim != 2 or strains.shape[1] != structure.operators.n_dofs + 1:
            raise ValueError("strains of another size")
        return origin, str(data["mesh"]), structure, strains
    except Exception as error:  # a damaged archive raises a dozen different ones
        raise CaseError(
            f"model.file: {path} is damaged or no file of delam-fem reduce ({reason_of(error)}); "
            "write it again with delam-fem reduce"
        ) from None


def _structure(data: Mapping[str, Any], origin: Case) -> Structure:
    """Return the structure that the arrays of a file and the case that was reduced describe.

    Raises:
        ValueError: arrays do not fit one another, or are not finite.
        KeyError: one is missing.
    """
    for name, values in data.items():
        if values.dtype.kind not in "iufbU" or (
            values.dtype.kind == "f" and not np.isfinite(values).all()
        ):
            raise ValueError(f"{name} has no numbers that can be used")
        allowed = _DIMENSIONS.get("places" if name.startswith("places_") else name)
        if name.startswith("pairs_"):
            allowed = (2,)
        if allowed is not None and values.ndim not in allowed:
            raise ValueError(f"{name} has {values.ndim} dimensions")
    squares, damping = data["squares"], data["damping"]
    if not squares.size or (squares < 0.0).any():
        raise ValueError("squares are none")
    n = squares.size
    base = data["base"]
    corner = data["corner"].tolist()
    weights = data["weights"]
    operators = Operators(
        mass=sp.identity(n, format="csr"),
        damping=sp.csr_matrix(np.diag(damping) if damping.ndim == 1 else damping),
        stiffness=sp.diags(squares, format="csr"),
        base=BaseCoupling(
            base[0], base[1], base[2], (corner[0], corner[1], corner[2]), bool(data["is_force"])
        ),
        gap_matrix=sp.csr_matrix(data["H"]),
        gap0=data["gap0"],
        pair_weights=weights if weights.size else None,
        probes=sp.csr_matrix(data["probes"]),
        start=data.get("start"),
        load=data.get("load"),
        buckling_factor=float(data["buckling"]) if "buckling" in data else None,
    )
    reading = Reading(sp.csr_matrix(data["readings"]), data["reading_base"], data["reading_part"])
    if reading.matrix.shape != (reading.base.size, n) or reading.part.shape != (n,):
        raise ValueError("readings of another size")
    parts = parts_of(origin, data["x"], data["dofs"], data["sections"])
    interfaces = [
        Interface(
            f"{parts[k].name}-{parts[k + 1].name}",
            (k, k + 1),
            data[f"places_{number}"],
            at=data.get(f"pairs_{number}"),
        )
        for number, k in enumerate(data["lower"].tolist())
    ]
    rows = data.get("spots", np.zeros((0, 4))).tolist()
    places = tuple(Place(int(part), x, z, int(side)) for part, x, z, side in rows)
    layout = layout_of(origin, parts, in_order(interfaces), reading, places)
    if "sheet_matrix" in data:
        layout = replace(layout, sheets=_sheets(data, n))
    return Structure(operators, layout)


def _sheets(data: Mapping[str, Any], n_dofs: int) -> Sheets:
    """Return the surfaces of the laminae that a file has.

    Raises:
        ValueError: arrays do not fit one another.
        KeyError: one is missing.
    """
    names = ("points", "thickness", "part", "cells", "matrix", "base")
    sheets = Sheets(*(data[f"sheet_{name}"] for name in names))
    n = len(sheets.points)
    sizes = {sheets.thickness.size, sheets.part.size, sheets.base.size, len(sheets.matrix)}
    if sizes != {n} or sheets.points.shape[1] != 3 or sheets.cells.shape[1] != 4:
        raise ValueError("sheets of another size")
    if sheets.matrix.shape[1] != n_dofs or not 0 <= sheets.cells.min() <= sheets.cells.max() < n:
        raise ValueError("sheets of another size")
    return sheets


def _assembled(case: Case) -> Iterator[tuple[str, object]]:
    """Yield the keys that were assembled, with their values."""
    yield "gap", None if case.gap is None else "given"
    data = case.model_dump(mode="json")
    # written laminae leave out what follows from others, as from a material
    data["lamina"] = [
        {key: getattr(lamina, key) for key in Lamina.model_fields} for lamina in case.lamina
    ]
    for section, keys in _COMPARED.items():
        tables = data[section] if isinstance(data[section], list) else [data[section] or {}]
        is_list = isinstance(data[section], list)
        yield f"number of [[{section}]]", len(tables)
        for number, table in enumerate(tables):
            name = table.get("name", number)
            for key, value in table.items():
                if key != "material" and (keys is None or key in keys):
                    yield f"{section}.{name}.{key}" if is_list else f"{section}.{key}", value
    for number, (one, *_) in enumerate(places_of(case.excitation)):
        place = "excitation" if number == 0 else f"excitation at place {number + 1}"
        yield f"{place}.kind", "base" if one.acts_on == "base" else "force"
        for key in ("lamina", "position"):
            yield f"{place}.{key}", getattr(one, key, None)


def _digest(case: Case) -> str:
    """Return a text that tells mesh files apart; empty without one."""
    if case.mesh.file is None:
        return ""
    return hashlib.sha256(case.mesh.file.read_bytes()).hexdigest()


def require_coupled(case: Case) -> None:
    """Refuse impulses on a lumped mass: a reduced model has none.

    Raises:
        CaseError: the law of the case reads such impulses.
    """
    if case.has_lumped_impulses:
        raise CaseError(
            'contact.impulse: expected "consistent", because a reduced model has no lumped mass, '
            'given "lumped"'
        )


def _strain_rows(layout: Layout, origin: Case, strains: FloatArray) -> StrainRows:
    """Return the strains of surfaces that a file has: those of the sensors of the reduced case."""
    known = [sensor for sensor in origin.sensor if sensor.quantity == "strain"]

    def rows(lamina: int, place: float, side: float, z: float) -> sp.csr_matrix:
        x = float(layout.parts[lamina].positions(np.array([place]))[0])
        for sensor, row in zip(known, strains, strict=True):
            assert sensor.position is not None
            distance = abs(x_of(sensor.position) - x) + abs(z_of(sensor.position) - z)
            is_there = distance <= _SAME_PLACE * origin.length
            is_side = (-1.0 if sensor.surface == "bottom" else 1.0) == side
            if sensor.lamina == layout.names[lamina] and is_there and is_side:
                return sp.csr_matrix(row)
        raise CaseError(
            f"sensor: expected one of the {len(known)} strains that the case had when it was "
            f"reduced, given lamina {layout.names[lamina]} at {x:g} m; reduce the case again with "
            "this sensor"
        )

    return rows
