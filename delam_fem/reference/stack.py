"""Assemble a bonded stack for the reference, by constraints instead of a transformation.

Every lamina has cubic deflections and quadratic axial displacements of its own middle plane over
its whole length. Where neighbours are bonded, the laminae share deflection and slope, and

    u_upper - u_lower + (z_upper - z_lower) w' = 0

at the ends and in the middle of every bonded element, which makes sections plane everywhere because
w' is quadratic too. The axial displacements carry no mass; for given deflections they minimise the
strain energy under these constraints (a saddle point problem). Free dofs are numbered node by node,
from the bottom, deflection before slope.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp
from numpy.polynomial import Polynomial
from scipy.interpolate import PchipInterpolator
from scipy.linalg import eigh

from delam_fem.case.definition import Case
from delam_fem.model.operators import BaseCoupling, Operators
from delam_fem.numerics.types import BoolArray, FloatArray, IntArray
from delam_fem.reference import matrices as elements
from delam_fem.system.errors import CaseError

HELD, MOVED = -1, -2
"""In place of a free dof: it is zero, or it moves with the base."""


@dataclass(frozen=True)
class Stack:
    """A stack of laminae over common nodes.

    Attributes:
        case: the case.
        x: positions of the nodes [m].
        is_bonded: of each interface in each element, shape (n_laminae - 1, n_nodes - 1).
        dofs: free dof, HELD or MOVED of deflection and slope, shape (n_laminae, n_nodes, 2).
        n_free: number of free dofs.
    """

    case: Case
    x: FloatArray
    is_bonded: BoolArray
    dofs: IntArray
    n_free: int

    @classmethod
    def of(cls, case: Case, x: FloatArray) -> Stack:
        """Number the dofs of a case."""
        names = [lamina.name for lamina in case.lamina]
        middles = 0.5 * (x[1:] + x[:-1])
        is_bonded = np.ones((len(names) - 1, middles.size), dtype=np.bool_)
        for own in case.delamination:
            inside = (middles > own.start) & (middles < own.end)
            is_bonded[names.index(own.between[0]), inside] = False
        dofs = np.empty((len(names), x.size, 2), dtype=np.int64)
        kinds = {0: case.support.start, x.size - 1: case.support.end}
        n = 0
        for node in range(x.size):
            kind = kinds.get(node, "free")
            for i in range(len(names)):
                if i > 0 and is_bonded[i - 1, max(node - 1, 0) : node + 1].any():
                    dofs[i, node] = dofs[i - 1, node]
                    continue
                dofs[i, node, 0] = n if kind == "free" else MOVED
                n += kind == "free"
                dofs[i, node, 1] = HELD if kind == "clamped" else n
                n += kind != "clamped"
        return cls(case, x, is_bonded, dofs, n)

    @property
    def sections(self) -> FloatArray:
        """Rows ρA [kg/m], EI [N m2], EA [N], z of the middle plane [m] of the laminae."""
        rows, bottom = [], 0.0
        for lamina in self.case.lamina:
            rhoA, EI = elements.section(lamina)
            EA = lamina.young_modulus * lamina.width * lamina.thickness
            rows.append((rhoA, EI, EA, bottom + lamina.thickness / 2.0))
            bottom += lamina.thickness
        return np.array(rows).T

    def column(self, dof: int) -> int | None:
        """Return the column of a dof: the free dofs, then the base; None if it is held."""
        return None if dof == HELD else self.n_free if dof == MOVED else dof

    def summed(self, blocks: list[tuple[int, int, FloatArray]]) -> sp.csr_matrix:
        """Sum element matrices, each with its lamina and element, over the columns."""
        total = np.zeros((self.n_free + 1,) * 2)
        for i, k, block in blocks:
            columns = [self.column(int(dof)) for dof in self.dofs[i, k : k + 2].ravel()]
            there = [j for j, column in enumerate(columns) if column is not None]
            own = [column for column in columns if column is not None]
            total[np.ix_(own, own)] += block[np.ix_(there, there)]
        return sp.csr_matrix(total)


def assemble(case: Case, x: npt.ArrayLike, observed: int) -> Operators:
    """Assemble a bonded stack.

    Args:
        case: the case; its mesh is not used.
        x: positions of the nodes, one at each edge of a delamination [m].
        observed: node whose displacements are the probes, one of each lamina.

    Raises:
        CaseError: contact points lie inside the elements.
    """
    if case.contact.points_per_element != 1:
        raise CaseError("reference: expected contact.points_per_element = 1 for a bonded stack")
    stack = Stack.of(case, np.asarray(x, dtype=np.float64))
    rhoA, EI = stack.sections[:2]
    places = [(i, k, h) for i in range(len(rhoA)) for k, h in enumerate(np.diff(stack.x).tolist())]
    lumps = [(i, k, np.diag(elements.lumped_mass(rhoA[i], h))) for i, k, h in places]
    masses = [(i, k, elements.element_mass(rhoA[i], h)) for i, k, h in places]
    for i, lamina in enumerate(case.lamina):
        for k, consistent, diagonal in elements.point_masses(case, lamina.name, stack.x):
            masses.append((i, k, consistent))
            lumps.append((i, k, diagonal))
    lumped = stack.summed(lumps)
    M = stack.summed(masses) if case.time.mass == "consistent" else lumped
    K = stack.summed([(i, k, elements.element_stiffness(EI[i], h)) for i, k, h in places])
    K = sp.csr_matrix(K + axial_stiffness(stack))
    H, gap0 = _pairs(stack)
    alpha, beta = _rayleigh(stack, M, K, H)
    C = sp.csr_matrix(alpha * M + beta * K)
    n = stack.n_free
    m, c, k = (matrix[:n, n].toarray().ravel() for matrix in (M, C, K))
    m_aa, c_aa, k_aa = (float(matrix[n, n]) for matrix in (M, C, K))
    eye = sp.identity(n, format="csr")
    return Operators(
        mass=M[:n, :n],
        damping=C[:n, :n],
        stiffness=K[:n, :n],
        lumped_mass=lumped.diagonal()[:n],
        base=BaseCoupling(m, c, k, corner=(m_aa, c_aa, k_aa)),
        gap_matrix=H,
        gap0=gap0,
        probes=sp.csr_matrix(eye[stack.dofs[:, observed, 0]]),
    )


def lowest_frequencies(operators: Operators, n: int) -> FloatArray:
    """Return the lowest natural frequencies of a stack, increasing, shape (n,) [Hz]."""
    K, M = operators.stiffness.toarray(), operators.mass.toarray()
    squares = eigh(K, M, eigvals_only=True, subset_by_index=(0, n - 1))
    return np.asarray(np.sqrt(np.maximum(squares, 0.0)) / (2.0 * np.pi))


def axial_stiffness(stack: Stack) -> FloatArray:
    """Return what the axial displacements add to the stiffness of free dofs and base."""
    G_u, G_d = _constraints(stack)
    K_u = _stretching(stack)
    n, m = K_u.shape[0], G_u.shape[0]
    scale = np.abs(K_u).max()
    saddle = np.block([[K_u / scale, G_u.T], [G_u, np.zeros((m, m))]])
    right = np.vstack([np.zeros((n, G_d.shape[1])), -G_d])
    U = np.linalg.lstsq(saddle, right, rcond=1e-14)[0][:n]
    return np.asarray(U.T @ K_u @ U)


def _stretching(stack: Stack) -> FloatArray:
    """Return the stiffness of all quadratic axial displacements, lamina by lamina."""
    own = 2 * stack.x.size - 1
    EA = stack.sections[2]
    total = np.zeros((own * len(EA),) * 2)
    for k, h in enumerate(np.diff(stack.x).tolist()):
        bases = [
            Polynomial.fit([0.0, 0.5 * h, h], values, 2).deriv()  # type: ignore[no-untyped-call]
            for values in np.eye(3)
        ]
        block = np.array([[(f * g).integ(lbnd=0.0)(h) for g in bases] for f in bases])
        for i, stiffness in enumerate(EA):
            at = own * i + 2 * k + np.arange(3)
            total[np.ix_(at, at)] += stiffness * block
    return total


def _constraints(stack: Stack) -> tuple[FloatArray, FloatArray]:
    """Return G_u and G_d of G_u u + G_d d = 0: plane sections and axial supports."""
    n_laminae, own = len(stack.case.lamina), 2 * stack.x.size - 1
    EA, z = stack.sections[2:]
    rows: dict[tuple[int, int], tuple[FloatArray, FloatArray]] = {}

    def empty() -> tuple[FloatArray, FloatArray]:
        return np.zeros(own * n_laminae), np.zeros(stack.n_free + 1)

    for k, h in enumerate(np.diff(stack.x).tolist()):
        N = elements.shape_functions(h)
        for j in np.flatnonzero(stack.is_bonded[:, k]):
            for point, s in enumerate((0.0, 0.5 * h, h)):
                u, d = empty()
                u[own * j + 2 * k + point] = -1.0
                u[own * (j + 1) + 2 * k + point] = 1.0
                for dof, f in zip(stack.dofs[j, k : k + 2].ravel().tolist(), N, strict=True):
                    column = stack.column(dof)
                    if column is not None:
                        slope = f.deriv()(s)  # type: ignore[no-untyped-call]
                        d[column] += (z[j + 1] - z[j]) * float(slope)
                rows[int(j), 2 * k + point] = u, d
    found = list(rows.values())
    ends = ((0, stack.case.support.start), (stack.x.size - 1, stack.case.support.end))
    for node, kind in ends:
        if kind == "free":
            continue
        element = 0 if node == 0 else node - 1
        cuts = [0, *(np.flatnonzero(~stack.is_bonded[:, element]) + 1).tolist(), n_laminae]
        for first, last in pairwise(cuts):
            u, d = empty()  # the neutral axis of each group of bonded laminae is held
            for i in range(first, last):
                u[own * i + 2 * node] = EA[i] / EA[first:last].sum()
            found.append((u, d))
    return np.array([u for u, _ in found]), np.array([d for _, d in found])


def _pairs(stack: Stack) -> tuple[sp.csr_matrix, FloatArray]:
    """Return H and the gaps at rest of the nodes at which neighbours are apart."""
    rows, gaps = [], []
    for j in range(len(stack.case.lamina) - 1):
        for node, place in enumerate(stack.x.tolist()):
            lower, upper = stack.dofs[j : j + 2, node, 0].tolist()
            if lower != upper:
                row = np.zeros(stack.n_free)
                row[lower], row[upper] = -1.0, 1.0
                rows.append(row)
                gaps.append(_opening(stack.case, j, place))
    return sp.csr_matrix(np.array(rows).reshape(-1, stack.n_free)), np.array(gaps)


def _opening(case: Case, interface: int, x: float) -> float:
    """Return the gap at rest of an interface at a place within a delamination [m]."""
    between = (case.lamina[interface].name, case.lamina[interface + 1].name)
    (own,) = [d for d in case.delamination if d.between == between and d.start <= x <= d.end]
    if own.file is not None:
        return float(PchipInterpolator(*elements.tabulated(own.file))(x))
    s = (x - own.start) / (own.end - own.start)
    if own.shape == "power":
        if case.support.start == "free" and own.start == 0.0:
            s = 1.0 - s
        return float(own.opening * s ** (own.exponent or 2.0))
    return float(own.opening * np.cos(np.pi * (s - 0.5)))


def _rayleigh(
    stack: Stack, M: sp.csr_matrix, K: sp.csr_matrix, H: sp.csr_matrix
) -> tuple[float, float]:
    """Return alpha [1/s] and beta [s] by the lowest modes of the stack kept closed."""
    case, n = stack.case, stack.n_free
    _, EI, EA, z = stack.sections
    share = EI + EA * (z - EA @ z / EA.sum()) ** 2
    D = float(share @ [lamina.damping_ratio for lamina in case.lamina] / share.sum())
    together = H.toarray()
    slopes = np.zeros_like(together)
    slopes[:, 1:] = together[:, :-1]  # a slope follows its deflection
    _, sizes, V = np.linalg.svd(np.vstack([together, slopes]))
    closed = V[np.count_nonzero(sizes > 1e-12) :].T
    small = [closed.T @ matrix[:n, :n].toarray() @ closed for matrix in (M, K)]
    kinds = (case.support.start, case.support.end)
    rigid = 0 if "clamped" in kinds else 2 - kinds.count("pinned")
    squares = eigh(small[1], small[0], eigvals_only=True)[rigid : rigid + 2]
    return elements.coefficients(case, D, np.sqrt(squares))
