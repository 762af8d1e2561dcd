"""Make the mesh of solids: the structured mesh of a case, or the user's own file.

The structured mesh of a case has quadrilaterals or hexahedra in rows along each lamina. Along x the
vertices are those of `mesh.elements`, with one at every edge of a delamination. Each lamina has
`model.layers` cells through its thickness, or through each of its layers of plies, and, in 3D,
`model.strips` across its width. Bonded laminae share their vertices. Over a delamination each has
its own; the vertices at its edges are shared.

A plate has `mesh.across` cells across its width in place of strips, with vertices at the edges of
patches along both axes. A patch that is an ellipse is a rectangle of cells whose outline is moved
to the ellipse; the vertices around follow as a soap film does.

In a file, physical groups say what is what: one for each lamina (its name) with its cells; "start"
and "end" with the facets of the ends that are held; "LOWER-UPPER lower" and "LOWER-UPPER upper"
with the facets of the two sides of each interface where laminae are apart.
"""

from __future__ import annotations

import logging
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import spsolve

from delam_fem.case.definition import Case
from delam_fem.case.sections import ENDS, ON_EDGE, Lamina, z_of
from delam_fem.model.layout import half_ways
from delam_fem.model.mesh import (
    NODE_TOLERANCE,
    coordinates_across,
    node_coordinates,
    read_file,
)
from delam_fem.model.solids.mesh import (
    FACETS,
    TENSOR,
    VERTICES,
    Facing,
    SolidMesh,
    jacobians_of,
    volumes,
)
from delam_fem.numerics.types import BoolArray, FloatArray, IntArray
from delam_fem.system.errors import CaseError

MOST_DOFS = 4_000_000
"""Largest number of dofs: factors of a mesh in three dimensions then take some 30 GB."""


def lattice(case: Case) -> SolidMesh:
    """Return the structured mesh of a case.

    Raises:
        CaseError: bonded laminae have different widths in 3D, or the mesh is too large.
    """
    x = node_coordinates(case)
    is_3d = case.model.kind == "solid"
    across = None if case.mesh.across is None else coordinates_across(case)
    _require_size(case, x.size - 1, is_3d=is_3d)
    bonded = bonded_cells(case, x, across)
    if is_3d and across is None:
        for i, (lower, upper) in enumerate(pairwise(case.lamina)):
            if bonded[i].any() and lower.width != upper.width:
                raise CaseError(
                    f"lamina.{upper.name}.width: expected the width {_said(lower.width)} of lamina "
                    f"{lower.name}, to which it is bonded, given {_said(upper.width)}; give the "
                    "model your own mesh in mesh.file"
                )
    for lamina in case.lamina:
        for key in ("width",) if not is_3d else ():
            if key in lamina.profiles:
                raise CaseError(
                    f"lamina.{lamina.name}.{key}: expected a number with model.kind = "
                    '"plane-stress", given a table; take "solid"'
                )
        if any(profile.steps for profile in lamina.profiles.values()):
            _require_no_step(lamina)
    vertices = _vertices(case, bonded, is_3d=is_3d)
    points = np.empty((1 + max(int(grid.max()) for grid in vertices), 3 if is_3d else 2))
    plan = None if across is None else _plan(case, x, across)
    X = x[:, None] if plan is None else plan[0]
    bottom = np.zeros(X.shape)
    if any("thickness" in lamina.profiles for lamina in case.lamina):  # the middle stays straight
        heights = np.sum([lamina.along("thickness", X) for lamina in case.lamina], axis=0)
        bottom = 0.5 * (heights[0] - heights)
    for lamina, grid in zip(case.lamina, vertices, strict=True):
        thickness = lamina.along("thickness", X)
        width = lamina.along("width", x)
        y = bottom[:, None] + heights_of(case, lamina)[:, None] * thickness[:, None]
        bottom = bottom + thickness
        z = np.zeros((x.size, 1))
        if is_3d:
            z = np.linspace(-0.5 * width, 0.5 * width, grid.shape[2], axis=1)
        if plan is not None:
            z = plan[1]
        axes = np.broadcast_arrays(X[:, None, :], y, z[:, None, :])
        points[grid.ravel()] = np.column_stack([axis.ravel() for axis in axes[: points.shape[1]]])
    cells = [_cells(grid) for grid in vertices]
    places: dict[str, tuple[int | slice, ...]] = {"start": (0,), "end": (-1,)}
    if across is not None:
        every = slice(None)
        places |= {"left": (every, every, 0), "right": (every, every, -1)}
    return SolidMesh(
        points,
        np.concatenate(cells),
        "hexahedron" if is_3d else "quadrilateral",
        np.repeat(np.arange(len(cells)), [len(lamina_cells) for lamina_cells in cells]),
        {
            name: np.concatenate([_facets(grid[place]) for grid in vertices])
            for name, place in places.items()
        },
        _sides(vertices, bonded),
    )


