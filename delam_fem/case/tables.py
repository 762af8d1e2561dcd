"""Read tables of numbers from files of the user.

Columns are separated by semicolons, tabs, commas or blanks. With any separator but the comma,
numbers may have a decimal comma, in quotes with commas, too. A heading, which may stand in a
comment, may name units. Text that is not UTF-8 is taken for Windows-1252, with a note.

Messages quote no words of a file: one that is named by mistake may hold private text.
"""

from __future__ import annotations

import csv
import logging
import math
import re
from array import array
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from datetime import date
from itertools import pairwise
from pathlib import Path

import numpy as np
from pydantic_core import PydanticCustomError

from delam_fem.case.toml import MOST_BYTES
from delam_fem.case.values import in_si
from delam_fem.numerics.types import FloatArray
from delam_fem.system.errors import CaseError
from delam_fem.system.footprint import bounded

_DATA = re.compile(r"[\"']?[+-]?[.,]?\d")
"""Start of a row of numbers."""
_CLOCK = r"(?P<hours>\d{1,2}):(?P<minutes>\d\d):(?P<seconds>\d\d(?:[.,]\d{1,12})?)"
_DATE = (
    r"(?:(?P<year>\d{4})-(?P<month>\d\d)-(?P<day>\d\d)"
    r"|(?P<first>\d{1,2})(?P<mark>[./])(?P<second>\d{1,2})[./](?P<last>\d{4}))"
)
_INSTANT = re.compile(rf"(?:{_DATE})?(?:T|$|(?=\d))(?:{_CLOCK})?Z?")
"""A date, a clock, or both with a T between them."""
_BEFORE_CLOCK = re.compile(r"(?<=\d) (?=\d{1,2}:\d\d:\d\d)")
"""The blank between a date and a clock."""
_DECIMAL_COMMA = re.compile(r"[+-]?\d{0,20},\d{1,20}(?:[eE][+-]?\d{1,3})?")
"""A number with a decimal comma, in quotes."""
_COMMENT = re.compile(r"(?:^|\s)#(?=\s|$)|^#")
"""The start of a comment in a row of headings, which may name `Laser #1`."""
_FIRST_DATE = re.compile(_DATE)
UTF_16 = (b"\xff\xfe", b"\xfe\xff")
"""Marks at the start of a text in UTF-16, as spreadsheets write it."""
_CONTROL = re.compile(r"[\x00-\x08\x0e-\x1b\x7f]")
"""Characters that no text has."""
DAY = 86400.0
"""Seconds of a day."""
_OPENING = {"]": "[", ")": "("}
"""The brackets about a unit, by the closing one."""
_NAME = re.compile(r"[^\s\[(]++")
"""A name among headings that blanks separate."""
_UNIT_BEGINS = re.compile(r"\s*+[\[(]")
_UNIT_ENDS = re.compile(r"[\])]")
_BARE_UNITS = frozenset(
    "m mm cm dm km µm μm um nm inch ft s ms µs μs us min h N mN kN g m/s2 m/s^2 m/s²".split()
)
"""Units that are recognised without brackets as the last word of a heading: `gap mm`, `x_mm`."""
_GRAVITY = ("g", "G", "gn")
"""How accelerometers name the standard gravity; a column is not in grams."""
_told: set[str] = set()
_log = logging.getLogger(__name__)
_COUNTS = ("no", "one", "two", "three", "four")


