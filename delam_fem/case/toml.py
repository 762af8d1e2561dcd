"""Read and write TOML as plain dictionaries, with overrides of single keys and readable messages.

This module does not know what a case contains; `sections.py` and `definition.py` define that.
"""

from __future__ import annotations

import json
import math
import re
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from copy import deepcopy
from datetime import date, datetime, time
from pathlib import Path
from typing import TypeAlias, TypeGuard

from pydantic import ValidationError
from pydantic_core import ErrorDetails

from delam_fem.case.materials import MATERIALS, ORTHOTROPIC
from delam_fem.system.errors import CaseError
from delam_fem.system.footprint import bounded

Data: TypeAlias = dict[str, object]
"""A case as tomllib returns it: tables are dictionaries, arrays are lists."""

MOST_LEVELS = 16
"""Deepest nesting of tables and arrays; a case has three levels."""
MOST_BYTES = 16_000_000
"""Largest TOML file; a sweep with a million listed values is smaller."""
MOST_PROBLEMS = 8
"""Number of problems that a message lists."""
_MOST_SHOWN = 200
"""Length of the longest line of which a message shows words."""
_LONG_KEY = re.compile(r"""(?<![\w"'-])(?:[\w"'-]++[ \t]*+\.[ \t]*+){64}""")
"""A key of so many levels that to parse it would take long."""
_BARE_KEY = re.compile(r"[\w-]+", re.ASCII)
"""Pattern of a key that TOML accepts without quotes."""

_UNION_TAGS = (
    "number", "profile", "plan", "harmonic", "sweep", "force", "hammer", "table", "random",
    "multisine", "burst", "record", "none", "several", "each",
)  # fmt: skip
"""Names that pydantic inserts into the path of an error although the case file has no such
level."""


def read_toml(path: Path) -> Data:
    """Read a TOML file.

    Args:
        path: the file.

    Returns:
        The tables of the file as dictionaries.

    Raises:
        CaseError: the file is missing, unreadable or not TOML (the message names the line).
    """
    label = f"case file {path}"
    try:
        if not path.exists():
            raise CaseError(f"{label}: no such file")
        if not path.is_file():
            raise CaseError(f"{label}: expected a file, given a folder or a device")
        if path.stat().st_size > MOST_BYTES:
            raise CaseError(f"{label}: expected at most {MOST_BYTES} bytes")
        text = path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise CaseError(f"{label}: cannot be read ({error.strerror})") from None
    except UnicodeDecodeError as error:
        raise CaseError(f"{label}: expected UTF-8 text ({error})") from None
    try:
        with bounded(path, label):
            return parsed(text, label)
    except tomllib.TOMLDecodeError as error:
        raise CaseError(f"{label}: not valid TOML: {error}{_remedy(text, str(error))}") from None


def _remedy(text: str, error: str) -> str:
    """Return what may be wrong in the line that an error of TOML names; "" if that is not seen."""
    place = re.search(r"at line (\d+)", error)
    line = text.splitlines()[int(place[1]) - 1] if place else ""
    if len(line) > _MOST_SHOWN:
        return ""
    name = line.partition("#")[0].strip().strip("[]").strip()
    headings = {text_line.partition("#")[0].strip() for text_line in text.splitlines()}
    if {f"[{name}]", f"[[{name}]]"} <= headings:
        return f"; [{name}] and [[{name}]] exclude one another: write [[{name}]] for each"
    word = re.match(r"\s*([\w.-]+)\s*=\s*([A-Za-z][\w@/-]*)\s*(#.*)?$", line)
    if word:
        return f'; a text stands in quotes: {word[1]} = "{word[2]}"'
    comma = re.match(r"\s*([\w.-]+)\s*=\s*([+-]?\d+),(\d+)", line)
    return f"; a number has a decimal point: {comma[1]} = {comma[2]}.{comma[3]}" if comma else ""


