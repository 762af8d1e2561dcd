"""Read measurements from tables of text."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from delam_fem.case.tables import is_number, read_columns, rows_of
from delam_fem.case.toml import CaseError
from delam_fem.results.measured.columns import Column, Sheet, heading


def read(path: Path) -> list[Sheet]:
    """Read a table.

    The lines above the first row of numbers are headings: the last with as many cells as the
    table has columns names them, with units as in `thick [mm]`; a line of units may follow.

    Args:
        path: of the file.

    Returns:
        One sheet.

    Raises:
        CaseError: the file cannot be read, or a row is not as long as the others or no numbers.
    """
    label = str(path)
    words: list[tuple[int, list[str]]] = []
    rows: list[list[float]] = []
    for number, cells in rows_of(path, label):
        if not rows and not all(is_number(cell) for cell in cells):
            words.append((number, cells))
            continue
        if not all(is_number(cell) for cell in cells):
            column = next(k for k, cell in enumerate(cells, 1) if not is_number(cell))
            raise CaseError(
                f"{label}, line {number}: expected numbers, found none in column {column}"
            )
        if rows and len(cells) != len(rows[0]):
            raise CaseError(
                f"{label}, line {number}: expected {len(rows[0])} columns as above, given "
                f"{len(cells)}"
            )
        rows.append([float(cell) for cell in cells])
    if len(rows) < 2:
        raise CaseError(f"{label}: expected a table with at least two rows of numbers")
    table = np.array(rows).T
    fitting = [(number, cells) for number, cells in words if len(cells) == len(table)]
    for number, cells in fitting:
        if is_number(cells[0]):
            raise CaseError(f"{label}, line {number}: expected numbers or names, found both")
    headings = [cells for _, cells in fitting]
    if not headings and not words:  # it may stand in a comment
        headings = [list(own) for own in [read_columns(path, label).headings] if own]
    names = _names(headings, len(table))
    columns = (Column(name, own, unit) for (name, unit), own in zip(names, table, strict=True))
    return [Sheet(label, tuple(columns))]


def _names(fitting: list[list[str]], n_columns: int) -> list[tuple[str, str | None]]:
    """Return names and units of the columns; without headings they are col1, col2 and so on."""
    if not fitting:
        return [(f"col{k}", None) for k in range(1, n_columns + 1)]
    if len(fitting) > 1 and all(_is_unit_cell(cell) for cell in fitting[-1]):
        units = [cell.strip("[]() ") for cell in fitting[-1]]
        return [(heading(cell)[0], unit) for cell, unit in zip(fitting[-2], units, strict=True)]
    return [heading(cell) for cell in fitting[-1]]


def _is_unit_cell(cell: str) -> bool:
    """Return whether a cell of a heading can be a unit: in brackets, or a few letters."""
    bare = cell.strip()
    return bare.startswith(("[", "(")) or len(bare) <= 5 or "/" in bare
