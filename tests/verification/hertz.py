"""Hertz's contact of a cylinder and of a sphere, on the package's way from meshes to impulses.

A half disc or an octant of a sphere, held at its flat faces, is the lower body. A plane above it,
rigid or a block of the same material, is moved down by the approach; forces follow from the
compliance H K⁻¹ Hᵀ of the pairs and the solver of complementarity problems.

    cylinder   a² = 4 P R / (π E*),     p₀ = 2 P / (π a),     P: force per width
    sphere     a³ = 3 P R / (4 E*),     p₀ = 3 P / (2 π a²)
    p = p₀ (1 − r²/a²)^(1/2),           1/E* = 1/E₁ + 1/E₂

with E of plane stress for the cylinder and E / (1 − ν²) for the sphere.

Source: K. L. Johnson, Contact Mechanics (1985), ch. 4.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import gmsh
import numpy as np
import numpy.typing as npt
import scipy.sparse as sp
from petsc4py import PETSc

from delam_fem.api import MPI
from delam_fem.contact import complementarity
from delam_fem.model.solids.facing import FacingPoints, at_middles, at_vertices, gap_rows, project
from delam_fem.model.solids.forms import Elasticity, Solid
from delam_fem.model.solids.mesh import FACETS, Facing, SolidMesh

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]
YOUNG, POISSON, RADIUS = 1.0, 0.3, 1.0
POINTS: dict[str, Callable[[SolidMesh, Facing], FacingPoints]] = {
    "vertices": at_vertices,
    "middles": at_middles,
}
COARSE = 0.15
"""Size of cells at a distance of R/2 from the contact."""


@dataclass(frozen=True)
class Found:
    """What a computation gives.

    Attributes:
        r: distance of the loaded pairs from the axis, shape (n,).
        pressure: force over the weight of each pair, shape (n,).
        force: total force of the whole body.
        radius: of contact, from the second moment of the forces.
        n_dofs: number of free dofs.
        n_pairs: number of candidate pairs.
    """

    r: Array
    pressure: Array
    force: float
    radius: float
    n_dofs: int
    n_pairs: int

    def errors(self, stiffness: float, dim: int) -> tuple[float, float, float]:
        """Return the relative errors of radius, largest pressure and profile (rms over p₀).

        Args:
            stiffness: E*.
            dim: 2: cylinder, 3: sphere.
        """
        P, R = self.force, RADIUS
        if dim == 2:
            a = np.sqrt(4.0 * P * R / (np.pi * stiffness))
            p0 = 2.0 * P / (np.pi * a)
        else:
            a = (0.75 * P * R / stiffness) ** (1.0 / 3.0)
            p0 = 1.5 * P / (np.pi * a**2)
        profile = p0 * np.sqrt(np.maximum(0.0, 1.0 - (self.r / a) ** 2))
        rms = np.sqrt(np.mean((self.pressure - profile) ** 2)) / p0
        return self.radius / a - 1.0, self.pressure[np.argmin(self.r)] / p0 - 1.0, float(rms)


def _half_disc(model: Any) -> None:
    disc = model.addDisk(0, 0, 0, RADIUS, RADIUS)
    model.cut([(2, disc)], [(2, model.addRectangle(-2, -2, 0, 4, 2))])


_GEOMETRIES: dict[tuple[str, int], Callable[[Any], object]] = {
    ("round", 2): _half_disc,
    ("round", 3): lambda model: model.addSphere(0, 0, 0, RADIUS, -1, 0, np.pi / 2, np.pi / 2),
    ("block", 2): lambda model: model.addRectangle(-1, RADIUS, 0, 2, 1),
    ("block", 3): lambda model: model.addBox(0, RADIUS, 0, 1, 1, 1),
}


def body(shape: str, dim: int, fine: float, near: float) -> tuple[Array, Indices]:
    """Return points and cells of a body that is fine about the point of contact (0, R).

    Args:
        shape: "round": a half disc or an octant of a sphere below that point; "block": above it.
        dim: 2 or 3.
        fine: size of the cells up to the distance `near` from the point.
        near: radius of the fine region.
    """
    gmsh.initialize()
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.option.setNumber("Mesh.MeshSizeMax", 1e22)  # -clmax of another model stays
        for name in ("FromPoints", "ExtendFromBoundary", "FromCurvature"):
            gmsh.option.setNumber(f"Mesh.MeshSize{name}", 0)
        _GEOMETRIES[shape, dim](gmsh.model.occ)
        gmsh.model.occ.synchronize()
        field, reach = gmsh.model.mesh.field, 4.0 * RADIUS  # beyond both bodies
        coarse = fine + reach * (COARSE - fine) / (0.5 * RADIUS - near)
        field.add("Ball", 1)
        for name, value in {
            "VIn": fine, "VOut": coarse, "YCenter": RADIUS, "Radius": near, "Thickness": reach,
        }.items():  # fmt: skip
            field.setNumber(1, name, value)
        field.setAsBackgroundMesh(1)
        gmsh.model.mesh.generate(dim)
        tags, x, _ = gmsh.model.mesh.getNodes()
        _, cells = gmsh.model.mesh.getElementsByType(2 if dim == 2 else 4)
    finally:
        gmsh.finalize()
    place = np.zeros(int(tags.max()) + 1, dtype=np.int64)
    place[tags.astype(np.int64)] = np.arange(tags.size)
    cells = place[cells.reshape(-1, dim + 1).astype(np.int64)]
    used, number = np.unique(cells, return_inverse=True)
    points = x.reshape(-1, 3)[used, :dim]
    n_near = np.sum(np.linalg.norm(points - RADIUS * np.eye(dim)[1], axis=1) < near)
    share = n_near / (near / fine) ** dim  # 1.8 to 2.1 of a half disc, 0.5 to 0.8 of an octant
    if not (0.3 < share < 3.0 and len(points) < 10 * n_near + 1000):
        raise RuntimeError(f"gmsh did not follow the field: {len(points)} points, {n_near} near")
    return points, number.reshape(cells.shape)


def outer(points: Array, cells: Indices) -> Indices:
    """Return the facets of one cell alone, shape (n, dim)."""
    dim = points.shape[1]
    kind = "triangle" if dim == 2 else "tetrahedron"
    facets = np.concatenate([cells[:, list(facet)] for facet in FACETS[kind]])
    _, first, count = np.unique(
        np.sort(facets, axis=1), axis=0, return_index=True, return_counts=True
    )
    return facets[first[count == 1]]


def plane(dim: int) -> tuple[Array, Indices]:
    """Return a wide body of few cells upon y = R, to be held at every point."""
    x = 0.5 * RADIUS * np.array([-1.0, 1.0])
    axes = [x, np.array([0.0, 1.0]) + RADIUS, *[x] * (dim - 2)]
    corners = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, dim)
    if dim == 2:
        return corners, np.array([[0, 1, 2], [1, 2, 3]])
    kuhn = [[0, a, a + b, 7] for a, b in ((4, 2), (4, 1), (2, 4), (2, 1), (1, 4), (1, 2))]
    return corners, np.array(kuhn)


def assembled(
    lower: tuple[Array, Indices], upper: tuple[Array, Indices], reach: float
) -> SolidMesh:
    """Return both bodies; pairs are sought where the lower one is near the axis."""
    shift, dim = len(lower[0]), lower[0].shape[1]
    points = np.concatenate([lower[0], upper[0]])
    cells = np.concatenate([lower[1], shift + upper[1]])
    first, second = outer(*lower), outer(*upper)
    x = lower[0][first]
    is_round = np.all(np.abs(np.linalg.norm(x, axis=2) - RADIUS) < 1e-9, axis=1)
    is_near = np.linalg.norm(np.delete(x, 1, axis=2), axis=2).max(axis=1) < reach
    is_top = x[..., 1].min(axis=1) > 0.5 * RADIUS
    bottom = np.all(np.abs(upper[0][second][..., 1] - upper[0][:, 1].min()) < 1e-9, axis=1)
    sides = Facing((0, 1), first[is_round & is_near & is_top], shift + second[bottom])
    lamina = np.repeat([0, 1], [len(lower[1]), len(upper[1])])
    kind = "triangle" if dim == 2 else "tetrahedron"
    return SolidMesh(points, cells, kind, lamina, sides=(sides,))


def held(mesh: SolidMesh, solid: Solid, *, is_rigid: bool) -> npt.NDArray[np.bool_]:
    """Return which dofs are held: the base, planes of symmetry, and what is above."""
    x, dim = solid.coordinates, mesh.dim
    of_upper = np.zeros(len(x), dtype=np.bool_)
    of_upper[solid.nodes_of(np.flatnonzero(mesh.lamina == 1)).ravel()] = True
    result = np.zeros((len(x), dim), dtype=np.bool_)
    result[np.abs(x[:, 1]) < 1e-9] = True
    if is_rigid:
        result[of_upper] = True
    else:
        result[x[:, 1] > x[:, 1].max() - 1e-9] = True
    if dim == 3:
        for axis in (0, 2):
            result[np.abs(x[:, axis]) < 1e-9, axis] = True
    return result.ravel()


def contact(
    dim: int, size: float, cells: int, points: str = "middles", upper: float | None = None
) -> tuple[Found, float]:
    """Return the contact of a round body with a plane, and E*.

    Args:
        dim: 2: cylinder in plane stress, 3: sphere.
        size: radius of contact over R, roughly.
        cells: number of cells over the radius of contact.
        points: where the pairs are: "vertices" or "middles".
        upper: the cells of an elastic block over those of the round body; None: a rigid plane.
    """
    fine, near = size * RADIUS / cells, 1.2 * size * RADIUS
    block = plane(dim) if upper is None else body("block", dim, upper * fine, near)
    mesh = assembled(body("round", dim, fine, near), block, 2.0 * size * RADIUS)
    stiffness = (YOUNG if dim == 2 else YOUNG / (1.0 - POISSON**2)) * (
        1.0 if upper is None else 0.5
    )
    approach = size**2 * RADIUS
    if dim == 2:  # of the half of a disc between two planes (Johnson, section 5.6)
        approach *= 0.25 * (2.0 * np.log(4.0 / size) - 1.0)
    return pressed(mesh, approach, points, is_rigid=upper is None), stiffness


def pressed(mesh: SolidMesh, approach: float, points: str, *, is_rigid: bool) -> Found:
    """Press the bodies together by a distance; pairs are at "vertices" or "middles"."""
    solid = Solid.on(mesh, MPI.COMM_SELF, 2)
    free = np.flatnonzero(~held(mesh, solid, is_rigid=is_rigid))
    K = solid.stiffness(np.full(len(mesh.cells), YOUNG), Elasticity.isotropic(mesh, POISSON))
    rows, columns, values = K.getValuesCSR()
    K = sp.csr_matrix((values, columns, rows), shape=K.getSize())[free][:, free]
    pairs = project(mesh, mesh.sides[0], POINTS[points](mesh, mesh.sides[0]))
    H = gap_rows(solid, pairs)[:, free].toarray()
    W = H @ solved(K, H.T)
    force = complementarity.solve(0.5 * (W + W.T), pairs.gap - approach)
    r = np.linalg.norm(np.delete(pairs.lower.x, 1, axis=1), axis=1)
    loaded = force > 0.0
    copies, moment = (1.0, 4.0) if mesh.dim == 2 else (4.0, 2.5)
    total = force.sum()
    radius = np.sqrt(moment * (force @ r**2) / total)
    pressure = force[loaded] / pairs.weights[loaded]
    return Found(r[loaded], pressure, copies * total, radius, free.size, r.size)


def solved(K: sp.csr_matrix, B: Array) -> Array:
    """Return K⁻¹ B by Cholesky's factorisation."""
    matrix = PETSc.Mat().createAIJ(K.shape, csr=(K.indptr, K.indices, K.data))
    matrix.setOption(PETSc.Mat.Option.SYMMETRIC, True)
    solver = PETSc.KSP().create(PETSc.COMM_SELF)
    solver.setOperators(matrix)
    solver.setType("preonly")
    solver.getPC().setType("cholesky")
    solver.getPC().setFactorOrdering("nd")
    result = np.empty_like(B)
    b, x = matrix.createVecs()
    for k in range(B.shape[1]):
        b.array = B[:, k]
        solver.solve(b, x)
        result[:, k] = x.array
    for thing in (b, x, solver, matrix):
        thing.destroy()
    return result