def cells_through(case: Case, lamina: Lamina) -> int:
    """Return the number of cells through the thickness of a lamina in the structured mesh."""
    return case.model.layers * len(lamina.layers)


def heights_of(case: Case, lamina: Lamina) -> FloatArray:
    """Return the heights of the vertices of a lamina in the structured mesh, in its thickness."""
    ends = np.cumsum([0.0, *(share for _, share in lamina.layers)])
    ends[-1] = 1.0
    within = np.linspace(0.0, 1.0, case.model.layers + 1)[:-1]
    starts = ends[:-1, None] + within * np.diff(ends)[:, None]
    return np.append(starts.ravel(), 1.0)


def layers_of_cells(case: Case, mesh: SolidMesh, i: int) -> IntArray:
    """Return the layer of plies in which each cell of a lamina is, shape (n,).

    Args:
        case: the case.
        mesh: its mesh.
        i: number of the lamina.

    Raises:
        CaseError: cells of a mesh from a file lie in several layers.
    """
    lamina = case.lamina[i]
    cells = mesh.cells[mesh.lamina == i]
    if case.mesh.file is None:  # cells count upwards within a place along x, see `_cells`
        n_across = (case.mesh.across or case.model.strips) if mesh.dim == 3 else 1
        upwards = np.arange(len(cells)) // n_across % cells_through(case, lamina)
        return np.asarray(upwards // case.model.layers)
    if len(lamina.layers) == 1:
        return np.zeros(len(cells), dtype=np.int64)
    y = mesh.points[cells][..., 1]
    heights = (y - y.min()) / np.ptp(y)
    ends = np.cumsum([share for _, share in lamina.layers])
    starts = np.concatenate([[0.0], ends[:-1]])
    layer = np.searchsorted(ends[:-1], heights.mean(axis=1))
    below = starts[layer] - heights.min(axis=1)
    above = heights.max(axis=1) - ends[layer]
    if max(below.max(), above.max()) > THICKNESS_TOLERANCE:
        raise CaseError(
            f"lamina.{lamina.name}.plies: expected faces of cells between the plies of a flat "
            "lamina in mesh.file; give each ply a lamina of its own, or such a mesh"
        )
    return np.asarray(layer, dtype=np.int64)


def _plan(case: Case, x: FloatArray, across: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return x and z of the vertices of a plate, with outlines moved to the ellipses of patches.

    The polygon of an outline has the area of its ellipse. The displacement of the other vertices
    fulfils Laplace's equation on the grid. It is 0 at the edges of the plate, on the outlines of
    rectangles, and where a support or a table needs a straight line.

    Args:
        case: the case.
        x: lines of the grid along x, shape (n,) [m].
        across: its lines across, shape (m,) [m].

    Returns:
        Shape (n, m) each [m].

    Raises:
        CaseError: an ellipse reaches an edge of the plate or the outline of another patch, or a
            cell would be folded.
    """
    X, Z = (np.array(grid) for grid in np.meshgrid(x, across, indexing="ij"))
    if not any(patch.is_ellipse for patch in case.delamination):
        return X, Z
    is_given = np.zeros(X.shape, dtype=np.bool_)
    is_given[[0, -1]] = True
    is_given[:, [0, -1]] = True
    straight = {support.x for support in case.support.held}
    for place in straight | {place for lamina in case.lamina for place in lamina.breaks}:
        is_given[np.argmin(np.abs(x - place))] = True
    for pin in case.support.pins:
        away = np.hypot(X - pin.x, Z - z_of(pin.position or 0.0))
        is_given[np.unravel_index(np.argmin(away), X.shape)] = True
    shift = np.zeros((2, *X.shape))
    for number, patch in enumerate(case.delamination, start=1):
        along, over = patch.local(X, Z)
        outline = np.abs(np.maximum(np.abs(along), np.abs(over)) - 1.0) < ON_EDGE
        moved = np.zeros((2, *X.shape))
        if patch.is_ellipse:
            # a point of the square goes to the angle that its place on its side gives
            first = np.abs(along) >= np.abs(over)
            angle = np.where(first, over * np.sign(along), along * np.sign(over)) * np.pi / 4.0
            circle = np.where(
                first,
                np.sign(along) * np.stack([np.cos(angle), np.sin(angle)]),
                np.sign(over) * np.stack([np.sin(angle), np.cos(angle)]),
            )
            # the polygon gets the area of the ellipse; each of its four sides spans 90 degrees
            lines = (along[:, 0], over[0])
            angles = [at[np.abs(at) <= 1.0 + ON_EDGE] * np.pi / 4.0 for at in lines]
            area = sum(float(np.sin(np.diff(side)).sum()) for side in angles)
            circle *= np.sqrt(np.pi / area)
            low, high = patch.across or (0.0, 0.0)
            halves = 0.5 * (patch.end - patch.start), 0.5 * (high - low)
            moved = np.stack([(circle[k] - (along, over)[k]) * halves[k] for k in (0, 1)])
        meets = outline & is_given
        if np.any(np.abs(moved - shift)[:, meets] > NODE_TOLERANCE * case.length):
            raise CaseError(
                f"delamination.{number}.shape_in_plane: expected an ellipse whose outline meets no "
                "edge of the plate and no outline of another patch; take a rectangle, or your own "
                "mesh in mesh.file"
            )
        shift[:, outline] = moved[:, outline]
        is_given |= outline
    X, Z = np.stack([X, Z]) + _film(x, across, shift, is_given)
    corners = np.stack([X, Z], axis=-1)
    cells = np.stack(
        [corners[:-1, :-1], corners[1:, :-1], corners[:-1, 1:], corners[1:, 1:]], axis=2
    ).reshape(-1, 4, 2)
    for at in np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]]):
        size = np.linalg.det(jacobians_of("quadrilateral", cells, np.tile(at, (len(cells), 1))))
        if size.min() <= _FOLDED * float(np.median(size)):
            raise CaseError(
                "mesh.elements: expected cells fine enough to follow the ellipses of delaminations "
                f"without folds, given {x.size - 1} along and {across.size - 1} across; take more, "
                "or patches farther from one another, or your own mesh in mesh.file"
            )
    return X, Z


_FOLDED = 1e-3
"""Jacobian at a corner of a cell of a plate, over the median, below which the cell is folded."""


def _film(x: FloatArray, across: FloatArray, given: FloatArray, is_given: BoolArray) -> FloatArray:
    """Return the solution of Laplace's equation on a grid with some values given.

    Args:
        x: lines of the grid, shape (n,) [m].
        across: its other lines, shape (m,) [m].
        given: values, shape (k, n, m).
        is_given: where they are given, shape (n, m).
    """
    operators = []
    for at in (x, across):
        D = sp.diags([-1.0 / np.diff(at), 1.0 / np.diff(at)], [0, 1], (at.size - 1, at.size))
        operators.append((D.T @ sp.diags(np.diff(at)) @ D, sp.diags(half_ways(at))))
    (Kx, Mx), (Kz, Mz) = operators
    K = sp.csr_matrix(sp.kron(Kx, Mz) + sp.kron(Mx, Kz))
    free = np.flatnonzero(~is_given.ravel())
    fixed = np.flatnonzero(is_given.ravel())
    result = given.reshape(len(given), -1).copy()
    if free.size:
        load = -(K[free][:, fixed] @ result[:, fixed].T)
        result[:, free] = spsolve(sp.csc_matrix(K[free][:, free]), load).reshape(free.size, -1).T
    return result.reshape(given.shape)


def _said(width: object) -> str:
    """Return a width as a message shows it."""
    return repr(width) if isinstance(width, float) else "a table"


def _require_no_step(lamina: Lamina) -> None:
    """Refuse a step of thickness or width, which a structured mesh cannot follow.

    Raises:
        CaseError: the lamina has one.
    """
    for key in ("thickness", "width"):
        profile = lamina.profiles.get(key)
        if profile is not None and profile.steps:
            raise CaseError(
                f"lamina.{lamina.name}.{key}: expected a table without steps with laminae as "
                "solids, whose built-in mesh has no corners; give two places near one another, or "
                "your own mesh in mesh.file"
            )


def bonded_cells(case: Case, x: FloatArray, across: FloatArray | None = None) -> BoolArray:
    """Return where neighbouring laminae are bonded, (n_laminae - 1, n_nodes - 1, n_across).

    Args:
        case: the case.
        x: positions of the nodes, one at every edge of a delamination [m].
        across: lines of the vertices of a plate across its width [m]; None: all strips are alike.
    """
    lines = np.zeros(2) if across is None else across
    middles = (0.5 * (at[1:] + at[:-1]) for at in (x, lines))
    X, Z = np.meshgrid(*middles, indexing="ij")
    count = case.model.strips if across is None and case.model.kind == "solid" else X.shape[1]
    names = [lamina.name for lamina in case.lamina]
    bonded = np.full((len(names) - 1, x.size - 1, count), not case.is_apart)
    for delamination in case.delamination:
        along, over = delamination.local(X, Z)
        is_open = (np.abs(along) < 1.0) & (np.abs(over) < 1.0)
        bonded[names.index(delamination.between[0])] &= ~is_open
    return bonded


def _require_size(case: Case, n: int, *, is_3d: bool) -> None:
    """Check the number of dofs before anything is allocated.

    Raises:
        CaseError: there are more than `MOST_DOFS`.
    """
    p = case.model.degree
    model = case.model
    n_across = case.mesh.across or model.strips
    across = (p * n_across + 1) * 3 if is_3d else 2
    through = sum(p * cells_through(case, lamina) + 1 for lamina in case.lamina)
    dofs = through * (p * n + 1) * across
    if dofs > MOST_DOFS:
        strips = f", model.strips = {model.strips}" if is_3d else ""
        if case.mesh.across is not None:
            strips = f", mesh.across = {case.mesh.across}"
        raise CaseError(
            f"mesh.elements: expected at most {MOST_DOFS} unknowns, given about {dofs} from "
            f"{n} cells along x, model.layers = {model.layers}{strips}, model.degree = {p}"
        )


def _vertices(case: Case, bonded: BoolArray, *, is_3d: bool) -> list[IntArray]:
    """Return the vertices of each lamina along x, y, z: shape (n, layers + 1, strips + 1 or 1)."""
    _, n, n_across = bonded.shape
    result: list[IntArray] = []
    count = 0
    for i, lamina in enumerate(case.lamina):
        shape = (n + 1, cells_through(case, lamina) + 1, n_across + 1 if is_3d else 1)
        is_shared = np.zeros(shape, dtype=np.bool_)
        if i > 0:  # a vertex is shared if a cell beside it is bonded
            before = slice(None, -1)
            behind = slice(1, None)
            for along in (before, behind):
                for across in (before, behind) if is_3d else (slice(None),):
                    is_shared[along, 0, across] |= bonded[i - 1]
        grid = np.empty(shape, dtype=np.int64)
        grid[~is_shared] = count + np.arange(np.count_nonzero(~is_shared))
        count += int(np.count_nonzero(~is_shared))
        if i > 0:
            grid[:, 0] = np.where(is_shared[:, 0], result[-1][:, -1], grid[:, 0])
        result.append(grid)
    return result


def _cells(vertices: IntArray) -> IntArray:
    """Return the cells of a lamina in tensor order, along x last, shape (n_cells, 4 or 8)."""
    depth = (0,) if vertices.shape[2] == 1 else (0, 1)
    nx, ny, nz = (max(size - 1, 1) for size in vertices.shape)
    corners = [
        vertices[a : a + nx, b : b + ny, c : c + nz].ravel()
        for c in depth
        for b in (0, 1)
        for a in (0, 1)
    ]
    return np.column_stack(corners)


def _facets(surface: IntArray) -> IntArray:
    """Return the facets of a surface of vertices, shape (n, m): segments or quadrilaterals."""
    if surface.shape[1] == 1:
        return np.column_stack([surface[:-1, 0], surface[1:, 0]])
    corners = (surface[:-1, :-1], surface[1:, :-1], surface[:-1, 1:], surface[1:, 1:])
    return np.column_stack([corner.ravel() for corner in corners])


def _sides(vertices: list[IntArray], bonded: BoolArray) -> tuple[Facing, ...]:
    """Return the surfaces that face one another, of the cells that are not bonded."""
    sides = []
    for i, is_bonded in enumerate(bonded):
        if is_bonded.all():
            continue
        is_open = ~is_bonded.ravel()
        lower = _facets(vertices[i][:, -1])
        upper = _facets(vertices[i + 1][:, 0])
        sides.append(Facing((i, i + 1), lower[is_open], upper[is_open]))
    return tuple(sides)


_KINDS = {
    "triangle": (("triangle", "triangle6"), ("line", "line3")),
    "quadrilateral": (("quad", "quad8", "quad9"), ("line", "line3")),
    "tetrahedron": (("tetra", "tetra10"), ("triangle", "triangle6")),
    "hexahedron": (("hexahedron", "hexahedron20", "hexahedron27"), ("quad", "quad8", "quad9")),
}
"""Names in meshio of cells and of their facets; cells of second order give their vertices."""
_OF_KIND = {"plane-stress": ("triangle", "quadrilateral"), "solid": ("tetrahedron", "hexahedron")}
_ORDER = {"quadrilateral": [0, 1, 3, 2], "hexahedron": [0, 1, 3, 2, 4, 5, 7, 6]}
"""Vertices of gmsh in the order of dolfinx."""
SAMPLES = 1001
"""Places at which the section of a lamina is summed."""
THICKNESS_TOLERANCE = 0.01
"""Relative deviation of volume or area from the case above which the user is told."""
_FLAT = 1e-9
"""Smallest Jacobian of a cell, relative to the cube of its size, in two dimensions the square."""
_log = logging.getLogger(__name__)


def solid_mesh(case: Case) -> SolidMesh:
    """Read the mesh of a case from its file.

    The bottom of the laminae is moved to y = 0 and the middle of the width to z = 0.

    Args:
        case: `mesh.file` names the file; model, laminae, supports and delaminations say what it
            must have.

    Raises:
        CaseError: the file cannot be read; it lacks a group, which the message names; it has cells
            of another dimension, of two kinds, or turned inside out in part; it does not fit the
            case.
    """
    assert case.mesh.file is not None
    path = Path(case.mesh.file)
    try:
        return _Reader(case, path, read_file(path, case.mesh.unit)).mesh()
    except ValueError as error:
        if isinstance(error, CaseError):
            raise
        raise CaseError(f"mesh.file: {path}: {error}") from error


def cells_along(case: Case, mesh: SolidMesh) -> int:
    """Return the length of the laminae over the mean length of cells along them, rounded."""
    return round(case.length / float(np.mean(np.ptp(mesh.points[mesh.cells][..., 0], axis=1))))


class _Reader:
    """The reader of one mesh file.

    Attributes:
        case: the case.
        path: the file.
        given: what meshio read.
        cell: kind of its cells.
    """

    def __init__(self, case: Case, path: Path, given: Any) -> None:
        self.case = case
        self.path = path
        self.given = given
        wanted = _OF_KIND[self.case.model.kind]
        has = {block.type for block in self.given.cells if len(block.data)}
        kinds = [cell for cell in wanted if has & {*_KINDS[cell][0]}]
        if len(kinds) != 1:
            raise self._error(
                f"expected cells of one kind, {wanted[0]}s or {wanted[1]}s, for model.kind = "
                f'"{self.case.model.kind}", found: {", ".join(sorted(has)) or "none"}'
            )
        self.cell = kinds[0]

    def mesh(self) -> SolidMesh:
        """Return the mesh; see `solid_mesh`."""
        if self.case.contact.points_per_element != 1:
            raise CaseError(
                "contact.points_per_element: expected 1 with solids from a mesh.file, whose pairs "
                f"are at vertices, given {self.case.contact.points_per_element}"
            )
        laminae = [
            self._group(lamina.name, _KINDS[self.cell][0], VERTICES[self.cell])
            for lamina in self.case.lamina
        ]
        cells = np.concatenate(laminae)
        lamina = np.repeat(np.arange(len(laminae)), [len(lamina_cells) for lamina_cells in laminae])
        self._require_size(len(cells))
        if len(np.unique(np.sort(cells, axis=1), axis=0)) < len(cells):
            raise self._error("expected each cell in the group of one lamina, one is in two")
        used, number = np.unique(cells, return_inverse=True)
        cells = np.asarray(number).reshape(cells.shape)
        points = self._points(used)
        cells = self._oriented(points, cells[:, _ORDER.get(self.cell, slice(None))])
        low = float(points[:, 0].min())
        high = float(points[:, 0].max())
        length = self.case.length
        if max(abs(low), abs(high - length)) > NODE_TOLERANCE * length:
            raise self._error(
                f"expected laminae from x = 0 to lamina.length = {length:g} m, given {low:g} to "
                f"{high:g} m"
            )
        plain = SolidMesh(points, cells, self.cell, lamina)
        place = np.full(len(self.given.points), -1, dtype=np.int64)
        place[used] = np.arange(len(used))
        support = self.case.support
        supports: dict[str, IntArray] = {
            side: self._facets(plain, place, side, None)
            for side in support.sides
            if support.holds(side) or (self.case.is_plate and support.kind(side) == "spring")
        }
        between = {delamination.between for delamination in self.case.delamination}
        sides = tuple(
            self._sides(plain, place, k)
            for k, (lower, upper) in enumerate(pairwise(self.case.lamina))
            if self.case.gap is not None or (lower.name, upper.name) in between
        )
        mesh = SolidMesh(points, cells, self.cell, lamina, supports, sides)
        self._require_support(mesh)
        self._compare(mesh)
        return mesh

    def _error(self, text: str) -> CaseError:
        return CaseError(f"mesh.file: {self.path}: {text}")

    def _require_size(self, n_cells: int) -> None:
        """Check that the unknowns are not too many."""
        p = self.case.model.degree
        dim = 2 if self.case.model.kind == "plane-stress" else 3
        of_brick = 1 if self.cell in TENSOR else {2: 2, 3: 5}[dim]
        dofs = n_cells * dim * p**dim // of_brick
        if dofs > MOST_DOFS:
            raise self._error(
                f"expected at most {MOST_DOFS} unknowns, given about {dofs} from {n_cells} cells "
                f"and model.degree = {p}"
            )

    def _group(self, name: str, types: tuple[str, ...], n_vertices: int) -> IntArray:
        """Return the vertices of the cells or facets of a group, shape (n, n_vertices)."""
        names = sorted(self.given.field_data)
        if name not in names:
            listed = ", ".join(map(repr, names)) or "none"
            raise self._error(
                f"expected a physical group {name!r} of {types[0]} cells, found the groups: "
                f"{listed}" + (f'; without one, give support.{name} = "free"' * (name in ENDS))
            )
        blocks = [
            np.asarray(block.data[chosen], dtype=np.int64)[:, :n_vertices]
            for block, chosen in zip(self.given.cells, self._members(name), strict=True)
            if block.type in types
        ]
        cells = np.concatenate([np.zeros((0, n_vertices), dtype=np.int64), *blocks])
        if len(cells) == 0:
            raise self._error(
                f"expected {types[0]} cells in the physical group {name!r}, found none"
            )
        if cells.min() < 0 or cells.max() >= len(self.given.points):
            raise self._error(f"a cell of the group {name!r} has a vertex that does not exist")
        return np.asarray(cells)

    def _members(self, name: str) -> list[Any]:
        """Return the members of a group in each block of cells."""
        sets = self.given.cell_sets.get(name)
        if sets is not None:
            nothing = np.zeros(0, dtype=np.int64)
            return [
                nothing if members is None else np.asarray(members, dtype=np.int64)
                for members in sets
            ]
        tag = int(self.given.field_data[name][0])
        tags = self.given.cell_data.get("gmsh:physical")
        if tags is None:
            raise self._error("expected physical groups, the cells have none")
        return [np.flatnonzero(np.asarray(block_tags) == tag) for block_tags in tags]

    def _points(self, used: IntArray) -> FloatArray:
        """Return the coordinates of vertices, with the bottom at y = 0 and centred across."""
        points = np.asarray(self.given.points, dtype=np.float64)[used]
        if not np.all(np.isfinite(points)):
            raise self._error("expected finite coordinates")
        if self.cell in ("triangle", "quadrilateral") and points.shape[1] == 3:
            if np.ptp(points[:, 2]) > NODE_TOLERANCE * self.case.length:
                raise self._error(
                    f"expected a mesh in the plane of x and y, z runs from {points[:, 2].min():g} "
                    f"to {points[:, 2].max():g} m"
                )
            points = points[:, :2]
        points = points - np.array([0.0, points[:, 1].min(), 0.0])[: points.shape[1]]
        if points.shape[1] == 3:
            points[:, 2] -= 0.5 * (points[:, 2].min() + points[:, 2].max())
        return np.asarray(points)

    def _oriented(self, points: FloatArray, cells: IntArray) -> IntArray:
        """Return the cells with positive Jacobians; turn those that are inside out."""
        dim = points.shape[1]
        corners = np.eye(dim + 1, dim, -1)
        if self.cell in TENSOR:
            corners = (np.arange(2**dim)[:, None] >> np.arange(dim)) & 1
        vertices = points[cells]
        size = np.linalg.norm(np.ptp(vertices, axis=1), axis=1)
        determinants = np.stack([
            np.linalg.det(jacobians_of(self.cell, vertices, np.tile(X, (len(cells), 1))))
            for X in corners.astype(np.float64)
        ])  # fmt: skip
        mixed = ~(np.all(determinants > 0.0, axis=0) | np.all(determinants < 0.0, axis=0))
        flat = np.abs(determinants).min(axis=0) <= _FLAT * size**dim
        if np.any(mixed | flat):
            worst = int(np.flatnonzero(mixed | flat)[0])
            at = ", ".join(f"{value:g}" for value in vertices[worst].mean(axis=0))
            raise self._error(
                f"expected convex cells with a volume, the {self.cell} about ({at}) m is "
                f"{'flat' if flat[worst] else 'folded'}"
            )
        # a cell is turned by exchanging its vertices along the first axis, or the last two vertices
        turned = np.arange(cells.shape[1])
        turned = turned ^ 1 if self.cell in TENSOR else np.append(turned[:-2], turned[:-3:-1])
        return np.where((determinants[0] < 0.0)[:, None], cells[:, turned], cells)

    def _sides(self, mesh: SolidMesh, place: IntArray, lower: int) -> Facing:
        """Return the sides of an interface, checked against the delaminations of the case."""
        names = (self.case.lamina[lower].name, self.case.lamina[lower + 1].name)
        sides = [
            self._facets(mesh, place, f"{names[0]}-{names[1]} {side}", lower + k)
            for k, side in enumerate(("lower", "upper"))
        ]
        delaminations = [d for d in self.case.delamination if d.between == names]
        if delaminations:
            reach = mesh.points[np.concatenate(sides).ravel(), 0]
            expected = min(d.start for d in delaminations), max(d.end for d in delaminations)
            extent = float(reach.min()), float(reach.max())
            if max(abs(a - b) for a, b in zip(expected, extent, strict=True)) > (
                NODE_TOLERANCE * self.case.length
            ):
                raise self._error(
                    f"expected the sides of {names[0]}-{names[1]} to reach from "
                    f"{expected[0]:g} to {expected[1]:g} m like the delaminations of the case, "
                    f"given {extent[0]:g} to {extent[1]:g} m"
                )
        heights = [
            float(mesh.points[mesh.cells[mesh.lamina == lower + k], 1].mean()) for k in (0, 1)
        ]
        if heights[0] >= heights[1]:
            raise self._error(
                f"expected lamina {names[0]!r} below lamina {names[1]!r}, as in the case"
            )
        return Facing((lower, lower + 1), sides[0], sides[1])

    def _facets(self, mesh: SolidMesh, place: IntArray, name: str, lamina: int | None) -> IntArray:
        """Return the facets of a group as vertices of the mesh, checked against its cells.

        Args:
            mesh: the cells.
            place: vertex of the mesh of each node of the file, or -1.
            name: of the group.
            lamina: the lamina whose facets they must be; None: of any.
        """
        facets = place[self._group(name, _KINDS[self.cell][1], len(FACETS[self.cell][0]))]
        if self.cell == "hexahedron":
            facets = facets[:, _ORDER["quadrilateral"]]
        if np.any(facets < 0):
            raise self._error(f"a facet of the group {name!r} is on no cell of a lamina")
        try:
            cells, _ = mesh.cells_with(facets)
        except ValueError as error:
            raise self._error(
                f"expected facets on the boundary of the laminae in the group {name!r}; {error}"
            ) from error
        if lamina is not None and np.any(mesh.lamina[cells] != lamina):
            raise self._error(
                f"expected facets of the lamina {self.case.lamina[lamina].name!r} alone in the "
                f"group {name!r}; are lower and upper exchanged?"
            )
        return facets

    def _require_support(self, mesh: SolidMesh) -> None:
        """Check that every separate body is held, if any is."""
        if not mesh.supports:
            return
        supported, _ = mesh.cells_with(np.concatenate([*mesh.supports.values()]))
        loose = np.setdiff1d(mesh.bodies, mesh.bodies[supported])
        if loose.size:
            cell = int(np.flatnonzero(mesh.bodies == loose[0])[0])
            name = self.case.lamina[int(mesh.lamina[cell])].name
            raise self._error(
                f"expected every body to have a facet in the groups "
                f"{' or '.join(map(repr, mesh.supports))}, one of lamina {name!r} has none; do "
                "bonded parts share their nodes?"
            )

    def _compare(self, mesh: SolidMesh) -> None:
        """Warn if the volume of a lamina, in 2D its area, differs from that of the case."""
        measures = np.abs(volumes(mesh))
        for number, lamina in enumerate(self.case.lamina):
            x = np.linspace(0.0, lamina.length, SAMPLES)
            sections = lamina.along("thickness", x)
            if mesh.dim == 3:
                sections = sections * lamina.along("width", x)
            middles = 0.5 * (sections[1:] + sections[:-1])
            expected = lamina.length * float(middles.mean())
            if lamina.is_uniform:
                expected = lamina.length * float(sections[0])
            ratio = float(measures[mesh.lamina == number].sum()) / expected
            if abs(ratio - 1.0) > THICKNESS_TOLERANCE:
                _log.warning(
                    "mesh.file: %s: the %s of lamina %r is %.3g times that of the case; its "
                    "stiffness and mass follow the mesh, with E and density of the case",
                    self.path,
                    "volume" if mesh.dim == 3 else "area",
                    lamina.name,
                    ratio,
                )
