"""What a study found, and the one way in which it becomes files: JSON, pictures, a page."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from delam_fem.case.files import save_case
from delam_fem.results.figures.style import styled
from delam_fem.results.folder import json_ready
from delam_fem.results.pages import html
from delam_fem.system.files import atomic, write_text

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from delam_fem.case.definition import Case


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


Picture: TypeAlias = "tuple[Callable[[], Figure], str]"
"""Function that draws a picture in the house style, and its caption on a page."""


@dataclass(frozen=True, kw_only=True)
class Report:
    """What a study says of its result, in files and on the terminal.

    Attributes:
        name: of the JSON file, without its suffix.
        numbers: content of the JSON file; what is not finite becomes null there. None: the study
            writes its numbers itself.
        files: names of files in the folder that the study has written itself.
        case: shown on the page and written as case.toml; None: neither.
        is_sweep: whether the folder is that of a sweep, whose own case.toml stays.
        title: of the page; empty: there is no page.
        tables: shown at the end.
        sentences: what the numbers mean.
        remarks: warnings.
        pictures: by the path of the file in the folder, without its suffix.
        left: what is not computed, because the study was interrupted; empty: it is complete.
    """

    name: str
    numbers: Mapping[str, Any] | None
    files: Sequence[str] = ()
    case: Case | None = None
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
        directory.mkdir(parents=True, exist_ok=True)
        if self.case is not None and not self.is_sweep:
            save_case(self.case, directory)
        written = [path for name in self.files if (path := directory / name).exists()]
        drawn = []
        if self.numbers is not None:
            text = json.dumps(json_ready(self.numbers), indent=2, allow_nan=False)
            written.append(write_text(directory / f"{self.name}.json", text + "\n"))
        links = [html.Paragraph(html.Link(path.name, path.name)) for path in written]
        for name, (draw, caption) in self.pictures.items():
            path = directory / f"{name}.png"
            path.parent.mkdir(exist_ok=True)
            with styled(), atomic(path) as temporary:
                draw().savefig(temporary)
            written.append(path)
            drawn.append(html.Gallery([html.embedded(path)], caption, caption))
        if self.title:
            text = " ".join([*self.sentences, *self.remarks])
            case = [] if self.case is None else [html.Preformatted(self.case.to_toml())]
            sections = [
                html.Section("", [html.Paragraph(text, "verdict")]),
                html.Section("Figures", drawn),
                *(
                    html.Section(t.title[:1].upper() + t.title[1:], [html.Table(t.heading, t.rows)])
                    for t in self.tables
                ),
                html.Section("Files", links),
                html.Section("Case", case),
            ]
            page = html.page(self.title, [s for s in sections if s.blocks], contents=True)
            written.append(write_text(directory / "report.html", page))
        return written


class Finding:
    """What a study found."""

    @property
    def report(self) -> Report:
        """What it says in files and on the terminal."""
        raise NotImplementedError

    def save(self, directory: Path | str) -> list[Path]:
        """Write the numbers as JSON, the pictures and the page, and return their paths.

        Args:
            directory: made where it is missing.

        Raises:
            OSError: a file cannot be written.
        """
        return self.report.save(directory)
