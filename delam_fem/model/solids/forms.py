"""Laminae as linearly elastic solids on dolfinx: matrices, values at points, stresses.

The weak forms of mass and stiffness are

    m(u, v) = ∫ b rho u · v dx                                                          (mass)
    k(u, v) = ∫ b sigma(u) : eps(v) dx,     eps(u) = (grad u + grad uᵀ) / 2             (stiffness)
    k_σ(u, v) = ∫ b sigma_0 : (grad uᵀ grad v) dx                              (geometric stiffness)

    sigma = E D eps,    b = 1 in 3D

b is the width. E is Young's modulus of a cell along x, D the elasticity of its material in parts of
E (`numerics/elasticity.py`): isotropic or orthotropic, in two dimensions that of plane stress.

All integrals are exact on cells whose mapping is affine: full integration. The space is Lagrange of
degree 2 or 3. Degree 1 locks on thin sheets: the shear of a cell as long as ten thicknesses makes
it a hundred times too stiff. Reduced integration has modes without energy.

`evaluate` gives displacements and their derivatives at points inside the cells, as sparse rows. The
cell of a point is found on the mesh as it was given (`mesh.locate`), so that all ranks find the
same one. The rank that owns the cell evaluates the basis there.

`Recovery` gives stresses at the nodes. sigma follows from the gradients of the displacement by
Hooke's law. In a quadrilateral or hexahedron of degree p, sigma is most accurate at the points of
Gauss's rule with p points in each direction (J. Barlow, Int. J. Numer. Meth. Engng 10 (1976) 243);
the polynomial of degree p - 1 through its values there is continued to the nodes. In a triangle or
tetrahedron sigma is taken at the nodes themselves. The stress of a node is the mean over the cells
of the same lamina that share it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp
import ufl

from delam_fem.model import _dolfinx
from delam_fem.model.solids.mesh import (
    FACETS,
    TENSOR,
    SolidMesh,
    jacobians_of,
    reference_coordinates,
)
from delam_fem.numerics.elasticity import DIRECTIONS, isotropic
from delam_fem.numerics.types import FloatArray, IntArray
from delam_fem.system.mpi import MPI

SAME = 1e-9
"""Share of the extent of the mesh within which nodes and shapes of cells are the same."""
INSIDE = 0.382
"""Where nodes of grids lie between such places, in parts of their distance: not at an edge."""


@dataclass(frozen=True)
class Solid:
    """The displacements of laminae on a mesh of solids.

    A node has one dof for each dimension: dof = dim * node + component. Global nodes count over all
    ranks; a rank owns those from `first_node` on.

    Attributes:
        mesh: the mesh, all of it on every rank.
        comm: communicator.
        degree: degree of the displacements.
        domain: dolfinx mesh.
        space: Lagrange space of vectors.
        input_cell: number in `mesh` of each cell of this rank, ghosts last, shape (n_local_cells,).
    """

    mesh: SolidMesh
    comm: MPI.Intracomm
    degree: int
    domain: Any
    space: Any
    input_cell: IntArray

    @classmethod
    def on(
        cls, mesh: SolidMesh, comm: MPI.Intracomm, degree: int, ranks: IntArray | None = None
    ) -> Solid:
        """Build the space of displacements on a mesh (collective).

        Args:
            mesh: the mesh, the same on every rank.
            comm: communicator.
            degree: degree of the displacements.
            ranks: the rank that owns each cell, shape (n_cells,); None: a graph partitioner
                decides.
        """
        domain = _dolfinx.create_mesh(comm, mesh.cell, mesh.points, mesh.cells, ranks)
        space = _dolfinx.vector_space(domain, degree)
        input_cell = np.asarray(domain.topology.original_cell_index, dtype=np.int64)
        return cls(mesh, comm, degree, domain, space, input_cell)

    @property
    def dim(self) -> int:
        """Number of dimensions and of dofs of a node."""
        return self.mesh.dim

    @property
    def n_nodes(self) -> int:
        """Number of nodes of all ranks."""
        return int(self.space.dofmap.index_map.size_global)

    @property
    def n_own_nodes(self) -> int:
        """Number of nodes that this rank owns."""
        return int(self.space.dofmap.index_map.size_local)

    @property
    def first_node(self) -> int:
        """The first global node that this rank owns."""
        return int(self.space.dofmap.index_map.local_range[0])

    @property
    def n_own_cells(self) -> int:
        """Number of cells that this rank owns, the first of `input_cell`."""
        return int(self.domain.topology.index_map(self.dim).size_local)

    @property
    def local_nodes(self) -> IntArray:
        """Local nodes of all cells of this rank, own nodes first, (n_local_cells, n_basis)."""
        return np.asarray(_dolfinx.cell_dofs(self.space), dtype=np.int64)

    def nodes_of(self, cells: IntArray) -> IntArray:
        """Return the global nodes of input cells in the order of basix, shape (n, n_basis).

        Args:
            cells: numbers of cells in `mesh`, shape (n,).

        Returns:
            Rows of -1 for cells that another rank owns.
        """
        local_nodes = self.local_nodes[: self.n_own_cells]
        flat = np.ascontiguousarray(local_nodes.ravel(), dtype=np.int32)
        table = np.full((len(self.mesh.cells), local_nodes.shape[1]), -1, dtype=np.int64)
        numbers = self.space.dofmap.index_map.local_to_global(flat)
        table[self.input_cell[: self.n_own_cells]] = numbers.reshape(local_nodes.shape)
        return table[cells]

    def tabulate(self, derivatives: int, points: FloatArray) -> FloatArray:
        """Return the basis of one component at reference points; see `_dolfinx.tabulate`."""
        return _dolfinx.tabulate(self.mesh.cell, self.degree, derivatives, points)

    def nodes_on(self, facets: IntArray) -> IntArray:
        """Return the global nodes on facets, edges included, on every rank (collective).

        Args:
            facets: facets on the boundary as vertices, shape (n, m).
        """
        cells, numbers = self.mesh.cells_with(facets)
        of_facet = np.array(_dolfinx.facet_dofs(self.space, len(FACETS[self.mesh.cell])))
        nodes = np.take_along_axis(self.nodes_of(cells), of_facet[numbers], axis=1)
        everywhere = self.comm.allgather(np.unique(nodes[nodes >= 0]))
        return np.asarray(np.unique(np.concatenate(everywhere)), dtype=np.int64)

    def normals_on(self, facets: IntArray) -> FloatArray:
        """Return the mean unit normals in the plane of x and z at the nodes on facets (collective).

        Args:
            facets: facets of an edge of a solid in three dimensions as vertices, shape (n, m).

        Returns:
            Nodes, increasing, and both components, shape (n_nodes, 3). Where normals differ the
            mean is shorter than 1.
        """
        cells, numbers = self.mesh.cells_with(facets)
        corners = self.mesh.points[facets]
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, [0, 2]]
        outward = corners.mean(axis=1) - self.mesh.points[self.mesh.cells[cells]].mean(axis=1)
        normal *= np.sign(np.einsum("ki,ki->k", normal, outward[:, [0, 2]]))[:, None]
        normal /= np.linalg.norm(normal, axis=1)[:, None]
        of_facet = np.array(_dolfinx.facet_dofs(self.space, len(FACETS[self.mesh.cell])))
        nodes = np.take_along_axis(self.nodes_of(cells), of_facet[numbers], axis=1)
        entries = np.column_stack([nodes.ravel(), np.repeat(normal, nodes.shape[1], axis=0)])
        entries = np.concatenate(self.comm.allgather(entries[nodes.ravel() >= 0]))
        every, number = np.unique(entries[:, 0], return_inverse=True)
        sums = np.zeros((every.size, 3))
        np.add.at(sums, number, np.column_stack([entries[:, 1:], np.ones(len(entries))]))
        return np.column_stack([every, sums[:, :2] / sums[:, 2:]])

    @property
    def coordinates(self) -> FloatArray:
        """Coordinates of the nodes that this rank owns, shape (n_own_nodes, dim) [m]."""
        points = self.space.tabulate_dof_coordinates()[: self.n_own_nodes, : self.dim]
        return np.asarray(points, dtype=np.float64)

    def fetched(self, own: Any, nodes: IntArray) -> Any:
        """Return values at global nodes from the ranks that own them (collective).

        Args:
            own: values at the nodes that this rank owns, shape (n_own_nodes, …).
            nodes: those that this rank asks for, shape (n,).

        Returns:
            Shape (n, …).
        """
        if self.comm.size == 1:
            return own[nodes]
        ends = np.array(self.comm.allgather(self.first_node + self.n_own_nodes))
        owner = np.searchsorted(ends, nodes, side="right")
        asked = self.comm.alltoall([nodes[owner == rank] for rank in range(self.comm.size)])
        answers = self.comm.alltoall([own[some - self.first_node] for some in asked])
        return np.concatenate(answers)[np.argsort(np.argsort(owner, kind="stable"))]

    def _local(self, values: FloatArray) -> FloatArray:
        """Return values of all dofs at the own ones and the ghosts, as dolfinx orders them."""
        ghosts = self.space.dofmap.index_map.ghosts.astype(np.int64)
        nodes = np.append(self.first_node + np.arange(self.n_own_nodes), ghosts)
        return np.asarray(values.reshape(-1, self.dim)[nodes].ravel())

    def extremes(self, of_cells: IntArray) -> tuple[IntArray, IntArray]:
        """Return the lowest and highest of the numbers of cells at each own node (collective).

        Args:
            of_cells: a number of each input cell, shape (n_cells,).
        """
        n = self.n_own_nodes
        ghosts = self.space.dofmap.index_map.ghosts.astype(np.int64)
        low = np.full(n + ghosts.size, np.iinfo(np.int64).max)
        high = np.full(n + ghosts.size, -1, dtype=np.int64)
        numbers = of_cells[self.input_cell]
        for nodes in self.local_nodes.T:
            np.minimum.at(low, nodes, numbers)
            np.maximum.at(high, nodes, numbers)
        for nodes, lowest, highest in self.comm.allgather((ghosts, low[n:], high[n:])):
            local = nodes - self.first_node
            is_local = (local >= 0) & (local < n)
            np.minimum.at(low, local[is_local], lowest[is_local])
            np.maximum.at(high, local[is_local], highest[is_local])
        return low[:n], high[:n]

    @cached_property
    def place(self) -> IntArray:
        """Place of each global node in an order that any number of ranks has (collective).

        Nodes are ordered by body, then by x, y and z. Nodes on both sides of a delamination, where
        the mesh may have no distance, are ordered by lamina. Shape (n_nodes,).
        """
        body, _ = self.extremes(self.mesh.bodies)
        lamina, _ = self.extremes(self.mesh.lamina)
        extent = np.maximum(np.ptp(self.mesh.points, axis=0), np.finfo(np.float64).tiny)
        box = np.floor(self.coordinates / (SAME * extent) + INSIDE).astype(np.int64)
        keys = np.column_stack([lamina, box[:, ::-1], body])  # the last one counts first
        return np.argsort(np.lexsort(np.concatenate(self.comm.allgather(keys)).T))

    def of_cells(self, values: FloatArray) -> Any:
        """Return a coefficient that is constant in each cell.

        Args:
            values: by input cell, shape (n_cells,).
        """
        space = _dolfinx.space(self.domain, "Discontinuous Lagrange", 0)
        cell_of_dof = np.argsort(_dolfinx.cell_dofs(space)[:, 0])
        return _dolfinx.function(space, values[self.input_cell[cell_of_dof]])

    def _dx(self) -> Any:
        return ufl.dx(domain=self.domain, metadata={"quadrature_degree": 2 * self.degree})

    def mass(self, density: FloatArray) -> Any:
        """Assemble the mass, a PETSc matrix that the caller owns (collective).

        Args:
            density: of each input cell, times the width in 2D, shape (n_cells,).
        """
        u = ufl.TrialFunction(self.space)
        v = ufl.TestFunction(self.space)
        return _dolfinx.assemble_matrix(self.of_cells(density) * ufl.inner(u, v) * self._dx())

    def stiffness(self, young_modulus: FloatArray, material: Elasticity) -> Any:
        """Assemble the stiffness, a PETSc matrix that the caller owns (collective).

        Args:
            young_modulus: of each input cell, times the width in 2D, shape (n_cells,).
            material: of the cells.
        """
        u = ufl.TrialFunction(self.space)
        v = ufl.TestFunction(self.space)

        def form(D: Any) -> Any:
            return ufl.inner(stress(D, u), strain(v))

        return self._of_kinds(young_modulus, material, form)

    def _of_kinds(
        self, young_modulus: FloatArray, material: Elasticity, form: Callable[[Any], Any]
    ) -> Any:
        """Return the sum of a form over the kinds of material, a matrix (collective).

        Args:
            young_modulus: see `stiffness`.
            material: of the cells.
            form: the integrand of E D, in UFL.
        """
        total: Any = None
        for number, elasticity in enumerate(material.matrices):
            E = self.of_cells(np.where(material.kind == number, young_modulus, 0.0))
            D = _dolfinx.constant(self.domain, elasticity)
            part = _dolfinx.assemble_matrix(E * form(D) * self._dx())
            if total is None:
                total = part
            else:
                total.axpy(1.0, part)
                part.destroy()
        return total

    def body_force(self, density: FloatArray, direction: int) -> FloatArray:
        """Return the load of a unit acceleration along a direction (collective), shape (n_dofs,).

        Args:
            density: of each input cell, times the width in 2D, shape (n_cells,).
            direction: number of the component.
        """
        matrix = self.mass(density)
        ones, load = matrix.createVecs()
        ones.array[:] = np.arange(ones.array.size) % self.dim == direction
        matrix.mult(ones, load)
        result: FloatArray = np.concatenate(self.comm.allgather(np.array(load.array)))
        for thing in (matrix, ones, load):
            thing.destroy()
        return result

    def geometric_stiffness(
        self,
        young_modulus: FloatArray,
        material: Elasticity,
        displacement: FloatArray,
        tension: FloatArray,
    ) -> Any:
        """Assemble the geometric stiffness, a PETSc matrix that the caller owns (collective).

        Args:
            young_modulus: of each input cell, times the width in 2D, shape (n_cells,).
            material: of the cells.
            displacement: u_0, whose stress acts, shape (n_dofs,) [m].
            tension: further stress along x of each input cell, times the width in 2D, (n_cells,).
        """
        u = ufl.TrialFunction(self.space)
        v = ufl.TestFunction(self.space)
        u_0 = _dolfinx.function(self.space, self._local(displacement))
        turned = ufl.grad(u).T * ufl.grad(v)

        def form(D: Any) -> Any:
            return ufl.inner(stress(D, u_0), turned)

        along = self.of_cells(tension) * ufl.inner(u.dx(0), v.dx(0))
        total = _dolfinx.assemble_matrix(along * self._dx())
        if np.any(displacement):
            acting = self._of_kinds(young_modulus, material, form)
            total.axpy(1.0, acting)
            acting.destroy()
        return total


def strain(u: Any) -> Any:
    """Return the strain eps(u) = (grad u + grad uᵀ) / 2 in UFL."""
    return ufl.sym(ufl.grad(u))


def stress(D: Any, u: Any) -> Any:
    """Return the stress sigma(u) in UFL.

    Args:
        D: elasticity as a constant matrix, see `numerics/elasticity.py`.
        u: displacements.
    """
    eps = strain(u)
    dim = eps.ufl_shape[0]
    pairs = DIRECTIONS[dim]
    strains = ufl.as_vector([eps[i, j] if i == j else 2 * eps[i, j] for i, j in pairs])
    of_pairs = dict(zip(pairs, ufl.dot(D, strains), strict=True))
    return ufl.as_matrix([[of_pairs[min(i, j), max(i, j)] for j in range(dim)] for i in range(dim)])


@dataclass(frozen=True)
class Elasticity:
    """The material of each cell, in parts of its Young's modulus along x.

    Attributes:
        matrices: D over E by kind of material, shape (n_kinds, 3, 3) or (n_kinds, 6, 6) [-].
        kind: kind of each cell of the mesh, shape (n_cells,).
    """

    matrices: FloatArray
    kind: IntArray

    @classmethod
    def isotropic(cls, mesh: SolidMesh, poisson: float) -> Elasticity:
        """Return the elasticity of one isotropic material.

        Args:
            mesh: the mesh.
            poisson: Poisson's ratio [-].
        """
        return cls(isotropic(mesh.dim, poisson)[None], np.zeros(len(mesh.cells), dtype=np.int64))


@dataclass(frozen=True)
class Evaluation:
    """The basis of a solid's space at points, of those points whose cells this rank owns.

    Attributes:
        n_points: number of points of all ranks.
        n_dofs: number of dofs of all ranks.
        points: numbers of this rank's points, shape (k,).
        nodes: global nodes of their cells, shape (k, n_basis); dof = dim * node + component.
        values: of the basis functions, shape (k, n_basis).
        gradients: their derivatives in x, y, z, shape (k, n_basis, dim) [1/m].
    """

    n_points: int
    n_dofs: int
    points: IntArray
    nodes: IntArray
    values: FloatArray
    gradients: FloatArray

    @property
    def dim(self) -> int:
        """Number of components of the displacement."""
        return int(self.gradients.shape[2])

    def displacement(self, component: int) -> sp.csr_matrix:
        """Return rows for a component of the displacement, shape (n_points, n_dofs)."""
        return self._rows(self.values, component)

    def derivative(self, component: int, direction: int) -> sp.csr_matrix:
        """Return rows for d u_component / d x_direction, shape (n_points, n_dofs)."""
        return self._rows(self.gradients[:, :, direction], component)

    def along(self, directions: FloatArray) -> sp.csr_matrix:
        """Return rows for the displacement along a direction at each point, (n_points, n_dofs).

        Args:
            directions: of all points, shape (n_points, dim).
        """
        return sum(
            (sp.diags(directions[:, i]) @ self.displacement(i) for i in range(1, self.dim)),
            sp.diags(directions[:, 0]) @ self.displacement(0),
        ).tocsr()

    def _rows(self, entries: FloatArray, component: int) -> sp.csr_matrix:
        rows = np.repeat(self.points, self.nodes.shape[1])
        columns = self.dim * self.nodes.ravel() + component
        shape = (self.n_points, self.n_dofs)
        return sp.csr_matrix((entries.ravel(), (rows, columns)), shape=shape)


def evaluate(solid: Solid, points: FloatArray, cells: IntArray) -> Evaluation:
    """Evaluate the basis of a solid at points, each rank in the cells that it owns.

    Args:
        solid: the solid.
        points: shape (k, dim) [m].
        cells: the input cell in which each point is, see `locate`, shape (k,).
    """
    mesh = solid.mesh
    nodes = solid.nodes_of(cells)
    local_points = np.flatnonzero(nodes[:, 0] >= 0)
    corners = mesh.points[mesh.cells[cells[local_points]]]
    X = reference_coordinates(mesh.cell, corners, points[local_points])
    table = solid.tabulate(1, X) if local_points.size else np.zeros((1 + mesh.dim, 0, 0))
    inverse = np.linalg.inv(jacobians_of(mesh.cell, corners, X))  # dX_k/dx_j
    gradients = np.einsum("dkb,kdj->kbj", table[1:], inverse)
    at = nodes[local_points, : table.shape[2]]
    return Evaluation(len(points), mesh.dim * solid.n_nodes, local_points, at, table[0], gradients)


def gathered(rows: sp.csr_matrix, comm: MPI.Intracomm) -> sp.csr_matrix:
    """Return the sum of all ranks' rows on every rank (collective), of the same shape."""
    if comm.size == 1:
        return rows
    coo = rows.tocoo()
    data, row, column = (
        np.concatenate(pieces)
        for pieces in zip(*comm.allgather((coo.data, coo.row, coo.col)), strict=True)
    )
    return sp.csr_matrix((data, (row, column)), shape=rows.shape)


