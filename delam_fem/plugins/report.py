"""What a study finds, and how it is written: numbers, pictures, tables, a page."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeAlias

from matplotlib.figure import Figure

from delam_fem.case.definition import Case
from delam_fem.case.files import save_case
from delam_fem.results.figures.style import save_figure
from delam_fem.results.pages import html
from delam_fem.system.files import write_json, write_text


@dataclass(frozen=True)
class Table:
    """A table of text.

    Attributes:
        title: title above the table.
        heading: headings of the columns.
        rows: rows with one entry per column.
    """

    title: str
    heading: Sequence[str]
    rows: Sequence[Sequence[str]]

    def markdown(self) -> str:
        """Return the table as Markdown, with its title in bold."""
        lines = [self.heading, ["---"] * len(self.heading), *self.rows]
        body = "\n".join(f"| {' | '.join(line)} |" for line in lines)
        return f"**{self.title}**\n\n{body}\n"


def number(value: float, form: str = ".4g") -> str:
    """Return a number of a table as text; a dash if it is not finite."""
    return format(value, form) if math.isfinite(value) else "–"


Picture: TypeAlias = "tuple[Callable[[], Figure], str]"
"""Function that draws a picture in the house style, and its caption on a page."""


@dataclass(frozen=True, kw_only=True)
class Report:
    """What a study says of its result, in files and on the terminal.

    Attributes:
        name: name of the JSON file, without its suffix.
        numbers: content of the JSON file; what is not finite becomes null there. None: the study
            writes its numbers itself.
        files: names of files in the folder that the study has written itself.
        case: case that the page shows and case.toml holds; None: neither.
        fitted: case that fits a measurement, which `fitted/case.toml` holds; None: there is none.
        is_sweep: whether the folder is that of a sweep, whose own case.toml stays.
        title: title of the page; empty: there is no page.
        tables: tables at the end of the page.
        sentences: sentences on what the numbers mean.
        remarks: warnings.
        pictures: pictures by the path of the file in the folder, without its suffix.
        left: what is not computed, because the study was interrupted; empty: it is complete.
    """

    name: str
    numbers: Mapping[str, Any] | None
    files: Sequence[str] = ()
    case: Case | None = None
    fitted: Case | None = None
    is_sweep: bool = False
    title: str = ""
    tables: Sequence[Table] = ()
    sentences: Sequence[str] = ()
    remarks: Sequence[str] = ()
    pictures: Mapping[str, Picture] = field(default_factory=dict)
    left: str = ""

    def save(self, directory: Path | str) -> list[Path]:
        """Write the case, the numbers, the pictures and the page; see `Finding.save`."""
        directory = Path(directory)
        if self.case is not None and not self.is_sweep:
            save_case(self.case, directory)
        fitted = [] if self.fitted is None else [save_case(self.fitted, directory / "fitted")]
        written = [path for name in self.files if (path := directory / name).exists()]
        drawn = []
        if self.numbers is not None:
            written.append(write_json(directory / f"{self.name}.json", self.numbers))
        written += fitted
        names = [str(path.relative_to(directory)) for path in written]
        links = [html.Paragraph(html.Link(name, name)) for name in names]
        for name, (draw, caption) in self.pictures.items():
            path = directory / f"{name}.png"
            written.append(save_figure(draw, path))
            drawn.append(html.Gallery([html.embedded(path)], caption, caption))
        if self.title:
            text = " ".join([*self.sentences, *self.remarks])
            case = [] if self.case is None else [html.Preformatted(self.case.to_toml())]
            sections = [
                html.PageSection("", [html.Paragraph(text, "verdict")]),
                html.PageSection("Figures", drawn),
                *(
                    html.PageSection(
                        t.title[:1].upper() + t.title[1:], [html.HtmlTable(t.heading, t.rows)]
                    )
                    for t in self.tables
                ),
                html.PageSection("Files", links),
                html.PageSection("Case", case),
            ]
            page = html.page(self.title, [s for s in sections if s.blocks], contents=True)
            written.append(write_text(directory / "report.html", page))
        return written


class Finding:
    """Result of a study, from which its report is made."""

    @property
    def report(self) -> Report:
        """Report of the finding in files and on the terminal."""
        raise NotImplementedError

    def save(self, directory: Path | str) -> list[Path]:
        """Write the numbers as JSON, the pictures and the page, and return their paths.

        Args:
            directory: folder of the files; it is made where it is missing.

        Raises:
            OSError: a file cannot be written.
        """
        return self.report.save(directory)
