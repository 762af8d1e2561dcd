"""The nodes along the laminae: uniform, or read from a mesh file by meshio.

Contact is node to node, so both laminae must have their nodes at the same positions x. Physical
groups in the file (or any integer cell data with two values) say which line belongs to which
lamina.
"""

from __future__ import annotations

import io
import logging
import xml.etree.ElementTree as ElementTree
from collections.abc import Sequence
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path
from typing import Any

import numpy as np

from delam_fem.case.definition import Case
from delam_fem.case.sections import MESH_UNITS, z_of
from delam_fem.numerics.types import FloatArray, IntArray
from delam_fem.system.errors import CaseError, reason_of, require
from delam_fem.system.footprint import bounded

_COUNTS = {2: "two", 3: "three"}
FORMATS = {".msh": "gmsh", ".vtk": "vtk", ".vtu": "vtu", ".xdmf": "xdmf"}
"""Names of meshio's formats by suffix. On damaged files of some others it never ends."""
HEAD = 64
"""Bytes at the start of a file that tell the version of gmsh's format."""
MOST_BYTES = 100_000_000
"""Largest mesh file."""
_log = logging.getLogger(__name__)
NODE_TOLERANCE = 1e-9  # relative to the length: nodes closer than this along x are opposite


def node_coordinates(case: Case) -> FloatArray:
    """Return the coordinates of the opposite nodes, clamp first, shape (n_nodes,) [m].

    Raises:
        CaseError: the mesh file is missing, unreadable, lacks a lamina, does not span [0, L], or
            the nodes of the two laminae are not opposite.
    """
    length = case.length
    if case.mesh.file is None:
        assert case.mesh.elements is not None
        if case.mesh.across is not None:
            return graded(edges(case), case.mesh.elements, "mesh.elements", _patch_edges(case, 0))
        return placed(case, case.mesh.elements)
    path = Path(case.mesh.file)
    first, *others = (
        _lamina_nodes(path, points, cells, length) for points, cells in _lamina_lines(case, path)
    )
    for other in others:
        for k, (a, b) in enumerate(zip(first, other, strict=False)):
            if abs(a - b) > NODE_TOLERANCE * length:
                raise CaseError(
                    f"mesh.file: {path}: expected opposite nodes on the two laminae, but node {k} "
                    f"is at x = {a:.9g} m on the first and {b:.9g} m on the second"
                )
        if len(first) != len(other):
            raise CaseError(
                f"mesh.file: {path}: expected the same number of nodes on both laminae, given "
                f"{len(first)} and {len(other)}"
            )
    require_edges(case, first, f"mesh.file: {path}")
    return first


def edges(case: Case) -> FloatArray:
    """Return where nodes must be, increasing [m].

    They are the ends of the structure, the edges of its delaminations, the supports inside that are
    no springs, the places of tables of its laminae, and the ends of shorter laminae.
    """
    length = case.length
    support_places = {support.x for support in (*case.support.held, *case.support.pins)}
    places = sorted(
        {
            edge
            for delamination in case.delamination
            for edge in (delamination.start, delamination.end)
        }
        | support_places
        | {x for lamina in case.lamina for x in lamina.breaks}
        | {lamina.length for lamina in case.lamina}
    )
    margin = NODE_TOLERANCE * length
    positions = [0.0]
    for place in places:
        if place - positions[-1] > margin and length - place > margin:
            positions.append(place)
    return np.array([*positions, length])


def require_edges(case: Case, x: FloatArray, source: str) -> None:
    """Check that a node is at every edge of a delamination and at every support that holds one.

    Raises:
        CaseError: an edge or a support lies between two nodes.
    """
    for edge in edges(case):
        nearest = float(x[np.argmin(np.abs(x - edge))])
        if abs(nearest - edge) > NODE_TOLERANCE * case.length:
            raise CaseError(
                f"{source}: expected a node at the edge x = {edge:g} m of a delamination, or at "
                f"that support or place of a table, the nearest is at {nearest:g} m"
            )


def coordinates_across(case: Case) -> FloatArray:
    """Return z of the vertices of a plate across its width, from its middle, shape (m,) [m].

    Raises:
        CaseError: `mesh.across` is less than two for each segment.
    """
    assert case.mesh.across is not None
    half = 0.5 * case.lamina[0].mean("width")
    patch_edges = _patch_edges(case, 1)
    pins = [z_of(pin.position or 0.0) for pin in case.support.pins]
    places = _apart([*patch_edges, *pins], NODE_TOLERANCE * case.length)
    inside = [z for z in places if half - abs(z) > NODE_TOLERANCE * half]
    return graded(np.array([-half, *inside, half]), case.mesh.across, "mesh.across", patch_edges)


def _patch_edges(case: Case, axis: int) -> list[float]:
    """Return where the edges of patches are, increasing: x, or z with axis 1 [m]."""
    spans = [((patch.start, patch.end), patch.across or ())[axis] for patch in case.delamination]
    return _apart([edge for span in spans for edge in span], NODE_TOLERANCE * case.length)


