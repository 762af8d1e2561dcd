"""Compute linear vibrations: modes, steady response, decay, the limit of central differences.

This is the only module that builds the dynamic stiffness K + iωC - ω²M.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy.sparse as sp
from scipy.linalg import eigh, null_space
from scipy.sparse.csgraph import connected_components

from delam_fem.model import operators as distributed
from delam_fem.model.factors import DENSE_DOFS, Factor, factored, largest, regular
from delam_fem.model.layout import Layout, Structure
from delam_fem.model.operators import (
    DistributedOperators,
    Operators,
    Recorded,
    diagonal,
    n_rows,
    of_ranks,
    own_rows,
    scaled_by,
    summed,
    times,
)
from delam_fem.model.sharing import Share
from delam_fem.numerics.beams import ComplexArray
from delam_fem.numerics.types import FloatArray, IntArray
from delam_fem.system.errors import CaseError

if TYPE_CHECKING:
    from delam_fem.case.definition import Case

DECAYING = 12
"""Number of lowest modes among which the slowest decay is looked for."""
MOST_RIGID = 6
"""Largest number of rigid motions of a body."""
NEAR_ZERO = 1e-9
"""Shift at which the smallest eigenvalues of a large scaled stiffness are sought."""
ABOVE_ROUND_OFF = 1e-12
"""Shift of a large floating body, in parts of the mean of its diagonal K over that of M."""
NO_STIFFNESS = 1e-13
"""Eigenvalue of a stiffness, scaled to a unit diagonal, below which it is round-off; the smallest
one of a cantilever of 200 elements is 3e-10."""
TIED_AT_ONCE = 500
"""Dofs that are solved for at once where pairs are tied: a bound for the memory."""
NO_MASS = 1e-15
"""Share of the largest 1/omega^2 that is round-off of motions without mass."""


def lowest(
    K: Any,
    M: Any,
    n: int,
    *,
    is_floating: bool = False,
    factor: Factor | None = None,
) -> tuple[FloatArray, FloatArray]:
    """Return the n lowest frequencies [Hz] and vectors, shape (n_dofs, n).

    Of matrices that are spread over ranks (collective) the vectors are those of the own dofs.

    M v = mu (K + s M) v is solved for the largest mu = 1/(omega^2 + s): the other way round, the
    lowest frequencies would drown in the round-off of the highest. What has no mass has an
    infinite frequency.

    Args:
        K: stiffness.
        M: mass.
        n: number of modes.
        is_floating: whether K is singular; a shift s then makes the problem regular. Without it s
            is 0.
        factor: factors of K + s M, if there are any; None: they are computed where they are needed.
    """
    dofs = n_rows(K)
    shift = factor.shift if factor else _shift(K, M) if is_floating else 0.0
    if sp.issparse(K) and (dofs <= DENSE_DOFS or 2 * n >= dofs):
        stiff = K.toarray() + shift * M.toarray() if shift else K.toarray()
        mu, vectors = eigh(M.toarray(), stiff, subset_by_index=(dofs - n, dofs - 1))
        mu = np.where(mu > NO_MASS * mu[-1], mu, 0.0)[::-1]
        vectors = vectors[:, ::-1]
        with np.errstate(divide="ignore"):
            omega = np.sqrt(np.maximum(1.0 / mu - shift, 0.0)) if shift else 1.0 / np.sqrt(mu)
    else:
        squares, vectors = (factor or factored(K, M, shift)).lowest(n)
        omega = np.sqrt(np.maximum(squares, 0.0))
    return omega / (2.0 * np.pi), vectors


def n_rigid(K: Any) -> int:
    """Return the number of motions against which a structure has no stiffness.

    They are the eigenvalues of K, scaled to a unit diagonal, that are round-off.

    Args:
        K: stiffness, symmetric and positive semidefinite; may be spread over ranks (collective).
    """
    sizes = diagonal(K)
    scale = 1.0 / np.sqrt(np.where(sizes > 0.0, sizes, 1.0))
    if not sp.issparse(K):
        scaled, ones = scaled_by(K, scale)
        values = factored(scaled, ones, NEAR_ZERO).lowest(MOST_RIGID)[0]
        return int(np.count_nonzero(np.abs(values) <= NO_STIFFNESS))
    scaled = sp.csc_matrix(sp.diags(scale) @ K @ sp.diags(scale))
    if K.shape[0] <= DENSE_DOFS:
        values = eigh(scaled.toarray(), eigvals_only=True)
    else:
        values = factored(scaled, sp.identity(K.shape[0]), NEAR_ZERO).lowest(MOST_RIGID)[0]
    return int(np.count_nonzero(np.abs(values) <= NO_STIFFNESS))


def mode_of(K: Any, M: Any, n: int, translation: FloatArray) -> FloatArray:
    """Return mode n of a structure that may float, shape (n_dofs,); see `lowest`.

    Rigid motions have the frequency 0 and are the first modes. As any mixture of several of them
    would do, the first one is the translation, or what they have of it.

    Args:
        K: stiffness.
        M: mass.
        n: number of the mode, from 1.
        translation: the dofs of a unit translation, shape (n_dofs,).
    """
    count = n_rigid(K)
    vectors = lowest(K, M, max(n, count), is_floating=count > 0)[1]
    if n > count or count == 1:
        return np.asarray(vectors[:, n - 1])
    rigid = vectors[:, :count]  # of equal size and orthogonal, by M
    along = summed(M, rigid.T @ times(M, translation))
    turn, _ = np.linalg.qr(np.column_stack([along, np.eye(count)]))
    return np.asarray(rigid @ turn[:, n - 1])


def normalised(vectors: FloatArray, M: Any) -> FloatArray:
    """Return modes with φᵀ M φ = 1 and a positive largest entry: similar modes have one sign."""
    masses = np.sqrt(summed(M, np.einsum("ij,ij->j", vectors, times(M, vectors))))
    return np.asarray(vectors / (masses * np.sign(largest_entries(vectors, M))))


def largest_entries(vectors: FloatArray, like: Any) -> FloatArray:
    """Return the entry of largest size of each vector whose dofs are those of a matrix, (n,)."""
    columns = np.arange(vectors.shape[1])
    local = vectors[np.abs(vectors).argmax(axis=0), columns] if len(vectors) else 0.0 * columns
    entries = np.array(of_ranks(like, local))
    return np.asarray(entries[np.abs(entries).argmax(axis=0), columns])


def elastic(K: Any, M: Any, n: int, n_rigid: int) -> tuple[FloatArray, FloatArray]:
    """Return the n lowest frequencies and vectors behind the rigid motions; see `lowest`."""
    frequencies, vectors = lowest(K, M, n_rigid + n, is_floating=n_rigid > 0)
    return frequencies[n_rigid:], vectors[:, n_rigid:]


_ITERATIONS = 12
"""Number of inverse iterations; each divides the share of mode 2 by (ω2/ω1)² = 39."""


def first_mode(structure: Structure, number: int) -> FloatArray:
    """Return the first mode of one part, while all other parts stay straight.

    The mode follows from the inverse iteration v <- K⁻¹ M v.

    Args:
        structure: the discretised structure.
        number: number of the part; the probe with the same number scales the mode.

    Returns:
        Mode in all free dofs, 1 at the probe, shape (n,) [-, 1/m].
    """
    operators = structure.operators
    dofs = structure.layout.own_dofs(number)
    K, M = (matrix[dofs][:, dofs] for matrix in (operators.stiffness, operators.mass))
    probe = operators.probes[number, dofs]
    solve = factored(K).solve
    shape = np.ones(dofs.size)
    for _ in range(_ITERATIONS):
        shape = solve(M @ shape)
        shape /= (probe @ shape)[0]
    mode = np.zeros(operators.n_dofs)
    mode[dofs] = shape
    return mode


def first_shapes(
    case: Case, structure: Structure, factors: Sequence[float] | None = None
) -> FloatArray:
    """Return a displacement of all dofs in which every lamina vibrates in its first mode.

    Args:
        case: the case.
        structure: its structure.
        factors: of the modes of laminae that are apart, shape (n_laminae,); None: 1.

    Returns:
        Shape (n_dofs,). A bonded stack moves in its own first mode, 1 at the largest probe.
    """
    if case.is_apart and not case.n_rigid:
        sizes = np.ones(len(structure.layout.parts)) if factors is None else factors
        return np.asarray(
            np.sum([size * first_mode(structure, i) for i, size in enumerate(sizes)], axis=0)
        )
    o = structure.operators
    shape = elastic(o.stiffness, o.mass, 1, case.n_rigid)[1][:, 0]
    return np.asarray(shape / np.abs(o.probes @ shape).max())


def openings(case: Case, structure: Structure) -> FloatArray:
    """Return by how much the first mode opens each contact pair, shape (n_pairs,).

    Laminae that are apart move against one another, each in its first mode φ₁ with 1 at the tip;
    the opening is the mean of both. A bonded stack moves as in `first_shapes`.
    """
    against = [0.5 * (-1.0) ** i for i in range(len(structure.layout.parts))]
    shape = first_shapes(case, structure, against)
    return np.asarray(np.abs(structure.operators.gap_matrix @ shape))


def response(
    operators: Operators, frequency: float, S: sp.csr_matrix | None = None
) -> ComplexArray:
    """Return the steady motion U of all dofs without contact, per unit of the drive, shape (n,).

    (K + iωC - ω²M) U = -(k_b + iω c_b - ω² m_b),   u = Im(U exp(iωt)),  q = Im(exp(iωt))

    Args:
        operators: the semi-discrete problem.
        frequency: frequency of the drive [Hz].
        S: the motions that are left, u = S w (`keeping_closed`), shape (n, m); None: all.
    """
    o = operators
    omega = 2.0 * math.pi * frequency
    load = -(o.base.stiffness + 1j * omega * o.base.damping - omega**2 * o.base.mass)
    M, C, K = o.mass, o.damping, o.stiffness
    if S is not None:
        M = S.T @ M @ S
        C = S.T @ C @ S
        K = S.T @ K @ S
        load = S.T @ load
    U = regular(K + 1j * omega * C - omega**2 * M)(load)
    return np.asarray(U if S is None else S @ U)


def opening_amplitude(
    o: Recorded[Any], frequency: float, springs: FloatArray | None = None
) -> float | None:
    """Return the amplitude of the drive at which the first pair opens that is closed at rest.

    The call is collective where ranks share the dofs.

    The pairs that are pressed together at rest stay together, all others are open:

        (K + iωC - ω²M) u - Hᵀ λ = -(k_b + iω c_b - ω² m_b),   H u + λ / k = 0

    and a pair opens where the amplitude of λ is that of its force at rest.

    Args:
        o: the operators, with their state of rest.
        frequency: frequency of the drive [Hz].
        springs: k of each pair, shape (n_pairs,) [N/m]; None: all are rigid.

    Returns:
        The amplitude [m, or N of a force]; None: no pair is closed at rest, or none opens.
    """
    if o.equilibrium is None or not o.equilibrium.force.any():
        return None
    pairs = np.flatnonzero(o.equilibrium.force > 0.0)
    omega = 2.0 * math.pi * frequency
    H = o.gap_matrix[pairs]
    soft = np.zeros(pairs.size) if springs is None else 1.0 / springs[pairs]
    load = -(o.base.stiffness + 1j * omega * o.base.damping - omega**2 * o.base.mass)
    if sp.issparse(o.stiffness):
        dynamic = o.stiffness + 1j * omega * o.damping - omega**2 * o.mass
        matrix = sp.bmat([[dynamic, -H.T], [H, sp.diags(soft)]], format="csc")
        force = regular(matrix)(np.concatenate([load, np.zeros(pairs.size)]))[o.n_dofs :]
    else:
        responses = _steady(o, omega, np.column_stack([H.T.toarray(), load]))
        read = o.total(H @ responses)
        force = np.linalg.solve(read[:, :-1] + np.diag(soft), -read[:, -1])
    sizes = np.abs(force)
    opens = sizes > 0.0
    ratios = o.equilibrium.force[pairs][opens] / sizes[opens]
    return float(ratios.min()) if ratios.size else None


def _steady(o: Recorded[Any], omega: float, loads: ComplexArray) -> ComplexArray:
    """Return the own part of (K + iωC - ω²M)⁻¹ times loads on ranks (collective), (n_own, k).

    With A = K - ω²M, B = ωC and U = x + iy it follows from real symmetric equations, as matrices of
    PETSc have one kind of numbers:

        [ A  -B ] [x]   [ Re f]
        [-B  -A ] [y] = [-Im f]

    Args:
        o: the operators.
        omega: angular frequency [rad/s].
        loads: f on the own dofs, shape (n_own, k).
    """
    M, C, K = (own_rows(matrix) for matrix in (o.mass, o.damping, o.stiffness))
    A = K - omega**2 * M
    B = omega * C
    firsts = np.array(of_ranks(o.mass, o.mass.getOwnershipRange()[0]))
    sizes = np.diff([*firsts, o.n_dofs])
    dofs = np.arange(o.n_dofs)
    real = dofs + np.repeat(firsts, sizes)  # each rank has its x, then its y
    imaginary = real + np.repeat(sizes, sizes)
    ones = np.ones(o.n_dofs)
    X, Y = (
        sp.csr_matrix((ones, (dofs, places)), shape=(o.n_dofs, 2 * o.n_dofs))
        for places in (real, imaginary)
    )
    rows = sp.vstack([A @ X - B @ Y, -B @ X - A @ Y], format="csr")
    matrix = distributed.matrix(rows, o.mass.comm.tompi4py())
    share = Share(matrix, None, 0.0)
    x, y = np.split(share.solve(np.vstack([loads.real, -loads.imag])), 2)
    share.destroy()
    matrix.destroy()
    return np.asarray(x + 1j * y)


def at_start(U: ComplexArray, frequency: float) -> FloatArray:
    """Return u, v, a of u = Im(U exp(iωt)) at t = 0, shape (3, n) [m, m/s, m/s2]."""
    omega = 2.0 * math.pi * frequency
    return np.stack([U.imag, omega * U.real, -(omega**2) * U.imag])


def slowest_decay(
    operators: Operators | DistributedOperators, *, is_floating: bool = False
) -> float:
    """Return the rate at which the slowest of the lowest modes dies out without contact [1/s].

    Ranks that share the operators find it together (collective).

    A mode with phiᵀ (M, C, K) phi = (1, 2 s, omega²) decays as e^(-s t), or as
    e^(-(s - sqrt(s² - omega²)) t) if it is overdamped. Rayleigh damping couples no modes, and the
    modes beyond the lowest `DECAYING` decay faster with it. Other damping, such as a damper inside
    the span, couples modes: the diagonal of C in modes is then its part of first order. Seven beams
    with a damper of 0.05 to 500 N s/m inside were judged rightly all the same. A strong damper acts
    as a support, whose modes the diagonal does not know; the rate is an estimate there.

    Args:
        operators: of the structure.
        is_floating: whether K is singular; modes without stiffness never die out.
    """
    o = operators
    omega, vectors = lowest(o.stiffness, o.mass, min(DECAYING, o.n_dofs), is_floating=is_floating)
    vectors = vectors[:, np.isfinite(omega)]
    mass, damping, stiffness = (
        o.total(np.einsum("ij,ij->j", vectors, times(matrix, vectors)))
        for matrix in (o.mass, o.damping, o.stiffness)
    )
    s = damping / (2.0 * mass)
    square = stiffness / mass
    rates = s - np.sqrt(np.maximum(s**2 - square, 0.0))
    return max(0.0, float(rates.min(initial=math.inf)))


def kept_closed(layout: Layout, n_dofs: int) -> sp.csr_matrix:
    """Return S of u = S u_closed for beams, with equal motion on both sides of every pair.

    The laminae share deflection and slope at each pair, and so everywhere between; they slide on
    one another without friction.

    Args:
        layout: layout with the dofs of the points of each pair.
        n_dofs: number of free dofs.

    Returns:
        Shape (n_dofs, number of dofs that are left).
    """
    tied = [np.zeros((2, 0), dtype=np.int64)]
    for interface in layout.interfaces:
        points = np.ceil(interface.places).astype(np.int64)
        both = np.stack([layout.parts[part].dofs[points].ravel() for part in interface.parts])
        tied.append(both[:, (both >= 0).all(axis=0)])
    ties = np.hstack(tied)
    graph = sp.csr_matrix((np.ones(ties.shape[1]), (ties[0], ties[1])), shape=(n_dofs, n_dofs))
    count, place = connected_components(graph, directed=False)
    return sp.csr_matrix((np.ones(n_dofs), (np.arange(n_dofs), place)), shape=(n_dofs, count))


def keeping_closed(structure: Structure) -> Any:
    """Return S of u = S u_closed for any structure, with equal motion on both sides of every pair.

    For beams see `kept_closed`. For others S spans the solutions of H u = 0; if there are many
    dofs, each row of H gives one dof through the others, so that S stays sparse. On several ranks S
    is a matrix of PETSc (collective).

    Raises:
        ValueError: there are more pairs than dofs that they can tie.
    """
    layout = structure.layout
    o = structure.operators
    H = o.gap_matrix[: sum(interface.places.size for interface in layout.interfaces)]
    if layout.reading is None:  # the rows of stops are left out, they stay open
        return kept_closed(layout, o.n_dofs)
    return tied(H, o.mass)


def tied(H: sp.csr_matrix, like: Any) -> Any:
    """Return S whose columns span the solutions of H u = 0; see `keeping_closed`.

    Args:
        H: gap matrix, columns of the own dofs, shape (n_pairs, n_own).
        like: a matrix of these dofs, of SciPy, or of PETSc on several ranks (collective).

    Raises:
        ValueError: there are more rows than dofs that they can tie.
    """
    n = n_rows(like)
    remaining = np.arange(n)
    if not H.shape[0]:
        S = sp.identity(n, format="csr")
    elif sp.issparse(like) and n <= DENSE_DOFS:
        S = sp.csr_matrix(null_space(H.toarray()))
    else:
        of_all = H if sp.issparse(like) else sp.hstack(of_ranks(like, H), format="csr")
        S, remaining = _tied_sparsely(of_all)
    if sp.issparse(like):
        return S
    first, stop = like.getOwnershipRange()
    n_own = np.count_nonzero((remaining >= first) & (remaining < stop))
    return distributed.matrix(S[first:stop], like.comm.tompi4py(), n_own)


def _tied_sparsely(H: sp.csr_matrix) -> tuple[sp.csr_matrix, IntArray]:
    """Return S with a row of the identity for each dof that remains, and the numbers of these.

    Raises:
        ValueError: there are more rows than dofs that they can tie.
    """
    n = H.shape[1]
    pivots = np.empty(H.shape[0], dtype=np.int64)
    is_free = np.ones(n, dtype=np.bool_)
    for k in range(H.shape[0]):
        row = H[k]
        free_columns = row.indices[is_free[row.indices]]
        size = np.abs(row.data[is_free[row.indices]])
        if not free_columns.size:
            raise ValueError("pairs: more of them than dofs that they can tie")
        pivots[k] = free_columns[size.argmax()]
        is_free[pivots[k]] = False
    remaining = np.flatnonzero(is_free)
    tying = np.flatnonzero(np.isin(remaining, H.indices))  # the other dofs are in no pair
    solve = regular(H[:, pivots])
    tied_rows = sp.hstack(
        [
            sp.csc_matrix(-solve(H[:, remaining[some]].toarray()))
            for some in np.split(tying, range(TIED_AT_ONCE, tying.size, TIED_AT_ONCE))
        ],
        format="coo",
    )
    rows = np.concatenate([remaining, pivots[tied_rows.row]])
    columns = np.concatenate([np.arange(remaining.size), tying[tied_rows.col]])
    values = np.concatenate([np.ones(remaining.size), tied_rows.data])
    return sp.csr_matrix((values, (rows, columns)), shape=(n, remaining.size)), remaining


def closed_by(S: Any, A: Any) -> Any:
    """Return Sᵀ A S, both of SciPy, or of PETSc on several ranks (collective)."""
    return S.T @ A @ S if sp.issparse(S) else distributed.congruent(A, S)


def _shift(K: Any, M: Any) -> float:
    """Return a shift for floating bodies, about the square of an elastic frequency [1/s2].

    A large body has no dense matrix. Its frequencies are then found with a far smaller shift.
    """
    few = min(n_rows(K), MOST_RIGID + 1)
    if sp.issparse(K) and n_rows(K) <= DENSE_DOFS:
        squares = eigh(K.toarray(), M.toarray(), eigvals_only=True)[:few]
    else:
        stiffness, mass = (summed(A, diagonal(A).sum()) for A in (K, M))
        shift = ABOVE_ROUND_OFF * float(stiffness / mass)
        squares = factored(K, M, shift).lowest(few)[0]
    return float(squares.max()) or 1.0


def largest_stable_time_step(
    operators: Recorded[Any], spring_stiffness: float | FloatArray = 0.0, courant: float = 2.0
) -> float:
    """Return Δt = Ω/ω_max of M and K, with every contact spring closed in K [s].

    Ω is `Scheme.courant`, 2 for the central difference. The step is infinite for masses without any
    stiffness. The call is collective where ranks share the dofs.

    Args:
        operators: the problem.
        spring_stiffness: stiffness of a contact spring of weight 1, or of each, shape (n_pairs,)
            [N/m].
        courant: Ω.
    """
    o = operators
    H = operators.gap_matrix
    weighted = H if o.pair_weights is None else sp.diags(o.pair_weights) @ H
    if not sp.issparse(o.mass):
        weighted = sp.hstack(of_ranks(o.mass, weighted), format="csr")
    if isinstance(spring_stiffness, np.ndarray):
        springs = H.T @ (sp.diags(spring_stiffness) @ weighted)
    else:
        springs = spring_stiffness * (H.T @ weighted)
    if sp.issparse(o.mass):
        K = sp.csc_matrix(o.stiffness + springs)
        M = sp.csc_matrix(o.mass)
        is_nothing = not K.count_nonzero()
    else:
        K = o.stiffness.copy()
        K.axpy(1.0, distributed.matrix(springs, K.comm.tompi4py()))
        M = o.mass
        is_nothing = not K.norm()
    return math.inf if is_nothing else courant / math.sqrt(largest(K, M))


def require_stable(
    operators: Recorded[Any],
    time_step: float,
    spring_stiffness: float | FloatArray = 0.0,
    courant: float = 2.0,
) -> None:
    """Raise a CaseError if a scheme would be unstable; see `largest_stable_time_step`.

    Raises:
        CaseError: the time step exceeds the largest stable one; the message names both.
    """
    limit = largest_stable_time_step(operators, spring_stiffness, courant)
    if time_step > limit:
        factor = math.ceil(time_step / limit)
        raise CaseError(
            f"time.steps_per_period: the scheme needs a time step of at most {limit:.4g} "
            f"s, given {time_step:.4g} s: use at least {factor} times as many steps per period, "
            'or time.scheme = "newmark"'
        )
