"""Pages are well formed, whatever the texts contain."""

import base64
from html.parser import HTMLParser
from pathlib import Path

import pytest

from delam_fem.results.pages import html
from delam_fem.results.pages.html import Figure, Link, Paragraph, Preformatted, Section, Table

NASTY = '<b>"it\'s" & 1 < 2</b>'


class Tags(HTMLParser):
    """Collects tags with their attributes, and the texts within each tag."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.found: list[tuple[str, dict[str, str | None]]] = []
        self.texts: list[tuple[str, str]] = []
        self.feed(text)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.found.append((tag, dict(attrs)))
        if tag not in ("img", "meta"):
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if data.strip() and self.open:
            self.texts.append((self.open[-1], data))


def test_title_stands_in_the_head_and_above_the_content() -> None:
    tags = Tags(html.page(NASTY, [], style=".x { color: red; }"))
    assert ("title", NASTY) in tags.texts and ("h1", NASTY) in tags.texts
    assert any(tag == "style" and text.endswith(".x { color: red; }") for tag, text in tags.texts)


@pytest.mark.parametrize(
    "block",
    [
        Paragraph(NASTY),
        Paragraph((NASTY, Link(NASTY, NASTY))),
        Preformatted(NASTY),
        Table([NASTY], [[NASTY], [Link(NASTY, NASTY)]]),
        Figure([NASTY], NASTY, NASTY),
    ],
)
def test_texts_and_addresses_are_escaped(block: html.Block) -> None:
    tags = Tags(html.page("title", [Section(NASTY, [block], anchor=NASTY)]))
    assert "b" not in {tag for tag, _ in tags.found}
    assert NASTY in {text for _, text in tags.texts}
    values = {value for _, attributes in tags.found for value in attributes.values()}
    assert NASTY in values  # the anchor


def test_sections_without_heading_or_anchor() -> None:
    tags = Tags(html.page("title", [Section("", [Paragraph("p", "about")]), Section("two", [])]))
    assert [name for name, _ in tags.found].count("h2") == 1
    assert ("p", {"class": "about"}) in tags.found and ("h2", {}) in tags.found


def test_rows_of_a_table_have_their_kinds() -> None:
    tags = Tags(html.page("title", [Section("", [Table(["a"], [["1"], ["2"]], ["good", ""])])]))
    assert [attributes for tag, attributes in tags.found if tag == "tr"] == [
        {}, {"class": "good"}, {},
    ]  # fmt: skip


def test_a_kind_per_row_is_required() -> None:
    with pytest.raises(ValueError, match="longer"):
        html.page("title", [Section("", [Table(["a"], [["1"], ["2"]], ["good"])])])


def test_links_and_pictures_keep_their_addresses(tmp_path: Path) -> None:
    picture = tmp_path / "picture.png"
    picture.write_bytes(b"\x89PNG")
    figure = Figure([html.embedded(picture), "film.gif"], "words", ("see ", Link("it", "#it"), "."))
    tags = Tags(html.page("title", [Section("", [figure])]))
    embedded, film = (attributes for tag, attributes in tags.found if tag == "img")
    data = str(embedded["src"]).removeprefix("data:image/png;base64,")
    assert base64.b64decode(data, validate=True) == b"\x89PNG"
    assert film == {"alt": "words", "src": "film.gif"}
    assert ("a", {"href": "#it"}) in tags.found
