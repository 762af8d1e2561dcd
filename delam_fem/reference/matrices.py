"""Assemble the matrices of two clamped laminae for the reference, by an independent derivation.

The cubic shape functions follow from their end conditions, the element matrices from integrals of
products of polynomials, the lumped mass from the consistent mass, and the damping from the roots of
cos B cosh B = -1. The reference shares only the case with the code that it checks.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp
from numpy.polynomial import Polynomial
from scipy.interpolate import PchipInterpolator
from scipy.linalg import eigh
from scipy.optimize import brentq

from delam_fem.case.definition import Case
from delam_fem.case.sections import Gap, Lamina
from delam_fem.model.operators import BaseCoupling, Operators
from delam_fem.numerics.types import FloatArray
from delam_fem.system.errors import CaseError

DOFS = 2
"""Number of dofs of a node: displacement u and slope phi."""
_NO_SHAPE = 1e-14
"""Value of a shape function that is round-off: it is zero at this place."""
_ROOT_TOLERANCE = 1e-15
"""Absolute tolerance of the roots B, which are of order 1."""


def assemble(case: Case, x: npt.ArrayLike) -> Operators:
    """Assemble both laminae over the same nodes, free dofs of lamina 1 before those of lamina 2.

    Args:
        case: the case; its mesh is not used.
        x: positions of the nodes from 0 to the length, shape (n_nodes,) [m].

    Returns:
        The operators; a gap opens as u2 - u1 grows.
    """
    if case.gap is None:
        raise CaseError("reference: expected a section gap for laminae that are apart")
    x = np.asarray(x, dtype=np.float64)
    laminae = [_lamina(case, lamina, x) for lamina in case.lamina]
    free, clamps = _partition(x.size)
    whole = [sp.block_diag(matrices) for matrices in zip(*laminae, strict=True)]
    M, C, K, lumped = (sp.csr_matrix(free.T @ matrix @ free) for matrix in whole)
    m, c, k = (free.T @ (matrix @ clamps) for matrix in whole[:3])
    m_aa, c_aa, k_aa = (float(clamps @ (matrix @ clamps)) for matrix in whole[:3])
    n = x.size - 1
    u = np.arange(0, 2 * n * DOFS, DOFS)  # dofs of displacements, lamina 1 and lamina 2
    eye = sp.identity(2 * n * DOFS, format="csr")
    places, rows, shares = _contact_points(x, case.contact.points_per_element)
    on_lamina = sp.csr_matrix(rows[:, DOFS:])
    return Operators(
        mass=M,
        damping=C,
        stiffness=K,
        lumped_mass=lumped.diagonal(),
        base=BaseCoupling(m, c, k, corner=(m_aa, c_aa, k_aa)),
        gap_matrix=sp.hstack([-on_lamina, on_lamina], format="csr"),
        gap0=gap_at_rest(case.gap, places, case.lamina[0].length),
        pair_weights=None if case.contact.points_per_element == 1 else shares,
        probes=sp.csr_matrix(eye[u[[n - 1, 2 * n - 1]]]),
    )


def natural_frequencies(operators: Operators, n: int) -> FloatArray:
    """Return the lowest natural frequencies of each lamina, shape (2, n) [Hz].

    Args:
        operators: as `assemble` returns them.
        n: number of frequencies per lamina, at most the number of its dofs.
    """
    half = operators.n_dofs // 2
    found = []
    for own in (slice(0, half), slice(half, None)):
        M, K = (m[own, own].toarray() for m in (operators.mass, operators.stiffness))
        # largest 1/omega^2: as omega^2, low frequencies would drown in the round-off of high ones
        squares = eigh(M, K, eigvals_only=True, subset_by_index=(half - n, half - 1))
        found.append(1.0 / (2.0 * np.pi * np.sqrt(squares[::-1])))
    return np.array(found)


def section(lamina: Lamina) -> tuple[float, float]:
    """Return the mass per length rho A [kg/m] and the bending stiffness EI [N m2] of a lamina."""
    area = lamina.width * lamina.thickness
    inertia = area * lamina.thickness**2 / 12.0
    given = lamina.bending_stiffness
    return lamina.density * area, lamina.young_modulus * inertia if given is None else given


def shape_functions(h: float) -> list[Polynomial]:
    """Return the four cubic shape functions N of an element.

    For each function one of the end values w(0), w'(0), w(h), w'(h) is 1 and the other three are 0.

    Args:
        h: length of the element [m].
    """
    powers = [_cubic(unit, h) for unit in np.eye(4)]
    ends = np.array([[end for s in (0.0, h) for end in _value_and_slope(p, s)] for p in powers])
    return [_cubic(coefficients, h) for coefficients in np.linalg.inv(ends)]


def element_mass(mass_per_length: float, h: float) -> FloatArray:
    """Return the consistent mass of an element, the integrals of rho A N_i N_j, shape (4, 4)."""
    return mass_per_length * _products(shape_functions(h), h)


def element_stiffness(flexural_rigidity: float, h: float) -> FloatArray:
    """Return the stiffness of an element, the integrals of EI N_i'' N_j'', shape (4, 4)."""
    return flexural_rigidity * _products([_derivative(N, 2) for N in shape_functions(h)], h)


def lumped_mass(mass_per_length: float, h: float) -> FloatArray:
    """Return the diagonal of the lumped mass of an element, shape (4,) [kg, kg m2].

    The diagonal of the consistent mass is scaled so that the entries of both displacements add up
    to the mass of the element.

    Source: E. Hinton, T. Rock, O. Zienkiewicz, "A note on mass lumping and related processes in
    the finite element method", Earthquake Eng. Struct. Dyn. 4 (1976).
    """
    diagonal = np.diag(element_mass(mass_per_length, h))
    scaled: FloatArray = diagonal * (mass_per_length * h / diagonal[::DOFS].sum())
    return scaled


def wave_numbers(n: int) -> list[float]:
    """Return the first n roots of cos B cosh B = -1; root k lies between (k - 1) pi and k pi."""

    def equation(B: float) -> float:
        return float(np.cos(B) + 1.0 / np.cosh(B))

    return [
        float(brentq(equation, k * np.pi, (k + 1) * np.pi, xtol=_ROOT_TOLERANCE)) for k in range(n)
    ]


def rayleigh(case: Case, lamina: Lamina) -> tuple[float, float]:
    """Return alpha [1/s] and beta [s] from the damping ratios alpha/(2 omega) + beta omega/2 = D.

    Args:
        case: case, which defines the modes with the ratio D.
        lamina: one of its laminae.
    """
    D = lamina.damping_ratio
    rhoA, EI = section(lamina)
    omega = np.array([(B / lamina.length) ** 2 * np.sqrt(EI / rhoA) for B in wave_numbers(2)])
    return coefficients(case, D, omega)


def coefficients(case: Case, D: float, omega: FloatArray) -> tuple[float, float]:
    """Return alpha [1/s] and beta [s] that give two modes the damping ratio D.

    Args:
        case: says which terms there are; with one term, the first mode has the ratio.
        D: damping ratio [-].
        omega: angular frequencies of the modes, shape (2,) [1/s].
    """
    ratios = np.column_stack([0.5 / omega, 0.5 * omega])  # of both modes per alpha and beta
    if case.damping.rayleigh == "stiffness":
        return 0.0, float(D / ratios[0, 1])
    if case.damping.rayleigh == "mass":
        return float(D / ratios[0, 0]), 0.0
    alpha, beta = np.linalg.solve(ratios, [D, D])
    return float(alpha), float(beta)


def gap_at_rest(gap: Gap, x: FloatArray, length: float) -> FloatArray:
    """Return the gap at the nodes [m]: a power of x, the first mode, or a table with PCHIP.

    Args:
        gap: the section `gap` of the case.
        x: positions of the nodes, shape (n_nodes,) [m].
        length: length of the laminae [m].
    """
    if gap.file is not None:
        places, heights = tabulated(gap.file)
        places[0] = 0.0  # the table may miss the clamp by round-off
        return np.asarray(PchipInterpolator(places, heights)(np.minimum(x, places[-1])))
    assert gap.tip is not None  # a case has a table or the gap at the tip
    low = 0.0 if gap.root is None else gap.root
    if gap.exponent is not None:
        share = (x / length) ** gap.exponent
        return np.asarray((1.0 - share) * low + share * gap.tip)
    (B,) = wave_numbers(1)
    z = B * np.append(x / length, 1.0)
    slope = (np.sinh(B) - np.sin(B)) / (np.cosh(B) + np.cos(B))
    mode = np.cosh(z) - np.cos(z) - slope * (np.sinh(z) - np.sin(z))
    share = mode[:-1] / mode[-1]
    return np.asarray((1.0 - share) * low + share * gap.tip)


def tabulated(file: Path) -> tuple[FloatArray, FloatArray]:
    """Return the two columns of a table; what is no number is skipped."""
    rows = []
    for line in file.read_text(encoding="utf-8-sig").splitlines():
        text = line.partition("#")[0].strip()
        if ";" in text or "\t" in text or re.fullmatch(r"\S*\d\s+\S+", text):
            text = re.sub(r"[;\t\s]+", " ", text.replace(",", "."))  # commas are decimal here
        cells = [cell for cell in re.split(r"[,\s]+", text) if cell]
        try:
            rows.append([float(cell) for cell in cells])
        except ValueError:
            continue
    places, heights = np.array([row for row in rows if row]).T
    return places, heights


def _contact_points(x: FloatArray, p: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the contact points of an interface: p in each element, the last one at its end.

    Returns:
        Positions, shape (n_pairs,) [m]; the displacement there per dof of a lamina, clamp included,
        shape (n_pairs, n_dofs); the share of each point in a spring per element of mean length,
        shape (n_pairs,).
    """
    lengths = np.diff(x)
    rows = np.zeros((lengths.size * p, DOFS * x.size))
    places = np.empty(lengths.size * p)
    for k, h in enumerate(lengths.tolist()):
        for j in range(p):
            s = h if j == p - 1 else h * (j + 1) / p
            places[k * p + j] = x[k + 1] if j == p - 1 else x[k] + s
            values = [float(N(s)) for N in shape_functions(h)]
            rows[k * p + j, DOFS * k : DOFS * (k + 2)] = values
    rows[np.abs(rows) < _NO_SHAPE] = 0.0
    spacing = np.repeat(lengths / p, p)
    halves = 0.5 * (spacing + np.append(spacing[1:], 0.0))
    return places, rows, halves / lengths.mean()


