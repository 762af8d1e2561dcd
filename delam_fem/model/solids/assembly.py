"""Assemble a case whose laminae are solids: operators and layout.

    M a + C v + K u = -(m_b q''_b + c_b q'_b + k_b q_b) + Hᵀ lambda

M and K come from the weak forms of `forms.py`, restricted to the free dofs. The damping is
Rayleigh's with the coefficients of the beam of the same case, so that models can be compared:
C = alpha_i M + beta_i K on each lamina that is apart, one pair of coefficients for a bonded stack.

What a beam has at its points, a solid reads from its middle lines (`body.py`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import scipy.sparse as sp

from delam_fem.case.definition import Case
from delam_fem.case.excitation import HarmonicExcitation
from delam_fem.model import operators as distributed
from delam_fem.model.beams import closed_form, network
from delam_fem.model.beams.network import completed, layout_of, parts_of
from delam_fem.model.layout import (
    DISPLACEMENT,
    SLOPE,
    Layout,
    Part,
    Reading,
    Structure,
    columns_of,
    place_of,
    probe_rows,
)
from delam_fem.model.linear import tied
from delam_fem.model.loads import with_load
from delam_fem.model.mesh import node_coordinates
from delam_fem.model.operators import BaseCoupling, DistributedOperators, Operators
from delam_fem.model.places import places_of_case, row_at
from delam_fem.model.solids import facing
from delam_fem.model.solids.body import (
    Body,
    middle_line,
    place_rows,
    points_along,
    reading_rows,
)
from delam_fem.model.solids.forms import SAME, Elasticity, Solid, evaluate, gathered
from delam_fem.model.solids.mesh import SolidMesh, locate
from delam_fem.model.solids.meshing import lattice, layers_of_cells, solid_mesh
from delam_fem.model.solids.unknowns import NodeColumns, Restricted, Unknowns, X, Y, held
from delam_fem.model.solids.weight import weight, with_axial_stress
from delam_fem.model.stops_sensors import StrainRows
from delam_fem.numerics import elasticity
from delam_fem.numerics.types import FloatArray, IntArray
from delam_fem.system.errors import CaseError
from delam_fem.system.mpi import MPI, hold, release

GAUSS = {2: np.array([0.5]), 3: 0.5 + np.array([-0.5, 0.5]) / np.sqrt(3.0)}
"""Places within a cell at which strains of bending are accurate, by degree."""
_INSIDE = 1e-7
"""Depth below the surface at which strains are read, in thicknesses."""


def assemble(
    case: Case, *, comm: MPI.Intracomm = MPI.COMM_SELF, needs_damping: bool = True
) -> Structure:
    """Assemble the solids of a case (collective).

    Args:
        case: the case; its model is "plane-stress" or "solid".
        comm: communicator that shares the dofs; the last rank has those of impactors.
        needs_damping: whether anything reads C; False: it is left 0.

    Raises:
        CaseError: the mesh does not fit the case, or the case asks for what solids cannot give.
    """
    hold(comm)
    is_file = case.mesh.file is not None
    mesh = solid_mesh(case) if is_file else lattice(case)
    x = points_along(case, mesh) if is_file else node_coordinates(case)
    of_bodies = whole_bodies(mesh, comm.size)
    ranks = in_plan(mesh, comm.size) if of_bodies is None else of_bodies
    solid = Solid.on(mesh, comm, case.model.degree, ranks)
    E = young_modulus(case, mesh)
    material = elasticity_of(case, mesh)
    ends = held(case, solid, E * _width(case, mesh))
    is_plain = "lumped" in (case.time.mass, case.contact.impulse)
    columns = None if is_plain else NodeColumns.of(solid, np.unique(ends.dofs // mesh.dim))
    unknowns = Unknowns.of(solid, ends, columns)
    touching, H = facing.touching(case, unknowns, x)
    layout = _layout(case, unknowns, x, touching)
    M, K, lumped = _matrices(case, unknowns, E * _width(case, mesh), material)
    M, lumped = _with_masses(M, lumped, case, layout, comm)
    springs = [*_springs(case, layout), *edge_springs(case, unknowns)]
    for row, number, k, _ in springs:
        K = _with_product(K, k, row, number, comm)
    buckling = None
    if case.has_axial_forces:
        moduli = E * _width(case, mesh), material
        density = _density(case, mesh)
        K, buckling = with_axial_stress(case, unknowns, K, moduli, density, layout)
    rayleigh = None
    if needs_damping:
        C, rayleigh = _damping(case, unknowns, M, K, H)
        for row, number, _, c in springs:
            C = _with_product(C, c, row, number, comm)
    else:
        C = Restricted(sp.csr_matrix(M.rows.shape), 0.0 * M.column, 0.0 * M.corners)
    matrices = [M, C, K]
    del M, C, K  # each is freed when PETSc has it
    operators = _operators(
        case,
        unknowns,
        layout,
        (touching, H),
        matrices,
        lumped,
        None if any(c for *_, c in springs) else rayleigh,
        of_bodies is not None,
    )
    if case.is_loaded:
        load = None
        if case.gravity is not None:
            load = weight(case, unknowns, _density(case, mesh), layout)
        operators = with_load(replace(operators, buckling_factor=buckling), layout, case, load)
    body = Body(
        solid,
        unknowns.free,
        unknowns.base,
        E,
        material,
        np.array([lamina.mean("width") for lamina in case.lamina]),
        touching,
    )
    return completed(
        Structure(operators, layout, body), case, _surface_strain(case, unknowns, layout.parts[0])
    )


def whole_bodies(mesh: SolidMesh, size: int) -> IntArray | None:
    """Return the rank of each cell if every rank gets whole bodies, otherwise None, (n_cells,).

    The largest bodies go first, each to the rank with the fewest cells.

    Args:
        mesh: the mesh.
        size: number of ranks; None is returned if there are fewer bodies.
    """
    cells = np.bincount(mesh.bodies)
    if cells.size < size:
        return None
    load = np.zeros(size, dtype=np.int64)
    rank_of = np.zeros(cells.size, dtype=np.int64)
    for body in np.argsort(-cells, kind="stable").tolist():
        rank_of[body] = np.argmin(load)
        load[rank_of[body]] += cells[body]
    return np.asarray(rank_of[mesh.bodies])


def in_plan(mesh: SolidMesh, size: int) -> IntArray | None:
    """Return the rank of each cell if bodies are cut: what is above one another stays together.

    So most contact pairs have both sides on one rank, and columns through the thickness are whole.
    Seen from above, the cells are halved across their longer extent until there are enough parts.

    Args:
        mesh: the mesh.
        size: number of ranks; None is returned if one of them would get no cell.
    """
    plan = np.delete(mesh.points[mesh.cells].mean(axis=1), Y, axis=1)
    rank_of = np.zeros(len(mesh.cells), dtype=np.int64)
    parts = [(np.arange(len(mesh.cells)), 0, size)]
    while parts:
        cells, first, count = parts.pop()
        if count == 1 or not cells.size:
            rank_of[cells] = first
            continue
        extent = np.ptp(plan[cells], axis=0)
        along = plan[cells][:, np.argmax(extent)]
        border = np.sort(along)[cells.size * (count // 2) // count] - SAME * extent.max()
        parts.append((cells[along < border], first, count // 2))
        parts.append((cells[along >= border], first + count // 2, count - count // 2))
    return rank_of if np.unique(rank_of).size == size else None


def _operators(
    case: Case,
    unknowns: Unknowns,
    layout: Layout,
    contact: tuple[tuple[facing.Pairs, ...], sp.csr_matrix],
    matrices: list[Restricted],
    lumped: FloatArray | None,
    rayleigh: tuple[FloatArray, FloatArray] | None,
    is_uncoupled: bool,
) -> Any:
    """Return the operators: `Operators` on one rank, `DistributedOperators` on several.

    The list of M, C and K is empty afterwards.
    """
    (touching, H), (M, C, K) = contact, (matrix.column for matrix in matrices)
    corners = matrices[0].corner, matrices[1].corner, matrices[2].corner
    taken = (matrices.pop(0).rows for _ in range(3))
    further: dict[str, Any] = {
        "base": BaseCoupling(M, C, K, corners),
        "gap_matrix": H,
        "gap0": facing.gaps(case, layout, touching),
        "lumped_mass": lumped,
        "pair_weights": facing.weights(case, layout.parts, touching, unknowns.solid.dim),
        "probes": probe_rows(layout, unknowns.n_own),
        "rayleigh": rayleigh,
        "near_null": unknowns.rigid_motions,
    }
    comm = unknowns.solid.comm
    if comm.size == 1:
        mass, damping, stiffness = taken
        return Operators(mass, damping, stiffness, **further)
    mass, damping, stiffness = (distributed.matrix(rows, comm) for rows in taken)
    distributed.with_near_null(stiffness, further["near_null"])
    further |= {"is_uncoupled": is_uncoupled, "order": unknowns.order, "body": unknowns.bodies}
    return DistributedOperators(mass, damping, stiffness, comm=comm, **further)


def young_modulus(case: Case, mesh: SolidMesh) -> FloatArray:
    """Return Young's modulus of each cell along x, from EI = E b h³/12, shape (n_cells,) [Pa]."""
    result = _of_cells(
        mesh,
        [
            (lambda x, value=lamina.along: value("young_modulus", x))  # type: ignore[misc]
            if not lamina.is_uniform and lamina.bending_stiffness is None
            else 12.0
            * lamina.flexural_rigidity
            / (lamina.mean("width") * lamina.mean("thickness") ** 3)
            for lamina in case.lamina
        ],
    )
    for _, cells, S in _layers(case, mesh):
        result[cells] = 1.0 / S[0, 0]
    return result


