"""TOML in and out, overrides of single keys, and what is said of each mistake."""

from __future__ import annotations

from copy import deepcopy
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support import refusal

from delam_fem.api import CaseError, apply_overrides, read_toml, shown, toml_text
from delam_fem.case import toml
from delam_fem.case.toml import parse_override, parsed, set_key, toml_value


@pytest.mark.parametrize(
    ("line", "remedy"),
    [
        ("law = newton-penalty # it", '; a text stands in quotes: law = "newton-penalty"'),
        ("a.b = x/y@z", '; a text stands in quotes: a.b = "x/y@z"'),
        ("tip = -0,012", "; a number has a decimal point: tip = -0.012"),
        ("length = = 3", ""), ("[", ""),
    ],
)  # fmt: skip
def test_what_may_be_wrong_in_a_line_is_said(tmp_path: Path, line: str, remedy: str) -> None:
    path = tmp_path / "c.toml"
    path.write_text(f'name = "x"\n{line}\nother = 3\n')
    told = refusal(lambda: read_toml(path))
    assert told.startswith(f"case file {path}: not valid TOML: ")
    assert "line 2" in told and told.partition("; ")[2] == remedy.removeprefix("; ")


def test_files_have_a_largest_size(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "c.toml"
    path.write_text("a = 1\n")
    monkeypatch.setattr(toml, "MOST_BYTES", 6)
    assert read_toml(path) == {"a": 1}
    path.write_text("a = 12\n")
    assert refusal(lambda: read_toml(path)) == f"case file {path}: expected at most 6 bytes"


def test_depth_and_whole_numbers_have_bounds() -> None:
    for depth, is_taken in ((14, True), (15, False)):
        text = "a = " + "[" * depth + "1" + "]" * depth
        if is_taken:
            assert parsed(text, "label")
        else:
            told = "label: expected at most 16 levels of tables and arrays"
            assert refusal(lambda text=text: parsed(text, "label")) == told
    for number, is_taken in ((2**63 - 1, True), (2**63, False), (-(2**63), True),
                             (-(2**63) - 1, False)):  # fmt: skip
        text = f"a = [{{b = {number}}}]"
        if is_taken:
            assert parsed(text, "l") == {"a": [{"b": number}]}
        else:
            told = "l: expected whole numbers of at most 64 bits"
            assert refusal(lambda text=text: parsed(text, "l")) == told
    for parts in (63, 64):
        text = "[" + ".".join("a" * parts) + ".b]"
        assert "16 levels" in refusal(lambda text=text: parsed(text, "l"))


DATA: dict[str, Any] = {
    "name": "a\x7fü\n", "flag": True, "n": 3, "x": np.float64(0.1), "list": [1, 2.5, "b"],
    "a key": 1, "gap": {"tip": 0.012, "with space": [True]},
    "lamina": [{"name": "low", "length": 1e-7}, {"name": "up"}], "empty": {},
}  # fmt: skip


def test_tables_are_written_so_that_they_read_back() -> None:
    text = toml_text(DATA)
    assert text == (
        'name = "a\\u007fü\\n"\nflag = true\nn = 3\nx = 0.1\nlist = [1, 2.5, "b"]\n"a key" = 1\n\n'
        '[gap]\ntip = 0.012\n"with space" = [true]\n\n[[lamina]]\nname = "low"\nlength = 1e-07\n\n'
        '[[lamina]]\nname = "up"\n\n[empty]\n'
    )
    assert parsed(text, "l") == DATA
    assert toml_value(Path("a/b")) == '"a/b"' and toml_value(()) == "[]"


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (float("inf"), "inf"), (10**60, str(10**60)), ("a", "'a'"), (Path("a b"), "a b"),
        (10**60 + 1, "a number of more than 60 digits"),
        (-(10**60) - 1, "a number of more than 60 digits"),
        ("b" * 58, repr("b" * 58)), ("b" * 59, repr("b" * 59)[:57] + "..."),
    ],
)  # fmt: skip
def test_long_inputs_are_shortened(value: object, text: str) -> None:
    assert shown(value) == (text if len(text) <= 60 else f"{text[:57]}...")


