"""Point masses on laminae: what they add to the mass of a structure.

    m(w, v) = ∫ rho A w v dx + Σ m_j w(x_j) v(x_j)                                  (weak form)

w and v are Hermite interpolants, so a mass m at x adds m N N^T, where N are the values of the cubic
Hermite functions there. The lumped mass gets the share m (1 - X) and m X at the ends of the cell.
The masses are part of M in the damping C = alpha M + beta K; their rotatory inertia is neglected.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy.sparse as sp

from delam_fem.case.attachments import PointMass
from delam_fem.case.definition import Case
from delam_fem.model.layout import BASE, DISPLACEMENT, Layout, Structure
from delam_fem.model.pairing import columns_of, place_of
from delam_fem.numerics.arrays import FloatArray


def added_mass(case: Case, layout: Layout, n: int) -> tuple[sp.csr_matrix, FloatArray]:
    """Return what the point masses of a case add to the mass of free dofs and base.

    Args:
        case: gives the masses.
        layout: of the structure.
        n: number of free dofs; column n is the base.

    Returns:
        Matrix of shape (n + 1, n + 1), lumped if the case takes the lumped mass; the diagonal that
        they add to the lumped mass, shape (n + 1,) [kg].
    """
    matrix, lumped = sp.csr_matrix((n + 1, n + 1)), np.zeros(n + 1)
    for own in case.point_mass:
        part = layout.parts[layout.names.index(own.lamina)]
        place = place_of(part, _position(own, case))
        row = columns_of(part, place, n)
        matrix = matrix + own.mass * (row.T @ row)
        point = min(int(place), part.n_elements - 1)
        for node, share in ((point, 1.0 - (place - point)), (point + 1, place - point)):
            dof = int(part.dofs[node, DISPLACEMENT])
            if dof >= 0 or dof == BASE:
                lumped[dof if dof >= 0 else n] += share * own.mass
    return (sp.diags(lumped, format="csr") if case.time.mass == "lumped" else matrix), lumped


def with_masses(structure: Structure, case: Case) -> Structure:
    """Return laminae that are apart with the point masses of their case."""
    if not case.point_mass:
        return structure
    o, layout = structure.operators, structure.layout
    n = o.n_dofs
    mass, damping, base = o.mass, o.damping, o.base
    lumped = np.zeros(n + 1)
    for i, lamina in enumerate(case.lamina):
        own = tuple(point for point in case.point_mass if point.lamina == lamina.name)
        added, diagonal = added_mass(case.model_copy(update={"point_mass": own}), layout, n)
        alpha, _ = case.rayleigh(i)
        column, corner = added[:n, n].toarray().ravel(), float(added[n, n])
        mass, damping = mass + added[:n, :n], damping + alpha * added[:n, :n]
        base = replace(
            base,
            mass=base.mass + column,
            damping=base.damping + alpha * column,
            corner=(base.corner[0] + corner, base.corner[1] + alpha * corner, base.corner[2]),
        )
        lumped += diagonal
    operators = replace(
        o,
        mass=mass.tocsr(),
        damping=damping.tocsr(),
        base=base,
        lumped_mass=None if o.lumped_mass is None else o.lumped_mass + lumped[:n],
    )
    return replace(structure, operators=operators)


def _position(own: PointMass, case: Case) -> float:
    """Return the place of a mass [m]; without one, the end x = L."""
    return case.length if own.position is None else own.position