VTK_ORDER = {2: [0, 1, 2], 3: [0, 1, 2, 3, 5, 4]}
"""Components of stresses by dimension in VTK's order: xx, yy, zz, xy, yz, xz."""


@dataclass(frozen=True)
class Recovery:
    """The linear map from displacements to stresses at points.

    Attributes:
        nodes: global nodes of the cells, shape (n_cells, n_basis).
        gradients: of the basis at the sampled places, shape (n_cells, n_places, n_basis, dim).
        continued: values at the nodes of a cell from those at its places, (n_basis, n_places).
        mean: mean over the cells of a point, CSR (n_points, n_cells n_basis).
        young_modulus: of each cell, shape (n_cells,) [Pa].
        material: of the cells.
    """

    nodes: IntArray
    gradients: FloatArray
    continued: FloatArray
    mean: sp.csr_matrix
    young_modulus: FloatArray
    material: Elasticity

    @classmethod
    def of(
        cls,
        mesh: SolidMesh,
        degree: int,
        nodes: IntArray,
        points: IntArray,
        young_modulus: FloatArray,
        material: Elasticity,
    ) -> Recovery:
        """Prepare the recovery of stresses on a mesh.

        Args:
            mesh: the mesh.
            degree: degree of the displacements.
            nodes: global nodes of the cells of the mesh, shape (n_cells, n_basis).
            points: points of the cells, at which stresses are wanted, shape (n_cells, n_basis).
            young_modulus: of each cell, shape (n_cells,) [Pa].
            material: of the cells.
        """
        places, continued = sampled(mesh.cell, degree, _dolfinx.reference_nodes(mesh.cell, degree))
        corners = mesh.points[mesh.cells]
        k = len(places)
        every = np.repeat(corners, k, axis=0)
        inverse = np.linalg.inv(jacobians_of(mesh.cell, every, np.tile(places, (len(corners), 1))))
        inverse = inverse.reshape(len(corners), k, mesh.dim, mesh.dim)
        table = _dolfinx.tabulate(mesh.cell, degree, 1, places)[1:]
        gradients = np.einsum("dkb,ckdj->ckbj", table, inverse)
        rows = points.ravel()
        mean = sp.csr_matrix((1.0 / np.bincount(rows)[rows], (rows, np.arange(rows.size))))
        return cls(nodes, gradients, continued, mean, young_modulus, material)

    def stress(self, displacement: FloatArray) -> FloatArray:
        """Return the stresses at the points, shape (n_points, n_components) [Pa].

        Args:
            displacement: of all nodes, shape (n_nodes, dim) [m].
        """
        grad = np.einsum("cbi,ckbj->ckij", displacement[self.nodes], self.gradients, optimize=True)
        dim = grad.shape[-1]
        first, second = zip(*DIRECTIONS[dim], strict=True)
        strains = grad[:, :, first, second] + grad[:, :, second, first]  # 2 eps_ij
        strains[:, :, :dim] *= 0.5
        sigma = np.empty_like(strains)
        for number, D in enumerate(self.material.matrices):
            chosen = self.material.kind == number
            sigma[chosen] = strains[chosen] @ D * self.young_modulus[chosen, None, None]
        sigma = sigma[:, :, VTK_ORDER[dim]]
        at_nodes = np.einsum("bk,cks->cbs", self.continued, sigma)
        return np.asarray(self.mean @ at_nodes.reshape(-1, sigma.shape[2]))