def test_overrides_are_taken_apart() -> None:
    assert parse_override(" a.b = [1, 2]") == ("a.b", [1, 2])
    assert parse_override("a=1\nb=2") == ("a", "1\nb=2")
    assert parse_override("a=12:30:00") == ("a", "12:30:00")
    assert refusal(lambda: parse_override("a.b")) == (
        "override 'a.b': expected KEY=VALUE, for example excitation.frequency=3.65"
    )
    assert parse_override(".".join("a" * 16) + "=1")[1] == 1
    key = ".".join("a" * 17)
    told = f"override {key!r}: expected at most 16 parts"
    assert refusal(lambda: parse_override(f"{key}=1")) == told


CASE: dict[str, Any] = {
    "name": "c", "lamina": [{"name": "low", "length": 1.0, "material": "steel"},
                            {"name": "up", "density": 3.0, "young_modulus": 4.0}],
    "delamination": [{"between": ["low", "up"]}, {"between": ["low", "up"]},
                     {"between": ["up", "top"], "end": 2.0}],
    "point_mass": [{"mass": 1.0}, {"mass": 2.0}], "sensor": [],
    "gap": {"tip": 0.1, "root": 0.2, "exponent": 2.0}, "mesh": {"elements": 3},
    "excitation": {"kind": "harmonic", "frequency": 2.0, "amplitude": 0.1},
    "time": {"scheme": "newmark", "steps_per_period": 9, "periods": 3},
    "contact": {"law": "newton"}, "output": {"window_periods": 2, "fields_per_period": 3},
    "support": [{"position": 0.1}, {"start": "free"}],
}  # fmt: skip


@pytest.mark.parametrize(
    ("overrides", "changed"),
    [
        ({"lamina.up.length": 2.0}, {"lamina": [CASE["lamina"][0], {**CASE["lamina"][1],
                                                                    "length": 2.0}]}),
        ({"lamina.2.length": np.float64(2.0)}, {"lamina": [CASE["lamina"][0], {
            **CASE["lamina"][1], "length": 2.0}]}),
        ({"delamination.up-top.end": 3.0}, {"delamination": [*CASE["delamination"][:2], {
            "between": ["up", "top"], "end": 3.0}]}),
        ({"point_mass.2.mass": None}, {"point_mass": [{"mass": 1.0}, {}]}),
        ({"new.deep.key": 1}, {"new": {"deep": {"key": 1}}}),
        ({"support.end": "free"}, {"support": [{"position": 0.1}, {"start": "free",
                                                                   "end": "free"}]}),
        ({"mesh.file": "a"}, {"mesh": {"file": "a"}}),
        ({"gap.shape": "mode"}, {"gap": {"tip": 0.1, "root": 0.2, "shape": "mode"}}),
        ({"gap.file": "a"}, {"gap": {"file": "a"}}), ({"gap.tip": 9}, {"gap": {
            **CASE["gap"], "tip": 9}}),
        ({"excitation.acceleration": 1.0}, {"excitation": {"kind": "harmonic", "frequency": 2.0,
                                                           "acceleration": 1.0}}),
        ({"time.step": 0.1}, {"time": {"scheme": "newmark", "periods": 3, "step": 0.1}}),
        ({"time.duration": 1.0}, {"time": {"scheme": "newmark", "steps_per_period": 9,
                                           "duration": 1.0}}),
        ({"excitation.kind": "sweep"}, {"excitation": {"kind": "sweep", "amplitude": 0.1},
                                        "output": {}}),
        ({"excitation.kind": "force"}, {"excitation": {"kind": "force"}}),
        ({"excitation.kind": "hammer"}, {"excitation": {"kind": "hammer"}, "output": {}}),
        ({"excitation.kind": "table"}, {"excitation": {"kind": "table"}, "output": {}}),
        ({"excitation.kind": "harmonic"}, {}),
        ({"contact.law": "penalty@newmark"}, {
            "contact": {"law": "penalty@newmark"}, "time": {"steps_per_period": 9, "periods": 3}}),
        ({"lamina.low.density": 5.0}, {"lamina": [
            {"name": "low", "length": 1.0, "young_modulus": 210e9, "density": 5.0},
            CASE["lamina"][1]]}),
        ({"lamina.low.young_modulus": 5.0}, {"lamina": [
            {"name": "low", "length": 1.0, "young_modulus": 5.0, "density": 7850.0},
            CASE["lamina"][1]]}),
        ({"lamina.up.material": "steel"}, {"lamina": [
            CASE["lamina"][0], {"name": "up", "material": "steel"}]}),
        ({"lamina.up.mass_per_length": 2.0}, {"lamina": [CASE["lamina"][0], {
            "name": "up", "young_modulus": 4.0, "mass_per_length": 2.0}]}),
    ],
)  # fmt: skip
def test_overrides_change_just_this(overrides: dict[str, Any], changed: dict[str, Any]) -> None:
    data = deepcopy(CASE)
    apply_overrides(data, overrides)
    assert data == CASE | changed


