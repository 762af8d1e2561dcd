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
    k_N(w, v) = ∫ N w' v' dx                               (axial force, tension positive)

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
from dataclasses import dataclass, field
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
    apart_forces,
    apart_parts,
    network,
    own_points,
    side_by_side,
    stack_forces,
    structure,
)
from delam_fem.model.layout import Structure
from delam_fem.model.mesh import node_coordinates
from delam_fem.numerics.types import FloatArray, IntArray
from delam_fem.system.errors import CaseError
from delam_fem.system.mpi import MPI

MASS_DEGREE = 8  # cubic times cubic times a quadratic coefficient
AXIAL_DEGREE = 6  # quadratic times quadratic times a quadratic coefficient
BENDING_DEGREE = 4  # linear times linear times a quadratic coefficient
COEFFICIENT_DEGREE = 2
VARYING_DEGREE = 5
"""Degree of E b h³ where each factor is linear in an element; quadratures then are exact with the
products of shape functions (degree 6 of the mass, 2 of bending)."""


@dataclass(frozen=True)
class Hermite:
    """A mixed P1 × P1 space and the Hermite interpolant of its functions.

    Attributes:
        mesh: dolfinx mesh of intervals.
        space: the space P1 × P1, or P1 × P1 × P1 with an axial field.
        of_coefficients: spaces of coefficients by their degree, made when they are needed.
    """

    mesh: Any
    space: Any
    of_coefficients: dict[int, Any] = field(default_factory=dict)

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
        mesh = _dolfinx.create_mesh(comm, "interval", x, cells)
        return cls(mesh, _dolfinx.mixed_space(mesh, 3 if has_axial else 2))

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

    def slope(self, pair: Any) -> Any:
        """Return w' of the Hermite interpolant of (u, phi); u enters through J u'."""
        X, _, _, _ = self._ends(pair[0])
        _, _, p0, p1 = self._ends(pair[1])
        bend = (1 - 4 * X + 3 * X**2) * p0 + (3 * X**2 - 2 * X) * p1
        return 6 * (X - X**2) * pair[0].dx(0) + bend

    def curvature(self, pair: Any) -> Any:
        """Return w'' of the Hermite interpolant of (u, phi); u enters through J u'."""
        X, J, _, _ = self._ends(pair[0])
        _, _, p0, p1 = self._ends(pair[1])
        return ((6 - 12 * X) * pair[0].dx(0) + (6 * X - 4) * p0 + (6 * X - 2) * p1) / J

    def coefficient(
        self,
        values: Callable[[IntArray, FloatArray], FloatArray],
        degree: int = COEFFICIENT_DEGREE,
    ) -> Any:
        """Return a coefficient on the cells that is a polynomial in each, discontinuous between.

        Args:
            values: a function (input cells of shape (k,), x of shape (k,)) -> values, shape (k,).
            degree: of the polynomials.
        """
        if degree not in self.of_coefficients:
            self.of_coefficients[degree] = _dolfinx.space(
                self.mesh, "Discontinuous Lagrange", degree
            )
        space = self.of_coefficients[degree]
        points = space.tabulate_dof_coordinates()[:, 0]
        topology = self.mesh.topology
        cells = np.empty(len(points), dtype=np.int64)
        cells[_dolfinx.cell_dofs(space)] = np.asarray(topology.original_cell_index)[:, None]
        return _dolfinx.function(space, values(cells, points))

    def _global_to_input(self) -> IntArray:
        """Return the input dof (fields × node + component) of each global dof, on every rank."""
        index_map = self.space.dofmap.index_map
        n = self.space.num_sub_spaces
        rows = []
        input_nodes = np.asarray(self.mesh.geometry.input_global_indices, dtype=np.int64)
        nodes = input_nodes[_dolfinx.cell_nodes(self.mesh)]
        for component in range(n):
            local = _dolfinx.cell_dofs(self.space.sub(component))[: len(nodes)]
            dofs = index_map.local_to_global(local.ravel().astype(np.int32))
            rows.append(np.column_stack([dofs, (n * nodes + component).ravel()]))
        table = np.vstack(self.mesh.comm.allgather(np.vstack(rows)))
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
        pieces = self.mesh.comm.allgather((rows, columns, values))
        order = self._global_to_input()
        i, j, v = (np.concatenate(piece) for piece in zip(*pieces, strict=True))
        gathered = sp.coo_matrix((v, (order[i], order[j])), shape=(n, n)).tocsr()
        gathered.eliminate_zeros()
        return gathered


