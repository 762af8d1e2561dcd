"""List all keys of a case file: as a reference, as a JSON schema, as a commented template.

The models of `sections.py` and its neighbours are the only source: types and defaults are those of
their fields, units and meanings those of the `Attributes` in their docstrings.

With the JSON schema editors check and complete a case file. It is a little more lenient than the
models: what several keys must fulfil together is checked when a case is read.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache, partial
from textwrap import wrap
from types import MappingProxyType, UnionType
from typing import Annotated, Any, Literal, TypeAlias, Union, get_args, get_origin

from pydantic.json_schema import GenerateJsonSchema
from pydantic_core import PydanticUndefined, core_schema

from delam_fem.case.definition import Case
from delam_fem.case.files import preset_text
from delam_fem.case.materials import Orthotropic
from delam_fem.case.sections import Profile
from delam_fem.case.toml import Data, toml_value
from delam_fem.case.values import Expected, Section
from delam_fem.system.docstrings import meanings, summary

_UNIT = re.compile(r"\[([^\[\]]++)\]")
_PLAIN = {str: "text", float: "a number", int: "a whole number", bool: "true or false"}


@dataclass(frozen=True)
class Key:
    """One key of a table.

    Attributes:
        name: the key.
        type: what it takes, in words: "a positive number".
        choices: the words that it takes; () if it takes others.
        unit: "m", "kg/m3", …; "-" of a pure number; "" of what is no number.
        is_required: whether it must be given.
        default: its value where it is not given; None: none.
        meaning: what it is, with its unit in brackets as in "length of a lamina [m]".
    """

    name: str
    type: str
    choices: tuple[str, ...]
    unit: str
    is_required: bool
    default: Any
    meaning: str

    @property
    def has_unit(self) -> bool:
        """Whether it is a number with a unit."""
        return self.unit not in ("", "-")


@dataclass(frozen=True)
class KeyTable:
    """A table of a case file with its keys.

    Attributes:
        name: "gap" for `[gap]`; "" for the keys before the first table.
        kind: value of the key `kind` of an excitation; "" of other tables.
        is_array: whether it is written `[[name]]` and may be repeated.
        meaning: what it is, in a sentence.
        keys: its keys in the order of the model.
        model: the model that checks it.
    """

    name: str
    kind: str
    is_array: bool
    meaning: str
    keys: tuple[Key, ...]
    model: type[Section]

    @property
    def heading(self) -> str:
        """The heading in a case file: `[gap]`, `[[lamina]]`; "" for the first keys."""
        return f"[[{self.name}]]" if self.is_array else f"[{self.name}]" if self.name else ""


@cache
def tables() -> tuple[KeyTable, ...]:
    """Return all tables of a case file in their order; the first has the keys before any table."""
    fields = Case.model_fields
    below = {name: _models(field.annotation) for name, field in fields.items()}
    all_tables = [_table(Case, "", [name for name, models in below.items() if not models])]
    for name, models in below.items():
        for model in models:
            inner = {key: _models(f.annotation) for key, f in model.model_fields.items()}
            keys = [*(key for key in inner if not inner[key]), *model.also_written]
            all_tables.append(
                _table(
                    model,
                    name,
                    sorted(keys, key=lambda key: key != "kind"),
                    is_array=_is_array(fields[name].annotation),
                )
            )
            all_tables += [  # such tables have the same name
                _table(inner_model, name, [*inner_model.model_fields], is_array=True)
                for models_of in inner.values()
                for inner_model in models_of
            ]
    return tuple(all_tables)


def _table(model: type[Section], name: str, keys: list[str], *, is_array: bool = False) -> KeyTable:
    """Return a table with some keys of its model."""
    kind = model.model_fields.get("kind")
    default = "" if kind is None or kind.is_required() else kind.default
    table_keys = tuple(_key(model, key, meanings(model)) for key in keys)
    return KeyTable(name, default, is_array, summary(model), table_keys, model)


def _key(model: type[Section], name: str, meanings: dict[str, str]) -> Key:
    """Return a key of a model; one that is only written is a positive number."""
    meaning = meanings.get(name, "")
    unit_match = _UNIT.search(meaning)
    if name not in model.model_fields:
        return Key(
            name,
            "a positive number",
            (),
            unit_match[1] if unit_match else "-",
            False,
            None,
            meaning,
        )
    field = model.model_fields[name]
    annotation: Any = field.annotation
    words = next((m.words for m in field.metadata if isinstance(m, Expected)), "")
    is_required = field.is_required() or name == "kind"  # the kind says which table it is
    default = None if is_required or field.default is PydanticUndefined else field.default
    parts = [*_parts(annotation)]
    unit = (unit_match[1] if unit_match else "-") if {int, float}.intersection(parts) else ""
    choices = tuple(
        str(word) for part in parts if get_origin(part) is Literal for word in get_args(part)
    )
    return Key(
        name, words or _type(annotation, choices), choices, unit, is_required, default, meaning
    )


def _parts(annotation: Any) -> Iterator[Any]:
    """Yield the members of a union, of an array and of what is annotated; otherwise the type."""
    origin = get_origin(annotation)
    if origin is Annotated:
        yield from _parts(get_args(annotation)[0])
    elif origin in (Union, UnionType, tuple):
        for part in get_args(annotation):
            if part not in (type(None), Ellipsis):
                yield from _parts(part)
    else:
        yield annotation


def _models(annotation: Any) -> list[type[Section]]:
    """Return the models of tables in the type of a field."""
    parts = [p for p in _parts(annotation) if isinstance(p, type) and issubclass(p, Section)]
    return [part for part in parts if part.is_written and part not in (Profile, Orthotropic)]


def _is_array(annotation: Any) -> bool:
    """Return whether the type of a field is an array of tables."""
    origin = get_origin(annotation)
    return origin is tuple or (origin is Annotated and _is_array(get_args(annotation)[0]))


def _type(annotation: Any, choices: tuple[str, ...]) -> str:
    """Return in words what a key takes."""
    if choices:
        *first, last = (f'"{choice}"' for choice in choices)
        return f"{', '.join(first)} or {last}" if first else last
    if Profile in _parts(annotation):
        return "a positive number or a table over x"
    if Orthotropic in _parts(annotation):
        return "a name, or a table of E1 E2 E3 G12 G13 G23 [Pa] nu12 nu13 nu23"
    for part in (annotation, *get_args(annotation)):
        for note in getattr(part, "__metadata__", ()):
            if isinstance(note, Expected):
                return note.words
    return next((_PLAIN[part] for part in _parts(annotation) if part in _PLAIN), "a value")


Schema: TypeAlias = dict[str, Any]

DIALECT = "https://json-schema.org/draft/2020-12/schema"
QUANTITY = r"^\s*[+-]?[0-9.].*[^0-9\s]\s*$"
"""Pattern of a number with a unit, as "2 mm"."""
_INSTEAD = {
    "density": ("material", "mass_per_length"),
    "young_modulus": ("material", "bending_stiffness"),
}
"""Keys of a case file that give a required number as well."""


class _WithoutNull(GenerateJsonSchema):
    """Generator of schemas without null, which TOML has not."""

    def nullable_schema(self, schema: core_schema.NullableSchema) -> Schema:
        """Return the schema of what may be missing as that of what is there."""
        return self.generate_inner(schema["schema"])


def case_schema() -> Schema:
    """Return the JSON schema of a case file, draft 2020-12.

    Returns:
        A dictionary for `json.dumps`.
    """
    made = Case.model_json_schema(schema_generator=_WithoutNull)
    listed = tables()
    definitions = {table.model.__name__: table for table in listed if table.name}
    for name, table in definitions.items():
        made["$defs"][name] = _described(made["$defs"][name], table)
    layer = made["$defs"]["Orthotropic"]["properties"]
    for name in layer:
        quantity = {"type": "string", "pattern": QUANTITY}
        layer[name] = {"anyOf": [{"type": "number"}, quantity]}
    ends, inner = ({"$ref": f"#/$defs/{name}"} for name in ("Support", "PointSupport"))
    several = {"type": "array", "items": {"anyOf": [ends, inner]}}
    del made["$defs"]["Support"]["properties"]["placed"]
    made["properties"]["support"] = {"anyOf": [ends, several]}
    del made["$defs"]["SeveralExcitations"]
    drive = made["properties"]["excitation"]
    del drive["discriminator"]["mapping"]["several"]
    drive["oneOf"] = [entry for entry in drive["oneOf"] if "Several" not in entry["$ref"]]
    made["properties"]["excitation"] = {"anyOf": [drive, {"type": "array", "items": drive}]}
    made["required"].remove("mesh")  # points need none
    return {"$schema": DIALECT, **_described(made, listed[0]), "title": "A case of delam_fem"}


def _described(schema: Schema, table: KeyTable) -> Schema:
    """Return the schema of a table with the meanings of its keys, as TOML can write them."""
    keys = {key.name: key for key in table.keys}
    properties = {
        name: _plain(entry, keys.get(name)) for name, entry in schema["properties"].items()
    }
    properties |= {
        name: _plain({"type": "number", "exclusiveMinimum": 0.0}, keys[name])
        for name in table.model.also_written
    }
    required = [
        *(name for name in schema.get("required", []) if name not in _INSTEAD),
        *(["kind"] if table.kind else []),
    ]
    alternatives = [
        {"anyOf": [{"required": [name]} for name in (key, *others)]}
        for key, others in _INSTEAD.items()
        if key in properties
    ]
    return {
        **schema,
        "title": table.heading,
        "description": table.meaning,
        "properties": properties,
        "required": required,
        **({"allOf": alternatives} if alternatives else {}),
    }


def _plain(schema: Schema, key: Key | None) -> Schema:
    """Return the schema of a key with its meaning, and without a default of null."""
    content = {name: value for name, value in schema.items() if name != "title"}
    if content.get("default", ...) is None:
        del content["default"]
    if key is not None:
        content["description"] = key.meaning
        if key.has_unit and "oneOf" in content:  # a number, a text with its unit, or a table over x
            forms = content.pop("oneOf")
            content["anyOf"] = [*forms, {"type": "string", "pattern": QUANTITY}]
        if key.has_unit and "prefixItems" in content:
            text = {"type": "string", "pattern": QUANTITY}
            content["prefixItems"] = [{"anyOf": [x, text]} for x in content["prefixItems"]]
        if key.has_unit and content.get("type") == "number":  # it may also be a text with its unit
            about: Schema = {
                name: content.pop(name) for name in ("default", "description") if name in content
            }
            content = {**about, "anyOf": [content, {"type": "string", "pattern": QUANTITY}]}
    return content


KindName = Literal["apart", "paper", "layered", "edge"]
KINDS: tuple[KindName, ...] = get_args(KindName)

_PRESETS: Mapping[KindName, tuple[str, str]] = MappingProxyType(
    {
        "apart": (
            "default",
            "Two aluminium strips, clamped together at one end and apart elsewhere.",
        ),
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

    The values are those of a preset; laminae that are apart are of aluminium. A key that the preset
    does not set stands there as a comment with its default, and so do tables that it does not have.

    Args:
        kind: what the case is like.
        name: name of the case.
    """
    of, words = _PRESETS[kind]
    data = tomllib.loads(preset_text(of)) | {"name": name}
    if kind == "apart":  # the paper's measured stiffnesses belong to its own strips
        data["lamina"] = [_of_aluminium(lamina) for lamina in data["lamina"]]
    lines = [
        f"# {words}",
        f"#   delam-fem check {name}.toml    checks this file",
        f"#   delam-fem run {name}.toml         computes it",
        "#",
        '# Numbers are in SI units; a text may carry another unit, as in "2 mm". A key behind # is',
        "# not set; its default stands after it.",
    ]
    for table in tables():
        lines += ["", *_table_lines(table, data)]
    return "\n".join(lines) + "\n"