def elasticity_of(case: Case, mesh: SolidMesh) -> Elasticity:
    """Return the material of each cell: an isotropic one, and one for each orthotropic layer."""
    material = Elasticity.isotropic(mesh, case.model.poisson or 0.0)
    matrices = [material.matrices[0]]
    numbers: dict[tuple[object, float], int] = {}
    for key, cells, S in _layers(case, mesh):
        number = numbers.setdefault(key, len(matrices))
        if number == len(matrices):
            matrices.append(elasticity.stiffness(S, mesh.dim) * S[0, 0])
        material.kind[cells] = number
    return Elasticity(np.array(matrices), material.kind)


def _layers(
    case: Case, mesh: SolidMesh
) -> Iterator[tuple[tuple[object, float], IntArray, FloatArray]]:
    """Yield the layers of orthotropic laminae.

    Yields:
        Material and angle; the cells; the compliance in x, y, z, shape (6, 6) [1/Pa].
    """
    for i, lamina in enumerate(case.lamina):
        material = lamina.orthotropic
        if material is None:
            continue
        cells = np.flatnonzero(mesh.lamina == i)
        layer = layers_of_cells(case, mesh, i)
        for number, (angle, _) in enumerate(lamina.layers):
            yield (material, angle), cells[layer == number], material.at(angle)


