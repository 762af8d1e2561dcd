"""Read tables of numbers from files of the user.

Columns are separated by semicolons, tabs, commas or blanks. With any separator but the comma,
numbers may have a decimal comma. A heading, which may stand in a comment, may name units.

Messages quote no words of a file: one that is named by mistake may hold private text.
"""

from __future__ import annotations

import logging
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pydantic_core import PydanticCustomError

from delam_fem.case.toml import MOST_BYTES
from delam_fem.case.values import in_si
from delam_fem.numerics.types import FloatArray
from delam_fem.system.errors import CaseError

_DATA = re.compile(r"[+-]?[.,]?\d")
"""Start of a row of numbers."""
_BRACKETS = re.compile(r"[\[(]\s*([^\])]*?)\s*[\])]\s*$")
"""A unit in brackets at the end of a heading."""
_NAME = re.compile(r"[^\s\[(]+(?:\s*[\[(][^\])]*[\])])?")
"""A heading among headings that blanks separate."""
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
class Columns:
    """The numbers of a table.

    Attributes:
        lines: line of the file of each row.
        values: the numbers, shape (n_columns, n_rows).
        headings: text above each column; () if there is no heading.
        heading_line: line of the heading; 0 if there is none.
        above: cells of all rows above the numbers that have as many; the last is the heading.
    """

    lines: tuple[int, ...]
    values: FloatArray
    headings: tuple[str, ...] = ()
    heading_line: int = 0
    above: tuple[list[str], ...] = ()

    def unit(self, column: int) -> str | None:
        """Return the unit that the heading of a column names, or None."""
        if not self.headings:
            return None
        text = self.headings[column].strip().strip("\"'")
        found = _BRACKETS.search(text)
        if found is not None:
            return found[1]
        *names, last = re.split(r"[\s_/]+", text) if "/s" not in text else text.split()
        return last if names and last in _BARE_UNITS else None


def read_columns(path: Path, label: str, names: Sequence[str] | None = None) -> Columns:
    """Read a table of finite numbers; empty lines and comments (#) are skipped.

    The first row may be a heading; without `names` all rows above the first one of numbers alone
    may be. A mark at the start of UTF-8 files and the line ends of any system are accepted.

    Args:
        path: the file.
        label: name of the file in messages.
        names: names of the columns in messages; None: as many columns as the first row of numbers.

    Raises:
        CaseError: the file cannot be read, is too large or is not UTF-8 text; a row does not have
            a finite number in each column; a heading begins with a number; or decimal points and
            commas are mixed.
    """
    rows, comments = _split(path, label, names)
    is_heading = [not all(map(is_number, cells)) for _, cells in rows]
    if names is not None:
        is_heading = [not any(map(is_number, cells)) for _, cells in rows[:1]]
    n_above = (*is_heading, False).index(False)
    above, rows = rows[:n_above], rows[n_above:]
    n, found = len(names if names is not None else rows[0][1] if rows else ()), []
    for number, cells in rows:
        place, given = f"{label}, line {number}", _described(cells, n)
        if len(cells) != n or not all(map(is_number, cells)):
            raise CaseError(f"{place}: expected {_what(n, names)}, given {given}")
        found.append([float(cell) for cell in cells])
        if not np.isfinite(found[-1]).all():
            raise CaseError(f"{place}: expected finite numbers, given {given}")
    lines = tuple(number for number, _ in rows)
    headings = [(number, cells) for number, cells in above if len(cells) == n]
    for number, cells in headings:
        if is_number(cells[0]):
            raise CaseError(f"{label}, line {number}: expected numbers or names, found both")
    if not above:
        headings = _commented_heading(comments, lines, n)
    line, heading = headings[-1] if headings else (0, [])
    every = tuple(cells for _, cells in headings)
    return Columns(lines, np.array(found).reshape(len(found), n).T, tuple(heading), line, every)