def _of_aluminium(lamina: Data) -> Data:
    """Return a lamina of a case with a material in place of its density, modulus and EI."""
    sizes = {key: lamina[key] for key in ("name", "length", "width", "thickness", "damping_ratio")}
    return sizes | {"material": "aluminium"}


def _table_lines(table: KeyTable, data: Data) -> Iterator[str]:
    """Yield the lines of a table: with values if the case has it, otherwise all as a comment."""
    if not table.name:
        yield from _key_lines(table, data)
        return
    content: Any = data.get(table.name)
    entries: list[Any] = content if isinstance(content, list) else [content]
    if isinstance(content, list) != table.is_array:  # the other tables of this name
        entries = [None]
    is_absent = entries == [None] or entries[0].get("kind", "") != table.kind
    instead = (
        f'{table.heading} of kind "{table.kind}" instead: ' if is_absent and table.kind else ""
    )
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


def _key_lines(
    table: KeyTable, given: Mapping[str, Any], *, is_active: bool = True
) -> Iterator[str]:
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


_wrapped = partial(wrap, break_on_hyphens=False)


def _comment(key: Key, is_needed: bool) -> str:
    """Return the comment beside a key: meaning, type, and whether the key must be given."""
    notes = [] if key.choices and all(word in key.meaning for word in key.choices) else [key.type]
    if is_needed:
        notes.append("required")
    elif key.default is not None:
        notes.append(f"default {toml_value(key.default)}")
    return key.meaning.removesuffix(".") + (f" ({'; '.join(notes)})" if notes else "")
