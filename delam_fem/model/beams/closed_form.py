"""Assemble the laminae from closed-form beam element matrices, without dolfinx.

The module needs only NumPy and SciPy, so sweeps and ladders start fast. The matrices equal those of
the weak forms in `beam.py` to round-off. `reference/matrices.py` checks both.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp

from delam_fem.case.definition import Case
from delam_fem.case.sections import Lamina
from delam_fem.case.toml import CaseError
from delam_fem.model.beams.bonded import structure
from delam_fem.model.beams.laminae import clamped_laminae, completed, gap_at_rest, pair_weights
from delam_fem.model.beams.masses import with_masses
from delam_fem.model.beams.network import Group, Network, Segment, network
from delam_fem.model.layout import Structure
from delam_fem.model.mesh import node_coordinates, require_edges
from delam_fem.model.operators import BaseCoupling, Operators
from delam_fem.model.pairing import gap_matrix, probe_rows
from delam_fem.numerics.arrays import FloatArray, IntArray

CLAMP_U, CLAMP_PHI = 0, 1
"""Dofs of the clamped node. One lamina's dofs run node by node from the clamp, u before phi."""


def assemble(case: Case, x: npt.ArrayLike | None = None) -> Structure:
    """Assemble the case from closed-form element matrices.

    Args:
        case: the case; its mesh gives the number of elements unless x is given.
        x: positions of the nodes from 0 to the length, shape (n_nodes,) [m]; None: uniform.

    Returns:
        Operators and layout.

    Raises:
        CaseError: the mesh is a file and x is not given, or x does not run from 0 to the length.
    """
    x = _nodes(case, x)
    if not case.is_apart:
        return _stack(case, network(case, x))
    beams = [Beam.of(lamina, np.diff(x)) for lamina in case.lamina]
    damping = [case.rayleigh(i) for i in range(len(beams))]
    is_lumped = case.time.mass == "lumped"
    M = [sp.diags(beam.lumped_mass, format="csr") if is_lumped else beam.mass for beam in beams]
    K = [beam.stiffness for beam in beams]
    C = [alpha * m + beta * k for (alpha, beta), m, k in zip(damping, M, K, strict=True)]
    EI = np.stack([beam.flexural_rigidity for beam in beams])
    rhoA = np.stack([beam.mass_per_length for beam in beams])
    layout, mass = clamped_laminae(case, x, EI, rhoA), _free_block(M)
    operators = Operators(
        mass=mass,
        damping=_free_block(C),
        stiffness=_free_block(K),
        lumped_mass=np.concatenate([beam.lumped_mass[CLAMP_PHI + 1 :] for beam in beams]),
        base=BaseCoupling(
            mass=_base_column(M),
            damping=_base_column(C),
            stiffness=_base_column(K),
            corner=(_base_corner(M), _base_corner(C), _base_corner(K)),
        ),
        gap_matrix=gap_matrix(layout.parts, layout.interfaces, mass.shape[0]),
        gap0=gap_at_rest(case, layout),
        pair_weights=pair_weights(case, layout),
        probes=probe_rows(layout, mass.shape[0]),
    )
    return completed(with_masses(Structure(operators, layout), case), case)


def _stack(case: Case, stack: Network) -> Structure:
    """Assemble a bonded stack: every group of a segment is one beam about its neutral axis."""
    sizes = (stack.n_columns, stack.n_columns)
    mass, stiffness = sp.csr_matrix(sizes), sp.csr_matrix(sizes)
    lumped = np.zeros(stack.n_columns)
    for segment, group in stack.groups():
        nodes = segment.nodes
        h = np.diff(stack.x[nodes])
        EI, rhoA, EA = stack.section(group)
        beam = Beam.uniform(EI, rhoA, h)
        to = _chain(stack, nodes, group[0])
        stretch = _stretch(stack, segment, group)
        mass = mass + to.T @ beam.mass @ to
        stiffness = stiffness + to.T @ beam.stiffness @ to + EA / h.sum() * stretch.T @ stretch
        lumped += to.T @ beam.lumped_mass  # each column of `to` picks a single dof
    return structure(case, stack, mass, stiffness, lumped)


