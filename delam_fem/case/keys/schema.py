"""Describe a case file by a JSON schema, with which editors check and complete it.

The schema follows from the models. It is a little more lenient than they are: what several keys
must fulfil together is checked when a case is read.
"""

from __future__ import annotations

from typing import Any, TypeAlias

from delam_fem.case.definition import Case
from delam_fem.case.keys.reference import Key, Table, tables

Schema: TypeAlias = dict[str, Any]

DIALECT = "https://json-schema.org/draft/2020-12/schema"
QUANTITY = r"^\s*[+-]?[0-9.].*[^0-9\s]\s*$"
"""Pattern of a number with a unit, as "2 mm"."""
_INSTEAD = {
    "density": ("material", "mass_per_length"),
    "young_modulus": ("material", "bending_stiffness"),
}
"""Keys of a case file that give a required number as well."""


def case_schema() -> Schema:
    """Return the JSON schema of a case file, draft 2020-12.

    Returns:
        A dictionary for `json.dumps`.
    """
    made = Case.model_json_schema()
    listed = tables()
    definitions = {own.model.__name__: own for own in listed if own.name}
    for name, own in definitions.items():
        made["$defs"][name] = _described(made["$defs"][name], own)
    whole = _described(made, listed[0])
    return {"$schema": DIALECT, "title": "A case of delam_fem", **whole}


def _described(schema: Schema, table: Table) -> Schema:
    """Return the schema of a table with the meanings of its keys, as TOML can write them."""
    keys = {key.name: key for key in table.keys}
    found = {name: _plain(own, keys.get(name)) for name, own in schema["properties"].items()}
    found |= {
        name: _plain({"type": "number", "exclusiveMinimum": 0.0}, keys[name])
        for name in table.model.also_written
    }
    required = [name for name in schema.get("required", []) if name not in _INSTEAD]
    if table.kind:
        required.append("kind")
    alternatives = [
        {"anyOf": [{"required": [name]} for name in (key, *others)]}
        for key, others in _INSTEAD.items()
        if key in found
    ]
    return {
        **schema,
        "title": table.heading,
        "description": table.meaning,
        "properties": found,
        "required": required,
        **({"allOf": alternatives} if alternatives else {}),
    }


def _plain(schema: Schema, key: Key | None) -> Schema:
    """Return the schema of a key with its meaning, and without null, which TOML has not."""
    own = {name: value for name, value in schema.items() if name != "title"}
    if own.get("default", ...) is None:
        del own["default"]
    choices = [choice for choice in own.get("anyOf", ()) if choice.get("type") != "null"]
    if len(choices) == 1:
        del own["anyOf"]
        own |= choices[0]
    elif choices:
        own["anyOf"] = choices
    if key is not None:
        own["description"] = key.meaning
        if key.unit not in ("", "-") and own.get("type") == "number":
            own = _with_unit(own)
    return own


def _with_unit(schema: Schema) -> Schema:
    """Return the schema of a number that may also be a text with its unit."""
    about: Schema = {
        name: schema.pop(name) for name in ("default", "description") if name in schema
    }
    return {**about, "anyOf": [schema, {"type": "string", "pattern": QUANTITY}]}