def test_tables_that_override_stay_as_they_are() -> None:
    overrides = {"excitation": {"kind": "harmonic", "frequency": 2.0}, "excitation.frequency": 3.0}
    data: dict[str, Any] = {}
    apply_overrides(data, overrides)
    assert data["excitation"]["frequency"] == 3.0
    assert overrides["excitation"] == {"kind": "harmonic", "frequency": 2.0}


def test_the_ends_of_several_supports_are_added() -> None:
    data: dict[str, Any] = {"support": [{"position": 0.1}]}
    set_key(data, "support.end", "free")
    assert data == {"support": [{"position": 0.1}, {"end": "free"}]}


@pytest.mark.parametrize(
    ("key", "message"),
    [
        ("stop.1.gap", "the case has no [[stop]]; write one into a case file"),
        ("name.x", "name is not a table"), ("gap.tip.x", "gap.tip is not a table"),
        ("lamina.length", "not a key of a case; expected lamina.low.length or lamina.up.length"),
        ("lamina.3.length", "no entry '3'; expected one of low, up or a number from 1"),
        ("point_mass.x.mass", "no entry 'x'; expected one of 1, 2 or a number from 1"),
        ("sensor.a.x", "no entry 'a'; expected one of none or a number from 1"),
        ("sensor.x", "not a key of a case"), ("gap.", "not a key of a case"),
        ("delamination.low-up.end", "2 entries 'low-up'; give a number from 1"),
        ("lamina.7.density", "no entry '7'; expected one of low, up or a number from 1"),
    ],
)  # fmt: skip
def test_keys_that_are_none_are_refused(key: str, message: str) -> None:
    told = refusal(lambda: apply_overrides(deepcopy(CASE), {key: 1.0}))
    assert told == f"override {key}: {message}"


def test_a_number_of_a_list_is_set_by_its_place() -> None:
    """Places count from 1; numbers alone are set so, tables by their names."""
    data: dict[str, object] = {"lamina": [{"name": "a", "young_modulus": {"value": [1.0, 2.0]}}]}
    set_key(data, "lamina.a.young_modulus.value.2", 3.0)
    assert data == {"lamina": [{"name": "a", "young_modulus": {"value": [1.0, 3.0]}}]}
    with pytest.raises(CaseError, match="at a place from 1 to 2"):
        set_key(data, "lamina.a.young_modulus.value.3", 3.0)
    with pytest.raises(CaseError, match="not a key of a case"):
        set_key(data, "lamina.1", 3.0)
