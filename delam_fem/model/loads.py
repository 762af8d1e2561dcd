"""Add what acts on a structure all the time: weight, forces, pressure; find its state of rest.

Constant loads are one vector f of the operators, from the virtual work of all of them,

    f·v = Σ ∫ ρA a v dx + Σ m_j a v(x_j) + Σ F_j v(x_j) + Σ ∫ p v dx                         (L1)

where a is the acceleration of free fall along deflections, and a pair of neighbours that is pressed
together gets F and -F. An axial force N, tension being positive, adds the geometric stiffness

    k_N(w, v) = ∫ N w' v' dx                                                                   (L2)

to K. Of weight along the axis, N follows from the masses behind each place; see `axial_forces`.

At rest contact forces λ part closed pairs, and

    K u = f + Hᵀ λ,   0 <= λ ⊥ H u + g0 + λ / k >= 0                                          (L3)

with the springs k of the law; k is infinite for rigid contact. u follows from
(H K⁻¹ Hᵀ + 1/k) λ + H K⁻¹ f + g0 >= 0. Where something floats, K is singular; then
(K + s M) uₙ₊₁ = f + s M uₙ + Hᵀ λ is solved until u stays (proximal points): a body that lies on
another stays at once, and one that falls never does.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Any, TypeVar

import numpy as np
import scipy.sparse as sp
from scipy.special import roots_legendre

from delam_fem.case.definition import Case
from delam_fem.case.sections import Lamina, Load
from delam_fem.contact import complementarity
from delam_fem.model.factors import Factor, factored, largest_above_zero
from delam_fem.model.layout import (
    Layout,
    Part,
    Structure,
    interpolation_rows,
    places_of,
    point_load,
)
from delam_fem.model.operators import (
    Equilibrium,
    Recorded,
    diagonal,
    n_rows,
    of_ranks,
    restricted,
    summed,
    times,
)
from delam_fem.model.places import row_at
from delam_fem.numerics.types import BoolArray, FloatArray, IntArray
from delam_fem.system.errors import CaseError

GAUSS: tuple[FloatArray, FloatArray] = roots_legendre(4)
"""Points and weights that integrate cubic functions times a cubic load exactly."""
MOST_ITERATIONS = 200
"""Proximal points after which something is falling."""
STAYS = 1e-12
"""Change of u, relative to a step of a falling body, that is round-off."""
FLOATS = 'gravity.gaps: expected "unloaded" where something floats, given "in place"'
DRIFTS = 1e-9
"""The same of a solid, whose round-off moves it slowly where nothing holds it."""
SOFT = 1e-6
"""Shift of a floating structure, in parts of the mean of its diagonal K over that of M."""
_Problem = TypeVar("_Problem", bound=Recorded[Any])
LIES = 1e-9
"""Gap of a free impactor, relative to the length, up to which it lies on its lamina."""


def loaded(structure: Structure, case: Case) -> Structure:
    """Return a structure with the constant loads of its case, its state of rest, and its start.

    The call is collective where ranks share the dofs.

    Args:
        structure: the structure with all of its pairs and dofs.
        case: the case.

    Raises:
        CaseError: a load has no effect, or there is no state of rest from which to begin.
    """
    o = structure.operators
    if not case.is_loaded:
        return structure
    if o.load is None:
        o = with_load(o, structure.layout, case)
    if case.gravity is not None and o.load is not None and structure.layout.n_impactors:
        o = replace(o, load=o.load + _of_impactors(case, o))
    if o.load is None or not any(of_ranks(o.mass, o.load.any())):
        return replace(structure, operators=replace(o, load=None))
    is_falling = falling_dofs(structure, case)
    if case.gravity is not None and case.gravity.gaps == "in place":
        if case.n_rigid:
            raise CaseError(FLOATS)
        closing = o.total(o.gap_matrix @ _without_contact(o, is_falling))
        o = replace(o, gap0=o.gap0 - closing)
    springs = springs_of(o, case)
    equilibrium = state_of_rest(
        o,
        springs=springs,
        is_falling=is_falling,
        is_open=case.contact.law == "none",
        shift=slowest(case) ** 2 if case.n_rigid and case.model.is_continuum else 0.0,
    )
    if equilibrium is None and case.begins_at_rest:
        raise CaseError(
            "gravity: there is no state of rest, as something that nothing holds falls or is "
            'pushed away for ever; give it a stop or a support, or time.begin = "unloaded"'
        )
    is_rigid = np.full(o.n_pairs, True) if springs is None else np.isinf(springs)
    if equilibrium is not None and equilibrium.force[is_rigid].any():
        require_lasting(case)
    o = replace(o, equilibrium=equilibrium)
    if equilibrium is not None and case.begins_at_rest:
        start = np.zeros((2, o.n_own)) if o.start is None else o.start
        o = replace(o, start=start + np.stack([equilibrium.displacement, np.zeros(o.n_own)]))
    return replace(structure, operators=o)


def springs_of(o: Recorded[Any], case: Case) -> FloatArray | None:
    """Return the stiffness of the contact of each pair, (n_pairs,) [N/m]; None: all are rigid."""
    of_law = case.contact.law in ("penalty", "newton-penalty") and case.spring[0] > 0.0
    has_spring = np.full(o.n_pairs, of_law)
    if o.pair_numbers is not None:
        has_spring |= o.pair_numbers.is_elastic
    if not has_spring.any():
        return None
    weights = np.ones(o.n_pairs) if o.pair_weights is None else o.pair_weights
    return np.where(has_spring, case.spring[0] * weights, np.inf)


def require_lasting(case: Case) -> None:
    """Refuse a law whose impacts between steps cannot hold what is pressed together.

    Between two impacts it falls by Δt² times half its acceleration, and nothing lifts it again.

    Raises:
        CaseError: the law has no springs, and the scheme no impulses within its steps.
    """
    is_carried = case.time.integration.has_impulses_within or case.is_massless
    if case.contact.law == "newton" and not is_carried:
        raise CaseError(
            f'contact.law: expected "newton@moreau-jean", or a law with springs, where weight or '
            f'loads press pairs together at rest, given "newton@{case.time.scheme}": with impacts '
            "between steps alone they would sink into one another"
        )


def with_load(
    o: _Problem, layout: Layout, case: Case, weight: FloatArray | None = None
) -> _Problem:
    """Return operators with the loads of weight and of all [[load]] on their dofs (L1).

    The weights of impactors are left out. The call is collective where ranks share the dofs.

    Args:
        o: the operators.
        layout: what their dofs mean.
        case: the case.
        weight: load of the weight, shape (n_own,) [N]; None: that of beams, bars and points.

    Raises:
        CaseError: a load is where its lamina is held, and has no effect.
    """
    if weight is None:
        weight = _weight(o, layout, case)
    f = np.array(weight)
    for number, load in enumerate(case.load, start=1):
        if load.axial is not None:
            continue
        of_load = _of_load(o, layout, case, load)
        size = load.force if load.per_length is None else load.per_length
        if size and not any(of_ranks(o.mass, of_load.any())):
            raise CaseError(
                f"load.{number}: expected a place that can move, given one where "
                f"{load.lamina or ' and '.join(load.between or ())} is held, or two bonded laminae"
            )
        f += of_load
    return replace(o, load=f)


def _acceleration(case: Case) -> float:
    """Return the acceleration of free fall along deflections [m/s2]."""
    if case.gravity is None:
        return 0.0
    is_along = case.lamina[0].motion == "axial"
    return case.gravity.along if is_along else case.gravity.across


def _weight(o: Recorded[Any], layout: Layout, case: Case) -> FloatArray:
    """Return the weights of laminae, points and point masses, shape (n_own,)."""
    a = _acceleration(case)
    n = o.n_own
    f = np.zeros(n)
    if not a:
        return f
    for lamina, part in zip(case.lamina, layout.parts, strict=True):
        if lamina.mass is not None:
            f += lamina.mass * a * point_load(layout, part, part.x[-1], n)
            continue
        for cell, q in enumerate(part.mass_per_length):
            f += q * a * _over(layout, part, (part.x[cell], part.x[cell + 1]), n)
    for mass in case.masses:
        part = layout.parts[layout.names.index(mass.lamina)]
        f += mass.mass * a * point_load(layout, part, case.position_of(mass), n)
    return f


def _of_impactors(case: Case, o: Recorded[Any]) -> FloatArray:
    """Return the weights of impactors, the last of all dofs, shape (n_own,)."""
    f = np.zeros(o.n_own)
    for dof, impactor in zip(o.last_dofs(len(case.impactor)), case.impactor, strict=False):
        f[dof] = _acceleration(case) * impactor.mass
    return f


def _of_load(o: Recorded[Any], layout: Layout, case: Case, load: Load) -> FloatArray:
    """Return a force, or a force per length, on a lamina or on two neighbours, shape (n_own,)."""
    n = o.n_own
    f = np.zeros(n)
    for side, sign in load.sides:
        length = case.length_of(side.lamina)
        if load.force is not None:
            row = layout.of_dofs(row_at(layout, side, n, length))
            f += sign * load.force * row.toarray()[0, :n]
        elif load.per_length is not None:
            part = layout.parts[layout.names.index(side.lamina or "")]
            reach = load.reach(length, case.delamination)
            f += sign * load.per_length * _over(layout, part, reach, n)
    return f


def _over(layout: Layout, part: Part, reach: tuple[float, float], n: int) -> FloatArray:
    """Return the loads of a unit force per length over a stretch of a part, shape (n,)."""
    inside = part.x[(part.x > reach[0]) & (part.x < reach[1])]
    edges = np.concatenate([[reach[0]], inside, [reach[1]]])
    half = 0.5 * np.diff(edges)
    x = (0.5 * (edges[1:] + edges[:-1]))[:, None] + half[:, None] * GAUSS[0]
    weights = half[:, None] * GAUSS[1]
    rows = interpolation_rows(part, places_of(part, x.ravel()), layout.n_numbered(n))
    return np.asarray(layout.of_dofs(rows).T @ weights.ravel())


def falling_dofs(structure: Structure, case: Case) -> BoolArray:
    """Return which own dofs are free impactors that do not lie on their laminae, shape (n_own,).

    They begin as their keys say and are no part of the state of rest.
    """
    o = structure.operators
    result = np.zeros(o.n_own, dtype=np.bool_)
    for dof, impactor in zip(o.last_dofs(len(case.impactor)), case.impactor, strict=False):
        is_away = impactor.gap > LIES * case.length or impactor.velocity > 0.0
        result[dof] = not impactor.spring and is_away
    return result


def slowest(case: Case) -> float:
    """Return the lowest angular frequency of all laminae as cantilevers [rad/s]."""
    return min(float(lamina.uniform.angular_frequencies(1)[0]) for lamina in case.lamina)


def _without_contact(o: Recorded[Any], is_falling: BoolArray) -> FloatArray:
    """Return the displacements under the constant loads without contact, shape (n_own,)."""
    assert o.load is not None
    dofs = np.flatnonzero(~is_falling)
    u = np.zeros(o.n_own)
    try:
        factor = factored(restricted(o.stiffness, dofs))
    except ValueError:
        raise CaseError(FLOATS) from None
    u[dofs] = factor.solve(o.load[dofs])
    return u


def state_of_rest(
    o: Recorded[Any],
    *,
    springs: FloatArray | None = None,
    is_falling: BoolArray | None = None,
    is_open: bool = False,
    shift: float = 0.0,
) -> Equilibrium | None:
    """Return the state of rest under the constant loads of operators (L3), the base at 0.

    The call is collective where ranks share the dofs.

    Args:
        o: the operators, with a load.
        springs: stiffness of the contact of each pair, shape (n_pairs,) [N/m]; None: rigid.
        is_falling: own dofs that are no part of it and stay at 0, shape (n_own,); None: none are.
        is_open: whether laminae pass through one another.
        shift: about the square of the lowest elastic angular frequency [1/s2], if K is known to be
            singular: the factors of a solid need not show it, and the mean of its diagonal is that
            of far faster motions. 0: K is held, or its factors show that it is not.

    Returns:
        The state of rest; None: there is none.
    """
    assert o.load is not None
    is_away = np.zeros(o.n_own, dtype=np.bool_) if is_falling is None else is_falling
    dofs = np.flatnonzero(~is_away)
    K, M = o.stiffness, o.mass
    if sp.issparse(K):
        K, M = (sp.csr_matrix(A)[dofs][:, dofs] for A in (K, M))
    elif any(of_ranks(K, is_away.any())):
        K, M = (restricted(A, dofs) for A in (K, M))
    f = o.load[dofs]
    of_away = o.total(abs(o.gap_matrix) @ is_away.astype(float))
    pairs = np.flatnonzero(of_away == 0.0)[: 0 if is_open else None]
    H = o.gap_matrix[pairs][:, dofs]
    soft = np.zeros(pairs.size) if springs is None else 1.0 / springs[pairs]
    stays = DRIFTS if shift else STAYS
    factor, shift = (factored(K, M, shift), shift) if shift else _factor(K, M)
    contact = _Contact(factor, sp.csr_matrix(H), o.gap0[pairs], soft, o.total)
    u = np.zeros(dofs.size)
    size = _largest(K, factor.solve(f))  # a step of what falls
    for _ in range(MOST_ITERATIONS):
        before = u
        right = f + shift * times(M, u)
        u, force = contact.pushed_apart(factor.solve(right))
        if not shift or _largest(K, u - before) <= stays * size:
            displacement = np.zeros(o.n_own)
            displacement[dofs] = u
            all_forces = np.zeros(o.n_pairs)
            all_forces[pairs] = force
            return Equilibrium(displacement, all_forces)
    return None


def _largest(like: Any, vector: FloatArray) -> float:
    """Return the largest size in a vector of the dofs of a matrix (collective)."""
    return max(of_ranks(like, float(np.abs(vector).max(initial=0.0))))


class _Contact:
    """Contact forces λ of L3 on pairs that would overlap, with K⁻¹ Hᵀ of those that ever did."""

    def __init__(
        self,
        factor: Factor,
        H: sp.csr_matrix,
        gap0: FloatArray,
        softness: FloatArray,
        total: Callable[[FloatArray], FloatArray],
    ) -> None:
        """Store factors of K, the gap operator, gaps at rest [m] and 1/k of each pair [m/N].

        `total` sums what the ranks contribute, whose own columns of the gap operator are given.
        """
        self._factor = factor
        self._H = H
        self._gap0 = gap0
        self._softness = softness
        self._total = total
        self._pairs: IntArray = np.zeros(0, dtype=np.int64)
        self._responses = np.zeros((H.shape[1], 0))

    def pushed_apart(self, free: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return u and λ, shape (n_pairs,), from the displacements without contact, (n_own,).

        The call is collective.
        """
        gap = self._total(self._H @ free) + self._gap0
        u = free
        force = np.zeros(gap.size)
        closed = np.flatnonzero(gap < 0.0)
        while closed.size:
            self._respond(np.setdiff1d(closed, self._pairs))
            H = self._H[self._pairs]
            W = self._total(H @ self._responses) + np.diag(self._softness[self._pairs])
            force[self._pairs] = complementarity.solve(0.5 * (W + W.T), gap[self._pairs])
            u = free + self._responses @ force[self._pairs]
            moved = self._total(self._H @ u) + self._gap0
            closed = np.setdiff1d(np.flatnonzero(moved < 0.0), self._pairs)
        return u, force

    def _respond(self, pairs: IntArray) -> None:
        """Add the responses to unit forces on some pairs."""
        if pairs.size:
            more = self._factor.solve(self._H[pairs].T.toarray())
            self._responses = np.hstack([self._responses, more])
            self._pairs = np.concatenate([self._pairs, pairs])


