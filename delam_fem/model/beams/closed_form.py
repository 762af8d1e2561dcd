"""Assemble laminae from closed-form beam element matrices, without dolfinx.

The module needs only NumPy and SciPy, so sweeps and ladders start fast. The matrices equal those of
the weak forms in `forms.py` to round-off. `reference/matrices.py` checks both.

One lamina over rigid ground, where each contact pair is a node and a point that never moves.

    gap_k = u_k + s_k,   H has one entry, 1, in each row,   g0 = s

The ground touches the straight, unstressed lamina along its whole length, or at its tip only. u
counts upwards from the shape s <= 0 in which the lamina would hang under its weight if there were
no ground, so the equation of motion has no load. Laws and schemes see the same `Operators` as with
two laminae.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp

from delam_fem.case.definition import Case
from delam_fem.case.sections import Lamina
from delam_fem.model.beams import axial
from delam_fem.model.beams.network import (
    Group,
    Network,
    Segment,
    clamped_laminae,
    network,
    side_by_side,
    structure,
)
from delam_fem.model.layout import Structure, selection
from delam_fem.model.mesh import node_coordinates, require_edges
from delam_fem.model.operators import BaseCoupling, Operators
from delam_fem.numerics import harmonics
from delam_fem.numerics.beams import cantilever_mode, cantilever_roots
from delam_fem.numerics.types import FloatArray, IntArray
from delam_fem.system.errors import CaseError


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
    if case.is_axial:
        return axial.assemble(case, x)
    if not case.is_apart:
        return _stack(case, network(case, x))
    beams = [Beam.of(lamina, np.diff(x), at_middles=case.is_at_middles) for lamina in case.lamina]
    damping = [case.rayleigh(i) for i in range(len(beams))]
    is_lumped = case.time.mass == "lumped"
    M = [sp.diags(beam.lumped_mass, format="csr") if is_lumped else beam.mass for beam in beams]
    K = [beam.stiffness for beam in beams]
    C = [alpha * m + beta * k for (alpha, beta), m, k in zip(damping, M, K, strict=True)]
    EI = np.stack([beam.flexural_rigidity for beam in beams])
    rhoA = np.stack([beam.mass_per_length for beam in beams])
    matrices = [sp.block_diag(own) for own in (M, C, K)]
    lumped = np.concatenate([beam.lumped_mass for beam in beams])
    return side_by_side(case, clamped_laminae(case, x, EI, rhoA), matrices, lumped)


def _stack(case: Case, stack: Network) -> Structure:
    """Assemble a bonded stack: every group of a segment is one beam about its neutral axis."""
    sizes = (stack.n_columns, stack.n_columns)
    mass, stiffness = sp.csr_matrix(sizes), sp.csr_matrix(sizes)
    lumped = np.zeros(stack.n_columns)
    for segment, group in stack.groups():
        nodes = segment.nodes
        h = np.diff(stack.x[nodes])
        EI, rhoA, EA = stack.section(group)
        beam = Beam.uniform(
            EI, rhoA, h, at_middles=case.is_at_middles, is_tied=stack.ties(segment, case)
        )
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


def middle_masses(masses: FloatArray, h: FloatArray, *, is_tied: bool = False) -> FloatArray:
    """Return masses at the middles of a chain of elements, whose nodes have none.

    An element's mass at its middle lacks the moment of inertia m h^2/12. The element and its
    neighbours, at an end of the chain the next two, exchange mass that makes up for it:

        sum m = mass,   sum m x = first moment,   sum m x^2 = moment of inertia             (M3)

    of the chain, and natural frequencies converge at order 4. Fewer than 3 elements keep the first
    two. A chain of n elements that is held or bonded at both ends has n - 1 nodes that may touch
    and 2 n - 2 dofs. With n masses n - 2 motions without mass are left, one too few; the element in
    the middle therefore gives its mass to its next ones, with M3.

    Args:
        masses: of the elements, shape (n,) [kg].
        h: lengths of the elements, shape (n,) [m].
        is_tied: whether both ends are held or bonded.

    Returns:
        Masses, shape (n,) [kg].

    Raises:
        CaseError: the lengths of neighbours differ so much that a mass is negative.
    """
    result, x, n = masses.copy(), np.cumsum(h) - 0.5 * h, h.size
    for i, missing in enumerate(masses * h**2 / 12.0 if n > 2 else ()):
        k = min(max(i, 1), n - 2)
        left, right = x[k] - x[k - 1], x[k + 1] - x[k]
        shares = np.array([1.0 / left, -1.0 / left - 1.0 / right, 1.0 / right])
        result[k - 1 : k + 2] += missing / (left + right) * shares
    if is_tied and n > 2:
        k = n // 2
        near = np.setdiff1d(np.arange(max(k - 2, 0), min(k + 3, n)), k)
        powers = np.vander((x[near] - x[k]) / h[k], increasing=True).T
        result[near] += result[k] * np.linalg.solve(powers, np.eye(near.size)[0])
        result[k] = 0.0
    if result.min() < 0.0:
        raise CaseError(
            'mesh: expected neighbouring elements of similar lengths with time.mass = "massless", '
            f"given {h.min():g} to {h.max():g} m"
        )
    return result


@dataclass(frozen=True)
class Beam:
    """One lamina with its clamped dofs; N = 2 n_nodes dofs."""

    flexural_rigidity: FloatArray  # (n,) [N m2]
    mass_per_length: FloatArray  # (n,) [kg/m]
    mass: sp.csr_matrix  # (N, N)
    stiffness: sp.csr_matrix  # (N, N)
    lumped_mass: FloatArray  # (N,)

    @classmethod
    def of(cls, lamina: Lamina, h: FloatArray, *, at_middles: bool = False) -> Beam:
        """Assemble a lamina from elements of lengths h, shape (n,) [m]; see `uniform`."""
        EI, rhoA = lamina.flexural_rigidity, lamina.mass_per_length
        return cls.uniform(EI, rhoA, h, at_middles=at_middles)

    @classmethod
    def uniform(
        cls,
        EI: float,
        rhoA: float,
        h: FloatArray,
        *,
        at_middles: bool = False,
        is_tied: bool = False,
    ) -> Beam:
        """Assemble a uniform beam of stiffness EI [N m2] and mass ρA [kg/m].

        Its mass is consistent, or at the middles of the elements; see `middle_masses`.
        """
        rigidity = np.full(h.size, EI)
        mass_per_length = np.full(h.size, rhoA)
        ends = element_lumped_mass(mass_per_length, h)
        lumped = np.zeros(2 * h.size + 2)
        lumped[:-2] += ends[:, :2].ravel()
        lumped[2:] += ends[:, 2:].ravel()
        mass = element_mass(mass_per_length, h)
        if at_middles:  # N N^T with N = (1/2, h/8, 1/2, -h/8), the interpolants at the middle
            N = np.outer([0.5, 0.125, 0.5, -0.125], [0.5, 0.125, 0.5, -0.125])
            mass = _scaled(N, middle_masses(mass_per_length * h, h, is_tied=is_tied), h)
        return cls(
            flexural_rigidity=rigidity,
            mass_per_length=mass_per_length,
            mass=sum_elements(mass),
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


Touching = Literal["everywhere", "tip"]
"""The nodes that can touch the ground."""
Lift = Literal["tip force", "uniform load", "first mode"]
"""The load that holds the lamina up before it is released."""

N_CLAMP = 2
"""Number of dofs of the clamped node; they are removed."""
GRAVITY = 9.81
"""Acceleration of gravity [m/s2]."""
_BELOW = 1e-9
"""A lifted shape may lie this deep below the ground: round-off, relative to the tip's height."""


