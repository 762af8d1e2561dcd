"""Assemble Euler–Bernoulli laminae and bonded stacks from weak forms in dolfinx.

Cubic Hermite beams on a mixed P1 × P1 space (u, phi = u'), in UFL. A P1 field f has the values f -
X J f' and f + (1 - X) J f' at the ends of its cell, where X in [0, 1] is the local coordinate and J
the signed Jacobian. The Hermite interpolant of (u, phi) is therefore an algebraic expression in
UFL. It needs no C1 element from the library, and its slopes are physical on any graded or reversed
cell.

Bonded laminae have a third P1 field, the axial displacement. Nodes keep the numbers that they have
in `Hermite.on_line`. In every gathered matrix node j has the dofs 2 j (u) and 2 j + 1 (phi),
however dolfinx and the partitioning number them; with an axial field, 3 j (u), 3 j + 1 (phi) and 3
j + 2 (axial).

Laminae that are apart have

    m(w, v) = ∫ rho A w v dx + Σ m_j w(x_j) v(x_j)         (mass; point masses: network.py)
    k(w, v) = ∫ E I w'' v'' dx                             (stiffness)
    c(w, v) = ∫ alpha rho A w v dx + ∫ beta E I w'' v'' dx (Rayleigh damping)

w and v are the Hermite interpolants of (u, phi). All laminae lie on one mesh as separate
lines; E I, rho A, alpha and beta are functions of x on this mesh. The clamped dofs are separated
after the assembly (paper eq. 9, 10). Bonded stacks have

    m(w, v) = ∫ rho A w v dx                                                      (mass)
    k(w, v) = ∫ E I w'' v'' dx + ∫ E A (u' - zeta w'') (r' - zeta v'') dx         (stiffness)

w and v are the Hermite interpolants of deflection and slope, u and r the axial displacements of the
neutral axis of the group that a lamina is bonded to, zeta its distance from this axis: N2 of
`network.py`. Every lamina of every segment is a line of its own on the mesh. A transformation
matrix then ties all lines to the unknowns of the stack: bonded laminae have one deflection, one
slope and plane sections, exactly and without penalties.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp
import ufl

from delam_fem.case.definition import Case
from delam_fem.model import _dolfinx
from delam_fem.model.beams.network import (
    Group,
    Network,
    Segment,
    clamped_parts,
    network,
    side_by_side,
    structure,
)
from delam_fem.model.layout import Structure
from delam_fem.model.mesh import node_coordinates
from delam_fem.numerics.types import FloatArray, IntArray
from delam_fem.system.errors import CaseError
from delam_fem.system.mpi import MPI

MASS_DEGREE = 8  # cubic times cubic times a quadratic coefficient
BENDING_DEGREE = 4  # linear times linear times a quadratic coefficient
COEFFICIENT_DEGREE = 2


@dataclass(frozen=True)
class Hermite:
    """A mixed P1 × P1 space and the Hermite interpolant of its functions.

    Attributes:
        comm: communicator of the mesh.
        mesh: dolfinx mesh of intervals.
        space: the space P1 × P1, or P1 × P1 × P1 with an axial field.
        node_of_vertex: input node of each geometry node of this rank.
        cell_of_cell: input cell of each cell of this rank, ghosts included.
        n_fields: number of P1 fields of the space.
    """

    comm: MPI.Intracomm
    mesh: Any
    space: Any
    node_of_vertex: IntArray
    cell_of_cell: IntArray
    n_fields: int = 2

    @classmethod
    def on_line(
        cls, comm: MPI.Intracomm, x: FloatArray, cells: IntArray, *, has_axial: bool = False
    ) -> Hermite:
        """Build the space on intervals, which may form several separate lines.

        Args:
            comm: communicator.
            x: node coordinates, shape (n_nodes,) [m].
            cells: node pairs in any order and direction, shape (n_cells, 2).
            has_axial: whether there is a third P1 field, the axial displacement.
        """
        n_fields = 3 if has_axial else 2
        mesh = _dolfinx.create_interval_mesh(comm, x, cells)
        return cls(
            comm,
            mesh,
            _dolfinx.mixed_space(mesh, n_fields),
            np.asarray(mesh.geometry.input_global_indices, dtype=np.int64),
            np.asarray(mesh.topology.original_cell_index, dtype=np.int64),
            n_fields,
        )

    def _ends(self, field: Any) -> tuple[Any, Any, Any, Any]:
        """Return X, J and the values of a P1 field at the start and the end of its cell, in UFL."""
        J = ufl.Jacobian(self.mesh)[0, 0]
        X = (ufl.SpatialCoordinate(self.mesh)[0] - ufl.geometry.CellVertices(self.mesh)[0, 0]) / J
        return X, J, field - X * J * field.dx(0), field + (1 - X) * J * field.dx(0)

    def value(self, pair: Any) -> Any:
        """Return w, the Hermite interpolant of (u, phi)."""
        X, J, u0, u1 = self._ends(pair[0])
        _, _, p0, p1 = self._ends(pair[1])
        return (
            (1 - 3 * X**2 + 2 * X**3) * u0
            + (X - 2 * X**2 + X**3) * J * p0
            + (3 * X**2 - 2 * X**3) * u1
            + (X**3 - X**2) * J * p1
        )

    def curvature(self, pair: Any) -> Any:
        """Return w'' of the Hermite interpolant of (u, phi); u enters through J u'."""
        X, J, _, _ = self._ends(pair[0])
        _, _, p0, p1 = self._ends(pair[1])
        return ((6 - 12 * X) * pair[0].dx(0) + (6 * X - 4) * p0 + (6 * X - 2) * p1) / J

    def coefficient(self, values: Callable[[IntArray, FloatArray], FloatArray]) -> Any:
        """Return a piecewise quadratic coefficient on the cells.

        Args:
            values: a function (input cells of shape (k,), x of shape (k,)) -> values, shape (k,).
        """
        space = _dolfinx.space(self.mesh, "Discontinuous Lagrange", COEFFICIENT_DEGREE)
        points = space.tabulate_dof_coordinates()[:, 0]
        cells = np.empty(len(points), dtype=np.int64)
        for local, given in enumerate(self.cell_of_cell):
            cells[space.dofmap.cell_dofs(local)] = given
        return _dolfinx.function(space, values(cells, points))

    def _global_to_input(self) -> IntArray:
        """Return the input dof (n_fields node + component) of each global dof, on every rank."""
        n = self.n_fields
        rows = []
        nodes = _dolfinx.cell_nodes(self.mesh)
        index_map = self.space.dofmap.index_map
        for component in range(n):
            dofmap = self.space.sub(component).dofmap
            for cell, vertices in enumerate(nodes):
                local = dofmap.cell_dofs(cell).astype(np.int32)
                dofs = index_map.local_to_global(local)
                rows.append(np.column_stack([dofs, n * self.node_of_vertex[vertices] + component]))
        mine = np.vstack(rows) if rows else np.empty((0, 2), dtype=np.int64)
        table = np.vstack(self.comm.allgather(mine))
        result = np.empty(index_map.size_global, dtype=np.int64)
        result[table[:, 0]] = table[:, 1]
        return result

    def assemble(self, form: Any) -> sp.csr_matrix:
        """Assemble a bilinear form and gather it on every rank, in the order of the nodes."""
        matrix = _dolfinx.assemble_matrix(form)
        indptr, columns, values = matrix.getValuesCSR()
        first, _ = matrix.getOwnershipRange()
        n = matrix.getSize()[0]
        matrix.destroy()
        rows = np.repeat(np.arange(len(indptr) - 1), np.diff(indptr)) + first
        pieces = self.comm.allgather((rows, columns, values))
        order = self._global_to_input()
        i, j, v = (np.concatenate(piece) for piece in zip(*pieces, strict=True))
        gathered = sp.coo_matrix((v, (order[i], order[j])), shape=(n, n)).tocsr()
        gathered.eliminate_zeros()
        return gathered


