"""Operators from what a user brings: UFL forms with their supports, or matrices of PETSc.

    M a + C v + K u = -(m_b q''_b + c_b q'_b + k_b q_b) + Hᵀ λ,   m_b = M g at the free dofs

g is what each held dof has of the motion q of the base: 1 where it follows, 0 where it rests. All
displacements are those of the fixed frame, and so are the gaps: a stop rests on the ground.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy.sparse as sp

from delam_fem.model.operators import BaseCoupling, DistributedOperators, Operators, with_near_null
from delam_fem.numerics.types import FloatArray
from delam_fem.system.errors import require

if TYPE_CHECKING:
    from petsc4py import PETSc


@dataclass(frozen=True)
class Gap:
    """Contact of points of a body with a rigid stop, or with points opposite.

    U = at_rest + along · (u(points) - u(opposite))

    Attributes:
        points: shape (n, dim) [m].
        along: the direction in which the gap opens, one number for each component of the space.
        at_rest: gap at rest, a number or shape (n,) [m]; positive is open.
        opposite: of each point, shape (n, dim) [m]; None: a rigid stop.
    """

    points: Any
    along: Sequence[float]
    at_rest: Any
    opposite: Any = None


def from_forms(
    mass: Any,
    stiffness: Any,
    damping: Any,
    base: Sequence[Any],
    gap: Gap | tuple[Any, Any],
    probes: Mapping[str, tuple[Sequence[float], Sequence[float]]] | None,
) -> Operators | DistributedOperators:
    """Assemble bilinear UFL forms on one space; see `Operators.from_forms`."""
    from delam_fem.model import _dolfinx

    space = mass.arguments()[0].ufl_function_space()
    M, K = (_dolfinx.assemble_own(form) for form in (mass, stiffness))
    C = damping if isinstance(damping, tuple) else _dolfinx.assemble_own(damping)
    if isinstance(gap, Gap):
        points, opposite = np.atleast_2d(gap.points), gap.opposite
        rows = _dolfinx.rows_at(space, points, gap.along)
        if opposite is not None:
            rows = rows - _dolfinx.rows_at(space, np.atleast_2d(opposite), gap.along)
        gap = rows, np.broadcast_to(np.asarray(gap.at_rest, dtype=float), len(points)).copy()
    seen = {
        name: _dolfinx.rows_at(space, np.atleast_2d(point), along)
        for name, (point, along) in (probes or {}).items()
    }
    result = from_petsc(M, C, K, gap, _dolfinx.held_by(base, M), seen)
    for matrix in (M, K, *([] if isinstance(C, tuple) else [C])):
        matrix.destroy()
    return result


def from_petsc(
    mass: PETSc.Mat,
    damping: Any,
    stiffness: PETSc.Mat,
    gap: tuple[Any, Any],
    base: FloatArray | None,
    probes: Mapping[str, Any] | None,
) -> Operators | DistributedOperators:
    """Take assembled matrices over; see `Operators.from_petsc`."""
    from petsc4py import PETSc

    comm, (n, _) = mass.comm.tompi4py(), mass.getSizes()[0]
    follows = np.full(n, np.nan) if base is None else np.asarray(base, dtype=float)
    require(follows.shape == (n,), "base", f"one number for each own dof, ({n},)", follows.shape)
    free = np.flatnonzero(np.isnan(follows))
    H, at_rest = sp.csr_matrix(gap[0]), np.asarray(gap[1], dtype=float)
    carried = np.abs(H @ np.nan_to_num(follows)).max(initial=0.0)
    carried = carried if comm.size == 1 else max(comm.allgather(carried))
    require(carried == 0.0, "gap", "points that the base does not carry", float(carried))
    if isinstance(damping, tuple):
        C = mass.copy()
        C.scale(damping[0])
        C.axpy(damping[1], stiffness)
    else:
        C = damping
    first, _ = mass.getOwnershipRange()
    where = PETSc.IS().createGeneral((first + free).astype(PETSc.IntType), comm=mass.comm)
    g, image = mass.createVecs()
    g.array[:] = np.nan_to_num(follows)
    parts, columns, corners = [], [], []
    for matrix in (mass, C, stiffness):
        matrix.mult(g, image)
        parts.append(matrix.createSubMatrix(where, where))
        columns.append(np.array(image.array[free]))
        corners.append(float(g.dot(image)))
    for own in (where, g, image, *([C] if isinstance(damping, tuple) else [])):
        own.destroy()
    shapes = stiffness.getNearNullSpace()
    near = np.array([v.array_r[free] for v in shapes.getVecs()]).T if shapes else None
    rows = [sp.csr_matrix((0, n)), *(sp.csr_matrix(row) for row in (probes or {}).values())]
    further: dict[str, Any] = {
        "base": BaseCoupling(
            columns[0], columns[1], columns[2], (corners[0], corners[1], corners[2])
        ),
        "gap_matrix": H[:, free],
        "gap0": at_rest,
        "probes": sp.vstack(rows, format="csr")[:, free],
        "names": tuple(probes or ()),
    }
    if isinstance(damping, tuple):
        further["rayleigh"] = np.full(free.size, damping[0]), np.full(free.size, damping[1])
    if comm.size > 1:
        if near is not None:
            with_near_null(parts[2], near)
        return DistributedOperators(comm, *parts, **further)
    arrays = [sp.csr_matrix(part.getValuesCSR()[::-1], shape=part.getSize()) for part in parts]
    return Operators(arrays[0], arrays[1], arrays[2], near_null=near, **further)
