"""Laminae as linearly elastic solids on dolfinx: the space of displacements, mass and stiffness.

    m(u, v) = ∫ b rho u · v dx                                                          (mass)
    k(u, v) = ∫ b sigma(u) : eps(v) dx,     eps(u) = (grad u + grad uᵀ) / 2             (stiffness)

    plane stress   sigma = E / (1 - nu²) ((1 - nu) eps + nu tr(eps) I)                  (2D)
    3D             sigma = E / (1 + nu) (eps + nu / (1 - 2 nu) tr(eps) I),   b = 1

b is the width. All integrals are exact on cells whose mapping is affine: full integration.

The space is Lagrange of degree 2 or 3. Degree 1 locks on thin sheets: the shear of a cell as long
as ten thicknesses makes it a hundred times too stiff. Reduced integration has modes without energy.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import ufl

from delam_fem.model import _dolfinx
from delam_fem.model.solids.mesh import FACETS, SolidMesh
from delam_fem.mpi import MPI
from delam_fem.numerics.arrays import FloatArray, IntArray


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
        """Build the space (collective).

        Args:
            mesh: the mesh, the same on every rank.
            comm: communicator.
            degree: degree of the displacements.
            ranks: the rank that owns each cell, shape (n_cells,); None: a graph partitioner
                decides.
        """
        domain = _dolfinx.create_mesh(comm, mesh.cell, mesh.points, mesh.cells, ranks)
        space = _dolfinx.vector_space(domain, degree)
        given = np.asarray(domain.topology.original_cell_index, dtype=np.int64)
        return cls(mesh, comm, degree, domain, space, given)

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
    def ghost_nodes(self) -> IntArray:
        """Global nodes that this rank shares but does not own; locally they follow its own."""
        return np.asarray(self.space.dofmap.index_map.ghosts, dtype=np.int64)

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
        own = self.input_cell[: self.n_own_cells]
        place = np.full(len(self.mesh.cells), -1, dtype=np.int64)
        place[own] = np.arange(own.size)
        local = place[cells]
        table = self._global_nodes()
        result = np.full((len(cells), table.shape[1]), -1, dtype=np.int64)
        result[local >= 0] = table[local[local >= 0]]
        return result

    def _global_nodes(self) -> IntArray:
        """Return the global nodes of the cells that this rank owns."""
        table = self.local_nodes[: self.n_own_cells]
        flat = np.ascontiguousarray(table.ravel(), dtype=np.int32)
        nodes = self.space.dofmap.index_map.local_to_global(flat)
        return np.asarray(nodes, dtype=np.int64).reshape(table.shape)

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
        found = np.take_along_axis(self.nodes_of(cells), of_facet[numbers], axis=1)
        everywhere = self.comm.allgather(np.unique(found[found >= 0]))
        return np.asarray(np.unique(np.concatenate(everywhere)), dtype=np.int64)

    @property
    def coordinates(self) -> FloatArray:
        """Coordinates of the nodes that this rank owns, shape (n_own_nodes, dim) [m]."""
        points = self.space.tabulate_dof_coordinates()[: self.n_own_nodes, : self.dim]
        return np.asarray(points, dtype=np.float64)

    def coordinates_of(self, nodes: IntArray) -> FloatArray:
        """Return the coordinates of global nodes on every rank (collective), shape (n, dim) [m].

        Args:
            nodes: the same on every rank, shape (n,).
        """
        local = nodes - self.first_node
        own = np.flatnonzero((local >= 0) & (local < self.n_own_nodes))
        pieces = self.comm.allgather((own, self.coordinates[local[own]]))
        result = np.full((nodes.size, self.dim), np.nan)
        for place, coordinates in pieces:
            result[place] = coordinates
        return result

    def of_cells(self, values: FloatArray) -> Any:
        """Return a coefficient that is constant in each cell.

        Args:
            values: by input cell, shape (n_cells,).
        """
        space = _dolfinx.space(self.domain, "Discontinuous Lagrange", 0)

        def fill(array: FloatArray) -> None:
            array[_dolfinx.cell_dofs(space)[:, 0]] = values[self.input_cell]

        return _dolfinx.function(space, fill)

    def _dx(self) -> Any:
        return ufl.dx(domain=self.domain, metadata={"quadrature_degree": 2 * self.degree})

    def mass(self, density: FloatArray) -> Any:
        """Assemble the mass, a PETSc matrix that the caller owns (collective).

        Args:
            density: of each input cell, times the width in 2D, shape (n_cells,).
        """
        u, v = ufl.TrialFunction(self.space), ufl.TestFunction(self.space)
        form = self.of_cells(density) * ufl.inner(u, v) * self._dx()
        return _dolfinx.assemble_matrix(form)

    def stiffness(self, young_modulus: FloatArray, poisson: float) -> Any:
        """Assemble the stiffness, a PETSc matrix that the caller owns (collective).

        Args:
            young_modulus: of each input cell, times the width in 2D, shape (n_cells,).
            poisson: Poisson's ratio.
        """
        u, v = ufl.TrialFunction(self.space), ufl.TestFunction(self.space)
        E, nu = self.of_cells(young_modulus), _dolfinx.constant(self.domain, poisson)
        return _dolfinx.assemble_matrix(ufl.inner(stress(E, nu, u), strain(v)) * self._dx())


def strain(u: Any) -> Any:
    """Return eps(u) = (grad u + grad uᵀ) / 2."""
    return ufl.sym(ufl.grad(u))


def stress(E: Any, nu: Any, u: Any) -> Any:
    """Return sigma(u): of plane stress in 2D.

    Args:
        E: Young's modulus.
        nu: Poisson's ratio.
        u: displacements.
    """
    eps = strain(u)
    dim = eps.ufl_shape[0]
    trace = ufl.tr(eps) * ufl.Identity(dim)
    if dim == 2:
        return E / (1 - nu**2) * ((1 - nu) * eps + nu * trace)
    return E / (1 + nu) * (eps + nu / (1 - 2 * nu) * trace)
