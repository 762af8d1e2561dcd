"""Cubic Hermite beams in dolfinx: natural frequencies of a cantilever, in one file."""

# # Euler-Bernoulli beams with cubic Hermite elements
#
# dolfinx has no Hermite element with physical slopes, and does not need one. Two fields of degree
# 1, the deflection u and the slope p at the nodes, determine the cubic on each cell. On an interval
# a field f of degree 1 has the values f - X J f' and f + (1 - X) J f' at the ends of its cell; X in
# [0, 1] is the local coordinate, J the signed Jacobian. So the cubic w through (u, p) is an
# algebraic expression in UFL, right on graded meshes and on cells of either direction:
#
#     w = (1 - 3X² + 2X³) u0 + (X - 2X² + X³) J p0 + (3X² - 2X³) u1 + (X³ - X²) J p1
#
# The demo solves K w = ω² M w of a cantilever, ω² = (β/L)⁴ EI/(ρA), cosh β cos β = -1, and shows
# the order 4 of the frequencies.

import dolfinx
import dolfinx.fem.petsc
import numpy as np
import ufl
from mpi4py import MPI
from scipy.sparse import csr_matrix
from scipy.sparse.linalg import eigsh

BETA = np.array([1.875104068711961, 4.694091132974175, 7.854757438237613])


def hermite_space(mesh):
    """Return the space of (u, p), both of degree 1."""
    if hasattr(dolfinx.fem, "functionspace"):  # dolfinx 0.7 and later
        from basix.ufl import element, mixed_element

        linear = element("Lagrange", "interval", 1)
        return dolfinx.fem.functionspace(mesh, mixed_element([linear, linear]))
    linear = ufl.FiniteElement("Lagrange", mesh.ufl_cell(), 1)
    return dolfinx.fem.FunctionSpace(mesh, ufl.MixedElement([linear, linear]))


def cubic(mesh, u, p):
    """Return w and w'' of the cubic through the deflections u and the slopes p."""
    J = ufl.Jacobian(mesh)[0, 0]
    X = (ufl.SpatialCoordinate(mesh)[0] - ufl.geometry.CellVertices(mesh)[0, 0]) / J
    (u0, u1), (p0, p1) = ((f - X * J * f.dx(0), f + (1 - X) * J * f.dx(0)) for f in (u, p))
    w = (1 - 3 * X**2 + 2 * X**3) * u0 + (3 * X**2 - 2 * X**3) * u1
    w += J * ((X - 2 * X**2 + X**3) * p0 + (X**3 - X**2) * p1)
    return w, ((6 - 12 * X) * u.dx(0) + (6 * X - 4) * p0 + (6 * X - 2) * p1) / J


def assembled(form):
    """Return a bilinear form as a matrix of scipy."""
    matrix = dolfinx.fem.petsc.assemble_matrix(dolfinx.fem.form(form))
    matrix.assemble()
    return csr_matrix(matrix.getValuesCSR()[::-1])


# The unit beam, EI = ρA = L = 1, on cells that grow towards the tip. Both fields are held at x = 0.


def roots(n):
    """Return β of the three lowest modes of a cantilever with n cells."""
    mesh = dolfinx.mesh.create_unit_interval(MPI.COMM_SELF, n)
    mesh.geometry.x[:, 0] **= 1.2
    V = hermite_space(mesh)
    (w, bend), (v, turn) = (
        cubic(mesh, *ufl.split(f)) for f in (ufl.TrialFunction(V), ufl.TestFunction(V))
    )
    dx = ufl.dx(metadata={"quadrature_degree": 6})  # a cubic times a cubic
    M, K = assembled(w * v * dx), assembled(bend * turn * dx)
    start = dolfinx.mesh.locate_entities_boundary(mesh, 0, lambda x: x[0] < 1e-12)
    clamped = [dolfinx.fem.locate_dofs_topological(V.sub(i), 0, start) for i in range(2)]
    free = np.setdiff1d(np.arange(M.shape[0]), np.concatenate(clamped))
    return eigsh(K[free][:, free], 3, M[free][:, free], sigma=0.0)[0] ** 0.25


errors = [np.abs(roots(n) / BETA - 1.0) for n in (8, 16)]
order = np.log2(errors[0] / errors[1])
print(f"errors with 16 cells: {errors[1]}, orders: {np.round(order, 2)}")
assert np.all(errors[1] < 3e-5) and np.all(np.abs(order - 4.0) < 0.2)
