"""Reproduce the figures of the paper: measure, judge, draw, and write files and pages.

Each figure is described by a `Piece` in one of the modules beside this one. The HTML page of all
figures is made from the figNN.json files in a folder.
"""

from __future__ import annotations

import json
import logging
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from delam_fem.api import CaseError, atomic, html, json_ready, style, write_json, write_text
from delam_fem.paper import histories, lateral, parameters, portraits, responses, shapes
from delam_fem.paper.claims import HEADING, Claim, Piece
from delam_fem.paper.runs import Laboratory

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
    figures = []
    for stem in stems:
        path = directory / f"{stem}.json"
        if path.is_file():
            figures.append(json.loads(path.read_text("utf-8")) | {"stem": stem})
    return figures


def claims_of(figures: Iterable[Entry]) -> list[Claim]:
    """Return the claims of all figures, in the order of the figures."""
    return [Claim(**claim) for figure in figures for claim in figure["claims"]]


def write_page(directory: Path, figures: Sequence[Entry]) -> Path:
    """Write index.html, which shows the figures of a folder and links to its files.

    Raises:
        OSError: the file cannot be written.
    """
    about = html.PageSection("", [html.Paragraph(PAPER), html.Paragraph(ABOUT, "about")])
    claims = claims_of(figures)
    overview = html.PageSection(
        "What the paper says and what came out",
        [html.Paragraph(tally(claims)), _table(claims, figures)],
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


def pictures(figure: Entry) -> list[str]:
    """Return the file names of a figure's picture and of its film, if it has one."""
    return [f"{figure['stem']}.png"] + ([figure["animation"]] if figure.get("animation") else [])


def heading(figure: Entry) -> str:
    """Return the heading of a figure."""
    name = str(figure["name"])
    return f"Fig. {name}: {figure['title']}" if name[0].isdigit() else str(figure["title"])


def _section(figure: Entry, figures: Sequence[Entry]) -> html.PageSection:
    """Return the section of a figure: picture, caption and claims."""
    caption = (f"{figure['caption']} ", html.Link("Numbers", f"{figure['stem']}.json"), ".")
    blocks: list[html.Block] = [html.Gallery(pictures(figure), heading(figure), caption)]
    if figure["claims"]:
        blocks.append(_table(claims_of([figure]), figures))
    return html.PageSection(heading(figure), blocks, anchor=figure["stem"])


def _table(claims: Sequence[Claim], figures: Sequence[Entry]) -> html.HtmlTable:
    """Return claims as a table with links to their figures."""
    stems = {figure["name"]: figure["stem"] for figure in figures}
    rows = [(html.Link(c.figure, f"#{stems[c.figure]}"), *c.row[1:]) for c in claims]
    return html.HtmlTable(HEADING, rows, [_ROW_CLASS[claim.verdict] for claim in claims])


FIGURES: dict[str, Piece] = {
    piece.name: piece
    for piece in (
        shapes.SYSTEM,
        responses.WITHOUT_CONTACT,
        responses.WITH_CONTACT,
        histories.HISTORIES,
        shapes.SHAPES,
        portraits.SPECTRA,
        lateral.ROLLING_STRIP,
        lateral.STRUCK_TIP,
        histories.VELOCITIES,
        portraits.IMPACT_PORTRAITS,
        histories.IMPACTS,
        shapes.CHART,
        portraits.PORTRAITS,
        histories.CONTACT,
        portraits.FINER_MESH,
        parameters.PLANES,
        parameters.THRESHOLD,
    )
}
"""The figures by their short names, in the order of the page."""

_log = logging.getLogger(__name__)


def file_stem(name: str) -> str:
    """Return the stem of a figure's file names: fig01, fig02a, …, or the name itself."""
    digits = name.rstrip("abcdefghijklmnopqrstuvwxyz")
    return f"fig{int(digits):02d}{name[len(digits) :]}" if digits else name


def chosen(names: Sequence[str]) -> list[str]:
    """Return the known names for figure names given by a user ("2a", "fig02a", "2" for all of 2).

    Raises:
        CaseError: there is no such figure; the message lists the names.
    """
    selected: list[str] = []
    for request in names or list(FIGURES):
        short = request.lower().removeprefix("fig").lstrip("0.")
        fits = [name for name in FIGURES if name == short or name.rstrip("ab") == short]
        if not fits:
            raise CaseError(
                f"figure {request!r}: expected one of {', '.join(FIGURES)}; give no names to make "
                "all figures"
            )
        selected += [name for name in fits if name not in selected]
    return [name for name in FIGURES if name in selected]


def reproduce(lab: Laboratory, directory: Path, names: Sequence[str]) -> list[Path]:
    """Compute figures and write their pictures, numbers and films.

    Args:
        lab: laboratory that computes.
        directory: folder for figNN.png, figNN.json and GIFs; it is created if it does not exist.
        names: figure names from `chosen`.

    Returns:
        Paths of the written files.

    Raises:
        OSError: the folder cannot be written or the disk is full.
    """
    paths: list[Path] = []
    for name in names:
        begin = time.perf_counter()
        paths += _write(FIGURES[name], lab, directory, begin)
        _log.info("figure %s: %.1f s", name, time.perf_counter() - begin)
    return paths


def _write(piece: Piece, lab: Laboratory, directory: Path, begin: float) -> list[Path]:
    """Write picture, numbers and film of a piece; each file appears only when it is complete."""
    from matplotlib import rc_context

    picture, numbers_path, film = (
        directory / f"{file_stem(piece.name)}.{end}" for end in ("png", "json", "gif")
    )
    paths = [picture, numbers_path]
    numbers = piece.measure(lab)
    with style.styled(), rc_context({"axes.titlelocation": "left"}):
        with atomic(picture) as temporary:
            style.write_png(piece.draw(numbers), temporary)
        if piece.film is not None:
            with atomic(film) as temporary:
                piece.film(numbers, temporary)
            paths.append(film)
    content = {
        "name": piece.name,
        "title": piece.title,
        "caption": piece.caption.format(numbers),
        "claims": [asdict(claim) for claim in piece.judge(numbers)],
        "animation": None if piece.film is None else film.name,
        "seconds": round(time.perf_counter() - begin, 2),
        "numbers": json_ready(numbers.kept, 7),
    }
    write_json(numbers_path, content)
    return paths