def _apart(places: Sequence[float], margin: float) -> list[float]:
    """Return places, increasing, without those that are no farther from another than a margin."""
    result: list[float] = []
    for place in sorted(places):
        if not result or place - result[-1] > margin:
            result.append(place)
    return result


def graded(at: FloatArray, n: int, key: str, fine: Sequence[float]) -> FloatArray:
    """Return the vertices of n cells with one at every given place, finer at some of these.

    Each segment has cells as many as its share of the length, and at least two. Cells at the places
    `fine` are half as long as those farthest from them.

    Args:
        at: places of vertices, increasing [m].
        n: number of cells.
        key: the key that gives n.
        fine: places at which cells are short [m].

    Raises:
        CaseError: n is less than two for each segment.
    """
    counts = _counts(at, n, key)
    margin = NODE_TOLERANCE * float(at[-1] - at[0])
    is_fine = [bool(min(abs(place - x) for x in [*fine, np.inf]) <= margin) for place in at]
    pieces = []
    for k, count in enumerate(counts.tolist()):
        s = np.linspace(0.0, 1.0, count + 1)[:-1]
        if is_fine[k] and is_fine[k + 1]:
            s = s - GRADING * np.sin(2.0 * np.pi * s) / (2.0 * np.pi)
        elif is_fine[k]:
            s = s - GRADING * s * (1.0 - s)
        elif is_fine[k + 1]:
            s = s + GRADING * s * (1.0 - s)
        pieces.append(at[k] + (at[k + 1] - at[k]) * s)
    return np.concatenate([*pieces, at[-1:]])


GRADING = 1.0 / 3.0
"""Half of the difference of the longest and the shortest cell of a segment, over their mean."""


def placed(case: Case, n: int) -> FloatArray:
    """Return the nodes of n elements with a node at every edge, uniform where that is possible.

    Otherwise each segment between two edges has equal elements, as many as its share of the length,
    and at least two, so that there is a pair within every delamination.

    Raises:
        CaseError: n is less than two for each segment.
    """
    length = case.length
    at = edges(case)
    uniform = np.linspace(0.0, length, n + 1)
    nearest = np.abs(uniform[:, None] - at).argmin(axis=0)
    if np.all(np.abs(uniform[nearest] - at) <= NODE_TOLERANCE * length) and (
        at.size == 2 or np.diff(nearest).min() > 1
    ):
        return uniform
    counts = _counts(at, n, "mesh.elements")
    pieces = [
        np.linspace(a, b, k + 1)[:-1] for a, b, k in zip(at[:-1], at[1:], counts, strict=True)
    ]
    return np.concatenate([*pieces, [length]])


def _counts(at: FloatArray, n: int, key: str) -> IntArray:
    """Return how many of n cells each segment between two places has, at least two.

    Raises:
        CaseError: n is less than two for each segment.
    """
    spans = np.diff(at)
    if spans.size == 1:
        return np.array([n])
    least = (
        f"at least {2 * spans.size}, two between neighbouring edges of delaminations, supports and "
        "places of tables"
    )
    require(n >= 2 * spans.size, key, least, n)
    length = float(at[-1] - at[0])
    counts = np.maximum(2, np.floor(n * spans / length)).astype(np.int64)
    while counts.sum() != n:  # the coarsest segment gets one more, or the finest one fewer
        h = spans / counts
        if counts.sum() < n:
            counts[np.argmax(h)] += 1
        else:
            counts[np.argmin(np.where(counts > 2, h, np.inf))] -= 1
    return counts


def read_file(path: Path, unit: str | None = None) -> Any:
    """Read a mesh file with meshio; its points are in metres.

    Args:
        path: the file.
        unit: the unit of its points, one of `MESH_UNITS`; None: the metre.

    Raises:
        CaseError: the file is missing, too large, of another format, or damaged.
    """
    import meshio

    if not path.is_file():
        raise CaseError(f"mesh.file: no such file: {path}")
    if path.suffix not in FORMATS:
        raise CaseError(f"mesh.file: {path}: expected a file {', '.join(FORMATS)}")
    if path.stat().st_size > MOST_BYTES:
        raise CaseError(f"mesh.file: {path}: expected at most {MOST_BYTES} bytes")
    try:
        with redirect_stdout(io.StringIO()), redirect_stderr(io.StringIO()):
            with bounded(path, f"mesh.file: {path}"):
                if path.suffix == ".xdmf":
                    _require_alone(path)
                mesh = meshio.read(path, file_format=FORMATS[path.suffix])
    except CaseError:
        raise
    except (Exception, SystemExit) as error:  # meshio exits on some files
        _log.debug("meshio failed here", exc_info=True)
        raise CaseError(
            f"mesh.file: meshio cannot read {path} as {FORMATS[path.suffix]} ({_reason(error)}); "
            f"{_remedy(path, str(error))}"
        ) from error
    if unit is not None:
        mesh.points = np.asarray(mesh.points, dtype=np.float64) * MESH_UNITS[unit]
    return mesh