def parsed(text: str, label: str) -> Data:
    """Return the tables of a TOML text, with bounds on its nesting and its whole numbers.

    Args:
        text: the text.
        label: name of the text in messages.

    Raises:
        TOMLDecodeError: the text is not TOML.
        CaseError: its tables or arrays are nested too deeply, or a whole number has more than 64
            bits.
    """
    too_deep = f"{label}: expected at most {MOST_LEVELS} levels of tables and arrays"
    too_long = f"{label}: expected whole numbers of at most 64 bits"
    if _LONG_KEY.search(text):
        raise CaseError(too_deep)
    try:
        data = tomllib.loads(text)
    except RecursionError:
        raise CaseError(too_deep) from None
    except tomllib.TOMLDecodeError:
        raise
    except ValueError:  # Python converts only so many digits
        raise CaseError(too_long) from None
    level: list[object] = [data]
    for _ in range(MOST_LEVELS):
        inner: list[object] = []
        for value in level:
            if isinstance(value, int) and not -(2**63) <= value < 2**63:
                raise CaseError(too_long)
            if isinstance(value, Mapping):
                inner.extend(value.values())
            elif isinstance(value, list):
                inner.extend(value)
        level = inner
    if level:
        raise CaseError(too_deep)
    return data


def toml_text(data: Mapping[str, object]) -> str:
    """Return nested dictionaries as TOML, with floats that read back exactly.

    Args:
        data: scalars, lists of scalars, tables (dictionaries) and arrays of tables (lists of
            dictionaries).

    Returns:
        The TOML text; `tomllib.loads` gives `data` back.
    """
    blocks = [_key_lines(data, is_top=True)]
    for key, value in data.items():
        if isinstance(value, Mapping):
            blocks.append(f"[{key}]\n{_key_lines(value)}")
        elif _is_tables(value):
            blocks += [f"[[{key}]]\n{_key_lines(table)}" for table in value]
    return "\n".join(blocks)


def _is_tables(value: object) -> TypeGuard[Sequence[Mapping[str, object]]]:
    """Return whether a value is an array of tables, not an array of scalars."""
    return isinstance(value, list | tuple) and any(isinstance(v, Mapping) for v in value)


def _key_lines(table: Mapping[str, object], *, is_top: bool = False) -> str:
    """Return the lines `key = value` of a table; tables in it are inline, at the top left out."""
    return "".join(
        f"{key if _BARE_KEY.fullmatch(key) else json.dumps(key)} = {toml_value(value)}\n"
        for key, value in table.items()
        if not (isinstance(value, Mapping) and is_top) and not _is_tables(value)
    )


def toml_value(value: object) -> str:
    """Return a scalar, a list of scalars, or an inline table as TOML writes it."""
    if isinstance(value, Mapping):
        entries = (f"{key} = {toml_value(entry)}" for key, entry in value.items())
        return f"{{ {', '.join(entries)} }}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(toml_value(entry) for entry in value)}]"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        return repr(float(value))  # the shortest text that reads back as the same double
    if isinstance(value, int):
        return repr(int(value))
    # JSON and TOML have the same escapes, except for DEL
    return json.dumps(str(value), ensure_ascii=False).replace("\x7f", "\\u007f")


def message(label: str, error: ValidationError, data: Mapping[str, object]) -> str:
    """Return a readable message for a validation error of pydantic.

    Args:
        label: name of the input, e.g. `case paper`.
        error: the error that pydantic raised.
        data: the input that pydantic refused.

    Returns:
        One line, or a heading with one line for each problem.
    """
    lines = [_problem(details, data) for details in error.errors(include_url=False)]
    if len(lines) == 1:
        return f"{label}: {lines[0]}"
    listed = [f"  {line}" for line in lines[:MOST_PROBLEMS]]
    listed += ["  …"] * (len(lines) > MOST_PROBLEMS)
    return f"{label}: {len(lines)} problems\n" + "\n".join(listed)


def _problem(details: ErrorDetails, data: Mapping[str, object]) -> str:
    """Return one problem in the form `key: expected …, given …`."""
    path = list(_path(details["loc"], data))
    context = details.get("ctx", {})
    kind = details["type"]
    text = details["msg"]
    suffix = f", given {shown(details['input'])}"
    if "key" in context:
        path = [*path, str(context["key"])]
        suffix = ""
    if kind == "missing":
        text, suffix = "missing, but required", ""
    elif kind == "literal_error":
        text = f"expected {context['expected']}"
    elif kind == "union_tag_not_found":
        path = [*path, "kind"]
        text = "missing, but required"
        suffix = ""
    elif kind == "union_tag_invalid":
        path = [*path, "kind"]
        suffix = f", given {context['tag']!r}"
        text = f"expected {context['expected_tags']}".removesuffix(", 'several'")
    elif kind in ("model_type", "model_attributes_type", "dict_type"):
        text = "expected a table"
    elif kind == "inconsistent":
        suffix = ""
    return f"{'.'.join(path)}: {text}{suffix}" if path else f"{text}{suffix}"