def _of_cells(
    mesh: SolidMesh, of_laminae: Sequence[float | Callable[[FloatArray], FloatArray]]
) -> FloatArray:
    """Return a property of each cell, with that of each lamina at the middle of the cell."""
    x = mesh.points[mesh.cells][..., X].mean(axis=1)
    result = np.empty(len(mesh.cells))
    for i, value in enumerate(of_laminae):
        chosen = mesh.lamina == i
        result[chosen] = value(x[chosen]) if callable(value) else value
    return result


def _width(case: Case, mesh: SolidMesh) -> FloatArray:
    """Return the width of each cell in 2D, 1 in 3D, shape (n_cells,)."""
    if mesh.dim == 3:
        return np.ones(len(mesh.cells))
    return np.asarray(np.array([lamina.mean("width") for lamina in case.lamina])[mesh.lamina])


def _density(case: Case, mesh: SolidMesh) -> FloatArray:
    """Return the density of each cell, times the width in 2D, shape (n_cells,)."""
    of_laminae = [
        (lambda x, value=lamina.along: value("density", x))
        if "density" in lamina.profiles
        else lamina.mean("density")
        for lamina in case.lamina
    ]
    return _of_cells(mesh, of_laminae) * _width(case, mesh)


def _matrices(
    case: Case, unknowns: Unknowns, rigidity: FloatArray, material: Elasticity
) -> tuple[Restricted, Restricted, FloatArray | None]:
    """Return M, K and the diagonal of the lumped mass, None if there are columns.

    The lumped mass is the diagonal of M, scaled so that the total mass is right (Hinton, Rock and
    Zienkiewicz 1976). On cells whose mapping is affine the scale is the same for all cells.
    """
    solid, mesh = unknowns.solid, unknowns.solid.mesh
    matrix = solid.mass(_density(case, mesh))
    ones, moved = matrix.createVecs()
    ones.array = np.arange(ones.array.size) % mesh.dim == 0
    matrix.mult(ones, moved)
    diagonal = matrix.getDiagonal()
    values = np.array(diagonal.array) * float(ones.dot(moved)) / float(ones.dot(diagonal))
    for vector in (ones, moved, diagonal):
        vector.destroy()
    if case.time.mass == "lumped":
        matrix.destroy()
        M = unknowns.diagonal(values)
    else:
        M = unknowns.restricted(matrix)
    K = unknowns.restricted(unknowns.columns.stiffness(rigidity, material), is_relative=True)
    is_plain = unknowns.columns.is_plain
    return M, K, np.array(unknowns.diagonal(values).rows.data) if is_plain else None


