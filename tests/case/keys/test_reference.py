"""The list of keys follows the models: nothing is missing, nothing is undocumented."""

import csv
import io
import json

import golden
import pytest
from project import ROOT

from delam_fem.api import PRESETS, preset, tables
from delam_fem.case.keys import Key, KeyTable

TABLE = ROOT / "docs" / "reference" / "keys.csv"


def table(name: str, kind: str = "") -> KeyTable:
    match, *_ = (t for t in tables() if (t.name, t.kind) == (name, kind))
    return match


def default_of(key: Key) -> str:
    if key.is_required:
        return "required"
    return "" if key.default is None else json.dumps(key.default, default=str, ensure_ascii=False)


@pytest.mark.stored
def test_the_table_of_the_documentation_has_all_keys(request: pytest.FixtureRequest) -> None:
    """`--store` writes it, as it writes texts of tests/golden."""
    text = io.StringIO()
    rows = csv.writer(text, lineterminator="\n")
    rows.writerow(("table", "kind", "key", "takes", "unit", "default", "meaning"))
    for section in tables():
        place = section.heading, section.kind
        rows.writerows(
            (*place, key.name, key.type, key.unit, default_of(key), key.meaning)
            for key in section.keys
        )
    golden.check(TABLE, text.getvalue(), store=bool(request.config.getoption("store")))


def test_every_key_has_a_meaning_and_every_number_a_unit() -> None:
    for section in tables():
        assert section.meaning.endswith("."), section.name
        for key in section.keys:
            assert key.meaning, f"{section.heading} {key.name}: no row in Attributes"
            assert key.type != "a value", f"{section.heading} {key.name}: no words for its type"


@pytest.mark.parametrize("name", PRESETS)
def test_every_key_of_a_preset_is_listed(name: str) -> None:
    case = preset(name)
    for key, value in case.model_dump(exclude_none=True).items():
        entries = value if isinstance(value, tuple | list) else [value]
        for entry in entries:
            if isinstance(entry, dict):
                listed = table(key, entry.get("kind", ""))
                assert set(entry) <= {listed_key.name for listed_key in listed.keys}
            else:
                assert key in {listed_key.name for listed_key in table("").keys}


def test_numbers_have_type_unit_and_default() -> None:
    keys = {key.name: key for key in table("contact").keys}
    spring = keys["penalty_stiffness"]
    assert (spring.type, spring.unit) == ("a number of at least 0", "N/m per node pair")
    assert (spring.default, spring.is_required) == (100.0, False)
    assert keys["points_per_element"].unit == "-"
    assert keys["law"].is_required and keys["law"].default is None


def test_words_are_listed() -> None:
    spacing = next(key for key in table("excitation", "sweep").keys if key.name == "spacing")
    assert spacing.choices == ("linear", "logarithmic")
    assert (spacing.type, spacing.unit, spacing.default) == (
        '"linear" or "logarithmic"',
        "",
        "linear",
    )


def test_a_force_and_a_motion_of_the_base_differ_in_the_unit_of_their_amplitude() -> None:
    def unit(kind: str) -> str:
        return next(k.unit for k in table("excitation", kind).keys if k.name == "amplitude")

    assert (unit("harmonic"), unit("force")) == ("m", "N")


def test_tables_say_how_they_are_written() -> None:
    assert table("lamina").heading == "[[lamina]]"
    assert table("gap").heading == "[gap]"
    assert table("").heading == ""
    kinds = [section.kind for section in tables() if section.name == "excitation"]
    assert kinds[:5] == ["harmonic", "sweep", "force", "hammer", "table"]
    assert kinds[5:] == ["random", "multisine", "burst", "record", "none"]
    assert "mass_per_length" in {key.name for key in table("lamina").keys}