def von_mises(sigma: FloatArray) -> FloatArray:
    """Return von Mises' equivalent stress, shape (n,) [Pa].

    Args:
        sigma: components in VTK's order, shape (n, 3) of plane stress, or (n, 6).
    """
    if sigma.shape[1] == 3:
        xx, yy, xy = sigma.T
        return np.asarray(np.sqrt(xx**2 - xx * yy + yy**2 + 3.0 * xy**2))
    xx, yy, zz, xy, yz, xz = sigma.T
    normal = (xx - yy) ** 2 + (yy - zz) ** 2 + (zz - xx) ** 2
    return np.asarray(np.sqrt(0.5 * normal + 3.0 * (xy**2 + yz**2 + xz**2)))


def sampled(cell: str, degree: int, nodes: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the places of a cell at which stresses are computed, and how they are continued.

    Args:
        cell: kind of the cell.
        degree: of the displacements.
        nodes: reference coordinates of the nodes, shape (n_basis, dim).

    Returns:
        Reference coordinates, shape (n_places, dim); values at the nodes from values there, shape
        (n_basis, n_places).
    """
    if cell not in TENSOR:
        return nodes, np.eye(len(nodes))
    dim = nodes.shape[1]
    roots, _ = np.polynomial.legendre.leggauss(degree)  # type: ignore[no-untyped-call]
    along = 0.5 + 0.5 * roots
    grid = np.stack(np.meshgrid(*[along] * dim, indexing="ij"), axis=-1).reshape(-1, dim)
    powers = np.stack(np.meshgrid(*[np.arange(degree)] * dim, indexing="ij"), axis=-1)
    powers = powers.reshape(-1, dim)

    def monomials(X: FloatArray) -> FloatArray:
        return np.asarray(np.prod(X[:, None, :] ** powers, axis=2))

    return grid, np.asarray(np.linalg.solve(monomials(grid).T, monomials(nodes).T).T)
