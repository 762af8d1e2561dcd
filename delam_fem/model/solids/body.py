"""The body of a solid structure: what its free dofs move, what it is made of, where it may touch.

Output reads it: operators and layout know dofs, pairs and readings alone. The first rank gets the
displacements of all nodes, state by state; nothing else of a state is gathered.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from delam_fem.model import _dolfinx
from delam_fem.model.solids import pressure
from delam_fem.model.solids.cells import shape_functions
from delam_fem.model.solids.elasticity import Solid
from delam_fem.model.solids.facing import Pairs
from delam_fem.model.solids.mesh import Facing, SolidMesh
from delam_fem.model.solids.stress import Recovery
from delam_fem.numerics.arrays import FloatArray, IntArray


@dataclass(frozen=True)
class Touching:
    """Two surfaces that may touch.

    Attributes:
        facing: the surfaces.
        pairs: those of their pairs that are rows of the gap matrix.
    """

    facing: Facing
    pairs: Pairs


@dataclass(frozen=True)
class Body:
    """A solid with its material, and the meaning of its free dofs.

    All dofs of the solid are `free @ u + base q`, u of the free dofs and q of the base; on several
    ranks each one has the columns of its own free dofs, and the sum over all ranks counts.

    Attributes:
        solid: the solid.
        free: CSR (n_dofs, n_own); see above.
        base: shape (n_dofs,).
        young_modulus: of each cell of the mesh, shape (n_cells,) [Pa].
        poisson: Poisson's ratio.
        width: of each lamina, shape (n_laminae,) [m]; surfaces of two dimensions are so wide.
        touching: surfaces that may touch, in the order of the layout's interfaces; their pairs
            follow one another in the gap matrix.
    """

    solid: Solid
    free: sp.csr_matrix
    base: FloatArray
    young_modulus: FloatArray
    poisson: float
    width: FloatArray
    touching: tuple[Touching, ...] = ()

    @property
    def mesh(self) -> SolidMesh:
        """The mesh."""
        return self.solid.mesh

    @property
    def is_first(self) -> bool:
        """Whether this rank gets what is gathered."""
        return self.solid.comm.rank == 0

    def gathered(self, vectors: FloatArray, base: FloatArray) -> FloatArray:
        """Return the displacements of all nodes on the first rank (collective).

        Args:
            vectors: values of the free dofs of this rank, shape (k, n_own).
            base: values of the base, shape (k,).

        Returns:
            Shape (k, n_nodes, dim) [m]; on the other ranks without nodes.
        """
        own = np.ascontiguousarray((self.free @ vectors.T).T)
        comm, dim = self.solid.comm, self.mesh.dim
        if comm.size > 1:
            total = np.empty_like(own) if self.is_first else None
            comm.Reduce(own, total, root=0)
            if total is None:
                return np.empty((len(vectors), 0, dim))
            own = total
        return np.asarray(own + base[:, None] * self.base).reshape(len(vectors), -1, dim)

    def shape(self) -> Shape:
        """Return the points and cells for output (collective)."""
        return Shape.of(self)

    def all_nodes(self) -> IntArray:
        """Return the global nodes of all cells of the mesh (collective), shape (n_cells, k)."""
        solid = self.solid
        cells = np.arange(len(self.mesh.cells))
        own = solid.nodes_of(cells)
        parts = solid.comm.allgather((np.flatnonzero(own[:, 0] >= 0), own[own[:, 0] >= 0]))
        result = np.empty((cells.size, max(nodes.shape[1] for _, nodes in parts)), dtype=np.int64)
        for where, nodes in parts:
            result[where] = nodes
        return result


@dataclass(frozen=True)
class Shape:
    """The laminae as points and cells for output, each lamina with points of its own.

    It holds arrays alone, nothing that ranks share.

    Attributes:
        mesh: the mesh.
        degree: of the displacements.
        nodes: global nodes of all cells, shape (n_cells, k).
        young_modulus: of each cell, shape (n_cells,) [Pa].
        poisson: Poisson's ratio.
        width: of each lamina, shape (n_laminae,) [m].
        touching: surfaces that may touch.
    """

    mesh: SolidMesh
    degree: int
    nodes: IntArray
    young_modulus: FloatArray
    poisson: float
    width: FloatArray
    touching: tuple[Touching, ...]

    @classmethod
    def of(cls, body: Body) -> Shape:
        """Return the shape of a body (collective)."""
        material = body.young_modulus, body.poisson, body.width
        return cls(body.mesh, body.solid.degree, body.all_nodes(), *material, body.touching)

    @cached_property
    def _numbering(self) -> tuple[IntArray, IntArray, IntArray]:
        lamina = np.repeat(self.mesh.lamina, self.nodes.shape[1])
        keys = lamina * (int(self.nodes.max()) + 1) + self.nodes.ravel()
        _, first, number = np.unique(keys, return_index=True, return_inverse=True)
        return first, number.reshape(self.nodes.shape), lamina[first]

    @property
    def cells(self) -> IntArray:
        """Points of the cells in the order of basix, shape (n_cells, k)."""
        return self._numbering[1]

    @cached_property
    def node(self) -> IntArray:
        """Global node of each point, shape (n_points,)."""
        return np.asarray(self.nodes.ravel()[self._numbering[0]])

    @property
    def lamina(self) -> IntArray:
        """Lamina of each point, shape (n_points,)."""
        return self._numbering[2]

    @property
    def reference_nodes(self) -> FloatArray:
        """Reference coordinates of the nodes of a cell, shape (k, dim)."""
        return _dolfinx.reference_nodes(self.mesh.cell, self.degree)

    @cached_property
    def points(self) -> FloatArray:
        """Positions of the points in the mesh, shape (n_points, dim) [m]."""
        mesh = self.mesh
        N, _ = shape_functions(mesh.cell, self.reference_nodes)
        every = np.einsum("bv,cvi->cbi", N, mesh.points[mesh.cells])
        return np.asarray(every.reshape(-1, mesh.dim)[self._numbering[0]])

    @cached_property
    def recovery(self) -> Recovery:
        """What recovers stresses at the points."""
        material = self.young_modulus, self.poisson
        return Recovery.of(self.mesh, self.degree, self.nodes, self.cells, *material)

    @cached_property
    def pressing(self) -> tuple[sp.csr_matrix, ...]:
        """Pressure at the points by unit forces of the pairs of each interface, (n, n_pairs) each.

        Both surfaces have the pressure.
        """
        mesh, places, n = self.mesh, self.reference_nodes, len(self.node)
        result = []
        for own in self.touching:
            width = float(self.width[list(own.facing.parts)].min()) if mesh.dim == 2 else 1.0
            total = sp.csr_matrix((n, len(own.pairs.gap)))
            for side in pressure.sides_of(mesh, own.facing, own.pairs):
                normals = own.pairs.lower.normals
                vertices, by_forces = pressure.at_vertices(mesh, side, normals, width)
                to = pressure.at_points(mesh, side, vertices, places, self.cells, n)
                total = total + to @ by_forces
            result.append(sp.csr_matrix(total))
        return tuple(result)