def _factor(K: Any, M: Any) -> tuple[Factor, float]:
    """Return factors of K, or of K + s M where K is singular, and s [1/s2] (collective)."""
    try:
        if n_rows(K) and min(of_ranks(K, diagonal(K).min(initial=np.inf))) > 0.0:
            return factored(K), 0.0
    except ValueError:
        pass
    stiffness, mass = (summed(A, diagonal(A).sum()) for A in (K, M))
    shift = SOFT * float(stiffness / mass) or 1.0
    return factored(K, M, shift), shift


def buckling_factor(K: Any, geometric: Any) -> float | None:
    """Return the factor on all axial forces at which a structure buckles.

    det(K + μ K_N) = 0, as 1/μ is the largest eigenvalue of -K_N φ = (1/μ) K φ.

    Args:
        K: stiffness without axial forces, of the free dofs; of SciPy, or of PETSc on several ranks
            (collective).
        geometric: K_N of L2, likewise.

    Returns:
        The least μ from 0 to 1e4; None: there is none, or the structure floats.
    """
    is_of_one = sp.issparse(K)
    size = abs(geometric).sum() if is_of_one else geometric.norm()
    if not n_rows(K) or not size:
        return None
    factor: Factor | None
    try:
        factor = factored(K)
    except ValueError:
        return None
    if is_of_one:
        share = largest_above_zero(-geometric, K, factor)
    else:
        factor = None  # SLEPc has its own: both at once would take twice the memory
        opposite = geometric.copy()
        opposite.scale(-1.0)
        share = largest_above_zero(opposite, K, factor)
    return 1.0 / share if share else None