def _path(place: tuple[int | str, ...], data: Mapping[str, object]) -> Iterator[str]:
    """Yield the levels of a key in the notation of overrides."""
    tables: object = data
    for part in place:
        if part in _UNION_TAGS and part not in data:  # a sweep has a section `record`
            continue
        if part == "placed":  # tables of [[support]]
            continue
        if isinstance(part, int):
            entry = tables[part] if isinstance(tables, list | tuple) else {}
            name = entry.get("name") if isinstance(entry, Mapping) else None
            yield name if isinstance(name, str) and name else str(part + 1)
        else:
            tables = data.get(part)
            yield part


def shown(value: object) -> str:
    """Return an input as the user wrote it, shortened to 60 characters."""
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    if isinstance(value, int) and abs(value) > 10**60:
        return "a number of more than 60 digits"  # Python may refuse to write it
    text = str(value) if isinstance(value, Path) else repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


_ARRAYS = ("lamina", "delamination", "point_mass", "stop", "impactor", "initial", "sensor")
"""Sections of a case that are arrays of tables."""
_ALTERNATIVES = (
    ("mesh", ("elements", "file")),
    ("gap", ("exponent", "shape", "file")),
    ("excitation", ("amplitude", "acceleration", "rms", "psd")),
    ("time", ("steps_per_period", "step")),
    ("time", ("periods", "duration")),
    ("scan", ("spacing", "file", "points")),
)
"""Sections with alternative keys: an override that sets one of them removes the others."""

_NOT_PERIODIC = ("sweep", "hammer", "table", "random", "burst", "record", "none")
"""Kinds of excitation that never repeat."""
_ALIKE = (
    "amplitude", "acceleration", "lamina", "position", "acts_on", "in", "low", "high", "rms", "psd",
    "seed", "duration",
)  # fmt: skip
"""Keys of an excitation that stay where another kind means the same by them."""
_OF_PERIODS = ("window_periods", "fields_per_period")
"""Keys of the section `output` that such an excitation removes: they count periods."""
_MATERIAL_KEYS = {
    "material": ("density", "young_modulus", "mass_per_length", "bending_stiffness"),
    "density": ("material", "mass_per_length"),
    "mass_per_length": ("material", "density"),
    "young_modulus": ("material", "angle", "plies"),
    "angle": ("plies",),
    "plies": ("angle",),
}
"""Keys of a lamina that an override of its material, or of a number of the material, removes."""


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
    if not value:
        return key, None
    try:
        table = parsed(f"value = {value}", f"override {shown(key)}")
    except tomllib.TOMLDecodeError:
        return key, value
    is_word = len(table) > 1 or isinstance(table["value"], date | datetime | time)
    return key, value if is_word else table["value"]


LISTS = ("x", "value", "across", "position")
"""Keys whose values may be lists of numbers, each of which has a key: of a table over x, the edges
of a patch across a plate, and places [x, z]."""


