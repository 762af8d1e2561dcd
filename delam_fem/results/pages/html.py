"""Pages of HTML: a title and sections of paragraphs, tables, figures and preformatted text.

All texts are escaped here, so callers pass plain text. A page needs no other file, except pictures
and links that are given by their address.
"""

from __future__ import annotations

import base64
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import TypeAlias

_STYLE = """
body { font: 16px/1.5 system-ui, sans-serif; color: #222; background: #fff; max-width: 60rem;
       margin: 2rem auto; padding: 0 1rem; }
h1 { font-size: 1.6rem; } h2 { font-size: 1.2rem; margin-top: 2.5rem; }
table { border-collapse: collapse; } td, th { padding: .2rem .9rem .2rem 0; text-align: left;
        border-bottom: 1px solid #ddd; }
figure { margin: 1.5rem 0; } img { max-width: 100%; } figcaption { color: #555; }
pre { background: #f4f4f4; padding: 1rem; overflow-x: auto; font-size: .85rem; }
"""


@dataclass(frozen=True)
class Link:
    """A link within a text.

    Attributes:
        text: of the link.
        address: of the target; `#name` is an anchor of the same page.
    """

    text: str
    address: str


Text: TypeAlias = str | Link | tuple[str | Link, ...]
"""Plain text, a link, or several of both in a row."""


@dataclass(frozen=True)
class Paragraph:
    """A paragraph.

    Attributes:
        text: of the paragraph.
        kind: CSS class, empty for none.
    """

    text: Text
    kind: str = ""


@dataclass(frozen=True)
class Table:
    """A table.

    Attributes:
        heading: texts of the columns.
        rows: cells of each row.
        kinds: CSS class of each row; empty for none.
    """

    heading: Sequence[Text]
    rows: Sequence[Sequence[Text]]
    kinds: Sequence[str] = ()


@dataclass(frozen=True)
class Figure:
    """Pictures with a common caption.

    Attributes:
        pictures: addresses of the pictures; `embedded` makes one from a file.
        description: what a reader without pictures gets.
        caption: below the pictures.
    """

    pictures: Sequence[str]
    description: str
    caption: Text


@dataclass(frozen=True)
class Preformatted:
    """Text whose lines and spaces are kept."""

    text: str


Block: TypeAlias = Paragraph | Table | Figure | Preformatted


@dataclass(frozen=True)
class Section:
    """A part of a page.

    Attributes:
        heading: empty for none.
        blocks: the content.
        anchor: name that links can point to, empty for none.
    """

    heading: str
    blocks: Sequence[Block]
    anchor: str = ""


def embedded(picture: Path) -> str:
    """Return a PNG file as an address that contains the picture itself.

    Raises:
        OSError: the file cannot be read.
    """
    data = base64.b64encode(picture.read_bytes()).decode("ascii")
    return f"data:image/png;base64,{data}"


def page(title: str, sections: Iterable[Section], *, style: str = "") -> str:
    """Return a complete page.

    Args:
        title: of the page, also its first heading.
        sections: the content.
        style: CSS rules in addition to the common ones.
    """
    parts = [f"<h1>{escape(title)}</h1>"]
    for section in sections:
        if section.heading:
            name = _attribute("id", section.anchor)
            parts.append(f"<h2{name}>{escape(section.heading)}</h2>")
        parts += [_block(block) for block in section.blocks]
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{escape(title)}</title>\n<style>{_STYLE}{style}</style>\n</head>\n<body>\n"
        + "\n".join(parts)
        + "\n</body>\n</html>\n"
    )


def _block(block: Block) -> str:
    """Return a block as HTML."""
    if isinstance(block, Paragraph):
        return f"<p{_attribute('class', block.kind)}>{_text(block.text)}</p>"
    if isinstance(block, Preformatted):
        return f"<pre>{escape(block.text)}</pre>"
    if isinstance(block, Figure):
        pictures = "".join(
            f"<img{_attribute('alt', block.description)}{_attribute('src', address)}>"
            for address in block.pictures
        )
        return f"<figure>{pictures}<figcaption>{_text(block.caption)}</figcaption></figure>"
    return _table(block)


def _table(table: Table) -> str:
    """Return a table as HTML."""
    head = "".join(f"<th>{_text(text)}</th>" for text in table.heading)
    kinds = table.kinds or [""] * len(table.rows)
    body = "\n".join(
        f"<tr{_attribute('class', kind)}>"
        + "".join(f"<td>{_text(text)}</td>" for text in row)
        + "</tr>"
        for kind, row in zip(kinds, table.rows, strict=True)
    )
    return f"<table>\n<thead><tr>{head}</tr></thead>\n<tbody>\n{body}\n</tbody>\n</table>"


def _text(text: Text) -> str:
    """Return a text with its links as HTML."""
    if isinstance(text, tuple):
        return "".join(_text(part) for part in text)
    if isinstance(text, Link):
        return f"<a{_attribute('href', text.address)}>{escape(text.text)}</a>"
    return escape(text)


def _attribute(name: str, value: str) -> str:
    """Return an attribute with a space before it, nothing for an empty value."""
    return f' {name}="{escape(value, quote=True)}"' if value else ""
