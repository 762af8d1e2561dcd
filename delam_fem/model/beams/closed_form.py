"""Assemble laminae from closed-form beam element matrices, without dolfinx.

The module needs only NumPy and SciPy, so sweeps and refinement studies start fast. The matrices
equal those of the weak forms in `forms.py` to round-off. `reference/matrices.py` checks both.

Bars and points do not bend (`axial`). A bar stretches, E A u'' = ρ A ü, in linear elements. A point
is a mass on a spring and a damper,

    m u'' + c (u' - q') + k (u - q) = contact,   c = 2 D √(k m)

a bar of one element whose mass is at its end. Nodes are held against turning; between them
displacements are straight.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp

from delam_fem.case.definition import Case
from delam_fem.model.beams.network import (
    Network,
    apart_forces,
    apart_parts,
    hermite,
    hermite_curvature,
    network,
    own_points,
    side_by_side,
    stack_forces,
    structure,
    unit_gauss,
)
from delam_fem.model.layout import Structure
from delam_fem.model.loads import GAUSS
from delam_fem.model.mesh import node_coordinates, require_edges
from delam_fem.numerics.types import FloatArray
from delam_fem.system.errors import CaseError


def assemble(case: Case, x: npt.ArrayLike | None = None) -> Structure:
    """Assemble the laminae of a case from closed-form element matrices.

    Args:
        case: the case.
        x: positions of the nodes from 0 to the length, shape (n_nodes,) [m]; None: its mesh.

    Returns:
        Operators and layout.

    Raises:
        CaseError: the mesh is not usable, or x does not run from 0 to the length.
    """
    x = node_coordinates(case) if x is None else _nodes(case, x)
    if case.is_axial:
        return axial(case, x)
    if not case.is_apart:
        return _stack(case, network(case, x))
    lines = [own_points(case, i, x) for i in range(len(case.lamina))]
    masses = {
        "at_middles": case.is_at_middles,
        "is_tied": case.support.holds("start") and case.support.holds("end"),
    }
    geometric = None
    forces = apart_forces(case, x)
    if forces is not None:
        geometric = sp.block_diag(
            [
                sum_elements(element_geometric(N[: line.size - 1], np.diff(line)))
                for N, line in zip(forces, lines, strict=True)
            ]
        )
    M, K, lumped = zip(
        *(
            beam(lamina.flexural_rigidity, lamina.mass_per_length, np.diff(line), **masses)
            if lamina.is_uniform
            else varying_beam(
                lamina.flexural_rigidity_at, lamina.mass_per_length_at, line, **masses
            )
            for lamina, line in zip(case.lamina, lines, strict=True)
        ),
        strict=True,
    )
    return side_by_side(
        case,
        apart_parts(case, x),
        (sp.block_diag(M), sp.block_diag(K)),
        np.concatenate(lumped),
        geometric=geometric,
    )


def _stack(case: Case, stack: Network) -> Structure:
    """Assemble a bonded stack: every group of a segment is one beam about its neutral axis."""
    sizes = (stack.n_columns, stack.n_columns)
    mass = sp.csr_matrix(sizes)
    stiffness = sp.csr_matrix(sizes)
    lumped = np.zeros(stack.n_columns)
    geometric = None
    forces = stack_forces(case, stack)
    for segment, group in stack.groups():
        x = stack.x[segment.nodes]
        h = np.diff(x)
        how = {"at_middles": case.is_at_middles, "is_tied": stack.ties(segment, case)}
        if stack.is_uniform:
            EI, rhoA, EA = stack.section(group)
            M, K, masses = beam(EI, rhoA, h, **how)
            ends = stack.matrix(
                [stack.axial_row(node, group) for node in (segment.first, segment.last)]
            )
            stretch = ends[1] - ends[0]
            of_stretch = EA / h.sum() * stretch.T @ stretch
        else:
            M, K, masses = varying_beam(
                partial(stack.flexural_rigidity_at, group),
                partial(stack.mass_per_length_at, group),
                x,
                **how,
            )
            stretch, compliance = stack.stretch(segment, group)
            of_stretch = stretch.T @ stretch / compliance
        # from the unknowns to (w, w') along the nodes
        to = stack.matrix([stack.row(node, group[0], k) for node in segment.nodes for k in (0, 1)])
        mass = mass + to.T @ M @ to
        stiffness = stiffness + to.T @ K @ to + of_stretch
        lumped += to.T @ masses  # each column of `to` picks a single dof
        if forces is not None:
            N = forces[list(group), segment.first : segment.last].sum(axis=0)
            of_group = to.T @ sum_elements(element_geometric(N, h)) @ to
            geometric = of_group if geometric is None else geometric + of_group
    return structure(case, stack, mass, stiffness, lumped, geometric=geometric)


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


def element_geometric(forces: FloatArray, h: FloatArray) -> FloatArray:
    """Return the geometric stiffness of beam elements with linear axial forces, shape (n, 4, 4).

        K = integral of N (dN/dx) (dN/dx)^T

    Args:
        forces: axial forces at both ends, shape (n, 2) [N].
        h: lengths of the elements, shape (n,) [m].
    """
    X = 0.5 + 0.5 * GAUSS[0]  # four points are exact for polynomials of degree 7
    weights = 0.5 * GAUSS[1]
    slopes = np.array([
        6.0 * (X**2 - X), 1.0 - 4.0 * X + 3.0 * X**2, 6.0 * (X - X**2), 3.0 * X**2 - 2.0 * X
    ])  # fmt: skip
    first = (slopes * weights * (1.0 - X)) @ slopes.T
    last = (slopes * weights * X) @ slopes.T
    start, end = forces.T / h
    return _scaled(first, start, h) + _scaled(last, end, h)


def element_lumped_mass(mass_per_length: npt.ArrayLike, h: npt.ArrayLike) -> FloatArray:
    """Return the diagonals of the lumped element masses.

    Each end has rho A h/2 for u and rho A h^3/78 for phi.

    Args:
        mass_per_length: rho A per element, shape (n,) [kg/m].
        h: lengths of the elements, shape (n,) [m].

    Returns:
        Diagonals, shape (n, 4) [kg, kg m2].
    """
    m = np.asarray(mass_per_length, dtype=np.float64)
    h = np.asarray(h, dtype=np.float64)
    return np.stack([m * h / 2.0, m * h**3 / 78.0] * 2, axis=-1)


def middle_masses(
    masses: FloatArray, h: FloatArray, *, is_tied: bool = False, has_inertia: bool = False
) -> FloatArray:
    """Return masses at the middles of a chain of elements, whose nodes have none.

    An element's mass at its middle lacks the moment of inertia m h^2/12. The element and its
    neighbours, at an end of the chain the next two, exchange mass that makes up for it:

        sum m = mass,   sum m x = first moment,   sum m x^2 = moment of inertia             (M3)

    of the chain, and natural frequencies converge at order 4. Fewer than 3 elements keep only the
    first two sums. A chain of n elements that is held or bonded at both ends has n - 1 nodes that
    may touch and 2 n - 2 dofs. With n masses n - 2 motions without mass are left, one too few; the
    element in the middle therefore gives its mass to its next ones, with M3.

    Args:
        masses: of the elements, shape (n,) [kg].
        h: lengths of the elements, shape (n,) [m].
        is_tied: whether both ends are held or bonded.
        has_inertia: whether the masses have their moments of inertia already.

    Returns:
        Masses, shape (n,) [kg].

    Raises:
        CaseError: the lengths of neighbours differ so much that a mass is negative.
    """
    result = masses.copy()
    x = np.cumsum(h) - 0.5 * h
    n = h.size
    for i, missing in enumerate(masses * h**2 / 12.0 if n > 2 and not has_inertia else ()):
        k = min(max(i, 1), n - 2)
        left = x[k] - x[k - 1]
        right = x[k + 1] - x[k]
        # no mass and no first moment; the second moment about the middle one is left + right
        shares = np.array([1.0 / left, -1.0 / left - 1.0 / right, 1.0 / right])
        result[k - 1 : k + 2] += missing / (left + right) * shares
    if is_tied and n > 2:
        k = n // 2
        near = np.setdiff1d(np.arange(max(k - 2, 0), min(k + 3, n)), k)
        # weights with the sums of a unit mass at x_k: 1, and 0 for all further powers of x - x_k
        powers = np.vander((x[near] - x[k]) / h[k], increasing=True).T
        result[near] += result[k] * np.linalg.solve(powers, np.eye(near.size)[0])
        result[k] = 0.0
    if result.min() < 0.0:
        raise CaseError(
            'mesh: expected neighbouring elements of similar lengths with time.mass = "massless", '
            f"given {h.min():g} to {h.max():g} m"
        )
    return result


def beam(
    EI: float, rhoA: float, h: FloatArray, *, at_middles: bool = False, is_tied: bool = False
) -> tuple[sp.csr_matrix, sp.csr_matrix, FloatArray]:
    """Return M, K and the diagonal of the lumped mass of a uniform beam, held dofs included.

    The mass is consistent, or at the middles of the elements; see `middle_masses`.

    Args:
        EI: bending stiffness [N m2].
        rhoA: mass per length [kg/m].
        h: lengths of the elements, shape (n,) [m]; there are N = 2 (n + 1) dofs.
        at_middles: whether the mass is at the middles of the elements.
        is_tied: whether both ends are held or bonded.
    """
    ends = element_lumped_mass(rhoA, h)
    lumped = np.zeros(2 * h.size + 2)
    lumped[:-2] += ends[:, :2].ravel()
    lumped[2:] += ends[:, 2:].ravel()
    mass = element_mass(rhoA, h)
    if at_middles:  # N N^T with N = (1/2, h/8, 1/2, -h/8), the interpolants at the middle
        N = np.outer([0.5, 0.125, 0.5, -0.125], [0.5, 0.125, 0.5, -0.125])
        mass = _scaled(N, middle_masses(rhoA * h, h, is_tied=is_tied), h)
    return sum_elements(mass), sum_elements(element_stiffness(EI, h)), lumped


def varying_beam(
    EI: Course, rhoA: Course, x: FloatArray, *, at_middles: bool = False, is_tied: bool = False
) -> tuple[sp.csr_matrix, sp.csr_matrix, FloatArray]:
    """Return M, K and the diagonal of the lumped mass of a beam whose section changes.

    Five Gauss points an element are exact where E, ρ, b and h are linear in it, EI ~ E b h³ of
    degree 5. The lumped mass of each end is that of half the element with the section there.

    Args:
        EI: function (places, places inside their elements) -> bending stiffness [N m2].
        rhoA: the same of the mass per length [kg/m].
        x: nodes, shape (n + 1,) [m].
        at_middles: see `beam`.
        is_tied: see `beam`.
    """
    h = np.diff(x)
    s, w = unit_gauss()
    places = x[:-1, None] + h[:, None] * s
    N = hermite(s)
    curvature = hermite_curvature(s)
    K = np.einsum("eq,qi,qj->eij", EI(places, places) * w, curvature, curvature)
    m = rhoA(places, places) * w
    M = np.einsum("eq,qi,qj->eij", m, N, N)
    ends = np.stack([x[:-1], x[1:]], axis=1)
    middles = np.repeat(0.5 * (x[1:] + x[:-1])[:, None], 2, axis=1)
    of_ends = rhoA(ends, middles) * h[:, None]
    lumped = np.zeros(2 * x.size)
    for node in (0, 1):
        share = np.stack([of_ends[:, node] / 2.0, of_ends[:, node] * h**2 / 78.0], axis=-1).ravel()
        lumped[2 * node : lumped.size - 2 + 2 * node] += share
    mass = _scaled(M, h, h)
    if at_middles:
        middle = np.outer([0.5, 0.125, 0.5, -0.125], [0.5, 0.125, 0.5, -0.125])
        arm = (s - 0.5) * h[:, None]
        moments = h * np.array([m.sum(axis=1), (m * arm).sum(axis=1), (m * arm**2).sum(axis=1)])
        mass = _scaled(middle, varying_masses(moments, x, is_tied=is_tied), h)
    return sum_elements(mass), sum_elements(_scaled(K, 1.0 / h**3, h)), lumped


Course = Callable[[FloatArray, FloatArray], FloatArray]
"""A property along a beam: (places [m], places inside their elements [m]) -> values."""


def varying_masses(moments: FloatArray, x: FloatArray, *, is_tied: bool = False) -> FloatArray:
    """Return masses at the middles of elements of which each has a centre and an inertia; see M3.

    Args:
        moments: mass [kg], first [kg m] and second moment [kg m2] of each element about its middle,
            shape (3, n).
        x: nodes, shape (n + 1,) [m].
        is_tied: see `middle_masses`.

    Raises:
        CaseError: the lengths of neighbours differ so much that a mass is negative.
    """
    middles = 0.5 * (x[1:] + x[:-1])
    h = np.diff(x)
    n = h.size
    if n < 3:
        return np.asarray(moments[0])
    result = np.zeros(n)
    for i, of_element in enumerate(moments.T):
        k = min(max(i, 1), n - 2)
        near = np.arange(k - 1, k + 2)
        powers = np.vander((middles[near] - middles[i]) / h[i], increasing=True).T
        result[near] += np.linalg.solve(powers, of_element / h[i] ** np.arange(3))
    return middle_masses(result, h, is_tied=is_tied, has_inertia=True)


def sum_elements(elements: FloatArray) -> sp.csr_matrix:
    """Assemble a chain of element matrices, shape (n, 4, 4), into one matrix of 2 (n + 1) dofs."""
    n = len(elements)
    dofs = 2 * np.arange(n)[:, None] + np.arange(4)  # (n, 4)
    rows = np.repeat(dofs, 4, axis=1)
    columns = np.tile(dofs, 4)
    return sp.csr_matrix(
        (elements.ravel(), (rows.ravel(), columns.ravel())), shape=(2 * n + 2,) * 2
    )


def _nodes(case: Case, x: npt.ArrayLike) -> FloatArray:
    """Return positions of nodes as an array, checked against the case."""
    length = case.length
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


def _means(course: Course, x: FloatArray) -> FloatArray:
    """Return the means of a property over elements, shape (n,)."""
    s, w = unit_gauss()
    places = x[:-1, None] + np.diff(x)[:, None] * s
    values = course(places, places)
    return np.where(np.ptp(values, axis=1) > 0.0, values @ w, values[:, 0])


def axial(case: Case, x: FloatArray) -> Structure:
    """Return the operators and the layout of a case of bars or points with nodes at x [m]."""
    h = np.diff(x)
    last = x.size - 1
    count = len(case.lamina)
    start, end = (sp.eye(last, x.size, k=k, format="csr") for k in (0, 1))  # nodes of cells
    laminae = []
    lumped = []
    for lamina in case.lamina:
        masses = sp.diags(_means(lamina.mass_per_length_at, x) * h)
        k = (
            _means(lamina.axial_rigidity_at, x) / h
            if lamina.stiffness is None
            else np.array([lamina.stiffness])
        )
        diagonal = 0.5 * (start + end).T @ masses.diagonal()
        if lamina.mass is not None:
            diagonal = lamina.mass * np.eye(x.size)[last]
        M = sum(N.T @ masses @ N for N in (start, end, start + end)) / 6.0
        if lamina.mass is not None or case.time.mass == "lumped":
            M = sp.diags(diagonal)
        K = (end - start).T @ sp.diags(k) @ (end - start)
        laminae.append((M, K))
        lumped.append(diagonal)
    sections = np.zeros((2, count, last))
    sections[1] = [_means(lamina.mass_per_length_at, x) for lamina in case.lamina]
    parts = apart_parts(case, x, sections)
    straight = np.diag([1.0, 0.0])  # the slopes have no stiffness and no mass
    M, K = (sp.kron(sp.block_diag(blocks), straight) for blocks in zip(*laminae, strict=True))
    return side_by_side(case, parts, (M, K), np.kron(np.concatenate(lumped), straight[0]))