def steel_strip(
    frequency: float = 20.0,
    *,
    length: float | None = None,
    thickness: float = 0.003,
    width: float = 0.040,
    damping_ratio: float = 0.0,
) -> Lamina:
    """Return a steel strip (E = 2.1e11 Pa, 7850 kg/m3) with a given lowest frequency.

    The paper gives only the lowest period, about 50 ms; thickness and width are our choice.

    Args:
        frequency: frequency of the first mode as a cantilever [Hz].
        length: length of the strip; if given, it replaces the frequency [m].
        thickness: thickness of the strip [m].
        width: width of the strip [m].
        damping_ratio: D of modes 1 and 2 [-].
    """
    young_modulus, density = 2.1e11, 7850.0
    kappa = thickness * math.sqrt(young_modulus / (12.0 * density))
    fitting = float(cantilever_roots(1)[0]) * math.sqrt(kappa / (2.0 * math.pi * frequency))
    return Lamina(
        name="steel",
        length=length or fitting,
        width=width,
        thickness=thickness,
        density=density,
        young_modulus=young_modulus,
        damping_ratio=damping_ratio,
    )


def nodes(lamina: Lamina, n: int) -> FloatArray:
    """Return the positions of the free nodes of n elements, shape (n,) [m]."""
    return lamina.length * np.arange(1, n + 1) / n


def sag(lamina: Lamina, gravity: float) -> float:
    """Return how far the tip would hang down if there were no ground, ρA g L⁴/(8 EI) [m].

    Args:
        lamina: the strip.
        gravity: g [m/s2].
    """
    weight = lamina.mass_per_length * gravity
    return weight * lamina.length**4 / (8.0 * lamina.flexural_rigidity)


