"""Units as instruments and people write them: those of units.md, and the rules of the page."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from hypothesis import given, strategies as st
from project import ROOT

from delam_fem.api import CaseError
from delam_fem.studies.signals.units import QUANTITIES, UNITS, of_quantity, ratio_of, unit_of

PAGE = (ROOT / "docs" / "measured_units.md").read_text(encoding="utf-8")
TABLE = Path(__file__).with_name("units.md").read_text(encoding="utf-8")
ROWS = re.findall(r"^\| (?:`(.*)`|\(nothing\)) \| (.+) \| (.+) \|$", TABLE, re.MULTILINE)
"""Text, quantity or "refused", and the SI value of one, typed by hand, or the reason."""
DIGITS = 1e-12
"""Relative tolerance of factors: they are typed with 15 digits."""


def test_the_table_has_two_hundred_texts_and_none_twice() -> None:
    texts = [text for text, _, _ in ROWS]
    assert len(texts) == len(set(texts)) >= 200
    assert sum(quantity == "refused" for _, quantity, _ in ROWS) >= 50


def test_examples_of_the_page_are_in_the_table() -> None:
    known = {(quantity, text) for text, quantity, _ in ROWS}
    examples = {
        (quantity, text)
        for quantity, texts in re.findall(r"^\| ([a-z ]+) \| (`.+`) \|$", PAGE, re.MULTILINE)
        for text in re.findall("`([^`]+)`", texts)
    }
    assert {quantity for quantity, _ in examples} == {quantity for _, quantity, _ in ROWS}
    assert examples <= known
    assert f"has {len(ROWS)} texts" in PAGE


@pytest.mark.parametrize(("text", "quantity", "factor"), ROWS)
def test_units_of_the_table(text: str, quantity: str, factor: str) -> None:
    if quantity == "refused":
        with pytest.raises(CaseError) as error:
            unit_of(text, "file, column 'a'")
        assert "file, column 'a'" in str(error.value) and "--channel" in str(error.value)
        assert repr(text) in str(error.value)
    else:
        unit = unit_of(text, "a")
        assert unit.factor == pytest.approx(float(factor), rel=DIGITS)
        assert (unit.quantity or "number") == quantity


def test_si_units_are_read_as_what_they_are() -> None:
    for quantity, (units, _) in QUANTITIES.items():
        same = of_quantity(quantity)
        assert (same.factor, same.units, same.quantity) == (1.0, units, quantity)
        assert unit_of(units, "a").factor == 1.0
        if quantity != "strain":  # "1" may be any number
            assert unit_of(units, "a").quantity == quantity


@given(st.sampled_from(sorted(UNITS)), st.sampled_from('?�$;!&@~|\\<>="{}#,Âß¿'), st.booleans())
def test_a_character_that_is_in_no_unit_is_never_left_out(name: str, odd: str, first: bool) -> None:
    with pytest.raises(CaseError):
        unit_of(odd + name if first else name + odd, "a")


@given(st.text(max_size=100))
def test_any_text_is_a_unit_or_refused(text: str) -> None:
    try:
        assert unit_of(text, "a").factor > 0.0
    except CaseError:
        pass


@pytest.mark.parametrize(
    ("text", "factor"),
    [("mm/g", 1e-3 / 9.80665), ("V/N", 1.0), ("g/V", 9.80665), ("um/V", 1e-6), ("mm/mA", 1.0)],
)
def test_over_a_frequency_any_motion_over_any_excitation_is_a_response(
    text: str, factor: float
) -> None:
    unit = unit_of(text, "a", is_response=True)
    assert unit.factor == pytest.approx(factor, rel=DIGITS) and unit.quantity == ""
    with pytest.raises(CaseError, match="no channel"):
        unit_of(text, "a")


@pytest.mark.parametrize("text", ["N/m", "N s/m", "N/g", "lbf/in"])
def test_a_force_over_a_motion_is_no_response(text: str) -> None:
    with pytest.raises(CaseError):
        unit_of(text, "a", is_response=True)


@pytest.mark.parametrize(
    ("above", "below", "ratio"),
    [("m", "N", "m/N"), ("m/s", "N", "m/(N s)"), ("m/s2", "N", "m/(N s2)"), ("1", "N", "1/N"),
     ("m", "m", "1"), ("m", "m/s2", "s2"), ("N s", "m/s", "kg")],
)  # fmt: skip
def test_ratios_of_si_units(above: str, below: str, ratio: str) -> None:
    assert ratio_of(above, below) == ratio
