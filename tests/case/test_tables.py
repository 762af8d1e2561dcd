"""Tables of numbers: separators, decimal commas, headings with units."""

from __future__ import annotations

from pathlib import Path

import pytest

from delam_fem.api import CaseError, read_columns
from delam_fem.case.tables import in_si_units

SAME = [[0.0, 0.25, 0.5], [0.0, 0.003, 1.5e-3]]


def written(folder: Path, text: str) -> Path:
    """Return a file with the text."""
    path = folder / "t.csv"
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize(
    "text",
    [
        "0,0\n0.25,0.003\n0.5,1.5e-3\n",
        "0, 0\n0.25,\t0.003\n0.5 , 1.5e-3\n",
        "x;gap\n0;0\n0.25;0.003\n0.5;1.5e-3\n",
        "x;gap\n0;0\n0,25;0,003\n0,5;1,5e-3\n",
        "x\tgap\n0\t0\n0.25\t0.003\n0.5\t1.5E-3\n",
        "x\tgap\n0\t0\n0,25\t0,003\n0,5\t1,5E-3\n",
        "0 0\n0.25   0.003\n .5 1.5e-3\n",
        "x gap\n0 0\n0,25   0,003\n ,5 1,5e-3\n",
        "# of a calliper\n\nx [m] gap [m]\n0 0  # clamp\n0.25 0.003\n0.5 1.5e-3\n",
        "\ufeffx (m), gap (m)\r\n0,0\r\n0.25,0.003\r\n0.5,1.5e-3\r\n",
        "x, gap\n0;0\n0.25;0.003\n0.5;1.5e-3\n",
    ],
)
def test_any_separator_and_decimal_mark(tmp_path: Path, text: str) -> None:
    table = read_columns(written(tmp_path, text), "t", ("x", "gap"))
    assert table.values.tolist() == SAME
    assert read_columns(written(tmp_path, text), "t").values.tolist() == SAME


@pytest.mark.parametrize(
    ("heading", "units"),
    [
        ("x [mm], gap [m]", ["mm", "m"]),
        ("x (mm), gap", ["mm", None]),
        ("x / mm, gap_um", ["mm", "um"]),
        ("x mm;gap m", ["mm", "m"]),
        ("time [s]\tvalue [m/s2]", ["s", "m/s2"]),
        ('"x [mm]","gap [mm]"', ["mm", "mm"]),
        ("x [mm] gap [mm]", ["mm", "mm"]),
        ("# x [mm], gap [mm]", ["mm", "mm"]),  # as numpy.savetxt writes it
        ("# x [mm] gap [mm]", ["mm", "mm"]),
        ("m, s", [None, None]),  # names of one letter are no units
        ("x, gap", [None, None]),
        ("# made in mm", [None, None]),
    ],
)
def test_units_of_a_heading(tmp_path: Path, heading: str, units: list[str | None]) -> None:
    table = read_columns(written(tmp_path, f"{heading}\n0,0\n1,2\n"), "t", ("x", "gap"))
    assert [table.unit(0), table.unit(1)] == units


@pytest.mark.parametrize(
    ("heading", "accepted", "factors"),
    [
        ("x [mm], gap [µm]", (("m",), ("m",)), (1e-3, 1e-6)),
        ("t [ms], a [g]", (("s",), ("m", "m/s2")), (1e-3, 9.80665)),
        ("t [min], a [m/s²]", (("s",), ("m", "m/s2")), (60.0, 1.0)),
        ("t [s], a [mm/s**2]", (("s",), ("m", "m/s2")), (1.0, 1e-3)),
        ("t [s], F [kN]", (("s",), ("N",)), (1.0, 1e3)),
        ("x [inch], gap [furlong]", (("m",), ("m",)), (0.0254, 201.168)),
    ],
)
def test_numbers_are_converted_by_the_units_of_the_heading(
    tmp_path: Path, heading: str, accepted: tuple[tuple[str, ...], ...],
    factors: tuple[float, float],
) -> None:  # fmt: skip
    table = read_columns(written(tmp_path, f"{heading}\n1,1\n2,3\n"), "t")
    values, units = in_si_units(table, ("a", "b"), accepted, "t")
    assert values[:, 0] == pytest.approx(factors, rel=1e-5)
    assert values[:, 1] == pytest.approx([2.0 * factors[0], 3.0 * factors[1]], rel=1e-5)
    assert units[0] == accepted[0][0] and units[1] == accepted[1][-1]


def test_a_unit_of_another_quantity_is_refused(tmp_path: Path) -> None:
    table = read_columns(written(tmp_path, "x [mm], gap [N]\n0,0\n1,2\n"), "t")
    with pytest.raises(CaseError, match=r"t, line 1: expected values in m, or in a multiple, in c"):
        in_si_units(table, ("x", "gap"), (("m",), ("m",)), "t")


