"""Assemble the matrices of the reference: laminae that are apart, and bonded stacks.

The matrices of the laminae are derived independently of the package. The cubic shape
functions follow from their end conditions, the element matrices from integrals of products of
polynomials, the lumped mass from the consistent mass, and the damping from the roots of cos B cosh
B = -1. The reference shares only the case with the code that it checks.

A bonded stack is assembled by constraints instead of a transformation. Every lamina has cubic
deflections and quadratic axial displacements of its own middle plane over its whole length. Where
neighbours are bonded, the laminae share deflection and slope, and

    u_upper - u_lower + (z_upper - z_lower) w' = 0

at the ends and in the middle of every bonded element, which makes sections plane everywhere because
w' is quadratic too. The axial displacements carry no mass; for given deflections they minimise the
strain energy under these constraints (a saddle point problem). Free dofs are numbered node by node,
from the bottom, deflection before slope; those of laminae that are apart lamina by lamina.

Weight and loads are integrals of the shape functions, and the geometric stiffness ∫ N w' v' dx
those of their slopes. The axial force N of a lamina that is apart is what hangs behind each place;
of one that is held at both ends, its mean is 0.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp
from numpy.polynomial import Polynomial
from scipy.interpolate import PchipInterpolator
from scipy.linalg import eigh
from scipy.optimize import brentq
from scipy.sparse.linalg import splu

from delam_fem.case.definition import Case
from delam_fem.case.sections import InitialGap, Lamina, Profile, x_of
from delam_fem.model.operators import BaseCoupling, Operators
from delam_fem.numerics.types import BoolArray, FloatArray, IntArray
from delam_fem.system.errors import CaseError

DOFS = 2
"""Number of dofs of a node: displacement u and slope phi."""
_NO_SHAPE = 1e-14
"""Size below which the value of a shape function is round-off of zero."""
_ROOT_TOLERANCE = 1e-15
"""Absolute tolerance of the roots B, which are of order 1."""


def natural_frequencies(operators: Operators, n: int) -> FloatArray:
    """Return the lowest natural frequencies of each lamina, shape (n_laminae, n) [Hz].

    Args:
        operators: of laminae that are apart, as `assemble` returns them.
        n: number of frequencies per lamina, at most the number of its dofs.
    """
    each = operators.n_dofs // operators.n_probes
    result = []
    for first in range(0, operators.n_dofs, each):
        dofs = slice(first, first + each)
        M, K = (m[dofs, dofs].toarray() for m in (operators.mass, operators.stiffness))
        # largest 1/omega^2: as omega^2, low frequencies would drown in the round-off of high ones
        squares = eigh(M, K, eigvals_only=True, subset_by_index=(each - n, each - 1))
        result.append(1.0 / (2.0 * np.pi * np.sqrt(squares[::-1])))
    return np.array(result)


def section(lamina: Lamina) -> tuple[float, float]:
    """Return the mass per length rho A [kg/m] and the bending stiffness EI [N m2] of a lamina."""
    h = _constant(lamina, "thickness")
    area = _constant(lamina, "width") * h
    inertia = area * h**2 / 12.0
    bending_stiffness = lamina.bending_stiffness
    E = _constant(lamina, "young_modulus")
    return (
        _constant(lamina, "density") * area,
        E * inertia if bending_stiffness is None else bending_stiffness,
    )


def _constant(lamina: Lamina, key: str) -> float:
    """Return a property that is the same all along a lamina.

    Raises:
        CaseError: it is a table.
    """
    value = getattr(lamina, key)
    if isinstance(value, Profile):
        raise CaseError(f"reference: lamina.{lamina.name}.{key}: expected a number, given a table")
    return float(value)


def _line(lamina: Lamina, key: str, x: float, h: float) -> Polynomial:
    """Return a property over an element from x to x + h, as a function of s from 0 to h."""
    value = getattr(lamina, key)
    if not isinstance(value, Profile):
        ends = [float(value), float(value)]
    elif value.steps:
        middle = x + 0.5 * h
        ends = [v for place, v in zip(value.x, value.value, strict=True) if place < middle][-1:] * 2
    else:
        ends = [float(np.interp(place, value.x, value.value)) for place in (x, x + h)]
    return Polynomial([ends[0], ends[1] - ends[0]], domain=[0.0, h], window=[0.0, 1.0])


def varying_element(lamina: Lamina, x: float, h: float) -> tuple[FloatArray, FloatArray]:
    """Return consistent mass and stiffness of an element whose section changes, each (4, 4).

    Where a bending stiffness EI is given, it counts in place of E b t³/12.
    """
    shapes = shape_functions(h)
    rho, b, t, E = (
        _line(lamina, k, x, h) for k in ("density", "width", "thickness", "young_modulus")
    )
    EI = E * b * t * t * t / 12.0
    bends = [N.deriv(2) for N in shapes]  # type: ignore[no-untyped-call]
    mass, stiffness = (
        np.array([[(weight * f * g).integ(lbnd=0.0)(h) for g in functions] for f in functions])
        for weight, functions in ((rho * b * t, shapes), (EI, bends))
    )
    return mass, stiffness


def varying_lumped_mass(lamina: Lamina, x: float, h: float) -> FloatArray:
    """Return the lumped mass of an element whose section changes, shape (4,) [kg, kg m2].

    Each end has that of an element with the section there.
    """
    rho, b, t = (_line(lamina, key, x, h) for key in ("density", "width", "thickness"))
    first, last = (lumped_mass(float((rho * b * t)(s)), h) for s in (0.0, h))
    return np.concatenate([first[:DOFS], last[DOFS:]])


def shape_functions(h: float) -> list[Polynomial]:
    """Return the four cubic shape functions N of an element.

    For each function one of the end values w(0), w'(0), w(h), w'(h) is 1 and the other three are 0.

    Args:
        h: length of the element [m].
    """
    powers = [_cubic(unit, h) for unit in np.eye(4)]
    pairs = [(p, p.deriv()) for p in powers]  # type: ignore[no-untyped-call]
    ends = np.array([[float(f(s)) for s in (0.0, h) for f in pair] for pair in pairs])
    return [_cubic(coefficients, h) for coefficients in np.linalg.inv(ends)]


def element_mass(mass_per_length: float, h: float) -> FloatArray:
    """Return the consistent mass of an element, the integrals of rho A N_i N_j, shape (4, 4)."""
    return mass_per_length * _products(shape_functions(h), h)


def element_stiffness(flexural_rigidity: float, h: float) -> FloatArray:
    """Return the stiffness of an element, the integrals of EI N_i'' N_j'', shape (4, 4)."""
    curvatures = [N.deriv(2) for N in shape_functions(h)]  # type: ignore[no-untyped-call]
    return flexural_rigidity * _products(curvatures, h)


def lumped_mass(mass_per_length: float, h: float) -> FloatArray:
    """Return the diagonal of the lumped mass of an element, shape (4,) [kg, kg m2].

    The diagonal of the consistent mass is scaled so that the entries of both displacements add up
    to the mass of the element.

    Source: E. Hinton, T. Rock, O. Zienkiewicz, "A note on mass lumping and related processes in
    the finite element method", Earthquake Eng. Struct. Dyn. 4 (1976).
    """
    diagonal = np.diag(element_mass(mass_per_length, h))
    return np.asarray(diagonal * (mass_per_length * h / diagonal[::DOFS].sum()))


def wave_numbers(n: int) -> list[float]:
    """Return the first n roots of cos B cosh B = -1; root k lies between (k - 1) pi and k pi."""
    ends = [(k * np.pi, (k + 1) * np.pi) for k in range(n)]
    return [
        float(brentq(lambda B: np.cos(B) + 1.0 / np.cosh(B), *end, xtol=_ROOT_TOLERANCE))
        for end in ends
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


def gap_at_rest(gap: InitialGap, x: FloatArray, length: float) -> FloatArray:
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
    """Return the two columns of a table; lines with anything but numbers are skipped."""
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
            rows[k * p + j, DOFS * k : DOFS * (k + 2)] = [float(N(s)) for N in shape_functions(h)]
    rows[np.abs(rows) < _NO_SHAPE] = 0.0
    spacing = np.repeat(lengths / p, p)
    halves = 0.5 * (spacing + np.append(spacing[1:], 0.0))
    return places, rows, halves / lengths.mean()


def _cubic(coefficients: FloatArray, h: float) -> Polynomial:
    """Return the polynomial in s/h with the given coefficients, as a function of s [m]."""
    return Polynomial(coefficients, domain=[0.0, h], window=[0.0, 1.0])


def _products(functions: list[Polynomial], h: float) -> FloatArray:
    """Return the integrals of the products f_i f_j of four functions from 0 to h, shape (4, 4)."""
    return np.array([[(f * g).integ(lbnd=0.0)(h) for g in functions] for f in functions])


def point_masses(case: Case, name: str, x: FloatArray) -> list[tuple[int, FloatArray, FloatArray]]:
    """Return element, mass matrix and lumped mass of each point mass on a lamina.

    Args:
        case: gives the masses.
        name: name of the lamina.
        x: positions of the nodes [m].
    """
    blocks = []
    for point_mass in case.masses:
        if point_mass.lamina == name:
            at = point_mass.position
            place = float(x[-1]) if at is None else x_of(at)
            k = int(np.clip(np.searchsorted(x, place) - 1, 0, x.size - 2))
            h = float(x[k + 1] - x[k])
            s = place - float(x[k])
            N = np.array([float(f(s)) for f in shape_functions(h)])
            ends = point_mass.mass * np.array([1.0 - s / h, 0.0, s / h, 0.0])
            blocks.append((k, point_mass.mass * np.outer(N, N), np.diag(ends)))
    return blocks


RIGID_SHARE = 1e-11
"""Square of a frequency over the largest, below which a motion is rigid but for round-off."""
HELD, MOVED = -1, -2
"""Numbers in place of that of a free dof: the dof is zero, or it moves with the base. Matrices and
rows are summed over the free dofs, the base and a last column for what is held, which is cut off:
so these numbers are indices."""


def _ends(case: Case, x: FloatArray) -> dict[int, str]:
    """Return the supports at the first and the last node."""
    words = {0: case.support.start, x.size - 1: case.support.end}
    nodes = {"start": 0, "end": x.size - 1}
    return words | {nodes[s.side]: s.kind for s in case.support.placed if s.side is not None}


def _yields(case: Case, node: int) -> bool:
    """Return whether a clamp at the first node (0) or at the last one yields."""
    side = "start" if node == 0 else "end"
    has_another = any(s.rotational_stiffness for s in case.support.placed if s.side == side)
    return has_another or case.support.rotational_stiffness is not None


def _elastic_ends(
    stack: Stack, only: Sequence[int] | None = None
) -> tuple[sp.csr_matrix, sp.csr_matrix]:
    """Return stiffness and damping of springs at the ends, of free dofs and base.

    A spring between the base and a lamina has the energy k (w - q)²/2, one against turns k w'²/2.
    Laminae that share their dofs share one spring.

    Args:
        stack: the laminae.
        only: numbers of the laminae whose springs count; None: all.
    """
    case, n = stack.case, stack.n_free
    K, C = np.zeros((2, n + 2, n + 2))  # the last is what is held
    pull = np.array([[1.0, -1.0], [-1.0, 1.0]])
    last = stack.x.size - 1
    counted = range(len(case.lamina)) if only is None else only
    for support in case.support.placed:
        numbers = [i for i in counted if support.lamina in (None, case.lamina[i].name)]
        node = 0 if support.side == "start" else last
        for w, turn in {tuple(stack.dofs[i, node].tolist()) for i in numbers}:
            K[turn, turn] += support.rotational_stiffness
            if support.kind == "spring":
                to_base = np.ix_([w, MOVED], [w, MOVED])
                K[to_base] += (support.stiffness or 0.0) * pull
                C[to_base] += support.damping * pull
    clamps = [node for node, kind in _ends(case, stack.x).items() if kind == "clamped"]
    for node in clamps:
        side = "start" if node == 0 else "end"
        has_another = any(s.rotational_stiffness for s in case.support.placed if s.side == side)
        if case.support.rotational_stiffness is not None and not has_another:
            for turn in np.unique(stack.dofs[counted, node, 1]).tolist():
                K[turn, turn] += case.support.rotational_stiffness
    return sp.csr_matrix(K[:-1, :-1]), sp.csr_matrix(C[:-1, :-1])


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
        """Number the dofs of a case: of laminae that are apart one after the other."""
        names = [lamina.name for lamina in case.lamina]
        middles = 0.5 * (x[1:] + x[:-1])
        is_bonded = np.full((len(names) - 1, middles.size), case.gap is None)
        for delamination in case.delamination:
            inside = (middles > delamination.start) & (middles < delamination.end)
            is_bonded[names.index(delamination.between[0]), inside] = False
        dofs = np.empty((len(names), x.size, 2), dtype=np.int64)
        kinds = _ends(case, x)
        places = list(np.ndindex(len(names), x.size))
        n = 0
        if not case.is_apart:
            places.sort(key=lambda place: place[1])
        for i, node in places:
            if i > 0 and is_bonded[i - 1, max(node - 1, 0) : node + 1].any():
                dofs[i, node] = dofs[i - 1, node]
                continue
            kind = kinds.get(node, "free")
            is_free = kind in ("free", "spring")
            dofs[i, node, 0] = n if is_free else MOVED
            n += is_free
            turns = kind != "clamped" or _yields(case, node)
            dofs[i, node, 1] = n if turns else HELD
            n += turns
        return cls(case, x, is_bonded, dofs, n)

    @property
    def is_varying(self) -> bool:
        """Whether a property of a lamina is a table."""
        keys = ("density", "width", "thickness", "young_modulus")
        return any(
            isinstance(getattr(lamina, k), Profile) for lamina in self.case.lamina for k in keys
        )

    @property
    def sections(self) -> FloatArray:
        """Rows ρA [kg/m], EI [N m2], EA [N], z of the middle plane [m] of the laminae."""
        rows = []
        bottom = 0.0
        if self.is_varying:
            raise CaseError("reference: expected uniform laminae in a bonded stack, given tables")
        for lamina in self.case.lamina:
            rhoA, EI = section(lamina)
            h = _constant(lamina, "thickness")
            EA = _constant(lamina, "young_modulus") * _constant(lamina, "width") * h
            rows.append((rhoA, EI, EA, bottom + h / 2.0))
            bottom += h
        return np.array(rows).T

    def summed(self, blocks: list[tuple[int, int, FloatArray]]) -> sp.csr_matrix:
        """Sum element matrices, each with its lamina and element, over free dofs and base."""
        total = sp.lil_matrix((self.n_free + 2,) * 2)
        for i, k, block in blocks:
            dofs = self.dofs[i, k : k + 2].ravel()
            total[np.ix_(dofs, dofs)] += block
        return total[:-1, :-1].tocsr()


def assemble(case: Case, x: npt.ArrayLike, observed: int = -1) -> Operators:
    """Assemble laminae that are apart, lamina by lamina, or a bonded stack, node by node.

    Args:
        case: the case; its mesh is not used.
        x: positions of the nodes from 0 to the length, one at each edge of a delamination [m].
        observed: node whose displacements are the probes, one of each lamina.

    Returns:
        The operators; a gap opens as the upper lamina rises from the lower one.

    Raises:
        CaseError: contact points lie inside the elements of a bonded stack.
    """
    if not case.has_one_length:
        raise CaseError("reference: expected laminae of one length, given several")
    p = case.contact.points_per_element
    if p != 1 and case.gap is None:
        raise CaseError("reference: expected contact.points_per_element = 1 for a bonded stack")
    ends = [kind in ("clamped", "pinned") for kind in _ends(case, np.zeros(2)).values()]
    if case.gap is not None and ends != [True, False]:
        raise CaseError("reference: expected beside [gap] a start that is held, and no such end")
    if case.support.inside:
        raise CaseError("reference: expected supports at the ends alone")
    stack = Stack.of(case, np.asarray(x, dtype=np.float64))
    laminae = range(len(case.lamina))
    places = [(i, k, h) for i in laminae for k, h in enumerate(np.diff(stack.x).tolist())]
    if stack.is_varying:
        if stack.is_bonded.any():
            raise CaseError(
                "reference: expected uniform laminae in a bonded stack, given tables over x"
            )
        blocks = [varying_element(case.lamina[i], float(stack.x[k]), h) for i, k, h in places]
        masses = [(i, k, mass) for (i, k, _), (mass, _) in zip(places, blocks, strict=True)]
        bending = [(i, k, block) for (i, k, _), (_, block) in zip(places, blocks, strict=True)]
        lumps = [
            (i, k, np.diag(varying_lumped_mass(case.lamina[i], float(stack.x[k]), h)))
            for i, k, h in places
        ]
    else:
        rhoA, EI = stack.sections[:2]
        lumps = [(i, k, np.diag(lumped_mass(rhoA[i], h))) for i, k, h in places]
        masses = [(i, k, element_mass(rhoA[i], h)) for i, k, h in places]
        bending = [(i, k, element_stiffness(EI[i], h)) for i, k, h in places]
    for i, lamina in enumerate(case.lamina):
        for k, consistent, diagonal in point_masses(case, lamina.name, stack.x):
            masses.append((i, k, consistent))
            lumps.append((i, k, diagonal))
    bending += axial_blocks(stack)
    inertia = masses if case.time.mass == "consistent" else lumps
    M = stack.summed(inertia)
    K = stack.summed(bending)
    if stack.is_bonded.any():
        K = sp.csr_matrix(K + axial_stiffness(stack))
    elastic, dampers = _elastic_ends(stack)
    if elastic.nnz:
        K = sp.csr_matrix(K + elastic)
    H, gap0, weights = _pairs(stack)
    if case.is_apart:
        damping_pairs = [
            _of_lamina(case, stack, i, (inertia, bending)) for i in range(len(case.lamina))
        ]
        C = stack.summed(
            [(i, k, damping_pairs[i][0] * block) for i, k, block in inertia]
            + [(i, k, damping_pairs[i][1] * block) for i, k, block in bending]
        )
        for i, (_, beta) in enumerate(damping_pairs):
            if elastic.nnz:
                C = sp.csr_matrix(C + beta * _elastic_ends(stack, [i])[0])
    else:
        alpha, beta = _rayleigh(stack, M, K, H)
        C = sp.csr_matrix(alpha * M + beta * K)
    if dampers.nnz:
        C = sp.csr_matrix(C + dampers)
    n = stack.n_free
    load = load_vector(stack) if case.is_loaded else None
    if case.gravity is not None and case.gravity.gaps == "in place":
        gap0 = gap0 - H @ splu(sp.csc_matrix(K[:n, :n])).solve(load)
    m, c, k = (matrix[:n, n].toarray().ravel() for matrix in (M, C, K))
    m_aa, c_aa, k_aa = (float(matrix[n, n]) for matrix in (M, C, K))
    eye = sp.identity(n, format="csr")
    return Operators(
        mass=M[:n, :n],
        damping=C[:n, :n],
        stiffness=K[:n, :n],
        lumped_mass=stack.summed(lumps).diagonal()[:n],
        base=BaseCoupling(m, c, k, corner=(m_aa, c_aa, k_aa)),
        gap_matrix=H,
        gap0=gap0,
        pair_weights=weights,
        probes=sp.csr_matrix(eye[stack.dofs[:, observed, 0]]),
        load=load if load is not None and load.any() else None,
    )


def _of_lamina(
    case: Case, stack: Stack, i: int, blocks: Sequence[Sequence[tuple[int, int, FloatArray]]]
) -> tuple[float, float]:
    """Return alpha [1/s] and beta [s] of a lamina; the modes are those with its point masses.

    Args:
        case: the case.
        stack: its laminae.
        i: number of the lamina.
        blocks: lamina, element and matrix of the inertia and of the bending of all laminae.
    """
    lamina = case.lamina[i]
    has_masses = any(mass.lamina == lamina.name for mass in case.masses)
    is_plain = not (has_masses or stack.is_varying or case.has_axial_forces)
    if is_plain and case.support.is_cantilever:
        return rayleigh(case, lamina)
    dofs = np.unique(stack.dofs[i])
    dofs = dofs[dofs >= 0]
    M, K = (
        stack.summed([block for block in each if block[0] == i]).toarray()[np.ix_(dofs, dofs)]
        for each in blocks
    )
    K = K + _elastic_ends(stack)[0].toarray()[np.ix_(dofs, dofs)]
    squares = eigh(K, M, eigvals_only=True)
    elastic = squares[squares > RIGID_SHARE * squares[-1]]
    return coefficients(case, lamina.damping_ratio, np.sqrt(elastic[:2]))


def lowest_frequencies(operators: Operators, n: int) -> FloatArray:
    """Return the lowest natural frequencies of a stack, increasing, shape (n,) [Hz]."""
    K = operators.stiffness.toarray()
    M = operators.mass.toarray()
    squares = eigh(K, M, eigvals_only=True, subset_by_index=(0, n - 1))
    return np.asarray(np.sqrt(np.maximum(squares, 0.0)) / (2.0 * np.pi))


def axial_stiffness(stack: Stack) -> FloatArray:
    """Return what the axial displacements add to the stiffness of free dofs and base."""
    G_u, G_d = _constraints(stack)
    K_u = _stretching(stack)
    n = K_u.shape[0]
    m = G_u.shape[0]
    scale = np.abs(K_u).max()
    saddle = np.block([[K_u / scale, G_u.T], [G_u, np.zeros((m, m))]])
    right = np.vstack([np.zeros((n, G_d.shape[1])), -G_d])
    U = np.linalg.lstsq(saddle, right, rcond=1e-14)[0][:n]
    return np.asarray(U.T @ K_u @ U)


def _stretching(stack: Stack) -> FloatArray:
    """Return the stiffness of all quadratic axial displacements, lamina by lamina."""
    n_places = 2 * stack.x.size - 1
    EA = stack.sections[2]
    total = np.zeros((n_places * len(EA),) * 2)
    for k, h in enumerate(np.diff(stack.x).tolist()):
        bases = [
            Polynomial.fit([0.0, 0.5 * h, h], values, 2).deriv()  # type: ignore[no-untyped-call]
            for values in np.eye(3)
        ]
        block = np.array([[(f * g).integ(lbnd=0.0)(h) for g in bases] for f in bases])
        for i, stiffness in enumerate(EA):
            at = n_places * i + 2 * k + np.arange(3)
            total[np.ix_(at, at)] += stiffness * block
    return total


def _constraints(stack: Stack) -> tuple[FloatArray, FloatArray]:
    """Return G_u and G_d of G_u u + G_d d = 0: plane sections and axial supports."""
    n_laminae = len(stack.case.lamina)
    n_places = 2 * stack.x.size - 1
    EA, z = stack.sections[2:]
    rows: dict[tuple[int, int], tuple[FloatArray, FloatArray]] = {}

    def empty() -> tuple[FloatArray, FloatArray]:
        return np.zeros(n_places * n_laminae), np.zeros(stack.n_free + 2)

    for k, h in enumerate(np.diff(stack.x).tolist()):
        N = shape_functions(h)
        for j in np.flatnonzero(stack.is_bonded[:, k]):
            for point, s in enumerate((0.0, 0.5 * h, h)):
                u, d = empty()
                u[n_places * j + 2 * k + point] = -1.0
                u[n_places * (j + 1) + 2 * k + point] = 1.0
                for dof, f in zip(stack.dofs[j, k : k + 2].ravel().tolist(), N, strict=True):
                    d[dof] += (z[j + 1] - z[j]) * float(f.deriv()(s))  # type: ignore[no-untyped-call]
                rows[int(j), 2 * k + point] = u, d
    constraints = list(rows.values())
    for node, kind in _ends(stack.case, stack.x).items():
        if kind in ("free", "spring"):
            continue
        element = 0 if node == 0 else node - 1
        cuts = [0, *(np.flatnonzero(~stack.is_bonded[:, element]) + 1).tolist(), n_laminae]
        for first, last in pairwise(cuts):
            u, d = empty()  # the neutral axis of each group of bonded laminae is held
            for i in range(first, last):
                u[n_places * i + 2 * node] = EA[i] / EA[first:last].sum()
            constraints.append((u, d))
    return np.array([u for u, _ in constraints]), np.array([d[:-1] for _, d in constraints])


def _pairs(stack: Stack) -> tuple[sp.csr_matrix, FloatArray, FloatArray | None]:
    """Return H, the gaps at rest, and the shares of the pairs in a spring; None: each has one.

    The pairs of a bonded stack are the nodes at which neighbours are apart.
    """
    case, n_interfaces = stack.case, len(stack.case.lamina) - 1
    if case.gap is not None:
        places, shapes, shares = _contact_points(stack.x, case.contact.points_per_element)
        on = []
        for dofs in stack.dofs:
            row = np.zeros((len(shapes), stack.n_free + 2))
            row[:, dofs.ravel()] = shapes  # held dofs of one kind overwrite each other: cut off
            on.append(row[:, :-2])
        H = sp.csr_matrix(np.vstack([upper - lower for lower, upper in pairwise(on)]))
        gap0 = np.tile(gap_at_rest(case.gap, places, case.lamina[0].length), n_interfaces)
        is_plain = case.contact.points_per_element == 1
        return H, gap0, None if is_plain else np.tile(shares, n_interfaces)
    rows = []
    gaps = []
    for j in range(n_interfaces):
        for node, place in enumerate(stack.x.tolist()):
            lower, upper = stack.dofs[j : j + 2, node, 0].tolist()
            if lower != upper:
                row = np.zeros(stack.n_free)
                row[lower], row[upper] = -1.0, 1.0
                rows.append(row)
                gaps.append(_opening(case, j, place))
    return sp.csr_matrix(np.array(rows).reshape(-1, stack.n_free)), np.array(gaps), None


def _opening(case: Case, interface: int, x: float) -> float:
    """Return the gap at rest of an interface at a place within a delamination [m]."""
    between = (case.lamina[interface].name, case.lamina[interface + 1].name)
    (delamination,) = [
        d for d in case.delamination if d.between == between and d.start <= x <= d.end
    ]
    if delamination.file is not None:
        return float(PchipInterpolator(*tabulated(delamination.file))(x))
    s = (x - delamination.start) / (delamination.end - delamination.start)
    if delamination.shape == "power":
        if _ends(case, np.zeros(2))[0] in ("free", "spring") and delamination.start == 0.0:
            s = 1.0 - s
        return float(delamination.opening * s ** (delamination.exponent or 2.0))
    return float(delamination.opening * np.cos(np.pi * (s - 0.5)))


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
    rigid = case.n_rigid
    squares = eigh(small[1], small[0], eigvals_only=True)[rigid : rigid + 2]
    return coefficients(case, D, np.sqrt(squares))


def accelerations(case: Case) -> tuple[float, float]:
    """Return the acceleration of free fall along the axis and along deflections [m/s2]."""
    if case.gravity is None:
        return 0.0, 0.0
    slope = math.radians(case.gravity.inclination)
    roll = math.radians(case.gravity.roll)
    g = case.gravity.acceleration
    return -g * math.sin(slope), -g * math.cos(slope) * math.cos(roll)


def axial_blocks(stack: Stack) -> list[tuple[int, int, FloatArray]]:
    """Return lamina, element and geometric stiffness of what pulls or presses along the axis.

    Raises:
        CaseError: the weight along the axis acts on a bonded stack.
    """
    case = stack.case
    if not case.has_axial_forces:
        return []
    along, _ = accelerations(case)
    if abs(along) > 1e-12 and stack.is_bonded.any():
        raise CaseError(
            "gravity.inclination: the reference has weight along the axis of laminae that are "
            "apart; given a bonded stack"
        )
    EA = stack.sections[2]
    blocks = []
    for i, lamina in enumerate(case.lamina):
        tension = 0.0
        for load in case.load:
            if load.axial is not None and load.lamina is None:
                tension += load.axial * float(EA[i] / EA.sum())
            elif load.axial is not None and load.lamina == lamina.name:
                tension += load.axial
        pulls = _behind(stack, i, along)
        for k, h in enumerate(np.diff(stack.x).tolist()):
            slopes = [f.deriv() for f in _shapes(h)]  # type: ignore[no-untyped-call]
            N = pulls[k] + tension
            block = [[_integral(N * a * b, 0.0, h) for b in slopes] for a in slopes]
            blocks.append((i, k, np.array(block)))
    return blocks


def load_vector(stack: Stack) -> FloatArray:
    """Return the load of weight and of all [[load]] on the free dofs, shape (n,) [N, N m].

    Raises:
        CaseError: laminae with tables over x have weight.
    """
    case = stack.case
    _, across = accelerations(case)
    if case.gravity is not None and stack.is_varying:
        raise CaseError("reference: expected uniform laminae with gravity, given tables over x")
    names = [lamina.name for lamina in case.lamina]
    result = np.zeros(stack.n_free + 2)

    def add(i: int, reach: tuple[float, float], per_length: float) -> None:
        for k, h in enumerate(np.diff(stack.x).tolist()):
            low, high = (min(max(end - float(stack.x[k]), 0.0), h) for end in reach)
            values = [per_length * _integral(f, low, high) for f in _shapes(h)]
            np.add.at(result, stack.dofs[i, k : k + 2].ravel(), values)

    def push(i: int, place: float, force: float) -> None:
        k = int(np.clip(np.searchsorted(stack.x, place) - 1, 0, stack.x.size - 2))
        h = float(stack.x[k + 1] - stack.x[k])
        values = [force * float(f(place - stack.x[k])) for f in _shapes(h)]
        np.add.at(result, stack.dofs[i, k : k + 2].ravel(), values)

    end = float(stack.x[-1])
    for i, lamina in enumerate(case.lamina):
        if across:
            add(i, (0.0, end), across * section(lamina)[0])
        for mass in case.masses:
            if mass.lamina == lamina.name:
                push(i, end if mass.position is None else x_of(mass.position), across * mass.mass)
    for load in case.load:
        sides = [(load.lamina, 1.0)]
        if load.between is not None:
            sides = [(load.between[0], 1.0), (load.between[1], -1.0)]
        for name, sign in sides if load.axial is None else []:
            i = names.index(name or "")
            if load.force is not None:
                push(i, case.position_of(load), sign * load.force)
            else:
                reach = load.reach(case.length, case.delamination)
                add(i, reach, sign * (load.per_length or 0.0))
    return result[: stack.n_free]


def _behind(stack: Stack, i: int, along: float) -> list[Polynomial]:
    """Return the axial force of a lamina by weight in each element, over s from its start [N].

    The force of a point mass inside an element is linear there, as from one end to the other.
    """
    case = stack.case
    x = stack.x
    end = float(x[-1])
    per_length = section(case.lamina[i])[0]
    masses = [
        (mass.mass, end if mass.position is None else x_of(mass.position))
        for mass in case.masses
        if mass.lamina == case.lamina[i].name
    ]
    at_starts = [per_length * (end - a) + sum(m for m, p in masses if p > a) for a in x[:-1]]
    at_ends = [per_length * (end - b) + sum(m for m, p in masses if p >= b) for b in x[1:]]
    is_held = [bool(stack.dofs[i, node, 0] < 0) for node in (0, -1)]
    shift = 0.0
    if is_held == [True, True]:
        pairs = zip(at_starts, at_ends, np.diff(x).tolist(), strict=True)
        shift = sum(0.5 * (a + b) * h for a, b, h in pairs) / end
    elif is_held == [False, True]:
        shift = per_length * end + sum(m for m, _ in masses)
    return [
        along * Polynomial([a - shift, (b - a) / h])
        for a, b, h in zip(at_starts, at_ends, np.diff(x).tolist(), strict=True)
    ]


def _shapes(h: float) -> list[Polynomial]:
    """Return the shape functions of an element as polynomials of the place in it."""
    return [f.convert() for f in shape_functions(h)]  # type: ignore[no-untyped-call]


def _integral(f: Polynomial, low: float, high: float) -> float:
    """Return the integral of a polynomial between two places."""
    F = f.integ()  # type: ignore[no-untyped-call]
    return float(F(high) - F(low))
