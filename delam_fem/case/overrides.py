"""Parse and apply overrides of single keys of a case, such as `lamina.thick.length=0.7`."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from datetime import date, datetime, time

from delam_fem.case.materials import MATERIALS
from delam_fem.case.toml import MOST_LEVELS, CaseError, Data, parsed, shown

_ARRAYS = ("lamina", "delamination", "point_mass", "sensor")
"""Sections of a case that are arrays of tables."""
_ALTERNATIVES = (
    ("mesh", ("elements", "file")),
    ("gap", ("exponent", "shape", "file")),
    ("excitation", ("amplitude", "acceleration")),
    ("time", ("steps_per_period", "step")),
    ("time", ("periods", "duration")),
)
"""Sections with alternative keys: an override that sets one of them removes the others."""

_NOT_PERIODIC = ("sweep", "hammer", "table")
"""Kinds of excitation that never repeat."""
_OF_PERIODS = ("window_periods", "fields_per_period")
"""Keys of the section `output` that such an excitation removes: they count periods."""
_MATERIAL_KEYS = {
    "material": ("density", "young_modulus", "mass_per_length", "bending_stiffness"),
    "density": ("material", "mass_per_length"),
    "mass_per_length": ("material", "density"),
    "young_modulus": ("material",),
}
"""What an override of a lamina's material, or of a number of it, removes."""


def parse_override(text: str) -> tuple[str, object]:
    """Split an override `key=value` from the command line.

    Args:
        text: a key with dots (`lamina.thick.length`), `=` and a TOML value. A word without quotes
            is a string; an empty value removes the key.

    Returns:
        The key and the value; None removes the key.

    Raises:
        CaseError: the text has no `=`, or no key before it.
    """
    key, equals, value = (part.strip() for part in text.partition("="))
    if not equals or not key:
        raise CaseError(
            f"override {shown(text)}: expected KEY=VALUE, for example excitation.frequency=3.65"
        )
    if key.count(".") >= MOST_LEVELS:
        raise CaseError(f"override {shown(key)}: expected at most {MOST_LEVELS} parts")
    return key, _override_value(key, value)


def _override_value(key: str, text: str) -> object:
    """Return the TOML value of a text, or the text itself if it is not a TOML value."""
    if not text:
        return None
    try:
        found = parsed(f"value = {text}", f"override {shown(key)}")
    except tomllib.TOMLDecodeError:
        return text
    value: object = found["value"]
    return text if len(found) > 1 or isinstance(value, date | datetime | time) else value


def set_key(data: Data, key: str, value: object) -> None:
    """Set one key in nested dictionaries, in place.

    Args:
        data: the case as `tomllib` returns it.
        key: path to the key, with dots; an entry of an array of tables is named by its `name`, a
            delamination by its neighbours (`lower-upper`), or by its number: laminae from 1,
            delaminations from 0.
        value: the new value; None removes the key.

    Raises:
        CaseError: a part of the path is not a table.
    """
    *parents, last = key.split(".")
    table: object = data
    if parents and parents[0] in _ARRAYS and parents[0] not in data:
        raise CaseError(
            f"override {key}: the case has no [[{parents[0]}]]; write one into a case file"
        )
    for depth, part in enumerate(parents, start=1):
        if isinstance(table, dict) and part:
            table = table.setdefault(part, {})
        elif isinstance(table, list):
            table = _entry(table, part, key, first_number(parents[depth - 2]))
        if not isinstance(table, dict | list):
            raise CaseError(f"override {key}: {'.'.join(parents[:depth])} is not a table")
    if not isinstance(table, dict) or not last:
        first = first_number(parents[-1]) if parents else 1
        names = " or ".join(f"{'.'.join(parents)}.{name}.{last}" for name in _names(table, first))
        raise CaseError(
            f"override {key}: not a key of a case" + (f"; expected {names}" * bool(names))
        )
    if value is None:
        table.pop(last, None)
    else:
        table[last] = value.item() if hasattr(value, "item") else value  # of NumPy too


def _names(table: object, first: int) -> list[str]:
    """Return the names of the entries of an array of tables; [] for anything else."""
    entries = table if isinstance(table, list) else []
    return [str(_name(entry) or i) for i, entry in enumerate(entries, start=first)]


def _name(entry: Data) -> object:
    """Return the name of an entry; a delamination has that of its neighbours, "lower-upper"."""
    between = entry.get("between")
    return "-".join(map(str, between)) if isinstance(between, list | tuple) else entry.get("name")


def first_number(array: str) -> int:
    """Return the number of the first entry of an array of tables: laminae count from 1."""
    return 0 if array == "delamination" else 1


def _entry(tables: list[Data], part: str, key: str, first: int) -> Data:
    """Return the entry of an array of tables with the name or the number `part`."""
    found = [
        table
        for number, table in enumerate(tables, start=first)
        if part in (str(number), _name(table))
    ]
    if len(found) == 1:
        return found[0]
    if found:
        raise CaseError(
            f"override {key}: {len(found)} entries {part!r}; give a number from {first}"
        )
    names = ", ".join(_names(tables, first))
    raise CaseError(
        f"override {key}: no entry {part!r}; expected one of {names or 'none'} or a number from "
        f"{first}"
    )


def apply_overrides(data: Data, overrides: Mapping[str, object]) -> None:
    """Apply overrides to a case in place; alternatives of the new keys are removed first.

    `contact.law` also takes a law with its scheme, for example `newton@moreau-jean`.

    Args:
        data: the case as `tomllib` returns it.
        overrides: values by key; see `set_key`.

    Raises:
        CaseError: a part of a key is not a table.
    """
    for section, choices in _ALTERNATIVES:
        table = data.get(section)
        if isinstance(table, dict) and any(f"{section}.{key}" in overrides for key in choices):
            has_table = section == "gap" and "gap.file" in overrides
            dropped = {*choices, "tip", "root"} if has_table else set(choices)
            for key in dropped & set(table):
                del table[key]
    table, kind = data.get("excitation"), overrides.get("excitation.kind")
    if isinstance(table, dict) and kind is not None and kind != table.get("kind"):
        groups = (("harmonic", "sweep"), ("force", "hammer"))  # kinds that mean the same amplitude
        are_alike = any(kind in group and table.get("kind") in group for group in groups)
        kept = ("amplitude", "acceleration", "lamina", "position") if are_alike else ()
        data["excitation"] = {key: table[key] for key in kept if key in table}
        output = data.get("output")
        if kind in _NOT_PERIODIC and isinstance(output, dict):  # the window is the whole run
            data["output"] = {k: v for k, v in output.items() if k not in _OF_PERIODS}
    for key, value in overrides.items():
        if key == "contact.law" and isinstance(value, str) and "@" in value:
            value, _, scheme = value.partition("@")  # a law with its scheme
            set_key(data, "time.scheme", scheme)
        if key.startswith("lamina."):
            _leave_material(data, key)
        set_key(data, key, value)


def _leave_material(data: Data, key: str) -> None:
    """Remove what a new material, density or modulus of a lamina replaces."""
    path, _, last = key.rpartition(".")
    entries, part = data.get("lamina"), path.removeprefix("lamina.")
    if not isinstance(entries, list) or last not in _MATERIAL_KEYS or "." in part:
        return
    entry = _entry(entries, part, key, first_number("lamina"))
    row = MATERIALS.get(str(entry.get("material")))
    if row is not None:
        entry.setdefault("density", row.density)
        entry.setdefault("young_modulus", row.young_modulus)
    for other in _MATERIAL_KEYS[last]:
        entry.pop(other, None)
