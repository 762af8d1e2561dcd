"""Run the plain time loop of the reference: Newmark, then contact, as in the paper.

`decide` finds the hit pairs, the pairs on springs and the velocities after impacts. All functions
are pure and follow the paper equation by equation (section 3, with corrections).

The loop is written for clarity, not for speed. On purpose it differs from the main path of the
package: the springs are part of the matrix, which is factorised again whenever they change.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from scipy.linalg import cholesky, eigh, solve_triangular
from scipy.optimize import nnls
from scipy.sparse.linalg import splu

from delam_fem.case.definition import Case
from delam_fem.case.excitation import base_motion
from delam_fem.case.sections import Contact
from delam_fem.model.operators import Operators
from delam_fem.numerics.types import BoolArray, FloatArray
from delam_fem.system.errors import CaseError

Impact = tuple[int, float, float]
"""Number of the pair (0 is next to the clamp), impulse [N s], gap rate before the impact [m/s]."""
_SINGULAR = 1e-12
"""Eigenvalue of W, relative to the largest, below which it is round-off of zero."""
MassSolver = Callable[[FloatArray], FloatArray]
"""Function that returns M^-1 times a vector (n,) or a matrix (n, k)."""


def decide(
    operators: Operators,
    law: Contact,
    state: tuple[FloatArray, FloatArray, BoolArray],
    solve_mass: MassSolver,
) -> tuple[FloatArray, list[Impact], BoolArray]:
    """Decide on contact at the end of a step, in the order of operations of newton-penalty.

    Args:
        operators: gap operator, gap at rest, masses.
        law: the section `contact` of a case with the law "none", "newton" or "newton-penalty".
        state: displacement, shape (n,) [m]; velocity, shape (n,) [m/s]; which pairs are at rest
            on springs, shape (n_pairs,).
        solve_mass: function that multiplies by M^-1.

    Returns:
        Velocity after the impacts, shape (n,) [m/s]; the impacts; which pairs are at rest on
        springs from now on, shape (n_pairs,).
    """
    u, v, P = state
    if law.law == "none":
        return v, [], P
    H = operators.gap_matrix
    gap = H @ u + operators.gap0
    rate = H @ v
    stays = P & (gap <= 0.0)  # eq. 21
    hit = ~P & (gap <= 0.0) & (rate < 0.0)  # eq. 13
    if not hit.any():
        return v, [], stays
    if law.impulse == "lumped":
        v, impulses = lumped_impact(operators, v, hit, law.restitution)
    else:
        v, impulses = consistent_impact(operators, v, hit, law.restitution, solve_mass)
    pairs = np.flatnonzero(hit)
    impacts = list(zip(pairs.tolist(), impulses.tolist(), rate[hit].tolist(), strict=True))
    if law.law == "newton":
        return v, impacts, stays
    enters = hit & (H @ v < law.threshold_velocity)  # eq. 18
    return v, impacts, stays | enters


def lumped_impact(
    operators: Operators, v: FloatArray, hit: BoolArray, restitution: float
) -> tuple[FloatArray, FloatArray]:
    """Apply impulses that change only the velocities of the hit nodes (paper eq. 14).

    Args:
        operators: gap operator and nodal (lumped) masses.
        v: velocity before, shape (n,) [m/s].
        hit: which pairs are closed and approaching, shape (n_pairs,).
        restitution: e [-].

    Returns:
        Velocity after, shape (n,) [m/s]; impulse of each hit pair, shape (n_hit,) [N s].
    """
    H = operators.gap_matrix[hit]
    inverse_mass = 1.0 / operators.require_lumped_mass()
    impulses = -(1.0 + restitution) * (H @ v) / (H.power(2) @ inverse_mass)
    return v + inverse_mass * (H.T @ impulses), impulses


def consistent_impact(
    operators: Operators,
    v: FloatArray,
    hit: BoolArray,
    restitution: float,
    solve_mass: MassSolver,
) -> tuple[FloatArray, FloatArray]:
    """Apply the impulses p that solve 0 <= p  _|_  W p + (1 + e) rate >= 0 over the hit pairs.

    Here W = H M^-1 H^T. With W = L L^T and b = (1 + e) rate these are the optimality conditions of
    min |L^T p + L^-1 b|^2 over p >= 0, a problem of non-negative least squares. If some pairs
    depend on the others, as many in one element do, W is singular and L has fewer columns.

    Args:
        operators: gap operator.
        v: velocity before, shape (n,) [m/s].
        hit: which pairs are closed and approaching, shape (n_pairs,).
        restitution: e [-].
        solve_mass: function that multiplies by M^-1.

    Returns:
        Velocity after, shape (n,) [m/s]; impulse of each hit pair, shape (n_hit,) [N s].
    """
    H = operators.gap_matrix[hit]
    response = solve_mass(H.T.toarray())  # M^-1 H^T
    b = (1.0 + restitution) * (H @ v)
    impulses, _ = nnls(*_roots(H @ response, -b))
    return v + response @ impulses, impulses


def _roots(W: FloatArray, right: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return L^T and L^-1 r of W = L L^T; of a singular W, L has as many columns as its rank."""
    squares, vectors = eigh(W)
    is_regular = squares > _SINGULAR * squares[-1]
    if is_regular.all():
        L = cholesky(W, lower=True)
        return L.T, np.asarray(solve_triangular(L, right, lower=True))
    roots = np.sqrt(squares[is_regular])
    basis = vectors[:, is_regular]
    return roots[:, None] * basis.T, basis.T @ right / roots