def in_si_units(
    table: Columns, names: Sequence[str], accepted: Sequence[Sequence[str]], label: str
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
    found = [_factor(table, k, choices, label) for k, choices in enumerate(accepted)]
    missing = [
        f"{name} in {unit}"
        for k, (name, (_, unit)) in enumerate(zip(names, found, strict=True))
        if table.unit(k) is None
    ]
    text = f"{label}: the heading names no unit; read as {', '.join(missing)}"
    if missing and text not in _told:
        _told.add(text)
        _log.warning(text)
    factors = np.array([[factor] for factor, _ in found])
    return table.values * factors, tuple(unit for _, unit in found)


def _factor(table: Columns, column: int, accepted: Sequence[str], label: str) -> tuple[float, str]:
    """Return the factor from the unit of a column to an accepted SI unit, and that SI unit."""
    given = table.unit(column)
    if given is None:
        return 1.0, accepted[0]
    for unit in accepted:
        name = "g_0" if given in _GRAVITY and unit == "m/s2" else given.replace("**", "^")
        try:
            factor = in_si(f"1 {name}", unit)
        except PydanticCustomError:
            continue
        if isinstance(factor, float):
            return factor, unit
    raise CaseError(
        f"{label}, line {table.heading_line}: expected values in {' or '.join(accepted)}, or in a "
        f"multiple, in column {column + 1}, given {given[:8]}"
    )


def _split(
    path: Path, label: str, names: Sequence[str] | None
) -> tuple[list[tuple[int, list[str]]], list[tuple[int, str]]]:
    """Return the cells of each row, and the comments, each with the number of its line."""
    rows, comments = _content(path, label)
    data = [(number, text) for number, text in rows if _DATA.match(text)]
    separator = _separator([text for _, text in data])
    is_decimal_comma = separator != "," and _has_decimal_comma(data, separator, label)
    found = []
    for number, text in rows:
        if not _DATA.match(text):
            cells = list(_headings(text, separator, names))
        elif is_decimal_comma:
            cells = [cell.replace(",", ".", 1) for cell in _cells(text, separator)]
        else:
            cells = _cells(text, separator)
        found.append((number, cells))
    return found, comments


def _content(path: Path, label: str) -> tuple[list[tuple[int, str]], list[tuple[int, str]]]:
    """Return the rows of a file and its lines of comment, each with its number."""
    try:
        if path.stat().st_size > MOST_BYTES:
            raise CaseError(f"{label}: expected at most {MOST_BYTES} bytes")
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except OSError as error:
        raise CaseError(f"{label}: cannot be read ({error.strerror})") from None
    except UnicodeDecodeError:
        raise CaseError(f"{label}: expected a text file (UTF-8)") from None
    rows, comments = [], []
    for number, line in enumerate(lines, start=1):
        content, _, comment = line.partition("#")
        if content.strip():
            rows.append((number, content.strip()))
        elif comment.strip():
            comments.append((number, comment.strip()))
    return rows, comments


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
    """Split a row into its cells."""
    return [cell.strip() for cell in text.split(separator)]


def _headings(text: str, separator: str | None, names: Sequence[str] | None) -> tuple[str, ...]:
    """Split a row of headings, which may have another separator than the numbers."""
    for choice in (separator, ";", "\t", ","):
        cells = tuple(_cells(text, choice))
        if choice is not None and len(cells) > 1 and len(cells) == len(names or cells):
            return cells
    return tuple(_NAME.findall(text))


def _commented_heading(
    comments: Sequence[tuple[int, str]], lines: Sequence[int], n: int
) -> list[tuple[int, list[str]]]:
    """Return the last comment above the numbers that gives each column a heading with a unit."""
    for number, text in reversed(comments):
        if lines and number < lines[0]:
            cells = _headings(text, None if "," not in text else ",", ("",) * n)
            if len(cells) == n and any(_BRACKETS.search(cell) for cell in cells):
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
        if any("." in cell for cell in _cells(text, separator)):
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