def _chain(stack: Network, nodes: IntArray, lamina: int) -> sp.csr_matrix:
    """Return the matrix from the unknowns to (w, w') along the nodes of a segment."""
    rows = sp.lil_matrix((2 * nodes.size, stack.n_columns))
    for k, node in enumerate(nodes):
        for component in (0, 1):
            for column, factor in stack.row(node, lamina, component):
                rows[2 * k + component, column] += factor
    return rows.tocsr()


def _stretch(stack: Network, segment: Segment, group: Group) -> sp.csr_matrix:
    """Return the row from the unknowns to the elongation of a group in a segment."""
    row = sp.lil_matrix((1, stack.n_columns))
    for node, sign in ((segment.first, -1.0), (segment.last, 1.0)):
        for column, factor in stack.axial_row(node, group):
            row[0, column] += sign * factor
    return row.tocsr()


def element_stiffness(flexural_rigidity: npt.ArrayLike, h: npt.ArrayLike) -> FloatArray:
    """Return the stiffness of cubic Hermite beam elements with dofs (u, phi) at both ends.

        K = integral of EI N'' N''^T

    Args:
        flexural_rigidity: EI per element, shape (n,) [N m2].
        h: lengths of the elements, shape (n,) [m].

    Returns:
        Element matrices, shape (n, 4, 4) [N/m, N, N m].

    Source: Przemieniecki, "Theory of Matrix Structural Analysis", ch. 5.
    """
    numbers = np.array(
        [
            [12.0, 6.0, -12.0, 6.0],
            [6.0, 4.0, -6.0, 2.0],
            [-12.0, -6.0, 12.0, -6.0],
            [6.0, 2.0, -6.0, 4.0],
        ]
    )
    return _scaled(numbers, np.asarray(flexural_rigidity) / np.asarray(h) ** 3, h)


def element_mass(mass_per_length: npt.ArrayLike, h: npt.ArrayLike) -> FloatArray:
    """Return the consistent mass of cubic Hermite beam elements with dofs (u, phi) at both ends.

        M = integral of rho A N N^T

    Args:
        mass_per_length: rho A per element, shape (n,) [kg/m].
        h: lengths of the elements, shape (n,) [m].

    Returns:
        Element matrices, shape (n, 4, 4) [kg, kg m, kg m2].

    Source: Przemieniecki, "Theory of Matrix Structural Analysis", ch. 11.
    """
    numbers = np.array(
        [
            [156.0, 22.0, 54.0, -13.0],
            [22.0, 4.0, 13.0, -3.0],
            [54.0, 13.0, 156.0, -22.0],
            [-13.0, -3.0, -22.0, 4.0],
        ]
    )
    return _scaled(numbers, np.asarray(mass_per_length) * np.asarray(h) / 420.0, h)


def element_lumped_mass(mass_per_length: npt.ArrayLike, h: npt.ArrayLike) -> FloatArray:
    """Return the diagonals of the lumped element masses.

    Each end has rho A h/2 for u and rho A h^3/78 for phi.

    Args:
        mass_per_length: rho A per element, shape (n,) [kg/m].
        h: lengths of the elements, shape (n,) [m].

    Returns:
        Diagonals, shape (n, 4) [kg, kg m2].
    """
    m, h = np.asarray(mass_per_length, dtype=np.float64), np.asarray(h, dtype=np.float64)
    return np.stack([m * h / 2.0, m * h**3 / 78.0] * 2, axis=-1)