def set_key(data: Data, key: str, value: object) -> None:
    """Set one key in nested dictionaries, in place.

    Args:
        data: the case as `tomllib` returns it.
        key: path to the key, with dots; an entry of an array of tables is named by its `name`, a
            delamination by its neighbours (`lower-upper`), or by its number, which counts from 1.
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
            table = _entry(table, part, key)
        if not isinstance(table, dict | list):
            raise CaseError(f"override {key}: {'.'.join(parents[:depth])} is not a table")
    if parents == ["support"] and isinstance(table, list):  # its own keys are those of the ends
        ends = [entry for entry in table if not {"position", "side"} & set(entry)] or [{}]
        table[:] = [*table, *(end for end in ends if end not in table)]
        table = ends[0]
    if isinstance(table, list) and parents[-1] in LISTS and last.isdigit():
        _set_number(table, int(last), value, key)
        return
    if not isinstance(table, dict) or not last:
        names = " or ".join(f"{'.'.join(parents)}.{name}.{last}" for name in _names(table))
        raise CaseError(
            f"override {key}: not a key of a case" + (f"; expected {names}" * bool(names))
        )
    if value is None:
        table.pop(last, None)
    else:
        table[last] = value.item() if hasattr(value, "item") else value  # of NumPy too


def _set_number(numbers: list[object], place: int, value: object, key: str) -> None:
    """Set a number of a list by its place, which counts from 1, in place of the list.

    Raises:
        CaseError: the list has no such place.
    """
    if not 1 <= place <= len(numbers) or value is None:
        raise CaseError(f"override {key}: expected a number, at a place from 1 to {len(numbers)}")
    numbers[place - 1] = value.item() if hasattr(value, "item") else value


def _names(table: object) -> list[str]:
    """Return the names of the entries of an array of tables; [] for anything else."""
    entries = table if isinstance(table, list) else []
    return [str(_name(entry) or i) for i, entry in enumerate(entries, start=1)]


def _name(entry: Data) -> object:
    """Return the name of an entry; a delamination has that of its neighbours, "lower-upper"."""
    name = entry.get("name")
    between = entry.get("between")
    return "-".join(map(str, between)) if name is None and isinstance(between, list) else name


def _entry(tables: list[Data], part: str, key: str) -> Data:
    """Return the entry of an array of tables with the name or the number `part`."""
    matches = [
        table for number, table in enumerate(tables, start=1) if part in (str(number), _name(table))
    ]
    if len(matches) == 1:
        return matches[0]
    if matches:
        raise CaseError(f"override {key}: {len(matches)} entries {part!r}; give a number from 1")
    raise CaseError(
        f"override {key}: no entry {part!r}; expected one of {', '.join(_names(tables)) or 'none'} "
        "or a number from 1"
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
            dropped |= {"unit"} if "mesh.elements" in overrides and section == "mesh" else set()
            dropped |= {"across"} if "mesh.file" in overrides and section == "mesh" else set()
            for key in dropped & set(table):
                del table[key]
    table = data.get("excitation")
    kind = overrides.get("excitation.kind")
    if isinstance(table, dict) and kind is not None and kind != table.get("kind"):
        groups = (("harmonic", "sweep"), ("force", "hammer"), ("random", "burst"))
        are_alike = any(kind in group and table.get("kind") in group for group in groups)
        keys = _ALIKE if are_alike else ()  # kinds that mean the same by them
        data["excitation"] = {key: table[key] for key in keys if key in table}
        output = data.get("output")
        if kind in _NOT_PERIODIC and isinstance(output, dict):  # the window is the whole run
            data["output"] = {k: v for k, v in output.items() if k not in _OF_PERIODS}
    for key, value in overrides.items():
        table = data.get("time")
        if key == "contact.law" and "@" in str(value) and isinstance(table, dict):
            table.pop("scheme", None)  # the law brings its own
        if key.startswith("lamina."):
            _leave_material(data, key, value)
        set_key(data, key, deepcopy(value))  # tables of the caller stay as they are


def _leave_material(data: Data, key: str, value: object) -> None:
    """Remove what a new material, density, modulus or angle of a lamina replaces."""
    path, _, last = key.rpartition(".")
    entries = data.get("lamina")
    part = path.removeprefix("lamina.")
    if not isinstance(entries, list) or last not in _MATERIAL_KEYS or "." in part:
        return
    entry = _entry(entries, part, key)
    removed = set(_MATERIAL_KEYS[last])
    name = str(entry.get("material"))
    if last not in ("angle", "plies"):
        for number, size in MATERIALS.get(name, {}).items():
            entry.setdefault(number, size)
    if last in ("density", "mass_per_length") and name not in MATERIALS:
        removed -= {"material"}  # an orthotropic one keeps its moduli
        if name in ORTHOTROPIC:
            entry["material"] = ORTHOTROPIC[name][0].model_dump()
    if last == "material" and str(value) in MATERIALS:
        removed |= {"angle", "plies"}
    for other in removed:
        entry.pop(other, None)
