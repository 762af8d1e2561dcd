"""The JSON schema takes what the models take, and marks what they refuse key by key."""

from __future__ import annotations

import tomllib
from typing import Any

import jsonschema
import pytest

from delam_fem.api import PRESETS, Case, preset, tables
from delam_fem.case.files import preset_text
from delam_fem.case.keys import case_schema


@pytest.fixture(scope="module")
def judge() -> jsonschema.Draft202012Validator:
    schema = case_schema()
    jsonschema.Draft202012Validator.check_schema(schema)
    return jsonschema.Draft202012Validator(schema)


@pytest.mark.parametrize("name", PRESETS)
def test_presets_and_complete_cases_are_taken(
    judge: jsonschema.Draft202012Validator, name: str
) -> None:
    judge.validate(tomllib.loads(preset_text(name)))
    judge.validate(tomllib.loads(preset(name).to_toml()))


def changed(changes: dict[str, Any], section: str) -> dict[str, Any]:
    """Return the preset "paper" with keys of a section changed; None removes one."""
    data = tomllib.loads(preset_text("paper"))
    table = data["lamina"][0] if section == "lamina" else data.setdefault(section, {})
    for key, value in changes.items():
        table.pop(key, None)
        if value is not None:
            table[key] = value
    return data


@pytest.mark.parametrize(
    ("section", "changes"),
    [
        ("contact", {"restitution": 1.5}),
        ("contact", {"law": "newtn"}),
        ("contact", {"stifness": 1.0}),
        ("excitation", {"kind": None}),
        ("excitation", {"kind": "sweep"}),
        ("lamina", {"density": None}),
        ("lamina", {"length": -1.0}),
        ("time", {"periods": 2.5}),
        ("time", {"steps_per_period": 3}),
        ("gap", {"tip": "wide"}),
        ("gap", {"tip": "12"}),
    ],
)
def test_what_the_models_refuse_is_marked(
    judge: jsonschema.Draft202012Validator, section: str, changes: dict[str, Any]
) -> None:
    data = changed(changes, section)
    with pytest.raises(ValueError):
        Case.model_validate(data)
    assert not judge.is_valid(data)


@pytest.mark.parametrize(
    ("section", "changes"),
    [
        ("lamina", {"density": None, "young_modulus": None, "material": "steel"}),
        ("lamina", {"density": None, "mass_per_length": 0.2}),
        ("lamina", {"young_modulus": None}),  # from its bending stiffness
        ("excitation", {"amplitude": None, "acceleration": 2}),
        ("gap", {"exponent": None, "shape": "mode"}),
        ("gap", {"tip": "12 mm"}),
        ("lamina", {"young_modulus": "70 GPa", "length": "685mm"}),
    ],
)
def test_what_the_models_take_is_not_marked(
    judge: jsonschema.Draft202012Validator, section: str, changes: dict[str, Any]
) -> None:
    data = changed(changes, section)
    Case.model_validate(data)
    judge.validate(data)


def test_every_key_is_there_with_its_meaning() -> None:
    schema = case_schema()
    for table in tables():
        place = schema["$defs"][table.model.__name__] if table.name else schema
        for key in table.keys:
            assert place["properties"][key.name]["description"] == key.meaning