def require_unbuckled(K: Any, geometric: Any, n: int) -> float | None:
    """Return the buckling factor of a structure; refuse one that its axial forces buckle.

    Args:
        K: stiffness, geometric stiffness included; it may have further rows and columns. A matrix
            of SciPy, or of PETSc on several ranks (collective).
        geometric: geometric stiffness, likewise; None: there are no axial forces.
        n: number of free dofs.

    Raises:
        CaseError: the factor is at most 1.
    """
    if geometric is None:
        return None
    if sp.issparse(K):
        geometric = sp.csr_matrix(geometric)[:n, :n]
        K = sp.csr_matrix(K)[:n, :n] - geometric
    else:
        K = K.copy()
        K.axpy(-1.0, geometric)
    factor = buckling_factor(K, geometric)
    if factor is not None and factor <= 1.0:
        raise CaseError(
            f"gravity, load.axial: the structure buckles: it bears {factor:.4g} of its weight and "
            "axial forces; take a stiffer or shorter one, or less compression"
        )
    return factor


def axial_forces(case: Case, x: FloatArray, chains: Sequence[Chain]) -> FloatArray:
    """Return the axial forces of all laminae at both ends of each cell, (n_laminae, n, 2) [N].

    Tension is positive. Within a cell they are linear, of a lamina that is not uniform the nearest
    linear ones; a point mass inside a cell counts from its end on. Neighbours that are bonded share
    the force of their stack by E b h.

    Args:
        case: the case.
        x: positions of the nodes, shape (n + 1,) [m].
        chains: the stretches of bonded laminae, with the joints at their ends.

    Raises:
        CaseError: nothing holds the structure along its axis.
    """
    N = np.zeros((len(case.lamina), x.size - 1, 2)) + tensions(case)[:, None, None]
    if case.gravity is not None and case.gravity.along:
        N += _of_weight(case, x, chains, case.gravity.along)
    return N


