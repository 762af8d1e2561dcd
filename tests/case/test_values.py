"""Types of values at their bounds, values with units, and what is said of others."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from pydantic import TypeAdapter, ValidationError
from pydantic_core import PydanticCustomError

from delam_fem.api import in_si
from delam_fem.case import values


def said(kind: Any, value: object) -> str:
    """Return what a type says of a value; "" if it takes it."""
    try:
        TypeAdapter(kind).validate_python(value)
    except ValidationError as error:
        return error.errors()[0]["msg"]
    return ""


SIZE = "expected a size from 1e-30 to 1e+30"
BOUNDS: list[tuple[Any, list[object], dict[object, str]]] = [
    (values.Positive, [1e-30, 1e30, 3], {
        0.0: "expected a positive number", -1.0: "expected a positive number", 0.99e-30: SIZE,
        1.01e30: SIZE, "1": "expected a positive number", True: "expected a positive number",
        float("inf"): "expected a positive number"}),
    (values.NotNegative, [0.0, 0, 1e-30, 1e30], {
        -1e-9: "expected a number of at least 0", 0.99e-30: SIZE, 1.01e30: SIZE}),
    (values.Finite, [-1e30, 0.0, 1e-40, 1e30], {
        -1.01e30: "expected a number", 1.01e30: "expected a number",
        float("nan"): "expected a number"}),
    (values.DampingRatio, [0.0, 0.999], {
        -1e-9: "expected a number from 0 to below 1", 1.0: "expected a number from 0 to below 1"}),
    (values.Restitution, [0.0, 1.0], {
        -1e-9: "expected a number from 0 to 1", 1.001: "expected a number from 0 to 1"}),
    (values.Elements, [1, 100_000], {k: "expected a whole number from 1 to 100000"
                                     for k in (0, 100_001, 2.0, True)}),
    (values.PointsPerElement, [1, 64], {k: "expected a whole number from 1 to 64"
                                        for k in (0, 65)}),
    (values.CellCount, [1, 100], {k: "expected a whole number from 1 to 100" for k in (0, 101)}),
    (values.Poisson, [0.0, 0.499], {k: "expected a number of at least 0 and below 0.5"
                                    for k in (-1e-9, 0.5)}),
    (values.Degree, [2, 3], {k: "expected 2 or 3" for k in (1, 4)}),
    (values.Steps, [4, 100_000_000], {k: "expected a whole number from 4 to 100000000"
                                      for k in (3, 100_000_001)}),
    (values.Refine, [1, 4096], {k: "expected a whole number from 1 (never) to 4096"
                                for k in (0, 4097)}),
    (values.Count, [1, 10**15], {0: "expected a whole number of at least 1",
                                 10**15 + 1: "expected at most 1e+15"}),
    (values.CountOrNone, [0, 10**15], {-1: "expected a whole number of at least 0",
                                       10**15 + 1: "expected at most 1e+15"}),
    (values.CountOrSettled, [1, 10**15, "settled"], {
        k: 'expected a whole number of at least 1, or "settled"'
        for k in (0, 10**15 + 1, "Settled", 1.5)}),
    (values.Label, ["a", "A_1-b"], {k: "expected a word of letters, digits, - and _"
                                    for k in ("", "1a", "a b", "-a", 3)}),
    (values.FileName, ["a" * 255, "/".join(4 * ["a" * 255]), Path("b.csv")], {
        k: "expected the name of a file"
        for k in ("a" * 256, "a\0", "/".join(5 * ["a" * 205]), 3)}),
]  # fmt: skip


@pytest.mark.parametrize("number", range(len(BOUNDS)))
def test_bounds_are_met_on_both_sides(number: int) -> None:
    kind, taken, refused = BOUNDS[number]
    assert {str(value): said(kind, value) for value in taken} == {str(value): "" for value in taken}
    assert {str(value): said(kind, value) for value in refused} == {
        str(value): words for value, words in refused.items()
    }


def test_names_of_files_count_from_the_working_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert TypeAdapter(values.FileName).validate_python("x/../b.csv") == tmp_path / "b.csv"


WORDS = {
    "m": 'a length such as "2 mm"', "kg": 'a mass such as "10 g"', "s": 'a time such as "5 ms"',
    "Hz": 'a frequency such as "3.25 Hz"', "N": 'a force such as "0.5 N"',
    "Pa": 'a modulus such as "70 GPa"', "m/s": 'a velocity such as "0.5 mm/s"',
    "m/s2": 'an acceleration such as "9.81 m/s2" or "1 g_0"',
    "kg/m": 'a mass per length such as "0.2 kg/m"', "kg/m3": 'a density such as "2.7 g/cm3"',
    "N m": 'a rotational stiffness such as "150 N m"',
    "N m2": 'a bending stiffness such as "1.5 N m2"', "N/m": 'a stiffness such as "0.1 N/mm"',
    "N s/m": 'a damping such as "2 N s/m"', "1": 'a pure number such as 0.008 or "0.8 %"',
    "kg m2": "a value in kg m2",
}  # fmt: skip


@pytest.mark.parametrize("unit", WORDS)
def test_what_a_unit_stands_for_is_said(unit: str) -> None:
    for text, more in (("2 K", ""), ("2 furlongz", ": unknown unit")):
        for key in ("", "a.b"):
            with pytest.raises(PydanticCustomError) as error:
                in_si(text, unit, key)
            assert error.value.message() == f"expected {WORDS[unit]}, given {text!r}{more}"
            assert error.value.context is not None
            assert error.value.context.get("key", "") == key


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("3 rpm", "expected a frequency such as \"3.25 Hz\", not an angular one, given '3 rpm'"),
        (
            "3 rad/s",
            "expected a frequency such as \"3.25 Hz\", not an angular one, given '3 rad/s'",
        ),
        ("3,25 Hz", "expected a frequency such as \"3.25 Hz\" with a decimal point, '3.25 Hz'"),
        ("-3,25", "expected a frequency such as \"3.25 Hz\" with a decimal point, '-3.25'"),
    ],
)
def test_angles_and_decimal_commas_are_refused(text: str, told: str) -> None:
    with pytest.raises(PydanticCustomError) as error:
        in_si(text, "Hz")
    assert error.value.message() == told


@pytest.mark.parametrize(
    "text", ["1" * 41 + " m", "1." + "1" * 41 + " m", "2 m" + 41 * "m", "a m", "2  "]
)
def test_what_is_no_value_with_a_unit_stays_a_text(text: str) -> None:
    assert in_si(text, "m") == text


@pytest.mark.parametrize(
    ("text", "unit", "number"),
    [
        ("1" * 40 + " m", "m", float("1" * 40)), ("+.5 mm", "m", 5e-4), ("-2.E+1 m", "m", -20.0),
        ("3 cm^2", "m2", 3e-4), ("3 cm2", "m2", 3e-4), ("2 kg m2/s", "kg m2/s", 2.0),
        ("50 %", "1", 0.5), ("1 rad/s", "1/s", 1.0),
    ],
)  # fmt: skip
def test_numbers_with_units(text: str, unit: str, number: float) -> None:
    assert in_si(text, unit) == pytest.approx(number, rel=1e-15)


def test_a_quantity_of_any_registry_is_taken() -> None:
    pint = pytest.importorskip("pint")
    registry = pint.UnitRegistry()
    assert in_si(2.5 * registry.mm, "m") == 0.0025
    with pytest.raises(PydanticCustomError, match="expected a length such as"):
        in_si(2.5 * registry.s, "m")


class Table(values.Section):
    """A section with a key that the other asks for."""

    kind: str = "a"
    other: int | None = None


def test_unknown_keys_get_a_hint_or_the_list() -> None:
    for key, told in (("othr", "unknown key; did you mean other?"),
                      ("xyz", "unknown key; expected one of kind, other")):  # fmt: skip
        with pytest.raises(ValidationError) as error:
            Table.model_validate({key: 1})
        [details] = error.value.errors()
        assert details["ctx"]["key"] == key and details["msg"] == told


def test_keys_that_another_asks_for() -> None:
    Table().require_just("other", False, "kind")
    Table(other=0).require_just("other", True, "kind")
    for table, is_needed, told in (
        (Table(), True, 'missing, but required with kind = "a"'),
        (Table(other=0), False, 'expected none with kind = "a"'),
    ):
        with pytest.raises(PydanticCustomError) as error:
            table.require_just("other", is_needed, "kind")
        assert error.value.message() == told
