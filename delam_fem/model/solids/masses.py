"""Point masses on solids: they move with the deflection that the middle line reads.

    m(u, v) = ∫ b rho u · v dx + Σ m_j r_j(u) r_j(v)                                (weak form)

r_j(u) is the Hermite interpolant of the readings at the place of the mass. Along the lamina and
across a mass has no inertia, as in beam theory.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from delam_fem.case.attachments import PointMass
from delam_fem.case.definition import Case
from delam_fem.case.toml import CaseError
from delam_fem.model.layout import Layout
from delam_fem.model.pairing import columns_of, place_of
from delam_fem.model.solids.unknowns import Restricted
from delam_fem.mpi import MPI
from delam_fem.numerics.arrays import FloatArray


def with_masses(
    mass: Restricted, lumped: FloatArray, case: Case, layout: Layout, comm: MPI.Intracomm
) -> tuple[Restricted, FloatArray]:
    """Return M and the diagonal of the lumped mass with the point masses of a case (collective).

    Args:
        mass: M of the laminae.
        lumped: diagonal of the lumped mass, shape (n_own,) [kg].
        case: gives the masses.
        layout: with its readings.
        comm: communicator that shares the dofs.

    Raises:
        CaseError: a mass would make a lumped mass matrix that is no diagonal.
    """
    if case.point_mass and case.time.mass == "lumped":
        raise CaseError(
            'point_mass: expected time.mass = "consistent" with laminae as solids, given "lumped"'
        )
    for own in case.point_mass:
        row, at_base = _row(own, case, layout)
        pieces = comm.allgather(row)
        whole = sp.hstack(pieces, format="csr")
        load = row.toarray().ravel()
        corners = mass.corners.copy()
        corners[layout.names.index(own.lamina)] += own.mass * at_base**2
        mass = Restricted(
            sp.csr_matrix(mass.rows + own.mass * (row.T @ whole)),
            mass.column + own.mass * at_base * load,
            corners,
        )
        total = sum(float(abs(piece).sum()) for piece in pieces)
        lumped = lumped + (own.mass * np.abs(load) / total if total else 0.0)
    return mass, lumped


def _row(own: PointMass, case: Case, layout: Layout) -> tuple[sp.csr_matrix, float]:
    """Return the deflection at a mass from the own free dofs, (1, n_own), and from the base."""
    part = layout.parts[layout.names.index(own.lamina)]
    place = place_of(part, case.length if own.position is None else own.position)
    row = layout.of_dofs(columns_of(part, place, layout.n_numbered(0)))
    return sp.csr_matrix(row[:, :-1]), float(row[0, row.shape[1] - 1])
