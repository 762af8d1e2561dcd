"""Stops that laminae strike: rows of the gap operator with one side only.

    U = g ± (s - u(x)),   + above, - below;   s = q of the base, or 0 on the ground

The gap operator knows free dofs alone. Where the base moves, the dofs are therefore changed to
w = u - r q, with any vector r for which no gap depends on q: r = 1 for stops on the base, r = 0 at
stops on the ground (S1). M, C and K stay, and the base couples by

    m_b + M r,   c_b + C r,   k_b + K r;   corners m_aa + 2 r·m_b + rᵀ M r, …                   (S2)

This is exact: the ledger counts what the base does through stops, and no law and no scheme knows of
it. `BaseCoupling.shift` and the layout's reading give u back.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy.sparse as sp

from delam_fem.case.definition import Case
from delam_fem.case.sections import EDGE_TOLERANCE, Stop
from delam_fem.model.layout import (
    DISPLACEMENT,
    Part,
    Reading,
    StopPairs,
    Structure,
    columns_of,
    interpolation_rows,
    place_of,
)
from delam_fem.model.operators import BaseCoupling
from delam_fem.numerics.types import FloatArray
from delam_fem.system.errors import CaseError

_SIDES = {"above": (1,), "below": (-1,), "both": (1, -1)}
_ROUND_OFF = 1e-9


def with_stops(structure: Structure, case: Case) -> Structure:
    """Return beams with the stops of their case, whose pairs follow those of the interfaces.

    Raises:
        CaseError: a stop is where its lamina is held, or between nodes although impulses are
            lumped.
    """
    if not case.stop:
        return structure
    o, layout = structure.operators, structure.layout
    rows, gaps = [o.gap_matrix], [o.gap0]
    weights = [np.ones(o.n_pairs) if o.pair_weights is None else o.pair_weights]
    stops: list[StopPairs] = []
    first = o.n_pairs
    for number, own in enumerate(case.stop):
        which = layout.names.index(own.lamina)
        places, shares = _places(own, layout.parts[which], number, case)
        N = interpolation_rows(layout.parts[which], places, o.n_dofs)
        if np.any(np.diff(N.indptr) == 0):
            raise CaseError(
                f"stop.{number + 1}: expected places where the lamina can move, given one where "
                f"{own.lamina} is held"
            )
        factor = 1.0 if own.stiffness is None else own.stiffness / case.spring[0] * shares
        for side in _SIDES[own.side]:
            stops.append(StopPairs(number, which, places, side, first, own.on == "base"))
            rows.append(-side * N)
            gaps.append(np.full(places.size, own.gap))
            weights.append(factor * np.ones(places.size))
            first += places.size
    both = np.concatenate(weights)
    operators = replace(
        o,
        gap_matrix=sp.vstack(rows, format="csr"),
        gap0=np.concatenate(gaps),
        pair_weights=None if np.all(both == 1.0) else both,
    )
    return replace(structure, operators=operators, layout=replace(layout, stops=tuple(stops)))


def _places(own: Stop, part: Part, number: int, case: Case) -> tuple[FloatArray, FloatArray]:
    """Return the places of the points of a stop on a part, and their shares of its stiffness."""
    if own.start is None or own.end is None:
        place = place_of(part, case.length if own.position is None else own.position)
        if place != round(place) and case.contact.impulse == "lumped" and own.stiffness is None:
            raise CaseError(
                f"stop.{number + 1}.position: expected a node of the mesh with contact.impulse = "
                f'"lumped", given {own.position} m; use contact.impulse = "consistent"'
            )
        return np.array([place]), np.ones(1)
    margin = EDGE_TOLERANCE * case.length
    inside = (part.x >= own.start - margin) & (part.x <= own.end + margin)
    inside &= part.dofs[:, DISPLACEMENT] >= 0
    nodes = np.flatnonzero(inside)
    if not nodes.size:
        raise CaseError(
            f"stop.{number + 1}: expected nodes of the mesh from start to end, given none from "
            f"{own.start:g} to {own.end:g} m; use more elements, or position"
        )
    h = np.concatenate([[0.0], np.diff(part.x), [0.0]])
    lengths = 0.5 * (h[:-1] + h[1:])[nodes]
    return nodes.astype(np.float64), lengths / lengths.sum()


def in_moving_frame(structure: Structure) -> Structure:
    """Return beams in the dofs w of S1, if stops are on a base that moves, or beside it.

    Raises:
        CaseError: no r does, because a stop on the ground and one on the base are at one place.
    """
    o, layout = structure.operators, structure.layout
    if not layout.stops or o.base.is_force:
        return structure
    n, base = o.n_dofs, o.base
    r, needed = np.zeros(n), np.zeros(o.n_pairs)  # H r = needed: then no gap depends on q
    for stop in layout.stops:
        part = layout.parts[stop.part]
        held = np.array([columns_of(part, place, n)[0, n] for place in stop.places])
        needed[stop.pairs] = -stop.side * (float(stop.on_base) - held)
    if any(stop.on_base for stop in layout.stops):
        for part in layout.parts:
            dofs = part.dofs[:, DISPLACEMENT]
            r[dofs[dofs >= 0]] = 1.0
    lacking = needed - o.gap_matrix @ r
    if np.abs(lacking).max() > _ROUND_OFF:
        r += np.linalg.lstsq(o.gap_matrix.toarray(), lacking, rcond=None)[0]
        if np.abs(needed - o.gap_matrix @ r).max() > _ROUND_OFF:
            raise CaseError(
                "stop: expected stops on the base and on the ground at different places, as the "
                "base moves"
            )
    if not r.any():
        return structure
    (m, m_aa), (c, c_aa), (k, k_aa) = (
        (column + matrix @ r, own + float(r @ (2.0 * column + matrix @ r)))
        for matrix, column, own in zip(
            (o.mass, o.damping, o.stiffness),
            (base.mass, base.damping, base.stiffness),
            base.corner,
            strict=True,
        )
    )
    part_of = np.zeros(n, dtype=np.int64)
    for number, part in enumerate(layout.parts):
        part_of[part.own_dofs] = number
    shifted = BaseCoupling(m, c, k, corner=(m_aa, c_aa, k_aa), shift=r)
    reading = Reading(sp.identity(n, format="csr"), r, part_of)
    return replace(
        structure,
        operators=replace(o, base=shifted),
        layout=replace(layout, reading=reading),
    )