Profile = Callable[[int, FloatArray], FloatArray | float]
"""A property along a lamina: (number of the lamina from 0, x [m]) -> values at x."""


def assemble(
    case: Case,
    *,
    comm: MPI.Intracomm = MPI.COMM_SELF,
    flexural_rigidity: Profile | None = None,
    mass_per_length: Profile | None = None,
) -> Structure:
    """Assemble the laminae of a case from weak forms.

    Args:
        case: the case, with all values that the other arguments do not replace.
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
        return assemble_stack(case, x, comm)
    n = len(x) - 1
    EI = flexural_rigidity or (lambda i, x: case.lamina[i].flexural_rigidity)
    rhoA = mass_per_length or (lambda i, x: case.lamina[i].mass_per_length)
    middle, numbers = 0.5 * (x[1:] + x[:-1]), range(len(case.lamina))
    sections = [[np.broadcast_to(profile(i, middle), n) for i in numbers] for profile in (EI, rhoA)]
    M, C, K, lumped = _matrices(case, Lines.of(comm, [x] * len(numbers)), (EI, rhoA))
    return side_by_side(case, clamped_parts(case, x, np.array(sections)), (M, C, K), lumped)


@dataclass(frozen=True)
class Lines:
    """Separate lines on one mesh, with what the forms of beams on them share.

    Attributes:
        hermite: the space.
        of_cell: number of the line of each input cell, shape (n_cells,).
        trial, test: the functions of the space.
        curvatures: their second derivatives.
    """

    hermite: Hermite
    of_cell: IntArray
    trial: Any
    test: Any
    curvatures: tuple[Any, Any]

    @classmethod
    def of(
        cls, comm: MPI.Intracomm, lines: Sequence[FloatArray], *, has_axial: bool = False
    ) -> Lines:
        """Build the space on lines, each given by x of its nodes, shape (n_nodes,) [m]."""
        sizes = np.array([x.size for x in lines])
        cells = np.column_stack([np.arange(sizes.sum() - 1), np.arange(1, sizes.sum())])
        within = np.delete(cells, np.cumsum(sizes)[:-1] - 1, axis=0)
        hermite = Hermite.on_line(comm, np.concatenate(lines), within, has_axial=has_axial)
        trial, test = ufl.TrialFunction(hermite.space), ufl.TestFunction(hermite.space)
        curvatures = hermite.curvature(trial), hermite.curvature(test)
        return cls(hermite, np.repeat(np.arange(sizes.size), sizes - 1), trial, test, curvatures)

    def coefficient(self, profile: Profile) -> Any:
        """Return a coefficient with its own course on each line."""

        def values(cells: IntArray, x: FloatArray) -> FloatArray:
            numbers = range(int(self.of_cell[-1]) + 1)
            own = [self.of_cell[cells] == i for i in numbers]
            return np.select(own, [profile(i, x) for i in numbers])

        return self.hermite.coefficient(values)

    def mass(self, factor: Any) -> Any:
        """Return the form of the consistent mass of ρA."""
        w, v = self.hermite.value(self.trial), self.hermite.value(self.test)
        return factor * w * v * ufl.dx(metadata={"quadrature_degree": MASS_DEGREE})

    def lumped_mass(self, factor: Any) -> Any:
        """Return the form of the lumped mass: ρA h/2 for u and ρA h³/78 for phi at each end."""
        h, pair, test = abs(ufl.Jacobian(self.hermite.mesh)[0, 0]), self.trial, self.test
        dx_ends = ufl.dx(metadata={"quadrature_rule": "GLL", "quadrature_degree": 1})
        return factor * (pair[0] * test[0] + h**2 / 39 * pair[1] * test[1]) * dx_ends


def _matrices(
    case: Case, lines: Lines, profiles: tuple[Profile, Profile]
) -> tuple[sp.csr_matrix, sp.csr_matrix, sp.csr_matrix, FloatArray]:
    """Return M, C, K and the diagonal of the lumped mass, with the clamped dofs."""
    EI, rhoA = (lines.coefficient(profile) for profile in profiles)
    alpha, beta = (
        lines.coefficient(lambda i, x, k=k: case.rayleigh(i)[k])  # type: ignore[misc]
        for k in (0, 1)
    )
    (w2, v2), assemble = lines.curvatures, lines.hermite.assemble
    dx_bending = ufl.dx(metadata={"quadrature_degree": BENDING_DEGREE})
    inertia = lines.lumped_mass if case.time.mass == "lumped" else lines.mass
    # two forms, because ffcx 0.5 does not allow two quadrature rules in one form
    C = assemble(inertia(alpha * rhoA)) + assemble(beta * EI * w2 * v2 * dx_bending)
    M, K = assemble(inertia(rhoA)), assemble(EI * w2 * v2 * dx_bending)
    return M, C, K, assemble(lines.lumped_mass(rhoA)).diagonal()


Line = tuple[Segment, Group, int]
"""A segment, a group of it, and the lamina of the group that the line stands for."""


def assemble_stack(case: Case, x: FloatArray, comm: MPI.Intracomm = MPI.COMM_SELF) -> Structure:
    """Assemble a case of bonded laminae from weak forms.

    Args:
        case: the case.
        x: positions of the nodes, one at every edge of a delamination [m].
        comm: communicator that shares the assembly; every rank gets the whole result.
    """
    unknowns = network(case, x)
    lines = [(segment, group, i) for segment, group in unknowns.groups() for i in group]
    M, K, lumped = _stack_matrices(unknowns, lines, comm)
    to = _transformation(unknowns, lines)
    return structure(case, unknowns, to.T @ M @ to, to.T @ K @ to, to.T @ lumped)


def _stack_matrices(
    unknowns: Network, lines: list[Line], comm: MPI.Intracomm
) -> tuple[sp.csr_matrix, sp.csr_matrix, FloatArray]:
    """Return M, K and the diagonal of the lumped mass of all lines, not yet tied."""
    on = Lines.of(comm, [unknowns.x[segment.nodes] for segment, _, _ in lines], has_axial=True)

    def coefficient(values: Sequence[float]) -> Any:
        return on.coefficient(lambda i, x: values[i])

    own, middles = [unknowns.laminae[i] for _, _, i in lines], unknowns.middles
    EI = coefficient([lamina.flexural_rigidity for lamina in own])
    EA = coefficient([lamina.axial_rigidity for lamina in own])
    rhoA = coefficient([lamina.mass_per_length for lamina in own])
    zeta = coefficient([float(middles[i]) - unknowns.neutral_axis(g) for _, g, i in lines])
    (w2, v2), assemble = on.curvatures, on.hermite.assemble
    strain, strain_test = on.trial[2].dx(0) - zeta * w2, on.test[2].dx(0) - zeta * v2
    dx_bending = ufl.dx(metadata={"quadrature_degree": BENDING_DEGREE})
    K = assemble((EI * w2 * v2 + EA * strain * strain_test) * dx_bending)
    return assemble(on.mass(rhoA)), K, assemble(on.lumped_mass(rhoA)).diagonal()


def _transformation(unknowns: Network, lines: list[Line]) -> sp.csr_matrix:
    """Return the matrix from the unknowns of the stack to the dofs of all lines (N1)."""
    rows: list[list[tuple[int, float]]] = []
    for segment, group, lamina in lines:
        start, end = unknowns.x[segment.first], unknowns.x[segment.last]
        ends = [unknowns.axial_row(node, group) for node in (segment.first, segment.last)]
        for node in segment.nodes:
            s = float((unknowns.x[node] - start) / (end - start))
            axial = [(c, (1.0 - s) * f) for c, f in ends[0]] + [(c, s * f) for c, f in ends[1]]
            rows += [unknowns.row(node, lamina, 0), unknowns.row(node, lamina, 1), axial]
    return unknowns.matrix(rows)
