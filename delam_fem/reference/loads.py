"""Weight, constant loads and the state of rest of the reference, derived from polynomials alone.

Loads are integrals of shape functions, the geometric stiffness ∫ N w' v' dx those of their slopes.
The axial force N of a lamina that is apart is what hangs behind each place; of one that is held at
both ends, its mean is 0. The state of rest with springs follows by asking which of them are closed
until the answer stays.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse as sp
from numpy.polynomial import Polynomial
from scipy.sparse.linalg import splu

from delam_fem.case.definition import Case
from delam_fem.case.sections import x_of
from delam_fem.model.operators import Operators
from delam_fem.numerics.types import BoolArray, FloatArray
from delam_fem.system.errors import CaseError

if TYPE_CHECKING:
    from delam_fem.reference.matrices import Stack

MOST_CHANGES = 200
"""Sets of closed springs that are tried."""


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
    total = sum(lamina.axial_rigidity for lamina in case.lamina)
    blocks = []
    for i, lamina in enumerate(case.lamina):
        tension = 0.0
        for load in case.load:
            if load.axial is not None and load.lamina is None:
                tension += load.axial * lamina.axial_rigidity / total
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
            add(i, (0.0, end), across * lamina.uniform.mass_per_length)
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


def rest(operators: Operators, case: Case) -> tuple[FloatArray, BoolArray]:
    """Return displacements at rest, shape (n,) [m], and the pairs whose springs carry a load.

    Raises:
        CaseError: the springs that are closed do not stay the same.
    """
    o = operators
    load = np.zeros(o.n_dofs) if o.load is None else o.load
    closed = np.zeros(o.n_pairs, dtype=bool)
    weights = np.ones(o.n_pairs) if o.pair_weights is None else o.pair_weights
    for _ in range(MOST_CHANGES):
        H = o.gap_matrix[closed]
        springs = H.T @ sp.diags(case.contact.penalty_stiffness * weights[closed])
        K = sp.csc_matrix(o.stiffness + springs @ H)
        u = splu(K).solve(load - springs @ o.gap0[closed])
        overlaps = o.gap_matrix @ u + o.gap0 < 0.0
        if case.contact.law == "none" or np.array_equal(overlaps, closed):
            return u, closed
        closed = overlaps
    raise CaseError("reference: found no state of rest")


def _behind(stack: Stack, i: int, along: float) -> list[Polynomial]:
    """Return the axial force of a lamina by weight in each element, over s from its start [N].

    The force of a point mass inside an element is linear there, as from one end to the other.
    """
    case = stack.case
    x = stack.x
    end = float(x[-1])
    per_length = case.lamina[i].uniform.mass_per_length
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
    from delam_fem.reference.matrices import shape_functions

    return [f.convert() for f in shape_functions(h)]  # type: ignore[no-untyped-call]


def _integral(f: Polynomial, low: float, high: float) -> float:
    """Return the integral of a polynomial between two places."""
    F = f.integ()  # type: ignore[no-untyped-call]
    return float(F(high) - F(low))
