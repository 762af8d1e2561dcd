"""Prepare a problem for compiled code: order the dofs, and compute scheme numbers and factors.

Two laminae with Rayleigh damping are stored in lane order (simd_chains.py) if the scheme is the
θ-scheme or the average acceleration. Everything else is stored by sparse rows and bands
(algebra.py), where a step of either scheme is

    ũ = u + Δt v + c2 a,   ṽ = v + c3 a                                                        (G1)
    A a⁺ = f - C ṽ - K (ũ + g ṽ),   A = M + p C + q K                                           (G2)
    u⁺ = ũ + d1 a⁺,   v⁺ = ṽ + d2 a⁺                                                            (G3)

                 p       q          c2              c3          g          d1       d2      ρ
    Newmark      γ Δt    β Δt²      (1/2 - β) Δt²   (1 - γ) Δt  0          β Δt²    γ Δt    1
    θ-scheme     θ Δt    θ² Δt²     0               0           (θ-1) Δt   θ Δt²    Δt      1/θ - 1

The damping loss of a step is weight · zᵀ C z with z = v⁺ + ρ v.

Lanes, lanes with points, modes and bands each earn their code. A step of the preset `embedded` with
20, 40 and 80 elements takes 6.9, 5.0 and 3.8 times as long in bands as in modes. With two and eight
points per element, a step of `paper` takes 4 and 19 times as long without the cells of
inner_points.py. With consistent impulses it takes 16 times as long in bands as in lanes (20
elements, periods with contact).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp

from delam_fem.contact.decisions import LawNumbers
from delam_fem.engines.compiled import algebra, simd_chains, simd_chains as lk
from delam_fem.engines.compiled.algebra import Band, Rows
from delam_fem.engines.compiled.inner_points import (
    NO_POINTS,
    Coordinates,
    InnerModes,
    Places,
    Points,
    in_modes,
    is_reduced,
    padded,
    points_of,
)
from delam_fem.engines.compiled.simd_chains import aligned_zeros
from delam_fem.engines.compiled.state import Memory
from delam_fem.model.operators import Operators
from delam_fem.numerics.types import FloatArray, IntArray


class StepNumbers(NamedTuple):
    """The numbers of a scheme and its time step that compiled code needs.

    Attributes:
        time_step: Δt [s].
        p, q, c2, c3, g, d1, d2, rho: see the table in the module docstring.
        weight: factor of zᵀ C z in the damping loss [s].
        theta: position within the step at which the base load is taken; 1: at its end.
        gap_ahead: time by which gaps are extrapolated from the start of the step [s]; 0: the law
            sees the gaps at its end.
        is_midpoint: whether the motion is that of a θ-scheme (also true for the average
            acceleration, θ = 1/2, which differs only in the gaps that the law sees).
    """

    time_step: float
    p: float
    q: float
    c2: float
    c3: float
    g: float
    d1: float
    d2: float
    rho: float
    weight: float
    theta: float
    gap_ahead: float
    is_midpoint: bool

    @classmethod
    def newmark(cls, time_step: float, beta: float = 0.25, gamma: float = 0.5) -> StepNumbers:
        """Return the numbers of Newmark's scheme; β = 0 is the central difference."""
        dt = time_step
        p = gamma * dt
        q = beta * dt**2
        return cls(
            dt, p, q, (0.5 - beta) * dt**2, (1.0 - gamma) * dt, 0.0, q, p, 1.0, 0.25 * dt,
            1.0, 0.0, beta == 0.25 and gamma == 0.5,
        )  # fmt: skip

    @classmethod
    def moreau_jean(cls, time_step: float, theta: float = 0.5) -> StepNumbers:
        """Return the numbers of the θ-scheme."""
        dt = time_step
        p = theta * time_step
        return cls(
            dt, p, p**2, 0.0, 0.0, (theta - 1.0) * dt, theta * dt**2, dt, 1.0 / theta - 1.0,
            theta * p, theta, 0.5 * dt, True,
        )  # fmt: skip

    @property
    def has_acceleration(self) -> bool:
        """Whether a step needs the acceleration at its start; the θ-scheme has none."""
        return self.gap_ahead == 0.0


