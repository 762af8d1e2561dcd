"""Stresses of a solid at its nodes.

sigma follows from the gradients of the displacement by Hooke's law, as in `elasticity`. In a
quadrilateral or hexahedron of degree p it is most accurate at Gauss's points of p points in each
direction (J. Barlow, Int. J. Numer. Meth. Engng 10 (1976) 243); the polynomial of degree p - 1
through its values there is continued to the nodes. In a triangle or tetrahedron it is taken at the
nodes themselves. The stress of a node is the mean over the cells of the same lamina that share it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from delam_fem.model import _dolfinx
from delam_fem.model.solids.cells import TENSOR, jacobians_of
from delam_fem.model.solids.mesh import SolidMesh
from delam_fem.numerics.arrays import FloatArray, IntArray

COMPONENTS = {2: ((0, 0), (1, 1), (0, 1)), 3: ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2))}
"""Components of the stress by dimension, in VTK's order: xx, yy, zz, xy, yz, xz."""


@dataclass(frozen=True)
class Recovery:
    """The linear map from displacements to stresses at points.

    Attributes:
        nodes: global nodes of the cells, shape (n_cells, n_basis).
        gradients: of the basis at the sampled places, shape (n_cells, n_places, n_basis, dim).
        continued: values at the nodes of a cell from those at its places, (n_basis, n_places).
        mean: mean over the cells of a point, CSR (n_points, n_cells n_basis).
        moduli: Lamé's second parameter mu, and lambda, that of plane stress in two dimensions, of
            each cell, shape (2, n_cells) [Pa].
    """

    nodes: IntArray
    gradients: FloatArray
    continued: FloatArray
    mean: sp.csr_matrix
    moduli: FloatArray

    @classmethod
    def of(
        cls,
        mesh: SolidMesh,
        degree: int,
        nodes: IntArray,
        points: IntArray,
        young_modulus: FloatArray,
        poisson: float,
    ) -> Recovery:
        """Prepare the recovery.

        Args:
            mesh: the mesh.
            degree: of the displacements.
            nodes: global nodes of the cells of the mesh, shape (n_cells, n_basis).
            points: points of the cells, at which stresses are wanted, shape (n_cells, n_basis).
            young_modulus: of each cell, shape (n_cells,) [Pa].
            poisson: Poisson's ratio.
        """
        at_nodes = _dolfinx.reference_nodes(mesh.cell, degree)
        places, continued = sampled(mesh.cell, degree, at_nodes)
        corners, k = mesh.points[mesh.cells], len(places)
        every = np.repeat(corners, k, axis=0)
        inverse = np.linalg.inv(jacobians_of(mesh.cell, every, np.tile(places, (len(corners), 1))))
        inverse = inverse.reshape(len(corners), k, mesh.dim, mesh.dim)
        table = _dolfinx.tabulate(mesh.cell, degree, 1, places)[1:]
        gradients = np.einsum("dkb,ckdj->ckbj", table, inverse)
        rows = points.ravel()
        count = np.bincount(rows)
        mean = sp.csr_matrix((1.0 / count[rows], (rows, np.arange(rows.size))))
        nu, mu = poisson, young_modulus / (2.0 * (1.0 + poisson))
        spread = 1.0 - nu if mesh.dim == 2 else 1.0 - 2.0 * nu
        return cls(nodes, gradients, continued, mean, np.array([mu, 2.0 * mu * nu / spread]))

    def stress(self, displacement: FloatArray) -> FloatArray:
        """Return the stresses at the points, shape (n_points, n_components) [Pa].

        Args:
            displacement: of all nodes, shape (n_nodes, dim) [m].
        """
        grad = np.einsum("cbi,ckbj->ckij", displacement[self.nodes], self.gradients, optimize=True)
        mu, bulk = self.moduli[:, :, None, None, None]
        dim = grad.shape[-1]
        trace = np.trace(grad, axis1=2, axis2=3)[..., None, None]
        sigma = mu * (grad + grad.swapaxes(2, 3)) + bulk * trace * np.eye(dim)
        first, second = zip(*COMPONENTS[dim], strict=True)
        at_nodes = np.einsum("bk,cks->cbs", self.continued, sigma[:, :, first, second])
        return np.asarray(self.mean @ at_nodes.reshape(-1, len(first)))


def von_mises(sigma: FloatArray) -> FloatArray:
    """Return von Mises' equivalent stress, shape (n,) [Pa].

    Args:
        sigma: components of `COMPONENTS`, shape (n, 3) of plane stress, or (n, 6).
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