def _with_masses(
    mass: Restricted, lumped: FloatArray | None, case: Case, layout: Layout, comm: MPI.Intracomm
) -> tuple[Restricted, FloatArray | None]:
    """Return M and the diagonal of the lumped mass with the point masses of a case (collective).

    Args:
        mass: M of the laminae.
        lumped: diagonal of the lumped mass, shape (n_own,) [kg]; None: there is none.
        case: the case, with the masses.
        layout: the layout with its readings.
        comm: communicator that shares the dofs.

    Raises:
        CaseError: a mass would make a lumped mass matrix that is no diagonal.
    """
    if case.masses and case.time.mass == "lumped":
        raise CaseError(
            'point_mass: expected time.mass = "consistent" with laminae as solids, given "lumped"'
        )
    for point_mass in case.masses:
        number = layout.names.index(point_mass.lamina)
        row = layout.of_dofs(row_at(layout, point_mass, 0, case.length))
        mass = _with_product(mass, point_mass.mass, row, number, comm)
        load = np.abs(row[:, :-1].toarray().ravel())
        total = sum(comm.allgather(float(load.sum())))
        if lumped is not None and total:
            lumped = lumped + point_mass.mass * load / total
    return mass, lumped


def _with_product(
    matrix: Restricted, size: float, row: sp.csr_matrix, number: int, comm: MPI.Intracomm
) -> Restricted:
    """Return a matrix plus size rᵀ r (collective).

    Args:
        matrix: the matrix.
        size: the factor.
        row: r, a functional of the own free dofs and the base, shape (1, n_own + 1).
        number: of the lamina of which r reads.
        comm: communicator that shares the dofs.
    """
    local_row = sp.csr_matrix(row[:, :-1])
    at_base = float(row[0, row.shape[1] - 1])
    full_row = sp.hstack(comm.allgather(local_row), format="csr")
    corners = matrix.corners.copy()
    corners[number] += size * at_base**2
    return Restricted(
        sp.csr_matrix(matrix.rows + size * (local_row.T @ full_row)),
        matrix.column + size * at_base * local_row.toarray().ravel(),
        corners,
    )


def _springs(case: Case, layout: Layout) -> list[tuple[sp.csr_matrix, int, float, float]]:
    """Return the springs of supports at ends and inside the span.

    Returns:
        For each of them what it strains, a functional of own free dofs and base, shape
        (1, n_own + 1); the number of the lamina that it holds; stiffness and damping.
    """
    if not case.support.placed:
        return []
    springs = []
    n = layout.n_numbered(0)
    for support in case.support.at_points:
        if support.kind == "spring":
            assert support.lamina is not None  # the section is checked
            row = layout.of_dofs(row_at(layout, support, 0))
            base = sp.csr_matrix(([1.0], ([0], [row.shape[1] - 1])), shape=row.shape)
            number = layout.names.index(support.lamina)
            springs.append((row - base, number, support.stiffness or 0.0, support.damping))
    if case.is_plate:  # its edges are lines; beams have no places beside their middle line
        inside = case.support.model_copy(update={"placed": case.support.inside})
        if not inside.placed:
            return springs
        drive = HarmonicExcitation(frequency=1.0, amplitude=1.0)
        plain = {"support": inside, "point_mass": (), "sensor": (), "excitation": drive}
        case = case.model_copy(update=plain)
    beams = closed_form.assemble(case.as_beams)
    for support, number in network.point_supports(case, beams.layout, beams.operators.n_dofs):
        part = layout.parts[number]
        row, turn = (
            layout.of_dofs(columns_of(part, place_of(part, support.x), n, kind))
            for kind in (DISPLACEMENT, SLOPE)
        )
        springs.append((turn, number, support.rotational_stiffness, 0.0))
        base = sp.csr_matrix(([1.0], ([0], [row.shape[1] - 1])), shape=row.shape)
        springs.append((row - base, number, support.stiffness or 0.0, support.damping))
    return springs