LAWS = ("none", "newton", "newton-penalty")
"""Contact laws that the reference has."""


@dataclass(frozen=True)
class Standing:
    """The state of a run at the end of a step.

    Attributes:
        step: number of steps since t = 0.
        displacement: displacements of the free dofs, shape (n,) [m, -].
        velocity: velocities of the free dofs, shape (n,) [m/s, 1/s].
        permanent: which pairs are at rest on springs (permanent contact in the paper), shape
            (n_pairs,).
    """

    step: int
    displacement: FloatArray
    velocity: FloatArray
    permanent: BoolArray


class Event(NamedTuple):
    """One impact of one pair.

    Attributes:
        time: end of the step [s].
        pair: number of the pair; 0 is next to the clamp.
        impulse: impulse on the pair [N s].
        velocity_before: gap rate before the impact [m/s].
    """

    time: float
    pair: int
    impulse: float
    velocity_before: float


@dataclass(frozen=True)
class ReferenceRun:
    """The record of a run of the reference.

    Attributes:
        times: ends of the steps, shape (n,) [s].
        displacement: displacements of both reference probes, shape (2, n) [m].
        velocity: their velocities after the impacts of the step, shape (2, n) [m/s].
        events: all impacts in the order of time.
        final: state after the last step.
    """

    times: FloatArray
    displacement: FloatArray
    velocity: FloatArray
    events: list[Event]
    final: Standing


def simulate_reference(
    operators: Operators, case: Case, *, periods: int, initial: Standing | None = None
) -> ReferenceRun:
    """Run the reference on a case for some periods, with a constant time step.

    Args:
        operators: operators of the structure, from any assembler.
        case: case with excitation, contact law and time step.
        periods: number of periods to compute.
        initial: initial state; default: at rest at t = 0, under weight and loads if there are any.

    Returns:
        Histories of the probes at every step, impacts and final state.

    Raises:
        CaseError: the reference does not have the scheme or the contact law of the case.
    """
    refusal = refused_motion(case)
    if refusal:
        raise CaseError(refusal)
    zeros = np.zeros(operators.n_dofs)
    state = initial or Standing(0, zeros, zeros, np.zeros(operators.n_pairs, dtype=bool))
    if initial is None and case.begins_at_rest:
        lying, closed = rest(operators, case)
        state = Standing(0, lying, zeros, closed)
    N, dt = case.steps_per_period, case.time_step
    steps = np.arange(state.step, state.step + periods * N + 1)
    base = base_motion(case.excitation).states(steps * dt)
    system = _System(operators, dt, case.contact.penalty_stiffness)
    u, v, P = state.displacement, state.velocity, state.permanent
    a = system.acceleration(u, v, base[0], P)
    probes = operators.probes
    motion = np.empty((2, operators.n_probes, periods * N))
    events: list[Event] = []
    for i in range(periods * N):
        u, v, a = system.newmark(u, v, a, base[i + 1], P)
        v, impacts, P_new = decide(operators, case.contact, (u, v, P), system.solve_mass)
        if impacts or not np.array_equal(P, P_new):
            P = P_new
            a = system.acceleration(u, v, base[i + 1], P)
        time = steps[i + 1] * dt
        events += [Event(time, *impact) for impact in impacts]
        motion[:, :, i] = probes @ u, probes @ v
    return ReferenceRun(
        steps[1:] * dt, motion[0], motion[1], events, Standing(int(steps[-1]), u, v, P)
    )