def _cubic(coefficients: FloatArray, h: float) -> Polynomial:
    """Return the polynomial in s/h with the given coefficients, as a function of s [m]."""
    return Polynomial(coefficients, domain=[0.0, h], window=[0.0, 1.0])


def _derivative(f: Polynomial, times: int) -> Polynomial:
    """Return the derivative of a polynomial of the order `times`."""
    derived: Polynomial = f.deriv(times)  # type: ignore[no-untyped-call]
    return derived


def _value_and_slope(f: Polynomial, s: float) -> tuple[float, float]:
    """Return f(s) and f'(s)."""
    return float(f(s)), float(_derivative(f, 1)(s))


def _products(functions: list[Polynomial], h: float) -> FloatArray:
    """Return the integrals of f_i f_j from 0 to h, shape (4, 4)."""
    return np.array([[(f * g).integ(lbnd=0.0)(h) for g in functions] for f in functions])


def _lamina(case: Case, lamina: Lamina, x: FloatArray) -> list[sp.csr_matrix]:
    """Return M, C, K and the lumped mass of one lamina, with the clamped dofs."""
    rhoA, EI = section(lamina)
    lengths = np.diff(x).tolist()
    lumps = [np.diag(lumped_mass(rhoA, h)) for h in lengths]
    masses = [element_mass(rhoA, h) for h in lengths]
    for k, consistent, diagonal in point_masses(case, lamina.name, x):
        masses[k], lumps[k] = masses[k] + consistent, lumps[k] + diagonal
    lumped = _sum(lumps)
    M = lumped if case.time.mass == "lumped" else _sum(masses)
    K = _sum([element_stiffness(EI, h) for h in lengths])
    alpha, beta = rayleigh(case, lamina)
    return [M, sp.csr_matrix(alpha * M + beta * K), K, lumped]