def edge_springs(case: Case, unknowns: Unknowns) -> list[tuple[sp.csr_matrix, int, float, float]]:
    """Return the springs along the edges of a plate, as `_springs` does (collective).

    Stiffness and damping are those of an edge as a whole. They are spread evenly along the middle
    of its height: each facet has its share at the points of Gauss's rule.
    """
    solid, mesh = unknowns.solid, unknowns.solid.mesh
    springs: list[tuple[sp.csr_matrix, int, float, float]] = []
    for support in case.support.placed if case.is_plate else ():
        of_turns = support.rotational_stiffness
        if support.side is None or not (support.kind == "spring" or of_turns):
            continue
        points, cells, normals, shares = _along_edge(mesh, mesh.supports[support.side])
        values = evaluate(solid, points, cells)
        slope = sum(sp.diags(normals[:, i]) @ values.derivative(Y, i) for i in range(mesh.dim))
        for rows, of_base, k, c in (
            (slope, 0.0, of_turns, 0.0),
            (values.displacement(Y), 1.0, support.stiffness or 0.0, support.damping),
        ):
            strained = gathered(sp.csr_matrix(rows), solid.comm)
            base = sp.csr_matrix((strained @ unknowns.base - of_base)[:, None])
            functionals = sp.hstack([strained @ unknowns.free, base], format="csr")
            for row, share, cell in zip(functionals, shares, cells, strict=True):
                springs.append((row, int(mesh.lamina[cell]), k * share, c * share))
    return springs


def _along_edge(
    mesh: SolidMesh, facets: IntArray
) -> tuple[FloatArray, IntArray, FloatArray, FloatArray]:
    """Return points along the middle of the height of an edge of hexahedra, for integrals.

    Returns:
        Points, shape (n, 3) [m]; their cells, shape (n,); unit normals, shape (n, 3); the share of
        the length of the edge that belongs to each, shape (n,).

    Raises:
        CaseError: the edge has other cells.
    """
    if mesh.cell != "hexahedron":
        raise CaseError(f"support.side: expected hexahedra at a spring, given {mesh.cell}s")
    cells, _ = mesh.cells_with(facets)
    corners = mesh.points[facets]  # in tensor order
    middle = 0.5 * (corners[..., Y].min() + corners[..., Y].max())
    low = corners[..., Y].min(axis=1)
    high = corners[..., Y].max(axis=1)
    chosen = np.flatnonzero((low < middle) & (high >= middle))  # of two that meet there, the lower
    plan = corners[chosen][:, :, [X, 2]]
    first = plan[:, 0]
    away = np.linalg.norm(plan - first[:, None], axis=2)
    last = plan[np.arange(len(plan)), away.argmax(axis=1)]
    length = np.linalg.norm(last - first, axis=1)
    normal = np.column_stack([last[:, 1] - first[:, 1], 0.0 * length, first[:, 0] - last[:, 0]])
    normal /= length[:, None]
    s, weight = np.polynomial.legendre.leggauss(3)  # type: ignore[no-untyped-call]
    s = 0.5 + 0.5 * s
    at = first[:, None] + s[:, None] * (last - first)[:, None]
    points = np.stack([at[..., 0], np.full(at.shape[:2], middle), at[..., 1]], axis=-1)
    shares = 0.5 * weight * length[:, None] / length.sum()
    count = s.size
    return (
        points.reshape(-1, 3),
        np.repeat(cells[chosen], count),
        np.repeat(normal, count, axis=0),
        shares.ravel(),
    )