class System(NamedTuple):
    """A problem in the form that compiled code reads; vectors have `size` numbers, internal order.

    Attributes:
        size: count of numbers per field.
        n_pairs: number of contact pairs.
        n_probes: number of probes, those of sensors included.
        is_chained: True: two laminae in lane order; False: sparse rows and bands.
        is_within: whether, in lane order, some pairs are inside the elements (inner_points.py).
        is_diagonal_load: whether the matrix B of L1 is diagonal (L4).
        scheme: the time integration.
        coefficients: coefficients of L1 and L2, shape (16,).
        forth, back: coefficients of a step (`simd_chains.step_tapes`).
        solution, mass_solution, form, rest: tapes of simd_chains.py.
        band, mass_band: factors of A and M if not chained.
        mass, damping, stiffness: M, C, K by rows.
        base: base columns of M, C, K, shape (3, size).
        inverse_lumped: inverse of the lumped mass, shape (size,).
        gap_rows: H by rows.
        gap_largest: largest |H_kj| of each row in modes, shape (n_pairs,); otherwise empty.
        gap0: gaps at rest, shape (n_pairs,) [m].
        roots: √w of the weights of the pairs, shape (n_pairs,).
        base_rows: `base` as a matrix by rows.
        is_selecting: whether every probe picks a single dof.
        selected: places of these dofs; empty if the probes do not pick single dofs.
        probe_rows: the probes by rows; empty if they pick single dofs.
        probe_shift: what a unit of q adds to the probes, shape (n_probes,).
        is_shifted: whether that is not 0 for one of them.
        coarseness: 0, 1, 2: fine, middle or coarse steps; W is kept for each.
        is_modal: whether the unknowns are the amplitudes of modes (inner_points.py).
        modal: diagonals of A⁻¹, C and K in modes, shape (3 size,); empty otherwise.
        is_touching: whether some pairs are closed at rest, so that contact lasts.
        points: the pairs by cells; empty unless `is_within`.
        has_load: whether there are constant loads or further forces.
        load: the constant loads, shape (size,).
        n_forces: number of further forces.
        forces: loads of a unit of each, shape (n_forces, size).
    """

    size: int
    n_pairs: int
    n_probes: int
    is_chained: bool
    is_within: bool
    is_diagonal_load: bool
    scheme: StepNumbers
    coefficients: FloatArray
    forth: FloatArray
    back: FloatArray
    solution: FloatArray
    mass_solution: FloatArray
    form: FloatArray
    rest: FloatArray
    band: Band
    mass_band: Band
    mass: Rows
    damping: Rows
    stiffness: Rows
    base: FloatArray
    inverse_lumped: FloatArray
    gap_rows: Rows
    gap_largest: FloatArray
    gap0: FloatArray
    roots: FloatArray
    base_rows: Rows
    is_selecting: bool
    selected: IntArray
    probe_rows: Rows
    probe_shift: FloatArray
    is_shifted: bool
    is_modal: bool
    modal: FloatArray
    is_touching: bool
    points: Points
    has_load: bool
    load: FloatArray
    n_forces: int
    forces: FloatArray
    coarseness: int = 0


class Problem(NamedTuple):
    """What compiled code needs of a problem: three sizes of steps, the law, the state.

    Attributes:
        coarse, middle, fine: the system with each size of steps; without refinement the same.
        law: contact law.
        memory: state and work space.
        corner: M_aa, C_aa, K_aa of the base, shape (3,).
    """

    coarse: System
    middle: System
    fine: System
    law: LawNumbers
    memory: Memory
    corner: FloatArray


_NO_BAND = Band(0, np.zeros((0, 1)))
_NOTHING = np.zeros(0)
_NO_PLACES: IntArray = np.zeros(0, dtype=np.int64)


@dataclass(frozen=True)
class _Chained:
    """Operators in lane order, for any size of steps.

    Attributes:
        system: the system without its scheme and what depends on that.
        places: its unknowns.
        mass, stiffness: M and K.
        alpha, beta: coefficients of Rayleigh damping in each lane, shape (4,) [1/s, s].
        stiffest: norm of M⁻¹ K if M is diagonal, otherwise 0 [1/s2].
    """

    system: System
    places: Places
    mass: simd_chains.Chains
    stiffness: simd_chains.Chains
    alpha: FloatArray
    beta: FloatArray
    stiffest: float


@lru_cache(maxsize=8)
def build(o: Operators, scheme: StepNumbers) -> tuple[System, Coordinates]:
    """Return a problem for compiled code, and its unknowns.

    The last results are kept: the points of a sweep mostly share operators and scheme, and building
    a system of 20 elements takes as long as computing twenty periods. Nobody ever writes to a
    system.

    Raises:
        ArithmeticError: M or A is singular.
    """
    lasts = not scheme.has_acceleration and o.is_touching
    if scheme.is_midpoint and not lasts:
        chained = _chained(o)
        if chained is not None:
            same = StepNumbers.moreau_jean(scheme.time_step, scheme.p / scheme.time_step)
            return _with_scheme(chained, same._replace(gap_ahead=scheme.gap_ahead)), chained.places
    full = padded(o) if is_reduced(o) else None
    takes_modes = o.base.shift is None
    if full is not None and (scheme.has_acceleration or not takes_modes):
        system = _system(full, scheme, Places(np.arange(full.n_dofs), full.n_dofs))
        return system, Places(np.arange(o.n_dofs), full.n_dofs)
    result = in_modes(o) if takes_modes and not scheme.has_acceleration else None
    if result is not None:
        modal, modes = result
        return _system(modal, scheme, modes), modes
    order = algebra.band_order(sum(abs(matrix) for matrix in (o.mass, o.damping, o.stiffness)))
    places = Places(order, o.n_dofs)
    return _system(o, scheme, places), places


