"""Assemble a bonded stack from weak forms in dolfinx, lamina by lamina.

    m(w, v) = ∫ rho A w v dx                                                      (mass)
    k(w, v) = ∫ E I w'' v'' dx + ∫ E A (u' - zeta w'') (r' - zeta v'') dx         (stiffness)

w and v are the Hermite interpolants of deflection and slope, u and r the axial displacements of the
neutral axis of the group that a lamina is bonded to, zeta its distance from this axis: N2 of
`network.py`. Every lamina of every segment is a line of its own on the mesh. A transformation
matrix then ties all lines to the unknowns of the stack: bonded laminae have one deflection, one
slope and plane sections, exactly and without penalties.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sp
import ufl

from delam_fem.case.definition import Case
from delam_fem.model.beams import bonded
from delam_fem.model.beams.hermite import BENDING_DEGREE, MASS_DEGREE, Hermite
from delam_fem.model.beams.network import Group, Network, Segment, network
from delam_fem.model.layout import Structure
from delam_fem.mpi import MPI
from delam_fem.numerics.arrays import FloatArray, IntArray

Line = tuple[Segment, Group, int]
"""A segment, a group of it, and the lamina of the group that the line stands for."""
_FIELDS = 3
"""Deflection, slope, axial displacement."""


def assemble(case: Case, x: FloatArray, comm: MPI.Intracomm = MPI.COMM_SELF) -> Structure:
    """Assemble a case of bonded laminae.

    Args:
        case: the case.
        x: positions of the nodes, one at every edge of a delamination [m].
        comm: communicator that shares the assembly; every rank gets the whole result.
    """
    unknowns = network(case, x)
    lines = [(segment, group, i) for segment, group in unknowns.groups() for i in group]
    M, K, lumped = _matrices(unknowns, lines, comm)
    to = _transformation(unknowns, lines)
    return bonded.structure(case, unknowns, to.T @ M @ to, to.T @ K @ to, to.T @ lumped)


def _matrices(
    unknowns: Network, lines: list[Line], comm: MPI.Intracomm
) -> tuple[sp.csr_matrix, sp.csr_matrix, FloatArray]:
    """Return M, K and the diagonal of the lumped mass of all lines, not yet tied."""
    sizes = np.array([segment.nodes.size for segment, _, _ in lines])
    starts = np.cumsum(sizes) - sizes
    x = np.concatenate([unknowns.x[segment.nodes] for segment, _, _ in lines])
    cells = np.concatenate([
        np.column_stack([np.arange(n - 1), np.arange(1, n)]) + start
        for n, start in zip(sizes, starts, strict=True)
    ])  # fmt: skip
    laminae = Hermite.on_line(comm, x, cells, has_axial=True)
    of_cell = np.repeat(np.arange(len(lines)), sizes - 1)

    def coefficient(values: list[float]) -> Any:
        of_lines = np.array(values)

        def at(cells: IntArray, x: FloatArray) -> FloatArray:
            return np.asarray(of_lines[of_cell[cells]])

        return laminae.coefficient(at)

    own = [unknowns.laminae[i] for _, _, i in lines]
    EI = coefficient([lamina.flexural_rigidity for lamina in own])
    EA = coefficient([lamina.axial_rigidity for lamina in own])
    rhoA = coefficient([lamina.mass_per_length for lamina in own])
    middles = unknowns.middles
    zeta = coefficient([float(middles[i]) - unknowns.neutral_axis(g) for _, g, i in lines])
    trial, test = ufl.TrialFunction(laminae.space), ufl.TestFunction(laminae.space)
    w, v = laminae.value(trial), laminae.value(test)
    w2, v2 = laminae.curvature(trial), laminae.curvature(test)
    strain, strain_test = trial[2].dx(0) - zeta * w2, test[2].dx(0) - zeta * v2
    h = abs(ufl.Jacobian(laminae.mesh)[0, 0])
    dx_mass = ufl.dx(metadata={"quadrature_degree": MASS_DEGREE})
    dx_bending = ufl.dx(metadata={"quadrature_degree": BENDING_DEGREE})
    dx_ends = ufl.dx(metadata={"quadrature_rule": "GLL", "quadrature_degree": 1})
    M = laminae.assemble(rhoA * w * v * dx_mass)
    K = laminae.assemble((EI * w2 * v2 + EA * strain * strain_test) * dx_bending)
    ends = rhoA * (trial[0] * test[0] + h**2 / 39 * trial[1] * test[1]) * dx_ends
    return M, K, laminae.assemble(ends).diagonal()


def _transformation(unknowns: Network, lines: list[Line]) -> sp.csr_matrix:
    """Return the matrix from the unknowns of the stack to the dofs of all lines (N1)."""
    rows: list[int] = []
    columns: list[int] = []
    factors: list[float] = []
    first = 0
    for segment, group, lamina in lines:
        start, end = unknowns.x[segment.first], unknowns.x[segment.last]
        ends = [unknowns.axial_row(node, group) for node in (segment.first, segment.last)]
        for k, node in enumerate(segment.nodes):
            s = float((unknowns.x[node] - start) / (end - start))
            axial = [(c, (1.0 - s) * f) for c, f in ends[0]] + [(c, s * f) for c, f in ends[1]]
            fields = (unknowns.row(node, lamina, 0), unknowns.row(node, lamina, 1), axial)
            for component, entries in enumerate(fields):
                rows += [_FIELDS * (first + k) + component] * len(entries)
                columns += [column for column, _ in entries]
                factors += [factor for _, factor in entries]
        first += segment.nodes.size
    shape = (_FIELDS * first, unknowns.n_columns)
    return sp.csr_matrix((factors, (rows, columns)), shape=shape)
