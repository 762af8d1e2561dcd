"""The structured mesh of a case: quadrilaterals or hexahedra in rows along each lamina.

Along x the vertices are those of `mesh.elements`, with one at every edge of a delamination. Each
lamina has `model.layers` cells through its thickness and, in 3D, `model.strips` across its width.
Bonded laminae share their vertices. Over a delamination each has its own; the vertices at its edges
are shared.
"""

from __future__ import annotations

import numpy as np

from delam_fem.case.definition import Case
from delam_fem.case.toml import CaseError
from delam_fem.model.mesh import node_coordinates
from delam_fem.model.solids.mesh import Facing, SolidMesh
from delam_fem.numerics.arrays import BoolArray, FloatArray, IntArray

MOST_DOFS = 4_000_000
"""Largest number of dofs: factors of a mesh in three dimensions then take some 30 GB."""


def lattice(case: Case) -> SolidMesh:
    """Return the structured mesh of a case.

    Raises:
        CaseError: bonded laminae have different widths in 3D, or the mesh is too large.
    """
    x = node_coordinates(case)
    is_3d = case.model.kind == "solid"
    _require_size(case, x.size - 1, is_3d=is_3d)
    bonded = bonded_cells(case, x)
    if is_3d:
        _require_widths(case, bonded)
    vertices = _vertices(case, x.size, bonded, is_3d=is_3d)
    n_points = 1 + max(int(own.max()) for own in vertices)
    points = np.empty((n_points, 3 if is_3d else 2))
    bottom = 0.0
    for lamina, own in zip(case.lamina, vertices, strict=True):
        y = bottom + np.linspace(0.0, lamina.thickness, own.shape[1])
        bottom += lamina.thickness
        z = np.linspace(-0.5 * lamina.width, 0.5 * lamina.width, own.shape[2])
        axes = np.meshgrid(x, y, z if is_3d else np.zeros(1), indexing="ij")
        points[own.ravel()] = np.column_stack([axis.ravel() for axis in axes[: points.shape[1]]])
    cells = [_cells(own) for own in vertices]
    return SolidMesh(
        points,
        np.concatenate(cells),
        "hexahedron" if is_3d else "quadrilateral",
        np.repeat(np.arange(len(cells)), [len(own) for own in cells]),
        {name: _ends(vertices, end) for name, end in (("start", 0), ("end", -1))},
        _sides(vertices, bonded),
    )


def bonded_cells(case: Case, x: FloatArray) -> BoolArray:
    """Return where neighbouring laminae are bonded, shape (n_laminae - 1, n_nodes - 1).

    Args:
        case: the case.
        x: positions of the nodes, one at every edge of a delamination [m].
    """
    middle = 0.5 * (x[1:] + x[:-1])
    names = [lamina.name for lamina in case.lamina]
    bonded = np.full((len(names) - 1, middle.size), not case.is_apart)
    for own in case.delamination:
        bonded[names.index(own.between[0]), (middle > own.start) & (middle < own.end)] = False
    return bonded


def _require_size(case: Case, n: int, *, is_3d: bool) -> None:
    """Check the number of dofs before anything is allocated.

    Raises:
        CaseError: there are more than `MOST_DOFS`.
    """
    p, model = case.model.degree, case.model
    across = (p * model.strips + 1) * 3 if is_3d else 2
    dofs = len(case.lamina) * (p * n + 1) * (p * model.layers + 1) * across
    if dofs > MOST_DOFS:
        strips = f", model.strips = {model.strips}" if is_3d else ""
        raise CaseError(
            f"mesh.elements: expected at most {MOST_DOFS} unknowns, given about {dofs} from "
            f"{n} cells along x, model.layers = {model.layers}{strips}, model.degree = {p}"
        )


def _require_widths(case: Case, bonded: BoolArray) -> None:
    """Check that bonded laminae have the same width, so that their vertices meet.

    Raises:
        CaseError: they have not.
    """
    for i, lower in enumerate(case.lamina[:-1]):
        upper = case.lamina[i + 1]
        if bonded[i].any() and lower.width != upper.width:
            raise CaseError(
                f"lamina.{upper.name}.width: expected the width {lower.width!r} of lamina "
                f"{lower.name}, to which it is bonded, given {upper.width!r}; give the model your "
                "own mesh in mesh.file"
            )


def _vertices(case: Case, n: int, bonded: BoolArray, *, is_3d: bool) -> list[IntArray]:
    """Return the vertices of each lamina, shape (n, layers + 1, strips + 1), or 1 in 2D."""
    shape = (n, case.model.layers + 1, case.model.strips + 1 if is_3d else 1)
    result: list[IntArray] = []
    count = 0
    for i in range(len(case.lamina)):
        is_shared = np.zeros(shape, dtype=np.bool_)
        if i > 0:  # a vertex is shared if a cell beside it is bonded
            is_shared[1:, 0] |= bonded[i - 1][:, None]
            is_shared[:-1, 0] |= bonded[i - 1][:, None]
        own = np.empty(shape, dtype=np.int64)
        own[~is_shared] = count + np.arange(np.count_nonzero(~is_shared))
        count += int(np.count_nonzero(~is_shared))
        if i > 0:
            own[:, 0] = np.where(is_shared[:, 0], result[-1][:, -1], own[:, 0])
        result.append(own)
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


def _ends(vertices: list[IntArray], end: int) -> IntArray:
    """Return the facets of all laminae at an end."""
    return np.concatenate([_facets(own[end]) for own in vertices])


def _sides(vertices: list[IntArray], bonded: BoolArray) -> tuple[Facing, ...]:
    """Return the surfaces that face one another, of the cells that are not bonded."""
    sides = []
    for i, is_bonded in enumerate(bonded):
        if is_bonded.all():
            continue
        strips = max(vertices[i].shape[2] - 1, 1)
        is_open = np.repeat(~is_bonded, strips)
        lower, upper = _facets(vertices[i][:, -1]), _facets(vertices[i + 1][:, 0])
        sides.append(Facing((i, i + 1), lower[is_open], upper[is_open]))
    return tuple(sides)