@lru_cache(maxsize=8)
def build_of_size(o: Operators, scheme: StepNumbers, coarseness: int) -> tuple[System, Coordinates]:
    """Return what `build` does, of coarse (2), middle (1) or fine steps (0).

    Raises:
        ArithmeticError: M or A is singular.
    """
    system, unknowns = build(o, scheme)
    return system._replace(coarseness=coarseness), unknowns


def _system(
    o: Operators, scheme: StepNumbers, places: Coordinates, *, is_chained: bool = False
) -> System:
    """Return the system without its tapes (simd_chains.py)."""
    is_modal = isinstance(places, InnerModes)
    size = places.size
    order = np.arange(size) if isinstance(places, InnerModes) else places.order
    to = sp.csr_matrix((np.ones(o.n_dofs), (order, np.arange(o.n_dofs))), (size, o.n_dofs))
    mass, damping, stiffness = (to @ A @ to.T for A in (o.mass, o.damping, o.stiffness))
    base = np.vstack([o.base.mass, o.base.damping, o.base.stiffness]) @ to.T
    step = mass + scheme.p * damping + scheme.q * stiffness
    band, mass_band = (_NO_BAND if is_chained else algebra.factorise(A) for A in (step, mass))
    to_rows = algebra.dense_rows if is_modal or is_reduced(o) else algebra.rows
    inverse_lumped = np.zeros(o.n_dofs) if o.lumped_mass is None else 1.0 / o.lumped_mass
    probes = o.observed
    gap_rows = to_rows(o.gap_matrix @ to.T)
    shape = (o.n_pairs, gap_rows.width)
    gap_largest = np.abs(gap_rows.value.reshape(shape)).max(1) if gap_rows.width else _NOTHING
    is_selecting = bool((np.diff(probes.indptr) == 1).all() and (probes.data == 1.0).all())
    return System(
        size=size,
        n_pairs=o.n_pairs,
        n_probes=o.n_probes + o.n_sensors,
        is_chained=is_chained,
        is_within=False,
        is_diagonal_load=False,
        scheme=scheme,
        coefficients=_NOTHING,
        forth=_NOTHING,
        back=_NOTHING,
        solution=_NOTHING,
        mass_solution=_NOTHING,
        form=_NOTHING,
        rest=_NOTHING,
        band=band,
        mass_band=mass_band,
        mass=algebra.rows(mass),
        damping=algebra.rows(damping),
        stiffness=algebra.rows(stiffness),
        base=simd_chains.flat(base).reshape(3, size),
        inverse_lumped=to @ inverse_lumped,
        gap_rows=gap_rows,
        gap_largest=gap_largest,
        gap0=np.array(o.gap0, dtype=float),
        roots=np.ones(o.n_pairs) if o.pair_weights is None else np.sqrt(o.pair_weights),
        base_rows=to_rows(sp.csr_matrix(base)),
        is_selecting=is_selecting,
        selected=order[probes.indices] if is_selecting else _NO_PLACES,
        probe_shift=o.probe_shift,
        is_shifted=bool(o.probe_shift.any()),
        probe_rows=to_rows((probes @ to.T)[: 0 if is_selecting else None]),
        is_modal=is_modal,
        modal=_diagonals(mass, damping, stiffness, scheme) if is_modal else _NOTHING,
        is_touching=o.is_touching,
        points=NO_POINTS,
        has_load=o.load is not None or o.n_forces > 0,
        load=simd_chains.flat(to @ (np.zeros(o.n_dofs) if o.load is None else o.load)),
        n_forces=o.n_forces,
        forces=np.ascontiguousarray((to @ o.forces).T),
    )


def _diagonals(
    mass: sp.csr_matrix, damping: sp.csr_matrix, stiffness: sp.csr_matrix, scheme: StepNumbers
) -> FloatArray:
    """Return the diagonals of A⁻¹, C and K in modes, one after the other."""
    m, c, k = (matrix.diagonal() for matrix in (mass, damping, stiffness))
    return np.concatenate([1.0 / (m + scheme.p * c + scheme.q * k), c, k])


