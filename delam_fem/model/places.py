"""Places on the surfaces of plates: where forces act, sensors read, and reference points are.

A place beside the middle line of a lamina, or on its surface, has a reading of its own, behind
those of the points of all parts (`Layout.places`). A reduced model keeps them, so that a case that
is computed with it may name the same places again.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import scipy.sparse as sp

from delam_fem.case.definition import Case
from delam_fem.case.excitation import parts_of
from delam_fem.case.sections import Impactor, Stop, x_of, z_of
from delam_fem.case.surface_scan import scan_points
from delam_fem.model.layout import Layout, Place, columns_of, place_of

_SIDES = {"middle": 0, "top": 1, "bottom": -1}
_OF_STRIKERS = {"above": 1, "below": -1}


def spot(names: Sequence[str], entry: Any) -> Place | None:
    """Return the place beside the middle line at which an entry of a case acts; None: on that line.

    A stop above a lamina strikes its top, one below it its bottom.

    Args:
        names: names of the laminae.
        entry: a drive, mass, sensor, stop, impactor, spring or initial state.
    """
    position = getattr(entry, "position", None)
    surface = getattr(entry, "surface", None)
    is_strain = getattr(entry, "quantity", None) == "strain"
    is_pair = isinstance(position, tuple)
    if position is None or is_strain or not (is_pair or surface in ("top", "bottom")):
        return None
    side = _SIDES[surface or "middle"]
    if isinstance(entry, Stop | Impactor):
        side = _OF_STRIKERS.get(entry.side, 0)
    return Place(names.index(entry.lamina), x_of(position), z_of(position), side)


def places_of_case(case: Case) -> tuple[Place, ...]:
    """Return all places of a case that have readings of their own, reference points first."""
    return tuple(dict.fromkeys([*_references(case), *_named(case), *scanned_places(case)]))


def scanned_places(case: Case) -> tuple[Place, ...]:
    """Return the places of the scan of a plate, in the order of its points; none without a scan."""
    if case.scan is None:
        return ()
    name = case.scan.lamina or case.outer_lamina.name
    lamina = [lamina.name for lamina in case.lamina].index(name)
    outer = "top" if lamina == len(case.lamina) - 1 else "bottom" if lamina == 0 else "middle"
    side = _SIDES[case.scan.surface or outer]
    return tuple(Place(lamina, x, z, side) for x, z in scan_points(case).tolist())


def _named(case: Case) -> Iterator[Place]:
    """Yield the places that tables name."""
    names = [lamina.name for lamina in case.lamina]
    entries: list[Any] = [*parts_of(case.excitation), *case.masses, *case.sensor]
    entries += [support for support in case.support.at_points if support.kind == "spring"]
    entries += case.initial
    forces = [side for load in case.load if load.force is not None for side, _ in load.sides]
    for entry in (*entries, *case.stop, *case.impactor, *forces):
        place = spot(names, entry)
        if place is not None:
            yield place


def _references(case: Case) -> Iterator[Place]:
    """Yield the reference points of a plate on each lamina, and the middles of all patches."""
    if not case.is_plate:
        return
    x, z = case.reference_point
    yield from (Place(lamina, x, z, 0) for lamina in range(len(case.lamina)))
    names = [lamina.name for lamina in case.lamina]
    for patch in case.delamination:
        yield from (Place(names.index(name), *patch.middle, 0) for name in patch.between)


def row_at(layout: Layout, entry: Any, n_dofs: int, length: float = 0.0) -> sp.csr_matrix:
    """Return the row that reads the deflection where an entry of a case acts.

    Args:
        layout: of the structure.
        entry: a drive, mass, sensor, spring or initial state.
        n_dofs: number of its free dofs.
        length: x where the entry names no position [m].

    Returns:
        Shape (1, n_numbered + 1), with a column of the base.

    Raises:
        CaseError: a reduced model has no reading there.
    """
    place = spot(layout.names, entry)
    if place is not None:
        return layout.row_of(place)
    part = layout.parts[layout.names.index(entry.lamina)]
    x = length if entry.position is None else x_of(entry.position)
    return columns_of(part, place_of(part, x), layout.n_numbered(n_dofs))