def on_ground(
    lamina: Lamina,
    n: int,
    touching: Touching,
    observed: Sequence[int] | IntArray | None = None,
    *,
    gravity: float = 0.0,
) -> Operators:
    """Return the operators of n Hermite elements, clamped at x = 0, over the ground.

    The free dofs run node by node from the clamp to the tip, u before φ. Rayleigh damping gives
    modes 1 and 2 the damping ratio of the lamina.

    Args:
        lamina: the strip.
        n: number of elements, at least 2.
        touching: which nodes are contact pairs.
        observed: dofs that the probes record; None: u of the tip.
        gravity: g [m/s2]; 0: a strip without weight.

    Raises:
        ValueError: n is below 2.
    """
    if n < 2:
        raise ValueError(f"lamina over ground: expected at least 2 elements, given {n}")
    beam = Beam.of(lamina, np.full(n, lamina.length / n))
    M, K = (matrix[N_CLAMP:, N_CLAMP:].tocsr() for matrix in (beam.mass, beam.stiffness))
    first, second = lamina.angular_frequencies(2).tolist()
    alpha, beta = harmonics.coefficients(lamina.damping_ratio, first, second)
    pairs = np.arange(n) if touching == "everywhere" else np.array([n - 1])
    entries = np.ones(pairs.size), (np.arange(pairs.size), 2 * pairs)
    return Operators(
        mass=M,
        damping=sp.csr_matrix(alpha * M + beta * K),
        stiffness=K,
        lumped_mass=beam.lumped_mass[N_CLAMP:],
        base=BaseCoupling.none(2 * n),
        gap_matrix=sp.csr_matrix(entries, shape=(pairs.size, 2 * n)),
        gap0=-lying(lamina, n, gravity)[2 * pairs],
        probes=selection([2 * n - 2] if observed is None else observed, 2 * n),
    )


def lying(lamina: Lamina, n: int, gravity: float) -> FloatArray:
    """Return the shape on the ground, measured from the hanging shape, u and φ, shape (2 n,)."""
    return _shape(lamina, n, "uniform load", sag(lamina, gravity))


def lifted(lamina: Lamina, n: int, tip: float, by: Lift, *, gravity: float = 0.0) -> FloatArray:
    """Return the shape in which the lamina is held up, u and φ of the free dofs, shape (2 n,).

    Args:
        lamina: the strip.
        n: number of elements.
        tip: height of the tip above the ground [m].
        by: the load that holds the lamina, besides its weight.
        gravity: g [m/s2]; 0: a strip without weight.

    Raises:
        ValueError: the weight would keep a part of the strip on the ground.
    """
    hanging = sag(lamina, gravity)
    u = _shape(lamina, n, by, tip + hanging)
    height = u - lying(lamina, n, gravity)
    if height[::2].min() < -_BELOW * tip:
        raise ValueError(
            f"height of the tip: expected enough to lift the whole strip off the ground (a third "
            f"of its sag of {hanging:g} m with a force at the tip), given {tip:g} m"
        )
    return u


def _shape(lamina: Lamina, n: int, by: Lift, tip: float) -> FloatArray:
    """Return the shape of a cantilever without weight under the load `by`, u and φ."""
    xi = nodes(lamina, n) / lamina.length
    if by == "tip force":
        u, slope = (3.0 * xi**2 - xi**3) / 2.0, (6.0 * xi - 3.0 * xi**2) / 2.0
    elif by == "uniform load":
        u = (6.0 * xi**2 - 4.0 * xi**3 + xi**4) / 3.0
        slope = (12.0 * xi - 12.0 * xi**2 + 4.0 * xi**3) / 3.0
    else:
        step = 1e-4  # the error of the central difference, step² B⁴ / 6, is 2e-8
        u = cantilever_mode(1, xi)
        inside = np.minimum(xi, 1.0 - step)  # the curvature is 0 at the tip
        ends = cantilever_mode(1, inside + step) - cantilever_mode(1, inside - step)
        slope = ends / (2.0 * step)
    return np.ravel(np.column_stack([tip * u, tip / lamina.length * slope]))


def strain_rows(lamina: Lamina, n: int, gauges: npt.ArrayLike) -> sp.csr_matrix:
    """Return the matrix that maps the dofs to the bending strain ε = (t/2) u″ at gauges.

    Args:
        lamina: the strip.
        n: number of elements.
        gauges: positions of the gauges from the clamp, shape (k,) [m].

    Returns:
        Matrix, shape (k, 2 n); positive strain is tension on the side of the ground.

    Raises:
        ValueError: a gauge is not on the strip.
    """
    h, half = lamina.length / n, 0.5 * lamina.thickness
    rows = sp.lil_matrix((np.size(gauges), N_CLAMP + 2 * n))
    for row, x in enumerate(np.atleast_1d(np.asarray(gauges, dtype=np.float64))):
        if not 0.0 <= x <= lamina.length:
            raise ValueError(f"gauge: expected a place from 0 to {lamina.length:g} m, given {x:g}")
        cell = min(int(x / h), n - 1)
        X = x / h - cell
        weights = [12.0 * X - 6.0, h * (6.0 * X - 4.0), 6.0 - 12.0 * X, h * (6.0 * X - 2.0)]
        rows[row, 2 * cell : 2 * cell + 4] = half / h**2 * np.array(weights)
    return rows.tocsr()[:, N_CLAMP:]
