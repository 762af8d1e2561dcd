"""Write a commented case file: a preset's values, and every other key beside them as a comment."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator, Mapping
from textwrap import wrap
from types import MappingProxyType
from typing import Any, Literal, get_args

from delam_fem.case.files import preset_text
from delam_fem.case.keys.reference import Key, Table, tables
from delam_fem.case.toml import Data, toml_value

KindName = Literal["apart", "paper", "layered", "edge"]
KINDS: tuple[KindName, ...] = get_args(KindName)

_PRESETS: Mapping[KindName, tuple[str, str]] = MappingProxyType(
    {
        "apart": ("default", "Two laminae, clamped together at one end and apart elsewhere."),
        "paper": ("paper", "Two laminae as in the paper, with its literal contact law."),
        "layered": ("embedded", "A bonded beam with a delamination in its middle."),
        "edge": ("edge", "A bonded cantilever with a delamination that reaches its free end."),
    }
)
"""Preset that each kind of case begins with, and what it is."""

COLUMN, WIDTH = 32, 100
"""Column at which comments begin, and width of a line."""


def case_text(kind: KindName, name: str) -> str:
    """Return a commented case file.

    The values are those of a preset. A key that the preset does not set stands there as a comment
    with its default, and so do tables that it does not have.

    Args:
        kind: what the case is like.
        name: name of the case.
    """
    of, words = _PRESETS[kind]
    data = tomllib.loads(preset_text(of)) | {"name": name}
    lines = [
        f"# {words}",
        f"#   delam-fem validate {name}.toml    checks this file",
        f"#   delam-fem run {name}.toml         computes it",
        "#",
        '# Numbers are in SI units; a text may carry another unit, as in "2 mm". A key behind # is',
        "# not set; its default stands after it.",
    ]
    for table in tables():
        lines += ["", *_table_lines(table, data)]
    return "\n".join(lines) + "\n"


def _table_lines(table: Table, data: Data) -> Iterator[str]:
    """Yield the lines of a table: with values if the case has it, otherwise all as a comment."""
    if not table.name:
        yield from _key_lines(table, data)
        return
    found: Any = data.get(table.name)
    entries = found if isinstance(found, list) else [found]
    is_absent = entries == [None] or entries[0].get("kind", "") != table.kind
    is_other = is_absent and table.kind
    instead = f'{table.heading} of kind "{table.kind}" instead: ' if is_other else ""
    yield from (f"# {line}" for line in _wrapped(instead + table.meaning, WIDTH - 2))
    if is_absent:
        if not instead:
            yield f"# {table.heading}"
        yield from _key_lines(table, {}, is_active=False)
        return
    yield table.heading
    yield from _key_lines(table, entries[0])
    for entry in entries[1:]:  # the comments stand beside the first
        yield from ("", table.heading)
        yield from (f"{key} = {toml_value(value)}" for key, value in entry.items())


def _key_lines(table: Table, given: Mapping[str, Any], *, is_active: bool = True) -> Iterator[str]:
    """Yield a line for each key of a table, with its comment, and further lines of the comment."""
    for key in table.keys:
        default = table.kind if key.name == "kind" else key.default
        if key.name in given:
            line = f"{key.name} = {toml_value(given[key.name])}"
        else:
            line = f"# {key.name} = " + ("" if default is None else toml_value(default))
        is_needed = key.is_required and (key.name in given or not is_active)
        first, *others = _wrapped(_comment(key, is_needed), WIDTH - COLUMN - 2)
        yield f"{line:<{COLUMN - 1}} # {first}"
        yield from (f"{'#' if line.startswith('#') else '':<{COLUMN}}# {text}" for text in others)


def _wrapped(text: str, width: int) -> list[str]:
    return wrap(text, width, break_on_hyphens=False)


def _comment(key: Key, is_needed: bool) -> str:
    """Return what stands beside a key: meaning, type, and whether it must be given."""
    notes = [] if key.choices and all(word in key.meaning for word in key.choices) else [key.type]
    if is_needed:
        notes.append("required")
    elif key.default is not None:
        notes.append(f"default {toml_value(key.default)}")
    return key.meaning.removesuffix(".") + (f" ({'; '.join(notes)})" if notes else "")