MOST_CHANGES = 200
"""Sets of closed springs that are tried for the state of rest."""


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


class _System:
    """The matrices M, C, K with the springs of resting pairs in K, and their factorisations."""

    def __init__(self, operators: Operators, dt: float, penalty_stiffness: float) -> None:
        self.operators = operators
        self.dt = dt
        self.penalty_stiffness = penalty_stiffness
        self.solve_mass: MassSolver = splu(operators.mass.tocsc()).solve
        base = operators.base
        self.base_columns = np.stack([base.stiffness, base.damping, base.mass], axis=1)
        self._factorise(np.zeros(operators.n_pairs, dtype=bool))

    def newmark(
        self, u: FloatArray, v: FloatArray, a: FloatArray, base: FloatArray, P: BoolArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Make a step of average acceleration (the paper's alpha_N = 1/4, beta_N = 1/2)."""
        self._require_springs(P)
        dt = self.dt
        u_predicted = u + dt * v + 0.25 * dt**2 * a
        v_predicted = v + 0.5 * dt * a
        force = self.force(base) - self.operators.damping @ v_predicted - self.K @ u_predicted
        a_new = self.newmark_factor.solve(force)
        return u_predicted + 0.25 * dt**2 * a_new, v_predicted + 0.5 * dt * a_new, a_new

    def acceleration(
        self, u: FloatArray, v: FloatArray, base: FloatArray, P: BoolArray
    ) -> FloatArray:
        """Return a from M a = f - C v - K u, with the springs in f and K."""
        self._require_springs(P)
        return self.solve_mass(self.force(base) - self.operators.damping @ v - self.K @ u)

    def force(self, base: FloatArray) -> FloatArray:
        """Return the force of the base motion (q, q', q''), rest gaps of springs, and loads."""
        force = self.spring_force - self.base_columns @ base
        return np.asarray(force if self.operators.load is None else force + self.operators.load)

    def _require_springs(self, P: BoolArray) -> None:
        if not np.array_equal(P, self.springs):
            self._factorise(P)

    def _factorise(self, P: BoolArray) -> None:
        """Put a spring on the gap of each pair in P: force on the dofs -k H^T (H u + g0)."""
        ops, k, dt = self.operators, self.penalty_stiffness, self.dt
        H = ops.gap_matrix[P]
        w = np.ones(ops.n_pairs)
        if ops.pair_weights is not None:
            w = ops.pair_weights
        springs = H.T @ sp.diags(k * w[P])
        self.springs = P.copy()
        self.spring_force = -(springs @ ops.gap0[P])
        self.K = sp.csr_matrix(ops.stiffness + springs @ H)  # paper eq. 19
        effective = ops.mass + 0.5 * dt * ops.damping + 0.25 * dt**2 * self.K
        self.newmark_factor = splu(effective.tocsc())


def refused_motion(case: Case) -> str:
    """Return why the reference cannot compute the motion of a case; "" if it can."""
    if case.excitation.kind != "harmonic":
        return (
            "excitation.kind: the reference has the first periods of a harmonic excitation; given "
            f"{case.excitation.kind!r}"
        )
    if not case.has_one_length:
        lengths = ", ".join(f"{lamina.length:g}" for lamina in case.lamina)
        return f"lamina.length: the reference has laminae of one length; given {lengths}"
    if case.contact.law not in LAWS:
        return f"contact.law: the reference has {', '.join(LAWS)}; given {case.contact.law!r}"
    if case.time.scheme != "newmark":
        return f"time.scheme: the reference has newmark; given {case.time.scheme!r}"
    for key in ("beta", "gamma"):
        if getattr(case.time, key) is not None:
            return f"time.{key}: the reference has average acceleration; given another {key}"
    for key, table in case.contacts:
        for name in ("restitution", "stiffness", "threshold_velocity"):
            if getattr(table, name) is not None:
                return f"{key}.{name}: the reference has the numbers of [contact] for all pairs"
    if case.initial:
        return f"initial: the reference begins at rest; given {len(case.initial)} initial states"
    if case.time.refine > 1 and case.contact.law != "none":
        return f"time.refine: the reference has steps of one length; given {case.time.refine}"
    return ""