@dataclass(frozen=True)
class Beam:
    """One lamina with its clamped dofs; N = 2 n_nodes dofs."""

    flexural_rigidity: FloatArray  # (n,) [N m2]
    mass_per_length: FloatArray  # (n,) [kg/m]
    mass: sp.csr_matrix  # (N, N)
    stiffness: sp.csr_matrix  # (N, N)
    lumped_mass: FloatArray  # (N,)

    @classmethod
    def of(cls, lamina: Lamina, h: FloatArray) -> Beam:
        """Assemble a lamina from elements of lengths h, shape (n,) [m]."""
        return cls.uniform(lamina.flexural_rigidity, lamina.mass_per_length, h)

    @classmethod
    def uniform(cls, EI: float, rhoA: float, h: FloatArray) -> Beam:
        """Assemble a uniform beam of stiffness EI [N m2] and mass ρA [kg/m]; see `of`."""
        rigidity = np.full(h.size, EI)
        mass_per_length = np.full(h.size, rhoA)
        ends = element_lumped_mass(mass_per_length, h)
        lumped = np.zeros(2 * h.size + 2)
        lumped[:-2] += ends[:, :2].ravel()
        lumped[2:] += ends[:, 2:].ravel()
        return cls(
            flexural_rigidity=rigidity,
            mass_per_length=mass_per_length,
            mass=sum_elements(element_mass(mass_per_length, h)),
            stiffness=sum_elements(element_stiffness(rigidity, h)),
            lumped_mass=lumped,
        )


def sum_elements(elements: FloatArray) -> sp.csr_matrix:
    """Assemble a chain of element matrices, shape (n, 4, 4), into one matrix of 2 (n + 1) dofs."""
    n = len(elements)
    dofs = 2 * np.arange(n)[:, None] + np.arange(4)  # (n, 4)
    rows, columns = np.repeat(dofs, 4, axis=1), np.tile(dofs, 4)
    entries = elements.reshape(n, 16)
    return sp.csr_matrix((entries.ravel(), (rows.ravel(), columns.ravel())), shape=(2 * n + 2,) * 2)


def _nodes(case: Case, x: npt.ArrayLike | None) -> FloatArray:
    length = case.lamina[0].length
    if x is None:
        if case.mesh.elements is None:
            raise CaseError(
                "mesh.file: the closed form reads no mesh files; expected mesh.elements, or the "
                f"positions of the nodes as x; given {case.mesh.file}"
            )
        return node_coordinates(case)
    nodes = np.asarray(x, dtype=np.float64)
    if nodes[0] != 0.0 or abs(nodes[-1] - length) > 1e-9 * length:
        raise CaseError(
            f"x: the nodes must run from 0 to the length {length:g} m, "
            f"given {nodes[0]:g} to {nodes[-1]:g} m"
        )
    require_edges(case, nodes, "x")
    return nodes


def _scaled(numbers: FloatArray, factor: FloatArray, h: npt.ArrayLike) -> FloatArray:
    """Multiply pure numbers by the factor, and by h for each slope dof in the row or column."""
    ones = np.ones_like(h, dtype=np.float64)
    units = np.stack([ones, np.asarray(h, dtype=np.float64)] * 2, axis=-1)  # (n, 4)
    scaled: FloatArray = (
        factor[..., None, None] * numbers * units[..., :, None] * units[..., None, :]
    )
    return scaled


def _free_block(laminae: list[sp.csr_matrix]) -> sp.csr_matrix:
    """Return the matrix of the free dofs of both laminae."""
    free = slice(CLAMP_PHI + 1, None)
    return sp.block_diag([matrix[free, free] for matrix in laminae], format="csr")


def _base_column(laminae: list[sp.csr_matrix]) -> FloatArray:
    """Return the forces on the free dofs per unit motion of both clamps (paper eq. 9)."""
    return np.concatenate(
        [matrix[CLAMP_PHI + 1 :, CLAMP_U].toarray().ravel() for matrix in laminae]
    )


def _base_corner(laminae: list[sp.csr_matrix]) -> float:
    """Return the force on the base, from both laminae, per unit motion of the base."""
    return float(sum(matrix[CLAMP_U, CLAMP_U] for matrix in laminae))
