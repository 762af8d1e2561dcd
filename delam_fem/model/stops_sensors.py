"""Add to a structure what a case has besides: stops, impactors, the initial state, and sensors.

A stop or an impactor that a lamina strikes adds rows to the gap operator:

    U = g ± (s - u(x)),   + above, - below;   s = q of the base, 0 on the ground, or the
                                              displacement of an impactor, a dof behind all others

The gap operator knows free dofs alone. Where the base moves, the dofs are therefore changed to
w = u - r q, with any vector r for which no gap depends on q: r = 1 for stops on the base, r = 0 at
stops on the ground (S1). M, C and K stay, and the base couples by

    m_b + M r,   c_b + C r,   k_b + K r;   corners m_aa + 2 r·m_b + rᵀ M r, …                   (S2)

This is exact: the ledger counts what the base does through stops, and no law and no scheme knows of
the change. `BaseCoupling.shift` and the layout's reading give u back. In modes r begins as
-K⁻¹ k_b, the static shape in which the structure follows the base; in solids it is a translation.

Hertz's contact of a ball of radius R, F = k δ^(3/2) with k = 4/3 E √R / (1 - ν²), is the sum of
springs at increasing gaps, whose force is the chord through that curve at

    δ_i = δ (i/n)^(4/3),   i = 0, …, n,   δ = (5 m v² / 4 k)^(2/5)                            (S3)

where δ is the depth that stops the ball on a rigid wall. F is then too large by at most 0.167 / n²
of its largest value.

Sensors are linear functionals of the state, of the base and of the contact forces. With r the row
that evaluates a deflection at the place of the sensor, a signal is

    displacement   r u + r_b q          velocity   r v + r_b q'
    acceleration   the mean change of that velocity over a step, see `simulation/signals.py`
    strain         a functional of u; see `StrainRows`
    contact force  Σ λ_k of the pairs of an interface

λ_k are the forces of springs, and the impulses of a step over the time step: their mean force.

`simulation/signals.py` puts the signals together.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import scipy.sparse as sp

from delam_fem.case.definition import Case
from delam_fem.case.excitation import drive
from delam_fem.case.gap import opening_at_rest
from delam_fem.case.sections import (
    EDGE_TOLERANCE,
    Impactor,
    Initial,
    Sensor,
    Stop,
    place_words,
    x_of,
    z_of,
)
from delam_fem.model.contacts import with_pair_numbers
from delam_fem.model.factors import factored
from delam_fem.model.layout import (
    CURVATURE,
    DISPLACEMENT,
    Layout,
    Reading,
    SensorRows,
    StopPairs,
    Structure,
    cells_at,
    columns_of,
    half_ways,
    interpolation_rows,
    place_of,
    selection,
)
from delam_fem.model.linear import mode_of, n_rigid
from delam_fem.model.loads import loaded
from delam_fem.model.operators import (
    BaseCoupling,
    DistributedOperators,
    Recorded,
    bordered,
    n_rows,
    of_ranks,
    restricted,
    times,
)
from delam_fem.model.places import row_at, spot
from delam_fem.numerics.types import FloatArray
from delam_fem.system.errors import CaseError, require

UP = 1
"""Column of `Operators.near_null` of a solid that is the translation along deflections."""
_SIDES = {"above": (1,), "below": (-1,), "both": (1, -1)}
_ROUND_OFF = 1e-9
_Added = tuple[StopPairs, sp.csr_matrix, FloatArray, "FloatArray | float"]
"""The pairs of a stop: where they are, their rows, gaps at rest and weights."""
N_HERTZ = 16
"""n of S3: an error of 7e-4 of the largest force."""


def struck(structure: Structure, case: Case) -> Structure:
    """Return a structure with the stops, initial state, impactors and constant loads of its case.

    Args:
        structure: beams, their modes, or solids, with the drive of the case.
        case: the case.

    Raises:
        CaseError: one of them is at a place where it cannot be, or something begins inside
            something else.
    """
    complete = in_moving_frame(with_impactors(with_start(with_stops(structure, case), case), case))
    complete = with_pair_numbers(complete, case)
    complete = loaded(complete, case)
    overlap = overlap_at_start(complete, case)
    if overlap is not None and case.contact.law != "penalty":
        raise CaseError(overlap)
    return complete


def overlap_at_start(structure: Structure, case: Case) -> str | None:
    """Return what is wrong with an initial state in which one thing is inside another.

    Springs can push them apart, rigid contact cannot. Beside the law "penalty", pairs of elastic
    contacts therefore do not count.

    Args:
        structure: the structure of the case.
        case: the case.

    Returns:
        The pair that overlaps most, and by how much; None if no gap is closed at t = 0, or if
        there is no contact.
    """
    o, layout = structure.operators, structure.layout
    start = o.start
    if start is None or case.contact.law == "none" or not o.n_pairs:
        return None
    q = float(drive(case.excitation).states(np.zeros(1))[0, 0])
    place = start[0] if o.base.shift is None else start[0] - q * o.base.shift
    gap = o.total(o.gap_matrix @ place) + o.gap0
    if o.equilibrium is not None and case.begins_at_rest:  # springs that carry a weight are closed
        gap -= np.minimum(o.total(o.gap_matrix @ o.equilibrium.displacement) + o.gap0, 0.0)
    if o.pair_numbers is not None and case.contact.law != "penalty":
        gap[o.pair_numbers.is_elastic] = np.inf
    pair = int(gap.argmin())
    largest = max(of_ranks(o.mass, float(np.abs(start[0]).max(initial=0.0))))
    if gap[pair] >= -_ROUND_OFF * largest:
        return None
    return (
        f"initial: expected displacements that leave all gaps open, given pair {pair + 1} "
        f"({_words(layout, case, pair)}) closed by {-gap[pair]:.4g} m; take a smaller "
        'initial.1.displacement, a larger gap, or contact.law = "none"'
    )


def _words(layout: Layout, case: Case, pair: int) -> str:
    """Return what a pair is between, and where."""
    for interface in layout.interfaces:
        if interface.pairs.start <= pair < interface.pairs.stop:
            lower, upper = (layout.names[part] for part in interface.parts)
            x, z = (at[pair - interface.first_pair] for at in layout.positions_of(interface))
            across = "" if interface.at is None else f", z = {z:.4g} m"
            return f"{lower} and {upper} at x = {x:.4g} m{across}"
    stop = next(stop for stop in layout.stops if stop.pairs.start <= pair < stop.pairs.stop)
    number = stop.number - len(case.stop)
    other = f"stop {stop.number + 1}" if number < 0 else f"impactor {number + 1}"
    x = layout.parts[stop.part].positions(stop.places)[pair - stop.first_pair]
    return f"{layout.names[stop.part]} and {other} at x = {x:.4g} m"


def striking_rows(structure: Structure, case: Case) -> sp.csr_matrix:
    """Return rows that read the deflections at all stops and impactors, shape (k, n)."""
    rows = (
        _places(entry, structure, f"{section}.{number}", case)[2]
        for section in ("stop", "impactor")
        for number, entry in enumerate(getattr(case, section), start=1)
    )
    return sp.vstack([sp.csr_matrix((0, structure.operators.n_own)), *rows], format="csr")


def with_stops(structure: Structure, case: Case) -> Structure:
    """Return a structure with the stops of its case, whose pairs follow those of the interfaces.

    Raises:
        CaseError: a stop is where its lamina is held, or between nodes although impulses are
            lumped.
    """
    if not case.stop:
        return structure
    added: list[_Added] = []
    for number, stop in enumerate(case.stop):
        which, places, N, shares = _places(stop, structure, f"stop.{number + 1}", case)
        factor = 1.0 if stop.stiffness is None else stop.stiffness / case.spring[0] * shares
        at = structure.layout.parts[which].positions(places)
        gap = stop.gap + opening_at_rest(stop, at, case.length)
        place = spot(structure.layout.names, stop)
        for side in _SIDES[stop.side]:
            pairs = StopPairs(number, which, places, side, 0, stop.on == "base", place)
            added.append((pairs, -side * N, gap, factor))
    return _with_pairs(structure, added)


def with_impactors(structure: Structure, case: Case) -> Structure:
    """Return a structure with the impactors of its case, each a dof and pairs behind all others.

    Raises:
        CaseError: see `with_stops`, or an impactor begins inside its lamina.
    """
    if not case.impactor:
        return structure
    structure = _with_dofs(structure, case)
    o = structure.operators
    added: list[_Added] = []
    start = np.zeros((2, o.n_own)) if o.start is None else o.start
    own_dofs = o.last_dofs(len(case.impactor))
    for k, impactor in enumerate(case.impactor):
        which, places, N, _ = _places(impactor, structure, f"impactor.{k + 1}", case)
        side = _SIDES[impactor.side][0]
        inside = side * float(o.total(N @ start[0])[0]) - impactor.gap
        if inside > _ROUND_OFF * impactor.gap:
            raise CaseError(
                f"impactor.{k + 1}.gap: expected a start outside lamina {impactor.lamina}, given "
                f"{impactor.gap:g} m, {inside:.3g} m inside as the lamina starts"
            )
        dof = own_dofs[k : k + 1]
        of_impactor = sp.csr_matrix((np.ones(len(dof)), (np.zeros(len(dof)), dof)), shape=N.shape)
        row = side * (of_impactor - N)
        stiffness, depths = _contact(impactor, case, which)
        n = depths.size
        factor = 1.0 if stiffness is None else stiffness / case.spring[0]
        stop = StopPairs(len(case.stop) + k, which, np.repeat(places, n), side, 0, on_base=False)
        added.append((stop, sp.vstack([row] * n), impactor.gap + depths, factor))
    return _with_pairs(structure, added)


def _with_pairs(structure: Structure, added: Sequence[_Added]) -> Structure:
    """Return a structure with the pairs of stops behind all others."""
    o, layout = structure.operators, structure.layout
    stops, rows, gaps, factors = zip(*added, strict=True)
    firsts = o.n_pairs + np.cumsum([0, *(gap.size for gap in gaps)])
    weights = np.concatenate([
        np.ones(o.n_pairs) if o.pair_weights is None else o.pair_weights,
        *(factor * np.ones(gap.size) for factor, gap in zip(factors, gaps, strict=True)),
    ])  # fmt: skip
    operators = replace(
        o,
        gap_matrix=sp.vstack([o.gap_matrix, *rows], format="csr"),
        gap0=np.concatenate([o.gap0, *gaps]),
        pair_weights=None if np.all(weights == 1.0) else weights,
    )
    numbered = [
        replace(stop, first_pair=first) for stop, first in zip(stops, firsts.tolist(), strict=False)
    ]
    layout = replace(layout, stops=(*layout.stops, *numbered))
    return replace(structure, operators=operators, layout=layout)


def _with_dofs(structure: Structure, case: Case) -> Structure:
    """Return a structure with a dof for each impactor, behind all others, and its start.

    On several ranks the last one has them (collective).
    """
    o = structure.operators
    base = structure.operators.base
    count = len(case.impactor)
    m, k, c, on_base = np.array(
        [[i.mass, i.spring, i.spring_damping, i.on == "base"] for i in case.impactor], dtype=float
    ).T
    m_aa, c_aa, k_aa = base.corner
    carried = np.zeros(count) if base.is_force else on_base
    corner = (m_aa, c_aa + float(carried @ c), k_aa + float(carried @ k))
    speeds = np.array([-_SIDES[i.side][0] * i.velocity for i in case.impactor])
    first = o.n_dofs
    is_here = len(o.last_dofs(count)) > 0
    if not is_here:
        m, k, c, carried, speeds = (values[:0] for values in (m, k, c, carried, speeds))
    own_count = m.size
    start = np.zeros((2, o.n_own + own_count))
    if o.start is not None:
        start[:, : o.n_own] = o.start
    start[1, o.n_own :] = speeds

    def wider(rows: sp.csr_matrix) -> sp.csr_matrix:
        return sp.hstack([rows, sp.csr_matrix((rows.shape[0], own_count))], format="csr")

    def beside(values: Any, others: Any) -> Any:
        return None if values is None else np.append(values, others)

    near_null = None if o.near_null is None else np.pad(o.near_null, ((0, own_count), (0, 0)))
    further: dict[str, Any] = {}
    if isinstance(o, DistributedOperators):
        numbers = np.arange(own_count)
        bodies = np.zeros(o.n_own, dtype=np.int64) if o.body is None else o.body
        n_bodies = 1 + max(o.comm.allgather(int(bodies.max(initial=0))))
        further = {
            "order": beside(o.order, first + numbers),
            "body": np.append(bodies, n_bodies + numbers),
        }
    operators = replace(
        o,
        mass=bordered(o.mass, m, count),
        damping=bordered(o.damping, c, count),
        stiffness=bordered(o.stiffness, k, count, near_null),
        lumped_mass=beside(o.lumped_mass, m),
        rayleigh=None,
        near_null=near_null,
        load=beside(o.load, np.zeros(own_count)),
        base=replace(
            base,
            mass=np.append(base.mass, np.zeros(own_count)),
            damping=np.append(base.damping, -carried * c),
            stiffness=np.append(base.stiffness, -carried * k),
            corner=corner,
        ),
        gap_matrix=wider(o.gap_matrix),
        probes=wider(o.probes),
        sensors=None,
        start=start,
        **further,
    )
    layout = replace(structure.layout, n_impactors=count)
    body = structure.body
    if reading := layout.reading:
        layout = replace(
            layout,
            reading=replace(
                reading,
                matrix=wider(reading.matrix),
                part=np.append(reading.part, np.full(own_count, -1)),
            ),
        )
    return Structure(operators, layout, body and replace(body, free=wider(body.free)))


def _contact(own: Impactor, case: Case, which: int) -> tuple[FloatArray | float | None, FloatArray]:
    """Return stiffnesses [N/m] of the springs of an impactor's contact, and their depths [m].

    The stiffness of a rigid contact is None.
    """
    if own.radius is None:
        return own.stiffness, np.zeros(1)
    lamina = case.lamina[which]
    if lamina.orthotropic is not None:
        raise CaseError(
            f"impactor.radius: expected stiffness in its place on lamina {lamina.name}, because "
            "Hertz's contact is that of isotropic bodies"
        )
    of_all = case.model.poisson
    x = np.array([case.position_of(own)])
    modulus = float(lamina.along("young_modulus", x)[0])
    E = modulus / (1.0 - (lamina.poisson if of_all is None else of_all) ** 2)
    k = 4.0 / 3.0 * E * np.sqrt(own.radius)
    deepest = (1.25 * own.mass * own.velocity**2 / k) ** 0.4
    depth = deepest * (np.arange(N_HERTZ + 1) / N_HERTZ) ** (4.0 / 3.0)
    slopes = np.diff(k * depth**1.5) / np.diff(depth)
    return np.diff(slopes, prepend=0.0), depth[:-1]


def _places(
    own: Stop | Impactor, structure: Structure, key: str, case: Case
) -> tuple[int, FloatArray, sp.csr_matrix, FloatArray]:
    """Return the part that strikes, its places, rows that read their deflections, and shares.

    The rows take the free dofs; the shares are those of the places in the stiffness of a stop.

    Raises:
        CaseError: a stop is where its lamina is held, or between nodes although impulses are
            lumped.
    """
    layout = structure.layout
    which = layout.names.index(own.lamina)
    part = layout.parts[which]
    shares = np.ones(1)
    if isinstance(own, Impactor) or own.start is None or own.end is None:
        place = place_of(part, case.position_of(own))
        if place != round(place) and case.has_lumped_impulses:
            raise CaseError(
                f"{key}.position: expected a node of the mesh with contact.impulse = "
                f'"lumped", given {own.position} m; use contact.impulse = "consistent"'
            )
        places = np.array([place])
    else:
        margin = EDGE_TOLERANCE * case.length
        inside = (part.x >= own.start - margin) & (part.x <= own.end + margin)
        inside &= part.dofs[:, DISPLACEMENT] >= 0
        nodes = np.flatnonzero(inside)
        if not nodes.size:
            raise CaseError(
                f"{key}: expected nodes of the mesh from start to end, given none from "
                f"{own.start:g} to {own.end:g} m; use more elements, or position"
            )
        lengths = half_ways(part.x)[nodes]
        places = nodes.astype(np.float64)
        shares = lengths / lengths.sum()
    numbered = layout.n_numbered(structure.operators.n_dofs)
    at = spot(layout.names, own)
    if at is not None:
        N = layout.of_dofs(layout.row_of(at)[:, :numbered])
    else:
        N = layout.of_dofs(interpolation_rows(part, places, numbered))
    if np.any(structure.operators.total(np.diff(N.indptr)) == 0):
        raise CaseError(
            f"{key}: expected places where the lamina can move, given one where {own.lamina} is "
            "held"
        )
    return which, places, N, shares


def in_moving_frame(structure: Structure) -> Structure:
    """Return a structure in dofs relative to its base (w of S1), if it has stops and a moving base.

    Raises:
        CaseError: there is no r, because a stop on the ground and one on the base are at one place.
    """
    o, layout = structure.operators, structure.layout
    if not layout.stops or o.base.is_force:
        return structure
    n = o.n_own
    base = o.base
    numbered = layout.n_numbered(o.n_dofs)
    r = np.zeros(n)
    needed = np.zeros(o.n_pairs)  # H r = needed: then no gap depends on q
    for stop in layout.stops:
        part = layout.parts[stop.part]
        row = (
            columns_of(part, stop.places, numbered)
            if stop.spot is None
            else layout.row_of(stop.spot)
        )
        base_share = layout.of_dofs(row)[:, n].toarray().ravel()  # known to all ranks
        needed[stop.pairs] = -stop.side * (float(stop.on_base) - base_share)
    if any(stop.on_base for stop in layout.stops):
        if structure.body is not None:
            assert o.near_null is not None
            r[:] = o.near_null[:, UP]
        elif layout.reading is not None:
            stiffness = o.stiffness.diagonal()
            np.divide(-base.stiffness, stiffness, out=r, where=stiffness > 0.0)
        for part in layout.parts if layout.reading is None else ():
            dofs = part.dofs[:, DISPLACEMENT]
            r[dofs[dofs >= 0]] = 1.0
        r[o.last_dofs(layout.n_impactors)] = 1.0
    lacking = needed - o.total(o.gap_matrix @ r)
    if np.abs(lacking).max() > _ROUND_OFF:
        r += _least_change(o, lacking, is_sparse=structure.body is not None)
        # least squares always give an r; it serves only if it fulfils all rows
        if np.abs(needed - o.total(o.gap_matrix @ r)).max() > _ROUND_OFF:
            raise CaseError(
                "stop: expected stops on the base and on the ground at different places, as the "
                "base moves"
            )
    if not o.total(np.array([float(r.any())]))[0]:
        return structure
    columns = []
    corners = []
    for matrix, column, corner in zip(
        (o.mass, o.damping, o.stiffness),
        (base.mass, base.damping, base.stiffness),
        base.corner,
        strict=True,
    ):
        image = times(matrix, r)
        columns.append(column + image)
        corners.append(corner + float(o.total(np.array(r @ (2.0 * column + image)))))
    m, c, k = columns
    m_aa, c_aa, k_aa = corners
    shifted = BaseCoupling(m, c, k, corner=(m_aa, c_aa, k_aa), shift=r)
    reading = layout.reading
    if reading is None:
        part_of = np.full(n, -1, dtype=np.int64)
        for number, part in enumerate(layout.parts):
            part_of[part.own_dofs] = number
        reading = Reading(sp.identity(n, format="csr"), np.zeros(n), part_of)
    reading = replace(reading, base=reading.base + o.total(reading.matrix @ r))
    body = structure.body
    return Structure(
        replace(o, base=shifted),
        replace(layout, reading=reading),
        body and replace(body, base=body.base + o.total(body.free @ r)),
    )


def _least_change(o: Recorded[Any], lacking: FloatArray, *, is_sparse: bool) -> FloatArray:
    """Return the smallest Δr with H Δr as near to what is lacking as can be (collective).

    Args:
        o: the operators.
        lacking: shape (n_pairs,) [-].
        is_sparse: whether H has too many columns for a dense matrix; Δr = Hᵀ y then follows from
            H Hᵀ y.
    """
    H = o.gap_matrix
    if not is_sparse:
        return np.asarray(np.linalg.lstsq(H.toarray(), lacking, rcond=None)[0])
    gram = o.total((H @ H.T).toarray())
    return np.asarray(H.T @ np.linalg.lstsq(gram, lacking, rcond=None)[0])


def with_start(structure: Structure, case: Case) -> Structure:
    """Return a structure with the initial state of its case, before its dofs are shifted.

    Modes have an initial state already, from the beams that were reduced.

    Raises:
        CaseError: a shape of the initial state does not exist.
    """
    if not case.initial or structure.operators.start is not None:
        return structure
    start = np.zeros((2, structure.operators.n_own))
    for number, entry in enumerate(case.initial, start=1):
        size = np.array([[entry.displacement], [entry.velocity]])
        start += size * _shape(structure, case, entry, f"initial.{number}")
    return replace(structure, operators=replace(structure.operators, start=start))


def _shape(structure: Structure, case: Case, own: Initial, key: str) -> FloatArray:
    """Return the shape of an initial state, whose largest deflection at a node is 1, (n_own,)."""
    o, layout, body = structure.operators, structure.layout, structure.body
    numbers = [k for k, part in enumerate(layout.parts) if own.lamina in (None, part.name)]
    parts = [layout.parts[k] for k in numbers]
    numbered = layout.n_numbered(o.n_dofs)
    deflections = np.unique(np.concatenate([part.dofs[:, DISPLACEMENT] for part in parts]))
    read = layout.of_dofs(selection(deflections[deflections >= 0], numbered))
    if body is None:
        dofs = np.unique(np.concatenate([part.own_dofs for part in parts]))
    else:
        dofs = body.moving(case, numbers)
    shape = np.zeros(o.n_own)
    if body is None:
        shape[read.indices] = 1.0
    else:
        assert o.near_null is not None
        shape[dofs] = o.near_null[dofs, UP]
    if own.shape == "uniform":
        return shape
    K = restricted(o.stiffness, dofs)
    if own.shape == "mode":
        require(own.mode <= n_rows(K), f"{key}.mode", f"at most {n_rows(K)}", own.mode)
        shape[dofs] = mode_of(K, restricted(o.mass, dofs), own.mode, shape[dofs])
    else:
        assert own.position is not None
        if n_rigid(K):
            raise CaseError(
                f'{key}.shape: expected "uniform" or "mode" of laminae that are not held, given '
                '"force", under which they would not stay'
            )
        load = layout.of_dofs(row_at(layout, own, o.n_dofs)).toarray()[0, dofs]
        factor = factored(K)
        shape[dofs] = factor.solve(load)
    own_share = body.raised(shape, numbers) if body and case.is_plate else read @ shape
    deflection = o.total(own_share)
    size = np.abs(deflection)
    # the first of several that are equal but for round-off gives the sign
    largest = float(deflection[np.argmax(size >= (1.0 - _ROUND_OFF) * size.max())])
    if not largest:
        raise CaseError(
            f"{key}.position: expected a point that can move, given {place_words(own.position)}"
        )
    return np.asarray(shape / largest)


StrainRows = Callable[[int, float, float, float], sp.csr_matrix]
"""Function (number of the lamina, place as a number of points, side: 1 top, -1 bottom, z [m]) ->
strain of the surface as a row in free dofs and base, shape (1, n + 1)."""


def with_sensors(structure: Structure, case: Case, strain: StrainRows | None = None) -> Structure:
    """Return the structure with the sensors of its case, and the gaps that are recorded.

    Gaps of all pairs are recorded where a sensor reads contact forces, otherwise those of stops and
    impactors.

    Args:
        structure: the structure of the case, with its drive.
        case: the case.
        strain: strains of surfaces; None: those of laminae that are apart, -s h/2 w'' with s = 1
            at the top, at a point between two cells the mean of both.
    """
    o, layout = structure.operators, structure.layout
    if not (case.sensor or layout.stops):
        return structure
    if strain is None:
        strain = _of_single_laminae(case, layout, o.n_dofs)
    rows = [np.zeros(o.n_own) for _ in range(layout.n_impactors)]
    for row, dof in zip(rows, o.last_dofs(layout.n_impactors), strict=False):
        row[dof] = 1.0
    sensors = tuple(
        replace(
            _sensor(sensor, case, structure, strain, rows), unit=sensor.unit, words=sensor.words
        )
        for sensor in case.sensor
    )
    blocks = [sp.csr_matrix(np.array(rows).reshape(len(rows), o.gap_matrix.shape[1]))]
    needs_all = any(sensor.of_forces is not None for sensor in sensors)
    first = 0 if needs_all else layout.stops[0].first_pair if layout.stops else o.n_pairs
    gap_row = len(rows) if first < o.n_pairs else None
    return replace(
        structure,
        operators=replace(o, sensors=sp.vstack([*blocks, o.gap_matrix[first:]], format="csr")),
        layout=replace(layout, sensors=sensors, gap_row=gap_row, first_gap=first),
    )


def _sensor(
    own: Sensor, case: Case, structure: Structure, strain: StrainRows, rows: list[FloatArray]
) -> SensorRows:
    """Return what a sensor reads; append its functionals to `rows`."""
    o, layout = structure.operators, structure.layout
    if own.quantity == "contact force":
        of_pairs = np.zeros(o.n_pairs)
        number = own.stop or (own.impactor and len(case.stop) + own.impactor)
        for stop in layout.stops:
            if stop.number + 1 == number:
                of_pairs[stop.pairs] = 1.0
        for interface in layout.interfaces:
            if tuple(layout.names[part] for part in interface.parts) == own.between:
                of_pairs[interface.pairs] = 1.0
        return SensorRows(own.name, None, None, of_forces=of_pairs)
    assert own.lamina is not None and own.position is not None  # all but contact forces
    number = layout.names.index(own.lamina)
    part = layout.parts[number]
    if own.quantity == "strain":
        place = place_of(part, x_of(own.position))
        row = strain(number, place, -1.0 if own.surface == "bottom" else 1.0, z_of(own.position))
    else:
        row = layout.of_dofs(row_at(layout, own, o.n_dofs))
    of_dofs = row.toarray()[0, :-1]
    of_base = 0.0 if o.base.is_force else float(row[0, -1])
    rows.append(of_dofs)
    if own.quantity in ("velocity", "acceleration"):
        is_rate = own.quantity == "acceleration"
        return SensorRows(own.name, None, len(rows) - 1, (0.0, of_base), is_rate=is_rate)
    return SensorRows(own.name, len(rows) - 1, None, (of_base, 0.0))


def _of_single_laminae(case: Case, layout: Layout, n: int) -> StrainRows:
    """Return the strains of laminae that bend about their own middles."""
    numbered = layout.n_numbered(n)

    def rows(lamina: int, place: float, side: float, _: float) -> sp.csr_matrix:
        part = layout.parts[lamina]
        cells = cells_at(part, place)
        bends = [columns_of(part, place, numbered, CURVATURE, cell) for cell in cells]
        if case.lamina[lamina].is_uniform:
            mean = layout.of_dofs(sum(bends) / len(cells))
            return sp.csr_matrix(-0.5 * side * case.lamina[lamina].mean("thickness") * mean)
        x = np.repeat(part.positions(np.array([place])), len(cells))
        inside = np.array([0.5 * (part.x[cell] + part.x[cell + 1]) for cell in cells])
        thickness = case.lamina[lamina].along("thickness", x, inside)
        mean = sum(h * bend for h, bend in zip(thickness, bends, strict=True)) / len(cells)
        return sp.csr_matrix(-0.5 * side * layout.of_dofs(mean))

    return rows
