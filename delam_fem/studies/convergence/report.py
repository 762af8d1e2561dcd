"""A ladder as one page: its short tables and its figures."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from delam_fem.case.atomic import write_text
from delam_fem.results.pages import html
from delam_fem.results.pages.html import (
    Figure,
    Link,
    Paragraph,
    Preformatted,
    Section,
    Table,
    embedded,
)
from delam_fem.studies.convergence.analysis import Convergence
from delam_fem.studies.convergence.overview import overview, verdict
from delam_fem.studies.convergence.tables import NO_LIMIT

PAGE = "report.html"
"""Name of the page in the folder of a ladder."""


def write_page(found: Convergence, figures: Sequence[Path], directory: str | Path) -> Path:
    """Write the page of a ladder.

    Args:
        found: the ladder with its results.
        figures: PNG files.
        directory: folder of the ladder.

    Returns:
        The file.

    Raises:
        OSError: the file cannot be written, or a figure cannot be read.
    """
    ladder, path = found.ladder, Path(directory) / PAGE
    n = len(list(ladder.rungs()))
    text = f"{verdict(found)} {len(found.results)} of {n} runs are there."
    if not ladder.has_limit:
        text += f" {NO_LIMIT}"
    tables = [
        block
        for table in overview(found)
        for block in (Paragraph(_capital(table.title), "title"), Table(table.heading, table.rows))
    ]
    drawn = [Figure([embedded(p)], _words(p), f"{_capital(_words(p))}.") for p in figures]
    files = [
        (Link(name, name), meaning)
        for name, meaning in (
            ("convergence.json", "all numbers"), ("tables.md", "all tables, Markdown")
        )
        if (path.parent / name).exists()
    ]  # fmt: skip
    sections = [
        Section("", [Paragraph(text, "verdict")]),
        Section("Figures", drawn),
        Section("Tables", tables),
        Section("Files", [Table(("file", "content"), files)]),
        Section("Case", [Preformatted(ladder.case.to_toml())]),
    ]
    shown = [section for section in sections if section.blocks]
    return write_text(path, html.page(f"Convergence of {ladder.case.name}", shown, contents=True))


def _capital(text: str) -> str:
    """Return a text that begins with a capital letter."""
    return text[:1].upper() + text[1:]


def _words(path: Path) -> str:
    """Return the name of a figure in words."""
    return path.stem.replace("_", " ")