@dataclass(frozen=True)
class TableColumns:
    """The numbers of a table.

    Attributes:
        lines: line of the file of each row.
        values: the numbers, shape (n_columns, n_rows).
        headings: text above each column; () if there is no heading.
        heading_line: line of the heading; 0 if there is none.
        above: cells of all rows above the numbers that have as many; the last is the heading.
        instants: what columns of dates and clocks are, by number; their values are in seconds.
        notes: what was put right.
    """

    lines: tuple[int, ...]
    values: FloatArray
    headings: tuple[str, ...] = ()
    heading_line: int = 0
    above: tuple[list[str], ...] = ()
    instants: dict[int, str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    def unit(self, column: int) -> str | None:
        """Return the unit that the heading of a column names, or None."""
        if not self.headings:
            return None
        text = self.headings[column].strip().strip("\"'")
        _, unit = heading(text)
        if unit is not None:
            return unit
        *names, last = re.split(r"[\s_/]+", text) if "/s" not in text else text.split()
        return last if names and last in _BARE_UNITS else None


def heading(text: str) -> tuple[str, str | None]:
    """Return name and unit of a heading such as "gap [mm]" or "gap (mm)"; None: no unit."""
    bare = text.strip().strip('"').strip()
    closing = bare[-1:]
    start = bare.find(_OPENING.get(closing, "]"), 1 + bare.rfind(closing, 0, -1))
    if closing not in _OPENING or start < 0:
        return bare, None
    return bare[:start].strip(), bare[start + 1 : -1].strip()


def read_columns(
    path: Path, label: str, names: Sequence[str] | None = None, most_bytes: int = MOST_BYTES
) -> TableColumns:
    """Read a table of finite numbers; empty lines and comments (#) are skipped.

    The first row may be a heading. Without `names` all rows above the numbers may be, also such as
    hold numbers, and columns may be dates and clocks. A mark at the start of UTF-8 files and the
    line ends of any system are accepted, and a separator at the end of every row.

    Args:
        path: the file.
        label: name of the file in messages.
        names: names of the columns in messages; None: as many columns as most rows of numbers.
        most_bytes: size of the largest file.

    Raises:
        CaseError: the file cannot be read, is too large or is no text; a row does not have
            a finite number in each column; a heading begins with a number, or has more or fewer
            names than the rows have columns; or decimal points and commas are mixed.
    """
    if not path.is_file():
        _content(path, label, most_bytes)  # tells why
    with bounded(path, label):
        return _read(path, label, names, most_bytes)


def _read(path: Path, label: str, names: Sequence[str] | None, most_bytes: int) -> TableColumns:
    """Read a table; see `read_columns`."""
    content = _content(path, label, most_bytes)
    layout = _layout(content.rows, label, names)
    n_above, values = _loaded(content.rows, layout, label) or _checked(content.rows, layout, label)
    n = values.shape[0]
    lines = tuple(line for line, _ in content.rows[n_above:])
    above = [(line, layout.cells(text)) for line, text in content.rows[:n_above]]
    headings = [(line, cells) for line, cells in above if len(cells) == n]
    if above:
        _require_heading(above[-1], n, label, names)
    else:
        headings = _commented_heading(content.comments, lines, n)
    line, heading = headings[-1] if headings else (0, [])
    every = tuple(cells for _, cells in headings)
    instants = _instants([text for _, text in content.rows[n_above:]], layout, label)
    return TableColumns(lines, values, tuple(heading), line, every, instants, content.notes)


HEAD = 1000
"""Rows in which the numbers of a long table must begin for the fast reader."""


def _loaded(
    rows: Sequence[tuple[int, str]], layout: _Layout, label: str
) -> tuple[int, FloatArray] | None:
    """Return where the numbers of a long table begin, and the numbers; None: it is not plain."""
    if len(rows) <= HEAD:
        return None
    head = [(line, text, layout.numbers(text)) for line, text in rows[:HEAD]]
    try:
        n_above, n = _extent(head, layout, label)
        texts = (text for _, text in rows[n_above:])
        if layout.is_decimal_comma:
            texts = (text.replace(",", ".") for text in texts)
        if layout.is_ended:
            texts = (text[:-1] for text in texts)
        values = np.loadtxt(texts, delimiter=layout.separator, comments=None, ndmin=2).T
    except (CaseError, ValueError):
        return None
    return (n_above, values.copy()) if len(values) == n and np.isfinite(values).all() else None


def _checked(
    rows: Sequence[tuple[int, str]], layout: _Layout, label: str
) -> tuple[int, FloatArray]:
    """Return where the numbers of a table begin, and the numbers, shape (n_columns, n_rows).

    Raises:
        CaseError: a row does not have a finite number in each column.
    """
    parsed = [(line, text, layout.numbers(text)) for line, text in rows]
    n_above, n = _extent(parsed, layout, label)
    values = array("d")
    for line, text, numbers in parsed[n_above:]:
        if numbers is None or len(numbers) != n or not all(map(math.isfinite, numbers)):
            expected = _what(n, layout.names)
            if numbers is not None and len(numbers) == n:
                expected = "finite numbers"
            description = _described(layout.cells(text), n)
            raise CaseError(f"{label}, line {line}: expected {expected}, given {description}")
        values.extend(numbers)
    return n_above, np.frombuffer(values, np.float64).reshape(len(parsed) - n_above, n).T.copy()


Row = tuple[int, str, "list[float] | None"]
"""Line, text and numbers of a row; None: not all of its cells are numbers."""


def _extent(rows: Sequence[Row], layout: _Layout, label: str) -> tuple[int, int]:
    """Return how many rows stand above the numbers, and how many columns there are.

    The numbers begin with two rows of as many as most rows have.

    Raises:
        CaseError: no row has numbers alone.
    """
    names = layout.names
    if names is not None:
        is_heading = bool(rows) and not any(map(is_number, layout.cells(rows[0][1])))
        return int(is_heading), len(names)
    sizes = [0 if numbers is None else len(numbers) for _, _, numbers in rows]
    counts = Counter(size for size in sizes if size)
    if not counts:
        raise CaseError(
            f"{label}: expected a table with at least two rows of numbers, found none"
            + _best_row(rows, layout)
        )
    n = counts.most_common(1)[0][0]
    pairs = list(pairwise(sizes))
    start = pairs.index((n, n)) if (n, n) in pairs else sizes.index(n)
    before = layout.cells(rows[start - 1][1]) if start else []
    if n in sizes[:start] and len(before) == n and is_number(before[0]):
        start = sizes.index(n)  # that row is one of numbers with a word in it
    return start, n


def _best_row(rows: Sequence[Row], layout: _Layout) -> str:
    """Return in words why the first row that begins with a digit is none of numbers."""
    for line, text, _ in rows:
        if _DATA.match(text):
            cells = layout.cells(text)
            return f"; line {line} has {len(cells)} columns, and {_described(cells, len(cells))}"
    return "; no line begins with a number"


def _require_heading(
    last: tuple[int, list[str]], n: int, label: str, names: Sequence[str] | None
) -> None:
    """Check the row above the numbers: it names the columns, or is something else altogether.

    Raises:
        CaseError: it begins with a number, or names more or fewer columns.
    """
    line, cells = last
    if len(cells) == n and is_number(cells[0]):
        raise CaseError(f"{label}, line {line}: expected numbers or names, found both")
    n_units = sum(heading(cell)[1] is not None for cell in cells)
    if names is None and len(cells) != n and n_units > len(cells) / 2 and len(cells) > 1:
        raise CaseError(
            f"{label}, line {line}: expected a heading with {n} names, as the rows have {n} "
            f"columns, given {len(cells)}; put a name that holds a separator into quotes"
        )


def _instants(texts: Sequence[str], layout: _Layout, label: str) -> dict[int, str]:
    """Return what columns of dates and clocks are, by number.

    Raises:
        CaseError: dates with slashes, which may be day or month first, differ.
    """
    if layout.names is not None or not texts:
        return {}
    instants = {}
    for column, cells in enumerate(
        zip(layout.cells(texts[0]), layout.cells(texts[-1]), strict=True)
    ):
        match = _INSTANT.fullmatch(cells[0])
        if match is None or is_number(cells[0]):
            continue
        kinds = [name for name, key in (("date", "mark"), ("clock", "hours")) if match[key]]
        if match["year"]:
            kinds.insert(0, "date")
        instants[column] = " and ".join(kinds)
        if match["mark"] == "/" and cells[0].partition("T")[0] != cells[1].partition("T")[0]:
            raise CaseError(
                f"{label}: expected dates as 2024-05-31 or 31.05.2024, given some with slashes in "
                f"column {column + 1}, which may be day or month first"
            )
    return instants


def in_si_units(
    table: TableColumns, names: Sequence[str], accepted: Sequence[Sequence[str]], label: str
) -> tuple[FloatArray, tuple[str, ...]]:
    """Return the numbers of a table in SI units, by the units that its heading names.

    A warning says, once, that a heading names none; the first accepted units are then meant.

    Args:
        table: the table.
        names: names of the columns in messages.
        accepted: SI units in which each column can be.
        label: name of the file in messages.

    Returns:
        The numbers, shape (n_columns, n_rows), and the unit of each column.

    Raises:
        CaseError: a heading names another unit.
    """
    conversions = [_factor(table, k, choices, label) for k, choices in enumerate(accepted)]
    missing = [
        f"{name} in {unit}"
        for k, (name, (_, unit)) in enumerate(zip(names, conversions, strict=True))
        if table.unit(k) is None
    ]
    text = f"{label}: the heading names no unit; read as {', '.join(missing)}"
    if missing and text not in _told:
        _told.add(text)
        _log.warning(text)
    factors = np.array([[factor] for factor, _ in conversions])
    return table.values * factors, tuple(unit for _, unit in conversions)


def _factor(
    table: TableColumns, column: int, accepted: Sequence[str], label: str
) -> tuple[float, str]:
    """Return the factor from the unit of a column to an accepted SI unit, and that SI unit."""
    unit_text = table.unit(column)
    if unit_text is None:
        return 1.0, accepted[0]
    for unit in accepted:
        name = "g_0" if unit_text in _GRAVITY and unit == "m/s2" else unit_text.replace("**", "^")
        try:
            factor = in_si(f"1 {name}", unit)
        except PydanticCustomError:
            continue
        if isinstance(factor, float):
            return factor, unit
    raise CaseError(
        f"{label}, line {table.heading_line}: expected values in {' or '.join(accepted)}, or in a "
        f"multiple, in column {column + 1}, given {unit_text[:8]}"
    )


@dataclass(frozen=True)
class _Content:
    """The lines of a file.

    Attributes:
        rows: rows with the numbers of their lines.
        comments: comments with the numbers of their lines.
        notes: what was put right.
    """

    rows: list[tuple[int, str]]
    comments: list[tuple[int, str]]
    notes: tuple[str, ...]


@dataclass(frozen=True)
class _Layout:
    """How the rows of a file are split into cells.

    Attributes:
        separator: what separates columns; None: blanks.
        is_decimal_comma: whether numbers have decimal commas.
        is_ended: whether each row of numbers ends with a separator.
        first_day: number of the first day in the file; None: dates and clocks are no numbers.
        names: names of the columns in messages; None: any number of columns.
    """

    separator: str | None
    is_decimal_comma: bool
    is_ended: bool
    first_day: int | None
    names: Sequence[str] | None

    def cells(self, text: str) -> list[str]:
        """Return the cells of a row."""
        if not _DATA.match(text):
            cells = list(_headings(text, self.separator, self.names))
        else:
            cells = _cells(text, self.separator)
            if self.is_decimal_comma:
                cells = [cell.replace(",", ".", 1) for cell in cells]
        if self.is_ended and len(cells) > 1 and not cells[-1]:
            cells.pop()
        return cells

    def numbers(self, text: str) -> list[float] | None:
        """Return the numbers of a row, seconds for dates and clocks; None: a cell is another."""
        if not _DATA.match(text):
            return None
        cells = self.cells(text)
        try:
            if "_" not in text:
                return list(map(float, cells))
        except ValueError:
            pass
        if self.first_day is None:
            return None
        numbers = [float(cell) if is_number(cell) else self._seconds(cell) for cell in cells]
        return None if None in numbers else [number for number in numbers if number is not None]

    def _seconds(self, cell: str) -> float | None:
        """Return a date, a clock or both in seconds from the first day; None: it is none."""
        match = _INSTANT.fullmatch(cell)
        if match is None or self.first_day is None:
            return None
        if not (match["year"] or match["mark"] or match["hours"]):
            return None
        days = _day(match)
        seconds = 0.0 if days is None else DAY * (days - self.first_day)
        if match["hours"]:
            clock = 60.0 * int(match["hours"]) + int(match["minutes"])
            seconds += 60.0 * clock + float(match["seconds"].replace(",", "."))
        return seconds


def _day(match: re.Match[str]) -> int | None:
    """Return the number of a day; None: there is none."""
    try:
        if match["year"]:
            return date(int(match["year"]), int(match["month"]), int(match["day"])).toordinal()
        if match["mark"] == ".":
            return date(int(match["last"]), int(match["second"]), int(match["first"])).toordinal()
    except ValueError:
        return None
    return None


def _layout(rows: list[tuple[int, str]], label: str, names: Sequence[str] | None) -> _Layout:
    """Return how the rows of a file are split."""
    data = [(line, text) for line, text in rows if _DATA.match(text)]
    separator = _separator([text for _, text in data])
    is_decimal_comma = separator != "," and _has_decimal_comma(data, separator, label)
    mark = separator or ","
    is_ended = bool(data) and all(text.endswith(mark) for _, text in data)
    first_day = None
    if names is None:
        days = (_day(match) for _, text in data for match in _FIRST_DATE.finditer(text[:40]))
        first_day = next((day for day in days if day is not None), 0)
    return _Layout(separator, is_decimal_comma, is_ended, first_day, names)


def _content(path: Path, label: str, most_bytes: int) -> _Content:
    """Return the rows of a file and its lines of comment.

    Raises:
        CaseError: the file cannot be read, is too large, or is no text.
    """
    try:
        size = path.stat().st_size
        if size > most_bytes:
            raise CaseError(
                f"{label}: expected at most {most_bytes} bytes, given {size}; cut it, thin it, or "
                "store it in a binary format"
            )
        content = path.read_bytes()
    except OSError as error:
        raise CaseError(f"{label}: cannot be read ({error.strerror})") from None
    notes: tuple[str, ...] = ()
    try:
        text = content.decode("utf-16" if content[:2] in UTF_16 else "utf-8-sig")
    except UnicodeDecodeError:
        notes = ("the text is not UTF-8, and was read as Windows-1252 (Latin-1)",)
        text = content.decode("cp1252", "replace")
    if _CONTROL.search(text):
        raise CaseError(f"{label}: expected a text file, given one with characters that none has")
    rows: list[tuple[int, str]] = []
    comments: list[tuple[int, str]] = []
    for number, whole_line in enumerate(text.splitlines(), start=1):
        line = whole_line.strip()
        mark = line.find("#")
        if mark >= 0 and not _DATA.match(line):
            match = _COMMENT.search(line)
            mark = match.start() if match else -1
        row = line[:mark].strip() if mark >= 0 else line
        if row:
            rows.append((number, _BEFORE_CLOCK.sub("T", row)))
        elif comment := line.lstrip("# \t"):
            comments.append((number, comment))
    return _Content(rows, comments, notes)


def _separator(data: Sequence[str]) -> str | None:
    """Return what separates the columns of rows of numbers; None: blanks."""
    if any(";" in text for text in data):
        return ";"
    if any(re.search(r",\s|\s,", text) for text in data):
        return ","  # a decimal comma stands between digits
    if any("\t" in text for text in data):
        return "\t"
    return None if data and len(data[0].split()) > 1 else ","


def _cells(text: str, separator: str | None) -> list[str]:
    """Split a row into its cells; a separator in quotes separates nothing."""
    if '"' not in text:
        return [cell.strip() for cell in text.split(separator)]
    reader = csv.reader([text], delimiter=separator or " ", skipinitialspace=True)
    try:
        cells = [cell.strip() for cell in next(reader)]
    except csv.Error:  # a cell of more than 131,072 characters, or a quote within one
        return [cell.strip() for cell in text.split(separator)]
    return [
        cell.replace(",", ".") if _DECIMAL_COMMA.fullmatch(cell) and separator == "," else cell
        for cell in cells
    ]


def _headings(text: str, separator: str | None, names: Sequence[str] | None) -> tuple[str, ...]:
    """Split a row of headings, which may have another separator than the numbers."""
    for choice in (separator, ";", "\t", ","):
        cells = tuple(_cells(text, choice))
        if choice is not None and len(cells) > 1 and len(cells) == len(names or cells):
            return cells
    return tuple(_names(text))


def _names(text: str) -> Iterator[str]:
    """Yield the headings that blanks separate, each with the unit in brackets behind it."""
    last = max(text.rfind("]"), text.rfind(")"))
    place = 0
    while (name := _NAME.search(text, place)) is not None:
        place = name.end()
        begin = _UNIT_BEGINS.match(text, place)
        if begin is not None and begin.end() <= last:
            end = _UNIT_ENDS.search(text, begin.end())
            place = place if end is None else end.end()
        yield text[name.start() : place]


def _commented_heading(
    comments: Sequence[tuple[int, str]], lines: Sequence[int], n: int
) -> list[tuple[int, list[str]]]:
    """Return the last comment above the numbers that gives each column a heading with a unit."""
    for number, text in reversed(comments):
        if lines and number < lines[0]:
            cells = _headings(text, None if "," not in text else ",", ("",) * n)
            if len(cells) == n and any(heading(cell)[1] for cell in cells):
                return [(number, [*cells])]
    return []


def _has_decimal_comma(data: Sequence[tuple[int, str]], separator: str | None, label: str) -> bool:
    """Return whether the numbers of a table have decimal commas.

    Raises:
        CaseError: some have a comma and some a point, so that 1,234 may be either.
    """
    commas = [number for number, text in data if "," in text]
    if not commas:
        return False
    for number, text in data:
        if any("." in cell and not _INSTANT.fullmatch(cell) for cell in _cells(text, separator)):
            raise CaseError(
                f"{label}: expected one decimal mark, given commas (line {commas[0]}) and points "
                f"(line {number})"
            )
    return True


def _what(n: int, names: Sequence[str] | None) -> str:
    """Return what a row must have in words."""
    count = _COUNTS[n] if n < len(_COUNTS) else str(n)
    return f"{count} number{'s' * (n != 1)}{'' if names is None else ' ' + ', '.join(names)}"


def _described(cells: Sequence[str], n: int) -> str:
    """Return what a row has instead of n finite numbers, without its text."""
    if len(cells) != n:
        return f"{len(cells)} column{'s' * (len(cells) > 1)}"
    for column, cell in enumerate(cells, start=1):
        if not is_number(cell):
            return f"a word in column {column}"
    return ", ".join(str(float(cell)) for cell in cells)


def is_number(text: str) -> bool:
    """Return whether a text is a number; NaN and infinity count as numbers."""
    try:
        float(text)
    except ValueError:
        return False
    return "_" not in text