Profile = Callable[[int, FloatArray], FloatArray | float]
"""A property along a lamina: (number of the lamina from 0, x [m]) -> values at x."""
Course = Callable[[int, FloatArray, FloatArray], FloatArray | float]
"""The same of (number of the line, x [m], places inside the cells of x [m])."""


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
        return _stack(case, network(case, x), comm)
    n = len(x) - 1
    laminae = case.lamina
    EI = _course(flexural_rigidity) or (lambda i, *x: laminae[i].flexural_rigidity_at(*x))
    rhoA = _course(mass_per_length) or (lambda i, *x: laminae[i].mass_per_length_at(*x))
    middle = 0.5 * (x[1:] + x[:-1])
    numbers = range(len(laminae))
    sections = [
        [np.broadcast_to(course(i, middle, middle), n) for i in numbers] for course in (EI, rhoA)
    ]
    forces = apart_forces(case, x)
    M, K, lumped, C, geometric = _matrices(
        case,
        comm,
        [own_points(case, i, x) for i in numbers],
        (EI, rhoA),
        forces=None
        if forces is None
        else np.vstack([N[: own_points(case, i, x).size - 1] for i, N in enumerate(forces)]),
    )
    constants = (
        None if flexural_rigidity is None and mass_per_length is None else np.array(sections)
    )
    parts = apart_parts(case, x, constants)
    return side_by_side(case, parts, (M, K), lumped, C, geometric=geometric)


def _course(profile: Profile | None) -> Course | None:
    """Return a profile as a function of places and of places inside their cells."""
    return None if profile is None else lambda i, x, inside: profile(i, x)


def _matrices(
    case: Case,
    comm: MPI.Intracomm,
    lines: Sequence[FloatArray],
    section: tuple[Course, Course],
    axial: tuple[Course, Course] | None = None,
    *,
    has_damping: bool = True,
    forces: FloatArray | None = None,
) -> tuple[sp.csr_matrix, sp.csr_matrix, FloatArray, sp.csr_matrix | None, sp.csr_matrix | None]:
    """Return M, K, the lumped mass, C and the geometric stiffness of lines, held dofs included.

    The lumped mass is ρA h/2 for u and ρA h³/78 for phi at each end of a cell.

    Args:
        case: the case.
        comm: communicator that shares the assembly.
        lines: x of the nodes of each line, shape (n_nodes,) [m]; all lines lie on one mesh.
        section: EI [N m2] and ρA [kg/m] of each line.
        axial: EA [N] and ζ [m] of lines with an axial field, which have no C; None: each line is a
            lamina of its own.
        has_damping: whether C follows from the modes of each lamina, if they are known exactly.
        forces: axial forces N at both ends of the cells of all lines, shape (n_cells, 2) [N]; None:
            there are none, and no geometric stiffness.
    """
    sizes = np.array([x.size for x in lines])
    cells = np.column_stack([np.arange(sizes.sum() - 1), np.arange(1, sizes.sum())])
    within = np.delete(cells, np.cumsum(sizes)[:-1] - 1, axis=0)
    on = Hermite.on_line(comm, np.concatenate(lines), within, has_axial=axial is not None)
    of_cell = np.repeat(np.arange(sizes.size), sizes - 1)

    more = 0 if all(lamina.is_uniform for lamina in case.lamina) else VARYING_DEGREE - 2

    def coefficient(course: Course) -> Any:
        def values(cells: IntArray, x: FloatArray) -> FloatArray:
            conditions = [of_cell[cells] == i for i in range(sizes.size)]
            _, number = np.unique(cells, return_inverse=True)
            inside = (np.bincount(number, x) / np.bincount(number))[number]
            return np.select(conditions, [course(i, x, inside) for i in range(sizes.size)])

        return on.coefficient(values, COEFFICIENT_DEGREE + more)

    # a form for each rule, because ffcx 0.5 does not allow two quadrature rules in one form
    def assembled(form: Any, degree: int = BENDING_DEGREE, **rule: str) -> sp.csr_matrix:
        exact = degree if rule else degree + more
        return on.assemble(form * ufl.dx(metadata={"quadrature_degree": exact, **rule}))

    def at_ends(factor: Any) -> sp.csr_matrix:
        h = abs(ufl.Jacobian(on.mesh)[0, 0])
        ends = pair[0] * test[0] + h**2 / 39 * pair[1] * test[1]
        return assembled(factor * ends, 1, quadrature_rule="GLL")

    def inertia(factor: Any) -> sp.csr_matrix:
        if case.time.mass == "lumped":
            return at_ends(factor)
        return assembled(factor * on.value(pair) * on.value(test), MASS_DEGREE)

    pair = ufl.TrialFunction(on.space)
    test = ufl.TestFunction(on.space)
    EI, rhoA = map(coefficient, section)
    w2 = on.curvature(pair)
    v2 = on.curvature(test)
    C = None
    energy = EI * w2 * v2
    if axial is None and has_damping and all(map(case.has_exact_modes, range(len(lines)))):
        alpha, beta = (coefficient(lambda i, *x, k=k: case.rayleigh(i)[k]) for k in (0, 1))
        C = inertia(alpha * rhoA) + assembled(beta * EI * w2 * v2)
    if axial is not None:
        EA, zeta = map(coefficient, axial)
        energy += EA * (pair[2].dx(0) - zeta * w2) * (test[2].dx(0) - zeta * v2)
    geometric = None
    if forces is not None:
        x = np.concatenate(lines)

        def linear(cells: IntArray, places: FloatArray) -> FloatArray:
            start, end = x[within[cells]].T
            share = (places - start) / (end - start)
            return np.asarray((1.0 - share) * forces[cells, 0] + share * forces[cells, 1])

        N = on.coefficient(linear)
        geometric = assembled(N * on.slope(pair) * on.slope(test), AXIAL_DEGREE)
    return inertia(rhoA), assembled(energy), at_ends(rhoA).diagonal(), C, geometric