def tensions(case: Case) -> FloatArray:
    """Return the tension of each lamina by [[load]] axial, shape (n_laminae,) [N].

    That of the whole structure is shared by E b h; of a lamina that is not uniform, by the one that
    a uniform one of the same stiffness along the axis has.
    """
    N = np.zeros(len(case.lamina))
    EA = np.array([_effective_rigidity(lamina) for lamina in case.lamina])
    names = [lamina.name for lamina in case.lamina]
    for load in case.load:
        if load.axial is not None and load.lamina is None:
            N += load.axial * (EA / EA.sum())
        elif load.axial is not None:
            N[names.index(load.lamina or "")] += load.axial
    return N


def _effective_rigidity(lamina: Lamina) -> float:
    """Return E A of a lamina as a bar: its length over its flexibility [N]."""
    if lamina.is_uniform:
        return lamina.axial_rigidity
    edges = np.array([0.0, *lamina.breaks, lamina.length])
    s, w, inside = _points(edges)
    flexibility = float((w / lamina.axial_rigidity_at(s, inside)).sum())
    return lamina.length / flexibility


def _points(x: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return places, weights [m] and the middles of cells, each of shape (n_cells, 4)."""
    half = 0.5 * np.diff(x)[:, None]
    middles = np.broadcast_to(x[:-1, None] + half, (half.size, GAUSS[0].size))
    return middles + half * GAUSS[0], half * GAUSS[1], middles


Chain = tuple[int, int, tuple[int, ...], int, int]
"""First and last node, the laminae that are bonded there, and the joints at both ends; -1: held."""


def _of_weight(case: Case, x: FloatArray, chains: Sequence[Chain], a: float) -> FloatArray:
    """Return the axial forces by weight along the axis; see `axial_forces`.

    Each chain is a bar between two joints, on which its masses pull with a; the joints' axial
    displacements follow from their equilibrium.
    """
    N = np.zeros((len(case.lamina), x.size - 1, 2))
    count = 1 + max((max(chain[3:]) for chain in chains), default=-1)
    K = np.zeros((count, count))
    f = np.zeros(count)
    bars = []
    for first, last, group, start, end in chains:
        points, weights, middles = _points(x[first : last + 1])
        laminae = [case.lamina[i] for i in group]
        density = np.sum([lamina.mass_per_length_at(points, middles) for lamina in laminae], axis=0)
        EA = np.sum([lamina.axial_rigidity_at(points, middles) for lamina in laminae], axis=0)
        pulls = _pulls(a * density * weights)
        for mass, place in _masses(case, group):
            is_at_end = last == x.size - 1 and place >= x[last]
            if not (x[first] <= place < x[last] or is_at_end):
                continue
            pulls[x[first:last] >= place, 0] += a * mass
            pulls[x[first + 1 : last + 1] > place, 1] += a * mass
            if is_at_end and end >= 0:
                f[end] += a * mass
        flexible = weights / EA
        k = 1.0 / float(flexible.sum())
        # N = N_start - pulls; its mean over k is the elongation
        mean = k * float((flexible * (pulls @ LINEAR)).sum())
        bars.append((pulls, mean, k))
        for joint, other in ((start, end), (end, start)):
            if joint >= 0:
                K[joint, joint] += k
                if other >= 0:
                    K[joint, other] -= k
        if start >= 0:
            f[start] += mean
        if end >= 0:
            f[end] += float(pulls[-1, 1]) - mean
    u = np.linalg.lstsq(K, f, rcond=None)[0] if count else np.zeros(0)
    if count and np.abs(K @ u - f).max() > 1e-9 * np.abs(f).max():
        raise CaseError(
            "gravity.inclination: expected an end that is clamped or pinned, which holds the "
            "structure along its axis"
        )
    for (first, last, group, start, end), (pulls, mean, k) in zip(chains, bars, strict=True):
        stretch = (u[end] if end >= 0 else 0.0) - (u[start] if start >= 0 else 0.0)
        forces = k * stretch + mean - pulls
        EA_all = np.array([_effective_rigidity(case.lamina[i]) for i in group])
        for i, share in zip(group, EA_all / EA_all.sum(), strict=True):
            N[i, first:last] += share * forces
    return N


LINEAR = 0.5 * np.stack([1.0 - GAUSS[0], 1.0 + GAUSS[0]])
"""Values of the two linear functions of a cell at its points, shape (2, 4)."""


def _pulls(loads: FloatArray) -> FloatArray:
    """Return the sum of all loads before a place, nearest to it in each cell and linear there.

    Args:
        loads: at the points of each cell, shape (n_cells, 4) [N].

    Returns:
        Its values at both ends of each cell, shape (n_cells, 2) [N].
    """
    before = np.cumsum(loads.sum(axis=1)) - loads.sum(axis=1)
    start, end = LINEAR
    mean = before + loads @ start
    slope = 3.0 * (loads @ (start * end))  # of the least squares, over half a cell
    return np.stack([mean - slope, mean + slope], axis=1)


def _masses(case: Case, group: Sequence[int]) -> Iterator[tuple[float, float]]:
    """Yield mass [kg] and place [m] of the point masses on some laminae."""
    names = [case.lamina[i].name for i in group]
    for mass in case.masses:
        if mass.lamina in names:
            yield mass.mass, case.position_of(mass)
