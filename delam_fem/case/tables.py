"""Read the rows of a CSV table of the user; messages about it quote nothing of the file.

A file that is named by mistake is no table, and its text may be nobody's business.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from delam_fem.case.toml import MOST_BYTES, CaseError


def rows_of(path: Path, label: str) -> Iterator[tuple[int, list[str]]]:
    """Yield line number and cells of each row of a table; empty lines and comments are skipped.

    A mark at the start of UTF-8 files and the line ends of any system are accepted.

    Args:
        path: the file.
        label: name of the file in messages.

    Raises:
        CaseError: the file cannot be read, is too large or is not UTF-8 text.
    """
    try:
        if path.stat().st_size > MOST_BYTES:
            raise CaseError(f"{label}: expected at most {MOST_BYTES} bytes")
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except OSError as error:
        raise CaseError(f"{label}: cannot be read ({error.strerror})") from None
    except UnicodeDecodeError:
        raise CaseError(f"{label}: expected a text file (UTF-8)") from None
    for number, line in enumerate(lines, start=1):
        content = line.partition("#")[0].strip()
        if content:
            yield number, [cell.strip() for cell in content.split(",")]


def described(cells: Sequence[str]) -> str:
    """Return what a row has instead of two finite numbers, without its text."""
    if len(cells) != 2:
        return f"{len(cells)} column{'s' * (len(cells) > 1)}"
    for column, cell in enumerate(cells, start=1):
        if not is_number(cell):
            return f"a word in column {column}"
    return f"{float(cells[0])}, {float(cells[1])}"


def is_number(text: str) -> bool:
    """Return whether a text is a number; NaN and infinity count as numbers."""
    try:
        float(text)
    except ValueError:
        return False
    return True