@lru_cache(maxsize=2)
def _chained(o: Operators) -> _Chained | None:
    """Return operators in lane order, or None if they do not fit it.

    The last results are kept, because points of a sweep and sizes of steps share operators.
    """
    if not o.n_dofs or o.n_dofs % 4:
        return None
    order = simd_chains.lane_order(o.n_dofs // 4)
    M, C, K = (simd_chains.chains(matrix, order) for matrix in (o.mass, o.damping, o.stiffness))
    damping, (rest_gaps, points) = simd_chains.rayleigh(o), _gaps(o, order)
    is_at_clamp = all(
        (order[np.flatnonzero(column)] < lk.ROW).all()
        for column in (o.base.mass, o.base.damping, o.base.stiffness)
    )
    if (
        M is None
        or C is None
        or K is None
        or damping is None
        or rest_gaps is None
        or not is_at_clamp
    ):
        return None
    places = Places(order, lk.ROW * -(-o.n_dofs // lk.ROW))
    alpha, beta = (np.repeat(values, 2) for values in damping)
    system = _system(o, StepNumbers.newmark(0.0), places, is_chained=True)._replace(
        is_within=points is not NO_POINTS,
        mass_solution=simd_chains.solution_tape(M),
        form=simd_chains.form_tape(C),
        rest=rest_gaps,
        points=points,
    )
    return _Chained(system, places, M, K, alpha, beta, _stiffest(o))


def _with_scheme(chained: _Chained, scheme: StepNumbers) -> System:
    """Return the system with the tapes of a scheme and its size of steps."""
    M = chained.mass
    K = chained.stiffness
    dt = scheme.time_step
    c_M = 1.0 + scheme.p * chained.alpha
    c_K = scheme.q + scheme.p * chained.beta
    # The acceleration has a part u/c_K with L4 and a part M⁻¹ K u with L3. The larger of these
    # parts loses more digits, so L4, which needs a diagonal M, is chosen if 1/c_K is at most the
    # norm of M⁻¹ K.
    is_diagonal = bool(float(c_K.min()) * chained.stiffest >= 1.0)
    coefficients = aligned_zeros(lk.N_COEFFICIENTS * simd_chains.LANES)
    table = coefficients.reshape(lk.N_COEFFICIENTS, simd_chains.LANES)
    table[lk.S] = c_K / (scheme.p * c_M)
    table[lk.KAPPA] = -dt / c_K if is_diagonal else 1.0 / (scheme.theta * c_M)
    table[lk.TO_U] = scheme.p
    table[lk.MINUS_RHO] = -scheme.rho
    loads = (
        simd_chains.flat(np.einsum("rlii->ril", M.scaled(dt * c_M / c_K).middle))
        if is_diagonal
        else simd_chains.product_tape(K.scaled(np.full(simd_chains.LANES, -dt)))
    )
    solution = simd_chains.solution_tape(M.scaled(c_M) + K.scaled(c_K))
    forth, back = simd_chains.step_tapes(loads, solution, chained.system.form, chained.system.rest)
    return chained.system._replace(
        is_diagonal_load=is_diagonal,
        scheme=scheme,
        coefficients=coefficients,
        forth=forth,
        back=back,
        solution=solution,
    )


def _stiffest(o: Operators) -> float:
    """Return the norm of M⁻¹ K if M is diagonal, otherwise 0 [1/s2]."""
    M = sp.coo_matrix(o.mass)
    if np.any((M.row != M.col) & (M.data != 0.0)):
        return 0.0
    return float(np.max(abs(o.stiffness).sum(axis=1).A1 / o.mass.diagonal()))


def _gaps(o: Operators, order: IntArray) -> tuple[FloatArray | None, Points]:
    """Return the gaps at rest in lane order, shape (4 m,), infinite where there is no pair.

    If there are pairs inside the elements, all of these are infinite, and `Points` has the pairs.
    Return None if the gaps are not those between opposite points of two laminae.
    """
    result = aligned_zeros(simd_chains.LANES * -(-o.n_dofs // lk.ROW))
    result[:] = np.inf
    if o.n_dofs == 4 * o.n_pairs:
        place = _opposite_nodes(o, order)
        if place is None:
            return None, NO_POINTS
        result[place // lk.ROW * simd_chains.LANES + place % simd_chains.LANES] = o.gap0
        return result, NO_POINTS
    points = None if not o.n_pairs or o.is_touching else points_of(o, order)
    return (None, NO_POINTS) if points is None else (result, points)


def _opposite_nodes(o: Operators, order: IntArray) -> IntArray | None:
    """Return the place of the lower node of each pair, shape (n,).

    Return None if the pairs are not the opposite nodes of two laminae.
    """
    n = o.n_pairs
    pair = np.arange(n)
    columns = np.concatenate([2 * pair, 2 * (n + pair)])
    opposite = sp.csr_matrix(
        (np.repeat([-1.0, 1.0], n), (np.tile(pair, 2), columns)), shape=(n, 4 * n)
    )
    if abs(o.gap_matrix - opposite).max() != 0.0:
        return None
    return np.asarray(order[2 * pair])