def _reason(error: BaseException) -> str:
    """Return why meshio failed; it ends the program on some files, and then says nothing."""
    return reason_of(error) if isinstance(error, Exception) else "without a reason"


def _remedy(path: Path, reason: str) -> str:
    """Return what makes a mesh readable that meshio refuses."""
    with path.open("rb") as file:
        head = file.read(HEAD).split()
    if path.suffix == ".msh" and head[:1] == [b"$MeshFormat"] and head[1:2] in ([b"4"], [b"4.0"]):
        return "its format 4.0 is not read; Mesh.MshFileVersion = 4.1 or 2.2 in gmsh writes another"
    if "gmsh:physical" in reason:
        return (
            "some of its cells are in no physical group; Mesh.SaveAll = 0 in gmsh leaves them out, "
            "and every lamina needs a group"
        )
    return "is it damaged? Write it anew, or convert it with `meshio convert`"


def _require_alone(path: Path) -> None:
    """Refuse an XDMF file whose numbers are elsewhere than in its HDF5 file, and that in this one.

    Raises:
        CaseError: it names other files, or its HDF5 file does.
        OSError: its HDF5 file is damaged.
    """
    from delam_fem.system.hdf5 import require_alone

    heavy = path.with_suffix(".h5")
    for item in ElementTree.parse(path).iter():
        kind = item.get("Format", "XML")
        if item.tag.endswith("include") or kind not in ("XML", "HDF"):
            raise CaseError(
                f"mesh.file: {path}: expected numbers in this file or in {heavy.name} beside it, "
                "given another file"
            )
        if kind == "HDF":
            name = (item.text or "").strip().partition(":")[0]
            if name != heavy.name or heavy.is_symlink():
                raise CaseError(
                    f"mesh.file: {path}: expected numbers in {heavy.name} beside it, given "
                    f"{name[:60]!r}"
                )
    if heavy.is_file():
        require_alone(heavy)


def _lamina_lines(case: Case, path: Path) -> list[tuple[FloatArray, IntArray]]:
    """Return, for each lamina, x of all points and the line cells."""
    names = [lamina.name for lamina in case.lamina]
    mesh = read_file(path, case.mesh.unit)
    lines = mesh.cells_dict.get("line")
    if lines is None:
        kinds = ", ".join(sorted(mesh.cells_dict)) or "none"
        raise CaseError(f"mesh.file: {path}: expected line cells, found: {kinds}")
    tags = [
        values["line"]
        for values in mesh.cell_data_dict.values()
        if "line" in values and len(np.unique(values["line"])) == len(names)
    ]
    if not tags:
        raise CaseError(
            f"mesh.file: {path}: expected the lines in {_COUNTS.get(len(names), len(names))} "
            f"physical groups named {' and '.join(map(repr, names))}"
        )
    tag = tags[0]
    if set(names) <= set(mesh.field_data):
        numbers = [int(mesh.field_data[name][0]) for name in names]
    else:
        numbers = sorted(int(t) for t in np.unique(tag))
    x = np.asarray(mesh.points[:, 0], dtype=np.float64)
    if not np.all(np.isfinite(x)):
        raise CaseError(f"mesh.file: {path}: expected finite coordinates")
    if lines.min(initial=0) < 0 or lines.max(initial=-1) >= len(x):
        raise CaseError(f"mesh.file: {path}: a line ends at a node that does not exist")
    return [(x, np.asarray(lines[tag == number], dtype=np.int64)) for number in numbers]


def _lamina_nodes(path: Path, x: FloatArray, cells: IntArray, length: float) -> FloatArray:
    """Return the sorted node coordinates of one lamina; check that its cells form one line."""
    nodes = np.unique(cells)
    order = nodes[np.argsort(x[nodes])]
    place = np.full(len(x), -1)
    place[order] = np.arange(len(order))
    steps = np.sort(np.sort(place[cells], axis=1), axis=0)
    chain = np.column_stack([np.arange(len(order) - 1), np.arange(1, len(order))])
    if steps.shape != chain.shape or not np.array_equal(steps, chain):
        raise CaseError(f"mesh.file: {path}: the lines of a lamina do not form one chain along x")
    result = x[order]
    if not np.all(np.diff(result) > 0.0):
        raise CaseError(f"mesh.file: {path}: two nodes of a lamina have the same x")
    tolerance = NODE_TOLERANCE * length
    if abs(result[0]) > tolerance or abs(result[-1] - length) > tolerance:
        raise CaseError(
            f"mesh.file: {path}: expected nodes from x = 0 to lamina.length = {length:g} m, "
            f"given {result[0]:g} to {result[-1]:g} m"
        )
    result[0] = 0.0
    result[-1] = length
    return result
