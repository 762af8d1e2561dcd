"""Weight of solids, and the geometric stiffness of what pulls or presses along them.

The load of a weight is ∫ b ρ a·v dx. Along the axis it strains the laminae by u_0, without contact
and with the base at 0,

    k(u_0, v) = ∫ b ρ a_x v_x dx                                                             (W1)

and a tension N of a lamina adds N / (b h) to its stress along x. Both are the stress σ_0 of

    k_σ(u, v) = ∫ b σ_0 : (∇uᵀ ∇v) dx                                                        (W2)

which is added to the stiffness, as k_N of beams is. The weight across is not part of it: it bends,
and what it stretches is of second order.

Source of W2: K.-J. Bathe, Finite Element Procedures (1996), section 6.2.3.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sp

from delam_fem.case.definition import Case
from delam_fem.model import operators as distributed
from delam_fem.model.factors import factored
from delam_fem.model.layout import Layout, Place, place_of
from delam_fem.model.loads import require_unbuckled, tensions
from delam_fem.model.places import spot
from delam_fem.model.solids.body import height_of, middle_line
from delam_fem.model.solids.forms import Elasticity, Solid, evaluate, gathered
from delam_fem.model.solids.mesh import locate
from delam_fem.model.solids.unknowns import Restricted, Unknowns, X, Y
from delam_fem.numerics.types import FloatArray
from delam_fem.system.errors import CaseError


def weight(case: Case, unknowns: Unknowns, density: FloatArray, layout: Layout) -> FloatArray:
    """Return the load of weight across the laminae, with that of point masses (collective).

    Args:
        case: the case, with gravity.
        unknowns: of the solid.
        density: of each cell, times the width in 2D, shape (n_cells,).
        layout: gives the points of the masses.

    Returns:
        Loads on the own dofs, shape (n_own,) [N].
    """
    assert case.gravity is not None
    return _of_direction(case, unknowns, density, layout, Y, case.gravity.across)


def with_axial_stress(
    case: Case,
    unknowns: Unknowns,
    stiffness: Restricted,
    moduli: tuple[FloatArray, Elasticity],
    density: FloatArray,
    layout: Layout,
) -> tuple[Restricted, float | None]:
    """Return K + K_σ (W2) and the factor on all axial forces at which the structure buckles.

    The call is collective.

    Args:
        case: the case.
        unknowns: of the solid.
        stiffness: K with the springs of supports.
        moduli: Young's modulus of each cell, times the width in 2D, shape (n_cells,); the
            material of the cells.
        density: of each cell, times the width in 2D, shape (n_cells,).
        layout: gives the points of the masses.

    Raises:
        CaseError: nothing holds the structure along its axis, or it buckles.
    """
    solid = unknowns.solid
    displacement = np.zeros(unknowns.n_dofs)
    if case.gravity is not None and case.gravity.along:
        load = _of_direction(case, unknowns, density, layout, X, case.gravity.along)
        try:
            factor = factored(_matrix(stiffness.rows, solid))
        except ValueError:
            raise CaseError(
                "gravity.inclination: expected an end that is clamped or pinned, which holds the "
                "structure along its axis"
            ) from None
        moved = unknowns.free @ factor.solve(load)
        displacement = np.sum(solid.comm.allgather(moved), axis=0)
        del factor  # its memory
    heights = np.array([lamina.mean("thickness") for lamina in case.lamina])
    widths = np.array([lamina.mean("width") for lamina in case.lamina])
    sections = heights if solid.dim == 2 else heights * widths
    tension = (tensions(case) / sections)[solid.mesh.lamina]
    added = unknowns.restricted(solid.geometric_stiffness(*moduli, displacement, tension))
    total = Restricted(
        (stiffness.rows + added.rows).tocsr(),
        stiffness.column + added.column,
        stiffness.corners + added.corners,
    )
    stiff, geometric = (_matrix(matrix.rows, solid) for matrix in (total, added))
    return total, require_unbuckled(stiff, geometric, unknowns.n_own)


def _matrix(rows: sp.csr_matrix, solid: Solid) -> Any:
    """Return own rows of a matrix as they are on one rank, as a matrix of PETSc on several."""
    return rows if solid.comm.size == 1 else distributed.matrix(rows, solid.comm)


def _of_direction(
    case: Case,
    unknowns: Unknowns,
    density: FloatArray,
    layout: Layout,
    direction: int,
    acceleration: float,
) -> FloatArray:
    """Return the load of an acceleration of all masses along a direction, shape (n_own,) [N]."""
    solid = unknowns.solid
    load = unknowns.free.T @ solid.body_force(density, direction)
    for mass in case.masses:
        number = layout.names.index(mass.lamina)
        part = layout.parts[number]
        x = part.positions(np.array([place_of(part, case.position_of(mass))]))
        place = spot(layout.names, mass) or Place(number, float(x[0]), 0.0, 0)
        points = middle_line(solid.mesh, number, x, place.z, height_of(place.side))
        cells = locate(solid.mesh, points, number)
        row = gathered(evaluate(solid, points, cells).displacement(direction), solid.comm)
        load = load + mass.mass * (row @ unknowns.free).toarray()[0]
    return np.asarray(acceleration * load)
