"""Read measurements from universal files (UFF): sets 58 and 58b with units and positions.

pyuff reads the sets; what it stumbles over in real files is put right before, byte by byte.
"""

from __future__ import annotations

import tempfile
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

from delam_fem.case.toml import CaseError
from delam_fem.results.measured.blocks import Block, blocks_of, cleaned
from delam_fem.results.measured.columns import Column, Sheet

FUNCTIONS = {0: "signal", 1: "signal", 4: "response", 6: "coherence"}
"""Functions of a set 58 that are read: general or time response, frequency response, coherence."""
UNKNOWN, TIME, FREQUENCY = 0, 17, 18
"""Types of an abscissa."""
QUANTITIES = {8: "displacement", 11: "velocity", 12: "acceleration", 13: "force", 9: "force",
              3: "strain", 17: "time", 18: "frequency"}  # fmt: skip
"""Quantities by the type of data."""
FACTORS = {"displacement": "length", "velocity": "length", "acceleration": "length",
           "force": "force", "strain": ""}  # fmt: skip
"""Which factor of set 164 makes a quantity SI: values are divided by it."""
RATIOS = {"displacement": "receptance", "velocity": "mobility", "acceleration": "accelerance"}
"""Quantities of frequency responses to a force."""
RESPONSE = 4
SETS = ("15", "58", "58b", "164", "2411")
"""Sets that are given to pyuff; others are left out."""
NOTHING = ("", "NONE")


def read(path: Path) -> list[Sheet]:
    """Read the functions of a universal file.

    Args:
        path: of the file.

    Returns:
        A sheet for each set 58 that holds a history, a frequency response or a coherence.

    Raises:
        CaseError: the file has no such set, or a damaged one.
    """
    blocks = [block for block in blocks_of(path) if block.kind in SETS]
    sets = [_parsed(block, path) for block in blocks]
    factors = next((own for own in sets if own["type"] == 164), {"length": None, "force": None})
    places: dict[int, float] = {}
    for own in sets:
        if own["type"] in (15, 2411):
            numbers = own.get("node_nums", own.get("grid_global", []))
            length = factors["length"] or 1.0
            places |= {int(n): float(x) / length for n, x in zip(numbers, own["x"], strict=False)}
    functions = [
        (block, own)
        for block, own in zip(blocks, sets, strict=True)
        if own["type"] == 58
        and own["func_type"] in FUNCTIONS
        and own["abscissa_spec_data_type"] in (UNKNOWN, TIME, FREQUENCY)
    ]
    if not functions:
        held = ", ".join(block.kind for block in blocks_of(path)) or "none"
        raise CaseError(
            f"{path}: expected a universal file with sets 58 that hold histories or frequency "
            f"responses, found the sets {held[:80]}"
        )
    names = _names([own for _, own in functions])
    return [
        _sheet(path, block, own, (name, factors, places))
        for (block, own), name in zip(functions, names, strict=True)
    ]


def _parsed(block: Block, path: Path) -> dict[str, Any]:
    """Return what pyuff makes of a set, whose bytes are put right first."""
    import pyuff

    with tempfile.TemporaryDirectory(prefix="delam-fem-") as folder:
        temporary = Path(folder) / "set.uff"
        with temporary.open("wb") as file:
            file.write(cleaned(block))
        try:
            found = pyuff.UFF(str(temporary)).read_sets()
        except Exception as error:  # pyuff raises bare exceptions
            raise CaseError(
                f"{path}: set {block.number} (type {block.kind}) cannot be read ({error})"
            ) from None
    if not isinstance(found, dict) or "type" not in found:
        raise CaseError(f"{path}: set {block.number} (type {block.kind}) cannot be read")
    return found


def _names(functions: list[dict[str, Any]]) -> list[str]:
    """Return the name of each set: the first of id1, entity, node that tells all sets apart."""

    def unique(key: str) -> list[str] | None:
        texts = [f"{own['func_type']}|{str(own.get(key, '')).strip()}" for own in functions]
        bare = [text.partition("|")[2] for text in texts]
        is_told = max(Counter(texts).values()) == 1 and not set(bare) & set(NOTHING)
        return bare if is_told else None

    by_node = [f"node{own['rsp_node']} {_direction(own['rsp_dir'])}".strip() for own in functions]
    return unique("id1") or unique("rsp_ent_name") or by_node


def _direction(number: int) -> str:
    """Return the direction of a response, such as +z; empty for none."""
    return f"{'-' if number < 0 else '+'}{'xyz'[abs(number) - 1]}" if 1 <= abs(number) <= 3 else ""


def _sheet(path: Path, block: Block, own: dict[str, Any], about: tuple[Any, ...]) -> Sheet:
    """Return the sheet of a set: its abscissa and its values."""
    name, factors, places = about
    kind = FUNCTIONS[own["func_type"]]
    abscissa = own["abscissa_spec_data_type"]
    is_time = abscissa == TIME or (kind == "signal" and abscissa != FREQUENCY)
    n = min(own["num_pts"], own["data"].size, own["x"].size)
    if n < own["num_pts"] or n < 2:
        raise CaseError(
            f"{path}: set {block.number} has {n} of {own['num_pts']} values; the file is cut off"
        )
    unit, quantity, scale = ("1", "", 1.0) if kind == "coherence" else _unit(own, factors)
    x = own["abscissa_min"] + own["abscissa_inc"] * np.arange(n)
    axis = Column(
        "time" if is_time else "frequency",
        x if own["abscissa_spacing"] else own["x"][:n],
        "s" if is_time else "Hz",
    )
    place = places.get(int(own["rsp_node"]))
    values = own["data"][:n] * scale
    column = Column(name, values, unit, quantity, place, kind=kind)
    label = f"{path}, set {block.number}"
    return Sheet(label, (axis, column), notes=block.notes, alias=f"set{block.number}")


def _unit(own: dict[str, Any], factors: dict[str, Any]) -> tuple[str | None, str, float]:
    """Return unit (None: not named), quantity (empty: not known), factor to that unit.

    The unit's label in the set comes first, then the factors of set 164, by which values are
    divided to be SI.
    """
    above = QUANTITIES.get(own["ordinate_spec_data_type"], "")
    below = QUANTITIES.get(own["orddenom_spec_data_type"], "")
    quantity = RATIOS.get(above, "") if below == "force" else "" if below else above
    unit = str(own.get("ordinate_axis_units_lab", "")).strip()
    divisor = str(own.get("orddenom_axis_units_lab", "")).strip()
    if unit.upper() not in NOTHING:
        is_ratio = own["func_type"] == RESPONSE and divisor.upper() not in NOTHING
        return (f"({unit})/({divisor})" if is_ratio else unit), quantity, 1.0
    if factors["length"] is None or not above:
        return None, quantity, 1.0
    scale = 1.0
    for name, sign in ((above, -1), (below, 1)):
        if factor := FACTORS.get(name, ""):
            scale *= float(factors[factor]) ** sign
    return "SI", quantity, scale
