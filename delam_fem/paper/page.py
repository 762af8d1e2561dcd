"""Write the HTML page of the paper's figures, and the tables of its claims for the documentation.

Everything is made from the figNN.json files in a folder; nothing is computed here.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from delam_fem.case.atomic import atomic, write_text
from delam_fem.paper.claims import HEADING, IN_SHORT, Claim, markdown_table
from delam_fem.results.pages import html
from delam_fem.results.pages.html import Block, Figure, Link, Paragraph, Section, Table

PAPER = (
    'I. Müller, "Clapping in Delaminated Sandwich-beams due to Forced Oscillations", '
    "Universität Karlsruhe"
)
ABOUT = (
    "The paper's text is available, its figures are not. Each figure here shows what the "
    "computation gives, and is compared with what the text says: a number, or a statement that a "
    "number can decide. Each verdict states its margin: the numbers that decide, the range that "
    "their own uncertainty allows (in brackets), and the bounds they need. It is "
    '"undecided" where that range contains the bound, and "open" where the text does not allow a '
    "verdict. Bounds on words such as significantly are ours. Unless a row "
    "says otherwise, all computations are with the preset paper: 20 elements, T/1000, Newmark, "
    "lumped impulses with the consistent mass matrix."
)
README_MARKS = ("<!-- paper claims: begin -->", "<!-- paper claims: end -->")
"""Marks in README.md; the short table stands between them."""
HEADLINES = (
    ("3", "1.60 Hz: the thin lamina beats the thick one"),
    ("3", "3.25 Hz gives the maximum strike of all"),
    ("3", "3.65 Hz: period doubling, one contact in two periods"),
    ("14", "50 elements: considerably less high-frequency velocity"),
    ("15", "the classical penalty law is far more sensitive"),
)
"""Figure and text of the claims of the short table. A test keeps README below 8 kB."""
_STYLE = """
td:last-child { white-space: nowrap; font-weight: 600; }
.holds td:last-child { color: var(--mark); } .no td:last-child { color: var(--bad); }
"""
_ROW_CLASS = {"holds": "holds", "does not hold": "no", "undecided": "open", "open": "open"}

Entry = Mapping[str, Any]


def entries(directory: Path, stems: Iterable[str]) -> list[Entry]:
    """Return the contents of the figNN.json files that exist.

    Args:
        directory: folder of the figures.
        stems: file names without suffix, in the wanted order.
    """
    found = []
    for stem in stems:
        path = directory / f"{stem}.json"
        if path.is_file():
            found.append(json.loads(path.read_text("utf-8")) | {"stem": stem})
    return found


def claims_of(figures: Iterable[Entry]) -> list[Claim]:
    """Return the claims of all figures, in the order of the figures."""
    return [Claim(**claim) for figure in figures for claim in figure["claims"]]


def write_page(directory: Path, figures: Sequence[Entry]) -> Path:
    """Write index.html, which shows the figures of a folder and links to its files.

    Raises:
        OSError: the file cannot be written.
    """
    about = Section("", [Paragraph(PAPER), Paragraph(ABOUT, "about")])
    claims = claims_of(figures)
    overview = Section(
        "What the paper says and what came out",
        [Paragraph(tally(claims)), _table(claims, figures)],
    )
    sections = [about, overview, *(_section(figure, figures) for figure in figures)]
    text = html.page("The paper, figure by figure", sections, style=_STYLE, contents=True)
    return write_text(directory / "index.html", text)


def tally(claims: Sequence[Claim]) -> str:
    """Return a sentence that counts the claims by verdict."""
    count = {verdict: sum(c.verdict == verdict for c in claims) for verdict in _ROW_CLASS}
    return (
        f"{len(claims)} statements: {count['holds']} hold, {count['does not hold']} do not, "
        f"{count['undecided']} are undecided, {count['open']} are open."
    )


def headlines(claims: Sequence[Claim]) -> list[Claim]:
    """Return the claims of the short table, those that are there, in the order of `HEADLINES`."""
    found = {(claim.figure, claim.text): claim for claim in claims}
    return [found[key] for key in HEADLINES if key in found]


def write_docs(directory: Path, root: Path, figures: Sequence[Entry]) -> list[Path]:
    """Write docs/paper.md and the short table of README.md, and copy the pictures for the docs.

    Args:
        directory: folder of the figures.
        root: folder of the project.
        figures: figures from `entries`.

    Raises:
        ValueError: README.md lacks the marks.
        OSError: a file cannot be written.
    """
    claims = claims_of(figures)
    lines = [
        "# The paper, figure by figure", "", f"{PAPER}. {ABOUT}", "",
        "This page is written by `scripts/paper_docs.py` from the numbers of `delam-fem paper`.",
        "", tally(claims), "", markdown_table(claims),
    ]  # fmt: skip
    paths = []
    pictures = root / "docs" / "figures"
    pictures.mkdir(parents=True, exist_ok=True)
    for figure in figures:
        lines += [f"## {_heading(figure)}", "", figure["caption"], ""]
        for name in _pictures(figure):
            paths.append(pictures / f"paper_{name}")
            with atomic(paths[-1]) as temporary:
                shutil.copyfile(directory / name, temporary)
            lines += [f"![{figure['title']}](figures/{paths[-1].name})", ""]
    readme = root / "README.md"
    short = markdown_table(headlines(claims), IN_SHORT)
    text = between(
        readme.read_text("utf-8"), README_MARKS, f"\n{tally(claims)} Five of them:\n\n{short}"
    )
    page = write_text(root / "docs" / "paper.md", "\n".join(lines).rstrip() + "\n")
    return [page, write_text(readme, text), *paths]


def between(text: str, marks: tuple[str, str], content: str) -> str:
    """Return a text in which the part between two marks is replaced.

    Raises:
        ValueError: the text does not contain both marks once and in this order.
    """
    begin, end = marks
    if text.count(begin) != 1 or text.count(end) != 1 or text.index(begin) > text.index(end):
        raise ValueError(f"README.md: expected {begin} and then {end}, once each; add these marks")
    head, rest = text.split(begin)
    return f"{head}{begin}\n{content}\n{end}{rest.split(end)[1]}"


def _pictures(figure: Entry) -> list[str]:
    """Return the file names of a figure's picture and of its film, if it has one."""
    return [f"{figure['stem']}.png"] + ([figure["animation"]] if figure.get("animation") else [])


def _heading(figure: Entry) -> str:
    """Return the heading of a figure."""
    name = str(figure["name"])
    return f"Fig. {name}: {figure['title']}" if name[0].isdigit() else str(figure["title"])


def _section(figure: Entry, figures: Sequence[Entry]) -> Section:
    """Return the section of a figure: picture, caption and claims."""
    caption = (f"{figure['caption']} ", Link("Numbers", f"{figure['stem']}.json"), ".")
    blocks: list[Block] = [Figure(_pictures(figure), _heading(figure), caption)]
    if figure["claims"]:
        blocks.append(_table(claims_of([figure]), figures))
    return Section(_heading(figure), blocks, anchor=figure["stem"])


def _table(claims: Sequence[Claim], figures: Sequence[Entry]) -> Table:
    """Return claims as a table with links to their figures."""
    stems = {figure["name"]: figure["stem"] for figure in figures}
    rows = [(Link(c.figure, f"#{stems[c.figure]}"), *c.row[1:]) for c in claims]
    return Table(HEADING, rows, [_ROW_CLASS[claim.verdict] for claim in claims])
