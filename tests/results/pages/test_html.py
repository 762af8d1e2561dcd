"""Pages are well formed, whatever the texts contain."""

import base64
import json
from html.parser import HTMLParser
from pathlib import Path

import pytest

from delam_fem.api import html
from delam_fem.results.pages.html import (
    Cell,
    CellMap,
    Code,
    Film,
    Gallery,
    HtmlTable,
    Link,
    PageSection,
    Paragraph,
    Preformatted,
)

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
        HtmlTable([NASTY], [[NASTY], [Link(NASTY, NASTY)]]),
        Gallery([NASTY], NASTY, NASTY),
        Film({"name": "</script><b>"}, NASTY, NASTY),
        CellMap(NASTY, [NASTY], [(NASTY, [Cell(NASTY, NASTY, NASTY, NASTY)])]),
        Paragraph((NASTY, Code(NASTY))),
    ],
)
def test_texts_and_addresses_are_escaped(block: html.Block) -> None:
    tags = Tags(html.page("title", [PageSection(NASTY, [block], anchor=NASTY)]))
    assert "b" not in {tag for tag, _ in tags.found}
    assert NASTY in {text for _, text in tags.texts}
    values = {value for _, attributes in tags.found for value in attributes.values()}
    assert NASTY in values  # the anchor


def test_sections_without_heading_or_anchor() -> None:
    tags = Tags(
        html.page("title", [PageSection("", [Paragraph("p", "about")]), PageSection("two", [])])
    )
    assert [name for name, _ in tags.found].count("h2") == 1
    assert ("p", {"class": "about"}) in tags.found and ("h2", {"id": "two"}) in tags.found


def test_contents_lead_to_every_section_and_follow_what_has_no_heading() -> None:
    sections = [
        PageSection("", [Paragraph("first")]),
        PageSection("In motion", []),
        PageSection("Case", [], "file"),
    ]  # fmt: skip
    tags = Tags(html.page("title", sections, contents=True))
    links = [attributes["href"] for tag, attributes in tags.found if tag == "a"]
    assert links == ["#in-motion", "#file"]
    anchors = [attributes.get("id") for tag, attributes in tags.found if tag == "h2"]
    assert [f"#{anchor}" for anchor in anchors] == links
    order = [tag for tag, _ in tags.found if tag in ("p", "nav", "h2")]
    assert order == ["p", "nav", "h2", "h2"]
    assert "nav" not in {tag for tag, _ in Tags(html.page("title", sections)).found}


def test_data_of_a_film_cannot_end_its_script() -> None:
    data = {"name": "</script><b>", "y": [1.5, None]}
    tags = Tags(html.page("title", [PageSection("", [Film(data, "words", "caption")])]))
    texts = [text for tag, text in tags.texts if tag == "script"]
    assert json.loads(texts[0]) == data
    assert len(texts) == 2 and "figure.film" in texts[1]
    with pytest.raises(ValueError, match="JSON compliant"):
        html.page("title", [PageSection("", [Film({"y": float("nan")}, "", "")])])


def test_scripts_are_on_the_page_once_and_only_where_they_are_needed() -> None:
    def count(*blocks: html.Block) -> int:
        return html.page("title", [PageSection("", list(blocks))]).count("<script>")

    figure, film = Gallery(["a.png"], "words", "caption"), Film({}, "words", "caption")
    assert count(Paragraph("words")) == 0
    assert count(figure, figure) == 1
    assert count(figure, film, film) == 2


def test_rows_of_a_table_have_their_kinds() -> None:
    tags = Tags(
        html.page("title", [PageSection("", [HtmlTable(["a"], [["1"], ["2"]], ["good", ""])])])
    )
    assert [attributes for tag, attributes in tags.found if tag == "tr"] == [
        {}, {"class": "good"}, {},
    ]  # fmt: skip


def test_rows_of_a_table_can_be_linked() -> None:
    table = HtmlTable(["a"], [["1"], ["2"]], anchors=["first", "second"])
    tags = Tags(html.page("title", [PageSection("", [table])]))
    rows = [attributes for tag, attributes in tags.found if tag == "tr"]
    assert rows == [{}, {"id": "first"}, {"id": "second"}]


def test_a_kind_per_row_is_required() -> None:
    with pytest.raises(ValueError, match="shorter"):
        html.page("title", [PageSection("", [HtmlTable(["a"], [["1"], ["2"]], ["good"])])])


def test_links_and_pictures_keep_their_addresses(tmp_path: Path) -> None:
    picture = tmp_path / "picture.png"
    picture.write_bytes(b"\x89PNG")
    figure = Gallery(
        [html.embedded(picture), "film.gif"], "words", ("see ", Link("it", "#it"), ".")
    )
    tags = Tags(html.page("title", [PageSection("", [figure])]))
    embedded, film = (attributes for tag, attributes in tags.found if tag == "img")
    data = str(embedded["src"]).removeprefix("data:image/png;base64,")
    assert base64.b64decode(data, validate=True) == b"\x89PNG"
    assert film == {"alt": "words", "src": "film.gif"}
    assert ("a", {"href": "#it"}) in tags.found
