"""Save figures of detection studies, and pages that show them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from matplotlib.figure import Figure as Drawing

from delam_fem.case.atomic import atomic, write_text
from delam_fem.case.definition import Case
from delam_fem.results.figures.style import styled
from delam_fem.results.pages import html
from delam_fem.results.pages.html import Figure, Paragraph, Preformatted, Section, embedded


def save_drawings(drawings: Mapping[str, Drawing], directory: Path) -> list[Path]:
    """Write figures as PNG by name into a folder, which is made where it is missing."""
    directory.mkdir(parents=True, exist_ok=True)
    paths = []
    with styled():
        for name, drawing in drawings.items():
            path = directory / f"{name}.png"
            with atomic(path) as temporary:
                drawing.savefig(temporary)
            paths.append(path)
    return paths


def save_page(
    title: str,
    text: str,
    figures: Mapping[Path, str],
    case: Case,
    directory: Path,
    more: tuple[Section, ...] = (),
) -> Path:
    """Write the page of a study.

    Args:
        title: of the page.
        text: what was found, in words.
        figures: captions of the PNG files.
        case: that was studied.
        directory: an existing folder.
        more: further sections.
    """
    drawn = [Figure([embedded(path)], caption, caption) for path, caption in figures.items()]
    sections = [
        Section("", [Paragraph(text, "verdict")]),
        Section("Figures", drawn),
        *more,
        Section("Case", [Preformatted(case.to_toml())]),
    ]
    return write_text(directory / "report.html", html.page(title, sections, contents=True))
