"""What stands for a solid lamina: deflection and slope of its middle line, as of a beam.

The middle line lies at half of the height and half of the width. Reading 2 (p n + k) is the
deflection u_y of part p at its point k, of n points; the next one is the slope ∂u_y/∂x there.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from delam_fem.case.definition import Case
from delam_fem.case.toml import CaseError
from delam_fem.model.layout import Part, Reading
from delam_fem.model.mesh import edges, placed
from delam_fem.model.solids.cells import FACET_OF, locate, meetings
from delam_fem.model.solids.elasticity import Solid
from delam_fem.model.solids.evaluation import evaluate
from delam_fem.model.solids.mesh import FACETS, SolidMesh
from delam_fem.numerics.arrays import FloatArray, IntArray

UP = 1
"""Number of the component that is the deflection."""
_BESIDE = 1e-5
"""How far beside a point slopes are taken, in lengths of the structure; far below a cell."""
FEWEST, MOST = 20, 400
"""Bounds for the number of cells between the points of a part on a mesh from a file."""


def parts(case: Case, x: FloatArray) -> tuple[Part, ...]:
    """Return the laminae as parts; their dofs are the numbers of readings.

    Args:
        case: the case.
        x: points along the laminae, shape (n,) [m].
    """
    n = x.size
    return tuple(
        Part(
            lamina.name,
            x,
            (2 * n * number + np.arange(2 * n)).reshape(n, 2),
            np.full(n - 1, lamina.flexural_rigidity),
            np.full(n - 1, lamina.mass_per_length),
        )
        for number, lamina in enumerate(case.lamina)
    )


def points_along(case: Case, mesh: SolidMesh) -> FloatArray:
    """Return the points of the parts of a mesh from a file, shape (n,) [m].

    They are about as dense as the cells are on the average, with one at each edge of a
    delamination.
    """
    size = float(np.mean(np.ptp(mesh.points[mesh.cells][..., 0], axis=1)))
    n = int(np.clip(round(case.length / size), max(FEWEST, 2 * edges(case).size), MOST))
    return placed(case, n)


def reading_rows(solid: Solid, x: FloatArray) -> sp.csr_matrix:
    """Return the readings of all laminae, this rank's share, shape (2 n_parts n, n_dofs).

    A slope at the boundary of two cells is the mean of theirs.

    Args:
        solid: the solid.
        x: points along the laminae, shape (n,) [m].

    Raises:
        CaseError: a lamina does not reach a point, or has a hole there.
    """
    mesh = solid.mesh
    count = int(mesh.lamina.max()) + 1
    line = np.concatenate([middle_line(mesh, number, x) for number in range(count)])
    lamina = np.repeat(np.arange(count), x.size)
    step = np.zeros(mesh.dim)
    step[0] = _BESIDE * (x[-1] - x[0])
    first, last = line[:, 0] == x[0], line[:, 0] == x[-1]
    try:
        before = locate(mesh, line - step * ~first[:, None], lamina)
        behind = locate(mesh, line + step * ~last[:, None], lamina)
    except ValueError as error:
        raise CaseError(
            f"mesh.file: expected laminae without holes at half of their height; {error}"
        ) from error
    sides = [evaluate(solid, line, cells) for cells in (before, behind)]
    deflection = 0.5 * sum(side.displacement(UP) for side in sides)
    slope = 0.5 * sum(side.derivative(UP, 0) for side in sides)
    n = len(line)
    order = np.arange(2 * n).reshape(2, n).T.ravel()
    return sp.vstack([deflection, slope], format="csr")[order]


def reading(rows: sp.csr_matrix, free: sp.spmatrix, base: FloatArray, part: IntArray) -> Reading:
    """Return the reading of a solid whose dofs follow from free ones and the base.

    All dofs are `free @ u + base q`, u of the free dofs and q of the base.

    Args:
        rows: of all dofs, with the shares of all ranks (see `evaluation.gathered`), shape
            (n_readings, n_dofs).
        free: shape (n_dofs, n_own); columns of the free dofs of this rank.
        base: shape (n_dofs,).
        part: number of the part of each free dof, -1 where parts share it, shape (n_own,).
    """
    return Reading(sp.csr_matrix(rows @ free), np.asarray(rows @ base), part)


def middle_line(mesh: SolidMesh, lamina: int, x: FloatArray) -> FloatArray:
    """Return the points at half of the height and width of a lamina, shape (n, dim) [m].

    Args:
        mesh: the mesh.
        lamina: number of the lamina.
        x: positions along the lamina, shape (n,) [m].

    Raises:
        CaseError: the lamina does not reach one of the positions.
    """
    boundary = surface(mesh, mesh.lamina == lamina)
    corners = mesh.points[boundary]
    origins = np.zeros((x.size, mesh.dim))
    origins[:, 0] = x
    if mesh.dim == 3:
        origins[:, 2] = 0.5 * (corners[..., 2].min() + corners[..., 2].max())
    upwards = np.zeros_like(origins)
    upwards[:, UP] = 1.0
    hits = meetings(corners, origins, upwards, FACET_OF[mesh.cell])
    low, high = np.full(x.size, np.inf), np.full(x.size, -np.inf)
    np.minimum.at(low, hits.line, hits.distance)
    np.maximum.at(high, hits.line, hits.distance)
    if not np.all(high > low):
        at = float(x[np.flatnonzero(~(high > low))[0]])
        raise CaseError(
            f"mesh.file: expected lamina {lamina} (counted from 0 at the bottom) to reach from "
            f"x = {x[0]:g} m to {x[-1]:g} m, there is nothing of it at {at:g} m"
        )
    origins[:, UP] = 0.5 * (low + high)
    return origins


def surface(mesh: SolidMesh, chosen: IntArray) -> IntArray:
    """Return the facets that belong to one cell only of those chosen, as vertices, (n, m)."""
    cells = mesh.cells[chosen]
    facets = np.concatenate([cells[:, list(own)] for own in FACETS[mesh.cell]])
    _, first, count = np.unique(
        np.sort(facets, axis=1), axis=0, return_index=True, return_counts=True
    )
    return np.asarray(facets[first[count == 1]])
