"""Columns of files as channels in SI: axes, units, places, and the parts of responses."""

from __future__ import annotations

import numpy as np
import pytest
from support import refusal as message

from delam_fem.api import heading
from delam_fem.studies.signals.channels import (
    Column,
    Sheet,
    Times,
    assignment,
    axis_of,
    channels_of,
    length_of,
    matrix_columns,
)

N = 8
TIME = 0.5 + 0.25 * np.arange(N)
ONE, TWO = 2.0 + np.sin(TIME), -1.0 + np.cos(3.0 * TIME)


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("thick [mm]", ("thick", "mm")), ("thick (mm)", ("thick", "mm")), ("a", ("a", None)),
        ('"a b [ m/s ]"', ("a b", "m/s")), ("a []", ("a", "")), (" a()", ("a", "")),
        ("a [m] b", ("a [m] b", None)), ("a(b) [m]", ("a(b)", "m")),
    ],
)  # fmt: skip
def test_headings(text: str, found: tuple[str, str | None]) -> None:
    assert heading(text) == found


@pytest.mark.parametrize(
    ("name", "unit", "axis"),
    [
        ("t", None, "time"), (" Zeit ", None, "time"), ("f", None, "frequency"),
        ("X", None, "x"), ("pos", None, "x"), ("a", None, ""), ("a", "s", "time"),
        ("a", "min", "time"), ("a", "µs", "time"), ("freq. axis", "Hz", "frequency"),
        ("freq. axis", "kHz", "frequency"), ("freq. axis", "mm", ""), ("a", "Hz", ""),
    ],
)  # fmt: skip
def test_axes(name: str, unit: str | None, axis: str) -> None:
    assert axis_of(name, unit) == axis


def test_rows_of_a_matrix_are_numbered_from_one() -> None:
    table = np.array([ONE, TWO, ONE * TWO])
    assert [column.name for column in matrix_columns("a", ONE)] == ["a"]
    assert [column.name for column in matrix_columns("a", table)] == ["a_1", "a_2", "a_3"]
    named = matrix_columns("a", table[:2], ["p", "q"], "mm")
    assert [(column.name, column.unit) for column in named] == [("p", "mm"), ("q", "mm")]
    np.testing.assert_array_equal(named[1].values, TWO)
    with pytest.raises(ValueError, match="zip"):
        matrix_columns("a", table, ["p", "q"])


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("a", ("a", {})), (" col2 ", ("col2", {})), ("a:mm", ("a", {"unit": "mm"})),
        ("a:", ("a", {"unit": ""})), ("a:m/s@120 mm/upper part",
         ("a", {"unit": "m/s", "position": 0.12, "lamina": "upper part"})),
        ("a@-1.5e-1", ("a", {"position": -0.15})), ("a b@2in", ("a b", {"position": 0.0508})),
    ],
)  # fmt: skip
def test_assignments(text: str, found: tuple[str, dict[str, object]]) -> None:
    source, says = assignment(text, "label")
    assert source == found[0]
    assert says == pytest.approx(found[1]) if "lamina" not in says else says == found[1]


def test_places_that_are_none_are_refused() -> None:
    assert message(lambda: assignment("", "--channel a")) == (
        "--channel a: expected SOURCE, SOURCE:UNIT or SOURCE:UNIT@POSITION/LAMINA, given ''"
    )
    assert message(lambda: length_of("here", "label")) == (
        "label: expected a position such as 0.12 or 120mm, given 'here'"
    )
    assert message(lambda: length_of("3 s", "label")) == (
        "label: expected a position in a unit of length, given '3 s'"
    )
    assert length_of("-.5", "label") == -0.5 and length_of("2.5e1cm", "label") == 0.25


def sheet(*columns: Column, label: str = "file", **about: object) -> Sheet:
    return Sheet(label, columns, **about)  # type: ignore[arg-type]


def test_messages_of_channels_are_exact() -> None:
    t, a = Column("t", TIME, "s"), Column("a", ONE, "mm")
    falling = TIME.copy()
    falling[3] = falling[2]
    refused = {
        "file, column 't': expected the time to increase, given 1 after 1 in row 4; --rate "
        "gives the samples per second instead": (sheet(Column("t", falling, "s"), a),),
        "file, column 'x': expected the x to increase, given 1 after 1 in row 4": (
            sheet(Column("x", falling, "m"), a),),
        "file, column 'f': expected the frequency to increase, given 1.25 after 1.5 in row 5": (
            sheet(Column("f", TIME[[0, 1, 2, 4, 3]], "Hz"), Column("a", ONE[:5], "mm")),),
        "file: expected a column beside the time, given none": (sheet(t),),
        "file, column 'b': no unit; expected one in the heading, as in 'b [mm]', or an option such "
        "as --units mm": (sheet(t, Column("b", ONE, None)),),
        "file, column 'b': expected finite numbers, given none at sample 3": (
            sheet(t, Column("b", np.where(np.arange(N) >= 2, np.nan, ONE), "mm")),),
    }  # fmt: skip
    for told, sheets in refused.items():
        assert message(lambda sheets=sheets: channels_of(sheets, {}, None, Times(), [])) == told
    two = [sheet(t, a), sheet(t, Column("b", TWO, "mm"))]
    assert message(
        lambda: channels_of(two, {"q": ("c", {}), "p": ("d", {})}, None, Times(), [])
    ) == ("--channel p: there is no column 'd'; the files have t, a, t, b")
    assert message(lambda: channels_of(two, {"q": ("col2", {})}, None, Times(), [])) == (
        "--channel q: col2 is not clear with several tables; use the names of the columns, or "
        "measure the files one by one"
    )
    many = sheet(t, *(Column(f"name_{k:02d}", ONE, "mm") for k in range(60)))
    told = message(lambda: channels_of([many], {"q": ("col62", {})}, None, Times(), []))
    names = ", ".join(["t", *(f"name_{k:02d}" for k in range(60))])[:300]
    assert told == f"--channel q: there is no column 'col62'; the files have {names}"
    channels = channels_of([many], {"q": ("col61", {})}, None, Times(), [])
    assert [channel.name for channel in channels[-2:]] == ["name_58", "q"]
    twins = sheet(t, Column("A", ONE, "mm"), Column("a", TWO, "mm"))
    for source, values in (("A", ONE), ("a", TWO)):
        of_twins = channels_of([twins], {"q": (source, {})}, None, Times(), [])
        [q] = [channel for channel in of_twins if channel.name == "q"]
        np.testing.assert_array_equal(q.values, 1e-3 * values)
    both = sheet(t, Column("Ab", ONE, "mm"), Column("aB", TWO, "mm"))
    assert "no column 'AB'" in message(
        lambda: channels_of([both], {"q": ("AB", {})}, None, Times(), [])
    )
    assert "no column 'col0'" in message(
        lambda: channels_of([both], {"q": ("col0", {})}, None, Times(), [])
    )