def point_masses(case: Case, name: str, x: FloatArray) -> list[tuple[int, FloatArray, FloatArray]]:
    """Return element, mass matrix and lumped mass of each point mass on a lamina.

    Args:
        case: gives the masses.
        name: name of the lamina.
        x: positions of the nodes [m].
    """
    found = []
    for own in case.point_mass:
        if own.lamina == name:
            place = float(x[-1]) if own.position is None else own.position
            k = int(np.clip(np.searchsorted(x, place) - 1, 0, x.size - 2))
            h, s = float(x[k + 1] - x[k]), place - float(x[k])
            N = np.array([float(f(s)) for f in shape_functions(h)])
            ends = own.mass * np.array([1.0 - s / h, 0.0, s / h, 0.0])
            found.append((k, own.mass * np.outer(N, N), np.diag(ends)))
    return found


def _sum(elements: list[FloatArray]) -> sp.csr_matrix:
    """Return the matrix of a lamina as the sum of its element matrices, in order along x."""
    matrix = sp.lil_matrix((DOFS * (len(elements) + 1),) * 2)
    for k, element in enumerate(elements):
        own = slice(DOFS * k, DOFS * (k + 2))
        matrix[own, own] = matrix[own, own] + element
    return matrix.tocsr()


def _partition(n_nodes: int) -> tuple[sp.csr_matrix, FloatArray]:
    """Return R and e in q = R q_free + e q_base, where q contains all dofs of both laminae.

    The clamps share the displacement of the base, and their slopes are 0.
    """
    dofs = np.arange(2 * n_nodes * DOFS)
    node = dofs // DOFS % n_nodes
    clamps = ((node == 0) & (dofs % DOFS == 0)).astype(np.float64)
    return sp.identity(dofs.size, format="csc")[:, node > 0].tocsr(), clamps