def test_a_table_without_units_is_told_once(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    table = read_columns(written(tmp_path, "x, gap [mm]\n0,0\n1,2\n"), "t")
    for _ in range(2):
        values, _ = in_si_units(table, ("x", "gap"), (("m",), ("m",)), str(tmp_path))
    assert values.tolist() == [[0.0, 1.0], [0.0, 0.002]]
    assert caplog.messages == [f"{tmp_path}: the heading names no unit; read as x in m"]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("0;0\n0,5;0.5\n", r"t: .*given commas \(line 2\) and points"),
        ("0;0\n1,234,5;1\n", "line 2: .*given a word in column 1"),
        ("0 0 0\n", "line 1: .*given 3 columns"),
        ("0,0\n1_0,1\n", "line 2: .*given a word in column 1"),
        ("0,0\n1,inf\n", "line 2: .*given 1.0, inf"),
        ("x,gap\nmm,mm\n0,0\n", "line 2: .*given a word"),
    ],
)
def test_what_is_no_table(tmp_path: Path, text: str, expected: str) -> None:
    with pytest.raises(CaseError, match=expected):
        read_columns(written(tmp_path, text), "t", ("x", "gap"))


def test_any_number_of_columns(tmp_path: Path) -> None:
    table = read_columns(written(tmp_path, "t;a;b\n0;1,5;2\n1;2,5;3\n"), "t")
    assert table.values.tolist() == [[0.0, 1.0], [1.5, 2.5], [2.0, 3.0]]
    assert table.headings == ("t", "a", "b")
    with pytest.raises(CaseError, match=r"line 2: .*given 2 columns"):
        read_columns(written(tmp_path, "0;1;2\n0;1\n"), "t")


@pytest.mark.parametrize(
    ("text", "names", "message"),
    [
        ("0;0\n0,5;1\n1,5;2\n2;0.5\n", None, "t: expected one decimal mark, given commas (line 2) "
         "and points (line 4)"),
        ("1 2 3 4\n1 2 3 4 5\n", None, "t, line 2: expected four numbers, given 5 columns"),
        ("1 2 3 4 5\n1\n", None, "t, line 2: expected 5 numbers, given 1 column"),
        ("1\n\nx\n", None, "t, line 3: expected one number, given a word in column 1"),
        ("1,2\n# no\n3,x\n", ("a", "b"), "t, line 3: expected two numbers a, b, given a word in "
         "column 2"),
        ("1,2\n3,nan\n", None, "t, line 2: expected finite numbers, given 3.0, nan"),
        ("x [mm],y [K]\n1,2\n3,4\n", None, "t, line 1: expected values in m or N, or in a "
         "multiple, in column 2, given K"),
        ("# a\n# x [mm],y [verylongunit]\n1,2\n3,4\n", None, "t, line 2: expected values in m or N"
         ", or in a multiple, in column 2, given verylong"),
    ],
)  # fmt: skip
def test_messages_are_exact(
    tmp_path: Path, text: str, names: tuple[str, ...] | None, message: str
) -> None:
    with pytest.raises(CaseError) as error:
        table = read_columns(written(tmp_path, text), "t", names)
        in_si_units(table, ("x", "y"), (("m", "N"), ("m", "N")), "t")
    assert str(error.value) == message


def test_lines_and_headings_are_counted_from_one(tmp_path: Path) -> None:
    table = read_columns(written(tmp_path, "# x [mm], y [m]\n\n1 2\n# no\n3 4\n# a [s], b\n"), "t")
    assert table.lines == (3, 5) and table.heading_line == 1
    assert table.headings == ("x [mm]", "y [m]")
    below = read_columns(written(tmp_path, "\nx;y\n1;2\n3;4\n"), "t")
    assert below.heading_line == 2 and below.lines == (3, 4)
    other = read_columns(written(tmp_path, "x;y;z\n1;2\n3;4\n"), "t")
    assert (other.headings, other.heading_line) == ((), 0)
    assert other.unit(1) is None
    empty = read_columns(written(tmp_path, "# nothing\n"), "t", ("x", "y"))
    assert empty.values.shape == (2, 0)
    with pytest.raises(CaseError, match=r"\bt: "):
        read_columns(written(tmp_path, "# nothing\n"), "t")
    for text in ("1 2 3\n", "1,2,3\n", "1\t2\t3\n", "1;2;3\n", "1 , 2 ,3\n"):
        assert read_columns(written(tmp_path, text), "t").values.tolist() == [[1.0], [2.0], [3.0]]
    one = read_columns(written(tmp_path, "1,5\n2,5\n"), "t")
    assert one.values.tolist() == [[1.0, 2.0], [5.0, 5.0]]