def _damping(
    case: Case, unknowns: Unknowns, M: Restricted, K: Restricted, H: sp.csr_matrix
) -> tuple[Restricted, tuple[FloatArray, FloatArray]]:
    """Return C = alpha M + beta K with the coefficients of each lamina, or of the stack.

    A stack has those of its beam. A plate, and a stack with orthotropic layers, whose shear beams
    do not know, have those of their own modes with all pairs kept closed.

    Args:
        case: the case.
        unknowns: the free dofs.
        M: mass.
        K: stiffness.
        H: gap matrix of all pairs, columns of the own free dofs.

    Returns:
        C; alpha and beta at the own free dofs, each of shape (n_own,).
    """
    is_layered = any(lamina.orthotropic is not None for lamina in case.lamina)
    if case.is_plate or (is_layered and not case.is_apart):
        comm = unknowns.solid.comm
        if comm.size == 1:
            of_stack = network.damping_of(case, K.rows, M.rows, tied(H, M.rows))
        else:
            stiffness, mass = (distributed.matrix(matrix.rows, comm) for matrix in (K, M))
            S = tied(H, mass)
            of_stack = network.damping_of(case, stiffness, mass, S)
            for handle in (stiffness, mass, S):
                handle.destroy()
            release(comm)
        of_lamina = np.array([of_stack] * len(case.lamina))
        alpha, beta = np.repeat(of_lamina[:1], unknowns.n_own, axis=0).T
    elif case.is_apart:
        laminae = range(len(case.lamina))
        if all(map(case.has_exact_modes, laminae)):
            of_lamina = np.array([case.rayleigh(i) for i in laminae])
        else:
            beam = closed_form.assemble(case.as_beams)
            inertia, rigidity = beam.operators.mass, beam.operators.stiffness
            of_lamina = np.array(
                [network.lamina_damping(case, beam.layout, i, inertia, rigidity) for i in laminae]
            )
        alpha, beta = of_lamina[unknowns.parts].T
    else:
        beam = closed_form.assemble(case.as_beams)
        o = beam.operators
        of_stack = network.damping(case, beam.layout, o.mass, o.stiffness)
        of_lamina = np.array([of_stack] * len(case.lamina))
        alpha, beta = np.repeat(of_lamina[:1], unknowns.n_own, axis=0).T
    a, b = of_lamina.T
    C = Restricted(
        sp.csr_matrix(sp.diags(alpha) @ M.rows + sp.diags(beta) @ K.rows),
        alpha * M.column + beta * K.column,
        a * M.corners + b * K.corners,
    )
    return C, (alpha, beta)


def _layout(
    case: Case, unknowns: Unknowns, x: FloatArray, touching: tuple[facing.Pairs, ...]
) -> Layout:
    """Return parts, interfaces and probes, with the readings of the solid."""
    count = len(case.lamina)
    n = x.size
    comm = unknowns.solid.comm
    parts = parts_of(case, x, np.arange(2 * n * count).reshape(count, n, 2))
    places = places_of_case(case)
    every = [reading_rows(unknowns.solid, x), place_rows(unknowns.solid, places)]
    rows = gathered(sp.vstack(every, format="csr"), comm)
    reading = Reading(
        sp.csr_matrix(rows @ unknowns.free),
        np.asarray(rows @ unknowns.base),
        unknowns.parts,
        comm if comm.size > 1 else None,
    )
    return layout_of(case, parts, facing.interfaces(parts, touching, case), reading, places)


def _surface_strain(case: Case, unknowns: Unknowns, part: Part) -> StrainRows:
    """Return the strains ∂u_x/∂x at the surfaces, in the middle of the width.

    In thin elements the strain of bending is one degree lower than the basis allows, because shear
    is tied to it: constant in a cell at degree 2. It is accurate at the Gauss points of that
    degree; a strain is interpolated between the two nearest of these points along the lamina.
    """
    solid, mesh = unknowns.solid, unknowns.solid.mesh
    accurate = (part.x[:-1, None] + np.diff(part.x)[:, None] * GAUSS[case.model.degree]).ravel()

    def rows(lamina: int, place: float, side: float, z: float) -> sp.csr_matrix:
        at = float(part.positions(np.array([place]))[0])
        first = int(np.clip(np.searchsorted(accurate, at) - 1, 0, accurate.size - 2))
        near = accurate[first : first + 2]
        share = (at - near[0]) / (near[1] - near[0])
        points = middle_line(mesh, lamina, near, z)
        points[:, Y] += side * (0.5 - _INSIDE) * case.lamina[lamina].along("thickness", near)
        strain = evaluate(solid, points, locate(mesh, points, lamina)).derivative(X, X)
        row = gathered(sp.csr_matrix(np.array([[1.0 - share, share]])) @ strain, solid.comm)
        base = sp.csr_matrix(row @ unknowns.base[:, None])
        return sp.hstack([row @ unknowns.free, base], format="csr")

    return rows
