"""Assemble the operators of Euler–Bernoulli laminae from weak forms in dolfinx.

    m(w, v) = ∫ rho A w v dx + Σ m_j w(x_j) v(x_j)         (mass; point masses: masses.py)
    k(w, v) = ∫ E I w'' v'' dx                             (stiffness)
    c(w, v) = ∫ alpha rho A w v dx + ∫ beta E I w'' v'' dx (Rayleigh damping)

w and v are the Hermite interpolants of (u, phi). All laminae lie on one mesh as separate
lines; E I, rho A, alpha and beta are functions of x on this mesh. The clamped dofs are separated
after the assembly (paper eq. 9, 10).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import scipy.sparse as sp
import ufl

from delam_fem.case.definition import Case
from delam_fem.case.toml import CaseError
from delam_fem.model.beams import stack
from delam_fem.model.beams.hermite import BENDING_DEGREE, MASS_DEGREE, Hermite
from delam_fem.model.beams.laminae import clamped_laminae, completed, gap_at_rest, pair_weights
from delam_fem.model.beams.masses import with_masses
from delam_fem.model.layout import BASE, Layout, Structure
from delam_fem.model.mesh import node_coordinates
from delam_fem.model.operators import BaseCoupling, Operators
from delam_fem.model.pairing import gap_matrix, probe_rows
from delam_fem.mpi import MPI
from delam_fem.numerics.arrays import FloatArray, IntArray

Profile = Callable[[int, FloatArray], FloatArray | float]
"""A property along a lamina: (number of the lamina from 0, x [m]) -> values at x."""


def assemble(
    case: Case,
    *,
    comm: MPI.Intracomm = MPI.COMM_SELF,
    flexural_rigidity: Profile | None = None,
    mass_per_length: Profile | None = None,
) -> Structure:
    """Assemble the laminae of a case.

    Args:
        case: the case; it gives all values that the other arguments do not replace.
        comm: communicator that shares the assembly; every rank gets the whole result.
        flexural_rigidity: E I along x [N m2]; None: the constants of the case.
        mass_per_length: rho A along x [kg/m]; None: the constants of the case.

    Raises:
        CaseError: the mesh or the gap is not usable.
    """
    x = node_coordinates(case)
    if not case.is_apart:
        if flexural_rigidity is not None or mass_per_length is not None:
            raise CaseError("bonded laminae: expected constant properties, given a profile along x")
        return stack.assemble(case, x, comm)
    n = len(x) - 1
    EI = flexural_rigidity or (lambda i, x: case.lamina[i].flexural_rigidity)
    rhoA = mass_per_length or (lambda i, x: case.lamina[i].mass_per_length)
    count = len(case.lamina)
    laminae = Hermite.on_line(comm, np.tile(x, count), _lines(n, count))
    M, C, K, lumped = _matrices(case, laminae, n, (EI, rhoA))
    middle = 0.5 * (x[1:] + x[:-1])
    EI_of_cell, rhoA_of_cell = (
        np.array([np.broadcast_to(profile(i, middle), n) for i in range(count)])
        for profile in (EI, rhoA)
    )
    layout = clamped_laminae(case, x, EI_of_cell, rhoA_of_cell)
    structure = Structure(_operators(case, layout, (M, C, K), lumped), layout)
    return completed(with_masses(structure, case), case)


def _lines(n: int, count: int) -> IntArray:
    """Return the cells of separate lines of n elements each, shape (count n, 2)."""
    line = np.column_stack([np.arange(n), np.arange(1, n + 1)])
    return np.vstack([line + k * (n + 1) for k in range(count)]).astype(np.int64)


def _matrices(
    case: Case, laminae: Hermite, n: int, profiles: tuple[Profile, Profile]
) -> tuple[sp.csr_matrix, sp.csr_matrix, sp.csr_matrix, FloatArray]:
    """Return M, C, K and the diagonal of the lumped mass, with the clamped dofs."""

    def coefficient(profile: Profile) -> Any:
        def values(cells: IntArray, x: FloatArray) -> FloatArray:
            own = [cells // n == i for i in range(len(case.lamina))]
            return np.select(own, [profile(i, x) for i in range(len(own))])

        return laminae.coefficient(values)

    EI, rhoA = (coefficient(profile) for profile in profiles)
    alpha, beta = (
        coefficient(lambda i, x, k=k: case.rayleigh(i)[k])  # type: ignore[misc]
        for k in (0, 1)
    )
    pair, test = ufl.TrialFunction(laminae.space), ufl.TestFunction(laminae.space)
    w, v = laminae.value(pair), laminae.value(test)
    w2, v2 = laminae.curvature(pair), laminae.curvature(test)
    h = abs(ufl.Jacobian(laminae.mesh)[0, 0])
    dx_mass = ufl.dx(metadata={"quadrature_degree": MASS_DEGREE})
    dx_bending = ufl.dx(metadata={"quadrature_degree": BENDING_DEGREE})
    dx_ends = ufl.dx(metadata={"quadrature_rule": "GLL", "quadrature_degree": 1})

    def mass(factor: Any) -> Any:
        return factor * rhoA * w * v * dx_mass

    def lumped_mass(factor: Any) -> Any:  # rho A h/2 for u and rho A h^3/78 for phi at each end
        return factor * rhoA * (pair[0] * test[0] + h**2 / 39 * pair[1] * test[1]) * dx_ends

    inertia = lumped_mass if case.time.mass == "lumped" else mass
    M = laminae.assemble(inertia(1))
    K = laminae.assemble(EI * w2 * v2 * dx_bending)
    # two forms, because ffcx 0.5 does not allow two quadrature rules in one form
    C = laminae.assemble(inertia(alpha)) + laminae.assemble(beta * EI * w2 * v2 * dx_bending)
    return M, C, K, laminae.assemble(lumped_mass(1)).diagonal()


def _operators(
    case: Case,
    layout: Layout,
    matrices: tuple[sp.csr_matrix, sp.csr_matrix, sp.csr_matrix],
    lumped: FloatArray,
) -> Operators:
    """Separate the clamped dofs (paper eq. 9) and pair opposite nodes."""
    whole = np.concatenate([part.dofs.ravel() for part in layout.parts])  # the assembly's order
    free, base = np.flatnonzero(whole >= 0), np.flatnonzero(whole == BASE)
    mass, damping, stiffness = (matrix[free][:, free].tocsr() for matrix in matrices)
    m, c, k = (np.asarray(matrix[free][:, base].sum(axis=1)).ravel() for matrix in matrices)
    m_aa, c_aa, k_aa = (float(matrix[base][:, base].sum()) for matrix in matrices)
    return Operators(
        mass=mass,
        damping=damping,
        stiffness=stiffness,
        lumped_mass=lumped[free],
        base=BaseCoupling(m, c, k, corner=(m_aa, c_aa, k_aa)),
        gap_matrix=gap_matrix(layout.parts, layout.interfaces, free.size),
        gap0=gap_at_rest(case, layout),
        pair_weights=pair_weights(case, layout),
        probes=probe_rows(layout, free.size),
    )
