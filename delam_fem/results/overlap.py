"""Warn where laminae overlap because the contact springs of a case are too soft."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from delam_fem.case.definition import Case
from delam_fem.case.sections import Lamina
from delam_fem.model.contacts import tables_of
from delam_fem.results.diagnostics import ProbeMotion, gap_field
from delam_fem.results.schema import by_interface

if TYPE_CHECKING:
    import xarray as xr

SHARE = 0.1
"""Share of a gap or of a thickness by which laminae may overlap before a penalty is too soft."""
MARGIN = 2.0
"""Factor above the stiffness at which a spring that takes the same energy yields just so much."""


@dataclass(frozen=True)
class Overlap:
    """What overlaps, and by how much.

    Attributes:
        what: in words.
        depth: largest overlap in the window of the run; negative: none [m].
        limit: overlap up to which a penalty is stiff enough [m]; infinite: none is known.
    """

    what: str
    depth: float
    limit: float


def overlap_warnings(history: xr.Dataset, case: Case) -> list[str]:
    """Return a warning if springs of `contact.penalty_stiffness` yield too much; [] otherwise.

    A spring that takes an energy E yields by d = sqrt(2 E / k), so that k (d/d1)^2 leaves d1.
    Contacts with a stiffness of their own, which are meant to yield, are left out.

    Args:
        history: dataset of the run.
        case: its case.
    """
    if case.contact.law != "penalty":
        return []
    overlaps = [*_of_laminae(history, case), *_of_stops(history, case)]
    worst = max(overlaps, key=lambda overlap: overlap.depth / overlap.limit, default=None)
    if worst is None or not worst.depth > worst.limit:
        return []
    k = case.contact.penalty_stiffness
    enough = _rounded_up(MARGIN * k * (worst.depth / worst.limit) ** 2)
    stiffer = f"{enough:g} N/m with steps that resolve its blows, or " if k else ""
    return [
        f"contact.penalty_stiffness = {k:g} N/m lets {worst.what} overlap by "
        f"{1e3 * worst.depth:.3g} mm, above {1e3 * worst.limit:.3g} mm, a tenth of the gap or of "
        f"the thickness; try {stiffer}a rigid law, contact.law = newton@moreau-jean"
    ]


def _of_laminae(history: xr.Dataset, case: Case) -> Iterator[Overlap]:
    """Yield the overlap of each two neighbours: of nodes at frames, of the probes at each step."""
    at_frames = gap_field(history)
    at_steps = ProbeMotion.of(history).gaps
    at_rest = by_interface(history["gap0"])
    for k, (lower, upper) in enumerate(pairwise(case.lamina)):
        tables = tables_of(case, f"{lower.name}-{upper.name}")
        if tables and all(table.stiffness is not None for table in tables):
            continue
        smallest = min(
            np.nanmin(at_frames[k], initial=math.inf), np.nanmin(at_steps[k], initial=math.inf)
        )
        limit = _limit(float(np.nanmax(at_rest[k], initial=0.0)), lower, upper)
        yield Overlap(f"laminae {lower.name} and {upper.name}", -float(smallest), limit)


def _of_stops(history: xr.Dataset, case: Case) -> Iterator[Overlap]:
    """Yield the overlap of each contact point of a stop without a stiffness of its own."""
    if "stop_number" not in history:
        return
    base = np.interp(history["frame"], history["time"], history["base_displacement"])
    names = ("stop_number", "stop_lamina", "stop_node", "stop_height", "stop_on_base")
    columns = (history[name].to_numpy().tolist() for name in names)
    for number, part, node, height, is_on_base in zip(*columns, strict=True):
        if number > len(case.stop) or case.stop[number - 1].stiffness is not None:
            continue
        lamina = case.lamina[part]
        above = history["displacement"].to_numpy()[part, :, node] - is_on_base * base - height
        depth = float(np.max(math.copysign(1.0, height) * above, initial=-math.inf))
        what = f"lamina {lamina.name} and stop.{number}"
        yield Overlap(what, depth, _limit(abs(height), lamina))


def _limit(gap: float, *laminae: Lamina) -> float:
    """Return the overlap up to which a penalty is stiff enough [m]; a point has no thickness."""
    sizes = [gap, *(lamina.mean("thickness") for lamina in laminae if not lamina.is_point)]
    return SHARE * min((size for size in sizes if size > 0.0), default=math.inf)


def _rounded_up(value: float) -> float:
    """Return the next larger number with one digit."""
    unit = 10.0 ** math.floor(math.log10(value)) if value else 1.0
    return math.ceil(value / unit) * unit
