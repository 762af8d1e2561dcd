"""Give the pairs of a structure the numbers that their contacts have of their own.

A contact is an interface, one of its delaminations, a stop or an impactor. Its table in the case
may have restitution, stiffness, damping and threshold velocity in place of those of `[contact]`.
Stiffnesses are multiples of that of one spring (`Case.spring`): they become weights of the pairs.
The rest becomes `PairNumbers`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from delam_fem.case.definition import ROUND_OFF, Case
from delam_fem.case.sections import EDGE_TOLERANCE, Delamination, OwnContact
from delam_fem.case.unread import is_elastic
from delam_fem.contact.decisions import PairNumbers
from delam_fem.model.layout import Layout, Structure
from delam_fem.numerics.types import BoolArray, FloatArray, IntArray


class Stretch(NamedTuple):
    """A contact between two neighbouring laminae, and where it is.

    Attributes:
        key: "gap", "delamination.1", ….
        table: its table in the case.
        start: where it begins [m].
        end: where it ends [m].
    """

    key: str
    table: OwnContact
    start: float
    end: float

    def inside(self, x: FloatArray, z: FloatArray | None = None) -> BoolArray:
        """Return which of some places belong to the contact, the shape of x.

        Args:
            x: places [m].
            z: places across the width, the shape of x [m]; None: its middle.
        """
        if isinstance(self.table, Delamination) and self.table.across is not None:
            return self.table.contains(x, np.zeros_like(x) if z is None else z)
        margin = EDGE_TOLERANCE * self.end
        return np.asarray((x >= self.start - margin) & (x <= self.end + margin))


def stretches(case: Case, between: tuple[str, ...]) -> Iterator[Stretch]:
    """Yield the contacts between two neighbouring laminae; where they are bonded there is none."""
    if case.gap is not None:
        yield Stretch("gap", case.gap, 0.0, case.length)
    for number, delamination in enumerate(case.delamination, start=1):
        if delamination.between == between:
            key = f"delamination.{number}"
            yield Stretch(key, delamination, delamination.start, delamination.end)


def tables_of(case: Case, name: str) -> list[OwnContact]:
    """Return the tables of a contact by its name in results: "lower-upper", "stop 1", …."""
    kind, _, number = name.partition(" ")
    if number:
        return [table for key, table in case.contacts if key == f"{kind}.{number}"]
    neighbours = pairwise(lamina.name for lamina in case.lamina)
    between = [pair for pair in neighbours if "-".join(pair) == name]
    return [stretch.table for pair in between for stretch in stretches(case, pair)]


def pairs_of_contacts(layout: Layout, case: Case) -> Iterator[tuple[str, OwnContact, IntArray]]:
    """Yield key, table and pairs of each contact of a case; a stop on both sides comes twice."""
    for interface in layout.interfaces:
        pairs = np.arange(interface.pairs.start, interface.pairs.stop)
        at = layout.positions_of(interface)
        for stretch in stretches(case, tuple(layout.names[part] for part in interface.parts)):
            yield stretch.key, stretch.table, pairs[stretch.inside(*at)]
    tables = dict(case.contacts)
    for stop in layout.stops:
        number = stop.number - len(case.stop)
        key = f"stop.{stop.number + 1}" if number < 0 else f"impactor.{number + 1}"
        yield key, tables[key], np.arange(stop.pairs.start, stop.pairs.stop)


def damping_at(case: Case, between: tuple[str, ...], x: FloatArray) -> FloatArray:
    """Return the damping of springs of weight 1 between two neighbours, shape of x [N s/m]."""
    k, c = case.spring
    result = np.full(x.shape, c if case.contact.law == "penalty" else 0.0)
    for stretch in stretches(case, between):
        table = stretch.table
        if table.stiffness is not None and is_elastic(case, table):
            result[stretch.inside(x)] = k * table.damping / table.stiffness
    return result


def with_pair_numbers(structure: Structure, case: Case) -> Structure:
    """Return a structure whose pairs have the numbers and stiffnesses of their contacts.

    Args:
        structure: the structure with all its pairs; the weights of those of stops and impactors
            have their stiffnesses already.
        case: its case.
    """
    o = structure.operators
    n = o.n_pairs
    shares = np.ones(n) if o.pair_weights is None else o.pair_weights
    weights = shares.copy()
    elastic = np.zeros(n, dtype=np.bool_)
    restitution, relaxation, threshold = np.full((3, n), np.nan)
    k, c = case.spring
    for key, entry, pairs in pairs_of_contacts(structure.layout, case):
        if entry.stiffness is not None and key.startswith(("gap", "delamination")):
            weights[pairs] *= entry.stiffness / k
        if entry.restitution is not None:
            restitution[pairs] = entry.restitution
        if entry.threshold_velocity is not None:
            threshold[pairs] = entry.threshold_velocity
        elastic[pairs] = entry.elastic_by is not None
        if entry.has_stiffness:
            ratio = entry.damping / (entry.stiffness or np.inf)
            is_same = abs(ratio - c / k) <= ROUND_OFF * max(ratio, c / k)
            relaxation[pairs] = np.nan if is_same else ratio
    numbers = PairNumbers(elastic, restitution, relaxation, threshold, shares)
    has_numbers = elastic.any() or not np.isnan([restitution, relaxation, threshold]).all()
    is_weighted = bool((weights != shares).any())
    if not (has_numbers or is_weighted):
        return structure
    operators = replace(
        o,
        pair_weights=weights if is_weighted else o.pair_weights,
        pair_numbers=numbers if has_numbers else None,
    )
    return replace(structure, operators=operators)
