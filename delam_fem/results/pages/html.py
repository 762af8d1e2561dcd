"""Pages in HTML, and bars of progress.

A page has a title, contents, and sections of paragraphs, tables, figures, films and texts. All
texts are escaped here, so callers pass plain text. A page needs no other file, except pictures and
links that are given by their address. Its style follows the reader's choice of light or dark, the
width of the screen, and paper; its scripts enlarge figures (page.js) and play films (film.js).
"""

from __future__ import annotations

import base64
import json
import re
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from html import escape
from pathlib import Path
from typing import Any, TypeAlias

FOLDER = Path(__file__).parent
"""Folder of the style sheet and the scripts, which are put into the pages."""


@dataclass(frozen=True)
class Link:
    """A link within a text.

    Attributes:
        text: text of the link.
        address: address of the target; `#name` is an anchor of the same page.
    """

    text: str
    address: str


@dataclass(frozen=True)
class Code:
    """A command or a name within a text."""

    text: str


Text: TypeAlias = str | Link | Code | tuple[str | Link | Code, ...]
"""Plain text, a link, a command, or several of them in a row."""


@dataclass(frozen=True)
class Paragraph:
    """A paragraph.

    Attributes:
        text: text of the paragraph.
        kind: CSS class, empty for none.
    """

    text: Text
    kind: str = ""


@dataclass(frozen=True)
class HtmlTable:
    """A table.

    Attributes:
        heading: texts of the columns.
        rows: cells of each row.
        kinds: CSS class of each row; empty for none.
        anchors: names of the rows that links can point to; empty for none.
        kind: CSS class of the table; "meanings": a narrow page puts the last column below the rest.
    """

    heading: Sequence[Text]
    rows: Sequence[Sequence[Text]]
    kinds: Sequence[str] = ()
    anchors: Sequence[str] = ()
    kind: str = ""


@dataclass(frozen=True)
class Cell:
    """A cell of a map.

    Attributes:
        text: text in the cell, a few letters.
        address: address to which the cell leads.
        colour: colour of its background, which black text suits.
        description: the meaning of the cell in words.
    """

    text: str
    address: str
    colour: str
    description: str


@dataclass(frozen=True)
class CellMap:
    """A map of coloured cells that lead somewhere.

    Attributes:
        title: what the rows and the columns are.
        columns: headings of the columns.
        rows: heading and cells of each row, from top to bottom.
    """

    title: str
    columns: Sequence[str]
    rows: Sequence[tuple[str, Sequence[Cell]]]


@dataclass(frozen=True)
class Gallery:
    """Pictures with a common caption.

    Attributes:
        pictures: addresses of the pictures; `embedded` makes one from a file.
        description: text for a reader without pictures.
        caption: text below the pictures.
    """

    pictures: Sequence[str]
    description: str
    caption: Text


@dataclass(frozen=True)
class Film:
    """A film of moving laminae, played by film.js.

    Attributes:
        data: entries that film.js describes, of types that JSON can hold.
        description: text for a reader without pictures.
        caption: text below the film.
    """

    data: Mapping[str, Any]
    description: str
    caption: Text


@dataclass(frozen=True)
class Preformatted:
    """Text whose lines and spaces are kept."""

    text: str


Block: TypeAlias = Paragraph | HtmlTable | CellMap | Gallery | Film | Preformatted


@dataclass(frozen=True)
class PageSection:
    """A part of a page.

    Attributes:
        heading: the heading; empty for none.
        blocks: the content.
        anchor: name that links can point to; empty: made from the heading.
    """

    heading: str
    blocks: Sequence[Block]
    anchor: str = ""

    @property
    def name(self) -> str:
        """The anchor of the section; empty where there is no heading either."""
        return self.anchor or re.sub(r"\W+", "-", self.heading.lower()).strip("-")


def embedded(picture: Path) -> str:
    """Return a PNG file as an address that contains the picture itself.

    Raises:
        OSError: the file cannot be read.
    """
    return f"data:image/png;base64,{base64.b64encode(picture.read_bytes()).decode('ascii')}"


def page(
    title: str, sections: Sequence[PageSection], *, style: str = "", contents: bool = False
) -> str:
    """Return a complete page as HTML.

    Args:
        title: title of the page, also its first heading.
        sections: the content.
        style: CSS rules in addition to the common ones.
        contents: whether a list of the sections follows the sections without a heading.
    """
    parts = [f"<h1>{escape(title)}</h1>"]
    headed = [section for section in sections if section.heading]
    for section in sections:
        if contents and headed and section is headed[0]:
            links = "".join(f"<li>{_text(Link(s.heading, f'#{s.name}'))}</li>" for s in headed)
            parts.append(f'<nav aria-label="Contents"><ul>{links}</ul></nav>')
        if section.heading:
            parts.append(f"<h2{_attribute('id', section.name)}>{escape(section.heading)}</h2>")
        parts += [_block(block) for block in section.blocks]
    kinds = {type(block) for section in sections for block in section.blocks}
    scripts = [name for name, kind in (("page.js", Gallery), ("film.js", Film)) if kind in kinds]
    code = "".join(f"<script>\n{_resource(name)}</script>\n" for name in scripts)
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        '<meta name="color-scheme" content="light dark">\n'
        f"<title>{escape(title)}</title>\n"
        f"<style>\n{_resource('page.css')}{style}</style>\n</head>\n<body>\n"
        + "\n".join(parts)
        + f"\n{code}</body>\n</html>\n"
    )