Line = tuple[Segment, Group, int]
"""A segment, a group of it, and the lamina of the group that the line stands for."""


def _stack(case: Case, unknowns: Network, comm: MPI.Intracomm) -> Structure:
    """Assemble a bonded stack: each lamina of every segment is a line, and all are tied (N1)."""
    if not unknowns.is_uniform:
        return _varying_stack(case, unknowns, comm)
    lines = [(segment, group, i) for segment, group in unknowns.groups() for i in group]
    laminae = [unknowns.laminae[i] for _, _, i in lines]
    zeta = [float(unknowns.middles[i]) - unknowns.neutral_axis(group) for _, group, i in lines]
    N = stack_forces(case, unknowns)
    M, K, lumped, _, geometric = _matrices(
        case,
        comm,
        [unknowns.x[segment.nodes] for segment, _, _ in lines],
        (
            lambda i, *x: laminae[i].flexural_rigidity,
            lambda i, *x: laminae[i].mass_per_length,
        ),
        (lambda i, *x: laminae[i].axial_rigidity, lambda i, *x: zeta[i]),
        forces=None if N is None else np.vstack([N[i, s.first : s.last] for s, _, i in lines]),
    )
    to = _transformation(unknowns, lines)
    of_axial = None if geometric is None else to.T @ geometric @ to
    return structure(
        case, unknowns, to.T @ M @ to, to.T @ K @ to, to.T @ lumped, geometric=of_axial
    )


def _varying_stack(case: Case, unknowns: Network, comm: MPI.Intracomm) -> Structure:
    """Assemble a bonded stack whose laminae change along x: each group of a segment is a line.

    Its axial force is constant in a segment; see `Network.stretch`.
    """
    groups = [*unknowns.groups()]
    M, K, lumped, *_ = _matrices(
        case,
        comm,
        [unknowns.x[segment.nodes] for segment, _ in groups],
        (
            lambda i, *x: unknowns.flexural_rigidity_at(groups[i][1], *x),
            lambda i, *x: unknowns.mass_per_length_at(groups[i][1], *x),
        ),
        has_damping=False,
    )
    rows = [
        unknowns.row(node, group[0], k)
        for segment, group in groups
        for node in segment.nodes
        for k in (0, 1)
    ]
    to = unknowns.matrix(rows)
    stiffness = to.T @ K @ to
    for segment, group in groups:
        stretch, compliance = unknowns.stretch(segment, group)
        stiffness = stiffness + stretch.T @ stretch / compliance
    return structure(case, unknowns, to.T @ M @ to, stiffness, to.T @ lumped)


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