def files(folder: Path, meanings: Mapping[str, str]) -> HtmlTable:
    """Return a table of links to files of a folder with their meaning, without missing files."""
    existing = {name: meaning for name, meaning in meanings.items() if (folder / name).exists()}
    rows = [(Link(name, name), meaning) for name, meaning in existing.items()]
    return HtmlTable(("file", "content"), rows)


def fragment(blocks: Iterable[Block]) -> str:
    """Return blocks as a piece of HTML for another page, without style and scripts."""
    return "\n".join(_block(block) for block in blocks)


@cache
def _resource(name: str) -> str:
    """Return a style sheet or a script of this folder."""
    return (FOLDER / name).read_text("utf-8")


def _block(block: Block) -> str:
    """Return a block as HTML."""
    if isinstance(block, Paragraph):
        return f"<p{_attribute('class', block.kind)}>{_text(block.text)}</p>"
    if isinstance(block, Preformatted):
        return f"<pre>{escape(block.text)}</pre>"
    if isinstance(block, Gallery):
        pictures = "".join(
            f'<div class="view"><img{_attribute("alt", block.description)}'
            f"{_attribute('src', address)}></div>"
            for address in block.pictures
        )
        return f"<figure>{pictures}<figcaption>{_text(block.caption)}</figcaption></figure>"
    if isinstance(block, Film):  # film.js draws its data, in which no tag can end
        data = json.dumps(block.data, allow_nan=False, separators=(",", ":"))
        data = data.replace("<", "\\u003c")
        return (
            '<figure class="film">'
            f'<canvas role="img"{_attribute("aria-label", block.description)}></canvas>'
            f'<script type="application/json">{data}</script>'
            f"<figcaption>{_text(block.caption)}</figcaption></figure>"
        )
    return _grid(block) if isinstance(block, CellMap) else _table(block)


def _table(table: HtmlTable) -> str:
    """Return a table as HTML."""
    head = "".join(f"<th>{_text(text)}</th>" for text in table.heading)
    none = [""] * len(table.rows)
    body = "\n".join(
        f"<tr{_attribute('id', anchor)}{_attribute('class', kind)}>"
        + "".join(f"<td>{_text(text)}</td>" for text in row)
        + "</tr>"
        for anchor, kind, row in zip(
            table.anchors or none, table.kinds or none, table.rows, strict=True
        )
    )
    return (
        f'<div class="wide"><table{_attribute("class", table.kind)}>\n'
        f"<thead><tr>{head}</tr></thead>\n"
        f"<tbody>\n{body}\n</tbody>\n</table></div>"
    )


def _grid(grid: CellMap) -> str:
    """Return a map as HTML."""
    head = "".join(f"<th>{escape(text)}</th>" for text in ("", *grid.columns))
    body = "\n".join(
        f"<tr><th>{escape(heading)}</th>{''.join(_cell(cell) for cell in cells)}</tr>"
        for heading, cells in grid.rows
    )
    return (
        f'<div class="wide"><table class="map">\n<caption>{escape(grid.title)}</caption>\n'
        f"<tbody>\n{body}\n<tr>{head}</tr>\n</tbody>\n</table></div>"
    )


def _cell(cell: Cell) -> str:
    """Return a cell of a map as HTML."""
    return (
        f"<td{_attribute('style', f'background:{cell.colour}')}>"
        f"<a{_attribute('href', cell.address)}{_attribute('title', cell.description)}>"
        f"{escape(cell.text)}</a></td>"
    )


def _text(text: Text) -> str:
    """Return a text with its links as HTML."""
    if isinstance(text, tuple):
        return "".join(_text(part) for part in text)
    if isinstance(text, Link):
        return f"<a{_attribute('href', text.address)}>{escape(text.text)}</a>"
    if isinstance(text, Code):
        return f"<code>{escape(text.text)}</code>"
    return escape(text)


def _attribute(name: str, value: str) -> str:
    """Return an attribute with a space before it, nothing for an empty value."""
    return f' {name}="{escape(value, quote=True)}"' if value else ""


Report: TypeAlias = Callable[[int, int], None]
"""Function of the numbers of finished and of all periods, points or runs."""


@contextmanager
def reporting(progress: Report | bool | None, unit: str) -> Iterator[Report | None]:
    """Yield a function to call with the progress of a computation; None if nobody wants to know.

    Args:
        progress: the function; True: show a bar; None or False: nothing.
        unit: name of what is counted, such as "period".
    """
    if not isinstance(progress, bool):
        yield progress
    elif not progress:
        yield None
    elif (shell := sys.modules.get("IPython")) and getattr(shell.get_ipython(), "kernel", None):
        from tqdm import tqdm

        with tqdm(unit=f" {unit}s", file=sys.stdout) as bar:

            def tell(done: int, total: int) -> None:
                if bar.total is None:  # what is resumed does not start at 0
                    bar.initial = bar.n = done
                bar.total = total
                bar.update(done - bar.n)

            yield tell
    else:
        from rich.console import Console
        from rich.progress import Progress

        with Progress(console=Console(stderr=True)) as bar:
            task = bar.add_task(f"{unit}s", total=None)
            yield lambda done, total: bar.update(task, completed=done, total=total)
